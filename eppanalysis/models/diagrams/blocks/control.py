"""Linear blocks of a diagram, as engineers call them: controllers, filters, and what is driven.

Every block is a frozen set of declared fields in SI units with a state space between named ports. Dead time, sample
time and the state at the start are fields of all of them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.errors import ModelError
from eppanalysis.models.devices.declared import Form, Section, choice, names, numbers, quantity, required
from eppanalysis.models.elements.base import DAMPING, OUT, RATIO, SLOPE, SLOPE_PER_TIME, Role
from eppanalysis.models.elements.static import Quantiser
from eppanalysis.models.systems.linear import StateSpace, transfer_function
from eppanalysis.readable import count

#: Blocks by the kind that a case file gives them.
BLOCKS: dict[str, type[Block]] = {}
#: How a continuous controller becomes one that is executed every sample time: what files call it, and scipy.
DISCRETISATIONS: dict[str, Any] = {"backward": "backward_diff", "forward": "euler", "tustin": "bilinear", "hold": "zoh"}


@dataclass(frozen=True, kw_only=True)
class Block(Section):
    """A linear block with named ports; this is what all of them have in common."""

    kind: ClassVar[str] = ""
    inputs: ClassVar[tuple[str, ...]] = ("in",)
    outputs: ClassVar[tuple[str, ...]] = ("out",)
    #: What the fields are the units of, where it depends on the signals.
    units: ClassVar[Mapping[str, Role]] = {}
    #: Units of the ports, where the block has its own.
    port_units: ClassVar[Mapping[str, str]] = {}
    #: Whether each output has the unit of the input in its place.
    same_unit: ClassVar[bool] = False

    delay: float = quantity(0.0, "Dead time", "s", "ms", at_least=0)
    sample_time: float | None = quantity(None, "Time between two executions, with the output held", "s", "ms", above=0)
    computation_delay: float = quantity(
        0.0, "Time from a sample to the new output, less than `sample_time`", "s", "ms", at_least=0
    )
    discretisation: str = choice("How its continuous form is executed", tuple(DISCRETISATIONS))
    start: Sequence[float] | None = numbers(
        "States at the start: of matrices theirs, of a transfer function those of a controllable form in its own time",
        None,
    )

    def __init_subclass__(cls, kind: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.kind = kind
        if kind:
            BLOCKS[kind] = cls

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.computation_delay and not self.sample_time:
            expected = "a sample_time beside it, as the block has no sample_time, or a delay in its place"
            raise ModelError(type(self).__name__, self.computation_delay, expected, field="computation_delay")
        if self.discretisation != next(iter(DISCRETISATIONS)) and not self.sample_time:
            expected = "a sample_time beside it, as the block has no sample_time"
            raise ModelError(type(self).__name__, self.discretisation, expected, field="discretisation")
        if self.sample_time and self.delay:
            expected = "zero where it is sampled: a computation_delay, or a dead_time behind it"
            raise ModelError(type(self).__name__, self.delay, expected, field="delay")
        if self.sample_time and not self.computation_delay < self.sample_time:
            limit = (
                "less than sample_time (a whole sample: a transfer_function of it, num = [1], den = [1, 0], behind it)"
            )
            raise ModelError(type(self).__name__, self.computation_delay, limit, field="computation_delay")

    @abstractmethod
    def continuous(self) -> StateSpace:
        """State space in continuous time, from the ports `inputs` to the ports `outputs`."""

    def state_space(self) -> StateSpace:
        """State space as it acts: in continuous time, or from one sample to the next.

        Raises
        ------
        ModelError
            If there is no finite one.
        """
        return self._state_space

    @cached_property
    def _state_space(self) -> StateSpace:
        try:
            with np.errstate(all="ignore"):  # what overflows is refused as not finite
                found = self.continuous()
        except ArithmeticError:
            expected = "numbers of which squares and quotients are finite"
            raise ModelError(f"{type(self).__name__}: its state space is not finite", expected=expected) from None
        if not all(np.all(np.isfinite(getattr(found, name))) for name in "ABCD"):
            expected = "numbers of which squares and quotients are finite"
            raise ModelError(f"{type(self).__name__}: its state space is not finite", expected=expected)
        if self.start is not None and len(self.start) != len(found.A):
            expected = f"{count(len(found.A), 'number')}, one for each state"
            raise ModelError(type(self).__name__, list(self.start), expected, field="start")
        return found if self.sample_time is None else self._executed(found)

    def _executed(self, s: StateSpace) -> StateSpace:
        if s.time_step is not None:
            return s
        step = float(self.sample_time or 0.0)
        if not len(s.A):
            return StateSpace(s.A, s.B, s.C, s.D, step)
        from scipy.signal import cont2discrete  # half a second, which loops without sampled controllers do not need

        made: Any = cont2discrete((s.A, s.B, s.C, s.D), step, DISCRETISATIONS[self.discretisation])
        return StateSpace(made[0], made[1], made[2], made[3], step)


def static(D: ArrayLike) -> StateSpace:
    """Ports without states between them."""
    through = np.array(D, float)
    rows, columns = through.shape
    return StateSpace(np.zeros((0, 0)), np.zeros((0, columns)), np.zeros((rows, 0)), through)


@dataclass(frozen=True, kw_only=True)
class Gain(Block, kind="gain"):
    """A factor."""

    units: ClassVar[Mapping[str, Role]] = {"gain": SLOPE}

    gain: float = quantity(1.0, "Output per input")

    def continuous(self) -> StateSpace:
        """No states."""
        return static([[self.gain]])


@dataclass(frozen=True, kw_only=True)
class Sensor(Block, kind="sensor"):
    """A sensor with its converter: ``gain`` times what comes in, in whole steps; held where it has a sample time.

    It is a gain behind a quantiser, an element by the sensor's name and "_quantiser".
    """

    units: ClassVar[Mapping[str, Role]] = {"gain": SLOPE, "step": OUT, "levels": RATIO}

    gain: float = quantity(1.0, "Output per input")
    step: float = required(
        "Step of the output: a turn over the counts of an encoder, the least bit of a converter", above=0
    )
    levels: float = quantity(2048.0, "Steps on either side of zero, a whole number", at_least=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not float(self.levels).is_integer():
            raise ModelError(type(self).__name__, self.levels, "a positive whole number", field="levels")
        if not self.gain:
            raise ModelError(type(self).__name__, self.gain, "a factor other than zero", field="gain")

    @property
    def quantiser(self) -> Quantiser:
        """The steps as they are at the input: the same numbers are held whether they are taken before or behind it."""
        return Quantiser(step=self.step / abs(self.gain), levels=int(self.levels))

    def continuous(self) -> StateSpace:
        """No states."""
        return static([[self.gain]])


@dataclass(frozen=True, kw_only=True)
class Constant(Block, kind="constant"):
    """A constant source: an offset, a bias, a load; late or sampled it is the same."""

    inputs: ClassVar[tuple[str, ...]] = ()
    units: ClassVar[Mapping[str, Role]] = {"value": OUT}

    value: float = required("What it puts out, in the unit of what it drives")

    def continuous(self) -> StateSpace:
        """No inputs and no states: its value is a constant term of what it drives."""
        return StateSpace(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((1, 0)), np.zeros((1, 0)))


@dataclass(frozen=True, kw_only=True)
class DeadTime(Block, kind="dead_time"):
    """What comes in comes out `delay` later."""

    same_unit = True

    def continuous(self) -> StateSpace:
        """No states."""
        return static([[1.0]])


@dataclass(frozen=True, kw_only=True)
class TransferFunction(Block, kind="transfer_function"):
    """A quotient of polynomials of s, or of z where it has a sample time."""

    num: Sequence[float] = numbers("Numerator, descending powers")
    den: Sequence[float] = numbers("Denominator, descending powers")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("num", "den"):
            if not len(getattr(self, name)):
                raise ModelError(type(self).__name__, [], "at least one coefficient", field=name)
        if not np.any(self.den):
            raise ModelError(type(self).__name__, list(self.den), "a coefficient other than zero", field="den")

    def continuous(self) -> StateSpace:
        """Controllable form."""
        return transfer_function(self.num, self.den, self.sample_time)


@dataclass(frozen=True, kw_only=True)
class ZeroPoleGain(Block, kind="zero_pole_gain"):
    """``gain`` times the product of (s - zero) over that of (s - pole); of z where it has a sample time."""

    zeros: Sequence[Any] = numbers(
        "Zeros; a complex one as [real part, imaginary part], beside its conjugate", (), Form.ROOTS
    )
    poles: Sequence[Any] = numbers("Poles, written as zeros are", form=Form.ROOTS)
    gain: float = quantity(1.0, "Factor")

    def continuous(self) -> StateSpace:
        """Controllable form."""
        zeros, poles = (self._roots(name) for name in ("zeros", "poles"))
        if len(zeros) > len(poles):
            expected = f"at most as many as the {len(poles)} poles"
            raise ModelError(type(self).__name__, list(self.zeros), expected, field="zeros")
        return transfer_function(self.gain * np.poly(zeros).real, np.poly(poles).real, self.sample_time)

    def _roots(self, name: str) -> np.ndarray:
        roots = np.array([complex(*np.atleast_1d(root)) for root in getattr(self, name) or ()])
        if not np.allclose(np.sort_complex(roots), np.sort_complex(roots.conj()), rtol=1e-12):
            raise ModelError(
                type(self).__name__, getattr(self, name), "every complex one beside its conjugate", field=name
            )
        return roots


@dataclass(frozen=True, kw_only=True)
class StateSpaceBlock(Block, kind="state_space"):
    """Matrices, with ports of any names; from one sample to the next where it has a sample time."""

    A: Sequence[Sequence[float]] = numbers("State matrix, a list of rows", form=Form.MATRIX)
    B: Sequence[Sequence[float]] = numbers(
        "From the inputs to the rate of the state, or to the next state", form=Form.MATRIX
    )
    C: Sequence[Sequence[float]] = numbers("From the state to the outputs", form=Form.MATRIX)
    D: Sequence[Sequence[float]] | None = numbers("From the inputs straight to the outputs", None, Form.MATRIX)
    input_names: Sequence[str] | None = names("Names of the inputs; by default in, or in1, in2, ...")
    output_names: Sequence[str] | None = names("Names of the outputs; by default out, or out1, out2, ...")
    state_names: Sequence[str] | None = names("Names of the states; by default the block's name and numbers")

    def __post_init__(self) -> None:
        super().__post_init__()
        A, B, C, _ = self._matrices()
        for which, given, n in (("in", self.input_names, B.shape[1]), ("out", self.output_names, len(C))):
            default = (which,) if n == 1 else tuple(f"{which}{i + 1}" for i in range(n))
            self._count(f"{which}put_names", given, n)
            if given is not None and len(set(given)) < n:
                raise ModelError(type(self).__name__, list(given), "names that differ", field=f"{which}put_names")
            object.__setattr__(self, f"{which}puts", default if given is None else tuple(given))
        self._count("state_names", self.state_names, len(A))

    def _count(self, field: str, given: Sequence[str] | None, count: int) -> None:
        """Refuse names of which there are not as many as are named."""
        if given is not None and len(given) != count:
            raise ModelError(type(self).__name__, list(given), f"{count} names, as the matrices have it", field=field)

    def _matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """As given, in two dimensions; without states B and C have the lengths that D has."""
        A, B, C = (np.atleast_2d(np.asarray(m, float)) for m in (self.A, self.B, self.C))
        if not A.size and self.D is not None:
            D = np.atleast_2d(np.asarray(self.D, float))
            return np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((len(D), 0)), D
        D = np.zeros((len(C), B.shape[1])) if self.D is None else np.atleast_2d(np.asarray(self.D, float))
        return A, B, C, D

    def continuous(self) -> StateSpace:
        """As given."""
        return StateSpace(*self._matrices(), self.sample_time)


@dataclass(frozen=True, kw_only=True)
class Integrator(Block, kind="integrator"):
    """``gain/s``."""

    units: ClassVar[Mapping[str, Role]] = {"gain": SLOPE_PER_TIME}

    gain: float = quantity(1.0, "Rate of the output per input")

    def continuous(self) -> StateSpace:
        """One state, the output."""
        return StateSpace(np.zeros((1, 1)), np.full((1, 1), self.gain), np.eye(1), np.zeros((1, 1)))


def _integral_gain(kp: float, ti: float | None, ki: float | None, who: str) -> float:
    """Gain of the integral part from either of its two spellings."""
    if ti is not None and ki is not None:
        raise ModelError(who, ki, "either it or ti, not both", field="ki")
    return kp / ti if ti is not None else ki or 0.0


#: The input of an integral part that has one of its own, as behind a dead band.
INTEGRAL = "integral"


def _integral_input() -> Any:
    return choice("Which input the integral part reads; it may be a second one", ("in", INTEGRAL))


def _with_inputs(s: StateSpace, integral_input: str) -> StateSpace:
    """A controller whose first state is its integral part, with as many inputs as it has."""
    if integral_input != INTEGRAL:
        return s
    of_integral = np.zeros_like(s.B)
    of_integral[0] = s.B[0]
    return StateSpace(s.A, np.hstack([s.B - of_integral, of_integral]), s.C, np.hstack([s.D, np.zeros_like(s.D)]))


class _WithIntegral(Block):
    """A controller with an integral part."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if getattr(self, "integral_input", "in") == INTEGRAL:
            object.__setattr__(self, "inputs", ("in", INTEGRAL))


@dataclass(frozen=True, kw_only=True)
class PI(_WithIntegral, kind="pi"):
    """``kp (1 + 1/(ti s))``, or ``kp + ki/s``."""

    units: ClassVar[Mapping[str, Role]] = {"kp": SLOPE, "ki": SLOPE_PER_TIME}

    kp: float = required("Proportional gain")
    ti: float | None = quantity(None, "Integral time", "s", above=0)
    ki: float | None = quantity(None, "Integral gain")
    integral_input: str = _integral_input()

    def continuous(self) -> StateSpace:
        """The integral part is the state."""
        ki = _integral_gain(self.kp, self.ti, self.ki, "PI")
        found = StateSpace(np.zeros((1, 1)), np.full((1, 1), ki), np.eye(1), np.full((1, 1), self.kp))
        return _with_inputs(found, self.integral_input)


@dataclass(frozen=True, kw_only=True)
class PID(_WithIntegral, kind="pid"):
    """``kp (1 + 1/(ti s) + td s/(tf s + 1))``, or with ``ki/s`` and ``kd s/(tf s + 1)``; tf filters the derivative."""

    units: ClassVar[Mapping[str, Role]] = {"kp": SLOPE, "ki": SLOPE_PER_TIME, "kd": DAMPING}

    kp: float = required("Proportional gain")
    ti: float | None = quantity(None, "Integral time", "s", above=0)
    ki: float | None = quantity(None, "Integral gain")
    td: float | None = quantity(None, "Derivative time", "s", at_least=0)
    kd: float | None = quantity(None, "Derivative gain")
    tf: float | None = quantity(
        None, "Time constant of the derivative's filter, needed with a derivative", "s", above=0
    )
    integral_input: str = _integral_input()

    def continuous(self) -> StateSpace:
        """States: the integral part, and what the derivative is filtered from."""
        return _with_inputs(self._of_one_input(), self.integral_input)

    def _of_one_input(self) -> StateSpace:
        ki = _integral_gain(self.kp, self.ti, self.ki, "PID")
        if self.td is not None and self.kd is not None:
            raise ModelError("PID", self.kd, "either it or td, not both", field="kd")
        kd = self.kp * self.td if self.td is not None else self.kd or 0.0
        if not kd:
            return StateSpace(np.zeros((1, 1)), np.full((1, 1), ki), np.eye(1), np.full((1, 1), self.kp))
        if self.tf is None:
            raise ModelError("PID", None, "a time, as a derivative without filter has no end", field="tf")
        A = np.array([[0.0, 0.0], [0.0, -1.0 / self.tf]])
        B, C = np.array([[ki], [1.0 / self.tf]]), np.array([[1.0, -kd / self.tf]])
        return StateSpace(A, B, C, np.array([[self.kp + kd / self.tf]]))


@dataclass(frozen=True, kw_only=True)
class LeadLag(Block, kind="lead_lag"):
    """``gain (zero_time s + 1)/(pole_time s + 1)``: lead where zero_time is larger, else lag."""

    units: ClassVar[Mapping[str, Role]] = {"gain": SLOPE}

    gain: float = quantity(1.0, "Gain at low frequencies")
    zero_time: float = required("Time constant of the zero", "s", "ms", at_least=0)
    pole_time: float = required("Time constant of the pole", "s", "ms", above=0)

    def continuous(self) -> StateSpace:
        """One state."""
        return transfer_function([self.gain * self.zero_time, self.gain], [self.pole_time, 1.0])


@dataclass(frozen=True, kw_only=True)
class LowPass(Block, kind="low_pass"):
    """``gain/(s/bandwidth + 1)``; with a damping, ``gain bandwidth^2/(s^2 + 2 damping bandwidth s + bandwidth^2)``."""

    units: ClassVar[Mapping[str, Role]] = {"gain": SLOPE, "damping": RATIO}

    bandwidth: float = required("Corner frequency", "rad/s", above=0)
    gain: float = quantity(1.0, "Gain at low frequencies")
    damping: float | None = quantity(None, "Damping ratio of a filter of second order", above=0)

    def continuous(self) -> StateSpace:
        """One or two states."""
        w = self.bandwidth
        if self.damping is None:
            return transfer_function([self.gain * w], [1.0, w])
        return transfer_function([self.gain * w * w], [1.0, 2.0 * self.damping * w, w * w])


@dataclass(frozen=True, kw_only=True)
class Notch(Block, kind="notch"):
    """``(s^2 + 2 depth width w s + w^2)/(s^2 + 2 width w s + w^2)``."""

    units: ClassVar[Mapping[str, Role]] = {"width": RATIO, "depth": RATIO}
    same_unit = True

    frequency: float = required("Angular frequency w of the notch", "rad/s", above=0)
    width: float = quantity(0.5, "Damping ratio of its poles", above=0)
    depth: float = quantity(0.0, "Gain at w, 0 for a full notch", at_least=0)

    def continuous(self) -> StateSpace:
        """Two states."""
        w = self.frequency
        return transfer_function([1.0, 2.0 * self.depth * self.width * w, w * w], [1.0, 2.0 * self.width * w, w * w])
