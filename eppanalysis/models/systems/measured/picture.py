"""Bode diagrams of measured frequency responses. Computes nothing."""

from __future__ import annotations

from typing import Any

import numpy as np

from eppanalysis.models.systems.measured.matrix import MeasuredMatrix
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.plotting import BLUE, GREEN, GREY, ORANGE, SKY, VERMILLION, Axes, Figure, places_of, put_legend

#: Of paths beside each other, in this order; what follows repeats the colours with the next style.
_COLOURS, _STYLES = (BLUE, VERMILLION, GREEN, ORANGE, SKY), ("-", "--", ":", "-.")
#: Points of the curve between two that were measured.
_BETWEEN = 8


def plot_response(response: MeasuredResponse, ax: Axes | None = None) -> Figure:
    """Magnitude and phase of the points, with the curve that interpolates the response between them."""
    figure, panels = places_of(ax, 2)
    _draw(panels, response, "curve through them" if response.deviation is None else "curve fitted to them")
    return _finished(figure, panels)


def plot_matrix(matrix: MeasuredMatrix, ax: Axes | None = None) -> Figure:
    """The same of all paths, in a colour each."""
    figure, panels = places_of(ax, 2)
    for k, (i, j, response) in enumerate(matrix.known):
        line = {"color": _COLOURS[k % len(_COLOURS)], "linestyle": _STYLES[k // len(_COLOURS) % len(_STYLES)]}
        _draw(panels, response, f"output {i + 1}, input {j + 1}", line)
    return _finished(figure, panels)


def _draw(panels: list[Axes], response: MeasuredResponse, label: str, line: dict[str, Any] | None = None) -> None:
    """One response: its points in grey, its curve over them."""
    curve = response.curve
    x = curve.log_omega
    between = np.interp(np.arange(_BETWEEN * (len(x) - 1) + 1) / _BETWEEN, np.arange(len(x)), x)
    # Of the logarithm of the response the first part is that of the magnitude, the second the phase.
    for k, (ax, factor) in enumerate(zip(panels, (20.0 / np.log(10.0), 180.0 / np.pi), strict=False)):
        dots: dict[str, Any] = {"marker": ".", "linestyle": "none", "color": GREY, "markersize": 4}
        ax.plot(np.exp(x), factor * curve.points[:, k], label="measured", **dots)
        ax.plot(np.exp(between), factor * curve.spline(between)[:, k], label=label, **(line or {"color": BLUE}))


def _finished(figure: Figure, panels: list[Axes]) -> Figure:
    for ax, what in zip(panels, ("magnitude [dB]", "phase [deg]"), strict=False):
        ax.set_xscale("log")
        ax.set_ylabel(what)
    panels[-1].set_xlabel("frequency [rad/s]")
    put_legend(panels[0])
    return figure
