"""Exact orbits in discrete time against closed forms, plain iterations, and differences of restarted runs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.search import sampled
from eppanalysis.results import Status
from tests.shared import mostly_slow
from tests.stress.families import problem


@cache
def search(name: str):
    """The shipped loop and its orbits."""
    system = epp.case(name).to_system()
    return system, epp.find_limit_cycles(system)


KP_KI = ("backlash_discrete_pi", "backlash_discrete_pi_kp02_ki02", "backlash_discrete_pi_kp05_ki02")


def states_after(system, start, n):
    """State of the loop with what its play has held until there, n samples later, by a plain loop."""
    A, B, C, gap = system.A, system.B[:, 0], system.C[0], system.elements[0].gap
    x, m = start[:-1], start[-1]
    for _ in range(n):
        z = C @ x
        m = min(max(m, z - gap / 2), z + gap / 2)
        x = A @ x + B * m
    return np.append(x, m)


@pytest.mark.parametrize("name", mostly_slow(KP_KI, KP_KI[2:]))
def test_orbits_of_the_sampled_servo_close_and_their_multipliers_are_those_of_small_disturbances(name):
    system, found = search(name)
    assert found.status is Status.CONVERGED
    assert found.stable and found.unstable
    for c in found:
        n = round(c.period)
        # A play that is pushed stands where two of its pieces meet; what it has held until there does not.
        start = states_after(system, np.append(c.state, c.memory[0]), n)
        np.testing.assert_allclose(start[:2], c.state, atol=1e-12)
        end = states_after(system, start, n)
        np.testing.assert_allclose(end, start, atol=1e-12)
        step = 1e-7
        moved = [states_after(system, start + step * e, n) - end for e in np.eye(3)]
        values = np.linalg.eigvals(np.array(moved).T / step)
        wanted = np.sort(np.abs(values))[::-1]
        # The play holds nothing that the states do not renew.
        np.testing.assert_allclose(np.abs(c.multipliers), wanted[:2], atol=1e-5)
        assert wanted[2] < 1e-5
        assert c.stable == (wanted[0] < 1)


@pytest.mark.parametrize("name", mostly_slow(KP_KI, KP_KI[2:]))
def test_mirrored_orbits_are_both_listed(name):
    """The loop is odd: the mirror image of an orbit is one too, the same one half a period on or another."""
    found = search(name)[1]
    for c in found:
        image = -c.waveform["m"]
        assert any(
            len(d.waveform["m"]) == len(image)
            and min(np.abs(np.roll(d.waveform["m"], k) - image).max() for k in range(len(image))) < 1e-9
            for d in found
        )


def test_unstable_orbit_of_period_two_in_closed_form():
    """x -> -x/2 - dz(x), dz a dead zone of 1: x = 2 and -2 in turn, with slope -3/2 on either; inside it rests."""
    loop = epp.LureSystem.build([[-0.5]], [[-1.0]], [[1.0]], [epp.DeadZone(-1.0, 1.0)], x0=[1.5], time_step=0.1)
    found = epp.find_limit_cycles(loop)
    (cycle,) = (c for c in found if c.period == pytest.approx(0.2))
    assert not cycle.stable and abs(cycle.state[0]) == pytest.approx(2.0, rel=1e-13)
    assert cycle.multipliers[0] == pytest.approx(2.25, rel=1e-11)
    assert found.settles


def test_relay_with_period_two_wipes_no_disturbance_out():
    """x -> x/2 - sgn(x)/2 alternates between 1/3 and -1/3, with slope 1/2 on both samples."""
    loop = epp.LureSystem.build([[0.5]], [[-0.5]], [[1.0]], [epp.Relay()], x0=[0.9], time_step=1.0)
    (cycle,) = epp.find_limit_cycles(loop)
    assert abs(cycle.state[0]) == pytest.approx(1 / 3, rel=1e-13)
    assert cycle.multipliers[0] == pytest.approx(0.25, rel=1e-11)


@pytest.mark.slow
def test_dead_time_of_whole_samples_is_part_of_the_state():
    """Two samples of dead time written as a chain of two states more: the same orbits and multipliers."""
    law, step = epp.Relay(), {"time_step": 1.0}
    late = epp.LureSystem.build([[0.6]], [[-2.0]], [[1.0]], [law], x0=[1.5], delays=[2.0], **step)
    A = [[0.6, -2.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]
    chain = epp.LureSystem.build(A, [[0.0], [0.0], [1.0]], [[1.0, 0.0, 0.0]], [law], x0=[1.5, 0, 0], **step)
    found = [epp.find_limit_cycles(loop) for loop in (late, chain)]
    assert len(found[0])
    for c in found[0]:
        twins = [d for d in found[1] if d.period == c.period]
        assert any(np.allclose(np.abs(c.multipliers[:3]), np.abs(d.multipliers), atol=1e-12) for d in twins)
        assert any(c.peak_to_peak["relay_input"] == pytest.approx(d.peak_to_peak["relay_input"]) for d in twins)


def test_prediction_leads_to_the_orbit_next_to_it_and_a_run_to_its_own():
    system = epp.case("backlash_discrete_pi").to_system()
    orbit = epp.exact_orbit(system, epp.predict_limit_cycles(system)[0])
    assert orbit.status is Status.CONVERGED and orbit.period == 25.0 and orbit.stable
    run = epp.simulate(system, t_end=2000.0).limit_cycle
    again = epp.exact_orbit(system, run)
    assert again.period == 25.0
    assert again.peak_to_peak["m"] == pytest.approx(run.peak_to_peak["m"], rel=1e-9)


@pytest.mark.slow
def test_curve_of_motions_without_a_period_is_said_to_be_undecided():
    """Two samples of dead time and a saturation: the period is no whole number of samples."""
    law = epp.Saturation(-1.0, 1.0, 1.0)
    loop = epp.LureSystem.build([[0.6]], [[-1.1]], [[1.0]], [law], x0=[0.7], delays=[2.0], time_step=1.0)
    found = epp.find_limit_cycles(loop)
    assert found.status is Status.UNDECIDED and "may fill a curve" in found.search


def test_a_start_without_state_is_refused():
    system = epp.case("backlash_discrete_pi").to_system()
    guess = epp.predict_limit_cycles(system)[0]
    with pytest.raises(EppError, match="0 states at its start; expected 2"):
        epp.exact_orbit(system, replace(guess, state=np.zeros(0)))


@pytest.mark.slow
def test_a_search_ends_with_its_work_and_says_what_it_left(monkeypatch):
    """A share of the work lists a share of the orbits, the same ones each time, and none is claimed to be all."""
    system, whole = search("backlash_discrete_pi_kp02_ki02")
    assert whole.status is Status.CONVERGED
    monkeypatch.setattr(sampled, "_MOST_WORK", 0.7 * whole.provenance.statistics["work"])
    cut, again = epp.find_limit_cycles(system), epp.find_limit_cycles(system)
    assert cut.status is Status.UNDECIDED
    assert "the search ended when it had taken" in str(cut)
    assert [c.period for c in cut] == [c.period for c in again]
    assert {c.period for c in cut} <= {c.period for c in whole}
    assert cut.provenance.statistics["work"] < 1.1 * sampled._MOST_WORK


@pytest.mark.slow
def test_runs_are_as_long_as_a_slow_loop_takes_to_rest():
    """Nothing is predicted; the affine map of the saturation's one piece decays by 0.99 a sample to its fixed point."""
    system = problem("saturation, sampled", 326).system
    found = epp.find_limit_cycles(system)
    assert found.status is Status.CONVERGED and found.settles and not len(found)
    element, x = system.elements[0], found.rest_state
    z = float(system.C[0] @ x) + system.constant_input[0]
    w = float(np.clip(element.slope * z, element.lower, element.upper))
    np.testing.assert_allclose(system.A @ x + system.B[:, 0] * w + system.constant_state, x, rtol=0, atol=1e-8)
