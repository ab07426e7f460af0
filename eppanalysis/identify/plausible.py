"""Whether a record can be the response that it is fitted with: it may not move, or by another size than any such case.

A fit always ends somewhere: in noise alone it ends where the model does not move either, with friction that holds it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.identify.response import Channel, Response
from eppanalysis.readable import quantity

#: Blocks into which a record is cut, and how much more than noise their means must vary to show a motion: the square of
#: a mean of noise varies by a third of itself over so many blocks, and passes this once in more than a million records.
_BLOCKS, _MOTION = 20, 4.0
#: How many times larger or smaller than those of all candidates a measured motion may be.
_SIZES = 4.0
#: Factors by which units are mistaken for one another, and how near a ratio comes to one of them.
_DEGREE, _POUND = math.pi / 180.0, 4.4482216152605
_MISTAKEN = {
    "rad": {1.0 / _DEGREE: "degrees taken for radians", _DEGREE: "radians taken for degrees"},
    "N": {_POUND: "newtons taken for pounds", 1.0 / _POUND: "pounds taken for newtons"},
}
_NEAR = 1.6
#: Least share of a motion that a fit must explain for it to be a fit of that motion.
LEAST_SHARE = 0.5


def moves(channel: Channel) -> bool:
    """Whether a column holds more than its noise, beside zero and drift.

    Means over blocks of rows are compared with what means of so many rows of noise would vary by.
    """
    x = _without_drift(channel, channel.data)
    blocks = [block.mean() for block in np.array_split(x, min(_BLOCKS, max(len(x) // 4, 2)))]
    return float(np.var(blocks, ddof=1)) > _MOTION * channel.noise**2 * len(blocks) / len(x)


def explained(channel: Channel, left: Array) -> float:
    """Share of the variance of a column, beside zero and drift, that a fit explains.

    Parameters
    ----------
    left : array, shape (n,)
        What the fit leaves.
    """
    power = float(np.sum(_without_drift(channel, channel.data) ** 2))
    return 1.0 - float(np.sum(left[channel.live] ** 2)) / power if power else 0.0


def refuse_what_is_no_response(response: Response, candidates: Sequence[dict[str, Array]], source: str) -> None:
    """Refuse a column that does not move where all candidates do, or by another size than any of them.

    Parameters
    ----------
    candidates : sequence of dict of str to array
        Signals of the case and of others about it, by role.
    source : str
        What messages call the record.

    Raises
    ------
    EppError
        If there is one.
    """
    still = [channel for channel in response.channels if not moves(channel)]
    for channel in response.channels:
        sizes = [_size(channel, signals[channel.role]) for signals in candidates]
        usual, size = float(np.median(sizes)), _size(channel, channel.data)
        # A noisy column beside others may hide its motion; where no column shows any there is nothing to fit.
        if channel in still and (max(sizes) > channel.noise or len(still) == len(response.channels)):
            raise EppError(
                f"{source}: its {channel.role} is noise alone ({_text(channel, channel.noise)}) where that of the case "
                f"moves by {_text(channel, usual)}; expected the response to the step."
            )
        if channel not in still and not min(sizes) / _SIZES <= size <= _SIZES * max(sizes):
            raise EppError(
                f"{source}: its {channel.role} moves {size / usual:.3g} times as far as that of the case "
                f"({_text(channel, size)} against {_text(channel, usual)}, root mean square)"
                f"{mistaken(channel.unit, size / usual)}; expected the same units and the same step."
            )


def _without_drift(channel: Channel, values: Array) -> Array:
    basis = np.linalg.qr(channel.nuisance[channel.live])[0]
    x = values[channel.live]
    return x - basis @ (basis.T @ x)


def _size(channel: Channel, values: Array) -> float:
    """Root mean square of a motion about its mean."""
    return float(np.std(values[channel.live]))


def _text(channel: Channel, value: float) -> str:
    return quantity(value, channel.unit, 3)


def mistaken(unit: str, ratio: float) -> str:
    """Which units may have been mistaken for one another where a column in `unit` is so many times what it should be.

    Examples
    --------
    >>> mistaken("rad", 55.0), mistaken("rad", 2.0)
    (', as with degrees taken for radians', '')
    """
    found = [
        what for factor, what in _MISTAKEN.get(unit, {}).items() if abs(math.log(ratio / factor)) < math.log(_NEAR)
    ]
    return f", as with {found[0]}" if found else ""
