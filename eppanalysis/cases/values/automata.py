"""Elements of one's own in a case file: the modes, guards, resets and outputs of an automaton as tables, and back.

The fields are those of `Mode`, `Guard`, `Smooth` and `OwnStates` by their names. What is left out is zero, and a guard
without a reset keeps the memory values. Numbers are plain or have units; nothing is executed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases.files import Missing, RawCase
from eppanalysis.cases.values.parameters import read_scalar
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.errors import CaseError, ModelError, did_you_mean
from eppanalysis.models.elements.automaton import SMOOTH_KINDS, Automaton, AutomatonBuilder, Guard, Mode, Smooth
from eppanalysis.models.elements.base import IN, OUT, SLOPE, OwnStates, Role
from eppanalysis.models.elements.own import AutomatonElement, ModeMemory

Shape = tuple[int, ...]

#: What a case file calls an element that is given by its automaton.
AUTOMATON = AutomatonElement.kind
#: Modes to which a guard may lead besides its target.
_AWAY = ("bypass", "on_threshold")
#: Most inputs, outputs and memory values.
_MOST = 50
#: Shapes of numbers by letters: inputs z, outputs w, memory values h, smooth functions s; a number alone has none.
_MODE = {"from_input": "wz", "from_memory": "wh", "from_smooth": "ws", "constant": "w", "level": "", "jump": ""}
_RESET = {"memory_from_input": "hz", "memory_from_memory": "hh", "memory_constant": "h"}
_GUARD = {"on_input": "z", "on_rate": "z", "on_memory": "h", "on_output": "w", "constant": "", **_RESET, "impulse": "z"}
_SMOOTH = {"on_input": "z", "constant": "", "scale": "", "on_smooth": "s"}
_LETTERS = {"z": "n_inputs", "w": "n_outputs", "h": "start_memory", "s": "smooth"}
_FIELDS = ("n_inputs", "n_outputs", "start_mode", "start_memory", "modes", "guards", "smooth", "own_states")
_OF_OWN_STATES = tuple(f.name for f in fields(OwnStates))
#: Fields that hold numbers, or lists of them, at any depth of the tables.
NUMBERS = frozenset(
    {"start_memory", "memory", "reached", *_MODE, *_GUARD, *_SMOOTH}
    | {name for name in _OF_OWN_STATES if not name.startswith("n_")}
)


class OwnElement(NamedTuple):
    """What a table says: the arguments of `AutomatonElement`, its numbers by their dotted names, and what these are."""

    arguments: dict[str, Any]
    parameters: dict[str, Parameter]
    units: dict[str, Role]


def read_automaton(table: Mapping[str, Any], place: str, raw: RawCase) -> OwnElement:
    """The automaton that a table of a case file holds.

    Parameters
    ----------
    table : mapping of str to object
        Without what all elements have (`kind`, `name`, `memory`).
    place : str
        Dotted name of the table.

    Raises
    ------
    CaseError
        At the first field that is not known, names a mode that is not there, or has another shape than it must.
    """
    _require_known(table, _FIELDS, place, raw)
    reader = _Reader.of(table, place, raw)
    names = reader.modes(table.get("modes", Missing()))
    build = AutomatonBuilder(reader.sizes["z"], reader.sizes["w"], reader.sizes["h"], reader.smooth(table))
    for name in names:
        build.mode(name, **reader.mode(name, table["modes"][name]))
    for i, guard in enumerate(reader.tables(table, "guards")):
        build.guard(**reader.guard(i, guard, names))
    # Tables have no order that every writer keeps.
    alone = names[0] if len(names) == 1 else Missing()
    start = reader.named(table.get("start_mode", alone), "start_mode", names)
    rules = build.build(start, reader.memory)
    return OwnElement({"rules": rules, "own_states": reader.own_states(table)}, reader.parameters, reader.units)


def read_memory(given: Any, rules: Automaton, place: str, raw: RawCase) -> ModeMemory:
    """What such an element remembers at the start: a table of its mode, its memory values and the input reached.

    Raises
    ------
    CaseError
        If it is no such table.
    """
    if not isinstance(given, Mapping):
        raise raw.refused(place, "a table of mode, memory and reached, as in { mode = 'free', reached = 0.0 }")
    _require_known(given, ("mode", "memory", "reached"), place, raw)
    reader = _Reader(place, raw, {"h": rules.n_memory})
    mode = reader.named(given.get("mode", Missing()), "mode", [m.name for m in rules.modes])
    memory = reader.numbers(given, "", {"memory": "h"}).get("memory", np.zeros(rules.n_memory))
    reached = reader.numbers(given, "", {"reached": ""}).get("reached", 0.0)
    return ModeMemory(mode, tuple(np.atleast_1d(memory).tolist()), float(reached))


@dataclass(frozen=True)
class _Reader:
    """Reads the tables of one element; `sizes` of its vectors by their letters, `parameters` and `units` grow."""

    place: str
    raw: RawCase
    sizes: dict[str, int]
    memory: Array = field(default_factory=lambda: np.zeros(0))
    parameters: dict[str, Parameter] = field(default_factory=dict)
    units: dict[str, Role] = field(default_factory=dict)

    @classmethod
    def of(cls, table: Mapping[str, Any], place: str, raw: RawCase) -> _Reader:
        """With the sizes that a table says."""
        sizes = {}
        for letter, name in (("z", "n_inputs"), ("w", "n_outputs")):
            count = table.get(name, 1)
            if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MOST:
                raise raw.refused(f"{place}.{name}", f"a whole number from 1 to {_MOST}")
            sizes[letter] = count
        memory = table.get("start_memory", [])
        if not isinstance(memory, list) or len(memory) > _MOST:
            raise raw.refused(f"{place}.start_memory", f"a list of at most {_MOST} numbers")
        start = [float(read_scalar(v, f"{place}.start_memory.{i}", raw).value) for i, v in enumerate(memory)]
        smooth = table.get("smooth", [])
        sizes |= {"h": len(start), "s": len(smooth) if isinstance(smooth, list) else 0}
        return cls(place, raw, sizes, np.array(start))

    def tables(self, table: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
        """A list of tables."""
        found = table.get(name, [])
        if not isinstance(found, list) or not all(isinstance(part, Mapping) for part in found):
            raise self.raw.refused(f"{self.place}.{name}", "a list of tables")
        return found

    def modes(self, given: Any) -> list[str]:
        """Names of the modes in their order."""
        if not isinstance(given, Mapping) or not given or not all(isinstance(v, Mapping) for v in given.values()):
            raise self.raw.refused(f"{self.place}.modes", "a table of one or more modes, each a table by its name")
        for name in given:
            if "." in name or not 0 < len(name.strip()) <= 60:
                raise CaseError(self.raw.origin(f"{self.place}.modes"), f"{self.place}.modes", name, _NAME)
        return list(given)

    def mode(self, name: str, table: Mapping[str, Any]) -> dict[str, Any]:
        """Arguments of a mode."""
        here = f"modes.{name}"
        _require_known(table, (*_MODE, "sticking"), f"{self.place}.{here}", self.raw)
        sticking = table.get("sticking", False)
        if not isinstance(sticking, bool):
            raise self.raw.refused(f"{self.place}.{here}.sticking", "true or false")
        for part in ("level", "jump"):
            if part in table and not sticking:
                raise self.raw.refused(f"{self.place}.{here}.{part}", "nothing, as the mode does not stick")
        if self.sizes["z"] == self.sizes["w"] == 1:
            roles = {"from_input": SLOPE, "constant": OUT, "level": IN, "jump": OUT}
            self.units.update({f"{here}.{part}": role for part, role in roles.items()})
        return {"sticking": sticking, **self.numbers(table, here, _MODE)}

    def guard(self, i: int, table: Mapping[str, Any], modes: Sequence[str]) -> dict[str, Any]:
        """Arguments of a guard."""
        here = f"guards.{i}"
        _require_known(table, ("name", "mode", "target", *_AWAY, *_GUARD), f"{self.place}.{here}", self.raw)
        ends = {end: self.named(table.get(end, Missing()), f"{here}.{end}", modes) for end in ("mode", "target")}
        ends |= {end: self.named(table[end], f"{here}.{end}", modes) for end in _AWAY if end in table}
        name = table.get("name", f"goes to {table['target']}")
        if not isinstance(name, str) or len(name) > 60:
            raise self.raw.refused(f"{self.place}.{here}.name", "a text of at most 60 characters")
        found = self.numbers(table, here, _GUARD)
        self.units.update(self._units_of(here, found))
        return {"name": name, **ends, **found}

    def _units_of(self, here: str, found: Mapping[str, Any]) -> dict[str, Role]:
        """A threshold has the unit of the signal beside it, where the guard reads just that one, plainly."""
        if not self.sizes["z"] == self.sizes["w"] == 1:
            return {}
        read = [name for name in ("on_input", "on_rate", "on_memory", "on_output") if np.any(found.get(name, 0.0))]
        role = {"on_input": IN, "on_output": OUT}.get(read[0]) if len(read) == 1 else None
        if role is None or (given := self.parameters.get(f"{here}.{read[0]}")) is None or given.unit or given.friendly:
            return {}
        return {f"{here}.constant": role}

    def smooth(self, table: Mapping[str, Any]) -> tuple[Smooth, ...]:
        """The smooth functions."""
        found = []
        for i, part in enumerate(self.tables(table, "smooth")):
            here = f"smooth.{i}"
            _require_known(part, ("kind", *_SMOOTH), f"{self.place}.{here}", self.raw)
            kind = part.get("kind")
            if kind not in SMOOTH_KINDS:
                expected = f"a known function: {did_you_mean(str(kind)[:60], SMOOTH_KINDS)}"
                raise self.raw.refused(f"{self.place}.{here}.kind", expected)
            numbers = {"on_input": np.eye(1, self.sizes["z"])[0], **self.numbers(part, here, _SMOOTH)}
            weights = numbers.pop("on_smooth", np.zeros(0))
            if np.any(weights[i:]):
                raise self.raw.refused(f"{self.place}.{here}.on_smooth", "weights of the functions before it alone")
            found.append(Smooth(kind, **numbers, on_smooth=tuple(weights[:i].tolist())))
        return tuple(found)

    def own_states(self, table: Mapping[str, Any]) -> OwnStates | None:
        """The linear states that it brings."""
        given = table.get("own_states")
        if given is None:
            return None
        place = f"{self.place}.own_states"
        if not isinstance(given, Mapping):
            raise self.raw.refused(place, "a table of A, B, C and D")
        _require_known(given, _OF_OWN_STATES, place, self.raw)
        for name in "ABCD":
            if name not in given:
                raise self.raw.refused(f"{place}.{name}", "a matrix, as a list of rows")
        values = {
            name: value if name.startswith("n_") else self._nested(value, f"own_states.{name}")
            for name, value in given.items()
        }
        for name in ("n_before", "n_behind"):
            count = values.get(name, 1)
            if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MOST:
                raise self.raw.refused(f"{place}.{name}", f"a whole number from 1 to {_MOST}")
        try:
            return OwnStates(**values)
        except ModelError as error:
            raise self.raw.refused_by_model(error, place) from None

    def named(self, given: Any, here: str, modes: Sequence[str]) -> int:
        """Number of the mode that a field names."""
        if not isinstance(given, str) or given not in modes:
            place = f"{self.place}.{here}"
            expected = f"the name of a mode: {did_you_mean(str(given)[:60], modes)}"
            raise CaseError(self.raw.origin(place), place, given, expected)
        return modes.index(given)

    def numbers(self, table: Mapping[str, Any], here: str, shapes: Mapping[str, str]) -> dict[str, Any]:
        """The fields of a table that are numbers, as floats and arrays of their shapes."""
        found: dict[str, Any] = {}
        for name, letters in shapes.items():
            if name in table:
                path = f"{here}.{name}" if here else name
                found[name] = self._shaped(table[name], path, letters)
        return found

    def _shaped(self, given: Any, path: str, letters: str) -> Any:
        """Numbers of a shape; where that has one row or one column, a list of them will do, and of one a number."""
        shape = tuple(self.sizes[letter] for letter in letters)
        if 0 in shape:
            missing = next(_LETTERS[letter] for letter in letters if not self.sizes[letter])
            raise self.raw.refused(f"{self.place}.{path}", f"nothing, as the element has no {missing}")
        nested = self._nested(given, path)
        if not shape and isinstance(nested, float):
            return nested
        try:
            found = np.array(nested)
        except ValueError:  # rows of different lengths
            found = np.zeros(0)
        flat = found.ndim < len(shape) and found.size == math.prod(shape) == max(shape, default=1)
        if not shape or not (found.shape == shape or flat):
            raise self.raw.refused(f"{self.place}.{path}", _said(shape))
        return found.reshape(shape)

    def _nested(self, given: Any, path: str) -> Any:
        """Numbers in lists of any depth; one alone is a parameter of the case."""
        if isinstance(given, list):
            return [self._nested_in(v, f"{path}.{i}") for i, v in enumerate(given)]
        found = read_scalar(given, f"{self.place}.{path}", self.raw)
        self.parameters[path] = found
        return float(found.value)

    def _nested_in(self, given: Any, path: str) -> Any:
        if isinstance(given, list):
            return [self._nested_in(v, f"{path}.{i}") for i, v in enumerate(given)]
        return float(read_scalar(given, f"{self.place}.{path}", self.raw).value)


_NAME = "names of modes of 1 to 60 characters, without a dot"


def _said(shape: Shape) -> str:
    if math.prod(shape) == 1:
        return "a number"
    if len(shape) == 1 or 1 in shape:
        return f"a list of {max(shape)} numbers"
    return f"a list of {shape[0]} rows of {shape[1]} numbers"


def _require_known(table: Mapping[str, Any], known: Iterable[str], place: str, raw: RawCase) -> None:
    """Refuse the first field that is not known."""
    for key, value in table.items():
        if key not in known:
            expected = f"a field of an automaton: {did_you_mean(key, known)}"
            raise CaseError(raw.origin(f"{place}.{key}"), f"{place}.{key}", value, expected)


def automaton_table(element: AutomatonElement, who: str) -> dict[str, Any]:
    """The table of a case file that reads back to the same automaton, bit by bit.

    Raises
    ------
    ModelError
        If modes have no names, or the same, by which a file could call them.
    """
    rules = element.rules
    names = [mode.name for mode in rules.modes]
    for name in names:
        if names.count(name) > 1 or "." in name or not 0 < len(name.strip()) <= 60:
            raise ModelError(f"{who}: a mode is called {name!r}", expected=f"{_NAME}, that differ")
    table: dict[str, Any] = {"n_inputs": rules.n_inputs, "n_outputs": rules.n_outputs}
    table |= {"start_mode": names[rules.start_mode], "start_memory": rules.start_memory.tolist()}
    if rules.smooth:
        table["smooth"] = [
            {"kind": s.kind, "on_input": s.on_input.tolist(), "constant": float(s.constant), "scale": float(s.scale)}
            | ({"on_smooth": weights.tolist()} if np.any(weights) else {})
            for s, weights in zip(rules.smooth, rules.smooth_on_smooth, strict=True)
        ]
    table["modes"] = {mode.name: _mode_table(mode) for mode in rules.modes}
    table["guards"] = [_guard_table(guard, names) for guard in rules.guards]
    if (own := element.own_states) is not None:
        values = {name: getattr(own, name) for name in _OF_OWN_STATES}
        table["own_states"] = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}
    return table


def memory_table(memory: ModeMemory, rules: Automaton) -> dict[str, Any]:
    """What :func:`read_memory` reads."""
    mode, values, reached = memory
    return {
        "mode": rules.modes[int(mode)].name,
        "memory": [float(v) for v in values],
        "reached": float(reached),
    }


def _mode_table(mode: Mode) -> dict[str, Any]:
    table: dict[str, Any] = _numbers(mode, {name: shape for name, shape in _MODE.items() if name != "jump"})
    if mode.sticking:
        table["sticking"] = True
    if mode.jump != 1.0:
        table["jump"] = float(mode.jump)
    return table


def _guard_table(guard: Guard, names: Sequence[str]) -> dict[str, Any]:
    table: dict[str, Any] = {"name": guard.name, "mode": names[guard.mode], "target": names[guard.target]}
    table |= {end: names[getattr(guard, end)] for end in _AWAY if getattr(guard, end) >= 0}
    table |= _numbers(guard, {name: shape for name, shape in _GUARD.items() if name not in _RESET})
    reset = _numbers(guard, _RESET)
    kept = _same(guard.memory_from_memory, np.eye(guard.memory_constant.size))
    if kept and set(reset) <= {"memory_from_memory"}:
        return table
    return table | (reset or {"memory_constant": guard.memory_constant.tolist()})


def _numbers(part: Mode | Guard, shapes: Mapping[str, str]) -> dict[str, Any]:
    """The fields that may not be left out: those that are not zeros without a sign."""
    given = {name: np.asarray(getattr(part, name), float) for name in shapes}
    return {name: value.tolist() for name, value in given.items() if not _same(value, np.zeros(value.shape))}


def _same(one: Array, other: Array) -> bool:
    return np.array_equal(one, other) and np.array_equal(np.signbit(one), np.signbit(other))
