"""What the tables of checks against other codes add up to, for the top of the page on trust."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from studies import DOCS
from studies.pages.tables import markdown

#: The tables of the page, written by who ran the checks.
CHECKS = DOCS / "_static" / "stress.md"
#: Of the tables of runs, searches and proofs the column that may not be what it says, and what it says in a sentence.
_AGAINST = {"runs": "differ", "searches": "contradicted", "proofs": "proved to have none"}
_WHAT = {
    "runs": "runs in time against another code",
    "searches": "searches for limit cycles against 200 starts each",
    "proofs": "proofs of absence tried where a cycle exists",
}


def tables(text: str) -> Iterator[tuple[list[str], list[list[str]]]]:
    """Heads and rows of the tables of a page."""
    for block in re.findall(r"^\|.*(?:\n\|.*)+", text, re.MULTILINE):
        head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()]
        yield head, rows


def summed(rows: list[list[str]], column: int) -> int:
    """The sum of the whole numbers that the cells of a column begin with."""
    found = (re.match(r"[\d,]+", row[column]) for row in rows)
    return sum(int(one.group().replace(",", "")) for one in found if one)


def _pairs(rows: list[list[str]], column: int) -> Iterator[list[str]]:
    """Both numbers of cells such as "41 of 42"."""
    return (re.findall(r"[\d,]+", row[column])[:2] for row in rows)


def _line(what: str, number: int, wrong: int) -> list[str]:
    return [what, f"{number:,}", str(wrong) if wrong else "none"]


def sums_table() -> str:
    """How much was checked, and how much of it was contradicted."""
    lines = []
    for head, rows in tables(CHECKS.read_text(encoding="utf-8")):
        kind = head[0].partition(" ")[0]
        if kind in _AGAINST:
            wrong = summed(rows, head.index(_AGAINST[kind]))
            lines.append(_line(_WHAT[kind], summed(rows, 1), wrong))
        if "verdicts borne out" in head:
            column = head.index("verdicts borne out")
            borne, given = (summed([[cell] for cell in part], 0) for part in zip(*_pairs(rows, column), strict=True))
            lines.append(_line("verdicts of these runs, by going on with the other code", given, given - borne))
    return markdown(["check", "loops", "contradicted (each explained below)"], lines)


def make_all(folder: Path) -> None:
    """Write it as a Markdown file."""
    (folder / "stress_sums.md").write_text(sums_table(), encoding="utf-8")
