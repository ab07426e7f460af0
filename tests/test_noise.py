"""The same lists, statuses, sentences and numbers on every processor: what the last bit of a library's sum decides.

A case's answers are held against those with noise of one unit in the last place (`tests/noise.py`), on the numbers of
its matrices and on what numpy and scipy return. In the quick tier a few cases, in the slow one all. There are twenty
draws: each case is held against a few, other ones from case to case, so that all are drawn. Searches of many seconds
are left out.
"""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from tests.noise import noise, shaken, unlike

QUICK = {
    "margins": ["level_valve", "sat_khalil710", "steering_compensated", "fig8a_original"],
    "predict": ["pid_hunting", "relay_deadzone", "belt_leine"],
    "simulate": ["relay_ideal_khalil79", "relay_fopdt_closed", "fig8a_original", "steering_compensated"],
    "cycles": ["relay_hyst_servo", "sat_khalil710", "clegg_loop"],
}

#: How many draws there are, and against how many of them each case is held.
DRAWS = 20
OF_A_CASE = {"margins": 5, "simulate": 5, "predict": 1, "cycles": 1, "branch": 1}
#: Branches; those of other cases bend into borders where the last digits are lost.
BRANCHES = """
    actuator_both_limits backlash_servo backlash_servo_unseen clegg_loop fig6a_original_pulley fig6b_ball_bearing
    fig8a_original fig8b_reduced_backlash freeplay_section sat_plus_backlash steering_compensated
    two_mass_damped_shaft"""
#: Searches of many seconds, and those of the loops of one study but one.
LONG = """
    azimuth_servo backlash_discrete_pi_kp02_ki02 backlash_discrete_pi_kp05_ki01 backlash_discrete_pi_kp05_ki02
    buck_converter level_valve robot_servo two_mass_deadzone upright virtual_spring x15_flare"""
#: What is another answer on another processor today, and what will make it one.
OPEN = {
    ("simulate", "azimuth_servo"): "whether a sample that falls on the end of a run counts as an event is rounding",
    ("simulate", "virtual_spring"): "whether a sample that falls on the end of a run counts as an event is rounding",
}


def every() -> list:
    """All analyses of all cases, each with its draws."""
    found = []
    for analysis, most in OF_A_CASE.items():
        names = BRANCHES.split() if analysis == "branch" else epp.shipped_cases()
        for i, name in enumerate(n for n in names if analysis != "cycles" or n not in LONG.split()):
            why = OPEN.get((analysis, name))
            marks = [pytest.mark.slow, *([pytest.mark.xfail(strict=True, reason=why)] if why else [])]
            first = 0 if why else i * most  # what is open has been seen with the first draws
            found.append(pytest.param(analysis, name, [k % DRAWS for k in range(first, first + most)], marks=marks))
    return found


@pytest.mark.parametrize(("analysis", "name", "draws"), every())
def test_no_answer_hangs_on_a_last_bit(analysis: str, name: str, draws: list[int]) -> None:
    assert unlike(name, analysis, draws) == []


@pytest.mark.parametrize("analysis", QUICK)
def test_answers_do_not_hang_on_a_last_bit(analysis: str) -> None:
    for name in QUICK[analysis]:
        assert unlike(name, analysis, range(2)) == [], name


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
