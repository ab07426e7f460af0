"""The stored table of remedies against the exact search, a per cent to both sides of each row."""

from __future__ import annotations

import pytest

import eppanalysis as epp
from studies.remedies import RANGE, REMEDIES, RESULT, Remedy, cured, table

ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in RESULT.read_text("utf-8").splitlines()[2:]]


def test_the_table_has_a_row_for_each_remedy_in_the_units_of_people() -> None:
    assert [row[0] for row in ROWS] == list(REMEDIES)
    ranges = [float(row[1]) for row in ROWS]
    assert [row[2] for row in ROWS] == ["-", *(f"{100 * (ranges[0] / r - 1):.0f} %" for r in ranges[1:])]
    made = table((Remedy("none", 4.4482216152605, 0.0, 3.6, True), Remedy("all", 2.2241108076, 1.0, 3.5, False)))
    assert "| none | 1.000 | - | 3.60 | yes |\n| all | 0.500 | 100 % | 3.50 | no |" in made


#: Of leads the shorter one; a softer cable and a wider band together, which hold each of them.
SEARCHED = [ROWS[i] for i in (0, 3, 4, 5)]


@pytest.mark.slow
@pytest.mark.parametrize("row", SEARCHED, ids=lambda row: row[0])
def test_cycles_begin_where_the_table_says(row: list[str]) -> None:
    case = cured(row[0])
    inside, beyond = (case.with_values({RANGE: f"{share * float(row[1])} lbf"}) for share in (1.01, 0.99))
    assert len(epp.find_limit_cycles(inside)) == 0
    assert len(epp.find_limit_cycles(beyond)) > 0
