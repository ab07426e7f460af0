"""Strokes of a motion that goes up and down, and the quasi-static friction loop of a pulley over them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eppanalysis.arrays import Array


@dataclass(frozen=True)
class Stroke:
    """Samples ``first`` to ``last`` (excluded) in which a signal moves in one direction, +1 or -1."""

    first: int
    last: int
    direction: int


def strokes(signal: Array, threshold: float) -> tuple[Stroke, ...]:
    """Pieces of a signal between turning points; a turn counts once the signal has come back by `threshold`.

    Parameters
    ----------
    signal : array, shape (n,)
    threshold : float
        Smaller movements are noise.

    Examples
    --------
    >>> [
    ...     (s.first, s.last, s.direction)
    ...     for s in strokes(np.array([0.0, 1.0, 2.0, 1.9, 3.0, 1.0, 0.0]), 0.5)
    ... ]
    [(0, 5, 1), (5, 7, -1)]
    """
    found: list[Stroke] = []
    begin, direction = 0, 0
    low = high = 0  # places of the extremes since the last turn
    for i, value in enumerate(signal.tolist()):
        if value > signal[high]:
            high = i
        if value < signal[low]:
            low = i
        if direction >= 0 and signal[high] - value > threshold:
            if high > begin or direction > 0:
                found.append(Stroke(begin, high + 1, 1))
            begin, direction, low = high + 1 if found else 0, -1, i
        elif direction <= 0 and value - signal[low] > threshold:
            if low > begin or direction < 0:
                found.append(Stroke(begin, low + 1, -1))
            begin, direction, high = low + 1 if found else 0, 1, i
    if begin < len(signal) and direction:
        found.append(Stroke(begin, len(signal), direction))
    return tuple(found)


@dataclass(frozen=True)
class Pulley:
    """Force at the sensor over the load (a force, or a stretch) where a pulley with friction slides and breaks away."""

    #: rises, falls: while it slides with rising and with falling load.
    rises: float
    falls: float
    #: breaks_up, breaks_down: where it breaks away upward and downward.
    breaks_up: float
    breaks_down: float

    @classmethod
    def of_force(cls, static: float, kinetic: float) -> Pulley:
        """For a force applied in front of the pulley; arguments are inverse hyperbolic tangents of friction per load.

        While it slides the tensions differ by ``F - F_f = ±tanh(kinetic) (F + F_f)``, so their logarithms by twice
        `kinetic`; it breaks away where they differ by twice `static`.
        """
        slide, leave = math.exp(2.0 * kinetic), math.exp(2.0 * static)
        return cls(1.0 / slide, slide, 1.0 / leave, leave)


def sensor_force(load: Array, pieces: tuple[Stroke, ...], pulley: Pulley) -> Array:
    """Force behind a pulley with friction, for a load that changes slowly; the first stroke begins sliding.

    Parameters
    ----------
    load : array, shape (n,)
        Not negative.
    pieces : tuple of Stroke
        Of the load.

    Returns
    -------
    array, shape (n,)

    Examples
    --------
    >>> load = np.array([0.0, 1.0, 2.0, 1.8, 1.0, 0.0])
    >>> sensor_force(load, strokes(load, 0.1), Pulley(0.9, 1.1, 0.9, 1.1)).tolist()
    [0.0, 0.9, 1.8, 1.8, 1.1, 0.0]
    """
    out = np.empty_like(load)
    held: float | None = None
    for piece in pieces:
        loads = load[piece.first : piece.last]
        if piece.direction > 0:
            # Small reverses within a stroke are noise: the pulley does not follow them.
            loads = np.maximum.accumulate(loads)
            line = loads * pulley.rises
            moves = np.ones(loads.size, bool) if held is None else loads * pulley.breaks_up > held
        else:
            loads = np.minimum.accumulate(loads)
            line = loads * pulley.falls
            moves = np.ones(loads.size, bool) if held is None else loads * pulley.breaks_down < held
        out[piece.first : piece.last] = line if held is None else np.where(moves, line, held)
        held = float(out[piece.last - 1])
    return out
