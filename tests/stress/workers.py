"""Jobs on processes of which each is given so much time and no more: what never ends is a finding, too."""

from __future__ import annotations

import multiprocessing
import time
import traceback
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any

Job = tuple[str, int]
Answer = dict[str, Any]


def _serve(work: Callable[[str, int], Answer], line: Connection) -> None:
    while (job := line.recv()) is not None:
        try:
            line.send(work(*job))
        except Exception as error:  # any exception is a finding
            place = traceback.extract_tb(error.__traceback__)[-1]
            why = f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})"
            line.send({"family": job[0], "seed": job[1], "outcome": "error", "why": why})


class _Worker:
    def __init__(self, work: Callable[[str, int], Answer]) -> None:
        self.work = work
        self.begin()

    def begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.line, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(self.work, other), daemon=True)
        self.process.start()
        self.job: Job | None = None

    def give(self, job: Job) -> None:
        self.job, self.since = job, time.monotonic()
        self.line.send(job)


def answers(work: Callable[[str, int], Answer], jobs: list[Job], count: int, limit: float) -> Iterator[Answer]:
    """The answer to each job, as they come; "no answer" after `limit` seconds."""
    waiting, workers = list(reversed(jobs)), [_Worker(work) for _ in range(count)]
    while waiting or any(w.job for w in workers):
        for w in workers:
            if w.job is None and waiting:
                w.give(waiting.pop())
        ready = wait([w.line for w in workers if w.job], timeout=1.0)
        for w in workers:
            if w.job is None:
                continue
            if w.line in ready:
                yield w.line.recv()
                w.job = None
            elif time.monotonic() - w.since > limit:
                family, seed = w.job
                w.process.kill()
                w.begin()
                yield {"family": family, "seed": seed, "outcome": "no answer", "why": f"none within {limit:g} s"}
    for w in workers:
        w.line.send(None)
