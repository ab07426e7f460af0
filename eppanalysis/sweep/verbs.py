"""What a sweep reports of a cell: columns of numbers by verb, a status for every cell, a sentence where it failed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.case import Case
from eppanalysis.errors import EppError
from eppanalysis.results import Status
from eppanalysis.sweep.axes import Axes

IntArray = NDArray[np.int64]
Columns = dict[str, NDArray[Any]]

VERBS = ("simulate", "predict", "cycles", "knock")
#: Prefix of a verb's variables; the run in time has the plain names.
PREFIX = {"simulate": "", "predict": "predicted_", "cycles": "exact_"}
#: Statuses by their code; 0 marks a cell that has not been computed, the last one a cell that could not be.
NOT_RUN, FAILED = 0, len(Status) + 1
STATUS_CODE = {status: code for code, status in enumerate(Status, start=1)}
STATUS_NAMES = ("not_run", *(status.name.lower() for status in Status), "failed")
STATUS_SENTENCES = (
    "The cell has not been computed yet.",
    *(status.value for status in Status),
    "The cell could not be computed; its message says why.",
)
OUTCOMES = ("unknown", "settles", "oscillates", "diverges")
STABILITIES = ("unknown", "no_cycle", "stable", "unstable")
KNOCKS = ("unknown", "no_cycle", "starts", "holds", "no_rest")


@dataclass(frozen=True)
class Variable:
    """A result: its type ("f8", "i4", "i1" or "text"), unit and meaning."""

    dtype: str
    unit: str = ""
    long_name: str = ""
    flags: tuple[str, ...] = ()

    @property
    def fill(self) -> Any:
        """What stands in a cell without a result."""
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
            found["units"] = self.unit
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
    verbs: tuple[str, ...]
    signals: tuple[str, ...]

    @property
    def main_signal(self) -> str:
        """The signal whose results have the plain names."""
        return self.signals[0]

    def named_signals(self) -> list[tuple[str, str]]:
        """Tail of the variables' names, and signal; the main one has none."""
        return [(f"_{name}" if i else "", name) for i, name in enumerate(self.signals)]

    @property
    def judge(self) -> str | None:
        """The verb by which predictions are judged: the run in time, or the exact cycle where there is no run."""
        if "predict" not in self.verbs:
            return None
        return next((verb for verb in ("simulate", "cycles") if verb in self.verbs), None)

    @property
    def knocked(self) -> str:
        """The external input that is knocked; the first state where there is none."""
        system = self.case.to_system()
        return (*system.input_names, *system.state_names)[0]

    def _knock_variables(self) -> dict[str, Variable]:
        unit = self.case.input_unit if self.case.to_system().input_names else ""
        name = self.knocked
        found = {"knock_outcome": Variable("i1", "", f"what a knock of {name} at rest does", KNOCKS)}
        for tail, way in (("", "either way"), ("_up", "upwards"), ("_down", "downwards")):
            text = f"smallest step of {name} {way} that starts a limit cycle from rest"
            found[f"knock{tail}"] = Variable("f8", unit, text)
        return found

    def variables(self) -> dict[str, Variable]:
        """All results, in order."""
        system = self.case.to_system()
        units = dict(zip(system.signals.names, system.signals.units or ("",) * len(system.signals.names), strict=True))
        found: dict[str, Variable] = {}
        for verb in self.verbs:
            found |= self._knock_variables() if verb == "knock" else _verb_variables(verb, self.signals, units)
        if self.judge is not None:
            whom = "run" if self.judge == "simulate" else "exact cycle"
            for name in ("amplitude", "frequency"):
                text = f"relative error of the first-order {name} against the {whom}: predicted / true - 1"
                found[f"first_order_error_{name}"] = Variable("f8", "1", text)
        found["status"] = Variable("i1", "", "how the computation of the cell ended", STATUS_NAMES)
        found["message"] = Variable("text", "", "why a cell failed")
        return found


def make_task(case: Case, axes: Axes, run: str | Sequence[str], signals: str | Sequence[str] | None) -> Task:
    """The task of a sweep.

    Raises
    ------
    EppError
        If there is no such verb or signal.
    """
    verbs = VERBS if run == "all" else (run,) if isinstance(run, str) else tuple(run)
    for verb in verbs:
        if verb not in VERBS:
            raise EppError(f"sweep: run is {verb!r}; expected one or several of {', '.join(VERBS)}.")
    if not verbs:
        raise EppError(f"sweep: run names no verb; expected one or several of {', '.join(VERBS)}.")
    known = case.to_system().signals.names
    main = case.expected.signal or known[0]
    chosen = (main,) if signals is None else known if signals == "all" else signals
    chosen = (chosen,) if isinstance(chosen, str) else tuple(chosen)
    for name in chosen:
        if name not in known:
            raise EppError(f"sweep: there is no signal {name!r}; expected one of {', '.join(known)}.")
    if signals == "all":
        chosen = (main, *(name for name in known if name != main))
    if not chosen:
        raise EppError(f"sweep: there is no signal to report; expected one of {', '.join(known)}.")
    return Task(case, axes, tuple(dict.fromkeys(verbs)), tuple(dict.fromkeys(chosen)))


def _verb_variables(verb: str, signals: Sequence[str], units: Mapping[str, str]) -> dict[str, Variable]:
    prefix, words = PREFIX[verb], {"simulate": "", "predict": "predicted ", "cycles": "exact "}[verb]
    found = {f"{prefix}outcome": Variable("i1", "", f"{words}outcome", OUTCOMES)}
    for i, name in enumerate(signals):
        tail = f"_{name}" if i else ""
        half = f"{words}amplitude of {name} (half of its peak-to-peak)"
        found[f"{prefix}amplitude{tail}"] = Variable("f8", units[name], half)
        found[f"{prefix}mean{tail}"] = Variable("f8", units[name], f"{words}mean of {name} (bias), or where it rests")
    found[f"{prefix}frequency"] = Variable("f8", "Hz", f"{words}frequency of the limit cycle")
    if verb == "simulate":
        found["events"] = Variable("i4", "", "switches of all elements in the run")
        found["last_event"] = Variable("f8", "s", "time of the last switch")
        found["change"] = Variable("f8", "1", "change of the cycle still to come, relative to its size")
    else:
        found[f"{prefix}stable_cycles"] = Variable("i4", "", f"number of {words}stable limit cycles")
        found[f"{prefix}unstable_cycles"] = Variable("i4", "", f"number of {words}limit cycles not known to be stable")
        found[f"{prefix}error"] = Variable("f8", "1", f"estimated relative error of the {words}cycle")
    if verb == "cycles":
        found["exact_stability"] = Variable("i1", "", "whether an exact cycle is stable, or all are not", STABILITIES)
        text = "largest Floquet multiplier of the stable cycle: the share of a disturbance that is left a period on"
        found["exact_multiplier"] = Variable("f8", "1", text)
    return found
