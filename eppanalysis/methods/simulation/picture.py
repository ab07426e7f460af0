"""Picture of a batch of runs: size and period of the cycles on which they end. Computes nothing."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.methods.simulation.batch import BatchResult
from eppanalysis.plotting import BLUE, place_of
from eppanalysis.readable import words
from eppanalysis.results import Status


def plot_batch(batch: BatchResult, ax: Axes | None = None) -> Figure:
    """Peak-to-peak of the first signal over the period, one dot for each cell that ends on a cycle."""
    figure, ax = place_of(ax, 3.4)
    cycling = np.array([status is Status.LIMIT_CYCLE for status in batch.status], bool)
    name = next(iter(batch.peak_to_peak), "")
    sizes = batch.peak_to_peak.get(name, np.zeros(cycling.size))
    ax.plot(batch.period[cycling], sizes[cycling], ".", color=BLUE)
    ax.set_xlabel("period [s]")
    ax.set_ylabel(f"{words(name)} peak to peak, SI units")
    ax.spines[["top", "right"]].set_visible(False)
    return figure
