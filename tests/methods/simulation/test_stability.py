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
