"""Pictures of a certificate for a loop with play. Computes nothing that is proved."""

from __future__ import annotations

import json
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.plotting import BLUE, GREY, VERMILLION, place_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from eppanalysis.methods.certificates.play.certify import PlayCertificate


def plot_play_certificate(certificate: PlayCertificate, ax: Axes | None = None) -> Figure:
    """By sectors: a level line of the function, in motion and at rest. By frequency: L(j omega), right of -1.

    Raises
    ------
    EppError
        If there is no proof to draw.
    """
    if not certificate.proved:
        raise EppError(certificate.message)
    figure, ax = place_of(ax, (5.6, 4.4))
    given = json.loads(certificate.text)
    if certificate.method == "sectors":
        _level_lines(ax, given)
    else:
        _frequency_response(ax, given)
    ax.legend(fontsize=7, loc="best", framealpha=0.9)
    return figure


def _floats(value: Any) -> Any:
    return np.array([_floats(item) for item in value]) if isinstance(value, list) else float(Fraction(value))


def _level_lines(ax: Axes, given: dict[str, Any]) -> None:
    """Where the function has one value on the plane of y_1 and y_2, with y_3 = 0."""
    rays, forms, stuck = (_floats(given[name]) for name in ("rays", "moving", "stuck"))
    angles = np.arctan2(rays[:, 1], rays[:, 0])
    fine = np.linspace(angles[0], angles[-1], 721)
    sector = np.clip(np.searchsorted(-angles, -fine, side="right") - 1, 0, len(forms) - 1)
    direction = np.stack([np.cos(fine), np.sin(fine)])
    for matrices, colour, label in (
        (forms[sector][:, :2, :2], BLUE, "play moves"),
        (np.broadcast_to(stuck[:2, :2], (len(fine), 2, 2)), VERMILLION, "play rests"),
    ):
        value = np.einsum("ik,kij,jk->k", direction, matrices, direction)
        radius = np.where(value > 0, 1.0 / np.sqrt(np.where(value > 0, value, 1.0)), np.nan)
        radius = np.where(radius < _REACH * np.nanmin(radius), radius, np.nan)
        ax.plot(*(radius * direction), color=colour, linewidth=1.6, label=label)
    reach = max(*ax.get_xlim(), *ax.get_ylim())
    for ray in rays / np.linalg.norm(rays, axis=1)[:, None] * reach:
        ax.plot([0.0, ray[0]], [0.0, ray[1]], color=GREY, linewidth=0.4)
    ax.set_xlabel("speed of the input of the play")
    ax.set_ylabel("contact coordinate $y_2$, its acceleration and speed")
    ax.set_title(f"No limit cycle: a level of the function in {len(forms)} sectors", fontsize=10)


def _frequency_response(ax: Axes, given: dict[str, Any]) -> None:
    """L(j omega) and the line through -1."""
    num, den = (_floats(given[name]) for name in ("numerator", "denominator"))
    size = max(1e-9, float(np.max(np.abs(np.roots(den)), initial=1.0)))
    s = 1j * size * np.logspace(-4, 3, 1401)
    response = np.polyval(num, s) / np.polyval(den, s)
    shown = np.abs(response) < _REACH
    ax.plot(response.real[shown], response.imag[shown], color=BLUE, linewidth=1.6, label="L(jω)")
    ax.axvline(-1.0, color=VERMILLION, linewidth=1.0, label="real part -1")
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    ax.set_title("No limit cycle: L(jω) stays right of -1", fontsize=10)


#: Levels are drawn out to this many times their smallest radius, frequency responses up to this size.
_REACH = 8.0
