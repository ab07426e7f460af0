"""All mistakes of a case file at once: what is wrong is taken out, and what is left is looked at again.

A name that is taken out is missed elsewhere, and what a connection drove is left open: what follows from that is no
mistake of the file. What stands behind it in the same field or connection is then not seen, and the names are told.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from eppanalysis.cases.files import Connections, Missing, RawCase, read_raw
from eppanalysis.cases.model import load
from eppanalysis.errors import AlgebraicLoop, CaseError, EppError, IdleInput, OpenInput, UnknownName, did_you_mean
from eppanalysis.models.diagrams.wiring import NAME, NOTHING
from eppanalysis.readable import listed

#: A file with more mistakes than these is something else.
_MOST = 200
#: Sections of things with names, and what stands in for what a file cannot be without.
_NAMED = ("parameters", "blocks", "elements", "inputs", "signals")
_STAND_INS: Mapping[str, Any] = {"title": "-", "run": {"t_end": "1 s"}, "run.t_end": "1 s"}


class Mistakes(NamedTuple):
    """Mistakes of a file, each in one sentence, and the wrong names, the rest or use of which was not seen."""

    found: tuple[CaseError, ...]
    not_seen: tuple[str, ...]


def mistakes_in(path: str | Path) -> Mistakes:
    """The mistakes of a case file; none where it is valid.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    CaseError
        If it cannot be read as TOML.
    """
    reading = _Reading(read_raw(Path(path), str(path)))
    for _ in range(_MOST):
        try:
            load(reading.left)
            break
        except CaseError as error:
            if not reading.follows(error):
                reading.found.append(reading.as_written(error))
            if not reading.take_out(error):
                break
    return Mistakes(tuple(reading.found), tuple(reading.missed))


def sentences_of(text: str, first: EppError) -> list[str]:
    """The mistakes of a case file, a sentence each, of which the first is known; that alone where it is none of it."""
    if not (os.path.isfile(text) and isinstance(first, CaseError) and first.field):
        return [str(first)]
    found, not_seen = mistakes_in(text)
    sentences = [str(error) for error in found]
    if str(first) not in sentences:
        sentences.append(str(first))
    if not_seen:
        unseen = f"the rest of {listed(not_seen)}, and what uses it,"
        sentences.append(f"{text}: {unseen} was not looked at; check again when that is mended.")
    return sentences


@dataclass
class _Reading:
    """A file under way; lives for one call.

    Attributes
    ----------
    left : RawCase
        What has not been taken out.
    found : list of CaseError
    gone : set of str
        Names, and fields, that have been taken out.
    missed : dict of str to None
        Names among them that were used elsewhere, or of parts that were not read to their end.
    cut : list of int
        Places of the connections that have been.
    fed : set of str
        Names in these connections.
    """

    left: RawCase
    found: list[CaseError] = field(default_factory=list)
    gone: set[str] = field(default_factory=set)
    missed: dict[str, None] = field(default_factory=dict)
    cut: list[int] = field(default_factory=list)
    fed: set[str] = field(default_factory=set)

    def follows(self, error: CaseError) -> bool:
        """Whether a mistake is there only because of what was taken out."""
        match error.fault:
            case UnknownName(name) if name in self.gone:
                self.missed[name] = None
                return True
            case OpenInput(port) if port.partition(".")[0] in self.fed:
                return True
            case IdleInput(name) if name in self.fed:
                return True
            case None if error.field == "connect" and isinstance(error.value, Connections) and self.gone:
                # What is left of a drawing need not make a loop.
                return True
        if isinstance(error.value, Missing) and _part(error.field) in self.gone:
            return self._was_meant(error.field)
        return error.field in self.gone

    def _was_meant(self, missing: str) -> bool:
        """Whether a missing field, or what was meant to be it, has been taken out; the rest of its part is unseen."""
        part, _, name = missing.rpartition(".")
        if part not in self.gone:
            return True
        taken = [at.rpartition(".")[2] for at in self.gone if at.rpartition(".")[0] == part]
        if part.partition(".")[0] in ("blocks", "elements"):
            self.missed[part.partition(".")[2]] = None
        return name in taken or any(did_you_mean(other, [name]).startswith("did you mean") for other in taken)

    def as_written(self, error: CaseError) -> CaseError:
        """The same with the connection's number in the file."""
        section, _, place = error.field.partition(".")
        if section != "connect" or not place.isdigit():
            return error
        number = int(place)
        # Each connection that was taken out before this one has moved it up.
        for taken in sorted(self.cut):
            number += taken <= number
        return CaseError(error.source, f"{section}.{number}", error.value, error.expected, error.fault)

    def take_out(self, error: CaseError) -> bool:
        """Take out what is wrong; whether there was anything to be taken out."""
        data, at = copy.deepcopy(self.left.data), error.field
        self.left = replace(self.left, data=data)
        match error.fault:
            case OpenInput(port):
                # A source that stands for nothing, so that the rest of the diagram can be read.
                data["connect"].append(f"{NOTHING} -> {port}")
                return True
            case AlgebraicLoop(parts):
                places = (place for place in ("blocks", "elements") if parts[0] in data.get(place, {}))
                at = ".".join((*places, parts[0]))
        if at == "kind" and at not in self.gone:
            self.gone.add(at)
            data["kind"] = "diagram" if "connect" in data else "loop"
            return "connect" in data or "loop" in data
        path = at.split(".")
        if at in _STAND_INS and (len(path) == 1 or isinstance(data.get(path[0]), dict)):
            holder = data if len(path) == 1 else data[path[0]]
            changed = holder.get(path[-1]) != _STAND_INS[at]
            holder[path[-1]] = _STAND_INS[at]
            return changed
        if isinstance(error.value, Missing):
            path = _part(at).split(".")
        return self._remove(data, path)

    def _remove(self, data: dict[str, Any], path: list[str]) -> bool:
        """Take out the field at a path, or the list of numbers that it stands in."""
        if path[0] == "connect" and len(path) == 2:
            self.cut.append(int(self.as_written(CaseError("", ".".join(path), "", "")).field.partition(".")[2]))
            self.fed |= set(NAME.findall(str(data["connect"].pop(int(path[1])))))
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
        self.gone |= {".".join(path), _part(".".join(path))}
        if path[0] in _NAMED and len(path) == 2:
            self.gone.add(path[1])
        elif path[0] in _NAMED and len(path) == 1:
            self.gone |= set(NAME.findall(str(taken)))
        return True


def _part(at: str) -> str:
    """The part, or the other table of a section, that a field belongs to."""
    return ".".join(at.split(".")[:2])


def _is_plain(inner: Any) -> bool:
    """Whether a list holds numbers or texts, and no tables."""
    return isinstance(inner, list) and not any(isinstance(v, dict) for v in inner)
