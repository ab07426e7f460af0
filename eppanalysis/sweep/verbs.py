"""What a sweep computes in a cell: columns of numbers by verb, a status for every cell, a sentence where it failed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.case import Case
from eppanalysis.errors import EppError
from eppanalysis.methods.batch import HybridStack, simulate_batch
from eppanalysis.results import LimitCycle, Status
from eppanalysis.sweep.axes import Axes, Design, make_design
from eppanalysis.sweep.cells import Builder, case_of, make_builder, sentence

IntArray = NDArray[np.int64]
Columns = dict[str, NDArray[Any]]

VERBS = ("simulate", "predict", "cycles")
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
_OUTCOME_OF = {Status.SETTLED: 1, Status.LIMIT_CYCLE: 2, Status.DIVERGED: 3}


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

    def variables(self) -> dict[str, Variable]:
        """All results, in order."""
        system = self.case.to_system()
        units = dict(zip(system.signals.names, system.signals.units or ("",) * len(system.signals.names), strict=True))
        found: dict[str, Variable] = {}
        for verb in self.verbs:
            found |= _verb_variables(verb, self.signals, units)
        if {"simulate", "predict"} <= set(self.verbs):
            for name in ("amplitude", "frequency"):
                text = f"relative error of the first-order {name} against the run: predicted / simulated - 1"
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
    verbs = (run,) if isinstance(run, str) else tuple(run)
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
    return found


@dataclass(frozen=True, eq=False)
class Work:
    """A task made ready to compute blocks of cells; equal for equal tasks, wherever it is made."""

    task: Task
    design: Design
    builder: Builder

    @classmethod
    def of(cls, task: Task) -> Work:
        """Make ready."""
        design = make_design(task.case, task.axes)
        fast = "simulate" in task.verbs and not task.case.to_system().time_step
        return cls(task, design, make_builder(task.case, design) if fast else Builder(task.case, design))

    def block(self, bounds: Sequence[tuple[int, int]]) -> Columns:
        """Results of a block of cells, the last axis fastest; never raises for a cell.

        Parameters
        ----------
        bounds : sequence of (first, last + 1)
            By dimension.
        """
        places = np.indices([stop - start for start, stop in bounds]).reshape(len(bounds), -1).T
        places = places + np.array([start for start, _ in bounds])
        out = {name: variable.empty(len(places)) for name, variable in self.task.variables().items()}
        for verb in self.task.verbs:
            if verb == "simulate":
                self._simulate(places, out)
            else:
                self._search(verb, places, out)
        if "first_order_error_amplitude" in out:
            with np.errstate(all="ignore"):
                for name in ("amplitude", "frequency"):
                    both = (out["outcome"] == 2) & (out["predicted_outcome"] == 2)
                    ratio = out[f"predicted_{name}"] / out[name] - 1.0
                    out[f"first_order_error_{name}"] = np.where(both & np.isfinite(ratio), ratio, np.nan)
        return out

    def _simulate(self, places: IntArray, out: Columns) -> None:
        if self.task.case.to_system().time_step:
            for row in range(len(places)):
                self._guarded(row, places, out, self._iterate)
            return
        stacks, wrong = self.builder.stacks(places)
        for row, text in wrong.items():
            _fail(out, row, text)
        for rows, stack in stacks:
            self._run_stack(rows, stack, out)

    def _run_stack(self, rows: IntArray, stack: HybridStack, out: Columns) -> None:
        try:
            result = simulate_batch(stack, self.task.case.t_end)
        except Exception as error:
            for row in rows.tolist():
                _fail(out, row, sentence(error))
            return
        for name, values in (
            ("frequency", 1.0 / result.period),
            ("events", result.events),
            ("last_event", result.last_event),
            ("change", result.change),
        ):
            out[name][rows] = values
        for i, signal in enumerate(self.task.signals):
            tail = f"_{signal}" if i else ""
            out[f"amplitude{tail}"][rows] = 0.5 * result.peak_to_peak[signal]
            out[f"mean{tail}"][rows] = result.mean[signal]
        out["status"][rows] = [STATUS_CODE[s] for s in result.status]
        out["outcome"][rows] = [_OUTCOME_OF.get(s, 0) for s in result.status]

    def _iterate(self, row: int, case: Case, out: Columns) -> None:
        """A loop in discrete time, one by one."""
        from eppanalysis.methods.simulate import simulate

        run = simulate(case.to_system(), case.input, case.t_end)
        out["status"][row], out["outcome"][row] = STATUS_CODE[run.status], _OUTCOME_OF.get(run.status, 0)
        out["events"][row] = len(run.events)
        if run.events:
            out["last_event"][row] = run.events[-1].time
        cycle = run.limit_cycle
        for i, signal in enumerate(self.task.signals):
            tail = f"_{signal}" if i else ""
            if cycle is not None:
                out[f"amplitude{tail}"][row] = 0.5 * cycle.peak_to_peak[signal]
                out[f"mean{tail}"][row] = cycle.mean[signal]
            elif signal in run.settled_at:
                out[f"amplitude{tail}"][row], out[f"mean{tail}"][row] = 0.0, run.settled_at[signal]
        if cycle is not None:
            out["frequency"][row], out["change"][row] = cycle.frequency, cycle.error_estimate

    def _search(self, verb: str, places: IntArray, out: Columns) -> None:
        search = self._predict if verb == "predict" else self._cycles
        for row in range(len(places)):
            if out["status"][row] != FAILED:
                self._guarded(row, places, out, search)

    def _guarded(self, row: int, places: IntArray, out: Columns, compute: Any) -> None:
        try:
            compute(row, case_of(self.task.case, self.design, places[row]), out)
        except Exception as error:
            _fail(out, row, sentence(error))

    def _predict(self, row: int, case: Case, out: Columns) -> None:
        from eppanalysis.methods.describing import predict_limit_cycles

        found = predict_limit_cycles(case.to_system(), case.final_input())
        self._fill(PREFIX["predict"], row, found.cycles, out)
        if out["status"][row] == NOT_RUN:
            out["status"][row] = STATUS_CODE[found.status]

    def _cycles(self, row: int, case: Case, out: Columns) -> None:
        from eppanalysis.methods.cycles import find_limit_cycles

        found = find_limit_cycles(case.to_system(), case.final_input())
        self._fill(PREFIX["cycles"], row, found.cycles, out)
        if out["status"][row] == NOT_RUN:
            out["status"][row] = STATUS_CODE[found.status]

    def _fill(self, prefix: str, row: int, cycles: Sequence[LimitCycle], out: Columns) -> None:
        """Counts, and the largest stable cycle."""
        stable = [c for c in cycles if c.stable]
        out[f"{prefix}stable_cycles"][row] = len(stable)
        out[f"{prefix}unstable_cycles"][row] = len(cycles) - len(stable)
        out[f"{prefix}outcome"][row] = 2 if stable else 1
        if not stable:
            return
        cycle = max(stable, key=lambda c: c.peak_to_peak[self.task.main_signal])
        out[f"{prefix}frequency"][row], out[f"{prefix}error"][row] = cycle.frequency, cycle.error_estimate
        for i, signal in enumerate(self.task.signals):
            tail = f"_{signal}" if i else ""
            out[f"{prefix}amplitude{tail}"][row] = 0.5 * cycle.peak_to_peak[signal]
            out[f"{prefix}mean{tail}"][row] = cycle.mean[signal]


def _fail(out: Columns, row: int, text: str) -> None:
    """A cell that could not be computed, and why."""
    out["status"][row], out["message"][row] = FAILED, text
