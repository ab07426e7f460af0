"""Bode diagram of measured data and their rational model. Computes nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.methods.rational.result import RationalModel
from eppanalysis.plotting import BLUE, GREY, VERMILLION, places_of, put_legend


def plot_rational(model: RationalModel, ax: Axes | None = None) -> Figure:
    """Magnitude, phase, and the distance of the model to the data; the magnitude alone in given axes."""
    figure, (size, *others) = places_of(ax, 3)
    for value, style, label in ((model.measured, "points", "data"), (model.fitted, "line", "model")):
        kind: dict[str, Any] = {"points": {"marker": ".", "linestyle": "none", "color": GREY}, "line": {"color": BLUE}}[
            style
        ]
        size.plot(model.omega, 20.0 * np.log10(np.abs(value)), label=label, **kind)
        for phase in others[:1]:
            phase.plot(model.omega, np.rad2deg(np.unwrap(np.angle(value))), label=label, **kind)
            phase.set_ylabel("phase [deg]")
    for off in others[1:]:
        off.plot(model.omega, 100.0 * np.abs(model.fitted / model.measured - 1.0), color=VERMILLION)
        off.set_ylabel("distance [%]")
        off.set_yscale("log")
    for panel in (size, *others):
        panel.set_xscale("log")
    (size, *others)[-1].set_xlabel("frequency [rad/s]")
    size.set_ylabel("magnitude [dB]")
    put_legend(size)
    return figure
