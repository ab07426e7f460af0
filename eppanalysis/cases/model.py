"""The case: a validated case file as a frozen noun."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.cases.diagrams import DiagramKind, with_declaration
from eppanalysis.cases.elbow_case import ElbowKind
from eppanalysis.cases.expected import Expected, make_expected
from eppanalysis.cases.files import Missing, RawCase, drop_alternatives, put, shipped_cases_folder, without_answers
from eppanalysis.cases.from_system import input_tables, tables_of
from eppanalysis.cases.kind import Kind
from eppanalysis.cases.loops import LoopKind
from eppanalysis.cases.schema import INPUTS, find_quantity, validate
from eppanalysis.cases.values.dimensions import remarks
from eppanalysis.cases.values.expressions import is_expression_of, same_unit
from eppanalysis.cases.values.parameters import Named
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.cases.values.shown import ShownCase
from eppanalysis.cases.values.toml import plain_value, updated_toml, write_toml
from eppanalysis.cases.values.typed import in_typed_units
from eppanalysis.cases.variation import Variation
from eppanalysis.cases.words import our_word
from eppanalysis.errors import CaseError
from eppanalysis.models.devices.elbow.parameters import ElbowParameters
from eppanalysis.models.diagrams import Diagram
from eppanalysis.models.systems.inputs import InputSignal
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.units import QuantityError, format_si, parse_any, parse_quantity, typed_unit, write_si

#: Fields whose change leaves the case's expected answers true.
_NO_CHANGE_OF_SYSTEM = ("title", "run.t_end")
#: What cases are of, by the names that files call them.
KINDS: dict[str, Kind] = {kind.name: kind for kind in (ElbowKind(), LoopKind(), DiagramKind())}
#: Units in which people read lengths.
#: Digits of a number in a message.
_TYPED = 6
#: Fields of an input signal that hold no quantity.
_NOT_A_NUMBER = ("kind", "file", "times", "values")


@dataclass(frozen=True, eq=False, repr=False)
class Case(ShownCase):
    """A validated case.

    Attributes
    ----------
    name, title : str
        Stem of the file; what the case is about, in a few words.
    kind : {"elbow", "loop", "diagram"}
        The paper's elbow, a loop of a transfer function and elements, or a diagram of blocks.
    source : str
        The file, as the user gave it.
    parameters : dict of str to Parameter
        Every scalar parameter that is given, by its dotted name: "lock_pin.backlash", or "play.gap" (name and field of
        an element) and "loop.gain" in a generic loop.
    input : InputSignal, mapping of str to InputSignal, or None
        What the external input does from t = 0 on, or any of them by name; None when the system has no input or it
        stays where it is.
    expected : Expected
        What should come out.
    """

    name: str
    title: str
    kind: str
    source: str
    parameters: dict[str, Parameter]
    input: InputSignal | Mapping[str, InputSignal] | None
    expected: Expected
    _raw: RawCase
    _system: LureSystem
    _elbow: ElbowParameters | None = None
    #: What expressions in fields of parts come to.
    _computed: Mapping[str, Named] = field(default_factory=dict)
    #: SI unit of each external input, and the unit that people use.
    _input_units: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    #: On how its parts are connected.
    _remarks: tuple[str, ...] = ()
    _end: float | None = None  # length of its run [s], where the file says it

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_validated", "_variation")}

    @cached_property
    def _validated(self) -> Any:
        """The model of its file; in another process its classes are others, so there it is made once more."""
        return _model_of(self._raw)

    @cached_property
    def _variation(self) -> Variation:
        """What is worth varying in it, which reports look up for each of their sections."""
        return KINDS[self.kind].variation(self)

    @classmethod
    @checked
    def from_system(
        cls,
        loop: LureSystem | Diagram,
        name: str = "",
        *,
        title: str = "",
        input: InputSignal | Mapping[str, InputSignal] | None = None,
        t_end: float = 10.0,
        signal: str | None = None,
    ) -> Case:
        """A loop that was made in Python, as a case: its elements' fields are parameters, and it can be written.

        Of a diagram the fields of its blocks are parameters, too.

        Parameters
        ----------
        loop : LureSystem or Diagram
        name, title : str, optional
            Of the case; by default the loop's name.
        input : InputSignal or mapping of str to InputSignal, optional
            What the only external input does from t = 0 on, or any of them by name.
        t_end : float
            How long to simulate [s].
        signal : str, optional
            The signal that rows and pictures show; the first one by default.

        Raises
        ------
        EppError
            If a case file has no place for something in it, such as an element of a class of one's own.

        Examples
        --------
        >>> import eppanalysis as epp
        >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
        >>> servo = epp.Case.from_system(loop, name="servo")
        >>> servo.value("play.gap"), epp.case_from_text(servo.to_toml()).value("play.gap")
        (2.0, 2.0)
        """
        name = name or loop.name
        data: dict[str, Any] = {
            **tables_of(loop),
            "title": title or name,
            "run": {"t_end": write_si(t_end, "s"), **input_tables(input)},
        }
        if signal is not None:
            data["expected"] = {"signal": signal}
        return load(RawCase(name, name, Path(), plain_value(data)))

    @classmethod
    @checked
    def from_tables(cls, tables: Mapping[str, Any], name: str = "case") -> Case:
        """The case that nested tables describe, as its file would.

        Parameters
        ----------
        tables : mapping
            The text of a case file, as tables.
        name : str

        Raises
        ------
        CaseError
            If anything in it is not valid, as for :func:`eppanalysis.read_case`.
        """
        return opened(RawCase(name, name, Path(), plain_value(tables)))

    def to_system(self) -> LureSystem:
        """The system that the case describes."""
        return self._system

    @property
    def t_end(self) -> float:
        """How long to simulate [s].

        Raises
        ------
        CaseError
            If the file does not say it.
        """
        if self._end is None:
            expected = "the length of a run: run.t_end = '10 s' above the first section"
            raise CaseError(self.source, "run.t_end", Missing(), expected)
        return self._end

    @property
    def operating_point(self) -> OperatingPoint:
        """Values of the external inputs at the end of the run [SI], or why they are not constant.

        Without a length of the run they are those that they come to in the end.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> str(case("fig8a_original").operating_point)
        'harness_position = 0.0216585'
        """
        return OperatingPoint.of(self._system, self.input, math.inf if self._end is None else self._end)

    @property
    def named_signals(self) -> tuple[str, ...]:
        """The signals that tables on a console show: those that the file names, and the expected one.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> case("x15_flare").named_signals
        ('theta', 'delta')
        """
        named = KINDS[self.kind].named_signals(self._raw.data, self._system.signals.names)
        return tuple(dict.fromkeys([*named, *([self.expected.signal] if self.expected.signal else [])]))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on what is possible but hardly meant: an angle without a unit, a play between two inertias.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> print(*case("fig8a_original").with_values({"lock_pin.backlash": 2.5}).remarks)
        lock_pin.backlash is 2.5 without a unit: 2.5 rad, which are 143.239 deg; for
        degrees write "2.5 deg".
        """
        plain = [name for name in self.parameters if self._is_plain(name)]
        return (*remarks(self.parameters, plain), *self._remarks)

    def _is_plain(self, name: str) -> bool:
        """Whether the file has a parameter as a plain number."""
        return isinstance(self.held(name), int | float)

    def held(self, name: str) -> Any:
        """What the file holds in a field, as it was typed."""
        return self._raw.typed(".".join(map(str, self._path(name))))

    @checked
    def parameter_of(self, field: str) -> str:
        """The parameter that makes a field of a part larger: itself, or one that the expression in it is made of.

        Of several the one that it grows with most, per cent by per cent; empty where there is none.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> servo = case("azimuth_servo")
        >>> servo.parameter_of("gear.gap"), servo.parameter_of("gear.stiffness")
        ('gap', 'gear.stiffness')
        """
        held = field if field in self.parameters else self.held(field)
        if field not in self._computed or held in self.parameters:
            return held if isinstance(held, str) and held in self.parameters else ""
        slopes = self._computed[field].value.gradient
        growth = {name: slope * self.value(name) * self._computed[field].value.number for name, slope in slopes.items()}
        return max((name for name in growth if growth[name] > 0.0), key=lambda name: growth[name], default="")

    @property
    def folder(self) -> Path:
        """Where files that the case names are looked for, such as a recorded input signal."""
        return self._raw.folder

    @property
    def elbow_parameters(self) -> ElbowParameters:
        """Parameters of the elbow in SI units.

        Raises
        ------
        CaseError
            If the case is a generic loop.
        """
        if self._elbow is None:
            raise CaseError(self.source, "kind", self.kind, "a case of the elbow")
        return self._elbow

    @property
    def input_units(self) -> dict[str, str]:
        """SI unit of each external input that has one, by its name."""
        return {name: unit for name, (unit, _) in self._input_units.items() if unit}

    @checked
    def value(self, name: str) -> float:
        """A parameter in SI units; of an elbow also one that follows from others or keeps its default.

        Raises
        ------
        CaseError
            If there is no such parameter, or it is switched off.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> round(case("fig8a_original").value("bands.slack"), 6)
        5.560277
        """
        if name in self.parameters:
            return float(self.parameters[name].value)
        self._check_known(name, self.source)
        if name == "run.t_end":
            return self.t_end
        if name in self._fields_of_inputs and not isinstance(held := self.held(name), Missing):
            return self.si(name, held)
        found = None if name.startswith("run.") else KINDS[self.kind].implied(self._elbow, name)
        if found is None:
            raise CaseError(self.source, name, Missing(), "a parameter that has a value in this case")
        return found

    @checked
    def si(self, name: str, value: object) -> float:
        """SI value of a quantity that the parameter `name` could take, such as "0.6 deg" for a backlash.

        Raises
        ------
        CaseError
            If there is no such parameter, or the value has another dimension.
        """
        self._check_known(name, self.source)
        try:
            return KINDS[self.kind].si(value, self.unit(name)[0])
        except QuantityError as error:
            raise CaseError(self.source, name, value, error.expected) from None

    @checked
    def unit(self, name: str) -> tuple[str, str]:
        """SI unit of a parameter, or of a field that is computed of some, and the unit that people use.

        Raises
        ------
        CaseError
            If there is no such parameter.
        """
        if name in self._computed:
            return self._computed[name].parameter.unit, self._computed[name].parameter.friendly
        self._check_known(name, self.source)
        if name in self.parameters:
            return self.parameters[name].unit, self.parameters[name].friendly
        if name in self._fields_of_inputs:
            return self._unit_of_input(name)
        quantity = find_quantity(KINDS[self.kind].file, name.split("."))
        return ("", "") if quantity is None else (quantity.unit, quantity.friendly or quantity.unit)

    def _unit_of_input(self, name: str) -> tuple[str, str]:
        """Units of a field of an input signal."""
        (model, of), field = self._fields_of_inputs[name], name.rpartition(".")[2]
        unit, friendly = self._input_units.get(of, ("", ""))
        friendly = typed_unit(self.held(name)) or friendly
        if field in ("size", "amplitude"):
            return unit, friendly or unit
        if field == "rate":
            return (f"{unit}/s", friendly or f"{unit}/s") if unit else ("1/s", "1/s")
        quantity = find_quantity(model, [field])
        return ("", "") if quantity is None else (quantity.unit, quantity.friendly or quantity.unit)

    @checked
    def readable(self, name: str) -> tuple[str, float]:
        """The unit that people use for a parameter, and the factor from SI to it.

        Raises
        ------
        CaseError
            If there is no such parameter.
        """
        unit, shown = self.unit(name)
        return shown, 1.0 / parse_quantity(f"1 {shown}", unit) if shown and shown != unit else 1.0

    @checked
    def text(self, name: str, value: float, digits: int = 6) -> str:
        """A value of a parameter, given in SI units, as people write it.

        Raises
        ------
        CaseError
            If there is no such parameter, or `digits` is not 1 to 17.
        """
        if not 1 <= digits <= 17:
            raise CaseError(self.source, "digits", digits, "1 to 17")
        return format_si(value, *self.unit(name), digits)

    @checked
    def with_values(self, values: Mapping[str, Any], source: str = "with_values") -> Case:
        """The same case with other values, validated again; its expected answers are dropped, as they no longer hold.

        Parameters
        ----------
        values : mapping of str to str, number, bool, Parameter or table
            By dotted names; plain numbers are in SI units. A field that another one replaces (thresholds for
            widths, prehensor mass for inertia) drops that other one; where one of the bands' thresholds or widths is
            given, the others of its group stay where they are.
        source : str
            What messages call the place where the values come from.

        Raises
        ------
        CaseError
            If a field is not known or the case is no longer valid.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> changed = case("fig8a_original").with_values({"lock_pin.backlash": "0.5 deg"})
        >>> str(changed.parameters["lock_pin.backlash"])
        '0.5 deg'
        """
        # What does not change stays the very same, which has been validated.
        data = dict(self._raw.data)
        if any(str(name) not in _NO_CHANGE_OF_SYSTEM for name in values):
            data = without_answers(data)
        origins = dict(self._raw.origins)
        given: dict[str, set[str]] = {}
        called: dict[str, str] = {}
        for name in values:
            section, _, last = str(name).partition(".")
            given.setdefault(section, set()).add(last)
        # A field replaces its alternatives, and may need others beside it.
        for section, names in given.items():
            if isinstance(data.get(section), dict):
                data[section] = drop_alternatives(section, data[section], names)
        for section, others in KINDS[self.kind].beside(self._elbow, data, given).items():
            data[section] = {**data[section], **others} if others else data[section]
        for name, value in values.items():
            if not isinstance(name, str) or not name or len(name) > 200:
                raise CaseError(source, "", name, "the dotted name of a field")
            plain = self._with_unit(name, plain_value(value))
            self._check_settable(name, plain, source)
            path = self._path(name)
            put(data, path, plain, source, name)
            called[".".join(map(str, path))] = name
            # Its sections too, for what the change makes missing; fields that stay keep their own entries.
            origins.update({".".join(map(str, path[:i])): source for i in range(1, len(path) + 1)})
        made = self._made_of(replace(self._raw, data=data, origins=origins), called, source)
        for name, value in values.items():
            old, new = (case.parameters.get(name) for case in (self, made))
            # A plain number is in SI units; what a field with a unit of its own refuses has been refused before.
            if old and new and old.unit and new.unit and not same_unit(old.unit, new.unit):
                raise CaseError(source, name, plain_value(value), f"a quantity in {old.unit}, as it is in the case")
        return made

    def to_toml(self, comments: bool = False) -> str:
        """The whole case as TOML text, without a base.

        Parameters
        ----------
        comments : bool
            Keep the comments and the order of the file that the case was read from, where there is one.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> changed = case("pid_hunting").with_values({"friction.static": 1.5})
        >>> changed.to_toml(comments=True).splitlines()[0][:34]
        "# x'' = u - x' - F, u = -10 x - 5 "
        """
        data = {"kind": self.kind, **self._raw.data}
        text = self._text() if comments else ""
        return updated_toml(text, data) if text else write_toml(data)

    def _text(self) -> str:
        """The file that the case was read from, as it is now; empty where there is none."""
        with suppress(OSError, ValueError):
            paths = (Path(self.source), shipped_cases_folder() / self.source)
            return next((path.read_text(encoding="utf-8") for path in paths if path.is_file()), "")
        return ""

    def provenance(self) -> dict[str, Any]:
        """What a result needs to be traced back: file, checksum, version and every parameter with its mark."""
        from eppanalysis import __version__

        # One content has one checksum, in whatever order its fields were written.
        content = json.dumps(self._raw.data, sort_keys=True, ensure_ascii=True)
        return {
            "case": self.name,
            "kind": self.kind,
            "source": self.source,
            "sha256": hashlib.sha256(content.encode()).hexdigest(),
            "version": __version__,
            "parameters": {name: asdict(p) for name, p in self.parameters.items()},
        }

    def fields_of_run(self) -> list[str]:
        """The fields of its run that hold a quantity."""
        return ["run.t_end", *self._fields_of_inputs]

    @cached_property
    def _fields_of_inputs(self) -> dict[str, tuple[type[Any], str]]:
        """The fields of its input signals that hold a quantity, each with the model of its signal and the input."""
        run = self._raw.data.get("run") or {}
        given = {f"run.inputs.{name}": (name, table) for name, table in (run.get("inputs") or {}).items()}
        if run.get("input"):
            given["run.input"] = (next(iter(self._input_units), ""), run["input"])
        return {
            f"{place}.{field}": (INPUTS[table["kind"]], name)
            for place, (name, table) in given.items()
            for field in INPUTS[table["kind"]].model_fields
            if field not in _NOT_A_NUMBER
        }

    def _known(self) -> list[str]:
        return list(dict.fromkeys([*KINDS[self.kind].fields(self.parameters), *self.fields_of_run()]))

    def _check_known(self, name: str, source: str, shown: object = None) -> None:
        known = self._known()
        if name in known:
            return
        if not name:
            raise CaseError(source, "", name, "the dotted name of a field")
        held = self.held(name)
        if not name.endswith(".kind") and is_expression_of(held, self.parameters):
            expected = (
                "a quantity, which can be varied; vary the parameters of its expression, or set it to a quantity first"
            )
            raise CaseError(source, name, held, expected)
        alike = [k for k in known if k.casefold() == name.casefold() or k.endswith(f".{name}")]
        alike += [k for k in known if k == f"{name.rpartition('.')[0]}.{self._path(name)[-1]}"]
        close = alike or difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"one of {', '.join(known)}"
        raise CaseError(source, name, "not known" if shown is None else shown, f"a known field: {hint}")

    def _check_settable(self, name: str, value: Any, source: str) -> None:
        """Refuse names that validation could not put right; the rest of the file may be set too ("run.t_end")."""
        section = name.partition(".")[0]
        if section in ("run", "expected", "title") or (section == "loop" and self.kind == "loop"):
            return
        if not KINDS[self.kind].takes(name, self._raw.data):
            self._check_known(name, source, value)

    def _with_unit(self, name: str, plain: Any) -> Any:
        """A plain number with the unit that its field has from the file alone; else what is given."""
        old = self.parameters.get(name)
        if old is None or not old.unit or find_quantity(KINDS[self.kind].file, name.split(".")) is not None:
            return plain
        try:
            number, _ = parse_any(plain)
        except QuantityError:
            return plain
        return plain if typed_unit(plain) else write_si(number, old.unit, old.friendly)

    def _made_of(self, raw: RawCase, called: Mapping[str, str], source: str) -> Case:
        """The case with other data; what of it a source gave is refused by the name that it was `called` there.

        "play.gap" is no "loop.elements.0.gap" to who sets it. What was not typed on the command line is refused in the
        units that people type.
        """
        try:
            return load(raw, (self._raw.data, self._validated), source)
        except CaseError as error:
            given = error.source == source and error.field in called
            field = called[error.field] if given else error.field
            named = CaseError(error.source, field, error.value, error.expected, error.fault, error.also)
            raise (named if given and source.startswith("--") else self._as_typed(named)) from None

    def _as_typed(self, error: CaseError) -> CaseError:
        """A refusal of a number that was handed on in SI units, with the number in the unit that people type."""
        if (
            error.field not in self._known()
            or isinstance(error.value, bool)
            or not isinstance(error.value, int | float)
        ):
            return error
        unit, shown = self.unit(error.field)
        if not unit and not shown:
            return error
        typed = format_si(float(error.value), unit, shown, _TYPED)
        return CaseError(error.source, error.field, typed, error.expected, error.fault, error.also)

    def _path(self, name: str) -> list[str | int]:
        """Where a field is in the file, whatever word for it is used."""
        path = KINDS[self.kind].path(name, self._raw.data)
        if len(path) > 2:
            path[-1] = our_word(self._raw.typed(".".join(map(str, path[:-1]))), str(path[-1]))
        return path


def _model_of(raw: RawCase, before: tuple[Mapping[str, Any], Any] | None = None) -> Any:
    return validate(raw, {name: kind.file for name, kind in KINDS.items()}, before)


def load(raw: RawCase, before: tuple[Mapping[str, Any], Any] | None = None, latest: str = "") -> Case:
    """The case of a file that has been read and merged; `before` as for :func:`eppanalysis.cases.schema.validate`.

    Parameters
    ----------
    latest : str
        Source of the values that were put in last; that of the file by default.

    Raises
    ------
    CaseError
        If anything in it is not valid.
    """
    raw = raw.in_our_words()
    file = _model_of(raw, before)
    try:
        with np.errstate(all="ignore"):  # what overflows is refused as not finite
            parts = KINDS[file.kind].parts(file, raw)
    except CaseError as error:
        raise raw.blamed(error, latest or raw.source) from None
    expected = make_expected(file.expected)
    if expected.signal is not None and expected.signal not in parts.system.signals.names:
        raise raw.refused("expected.signal", f"one of {', '.join(parts.system.signals.names)}")
    signals = in_typed_units(parts.system.signals, raw.data, raw.typed("run.t_end"))
    if expected.signal is not None and expected.signal != signals.names[0]:
        signals = signals.led_by(expected.signal)
    system = replace(parts.system, signals=signals)
    told = raw.name, file.title, file.kind, raw.source, parts.parameters, parts.input
    end = None if file.run.t_end is None else float(file.run.t_end.value)
    return Case(*told, expected, raw, system, parts.elbow, parts.computed, parts.input_units, parts.remarks, end)


def opened(raw: RawCase) -> Case:
    """The case of a file, whose fields are refused by the words that the file has for them.

    Raises
    ------
    CaseError
        As :func:`load`.
    """
    try:
        return load(raw)
    except CaseError as error:
        raise with_declaration(raw.as_called(error), raw) from None


def json_schema(kind: str) -> dict[str, Any]:
    """JSON schema of a case file, for editors.

    Parameters
    ----------
    kind : {"elbow", "loop", "diagram"}

    Raises
    ------
    CaseError
        If there is no such kind.
    """
    if kind not in KINDS:
        raise CaseError("json_schema", "kind", kind, " or ".join(repr(k) for k in KINDS))
    schema = KINDS[kind].file.model_json_schema()
    schema["properties"]["base"] = {"type": "string", "description": "Case that this one inherits from."}
    return schema
