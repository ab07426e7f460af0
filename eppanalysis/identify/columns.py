"""Which column of a CSV file is what: roles by name, units in the header or from the user; to SI at this border."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from eppanalysis.errors import CaseError
from eppanalysis.readable import readable, written
from eppanalysis.units import QuantityError, parse_any, parse_quantity


class Role(StrEnum):
    """What a column of a measured file holds."""

    TIME = "time"
    FORCE = "force"
    VOLTAGE = "voltage"
    ANGLE = "angle"
    TORQUE = "torque"
    HARNESS = "harness"


#: SI unit of each role, and what people write in a header, for messages.
ROLES: Mapping[str, str] = dict(zip(Role, ("s", "N", "V", "rad", "N*m", "m"), strict=True))
_EXAMPLES: Mapping[str, str] = dict(zip(Role, ("ms", "lbf", "V", "deg", "N*m", "mm"), strict=True))
_HEADER = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?\s*", re.DOTALL)


@dataclass(frozen=True)
class Layout:
    """What the columns of a recorded response are of a case."""

    #: signals, inputs: signal of the loop, and external input, by the role of the column that may hold it.
    signals: Mapping[str, str]
    inputs: Mapping[str, str]
    units: Mapping[str, str]  # SI unit of every role, "time" among them
    clipped: tuple[str, ...] = ()  # roles whose sensor may saturate, which the loop itself does not know
    #: Whether a recorded input counts from its first row on; else from where the case has it before the start.
    from_first: bool = False


#: Of an elbow: its sensors and its harness.
ELBOW = Layout(
    {Role.ANGLE: "theta", Role.FORCE: "sensor_force"}, {Role.HARNESS: "harness_position"}, ROLES, (Role.FORCE,), True
)


@dataclass(frozen=True)
class Column:
    """Place of a role in the rows of a file, and the factor from its unit to SI."""

    role: str
    place: int
    factor: float
    header: str


def parse_choice(text: str, roles: Mapping[str, str] = ROLES) -> tuple[str, str, str]:
    """Role, header and unit ("" where the header gives it) of ``force=F (lbf):lbf``, as ``--column`` takes it.

    Parameters
    ----------
    roles : mapping of str to str
        SI unit of every role.

    Raises
    ------
    CaseError
        If there is no such role, or no header.

    Examples
    --------
    >>> parse_choice("force=load cell 2:lbf")
    ('force', 'load cell 2', 'lbf')
    >>> parse_choice("angle=theta [deg]")
    ('angle', 'theta [deg]', '')
    """
    role, equals, rest = text.partition("=")
    role = role.strip() if role.strip() in roles else role.strip().lower()
    if not equals or not rest.strip():
        raise CaseError("--column", "", text, f'ROLE="HEADER:UNIT", such as {_example(roles)}')
    if role not in roles:
        raise CaseError("--column", "", text, f"a role that is one of {', '.join(dict.fromkeys(roles))}")
    header, colon, unit = rest.rpartition(":")
    return (role, header.strip(), unit.strip()) if colon else (role, rest.strip(), "")


def _example(roles: Mapping[str, str]) -> str:
    """How a column is named for the first of some roles that is not the time."""
    role = next((role for role in roles if role != Role.TIME), Role.TIME)
    unit = _EXAMPLES.get(role) or written(readable(roles[role])[0])
    return f'{role}="channel 1{f":{unit}" if unit else ""}"'


def find_columns(
    header: Sequence[str],
    needed: Sequence[str],
    optional: Sequence[str],
    choices: Mapping[str, tuple[str, str]],
    source: str,
    units: Mapping[str, str] = ROLES,
) -> tuple[Column, ...]:
    """The columns of a file that a bench needs, and those of the optional ones that are there.

    Parameters
    ----------
    header : sequence of str
        Cells of the first line: ``name [unit]`` or ``name (unit)``; the name is the role unless `choices` says else.
    needed, optional : sequence of str
        Roles.
    choices : mapping of str to (str, str)
        Header and unit of a role, as the user gave them; an empty unit is taken from the header.
    source : str
        File, for messages.
    units : mapping of str to str
        SI unit of every role; a column whose role has none needs none.

    Raises
    ------
    CaseError
        If a role has no column or several, a column has no unit, or its unit measures something else.
    """
    found = []
    for role in (*needed, *optional):
        place = _place(header, role, choices.get(role), source)
        if place is None:
            if role in optional and role not in choices:
                continue
            raise _missing(header, role, choices.get(role), source)
        factor = _factor(header[place], role, choices.get(role), source, units[role])
        found.append(Column(role, place, factor, header[place]))
    return tuple(found)


def _place(header: Sequence[str], role: str, choice: tuple[str, str] | None, source: str) -> int | None:
    if choice is None:
        places = [i for i, cell in enumerate(header) if _split(cell)[0].lower() == role.lower()]
    else:
        places = [i for i, cell in enumerate(header) if cell.strip() == choice[0]]
        # Headers may differ by their units alone, so that the whole one counts first.
        places = places or [i for i, cell in enumerate(header) if _split(cell)[0] == choice[0]]
    if len(places) > 1:
        both = " and ".join(repr(header[i].strip()) for i in places[:2])
        raise CaseError(source, f"line 1, {role}", f"{both} at once", f'one column: --column {role}="HEADER:UNIT"')
    return places[0] if places else None


def _split(cell: str) -> tuple[str, str]:
    """Name and unit of a header's cell."""
    match = _HEADER.fullmatch(cell)
    return (match[1], (match[2] or match[3] or "").strip()) if match else (cell.strip(), "")


def _missing(header: Sequence[str], role: str, choice: tuple[str, str] | None, source: str) -> CaseError:
    names = [cell.strip() for cell in header]
    shown = ", ".join(names)
    if choice is not None:
        close = difflib.get_close_matches(choice[0], names, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        return CaseError(source, f"line 1, {role}", shown, f"the column {choice[0]!r} of --column{hint}")
    example = f"{role} [{_EXAMPLES[role]}]" if role in _EXAMPLES else role
    return CaseError(
        source,
        f"line 1, {role}",
        shown,
        f'a column {example!r}, or --column {role}="HEADER:UNIT" for one that is there',
    )


def _factor(cell: str, role: str, choice: tuple[str, str] | None, source: str, si: str) -> float:
    own = _split(cell)[1]
    unit = choice[1] if choice is not None and choice[1] else own
    if not unit and not si:
        return 1.0
    if not unit:
        example = f"{_split(cell)[0]} [{_EXAMPLES.get(role, si)}]"
        raise CaseError(source, f"line 1, {role}", cell.strip(), f"a unit with it, such as {example!r}")
    try:
        factor = parse_quantity(f"1 {unit}", si)
        if own and own != unit and _differ(own, unit):
            raise CaseError(source, f"line 1, {role}", cell.strip(), f"the unit {unit!r} of --column in the header too")
    except QuantityError as error:
        raise CaseError(source, f"line 1, {role}", cell.strip(), f"the unit of {error.expected}") from None
    return factor


def _differ(own: str, unit: str) -> bool:
    """Whether what is in brackets in a header is another unit than the one given; remarks are no units."""
    try:
        return parse_any(f"1 {own}") != parse_any(f"1 {unit}")
    except QuantityError:
        return False
