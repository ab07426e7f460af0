"""Whether an orbit is the one that was requested: frequency, size, mean and symmetry of the approximate cycle.

Between an approximate cycle and an exact orbit lies the error that the approximation estimates of itself. What is
farther away is a neighbour, however well it closes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.cycle import to_limit_cycle
from eppanalysis.methods.orbits.mirrored import is_mirrored, mirror
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.simulation.period import free_of
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.linear import ROUNDING
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.readable import number
from eppanalysis.results import LimitCycle

#: An orbit within this many times a prediction's estimated error belongs to it. An estimate that is infinite or larger
#: counts as a factor of two; a smaller one is raised to a floor for rounding, thresholds and starts from a neighbouring
#: loop.
_TIMES, _LEAST, _MOST = 2.0, 0.02, 1.0
#: An estimate above this share bounds a cycle no more on that side on which it is larger or slower than predicted.
_SHARE = 2.0 / 3.0
#: How much farther an orbit may be where a balance in between agrees with it.
_LOOSER = 5.0
#: Even harmonics and mean, relative to the fundamental: below the first they are rounding of a balance, above the other
#: the cycle is no mirror image of itself.
_ODD, _SKEW = 1e-6, 1e-2


@dataclass(frozen=True, eq=False)
class Target:
    """What is requested."""

    system: LureSystem
    cycle: LimitCycle  # the approximate cycle
    #: See :func:`eppanalysis.methods.orbits.mirrored.mirror`; None where the cycle is not its own mirror image.
    image: Array | None
    other_image: Array | None  # the same; None where the cycle may be its own mirror image
    tolerance: float  # how far frequency and sizes may be away, relative

    @classmethod
    def of(cls, system: LureSystem, hybrid: HybridSystem, cycle: LimitCycle) -> Target:
        """By the cycle's own estimate of its error."""
        image = mirror(hybrid)
        skew = 0.0 if image is None else _skew(system, hybrid, cycle)
        estimate = cycle.error_estimate
        tolerance = float(np.clip(_TIMES * estimate, _LEAST, _MOST)) if np.isfinite(estimate) else _MOST
        return cls(system, cycle, image if skew <= _ODD else None, image if skew > _SKEW else None, tolerance)

    def loosened(self) -> Target:
        """The same for an orbit that a better estimate vouches for, too."""
        return replace(self, tolerance=min(_LOOSER * self.tolerance, _MOST))

    def widened(self) -> Target:
        """The same for orbits that are known: of a relaxation oscillation more than a factor of two may be promised."""
        estimate = self.cycle.error_estimate
        if not np.isfinite(estimate):
            return self
        # An estimate is a share of the exact cycle, which may be 1/(1 - estimate) times as slow or large as predicted.
        return replace(self, tolerance=max(self.tolerance, estimate, 1.0 / (1.0 - min(estimate, _SHARE)) - 1.0))

    def difference(self, orbit: Orbit) -> str:
        """What tells an orbit from the one that is requested, in words; empty where nothing does."""
        cycle = self.cycle
        if not _near(orbit.period, cycle.period, self.tolerance):
            return f"has {number(1.0 / orbit.period)} Hz"
        if self.image is not None and not is_mirrored(orbit, self.image):
            return f"is not its own mirror image ({number(1.0 / orbit.period)} Hz)"
        # Beside a pair of mirror images there may be a symmetric cycle of nearly the same frequency and size.
        if self.other_image is not None and not orbit.one_of_many and is_mirrored(orbit, self.other_image):
            return f"is its own mirror image ({number(1.0 / orbit.period)} Hz)"
        floats = orbit.one_of_many or bool(np.any(free_of(orbit.hybrid)))
        return self.shape_difference(to_limit_cycle(self.system, orbit), floats)

    def shape_difference(self, found: LimitCycle, floats: bool = False) -> str:
        """The same for frequency, sizes and (unless the motion `floats`) means of a cycle."""
        cycle = self.cycle
        if not _near(found.period, cycle.period, self.tolerance):
            return f"has {number(found.frequency)} Hz"
        moving = [k for k, c in cycle.harmonics.items() if len(c) > 1 and found.peak_to_peak[k] > 0.0]
        names = [k for k in moving if abs(cycle.harmonics[k][1]) * abs(found.harmonics[k][1]) > 0.0]
        # The estimate holds for the first signal that moves, but that may be a difference of large parts, as what comes
        # out of an element is the same at any size: the one that is looked for is as large in it or in most signals.
        ratios = [abs(found.harmonics[k][1]) / abs(cycle.harmonics[k][1]) for k in names] or [1.0]
        if not any(_near(ratio, 1.0, self.tolerance) for ratio in (ratios[0], float(np.median(ratios)))):
            return f"has {100.0 * ratios[0]:.3g} % of the size ({number(found.frequency)} Hz)"
        shifts = [abs(found.mean[k] - cycle.mean[k]) / found.peak_to_peak[k] for k in names]
        if shifts and not floats and np.median(shifts) > self.tolerance:
            return f"has another mean ({number(found.frequency)} Hz)"
        return ""


def _near(value: float, other: float, tolerance: float) -> bool:
    return bool(abs(np.log(value / other)) <= np.log1p(tolerance))


def _skew(system: LureSystem, hybrid: HybridSystem, cycle: LimitCycle) -> float:
    """Largest even harmonic, with the mean about the loop's centre, relative to the size; not a number where that says
    nothing.
    """
    model, n = hybrid.model, hybrid.n_plant
    at_rest = model.Yx[:, n:] @ hybrid.x0[n:] + model.YH @ hybrid.H0
    skews = []
    for middle, name in zip(at_rest, system.signals.names, strict=True):
        c = cycle.harmonics.get(name, np.zeros(0))
        if len(c) < 2:
            continue
        size = max(float(abs(c[1])), cycle.peak_to_peak[name])
        even = max(float(abs(c[0].real - middle)), float(np.abs(c[2::2]).max(initial=0.0)))
        # A setpoint, which does not move, has harmonics of rounding.
        size, even = (part if part > ROUNDING * abs(middle) else 0.0 for part in (size, even))
        if size > 0 or even > 0:
            skews.append(even / size if size > 0 else np.nan)
    return float(np.max(skews)) if skews else np.nan
