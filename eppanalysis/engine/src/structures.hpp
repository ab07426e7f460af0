#pragma once
// Tables of arrays, as Python has them.

#include "rows.hpp"

namespace epp {
inline namespace EPP_ARCH {

/// Flat arrays of a hybrid system: n states, w outputs, z inputs, H memory values (the last is 1), s smooth ones.
///
/// Those of several systems of one structure have one axis more, in front.
template <int axes> struct ModelOf {
    View<double, 2 + axes> A{};  // (n, n)
    View<double, 2 + axes> B{};  // (n, w), without delayed outputs
    View<double, 2 + axes> S{};  // (n, s)
    View<double, 2 + axes> K{};  // (n, H)
    View<double, 2 + axes> C{};  // (z, n)
    View<double, 2 + axes> D{};  // (z, w)
    View<double, 2 + axes> Kz{};  // (z, H)
    View<i64, 2 + axes> first{};  // (E + 1, 3) int: where each element's inputs, outputs, memory values begin
    View<i64, 1 + axes> order{};  // (E,) int: elements, each behind those whose outputs act straight on its inputs
    View<i64, 2 + axes> reach{};  // (E + 1, E) int: whether an element's output (last: external inputs) acts straight on an input
    View<i64, 1 + axes> mode_first{};  // (E + 1,) int
    View<double, 3 + axes> mode_wz{};  // (m, w_max, z_max)
    View<double, 3 + axes> mode_wh{};  // (m, w_max, h_max)
    View<double, 3 + axes> mode_ws{};  // (m, w_max, s)
    View<double, 2 + axes> mode_w0{};  // (m, w_max)
    View<i64, 1 + axes> mode_stick{};  // (m,) int
    View<i64, 1 + axes> mode_lags{};  // (m,) int: whether a jump of the element's input may leave it behind
    View<double, 1 + axes> mode_level{};  // (m,)
    View<i64, 1 + axes> guard_first{};  // (m + 1,) int
    View<i64, 1 + axes> guard_element{};  // (g,) int
    View<i64, 1 + axes> guard_target{};  // (g,) int, mode number within the element
    View<i64, 1 + axes> guard_bypass{};  // (g,) int, the mode beyond a sticking target, for an input that jumped over its level
    View<i64, 1 + axes> guard_on_threshold{};  // (g,) int, the mode for an input that stays on the threshold, -1 for none
    View<double, 2 + axes> guard_z{};  // (g, z_max)
    View<double, 2 + axes> guard_rate{};  // (g, z_max)
    View<double, 2 + axes> guard_h{};  // (g, h_max)
    View<double, 2 + axes> guard_w{};  // (g, w_max)
    View<double, 1 + axes> guard_0{};  // (g,)
    View<double, 3 + axes> reset_z{};  // (g, h_max, z_max)
    View<double, 3 + axes> reset_h{};  // (g, h_max, h_max)
    View<double, 2 + axes> reset_0{};  // (g, h_max)
    View<double, 2 + axes> guard_impulse{};  // (g, z_max): on the inputs, of the impulse of its element's first output
    View<i64, 1 + axes> smooth_kind{};  // (s,) int
    View<double, 2 + axes> smooth_x{};  // (s, n)
    View<double, 2 + axes> smooth_H{};  // (s, H)
    View<double, 2 + axes> smooth_s{};  // (s, s): on those before it
    View<double, 1 + axes> smooth_scale{};  // (s,)
    View<i64, 1 + axes> smooth_w{};  // (s,) int, the delayed output of a delay channel
    View<double, 1 + axes> smooth_delay{};  // (s,)
    View<double, 2 + axes> Yx{};  // (y, n)
    View<double, 2 + axes> Yw{};  // (y, w)
    View<double, 2 + axes> YH{};  // (y, H)
    View<double, 1 + axes> breakpoint_time{};  // (k,)
    View<i64, 1 + axes> breakpoint_state{};  // (k,) int
    View<double, 1 + axes> breakpoint_value{};  // (k,)
    View<i64, 1 + axes> breakpoint_memory{};  // (k,) int
    View<double, 1 + axes> breakpoint_slope{};  // (k,)
};
using Model = ModelOf<0>;
using Models = ModelOf<1>;

/// Compiled mode combinations (leading axis: combination).
///
/// Lengths with a + are those of rows that are summed eight numbers at a time: padded with zeros.
struct Combinations {
    Indices count{};  // (3,) int: in use, ever used, the place given up last
    IndexMatrix key{};  // (q, E) int
    Indices linear{};  // (q,) int: no smooth channel acts
    Vector step{};  // (q,)
    Vector rate{};  // (q,) bound on the growth of the powers of M
    Indices ready{};  // (q,) int: whether T and bound are filled
    Matrices M{};  // (q, n+, n+) transposed: M[j, i] = d x_i' / d x_j
    Matrices M_twice{};  // (q, n+, n+) its square, of few states
    Matrices M_size{};  // (q, n+, n+) its absolute values
    Matrices entries{};  // (q, n+ n+ / 8, 8) rows of eight numbers of M that are not zero, of more than a few states
    IndexMatrix row{};  // (q, n+ n+ / 8) int: their rows in M; four at a time, where need be with zeros
    IndexMatrix row_end{};  // (q, n+ / 8) int: behind those of eight columns; () of a few states
    Vector spread_rate{};  // (q,) bound on the growth of the powers of M_size, where M is kept so
    Vector far{};  // (q,) time that a series goes, where the steps of that time cost more; 0 where they do not
    Matrices y_entries{};  // (q, n+ y+ / 8, 8), and so on: Y kept in the same way
    IndexMatrix y_row{};  // (q, n+ y+ / 8) int
    IndexMatrix y_row_end{};  // (q, y+ / 8) int
    Matrices N{};  // (q, n, H)
    Matrices S{};  // (q, n, s)
    Matrices Wx{};  // (q, w, n)
    Matrices WH{};  // (q, w, H)
    Matrices Ws{};  // (q, w, s)
    Matrices Zx{};  // (q, z, n)
    Matrices ZH{};  // (q, z, H)
    Matrices Zs{};  // (q, z, s)
    Matrices Y{};  // (q, n+, y+) transposed: signals on the state
    Matrices YH{};  // (q, y, H)
    Matrices Ys{};  // (q, y, s)
    Indices n_guards{};  // (q,) int
    IndexMatrix guard{};  // (q, G) int
    IndexMatrix next{};  // (q, G) int
    Matrices ga{};  // (q, G, n+) guard rows on the state
    IndexMatrix ga_count{};  // (q, G) int: their entries that are not zero
    View<i64, 3> ga_place{};  // (q, G, n) int
    Matrices ga_size{};  // (q, G, n+) their absolute values
    Matrices gb{};  // (q, G, n+) guard rows on the rate of the state
    Matrices gb_size{};  // (q, G, n+)
    IndexMatrix on_rate{};  // (q, G) int: whether gb has an entry
    Matrices gH{};  // (q, G, H)
    Matrices gs{};  // (q, G, s)
    Matrices gt{};  // (q, G, s): on the rates of the smooth channels
    IndexMatrix smooth_guard{};  // (q, G) int: whether gs or gt has an entry
    Matrices gf{};  // (q, G, n+) guard rows on the state, with the rate put in
    Matrices gfH{};  // (q, G, H)
    Matrices all_gf{};  // (q, n+, G+) transposed: all of them
    Matrices reach_gf{};  // (q, n+, G+) a trace more than their absolute values
    Matrices T{};  // (q, n+, 2n+ + 2G+): from rate at start to state increment, rate, guard increments, guard rates
    Matrices bound{};  // (q, n+, G+)
    Indices longs{};  // (q,) int: lengths of the next two that are filled
    View<double, 4> T_long{};  // (q, lengths, n+, 2n+ + 2G+): as T, over long steps
    View<double, 4> reach{};  // (q, lengths, n+, G+): bound on how far a guard moves on the way, from the rate at the start
};

/// Workspace for compiling a mode combination.
struct Work {
    Matrix E{};  // (w, w)
    Matrix F{};  // (w, n + H + s)
    Matrix rate{};  // (n, n + H + s)
    Matrix inputs{};  // (z, n + H + s)
    Matrix signals{};  // (y, n + H + s)
    Matrices square{};  // (8, n+, n+)
    Matrices guards{};  // (3, n+, G+)
};

/// Workspace of a run (lengths with a + are padded as in `Combinations`).
struct Workspace {
    Matrix X{};  // (order + 1, n+) series of the state
    Matrix Y{};  // (order + 2, n+) sizes behind it
    Matrix Z{};  // (order + 1, y+) series of the signals
    Matrix Sg{};  // (order + 1, s) series of the smooth channels, their arguments, and helpers
    Matrix arg{};
    Matrix aux{};
    Vector p{};  // ((order + 1)+,) series of a guard
    Vector still{};  // (y+,) constant parts of the signals
    Vector x{};  // (n+,) state, modes and memory values (the last one is 1): the start, and the state of the run
    Indices modes{};  // (E,) int
    Vector H{};  // (H,)
    Vector rate{};  // (n+,) rate of the state just before the last event, or at the end
    Vector low{};  // (n+,) least and greatest values of the states on the way
    Vector high{};  // (n+,)
    Vector largest{};  // (n+,) sizes of the states: greatest so far, and those from which they were computed last
    Vector recent{};  // (n+,)
    Vector spread{};  // (n+,) sum of the absolute terms of the series behind the start
    Vector push{};  // (n+,) constant part of the rate in the mode
    Vector slope{};  // (n+,) rate that fast steps carry along, and its size
    Vector speed{};  // (n+,)
    Vector small{};  // (n+,) rounding of the states, and scratch workspaces
    Vector wide{};  // (n+,)
    Vector one{};  // (n+,) ones
    Vector memory{};  // (H,)
    Vector constant{};  // (G+,) constant parts of the guards on state and rate, and on the state alone
    Vector lift{};  // (G+,)
    Vector g0{};  // (G+,) guards, their rates and their rounding, which fast steps carry along
    Vector g1{};  // (G+,)
    Vector tol{};  // (G+,)
    Vector stray{};  // (G+,) bound on how far each guard strays, and on how high it comes
    Vector top{};  // (G+,)
    Vector end{};  // (2n+ + 2G+,)
    Vector watch{};  // (3,) candidate period of a run that closes, events near their predecessors, eighths of events
    Matrices line_t{};  // (s, segments, 2) begin and end of each segment of a delayed output
    Matrix line_h{};  // (s, segments) unit of its series
    Matrices line_c{};  // (s, segments, order + 1)
    IndexMatrix line_n{};  // (s, 2) int: segments written, segment being read
    Vector behind_x{};  // (n+,) state, modes, memory values and sizes of a run that has closed, behind its periods
    Indices behind_modes{};  // (E,) int
    Vector behind_H{};  // (H,)
    Vector behind_recent{};  // (n+,)
    Vector once{};  // (events,) times of the events of its period
    Matrix then_x{};  // (2, n+) state behind a jump of inputs, and that of a jump that is tried
    Indices then_modes{};  // (E,) int
    Vector then_H{};  // (H,)
    Vector before{};  // (z,) inputs of the elements before a jump
};

/// Times at which signals are wanted, where the signals go, and room to sort times.
struct Samples {
    Vector times{};  // (2 nt,) increasing; the second half is room for phases in a period
    Indices rows{};  // (2 nt,) int: the row of `out` for each
    Matrix out{};  // (nt, y+)
    Vector phases{};  // (nt,)
    Indices order{};  // (nt,) int
    Indices bins{};  // (nt + 1,) int
};

/// The last events of a run (leading axis: place).
struct EventBuffer {
    Vector t{};  // (keep,)
    Indices guard{};  // (keep,) int
    Matrix x{};  // (keep, n) state just after the event
    Matrix v{};  // (keep, n) its rate just before
    Matrix H{};  // (keep, h) memory values
    IndexMatrix modes{};  // (keep, E) int
};

/// The state of a run, and the request.
struct Progress {
    double t_end{};
    double base_step{};
    i64 max_events{};
    bool watch{};
    bool past_known{};
    double slice{};
    double most_steps{};
    double t{};
    double until{};
    double origin{};
    i64 j_grid{};
    i64 q{};
    i64 i_sample{};
    i64 n_samples{};
    i64 i_breakpoint{};
    i64 quiet{};
    double last_t{};
    i64 same_instant{};
    i64 untimed{};
    bool armed{};
    bool forced{};
    bool entered{};
    bool renewed{};
    bool stepped{};
    bool watched{};
    bool aside{};
    double t_behind{};
    i64 i_behind{};
    double h{};
    double t1{};
    double t_stop{};
    double holds{};
    double d{};
    double ahead{};
    bool on_grid{};
    i64 why{};
    i64 last{};
    i64 which{};
    double best{};
    bool stays{};
    i64 guard{};
    i64 code{};
    bool paused{};
    double spent{};
    i64 count{};
    i64 fast_steps{};
    i64 series_steps{};
    i64 refused_series{};
    i64 forced_leaves{};
    i64 periods_repeated{};
};

/// Results of cells (leading axis: cell).
struct Outcome {
    Indices code{};  // (cells,) int: how the run ended
    Indices verdict{};  // (cells,) int
    Indices events{};  // (cells,) int
    Vector since{};  // (cells,) time of the last event
    Vector period{};  // (cells,)
    Matrix change{};  // (cells, 2): last and extrapolated change of the cycle
    Matrix mean{};  // (cells, y)
    Matrix low{};  // (cells, y)
    Matrix high{};  // (cells, y)
    Matrix rms{};  // (cells, y): about the mean
    Indices stop{};  // (1,) int: set, from another thread, to end before all cells are done
};

/// Mode guards (s) and modes (m) of an automaton as arrays; memory values h, inputs z in their roles, outputs w.
///
/// A mode guard of a mode fires where ``factor * series + on_memory @ h + on_clock * time + constant`` rises through
/// zero (`series` -1: it has none), writes ``from_input @ z + from_memory @ h + memory_constant`` into the memory
/// values, and leads to the mode `target`. `on_free` and `on_rate` are what ``factor * series`` is of the free input
/// and of its rate, `free_series` and `rate_series` what each series is. In a mode an output is ``w_free * z + w_rate *
/// dz/dt + w_memory @ h + w_constant``.
struct Table {
    Indices roles{};  // (inputs,): 0 the free series, 1 its rate, 2 the time
    Indices first{};  // (m + 1,): first mode guard of each mode
    Indices series{};
    Vector factor{};
    Vector constant{};
    Matrix on_memory{};  // (s, h)
    Vector on_clock{};
    Indices target{};
    Matrices from_input{};  // (s, h, inputs)
    Matrices from_memory{};  // (s, h, h)
    Matrix memory_constant{};  // (s, h)
    Vector on_free{};
    Vector on_rate{};
    Vector free_series{};  // (S,)
    Vector rate_series{};  // (S,)
    Matrix w_free{};  // (m, w)
    Matrix w_rate{};  // (m, w)
    Matrices w_memory{};  // (m, w, h)
    Matrix w_constant{};  // (m, w)
};

/// What a period consists of, with s switches, h memory values, w outputs.
struct Pieces {
    Vector edges{};  // (s + 2,) phases: begin, switches, end
    Indices modes{};  // (s + 1,)
    Matrix memory{};  // (s + 1, h)
    Indices fired{};  // (s,) mode guards in the table
};

/// The elements of a loop, all of one input and affine between their switches.
struct Automata {
    View<const Table, 1> tables{};
    Indices modes{};  // (F,): at the start
    Flags clocked{};  // (F,) bool
    IndexMatrix first{};  // (F + 1, 2): first output, and first memory value, of each
};

/// Modes (leading axis m) and guards (g), inputs z, outputs w, memory values h, smooth functions s.
struct Rules {
    Matrices from_input{};  // (m, w, z)
    Matrices from_memory{};  // (m, w, h)
    Matrices from_smooth{};  // (m, w, s)
    Matrix constant{};  // (m, w)
    Indices smooth_kind{};  // (s,) int
    Matrix smooth_input{};  // (s, z)
    Vector smooth_constant{};  // (s,)
    Vector smooth_scale{};  // (s,)
    Indices guard_mode{};  // (g,) int
    Indices target{};  // (g,) int: the mode beyond a sticking one
    Matrix on_input{};  // (g, z)
    Matrix on_rate{};  // (g, z)
    Matrix on_memory{};  // (g, h)
    Matrix on_output{};  // (g, w)
    Vector guard_constant{};  // (g,)
    Matrices memory_from_input{};  // (g, h, z)
    Matrices memory_from_memory{};  // (g, h, h)
    Matrix memory_constant{};  // (g, h)
    Vector start{};  // (h,)
};

/// The smooth channels of a model, under the names that they have there.
///
/// Kernels take None where none acts on any arc: what handles them is not compiled then.
struct Channels {
    Indices smooth_kind{};  // (s,) int
    Matrix smooth_x{};  // (s, n)
    Matrix smooth_H{};  // (s, H)
    Matrix smooth_s{};  // (s, s): on those before it
    Vector smooth_scale{};  // (s,)
    Matrix sense{};  // (p, s): sign of the argument on each arc, for channels that depend on its magnitude
};

/// What the motion along one arc depends on, or the derivatives of it by a parameter.
struct Numbers {
    Matrix F{};  // (n, N)
    Matrix S{};  // (n, s)
    Matrix smooth_x{};  // (s, n)
    Matrix smooth_H{};  // (s, H)
    Matrix smooth_s{};  // (s, s)
    Vector smooth_scale{};  // (s,)
};

/// The events of a run in their order: when, which guard, and state, memory values and modes behind each.
struct Met {
    Vector time{};  // (p,)
    Indices guard{};  // (p,) int
    Matrix state{};  // (p, n)
    Matrix memory{};  // (p, H)
    IndexMatrix modes{};  // (p, E) int
};

/// The numbers that go with channels; none without.
template <class C> using NumbersOf = std::conditional_t<std::is_same_v<C, None>, None, Numbers>;

/// The arcs of an orbit, as `sweep` takes them.
struct Chain {
    Matrices F{};
    Matrices S{};
    Matrix g{};
    Matrix gs{};
    Matrices J{};
    Indices smooth{};
    Indices at_once{};
    Indices free{};
    Vector shift{};
    double duration{};  // of all arcs together where an input drives the motion; else not a number
};

/// An iterate: start, dwell times, what a sweep along the arcs fills, sizes of the motion and of the residuals.
struct Motion {
    Vector y{};  // (N,)
    Vector tau{};  // (p,)
    Matrix starts{};  // (p + 1, N)
    Matrix ends{};  // (p, N)
    Matrix A{};  // (m + p, m + p)
    Vector r{};  // (m + p,)
    Vector speed{};  // (p,)
    Vector scale{};  // (N,)
    Vector rows{};  // (m + p,)
};

/// Work that may be done, and how much a sweep with its linear equations is, and a series.
struct Effort {
    double most{};
    double sweep{};
    double series{};
};

/// All numbers of an orbit's arcs in one vector, and the polynomials of the parameter that some of them are.
struct Curve {
    double middle{};
    double half{};
    Vector base{};  // (n,)
    Indices places{};  // (k,) int: those that vary
    Matrix coefficients{};  // (degree + 1, k): of Chebyshev's polynomials over middle +- half
};

/// A plane across a branch, at a distance from an orbit on it, and how far Newton's method may go from there.
struct Plane {
    Vector row{};  // (m + p + 1,)
    Vector old{};  // (m + p + 1,): unknowns of the orbit
    double distance{};
    Vector slope{};  // (m + p,): derivative of the residual by the parameter
    double largest{};  // size of the motion
    double longest{};  // period [s]
};

}  // namespace EPP_ARCH
}  // namespace epp
