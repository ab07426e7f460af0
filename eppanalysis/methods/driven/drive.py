"""A loop driven by a sine at one of its inputs, as one more autonomous hybrid system.

The sine is exact: two states of an undamped oscillator that nothing acts on. What is driven repeats itself after a
whole number of the input's periods, which are known; so its phase is no unknown, and no event need mark its begin
(docs/theory/driven.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.describing.balance import Balance, describe
from eppanalysis.methods.orbits.decoupled import in_decoupled_states
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.states import OtherStates
from eppanalysis.methods.steady.flow import later, strobe_of
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import Sine
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import is_sampled
from eppanalysis.models.systems.subject import (
    CaseLike,
    PointLike,
    driven_input,
    own_sines,
    standing,
    system_of,
)
from eppanalysis.results import LimitCycle

#: Longest step of a run, relative to the period of the input: no simple share of it, for switches of what keeps step
#: with the input would fall on the ends of steps, where rounding has them met again and again.
_STEP = 0.0618
#: Difference of a number of periods from a whole one that is rounding.
_WHOLE = 1e-9


@dataclass(frozen=True, eq=False)
class Drive:
    """A loop whose inputs are constant but for one: ``amplitude * sin(omega t)`` about where it is held."""

    #: In states of its own: what nothing drives would make every response one of a continuum, and turned ones mix what
    #: sticks with what moves.
    system: LureSystem
    at: OperatingPoint  # where the inputs are held, the driven one included
    input: str
    amplitude: float  # in the unit of the input
    omega: float  # angular frequency [rad/s]
    form: InSamples | None = None  # how a loop in discrete time is run
    states: OtherStates | None = None  # its states beside its user's; None where they are the same

    @property
    def given(self) -> LureSystem:
        """The loop as its user has it: in discrete time another one than what is run."""
        return self.system if self.form is None else self.form.clocked.given

    def begun(self, state: Array) -> HybridSystem:
        """The hybrid system begun at a state of the loop (n,), with the input at phase zero."""
        start = (state, ()) if self.form is None else self.form.start(state, ())
        return self.hybrid.begun(*start)

    def to_user(self, cycle: LimitCycle, start: HybridSystem | None = None) -> LimitCycle:
        """A motion of the loop as its user knows it; in discrete time one that begins at a sample, at a start."""
        own = cycle if self.form is None else self.form.to_user(cycle, start)
        own = own if self.states is None else self.states.to_user(own)
        return replace(own, operating_point=self.at)

    @property
    def period(self) -> float:
        """Of the input [s]."""
        return 2.0 * np.pi / self.omega

    @property
    def frequency(self) -> float:
        """Of the input [Hz]."""
        return self.omega / (2.0 * np.pi)

    @property
    def unit(self) -> str:
        """SI unit of the input, where the loop knows it."""
        return self.system.signals.units_by_name().get(self.input, "")

    @property
    def column(self) -> int:
        """Number of the input."""
        return self.system.input_names.index(self.input)

    @cached_property
    def _unit(self) -> HybridSystem:
        """The hybrid system with a sine of amplitude 1 and 1 rad/s."""
        held = replace(self.system, v0=self.at.vector(self.system))
        hybrid = HybridSystem.from_lure(held, {self.input: Sine(1.0, 0.5 / np.pi)})
        none = {"breakpoint_time": np.zeros(0), "breakpoint_state": np.zeros(0, np.int64)}
        none |= {"breakpoint_value": np.zeros(0), "breakpoint_memory": np.zeros(0, np.int64)}
        return replace(hybrid, model=hybrid.model._replace(**none, breakpoint_slope=np.zeros(0)))

    @property
    def sine(self) -> slice:
        """Places of sine and cosine of the input among the states."""
        first = self.system.A.shape[0] + self.column
        return slice(first, first + 2)

    @cached_property
    def hybrid(self) -> HybridSystem:
        """The hybrid system, begun at the loop's own start with the input at phase zero."""
        unit, s = self._unit, self.sine.start
        # Amplitude and frequency enter by the sine's own two states alone
        # (docs/theory/driven.md), so that nothing of the loop is built anew along a branch.
        of_states = {name: getattr(unit.model, name).copy() for name in ("A", "C", "smooth_x", "Yx")}
        A = of_states["A"]
        for matrix in (A[: unit.n_plant], *(rows for name, rows in of_states.items() if name != "A")):
            matrix[:, s] *= self.amplitude
        A[s, s + 1], A[s + 1, s] = self.omega, -self.omega
        scale = min(unit.time_scale, 0.5 * _STEP * self.period)
        return replace(unit, model=unit.model._replace(**of_states), time_scale=scale)

    @cached_property
    def balance(self) -> Balance | None:
        """Of the means, for describing functions; None where it does not determine them, or an element has none."""
        try:
            for element in self.given.elements:
                describe(element, np.array(1.0), np.array(0.0), np.array(self.omega))
            return Balance.of(self.given, 0, self.at.vector(self.given))
        except ModelError:
            return None

    def phase(self, x: Array) -> float:
        """Phase of the input in a state of the hybrid system [rad], between 0 and 2 pi."""
        sine, cosine = x[self.sine]
        return float(np.arctan2(sine, cosine)) % (2.0 * np.pi)

    def alongside(self, start: HybridSystem, phase: float, multiple: int) -> Iterator[HybridSystem | None]:
        """A motion from a start at the next times at which the input has a phase [rad], of so many periods."""
        ahead = (phase - self.phase(start.x0)) % (2.0 * np.pi)
        ahead = 0.0 if 2.0 * np.pi - ahead < 1e-12 else ahead
        for k in range(multiple):
            yield later(start, ahead / self.omega + k * self.period)

    @property
    def is_sampled(self) -> bool:
        """Whether there is a sampled controller in the loop."""
        return is_sampled(self.system.elements)

    def comes_round(self, most: int) -> int:
        """Fewest periods of the input, `most` at most, in which samples come round with it; 0 where in none."""
        strobe = strobe_of(self.hybrid)
        if strobe is None:
            return 1
        for n in range(1, most + 1):
            rounds = n * self.period / strobe.period
            if strobe.every and round(rounds) and abs(rounds - round(rounds)) <= _WHOLE * rounds:
                return n
        return 0

    def changed(self, amplitude: float | None = None, omega: float | None = None) -> Drive:
        """The same loop under another sine."""
        new = Drive(
            self.system,
            self.at,
            self.input,
            self.amplitude if amplitude is None else amplitude,
            self.omega if omega is None else omega,
            self.form,
            self.states,
        )
        new.__dict__.update(_unit=self._unit, balance=self.balance)  # which do not depend on the sine
        return new


@dataclass(frozen=True, eq=False)
class DriveRange:
    """What a branch of responses runs over: the drive at each value of the logarithm of its frequency or amplitude."""

    drive: Callable[[float], Drive]  # from the value to the drive
    limits: tuple[float, float]
    multiple: int = 1  # periods of the input after which what is driven repeats itself

    def at(self, value: float, like: HybridSystem) -> tuple[HybridSystem, float]:
        """The system, begun as another one, and the time after which what it does repeats itself [s]."""
        drive = self.drive(value)
        return drive.hybrid.at(like.x0, like.H0, like.modes0), self.multiple * drive.period

    def alongside(self, value: float, start: HybridSystem, other: HybridSystem) -> Iterator[HybridSystem | None]:
        """Where a motion from a start comes to the phase of the input at which another one begins."""
        drive = self.drive(value)
        return drive.alongside(start, drive.phase(other.x0), self.multiple)


def drive_of(
    loop: LureSystem | CaseLike,
    input: str | None,
    amplitude: float | None,
    frequency: float | None,
    operating_point: PointLike | None,
    analysis: str,
) -> Drive:
    """The drive of an analysis; what is not given is that of the case's own sine.

    Raises
    ------
    EppError
        If it has no such input, another input is not constant, or the sine is not given.
    """
    system, own = system_of(loop, analysis), own_sines(loop, analysis)
    name = driven_input(loop, input, analysis)
    if name in own:
        amplitude = own[name].amplitude if amplitude is None else amplitude
        frequency = own[name].frequency_hz if frequency is None else frequency
    for what, number, unit in (("amplitude", amplitude, "the unit of the input"), ("frequency", frequency, "Hz")):
        if number is None or not (np.isfinite(number) and number > 0):
            raise EppError(f"{analysis}: {what} is {number}; expected a positive number [{unit}].")
    assert amplitude is not None and frequency is not None
    point = OperatingPoint.of(system) if isinstance(loop, LureSystem) else loop.operating_point
    if operating_point is not None:
        point = operating_point if isinstance(operating_point, OperatingPoint) else point.with_inputs(operating_point)
    middle = point.inputs.get(name, float(system.v0[system.input_names.index(name)]))
    system, at = standing(loop, point.with_inputs({name: middle}), analysis)
    states = in_decoupled_states(system)
    system = system if states is None else states.system
    form = InSamples.at(system, at) if system.time_step else None
    if form is not None:
        system, at = standing(form.system, at, analysis)
    return Drive(system, at, name, float(amplitude), 2.0 * np.pi * float(frequency), form, states)
