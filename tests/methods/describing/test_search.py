"""The search of a loop with one element, against what its balance says where it can be solved in one line."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import eppanalysis as epp

#: Half the distance of the relay's thresholds.
H = 0.3


@pytest.mark.parametrize("damping", [1e-7, 1e-4, 1e-2])
@pytest.mark.parametrize("gain", [1e-3, 1e-2, 0.1, 1.0, 30.0])
def test_cycles_at_a_resonance_are_those_of_the_relays_locus(damping: float, gain: float) -> None:
    """Minus one over the gain of a relay with hysteresis lies a fixed way below the real axis: one equation in omega.

    Beside a resonance the gain of the loop passes one between points that are both far from it.
    """
    den = np.polymul([1.0, 2.0 * damping, 1.0], np.polymul([1.0, 0.2], [1.0, 2.0]))
    loop = epp.LureSystem.from_tf(([gain], den), epp.HysteresisRelay(-H, H))

    def below(omega: float) -> float:
        return float((gain / np.polyval(den, 1j * omega)).imag + np.pi * H / 4.0)

    beside = np.geomspace(1e-10, 0.5, 4000)
    nodes = np.concatenate([np.geomspace(1e-6, 0.5, 4000), 1.0 - beside[::-1], [1.0], 1.0 + beside, [1.6, 3.0, 1e3]])
    sizes = [below(w) for w in nodes]
    wanted = [
        brentq(below, a, b, xtol=1e-15)
        for a, b, y, z in zip(nodes[:-1], nodes[1:], sizes[:-1], sizes[1:], strict=True)
        if y * z < 0
    ]
    wanted = [w for w in wanted if (gain / np.polyval(den, 1j * w)).real < 0]
    found = sorted(c.omega for c in epp.predict_limit_cycles(loop))
    assert np.allclose(found, wanted, rtol=1e-9, atol=0.0) if wanted else not found


@pytest.mark.slow
def test_an_encoder_of_many_levels_has_the_cycles_of_one_of_few() -> None:
    """Among the first levels no further one counts; they cost as many evaluations as there are, not their square."""
    few, many = (
        epp.predict_limit_cycles(epp.LureSystem.from_tf(([5.0], [1.0, 3.0, 2.0, 0.0]), epp.Quantiser(0.01, levels)))
        for levels in (200, 20_000)
    )
    assert len(few) == 2 and str(few) == str(many)
    wanted, found = (sorted((c.omega, *c.amplitudes.values()) for c in cycles) for cycles in (few, many))
    assert np.allclose(found, wanted, rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("gain", "poles", "edges", "levels"),
    [
        (0.331, (0.0, 2.41), (-1.55, 1.24), (-1.0, 1.0)),
        (0.514, (0.0, 2.82), (-0.44, 0.53), (-1.0, 1.0)),
        (0.458, (0.0, 1.53), (-1.19, 0.52), (-1.14, 1.07)),
        (1.502, (0.0, 2.39), (-1.29, 0.76), (-0.95, 1.36)),
        (2.438, (0.013, 2.55), (-1.33, 1.81), (-0.73, 0.8)),
        (0.469, (0.2622, 1.7398), (-0.28, 0.26), (-0.97, 1.42)),
    ],
)
def test_an_oscillation_that_hardly_reaches_both_thresholds_is_found_about_any_bias(
    gain: float, poles: tuple[float, float], edges: tuple[float, float], levels: tuple[float, float]
) -> None:
    """The output is high from one crossing to the other: its mean and first harmonic are integrals of two pieces."""
    den = np.poly(np.negative(poles))
    relay = epp.HysteresisRelay(*edges, *levels)
    (cycle,) = epp.predict_limit_cycles(epp.LureSystem.from_tf(([gain], den), relay))
    a, b, omega = cycle.amplitude("x"), cycle.mean["x"], cycle.omega
    rise, fall = np.arcsin((edges[1] - b) / a), np.pi - np.arcsin((edges[0] - b) / a)
    mean = levels[0] + np.ptp(levels) * (fall - rise) / (2.0 * np.pi)
    harmonic = np.ptp(levels) / np.pi * (np.exp(-1j * rise) - np.exp(-1j * fall)) / 1j
    assert a < 0.55 * np.ptp(edges)
    assert np.polyval(den, 0.0) * b == pytest.approx(-gain * mean, abs=1e-9)
    assert -1j * a == pytest.approx(-gain / np.polyval(den, 1j * omega) * harmonic, rel=1e-8)
