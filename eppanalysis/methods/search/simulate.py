"""Event-exact simulation in time of any loop, as its user calls it; beyond its end it is decided how it goes on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.errors import EppError
from eppanalysis.methods.search.longer import ending
from eppanalysis.methods.simulation.in_samples import simulate_in_samples
from eppanalysis.methods.simulation.runs import MOST_STEPS, run_in_time
from eppanalysis.methods.simulation.times import sample_times
from eppanalysis.models.systems.inputs import InputSignal
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, system_of
from eppanalysis.results import Status, Trajectory

#: How long a loop is simulated where nothing is said of it [s].
_USUAL_END = 10.0


def simulate(
    system: LureSystem | CaseLike,
    input: InputSignal | Mapping[str, InputSignal] | None = None,
    t_end: float | None = None,
    t_eval: ArrayLike | None = None,
    *,
    max_events: int = 200_000,
    max_steps: int = MOST_STEPS,
    step: float | None = None,
    decide: bool = False,
) -> Trajectory:
    """Run a loop in time, exactly between events, every switch of every element located to rounding.

    Parameters
    ----------
    system : LureSystem or Case
        Starts from its ``x0``, ``memory`` and ``v0``.
    input : InputSignal or mapping of str to InputSignal, optional
        Input signal(s) added to the external inputs from t = 0 on; a single InputSignal drives the only input. By
        default that of the case, none of a loop.
    t_end : float, optional
        End [s], positive (for a discrete-time system too); by default that of the case, 10 s of a loop.
    t_eval : array_like, shape (nt,), optional
        Increasing times at which signals are wanted [s]; 6001 even ones by default. Even spacing from 0 is fastest.
    max_events : int
        A run with more stops there and says why (its switches accumulate, or are many). Samples of controllers do not
        count, nor what repeats itself once a run has closed on a cycle.
    max_steps : int
        A run with more steps stops there too, as one of a loop with motions far faster than the run is long (sixteen
        steps that are proven free of events count as one; of a discrete-time loop they are samples).
    step : float, optional
        Longest internal step [s]; the results do not depend on it but for rounding.
    decide : bool
        Whether a run that is undecided by its end is carried on until it settles, repeats itself or leaves, for some
        ten seconds at most. Samples and events end at `t_end`; `status`, `limit_cycle`, `settled_at` and
        `settled_since` are those of the motion that goes on, and `carried_to` says how far it went.

    Returns
    -------
    Trajectory

    Raises
    ------
    EppError
        If `t_end`, `t_eval` or `step` is not valid.
    ModelError
        If the loop has no unique solution.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    >>> run = epp.simulate(loop, t_end=200.0)
    >>> run.status.name, round(run.limit_cycle.period, 8)
    ('LIMIT_CYCLE', 4.55107103)
    >>> print(epp.simulate(loop, t_end=5.0, decide=True))
    Oscillates: x 0.4401 peak to peak at 0.2197 Hz, from 17.24 s on; carried on to 45 s.
    """
    system, input, t_end = _resolved(system, input, t_end)
    if not (np.isfinite(t_end) and t_end > 0):
        raise EppError(f"simulate: t_end is {t_end}; expected a positive number of seconds.")
    if step is not None and not (np.isfinite(step) and step > 0):
        raise EppError(f"simulate: step is {step}; expected a positive number of seconds.")
    for name, most in (("max_events", max_events), ("max_steps", max_steps)):
        if most < 1:
            raise EppError(f"simulate: {name} is {most}; expected 1 or more.")

    def run_to(t_end: float, t_eval: ArrayLike | None = None) -> Trajectory:
        times = sample_times(t_end, t_eval)
        if system.time_step:
            return simulate_in_samples(system, input, t_end, None if t_eval is None else times, max_events, max_steps)
        return run_in_time(system, input, t_end, times, t_eval is None, max_events, max_steps, step)

    run = run_to(t_end, t_eval)
    end = cache(partial(ending, system, input, t_end, run_to))
    if run.status is Status.EVENT_LIMIT and decide and end().status is not Status.UNDECIDED:
        return end().of(run)
    if run.status is not Status.UNDECIDED or run.note:
        return run
    return end().of(run) if decide else replace(run, note=lambda: end().note(run))


def _resolved(
    loop: LureSystem | CaseLike, input: InputSignal | Mapping[str, InputSignal] | None, t_end: float | None
) -> tuple[LureSystem, InputSignal | Mapping[str, InputSignal] | None, float]:
    """The system, its input signals and the end of the run, what is not given being that of the case."""
    system = system_of(loop, "simulate")
    # A loop, or the diagram of one, has neither input signals nor an end of its own.
    given = getattr(loop, "input", None) if input is None else input
    return system, given, float(getattr(loop, "t_end", _USUAL_END) if t_end is None else t_end)
