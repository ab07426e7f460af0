"""Words of case files: what parts and their fields are also called, in other programs and on data sheets.

A file that is read is put into our words once, so that all that follows knows one word for one thing. The
`kind` of a part says what it is; an element may call it `element`.
"""

from __future__ import annotations

import inspect
from collections.abc import Container, Iterable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

from eppanalysis.errors import CaseError
from eppanalysis.models.devices.declared import declared_fields
from eppanalysis.models.diagrams import BLOCKS
from eppanalysis.models.elements import ELEMENTS

KIND = "kind"
#: Another word for `kind`, which elements may have.
ELEMENT = "element"
#: Field of an element that names a CSV file, which holds its columns.
FILE = "file"
#: Fields that every element has.
OF_ALL = (KIND, "name", "memory")

#: Kinds by other words; of several the one is meant that knows most of the fields beside it, or the first.
KINDS_OF_BLOCKS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("dc_motor",), ("motor",)),
    **dict.fromkeys(("tf", "transfer_fcn"), ("transfer_function",)),
    **dict.fromkeys(("ss",), ("state_space",)),
    **dict.fromkeys(("zpk", "zero_pole"), ("zero_pole_gain",)),
    **dict.fromkeys(("delay", "deadtime", "transport_delay"), ("dead_time",)),
    **dict.fromkeys(("lowpass", "lag"), ("low_pass",)),
    **dict.fromkeys(("encoder", "adc"), ("sensor",)),
    **dict.fromkeys(("gearbox",), ("gear",)),
    **dict.fromkeys(("spring_damper",), ("shaft",)),
    **dict.fromkeys(("PI", "pi_controller"), ("pi",)),
    **dict.fromkeys(("PID", "pid_controller"), ("pid",)),
}
KINDS_OF_ELEMENTS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("backlash",), ("play", "lock_pin")),
    **dict.fromkeys(("friction_backlash",), ("play",)),
    **dict.fromkeys(("prandtl_ishlinsky",), ("prandtl_ishlinskii",)),
    **dict.fromkeys(("deadzone", "dead_band", "deadband"), ("dead_zone",)),
    **dict.fromkeys(("limit", "limiter", "clip", "sat"), ("saturation",)),
    **dict.fromkeys(("quantizer", "encoder", "adc"), ("quantiser",)),
    **dict.fromkeys(("floor_quantizer",), ("floor_quantiser",)),
    **dict.fromkeys(("mid_rise_quantizer",), ("mid_rise_quantiser",)),
    **dict.fromkeys(("coulomb_friction",), ("friction", "coulomb")),
    **dict.fromkeys(("coulomb_and_viscous_friction", "coulomb_viscous"), ("viscous_coulomb",)),
    **dict.fromkeys(("stribeck",), ("stribeck_friction",)),
    **dict.fromkeys(("dahl",), ("dahl_friction",)),
    **dict.fromkeys(("lugre",), ("lugre_friction",)),
    **dict.fromkeys(("boucwen",), ("bouc_wen",)),
    **dict.fromkeys(("relay_hysteresis", "relay_with_hysteresis"), ("hysteresis_relay",)),
    **dict.fromkeys(("relay_with_dead_zone",), ("relay_dead_zone",)),
    **dict.fromkeys(("sign", "signum"), ("relay",)),
    **dict.fromkeys(("compare", "compare_to_zero", "compare_to_constant"), ("comparator",)),
    **dict.fromkeys(("rate_limit",), ("rate_limiter",)),
    **dict.fromkeys(("lookup", "lookup_table_1d"), ("lookup_table",)),
}

_STEP = ("interval", "quantization_interval", "resolution", "quantum", "lsb")
#: Other words by our word for a field.
_Words = dict[str, tuple[str, ...]]
_LIMITS: _Words = {
    "lower": ("lower_limit", "min", "minimum"),
    "upper": ("upper_limit", "max", "maximum"),
}
_STATIC: _Words = {"static": ("stiction", "breakaway", "Fs"), "coulomb": ("Fc",)}
_CONTROLLER: _Words = {name.lower(): (name,) for name in ("Kp", "Ti", "Ki", "Td", "Kd", "Tf")}
#: Fields of kinds by other words of the same meaning, number for number.
_FIELDS: dict[tuple[str, ...], _Words] = {
    ("play", "lock_pin", "nordin_shaft", "backlash_compensator"): {
        "gap": ("backlash", "freeplay", "width", "deadband", "deadband_width")
    },
    ("prandtl_ishlinskii",): {"half_widths": ("thresholds", "radii")},
    ("saturation", "anti_windup_pid", "clamped_pid"): _LIMITS,
    ("dead_zone",): {"lower": ("start",), "upper": ("end",)},
    ("hysteresis_relay",): {
        "upper": ("switch_on_point",),
        "lower": ("switch_off_point",),
        "high": ("output_when_on",),
        "low": ("output_when_off",),
    },
    ("quantiser", "floor_quantiser", "mid_rise_quantiser", "sensor"): {"step": _STEP},
    ("friction", "stribeck_friction", "lugre_friction"): _STATIC,
    ("rate_limiter", "rate_limited_servo"): {"rate": ("rate_limit", "slew_rate")},
    ("lookup_table", "monotone_table"): {"inputs": ("breakpoints",), "outputs": ("table",)},
    ("pi", "pid", "anti_windup_pid", "clamped_pid"): _CONTROLLER,
    ("motor",): {
        "resistance": ("R",),
        "inductance": ("L",),
        "torque_constant": ("Kt", "kt"),
        "back_emf": ("Ke", "ke"),
        "ratio": ("gear_ratio",),
    },
    ("motor", "inertia"): {"inertia": ("J",)},
    ("transfer_function",): {"num": ("numerator",), "den": ("denominator",)},
    ("low_pass",): {"bandwidth": ("cutoff", "corner_frequency")},
    tuple(BLOCKS): {
        "sample_time": ("Ts", "ts", "dt"),
        "delay": ("dead_time", "deadtime", "transport_delay", "time_delay"),
    },
}


class InOurWords(NamedTuple):
    """Tables of a file in our words, and what the file calls the fields that it calls otherwise, by dotted names."""

    data: dict[str, Any]
    called: dict[str, str]


@cache
def other_words(kind: str) -> dict[str, str]:
    """Fields of a kind of part by what they are also called.

    Examples
    --------
    >>> other_words("play")["backlash"], "backlash" in other_words("saturation")
    ('gap', False)
    """
    found: dict[str, str] = {}
    for kinds, names in _FIELDS.items():
        for ours, others in names.items() if kind in kinds else ():
            if ours in fields_of(kind):
                found |= {other: ours for other in others if other not in fields_of(kind)}
    return found


def our_word(part: Any, name: str) -> str:
    """Our word for a field of a part that a file has, in our words, as this table.

    Examples
    --------
    >>> our_word({"kind": "play", "gap": "1 deg"}, "backlash")
    'gap'
    """
    kind = part.get(KIND) if isinstance(part, Mapping) else None
    return other_words(kind).get(name, name) if isinstance(kind, str) else name


def other_kinds(kind: str, words: Mapping[str, tuple[str, ...]]) -> list[str]:
    """A kind and all other words that mean it."""
    return [kind, *(word for word, meant in words.items() if kind in meant)]


@cache
def fields_of(kind: str) -> Container[str]:
    """Fields of a kind of block or element."""
    if kind in BLOCKS:
        return {KIND, *declared_fields(BLOCKS[kind])}
    made = ELEMENTS.get(kind)
    sizes = made.estimate.sizes if made and made.estimate else ()
    return {*(inspect.signature(made).parameters if made else ()), *sizes, FILE, *OF_ALL}


def in_our_words(data: dict[str, Any], known: Mapping[str, Any], source: str) -> InOurWords:
    """The tables of a file with parts and fields in our words; the very same where they are.

    Parameters
    ----------
    data : dict
        Tables of the file.
    known : mapping
        Those of the file that it inherits from, in our words, which may say what kind a part is.
    source : str
        What messages call the file.

    Raises
    ------
    CaseError
        If one thing is said in two words.
    """
    called: dict[str, str] = {}
    changed: dict[str, dict[str | int, Any]] = {}
    for path, table in _parts(data):
        kind = _kind_of(_at(known, path))
        ours = _of_part(table, kind, path[0] == "blocks", ".".join(map(str, path)), source, called)
        if ours is not table:
            changed.setdefault(".".join(map(str, path[:-1])), {})[path[-1]] = ours
    out = dict(data) if changed else data
    for at, parts in changed.items():
        first, *rest = at.split(".")
        if rest:
            out[first] = {**out[first], rest[0]: [parts.get(i, t) for i, t in enumerate(out[first][rest[0]])]}
        else:
            out[first] = {name: parts.get(name, table) for name, table in out[first].items()}
    return InOurWords(out, called)


def _parts(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str | int, ...], Mapping[str, Any]]]:
    """Tables of all parts, and their places."""
    loop = data.get("loop")
    for section in ("blocks", "elements"):
        named = data.get(section)
        inside = loop.get(section) if isinstance(loop, Mapping) else None
        rows: Iterable[tuple[tuple[str | int, ...], Any]] = [
            *(((section, name), table) for name, table in (named.items() if isinstance(named, Mapping) else ())),
            *((("loop", section, i), table) for i, table in enumerate(inside if isinstance(inside, list) else ())),
        ]
        yield from ((path, table) for path, table in rows if isinstance(table, Mapping))


def _at(data: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        data = data.get(key) if isinstance(data, Mapping) else None
    return data


def _kind_of(table: Any) -> Any:
    return table.get(KIND) if isinstance(table, Mapping) else None


def _of_part(
    table: Mapping[str, Any], inherited: Any, is_block: bool, place: str, source: str, called: dict[str, str]
) -> Mapping[str, Any]:
    """The table of a part in our words; `called` grows by what it calls otherwise."""
    out = table
    if not is_block and ELEMENT in table:
        out = _renamed(out, {ELEMENT: KIND}, place, source, called)
    word = out.get(KIND, inherited)
    kind = _meant(word, KINDS_OF_BLOCKS if is_block else KINDS_OF_ELEMENTS, out) if isinstance(word, str) else ""
    if kind not in (BLOCKS if is_block else ELEMENTS):
        return out
    if KIND in out and kind != word:
        out = {**out, KIND: kind}
    names = {name: ours for name, ours in other_words(kind).items() if name in out}
    return _renamed(out, names, place, source, called) if names else out


def _meant(word: str, kinds: Mapping[str, tuple[str, ...]], table: Mapping[str, Any]) -> str:
    """The kind that a word means."""

    def known(kind: str) -> int:
        return sum(name in fields_of(kind) or name in other_words(kind) for name in table)

    return max(kinds[word], key=known) if word in kinds else word


def _renamed(
    table: Mapping[str, Any], names: Mapping[str, str], place: str, source: str, called: dict[str, str]
) -> dict[str, Any]:
    """A table with other names for its fields, in their order."""
    out: dict[str, Any] = {}
    for name, value in table.items():
        ours = names.get(name, name)
        if ours in out:
            both = [other for other in table if names.get(other, other) == ours]
            expected = f"either {both[0]} or {both[1]}, which mean the same"
            raise CaseError(source, f"{place}.{name}", value, expected)
        out[ours] = value
        if ours != name:
            called[f"{place}.{ours}"] = f"{place}.{name}"
    return out
