"""All limit cycles of a loop, exactly: seeds from describing functions and runs, basin boundaries by bisection.

Runs end on stable cycles. A cycle with one unstable direction lies on the basin boundary between two outcomes: the
boundary is bisected along a line of starts, and the run from there stays near the unstable cycle long enough to close
the orbit (docs/theory/exact_orbits.md, The search for all of them).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TypeVar

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.describing.predict import predicted_cycles
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.decoupled import in_decoupled_states
from eppanalysis.methods.orbits.delayed.smooth import closed_behind_delay, is_smooth_delayed
from eppanalysis.methods.orbits.exact import Candidate, asked_for, orbits_of, steady_hybrid
from eppanalysis.methods.orbits.guess import recurrences
from eppanalysis.methods.orbits.locus import has_locus, orbits_on_locus
from eppanalysis.methods.orbits.mirrored import mirror
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, middle
from eppanalysis.methods.orbits.shooting import close_orbit, orbits_near
from eppanalysis.methods.orbits.target import Target
from eppanalysis.methods.search.outcomes import (
    FOR_ONE,
    MOST_EVENTS,
    NO_CORNERS,
    NO_SAMPLES,
    Ray,
    RunOutcome,
    SimulatedCycle,
)
from eppanalysis.methods.search.reach import crossover_frequency, may_be_overcome
from eppanalysis.methods.search.report import N_RANDOM, SCALES, SearchReport
from eppanalysis.methods.search.rests import towards_rests
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.sampled import Enough, Starts, search_near, search_sampled
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget, remaining, telling
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.methods.simulation.states import OtherStates
from eppanalysis.methods.steady.flow import advances
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import poles
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle, Status, smallest_first
from eppanalysis.results.provenance import Provenance

#: Of one that ends at the first cycle that is enough: None where none is.
Searched = TypeVar("Searched", CycleSearch, CycleSearch | None)

_SEED = 20050901
#: Scales of starts beyond the others, where no start has left and the loop holds none from far out.
_AFAR = (SCALES[-1], 30.0, 200.0, 2e3, 2e4)
#: Most basin boundaries that are bisected. A fractal boundary has no last one.
_MOST_BOUNDARIES = 150
#: Steps of the engine, and what is worth as many, after which a search ends; the share of them for all predictions
#: together, for runs and basin boundaries where a relay has cycles that are found without, and for one of these.
_MOST_WORK, _FOR_PREDICTIONS, _FOR_RUNS, _FOR_BOUNDARY = 2e7, 0.5, 0.9, 0.2


def find_limit_cycles(
    system: LureSystem | CaseLike,
    operating_point: PointLike | None = None,
    *,
    by_balance: bool = True,
    predicted: Sequence[LimitCycle] | None = None,
    progress: Progress | None = None,
) -> CycleSearch:
    """The limit cycles of a loop that a search finds, as exact orbits, stable and unstable; it may miss one.

    Parameters
    ----------
    system : LureSystem or Case
        In discrete time, and with sampled controllers, orbits are sought that close after a whole number of samples;
        stable motions that stay and do not close so are listed as long runs have them (method "simulation"), and their
        `note` says so.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.
    by_balance : bool
        Where a prediction does not lead to an orbit, try by way of harmonic balance of rising order, which
        takes longer.
    predicted : sequence of LimitCycle, optional
        What :func:`predict_limit_cycles` found for this system and this input, where that is known already; it saves
        that part of the search.
    progress : callable, optional
        Called with what is done (runs made, or numbers of samples sought), of how much (None where that is not known
        before), and the state of the search in words.

    Returns
    -------
    CycleSearch

    Raises
    ------
    EppError
        For an input that is not constant.
    ModelError
        If an input is unknown.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(
    ...     ([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0)
    ... )
    >>> [(round(c.period, 8), c.stable) for c in epp.find_limit_cycles(loop)]
    [(8.25509713, False), (6.3277966, True)]
    """
    return _found(*standing(system, operating_point, "find_limit_cycles"), by_balance, predicted, progress)


def _found(
    system: LureSystem,
    at: OperatingPoint,
    by_balance: bool = True,
    predicted: Sequence[LimitCycle] | None = None,
    progress: Progress | None = None,
    enough: Enough | None = None,
) -> CycleSearch:
    """See ``find_limit_cycles`` and ``search_from``."""
    # In the given states: what falls off faster than 1/s may not in others, by rounding, and phases are lost then.
    seeds = seeds_of(system, at) if predicted is None else predicted
    for cycle in seeds:
        cycle.require_state(len(system.A))
    if (apart := in_decoupled_states(system, at.vector(system))) is not None:
        given = [apart.from_user(cycle) for cycle in seeds]
        wanted = None if enough is None else lambda cycle: enough(apart.to_user(cycle))
        return _in_user_states(_as_it_is(apart.system, apart.point(at), by_balance, given, progress, wanted), apart, at)
    return _as_it_is(system, at, by_balance, seeds, progress, enough)


def _as_it_is(
    system: LureSystem,
    at: OperatingPoint,
    by_balance: bool,
    seeds: Sequence[LimitCycle],
    progress: Progress | None,
    enough: Enough | None,
) -> CycleSearch:
    """The search in the states in which the loop is given."""
    if has_samples(system):
        return _in_samples(system, at, seeds, lambda own, starts: search_sampled(own, starts, at, progress, enough))
    hybrid = steady_hybrid(system, at)
    if not np.any(poles(system.A)):
        # Integrators alone have no time scale of their own: steps of a second would never end on a slow cycle.
        scale = min(c.period for c in seeds) / 20.0 if seeds else 1.0 / crossover_frequency(system)
        hybrid = replace(hybrid, time_scale=scale)
    search = _Search(system, hybrid, seeds, at, progress, by_balance=by_balance)
    search.run_all()
    with telling():
        cycles = [*(to_limit_cycle(system, o) for o in search.orbits), *(r.cycle for r in search.reached)]
    outcomes = search.outcomes
    counted = {"runs": search.n_runs, "boundaries": search.n_boundaries, "work": search.work.used}
    return CycleSearch(
        cycles=tuple(replace(c, operating_point=at) for c in smallest_first(cycles)),
        status=Status.CONVERGED if search.complete else Status.UNDECIDED,
        settles=RunOutcome.REST in outcomes,
        diverges=RunOutcome.DIVERGENCE in outcomes,
        search=search.sentence(),
        not_covered=search.not_covered(),
        rest_state=np.zeros(0) if search.rest is None else search.rest[0][: hybrid.n_plant],
        unclosed=tuple(search.unclosed),
        left_open=search.left_open(),
        n_runs=search.n_runs,
        n_continua=sum(o.one_of_many for o in search.orbits),
        provenance=_made_by(system, counted),
        operating_point=at,
    )


def _in_samples(
    system: LureSystem,
    at: OperatingPoint,
    known: Sequence[LimitCycle],
    search: Callable[[LureSystem, Starts], Searched],
) -> Searched:
    """A search of a loop with samples, from cycles that are known, as its user has them."""
    if system.time_step:
        form = InSamples.at(system, at)
        hybrid = steady_hybrid(form.system, at)
        starts = Starts(system, hybrid, known, lambda x, memory: hybrid.begun(*form.start(x, memory)), form.state)
        found = search(form.system, replace(starts, to_user=form.to_user))
        with telling():
            return found and replace(found, cycles=tuple(map(form.to_user, found.cycles)))
    hybrid = steady_hybrid(system, at)
    strobe = Strobe.of(hybrid)
    assert strobe is not None
    clock, n = strobe.clock, hybrid.n_plant

    def begun(state: Array, memory: Sequence[object]) -> HybridSystem:
        # Where no controller remembers a time, the clock is at zero.
        return hybrid.begun(state if memory else np.where(np.arange(n) == clock, 0.0, state), memory)

    misses = "that are reached only from small basins or other contents of the controllers' memory"
    return search(system, Starts(system, hybrid, known, begun, lambda y: y[:n], misses))


def _in_user_states(found: CycleSearch, apart: OtherStates, at: OperatingPoint) -> CycleSearch:
    """What was found in a loop with other states."""
    cycles, unclosed = (tuple(map(apart.to_user, part)) for part in (found.cycles, found.unclosed))
    rest = apart.state(found.rest_state)
    return replace(found, cycles=cycles, unclosed=unclosed, rest_state=rest, operating_point=at)


def search_from(
    system: LureSystem | CaseLike,
    known: Sequence[LimitCycle],
    enough: Enough | None = None,
    progress: Progress | None = None,
) -> CycleSearch:
    """The search for all limit cycles, begun also from cycles that are known at another value of a parameter.

    In a loop with sampled controllers it ends at the first cycle that is `enough`, and those known come first.
    """
    loop, at = standing(system, None, "find_limit_cycles")
    if enough is not None and known and has_samples(loop):
        near = _in_samples(loop, at, known, lambda own, starts: search_near(own, starts, at, enough))
        if near is not None:
            return near
    return _found(loop, at, predicted=[*seeds_of(loop, at), *known], progress=progress, enough=enough)


def _made_by(system: LureSystem, counts: dict[str, float]) -> Provenance:
    return Provenance("search for limit cycles", {"system": system.name}, {"residual": CONVERGED}, counts)


def seeds_of(system: LureSystem | CaseLike, at: OperatingPoint | None = None) -> Sequence[LimitCycle]:
    """The predicted cycles of a loop; none where an element has no describing function."""
    try:
        return predicted_cycles(system, at)
    except ModelError:
        return ()


@dataclass
class _Search(SearchReport):
    """State of one search; lives for one call."""

    def run_all(self) -> None:
        """Seeds, then runs along rays and from random starts, then the basin boundaries between outcomes."""
        with budget(_MOST_WORK) as self.work:
            # The order of docs/theory/exact_orbits.md, The search for all of them: predictions, rays, random starts,
            # starts beside rest, rays to what was found, other periods, mirror images. Boundaries are bisected where a
            # ray shows them.
            led_to = self._close_all()
            with budget((1.0 if self.pulses is None else _FOR_RUNS) * _MOST_WORK):
                if np.array_equal(self.hybrid.x0, self.centre):  # else the loop's own start is on a ray
                    self.outcome(self.hybrid.x0, self.hybrid.H0)
                self._scan_all(self.rays)
                for start in chain(self._random(), self.beside_rest()):
                    self.outcome(*start)
                if RunOutcome.DIVERGENCE not in self.outcomes and may_be_overcome(self.system):
                    for ray in self.rays[-1:]:
                        self._scan(ray, _AFAR)
                for x, H, rests_by in (
                    towards_rests(self.hybrid, self.visited) if RunOutcome.REST not in self.outcomes else ()
                ):
                    self.n_towards += 1
                    self.outcome(x, H, rests_by)
                self._scan_all(self._ray_to(orbit) for orbit in list(self.orbits))
            self._add_symmetric()
            for orbit in list(self.orbits):
                self._add_on_locus(orbit)
            for number, orbit in enumerate(list(self.orbits)):
                self._add_mirrored(number, orbit)
        self.unclosed = self._not_among(led_to)

    def _close_all(self) -> list[int | None]:
        """For each prediction the number of the orbit that it means, None for none."""
        with budget(_FOR_PREDICTIONS * _MOST_WORK):
            return [self._close(cycle) for cycle in self.predicted]

    def _close(self, cycle: LimitCycle) -> int | None:
        """Number of the orbit that a prediction means, None for none; all orbits that it leads to are kept."""
        if is_smooth_delayed(self.hybrid):
            self._close_behind_delay(cycle)
            return None
        found: list[Candidate] = []
        try:
            with budget(FOR_ONE * _MOST_WORK):
                for step in orbits_of(self.system, self.hybrid, cycle, self.at, self.by_balance, True):
                    found.append(step)
                    self.add(step.orbit)
        except BudgetExceeded:
            self.n_cut += 1
        asked = asked_for(found)
        return None if asked is None else self.add(asked)

    def _close_behind_delay(self, cycle: LimitCycle) -> None:
        """Keep the cycle that a prediction means, or why it is not closed."""
        try:
            with budget(FOR_ONE * _MOST_WORK):
                closed, why = closed_behind_delay(self.system, self.hybrid, cycle, self.at)
        except BudgetExceeded:
            self.n_cut += 1
            return
        if closed is None:
            self.why_unclosed[id(cycle)] = why
        else:
            self.keep(SimulatedCycle(closed, NO_CORNERS))

    def _not_among(self, led_to: Sequence[int | None]) -> list[LimitCycle]:
        """The predictions whose orbits are not among those found, by whatever way; an orbit answers the nearest."""
        answers: dict[int, LimitCycle] = {}
        unclosed = []
        nearest = sorted(zip(led_to, self.predicted, strict=True), key=lambda pair: self._distance(*pair))
        # Greedily by period: an orbit that is meant twice answers the prediction that lies nearest to it.
        # Two predictions may lead to one orbit: it answers the one that says of it what is true.
        nearest.sort(key=lambda pair: not self._as_stable(*pair))
        for place, cycle in nearest:
            if place is None or (place in answers and not self.orbits[place].one_of_many):
                place = self._other_answer(cycle, answers)
            if place is None:
                unclosed.append(replace(cycle, note=self.why_unclosed.get(id(cycle), cycle.note)))
            else:
                answers[place] = cycle
        return unclosed

    def _distance(self, number: int | None, cycle: LimitCycle) -> float:
        return np.inf if number is None else abs(np.log(self.orbits[number].period / cycle.period))

    def _as_stable(self, number: int | None, cycle: LimitCycle) -> bool:
        """Whether an orbit is as stable as was predicted."""
        return number is not None and is_stable(self.orbits[number].multipliers) == cycle.stable

    def _other_answer(self, cycle: LimitCycle, answers: Mapping[int, LimitCycle]) -> int | None:
        """Number of an orbit that no other prediction means and that this one may mean; -1 for a cycle of a run."""
        asked = Target.of(self.system, self.hybrid, cycle).widened()
        for i, orbit in enumerate(self.orbits):
            if i not in answers and is_stable(orbit.multipliers) == cycle.stable and not asked.difference(orbit):
                return i
        return -1 if any(not asked.shape_difference(r.cycle) for r in self.reached) else None

    def _add_symmetric(self) -> None:
        """Add the symmetric cycles of a relay at all half periods."""
        if self.pulses is None:
            return
        try:
            with budget(_FOR_PREDICTIONS * _MOST_WORK):
                for guess in self.pulses.guesses():
                    orbit = close_orbit(self.hybrid, guess, self.orbits)
                    if orbit is not None:
                        self.add(orbit)
        except BudgetExceeded:
            self.pulses = None
            self.n_pulses += 1

    def _add_on_locus(self, orbit: Orbit) -> None:
        """Add orbits with the switches of one at other periods; on a boundary a run finds the least unstable only."""
        try:
            with budget(FOR_ONE * _MOST_WORK):
                for found in orbits_on_locus(orbit):
                    self.add(found)
            self.n_followed += has_locus(orbit)
        except BudgetExceeded:
            self.n_loci += 1

    def _add_mirrored(self, number: int, orbit: Orbit) -> None:
        """Add the mirror image of an orbit, which a symmetric loop has too."""
        n, compared = self.hybrid.x0.size, self.hybrid.compared
        y = middle(orbit, int(np.argmax(orbit.tau)))
        if self.image is None:
            # Where no symmetry is known the image about the rest is tried: only what closes as an orbit is kept.
            centre = np.zeros(n) if self.rest is None else self.rest[0]
            x = np.where(compared, 2.0 * centre - y[:n], y[:n])
            memory = -y[orbit.arcs.memory]
            memory[-1] = 1.0
        else:
            y = self.image @ y
            x, memory = y[:n], y[orbit.arcs.memory]
        try:
            with budget(FOR_ONE * _MOST_WORK):
                for found in orbits_near(self.hybrid, x, memory, orbit.period, self.orbits):
                    image = self.add(found)
                    if number in self.bounding:
                        self.bounding[image] += 0  # it bounds what it is the image of, and was not met itself
                    return
        except BudgetExceeded:
            self.n_images += 1

    @cached_property
    def image(self) -> Array | None:
        """The map to the mirror image, where there is one."""
        return mirror(self.hybrid)

    def _ray_to(self, orbit: Orbit) -> Ray:
        """From rest (or the orbit's own middle) to the orbit."""
        n = self.hybrid.x0.size
        x = orbit.y[:n].copy()
        centre = np.mean(orbit.starts[:-1, :n], axis=0) if self.rest is None else self.rest[0]
        x[~self.hybrid.compared], centre = self.hybrid.x0[~self.hybrid.compared], centre.copy()
        centre[~self.hybrid.compared] = self.hybrid.x0[~self.hybrid.compared]
        # Times that elements remember go back with the clock, or they would lie far ahead.
        rates = advances(self.hybrid)
        back = max(((orbit.y[:n] - x)[rates[:n] != 0.0] / rates[:n][rates[:n] != 0.0]).tolist(), default=0.0)
        return centre, x - centre, orbit.y[orbit.arcs.memory] - back * rates[n:]

    def _random(self) -> Iterator[tuple[Array, Array]]:
        """Starts in a box as large as the motions seen."""
        rng = np.random.default_rng(_SEED)
        boxes = [(r[0], np.abs(r[1]), r[2]) for r in self.rays]
        for orbit in self.orbits:
            centre, _, H = self._ray_to(orbit)
            boxes.append((centre, 0.5 * orbit.scale[: centre.size], H))
        for i in range(N_RANDOM if boxes else 0):
            centre, size, H = boxes[i % len(boxes)]
            x = centre + 2.0 * rng.uniform(-1.0, 1.0, size.size) * size
            x[~self.hybrid.compared] = self.hybrid.x0[~self.hybrid.compared]
            yield x, H

    def _scan_all(self, rays: Iterable[Ray]) -> None:
        for ray in rays:
            self._scan(ray)

    def _scan(self, ray: Ray, scales: Sequence[float] = SCALES) -> None:
        """Outcomes along a line of starts, and the unstable cycles on the basin boundaries between them."""
        centre, direction, H = ray
        ends = [self.outcome(centre + s * direction, H) for s in scales]
        for a, b, end_a, end_b in zip(scales, scales[1:], ends, ends[1:], strict=False):
            if end_a != end_b:
                self._bisect(ray, a, b, end_a, end_b)

    def _bisect(self, ray: Ray, a: float, b: float, end_a: RunOutcome | int, end_b: RunOutcome | int) -> None:
        """Bisect a basin boundary between two outcomes; close orbits from the run that stays near it longest."""
        if self.n_boundaries >= _MOST_BOUNDARIES or not remaining():
            self.n_left += 1
            return
        self.n_boundaries += 1
        try:
            with budget(_FOR_BOUNDARY * _MOST_WORK):
                self._halve(ray, a, b, end_a, end_b)
        except BudgetExceeded:
            self.n_left += 1

    def _halve(self, ray: Ray, a: float, b: float, end_a: RunOutcome | int, end_b: RunOutcome | int) -> None:
        centre, direction, H = ray
        for i in range(48):
            c = 0.5 * (a + b)
            # Ten halvings bring the start a thousand times nearer to the boundary, and keep its run near the unstable
            # cycle for longer.
            if i in (10, 20, 30, 40) and self._close_on_boundary(centre + c * direction, H):
                return
            end = self._outcome(centre + c * direction, H)
            if end == end_a:
                a = c
            elif end == end_b:
                b = c
            else:
                # A third outcome lies in between: keep the pair around the first boundary.
                b, end_b = c, end
        self._close_on_boundary(centre + 0.5 * (a + b) * direction, H)

    def _close_on_boundary(self, x: Array, H: Array) -> bool:
        quiet = [steady_hybrid(self.system, self.at, observed=True)] if self.hybrid.may_be_quiet else []
        for hybrid in (self.hybrid, *quiet):
            start = hybrid.at(x, H, hybrid.modes0)
            try:
                run = run_hybrid(start, self.horizon, NO_SAMPLES, 2.0 * self.hybrid.time_scale, MOST_EVENTS, 400)
            except EppError:  # a dead time with more switches than its history holds
                continue
            for guess in recurrences(hybrid, run, None, 3, 400):
                orbit = close_orbit(hybrid, guess, self.orbits)
                if orbit is not None and not is_stable(orbit.multipliers, orbit.one_of_many):
                    self.bounding[self.add(orbit)] += 1
                    return True
        return False
