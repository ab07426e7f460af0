"""Systems of the cells of a sweep, stacked for the engine.

On a grid nearly every number of a model depends on one axis alone. Then systems are made along the axes only and the
cells are put together from them, number by number; corners and some inner cells, made in full, confirm it. Cells whose
structure differs (a pulley with and without friction) are kept apart. A cell put together and one made in full are
equal to the last bit, so nothing depends on which way was taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.cases import Case
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.batch import HybridStack
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import input_signals_by_name
from eppanalysis.models.systems.linear import fastest_poles
from eppanalysis.sweep.axes import Design

#: Inner cells of a part that are made in full to confirm it, and corners at most.
_INNER, _CORNERS = 16, 64


def case_of(case: Case, design: Design, place: Sequence[int]) -> Case:
    """The case of one cell."""
    return case.with_values(design.at(place), "sweep")


def hybrid_of(case: Case) -> HybridSystem:
    """The hybrid system of a case, driven by its input."""
    system = case.to_system()
    return HybridSystem.from_lure(system, input_signals_by_name(system.input_names, case.input))


def structure(system: HybridSystem) -> tuple[Any, ...]:
    """What systems of one stack have in common."""
    return (tuple(a.shape for a in system.model), system.compared.tobytes(), system.n_plant)


@dataclass(frozen=True, eq=False)
class _Part:
    """Part of a grid whose cells are put together from systems along its axes."""

    base: HybridStack  # one cell: the first place of the part on every axis
    lines: tuple[HybridStack, ...]  # systems along each axis, the other axes at their first places
    changed: tuple[tuple[BoolArray, ...], ...]  # by array and axis: which numbers the axis moves
    clock: int  # the axis that moves the time scale; -1 where the linear part depends on several axes or on none
    n_plant: int

    def stack(self, places: IntArray) -> HybridStack:
        """Cells at places within the part, shape (cells, axes)."""
        parts = [
            self._combine(start, along, changed, places)
            for start, along, changed in zip(
                _arrays(self.base), zip(*map(_arrays, self.lines), strict=True), self.changed, strict=True
            )
        ]
        model = type(self.base.model)(*parts[:-3])
        x0, modes0, held = parts[-3:]
        if self.clock >= 0:
            scale = self.lines[self.clock].time_scale[places[:, self.clock]]
        else:
            scale = _time_scale(model.A[:, : self.n_plant, : self.n_plant])
        return HybridStack(model, x0, modes0, held, self.base.compared, scale, self.base.signal_names)

    @staticmethod
    def _combine(
        start: NDArray[Any], along: Sequence[NDArray[Any]], changed: Sequence[BoolArray], places: IntArray
    ) -> NDArray[Any]:
        out = np.repeat(start, len(places), axis=0)
        for axis, (line, where) in enumerate(zip(along, changed, strict=True)):
            if np.any(where):
                out[:, where] = line[:, where][places[:, axis]]
        return out


def _arrays(stack: HybridStack) -> list[NDArray[Any]]:
    return [*stack.model, stack.x0, stack.modes0, stack.H0]


def _time_scale(A: Array) -> Array:
    """Time scales of plants as the hybrid system has them, shape (cells,)."""
    if A.shape[1] == 0:
        return np.ones(len(A))
    fastest = fastest_poles(A)
    with np.errstate(divide="ignore"):
        return np.where(fastest > 0, 2.0 / fastest, 1.0)


@dataclass(frozen=True, eq=False)
class Builder:
    """Makes the stacks of a sweep's cells."""

    case: Case
    design: Design
    classes: tuple[IntArray, ...] = ()  # for each axis: which group of equal structure a place belongs to
    within: tuple[IntArray, ...] = ()  # for each axis: which place it is within its group
    #: By the groups of a cell on every axis; cells of no part are made in full.
    parts: dict[tuple[int, ...], _Part] = field(default_factory=dict)

    def stacks(self, places: IntArray) -> tuple[list[tuple[IntArray, HybridStack]], dict[int, str]]:
        """Stacks of cells, and what was wrong with the cells that are in none.

        Parameters
        ----------
        places : int array, shape (cells, axes)

        Returns
        -------
        list of (int array, HybridStack)
            Rows of `places`, and their stack.
        dict of int to str
            By row: the sentence.
        """
        found: list[tuple[IntArray, HybridStack]] = []
        rest = np.arange(len(places))
        if self.parts:
            groups = np.stack([c[places[:, k]] for k, c in enumerate(self.classes)], axis=1)
            inner = np.stack([w[places[:, k]] for k, w in enumerate(self.within)], axis=1)
            taken = np.zeros(len(places), bool)
            for key, part in self.parts.items():
                rows = np.flatnonzero(np.all(groups == key, axis=1))
                if rows.size:
                    found.append((rows, part.stack(inner[rows])))
                    taken[rows] = True
            rest = np.flatnonzero(~taken)
        made, wrong = self._made(places, rest)
        return found + made, wrong

    def _made(self, places: IntArray, rows: IntArray) -> tuple[list[tuple[IntArray, HybridStack]], dict[int, str]]:
        groups: dict[tuple[Any, ...], tuple[list[int], list[HybridSystem]]] = {}
        wrong: dict[int, str] = {}
        for row in rows.tolist():
            try:
                system = hybrid_of(case_of(self.case, self.design, places[row]))
            except Exception as error:
                wrong[row] = sentence(error)
                continue
            members, systems = groups.setdefault(structure(system), ([], []))
            members.append(row)
            systems.append(system)
        names = self.case.to_system().signals.names
        return [(np.array(m), HybridStack.of(s, names)) for m, s in groups.values()], wrong


def sentence(error: Exception) -> str:
    """What went wrong, in one sentence."""
    if isinstance(error, EppError):
        return str(error)
    return f"{type(error).__name__}: {error}".split("\n")[0][:300]


def make_builder(case: Case, design: Design) -> Builder:
    """The builder of a sweep; of a grid it puts cells together wherever that is exact."""
    sizes = design.shape
    if len(sizes) < 2 or case.to_system().time_step or design.n_cells <= 2 * sum(sizes) + _INNER:
        return Builder(case, design)
    made = _Made(case, design)
    origin = made.origin()
    if origin is None:
        return Builder(case, design)
    classes, within = zip(*(_classes(made, axis, origin) for axis in range(len(sizes))), strict=True)
    plain = Builder(case, design, classes, within)
    parts = {}
    for key in product(*(range(int(c.max()) + 1) for c in classes)):
        part = _part(plain, made, key)
        if part is not None:
            parts[key] = part
    return replace(plain, parts=parts)


class _Made:
    """Systems of cells made in full, each once; None where there is none."""

    def __init__(self, case: Case, design: Design) -> None:
        self.case, self.design = case, design
        self.names = case.to_system().signals.names
        self._found: dict[tuple[int, ...], HybridSystem | None] = {}

    def at(self, *place: int) -> HybridSystem | None:
        """The system of one cell."""
        if place not in self._found:
            try:
                self._found[place] = hybrid_of(case_of(self.case, self.design, place))
            except Exception:
                self._found[place] = None
        return self._found[place]

    def origin(self) -> tuple[int, ...] | None:
        """A place where a system can be made: the first one, the middle or the last one."""
        for share in (0.0, 0.5, 1.0):
            place = tuple(int(share * (n - 1)) for n in self.design.shape)
            if self.at(*place) is not None:
                return place
        return None

    def stack(self, places: Sequence[tuple[int, ...]]) -> HybridStack | None:
        """Several cells; None where one of them cannot be made, or their structures differ."""
        systems = [system for place in places if (system := self.at(*place)) is not None]
        if len(systems) < len(places) or len({structure(system) for system in systems}) != 1:
            return None
        return HybridStack.of(systems, self.names)


def _classes(made: _Made, axis: int, origin: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    """Groups of equal structure along an axis, and the place of each value within its group; wrong values are -1."""
    keys: dict[tuple[Any, ...], int] = {}
    counts: list[int] = []
    n = made.design.shape[axis]
    group, within = np.full(n, -1), np.zeros(n, np.int64)
    for i in range(n):
        system = made.at(*origin[:axis], i, *origin[axis + 1 :])
        if system is None:
            continue
        g = keys.setdefault(structure(system), len(keys))
        if g == len(counts):
            counts.append(0)
        group[i], within[i] = g, counts[g]
        counts[g] += 1
    return group, within


def _part(builder: Builder, made: _Made, key: tuple[int, ...]) -> _Part | None:
    """One part of the grid; None where its cells must be made in full."""
    members = [np.flatnonzero(c == k) for c, k in zip(builder.classes, key, strict=True)]
    first = tuple(int(m[0]) for m in members)
    base = made.stack([first])
    along = [made.stack([(*first[:k], int(i), *first[k + 1 :]) for i in places]) for k, places in enumerate(members)]
    lines = tuple(line for line in along if line is not None)
    start = made.at(*first)
    if base is None or start is None or len(lines) < len(along):
        return None
    changed = tuple(
        tuple(np.any(line != one, axis=0) for line in these)
        for one, these in zip(_arrays(base), zip(*map(_arrays, lines), strict=True), strict=True)
    )
    # What moves along two axes is no matter of one of them: such cells are made in full.
    if any(np.any(np.sum(where, axis=0) > 1) for where in changed):
        return None
    n = start.n_plant
    # The time scale hangs on A: it goes along with the only axis that moves A, and is computed anew where several do.
    moves = [bool(np.any(line.model.A[:, :n, :n] != base.model.A[:, :n, :n])) for line in lines]
    clock = moves.index(True) if sum(moves) == 1 else -1
    if sum(moves) == 0:
        clock = 0  # all the same along every axis
    part = _Part(base, lines, changed, clock, n)
    return part if _confirmed(builder, made, part, members) else None


def _confirmed(builder: Builder, made: _Made, part: _Part, members: list[IntArray]) -> bool:
    """Whether the part's corners, and inner cells drawn once and for all, equal those made in full."""
    ends = [sorted({0, len(m) - 1, *_extremes(builder, k, m)}) if len(m) > 1 else [0] for k, m in enumerate(members)]
    corners = [c for c, _ in zip(product(*ends), range(_CORNERS), strict=False)]
    draw = np.random.default_rng(0)
    inner = [tuple(int(draw.integers(len(m))) for m in members) for _ in range(_INNER)]
    places = np.array(corners + inner)
    stack = part.stack(places)
    for row, place in enumerate(places):
        full = made.at(*(int(m[i]) for m, i in zip(members, place, strict=True)))
        if full is None:
            return False
        arrays = [*full.model, full.x0, full.modes0, full.H0]
        same = all(
            a[row].shape == b.shape and a[row].tobytes() == b.tobytes()
            for a, b in zip(_arrays(stack), arrays, strict=True)
        )
        if not same or stack.time_scale[row] != full.time_scale:
            return False
    return True


def _extremes(builder: Builder, axis: int, members: IntArray) -> tuple[int, int]:
    """Places of the smallest and the largest value."""
    values = next(iter(builder.design.dimensions[axis].values.values()))[members]
    return int(np.argmin(values)), int(np.argmax(values))
