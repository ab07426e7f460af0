"""The paper's design advice at several operating points, as stored sentences: ``python -m studies.advice_table``.

It takes some minutes, so that its result is kept in ``_static/advice.md`` and shown from there.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import eppanalysis as epp
from studies import STORED
from studies.advice import AdviceRow, advice_sentences, design_advice

RESULT = STORED / "advice.md"
WITHIN = ("0.05 deg", "5 deg")
#: Pulley, the case that has it, and the profile ranges.
POINTS = (
    ("Ball bearing", "fig6b_ball_bearing", ("2.5 lbf", "1.5 lbf")),
    ("Original pulley", "fig6a_original_pulley", ("2.5 lbf", "1.5 lbf", "1.25 lbf")),
)


def rows(pulley: str, gain: str) -> tuple[AdviceRow, ...]:
    """The advice for the original elbow with the pulley of another case, at one gain."""
    friction = epp.case(pulley).value("pulley.friction")
    case = epp.case("fig8a_original").with_values({"pulley.friction": friction})
    return design_advice(case, [gain], within=WITHIN)


def text(workers: int = 2) -> str:
    """Sentences in Markdown."""
    jobs = [(pulley, gain) for _, pulley, gains in POINTS for gain in gains]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        found = dict(zip(jobs, pool.map(rows, *zip(*jobs, strict=True)), strict=True))
    sentences = advice_sentences([row for job in jobs for row in found[job]])
    return "\n".join(f"* {sentence}" for sentence in sentences) + "\n"


if __name__ == "__main__":
    RESULT.write_text(text(), encoding="utf-8")
