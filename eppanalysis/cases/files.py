"""Case files on disk: reading TOML, following `base`, merging, and the cases that ship."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from eppanalysis.cases.values.expressions import is_expression, parse
from eppanalysis.cases.words import in_our_words
from eppanalysis.errors import CaseError, Missing, ModelError, visible
from eppanalysis.models.devices.elbow.parameters import Bands
from eppanalysis.readable import listed
from eppanalysis.units import QuantityError

LARGEST_FILE = 1_000_000
DEEPEST = 12
LONGEST_CHAIN = 16
#: Names of cases: nothing that leads out of a folder.
PLAIN_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
#: Names of signals, inputs and elements of a loop, as python-control and block diagrams elsewhere give them too
#: ("sys[0]$copy_u[0]", "Motor/Speed ref"), and what is said of others.
LABEL = r"^[^\W\d][\w$]*(\[[0-9]+\][\w$]*)*([ /-][\w$]+(\[[0-9]+\][\w$]*)*)*$"
LABEL_IS = "a name of letters, digits, underscores and $, of indices such as [0], with single spaces, - or / between"

#: Fields of a section that replace one another: giving one of a group drops the inherited other group.
ALTERNATIVES: tuple[tuple[str, frozenset[str], frozenset[str]], ...] = (
    ("bands", frozenset(Bands.WIDTHS), frozenset(Bands.THRESHOLDS)),
    ("forearm", frozenset({"inertia"}), frozenset({"prehensor_mass"})),
    ("forearm", frozenset({"gravity_moment"}), frozenset({"upright"})),
    ("loop", frozenset({"num", "den"}), frozenset({"A", "B", "C", "D"})),
)

#: Names of several shipped cases: the experiments of the paper, in the order of the model's truth table.
GROUPS: dict[str, tuple[str, ...]] = {
    "truth-table": (
        "fig8a_original",
        "fig8b_reduced_backlash",
        "gain_brings_it_back",
        "fig6a_original_pulley",
        "fig6b_ball_bearing",
        "soft_cable",
        "light_forearm",
        "upright",
    )
}

#: What a case inherits of its base's expectations: which signal they are of and where they come from, not the answers.
_KEPT_EXPECTATIONS = ("signal", "source")

#: Fields of models that files call otherwise.
_IN_FILES = {
    "x0": "initial_state",
    "B_input": "input_matrix",
    "D_input": "input_feedthrough",
    "frequency_hz": "frequency",
}


class Connections:
    """What a message shows for all connections of a diagram."""

    def __repr__(self) -> str:
        return "a list of connections"


@dataclass(frozen=True)
class RawCase:
    """A case file with its bases merged in, not yet validated."""

    #: name, source: stem of the file, and its path as the user gave it.
    name: str
    source: str
    folder: Path  # where files that the case names are looked for
    data: dict[str, Any]  # plain TOML values
    #: File (or other source) that each dotted field was last set by.
    origins: dict[str, str] = field(default_factory=dict)
    #: What the file calls the fields that it calls otherwise than we do, by their dotted names.
    called: dict[str, str] = field(default_factory=dict)

    def in_our_words(self) -> RawCase:
        """The same with one word for one thing (:mod:`eppanalysis.cases.words`).

        Raises
        ------
        CaseError
            If one thing is said in two words.
        """
        data, called = in_our_words(self.data, {}, self.source)
        return self if data is self.data else replace(self, data=data, called={**self.called, **called})

    def as_called(self, error: CaseError) -> CaseError:
        """A refusal with its field as the file calls it."""
        also = tuple(self.as_called(other) for other in error.also)
        field = self.called.get(error.field, error.field)
        return CaseError(error.source, field, error.value, error.expected, error.fault, also)

    def origin(self, dotted: str) -> str:
        """Source of a field, or of the nearest part of it that is known."""
        while dotted:
            if dotted in self.origins:
                return self.origins[dotted]
            dotted = dotted.rpartition(".")[0]
        return self.source

    def typed(self, dotted: str) -> Any:
        """What the user wrote in a field, with its unit; :class:`Missing` where it is not there."""
        here: Any = self.data
        for part in dotted.split("."):
            if isinstance(here, list) and part.isdigit() and int(part) < len(here):
                here = here[int(part)]
            elif isinstance(here, dict) and part in here:
                here = here[part]
            else:
                return Missing()
        return here["value"] if _is_parameter(here) else here

    def refused(self, field: str, expected: str) -> CaseError:
        """The error that a field does not hold what was expected, with its place and what the user wrote there."""
        return CaseError(self.origin(field), field, self.typed(field), expected)

    def refused_by_model(self, error: ModelError, section: str) -> CaseError:
        """A model's refusal as that of the section that it was made from: the field as the file calls it, as typed.

        What is said of a field that the file has not is said of the section.
        """
        field = _IN_FILES.get(error.field, error.field)
        place = f"{section}.{field}" if section else field
        absent = isinstance(self.typed(place), Missing)
        if error.field and error.expected and (not absent or error.value is None):
            return self.refused(place, error.wanted(lambda name, value: self.typed_or(f"{section}.{name}", value)))
        wanted = f"{error.wanted()} ({error.found})" if error.expected else f"a valid model ({error.found})"
        return self.refused(section, wanted)

    def blamed(self, error: CaseError, latest: str) -> CaseError:
        """A refusal of an expression as that of the parameter behind it that the latest source has set.

        Who sets `--set ratio=0`, or inherits from a base, has not written the field in which the ratio is refused.
        """
        text, written = error.value, self.origin(error.field)
        if error.source != written or written == latest or not is_expression(text):
            return error
        behind = [name for name in self._behind(str(text)) if self.origin(f"parameters.{name}") == latest]
        if not behind:
            return error
        if len(behind) > 1:
            expected = f"{error.expected}, with {listed(behind)} of {latest}"
            return CaseError(error.source, error.field, text, expected, error.fault, error.also)
        wanted, colon, found = error.expected.partition(f": {text} is ")
        if text != behind[0]:
            wanted = f"a value with which {error.field} is {wanted}{colon}{found}"
        place = f"parameters.{behind[0]}"
        return CaseError(latest, place, self.typed(place), wanted, error.fault, error.also)

    def _behind(self, text: str) -> list[str]:
        """The parameters that an expression hangs on, those that it names first."""
        names: dict[str, None] = {}
        found = [text]
        for expression in found:
            try:
                new = [name for name in parse(expression).names if name not in names]
            except QuantityError:  # none after all, which is refused in its own place
                continue
            names |= dict.fromkeys(new)
            texts = (self.typed(f"parameters.{name}") for name in new)
            found += [str(typed) for typed in texts if is_expression(typed)]
        return list(names)

    def typed_or(self, dotted: str, value: object) -> object:
        """What the user wrote in a field, or a value in its place where it is not there."""
        found = self.typed(dotted)
        return value if isinstance(found, Missing) else found


def own_or_shipped(path: Path) -> Path:
    """The file of measured data, or where there is none the one of that name that ships as an example."""
    if path.exists() or path.name != str(path):
        return path
    shipped = shipped_cases_folder() / "measured" / path.name
    return shipped if shipped.is_file() else path


@cache
def shipped_cases_folder() -> Path:
    """Folder of the cases that ship: inside the installed package, or beside it in the repository.

    Raises
    ------
    CaseError
        If neither is there.
    """
    package = Path(__file__).parents[1]
    inside, beside = package / "cases" / "shipped", package.parent / "cases"
    for folder in (inside, beside):
        if folder.is_dir():
            return folder
    raise CaseError("shipped cases", "", str(inside), "a folder with the cases that ship; reinstall the package")


def shipped_cases() -> tuple[str, ...]:
    """Names of the cases that ship, in alphabetical order.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import eppanalysis as epp
    >>> epp.shipped_cases()[:2]
    ('actuator_both_limits', 'azimuth_servo')
    """
    return tuple(sorted(name[: -len(".toml")] for name in os.listdir(shipped_cases_folder()) if name.endswith(".toml")))


def read_raw(path: Path, source: str) -> RawCase:
    """Read a case file and the bases that it inherits from.

    Raises
    ------
    CaseError
        If a file cannot be read, is empty or no TOML, or the chain of bases is broken or closes on itself.
    """
    return _follow(_read_toml(path, source), path, source)


def parse_raw(text: str, name: str, folder: Path) -> RawCase:
    """The case that a text holds, as if it were in a file of that name in `folder`.

    Raises
    ------
    CaseError
        As :func:`read_raw`.
    """
    if len(text) > LARGEST_FILE:
        raise CaseError(name, "", f"{len(text)} characters long", f"at most {LARGEST_FILE}")
    return _follow(_checked(text, name), folder / f"{name}.toml", name)


def _follow(data: dict[str, Any], path: Path, source: str) -> RawCase:
    """A case with its bases merged in."""
    chain: list[tuple[str, dict[str, Any]]] = []
    seen: set[Path] = set()
    name, here, label = visible(path.stem), path, source
    while True:
        seen.add(here.resolve())
        base = data.pop("base", None)
        chain.append((label, data))
        if base is None:
            break
        following = _find_base(base, here, label)
        if following.resolve() in seen:
            raise CaseError(label, "base", base, "a case that does not inherit from itself")
        if len(chain) >= LONGEST_CHAIN:
            raise CaseError(label, "base", base, f"at most {LONGEST_CHAIN - 1} bases one behind the other")
        here, label = following, str(Path(label).with_name(following.name))
        data = _read_toml(here, label)
    merged: dict[str, Any] = {}
    origins: dict[str, str] = {}
    called: dict[str, str] = {}
    for label, given in reversed(chain):
        data, others = in_our_words(given, merged, label)
        called |= others
        merged = merge(without_answers(merged), data)
        # A list takes the place of the inherited one as a whole: where parts of that came from is no longer true.
        fields = list(_dotted(data))
        replaced = tuple(f"{name}." for name, value in fields if isinstance(value, list))
        origins = {name: place for name, place in origins.items() if not name.startswith(replaced)}
        origins.update(dict.fromkeys((name for name, _ in fields), label))
    return RawCase(name, source, path.parent, merged, origins, called)


def _read_toml(path: Path, source: str) -> dict[str, Any]:
    return _checked(_read_text(path, source), source)


def _checked(text: str, source: str) -> dict[str, Any]:
    data = _parse_toml(text, source)
    if not data:
        raise CaseError(source, "", "empty", "a case file with at least a title and a base or all sections")
    _check_depth(data, source)
    return data


def _read_text(path: Path, source: str) -> str:
    try:
        if not path.is_file():
            there = "a folder" if path.is_dir() else "not a file" if path.exists() else Missing()
            raise CaseError(source, "", there, "a case file")
        if path.stat().st_size > LARGEST_FILE:
            raise CaseError(source, "", f"{path.stat().st_size} bytes long", f"at most {LARGEST_FILE} bytes")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise CaseError(source, "", f"not UTF-8 at byte {error.start}", "a TOML file in UTF-8") from None
    except (OSError, ValueError) as error:
        raise CaseError(source, "", getattr(error, "strerror", None) or str(error), "a readable case file") from None
    # Letters of two or four bytes are valid UTF-8 with zeros between, which no text holds.
    if "\0" in text:
        raise CaseError(
            source, "", f"not UTF-8 text, as it has a zero at byte {text.encode().index(0)}", "a TOML file in UTF-8"
        )
    return text


def _parse_toml(text: str, source: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))  # the mark that some editors put before UTF-8
    except tomllib.TOMLDecodeError as error:
        raise CaseError(source, "", f"not TOML: {error}", "a TOML file") from None
    except RecursionError:
        raise CaseError(source, "", "nested too deeply", f"at most {DEEPEST} levels of tables and lists") from None
    except ValueError as error:
        # Python limits the digits of whole numbers.
        raise CaseError(source, "", f"not readable: {error}", "numbers of ordinary length") from None


def _check_depth(data: dict[str, Any], source: str) -> None:
    """Keep what follows (merging, messages) from running out of stack."""
    level: list[Any] = [data]
    for _ in range(DEEPEST):
        values = [v for item in level for v in (item.values() if isinstance(item, dict) else item)]
        level = [v for v in values if isinstance(v, (dict, list))]
        if not level:
            return
    raise CaseError(source, "", "nested too deeply", f"at most {DEEPEST} levels of tables and lists")


def _find_base(base: Any, child: Path, source: str) -> Path:
    """File of a base: another one in the child's own folder, or a case that ships."""
    if not isinstance(base, str) or not PLAIN_NAME.fullmatch(base):
        raise CaseError(source, "base", base, "the name of a case in the same folder, or of one that ships")
    file_name = base if base.endswith(".toml") else f"{base}.toml"
    there = [f for folder in (child.parent, shipped_cases_folder()) if (f := folder / file_name).is_file()]
    if not there:
        raise CaseError(source, "base", base, "the name of a case in the same folder, or of one that ships")
    # A file that bears the name of a case that ships means that one.
    found = next((f for f in there if f.resolve() != child.resolve()), child)
    # A case from elsewhere must not lead out of its folder by a link.
    if found.resolve().parent != found.parent.resolve():
        raise CaseError(source, "base", base, "a case that lies in the same folder, not a link out of it")
    return found


def _is_parameter(value: Any) -> bool:
    return isinstance(value, dict) and "value" in value


def without_answers(data: dict[str, Any]) -> dict[str, Any]:
    """A case without what it should give: answers belong to one set of values and do not outlive a change of them."""
    expected = data.get("expected")
    if not isinstance(expected, dict):
        return data
    return {**data, "expected": {k: v for k, v in expected.items() if k in _KEPT_EXPECTATIONS}}


def merge(base: dict[str, Any], child: dict[str, Any]) -> dict[str, Any]:
    """The child's values over the base's, section by section; alternatives that the child replaces are dropped.

    Lists and tables with a `value` replace; other tables merge.
    """
    out = dict(base)
    for key, value in child.items():
        inherited = out.get(key)
        if isinstance(value, dict) and isinstance(inherited, dict) and not _is_parameter(value):
            out[key] = merge(drop_alternatives(key, inherited, set(value)), value)
        elif isinstance(value, dict) and not _is_parameter(value) and isinstance(inherited, str | int | float):
            # A mark, a note or a tolerance alone leaves the inherited number as it is.
            out[key] = {"value": inherited, **value} if set(value) <= {"mark", "note", "tolerance"} else value
        else:
            out[key] = value
    return out


def drop_alternatives(section: str, inherited: dict[str, Any], given: set[str]) -> dict[str, Any]:
    """The inherited fields of a section without those that the given ones replace."""
    out = dict(inherited)
    for name, first, second in ALTERNATIVES:
        if name != section:
            continue
        for these, those in ((first, second), (second, first)):
            if given & these and not given & those:
                out = {k: v for k, v in out.items() if k not in those}
    return out


def _dotted(data: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """All fields of tables and of tables in lists, by their dotted names."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if isinstance(data, dict) or isinstance(value, dict):
            yield f"{prefix}{key}", value
        if isinstance(value, (dict, list)):
            yield from _dotted(value, f"{prefix}{key}.")


def put(data: dict[str, Any], path: list[str | int], value: Any, source: str, name: str) -> None:
    """Write a value at a dotted path into the tables of a file; those on the way, which others hold, are copied.

    Raises
    ------
    CaseError
        If there is no table that it could be in.
    """
    here: Any = data
    for part in path[:-1]:
        if isinstance(part, str) and isinstance(here, dict):
            here[part] = here = copy(here.get(part, {}))
        elif isinstance(here, list) and str(part).isdigit() and int(part) < len(here):
            here[int(part)] = here = copy(here[int(part)])
        else:
            break
    last = path[-1]
    if not isinstance(here, dict) or not isinstance(last, str) or not last:
        raise CaseError(source, name, value, "the dotted name of a field")
    old = here.get(last)
    if isinstance(value, dict) or not isinstance(old, dict):
        here[last] = value
        return
    # A source was the old value's: what is free to choose, and how far a part may be off, is so with another one, too.
    kept = {"mark": "tunable"} if old.get("mark") == "tunable" else {}
    if "tolerance" in old and not is_expression(value):
        kept["tolerance"] = old["tolerance"]
    here[last] = {"value": value, **kept} if kept else value
