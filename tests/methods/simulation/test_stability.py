"""Floquet multipliers against published ones, finite differences of runs, and rank deficiency."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import cycles_of
from tests.stress.families import with_states


@pytest.mark.parametrize(
    "name",
    ["relay_ideal_khalil79", "relay_hyst_goncalves6", "sat_am165", "backlash_servo", "stiction_level_S5J2"],
)
def test_largest_multiplier_is_that_of_the_independent_code(name):
    exact = epp.case(name).expected.exact[0]
    cycle = min(cycles_of(name), key=lambda c: abs(c.period - exact.period))
    assert abs(cycle.multipliers[0]) == pytest.approx(exact.largest_multiplier, rel=1e-8)


def test_multipliers_are_those_of_differences_of_runs_over_a_period():
    """The derivative of the state a period later by the start: 1 along the motion, and the multipliers."""
    case = epp.case("relay_deadzone")
    cycle = cycles_of(case.name)[-1]
    # From the middle of an arc: at its switches the motion bends.
    time = 0.5 * (cycle.events[0].time + cycle.events[1].time)
    system = with_states(replace(case.to_system(), x0=cycle.state, memory=cycle.memory))
    middle = epp.simulate(system, t_end=time, t_eval=[0.0, time])
    names = system.signals.names
    start = np.array([middle.signals[n][-1] for n in names])

    def later(x):
        run = epp.simulate(replace(system, x0=x), t_end=cycle.period, t_eval=[0.0, cycle.period])
        return np.array([run.signals[n][-1] for n in names])

    h = 1e-6 * np.abs(start).max()
    P = np.column_stack([(later(start + h * e) - later(start - h * e)) / (2.0 * h) for e in np.eye(start.size)])
    found = np.sort(np.abs(np.linalg.eigvals(P)))[::-1]
    wanted = np.sort([1.0, *np.abs(cycle.multipliers)])[::-1][: found.size]
    np.testing.assert_allclose(found[:2], wanted[:2], rtol=1e-5)


def test_sticking_wipes_out_directions():
    cycle = cycles_of("pid_hunting").stable[0]
    assert cycle.multipliers[-1] == 0.0


def test_stribeck_friction_is_superstable():
    # Every cycle on the belt passes through the same point of breakaway.
    (cycle,) = cycles_of("belt_leine")
    assert np.all(cycle.multipliers == 0.0) and cycle.stable


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_mode_without_damping_makes_a_cycle_neither_stable_nor_unstable(turn):
    """A relay's cycle drives an undamped mode that it does not see: by the rounding of two multipliers of size one it
    was stable or not.
    """
    relay = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    A, B, C = np.zeros((5, 5)), np.zeros((5, 1)), np.zeros((1, 5))
    A[:3, :3], B[:3], C[:, :3] = relay.A, relay.B, relay.C
    A[3:, 3:], B[4] = [[0.0, 1.0], [-1.69, 0.0]], 0.2
    T = np.eye(5)
    T[np.ix_([0, 3], [0, 3])] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    loop = epp.LureSystem.build(T @ A @ T.T, T @ B, C @ T.T, [epp.Relay()], x0=np.ones(5))
    cycle = epp.exact_orbit(loop, epp.predict_limit_cycles(loop)[0])
    # The mode's own multipliers are those of its free swing over the period.
    assert np.abs(cycle.multipliers[:2]) == pytest.approx([1.0, 1.0], rel=1e-9)
    assert cycle.stable is None
    assert "on the unit circle to rounding" in cycle.stability_criterion


@pytest.mark.slow
def test_cycles_of_two_undamped_oscillators_are_neutral():
    A = np.zeros((4, 4))
    A[[0, 1, 2, 3], [1, 0, 3, 2]] = 1.0, -1.0, 1.0, -2.0
    loop = epp.LureSystem.build(
        A, [[0.0], [-1.0], [0.0], [1.0]], [[1.0, 0.0, -1.0, 0.0]], [epp.DeadZone()], x0=[0.7, 0.0, 0.7, 0.0]
    )
    found = epp.find_limit_cycles(loop)
    assert [c.stable for c in found] == [None] * len(found) and len(found)
    assert str(found).startswith("Neutral limit cycles exist")
