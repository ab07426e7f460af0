"""Where a loop with sampled controllers is looked at once in a while: at samples that come round together."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem


def sampled_among(elements: Iterable[Nonlinearity]) -> dict[int, SampledController]:
    """The sampled controllers among the elements of a loop, by their places."""
    # Called at every run: `isinstance` of an abstract class takes five times as long.
    return {i: e for i, e in enumerate(elements) if SampledController in type(e).__mro__}  # type: ignore[misc]


def clock_in(row: Array) -> int:
    """Number of the state that a controller's row of C reads as its clock.

    Raises
    ------
    ModelError
        If it is no state of its own: coordinates of a loop mix its other states only.
    """
    read = np.flatnonzero(row)
    if read.size != 1:
        raise ModelError(
            f"SampledController: its clock is mixed with other states (its row of C reads {read.size} of them)",
            expected="the clock as a state of its own: other coordinates of the plant's states alone, or of the plant "
            "before the loop is built",
        )
    return int(read[0])


def is_sampled(elements: Iterable[Nonlinearity]) -> bool:
    """Whether there is a sampled controller among the elements of a loop."""
    return bool(sampled_among(elements))


#: Analyses that do not cover loops with samples, and what answers in their place.
_INSTEAD = {
    "continue_folds": "locked cycles end at borders, not in folds; use design_bounds",
    "free_region": "use outcome_boundary with run='cycles'",
    "certify": "certify_orbit proves cycles that are locked to the samples",
    "frozen_nyquist": "use predict_limit_cycles and margins",
    "olop": "use predict_limit_cycles and forced_response",
    "frequency_response": "samples come round with the input at single frequencies only; use amplitude_response",
    "A batch": "simulate runs them one by one",
}


def refuse_samples(elements: Iterable[Nonlinearity], analysis: str) -> None:
    """Refuse a loop with sampled controllers where an analysis does not cover them, and name what to use instead.

    Raises
    ------
    EppError
        If there is one, and the analysis does not.
    """
    if analysis in _INSTEAD and is_sampled(elements):
        raise EppError(f"{analysis} does not cover loops with sampled controllers: {instead_of(analysis)}.")


def instead_of(analysis: str) -> str:
    """What answers for loops with samples in the place of an analysis that does not cover them."""
    return _INSTEAD[analysis]


@dataclass(frozen=True, eq=False)
class Strobe:
    """The samples of a hybrid system's slowest controller, and how many of them go round together with all others."""

    hybrid: HybridSystem
    numbers: tuple[int, ...]  # of the sampled controllers among the elements, the slowest one first

    @classmethod
    def of(cls, hybrid: HybridSystem) -> Strobe | None:
        """That of a hybrid system; None where nothing is sampled."""
        times = {i: e.sample_time for i, e in sampled_among(hybrid.elements).items()}
        return cls(hybrid, tuple(sorted(times, key=lambda i: -times[i]))) if times else None

    @cached_property
    def controllers(self) -> tuple[SampledController, ...]:
        """The controllers, the slowest one first."""
        controllers = sampled_among(self.hybrid.elements)
        return tuple(controllers[i] for i in self.numbers)

    @cached_property
    def guard(self) -> int:
        """Number of the guard that takes the samples of the slowest controller."""
        model = self.hybrid.model
        return int(model.guard_first[model.mode_first[self.numbers[0]]])

    @cached_property
    def of_samples(self) -> BoolArray:
        """Which guards are those of sampled controllers."""
        return np.isin(self.hybrid.model.guard_element, self.numbers)

    @cached_property
    def every(self) -> int:
        """Samples of the slowest controller until all samples come round; 0 where they never do."""
        # In one tick all come round after the least common multiple of their counts; without a common tick they never
        # do.
        counts = [c.counted(c.sample_time) for c in self.controllers]
        if len({c.unit for c in self.controllers}) > 1 or any(n % 1.0 for n in counts):
            return 0 if len(counts) > 1 else 1
        return math.lcm(*map(int, counts)) // int(counts[0])

    @property
    def closes(self) -> bool:
        """Whether orbits can be closed: samples come round together, and states and memory values tell all."""
        return bool(self.every) and not self.forgets

    @property
    def forgets(self) -> bool:
        """Whether states and memory values do not tell all, as something is on its way through a dead time."""
        return bool(np.any(self.hybrid.model.smooth_kind == DELAY_LINE))

    @property
    def period(self) -> float:
        """Time until all samples come round [s]; infinite where they never do."""
        return self.every * self.controllers[0].sample_time if self.every else math.inf

    def samples_in(self, time: float) -> int:
        """About how many events the controllers have in a time [s]."""
        return sum(math.ceil(time / c.sample_time) * (2 if c.delay or c.state_last else 1) for c in self.controllers)

    @cached_property
    def counting(self) -> BoolArray:
        """Memory values that count ticks, shape (h,)."""
        model = self.hybrid.model
        out = np.zeros(model.K.shape[1], bool)
        for guard in np.flatnonzero(self.of_samples):
            e = model.guard_element[guard]
            h, end = model.first[e : e + 2, 2]
            out[h:end] |= model.guard_h[guard, : end - h] != 0.0
        return out

    @cached_property
    def held(self) -> BoolArray:
        """Memory values of the elements that repeat on a cycle: those that do not count, shape (h,)."""
        out = ~self.counting
        out[int(self.hybrid.model.first[-1, 2]) :] = False
        return out

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Places of what repeats on a cycle among states and memory values."""
        return np.flatnonzero(np.concatenate([self.hybrid.compared, self.held]))

    def begun(self, x: Array, H: Array, modes: IntArray) -> HybridSystem:
        """The hybrid system begun behind one of its samples, with the clock turned back to zero."""
        model, x, H = self.hybrid.model, x.copy(), H.copy()
        for e, controller in zip(self.numbers, self.controllers, strict=True):
            own = np.flatnonzero(self.counting[model.first[e, 2] : model.first[e + 1, 2]]) + model.first[e, 2]
            passed = x[self.clock] / controller.unit
            # Counts of whole ticks must not take up the rounding of the clock.
            H[own] -= round(passed) if self.every else passed
        x[self.clock] = 0.0
        return self.hybrid.at(x, H, np.array(modes, np.int64))

    @cached_property
    def clock(self) -> int:
        """Number of the state that is the clock."""
        model = self.hybrid.model
        return clock_in(model.C[model.first[self.numbers[0] + 1, 0] - 1])
