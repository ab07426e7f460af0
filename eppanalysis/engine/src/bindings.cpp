// What Python sees of the engine: functions of arrays, and of named tuples of arrays.

#include "python.hpp"

#include "answers.hpp"
#include "balances.hpp"
#include "cells.hpp"
#include "describing/clamped.hpp"
#include "describing/closed_forms.hpp"
#include "describing/piecewise.hpp"
#include "describing/rate_limit.hpp"
#include "describing/shaft.hpp"
#include "describing/sinusoid.hpp"
#include "engine/run.hpp"
#include "extrema.hpp"
#include "newton.hpp"
#include "orbits/arcs.hpp"
#include "orbits/corrector.hpp"
#include "orbits/newton.hpp"
#include "orbits/passage.hpp"
#include "orbits/signals.hpp"
#include "orbits/sizes.hpp"
#include "orbits/sweep.hpp"
#include "periodic.hpp"
#include "responses.hpp"
#include "units.hpp"
#include "verdict.hpp"

using namespace epp;

NB_MODULE(EPP_MODULE, m) {
    m.doc() = "The compiled engine.";

    m.attr("ALWAYS") = ALWAYS;
    m.attr("SOURCES") = EPP_SOURCES;
#ifdef EPP_BESIDE_AVX2
    m.attr("AVX2") = __builtin_cpu_supports("avx2") != 0;
#else
    m.attr("AVX2") = false;
#endif
    bind(m, "run", &epp::run, {"model", "compiled", "work", "workspace", "samples", "buffer", "now"},
        "Run from time 0 to the end; state, modes and memory values of the workspace are changed in place to those at the");
    bind(m, "step_at_start", &epp::step_at_start,
        {"model", "compiled", "work", "workspace", "none", "buffer", "now", "x0", "modes0", "H0", "without_memory"},
        "To the start of a run at which inputs step: delayed outputs on their way are those before the step.");
    bind(m, "run_cells", &cells::run_cells,
        {"stack", "compiled", "work", "workspace", "none", "period_samples", "buffer", "now", "x0", "modes0", "H0",
         "compared", "base_step", "first", "last", "out"},
        "Run cells first..last-1 of a stack of models; every result goes to its own place in `out`.");
    bind(m, "verdict_of_run", &verdict::verdict_of_run,
        {"model", "ev_t", "ev_guard", "ev_x", "ev_v", "count", "t_end", "low", "high", "x_end", "rate_end",
         "compared", "found"},
        "UNDECIDED, SETTLED, CYCLE or GROWS for a run of a model; the arguments are those of `verdict` and `grows`.");
    bind(m, "rounding_of_motion", &verdict::rounding_of_motion,
        {"states", "memory", "moves", "period", "compared", "on_inputs", "elements", "changes", "rounding"},
        "Whether elements see but `rounding` of a motion, and the largest share of it that they change in a period.");
    bind(m, "settle", &periodic::settle_part, {"table", "z", "omega", "mode", "clocked", "rest"},
        "Run an automaton over whole periods until mode and memory values come back.");
    bind(m, "find_extrema", &periodic::find_extrema, {"c", "phase", "value"},
        "All extrema of a series, in order of phase in [0, 2 pi); returns their number.");
    bind(m, "spans", &extrema::spans, {"c", "fine", "grid", "out"},
        "Greatest less least value of each signal: the best values on a grid, each refined by Newton's method.");
    bind(m, "build_arcs", &orbits_arcs::build_arcs,
        {"model", "compiled", "work", "base_step", "modes", "guards", "timing", "F", "S", "g", "gs", "J", "smooth",
         "sense", "Y", "Ys", "W"},
        "Fill the arrays of an orbit's arcs from the modes on them and the guards that end them.");
    bind(m, "sizes_of_residuals", &orbits_sizes::sizes_of_residuals,
        {"g", "at_once", "free", "scale", "period", "rows"},
        "Fill `rows` (m + p,) with the sizes of what must vanish: places `free` of y, and the guard that ends each arc.");
    bind(m, "correct", &orbits_corrector::correct<None>, &orbits_corrector::correct<Channels>,
        {"channels", "chain", "curve", "input_place", "n_inputs", "effort", "plane", "step", "progress", "u", "here"},
        "Newton's method to the orbit in a plane, over start, dwell times and parameter.");
    bind(m, "states_at", &orbits_signals::states_at<None>, &orbits_signals::states_at<Channels>,
        {"channels", "F", "S", "smooth", "starts", "marks", "times", "out"},
        "y at increasing `times` of one period, each by its own flow from the start of its arc.");
    bind(m, "extents", &orbits_signals::extents<None>, &orbits_signals::extents<Channels>,
        {"channels", "F", "S", "smooth", "Y", "Ys", "starts", "tau", "low", "high"},
        "Smallest and largest value of every signal over an orbit, exact: nodes on every arc, then Newton on the rate.");
    bind(m, "newton_orbit", &orbits_newton::newton<None>, &orbits_newton::newton<Channels>,
        {"channels", "chain", "effort", "iterations", "step", "here", "share"},
        "Newton's method from `here`, which is moved; without iterations its equations alone are set up.");
    bind(m, "derivative_of_run", &orbits_passage::derivative_of_run,
        {"model", "compiled", "work", "base_step", "y", "modes", "met", "t_end", "D", "shift"},
        "The derivative D (N, N) of a run's end by its start, and of how much later its events come, `shift` (N,).");
    bind(m, "sweep_by", &orbits_sweep::sweep_by<None>, &orbits_sweep::sweep_by<Channels>,
        {"channels", "F", "S", "g", "gs", "J", "smooth", "at_once", "starts", "tau", "free", "of_channels", "dF",
         "dS", "dg", "dgs", "dJ", "dshift", "dy", "out"},
        "Derivative of the equations that `sweep` sets up by a parameter of which all numbers are functions.");
    bind(m, "describe_stiction_pulley", &describing_closed_forms::stiction_pulley,
        {"forearm", "harness", "of", "amplitude", "bias", "mean", "gain"},
        "Both forces of a cable that sticks to a pulley.");
    bind(m, "describe_lock_pin", &describing_closed_forms::lock_pin,
        {"gap", "stiffness", "damping", "unilateral", "amplitude", "bias", "omega", "mean", "gain"},
        "Torque of a spring and a damper outside a gap.");
    bind(m, "describe_map", &describing_piecewise::biased_sinusoid,
        {"breakpoints", "slopes", "intercepts", "jumps", "amplitude", "bias", "mean", "gain", "by"},
        "Fill `mean`, `gain` and what they change `by` for every pair of `amplitude` and `bias`; only breakpoints inside");
    bind(m, "describe_automaton", &describing_sinusoid::describe,
        {"rules", "start_mode", "a", "b", "omega", "mean", "gain"},
        "Mean outputs and gains (points, w) for points of amplitude, bias and frequency (points,).");
    bind(m, "describe_clamped", &describing_clamped::describe, {"low", "high", "kappa", "eta", "tau", "mean", "gain"},
        "Mean of the integrator's state about the bias and its fundamental, over the amplitude.");
    bind(m, "describe_nordin_shaft", &describing_shaft::nordin_shaft,
        {"gap", "stiffness", "damping", "amplitude", "bias", "omega", "mean", "share"},
        "Torque of the settled shaft.");
    bind(m, "describe_rate_limit", &describing_rate_limit::describe, {"alpha", "kappa", "gain"},
        "Gains from input to output, for points (p,) of alpha and kappa.");
    bind(m, "describe_rate_limit_inside", &describing_rate_limit::describe_inside, {"error", "kappa", "gain"},
        "Gains from the error ``u - y`` to the rate of the output, over the frequency, for points (p,).");
    bind(m, "response_and_slope", &responses::response_and_slope, {"A", "B", "C", "s", "ds", "out"},
        "Fill `out` with ``C (s - A)^-1 B``, and then with its derivative by what s has the derivative ds by.");
    bind(m, "shift", &balances::shift,
        {"X", "places", "pivot", "of_outputs", "relative", "inputs", "a", "b", "omega", "steps"},
        "Inputs of n points, and the same with amplitude, bias and frequency shifted.");
    bind(m, "assemble", &balances::assemble,
        {"X", "places", "owner", "pivot", "static", "of_elements", "inputs", "L", "dL", "J", "R"},
        "Fill the residuals R (n, 3 m) and Jacobians J (n, 3 m, 3 m + 1) of n balances.");
    bind(m, "drive", &balances::drive, {"L", "gains", "owner", "others", "pivot", "inputs"},
        "Inputs of all elements but the pivot, for given gains and input of the pivot: linear equations.");
    bind(m, "solve", &balances::solve, {"J", "R", "rows", "columns", "border", "edge", "step", "regular"},
        "Solve n linear systems for some of their columns; those that are not finite give zeros and False.");
    bind(m, "move", &balances::move, {"X", "places", "step", "longest", "largest", "sound"},
        "Take steps from points, shortened to the longest that is allowed.");
    bind(m, "newton_balance", &newton::newton,
        {"X", "normal", "iterations", "limits", "parts", "places", "pivot", "static", "elements", "linear", "L",
         "around", "jacobian", "found"},
        "Bring points to solutions, of some equations for some of their unknowns.");
    bind(m, "answer", &answers::answer, {"table", "z", "omega", "mode", "clocked", "rest"},
        "What an element that is affine between its switches makes of an input; arguments are those of `settle`.");
    bind(m, "slopes", &answers::slopes, {"table", "pieces", "z", "omega", "S", "R", "jump", "at_rest"},
        "Derivatives (w, n + 1, 2 n + 2) of the coefficients of the outputs by the unknowns.");
    bind(m, "jacobian", &answers::jacobian, {"dW", "W", "L", "dL", "on_bias", "on_mean", "pivot"},
        "Derivatives of the equations of a balance by its unknowns, both of number F (2 n + 1) + 1.");
    bind(m, "equations", &answers::equations,
        {"automata", "rest", "X", "linear", "means", "pivot", "J", "R", "W", "switches"},
        "The equations of a balance at its unknowns X, mean, real and imaginary parts of each input, and omega at last.");
    bind(m, "even_out", &units::even_out, {"A", "sizes"},
        "Bring a matrix into units of its states, powers of two, in which rows are as long as columns to a factor of two.");

    parts(m);
}
