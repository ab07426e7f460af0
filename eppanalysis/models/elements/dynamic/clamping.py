"""A PI or PID controller with a limited output whose integrator is held at a limit: clamping.

What is in the loop is the law from the output without limits, the error and the integrator's state to what drives
the integrator and to the output; the states are the loop's.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.engine.describing import describe_clamped
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import DAMPING, OUT, SLOPE, SLOPE_PER_TIME, TIME, Answer, OwnStates
from eppanalysis.models.elements.dynamic.controller import LimitedPID
from eppanalysis.models.elements.dynamic.state import POLE
from eppanalysis.models.elements.phases import (
    NOT_ZERO,
    SMALLEST_AMPLITUDE,
    broadcast_with_frequency,
    distances,
    require,
    require_numbers,
    with_nan,
)
from eppanalysis.models.elements.static import Saturation


@dataclass(frozen=True)
class ClampedPID(LimitedPID, kind="clamped_pid"):
    """PID controller whose output is limited, with anti-windup by clamping (conditional integration).

    With the error e and the output v that it would have without limits, ::

        v = kp e + s + kd/filter_time (e - d)
        u = clip(v, lower, upper)
        dd/dt = (e - d)/filter_time

    the integrator s is held, ds/dt = 0, while v is beyond a limit and ki e would drive it further; else ds/dt = ki e.
    Where v returns from a limit only while s is held, v stays at the limit, and s moves by what keeps it there.

    The states start at zero. Its sector, slopes and thresholds are those of the law from v, e and s to ``ds/dt + s``
    and u; its describing function is for a v that is a sine, with the e that belongs to it. Margins are those
    of the PID within its limits.

    Parameters
    ----------
    kp : float
        Proportional gain, not zero [unit of the output per unit of the input].
    ki : float
        Integral gain, not zero, of the sign of kp [unit of the output per unit of the input and s].
    lower, upper : float
        Limits of the output, ascending [unit of the output].
    kd : float
        Derivative gain [unit of the output per unit of the input, times s].
    filter_time : float
        Time constant of the derivative's filter [s], positive where there is a derivative.

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    >>> from eppanalysis.models.elements import ClampedPID
    >>> pi = ClampedPID(kp=2.0, ki=4.0)
    >>> mean, gain = pi.describing_function(amplitude=[0.5, 2.0], omega=2.0)
    >>> gain[:, 1].round(3).tolist()  # from v to u, that of a saturation
    [(1+0j), (0.609+0j)]
    """

    n_inputs: ClassVar[int] = 3
    n_outputs: ClassVar[int] = 2
    of_frequency: ClassVar[bool] = True
    linear_gain_is: ClassVar[str] = "the PID within its limits"

    units = MappingProxyType({
        "kp": SLOPE, "ki": SLOPE_PER_TIME, "lower": OUT, "upper": OUT, "kd": DAMPING, "filter_time": TIME,
    })  # fmt: skip

    kp: float
    ki: float
    lower: float = -1.0
    upper: float = 1.0
    kd: float = 0.0
    filter_time: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, kp=NOT_ZERO)
        require(self, "ki", self.ki * np.sign(self.kp) > 0, "a number of the sign of kp", "kp")
        self._require_limits()
        self._set_states(self._states())

    def _states(self) -> OwnStates:
        """The integrator and the filter of the derivative; rows: v, e, s for the law, then u."""
        n, ahead, filtering = self._derivative
        none = np.zeros(2)
        return OwnStates(
            np.diag([-POLE, -filtering])[:n, :n],
            np.array([[0.0, 1.0, 0.0], [filtering, 0.0, 0.0]])[:n],
            np.array([[1.0, -ahead], none, [1.0, 0.0], none])[:, :n],
            np.array([[self.kp + ahead, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        )

    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """What drives the integrator, and the output, for v, e and s; without memory."""
        v, e, s = (floats(z, "output: x") for z in x)
        drive = self.ki * e
        held = ((v > self.upper) & (drive > 0)) | ((v < self.lower) & (drive < 0))
        return np.array([np.where(held, 0.0, drive) + POLE * s, np.clip(v, self.lower, self.upper)]), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain of both outputs, shape (..., 2), for ``v = bias + amplitude * sin(omega t)``.

        Closed forms without a derivative; with one the map of a period is closed and its fixed point is found by
        Newton's method, to about 1e-12. Where none is found (a derivative many times the integral action, which
        need not come to repeat itself) they are not numbers.

        A v that is beyond a limit throughout holds the integrator at that limit.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative, or `kd` does not have the sign of kp: then the error that
            belongs to a v grows without bound.
        """
        if self.kd * self.kp < 0:
            expected = "one of the sign of kp, or the exact orbit and the run"
            raise ModelError(f"ClampedPID: with kd {self.kd!r} it has no describing function", expected=expected)
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
        mean, gain = self._with_derivative(a, b, w) if self.kd else self._integrator(a, b, w)
        of_u = Saturation(self.lower, self.upper).describing_function(a, b, w)
        return np.stack([POLE * mean, of_u[0]], -1), np.stack([(1j * w + POLE) * gain, of_u[1]], -1)

    def _with_derivative(self, a: Array, b: Array, w: Array) -> Answer:
        """The same where the error follows from v by the filter of the derivative, too (see the engine)."""
        ahead = self.kd / self.filter_time
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            low, high = (self.lower - b) / a, (self.upper - b) / a
            kappa, tau = np.abs(self.ki / (self.kp + ahead)) / w, 1.0 / (self.filter_time * w)
        moves = (low < 1) & (high > -1) & (w > 0) & np.isfinite(kappa + tau)
        whole, wave = np.zeros(a.shape), np.zeros(a.shape, complex)
        some, them = np.empty(int(moves.sum())), np.empty(int(moves.sum()), complex)
        eta = np.full(some.size, ahead / (self.kp + ahead))
        describe_clamped(low[moves], high[moves], kappa[moves], eta, tau[moves], some, them)
        whole[moves], wave[moves] = some, them
        # Beyond a limit throughout it is held there; so slow a motion it follows.
        level = np.clip(b, self.lower, self.upper)
        follows = (low < 1) & (high > -1) & ~moves
        slow = Saturation(self.lower, self.upper).describing_function(a, b)
        mean = np.where(moves, b + a * whole, np.where(follows, slow[0], level))
        gain = np.where(moves, wave, np.where(follows, slow[1], 0.0))
        return with_nan(a, b, mean, gain, w)

    def _integrator(self, a: Array, b: Array, w: Array) -> Answer:
        """Mean of the integrator's state, and its fundamental over the amplitude.

        As ``ki e = (v - s) ki/kp`` it follows v with the time constant kp/ki while v is within the limits, and is held
        still while v is beyond one (docs/theory/anti_windup.md).
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            kappa = self.ki / self.kp / w
            low, high = (np.arcsin(np.clip((level - b) / a, -1.0, 1.0)) for level in (self.lower, self.upper))
            arcs = _Arc.of(kappa, low, high), _Arc.of(kappa, np.pi - high, np.pi - low)
            # What is left of the start of an arc at its end, and what the sine adds, over the amplitude and about b.
            rise, fall = (arc.added() for arc in arcs)
            kept = np.exp(-kappa * (high - low))
            # s repeats itself for (E c_up + c_down)/(1 - E^2) (docs/theory/anti_windup.md, Clamping).
            start = (kept * rise + fall) / -np.expm1(-2 * kappa * (high - low))
        level = np.clip(b, self.lower, self.upper)
        never = ~(high - low > 0)
        start = np.where(never, 0.0, start)
        top = np.where(never, 0.0, kept * start + rise)
        whole, wave = (
            one + other + top * held_top + start * held_low
            for one, other, held_top, held_low in zip(
                arcs[0].integrals(start), arcs[1].integrals(top),
                _held(high, np.pi - high), _held(np.pi - low, 2 * np.pi + low), strict=True,
            )
        )  # fmt: skip
        mean = np.where(never, level, b + a * whole.real / (2 * np.pi))
        gain = np.where(never, 0.0, 1j * wave / np.pi)
        return with_nan(a, b, mean, gain, w)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Amplitudes at which v reaches a limit."""
        return distances(self.lower - bias, self.upper - bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Nothing is known: what drives the integrator depends on the error."""
        return -np.inf, np.inf

    def linear_gain(self) -> Array:
        """Gains of the law within the limits."""
        return np.array([[0.0, self.ki, POLE], [1.0, 0.0, 0.0]])

    def automaton(self) -> Automaton:
        """Within the limits, and at either: held, free where the error leads back, and sliding along the limit."""
        build = AutomatonBuilder(n_inputs=3, n_outputs=2)
        integrates, holds, v = [0.0, self.ki, POLE], [0.0, 0.0, POLE], [1.0, 0.0, 0.0]
        none, way = [0.0, 0.0, 0.0], np.sign(self.ki)
        within = build.mode("within the limits", from_input=[integrates, v])
        for side, sign, limit in (("upper", 1.0, self.upper), ("lower", -1.0, self.lower)):
            at = [0.0, limit]
            held = build.mode(f"{side} limit, held", from_input=[holds, none], constant=at)
            free = build.mode(f"{side} limit, integrates", from_input=[integrates, none], constant=at)
            slides = build.mode(
                f"along the {side} limit", from_input=[none, none], constant=at, sticking=True, level=limit, jump=-1.0
            )
            # A limit is entered by sliding along it, which the last two guards end at once unless ds/dt lies between
            # zero and ki e (docs/theory/anti_windup.md, Clamping); a v that has jumped over the limit takes the bypass.
            beyond, back, further = [sign, 0.0, 0.0], [-sign, 0.0, 0.0], [0.0, sign * way, 0.0]
            build.guard(f"reaches {side}", within, slides, on_input=beyond, constant=-sign * limit, bypass=held)
            build.guard(f"returns to {side}", held, slides, on_input=back, constant=sign * limit, bypass=within)
            build.guard(f"returns from {side}", free, within, on_input=back, constant=sign * limit)
            build.guard("error turns back", held, free, on_input=[-f for f in further])
            build.guard("error turns on", free, held, on_input=further)
            # Along the limit the integrator is driven by between nothing and ki e.
            build.guard(f"leaves beyond {side}", slides, held, on_output=[-sign, 0.0], on_input=[0.0, 0.0, sign * POLE])
            build.guard(
                f"leaves {side}", slides, within, on_output=[sign, 0.0], on_input=[0.0, -sign * self.ki, -sign * POLE]
            )
        return build.build(within)


@dataclass(frozen=True)
class _Arc:
    """Phases in which ``ds/dphi = kappa (sin(phi) - s)``: the integrator follows a sine of amplitude one."""

    kappa: Array
    begin: Array
    end: Array
    #: Of the response that is left in the end, ``on_sine sin(phi) - on_cosine cos(phi)``.
    on_sine: Array
    on_cosine: Array

    @classmethod
    def of(cls, kappa: Array, begin: Array, end: Array) -> _Arc:
        """Arc between two phases."""
        # 1/(1 + 1/kappa^2) for quick integrators, of which the square of kappa may have no end.
        quick = kappa > 1
        inverse = 1 / np.where(quick, kappa, 1.0)
        slow = np.where(quick, 1.0, kappa)
        on_cosine = np.where(quick, inverse / (1 + inverse**2), slow / (1 + slow**2))
        on_sine = np.where(quick, 1 / (1 + inverse**2), slow**2 / (1 + slow**2))
        return cls(kappa, begin, end, on_sine, on_cosine)

    def forced(self, phi: Array) -> Array:
        """The response that is left in the end."""
        return self.on_sine * np.sin(phi) - self.on_cosine * np.cos(phi)

    def added(self) -> Array:
        """What s is at the end where it is zero at the begin."""
        middle, half = (self.end + self.begin) / 2, (self.end - self.begin) / 2
        change = 2 * np.sin(half) * (self.on_sine * np.cos(middle) + self.on_cosine * np.sin(middle))
        return change - self.forced(self.begin) * np.expm1(-self.kappa * (self.end - self.begin))

    def integrals(self, start: Array) -> tuple[ComplexArray, ComplexArray]:
        """Integrals of s, and of s times ``exp(-j phi)``, from `start` on."""
        left = start - self.forced(self.begin)
        length = self.end - self.begin
        die = -np.expm1(-self.kappa * length) / self.kappa
        ends = [(self.on_sine * np.cos(phi) + self.on_cosine * np.sin(phi)) for phi in (self.begin, self.end)]
        whole = ends[0] - ends[1] + left * die
        # sin and cos times exp(-j phi): a constant and a wave of twice the frequency.
        twice = (np.exp(-2j * self.begin) - np.exp(-2j * self.end)) / 4j
        sine, cosine = length / 2j - twice / 1j, length / 2 + twice
        rate = self.kappa + 1j
        dies = (np.exp(-1j * self.begin) - np.exp(-self.kappa * length - 1j * self.end)) / rate
        wave = self.on_sine * sine - self.on_cosine * cosine + left * dies
        return np.asarray(whole, complex), np.asarray(wave, complex)


def _held(begin: Array, end: Array) -> tuple[ComplexArray, ComplexArray]:
    """Integrals of one, and of ``exp(-j phi)``."""
    return np.asarray(end - begin, complex), np.asarray((np.exp(-1j * begin) - np.exp(-1j * end)) / 1j, complex)
