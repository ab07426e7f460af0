"""What may explain an oscillation of a loop: the loop as it is modelled, or one of its elements alone.

Beside an element that is taken alone the others are the gains of their ideals. An element's size is a factor on those
of its fields that are measured in the units of its signals: with the factor s
its map is s f(x/s). Where the rest of the loop is linear and rests at zero, its limit cycles grow in proportion.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields as fields_of, replace
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.diagnose.linear import Linear, is_linear
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget, remaining
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.absorbed import with_gains
from eppanalysis.models.systems.lure import LureSystem, with_own_states
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.places import Places
from eppanalysis.results import LimitCycle

#: Constant terms of a loop, relative to its other numbers, that are rounding.
_ROUNDING = 1e-12
#: Steps of the engine that the search for the cycles of one candidate may take.
STEPS = 1_000_000


def size_exponents(element: Nonlinearity) -> dict[str, int]:
    """By which power of a factor on input and output each field of an element grows; those that do not left out.

    Examples
    --------
    >>> from eppanalysis.models.elements import Saturation
    >>> size_exponents(Saturation(-1.0, 1.0, 2.0))
    {'lower': 1, 'upper': 1}
    """
    values = {name: getattr(element, name) for name in element.units}
    return {
        name: roles[0] + roles[1]
        for name, roles in element.units.items()
        if roles[0] + roles[1] and isinstance(values[name], Real) and values[name] != 0
    }


def resized(element: Nonlinearity, size: float) -> Nonlinearity:
    """The element with the map ``size * f(x/size)``."""
    own = {f.name for f in fields_of(element) if f.init}  # type: ignore[arg-type]  # those with a size are dataclasses
    powers = {name: power for name, power in size_exponents(element).items() if name in own}
    changed: dict[str, Any] = {name: getattr(element, name) * size**power for name, power in powers.items()}
    return replace(element, **changed)  # type: ignore[type-var]


def _parts(system: LureSystem, active: int, size: float) -> LureSystem:
    """The loop with gains in place of elements with states of their own, one element left as it is but for its size."""
    base = system.given or system
    elements = tuple(resized(e, size) if i == active else (e.small_signal or e) for i, e in enumerate(base.elements))
    loop = replace(base, elements=elements, memory=(None,) * len(elements))
    return loop if system.given is None else with_own_states(loop)


@dataclass(frozen=True, eq=False)
class Sought:
    """Limit cycles that are sought with a bound of effort."""

    system: LureSystem
    at: OperatingPoint
    steps: float  # of the engine, for one search

    @cached_property
    def begun(self) -> set[float]:
        """Sizes at which cycles were sought."""
        return set()

    @cached_property
    def finished(self) -> set[float]:
        """Sizes at which the search was done before it had taken all of its steps."""
        return set()

    def sought(self, loop: LureSystem, size: float = 1.0) -> tuple[LimitCycle, ...]:
        """The limit cycles of a loop that are not unstable, as far as the steps of a search lead.

        Raises
        ------
        EppError
            If they cannot be sought.
        """
        found: Iterable[LimitCycle] = ()
        self.begun.add(size)
        with budget(self.steps), suppress(BudgetExceeded):
            found = find_limit_cycles(loop, self.at)
            if remaining():
                self.finished.add(size)
        return tuple(c for c in found if c.stable is not False)


@dataclass(frozen=True, eq=False)
class Whole(Sought):
    """The limit cycles of the loop as it is modelled."""

    @cached_property
    def cycles(self) -> tuple[LimitCycle, ...]:
        """Those that are not unstable.

        Raises
        ------
        EppError
            If they cannot be sought.
        """
        return self.sought(self.system)


@dataclass(frozen=True, eq=False)
class Family(Sought):
    """The limit cycles of a loop with one of its elements, over the size of that element."""

    number: int  # of the element
    gains: dict[int, Array]  # of the other elements; those without a gain stay as they are

    @property
    def element(self) -> Nonlinearity:
        """As the model has it."""
        return (self.system.given or self.system).elements[self.number]

    @property
    def name(self) -> str:
        """What the loop calls the element."""
        return self.system.element_names[self.number]

    def loop(self, size: float = 1.0) -> LureSystem:
        """The loop with the element alone, of a size relative to that in the model."""
        others = {i: gain for i, gain in self.gains.items() if i != self.number}
        return with_gains(_parts(self.system, self.number, size), others)

    @cached_property
    def alone(self) -> bool:
        """Whether a gain replaces every other element."""
        return sum(not is_linear(e) for e in self.loop().elements) == 1

    @cached_property
    def in_proportion(self) -> bool:
        """Whether its limit cycles grow in proportion to its size."""
        loop = self.loop()
        v = self.at.vector(loop)
        offsets = np.concatenate([
            (loop.B_input @ v + loop.constant_state)[Places.of(loop).plant], loop.D_input @ v + loop.constant_input,
        ])  # fmt: skip
        size = max(np.abs(loop.A).max(initial=1.0), 1.0)
        return self.alone and bool(np.all(np.abs(offsets) <= _ROUNDING * size))

    @cached_property
    def _known(self) -> dict[float, tuple[LimitCycle, ...]]:
        return {}

    def cycles(self, size: float = 1.0) -> tuple[LimitCycle, ...]:
        """The limit cycles that are not unstable; in proportion those of the model's size.

        Raises
        ------
        EppError
            If they cannot be sought.
        """
        size = 1.0 if self.in_proportion else size
        if size not in self._known:
            self._known[size] = self.sought(self.loop(size), size)
        return self._known[size]


@dataclass(frozen=True, eq=False)
class Candidates:
    """All that may explain an oscillation of a loop."""

    system: LureSystem
    at: OperatingPoint
    whole: Whole
    families: tuple[Family, ...]  # of the elements that have a size
    linear: Linear
    left_out: dict[str, str]  # elements that are no candidate of their own, and why


def candidates_of(system: LureSystem, at: OperatingPoint, steps: float = STEPS) -> Candidates:
    """The candidates of a loop; each search for their cycles takes so many steps of the engine at most."""
    linear = Linear.of(system, at)
    base = system.given or system
    families, left_out = [], {}
    for i, (name, element) in enumerate(zip(base.element_names, base.elements, strict=True)):
        if not size_exponents(element):
            left_out[name] = "has no size in the model, or none that can be varied"
        else:
            families.append(Family(system, at, steps, i, linear.gains))
    return Candidates(system, at, Whole(system, at, steps), tuple(families), linear, left_out)
