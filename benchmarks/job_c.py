"""Job C: a million describing-function evaluations of the five-band law."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad

import eppanalysis as epp
from benchmarks.timing import Contender, alternate
from tests.reference.elbow_reference import LBF

Array = NDArray[np.float64]

TARGET = 1000.0
#: Amplitudes that python-control is given (its time per evaluation does not depend on how many there are).
SAMPLE = 1000


def typed_in(law: epp.FiveBandLaw, centre: float) -> Callable[[float], float]:
    """The five-band law as a user would type it for python-control, centred on its parking band."""
    low, high, most, ramp = law.low - centre, law.high - centre, law.supply_voltage, law.max - law.high

    def voltage(force: float) -> float:
        if force > high:
            return min((force - high) / ramp, 1.0) * most
        if force < low:
            return -min((low - force) / ramp, 1.0) * most
        return 0.0

    return voltage


def law() -> tuple[epp.FiveBandLaw, float]:
    """The nominal law, and the middle of its parking band [N]."""
    bands = {"slack": 1.25 * LBF, "low": 2.4 * LBF, "high": 2.6 * LBF, "max": 3.75 * LBF}
    return epp.FiveBandLaw(**bands, supply_voltage=16.0), 2.5 * LBF


def gain_by_quadrature(law: epp.FiveBandLaw, centre: float, amplitude: float) -> float:
    """First Fourier coefficient over the amplitude, integrated from corner to corner of the law."""
    f = typed_in(law, centre)
    corners = [np.arcsin(c / amplitude) for c in (law.high - centre, law.max - centre) if c < amplitude]
    edges = [0.0, *corners, np.pi / 2.0]
    parts = (
        quad(lambda p: f(amplitude * np.sin(p)) * np.sin(p), a, b, epsabs=1e-13, epsrel=1e-13)[0]
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    )
    return 4.0 / np.pi * sum(parts) / amplitude


def run(n: int = 1_000_000, turns: int = 5, clock: str = "wall") -> dict[str, Any]:
    """The job: ratio per evaluation, and the largest error against quadrature relative to the largest gain."""
    bands, centre = law()
    theirs = typed_in(bands, centre)
    amplitudes = np.linspace(0.01, 20.0, n)
    sample = np.linspace(0.6, 20.0, min(SAMPLE, n))

    ours = Contender("eppanalysis", lambda: bands.describing_function(amplitudes, centre)[1])
    rival = Contender("python-control", lambda: control.describing_function(theirs, sample))
    timings = alternate(ours, [rival], turns, clock)
    checked = sample[:: max(1, sample.size // 100)]
    exact = np.array([gain_by_quadrature(bands, centre, a) for a in checked])
    rows = []
    for c, count, gains in (
        (ours, n, bands.describing_function(checked, centre)[1].real),
        (rival, sample.size, np.real(control.describing_function(theirs, checked))),
    ):
        t = timings[c.name]
        ratio = t.ratio * n / count
        target = TARGET if c is rival else None
        rows.append(
            {
                "name": c.name,
                "evaluations_timed": count,
                "seconds_per_evaluation": t.seconds / count,
                "seconds": t.seconds / count * n,
                "turns": t.turns,
                "ratio": ratio,
                "error": float(np.abs(gains - exact).max() / exact.max()),
                "target": target,
                "met": None if target is None else bool(ratio >= target),
            }
        )
    return {"evaluations": n, "rows": rows}
