"""Tables of elements in CSV files, named by a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import CaseError

CASE = """
kind = "loop"
title = "Valve with a measured curve"

[loop]
num = [2.0]
den = [1, 2, 1, 0]

[[loop.elements]]
element = "lookup_table"
name = "valve"
{field}
beyond = "hold"

[run]
t_end = "10 s"
"""
DIAGRAM = """
kind = "diagram"
title = "Valve with a measured curve"
connect = ["-plant -> valve", "valve -> plant"]

[blocks]
plant = {{ kind = "transfer_function", num = [2.0], den = [1, 2, 1, 0] }}

[elements]
valve = {{ element = "lookup_table", {field}, beyond = "hold" }}

[run]
t_end = "10 s"
"""
POINTS = [(-20.0, -3.0), (0.0, 0.0), (10.0, 0.5), (30.0, 4.0)]


def valve(folder: Path, text: str, field: str = 'file = "valve.csv"', form: str = CASE) -> epp.LookupTable:
    """The element of a case that lies beside a file of the given text."""
    (folder / "valve.csv").write_text(text, encoding="utf-8")
    loop = epp.case_from_text(form.format(field=field), folder=folder).to_system()
    (element,) = loop.elements
    assert isinstance(element, epp.LookupTable)
    return element


def rows(header: str = "") -> str:
    return header + "".join(f"{x},{y},a remark\n" for x, y in POINTS)


@pytest.mark.parametrize("form", [CASE, DIAGRAM])
def test_the_columns_of_a_file_are_those_of_the_case(tmp_path: Path, form: str) -> None:
    x, y = np.array(POINTS).T
    expected = epp.LookupTable(x, y, "hold")
    assert valve(tmp_path, rows(), form=form) == expected
    assert valve(tmp_path, rows("opening,flow,\n"), form=form) == expected
    inline = f"inputs = {x.tolist()}, outputs = {y.tolist()}" if form is DIAGRAM else (
        f"inputs = {x.tolist()}\noutputs = {y.tolist()}"
    )  # fmt: skip
    assert valve(tmp_path, "", inline, form) == expected


def test_units_stand_in_the_header(tmp_path: Path) -> None:
    found = valve(tmp_path, rows("opening [mm],flow [kN]\n"))
    np.testing.assert_allclose(found.inputs, np.array(POINTS)[:, 0] / 1e3, rtol=1e-15)
    np.testing.assert_allclose(found.outputs, np.array(POINTS)[:, 1] * 1e3, rtol=1e-15)


def test_a_path_leads_into_the_folder_of_the_case(tmp_path: Path) -> None:
    (tmp_path / "measured").mkdir()
    (tmp_path / "measured" / "curve.csv").write_text(rows(), encoding="utf-8")
    assert valve(tmp_path, "", 'file = "measured/curve.csv"').inputs.size == 4


@pytest.mark.parametrize(("text", "field", "words"), [
    (rows(), 'file = "../valve.csv"', "within the case's folder"),
    (rows(), 'file = "none.csv"', "within the case's folder"),
    (rows(), "file = 3", "within the case's folder"),
    (rows(), 'file = "valve.csv"\ninputs = [1, 2]', "either file, or inputs and outputs"),
    ("x,y\n1,2\n2,b\n", 'file = "valve.csv"', r"valve.csv: line 3 is 'b'; expected a number"),
    ("1,2\n2\n", 'file = "valve.csv"', r"valve.csv: line 2 is '2'; expected 2 numbers"),
    ("x,y\n", 'file = "valve.csv"', "0 rows of numbers"),
    (rows("x [parrots],y\n"), 'file = "valve.csv"', "parrots"),
    ("2,1\n1,3\n0,0\n", 'file = "valve.csv"', "ascending numbers"),
])  # fmt: skip
def test_what_is_wrong_is_refused_in_a_sentence(tmp_path: Path, text: str, field: str, words: str) -> None:
    with pytest.raises(CaseError, match=words):
        valve(tmp_path, text, field)


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    inside = tmp_path / "case"
    inside.mkdir()
    (tmp_path / "valve.csv").write_text(rows(), encoding="utf-8")
    (inside / "link.csv").symlink_to(tmp_path / "valve.csv")
    with pytest.raises(CaseError, match="within the case's folder"):
        valve(inside, "", 'file = "link.csv"')
