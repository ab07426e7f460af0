"""The pages on the paper: the notebook's verdicts, and which of them depend on what the paper leaves open."""

from __future__ import annotations

import ast
import re

import nbformat
import pytest

import eppanalysis as epp
from eppanalysis.report.notebook import execute
from studies import DOCS
from studies.paper import sensitivity, tables

pytestmark = pytest.mark.slow

#: Statements that the model does not bear out, or in part; the page of the paper names them.
DIFFERS = {
    "60.7 deg/s with 1.4 N m on its own 12 V battery",
    "stick-slip, the drop from static to kinetic friction, is especially detrimental",
    "the slip may turn flexion into extension immediately",
    "a small drift, put down to the cord",
}
IN_PART = {
    "bidirectional EPP should be superior",
    "oscillations suddenly stop, rarely",
    "while it sticks the sensor commands flexion, the harness side may be in parking or extension",
    "stiffness and mass determine how much the backlash matters",
    "a compensator removes the limit cycle",
}


def test_the_notebook_runs_and_its_verdicts_are_those_of_the_page() -> None:
    path = DOCS / "paper" / "farrell.ipynb"
    notebook = nbformat.read(path, 4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "outputs are made when the documentation is built"
    last = (
        "for word in ('differs', 'agrees in part', 'agrees'): print([said for _, said, _, w in verdicts if w == word])"
    )
    notebook.cells.append(nbformat.v4.new_code_cell(last))
    outputs = [out for cell in execute(notebook, path.name).cells for out in cell.get("outputs", ())]
    assert sum("image/png" in out.get("data", {}) for out in outputs) >= 10
    assert not any(out.get("name") == "stderr" for out in outputs)
    differ, in_part, agree = map(ast.literal_eval, outputs[-1]["text"].splitlines())
    assert set(differ) == DIFFERS and set(in_part) == IN_PART and len(agree) >= 20


def test_findings_that_flip_are_those_that_the_page_names() -> None:
    flips = {
        (i + 1, name)
        for i, finding in enumerate(sensitivity.FINDINGS)
        for name in sensitivity.assumed()
        if tables.flips_at(finding, name)
    }
    assert flips == {(3, "lock_pin.stiffness"), (5, "lock_pin.stiffness"), (1, "bands.range"), (7, "bands.range")}
    assert tables.flips_at("fig6b_ball_bearing", "lock_pin.stiffness")[0].startswith("-")
    assert tables.flips_at("gain_brings_it_back", "lock_pin.stiffness") == ["+50 %"]
    assert tables.flips_at("fig8a_original", "bands.range") == ["+50 %"]
    assert tables.flips_at("light_forearm", "bands.range") == ["-50 %"]


def test_findings_hold_together_as_the_page_says() -> None:
    for finding in sensitivity.FINDINGS:
        want = epp.case(finding).expected.outcome
        near, far = (sensitivity.all_at_once(finding, s).count(want) / sensitivity.SAMPLES for s in sensitivity.SPREADS)
        assert near > 0.9 and far > 0.6


def test_variation_keeps_what_the_paper_gives() -> None:
    case = epp.case("fig8a_original")
    wider = case.with_values(sensitivity.varied(case, "pulley.radius", 1.5))
    assert wider.value("pulley.radius") * wider.value("cable.stiffness") == pytest.approx(
        case.value("pulley.radius") * case.value("cable.stiffness")
    )
    heavier = case.with_values(sensitivity.varied(case, "forearm.shell_inertia", 1.5))
    assert heavier.value("forearm.inertia") == pytest.approx(0.0465 + 0.003)


@pytest.mark.parametrize("finding", sensitivity.FINDINGS)
def test_what_cannot_go_up_by_half_is_named_on_the_page(finding: str) -> None:
    case, page = epp.case(finding), (DOCS / "paper" / "assumptions.md").read_text(encoding="utf-8")
    for name in sensitivity.assumed():
        for factor in sensitivity.FACTORS:
            if sensitivity.varied(case, name, factor)[name] != pytest.approx(factor * case.value(name)):
                most = sensitivity.varied(case, name, factor)[name] / case.value(name) - 1.0
                told = re.search(rf"`{name}` goes up by (\d+) per cent only", " ".join(page.split()))
                assert told and 100.0 * most == pytest.approx(float(told[1]))


def test_pieces_put_in_flip_what_the_page_says() -> None:
    flips = {
        piece.text: {
            i + 1
            for i, finding in enumerate(sensitivity.FINDINGS)
            if sensitivity.with_piece(finding, number) != epp.case(finding).expected.outcome
        }
        for number, piece in enumerate(sensitivity.PIECES)
        if "bit" not in piece.text  # the modes of a converter take long to make
    }
    assert flips == {
        "sensor filter of 2 ms": {5},
        "controller sampled every 1 ms": set(),
        "controller sampled every 5 ms": {5},
        "parking logic, dwell time 0.5 s": set(),
        "step in the other direction": {7},
    }
