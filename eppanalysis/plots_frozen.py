"""The Nyquist picture of a loop that is cut at one element, the others frozen. Computes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from eppanalysis.plots import BLUE, GREEN, GREY, VERMILLION

if TYPE_CHECKING:
    from eppanalysis.methods.describing_frozen import FrozenLoop


def plot_frozen(loop: FrozenLoop) -> Figure:
    """G(j omega) of the rest of the loop, -1/N of the element at the cut, and the motion that the rest is frozen at."""
    figure = Figure(figsize=(5.6, 4.4), layout="constrained")
    ax = figure.add_subplot()
    ax.axhline(0.0, color=GREY, linewidth=0.5)
    ax.axvline(0.0, color=GREY, linewidth=0.5)
    ax.plot(loop.response.real, loop.response.imag, color=BLUE, linewidth=1.3, label=r"$G(j\omega)$")
    style: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.3, "linestyle": "--"}
    ax.plot(loop.locus.real, loop.locus.imag, label=r"$-1/N(A)$", **style)
    reach = 1.3 * float(np.abs(loop.locus).min() if loop.point is None else abs(loop.point))
    if loop.point is not None:
        mark: dict[str, Any] = {"mfc": "none", "mec": GREEN, "mew": 1.8, "markersize": 9, "linestyle": "none"}
        ax.plot([loop.point.real], [loop.point.imag], marker="o", label="the cycle", zorder=5, **mark)
    ax.set_xlim(-2.0 * reach, 0.8 * reach)
    ax.set_ylim(-1.3 * reach, 1.3 * reach)
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    ax.set_title(f"Nyquist, cut at {loop.element.replace('_', ' ')}", fontsize=10)
    ax.legend(fontsize=7, loc="best", framealpha=0.9)
    return figure
