"""What a motion comes to beyond the end of its run: it is carried on until it settles, repeats itself or leaves.

The judge of a search's runs decides (closed orbits, the modes at the end, turns that are alike), and a run as long as
it took shows it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.search.outcomes import Look, RunOutcome, RunOutcomes
from eppanalysis.methods.search.sampled import SampledSearch, Starts
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.states import OtherStates, at_centre, unobservable_apart
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import InputSignal, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.readable import lasting
from eppanalysis.results import LimitCycle, Status, Trajectory

#: What carrying a motion on may take in all [steps of the engine], and how many times as long it becomes at most.
_WORK, _LONGEST = 3e6, 3.0**7
#: How much longer the next run is.
_FACTOR = 3.0
#: A motion is looked at first when its inputs have not changed for the second half of its run.
_BEHIND = 2.0

#: What no longer run shows better: it stays open, or goes beyond all bounds.
_SAID = (
    RunOutcome.UNDECIDED,
    RunOutcome.OUT_OF_EVENTS,
    RunOutcome.BENEATH_ROUNDING,
    RunOutcome.DIVERGENCE,
)

#: A run of the same loop of another length [s].
RunTo = Callable[[float], Trajectory]


@dataclass(frozen=True, eq=False)
class Ending:
    """What a motion comes to.

    Attributes
    ----------
    status : Status
        SETTLED, LIMIT_CYCLE, DIVERGED, or UNDECIDED where the work was used up or nothing decides.
    until : float
        How far the motion was carried on [s].
    limit_cycle, settled_at, settled_since
        As of a trajectory.
    """

    status: Status
    until: float
    limit_cycle: LimitCycle | None = None
    settled_at: dict[str, float] = field(default_factory=dict)
    settled_since: float = float("nan")

    def of(self, run: Trajectory) -> Trajectory:
        """A run with this as its end."""
        undecided, stopped = self.status is Status.UNDECIDED, run.status is Status.EVENT_LIMIT
        return replace(
            run,
            status=self.status,
            limit_cycle=self.limit_cycle,
            settled_at=self.settled_at,
            settled_since=self.settled_since,
            carried_to=float("nan") if stopped else self.until,
            note=self.note(run) if undecided else "",
        )

    def note(self, run: Trajectory) -> str:
        """What a run that ends before has to say of it, in a sentence."""
        by_then, until = "The motion had neither settled nor repeated itself by the end", lasting(self.until, run.units)
        if self.status is Status.UNDECIDED:
            return f"{by_then}, nor by {until}." if self.until > run.end_time else ""
        comes_to = {Status.SETTLED: "settles", Status.DIVERGED: "grows without bound"}.get(self.status)
        if self.limit_cycle is not None:
            comes_to = f"repeats itself every {lasting(self.limit_cycle.period, run.units)}"
        shown = f": simulate for some {until}" if self.settled_since >= 0.0 else ""
        return f"{by_then}; carried on, it {comes_to}{shown}."


def ending(
    system: LureSystem, input: InputSignal | Mapping[str, InputSignal] | None, t_end: float, run_to: RunTo
) -> Ending:
    """What a motion comes to that was undecided by `t_end` [s]; `run_to` makes the same run of any length."""
    carried = _Carried.of(system, input_signals_by_name(system.input_names, input), t_end)
    with suppress(BudgetExceeded, EppError), budget(_WORK):
        return carried.shown(run_to)
    return carried.ending()


@dataclass
class _Carried:
    """A motion that is carried on, and what it has come to so far."""

    hybrid: HybridSystem
    #: None under an input that moves for ever, where nothing but a longer run decides.
    judge: RunOutcomes | SampledSearch | None
    to_user: Callable[[LimitCycle], LimitCycle]
    last: Look

    @classmethod
    def of(cls, system: LureSystem, given: Mapping[str, InputSignal], t_end: float) -> _Carried:
        """The motion of a loop from its own start, carried to `t_end` [s]."""
        form = InSamples.under(system, given) if system.time_step else None
        own = OtherStates.given(form.system) if form else unobservable_apart(system) or OtherStates.given(system)
        changes = HybridSystem.from_lure(own.system, given).model.breakpoint_time
        first = max(t_end, _BEHIND * float(changes.max(initial=0.0)))
        at = OperatingPoint.of(own.system, given, first)
        if at.stands and (centred := at_centre(own.system, at.vector(own.system))) is not None:
            own, at = own.then(centred), centred.point(at)
        loop = own.system
        hybrid = HybridSystem.from_lure(loop, given)
        strobe = Strobe.of(hybrid)
        judge: RunOutcomes | SampledSearch | None = None
        if at.stands and strobe is not None:
            judge = SampledSearch(loop, strobe, Starts(loop, hybrid, (), hybrid.begun, lambda y: y))
        elif at.stands:
            judge = RunOutcomes(loop, hybrid.held, (), at)

        def to_user(cycle: LimitCycle) -> LimitCycle:
            return form.to_user(own.to_user(cycle)) if form else own.to_user(cycle)

        return cls(hybrid, judge, to_user, Look(first, RunOutcome.UNDECIDED))

    def shown(self, run_to: RunTo) -> Ending:
        """What it comes to, and a run that shows it."""
        first = self.last.time
        for look in self.judge.looks(self.hybrid, first) if self.judge else ():
            self.last = look
        if self.judge and self.last.outcome in _SAID:
            return self.ending()
        longest = max(_LONGEST * first, self.last.time)
        t = self.last.time
        while t <= longest:
            run = run_to(t)
            if run.status in (Status.SETTLED, Status.LIMIT_CYCLE, Status.DIVERGED):
                return Ending(run.status, t, self._closed or run.limit_cycle, run.settled_at, run.settled_since)
            if run.status is Status.EVENT_LIMIT:
                break
            self.last = replace(self.last, time=t)
            t *= _FACTOR
        return self.ending()

    def ending(self) -> Ending:
        """What is known without a run that shows it."""
        if self._closed is not None:
            return Ending(Status.LIMIT_CYCLE, self.last.time, self._closed)
        ends: dict[RunOutcome | int, Status] = {
            RunOutcome.REST: Status.SETTLED,
            RunOutcome.DIVERGENCE: Status.DIVERGED,
        }
        return Ending(ends.get(self.last.outcome, Status.UNDECIDED), self.last.time)

    @property
    def _closed(self) -> LimitCycle | None:
        """The closed orbit that it is on."""
        judge, on = self.judge, self.last.outcome
        if isinstance(on, RunOutcome) or not isinstance(judge, RunOutcomes):
            return None
        return self.to_user(judge.reached[-1 - on].cycle if on < 0 else to_limit_cycle(judge.system, judge.orbits[on]))
