"""A cycle restarted from its state and its memory, in runs that know nothing else of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import eppanalysis as epp
from eppanalysis.results import LimitCycle, Trajectory

#: Relative to the period: events nearer to its begin than this belong to the start.
AT_ONCE = 1e-7


def cycles_of(name: str) -> tuple[epp.LureSystem, epp.OperatingPoint, list[LimitCycle]]:
    """A shipped case's loop, its operating point, and its cycles: all of them, or the one that a sampled loop is on."""
    case = epp.case(name)
    system, at = case.to_system(), case.operating_point
    if system.time_step:
        found = epp.simulate(system, t_end=2000.0 * system.time_step).limit_cycle
        return system, at, [] if found is None else [found]
    return system, at, list(epp.find_limit_cycles(system, at))


def restart(system: epp.LureSystem, at: epp.OperatingPoint, cycle: LimitCycle, t_end: float) -> Trajectory:
    """A run from the state and the memory of a cycle, the external inputs where they stand on it."""
    steps = zip(system.input_names, at.vector(system) - system.v0, strict=True)
    rest = {name: epp.inputs.Constant(float(step)) for name, step in steps}
    times = cycle.time[cycle.time <= t_end] if cycle.time.size else None
    return epp.simulate(replace(system, x0=cycle.state, memory=cycle.memory), rest, t_end, times)


def check_restart(system: epp.LureSystem, at: epp.OperatingPoint, cycle: LimitCycle) -> None:
    """The same events at the same times to a billionth of the period, once more in the next one, and the same motion.

    An unstable cycle grows by its largest multiplier in one period.
    """
    T = cycle.period
    run = restart(system, at, cycle, T if system.time_step else 2.05 * T)
    n = cycle.time.size
    away = np.ones(n, bool)
    if not system.time_step:
        growth = 1.0 if cycle.multipliers is None else max(1.0, float(np.abs(cycle.multipliers).max(initial=0.0)))
        events = [e for e in run.events if e.time > AT_ONCE * T]
        first = [e for e in events if e.time < (1.0 - AT_ONCE) * T]
        second = [e for e in events if (1.0 + AT_ONCE) * T < e.time < (2.0 - AT_ONCE) * T]
        expected = [e for e in cycle.events if AT_ONCE * T < e.time < (1.0 - AT_ONCE) * T]
        for met, turn, tolerance in ((first, 0.0, 1e-9), (second, T, 1e-9 * growth)):
            assert [e[1:] for e in met] == [e[1:] for e in expected]
            late = [a.time - turn - b.time for a, b in zip(met, expected, strict=True)]
            assert np.max(np.abs(late), initial=0.0) < tolerance * T
        for mark in (0.0, *(e.time for e in cycle.events)):
            away &= np.abs(cycle.time - mark) > 1e-6 * T
    for name, wave in cycle.waveform.items():
        size = max(cycle.peak_to_peak[name], 1e-9 * float(np.abs(wave).max(initial=0.0)))
        np.testing.assert_allclose(run.signals[name][:n][away], wave[away], rtol=0.0, atol=1e-8 * size, err_msg=name)
