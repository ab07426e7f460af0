"""Rates of parameters: 1/s, rad/s and Hz stay apart in sentences, tables and pictures of what runs over them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import eppanalysis as epp
from eppanalysis.shown import for_people

TABLES = {
    "kind": "diagram",
    "title": "Relay behind a filter",
    "connect": ["-plant -> relay", "relay -> filter", "filter -> plant"],
    "run": {"t_end": "50 s"},
    "parameters": {
        "decay": "30 1/s",
        "corner": "30 rad/s",
        "count": "30 Hz",
        "turning": "30 deg/s",
        "twice": "2*decay",
    },
    "blocks": {
        "filter": {"kind": "low_pass", "bandwidth": "corner"},
        "plant": {"kind": "zero_pole_gain", "poles": [-1, "-decay"], "gain": "decay", "start": [1, 0]},
    },
    "elements": {"relay": {"element": "hysteresis_relay", "lower": -0.1, "upper": 0.1}},
}
WRITTEN = {"decay": "1/s", "corner": "rad/s", "count": "Hz", "turning": "deg/s", "twice": "1/s"}


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return epp.Case.from_tables(TABLES, name="filtered")


@pytest.fixture(scope="module")
def branch(case: epp.Case) -> epp.Branch:
    return epp.continue_branch(case, "corner", "30 rad/s", "33 rad/s", max_step=0.5, n_others=0)


@pytest.mark.parametrize(("name", "unit"), WRITTEN.items())
def test_a_rate_is_shown_in_the_unit_that_it_is_written_in(case: epp.Case, name: str, unit: str) -> None:
    number = "60" if name == "twice" else "30"
    assert str(case.parameters[name]) == case.text(name, case.value(name)) == f"{number} {unit}"
    assert case.readable(name) == (unit, pytest.approx(180.0 / math.pi if unit == "deg/s" else 1.0))
    again = epp.Case.from_tables(TABLES | {"parameters": {**TABLES["parameters"], name: case.text(name, 1.0)}})
    assert again.readable(name) == case.readable(name)


def test_hertz_are_no_angular_velocity_and_one_over_a_time_may_be_one(case: epp.Case) -> None:
    with pytest.raises(epp.EppError, match="write turn/s"):
        case.with_values({"corner": "30 Hz"})
    wanted = {**TABLES["blocks"], "filter": {"kind": "low_pass", "bandwidth": "count"}}
    with pytest.raises(epp.EppError, match="count is in Hz"):
        epp.Case.from_tables(TABLES | {"blocks": wanted})
    wanted["filter"] = {"kind": "low_pass", "bandwidth": "decay"}
    assert epp.Case.from_tables(TABLES | {"blocks": wanted}).to_system().A.shape == (3, 3)


def test_a_branch_reads_in_the_unit_of_its_parameter(branch: epp.Branch) -> None:
    assert str(branch).startswith("Limit cycles exist for corner from 30 rad/s to 33 rad/s")
    assert "corner [rad/s]" in for_people(branch.in_brief()).columns
    axes = branch.plot().figure.axes
    assert axes[0].get_xlabel() == "corner [rad/s]" and axes[0].get_xlim()[1] < 40.0
    assert "deg/s" not in str(replace(branch, readable=("rad/s", 1.0)))
