"""Where the results of a sweep are kept: in memory, or in a Zarr folder that grows block by block.

A block counts as done only when its mark is there; the mark is written after all its numbers, and every file takes its
place in one step. So a sweep may be killed at any moment and go on later. Only one process writes: the one that was
asked for the sweep.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import product
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.models.signals import Recorded, Steps
from eppanalysis.sweep.axes import Design
from eppanalysis.sweep.verbs import Columns, Task, Variable

if TYPE_CHECKING:
    import xarray
    import zarr

Bounds = tuple[tuple[int, int], ...]
_MARK, _FORMAT = "eppanalysis_sweep", 1
_DONE = "progress/done"


class MemoryStore:
    """Results in memory."""

    def __init__(self, task: Task, design: Design, attributes: Mapping[str, Any], chunk: int) -> None:
        self.design, self.attributes = design, dict(attributes)
        self.variables = task.variables()
        self.blocks = block_shape(design.shape, chunk)
        self.values = {name: np.full(design.shape, v.fill, _memory_type(v)) for name, v in self.variables.items()}

    def pending(self) -> list[Bounds]:
        """Blocks that are still to be computed."""
        return list(_all_bounds(self.design.shape, self.blocks))

    def write(self, bounds: Bounds, columns: Columns) -> None:
        """Keep the results of a block."""
        place = tuple(slice(*b) for b in bounds)
        for name, values in columns.items():
            self.values[name][place] = values.reshape([stop - start for start, stop in bounds])

    def dataset(self) -> xarray.Dataset:
        """All results."""
        import xarray

        names = [d.name for d in self.design.dimensions]
        data = {name: (names, values, self.variables[name].attributes()) for name, values in self.values.items()}
        return xarray.Dataset(data, coords=_coordinates(self.design, self.attributes), attrs=_plain(self.attributes))


class ZarrStore:
    """Results in a Zarr folder."""

    def __init__(
        self, path: Path, task: Task, design: Design, attributes: Mapping[str, Any], chunk: int, resume: bool
    ) -> None:
        self.path, self.design, self.variables = path, design, task.variables()
        self.identity = identity(task, design)
        self.done: Any = None
        if path.exists() and not path.is_dir():
            raise EppError(f"{path}: is a file and is no store of a sweep; expected another name.")
        with _writing(path):
            if not path.exists() or (path.is_dir() and not any(path.iterdir())):
                part = path.with_name(f".{path.name}.part")
                try:
                    self._create(part, attributes, block_shape(design.shape, chunk))
                except OSError:
                    shutil.rmtree(part, ignore_errors=True)
                    raise
            self._open(resume)

    def _create(self, part: Path, attributes: Mapping[str, Any], blocks: tuple[int, ...]) -> None:
        """The empty store, made beside its place as `part` and moved there in one step."""
        import zarr

        shutil.rmtree(part, ignore_errors=True)
        names = tuple(d.name for d in self.design.dimensions)
        group = zarr.open_group(str(part), mode="w-", zarr_format=3)
        for name, variable in self.variables.items():
            array = group.create_array(
                name,
                shape=self.design.shape,
                chunks=blocks,
                dtype=str if variable.dtype == "text" else variable.dtype,
                fill_value=variable.fill,
                dimension_names=names,
            )
            array.attrs.update(variable.attributes())
        for name, (dims, values, attrs) in _coordinates(self.design, attributes).items():
            array = group.create_array(name, data=np.asarray(values), chunks=(len(values),), dimension_names=dims)
            array.attrs.update(attrs)
        counts = tuple(-(-n // b) for n, b in zip(self.design.shape, blocks, strict=True))
        group.create_array(_DONE, shape=counts, chunks=(1,) * len(counts), dtype="i1", fill_value=0)
        group.attrs.update({**_plain(attributes), _MARK: {"format": _FORMAT, "blocks": blocks, **self.identity}})
        os.rename(part, self.path)

    def _open(self, resume: bool) -> None:
        """The store that is there, if it is of this very sweep."""
        import zarr

        try:
            self.group: zarr.Group = zarr.open_group(str(self.path), mode="r+")
            held: Any = self.group.attrs.asdict()[_MARK]
            self.blocks = tuple(int(b) for b in held["blocks"])
            self.done = self.group[_DONE]
        except (KeyError, ValueError, TypeError, FileNotFoundError, NotADirectoryError) as error:
            raise EppError(f"{self.path}: is there and is no store of a sweep; expected another name.") from error
        for key, what in _PARTS.items():
            if held.get(key) != self.identity[key]:
                changed = _difference(key, held.get(key), self.identity[key])
                raise EppError(
                    f"{self.path}: holds a sweep with {what}{changed}; expected the same sweep, or another name."
                )
        self.arrays: dict[str, Any] = {name: self.group[name] for name in self.variables}
        if not resume and self.done[...].any():
            raise EppError(f"{self.path}: holds results already; expected another name, or to resume.")
        for stale in self.path.rglob("*.partial"):
            stale.unlink(missing_ok=True)

    def pending(self) -> list[Bounds]:
        """Blocks that are still to be computed."""
        done = np.asarray(self.done[...], bool)
        return [
            bounds
            for bounds, ready in zip(_all_bounds(self.design.shape, self.blocks), done.ravel(), strict=True)
            if not ready
        ]

    def write(self, bounds: Bounds, columns: Columns) -> None:
        """Keep the results of a block, and then mark it as done."""
        place = tuple(slice(*b) for b in bounds)
        shape = [stop - start for start, stop in bounds]
        with _writing(self.path):
            for name, values in columns.items():
                if values.dtype == object and not any(values):
                    continue  # empty sentences are what stands there anyway
                self.arrays[name][place] = values.reshape(shape)
            self.done[tuple(start // b for (start, _), b in zip(bounds, self.blocks, strict=True))] = 1

    def dataset(self) -> xarray.Dataset:
        """All results, read from the store when they are used."""
        return open_sweep(self.path)


def open_sweep(path: str | Path) -> xarray.Dataset:
    """The results in a store, finished or not; numbers are read when they are used.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    EppError
        If there is no store of a sweep.
    """
    import xarray
    import zarr

    try:
        facts: Any = zarr.open_group(str(path), mode="r").attrs.asdict()
        order = list(facts[_MARK]["variables"])
        found = xarray.open_zarr(str(path), chunks=None, consolidated=False)
    except (KeyError, ValueError, TypeError, OSError) as error:
        raise EppError(f"{path}: is no store of a sweep; expected one that sweep has made.") from error
    del found.attrs[_MARK]
    return found[order]


_PARTS = {
    "case": "another case",
    "input": "another input",
    "axes": "other axes",
    "verbs": "another run",
    "variables": "other variables",
    "signals": "other signals",
    "version": "another version of eppanalysis",
}


def identity(task: Task, design: Design) -> dict[str, Any]:
    """What makes a sweep the same sweep: case, input, axes, verbs, variables, signals, version."""
    from eppanalysis import __version__

    facts = task.case.provenance()
    motion = task.case.input
    recorded = (
        hashlib.sha256(np.concatenate([motion.times, motion.values]).tobytes()).hexdigest()
        if isinstance(motion, Recorded | Steps)
        else repr(motion)
    )
    axes = {
        f"{d.name}/{name}": [len(values), hashlib.sha256(values.tobytes()).hexdigest()]
        for d in design.dimensions
        for name, values in d.values.items()
    }
    return {
        "case": facts["sha256"],
        "input": recorded,
        "axes": axes,
        "verbs": list(task.verbs),
        "variables": list(task.variables()),
        "signals": list(task.signals),
        "version": __version__,
    }


def _difference(key: str, held: Any, wanted: Any) -> str:
    """Which of several things differs, for a message."""
    if key == "axes" and isinstance(held, dict):
        names = [n for n in dict.fromkeys([*held, *wanted]) if held.get(n) != wanted.get(n)]
        if not names:
            return ""
        return f" ({', '.join(n.partition('/')[2] for n in names)})" if names else ""
    if key in ("version", "verbs", "signals"):
        return f" ({held if isinstance(held, str) else ', '.join(held or [])})"
    return ""


def block_shape(shape: Sequence[int], chunk: int) -> tuple[int, ...]:
    """Shape of the blocks of at most about `chunk` cells that a sweep is cut into."""
    from dask.array.core import normalize_chunks

    cut = normalize_chunks("auto", shape=tuple(shape), limit=8 * max(1, chunk), dtype=np.dtype("f8"))
    return tuple(int(max(sizes)) for sizes in cut)


def cells_in(bounds: Bounds) -> int:
    """Number of cells of a block."""
    return prod(stop - start for start, stop in bounds)


def _all_bounds(shape: Sequence[int], blocks: Sequence[int]) -> Iterator[Bounds]:
    axes = [[(i, min(i + b, n)) for i in range(0, n, b)] for n, b in zip(shape, blocks, strict=True)]
    return product(*axes)


def _memory_type(variable: Variable) -> Any:
    return np.dtypes.StringDType() if variable.dtype == "text" else variable.dtype


def _coordinates(design: Design, attributes: Mapping[str, Any]) -> dict[str, tuple[tuple[str], Any, dict[str, Any]]]:
    units = attributes["units_of_axes"]
    return {
        name: ((d.name,), values, dict(zip(("units", "readable_units", "per_readable_unit"), units[name], strict=True)))
        for d in design.dimensions
        for name, values in d.values.items()
    }


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as texts and numbers, which every file format takes."""
    return {
        k: v if isinstance(v, str | int | float) else json.dumps(v, default=str)
        for k, v in attributes.items()
        if k != "units_of_axes"
    }


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """What the operating system refuses, in one sentence."""
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        raise EppError(
            f"{path}: cannot be written ({why}); expected a place to write to; "
            "what is stored already stays, and the same command goes on from there."
        ) from error
