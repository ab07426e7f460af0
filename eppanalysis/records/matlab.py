"""MAT-files: plain vectors, structures with time, and what ``to_eppanalysis.m`` writes.

MATLAB's objects (timetable, tf, ss, frd) are opaque in its files, of version 5 and 7.3 alike. ``to_eppanalysis.m``,
beside this file, writes each of them as a structure of plain numbers and names, whose field ``kind`` says what it was.
"""

from __future__ import annotations

import math
import struct
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from eppanalysis.errors import CaseError, require_packages
from eppanalysis.records.columns import TIME, Heading
from eppanalysis.records.memory import group
from eppanalysis.records.tables import Group, Groups

#: Numbers that the variables of a file may hold, and levels of structures within structures.
_MOST, _DEEPEST = 200_000_000, 6
#: Types of elements of version 5.
_ELEMENTS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 14, 15, 16, 17, 18}
#: What variables with times are called, and the function that writes what MATLAB keeps to itself.
_TIMES = (TIME, "t", "tout", "seconds")
_WRITER = "numbers, as to_eppanalysis.m (in eppanalysis/records) writes a timetable, tf, ss or frd"


class Opaque:
    """In place of an object that only MATLAB can read."""


def mat(path: Path, source: str) -> Groups:
    """Signals of a MAT-file: one group a structure or set of vectors with times; or a frequency response.

    Raises
    ------
    CaseError
        If it has neither, or an object of MATLAB in place of them.
    """
    found = variables(path, source)
    written = [v for v in found.values() if isinstance(v, Mapping) and v.get("kind") in ("timetable", "frd")]
    if written and written[0]["kind"] == "frd":
        return Groups(source, [_response(written[0], source)], None)
    groups = [_timetable(v, source) for v in written]
    others = {name: v for name, v in found.items() if not any(v is w for w in written)}
    structures = {name: v for name, v in others.items() if isinstance(v, Mapping)}
    groups += filter(None, (_timed(v, name) for name, v in structures.items()))
    groups += filter(None, [_timed(others, "")])
    if not groups:
        opaque = any(isinstance(v, Opaque) for v in found.values())
        shown = "an object of MATLAB" if opaque else ", ".join(found) or "empty"
        expected = _WRITER if opaque else "a vector 'time' and vectors as long, alone or in a structure"
        raise CaseError(source, "", shown, expected)
    return Groups(source, groups)


def _timetable(written: Mapping[str, Any], source: str) -> Group:
    values = np.atleast_2d(np.asarray(written["values"], float))
    names = texts(written.get("names"))
    units = texts(written.get("units")) or [""] * len(names)
    if len(names) != values.shape[1] or len(units) != len(names):
        raise CaseError(source, "names", f"{len(names)} long", f"{values.shape[1]}, one for each column of values")
    headings = [Heading.of(name, unit) for name, unit in zip(names, units, strict=True)]
    return group(headings, np.ravel(written[TIME]), list(values.T))


def _response(written: Mapping[str, Any], source: str) -> Group:
    """The columns of a frequency response, as a table of one has them."""
    omega = np.ravel(written["frequency"])
    response = np.atleast_3d(np.asarray(written["response"]))
    if response.shape[2] != omega.size:
        raise CaseError(source, "response", f"of shape {response.shape}", f"{omega.size} values in its third direction")
    headings, values = [Heading.of("frequency", "rad/s")], [omega]
    single = response.shape[:2] == (1, 1)
    for i, j in np.ndindex(response.shape[:2]):
        for name, part in (("real", response[i, j].real), ("imaginary", response[i, j].imag)):
            headings.append(Heading.of(name if single else f"{name} {i + 1}/{j + 1}"))
            values.append(part)
    return group(headings, None, values)


def _timed(found: Mapping[str, Any], name: str) -> Group | None:
    """Vectors, or columns of matrices, that are as long as those that hold times."""
    time = next((np.ravel(v) for n, v in found.items() if n.lower() in _TIMES and _is_vector(v)), None)
    if time is None:
        return None
    signals = found.get("signals")  # of Simulink's "structure with time"
    signals = signals if isinstance(signals, list) else [signals] if isinstance(signals, Mapping) else []
    labelled = {str(s.get("label") or f"signal{i}"): s.get("values") for i, s in enumerate(signals, start=1)}
    headings: list[Heading] = []
    values: list[Any] = []
    for own, value in {**found, **labelled}.items():
        if own.lower() in _TIMES or not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            continue
        if value.size and value.size % time.size == 0 and time.size in value.shape:
            columns = (value if len(value) == time.size else value.T).reshape(time.size, -1).T
            headings += [Heading.of(own if len(columns) == 1 else f"{own}[{k}]") for k in range(1, len(columns) + 1)]
            values += [*columns]
    return group(headings, time, values, name) if values else None


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size == max(value.shape, default=0) > 1


def texts(value: Any) -> list[str]:
    """A cell of texts, or one text."""
    return [str(v) for v in value] if isinstance(value, list) else [value] if isinstance(value, str) and value else []


def variables(path: Path, source: str) -> dict[str, Any]:
    """The variables of a MAT-file as arrays, texts, lists (cells, arrays of structures) and mappings (structures).

    Raises
    ------
    CaseError
        If it holds more numbers than may be.
    """
    with path.open("rb") as stream:
        begin = stream.read(520)
    if begin[:19] == b"MATLAB 7.3 MAT-file" or begin[512:516] == b"\x89HDF" or begin[:4] == b"\x89HDF":
        require_packages(f"{source}: a MAT-file of version 7.3", "records", "h5py")
        import h5py

        with h5py.File(path, "r") as file:
            return {
                str(name): _of_hdf5(file, file.get(name, getlink=True), file, name) for name in file if name[0] != "#"
            }
    from scipy.io import loadmat, whosmat

    if begin[126:128] in (b"IM", b"MI"):
        _require_sound(memoryview(path.read_bytes())[128:], "<" if begin[126:128] == b"IM" else ">")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with suppress(TypeError):  # raised by scipy for the shape that an object of MATLAB lacks
            size = sum(math.prod(shape) for _, shape, _ in whosmat(str(path)))
            if size > _MOST:
                raise CaseError(source, "", f"of {size} numbers", f"at most {_MOST}")
        found = loadmat(str(path), chars_as_strings=True)
    return {name: _of_scipy(value) for name, value in found.items() if name[:2] != "__"}


def _require_sound(elements: memoryview, order: str, depth: int = 0) -> None:
    """Refuse elements of version 5 that scipy would follow out of its memory: of no known type, or without a part."""
    at, found = 0, 0
    is_complex = False
    while at + 8 <= len(elements):
        kind, size = struct.unpack_from(f"{order}II", elements, at)
        small = kind >> 16  # of four bytes or less, which are in the tag itself
        begin, size, kind = (at + 4, small, kind & 0xFFFF) if small else (at + 8, size, kind)
        if kind not in _ELEMENTS or begin + size > len(elements) or depth > 2 * _DEEPEST:
            raise ValueError(f"an element of type {kind} and {size} bytes")
        if kind == 14:
            _require_sound(elements[begin : begin + size], order, depth + 1)
        if depth and not found and size:
            is_complex = bool(struct.unpack_from(f"{order}I", elements, begin)[0] & 0x800)
        found += 1
        at = at + 8 if small else begin + size + (-size % 8 if kind != 15 else 0)
    if depth and 0 < found < 4 + is_complex:
        raise ValueError("an array without all of its parts")


def _of_scipy(value: Any, depth: int = 0) -> Any:
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if isinstance(value, MatlabOpaque | MatlabObject | MatlabFunction) or depth > _DEEPEST:
        return Opaque()
    if isinstance(value, np.ndarray) and value.dtype.names:
        items = [{name: _of_scipy(item[name], depth + 1) for name in value.dtype.names} for item in value.ravel()]
        return items[0] if len(items) == 1 else items
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        return [_of_scipy(item, depth + 1) for item in value.ravel()]
    if isinstance(value, np.ndarray) and value.dtype.kind in "US":
        return str(value.ravel()[0]) if value.size == 1 else ""
    return value


def _of_hdf5(parent: Any, link: Any, file: Any, name: str, depth: int = 0) -> Any:
    """What MATLAB keeps in a group or data set of HDF5; what lies in another file is not read."""
    import h5py

    return _of_node(parent[name], file, depth) if isinstance(link, h5py.HardLink) else Opaque()


def _of_node(node: Any, file: Any, depth: int) -> Any:
    import h5py

    kind = node.attrs.get("MATLAB_class", b"")
    if "MATLAB_object_decode" in node.attrs or depth > _DEEPEST:
        return Opaque()
    if isinstance(node, h5py.Group):
        return {str(n): _of_hdf5(node, node.get(n, getlink=True), file, n, depth + 1) for n in node}
    if node.external or node.is_virtual or node.size > _MOST:
        return Opaque()
    value = node[()]
    if "MATLAB_empty" in node.attrs:
        return "" if kind == b"char" else [] if kind == b"cell" else np.empty((0, 0))
    if value.dtype.kind == "O":
        return [_of_node(file[reference], file, depth + 1) for reference in value.T.ravel() if reference]
    if kind == b"char":
        return "".join(map(chr, value.T.ravel()))
    if value.dtype.names and {"real", "imag"} <= set(value.dtype.names):
        value = value["real"] + 1j * value["imag"]
    return np.asarray(value).T  # MATLAB counts columns first


def linear_part(path: Path, source: str) -> Mapping[str, Any]:
    """The structure of a linear system that ``to_eppanalysis.m`` wrote.

    Raises
    ------
    CaseError
        If there is none.
    """
    found = variables(path, source)
    for value in found.values():
        if isinstance(value, Mapping) and value.get("kind") in ("tf", "ss"):
            return value
    raise CaseError(source, "", f"without tf or ss ({', '.join(found) or 'empty'})", _WRITER)
