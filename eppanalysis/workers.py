"""Who computes: processes that work for this one, which leave interrupts to it and end with it however it ends; and in
how many threads, which is one for linear algebra.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from functools import cache
from multiprocessing import current_process, get_context, parent_process, resource_tracker
from multiprocessing.connection import wait
from typing import Any, ParamSpec, TypeVar

from eppanalysis.errors import EppError

P = ParamSpec("P")
T = TypeVar("T")
_THREADS = "OPENBLAS_NUM_THREADS"
#: What loads a library of linear algebra beside that of numpy, which takes a fifth of a second.
_SCIPY = "scipy.linalg"
#: With what a process ends that would start others while it reads the script that has started it, and with what one
#: that cannot read it.
_READS_THE_SCRIPT, _CANNOT_READ_IT = 77, 1
#: How long a process that has ended may take to be noticed [s].
_PATIENCE = 5.0


class Workers(ProcessPoolExecutor):
    """A pool of new processes, for functions and data that can be pickled.

    Parameters
    ----------
    n : int
    begin : callable, optional
        What each does first.
    """

    def __init__(self, n: int, begin: Callable[[], None] | None = None) -> None:
        if getattr(current_process(), "_inheriting", False):  # the script is read anew, and comes here once more
            os._exit(_READS_THE_SCRIPT)
        self.started: dict[int, Any] = {}
        try:
            super().__init__(n, mp_context=get_context("spawn"), initializer=_begin, initargs=(begin,))
        except OSError as error:
            raise NoProcesses(
                f"Processes cannot be started ({error.strerror or error}); expected a system that lets processes share "
                "memory (a folder /dev/shm that can be written), or one worker."
            ) from error

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """As of every pool; a process that starts for it is insensitive to interrupts from its first moment on.

        An interrupt of this process comes once the new one has been given all that it reads.
        """
        with interrupts_wait(), _one_thread_each():
            future = super().submit(fn, *args, **kwargs)
        self.started |= self._processes or {}
        return future

    def end(self) -> None:
        """End the processes, whatever they are doing, and the thread that speaks with them.

        Python, when it ends, would wake that thread through a pipe that it may be closing just then.
        """
        processes: dict[int, Any] = dict(getattr(self, "_processes", None) or {})
        for process in processes.values():
            process.terminate()
        self.shutdown(cancel_futures=True)

    def why_lost(self) -> EppError | None:
        """What is wrong with the script that has started the processes, where they have ended for that."""
        for process in self.started.values():
            process.join(_PATIENCE)
        ends = {process.exitcode for process in self.started.values()}
        script = getattr(sys.modules.get("__main__"), "__file__", None) or "the script"
        if _READS_THE_SCRIPT in ends:
            expected = 'the line if __name__ == "__main__": above what it does'
            return EppError(f"{script}: starts processes, each of which reads it anew; expected {expected}.")
        if _CANNOT_READ_IT in ends:
            return EppError(f"{script}: cannot be read by the processes that it starts; expected a script in a file.")
        return None


class NoProcesses(EppError):
    """Raised where the system lets no processes be started."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def workers(n: int) -> Iterator[Executor | None]:
    """Processes, or None for one worker; they are ended at once where the block does not end well.

    Raises
    ------
    EppError
        If a process ended before its time.
    """
    pool = None if n == 1 else _some(n)
    if pool is None:
        yield None
        return
    try:
        for _ in range(n):
            pool.submit(os.getpid)  # any call: the processes start while the caller has work of its own
        yield pool
    except BrokenProcessPool:
        pool.end()
        lost = EppError("A worker process ended before its time; expected enough memory, or fewer workers.")
        raise pool.why_lost() or lost from None
    except BaseException:
        pool.end()
        raise
    pool.shutdown()


def _some(n: int) -> Workers | None:
    """Processes, or None where there can be none, as is said: then one does all the work."""
    try:
        return Workers(n)
    except NoProcesses as error:
        sys.stderr.write(f"{error.args[0]} One does it all.\n")
        return None


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """An interrupt comes after the block; what is started in it, threads too, inherits that it hears none."""
    with _handlers_wait():
        if not hasattr(signal, "pthread_sigmask"):  # Windows, where a worker ignores them only once it has begun
            yield
            return
        resource_tracker.ensure_running()  # which would let interrupts through again when it is started inside
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _handlers_wait() -> Iterator[None]:
    """What Python does at an interrupt, or at a signal of the system to end, it does after the block.

    A signal that is blocked in the main thread alone reaches another thread, and is handled in the main one all the
    same.
    """
    if threading.current_thread() is not threading.main_thread():  # in which nothing is handled
        yield
        return
    come: list[int] = []
    with ExitStack() as after:
        after.callback(_raise_all, come)
        for number in (signal.SIGINT, signal.SIGTERM):
            handler = signal.getsignal(number)
            if callable(handler):
                after.callback(signal.signal, number, handler)
                signal.signal(number, lambda number, frame: come.append(number))
        yield


def _raise_all(signals: Iterable[int]) -> None:
    for number in signals:
        signal.raise_signal(number)


@contextmanager
def _one_thread_each(whatever_is_said: bool = False) -> Iterator[None]:
    """Libraries of linear algebra that are loaded in the block take one thread, where the user says nothing else.

    So do those of processes that start in it, which would wait for each other's cores.
    """
    before = os.environ.get(_THREADS)
    if whatever_is_said or before is None:
        os.environ[_THREADS] = "1"  # read when the library is loaded, before anything of ours runs there
    try:
        yield
    finally:
        os.environ.pop(_THREADS, None)
        if before is not None:
            os.environ[_THREADS] = before


class _LinearAlgebra:
    """How many blocks of this process want linear algebra in one thread, and what ends that."""

    def __init__(self) -> None:
        self.lock, self.blocks = threading.Lock(), 0
        self.end = ExitStack()

    def enter(self) -> None:
        with self.lock:
            if self.blocks == 0:
                self._limit(_libraries(_SCIPY in sys.modules))
            self.blocks += 1

    def leave(self) -> None:
        with self.lock:
            self.blocks -= 1
            if self.blocks == 0:
                self.end.close()

    def _limit(self, libraries: Any) -> None:
        """One thread until the end, for scipy's library too, which may be loaded on the way."""
        limits = libraries.limit(limits=1, user_api="blas")
        self.end.callback(limits.restore_original_limits)
        if _SCIPY not in sys.modules:
            self.end.callback(_set_threads, limits.get_original_num_threads()["blas"])
            self.end.enter_context(_one_thread_each(whatever_is_said=True))


def _set_threads(threads: int | None) -> None:
    """Give all libraries of linear algebra so many threads, where scipy's has been loaded."""
    if _SCIPY in sys.modules:
        _libraries(True).limit(limits=threads, user_api="blas")


@cache
def _libraries(with_scipy: bool) -> Any:
    """The libraries of linear algebra that are loaded: that of numpy, and from a time on that of scipy."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


_LINEAR_ALGEBRA = _LinearAlgebra()


@contextmanager
def one_thread() -> Iterator[None]:
    """In the block linear algebra takes one thread, whichever thread of ours calls it; behind it as many as before.

    Where a sum is split over threads depends on their number, and so do its last bits.
    """
    _LINEAR_ALGEBRA.enter()
    try:
        yield
    finally:
        _LINEAR_ALGEBRA.leave()


def _begin(begin: Callable[[], None] | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(0)
