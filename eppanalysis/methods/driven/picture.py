"""Pictures of driven loops: gain and phase over what runs, and the waveforms of all responses to one sine."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.arrays import Array
from eppanalysis.methods.driven.result import ForcedResponse, FrequencyResponse, Over, ResponseBranch
from eppanalysis.methods.steady.changes import Change
from eppanalysis.plotting import (
    BLUE,
    DARK,
    DARK_ORANGE,
    DARK_SKY,
    GREEN,
    GREY,
    STABILITY,
    VERMILLION,
    chosen,
    label_of,
    label_time,
    label_up,
    legend_below,
    place_of,
    places_of,
    put_legend,
)
from eppanalysis.readable import count, readable, with_unit, words

#: Colours and lines of stable responses, which may be several; unstable ones are dashed.
_STABLE = ((BLUE, "-"), (GREEN, "-."), (DARK_SKY, ":"))


def plot_frequency_response(response: FrequencyResponse, ax: Axes | None = None) -> Figure:
    """Peak to peak and phase of the output over the frequency, or the amplitude, of the input.

    The upper panel is the peak to peak of the output, the lower one the phase of its component at the input's
    frequency. Stable responses are solid, unstable ones dashed, the DF is thin and dotted; folds are diamonds, and
    arrows show where the motion jumps to. Units are those that the case types.
    """
    figure, (upper, *below) = places_of(ax, 2, height=2.6)
    shown, factor = readable(response.units.get(response.output, ""))
    unit, across = ("Hz", 1.0) if response.over is Over.FREQUENCY else readable(response.units.get(response.input, ""))
    for branch in response.first_order:
        x = across * getattr(branch, response.over)
        thin: dict[str, Any] = {"color": "black", "linewidth": 1.0, "label": "DF", "zorder": 2.5}
        upper.plot(x, factor * branch.peak_to_peak, ":", **thin)
        for lower in below:
            lower.plot(x, _phase(branch), ":", **thin)
    for branch in response.branches:
        x = across * getattr(branch, response.over)
        _draw(upper, branch, x, factor * branch.peak_to_peak)
        _mark(upper, branch, x, factor * branch.peak_to_peak)
        for lower in below:
            _draw(lower, branch, x, _phase(branch))
            _mark(lower, branch, x, _phase(branch))
    upper.set_ylabel(with_unit(f"{words(response.output)}\npeak to peak", shown))
    for lower in below:
        lower.set_ylabel("phase at the input's\nfrequency [deg]")
    for panel in (upper, *below):
        panel.set_xlabel(with_unit(f"{response.over} of {words(response.input)}", unit))
        panel.margins(x=0.02)
    upper.set_ylim(bottom=0.0)
    put_legend(upper)
    return figure


def _phase(branch: ResponseBranch) -> Array:
    """Phase along a branch [deg], continuous, begun between -180 and 180 degrees."""
    return np.degrees(np.unwrap(np.angle(branch.response)))


def _draw(ax: Axes, branch: ResponseBranch, x: Array, y: Array) -> None:
    """A branch, solid where it is stable and dashed where not; the pieces meet at the folds."""
    for kind, colour, style in ((True, BLUE, "-"), (False, VERMILLION, "--")):
        # A piece belongs to the stability of its first point; the other kind leaves a gap.
        piece = (branch.stable == kind) | np.append(False, branch.stable[:-1] == kind)
        if np.any(branch.stable == kind):
            ax.plot(x, np.where(piece, y, np.nan), style, color=colour, linewidth=1.6, label=STABILITY[kind])


def _mark(ax: Axes, branch: ResponseBranch, x: Array, y: Array) -> None:
    """Folds and other special points; with each fold an arrow to the stable response to which the motion jumps."""
    for special in branch.special:
        i = special.index
        fold = special.kind == Change.FOLD
        style: dict[str, Any] = {"marker": "D", "color": DARK_ORANGE}
        if not fold:
            style = {"marker": "s", "color": GREEN, "markerfacecolor": "none"}
        ax.plot(x[i], y[i], linestyle="none", markersize=5, label=special.kind, zorder=3, **style)
        if fold:
            _jump(ax, branch, x, y, i)


def _jump(ax: Axes, branch: ResponseBranch, x: Array, y: Array, index: int) -> None:
    """An arrow from a fold to the nearest stable stretch above or below it, where there is one."""
    ends, at, height = [], float(x[index]), float(y[index])
    for k in np.flatnonzero((x[:-1] - at) * (x[1:] - at) <= 0):
        if abs(int(k) - index) > 2 and branch.stable[k] and branch.stable[k + 1]:
            share = (at - x[k]) / (x[k + 1] - x[k])
            ends.append(float(y[k] + share * (y[k + 1] - y[k])))
    if ends:
        target = min(ends, key=lambda end: abs(end - height))
        look = {"arrowstyle": "-|>", "color": GREY, "linewidth": 0.9, "shrinkA": 4.0, "shrinkB": 1.0}
        ax.annotate("", (at, target), (at, height), arrowprops=look)


def plot_forced_response(response: ForcedResponse, signals: list[str] | None = None, ax: Axes | None = None) -> Figure:
    """One period of every response, one panel a signal, with the phase of the input in turns across.

    Parameters
    ----------
    signals : sequence of str, optional
        Which signals, in this order; all by default.

    Raises
    ------
    EppError
        If there is no such signal.
    """
    if not response.responses:
        figure, panel = place_of(ax, 0.6)
        panel.set_axis_off()
        panel.text(0.5, 0.5, "There is no response to draw.", transform=panel.transAxes, ha="center", color=DARK)
        return figure
    names = chosen(response.responses[0].cycle.waveform, signals)
    figure, panels = places_of(ax, len(names))
    for name, panel in zip(names, panels, strict=False):
        for number, one in enumerate(response.responses, start=1):
            label, factor = label_of(name, one.cycle.units)
            turns = (one.cycle.time - one.cycle.time[0]) * response.frequency + one.phase / (2.0 * np.pi)
            style: dict[str, Any] = {"linestyle": "--", "color": VERMILLION}
            if one.stable:
                style = dict(zip(("color", "linestyle"), _STABLE[(number - 1) % len(_STABLE)], strict=True))
            text = f"{number}: {STABILITY[one.stable]}, of {count(one.multiple, 'period')}"
            panel.plot(turns, factor * one.cycle.waveform[name], linewidth=1.3, label=text, **style)
            label_up(panel, label)
    label_time(panels, "periods of the input")
    if ax is None:
        legend_below(figure, panels[0])
    else:
        put_legend(ax)
    return figure
