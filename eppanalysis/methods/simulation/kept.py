"""What is kept of a run: signals, the last events, where it ended; what the codes of the engine mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eppanalysis.results import Status

Array = NDArray[np.float64]

#: By the codes of `kernels/engine/workspace.py` for runs that ended before their time, and of `kernels/verdict.py`.
EARLY = {
    1: Status.EVENT_LIMIT,
    2: Status.DIVERGED,
    3: Status.NOT_CONVERGED,
    4: Status.EVENT_LIMIT,
    5: Status.EVENT_LIMIT,
    6: Status.EVENT_LIMIT,
}
VERDICTS = (Status.UNDECIDED, Status.SETTLED, Status.LIMIT_CYCLE, Status.DIVERGED)


@dataclass(frozen=True, eq=False)
class Run:
    """What one call of the kernel left: signals, event buffer, least and greatest values of the states, end."""

    code: int
    samples: Array
    count: int
    time: Array
    guard: NDArray[np.int64]
    state: Array
    rate: Array
    memory_values: Array
    modes: NDArray[np.int64]
    low: Array
    high: Array
    x_end: Array
    rate_end: Array
    stats: Array

    @property
    def n_kept(self) -> int:
        """Events that the event buffer still holds."""
        return min(self.count, self.time.size)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Places of the kept events in the buffer, oldest first."""
        return np.arange(self.count - self.n_kept, self.count) % max(self.time.size, 1)
