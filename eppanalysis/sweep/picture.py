"""Pictures of sweeps: design maps with boundaries on top, slices, parallel coordinates. Computes nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import xarray
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.plotting import (
    BLUE,
    DARK_SKY,
    GREEN,
    GREY,
    ORANGE,
    SMALL,
    VERMILLION,
    figure_of_height,
    label_of,
    label_up,
    place_of,
    put_legend,
    show_constant,
)
from eppanalysis.readable import readable, with_unit, words
from eppanalysis.sweep.analyses import Allowance, Outcome
from eppanalysis.sweep.boundary import Boundary
from eppanalysis.sweep.labels import (
    factor_of,
    is_sized,
    meanings,
    outcomes_in,
    place_in,
    put_verdict_of,
    readable_axis,
)
from eppanalysis.sweep.parallel import plot_parallel

#: Colours of unknown, settles, oscillates, diverges: apart in brightness as well as in hue.
OUTCOME_COLOURS = ("#BDBDBD", "#DCEBF5", ORANGE, VERMILLION)
#: Of unknown, settles, within what is allowed, exceeds it, diverges: what is as good as rest is blue as rest is.
_ALLOWANCE_COLOURS = ("#BDBDBD", "#DCEBF5", "#9ACBEE", ORANGE, VERMILLION)
#: Dashed lines round cells that oscillate, or exceed what is allowed, by what says so.
_BORDERS = {
    "outcome": ("runs oscillate", ORANGE),
    "exact_outcome": ("exact orbits exist", GREEN),
    "predicted_outcome": ("describing function", BLUE),
    "allowed": ("runs exceed it", ORANGE),
    "exact_allowed": ("exact orbits exceed it", GREEN),
    "predicted_allowed": ("describing function exceeds it", BLUE),
}
#: The line at the size that is allowed.
_MOST: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.0, "linestyle": "-."}
_LINE_COLOURS = ("#000000", BLUE, GREEN, DARK_SKY, GREY)
_LINES = ("-", "--", "-.", ":")
#: Of the stretches of a region's border, by kind.
_KIND_COLOURS = (BLUE, VERMILLION, GREEN, DARK_SKY, "#000000")
#: Curves of fewer points show each of them.
_FEW = 60
_MOST_CONTOURS, _MOST_SLICES = 6, 6
#: Shares of a map's width and height: how far labels of contours stay from the frame and from each other, and how long
#: a line is that has one.
_FROM_FRAME, _APART, _LABELLED = 0.12, 0.2, 0.2
#: Lines of slices by method.
_DASHES: dict[str, Literal["-", "--", ":"]] = {"run": "-", "predicted": "--", "exact": ":"}
#: Height of a panel of slices [inch].
_SLICES = 2.0
#: Variables that are those of the signal of the case, and the mark at the foot of cells that no curve has.
_OF_SIGNAL = ("peak_to_peak", "mean", "size")
_UNKNOWN: dict[str, Any] = {"color": GREY, "marker": "x", "markersize": 6, "linestyle": "none", "clip_on": False}
#: A marker at every cell, for a curve may be broken on both sides of one.
_MARKERS = {"run": ".", "predicted": "x", "exact": "+"}


def plot_design_map(
    dataset: xarray.Dataset,
    x: str | None = None,
    y: str | None = None,
    *,
    at: Mapping[str, int] | None = None,
    lines: bool = True,
    curves: Sequence[Boundary] | Mapping[str, tuple[Any, Any]] = (),
    ax: Axes | None = None,
) -> Figure:
    """Where a design settles and where it oscillates, over two axes of a sweep.

    Shaded regions are outcomes, or what is proved, thin lines the peak to peak of the cycle. Where the sweep has
    predictions, the describing function's boundary is dashed; curves from elsewhere are drawn on top. Where a limit
    cycle is allowed, regions and dashed lines say what exceeds it, thin lines the size that is compared.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep`, over a grid.
    x, y : str, optional
        Axes of the picture; by default the last two dimensions, the last one upwards.
    at : mapping of str to int, optional
        Place along every other dimension; the first one by default.
    lines : bool
        Whether to draw lines of equal peak to peak.
    curves : sequence of Boundary, or mapping of str to (x values, y values)
        Boundaries of :func:`eppanalysis.outcome_boundary` and :func:`eppanalysis.free_region`, or curves by their
        name in the legend, in SI units.
    ax : matplotlib.axes.Axes, optional
        Where to draw, without the name of the case; a figure of its own by default.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    EppError
        If the dataset has no such axes, or no outcome.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> axes = {"bands.range": "2:3:2:lbf", "lock_pin.backlash": "0.5:2.5:2:deg"}
    >>> figure = epp.plot_design_map(
    ...     epp.sweep(epp.case("fig8a_original"), axes, progress=False)
    ... )
    >>> figure.axes[0].get_xlabel()
    'bands range [lbf]'
    """
    x, y = _axes_of(dataset, x, y)
    names = [n for n in ("proved", *outcomes_in(dataset)) if n in dataset]
    if not names:
        raise EppError("The dataset has no outcome to draw; expected the result of a sweep.")
    others = {d: int((at or {}).get(d, 0)) for d in map(str, dataset[names[0]].dims) if d not in (x, y)}
    plane = dataset.isel(others).transpose(y, x)
    if ax is None:
        figure: Any
        figure, ax = place_of(None, 4.0)
        put_verdict_of(figure, plane)
    else:
        figure = ax.figure
    (across, x_label), (up, y_label) = (readable_axis(plane, name) for name in (x, y))
    handles = _regions(ax, across, up, plane[names[0]])
    if lines and _size_of(dataset) in plane:
        handles += _contours(ax, across, up, plane[_size_of(dataset)])
    for name in names[1:]:
        handles += _boundary(ax, across, up, plane[name], *_BORDERS[name])
    handles += _curves(ax, plane, x, y, curves)
    places = ", ".join(f"{words(d)} = {place_in(dataset, d, i)}" for d, i in others.items())
    ax.set(xlabel=x_label + f"\nat {places}" * bool(places), ylabel=y_label)
    _reach(ax, across, up)
    put_legend(ax, handles)
    return figure


def _size_of(dataset: xarray.Dataset) -> str:
    """The variable that says how large a cycle is."""
    return "size" if is_sized(dataset) else "peak_to_peak"


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
    if isinstance(curves, Mapping):
        named = [(label, places, True) for label, places in curves.items()]
    else:
        named = [_named(c, x, y) for c in curves]
    handles = []
    for i, (label, (xs, ys), is_marked) in enumerate(named):
        across, up = np.asarray(xs) * factor_of(plane, x), np.asarray(ys) * factor_of(plane, y)
        style: dict[str, Any] = {"color": _LINE_COLOURS[i % len(_LINE_COLOURS)], "linestyle": _LINES[i % len(_LINES)]}
        if across.size < _FEW and is_marked:
            style |= {"marker": "o", "markersize": 3.5}
        handles += ax.plot(across, up, linewidth=1.8, label=label, **style)
    return handles


def _named(curve: Boundary, x: str, y: str) -> tuple[str, tuple[np.ndarray, np.ndarray], bool]:
    """A boundary with its name in the legend, and whether few points of it are marked.

    Of a region without the ends of the ranges, where the map ends, too.
    """
    if not curve.kinds:
        return curve.label, curve.over(x, y), True
    border = replace(curve, points=np.column_stack(curve.stretches({*curve.kinds} - {Turn.EDGE})))
    return f"exact border: {curve.label}", border.over(x, y), False


def _regions(ax: Axes, x: np.ndarray, y: np.ndarray, outcome: xarray.DataArray) -> list[Any]:
    means = meanings(outcome)
    shades = _ALLOWANCE_COLOURS if len(means) == len(Allowance) else OUTCOME_COLOURS
    colours = ListedColormap(shades[: len(means)])
    norm = BoundaryNorm(np.arange(len(means) + 1) - 0.5, len(means))
    ax.pcolormesh(_edges(x), _edges(y), outcome.values, cmap=colours, norm=norm, rasterized=True)
    there = np.unique(outcome.values)
    return [Patch(facecolor=shades[int(c)], edgecolor=GREY, label=means[int(c)]) for c in there]


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of the cells round their centres."""
    if centres.size == 1:
        half = 0.05 * abs(float(centres[0])) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _contours(ax: Axes, x: np.ndarray, y: np.ndarray, size: xarray.DataArray) -> list[Any]:
    """Lines of cycles of equal size, with what they are lines of for the legend."""
    unit, factor = readable(str(size.attrs.get("units", "")))
    values = np.where(size.values > 0, factor * size.values, np.nan)
    if min(values.shape) < 2 or not np.any(np.isfinite(values)) or np.nanmax(values) <= np.nanmin(values):
        return []
    style: dict[str, Any] = {"linewidth": 0.8, "color": "#000000"}
    lines = ax.contour(x, y, values, levels=_MOST_CONTOURS, colors=style["color"], linewidths=style["linewidth"])
    places = _label_places(lines.allsegs, np.array([x.min(), y.min()]), np.array([np.ptp(x), np.ptp(y)]))
    if places:
        ax.clabel(lines, fontsize=SMALL, fmt=lambda v: f"{v:.3g} {unit}".rstrip(), manual=places)
    name = words(str(size.attrs.get("long_name", "peak to peak")).partition(" (")[0])
    return [Line2D([], [], **style, label=with_unit(name, unit))]


def _label_places(levels: Sequence[Sequence[np.ndarray]], low: np.ndarray, width: np.ndarray) -> list[tuple[Any, Any]]:
    """Where each level's longest line is labelled: far from the frame and from other labels, else nowhere."""
    places: list[np.ndarray] = []
    for lines in levels:
        line = max(((np.asarray(part) - low) / width for part in lines), key=_length, default=np.zeros((0, 2)))
        inside = np.all(np.abs(line - 0.5) < 0.5 - _FROM_FRAME, axis=1)
        apart = [np.linalg.norm(line - place, axis=1) > _APART for place in places]
        free = line[np.all([inside, *apart], axis=0)]
        if _length(line) > _LABELLED and free.size:
            places.append(free[len(free) // 2])
    return [tuple(low + width * place) for place in places]


def _length(line: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _boundary(ax: Axes, x: np.ndarray, y: np.ndarray, outcome: xarray.DataArray, label: str, colour: str) -> list[Any]:
    """Dashed line round the cells with a stable cycle, or with one larger than allowed."""
    there = Outcome.OSCILLATES if str(outcome.name).endswith("outcome") else Allowance.EXCEEDS
    inside = np.asarray(outcome.values == there, float)
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
    variables: Sequence[str] | None = None,
    at: Mapping[str, int] | None = None,
) -> Figure:
    """Results over one axis of a sweep, a line for each of some values of another axis.

    Where the sweep has predictions or exact cycles, they are drawn beside the run: dashed and dotted, in its colour.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep`, over a grid (or a sample over one parameter).
    x : str, optional
        Axis of the picture; by default the last dimension.
    by : str, optional
        Axis whose values get a line each (at most six, spread evenly); by default the first other dimension, if any.
    variables : sequence of str, optional
        One panel each; by default peak to peak and frequency, and where a limit cycle is allowed the size that is
        compared in place of the peak to peak.
    at : mapping of str to int, optional
        Place along every dimension that is neither; the first one by default.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    EppError
        If the dataset has no such axis, or no such results.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> axes = {"bands.range": "2:3:2:lbf", "lock_pin.backlash": "0.5:2.5:3:deg"}
    >>> figure = epp.plot_slices(
    ...     epp.sweep(epp.case("fig8a_original"), axes, progress=False)
    ... )
    >>> [" ".join(ax.get_ylabel().split()) for ax in figure.axes]
    ['peak to peak of theta [deg]', 'frequency [Hz]']
    """
    dims = [str(d) for d in dataset.dims if d in dataset.coords]
    if not dims:
        raise EppError("Slices need an axis; expected a sweep over a grid (a sample has none).")
    x = x or dims[-1]
    by = by or next((d for d in dims if d != x), None)
    variables = (_size_of(dataset), "frequency") if variables is None else variables
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
    figure = figure_of_height(0.8 + _SLICES * len(shown))
    panels = figure.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    across, label = readable_axis(plane, x)
    unknown = _unknown(plane, by)
    for ax, names, variable in zip(panels, shown, variables, strict=True):
        _slices(ax, plane, across, by, names)
        of = (
            f" of {words(str(dataset.attrs['signal']))}" if variable in _OF_SIGNAL and "signal" in dataset.attrs else ""
        )
        unit = readable(str(plane[names[0]].attrs.get("units", "")))[0]
        label_up(ax, with_unit(f"{words(variable)}{of}", unit), _SLICES)
        if unknown.size:
            ax.plot(across[unknown], 0.0 * across[unknown], **_UNKNOWN, transform=ax.get_xaxis_transform())
        ax.spines[["top", "right"]].set_visible(False)
        if variable == "size" and is_sized(dataset):
            most = readable(str(plane[names[0]].attrs.get("units", "")))[1] * float(dataset.attrs["allowed_size"])
            ax.axhline(most, **_MOST, zorder=1)
    panels[-1].set_xlabel(label)
    _slice_legend(panels[0], plane, by, [n for names in shown for n in names], unknown.size > 0)
    places = ", ".join(f"{words(d)} = {place_in(dataset, d, i)}" for d, i in others.items())
    put_verdict_of(figure, plane, places)
    return figure


def _chosen_places(dataset: xarray.Dataset, by: str | None) -> list[int]:
    n = 1 if by is None else dataset.sizes[by]
    return sorted({round(i) for i in np.linspace(0, n - 1, min(n, _MOST_SLICES))})


def _unknown(plane: xarray.Dataset, by: str | None) -> np.ndarray:
    """Where on the axis of the slices a run that is drawn neither settles nor repeats itself."""
    if "outcome" not in plane:
        return np.zeros(0, int)
    outcome = plane["outcome"] if by is None else plane["outcome"].transpose(by, ...)[_chosen_places(plane, by)]
    return np.flatnonzero(np.any(np.atleast_2d(outcome.values) == 0, axis=0))


def _slice_colours(n: int) -> list[Any]:
    """Dark to light, so that neighbours and print in grey keep apart, and the lightest is still seen on paper."""
    return [colormaps["cividis"](0.6 * i / max(n - 1, 1)) for i in range(n)]


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


def _slice_legend(ax: Axes, plane: xarray.Dataset, by: str | None, names: Sequence[str], unknown: bool) -> None:
    places = _chosen_places(plane, by)
    handles = []
    if by is not None:
        for colour, place in zip(_slice_colours(len(places)), places, strict=True):
            handles.append(Line2D([], [], color=colour, label=f"{words(by)} {place_in(plane, by, place)}"))
    methods = list(dict.fromkeys(map(_method, names)))
    if len(methods) > 1:
        style: dict[str, Any] = {"color": GREY, "markersize": 5}
        handles += [Line2D([], [], linestyle=_DASHES[m], marker=_MARKERS[m], label=m, **style) for m in methods]
    if is_sized(plane):
        handles.append(Line2D([], [], **_MOST, label="allowed"))
    if unknown:
        handles.append(Line2D([], [], **_UNKNOWN, label="unknown"))
    put_legend(ax, handles)


def plot_boundary(boundary: Boundary, ax: Axes | None = None) -> Figure:
    """A boundary in the plane of its two parameters; of a region, each stretch by its kind."""
    figure, ax = place_of(ax, 3.4 if not boundary.kinds else 4.0)
    (x_label, x), (y_label, y) = (label_of(name, boundary.units, boundary.readable) for name in boundary.axes)
    points = boundary.points * [x, y]
    if boundary.kinds:
        _draw_region(ax, boundary, (x, y))
        across, up = np.array(boundary.within) * [[x], [y]]
        ax.set(xlim=across, ylim=up)
    else:
        few: dict[str, Any] = {"marker": "."} if len(points) < _FEW else {}
        ax.plot(*points.T, color=BLUE, linewidth=1.4, **few)
    ax.set(xlabel=x_label, ylabel=y_label)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_region(ax: Axes, region: Boundary, factors: tuple[float, float]) -> None:
    """A region with its border, each stretch in the colour and line of its kind."""
    points, kinds = region.points * factors, region.kinds
    gaps = np.flatnonzero(np.isnan(points[:, 0]))
    curves = [c[np.isfinite(c[:, 0])] for c in np.split(points, gaps)]
    if all(np.array_equal(c[0], c[-1]) for c in curves):
        whole = Path.make_compound_path(*map(Path, curves))
        ax.add_patch(PathPatch(whole, facecolor=OUTCOME_COLOURS[1], edgecolor="none"))
    there = [kind for kind in dict.fromkeys(kinds) if kind]
    handles: list[Any] = [Patch(facecolor=OUTCOME_COLOURS[1], edgecolor=GREY, label=region.label)]
    for i, kind in enumerate(sorted(there, key=lambda kind: kind == Turn.EDGE)):
        line = np.column_stack(region.stretches([kind])) * factors
        style: dict[str, Any] = {"color": _KIND_COLOURS[i % len(_KIND_COLOURS)], "linestyle": _LINES[i % len(_LINES)]}
        style |= {"linewidth": 1.6} if kind != Turn.EDGE else {"linewidth": 0.8, "color": GREY, "linestyle": "-"}
        handles += ax.plot(*line.T, label=kind, **style)
    put_legend(ax, handles)


def plot_sweep(dataset: xarray.Dataset, curves: Sequence[Boundary] = ()) -> Figure:
    """The picture that suits a sweep: a map of two axes, slices of one, parallel coordinates of more and of samples.

    Parameters
    ----------
    dataset : xarray.Dataset
        From :func:`eppanalysis.sweep`.
    curves : sequence of Boundary
        For a map.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    EppError
        If there is nothing to draw.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> relay = epp.case("relay_deadzone")
    >>> cells = epp.sweep(
    ...     relay,
    ...     {"relay_dead_zone.threshold": [0.5, 1.0]},
    ...     run="predict",
    ...     progress=False,
    ... )
    >>> epp.plot_sweep(cells).axes[-1].get_xlabel()
    'relay dead zone threshold'
    """
    axes, dims = list(dataset.coords), [d for d in dataset.dims if d in dataset.coords]
    if len(axes) == len(dims) == 2:
        return plot_design_map(dataset, curves=curves)
    prefix = next((p for p in ("", "exact_", "predicted_") if f"{p}outcome" in dataset), "")
    if len(axes) == len(dims) == 1:
        return plot_slices(dataset)
    return plot_parallel(dataset, [f"{prefix}{_size_of(dataset)}", f"{prefix}frequency"])
