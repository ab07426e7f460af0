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
    m.def("run", [](nb::handle model_, nb::handle compiled_, nb::handle work_, nb::handle workspace_,
        nb::handle samples_, nb::handle buffer_, nb::handle now_) {
        Call call;
        const auto model = call.take<Model>(model_, "model");
        const auto compiled = call.take<Combinations>(compiled_, "compiled");
        const auto work = call.take<Work>(work_, "work");
        const auto workspace = call.take<Workspace>(workspace_, "workspace");
        const auto samples = call.take<Samples>(samples_, "samples");
        const auto buffer = call.take<EventBuffer>(buffer_, "buffer");
        auto& now = call.take<Progress>(now_, "now");
        return call.result([&] { return epp::run(model, compiled, work, workspace, samples, buffer, now); });
    }, nb::arg("model"), nb::arg("compiled"), nb::arg("work"), nb::arg("workspace"), nb::arg("samples"),
        nb::arg("buffer"), nb::arg("now"),
        "Run from time 0 to the end; state, modes and memory values of the workspace are changed in place to those at the");

    m.def("lines_before", [](nb::handle model_, nb::handle compiled_, nb::handle workspace_, nb::handle q_) {
        Call call;
        const auto model = call.take<Model>(model_, "model");
        const auto compiled = call.take<Combinations>(compiled_, "compiled");
        const auto workspace = call.take<Workspace>(workspace_, "workspace");
        const auto q = call.take<i64>(q_, "q");
        return call.result([&] { return epp::lines_before(model, compiled, workspace, q); });
    }, nb::arg("model"), nb::arg("compiled"), nb::arg("workspace"), nb::arg("q"),
        "What is on its way through dead times at the start of the next run: what mode combination q has put out.");

    m.def("run_cells", [](nb::handle stack_, nb::handle compiled_, nb::handle work_, nb::handle workspace_,
        nb::handle none_, nb::handle period_samples_, nb::handle buffer_, nb::handle now_, nb::handle x0_,
        nb::handle modes0_, nb::handle H0_, nb::handle compared_, nb::handle base_step_, nb::handle first_,
        nb::handle last_, nb::handle out_) {
        Call call;
        const auto stack = call.take<Models>(stack_, "stack");
        const auto compiled = call.take<Combinations>(compiled_, "compiled");
        const auto work = call.take<Work>(work_, "work");
        const auto workspace = call.take<Workspace>(workspace_, "workspace");
        const auto none = call.take<Samples>(none_, "none");
        const auto period_samples = call.take<Samples>(period_samples_, "period_samples");
        const auto buffer = call.take<EventBuffer>(buffer_, "buffer");
        auto& now = call.take<Progress>(now_, "now");
        const auto x0 = call.take<Matrix>(x0_, "x0");
        const auto modes0 = call.take<IndexMatrix>(modes0_, "modes0");
        const auto H0 = call.take<Matrix>(H0_, "H0");
        const auto compared = call.take<Flags>(compared_, "compared");
        const auto base_step = call.take<Vector>(base_step_, "base_step");
        const auto first = call.take<i64>(first_, "first");
        const auto last = call.take<i64>(last_, "last");
        const auto out = call.take<Outcome>(out_, "out");
        return call.result([&] { return cells::run_cells(stack, compiled, work, workspace, none, period_samples,
            buffer, now, x0, modes0, H0, compared, base_step, first, last, out); });
    }, nb::arg("stack"), nb::arg("compiled"), nb::arg("work"), nb::arg("workspace"), nb::arg("none"),
        nb::arg("period_samples"), nb::arg("buffer"), nb::arg("now"), nb::arg("x0"), nb::arg("modes0"), nb::arg("H0"),
        nb::arg("compared"), nb::arg("base_step"), nb::arg("first"), nb::arg("last"), nb::arg("out"),
        "Run cells first..last-1 of a stack of models; every result goes to its own place in `out`.");

    m.def("verdict_of_run", [](nb::handle model_, nb::handle ev_t_, nb::handle ev_guard_, nb::handle ev_x_,
        nb::handle ev_v_, nb::handle count_, nb::handle t_end_, nb::handle low_, nb::handle high_, nb::handle x_end_,
        nb::handle rate_end_, nb::handle compared_, nb::handle found_) {
        Call call;
        const auto model = call.take<Model>(model_, "model");
        const auto ev_t = call.take<Vector>(ev_t_, "ev_t");
        const auto ev_guard = call.take<Indices>(ev_guard_, "ev_guard");
        const auto ev_x = call.take<Matrix>(ev_x_, "ev_x");
        const auto ev_v = call.take<Matrix>(ev_v_, "ev_v");
        const auto count = call.take<i64>(count_, "count");
        const auto t_end = call.take<double>(t_end_, "t_end");
        const auto low = call.take<Vector>(low_, "low");
        const auto high = call.take<Vector>(high_, "high");
        const auto x_end = call.take<Vector>(x_end_, "x_end");
        const auto rate_end = call.take<Vector>(rate_end_, "rate_end");
        const auto compared = call.take<Flags>(compared_, "compared");
        const auto found = call.take<Vector>(found_, "found");
        return call.result([&] { return verdict::verdict_of_run(model, ev_t, ev_guard, ev_x, ev_v, count, t_end, low,
            high, x_end, rate_end, compared, found); });
    }, nb::arg("model"), nb::arg("ev_t"), nb::arg("ev_guard"), nb::arg("ev_x"), nb::arg("ev_v"), nb::arg("count"),
        nb::arg("t_end"), nb::arg("low"), nb::arg("high"), nb::arg("x_end"), nb::arg("rate_end"), nb::arg("compared"),
        nb::arg("found"), "UNDECIDED, SETTLED, CYCLE or GROWS for a run of a model; the arguments are those of `verdict` and `grows`.");

    m.def("rounding_of_motion", [](nb::handle states_, nb::handle memory_, nb::handle moves_, nb::handle period_,
        nb::handle compared_, nb::handle gains_, nb::handle elements_, nb::handle changes_, nb::handle rounding_) {
        Call call;
        const auto states = call.take<Matrix>(states_, "states");
        const auto memory = call.take<Matrix>(memory_, "memory");
        const auto moves = call.take<Vector>(moves_, "moves");
        const auto period = call.take<double>(period_, "period");
        const auto compared = call.take<Flags>(compared_, "compared");
        const auto gains = call.take<std::tuple<Matrix, Matrix, Matrix>>(gains_, "gains");
        const auto elements = call.take<std::tuple<Matrix, Vector>>(elements_, "elements");
        const auto changes = call.take<std::tuple<Vector, Vector>>(changes_, "changes");
        const auto rounding = call.take<double>(rounding_, "rounding");
        return call.result([&] { return verdict::rounding_of_motion(states, memory, moves, period, compared, gains,
            elements, changes, rounding); });
    }, nb::arg("states"), nb::arg("memory"), nb::arg("moves"), nb::arg("period"), nb::arg("compared"),
        nb::arg("gains"), nb::arg("elements"), nb::arg("changes"), nb::arg("rounding"),
        "Whether elements see but `rounding` of a motion, and the largest share of it that they change in a period.");

    m.def("settle", [](nb::handle table_, nb::handle z_, nb::handle omega_, nb::handle mode_, nb::handle clocked_,
        nb::handle rest_) {
        Call call;
        const auto table = call.take<Table>(table_, "table");
        const auto z = call.take<ComplexVector>(z_, "z");
        const auto omega = call.take<double>(omega_, "omega");
        const auto mode = call.take<i64>(mode_, "mode");
        const auto clocked = call.take<bool>(clocked_, "clocked");
        const auto rest = call.take<Vector>(rest_, "rest");
        return call.result([&] { return periodic::settle_part(table, z, omega, mode, clocked, rest); });
    }, nb::arg("table"), nb::arg("z"), nb::arg("omega"), nb::arg("mode"), nb::arg("clocked"), nb::arg("rest"),
        "Run an automaton over whole periods until mode and memory values come back.");

    m.def("find_extrema", [](nb::handle c_, nb::handle phase_, nb::handle value_) {
        Call call;
        const auto c = call.take<ComplexVector>(c_, "c");
        const auto phase = call.take<Vector>(phase_, "phase");
        const auto value = call.take<Vector>(value_, "value");
        return call.result([&] { return periodic::find_extrema(c, phase, value); });
    }, nb::arg("c"), nb::arg("phase"), nb::arg("value"),
        "All extrema of a series, in order of phase in [0, 2 pi); returns their number.");

    m.def("spans", [](nb::handle c_, nb::handle fine_, nb::handle grid_, nb::handle out_) {
        Call call;
        const auto c = call.take<Matrices>(c_, "c");
        const auto fine = call.take<Matrices>(fine_, "fine");
        const auto grid = call.take<Vector>(grid_, "grid");
        const auto out = call.take<Vector>(out_, "out");
        return call.result([&] { return extrema::spans(c, fine, grid, out); });
    }, nb::arg("c"), nb::arg("fine"), nb::arg("grid"), nb::arg("out"),
        "Greatest less least value of each signal: the best values on a grid, each refined by Newton's method.");

    m.def("build_arcs", [](nb::handle model_, nb::handle compiled_, nb::handle work_, nb::handle base_step_,
        nb::handle modes_, nb::handle guards_, nb::handle timing_, nb::handle F_, nb::handle S_, nb::handle g_,
        nb::handle gs_, nb::handle J_, nb::handle smooth_, nb::handle sense_, nb::handle Y_, nb::handle Ys_,
        nb::handle W_) {
        Call call;
        const auto model = call.take<Model>(model_, "model");
        const auto compiled = call.take<Combinations>(compiled_, "compiled");
        const auto work = call.take<Work>(work_, "work");
        const auto base_step = call.take<double>(base_step_, "base_step");
        const auto modes = call.take<IndexMatrix>(modes_, "modes");
        const auto guards = call.take<Indices>(guards_, "guards");
        const auto timing = call.take<Indices>(timing_, "timing");
        const auto F = call.take<Matrices>(F_, "F");
        const auto S = call.take<Matrices>(S_, "S");
        const auto g = call.take<Matrix>(g_, "g");
        const auto gs = call.take<Matrix>(gs_, "gs");
        const auto J = call.take<Matrices>(J_, "J");
        const auto smooth = call.take<Indices>(smooth_, "smooth");
        const auto sense = call.take<Matrix>(sense_, "sense");
        const auto Y = call.take<Matrices>(Y_, "Y");
        const auto Ys = call.take<Matrices>(Ys_, "Ys");
        const auto W = call.take<Matrices>(W_, "W");
        return call.result([&] { return orbits_arcs::build_arcs(model, compiled, work, base_step, modes, guards,
            timing, F, S, g, gs, J, smooth, sense, Y, Ys, W); });
    }, nb::arg("model"), nb::arg("compiled"), nb::arg("work"), nb::arg("base_step"), nb::arg("modes"),
        nb::arg("guards"), nb::arg("timing"), nb::arg("F"), nb::arg("S"), nb::arg("g"), nb::arg("gs"), nb::arg("J"),
        nb::arg("smooth"), nb::arg("sense"), nb::arg("Y"), nb::arg("Ys"), nb::arg("W"),
        "Fill the arrays of an orbit's arcs from the modes on them and the guards that end them.");

    m.def("sizes_of_residuals", [](nb::handle g_, nb::handle at_once_, nb::handle free_, nb::handle scale_,
        nb::handle period_, nb::handle rows_) {
        Call call;
        const auto g = call.take<Matrix>(g_, "g");
        const auto at_once = call.take<Indices>(at_once_, "at_once");
        const auto free = call.take<Indices>(free_, "free");
        const auto scale = call.take<Vector>(scale_, "scale");
        const auto period = call.take<double>(period_, "period");
        const auto rows = call.take<Vector>(rows_, "rows");
        return call.result([&] { return orbits_sizes::sizes_of_residuals(g, at_once, free, scale, period, rows); });
    }, nb::arg("g"), nb::arg("at_once"), nb::arg("free"), nb::arg("scale"), nb::arg("period"), nb::arg("rows"),
        "Fill `rows` (m + p,) with the sizes of what must vanish: places `free` of y, and the guard that ends each arc.");

    m.def("correct", [](nb::handle channels_, nb::handle chain_, nb::handle curve_, nb::handle input_place_,
        nb::handle n_inputs_, nb::handle effort_, nb::handle plane_, nb::handle step_, nb::handle progress_,
        nb::handle u_, nb::handle here_) {
        Call call;
        const auto chain = call.take<Chain>(chain_, "chain");
        const auto curve = call.take<Curve>(curve_, "curve");
        const auto input_place = call.take<i64>(input_place_, "input_place");
        const auto n_inputs = call.take<i64>(n_inputs_, "n_inputs");
        const auto effort = call.take<Effort>(effort_, "effort");
        const auto plane = call.take<Plane>(plane_, "plane");
        const auto step = call.take<Vector>(step_, "step");
        const auto progress = call.take<Vector>(progress_, "progress");
        const auto u = call.take<Vector>(u_, "u");
        const auto here = call.take<Motion>(here_, "here");
        if (channels_.is_none()) {
            const None channels{};
            return call.result([&] { return orbits_corrector::correct(channels, chain, curve, input_place, n_inputs,
                effort, plane, step, progress, u, here); });
        }
        const auto channels = call.take<Channels>(channels_, "channels");
        return call.result([&] { return orbits_corrector::correct(channels, chain, curve, input_place, n_inputs,
            effort, plane, step, progress, u, here); });
    }, nb::arg("channels").none(), nb::arg("chain"), nb::arg("curve"), nb::arg("input_place"), nb::arg("n_inputs"),
        nb::arg("effort"), nb::arg("plane"), nb::arg("step"), nb::arg("progress"), nb::arg("u"), nb::arg("here"),
        "Newton's method to the orbit in a plane, over start, dwell times and parameter.");

    m.def("states_at", [](nb::handle channels_, nb::handle F_, nb::handle S_, nb::handle smooth_, nb::handle starts_,
        nb::handle marks_, nb::handle times_, nb::handle out_) {
        Call call;
        const auto F = call.take<Matrices>(F_, "F");
        const auto S = call.take<Matrices>(S_, "S");
        const auto smooth = call.take<Indices>(smooth_, "smooth");
        const auto starts = call.take<Matrix>(starts_, "starts");
        const auto marks = call.take<Vector>(marks_, "marks");
        const auto times = call.take<Vector>(times_, "times");
        const auto out = call.take<Matrix>(out_, "out");
        if (channels_.is_none()) {
            const None channels{};
            return call.result([&] { return orbits_signals::states_at(channels, F, S, smooth, starts, marks, times,
                out); });
        }
        const auto channels = call.take<Channels>(channels_, "channels");
        return call.result([&] { return orbits_signals::states_at(channels, F, S, smooth, starts, marks, times, out);
            });
    }, nb::arg("channels").none(), nb::arg("F"), nb::arg("S"), nb::arg("smooth"), nb::arg("starts"), nb::arg("marks"),
        nb::arg("times"), nb::arg("out"),
        "y at increasing `times` of one period, each by its own flow from the start of its arc.");

    m.def("extents", [](nb::handle channels_, nb::handle F_, nb::handle S_, nb::handle smooth_, nb::handle Y_,
        nb::handle Ys_, nb::handle starts_, nb::handle tau_, nb::handle low_, nb::handle high_) {
        Call call;
        const auto F = call.take<Matrices>(F_, "F");
        const auto S = call.take<Matrices>(S_, "S");
        const auto smooth = call.take<Indices>(smooth_, "smooth");
        const auto Y = call.take<Matrices>(Y_, "Y");
        const auto Ys = call.take<Matrices>(Ys_, "Ys");
        const auto starts = call.take<Matrix>(starts_, "starts");
        const auto tau = call.take<Vector>(tau_, "tau");
        const auto low = call.take<Vector>(low_, "low");
        const auto high = call.take<Vector>(high_, "high");
        if (channels_.is_none()) {
            const None channels{};
            return call.result([&] { return orbits_signals::extents(channels, F, S, smooth, Y, Ys, starts, tau, low,
                high); });
        }
        const auto channels = call.take<Channels>(channels_, "channels");
        return call.result([&] { return orbits_signals::extents(channels, F, S, smooth, Y, Ys, starts, tau, low, high);
            });
    }, nb::arg("channels").none(), nb::arg("F"), nb::arg("S"), nb::arg("smooth"), nb::arg("Y"), nb::arg("Ys"),
        nb::arg("starts"), nb::arg("tau"), nb::arg("low"), nb::arg("high"),
        "Smallest and largest value of every signal over an orbit, exact: nodes on every arc, then Newton on the rate.");

    m.def("newton_orbit", [](nb::handle channels_, nb::handle chain_, nb::handle effort_, nb::handle iterations_,
        nb::handle step_, nb::handle here_, nb::handle share_) {
        Call call;
        const auto chain = call.take<Chain>(chain_, "chain");
        const auto effort = call.take<Effort>(effort_, "effort");
        const auto iterations = call.take<i64>(iterations_, "iterations");
        const auto step = call.take<Vector>(step_, "step");
        const auto here = call.take<Motion>(here_, "here");
        const auto share = call.take<i64>(share_, "share");
        if (channels_.is_none()) {
            const None channels{};
            return call.result([&] { return orbits_newton::newton(channels, chain, effort, iterations, step, here,
                share); });
        }
        const auto channels = call.take<Channels>(channels_, "channels");
        return call.result([&] { return orbits_newton::newton(channels, chain, effort, iterations, step, here, share);
            });
    }, nb::arg("channels").none(), nb::arg("chain"), nb::arg("effort"), nb::arg("iterations"), nb::arg("step"),
        nb::arg("here"), nb::arg("share"),
        "Newton's method from `here`, which is moved; without iterations its equations alone are set up.");

    m.def("derivative_of_run", [](nb::handle model_, nb::handle compiled_, nb::handle work_, nb::handle base_step_,
        nb::handle y_, nb::handle modes_, nb::handle time_, nb::handle guard_, nb::handle state_, nb::handle memory_,
        nb::handle met_modes_, nb::handle t_end_, nb::handle D_, nb::handle shift_) {
        Call call;
        const auto model = call.take<Model>(model_, "model");
        const auto compiled = call.take<Combinations>(compiled_, "compiled");
        const auto work = call.take<Work>(work_, "work");
        const auto base_step = call.take<double>(base_step_, "base_step");
        const auto y = call.take<Vector>(y_, "y");
        const auto modes = call.take<Indices>(modes_, "modes");
        const Met met{call.take<Vector>(time_, "time"), call.take<Indices>(guard_, "guard"),
            call.take<Matrix>(state_, "state"), call.take<Matrix>(memory_, "memory"),
            call.take<IndexMatrix>(met_modes_, "met_modes")};
        const auto t_end = call.take<double>(t_end_, "t_end");
        const auto D = call.take<Matrix>(D_, "D");
        const auto shift = call.take<Vector>(shift_, "shift");
        return call.result([&] { return orbits_passage::derivative_of_run(model, compiled, work, base_step, y, modes,
            met, t_end, D, shift); });
    }, nb::arg("model"), nb::arg("compiled"), nb::arg("work"), nb::arg("base_step"), nb::arg("y"), nb::arg("modes"),
        nb::arg("time"), nb::arg("guard"), nb::arg("state"), nb::arg("memory"), nb::arg("met_modes"),
        nb::arg("t_end"), nb::arg("D"), nb::arg("shift"),
        "The derivative D (N, N) of a run's end by its start, and of how much later its events come, `shift` (N,).");

    m.def("sweep_by", [](nb::handle channels_, nb::handle F_, nb::handle S_, nb::handle g_, nb::handle gs_,
        nb::handle J_, nb::handle smooth_, nb::handle at_once_, nb::handle starts_, nb::handle tau_, nb::handle free_,
        nb::handle of_channels_, nb::handle dF_, nb::handle dS_, nb::handle dg_, nb::handle dgs_, nb::handle dJ_,
        nb::handle dshift_, nb::handle dy_, nb::handle out_) {
        Call call;
        const auto F = call.take<Matrices>(F_, "F");
        const auto S = call.take<Matrices>(S_, "S");
        const auto g = call.take<Matrix>(g_, "g");
        const auto gs = call.take<Matrix>(gs_, "gs");
        const auto J = call.take<Matrices>(J_, "J");
        const auto smooth = call.take<Indices>(smooth_, "smooth");
        const auto at_once = call.take<Indices>(at_once_, "at_once");
        const auto starts = call.take<Matrix>(starts_, "starts");
        const auto tau = call.take<Vector>(tau_, "tau");
        const auto free = call.take<Indices>(free_, "free");
        const auto dF = call.take<Matrices>(dF_, "dF");
        const auto dS = call.take<Matrices>(dS_, "dS");
        const auto dg = call.take<Matrix>(dg_, "dg");
        const auto dgs = call.take<Matrix>(dgs_, "dgs");
        const auto dJ = call.take<Matrices>(dJ_, "dJ");
        const auto dshift = call.take<Vector>(dshift_, "dshift");
        const auto dy = call.take<Vector>(dy_, "dy");
        const auto out = call.take<Vector>(out_, "out");
        if (channels_.is_none()) {
            const None channels{};
            const None of_channels{};
            return call.result([&] { return orbits_sweep::sweep_by(channels, F, S, g, gs, J, smooth, at_once, starts,
                tau, free, of_channels, dF, dS, dg, dgs, dJ, dshift, dy, out); });
        }
        const auto channels = call.take<Channels>(channels_, "channels");
        const auto of_channels = call.take<Channels>(of_channels_, "of_channels");
        return call.result([&] { return orbits_sweep::sweep_by(channels, F, S, g, gs, J, smooth, at_once, starts, tau,
            free, of_channels, dF, dS, dg, dgs, dJ, dshift, dy, out); });
    }, nb::arg("channels").none(), nb::arg("F"), nb::arg("S"), nb::arg("g"), nb::arg("gs"), nb::arg("J"),
        nb::arg("smooth"), nb::arg("at_once"), nb::arg("starts"), nb::arg("tau"), nb::arg("free"),
        nb::arg("of_channels").none(), nb::arg("dF"), nb::arg("dS"), nb::arg("dg"), nb::arg("dgs"), nb::arg("dJ"),
        nb::arg("dshift"), nb::arg("dy"), nb::arg("out"),
        "Derivative of the equations that `sweep` sets up by a parameter of which all numbers are functions.");

    m.def("describe_stiction_pulley", [](nb::handle forearm_, nb::handle harness_, nb::handle of_,
        nb::handle amplitude_, nb::handle bias_, nb::handle mean_, nb::handle gain_) {
        Call call;
        const auto forearm = call.take<double>(forearm_, "forearm");
        const auto harness = call.take<double>(harness_, "harness");
        const auto of = call.take<Vector>(of_, "of");
        const auto amplitude = call.take<Vector>(amplitude_, "amplitude");
        const auto bias = call.take<Vector>(bias_, "bias");
        const auto mean = call.take<Matrix>(mean_, "mean");
        const auto gain = call.take<ComplexMatrix>(gain_, "gain");
        return call.result([&] { return describing_closed_forms::stiction_pulley(forearm, harness, of, amplitude, bias,
            mean, gain); });
    }, nb::arg("forearm"), nb::arg("harness"), nb::arg("of"), nb::arg("amplitude"), nb::arg("bias"), nb::arg("mean"),
        nb::arg("gain"), "Both forces of a cable that sticks to a pulley.");

    m.def("describe_lock_pin", [](nb::handle gap_, nb::handle stiffness_, nb::handle damping_, nb::handle unilateral_,
        nb::handle amplitude_, nb::handle bias_, nb::handle omega_, nb::handle mean_, nb::handle gain_) {
        Call call;
        const auto gap = call.take<double>(gap_, "gap");
        const auto stiffness = call.take<double>(stiffness_, "stiffness");
        const auto damping = call.take<double>(damping_, "damping");
        const auto unilateral = call.take<bool>(unilateral_, "unilateral");
        const auto amplitude = call.take<Vector>(amplitude_, "amplitude");
        const auto bias = call.take<Vector>(bias_, "bias");
        const auto omega = call.take<Vector>(omega_, "omega");
        const auto mean = call.take<Vector>(mean_, "mean");
        const auto gain = call.take<ComplexVector>(gain_, "gain");
        return call.result([&] { return describing_closed_forms::lock_pin(gap, stiffness, damping, unilateral,
            amplitude, bias, omega, mean, gain); });
    }, nb::arg("gap"), nb::arg("stiffness"), nb::arg("damping"), nb::arg("unilateral"), nb::arg("amplitude"),
        nb::arg("bias"), nb::arg("omega"), nb::arg("mean"), nb::arg("gain"),
        "Torque of a spring and a damper outside a gap.");

    m.def("describe_map", [](nb::handle breakpoints_, nb::handle slopes_, nb::handle intercepts_, nb::handle jumps_,
        nb::handle amplitude_, nb::handle bias_, nb::handle mean_, nb::handle gain_, nb::handle by_) {
        Call call;
        const auto breakpoints = call.take<Vector>(breakpoints_, "breakpoints");
        const auto slopes = call.take<Vector>(slopes_, "slopes");
        const auto intercepts = call.take<Vector>(intercepts_, "intercepts");
        const auto jumps = call.take<Vector>(jumps_, "jumps");
        const auto amplitude = call.take<Vector>(amplitude_, "amplitude");
        const auto bias = call.take<Vector>(bias_, "bias");
        const auto mean = call.take<Vector>(mean_, "mean");
        const auto gain = call.take<Vector>(gain_, "gain");
        const auto by = call.take<Matrix>(by_, "by");
        return call.result([&] { return describing_piecewise::biased_sinusoid(breakpoints, slopes, intercepts, jumps,
            amplitude, bias, mean, gain, by); });
    }, nb::arg("breakpoints"), nb::arg("slopes"), nb::arg("intercepts"), nb::arg("jumps"), nb::arg("amplitude"),
        nb::arg("bias"), nb::arg("mean"), nb::arg("gain"), nb::arg("by"),
        "Fill `mean`, `gain` and what they change `by` for every pair of `amplitude` and `bias`; only breakpoints inside");

    m.def("describe_automaton", [](nb::handle rules_, nb::handle start_mode_, nb::handle a_, nb::handle b_,
        nb::handle omega_, nb::handle mean_, nb::handle gain_) {
        Call call;
        const auto rules = call.take<Rules>(rules_, "rules");
        const auto start_mode = call.take<i64>(start_mode_, "start_mode");
        const auto a = call.take<Vector>(a_, "a");
        const auto b = call.take<Vector>(b_, "b");
        const auto omega = call.take<Vector>(omega_, "omega");
        const auto mean = call.take<Matrix>(mean_, "mean");
        const auto gain = call.take<ComplexMatrix>(gain_, "gain");
        return call.result([&] { return describing_sinusoid::describe(rules, start_mode, a, b, omega, mean, gain); });
    }, nb::arg("rules"), nb::arg("start_mode"), nb::arg("a"), nb::arg("b"), nb::arg("omega"), nb::arg("mean"),
        nb::arg("gain"), "Mean outputs and gains (points, w) for points of amplitude, bias and frequency (points,).");

    m.def("describe_clamped", [](nb::handle low_, nb::handle high_, nb::handle kappa_, nb::handle eta_,
        nb::handle tau_, nb::handle mean_, nb::handle gain_) {
        Call call;
        const auto low = call.take<Vector>(low_, "low");
        const auto high = call.take<Vector>(high_, "high");
        const auto kappa = call.take<Vector>(kappa_, "kappa");
        const auto eta = call.take<Vector>(eta_, "eta");
        const auto tau = call.take<Vector>(tau_, "tau");
        const auto mean = call.take<Vector>(mean_, "mean");
        const auto gain = call.take<ComplexVector>(gain_, "gain");
        return call.result([&] { return describing_clamped::describe(low, high, kappa, eta, tau, mean, gain); });
    }, nb::arg("low"), nb::arg("high"), nb::arg("kappa"), nb::arg("eta"), nb::arg("tau"), nb::arg("mean"),
        nb::arg("gain"), "Mean of the integrator's state about the bias and its fundamental, over the amplitude.");

    m.def("describe_nordin_shaft", [](nb::handle gap_, nb::handle stiffness_, nb::handle damping_,
        nb::handle amplitude_, nb::handle bias_, nb::handle omega_, nb::handle mean_, nb::handle share_) {
        Call call;
        const auto gap = call.take<double>(gap_, "gap");
        const auto stiffness = call.take<double>(stiffness_, "stiffness");
        const auto damping = call.take<double>(damping_, "damping");
        const auto amplitude = call.take<Vector>(amplitude_, "amplitude");
        const auto bias = call.take<Vector>(bias_, "bias");
        const auto omega = call.take<Vector>(omega_, "omega");
        const auto mean = call.take<Vector>(mean_, "mean");
        const auto share = call.take<ComplexVector>(share_, "share");
        return call.result([&] { return describing_shaft::nordin_shaft(gap, stiffness, damping, amplitude, bias, omega,
            mean, share); });
    }, nb::arg("gap"), nb::arg("stiffness"), nb::arg("damping"), nb::arg("amplitude"), nb::arg("bias"),
        nb::arg("omega"), nb::arg("mean"), nb::arg("share"), "Torque of the settled shaft.");

    m.def("describe_rate_limit", [](nb::handle alpha_, nb::handle kappa_, nb::handle gain_) {
        Call call;
        const auto alpha = call.take<Vector>(alpha_, "alpha");
        const auto kappa = call.take<Vector>(kappa_, "kappa");
        const auto gain = call.take<ComplexVector>(gain_, "gain");
        return call.result([&] { return describing_rate_limit::describe(alpha, kappa, gain); });
    }, nb::arg("alpha"), nb::arg("kappa"), nb::arg("gain"),
        "Gains from input to output, for points (p,) of alpha and kappa.");

    m.def("describe_rate_limit_inside", [](nb::handle error_, nb::handle kappa_, nb::handle gain_) {
        Call call;
        const auto error = call.take<Vector>(error_, "error");
        const auto kappa = call.take<Vector>(kappa_, "kappa");
        const auto gain = call.take<ComplexVector>(gain_, "gain");
        return call.result([&] { return describing_rate_limit::describe_inside(error, kappa, gain); });
    }, nb::arg("error"), nb::arg("kappa"), nb::arg("gain"),
        "Gains from the error ``u - y`` to the rate of the output, over the frequency, for points (p,).");

    m.def("response_and_slope", [](nb::handle A_, nb::handle B_, nb::handle C_, nb::handle s_, nb::handle ds_,
        nb::handle out_) {
        Call call;
        const auto A = call.take<Matrix>(A_, "A");
        const auto B = call.take<Matrix>(B_, "B");
        const auto C = call.take<Matrix>(C_, "C");
        const auto s = call.take<ComplexVector>(s_, "s");
        const auto ds = call.take<ComplexVector>(ds_, "ds");
        const auto out = call.take<View<Complex, 4>>(out_, "out");
        return call.result([&] { return responses::response_and_slope(A, B, C, s, ds, out); });
    }, nb::arg("A"), nb::arg("B"), nb::arg("C"), nb::arg("s"), nb::arg("ds"), nb::arg("out"),
        "Fill `out` with ``C (s - A)^-1 B``, and then with its derivative by what s has the derivative ds by.");

    m.def("shift", [](nb::handle X_, nb::handle places_, nb::handle pivot_, nb::handle of_outputs_,
        nb::handle relative_, nb::handle inputs_, nb::handle a_, nb::handle b_, nb::handle omega_, nb::handle steps_) {
        Call call;
        const auto X = call.take<Matrix>(X_, "X");
        const auto places = call.take<Indices>(places_, "places");
        const auto pivot = call.take<i64>(pivot_, "pivot");
        const auto of_outputs = call.take<Indices>(of_outputs_, "of_outputs");
        const auto relative = call.take<double>(relative_, "relative");
        const auto inputs = call.take<ComplexMatrix>(inputs_, "inputs");
        const auto a = call.take<Matrices>(a_, "a");
        const auto b = call.take<Matrices>(b_, "b");
        const auto omega = call.take<Matrix>(omega_, "omega");
        const auto steps = call.take<Matrices>(steps_, "steps");
        return call.result([&] { return balances::shift(X, places, pivot, of_outputs, relative, inputs, a, b, omega,
            steps); });
    }, nb::arg("X"), nb::arg("places"), nb::arg("pivot"), nb::arg("of_outputs"), nb::arg("relative"),
        nb::arg("inputs"), nb::arg("a"), nb::arg("b"), nb::arg("omega"), nb::arg("steps"),
        "Inputs of n points, and the same with amplitude, bias and frequency shifted.");

    m.def("assemble", [](nb::handle X_, nb::handle places_, nb::handle owner_, nb::handle pivot_, nb::handle static__,
        nb::handle of_elements_, nb::handle inputs_, nb::handle L_, nb::handle dL_, nb::handle J_, nb::handle R_) {
        Call call;
        const auto X = call.take<Matrix>(X_, "X");
        const auto places = call.take<Indices>(places_, "places");
        const auto owner = call.take<Indices>(owner_, "owner");
        const auto pivot = call.take<i64>(pivot_, "pivot");
        const auto static_ = call.take<std::tuple<Matrix, Matrix, Vector>>(static__, "static");
        const auto of_elements = call.take<std::tuple<Matrix, ComplexMatrix, Matrices, ComplexMatrices>>(of_elements_,
            "of_elements");
        const auto inputs = call.take<ComplexMatrix>(inputs_, "inputs");
        const auto L = call.take<ComplexMatrices>(L_, "L");
        const auto dL = call.take<ComplexMatrices>(dL_, "dL");
        const auto J = call.take<Matrices>(J_, "J");
        const auto R = call.take<Matrix>(R_, "R");
        return call.result([&] { return balances::assemble(X, places, owner, pivot, static_, of_elements, inputs, L,
            dL, J, R); });
    }, nb::arg("X"), nb::arg("places"), nb::arg("owner"), nb::arg("pivot"), nb::arg("static"), nb::arg("of_elements"),
        nb::arg("inputs"), nb::arg("L"), nb::arg("dL"), nb::arg("J"), nb::arg("R"),
        "Fill the residuals R (n, 3 m) and Jacobians J (n, 3 m, 3 m + 1) of n balances.");

    m.def("drive", [](nb::handle L_, nb::handle gains_, nb::handle owner_, nb::handle others_, nb::handle pivot_,
        nb::handle inputs_) {
        Call call;
        const auto L = call.take<ComplexMatrices>(L_, "L");
        const auto gains = call.take<ComplexMatrix>(gains_, "gains");
        const auto owner = call.take<Indices>(owner_, "owner");
        const auto others = call.take<Indices>(others_, "others");
        const auto pivot = call.take<i64>(pivot_, "pivot");
        const auto inputs = call.take<ComplexMatrix>(inputs_, "inputs");
        return call.result([&] { return balances::drive(L, gains, owner, others, pivot, inputs); });
    }, nb::arg("L"), nb::arg("gains"), nb::arg("owner"), nb::arg("others"), nb::arg("pivot"), nb::arg("inputs"),
        "Inputs of all elements but the pivot, for given gains and input of the pivot: linear equations.");

    m.def("solve", [](nb::handle J_, nb::handle R_, nb::handle rows_, nb::handle columns_, nb::handle border_,
        nb::handle edge_, nb::handle step_, nb::handle regular_) {
        Call call;
        const auto J = call.take<Matrices>(J_, "J");
        const auto R = call.take<Matrix>(R_, "R");
        const auto rows = call.take<Indices>(rows_, "rows");
        const auto columns = call.take<Indices>(columns_, "columns");
        const auto border = call.take<Matrix>(border_, "border");
        const auto edge = call.take<double>(edge_, "edge");
        const auto step = call.take<Matrix>(step_, "step");
        const auto regular = call.take<Flags>(regular_, "regular");
        return call.result([&] { return balances::solve(J, R, rows, columns, border, edge, step, regular); });
    }, nb::arg("J"), nb::arg("R"), nb::arg("rows"), nb::arg("columns"), nb::arg("border"), nb::arg("edge"),
        nb::arg("step"), nb::arg("regular"),
        "Solve n linear systems for some of their columns; those that are not finite give zeros and False.");

    m.def("move", [](nb::handle X_, nb::handle places_, nb::handle step_, nb::handle longest_, nb::handle largest_,
        nb::handle sound_) {
        Call call;
        const auto X = call.take<Matrix>(X_, "X");
        const auto places = call.take<Indices>(places_, "places");
        const auto step = call.take<Matrix>(step_, "step");
        const auto longest = call.take<double>(longest_, "longest");
        const auto largest = call.take<Vector>(largest_, "largest");
        const auto sound = call.take<Flags>(sound_, "sound");
        return call.result([&] { return balances::move(X, places, step, longest, largest, sound); });
    }, nb::arg("X"), nb::arg("places"), nb::arg("step"), nb::arg("longest"), nb::arg("largest"), nb::arg("sound"),
        "Take steps from points, shortened to the longest that is allowed.");

    m.def("newton_balance", [](nb::handle X_, nb::handle normal_, nb::handle iterations_, nb::handle limits_,
        nb::handle parts_, nb::handle places_, nb::handle pivot_, nb::handle static__, nb::handle elements_,
        nb::handle linear_, nb::handle L_, nb::handle around_, nb::handle jacobian_, nb::handle found_) {
        Call call;
        const auto X = call.take<Matrix>(X_, "X");
        const auto normal = call.take<Matrix>(normal_, "normal");
        const auto iterations = call.take<i64>(iterations_, "iterations");
        const auto limits = call.take<std::tuple<double, double, double, double, double, double>>(limits_, "limits");
        const auto parts = call.take<std::tuple<Indices, Indices, Indices>>(parts_, "parts");
        const auto places = call.take<Indices>(places_, "places");
        const auto pivot = call.take<i64>(pivot_, "pivot");
        const auto static_ = call.take<std::tuple<Matrix, Matrix, Vector>>(static__, "static");
        const auto elements = call.take<std::tuple<Indices, std::tuple<Vector, Vector, Vector, Vector>,
            Matrix>>(elements_, "elements");
        const auto linear = call.take<std::tuple<Matrix, Matrix, Matrix, Matrix>>(linear_, "linear");
        const auto L = call.take<ComplexMatrices>(L_, "L");
        const auto around = call.take<ComplexVector>(around_, "around");
        const auto jacobian = call.take<Matrices>(jacobian_, "jacobian");
        const auto found = call.take<Flags>(found_, "found");
        return call.result([&] { return newton::newton(X, normal, iterations, limits, parts, places, pivot, static_,
            elements, linear, L, around, jacobian, found); });
    }, nb::arg("X"), nb::arg("normal"), nb::arg("iterations"), nb::arg("limits"), nb::arg("parts"), nb::arg("places"),
        nb::arg("pivot"), nb::arg("static"), nb::arg("elements"), nb::arg("linear"), nb::arg("L"), nb::arg("around"),
        nb::arg("jacobian"), nb::arg("found"),
        "Bring points to solutions, of some equations for some of their unknowns.");

    m.def("answer", [](nb::handle table_, nb::handle z_, nb::handle omega_, nb::handle mode_, nb::handle clocked_,
        nb::handle rest_) {
        Call call;
        const auto table = call.take<Table>(table_, "table");
        const auto z = call.take<ComplexVector>(z_, "z");
        const auto omega = call.take<double>(omega_, "omega");
        const auto mode = call.take<i64>(mode_, "mode");
        const auto clocked = call.take<bool>(clocked_, "clocked");
        const auto rest = call.take<Vector>(rest_, "rest");
        return call.result([&] { return answers::answer(table, z, omega, mode, clocked, rest); });
    }, nb::arg("table"), nb::arg("z"), nb::arg("omega"), nb::arg("mode"), nb::arg("clocked"), nb::arg("rest"),
        "What an element that is affine between its switches makes of an input; arguments are those of `settle`.");

    m.def("slopes", [](nb::handle table_, nb::handle pieces_, nb::handle z_, nb::handle omega_, nb::handle S_,
        nb::handle R_, nb::handle jump_, nb::handle at_rest_) {
        Call call;
        const auto table = call.take<Table>(table_, "table");
        const auto pieces = call.take<Pieces>(pieces_, "pieces");
        const auto z = call.take<ComplexVector>(z_, "z");
        const auto omega = call.take<double>(omega_, "omega");
        const auto S = call.take<ComplexMatrix>(S_, "S");
        const auto R = call.take<ComplexMatrix>(R_, "R");
        const auto jump = call.take<Matrix>(jump_, "jump");
        const auto at_rest = call.take<Vector>(at_rest_, "at_rest");
        return call.result([&] { return answers::slopes(table, pieces, z, omega, S, R, jump, at_rest); });
    }, nb::arg("table"), nb::arg("pieces"), nb::arg("z"), nb::arg("omega"), nb::arg("S"), nb::arg("R"),
        nb::arg("jump"), nb::arg("at_rest"),
        "Derivatives (w, n + 1, 2 n + 2) of the coefficients of the outputs by the unknowns.");

    m.def("jacobian", [](nb::handle dW_, nb::handle W_, nb::handle L_, nb::handle dL_, nb::handle on_bias_,
        nb::handle on_mean_, nb::handle pivot_) {
        Call call;
        const auto dW = call.take<ComplexMatrices>(dW_, "dW");
        const auto W = call.take<ComplexMatrix>(W_, "W");
        const auto L = call.take<ComplexMatrices>(L_, "L");
        const auto dL = call.take<ComplexMatrices>(dL_, "dL");
        const auto on_bias = call.take<Matrix>(on_bias_, "on_bias");
        const auto on_mean = call.take<Matrix>(on_mean_, "on_mean");
        const auto pivot = call.take<i64>(pivot_, "pivot");
        return call.result([&] { return answers::jacobian(dW, W, L, dL, on_bias, on_mean, pivot); });
    }, nb::arg("dW"), nb::arg("W"), nb::arg("L"), nb::arg("dL"), nb::arg("on_bias"), nb::arg("on_mean"),
        nb::arg("pivot"), "Derivatives of the equations of a balance by its unknowns, both of number F (2 n + 1) + 1.");

    m.def("equations", [](nb::handle automata_, nb::handle rest_, nb::handle X_, nb::handle linear_, nb::handle means_,
        nb::handle pivot_, nb::handle J_, nb::handle R_, nb::handle W_, nb::handle switches_) {
        Call call;
        const auto automata = call.take<Automata>(automata_, "automata");
        const auto rest = call.take<Vector>(rest_, "rest");
        const auto X = call.take<Vector>(X_, "X");
        const auto linear = call.take<std::tuple<ComplexMatrices, ComplexMatrices>>(linear_, "linear");
        const auto means = call.take<std::tuple<Matrix, Matrix, Vector>>(means_, "means");
        const auto pivot = call.take<i64>(pivot_, "pivot");
        const auto J = call.take<Matrix>(J_, "J");
        const auto R = call.take<Vector>(R_, "R");
        const auto W = call.take<ComplexMatrix>(W_, "W");
        const auto switches = call.take<Indices>(switches_, "switches");
        return call.result([&] { return answers::equations(automata, rest, X, linear, means, pivot, J, R, W, switches);
            });
    }, nb::arg("automata"), nb::arg("rest"), nb::arg("X"), nb::arg("linear"), nb::arg("means"), nb::arg("pivot"),
        nb::arg("J"), nb::arg("R"), nb::arg("W"), nb::arg("switches"),
        "The equations of a balance at its unknowns X, mean, real and imaginary parts of each input, and omega at last.");

    m.def("even_out", [](nb::handle A_, nb::handle sizes_) {
        Call call;
        const auto A = call.take<Matrix>(A_, "A");
        const auto sizes = call.take<Vector>(sizes_, "sizes");
        return call.result([&] { return units::even_out(A, sizes); });
    }, nb::arg("A"), nb::arg("sizes"),
        "Bring a matrix into units of its states, powers of two, in which rows are as long as columns to a factor of two.");

    parts(m);
}
