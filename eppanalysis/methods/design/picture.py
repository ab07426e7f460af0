"""Picture of a design: of two parameters the bound with the optimum, else their ranges; the objective of a front."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.errors import EppError
from eppanalysis.methods.design.goal import Sense
from eppanalysis.methods.design.result import Design
from eppanalysis.plotting import BLUE, DARK_ORANGE, GREEN, GREY, SMALL, VERMILLION, place_of, put_legend
from eppanalysis.readable import with_unit, words

#: Offsets of texts from marks are in points.
_POINTS: dict[str, Any] = {"textcoords": "offset points"}


def plot_design(design: Design, ax: Axes | None = None) -> Figure:
    """The exact bound over the other of two tuned parameters with the optimum; else the range of each with the optimum.

    Where a front was requested, that.

    Raises
    ------
    EppError
        If no design is feasible.
    """
    if design.front:
        return _front(design, ax)
    if not design.optimum.feasible:
        raise EppError(f"{design.case}: no design is feasible, so there is nothing to draw.")
    others = [name for name in design.tune if name != design.limit]
    return _bound(design, others[0], ax) if len(others) == 1 else _ranges(design, ax)


def _bound(design: Design, other: str, ax: Axes | None) -> Figure:
    """The exact bound over the other parameter, with the optimum on it."""
    (x_unit, x), (y_unit, y) = design.readable[other], design.readable[design.limit]
    known, best = design.optimum.evaluated, design.optimum
    figure, ax = _axes(ax, with_unit(words(other), x_unit), with_unit(words(design.limit), y_unit))
    ax.update_datalim([(x * end, y * best.at[design.limit]) for end in design.tune[other]])
    ax.plot(x * known[:, 0], y * known[:, 1], ".-", color=BLUE, linewidth=1.4, label="exact bound")
    rule = "on the safe side of it (tested at the optimum)"
    edge = y * _safe_end(design)
    ax.fill_between(x * known[:, 0], y * known[:, 1], edge, color=GREEN, alpha=0.25, linewidth=0, label=rule)
    at, safe = (x * best.at[other], y * best.at[design.limit]), y * best.values[design.limit]
    confirmed = "confirmed" if best.confirmed else "not confirmed"
    ax.plot(*at, "D", color=VERMILLION, label=f"optimum, {confirmed}")
    ax.plot(at[0], safe, "o", color=GREEN, label=f"design, {100 * design.margin:g} % inside")
    if np.isfinite(best.first_order):
        ax.plot(at[0], y * best.first_order, "x", color=DARK_ORANGE, label="the describing function there")
    put_legend(ax)
    return figure


def _ranges(design: Design, ax: Axes | None) -> Figure:
    """The range of each tuned parameter with the optimum in it, and of the bounded one where it is free of cycles."""
    best, names = design.optimum, [design.limit, *(name for name in design.tune if name != design.limit)]
    figure, ax = place_of(ax, 1.2 + 0.6 * len(names))
    free = "no limit cycle" if design.allowed is None else "none above the allowed size"
    confirmed = f"optimum, {'confirmed' if best.confirmed else 'not confirmed'}"
    for row, name in enumerate(names):
        low, high = design.tune[name]
        at, inside = ((value[name] - low) / (high - low) for value in (best.at, best.values))
        ax.plot([0.0, 1.0], [row, row], color=GREY, alpha=0.3, linewidth=8, solid_capstyle="butt", label="range")
        if name == design.limit:
            safe = [(_safe_end(design) - low) / (high - low), at]
            label = f"{free} (tested at the optimum)"
            ax.plot(safe, [row, row], color=GREEN, alpha=0.4, linewidth=8, solid_capstyle="butt", label=label)
            proposed = (best.first_order - low) / (high - low)
            if 0.0 <= proposed <= 1.0:
                ax.plot(proposed, row, "x", color=DARK_ORANGE, label="the describing function there")
        ax.plot(inside, row, "o", color=GREEN, label=f"design, {100 * design.margin:g} % inside")
        ax.plot(at, row, "D", color=VERMILLION, label=confirmed)
        for place, value, side in ((0.0, low, "left"), (1.0, high, "right")):
            ax.annotate(design.text(name, value), (place, row), (0, -8), fontsize=SMALL, ha=side, va="top", **_POINTS)
        ax.annotate(design.inside(best, name), (at, row), (0, 8), fontsize=SMALL, ha="center", va="bottom", **_POINTS)
    ax.set_yticks(range(len(names)), [words(name) for name in names])
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xticks([])
    ax.spines[["top", "right", "bottom", "left"]].set_visible(False)
    ax.tick_params(left=False)
    put_legend(ax)
    return figure


def _safe_end(design: Design) -> float:
    """The end of the bounded parameter's range on whose side designs are free of cycles [SI]."""
    best, ends = design.optimum, design.tune[design.limit]
    if design.limit == design.objective:
        return ends[0 if design.goal is Sense.LARGEST else 1]
    return ends[0 if best.values[design.limit] <= best.at[design.limit] else 1]


def _front(design: Design, ax: Axes | None) -> Figure:
    (x_unit, x), (y_unit, y) = design.readable[design.front_over], design.readable[design.objective]
    # The verdict above is of the case's own value, which is drawn with the others.
    own = [] if any(value == design.front_own for value, _ in design.front) else [(design.front_own, design.optimum)]
    rows = sorted(((value, o) for value, o in (*design.front, *own) if o.feasible), key=itemgetter(0))
    if not rows:
        raise EppError(f"{design.case}: no design of the front is feasible, so there is nothing to draw.")
    figure, ax = _axes(ax, with_unit(words(design.front_over), x_unit), with_unit(words(design.objective), y_unit))
    places = x * np.array([value for value, _ in rows])
    best = y * np.array([design.value_of(o) for _, o in rows])
    ax.plot(places, best, "-", color=BLUE, linewidth=1.4, label=f"{design.goal} {words(design.objective)}")
    for confirmed, face, text in ((True, VERMILLION, "confirmed"), (False, "none", "not confirmed")):
        mask = np.array([o.confirmed is confirmed for _, o in rows])
        if np.any(mask):
            ax.plot(places[mask], best[mask], "D", color=VERMILLION, markerfacecolor=face, label=text)
    if design.optimum.feasible:  # a ring, in which the mark of the optimum is seen
        ring: dict[str, Any] = {"markersize": 13, "markerfacecolor": "none"}
        label = f"own value of {words(design.front_over)}"
        ax.plot(x * design.front_own, y * design.value_of(design.optimum), "ok", label=label, **ring)
    for place, value, (_, o) in zip(places, best, rows, strict=True):
        told = (f"{words(n)} {design.text(n, o.at[n])}" for n in design.tune if n != design.objective)
        ax.annotate("\n".join(told), (place, value), fontsize=SMALL, xytext=(8, 4), textcoords="offset points")
    put_legend(ax)
    return figure


def _axes(ax: Axes | None, x_label: str, y_label: str) -> tuple[Figure, Axes]:
    figure, ax = place_of(ax, 4.2)
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    ax.spines[["top", "right"]].set_visible(False)
    return figure, ax
