"""Design bounds against independent answers: exact folds of branches, describing functions on both sides, runs."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.bounds import balanced
from eppanalysis.methods.bounds.balanced import BalancedSweep, BoundProblem, Finding, look, steady_loop
from eppanalysis.methods.bounds.design import Settings, bound_of_branch, checked_bound, design_bounds
from eppanalysis.methods.bounds.equations import write
from eppanalysis.methods.bounds.exact import ExactBound, correct
from eppanalysis.methods.bounds.fold import Cycle, unknowns_of
from eppanalysis.methods.bounds.numbers import ParametricModel, gather, plan_of
from eppanalysis.methods.bounds.result import BoundCell, Known
from eppanalysis.methods.bounds.tolerances.bound import quantile, tolerance_bound
from eppanalysis.methods.bounds.verify import verify
from eppanalysis.methods.harmonic.balance import harmonic_balance
from eppanalysis.methods.harmonic.loop import inputs_of
from eppanalysis.methods.harmonic.series import anchored
from tests import made_bounds

DEGREE = math.pi / 180.0
WITHIN = ("0.1 deg", "5 deg")
#: The fold in backlash at a profile range of 2.5 lbf, from a branch of exact orbits [rad].
FOLD = 0.0170795626032


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return epp.case("fig8a_original")


@pytest.fixture(scope="module")
def wheelchair() -> epp.Case:
    return made_bounds.wheelchair()


@pytest.fixture(scope="module")
def found(case: epp.Case) -> epp.DesignBounds:
    return design_bounds(case, "bands.range", "lock_pin.backlash", at=["2.5 lbf"], within=WITHIN, starts=200)


def test_row_one_against_the_fold_of_its_branch(found: epp.DesignBounds) -> None:
    cell = found[0]
    assert cell.exact == pytest.approx(FOLD, rel=1e-9)
    assert cell.sign == 1.0 and cell.kind == "fold"
    assert cell.first_order < cell.exact and not cell.first_order_unsafe
    assert cell.first_order_error == pytest.approx(-0.2486, abs=5e-4)


def test_a_bound_is_verified_on_both_sides(found: epp.DesignBounds) -> None:
    (cell,) = found
    assert cell.verified, cell.message
    assert cell.n_settled == cell.n_runs == 200
    assert cell.n_cycles == 0
    assert cell.other_orbit is not None and cell.other_orbit.residual < 1e-9
    assert cell.safe_value < cell.exact < cell.other_value
    assert found.status.ok


def test_first_order_bound_parts_predictions_with_and_without_cycles(case: epp.Case, found: epp.DesignBounds) -> None:
    bound = found[0].first_order
    for factor, there in ((0.997, False), (1.003, True)):
        changed = case.with_values({"lock_pin.backlash": factor * bound})
        assert bool(len(epp.predict_limit_cycles(changed))) is there


@pytest.mark.slow
def test_exact_elasticities_against_moved_folds(case: epp.Case, found: epp.DesignBounds) -> None:
    h = 2e-3
    for name in ("bands.range", "cable.stiffness"):
        moved = []
        for share in (-h, h):
            changed = case.with_values({name: case.value(name) * (1.0 + share)})
            branch = epp.continue_branch(
                changed, "lock_pin.backlash", "1.1 deg", "0.9 deg", n_points=80, max_step=0.05, n_others=0
            )
            moved.append(min(f.value for f in branch.folds))
        slope = (math.log(moved[1]) - math.log(moved[0])) / (2 * h)
        assert found[0].elasticities[name] == pytest.approx(slope, rel=2e-4)


@pytest.mark.slow
def test_bounds_by_describing_functions_do_not_depend_on_where_they_began(wheelchair: epp.Case) -> None:
    alone, last = (
        design_bounds(wheelchair, "play.gap", "loop.gain", at=at, exact=False)[-1] for at in ([0.012], [0.011, 0.012])
    )
    assert last.first_order == last.bound == pytest.approx(alone.first_order, rel=1e-14)
    assert last.known is Known.BALANCED


def test_where_the_describing_function_is_off_by_a_half_the_exact_bound_is_found_all_the_same(case: epp.Case) -> None:
    """No exact orbit is near its cycles at its own bound: those far inside lead to the fold."""
    (cell,) = design_bounds(case, "bands.range", "lock_pin.backlash", at=["5 lbf"], within=WITHIN, verify=False)
    assert cell.first_order_error == pytest.approx(-0.5546, abs=5e-4) and cell.kind == "fold"
    # On the branch of the elbow's own range the bands at that backlash turn back at 5 lbf.
    there = case.with_values({"lock_pin.backlash": cell.exact})
    branch = epp.continue_branch(there, "bands.range", "3 lbf", "6 lbf", max_step=0.05, n_others=0)
    assert max(f.value for f in branch.folds) == pytest.approx(case.si("bands.range", "5 lbf"), rel=1e-6)


def test_a_bound_that_is_wrong_is_not_verified(case: epp.Case, found: epp.DesignBounds) -> None:
    orbit = found[0].orbit
    assert orbit is not None
    question = BoundProblem(case, "lock_pin.backlash", 0.002, 0.09)
    test = verify(question, 1.03 * FOLD, 1.0, orbit, margin=0.01, n_starts=40, seed=1)
    assert not test.verified
    assert test.n_settled < 40 and len(test.search) == 2


def test_cycles_that_only_runs_find_lead_to_the_true_bound(
    case: epp.Case, found: epp.DesignBounds, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bound 3 % too high, and a search that sees nothing: the runs end on a cycle, and its fold is the bound."""
    orbit = found[0].orbit
    assert orbit is not None
    nothing = epp.CycleSearch((), epp.Status.CONVERGED, True, False, "blind")
    monkeypatch.setattr("eppanalysis.methods.bounds.verify.find_limit_cycles", lambda *_, **__: nothing)
    question = BoundProblem(case, "lock_pin.backlash", 0.002, 0.09)
    wrong = ExactBound(1.03 * FOLD, orbit.period, orbit, "fold")
    first = verify(question, wrong.value, 1.0, orbit, margin=0.01, n_starts=40, seed=1)
    assert len(first.cycles) == 1 and first.cycles[0].stable and not first.verified
    cell = checked_bound(question, replace(found[0], exact=math.nan, verified=False), wrong, Settings(starts=40))
    assert cell.exact == pytest.approx(FOLD, rel=1e-9) and cell.kind == "fold"
    assert cell.verified and cell.safe_value == pytest.approx(0.99 * FOLD)


@pytest.mark.slow
def test_a_bound_at_a_border_collision_is_exact_and_verified() -> None:
    """With the original pulley the branch turns back at a border collision, whose value is known from a branch."""
    pulley = epp.case("fig6a_original_pulley").value("pulley.friction")
    changed = epp.case("fig8a_original").with_values({"pulley.friction": pulley})
    branch = epp.continue_branch(changed, "lock_pin.backlash", start="1.2 deg", stop="0.7 deg", n_others=0)
    question = BoundProblem(changed, "lock_pin.backlash", 0.7 * DEGREE, 1.2 * DEGREE)
    cell = bound_of_branch(question, changed.value("bands.range"), branch, Settings(starts=40))
    assert cell is not None
    assert cell.verified, cell.message
    assert cell.kind == "border collision" and cell.n_settled == 40
    assert math.degrees(cell.exact) == pytest.approx(0.8234704211, rel=1e-9)
    assert cell.elasticities["bands.range"] == pytest.approx(1.20383, rel=1e-4)


@pytest.mark.parametrize("name", ["fig8a_original", "fig6a_original_pulley"])
def test_expressions_hold_for_cycles_of_the_harmonic_balance(name: str) -> None:
    """The balance as CasADi has it against the one of the harmonic module, with memory and two outputs."""
    changed = epp.case(name)
    system = changed.to_system()
    loop = steady_loop(changed)
    guess = next(c for c in epp.predict_limit_cycles(system, changed.operating_point) if c.stable)
    cycle = harmonic_balance(system, guess, order=5, operating_point=changed.operating_point)
    Z, pivot = anchored(inputs_of(loop, cycle))
    plan, phases, memory = plan_of(loop, Z, cycle.omega)
    numbers = gather(loop, plan)
    theta = numbers.flat()
    used = theta != 0.0
    expressions = write(plan, numbers, used, tuple(() for _ in loop.elements), pivot)
    X = unknowns_of(loop, Z, cycle.omega, phases, memory)
    residual = np.array(expressions.residual(X, theta[used])).ravel()
    J = np.array(expressions.residual.jacobian()(X, theta[used], 0)[0])
    size = np.abs(J).max(1)
    assert np.max(np.abs(residual) / (size * np.abs(X).max())) < 1e-9
    # Exact derivatives: a step along a random direction.
    direction = np.random.default_rng(3).normal(size=X.size) * np.abs(X)
    h = 1e-6
    up, down = (np.array(expressions.residual(X + s * h * direction, theta[used])).ravel() for s in (1.0, -1.0))
    slope = J @ direction
    assert np.max(np.abs((up - down) / (2 * h) - slope)) < 1e-6 * np.max(np.abs(slope))


def test_numbers_as_polynomials_of_the_parameter(case: epp.Case) -> None:
    model = ParametricModel(lambda v: steady_loop(case.with_values({"bands.range": v})), 4.0, 30.0)
    loop = model.loop(12.0)
    cycle = next(c for c in epp.predict_limit_cycles(loop.system, case.operating_point) if c.stable)
    plan, _, _ = plan_of(loop, inputs_of(loop, cycle), cycle.omega)
    numbers = model.numbers(plan, 12.0)
    for value in (11.3, 13.1):
        exact = gather(model.loop(value), plan).flat()
        np.testing.assert_allclose(numbers.at(value), exact, rtol=1e-12, atol=1e-12)


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycles are looked for at three values of a range, where there is nothing to see between them."""
    monkeypatch.setattr("eppanalysis.methods.bounds.balanced.look", partial(look, n_scan=3))


def test_a_loop_whose_cycles_scale_with_the_gap_has_no_bound_on_it(coarse: None) -> None:
    sweep = BalancedSweep(BoundProblem(epp.case("backlash_servo"), "play.gap", 0.2, 5.0))
    _, bound = sweep.bound(0.0)
    assert bound.finding is Finding.SCALES
    assert "scale with this parameter alone" in bound.finding.sentence
    assert bound.fold is None


@pytest.mark.parametrize(
    ("within", "finding", "words"),
    [
        ((0.3, 0.6), "none", "The exact search finds no limit cycle"),
        pytest.param((1.0, 1.3), "always", "none of them is free", marks=pytest.mark.slow),
    ],
)
def test_questions_without_a_bound_get_a_sentence(
    wheelchair: epp.Case, coarse: None, within: tuple[float, float], finding: str, words: str
) -> None:
    result = design_bounds(wheelchair, "play.gap", "loop.gain", at=[0.012], within=within)
    assert result[0].finding == finding
    assert words in result[0].message
    assert math.isnan(result[0].bound)
    assert result.status.ok


HUNTING = """
kind = "loop"
title = "Positioning with integral action and stiction"
[loop]
A = [[0, 1, 0], [-25.0, -3.0, {integral}], [1, 0, 0]]
B = [[0], [-1.0], [0]]
C = [[0, 1, 0]]
initial_state = [0.1, 0, 0]
[[loop.elements]]
element = "friction"
name = "friction"
coulomb = "1 N"
static = "1.5 N"
[run]
t_end = "120 s"
"""


@pytest.mark.parametrize("integral", [-20.0, pytest.param(-10.0, marks=pytest.mark.slow)])
def test_cycles_that_first_order_misses_everywhere_are_found_everywhere(integral: float) -> None:
    """Hunting: no describing function sees it, and no value between those that are asked first is free of it."""
    case = epp.case_from_text(HUNTING.format(integral=integral))
    assert len(epp.predict_limit_cycles(case.to_system())) == 0
    for value in (1.8, 2.6):
        there = case.with_values({"friction.static": value})
        assert epp.simulate(there.to_system(), t_end=400.0).status is epp.Status.LIMIT_CYCLE
    assert look(BoundProblem(case, "friction.static", 1.5, 3.0)).finding is Finding.ALWAYS


def test_a_search_that_cannot_tell_is_no_answer(wheelchair: epp.Case, monkeypatch: pytest.MonkeyPatch) -> None:
    undecided = epp.CycleSearch((), epp.Status.UNDECIDED, True, False, "blind", left_open=("9 runs neither settled",))
    monkeypatch.setattr("eppanalysis.methods.bounds.balanced.find_limit_cycles", lambda *_, **__: undecided)
    result = design_bounds(wheelchair, "play.gap", "loop.gain", at=[0.012], within=(0.3, 0.6))
    assert result[0].finding == "unsure" and not result.status.ok
    assert "left runs undecided" in result[0].message and "0.3, 0.3568" in result[0].message


@pytest.mark.slow
def test_every_slow_run_beside_a_bound_is_looked_at_to_its_end(wheelchair: epp.Case) -> None:
    """Of a thousand runs 1 % beside the fold more than two hundred are slow, and none of them stays."""
    question = BoundProblem(wheelchair, "loop.gain", 0.05, 2.0)
    there = wheelchair.with_values({"loop.gain": 0.85})
    orbit = epp.find_limit_cycles(there.to_system())[0]
    test = verify(question, 0.8462571577, 1.0, orbit, margin=0.01, n_starts=1000, seed=20050901)
    assert test.verified and test.n_settled == 1000, test.message


@pytest.mark.slow
def test_runs_that_keep_moving_are_not_all_waited_for(wheelchair: epp.Case) -> None:
    question = BoundProblem(wheelchair, "loop.gain", 0.05, 2.0)
    orbit = epp.find_limit_cycles(wheelchair.to_system()).stable[0]
    test = verify(question, 1.0, 1.0, orbit, margin=0.01, n_starts=200, seed=1)
    assert not test.verified and "of " in test.message
    moving = int(re.search(r"(\d+) of (\d+) runs did not come to rest", test.message)[1])
    left = int(re.search(r"(\d+) slow runs after these were not run", test.message)[1])
    assert moving == 50 and test.n_settled + moving + left == 200


def test_of_the_two_sides_of_cycles_that_is_bounded_which_the_own_value_is_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(balanced, "scales", lambda *_: False)
    cycle = Cycle(3.0, np.zeros((1, 2), complex), 2.4)
    seen = [balanced._Seen(v, exact=[cycle] * (2.0 < v < 10.0), complete=True) for v in (1.25, 3.0, 7.0, 19.0, 50.0)]
    for own, sign, note in (("25 rad/s", -1.0, "below 1.25 rad/s either"), ("2 rad/s", 1.0, "above 19 rad/s either")):
        case = epp.case("x15_flare").with_values({"bandwidth": own})
        outlook = balanced._outlook(BoundProblem(case, "bandwidth", 1.25, 50.0), seen)
        assert (outlook.finding, outlook.sign) == (Finding.BOUND, sign) and note in outlook.note


@pytest.mark.slow
def test_first_order_is_not_believed_that_cycles_are_everywhere(case: epp.Case) -> None:
    # Little and much inertia oscillate; the elbow's own does not: its fold stands at 0.979 degrees (first order: 0.74).
    own = case.with_values({"lock_pin.backlash": "0.95 deg"})
    assert look(BoundProblem(own, "drive.inertia", 0.0015, 0.06), n_scan=2).finding is Finding.BETWEEN


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": 0}, "points is 0"),
        ({"workers": 0}, "workers is 0"),
        ({"margin": 0.7}, "margin is 0.7"),
        ({"starts": -1}, "starts is -1"),
        ({"limit": "bands.range"}, "two different parameters"),
        ({"start": "1 lbf", "stop": "1 lbf"}, "two different values"),
        ({"within": ("2 deg", "1 deg")}, "low < high"),
        ({"limit": "lock_pin.baklash"}, "did you mean 'lock_pin.backlash'"),
    ],
)
def test_bad_questions_are_refused(case: epp.Case, change: dict[str, object], words: str) -> None:
    asked: dict[str, object] = {"over": "bands.range", "limit": "lock_pin.backlash", **change}
    with pytest.raises(epp.EppError, match=words):
        design_bounds(case, **asked)


def test_quantile_interval_covers_as_often_as_it_says() -> None:
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(400):
        q = quantile(rng.normal(size=300), 0.9)
        hits += q.low <= -1.2815515655446004 <= q.high
    # Binomial(400, >= 0.95): fewer than 370 has a probability below 0.5 %.
    assert hits >= 370


def test_quantile_of_few_draws_is_not_made_up() -> None:
    assert math.isnan(quantile(np.arange(50.0), 0.99).low)


@pytest.mark.slow
def test_tolerances(wheelchair: epp.Case) -> None:
    """The worst corner is where the branch of that corner turns back; no draw lies below it."""
    within, widths = (0.3, 1.3), {"play.gap": "6 %", "dead_zone.upper": "5 %"}
    result = tolerance_bound(wheelchair, "loop.gain", widths, within=within, samples=60, seed=5)
    assert result.nominal == pytest.approx(made_bounds.GAIN, rel=1e-6)
    assert result.worst_values["play.gap"] == pytest.approx(1.06 * wheelchair.value("play.gap"))
    # The worst corner once more, on its own.
    worst = wheelchair.with_values({**result.worst_values, "loop.gain": 1.0})
    branch = epp.continue_branch(worst, "loop.gain", start=1.0, stop=0.7, n_others=0)
    assert result.worst_case == pytest.approx(min(f.value for f in branch.folds), rel=1e-8)
    assert abs(result.engine_offset) < 0.01
    assert result.n_corners == 3 and not result.message
    q = result.quantiles[0]
    assert result.worst_case < q.value < result.nominal
    assert np.all(result.draws > 0.99 * result.worst_case)


def test_correction_says_why_there_is_no_orbit(case: epp.Case) -> None:
    question = BoundProblem(case, "lock_pin.backlash", 0.0005, 0.006)
    loop = steady_loop(case)
    cycle = next(c for c in epp.predict_limit_cycles(loop.system, case.operating_point) if c.stable)
    bound = correct(question, Cycle(0.004, inputs_of(loop, cycle), cycle.omega), 1.0)
    assert math.isnan(bound.value) and bound.message


@pytest.mark.parametrize("n", [0, 1, 2])
def test_where_the_tests_find_cycles_on_the_safe_side_there_is_no_bound(wheelchair, n):
    """A servo that hunts in friction had a fold of another cycle as its bound, and all runs at it moved on."""
    cells = [
        BoundCell(
            value, Finding.BOUND, exact=0.01, safe_value=0.0099, n_runs=50, n_cycles=int(i < n), verified=i >= n,
            message=f"Not verified: it hunts{' slowly' * i}." * (i < n),
        )
        for i, value in enumerate((0.9, 1.0))
    ]  # fmt: skip
    bounds = made_bounds.bounds_of(wheelchair, "loop.gain", "play.gap", *cells)
    assert [cell.known is Known.NONE for cell in bounds] == [i < n for i in range(2)]
    said, rows = str(bounds), epp.manual_table(bounds).rows if n < 2 else ()
    assert said.startswith(
        "No bound on play gap" if n == 2 else "Free of limit cycles below a play gap of 9.9 mm (exact 10 mm)"
    )
    assert ("At a loop gain of 0.9: Not verified: it hunts. At a loop gain of 1: " in said) == (n == 2)
    assert ("it hunts" in said) == (n == 2) and ("no bound at 1 of 2 values" in said) == (n == 1)
    assert [row[-1].startswith("Not verified: it hunts") for row in rows] == [i < n for i in range(len(rows))]


@pytest.mark.parametrize("verified", [(True, True), (True, False), (False, False)])
def test_what_no_test_confirms_is_no_bound_in_large_letters_without_a_word(wheelchair, verified):
    """Above the picture stood that there is no cycle below, and in small print that none of that was verified."""
    cells = [
        BoundCell(value, Finding.BOUND, exact=0.01, safe_value=0.0099, n_runs=50, verified=done)
        for value, done in zip((0.9, 1.0), verified, strict=True)
    ]
    told = made_bounds.bounds_of(wheelchair, "loop.gain", "play.gap", *cells).headline()
    assert told.startswith("Free of limit cycles below a play gap of 9.9 mm (exact 10 mm)")
    assert told.endswith(", not verified") == (not any(verified))
    assert told.endswith(", verified in part") == (any(verified) and not all(verified))
