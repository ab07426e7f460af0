"""Limited rates: the ideal rate limiter, and the servo whose rate is limited.

Each brings one linear state, its output y, which the law inside it drives by the error ``u - y``: a relay, which slides
along zero error where the limiter follows its input, or a saturation. That law is what is in the loop; what is said
here, from u to y, is what the element does, and the DF takes it for: the answer to a sine, not the law's answer to
an error that would be one.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.engine.describing import describe_rate_limit, describe_rate_limit_inside
from eppanalysis.models.elements.base import (
    OUT_PER_TIME,
    PER_TIME,
    Answer,
    ClosedForm,
    Nonlinearity,
    OwnStates,
    RateLimit,
)
from eppanalysis.models.elements.dynamic.state import StateOutput, lag
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.phases import POSITIVE, broadcast, broadcast_with_frequency, require_numbers
from eppanalysis.models.elements.piecewise import UNITY, PiecewiseLinear

#: Times a sine's fastest slope over the limit, and its frequency over the bandwidth, beyond which nothing passes.
_TOO_FAST = 1e100


@dataclass(frozen=True)
class _Chasing(PiecewiseLinear):
    """From the error of a limiter to the rate of its output: a saturation, or a relay where the bandwidth is infinite.

    Its describing function is not that of an error which is a sine, but of the one that a sine at the limiter's input
    makes, for its fundamental: with the output's state about it, it balances where the limiter's own does.
    """

    of_frequency: ClassVar[bool] = True

    rate: float
    bandwidth: float = np.inf

    def __post_init__(self) -> None:
        if np.isinf(self.bandwidth):
            self._set_pieces([0.0], [0.0, 0.0], [-self.rate, self.rate])
            return
        edge = self.rate / self.bandwidth
        self._set_pieces([-edge, edge], [0.0, self.bandwidth, 0.0], [-self.rate, 0.0, self.rate])

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean of the law alone, which a periodic motion has only without a bias, and gain without one."""
        a, _, w = broadcast(amplitude, bias, omega)
        mean, _ = super().describing_function(amplitude, bias, omega)
        # The loop filters the input and not the error, so the sine is the one at the limiter's input that makes an
        # error of this size (docs/theory/rate_limit.md, What is taken for the element).
        error, kappa = (a * w / self.rate).flatten(), (self.bandwidth / w).flatten()
        gain = np.empty(error.size, complex)
        describe_rate_limit_inside(error, kappa, gain)
        return mean, np.asarray(w * gain.reshape(a.shape))

    @property
    def closed_form(self) -> ClosedForm:
        """The pieces of the law, for its mean, and the limit, for its gain."""
        return self._map._replace(limit=RateLimit(self.rate, self.bandwidth))


class _RateLimited(StateOutput):
    """What the two share: a state that chases the input, and what a sine makes of it."""

    same_unit = True
    rate: float

    def _set_chase(self, bandwidth: float, small_signal: Nonlinearity) -> None:
        """Store the state, what drives it and what the element is below its limit."""
        C, D = np.array([[-1.0], [1.0]]), np.array([[1.0, 0.0], [0.0, 0.0]])
        state = OwnStates(np.zeros((1, 1)), np.array([[0.0, 1.0]]), C, D)
        self._set_parts(state, _Chasing(self.rate, bandwidth), small_signal)
        object.__setattr__(self, "rate_limit", RateLimit(self.rate, bandwidth))

    def output(self, x: Any, memory: Any = None) -> tuple[Array, Array]:
        """Output for an input `x` that is approached slowly: x itself."""
        y = floats(x, "output: x")
        return y, y

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean (the bias) and gain; exact, with the phases at which the ramps begin and end, which are roots.

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            alpha, kappa = a * w / self.rate, np.where(w > 0, self._chasing.bandwidth / w, w + np.inf)
        gain = np.empty(alpha.size, complex)
        # Where squares would leave the range of numbers nothing of the sine is left.
        still = (alpha > _TOO_FAST) | (kappa < 1.0 / _TOO_FAST)
        alpha, kappa = np.where(still, 0.0, alpha), np.where(still, 1.0, kappa)
        describe_rate_limit(alpha.flatten(), kappa.flatten(), gain)
        undefined = np.isnan(a) | np.isnan(b)
        return np.where(undefined, np.nan, b), np.where(undefined, np.nan, np.where(still, 0.0, gain.reshape(a.shape)))

    def thresholds(self, bias: float = 0.0) -> Array:
        """No amplitudes: where the form changes depends on the frequency."""
        return np.zeros(0)

    def linear_gain(self) -> Array:
        """One, below the limit."""
        return np.ones((1, 1))

    @property
    def _chasing(self) -> _Chasing:
        assert isinstance(self.inside, _Chasing)
        return self.inside


@dataclass(frozen=True)
class RateLimiter(_RateLimited, kind="rate_limiter"):
    """Ideal rate limiter: the output follows the input, but no faster than `rate`.

    It begins at its memory, which is zero where none is given.

    Parameters
    ----------
    rate : float
        Greatest rate of the output, either way [unit of the output per s], positive.

    Raises
    ------
    ModelError
        If the rate is not a positive number.

    Examples
    --------
    >>> import numpy as np
    >>> from eppanalysis.models.elements import RateLimiter
    >>> mean, gain = RateLimiter(rate=1.0).describing_function(
    ...     amplitude=[1.0, 1.5, 3.0], omega=1.0
    ... )
    >>> abs(gain).round(5).tolist(), abs(np.angle(gain)).round(5).tolist()
    ([1.0, 0.83836, 0.42441], [0.0, 0.276, 1.01973])
    """

    units = MappingProxyType({"rate": OUT_PER_TIME})

    rate: float

    def __post_init__(self) -> None:
        require_numbers(self, rate=POSITIVE)
        self._set_chase(np.inf, UNITY)


@dataclass(frozen=True)
class RateLimitedServo(_RateLimited, kind="rate_limited_servo"):
    """First-order servo whose rate is limited: ``dy/dt = clip(bandwidth (u - y), -rate, rate)``.

    It begins at its memory, which is zero where none is given.

    Parameters
    ----------
    bandwidth : float
        Bandwidth of the servo [rad/s], positive.
    rate : float
        Greatest rate of the output, either way [unit of the output per s], positive.

    Raises
    ------
    ModelError
        If a field is not a positive number.

    Examples
    --------
    >>> from eppanalysis.models.elements import RateLimitedServo
    >>> mean, gain = RateLimitedServo(bandwidth=10.0, rate=1.0).describing_function(
    ...     amplitude=[0.5, 2.0], omega=2.0
    ... )
    >>> gain.round(4).tolist()
    [(0.9615-0.1923j), (0.1221-0.2938j)]
    """

    units = MappingProxyType({"bandwidth": PER_TIME, "rate": OUT_PER_TIME})

    bandwidth: float
    rate: float

    def __post_init__(self) -> None:
        require_numbers(self, bandwidth=POSITIVE, rate=POSITIVE)
        self._set_chase(self.bandwidth, AutomatonElement(UNITY.automaton(), lag(self.bandwidth, self.bandwidth)))
