"""Jobs on processes of which each is given so much time and no more: what never ends is a finding, too."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from typing import Any

Job = tuple[str, int]
Answer = dict[str, Any]


def _serve(work: Callable[[str, int], Answer], line: Connection, limit: float) -> None:
    while (job := line.recv()) is not None:
        # Seconds of the processor, not on the wall: a busy machine must not choose the loops.
        # The signal ends the process.
        signal.setitimer(signal.ITIMER_PROF, limit)
        try:
            answer = work(*job)
        except Exception as error:  # any exception is a finding
            place = traceback.extract_tb(error.__traceback__)[-1]
            why = f"{type(error).__name__}: {error} ({place.name}, line {place.lineno})"
            answer = {"family": job[0], "seed": job[1], "outcome": "error", "why": why}
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        line.send(answer)


class _Worker:
    def __init__(self, work: Callable[[str, int], Answer], limit: float) -> None:
        self.work, self.limit = work, limit
        self.begin()

    def begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.line, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(self.work, other, self.limit), daemon=True)
        self.process.start()
        other.close()
        self.job: Job | None = None

    def give(self, job: Job) -> None:
        self.job = job
        self.line.send(job)

    def answer(self) -> Answer:
        """What the job that was given has come to; behind one that took too long stands a new process."""
        assert self.job is not None
        family, seed = self.job
        try:
            row: Answer = self.line.recv()
            self.job = None
        except (EOFError, ConnectionError):
            why = f"none within {self.limit:g} s of the processor"
            row = {"family": family, "seed": seed, "outcome": "no answer", "why": why}
            self.process.join()
            self.begin()
        return row


def answers(work: Callable[[str, int], Answer], jobs: list[Job], count: int, limit: float) -> Iterator[Answer]:
    """The answer to each job, as they come; "no answer" after `limit` seconds of the processor."""
    waiting, workers = list(reversed(jobs)), [_Worker(work, limit) for _ in range(count)]
    while waiting or any(w.job for w in workers):
        for w in workers:
            if w.job is None and waiting:
                w.give(waiting.pop())
        ready = wait([w.line for w in workers if w.job])
        for w in workers:
            if w.line in ready:
                yield w.answer()
    for w in workers:
        w.line.send(None)
