"""Input signals of a case file, recorded ones included."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eppanalysis.cases.files import Missing, RawCase
from eppanalysis.cases.schema import RampInput, RecordedInput, SineInput, StepInput, StepsInput
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.errors import CaseError, ModelError, UnknownName
from eppanalysis.models.systems.inputs import InputSignal, Ramp, Recorded, Sine, Step, Steps
from eppanalysis.units import QuantityError, parse_quantity

LARGEST_RECORDING = 64_000_000
_HEADER = re.compile(r"\s*([A-Za-z_][A-Za-z_ ]*?)\s*(?:\[([^\]]*)\])?\s*")

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
        return make_input_signal(run.input, units[names[0]], raw)
    for name in run.inputs or {}:
        if name not in names:
            known = ", ".join(names) or "none"
            expected, fault = f"an input of the loop: {known}", UnknownName(name)
            raise CaseError(raw.origin("run.inputs"), f"run.inputs.{name}", name, expected, fault)
    return {n: make_input_signal(m, units[n], raw, f"run.inputs.{n}") for n, m in (run.inputs or {}).items()} or None


def make_input_signal(given: Input, unit: str, raw: RawCase, field: str = "run.input") -> InputSignal:
    """The input signal of a case, in SI units.

    Parameters
    ----------
    unit : str
        SI unit of the system's input.
    raw : RawCase
        The case that it stands in.
    field : str
        Where in it.

    Raises
    ------
    CaseError
        If a value has the wrong dimension, times are out of order, or a recording cannot be read.
    """
    try:
        return _input_signal(given, unit, raw, field)
    except ModelError as error:
        raise raw.refused_by_model(error, field) from None


def _input_signal(given: Input, unit: str, raw: RawCase, field: str) -> InputSignal:
    if isinstance(given, RecordedInput):
        return _recorded(given, unit, raw, field)
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


def _recorded(given: RecordedInput, unit: str, raw: RawCase, field: str) -> Recorded:
    """From a file, or from the samples that stand in the case itself."""
    if given.file is not None and given.times is None and given.values is None:
        return read_recording(raw.folder / given.file, unit, given.file, raw)
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


def read_recording(path: Path, unit: str, label: str, raw: RawCase) -> Recorded:
    """A recorded input signal: a CSV file with two columns, time and position, under a header.

    The header may give units in brackets, as in ``time [ms], position [mm]``; without them they are SI.

    Raises
    ------
    CaseError
        If the file is not there, a row has a hole, or times do not increase.
    """
    # A case from elsewhere must not read outside its folder, by a link either.
    if not path.is_file() or path.resolve().parent != path.parent.resolve():
        field = "run.input.file"
        raise CaseError(raw.origin(field), field, label, "the name of a CSV file in the case's folder")
    if path.stat().st_size > LARGEST_RECORDING:
        raise CaseError(str(path), "", f"{path.stat().st_size} bytes long", f"at most {LARGEST_RECORDING} bytes")
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [(number, row) for number, row in enumerate(csv.reader(stream), start=1) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CaseError(str(path), "", f"not readable ({error})", "a CSV file in UTF-8") from None
    if len(rows) < 3:
        raise CaseError(
            str(path),
            "",
            f"{len(rows)} row{'s' * (len(rows) != 1)} long",
            "a header and two or more rows of time and position",
        )
    factors = _factors(rows[0][1], unit, str(path))
    times: list[float] = []
    values: list[float] = []
    for number, row in rows[1:]:
        time, value = _read_row(row, number, str(path))
        if times and time * factors[0] <= times[-1]:
            raise CaseError(str(path), f"line {number}, time", row[0], "a later time than in the line before")
        if time < 0:
            raise CaseError(str(path), f"line {number}, time", row[0], "a time that is not negative")
        times.append(time * factors[0])
        values.append(value * factors[1])
    return Recorded(np.array(times), np.array(values))


def _factors(header: list[str], unit: str, source: str) -> tuple[float, float]:
    """SI values of the units that a header gives."""
    if len(header) != 2:
        raise CaseError(source, "line 1", ", ".join(header), "a header of two columns: time and position")
    factors = []
    for cell, si, column in zip(header, ("s", unit), ("time", "position"), strict=True):
        match = _HEADER.fullmatch(cell)
        if match is None:
            raise CaseError(source, f"line 1, {column}", cell, f"a name such as '{column} [{si or '1'}]'")
        try:
            factors.append(parse_quantity(f"1 {match[2] or si}", si))
        except QuantityError as error:
            raise CaseError(source, f"line 1, {column}", cell, f"the unit of {error.expected}") from None
    return factors[0], factors[1]


def _read_row(row: list[str], number: int, source: str) -> tuple[float, float]:
    if len(row) != 2:
        raise CaseError(source, f"line {number}", ", ".join(row), "two numbers: time and position")
    numbers = []
    for cell, column in zip(row, ("time", "position"), strict=True):
        try:
            found = float(cell)
        except ValueError:
            found = math.nan
        if not math.isfinite(found):
            shown: object = cell if cell.strip() else Missing()
            raise CaseError(source, f"line {number}, {column}", shown, "a finite number; a recording has no holes")
        numbers.append(found)
    return numbers[0], numbers[1]
