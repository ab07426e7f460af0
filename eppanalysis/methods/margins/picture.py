"""The Nyquist plot of a loop that is cut open at a place, and Nichols' chart of an onset point. Computes nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eppanalysis.methods.margins.olop_result import BOUNDARY, OnsetPoint
from eppanalysis.methods.margins.result import Margins
from eppanalysis.plotting import BLUE, DARK, GREEN, VERMILLION, place_of, put_legend

#: Half the width of the window; and loop gains that are drawn, beyond its corners, so that a curve goes to its edge.
_REACH = 2.5
_DRAWN = 2.0 * np.sqrt(2.0) * _REACH
#: The mark of -1.
_CRITICAL: dict[str, Any] = {"marker": "+", "color": "k", "markersize": 10, "linestyle": "none", "label": "-1"}


def plot_margins(margins: Margins, ax: Axes | None = None) -> Figure:
    """L(j omega) about -1, the unit circle, and where the margins are taken."""
    shown = np.abs(margins.response) < _DRAWN
    figure, ax = place_of(ax, 4.2 if np.any(shown) else 0.6)
    if not np.any(shown):
        ax.set_axis_off()
        ax.text(0.5, 0.5, "There is no open loop to draw.", transform=ax.transAxes, ha="center", color=DARK)
        return figure
    L = np.where(shown, margins.response, np.nan)
    ax.plot(L.real, L.imag, color=BLUE, linewidth=1.6, label="L(jω)")
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    ax.plot(np.cos(turn), np.sin(turn), color="0.6", linewidth=0.8, linestyle="--")
    ax.plot([-1.0], [0.0], **_CRITICAL)
    if np.isfinite(margins.gain_margin) and margins.gain_margin:
        ax.plot(
            [-1.0 / margins.gain_margin],
            [0.0],
            "s",
            mfc="none",
            mec=GREEN,
            label=f"gain margin {margins.gain_margin:.4g}",
        )
    if np.isfinite(margins.gain_crossover):
        there = -np.exp(1j * margins.phase_margin)
        label = f"phase margin {np.rad2deg(margins.phase_margin):.4g} deg"
        ax.plot([there.real], [there.imag], "o", mfc="none", mec=GREEN, label=label)
    ax.set_xlim(-_REACH, _REACH)
    ax.set_ylim(-_REACH, _REACH)
    ax.set_aspect("equal")
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    put_legend(ax)
    return figure


def plot_onset_point(point: OnsetPoint, ax: Axes | None = None) -> Figure:
    """Nichols chart: the open loop, Duda's boundary, and the onset point."""
    figure, ax = place_of(ax, 4.2)
    phase, decibels = np.array(BOUNDARY).T
    L = point.response[np.abs(point.response) > 0]
    turned = np.rad2deg(np.unwrap(np.angle(L)))
    # The branch on which the point lies.
    if np.isfinite(point.omega):
        here = np.interp(point.omega, point.frequencies[np.abs(point.response) > 0], turned)
        turned += 360.0 * np.round((np.rad2deg(point.phase) - here) / 360.0)
    ax.plot(turned, 20.0 * np.log10(np.abs(L)), color=BLUE, linewidth=1.6, label="open loop")
    ax.plot(phase, decibels, "--", color=VERMILLION, linewidth=1.6, label="boundary")
    ax.fill_between(phase, decibels, 60.0, color=VERMILLION, alpha=0.25, linewidth=0, label="prone to jump")
    if np.isfinite(point.omega):
        there = [np.rad2deg(point.phase)], [20.0 * np.log10(point.gain)]
        ax.plot(*there, "o", color=GREEN, markersize=8, label=f"onset at {point.omega:.4g} rad/s", zorder=5)
    ax.plot([-180.0], [0.0], **_CRITICAL)
    ax.set_xlim(-270.0, 0.0)
    ax.set_ylim(-20.0, 25.0)
    ax.set_xticks(np.arange(-270.0, 1.0, 45.0))
    ax.set_xlabel("phase of the open loop [deg]")
    ax.set_ylabel("magnitude [dB]")
    put_legend(ax)
    return figure
