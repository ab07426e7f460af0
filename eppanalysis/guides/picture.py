"""Picture of a guideline: the limits as a grid of designs, and what a design does over the parameter that runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from eppanalysis.guides.manual import limit_grid
from eppanalysis.guides.result import GAIN, Guide, GuideRow, Region, Side, in_words
from eppanalysis.methods.bounds.result import Known
from eppanalysis.plotting import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    SMALL,
    VERMILLION,
    WIDTH,
    figure_of_height,
    label_up,
    legend_below,
    lines_of,
    place_of,
    put_legend,
    root_figure,
)
from eppanalysis.readable import reasons, with_unit

#: Regions of a design from its safe side on, which differ in hatching as well as in colour.
_REGIONS = (
    (Region.FREE, GREEN, ""),
    (Region.STRUCK, ORANGE, "//"),
    (Region.UNKNOWN, GREY, ".."),
    (Region.RUNS, VERMILLION, "xx"),
)
#: Letters of a title on one line.
_LETTERS = 12.0 * WIDTH
#: Height of a panel, and of one of many [inch].
_PANEL, _LOW_PANEL, _MANY = 2.6, 2.0, 3
#: Distance between values at which runs were tried, relative to them, that is no region of its own.
_GRID = 0.02
#: How a limit is known: the colour of its cell in the grid, and the mark of its point.
_KNOWN: dict[Known, tuple[str, dict[str, Any]]] = {
    Known.PROVED: (GREEN, {"marker": "*", "markersize": 9, "markerfacecolor": GREEN}),
    Known.TESTED: (GREEN, {"marker": "o", "markersize": 5, "markerfacecolor": BLUE}),
    Known.EXACT: (SKY, {"marker": "o", "markersize": 5, "markerfacecolor": "none"}),
    Known.SEARCHED: (SKY, {"marker": "s", "markersize": 5, "markerfacecolor": "none"}),
    Known.BALANCED: (ORANGE, {"marker": "^", "markersize": 5, "markerfacecolor": "none"}),
    Known.NONE: (GREY, {"marker": "x", "markersize": 5}),
}


def plot_guide(guide: Guide, given: Axes | None = None) -> Figure:
    """What a design does, by region, over the parameter that runs: a panel a variant, above several of them their grid.

    Parameters
    ----------
    given : matplotlib.axes.Axes, optional
        Where to draw the regions of the first variant alone; all on a figure of its own by default.
    """
    groups = guide.variants()
    if not any(np.isfinite(row.cell.bound) for row in guide.rows):
        return _without_limits(guide, given)
    if given is not None:
        given.set_ylim(0.0, _draw_regions(given, guide, next(iter(groups.values()))))
        put_legend(given)
        return root_figure(given)
    # The first row is the grid; a single variant needs none.
    above = 1.4 + 0.35 * len(guide.rows) / len(groups) if len(groups) > 1 else 0.0
    heights = [above] * (above > 0) + [_PANEL if len(groups) < _MANY else _LOW_PANEL] * len(groups)
    figure = figure_of_height(1.4 + sum(heights))
    places = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    first: Axes | None = None
    panels, tops = [], []
    for k, (variant, rows) in enumerate(groups.items()):
        ax = figure.add_subplot(places[k + (above > 0)], sharex=first, sharey=first)
        first = first or ax
        tops.append(_draw_regions(ax, guide, rows))
        ax.set_title("\n".join(lines_of(guide.variant_in_words(variant), _LETTERS)), fontsize=SMALL)
        panels.append(ax)
    for ax in panels[:-1]:  # all have the range of the lowest
        ax.set_xlabel("")
        ax.tick_params(labelbottom=False)
    panels[0].set_ylim(0.0, max(tops))
    if above:
        _draw_grid(figure.add_subplot(places[0]), guide)
    legend_below(figure, *panels)
    return figure


def _without_limits(guide: Guide, given: Axes | None) -> Figure:
    """Why there is no limit, where there is none."""
    figure, ax = place_of(given, 1.2)
    ax.set_axis_off()
    why = reasons((guide.place(row), row.cell.message or row.cell.finding.sentence) for row in guide.rows)
    text = "\n".join(lines_of(f"No limit on {in_words(guide.limit)}. {why}", _LETTERS))
    ax.text(0.0, 1.0, text, transform=ax.transAxes, va="top", fontsize=SMALL)
    return figure


def _draw_grid(ax: Axes, guide: Guide) -> None:
    """The limits, rounded to the safe side: values of the parameter that runs down, variants across."""
    cells, heads, texts, step = limit_grid(guide)
    unit = guide.case.readable(guide.limit)[0]
    for i, row in enumerate(cells):
        for j, cell in enumerate(row):
            colour = GREY if cell is None else _KNOWN[cell.cell.known][0]
            ax.add_patch(Rectangle((j - 0.48, i - 0.46), 0.96, 0.92, facecolor=colour, alpha=0.35, linewidth=0))
            ax.text(j, i, texts[i][j], ha="center", va="center", fontsize=SMALL, fontweight="bold")
    ax.set_xlim(-0.5, len(cells[0]) - 0.5)
    ax.set_ylim(len(cells) - 0.5, -0.5)
    heads = ["\n".join(lines_of(head, _LETTERS / len(heads))) for head in heads]
    ax.set_xticks(range(len(heads)), heads, fontsize=SMALL)
    ax.xaxis.tick_top()
    over = guide.over
    values = [next(c for c in row if c is not None).values[over] for row in cells]
    ax.set_yticks(range(len(cells)), [guide.case.text(over, v, 4) for v in values], fontsize=SMALL)
    label_up(ax, in_words(over))
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    side = "at most" if guide.side is Side.BELOW else "at least"
    ax.set_xlabel(f"{with_unit(in_words(guide.limit), unit)}, {side}, in steps of {step}", fontsize=SMALL)
    known = [k for k in Known if any(row.cell.known is k for row in guide.rows)]
    handles = [Patch(facecolor=_KNOWN[k][0], alpha=0.35, label=str(k)) for k in known]
    # The variants are named above the grid.
    put_legend(ax, handles, loc="upper left", bbox_to_anchor=(0.0, -0.25))


def _draw_regions(ax: Axes, guide: Guide, rows: Sequence[GuideRow]) -> float:
    """Regions of a variant, and how far up they are known."""
    (x_unit, x_factor), (unit, factor) = guide.case.readable(guide.over), guide.case.readable(guide.limit)
    rows = sorted(rows, key=lambda row: row.values[guide.over])
    x = x_factor * np.array([row.values[guide.over] for row in rows])
    bound = factor * np.array([row.allowed for row in rows])
    own = factor * rows[0].own
    sign = 1.0 if guide.side is Side.BELOW else -1.0
    edges, top = _edges(factor, rows, bound, own, sign)
    for i, (region, colour, hatch) in enumerate(_REGIONS):
        style: dict[str, Any] = {"facecolor": (colour, 0.25), "edgecolor": (colour, 0.8), "hatch": hatch}
        said = guide.says(region)
        for across, at in _pieces(x, np.isfinite(bound)):
            low, high = edges[i][at], edges[i + 1][at]
            if np.max(np.abs(high - low)) > 0.0:
                ax.fill_between(across, low, high, **style, linewidth=0, label=said)
                said = "_"  # named once
    ax.plot(x, bound, color=BLUE, linewidth=1.4)
    for known, (_, mark) in _KNOWN.items():
        these = np.array([row.cell.known is known for row in rows]) & np.isfinite(bound)
        if np.any(these):
            ax.plot(x[these], bound[these], linestyle="none", markeredgecolor=BLUE, **mark, label=f"limit, {known}")
    none = x[~np.isfinite(bound)]
    if none.size:
        lone: dict[str, Any] = {"linestyle": "none", "color": GREY, "clip_on": False, "label": str(Known.NONE)}
        ax.plot(none, np.zeros(none.size), marker="x", markersize=5, **lone)
    if math.isfinite(own):
        whose = "this elbow" if guide.case.kind == "elbow" else "this case"
        ax.axhline(own, color=GREY, linestyle="--", linewidth=1.0, label=whose)
    remark = " (small: high gain)" if guide.over == GAIN else ""
    label = lines_of(f"{with_unit(in_words(guide.over), x_unit)}{remark}", _LETTERS)
    ax.set_xlabel("\n".join(label), fontsize=SMALL)
    label_up(ax, with_unit(in_words(guide.limit), unit))
    ax.spines[["top", "right"]].set_visible(False)
    return top


def _pieces(x: np.ndarray, known: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Values next to each other that have a bound, and their numbers; one alone has no width and is made a strip."""
    places = np.flatnonzero(known)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return [(x[at], at) if at.size > 1 else (x[at] * np.array([0.96, 1.04]), np.repeat(at, 2)) for at in runs]


def _edges(
    factor: float, rows: Sequence[GuideRow], bound: np.ndarray, own: float, sign: float
) -> tuple[list[np.ndarray], float]:
    """Where the regions begin and end, from the safe side on, and how far up."""
    rests, runs = (factor * np.array([getattr(row, name) for row in rows]) for name in ("rests_to", "from_rest"))
    known = np.concatenate([[own], bound, rests, runs])
    known = known[np.isfinite(known)]
    top = 1.15 * float(np.max(known))
    safe, far = (0.0, top) if sign > 0 else (top, 0.0)
    beyond = np.maximum if sign > 0 else np.minimum
    begun = np.where(np.isfinite(runs), beyond(runs, bound), far)
    # Runs are tried on a grid: what oscillates in the first ones beyond the limit does so from there on.
    begun = np.where(np.isfinite(runs) & (np.abs(begun - bound) < _GRID * np.abs(begun)), bound, begun)
    # A run that rests up to the last value tried before the one that oscillates rests up to that one, as drawn.
    struck = np.where(np.isfinite(rests), beyond(rests, bound), bound)
    near = np.isfinite(runs) & (np.abs(begun - struck) < _GRID * np.abs(begun))
    struck = np.where(near, begun, struck)
    edge = np.full(bound.size, safe), bound, struck, begun, np.full(bound.size, far)
    return [np.where(np.isfinite(bound), e, np.nan) for e in edge], top
