"""Thousands of loops of one structure at once: verdict and cycle of each, on all cores by threads.

The engine releases the interpreter's lock and writes each cell's result to its own place, so results are the same to
the last bit whatever the number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.engine.runs import SAMPLES, Outcome, run_cells
from eppanalysis.engine.workspace import make_event_buffer, make_progress, make_samples, make_workspaces
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.kept import EARLY, VERDICTS
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.sampled.strobe import refuse_samples
from eppanalysis.readable import count, listed, words
from eppanalysis.results import Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Events of a cell that are kept for its verdict, and cells that a thread takes at a time.
KEPT_EVENTS, CHUNK = 4096, 8
#: How runs end, in words that follow their number.
_ENDS = {
    Status.SETTLED: "settled at rest",
    Status.LIMIT_CYCLE: "on a limit cycle",
    Status.UNDECIDED: "undecided",
    Status.DIVERGED: "growing without bound",
    Status.EVENT_LIMIT: "stopped early at too many events",
    Status.NOT_CONVERGED: "failed",
}


@dataclass(frozen=True, eq=False)
class HybridStack:
    """Hybrid systems of one structure, array by array, with the cell as leading axis; one model may serve all cells."""

    model: Any
    x0: Array
    modes0: IntArray
    H0: Array
    compared: BoolArray
    time_scale: Array
    signal_names: tuple[str, ...]

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.x0)

    def take(self, rows: IntArray) -> HybridStack:
        """Some of the cells."""
        model = self.model if len(self.model.A) == 1 else type(self.model)(*(a[rows] for a in self.model))
        return replace(
            self,
            model=model,
            x0=self.x0[rows],
            modes0=self.modes0[rows],
            H0=self.H0[rows],
            time_scale=self.time_scale[rows],
        )

    @classmethod
    def of(cls, systems: Sequence[HybridSystem], signal_names: Sequence[str]) -> HybridStack:
        """Stack systems.

        Raises
        ------
        EppError
            If there are none, their structures differ, or they have sampled controllers.
        """
        if not systems:
            raise EppError("A batch needs at least one system.")
        refuse_samples(systems[0].elements, "A batch")
        shapes = {tuple(a.shape for a in s.model) for s in systems}
        if len(shapes) > 1:
            raise EppError(
                "The systems of a batch differ in structure (states, elements or modes); run them in groups."
            )
        # Runs of one system from many starts have its model.
        models = [s.model for s in (systems[:1] if all(s.model is systems[0].model for s in systems) else systems)]
        return cls(
            model=type(models[0])(*(np.stack(arrays) for arrays in zip(*models, strict=True))),
            x0=np.stack([s.x0 for s in systems]),
            modes0=np.stack([s.modes0 for s in systems]),
            H0=np.stack([s.H0 for s in systems]),
            compared=systems[0].compared,
            time_scale=np.array([s.time_scale for s in systems]),
            signal_names=tuple(signal_names),
        )


@dataclass(frozen=True, eq=False, repr=False)
class BatchResult(Result):
    """Verdict and cycle of every cell.

    Attributes
    ----------
    status : tuple of Status
    period : array, shape (cells,)
        [s]; nan where there is no cycle.
    mean, peak_to_peak : dict of str to array, shape (cells,)
        Of every signal, in SI units: on the cycle (extrema from 512 samples and a parabola), or at rest.
    rms : dict of str to array, shape (cells,)
        Of every signal about its mean, from the same samples.
    events : int array, shape (cells,)
    last_event : array, shape (cells,)
        Time of the last switch [s].
    change : array, shape (cells,)
        Extrapolated change of the cycle still to come, relative to its size; nan where there is none.
    """

    status: tuple[Status, ...]
    period: Array
    mean: dict[str, Array]
    peak_to_peak: dict[str, Array]
    rms: dict[str, Array]
    events: IntArray
    last_event: Array
    change: Array

    def __str__(self) -> str:
        """How many cells end how."""
        counts = {status: self.status.count(status) for status in _ENDS}
        parts = [f"{n} {_ENDS[status]}" for status, n in counts.items() if n]
        return f"{count(len(self.status), 'run')}: {listed(parts)}." if parts else "No cell was run (0 cells)."

    def to_frame(self) -> pandas.DataFrame:
        """The cells, one a row: status, period [s], and the peak-to-peak and mean of every signal."""
        rows = []
        for i, status in enumerate(self.status):
            row: dict[str, Any] = {"status": words(status.name.lower()), "period": float(self.period[i])}
            for name, values in self.peak_to_peak.items():
                row |= {f"{name}.peak_to_peak": float(values[i]), f"{name}.mean": float(self.mean[name][i])}
            rows.append(row)
        return frame_of(rows, {"period": "s"})

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Peak-to-peak of the first signal and period of the cells that end on a cycle."""
        return self.drawn("plot_batch", ax)


def simulate_batch(stack: HybridStack, t_end: float, *, threads: int = 1, max_events: int = 100_000) -> BatchResult:
    """Run every cell of a stack to its verdict.

    Parameters
    ----------
    t_end : float
        End of each run [s].
    threads : int
        Cells run on so many threads; the result does not depend on it.
    max_events : int
        A run with more stops there and says so.

    Raises
    ------
    EppError
        If `t_end` or `threads` is not positive.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
    >>> from eppanalysis.models.systems.hybrid import HybridSystem
    >>> loops = [
    ...     epp.LureSystem.from_tf(([k], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    ...     for k in (1.0, 2.0)
    ... ]
    >>> stack = HybridStack.of(
    ...     [HybridSystem.from_lure(s) for s in loops], loops[0].signals.names
    ... )
    >>> [round(float(v), 4) for v in simulate_batch(stack, 200.0).peak_to_peak["x"]]
    [0.4401, 0.8801]
    """
    if not (np.isfinite(t_end) and t_end > 0):
        raise EppError(f"simulate_batch: t_end is {t_end}; expected a positive number of seconds.")
    if threads < 1:
        raise EppError(f"simulate_batch: threads is {threads}; expected 1 or more.")
    n, n_y = stack.n_cells, len(stack.signal_names)
    mean, low, high, rms = np.full((4, n, n_y), np.nan)
    out = Outcome(
        np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n), np.full(n, np.nan),
        np.full((n, 2), np.nan), mean, low, high, rms, np.zeros(1, np.int64),
    )  # fmt: skip
    _run_all(stack, t_end, threads, max_events, out)
    status = tuple(EARLY.get(int(c)) or VERDICTS[int(v)] for c, v in zip(out.code, out.verdict, strict=True))
    return BatchResult(
        status=status,
        period=out.period,
        mean={k: out.mean[:, i] for i, k in enumerate(stack.signal_names)},
        peak_to_peak={k: out.high[:, i] - out.low[:, i] for i, k in enumerate(stack.signal_names)},
        rms={k: out.rms[:, i] for i, k in enumerate(stack.signal_names)},
        events=out.events,
        last_event=out.since,
        change=out.change[:, 1],
        provenance=Provenance("event-exact simulation", {"t_end": t_end, "max_events": max_events}),
    )


def _run_all(stack: HybridStack, t_end: float, threads: int, max_events: int, out: Any) -> None:
    """Run all cells on threads, each of which takes some at a time; an interrupt stops them."""
    n, n_y, base = stack.n_cells, len(stack.signal_names), 2.0 * stack.time_scale
    one = type(stack.model)(*(a[0] for a in stack.model))
    spare: list[tuple[Any, Any, Any, Any, Any, Any, Any]] = []

    def work(first: int) -> None:
        try:
            # Taken and put back in one step each of the interpreter, so without a lock: as many are made as threads
            # work at once.
            workspaces = spare.pop()
        except IndexError:
            buffer = make_event_buffer(KEPT_EVENTS, stack.x0.shape[1], stack.H0.shape[1], stack.modes0.shape[1])
            samples = make_samples(np.zeros(0), n_y), make_samples(np.zeros(SAMPLES + 1), n_y)
            workspaces = *make_workspaces(one), *samples, buffer, make_progress(t_end, 0.0, max_events)
        run_cells(
            stack.model, *workspaces, stack.x0, stack.modes0, stack.H0, stack.compared, base, first,
            min(first + CHUNK, n), out,
        )  # fmt: skip
        spare.append(workspaces)

    # On threads of their own even where there is one: the caller hears an interrupt, and stops them.
    with ThreadPoolExecutor(threads) as pool:
        try:
            list(pool.map(work, range(0, n, CHUNK)))
        except BaseException:
            out.stop[0] = 1
            raise
