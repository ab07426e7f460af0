"""Picture of the convergence of harmonic balance to the exact orbit."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import eppanalysis as epp
from eppanalysis.plotting import BLUE, GREEN, GREY, SMALL, VERMILLION, place_of, put_legend

ORDERS = (1, 3, 5, 7, 9, 13, 17, 25, 35, 49, 65)

#: Case, label, order n**-rate that the smoothness of the element and the relative degree of the plant predict.
LOOPS = (
    ("relay_hyst_goncalves6", "relay (jump), relative degree 1", 1, VERMILLION, "o"),
    ("relay_ideal_khalil79", "relay (jump), relative degree 3", 3, VERMILLION, "s"),
    ("sat_khalil710", "saturation (corner), relative degree 1", 3, BLUE, "o"),
    ("sat_am165", "saturation (corner), relative degree 3", 5, BLUE, "s"),
    ("van_der_pol_mu1", "cube (smooth)", None, GREEN, "^"),
)


def errors(name: str) -> tuple[list[float], list[float]]:
    """True relative error of the frequency against the exact orbit, and the estimate, at each order."""
    case = epp.case(name)
    system, exact = case.to_system(), case.expected.exact[-1]
    guess = epp.predict_limit_cycles(system)[-1]
    cycles = [epp.harmonic_balance(system, guess, n) for n in ORDERS]
    return [abs(c.omega / exact.omega - 1) for c in cycles], [c.error_estimate for c in cycles]


def harmonic_convergence() -> Figure:
    """Error against order for elements that jump, have corners or are smooth, with the slopes of theory."""
    figure, ax = place_of(None, 4.6)
    n = np.array(ORDERS, float)
    for name, label, rate, colour, marker in LOOPS:
        true, estimated = errors(name)
        ax.loglog(n, np.maximum(true, 1e-16), marker=marker, color=colour, linewidth=1.2, markersize=4.5, label=label)
        ax.loglog(n, np.maximum(estimated, 1e-16), color=colour, linewidth=0.8, linestyle=":")
        if rate is not None:
            high = n[n >= 9]
            ax.loglog(high, 2.5 * true[-1] * (high / n[-1]) ** -rate, color=GREY, linewidth=0.8, linestyle="--")
            ax.annotate(f" $n^{{-{rate}}}$", (n[-1], 2.5 * true[-1]), va="center", fontsize=SMALL, color="#555555")
    ax.set_xlabel("order n of the harmonic balance")
    ax.set_ylabel("relative error of the frequency")
    ax.set_ylim(1e-16, 1.0)
    ax.set_xlim(0.9, 85.0)
    ax.set_xticks([1, 3, 5, 9, 17, 35, 65], labels=["1", "3", "5", "9", "17", "35", "65"])
    ax.minorticks_off()
    ax.spines[["top", "right"]].set_visible(False)
    ax.plot([], [], color="black", linewidth=0.8, linestyle=":", label="estimate (frequency and fundamentals)")
    put_legend(ax)
    return figure
