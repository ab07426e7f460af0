"""Boundaries in the plane of two parameters: where an outcome changes, and round the region without a limit cycle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import check_counts, checked
from eppanalysis.arrays import Array, BoolArray
from eppanalysis.cases import as_case
from eppanalysis.errors import EppError
from eppanalysis.models.systems.subject import require_case, require_continuous
from eppanalysis.progress import Progress
from eppanalysis.readable import count, listed, percent, span, words
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
    kinds : tuple of str
        What the stretch that ends at each point is: a fold, a border collision, ...; of :func:`free_region`, else none.
    within : tuple of (float, float)
        Ranges of both parameters in which it was sought [SI]; of :func:`free_region`, else none.
    area : float
        Of the region that it goes round [product of the SI units]; nan where that is not known.
    """

    axes: tuple[str, str]
    points: Array
    label: str
    status: Status
    message: str

    units: dict[str, str] = field(default_factory=dict)
    readable: dict[str, tuple[str, float]] = field(default_factory=dict)
    kinds: tuple[str, ...] = ()
    within: tuple[tuple[float, float], ...] = ()
    area: float = float("nan")

    in_json = "axes points kinds within area label status message provenance"

    def __str__(self) -> str:
        """Over which values the boundary is known, and how it was found."""
        known = self.points[np.all(np.isfinite(self.points), axis=1)]
        ranges = np.array(self.within).T if self.within else known
        places = [
            f"{words(name)} {span(ranges[:, i], self.units.get(name, ''), self.readable.get(name))}"
            for i, name in enumerate(self.axes)
        ]
        if math.isfinite(self.area):
            share = self.area / math.prod(high - low for low, high in self.within)
            return f"{self.label[0].upper()}{self.label[1:]} in {percent(share)} of {listed(places)}. {self.message}"
        where = f"{count(len(known), 'point')}, {listed(places)}" if len(known) else "no point"
        ended = "" if self.status.ok else f" {self.status.value}"
        return f"Boundary ({self.label}): {where}. {self.message}{ended}"

    def stretches(self, kinds: Iterable[str]) -> tuple[Array, Array]:
        """Values of both parameters along the stretches of some kinds, with nan in place of the others."""
        at = np.isin(self.kinds, list(kinds))
        # A stretch goes from the point before the first that it ends at to the last.
        on = at | np.append(at[1:], False)
        across, up = np.where(on[:, None], self.points, np.nan).T
        return across, up

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


def free_region(
    case: Case | LureSystem,
    axes: Mapping[str, Axis],
    *,
    allow: str | None = None,
    places: int = 5,
    progress: Progress | None = None,
) -> Boundary:
    """The region of two parameters without a limit cycle: its border all round, each stretch with its kind.

    The border is followed through turns in either parameter, cusps and changes of the sequence of events, and where
    the borders of two families of cycles cross (docs/theory/exact_orbits.md, Regions). Each point of it is the end of
    exact cycles, and tested on both sides: by the search for limit cycles and by 50 runs on the free one, by an exact
    orbit on the other. Where a border is, is known from searches at a grid of places over the ranges: an island that
    lies between these may be missed.

    Parameters
    ----------
    case : Case or LureSystem
    axes : mapping of str to axis
        Two axes, as for a grid; only the least and the largest value of each count.
    allow : str, optional
        A limit cycle that is allowed, as :func:`design_bounds` takes it: the region is then where no stable cycle is
        larger.
    places : int
        Along each axis, at which limit cycles are searched for.
    progress : callable, optional
        Called with the number of points so far, None, and a text.

    Returns
    -------
    Boundary
        Closed, with `kinds` and `area`. NOT_CONVERGED, without an area, where the border could not be followed all
        round.

    Raises
    ------
    EppError
        If there are not two axes, one of them is not valid, limit cycles are at all places searched, no border was
        found, or the loop has sampled controllers.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> found = epp.free_region(
    ...     case,
    ...     {"loop.gain": [1.05, 1.25], "relay_dead_zone.threshold": [1.5, 1.8]},
    ...     places=2,
    ... )
    >>> sorted(set(found.kinds)), round(found.area, 6)
    (['end of the range', 'fold'], 0.000887)
    """
    from eppanalysis.methods.bounds.region import RegionSearch
    from eppanalysis.methods.continuation.own_states import in_own_states

    case = require_case(as_case(case), "free_region")
    require_continuous(case.to_system(), "free_region")
    check_counts("free_region", {"places": (places, 2)})
    x, y = _two(axes)
    given = [d.values[name] for d, name in zip(make_design(case, axes).dimensions, (x, y), strict=True)]
    low, high = (np.array([float(end(v)) for v in given]) for end in (np.min, np.max))
    for name, start, stop in zip((x, y), low, high, strict=True):
        if not start < stop:
            raise EppError(f"free_region: {name} has one value; expected a range.")
    search = RegionSearch(in_own_states(case), (x, y), low, high, places, allow, progress)
    search.run()
    if not search.borders:
        everywhere = f"limit cycles are at all places searched; expected ranges of {x} and {y} with one that has none."
        raise EppError(f"free_region: {search.why or everywhere}")
    pieces: list[Array] = []
    kinds: list[str] = []
    for border in search.borders:
        pieces += [low + (high - low) * border.places, _NO_POINT]
        kinds += [*map(str, border.kinds), ""]
    what = "limit cycle" if allow is None else f"stable limit cycle larger than allowed ({search.settings.allowed})"
    tested = [p.verified for border in search.borders for p in border.points if p.cycle is not None]
    message = search.why or (
        f"Of {count(len(tested), 'point')} on its border {sum(tested)} passed the tests on both sides; "
        f"{count(len(search.searched), 'place')} over the ranges were searched"
        + (f", {search.n_open} of them without an answer." if search.n_open else ".")
    )
    return Boundary(
        axes=(x, y),
        points=np.concatenate(pieces[:-1]),
        label=f"no {what}",
        status=Status.NOT_CONVERGED if search.why else Status.CONVERGED,
        message=message,
        units={name: case.unit(name)[0] for name in (x, y)},
        readable={name: case.readable(name) for name in (x, y)},
        kinds=tuple(kinds[:-1]),
        within=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        area=search.area * float(np.prod(high - low)),
        provenance=Provenance(
            "free region", {"low": low.tolist(), "high": high.tolist(), "allow": allow}, case=case.provenance()
        ),
    )


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
