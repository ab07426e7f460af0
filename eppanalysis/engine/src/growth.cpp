#include "growth.hpp"

namespace epp {
inline namespace EPP_ARCH {

namespace growth {

/// Whether the last three stretches of p events are the same.
bool repeats(Indices ev_guard, i64 count, i64 keep, i64 p) {
    for (i64 k = 0, k_end = 2 * p; k < k_end; ++k) {
        if (ev_guard(modulo(count - 1 - k, keep)) != ev_guard(modulo(count - 1 - k - p, keep))) {
            return false;
        }
    }
    return true;
}

/// Most that constants, of the loop and of its elements' modes, add to the rate of state i.
double pushed(const Model& model, i64 i) {
    double gain{}, most{};
    i64 w0{};
    double push = std::fabs(model.K(i, model.K.shape(1) - 1));
    for (i64 e = 0, e_end = model.mode_first.size() - 1; e < e_end; ++e) {
        w0 = model.first(e, 1);
        for (i64 a = 0, a_end = model.first(e + 1, 1) - w0; a < a_end; ++a) {
            gain = std::fabs(model.B(i, w0 + a));
            for (i64 j = 0, j_end = model.smooth_kind.size(); j < j_end; ++j) {
                if (model.smooth_w(j) == (w0 + a)) {
                    gain = greatest_of(gain, std::fabs(model.S(i, j)));
                }
            }
            most = 0.0;
            for (i64 m = model.mode_first(e), m_end = model.mode_first(e + 1); m < m_end; ++m) {
                most = greatest_of(most, std::fabs(model.mode_w0(m, a)));
            }
            push += gain * most;
        }
    }
    return push;
}

/// Whether elements' inputs are far beyond their levels, and rates far beyond what constants add to them.
bool far(const Model& model, Vector state, Vector rate, Flags compared) {
    i64 z0{};
    double size{}, level{}, c{};
    i64 one = model.K.shape(1) - 1;
    for (i64 e = 0, e_end = model.mode_first.size() - 1; e < e_end; ++e) {
        z0 = model.first(e, 0);
        for (i64 m = model.mode_first(e), m_end = model.mode_first(e + 1); m < m_end; ++m) {
            for (i64 g = model.guard_first(m), g_end = model.guard_first(m + 1); g < g_end; ++g) {
                size = 0.0;
                level = std::fabs(model.guard_0(g));
                for (i64 a = 0, a_end = model.first(e + 1, 0) - z0; a < a_end; ++a) {
                    c = std::fabs(model.guard_z(g, a));
                    level += c * std::fabs(model.Kz(z0 + a, one));
                    for (i64 i = 0; i < state.size(); ++i) {
                        size += c * std::fabs(model.C(z0 + a, i)) * state(i) * compared(i);
                    }
                }
                if (model.guard_z.row(g).any([&](auto one) { return one != 0.0; }) && !(size > (FAR * level))) {
                    return false;
                }
            }
        }
    }
    for (i64 i = 0; i < state.size(); ++i) {
        if (compared(i) && rate(i) < (FAR * pushed(model, i))) {
            return false;
        }
    }
    return true;
}

/// Whether state and rate have one direction, and have had it for many times the time in which the state grows.
bool along_a_ray(Vector x, Vector rate, double quiet, Flags compared) {
    i64 top = 0;
    for (i64 i = 0; i < compared.size(); ++i) {
        if (compared(i) && (std::fabs(x(i)) > std::fabs(x(top)) || !compared(top))) {
            top = i;
        }
    }
    if (x(top) == 0.0 || !compared(top)) {
        return false;
    }
    // Along a ray all states grow at one rate per second, that of the largest; one that decays fails the comparison.
    double per_second = rate(top) / x(top);
    for (i64 i = 0; i < compared.size(); ++i) {
        if (compared(i) && std::fabs(rate(i) - per_second * x(i)) > (EVENLY * per_second * std::fabs(x(top)))) {
            return false;
        }
    }
    return (per_second * quiet) > LASTED;
}

/// How far states, and their rates, reach over the last p events; a state may be small at all its own switches.
void reach(Vector ev_t, Matrix ev_x, Matrix ev_v, i64 count, i64 keep, i64 p, Vector state, Vector rate) {
    i64 r{};
    double run{};
    for (i64 i = 0; i < state.size(); ++i) {
        const double was1 = 0.0;
        state(i) = was1;
        rate(i) = was1;
        for (i64 k = 0; k < p; ++k) {
            r = modulo(count - 1 - k, keep);
            run = 0.1 * std::fabs(ev_v(r, i)) * (ev_t(r) - ev_t(modulo(count - 2 - k, keep)));
            {
                const double was2 = greatest_of(greatest_of(state(i), std::fabs(ev_x(r, i))), run);
                const double was3 = greatest_of(rate(i), std::fabs(ev_v(r, i)));
                state(i) = was2;
                rate(i) = was3;
            }
        }
    }
}

/// Factor by which state and rate at event c are those of p events before, in all states alike; 0 where not.
///
/// With dead time what grows may be on its way, and the state at its switches the same: rates show it.
double factor(Matrix ev_x, Matrix ev_v, i64 c, i64 keep, i64 p, Vector state, Vector rate, Flags compared) {
    i64 now = modulo(c, keep);
    i64 before = modulo(c - p, keep);
    i64 top = 0;
    for (i64 i = 0; i < state.size(); ++i) {
        if (compared(i) && (std::fabs(ev_v(now, i)) > std::fabs(ev_v(now, top)) || !compared(top))) {
            top = i;
        }
    }
    double factor = (ev_v(before, top) != 0.0) ? ev_v(now, top) / ev_v(before, top) : 0.0;
    for (i64 i = 0; i < state.size(); ++i) {
        if (compared(i) && (std::fabs(ev_v(now, i) - factor * ev_v(before, i)) > (EVENLY * rate(i)) ||
            std::fabs(ev_x(now, i) - factor * ev_x(before, i)) > (EVENLY * state(i)))) {
            return 0.0;
        }
    }
    return factor;
}

/// Whether the motion grows without end: by one factor from period to period, or without a switch along a ray.
///
/// Parameters
/// ----------
/// model : Model
/// ev_t, ev_guard, ev_x, ev_v : arrays (keep, ...)
///     Event buffer, `count` of them in all.
/// t_end : float
///     End of the run.
/// x_end, rate_end : arrays (n,) or longer
///     State and its rate at the end.
/// compared : bool array (n,)
///     States that belong to the motion (clocks and inputs do not).
bool grows(const Model& model, Vector ev_t, Indices ev_guard, Matrix ev_x, Matrix ev_v, i64 count, double t_end,
    Vector x_end, Vector rate_end, Flags compared) {
    Scope scope;
    double now{}, before{};
    i64 keep = ev_x.shape(0);
    i64 n = ev_x.shape(1);
    // A sine or a cube is not homogeneous, however far out: nothing that is k times as large moves k times as fast.
    for (i64 j = 0, j_end = model.smooth_kind.size(); j < j_end; ++j) {
        if (model.smooth_kind(j) != DELAY_LINE) {
            return false;
        }
    }
    Vector state = zeros<double>(n);
    Vector rate = zeros<double>(n);
    double last = (count > 0) ? ev_t(modulo(count - 1, keep)) : 0.0;
    for (i64 i = 0; i < n; ++i) {
        {
            const double was1 = std::fabs(x_end(i));
            const double was2 = std::fabs(rate_end(i));
            state(i) = was1;
            rate(i) = was2;
        }
    }
    if (far(model, state, rate, compared) && along_a_ray(x_end, rate_end, t_end - last, compared)) {
        return true;
    }
    reach(ev_t, ev_x, ev_v, count, keep, least_of<i64>(count, keep) - 1, state, rate);
    if (count < 3 || !far(model, state, rate, compared)) {
        return false;
    }
    for (i64 p = 1, p_end = floor_div(least_of<i64>(count, keep), 3) + 1; p < p_end; ++p) {
        if (repeats(ev_guard, count, keep, p)) {
            reach(ev_t, ev_x, ev_v, count, keep, p, state, rate);
            // Two periods by one factor, in all states and rates alike (docs/theory/simulation.md, Verdict).
            if (far(model, state, rate, compared)) {
                now = factor(ev_x, ev_v, count - 1, keep, p, state, rate, compared);
                before = factor(ev_x, ev_v, count - 1 - p, keep, p, state, rate, compared);
                if (now > (1.0 + LEAST) && std::fabs(now - before) < (EVENLY * now)) {
                    return true;
                }
            }
        }
    }
    return false;
}

}  // namespace growth
}  // namespace EPP_ARCH
}  // namespace epp
