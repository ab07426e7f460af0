"""Guidelines with a limit cycle that is allowed: a published amplitude, words, files, other units."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.guides.beyond import own_runs, smallest_trigger
from eppanalysis.guides.result import Region
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from tests import made_bounds
from tests.shared import said_above

#: Amplitude of the cycle of `backlash_servo` at its gap of 2, as published; all its cycles scale with the gap.
_AMPLITUDE = 1.959706261794195
_LARGER = "stable limit cycle larger than allowed (x 0.5 peak to peak)"


@pytest.fixture(scope="module")
def servo() -> epp.Case:
    return epp.case("backlash_servo")


@pytest.fixture(scope="module")
def guide(servo: epp.Case) -> epp.Guide:
    return epp.design_guide(servo, [1.0], over="loop.gain", limit="play.gap", allow="x 0.5", starts=40)


def test_the_limit_is_that_of_the_published_amplitude(guide: epp.Guide) -> None:
    (row,) = guide.rows
    gap = 2.0 * 0.5 / (2.0 * _AMPLITUDE)
    assert row.allowed == pytest.approx(gap, rel=1e-9)
    assert row.cell.kind is Turn.SIZE and row.cell.verified and row.cell.n_settled == 40
    # The case's own run is on that cycle: it exceeds what is allowed from the limit on, to the steps of the runs.
    assert row.from_rest == pytest.approx(gap, rel=0.05) and row.from_rest >= gap * (1.0 - 1e-9)
    assert row.region is Region.RUNS and not row.within


@pytest.mark.slow
def test_at_the_limit_the_exact_cycle_has_the_rms_that_is_allowed(servo: epp.Case) -> None:
    text = "x 0.1 rms"
    guide = epp.design_guide(servo, [1.0], over="loop.gain", limit="play.gap", allow=text, starts=20, within=(0.05, 1))
    (row,) = guide.rows
    there = epp.find_limit_cycles(servo.with_values({"play.gap": row.allowed})).stable[0]
    assert Allowed.read(servo.to_system(), text).size_of(there) == pytest.approx(0.1, rel=1e-6)
    assert row.cell.verified and "size at the limit" in guide.to_frame()


def test_what_is_allowed_is_named_in_sentences_and_tables(guide: epp.Guide) -> None:
    (limit,) = guide.rounded()["largest play gap"]  # the sentence and the table give it in the same digits
    kept = f"Keep play gap under {limit} (exact 0.2551), at a loop gain of 1, with x 0.5 peak to peak allowed"
    assert str(guide).startswith(kept)
    told = guide.sentences()
    assert told[0].endswith("This case has 2: its own run ends in an oscillation larger than allowed.")
    assert told[-1] == "Allowed is a stable limit cycle up to x 0.5 peak to peak."
    frame = guide.to_frame()
    assert frame["allowed"].tolist() == ["x 0.5 peak to peak"] and frame["what limits"].tolist() == ["allowed size"]
    assert frame["size at the limit"].tolist() == pytest.approx([0.5], rel=1e-9)
    assert "own run exceeds it above" in frame and "own run oscillates above" not in frame
    plain = guide.to_dict()
    assert plain["allowed"]["size"] == 0.5 and plain["provenance"]["settings"]["allowed"]["signal"] == "x"


def test_a_cycle_that_is_born_larger_is_said(guide: epp.Guide) -> None:
    cycle = epp.predict_limit_cycles(guide.case)[0]
    cell = dataclasses.replace(guide.rows[0].cell, kind=Turn.FOLD, size=0.7, orbit=cycle)
    told = dataclasses.replace(guide, rows=(dataclasses.replace(guide.rows[0], cell=cell),)).sentences()[0]
    assert told.endswith("the cycle is born with x 0.7 peak to peak, more than is allowed (x 0.5 peak to peak).")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"rests_to": 3.0, "from_rest": math.nan},
            "it stays within what is allowed unless struck; an oscillation larger",
        ),
        ({"rests_to": math.nan, "from_rest": math.nan}, "and may oscillate more than is allowed."),
        ({"own": 0.2}, "Its own 0.2 is within it."),
    ],
)
def test_what_the_case_itself_does(guide: epp.Guide, changed: dict[str, float], words: str) -> None:
    row = dataclasses.replace(guide.rows[0], **changed)
    assert words in dataclasses.replace(guide, rows=(row,)).sentences()[0]


def test_the_picture_says_it(guide: epp.Guide) -> None:
    figure = guide.plot().figure
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert named[:2] == ["no oscillation larger than allowed", "exceeds what is allowed in its own run"]
    assert "with x 0.5 peak to peak allowed" in said_above(figure)[0].replace("\n", " ")


@pytest.mark.parametrize("ending", [".md", ".html", ".tex", ".csv"])
def test_files_name_it(guide: epp.Guide, ending: str, tmp_path: Path) -> None:
    guide.write(tmp_path / f"guide{ending}")
    text = (tmp_path / f"guide{ending}").read_text(encoding="utf-8")
    assert ending == ".csv" or f"without a {_LARGER}" in text
    assert "without a limit cycle" not in text and "x 0.5 peak to peak" in text


def test_sheets_and_documents_name_it(guide: epp.Guide, tmp_path: Path) -> None:
    openpyxl, docx = pytest.importorskip("openpyxl"), pytest.importorskip("docx")
    for name in ("guide.xlsx", "guide.docx"):
        guide.write(tmp_path / name)
    heads = [cell.value for cell in openpyxl.load_workbook(tmp_path / "guide.xlsx")["guideline"][1]]
    assert {"allowed", "what limits", "size at the limit"} <= set(heads)
    document = docx.Document(str(tmp_path / "guide.docx"))
    texts = " ".join(p.text for p in document.paragraphs)
    assert f"without a {_LARGER}" in texts and "Allowed is a lasting oscillation up to x 0.5 peak to peak." in texts


def test_the_table_for_a_manual_holds_nothing_of_rest_alone(guide: epp.Guide) -> None:
    beyond = tuple(dataclasses.replace(row, rests_to=1.1 * row.cell.bound) for row in guide.rows)
    text = str(epp.manual_table(dataclasses.replace(guide, rows=beyond)))
    assert "Within what is allowed unless struck up to" in text and "Rests unless struck" not in text
    assert "came to rest or stayed within what is allowed and no oscillation larger than that was found" in text
    assert "| Loop gain 1 | 0.250 |" in text


def test_the_table_of_bounds_says_so_too(servo: epp.Case) -> None:
    cell = BoundCell(1.0, Finding.BOUND, exact=0.2551, safe_value=0.2526, n_runs=20, verified=True, frequency=0.25)
    bounds = made_bounds.bounds_of(servo, "loop.gain", "play.gap", cell)
    sized = dataclasses.replace(bounds, allowed=Allowed("x", 0.5))
    # Tested at 0.2526 and printed in steps of 0.005.
    assert str(bounds).startswith("Free of limit cycles below a play gap of 0.250 (exact 0.2551),")
    assert str(sized).startswith(f"No {_LARGER} below a play gap of 0.250 (exact 0.2551),")
    assert f"without a {_LARGER}" in str(epp.manual_table(sized))


def test_other_units_of_what_is_allowed_give_the_same() -> None:
    """In degrees and in radians, by the case's own run beyond a bound."""
    case = epp.case("fig8a_original")
    question = BoundProblem(case, "lock_pin.backlash", math.radians(0.9), math.radians(3.0))
    found = [
        own_runs(question, math.radians(1.5), 1.0, Allowed.read(case.to_system(), text))
        for text in ("theta 4 deg", f"theta {math.radians(4.0)!r} rad")
    ]
    assert found[0] == found[1]
    # The docs' bound for 4 deg is 2.304 deg; the own run is on the cycle that the bound is of.
    assert math.degrees(found[0].oscillates_from) == pytest.approx(2.304, rel=2e-3)
    assert math.degrees(found[0].rests_to) == pytest.approx(2.304, rel=2e-2)


@pytest.mark.slow
def test_a_step_is_told_where_all_cycles_are_too_large() -> None:
    """The elbow's only stable cycle has 4.39 deg: the step that starts it counts beside 4 deg, not beside 5 deg."""
    case = epp.case("fig8a_original")
    question, system = BoundProblem(case, "lock_pin.backlash", 0.001, 0.1), case.to_system()
    own = case.value("lock_pin.backlash")
    known, small, large = (
        smallest_trigger(question, own, None if text is None else Allowed.read(system, text))
        for text in (None, "theta 4 deg", "theta 5 deg")
    )
    assert known is not None and small is not None and large is None
    assert small.size == known.size


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"tolerances": {"loop.gain": "5 %"}}, "tolerances is given beside allow"),
        ({"prove": True}, "prove is given beside allow"),
        ({"allow": "theta 3 deg"}, "the loop has no signal 'theta'"),
    ],
)
def test_what_is_of_all_cycles_is_refused(servo: epp.Case, given: dict[str, object], words: str) -> None:
    asked: dict[str, object] = {"over": "loop.gain", "limit": "play.gap", "allow": "x 0.5", **given}
    with pytest.raises(epp.EppError, match=words):
        epp.design_guide(servo, [1.0], **asked)  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_command_takes_it() -> None:
    asked = ["guide", "backlash_servo", "--over", "loop.gain", "--limit", "play.gap", "--gains", "1", "--workers", "1"]
    done = CliRunner().invoke(app, [*asked, "--within", "0.1..1", "--allow", "x 0.5", "--starts", "20"])
    assert done.exit_code == 0, done.output
    assert f"without a {_LARGER}" in " ".join(done.output.split())
