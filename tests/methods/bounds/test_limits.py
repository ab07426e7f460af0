"""Every kind of parameter as the limit: its exact bound, the safe side, and what runs and the full search say of both.

All begin from one exact orbit, the one at the bound on backlash. At a backlash a little beside that bound the bound on
another parameter is close by: the orbit leads to it, so that no describing function is needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.bounds.balanced import (
    BalancedBound,
    BalancedSweep,
    BoundProblem,
    Finding,
    idle,
    look,
    steady_loop,
)
from eppanalysis.methods.bounds.design import Settings, bound_of_branch
from eppanalysis.methods.bounds.elasticity import exact_slopes
from eppanalysis.methods.bounds.exact import correct, searched
from eppanalysis.methods.bounds.fold import Cycle
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.bounds.verify import verify
from eppanalysis.methods.design import bound_curve
from eppanalysis.methods.design.bound_curve import first_turn
from eppanalysis.methods.harmonic.loop import inputs_of
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.simulation.runs import judge, run_hybrid
from eppanalysis.results import LimitCycle, Status
from tests import made_bounds
from tests.shared import cycles_of

BACKLASH = "lock_pin.backlash"
#: Limit, backlash [deg], side that has cycles, distance of the tests (those that move the bound on backlash little are
#: tested farther away: a cycle that is about to vanish takes long to decay), and the bound on it as a share of its own.
LIMITS = [
    ("bands.range", 1.0217, -1.0, 0.01, 1.0396),
    ("bands.max", 0.9980, -1.0, 0.01, 1.0300),
    ("bands.parking_width", 0.9956, -1.0, 0.02, 1.0395),
    ("cable.stiffness", 0.9209, 1.0, 0.01, 1.0400),
    ("forearm.prehensor_mass", 0.9757, 1.0, 0.05, 1.0415),
    ("controller.delay", 0.97797, 1.0, 0.2, 1.0390),
    ("drive.inertia", 0.97518, 1.0, 0.05, 1.0382),
]


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return epp.case("fig8a_original")


@pytest.fixture(scope="module")
def wheelchair() -> epp.Case:
    return made_bounds.wheelchair()


@pytest.fixture(scope="module")
def orbit(case: epp.Case) -> LimitCycle:
    """At the bound on backlash, 0.9786 deg."""
    branch = epp.continue_branch(case, BACKLASH, "1.1 deg", "0.9 deg", n_points=80, max_step=0.05, n_others=0)
    return min(branch.folds, key=lambda f: f.value).cycle


def question_at(case: epp.Case, limit: str, backlash: float) -> BoundProblem:
    own = case.value(limit)
    return BoundProblem(case.with_values({BACKLASH: f"{backlash} deg"}), limit, 0.8 * own, 1.3 * own)


def ends(question: BoundProblem, value: float, orbit: LimitCycle) -> Status:
    """Where an event-exact run from a state of the orbit ends at a value of the limit."""
    case = question.case_at(value)
    system = case.to_system()
    hybrid = steady_hybrid(system, case.operating_point)
    x0, H0 = start_of(hybrid, orbit)
    hybrid = replace(hybrid, x0=x0, H0=H0)
    t = 400.0 * orbit.period
    return judge(hybrid, run_hybrid(hybrid, t, np.zeros(0), 2.0 * hybrid.time_scale, 400_000, 4000), t)[0]


#: One with cycles below it, and one with cycles above it.
FIRST = "bands.range", "cable.stiffness"


@pytest.mark.parametrize(
    ("limit", "backlash", "sign", "margin", "share"),
    [pytest.param(*row, id=row[0], marks=[pytest.mark.slow] * (row[0] not in FIRST)) for row in LIMITS],
)
def test_bound_on_any_parameter(
    case: epp.Case, orbit: LimitCycle, limit: str, backlash: float, sign: float, margin: float, share: float
) -> None:
    question = question_at(case, limit, backlash)
    near = Cycle(share * case.value(limit), inputs_of(steady_loop(case), orbit)[:, :10], orbit.omega)
    found = correct(question, near, sign)
    assert found.kind == "fold" and found.cycle is not None, found.message
    assert found.value / case.value(limit) == pytest.approx(share, abs=2e-3)
    # The fold in backlash of the case with this value of the limit is the backlash of the question.
    there = case.with_values({limit: found.value})
    branch = epp.continue_branch(there, BACKLASH, "1.1 deg", "0.85 deg", n_points=80, max_step=0.05, n_others=0)
    assert np.degrees(min(f.value for f in branch.folds)) == pytest.approx(backlash, rel=1e-6)
    test = verify(question, found.value, sign, found.cycle, margin=margin, n_starts=40, seed=1)
    assert test.verified, test.message
    assert len(test.search) == 0 and test.n_settled == 40
    # Runs from the orbit at the bound itself: to rest on the safe side, to the stable cycle on the other.
    assert ends(question, found.value * (1.0 - sign * margin), found.cycle) is Status.SETTLED
    assert ends(question, found.value * (1.0 + sign * margin), found.cycle) is Status.LIMIT_CYCLE


@pytest.mark.slow
def test_friction_of_the_pulley_at_high_gain() -> None:
    """With the original pulley at 1.5 lbf half a degree of backlash is too much; with half the friction it is not."""
    limit, own = "pulley.friction", epp.case("fig6a_original_pulley").value("pulley.friction")
    here = epp.case("fig8a_original").with_values({"bands.range": "1.5 lbf", BACKLASH: "0.5 deg", limit: own})
    cycle = epp.find_limit_cycles(here).stable[-1]
    branch = epp.continue_branch(here, limit, own, 0.01, cycle=cycle, max_step=0.05, n_others=0)
    cell = bound_of_branch(BoundProblem(here, limit, 0.01, own), here.value(BACKLASH), branch, Settings(starts=40))
    assert cell is not None and cell.verified, cell
    assert cell.exact == pytest.approx(0.0252, abs=5e-5)
    # The bound on backlash of the elbow with that friction is half a degree.
    there = here.with_values({limit: cell.exact})
    back = epp.continue_branch(there, BACKLASH, "0.55 deg", "0.4 deg", cycle=cell.orbit, max_step=0.05, n_others=0)
    assert np.degrees(min(f.value for f in back.folds)) == pytest.approx(0.5, rel=1e-6)


@pytest.mark.slow
def test_bound_from_exact_orbits_alone(wheelchair: epp.Case) -> None:
    """What is done where describing functions are of no help: the search, the branch, the fold."""
    found = searched(BoundProblem(wheelchair, "loop.gain", 0.6, 1.2), 0.6, 1.0)
    assert found.kind == "fold" and found.value == pytest.approx(made_bounds.GAIN, rel=1e-6)
    # Where no cycle exists none is found.
    none = searched(BoundProblem(wheelchair, "loop.gain", 0.6, 0.8), 0.8, 1.0)
    assert none.kind == "" and none.cycle is None and none.message.endswith("finds no limit cycle at 0.6, 0.8")


@pytest.mark.slow
def test_a_cell_without_describing_functions_is_bound_exactly(
    wheelchair: epp.Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Describing functions that see cycles down to the end of the range are not believed: exact orbits decide."""
    blind = BalancedBound(Finding.BEYOND, 1.0)
    monkeypatch.setattr(BalancedSweep, "bound", lambda self, value: (self.question.at(value), blind))
    asked = (wheelchair, "play.gap", "loop.gain")
    (cell,) = epp.design_bounds(*asked, at=[0.012], within=(0.6, 1.2), starts=40)
    assert cell.finding == "bound" and cell.verified, cell.message
    assert cell.exact == pytest.approx(made_bounds.GAIN, rel=1e-6)
    assert np.isnan(cell.first_order)
    # There really are cycles down to the end of this one.
    (cell,) = epp.design_bounds(*asked, at=[0.012], within=(0.95, 1.2), starts=40)
    assert cell.finding == "beyond" and "down to the end" in cell.message and np.isnan(cell.bound)


def test_parameters_without_effect_are_named_so(case: epp.Case) -> None:
    for limit in ("forearm.prehensor_distance", "pulley.kinetic_ratio", "sensor.gain"):
        own = case.value(limit)
        assert look(BoundProblem(case, limit, 0.5 * own, own)).finding is Finding.IDLE
    massive = case.with_values({"forearm.prehensor_mass": "0.45 kg"})
    assert not idle(BoundProblem(massive, "forearm.prehensor_distance", 0.2, 0.3), (0.2, 0.3))


@pytest.mark.parametrize(
    ("given", "over", "limit", "expected"),
    [
        ({}, BACKLASH, "sensor.filter", "sensor.filter has no value in this case; expected a range"),
        ({}, "sensor.filter", BACKLASH, "sensor.filter has no value in this case; expected values"),
        ({}, BACKLASH, "pulley.friction", "pulley.friction is 0 in this case; expected a range"),
        ({}, "forearm.inertia", "forearm.prehensor_mass", "replaces forearm.inertia"),
        ({}, "bands.range", "bands.max", "replaces bands.range"),
        ({"bands.low": "2.3 lbf"}, BACKLASH, "bands.range", r"cannot be changed .* bands.centre is missing"),
        ({"controller.sample_period": "5 ms"}, BACKLASH, "bands.range", "has a clock"),
        ({}, BACKLASH, "delay", "did you mean 'controller.delay'"),
    ],
)
def test_what_cannot_be_asked(case: epp.Case, given: dict[str, str], over: str, limit: str, expected: str) -> None:
    with pytest.raises(epp.EppError, match=expected):
        epp.design_bounds(case.with_values(given), over, limit, points=2)


def test_a_field_that_is_left_out_may_be_bounded(case: epp.Case) -> None:
    """The filter of the sensor: none is given, and the answer knows no own value of it."""
    found = epp.design_bounds(case, BACKLASH, "sensor.filter", at=["0.1 deg"], within=("1 ms", "1.2 ms"), exact=False)
    assert found[0].finding == "none" and set(found.own) == {BACKLASH}


@pytest.mark.slow
def test_where_cycles_begin_at_the_linear_limit_the_bound_moves_as_the_undamped_pole_asks() -> None:
    """Against the characteristic polynomial p(s) = (s + b) den(s) + b K num(s), zero at jw: K and w over b."""
    case = epp.case("x15_flare")
    unstable = next(cycle for cycle in epp.find_limit_cycles(case) if not cycle.stable)
    question = BoundProblem(case, "Kp", 1.5, 3.0)
    found = first_turn(question, 1.5, unstable, -1.0)
    assert found is not None and found.kind is Turn.LINEAR and found.point is not None
    num, den, b = np.poly1d([3.476, 3.1708072, 0.0896237936]), np.poly1d([1, 0.8608, 5.3159942, 0.108928, 0.0529]), 25.0
    K, s = found.value, 2j * np.pi / found.period
    by_s = den(s) + (s + b) * den.deriv()(s) + b * K * num.deriv()(s)
    columns = np.array([b * num(s), 1j * by_s])
    expected = np.linalg.solve(
        [columns.real, columns.imag], [-(part(den(s) + K * num(s))) for part in (np.real, np.imag)]
    )
    slopes = exact_slopes(question, found.point, {"bandwidth": b, "rate": 0.3})
    assert slopes["bandwidth"] == pytest.approx(expected[0], rel=1e-7)
    assert abs(slopes["rate"]) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(("at_once", "step"), [(8, 0.05), (13, 0.02)])
def test_a_walk_that_is_begun_anew_ends_as_the_one_walk_does(
    monkeypatch: pytest.MonkeyPatch, at_once: int, step: float
) -> None:
    """At a linear limit orbits of two unequal visits exist, too: a step that lands on one is not taken for a change."""
    monkeypatch.setattr(bound_curve, "_AT_ONCE", at_once)
    monkeypatch.setattr(bound_curve, "_STEP", step)
    monkeypatch.setattr(bound_curve, "_MOST", 600)
    case = epp.case("x15_flare")
    unstable = next(cycle for cycle in cycles_of("x15_flare") if not cycle.stable)
    branch = epp.continue_branch(case, "Kp", 1.5, 3.0, cycle=unstable, n_others=0)
    [limit] = branch.special
    found = first_turn(BoundProblem(case, "Kp", 1.5, 3.0), 1.5, unstable, -1.0)
    assert limit.kind == "linear limit" and found is not None and found.kind is Turn.LINEAR
    assert found.value == pytest.approx(limit.value, rel=1e-11)
