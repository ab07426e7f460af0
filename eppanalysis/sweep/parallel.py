"""Parallel coordinates of a sweep. Computes nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from eppanalysis.arguments import check_counts
from eppanalysis.errors import EppError
from eppanalysis.plotting import BLUE, DARK, DARK_SKY, GREY, SMALL, VERMILLION, WIDTH, lines_of, place_of, put_legend
from eppanalysis.readable import readable, with_unit, words
from eppanalysis.sweep.analyses import Allowance, Outcome
from eppanalysis.sweep.labels import is_sized, meanings, outcomes_in, put_verdict_of, readable_axis

#: Letters of all labels side by side, and those of one below which labels are upright.
_LETTERS, _FEWEST = 12.5 * WIDTH, 8
Line = tuple[str, Literal["-", "--", "-.", ":"]]
#: The outcomes as thin lines: as in the map, but dark enough to be seen.
_LINES: dict[bool, tuple[Line, ...]] = {
    False: ((DARK, "-."), (DARK_SKY, ":"), (VERMILLION, "-"), ("#000000", "--")),
    True: ((DARK, "-."), (DARK_SKY, ":"), (BLUE, "--"), (VERMILLION, "-"), ("#000000", "--")),
}


def plot_parallel(
    dataset: xarray.Dataset, variables: Sequence[str] = ("peak_to_peak", "frequency"), *, most: int = 2000
) -> Figure:
    """Parallel coordinates: a line for each cell through its parameters and its results, by outcome.

    For more than two axes, and for samples. What oscillates (more than is allowed) is drawn solid and on top, what
    settles dotted.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep`.
    variables : sequence of str
        Results, to the right of the parameters.
    most : int
        Of more cells than these, so many are drawn, spread evenly.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    EppError
        If the dataset has no outcome, or no such results.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> ranges = {
    ...     "bands.range": "1:5:lbf",
    ...     "lock_pin.backlash": "0:3:deg",
    ...     "forearm.inertia": (0.03, 0.06),
    ... }
    >>> found = epp.sweep(
    ...     epp.case("fig8a_original"), epp.Sobol(ranges, 8), progress=False
    ... )
    >>> len(epp.plot_parallel(found).axes[0].collections)
    2
    """
    check_counts("plot_parallel", {"most": (most, 1)})
    outcome = next(iter(outcomes_in(dataset)), None)
    if outcome is None:
        raise EppError("The dataset has no outcome to draw; expected the result of a sweep.")
    if missing := [name for name in variables if name not in dataset]:
        raise EppError(f"The sweep has no {missing[0]}; expected one of {', '.join(map(str, dataset.data_vars))}.")
    cells, columns, labels = _flat(dataset, variables, outcome, most)
    low, high = np.array([_span(column) for column in columns.T]).T
    with np.errstate(invalid="ignore"):
        shares = np.where(high > low, (columns - low) / np.where(high > low, high - low, 1.0), 0.5)
    figure, ax = place_of(None, 3.8)
    means, worst = meanings(dataset[outcome]), Allowance.EXCEEDS if is_sized(dataset) else Outcome.OSCILLATES
    handles = []
    for code in sorted(np.unique(cells).tolist(), key=lambda c: c == worst):
        rows = shares[cells == code]
        lines = [np.column_stack([np.arange(row.size), row])[np.isfinite(row)] for row in rows]
        colour, dashes = _LINES[is_sized(dataset)][code]
        opacity = min(1.0, 0.25 + 20.0 / len(lines))
        ax.add_collection(LineCollection(lines, colors=colour, linewidths=0.8, linestyles=dashes, alpha=opacity))
        text = f"{means[code]} ({len(rows)})"
        handles.append(Line2D([], [], color=colour, linewidth=1.8, linestyle=dashes, label=text))
    _parallel_axes(ax, low, high, labels)
    put_legend(ax, handles)
    some = dataset[outcome].size > cells.size
    put_verdict_of(figure, dataset, f"drawn are {cells.size} of {dataset[outcome].size} designs" * some)
    return figure


def _flat(
    dataset: xarray.Dataset, variables: Sequence[str], outcome: str, most: int
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Outcome, and parameters and results in readable units, of the cells that are drawn."""
    dims = dataset[outcome].dims
    chosen = np.unique(np.linspace(0, dataset[outcome].size - 1, min(most, dataset[outcome].size)).astype(int))
    place = dict(zip(dims, np.unravel_index(chosen, dataset[outcome].shape), strict=True))
    columns, labels = [], []
    for name in map(str, dataset.coords):
        (dim,) = dataset[name].dims
        values, label = readable_axis(dataset, name)
        columns.append(values[place[dim]])
        labels.append(label)
    for name in variables:
        unit, factor = readable(str(dataset[name].attrs.get("units", "")))
        columns.append(factor * dataset[name].values.ravel()[chosen])
        labels.append(with_unit(words(name), unit))
    return dataset[outcome].values.ravel()[chosen], np.column_stack(columns).astype(float), labels


def _span(column: np.ndarray) -> tuple[float, float]:
    """Least and largest value; nan where there is none, as of the frequency of cells that all rest."""
    there = column[np.isfinite(column)]
    return (float(there.min()), float(there.max())) if there.size else (np.nan, np.nan)


def _parallel_axes(ax: Axes, low: np.ndarray, high: np.ndarray, labels: Sequence[str]) -> None:
    """An upright line for every parameter and result, with its least and largest value at its ends."""
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        ax.plot([i, i], [0.0, 1.0], color=GREY, linewidth=0.8, zorder=3)
        for share, value, side, shift in ((0.0, a, "top", -3), (1.0, b, "bottom", 3)):
            text = f"{value:.4g}" if np.isfinite(value) else "none"
            place: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": side, "fontsize": SMALL}
            ax.annotate(text, (i, share), (0, shift), **place)
    ax.set(xlim=(-0.3, len(labels) - 0.7), ylim=(-0.09, 1.09), yticks=[])
    letters = _LETTERS / len(labels)
    broken = ["\n".join(lines_of(label, letters)) for label in labels] if letters > _FEWEST else labels
    ax.set_xticks(range(len(labels)), broken, fontsize=SMALL, rotation=0 if letters > _FEWEST else 90)
    ax.spines[["top", "right", "left", "bottom"]].set_visible(False)
    ax.tick_params(axis="x", length=0)
