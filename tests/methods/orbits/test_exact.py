"""One exact orbit from its prediction, through harmonic balance where a run leaves the cycle at once."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.results import Status
from tests.freeplay import EDGE, freeplay
from tests.shared import cycles_of, predicted


@pytest.fixture(scope="module")
def unstable():
    """The original elbow, its input, and its unstable cycle as first order predicts it."""
    case = epp.case("fig8a_original")
    system, value = case.to_system(), case.operating_point
    return system, value, predicted(case.name)[0]


@pytest.mark.parametrize("name", ["fig8a_original", "relay_deadzone", "band_two_cycles", "quantised_sensor_ct"])
def test_every_prediction_leads_to_its_own_orbit(name):
    case = epp.case(name)
    system, value = case.to_system(), case.operating_point
    guesses = predicted(name)
    found = [epp.exact_orbit(system, guess, value) for guess in guesses]
    assert [c.stable for c in found] == [c.stable for c in guesses]
    assert [np.sum(np.abs(c.multipliers) > 1.0) for c in found] == [0 if c.stable else 1 for c in guesses]
    assert len({round(c.period, 9) for c in found}) == len(found)
    for expected in case.expected.exact or ():
        assert min(abs(c.period / expected.period - 1.0) for c in found) < 1e-9


def test_the_unstable_cycle_of_the_original_elbow_from_its_prediction(unstable):
    system, value, guess = unstable
    cycle = epp.exact_orbit(system, guess, value)
    assert cycle.status is Status.CONVERGED and cycle.residual < 1e-9
    # What the search finds by bisection between outcomes.
    assert cycle.period == pytest.approx(0.192932133055, rel=1e-9)


@pytest.mark.slow
def test_the_unstable_cycle_takes_no_balance(unstable):
    system, value, guess = unstable
    seconds = []
    for _ in range(5):
        begin = time.process_time()
        epp.exact_orbit(system, guess, value)
        seconds.append(time.process_time() - begin)
    # Some 12 ms on an idle machine; by way of harmonic balance it took 600.
    assert min(seconds[1:]) < 0.06


def test_a_cycle_of_another_period_is_not_the_predicted_one():
    # First order sees a slow unstable cycle where there is only the fast stable one.
    system = epp.case("backlash_servo").to_system()
    slow = predicted("backlash_servo")[0]
    assert not slow.stable and slow.period > 15.0
    assert epp.exact_orbit(system, slow).status is Status.NOT_CONVERGED


def test_a_prediction_without_an_orbit_says_so():
    case = epp.case("elbow_cycle_not_there")
    system, value = case.to_system(), case.operating_point
    guess = predicted(case.name)[1]
    cycle = epp.exact_orbit(system, guess, value)
    assert cycle.status is Status.NOT_CONVERGED and np.isnan(cycle.residual) and cycle.stable is None


def test_a_start_without_state_is_refused():
    system = epp.case("relay_ideal_khalil79").to_system()
    guess = epp.predict_limit_cycles(system)[0]
    with pytest.raises(EppError, match="has 0 states at its start; expected 3"):
        epp.exact_orbit(system, replace(guess, state=np.zeros(0)))


@pytest.mark.slow
def test_asymmetric_orbits_come_in_mirrored_pairs():
    found = cycles_of("two_mass_deadzone")
    for cycle in found:
        mean = cycle.mean["twist"]
        twins = [c for c in found if c.period == pytest.approx(cycle.period, rel=1e-8)]
        assert any(c.mean["twist"] == pytest.approx(-mean, abs=1e-9) for c in twins)
        assert all(c.stable == cycle.stable for c in twins)


def test_a_state_of_rest_on_several_guards_is_no_cycle():
    case = epp.case("two_mass_damped_shaft")
    assert [c.stable for c in epp.find_limit_cycles(case.to_system())] == [True]


# The orbit that is asked for ---------------------------------------------------------------------------------------
@pytest.fixture(scope="module", params=[12.0, 14.0, 20.0, 22.5])
def section(request):
    """A symmetric loop with asymmetric orbits beside its symmetric ones, and what first order predicts for it."""
    loop = freeplay(request.param)
    return loop, epp.predict_limit_cycles(loop)


def test_symmetric_predictions_lead_to_symmetric_orbits_of_their_own(section):
    loop, predicted = section
    cycles = [epp.exact_orbit(loop, guess) for guess in predicted]
    assert len({round(c.period, 9) for c in cycles}) == len(cycles) >= 2

    def rate(t, x):
        return loop.A @ x + loop.B[:, 0] * (x[2] - np.clip(x[2], -EDGE, EDGE))

    for guess, cycle in zip(predicted, cycles, strict=True):
        assert cycle.status is Status.CONVERGED and cycle.residual < 1e-12
        # Half a period later, by a method that knows nothing of events, the state is the image of the start.
        half = solve_ivp(
            rate, (0.0, 0.5 * cycle.period), cycle.state, method="DOP853", rtol=1e-11, atol=1e-13, max_step=1e-3
        )
        size = np.abs(half.y).max(axis=1)
        assert np.max(np.abs(half.y[:, -1] + cycle.state) / size) < 1e-7
        balance = epp.harmonic_balance(loop, guess)
        assert abs(balance.period / cycle.period - 1.0) < balance.error_estimate < 3e-4
        assert cycle.period == pytest.approx(balance.period, rel=3e-4)
        signal = loop.signals.names[0]
        assert cycle.amplitude(signal) == pytest.approx(balance.amplitude(signal), rel=3e-4)


def test_the_search_lists_symmetric_orbits_and_their_asymmetric_neighbours():
    # Of independent half-orbit shooting: frequency [Hz] and peak of the surface's angle [deg].
    known = {14.0: ((5.179408, 2.9922), (10.987684, 3.5943)), 20.0: ((5.677415, 3.1363), (11.432379, 3.8774))}
    for speed, expected in known.items():
        found = epp.find_limit_cycles(freeplay(speed))
        signal = next(iter(found[0].mean))
        symmetric = sorted((c for c in found if abs(c.mean[signal]) < 1e-9), key=lambda c: c.frequency)
        for cycle, (frequency, peak) in zip(symmetric, expected, strict=True):
            assert cycle.frequency == pytest.approx(frequency, abs=1e-6)
            assert np.rad2deg(cycle.peak_to_peak[signal] / 2.0) == pytest.approx(peak, abs=1e-4)
        pair = [c for c in found if c not in symmetric]
        assert len(pair) == 2 and pair[0].mean[signal] == pytest.approx(-pair[1].mean[signal], rel=1e-9)
        assert found.status is Status.CONVERGED and not found.unclosed


def fin(speed: float) -> epp.LureSystem:
    """Bending and torsion of a fin in an air stream, with freeplay of 0.01 either way at its root; made-up numbers."""
    inertia = np.linalg.inv([[1.0, 0.2], [0.2, 0.25]])
    air = np.array([[1.0, 1.3 * speed**2], [0.0, -0.25 * speed**2]])
    damping = 0.3 * np.array([[0.04 + 0.3 * speed, 0.0], [-0.05 * speed, 0.03 + 0.12 * speed]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-inertia @ air, -inertia @ damping]])
    B = np.concatenate([[0.0, 0.0], -inertia @ [0.0, 0.6]])
    section = epp.blocks.StateSpaceBlock(A=A.tolist(), B=B[:, None].tolist(), C=[[0, 1, 0, 0]])
    parts = {"section": section, "root": epp.DeadZone(-0.01, 0.01)}
    return epp.Diagram(parts, ["section -> root", "root -> section"], signals={"torsion": "section"}).to_system()


@pytest.mark.parametrize(("speed", "period"), [(0.85, 7.859866276), (0.9, 7.944344758)])  # of independent shooting
def test_a_pair_of_mirror_images_is_not_answered_by_the_symmetric_cycle_beside_it(speed, period):
    loop = fin(speed)
    guesses = epp.predict_limit_cycles(loop)
    pair = [guess for guess in guesses if abs(guess.mean["torsion"]) > 1e-3]
    assert len(pair) == 2 and len(guesses) == 3
    for guess in pair:
        cycle = epp.exact_orbit(loop, guess)
        assert cycle.period == pytest.approx(period, rel=1e-9)
        # Harmonic balance knows nothing of runs, events and neighbours.
        balance = epp.harmonic_balance(loop, guess, order=15)
        assert cycle.period == pytest.approx(balance.period, rel=1e-5)
        assert cycle.mean["torsion"] == pytest.approx(balance.mean["torsion"], rel=1e-2)
    found = epp.find_limit_cycles(loop)
    assert sorted(np.sign(np.round([c.mean["torsion"] for c in found], 9))) == [-1.0, 0.0, 1.0]
    assert found.status is Status.CONVERGED and not found.unclosed


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda c: {"period": 1.2 * c.period}, "Hz"),
        (lambda c: {"harmonics": {k: 1.5 * v for k, v in c.harmonics.items()}}, "of the size"),
        (lambda c: {"mean": {k: v + 0.3 * c.peak_to_peak[k] for k, v in c.mean.items()}}, "another mean"),
    ],
)
def test_an_orbit_that_is_not_the_one_asked_for_is_no_answer(change, reason):
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
    cycle = epp.find_limit_cycles(loop).stable[0]
    assert epp.exact_orbit(loop, cycle).period == pytest.approx(cycle.period, rel=1e-9)
    other = epp.exact_orbit(loop, replace(cycle, stable=None, **change(cycle)))
    assert other.status is Status.NOT_CONVERGED
    assert reason in other.note


def test_a_prediction_that_was_not_closed_is_named():
    # The slow cycle that first order sees is not there.
    system = epp.case("backlash_servo").to_system()
    found = cycles_of("backlash_servo")
    (missing,) = found.unclosed
    assert missing.frequency == pytest.approx(0.0506, abs=1e-4)
    assert np.isinf(missing.error_estimate)
    assert found.status is Status.CONVERGED and not found.left_open
    assert "may not exist" in found.message
    # Where the estimate says that it exists, it is missing.
    sure = epp.find_limit_cycles(system, predicted=[replace(missing, error_estimate=0.1)])
    assert sure.status is Status.UNDECIDED and len(sure.unclosed) == 1 and not sure.left_open
    for text in (found.message, found.to_dict()["message"]):
        assert "0.05063 Hz" in text and "unstable" in text


def test_an_orbit_that_was_not_closed_for_want_of_steps_says_so(monkeypatch: pytest.MonkeyPatch):
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    (predicted,) = epp.predict_limit_cycles(loop)
    assert epp.exact_orbit(loop, predicted).status.ok
    monkeypatch.setattr("eppanalysis.methods.orbits.exact.MOST_WORK", 1.0)
    cycle = epp.exact_orbit(loop, predicted)
    assert not cycle.status.ok and "steps allowed ended" in cycle.note
