"""Orbits on the locus of a known one: its switches at other periods.

Tsypkin's locus tells of all periods whether the one switch of a relay's symmetric cycle lies on its threshold. Here it
is followed from an orbit with any sequence of events: at each period all of its switches but one lie on their guards,
and where that one does, too, there is another orbit (docs/theory/exact_orbits.md, The search for all of them).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.guess import Guess
from eppanalysis.methods.orbits.mirrored import is_mirrored, mirror
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, solve
from eppanalysis.methods.orbits.shooting import close_orbit

#: Factor from one period to the next, and on that of the orbit at most.
_STEP, _FAR = 1.1, 8.0
#: Of an orbit with more switches only so many are left open, one after the other.
_MOST_OPEN = 4


@dataclass(frozen=True, eq=False)
class _Point:
    """A motion on the locus: start, dwell times [s], and the value at its end of the guard that is left open."""

    y: Array
    tau: Array
    value: float


def has_locus(orbit: Orbit) -> bool:
    """Whether the switches of an orbit can be followed to other periods: without dead time, and not in a continuum."""
    return orbit.motion is None and not orbit.arcs.n_timers and not orbit.one_of_many


def orbits_on_locus(orbit: Orbit) -> Iterator[Orbit]:
    """Orbits with the switches of one at other periods; none of those that have no locus."""
    if not has_locus(orbit):
        return
    for guess in _through_guards(orbit):
        found = close_orbit(orbit.hybrid, guess)
        # What creeps to rest closes, too, after times without end.
        if found is not None and 1.0 / _FAR < found.period / orbit.period < _FAR:
            yield found


def _through_guards(orbit: Orbit) -> Iterator[Guess]:
    """From the loci of all guards that may be left open."""
    image = mirror(orbit.hybrid)
    if image is not None and not is_mirrored(orbit, image):
        image = None
    # An orbit that is its own image is followed as a half, or the guard that is left open would spoil that.
    p = orbit.arcs.n_arcs if image is None else orbit.arcs.n_arcs // 2
    for first in range(0, p, -(-p // _MOST_OPEN)):
        begun = orbit.rotated(first)
        if not begun.arcs.event_sequence.at_once[p - 1]:  # a guard that the motion comes to
            yield from _changes(begun, p, image)


def _changes(orbit: Orbit, p: int, image: Array | None) -> Iterator[Guess]:
    """Whole turns where the guard that is left open changes its sign, to both sides of an orbit's own period."""
    arcs, it = orbit.arcs, orbit.arcs.event_sequence
    if image is not None:
        more = np.arange(p + 1)
        half = EventSequence(it.modes[more], it.guards[more], it.source[more], it.at_once[more])
        try:
            arcs = Arcs.build(orbit.hybrid, half).halved(orbit.hybrid, image)
        except ModelError:
            return
    turns = 1 if image is None else 2
    for step in (_STEP, 1.0 / _STEP):
        last = _Point(orbit.y, orbit.tau[:p], 0.0)
        for point in _points(orbit, arcs, last, step):
            if last.value * point.value < 0:
                share = last.value / (last.value - point.value)
                y, tau = (a + share * (b - a) for a, b in ((last.y, point.y), (last.tau, point.tau)))
                yield Guess(it, y, np.tile(tau, turns))
            last = point


def _points(orbit: Orbit, arcs: Arcs, last: _Point, step: float) -> Iterator[_Point]:
    """The locus from an orbit to ever longer or shorter periods, until it ends."""
    before, period = last, float(last.tau.sum())
    for k in range(1, int(np.log(_FAR) / np.log(_STEP))):
        y, tau = 2.0 * last.y - before.y, 2.0 * last.tau - before.tau
        if np.any(tau < 0):
            y, tau = last.y, last.tau
        of_time = replace(arcs, duration=step**k * period)
        there = solve(orbit.hybrid, Guess(arcs.event_sequence, y, tau), of_time)
        if not there.residual < CONVERGED or np.any(there.tau < 0):
            return
        before, last = last, _Point(there.y, there.tau, float(arcs.g[-1] @ there.ends[-1]))
        yield last
