"""All limit cycles of a loop, exactly: seeds from describing functions and runs, basin boundaries by bisection.

Runs end on stable cycles. A cycle with one unstable direction lies on the basin boundary between two outcomes: the
boundary is bisected along a line of starts, and the run from there stays near the unstable cycle long enough to close
the orbit (docs/theory/exact_orbits.md, All of them).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.orbits.asked import Asked
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.exact import Found, asked_for, centre_of, orbits_of, start_of, steady_hybrid
from eppanalysis.methods.orbits.guess import recurrences
from eppanalysis.methods.orbits.mirrored import mirror
from eppanalysis.methods.orbits.sampled import search_sampled
from eppanalysis.methods.orbits.shooting import CONVERGED, Orbit, close_orbit, middle, orbit_of, orbits_near, same_orbit
from eppanalysis.methods.search.reach import reach_of_elements
from eppanalysis.methods.simulation.effort import Spent, Work, allotted, left
from eppanalysis.methods.simulation.simulate import Run, cycle_of_run, judge, run_hybrid
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem
from eppanalysis.models.systems.linear import poles
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle, Result, Status
from eppanalysis.results.provenance import Provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Factors on the predicted oscillation (or on the start's distance from rest) at which runs are started.
SCALES = (0.03, 0.1, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 3.0, 6.0)
N_RANDOM = 24
_SEED = 20050901
_NO_SAMPLES = np.zeros(0)
_MOST_EVENTS = 60_000
#: A run without an outcome after this many events is not made longer.
_ENOUGH_EVENTS = 600
#: Largest change of a state over a period, relative to its amplitude on a cycle, that counts as rest, and as slow
#: drift.
_STILL, _DRIFT = 1e-6, 1e-2
#: A run is tested for a cycle without switches after this many extensions, on a run this many times as long.
_QUIET_TURN, _SEEN = 2, 3.0
#: A state this many times beyond all cycles and its own start that still moves has diverged. The threshold is relative,
#: for integrators grow slowly, beyond no bound (docs/theory/exact_orbits.md, All of them).
_FAR = 1e6
#: Switches accumulate: the amplitude between them is taken over this many events, and is rest below this share of the
#: amplitude of the whole run.
_PILE, _PILED = 64, 1e-3
#: The amplitude decays when it is below this share of what it was at the oldest events that a run keeps.
_DWINDLES = 0.999
#: A run that seems to settle is made this many times longer, for friction may creep towards its next slip far more
#: slowly than the linear part moves; a state that drifts is followed this far at most.
_LATE, _LATEST = 100.0, 1e6
#: Most basin boundaries that are bisected. A fractal boundary has no last one.
_MOST_EDGES = 150
#: Steps of the engine, and what is worth as many, after which a search ends; the share of them for all predictions
#: together, for one edge, and for one prediction, one start or one mirror image.
_MOST_WORK, _FOR_PREDICTIONS, _FOR_EDGE, _FOR_ONE = 2e7, 0.5, 0.2, 0.1
#: A cycle is listed as a run has it when all changes still to come are below this share of its amplitude. The run is
#: made three times longer this often at most. Only so many are listed, for they may fill a continuum.
_REACHED, _MOST_LONGER, _MOST_REACHED = 1e-9, 6, 12
#: An orbit grazes a guard when it crosses it more slowly than this share of its movement across it in a period.
_GRAZING = 1e-3
#: Relative difference of the periods of a linear oscillation that is rounding.
_SAME_PERIOD = 1e-8
#: Outcome of a run that repeats itself but whose orbit could not be closed.
UNCLOSED = "on a cycle that could not be closed"


@dataclass(frozen=True, eq=False, repr=False)
class CycleSearch(Result):
    """All limit cycles found, smallest first; behaves as a sequence of LimitCycle.

    Attributes
    ----------
    cycles : tuple of LimitCycle
        Exact orbits; and where runs are on cycles whose orbits could not be closed, those as the runs have them (method
        "simulation", with an error estimate below 1e-9).
    status : Status
        CONVERGED, or UNDECIDED when something is left open: no orbit was found for a predicted cycle whose estimate
        says that it exists, some run neither settled nor repeated itself nor left, or is on a cycle that could not be
        closed, there were more edges between outcomes than are bisected, or the search ended before it had come to
        its end (`message` says which).
    settles : bool
        Whether some start settled at rest.
    diverges : bool
        Whether some start grew without bound.
    search : str
        How completeness was sought, in plain words.
    rest_state : array, shape (n,)
        A state of rest that some run reached; empty where none did.
    unclosed : tuple of LimitCycle
        The predicted cycles whose orbits were not found; those with an infinite error estimate may not exist, and
        alone leave nothing open.
    left_open : tuple of str
        What keeps the search from being complete, unclosed predictions aside, each in words.
    n_runs : int
        Runs that were made.
    """

    cycles: tuple[LimitCycle, ...]
    status: Status
    settles: bool
    diverges: bool
    search: str
    rest_state: Array = field(default_factory=lambda: np.zeros(0))
    unclosed: tuple[LimitCycle, ...] = ()
    left_open: tuple[str, ...] = ()
    n_runs: int = 0

    in_json = "status message settles diverges search operating_point cycles unclosed provenance"

    @property
    def message(self) -> str:
        """How the search ended, in a sentence."""
        missing = [f"no orbit was closed for the cycle predicted at {_named(c)}" for c in self.unclosed if _exists(c)]
        open_ends = "; ".join([*missing, *self.left_open])
        told = self.status.value if not open_ends else f"The search leaves something open: {open_ends}."
        doubtful = " and ".join(_named(c) for c in self.unclosed if not _exists(c))
        if not doubtful:
            return told
        return f"{told} No orbit was found for what first order predicts at {doubtful}, which may not exist."

    def __len__(self) -> int:
        return len(self.cycles)

    def __getitem__(self, i: int) -> LimitCycle:
        return self.cycles[i]

    def __iter__(self) -> Iterator[LimitCycle]:
        return iter(self.cycles)

    @property
    def stable(self) -> tuple[LimitCycle, ...]:
        """The stable cycles: what the device can do for ever."""
        return tuple(c for c in self.cycles if c.stable)

    @property
    def unstable(self) -> tuple[LimitCycle, ...]:
        """The unstable cycles: what separates one outcome from another."""
        return tuple(c for c in self.cycles if not c.stable)

    def plot(self, signal: str | None = None) -> Figure:
        """Waveform of every cycle, and the rate of the signal over it."""
        return self.drawn("plot_cycles", signal)


def find_limit_cycles(
    system: LureSystem | CaseLike,
    operating_point: PointLike | None = None,
    *,
    by_balance: bool = True,
    predicted: Sequence[LimitCycle] | None = None,
    progress: Progress | None = None,
) -> CycleSearch:
    """All limit cycles of a loop as exact orbits, stable and unstable.

    Parameters
    ----------
    system : LureSystem or Case
        In discrete time orbits are sought that close after a whole number of samples.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.
    by_balance : bool
        Where a prediction does not lead to an orbit, try by way of harmonic balance of rising order; that takes a
        second or two for a prediction without an orbit near.
    predicted : sequence of LimitCycle, optional
        What :func:`predict_limit_cycles` found for this system and this input, where that is known already; it takes
        most of the time of a search.
    progress : callable, optional
        Called at each run with the runs made, None (their number is not known before), and the state of the search in
        words.

    Returns
    -------
    CycleSearch

    Raises
    ------
    EppError
        For a discrete-time system with an element of several inputs, or an input that does not stand still.
    ModelError
        If an input is unknown.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
    >>> [(round(c.period, 8), c.stable) for c in epp.find_limit_cycles(loop)]
    [(8.25509713, False), (6.3277966, True)]
    """
    system, at = standing(system, operating_point, "find_limit_cycles")
    if system.time_step:
        return _in_discrete_time(system, at, predicted)
    hybrid = steady_hybrid(system, at)
    seeds = _predictions(system, at) if predicted is None else predicted
    for cycle in seeds:
        cycle.require_state(hybrid.n_plant)
    if seeds and not np.any(poles(system.A)):
        # Integrators alone have no time scale of their own: steps of a second would never end on a slow cycle.
        hybrid = replace(hybrid, time_scale=min(c.period for c in seeds) / 20.0)
    search = _Search(system, hybrid, seeds, at, by_balance, progress)
    search.run_all()
    cycles = [*(to_limit_cycle(system, o) for o in search.orbits), *(r.cycle for r in search.reached)]
    outcomes = search.outcomes
    return CycleSearch(
        cycles=tuple(replace(c, operating_point=at) for c in sorted(cycles, key=lambda c: _size(system, c))),
        status=Status.CONVERGED if search.complete else Status.UNDECIDED,
        settles="rest" in outcomes,
        diverges="leaves" in outcomes,
        search=search.sentence(),
        rest_state=np.zeros(0) if search.rest is None else search.rest[0][: hybrid.n_plant],
        unclosed=tuple(search.unclosed),
        left_open=search.left_open(),
        n_runs=search.n_runs,
        provenance=_made_by(system, {"runs": search.n_runs, "edges": search.n_edges, "work": search.work.used}),
        operating_point=at,
    )


def _in_discrete_time(system: LureSystem, at: OperatingPoint, predicted: Sequence[LimitCycle] | None) -> CycleSearch:
    """Orbits that close after whole numbers of samples."""
    found = search_sampled(system, at, _predictions(system, at) if predicted is None else predicted)
    return CycleSearch(
        cycles=tuple(replace(c, operating_point=at) for c in found.cycles),
        status=Status.UNDECIDED if found.undecided else Status.CONVERGED,
        settles=found.rest is not None,
        diverges=found.diverges,
        search=found.search,
        rest_state=np.zeros(0) if found.rest is None else found.rest,
        left_open=(_undecided(found.undecided),) if found.undecided else (),
        n_runs=found.runs,
        provenance=_made_by(system, {"runs": found.runs}),
        operating_point=at,
    )


def _made_by(system: LureSystem, counts: dict[str, float]) -> Provenance:
    return Provenance("search for limit cycles", {"system": system.name}, {"residual": CONVERGED}, counts)


def _predictions(system: LureSystem, at: OperatingPoint) -> Sequence[LimitCycle]:
    try:
        return predict_limit_cycles(system, at).cycles
    except ModelError:
        return ()


def _undecided(count: int) -> str:
    """What runs without an end leave open."""
    return f"{count} runs neither settled nor repeated themselves"


def _named(cycle: LimitCycle) -> str:
    """A predicted cycle by its frequency and the size of its first signal."""
    name, size = next(iter(cycle.peak_to_peak.items()))
    kind = {True: ", stable", False: ", unstable", None: ""}[cycle.stable]
    return f"{cycle.frequency:.6g} Hz ({name} {size:.4g} {cycle.units.get(name, '')}".rstrip() + f" peak to peak{kind})"


def _exists(cycle: LimitCycle) -> bool:
    """Whether a prediction claims that its cycle exists; an infinite estimate of its error says that it may not."""
    return not np.isinf(cycle.error_estimate)


def _size(system: LureSystem, cycle: LimitCycle) -> float:
    return cycle.peak_to_peak[system.signals.names[0]]


@dataclass(frozen=True, eq=False)
class _Reached:
    """A cycle that a run is on, whose orbit could not be closed.

    Attributes
    ----------
    cycle : LimitCycle
        As the run has it.
    corners : tuple of arrays, shapes (events,), (events, n), (n,)
        Guard and state at each event of a period, and how far each state moves.
    """

    cycle: LimitCycle
    corners: tuple[IntArray, Array, Array]

    @classmethod
    def of(cls, system: LureSystem, start: HybridSystem, run: Run, facts: Array) -> _Reached:
        """From the end of a run, and what the verdict says of it."""
        events, period = run.order[-int(facts[0]) - 1 : -1], float(facts[1])
        states = run.state[events]
        size = np.ptp(states, axis=0) + np.abs(run.rate[events]).max(axis=0) * period / (2.0 * np.pi)
        size = np.where(size > 0, size, np.inf)
        told = Provenance("event-exact simulation", {"system": system.name, "t_end": float(run.stats[0])})
        cycle = cycle_of_run(system, start, run, facts, told)
        return cls(cycle, (run.guard[events], states, size))


@dataclass
class _Search:
    """State of one search; lives for one call."""

    system: LureSystem
    hybrid: HybridSystem
    predicted: Sequence[LimitCycle]
    at: OperatingPoint
    by_balance: bool = True
    progress: Progress | None = None
    orbits: list[Orbit] = field(default_factory=list)
    reached: list[_Reached] = field(default_factory=list)
    outcomes: dict[str, int] = field(default_factory=dict)
    n_runs: int = 0
    n_edges: int = 0
    n_left: int = 0
    n_ended: int = 0
    n_cut: int = 0
    n_images: int = 0
    work: Work = field(default_factory=lambda: Work(_MOST_WORK))
    rest: tuple[Array, Array] | None = None
    unclosed: list[LimitCycle] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Whether every cycle said to exist was closed, every run came to an end, every edge was split."""
        return not (any(map(_exists, self.unclosed)) or self.left_open())

    def left_open(self) -> tuple[str, ...]:
        """What keeps the search from being complete, unclosed predictions aside."""
        undecided, unclosed = (self.outcomes.get(end, 0) for end in ("undecided", UNCLOSED))
        parts = {
            _undecided(undecided): undecided,
            f"{unclosed} runs are on cycles that could not be closed": unclosed,
            f"{self.n_left} edges between different outcomes were not bisected": self.n_left,
            f"{self.n_ended} starts were left when the search had taken {_MOST_WORK:.0e} steps": self.n_ended,
            f"{self.n_cut} predictions were not followed to the end": self.n_cut,
            f"the mirror images of {self.n_images} cycles were not tried": self.n_images,
        }
        return tuple(text for text, count in parts.items() if count)

    def run_all(self) -> None:
        """Seeds, then runs along rays and from random starts, then the edges between outcomes."""
        with allotted(_MOST_WORK) as self.work:
            led_to = self._close_all()
            for ray in self.rays:
                self._scan(ray)
            for start in self._random():
                self.outcome(*start)
            for orbit in list(self.orbits):
                self._scan(self._ray_to(orbit))
            for orbit in list(self.orbits):
                self._add_mirrored(orbit)
        self.unclosed = self._not_among(led_to)

    def _close_all(self) -> list[int | None]:
        """For each prediction the number of the orbit that it asks for, None for none."""
        with allotted(_FOR_PREDICTIONS * _MOST_WORK):
            return [self._close(cycle) for cycle in self.predicted]

    def _close(self, cycle: LimitCycle) -> int | None:
        """Number of the orbit that a prediction asks for, None for none; all orbits that it leads to are kept."""
        found: list[Found] = []
        try:
            with allotted(_FOR_ONE * _MOST_WORK):
                for step in orbits_of(self.system, self.hybrid, cycle, self.at, self.by_balance, True):
                    found.append(step)
                    self.add(step.orbit)
        except Spent:
            self.n_cut += 1
        asked = asked_for(found)
        return None if asked is None else self.add(asked)

    def _not_among(self, led_to: Sequence[int | None]) -> list[LimitCycle]:
        """The predictions whose orbits are not among those found, by whatever way; an orbit answers the nearest."""
        answers: dict[int, LimitCycle] = {}
        unclosed = []
        nearest = sorted(zip(led_to, self.predicted, strict=True), key=lambda pair: self._distance(*pair))
        # Two predictions may lead to one orbit: it answers the one that says of it what is true.
        nearest.sort(key=lambda pair: not self._as_stable(*pair))
        for number, cycle in nearest:
            if number is None or (number in answers and not self.orbits[number].one_of_many):
                number = self._other_answer(cycle, answers)
            if number is None:
                unclosed.append(cycle)
            else:
                answers[number] = cycle
        return unclosed

    def _distance(self, number: int | None, cycle: LimitCycle) -> float:
        return np.inf if number is None else abs(np.log(self.orbits[number].period / cycle.period))

    def _as_stable(self, number: int | None, cycle: LimitCycle) -> bool:
        """Whether an orbit is as stable as was predicted."""
        return number is not None and is_stable(self.orbits[number].multipliers) == cycle.stable

    def _other_answer(self, cycle: LimitCycle, answers: Mapping[int, LimitCycle]) -> int | None:
        """Number of an orbit that no other prediction asks for and that this one may mean; -1 for a cycle of a run."""
        asked = Asked.of(self.system, self.hybrid, cycle)
        for i, orbit in enumerate(self.orbits):
            if i not in answers and is_stable(orbit.multipliers) == cycle.stable and not asked.difference(orbit):
                return i
        return -1 if any(not asked.shape_difference(r.cycle) for r in self.reached) else None

    def sentence(self) -> str:
        """How completeness was sought."""
        ends = ", ".join(f"{n} {what}" for what, n in sorted(self.outcomes.items()))
        balance = ", by harmonic balance where needed" * self.by_balance
        return (
            f"{len(self.predicted)} predicted cycles as seeds{balance}; {self.n_runs} runs "
            f"along {len(SCALES)} scales of each predicted and found cycle and from {N_RANDOM} random starts ({ends}); "
            f"{self.n_edges} edges between different outcomes bisected for unstable cycles; the mirror image of each "
            "cycle tried. Cycles with several unstable directions that no prediction is near may be missed."
            f"{self._pasts()}{self._continua()}{self._unclosed()}{self._left()}{self._open()}"
        )

    def _pasts(self) -> str:
        """From which pasts no run was begun."""
        if not np.any(self.hybrid.model.smooth_kind == DELAY_LINE):
            return ""
        return " Before a run its delayed signals are at rest; a cycle that only other pasts lead to may be missed."

    def _left(self) -> str:
        """Sentence on the starts and basin boundaries that were left out."""
        if not self.work.left:
            return (
                f" The search ended after {_MOST_WORK:.0e} steps of the engine; "
                f"{self.n_ended} starts and {self.n_left} edges were left."
            )
        if not self.n_left:
            return ""
        return f" {self.n_left} more edges were left: the starts of different outcomes are interwoven."

    def _open(self) -> str:
        """Sentence on the predictions without an exact orbit."""
        if not self.unclosed:
            return ""
        names = "; ".join(map(_named, self.unclosed))
        return f" Predicted, but not closed to an exact orbit: {names}. What is predicted need not exist."

    def _continua(self) -> str:
        """Sentence on cycles that stand for a continuum of cycles."""
        many = sum(o.one_of_many for o in self.orbits)
        if not many:
            return ""
        return (
            f" {many} of the cycles listed {'stands' if many == 1 else 'stand'} for a continuum of cycles with the "
            "same switches: an element holds a value that none of them renews, or nothing fixes where the motion lies "
            "or how large it is."
        )

    def _unclosed(self) -> str:
        """Why there are runs on cycles that are not among those found."""
        if UNCLOSED not in self.outcomes:
            return ""
        if np.any(self.hybrid.model.smooth_kind == DELAY_LINE):
            why = "from none of their events, with what was on its way through the dead time, was an orbit closed"
        else:
            why = "from none of their events did Newton's method close an orbit"
        what = (
            f"They are listed as runs have them, stable ones only and {_MOST_REACHED} at most"
            if self.reached
            else "They are not listed; simulate from such a start to see one"
        )
        return f" Some runs are on cycles without a closed orbit: {why}. {what}."

    def add(self, orbit: Orbit) -> int:
        """Number of an orbit among those found; a new one is appended."""
        for i, known in enumerate(self.orbits):
            if same_orbit(known, orbit) or same_continuum(known, orbit) or on_rim(known, orbit):
                return i
        self.orbits.append(orbit)
        return len(self.orbits) - 1

    def _add_mirrored(self, orbit: Orbit) -> None:
        """Add the mirror image of an orbit, which a symmetric loop has too."""
        n, compared = self.hybrid.x0.size, self.hybrid.compared
        y = middle(orbit, int(np.argmax(orbit.tau)))
        if self.image is None:
            centre = np.zeros(n) if self.rest is None else self.rest[0]
            x = np.where(compared, 2.0 * centre - y[:n], y[:n])
            held = -y[orbit.arcs.memory]
            held[-1] = 1.0
        else:
            y = self.image @ y
            x, held = y[:n], y[orbit.arcs.memory]
        try:
            with allotted(_FOR_ONE * _MOST_WORK):
                for found in orbits_near(self.hybrid, x, held, orbit.period):
                    self.add(found)
                    return
        except Spent:
            self.n_images += 1

    @cached_property
    def image(self) -> Array | None:
        """The map to the mirror image, where there is one."""
        return mirror(self.hybrid)

    @cached_property
    def horizon(self) -> float:
        """How long a run is before it is judged for the first time [s]."""
        if self.predicted:
            return 40.0 * max(c.period for c in self.predicted)
        rates = np.abs(poles(self.system.A)) if self.system.A.size else np.ones(1)
        slow = rates[rates > 1e-9 * max(rates.max(), 1e-300)]
        return 3.0 / float(slow.min()) if slow.size else 100.0

    def outcome(self, x: Array, H: Array) -> str:
        """Where a run from (x, H) ends: "rest", "leaves", "undecided", UNCLOSED, or the number of a cycle."""
        try:
            found = self._outcome(x, H)
        except Spent:
            self.n_ended += 1
            found = "not run"
        kind = "cycle" if found.isdigit() else found
        self.outcomes[kind] = self.outcomes.get(kind, 0) + 1
        return found

    def _outcome(self, x: Array, H: Array) -> str:
        self._tell()
        try:
            with allotted(_FOR_ONE * _MOST_WORK):
                return self._end_of(replace(self.hybrid, x0=x, H0=H))
        except EppError:  # a dead time with more switches than its history holds
            return "undecided"
        except Spent:
            if not left():  # of what lies around this start
                raise
            return "undecided"

    def _end_of(self, start: HybridSystem) -> str:
        t = self.horizon
        for turn in range(8):
            run = self._run(start, t)
            status, facts = judge(start, run, t)
            ended = self._ended(status, start, run)
            if ended is not None:
                return ended
            if status is Status.LIMIT_CYCLE:
                known = self._recognise(start, run, float(facts[1]))
            elif decays(start, run, t, self.horizon, self._sizes()):
                return self._late_cycle(start, run, t) or "rest"
            else:
                known = self._recognise(start, run, None)
                if known == "undecided" and turn == _QUIET_TURN:
                    known = self._quiet_cycle(run, t)
            if known != "undecided":
                return known
            if turn >= 3 and run.count > _ENOUGH_EVENTS and status is not Status.LIMIT_CYCLE:
                break
            t *= 3.0
        return "leaves" if self._has_gone(start, run, t) else "undecided"

    def _ended(self, status: Status, start: HybridSystem, run: Run) -> str | None:
        """Where a run ends that goes on no longer; None for one that does."""
        if status is Status.SETTLED:
            return self._rested(start, run)
        if status is Status.EVENT_LIMIT:
            return self._rested(start, run) if _died_out(start, run) else "undecided"
        return "leaves" if status is Status.DIVERGED else None

    def _quiet_cycle(self, run: Run, t: float) -> str:
        """Number of the cycle that a run without switches is on at its end, of a linear part that does not damp it."""
        if run.n_kept and run.time[run.order[-1]] > 0.5 * t:
            return "undecided"
        observed = steady_hybrid(self.system, self.at, observed=True)
        held = run.memory_values[run.order[-1]] if run.n_kept else self.hybrid.H0
        start = replace(observed, x0=run.x_end.copy(), H0=held.copy(), time_scale=self.hybrid.time_scale)
        again = self._run(start, _SEEN * t)
        status, facts = judge(start, again, _SEEN * t)
        orbit = orbit_of(start, again, float(facts[1])) if status is Status.LIMIT_CYCLE else None
        return "undecided" if orbit is None else str(self.add(orbit))

    def _rested(self, start: HybridSystem, run: Run) -> str:
        """Keep the state of rest of the first run that settles."""
        if self.rest is None:
            self.rest = run.x_end, (run.memory_values[run.order[-1]] if run.n_kept else start.H0)
        return "rest"

    def _has_gone(self, start: HybridSystem, run: Run, t: float) -> bool:
        """Whether a run has diverged: it is far beyond all cycles and still moves. Integrators pass no fixed bound."""
        n = start.n_plant
        here, size = np.abs(run.x_end[:n]), np.maximum(self._sizes()[:n], np.abs(start.x0[:n]))
        return bool(np.any((here > _FAR * size) & (size > 0) & (np.abs(run.rate_end[:n]) * t > 0.5 * here)))

    def _tell(self) -> None:
        """How far the search is."""
        if self.progress is not None:
            words = f"{self.system.name}: {self.n_runs} runs, {self.n_edges} edges, {len(self.orbits)} cycles"
            self.progress(self.n_runs, None, words)

    def _late_cycle(self, start: HybridSystem, run: Run, t: float) -> str | None:
        """The cycle that a run that seemed to decay by time t is on much later, as a number; None for none.

        A stuck element may creep towards its next slip far more slowly than the linear part moves.
        """
        if self.hybrid.model.S.shape[1]:
            return None  # without long steps that would take minutes
        # An even drift reaches the next slip in this time; where that is too long the run is not made.
        with np.errstate(divide="ignore", invalid="ignore"):
            way = (self._sizes() / np.abs(run.rate_end))[start.compared]
        late = max(_LATE * t, 4.0 * float(np.max(way, where=way < 0.25 * _LATEST * t, initial=0.0)))
        run = self._run(start, late)
        status, facts = judge(start, run, late)
        known = self._recognise(start, run, float(facts[1]) if status is Status.LIMIT_CYCLE else None)
        return None if known == "undecided" else known

    def _sizes(self) -> Array:
        """How far the states move on what was predicted and found."""
        n = self.hybrid.x0.size
        size = 1e-9 * np.abs(self.hybrid.x0)
        for ray in self.rays:
            size = np.maximum(size, np.abs(ray[1]))
        for orbit in self.orbits:
            size = np.maximum(size, orbit.scale[:n])
        return size

    def _recognise(self, start: HybridSystem, run: Run, period: float | None) -> str:
        """Number of the cycle that a run is on at its end."""
        if run.n_kept == 0:
            return "undecided"
        n = self.hybrid.x0.size
        for i, known in enumerate(self.orbits):
            if self._is_on(run, known.arcs.event_sequence.guards, known.starts[1:, :n], known.scale[:n]):
                return str(i)
        if any(self._is_on(run, *r.corners) for r in self.reached):
            return UNCLOSED
        if period is None:
            return "undecided"
        orbit = orbit_of(self.hybrid, run, period)
        if orbit is not None:
            return str(self.add(orbit))
        for i, known in enumerate(self.orbits):
            if has_period_of(known, period):  # it only touches a guard, now and then
                return str(i)
        if _dwindles(start, run)[0]:
            return "undecided"
        self._reach(start, float(run.stats[0]))
        return UNCLOSED

    def _is_on(self, run: Run, guards: IntArray, states: Array, scale: Array) -> bool:
        """Whether a run's last event is one of a cycle's: the same guard, in the same state."""
        last, compared = run.order[-1], self.hybrid.compared
        away = np.abs(states[guards == run.guard[last]] - run.state[last])[:, compared]
        return bool(len(away)) and float(np.min(np.max(away / scale[compared], axis=1))) < 1e-3

    def _reach(self, start: HybridSystem, t: float) -> None:
        """List the cycle that a run is on at time t as the run has it, once it is on it to many digits."""
        for longer in 3.0 ** np.arange(_MOST_LONGER if len(self.reached) < _MOST_REACHED else 0):
            run = self._run(start, longer * t)
            status, facts = judge(start, run, longer * t)
            if status is not Status.LIMIT_CYCLE:
                return
            if facts[3] < _REACHED:
                self.reached.append(_Reached.of(self.system, start, run, facts))
                return

    def _run(self, start: HybridSystem, t: float) -> Run:
        """A run of the search, without samples."""
        self.n_runs += 1
        return run_hybrid(start, t, _NO_SAMPLES, 2.0 * self.hybrid.time_scale, _MOST_EVENTS, 600)

    @cached_property
    def rays(self) -> list[tuple[Array, Array, Array]]:
        """Lines of starts: centre, direction, held values."""
        rays = []
        for cycle in self.predicted:
            x, H = start_of(self.hybrid, cycle)
            centre = x.copy()
            centre[: self.hybrid.n_plant] = centre_of(self.hybrid, cycle)
            rays.append((centre, x - centre, H))
        x0 = self.hybrid.x0
        centre = np.zeros_like(x0)
        centre[self.hybrid.n_plant :] = x0[self.hybrid.n_plant :]
        if np.any(x0 != centre):
            rays.append((centre, x0 - centre, self.hybrid.H0))
        reach = np.zeros_like(x0)
        reach[: self.hybrid.n_plant] = reach_of_elements(self.system)
        if np.any(reach):
            rays.append((centre, reach, self.hybrid.H0))
        return rays

    def _ray_to(self, orbit: Orbit) -> tuple[Array, Array, Array]:
        """From rest (or the orbit's own middle) to the orbit."""
        n = self.hybrid.x0.size
        x = orbit.y[:n].copy()
        centre = np.mean(orbit.starts[:-1, :n], axis=0) if self.rest is None else self.rest[0]
        x[~self.hybrid.compared], centre = self.hybrid.x0[~self.hybrid.compared], centre.copy()
        centre[~self.hybrid.compared] = self.hybrid.x0[~self.hybrid.compared]
        return centre, x - centre, orbit.y[orbit.arcs.memory].copy()

    def _random(self) -> Iterator[tuple[Array, Array]]:
        """Starts in a box as large as the motions seen."""
        rng = np.random.default_rng(_SEED)
        boxes = [(r[0], np.abs(r[1]), r[2]) for r in self.rays]
        boxes += [(*self._ray_to(o)[:1], 0.5 * o.scale[: self.hybrid.x0.size], o.y[o.arcs.memory]) for o in self.orbits]
        for i in range(N_RANDOM if boxes else 0):
            centre, size, H = boxes[i % len(boxes)]
            x = centre + 2.0 * rng.uniform(-1.0, 1.0, size.size) * size
            x[~self.hybrid.compared] = self.hybrid.x0[~self.hybrid.compared]
            yield x, H

    def _scan(self, ray: tuple[Array, Array, Array]) -> None:
        """Outcomes along a line of starts, and the unstable cycles on the edges between different ones."""
        centre, direction, H = ray
        ends = [self.outcome(centre + s * direction, H) for s in SCALES]
        for a, b, end_a, end_b in zip(SCALES, SCALES[1:], ends, ends[1:], strict=False):
            if end_a != end_b:
                self._edge(ray, a, b, end_a, end_b)

    def _edge(self, ray: tuple[Array, Array, Array], a: float, b: float, end_a: str, end_b: str) -> None:
        """Bisect a basin boundary between two outcomes; close orbits from the run that stays near it longest."""
        if self.n_edges >= _MOST_EDGES or not self.work.left:
            self.n_left += 1
            return
        self.n_edges += 1
        try:
            with allotted(_FOR_EDGE * _MOST_WORK):
                self._bisect(ray, a, b, end_a, end_b)
        except Spent:
            self.n_left += 1

    def _bisect(self, ray: tuple[Array, Array, Array], a: float, b: float, end_a: str, end_b: str) -> None:
        centre, direction, H = ray
        for i in range(48):
            c = 0.5 * (a + b)
            if i in (10, 20, 30, 40) and self._close_on_edge(centre + c * direction, H):
                return
            end = self._outcome(centre + c * direction, H)
            if end == end_a:
                a = c
            elif end == end_b:
                b = c
            else:
                # A third outcome lies in between: keep the pair around the first boundary.
                b, end_b = c, end
        self._close_on_edge(centre + 0.5 * (a + b) * direction, H)

    def _close_on_edge(self, x: Array, H: Array) -> bool:
        start = replace(self.hybrid, x0=x, H0=H)
        run = run_hybrid(start, self.horizon, _NO_SAMPLES, 2.0 * self.hybrid.time_scale, _MOST_EVENTS, 400)
        for guess in recurrences(self.hybrid, run, None, 3, 400):
            orbit = close_orbit(self.hybrid, guess)
            if orbit is not None and not is_stable(orbit.multipliers, orbit.one_of_many):
                self.add(orbit)
                return True
        return False


def _died_out(start: HybridSystem, run: Run) -> bool:
    """Whether switches accumulate while the amplitude between them decays to rest."""
    if not run.n_kept:  # steps without number, but no switch
        return False
    dwindles, now = _dwindles(start, run)
    return dwindles and now <= _PILED


def _dwindles(start: HybridSystem, run: Run) -> tuple[bool, float]:
    """Whether the last events that a run keeps are smaller than the first, and their size relative to the whole run."""
    size = np.where(run.high > run.low, run.high - run.low, np.inf)
    before, now = ((np.ptp(run.state[part], axis=0) / size)[start.compared].max() for part in (
        run.order[:_PILE], run.order[-_PILE:],
    ))  # fmt: skip
    return bool(now < _DWINDLES * before), float(now)


def decays(start: HybridSystem, run: Run, t: float, horizon: float, size: Array) -> bool:
    """Whether a run decays: its states move by rounding only, or drift ever more slowly through a band without gain.

    Parameters
    ----------
    t, horizon : float
        Length of the run, and of some forty periods of the cycles in question [s].
    size : array, shape (n,)
        How far the states move on such cycles.
    """
    size = np.maximum(size, np.abs(run.x_end - start.x0))[start.compared]
    if t - _last_motion(start, run, _STILL * size) < 0.3 * t:
        return False
    rate = np.abs(run.rate_end)[start.compared]
    # A state that grows is faster at the end of the run than on average.
    if np.any(rate * t > 2.0 * size + np.abs(run.x_end)[start.compared] * _STILL):
        return False
    return bool(np.all(rate * horizon / 40.0 <= (_STILL if t < 9.0 * horizon else _DRIFT) * size))


def _last_motion(start: HybridSystem, run: Run, size: Array) -> float:
    """Time of the last event at which a state was farther than `size` from where the run ends [s].

    Rounding makes events at standstill where a drive creeps to a stop; they do not count.
    """
    away = np.abs(run.state[run.order] - run.x_end)[:, start.compared]
    moved = np.flatnonzero(np.any(away > size, axis=1))
    if moved.size:
        return float(run.time[run.order[moved[-1]]])
    return float(run.time[run.order[0]]) if run.count > run.n_kept else 0.0


def on_rim(known: Orbit, orbit: Orbit) -> bool:
    """Whether an orbit only grazes a guard and is the outermost of a continuum without that switch."""
    if not has_period_of(known, orbit.period):
        return False
    slow = np.abs(orbit.speed) * orbit.period < _GRAZING * (np.abs(orbit.arcs.g) @ orbit.scale)
    return bool(np.any(slow & (orbit.arcs.event_sequence.at_once != 1)))


def has_period_of(known: Orbit, period: float) -> bool:
    """Whether a period is that of a continuum of cycles, or a multiple of it."""
    turns = period / known.period
    return known.one_of_many and round(turns) >= 1 and abs(turns / round(turns) - 1.0) < _SAME_PERIOD


def same_continuum(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits of continua pass through the same switches and are as stable: one then stands for both."""
    guards = [o.arcs.event_sequence.guards for o in (one, other)]
    if guards[0].size != guards[1].size or not (one.one_of_many and other.one_of_many):
        return False
    unstable = [int(np.sum(np.abs(o.multipliers) > 1.0 + 1e-4)) for o in (one, other)]
    turned = any(np.array_equal(np.roll(guards[0], k), guards[1]) for k in range(guards[0].size))
    return unstable[0] == unstable[1] and turned
