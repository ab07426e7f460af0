"""The same lists, statuses, sentences and numbers on every processor: what the last bit of a library's sum decides.

A case's answers are held against those with noise of one unit in the last place (`tests/noise.py`), on the numbers of
its matrices and on what numpy and scipy return. In the quick tier a few cases, in the slow one all: twenty draws where
an answer takes a tenth of a second or so, two where it takes longer, none of searches that take seconds.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.noise import noise, shaken, unlike
from tests.shared import shipped

QUICK = {
    "margins": ["level_valve", "sat_khalil710", "steering_compensated", "fig8a_original"],
    "predict": ["pid_hunting", "relay_deadzone", "belt_leine"],
    "simulate": ["relay_ideal_khalil79", "relay_fopdt_closed", "fig8a_original", "steering_compensated"],
    "cycles": ["relay_hyst_servo", "sat_khalil710", "clegg_loop", "pid_hunting"],
}

#: What takes a tenth of a second or less, and what takes too long.
CHEAP = {
    "predict": """
        backlash_discrete_pi backlash_discrete_pi_kp02_ki02 backlash_discrete_pi_kp05_ki01
        backlash_discrete_pi_kp05_ki02 backlash_servo backlash_servo_unseen band_two_cycles belt_leine clegg_loop
        freeplay_section pid_hunting quantised_sensor_ct quantised_sensor_ct_large relay_biased_fopdt relay_deadzone
        relay_fopdt_closed relay_hyst_goncalves6 relay_hyst_servo relay_ideal_khalil79 sat_am165 sat_asymmetric
        sat_khalil710 sat_pycontrol_doc stiction_deadband_none stiction_level_S5J2 thruster_dz_hyst
        two_mass_damped_shaft_classical x15_flare""",
    "cycles": """
        clegg_loop fig6b_ball_bearing fig6b_three_steps fig8b_reduced_backlash fig8b_three_steps pid_hunting
        relay_biased_fopdt relay_deadzone relay_fopdt_closed relay_hyst_goncalves6 relay_hyst_servo
        relay_ideal_khalil79 sat_am165 sat_asymmetric sat_khalil710 sat_pycontrol_doc soft_cable
        stiction_level_S5J2 thruster_dz_hyst""",
}
#: Branches that take no longer; those of other cases bend into borders where the last digits are lost.
BRANCHES = """
    actuator_both_limits backlash_servo backlash_servo_unseen clegg_loop fig6a_original_pulley fig6b_ball_bearing
    fig8a_original fig8b_reduced_backlash freeplay_section sat_plus_backlash steering_compensated
    two_mass_damped_shaft"""
LONG = "azimuth_servo backlash_discrete_pi_kp05_ki01 level_valve robot_servo virtual_spring x15_flare"
#: What is another answer on another processor today, and what will make it one.
OPEN = {
    ("simulate", "azimuth_servo"): "whether a sample that falls on the end of a run counts as an event is rounding",
    ("simulate", "virtual_spring"): "whether a sample that falls on the end of a run counts as an event is rounding",
    ("simulate", "buck_converter"): "an irregular motion is told by one of its turns: no orbit is closed to confirm it",
    ("cycles", "buck_converter"): "which members of a continuum are listed is what runs happen to come to",
    ("cycles", "stiction_deadband_none"): "how many runs a search makes depends on where its bisections end",
    ("cycles", "two_mass_deadzone"): "which cycles on basin boundaries are met depends on where bisections end",
}


def every() -> list:
    """All analyses of all cases, with their number of draws."""
    found = []
    for analysis, name in itertools.product(("margins", "predict", "simulate", "cycles"), shipped()):
        dear = analysis in CHEAP and name not in CHEAP[analysis].split()
        why = OPEN.get((analysis, name))
        marks = [pytest.mark.slow, *([pytest.mark.xfail(strict=True, reason=why)] if why else [])]
        if analysis != "cycles" or name not in LONG.split():
            found.append(pytest.param(analysis, name, 1 if why and dear else 2 if dear else 20, marks=marks))
    return found + [pytest.param("branch", name, 2, marks=pytest.mark.slow) for name in BRANCHES.split()]


@pytest.mark.parametrize(("analysis", "name", "draws"), every())
def test_no_answer_hangs_on_a_last_bit(analysis: str, name: str, draws: int) -> None:
    assert unlike(name, analysis, range(draws)) == []


@pytest.mark.parametrize(("analysis", "name"), [(a, name) for a, names in QUICK.items() for name in names])
def test_answers_do_not_hang_on_a_last_bit(analysis: str, name: str) -> None:
    assert unlike(name, analysis, range(3)) == []


def test_noise_is_one_unit_in_the_last_place_of_some_numbers_and_keeps_what_is_equal() -> None:
    x = np.random.default_rng(1).normal(size=10_000)
    moved = shaken(x, 3)
    steps = np.round((np.abs(moved) - np.abs(x)) / np.spacing(np.abs(x)))
    assert {np.count_nonzero(steps == k) > 3000 for k in (-1, 0, 1)} == {True} and np.abs(steps).max() == 1
    assert np.array_equal(shaken(-x, 3), -moved) and not np.array_equal(shaken(x, 4), moved)
    assert np.array_equal(shaken(np.array([0.0, np.inf]), 3), [0.0, np.inf])
    A = np.array([[0.0, 1.0], [-2.0, -0.3]])
    exact = np.linalg.eigvals(A)
    with noise(5):
        there = np.linalg.eigvals(A)
    assert there[0] == there[1].conj() and 0.0 < np.abs(there - exact).max() < 1e-15
    assert np.array_equal(np.linalg.eigvals(A), exact)
