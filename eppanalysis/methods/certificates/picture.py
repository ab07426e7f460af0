"""Pictures of certificates: the cover of a box with its roots, the Popov plot, a level line. Computes nothing new."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.play.picture import plot_level
from eppanalysis.methods.certificates.registry import Claim
from eppanalysis.methods.certificates.result import Certificate
from eppanalysis.plotting import BLUE, VERMILLION, place_of, put_legend
from eppanalysis.readable import number


def plot_certificate(certificate: Certificate, ax: Axes | None = None) -> Figure:
    """What a certificate shows, by its statement."""
    if not certificate.document:
        raise EppError(f"There is no picture of a certificate that is none. {certificate.message}")
    figure, ax = place_of(ax, 4.0)
    if certificate.statement is Claim.ROOTS:
        _plot_cover(certificate, ax)
    elif "sectors" in certificate.document["claim"]:
        plot_level(certificate.document["evidence"], ax)
    elif "cells" in certificate.document["claim"]:
        _plot_cells(certificate, ax)
    elif "backlash" in certificate.document["claim"]:
        _plot_sizes(certificate, ax)
    else:
        _plot_popov(certificate, ax)
    return figure


def _plot_sizes(certificate: Certificate, ax: Axes) -> None:
    """What the gap and the elasticity let the drive gain, as a share of what it loses, over the frequency."""
    from eppanalysis.methods.certificates.elbow.find import gained

    omega = np.geomspace(1.0, 1e4, 401)
    ax.semilogx(omega, gained(certificate.document, omega), color=BLUE)
    ax.axhline(1.0, color=VERMILLION, linewidth=1.0)
    ax.set_xlabel("angular frequency [rad/s]")
    ax.set_ylabel("gained as a share of lost")


def _plot_cover(certificate: Certificate, ax: Axes) -> None:
    """Boxes without a root in grey, those in the region of one in blue, undecided ones in red; dots are roots."""
    from eppanalysis.methods.certificates.roots.find import all_leaves

    colours = {".": "0.94", "r": BLUE, "?": VERMILLION}
    leaves = [(mark, [float(Fraction(str(x))) for x in leaf]) for mark, leaf in all_leaves(certificate.document)]
    # Seen along the bias, what is not empty lies in front.
    leaves.sort(key=lambda leaf: ".r?".index(leaf[0]) * (len(leaf[1]) > 4))
    corners = [[(a, c), (b, c), (b, d), (a, d)] for _, (a, b, c, d, *_) in leaves]
    faces = [colours[mark] for mark, _ in leaves]
    ax.add_collection(PolyCollection(corners, facecolors=faces, edgecolors="0.6", linewidths=0.3))
    for k, root in enumerate(certificate.roots):
        ax.plot(root.amplitude[0], root.omega[0], "ko", mfc="none", markersize=9, label="a root" * (k == 0))
    marks = {mark for mark, _ in leaves}
    said = {".": "proved: no root", "r": "proved: this root alone", "?": "undecided"}
    for mark in [mark for mark in said if mark in marks]:
        ax.fill_between([], [], facecolor=colours[mark], edgecolor="0.6", linewidth=0.3, label=said[mark])
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.autoscale_view()
    ax.set_xlabel("amplitude at the element's input")
    ax.set_ylabel("angular frequency [rad/s]")
    put_legend(ax)


def _plot_cells(certificate: Certificate, ax: Axes) -> None:
    """Cells of the return map, the darker the more of them a motion may pass before it ends; dots are limit cycles."""
    from eppanalysis.methods.certificates.check_cells import GRID, leaves
    from eppanalysis.methods.certificates.result import cycles_of

    evidence, claim = certificate.document["evidence"], certificate.document["claim"]
    corners = [[(a, c), (b, c), (b, d), (a, d)] for a, b, c, d in np.array([*leaves(evidence["cover"])]) / 2.0**GRID]
    cells = PolyCollection(corners, array=np.array(evidence["order"], float), cmap="Greys", edgecolors="none")
    ax.add_collection(cells)
    for (place, _), cycle in zip(evidence["forms"], cycles_of(claim), strict=True):
        held = [c for c, n in zip(corners, evidence["order"], strict=True) if n == place]
        x, y = np.mean([np.mean(c, axis=0) for c in held], axis=0)
        said = f"{np.mean(cycle['period']):.4g} s, {'un' * (cycle['outside'] > 0)}stable"
        ax.plot(x, y, "o", color=VERMILLION if cycle["outside"] else BLUE, markersize=5, label=said)
    ax.autoscale_view()
    ax.set_xlabel("speed at the switch, of the greatest")
    ax.set_ylabel("acceleration, of the greatest")
    if claim["cycles"]:
        put_legend(ax)


def _plot_popov(certificate: Certificate, ax: Axes) -> None:
    """Popov's curves of the loops from the lower edge of the sector, and the line that they stay on one side of."""
    loop, claim = certificate.document["loop"], certificate.document["claim"]
    nums, dens = ([np.array([float(Fraction(c)) for c in row]) for row in loop[name]] for name in ("num", "den"))
    low, high = (None if edge is None else float(Fraction(edge)) for edge in claim["sector"])
    rate, floor = float(Fraction(claim["multiplier"])), 0.0 if low is None else low
    edge, curves = 0.0 if high is None else -1.0 / (high - floor), []
    step = None if loop["time_step"] is None else float(Fraction(loop["time_step"]))
    given = loop["delay"] if isinstance(loop["delay"], list) else [loop["delay"]]
    for num, den, late in ((*row, float(Fraction(delay))) for row in zip(nums, dens, strict=True) for delay in given):
        sizes = np.abs(np.concatenate([np.roots(np.polyadd(den, floor * num)), np.roots(num)]))
        scales = sizes[sizes > 0] if np.any(sizes > 0) else np.ones(1)
        omega = np.geomspace(scales.min() / 300.0, scales.max() * 300.0, 2000)
        if step is not None:
            omega = np.linspace(0.0, np.pi / step, 2001)[1:]
        at = 1j * omega if step is None else np.exp(1j * omega * step)
        driven = np.polyval(num, at) * np.exp(-1j * omega * late)
        response = driven / (np.polyval(den, at) + floor * driven)
        curves.append((response.real, omega * response.imag))
        ax.plot(*curves[-1], color=BLUE, linewidth=1.6, label="Popov's curve" if len(curves) == 1 else "")
    if low is None:
        ax.axhline(0.0, color=VERMILLION, linewidth=1.0, label="line that it stays on one side of")
    else:
        # Re[(1 + j omega r) G] + 1/k > 0 is x - r y > -1/k: one side
        # of a line (docs/theory/proofs.md, No periodic motion).
        heights = np.array([min(y.min() for _, y in curves), max(y.max() for _, y in curves)])
        label = f"line that it stays to the right of (multiplier {number(rate)} s)"
        ax.plot(edge + rate * heights, heights, color=VERMILLION, linewidth=1.0, label=label)
        ax.plot([edge], [0.0], "k+", markersize=10, label=f"{number(edge)}, the edge of the sector")
    ax.set_xlabel("Re G(jω)")
    ax.set_ylabel("ω Im G(jω) [1/s]")
    put_legend(ax)
