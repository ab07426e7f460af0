"""What a slider shows a moment later: exact cycles, the branch over a parameter, the design map; in other processes.

Another process, because these take seconds and would hold up the page. Jobs are functions of plain data, so that each
is computed once and kept; one that nobody wants any more is dropped before it begins.
"""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eppanalysis.cases import Case, case_from_text
from eppanalysis.errors import EppError
from eppanalysis.readable import DIGITS
from eppanalysis.workers import Workers

if TYPE_CHECKING:
    from eppanalysis.methods.continuation.result import Branch

#: Plain data: what jobs take and give.
Facts = dict[str, Any]

_KEPT = 64
_MAP_CELLS = (17, 13)
_BRANCH: dict[str, Any] = {"n_points": 240, "max_step": 0.1, "n_others": 0}


@dataclass(frozen=True)
class Given:
    """A case as plain data."""

    #: text, name, folder: TOML text, name, and where files that it names are looked for.
    text: str
    name: str
    folder: str
    signal: str  # what the page shows of it

    @classmethod
    def of(cls, case: Case, signal: str) -> Given:
        """The plain data of a case."""
        return cls(case.to_toml(), "case", str(case.folder), signal)

    def case(self) -> Case:
        """The case."""
        return case_from_text(self.text, self.name, self.folder)


def all_cycles(given: Given) -> Facts:
    """Exact cycles: peak-to-peak of the signal [SI], frequency [Hz], stability; and how they were sought."""
    from eppanalysis.methods.search.find import find_limit_cycles

    case = given.case()
    found = find_limit_cycles(case)
    return {
        "size": [c.peak_to_peak[given.signal] for c in found],
        "frequency": [c.frequency for c in found],
        "stable": [bool(c.stable) for c in found],
        "settles": found.settles,
        "doubts": " ".join(found.doubts()),
    }


def remedies(given: Given) -> Facts:
    """Why the case oscillates and what ends it, in a sentence."""
    from eppanalysis.remedies import remedies as tried

    return {"sentence": str(tried(given.case()))}


def branch(given: Given, over: str, low: float, high: float) -> Facts:
    """Branches over a parameter between two values [SI], where their cycles begin to exist, and what they leave out.

    From the upper end in one piece; where there is none or it is lost, from the case's own value to both sides, too.
    """
    from eppanalysis.methods.bounds.exact import BORN
    from eppanalysis.methods.steady.changes import Change

    case = given.case()
    pieces = _followed(case, over, (high, low))
    if not pieces or any(special.kind is Change.END for special in pieces[0].special):
        pieces += _followed(case, over, (case.value(over), low), (case.value(over), high))
    special = [special for piece in pieces for special in piece.special]
    lost = [case.text(over, s.value, DIGITS) for s in special if s.kind is Change.END]
    return {
        "pieces": [
            {"value": p.points["value"].tolist(), "stable": p.points["stable"].tolist()}
            | {"size": p.points[given.signal].tolist()}
            for p in pieces
        ],
        "begins": [[s.value, s.cycle.peak_to_peak[given.signal]] for s in special if s.kind in BORN],
        "doubts": f"not followed beyond {' and '.join(lost)}" if lost else "" if pieces else "none found",
    }


def _followed(case: Case, over: str, *ends: tuple[float, float]) -> list[Branch]:
    """Branches from one value to another each, where there is a cycle at the first."""
    from eppanalysis.methods.continuation.branch import continue_branch

    pieces = []
    for start, stop in ends:
        with suppress(EppError):
            pieces.append(continue_branch(case, over, start, stop, **_BRANCH))
    return pieces


def design_map(given: Given, x: str, y: str, xs: tuple[float, float], ys: tuple[float, float]) -> Facts:
    """Outcome over a grid of two parameters [SI]: codes as a sweep has them."""
    import numpy as np

    from eppanalysis.cases.variation import time_of_maps
    from eppanalysis.sweep import sweep

    axes = {
        name: [float(v) for v in np.linspace(*ends, n)]
        for name, ends, n in zip((x, y), (xs, ys), _MAP_CELLS, strict=True)
    }
    case = given.case()
    longer = case.with_values({"run.t_end": time_of_maps(case)})
    cells = sweep(longer, axes, workers=1, progress=False)
    return {"outcome": cells["outcome"].transpose(y, x).values.tolist(), "x": axes[x], "y": axes[y]}


def border(given: Given, x: str, y: str, xs: tuple[float, float], ys: tuple[float, float]) -> Facts:
    """The exact border of where there is no limit cycle over two parameters [SI], without the ends of their ranges."""
    from eppanalysis.methods.bounds.result import Turn
    from eppanalysis.sweep.boundary import free_region

    found = free_region(given.case(), {x: list(xs), y: list(ys)})
    across, up = found.stretches({*found.kinds} - {Turn.EDGE})
    return {"x": across.tolist(), "y": up.tolist()}


def picture(given: Given) -> Facts:
    """The ladder's picture, as a PNG."""
    from eppanalysis.methods.comparison.ladder import ladder
    from eppanalysis.plotting import figure_of
    from eppanalysis.shown import png

    return {"png": png(figure_of(ladder(given.case()).plot()), 150)}


#: In which process a job is done: what takes long keeps nothing else waiting.
_PLACES = {
    "design_map": "quick",
    "picture": "quick",
    "all_cycles": "cycles",
    "branch": "branch",
    "border": "border",
    "remedies": "remedies",
}


def _quietly(job: Callable[..., Facts], args: tuple[Any, ...]) -> Facts:
    """A job, with what it refuses as a sentence."""
    try:
        return job(*args)
    except EppError as error:
        return {"error": str(error)}


def _begin() -> None:
    """A worker leaves the processor to the page."""
    with suppress(AttributeError, OSError):
        os.nice(5)


class Workshop:
    """A few processes that work for all pages, and what they have found so far."""

    def __init__(self) -> None:
        self._pools = {place: self._fresh() for place in sorted({*_PLACES.values()})}
        self._kept: OrderedDict[Any, Facts] = OrderedDict()
        self._lock = threading.Lock()

    @staticmethod
    def _fresh() -> Workers:
        return Workers(1, _begin)

    def ask(self, job: Callable[..., Facts], args: tuple[Any, ...], then: Callable[[Facts], None]) -> Future[Facts]:
        """Have a job done; `then` is called from another thread with what it gives.

        Returns
        -------
        Future
            To cancel what is not wanted any more.
        """
        key = (job.__name__, args)
        with self._lock:
            known = self._kept.get(key)
            if known is None:
                future = self._submit(job, args)
        if known is not None:
            future = Future()
            future.set_result(known)
        future.add_done_callback(lambda done: self._finish(key, done, then))
        return future

    def _submit(self, job: Callable[..., Facts], args: tuple[Any, ...]) -> Future[Facts]:
        place = _PLACES[job.__name__]
        try:
            return self._pools[place].submit(_quietly, job, args)
        except BrokenProcessPool:
            self._pools[place] = self._fresh()
            return self._pools[place].submit(_quietly, job, args)

    def _finish(self, key: Any, done: Future[Facts], then: Callable[[Facts], None]) -> None:
        if done.cancelled():
            return
        error = done.exception()
        if error is not None:
            then({"error": f"It could not be computed ({type(error).__name__}: {error})."})
            return
        with self._lock:
            self._kept[key] = done.result()
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        then(done.result())

    def close(self) -> None:
        """End the processes, whatever they are doing."""
        for pool in self._pools.values():
            pool.end()
