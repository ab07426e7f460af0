"""Reset elements: an integrator and a first-order lag whose state becomes zero where the input passes through zero.

Each brings one linear state s, its output, and the law inside it, which reads the input and that state, drives the
state and has an impulse where the input passes through zero, of the size that takes the state to zero. So the law is
what is in the loop; what is said here, from u to y, is what the element does, and the DF takes it for.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import PER_TIME, SLOPE_PER_TIME, Answer, Nonlinearity
from eppanalysis.models.elements.dynamic.state import POLE, StateOutput, lag, state_of_law
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.phases import (
    POSITIVE,
    SMALLEST_AMPLITUDE,
    broadcast,
    broadcast_with_frequency,
    require_numbers,
    with_nan,
)
from eppanalysis.models.elements.piecewise import UNITY

#: Product of a pole and a time below which the exponential is a series.
_SHORT = 1e-2


@dataclass(frozen=True)
class ResetLaw(Nonlinearity):
    """From the input and the state of a reset element to what drives the state, its impulses included.

    Its describing function is that of the input, for the fundamental: behind it the state is what the element's own
    describing function says.
    """

    n_inputs: ClassVar[int] = 2
    of_frequency: ClassVar[bool] = True
    linear_gain_is: ClassVar[str] = "without its resets"

    gain: float
    pole: float

    @property
    def leak(self) -> float:
        """Pole of the state without what the law drives it by [rad/s]."""
        return self.pole or POLE

    @property
    def has_impulses(self) -> bool:
        """Its resets are impulses."""
        return True

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """What drives the state, for an input and a state."""
        u, s = x
        return self.gain * floats(u, "output: x") + (self.leak - self.pole) * floats(s, "output: x"), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain that make the state's those of the reset element."""
        a, b, w = broadcast(amplitude, bias, omega)
        mean, gain = _answer(a, b, w, self.gain, self.pole)
        return self.leak * mean, (1j * w + self.leak) * gain

    def thresholds(self, bias: float = 0.0) -> Array:
        """No amplitudes: what it does does not depend on the amplitude."""
        return np.zeros(0)

    def linear_gain(self) -> Array:
        """Without the impulses."""
        return np.array([[self.gain, self.leak - self.pole]])

    def automaton(self) -> Automaton:
        """A mode for either sign of the input, and one at the start, which is left without a reset."""
        build = AutomatonBuilder(n_inputs=2)
        # The impulse is minus the state, by which its integrator becomes zero exactly (docs/theory/reset.md, In a
        # loop). The start has a mode of its own: to take the mode of the input's sign there is no passage through zero.
        law = [self.gain, self.leak - self.pole]
        start, plus, minus = (build.mode(name, from_input=law) for name in ("start", "positive", "negative"))
        for before, after, sign, name in ((minus, plus, 1.0, "upward"), (plus, minus, -1.0, "downward")):
            build.guard(f"begins {build.modes[after].name}", start, after, on_input=[sign, 0.0])
            build.guard(f"resets {name}", before, after, on_input=[sign, 0.0], impulse=[0.0, -1.0])
        return build.build(start)


def _answer(a: Array, b: Array, w: Array, k: float, pole: float, n: int = 1) -> Answer:
    """Mean and n-th harmonic of ``dy/dt = -pole y + k u``, reset where ``u = b + a sin(w t)`` passes through zero.

    With ``sin(beta) = b/a`` the input is positive over ``L = pi + 2 beta`` and negative over ``pi - 2 beta``; what the
    output has reached at the end of either is lost there, and is in every harmonic as an impulse.
    """
    a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        kappa, drive = pole / w, k / w
        sine = np.clip(b / a, -1.0, 1.0)
        beta, cosine = np.arcsin(sine), np.sqrt((1 - sine) * (1 + sine))
        lost, area = _half(kappa, np.pi + 2 * beta, sine, cosine)
        lost_below, area_below = _half(kappa, np.pi - 2 * beta, -sine, cosine)
        mean = a * drive / (2 * np.pi) * (area - area_below)
        # What is lost at either passage is an impulse in the rate, so that each harmonic follows without a further
        # integral (docs/theory/reset.md, Describing function).
        jump = lost * (-cosine + 1j * sine) ** n - lost_below * (cosine + 1j * sine) ** n
        gain = drive * (float(n == 1) - 1j * jump / np.pi) / (kappa + 1j * n)
        linear = (n == 1) * k / (pole + 1j * w)
        steady = k * b / pole if pole else np.where(b == 0, 0.0, np.copysign(np.inf, k * b))
        rests = (np.abs(b) >= a) | (w == 0)
    return with_nan(a, b, np.where(rests, steady, mean), np.where(rests, linear, gain), w)


def _half(kappa: Array, length: Array, sine: Array, cosine: Array) -> tuple[Array, Array]:
    """What the output reaches behind a positive input of a length, and its integral; of ``dy/dphi = -kappa y + u``.

    The input is ``sine + sin(phi)``, from its passage through zero to the next.
    """
    x = kappa * length
    # h2 = (L - h1)/kappa of docs/theory/reset.md first, and h1 from it: an integrator, kappa = 0, divides by nothing.
    series = 0.5 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x * (1 / 720 - x / 5040))))
    safe = np.where(x < _SHORT, 1.0, x)
    second = np.where(x < _SHORT, series, (safe + np.expm1(-safe)) / safe**2) * length**2
    first = length - kappa * second
    whole = sine * length + 2 * cosine
    scale = 1 + kappa**2
    reached = (sine * first + cosine * (2 - kappa * first)) / scale
    return reached, (sine * second + cosine * first + kappa * whole) / scale


class _WithoutResets(AutomatonElement):
    """What margins take for a reset element."""

    linear_gain_is = "without its resets"


class _Reset(StateOutput):
    """What both share: a state that is reset where the input passes through zero."""

    linear_gain_is: ClassVar[str] = "without its resets"

    def _set_law(self, gain: float, pole: float) -> None:
        """Store the state, what drives it and the linear element."""
        law = ResetLaw(gain, pole)
        self._set_parts(state_of_law(law.leak), law, _WithoutResets(UNITY.automaton(), lag(pole, gain)))

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain; exact, and the gain is independent of the amplitude where there is no bias.

        An input that never passes through zero resets nothing: there the gain is the linear one.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        return _answer(a, b, w, self._law.gain, self._law.pole)

    def harmonics(self, amplitude: float, bias: float, omega: float, order: int) -> ComplexArray:
        """In closed form, as the describing function; the mean is infinite where an integrator is never reset."""
        point = broadcast_with_frequency(amplitude, bias, omega)
        each = [_answer(*point, self._law.gain, self._law.pole, n) for n in range(1, order + 1)]
        return np.array([[each[0][0] / amplitude, *(harmonic for _, harmonic in each)]], complex)

    def linear_gain(self) -> Array:
        """Static gain without resets, infinite for an integrator."""
        return np.array([[self._law.gain / self._law.pole if self._law.pole else np.inf]])

    @property
    def _law(self) -> ResetLaw:
        assert isinstance(self.inside, ResetLaw)
        return self.inside


@dataclass(frozen=True)
class CleggIntegrator(_Reset, kind="clegg_integrator"):
    """Integrator ``dy/dt = gain u`` whose output becomes zero where its input passes through zero.

    It begins at its memory, which is zero where none is given.

    Parameters
    ----------
    gain : float
        Gain of the integrator [unit of the output per unit of the input and s], positive.

    Raises
    ------
    ModelError
        If the gain is not a positive number.

    Notes
    -----
    Clegg, A nonlinear integrator for servomechanisms, 1958. About a bias that is no smaller than the amplitude it is
    never reset and its mean grows without bound.

    Examples
    --------
    >>> import numpy as np
    >>> from eppanalysis.models.elements import CleggIntegrator
    >>> mean, gain = CleggIntegrator(gain=1.0).describing_function(
    ...     amplitude=1.0, omega=2.0
    ... )
    >>> round(float(abs(gain)) * 2.0, 4), round(float(np.degrees(np.angle(gain))), 2)
    (1.619, -38.15)
    """

    units = MappingProxyType({"gain": SLOPE_PER_TIME})

    gain: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, gain=POSITIVE)
        self._set_law(self.gain, 0.0)


@dataclass(frozen=True)
class FirstOrderReset(_Reset, kind="first_order_reset"):
    """First-order lag ``dy/dt = -pole y + gain u`` whose output becomes zero where its input passes through zero.

    It begins at its memory, which is zero where none is given.

    Parameters
    ----------
    pole : float
        Corner frequency [rad/s], positive.
    gain : float
        Gain from the input to the rate of the output [unit of the output per unit of the input and s], positive.

    Raises
    ------
    ModelError
        If a field is not a positive number.

    Notes
    -----
    Horowitz and Rosenbaum, Non-linear design for cost of feedback reduction in systems with large parameter
    uncertainty, 1975: the first-order reset element (FORE).

    Examples
    --------
    >>> from eppanalysis.models.elements import FirstOrderReset
    >>> element = FirstOrderReset(pole=1.0, gain=1.0)
    >>> mean, gain = element.describing_function(amplitude=[1.0, 5.0], omega=1.0)
    >>> gain.round(4).tolist()
    [(0.666-0.334j), (0.666-0.334j)]
    """

    units = MappingProxyType({"pole": PER_TIME, "gain": SLOPE_PER_TIME})

    pole: float
    gain: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, pole=POSITIVE, gain=POSITIVE)
        self._set_law(self.gain, self.pole)
