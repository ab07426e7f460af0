"""Bifurcation diagram of a branch of orbits."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.methods.continuation.folds import FoldCurve
from eppanalysis.methods.continuation.result import Branch
from eppanalysis.methods.steady.changes import Change
from eppanalysis.plotting import (
    BLUE,
    DARK_ORANGE,
    GREEN,
    GREY,
    STABILITY,
    VERMILLION,
    chosen,
    height_of,
    label_of,
    note_below,
    place_of,
    places_of,
    put_legend,
    show_constant,
)
from eppanalysis.readable import readable, with_unit, words

#: Filled marks of special points that have one of their own; all others are open squares.
_MARKS: dict[str, dict[str, Any]] = {
    Change.FOLD: {"marker": "D", "color": DARK_ORANGE, "markersize": 5},
    Change.PERIOD_DOUBLING: {"marker": "^", "color": "black", "markersize": 6},
}
_SQUARE: dict[str, Any] = {"marker": "s", "color": GREY, "markerfacecolor": "none", "markersize": 5}


def plot_branch(
    branch: Branch, signal: str | None = None, at: float | None = None, given: Axes | None = None
) -> Figure:
    """Bifurcation diagram: peak to peak and frequency over the parameter; stable solid, unstable dashed.

    Folds are filled diamonds, period doublings triangles, other special points open squares that are named where all
    are alike, simulated runs crosses on top. Parts of the given range that no branch covers are hatched, with the
    reason in the legend. Units are those that the case types.

    Parameters
    ----------
    signal : str, optional
        Whose peak-to-peak is drawn; the first by default.
    at : float, optional
        Value of the parameter that a dotted line marks [SI].
    given : matplotlib.axes.Axes, optional
        Where to draw the peak to peak; it and the frequency on a figure of its own by default.

    Raises
    ------
    EppError
        If the branch has no such signal.
    """
    name = chosen(dict.fromkeys(branch.signals), None if signal is None else [signal])[0]
    x_unit, x_factor = branch.shown_in
    unit, factor = readable(branch.units.get(name, ""))
    label = with_unit(f"{words(name)}\npeak to peak", unit)
    figure, panels = places_of(given, 2, height=2.0)
    others = {special.kind for one in (branch, *branch.others) for special in one.special} - set(_MARKS)
    squares = next(iter(others)) if len(others) == 1 else "other special point"
    for ax, key, scale in zip(panels, (name, "frequency"), (factor, 1.0), strict=False):
        y = scale * branch.points[key]
        for one in (branch, *branch.others):
            _draw_branch(ax, one, name, key, x_factor, scale, squares)
            y = np.append(y, scale * one.points[key])
        for gap in branch.missing:
            edges: dict[str, Any] = {"facecolor": "none", "edgecolor": GREY, "linewidth": 0.8, "hatch": "xxx"}
            ax.axvspan(x_factor * gap.low, x_factor * gap.high, **edges, label=f"not covered: {gap.why}")
        if key in branch.simulated:
            runs = x_factor * branch.simulated["value"], scale * branch.simulated[key]
            ax.plot(*runs, "x", color=GREEN, markersize=5, label="simulated")
            y = np.append(y, runs[1])
        if branch.not_covered and ax is panels[-1]:
            note_below(ax, branch.not_covered)
        show_constant(ax, y)
        top = max(height_of(one.points["value"], scale * one.points[key]) for one in (branch, *branch.others))
        if top < np.nanmax(y):
            ax.set_ylim(0.0, 1.05 * top)
        if at is not None:
            ax.axvline(x_factor * at, color=GREY, linestyle=":")
        ax.set_ylabel("frequency [Hz]" if key == "frequency" else label)
        ax.set_xlabel(with_unit(words(branch.parameter), x_unit))
    put_legend(panels[0])
    return figure


def plot_folds(curve: FoldCurve, ax: Axes | None = None) -> Figure:
    """The folds in the plane of the two parameters."""
    figure, ax = place_of(ax, 3.4)
    (y_label, up), (x_label, across) = (label_of(name, curve.units, curve.readable) for name in curve.parameters)
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    ax.plot(across * curve.values[:, 1], up * curve.values[:, 0], "D-", color=DARK_ORANGE, markersize=4, linewidth=1.3)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_branch(ax: Axes, branch: Branch, name: str, key: str, across: float, scale: float, squares: str) -> None:
    """One curve of the diagram with its special points, and what open squares are."""
    value, stable = across * branch.points["value"], branch.points["stable"]
    y = scale * branch.points[key]
    ceases = [s.index for s in branch.special if s.kind == Change.SAMPLES]  # another cycle goes on from there
    for kind, colour, style in ((True, BLUE, "-"), (False, VERMILLION, "--")):
        # A piece belongs to the stability of its first point; the other kind leaves a gap.
        piece = (stable == kind) | np.append(False, stable[:-1] == kind)
        if np.any(piece):
            line = np.insert(value, ceases, np.nan), np.insert(np.where(piece, y, np.nan), ceases, np.nan)
            ax.plot(*line, style, color=colour, linewidth=1.4, label=STABILITY[kind])
    for special in branch.special:
        height = special.cycle.frequency if key == "frequency" else special.cycle.peak_to_peak[name]
        mark, label = _MARKS.get(special.kind, _SQUARE), special.kind if special.kind in _MARKS else squares
        ax.plot(across * special.value, scale * height, linestyle="none", label=label, **mark)
