"""Which column of a table is what: roles by name, units in the heading or from the user; to SI at this border."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from eppanalysis.errors import CaseError
from eppanalysis.readable import written
from eppanalysis.units import QuantityError, parse_any, parse_quantity

#: The role of times.
TIME = "time"
_HEADING = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?\s*", re.DOTALL)
#: Length of all names up to which a message lists them, and how many it lists of more.
_LISTED, _MOST = 80, 10


@dataclass(frozen=True)
class Heading:
    """Name and unit of a column, "" where it has none, and both as the table has them."""

    name: str
    unit: str = ""
    text: str = ""

    @classmethod
    def of(cls, text: str, unit: str = "") -> Heading:
        """Of a name with its unit in brackets behind it, or with one that the table gives apart from it."""
        match = _HEADING.fullmatch(text)
        bracket = (match[2] or match[3] or "").strip() if match else ""
        # "q[0]" is a name: an index, no unit.
        name = text.strip() if match is None or bracket.isdigit() or unit else match[1]
        unit = unit or ("" if bracket.isdigit() else bracket)
        return cls(name, unit, text.strip() if bracket or not unit else f"{name} [{unit}]")

    def is_called(self, name: str) -> bool:
        """Whether a name without that of its topic is meant: "pitch" is "attitude.pitch"."""
        return self.name.lower().endswith(f".{name.lower()}")


@dataclass(frozen=True)
class Column:
    """Place of a role in the rows of a table, and the factor from its unit to SI."""

    role: str
    place: int
    factor: float
    heading: Heading


@dataclass(frozen=True)
class Headings:
    """The headings of a table, for what is looked for among them."""

    source: str  # of the table, for messages
    all: Sequence[Heading]
    line: str  # where they are in it: "line 1" of a text; "" where that is no question
    has_si: bool  # whether a column without a unit is in SI units

    def field(self, role: str) -> str:
        """Of a message about a role."""
        return f"{self.line}, {role}" if self.line else role

    @property
    def shown(self) -> str:
        """All of them, or how many there are."""
        listed = ", ".join(heading.text for heading in self.all)
        return listed if len(listed) <= _LISTED else f"{len(self.all)} columns"

    def nearest(self, names: Iterable[str]) -> str:
        """Of many, the ones that are nearest to some names, as the end of a sentence."""
        if not self.shown.endswith(" columns"):
            return ""

        def likeness(heading: Heading) -> float:
            last = heading.name.lower().rpartition(".")[2]
            return max((difflib.SequenceMatcher(None, name.lower(), last).ratio() for name in names), default=0.0)

        first = sorted(self.all, key=likeness, reverse=True)[:_MOST]
        return f"; the nearest are {', '.join(heading.text for heading in first)}"


def parse_choice(text: str, units: Mapping[str, str]) -> tuple[str, str, str]:
    """Role, name and unit ("" where the table gives it) of ``force=F (lbf):lbf``, as ``--signal`` takes it.

    A name alone is that of the role of the same name, or of the only one that there is beside the time.

    Parameters
    ----------
    units : mapping of str to str
        SI unit of every role.

    Raises
    ------
    CaseError
        If there is no such role, or no name.

    Examples
    --------
    >>> parse_choice("force=load cell 2:lbf", {"time": "s", "force": "N"})
    ('force', 'load cell 2', 'lbf')
    >>> parse_choice("imu.pitch [deg]", {"time": "s", "theta": "rad"})
    ('theta', 'imu.pitch [deg]', '')
    """
    role, equals, rest = text.partition("=")
    others = [name for name in units if name != TIME]
    if not equals:
        name = text.partition(":")[0].strip()
        role, rest = name if name in units or len(others) != 1 else others[0], text
    role = role.strip() if role.strip() in units else role.strip().lower()
    if not rest.strip() or not (equals or role in units):
        unit = written(units[others[0]]) if others else ""
        example = f'{others[0] if others else TIME}="channel 1{f":{unit}" if unit else ""}"'
        raise CaseError("--signal", "", text, f'SIGNAL="NAME:UNIT", such as {example}')
    if role not in units:
        raise CaseError("--signal", "", text, f"a signal that is one of {', '.join(dict.fromkeys(units))}")
    name, colon, unit = rest.rpartition(":")
    return (role, name.strip(), unit.strip()) if colon else (role, rest.strip(), "")


def find_columns(
    headings: Headings,
    needed: Sequence[str],
    optional: Sequence[str],
    choices: Mapping[str, tuple[str, str]],
    units: Mapping[str, str],
) -> tuple[Column, ...]:
    """The columns of a table that are needed, and those of the optional ones that are there; those chosen come first.

    Parameters
    ----------
    headings : Headings
        A column's name is the role, alone or behind that of its topic where no other ends so, unless `choices` says
        else.
    needed, optional : sequence of str
        Roles. Where there are choices, an optional role that is none of them is a column of just this name.
    choices : mapping of str to (str, str)
        Name and unit of a role, as the user gave them; an empty unit is taken from the heading.
    units : mapping of str to str
        SI unit of every role; a column whose role has none needs none.

    Raises
    ------
    CaseError
        If a role has no column or several, a column has no unit that needs one, or its unit measures something else.
    """
    found, named = [], list(choices)
    # Where signals have times of their own, those of the signal that is named first count.
    for role in sorted((*needed, *optional), key=lambda r: named.index(r) if r in named else len(named)):
        choice = choices.get(role)
        free = role in optional and choice is None
        places = _places(headings.all, role, choice, exactly=free and bool(choices))
        if free and (not places or (len(places) > 1 and headings.all[places[0]].name.lower() != role.lower())):
            continue
        if not places:
            raise _missing(headings, role, choice)
        if len(places) > 1:
            both = " and ".join(repr(headings.all[i].text) for i in places[:2])
            expected = f'one column: --signal {role}="NAME:UNIT"'
            raise CaseError(headings.source, headings.field(role), f"{both} at once", expected)
        heading = headings.all[places[0]]
        found.append(Column(role, places[0], _factor(headings, heading, role, choice, units[role]), heading))
    return tuple(found)


def _places(headings: Sequence[Heading], role: str, choice: tuple[str, str] | None, exactly: bool) -> list[int]:
    """Places of the columns that a role may mean: by the whole heading, by the name, by the name within a topic."""
    if choice is None:
        ways = [lambda h: h.name.lower() == role.lower(), lambda h: not exactly and h.is_called(role)]
    else:
        name = choice[0]
        # Headings may differ by their units alone, so that the whole one counts first.
        ways = [lambda h: h.text == name, lambda h: h.name == name, lambda h: h.is_called(name)]
    return next((places for way in ways if (places := [i for i, h in enumerate(headings) if way(h)])), [])


def _missing(headings: Headings, role: str, choice: tuple[str, str] | None) -> CaseError:
    if choice is not None:
        close = difflib.get_close_matches(choice[0], [h.text for h in headings.all], n=1)
        expected = f"the column {choice[0]!r} of --signal" + (f" (did you mean {close[0]!r}?)" if close else "")
    else:
        expected = f'a column {role!r} with its unit, or --signal {role}="NAME:UNIT" for one that is there'
    near = headings.nearest([role if choice is None else choice[0]])
    return CaseError(headings.source, headings.field(role), headings.shown, expected + near)


def _factor(headings: Headings, heading: Heading, role: str, choice: tuple[str, str] | None, si: str) -> float:
    unit = choice[1] if choice is not None and choice[1] else heading.unit
    if not unit and (not si or headings.has_si):
        return 1.0
    if not unit:
        example = f"{heading.name} [{written(si)}]"
        raise CaseError(headings.source, headings.field(role), heading.text, f"a unit with it, such as {example!r}")
    return unit_factor(headings, heading, role, unit, si)


def unit_factor(headings: Headings, heading: Heading, role: str, unit: str, si: str) -> float:
    """SI value of one of a column's unit.

    Raises
    ------
    CaseError
        If the unit measures something else, or is another one than in the heading.
    """
    try:
        factor = parse_quantity(f"1 {unit}", si)
    except QuantityError as error:
        expected = f"the unit of {error.expected}"
        raise CaseError(headings.source, headings.field(role), heading.text, expected) from None
    if heading.unit not in ("", unit) and _differ(heading.unit, unit):
        expected = f"the unit {unit!r} of --signal in the heading too"
        raise CaseError(headings.source, headings.field(role), heading.text, expected)
    return factor


def _differ(own: str, unit: str) -> bool:
    """Whether what a heading has is another unit than the one given; remarks are no units."""
    try:
        return parse_any(f"1 {own}") != parse_any(f"1 {unit}")
    except QuantityError:
        return False
