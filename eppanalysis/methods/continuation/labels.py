"""What special points of a branch are called: which multiplier leaves the unit circle, which events come and go."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eppanalysis.arrays import ComplexArray
from eppanalysis.methods.continuation.steps import BranchPoint
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import run_from
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.methods.steady.changes import Change, left
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.readable import listed

#: Relative growth of the longest dwell time over a step that counts as one, and dwell times that are not looked at.
_LONGER, _BRIEF = 1e-4, 1e-3
#: Relative distance of a pole from the frequency of a cycle within which the cycle is the oscillation of that pole.
_AT_POLE = 1e-6
#: Speed across a guard, relative to the movement in a period, with which it is only just reached.
_TOUCHED = 1e-5
#: Time constants that an approach to a guard takes until it is so slow; where one is grazed the speed falls far faster,
#: and a slow ramp hardly at all.
_APPROACH = 10.0, 1e3


#: What is where a branch does not go on.
STANDS = {
    Change.INFINITE: "the period grows without bound",
    Change.CONTINUUM: "cycles are a continuum at one value of the parameter",
    Change.CONTINUA: "cycles are a continuum at each value of the parameter",
    Change.LINEAR: "the cycle is the oscillation of the linear loop, at the limit of its stability",
}


def in_words(ends: tuple[str, str]) -> str:
    """How a branch ends, as a sentence.

    Examples
    --------
    >>> in_words(("begins at the end of the range", "leaves the range"))
    'The branch begins at the end of the range and leaves the range.'
    """
    one, other = ends
    return f"The branch {one} and {other}." if one.startswith("begins") else f"One end {one}; the other {other}."


def standstill(old: BranchPoint, new: BranchPoint) -> Change | None:
    """What a branch has come to that does not go on, but for rounding; None where it moves."""
    if new.one_of_many:
        return Change.CONTINUA
    if not new.stands:
        return None
    before, tau = old.orbit.tau, new.orbit.tau
    if before.size != tau.size:
        return Change.CONTINUUM
    of_size = tau > _BRIEF * new.orbit.period
    growth = (tau[of_size] - before[of_size]) / tau[of_size]
    longest = float(growth[np.argmax(tau[of_size])])
    # Where all dwell times grow in proportion the motion is only larger.
    alike = bool(np.all(np.abs(growth - longest) < 0.1 * abs(longest)))
    return Change.INFINITE if longest > _LONGER and not alike else Change.CONTINUUM


def linear_arc(orbit: Orbit) -> int | None:
    """The arc of whose modes an orbit is the free oscillation, but for moments; None where it is none."""
    modes, tau = orbit.arcs.event_sequence.modes, orbit.tau
    longest, n = int(np.argmax(tau)), orbit.hybrid.n_plant
    elsewhere = np.any(modes != modes[longest], axis=1)
    if orbit.arcs.smooth[longest] or not 0.0 <= tau[elsewhere].sum() < _BRIEF * orbit.period:
        return None
    pole, values = 2j * np.pi / orbit.period, np.linalg.eigvals(orbit.arcs.F[longest, :n, :n])
    return longest if np.min(np.abs(values - pole)) < _AT_POLE * abs(pole) else None


def ending(orbit: Orbit) -> Change:
    """What a border is beyond which no orbit continues a branch."""
    if linear_arc(orbit) is not None:
        return Change.LINEAR
    return Change.INFINITE if _creeps(orbit) else Change.END


def _creeps(orbit: Orbit) -> bool:
    """Whether an orbit comes ever more slowly to a guard that it only just reaches: at the border it never does."""
    arcs, at = orbit.arcs, np.flatnonzero(orbit.grazes(_TOUCHED) & (orbit.arcs.event_sequence.at_once == 0))
    # Both rates of an exponential approach die out together; where a guard is grazed only the speed vanishes.
    n = arcs.F.shape[1]
    bent = np.array([arcs.g[a, :n] @ arcs.F[a, :, :n] @ arcs.F[a] @ orbit.ends[a] for a in at])
    falls, least, most = -bent * orbit.tau[at], *(n * orbit.speed[at] for n in _APPROACH)
    return bool(np.any((falls > least) & (falls < most) & (arcs.smooth[at] == 0)))


def crossing(old: BranchPoint, new: BranchPoint) -> tuple[Change, Callable[[BranchPoint], float]]:
    """Which way a multiplier crosses the unit circle, and the test function for it."""
    unstable = new if not is_stable(new.multipliers) else old
    kind, leading = left(unstable.multipliers)
    if kind is Change.TORUS:
        return kind, lambda p: _nearest(p.multipliers, leading) - 1.0
    return kind, lambda p: determinant(p.orbit, 1.0 if kind is Change.PERIOD_DOUBLING else -1.0)


def determinant(orbit: Orbit, sign: float) -> float:
    """Product of (multiplier + sign), from the scaled return map."""
    # The product passes zero with any one of the multipliers, and is smooth also where two of them meet and turn
    # complex.
    P, scale = orbit.return_map, orbit.scale[orbit.arcs.free]
    return float(np.linalg.det(P * scale / scale[:, None] + sign * np.eye(len(P))))


def _nearest(values: ComplexArray, leading: complex) -> float:
    return float(np.abs(values[np.argmin(np.abs(values - leading))]))


def _name(hybrid: HybridSystem, guard: int) -> str:
    return f"{hybrid.element_names[int(hybrid.model.guard_element[guard])]} {hybrid.guard_name(guard)}"


def departure(inside: Orbit, outside: Orbit) -> str:
    """What keeps an orbit from going on: the first event in which the engine leaves it just beyond where it ends."""
    wanted, kind = inside.arcs.event_sequence.guards, inside.arcs.event_sequence.at_once
    touched = [_name(inside.hybrid, int(g)) for g in wanted[inside.grazes(_TOUCHED) & (wanted >= 0) & (kind == 0)]]
    if touched:
        return f"{listed(sorted(set(touched)))} only just"
    run = run_from(outside, outside.period, 2 * wanted.size + 40, outside.y)
    met = run.guard[run.order][: wanted.size]
    (differ,) = np.nonzero(met != wanted[: met.size])
    if outside.arcs.n_timers or not differ.size or wanted[differ[0]] < 0:
        return "the sequence of events changes"
    return " before ".join(_name(outside.hybrid, int(guards[differ[0]])) for guards in (met, wanted))


def difference(old: Orbit, new: Orbit) -> str:
    """Which events come and go at a change of the sequence."""

    def names(orbit: Orbit) -> list[str]:
        it = orbit.arcs.event_sequence
        return [
            _name(orbit.hybrid, int(g)) + (" at once" if at_once == 1 else "")
            for g, at_once in zip(it.guards, it.at_once, strict=True)
            if g >= 0
        ]

    before, after = names(old), names(new)
    gone = sorted({n for n in before if before.count(n) > after.count(n)})
    come = sorted({n for n in after if after.count(n) > before.count(n)})
    parts = [f"appears: {', '.join(come)}"] * bool(come) + [f"disappears: {', '.join(gone)}"] * bool(gone)
    return "; ".join(parts) or "events change their order"
