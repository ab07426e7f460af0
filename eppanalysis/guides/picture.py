"""Picture of a guideline: where a design is safe, by gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.errors import EppError
from eppanalysis.guides.guideline import Guide, GuideRow
from eppanalysis.plotting import BLUE, GREEN, GREY, ORANGE, VERMILLION, root_figure, with_name
from eppanalysis.readable import with_unit, words

_GAIN, _LIMIT = "bands.range", "lock_pin.backlash"
#: Regions of a design from below, told apart by their hatching as well as by colour.
_REGIONS = (
    ("free of limit cycles", GREEN, ""),
    ("guarded by an unstable cycle", ORANGE, "//"),
    ("oscillates from rest", VERMILLION, "xx"),
)


def plot_regions(guide: Guide, given: Axes | None = None) -> Figure:
    """Backlash over the gain in three regions: free of cycles, guarded by an unstable cycle, oscillating from rest.

    One panel a variant; filled circles are bounds that were verified.

    Parameters
    ----------
    guide : Guide
    given : matplotlib.axes.Axes, optional
        Where to draw the first variant alone; all of them on a figure of its own by default.

    Raises
    ------
    EppError
        If no row has a bound.
    """
    groups: dict[tuple[float, ...], list[GuideRow]] = {}
    for row in guide.rows:
        groups.setdefault(tuple(row.values[name] for name in guide.varied), []).append(row)
    if not any(np.isfinite(row.cell.bound) for row in guide.rows):
        raise EppError(f"{guide.case.name}: no bound was found, so there is nothing to draw.")
    if given is not None:
        _draw_regions(given, guide, next(iter(groups.values())))
        given.legend(fontsize=7)
        return root_figure(given)
    columns = min(len(groups), 3)
    count = -(-len(groups) // columns)
    figure = Figure(figsize=(1.6 + 3.6 * columns, 0.6 + 3.2 * count), layout="constrained")
    axes = figure.subplots(count, columns, squeeze=False, sharex=True, sharey=True)
    for ax, (variant, rows) in zip(axes.flat, groups.items(), strict=False):
        _draw_regions(ax, guide, rows)
        parts = [f"{words(n)} {guide.case.text(n, v, 4)}" for n, v in zip(guide.varied, variant, strict=True)]
        ax.set_title(", ".join(parts), fontsize=8)
    for ax in list(axes.flat)[len(groups) :]:
        ax.set_axis_off()
    figure.suptitle(with_name("backlash over gain", guide.case.name), fontsize=10)
    handles, texts = axes.flat[0].get_legend_handles_labels()
    # Three columns are wider than a single panel.
    wide = 2 if columns == 1 else 3
    figure.legend(handles, texts, fontsize=8, loc="outside lower center", ncols=wide, frameon=False)
    return figure


def _draw_regions(ax: Axes, guide: Guide, rows: Sequence[GuideRow]) -> None:
    gain_unit, gain = guide.case.readable(_GAIN)
    unit, factor = guide.case.readable(_LIMIT)
    rows = sorted(rows, key=lambda row: row.values[_GAIN])
    x = gain * np.array([row.values[_GAIN] for row in rows])
    bound = factor * np.array([row.allowed for row in rows])
    start = factor * np.array([row.from_rest for row in rows])
    own = factor * rows[0].own
    top = 1.15 * np.nanmax([own, *bound, *start[np.isfinite(start)]])
    middle = np.where(np.isfinite(start), np.maximum(start, bound), top)
    # A single gain has no width: its regions are drawn as a strip around it.
    over, (free, rest) = x, (bound, middle)
    if x.size == 1:
        over, (free, rest) = x * np.array([0.96, 1.04]), (np.repeat(y, 2) for y in (bound, middle))
    edges = (np.zeros(over.size), free, rest, np.full(over.size, top))
    for i, (text, colour, hatch) in enumerate(_REGIONS):
        style: dict[str, Any] = {"facecolor": (colour, 0.25), "edgecolor": (colour, 0.8), "hatch": hatch}
        ax.fill_between(over, edges[i], edges[i + 1], **style, linewidth=0, label=text)
    ax.plot(x, bound, color=BLUE, linewidth=1.4)
    done = np.array([row.cell.verified for row in rows])
    circle: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5, "markeredgecolor": BLUE}
    ax.plot(x[done], bound[done], **circle, markerfacecolor=BLUE, label="bound, verified")
    if not np.all(done):
        ax.plot(x[~done], bound[~done], **circle, markerfacecolor="none", label="bound, not verified")
    ax.axhline(own, color=GREY, linestyle="--", linewidth=1.0, label="this elbow")
    ax.set_ylim(0.0, top)
    ax.set_xlabel(f"profile range [{gain_unit}] (small: high gain)", fontsize=8)
    ax.set_ylabel(with_unit(words(_LIMIT), unit), fontsize=8)
    ax.spines[["top", "right"]].set_visible(False)
