"""The smallest disturbance that starts a limit cycle which coexists with rest, found by runs and confirmed on both
sides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.exact import range_of, steady_hybrid
from eppanalysis.methods.orbits.samples.locked import starts_on
from eppanalysis.methods.search.decay import PoincareReturns, comes_to_rest
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.simulation.futures import Switches, future_of
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import judge, run_hybrid
from eppanalysis.methods.steady.flow import advance, stacked
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import Strobe, is_sampled
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.readable import count, quantity, words
from eppanalysis.results import LimitCycle, Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Sizes that are tried, relative to the cycle's own; neighbours differ by a tenth.
_GRID = np.geomspace(1e-3, 30.0, 110)
_DIGITS = 1e-7
#: Squarings of a derivative between which what a disturbance becomes is compared, and a ratio that is growth: a drift
#: gains the 18th power of two, and rounding gains nothing in so many times.
_EARLY, _LATE, _GROWN = 22, 40, 1e3
#: Of a balance, relative to its largest terms, that is rounding.
_ROUNDING = 1e-9
#: Where an elbow is disturbed: at the forearm.
_FOREARM = ("theta", "theta_dot")
#: SI units of what an elbow is disturbed at; those of other loops are known by their signals.
_UNITS = {"harness_position": "m", "theta": "rad", "theta_dot": "rad/s"}


#: What is said of a loop with sampled controllers.
_AT_SAMPLES = (
    " The loop is sampled: it is disturbed just after a sample. Disturbances at other times, or with other contents "
    "of the controllers' memory, are not covered."
)


#: Why any disturbance starts a cycle.
GROWS = "linearised at rest, the loop lets it grow however small it is"


class NoRest(EppError):
    """The loop has no resting state that its start leads to, so there is nothing to disturb."""


@dataclass(frozen=True, repr=False)
class Trigger(Result):
    """A disturbance of the resting loop that just starts a limit cycle.

    Attributes
    ----------
    name : str
        External input that is stepped, or state that is displaced.
    size : float
        The threshold, signed [SI]; nan where no size up to `tried` starts a cycle; 0 where every disturbance grows
        however small, by the loop linearised at rest.
    settles, starts : float
        Sizes on both sides of it at which a run settles, and ends on a cycle; `starts` is the smallest tried where
        `size` is 0.
    tried : float
        Largest size tried.
    not_covered : str
        What the runs leave open, in sentences; empty where that is nothing.
    unit : str
        SI unit of what is disturbed; empty where none is known.
    operating_point : OperatingPoint or None
        Where the external inputs are held before it.
    """

    name: str
    size: float
    settles: float
    starts: float
    tried: float
    not_covered: str = ""
    unit: str = ""

    def __str__(self) -> str:
        """From which size on it starts a cycle, or up to which it starts none."""
        if np.isnan(self.size):
            tried = quantity(self.tried, self.unit)
            none = f"No disturbance of {words(self.name)} starts a limit cycle; the largest tried is {tried}."
            return none + self.not_covered
        if self.size == 0.0:
            return f"Any disturbance of {words(self.name)} starts a limit cycle: {GROWS}.{self.not_covered}"
        size = quantity(self.size, self.unit)
        return f"A disturbance of {words(self.name)} by {size} just starts a limit cycle.{self.not_covered}"

    def to_frame(self) -> pandas.DataFrame:
        """One row: what is disturbed, the threshold, and the sizes on both sides of it."""
        sizes = ("size", "settles", "starts", "tried")
        row = {"disturbed": words(self.name), **{name: getattr(self, name) for name in sizes}}
        return frame_of([row], dict.fromkeys(sizes, self.unit))

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Which sizes settle and which start a cycle."""
        return self.drawn("plot_trigger", ax)

    in_json = "name size settles starts tried not_covered unit operating_point provenance"


def trigger(
    system: LureSystem | CaseLike,
    operating_point: PointLike | None = None,
    *,
    states: Sequence[str] | None = None,
    cycles: CycleSearch | None = None,
) -> tuple[Trigger, ...]:
    """For every external input and state: the smallest disturbance of the resting loop that starts a limit cycle.

    Parameters
    ----------
    system : LureSystem or Case
        In discrete time, and with sampled controllers, it is disturbed just behind a sample.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held while the loop rests, or some of them by name [SI]; by default that of
        `cycles`, else that of the case or loop.
    states : sequence of str, optional
        States that are disturbed besides the inputs; by default the forearm's angle and velocity of an elbow, all
        states of another loop.
    cycles : CycleSearch, optional
        From an earlier search, for the sizes to be tried.

    Returns
    -------
    tuple of Trigger
        Both signs of each, smaller first; empty when there is no stable cycle.

    Raises
    ------
    NoRest
        If the loop has no resting state that a run from its start reaches.
    EppError
        If there is no such state, or an input is not constant.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> print(epp.trigger(epp.case("relay_deadzone"), states=["x1"])[0])
    A disturbance of x1 by 0.5004 just starts a limit cycle.
    """
    if operating_point is None and cycles is not None:
        operating_point = cycles.operating_point
    system, at = standing(system, operating_point, "trigger")
    # An empty search is false as a truth value, so it is compared with None.
    found = find_limit_cycles(system, at) if cycles is None else cycles
    if not found.stable:
        return ()
    form: InSamples | _AsItIs
    form = InSamples.at(system, at) if system.time_step else _AsItIs(system, steady_hybrid(system, at))
    hybrid = steady_hybrid(form.system, at)
    amplitude = np.max([form.range_of(c) for c in found], axis=0)
    to = Judge(40.0 * max(c.period for c in found), np.append(amplitude, np.zeros(len(system.v0))))
    rest = _rest(hybrid, form, system, at, to)
    as_on_cycles = np.abs(stacked(form.moved(rest, amplitude, np.zeros(len(system.v0)))) - stacked(rest))
    linear = Linearised.at(rest, to.horizon / 40.0, as_on_cycles)
    out: list[Trigger] = []
    for name, unit, apply, scale in _directions(system, form, rest, amplitude, states):
        grows = linear is not None and linear.grows(apply(scale))
        both = [replace(_threshold(name, apply, sign * scale, to, grows), unit=unit) for sign in (1.0, -1.0)]
        out += sorted(both, key=lambda k: (not np.isfinite(k.size), abs(k.size)))
    made_by = Provenance("smallest disturbance by runs", {"system": system.name}, {"size": _DIGITS})
    beside = _AT_SAMPLES if is_sampled(system.elements) else ""
    return tuple(replace(k, provenance=made_by, operating_point=at, not_covered=beside + k.not_covered) for k in out)


@dataclass(frozen=True, eq=False)
class Judge:
    """Where a run ends, with sizes that tell rest from motion."""

    horizon: float
    size: Array

    def ends(self, start: HybridSystem) -> tuple[Status, Run]:
        """SETTLED, LIMIT_CYCLE or what else it is, and the run."""
        t, strobe = self.horizon, Strobe.of(start)
        for _ in range(4):
            most = 100_000 if strobe is None else strobe.samples_in(t) + 20_000
            run = run_hybrid(start, t, np.zeros(0), 2.0 * start.time_scale, most, 600 if strobe is None else most)
            status, _ = judge(start, run, t)
            still = strobe is None and status is Status.UNDECIDED
            future = future_of(run.end(start)) if still else None
            if still and comes_to_rest(future, PoincareReturns.of(start, run), start, run, t, self.size):
                status = Status.SETTLED
            if status is not Status.UNDECIDED:
                break
            t = 2.5 * (t + (future.after if isinstance(future, Switches) else 0.0))  # behind the next switch of a drift
        return status, run


@dataclass(frozen=True, eq=False)
class Linearised:
    """A loop about its rest: what a small disturbance becomes over a time, and over that time again and again."""

    rest: HybridSystem
    first: Array  # (N, N): derivative by the rest of where the loop is half the time later, between samples
    powers: tuple[Array, Array]  # (N, N): derivatives over two numbers of times, the second one far larger
    size: Array  # (N,): how far what moves on cycles does

    @classmethod
    def at(cls, rest: HybridSystem, period: float, size: Array) -> Linearised | None:
        """None where the flow has no derivative at rest, or states do not tell all, as behind a dead time."""
        strobe = Strobe.of(rest)
        if strobe is not None:
            period = strobe.period * np.ceil(period / strobe.period)
        if np.any(rest.model.smooth_kind == DELAY_LINE) or not np.isfinite(period):
            return None
        half = advance(rest, 0.5 * period)
        whole = None if half is None else advance(half.run.end(rest), period)
        if half is None or whole is None or not np.all(np.isfinite(half.derivative) & np.isfinite(whole.derivative)):
            return None
        powers = [whole.derivative]
        with np.errstate(over="ignore", invalid="ignore"):  # what grows may do so beyond all range
            for _ in range(_LATE):
                powers.append(powers[-1] @ powers[-1])
        return cls(rest, half.derivative, (powers[_EARLY], powers[_LATE]), size)

    def grows(self, moved: HybridSystem) -> bool:
        """Whether what becomes of a disturbance has no bound, as beside an unstable pole or where something drifts."""
        moves = np.flatnonzero(self.size > 0.0)
        disturbance = self.first @ (stacked(moved) - stacked(self.rest))
        with np.errstate(over="ignore", invalid="ignore"):
            early, late = (np.abs((power @ disturbance)[moves] / self.size[moves]).max() for power in self.powers)
        return bool(not np.isfinite(late) or late > _GROWN * max(early, 1.0))


@dataclass(frozen=True, eq=False)
class _AsItIs:
    """A loop that has motions between samples; offers what :class:`InSamples` does."""

    system: LureSystem
    hybrid: HybridSystem

    def start(self, state: Array, memory: Sequence[Any]) -> tuple[Array, Sequence[Any]]:
        return state, memory

    def moved(self, start: HybridSystem, state: Array, inputs: Array) -> HybridSystem:
        return replace(start, x0=start.x0 + np.append(state, inputs))

    def range_of(self, cycle: LimitCycle) -> Array:
        return range_of(self.hybrid, cycle)


def _rest(
    hybrid: HybridSystem, form: InSamples | _AsItIs, system: LureSystem, at: OperatingPoint, to: Judge
) -> HybridSystem:
    """The system at rest, as a run from its start (or, if that oscillates, from its origin) leaves it."""
    carried = _carried(system, at)
    for scale in (1.0, 0.0, 0.01):
        start = hybrid.begun(*form.start(scale * system.x0 + carried, system.memory))
        status, run = to.ends(start)
        strobe = Strobe.of(start)
        if status is Status.SETTLED and strobe is not None:
            return next(starts_on(strobe, run, 1, 1))
        if status is Status.SETTLED:
            return run.end(start)
    raise NoRest(f"{system.name}: no resting state was reached from the start, so there is nothing to disturb.")


def _carried(system: LureSystem, at: OperatingPoint) -> Array:
    """How far a rest is carried along with the inputs, shape (n,), so that all elements and rates stay as they are.

    Zero where the inputs have not moved, or the loop is no longer the same where they are.
    """
    moved = at.vector(system) - system.v0
    if not np.any(moved):
        return np.zeros(system.x0.size)
    still = np.eye(len(system.A)) if system.time_step else 0.0  # the next state is this one
    rows = np.vstack([system.A - still, system.C])
    wanted = -np.concatenate([system.B_input, system.D_input]) @ moved
    change = np.linalg.lstsq(rows, wanted, rcond=None)[0]
    size = np.abs(rows) @ np.abs(change) + np.abs(wanted)
    fits = np.all(np.abs(rows @ change - wanted) <= _ROUNDING * size.max(initial=0.0))
    return np.asarray(change if fits else np.zeros(change.size), float)


Direction = tuple[str, str, Callable[[float], HybridSystem], float]


def _directions(
    system: LureSystem, form: InSamples | _AsItIs, rest: HybridSystem, amplitude: Array, states: Sequence[str] | None
) -> Iterator[Direction]:
    """Name and unit, the system disturbed by a size, and the size that compares with the cycle."""
    z = np.abs(system.C) @ amplitude
    at_states, at_inputs = np.split(np.eye(len(system.A) + len(system.v0)), [len(system.A)])

    def moved(along: Array) -> Callable[[float], HybridSystem]:
        return lambda size: form.moved(rest, *np.split(size * along, [len(system.A)]))

    for i, name in enumerate(system.input_names):
        on = np.abs(system.D_input[:, i])
        # A step of this input that moves an element's input as far as the cycle does.
        reach = float(np.max(np.where(on > 0, z / np.where(on > 0, on, 1.0), 0.0), initial=0.0))
        unit = _UNITS.get(name) or system.signals.unit_of(v=np.eye(len(system.v0))[i])
        yield name, unit, moved(at_inputs[i]), reach or max(abs(float(system.v0[i])), 1.0)
    usual = [n for n in _FOREARM if n in system.state_names] or system.state_names
    for name in usual if states is None else states:
        if name not in system.state_names:
            known = ", ".join(system.state_names)
            raise EppError(f"{system.name}: there is no state {name!r}; expected one of: {known}.")
        place = system.state_names.index(name)
        if system.time_step or rest.compared[place]:  # not a clock
            unit = _UNITS.get(name) or system.signals.unit_of(x=np.eye(system.x0.size)[place])
            yield name, unit, moved(at_states[place]), float(amplitude[place]) or 1.0


def _threshold(
    name: str, apply: Callable[[float], HybridSystem], scale: float, to: Judge, grows: bool = False
) -> Trigger:
    """The first size on the grid that starts a cycle, and bisection between it and the one before; none where it grows
    from nothing.
    """
    # Upwards: beyond the first size that starts a cycle there may be larger ones that settle again.
    below, left = 0.0, 0
    for share in _GRID:
        size = float(share * scale)
        status = to.ends(apply(size))[0]
        if status is Status.LIMIT_CYCLE:
            break
        below, left = size, left + (status is not Status.SETTLED)
    else:
        return Trigger(name, float("nan"), below, float("nan"), float(_GRID[-1] * scale), _left_open(left))
    above = size
    if grows and below == 0.0:
        # What drifts, as a motor in the gap of its gear, grows only as far as to a stop, and may rest there.
        below = _DIGITS * size
        if to.ends(apply(below))[0] is not Status.SETTLED:
            return Trigger(name, 0.0, 0.0, above, size)
    while abs(above - below) > _DIGITS * abs(above):
        middle = 0.5 * (above + below)
        status = to.ends(apply(middle))[0]
        if status is Status.LIMIT_CYCLE:
            above = middle
        else:
            below, left = middle, left + (status is not Status.SETTLED)
    return Trigger(name, 0.5 * (above + below), below, above, size, _left_open(left))


def _left_open(runs: int) -> str:
    """What runs that came to no end leave open, in a sentence."""
    return f" {count(runs, 'run')} of smaller disturbances neither settled nor reached a cycle." if runs else ""
