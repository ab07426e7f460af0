"""One exact orbit from its prediction, through harmonic balance where a run leaves the cycle at once."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.edge import orbits_on_edge
from eppanalysis.methods.exact import start_of, steady_hybrid
from eppanalysis.results import Status


@pytest.fixture(scope="module")
def unstable():
    """The original elbow, its input, and its unstable cycle as first order predicts it."""
    case = epp.case("fig8a_original")
    system, value = case.to_system(), case.final_input()
    return system, value, epp.predict_limit_cycles(system, value)[0]


@pytest.mark.parametrize("name", ["fig8a_original", "relay_deadzone", "band_two_cycles", "quantised_sensor_ct"])
def test_every_prediction_leads_to_its_own_orbit(name):
    case = epp.case(name)
    system, value = case.to_system(), case.final_input()
    guesses = epp.predict_limit_cycles(system, value)
    found = [epp.exact_orbit(system, guess, value) for guess in guesses]
    assert [c.stable for c in found] == [c.stable for c in guesses]
    assert len({round(c.period, 9) for c in found}) == len(found)
    for expected in case.expected.exact or ():
        assert min(abs(c.period / expected.period - 1.0) for c in found) < 1e-9


def test_the_unstable_cycle_of_the_original_elbow_from_its_prediction(unstable):
    system, value, guess = unstable
    cycle = epp.exact_orbit(system, guess, value)
    assert cycle.status is Status.CONVERGED and cycle.residual < 1e-9
    # What the search finds by bisection between outcomes.
    assert cycle.period == pytest.approx(0.192932133055, rel=1e-9)


def test_the_unstable_cycle_takes_no_balance(unstable):
    system, value, guess = unstable
    seconds = []
    for _ in range(5):
        begin = time.process_time()
        epp.exact_orbit(system, guess, value)
        seconds.append(time.process_time() - begin)
    # Some 12 ms on an idle machine; by way of harmonic balance it took 600.
    assert min(seconds[1:]) < 0.06


def test_the_edge_between_growth_and_decay_leads_to_the_unstable_cycle_alone():
    case = epp.case("relay_deadzone")
    system = case.to_system()
    hybrid = steady_hybrid(system)
    guess = epp.predict_limit_cycles(system)[0]
    x, held = start_of(hybrid, guess)
    orbit = next(orbits_on_edge(hybrid, x, np.zeros_like(x), held, guess.period))
    # What the search finds by bisection between outcomes of long runs.
    assert orbit.period == pytest.approx(8.25509713011712, rel=1e-12)
    assert np.sum(np.abs(orbit.multipliers) > 1.0) == 1
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    assert not list(orbits_on_edge(steady_hybrid(loop), np.array([1.0, 0.0, 0.0]), np.zeros(3), np.ones(1), 4.4))


def test_a_cycle_of_another_period_is_not_the_predicted_one():
    # First order sees a slow unstable cycle where there is only the fast stable one.
    system = epp.case("backlash_servo").to_system()
    slow = epp.predict_limit_cycles(system)[0]
    assert not slow.stable and slow.period > 15.0
    assert epp.exact_orbit(system, slow).status is Status.NOT_CONVERGED


def test_a_prediction_without_an_orbit_says_so():
    case = epp.case("elbow_cycle_not_there")
    system, value = case.to_system(), case.final_input()
    guess = epp.predict_limit_cycles(system, value)[1]
    cycle = epp.exact_orbit(system, guess, value)
    assert cycle.status is Status.NOT_CONVERGED and np.isnan(cycle.residual) and cycle.stable is None


def test_a_start_without_state_and_a_sampled_loop_are_refused():
    system = epp.case("relay_ideal_khalil79").to_system()
    guess = epp.predict_limit_cycles(system)[0]
    with pytest.raises(EppError, match="no state"):
        epp.exact_orbit(system, replace(guess, state=np.zeros(0)))
    with pytest.raises(EppError, match="discrete-time"):
        epp.exact_orbit(epp.case("backlash_discrete_pi").to_system(), guess)


def test_asymmetric_orbits_come_in_mirrored_pairs():
    found = epp.find_limit_cycles(epp.case("two_mass_deadzone").to_system())
    for cycle in found:
        mean = cycle.mean["twist"]
        twins = [c for c in found if c.period == pytest.approx(cycle.period, rel=1e-8)]
        assert any(c.mean["twist"] == pytest.approx(-mean, abs=1e-9) for c in twins)
        assert all(c.stable == cycle.stable for c in twins)


def test_a_state_of_rest_on_several_guards_is_no_cycle():
    case = epp.case("two_mass_damped_shaft")
    assert [c.stable for c in epp.find_limit_cycles(case.to_system())] == [True]
