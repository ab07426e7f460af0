"""Pictures of design bounds: the boundary with its tests, a tornado of elasticities, the three regions of a design."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from eppanalysis.errors import EppError
from eppanalysis.plots import BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION, with_name
from eppanalysis.readable import with_unit, words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from eppanalysis.guidelines import Guide, GuideRow
    from eppanalysis.methods.bounds_result import DesignBounds

_MOST_BARS = 14
_SMALLEST_BAR = 5e-4
_GAIN, _LIMIT = "bands.range", "lock_pin.backlash"
#: Regions of a design from below, told apart by their hatching as well as by colour.
_REGIONS = (
    ("free of limit cycles", GREEN, ""),
    ("guarded by an unstable cycle", ORANGE, "//"),
    ("oscillates from rest", VERMILLION, "xx"),
)


def plot_bounds(bounds: DesignBounds) -> Figure:
    """The boundary over the parameter that runs: first order, harmonic balance, exact, and the simulated tests.

    Filled circles are places at which every run came to rest and the search found no cycle; diamonds are exact orbits
    on the other side. Open circles mark tests that failed.

    Parameters
    ----------
    bounds : DesignBounds

    Raises
    ------
    EppError
        If no cell has a bound.
    """
    if not np.any(np.isfinite(bounds.array("bound"))):
        raise EppError(f"{bounds.case}: no bound on {bounds.limit} was found, so there is nothing to draw.")
    (x_unit, x_factor), (y_unit, y_factor) = (bounds.readable[n] for n in (bounds.over, bounds.limit))
    x = x_factor * bounds.array("value")
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    ax = figure.add_subplot()
    curves = (("first_order", "first order", ORANGE, ":", 1.6), ("harmonic", "harmonic balance", SKY, "--", 1.6))
    for name, text, colour, style, width in curves:
        ax.plot(x, y_factor * bounds.array(name), style, color=colour, linewidth=width, label=text)
    exact = y_factor * bounds.array("exact")
    ax.plot(x, exact, color=BLUE, linewidth=1.4, marker=".", label="exact fold")
    verified = np.array([c.verified for c in bounds])
    safe, other = y_factor * bounds.array("safe_value"), y_factor * bounds.array("other_value")
    tested = np.isfinite(safe)
    runs = max((c.n_runs for c in bounds), default=0)
    circle: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5, "markeredgecolor": GREEN}
    if np.any(tested & verified):
        text = f"all {runs} runs come to rest, no orbit"
        ax.plot(x[tested & verified], safe[tested & verified], **circle, markerfacecolor=GREEN, label=text)
    if np.any(tested & ~verified):
        ax.plot(x[tested & ~verified], safe[tested & ~verified], **circle, markerfacecolor="none", label="not verified")
    there = np.array([c.other_orbit is not None for c in bounds])
    if np.any(there):
        diamond: dict[str, Any] = {"linestyle": "none", "marker": "D", "markersize": 4, "color": VERMILLION}
        ax.plot(x[there], other[there], **diamond, label="exact orbit")
    sign = next(c.sign for c in bounds if np.isfinite(c.bound))
    best = y_factor * bounds.array("bound")
    edge = ax.get_ylim()[0 if sign > 0 else 1]
    ax.fill_between(x, best, edge, color=GREEN, alpha=0.12, linewidth=0, label="free of limit cycles")
    ax.set_xlabel(with_unit(words(bounds.over), x_unit))
    ax.set_ylabel(with_unit(words(bounds.limit), y_unit))
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=7, framealpha=0.9)
    ax.set_title(f"{bounds.case}: bound on {words(bounds.limit)}", fontsize=10)
    return figure


def plot_tornado(bounds: DesignBounds, cell: int = 0) -> Figure:
    """Elasticities of one bound, largest first: by how many per cent it moves for one per cent of each parameter.

    Parameters
    ----------
    bounds : DesignBounds
    cell : int
        Which one.

    Raises
    ------
    EppError
        If the cell has no elasticities.
    """
    chosen = bounds[cell]
    known = chosen.elasticities or chosen.harmonic_elasticities
    if not known:
        raise EppError(f"{bounds.case}: the bound of cell {cell} has no elasticities; expected a corrected bound.")
    unit, factor = bounds.readable[bounds.over]
    where = f"{words(bounds.over)} {factor * chosen.value:.3g} {unit}"
    return tornado({"exact": known, "harmonic balance": chosen.harmonic_elasticities}, bounds.limit, where)


def tornado(elasticities: Mapping[str, Mapping[str, float]], limit: str, where: str) -> Figure:
    """Bars of elasticities by method.

    Parameters
    ----------
    elasticities : mapping of str to mapping
        By method and parameter; the first method orders the bars.
    limit : str
        The parameter that is bounded.
    where : str
        Operating point, in words.
    """
    first, *_ = elasticities.values()
    names = [n for n, v in first.items() if np.isfinite(v) and abs(v) > _SMALLEST_BAR]
    names = sorted(names, key=lambda n: abs(first[n]))[-_MOST_BARS:]
    figure = Figure(figsize=(6.4, 0.9 + 0.32 * len(names)), layout="constrained")
    ax = figure.add_subplot()
    height = 0.8 / len(elasticities)
    for (method, values), colour, i in zip(elasticities.items(), (BLUE, SKY, ORANGE), range(3), strict=False):
        places = np.arange(len(names)) + (0.5 * (len(elasticities) - 1) - i) * height
        ax.barh(places, [values.get(n, 0.0) for n in names], height, color=colour, label=method)
    ax.set_yticks(np.arange(len(names)), [words(n) for n in names], fontsize=8)
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    ax.set_xlabel(f"elasticity of the bound on {words(limit)} [% for 1 %]")
    ax.set_title(where, fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=7, loc="lower right")
    return figure


def plot_regions(guide: Guide) -> Figure:
    """Backlash over the gain in three regions: free of cycles, guarded by an unstable cycle, oscillating from rest.

    One panel a variant; filled circles are bounds that were verified.

    Parameters
    ----------
    guide : Guide

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
