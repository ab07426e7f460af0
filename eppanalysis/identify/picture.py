"""Pictures of identification: measured points and fit, residuals, and the intervals of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.identify import Identification
from eppanalysis.identify.estimate import BenchFit, Estimate
from eppanalysis.plotting import (
    BLUE,
    DARK_ORANGE,
    GREY,
    SMALL,
    VERMILLION,
    figure_of_height,
    label_up,
    place_of,
    put_legend,
    root_figure,
)
from eppanalysis.readable import readable, with_unit, words
from eppanalysis.units import parse_quantity

#: Points of a curve that is only drawn behind.
_MOST_POINTS = 6000
#: Intervals wider than this share of their value are cut, and say so.
_WIDEST = 60.0


def plot_bench(fit: BenchFit, ax: Axes | None = None) -> Figure:
    """Data with the fit over their abscissa, residuals below, and below all the intervals relative to their values.

    Parameters
    ----------
    ax : matplotlib.axes.Axes, optional
        Where to draw the intervals alone; all of it on a figure of its own by default.
    """
    if ax is not None:
        _draw_intervals(ax, fit.estimates)
        return root_figure(ax)
    panels: Mapping[str, Any] = fit.curves["panels"]
    heights = [1.9, 0.9] * len(panels) + [_height_of(fit.estimates)]
    figure = figure_of_height(0.6 + sum(heights))
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    for i, (role, panel) in enumerate(panels.items()):
        top = figure.add_subplot(grid[2 * i])
        below = figure.add_subplot(grid[2 * i + 1], sharex=top)
        units = [_shown_in(unit, fit.estimates) for unit in panel["units"]]
        _draw_panel(top, below, role, panel, str(fit.curves["x"]), bool(fit.curves.get("line")), units)
        if i == 0:
            put_legend(top)
    _draw_intervals(figure.add_subplot(grid[-1]), fit.estimates)
    return figure


def plot_intervals(found: Identification, ax: Axes | None = None) -> Figure:
    """The intervals of all parameters, relative to their values."""
    figure, ax = place_of(ax, _height_of(found.estimates))
    _draw_intervals(ax, found.estimates)
    return figure


def _height_of(estimates: tuple[Estimate, ...]) -> float:
    """Height of a panel of intervals [inch]: two lines of letters and a bar each."""
    return 0.8 + 0.55 * len(estimates)


def _shown_in(unit: str, estimates: tuple[Estimate, ...]) -> tuple[str, float]:
    """The unit of a column as it is in those of the parameters, and its factor: V/lbf goes with lbf."""
    pounds = any("lbf" in estimate.friendly for estimate in estimates)
    return ("lbf", 1.0 / parse_quantity("1 lbf", "N")) if unit == "N" and pounds else readable(unit)


def _draw_panel(
    top: Axes, below: Axes, role: str, panel: Mapping[str, Any], abscissa: str, line: bool,
    units: Sequence[tuple[str, float]],
) -> None:  # fmt: skip
    (x_unit, x_factor), (unit, factor) = units
    x = x_factor * np.asarray(panel["x"])
    if "behind" in panel:
        times, values = (np.asarray(a) for a in panel["behind"])
        some = slice(None, None, max(1, times.size // _MOST_POINTS))
        top.plot(x_factor * times[some], factor * values[some], color=GREY, linewidth=0.7, label="record")
    style: dict[str, Any] = {"color": BLUE, "markersize": 3.0 if x.size < 500 else 1.2, "linestyle": "none"}
    top.plot(x, factor * np.asarray(panel["y"]), ".", label="measured", zorder=3, **style)
    marks: dict[str, Any] = {"linewidth": 1.0} if line or abscissa == "force" else {"linestyle": "none", "marker": "x"}
    top.plot(x, factor * np.asarray(panel["fit"]), color=VERMILLION, markersize=4, label="fit", **marks)
    below.axhline(0.0, color=GREY, linewidth=0.6)
    below.plot(x, factor * np.asarray(panel["residual"]), ".", **style)
    label_up(top, with_unit(role, unit))
    label_up(below, with_unit("residual", unit), 0.0)
    below.set_xlabel(with_unit(abscissa, x_unit))
    top.tick_params(labelbottom=False)
    for ax in (top, below):
        ax.spines[["top", "right"]].set_visible(False)


def _draw_intervals(ax: Axes, estimates: tuple[Estimate, ...]) -> None:
    """Every interval as a share of its own value, with the numbers beside it."""
    for i, estimate in enumerate(estimates):
        size = abs(estimate.value) or max(abs(estimate.high), abs(estimate.low)) or 1.0
        ends = [100.0 * (e - estimate.value) / size for e in (estimate.low, estimate.high)]
        low, high = (float(np.clip(e, -_WIDEST, _WIDEST)) for e in ends)
        colour = BLUE if estimate.identified else DARK_ORANGE
        ax.plot([low, high], [i, i], color=colour, linewidth=2.2, linestyle="-" if estimate.identified else ":")
        ax.plot([0.0], [i], "o" if estimate.identified else "s", color=colour, markersize=5)
        identified = "" if estimate.identified else ", not identified by these data"
        interval = f"{estimate.text(estimate.low)} to {estimate.text(estimate.high)}{identified}"
        text = f"{words(estimate.name)} = {estimate.text(estimate.value)}\n{interval}"
        ax.annotate(
            text,
            (0.02, i),
            (0, 6),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=SMALL,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        )
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.set_ylim(len(estimates) - 0.5, -0.8)
    ax.set_yticks([])
    ax.set_xlabel("95 % interval about the estimate [% of it]")
    ax.spines[["top", "right", "left"]].set_visible(False)
