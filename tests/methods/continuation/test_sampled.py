"""Branches of sampled loops: borders against closed forms from sample to sample, runs, and what is not covered."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.sampled_relay import patterns, sampled_relay


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return sampled_relay()


@pytest.fixture(scope="module")
def branch(case: epp.Case) -> epp.Branch:
    return epp.continue_branch(case, "dead", 0.05, 0.25, max_step=0.1)


def test_borders_are_those_of_closed_forms(branch: epp.Branch) -> None:
    ends = np.array([p.high for p in patterns(0.5, 20)])
    assert len(branch.special) >= 3
    for special in branch.special:
        assert np.abs(ends - special.value).min() < 2e-6 * 0.2
    assert [s.kind for s in branch.special[:-1]] == ["change of samples"] * (len(branch.special) - 1)
    told = [
        re.fullmatch(r"the (cycle of \d+ samples) .*; on with a (cycle of \d+ samples)", s.note)
        for s in branch.special[:-1]
    ]
    assert all(told)


def test_the_branch_goes_on_with_neighbours_until_no_cycle_is_left(branch: epp.Branch) -> None:
    known = list(patterns(0.5, 40))
    assert branch.special[-1].kind == "end"
    assert branch.special[-1].value == pytest.approx(max(p.high for p in known), abs=1e-6)
    samples = branch.points["samples"]
    assert samples[0] == 9.0 and 10.0 in samples and not np.any(np.isnan(samples))
    np.testing.assert_allclose(branch.points["period"], 0.5 * samples, rtol=1e-12)
    for value, n in zip(branch.points["value"], samples, strict=True):
        assert any(p.samples == n and p.low - 1e-6 <= value <= p.high + 1e-6 for p in known)


def test_runs_on_both_sides_of_its_end_say_the_same(case: epp.Case, branch: epp.Branch) -> None:
    end = branch.special[-1]
    for factor, rests in ((0.999, False), (1.001, True)):
        loop = case.with_values({"dead": factor * end.value}).to_system()
        run = epp.simulate(replace(loop, x0=end.cycle.state, memory=end.cycle.memory), t_end=200.0)
        assert (run.status is epp.Status.SETTLED) is rests


def test_what_it_does_not_cover_is_said_everywhere(branch: epp.Branch) -> None:
    assert branch.not_covered in str(branch) and "another number of samples" in branch.not_covered
    assert branch.to_dict()["not_covered"] == branch.not_covered and branch.status is epp.Status.NOT_CONVERGED
    (gap,) = branch.missing
    assert gap.high == 0.25 and gap.low == branch.special[-1].value
    shown = " ".join(" ".join(t.get_text() for t in branch.plot().figure.axes[-1].texts).split())
    assert branch.not_covered in shown
    assert "samples" in branch.to_frame().columns


@pytest.mark.slow
def test_a_sample_time_is_an_axis_like_any_other(case: epp.Case) -> None:
    along = epp.continue_branch(case, "T", "0.5 s", "0.47 s", max_step=0.5)
    assert along.status is epp.Status.INCOMPLETE and not along.missing
    np.testing.assert_allclose(along.points["period"], 10.0 * along.points["value"], rtol=1e-12)


def test_where_nothing_oscillates_there_is_no_branch(case: epp.Case) -> None:
    with pytest.raises(epp.EppError, match="no limit cycle was found at either end of the range of dead"):
        epp.continue_branch(case, "dead", 0.3, 0.4)


@pytest.mark.slow
def test_a_cycle_that_is_given_begins_it(case: epp.Case, branch: epp.Branch) -> None:
    found = epp.find_limit_cycles(case)
    own = max(found, key=lambda c: c.peak_to_peak["plant"])
    along = epp.continue_branch(case, "dead", 0.16, 0.17, cycle=own, max_step=0.5)
    assert along.points["plant"][0] == pytest.approx(own.peak_to_peak["plant"], rel=1e-9)


def test_a_cycle_that_is_not_locked_is_followed_by_runs() -> None:
    # A relay loop, a little disturbed by a sampled law whose samples have nothing to do with its period.
    tables = {
        "kind": "diagram",
        "title": "Relay with hysteresis beside a sampled law",
        "connect": ["-plant -> relay", "plant.out -> law", "relay + law -> plant"],
        "run": {"t_end": "200 s"},
        "parameters": {"lag": "1 s"},
        "blocks": {
            "law": {"kind": "gain", "gain": -0.02, "sample_time": "37.1 ms"},
            "plant": {"kind": "zero_pole_gain", "poles": ["-1/lag"] * 3, "gain": "1/lag^3", "start": [1, 0, 0]},
        },
        "elements": {"relay": {"element": "hysteresis_relay", "lower": -0.1, "upper": 0.1}},
    }  # fmt: skip
    along = epp.continue_branch(epp.Case.from_tables(tables, name="relay"), "lag", "1 s", "1.1 s", max_step=0.5)
    assert len(along) == 3 and not along.special and np.all(np.isnan(along.points["samples"]))
    assert np.all(along.points["stable"]) and np.all(np.isnan(along.points["multiplier"]))
    # Beside the small law the loop is that of the relay alone, whose period is in proportion to the lag.
    periods = along.points["period"] / along.points["value"]
    np.testing.assert_allclose(periods, periods[0], rtol=2e-3)
    assert "not locked to the samples are stable cycles from runs" in str(along)
