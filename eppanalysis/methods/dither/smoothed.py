"""What an element is to slow signals while a fast dither rides on its input.

While the dither runs through a period, a slow input hardly moves. Of an element without memory the loop then feels the
mean over the dither, ``F(x) = mean of f(x + d)``; its describing function is the mean of the element's own over the
bias ``d``, for the two means may be taken in either order (docs/theory/dither.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, ComplexArray, IntArray
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import Automaton, switching_levels
from eppanalysis.models.elements.base import Nonlinearity, automaton_of
from eppanalysis.models.elements.phases import broadcast

Wave = Literal["sine", "triangle"]

#: Gauss's rule on each panel, in a variable that makes roots at the ends of the panel smooth.
_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(28)
_BENT, _BENT_WEIGHT = np.sin(0.5 * np.pi * _PLACE), 0.5 * np.pi * np.cos(0.5 * np.pi * _PLACE) * _WEIGHT
#: Amplitudes smaller than this share of the dither have the gain of this share: beneath it rounding takes over.
_SMALLEST = 1e-6
#: Difference of a panel from its halves, relative to the largest value, that is none; most halvings, and doublings.
_AGREES, _MOST_HALVINGS, _MOST_DOUBLINGS = 1e-12, 40, 50.0
#: Points that are evaluated at once.
_AT_ONCE = 20_000


@dataclass(frozen=True, eq=False)
class Smoothed(Nonlinearity):
    """An element without memory under a fast dither, as slow signals find it; made by :func:`smoothed`.

    Attributes
    ----------
    element : Nonlinearity
    dither : float
        Amplitude of the dither, in the unit of the input.
    wave : {"sine", "triangle"}
    """

    element: Nonlinearity
    dither: float
    wave: Wave

    @property
    def breakpoints(self) -> Array:  # type: ignore[override]
        """Where the dither begins and ceases to reach a breakpoint of the element."""
        edges = self.element.breakpoints
        return np.unique(np.concatenate([edges - self.dither, edges + self.dither]))

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Mean output over the dither about the slow input `x`."""
        x = floats(x, "output: x")
        means = self._means(lambda b, i: np.asarray(self.element.output(b)[0])[None], x.ravel(), np.zeros(x.size))
        return means[0].reshape(x.shape), memory

    def describing_function(
        self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0
    ) -> tuple[Array, ComplexArray]:
        """Mean and gain of the slow sine ``bias + amplitude * sin(omega t)``: its equivalent describing function."""
        a, b, _ = broadcast(amplitude, bias, omega)
        sizes = np.maximum(a.ravel(), _SMALLEST * self.dither)

        def of(biases: Array, i: IntArray) -> Array:
            mean, gain = self.element.describing_function(sizes[i], biases)
            return np.array([mean, gain.real])

        mean, gain = self._means(of, b.ravel(), sizes)
        return mean.reshape(a.shape), gain.reshape(a.shape).astype(complex)

    def slope_bounds(self) -> tuple[float, float]:
        """Those of the element: what is a mean of its slopes lies between them."""
        return self.element.slope_bounds()

    def thresholds(self, bias: float = 0.0) -> Array:
        """Amplitudes at which a slow sine and the dither reach one more breakpoint together, and the dither's own."""
        sizes = np.unique(np.abs(np.append(self.breakpoints - bias, self.dither)))
        return sizes[sizes > 0]

    def automaton(self) -> Automaton:
        """None: a run has the element itself, and the dither as its input."""
        raise ModelError("A smoothed element has no automaton", expected="the element itself, with the dither as input")

    def _means(self, of: Any, x: Array, reach: Array) -> Array:
        """Means over the dither of what has its corners where ``x + dither`` is `reach` beside an edge."""
        step = max(1, _AT_ONCE // (_PLACE.size * (4 * self._edges.size + 1)))
        parts = [self._some_means(of, x[k : k + step], reach[k : k + step], k) for k in range(0, x.size, step)]
        return np.concatenate(parts, axis=1) if parts else np.zeros((2, 0))

    @cached_property
    def _edges(self) -> Array:
        """Inputs at which panels end: where the element bends or jumps, and about where a smooth one is steep.

        Of one that is linear between its breakpoints these are all. Others switch where their guards and what sticks
        say; what is smooth changes within the order of one of its argument, and farther off more and more slowly.
        """
        if self.element.breakpoints.size or isinstance(self.element, Smoothed):
            return self.element.breakpoints
        automaton = automaton_of(self.element)
        modes, found = automaton.mode_columns, [switching_levels(automaton)]
        found.append(modes["level"][modes["sticking"]])
        for smooth in automaton.smooth:
            if steep := abs(float(smooth.on_input[0])):
                doublings = np.arange(-1.0, np.clip(np.log2(4.0 * self.dither * steep), 0.0, _MOST_DOUBLINGS))
                wide = np.concatenate([[0.0], 2.0**doublings, -(2.0**doublings)])
                found.append(wide / steep - smooth.constant / float(smooth.on_input[0]))
        return np.unique(np.concatenate(found))

    def _some_means(self, of: Any, x: Array, reach: Array, first: int) -> Array:
        edges = self._edges
        corners = np.concatenate([edges - x[:, None] - reach[:, None], edges - x[:, None] + reach[:, None]], axis=1)
        # Panels end where an edge comes within reach, in a variable in which the dither's density is even: of a
        # sine its arcsine (docs/theory/dither.md, The equivalent describing function).
        share = np.clip(corners / self.dither, -1.0, 1.0)
        place = np.arcsin(share) if self.wave == "sine" else share
        end = np.full((x.size, 1), 0.5 * np.pi if self.wave == "sine" else 1.0)
        place = np.sort(np.concatenate([-end, place, end], axis=1), axis=1)
        rows, panels = np.nonzero(np.diff(place, axis=1) > 0.0)
        low, high = place[rows, panels], place[rows, panels + 1]

        def summed(rows: IntArray, low: Array, high: Array) -> tuple[Array, Array]:
            half = 0.5 * (high - low)[:, None]
            at, weight = low[:, None] + half * (1.0 + _BENT), half * _BENT_WEIGHT / (2.0 * end[0, 0])
            dither = self.dither * (np.sin(at) if self.wave == "sine" else at)
            values = of((x[rows, None] + dither).ravel(), np.repeat(rows + first, _PLACE.size))
            values = values.reshape(len(values), *at.shape)
            return np.sum(values * weight, axis=-1), np.abs(values).max(-1)

        sums, sizes = summed(rows, low, high)
        if self.element.breakpoints.size:
            return np.array([np.bincount(rows, row, x.size) for row in sums])
        # What is not linear between edges is halved until two halves give what the whole gives.
        means, largest = np.zeros((len(sums), x.size)), np.zeros((len(sums), x.size))
        for depth in range(_MOST_HALVINGS + 1):
            for row, size in zip(largest, sizes, strict=True):
                np.maximum.at(row, rows, size)
            middle = 0.5 * (low + high)
            left, right = summed(rows, low, middle), summed(rows, middle, high)
            both = left[0] + right[0]
            fine = np.all(np.abs(both - sums) <= _AGREES * largest[:, rows], axis=0) | (depth == _MOST_HALVINGS)
            means += np.array([np.bincount(rows[fine], row, x.size) for row in both[:, fine]])
            if np.all(fine):
                break
            rows = np.tile(rows[~fine], 2)
            low, high = np.append(low[~fine], middle[~fine]), np.append(middle[~fine], high[~fine])
            sums, sizes = (np.hstack([part[:, ~fine] for part in parts]) for parts in zip(left, right, strict=True))
        return means


def smoothed(element: Nonlinearity, amplitude: float, wave: Wave = "sine") -> Nonlinearity:
    """What an element is to slow signals while a fast dither rides on its input: its effective characteristic.

    Its `output` is the mean over the dither, its `describing_function` the equivalent one of a slow sine; both are
    means of the element's own, exact to quadrature (1e-9 of their size). It is the limit of an infinitely fast
    dither.

    Parameters
    ----------
    element : Nonlinearity
        Without memory, with one input and one output; or a play, of which the dither takes its own width.
    amplitude : float
        Of the dither, in the unit of the element's input; positive.
    wave : {"sine", "triangle"}
        Form of the dither.

    Returns
    -------
    Nonlinearity
        It has no automaton, so that it serves describing functions alone (but for a play, of which a narrower one is
        left, or none).

    Raises
    ------
    ModelError
        If the amplitude is not positive, or the element has several inputs, or memory other than that of a play.

    References
    ----------
    Gelb and Vander Velde, "Multiple-Input Describing Functions", 1968, chapter 6 (dual-input describing functions,
    dither); Zames and Shneydor, "Structural stabilization and quenching by dither in nonlinear systems", 1977.

    Examples
    --------
    A triangle makes a saturation of a relay, of slope 1/amplitude:

    >>> import eppanalysis as epp
    >>> valve = epp.smoothed(epp.Relay(), 0.5, "triangle")
    >>> valve.output([-1.0, 0.1, 0.25])[0].round(12).tolist()
    [-1.0, 0.2, 0.5]
    >>> epp.smoothed(epp.Play(gap=1.0), 0.2)
    Play(gap=0.6)
    """
    if not (np.isfinite(amplitude) and amplitude > 0):
        raise ModelError("smoothed: amplitude", amplitude, "a positive number")
    left = element.under_dither(amplitude)
    if left is not None:
        return left
    if not (element.is_single and element.n_inputs == 1 and element._isstatic()):
        raise ModelError(
            f"smoothed: {type(element).__name__} has memory, or several inputs",
            expected="an element without memory, or a play; for others a run shows what dither does (simulate)",
        )
    return Smoothed(element, float(amplitude), wave)
