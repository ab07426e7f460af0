"""Exact limit cycles of loops in discrete time: orbits that close after a whole number of samples.

On every sample each element is on one of its pieces, and as long as the pieces stay the same the state after n samples
is an affine function of the state before: its fixed point solves one linear equation, and its multipliers are the
eigenvalues of the product of the steps. The equation is solved for the pieces that are met, these are looked up again
at the solution, and so on (Newton's method on a piecewise-affine map ends after finitely many steps, exactly). What is
accepted comes back under the iteration itself, so that its pieces are the right ones.

A motion whose period is no whole number of samples has no such orbit: it fills a curve. Where a turn has many samples
it is listed as long runs have it (``unlocked``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.samples.sample_step import Step
from eppanalysis.methods.orbits.samples.unlocked import unlocked
from eppanalysis.methods.simulation.effort import Spent
from eppanalysis.methods.simulation.iterate import cycle_of_samples
from eppanalysis.methods.simulation.stability import describe, is_stable, multipliers
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.results import EXACT_ORBIT, SIMULATION, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

__all__ = ["SampledSearch", "sampled_orbit", "search_sampled"]

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
_ITERATIONS = 12
_CLOSED = 1e-11  # change over a period, relative to the motion, of an orbit that is closed
_SAME = 1e-7
_STILL = 1e-9
_NEUTRAL = 1e-7
_MOST_STARTS, _MOST_PERIODS, _MOST_SAMPLES = 60, 60, 8000
#: Turns of the slowest prediction that runs last at least, as far as they are not longer than so many samples.
_TURNS, _LONGEST = 24, 60_000
#: Samples of a turn from which orbits of its length are sought where runs end on them alone.
_LONG = 500
_SCALES = (0.03, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 4.0)
_N_RANDOM = 24
_SEED = 20050901
#: Numbers of samples that are always tried.
_SHORT = range(2, 9)
_FAR = 1e9


@dataclass(frozen=True, eq=False)
class SampledSearch:
    """Cycles found, how the runs of the search ended, and the lengths that were `left` when its work was spent."""

    cycles: tuple[LimitCycle, ...]
    rest: Array | None
    diverges: bool
    undecided: int
    left: tuple[int, ...]
    search: str
    runs: int


def _round(
    step: Step, S: Array, marks: list[Any], n: int, scale: Array, careful: bool = False
) -> tuple[Array, list[Any], Array, BoolArray]:
    """States after n samples, marks, derivative, and whether a border was met."""
    J, met = np.broadcast_to(np.eye(step.size), (len(S), step.size, step.size)), np.zeros(len(S), bool)
    for _ in range(n):
        S, marks, _, slopes = step.advance(S, marks, scale, careful)
        J, met = slopes[0] @ J, met | slopes[1]
    return S, marks, J, met


def _closed(step: Step, S: Array, marks: list[Any], n: int, scale: Array) -> tuple[Array, list[Any]]:
    """States (k, d) that come back after n samples, from starts (m, d), and their marks."""
    active = np.ones(len(S), bool)
    eye, closed = np.eye(step.size), np.zeros(len(S), bool)
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            k = np.flatnonzero(active)
            if not k.size:
                break
            after, marks_k, J, _ = _round(step, S[k], _chosen(marks, k), n, scale)
            r = (after - S[k]) / scale
            small = np.abs(r).max(1) < _CLOSED
            closed[k[small]] = True  # and moved once more, to rounding
            matrix = (J - eye) / scale[:, None] * scale
            good = np.isfinite(matrix).all((1, 2)) & np.isfinite(r).all(1)
            change = np.zeros_like(r)
            change[good] = -(np.linalg.pinv(matrix[good], rcond=1e-12) @ r[good][..., None])[..., 0]
            S[k] += change * scale
            marks = _put(marks, k[good], _chosen(marks_k, np.flatnonzero(good)))
            active[k] = good & ~small & (np.abs(change).max(1) < _FAR)
    keep = np.flatnonzero(closed)
    return S[keep], _chosen(marks, keep)


def _chosen(marks: list[Any], k: NDArray[np.intp]) -> list[Any]:
    def of(mark: Any) -> Any:
        if mark is None:
            return None
        if isinstance(mark, Slip):
            return Slip(*(np.asarray(v)[k] if np.ndim(v) else np.full(k.size, v) for v in mark))
        return np.asarray(mark)[k]

    return [of(mark) for mark in marks]


def _put(marks: list[Any], k: NDArray[np.intp], new: list[Any]) -> list[Any]:
    """Marks with those of rows k replaced."""
    out = []
    for mark, fresh in zip(marks, new, strict=True):
        if isinstance(mark, Slip):
            parts = [np.array(np.broadcast_to(v, np.shape(mark.value))) for v in mark]
            for part, given in zip(parts, fresh, strict=True):
                part[k] = given
            out.append(Slip(*parts))
        else:
            out.append(mark)
    return out


@dataclass(frozen=True, eq=False)
class _Found:
    """A closed orbit: states (n, d) at its samples, in the size of `scale`, with marks at the first."""

    states: Array
    marks: list[Any]
    scale: Array

    @property
    def n(self) -> int:
        return len(self.states)

    def same(self, other: _Found) -> bool:
        """Whether two orbits are one, begun at different samples."""
        if self.n != other.n:
            return False
        nearest = int(np.argmin((np.abs(other.states - self.states[0]) / self.scale).max(1)))
        turned = np.roll(other.states, -nearest, 0)
        return bool((np.abs(turned - self.states) / self.scale).max() < _SAME)


def _orbits(step: Step, S: Array, marks: list[Any], n: int, scale: Array) -> list[_Found]:
    """Different orbits of n samples, none of them a shorter one or a rest, that starts lead to."""
    S, marks = _closed(step, S.copy(), marks, n, scale)
    found: list[_Found] = []
    if not len(S):
        return found
    path = [S]
    at, now = S, marks
    for _ in range(n):
        at, now, _, _ = step.advance(at, now)
        path.append(at)
    states = np.stack(path, 1)
    for i in range(len(S)):
        orbit = _Found(states[i, :n], _chosen(marks, np.array([i])), scale)
        moved = (np.abs(states[i, 1:] - states[i, 0]) / scale).max(1)
        if not np.all(np.isfinite(moved)) or moved[:-1].min(initial=np.inf) < _SAME or moved.max() < 1e-6:
            continue
        if not _closes(states[i]):
            continue
        if n > 1 and not any(orbit.same(known) for known in found):
            found.append(orbit)
    return found


def _closes(states: Array) -> bool:
    """Whether the states (n + 1, d) of a round come back in the size of their own motion, however large others are."""
    size = np.abs(states).max(0)
    allowed = _STILL * np.ptp(states, axis=0) + len(states) * np.finfo(float).eps * size
    return bool(np.all(np.abs(states[-1] - states[0]) <= allowed))


def _limit_cycle(step: Step, orbit: _Found) -> LimitCycle:
    system, scale = step.system, orbit.scale
    S, marks = orbit.states[:1], orbit.marks
    after, _, J, border = _round(step, S, marks, orbit.n, scale, careful=True)
    W = np.zeros((orbit.n, system.B.shape[1]))
    at, now = S, marks
    for k in range(orbit.n):
        at, now, w, _ = step.advance(at, now)
        W[k] = w[0]
    s, n = system.signals, system.A.shape[0]
    Y = orbit.states[:, :n] @ s.C.T + W @ s.D.T + s.D_input @ step.value + s.constant
    residual = float((np.abs(after - S) / scale).max())
    noise = residual + np.finfo(float).eps * np.sqrt(orbit.n)
    inverse = np.linalg.pinv((J[0] - np.eye(step.size)) / scale[:, None] * scale, rcond=1e-12)
    values = multipliers(J[0], scale, step.size)
    many = bool(np.any(np.abs(values - 1.0) < _NEUTRAL))
    made_by = Provenance(EXACT_ORBIT, {"system": system.name, "samples": orbit.n, "time_step": system.time_step})
    cycle = cycle_of_samples(
        dict(zip(s.names, Y.T.copy(), strict=True)), orbit.n, float(system.time_step or 1.0), residual, made_by
    )
    stored = dict(zip(step.remembers, orbit.states[0, n:], strict=False))
    return replace(
        cycle,
        method=EXACT_ORBIT,
        stable=None if border[0] else is_stable(values, many),
        stability_criterion=_BORDER if border[0] else describe(values, many),
        multipliers=None if border[0] else values,
        residual=residual,
        error_estimate=float(np.abs(inverse).sum(1).max() * noise),
        state=orbit.states[0, :n].copy(),
        mean_state=orbit.states[:, :n].mean(axis=0),
        memory=tuple(float(stored[i]) if i in stored else None for i in range(len(system.elements))),
        units=dict(zip(s.names, s.units or [""] * len(s.names), strict=True)),
    )


_BORDER = (
    "an element is where two of its pieces meet on a sample: a disturbance to either side has multipliers of its own"
)


def _ready(system: LureSystem, at: OperatingPoint) -> Step:
    step = Step(system, at.vector(system))
    for name, e in zip(system.element_names, system.elements, strict=True):
        if e.n_inputs > 1:
            raise EppError(f"{system.name}: {name} has several inputs; exact orbits in discrete time need one each.")
    return step


def _runs(step: Step, starts: Array, memory: Sequence[Any], samples: int) -> tuple[Array, list[Any]]:
    """States (samples, m, d) of runs from states (m, n) of the loop, and the marks at their end."""
    S, marks = step.begin(starts, memory)
    out = np.empty((samples, *S.shape))
    with np.errstate(all="ignore"):
        for k in range(samples):
            out[k] = S
            S, marks, _, _ = step.advance(S, marks)
    return out, marks


def _scale(paths: Array) -> Array:
    """Amplitude of each place of the state, (d,): of the runs that do not settle, or of the starts where all do."""
    stays = paths[:, np.all(np.abs(paths) < _FAR, (0, 2))]
    begin = np.ptp(paths[:2], (0, 1))
    size = np.ptp(stays[len(stays) // 2 :], (0, 1)) if stays.shape[1] else begin
    size = np.where(size > 1e-6 * begin, size, begin)
    return np.where(size > 0, size, max(size.max(initial=0.0), 1e-300))


def _seeds(paths: Array, marks: list[Any], most: int) -> tuple[Array, list[Any]]:
    """States of all runs, early ones denser, with marks of one of them (they come right within a round)."""
    when = np.unique(np.geomspace(1, len(paths), 4 * most).astype(int)) - 1
    states = paths[when].reshape(-1, paths.shape[-1])
    states = states[np.isfinite(states).all(1) & (np.abs(states).max(1) < _FAR)]
    chosen = states[np.linspace(0, len(states) - 1, min(most, len(states))).astype(int)]
    return chosen.copy(), _chosen(marks, np.zeros(len(chosen), np.intp))


def _between(found: list[_Found]) -> tuple[Array, list[Any]]:
    """States between neighbouring points of known orbits: on a curve of motions, unstable ones lie between stable."""
    points = np.concatenate([o.states for o in found])
    away = (np.abs(points[:, None] - points[None]) / found[0].scale).max(2)
    np.fill_diagonal(away, np.inf)
    near = np.argsort(away, axis=1)[:, :2]
    seeds = np.concatenate(
        [(1 - w) * points + w * points[near[:, i]] for i in range(near.shape[1]) for w in (0.3, 0.5)]
    )
    seeds = seeds[np.linspace(0, len(seeds) - 1, min(2 * _MOST_STARTS, len(seeds))).astype(int)]
    return seeds, _chosen(found[0].marks, np.zeros(len(seeds), np.intp))


def _all_orbits(step: Step, seeds: tuple[Array, list[Any]], n: int, scale: Array) -> list[LimitCycle]:
    """Cycles of n samples that seeds lead to, and that lie between those."""
    found = _orbits(step, *seeds, n, scale)
    if found and n * len(found) <= _MOST_SAMPLES // 4:
        more = _orbits(step, *_between(found), n, scale)
        found += [o for o in more if not any(o.same(known) for known in found)]
    return [_limit_cycle(step, o) for o in found]


def sampled_orbit(system: LureSystem, start: LimitCycle, at: OperatingPoint) -> LimitCycle:
    """The closed orbit of a loop in discrete time nearest to an approximate one; see ``exact_orbit``."""
    step = _ready(system, at)
    if start.state.size != system.A.shape[0] and start.method != SIMULATION:
        raise EppError(f"{system.name}: the start has no state; expected a predicted cycle, or an exact one.")
    x = start.state if start.state.size == system.A.shape[0] else system.x0
    memory = start.memory if len(start.memory) == len(system.elements) else system.memory
    length = start.period / float(system.time_step or 1.0)
    middle = _middle(start, x.size)
    starts = middle + np.array(_SCALES)[:, None] * (x - middle)
    paths, marks = _runs(step, starts, memory, int(min(12 * length + 50, _MOST_SAMPLES)))
    # A whole number of samples is taken at its word; any other is approximate, and its neighbours are all tried.
    if abs(length - round(length)) < 1e-9 * length:
        lengths: Iterable[int] = [round(length)]
    else:
        lengths = range(max(2, int(0.75 * length)), min(int(1.35 * length) + 2, int(0.75 * length) + _MOST_PERIODS))
    scale = _scale(paths)
    cycles = [
        _limit_cycle(step, o) for n in lengths for o in _orbits(step, *_seeds(paths, marks, _MOST_STARTS), n, scale)
    ]
    alike = [c for c in cycles if _away(c, start) < np.log(2.0)]
    fit = [c for c in alike if start.stable is None or c.stable == start.stable] or alike
    if fit:
        return min(fit, key=lambda c: _away(c, start))
    return replace(start, method=EXACT_ORBIT, status=Status.NOT_CONVERGED, stable=None, residual=float("nan"))


def _middle(cycle: LimitCycle, n: int) -> Array:
    """Where starts of other sizes are made about: the mean of a cycle, or the origin where that is not known."""
    return cycle.mean_state if cycle.mean_state.size == n else np.zeros(n)


def _away(cycle: LimitCycle, start: LimitCycle) -> float:
    """How far two cycles are apart in period and size, as logarithms."""
    sizes = [(cycle.peak_to_peak[k], v) for k, v in start.peak_to_peak.items() if v > 0 and cycle.peak_to_peak.get(k)]
    return abs(float(np.log(cycle.period / start.period))) + max(
        (abs(float(np.log(a / b))) for a, b in sizes), default=0.0
    )


def search_sampled(system: LureSystem, at: OperatingPoint, predicted: Sequence[LimitCycle]) -> SampledSearch:
    """All orbits of a loop in discrete time that runs and predictions lead to, stable and unstable."""
    step = _ready(system, at)
    starts = _starts(system, predicted)
    turns = [c.period / float(system.time_step or 1.0) for c in predicted]
    slowest = max(turns) if turns else _slowest(system)
    samples = int(np.clip(320 * slowest, 400, max(_MOST_SAMPLES, min(_TURNS * slowest, _LONGEST))))
    paths, marks = _runs(step, starts, system.memory, samples)
    scale = _scale(paths)
    ends = [_end(paths[:, i], scale) for i in range(len(starts))]
    open_ = [i for i, n in enumerate(ends) if n == 0]
    tails = [paths[len(paths) // 2 :, i] for i in open_]
    motions, on = unlocked(step, tails, [_chosen(marks, np.array([i])) for i in open_])
    sought = _lengths(ends, turns)
    left, cycles, seeds = list(sought), list(motions), _seeds(paths, marks, _MOST_STARTS)
    with suppress(Spent):
        while left:
            cycles += _all_orbits(step, seeds, left[0], scale)
            left.pop(0)
    resting = [i for i, n in enumerate(ends) if n == 1]
    name = system.signals.names[0]
    undecided = ends.count(0) - len(on)
    return SampledSearch(
        cycles=tuple(sorted(cycles, key=lambda c: (c.peak_to_peak[name], c.period))),
        rest=paths[-1, resting[0], : system.A.shape[0]] if resting else None,
        diverges=-1 in ends,
        undecided=undecided,
        left=tuple(left),
        search=_sentence(len(starts), samples, sorted(set(sought) - set(left)), undecided, len(on)),
        runs=len(starts),
    )


def _slowest(system: LureSystem) -> float:
    """Samples in which the slowest motion of the linear part goes one radian, or decays to a third; ten at least."""
    poles = np.linalg.eigvals(system.A).astype(complex)
    rates = np.abs(np.log(poles[np.abs(poles) > _STILL]))
    return max(10.0, 1.0 / float(rates[rates > _STILL].min(initial=1.0)))


def _lengths(ends: Sequence[int], turns: Sequence[float]) -> list[int]:
    """Numbers of samples of orbits that are sought: those that runs end on, short ones, and those nearest to turns."""
    of_runs = {n for n in ends if n > 1}
    near = {n for turn in turns for n in _lengths_near(turn)}
    away = {n: min((abs(n - turn) for turn in turns), default=0.0) for n in near}
    return sorted(of_runs | set(_SHORT) | near, key=lambda n: (n not in of_runs, n not in _SHORT, away.get(n, 0.0), n))


def _lengths_near(turn: float) -> range:
    """Numbers of samples of orbits that a prediction may stand for; of long turns, each costs as much, few or none."""
    first, last = max(2, int(0.8 * turn)), int(1.25 * turn) + 2
    most = int(_MOST_SAMPLES / turn) if turn < _LONG else 0
    middle = round(turn)
    return range(max(first, middle - most // 2), min(last, middle + (most + 1) // 2))


def _starts(system: LureSystem, predicted: Sequence[LimitCycle]) -> Array:
    """States (m, n): the loop's own, predicted cycles in several sizes, and random ones of their size."""
    own = system.x0
    starts, sizes = [own], [np.abs(own)]
    for c in predicted:
        middle = _middle(c.require_state(own.size), own.size)
        starts += [middle + s * (c.state - middle) for s in _SCALES]
        sizes.append(np.abs(c.state - middle))
    size = np.max(sizes, axis=0)
    size = np.where(size > 0, size, size.max(initial=0.0) or 1.0)
    noise = np.random.default_rng(_SEED).uniform(-1.5, 1.5, (_N_RANDOM, own.size))
    return np.concatenate([np.array(starts), size * noise])


def _end(path: Array, scale: Array) -> int:
    """Samples after which a run repeats itself (1: it settles), 0 where it does not, -1 where it diverges."""
    last = path[-1]
    if not np.all(np.isfinite(last)) or np.abs(last).max() > _FAR:
        return -1
    tail = path[len(path) // 2 :]
    near = (np.abs(tail[:-1] - last) / scale).max(1) < _STILL
    for n in (len(near) - np.flatnonzero(near)[::-1]).tolist():
        if 2 * n < len(tail) and (np.abs(tail[n:] - tail[:-n])[-n:] / scale).max() < _STILL:
            return int(n)
    return 0


def _sentence(runs: int, samples: int, sought: list[int], undecided: int, unlocked: int) -> str:
    lengths = "none" if not sought else ", ".join(str(n) for n in sought) if len(sought) < 6 else _stretch(sought)
    text = (
        f"{runs} runs of {samples} samples; closed orbits, stable or not, of {lengths} samples "
        "were sought from states on all of them. Orbits of other numbers of samples were not sought"
    )
    if unlocked:
        text += f"; {unlocked} runs ended on listed motions that are not locked to the samples"
    if undecided:
        text += f", and {undecided} runs had neither come to rest nor repeated themselves"
        return text + " (their motion may fill a curve)."
    return text + "; every run ended on a listed orbit, at rest, or left."


def _stretch(sought: list[int]) -> str:
    whole = sought == list(range(sought[0], sought[-1] + 1))
    return f"{sought[0]} to {sought[-1]}" if whole else f"{len(sought)} lengths from {sought[0]} to {sought[-1]}"
