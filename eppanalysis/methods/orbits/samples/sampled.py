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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.samples.sample_step import Step
from eppanalysis.methods.simulation.iterate import cycle_of_samples
from eppanalysis.methods.simulation.stability import describe, drifts, multipliers, verdict
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.results import EXACT_ORBIT, SIMULATION, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

_ITERATIONS = 12
_CLOSED = 1e-11  # change over a period, relative to the motion, of an orbit that is closed
_SAME = 1e-7
_STILL = 1e-9
_NEUTRAL = 1e-7
_MOST_STARTS, _MOST_PERIODS, _MOST_SAMPLES = 60, 60, 8000
#: Sizes of an approximate cycle from which runs are begun.
SCALES = (0.03, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 4.0)
_FAR = 1e9


def _round(
    step: Step, S: Array, marks: list[Any], n: IntArray, scale: Array, careful: bool = False
) -> tuple[Array, list[Any], Array, BoolArray]:
    """States after n samples, of each start its own number, with marks, derivative, and whether a border was met."""
    J, met = np.broadcast_to(np.eye(step.size), (len(S), step.size, step.size)), np.zeros(len(S), bool)
    out, J_out, marks_out = np.empty_like(S), np.empty(J.shape), marks
    for k in range(int(n.max())):
        S, marks, _, slopes = step.advance(S, marks, scale, careful)
        J, met = slopes[0] @ J, met | (slopes[1] & (k < n))
        done = np.flatnonzero(n == k + 1)
        if done.size:
            out[done], J_out[done] = S[done], J[done]
            marks_out = _put(marks_out, done, chosen(marks, done))
    return out, marks_out, J_out, met


def _closed(step: Step, S: Array, marks: list[Any], n: IntArray, scale: Array) -> tuple[Array, list[Any], IntArray]:
    """States (k, d) that come back after n samples, from starts (m, d), with marks and number of samples of each."""
    active = np.ones(len(S), bool)
    eye, closed = np.eye(step.size), np.zeros(len(S), bool)
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            k = np.flatnonzero(active)
            if not k.size:
                break
            after, marks_k, J, _ = _round(step, S[k], chosen(marks, k), n[k], scale)
            r = (after - S[k]) / scale
            small = np.abs(r).max(1) < _CLOSED
            closed[k[small]] = True  # and moved once more, to rounding
            matrix = (J - eye) / scale[:, None] * scale
            good = np.isfinite(matrix).all((1, 2)) & np.isfinite(r).all(1)
            change = np.zeros_like(r)
            # Along a continuum of orbits the equations leave a direction free: no step in it.
            change[good] = -(np.linalg.pinv(matrix[good], rcond=1e-12) @ r[good][..., None])[..., 0]
            S[k] += change * scale
            marks = _put(marks, k[good], chosen(marks_k, np.flatnonzero(good)))
            active[k] = good & ~small & (np.abs(change).max(1) < _FAR)
    keep = np.flatnonzero(closed)
    return S[keep], chosen(marks, keep), n[keep]


def chosen(marks: list[Any], k: IntArray) -> list[Any]:
    """Marks of rows k."""

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


def _orbits(step: Step, S: Array, marks: list[Any], n: IntArray, scale: Array) -> list[_Found]:
    """Different orbits of n samples, none of them a shorter one or a rest, that starts lead to."""
    S, marks, n = _closed(step, S.copy(), marks, n, scale)
    found: list[_Found] = []
    if not len(S):
        return found
    path = [S]
    at, now = S, marks
    for _ in range(int(n.max())):
        at, now, _, _ = step.advance(at, now)
        path.append(at)
    for i, whole in enumerate(np.stack(path, 1)):
        states = whole[: n[i] + 1]
        orbit = _Found(states[:-1], chosen(marks, np.array([i])), scale)
        moved = (np.abs(states[1:] - states[0]) / scale).max(1)
        if not np.all(np.isfinite(moved)) or moved[:-1].min(initial=np.inf) < _SAME or moved.max() < 1e-6:
            continue
        if _closes(states) and orbit.n > 1 and not any(orbit.same(known) for known in found):
            found.append(orbit)
    return found


def _closes(states: Array) -> bool:
    """Whether the states (n + 1, d) of a round come back in the size of their own motion, however large others are."""
    size = np.abs(states).max(0)
    allowed = _STILL * np.ptp(states, axis=0) + len(states) * np.finfo(float).eps * size
    return bool(np.all(np.abs(states[-1] - states[0]) <= allowed))


def is_of_many(step: Step, state: Array, marks: list[Any], n: int, scale: Array) -> bool:
    """Whether the orbit of n samples through a state (d,) is one of a continuum: a multiplier of it is one."""
    _, _, J, _ = _round(step, state[None], marks, np.array([n]), scale, careful=True)
    return bool(np.any(np.abs(multipliers(J[0], scale, step.size) - 1.0) < _NEUTRAL))


def _limit_cycle(step: Step, orbit: _Found) -> LimitCycle:
    system, scale = step.system, orbit.scale
    S, marks = orbit.states[:1], orbit.marks
    after, _, J, border = _round(step, S, marks, np.array([orbit.n]), scale, careful=True)
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
    drifting = many and drifts(J[0], scale)
    made_by = Provenance(EXACT_ORBIT, {"system": system.name, "samples": orbit.n, "time_step": system.time_step})
    cycle = cycle_of_samples(
        dict(zip(s.names, Y.T.copy(), strict=True)), orbit.n, float(system.time_step or 1.0), residual, made_by
    )
    stored = dict(zip(step.remembers, orbit.states[0, n:], strict=False))
    return replace(
        cycle,
        method=EXACT_ORBIT,
        stable=None if border[0] else verdict(values, many, drifting),
        stability_criterion=BORDER if border[0] else describe(values, many, drifting),
        multipliers=None if border[0] else values,
        residual=residual,
        error_estimate=float(np.abs(inverse).sum(1).max() * noise),
        state=orbit.states[0, :n].copy(),
        mean_state=orbit.states[:, :n].mean(axis=0),
        memory=tuple(float(stored[i]) if i in stored else None for i in range(len(system.elements))),
        units=s.units_of_results(),
    )


BORDER = (
    "an element is where two of its pieces meet on a sample: a disturbance to either side has multipliers of its own"
)


def ready(system: LureSystem, at: OperatingPoint) -> Step:
    """The step of a loop whose elements have one input each."""
    step = Step(system, at.vector(system))
    for name, e in zip(system.element_names, system.elements, strict=True):
        if e.n_inputs > 1:
            raise EppError(f"{system.name}: {name} has several inputs; exact orbits in discrete time need one each.")
    return step


def runs(step: Step, S: Array, marks: list[Any], samples: int) -> tuple[Array, list[Any]]:
    """States (samples, m, d) of runs from states (m, d) on, the first of them these, and the marks at the last."""
    out = np.empty((samples, *S.shape))
    out[0] = S
    with np.errstate(all="ignore"):
        for k in range(1, samples):
            S, marks, _, _ = step.advance(S, marks)
            out[k] = S
    return out, marks


def size_of(paths: Array, far: Array) -> Array:
    """Amplitude of each place of the state, (d,): of the runs that do not settle, or of the starts where all do."""
    stays = paths[:, np.all(np.abs(paths) < far, (0, 2))]
    begin = np.ptp(paths[:2], (0, 1))
    size = np.ptp(stays[len(stays) // 2 :], (0, 1)) if stays.shape[1] else begin
    size = np.where(size > 1e-6 * begin, size, begin)
    return np.where(size > 0, size, max(size.max(initial=0.0), 1e-300))


def far_from(paths: Array) -> Array:
    """States (d,) beyond which runs have diverged: so many times as far as their starts; where these are zero none."""
    begun = np.abs(paths[:2]).max((0, 1))
    return np.where(begun > 0, _FAR * begun, np.inf)


def seeds_of(paths: Array, far: Array) -> Array:
    """Some states of all runs, early ones denser."""
    when = np.unique(np.geomspace(1, len(paths), 4 * _MOST_STARTS).astype(int)) - 1
    states = paths[when].reshape(-1, paths.shape[-1])
    return _some(states[np.all(np.abs(states) < far, axis=1)], _MOST_STARTS)


def _some(states: Array, most: int) -> Array:
    """So many of the states, evenly spread."""
    return states[np.linspace(0, len(states) - 1, min(most, len(states))).astype(int)]


def _between(found: list[_Found]) -> tuple[Array, list[Any]]:
    """States between neighbouring points of known orbits: on a curve of motions, unstable ones lie between stable."""
    points = np.concatenate([o.states for o in found])
    away = (np.abs(points[:, None] - points[None]) / found[0].scale).max(2)
    np.fill_diagonal(away, np.inf)
    near = np.argsort(away, axis=1)[:, :2]
    seeds = np.concatenate(
        [(1 - w) * points + w * points[near[:, i]] for i in range(near.shape[1]) for w in (0.3, 0.5)]
    )
    seeds = _some(seeds, 2 * _MOST_STARTS)
    return seeds, chosen(found[0].marks, np.zeros(len(seeds), np.intp))


def _sought(step: Step, seeds: Array, marks: list[Any], lengths: Sequence[int], scale: Array) -> list[_Found]:
    """Different orbits of so many samples that seeds lead to; of marks those of one, which come right in a round."""
    n, first = np.repeat(np.array(lengths), len(seeds)), np.zeros(len(lengths) * len(seeds), np.intp)
    return _orbits(step, np.tile(seeds, (len(lengths), 1)), chosen(marks, first), n, scale)


def all_orbits(step: Step, seeds: Array, marks: list[Any], lengths: Sequence[int], scale: Array) -> list[LimitCycle]:
    """Cycles of so many samples that seeds lead to, and those that lie between them."""
    found = _sought(step, seeds, marks, lengths, scale)
    for length in sorted({o.n for o in found}):
        own = [o for o in found if o.n == length]
        if length * len(own) <= _MOST_SAMPLES // 4:
            S, at = _between(own)
            more = _orbits(step, S, at, np.full(len(S), length), scale)
            found += [o for o in more if not any(o.same(known) for known in own)]
    return [_limit_cycle(step, o) for o in found]


def sampled_orbit(system: LureSystem, start: LimitCycle, at: OperatingPoint) -> LimitCycle:
    """The closed orbit of a loop in discrete time nearest to an approximate one; see ``exact_orbit``."""
    step = ready(system, at)
    if start.state.size != system.A.shape[0] and start.method != SIMULATION:
        raise EppError(f"{system.name}: the start has no state; expected a predicted cycle, or an exact one.")
    x = start.state if start.state.size == system.A.shape[0] else system.x0
    memory = start.memory if len(start.memory) == len(system.elements) else system.memory
    length = start.period / float(system.time_step or 1.0)
    middle = middle_of(start, x.size)
    starts = middle + np.array(SCALES)[:, None] * (x - middle)
    paths, marks = runs(step, *step.begin(starts, memory), int(min(12 * length + 50, _MOST_SAMPLES)))
    # A whole number of samples is taken at its word; any other is approximate, and its neighbours are all tried.
    if abs(length - round(length)) < 1e-9 * length:
        lengths = [round(length)]
    else:
        longest = min(int(1.35 * length) + 2, int(0.75 * length) + _MOST_PERIODS)
        lengths = list(range(max(2, int(0.75 * length)), longest))
    far = far_from(paths)
    seeds, scale = seeds_of(paths, far), size_of(paths, far)
    cycles = [_limit_cycle(step, o) for o in _sought(step, seeds, marks, lengths, scale)]
    alike = [c for c in cycles if _away(c, start) < np.log(2.0)]
    fit = [c for c in alike if start.stable is None or c.stable == start.stable] or alike
    if fit:
        return min(fit, key=lambda c: _away(c, start))
    return replace(start, method=EXACT_ORBIT, status=Status.NOT_CONVERGED, stable=None, residual=float("nan"))


def middle_of(cycle: LimitCycle, n: int) -> Array:
    """Where starts of other sizes are made about: the mean of a cycle, or the origin where that is not known."""
    return cycle.mean_state if cycle.mean_state.size == n else np.zeros(n)


def _away(cycle: LimitCycle, start: LimitCycle) -> float:
    """How far two cycles are apart in period and size, as logarithms."""
    sizes = [(cycle.peak_to_peak[k], v) for k, v in start.peak_to_peak.items() if v > 0 and cycle.peak_to_peak.get(k)]
    return abs(float(np.log(cycle.period / start.period))) + max(
        (abs(float(np.log(a / b))) for a, b in sizes), default=0.0
    )
