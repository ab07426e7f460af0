"""The loop of a measured linear part and one element, and what stands for it where methods take a loop.

The methods ask a loop for its frequency response, for the balance of its means and for its named signals. All three are
known without a state: the first is measured, the second is the static gain.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import checked_class, floats
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.models.systems.signals import SignalMap

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Amplitudes, over the spread of an element's thresholds, at which it is asked for a mean of its own.
_AMPLITUDES = np.geomspace(1e-2, 1e3, 60)
#: Nodes a decade of a response that is a smooth curve.
_PER_DECADE = 60


@checked_class
@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """A measured linear part G closed by one element: ``x = feedback * G y``, ``y = element(x)``.

    The signals are "x", the element's input, and "y", its output. It has no states: what needs them takes the loop of
    a rational model of the data.

    Parameters
    ----------
    response : MeasuredResponse
    element : Nonlinearity
        With one input and one output, and no states of its own.
    feedback : {-1, 1}
        Sign of the feedback.
    name : str

    Raises
    ------
    ModelError
        If the element has several inputs or outputs or states of its own, `feedback` is neither -1 nor 1, or the
        element makes a mean of a sine without one and the static gain, which then counts, is not given.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> s = 1j * np.geomspace(0.1, 100.0, 301)
    >>> response = epp.MeasuredResponse(s.imag, 1.0 / (s * (s + 1.0) * (s + 2.0)))
    >>> for cycle in epp.predict_limit_cycles(epp.MeasuredLoop(response, epp.Relay())):
    ...     print(f"amplitude {cycle.amplitude('x'):.4f}, {cycle.omega:.4f} rad/s")
    amplitude 0.2122, 1.4142 rad/s
    """

    response: MeasuredResponse
    element: Nonlinearity
    feedback: int = -1
    name: str = "measured loop"

    def __post_init__(self) -> None:
        e = self.element
        if e.n_inputs != 1 or e.n_outputs != 1 or e.own_states is not None or e.of_frequency:
            what = f"{self.name}: {type(e).__name__} has several inputs or outputs, or states of its own"
            raise ModelError(what, expected="an element with one of each and none, or a rational model of the data")
        if self.feedback not in (-1, 1):
            raise ModelError(self.name, self.feedback, "-1 or 1", field="feedback")
        if self.response.static_gain is None and _makes_a_mean(e):
            raise ModelError(
                f"{self.name}: {type(e).__name__} makes a mean of an oscillation without one, and the data have no "
                "static gain, with which it comes round",
                expected="static_gain of the response, infinite where it integrates",
            )

    def to_system(self) -> DataSystem:
        """What stands for it in methods that need no states."""
        gain = self.response.static_gain
        straight = 0.0 if gain is None or np.isinf(gain) else self.feedback * gain
        # Two integrators in a row: a mean of the output has nowhere to stay, and nothing passes at once. Which they are
        # is not seen: their response is never asked for.
        n = 2 if gain is not None and np.isinf(gain) else 0
        A, B, C = np.eye(n, k=1), np.zeros((n, 1)), np.zeros((1, n))
        B[-1:], C[:, :1] = 1.0, self.feedback
        D = np.array([[straight]])
        signals = SignalMap(
            ("x", "y"),
            np.vstack([C, np.zeros((1, n))]),
            np.array([[straight], [1.0]]),
            np.zeros((2, 0)),
            np.zeros(2),
            ("", ""),
        )
        plain = LureSystem.build(A, B, C, [self.element], D=D, signals=signals, name=self.name)
        values = {f.name: getattr(plain, f.name) for f in fields(LureSystem)}
        return DataSystem(**values, response=self.response, feedback=self.feedback)


def _makes_a_mean(element: Nonlinearity) -> bool:
    """Whether an element makes a mean of a sine that has none."""
    levels = np.abs(np.asarray(element.thresholds(), float)).ravel()
    levels = levels[levels > 0]
    a = (float(levels.max()) if levels.size else 1.0) * _AMPLITUDES
    with np.errstate(all="ignore"):
        mean, gain = element.describing_function(a, 0.0)
    size = np.abs(gain) * a
    known = np.isfinite(mean) & np.isfinite(size)
    return bool(np.any(np.abs(mean[known]) > 1e-9 * np.max(size[known], initial=0.0)))


@dataclass(frozen=True, eq=False)
class DataSystem(LureSystem):
    """A loop whose responses are measured; its matrices say what means do, and nothing else.

    Attributes
    ----------
    response : MeasuredResponse
    feedback : int
    """

    response: MeasuredResponse | None = None
    feedback: int = -1

    @property
    def data(self) -> MeasuredResponse:
        """The measured response."""
        assert self.response is not None
        return self.response

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies [rad/s] between which responses are known."""
        return self.data.band

    def highest_harmonic(self, omega: float) -> int:
        """Highest harmonic of a frequency [rad/s] within the data."""
        return max(1, int(self.band[1] / omega * (1.0 + 1e-9)))

    def frequency_nodes(self) -> Array:
        """Ascending frequencies [rad/s] between which nothing happens that the data show."""
        low, high = self.band
        even = np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 2)
        own = self.data.curve.log_omega
        nodes = np.exp(np.concatenate([own[1:-1], 0.5 * (own[1:] + own[:-1])]))
        nodes = np.concatenate([even, nodes])
        return np.unique(np.concatenate([[low], nodes[(nodes > low) & (nodes < high)], [high]]))

    def frequency_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the element's output to its input, shape (..., 1, 1); not a number outside the data."""
        return self.frequency_response_and_slope(omega)[0]

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`frequency_response` and its derivative by `omega`."""
        G, dG = self.data.with_slope(floats(omega, "frequency_response: omega"))
        return self.feedback * G[..., None, None], self.feedback * dG[..., None, None]

    def signal_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the element's output to "x" and "y", shape (..., 2, 1)."""
        G = self.frequency_response(omega)
        return np.concatenate([G, np.ones_like(G)], axis=-2)

    def state_response(self, omega: ArrayLike) -> ComplexArray:
        """Nothing: there are no states."""
        return np.zeros((*np.shape(omega), len(self.A), 1), complex)
