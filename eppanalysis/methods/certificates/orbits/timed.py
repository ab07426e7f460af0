"""Motions that samples or a sine tell the time, once round in floats: where the proof of such an orbit begins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations
from math import gcd
from typing import Protocol

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.numbers import NotCovered, kept, number_of
from eppanalysis.methods.certificates.orbits.path import Course, together
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.orbits.samples.locked import SampledTurn, begun_behind, close_locked
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.steady.closing import close
from eppanalysis.methods.steady.flow import later, run_over, stacked
from eppanalysis.methods.steady.motion import SteadyMotion, size_of
from eppanalysis.models.elements.automaton import AutomatonBuilder
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import Sine
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.results import LimitCycle

#: Distance from a motion, relative to its size, that is none.
_SAME = 1e-6
#: Name of the element that marks the zeros of a sine.
_ZEROS = "sine"


class Response(Protocol):
    """What is needed of a periodic response here; its attributes are those of :class:`PeriodicResponse`."""

    @property
    def multiple(self) -> int:
        """Periods of the input in one of its own."""

    @property
    def phase(self) -> float:
        """Of the input at the start [rad]."""

    @property
    def amplitude(self) -> float:
        """Of the input."""

    @property
    def cycle(self) -> LimitCycle:
        """The motion."""


@dataclass(frozen=True)
class Sinusoid:
    """The sine at an input of a loop, in numbers that are those of the proof."""

    input: str
    amplitude: float
    omega: float  # [rad/s]

    @classmethod
    def of(cls, response: Response, input: str) -> Sinusoid:
        """That of a response."""
        omega = 2.0 * np.pi * response.multiple / response.cycle.period
        return cls(input, kept(response.amplitude), kept(omega))

    def hybrid(self, system: LureSystem, at: OperatingPoint) -> HybridSystem:
        """The loop under the sine, which is two states, with an element that marks its zeros and does nothing else.

        Raises
        ------
        NotCovered
            If the loop has no such input, or has sampled controllers.
        """
        if self.input not in system.input_names:
            raise NotCovered(f"{system.name} has no input {self.input}.")
        held = replace(_with_zeros(system, self.input, at), v0=at.vector(system))
        sine = Sine(self.amplitude, self.omega / (2.0 * np.pi))
        hybrid = HybridSystem.from_lure(held, {self.input: sine}).held
        if Strobe.of(hybrid) is not None:
            raise NotCovered("Samples are at rational times and zeros of a sine are not: together they have no proof.")
        A, s = hybrid.model.A.copy(), self.place(system)
        A[s, s + 1], A[s + 1, s] = self.omega, -self.omega
        return replace(hybrid, model=hybrid.model._replace(A=A))

    def place(self, system: LureSystem) -> int:
        """Of the sine among the states of the hybrid system; that of the cosine follows."""
        return len(system.A) + system.input_names.index(self.input)


def _with_zeros(system: LureSystem, name: str, at: OperatingPoint) -> LureSystem:
    """The loop with one more element, which reads an input about where it is held, and acts on nothing."""
    build = AutomatonBuilder()
    above, below = build.mode("above zero"), build.mode("below zero")
    build.guard("falls through zero", above, below, on_input=-1.0)
    build.guard("rises through zero", below, above, on_input=1.0)
    (nz, n), nw, nv, k = system.C.shape, system.B.shape[1], len(system.v0), system.input_names.index(name)
    s, D = system.signals, np.zeros((nz + 1, nw + 1))
    D[:nz, :nw] = system.D
    return replace(
        system,
        B=np.hstack([system.B, np.zeros((n, 1))]), C=np.vstack([system.C, np.zeros((1, n))]), D=D,
        D_input=np.vstack([system.D_input, np.eye(nv)[k]]),
        constant_input=np.append(system.constant_input, -at.vector(system)[k]),
        elements=(*system.elements, AutomatonElement(build.build(above))),
        element_names=(*system.element_names, _ZEROS), memory=(*system.memory, None),
        delays=np.append(system.delays, 0.0), signals=replace(s, D=np.hstack([s.D, np.zeros((len(s.D), 1))])),
        cuts=None, margins_at=(), given=None,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class TimedMotion:
    """A motion once round, closed in floats; offers what the proof takes of an :class:`Orbit`."""

    hybrid: HybridSystem
    course: Course
    y: Array  # (N,): behind the event at the start
    starts: Array  # (p + 1, N): y behind each event, the clock since the last sample
    tau: Array  # (p,): times between the events [s]
    scale: Array  # (N,): size of the motion in each place of y; never zero

    @property
    def period(self) -> float:
        """Period [s]."""
        return float(self.tau.sum())

    @classmethod
    def of(cls, start: HybridSystem, run: Run, last: int, held: IntArray, sine: int | None = None) -> TimedMotion:
        """A run from behind an event that tells the time to that at place `last`, which is behind the same one.

        Parameters
        ----------
        held : int array
            Places of what comes back whatever it is, as what an integrator holds of steps that add up to none.
        sine : int, optional
            Place of the sine that tells the time, if one does.
        """
        model, n, events = start.model, start.x0.size, slice(0, last + 1)
        guards = run.guard[events]
        rows = np.vstack([stacked(start), np.hstack([run.state, run.memory_values])[events]])
        times = np.append(0.0, run.time[events])
        strobe, own = Strobe.of(start), renewed(start, guards)
        timed = np.zeros(n, bool)
        if sine is not None:
            timed[sine : sine + 2] = True
        if strobe is not None:
            timed[strobe.clock] = True
            ticks = np.any(model.guard_h[guards] != 0.0, axis=1) & strobe.of_samples[guards]
            back = np.maximum.accumulate(np.where(np.append(True, ticks), times, 0.0))
            rows[:, strobe.clock] = times - back
            own &= strobe.held
        own[held[held >= n] - n] = False
        free = np.flatnonzero(np.concatenate([start.compared | timed, own]))
        range_, most = np.ptp(rows, axis=0), np.abs(rows).max(axis=0)
        range_[:n] = np.where(timed, range_[:n], run.high - run.low)
        most[:n] = np.where(timed, most[:n], np.maximum(np.abs(run.high), np.abs(run.low)))
        if strobe is not None:
            range_[strobe.clock] = np.diff(times).max()
        scale = size_of(range_, most)
        y = rows[0].copy()
        y[n:] = [kept(value) for value in y[n:].tolist()]
        if sine is not None:
            scale[sine : sine + 2] = 1.0
        modes = np.vstack([start.modes0, run.modes[events]])[:-1].astype(np.int64)
        tau = np.diff(times)
        at_once = together(tau, float(times[-1]))
        course = Course(modes, guards.astype(np.int64), at_once, tuple(free.tolist()), sine)
        return cls(start, course, y, rows, tau, scale)


def renewed(hybrid: HybridSystem, guards: IntArray) -> BoolArray:
    """Which memory values events change, shape (h,)."""
    model = hybrid.model
    out = np.zeros(hybrid.H0.size, bool)
    for g in set(guards.tolist()):
        e = model.guard_element[g]
        h, size = int(model.first[e, 2]), int(model.first[e + 1, 2] - model.first[e, 2])
        kept = np.all(model.reset_h[g, :size, :size] == np.eye(size), axis=1) & (model.reset_0[g, :size] == 0.0)
        out[h : h + size] |= ~(kept & np.all(model.reset_z[g, :size] == 0.0, axis=1))
    return out


def takes_own_samples(hybrid: HybridSystem, memory: Array) -> bool:
    """Whether memory values have the samples of all controllers as long after one another as they are in the loop."""
    strobe, model, apart = Strobe.of(hybrid), hybrid.model, []
    for e, controller in () if strobe is None else zip(strobe.numbers, strobe.controllers, strict=True):
        guard = int(model.guard_first[model.mode_first[e]])
        due = int(model.first[e, 2] + np.flatnonzero(model.guard_h[guard])[0])
        # By how many ticks a count is off that of the first sample, and after how many it is there again.
        apart.append((number_of(memory[due] - hybrid.H0[due]), number_of(controller.counted(controller.sample_time))))
    return all(not (one - other) % _divisor(every, each) for (one, every), (other, each) in combinations(apart, 2))


def _divisor(a: Fraction, b: Fraction) -> Fraction:
    """Greatest number of which both are multiples."""
    return Fraction(gcd(a.numerator * b.denominator, b.numerator * a.denominator), a.denominator * b.denominator)


def locked_motion(system: LureSystem, cycle: LimitCycle, at: OperatingPoint) -> TimedMotion | None:
    """The motion of a cycle that is locked to samples; None where it does not close.

    Raises
    ------
    EppError
        If the samples never come round together.
    NotCovered
        If on the cycle samples come at other times than in the loop.
    """
    hybrid = steady_hybrid(system, at)
    strobe = Strobe.of(hybrid)
    assert strobe is not None
    if not strobe.closes:
        raise EppError(f"{system.name}: its samples never come round together, so no cycle is locked to them.")
    begun = hybrid.begun(cycle.state, cycle.memory)
    start = strobe.begun(begun.x0, begun.H0, begun.modes0)
    if not takes_own_samples(hybrid, start.H0):
        raise NotCovered("On the cycle the samples of the controllers come at other times than in the loop.")
    n = round(cycle.period / strobe.period)
    # Once round elements are in the modes, and hold the values, in which they come back.
    once = SampledTurn.of(strobe, start, n) if n else None
    start = start if once is None else begun_behind(strobe, once.run, once.last)
    found = None if once is None else close_locked(strobe, start, n)
    if found is None or found.n != n or not _is_near(found.at_samples, stacked(start)[strobe.free], found.scale):
        return None
    return TimedMotion.of(found.start, found.run, found.last, found.steady.sought[found.steady.held])


def _is_near(rows: Array, there: Array, scale: Array) -> bool:
    """Whether one of the places that a motion passes is another one."""
    return bool(np.abs((rows - there) / scale).max(axis=1).min() < _SAME)


def driven_motion(system: LureSystem, response: Response, sinusoid: Sinusoid, at: OperatingPoint) -> TimedMotion | None:
    """The motion of a response to a sine; None where it does not close."""
    hybrid, s = sinusoid.hybrid(system, at), sinusoid.place(system)
    period = 2.0 * np.pi / sinusoid.omega
    x = hybrid.x0.copy()
    x[s : s + 2] = np.sin(response.phase), np.cos(response.phase)
    begun = hybrid.at(x, hybrid.H0, hybrid.modes0).begun(response.cycle.state, response.cycle.memory)
    # Half a turn of the sine later the element that marks its zeros is in its mode, wherever it began.
    start = later(begun, 0.6 * period)
    steady = None if start is None else close(SteadyMotion.begun(start, response.multiple * period), given=True)
    run = None if steady is None else run_over(steady.start, 1.2 * period)
    if steady is None or run is None:
        return None
    (upward,) = np.flatnonzero((hybrid.model.guard_element == len(system.elements)) & (hybrid.model.guard_z[:, 0] > 0))
    first = np.flatnonzero(run.guard[: run.n_kept] == upward)[0]
    x, memory, modes = run.state[first].copy(), run.memory_values[first], run.modes[first]
    x[s : s + 2] = 0.0, 1.0
    start = hybrid.at(x, memory, modes)
    again, own = run_over(start, (response.multiple + 0.2) * period), run_over(begun, 1.2 * period)
    if again is None or own is None:
        return None
    zeros, first = (np.flatnonzero(r.guard[: r.n_kept] == upward) for r in (again, own))
    if zeros.size < response.multiple:
        return None
    motion = TimedMotion.of(start, again, int(zeros[response.multiple - 1]), steady.sought[steady.held], s)
    n = hybrid.n_plant
    near = _is_near(again.state[zeros, :n], own.state[first[0], :n], motion.scale[:n])
    return motion if near else None
