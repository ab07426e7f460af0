"""The picture of a certified orbit: its multipliers beside the unit circle. Computes nothing."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
from eppanalysis.plotting import BLUE, place_of


def plot_multiplier_discs(orbit: CertifiedOrbit, ax: Axes | None = None) -> Figure:
    """Discs that hold the multipliers; those too small to be seen are marked by a cross at their centre."""
    figure, ax = place_of(ax, 4.4)
    ax.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor="0.6", linestyle="--", linewidth=0.8))
    for centre, radius in zip(orbit.multipliers, orbit.multiplier_radii, strict=True):
        ax.add_patch(Circle((centre.real, centre.imag), radius, facecolor=BLUE, alpha=0.3, edgecolor=BLUE))
    ax.plot(orbit.multipliers.real, orbit.multipliers.imag, "+", color=BLUE)
    ends = np.append(np.abs(orbit.multipliers) + orbit.multiplier_radii, 1.0)
    reach = 1.15 * float(np.max(np.where(np.isfinite(ends), ends, 1.0)))
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    return figure
