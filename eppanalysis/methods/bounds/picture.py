"""Pictures of design bounds: the boundary with its tests, a tornado of elasticities, the three regions of a design."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.result import DesignBounds, Finding, Turn
from eppanalysis.plotting import (
    BLUE,
    DARK_ORANGE,
    GREEN,
    GREY,
    ORANGE,
    SMALL,
    VERMILLION,
    lines_of,
    note_below,
    place_of,
    put_legend,
)
from eppanalysis.readable import number, with_unit, words

_MOST_BARS = 14
#: Letters of a line of a label below bars, whose names take a third of the width.
_LETTERS = 36
_SMALLEST_BAR = 5e-4
#: Colour and words of a range in which there is no bound.
_WITHOUT = {
    Finding.NONE: (GREEN, "no limit cycle found"),
    Finding.IDLE: (GREY, "no influence on the loop"),
    Finding.ALWAYS: (VERMILLION, "limit cycles at all values tried"),
    Finding.SCALES: (VERMILLION, "limit cycles that scale with it"),
    Finding.BETWEEN: (ORANGE, "limit cycles at both ends"),
    Finding.BEYOND: (ORANGE, "limit cycles down to its end"),
}


def plot_bounds(bounds: DesignBounds, ax: Axes | None = None) -> Figure:
    """The boundary over the parameter that runs: describing functions, exact, and the simulated tests.

    Filled circles are places at which every run came to rest and the search found no cycle; diamonds are exact orbits
    on the other side. Open circles mark tests that failed. What bounds of a sampled loop do not cover is below.

    Parameters
    ----------
    ax : matplotlib.axes.Axes, optional
        Where to draw; a figure of its own by default.

    Where no bound was found the range that was looked at is drawn, with why.
    """
    (x_unit, x_factor), (y_unit, y_factor) = (bounds.readable[n] for n in (bounds.over, bounds.limit))
    x = x_factor * bounds.array("value")
    # A single value has no width: what is drawn of it is a strip around it.
    over = x if x.size > 1 else x * np.array([0.98, 1.02])
    figure, ax = place_of(ax, 4.2)
    ax.set_xlabel(with_unit(words(bounds.over), x_unit))
    ax.set_ylabel(with_unit(words(bounds.limit), y_unit))
    ax.spines[["top", "right"]].set_visible(False)
    if not np.any(np.isfinite(bounds.array("bound"))):
        _draw_ranges(ax, x, y_factor, bounds)
        put_legend(ax)
        return figure
    _draw_first_order(ax, over, y_factor, bounds)
    _draw_best(ax, x, y_factor, bounds)
    _draw_tests(ax, x, y_factor, bounds)
    _draw_proofs(ax, x, y_factor, bounds)
    sign = next(c.sign for c in bounds if np.isfinite(c.bound))
    best = y_factor * bounds.array("bound")
    edge = ax.get_ylim()[0 if sign > 0 else 1]
    free = "free of limit cycles" if bounds.allowed is None else "no larger stable cycle"
    free = "no such limit cycle found" if bounds.not_covered else free
    free += ", straight between the points" * (len(bounds) > 1)
    ax.fill_between(over, np.broadcast_to(best, over.shape), edge, color=GREEN, alpha=0.25, linewidth=0, label=free)
    put_legend(ax)
    return figure


def _draw_ranges(ax: Axes, x: np.ndarray, y_factor: float, bounds: DesignBounds) -> None:
    """Of each value the range in which a bound was sought, by what was found in it."""
    low, high = (y_factor * end for end in bounds.within)
    for cell, at in zip(bounds, x, strict=True):
        colour, text = _WITHOUT.get(cell.finding, (GREY, "no bound"))
        ax.plot([at, at], [low, high], color=colour, linewidth=6.0, solid_capstyle="butt", label=text)
    if x.size == 1:
        ax.set_xlim(x[0] - 0.05 * (abs(x[0]) or 1.0), x[0] + 0.05 * (abs(x[0]) or 1.0))


def _draw_first_order(ax: Axes, over: np.ndarray, y_factor: float, bounds: DesignBounds) -> None:
    """The line of describing functions."""
    if np.any(np.isfinite(bounds.array("first_order"))) or (bounds.allowed is None and not bounds.not_covered):
        values = np.broadcast_to(y_factor * bounds.array("first_order"), over.shape)
        ax.plot(over, values, ":", color=DARK_ORANGE, linewidth=1.6, label="DF")


def _draw_tests(ax: Axes, x: np.ndarray, y_factor: float, bounds: DesignBounds) -> None:
    """Circles on the safe side of the bounds, and diamonds where an orbit was found on the other."""
    verified = np.array([c.verified for c in bounds])
    safe, other = y_factor * bounds.array("safe_value"), y_factor * bounds.array("other_value")
    tested = np.isfinite(safe)
    runs = max((c.n_runs for c in bounds), default=0)
    circle: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5, "markeredgecolor": GREEN}
    if np.any(tested & verified):
        text = f"all {'' if bounds.not_covered else f'{runs} '}runs come to rest, no orbit"
        if bounds.allowed is not None:
            text = f"all {runs} runs at rest or on cycles that are allowed"
        ax.plot(x[tested & verified], safe[tested & verified], **circle, markerfacecolor=GREEN, label=text)
    if np.any(tested & ~verified):
        ax.plot(x[tested & ~verified], safe[tested & ~verified], **circle, markerfacecolor="none", label="not verified")
    there = np.array([c.other_orbit is not None for c in bounds])
    if np.any(there):
        diamond: dict[str, Any] = {"linestyle": "none", "marker": "D", "markersize": 4, "color": VERMILLION}
        what = "limit cycle found" if bounds.not_covered else "exact orbit"
        ax.plot(x[there], other[there], **diamond, label=what if bounds.allowed is None else f"{what}, too large")


def _draw_best(ax: Axes, x: np.ndarray, y_factor: float, bounds: DesignBounds) -> None:
    """The line of the best bounds: exact, or of the search with what it does not cover."""
    if not bounds.not_covered:
        exact = y_factor * bounds.array("exact")
        label = "exact fold" if all(c.kind is Turn.FOLD for c in bounds if np.isfinite(c.exact)) else "exact"
        ax.plot(x, exact, color=BLUE, linewidth=1.4, marker=".", label=label)
        if bounds.allowed is not None:
            reached = np.array([c.kind is Turn.SIZE for c in bounds])
            size: dict[str, Any] = {"linestyle": "none", "marker": "s", "markersize": 5, "color": BLUE}
            ax.plot(x[reached], exact[reached], **size, label="of these: allowed size reached")
        return
    line: dict[str, Any] = {"color": BLUE, "linewidth": 1.4, "linestyle": ":", "marker": "."}
    ax.plot(x, y_factor * bounds.array("searched"), **line, label="by search")
    note_below(ax, bounds.not_covered)


def _draw_proofs(ax: Axes, x: np.ndarray, y_factor: float, bounds: DesignBounds) -> None:
    """Where absence of cycles is proved, and where a cycle is."""
    bars: dict[str, Any] = {"linestyle": "none", "marker": "_", "markersize": 13, "markeredgewidth": 1.8}
    for at, colour, label in ((0, GREEN, "proved free of limit cycles"), (1, VERMILLION, "cycle proved")):
        values = [(c.proved.free, c.proved.cycle)[at] if c.proved is not None else np.nan for c in bounds]
        if np.any(np.isfinite(values)):
            ax.plot(x, y_factor * np.array(values), **bars, color=colour, label=label)


def plot_tornado(bounds: DesignBounds, cell: int = 0, ax: Axes | None = None) -> Figure:
    """Elasticities of one bound, largest first: by how many per cent it moves for one per cent of each parameter.

    Parameters
    ----------
    cell : int
        Which one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a figure of its own by default.

    Raises
    ------
    EppError
        If the cell has no elasticities.
    """
    chosen = bounds[cell]
    if not chosen.elasticities:
        raise EppError(f"{bounds.case}: the bound of cell {cell} has no elasticities; expected a corrected bound.")
    unit, factor = bounds.readable[bounds.over]
    where = f"{words(bounds.over)} {number(factor * chosen.value)} {unit}".rstrip()
    names = [n for n, v in chosen.elasticities.items() if np.isfinite(v) and abs(v) > _SMALLEST_BAR]
    names = sorted(names, key=lambda n: abs(chosen.elasticities[n]))[-_MOST_BARS:]
    figure, ax = place_of(ax, 1.1 + 0.3 * len(names))
    ax.barh(np.arange(len(names)), [chosen.elasticities[n] for n in names], 0.8, color=BLUE)
    ax.set_yticks(np.arange(len(names)), [words(n) for n in names], fontsize=SMALL)
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    text = f"elasticity of the bound on {words(bounds.limit)} [% for 1 %], at {where}"
    ax.set_xlabel("\n".join(lines_of(text, _LETTERS)))
    ax.spines[["top", "right"]].set_visible(False)
    return figure
