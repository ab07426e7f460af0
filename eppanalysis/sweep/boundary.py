"""Boundaries in the plane of two parameters: where an outcome changes, and where exact cycles are born in folds."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import check_counts, checked
from eppanalysis.arrays import Array, BoolArray
from eppanalysis.cases import as_case
from eppanalysis.errors import EppError
from eppanalysis.models.systems.subject import require_case, require_continuous
from eppanalysis.readable import count, listed, span, words
from eppanalysis.results import Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of
from eppanalysis.sweep.analyses import PREFIX, Allowance, Analysis, Outcome
from eppanalysis.sweep.axes import Axis, Zipped, make_design

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from eppanalysis.cases import Case
    from eppanalysis.models.systems.lure import LureSystem

#: What each analysis is called that says whether a cell oscillates.
_WORDS = {Analysis.SIMULATE: "run in time", Analysis.PREDICT: "describing function", Analysis.CYCLES: "exact orbits"}
#: How far from the last fold the next one is looked for, relative to the range.
_NEAR = (0.15, 0.06)
_NO_POINT = np.full((1, 2), np.nan)


@dataclass(frozen=True, eq=False, repr=False)
class Boundary(Result):
    """A curve in the plane of two parameters, in one or several pieces.

    Attributes
    ----------
    axes : (str, str)
        Dotted names of the parameters.
    points : array, shape (k, 2)
        Points along the curve [SI]; rows of nan separate its pieces.
    label : str
        What it is the boundary of, for a legend.
    status : Status
        CONVERGED, or NOT_CONVERGED when parts of it were not found.
    message : str
        How it was found.
    units : dict of str to str
        SI units of both parameters.
    readable : dict of str to (str, float)
        The units that people use for them, and the factors from SI to these.
    """

    axes: tuple[str, str]
    points: Array
    label: str
    status: Status
    message: str

    units: dict[str, str] = field(default_factory=dict)
    readable: dict[str, tuple[str, float]] = field(default_factory=dict)

    in_json = "axes points label status message provenance"

    def __str__(self) -> str:
        """Over which values the boundary is known, and how it was found."""
        known = self.points[np.all(np.isfinite(self.points), axis=1)]
        places = [
            f"{words(name)} {span(known[:, i], self.units.get(name, ''), self.readable.get(name))}"
            for i, name in enumerate(self.axes)
        ]
        where = f"{count(len(known), 'point')}, {listed(places)}" if len(known) else "no point"
        ended = "" if self.status.ok else f" {self.status.value}"
        return f"Boundary ({self.label}): {where}. {self.message}{ended}"

    def to_frame(self) -> pandas.DataFrame:
        """The points, one a row [SI]; rows without numbers separate the pieces of the curve."""
        rows = [dict(zip(self.axes, point, strict=True)) for point in self.points.tolist()]
        return frame_of(rows, self.units, self.readable)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The boundary in the plane of both parameters."""
        return self.drawn("plot_boundary", ax)

    def over(self, x: str, y: str) -> tuple[Array, Array]:
        """Values of `x` and of `y` along the curve.

        Raises
        ------
        EppError
            If the curve is over other parameters.
        """
        if {x, y} != set(self.axes):
            raise EppError(f"The boundary is over {' and '.join(self.axes)}; expected a map of the same axes.")
        first = self.axes.index(x)
        return self.points[:, first], self.points[:, 1 - first]


def outcome_boundary(
    case: Case | LureSystem,
    axes: Mapping[str, Axis],
    run: str = "predict",
    *,
    halvings: int = 5,
    allow: str | None = None,
    scheduler: str = "threads",
    workers: int | None = None,
    progress: bool = True,
) -> Boundary:
    """Where an analysis's outcome changes between oscillation and rest, over two axes.

    A coarse grid is swept first; then every edge between two cells that differ is halved again and again. All of this
    are sweeps, so it runs where a sweep runs. What is smaller than a cell of the coarse grid may be missed.

    Parameters
    ----------
    case : Case or LureSystem
    axes : mapping of str to axis
        Two axes as for a grid, coarse: ten values or so each.
    run : {"predict", "simulate", "cycles"}
        Whose outcome: describing functions, runs in time, or exact orbits.
    halvings : int
        How often an edge is halved; the boundary lies within 2**-(halvings + 1) of an edge.
    allow : str, optional
        A limit cycle that is allowed, as :func:`eppanalysis.sweep` takes it: the boundary is then where it begins
        to be exceeded.
    scheduler, workers, progress
        As :func:`eppanalysis.sweep` takes them.

    Returns
    -------
    Boundary

    Raises
    ------
    EppError
        If there are not two axes, or one of them or the analysis is not valid.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> axes = {"relay_dead_zone.threshold": "0.5:3:4", "loop.gain": "1:5:3"}
    >>> found = epp.outcome_boundary(
    ...     epp.case("relay_deadzone"), axes, "predict", halvings=2, progress=False
    ... )
    >>> found.axes, found.status.name
    (('relay_dead_zone.threshold', 'loop.gain'), 'CONVERGED')
    """
    from eppanalysis.sweep import schedule, sweep

    case = as_case(case)
    if run not in PREFIX:
        raise EppError(f"outcome_boundary: run is {run!r}; expected one of {', '.join(PREFIX)}.")
    prefix = PREFIX[Analysis(run)]
    outcome, there = (
        (f"{prefix}outcome", Outcome.OSCILLATES) if allow is None else (f"{prefix}allowed", Allowance.EXCEEDS)
    )
    check_counts("outcome_boundary", {"halvings": (halvings, 0)})
    x, y = _two(axes)
    where = nullcontext(scheduler) if scheduler == schedule.Scheduler.THREADS else schedule.address(scheduler, workers)
    with where as place:
        coarse = sweep(case, axes, run, allow=allow, scheduler=place, workers=workers, progress=progress)
        # What is undecided counts with what does not oscillate.
        inside = coarse[outcome].values == there
        grid = np.stack(np.meshgrid(coarse[x].values, coarse[y].values, indexing="ij"), axis=-1)
        edges = edges_of(inside)
        ends = np.array([[grid[a], grid[b]] if inside[a] else [grid[b], grid[a]] for a, b in edges]).reshape(-1, 2, 2)
        for _ in range(halvings if len(edges) else 0):
            # All edges at once, so that a round is one sweep on all workers.
            middle = ends.mean(axis=1)
            points = Zipped({x: middle[:, 0].tolist(), y: middle[:, 1].tolist()})
            found = sweep(case, points, run, allow=allow, scheduler=place, workers=workers, progress=progress)
            within = found[outcome].values == there
            ends[np.arange(len(ends)), np.where(within, 0, 1)] = middle
    crossings = dict(zip(edges, ends.mean(axis=1), strict=True))
    return Boundary(
        axes=(x, y),
        points=pieces_of(inside.shape, crossings),
        label=_WORDS[Analysis(run)] + (" exceed" + "s" * (run != "cycles") + " what is allowed") * (allow is not None),
        status=Status.CONVERGED,
        message=f"{len(edges)} edges of a grid of {' x '.join(map(str, inside.shape))} cells, halved {halvings} times.",
        units={name: case.unit(name)[0] for name in (x, y)},
        readable={name: case.readable(name) for name in (x, y)},
        provenance=Provenance(
            "outcome boundary", {"run": run, "halvings": halvings, "allow": allow}, case=case.provenance()
        ),
    )


def fold_boundary(case: Case | LureSystem, axes: Mapping[str, Axis], *, allow: str | None = None) -> Boundary:
    """The exact fold curve: for every value of the first axis, the value of the second at which cycles are born.

    Parameters
    ----------
    case : Case or LureSystem
    axes : mapping of str to axis
        Two axes: how many values folds are looked for at, evenly from the least to the largest (ten or so), and the
        range in which they are.
    allow : str, optional
        A limit cycle that is allowed, as :func:`design_bounds` takes it: in place of folds the exact bounds on the
        second axis, where the largest stable cycle becomes larger, whether it grows so large or is born so.

    Returns
    -------
    Boundary
        With status NOT_CONVERGED, and a gap, where a value of the first axis has no fold in the range.

    Raises
    ------
    EppError
        If there are not two axes, one of them is not valid, no value of the first axis has a fold, or the loop has
        sampled controllers.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> found = epp.fold_boundary(
    ...     case, {"loop.gain": "1:1.1:2", "relay_dead_zone.threshold": "1.2:2.5:2"}
    ... )
    >>> found.points.round(3).tolist()
    [[1.0, 1.663], [1.1, 1.829]]

    Where does a servo stay within what is allowed?

    >>> axes = {"loop.gain": "1:2:2", "play.gap": "0.1:1:2"}
    >>> found = epp.fold_boundary(epp.case("backlash_servo"), axes, allow="x 0.5")
    >>> found.points.round(3).tolist()
    [[1.0, 0.255], [2.0, 0.159]]
    """
    case = require_case(as_case(case), "fold_boundary")
    require_continuous(case.to_system(), "fold_boundary")
    x, y = _two(axes)
    design = make_design(case, axes)
    given, reach = (d.values[name] for d, name in zip(design.dimensions, (x, y), strict=True))
    rows, limits = np.linspace(given.min(), given.max(), given.size), (float(reach.min()), float(reach.max()))
    curve = _folds(case, x, y, rows, limits) if allow is None else _bounds(case, x, y, rows, limits, allow)
    missing = int(np.sum(np.isnan(curve.points[:, 0])))
    if missing == rows.size:
        raise EppError(
            f"fold_boundary: no {curve.what} in {y} was found at any value of {x}; expected a range that holds one."
            f"{curve.why}"
        )
    return Boundary(
        axes=(x, y),
        points=curve.points,
        label=curve.label,
        status=Status.NOT_CONVERGED if missing else Status.CONVERGED,
        message=f"{curve.what.capitalize()}s in {y} at {rows.size - missing} of {rows.size} values of {x}.{curve.why}",
        units={name: case.unit(name)[0] for name in (x, y)},
        readable={name: case.readable(name) for name in (x, y)},
        provenance=Provenance("fold boundary", {"limits": limits, "allow": allow}, case=case.provenance()),
    )


@dataclass(frozen=True)
class _Curve:
    """An exact curve: its points by row, what they are, and why some are missing."""

    points: Array
    what: str
    label: str
    why: str = ""


def _folds(case: Case, x: str, y: str, rows: Array, limits: tuple[float, float]) -> _Curve:
    search = _FoldSearch(case, x, y, rows, limits)
    search.run()
    return _Curve(search.found, "fold", "exact fold")


def _bounds(case: Case, x: str, y: str, rows: Array, limits: tuple[float, float], allow: str) -> _Curve:
    """The bounds on the second parameter where a size is allowed; as folds of a curve they are not tested."""
    from eppanalysis.methods.bounds.design import design_bounds

    bounds = design_bounds(case, x, y, at=rows.tolist(), within=limits, allow=allow, verify=False)
    exact = bounds.array("exact")
    points = np.where(np.isfinite(exact)[:, None], np.column_stack([rows, exact]), np.nan)
    missing = next((c for c in bounds if not np.isfinite(c.exact)), None)
    why = "" if missing is None else f" At a {words(x)} of {case.text(x, missing.value)}: {missing.message}"
    return _Curve(points, "bound", f"exact bound, {bounds.allowed} allowed", why)


@dataclass
class _FoldSearch:
    """A fold curve under way: a first fold, and from there row by row to both ends; lives for one call."""

    case: Case
    x: str
    y: str
    rows: Array
    limits: tuple[float, float]
    found: Array = field(init=False)

    def run(self) -> None:
        """Fill `found`, shape (rows, 2)."""
        n = self.rows.size
        self.found = np.full((n, 2), np.nan)
        for first in sorted(range(n), key=lambda i: abs(i - n // 2)):
            if self._follow(first, first, self.limits):
                self._march(first, 1)
                self._march(first, -1)
                return

    def _march(self, first: int, step: int) -> None:
        """From a fold on; where its curve ends, another one is looked for close by."""
        last, i, end = first, first + step, self.rows.size - 1 if step > 0 else 0
        while 0 <= i < self.rows.size:
            k = 0
            # Rows that lie far apart have folds that do, too: in the end all of the range is looked through.
            for share in (*_NEAR, 1.0):
                # The farther the last fold is behind, the farther its successor may have moved.
                half = share * (self.limits[1] - self.limits[0]) * abs(i - last)
                near = self.found[last, 1]
                window = max(near - half, self.limits[0]), min(near + half, self.limits[1])
                k = k or self._follow(i, end, window)
            last = i + (k - 1) * step if k else last
            i += max(k, 1) * step

    def _follow(self, i: int, end: int, window: tuple[float, float]) -> int:
        """Folds from row `i` towards row `end`, as far as one curve goes; how many there are."""
        from eppanalysis.methods.continuation.folds import continue_folds

        over, n, step = (self.rows[i], self.rows[end]), abs(end - i) + 1, 1 if end >= i else -1
        # A fold is reached along a branch from the side that has cycles; which that is is not known.
        for limits in (window[::-1], window):
            try:
                with np.errstate(over="ignore"):  # trial orbits that run away are refused
                    curve = continue_folds(self.case, self.y, self.x, limits, over, n_points=n)
            except EppError:
                continue
            k = len(curve.values)
            self.found[i : i + k * step if i + k * step >= 0 else None : step] = curve.values[:, ::-1]
            return k
        return 0


def _two(axes: Mapping[str, Axis]) -> tuple[str, str]:
    if not isinstance(axes, Mapping) or len(axes) != 2:
        raise EppError("A boundary lies in the plane of two axes; expected axes by parameter, two of them.")
    x, y = axes
    return x, y


Node = tuple[int, int]


def edges_of(inside: BoolArray) -> list[tuple[Node, Node]]:
    """Pairs of neighbouring nodes of a grid that differ."""
    across = [((i, j), (i + 1, j)) for i, j in np.argwhere(inside[1:] != inside[:-1]).tolist()]
    up = [((i, j), (i, j + 1)) for i, j in np.argwhere(inside[:, 1:] != inside[:, :-1]).tolist()]
    return across + up


def pieces_of(shape: tuple[int, ...], crossings: Mapping[tuple[Node, Node], Array]) -> Array:
    """Crossings joined within every square of the grid (marching squares), and the squares to curves."""
    joined: dict[tuple[Node, Node], list[tuple[Node, Node]]] = {edge: [] for edge in crossings}
    for i in range(shape[0] - 1):
        for j in range(shape[1] - 1):
            a, b, c, d = (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)
            # In a square with four crossings, neighbouring ones round the corners a and c belong together.
            cut = [edge for edge in ((a, d), (a, b), (b, c), (d, c)) if edge in joined]
            for one, other in zip(cut[::2], cut[1::2], strict=False):
                joined[one].append(other)
                joined[other].append(one)
    pieces = []
    # Open curves from their ends, then what is left: closed ones.
    for start in sorted(joined, key=lambda edge: (len(joined[edge]), edge)):
        curve = _walk(start, joined)
        if len(curve) > 1:
            pieces += [np.array([crossings[edge] for edge in curve]), _NO_POINT]
    return np.concatenate(pieces[:-1]) if pieces else np.zeros((0, 2))


def _walk(start: tuple[Node, Node], joined: dict[tuple[Node, Node], list[tuple[Node, Node]]]) -> list[Any]:
    """The curve that begins at an edge; its links are used up."""
    curve = [start]
    while joined[curve[-1]]:
        following = joined[curve[-1]].pop()
        joined[following].remove(curve[-1])
        curve.append(following)
    return curve
