"""What a search found in pictures: waveforms and phase portrait, disturbances, where starts end. Computes nothing."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.search.basin import Basin
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.trigger import Trigger
from eppanalysis.plotting import (
    BLUE,
    DARK,
    DARK_ORANGE,
    DARK_SKY,
    GREEN,
    GREY,
    PURPLE,
    SMALL,
    VERMILLION,
    few_numbers,
    note_below,
    panels_of,
    place_of,
    put_legend,
    root_figure,
)
from eppanalysis.readable import number, readable, with_unit, words
from eppanalysis.results import LimitCycle
from eppanalysis.results.picture import closes

_STABLE, _UNSTABLE = (BLUE, GREEN, DARK_SKY, PURPLE), (VERMILLION, DARK_ORANGE, GREY, PURPLE)
#: Words in the middle of an empty panel, and the letters on a line of them.
_MIDDLE: dict[str, Any] = {"ha": "center", "va": "center", "color": DARK, "fontsize": SMALL}
_WIDTH = 60
#: More than these are not distinguished in one picture; what is left over is drawn thin.
_TOLD_APART = 4
#: A line like others.
_THIN: dict[str, Any] = {"color": "#BBBBBB", "linewidth": 0.5}


def plot_cycles(search: CycleSearch, signal: str | None = None, given: Axes | None = None) -> Figure:
    """Every cycle's waveform over its own period, and the signal's rate over the signal; stable solid, unstable dashed.

    Waveforms begin where their fundamental rises through zero. Of many cycles four are distinguished, stable and large
    ones first; of the others the orbits alone are drawn, thin. Predictions whose orbits were not found are dotted and
    grey.

    Parameters
    ----------
    signal : str, optional
        The first one by default.
    given : matplotlib.axes.Axes, optional
        Where to draw the waveforms; they and the rates on a figure of their own by default.

    Raises
    ------
    EppError
        If there is no such signal.
    """
    figure, panels = _places(search, given)
    for ax in panels:
        ax.spines[["top", "right"]].set_visible(False)
    shown = _lines_of(search)
    if not shown:
        for ax in panels:
            ax.set_axis_off()
        text = f"Sought with {search.search}"
        panels[0].text(0.5, 0.5, "\n".join(map(_wrapped, text.split("\n"))), **_MIDDLE, transform=panels[0].transAxes)
        return figure
    name = _chosen(shown[0][0], signal)
    unit, factor = readable(shown[0][0].units.get(name, ""))
    for cycle, style, text in shown:
        time, wave, rate = _turned(cycle, name)
        # Of many waveforms, each over a period of its own, none can be followed; orbits can.
        followed = slice(0) if style["linewidth"] == _THIN["linewidth"] else slice(None)
        panels[0].plot((time / cycle.period)[followed], factor * wave[followed], label=text, **style)
        for right in panels[1:]:
            right.plot(factor * wave, factor * rate, **style)
    panels[0].set_xlim(0.0, 1.0)
    panels[0].set_xlabel("time over period")
    panels[0].set_ylabel(with_unit(words(name), unit))
    for right in panels[1:]:
        few_numbers(right)
        right.set_xlabel(with_unit(words(name), unit))
        right.set_ylabel(with_unit(f"rate of {words(name)}", f"{unit or '1'}/s"))
    put_legend(panels[0])
    return figure


def _lines_of(search: CycleSearch) -> list[tuple[LimitCycle, dict[str, Any], str]]:
    """What is drawn, with its line and its words: distinguished cycles on top, stable before unstable ones and large
    before small ones among them, others as thin lines that share their words.
    """
    told = [*search.stable[::-1], *search.unstable[::-1]][:_TOLD_APART]
    clear = [cycle for cycle in search.cycles if any(cycle is one for one in told)]
    thin = [cycle for cycle in search.cycles if not any(cycle is one for one in told)]
    used: dict[str, dict[str, Any]] = {}
    return [
        *((cycle, *_thin(cycle, thin)) for cycle in thin),
        *((cycle, *_listed(cycle, used)) for cycle in clear),
        *((cycle, *_unclosed(cycle, len(search.unclosed))) for cycle in search.unclosed),
    ]


def _listed(cycle: LimitCycle, used: dict[str, dict[str, Any]]) -> tuple[dict[str, Any], str]:
    """Line and words of a distinguished cycle; those of the same words, mirror images, have one line in `used`."""
    stable = bool(cycle.stable)
    text = f"{'stable' if stable else 'unstable'}, {number(cycle.frequency)} Hz"
    style = {"linestyle": "-" if stable else "--", "linewidth": 1.3}
    others = sum(one["linestyle"] == style["linestyle"] for one in used.values())
    return used.setdefault(text, style | {"color": (_STABLE if stable else _UNSTABLE)[others % len(_STABLE)]}), text


def _thin(cycle: LimitCycle, others: Sequence[LimitCycle]) -> tuple[dict[str, Any], str]:
    """Line and words of a cycle that is one of many."""
    alike = sum(bool(one.stable) == bool(cycle.stable) for one in others)
    style = {**_THIN, "linestyle": "-" if cycle.stable else "--"}
    return style, f"{alike} more, {'stable' if cycle.stable else 'unstable'}"


def _unclosed(cycle: LimitCycle, n: int) -> tuple[dict[str, Any], str]:
    """Line and words of one of `n` predictions whose orbits were not found, or that a balance leads to, not closed."""
    doubt = "may not exist" if cycle.may_not_exist else "not closed"
    where = f", {number(cycle.frequency)} Hz" if n <= _TOLD_APART else ""
    return {"color": GREY, "linestyle": ":", "linewidth": 1.3}, f"predicted{where} ({doubt})"


def _places(search: CycleSearch, given: Axes | None) -> tuple[Figure, list[Axes]]:
    """Two panels, or one for the sentence that nothing was found."""
    if given is not None:
        return root_figure(given), [given]
    some = bool(search.cycles or search.unclosed)
    return panels_of(2, 2.5) if some else panels_of(1)


def _wrapped(text: str) -> str:
    return textwrap.fill(text, _WIDTH)


def plot_trigger(trigger: Trigger, ax: Axes | None = None) -> Figure:
    """Sizes of the disturbance on a line: how far none of those tried starts a cycle, and the one that just does."""
    figure, ax = place_of(ax, 2.6 if trigger.not_covered else 1.8)
    unit, factor = readable(trigger.unit)
    none = np.isnan(trigger.size)
    edge, end = factor * (trigger.tried if none else trigger.size), factor * trigger.tried
    ax.barh([0.0], [edge], color=GREEN, alpha=0.5, label="no size tried starts a cycle")
    if not none:
        text = f"starts a cycle: {number(edge)} {unit}".rstrip()
        ax.axvline(edge, color=VERMILLION, linewidth=1.6, label=text)
    far = 1.3 * (end if none or not edge else edge)
    ax.set_xlim(min(0.0, far), max(0.0, far))
    ax.set_yticks([])
    few_numbers(ax)
    ax.set_xlabel(with_unit(words(trigger.name), unit))
    if trigger.not_covered:
        note_below(ax, trigger.not_covered)
    ax.spines[["top", "right", "left"]].set_visible(False)
    put_legend(ax)
    return figure


def plot_basin(basin: Basin, ax: Axes | None = None) -> Figure:
    """The starts in the plane of the first two states (over their number where there is one), by where they end."""
    figure, ax = place_of(ax, 3.8)
    plane = basin.starts.shape[1] > 1
    x = basin.starts[:, 0] if plane else np.arange(len(basin.starts))
    y = basin.starts[:, 1 if plane else 0]
    colours = (BLUE, VERMILLION, GREEN, DARK_ORANGE, DARK_SKY, GREY)
    for i, (end, text) in enumerate(basin.ends_in_words().items()):
        here = basin.ends == end
        ax.plot(x[here], y[here], ".", color=colours[i % len(colours)], label=text)
    ax.set_xlabel("first state" if plane else "number of the start")
    ax.set_ylabel("second state" if plane else "state")
    ax.spines[["top", "right"]].set_visible(False)
    if len(basin.ends):
        put_legend(ax)
    return figure


def _turned(cycle: LimitCycle, name: str) -> tuple[Array, Array, Array]:
    """Times, waveform and its rate from the rise of the fundamental through zero on: one period, and a few samples
    around it.

    Rates are those of the samples as they follow each other: where a cycle of a run begins again it closes to a small
    error, over a time that may be smaller.
    """
    begin = (-np.pi / 2 - np.angle(cycle.harmonics[name][1])) / (2 * np.pi) * cycle.period
    new = np.append(True, np.diff(cycle.time) > 1e-9 * cycle.period)
    own, wave = cycle.time[new], cycle.waveform[name][new]
    time = (own - begin) % cycle.period
    order = np.argsort(time)
    order = order[np.append(True, np.diff(time[order]) > 1e-9 * cycle.period)]
    around = np.concatenate([order[-1:], order, order[:3]])
    turns = np.repeat([-1.0, 0.0, 1.0], [1, len(order), len(order[:3])])
    found = time[around] + turns * cycle.period, wave[around], np.gradient(wave, own, edge_order=2)[around]
    if closes(cycle):
        return found
    # Where the period of one that does not close begins anew the line breaks: nothing moves through its misfit.
    seams = np.flatnonzero(np.diff(around) < 0) + 1
    return tuple(np.insert(values, seams, np.nan) for values in found)  # type: ignore[return-value]


def _chosen(cycle: LimitCycle, signal: str | None) -> str:
    known = list(cycle.waveform)
    if signal is not None and signal not in known:
        raise EppError(f"There is no signal {signal!r}; expected one of {', '.join(known)}.")
    return signal or known[0]
