"""Results to pictures: labelled with units, readable without colour vision, ready for print. Computes nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from eppanalysis.methods.ladder import Ladder
    from eppanalysis.results import LimitCycle, Prediction, Trajectory

Array = NDArray[np.float64]

#: Colours that stay apart under every form of colour blindness (Okabe and Ito, "Color Universal Design", 2008).
BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, GREY = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#CC79A7",
    "#7F7F7F",
)
_STABILITY = {True: "stable", False: "unstable", None: "stability unknown"}
#: More marks than these merge into a bar that says nothing.
_MOST_MARKS = 300
_PANEL_WIDTH, _PANEL_HEIGHT = 5.2, 1.5  # inches


def plot_trajectory(trajectory: Trajectory, signals: Sequence[str] | None = None) -> Figure:
    """Signals against time, one panel each; grey marks at the foot are events, shaded is where the run is steady.

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
        ax.plot(trajectory.t, trajectory.signals[name], color=BLUE, linewidth=1.0)
        ax.set_ylabel(_label(name, trajectory.units))
        _mark_events(ax, times)
        if np.isfinite(trajectory.settled_since) and trajectory.t.size:
            ax.axvspan(trajectory.settled_since, float(trajectory.t[-1]), color=SKY, alpha=0.18, linewidth=0)
    _label_time(panels, "time [s]")
    figure.suptitle(trajectory.status.value, fontsize=10)
    return figure


def plot_limit_cycle(cycle: LimitCycle, signals: Sequence[str] | None = None) -> Figure:
    """One period of a limit cycle, one panel a signal, with its mean (dashed) and its switches (grey marks).

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
        ax.plot(time, waveform[name], color=BLUE, linewidth=1.2)
        ax.axhline(cycle.mean[name], color=GREY, linewidth=0.8, linestyle="--")
        ax.set_ylabel(_label(name, cycle.units))
        if switches.size:
            ax.plot(
                switches, np.zeros_like(switches), "|", color=GREY, markersize=5, transform=ax.get_xaxis_transform()
            )
    _label_time(panels, "time within the period [s]")
    figure.suptitle(f"{cycle.method}: {cycle.frequency:.4g} Hz, {_STABILITY[cycle.stable]}", fontsize=10)
    return figure


def plot_nyquist(prediction: Prediction, ax: Axes | None = None) -> Figure:
    """Nyquist picture: the loop's response, the -1/N locus with growing amplitude, and the cycles where they meet.

    A filled circle is a stable cycle, an open one any other. Loops with several elements have no single -1/N locus; for
    them the picture is the loop gain over the amplitude at the principal element, at the frequency at which the loop's
    phase closes and with all other balances met: a cycle is where it is one, stable where it falls through one.

    Parameters
    ----------
    prediction : Prediction
    ax : matplotlib.axes.Axes, optional
        Where to draw; a figure of its own by default.
    """
    if ax is None:
        figure = Figure(figsize=(5.6, 5.0), layout="constrained")
        ax = figure.add_subplot()
    else:
        figure = _root_figure(ax)
    if prediction.curves.get("kind") == "nyquist":
        _draw_nyquist(ax, prediction)
    else:
        _draw_loop_gain(ax, prediction)
    n = len(prediction)
    ax.set_title(f"{n or 'no'} limit cycle{'' if n == 1 else 's'} predicted", fontsize=10)
    return figure


def plot_ladder(ladder: Ladder) -> Figure:
    """The methods of a ladder side by side, one panel a quantity: how far each is from the others."""
    rows = [(row.method, row.quantities) for row in ladder.rows]
    names = [name for name in dict.fromkeys(n for _, q in rows for n in q) if _numeric(q.get(name) for _, q in rows)]
    figure, panels = _panels(len(names), height=0.5 + 0.3 * len(rows))
    for name, ax in zip(names, panels, strict=True):
        values = [q.get(name) for _, q in rows]
        for i, value in enumerate(values):
            if value is None or not np.isfinite(value):
                ax.text(0.02, i, "none", transform=ax.get_yaxis_transform(), va="center", color=GREY, fontsize=8)
                continue
            ax.plot([value], [i], "o", color=(BLUE, VERMILLION, GREEN, ORANGE, PURPLE)[i % 5], markersize=6)
            ax.annotate(f"{value:.4g}", (value, i), (0, 6), textcoords="offset points", ha="center", fontsize=8)
        ax.set_yticks(range(len(rows)), [method for method, _ in rows])
        ax.set_ylim(len(rows) - 0.4, -0.8)
        ax.margins(x=0.25)
        ax.grid(axis="y", alpha=0.3)
        ax.set_xlabel(_label(name, ladder.units))
    figure.suptitle(ladder.verdict, fontsize=10, wrap=True)
    return figure


def _mark_events(ax: Axes, times: Array) -> None:
    if 0 < times.size <= _MOST_MARKS:
        ax.plot(times, np.zeros_like(times), "|", color=GREY, markersize=5, transform=ax.get_xaxis_transform())


def _draw_nyquist(ax: Axes, prediction: Prediction) -> None:
    curves = prediction.curves
    response = np.asarray(curves["response"], complex)
    locus = np.asarray(curves["locus"], complex)
    meets = [complex(point["value"]) for point in curves["intersections"]]
    box = _window(response, locus, meets)
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
    _mark_cycles(ax, meets, prediction.cycles)
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    ax.legend(fontsize=8, loc="best")


def _draw_loop_gain(ax: Axes, prediction: Prediction) -> None:
    curves = prediction.curves
    ax.axhline(1.0, color=GREY, linewidth=0.8)
    for branch in curves.get("branches", ()):
        ax.plot(branch["amplitude"], branch["loop_gain"], color=BLUE, linewidth=1.3)
    points = [complex(point["amplitude"], 1.0) for point in curves.get("intersections", ())]
    ax.set_xscale("log")
    ax.set_yscale("log")
    _mark_cycles(ax, points, prediction.cycles)
    ax.set_xlabel(f"amplitude at the input of {curves.get('element', 'the element').replace('_', ' ')}")
    ax.set_ylabel("loop gain (one at a cycle)")


def _mark_cycles(ax: Axes, points: Sequence[complex], cycles: Sequence[LimitCycle]) -> None:
    """Filled circles for stable cycles, open ones around them for the others; cycles at one point share a label."""
    to_share = ax.transData + ax.transAxes.inverted()
    labels: dict[tuple[int, int], list[str]] = {}
    places: dict[tuple[int, int], complex] = {}
    for point, cycle in zip(points, cycles, strict=True):
        face, size = (GREEN, 7) if cycle.stable else ("none", 11)
        ax.plot([point.real], [point.imag], "o", mfc=face, mec=GREEN, mew=1.5, markersize=size, zorder=5)
        name = next(iter(cycle.harmonics))
        unit = cycle.units.get(name, "")
        text = f"{_STABILITY[cycle.stable]}: {cycle.frequency:.3g} Hz, {name} {cycle.amplitude(name):.3g} {unit}"
        share = to_share.transform((point.real, point.imag))
        near = (round(50 * share[0]), round(50 * share[1]))
        labels.setdefault(near, []).append(text.strip())
        places.setdefault(near, point)
    for i, (near, texts) in enumerate(labels.items()):
        # Labels point into the picture, and neighbours to different sides.
        left, below = near[0] < 28, i % 2 == 0
        ax.annotate(
            "\n".join(texts),
            (places[near].real, places[near].imag),
            (10 if left else -10, -10 if below else 10),
            textcoords="offset points",
            ha="left" if left else "right",
            va="top" if below else "bottom",
            fontsize=7,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
        )


def _window(
    response: NDArray[np.complex128], locus: NDArray[np.complex128], meets: Sequence[complex]
) -> tuple[float, float, float, float]:
    """Limits that show the origin and every cycle; curves that run to infinity are cut."""
    finite = locus[np.isfinite(locus)]
    points = [0j, *meets] if meets else [0j, -1.0 + 0j, *finite[np.argsort(np.abs(finite))[:1]]]
    reach = 1.3 * max([abs(p) for p in points])
    reals, imags = [p.real for p in points], [p.imag for p in points]
    return min(reals) - 0.8 * reach, max(reals) + 0.5 * reach, min(imags) - 0.65 * reach, max(imags) + 0.65 * reach


def _arrows(ax: Axes, curve: NDArray[np.complex128], box: tuple[float, float, float, float], colour: str) -> None:
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
        ax.annotate("", (end.real, end.imag), (start.real, start.imag), arrowprops=head)


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
        raise EppError(f"There is no signal {missing[0]!r}; expected one of {', '.join(available)}.")
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
    last_row = max(ax.get_subplotspec().rowspan.stop for ax in panels if ax.get_subplotspec())  # type: ignore[union-attr]
    columns: dict[int, Axes] = {}
    for ax in panels:
        spec = ax.get_subplotspec()
        assert spec is not None
        columns[spec.colspan.start] = ax
        ax.margins(x=0.0)
        ax.tick_params(labelbottom=spec.rowspan.stop == last_row)
    for ax in columns.values():
        ax.tick_params(labelbottom=True)
        ax.set_xlabel(text)
    _root_figure(panels[0]).align_ylabels(panels)


def _label(name: str, units: Mapping[str, str]) -> str:
    unit = units.get(name, "").replace("*", "·")
    words = name.replace("_", " ")
    return f"{words} [{unit}]" if unit else words


def _numeric(values: Any) -> bool:
    return any(isinstance(v, (int, float)) and not isinstance(v, bool) and np.isfinite(v) for v in values)


def _root_figure(ax: Axes) -> Figure:
    figure = ax.figure
    while isinstance(figure, SubFigure):
        figure = figure.figure
    return figure
