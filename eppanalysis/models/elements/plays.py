"""A weighted sum of plays side by side: the hysteresis of Prandtl and Ishlinskii, as piezo actuators have it."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import IN, SLOPE, Answer, Nonlinearity
from eppanalysis.models.elements.memory import Play
from eppanalysis.models.elements.phases import broadcast, distances, require_numbers
from eppanalysis.models.elements.static import PiecewiseLinear

#: By how much of their size two plays may miss being nested by rounding.
_ROUNDING = 1e-12


class PrandtlIshlinskii(Nonlinearity, kind="prandtl_ishlinskii"):
    """Hysteresis of Prandtl and Ishlinskii: ``y = straight x`` and a weighted sum of plays of ascending half-widths.

    It remembers the outputs of its plays, without their weights: a list, zeros where none is given. Outputs of
    neighbours differ by no more than their half-widths do, as behind any motion from zero.

    Parameters
    ----------
    half_widths : array_like, shape (n,)
        Of the plays, positive and ascending [unit of the input].
    weights : array_like, shape (n,)
        Of the plays, of any sign [unit of the output per unit of the input].
    straight : float
        Weight of the input itself [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If there is no play, numbers are not finite, half-widths are not positive and ascending, or there is not one
        weight for each.

    Notes
    -----
    While the input rises the plays that move are the narrowest ones, whatever came before: so there is one mode for
    each number of them, in either direction, and one in which all rest. Kuhnen, "Modeling, identification and
    compensation of complex hysteretic nonlinearities", European Journal of Control 9 (2003) 407.

    Examples
    --------
    >>> from eppanalysis.models.elements import PrandtlIshlinskii
    >>> piezo = PrandtlIshlinskii([0.5, 1.0], [0.2, 0.1], straight=1.0)
    >>> y, plays = piezo.output(2.0)
    >>> float(y), plays.tolist()
    (2.4, [1.5, 1.0])
    >>> mean, gain = piezo.describing_function(amplitude=2.0)
    >>> complex(gain.round(4))
    (1.2109-0.0796j)
    """

    linear_gain_is = "the slope at which it follows"
    units = MappingProxyType({"half_widths": IN, "weights": SLOPE, "straight": SLOPE})
    remembers_a_list: ClassVar[bool] = True

    half_widths: Array
    weights: Array
    straight: float

    def __init__(self, half_widths: ArrayLike, weights: ArrayLike, straight: float = 0.0) -> None:
        r, w = (
            floats(v, f"PrandtlIshlinskii: {n}", ndmin=1, copy=True)
            for n, v in (("half_widths", half_widths), ("weights", weights))
        )
        if r.ndim != 1 or not r.size or not np.all(np.isfinite(r)) or not np.all(np.diff(r, prepend=0.0) > 0):
            expected = "positive numbers that ascend, one or more"
            raise ModelError("PrandtlIshlinskii", r.tolist(), expected, field="half_widths")
        if w.shape != r.shape or not np.all(np.isfinite(w)):
            expected = f"{r.size} finite numbers, one for each of half_widths"
            raise ModelError("PrandtlIshlinskii", w.tolist(), expected, field="weights")
        r.flags.writeable = w.flags.writeable = False
        self.half_widths, self.weights, self.straight = r, w, straight
        require_numbers(self, ("straight",))

    def _key(self) -> tuple[Any, ...]:
        return tuple(self.half_widths.tolist()), tuple(self.weights.tolist()), self.straight

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PrandtlIshlinskii) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def __repr__(self) -> str:
        r, w, straight = self._key()
        return f"PrandtlIshlinskii(half_widths={list(r)}, weights={list(w)}, straight={straight!r})"

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Array]:
        """Output, and the plays, shape (..., n), which are the memory."""
        x = floats(x, "output: x")
        stored = np.zeros(self.half_widths.shape) if memory is None else self._nested(memory, x.ndim + 1)
        plays = np.clip(stored, x[..., None] - self.half_widths, x[..., None] + self.half_widths)
        return np.asarray(self.straight * x + plays @ self.weights), plays

    def _nested(self, memory: Any, n_axes: int | None = None) -> Array:
        """Outputs of plays, shape (..., n), as a motion may leave them."""
        plays, r = floats(memory, "PrandtlIshlinskii: memory", ndmin=1), self.half_widths
        if plays.shape[-1:] == r.shape and plays.ndim in (1, n_axes) and np.all(np.isfinite(plays)):
            spare = np.diff(r) - np.abs(np.diff(plays))
            if np.all(spare >= -_ROUNDING * (r[1:] + np.abs(plays[..., 1:]))):
                return plays
        expected = f"{r.size} outputs of its plays, of which neighbours differ by no more than their half-widths do"
        raise ModelError("PrandtlIshlinskii", plays.tolist(), expected, field="memory")

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Sums of mean and gain of the plays: a play up to whose half-width the amplitude goes adds its bias alone.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b, _ = broadcast(amplitude, bias, omega)
        mean, gain = self.straight * b, self.straight + 0j * (a + b)
        for half_width, weight in zip(self.half_widths.tolist(), self.weights.tolist(), strict=True):
            of_play = Play(2 * half_width).describing_function(a, b)
            mean, gain = mean + weight * of_play[0], gain + weight * of_play[1]
        return np.asarray(mean), np.asarray(gain, complex)

    def thresholds(self, bias: float = 0.0) -> Array:
        """The half-widths, about any bias."""
        return distances(*self.half_widths)

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """At rest with the plays that are remembered."""
        return automaton.start_mode, automaton.start_memory.copy() if memory is None else self._nested(memory)

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> tuple[float, ...]:
        """Outputs of the plays: of those that move from the input, of the others as they are stored."""
        moving, way = automata.moving_plays(mode)
        at = np.arange(stored.size) < moving
        return tuple(np.where(at, x[0] - way * self.half_widths, stored).tolist())

    def under_dither(self, amplitude: float) -> Nonlinearity:
        """Plays that are narrower by the dither; what let their input through join the straight part."""
        left = self.half_widths - amplitude
        open_ = left > _ROUNDING * self.half_widths
        straight = float(self.straight + self.weights[~open_].sum())
        if not np.any(open_):
            return PiecewiseLinear((), (straight,), (0.0,))
        return PrandtlIshlinskii(left[open_], self.weights[open_], straight)

    def automaton(self) -> Automaton:
        """All plays rest, and for each number of them they move up or down."""
        return automata.plays(self.half_widths, self.weights, self.straight)
