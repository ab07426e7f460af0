"""Motions of loops in discrete time whose period is no whole number of samples: as long runs have them.

Such a motion never closes. It fills a curve, and where a turn has many samples it comes back to within a small part of
one: the turns of a long run bound its period and its way, and that is all that is said of it. A motion that still
drifts, or whose turns differ, is none of these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.samples.sample_step import Step
from eppanalysis.results import SIMULATION, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: Fewest samples of a turn between which a state is taken from a straight line, and fewest turns that are compared.
_FEWEST_SAMPLES, _FEWEST_TURNS = 30, 8
#: How far turns may differ, relative to the motion, and how much of that may be a drift from the first half of them to
#: the second (of turns that drift evenly it is one half).
_SPREAD, _DRIFT = 0.01, 0.35
_TURNS = 40
_HARMONICS = 40


@dataclass(frozen=True, eq=False)
class Turns:
    """Turns of a run: the times [samples] at which it passes its middle upwards, and the states there (turns, d)."""

    times: Array
    states: Array
    scale: Array

    @classmethod
    def of(cls, step: Step, path: Array) -> Turns | None:
        """Those of the states (samples, d) of a run; None where it does not turn."""
        system = step.system
        y = path[:, : system.A.shape[0]] @ system.C[system.input_slices[system.principal].start]
        middle = 0.5 * (y.max() + y.min())
        before = np.flatnonzero((y[:-1] < middle) & (y[1:] >= middle))
        if len(before) < 2:
            return None
        share = (middle - y[before]) / (y[before + 1] - y[before])
        size = np.ptp(path, axis=0)
        scale = np.where(size > 0, size, np.maximum(size.max(), 1e-300))
        return cls(before + share, path[before] + share[:, None] * (path[before + 1] - path[before]), scale)

    @property
    def period(self) -> float:
        """Mean of all turns [samples]."""
        return float((self.times[-1] - self.times[0]) / (len(self.times) - 1))

    @property
    def spread(self) -> float:
        """Largest difference between turns, of their states or their lengths."""
        lengths = np.diff(self.times)
        return max(float((np.ptp(self.states, 0) / self.scale).max()), float(np.ptp(lengths)) / self.period)

    @property
    def repeat(self) -> bool:
        """Whether the turns are those of one motion that stays where it is."""
        few = self.period < _FEWEST_SAMPLES or len(self.times) <= _FEWEST_TURNS
        if few or self.spread > _SPREAD:
            return False
        half = len(self.states) // 2
        drift = np.abs(self.states[:half].mean(0) - self.states[-half:].mean(0))
        return bool(np.all(drift <= _DRIFT * np.ptp(self.states, 0) + 1e-9 * self.scale))

    def same(self, other: Turns) -> bool:
        """Whether two runs are on one motion, as far as their turns are alike."""
        return bool(other.away(self.states.mean(0)) <= self.spread + other.spread)

    def joins(self, motion: Turns) -> bool:
        """Whether a run is on a motion, or comes nearer to it and is near already."""
        last = motion.away(self.states[-1])
        return last <= motion.spread or (last < _SPREAD and last < motion.away(self.states[0]))

    def away(self, state: Array) -> float:
        """How far a state (d,) is from the mean of these, in the size of the motion."""
        return float((np.abs(state - self.states.mean(0)) / self.scale).max())


def unlocked(step: Step, paths: list[Array], marks: list[list[Any]]) -> tuple[list[LimitCycle], list[int]]:
    """Different motions that runs end on, and which of the runs do.

    Parameters
    ----------
    paths : list of array, shape (samples, d)
        The later part of runs that have neither come to rest nor repeated themselves.
    marks : list of list
        At the end of each.
    """
    known: list[tuple[Turns, LimitCycle]] = []
    of_runs = [Turns.of(step, path) for path in paths]
    for path, ends, turns in zip(paths, marks, of_runs, strict=True):
        if turns is None or not turns.repeat or any(turns.same(other) for other, _ in known):
            continue
        longer = _longer(step, path[-1], ends, turns.period)
        if longer is not None:
            known.append(longer)
    on = [i for i, turns in enumerate(of_runs) if turns is not None and any(turns.joins(other) for other, _ in known)]
    return [cycle for _, cycle in known], on


def _longer(step: Step, state: Array, marks: list[Any], period: float) -> tuple[Turns, LimitCycle] | None:
    """The motion over many more turns; None where it does not stay."""
    samples = int((_TURNS + 1) * period) + 2
    S, path, W = state[None], np.empty((samples, state.size)), np.empty((samples, step.system.B.shape[1]))
    for k in range(samples):
        path[k] = S[0]
        S, marks, w, _ = step.advance(S, marks)
        W[k] = w[0]
    found = Turns.of(step, path)
    if found is None or not found.repeat:
        return None
    return found, _limit_cycle(step, path, W, found)


def _limit_cycle(step: Step, path: Array, W: Array, turns: Turns) -> LimitCycle:
    """What many turns say of their motion."""
    system, s, n = step.system, step.system.signals, step.system.A.shape[0]
    T = float(system.time_step or 1.0)
    Y = path[:, :n] @ s.C.T + W @ s.D.T + s.D_input @ step.value + s.constant
    first, last = int(np.ceil(turns.times[0])), int(np.ceil(turns.times[-1]))
    whole, at = Y[first:last], np.arange(first, last)
    k = np.arange(min(_HARMONICS, int(turns.period / 2)) + 1)
    # The stretch is whole turns but for less than a sample: what leaks from one harmonic to others is one over its
    # samples.
    c = 2.0 / len(at) * np.exp(-2j * np.pi / turns.period * np.outer(k, at - first)) @ whole
    c[0] = whole.mean(0)
    one = Y[first : first + int(turns.period) + 1]
    lengths = np.diff(turns.times)
    stored = dict(zip(step.remembers, path[first, n:], strict=False))
    return LimitCycle(
        method=SIMULATION,
        status=Status.CONVERGED,
        period=turns.period * T,
        mean=dict(zip(s.names, whole.mean(0).tolist(), strict=True)),
        peak_to_peak=dict(zip(s.names, np.ptp(whole, axis=0).tolist(), strict=True)),
        harmonics=dict(zip(s.names, c.T, strict=True)),
        stable=True,
        stability_criterion="reached in simulation",
        residual=turns.spread,
        error_estimate=turns.spread,
        time=np.asarray(T * np.arange(len(one)), float),
        waveform=dict(zip(s.names, one.T.copy(), strict=True)),
        state=path[first, :n].copy(),
        mean_state=path[first:last, :n].mean(axis=0),
        memory=tuple(float(stored[i]) if i in stored else None for i in range(len(system.elements))),
        units=s.units_of_results(),
        note=f"not locked to the samples: {len(lengths)} turns of {lengths.min():.6g} to {lengths.max():.6g} samples",
        provenance=Provenance("simulation", {"system": system.name, "turns": len(lengths), "time_step": T}),
    )
