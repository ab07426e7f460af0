"""Floquet multipliers against published ones, finite differences of the engine's return map, and rank deficiency."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.orbits.guess import recurrences
from eppanalysis.methods.orbits.shooting import close_orbit, run_from
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.methods.simulation.stability import describe, drifts, is_stable, multipliers


def orbit_of(name):
    case = epp.case(name)
    hybrid = steady_hybrid(case.to_system(), case.operating_point)
    run = run_hybrid(hybrid, case.t_end, np.zeros(0), 2.0 * hybrid.time_scale, 50_000, 400)
    period = epp.simulate(case.to_system(), case.input, t_end=case.t_end).limit_cycle.period
    for guess in recurrences(hybrid, run, (0.99 * period, 1.01 * period), 3):
        orbit = close_orbit(hybrid, guess)
        if orbit is not None:
            return case, orbit
    raise AssertionError(name)


@pytest.mark.parametrize(
    "name",
    ["relay_ideal_khalil79", "relay_hyst_goncalves6", "sat_am165", "backlash_servo", "stiction_level_S5J2"],
)
def test_largest_multiplier_is_that_of_the_independent_code(name):
    case, orbit = orbit_of(name)
    assert abs(orbit.multipliers[0]) == pytest.approx(case.expected.exact[0].largest_multiplier, rel=1e-8)


def test_return_map_agrees_with_differences_of_the_engine():
    _, orbit = orbit_of("relay_deadzone")
    start, free = orbit.starts[0], orbit.arcs.free
    guard, found = int(orbit.arcs.event_sequence.guards[-1]), []
    for i in free:
        ends = []
        for sign in (1.0, -1.0):
            y = start.copy()
            y[i] += sign * 1e-6 * orbit.scale[i]
            run = run_from(orbit, 1.3 * orbit.period, 40, y)
            near = [r for r in run.order if run.guard[r] == guard and abs(run.time[r] / orbit.period - 1) < 0.1]
            ends.append(run.state[near[0]])
        found.append((ends[0] - ends[1]) / (2e-6 * orbit.scale[i]))
    measured = np.sort(np.abs(np.linalg.eigvals(np.array(found).T)))[::-1]
    assert measured[0] == pytest.approx(abs(orbit.multipliers[0]), rel=1e-6)


@pytest.mark.parametrize("links", [1, 2, 3])
@pytest.mark.parametrize("turns", [1, 6, 12])
def test_chains_of_integrators_have_multipliers_that_are_exactly_one(links, turns):
    """In any coordinates: QR iterations leave them off by roots of rounding."""
    rng = np.random.default_rng(links)
    chain = np.eye(links) + np.diag(np.ones(links - 1), -1)
    others = np.diag([0.9, 0.0])
    turned = np.linalg.qr(rng.standard_normal((links + 2, links + 2)))[0]
    P = turned @ np.linalg.matrix_power(
        np.block([[chain, np.zeros((links, 2))], [np.zeros((2, links)), others]]), turns
    )
    found = multipliers(P @ turned.T, np.ones(links + 2), links + 2)
    assert found[:links].tolist() == [1.0] * links and found[-1] == 0.0
    assert found[links] == pytest.approx(0.9**turns)
    assert drifts(P @ turned.T, np.ones(links + 2)) is (links > 1)


def test_sticking_wipes_out_directions():
    _, orbit = orbit_of("pid_hunting")
    assert orbit.multipliers[-1] == 0.0
    assert "1 of 2 vanish" in describe(orbit.multipliers)


def test_stribeck_friction_is_superstable():
    # Every cycle on the belt passes through the same point of breakaway.
    _, orbit = orbit_of("belt_leine")
    assert np.all(orbit.multipliers == 0.0)


def test_nilpotent_blocks_do_not_leak_rounding():
    # A Jordan block of three zeros: a QR iteration alone gives magnitudes near 1e-5.
    P = np.diag(np.ones(3), 1)
    P[3, 3] = 0.5
    rng = np.random.default_rng(1)
    Q, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    found = multipliers(Q @ P @ Q.T, np.ones(4), 4)
    assert found[0] == pytest.approx(0.5, rel=1e-12)
    assert np.all(found[1:] == 0.0)


def test_stability_needs_all_multipliers_inside():
    assert is_stable(np.array([0.5, -0.9 + 0.1j]))
    assert not is_stable(np.array([0.5, -1.1]))
    assert is_stable(np.zeros(0))


def test_orbit_is_the_same_from_any_of_its_events():
    _, orbit = orbit_of("fig8a_original")
    for first in (3, 11):
        turned = orbit.rotated(first)
        assert turned.residual < 1e-10
        assert abs(turned.multipliers[0]) == pytest.approx(abs(orbit.multipliers[0]), rel=1e-9)
    assert replace(orbit).period == orbit.period
