"""The paper's advice: elasticities against folds of moved branches, triggers against runs of steps on both sides."""

from __future__ import annotations

import math
import re

import pytest

import eppanalysis as epp
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.design import Settings, bound_of_branch
from studies import STORED
from studies.advice import (
    ADVICE,
    AdviceRow,
    _joined,
    _word,
    advice_frame,
    advice_of,
    advice_sentences,
    design_advice,
    with_mass,
)
from tests.made_bounds import bounds_of

#: The original elbow with its original pulley at a profile range of 1.5 lbf.
FRICTION, GAIN = 0.0526, "1.5 lbf"
LIMIT, WITHIN = "lock_pin.backlash", (0.1 * math.pi / 180.0, 3.0 * math.pi / 180.0)


@pytest.fixture(scope="module")
def case() -> epp.Case:
    given = epp.case("fig8a_original").with_values({"pulley.friction": FRICTION, "bands.range": GAIN})
    return with_mass(given)


@pytest.fixture(scope="module")
def cycle(case: epp.Case) -> epp.LimitCycle:
    """The stable one at half a degree, beyond the bound."""
    beyond = case.with_values({LIMIT: "0.5 deg"})
    return epp.find_limit_cycles(beyond).stable[-1]


@pytest.fixture(scope="module")
def bounds(case: epp.Case, cycle: epp.LimitCycle) -> epp.DesignBounds:
    """The bound at one gain, from the branch that ends there."""
    branch = epp.continue_branch(case, LIMIT, "0.5 deg", "0.3 deg", cycle=cycle, max_step=0.05)
    cell = bound_of_branch(
        BoundProblem(case, LIMIT, *WITHIN), case.value("bands.range"), branch, Settings(verify=False)
    )
    assert cell is not None
    return bounds_of(case, "bands.range", LIMIT, cell)


@pytest.fixture(scope="module")
def rows(case: epp.Case, bounds: epp.DesignBounds) -> dict[str, AdviceRow]:
    found = advice_of(case, bounds)
    assert [r.words for r in found] == [words for words, _, _ in ADVICE]
    return {r.parameter: r for r in found}


@pytest.mark.slow
def test_the_mass_is_what_the_shell_leaves_of_the_inertia(case: epp.Case) -> None:
    assert case.value("forearm.prehensor_mass") == pytest.approx(0.45)


@pytest.mark.slow
def test_elasticities_against_folds_of_moved_cases(
    case: epp.Case, cycle: epp.LimitCycle, bounds: epp.DesignBounds, rows: dict[str, AdviceRow]
) -> None:
    """Slopes from the equations of one fold against folds of branches that are followed anew."""
    h = 2e-3
    assert bounds[0].kind == "fold"
    for name, direction in (("pulley.friction", -1), ("bands.range", 1)):
        moved = []
        for share in (-h, h):
            here = case.with_values({name: case.value(name) * (1.0 + share)})
            branch = epp.continue_branch(here, LIMIT, "0.5 deg", "0.4 deg", cycle=cycle, max_step=0.05)
            moved.append(min(f.value for f in branch.folds))
        slope = (math.log(moved[1]) - math.log(moved[0])) / (2 * h)
        assert rows[name].gained == pytest.approx(direction * slope, rel=1e-3, abs=1e-4), name
        assert rows[name].traded == pytest.approx(rows[name].gained / rows["bands.range"].gained)
    assert rows[LIMIT].traded == pytest.approx(1.0 / rows["bands.range"].gained)


@pytest.mark.slow
def test_triggers_part_runs_that_settle_from_runs_that_do_not(case: epp.Case, rows: dict[str, AdviceRow]) -> None:
    size = rows["bands.range"].trigger
    ends = [epp.simulate(case.to_system(), epp.inputs.Step(s * f * size), 20.0).status.name
            for f in (0.97, 1.03) for s in (1.0, -1.0)]  # fmt: skip
    assert ends[:2] == ["SETTLED", "SETTLED"] and "LIMIT_CYCLE" in ends[2:]


@pytest.mark.slow
def test_the_model_bears_out_less_than_the_paper_says(rows: dict[str, AdviceRow]) -> None:
    """Of an elbow beyond its bound: a softer cable helps, less backlash is of no use, less friction does harm."""
    assert rows["cable.stiffness"].verdict == rows["cable.stiffness"].trigger_verdict == "strong"
    assert rows[LIMIT].trigger_gained == pytest.approx(0.0, abs=1e-4)
    assert rows["pulley.friction"].gained > 0 > rows["pulley.friction"].trigger_gained
    said = {s.partition(":")[0]: s for s in advice_sentences(list(rows.values()))}
    assert "does nothing for the step" in said["Less backlash"]
    assert "does not bear the advice out for the step" in said["Less pulley friction"]


@pytest.mark.slow
def test_frame_shows_what_is_not_applicable(case: epp.Case, rows: dict[str, AdviceRow]) -> None:
    frame = advice_frame(case, list(rows.values()))
    assert frame["profile range [lbf]"].unique().tolist() == ["1.5"]
    assert frame["bound grows [%]"][0] == "–"
    assert frame["on the bound"][2] == "strong"


@pytest.mark.parametrize(
    ("elasticity", "word"),
    [(0.6, "strong"), (0.2, "moderate"), (0.05, "weak"), (0.0, "none"), (-0.1, "the other way"),
     (math.inf, "ends the oscillation"), (math.nan, "not known")],
)  # fmt: skip
def test_words(elasticity: float, word: str) -> None:
    assert _word(elasticity) == word


def test_verdicts_are_told_in_the_order_of_their_numbers() -> None:
    grown = [0.6, -0.1, math.inf, 0.05, math.nan, 0.2, 0.05, 0.0]
    assert _joined(map(_word, grown)) == "the other way, none, weak, moderate, strong, ends the oscillation"
    stored = (STORED / "advice.md").read_text(encoding="utf-8")
    for told in re.findall(r"% \(([^)]*)\)", stored):
        assert told == _joined(told.split(", "))


@pytest.mark.slow
def test_only_elbows_with_a_prehensor() -> None:
    with pytest.raises(epp.EppError, match="expected a case of the elbow"):
        design_advice(epp.case("backlash_servo"), ["2 lbf"])
    bare = epp.case("fig8a_original").with_values({"forearm.inertia": "0.006 kg*m^2"})
    with pytest.raises(epp.EppError, match="so that a prehensor is left"):
        design_advice(bare, ["2 lbf"])
