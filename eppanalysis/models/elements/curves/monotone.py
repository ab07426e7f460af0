"""A smooth curve through tabulated points that rises and falls only where they do: cubics between them."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder, Smooth
from eppanalysis.models.elements.base import Answer
from eppanalysis.models.elements.curves.table import Tabulated, check_points
from eppanalysis.models.elements.phases import broadcast, distances, with_nan

#: Gauss's rule for the phases between two points, of polynomials of the sixth degree in a sine.
_PLACE, _WEIGHT = np.polynomial.legendre.leggauss(28)
#: Roots whose imaginary part is below this share of their size are real but for rounding.
_REAL = 1e-9
#: Row m, column n: n over m.
_BINOMIAL = np.array([[1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 3.0], [0.0, 0.0, 0.0, 1.0]])


class MonotoneTable(Tabulated, kind="monotone_table"):
    """Monotone cubics through the points of a table: curve and slope are continuous within it, without overshoot.

    Parameters
    ----------
    inputs : array_like, shape (k,)
        At least two, ascending [unit of the input].
    outputs : array_like, shape (k,)
        Output at each of them [unit of the output].
    beyond : {"line", "hold"}
        Beyond the table: "line" goes on with the slope of the end, "hold" with its value, and no slope.

    Raises
    ------
    ModelError
        If there are fewer than two points, numbers are not finite, or inputs do not ascend.

    Notes
    -----
    Slopes at the points are those of Fritsch and Butland, "A method for constructing local monotone piecewise cubic
    interpolants", SIAM J. Sci. Stat. Comput. 5 (1984) 300. The describing function is integrated piece by piece, where
    the integrand is a polynomial in the sine of the phase.

    Examples
    --------
    >>> from eppanalysis.models.elements import MonotoneTable
    >>> valve = MonotoneTable([0.0, 0.2, 1.0], [0.0, 0.0, 5.0], beyond="hold")
    >>> valve.output([-1.0, 0.1, 0.6, 2.0])[0].round(4).tolist()
    [0.0, 0.0, 1.375, 5.0]
    """

    def __init__(self, inputs: ArrayLike, outputs: ArrayLike, beyond: Literal["line", "hold"] = "line") -> None:
        x, y = (
            floats(v, f"MonotoneTable: {n}", ndmin=1, copy=True) for n, v in (("inputs", inputs), ("outputs", outputs))
        )
        check_points("MonotoneTable", x, y, beyond)
        if np.any(np.diff(x) == 0):
            raise ModelError("MonotoneTable", x.tolist(), "ascending numbers", field="inputs")
        x.flags.writeable = y.flags.writeable = False
        self.inputs, self.outputs, self.beyond = x, y, beyond
        #: Where each piece begins, and its cubic in powers of the distance from there.
        self._begin = np.concatenate([x[:1], x])
        self._cubics = _cubics(x, y, beyond == "hold")

    def _key(self) -> tuple[Any, ...]:
        return tuple(self.inputs.tolist()), tuple(self.outputs.tolist()), self.beyond

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MonotoneTable) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        return f"MonotoneTable(inputs={self.inputs.tolist()}, outputs={self.outputs.tolist()}, beyond={self.beyond!r})"

    def _value(self, x: Array, derivative: int = 0) -> Array:
        """The curve, or its slope."""
        piece = np.searchsorted(self.inputs, x, side="right")
        c, u = self._cubics[piece], x - self._begin[piece]
        if derivative:
            return np.asarray(c[..., 1] + u * (2 * c[..., 2] + 3 * u * c[..., 3]))
        return np.asarray(c[..., 0] + u * (c[..., 1] + u * (c[..., 2] + u * c[..., 3])))

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output of the curve for any array `x`; `memory` is handed through unused."""
        x = floats(x, "output: x")
        return np.where(np.isnan(x), np.nan, self._value(x)), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean output and gain (real) for ``x = bias + amplitude * sin(omega t)``, to rounding.

        The gain is 2/pi times the integral of the slope by the squared cosine from trough to peak (by parts), so that
        nothing cancels at small amplitudes.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        away = self.inputs - b[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(a[..., None] > 0, away / a[..., None], np.sign(away))
        # Between the phases at which the input passes a point the integrand is a polynomial in the sine: a bend inside
        # a panel would cost Gauss's rule most of its digits (docs/theory/piecewise_linear.md, Tables).
        edge = np.arcsin(np.clip(ratio, -1.0, 1.0))
        half = np.full((*a.shape, 1), 0.5 * np.pi)
        edge = np.concatenate([-half, edge, half], axis=-1)
        low, width = edge[..., :-1, None], np.diff(edge)[..., None]
        theta = low + 0.5 * width * (1.0 + _PLACE)
        x = b[..., None, None] + a[..., None, None] * np.sin(theta)
        weight = 0.5 * width * _WEIGHT
        mean = (weight * self._value(x)).sum(axis=(-2, -1)) / np.pi
        gain = 2.0 / np.pi * (weight * self._value(x, 1) * np.cos(theta) ** 2).sum(axis=(-2, -1))
        return with_nan(a, b, mean, gain)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Amplitudes at which the oscillation about `bias` reaches one more point of the table."""
        return distances(*(self.inputs - bias))

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope of the curve."""
        c = self._cubics
        with np.errstate(divide="ignore", invalid="ignore"):
            # The slope of a cubic is a parabola: extreme at its vertex, or at the ends of the piece.
            turns = np.nan_to_num(-c[1:-1, 2] / (3.0 * c[1:-1, 3]))
        width = np.diff(self.inputs)
        u = np.array([np.zeros_like(width), width, np.clip(turns, 0.0, width)])
        slopes = c[1:-1, 1] + u * (2 * c[1:-1, 2] + 3 * u * c[1:-1, 3])
        return float(min(slopes.min(), *c[[0, -1], 1])), float(max(slopes.max(), *c[[0, -1], 1]))

    def sector(self) -> tuple[float, float]:
        """Least and greatest ``y/x`` over all x except zero; infinite where the curve misses the origin."""
        rounding = 1e-14 * float(np.abs(self.outputs).max())
        if abs(float(self._value(np.zeros(())))) > rounding:
            return -np.inf, np.inf
        # y/x is extreme at the ends of a piece or where a line through the origin touches it.
        x = np.concatenate([self.inputs, *map(self._tangent, range(1, len(self.inputs)))])
        x = x[np.abs(x) > 1e-9 * np.abs(self.inputs).max()]
        ratios = [
            *(self._value(x) / x).tolist(),
            float(self._value(np.zeros(()), 1)),
            *self._cubics[[0, -1], 1].tolist(),
        ]
        return min(ratios), max(ratios)

    def _tangent(self, piece: int) -> Array:
        """Inputs within a piece at which a line through the origin touches the curve: ``x y' = y``."""
        poly = np.polynomial.polynomial
        begin = self._begin[piece]
        c, x = self._cubics[piece], [begin, 1.0]
        touches = np.trim_zeros(poly.polysub(poly.polymul(x, poly.polyder(c)), c), "b")
        roots = poly.polyroots(touches) + begin if touches.size else np.zeros(0)
        roots = roots.real[np.abs(roots.imag) <= _REAL * np.abs(roots)]
        return np.asarray(roots[(roots > self.inputs[piece - 1]) & (roots < self.inputs[piece])])

    def automaton(self) -> Automaton:
        """One mode a piece, with the square and the cube of the distance from the middle of the table."""
        # About one centre by the binomial formula, so that one square and one cube of the input serve all modes.
        centre = float(0.5 * (self.inputs[0] + self.inputs[-1]))
        powers = np.maximum(np.arange(4) - np.arange(4)[:, None], 0)
        cubics = np.einsum("pn,mn,pmn->pm", self._cubics, _BINOMIAL, (centre - self._begin)[:, None, None] ** powers)
        build = AutomatonBuilder(smooth=tuple(Smooth(kind, np.ones(1), -centre, 1.0) for kind in ("square", "cube")))
        for i, c in enumerate(cubics.tolist()):
            build.mode(f"piece {i + 1}", from_input=c[1], constant=c[0] - c[1] * centre, from_smooth=np.array(c[2:]))
        for i, edge in enumerate(self.inputs.tolist()):
            build.guard(f"up past {edge:.6g}", i, i + 1, on_input=1.0, constant=-edge)
            build.guard(f"down past {edge:.6g}", i + 1, i, on_input=-1.0, constant=edge)
        return build.build(int(np.searchsorted(self.inputs, 0.0, side="right")))


def _cubics(x: Array, y: Array, hold: bool) -> Array:
    """Coefficients of each piece from the constant on, shape (k + 1, 4), first and last those beyond the table."""
    from scipy.interpolate import PchipInterpolator

    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        between = PchipInterpolator(x, y).c[::-1].T
    if not np.all(np.isfinite(between)):
        raise ModelError("MonotoneTable", y.tolist(), "outputs whose slopes are finite", field="outputs")
    ends = np.zeros((2, 4))
    ends[:, 0] = y[[0, -1]]
    if not hold:
        h, last = x[-1] - x[-2], between[-1]
        ends[:, 1] = between[0, 1], last[1] + h * (2 * last[2] + 3 * h * last[3])
    return np.concatenate([ends[:1], between, ends[1:]])
