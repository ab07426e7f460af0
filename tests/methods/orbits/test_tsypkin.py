"""Symmetric cycles of one relay at all half periods, against closed forms by residues of the plant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.signal import residue

import eppanalysis as epp
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.orbits.shooting import close_orbit
from eppanalysis.methods.orbits.tsypkin import Pulses, _grown
from tests.coordinates import rotated
from tests.methods.orbits.test_locus import HalfPeriod


def ringing(rng: np.random.Generator) -> tuple[list[float], np.ndarray]:
    damping, speed, lag, gain = rng.uniform(0.03, 0.2), rng.uniform(0.5, 3.0), rng.uniform(0.1, 0.6), rng.uniform(2, 20)
    return [gain * lag * speed**2], np.polymul([1.0, 2.0 * damping * speed, speed**2], [1.0, lag, 0.0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_search_lists_all_cycles_of_a_relay_with_dead_zone_on_a_ringing_plant(seed: int) -> None:
    """Most of them lie on no basin boundary that a line of starts crosses, and first order predicts none."""
    rng = np.random.default_rng(seed)
    wanted: list[float] = []
    while len(wanted) < 5:
        numerator, denominator = ringing(rng)
        wanted = HalfPeriod(numerator, denominator).cycles()
    found = epp.find_limit_cycles(epp.LureSystem.from_tf((numerator, denominator), epp.RelayDeadZone(1.0)))
    for omega in wanted:
        assert min(abs(cycle.omega - omega) for cycle in found) < 1e-6 * omega
    assert "one pulse to each side" in found.search


@pytest.mark.parametrize("width", [0.01, 0.05])
@pytest.mark.parametrize("turned", [False, True], ids=["canonical", "turned"])
def test_a_relay_with_hysteresis_has_the_roots_of_tsypkins_function(width: float, turned: bool) -> None:
    """For G = sum r/(s - p) the input behind half a period h is sum of r/p tanh(p h/2), of a relay of one."""
    numerator, denominator = [1.0, 0.3], np.polymul([1.0, 0.06, 1.0], [1.0, 0.08, 9.0])
    loop = epp.LureSystem.from_tf((numerator, denominator), epp.HysteresisRelay(-width, width))
    if turned:
        Q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=loop.A.shape))
        loop = loop.in_coordinates(Q, Q.T)
    r, p, _ = residue(numerator, denominator)

    def off(h: float) -> float:
        return float(np.sum(r / p * np.tanh(p * h / 2.0)).real) - width

    grid = np.arange(0.05, 60.0, 0.01)
    values = np.array([off(h) for h in grid])
    at = np.flatnonzero((values[:-1] < 0) != (values[1:] < 0))
    roots = [brentq(off, grid[i], grid[i + 1], xtol=1e-13) for i in at]
    hybrid = steady_hybrid(loop)
    pulses = Pulses.of(hybrid)
    assert pulses is not None
    asked = np.array([guess.tau[0] for guess in pulses.guesses()])
    assert asked.size

    def stays(h: float) -> bool:
        """Whether the input stays within the threshold until half a period is over."""
        t = np.linspace(0.0, h, 4000)[1:-1, None]
        state = np.exp(p * t) * (-np.tanh(p * h / 2.0) / p) + np.expm1(p * t) / p
        return bool(np.max((state @ r).real * -1.0) <= width * (1.0 + 1e-9)) or bool(np.max(-(state @ r).real) < width)

    for h in asked:
        assert min(abs(h - root) for root in roots) < 1e-8 * h
    closed = [close_orbit(hybrid, guess) for guess in pulses.guesses()]
    assert all(orbit is not None for orbit in closed)
    assert len(asked) == sum(stays(h) for h in roots if pulses.reach[0] < h < pulses.reach[1])


def test_only_one_odd_relay_without_dead_time_is_asked() -> None:
    plant = ([1.0], [1.0, 3.0, 2.0, 0.0])
    assert Pulses.of(steady_hybrid(epp.LureSystem.from_tf(plant, epp.Relay()))) is not None
    for element, delay in (
        (epp.Relay(-1.0, 2.0), 0.0),
        (epp.Relay(), 0.2),
        (epp.Saturation(), 0.0),
        (epp.Play(1.0), 0.0),
    ):
        assert Pulses.of(steady_hybrid(epp.LureSystem.from_tf(plant, element, delay=delay))) is None


@pytest.mark.parametrize("seed", [None, *range(8)])
def test_symmetric_cycles_on_a_plant_with_a_double_pole_are_sought_in_all_coordinates(seed: int | None) -> None:
    """As it is given its matrix has one mode for two poles, and nothing was sought: both published periods are met."""
    case = epp.case("relay_deadzone")
    system = case.to_system() if seed is None else rotated(case.to_system(), seed)
    pulses = Pulses.of(steady_hybrid(system))
    assert pulses is not None
    found = sorted(guess.tau.sum() for guess in pulses.guesses())
    assert found == pytest.approx(sorted(c.period for c in case.expected.exact), rel=1e-6)
    assert pulses.reach == pytest.approx((0.05, 30.0), rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_chain_of_integrators_has_no_modes_in_any_coordinates(seed: int) -> None:
    """Turned, rounding makes two slow poles of a double integrator, and half periods of years were asked for."""
    loop = epp.LureSystem.from_tf(([1.0, 1.0], [1.0, 4.0, 0.0, 0.0]), epp.RelayDeadZone(0.2))
    assert Pulses.of(steady_hybrid(loop)) is None and Pulses.of(steady_hybrid(rotated(loop, seed))) is None


@pytest.mark.parametrize("turning", [0.0, 1e-7, 1.0, 40.0])
def test_what_a_mode_grows_by_is_exact_to_rounding_however_short_the_time(turning: float) -> None:
    poles = np.array([[-3.0 + 1j * turning], [0.0], [0.2 - 1j * turning]])
    times = np.geomspace(1e-12, 10.0, 200)
    exact = np.expm1(poles * times)
    assert np.all(np.abs(_grown(poles, times) - exact) <= 1e-15 * np.abs(exact) * (1.0 + np.abs(poles * times)))


def test_one_mode_of_a_pair_stands_for_both() -> None:
    """The states at the switches are those of the whole linear part, which its matrix exponential tells."""
    loop = epp.LureSystem.from_tf(([4.0], np.polymul([1.0, 0.3, 2.0], [0.5, 1.0, 0.0])), epp.RelayDeadZone(0.5))
    pulses = Pulses.of(steady_hybrid(loop))
    assert pulses is not None and len(pulses.poles) < len(loop.A)
    w, h = 1.3, 2.9
    begin, end = ((pulses.vectors @ x).real for x in pulses._states(np.array(w), np.array(h)))
    pushed = np.block([[loop.A, loop.B * pulses.level], [np.zeros((1, len(loop.A) + 1))]])
    assert expm(pushed * w) @ [*begin, 1.0] == pytest.approx([*end, 1.0], rel=1e-9, abs=1e-12)
    assert expm(loop.A * (h - w)) @ end == pytest.approx(-begin, rel=1e-9, abs=1e-12)
