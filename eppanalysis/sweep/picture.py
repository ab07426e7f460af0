"""Pictures of sweeps: design maps with boundaries on top, slices, parallel coordinates. Computes nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eppanalysis.arguments import check_counts
from eppanalysis.errors import EppError
from eppanalysis.plotting import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    VERMILLION,
    label_of,
    place_of,
    put_verdict,
    show_constant,
)
from eppanalysis.readable import in_print, readable, with_unit, words
from eppanalysis.sweep.analyses import Outcome

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

    from eppanalysis.sweep.boundary import Boundary

#: Colours of unknown, settles, oscillates, diverges: apart in brightness as well as in hue.
OUTCOME_COLOURS = ("#BDBDBD", "#DCEBF5", ORANGE, VERMILLION)
#: Dashed lines round cells that oscillate, by what says so.
_BORDERS = {
    "outcome": ("runs oscillate", ORANGE),
    "exact_outcome": ("exact orbits exist", GREEN),
    "predicted_outcome": ("describing function", BLUE),
}
_LINE_COLOURS = ("#000000", BLUE, GREEN, SKY, GREY)
_LINES = ("-", "--", "-.", ":")
#: Curves of fewer points show each of them.
_FEW = 60
_MOST_CONTOURS, _MOST_SLICES = 6, 6
#: The outcomes as thin lines: as in the map, but dark enough to be seen.
_PARALLEL_COLOURS = (GREY, SKY, VERMILLION, "#000000")
_PARALLEL_LINES: tuple[Literal["-", "--", "-.", ":"], ...] = ("-.", ":", "-", "--")
#: Lines of slices by method.
_DASHES: dict[str, Literal["-", "--", ":"]] = {"run": "-", "predicted": "--", "exact": ":"}
#: A marker at every cell, for a curve may be broken on both sides of one.
_MARKERS = {"run": ".", "predicted": "x", "exact": "+"}


def plot_design_map(
    dataset: xarray.Dataset,
    x: str | None = None,
    y: str | None = None,
    *,
    at: Mapping[str, int] | None = None,
    amplitude: bool = True,
    curves: Sequence[Boundary] | Mapping[str, tuple[Any, Any]] = (),
    ax: Axes | None = None,
) -> Figure:
    """Where a design settles and where it oscillates, over two axes of a sweep.

    Shaded regions are outcomes, or what is proved, thin lines the amplitude of the cycle. Where the sweep has
    predictions, the describing function's boundary is dashed; curves from elsewhere are drawn on top.

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
    curves : sequence of Boundary, or mapping of str to (x values, y values)
        Boundaries of :func:`eppanalysis.outcome_boundary` and :func:`eppanalysis.fold_boundary`, or curves by their
        name in the legend, in SI units.
    ax : matplotlib.axes.Axes, optional
        Where to draw, without the name of the case; a figure of its own by default.

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
    names = [n for n in ("proved", *_BORDERS) if n in dataset]
    if not names:
        raise EppError("The dataset has no outcome to draw; expected the result of a sweep.")
    others = {d: int((at or {}).get(d, 0)) for d in map(str, dataset[names[0]].dims) if d not in (x, y)}
    plane = dataset.isel(others).transpose(y, x)
    if ax is None:
        figure: Any = Figure(figsize=(6.2, 4.4), layout="constrained")
        ax = figure.add_subplot()
        _put_verdict(figure, plane)
    else:
        figure = ax.figure
    (across, x_label), (up, y_label) = (_readable(plane, name) for name in (x, y))
    handles = _regions(ax, across, up, plane[names[0]])
    if amplitude and "amplitude" in plane:
        handles += _contours(ax, across, up, plane["amplitude"])
    for name in names[1:]:
        handles += _boundary(ax, across, up, plane[name], *_BORDERS[name])
    handles += _curves(ax, plane, x, y, curves)
    ax.set(xlabel=x_label, ylabel=y_label)
    _reach(ax, across, up)
    ax.legend(handles=handles, fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
    places = ", ".join(f"{d} = {_place(dataset, d, i)}" for d, i in others.items())
    if places:
        ax.set_title(places, fontsize=8, loc="right", pad=22)
    return figure


def _put_verdict(figure: Figure, cells: xarray.Dataset, details: str = "") -> None:
    """In how many of the designs that are drawn the loop does what, or what is proved of it, the most first."""
    name = next((n for n in ("proved", *_BORDERS) if n in cells), None)
    values, counts = np.unique(cells[name].values if name else [], return_counts=True)
    parts = [f"{_meanings(cells[name])[int(values[k])]} in {counts[k]}" for k in np.argsort(-counts, kind="stable")]
    verdict = ", ".join([f"{parts[0]} of {counts.sum()} designs", *parts[1:]]).capitalize() if parts else ""
    put_verdict(figure, verdict, details, str(cells.attrs.get("case", "")))


def _meanings(outcome: xarray.DataArray) -> list[str]:
    """What each number of an outcome means."""
    return [words(word) for word in str(outcome.attrs["flag_meanings"]).split()]


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


def _curves(ax: Axes, plane: xarray.Dataset, x: str, y: str, curves: Any) -> list[Any]:
    """Curves on top of a map, each in a colour, line and marker of its own."""
    named = curves.items() if isinstance(curves, Mapping) else [(c.label, c.over(x, y)) for c in curves]
    handles = []
    for i, (label, (xs, ys)) in enumerate(named):
        across, up = np.asarray(xs) * _factor(plane, x), np.asarray(ys) * _factor(plane, y)
        style: dict[str, Any] = {"color": _LINE_COLOURS[i % len(_LINE_COLOURS)], "linestyle": _LINES[i % len(_LINES)]}
        if across.size < _FEW:
            style |= {"marker": "o", "markersize": 3.5}
        handles += ax.plot(across, up, linewidth=1.8, label=label, **style)
    return handles


def _factor(dataset: xarray.Dataset, name: str) -> float:
    """From SI to the unit in which people read the axis."""
    shown = dataset[name].attrs.get("per_readable_unit")
    return 1.0 / float(shown) if shown else 1.0


def _unit(dataset: xarray.Dataset, name: str) -> str:
    attrs = dataset[name].attrs
    return attrs.get("readable_units" if attrs.get("per_readable_unit") else "units", "")


def _readable(dataset: xarray.Dataset, name: str) -> tuple[np.ndarray, str]:
    return dataset[name].values * _factor(dataset, name), with_unit(words(name), in_print(_unit(dataset, name)))


def _place(dataset: xarray.Dataset, name: str, i: int) -> str:
    if name not in dataset.coords:
        return str(i)
    return f"{float(dataset[name].values[i]) * _factor(dataset, name):.4g} {_unit(dataset, name)}".strip()


def _regions(ax: Axes, x: np.ndarray, y: np.ndarray, outcome: xarray.DataArray) -> list[Any]:
    meanings = _meanings(outcome)
    colours = ListedColormap(OUTCOME_COLOURS[: len(meanings)])
    norm = BoundaryNorm(np.arange(len(meanings) + 1) - 0.5, len(meanings))
    ax.pcolormesh(_edges(x), _edges(y), outcome.values, cmap=colours, norm=norm, rasterized=True)
    there = np.unique(outcome.values)
    return [Patch(facecolor=OUTCOME_COLOURS[int(c)], edgecolor=GREY, label=meanings[int(c)]) for c in there]


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of the cells round their centres."""
    if centres.size == 1:
        half = 0.05 * abs(float(centres[0])) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _contours(ax: Axes, x: np.ndarray, y: np.ndarray, amplitude: xarray.DataArray) -> list[Any]:
    """Lines of equal amplitude, with what they are lines of for the legend."""
    unit, factor = readable(str(amplitude.attrs.get("units", "")))
    values = np.where(amplitude.values > 0, factor * amplitude.values, np.nan)
    if min(values.shape) < 2 or not np.any(np.isfinite(values)) or np.nanmax(values) <= np.nanmin(values):
        return []
    style: dict[str, Any] = {"linewidth": 0.6, "color": "#444444"}
    lines = ax.contour(x, y, values, levels=_MOST_CONTOURS, colors=style["color"], linewidths=style["linewidth"])
    ax.clabel(lines, fontsize=6, fmt=lambda v: f"{v:.3g} {unit}")
    name = words(str(amplitude.attrs.get("long_name", "amplitude")).partition(" (")[0])
    return [Line2D([], [], **style, label=with_unit(name, unit))]


def _boundary(ax: Axes, x: np.ndarray, y: np.ndarray, outcome: xarray.DataArray, label: str, colour: str) -> list[Any]:
    """Dashed line round the cells with a stable cycle."""
    inside = np.asarray(outcome.values == Outcome.OSCILLATES, float)
    if min(inside.shape) < 2 or inside.min() == inside.max():
        return []
    ax.contour(x, y, inside, levels=[0.5], colors=[colour], linestyles="--", linewidths=1.6)
    return [Line2D([], [], color=colour, linestyle="--", linewidth=1.6, label=label)]


def _reach(ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    for values, limits in ((x, ax.set_xlim), (y, ax.set_ylim)):
        edges = _edges(values)
        limits(float(edges.min()), float(edges.max()))


def plot_slices(
    dataset: xarray.Dataset,
    x: str | None = None,
    by: str | None = None,
    *,
    variables: Sequence[str] = ("amplitude", "frequency"),
    at: Mapping[str, int] | None = None,
) -> Figure:
    """Results over one axis of a sweep, a line for each of some values of another axis.

    Where the sweep has predictions or exact cycles, they are drawn beside the run: dashed and dotted, in its colour.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep.sweep`, over a grid (or a sample over one parameter).
    x : str, optional
        Axis of the picture; by default the last dimension.
    by : str, optional
        Axis whose values get a line each (at most six, spread evenly); by default the first other dimension, if any.
    variables : sequence of str
        One panel each.
    at : mapping of str to int, optional
        Place along every dimension that is neither; the first one by default.

    Raises
    ------
    EppError
        If the dataset has no such axis, or no such results.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> axes = {"bands.range": "2:3:2:lbf", "lock_pin.backlash": "0.5:2.5:3:deg"}
    >>> figure = plot_slices(epp.sweep(epp.case("fig8a_original"), axes, progress=False))
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['amplitude [deg]', 'frequency [Hz]']
    """
    dims = [str(d) for d in dataset.dims if d in dataset.coords]
    if not dims:
        raise EppError("Slices need an axis; expected a sweep over a grid (a sample has none).")
    x = x or dims[-1]
    by = by or next((d for d in dims if d != x), None)
    if not len(variables):
        raise EppError("plot_slices: variables is empty; expected one or more.")
    for name in (x, *([by] if by else [])):
        if name not in dims:
            raise EppError(f"There is no axis {name!r} in the sweep; expected one of {', '.join(dims)}.")
    shown = [[p + v for p in ("", "predicted_", "exact_") if p + v in dataset] for v in variables]
    for name, found in zip(variables, shown, strict=True):
        if not found:
            raise EppError(f"The sweep has no {name}; expected one of {', '.join(map(str, dataset.data_vars))}.")
    others = {d: int((at or {}).get(d, 0)) for d in dims if d not in (x, by)}
    plane = dataset.isel(others)
    figure = Figure(figsize=(6.4, 0.8 + 2.4 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    across, label = _readable(plane, x)
    for ax, names, variable in zip(panels, shown, variables, strict=True):
        _slices(ax, plane, across, by, names)
        ax.set_ylabel(with_unit(words(variable), readable(str(plane[names[0]].attrs.get("units", "")))[0]))
        ax.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel(label)
    _slice_legend(panels[0], plane, by, [n for names in shown for n in names])
    places = ", ".join(f"{d.replace('_', ' ')} = {_place(dataset, d, i)}" for d, i in others.items())
    _put_verdict(figure, plane, places)
    return figure


def _chosen_places(dataset: xarray.Dataset, by: str | None) -> list[int]:
    n = 1 if by is None else dataset.sizes[by]
    return sorted({round(i) for i in np.linspace(0, n - 1, min(n, _MOST_SLICES))})


def _slice_colours(n: int) -> list[Any]:
    """Dark to light, so that neighbours and print in grey keep apart."""
    return [colormaps["cividis"](0.65 * i / max(n - 1, 1)) for i in range(n)]


def _slices(ax: Axes, plane: xarray.Dataset, across: np.ndarray, by: str | None, names: Sequence[str]) -> None:
    places = _chosen_places(plane, by)
    drawn = []
    for colour, place in zip(_slice_colours(len(places)), places, strict=True):
        cells = plane if by is None else plane.isel({by: place})
        for name in names:
            _, factor = readable(str(cells[name].attrs.get("units", "")))
            method = _method(name)
            outcome = cells.get("outcome" if method == "run" else f"{method}_outcome")
            drawn.append(factor * cells[name].values)
            x, y = _broken(across, drawn[-1], None if outcome is None else outcome.values)
            style: dict[str, Any] = {"color": colour, "linestyle": _DASHES[method], "linewidth": 1.3}
            ax.plot(x, y, **style, marker=_MARKERS[method], markersize=5)
    show_constant(ax, *drawn)


def _broken(x: np.ndarray, y: np.ndarray, outcome: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """A curve that is broken where the outcome changes: between rest and a cycle there is a jump, no slope."""
    if outcome is None:
        return x, y
    jumps = np.flatnonzero(np.diff(outcome)) + 1
    return np.insert(np.asarray(x, float), jumps, 0.5 * (x[jumps - 1] + x[jumps])), np.insert(y, jumps, np.nan)


def _method(name: str) -> str:
    return next((p for p in ("predicted", "exact") if name.startswith(f"{p}_")), "run")


def _slice_legend(ax: Axes, plane: xarray.Dataset, by: str | None, names: Sequence[str]) -> None:
    places = _chosen_places(plane, by)
    handles = []
    if by is not None:
        for colour, place in zip(_slice_colours(len(places)), places, strict=True):
            handles.append(Line2D([], [], color=colour, label=f"{words(by)} {_place(plane, by, place)}"))
    methods = list(dict.fromkeys(map(_method, names)))
    if len(methods) > 1:
        style: dict[str, Any] = {"color": GREY, "markersize": 5}
        handles += [Line2D([], [], linestyle=_DASHES[m], marker=_MARKERS[m], label=m, **style) for m in methods]
    if handles:
        ax.legend(handles=handles, fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def plot_parallel(
    dataset: xarray.Dataset, variables: Sequence[str] = ("amplitude", "frequency"), *, most: int = 2000
) -> Figure:
    """Parallel coordinates: a line for each cell through its parameters and its results, by outcome.

    For more than two axes, and for samples. What oscillates is drawn solid and on top, what settles dotted.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep.sweep`.
    variables : sequence of str
        Results, to the right of the parameters.
    most : int
        Of more cells than these, so many are drawn, spread evenly.

    Raises
    ------
    EppError
        If the dataset has no outcome, or no such results.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> ranges = {"bands.range": "1:5:lbf", "lock_pin.backlash": "0:3:deg", "forearm.inertia": (0.03, 0.06)}
    >>> found = epp.sweep(epp.case("fig8a_original"), epp.Sobol(ranges, 8), progress=False)
    >>> len(plot_parallel(found).axes[0].collections)
    2
    """
    check_counts("plot_parallel", {"most": (most, 1)})
    outcome = next((n for n in _BORDERS if n in dataset), None)
    if outcome is None:
        raise EppError("The dataset has no outcome to draw; expected the result of a sweep.")
    if missing := [name for name in variables if name not in dataset]:
        raise EppError(f"The sweep has no {missing[0]}; expected one of {', '.join(map(str, dataset.data_vars))}.")
    cells, columns, labels = _flat(dataset, variables, outcome, most)
    low, high = np.array([_span(column) for column in columns.T]).T
    with np.errstate(invalid="ignore"):
        shares = np.where(high > low, (columns - low) / np.where(high > low, high - low, 1.0), 0.5)
    figure = Figure(figsize=(1.2 + 1.35 * columns.shape[1], 4.2), layout="constrained")
    ax = figure.add_subplot()
    meanings = _meanings(dataset[outcome])
    handles = []
    for code in sorted(np.unique(cells).tolist(), key=lambda c: c == Outcome.OSCILLATES):
        rows = shares[cells == code]
        lines = [np.column_stack([np.arange(row.size), row])[np.isfinite(row)] for row in rows]
        colour, dashes = _PARALLEL_COLOURS[code], _PARALLEL_LINES[code]
        opacity = min(1.0, 0.25 + 20.0 / len(lines))
        ax.add_collection(LineCollection(lines, colors=colour, linewidths=0.8, linestyles=dashes, alpha=opacity))
        text = f"{meanings[code]} ({len(rows)})"
        handles.append(Line2D([], [], color=colour, linewidth=1.8, linestyle=dashes, label=text))
    _parallel_axes(ax, low, high, labels)
    ax.legend(handles=handles, fontsize=9, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
    _put_verdict(figure, dataset)
    if dataset[outcome].size > cells.size:
        ax.set_title(f"{cells.size} of {dataset[outcome].size} cells", fontsize=8, loc="right")
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
        values, label = _readable(dataset, name)
        columns.append(values[place[dim]])
        labels.append(label.replace(" [", "\n["))
    for name in variables:
        unit, factor = readable(str(dataset[name].attrs.get("units", "")))
        columns.append(factor * dataset[name].values.ravel()[chosen])
        labels.append(with_unit(words(name), unit).replace(" [", "\n["))
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
            place: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "va": side, "fontsize": 8}
            ax.annotate(text, (i, share), (0, shift), **place)
    ax.set(xlim=(-0.3, len(labels) - 0.7), ylim=(-0.09, 1.09), yticks=[])
    ax.set_xticks(range(len(labels)), labels, fontsize=8)
    ax.spines[["top", "right", "left", "bottom"]].set_visible(False)
    ax.tick_params(axis="x", length=0)


def plot_boundary(boundary: Boundary, ax: Axes | None = None) -> Figure:
    """A boundary in the plane of its two parameters."""
    figure, ax = place_of(ax, (5.2, 3.6))
    (x_label, x), (y_label, y) = (label_of(name, boundary.units, boundary.readable) for name in boundary.axes)
    few: dict[str, Any] = {"marker": "."} if len(boundary.points) < _FEW else {}
    ax.plot(x * boundary.points[:, 0], y * boundary.points[:, 1], color=BLUE, linewidth=1.4, **few)
    ax.set(xlabel=x_label, ylabel=y_label)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def plot_sweep(dataset: xarray.Dataset, curves: Sequence[Boundary] = ()) -> Figure:
    """The picture that suits a sweep: a map of two axes, slices of one, parallel coordinates of more and of samples.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep.sweep`.
    curves : sequence of Boundary
        For a map.

    Raises
    ------
    EppError
        If there is nothing to draw.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> relay = epp.case("relay_deadzone")
    >>> cells = epp.sweep(relay, {"relay_dead_zone.threshold": [0.5, 1.0]}, run="predict", progress=False)
    >>> plot_sweep(cells).axes[-1].get_xlabel()
    'relay dead zone threshold'
    """
    axes, dims = list(dataset.coords), [d for d in dataset.dims if d in dataset.coords]
    if len(axes) == len(dims) == 2:
        return plot_design_map(dataset, curves=curves)
    prefix = next((p for p in ("", "exact_", "predicted_") if f"{p}outcome" in dataset), "")
    if len(axes) == len(dims) == 1:
        return plot_slices(dataset)
    return plot_parallel(dataset, [f"{prefix}amplitude", f"{prefix}frequency"])
