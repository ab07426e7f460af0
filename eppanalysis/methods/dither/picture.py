"""Picture of a dither: what it leaves of the cycle over its amplitude, and what it makes of the element."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.arrays import Array
from eppanalysis.methods.dither.result import Dither
from eppanalysis.methods.dither.runs import Start
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.plotting import BLUE, GREEN, GREY, ORANGE, VERMILLION, places_of, put_legend

#: How a run from the cycle ended: label, colour, marker.
_ENDS = {
    False: ("run: it stays", VERMILLION, "o"),
    None: ("run: undecided", ORANGE, "s"),
    True: ("run: it is gone", GREEN, "D"),
}


def plot_dither(found: Dither, ax: Axes | None = None) -> Figure:
    """What is left of the cycle over the dither's amplitude, and the element with and without the least dither."""
    figure, (upper, *below) = places_of(ax, 2, height=2.6)
    known = found.predicted
    if known.size:
        upper.plot(known[:, 0], 100.0 * known[:, 1] / found.size, ".:", color="black", markersize=3, label="DF")
    for gone, (label, colour, marker) in _ENDS.items():
        rows = [run for run in found.runs if run.gone is gone and run.start is Start.CYCLE]
        if rows:
            x, y = [run.amplitude for run in rows], [100.0 * run.left for run in rows]
            upper.plot(x, y, marker, color=colour, linestyle="none", markersize=5, clip_on=False, label=label)
    if np.isfinite(found.amplitude):
        upper.axvline(found.amplitude, color=GREY, linewidth=1.0, zorder=0)
    upper.set_xlabel("amplitude of the dither")
    upper.set_ylabel("slow motion\n[% of the cycle]")
    upper.set_ylim(bottom=0.0)
    put_legend(upper)
    for lower in below:
        _characteristic(found, lower)
    return figure


def _characteristic(found: Dither, ax: Axes) -> None:
    """The element and its effective characteristic, over the range of the cycle."""
    x = 0.75 * found.size * np.linspace(-1.0, 1.0, 801)
    for way in (x, x[::-1]):  # an element with memory has two
        label = "without dither" if way is x else None
        ax.plot(way, _along(found.characteristic, way), color=GREY, linewidth=1.0, label=label)
    if np.isfinite(found.amplitude):
        for way in (x, x[::-1]):
            label = f"under a dither of {found.amplitude:.4g}" if way is x else None
            ax.plot(way, _along(found.effective, way), color=BLUE, linewidth=1.6, label=label)
    ax.set_xlabel(f"slow input of {found.element}")
    ax.set_ylabel("mean output")
    ax.grid(True, color="0.9", linewidth=0.6)
    put_legend(ax)


def _along(element: Nonlinearity, x: Array) -> Array:
    """Outputs of an element whose input runs along `x` and has come there from where it is at the begin."""
    _, memory = element.output(x[0])
    outputs = []
    for value in x:
        y, memory = element.output(value, memory)
        outputs.append(float(y))
    return np.array(outputs)
