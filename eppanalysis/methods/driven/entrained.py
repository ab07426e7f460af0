"""The loop's own oscillation under a weak sine: entrained at two phases, or passed by with a beat (Adler's law).

The exact cycle of the undriven loop is the motion to order zero. To first order a sine of amplitude V moves its phase
by a sinusoid of the phase at which they meet, and so says where the two keep step (docs/theory/driven.md, Entrainment).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.describing.predict import predicted_cycles
from eppanalysis.methods.driven.drive import Drive
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.orbits.guess import MOST_ARCS, brought_about, marked
from eppanalysis.methods.orbits.orbit import Orbit, evaluate
from eppanalysis.methods.orbits.shooting import orbits_near, restarted, same_orbit
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.methods.steady.flow import advance, away_from_events, later, run_over
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.readable import quantity
from eppanalysis.results import LimitCycle

#: Most cycles of the loop that are compared with periods of the input, and how far apart both may be.
_MOST_CYCLES, _APART = 6, 0.2
#: Share of the next singular value below which that of a shift along the cycle is zero.
_SHIFT = 1e-6
#: Phase [rad] that is rounding after a pass; residual of a response, relative to the phase by which the sine moves it,
#: from which on it says nothing of that phase; distance of a multiplier from one that may be that of such a response.
_ROUNDING, _DECIDES, _MARGINAL = 1e-12, 1e-3, 1e-6
#: Change of the phase over a pass [rad] up to which first order is believed, and a run's distance from the cycle.
_WEAK, _ON_IT = 0.2, 0.02
#: How often the order of magnitude of what first order leaves out, for more to decide it.
_SECOND = 10.0


@dataclass(frozen=True, eq=False)
class Entrainment:
    """A cycle of the undriven loop beside n periods of the input, to first order in the sine."""

    #: multiple, cycles: periods of the input, and cycles of the loop, that last nearly the same.
    multiple: int
    cycles: int
    late: float  # how much longer they last than the loop's own cycles [s]
    width: float  # how much of that the sine makes up at most [s]
    phases: tuple[HybridSystem, ...]  # starts at which the two keep step: none, or two
    cycle: Orbit  # the undriven one
    unseen: float  # how much longer or shorter they last, at the very most, by what first order leaves out [s]

    def is_weak(self, omega: float) -> bool:
        """Whether the phase moves so little over a pass that first order says how it goes on."""
        return omega * max(self.width, self.unseen) < _WEAK

    def is_decided(self, omega: float) -> bool:
        """Whether keeping step is seen in spite of rounding, and of the second order where the first is none."""
        return omega * max(self.width, abs(self.late)) > _ROUNDING and not self.is_of_second_order(omega)

    def is_of_second_order(self, omega: float) -> bool:
        """Whether what first order leaves out decides if the two keep step."""
        return self.width == 0.0 and self.unseen > max(abs(self.late), _ROUNDING / omega)

    def closes(self, omega: float, response: SteadyMotion) -> bool:
        """Whether the sine decides at which phase a response is, and not the rounding with which it closes.

        Newton's method is content with any phase of a cycle that the sine moves by less than is left of its equations.
        """
        decided = self.is_decided(omega) and response.gap < _DECIDES * omega * self.width
        return decided or _from_one(response.multipliers) >= _MARGINAL or not self.passes(response.start)

    def holds(self, omega: float, cycle: LimitCycle) -> bool:
        """Whether a response is the cycle held at a phase, which so weak a sine all but leaves free.

        By its size alone it would be one of a continuum; the multiplier tells the stable phase from the other.
        """
        return self.width > 0.0 and 10.0 * _DECIDES * omega * self.width < _from_one(cycle.multipliers) < _MARGINAL

    def tongue(self, frequency: float) -> tuple[float, float]:
        """Frequencies of the input between which the loop is entrained [Hz], from the one that it has."""
        if self.width == 0.0:
            return float("nan"), float("nan")
        time = self.multiple / frequency
        own = time - self.late
        return frequency * time / (own + self.width), frequency * time / (own - self.width)

    def in_words(self, frequency: float) -> str:
        """How the phase goes on by Adler's law, and the frequencies between which the loop is entrained."""
        low, high = self.tongue(frequency)
        tongue = f"by Adler's law within {low:.9g} to {high:.9g} Hz"
        if self.is_of_second_order(2.0 * np.pi * frequency):
            return (
                f"on its own oscillation, {self.cycles} of which last about {self.multiple} periods of the input. "
                "There a sine moves the phase in second order only: entrainment is undecided"
            )
        if not self.phases:
            beat = f"with a beat of {quantity(self.beat(1.0 / frequency), 's', 4)}"
            return f"{beat}; the loop is entrained {tongue}" if self.width > 0 else beat
        rate = 2.0 * np.pi * frequency * float(np.sqrt(self.width**2 - self.late**2)) / self.multiple
        slow = f"{1.0 / rate:.3g}" if rate > 0 else "ever more"
        return f"{tongue}: slowly, its phase comes nearer by a factor e in {slow} periods"

    def beat(self, period: float) -> float:
        """Time after which the two meet again as they did [s]; nan where they keep step.

        The phase of m cycles beside n periods obeys d(phase)/dt = detuning - K sin(phase), which takes
        2 pi / sqrt(detuning^2 - K^2) for a turn: without a tongue 1 / abs(m / period - n / (period of the cycle)).
        """
        if abs(self.late) <= self.width:
            return float("nan")
        own = (self.multiple * period - self.late) / self.cycles
        return period * own / float(np.sqrt(self.late**2 - self.width**2))

    def on_it(self, start: HybridSystem) -> bool:
        """Whether a motion is on the cycle, which is stable, but for what a weak sine moves it by."""
        return is_stable(self.cycle.multipliers, self.cycle.one_of_many) and self.passes(start)

    def passes(self, start: HybridSystem) -> bool:
        """Whether a motion goes along the cycle; where its elements hold it does not."""
        run = run_over(start, 1.5 * self.cycle.period)
        if run is None or not run.count:
            return False
        first, n, compared = run.order[0], start.x0.size, start.compared
        met = self.cycle.arcs.event_sequence.guards == run.guard[first]
        away = np.abs(self.cycle.starts[1:, :n][met] - run.state[first])[:, compared] / self.cycle.scale[:n][compared]
        return bool(len(away)) and float(np.min(np.max(away, axis=1))) < _ON_IT


def _from_one(multipliers: ComplexArray | None) -> float:
    """How near the nearest multiplier is to the unit circle."""
    multipliers = np.zeros(0, complex) if multipliers is None else multipliers
    return float(np.min(np.abs(np.abs(multipliers) - 1.0), initial=1.0))


def entrainments(drive: Drive, end: HybridSystem, most_periods: int) -> Iterator[Entrainment]:
    """The loop's own cycles beside the input: the one near a motion, and those near describing functions."""
    known: list[Orbit] = []
    for orbit in _own_cycles(drive, end, most_periods):
        if any(same_orbit(one, orbit) for one in known):
            continue
        known.append(orbit)
        found = _beside(drive, orbit, most_periods)
        if found is not None:
            yield found


def undriven(drive: Drive, start: HybridSystem) -> HybridSystem:
    """The loop in a state, without the sine: its two states are at zero, where they stay."""
    x = start.x0.copy()
    x[drive.sine] = 0.0
    return replace(start, x0=x)


def _own_cycles(drive: Drive, end: HybridSystem, most_periods: int) -> Iterator[Orbit]:
    """Exact cycles of the undriven loop."""
    here, still = undriven(drive, end), undriven(drive, drive.hybrid)
    starts = [(here, n * drive.period) for n in range(1, most_periods + 1)]
    with suppress(EppError, ModelError):  # such as an element without a describing function
        starts += [(still.begun(c.state, c.memory), c.period) for c in predicted_cycles(drive.system, drive.at)]
    for start, period in starts:
        # A start on a switch may be met on its wrong side.
        placed = away_from_events(start, period)
        near = None if placed is None else next(orbits_near(placed, placed.x0, placed.H0, period), None)
        if near is not None and near.motion is None:
            yield near


def _beside(drive: Drive, cycle: Orbit, most_periods: int) -> Entrainment | None:
    """The cycle beside so many periods of the input that both last nearly the same; None where that is far off."""
    pairs = ((n, m) for n in range(1, most_periods + 1) for m in range(1, _MOST_CYCLES + 1) if np.gcd(n, m) == 1)
    n, m = min(
        pairs, key=lambda nm: (abs(np.log(nm[0] * drive.period / (nm[1] * cycle.period))) > _APART / sum(nm), sum(nm))
    )
    duration, own = n * drive.period, m * cycle.period
    if abs(np.log(duration / own)) > _APART / (n + m):
        return None
    longest = int(np.argmax(cycle.tau))
    # The sine that keeps step: what it does at another frequency differs by the second order.
    hybrid = drive.changed(omega=2.0 * np.pi * n / own).hybrid
    begin = replace(_begun(cycle), model=hybrid.model, time_scale=hybrid.time_scale)
    placed = later(begin, float(cycle.tau[:longest].sum() + 0.5 * cycle.tau[longest]))
    orbit = None if placed is None else _passed(placed, own)
    if placed is None or orbit is None:
        return None
    A = orbit.scaled
    if not np.all(np.isfinite(A)):
        return None
    left, sizes, right = np.linalg.svd(A)
    if not sizes[-1] < _SHIFT * sizes[-2]:  # more than one direction is free, or a switch lies at the begin
        return None
    # A shift along the cycle solves the undriven equations: what the sine and the difference of the durations add to
    # them must be seen by none of its left null vector.
    psi = left[:, -1] / orbit.row_scale
    by_sine, by_cosine = (_by_state(orbit, i) for i in range(drive.sine.start, drive.sine.stop))
    longer = np.zeros(orbit.r.size)
    longer[-1] = duration - own
    g = np.array([psi @ by_sine, psi @ by_cosine])
    size = float(np.hypot(*g))

    def moved(missing: Array) -> Array:
        """How the rest of the equations moves the orbit, in its own scale, with the phase held."""
        return right[:-1].T @ ((left[:, :-1].T @ (missing / orbit.row_scale)) / sizes[:-1])

    # Second order is that of the square of what the sine moves the orbit by.
    away = max(float(np.max(np.abs(moved(by)))) for by in (by_sine, by_cosine))
    unseen = _SECOND * away**2 * own / (2.0 * np.pi)
    # Of m cycles, and of a symmetric loop's even harmonics, first order does nothing, to rounding.
    if m > 1 or size <= _SHIFT * float(np.abs(psi) @ (np.abs(by_sine) + np.abs(by_cosine))):
        return Entrainment(n, m, duration - own, 0.0, (), cycle, unseen)
    phases, ratio = [], float(psi @ longer) / size
    for turn in (-1.0, 1.0) if abs(ratio) <= 1.0 else ():
        phase = float(np.arctan2(g[0], g[1]) + turn * np.arccos(ratio))
        # The state moves by what the rest of the equations says.
        step = -moved(np.sin(phase) * by_sine + np.cos(phase) * by_cosine - longer) * orbit.column_scale
        x = orbit.moved(step)[0][: placed.x0.size].copy()
        x[drive.sine] = np.sin(phase), np.cos(phase)
        phases.append(replace(drive.hybrid, x0=x, H0=placed.H0, modes0=placed.modes0))
    return Entrainment(n, m, duration - own, size / abs(float(psi[-1])), tuple(phases), cycle, unseen)


def _by_state(orbit: Orbit, i: int) -> Array:
    """Derivative of the residual by a state of the sine, by a difference as large as the sine."""
    up, down = orbit.y.copy(), orbit.y.copy()
    up[i], down[i] = 1.0, -1.0
    return 0.5 * (
        evaluate(orbit.hybrid, orbit.arcs, up, orbit.tau).r - evaluate(orbit.hybrid, orbit.arcs, down, orbit.tau).r
    )


def _passed(start: HybridSystem, duration: float) -> Orbit | None:
    """One pass of the duration from a start: its arcs as the engine meets them, the derivative and what does not close.

    None where the run does not come so far, or has too many events or one that arcs do not know.
    """
    found = advance(start, duration)
    if found is None or found.events.size > MOST_ARCS:
        return None
    run, rows = found.run, found.events
    tau = np.diff(np.concatenate([[0.0], run.time[rows], [found.duration]]))
    modes, guards = np.vstack([start.modes0, run.modes[rows]]), run.guard[rows]
    marks = np.append(brought_about(start.model, guards, tau[:-1]) if rows.size else guards, 0)
    # The last arc ends when the time is over and on no guard: -1 (docs/theory/driven.md, Periodic responses).
    sequence = EventSequence(modes, np.append(guards, -1), np.full((rows.size + 1, 3), -1), marks)
    try:
        arcs = replace(Arcs.build(start, sequence), duration=found.duration)
    except ModelError:
        return None
    arcs = replace(arcs, event_sequence=marked(arcs, found.rows, tau))
    orbit = evaluate(start, arcs, found.y, tau)
    return orbit if np.isfinite(orbit.residual) else None


def _begun(orbit: Orbit) -> HybridSystem:
    """The system at the beginning of an orbit."""
    return restarted(orbit.hybrid, orbit.arcs, orbit.y, orbit.arcs.event_sequence.modes[0])
