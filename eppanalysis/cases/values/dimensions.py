"""Whether the units in a loop go together: the fields of an element, and the signals before and behind it.

Every field has the unit of the element's input, of its output, or of a quotient of them: a gap that of the input, the
stiffness behind it that of output over input. What is given without a unit is taken to fit. Radians count where a field
has the unit of a signal as it is; in quotients they may be left out, as people do ("N*m*s").
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.cases.blocks import Block, element_class
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.models.elements.base import IN, OUT, RATIO, Role
from eppanalysis.units import KINDS, dimensions, format_si, unit_of

if TYPE_CHECKING:
    from eppanalysis.cases.files import RawCase
    from eppanalysis.cases.schema import LoopSection

#: Sizes that a quantity has in machines; what is outside has more likely a wrong unit.
_USUAL: dict[str, tuple[float, float]] = {
    "rad": (1e-9, 4.0 * math.pi),
    "rad/s": (1e-9, 1e5),
    "m": (1e-10, 1e4),
    "m/s": (1e-9, 1e4),
    "s": (1e-10, 1e7),
    "kg": (1e-9, 1e7),
    "N": (1e-9, 1e8),
    "N*m": (1e-9, 1e8),
    "V": (1e-9, 1e6),
}
#: An angle that is given without a unit and is larger is likelier to be in degrees [rad].
_LIKELY_DEGREES = 0.5


@dataclass(frozen=True)
class _Fact:
    """A unit that is known: its field, its role, its exponents."""

    field: str
    role: Role
    exponents: Mapping[str, int]

    @property
    def direct(self) -> bool:
        """Whether it is the unit of a signal as it is, so that radians count."""
        return self.role in (IN, OUT, RATIO)


def check_units(loop: LoopSection, blocks: Sequence[Block], place: str, raw: RawCase) -> None:
    """Refuse units that do not go together.

    Parameters
    ----------
    place : str
        Where the blocks are in the file.

    Raises
    ------
    CaseError
        At the first field whose unit contradicts what is known by then.
    """
    first_in = first_out = 0
    for i, block in enumerate(blocks):
        if not block.kind:
            continue
        known = list(_of_signals(loop, first_in, first_out))
        if element_class(block.kind).same_unit:
            known.append(_Fact("", (-1, 1, 0), {}))
        _check_block(block, _given(block), known, f"{place}.{i}", raw)
        n_in, n_out = block.width
        first_in, first_out = first_in + n_in, first_out + n_out


def check_each(block: Block, place: str, raw: RawCase) -> None:
    """Refuse units of one element that its fields cannot have, whatever the others have.

    Raises
    ------
    CaseError
        At the first such field.
    """
    for given in _given(block):
        _check_block(block, [given], [], place, raw)


def check_fields(block: Block, place: str, raw: RawCase) -> None:
    """Refuse units of one element, of whose signals nothing is known, that do not go together.

    Raises
    ------
    CaseError
        At the first field whose unit contradicts those before it.
    """
    known = [_Fact("", (-1, 1, 0), {})] if element_class(block.kind).same_unit else []
    _check_block(block, _given(block), known, place, raw)


def units_of_ports(block: Block) -> tuple[str, str]:
    """SI units of an element's input and output, as far as its fields tell; empty where they do not.

    Examples
    --------
    >>> from eppanalysis.cases.values.quantities import Parameter
    >>> gap = Parameter(value=0.012, unit="m", mark="assumed")
    >>> units_of_ports(Block("play", "play", {"gap": gap}, {}, roles={"gap": IN}))
    ('m', 'm')
    """
    facts = [
        _Fact(name, block.roles[name], dimensions(parameter.unit))
        for _, name, parameter in _given(block)
        if name in block.roles and parameter.unit
    ]
    first, second = (_unit_of_port(facts, role) for role in (IN, OUT))
    return (first or second, second or first) if element_class(block.kind).same_unit else (first, second)


def _unit_of_port(known: Sequence[_Fact], role: Role) -> str:
    direct = [f for f in known if f.direct]
    names = {"radian", *(name for f in known for name in f.exponents)}
    powers = {name: _implied(direct if name == "radian" else known, role, name) for name in names}
    found = {name: power for name, power in powers.items() if power is not None}
    return unit_of(found) if len(found) == len(names) and any(found.values()) else ""


def _of_signals(loop: LoopSection, first_in: int, first_out: int) -> Iterator[_Fact]:
    """Units of input and output of an element, from declared signals that are just these."""
    for name, row in (loop.signals or {}).items():
        exponents = _exponents(row.unit)
        if not row.unit or exponents is None:
            continue
        if _is_input(loop, first_in, row.state, row.output):
            yield _Fact(f"signals.{name}", IN, exponents)
        weights = row.output or []
        if weights and not any(row.state or []) and abs(_at(weights, first_out)) == 1.0 == sum(map(abs, weights)):
            yield _Fact(f"signals.{name}", OUT, exponents)


def _is_input(loop: LoopSection, place: int, state: Sequence[float] | None, output: Sequence[float] | None) -> bool:
    """Whether a signal is the input of the element there, or its opposite."""
    if not loop.C or place >= len(loop.C) or state is None or any(output or []):
        return False
    if any(_at(loop.D, place) or []) or not any(state):
        return False
    return list(state) in (list(loop.C[place]), [-x for x in loop.C[place]])


def _at(values: Sequence[Any] | None, place: int) -> Any:
    return values[place] if values is not None and place < len(values) else 0


def _exponents(unit: str) -> Mapping[str, int] | None:
    """Exponents of the unit of a signal, which may be any word; None for a word that is no unit."""
    try:
        return dimensions(unit)
    except ValueError:
        return None


def _check_block(
    block: Block, fields: Iterable[tuple[str, str, Parameter]], known: list[_Fact], place: str, raw: RawCase
) -> None:
    """Refuse the first of an element's fields that does not go with `known`, which grows by those that do."""
    for where, name, parameter in fields:
        role = block.roles.get(name)
        if role is None or not (parameter.unit or parameter.friendly):
            continue
        fact = _Fact(name, role, dimensions(parameter.unit))
        expected = _unlike(block.kind, fact) or _contradicted(known, fact)
        if expected:
            raise raw.refused(f"{place}.{where}", expected)
        known.append(fact)


def _unlike(kind: str, fact: _Fact) -> str:
    """What a field of this element is by its nature; empty where it may be that, or has none."""
    names, element = fact.exponents, element_class(kind)
    if element.output_is == "force" and fact.role == OUT and not (names.get("second", 0) < 0 or "ampere" in names):
        return "a force or a torque such as '2 N'"
    if element.input_is == "way" and fact.role == IN and names not in ({"radian": 1}, {"meter": 1}):
        return "an angle or a length such as '2.5 deg'"
    return ""


def _given(block: Block) -> Iterator[tuple[str, str, Parameter]]:
    """The place of each value in the block, its field, and the value."""
    for name, parameter in block.parameters.items():
        yield name, name, parameter
    for name, parameters in block.lists.items():
        for i, parameter in enumerate(parameters):
            yield f"{name}.{i}", name, parameter


def _contradicted(known: Sequence[_Fact], fact: _Fact) -> str:
    """What a field should be by what is known; empty where it may be as it is."""
    if fact.role == RATIO:
        return "a plain number or a percentage" if fact.exponents else ""
    direct = [f for f in known if f.direct]
    wanted: dict[str, float] = {}
    wrong = False
    names = {name for f in (*known, fact) for name in f.exponents}
    # A time or a rate is one whatever the signals are.
    for name in sorted(names | ({"second"} if fact.role[:2] == RATIO[:2] else set())):
        here = fact.exponents.get(name, 0)
        found = _implied(direct if name == "radian" else known, fact.role, name)
        wanted[name] = here if found is None else found
        wrong |= wanted[name] != here and (name != "radian" or fact.direct)
    if not wrong:
        return ""
    unit = unit_of(wanted)
    kind, example = KINDS.get(unit, (f"a quantity in {unit}", f"1 {unit}"))
    because = ", ".join(dict.fromkeys(f.field for f in known if f.field))
    return f"{kind} such as {example!r}" + (f", to go with {because}" if because else "")


def _implied(known: Sequence[_Fact], role: Role, name: str) -> float | None:
    """Exponent of a base unit in a field of this role, None where what is known does not tell."""
    # Exponents add up as roles do: a role that is a combination of known ones has that combination of their exponents.
    weights = _combination(tuple(f.role[:2] for f in known), role[:2])
    if weights is None:
        return None
    right = sum(weight * _right(f, name) for weight, f in zip(weights, known, strict=True))
    return round(right, 9) + (role[2] if name == "second" else 0)


@lru_cache(maxsize=1024)
def _combination(known: tuple[tuple[int, int], ...], wanted: tuple[int, int]) -> tuple[float, ...] | None:
    """Weights with which roles add up to another one, None where they do not."""
    rows = np.array(known, float).reshape(-1, 2)
    weights = np.linalg.lstsq(rows.T, np.array(wanted, float), rcond=None)[0] if known else np.zeros(0)
    return tuple(weights.tolist()) if np.allclose(weights @ rows, wanted) else None


def _right(fact: _Fact, name: str) -> float:
    return fact.exponents.get(name, 0) - (fact.role[2] if name == "second" else 0)


def remarks(parameters: Mapping[str, Parameter], without_unit: Sequence[str]) -> tuple[str, ...]:
    """Sentences on values that are possible but hardly meant.

    Parameters
    ----------
    without_unit : sequence of str
        Those that are plain numbers in the file.
    """
    found = []
    for name, parameter in parameters.items():
        value, unit = parameter.value, parameter.unit
        if isinstance(value, bool) or not value or unit not in _USUAL:
            continue
        low, high = _USUAL[unit]
        shown = parameter.friendly or unit
        if unit == "rad" and name in without_unit and abs(value) > _LIKELY_DEGREES:
            degrees = format_si(value, "rad", "deg")
            found.append(
                f"{name} is {value:g} without a unit: {value:g} rad, which are {degrees}; "
                f'for degrees write "{value:g} deg".'
            )
        elif not low <= abs(value) <= high:
            ends = f"{format_si(low, unit, shown)} to {format_si(high, unit, shown)}"
            found.append(
                f"{name} is {format_si(value, unit, shown)}, far from what machines have ({ends}): is its unit right?"
            )
    return tuple(found)
