"""Computes the cells of a sweep, block by block; a cell that cannot be computed gets a status and a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arrays import IntArray
from eppanalysis.cases import Case
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.results import LimitCycle, Status
from eppanalysis.sweep.analyses import (
    FAILED,
    NOT_RUN,
    PREFIX,
    STATUS_CODE,
    Allowance,
    Analysis,
    Columns,
    Outcome,
    Proved,
    Stability,
    Task,
    TriggerOutcome,
)
from eppanalysis.sweep.axes import Design, make_design
from eppanalysis.sweep.cells import Builder, case_of, make_builder, sentence
from eppanalysis.workers import one_thread

if TYPE_CHECKING:
    from eppanalysis.methods.search.result import CycleSearch

_OUTCOME_OF = {
    Status.SETTLED: Outcome.SETTLES,
    Status.LIMIT_CYCLE: Outcome.OSCILLATES,
    Status.DIVERGED: Outcome.DIVERGES,
}
_ALLOWANCE_OF = {
    Status.SETTLED: Allowance.SETTLES,
    Status.LIMIT_CYCLE: Allowance.WITHIN,
    Status.DIVERGED: Allowance.DIVERGES,
}


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
        fast = Analysis.SIMULATE in task.analyses and not _alone(task.case)
        return cls(task, design, make_builder(task.case, design) if fast else Builder(task.case, design))

    @property
    def batched(self) -> bool:
        """Whether cells are computed many at a time, and by nothing else."""
        return self.task.analyses == (Analysis.SIMULATE,) and not _alone(self.task.case)

    @one_thread()
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
        one_by_one: list[Analysis] = [analysis for analysis in self.task.analyses if analysis is not Analysis.SIMULATE]
        if Analysis.SIMULATE in self.task.analyses:
            if _alone(self.task.case):
                one_by_one.insert(0, Analysis.SIMULATE)
            else:
                self._simulate(places, out)
        if one_by_one:
            self._each(places, one_by_one, out)
        if self.task.judge is not None:
            _judge(PREFIX[self.task.judge], out)
        return out

    def _simulate(self, places: IntArray, out: Columns) -> None:
        stacks, wrong = self.builder.stacks(places)
        for row, text in wrong.items():
            _fail(out, row, text)
        ends = self._ends(places)
        for rows, stack in stacks:
            for t_end in np.unique(ends[rows]):
                chosen = ends[rows] == t_end
                part = stack if chosen.all() else stack.take(np.flatnonzero(chosen))
                self._run_stack(rows[chosen], part, float(t_end), out)

    def _ends(self, places: IntArray) -> np.ndarray:
        """How long the run of each cell is [s], shape (cells,)."""
        for axis, dimension in enumerate(self.design.dimensions):
            if "run.t_end" in dimension.values:
                return dimension.values["run.t_end"][places[:, axis]]
        return np.full(len(places), self.task.case.t_end)

    def _run_stack(self, rows: IntArray, stack: HybridStack, t_end: float, out: Columns) -> None:
        try:
            result = simulate_batch(stack, t_end)
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
        for tail, signal in self.task.named_signals():
            out[f"peak_to_peak{tail}"][rows] = result.peak_to_peak[signal]
            out[f"mean{tail}"][rows] = result.mean[signal]
        out["status"][rows] = [STATUS_CODE[s] for s in result.status]
        out["outcome"][rows] = [_OUTCOME_OF.get(s, 0) for s in result.status]
        allowed = self.task.allowed
        if allowed is not None:
            too_large = allowed.too_large(result)
            out["allowed"][rows] = [
                Allowance.EXCEEDS if large else _ALLOWANCE_OF.get(s, 0)
                for s, large in zip(result.status, too_large, strict=True)
            ]
            counted = (out["outcome"][rows] == Outcome.OSCILLATES) & allowed.counts(result.period)
            out["size"][rows] = np.where(counted, allowed.size_of_runs(result), np.nan)

    def _each(self, places: IntArray, analyses: Sequence[Analysis], out: Columns) -> None:
        """Analyses that take one cell at a time."""
        for row in range(len(places)):
            if out["status"][row] == FAILED:
                continue
            try:
                cell = _Cell(self.task, case_of(self.task.case, self.design, places[row]), row, out)
                for analysis in analyses:
                    getattr(cell, analysis)()
            except Exception as error:
                _fail(out, row, sentence(error))


@dataclass(eq=False)
class _Cell:
    """One cell under way: its analyses share what they need of each other."""

    task: Task
    case: Case
    row: int
    out: Columns

    @cached_property
    def search(self) -> CycleSearch:
        """All exact limit cycles."""
        from eppanalysis.methods.search.find import find_limit_cycles

        return find_limit_cycles(self.case)

    def put(self, name: str, value: float) -> None:
        """Keep a result."""
        self.out[name][self.row] = value

    def end(self, status: Status) -> None:
        """The status of the cell is that of its first analysis."""
        if self.out["status"][self.row] == NOT_RUN:
            self.put("status", STATUS_CODE[status])

    def simulate(self) -> None:
        """A loop in discrete time."""
        from eppanalysis.methods.search.simulate import simulate

        run = simulate(self.case)
        self.end(run.status)
        self.put("outcome", _OUTCOME_OF.get(run.status, 0))
        self.put("events", len(run.events))
        if run.events:
            self.put("last_event", run.events[-1].time)
        cycle = run.limit_cycle
        self.beside_allowed(Analysis.SIMULATE, [] if cycle is None else [cycle], _ALLOWANCE_OF.get(run.status, 0))
        if cycle is not None:
            self.put("frequency", cycle.frequency)
            self.put("change", cycle.error_estimate)
        for tail, signal in self.task.named_signals():
            if cycle is not None:
                self.put(f"peak_to_peak{tail}", cycle.peak_to_peak[signal])
                self.put(f"mean{tail}", cycle.mean[signal])
            elif signal in run.settled_at:
                self.put(f"peak_to_peak{tail}", 0.0)
                self.put(f"mean{tail}", run.settled_at[signal])

    def predict(self) -> None:
        """Describing functions."""
        from eppanalysis.methods.describing.predict import predict_limit_cycles

        found = predict_limit_cycles(self.case)
        stable = self._cycles(Analysis.PREDICT, found.cycles)
        self.put("predicted_outcome", Outcome.SETTLES if stable is None else Outcome.OSCILLATES)
        self.beside_allowed(Analysis.PREDICT, found.cycles, Allowance.SETTLES if stable is None else Allowance.WITHIN)
        self.end(found.status)

    def cycles(self) -> None:
        """Exact orbits."""
        found = self.search
        stable = self._cycles(Analysis.CYCLES, found.cycles)
        where = Outcome.SETTLES if found.settles else Outcome.DIVERGES if found.diverges else Outcome.UNKNOWN
        self.put("exact_outcome", where if stable is None else Outcome.OSCILLATES)
        otherwise = (
            Allowance.WITHIN if stable is not None else Allowance.SETTLES if found.settles else Allowance.UNKNOWN
        )
        # What the search left open may be larger.
        otherwise = Allowance.UNKNOWN if found.status is Status.UNDECIDED else otherwise
        self.beside_allowed(Analysis.CYCLES, found.cycles, Allowance.DIVERGES if found.diverges else otherwise)
        kind = Stability.UNSTABLE if stable is None else Stability.STABLE
        self.put("exact_stability", kind if len(found) else Stability.NO_CYCLE)
        if stable is not None and stable.multipliers is not None and stable.multipliers.size:
            self.put("exact_multiplier", float(np.max(np.abs(stable.multipliers))))
        self.end(found.status)

    def beside_allowed(self, analysis: Analysis, cycles: Sequence[LimitCycle], otherwise: int) -> None:
        """What the cell does beside a limit cycle that is allowed, by the largest one that counts; else `otherwise`."""
        allowed, prefix = self.task.allowed, PREFIX[analysis]
        if allowed is None:
            return
        too_large = allowed.largest(cycles)
        self.put(f"{prefix}allowed", otherwise if too_large is None else Allowance.EXCEEDS)
        counted = [c for c in cycles if c.stable is not False and allowed.counts(np.array(c.period))]
        if counted:
            self.put(f"{prefix}size", max(map(allowed.size_of, counted)))

    def trigger(self) -> None:
        """The smallest step that starts a cycle which coexists with rest."""
        from eppanalysis.methods.search.trigger import NoRest, trigger

        system = self.case.to_system()
        kind = TriggerOutcome.NO_CYCLE
        if self.search.stable:
            states = () if system.input_names else (self.task.disturbed,)
            try:
                found = [
                    k for k in trigger(self.case, cycles=self.search, states=states) if k.name == self.task.disturbed
                ]
                starts = [k for k in found if np.isfinite(k.size)]
                kind = TriggerOutcome.HOLDS if found else TriggerOutcome.UNKNOWN
                for k in starts:
                    self.put("trigger_up" if k.tried > 0 else "trigger_down", abs(k.size))
                if starts:
                    kind = TriggerOutcome.STARTS
                    self.put("trigger", min(abs(k.size) for k in starts))
            except NoRest:
                kind = TriggerOutcome.NO_REST
        self.put("trigger_outcome", kind)
        self.end(self.search.status)

    def certify(self) -> None:
        """Absence of cycles, or where that is not proved one of those that exist."""
        from eppanalysis.methods.certificates.certify import proof_of_absence
        from eppanalysis.methods.certificates.orbits.certify import proof_of_orbit

        kind = Proved.UNDECIDED
        if proof_of_absence(self.case)[0] is not None:
            kind = Proved.PROVED_FREE
        elif any(proof_of_orbit(self.case, cycle)[0] is not None for cycle in self.search):
            kind = Proved.PROVED_TO_OSCILLATE
        self.put("proved", kind)
        self.end(Status.INCOMPLETE if kind is Proved.UNDECIDED else Status.CONVERGED)

    def _cycles(self, analysis: Analysis, cycles: Sequence[LimitCycle]) -> LimitCycle | None:
        """Counts, and the largest stable cycle, which is returned."""
        prefix, stable = PREFIX[analysis], [c for c in cycles if c.stable]
        self.put(f"{prefix}stable_cycles", len(stable))
        self.put(f"{prefix}unstable_cycles", len(cycles) - len(stable))
        if not stable:
            return None
        cycle = max(stable, key=lambda c: c.peak_to_peak[self.task.main_signal])
        self.put(f"{prefix}frequency", cycle.frequency)
        self.put(f"{prefix}error", cycle.error_estimate)
        for tail, signal in self.task.named_signals():
            self.put(f"{prefix}peak_to_peak{tail}", cycle.peak_to_peak[signal])
            self.put(f"{prefix}mean{tail}", cycle.mean[signal])
        return cycle


def _alone(case: Case) -> bool:
    """Whether runs of a case are made one by one: in discrete time, and where samples never end."""
    return has_samples(case.to_system())


def _judge(truth: str, out: Columns) -> None:
    """Errors of the DF cycle where both it and the true one are there."""
    both = (out[f"{truth}outcome"] == Outcome.OSCILLATES) & (out["predicted_outcome"] == Outcome.OSCILLATES)
    with np.errstate(all="ignore"):
        for name in ("peak_to_peak", "frequency"):
            ratio = out[f"predicted_{name}"] / out[f"{truth}{name}"] - 1.0
            out[f"first_order_error_{name}"] = np.where(both & np.isfinite(ratio), ratio, np.nan)


def _fail(out: Columns, row: int, text: str) -> None:
    """A cell that could not be computed, and why."""
    out["status"][row], out["message"][row] = FAILED, text
