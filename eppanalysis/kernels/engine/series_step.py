"""Compiled: a step by series, from any state and with smooth channels: its length, the guard that rises first, its end.

Rules at its start, for a guard that stands within rounding of zero: the sign of its first derivative that is above
rounding decides; rising fires at once, falling arms it for its next rise (docs/theory/engine.md, "Rules at a switch").
"""

import numpy as np

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.delays import extend_lines, read_line, segment_reach
from eppanalysis.kernels.engine.fast import EVENT_AHEAD, pays, predicted
from eppanalysis.kernels.engine.flow import size_of_rate
from eppanalysis.kernels.engine.series import DELAY_LINE, expand, guard_series, may_rise, term_sizes
from eppanalysis.kernels.engine.signals import sample_series, sample_signals, slack_at
from eppanalysis.kernels.engine.switches import rise_from_start
from eppanalysis.kernels.engine.tables import HOT, INLINE
from eppanalysis.kernels.engine.workspace import HISTORY, STALLED
from eppanalysis.kernels.simd.vectors import (
    any_above,
    polynomial,
    raise_to,
    row_sum_from,
    size_sum,
    take,
    take_larger,
    take_sizes,
)

#: A step that is so little of its mode's does not move the clock; so many in a row may die out, or grow beyond bounds.
UNTIMED, MOST_UNTIMED = 1e-14, 2500
#: What counts of the size that a state is to have.
TRACE = 1e-3
#: A series that has fallen to rounding by this order does so by the last one over twice the step.
GROWS = 19


@njit(**HOT)
def plan(model, compiled, workspace, now):
    """Length of a series step: at most to the next point of the grid, and what counts of it where the past is read."""
    t, h, far = now.t, now.h, compiled.far[now.q]
    now.quiet = now.quiet + int(far / h) if far > 0.0 else 0
    if workspace.line_h.shape[1] > 1:
        now.origin = t  # where the past is read, the steps made then are the grid
    now.j_grid = int(np.floor((t - now.origin) / h + 1e-9)) + 1
    now.t1 = now.origin + now.j_grid * h
    if now.t1 - t <= 1e-9 * h:
        # Late in a long run rounding shifts the points of the grid.
        now.j_grid += 1
        now.t1 = now.origin + now.j_grid * h
    if t + far > now.t1:
        now.j_grid = int(np.floor((t + far - now.origin) / h + 1e-9))
        now.t1 = now.origin + now.j_grid * h
    now.on_grid = True
    if now.t1 > now.t_stop:
        now.t1, now.on_grid = now.t_stop, False
    take_larger(workspace.largest, workspace.x, workspace.largest)
    d = now.t1 - t
    if d > now.holds:
        d, now.on_grid = now.holds, False
    # The cubics of the fast step that failed tell how far its event is: a series over less of the step has fewer terms.
    if now.why == EVENT_AHEAD:
        u = predicted(compiled, now.q, workspace.g0, workspace.g1, workspace.tol, h, workspace.end)
        if u < 0.9:
            d, now.on_grid = min(d, u * h), False
    # Two guards that point at each other at one instant: a billionth of a step in the present mode, then they are
    # judged anew (docs/theory/engine.md, Rules at a switch).
    if now.forced:
        d, now.on_grid = min(d, 1e-9 * h), False
    now.ahead = d
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            # The step is expanded as far as the series of the past holds, but counts only to the end of its segment:
            # behind it the past may have had a switch.
            counts, holds = segment_reach(model, j, t, workspace.line_t, workspace.line_h, workspace.line_n)
            if counts < 0.0:
                now.code = HISTORY
                break
            if counts < now.ahead:
                now.ahead, now.on_grid = counts, False
            d = min(d, holds)
    now.d = d


@njit(**HOT)
def expand_step(model, compiled, workspace, now):
    """Series of the state over the step, which is halved until it holds; none where a guard is passed already."""
    now.best, now.last = 0.0 if now.which >= 0 else 2.0, -1
    while now.last < 0 and now.which < 0:
        read_lines(model, workspace, now.t, now.d)
        # How far the series of smooth channels converges is known by how far the one before did, or the step is halved.
        now.last = expand(
            model, compiled, now.q, workspace.x, workspace.push, workspace.H, now.d, workspace.largest,
            workspace.small, workspace.X, workspace.Sg, workspace.arg,
            workspace.aux,
        )  # fmt: skip
        if now.last < 0 and not _give_sizes(compiled, now.q, workspace):
            now.d, now.on_grid = 0.5 * now.d, False
            if model.S.shape[1] > 0:  # without, the next mode tells its own step
                now.holds = now.d
            now.ahead = min(now.ahead, now.d)
            now.refused_series += 1
            now.spent += 1.0
            if not now.d > 0.0:
                now.code = STALLED
                return
    if 0 <= now.last <= GROWS and now.d >= now.holds:
        now.holds = 2.0 * now.d
    now.untimed = now.untimed + 1 if now.last >= 0 and now.d < UNTIMED * now.h else 0
    if now.untimed > MOST_UNTIMED:
        now.code = STALLED
    now.series_steps += now.last >= 0


@njit(**HOT)
def _give_sizes(compiled, q, workspace):
    """Give a trace of their sizes to be to states that have none yet; whether there were such. In large loops alone.

    What moves reaches a state that lies many others behind with as high an order of its series, whatever the step, and
    as next to nothing. Its size is what comes along in one turn at each of the others.
    """
    if compiled.row_end.shape[1] == 0 or compiled.spread_rate[q] == 0.0:
        return False
    sizes, further, per_turn = workspace.wide, workspace.spread, 1.0 / compiled.spread_rate[q]
    take_sizes(sizes, workspace.x)
    for i in range(compiled.N.shape[1]):
        sizes[i] = max(sizes[i], per_turn * abs(workspace.push[i]))
    for _ in range(compiled.N.shape[1]):
        size_of_rate(compiled, q, sizes, per_turn, further)
        raise_to(further, sizes)
        grown = any_above(further, 0.5, sizes)
        take(sizes, further)
        if not grown:
            break
    given = False
    for i in range(compiled.N.shape[1]):
        if TRACE * sizes[i] > workspace.largest[i]:
            workspace.largest[i], given = TRACE * sizes[i], True
    return given


@njit(**HOT)
def read_lines(model, workspace, t, d):
    """Series of all delayed outputs over [t, t + d]."""
    for j in range(model.S.shape[1]):
        if model.smooth_kind[j] == DELAY_LINE:
            read_line(
                model, j, t, d, workspace.line_t, workspace.line_h, workspace.line_c, workspace.line_n, workspace.Sg,
                workspace.p
            )  # fmt: skip


@njit(**HOT)
def look_ahead(model, compiled, workspace, samples, now):
    """The guard that rises first on the series, and the samples and delayed outputs up to there."""
    q, t, d, last, X, Sg, n, n_s = (
        now.q,
        now.t,
        now.d,
        now.last,
        workspace.X,
        workspace.Sg,
        model.S.shape[0],
        model.S.shape[1],
    )
    if last >= 0:
        clock = t / d if workspace.line_h.shape[1] > 1 else 0.0
        now.which, now.best = _first_guard(compiled, q, workspace, last, d, clock, now.forced)
        # An event beyond what counts is foretold by a past that may not be so: it is looked for again from there.
        if now.ahead < d and now.best > now.ahead / d:
            now.which, now.best = -1, 2.0
    now.forced = False
    # Where a guard fires at once the state is not computed anew: judged by smaller sizes than its own the next guard
    # would take what is left of the rounding for a rise, and the two would fire in turn.
    if last >= 0 and now.best > 0.0:
        for i in range(n):
            workspace.recent[i] = abs(X[0, i]) + workspace.spread[i]
    if now.best > 0.0:
        u1 = min(now.best, now.ahead / d)
        # A sample at the end of a step is left to the next one, which may begin behind an input's step.
        first, reached = now.i_sample, t + u1 * d
        if now.which < 0:
            reached -= slack_at(reached, u1 * d)
        while now.i_sample < now.n_samples and (
            samples.times[now.i_sample] < reached or samples.times[now.i_sample] <= t
        ):
            now.i_sample += 1
        if compiled.far[q] > 0.0 and compiled.y_row_end[q, -1] < (now.i_sample - first) * compiled.row_end.shape[1]:
            sample_signals(compiled, q, workspace, last, samples, first, now.i_sample, t, d)
        elif now.i_sample > first:
            sample_series(
                compiled.Y[q], compiled.Ys[q], X, last, Sg, samples.times, samples.rows, first, now.i_sample, t, d,
                workspace.still, workspace.wide, samples.out,
            )  # fmt: skip
        if n_s > 0:
            extend_lines(
                model, compiled, q, X, last, Sg, workspace.H, t, d, u1, workspace.line_t, workspace.line_h,
                workspace.line_c, workspace.line_n,
                workspace.p,
            )  # fmt: skip


@njit(**INLINE)
def _first_guard(compiled, q, workspace, last, d, clock, forced):
    """The guard that rises first on the series, and where in [0, 1]; -1 and 2.0 when none does."""
    X, Sg, H, p, top, constant = workspace.X, workspace.Sg, workspace.H, workspace.p, workspace.top, workspace.constant
    which, best, sized = -1, 2.0, False
    size_sum(X, last, workspace.spread)
    row_sum_from(workspace.lift, compiled.all_gf[q], X[0], 1.0, top)
    row_sum_from(top, compiled.reach_gf[q], workspace.spread, 1.0, top)
    for g in range(compiled.n_guards[q]):
        # Below zero by the sum of the absolute terms: nothing on [0, 1] can lift it (rates and smooth channels aside).
        if top[g] < 0.0 and (Sg.shape[1] == 0 or not (compiled.on_rate[q, g] or compiled.smooth_guard[q, g])):
            continue
        guard_series(compiled, q, g, X, last, Sg, constant[g], d, p)
        if p[0] < 0.0 and not may_rise(p):
            continue
        if not sized:
            term_sizes(compiled, q, X, Sg, H, d, workspace.recent, clock, 0, 2, workspace.Y, workspace.wide)
            sized = True
        u = rise_from_start(
            compiled, q, g, X, last, Sg, H, d, workspace.recent, clock, workspace.Y, workspace.wide, p, forced
        )  # fmt: skip
        if u < best:
            best, which = u, g
    return which, best


@njit(**HOT)
def reach(compiled, workspace, samples, now):
    """To the end of a series step on which no guard rises."""
    polynomial(workspace.X, now.last, now.ahead / now.d, workspace.x)
    now.t = now.t1 if now.on_grid or now.t1 - now.t == now.ahead else now.t + now.ahead
    now.armed = compiled.linear[now.q] != 0 and now.on_grid and pays(compiled, samples, now)
    now.renewed = False
    now.stepped = True
