"""All periodic responses to one sine that runs and the DF lead to, and how the run from the start goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.arrays import Array
from eppanalysis.methods.driven.drive import Drive, drive_of
from eppanalysis.methods.driven.entrained import Entrainment, entrainments, undriven
from eppanalysis.methods.driven.first_order import Sinusoid, near_misses, sinusoids
from eppanalysis.methods.driven.result import ForcedResponse, Motion, PeriodicResponse
from eppanalysis.methods.driven.runs import METHOD as RUN, REPEATS, by_runs, steady_of_run
from eppanalysis.methods.orbits.samples.locked import LockedOrbit, locked_cycle
from eppanalysis.methods.simulation.stability import describe, is_stable
from eppanalysis.methods.steady.closing import CLOSED, close
from eppanalysis.methods.steady.cycle import steady_cycle
from eppanalysis.methods.steady.flow import advance, advances, later, repeating, stacked, strobe_of
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, PointLike, facts_of
from eppanalysis.readable import quantity
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

METHOD = "shooting over the input's period"
#: Periods of the input after which a run is held against periodic responses.
_CHECKED = (30, 100, 300, 1000)
#: Distance from a periodic response, relative to its size, that counts as being on it; what a run must have come nearer
#: within ten of its periods to be on the way there, and from how far.
_ON_IT, _NEARER, _NEAR = 1e-7, 0.7, 0.3
#: Change of the state over n periods, relative to the range of all, up to which a response of n periods is sought.
_RETURNS = 0.15
#: Periods over which the parting of neighbouring motions is measured, and the rate per period that counts as none.
_PARTING, _NO_RATE = 300, 0.02
#: Multiplier of a response above which the loop's own oscillation may hide others.
_SLOW = 0.9
#: Two responses whose states at phase zero are nearer than this, relative to the motion, are one.
_SAME = 1e-6
#: How far beside an unstable response runs begin that leave it, relative to its size.
_ASIDE = 1e-3
#: Responses that a range begins with at most.
_SOME = 8
#: How often the way between two responses is halved, and after how many of these the run between them is looked at;
#: parting of the runs from both sides, relative to their responses' distance, up to which they are at the one between.
_HALVINGS, _LOOKS, _TOGETHER = 30, 5, 0.05
_FOLLOWS, _EVERY = "comes to follow the input", "repeats itself every {} periods"
_LEAVES = "ends early, or grows beyond bounds"
_PARTS = {
    Motion.IRREGULAR: "does not repeat itself: neighbouring motions part by a factor {0:.3g} each period of the input",
    Motion.QUASI_PERIODIC: (
        "does not repeat itself: quasi-periodic, for neighbouring motions neither part nor meet "
        f"(by more than {100 * _NO_RATE:.0f} % a period, so that a slower entrainment looks the same)"
    ),
    Motion.UNDECIDED: "does not repeat itself within {1} periods of the input",
}


#: What is said where responses of one period are even in number.
_EVEN = (
    "At least one more response of one period exists, as their number is odd: an unstable one between those found, "
    "for instance."
)
_UNTOLD = "So weak a sine moves its phase by less than rounding: entrainment is undecided at this size."


def forced_response(
    system: LureSystem | CaseLike,
    input: str | None = None,
    *,
    amplitude: float | None = None,
    frequency: float | None = None,
    operating_point: PointLike | None = None,
    most_periods: int = 6,
) -> ForcedResponse:
    """The exact periodic responses of a loop to ``amplitude * sin(2 pi frequency t)`` at one of its inputs.

    The run from the loop's own start, runs from what describing functions say, and these themselves lead to responses
    that are closed by Newton's method on the exact map of the state over one and several periods of the input, with its
    exact derivative, whose eigenvalues are the Floquet multipliers. Not every response need be found: there is no proof
    that these are all; where those of one period are even in number the message says that one is missing. With samples
    (a controller's, or in discrete time) the periods must be such as bring these round together with the input. With
    dead time, and where no number of periods does, the response is that on which the run from the loop's own start
    ends, to a millionth, without multipliers; the message says so, and others are not looked for.

    Parameters
    ----------
    system : LureSystem or Case
    input : str, optional
        The driven input; by default that of the case's own sine, or the only one.
    amplitude : float, optional
        In the SI unit of the input, positive; by default that of the case's own sine.
    frequency : float, optional
        [Hz], positive; by default that of the case's own sine.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the inputs are held, the driven one in the mean [SI]; by default that of the case or loop.
    most_periods : int
        Responses of up to so many periods of the input are looked for.

    Returns
    -------
    ForcedResponse

    Raises
    ------
    EppError
        For a number that is not positive, or another input that is not constant.
    ModelError
        If there is no such input.

    References
    ----------
    Nayfeh and Balachandran, "Applied Nonlinear Dynamics", 1995, chapters 3 and 6 (shooting, Floquet theory).

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> loop = epp.Diagram(
    ...     parts={
    ...         "spring": epp.Saturation(lower=-1.0, upper=1.0),
    ...         "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 0.0]),
    ...     },
    ...     connect=["end - mass -> spring", "spring -> mass"],
    ...     inputs=["end"],
    ... )
    >>> found = epp.forced_response(loop, amplitude=0.5, frequency=0.8 / (2 * np.pi))
    >>> [(round(r.cycle.peak_to_peak["mass"] / 2, 3), r.stable) for r in found]
    [(1.269, True), (1.761, False), (1.821, True)]
    """
    check_counts("forced_response", {"most_periods": (most_periods, 1)})
    drive = drive_of(system, input, amplitude, frequency, operating_point, "forced_response")
    facts = facts_of(system)
    settings = {"system": drive.system.name, "input": drive.input, "most_periods": most_periods}
    if by_runs(drive, most_periods):
        return _of_run(drive, most_periods, Provenance(RUN, settings, {"distance": REPEATS}, case=facts))
    search = Search(drive, most_periods)
    first = sinusoids(drive)
    motion, exponent = search.run(drive.hybrid, to_the_end=True)
    search.from_first_order((*first, *near_misses(drive)))
    search.from_beside()
    search.from_between()
    own = search.from_own_cycles() if motion is not Motion.IRREGULAR else None
    motion = search.by_adlers_law(motion, own)
    responses = search.responses()
    told = own if own is not None and own.is_decided(drive.omega) else None
    names = drive.system.signals.names
    return ForcedResponse(
        input=drive.input,
        amplitude=drive.amplitude,
        frequency=drive.frequency,
        responses=responses,
        motion=motion,
        repeats=search.repeats,
        exponent=exponent,
        status=Status.CONVERGED if responses else Status.NOT_CONVERGED,
        message=_sentence(drive, responses, motion, exponent, search, own),
        first_order={name: np.array([one.response(name) for one in first]) for name in names} if first else {},
        beat=float("nan") if told is None or motion is Motion.PERIODIC else told.beat(drive.period),
        tongue=(float("nan"), float("nan")) if told is None else told.tongue(drive.frequency),
        provenance=Provenance(METHOD, settings, {"residual": CLOSED}, case=facts),
        operating_point=drive.at,
    )


def _of_run(drive: Drive, most_periods: int, provenance: Provenance) -> ForcedResponse:
    """What the run from the loop's own start comes to, where other responses are not looked for."""
    found = steady_of_run(drive, most_periods)
    response, repeats = found.response, 0 if found.response is None else found.response.multiple
    if response is not None:
        goes_on = (
            f"after {found.periods} periods of the input it {_FOLLOWS if repeats == 1 else _EVERY.format(repeats)} "
            f"(to {found.distance:.1g} of its size)"
        )
    elif found.periods:
        goes_on = f"it {_PARTS[Motion.UNDECIDED].format(0.0, found.periods)}"
    else:
        goes_on = f"it {_LEAVES}"
    return ForcedResponse(
        input=drive.input,
        amplitude=drive.amplitude,
        frequency=drive.frequency,
        responses=() if response is None else (response,),
        motion=Motion.UNDECIDED if response is None else Motion.PERIODIC,
        repeats=repeats,
        exponent=float("nan"),
        status=Status.NOT_CONVERGED if response is None else Status.CONVERGED,
        message=(
            f"Response to a sine of {_sine(drive)}, from a run alone, for the loop has {by_runs(drive, most_periods)}: "
            f"{goes_on}. "
            f"Other responses were not looked for."
        ),
        provenance=provenance,
        operating_point=drive.at,
    )


def _sine(drive: Drive) -> str:
    """The input in words."""
    return f"amplitude {quantity(drive.amplitude, drive.unit, 4)} and {drive.frequency:.4g} Hz at {drive.input}"


@dataclass
class Search:
    """The responses to one sine that have been found; lives for one call."""

    drive: Drive
    most_periods: int
    found: list[tuple[int, SteadyMotion]] = field(default_factory=list)
    reached: int = 0
    repeats: int = 0
    settled: bool = False
    leaves: bool = False  # whether the run from the loop's own start ends early, or grows beyond bounds
    end: HybridSystem | None = None
    own: list[Entrainment] = field(default_factory=list)

    def from_first_order(self, first: tuple[Sinusoid, ...]) -> None:
        """Responses near those of the DF, and those to which runs from there lead."""
        for one in first:
            start = self.drive.begun(one.start)
            if not np.all(np.isfinite(start.x0)):
                continue
            self.closed(start, self.shortest)
            self.run(start)

    @cached_property
    def shortest(self) -> int:
        """Fewest periods of the input after which samples, if any, come round with it."""
        return self.drive.comes_round(self.most_periods)

    @property
    def one_is_missing(self) -> bool:
        """Whether the responses of one period found are even in number, as all of them are not: their indices, 1 or -1
        by the sign of det(1 - P), add up to 1 or -1 (docs/theory/driven.md, How they are found).
        """
        once = [response for n, response in self.found if n == self.shortest]
        return bool(once) and len(once) % 2 == 0 and not any(response.one_of_many for response in once)

    def from_between(self) -> None:
        """An unstable response between two stable ones, where one is missing: on the boundary of their basins."""
        stable = [response for n, response in self.found if n == self.shortest and response.stable]
        for one, other in combinations(stable, 2):
            if self.one_is_missing:
                self._between(one, other)

    def from_beside(self) -> None:
        """The stable responses on both sides of an unstable one, where one is missing."""
        for n, response in list(self.found):
            if n == self.shortest and self.one_is_missing and response.stable is False:
                for side in _ASIDE, -_ASIDE:
                    self.run(_beside(response, side))

    def _between(self, one: SteadyMotion, other: SteadyMotion) -> None:
        """Halve the way between two stable responses until runs from both sides lead on together to a third."""
        start, there = one.start, next(self.drive.alongside(other.start, self.drive.phase(one.start.x0), 1))
        if there is None:
            return
        known, a, b, most = len(self.found), 0.0, 1.0, _TOGETHER * _away(one, start, there)
        paths = [self._path(start), self._path(there)]
        for halving in range(1, _HALVINGS + 1):
            c = 0.5 * (a + b)
            path = self._path(_midway(start, there, c))
            nearer = _away(one, path[-1], start) < _away(one, path[-1], there)
            a, b, paths = (c, b, [path, paths[1]]) if nearer else (a, c, [paths[0], path])
            if halving % _LOOKS == 0:
                self.closed(_last_together(one, paths, most), self.shortest)
                if len(self.found) > known:
                    return

    def _path(self, start: HybridSystem) -> list[HybridSystem]:
        """A run, period by period."""
        path = [start]
        for _ in range(_CHECKED[0]):
            now = later(path[-1], self.shortest * self.drive.period)
            if now is None:
                break
            path.append(now)
        return path

    def from_own_cycles(self) -> Entrainment | None:
        """Responses that are the loop's own oscillation, held by the input at one phase or the other.

        A weak sine entrains it at a stable and at an unstable phase: a run comes to the first of them slowly, to the
        other never. What is returned is the cycle that the run has come to, where it has come to one.
        """
        end = self.end
        slow = [
            abs(response.multipliers).max(initial=0.0) for _, response in self.found if response.multipliers is not None
        ]
        # With samples the loop's own oscillation keeps step with these, if with anything.
        if end is None or self.drive.is_sampled or (slow and not max(slow) > _SLOW):
            return None
        on = None
        for own in entrainments(self.drive, end, self.most_periods):
            self.own.append(own)
            self._drop_undecided(own)
            for start in own.phases:
                self.closed(start, own.multiple)
            self._drop_undecided(own)
            if on is None and own.is_weak(self.drive.omega) and own.on_it(undriven(self.drive, end)):
                on = own
        return on

    def _drop_undecided(self, own: Entrainment) -> None:
        """Leave out what closes at any phase of a cycle that the sine moves by less than rounding."""
        kept = [(n, response) for n, response in self.found if own.closes(self.drive.omega, response)]
        # The run may have been taken to follow the input on one of these.
        self.settled &= len(kept) == len(self.found)
        self.found = kept

    def by_adlers_law(self, motion: Motion, own: Entrainment | None) -> Motion:
        """How a run goes on that has come to the loop's own oscillation, of which no length of it tells the end."""
        if motion is Motion.PERIODIC and self.settled:
            return motion
        open_end = Motion.UNDECIDED if motion is Motion.PERIODIC else motion
        if own is not None and own.is_of_second_order(self.drive.omega):
            return Motion.UNDECIDED
        if own is None or not own.is_decided(self.drive.omega):
            return open_end
        entrained = any(n == own.multiple and response.stable for n, response in self.found)
        if own.phases and entrained:
            self.repeats = own.multiple
            return Motion.PERIODIC
        return open_end if own.phases else Motion.QUASI_PERIODIC

    def closed(self, start: HybridSystem, multiple: int) -> tuple[int, SteadyMotion] | None:
        """The response of so many periods near a start, in the shortest form; None where there is none."""
        response = close(SteadyMotion.begun(start, multiple * self.drive.period), given=True)
        if response is None:
            return None
        found = self._in_fewest(multiple, response)
        for known in self.found:
            if known[0] == found[0] and self.same(known[1], *found[::-1]):
                return known
        self.found.append(found)
        return found

    def _in_fewest(self, multiple: int, response: SteadyMotion) -> tuple[int, SteadyMotion]:
        for n in range(self.shortest, multiple, self.shortest):
            end = later(response.start, n * self.drive.period) if multiple % n == 0 else None
            if end is not None and _away(response, end, response.start) < _SAME:
                once = close(SteadyMotion.begun(response.start, n * self.drive.period), given=True)
                if once is not None:
                    return n, once
        return multiple, response

    def same(self, known: SteadyMotion, response: SteadyMotion, multiple: int) -> bool:
        """Whether two responses of as many periods are one motion, begun at any period of the input."""
        return any(
            there is not None and _away(known, there, known.start) < _SAME
            for there in self.drive.alongside(response.start, self.drive.phase(known.start.x0), multiple)
        )

    def run(self, start: HybridSystem, to_the_end: bool = False) -> tuple[Motion, float]:
        """Where a run leads; its responses are noted. Unless `to_the_end`, only while there is reason to go on."""
        now: HybridSystem | None = start
        made, states = 0, []
        for checked in _CHECKED if to_the_end else _CHECKED[:2]:
            while now is not None and made < checked:
                now, made = later(now, self.shortest * self.drive.period), made + self.shortest
                states.append((stacked(now or start) - made * self.drive.period * advances(start))[repeating(start)])
            if now is None:
                self.leaves |= to_the_end
                return Motion.UNDECIDED, float("nan")
            if to_the_end:
                self.reached, self.end = max(self.reached, made), now
            settled = self._settles(now, np.array(states[-4 * self.most_periods :]))
            if settled:
                if to_the_end:
                    self.repeats, self.settled = settled, True
                return Motion.PERIODIC, float("nan")
        return self._parting(now) if to_the_end and now is not None else (Motion.UNDECIDED, float("nan"))

    def _settles(self, now: HybridSystem, states: Array) -> int:
        """The periods of the stable response that a run is on, or on the way to; 0 for none."""
        span = np.ptp(states, axis=0)
        for k in range(1, self.most_periods // self.shortest + 1):
            change = np.abs(states[-1] - states[-1 - k]) / np.where(span > 0, span, np.inf)
            # Closing is dear: several periods are tried only where the run nearly repeats itself after as many.
            if k > 1 and np.max(change, initial=0.0) > _RETURNS:
                continue
            found = self.closed(now, k * self.shortest)
            if found is not None and found[1].stable:
                # A response that closes near the run is not yet where it goes: the run must come nearer to it, or be on
                # it (docs/theory/driven.md, How they are found).
                away = [self._from(found, state) for state in (now, later(now, 10 * found[0] * self.drive.period))]
                if away[1] < _ON_IT or (away[0] < _NEAR and away[1] < _NEARER * away[0]):
                    return found[0]
        return 0

    def _from(self, found: tuple[int, SteadyMotion], state: HybridSystem | None) -> float:
        """Distance of a run from a response, whichever of the input's periods it is in."""
        if state is None:
            return float("inf")
        multiple, response = found
        there = next(self.drive.alongside(state, self.drive.phase(response.start.x0), 1))
        if there is None:
            return float("inf")
        starts = (later(response.start, k * self.drive.period) for k in range(multiple))
        return min((_away(response, there, s) for s in starts if s is not None), default=float("inf"))

    def _parting(self, start: HybridSystem) -> tuple[Motion, float]:
        """The rate at which neighbours of a run part, per period, from the products of its exact derivatives."""
        now, sought, n = start, repeating(start), start.n_plant
        direction, total = np.ones(sought.size), 0.0
        for _ in range(_PARTING):
            once = advance(now, self.shortest * self.drive.period)
            if once is None:
                return Motion.UNDECIDED, float("nan")
            direction = once.derivative[np.ix_(sought, sought)] @ direction
            size = float(np.linalg.norm(direction[sought < n]))
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
                total, direction = total + np.log(size) / self.shortest, direction / size
            if not np.all(np.isfinite(direction)):  # it has shrunk to nothing, or grown beyond numbers
                return Motion.UNDECIDED, float("nan")
            now = once.run.end(now)
        # The direction began with length sqrt(n), not one.
        rate = (total - 0.5 * np.log(self.drive.hybrid.n_plant)) / _PARTING
        if rate > _NO_RATE:
            return Motion.IRREGULAR, rate
        return (Motion.QUASI_PERIODIC if rate > -_NO_RATE else Motion.UNDECIDED), rate

    def responses(self) -> tuple[PeriodicResponse, ...]:
        """What was found, as its users see it: by multiple, then by size."""
        made = [self._held(periodic_response(self.drive, n, response)) for n, response in self.found]
        return tuple(sorted(made, key=lambda r: (r.multiple, *sorted(r.cycle.peak_to_peak.values(), reverse=True)[:1])))

    def _held(self, response: PeriodicResponse) -> PeriodicResponse:
        """A response with its own stability where a weak sine holds the loop's oscillation at a phase."""
        cycle, values = response.cycle, response.cycle.multipliers
        if values is None or not any(own.holds(self.drive.omega, cycle) for own in self.own):
            return response
        stable = is_stable(values)
        return replace(
            response, one_of_many=False, cycle=replace(cycle, stable=stable, stability_criterion=describe(values))
        )


def _beside(response: SteadyMotion, share: float) -> HybridSystem:
    """The begin of a response, moved by a share of its size along the direction in which runs leave it most."""
    values, vectors = np.linalg.eig(response.matrix)
    leaving = vectors[:, np.argmax(np.abs(values))].real
    y, n = response.passes[0].y.copy(), response.start.x0.size
    y[response.sought] += share * response.scale * leaving / np.max(np.abs(leaving))
    return replace(response.start, x0=y[:n])


def _away(response: SteadyMotion, one: HybridSystem, other: HybridSystem) -> float:
    """Distance of what repeats in two systems, relative to the size of a response."""
    apart, goes_on = stacked(one) - stacked(other), advances(one)
    clocks = np.flatnonzero(goes_on[: one.x0.size])
    if clocks.size:  # what tells the time differs by as much as the clock does
        apart = apart - goes_on * (apart[clocks[0]] / goes_on[clocks[0]])
    return float(np.max(np.abs(apart)[response.sought] / response.scale, initial=0.0))


def _midway(start: HybridSystem, other: HybridSystem, share: float) -> HybridSystem:
    """A system between two, its memory values, too, where both are in the same modes."""
    alike = np.array_equal(start.modes0, other.modes0)
    H0 = (1.0 - share) * start.H0 + share * other.H0 if alike else start.H0
    return replace(start, x0=(1.0 - share) * start.x0 + share * other.x0, H0=H0)


def _last_together(size: SteadyMotion, paths: Sequence[list[HybridSystem]], most: float) -> HybridSystem:
    """The last place at which two runs are still together: there they have come to what they part at."""
    both = list(zip(*paths, strict=False))
    near = [k for k, pair in enumerate(both) if _away(size, *pair) <= most]
    return both[max(near, default=0)][0]


def periodic_response(drive: Drive, multiple: int, response: SteadyMotion) -> PeriodicResponse:
    """A response as its users see it, begun where the input has phase zero unless an element switches there.

    With samples it begins at one of them.
    """
    strobe = strobe_of(response.start)
    if strobe is not None:
        locked = LockedOrbit.closed(strobe, response, round(response.duration / strobe.period))
        assert locked is not None  # a run of it ends early only where the motion itself does
        cycle = drive.to_user(locked_cycle(drive.system, locked), locked.start)
        return PeriodicResponse(multiple, drive.phase(locked.start.x0), drive.amplitude, cycle, response.one_of_many)
    shown, placed = response, next(drive.alongside(response.start, 0.0, 1))
    if placed is not None:
        x = placed.x0.copy()
        # At phase zero exactly, without the rounding of the way there.
        x[drive.sine] = 0.0, 1.0
        moved = SteadyMotion.begun(replace(placed, x0=x), response.duration)
        shown = moved if moved is not None and moved.gap < CLOSED and moved.ends_in_its_modes else response
    (once,) = shown.passes
    turn = shown.start, once.run, int(once.run.order[-1]) if once.run.count else -1
    rows = np.vstack([once.rows, stacked(once.run.end(shown.start))])
    cycle = drive.to_user(steady_cycle(drive.system, response, turn, rows, response.duration))
    phase = drive.phase(shown.start.x0)
    phase = 0.0 if 2 * np.pi - phase < 1e-9 else phase
    return PeriodicResponse(multiple, phase, drive.amplitude, cycle, response.one_of_many)


def _sentence(
    drive: Drive,
    responses: tuple[PeriodicResponse, ...],
    motion: Motion,
    exponent: float,
    search: Search,
    own: Entrainment | None,
) -> str:
    stable = sum(r.stable for r in responses)
    multiples = sorted({r.multiple for r in responses} - {1})
    what = f"{len(responses)} found, {stable} stable" if responses else "none found"
    which = "some of them of" if any(r.multiple == 1 for r in responses) else "of"
    sub = f", {which} {' and '.join(map(str, multiples))} periods of the input" if multiples else ""
    if held := sum(r.one_of_many for r in responses):
        sub += f", {'each' if held == len(responses) else f'{held} of them'} one of a continuum"
    goes_on = _FOLLOWS if search.repeats == 1 else _EVERY.format(search.repeats)
    by_law = own is not None and not search.settled
    if own is not None and by_law and own.is_of_second_order(drive.omega):
        goes_on = f"is {own.in_words(drive.frequency)}"
    elif own is not None and by_law and motion is Motion.QUASI_PERIODIC:
        goes_on = f"does not repeat itself: quasi-periodic, {own.in_words(drive.frequency)}"
    elif own is not None and by_law and not own.is_decided(drive.omega):
        goes_on = f"is on its own oscillation. {_UNTOLD}"
    elif search.leaves:
        goes_on = _LEAVES
    elif motion is not Motion.PERIODIC:
        goes_on = _PARTS[motion].format(float(np.exp(exponent)), search.reached)
    elif own is not None and by_law:
        goes_on = f"{goes_on}, {own.in_words(drive.frequency)}"
    missing = f" {_EVEN}" * search.one_is_missing
    return (
        f"Periodic responses to a sine of {_sine(drive)}: {what}{sub}. The run from the loop's own start "
        f"{goes_on.removesuffix('.')}.{missing}"
    )


def some_responses(drive: Drive, multiple: int) -> list[SteadyMotion]:
    """Some responses of so many periods, from the loop's own start and from the DF."""
    search = Search(drive, multiple)
    first = sinusoids(drive)
    search.run(drive.hybrid)
    search.from_first_order((*first, *near_misses(drive)))
    return list(islice((response for n, response in search.found if n == multiple), _SOME))
