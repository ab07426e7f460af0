"""Times of contenders that take turns, so that a busy machine disturbs all of them alike; what counts are ratios."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

#: One turn of a fast contender lasts about this long [s].
TURN = 0.03
#: Contenders that take longer than the first number [s] get at most as many turns as the second one.
SLOW = ((4.0, 1), (1.0, 3))
#: The first call of a contender may compile, so a second one says how long it takes, unless it is slow anyway [s].
SECOND_CALL = 8.0


@dataclass(frozen=True)
class Contender:
    """Someone who does the work; `run` returns what the work asks for."""

    name: str
    run: Callable[[], Any]
    group: str = ""
    note: str = ""


@dataclass(frozen=True)
class Timing:
    """Median over the turns [s], median of the ratio to the base timed just before each turn, what the work gave."""

    seconds: float
    ratio: float
    turns: int
    result: Any
    failure: str = ""


CLOCKS = {"wall": time.perf_counter, "cpu": time.process_time}


def once(run: Callable[[], Any], clock: str = "wall") -> tuple[float, Any]:
    """Seconds and result of one call; "cpu" adds up what all threads compute, for a machine that is shared."""
    now = CLOCKS[clock]
    begin = now()
    result = run()
    return now() - begin, result


def alternate(base: Contender, others: Sequence[Contender], turns: int, clock: str = "wall") -> dict[str, Timing]:
    """Medians of all contenders by name, those that raise included (with not-a-number and the reason).

    Every turn of a contender is preceded by one of the base, and their ratio is taken.

    Parameters
    ----------
    base : Contender
        The one against which ratios are formed; it comes out too, with ratio 1.
    others : sequence of Contender
    turns : int
        Turns of each contender; slow ones get fewer.
    clock : str
        "wall" or "cpu".
    """
    first: dict[str, tuple[float, Any]] = {}
    failures: dict[str, str] = {}
    for c in (base, *others):
        try:
            first[c.name] = once(c.run, clock)
            if first[c.name][0] < SECOND_CALL:
                first[c.name] = once(c.run, clock)
        except Exception as error:  # whatever a rival raises is its result
            failures[c.name] = f"{type(error).__name__}: {str(error).splitlines()[0][:120]}"
    seconds: dict[str, list[float]] = {c.name: [] for c in (base, *others)}
    ratios: dict[str, list[float]] = {c.name: [] for c in others}
    for turn in range(turns):
        for c in others:
            if c.name in failures or turn >= _allowed(first[c.name][0], turns):
                continue
            own = _turn(base.run, first[base.name][0], clock)
            theirs = _turn(c.run, first[c.name][0], clock)
            seconds[base.name].append(own)
            seconds[c.name].append(theirs)
            ratios[c.name].append(theirs / own)
    out = {base.name: Timing(statistics.median(seconds[base.name]), 1.0, len(seconds[base.name]), first[base.name][1])}
    for c in others:
        if c.name in failures:
            out[c.name] = Timing(math.nan, math.nan, 0, None, failures[c.name])
        else:
            middle = statistics.median(seconds[c.name])
            out[c.name] = Timing(middle, statistics.median(ratios[c.name]), len(ratios[c.name]), first[c.name][1])
    return out


def _allowed(seconds: float, turns: int) -> int:
    return next((min(turns, most) for limit, most in SLOW if seconds > limit), turns)


def _turn(run: Callable[[], Any], expected: float, clock: str) -> float:
    """Median of as many calls as fill a turn."""
    calls = max(1, min(15, int(TURN / max(expected, 1e-9))))
    return statistics.median(once(run, clock)[0] for _ in range(calls))
