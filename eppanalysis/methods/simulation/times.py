"""Times at which a run is sampled, and the step that goes with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.models.systems.hybrid import HybridSystem


def sample_times(t_end: float, t_eval: ArrayLike | None) -> Array:
    """Times at which signals are wanted: 6001 even ones, or those given.

    Raises
    ------
    EppError
        If they are not finite, do not increase or lie outside the run.
    """
    if t_eval is None:
        return np.linspace(0.0, t_end, 6001)
    times = np.atleast_1d(np.asarray(t_eval, float))
    # What increases from and to a finite number is finite in between.
    ends = times[[0, -1]] if times.size else times
    if times.ndim != 1 or not (np.isfinite(ends).all() and (times[1:] > times[:-1]).all()):
        raise EppError("simulate: t_eval must hold finite times in increasing order.")
    if times.size and (times[0] < 0 or times[-1] > t_end * (1 + 1e-12)):
        raise EppError(
            f"simulate: t_eval runs from {times[0]} to {times[-1]}; expected times from 0 to t_end = {t_end}."
        )
    return times


def base_step(times: Array, even: bool, hybrid: HybridSystem) -> float:
    """Spacing of even samples (the engine halves it as needed), else a step that suits the linear part."""
    if times.size > 1:
        # On the grid of even samples fast steps need no series between (docs/theory/engine.md, Two ways to advance).
        spacing = times[-1] / (times.size - 1)
        if even or (times[0] == 0.0 and np.abs(times - spacing * np.arange(times.size)).max() <= 1e-9 * spacing):
            return float(spacing)
    return 2.0 * hybrid.time_scale
