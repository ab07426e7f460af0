"""What a sweep reports of a cell: columns of numbers by analysis, a status for every cell, a sentence where
it failed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.cases import Case
from eppanalysis.errors import ArgumentError, EppError, require_packages
from eppanalysis.readable import words
from eppanalysis.results import Status
from eppanalysis.sweep.axes import Axes

if TYPE_CHECKING:
    from eppanalysis.methods.bounds.sizes.allowed import Allowed

Columns = dict[str, NDArray[Any]]


class Analysis(StrEnum):
    """What a sweep carries out in every cell."""

    SIMULATE = "simulate"
    PREDICT = "predict"
    CYCLES = "cycles"
    TRIGGER = "trigger"
    CERTIFY = "certify"


class Code(IntEnum):
    """A result that is one of few, stored as a number; its words are those of the members."""

    @property
    def word(self) -> str:
        """What files and tables call it."""
        return self.name.lower()

    @classmethod
    def words(cls) -> tuple[str, ...]:
        """All words, in the order of their numbers."""
        return tuple(member.word for member in cls)


class Outcome(Code):
    """Where a cell's motion ends."""

    UNKNOWN, SETTLES, OSCILLATES, DIVERGES = range(4)


class Allowance(Code):
    """Where a cell's motion ends beside a limit cycle that is allowed: the worst that is known of it."""

    UNKNOWN, SETTLES, WITHIN, EXCEEDS, DIVERGES = range(5)

    @property
    def word(self) -> str:
        """What files and tables call it."""
        cycles = {Allowance.WITHIN: "cycles_within_what_is_allowed", Allowance.EXCEEDS: "exceeds_what_is_allowed"}
        return cycles.get(self) or super().word


class Stability(Code):
    """Whether an exact cycle of a cell is stable, or all are not."""

    UNKNOWN, NO_CYCLE, STABLE, UNSTABLE = range(4)


class TriggerOutcome(Code):
    """What a disturbance of a cell at rest does."""

    UNKNOWN, NO_CYCLE, STARTS, HOLDS, NO_REST = range(5)


class Proved(Code):
    """What is proved of a cell: that nothing in it is periodic but rest, or that a limit cycle exists."""

    UNDECIDED, PROVED_FREE, PROVED_TO_OSCILLATE = range(3)


ANALYSES = tuple(Analysis)
#: Words for every analysis that needs no further package, or for every signal.
ALL = "all"
#: Prefix of an analysis's variables; the run in time has the plain names.
PREFIX = {Analysis.SIMULATE: "", Analysis.PREDICT: "predicted_", Analysis.CYCLES: "exact_"}
#: Statuses by their code; 0 marks a cell that has not been computed, the last one a cell that could not be.
NOT_RUN, FAILED = 0, len(Status) + 1
STATUS_CODE = {status: code for code, status in enumerate(Status, start=1)}
STATUS_NAMES = ("not_run", *(status.name.lower() for status in Status), "failed")
STATUS_SENTENCES = (
    "The cell has not been computed yet.",
    *(status.value for status in Status),
    "The cell could not be computed; its message gives the reason.",
)


@dataclass(frozen=True)
class Variable:
    """A result: its type ("f8", "i4", "i1" or "text"), unit and meaning."""

    dtype: str
    unit: str = ""
    long_name: str = ""
    flags: tuple[str, ...] = ()

    @property
    def fill(self) -> Any:
        """What is in a cell without a result."""
        return {"f8": np.nan, "text": ""}.get(self.dtype, 0)

    def empty(self, n: int) -> NDArray[Any]:
        """Results of n cells, none there yet."""
        if self.dtype == "text":
            return np.full(n, "", object)
        return np.full(n, self.fill, self.dtype)

    def attributes(self) -> dict[str, Any]:
        """Attributes of the variable in a dataset (CF conventions: units, long_name, flags)."""
        found: dict[str, Any] = {"long_name": self.long_name}
        if self.dtype == "f8":
            found["units"] = str(self.unit)  # plain text, which a file takes
        if self.flags:
            found |= {"flag_values": list(range(len(self.flags))), "flag_meanings": " ".join(self.flags)}
        if self.flags == STATUS_NAMES:
            found["sentences"] = json.dumps(dict(zip(STATUS_NAMES, STATUS_SENTENCES, strict=True)))
        return found


@dataclass(frozen=True)
class Task:
    """What a sweep computes: in small, so that it travels to any worker, which then makes a :class:`Work` of it."""

    case: Case
    axes: Axes
    analyses: tuple[Analysis, ...]
    signals: tuple[str, ...]
    allowed: Allowed | None = None

    @property
    def main_signal(self) -> str:
        """The signal whose results have the plain names."""
        return self.signals[0]

    def named_signals(self) -> list[tuple[str, str]]:
        """Tail of the variables' names, and signal; the main one has none."""
        return [(f"_{name}" if i else "", name) for i, name in enumerate(self.signals)]

    @property
    def judge(self) -> Analysis | None:
        """The analysis by which predictions are judged: the run in time, or the exact cycle where there is no run."""
        if Analysis.PREDICT not in self.analyses:
            return None
        return next((analysis for analysis in (Analysis.SIMULATE, Analysis.CYCLES) if analysis in self.analyses), None)

    @property
    def disturbed(self) -> str:
        """The external input that is disturbed; the first state where there is none."""
        system = self.case.to_system()
        return (*system.input_names, *system.state_names)[0]

    def _trigger_variables(self) -> dict[str, Variable]:
        unit = self.case.input_units.get(self.disturbed, "")
        name = self.disturbed
        found = {
            "trigger_outcome": Variable("i1", "", f"what a disturbance of {name} at rest does", TriggerOutcome.words())
        }
        for tail, way in (("", "either way"), ("_up", "upwards"), ("_down", "downwards")):
            text = f"smallest step of {name} {way} that starts a limit cycle from rest"
            found[f"trigger{tail}"] = Variable("f8", unit, text)
        return found

    def variables(self) -> dict[str, Variable]:
        """All results, in order."""
        units = self.case.to_system().signals.units_by_name()
        found: dict[str, Variable] = {}
        for analysis in self.analyses:
            if analysis is Analysis.TRIGGER:
                found |= self._trigger_variables()
            elif analysis is Analysis.CERTIFY:
                found["proved"] = Variable("i1", "", "what is proved of the loop", Proved.words())
            else:
                found |= _analysis_variables(analysis, self.signals, units)
                found |= {} if self.allowed is None else _size_variables(analysis, self.allowed)
        if self.judge is not None:
            whom = "run" if self.judge is Analysis.SIMULATE else "exact cycle"
            for name in ("peak_to_peak", "frequency"):
                text = f"relative error of the predicted {words(name)} against the {whom}: predicted / true - 1"
                found[f"first_order_error_{name}"] = Variable("f8", "1", text)
        found["status"] = Variable("i1", "", "how the computation of the cell ended", STATUS_NAMES)
        found["message"] = Variable("text", "", "why a cell failed")
        return found


def make_task(
    case: Case, axes: Axes, run: str | Sequence[str], signals: str | Sequence[str] | None, allow: str | None = None
) -> Task:
    """The task of a sweep.

    Raises
    ------
    EppError
        If there is no such analysis or signal, what is allowed is not valid or given to analyses without cycles, or
        what an analysis needs is not installed.
    """
    allowed = None if allow is None else _allowed(case, allow)
    of_all = tuple(analysis for analysis in Analysis if analysis is not Analysis.CERTIFY)
    named = of_all if run == ALL else (run,) if isinstance(run, str) else tuple(run)
    for analysis in named:
        if analysis not in ANALYSES:
            raise ArgumentError("run", f" is {analysis!r}; expected one or several of {', '.join(ANALYSES)}.", "sweep")
    analyses = [Analysis(analysis) for analysis in named]
    if not analyses:
        raise ArgumentError("run", f" names no analysis; expected one or several of {', '.join(ANALYSES)}.", "sweep")
    if Analysis.CERTIFY in analyses:
        require_packages("sweep", "proof", "flint")
    if allowed is not None and not PREFIX.keys() & set(analyses):
        raise ArgumentError(
            "allow", f" is {allow!r} and run has no cycles; expected one of {', '.join(PREFIX)} in it.", "sweep"
        )
    known = case.to_system().signals.names
    main = case.expected.signal or known[0]
    main = main if allowed is None else allowed.signal
    chosen = (main,) if signals is None else known if signals == ALL else signals
    chosen = (chosen,) if isinstance(chosen, str) else tuple(chosen)
    for name in chosen:
        if name not in known:
            raise EppError(f"sweep: there is no signal {name!r}; expected one of {', '.join(known)}.")
    if signals == ALL:
        chosen = (main, *(name for name in known if name != main))
    if not chosen:
        raise EppError(f"sweep: there is no signal to report; expected one of {', '.join(known)}.")
    return Task(case, axes, tuple(dict.fromkeys(analyses)), tuple(dict.fromkeys(chosen)), allowed)


def _allowed(case: Case, allow: str) -> Allowed:
    """What is allowed; without it a sweep needs none of what bounds need."""
    from eppanalysis.methods.bounds.sizes.allowed import Allowed

    return Allowed.read(case.to_system(), allow)


def _size_variables(analysis: Analysis, allowed: Allowed) -> dict[str, Variable]:
    """What there is to say beside a limit cycle that is allowed."""
    prefix = PREFIX[analysis]
    method = words(prefix)
    size = f"{method}{allowed.measure} of {allowed.signal} (of the largest stable cycle that counts)"
    return {
        f"{prefix}allowed": Variable("i1", "", f"{method}outcome, {allowed} allowed", Allowance.words()),
        f"{prefix}size": Variable("f8", allowed.unit, size),
    }


def _analysis_variables(analysis: Analysis, signals: Sequence[str], units: Mapping[str, str]) -> dict[str, Variable]:
    prefix, method = PREFIX[analysis], words(PREFIX[analysis])
    found = {f"{prefix}outcome": Variable("i1", "", f"{method}outcome", Outcome.words())}
    for i, name in enumerate(signals):
        tail = f"_{name}" if i else ""
        size = f"{method}peak to peak of {name} (zero at rest)"
        found[f"{prefix}peak_to_peak{tail}"] = Variable("f8", units[name], size)
        found[f"{prefix}mean{tail}"] = Variable("f8", units[name], f"{method}mean of {name} (bias), or where it rests")
    found[f"{prefix}frequency"] = Variable("f8", "Hz", f"{method}frequency of the limit cycle")
    if analysis is Analysis.SIMULATE:
        found["events"] = Variable("i4", "", "switches of all elements in the run")
        found["last_event"] = Variable("f8", "s", "time of the last switch")
        found["change"] = Variable("f8", "1", "change of the cycle still to come, relative to its size")
    else:
        found[f"{prefix}stable_cycles"] = Variable("i4", "", f"number of {method}stable limit cycles")
        found[f"{prefix}unstable_cycles"] = Variable("i4", "", f"number of {method}limit cycles not known to be stable")
        found[f"{prefix}error"] = Variable("f8", "1", f"estimated relative error of the {method}cycle")
    if analysis is Analysis.CYCLES:
        found["exact_stability"] = Variable(
            "i1", "", "whether an exact cycle is stable, or all are not", Stability.words()
        )
        text = "largest Floquet multiplier of the stable cycle: the share of a disturbance that is left a period on"
        found["exact_multiplier"] = Variable("f8", "1", text)
    return found
