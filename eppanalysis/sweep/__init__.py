"""Sweeps: any analysis over any grid or sample of a case, on one core, on all, or on a cluster, with the same
numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eppanalysis.cases import Case, as_case
from eppanalysis.errors import ArgumentError, require_packages
from eppanalysis.progress import progress_bar, steps
from eppanalysis.sweep.axes import Axes, LatinHypercube, Sobol, Tolerances, Zipped, make_design

if TYPE_CHECKING:
    import xarray

    from eppanalysis.models.systems.lure import LureSystem
    from eppanalysis.sweep.analyses import Task
    from eppanalysis.sweep.axes import Design
    from eppanalysis.sweep.estimate import Cost
    from eppanalysis.sweep.store import Bounds, MemoryStore, ZarrStore

__all__ = ["LatinHypercube", "Sobol", "Tolerances", "Zipped", "open_sweep", "sweep", "sweep_cost"]

#: Cells of a block: few enough that all cores have work and a kill costs little (a second or two), enough that files
#: stay few and storing them costs little.
_QUICK, _SLOW, _FEWEST_BLOCKS, _MOST_BLOCKS = 500, 8, 32, 2000
#: Cells, of runs and of anything else, from which on what the sweep will cost is said before it begins.
_MANY_RUNS, _MANY = 100_000, 500


def sweep(
    case: Case | LureSystem,
    axes: Axes,
    run: str | Sequence[str] = "simulate",
    *,
    signals: str | Sequence[str] | None = None,
    allow: str | None = None,
    scheduler: str = "threads",
    workers: int | None = None,
    chunk: int | None = None,
    store: str | Path | None = None,
    resume: bool = True,
    shard: str | tuple[int, int] | None = None,
    merge: bool = False,
    progress: bool = True,
) -> xarray.Dataset:
    """Run analyses in every cell of a grid or sample of a case.

    The numbers depend on case, axes and analyses alone: they are the same to the last bit from threads, processes and a
    cluster, and for any size of chunks.

    Parameters
    ----------
    case : Case or LureSystem
    axes : mapping of str to axis, Zipped, LatinHypercube, Sobol or Tolerances
        An axis is a list of quantities (["1 deg", "2 deg"]; plain numbers are in SI units) or "start:stop:count:unit".
        A mapping is a grid, each axis a dimension of its own.
    run : {"simulate", "predict", "cycles", "trigger", "certify"}, several of them, or "all"
        Runs in time from the case's start until ``case.t_end``; describing functions; exact orbits; what starts them;
        what is proved, which needs the extra "proof" and is left out of "all". With "simulate" and "predict" together
        the describing function's error is reported.
    signals : str or sequence of str, optional
        Signals whose peak to peak and mean are reported, the first one under plain names; by default that of `allow`,
        else the case's own one. "all" for every signal.
    allow : str, optional
        A limit cycle that is allowed, as :func:`design_bounds` takes it ("theta 0.3 deg"). Cells then also have their
        `size`, and in `allowed` whether they settle, have stable cycles within what is allowed, or exceed it. Runs have
        sizes by 512 samples of a period, exact orbits exact extrema and the rms of their 256 samples, predictions those
        of a sinusoid.
    scheduler : str
        "threads" (the engine releases the interpreter's lock), "processes", a queueing system whose jobs are the
        workers ("slurm", "pbs", "lsf", "sge", "oar", "moab", "htcondor"; needs dask-jobqueue), or the address of an
        existing ``dask.distributed`` scheduler such as ``tcp://host:8786``.
    workers : int, optional
        Threads or processes; by default one for each core. Workers requested from a queue; by default one. A cluster
        at an address has its own.
    chunk : int, optional
        Cells computed and stored together; chosen from the number of cells by default. A store keeps its own.
    store : str or Path, optional
        Zarr folder that results are written to, chunk by chunk as they are finished. By default they are in memory.
    resume : bool
        Whether a store of the same sweep that is there already goes on where it was; else it is refused.
    shard : str or (int, int), optional
        Compute this share of the sweep alone, "3/8" for the third of eight, in a store of its own beside `store`
        (`map.3-of-8.zarr` for `map.zarr`); its other cells are "not_run".
    merge : bool
        Compute nothing: take over into `store` what is finished in the shares beside it. Cells that no share has
        finished are "not_run"; joining again later goes on.
    progress : bool
        Show cells, rate and time left (on a terminal or in a notebook).

    Returns
    -------
    xarray.Dataset
        One variable for each result over the dimensions of the sweep, in SI units; ``status`` of every cell with its
        sentences as attribute, ``message`` of those that failed. Read lazily where there is a store.

    Raises
    ------
    EppError
        If an axis, analysis, signal, scheduler or number is not valid, the store is of another sweep or cannot be
        written, there are no shares to be joined, or Dask and Zarr are not installed.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> found = epp.sweep(
    ...     epp.case("fig8a_original"),
    ...     {"lock_pin.backlash": "0.5:2.5:2:deg"},
    ...     progress=False,
    ... )
    >>> found["outcome"].values.tolist(), found["outcome"].attrs["flag_meanings"]
    ([1, 2], 'unknown settles oscillates diverges')
    >>> [round(float(f), 2) for f in found["frequency"]]
    [nan, 8.97]

    In which of three gaps does a servo stay within what is allowed?

    >>> gaps = {"play.gap": [0.2, 0.25, 0.26]}
    >>> found = epp.sweep(
    ...     epp.case("backlash_servo"), gaps, "cycles", allow="x 0.5", progress=False
    ... )
    >>> found["exact_size"].values.round(3).tolist()
    [0.392, 0.49, 0.51]
    >>> found["exact_allowed"].values.tolist()
    [2, 2, 3]
    """
    case = as_case(case)
    require_packages("sweep", "sweep", "dask", "filelock", "zarr")
    from eppanalysis.sweep.analyses import make_task
    from eppanalysis.sweep.schedule import run_blocks
    from eppanalysis.sweep.store import cells_in

    design = make_design(case, axes)
    task = make_task(case, axes, run, signals, allow)
    kept, mine = _store(task, design, _chunk(design, task, chunk), store, resume, shard, merge)
    with closing(kept):
        blocks = [] if merge else kept.pending()
        if mine is not None:
            blocks = [bounds for bounds in blocks if bounds in mine]
        missing = sum(map(cells_in, blocks))
        n = design.n_cells if mine is None else sum(map(cells_in, mine))
        if progress and (notice := kept.notice()):
            _tell(notice)
        if progress and missing >= (_MANY_RUNS if _only_runs(task) else _MANY):
            _tell(str(_cost(task, missing)))
        bar = (
            progress_bar("cells", n, n - missing, unit="cells", keep=True) if progress and not merge else nullcontext()
        )
        with bar as advance:
            run_blocks(task, blocks, kept, scheduler, workers, steps(advance, n, n - missing))
    return kept.dataset()


def sweep_cost(
    case: Case | LureSystem,
    axes: Axes,
    run: str | Sequence[str] = "simulate",
    *,
    signals: str | Sequence[str] | None = None,
    allow: str | None = None,
) -> Cost:
    """What a sweep will cost in processor time, from a sample of its cells; a few seconds.

    Parameters
    ----------
    case, axes, run, signals, allow
        As :func:`sweep` takes them.

    Returns
    -------
    Cost
        Core hours of all cells, and how much the sample's cells differ.

    Raises
    ------
    EppError
        If an axis, analysis or signal, or what is allowed, is not valid.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> cost = epp.sweep_cost(
    ...     epp.case("fig8a_original"), {"lock_pin.backlash": "0.5:2.5:1000:deg"}
    ... )
    >>> cost.cells, cost.core_hours < 0.01
    (1000, True)
    """
    case = as_case(case)
    require_packages("sweep", "sweep", "dask", "filelock", "zarr")
    from eppanalysis.sweep.analyses import make_task

    return _cost(make_task(case, axes, run, signals, allow), make_design(case, axes).n_cells)


def _cost(task: Task, cells: int) -> Cost:
    from eppanalysis.sweep.estimate import measure
    from eppanalysis.sweep.work import Work

    return measure(Work.of(task), cells)


def _only_runs(task: Task) -> bool:
    from eppanalysis.sweep.analyses import Analysis

    return task.analyses == (Analysis.SIMULATE,)


def _store(
    task: Task,
    design: Design,
    size: int,
    store: str | Path | None,
    resume: bool,
    shard: str | tuple[int, int] | None,
    merge: bool,
) -> tuple[MemoryStore | ZarrStore, set[Bounds] | None]:
    """Where results go, joined from shares where that is requested; and the blocks of a share, None for all."""
    from eppanalysis.sweep.shards import Shard
    from eppanalysis.sweep.store import MemoryStore, ZarrStore

    attributes = _attributes(task, design)
    if shard is None and not merge:
        if store is None:
            return MemoryStore(task, design, attributes, size), None
        return ZarrStore(Path(store), task, design, attributes, size, resume), None
    if store is None:
        name = "merge" if merge else "shard"
        raise ArgumentError(name, " is given without a store; expected the name of one (.zarr).", "sweep")
    if shard is None:
        return _joined(ZarrStore(Path(store), task, design, attributes, size, True)), None
    if merge:
        raise ArgumentError("merge", f" is given beside shard {shard!r}; expected one of the two.", "sweep")
    share = Shard.parse(shard)
    kept = ZarrStore(share.path(Path(store)), task, design, attributes, size, resume)
    return kept, set(share.blocks(kept))


def _joined(kept: ZarrStore) -> ZarrStore:
    """A store with what the shares beside it have finished."""
    from eppanalysis.sweep.shards import join

    try:
        join(kept)
    except BaseException:
        kept.close()
        raise
    return kept


def _tell(text: str) -> None:
    """Say what there is to know before a sweep begins, on a terminal, in a notebook and in a file that is written."""
    from rich.console import Console

    Console(stderr=True).print(text, markup=False, highlight=False, soft_wrap=True)


def open_sweep(path: str | Path) -> xarray.Dataset:
    """The results in a store, finished or not; numbers are read, and checked, when they are used.

    Parameters
    ----------
    path : str or Path
        Zarr folder that :func:`sweep` has written.

    Returns
    -------
    xarray.Dataset
        As :func:`sweep` returns it.

    Raises
    ------
    EppError
        If there is no store of a sweep, or it is damaged; what is damaged of its numbers is refused when it is read.

    Examples
    --------
    >>> import tempfile
    >>> import eppanalysis as epp
    >>> axes = {"loop.gain": [0.5, 1.0]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = f"{folder}/map.zarr"
    ...     found = epp.sweep(
    ...         epp.case("relay_deadzone"), axes, store=store, progress=False
    ...     )
    ...     epp.open_sweep(store)["outcome"].values.tolist()
    [1, 2]
    """
    require_packages("sweep", "sweep", "filelock", "zarr")
    from eppanalysis.sweep import store

    return store.open_sweep(path)


def _chunk(design: Design, task: Task, chunk: int | None) -> int:
    if chunk is not None:
        if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
            raise ArgumentError("chunk", f" is {chunk!r}; expected a whole number of cells, 1 or more.", "sweep")
        return chunk
    n = design.n_cells
    usual = _QUICK if _only_runs(task) else _SLOW
    return max(1, min(usual, -(-n // _FEWEST_BLOCKS)), -(-n // _MOST_BLOCKS))


def _attributes(task: Task, design: Design) -> dict[str, Any]:
    """Where the results come from."""
    from eppanalysis.results.provenance import Provenance

    case = task.case
    names = [name for d in design.dimensions for name in d.values]
    settings = {
        "run": list(task.analyses),
        "signals": list(task.signals),
        **({"t_end": case.t_end} if "simulate" in task.analyses else {}),
        "axes": repr(task.axes)[:500],
        **({} if task.allowed is None else {"allowed": task.allowed.to_dict()}),
    }
    return {
        "title": case.title,
        "case": case.name,
        "signal": task.main_signal,
        **({} if task.allowed is None else {"allowed": str(task.allowed), "allowed_size": task.allowed.size}),
        "cells": design.n_cells,
        "provenance": Provenance("sweep", settings, case=case.provenance()).to_dict(),
        "case_file": case.to_toml(),
        "units_of_axes": {name: (*case.unit(name), _per_readable(*case.unit(name))) for name in names},
    }


def _per_readable(unit: str, readable: str) -> float:
    """SI value of one readable unit."""
    from eppanalysis.units import parse_quantity

    return parse_quantity(f"1 {readable}", unit) if readable and readable != unit else 1.0
