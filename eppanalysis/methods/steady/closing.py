"""Steady motions by Newton's method on the flow: the end of a pass is its start.

The duration is given where something outside of the loop's own motion beats the time (samples of a controller, a sine),
and an unknown with a condition on the phase where nothing does. Events are what each pass meets: no order of them is
assumed, so none has to be checked (docs/theory/flow.md).
"""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.steady.flow import Pass, advance, later
from eppanalysis.models.systems.hybrid import HybridSystem

#: Change over a pass, relative to the motion, of a motion that is closed, and one at which Newton's method ends.
CLOSED, EXACT = 1e-10, 1e-14
#: Steps of Newton's method at most, and in a row that better nothing.
_MOST_STEPS, _IDLE = 60, 5
#: Shares of a step that are tried, and the longest step, in sizes of the motion.
_SHARES = (1.0, 0.4, 0.15, 0.05)
_LONGEST = 1.0
#: Singular value, relative to the largest, of a direction along which motions lie side by side.
_FREE = 1e-13


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # of a motion that shrinks to nothing
def close(start: HybridSystem, duration: float, given: bool) -> Pass | None:
    """The steady motion near a start; None where Newton's method finds none.

    Parameters
    ----------
    start : HybridSystem
        Near the motion.
    duration : float
        Time after which the motion repeats itself, or where it is not `given` a guess of that [s].
    given : bool
        Whether samples or an input tell the duration.

    Returns
    -------
    Pass or None
        Begun where no event is near, closed, and ending in the modes in which it begins.
    """
    best = now = placed(advance(start, duration))
    idle = 0
    for _ in range(_MOST_STEPS):
        if best is None or now is None or idle >= _IDLE or (best.gap < EXACT and best.ends_in_its_modes):
            break
        now = _nearer(now, given)
        # Where a step leads to another piece of the map it may worsen first: several have to better nothing.
        away = np.inf if now is None else now.gap_in(best.scale)
        idle = 0 if away < 0.5 * best.gap else idle + 1
        best = now if now is not None and away < best.gap else best
    return best if best is not None and best.gap <= CLOSED and best.ends_in_its_modes else None


def _nearer(now: Pass, given: bool) -> Pass | None:
    """The pass after the longest share of Newton's step that betters it, or after all of it where none does."""
    step, longer = newton(now, given)
    if not np.all(np.isfinite(step)):
        return None
    whole = None
    for share in _SHARES:
        new = advance(now.moved(share * step), now.duration * float(np.exp(share * longer)))
        if new is not None and new.gap_in(now.scale) < (1.0 - 0.1 * share) * now.gap:
            return new
        whole = new if share == 1.0 else whole
    # An event has passed the begin, or what holds memory is elsewhere: on from where no event is near.
    return whole if whole is None or whole.ends_in_its_modes else placed(whole)


def placed(found: Pass | None) -> Pass | None:
    """A pass of the same motion, begun away from its events, which Newton's steps move."""
    begin = None if found is None else later(found.start, found.middle_of_longest_gap())
    return None if begin is None or found is None else advance(begin, found.duration)


def newton(now: Pass, given: bool) -> tuple[Array, float]:
    """Newton's step in what repeats, and relative to it in the duration; nan where there is none."""
    m = now.sought.size
    A, b = now.matrix - np.eye(m), -now.change[now.sought] / now.scale
    if not given:
        first, last = (rate[now.sought] / now.scale * now.duration for rate in now.rates)
        A, b = np.block([[A, last[:, None]], [first[None], np.zeros((1, 1))]]), np.append(b, 0.0)
    if not np.all(np.isfinite(A)):
        return np.full(m, np.nan), np.nan
    step = np.linalg.lstsq(A, b, rcond=_FREE)[0]
    step *= min(1.0, _LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
    return step[:m] * now.scale, 0.0 if given else float(step[m])
