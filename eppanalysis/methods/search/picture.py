"""All limit cycles of a loop in one picture: waveforms and phase portrait. Computes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eppanalysis.errors import EppError
from eppanalysis.plotting import BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION, with_name
from eppanalysis.readable import readable, with_unit, words

if TYPE_CHECKING:
    from eppanalysis.methods.search.result import CycleSearch
    from eppanalysis.results import LimitCycle

Array = NDArray[np.float64]

_STABLE, _UNSTABLE = (BLUE, GREEN, SKY), (VERMILLION, ORANGE, GREY)
#: More than these cannot be told apart in one picture.
_MOST = 12


def plot_cycles(search: CycleSearch, signal: str | None = None) -> Figure:
    """Every cycle's waveform over its own period, and the signal's rate over the signal; stable solid, unstable dashed.

    Waveforms begin where their fundamental rises through zero.

    Parameters
    ----------
    search : CycleSearch
    signal : str, optional
        The first one by default.

    Raises
    ------
    EppError
        If there is no such signal.
    """
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    figure.suptitle(with_name(_title(search), search.provenance.subject), fontsize=10)
    for ax in (left, right):
        ax.spines[["top", "right"]].set_visible(False)
    if not len(search):
        for ax in (left, right):
            ax.set_axis_off()
        return figure
    name = _chosen(search, signal)
    unit, factor = readable(search[0].units.get(name, ""))
    used = {True: 0, False: 0}
    for cycle in search.cycles[:_MOST]:
        stable = bool(cycle.stable)
        colours = _STABLE if stable else _UNSTABLE
        style = {"color": colours[used[stable] % 3], "linestyle": "-" if stable else "--", "linewidth": 1.3}
        used[stable] += 1
        time, wave = _turned(cycle, name)
        left.plot(
            time / cycle.period,
            factor * wave,
            label=f"{'stable' if stable else 'unstable'}, {cycle.frequency:.4g} Hz",
            **style,
        )
        right.plot(factor * wave, factor * np.gradient(wave, time), **style)
    left.set_xlabel("time over period")
    left.set_ylabel(with_unit(words(name), unit))
    right.set_xlabel(with_unit(words(name), unit))
    right.set_ylabel(with_unit(f"rate of {words(name)}", f"{unit or '1'}/s"))
    left.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    return figure


def _turned(cycle: LimitCycle, name: str) -> tuple[Array, Array]:
    """Times and waveform of one period and a bit, from the rise of the fundamental through zero on."""
    begin = (-np.pi / 2 - np.angle(cycle.harmonics[name][1])) / (2 * np.pi) * cycle.period
    time = (cycle.time - begin) % cycle.period
    order = np.argsort(time)
    time, wave = time[order], cycle.waveform[name][order]
    new = np.append(True, np.diff(time) > 1e-9 * cycle.period)
    time, wave = time[new], wave[new]
    return np.append(time, time[:2] + cycle.period), np.append(wave, wave[:2])


def _chosen(search: CycleSearch, signal: str | None) -> str:
    known = list(search[0].waveform)
    if signal is not None and signal not in known:
        raise EppError(f"There is no signal {signal!r}; expected one of {', '.join(known)}.")
    return signal or known[0]


def _title(search: CycleSearch) -> str:
    if not len(search):
        return "no limit cycle"
    counts = [f"{len(c)} {kind}" for c, kind in ((search.stable, "stable"), (search.unstable, "unstable")) if c]
    shown = f", the smallest {_MOST} shown" if len(search) > _MOST else ""
    return f"{' and '.join(counts)} limit cycle{'' if len(search) == 1 else 's'}{shown}"
