"""Event-exact runs of the engine, with a verdict: at rest, on a limit cycle, or undecided."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.engine.runs import ALWAYS, run, step_at_start, verdict_of_run
from eppanalysis.engine.workspace import (
    HISTORY,
    PAUSED,
    SINGULAR,
    STEP_LIMIT,
    Samples,
    Workspace,
    make_progress,
    make_samples,
)
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.budget import remaining, spend
from eppanalysis.methods.simulation.kept import EARLY, VERDICTS, Run, from_event
from eppanalysis.methods.simulation.period import advance, advances, analyse_period, moves_until, resting
from eppanalysis.methods.simulation.rounding import (
    BENEATH_ROUNDING,
    SAMPLES,
    is_lost,
    left_by_rounding,
    watched,
)
from eppanalysis.methods.simulation.samples import is_locked, judge_samples, locked_or_not, rests_since
from eppanalysis.methods.simulation.states import unobservable_apart
from eppanalysis.methods.simulation.times import base_step
from eppanalysis.methods.simulation.workspaces import of_thread
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem, of_model
from eppanalysis.models.systems.inputs import InputSignal, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import Strobe, sampled_among
from eppanalysis.models.systems.starts import remembered
from eppanalysis.results import SIMULATION, LimitCycle, Status, Trajectory
from eppanalysis.results.events import Events
from eppanalysis.results.provenance import Provenance

_KEPT_EVENTS, _KEPT_SAMPLES = 20_000, 200_000
#: What a run has counted, as the engine names it and as its statistics do.
_COUNTED = {
    "t": "time_reached",
    "count": "events",
    "i_sample": "samples",
    "fast_steps": "fast_steps",
    "series_steps": "series_steps",
    "forced_leaves": "forced_leaves",
    "periods_repeated": "periods_repeated",
}
#: A minute or two, if none of them can be saved.
MOST_STEPS = 10_000_000
#: What a search may compute is counted in series steps without smooth channels: so many are worth the set-up of a run,
#: one with delayed signals alone, and one with other smooth channels; so many fast steps are worth one.
_SET_UP, _DELAYED, _SMOOTH, _FAST_STEPS = 200.0, 5.0, 20.0, 20.0
#: A state beyond this has diverged, in a run that rounding has stopped.
_LARGEST_STATE = 1e100
#: Changes from period to period, relative to the cycle's size, that may be rounding.
_STANDING = 1e-9


def run_in_time(
    system: LureSystem,
    input: InputSignal | Mapping[str, InputSignal] | None,
    t_end: float,
    times: Array,
    even: bool,
    max_events: int = 200_000,
    max_steps: int = MOST_STEPS,
    step: float | None = None,
) -> Trajectory:
    """A run of a loop in continuous time, its signals at times (nt,) that are the usual `even` ones or not."""
    if (apart := unobservable_apart(system)) is not None:
        system = apart.system
    given = input_signals_by_name(system.input_names, input)
    for observed in (False, True):  # curved elements may repeat themselves without a switch: extrema tell it
        hybrid = HybridSystem.from_lure(system, given, observed)
        base = step or base_step(times, even, hybrid)
        samples = 0 if (strobe := Strobe.of(hybrid)) is None else strobe.samples_in(t_end)
        kept = _KEPT_EVENTS + min(samples, _KEPT_SAMPLES)
        run = run_hybrid(hybrid, t_end, times, base, max_events + samples, kept, max_steps)
        status, found = judge(hybrid, run, t_end)
        if status is not Status.UNDECIDED or not (hybrid.may_be_quiet and run.is_quiet_at(t_end)):
            break
    lost = repeats_undecided(status, found)
    signals = _signals(system.signals.names, run)
    n_written = int(run.stats[2])
    settings = {"t_end": t_end, "step": base, "max_events": max_events, "max_steps": max_steps, "system": system.name}
    facts = Provenance("event-exact simulation", settings, statistics=_statistics(run))
    at = OperatingPoint.of(system, input, t_end)
    cycle = cycle_of_run(system, hybrid, run, found, facts, at) if status is Status.LIMIT_CYCLE else None
    if status is Status.LIMIT_CYCLE and cycle is None:
        status = Status.UNDECIDED
    settled, early = status is Status.SETTLED, run.why_early(t_end)
    rest = resting(signals, advance(hybrid, run.rate_end) * t_end) if settled and n_written else {}
    again = partial(_at_times, hybrid, system.signals.names, base, max_events + samples, max_steps)
    return Trajectory(
        t=times[:n_written],
        signals=signals,
        events=_events(hybrid, run),
        status=status,
        limit_cycle=apart.to_user(cycle) if apart and cycle else cycle,
        settled_at=rest,
        settled_since=max(_since(hybrid, run, found), moves_until(times, signals, rest)) if status.ok else float("nan"),
        n_events=run.count,
        note=BENEATH_ROUNDING if lost else (early and hybrid.chatters) or early,
        units=system.signals.units_of_results(),
        provenance=facts,
        operating_point=at,
        again=again,
    )


def _signals(names: tuple[str, ...], run: Run) -> dict[str, Array]:
    """The named signals at the times that a run has reached."""
    return dict(zip(names, run.samples[: int(run.stats[2])].T.copy(), strict=True))


def _at_times(
    hybrid: HybridSystem, names: tuple[str, ...], base: float, max_events: int, max_steps: int, times: Array
) -> dict[str, Array]:
    """Signals of a run at other times, for which it is made anew."""
    return _signals(names, run_hybrid(hybrid, float(times[-1]), times, base, max_events, 1, max_steps))


@of_model
def _of_smooth(hybrid: HybridSystem) -> tuple[bool, float]:
    """Whether inputs step at the start, before which a dead time still has what the elements put out until then, and
    what a step is worth.
    """
    model, late = hybrid.model, hybrid.model.smooth_kind == DELAY_LINE
    cost = (_DELAYED if np.all(late) else _SMOOTH) if late.size else 1.0
    return bool(np.any(late) and np.any(model.breakpoint_time <= 0.0)), cost


@cache
def _without_samples(n_y: int) -> Samples:
    """Workspace for signals at no times, which nothing is written to."""
    return make_samples(np.zeros(0), n_y)


def without_memory(hybrid: HybridSystem) -> BoolArray:
    """Automata whose mode follows from their input alone."""
    static = [len(e.breakpoints) > 0 for e in hybrid.elements]
    return np.array(static + [False] * (len(hybrid.automata) - len(static)))


def _begin(hybrid: HybridSystem, workspace: Workspace, modes: IntArray) -> None:
    """Put a run at its start."""
    workspace.x[: hybrid.x0.size], workspace.modes[:], workspace.H[:] = hybrid.x0, modes, hybrid.H0


def _write_past(hybrid: HybridSystem, workspace: Workspace, past: Array) -> None:
    """What delayed outputs (lines,) have been until the start, where the engine reads what it has put out itself."""
    lines = np.flatnonzero(hybrid.model.smooth_kind == DELAY_LINE)
    workspace.line_t[lines, 0], workspace.line_h[lines, 0] = (-ALWAYS, 0.0), 2.0 * ALWAYS
    workspace.line_c[lines, 0] = 0.0
    workspace.line_c[lines, 0, 0] = past
    workspace.line_n[lines] = 1, 0


def run_hybrid(
    hybrid: HybridSystem,
    t_end: float,
    times: Array,
    base: float,
    max_events: int,
    keep: int,
    max_steps: int = MOST_STEPS,
    past: Array | None = None,
) -> Run:
    """One run of the compiled engine; until now delayed outputs were `past`, by default what they are at the start.

    Raises
    ------
    EppError
        If a combination of modes has no unique solution, or a dead time is too long for its history.
    BudgetExceeded
        If the search that it belongs to may compute no more.
    """
    spend(_SET_UP)
    (compiled, work, workspace), buffer = (
        of_thread.workspaces(hybrid, base),
        of_thread.buffer(hybrid, max(1, min(keep, max_events))),
    )
    n, n_y, (past_known, cost) = hybrid.x0.size, hybrid.model.Yx.shape[0], _of_smooth(hybrid)
    _begin(hybrid, workspace, hybrid.modes0)
    most = min(float(max_steps), remaining() / cost)
    samples = make_samples(times, n_y) if times.size else _without_samples(n_y)
    now = make_progress(t_end, base, max_events, most)
    if past is not None:
        _write_past(hybrid, workspace, past)
    elif past_known:
        step_at_start(
            hybrid.model, compiled, work, workspace, _without_samples(n_y), buffer, now, hybrid.x0, hybrid.modes0,
            hybrid.H0, without_memory(hybrid),
        )  # fmt: skip
    now["past_known"] = past_known or past is not None
    code = PAUSED
    while code == PAUSED:  # between the calls an interrupt is heard
        code = run(hybrid.model, compiled, work, workspace, samples, buffer, now)
    stats = np.array(now[list(_COUNTED)].item(), float)
    made = int(now["series_steps"]) + int(now["refused_series"]) + int(now["fast_steps"]) / _FAST_STEPS
    spend(cost * (most if code == STEP_LIMIT else made))
    if code == SINGULAR:
        unsolved = "the loop has no unique solution in one combination of modes"
        raise EppError(
            f"simulate: {unsolved} (an algebraic loop through the elements); expected a state or a dead time in it, or "
            "values of ordinary magnitude."
        )
    if code == HISTORY:
        raise EppError("simulate: the dead time spans more switches than its history holds; expected a shorter one.")
    count = int(now["count"])
    t, guard, states, rates, memory, passed = (a[: max(1, count)].copy() for a in buffer)
    low, high, x_end, rate_end = (a[:n].copy() for a in (workspace.low, workspace.high, workspace.x, workspace.rate))
    return Run(
        code, samples.out[:, :n_y], count, t, guard, states, rates, memory, passed, low, high, x_end, rate_end, stats
    )  # fmt: skip


def judge(hybrid: HybridSystem, run: Run, t_end: float) -> tuple[Status, Array]:
    """Status of a run, and for a cycle: its events, period, change over the last period, extrapolated change.

    A run that repeats itself while rounding hides what its elements do has these, too, and is undecided.
    """
    if run.code in EARLY:
        status, found = EARLY[run.code], np.zeros(4)
        last = np.concatenate([run.x_end, *run.memory_values[run.order[-1:]]])
        if not np.all(np.abs(last) < _LARGEST_STATE):
            return Status.DIVERGED, found
        if run.is_out_of_events and Strobe.of(hybrid) is None:
            # Those switches that were met may tell the cycle: what does not close to rounding is not carried on.
            status, found = judge(hybrid, replace(run, code=0), float(run.stats[0]))
        return (status, found) if status is Status.LIMIT_CYCLE else (EARLY[run.code], np.zeros(4))
    strobe, found = Strobe.of(hybrid), np.zeros(4)
    if strobe is not None:
        return judge_samples(strobe, run, t_end)
    code = verdict_of_run(
        hybrid.model, run.time, run.guard, run.state, run.rate, run.count, t_end, run.low, run.high, run.x_end,
        run.rate_end, hybrid.compared, found,
    )  # fmt: skip
    status = VERDICTS[int(code)]
    if status is Status.LIMIT_CYCLE:
        last = run.order[-int(found[0]) - 1 :]
        states = run.state[last]
        # States are kept at events alone: how far they go between them follows from the rates there.
        moves = np.ptp(states, axis=0) + np.abs(run.rate[last]).max(axis=0) * found[1]
        held = run.memory_values[last]
        reached = np.maximum(np.abs(run.low), np.abs(run.high))
        rounding, may_be_lost = left_by_rounding(hybrid, states, held, moves, found[1], reached)
        if rounding:
            return Status.SETTLED, np.zeros(4)
        if may_be_lost and _loses_elements(hybrid, run, found):
            return Status.UNDECIDED, found
    return status, found


def repeats_undecided(status: Status, found: Array) -> bool:
    """Whether `judge` says of a run that it repeats itself and that rounding hides what its elements do."""
    return status is Status.UNDECIDED and found.size == 4 and bool(found[0])


def _loses_elements(hybrid: HybridSystem, run: Run, found: Array) -> bool:
    """Whether a run is on a cycle on which what its elements change in a period is beneath rounding."""
    period, end = float(found[1]), float(run.time[run.order[-1]])
    start, begin = from_event(hybrid, run, int(run.order[-int(found[0]) - 1]))
    # What the verdict lets pass as rounding: changes from period to period, and that of times in states that swing.
    changes = min(max(found[2], found[3], 1e-15 * 2.0 * np.pi * end / period), _STANDING)
    return loses_elements(start, end - begin, period, changes, 2 * run.count + 100)


def loses_elements(
    start: HybridSystem, end: float, period: float, changes: float, max_events: int = _KEPT_EVENTS
) -> bool:
    """Whether what the elements change in the last period of a run until `end` is beneath rounding, see `is_lost`."""
    # Not at the switches themselves, where a force may have its only peak.
    times = end - period * (1.0 - (np.arange(SAMPLES) + 0.5) / SAMPLES)
    again = run_hybrid(watched(start), end, times, 2.0 * start.time_scale, max_events, 1)
    signals = again.samples[: int(again.stats[2])]
    return len(signals) > 0 and is_lost(start, signals, period, changes)


def _statistics(run: Run) -> dict[str, Any]:
    return {name: float(run.stats[i]) if i == 0 else int(run.stats[i]) for i, name in enumerate(_COUNTED.values())}


def _events(hybrid: HybridSystem, run: Run, first: int = 0, origin: float = 0.0) -> Events:
    """The kept events from place `first` on, as sentences."""
    rows = run.order[first:]
    return named_events(hybrid, run.time[rows] - origin, run.guard[rows], run.modes[rows])


def named_events(hybrid: HybridSystem, times: Array, guards: IntArray, modes: IntArray) -> Events:
    """Switches in words, from their times, guards (n,), and the modes of all elements after each, shape (n, E)."""
    words = _words_of(hybrid)
    listed = words.listed[guards].nonzero()[0]
    times, guards = times[listed], guards[listed]
    # A guard is one of one element, whose mode after it makes the second half of what happened.
    kinds = guards * words.most + modes[listed, hybrid.model.guard_element[guards]]
    return Events(times, kinds, {kind: words[kind] for kind in sorted(set(kinds.tolist()))})


class _Words(dict[int, tuple[str, str, str]]):
    """Element, guard and mode in words, by the number of what happened."""

    def __init__(self, hybrid: HybridSystem) -> None:
        super().__init__()
        self.hybrid, self.most = hybrid, int(np.diff(hybrid.model.mode_first).max(initial=0))
        # Not that a controller takes a sample, nor that the observer behind the elements marks an extremum.
        told = [i for i in range(len(hybrid.elements)) if i not in sampled_among(hybrid.elements)]
        self.listed = np.isin(hybrid.model.guard_element, told)

    def __missing__(self, kind: int) -> tuple[str, str, str]:
        guard, mode = divmod(kind, self.most)
        e = int(self.hybrid.model.guard_element[guard])
        self[kind] = self.hybrid.element_names[e], self.hybrid.guard_name(guard), self.hybrid.mode_name(e, mode)
        return self[kind]


_words_of = of_model(_Words)


def _since(hybrid: HybridSystem, run: Run, found: Array) -> float:
    """Time of the last switch before rest, or the begin of the first period that already repeats to a thousandth."""
    if run.count == 0:
        return 0.0
    strobe = Strobe.of(hybrid)
    if strobe is not None and not (found[0] and found[5] == 0.0):
        return rests_since(strobe, run, found)
    last = run.order[-1]
    if found[0] == 0:
        # The turns of a motion that the observer marks behind the elements are no switches: it dies out through them.
        switches = run.switches(hybrid)
        return float(run.time[switches[-1]]) if switches.size else 0.0
    p = int(found[0])
    period = run.order[-p - 1 :]
    # What switches an element is on its threshold at every event, and moves between them.
    scale = np.maximum(np.ptp(run.state[period], axis=0), 0.1 * np.abs(run.rate[period]).max(axis=0) * float(found[1]))
    # A clock and the input go on for ever and do not belong to the motion.
    scale = np.where((scale > 0) & hybrid.compared, scale, np.inf)
    turns = run.order[run.n_kept - 1 - p :: -p]
    moved = np.max(np.abs(np.diff(run.state[turns], axis=0)) / scale, axis=1)
    other = (run.guard[turns[1:]] != run.guard[turns[:-1]]) | (moved > 1e-3)
    repeated = int(run.stats[-1])
    if repeated and not np.any(other) and run.count > run.n_kept:
        # What the run was carried over has taken the place of all that came before.
        most, end = run.count - repeated * p, float(run.time[last]) - repeated * float(found[1])
        return _since(hybrid, run_hybrid(hybrid, end, np.zeros(0), 2.0 * hybrid.time_scale, most, most), found)
    first = int(np.argmax(other)) if np.any(other) else -1
    return float(run.time[turns[first]])


def cycle_of_run(
    system: LureSystem,
    hybrid: HybridSystem,
    run: Run,
    found: Array,
    facts: Provenance,
    at: OperatingPoint | None = None,
) -> LimitCycle | None:
    """The last period of a run, sampled once more on the arcs between its events; None where that cannot be done.

    Parameters
    ----------
    system : LureSystem
        The loop, as `hybrid` has it.
    hybrid : HybridSystem
        As the run was started.
    run : Run
        With more events in its event buffer than a period has.
    found : array
        What `judge` says of the cycle.
    facts : Provenance
    at : OperatingPoint, optional
        Where the inputs are held.
    """
    p, period = int(found[0]), float(found[1])
    marks = run.time[run.order[-p - 1 :]]
    first, strobe = int(run.order[-p - 1]), Strobe.of(hybrid)
    gained = advance(hybrid, run.state[run.order[-1]] - run.state[first])

    def sample(times: Array, place: int = first) -> Array:
        start, begin = from_event(hybrid, run, place)
        again = run_hybrid(
            start, float(marks[-1]) - begin, times - begin, 2.0 * hybrid.time_scale, 2 * run.count + 100, 1
        )
        signals = again.samples[: int(again.stats[2])]
        return signals - np.outer(times[: len(signals)] - marks[0], gained / period) if np.any(gained) else signals

    try:
        shape = analyse_period(marks, system.delays, hybrid.time_scale, system.signals.names, sample)
    except EppError:
        return None
    size = shape.peak_to_peak
    if strobe is not None and not is_locked(found):
        # Its turns differ: it is as large as the largest of those that were compared.
        since = int(run.order[int(np.searchsorted(run.time[run.order], found[6]))])
        count = shape.time.size * round((marks[-1] - run.time[since]) / period)
        whole = np.ptp(sample(np.linspace(run.time[since], marks[-1], count), since), axis=0)
        size = {name: max(size[name], float(all_)) for name, all_ in zip(size, whole, strict=True)}
    return LimitCycle(
        method=SIMULATION,
        status=Status.CONVERGED,
        note="; ".join([*([] if strobe is None else [locked_or_not(strobe, found)]), *advances(system, gained, shape)]),
        period=period,
        mean=shape.mean,
        peak_to_peak=size,
        harmonics=shape.harmonics,
        stable=True,
        stability_criterion="reached in simulation",
        residual=float(found[2]),
        error_estimate=float(found[3]),
        events=_events(hybrid, run, run.n_kept - p, float(marks[0])),
        time=shape.time,
        waveform=shape.waveform,
        state=run.state[first, : hybrid.n_plant].copy(),
        event_states=run.state[run.order[-p - 1 : -1], : hybrid.n_plant].copy(),
        memory=remembered(hybrid, run.state[first], run.memory_values[first], run.modes[first]),
        units=system.signals.units_of_results(),
        provenance=facts,
        operating_point=at,
    )
