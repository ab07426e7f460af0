"""Bounds of sampled loops by the search: closed forms from sample to sample, runs, and what is not covered."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cli.bounds import bounds_columns, sentences
from eppanalysis.methods.bounds import searched
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.searched import Answer, SearchedProblem, searched_cell
from eppanalysis.tables.designs import bounds_table
from studies.virtual_spring import Haptic, comes_to_rest
from tests.sampled_relay import patterns, sampled_relay


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return sampled_relay()


@pytest.fixture(scope="module")
def bounds(case: epp.Case) -> epp.DesignBounds:
    return epp.design_bounds(case, "T", "dead", at=["0.5 s"], within=(0.15, 0.3), margin=0.05)


@pytest.mark.slow
def test_the_bound_of_a_sampled_relay_holds_that_of_closed_forms(bounds: epp.DesignBounds) -> None:
    (cell,) = bounds
    known = max(p.high for p in patterns(0.5, 40))
    assert known == pytest.approx(0.18166, abs=1e-5)
    assert cell.finding is Finding.BOUND and cell.sign == -1.0 and cell.kind is Turn.SEARCH
    assert cell.other_value <= known < cell.searched
    assert cell.searched / cell.other_value - 1.0 < 0.06
    assert cell.bound == cell.safe_value == cell.searched and np.isnan(cell.exact) and np.isnan(cell.first_order)


def test_runs_on_both_sides_say_the_same(case: epp.Case, bounds: epp.DesignBounds) -> None:
    (cell,) = bounds
    assert epp.simulate(case.with_values({"dead": cell.searched})).status is epp.Status.SETTLED
    assert cell.verified and cell.n_settled == cell.n_runs > 10 and cell.other_orbit is not None
    beyond = case.with_values({"dead": cell.other_value}).to_system()
    again = epp.simulate(replace(beyond, x0=cell.other_orbit.state, memory=cell.other_orbit.memory), t_end=100.0)
    assert again.limit_cycle is not None
    assert again.limit_cycle.period == pytest.approx(cell.other_orbit.period, rel=1e-12)


def test_what_the_search_does_not_cover_is_said_everywhere(case: epp.Case, bounds: epp.DesignBounds) -> None:
    said = bounds.not_covered
    assert f"searched at {bounds[0].n_searched} values of the range and to 5 %" in said and "not covered" in said
    assert str(bounds).startswith("No limit cycle was found above a dead of 0.18") and said in str(bounds)
    assert "Free of limit cycles" not in str(bounds)
    assert bounds.status is epp.Status.INCOMPLETE and bounds.to_dict()["not_covered"] == said
    assert said in " ".join(sentences(case, bounds))
    assert not any("irst order" in text or "verified" in text for text in sentences(case, bounds))
    assert bounds_columns(bounds).columns["searched"] == [bounds[0].searched]
    ax = bounds.plot()
    assert said in " ".join(" ".join(t.get_text() for t in ax.texts).split())
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "by search" in legend and "exact fold" not in legend and "free of limit cycles" not in legend


def test_a_table_names_what_was_found_in_a_column_of_its_own(bounds: epp.DesignBounds) -> None:
    for finding in (Finding.BOUND, Finding.ALWAYS):
        columns = bounds_table(replace(bounds, cells=(replace(bounds[0], finding=finding),))).columns
        shown = {str(column.header): next(column.cells) for column in columns}
        assert shown["finding"] == finding
        assert (shown["frequency [Hz]"] == "-") is (finding is Finding.ALWAYS)


def test_a_bound_by_harmonic_balance_alone_is_refused(case: epp.Case) -> None:
    with pytest.raises(epp.EppError, match="exact is False; expected True for a loop"):
        epp.design_bounds(case, "T", "dead", at=["0.5 s"], exact=False)


@dataclass(frozen=True)
class Told(SearchedProblem):
    """The answers of a loop that has cycles from one value on, and whose search is complete up to another one."""

    cycle: epp.LimitCycle | None = None
    cycles_from: float = 0.0
    free_to: float = 0.0

    def answer(self, question: BoundProblem, value: float, known: object = ()) -> Answer:
        opened = () if value <= self.free_to else ("a run was left undecided",)
        cycles = () if value < self.cycles_from or self.cycle is None else (self.cycle,)
        return Answer(value, cycles, opened, 7)


def cell_of(case: epp.Case, told: Told) -> BoundCell:
    return searched_cell(BoundProblem(case, "dead", 0.1, 0.2, "T"), 0.5, told)


def test_where_runs_are_left_undecided_before_the_next_cycle_the_bound_is_not_verified(case, bounds) -> None:
    cell = cell_of(case, Told(cycle=bounds[0].other_orbit, cycles_from=0.16, free_to=0.14))
    assert 0.1386 <= cell.searched <= 0.14 and not cell.verified
    assert cell.message.startswith("Not verified: at 0.14") and "a run was left undecided; the next" in cell.message
    assert cell.other_value >= 0.16
    told = replace(bounds, cells=(cell,))
    assert told.status is epp.Status.UNDECIDED and "a cycle was found just beyond 0 of 1 bound" in str(told)


def test_where_no_cycle_is_found_beyond_that_is_said(case, bounds) -> None:
    cell = cell_of(case, Told(free_to=0.14))
    assert 0.1386 <= cell.searched <= 0.14 < cell.other_value < 0.142 and not cell.verified
    assert cell.other_orbit is None and "no cycle was found beyond" in cell.message
    replace(bounds, cells=(cell,)).plot()


@pytest.mark.parametrize(
    ("cycles_from", "free_to", "finding"),
    [(9.0, 9.0, Finding.NONE), (0.0, 0.0, Finding.ALWAYS), (9.0, 0.0, Finding.UNSURE)],
)
def test_where_the_answer_does_not_change_there_is_no_bound(case, bounds, cycles_from, free_to, finding) -> None:
    cell = cell_of(case, Told(cycle=bounds[0].other_orbit, cycles_from=cycles_from, free_to=free_to))
    assert cell.finding is finding and np.isnan(cell.bound) and cell.n_searched == 6
    told = str(replace(bounds, cells=(cell,)))
    said = "Undecided: no bound on dead" if finding is Finding.UNSURE else "No bound on dead"
    assert told.startswith(said) and "not covered" in told


@dataclass(frozen=True)
class OpenFromOthers(Told):
    """The answers of a loop whose runs from known cycles are left undecided where it has none."""

    def answer(self, question: BoundProblem, value: float, known: object = ()) -> Answer:
        answer = super().answer(question, value, known)
        return answer if self.first or answer.cycles else replace(answer, open_ends=("a run was left undecided",))


def test_starts_that_leave_the_end_of_the_range_open_are_no_cycles_there(case, bounds) -> None:
    cell = cell_of(case, OpenFromOthers(cycle=bounds[0].other_orbit, cycles_from=0.16, free_to=9.0))
    assert cell.finding is Finding.UNSURE and np.isnan(cell.bound)
    assert "of the others, runs were left undecided at" in cell.message
    _, free, left = re.split("undecided at |Left open: ", cell.message)
    assert [part.split(",")[0] for part in left.split("; ")] == [f"at {v}" for v in re.findall(r"\d[.\d]*\d", free)]
    told = [f"{replace(bounds, cells=(cell,)).headline()}.", *sentences(case, replace(bounds, cells=(cell,)))]
    assert " ".join(told).count(cell.message) == 1 and bounds.not_covered in told


def test_a_bound_at_zero_is_found_in_few_steps(case, bounds) -> None:
    told = Told(cycle=bounds[0].other_orbit, cycles_from=1e-300)
    question = BoundProblem(case, "dead", 0.0, 0.2)
    safe, beyond = (told.answer(question, value) for value in (0.0, 0.2))
    (safe, beyond, _), count = searched._narrowed(question, (safe, beyond, beyond), told)
    assert safe.value == 0.0 and 0.0 < beyond.value < 1e-4 and count < 25


@pytest.mark.slow
def test_the_own_run_of_a_virtual_spring_is_bounded_where_closed_forms_are() -> None:
    """Let go 5 mm aside it comes to rest up to 544 N/m, by closed forms that know nothing of the engine."""
    spring = epp.case("virtual_spring")
    found = epp.design_bounds(spring, "aside", "K", at=["5 mm"], within=(500.0, 600.0), own_run=True, margin=0.02)
    (cell,) = found
    assert comes_to_rest(Haptic(5e-3), cell.searched) and not comes_to_rest(Haptic(5e-3), cell.other_value)
    assert cell.sign == 1.0 and 0.98 < cell.searched / cell.other_value < 1.0
    assert "where the case's own run ceases to come to rest" in str(found) and "other starts and inputs" in str(found)
    assert found.status is epp.Status.UNDECIDED and "neither settles nor repeats itself" in cell.message


def test_the_own_run_is_for_sampled_loops() -> None:
    with pytest.raises(epp.EppError, match="own_run is given for a loop whose bounds are folds"):
        epp.design_bounds(epp.case("wheelchair"), "play.gap", "loop.gain", at=[0.012], within=(0.5, 1.0), own_run=True)


@pytest.mark.slow
def test_a_controller_that_holds_its_integrator_is_bounded_by_the_search() -> None:
    """(kp + ki/s)/(s + 1)^3 is unstable from ``(8 - kp)(1 + kp) = 9 ki`` on, by Routh; a limit makes cycles of it."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 3.0, 1.0]), epp.ClampedPID(kp=4.0, ki=0.8), x0=[1.0, 0.0, 0.0])
    case = epp.Case.from_system(loop, name="clamped", t_end=100.0)
    found = epp.design_bounds(case, "clamped_pid.ki", "clamped_pid.kp", at=[0.8], within=(4.0, 15.0), margin=0.02)
    (cell,) = found
    unstable = 3.5 + np.sqrt(3.5**2 + 8.0 - 9.0 * 0.8)
    assert cell.searched <= unstable <= cell.other_value <= 1.02 * cell.searched and cell.verified
    assert "no balance of harmonics: bounds are where the answer of the search" in str(found)


@pytest.mark.slow
def test_a_loop_in_discrete_time_is_bounded_by_the_search() -> None:
    """x+ = a x - (1 - a) relay(x) changes its sign at each sample as long as (1 - a)/(1 + a) is above the dead zone."""
    loop = epp.LureSystem.from_tf(epp.StateSpace([[0.5]], [[0.5]], [[1.0]], [[0.0]], 0.1), epp.RelayDeadZone(0.2))
    case = epp.Case.from_system(replace(loop, x0=np.array([0.3])), name="discrete")
    found = epp.design_bounds(case, "relay_dead_zone.level", "relay_dead_zone.threshold", at=[1.0], within=(0.2, 0.6))
    (cell,) = found
    assert cell.other_value <= 1.0 / 3.0 <= cell.searched and cell.sign == -1.0 and cell.verified
    assert found.not_covered in str(found)
