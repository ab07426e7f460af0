"""Input signals of a case file, recorded ones included."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eppanalysis.cases.files import Missing, RawCase
from eppanalysis.cases.schema import RampInput, RecordedInput, SineInput, StepInput, StepsInput
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.errors import CaseError, ModelError, UnknownName
from eppanalysis.models.systems.inputs import InputSignal, Ramp, Recorded, Sine, Step, Steps
from eppanalysis.records.columns import TIME, Column, Headings, find_columns, unit_factor
from eppanalysis.records.formats import opened
from eppanalysis.records.reading import read

LARGEST_RECORDING = 64_000_000

Input = StepInput | StepsInput | RampInput | SineInput | RecordedInput


def input_signals_of(
    run: Any, names: Sequence[str], unit: str | Mapping[str, str], raw: RawCase
) -> InputSignal | dict[str, InputSignal] | None:
    """What a case's run says of the external inputs with these names: of the only one, or of any by name.

    Raises
    ------
    CaseError
        If there is no such input, or an input's input signal is not valid.
    """
    units = unit if isinstance(unit, Mapping) else dict.fromkeys(names, unit)
    if run.input is not None:
        if not names:
            raise CaseError(raw.origin("run.input"), "run.input", run.input.kind, "no input: the loop has none")
        if len(names) > 1 or run.inputs is not None:
            expected = "inputs by name, as in run.inputs.<name>"
            raise CaseError(raw.origin("run.input"), "run.input", run.input.kind, expected)
        return make_input_signal(run.input, units[names[0]], raw, names[0])
    for name in run.inputs or {}:
        if name not in names:
            known = ", ".join(names) or "none"
            expected, fault = f"an input of the loop: {known}", UnknownName(name)
            raise CaseError(raw.origin("run.inputs"), f"run.inputs.{name}", name, expected, fault)
    return {n: make_input_signal(m, units[n], raw, n, f"run.inputs.{n}") for n, m in (run.inputs or {}).items()} or None


def make_input_signal(given: Input, unit: str, raw: RawCase, name: str, field: str = "run.input") -> InputSignal:
    """The input signal of a case, in SI units.

    Parameters
    ----------
    unit : str
        SI unit of the system's input.
    raw : RawCase
        The case that it is in.
    name : str
        What the system calls the input.
    field : str
        Where in it.

    Raises
    ------
    CaseError
        If a value has the wrong dimension, times are out of order, or a recording cannot be read.
    """
    try:
        return _input_signal(given, unit, raw, name, field)
    except ModelError as error:
        raise raw.refused_by_model(error, field) from None


def _input_signal(given: Input, unit: str, raw: RawCase, name: str, field: str) -> InputSignal:
    if isinstance(given, RecordedInput):
        return _recorded(given, unit, raw, name, field)
    if isinstance(given, StepInput):
        return Step(_value(given.size, f"{field}.size", unit, raw), _time(given.time))
    if isinstance(given, StepsInput):
        return _steps(given, unit, raw, field)
    if isinstance(given, RampInput):
        start, stop = _time(given.start), None if given.stop is None else float(given.stop.value)
        if stop is not None and stop <= start:
            raise raw.refused(f"{field}.stop", "a time after start")
        per_second = f"{unit}/s" if unit else "1/s"
        return Ramp(_value(given.rate, f"{field}.rate", per_second, raw), start, stop)
    phase = 0.0 if given.phase is None else float(given.phase.value)
    return Sine(_value(given.amplitude, f"{field}.amplitude", unit, raw), float(given.frequency.value), phase)


def _recorded(given: RecordedInput, unit: str, raw: RawCase, name: str, field: str) -> Recorded:
    """From a file, or from the samples in the case itself."""
    if given.file is not None and given.times is None and given.values is None:
        return read_recording(raw.folder / given.file, unit, name, given.file, raw)
    if given.file is not None or given.times is None or given.values is None:
        wrong = "file" if given.file is None and given.times is None and given.values is None else "times"
        shown = Missing() if given.file is None else "given"
        raise CaseError(raw.origin(field), f"{field}.{wrong}", shown, "either file, or times and values")
    try:
        return Recorded(np.array(given.times), np.array(given.values))
    except ModelError as error:
        raise CaseError(raw.origin(field), field, "not a recording", f"increasing times ({error})") from None


def _steps(given: StepsInput, unit: str, raw: RawCase, field: str) -> Steps:
    times = [float(t.value) for t in given.times]
    if len(given.values) != len(times):
        expected = f"{len(times)} values, one for each time"
        raise CaseError(raw.origin(field), f"{field}.values", f"{len(given.values)} long", expected)
    for i in range(1, len(times)):
        if times[i] <= times[i - 1]:
            raise raw.refused(f"{field}.times.{i}", "a later time than the one before")
    values = [_value(v, f"{field}.values.{i}", unit, raw) for i, v in enumerate(given.values)]
    return Steps(np.array(times), np.array(values))


def _time(given: Parameter | None) -> float:
    return 0.0 if given is None else float(given.value)


def _value(given: Parameter, field: str, unit: str, raw: RawCase) -> float:
    if given.unit not in ("", unit):
        unknown = 'a plain number, for its input has no unit (in a diagram: inputs = { name = "0 rad" })'
        raise raw.refused(field, f"a quantity in {unit}" if unit else unknown)
    return float(given.value)


def read_recording(path: Path, unit: str, name: str, label: str, raw: RawCase) -> Recorded:
    """A recorded input signal: the only column beside the time of a file, or the one that is called as the input.

    A column without a unit is in SI units.

    Raises
    ------
    CaseError
        If the file is not there, a row has a hole, or times do not increase.
    """
    # A case from elsewhere must not read outside its folder, by a link either.
    if not path.exists() or path.resolve().parent != path.parent.resolve():
        field = "run.input.file"
        raise CaseError(raw.origin(field), field, label, "the name of a file in the case's folder, such as CSV")
    header = f"a header such as 'time [s],{name}{f' [{unit}]' if unit else ''}'"
    table = opened(path, header, has_si=True, largest=LARGEST_RECORDING)
    columns = _columns(table.headings, unit, name)
    found = read(table, columns, fewest=2, whole=True, largest=math.inf)
    if found[TIME][0] < 0.0:
        raise CaseError(str(path), TIME, f"{found[TIME][0]:g} s", "a time that is not negative")
    return Recorded(found[TIME], found[columns[1].role])


def _columns(headings: Headings, unit: str, name: str) -> Sequence[Column]:
    """Time and value."""
    if len(headings.all) > 2:
        return find_columns(headings, (TIME, name), (), {}, {TIME: "s", name: unit})
    if len(headings.all) < 2:
        found = ", ".join(heading.text for heading in headings.all)
        raise CaseError(headings.source, headings.line, found, f"two columns: time and {name}")
    both = zip((TIME, name), headings.all, ("s", unit), strict=True)
    return [
        Column(role, i, unit_factor(headings, heading, role, heading.unit, si) if heading.unit else 1.0, heading)
        for i, (role, heading, si) in enumerate(both)
    ]
