"""Compiled: fast steps of an affine mode by matrices made beforehand, each with the proof that no guard rises on it.

A fast step proves it from end values, end rates and a bound on the fourth derivative (Bernstein coefficients of the
cubic plus its remainder); a long one, of 16 to 65536 steps of the grid, from a bound on how far a guard travels at all.
Derived in docs/theory/engine.md, "Two ways to advance".
"""

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.flow import compile_long, compile_step, rate_from
from eppanalysis.kernels.engine.series import EPS
from eppanalysis.kernels.engine.signals import slack_at, write
from eppanalysis.kernels.engine.tables import HOT, INLINE, LONG_DOUBLINGS, LONGS
from eppanalysis.kernels.engine.workspace import DIVERGED
from eppanalysis.kernels.simd.vectors import (
    add,
    any_above,
    cubics_below,
    dot,
    lower_to,
    raise_to,
    row_sum,
    row_sum_from,
    take,
    take_larger,
    take_sizes,
)

#: A state beyond this has diverged.
LARGEST = 1e100
#: Why fast steps end.
OFF_GRID, EVENT_AHEAD, LONG_AHEAD = 0, 1, 2
#: Steps without a switch before a long one (of as many) is tried.
LONG_QUIET = 16


@njit(**INLINE)
def violated(compiled, q, x, recent, constant, wide):
    """A guard that stands clearly above zero already, without any series; -1 when there is none."""
    take_larger(wide, x, recent)
    for g in range(compiled.n_guards[q]):
        v = constant[g] + dot(compiled.ga[q, g], x)
        if v > 0.0 and not compiled.on_rate[q, g] and v > 1e-9 * (abs(constant[g]) + dot(compiled.ga_size[q, g], wide)):
            return g
    return -1


@njit(**INLINE)
def pays(compiled, samples, now):
    """Whether steps by matrices may be made: where series go as far for less, only long ones, once they are due."""
    if compiled.far[now.q] == 0.0:
        return True
    until_sample = now.i_sample == now.n_samples or samples.times[now.i_sample] >= now.t + LONG_QUIET * now.h
    return now.quiet >= LONG_QUIET and until_sample


@njit(**INLINE)
def arm(compiled, work, q, workspace):
    """Matrices, rates and guards of a linear mode combination, for the fast steps that follow."""
    if not compiled.ready[q]:
        compile_step(compiled, work, q)
    x, xd, wide, speed, constant, g0 = (
        workspace.x,
        workspace.slope,
        workspace.wide,
        workspace.speed,
        workspace.constant,
        workspace.g0,
    )
    take_sizes(wide, x)
    # The rate is summed anew from the state, so that steps carry no rounding from one mode into the next.
    rate_from(compiled, q, workspace.push, x, 1.0, xd)
    take_sizes(speed, xd)
    G = compiled.n_guards[q]
    for g in range(G):
        v, size = constant[g] + dot(compiled.ga[q, g], x), abs(constant[g]) + dot(compiled.ga_size[q, g], wide)
        if compiled.on_rate[q, g]:
            v += dot(compiled.gb[q, g], xd)
            size += dot(compiled.gb_size[q, g], speed)
        g0[g], workspace.g1[g], workspace.tol[g] = v, dot(compiled.gf[q, g], xd), 256.0 * EPS * size
    for g in range(G, g0.size):
        g0[g], workspace.g1[g], workspace.tol[g] = -1.0, 0.0, 0.0


@njit(**HOT)
def go_far(compiled, work, workspace, samples, now):
    """One long step, where nothing has happened for a while and nothing is to be sampled; whether it was made."""
    if now.quiet < LONG_QUIET or not now.armed:
        return False
    q, h = now.q, now.h
    # The longer nothing has happened, the longer the step that is tried: 16 steps of the grid, then 256, and so on; the
    # longest that ends before the next sample.
    level = min(now.quiet // 32, LONGS - 1)
    all_taken = now.i_sample == now.n_samples
    while True:
        steps = 1 << (LONG_DOUBLINGS * (level + 1))
        t1 = now.origin + (now.j_grid + steps) * h
        if t1 <= now.t_stop and (all_taken or samples.times[now.i_sample] >= t1 - slack_at(t1, h)):
            break
        level -= 1
        if level < 0:
            return False
    while compiled.longs[q] <= level:
        compile_long(compiled, work, q)
    if _long_step(
        compiled,
        q,
        level,
        workspace.slope,
        workspace.speed,
        workspace.g0,
        workspace.tol,
        workspace.stray,
        workspace.end,
    ):
        _move(
            workspace.x,
            workspace.slope,
            workspace.speed,
            workspace.g0,
            workspace.g1,
            workspace.end,
            workspace.low,
            workspace.high,
        )
        now.j_grid += steps
        now.t = now.origin + now.j_grid * h
        # A few of them in a row, and the next longer one is tried.
        now.quiet += 4
        now.fast_steps += 1
        return True
    # A bound that does not exclude an event says nothing of where: shorter steps take over until it is quiet again.
    now.quiet = max(32 * (level - 1), 0)
    return False


@njit(**INLINE)
def _long_step(compiled, q, level, xd, speed, g0, tol, stray, end):
    """Increments over a long step into `end`; False when an event inside cannot be excluded."""
    # A bound on travel alone, whichever way a guard goes: enough at rest, where this step is for.
    row_sum_from(tol, compiled.reach[q, level], speed, 1.0, stray)
    for g in range(compiled.n_guards[q]):
        if not g0[g] + stray[g] < 0.0:
            return False
    row_sum(compiled.T_long[q, level], xd, 1.0, end)
    return True


@njit(**HOT)
def go_fast(compiled, workspace, samples, now):
    """Fast steps, proven free of events from the values at their ends; whether a series step need not follow."""
    if not now.armed or compiled.far[now.q] > 0.0:
        return False
    q, before = now.q, now.j_grid
    now.j_grid, now.i_sample, now.why = _fast_steps(
        compiled.T[q], compiled.bound[q], compiled.Y[q], compiled.Ys[q], workspace.x, workspace.slope, workspace.speed,
        workspace.g0, workspace.g1,
        workspace.tol, workspace.stray, workspace.end, workspace.still, workspace.one, workspace.Sg[0], samples.times,
        samples.rows, samples.out,
        now.origin, now.j_grid, now.h, now.t, now.t_stop, now.i_sample, now.n_samples, now.quiet, workspace.low,
        workspace.high,
    )  # fmt: skip
    made = now.j_grid - before
    if made == 0:
        return False
    now.t = now.origin + now.j_grid * now.h
    now.quiet += made
    now.fast_steps += made
    now.spent += made * 0.0625
    if too_large(workspace.x):
        now.code = DIVERGED
        return True
    return now.why != EVENT_AHEAD


@njit(**INLINE)
def _fast_steps(
    T, bound, Y, Ys, x, xd, speed, g0, g1, tol, stray, end, still, one, sigma, times, rows, out,
    origin, j, h, t, t_stop, i_sample, n_samples, quiet, low, high,
):  # fmt: skip
    """Steps of the grid from its point j on, with the samples on it; returns the point, the next sample, why there.

    EVENT_AHEAD: a switch within the next step can't be excluded, and what the step would add is in `end`. OFF_GRID: the
    next step would go beyond `t_stop` or a sample. LONG_AHEAD: so much has passed without a switch that a long step may
    be tried, or the state has grown too large. A row of ones is in `one`.
    """
    wide, half, slack = x.size, g0.size, slack_at(t_stop, h)
    after = 2 * wide + half
    while True:
        if i_sample < n_samples and times[i_sample] <= t + slack:
            write(Y, Ys, x, still, sigma, out[rows[i_sample]])
            i_sample += 1
        t1 = origin + (j + 1) * h
        if t1 > t_stop or (i_sample < n_samples and times[i_sample] < t1 - slack):
            return j, i_sample, OFF_GRID
        # T acts on the rate, not on the state: what is added is small near rest, and no large numbers cancel.
        row_sum(T, xd, 1.0, end)
        row_sum(bound, speed, 1.0, stray)
        # Ordinates of the cubic in Bernstein form are its end values and these less, or more, a third of a step of its
        # rates; the middle ones are lifted by the remainder (docs/theory/engine.md, Fast step).
        if not cubics_below(g0, g1, end[2 * wide : after], end[after:], h / 3.0, tol, stray):
            return j, i_sample, EVENT_AHEAD
        _move(x, xd, speed, g0, g1, end, low, high)
        j += 1
        t = t1
        quiet += 1
        if (
            any_above(x, 1.0 / LARGEST, one)
            or t >= t_stop
            or quiet >= LONG_QUIET
            and (i_sample == n_samples or times[i_sample] >= t + LONG_QUIET * h)
        ):
            return j, i_sample, LONG_AHEAD


@njit(**INLINE)
def _move(x, xd, speed, g0, g1, end, low, high):
    """Take over the increments of a step."""
    wide, half = x.size, g0.size
    add(x, end[:wide])
    lower_to(low, x)
    raise_to(high, x)
    take(xd, end[wide : 2 * wide])
    take_sizes(speed, xd)
    add(g0, end[2 * wide : 2 * wide + half])
    take(g1, end[2 * wide + half :])


@njit(**INLINE)
def predicted(compiled, q, g0, g1, tol, h, end):
    """Fraction of the step that surely holds the first event, by the guards' cubics: how far the series need reach.

    Guards that stand at zero are left to the rules of the series.
    """
    first, half = 1.0, g0.size
    place = end.size - 2 * half
    for g in range(compiled.n_guards[q]):
        a, b, c, d = g0[g], h * g1[g], g0[g] + end[place + g], h * end[place + half + g]
        # The cubic lies below zero where its four Bernstein ordinates do; only the others are looked at, on a grid of
        # u.
        if a > -tol[g] or (c <= 0.0 and a + b / 3.0 <= 0.0 and c - d / 3.0 <= 0.0):
            continue
        u = 0.05
        while u < first:
            # Hermite's form of the cubic through end values and end rates.
            w = 1.0 - u
            v = w * w * ((1.0 + 2.0 * u) * a + u * b) + u * u * ((3.0 - 2.0 * u) * c - w * d)
            if v > 0.0:
                first = u
            u += 0.05
    return first + 0.05


@njit(**INLINE)
def too_large(x):
    """Whether a state is beyond all bounds, or no number."""
    for i in range(x.size):
        if not abs(x[i]) < LARGEST:
            return True
    return False
