"""The picture of a checked element: its describing function and its energy over the amplitude. Computes nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.arrays import Array
from eppanalysis.methods.elements.result import ElementCheck
from eppanalysis.plotting import BLUE, VERMILLION, label_up, number_powers, places_of, put_legend
from eppanalysis.readable import number


def plot_element_check(found: ElementCheck, ax: Axes | None = None) -> Figure:
    """Real and imaginary part of the describing function, and below the energy that is taken up."""
    figure, (upper, *below) = places_of(ax, 2, height=2.6)
    _draw(upper, found, {"Re N": found.gain.real, "Im N": found.gain.imag}, "describing function N [output over input]")
    for lower in below:
        energies = {
            "input is a displacement [input times output]": found.over_way,
            "input is a speed [input times output times s]": found.over_speed,
        }
        _draw(lower, found, energies, "energy taken up in a period")
    return figure


def _draw(ax: Axes, found: ElementCheck, curves: Mapping[str, Array], label: str) -> None:
    amplitudes = found.amplitudes
    for (name, values), colour, line in zip(curves.items(), (BLUE, VERMILLION), ("-", "--"), strict=True):
        ax.plot(amplitudes, values, line, color=colour, linewidth=1.6, label=name)
    ax.axhline(0.0, color="0.6", linewidth=0.8)
    if amplitudes.size and np.all(amplitudes > 0) and np.ptp(amplitudes) > 0:
        ax.set_xscale("log")
        number_powers(ax.xaxis, (2.0, 5.0))
    ax.set_xlabel(f"amplitude A of the input [its unit], at {number(found.omega)} rad/s")
    label_up(ax, label)
    put_legend(ax)
