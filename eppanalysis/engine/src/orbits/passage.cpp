#include "orbits/passage.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace orbits_passage {

/// What an event is, as far as its instant goes.
enum : i64 {
    CROSSED,  // its guard rises through zero
    INDUCED,  // an event at the same instant has made its input jump, or its element has just come to this mode
    LETS_GO,  // the next event makes its input jump, which moves on along that one's guard
};

/// How each event comes about, from the last one back and from the first one on.
void mark(const Model& model, const Met& met, Indices modes0, Indices kind) {
    i64 p = met.guard.size();
    i64 jump = p - 1;
    auto element = [&](i64 a) { return model.guard_element(met.guard(a)); };
    kind.fill(CROSSED);
    for (i64 a = p - 2; a >= 0; --a) {
        // What follows its input lets go by a guard on rates; what is held on a level, by any.
        i64 m = model.mode_first(element(a)) + ((a > 0) ? met.modes.row(a - 1) : modes0)(element(a));
        bool held = model.mode_lags(m) && model.mode_stick(m);
        bool on_rate = model.guard_rate.row(met.guard(a)).any([](double c) { return c != 0.0; });
        if (met.time(a + 1) == met.time(a) && (held || on_rate) && model.reach(element(jump), element(a))) {
            kind(a) = LETS_GO;
        } else {
            jump = a;
        }
    }
    for (i64 a = 0; a < p; ++a) {
        if (kind(a) == LETS_GO) {
            continue;
        }
        // What the start has passed already switches there.
        bool induced = (a > 0) ? kind(a - 1) == LETS_GO : met.time(a) == 0.0;
        for (i64 b = a; !induced && b > 0 && met.time(b) == met.time(b - 1); --b) {
            induced = element(b - 1) == element(a) || model.reach(element(b - 1), element(a)) || met.time(b - 1) == 0.0;
        }
        kind(a) = induced ? INDUCED : CROSSED;
    }
}

/// Value of a guard; zero at its threshold but for rounding.
double value_of(Vector g, Vector y) {
    double value = 0.0, size = 0.0;
    for (i64 i = 0; i < g.size(); ++i) {
        value += g(i) * y(i);
        size += std::fabs(g(i) * y(i));
    }
    return (std::fabs(value) <= AT_THRESHOLD * size) ? 0.0 : value;
}

/// The derivative D (N, N) of a run's end by its start, and of how much later its events come, `shift` (N,).
///
/// The end is that after the time of the run, whenever its events come. Not a number where a guard is only touched.
///
/// Returns READY, or TOUCHES where an induced event only just reaches its threshold: the derivative is that of the side on
/// which it does. Else why it cannot be had (what is on its way through a dead time is no part of the start).
i64 derivative_of_run(const Model& model, const Combinations& compiled, const Work& work, double base_step, Vector y0,
    Indices modes0, const Met& met, double t_end, Matrix D, Vector shift) {
    Scope scope;
    i64 n = model.A.shape(0), N = y0.size(), n_s = model.S.shape(1), p = met.time.size();
    if (model.smooth_kind.any([](i64 kind) { return kind == orbits_arcs::DELAY_LINE; })) {
        return orbits_arcs::UNSUPPORTED;
    }
    Matrix F = zeros<double>(n, N), S = zeros<double>(n, n_s), J = zeros<double>(N, N), Phi = zeros<double>(N, N);
    Matrix E = zeros<double>(N, N), sense = zeros<double>(1, n_s);
    Vector g = zeros<double>(N), gs = zeros<double>(n_s), row = zeros<double>(N), end = zeros<double>(N);
    Vector y = copy_of(y0), rate = zeros<double>(n), sigma = zeros<double>(n_s);
    Indices kind = zeros<i64>(p), modes = copy_of(modes0);
    const Channels channels{model.smooth_kind, model.smooth_x, model.smooth_H, model.smooth_s, model.smooth_scale, sense};
    mark(model, met, modes0, kind);
    filling::fill_rows(D, identity(N));
    shift.fill(0.0);
    i64 found = orbits_arcs::READY;
    for (i64 a = 0; a <= p; ++a) {
        Scope arc;
        i64 q = find_combination(model, compiled, work, modes, base_step);
        if (q < 0) {
            return orbits_arcs::SINGULAR;
        }
        orbits_arcs::rates_of(compiled, q, F, S);
        filling::fill_rows(J, identity(N));
        g.fill(0.0);
        gs.fill(0.0);
        if (a < p) {
            i64 timing = a;
            while (kind(timing) == LETS_GO) {
                ++timing;
            }
            i64 code = orbits_arcs::guard_rows(model, compiled, q, met.guard(timing), g, gs);
            if (code == orbits_arcs::READY) {
                code = orbits_arcs::event_map(model, compiled, q, met.guard(a), met.modes.row(a), J);
            }
            if (code != orbits_arcs::READY) {
                return code;
            }
        }
        // What comes behind one that lets go is met by itself.
        bool by_itself = a > 0 && kind(a - 1) == LETS_GO;
        if (a < p && kind(a) == INDUCED && !by_itself && value_of(g, y) == 0.0) {
            found = TOUCHES;
        }
        double tau = ((a < p) ? met.time(a) : t_end) - ((a > 0) ? met.time(a - 1) : 0.0);
        // A jump has passed it, be it by a force alone, which acts on no input straight: friction that breaks away.
        if (a < p && a > 0 && kind(a) == CROSSED && tau == 0.0 && value_of(g, y) > 0.0) {
            kind(a) = INDUCED;
        }
        if (orbits_arcs::is_smooth(model, modes, S, gs, sense.row(0))) {
            orbits_sweep::along(channels, 0, F, S, g, gs, 1, y, tau, end, Phi, sigma, row);
        } else {
            orbits_sweep::along(None{}, 0, F, S, g, gs, 0, y, tau, end, Phi, sigma, row);
        }
        orbits_sweep::times(Phi, D, E, n, N);
        orbits_flow::rate_at(F, S, end, sigma, rate);
        if (a == p || kind(a) != INDUCED) {
            double speed = 0.0;
            for (i64 i = 0; i < n; ++i) {
                speed += row(i) * rate(i);
            }
            for (i64 j = 0; j < N; ++j) {
                double sooner = 0.0, later = -shift(j);
                if (a < p) {
                    for (i64 i = 0; i < N; ++i) {
                        sooner += row(i) * E(i, j);
                    }
                    later = (sooner == 0.0) ? 0.0 : (speed != 0.0) ? -sooner / speed : NaN;
                    shift(j) += later;
                }
                // The time that is left to the end is so much shorter.
                if (later != 0.0) {
                    filling::accumulate(E.cut(Span{0, n}, j), later, rate);
                }
            }
        }
        orbits_sweep::times(J, E, D, N, N);
        if (a < p) {
            filling::fill(y.slice(0, n), met.state.row(a));
            filling::fill(y.slice(n, N), met.memory.row(a));
            filling::fill(modes, met.modes.row(a));
        }
    }
    return found;
}

}  // namespace orbits_passage
}  // namespace EPP_ARCH
}  // namespace epp
