"""From a closed orbit to the LimitCycle that users see: waveform, harmonics, events, stability."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, sample_arcs
from eppanalysis.methods.orbits.shooting import begun_amid
from eppanalysis.methods.simulation.period import PeriodShape, about_zero, advance, advances, analyse_period
from eppanalysis.methods.simulation.runs import named_events, run_hybrid
from eppanalysis.methods.simulation.stability import describe, drifts, on_the_circle, verdict
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.starts import remembered
from eppanalysis.results import EXACT_ORBIT, LimitCycle, Status
from eppanalysis.results.events import Events
from eppanalysis.results.provenance import Provenance

#: The cycles of orbits, and of which loops: a search compares an orbit with what it looks for before it lists it.
_MADE: WeakKeyDictionary[Orbit, tuple[LureSystem, LimitCycle]] = WeakKeyDictionary()


def to_limit_cycle(system: LureSystem, orbit: Orbit) -> LimitCycle:
    """What a closed orbit looks like to its user; an orbit, which does not change, has one cycle.

    Parameters
    ----------
    system : LureSystem
        The loop whose orbit it is.
    """
    of, cycle = _MADE.get(orbit, (None, None))
    if cycle is None or of is not system:
        cycle = _cycle_of(system, orbit)
        _MADE[orbit] = system, cycle
    return cycle


def _cycle_of(system: LureSystem, orbit: Orbit) -> LimitCycle:
    shape = orbit_shape(system, orbit)
    values = orbit.multipliers
    n = orbit.hybrid.n_plant
    y, aside = orbit.y.copy(), about_zero(orbit.hybrid, shape)
    y[:n] += aside
    shape = shape.moved(orbit.hybrid.model.Yx[:, :n] @ aside)
    settings = {"system": system.name, "inputs": y[n : orbit.hybrid.x0.size].tolist()}
    error = error_estimate(orbit)
    many, drifting, on_circle = orbit.one_of_many, False, False
    if orbit.motion is None:  # where what is delayed moves, the equations at the start alone do not tell
        of_start = orbit.return_map, orbit.scale[orbit.arcs.free]
        drifting, on_circle = many and drifts(*of_start), on_the_circle(*of_start, error, many)
    return LimitCycle(
        method=EXACT_ORBIT,
        status=Status.CONVERGED if orbit.residual < CONVERGED else Status.NOT_CONVERGED,
        period=orbit.period,
        mean=shape.mean,
        peak_to_peak=shape.peak_to_peak,
        harmonics=shape.harmonics,
        note="".join(advances(system, gained(orbit), shape)),
        stable=verdict(values, many, drifting, on_circle),
        stability_criterion=describe(values, many, drifting, on_circle),
        multipliers=values,
        residual=orbit.residual,
        error_estimate=error,
        events=_events(orbit),
        time=shape.time,
        waveform=shape.waveform,
        state=y[:n].copy(),
        memory=remembered(
            orbit.hybrid, y[: orbit.hybrid.x0.size], y[orbit.arcs.memory], orbit.arcs.event_sequence.modes[0]
        ),
        units=system.signals.units_of_results(),
        event_states=orbit.starts[:-1, :n] + aside,
        provenance=Provenance(EXACT_ORBIT, settings, {"residual": CONVERGED}),
    )


def error_estimate(orbit: Orbit) -> float:
    """What the residual and the rounding of the flow can do to the orbit, relative to its size."""
    if orbit.motion is not None:
        return orbit.motion.error
    noise = np.maximum(np.abs(orbit.r), 2.0**-52 * orbit.row_scale)
    step = orbit.correction(noise)
    return float(np.max(np.abs(step) / orbit.column_scale))


def orbit_shape(system: LureSystem, orbit: Orbit) -> PeriodShape:
    """Mean, extrema, harmonics and waveform over one period."""
    marks = np.concatenate([[0.0], np.cumsum(orbit.tau)])
    delayed, goes_on = orbit.arcs.n_timers > 0, gained(orbit) / orbit.period

    def by_engine(times: Array) -> Array:
        # From the middle of the first arc, where no guard is near, once round.
        half = 0.5 * float(orbit.tau[0])
        start = begun_amid(orbit, 0)
        first = int(np.searchsorted(times, half))
        turned = np.concatenate([times[first:] - half, times[:first] + (orbit.period - half)])
        base = 2.0 * orbit.hybrid.time_scale
        samples = run_hybrid(start, orbit.period, turned, base, 10 * marks.size + 100, 1).samples
        return np.roll(samples - np.outer(turned[: len(samples)], goes_on), first, axis=0)

    def by_arcs(times: Array) -> Array:
        return sample_arcs(orbit, times) - np.outer(times, goes_on)

    if orbit.motion is not None:
        # Its pieces end where a signal has a corner.
        marks, sample = orbit.motion.mesh.breaks, orbit.motion.signals
    else:
        sample = by_arcs if delayed else by_engine
    return analyse_period(marks, np.zeros(0), orbit.hybrid.time_scale, system.signals.names, sample)


def gained(orbit: Orbit) -> Array:
    """What each signal gains in a period."""
    return (
        advance(orbit.hybrid, orbit.starts[-1] - orbit.y)
        if orbit.motion is None
        else np.zeros(len(orbit.hybrid.model.Yx))
    )


def _events(orbit: Orbit) -> Events:
    """The events within the period, the one that closes it last."""
    hybrid, it = orbit.hybrid, orbit.arcs.event_sequence
    real = it.guards >= 0
    after = np.roll(it.modes, -1, axis=0)
    return named_events(hybrid, np.cumsum(orbit.tau)[real], it.guards[real], after[real])
