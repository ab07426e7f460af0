"""Rows of a stress run as the table of the documentation's page on trust."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

Row = dict[str, Any]

#: What a row's outcome may be without speaking against the package.
FINE = {"agrees", "magnified", "not comparable", "borne out", "refused", "not proved"}
HEADINGS = (
    "family", "runs", "compared", "largest difference", "verdicts borne out", "searches", "cycles", "stable",
    "contradicted",
)  # fmt: skip


def against(row: Row) -> bool:
    """Whether a row speaks against the package."""
    return row["outcome"] not in FINE or row.get("verdict_holds") is False


def markdown(runs: Sequence[Row], searches: Sequence[Row], title: str) -> str:
    """A sentence with date and seeds, a line a family, their sum, and what is left unexplained by name."""
    families = sorted({r["family"] for r in (*runs, *searches)})
    lines = [" | ".join(_cells(name, runs, searches, lambda r, n=name: r["family"] == n)) for name in families]
    lines.append(" | ".join(_cells("**all**", runs, searches, lambda r: True)))
    table = [f"| {' | '.join(HEADINGS)} |", f"|{' --- |' * len(HEADINGS)}", *(f"| {line} |" for line in lines)]
    left = [f"* {r['family']}, seed {r['seed']}: {_why(r)}" for r in (*runs, *searches) if against(r)]
    open_ones = ["", "What speaks against the package, loop by loop:", "", *left] if left else []
    return "\n".join([title, "", *table, *open_ones, ""])


def in_words(proofs: Sequence[Row]) -> str:
    """What came of the proofs, in a sentence; empty where none were tried."""
    asked = [r for r in proofs if r["outcome"] in ("proved", "not proved")]
    wrong, below = (sum(map(wanted, asked)) for wanted in (against, lambda r: r["far_below"]))
    dates, seeds = (sorted({r[name] for r in asked}) for name in ("date", "seed"))
    if not asked:
        return ""
    return (
        f"{dates[0]}, seeds {seeds[0]} to {seeds[-1]}: {len(asked)} loops of {len({r['family'] for r in asked})} "
        f"families with a limit cycle, near the least gain that has one; {wrong} proved to have none. At a fifth of "
        f"that gain {below} are proved to have none."
    )


def _cells(name: str, runs: Sequence[Row], searches: Sequence[Row], wanted: Callable[[Row], bool]) -> list[str]:
    mine, sought = [r for r in runs if wanted(r)], [r for r in searches if wanted(r)]
    compared = [r for r in mine if r["outcome"] in ("agrees", "magnified", "differs")]
    apart = max((r["apart"] for r in compared if r["outcome"] == "agrees"), default=float("nan"))
    verdicts = Counter(r.get("verdict_holds") for r in mine)
    judged = verdicts[True] + verdicts[False]
    bad = sum(map(against, mine)) + sum(map(against, sought))
    return [
        name, f"{len(mine)}", f"{len(compared)}", f"{apart:.0e}" if compared else "–",
        f"{verdicts[True]} of {judged}", f"{len(sought)}", f"{sum(r.get('cycles', 0) for r in sought)}",
        f"{sum(r.get('stable', 0) for r in sought)}", f"{bad}",
    ]  # fmt: skip


def _why(row: Row) -> str:
    if row.get("verdict_holds") is False:
        return f"the verdict {row['verdict']} is not borne out (change {row['change']:.2g})"
    if row.get("against"):
        return "; ".join(row["against"]) + f" (status {row['status'].lower()})"
    if "apart" in row:
        return f"the two codes are {row['apart']:.2g} apart"
    return str(row.get("why", row["outcome"]))
