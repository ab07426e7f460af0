"""Where the results of a sweep are kept: in memory, or in a Zarr folder that grows block by block.

A block counts as done only when its mark is there; the mark is written after all its numbers are on the disk, and every
file takes its place in one step. So a sweep may be killed at any moment and go on later. The mark holds digests of what
the block has written, the sheet those of everything else: what was damaged since is computed, or made, anew, and is
never read. Only one process writes: the one that runs the sweep, which holds the store's lock.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from itertools import product
from math import prod
from pathlib import Path
from threading import Semaphore
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.models.systems.inputs import Recorded, Steps
from eppanalysis.readable import count
from eppanalysis.sweep import integrity
from eppanalysis.sweep.analyses import Columns, Task, Variable
from eppanalysis.sweep.axes import Design
from eppanalysis.sweep.code import code_digest

if TYPE_CHECKING:
    import xarray

Bounds = tuple[tuple[int, int], ...]
_FORMAT = 2
#: Threads that write blocks and bring them to the disk: a disk takes several at once.
_KEEPERS = 4
#: What stores of the first form, which had no digests, hold in their attributes.
_FIRST_FORM = b'"eppanalysis_sweep"'


class MemoryStore:
    """Results in memory."""

    def __init__(self, task: Task, design: Design, attributes: Mapping[str, Any], chunk: int) -> None:
        self.design, self.attributes = design, dict(attributes)
        self.variables = task.variables()
        self.blocks = block_shape(design.shape, chunk)
        self.values = {name: np.full(design.shape, v.fill, _memory_type(v)) for name, v in self.variables.items()}

    def pending(self) -> list[Bounds]:
        """Blocks that are still to be computed."""
        return list(all_bounds(self.design.shape, self.blocks))

    def write(self, bounds: Bounds, columns: Columns) -> None:
        """Keep the results of a block."""
        place = tuple(slice(*b) for b in bounds)
        for name, values in columns.items():
            self.values[name][place] = values.reshape([stop - start for start, stop in bounds])

    def close(self) -> None:
        """Nothing to let go."""

    def notice(self) -> str:
        """Nothing to report."""
        return ""

    def dataset(self) -> xarray.Dataset:
        """All results."""
        import xarray

        names = [d.name for d in self.design.dimensions]
        data = {name: (names, values, self.variables[name].attributes()) for name, values in self.values.items()}
        return xarray.Dataset(data, coords=_coordinates(self.design, self.attributes), attrs=_plain(self.attributes))


class ZarrStore:
    """Results in a Zarr folder.

    Attributes
    ----------
    damaged : int
        Blocks that were finished once and are no longer as they were written.
    """

    def __init__(
        self, path: Path, task: Task, design: Design, attributes: Mapping[str, Any], chunk: int, resume: bool
    ) -> None:
        self.path, self.design, self.attributes, self.variables = path, design, attributes, task.variables()
        self.identity = identity(task, design)
        self.damaged = 0
        _refuse_what_is_no_store(path)
        slashed = (n for n in (*self.variables, *(n for d in design.dimensions for n in d.values)) if "/" in n)
        if (name := next(slashed, None)) is not None:
            expected = "a table (.nc), or another name in the case file"
            raise EppError(f"{path}: cannot hold {name!r}, as a slash separates folders there; expected {expected}.")
        with _writing(path):
            ours = not path.exists()
            (path / integrity.PROGRESS).mkdir(parents=True, exist_ok=True)
            self._lock = integrity.Lock(path)
            # Bringing numbers to the disk takes longer than computing them at times: the next block need not wait. But
            # what is not marked yet stays little, as an end waits for it and a kill loses it.
            self._keeper, self._failure = ThreadPoolExecutor(_KEEPERS), list[BaseException]()
            self._room = Semaphore(2 * _KEEPERS)
            try:
                self._open(block_shape(design.shape, chunk), resume)
            except BaseException:
                if ours and not (path / integrity.SHEET).exists():
                    shutil.rmtree(path, ignore_errors=True)
                self.close()
                raise

    def close(self) -> None:
        """Write and mark what is still to be kept, and let others write.

        Raises
        ------
        EppError
            If a block or its mark cannot be written.
        """
        self._keeper.shutdown()
        self._lock.release()
        with _writing(self.path):
            self._fail()

    def _open(self, blocks: tuple[int, ...], resume: bool) -> None:
        """The store that is there, if it is of this very sweep, made whole; or an empty one."""
        import zarr

        sheet = _read_sheet(self.path)
        if sheet is not None:
            self._compare(sheet)
            blocks = tuple(sheet["blocks"])
        self.blocks, self.stamp = blocks, _stamp(blocks, self.identity)
        marked = [key for key in map(self._key, self._bounds()) if (self.path / integrity.DONE / key).exists()]
        names = tuple(self.variables)
        # A mark says that a block was written; what is there now may be damaged, and is held against its digests.
        self.whole = {key for key in marked if integrity.is_whole(self.path, key, self.stamp, names)}
        self.damaged = len(marked) - len(self.whole)
        if marked and not resume:
            raise EppError(f"{self.path}: holds results already; expected another name, or to resume.")
        if sheet is None and not self.whole and any((self.path / integrity.DONE).rglob("*")):
            raise EppError(
                f"{self.path}: {integrity.SHEET} is damaged, and no block shows whose results these are; "
                "expected another name."
            )
        if sheet is None or _damaged_file(self.path, sheet):
            self._lay_out()
        for stale in self.path.rglob("*.partial"):
            stale.unlink(missing_ok=True)
        group = zarr.open_group(str(self.path), mode="r+")
        self.arrays: dict[str, Any] = {name: group[name] for name in self.variables}

    def _compare(self, held: Mapping[str, Any]) -> None:
        """Refuse a store of another sweep."""
        for key, what in _PARTS.items():
            if held.get(key) != self.identity.get(key):
                changed = _difference(key, held.get(key), self.identity.get(key))
                raise EppError(
                    f"{self.path}: holds a sweep with {what}{changed}; expected the same sweep, or another name."
                )

    def _lay_out(self) -> None:
        """Everything but the blocks, made aside and moved to its place file by file, and then the sheet."""
        import zarr
        from zarr.codecs import Crc32cCodec, ZstdCodec

        part = self.path / integrity.PROGRESS / "part"
        shutil.rmtree(part, ignore_errors=True)
        names = tuple(d.name for d in self.design.dimensions)
        codecs = (ZstdCodec(), Crc32cCodec())
        group = zarr.open_group(str(part), mode="w-", zarr_format=3)
        for name, variable in self.variables.items():
            array = group.create_array(
                name,
                shape=self.design.shape,
                chunks=self.blocks,
                dtype=str if variable.dtype == "text" else variable.dtype,
                fill_value=variable.fill,
                dimension_names=names,
                compressors=codecs,
            )
            array.attrs.update(variable.attributes())
        for name, (dims, values, attrs) in _coordinates(self.design, self.attributes).items():
            array = group.create_array(
                name, data=np.asarray(values), chunks=(len(values),), dimension_names=dims, compressors=codecs
            )
            array.attrs.update(attrs)
        group.create_group(integrity.PROGRESS)
        group.attrs.update(_plain(self.attributes))
        digests = {}
        for file in sorted(f for f in part.rglob("*") if f.is_file()):
            name = file.relative_to(part).as_posix()
            digests[name] = integrity.file_digest(file, on_disk=True)
            (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            file.replace(self.path / name)
        shutil.rmtree(part)
        facts = {"format": _FORMAT, "blocks": self.blocks, **self.identity, "files": digests}
        # The sheet comes last: where it is missing, or a file is
        # not as it says, the next call lays all of this out anew.
        integrity.write_sheet(self.path / integrity.SHEET, _SHEET_PLACE, facts)

    def _bounds(self) -> Iterator[Bounds]:
        return all_bounds(self.design.shape, self.blocks)

    def _key(self, bounds: Bounds) -> str:
        """Name of the files of a block."""
        return "/".join(str(start // b) for (start, _), b in zip(bounds, self.blocks, strict=True))

    def pending(self) -> list[Bounds]:
        """Blocks that are still to be computed, or again."""
        return [bounds for bounds in self._bounds() if self._key(bounds) not in self.whole]

    def take_over(self, other: Path) -> None:
        """Copy the blocks that are missing here and finished in a store of the same sweep.

        Raises
        ------
        EppError
            If the other store is of another sweep, or in other blocks.
        """
        with _reading(other):
            sheet = _read_sheet(other)
        if sheet is None:
            raise EppError(f"{other}: {integrity.SHEET} is damaged or missing; expected a share of {self.path}.")
        stamp = _stamp(sheet["blocks"], _identity_in(sheet))
        if stamp != self.stamp:
            raise EppError(f"{other}: holds another sweep, or blocks of another size; expected a share of {self.path}.")
        names = tuple(self.variables)
        for key in map(self._key, self.pending()):
            if integrity.is_whole(other, key, stamp, names):
                with _writing(self.path):
                    for name in names:
                        _copy_file(other / name / "c" / key, self.path / name / "c" / key)
                    integrity.write_mark(self.path, key, stamp, names)
                if integrity.is_whole(self.path, key, stamp, names):  # the other may have been written meanwhile
                    self.whole.add(key)

    def write(self, bounds: Bounds, columns: Columns) -> None:
        """Keep the results of a block while the next one is computed; it is marked as done when they are on the disk.

        Raises
        ------
        EppError
            If a block before it cannot be written.
        """
        with _writing(self.path):
            self._fail()
        self._room.acquire()
        self._keeper.submit(self._keep, bounds, columns)

    def _keep(self, bounds: Bounds, columns: Columns) -> None:
        place, key = tuple(slice(*b) for b in bounds), self._key(bounds)
        shape = [stop - start for start, stop in bounds]
        try:
            for name, values in columns.items():
                # What is there may be torn, and nothing is written where it is what an empty block has anyway.
                (self.path / name / "c" / key).unlink(missing_ok=True)
                if values.dtype != object or any(values):
                    self.arrays[name][place] = values.reshape(shape)
            self._mark(key)
        except BaseException as error:
            self._failure.append(error)
        finally:
            self._room.release()

    def _mark(self, key: str) -> None:
        """Mark a block as finished when all its numbers are on the disk."""
        integrity.write_mark(self.path, key, self.stamp, tuple(self.variables))

    def _fail(self) -> None:
        """Raise what went wrong with a block."""
        if self._failure:
            raise self._failure[0]

    def notice(self) -> str:
        """What was found damaged, as a sentence; empty where nothing was."""
        if not self.damaged:
            return ""
        return f"{self.path}: {count(self.damaged, 'block')} damaged since stored, computed again."

    def dataset(self) -> xarray.Dataset:
        """All results, read from the store when they are used."""
        return open_sweep(self.path)


def open_sweep(path: str | Path) -> xarray.Dataset:
    """The results in a store, finished or not; numbers are read, and checked, when they are used.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    EppError
        If there is no store of a sweep, or it is damaged; what is damaged of its numbers is refused when it is read.
    """
    import xarray

    if not isinstance(path, str | Path):
        raise EppError(f"open_sweep: path is {path!r}; expected the name of a store.")
    path = Path(path)
    with _reading(path):
        sheet = _read_sheet(path) if path.is_dir() else None
        if sheet is None:
            _refuse_what_is_no_store(path)
            known = (path / integrity.SHEET).exists() or (path / integrity.LOCK).exists()
            raise EppError(f"{path}: {integrity.SHEET} is damaged; {integrity.REMEDY}." if known else _no_store(path))
        damaged = _damaged_file(path, sheet)
        if damaged:
            raise EppError(f"{path}: {damaged} is damaged; {integrity.REMEDY}.")
        stamp = _stamp(sheet["blocks"], _identity_in(sheet))
        store = integrity.CheckedStore(path, sheet["variables"], stamp)
        return xarray.open_zarr(store, chunks=None, consolidated=False)[sheet["variables"]]


def _copy_file(source: Path, target: Path) -> None:
    """A file of another store in one step; none where that has none."""
    target.unlink(missing_ok=True)
    if source.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = target.with_name(f"{target.name}.partial")
        shutil.copyfile(source, partial)
        partial.replace(target)


def _refuse_what_is_no_store(path: Path) -> None:
    """Leave alone what is there and is something else."""
    if path.exists() and not path.is_dir():
        raise EppError(f"{path}: is a file and is no store of a sweep; expected another name.")
    with _reading(path):
        if not path.exists() or not any(path.iterdir()) or any((path / f).exists() for f in _OURS):
            return
        if [entry.name for entry in path.rglob("*")] == [integrity.PROGRESS]:  # another process has just begun it
            return
        with suppress(FileNotFoundError):
            if _FIRST_FORM in (path / "zarr.json").read_bytes():
                raise EppError(
                    f"{path}: is a store of an earlier form, without digests; expected another name "
                    "(xarray.open_zarr reads it)."
                )
    raise EppError(f"{path}: is there and is no store of a sweep; expected another name.")


def _no_store(path: Path) -> str:
    return f"{path}: is no store of a sweep; expected one that sweep has made."


def _read_sheet(path: Path) -> dict[str, Any] | None:
    return integrity.read_sheet(path / integrity.SHEET, _SHEET_PLACE)


def _damaged_file(path: Path, sheet: Mapping[str, Any]) -> str:
    """The first file but those of the blocks that is not as it was written; empty where all are."""
    return next((name for name, held in sheet["files"].items() if integrity.file_digest(path / name) != held), "")


def _stamp(blocks: Sequence[int], identity: Mapping[str, Any]) -> str:
    """What marks the blocks of this very sweep, cut like this."""
    return integrity.digest_of([_FORMAT, list(blocks), identity])


_SHEET_PLACE = "sheet"
#: A folder that has one of these is, or was, a store.
_OURS = (integrity.SHEET, integrity.LOCK, integrity.DONE)

_PARTS = {
    "case": "another case",
    "input": "another input",
    "axes": "other axes",
    "analyses": "another run",
    "variables": "other variables",
    "signals": "other signals",
    "allowed": "another limit cycle allowed",
    "version": "another version of eppanalysis",
    "code": "other code of eppanalysis, or another numpy or scipy",
}


def identity(task: Task, design: Design) -> dict[str, Any]:
    """What makes a sweep the same sweep: case, input, axes, analyses, variables, signals, version, code."""
    from eppanalysis import __version__

    facts = task.case.provenance()
    input_signal = task.case.input
    recorded = (
        hashlib.sha256(np.concatenate([input_signal.times, input_signal.values]).tobytes()).hexdigest()
        if isinstance(input_signal, Recorded | Steps)
        else repr(input_signal)
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
        "analyses": list(task.analyses),
        "variables": list(task.variables()),
        "signals": list(task.signals),
        # Only where there is one: stores made before sweeps knew it are what they were.
        **({} if task.allowed is None else {"allowed": task.allowed.to_dict()}),
        # Another version may compute other numbers, and so may other code of the same version.
        "version": __version__,
        "code": code_digest(),
    }


def _identity_in(sheet: Mapping[str, Any]) -> dict[str, Any]:
    """What makes the sweep of a sheet the same sweep."""
    return {key: sheet[key] for key in _PARTS if key in sheet}


def _difference(key: str, held: Any, wanted: Any) -> str:
    """Which of several things differs, for a message."""
    if key == "axes" and isinstance(held, dict):
        names = [n for n in dict.fromkeys([*held, *wanted]) if held.get(n) != wanted.get(n)]
        return f" ({', '.join(n.partition('/')[2] for n in names)})" if names else ""
    if key in ("version", "analyses", "signals"):
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


def all_bounds(shape: Sequence[int], blocks: Sequence[int]) -> Iterator[Bounds]:
    """All blocks of a grid, in their order."""
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
            f"{path}: cannot be written ({why}); expected a place to write to; stored cells stay, and the same command "
            "continues."
        ) from error


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """What the operating system does not let one read, in one sentence."""
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        raise EppError(f"{path}: cannot be read ({why}); expected a store of a sweep.") from error
