"""Results to pictures: labelled with units, readable without colour vision, ready for print. Computes nothing."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from eppanalysis.errors import EppError, shown
from eppanalysis.readable import count, readable, with_unit, words
from eppanalysis.results import Status

if TYPE_CHECKING:
    from eppanalysis.methods.continuation import Branch
    from eppanalysis.methods.ladder import Ladder
from eppanalysis.results import LimitCycle, Prediction, Trajectory

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complexfloating[Any, Any]]

#: Colours that stay apart under every form of colour blindness (Okabe and Ito, "Color Universal Design", 2008).
BLUE, VERMILLION, GREEN, ORANGE, SKY, GREY = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#7F7F7F",
)
_STABILITY = {True: "stable", False: "unstable", None: "stability unknown"}
#: More marks than these merge into a bar that says nothing.
_MOST_MARKS = 300
_PANEL_WIDTH, _PANEL_HEIGHT = 5.2, 1.5  # inches
#: What varies by less than this share of itself is a constant, whose digits are rounding errors.
_CONSTANT = 1e-6
#: Half height of the axis around a constant, relative to it.
_AROUND = 0.05
#: What a system is called that was given no name.
_UNNAMED = "loop"
#: What the shaded part of a run is.
_STEADY = {Status.SETTLED: "at rest", Status.LIMIT_CYCLE: "on the limit cycle"}


def with_name(text: str, subject: str) -> str:
    """A title with the case or the system in front that a result is of, where it has a name."""
    # A loop that nobody named has no name to show; a dollar would begin a formula.
    name = "" if subject == _UNNAMED else subject.replace("$", r"\$")
    return f"{name}: {text}" if name and text else name or text


def show_constant(ax: Axes, *curves: Array) -> None:
    """Draw what is constant but for rounding as a flat line, on an axis around it; no axis counts from an offset."""
    ax.ticklabel_format(axis="y", useOffset=False)
    values = np.concatenate([np.ravel(curve) for curve in curves] or [np.zeros(0)])
    values = values[np.isfinite(values)]
    largest = float(np.abs(values).max()) if values.size else 0.0
    if largest > 0.0 and np.ptp(values) < _CONSTANT * largest:
        middle = float(values.mean())
        ax.set_ylim(middle - _AROUND * largest, middle + _AROUND * largest)


def plot_trajectory(trajectory: Trajectory, signals: Sequence[str] | None = None) -> Figure:
    """Signals against time, one panel each; grey marks at the foot are events, shaded is where the run is steady.

    Angles are in degrees, lengths in millimetres.

    Parameters
    ----------
    trajectory : Trajectory
    signals : sequence of str, optional
        Which signals, in this order; all by default.

    Raises
    ------
    EppError
        If the trajectory has no such signal.
    """
    names = _chosen(trajectory.signals, signals)
    figure, panels = _panels(len(names))
    times = np.array([event.time for event in trajectory.events])
    for name, ax in zip(names, panels, strict=True):
        label, factor = _shown(name, trajectory.units)
        values = factor * trajectory.signals[name]
        ax.plot(trajectory.t, values, color=BLUE, linewidth=1.0)
        show_constant(ax, values)
        ax.set_ylabel(label)
        _mark_events(ax, times)
        if np.isfinite(trajectory.settled_since) and trajectory.t.size:
            steady: dict[str, Any] = {"color": SKY, "alpha": 0.18, "linewidth": 0}
            text = f"{_STEADY.get(trajectory.status, 'steady')} (from {trajectory.settled_since:.3g} s on)"
            ax.axvspan(trajectory.settled_since, float(trajectory.t[-1]), **steady, label=text)
    _label_time(panels, "time [s]")
    _legend_below(figure, panels[0])
    figure.suptitle(with_name(trajectory.status.value, trajectory.provenance.subject), fontsize=10)
    return figure


def plot_limit_cycle(cycle: LimitCycle, signals: Sequence[str] | None = None) -> Figure:
    """One period of a limit cycle, one panel a signal, with its mean (dashed) and its switches (grey marks).

    Angles are in degrees, lengths in millimetres.

    Parameters
    ----------
    cycle : LimitCycle
    signals : sequence of str, optional
        Which signals, in this order; all by default.

    Raises
    ------
    EppError
        If the cycle has no such signal.
    """
    time, waveform = _one_period(cycle)
    names = _chosen(waveform, signals)
    figure, panels = _panels(len(names))
    switches = np.array([event.time for event in cycle.events if event.time <= cycle.period])
    for name, ax in zip(names, panels, strict=True):
        label, factor = _shown(name, cycle.units)
        values = factor * np.asarray(waveform[name])
        ax.plot(time, values, color=BLUE, linewidth=1.2)
        ax.axhline(factor * cycle.mean[name], color=GREY, linewidth=0.8, linestyle="--", label="mean")
        show_constant(ax, values)
        ax.set_ylabel(label)
        _mark_events(ax, switches)
    _label_time(panels, "time within the period [s]")
    _legend_below(figure, panels[0])
    text = f"{cycle.method}, {cycle.frequency:.4g} Hz, {_STABILITY[cycle.stable]}"
    figure.suptitle(with_name(text, cycle.provenance.subject), fontsize=10)
    return figure


def plot_nyquist(prediction: Prediction, ax: Axes | None = None) -> Figure:
    """Nyquist picture: the loop's response, the -1/N locus with growing amplitude, and the cycles where they meet.

    A filled circle is a stable cycle, an open one any other. Loops with several elements have no single -1/N locus; for
    them the picture is the loop gain over the amplitude at the principal element, cut there, at the frequency at which
    the loop's phase closes and with all other balances met. A cycle is where it is one: where it rises with amplitude
    an oscillation grows away from the cycle, where it falls it returns to it.

    Parameters
    ----------
    prediction : Prediction
    ax : matplotlib.axes.Axes, optional
        Where to draw, without the name of the case; a figure of its own by default.
    """
    own = ax is None
    if ax is None:
        figure = Figure(figsize=(5.6, 5.0), layout="constrained")
        ax = figure.add_subplot()
    else:
        figure = _root_figure(ax)
    if prediction.curves.get("kind") == "nyquist":
        _draw_nyquist(ax, prediction)
    else:
        _draw_loop_gain(ax, prediction)
    text = f"{count(len(prediction), 'limit cycle')} predicted"
    ax.set_title(with_name(text, prediction.provenance.subject if own else ""), fontsize=10)
    return figure


def plot_ladder(ladder: Ladder) -> Figure:
    """The run in time, its steady motion with the predicted cycle over it, and the picture of the prediction.

    Two signals are drawn: the ladder's own, and the force that the controller reads (or the next signal that there is).

    Parameters
    ----------
    ladder : Ladder
    """
    others = [name for name in ladder.run.signals if name != ladder.signal]
    second = "sensor_force" if "sensor_force" in others else others[0] if others else None
    names = [ladder.signal] if second is None else [ladder.signal, second]
    n = len(names)
    figure = Figure(figsize=(7.6, 4.2 + 2.0 * n), layout=ConstrainedLayoutEngine(wspace=0.08))
    grid = figure.add_gridspec(2 * n, 2, height_ratios=[1.0] * n + [2.6 / n] * n)
    runs = [figure.add_subplot(grid[i, :]) for i in range(n)]
    close = [figure.add_subplot(grid[n + i, 0]) for i in range(n)]
    for name, ax in zip(names, runs, strict=True):
        label, factor = _shown(name, ladder.run.units)
        ax.plot(ladder.run.t, factor * ladder.run.signals[name], color=BLUE, linewidth=0.7)
        ax.set_ylabel(label)
    draw = _draw_steady if ladder.run.limit_cycle is not None else _draw_begin
    for name, ax in zip(names, close, strict=True):
        draw(ax, ladder, name)
    for panels, text in ((runs, "time [s]"), (close, "time [s]")):
        _label_time(panels, text)
    for ax in close:
        ax.xaxis.set_major_locator(MaxNLocator(5))
    for ax in (*runs, *close):
        ax.spines[["top", "right"]].set_visible(False)
    close[0].legend(fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False, borderaxespad=0.2)
    _draw_prediction(figure.add_subplot(grid[n:, 1]), ladder.prediction)
    text = with_name(ladder.verdict, ladder.provenance.subject)
    figure.suptitle(textwrap.fill(text, 108), fontsize=9, x=0.01, ha="left")
    return figure


def _draw_steady(ax: Axes, ladder: Ladder, name: str) -> None:
    """Two periods of the run's cycle (a few swings of a long one); predicted and balanced in phase in the middle."""
    cycle = ladder.run.limit_cycle
    assert cycle is not None
    label, factor = _shown(name, ladder.run.units)
    time, waveform = _one_period(cycle)
    both = np.concatenate([time, time + cycle.period])
    ax.plot(both, factor * np.tile(waveform[name], 2), color=BLUE, linewidth=1.3, label="simulated")
    if ladder.matched is not None and ladder.prediction is not None:
        guess = ladder.prediction[ladder.matched]
        ax.plot(both, factor * _in_phase(ladder, guess, name, both), "--", color=VERMILLION, lw=1.3, label="predicted")
    balance = ladder.balance
    if balance is not None:
        ax.plot(both, factor * _in_phase(ladder, balance, name, both), ":", color=ORANGE, lw=1.6, label="balanced")
    if ladder.swings > 2:
        half = 2.0 * cycle.period / ladder.swings
        ax.set_xlim(cycle.period - half, cycle.period + half)
    ax.set_ylabel(label)


def _in_phase(ladder: Ladder, guess: LimitCycle, name: str, time: Array) -> Array:
    """A signal of an approximate cycle over two periods of the run's, with the phases equal in the middle."""
    cycle = ladder.run.limit_cycle
    assert cycle is not None
    shift = np.angle(cycle.harmonics[ladder.signal][ladder.swings]) - np.angle(guess.harmonics[ladder.signal][1])
    angle = guess.omega * (time - cycle.period) + shift
    waves = (c * np.exp(1j * k * angle) for k, c in enumerate(guess.harmonics[name]))
    return np.sum([np.real(wave) for wave in waves], axis=0)


def _draw_begin(ax: Axes, ladder: Ladder, name: str) -> None:
    """How a run comes to rest (all of one that does not), and the reach of the stable cycles predicted and missed."""
    run = ladder.run
    label, factor = _shown(name, run.units)
    y = factor * run.signals[name]
    ax.plot(run.t, y, color=BLUE, linewidth=1.3, label="simulated")
    bands = []
    for cycle in ladder.prediction or ():
        if cycle.stable:
            half = 0.5 * factor * cycle.peak_to_peak[name]
            middle = factor * cycle.mean[name]
            bands.append((middle - half, middle + half))
            ax.axhspan(*bands[-1], color=ORANGE, alpha=0.3, linewidth=0, label="stable cycle predicted")
    text = "stable cycle that first order misses"
    for cycle in () if ladder.search is None else [ladder.search[number] for number in ladder.missed]:
        half, middle = 0.5 * factor * cycle.peak_to_peak[name], factor * cycle.mean[name]
        bands.append((middle - half, middle + half))
        style: dict[str, Any] = {"facecolor": "none", "edgecolor": SKY, "hatch": "//", "linewidth": 0.8}
        ax.axhspan(*bands[-1], **style, label=text)
        text = ""
    ax.set_ylabel(label)
    if run.settled_at and np.ptp(y) > 0:
        edges = [abs(edge - float(y[-1])) for band in bands for edge in band]
        reach = 1.5 * max(0.02 * float(np.ptp(y)), *edges, 0.0)
        near = np.abs(y - y[-1]) < reach
        first = int(np.argmax(near))
        ax.set_ylim(y[-1] - reach, y[-1] + reach)
        ax.set_xlim(0.9 * run.t[first], max(1.3 * run.settled_since, run.t[min(first + 50, run.t.size - 1)]))


def _draw_prediction(ax: Axes, prediction: Prediction | None) -> None:
    if prediction is None:
        ax.set_axis_off()
        ax.text(0.5, 0.5, "no describing function", transform=ax.transAxes, ha="center", color=GREY)
    else:
        plot_nyquist(prediction, ax)
        ax.spines[["top", "right"]].set_visible(False)


def _mark_events(ax: Axes, times: Array) -> None:
    if 0 < times.size <= _MOST_MARKS:
        foot: dict[str, Any] = {"color": GREY, "markersize": 5, "transform": ax.get_xaxis_transform()}
        ax.plot(times, np.zeros_like(times), "|", label="switch of an element", **foot)


def _draw_nyquist(ax: Axes, prediction: Prediction) -> None:
    curves = prediction.curves
    response = np.asarray(curves["response"], complex)
    locus = np.asarray(curves["locus"], complex)
    meets = [complex(point["value"]) for point in curves["intersections"]]
    draw_nyquist(ax, response, locus, meets)
    _mark_cycles(ax, meets, prediction.cycles)


def draw_nyquist(ax: Axes, response: ComplexArray, locus: ComplexArray, meets: Sequence[complex]) -> None:
    """G(j omega) and -1/N(A) with their directions, in a window that shows where they meet."""
    box = nyquist_window(response, locus, meets)
    ax.axhline(0.0, color=GREY, linewidth=0.5)
    ax.axvline(0.0, color=GREY, linewidth=0.5)
    ax.plot(response.real, response.imag, color=BLUE, linewidth=1.3, label=r"$G(j\omega)$, growing frequency")
    ax.plot(
        locus.real, locus.imag, color=VERMILLION, linewidth=1.3, linestyle="--", label=r"$-1/N(A)$, growing amplitude"
    )
    _arrows(ax, response, box, BLUE)
    _arrows(ax, locus, box, VERMILLION)
    ax.set_xlim(box[0], box[1])
    ax.set_ylim(box[2], box[3])
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")


def _draw_loop_gain(ax: Axes, prediction: Prediction) -> None:
    curves = prediction.curves
    element = words(str(curves.get("element", "the element")))
    unit, factor = readable(curves.get("unit", ""))
    ax.axhline(1.0, color=GREY, linewidth=0.8)
    for branch in curves.get("branches", ()):
        ax.plot(factor * np.asarray(branch["amplitude"]), branch["loop_gain"], color=BLUE, linewidth=1.3)
    points = [complex(factor * point["amplitude"], 1.0) for point in curves.get("intersections", ())]
    ax.set_xscale("log")
    ax.set_yscale("log")
    if not curves.get("branches"):
        ax.text(0.5, 0.5, "the phase closes at no amplitude", transform=ax.transAxes, ha="center", color=GREY)
    _mark_cycles(ax, points, prediction.cycles)
    ax.set_xlabel(with_unit(f"amplitude at the input of {element}", unit))
    ax.set_ylabel("loop gain (one at a cycle)")


def _mark_cycles(ax: Axes, points: Sequence[complex], cycles: Sequence[LimitCycle]) -> None:
    """Filled circles for stable cycles, open ones around them for the others; numbers lead to the legend."""
    to_share = ax.transData + ax.transAxes.inverted()
    places: dict[tuple[int, int], list[int]] = {}
    for i, (point, cycle) in enumerate(zip(points, cycles, strict=True)):
        face, size = (GREEN, 7) if cycle.stable else ("none", 11)
        name = next(iter(cycle.harmonics))
        unit, factor = readable(cycle.units.get(name, ""))
        swing = f"{name.replace('_', ' ')} amplitude {factor * cycle.amplitude(name):.3g} {unit}"
        text = f"{_STABILITY[cycle.stable]}: {cycle.frequency:.3g} Hz, {swing}"
        style: dict[str, Any] = {
            "mfc": face,
            "mec": GREEN,
            "mew": 1.5,
            "markersize": size,
            "linestyle": "none",
            "zorder": 5,
        }
        ax.plot([point.real], [point.imag], marker="o", label=f"{i + 1} {text.strip()}", **style)
        share = to_share.transform((point.real, point.imag))
        # Cycles at one point share their numbers.
        places.setdefault((round(50 * share[0]), round(50 * share[1])), []).append(i)
    for numbers in places.values():
        point = points[numbers[0]]
        ax.annotate(
            ", ".join(str(i + 1) for i in numbers),
            (point.real, point.imag),
            (8, 5),
            textcoords="offset points",
            fontsize=9,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
            zorder=6,
        )
    if len(points) or ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=7, loc="best", framealpha=0.9)


def nyquist_window(
    response: ComplexArray, locus: ComplexArray, meets: Sequence[complex]
) -> tuple[float, float, float, float]:
    """Limits that show the origin and every cycle (where there is none, -1 and the locus's nearest point).

    Curves that run to infinity are cut.
    """
    finite = locus[np.isfinite(locus)]
    points = [0j, *meets] if len(meets) else [0j, -1.0 + 0j, *finite[np.argsort(np.abs(finite))[:1]]]
    reach = 1.3 * max([abs(p) for p in points])
    reals, imags = [p.real for p in points], [p.imag for p in points]
    return min(reals) - 0.8 * reach, max(reals) + 0.5 * reach, min(imags) - 0.65 * reach, max(imags) + 0.65 * reach


def _arrows(ax: Axes, curve: ComplexArray, box: tuple[float, float, float, float], colour: str) -> None:
    """Two arrow heads along the part of a curve that is inside the picture."""
    with np.errstate(invalid="ignore"):
        inside = (curve.real > box[0]) & (curve.real < box[1]) & (curve.imag > box[2]) & (curve.imag < box[3])
    index = np.flatnonzero(inside[:-1] & inside[1:])
    length = np.cumsum(np.abs(np.diff(curve)[index]))
    if not index.size or length[-1] == 0.0:
        return
    head = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.3}
    for share in (0.3, 0.75):
        k = index[int(np.searchsorted(length, share * length[-1]))]
        start, end = curve[k], curve[k + 1]
        near = end + 1e-3 * (start - end)
        ax.annotate("", (end.real, end.imag), (near.real, near.imag), arrowprops=head)


def _one_period(cycle: LimitCycle) -> tuple[Array, Mapping[str, Array]]:
    """Times and waveform; of a cycle that has only harmonics, their sum."""
    if cycle.time.size:
        return cycle.time, cycle.waveform
    time = np.linspace(0.0, cycle.period, 401)
    return time, {
        name: sum((c * np.exp(1j * k * cycle.omega * time) for k, c in enumerate(coefficients)), np.zeros(401)).real
        for name, coefficients in cycle.harmonics.items()
    }


def _chosen(available: Mapping[str, Any], signals: Sequence[str] | None) -> list[str]:
    names = list(available) if signals is None else list(signals)
    missing = [name for name in names if name not in available]
    if missing:
        raise EppError(f"There is no signal {shown(missing[0])}; expected one of {', '.join(available)}.")
    if not names:
        raise EppError("There is no signal to draw; expected at least one.")
    return names


def _panels(n: int, height: float = _PANEL_HEIGHT) -> tuple[Figure, list[Axes]]:
    columns = 1 if n <= 4 else 2
    rows = max(1, -(-n // columns))
    figure = Figure(figsize=(_PANEL_WIDTH * columns, 0.9 + height * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    panels = [grid[i % rows, i // rows] for i in range(rows * columns)]
    for ax in panels[n:]:
        ax.set_axis_off()
    for ax in panels:
        ax.spines[["top", "right"]].set_visible(False)
    return figure, panels[:n]


def _label_time(panels: Sequence[Axes], text: str) -> None:
    """The lowest panel of each column carries the label of the time axis, and all share its range."""
    placed = [(ax, spec) for ax in panels if (spec := ax.get_subplotspec()) is not None]
    last_row = max(spec.rowspan.stop for _, spec in placed)
    columns: dict[int, Axes] = {}
    for ax, spec in placed:
        columns[spec.colspan.start] = ax
        ax.margins(x=0.0)
        ax.tick_params(labelbottom=spec.rowspan.stop == last_row)
    for ax in columns.values():
        ax.tick_params(labelbottom=True)
        ax.set_xlabel(text)
    _root_figure(panels[0]).align_ylabels(panels)


def _shown(name: str, units: Mapping[str, str]) -> tuple[str, float]:
    """A signal's name with the unit that people read it in, and the factor to it from SI."""
    unit, factor = readable(units.get(name, ""))
    return with_unit(words(name), unit), factor


def _legend_below(figure: Figure, ax: Axes) -> None:
    """What the marks and shades of all panels mean, once."""
    handles, texts = ax.get_legend_handles_labels()
    if handles:
        figure.legend(handles, texts, fontsize=8, loc="outside lower center", ncols=3, frameon=False)


def _root_figure(ax: Axes) -> Figure:
    figure = ax.figure
    while isinstance(figure, SubFigure):
        figure = figure.figure
    return figure


def plot_branch(branch: Branch, signal: str | None = None, at: float | None = None) -> Figure:
    """Bifurcation diagram: amplitude and frequency over the parameter; stable solid, unstable dashed.

    Folds are filled diamonds, period doublings triangles, other special points open squares, simulated runs crosses on
    top. Parts of the range asked for that have no orbit are hatched, with the reason in the legend. Angles are in
    degrees, lengths in millimetres.

    Parameters
    ----------
    branch : Branch
    signal : str, optional
        Whose peak-to-peak is drawn; the first by default.
    at : float, optional
        Value of the parameter that a dotted line marks [SI].

    Raises
    ------
    EppError
        If the branch has no such signal.
    """
    name = _chosen(dict.fromkeys(branch.signals), None if signal is None else [signal])[0]
    x_unit, x_factor = readable(branch.unit)
    label, factor = _shown(name, branch.units)
    figure, panels = _panels(2, height=2.4)
    figure.suptitle(with_name("", branch.provenance.subject), fontsize=10)
    for ax, key, scale in zip(panels, (name, "frequency"), (factor, 1.0), strict=True):
        y = scale * branch.points[key]
        for one in (branch, *branch.others):
            _draw_branch(ax, one, name, key, x_factor, scale)
            y = np.append(y, scale * one.points[key])
        for gap in branch.missing:
            edges: dict[str, Any] = {"facecolor": GREY, "alpha": 0.18, "linewidth": 0, "hatch": "xx"}
            ax.axvspan(x_factor * gap.low, x_factor * gap.high, **edges, label=f"no orbit: {gap.why}")
        if key in branch.simulated:
            runs = x_factor * branch.simulated["value"], scale * branch.simulated[key]
            ax.plot(*runs, "x", color=GREEN, markersize=5, label="simulated")
            y = np.append(y, runs[1])
        show_constant(ax, y)
        if at is not None:
            ax.axvline(x_factor * at, color=GREY, linestyle=":")
        ax.set_ylabel("frequency [Hz]" if key == "frequency" else label + "\npeak to peak")
        ax.set_xlabel(with_unit(words(branch.parameter), x_unit))
    handles = dict(zip(*panels[0].get_legend_handles_labels()[::-1], strict=True))
    panels[0].legend(handles.values(), [textwrap.fill(text, 48) for text in handles], fontsize=8)
    return figure


def _draw_branch(ax: Axes, branch: Branch, name: str, key: str, across: float, scale: float) -> None:
    """One curve of the diagram with its special points."""
    value, stable = across * branch.points["value"], branch.points["stable"]
    y = scale * branch.points[key]
    for kind, colour, style in ((True, BLUE, "-"), (False, VERMILLION, "--")):
        # A piece belongs to the stability of its first point; the other kind leaves a gap.
        piece = (stable == kind) | np.append(False, stable[:-1] == kind)
        if np.any(piece):
            ax.plot(value, np.where(piece, y, np.nan), style, color=colour, linewidth=1.4, label=_STABILITY[kind])
    for special in branch.special:
        height = special.cycle.frequency if key == "frequency" else special.cycle.peak_to_peak[name]
        _mark_special(ax, special.kind, across * special.value, scale * height)


def _mark_special(ax: Axes, kind: str, x: float, y: float) -> None:
    """A filled diamond for a fold, a filled triangle for a period doubling, an open square for the rest."""
    from eppanalysis.methods.continuation_labels import Change

    if kind == Change.FOLD:
        ax.plot(x, y, "D", color=ORANGE, markersize=5, label="fold")
    elif kind == Change.PERIOD_DOUBLING:
        ax.plot(x, y, "^", color="black", markersize=6, label="period doubling")
    else:
        ax.plot(x, y, "s", color=GREY, markerfacecolor="none", markersize=5, label="other special point")
