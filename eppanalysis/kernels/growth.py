"""Compiled: whether a run grows without end, which its last events or its last rate show far beyond all levels.

Far beyond its levels and constants a piecewise linear loop (with dead time or without) is homogeneous: what is k times
as large moves k times as fast. So a motion that comes back enlarged, in all its states alike, comes back so for ever.
"""

import numpy as np

from eppanalysis.kernels.compiling import PART, njit
from eppanalysis.kernels.engine.series import DELAY_LINE

#: How far a motion is beyond levels and constants that count no more, and the share of it to which it grows evenly.
#: (A gap that a motion crosses where it turns delays it by the root of their ratio.)
FAR, EVENLY = 1e6, 1e-4
#: Least growth over as many periods as are compared; without switches, time constants that the growth has lasted.
LEAST, LASTED = 1e-2, 20.0


@njit(**PART)
def grows(model, ev_t, ev_guard, ev_x, ev_v, count, t_end, x_end, rate_end, compared):
    """Whether the motion grows without end: by one factor from period to period, or without a switch along a ray.

    Parameters
    ----------
    model : Model
    ev_t, ev_guard, ev_x, ev_v : arrays (keep, ...)
        Event buffer, `count` of them in all.
    t_end : float
        End of the run.
    x_end, rate_end : arrays (n,) or longer
        State and its rate at the end.
    compared : bool array (n,)
        States that belong to the motion (clocks and inputs do not).
    """
    keep, n = ev_x.shape
    # A sine or a cube is not homogeneous, however far out: nothing that is k times as large moves k times as fast.
    for j in range(model.smooth_kind.size):
        if model.smooth_kind[j] != DELAY_LINE:
            return False
    state, rate = np.zeros(n), np.zeros(n)
    last = ev_t[(count - 1) % keep] if count > 0 else 0.0
    for i in range(n):
        state[i], rate[i] = abs(x_end[i]), abs(rate_end[i])
    if _far(model, state, rate, compared) and _along_a_ray(x_end, rate_end, t_end - last, compared):
        return True
    _reach(ev_t, ev_x, ev_v, count, keep, min(count, keep) - 1, state, rate)
    if count < 3 or not _far(model, state, rate, compared):
        return False
    for p in range(1, min(count, keep) // 3 + 1):
        if repeats(ev_guard, count, keep, p):
            _reach(ev_t, ev_x, ev_v, count, keep, p, state, rate)
            # Two periods by one factor, in all states and rates alike (docs/theory/simulation.md, Verdict).
            if _far(model, state, rate, compared):
                now = _factor(ev_x, ev_v, count - 1, keep, p, state, rate, compared)
                before = _factor(ev_x, ev_v, count - 1 - p, keep, p, state, rate, compared)
                if now > 1.0 + LEAST and abs(now - before) < EVENLY * now:
                    return True
    return False


@njit(**PART)
def repeats(ev_guard, count, keep, p):
    """Whether the last three stretches of p events are the same."""
    for k in range(2 * p):
        if ev_guard[(count - 1 - k) % keep] != ev_guard[(count - 1 - k - p) % keep]:
            return False
    return True


@njit(**PART)
def _reach(ev_t, ev_x, ev_v, count, keep, p, state, rate):
    """How far states, and their rates, reach over the last p events; a state may be small at all its own switches."""
    for i in range(state.size):
        state[i] = rate[i] = 0.0
        for k in range(p):
            r = (count - 1 - k) % keep
            run = 0.1 * abs(ev_v[r, i]) * (ev_t[r] - ev_t[(count - 2 - k) % keep])
            state[i], rate[i] = max(state[i], abs(ev_x[r, i]), run), max(rate[i], abs(ev_v[r, i]))


@njit(**PART)
def _far(model, state, rate, compared):
    """Whether elements' inputs are far beyond their levels, and rates far beyond what constants add to them."""
    one = model.K.shape[1] - 1
    for e in range(model.mode_first.size - 1):
        z0 = model.first[e, 0]
        for m in range(model.mode_first[e], model.mode_first[e + 1]):
            for g in range(model.guard_first[m], model.guard_first[m + 1]):
                size, level = 0.0, abs(model.guard_0[g])
                for a in range(model.first[e + 1, 0] - z0):
                    c = abs(model.guard_z[g, a])
                    level += c * abs(model.Kz[z0 + a, one])
                    for i in range(state.size):
                        size += c * abs(model.C[z0 + a, i]) * state[i] * compared[i]
                if np.any(model.guard_z[g] != 0.0) and not size > FAR * level:
                    return False
    for i in range(state.size):
        if compared[i] and rate[i] < FAR * _pushed(model, i):
            return False
    return True


@njit(**PART)
def _pushed(model, i):
    """Most that constants, of the loop and of its elements' modes, add to the rate of state i."""
    push = abs(model.K[i, model.K.shape[1] - 1])
    for e in range(model.mode_first.size - 1):
        w0 = model.first[e, 1]
        for a in range(model.first[e + 1, 1] - w0):
            gain = abs(model.B[i, w0 + a])
            for j in range(model.smooth_kind.size):
                if model.smooth_w[j] == w0 + a:
                    gain = max(gain, abs(model.S[i, j]))
            most = 0.0
            for m in range(model.mode_first[e], model.mode_first[e + 1]):
                most = max(most, abs(model.mode_w0[m, a]))
            push += gain * most
    return push


@njit(**PART)
def _along_a_ray(x, rate, quiet, compared):
    """Whether state and rate have one direction, and have had it for many times the time in which the state grows."""
    top = 0
    for i in range(compared.size):
        if compared[i] and (abs(x[i]) > abs(x[top]) or not compared[top]):
            top = i
    if x[top] == 0.0 or not compared[top]:
        return False
    # Along a ray all states grow at one rate per second, that of the largest; one that decays fails the comparison.
    per_second = rate[top] / x[top]
    for i in range(compared.size):
        if compared[i] and abs(rate[i] - per_second * x[i]) > EVENLY * per_second * abs(x[top]):
            return False
    return per_second * quiet > LASTED


@njit(**PART)
def _factor(ev_x, ev_v, c, keep, p, state, rate, compared):
    """Factor by which state and rate at event c are those of p events before, in all states alike; 0 where not.

    With dead time what grows may be on its way, and the state at its switches the same: rates show it.
    """
    now, before, top = c % keep, (c - p) % keep, 0
    for i in range(state.size):
        if compared[i] and (abs(ev_v[now, i]) > abs(ev_v[now, top]) or not compared[top]):
            top = i
    factor = ev_v[now, top] / ev_v[before, top] if ev_v[before, top] != 0.0 else 0.0
    for i in range(state.size):
        if compared[i] and (
            abs(ev_v[now, i] - factor * ev_v[before, i]) > EVENLY * rate[i]
            or abs(ev_x[now, i] - factor * ev_x[before, i]) > EVENLY * state[i]
        ):
            return 0.0
    return factor
