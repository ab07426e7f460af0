"""Picture of a diagnosis: the record folded to one period with the waveform of what explains it, a panel a signal."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.diagnose.record import waveform
from eppanalysis.diagnose.result import Diagnosis, Explanation
from eppanalysis.plotting import (
    BLUE,
    GREEN,
    GREY,
    VERMILLION,
    label_of,
    label_time,
    label_up,
    legend_below,
    places_of,
    put_legend,
)

#: Points of a record that are drawn, and points of a waveform.
_MOST_POINTS, _POINTS = 4000, 400
_COLOURS = ((VERMILLION, "-"), (BLUE, "--"), (GREEN, "-."))


def plot_diagnosis(found: Diagnosis, ax: Axes | None = None) -> Figure:
    """The record over the phase of its oscillation, and the waveforms of the likeliest candidates.

    Parameters
    ----------
    ax : matplotlib.axes.Axes, optional
        Where to draw the first signal alone; all of them on a figure of their own by default.
    """
    oscillation, record = found.oscillation, found.record
    figure, panels = places_of(ax, len(oscillation.names), 1.9)
    t = record.time - oscillation.middle
    turns = t / oscillation.period
    grown = np.exp(oscillation.growth * turns)
    some = slice(None, None, max(1, len(t) // _MOST_POINTS))
    phase = np.linspace(0.0, 1.0, _POINTS)
    for i, (name, panel) in enumerate(zip(oscillation.names, panels, strict=False)):
        label, factor = label_of(name, found.units)
        values = record.signals[name] - oscillation.mean[name] - oscillation.drift[name] * t
        points = factor * (values / grown)[some]
        panel.plot(turns[some] % 1.0, points, ".", color=GREY, markersize=2.0, label="record")
        for explanation, (colour, style) in zip(_drawn(found), _COLOURS, strict=False):
            y = factor * waveform(oscillation, explanation.harmonics[i], phase * oscillation.period)
            panel.plot(phase, y, style, color=colour, linewidth=1.5, label=explanation.called)
        label_up(panel, label)
    label_time(panels, "periods of the record")
    if ax is None:
        legend_below(figure, panels[0])
    else:
        put_legend(ax)
    return figure


def _drawn(found: Diagnosis) -> list[Explanation]:
    """What is named, or the nearest candidate where none is."""
    return list(found.named) or [e for e in found if e.harmonics.size][:1]
