"""All mistakes of a case file at once: what is wrong is taken out, and what is left is looked at again.

A name that is taken out is missed elsewhere, and what a connection drove is left open: what follows from that is no
mistake of the file. A part that cannot be made is replaced by one with its ports, so that all connections are seen,
but for units and algebraic loops through it. It is named, as are names whose use was not seen.
"""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from eppanalysis.cases.blocks import example, left_out
from eppanalysis.cases.diagrams import with_declaration
from eppanalysis.cases.files import Connections, Missing, RawCase, read_raw
from eppanalysis.cases.model import load
from eppanalysis.cases.values.expressions import is_expression, parse, unknown_name
from eppanalysis.cases.words import KIND
from eppanalysis.errors import (
    AlgebraicLoop,
    CaseError,
    DrivenTwice,
    EppError,
    IdleInput,
    OpenInput,
    UnknownName,
    did_you_mean,
)
from eppanalysis.models.diagrams.wiring import NAME, NOTHING, port_names
from eppanalysis.readable import listed
from eppanalysis.units import QuantityError

#: A file with more mistakes than these is something else.
_MOST = 200
#: Sections of things with names, and values for what a file cannot be without.
_NAMED = ("parameters", "blocks", "elements", "inputs", "signals")
_OF_PARTS = ("blocks", "elements")
_STAND_INS: Mapping[str, Any] = {"title": "-"}


class Mistakes(NamedTuple):
    """Mistakes of a file, each in one sentence, and what was not seen: uses of names, units and loops through parts."""

    found: tuple[CaseError, ...]
    not_seen: tuple[str, ...]
    not_through: tuple[str, ...] = ()


def mistakes_in(path: str | Path) -> Mistakes:
    """The mistakes of a case file; none where it is valid.

    Raises
    ------
    CaseError
        If it cannot be read as TOML.
    """
    raw = read_raw(Path(path), str(path))
    reading = _Reading(raw, raw)
    for _ in range(_MOST):
        try:
            load(reading.left)
            break
        except CaseError as error:
            if not reading.goes_on(error):
                break
    return Mistakes(tuple(reading.found), tuple(reading.missed), tuple(reading.stood_in))


def sentences_of(text: str, first: EppError) -> list[str]:
    """The mistakes of a case file, a sentence each, of which the first is known; that alone where it is none of it."""
    if not (os.path.isfile(text) and isinstance(first, CaseError) and first.field):
        return [str(first)]
    try:
        found, not_seen, not_through = mistakes_in(text)
    except CaseError as error:  # a base that is not there: nothing more is known of the file
        return [str(error)]
    sentences = [str(error) for error in found]
    if str(first) not in sentences:
        sentences.append(str(first))
    unseen = [f"uses of {listed(not_seen)}"] if not_seen else []
    unseen += [f"units and algebraic loops through {listed(not_through)}"] if not_through else []
    if unseen:
        sentences.append(f"{text}: not checked before that is mended: {'; '.join(unseen)}.")
    return sentences


@dataclass
class _Reading:
    """A file under way; lives for one call."""

    #: whole, left: the file, and what has not been taken out of it.
    whole: RawCase
    left: RawCase
    found: list[CaseError] = field(default_factory=list)
    #: gone, absent: names, and fields, that have been taken out; fields that are missing.
    gone: set[str] = field(default_factory=set)
    absent: set[str] = field(default_factory=set)
    #: missed, stood_in: names among them that were used elsewhere; parts that another one replaces.
    missed: dict[str, None] = field(default_factory=dict)
    stood_in: dict[str, None] = field(default_factory=dict)
    cut: dict[str, list[int]] = field(default_factory=dict)  # places of the entries of lists that have been
    fed: set[str] = field(default_factory=set)  # names in connections that have been

    def goes_on(self, error: CaseError) -> bool:
        """Note what is wrong and take it out; whether there was anything to be taken out."""
        together = (error, *error.also, *self._also_unknown(error))
        for one in together:
            said = with_declaration(self.whole.as_called(self._as_written(one)), self.whole)
            if not self._follows(one) and str(said) not in map(str, self.found):
                self.found.append(said)
            if isinstance(one.value, Missing):
                self.absent.add(one.field)
        return self._take_out(next((one for one in together if not isinstance(one.value, Missing)), error))

    def _also_unknown(self, error: CaseError) -> list[CaseError]:
        """Further names in an expression that are not known."""
        known, text = self.left.data.get("parameters", {}), error.value
        in_numbers = error.field.startswith(("parameters", "inputs", *_OF_PARTS)) and is_expression(text)
        if not (isinstance(error.fault, UnknownName) and in_numbers):
            return []
        try:
            others = {*parse(text).names} - {*known, error.fault.name} - self.gone
        except QuantityError:  # a function that is not known
            return []
        said = [unknown_name(name, known) for name in sorted(others)]
        return [CaseError(error.source, error.field, text, one.expected, one.fault) for one in said]

    def _follows(self, error: CaseError) -> bool:
        """Whether a mistake is there only because of what was taken out."""
        match error.fault:
            case UnknownName(name) if name.partition(".")[0] in self.gone:
                self.missed[name.partition(".")[0]] = None
                return True
            case UnknownName(name) if error.field == f"run.inputs.{name}" and name in self.fed:
                return True
            case OpenInput(name) | IdleInput(name):
                return any(_meant(other, name.partition(".")[0]) for other in self.fed)
            case None if error.field == "connect" and isinstance(error.value, Connections) and (self.gone or self.fed):
                # What is left of a drawing need not make a loop.
                return True
        part = _part(error.field)
        if part.startswith("loop.") and f"{part}.kind" in self.gone:
            self.missed[part.replace(".", " ")] = None  # of no known kind: none of its other fields is wrong
            return True
        if isinstance(error.value, Missing) and error.field not in self.absent and _part(error.field) in self.gone:
            part, _, name = error.field.rpartition(".")
            return any(_meant(at.rpartition(".")[2], name) for at in self.gone if at.rpartition(".")[0] == part)
        of_gone = error.field == "run.input" and any(at.startswith("inputs.") for at in self.gone)
        of_gone |= error.field == "expected.signal" and str(error.value) in self.gone
        return of_gone or error.field in self.gone | self.absent

    def _as_written(self, error: CaseError) -> CaseError:
        """The same with the place in the file's list, and what the file has there."""
        section, _, place = error.field.partition(".")
        if section == "signals" and isinstance(error.value, str):
            return CaseError(error.source, error.field, self.whole.typed(error.field), error.expected, error.fault)
        if section not in ("connect", "margins_at") or not place.isdigit():
            return error
        number = self._number(section, int(place))
        expected, lines = error.expected, self.whole.data[section]
        for i, text in enumerate(self.left.data[section]):
            whole = lines[self._number(section, i)] if i + len(self.cut.get(section, [])) < len(lines) else text
            expected = expected.replace(f"{text!r} does", f"{whole!r} does")
        return CaseError(error.source, f"{section}.{number}", lines[number], expected, error.fault)

    def _number(self, section: str, place: int) -> int:
        """Where an entry of a list is in the file: each that was taken out before it has moved it up."""
        for taken in sorted(self.cut.get(section, [])):
            place += taken <= place
        return place

    def _take_out(self, error: CaseError) -> bool:
        """Take out what is wrong; whether there was anything to be taken out."""
        data, at = copy.deepcopy(self.left.data), error.field
        self.left = replace(self.left, data=data)
        match error.fault:
            case OpenInput(port):
                # A source without a name, so that the rest of the diagram can be read.
                data["connect"].append(f"{NOTHING} -> {port}")
                return True
            case AlgebraicLoop(parts):
                places = (place for place in _OF_PARTS if parts[0] in data.get(place, {}))
                at = ".".join((*places, parts[0]))
            case UnknownName(name) | DrivenTwice(name) if self._shortened(data, at, name, error.fault):
                return True
        if at == "kind" and at not in self.gone:
            self.gone.add(at)
            data["kind"] = "diagram" if "connect" in data else "loop"
            return "connect" in data or "loop" in data
        path = at.split(".")
        if at in _STAND_INS:
            changed = data.get(at) != _STAND_INS[at]
            data[at] = _STAND_INS[at]
            return changed
        if isinstance(error.value, Missing):
            path = _part(at).split(".")
        return self._replaced(data, path) or self._remove(data, path)

    def _shortened(self, data: dict[str, Any], at: str, name: str, fault: object) -> bool:
        """Take a name out of a connection or a sum, so that its others are seen; whether anything is left of that."""
        *path, last = at.split(".")
        if path[:1] not in (["connect"], ["signals"]):
            return False
        holder: Any = data
        for key in path:
            holder = holder[key]
        own: Any = int(last) if isinstance(holder, list) else last
        if not isinstance(holder[own], str):
            return False
        left, arrow, right = (text.strip() for text in holder[own].partition("->"))
        one = rf"(?<![\w.]){re.escape(name)}(\.\w+)?(?![\w.])"
        shorter = left if isinstance(fault, DrivenTwice) else re.sub(rf"[+-]?\s*{one}", "", left, count=1).strip()
        if shorter == left:
            right = ", ".join(end.strip() for end in right.split(",") if not re.fullmatch(rf"\s*{one}\s*", end))
        if arrow and right:
            self.fed.add(name.partition(".")[0])
            holder[own] = f"{shorter or NOTHING} -> {right}"
        elif not arrow and shorter:
            holder[own] = shorter
        return bool(right if arrow else shorter)

    def _replaced(self, data: dict[str, Any], path: list[str]) -> bool:
        """Put another part in place of one that cannot be made: a block with its ports; whether these are known."""
        *places, name = path
        if places not in (["blocks"], ["elements"], ["loop", "elements"], ["loop", "blocks"]):
            return False
        holder: Any = data
        for key in places:
            holder = holder[key]
        own: Any = int(name) if isinstance(holder, list) else name
        table, called = holder[own], f"{' '.join(places)} {name}" if isinstance(holder, list) else name
        if not (isinstance(holder, list) or NAME.fullmatch(name)):
            return False  # no other part could have that name either
        kind = str(table.get("kind")) if isinstance(table, dict) else ""
        found = None if called in self.stood_in else example(kind)
        if found is None:
            return False
        self.gone |= {f"{'.'.join(path)}.{field}" for field in table}
        self.stood_in[called] = None
        fields, part = found
        if isinstance(holder, list):
            holder[own] = {"kind": kind, **fields}
            return True
        before, behind = port_names(part)
        del holder[own]
        data.setdefault("blocks", {})[name] = {
            "kind": "state_space",
            "A": [[-1.0]],
            "B": [[1.0] * len(before)],
            "C": [[1.0]] * len(behind),
            "input_names": [*before],
            "output_names": [*behind],
        }
        return True

    def _remove(self, data: dict[str, Any], path: list[str]) -> bool:
        """Take out the field at a path, or the list of numbers that it is in."""
        if path[0] in ("connect", "margins_at") and len(path) == 2:
            written = self._as_written(CaseError("", ".".join(path), "", "")).field
            self.cut.setdefault(path[0], []).append(int(written.partition(".")[2]))
            taken = data[path[0]].pop(int(path[1]))
            self.fed |= set(NAME.findall(str(taken))) if path[0] == "connect" else set()
            return True
        here: Any = data
        for i, key in enumerate(path):
            inner = here[int(key)] if isinstance(here, list) else here.get(key)
            if i == len(path) - 1 or not isinstance(inner, dict | list) or _is_plain(inner):
                return self._gone_from(here, path[: i + 1])
            here = inner
        return False

    def _gone_from(self, holder: Any, path: list[str]) -> bool:
        if not isinstance(holder, dict) or path[-1] not in holder:
            return False
        taken = holder.pop(path[-1])
        number = left_out(str(holder.get(KIND)), path[-1]) if path[0] in _OF_PARTS and len(path) == 3 else None
        if number is not None and taken != number:
            holder[path[-1]] = number  # a gain that is left out makes no other unit, one that is a plain number may
        self.gone |= {".".join(path), _part(".".join(path))}
        if path[0] in _NAMED and len(path) == 2:
            self.gone.add(path[1])
        elif path[0] in _NAMED and len(path) == 1:
            self.gone |= set(NAME.findall(str(taken)))
        return True


def _part(at: str) -> str:
    """The part, or the other table of a section, that a field belongs to."""
    path = at.split(".")
    return ".".join(path[: 3 if path[0] == "loop" and path[2:3] and path[2].isdigit() else 2])


def _meant(name: str, known: str) -> bool:
    """Whether a name is, or is likely to be a mistake for, another one."""
    return name == known or did_you_mean(name, [known]).startswith("did you mean")


def _is_plain(inner: Any) -> bool:
    """Whether a list holds numbers or texts, and no tables."""
    return isinstance(inner, list) and not any(isinstance(v, dict) for v in inner)
