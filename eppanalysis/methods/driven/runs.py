"""Responses of loops with dead time, or with samples that do not come round with the input: what a run comes to repeat.

Nothing is solved: the response is given as near as the run from the loop's own start has come to repeat itself. Other
responses are not looked for (docs/theory/driven.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.driven.drive import Drive
from eppanalysis.methods.driven.result import PeriodicResponse
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.methods.simulation.period import analyse_period
from eppanalysis.models.systems.inputs import Sine
from eppanalysis.models.systems.sampled.strobe import sampled_among
from eppanalysis.readable import count
from eppanalysis.results import SIMULATION, LimitCycle, Status, Trajectory
from eppanalysis.results.provenance import Provenance

METHOD = "run to a periodic steady state"
#: Periods of the input after which a run is looked at, and samples of each of the last ones.
_LOOKED_AT = (30, 100, 300)
_SAMPLES = 240
#: Where between even times a run is looked at: on these the samples of a controller may fall, where signals jump.
_ASIDE = 0.382
#: Distance of a stretch from the one before it, relative to the range of each signal, up to which it repeats it.
REPEATS = 1e-6


@dataclass(frozen=True, eq=False)
class Steady:
    """What a run comes to."""

    response: PeriodicResponse | None  # None where it has not come to repeat itself
    periods: int  # of the input that were run
    #: Of the last stretch from the one before, relative to the range; nan where nothing repeats itself.
    distance: float = float("nan")


def by_runs(drive: Drive, most_periods: int) -> str:
    """What keeps the response of a loop from being closed exactly, in words; empty where nothing does."""
    reasons = ["dead time"] * bool(np.any(drive.system.delays > 0))
    if not drive.comes_round(most_periods):
        reasons += [f"samples that do not come round with the input within {count(most_periods, 'period')} of it"]
    return " and ".join(reasons)


def steady_of_run(drive: Drive, most_periods: int) -> Steady:
    """The response on which the run from the loop's own start ends; of at most so many periods of the input."""
    reached = 0
    for made in dict.fromkeys(max(n, 4 * most_periods) for n in _LOOKED_AT):
        last = 2 * most_periods
        times = (made - last + (np.arange(last * _SAMPLES) + _ASIDE) / _SAMPLES) * drive.period
        run = _run(drive, made, times)
        if run is None:
            break
        reached = made
        for multiple, distance in _distances(run, most_periods):
            if distance <= REPEATS:
                cycle = _cycle(drive, made, multiple, distance)
                return Steady(PeriodicResponse(multiple, 0.0, drive.amplitude, cycle), made, distance)
    return Steady(None, reached)


def _run(drive: Drive, periods: int, times: Array) -> Trajectory | None:
    """The run from the loop's own start over so many periods; None where it ends early."""
    held = replace(drive.system, v0=drive.at.vector(drive.system))
    try:
        run = simulate(held, {drive.input: Sine(drive.amplitude, drive.frequency)}, periods * drive.period, times)
    except EppError:
        return None
    whole = run.t.size == times.size and all(np.all(np.isfinite(y)) for y in run.signals.values())
    return run if whole else None


def _distances(run: Trajectory, most: int) -> Iterator[tuple[int, float]]:
    """How far the last n periods are from the n before them, relative to the range of each signal, for n = 1, 2, ..."""
    signals = np.array(list(run.signals.values()))
    span = np.ptp(signals, axis=1, keepdims=True)
    span = np.where(span > 1e-12 * np.abs(signals).max(initial=0.0), span, np.inf)  # what is constant repeats itself
    for n in range(1, most + 1):
        last, before = signals[:, -n * _SAMPLES :], signals[:, -2 * n * _SAMPLES : -n * _SAMPLES]
        yield n, float(np.max(np.abs(last - before) / span, initial=0.0))


def _cycle(drive: Drive, periods: int, multiple: int, distance: float) -> LimitCycle:
    """The last stretch of the run as a motion: sampled once more on the pieces between its switches."""
    system, end = drive.system, periods * drive.period
    begin = end - multiple * drive.period
    run = _run(drive, periods, np.array([begin, end]))
    assert run is not None  # the same run was made a moment ago
    switches = [event.time for event in run.events if begin < event.time < end]
    # Corners would spoil the quadrature of means and harmonics: its pieces end at them.
    marks = np.unique(np.concatenate([[begin, end], switches, *_ticks(drive, begin, end)]))

    def sample(times: Array) -> Array:
        again = _run(drive, periods, times)
        return np.zeros((0, len(system.signals.names))) if again is None else np.array([*again.signals.values()]).T

    shape = analyse_period(marks, system.delays, drive.hybrid.time_scale, system.signals.names, sample)
    return LimitCycle(
        method=SIMULATION,
        status=Status.CONVERGED,
        period=multiple * drive.period,
        mean=shape.mean,
        peak_to_peak=shape.peak_to_peak,
        harmonics=shape.harmonics,
        stable=True,
        stability_criterion="reached in simulation",
        residual=distance,
        events=tuple(e._replace(time=e.time - begin) for e in run.events if begin < e.time < end),
        time=shape.time,
        waveform=shape.waveform,
        units=system.signals.units_of_results(),
        operating_point=drive.at,
        provenance=Provenance(METHOD, {"system": system.name, "periods": periods}, {"distance": REPEATS}),
    )


def _ticks(drive: Drive, begin: float, end: float) -> Iterator[Array]:
    """Times at which sampled controllers read and hand out, between two times."""
    for controller in sampled_among(drive.system.elements).values():
        T = controller.sample_time
        for shift in {controller.offset, controller.offset + controller.delay}:
            k = np.arange(np.ceil((begin - shift) / T), np.floor((end - shift) / T) + 1)
            yield shift + k * T
