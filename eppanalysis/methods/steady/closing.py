"""Steady motions by Newton's method on the flow: the end of a chain of passes is its start.

The duration is given where something outside of the loop's own motion beats the time (samples of a controller, a sine),
and an unknown with a condition on the phase where nothing does. Events are what each pass meets: no order of them is
assumed, so none has to be checked (docs/theory/flow.md).
"""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.steady.flow import advances
from eppanalysis.methods.steady.motion import SteadyMotion

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
def close(begin: SteadyMotion | None, given: bool, pieces: int = 1) -> SteadyMotion | None:
    """The steady motion near one that is none yet; None where Newton's method finds none.

    Parameters
    ----------
    begin : SteadyMotion, optional
        Its duration is a guess where it is not `given`.
    given : bool
        Whether samples or an input tell the duration.
    pieces : int, optional
        In how many passes it is closed.

    Returns
    -------
    SteadyMotion or None
        Begun where no event is near, closed, and ending in the modes in which it begins.
    """
    best = now = None if begin is None else begin.placed(pieces)
    # An orbit whose duration is free is solved to rounding along the events that it has met.
    idle, enough = 0, EXACT if given else CLOSED
    for _ in range(_MOST_STEPS):
        if best is None or now is None or idle >= _IDLE or (best.gap < enough and best.ends_in_its_modes):
            break
        now = _nearer(now, given)
        # Where a step leads to another piece of the map it may worsen first: several have to better nothing.
        idle = 0 if now is not None and now.is_nearer(best, 0.5) else idle + 1
        best = now if now is not None and now.is_nearer(best, 1.0) else best
    return best if best is not None and best.gap <= CLOSED and best.ends_in_its_modes else None


def _nearer(now: SteadyMotion, given: bool) -> SteadyMotion | None:
    """What comes of the longest share of Newton's step that betters it, or of all of it where none does.

    None where there is no step, or it leaves what keeps the motion from closing as it is.
    """
    step, longer = newton(now, given)
    if not np.all(np.isfinite(step)):
        return None
    whole = None
    for share in _SHARES:
        new = now.moved(share * step, share * longer)
        if share == 1.0 and new is not None and _drifts_on(now, new):
            return None
        if new is not None and new.is_nearer(now, 1.0 - 0.1 * share):
            return new
        whole = new if share == 1.0 else whole
    # An event has passed the begin, or what holds memory is elsewhere: on from where no event is near.
    return whole if whole is None or whole.ends_in_its_modes else whole.placed(len(whole.passes))


def _drifts_on(now: SteadyMotion, new: SteadyMotion) -> bool:
    """Whether what is held misses after a step what it has missed before: no start near changes what it counts.

    The integral of a sampled controller behind a quantiser moves by whole steps of it, unless events come or go.
    """
    before, after = (motion.misses.sum(axis=0)[now.held] / now.scale[now.held] for motion in (now, new))
    return bool(np.any((np.abs(before) > CLOSED) & (np.abs(after - before) <= CLOSED)))


def newton(now: SteadyMotion, given: bool) -> tuple[Array, float]:
    """Newton's step in what repeats (k, m), and in the logarithm of the duration; nan where there is none."""
    k, m = len(now.passes), now.sought.size
    A, b = np.zeros((k * m, k * m)), -(now.misses / now.scale).ravel()
    # Each pass has to end where the next one begins.
    for i, block in enumerate(now.blocks):
        rows, following = slice(i * m, (i + 1) * m), (i + 1) % k * m + np.arange(m)
        A[rows, rows] = block
        A[i * m + np.arange(m), following] -= 1.0
    if not given:
        along = now.passes[0].rate_at_start - advances(now.start)
        row = np.zeros(k * m)
        row[:m] = along[now.sought] / now.scale * now.duration
        last = (now.slope / now.scale).ravel()
        A, b = np.block([[A, last[:, None]], [row[None], np.zeros((1, 1))]]), np.append(b, 0.0)
    if not np.all(np.isfinite(A)):
        return np.full((k, m), np.nan), np.nan
    step = np.linalg.lstsq(A, b, rcond=_FREE)[0]
    step *= min(1.0, _LONGEST / max(float(np.abs(step).max(initial=0.0)), 1e-300))
    return step[: k * m].reshape(k, m) * now.scale, 0.0 if given else float(step[k * m])
