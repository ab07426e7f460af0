"""Design maps of sweeps: regions of outcome, boundaries on top. Computes nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from eppanalysis.errors import EppError
from eppanalysis.plots import BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

#: Colours of unknown, settles, oscillates, diverges: apart in brightness as well as in hue.
_OUTCOME_COLOURS = ("#BDBDBD", "#DCEBF5", ORANGE, VERMILLION)
_LINE_COLOURS = (BLUE, GREEN, "#000000", SKY, GREY)
_MOST_CONTOURS = 6


def plot_design_map(
    dataset: xarray.Dataset,
    x: str | None = None,
    y: str | None = None,
    *,
    at: Mapping[str, int] | None = None,
    amplitude: bool = True,
    curves: Mapping[str, tuple[Any, Any]] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Where a design settles and where it oscillates, over two axes of a sweep.

    Shaded regions are outcomes, thin lines the amplitude of the cycle. Where the sweep has predictions, the
    describing function's boundary is dashed; curves from elsewhere, such as exact folds, are drawn on top.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep.sweep`, over a grid.
    x, y : str, optional
        Axes of the picture; by default the last two dimensions, the last one upwards.
    at : mapping of str to int, optional
        Place along every other dimension; the first one by default.
    amplitude : bool
        Whether to draw lines of equal amplitude.
    curves : mapping of str to (x values, y values), optional
        Curves by their name in the legend, in SI units.
    ax : matplotlib.axes.Axes, optional
        Where to draw; a figure of its own by default.

    Raises
    ------
    EppError
        If the dataset has no such axes, or no outcome.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> from eppanalysis.sweep import sweep
    >>> axes = {"bands.range": "2:3:2:lbf", "lock_pin.backlash": "0.5:2.5:2:deg"}
    >>> figure = plot_design_map(sweep(epp.case("fig8a_original"), axes, progress=False))
    >>> figure.axes[0].get_xlabel()
    'bands range [lbf]'
    """
    x, y = _axes_of(dataset, x, y)
    names = [n for n in ("outcome", "exact_outcome", "predicted_outcome") if n in dataset]
    if not names:
        raise EppError("The dataset has no outcome to draw; expected the result of a sweep.")
    others = {d: int((at or {}).get(d, 0)) for d in map(str, dataset[names[0]].dims) if d not in (x, y)}
    plane = dataset.isel(others).transpose(y, x)
    if ax is None:
        figure: Any = Figure(figsize=(6.2, 4.6), layout="constrained")
        ax = figure.add_subplot()
    else:
        figure = ax.figure
    (across, x_label), (up, y_label) = (_readable(plane, name) for name in (x, y))
    handles = _regions(ax, across, up, plane[names[0]])
    if amplitude and names[0] == "outcome" and "amplitude" in plane:
        _contours(ax, across, up, plane["amplitude"])
    for name in names[1:]:
        colour = GREEN if name == "exact_outcome" else BLUE
        label = "exact orbits exist" if name == "exact_outcome" else "describing function"
        handles += _boundary(ax, across, up, plane[name], label, colour)
    for colour, (label, (xs, ys)) in zip(_LINE_COLOURS * len(curves or {}), (curves or {}).items(), strict=False):
        factors = [_factor(plane, n) for n in (x, y)]
        handles += ax.plot(
            np.asarray(xs) * factors[0], np.asarray(ys) * factors[1], color=colour, linewidth=1.8, label=label
        )
    ax.set_xlabel(x_label)
    ax.set_ylabel(y_label)
    _reach(ax, across, up)
    ax.legend(handles=handles, fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
    places = ", ".join(f"{d} = {_place(dataset, d, i)}" for d, i in others.items())
    if places:
        ax.set_title(places, fontsize=8, loc="right", pad=22)
    return figure


def _axes_of(dataset: xarray.Dataset, x: str | None, y: str | None) -> tuple[str, str]:
    dims = [str(d) for d in dataset.dims if d in dataset.coords]
    if len(dims) < 2 and (x is None or y is None):
        raise EppError("A design map needs a grid of two axes or more; expected a sweep over one.")
    x, y = x or next(d for d in [dims[-2], *dims] if d != y), y or next(d for d in [dims[-1], *dims] if d != x)
    for name in (x, y):
        if name not in dims:
            raise EppError(f"There is no axis {name!r} in the sweep; expected one of {', '.join(dims)}.")
    if x == y:
        raise EppError(f"Both axes of the map are {x!r}; expected two different ones.")
    return x, y


def _factor(dataset: xarray.Dataset, name: str) -> float:
    """From SI to the unit in which people read the axis."""
    shown = dataset[name].attrs.get("per_readable_unit")
    return 1.0 / float(shown) if shown else 1.0


def _unit(dataset: xarray.Dataset, name: str) -> str:
    attrs = dataset[name].attrs
    return attrs.get("readable_units" if attrs.get("per_readable_unit") else "units", "")


def _readable(dataset: xarray.Dataset, name: str) -> tuple[np.ndarray, str]:
    unit = _unit(dataset, name).replace("*", "·")
    words = name.replace("_", " ").replace(".", " ")
    return dataset[name].values * _factor(dataset, name), f"{words} [{unit}]" if unit else words


def _place(dataset: xarray.Dataset, name: str, i: int) -> str:
    if name not in dataset.coords:
        return str(i)
    return f"{float(dataset[name].values[i]) * _factor(dataset, name):.4g} {_unit(dataset, name)}".strip()


def _regions(ax: Axes, x: np.ndarray, y: np.ndarray, outcome: xarray.DataArray) -> list[Any]:
    words = str(outcome.attrs["flag_meanings"]).split()
    colours = ListedColormap(_OUTCOME_COLOURS[: len(words)])
    norm = BoundaryNorm(np.arange(len(words) + 1) - 0.5, len(words))
    ax.pcolormesh(_edges(x), _edges(y), outcome.values, cmap=colours, norm=norm, rasterized=True)
    there = np.unique(outcome.values)
    return [Patch(facecolor=_OUTCOME_COLOURS[int(c)], edgecolor=GREY, label=words[int(c)]) for c in there]


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of the cells round their centres."""
    if centres.size == 1:
        half = 0.05 * abs(float(centres[0])) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _contours(ax: Axes, x: np.ndarray, y: np.ndarray, amplitude: xarray.DataArray) -> None:
    from eppanalysis.readable import readable

    unit, factor = readable(str(amplitude.attrs.get("units", "")))
    values = np.where(amplitude.values > 0, factor * amplitude.values, np.nan)
    if min(values.shape) < 2 or not np.any(np.isfinite(values)) or np.nanmax(values) <= np.nanmin(values):
        return
    lines = ax.contour(x, y, values, levels=_MOST_CONTOURS, colors="#444444", linewidths=0.6)
    ax.clabel(lines, fontsize=6, fmt=lambda v: f"{v:.3g} {unit}")


def _boundary(ax: Axes, x: np.ndarray, y: np.ndarray, outcome: xarray.DataArray, label: str, colour: str) -> list[Any]:
    """Dashed line round the cells with a stable cycle."""
    from matplotlib.lines import Line2D

    inside = np.asarray(outcome.values == 2, float)
    if min(inside.shape) < 2 or inside.min() == inside.max():
        return []
    ax.contour(x, y, inside, levels=[0.5], colors=[colour], linestyles="--", linewidths=1.6)
    return [Line2D([], [], color=colour, linestyle="--", linewidth=1.6, label=label)]


def _reach(ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    for values, limits in ((x, ax.set_xlim), (y, ax.set_ylim)):
        edges = _edges(values)
        limits(float(edges.min()), float(edges.max()))
