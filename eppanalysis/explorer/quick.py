"""What a slider shows at once: the run in time and the Nyquist plot, in some tens of milliseconds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases import Case
from eppanalysis.errors import ModelError
from eppanalysis.explorer.values import moved_case
from eppanalysis.methods.describing.frozen import (
    FrozenLoop,
    frozen_loop,
    input_name,
    nearest_cycle,
    with_element_inputs,
)
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.readable import readable
from eppanalysis.results import Status, Trajectory
from eppanalysis.results.picture import shown_until

_SAMPLES = 2401
#: A run is shown up to a round time, and the next one so, too, while that is not more than so many times too long.
_ROUND, _ROOM, _MUCH = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0), 1.15, 2.5
#: A part with fewer samples than this share of all, or this number in a period, is run again with finer ones.
_SHARE, _FEWEST_IN_PERIOD = 0.25, 24


@dataclass(frozen=True, eq=False)
class Quick:
    """A run and the picture that belongs to it."""

    case: Case
    #: signal, unit: which signal, and the unit that people read it in.
    signal: str
    unit: str
    factor: float  # to that unit from SI
    until: float  # up to when the run is shown [s]
    #: time, values: (n,): [s], [unit].
    time: Array
    values: Array
    #: frequency, peak_to_peak: of the limit cycle [Hz], [unit]; nan where there is none, but at rest the size is zero.
    frequency: float
    peak_to_peak: float
    sentence: str  # the verdict
    #: Frozen at the cycle of the DF next to the run's; at the run's own where there is none; or at rest.
    loop: FrozenLoop | None
    of_run: complex | None  # -1/N at the amplitude of the run's cycle
    first_order: bool  # whether the loop is frozen at a cycle of the DF


def shown_signal(case: Case) -> str:
    """The signal that the page shows."""
    return case.expected.signal or case.to_system().signals.names[0]


def compute(base: Case, signal: str, values: Mapping[str, float], held: float = 0.0) -> Quick:
    """Run a case with moved values.

    Parameters
    ----------
    held : float
        Up to when the run before was shown [s]; this one is, too, if it can be.

    Raises
    ------
    EppError
        If the values do not go together or the loop cannot be run.
    """
    case = moved_case(base, values)
    system = with_element_inputs(case.to_system(), (signal,))
    run = simulate(system, case.input, case.t_end, t_eval=_times(system, case.t_end))
    seen, until = _begin(case, system, run, held)
    unit, factor = readable(run.units.get(signal, ""))
    cycle, size = run.limit_cycle, 0.0 if run.status is Status.SETTLED else math.nan
    return Quick(
        case,
        signal,
        unit,
        factor,
        until,
        seen.t,
        factor * seen.signals[signal],
        math.nan if cycle is None else cycle.frequency,
        size if cycle is None else factor * cycle.peak_to_peak[signal],
        _sentence(run, signal, unit, factor),
        *_loop(case, run),
    )


def _times(system: LureSystem, t_end: float) -> Array | None:
    """Times at which a run is looked at; in discrete time all samples."""
    return None if system.time_step else np.linspace(0.0, t_end, _SAMPLES)


def _begin(case: Case, system: LureSystem, run: Trajectory, held: float) -> tuple[Trajectory, float]:
    """What there is to see of a run, the part up to its steady state and a while of that, and up to when that is."""
    end = _round_time(shown_until(run), held)
    if not 0.0 < end < case.t_end:
        return run, case.t_end
    early = run.t <= end
    cycle, fewest = run.limit_cycle, _SHARE * _SAMPLES
    if cycle is not None:
        fewest = max(fewest, _FEWEST_IN_PERIOD * end / cycle.period)
    if not system.time_step and early.sum() < min(fewest, _SAMPLES):
        return simulate(system, case.input, end, t_eval=_times(system, end)), end
    return replace(run, t=run.t[early], signals={name: y[early] for name, y in run.signals.items()}), end


def _round_time(until: float, held: float) -> float:
    """The one that was held while it shows all and is not much longer, so that curves move and their axis does not.

    A new one leaves some room: what comes next often takes a little longer.
    """
    if until <= 0.0:
        return 0.0
    if until <= held <= _MUCH * until:
        return held
    decade = 10.0 ** math.floor(math.log10(until))
    return next(decade * factor for factor in _ROUND if decade * factor >= _ROOM * until)


def _sentence(run: Trajectory, signal: str, unit: str, factor: float) -> str:
    cycle, name = run.limit_cycle, signal.replace("_", " ")
    if cycle is not None:
        size = f"{factor * cycle.peak_to_peak[signal]:.4g} {unit}".strip()
        return f"Oscillates at {cycle.frequency:.4g} Hz, {name} by {size} peak to peak."
    if run.status is Status.SETTLED:
        if run.stands_still:
            return "Rests where it starts; other starts may oscillate."
        return "Settles at rest" + f", from {run.settled_since:.3g} s on" * (run.settled_since > 0.0) + "."
    return run.message


def _loop(case: Case, run: Trajectory) -> tuple[FrozenLoop | None, complex | None, bool]:
    """The Nyquist plot of the run: frozen at its cycle, or at rest; None where elements allow none."""
    try:
        return _frozen(case, run)
    except ModelError:
        return None, None, False


def _frozen(case: Case, run: Trajectory) -> tuple[FrozenLoop | None, complex | None, bool]:
    system, cycle = case.to_system(), run.limit_cycle
    inputs = {name: input_name(name) for name in system.element_names}
    if cycle is not None:
        means = {name: cycle.mean[at] for name, at in inputs.items()}
        own = frozen_loop(system, {name: cycle.amplitude(at) for name, at in inputs.items()}, means, cycle.omega)
        phasors = {name: complex(cycle.harmonics[at][1]) for name, at in inputs.items()}
        value = case.operating_point.vector(system)
        near = nearest_cycle(system, phasors, means, cycle.omega, value)
        of_run = None if own is None else own.point
        return (own, of_run, False) if near is None else (frozen_loop(system, *near), of_run, True)
    if not run.t.size:
        return None, None, False
    rest = {name: float(run.settled_at.get(at, run.signals[at][-1])) for name, at in inputs.items()}
    return frozen_loop(system, dict.fromkeys(inputs, 0.0), rest, None), None, False
