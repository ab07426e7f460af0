"""One exact orbit from an approximate cycle: from a run, by Newton's method on the flow, or by harmonic balance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.harmonic.balance import balances_of
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.methods.harmonic.path import balance_on_curve
from eppanalysis.methods.orbits.balanced import orbit_of_balance
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.decoupled import in_decoupled_states
from eppanalysis.methods.orbits.delayed.smooth import closed_behind_delay, is_smooth_delayed
from eppanalysis.methods.orbits.mirrored import mirrored_orbits
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.samples.locked import locked_orbit, unclosed
from eppanalysis.methods.orbits.shooting import orbit_from, orbits_near, same_orbit
from eppanalysis.methods.orbits.target import Target
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.results import LimitCycle

#: Estimated error below which a balance may not be followed by another one of higher order.
_TRUSTED = 0.05
#: And below which what does not agree with it is not the orbit looked for.
_REFUTES = 5e-3
#: Steps of the engine, and what is worth as many, after which an orbit that has not been closed will not be.
MOST_WORK = 1e7
#: Steps of a run once round a cycle, whose extrema they miss by a thousandth of the motion.
_STEPS = 64


def steady_hybrid(system: LureSystem, at: OperatingPoint | None = None, observed: bool = False) -> HybridSystem:
    """The hybrid system with its inputs held, by default at `v0`; `observed` as for :meth:`HybridSystem.from_lure`.

    Raises
    ------
    EppError
        For a discrete-time system, or an input that is not constant.
    ModelError
        If an input is unknown, or what is given names none.
    """
    if system.time_step:
        raise EppError(f"{system.name} is a loop in discrete time, which has no motion between its samples.")
    memory = system if at is None else replace(system, v0=at.vector(system))
    return HybridSystem.from_lure(memory, observed=observed).held


def exact_orbit(
    system: LureSystem | CaseLike, start: LimitCycle, operating_point: PointLike | None = None
) -> LimitCycle:
    """The exact orbit near an approximate one (a prediction, a balance, or the limit cycle of a run).

    A run from the start gives the sequence of events. A run leaves an unstable cycle, and may be on another one before
    it has come round: a cycle that is its own mirror image is begun as half an orbit and its image, and one predicted
    unstable is closed without a run, from all sizes that it may have. Where the orbit found is not the requested one
    (frequency, size, mean and symmetry within twice the start's own estimate of its error), or not of the predicted
    stability, harmonic balance of rising order is put in between.

    Parameters
    ----------
    system : LureSystem or Case
        In discrete time, and with sampled controllers, the orbit closes after a whole number of samples.
    start : LimitCycle
        With state and period.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.

    Returns
    -------
    LimitCycle
        With status NOT_CONVERGED, and otherwise as given, where the requested orbit was not closed;
        its `note` then says what was found instead, if anything.

    Raises
    ------
    EppError
        For a start without a state, or an input that is not constant.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    >>> predicted = epp.predict_limit_cycles(loop)[0]
    >>> exact = epp.exact_orbit(loop, predicted)
    >>> print(f"{predicted.frequency:.4f} Hz, exactly {exact.frequency:.4f} Hz")
    0.2251 Hz, exactly 0.2197 Hz
    """
    system, at = standing(system, operating_point, "exact_orbit")
    require_own(system, start)
    if (apart := in_decoupled_states(system, at.vector(system))) is not None:
        return apart.to_user(_as_it_is(apart.system, apart.from_user(start), apart.point(at)))
    return _as_it_is(system, start, at)


def _as_it_is(system: LureSystem, start: LimitCycle, at: OperatingPoint) -> LimitCycle:
    """The exact orbit in the states in which the loop is given."""
    if system.time_step:
        form = InSamples.at(system, at)
        return form.to_user(_as_it_is(form.system, form.from_user(start), at))
    hybrid = steady_hybrid(system, at)
    if (strobe := Strobe.of(hybrid)) is not None:
        return replace(locked_orbit(system, hybrid, strobe, start), operating_point=at)
    found: list[Candidate] = []
    if is_smooth_delayed(hybrid):
        return replace(_behind_delay(system, hybrid, start, at), operating_point=at)
    with suppress(BudgetExceeded), budget(MOST_WORK) as work:
        found.extend(orbits_of(system, hybrid, start, at))
    orbit = asked_for(found)
    if orbit is not None:
        return replace(to_limit_cycle(system, orbit), operating_point=at)
    note = start.note if work.remaining else "the steps allowed ended before an orbit was closed"
    note = f"the orbit that was found {found[-1].difference}" if found else note
    return replace(unclosed(start, note), operating_point=at)


def require_own(system: LureSystem, cycle: LimitCycle) -> None:
    """Raise EppError where a cycle has not the states and signals of a loop in continuous time."""
    cycle.require_state(len(system.A))
    others = [name for name in cycle.harmonics if name not in system.signals.names]
    if others:
        raise EppError(f"{system.name}: a limit cycle with a signal {others[0]} is of another loop; expected its own.")


def _behind_delay(system: LureSystem, hybrid: HybridSystem, start: LimitCycle, at: OperatingPoint) -> LimitCycle:
    with suppress(BudgetExceeded), budget(MOST_WORK):
        closed, note = closed_behind_delay(system, hybrid, start, at)
        return closed or unclosed(start, note)
    return unclosed(start, "no harmonic balance leads to it within the steps allowed")


@dataclass(frozen=True, eq=False)
class Candidate:
    """An orbit that an approximate cycle led to."""

    orbit: Orbit
    difference: str  # what distinguishes it from the one looked for; empty for nothing
    as_stable: bool  # whether it is as stable as was predicted, if anything was


def asked_for(found: Sequence[Candidate]) -> Orbit | None:
    """The orbit that was requested, rather as stable as predicted; what is said of an orbit last counts."""
    last = {id(f.orbit): f for f in found}
    fitting = sorted((f for f in last.values() if not f.difference), key=lambda f: f.as_stable)
    return fitting[-1].orbit if fitting else None


def orbits_of(
    system: LureSystem,
    hybrid: HybridSystem,
    start: LimitCycle,
    at: OperatingPoint,
    by_balance: bool = True,
    neighbours: bool = False,
) -> Iterator[Candidate]:
    """Closed orbits that an approximate cycle leads to, some of them several times; see :func:`asked_for`.

    With `neighbours` runs from the cycle are tried to the end, although the one looked for has been found: there may be
    others near.
    """
    hybrid = _seen(system, hybrid, start, at)
    asked = Target.of(system, hybrid, start)
    met: list[Orbit] = []
    done = False
    # A run leaves an unstable cycle: only who wants its neighbours, too, begins with runs.
    for ways in (_directly, _about) if neighbours or start.stable is not False else (_about, _directly):
        for orbit in _new(ways(hybrid, asked, met), met):
            found = _compared(asked, orbit, start.stable)
            yield found
            done |= not found.difference and found.as_stable
            if done and not neighbours:
                return
        if done:
            return
    if by_balance and start.harmonics and not done:
        yield from _by_balance(asked, hybrid, met, at)


def _new(orbits: Iterable[Orbit], met: list[Orbit]) -> Iterator[Orbit]:
    """Those that have not been met."""
    for orbit in orbits:
        if not any(same_orbit(known, orbit) for known in met):
            met.append(orbit)
            yield orbit


def _compared(asked: Target, orbit: Orbit, stable: bool | None) -> Candidate:
    return Candidate(orbit, asked.difference(orbit), stable in (None, is_stable(orbit.multipliers)))


def _directly(hybrid: HybridSystem, asked: Target, met: Sequence[Orbit]) -> Iterator[Orbit]:
    """Orbits from runs that begin on an approximate cycle."""
    # From an unstable cycle a run departs at once: the half of a symmetric one comes before it (docs/theory/
    # exact_orbits.md, Closing an orbit).
    x, memory = start_of(hybrid, asked.cycle)
    if asked.image is not None:
        yield from mirrored_orbits(hybrid, asked.image, x, memory, asked.cycle.period)
    yield from islice(orbits_near(hybrid, x, memory, asked.cycle.period, met), 2)


def _about(hybrid: HybridSystem, asked: Target, met: Sequence[Orbit]) -> Iterator[Orbit]:
    """An unstable orbit that Newton's method finds from an approximate one, of the size that it has or may have."""
    cycle = asked.cycle
    if cycle.stable is not False or not cycle.mean_state.size:
        return
    x, memory = start_of(hybrid, cycle)
    centre = x.copy()
    centre[: hybrid.n_plant] = cycle.mean_state
    # Between a prediction and its neighbours there may be less than its error.
    for size in (1.0, 1.0 / (1.0 + asked.tolerance), 1.0 + asked.tolerance):
        orbit = orbit_from(hybrid, centre + size * (x - centre), memory, cycle.period, met)
        if orbit is not None:
            yield orbit
            if not is_stable(orbit.multipliers):
                return


def _by_balance(asked: Target, hybrid: HybridSystem, met: list[Orbit], at: OperatingPoint) -> Iterator[Candidate]:
    """Exact orbits that balances of rising order lead to, until one is that of a balance that can be trusted.

    What was met before is compared with each balance, too; but only a good one has the word against an orbit.
    """
    stable = asked.cycle.stable
    # Newton's method may leave the cycle for another one from order to order.
    loosely = asked.loosened()
    try:
        for balance in _balances(asked, at):
            wanted = Target.of(asked.system, hybrid, balance)
            before = tuple(met)
            for orbit in chain(before, _new(_of_balance(hybrid, wanted, at, met), met)):
                found = _compared(wanted, orbit, stable)
                if not found.difference:
                    found = _compared(loosely, orbit, stable)
                if not found.difference or orbit not in before or balance.error_estimate < _REFUTES:
                    yield found
                if not found.difference and balance.error_estimate < _TRUSTED:
                    return
    except ModelError:  # an element that harmonic balance does not cover
        return


def _balances(asked: Target, at: OperatingPoint) -> Iterator[LimitCycle]:
    """Balances of rising order, and where none of them leads to the orbit, that on the curve from the DF."""
    yield from balances_of(asked.system, asked.cycle, at)
    # Low orders may be far from both the DF and the cycle (docs/how_we_know.md, Does the error
    # estimate cover the error?).
    straight = balance_on_curve(Loop.of(asked.system, at.vector(asked.system)), asked.cycle)
    if straight is not None and straight.error_estimate < _TRUSTED:
        yield straight


def _of_balance(hybrid: HybridSystem, wanted: Target, at: OperatingPoint, met: Sequence[Orbit]) -> Iterator[Orbit]:
    """Orbits from runs that begin on a balance, and the one from its own switches where that can be trusted."""
    yield from _directly(hybrid, wanted, met)
    if wanted.cycle.error_estimate < _TRUSTED:
        own = orbit_of_balance(hybrid, Loop.of(wanted.system, at.vector(wanted.system)), wanted.cycle)
        if own is not None:
            yield own
    yield from _about(hybrid, wanted, met)


def centre_of(hybrid: HybridSystem, cycle: LimitCycle) -> Array:
    """Mean of the state on a cycle (n,); where its method does not tell, the middle of a run once round."""
    if cycle.mean_state.size == hybrid.n_plant:
        return cycle.mean_state
    run = _once_round(hybrid, cycle)
    return 0.5 * (run.low + run.high)[: hybrid.n_plant]


def range_of(hybrid: HybridSystem, cycle: LimitCycle) -> Array:
    """How far each state moves on a cycle (n,): between its events where those are known, else in a run once round."""
    if cycle.event_states.size:
        return np.ptp(cycle.event_states, axis=0)
    run = _once_round(hybrid, cycle)
    return (run.high - run.low)[: hybrid.n_plant]


def _once_round(hybrid: HybridSystem, cycle: LimitCycle) -> Run:
    x, memory = start_of(hybrid, cycle.require_state(hybrid.n_plant))
    step = cycle.period / _STEPS  # the range of a run is that of its steps
    return run_hybrid(hybrid.at(x, memory, hybrid.modes0), cycle.period, np.zeros(0), step, 60_000, 1)


def _seen(system: LureSystem, hybrid: HybridSystem, cycle: LimitCycle, at: OperatingPoint | None) -> HybridSystem:
    """The system in which an approximate cycle has events: what slips all the time under a curve of friction, or stays
    within its stops, meets none but its extrema.
    """
    quiet = hybrid.may_be_quiet and _once_round(hybrid, cycle).count == 0
    return steady_hybrid(system, at, observed=True) if quiet else hybrid


def start_of(hybrid: HybridSystem, cycle: LimitCycle) -> tuple[Array, Array]:
    """State with inputs, and memory values, at the beginning of a cycle."""
    start = hybrid.begun(cycle.state, cycle.memory)
    return start.x0, start.H0
