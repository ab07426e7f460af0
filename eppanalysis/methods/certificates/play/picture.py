"""Picture of the function that falls along every motion of a loop with play. Computes nothing that is proved."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from eppanalysis.plotting import BLUE, GREY, VERMILLION, put_legend

#: Levels are drawn out to this many times their smallest radius.
_REACH = 8.0


def _floats(value: Any) -> Any:
    return np.array([_floats(item) for item in value]) if isinstance(value, list) else float(Fraction(value))


def plot_level(given: Mapping[str, Any], ax: Axes) -> None:
    """Where the function has one value on the plane of y_1 and y_2, with y_3 = 0, while the play moves and rests.

    Of a range the function at its last end.
    """
    rays, forms, stuck = map(_floats, (given["rays"], given["moving"][-1], given["stuck"][-1]))
    angles = np.arctan2(rays[:, 1], rays[:, 0])
    fine = np.linspace(angles[0], angles[-1], 721)
    sector = np.clip(np.searchsorted(-angles, -fine, side="right") - 1, 0, len(forms) - 1)
    direction = np.stack([np.cos(fine), np.sin(fine)])
    for matrices, style, colour, label in (
        (forms[sector][:, :2, :2], "-", BLUE, "falling function equal to 1 while the play moves"),
        (np.broadcast_to(stuck[:2, :2], (len(fine), 2, 2)), "--", VERMILLION, "the same while it rests"),
    ):
        value = np.einsum("ik,kij,jk->k", direction, matrices, direction)
        radius = np.where(value > 0, 1.0 / np.sqrt(np.where(value > 0, value, 1.0)), np.nan)
        radius = np.where(radius < _REACH * np.nanmin(radius), radius, np.nan)
        ax.plot(*(radius * direction), style, color=colour, linewidth=1.6, label=label)
    reach = max(*ax.get_xlim(), *ax.get_ylim())
    for ray in rays / np.linalg.norm(rays, axis=1)[:, None] * reach:
        ax.plot([0.0, ray[0]], [0.0, ray[1]], color=GREY, linewidth=0.4, label="borders of the sectors")
    ax.set_xlabel("contact coordinate $y_1$: speed of the input of the play")
    ax.set_ylabel("contact coordinate $y_2$:\nits acceleration and speed")
    put_legend(ax)
