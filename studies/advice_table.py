"""The paper's design advice at several operating points, as a stored table: ``python -m studies.advice_table``.

It takes some minutes, so that its result is kept in ``_static/advice.md`` and shown from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pandas as pd

import eppanalysis as epp
from studies import STORED
from studies.advice import AdviceRow, advice_frame, advice_sentences, design_advice
from studies.pages.tables import markdown

RESULT = STORED / "advice.md"
WITHIN = ("0.05 deg", "5 deg")
#: Pulley, the case that has it, and the profile ranges.
POINTS = (
    ("Ball bearing", "fig6b_ball_bearing", ("2.5 lbf", "1.5 lbf")),
    ("Original pulley", "fig6a_original_pulley", ("2.5 lbf", "1.5 lbf", "1.25 lbf")),
)
#: What each cell of the table holds, in this order.
SHOWN = ("bound grows [%]", "gain may grow [%]", "step grows [%]", "blow grows [%]")


def rows(pulley: str, gain: str) -> tuple[AdviceRow, ...]:
    """The advice for the original elbow with the pulley of another case, at one gain."""
    friction = epp.case(pulley).value("pulley.friction")
    case = epp.case("fig8a_original").with_values({"pulley.friction": friction})
    return design_advice(case, [gain], within=WITHIN)


def text(workers: int = 2) -> str:
    """Sentences and tables in Markdown."""
    jobs = [(pulley, gain) for _, pulley, gains in POINTS for gain in gains]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        found = dict(zip(jobs, pool.map(rows, *zip(*jobs, strict=True)), strict=True))
    case = epp.case("fig8a_original")
    sentences = advice_sentences([row for job in jobs for row in found[job]])
    parts = ["\n".join(f"* {sentence}" for sentence in sentences)]
    points = {
        f"{name}, {gain}": advice_frame(case, found[pulley, gain]) for name, pulley, gains in POINTS for gain in gains
    }
    return "\n\n".join([*parts, table(points)])


def table(points: Mapping[str, pd.DataFrame]) -> str:
    """A row for each piece of advice, a column for each operating point with its bound."""
    header = ["per cent for one per cent", *(f"{name} ({f['bound [deg]'].iloc[0]} deg)" for name, f in points.items())]
    advice = next(iter(points.values()))["advice"]
    cells = [
        [one, *(", ".join(f.loc[f["advice"] == one, list(SHOWN)].iloc[0]) for f in points.values())] for one in advice
    ]
    said = ", ".join(name.removesuffix(" [%]") for name in SHOWN)
    return f"Cells: {said}.\n\n{markdown(header, cells)}"


if __name__ == "__main__":
    RESULT.write_text(text(), encoding="utf-8")
