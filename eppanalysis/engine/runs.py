"""Runs of hybrid systems from event to event, many at a time, and what they came to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.engine._engine import (
    ALWAYS,
    rounding_of_motion,
    run,
    run_cells,
    spans,
    step_at_start,
    verdict_of_run,
)

__all__ = [
    "ALWAYS",
    "CYCLE",
    "GROWS",
    "SAMPLES",
    "SETTLED",
    "UNDECIDED",
    "Outcome",
    "rounding_of_motion",
    "run",
    "run_cells",
    "spans",
    "step_at_start",
    "verdict_of_run",
]


#: Verdicts.
UNDECIDED, SETTLED, CYCLE, GROWS = 0, 1, 2, 3
#: Samples of a cell's period.
SAMPLES = 512


class Outcome(NamedTuple):
    """Results of cells (leading axis: cell)."""

    code: np.ndarray  # (cells,) int: how the run ended
    verdict: np.ndarray  # (cells,) int
    events: np.ndarray  # (cells,) int
    since: np.ndarray  # (cells,) time of the last event
    period: np.ndarray  # (cells,)
    change: np.ndarray  # (cells, 2): last and extrapolated change of the cycle
    mean: np.ndarray  # (cells, y)
    low: np.ndarray  # (cells, y)
    high: np.ndarray  # (cells, y)
    rms: np.ndarray  # (cells, y): about the mean
    stop: np.ndarray  # (1,) int: set, from another thread, to end before all cells are done
