"""The stored table of all rungs for all cases: some cases are climbed again."""

from __future__ import annotations

import re

import pytest

from studies import ladder as study

pytestmark = pytest.mark.slow


def test_every_shipped_case_is_in_the_table():
    assert list(dict.fromkeys(row.case for row in study.read())) == list(study.covered())


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
    for seconds, text in (
        (0.0123456, "12.3 ms"),
        (0.9994, "999 ms"),
        (0.9996, "1 s"),
        (1.164, "1.16 s"),
        (72.0, "72 s"),
    ):
        assert study._time(seconds) == text
