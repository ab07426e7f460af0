"""Jobs of a stress run end after so many seconds of the processor, however busy the machine is."""

from __future__ import annotations

import time
from typing import Any

from tests.stress.workers import answers


def job(family: str, seed: int) -> dict[str, Any]:
    """One that waits longer than the limit, or computes without end."""
    if family == "waits":
        time.sleep(0.8)
    while family == "computes":
        seed += 1
    return {"family": family, "seed": seed, "outcome": "agrees"}


def test_waiting_for_the_processor_is_no_time_of_a_job():
    from tests.stress.test_workers import job as importable  # by the name under which the workers find it

    rows = list(answers(importable, [("waits", 1), ("computes", 2), ("quick", 3)], 1, 0.5))
    assert [r["outcome"] for r in rows] == ["agrees", "no answer", "agrees"]
