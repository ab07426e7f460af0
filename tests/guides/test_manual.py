"""Tables for manuals: five columns, every limit on the safe side, read back by the readers of each format."""

from __future__ import annotations

import gc
import json
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas
import pytest
from hypothesis import given, strategies as st
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.errors import EppError
from eppanalysis.guides.result import Guide, GuideRow
from eppanalysis.limits import drawing_step, to_step
from eppanalysis.methods.bounds.result import BoundCell, Finding
from eppanalysis.methods.bounds.tolerances.result import Quantile
from eppanalysis.results.provenance import Provenance
from eppanalysis.tables.manual import MANUALS
from tests.made_bounds import bounds_of
from tests.shared import mostly_slow

PAIR = ("bands.range", "lock_pin.backlash")
LBF, DEGREE = 4.4482216152605, np.pi / 180.0
BAD = '=HYPERLINK("x") <b>50 % & more</b> \\input{x} a|b'


def cell(gain: float, bound: float, **more) -> BoundCell:
    tested = {"safe_value": 0.99 * bound * DEGREE, "n_runs": 1000, "verified": True, "frequency": 8.123456}
    return BoundCell(gain * LBF, "bound", exact=bound * DEGREE, **{**tested, **more})


@pytest.fixture
def bounds() -> epp.DesignBounds:
    none = BoundCell(4.0 * LBF, Finding.NONE)
    cells = (cell(2.5, 0.98), cell(3.0, 1.1677, verified=False), none)
    return bounds_of(epp.case("fig8a_original"), "bands.range", "lock_pin.backlash", *cells)


@pytest.fixture
def guide() -> Guide:
    case = replace(epp.case("fig8a_original"), title=BAD)
    radius, stiffness = case.value("pulley.radius"), case.value("cable.stiffness")
    rows = []
    for gain, bound in ((1.5, 0.6), (2.5, 0.98)):
        allowed = bound * DEGREE
        forces = (allowed, radius * allowed, stiffness * radius * allowed)
        rows.append(GuideRow({"bands.range": gain * LBF}, cell(gain, bound), *forces, None, 0.02, 0.04, 0.001))
    return Guide(
        case,
        "bands.range",
        "lock_pin.backlash",
        (),
        tuple(rows),
        {},
        provenance=Provenance("guide", case=case.provenance()),
    )


def test_five_columns_rounded_down_from_where_the_design_was_tested(guide):
    table = epp.manual_table(guide)
    assert len(table.columns) == 5 and all(len(row) == 5 for row in table.rows)
    # 99 % of 0.6 deg and of 0.98 deg are 0.594 deg and 0.9702 deg; 2 % of the first is 0.0119 deg.
    assert [row[:2] for row in table.texts()] == [("Profile range 1.5 lbf", "0.59"), ("Profile range 2.5 lbf", "0.97")]
    radius = 1e3 * guide.case.value("pulley.radius")
    for row, tested in zip(table.rows, (0.594, 0.9702), strict=True):
        assert float(row[2]) <= radius * tested * DEGREE < float(row[2]) + 0.005
    assert "in steps of 0.01 deg, 0.002 mm, 0.005 lbf" in table.notes[0]
    assert not any(re.search(r"[{}\[\]]|sha256", note) for note in table.notes)


def test_a_step_of_the_drawing_is_kept(guide):
    table = epp.manual_table(guide, 0.05)
    assert [row[1] for row in table.texts()] == ["0.55", "0.95"]
    assert "in steps of 0.05 deg" in table.notes[0]


def test_tolerances_and_factors_of_safety_are_taken_off(guide):
    worst = epp.ToleranceBound(
        "lock_pin.backlash", "rad", ("deg", 1.0 / DEGREE), 1.0, {}, 0.6 * DEGREE, 0.5 * DEGREE, {}, 0,
        (Quantile(0.95, 0, 0, 0),), np.zeros(0), 0.0,
    )  # fmt: skip
    rows = tuple(replace(row, tolerance=worst, allowed=row.allowed / 2, pulley=row.pulley / 2) for row in guide.rows)
    table = epp.manual_table(replace(guide, rows=rows, margins={"lock_pin.backlash": 2.0}), 0.01)
    assert table.columns[3] == "Backlash with all tolerances used up, at most [deg]"
    assert [row[1] for row in table.texts()] == ["0.30", "0.49"]
    assert [row[3] for row in table.texts()] == ["0.25", "0.25"]
    assert "Factors of safety that are taken off already: 2 on lock pin backlash." in table.notes


def test_margins_are_taken_off_what_tolerances_leave(guide):
    worst = epp.ToleranceBound(
        "lock_pin.backlash", "rad", ("deg", 1.0 / DEGREE), 1.0, {}, 0.6 * DEGREE, 0.5 * DEGREE, {}, 0,
        (Quantile(0.95, 0.54 * DEGREE, 0.52 * DEGREE, 0.56 * DEGREE),), np.zeros(0), 0.0,
    )  # fmt: skip
    rows = tuple(replace(row, tolerance=worst) for row in guide.rows)
    plain = replace(guide, rows=rows)
    halved = replace(plain, margins={"lock_pin.backlash": 2.0, "bands.range": 1.5})
    for name, whole in (("worst case", 0.5), ("95 %", 0.54), ("95 % from", 0.52), ("95 % to", 0.56)):
        assert list(plain.to_frame()[f"{name} [deg]"]) == pytest.approx([whole] * len(rows))
        assert list(halved.to_frame()[f"{name} [deg]"]) == pytest.approx([whole / 2] * len(rows))
    assert "margins taken off" not in plain.to_frame()
    said = "a factor of 2 on backlash, a factor of 1.5 on profile range"
    assert set(halved.to_frame()["margins taken off"]) == {said}
    assert "under 0.25 deg where every tolerance is used up" in halved.sentences()[0]
    assert halved.sentences()[-1] == (
        "Taken off every bound, also where tolerances are used up: a factor of 2 on backlash and a factor of 1.5 on "
        "profile range."
    )
    assert len(plain.sentences()) == len(rows)


def test_what_is_not_checked_and_what_has_no_bound_says_so(bounds):
    table = epp.manual_table(bounds)
    assert [row[-1] for row in table.texts()][:2] == ["yes, 1000 simulations", "no"]
    assert table.texts()[2][1:4] == ("-", "-", "-") and table.texts()[2][4] == Finding.NONE.sentence
    assert "1 of 2 limits is not checked: do not use it without a test." in table.notes
    assert "from the case fig8a_original." in table.notes[-1]
    assert table.texts()[0] == ("2.5", "0.97", "0.980", "8.1", "yes, 1000 simulations")


def test_a_limit_from_below_is_rounded_up(bounds):
    above = cell(2.5, 0.98, sign=-1.0, safe_value=0.9898 * DEGREE)
    table = epp.manual_table(replace(bounds, cells=(above,)))
    assert "at least" in table.columns[1] and table.texts()[0][1] == "0.99" and "rounded up" in table.notes[0]
    with pytest.raises(EppError, match="one side for all"):
        epp.manual_table(replace(bounds, cells=(above, *bounds.cells)))


def test_what_is_rounded_is_said_to_be_tested_only_where_it_was(bounds):
    note = epp.manual_table(bounds).notes[0]
    assert note.startswith(
        "Lock pin backlash, at most: as tested on the safe side of the computed limit, rounded down,"
    )
    untested = replace(bounds, cells=tuple(replace(cell, safe_value=np.nan) for cell in bounds.cells))
    table = epp.manual_table(untested)
    assert "tested" not in table.notes[0] and "as computed, rounded down" in table.notes[0]
    assert float(table.texts()[0][1]) > 0.97  # of the bound itself


@given(st.floats(1e-6, 1e6), st.sampled_from(["1", "0.05", "0.002", "0.25", "2E+1"]), st.booleans())
def test_rounding_is_safe_and_loses_less_than_a_step(value, text, up):
    step = Decimal(text)
    found = float(to_step(value, step, up=up))
    lost = found - value if up else value - found
    assert -1e-8 * float(step) - 1e-12 * value <= lost < float(step)
    assert Decimal(str(to_step(value, step, up=up))) % step == 0


@given(st.lists(st.floats(1e-6, 1e6), min_size=1))
def test_the_chosen_step_gives_away_two_per_cent_at_most(values):
    step = float(drawing_step(values))
    assert 0.02 * min(values) / 2.500001 < step <= 0.02 * min(values) * (1 + 1e-9)


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), 5.0])
def test_a_step_that_cannot_be_is_refused(bounds, step):
    with pytest.raises(EppError, match="manual_table: step is .*; expected"):
        epp.manual_table(bounds, step)


def test_a_step_on_the_command_line_is_called_by_its_option_in_its_unit(monkeypatch, bounds, tmp_path: Path):
    monkeypatch.setattr("eppanalysis.methods.bounds.design.design_bounds", lambda *_, **__: bounds)
    command = ["bounds", "fig8a_original", "--over", "bands.range", "--limit", "lock_pin.backlash"]
    manual = [*command, "--manual", str(tmp_path / "b.md"), "--step"]
    larger = CliRunner().invoke(app, [*manual, "1.5 deg", "--json"])
    assert larger.exit_code == 2 and not (tmp_path / "b.md").exists()
    assert re.fullmatch(r"--step is 1.5 deg; expected at most the smallest bound, [\d.]+ deg\.\n", larger.stderr)
    assert json.loads(larger.stdout)["cases"]  # what was computed is shown all the same
    other = CliRunner().invoke(app, [*manual, "1 N"])
    assert other.exit_code == 2
    assert other.stderr.startswith("--step: lock_pin.backlash is '1 N'; expected an angle")


@pytest.mark.parametrize(
    "finding", mostly_slow([f for f in Finding if f is not Finding.BOUND], [Finding.ALWAYS, Finding.NONE])
)
def test_no_bound_is_an_answer_that_is_written_in_every_file(monkeypatch, bounds, tmp_path: Path, finding):
    """Manual, picture and table say why, and the exit code is 0: "always" ended in code 2 without a manual."""
    none = replace(bounds, cells=(BoundCell(4.0 * LBF, finding), BoundCell(5.0 * LBF, finding)))
    table = epp.manual_table(none)
    assert [row[1:] for row in table.texts()] == [("-", "-", "-", finding.sentence)] * 2
    assert table.notes[0] == "There is no limit to print; the last column gives the reason."
    monkeypatch.setattr("eppanalysis.methods.bounds.design.design_bounds", lambda *_, **__: none)
    command = ["bounds", "fig8a_original", "--over", "bands.range", "--limit", "lock_pin.backlash"]
    for ending in (".png", ".csv", ".nc"):
        files = ["-o", str(tmp_path / f"b{ending}"), "--manual", str(tmp_path / "b.md"), "--step", "0.1 deg"]
        done = CliRunner().invoke(app, [*command, *files])
        assert done.exit_code == 0, done.output
        assert (tmp_path / f"b{ending}").stat().st_size > 100
        assert finding.sentence in (tmp_path / "b.md").read_text()
        (tmp_path / "b.md").unlink()


def test_a_guideline_without_a_limit_is_written_too(guide, tmp_path: Path):
    rows = tuple(
        replace(row, cell=BoundCell(row.cell.value, Finding.ALWAYS), allowed=np.nan, pulley=np.nan, force=np.nan)
        for row in guide.rows
    )
    none = replace(guide, rows=rows)
    assert {row[1] for row in epp.manual_table(none).texts()} == {"-"}
    for ending in (".png", ".md", ".csv", ".html", ".tex", ".xlsx"):
        none.write(tmp_path / f"g{ending}")
        assert (tmp_path / f"g{ending}").stat().st_size > 100


@pytest.mark.parametrize("ending", MANUALS)
def test_every_format_is_written_whole(guide, tmp_path: Path, ending):
    path = tmp_path / f"guide{ending}"
    epp.manual_table(guide).write(path)
    assert path.stat().st_size > 300 and [p.name for p in tmp_path.iterdir()] == [path.name]


def test_excel_holds_numbers_with_their_decimals_and_no_formula(guide, tmp_path: Path):
    import openpyxl

    epp.manual_table(guide).write(tmp_path / "g.xlsx")
    sheet = openpyxl.load_workbook(tmp_path / "g.xlsx").active
    assert [c.value for c in sheet["B"]][2:4] == [0.59, 0.97]
    assert sheet["B3"].number_format == "0.00" and sheet["C3"].number_format == "0.000"
    assert all(c.font.bold and c.alignment.wrap_text for c in sheet[2])
    assert all(c.data_type != "f" for row in sheet.iter_rows() for c in row)
    # A mark that keeps a text from being run would stand in the cell for all to see; a text needs none.
    assert [[c.value for c in row if isinstance(c.value, str)] for row in sheet.iter_rows(min_row=3, max_row=4)] == [
        [text for text, cell in zip(texts, row, strict=True) if isinstance(cell, str)]
        for texts, row in zip(epp.manual_table(guide).texts()[:2], epp.manual_table(guide).rows[:2], strict=True)
    ]
    assert sheet["A1"].value == epp.manual_table(guide).title
    frame = pandas.read_excel(tmp_path / "g.xlsx", header=1, nrows=2)
    assert frame.columns[1] == "Backlash at the elbow, at most [deg]"


def test_word_holds_the_table_with_bold_headings_that_repeat(guide, tmp_path: Path):
    docx = pytest.importorskip("docx")
    epp.manual_table(guide).write(tmp_path / "g.docx")
    document = docx.Document(str(tmp_path / "g.docx"))
    (table,) = document.tables
    texts = [c.text for c in table.rows[1].cells]
    assert [text.replace("\N{NO-BREAK SPACE}", " ") for text in texts] == list(epp.manual_table(guide).texts()[0])
    assert "1.5\N{NO-BREAK SPACE}lbf" in texts[0]
    # A word as long as the column is wide would be torn apart.
    assert not any("\N{NO-BREAK SPACE}simulations" in text for text in texts)
    assert all(run.bold for c in table.rows[0].cells for run in c.paragraphs[0].runs)
    assert "w:tblHeader" in table.rows[0]._tr.xml
    assert document.paragraphs[0].text.endswith(BAD)


def test_markdown_latex_and_html_keep_texts_as_texts(guide, tmp_path: Path):
    table = epp.manual_table(guide)
    lines = [line for line in str(table).splitlines() if line.startswith("|")]
    assert len(lines) == 4 and {line.count("|") for line in lines} == {6}
    for ending in (".tex", ".html"):
        table.write(tmp_path / f"g{ending}")
    latex, page = ((tmp_path / f"g{ending}").read_text() for ending in (".tex", ".html"))
    assert "\\input{x}" not in latex and "50 \\% \\& more" in latex and latex.count(" & ") == 3 * 4
    assert "<b>" not in page and "&lt;b&gt;50 % &amp; more" in page and page.count("<tr>") == 3


def test_command_writes_the_table_and_refuses_before_it_computes(monkeypatch, bounds, tmp_path: Path):
    calls = []
    monkeypatch.setattr("eppanalysis.methods.bounds.design.design_bounds", lambda *_, **__: calls.append(1) or bounds)
    command = ["bounds", "fig8a_original", "--over", "bands.range", "--limit", "lock_pin.backlash"]

    def refusal(*options: str) -> str:
        result = CliRunner().invoke(app, [*command, *options])
        assert result.exit_code == 2 and not calls
        return result.stderr

    assert "expected one of .md" in refusal("--manual", str(tmp_path / "g.odt"))
    assert "expected a file for it" in refusal("--step", "0.1 deg")
    assert "lock_pin.backlash" in refusal("--manual", str(tmp_path / "g.md"), "--step", "2 mm")
    assert "expected a positive one" in refusal("--manual", str(tmp_path / "g.md"), "--step", "0 deg")
    larger = "expected at most 2 deg, the end of the range in which the bound is sought"
    assert larger in refusal("--manual", str(tmp_path / "g.md"), "--within", "0.5 deg..2 deg", "--step", "3 deg")
    with monkeypatch.context() as missing:
        missing.setitem(sys.modules, "docx", None)
        missing.setattr("importlib.util.find_spec", lambda name: None)
        assert "python-docx" in refusal("--manual", str(tmp_path / "g.docx"))
    files = [tmp_path / "g.md", tmp_path / "g.html"]
    asked = [part for path in files for part in ("--manual", str(path))]
    result = CliRunner().invoke(app, [*command, *asked, "--step", "0.1 deg"])
    assert "<table>" in files[1].read_text()
    assert result.exit_code == 0 and "| 2.5 | 0.9 | 0.980 |" in (tmp_path / "g.md").read_text()


@contextmanager
def full_disk() -> Iterator[None]:
    """No file may have more than 512 bytes."""
    import resource

    most, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (512, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))


@pytest.mark.skipif(sys.platform == "win32", reason="limits of this system")
@pytest.mark.parametrize("ending", ["xlsx", "docx"])
def test_a_full_disk_is_one_sentence_and_nothing_is_left(guide, tmp_path, ending, monkeypatch) -> None:
    """What writes an archive would fail once more where it is put away, in a traceback that nobody can catch."""
    lost: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lost.append)
    for write in (guide.write, epp.manual_table(guide).write):
        with full_disk(), pytest.raises(EppError, match=f"g.{ending}: cannot be written"):
            write(tmp_path / f"g.{ending}")
        with full_disk():
            gc.collect()
    assert not lost and not list(tmp_path.iterdir())
