"""Picture of a ladder: the run, its cycle beside those of DF and harmonic balance, and the prediction."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.arrays import Array
from eppanalysis.methods.comparison.ladder import Ladder
from eppanalysis.plotting import (
    BLUE,
    DARK_ORANGE,
    DARK_SKY,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    STABILITY,
    VERMILLION,
    figure_of_height,
    label_of,
    label_time,
    label_up,
    main_signals,
    put_legend,
    root_figure,
)
from eppanalysis.readable import number, time_unit, with_unit
from eppanalysis.results import LimitCycle, Prediction
from eppanalysis.results.picture import closes, draw_run, motion_of, one_period, periods, plot_nyquist, time_of

#: Heights of a panel of the run, of the steady motion, and of the prediction [inch].
_RUN, _CLOSE, _PREDICTION = 1.0, 1.4, 3.0
#: More exact cycles than these beside that of the run cannot be distinguished.
_MOST_OTHERS = 3
#: Stable cycles side by side, distinct in grey, too.
_CYCLES: tuple[dict[str, Any], ...] = (
    {"color": BLUE, "linestyle": "-"},
    {"color": VERMILLION, "linestyle": "-."},
    {"color": GREEN, "linestyle": ":"},
    {"color": ORANGE, "linestyle": "-"},
)


def plot_ladder(ladder: Ladder, given: Axes | None = None) -> Figure:
    """The run in time, its steady motion with the predicted cycle over it, and the picture of the prediction.

    Two signals are drawn: the ladder's own, and the force that the controller reads (or the next signal that there is).

    Parameters
    ----------
    given : matplotlib.axes.Axes, optional
        Where to draw the steady motion of the ladder's own signal alone; all of it on a figure of its own by default.
    """
    late = with_unit("time", time_unit(ladder.run.units))
    draw = _draw_steady if ladder.run.limit_cycle is not None else _draw_begin
    if not ladder.run.settled_at and ladder.run.limit_cycle is None and len(ladder.search or ()):
        draw = _draw_cycles
    if given is not None:
        draw(given, ladder, ladder.signal)
        label_time([given], time_of(ladder.run) if draw is _draw_begin else late, ladder.run.units)
        put_legend(given)
        given.spines[["top", "right"]].set_visible(False)
        return root_figure(given)
    names = main_signals(list(ladder.run.signals), ladder.signal)
    n = len(names)
    motion, predicted = _parts(ladder)
    heights = [_RUN] * n + [_CLOSE] * n * motion + [_PREDICTION] * predicted
    figure = figure_of_height(0.6 + sum(heights))
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    panels = [figure.add_subplot(grid[i]) for i in range(len(heights))]
    runs, close = panels[:n], panels[n : n + n * motion]
    whole = motion_of(ladder.run)
    for name, ax in zip(names, runs, strict=True):
        label, factor = label_of(name, ladder.run.units)
        draw_run(ax, ladder.run, whole, name, factor, 0.7)
        label_up(ax, label, 0.75)
    for name, ax in zip(names, close, strict=False):
        draw(ax, ladder, name)
    label_time(runs, time_of(ladder.run), ladder.run.units)
    if close:
        label_time(close, late, ladder.run.units)
    for ax in panels:
        ax.spines[["top", "right"]].set_visible(False)
    for ax in close[:1]:
        put_legend(ax)
    if predicted:
        _draw_prediction(panels[-1], ladder.prediction)
    return figure


def _parts(ladder: Ladder) -> tuple[bool, bool]:
    """Whether the steady motion and the prediction are below the run: what has nothing to show does not."""
    run, prediction = ladder.run, ladder.prediction
    curves = prediction is None or prediction.curves.get("kind") == "nyquist" or prediction.curves.get("branches")
    cycles = (ladder.search, prediction)
    more = run.limit_cycle is not None or prediction is None or any(len(c or ()) for c in cycles)
    return more, bool(curves) or not more


def _draw_steady(ax: Axes, ladder: Ladder, name: str) -> None:
    """Two periods of the run's cycle (a few oscillations of a long one); those of DF and harmonic balance are in phase
    with it in the middle.
    """
    cycle = ladder.run.limit_cycle
    assert cycle is not None
    label, factor = label_of(name, ladder.run.units)
    both, values = periods(cycle, name)
    ax.plot(both, factor * values, color=BLUE, linewidth=1.3, label="simulated")
    if ladder.matched is not None and ladder.prediction is not None:
        guess = ladder.prediction[ladder.matched]
        ax.plot(both, factor * _in_phase(ladder, guess, name, both), "--", color=VERMILLION, lw=1.3, label="predicted")
    balance = ladder.balance
    if balance is not None:
        balanced = factor * _in_phase(ladder, balance, name, both)
        ax.plot(both, balanced, ":", color=DARK_ORANGE, lw=1.6, label=balance.method)
    for other in _others(ladder):
        colour, style = (DARK_SKY, "-") if other.stable else (GREY, "--")
        text = f"exact, {STABILITY[other.stable]}"
        ax.plot(both, factor * _in_phase(ladder, other, name, both), style, color=colour, lw=1.0, label=text, zorder=1)
    if ladder.oscillations > 2:
        half = 2.0 * cycle.period / ladder.oscillations
        ax.set_xlim(cycle.period - half, cycle.period + half)
    label_up(ax, label)


def _others(ladder: Ladder) -> list[LimitCycle]:
    """The first of the exact cycles that the run is not on."""
    here = ladder.rows[-1].exact if ladder.rows else None
    return [cycle for i, cycle in enumerate(ladder.search or ()) if i != here][:_MOST_OTHERS]


def _in_phase(ladder: Ladder, guess: LimitCycle, name: str, time: Array) -> Array:
    """A signal of another cycle over two periods of the run's, with the phases equal in the middle."""
    cycle = ladder.run.limit_cycle
    assert cycle is not None
    shift = np.angle(cycle.harmonics[ladder.signal][ladder.oscillations]) - np.angle(guess.harmonics[ladder.signal][1])
    angle = guess.omega * (time - cycle.period) + shift
    if guess.time.size:
        own = guess.time - guess.time[0]
        return np.interp(angle / guess.omega, own, guess.waveform[name], period=guess.period)
    waves = (c * np.exp(1j * k * angle) for k, c in enumerate(guess.harmonics[name]))
    return np.sum([np.real(wave) for wave in waves], axis=0)


def _draw_cycles(ax: Axes, ladder: Ladder, name: str) -> None:
    """The cycles that the search finds beside a run that is on none of them, over two periods of the longest."""
    label, factor = label_of(name, ladder.run.units)
    cycles = list(ladder.search or ())[: _MOST_OTHERS + 1]
    time = np.linspace(0.0, 2.0 * max(cycle.period for cycle in cycles), 2001)
    for i, cycle in enumerate(cycles):
        own, waveform = one_period(cycle)
        y = factor * np.interp(time, own - own[0], waveform[name], period=cycle.period)
        if not closes(cycle):  # from the last sample of a period to the first of the next there is no line
            y = np.where(time % cycle.period > own[-1] - own[0] - np.diff(time[:2]), np.nan, y)
        style = _CYCLES[i % len(_CYCLES)] if cycle.stable else {"color": GREY, "linestyle": "--"}
        text = f"{cycle.method}, {STABILITY[cycle.stable]}, {number(cycle.frequency)} Hz"
        ax.plot(
            time, y, linewidth=1.2, label=text + ", the describing function misses it" * (i in ladder.missed), **style
        )
    label_up(ax, label)


def _draw_begin(ax: Axes, ladder: Ladder, name: str) -> None:
    """How a run comes to rest, or all of one that does not, and the reach of the cycles predicted and found."""
    run = ladder.run
    label, factor = label_of(name, run.units)
    y = factor * run.signals[name]
    draw_run(ax, run, motion_of(run), name, factor, 1.3)
    ax.lines[-1].set_label("simulated")
    bands = []
    for cycle in ladder.prediction or ():
        if cycle.stable:
            half = 0.5 * factor * cycle.peak_to_peak[name]
            middle = factor * cycle.mean[name]
            bands.append((middle - half, middle + half))
            ax.axhspan(*bands[-1], color=ORANGE, alpha=0.3, linewidth=0, label="stable cycle predicted")
    for i, cycle in enumerate(ladder.search or ()):
        half, middle = 0.5 * factor * cycle.peak_to_peak[name], factor * cycle.mean[name]
        bands.append((middle - half, middle + half))
        style: dict[str, Any] = {"edgecolor": SKY, "hatch": "//", "linewidth": 0.8}
        if not cycle.stable:
            style = {"edgecolor": VERMILLION, "linestyle": "--", "linewidth": 0.8}
        text = f"exact, {STABILITY[cycle.stable]}" + ", the describing function misses it" * (i in ladder.missed)
        ax.axhspan(*bands[-1], facecolor="none", **style, label=text)
    label_up(ax, label)
    if bands and run.settled_at and np.ptp(y) > 0:
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
