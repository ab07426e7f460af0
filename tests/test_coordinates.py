"""What is found does not depend on the coordinates of a loop's state, nor on the units of its time and amplitudes.

Every shipped loop, and textbook loops beyond them, with the state turned by random orthogonal matrices and with time,
amplitudes and states in other units. Some turns and units each; `tests/stress` has them all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import eppanalysis as epp
from eppanalysis.methods.describing.multi import choose_pivot
from eppanalysis.methods.harmonic.loop import Loop
from tests.coordinates import UNITS, assert_same_cycles, in_coordinates, orthogonal, rescaled, rotated, words
from tests.shared import cycles_of, mostly_slow, of_kind

LOOPS = of_kind("loop")
#: A search of half a second each: of an integrator, a dead time, a relay, a contact.
QUICK = ["pid_hunting", "relay_fopdt_closed", "relay_hyst_goncalves6", "two_mass_damped_shaft_classical"]


def roots(*values: float) -> np.ndarray:
    return np.poly(values)


def textbook() -> dict[str, epp.LureSystem]:
    """Chains of integrators, multiple poles, cancellations, poles far apart, several elements, discrete time."""
    tf, ring = epp.LureSystem.from_tf, epp.LureSystem.from_blocks
    mode = [1.0, 0.1, 4.0]
    return {
        "play": tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(2.0)),
        "double integrator, saturation": tf((roots(-1, -1), roots(0, 0, 0)), epp.Saturation(-1, 1, 5.0)),
        "double integrator, relay": tf(([1.0, 1.0], roots(0, 0)), epp.HysteresisRelay(-0.2, 0.2)),
        "double integrator, quantiser": tf(([2.0, 1.0], roots(0, 0, -3)), epp.Quantiser(0.5, 5)),
        "triple integrator": tf((2 * roots(-1, -1.2), roots(0, 0, 0, -8)), epp.Saturation(-1, 1, 4.0)),
        "five equal poles": tf(([4.0], roots(*[-1] * 5)), epp.Relay()),
        "six equal poles": tf(([3.0], roots(*[-1] * 6)), epp.RelayDeadZone(0.1)),
        "cancelled pole": tf((6 * roots(-2), roots(-2, 0, -1, -2)), epp.Saturation(-1, 1, 2.0)),
        "cancelled resonance": tf(
            (10 * np.polymul(mode, [1.0, 0.5]), np.polymul(mode, roots(0, -1, -2, -3))), epp.DeadZone(-0.3, 0.3, 2.0)
        ),
        "cancelled integrator": tf((5 * roots(0, -0.2), roots(0, 0, -1, -1.5)), epp.HysteresisRelay(-0.1, 0.1)),
        "right half-plane zero": tf((-3 * roots(2), roots(-1, -1, -3)), epp.Relay()),
        "poles far apart": tf(([1e4], roots(0, -0.01, -1, -100)), epp.Play(0.1)),
        "differentiator": tf(([1.0, 0.0], [1.0, 0.2, 1.0]), epp.Saturation(-1, 1, 1.0), feedback=1),
        "discrete": _discrete(),
        "play in a ring": ring([epp.Saturation(-1, 1, 5.0), ([3.0], [1.0, 1.0, 0.0]), epp.Play(0.3)]),
        "relay and gap": ring([epp.Relay(), ([1.0], [1.0, 1.0]), epp.DeadZone(-0.2, 0.2), ([2.0], [1.0, 2.0, 0.0])]),
    }  # fmt: skip


def _discrete() -> epp.LureSystem:
    from eppanalysis.models.systems.linear import transfer_function

    return epp.LureSystem.from_tf(transfer_function([0.4, 0.2], [1.0, -1.6, 0.6], 0.1), epp.Play(0.3))


TEXTBOOK = textbook()


def schur(system: epp.LureSystem) -> epp.LureSystem:
    """The realisation that a Schur decomposition leaves."""
    return in_coordinates(system, scipy.linalg.schur(system.A)[1].T)


def balanced(system: epp.LureSystem) -> epp.LureSystem:
    """The balanced realisation of the plant with its poles moved to the left by one, as for unstable plants."""
    A = system.A - (1.0 + max(0.0, np.linalg.eigvals(system.A).real.max())) * np.eye(len(system.A))
    reach = scipy.linalg.solve_continuous_lyapunov(A, -system.B @ system.B.T)
    see = scipy.linalg.solve_continuous_lyapunov(A.T, -system.C.T @ system.C)
    U, s, _ = np.linalg.svd(scipy.linalg.sqrtm(reach).real @ see @ scipy.linalg.sqrtm(reach).real)
    return in_coordinates(system, np.linalg.inv(scipy.linalg.sqrtm(reach).real @ U / s**0.25))


def predict_alike(wanted: epp.Prediction, other: epp.LureSystem, time: float = 1.0, amplitude: float = 1.0) -> None:
    """A loop has the predictions of another one, said in the same words, with the same estimates of their errors."""
    found = epp.predict_limit_cycles(other)
    assert_same_cycles(found, wanted, other.signals.names[0], time, amplitude)
    assert words(found.search) == words(wanted.search)
    for mine, theirs in zip(found, wanted, strict=True):
        assert words(mine.stability_criterion) == words(theirs.stability_criterion)
        np.testing.assert_allclose(mine.error_estimate, theirs.error_estimate, rtol=1e-3)


def search_alike(wanted: epp.CycleSearch, other: epp.LureSystem, time: float = 1.0, amplitude: float = 1.0) -> None:
    """A loop has the exact cycles of another one, and its search ends with the same words."""
    found = epp.find_limit_cycles(other)
    assert_same_cycles(found, wanted, other.signals.names[0], time, amplitude)
    assert words(found.search) == words(wanted.search)
    assert (found.status, found.settles, found.diverges) == (wanted.status, wanted.settles, wanted.diverges)


def simulate_alike(case: epp.Case, wanted: epp.Trajectory, other: epp.LureSystem) -> None:
    """A run of a case and that of its loop in other coordinates have the same verdict on the same motion."""
    found = epp.simulate(other, case.input, case.t_end)
    assert found.status == wanted.status
    if wanted.limit_cycle is not None:
        for signal in wanted.signals:
            assert_same_cycles([found.limit_cycle], [wanted.limit_cycle], signal)


@pytest.mark.parametrize("name", mostly_slow(LOOPS, QUICK))
def test_predictions_do_not_depend_on_coordinates_and_units(name):
    system = epp.case(name).to_system()
    wanted = epp.predict_limit_cycles(system)
    predict_alike(wanted, rotated(system, 1))
    time, amplitude, states = UNITS[0]
    predict_alike(wanted, rescaled(rotated(system, 2), time, amplitude, states), time, amplitude)


@pytest.mark.parametrize("name", mostly_slow(TEXTBOOK, [name for name in TEXTBOOK if name != "play in a ring"]))
def test_predictions_of_textbook_loops_do_not_depend_on_the_realisation(name):
    system = TEXTBOOK[name]
    wanted = epp.predict_limit_cycles(system)
    predict_alike(wanted, rotated(system, 3))
    predict_alike(wanted, schur(system))
    if not system.time_step and len(system.elements) == 1:
        minimal = not name.startswith("cancelled")
        predict_alike(wanted, balanced(system) if minimal else rescaled(system, 1.0, 1.0, 5))


@pytest.mark.parametrize("name", mostly_slow(LOOPS, QUICK))
def test_runs_do_not_depend_on_coordinates(name):
    case = epp.case(name)
    system = case.to_system()
    wanted = epp.simulate(system, case.input, case.t_end)
    for seed in (0, 1, 2):
        simulate_alike(case, wanted, rotated(system, seed))


def test_the_cycle_of_a_run_has_the_least_period_in_all_coordinates():
    """In turned states the rounding of the elbow's run is a millionth of its gap: two turns to fourteen came out."""
    case = epp.case("fig8a_original")
    system = case.to_system()
    wanted = epp.simulate(system, case.input, case.t_end)
    for seed in range(10, 22):
        simulate_alike(case, wanted, rotated(system, seed))


@pytest.mark.parametrize("name", QUICK)
def test_searches_do_not_depend_on_coordinates_and_units(name):
    system = epp.case(name).to_system()
    search_alike(cycles_of(name), rotated(system, 4))
    time, amplitude, states = UNITS[1]
    search_alike(cycles_of(name), rescaled(system, time, amplitude, states), time, amplitude)


@pytest.mark.slow
def test_a_search_with_a_double_integrator_has_time_for_all_its_starts_in_turned_states():
    """Runs that drift through the band without gain took ten thousand times as many steps, and most were left."""
    search_alike(cycles_of("band_two_cycles"), rotated(epp.case("band_two_cycles").to_system(), 0))


def test_a_motion_that_grows_out_of_a_gap_for_long_is_followed_to_its_cycle():
    """In these coordinates a random start leaves the gap a thousand times slower than it moves on the cycle."""
    search_alike(cycles_of("backlash_servo_unseen"), rotated(epp.case("backlash_servo_unseen").to_system(), 19))


def test_a_cycle_that_meets_a_switch_by_rounding_is_listed_once():
    """In these coordinates its play comes to rest and turns in two events at one time, in one run but not in others."""
    system = epp.case("backlash_servo").to_system()
    search_alike(cycles_of("backlash_servo"), rotated(system, 10))


def test_a_search_starts_no_farther_out_in_turned_states():
    """The angle of a contact drives nothing: by rounding it did, and a start a million gaps away seemed to settle."""
    search_alike(cycles_of("two_mass_damped_shaft"), rotated(epp.case("two_mass_damped_shaft").to_system(), 13))


def test_the_input_of_an_element_has_a_unit_in_all_states_where_it_is_a_difference_of_two_signals():
    system = epp.case("rate_limited_aircraft").to_system()
    for loop in (system, rotated(system, 0)):
        assert "amplitudes of actuator from 0.00025 to 0.75 deg" in epp.predict_limit_cycles(loop).search


def test_a_solution_whose_phase_is_whole_turns_off_is_the_same():
    """In turned states it was counted as a further branch."""
    system = epp.case("azimuth_servo").to_system()
    wanted = epp.predict_limit_cycles(system)
    assert "(1 branch)" in wanted.search
    predict_alike(wanted, rotated(system, 0))


def test_an_integrator_that_cancels_leaves_no_branches_of_the_bias():
    """Of its share in the static balance rounding was left, and gave the bias three branches where it has one."""
    wanted = epp.predict_limit_cycles(TEXTBOOK["cancelled integrator"])
    for seed in range(4):
        found = epp.predict_limit_cycles(rotated(TEXTBOOK["cancelled integrator"], seed))
        assert "(1 branch of the bias)" in found.search and len(found) == len(wanted)


def test_a_gap_that_is_left_alone_has_no_cycles_of_rounding():
    """Play of 2 on 5/(s^2 + s), turned: both of its cycles, and frequencies from the pole, not from rounding, on."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(2.0))
    for seed in range(8):
        prediction = epp.predict_limit_cycles(in_coordinates(loop, orthogonal(2, seed)))
        assert [round(c.omega, 6) for c in prediction] == [0.318142, 1.591383]
        assert "frequencies from 0.000159 to 159 Hz" in prediction.search


@pytest.mark.parametrize(("plant", "element", "amplitude"), [
    pytest.param(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0), 1e-6, marks=pytest.mark.slow),
    (([1.0], [1.0, 1.0]), epp.HysteresisRelay(-0.1, 0.1), 1e6),
])  # fmt: skip
def test_searches_with_dead_time_do_not_depend_on_the_unit(plant, element, amplitude):
    """Unstable cycles too, and what is said of a prediction without one."""
    system = epp.LureSystem.from_tf(plant, element, delay=0.2)
    search_alike(epp.find_limit_cycles(system), rescaled(system, 1.0, amplitude), 1.0, amplitude)


def test_an_orbit_answers_the_prediction_that_is_as_stable():
    """A pulse of the relay is just the width of its dead zone: that a run creeps from edge to edge is no orbit."""
    system = epp.LureSystem.from_tf(([2.0], [1.0, 1.0, 0.0]), epp.RelayDeadZone(0.3), delay=0.3)
    found = epp.find_limit_cycles(system)
    assert [c.stable for c in found] == [True] and [c.stable for c in found.unclosed] == [False]


@pytest.mark.parametrize("name", ["elbow", "fig8a_original"])
def test_an_exact_orbit_does_not_depend_on_coordinates(name):
    """Stiff contacts of the elbow, whose matrices are ten thousand times as large where states mix."""
    case = epp.case(name)
    system, start = case.to_system(), epp.simulate(case).limit_cycle
    Q = orthogonal(len(system.A), 0)
    turned = replace(start, state=Q @ start.state, event_states=start.event_states @ Q.T)
    wanted, found = epp.exact_orbit(system, start), epp.exact_orbit(in_coordinates(system, Q), turned)
    assert wanted.status.ok and found.status.ok
    for signal in wanted.peak_to_peak:
        assert_same_cycles([found], [wanted], signal)
    np.testing.assert_allclose(found.multipliers, wanted.multipliers, atol=1e-7)
    np.testing.assert_allclose(Q.T @ found.state, wanted.state, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("name", of_kind("elbow"))
def test_what_acts_on_what_in_an_elbow_does_not_depend_on_coordinates(name):
    """A search begins at the same element, and a contact's second input is the rate of its first, not another state."""
    system = epp.case(name).to_system()
    free = Loop.of(system, system.v0).rows
    for seed in range(5):
        turned = rotated(system, seed).with_integrators_apart[0]
        assert choose_pivot(turned) == choose_pivot(system)
        np.testing.assert_array_equal(Loop.of(turned, turned.v0).rows, free)
