"""Families of cycles that end without a fold: a block on a belt slips for ever once its cycle ceases to stick.

The witness is the block's own equation, integrated by scipy: from where it lets go (spring and damping are just held
by the static friction) it swings back, and at the belt's speed that ends the family it just reaches it again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.exact import farthest_turn
from eppanalysis.methods.bounds.result import BoundCell, Finding, Known, Turn
from tests import made_bounds
from tests.shared import mostly_slow

#: The block and its friction (Veraszto and Stepan 2017, tables 1 and 2) [SI].
MASS, STIFFNESS, COULOMB, FADES, VISCOUS = 0.538, 6957.0, 2.0, 0.1, 0.2
_BELT = """
kind = "diagram"
title = "Block on a belt"
connect = ["block.speed - belt -> friction", "-friction -> block"]
signals = {{ x = {{ of = "block.position" }} }}
[parameters]
v = 0.22
[blocks]
block = {{ kind = "mass", mass = {mass}, damping = {damping}, stiffness = {stiffness}, start = [0.004, 0] }}
belt = {{ kind = "constant", value = "v" }}
[elements.friction]
element = "stribeck_friction"
coulomb = {coulomb}
static = {static}
velocity = {fades}
shape = 1
viscous = {viscous}
[run]
t_end = "5 s"
"""


def _belt(damping: float, static: float) -> epp.Case:
    numbers = {"mass": MASS, "stiffness": STIFFNESS, "coulomb": COULOMB, "fades": FADES, "viscous": VISCOUS}
    return epp.case_from_text(_BELT.format(damping=damping, static=static, **numbers), "belt")


def _last_to_stick(damping: float, static: float) -> float:
    """The belt's speed from which on the block does not come to stick again."""

    def short_of(belt: float) -> float:
        def rates(_: float, y: np.ndarray) -> list[float]:
            slip = belt - y[1]
            friction = COULOMB + (static - COULOMB) * np.exp(-slip / FADES) + VISCOUS * slip
            return [y[1], (friction - STIFFNESS * y[0] - damping * y[1]) / MASS]

        def fastest(t: float, y: np.ndarray) -> float:
            return rates(t, y)[1]

        fastest.direction = -1.0  # type: ignore[attr-defined]
        turn = 2.0 * np.pi * np.sqrt(MASS / STIFFNESS)
        start = [(static - damping * belt) / STIFFNESS, belt]
        run = solve_ivp(rates, (0.0, 1.6 * turn), start, "DOP853", events=fastest, rtol=1e-11, atol=1e-14)
        later = run.t_events[0] > 0.3 * turn
        return float(run.y_events[0][later][0, 1]) - belt

    return float(brentq(short_of, 0.2, 0.4, xtol=1e-12))


@pytest.mark.parametrize(
    ("damping", "static"), mostly_slow([(5.746, 6.0), (7.0, 6.0), (5.746, 7.0), (8.0, 7.0)], [(7.0, 6.0)])
)
def test_where_nothing_continues_a_branch_its_family_ends(damping, static):
    case = _belt(damping, static).with_values({"v": 0.21})
    cycle = epp.simulate(case).limit_cycle
    assert cycle is not None
    bound = farthest_turn(BoundProblem(case, "v", 0.2, 0.42), 0.21, [cycle], -1.0)
    assert bound is not None and bound.kind is Turn.BREAK
    # The branch is halved to a millionth of a step.
    assert bound.value == pytest.approx(_last_to_stick(damping, static), rel=1e-6)


@pytest.mark.slow
def test_the_bound_of_a_family_that_ends_without_a_fold_is_found_and_tested():
    found = epp.design_bounds(_belt(5.746, 6.0), "friction.static", "v", at=[7.0], starts=50)
    assert found.status is epp.Status.CONVERGED and found[0].verified
    assert found[0].exact == pytest.approx(_last_to_stick(5.746, 7.0), rel=1e-6)
    assert found[0].kind is Turn.BREAK and not found[0].elasticities


@pytest.mark.parametrize("finding", [f for f in Finding if f is not Finding.BOUND])
def test_what_was_not_found_is_not_said_to_be_none(finding):
    case = made_bounds.wheelchair()
    cell = BoundCell(0.9, finding, message=finding.sentence)
    other = BoundCell(1.0, Finding.BOUND, exact=0.01, safe_value=0.0099, verified=True)
    alone, among = (made_bounds.bounds_of(case, "loop.gain", "play.gap", *cells) for cells in ([cell], [cell, other]))
    is_open = finding in (Finding.UNSURE, Finding.FAILED)
    assert str(alone).startswith("Undecided: no bound on play gap was found" if is_open else "No bound on play gap")
    said = "undecided at 1 of 2 values" if is_open else "no bound at 1 of 2 values"
    assert said in str(among)
    assert (alone.status is epp.Status.UNDECIDED) == is_open and alone[0].known is Known.NONE


@pytest.mark.slow
def test_the_range_that_is_looked_in_ends_where_the_case_ceases_to_be_valid():
    """Friction at rest is at least that of sliding, 2 lbf; the bound lies a hair above, and was called none."""
    case = epp.case_from_text(
        """
kind = "diagram"
title = "slider on a belt"
connect = ["mass.speed - belt -> rub", "-rub -> mass"]
signals = { x = { of = "mass.position", unit = "in" } }
[parameters]
v = "20 mm/s"
fs = "3 lbf"
[blocks]
mass = { kind = "mass", mass = "2 lb", damping = "1 N*s/m", stiffness = "800 N/m" }
belt = { kind = "constant", value = "v" }
[elements]
rub = { element = "friction", coulomb = "2 lbf", static = "fs" }
[run]
t_end = "8 s"
""",
        name="slider",
    )
    found = epp.design_bounds(case, "v", "fs", at=["20 mm/s"], verify=False)
    lbf = case.si("fs", "1 lbf")
    assert found.within[0] == pytest.approx(2.0 * lbf, rel=2e-3)
    assert "fs of 2.06 lbf" in str(found)


@pytest.mark.slow
def test_cycles_that_describing_functions_alone_see_do_not_go_on_to_the_end_of_the_range():
    """A gap in a loop that its integral part destabilises: exact cycles at 1.36, and beyond the linear limit at 1.98
    motions grow or rest, where describing functions go on to see a cycle.
    """
    servo = epp.Diagram(
        parts={
            "controller": epp.blocks.PI(kp=2.85, ti=0.75),
            "plant": epp.blocks.TransferFunction(num=[0.376], den=[1.0, 1.23, 1.96, 0.48]),
            "gear": epp.Play(gap=0.7),
        },
        connect=["-gear -> controller", "controller -> plant", "plant -> gear"],
    )
    case, high = epp.Case.from_system(servo, name="servo"), 10.0
    (cell,) = epp.design_bounds(case, "gear.gap", "controller.kp", at=[0.7], within=(0.3, high), verify=False)
    at_end = case.with_values({"controller.kp": high}).to_system()
    ends = {epp.simulate(replace(at_end, x0=size * at_end.x0), t_end=100.0).status.name for size in (0.1, 1.0, 10.0)}
    assert ends <= {"SETTLED", "DIVERGED"} and epp.predict_limit_cycles(at_end), ends
    assert cell.finding is Finding.FAILED and "cycles exist" not in cell.message, cell.message
    assert "no limit cycle at 0.3, " in cell.message and "10, and limit cycles at" in cell.message
