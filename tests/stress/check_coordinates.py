"""Every shipped case with its state turned by twenty random orthogonal matrices, and in other units: the same answers.

Not collected by default: ``pytest tests/stress/check_coordinates.py``, about six minutes on one core.
"""

from __future__ import annotations

import pytest

import eppanalysis as epp
from tests.coordinates import UNITS, rescaled, rotated
from tests.methods.continuation.test_coordinates import BRANCHES, TURNED_ONLY, branch_alike, in_units, turned
from tests.test_coordinates import (
    LOOPS,
    TEXTBOOK,
    predict_alike,
    search_alike,
    simulate_alike,
)

CASES = epp.shipped_cases()
TURNS = range(20)
#: Unstable cycles without end: which of them bisection meets is left to rounding.
CHAOTIC = "two_mass_deadzone"
SEARCHED = [n for n in LOOPS if n != CHAOTIC and not epp.case(n).to_system().time_step]


@pytest.mark.parametrize("name", CASES)
def test_predictions_in_turned_coordinates(name: str) -> None:
    system = epp.case(name).to_system()
    wanted = epp.predict_limit_cycles(system)
    for seed in TURNS if name in LOOPS else TURNS[:2]:
        predict_alike(wanted, rotated(system, seed))


@pytest.mark.parametrize("name", LOOPS)
def test_predictions_in_other_units(name: str) -> None:
    system = epp.case(name).to_system()
    wanted = epp.predict_limit_cycles(system)
    for time, amplitude, states in UNITS:
        predict_alike(wanted, rescaled(system, time, amplitude, states), time, amplitude)


@pytest.mark.parametrize("name", TEXTBOOK)
def test_predictions_of_textbook_loops_in_turned_coordinates(name: str) -> None:
    wanted = epp.predict_limit_cycles(TEXTBOOK[name])
    for seed in TURNS:
        predict_alike(wanted, rotated(TEXTBOOK[name], seed))


@pytest.mark.parametrize("name", LOOPS)
def test_runs_in_turned_coordinates(name: str) -> None:
    case = epp.case(name)
    system = case.to_system()
    wanted = epp.simulate(system, case.input, case.t_end)
    for seed in TURNS:
        simulate_alike(case, wanted, rotated(system, seed))


@pytest.mark.parametrize("name", SEARCHED)
def test_searches_in_turned_coordinates(name: str) -> None:
    system = epp.case(name).to_system()
    wanted = epp.find_limit_cycles(system)
    for seed in TURNS:
        search_alike(wanted, rotated(system, seed))


@pytest.mark.parametrize("name", SEARCHED)
def test_searches_in_other_units(name: str) -> None:
    system = epp.case(name).to_system()
    wanted = epp.find_limit_cycles(system)
    for time, amplitude, states in UNITS:
        search_alike(wanted, rescaled(system, time, amplitude, states), time, amplitude)


@pytest.mark.parametrize("name", BRANCHES)
def test_branches_in_turned_coordinates(name: str) -> None:
    for seed in TURNS[:5]:
        branch_alike(name, turned(name, seed))


@pytest.mark.parametrize("name", [n for n in BRANCHES if n not in TURNED_ONLY])
def test_branches_in_other_units(name: str) -> None:
    for units in UNITS:
        branch_alike(name, in_units(name, *units), units[1])
