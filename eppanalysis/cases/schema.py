"""What a case file may hold, as pydantic models, and their errors as one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_origin

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, create_model

from eppanalysis.cases.files import LABEL, LABEL_IS, Missing, RawCase
from eppanalysis.cases.values.quantities import (
    LONGEST_TEXT,
    AnyQuantity,
    Duration,
    Parameter,
    PositiveDuration,
    Quantity,
    declared_type,
    not_as_expected,
    plain_text,
)
from eppanalysis.errors import CaseError, did_you_mean
from eppanalysis.models.devices.declared import Section, declared_fields
from eppanalysis.models.devices.elbow.parameters import ElbowParameters
from eppanalysis.models.diagrams.wiring import plain_name
from eppanalysis.units import KINDS

Text = Annotated[str, Field(max_length=LONGEST_TEXT), AfterValidator(plain_text)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=60)]
#: Of what a loop made elsewhere brings along, such as "motor_x[0]": the same, and indices.
Label = Annotated[str, Field(pattern=LABEL, max_length=100)]
Place = Annotated[str, Field(max_length=120), AfterValidator(plain_text)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
Row = Annotated[list[Number], Field(max_length=200)]
Matrix = Annotated[list[Row], Field(max_length=200)]
Scalar = Annotated[Parameter, AnyQuantity()]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CaseFile(_Model):
    """A case file: the top level, where a base may be beside the fields."""


class StepInput(_Model):
    """A jump."""

    kind: Literal["step"]
    size: Scalar
    time: Duration | None = None


class StepsInput(_Model):
    """Several jumps one after the other: when, and its value after each."""

    kind: Literal["steps"]
    times: Annotated[list[Duration], Field(min_length=1, max_length=1000)]
    values: Annotated[list[Scalar], Field(min_length=1, max_length=1000)]


class RampInput(_Model):
    """An input signal at constant rate."""

    kind: Literal["ramp"]
    rate: Scalar
    start: Duration | None = None
    stop: PositiveDuration | None = None


class SineInput(_Model):
    """A sine."""

    kind: Literal["sine"]
    amplitude: Scalar
    frequency: Annotated[Parameter, Quantity("Hz", above=0)]
    phase: Annotated[Parameter, Quantity("rad", "deg")] | None = None


class RecordedInput(_Model):
    """A recorded input signal, linear between its samples: a CSV file in the case's folder, or times and values."""

    kind: Literal["recorded"]
    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=100)] | None = None
    times: Annotated[list[Number], Field(min_length=2, max_length=20_000)] | None = None
    values: Annotated[list[Number], Field(min_length=2, max_length=20_000)] | None = None


#: Input signals by their kind.
INPUTS: dict[str, type[_Model]] = {
    "step": StepInput,
    "steps": StepsInput,
    "ramp": RampInput,
    "sine": SineInput,
    "recorded": RecordedInput,
}


AnyInput = Annotated[
    StepInput | StepsInput | RampInput | SineInput | RecordedInput,
    Field(discriminator="kind"),
]


class RunSection(_Model):
    """How the case is simulated: `input` moves the only external input, `inputs` any of them by name."""

    t_end: Annotated[Parameter, Quantity("s", above=0)] | None = None
    input: AnyInput | None = None
    inputs: dict[Label, AnyInput] | None = None


class CycleAnswer(_Model):
    """A known limit cycle."""

    amplitude: Positive
    omega: Positive
    period: Positive | None = None
    mean: Number | None = None
    middle: Number | None = None
    fundamental: Number | None = None
    stable: bool | None = None
    largest_multiplier: Number | None = None
    also: dict[Label, Number] = {}


class PublishedValue(_Model):
    """A number from the literature."""

    quantity: Text
    value: Number
    source: Text
    how_known: Text = ""
    confirmed: bool = False


class ExpectedSection(_Model):
    """What the case should give, and who says so."""

    outcome: Literal["oscillate", "settle"] | None = None
    signal: Label | None = None
    describing_function: list[CycleAnswer] | None = None
    exact: list[CycleAnswer] | None = None
    published: list[PublishedValue] = []
    paper: Text = ""
    finding: Text = ""
    source: Text = ""
    note: Text = ""


def _section(name: str, declared: type[Section]) -> tuple[Any, Any]:
    """Type and default of a section of a file, from what a device declares of it."""
    held: dict[str, Any] = {}
    for field, about in declared_fields(declared).items():
        kind = declared_type(about)
        held[field] = (kind | None, None) if about.optional else (kind, ...)
    title = "".join(part.title() for part in name.split("_"))
    summary = (declared.__doc__ or "").partition("\n")[0]
    made = create_model(f"{title}Section", __base__=_Model, __doc__=summary, __module__=__name__, **held)
    return made, made() if declared.left_out else ...


#: Sections of a case of the elbow.
SECTIONS = {name: _section(name, declared) for name, declared in ElbowParameters.sections().items()}
_ELBOW: dict[str, Any] = {
    "kind": (Literal["elbow"], "elbow"),
    "title": (Text, ...),
    **SECTIONS,
    "run": (RunSection, RunSection()),
    "expected": (ExpectedSection, ExpectedSection()),
}
ElbowFile: Any = create_model(
    "ElbowFile", __base__=CaseFile, __doc__="A case of the elbow.", __module__=__name__, **_ELBOW
)


class SignalRow(_Model):
    """A named signal: weights of the states, of the elements' outputs and of the external inputs."""

    state: Row | None = None
    output: Row | None = None
    input: Row | None = None
    constant: Number = 0.0
    unit: Annotated[str, Field(max_length=30)] = ""


class CutRow(_Model):
    """A place at which a loop can be cut: what a disturbance there does, and the signal before it."""

    to_state: Row | None = None
    to_inputs: Row | None = None
    state: Row | None = None
    output: Row | None = None
    itself: Number = 0.0
    delay: Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)] = 0.0


class LoopSection(_Model):
    """A generic loop: a transfer function and one element, a ring of blocks, or a state space with elements."""

    gain: Scalar | None = None
    num: Row | None = None
    den: Row | None = None
    blocks: Annotated[list[dict[str, Any]], Field(max_length=50)] | None = None
    A: Matrix | None = None
    B: Matrix | None = None
    C: Matrix | None = None
    D: Matrix | None = None
    constant_state: Row | None = None
    constant_input: Row | None = None
    inputs: list[Label] = []
    input_matrix: Matrix | None = None
    input_feedthrough: Matrix | None = None
    elements: Annotated[list[dict[str, Any]], Field(max_length=50)] | None = None
    states: list[Place] | None = None
    signals: dict[Label, SignalRow] | None = None
    initial_state: Row | None = None
    initial_input: Row | None = None
    delay: Duration | None = None
    delays: Annotated[list[Annotated[Number, Field(ge=0)]], Field(max_length=200)] | None = None
    time_step: PositiveDuration | None = None
    principal: Label | None = None
    cuts: Annotated[dict[Place, CutRow], Field(max_length=500)] | None = None
    margins_at: Place | Annotated[list[Place], Field(max_length=50)] | None = None
    feedback: Literal[-1, 1] = -1


class LoopFile(CaseFile):
    """A case of a generic loop."""

    kind: Literal["loop"]
    title: Text
    loop: LoopSection
    run: RunSection = RunSection()
    expected: ExpectedSection = ExpectedSection()


class SignalSum(_Model):
    """A named signal of a diagram: a signed sum of ports, with its unit."""

    of: Text
    unit: Annotated[str, Field(max_length=30)] = ""


Table = dict[str, Any]


def _levels(inputs: Any) -> Any:
    """External inputs that are only named are at zero before the start."""
    if isinstance(inputs, dict):
        return inputs
    if not isinstance(inputs, list) or not all(isinstance(name, str) for name in inputs):
        raise not_as_expected("a list of names, or a table of names and values", inputs)
    if len(set(inputs)) < len(inputs):
        raise not_as_expected("names that differ", inputs)
    return dict.fromkeys(inputs, 0.0)


def _one_or_more(names: Any) -> Any:
    """A name alone is a list of one."""
    if not isinstance(names, str | list):
        raise not_as_expected("a name, or a list of names", names)
    return [names] if isinstance(names, str) else names


def _sum(signal: Any) -> Any:
    """A signal without a unit may be the sum alone."""
    if not isinstance(signal, str | dict):
        raise not_as_expected(
            "a signed sum of ports such as 'setpoint - sensor', or a table of it and its unit", signal
        )
    return {"of": signal} if isinstance(signal, str) else signal


class DiagramFile(CaseFile):
    """A case of a diagram: named parameters, blocks, elements, and how they are connected."""

    kind: Literal["diagram"]
    title: Text
    connect: Annotated[list[Text], Field(max_length=500)]
    inputs: Annotated[dict[Name, Any], BeforeValidator(_levels, list[Name] | dict[Name, Any])] = {}
    margins_at: Annotated[list[Text], BeforeValidator(_one_or_more, Text | list[Text])] = []
    parameters: Annotated[dict[Name, Any], Field(max_length=500)] = {}
    blocks: Annotated[dict[Name, Table], Field(max_length=200)] = {}
    elements: Annotated[dict[Name, Table], Field(max_length=100)] = {}
    signals: dict[Label, Annotated[SignalSum, BeforeValidator(_sum, Text | SignalSum)]] = {}
    run: RunSection = RunSection()
    expected: ExpectedSection = ExpectedSection()


_SENTENCES = {
    "string_type": "a text",
    "list_type": "a list",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "finite_number": "a finite number",
    "model_type": "a table of fields",
    "model_attributes_type": "a table of fields",
    "dict_type": "a table",
}
_NAME_IS = "a plain name of letters, digits and underscores"
#: What is too long, and what is counted in it.
_LENGTHS = {"string_too_long": ("a text", "characters"), "too_long": ("a list", "items")}


def validate(
    raw: RawCase, files: Mapping[str, type[CaseFile]], before: tuple[Mapping[str, Any], Any] | None = None
) -> Any:
    """The validated model of a case file; `files` are the models by what files call their kind.

    `before` are the tables of a file and its model: sections of it that are in this one unchanged were validated.

    Raises
    ------
    CaseError
        On the first thing that is wrong: a field that is not known before one that is missing or has a wrong value.
    """
    if "kind" not in raw.data and "loop" in raw.data and "drive" not in raw.data:
        raise CaseError(raw.source, "kind", Missing(), "'loop', as the file has a section of that name")
    if "kind" not in raw.data and "connect" in raw.data:
        raise CaseError(raw.source, "kind", Missing(), "'diagram', as the file has connections")
    kind = raw.data.get("kind", "elbow")
    model = files.get(kind) if isinstance(kind, str) else None
    if model is None:
        raise CaseError(raw.origin("kind"), "kind", kind, " or ".join(repr(k) for k in files))
    try:
        return model.model_validate(raw.data if before is None else _with_known(raw.data, *before))
    except ValidationError as error:
        found = error.errors(include_url=False)
        # An unknown field tells more than the missing one that it was meant for, and goes first; missing ones go last.
        first = min(found, key=lambda e: (e["type"] != "extra_forbidden", e["type"] == "missing"))
        raise _case_error(dict(first), raw, model) from None


def _with_known(data: Mapping[str, Any], tables: Mapping[str, Any], file: Any) -> dict[str, Any]:
    """The tables of a file, with the models of those that are the very ones of another file."""
    known = {name: getattr(file, name, None) for name, table in data.items() if table is tables.get(name)}
    return {**data, **{name: model for name, model in known.items() if isinstance(model, _Model)}}


def _case_error(error: dict[str, Any], raw: RawCase, model: type[BaseModel]) -> CaseError:
    loc = [str(part) for part in error["loc"]]
    member = {"input": 2, "inputs": 3}.get(loc[1] if loc[0] == "run" and len(loc) > 1 else "", len(loc))
    signal = INPUTS.get(loc[member]) if member < len(loc) else None
    del loc[member : member + 1]  # the name of the union's member
    if loc[-1] == "[key]":
        del loc[-1]  # it is the name that is wrong, not what is there
    field, context = ".".join(loc), error.get("ctx", {})
    shown: Any = error["input"]
    if error["type"] == "extra_forbidden":
        expected = _suggest(loc[-1], signal or _model_at(model, loc[:-1]))
    elif error["type"] == "missing":
        shown, expected = Missing(), _wanted(model, loc)
    elif error["type"] == "quantity":
        shown, expected = context["shown"], context["expected"]
        field = f"{field}.{context['key']}" if context["key"] else field
    elif error["type"].startswith("union_tag"):
        field, shown, expected = _input_of_no_kind(field, shown)
    elif error["type"] == "literal_error":
        expected = context["expected"]
    elif error["type"] in _LENGTHS:
        expected = f"{_LENGTHS[error['type']][0]} of at most {context['max_length']} {_LENGTHS[error['type']][1]}"
    elif error["type"] == "string_pattern_mismatch":
        rename = f", such as {plain_name(str(shown))!r} here and wherever it is named"
        expected = LABEL_IS if context.get("pattern") == LABEL else f"{_NAME_IS}{rename}"
    elif error["type"] in _SENTENCES:
        expected = _SENTENCES[error["type"]]
    else:
        expected = error["msg"].removeprefix("Input should be ").removeprefix("Input should have ").lower()
    return CaseError(raw.origin(field), field, shown, expected)


def _input_of_no_kind(field: str, shown: Any) -> tuple[str, Any, str]:
    """Field, value and what was expected, where an input signal has no kind that there is.

    A table of tables is one of external inputs by their names, which is one level further.
    """
    kinds = "'step', 'steps', 'ramp', 'sine' or 'recorded'"
    if field == "run.input" and isinstance(shown, dict) and shown and all(isinstance(v, dict) for v in shown.values()):
        return (
            field,
            f"a table of {', '.join(shown)}",
            "one input signal; write several by name in run.inputs",
        )
    return f"{field}.kind", shown.get("kind", Missing()) if isinstance(shown, dict) else shown, kinds


def _model_at(model: type[BaseModel], path: list[str]) -> type[BaseModel] | None:
    """The model behind a dotted path; None where there is none, or several."""
    keyed = False
    for part in path:
        if keyed or part.isdigit():
            keyed = False
            continue
        info = model.model_fields.get(part)
        keyed = info is not None and _is_table(info.annotation)
        found = (
            [m for m in _members(info.annotation) if isinstance(m, type) and issubclass(m, BaseModel)] if info else []
        )
        if len(found) != 1:
            return None
        model = found[0]
    return model


def _is_table(annotation: Any) -> bool:
    """Whether a field holds things by names of their own."""
    return get_origin(annotation) is dict or any(_is_table(a) for a in getattr(annotation, "__args__", ()))


def _members(annotation: Any) -> list[Any]:
    """Everything inside a union, list or annotation."""
    inner = getattr(annotation, "__args__", ())
    return [annotation] if not inner else [m for a in inner for m in _members(a)]


def _suggest(name: str, model: type[BaseModel] | None) -> str:
    known = sorted(model.model_fields) if model is not None else []
    if model is not None and issubclass(model, CaseFile):
        known.append("base")
    return "a known field in its place" + (f": {did_you_mean(name, known)}" if known else "")


def _wanted(model: type[BaseModel], loc: list[str]) -> str:
    quantity = find_quantity(model, loc)
    if quantity is not None:
        kind, example = KINDS.get(quantity.unit, ("a quantity", "1"))
        return f"{kind} such as {example!r}" if quantity.unit else f"{kind} such as {example}"
    return "a section" if _model_at(model, loc) is not None else "a value"


def find_quantity(model: type[BaseModel], loc: list[str]) -> Quantity | None:
    """The kind of quantity that a field holds, None when it holds something else."""
    parent = _model_at(model, loc[:-1])
    info = parent.model_fields.get(loc[-1]) if parent is not None else None
    if info is None:
        return None
    candidates = [*info.metadata]
    for member in getattr(info.annotation, "__args__", ()):
        candidates += getattr(member, "__metadata__", ())
    return next((c for c in candidates if isinstance(c, Quantity)), None)
