"""The picture of a bound under tolerances: the bounds of the draws, the nominal one, the worst case."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.methods.bounds.tolerances.result import ToleranceBound
from eppanalysis.plotting import BLUE, SKY, VERMILLION, place_of, put_legend
from eppanalysis.readable import number, with_unit, words


def plot_tolerance(bound: ToleranceBound, ax: Axes | None = None) -> Figure:
    """The bounds of all draws as a histogram, with the nominal bound and the worst case."""
    figure, ax = place_of(ax, 3.4)
    unit, factor = bound.readable
    draws = factor * bound.draws[np.isfinite(bound.draws)]
    if draws.size:
        ax.hist(draws, bins="auto", color=SKY, alpha=0.7, label=f"{draws.size} draws")
    lines = (("nominal", bound.nominal, BLUE, "-"), ("worst case", bound.worst_case, VERMILLION, "--"))
    for text, value, colour, style in lines:
        if np.isfinite(value):
            text = f"{text}: {number(factor * value)} {unit}".rstrip()
            ax.axvline(factor * value, color=colour, linestyle=style, linewidth=1.6, label=text)
    ax.set_xlabel(with_unit(f"bound on {words(bound.limit)}", unit))
    ax.set_ylabel("draws" if draws.size else "")
    if not draws.size:
        ax.set_yticks([])
    ax.spines[["top", "right"]].set_visible(False)
    put_legend(ax)
    return figure
