"""Limits as they are printed: one number each, rounded to the side on which it holds; the only place that rounds them.

A limit is printed where the design was tested on the safe side of it, in a step of a drawing, and where it is as it was
computed in brackets behind, cut to the safe side too. Titles, tables, sentences, reports and pictures have both from
here, so that one limit is one number.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from decimal import Decimal

from eppanalysis.readable import DIGITS, number

_DASH = "-"
#: Most that is given away by rounding, relative to the smallest limit.
_GIVEN_AWAY = 0.02
#: How far a design is tested from a bound, relative to it, where nothing else is said.
MARGIN = 0.01


@dataclass(frozen=True)
class Limit:
    """A limit on a parameter, in SI units.

    Attributes
    ----------
    value : float
        As it was computed; nan where there is none.
    holds_above : bool
        Whether the parameter is to be at least the limit; at most, where not.
    tested : float
        Where the design was tested on the safe side; nan where it was not.
    how : str
        How `value` is known, in a word or two.
    """

    value: float
    holds_above: bool = False
    tested: float = math.nan
    how: str = "exact"

    @property
    def safe(self) -> float:
        """The limit, or where the design was tested on the safe side of it [SI]."""
        if not (math.isfinite(self.tested) and math.isfinite(self.value)):
            return self.value
        return max(self.value, self.tested) if self.holds_above else min(self.value, self.tested)

    @property
    def side(self) -> str:
        """On which side of it the parameter is to be kept."""
        return "above" if self.holds_above else "under"

    def beside(self, value: float) -> Limit:
        """A limit on something else that holds on the same side."""
        return Limit(value, self.holds_above)


@dataclass(frozen=True)
class Printed:
    """How the limits on one parameter are printed.

    Attributes
    ----------
    unit : str
        In which people read the parameter.
    factor : float
        From SI to that unit.
    step : Decimal
        In which limits are rounded, in that unit.
    """

    unit: str
    factor: float
    step: Decimal = field(default=Decimal("0.01"))

    @classmethod
    def of(cls, limits: Iterable[Limit], shown: tuple[str, float], step: float | None = None) -> Printed:
        """How limits are printed together: in a step that gives away 2 % of the smallest at most, or in one given."""
        unit, factor = shown
        values = [factor * limit.safe for limit in limits]
        return cls(unit, factor, drawing_step(values) if step is None else Decimal(f"{step:.12g}"))

    def number(self, limit: Limit) -> Decimal | str:
        """The limit, rounded to its safe side; a dash where there is none."""
        if not math.isfinite(limit.value):
            return _DASH
        return to_step(self.factor * limit.safe, self.step, up=limit.holds_above)

    def digits(self, limit: Limit) -> str:
        """The limit, rounded to its safe side, as text."""
        found = self.number(limit)
        return found if isinstance(found, str) else f"{found:f}"

    @property
    def in_steps(self) -> str:
        """The step with its unit."""
        return f"{self.step:f} {self.unit}".rstrip()

    def text(self, limit: Limit) -> str:
        """The limit with its unit."""
        return f"{self.digits(limit)} {self.unit}".rstrip()

    def computed(self, limit: Limit, digits: int = DIGITS) -> str:
        """Where it was computed to be, cut to the safe side, with its unit."""
        return f"{self.figures(limit, digits)} {self.unit}".rstrip()

    def figures(self, limit: Limit, digits: int = DIGITS) -> str:
        """Where it was computed to be, cut to the safe side."""
        return cut_text(self.factor * limit.value, digits, up=limit.holds_above)

    def whole(self, limit: Limit) -> str:
        """The limit with its unit, and in brackets where it was computed to be.

        Examples
        --------
        >>> fold = Limit(0.978586853, tested=0.9688)
        >>> Printed.of([fold], ("deg", 1.0)).whole(fold)
        '0.96 deg (exact 0.9785 deg)'
        """
        return f"{self.text(limit)} ({limit.how} {self.computed(limit)})"

    def kept(self, limit: Limit) -> str:
        """On which side of the limit the parameter is to be kept."""
        return f"{limit.side} {self.whole(limit)}"

    def span(self, limits: Sequence[Limit]) -> str:
        """From where to where limits run, and in brackets where they were computed to be.

        Examples
        --------
        >>> limits = [Limit(0.978586853, tested=0.9688), Limit(1.2098, tested=1.1977)]
        >>> Printed.of(limits, ("deg", 1.0)).span(limits)
        'in the range 0.96 deg to 1.19 deg (exact 0.9785 deg to 1.209 deg)'
        """
        low, high = (of(limits, key=lambda limit: limit.value) for of in (min, max))
        if low == high:
            return f"of {self.whole(low)}"
        how = low.how if all(limit.how == low.how for limit in limits) else "computed"
        return (
            f"in the range {self.text(low)} to {self.text(high)} ({how} {self.computed(low)} to {self.computed(high)})"
        )


def drawing_step(values: Sequence[float]) -> Decimal:
    """The step in which values are rounded for a drawing: 1, 2 or 5 of a decimal place, at most 2 % of the smallest.

    Examples
    --------
    >>> print(drawing_step([0.6875, 0.98]), drawing_step([14.2]))
    0.01 0.2
    """
    known = [abs(value) for value in values if math.isfinite(value) and value]
    most = _GIVEN_AWAY * min(known, default=1.0)
    place = math.floor(math.log10(most))
    digit = max(d for d in (1, 2, 5) if d * 10.0**place <= most * (1 + 1e-12))
    return Decimal(digit).scaleb(place)


def to_step(value: float, step: Decimal, *, up: bool = False) -> Decimal:
    """A value rounded down (or up) to a whole number of steps; what is one but for rounding errors stays.

    Examples
    --------
    >>> step = Decimal("0.05")
    >>> print(to_step(0.6875, step), to_step(0.6875, step, up=True), to_step(0.3, step))
    0.65 0.70 0.30
    """
    number = value / float(step)
    whole = math.ceil(number - 1e-9) if up else math.floor(number + 1e-9)
    found = whole * step
    return found.quantize(Decimal(1)) if found.as_tuple().exponent > 0 else found  # type: ignore[operator]


def cut(value: float, digits: int, *, up: bool = False) -> float:
    """A number cut to significant digits, or brought up to them: a limit, rounded to its safe side.

    Examples
    --------
    >>> cut(0.45977, 2), cut(0.45977, 2, up=True), cut(-0.45977, 2)
    (0.45, 0.46, -0.46)
    """
    if not (value and math.isfinite(value)):
        return value
    place = math.floor(math.log10(abs(value))) - digits + 1
    # What is a whole number of digits but for rounding errors stays one.
    scaled = value / 10.0**place
    whole = math.ceil(scaled - 1e-9) if up else math.floor(scaled + 1e-9)
    return float(f"{whole}e{place}")


def cut_text(value: float | str, digits: int = DIGITS, *, up: bool = False) -> str:
    """A number as text, cut (or brought up) to significant digits; a dash where there is none, a text as it is."""
    if isinstance(value, str):
        return value
    return _DASH if math.isnan(value) else number(cut(value, digits, up=up), digits)
