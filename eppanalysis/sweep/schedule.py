"""Runs the blocks of a sweep: on threads, on processes of this one's own, or with Dask on a cluster that is there.

Processes of this machine are spoken to through pipes, which belong to them alone: whoever reaches a scheduler at a port
may have code of theirs run by its workers.

Only a few blocks are under way at a time, so that memory stays flat however many there are.
"""

from __future__ import annotations

import pickle
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum
from functools import lru_cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from eppanalysis.arguments import check_counts
from eppanalysis.errors import ArgumentError, EppError, require_packages
from eppanalysis.sweep.analyses import Columns, Task
from eppanalysis.sweep.store import Bounds, MemoryStore, ZarrStore, cells_in
from eppanalysis.sweep.work import Work
from eppanalysis.workers import Workers, cores

if TYPE_CHECKING:
    from distributed import Client

Store = MemoryStore | ZarrStore
#: Called with how many more cells are done, from any thread.
Advance = Callable[[int], None]

#: Blocks under way for each thread of a cluster, and how often one is tried again whose workers were lost.
_AHEAD, _TRIES = 2, 20
#: How long a scheduler may take to answer.
_PATIENCE = "10s"


#: Queueing systems that workers are jobs of, and what dask-jobqueue calls them; "local" runs a job as a process here.
QUEUES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "lsf": "LSFCluster",
    "sge": "SGECluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
    "htcondor": "HTCondorCluster",
    "local": "LocalCluster",
}


class Scheduler(StrEnum):
    """Where a sweep runs, if not on a cluster at an address."""

    THREADS = "threads"
    PROCESSES = "processes"


def run_blocks(
    task: Task, blocks: Sequence[Bounds], store: Store, scheduler: str, workers: int | None, advance: Advance
) -> None:
    """Compute and keep blocks of cells.

    Parameters
    ----------
    blocks : sequence of Bounds
        Those that the store misses.
    scheduler : str
        "threads", "processes", or the address of a Dask scheduler ("tcp://host:8786").
    workers : int, optional
        Threads or processes; by default as many as there are cores.
    advance : callable
        Called with the number of cells of each block that is done.

    Raises
    ------
    EppError
        If there is no such scheduler, or blocks could not be computed because their workers were lost.
    """
    if workers is not None:
        check_counts("sweep", {"workers": (workers, 1)})
    if scheduler == Scheduler.THREADS:
        _on_threads(Work.of(task), blocks, store, workers or cores(), advance)
        return
    if scheduler == Scheduler.PROCESSES:
        with _processes(workers) as processes:
            processes.run(task, blocks, store, advance)
        return
    with _client(scheduler, workers) as client:
        _on_cluster(client, task, blocks, store, advance)


def _on_threads(work: Work, blocks: Sequence[Bounds], store: Store, workers: int, advance: Advance) -> None:
    """All blocks as one Dask graph; a thread keeps what it has computed before it takes the next block."""
    from dask.threaded import get

    def compute(bounds: Bounds) -> None:
        store.write(bounds, work.block(bounds))
        advance(cells_in(bounds))

    graph = {("block", i): (compute, bounds) for i, bounds in enumerate(blocks)}
    get(graph, list(graph), num_workers=workers)


@contextmanager
def _jobs(queue: str, workers: int | None) -> Iterator[Client]:
    """A client of workers that a queueing system runs as its jobs.

    The settings of a job are where dask-jobqueue reads them, in ``~/.config/dask/jobqueue.yaml``.
    """
    require_packages(f"sweep: scheduler {queue!r}", "queue", "dask", "distributed", "dask_jobqueue")
    from dask import config
    from distributed import Client

    module = import_module("dask_jobqueue.local" if queue == "local" else "dask_jobqueue")
    if any(config.get(f"jobqueue.{queue}.{name}", None) is None for name in ("cores", "memory")):
        expected = f"cores, processes and memory of a job under jobqueue.{queue} in ~/.config/dask/jobqueue.yaml"
        raise ArgumentError("scheduler", f" {queue!r} is not described; expected {expected}.", "sweep")
    with getattr(module, QUEUES[queue])() as cluster, Client(cluster) as client:
        cluster.scale(workers or 1)
        yield client


@contextmanager
def _client(scheduler: str, workers: int | None) -> Iterator[Client]:
    """A client of a queueing system's jobs, or of the cluster at an address."""
    require_packages(f"sweep: scheduler {scheduler!r}", "sweep", "distributed")
    from distributed import Client

    if scheduler in QUEUES:
        with _jobs(scheduler, workers) as client:
            yield client
        return
    if "://" not in scheduler:
        queues = ", ".join(repr(name) for name in QUEUES if name != "local")
        expected = f"'threads', 'processes', {queues} or the address of a Dask scheduler such as tcp://host:8786"
        raise ArgumentError("scheduler", f" is {scheduler!r}; expected {expected}.", "sweep")
    try:
        client = Client(scheduler, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise EppError(f"sweep: no Dask scheduler answers at {scheduler}; expected the address of one.") from error
    with client:
        yield client


@contextmanager
def address(scheduler: str, workers: int | None) -> Iterator[str]:
    """Where several sweeps in a row find their workers, which are started once.

    Parameters
    ----------
    scheduler, workers
        As :func:`run_blocks` takes them, but for "threads", which need no address.
    """
    if scheduler == Scheduler.PROCESSES:
        with _processes(workers):
            yield scheduler
        return
    with _client(scheduler, workers) as client:
        yield str(client.scheduler_info()["address"])


class _Processes:
    """Processes of this machine that compute blocks.

    Parameters
    ----------
    n : int
    """

    def __init__(self, n: int) -> None:
        self.n, self.pool = n, Workers(n)

    def run(self, task: Task, blocks: Sequence[Bounds], store: Store, advance: Advance) -> None:
        """Compute and keep blocks; those of processes that end before their time are given to new ones."""
        said, waiting, tries = pickle.dumps(task), deque(blocks), Counter[Bounds]()
        running: dict[Future[Columns], Bounds] = {}
        lost: list[Bounds] = []
        while waiting or running:
            failed: list[Bounds] = []
            while waiting and len(running) < _AHEAD * self.n and not failed:
                bounds = waiting.popleft()
                try:
                    running[self.pool.submit(_block_of, said, bounds)] = bounds
                except BrokenProcessPool:
                    failed.append(bounds)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                bounds = running.pop(future)
                try:
                    columns = future.result()
                except BrokenProcessPool:
                    failed.append(bounds)
                    continue
                store.write(bounds, columns)
                advance(cells_in(bounds))
            if failed:
                failed += running.values()
                running.clear()
                self._renew()
                tries.update(failed)
                lost += (bounds for bounds in failed if tries[bounds] >= _TRIES)
                waiting.extendleft(bounds for bounds in reversed(failed) if tries[bounds] < _TRIES)
        _tell_lost(sum(map(cells_in, lost)))

    def _renew(self) -> None:
        """New processes in place of some that have ended before their time.

        Raises
        ------
        EppError
            If they have ended because of the script that has started them.
        """
        wrong = self.pool.why_lost()
        self.pool.end()
        if wrong is not None:
            raise wrong
        self.pool = Workers(self.n)


#: Processes that sweeps of this context share.
_shared: ContextVar[_Processes | None] = ContextVar("processes", default=None)


@contextmanager
def _processes(workers: int | None) -> Iterator[_Processes]:
    """Those that are shared here, or new ones that sweeps inside share."""
    there = _shared.get()
    if there is not None:
        yield there
        return
    processes = _Processes(workers or cores())
    before = _shared.set(processes)
    try:
        yield processes
    except BaseException:
        processes.pool.end()
        raise
    finally:
        _shared.reset(before)
    processes.pool.shutdown()


@lru_cache(maxsize=1)
def _work_of(said: bytes) -> Work:
    """What a process makes of its task, once for all its blocks."""
    return Work.of(pickle.loads(said))


def _block_of(said: bytes, bounds: Bounds) -> Columns:
    return _work_of(said).block(bounds)


def _block(work: Work, bounds: Bounds) -> Columns:
    return work.block(bounds)


class _Window:
    """The blocks under way on a cluster."""

    def __init__(self, client: Client, task: Task, ahead: int) -> None:
        from distributed import as_completed

        self.client, self.ahead = client, ahead
        # Made by a worker, so that it can be made again when the worker is lost.
        self.work = client.submit(Work.of, task, pure=False)
        self.running: Any = as_completed(loop=client.loop, with_results=False)
        self.bounds: dict[Any, Bounds] = {}
        self.tries: dict[Bounds, int] = {}

    def submit(self, bounds: Bounds) -> None:
        future = self.client.submit(_block, self.work, bounds, pure=False)
        self.bounds[future.key] = bounds
        self.tries[bounds] = self.tries.get(bounds, 0) + 1
        self.running.add(future)

    def results(self, blocks: Iterator[Bounds]) -> Iterator[tuple[Bounds, Any]]:
        """Blocks as they finish; for each a new one is begun."""
        for _, bounds in zip(range(self.ahead), blocks, strict=False):
            self.submit(bounds)
        for future in self.running:
            bounds = self.bounds.pop(future.key)
            yield bounds, future
            following = next(blocks, None)
            if following is not None:
                self.submit(following)


def _on_cluster(client: Client, task: Task, blocks: Sequence[Bounds], store: Store, advance: Advance) -> None:
    if not blocks:
        return
    threads = sum(client.nthreads().values()) or 1
    window = _Window(client, task, _AHEAD * threads)
    lost = 0
    for bounds, future in window.results(iter(blocks)):
        if future.status == "finished":
            # Workers compute and this process writes, as a store has one writer.
            store.write(bounds, future.result())
            del window.tries[bounds]
            advance(cells_in(bounds))
        elif not _is_loss(future):
            future.result()  # raises what went wrong
        elif window.tries[bounds] < _TRIES:
            window.submit(bounds)
        else:
            lost += cells_in(bounds)
    _tell_lost(lost)


def _tell_lost(cells: int) -> None:
    if cells:
        raise EppError(
            f"sweep: {cells} cells were lost with their workers {_TRIES} times; expected workers that stay alive "
            "(more memory, or smaller chunks); all other cells are kept."
        )


def _is_loss(future: Any) -> bool:
    from distributed import KilledWorker

    return future.status in ("cancelled", "lost") or isinstance(future.exception(), KilledWorker)
