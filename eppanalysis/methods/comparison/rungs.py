"""The rungs of the ladder: the DF, harmonic balance, exact orbit and simulation of each limit cycle, with errors.

Every cycle of an approximate method is put beside the exact cycle that it belongs to: the nearest one in frequency and
size, each exact cycle given away once, and those of the same stability first.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.harmonic.balance import harmonic_balance
from eppanalysis.methods.orbits.exact import exact_orbit
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.models.elements import Relay
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.readable import percent, signed_percent
from eppanalysis.results import (
    DESCRIBING_FUNCTION,
    EXACT_ORBIT,
    HARMONIC_BALANCE,
    SIMULATION,
    LimitCycle,
    PlainData,
    Prediction,
    Trajectory,
)

#: Factor in frequency and in size within which two cycles may belong together.
FACTOR = 2.0
_STABILITY = {True: "stable", False: "unstable", None: "stability unknown"}


@dataclass(frozen=True)
class Rung(PlainData):
    """One rung: a method and what it gives (None where it gives nothing).

    Attributes
    ----------
    method : str
    quantities : dict of str to (float or None)
        Frequency [Hz], peak-to-peak and mean of the ladder's signal.
    seconds : float
        How long the method took. The DF takes it once for all cycles; a balance starts from the DF, an exact
        orbit from the balance (or from the DF); one that only the search has found carries the search's time.
    note : str
    cycle : LimitCycle or None
        Where all signals are.
    exact : int or None
        Number of the exact cycle that the rung belongs to.
    errors : dict of str to float
        Relative errors of "period" (of an oscillation) and "peak-to-peak" against that cycle; empty when there is none.
    """

    method: str
    quantities: dict[str, float | None]
    seconds: float
    note: str = ""
    cycle: LimitCycle | None = None
    exact: int | None = None
    errors: dict[str, float] = field(default_factory=dict)

    in_json = "method quantities seconds note exact errors"

    def error_of(self, name: str) -> str:
        """One of the errors in words; of a small one no more than that, and none of what errors are taken against."""
        error = self.errors.get(name)
        if error is not None and not any(self.errors.values()):
            return "exact"
        return percent(abs(error)) if error is not None and abs(error) < 1e-4 else signed_percent(error)


class Clock:
    """Time between laps on the wall [s]."""

    def __init__(self) -> None:
        self.last = time.perf_counter()

    def lap(self) -> float:
        """Time since the lap before."""
        before, self.last = self.last, time.perf_counter()
        return self.last - before


@cache
def load_methods() -> None:
    """Import what methods import when they are first called, so that times are those of the methods."""
    loop = LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), Relay())
    simulate(loop, t_end=1.0)
    exact_orbit(loop, predict_limit_cycles(loop)[0])


def largest_harmonic(cycle: LimitCycle, signal: str) -> int:
    """Number of the largest harmonic of a signal: its oscillations within a period, one but for cycles of several
    turns.
    """
    sizes = np.abs(cycle.harmonics[signal][1:])
    return int(np.argmax(sizes)) + 1 if sizes.size else 1


def pace(cycle: LimitCycle, signal: str) -> float:
    """Oscillations of a signal per second [Hz]."""
    return largest_harmonic(cycle, signal) * cycle.frequency


def distance(a: LimitCycle, b: LimitCycle, signal: str) -> float:
    """How far two cycles are apart: the larger of the ratios of frequency (of the oscillations) and size, as
    logarithms.
    """
    size = max(a.peak_to_peak[signal], 1e-300) / max(b.peak_to_peak[signal], 1e-300)
    return float(max(abs(np.log(pace(a, signal) / pace(b, signal))), abs(np.log(size))))


@dataclass(frozen=True, eq=False)
class Climb:
    """All rungs, and where the exact ones come from."""

    rows: tuple[Rung, ...]  # the DF, balances, exact orbits, simulation
    search: CycleSearch | None  # the search for exact cycles; None where there can be no exact orbit
    search_seconds: float
    sentence: str  # how many exact cycles there are, or why there are none
    #: Numbers of the stable exact cycles near which the DF predicts none that may be stable; empty where it
    #: predicts nothing for want of a describing function.
    missed: tuple[int, ...] = ()
    confirmed: bool = False  # whether a stable exact cycle is near one that the DF predicts to be stable


def climb(
    system: LureSystem,
    at: OperatingPoint,
    prediction: tuple[Prediction | None, float],
    run: tuple[Trajectory, float],
    signal: str,
) -> Climb:
    """Balances and exact orbits between a prediction and a run (each with the seconds it took)."""
    clock = Clock()
    search, why_not = _search(system, at, prediction[0])
    search_seconds = prediction[1] + clock.lap()  # a search begins at the predicted cycles
    truth: Sequence[LimitCycle] = search.cycles if search else ()
    first = _first_order(*prediction, signal)
    first = _belonging(first, truth, signal)
    balances = _belonging(_balances(system, at, first, signal), truth, signal)
    exact = () if search is None else _exact(system, at, search, (*balances, *first), search_seconds, signal)
    last = _simulated(*run, signal)
    rows = (*first, *balances, *exact, *_belonging((last,), truth, signal))
    near = _foreseen(prediction[0], search, signal)
    missed = tuple(i for i, known in near.items() if not known)
    return Climb(rows, search, search_seconds, _sentence(search, why_not), missed, any(near.values()))


def _foreseen(prediction: Prediction | None, search: CycleSearch | None, signal: str) -> dict[int, bool]:
    """By the number of each stable exact cycle: whether the DF predicts one near it that may be stable."""
    if prediction is None or search is None:
        return {}
    may_be = [c for c in prediction if c.stable is not False]
    return {
        i: any(distance(p, cycle, signal) < np.log(FACTOR) for p in may_be)
        for i, cycle in enumerate(search)
        if cycle.stable
    }


def _search(system: LureSystem, at: OperatingPoint, prediction: Prediction | None) -> tuple[CycleSearch | None, str]:
    try:
        return find_limit_cycles(system, at, predicted=prediction.cycles if prediction else ()), ""
    except EppError as error:
        return None, str(error)


def _sentence(search: CycleSearch | None, why_not: str) -> str:
    if search is None:
        return why_not
    if not len(search) and search.left_open:
        return f"No exact limit cycle was found. {search.message}"
    if not len(search):
        ends = f"all {search.n_runs} runs of the search {'rest' if search.settles else 'grow without bound'}"
        if search.unclosed:
            return f"No exact limit cycle was found: {ends}, and no prediction leads to an orbit."
        return f"No exact limit cycle was found: {ends}."
    exact = [c for c in search if c.method == EXACT_ORBIT]
    parts = [f"{n} {kind}" for kind, n in Counter(_STABILITY[c.stable] for c in exact).items()]
    sentences = [f"Exact limit cycles: {' and '.join(sorted(parts))}."] if exact else []
    if len(search) > len(exact):
        sentences.append(f"Limit cycles known from runs alone: {len(search) - len(exact)} stable.")
    return " ".join([*sentences, *search.doubts()])


def _first_order(prediction: Prediction | None, seconds: float, signal: str) -> tuple[Rung, ...]:
    rows = tuple(
        Rung(f"{DESCRIBING_FUNCTION}, {_STABILITY[c.stable]}", quantities(c, signal), seconds, cycle=c)
        for c in prediction or ()
    )
    note = "no describing function" if prediction is None else "no cycle"
    return rows or (Rung(DESCRIBING_FUNCTION, quantities(None, signal), seconds, note),)


def _balances(system: LureSystem, at: OperatingPoint, first: Sequence[Rung], signal: str) -> tuple[Rung, ...]:
    """Balance of each predicted cycle; of predictions that lead to one cycle only the first."""
    rows: list[Rung] = []
    for rung in first:
        if rung.cycle is None:
            continue
        clock = Clock()
        try:
            found = harmonic_balance(system, rung.cycle, operating_point=at)
        except EppError as error:
            rows.append(Rung(HARMONIC_BALANCE, quantities(None, signal), clock.lap(), str(error)))
            continue
        seconds = clock.lap()
        if not found.status.ok:
            note = f"does not converge from the cycle predicted at {pace(rung.cycle, signal):.4g} Hz"
            rows.append(Rung(HARMONIC_BALANCE, quantities(None, signal), seconds, note))
        elif not any(_same(found, row.cycle, signal) for row in rows if row.cycle is not None):
            rows.append(Rung(found.method, quantities(found, signal), seconds, cycle=found))
    return tuple(rows)


def _same(a: LimitCycle, b: LimitCycle, signal: str) -> bool:
    return distance(a, b, signal) < max(2.0 * float(np.nansum([a.error_estimate, b.error_estimate])), 1e-6)


def _exact(
    system: LureSystem,
    at: OperatingPoint,
    search: CycleSearch,
    below: Sequence[Rung],
    search_seconds: float,
    signal: str,
) -> tuple[Rung, ...]:
    """Exact orbits, each with the time that it takes to close it from the best rung below."""
    rows = []
    for i, cycle in enumerate(search):
        start = next((rung.cycle for rung in below if rung.exact == i), None)
        seconds, note = search_seconds, "found by the search"
        if start is not None:
            clock = Clock()
            again = exact_orbit(system, start, at)
            if again.status.ok and abs(again.period / cycle.period - 1.0) < 1e-6:
                seconds, note = clock.lap(), ""
        method = f"{cycle.method}, {_STABILITY[cycle.stable]}"
        # A cycle that only a run has found is nothing that errors could be taken against.
        errors = {"period": 0.0, "peak-to-peak": 0.0} if cycle.method == EXACT_ORBIT else {}
        rows.append(Rung(method, quantities(cycle, signal), seconds, note, cycle, i, errors))
    return tuple(rows)


def _simulated(run: Trajectory, seconds: float, signal: str) -> Rung:
    note = run.message if run.limit_cycle is None else ""
    return Rung(SIMULATION, quantities(run.limit_cycle, signal), seconds, note, run.limit_cycle)


def _belonging(rows: tuple[Rung, ...], truth: Sequence[LimitCycle], signal: str) -> tuple[Rung, ...]:
    """The rungs with the exact cycles that they belong to, and their errors."""
    # From the best pair on: cycles of one stability first, then the nearest; no exact cycle serves two of a method.
    pairs = sorted(
        (row.cycle.stable not in (None, cycle.stable), distance(row.cycle, cycle, signal), i, j)
        for i, row in enumerate(rows)
        for j, cycle in enumerate(truth)
        if row.cycle is not None
    )
    given: dict[int, int] = {}
    for _, apart, i, j in pairs:
        if apart < np.log(FACTOR) and i not in given and j not in given.values():
            given[i] = j
    return tuple(_with_errors(row, given.get(i), truth, signal) for i, row in enumerate(rows))


def _with_errors(row: Rung, exact: int | None, truth: Sequence[LimitCycle], signal: str) -> Rung:
    if exact is None or row.cycle is None:
        return row
    errors = {"period": pace(truth[exact], signal) / pace(row.cycle, signal) - 1.0}
    size = truth[exact].peak_to_peak[signal]
    if size > 0.0:  # else the signal is constant, and no error is relative to that
        errors["peak-to-peak"] = row.cycle.peak_to_peak[signal] / size - 1.0
    return replace(row, exact=exact, errors=errors)


def quantities(cycle: LimitCycle | None, signal: str) -> dict[str, float | None]:
    """What a rung shows of a cycle."""
    if cycle is None:
        return {"frequency": None, "peak-to-peak": None, "mean": None}
    return {
        "frequency": pace(cycle, signal),
        "peak-to-peak": cycle.peak_to_peak[signal],
        "mean": cycle.mean[signal],
    }
