"""The stored table of all rungs for all cases: some cases are climbed again."""

from __future__ import annotations

import re
from collections import Counter

import pytest

import eppanalysis as epp
from studies import ladder as study


def test_every_shipped_case_is_in_the_table():
    assert list(dict.fromkeys(row.case for row in study.read())) == list(study.covered())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["relay_deadzone", "sat_khalil710", "backlash_discrete_pi"])
def test_stored_rows_come_out_again(name):
    stored = [r for r in study.read() if r.case == name]
    for old, new in zip(stored, study.rows_of(name), strict=True):
        assert (new.method, new.exact) == (old.method, old.exact)
        for field in ("frequency", "peak_to_peak", "error_period", "error_size"):
            assert getattr(new, field) == pytest.approx(getattr(old, field), rel=1e-3, abs=1e-8, nan_ok=True)


def test_exact_orbits_and_long_runs_agree_wherever_both_exist():
    agreed = 0
    for row in study.read():
        if row.method == "simulation" and row.exact >= 0:
            # The run of the wheelchair has not come quite to its end when it is judged.
            limit = 1e-5 if row.case == "wheelchair" else 1e-8
            assert abs(row.error_period) < limit and abs(row.error_size) < limit, row.case
            agreed += 1
    assert agreed >= 25


def test_numbers_of_the_table_are_written_as_people_write_them():
    cells = [cell for line in study.table()[1] for cell in line]
    assert not [cell for cell in cells if re.search(r"\de[+-]?\d", cell)]
    spans = [cell.split(" to ") for cell in cells if " to " in cell]
    assert all(float(low) < float(high) for low, high in spans)


def test_every_exact_cycle_of_the_stored_rows_is_in_the_table_once():
    rows = study.read()
    cycles = {(r.case, r.exact) for r in rows if r.exact >= 0}
    shown: Counter[str] = Counter()
    for case, what, *_ in study.table()[1]:
        number = re.match(r"\d+", what)
        shown[case.strip("`")] += int(number[0]) if number else what not in ("not real", "not closed", "no cycle")
        assert number is None or int(number[0]) > 1, "one cycle has a line like any other"
    assert +shown == Counter(case for case, _ in cycles)


def test_a_case_without_a_cycle_says_what_its_run_does():
    cells = {line[0].strip("`"): line[-1] for line in study.table()[1] if line[1] == "no cycle"}
    assert cells["stiction_deadband_none"] == "undecided"
    assert all(epp.case(name).expected.outcome == "settle" for name, cell in cells.items() if cell == "settles")
    assert set(cells.values()) == {"settles", "undecided"}
