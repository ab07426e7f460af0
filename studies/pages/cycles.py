"""Pictures of exact cycles: the basins of the original elbow, and its branch over the backlash."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

import eppanalysis as epp
from eppanalysis.methods.search.basin import REST, basin
from eppanalysis.plotting import BLUE, DARK_SKY, SKY, VERMILLION, place_of, put_legend

N_GRID = 31
REACH = np.radians(3.0), np.radians(130.0)


def elbow_basins() -> Figure:
    """Where runs of the resting elbow end when its forearm is displaced and pushed, with both cycles over it."""
    case = epp.case("fig8a_original")
    system, value = case.to_system(), case.operating_point
    found = epp.find_limit_cycles(system, value)
    angle, speed = (system.state_names.index(name) for name in ("theta", "theta_dot"))
    grid = np.array(np.meshgrid(*(np.linspace(-r, r, N_GRID) for r in REACH), indexing="ij")).reshape(2, -1).T
    starts = np.repeat(found.rest_state[None], len(grid), axis=0)
    starts[:, angle] += grid[:, 0]
    starts[:, speed] += grid[:, 1]
    ends = basin(system, found, starts, value).ends
    figure, ax = place_of(None, 4.4)
    kinds = ((ends == REST, "none", "ends at rest"), (ends >= 0, SKY, "ends on the stable cycle"))
    for chosen, colour, label in kinds:
        ax.plot(*np.degrees(grid[chosen]).T, "o", markersize=3.4, mfc=colour, mec=DARK_SKY, mew=1.1, label=label)
    if np.any(ends < REST):
        ax.plot(*np.degrees(grid[ends < REST]).T, "x", color="black", label="neither")
    middle = found.rest_state[angle]
    for cycle in found:
        style: dict[str, Any] = (
            {"color": BLUE, "linestyle": "-"} if cycle.stable else {"color": VERMILLION, "linestyle": "--"}
        )
        wave = [np.append(cycle.waveform[k], cycle.waveform[k][0]) for k in ("theta", "theta_dot")]
        label = "stable cycle" if cycle.stable else "unstable cycle"
        ax.plot(np.degrees(wave[0] - middle), np.degrees(wave[1]), linewidth=1.8, label=label, **style)
    ax.set_xlabel("forearm's angle from rest [deg]")
    ax.set_ylabel("forearm's velocity [deg/s]")
    put_legend(ax)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def elbow_branch() -> Figure:
    """The limit cycles of the elbow over its backlash: born in a fold."""
    case = epp.case("fig8a_original")
    return (
        epp.continue_branch(case, "lock_pin.backlash", "2.5 deg", "0.6 deg", n_simulated=9).plot(signal="theta").figure
    )
