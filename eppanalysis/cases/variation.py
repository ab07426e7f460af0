"""What is worth varying in a case; of any loop that does not say it better, its positive parameters."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.errors import CaseError
from eppanalysis.models.elements.base import IN, OUT, OUT_PER_TIME
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.readable import number, with_unit, words


@dataclass(frozen=True)
class Slider:
    """A parameter with the range that it is moved over; its numbers are in the unit that people use."""

    name: str
    title: str
    unit: str
    per_unit: float  # SI value of one `unit`
    low: float
    high: float
    step: float
    value: float

    def label(self) -> str:
        """Title with unit."""
        return with_unit(self.title, self.unit)


class Varied(Protocol):
    """The part of a case that is used here; the case itself is in a higher layer."""

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Every scalar parameter that is given."""

    def value(self, name: str) -> float:
        """Value of a field [SI]."""

    def si(self, name: str, value: object) -> float:
        """SI value of a quantity in a field."""

    def unit(self, name: str) -> tuple[str, str]:
        """SI unit of a field, and the one that people use."""

    def with_values(self, values: Mapping[str, Any]) -> Any:
        """The case with other values."""

    @property
    def t_end(self) -> float:
        """Length of its run [s]."""

    def held(self, name: str) -> Any:
        """What the file holds in a field."""

    def parameter_of(self, field: str) -> str:
        """The parameter that makes a field of a part larger; empty where there is none."""

    def to_system(self) -> LureSystem:
        """The loop."""


@dataclass(frozen=True)
class Variation(ABC):
    """What is worth varying in a case of one kind."""

    #: The parameter that guidelines run over and the one that they bound, where nothing else is requested.
    guided: ClassVar[tuple[str, str] | None] = None

    case: Varied

    @abstractmethod
    def sliders(self) -> Iterable[Slider]:
        """Parameters with the ranges that they are moved over."""

    @property
    def example(self) -> str:
        """A field of the case with its value, as one sets them."""
        own = (f"{slider.name} = {number(slider.value)} {slider.unit}".rstrip() for slider in self.sliders())
        return next(own, "")

    @abstractmethod
    def over(self) -> list[str]:
        """Parameters that a picture may run over, most telling first."""

    def beside(self, limit: str) -> list[str]:
        """Parameters over which another one is bounded, most telling first."""
        return [name for name in (*(self.guided or ()), *self.over()) if name != limit]

    @abstractmethod
    def branch(self, name: str) -> tuple[float, float, float]:
        """Where a branch over a parameter starts, with a cycle at hand and without one, and where it stops [SI]."""

    def places(self) -> dict[str, str]:
        """Inputs that a part may be put before, with what drives them; none but in a diagram."""
        return {}

    @abstractmethod
    def axes(self, points: int = 9) -> dict[str, str]:
        """Axes of a map of designs, as sweeps take them, of so many points; none where there are less than two."""


class LoopVariation(Variation):
    """Of any loop: its gain and whatever is positive."""

    def sliders(self) -> Iterable[Slider]:
        """What a picture may run over, from a tenth to three times of what it is."""
        for name in self.over():
            value, unit = self.case.value(name), self.case.unit(name)[1]
            per_unit = self.case.si(name, f"1 {unit}".strip())
            shown = value / per_unit
            step = 10.0 ** math.floor(math.log10(shown) - 1.5)
            yield Slider(name, words(name), unit, per_unit, shown / 10.0, 3.0 * shown, step, shown)

    def over(self) -> list[str]:
        """What is tunable, the gain, what else is positive, and the delay last; no half of what has two sides."""
        given = self.case.parameters
        names = [name for name in self._positive if _other_side(name) not in given]

        def place(name: str) -> tuple[bool, bool, bool]:
            return not self._is_tunable(name), name != "loop.gain", name == "loop.delay"

        return sorted(names, key=place)

    @cached_property
    def _positive(self) -> list[str]:
        """Parameters that are positive and may move a little: no counts and no sample times of discrete time."""
        given = self.case.parameters
        names = [*(["loop.gain"] if "loop.gain" not in given and takes(self.case, "loop.gain", 1.01) else []), *given]
        positive = [n for n in names if not isinstance(value := self.case.value(n), bool) and value > 0]
        return [n for n in positive if n != "loop.time_step" and takes(self.case, n, 1.01 * self.case.value(n))]

    def beside(self, limit: str) -> list[str]:
        """Beside what is free to choose the sizes of elements, beside all else what is free to choose."""
        over = self.over()
        is_free = self._is_tunable(limit) or limit in over[:1]
        both = (self._sizes, over) if is_free else (over, self._sizes)
        return [name for name in dict.fromkeys([*both[0], *both[1]]) if name != limit]

    @cached_property
    def _sizes(self) -> list[str]:
        """Parameters that make an element larger: widths, levels, rates; those with a name first."""
        system = self.case.to_system()
        fields = [
            (f"{name}.{field}", role)
            for name, element in zip(system.element_names, system.elements, strict=True)
            for field, role in element.units.items()
            if _other_side(f"{name}.{field}") not in self.case.parameters
        ]
        ranked = (field for wanted in (IN, OUT, OUT_PER_TIME) for field, role in fields if role == wanted)
        found = dict.fromkeys(self.case.parameter_of(field) for field in ranked)
        return sorted((name for name in found if name in self._positive), key=lambda name: "." in name)

    def branch(self, name: str) -> tuple[float, float, float]:
        """From where the parameter is, or from four times of it, down to a quarter."""
        value = self.case.value(name)
        return value, 4.0 * value, 0.25 * value

    def axes(self, points: int = 9) -> dict[str, str]:
        """Two that are tunable, else the first parameter and the size of an element, around what they are."""
        names = self.over()
        tunable = [name for name in names if self._is_tunable(name)]
        pair = tunable[:2] if len(tunable) > 1 else [*names[:1], *self.beside(names[0])[:1]] if names else []
        return {name: self._around(name, points) for name in pair} if len(pair) == 2 else {}

    def _is_tunable(self, name: str) -> bool:
        return name in self.case.parameters and self.case.parameters[name].mark == "tunable"

    def _around(self, name: str, points: int) -> str:
        """As far to both sides: the middle one of an odd number of points is the case's own value."""
        unit = self.case.unit(name)[1]
        shown = self.case.value(name) / self.case.si(name, f"1 {unit}".strip())
        return f"{0.25 * shown:.12g}:{1.75 * shown:.12g}:{points}" + (f":{unit}" if unit else "")


#: Runs of a map are so many times as long as the case's own.
_LONGER = 4.0
#: The two sides of what need not be symmetric; alone, one of them makes an element that nobody builds.
_SIDES = {"upper": "lower", "lower": "upper", "high": "low", "low": "high"}


def _other_side(name: str) -> str:
    """The field that holds the other side of what a field holds one of; empty where it holds all."""
    element, _, last = name.rpartition(".")
    return f"{element}.{_SIDES[last]}" if last in _SIDES else ""


def time_of_maps(case: Varied) -> float:
    """Length of the runs of a map around a case [s]: what settles in other designs may take longer than in the case's.

    A run ends where it has settled or repeats itself: only those that take longer cost more.
    """
    return _LONGER * case.t_end


def takes(case: Varied, name: str, value: float) -> bool:
    """Whether a field may have a value: a transfer function has a gain in front of it, a count is a whole number."""
    try:
        return bool(case.with_values({name: value}))
    except CaseError:
        return False
