"""A loop as a Co-Simulation unit: the library of its run, its tables, and a description of its variables."""

from __future__ import annotations

import platform
import struct
import uuid
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from eppanalysis import units
from eppanalysis.engine import _engine
from eppanalysis.engine.workspace import make_event_buffer, make_progress, make_samples, make_workspaces
from eppanalysis.errors import EppError
from eppanalysis.fmu import BASE_UNITS
from eppanalysis.methods.simulation.runs import without_memory
from eppanalysis.models.diagrams.wiring import free_name, plain_name
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import InputSignal, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, system_of
from eppanalysis.writing import at_once, atomic

#: Events of a run, of which none is counted here.
_ANY_NUMBER = np.iinfo(np.int64).max
#: How FMI 2 calls the platforms that it has a name for, and the end of a library's name.
_PLATFORMS = {
    "x86_64-linux": "linux64",
    "x86_64-windows": "win64",
    "x86_64-darwin": "darwin64",
    "aarch64-darwin": "darwin64",
}
_SUFFIXES = {"windows": ".dll", "darwin": ".dylib"}
#: All files of a unit have one date, so that a loop makes the same unit each time.
_DATE = (1980, 1, 1, 0, 0, 0)


def to_fmu(
    loop: LureSystem | CaseLike,
    path: str | Path,
    *,
    version: int = 2,
    input: InputSignal | Mapping[str, InputSignal] | None = None,
) -> Path:
    """Write a loop as a Co-Simulation unit (FMU), which other tools run with the event-exact engine, without Python.

    Its outputs are the named signals of the loop [SI]. Its inputs, ``NAME_offset`` for an external input NAME, are
    added to the level of that input and to the signal of the case, as :func:`simulate` adds its own; they are zero by
    default, and held over a communication step. The library in the unit is that of the platform on which it is written.

    Parameters
    ----------
    loop : LureSystem or Case
        In continuous time; sampled controllers may be in it.
    path : str or Path
        File to write.
    version : {2, 3}
        Of FMI.
    input : InputSignal or mapping of str to InputSignal, optional
        Signals that the unit plays on the external inputs from t = 0 on; by default those of the case, none of a loop.
        An empty mapping plays none.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    EppError
        If the loop is in discrete time, there is no such version, or the file cannot be written.
    ModelError
        If there is no input of that name.

    Examples
    --------
    >>> import tempfile
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     epp.to_fmu(loop, f"{folder}/loop.fmu").name
    'loop.fmu'
    """
    if version not in (2, 3):
        raise EppError(f"to_fmu: version is {version}; expected 2 or 3.")
    system = system_of(loop, "to_fmu")
    if system.time_step:
        raise EppError(f"to_fmu: {system.name} is in discrete time; expected a loop in continuous time.")
    signals = getattr(loop, "input", None) if input is None else input
    given = input_signals_by_name(system.input_names, signals)
    t_end = float(getattr(loop, "t_end", 10.0))
    tables = _tables(_with_offsets(system), given, len(system.input_names))
    token = str(uuid.uuid5(uuid.NAMESPACE_OID, tables.hex()))
    machine, name = _platform(), plain_name(system.name)
    suffix = _SUFFIXES.get(machine.partition("-")[2], ".so")
    folder = machine if version == 3 else _PLATFORMS.get(machine, machine)
    files = {
        "modelDescription.xml": _description(system, token, name, t_end, version),
        "resources/loop.bin": token.encode() + tables,
        f"binaries/{folder}/{name}{suffix}": _library().read_bytes(),
    }
    with (
        atomic(Path(path)) as part,
        at_once(part) as stream,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as unit_file,
    ):
        for place, content in files.items():
            unit_file.writestr(zipfile.ZipInfo(place, _DATE), content, zipfile.ZIP_DEFLATED)
    return Path(path)


def _library() -> Path:
    """The library beside the engine that was built with it."""
    return next(Path(str(_engine.__file__)).parent.glob("_fmu.*"))


def _platform() -> str:
    """Processor and system, as FMI 3 calls them."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{platform.system().lower()}"


def _with_offsets(system: LureSystem) -> LureSystem:
    """The loop with each external input a second time, for an offset beside what its signal does."""
    s, names = system.signals, list(system.input_names)
    for name in system.input_names:
        names.append(free_name(name, names))
    return replace(
        system,
        B_input=np.hstack([system.B_input] * 2),
        D_input=np.hstack([system.D_input] * 2),
        input_names=tuple(names),
        v0=np.append(system.v0, np.zeros(len(system.v0))),
        signals=replace(s, D_input=np.hstack([s.D_input] * 2)),
        given=None,
    )


def _tables(system: LureSystem, given: Mapping[str, InputSignal], n_inputs: int) -> bytes:
    """All arrays that the run of the engine takes, as `fmu.cpp` reads them; the last inputs are those of the unit."""
    hybrid = HybridSystem.from_lure(system, given)
    model, n, n_H = hybrid.model, hybrid.x0.size, hybrid.H0.size
    base = 2.0 * hybrid.time_scale
    last = np.arange(n_inputs) - n_inputs
    tables = (
        model,
        *make_workspaces(model),
        map(np.zeros_like, make_samples(np.zeros(1), model.Yx.shape[0])),
        map(np.zeros_like, make_event_buffer(1, n, n_H, hybrid.modes0.size)),
    )
    now = make_progress(0.0, base, _ANY_NUMBER)
    start = hybrid.x0, hybrid.H0, hybrid.modes0, n + last, n_H - 1 + last, without_memory(hybrid)
    return b"".join([*(_written(array) for table in tables for array in table), now.tobytes(), *map(_written, start)])


def _written(array: NDArray[Any]) -> bytes:
    """Lengths of an array, whether its numbers follow, and these where they are not all zero."""
    given = bool(np.any(array))
    return struct.pack(f"={array.ndim + 1}q", *array.shape, given) + (array.tobytes() if given else b"")


def _variables(system: LureSystem) -> Iterator[tuple[str, dict[str, str], dict[str, str]]]:
    """Name of each variable, what it is, and its unit and start, in the order of the references."""
    signals, names = system.signals, system.input_names
    for name, row in zip(names, np.eye(len(names)), strict=True):
        about = {"causality": "input", "variability": "continuous"}
        yield free_name(f"{name}_offset", signals.names), about, {"unit": signals.unit_of(v=row), "start": "0"}
    for name, unit in signals.units_by_name().items():
        yield name, {"causality": "output", "variability": "continuous", "initial": "calculated"}, {"unit": unit}


def _description(system: LureSystem, token: str, identifier: str, t_end: float, version: int) -> bytes:
    """The model description of either version."""
    add = ElementTree.SubElement
    root = ElementTree.Element("fmiModelDescription", fmiVersion=f"{version}.0", modelName=system.name)
    root.set("guid" if version == 2 else "instantiationToken", token)
    root.set("description", f"Runs on {_platform()}. Inputs are offsets and held over a communication step.")
    root.set("generationTool", "eppanalysis")
    add(root, "CoSimulation", modelIdentifier=identifier, canHandleVariableCommunicationStepSize="true")
    listed = list(_variables(system))
    definitions = ElementTree.Element("UnitDefinitions")
    for name in sorted({own["unit"] for *_, own in listed if own["unit"]}):
        unit = add(definitions, "Unit", name=name)
        with suppress(units.QuantityError):  # a name that no one else knows
            powers = units.dimensions(name)
            add(unit, "BaseUnit", {own: str(powers[base]) for own, base in BASE_UNITS.items() if base in powers})
    root.extend([definitions] if len(definitions) else [])
    add(root, "DefaultExperiment", startTime="0", stopTime=repr(t_end))
    variables, structure = add(root, "ModelVariables"), add(root, "ModelStructure")
    for k, (name, about, more) in enumerate(listed):
        own = {key: value for key, value in more.items() if value}
        if version == 2:
            add(add(variables, "ScalarVariable", about, name=name, valueReference=str(k)), "Real", own)
        else:
            add(variables, "Float64", about | own, name=name, valueReference=str(k))
    outputs = [k for k, (_, about, _) in enumerate(listed) if about["causality"] == "output"]
    if version == 2:
        for kind in ("Outputs", "InitialUnknowns") if outputs else ():
            of = add(structure, kind)
            for k in outputs:
                add(of, "Unknown", index=str(k + 1))
    else:
        name = free_name("time", [name for name, *_ in listed])
        about = {"name": name, "causality": "independent", "variability": "continuous"}
        add(variables, "Float64", about, valueReference=str(len(listed)))
        for kind in ("Output", "InitialUnknown"):
            for k in outputs:
                add(structure, kind, valueReference=str(k))
    ElementTree.indent(root)
    return ElementTree.tostring(root, "utf-8", xml_declaration=True)
