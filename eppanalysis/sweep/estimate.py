"""What a sweep will cost, from a sample of its cells: core hours, before machines are requested.

The sample is a few short runs of neighbouring cells, spread over the sweep by the golden ratio's multiples. Time is the
processor's, so that other work on the machine does not count.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.readable import count, number

if TYPE_CHECKING:
    from eppanalysis.sweep.work import Work

#: Runs of so many neighbouring cells, until enough time has gone by [s]; neighbours share what a block has to make.
_RUNS, _NEIGHBOURS, _PATIENCE = 16, 64, 2.0
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True)
class Cost:
    """What the cells of a sweep cost."""

    cells: int  # cells that are to be computed
    measured: int  # cells of the sample
    seconds: float  # mean processor time of a cell [s]
    #: least, most: the same of the quickest and of the slowest part of the sample [s].
    least: float
    most: float

    @property
    def core_hours(self) -> float:
        """Processor time of all cells [h]."""
        return self.cells * self.seconds / 3600.0

    def to_dict(self) -> dict[str, float]:
        """Plain numbers, in s and h."""
        return asdict(self) | {"core_hours": self.core_hours}

    def __str__(self) -> str:
        """One sentence."""
        total = self.cells * self.seconds
        size = f"{number(total / 3600.0, 2)} core hours" if total >= 360.0 else f"{number(total, 2)} s of one core"
        spread = f"{number(1e3 * self.least, 2)} to {number(1e3 * self.most, 2)} ms"
        return f"About {size} for {count(self.cells, 'cell')}: {self.measured} of them took {spread} each."


def measure(work: Work, cells: int) -> Cost:
    """Compute a sample of a sweep's cells, and keep nothing but how long it took.

    Parameters
    ----------
    cells : int
        How many are to be computed.
    """
    shape = work.design.shape
    length = min(_NEIGHBOURS if work.batched else 1, shape[-1])
    rows = int(np.prod(shape)) // shape[-1]
    spent: list[float] = []
    for run in range(-1, _RUNS):  # the first one compiles, and counts for nothing
        place = (0.5 + max(run, 0) * _GOLDEN) % 1.0
        start = np.unravel_index(int(place * rows) * shape[-1], shape)
        first = int((place * rows % 1.0) * (shape[-1] - length + 1))
        bounds = [(int(k), int(k) + 1) for k in start[:-1]] + [(first, first + length)]
        begin = time.process_time()
        work.block(bounds)
        if run >= 0:
            spent.append((time.process_time() - begin) / length)
        if sum(spent) * length > _PATIENCE:
            break
    return Cost(cells, len(spent) * length, float(np.mean(spent)), min(spent), max(spent))
