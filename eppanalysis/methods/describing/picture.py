"""The Nyquist plot of a loop that is cut at one element, the others frozen. Computes nothing."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.methods.describing.frozen import FrozenLoop
from eppanalysis.plotting import GREEN, draw_nyquist, place_of, put_legend


def plot_frozen(loop: FrozenLoop, ax: Axes | None = None) -> Figure:
    """G(j omega) of the rest of the loop, -1/N of the element at the cut, and the motion that the rest is frozen at."""
    figure, ax = place_of(ax, 4.2)
    meets = [] if loop.point is None else [loop.point]
    draw_nyquist(ax, loop.response, loop.locus, meets)
    mark: dict[str, Any] = {"mfc": "none", "mec": GREEN, "mew": 1.8, "markersize": 9, "linestyle": "none"}
    for point in meets:
        ax.plot([point.real], [point.imag], marker="o", label="the cycle", zorder=5, **mark)
    put_legend(ax)
    return figure
