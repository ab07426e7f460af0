"""One limit, one number: rounded to the side on which it holds, the same in title, table, sentence and picture."""

from __future__ import annotations

import dataclasses
import math
import re
from decimal import Decimal

import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.guides.manual import in_steps, limit_grid
from eppanalysis.guides.result import Guide, GuideRow
from eppanalysis.limits import Limit, Printed, cut
from eppanalysis.methods.bounds.result import BoundCell
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import for_people
from eppanalysis.tables.designs import bounds_table
from tests.made_bounds import bounds_of

DEGREE, LBF = math.pi / 180.0, 4.4482216152605
#: Limits on a backlash [deg]: the fold of the original elbow, and others whose nearest four digits are not safe.
FOLDS = (0.978586853, 4.49575021, 0.0123456789, 11.99999)
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")


def bounds(*degrees: float, sign: float = 1.0) -> epp.DesignBounds:
    """Bounds on the elbow's backlash, tested a per cent inside."""
    cells = [
        BoundCell((2.5 + i) * LBF, "bound", sign=sign, exact=d * DEGREE, safe_value=(1.0 - 0.01 * sign) * d * DEGREE,
                  n_runs=100, verified=True, frequency=5.0)
        for i, d in enumerate(degrees)
    ]  # fmt: skip
    return bounds_of(epp.case("fig8a_original"), "bands.range", "lock_pin.backlash", *cells)


def guide(*degrees: float, sign: float = 1.0) -> Guide:
    """The same bounds as a guideline."""
    case = epp.case("fig8a_original")
    radius, stiffness = case.value("pulley.radius"), case.value("cable.stiffness")
    rows = [
        GuideRow({"bands.range": cell.value}, cell, cell.bound, radius * cell.bound, radius * stiffness * cell.bound,
                 None, math.nan, 2.5 * DEGREE, math.nan)
        for cell in bounds(*degrees, sign=sign)
    ]  # fmt: skip
    return Guide(case, "bands.range", "lock_pin.backlash", (), tuple(rows), {}, provenance=Provenance("guide"))


def numbers_near(text: str, degrees: float) -> set[float]:
    """The numbers of a text that are about a limit: within a twentieth of it."""
    found = (float(match) for match in NUMBER.findall(re.sub(r"\d+ of \d+ bounds?", "", text)))
    return {value for value in found if abs(value / degrees - 1.0) < 0.05}


def console(table) -> str:
    """The cells of a table of the console."""
    return " ".join(cell for column in table.columns for cell in column._cells)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["free below", "free above"])
@pytest.mark.parametrize("fold", FOLDS)
def test_a_limit_is_one_number_wherever_it_is_printed(fold: float, sign: float) -> None:
    """That of the manual, and in brackets the exact one; no other, and none beyond the fold."""
    found, made = bounds(fold, sign=sign), guide(fold, sign=sign)
    printed = float(str(epp.manual_table(found).rows[0][1]))
    exact = float(f"{cut(fold, 4, up=sign < 0):.4g}")
    assert sign * (fold - printed) > 0 and sign * (fold - exact) >= 0
    heads = (made.plot().figure.texts, found.plot().figure.texts)
    texts = {
        "sentence of bounds": str(found),
        "console of bounds": console(bounds_table(found)),
        "notebook of bounds": for_people(found.in_brief()).to_string(),
        "title of bounds": " ".join(text.get_text() for text in heads[1]),
        "sentence of the guideline": str(made),
        "sentences of the guideline": " ".join(made.sentences()),
        "table of the guideline": made.rounded().to_string(),
        "title of the guideline": " ".join(text.get_text() for text in heads[0]),
        "grid of the guideline": str(limit_grid(made)[2]),
        "manual of the guideline": " ".join(str(cell) for cell in epp.manual_table(made).rows[0][1:2]),
    }
    for where, text in texts.items():
        said = numbers_near(text, fold)
        assert printed in said, where
        assert said <= {printed, exact}, where
    assert numbers_near(str(found), fold) == numbers_near(str(made), fold) == {printed, exact}
    computed = float(str(epp.manual_table(found).rows[0][2]))
    assert sign * (fold - computed) >= 0


@pytest.mark.parametrize("step", [0.05, 0.02])
def test_a_step_that_is_asked_for_is_that_of_every_number(step: float) -> None:
    made = in_steps(guide(*FOLDS[:2]), step)
    printed = [float(Decimal(str(step)) * math.floor(0.99 * fold / step)) for fold in FOLDS[:2]]
    assert [float(str(row[1])) for row in epp.manual_table(made).rows] == pytest.approx(printed)
    assert made.rounded()["largest backlash [deg]"].astype(float).tolist() == pytest.approx(printed)
    assert [float(row[0]) for row in limit_grid(made)[2]] == pytest.approx(printed)
    for fold, said, value in zip(FOLDS, made.sentences(), printed, strict=False):
        assert value in numbers_near(said, fold)
    assert f"{printed[0]:.2f} deg" in str(made)


def test_a_mixture_of_sides_is_said_with_both() -> None:
    below, above = bounds(0.9785).cells[0], bounds(1.4, sign=-1.0).cells[0]
    both = dataclasses.replace(bounds(0.9785), cells=(below, above))
    assert " below or above " in str(both) and "0.96 deg to 1.42 deg (exact 0.9785 deg to 1.4 deg)" in str(both)


@given(st.floats(-1e6, 1e6), st.booleans(), st.floats(1e-3, 0.2), st.sampled_from([1.0, 180.0 / math.pi, 1e3, 0.22481]))
def test_what_is_printed_is_on_the_safe_side_of_what_was_tested_and_gives_away_little(
    value: float, above: bool, margin: float, factor: float
) -> None:
    side = -1.0 if above else 1.0
    limit = Limit(value, above, value - side * margin * abs(value))
    printed = Printed.of([limit], ("", factor))
    found, scale = float(printed.number(limit)), factor * abs(limit.safe)
    assert side * (factor * limit.safe - found) >= -1e-8 * scale
    assert side * (factor * limit.safe - found) <= 0.02 * max(scale, 1.0 if not scale else 0.0) + 1e-300
    computed = float(printed.figures(limit))
    assert side * (factor * value - computed) >= -1e-8 * abs(factor * value)


def test_a_fold_is_rounded_to_the_side_without_its_cycles() -> None:
    """The branch over the gain of the wheelchair folds at 0.84625722: "0.8463" would be among its cycles."""
    branch = epp.continue_branch(epp.case("wheelchair").with_values({"loop.gain": 1.0}), "loop.gain", 1.0, 0.6)
    (fold,) = branch.folds
    assert branch.lies_above(fold) and float(branch.place(fold)) <= fold.value
    for number in numbers_near(str(branch), fold.value):
        assert number <= fold.value
