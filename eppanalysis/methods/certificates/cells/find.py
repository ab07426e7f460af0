"""Finds all limit cycles of a relay with dead zone, with proof: cells of its return map are halved until it is decided.

Cells that do not lie on a circle of the graph "may come back to" hold no periodic motion. Circles of cells are halved
until none is left, or each is proved to hold one cycle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb, ctx
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from eppanalysis.methods.certificates import check_cells
from eppanalysis.methods.certificates.check_cells import BITS, GRID, Refused, ReturnMap
from eppanalysis.methods.certificates.registry import sealed

#: Cells in which the search begins, as cuts of both sides; cells and halvings after which it gives up.
_FIRST_CUTS, _MOST_CELLS, _MOST_ROUNDS = 4, 6000, 60
#: Returns after which a motion would have come to rest.
_MOST_RETURNS = 1000
#: Most clusters of cells that are tried for a cycle at once; relative room about a period for the rounding of others.
_MOST_CLUSTERS, _ROOM = 64, 1e-9


@dataclass
class Node:
    """A box of the tree: cut in two, or a leaf with its images and the slopes of the map."""

    box: tuple[int, int, int, int]
    cut: str = "."
    parts: tuple[Node, ...] = ()
    images: list[list[int]] | None = None
    slope: Any = None

    def halve(self, mark: str) -> None:
        """Cut it in speed ("v") or in acceleration ("a")."""
        i = 0 if mark == "v" else 2
        middle = (self.box[i] + self.box[i + 1]) // 2
        low, high = list(self.box), list(self.box)
        low[i + 1] = high[i] = middle
        self.cut, self.images = mark, None
        self.parts = tuple(Node(tuple(box)) for box in (low, high))  # type: ignore[arg-type]

    def map(self, returns: ReturnMap) -> None:
        """Where its points come back."""
        found = list(returns.reached(self.box))
        self.images = [image for image, _ in found]
        self.slope = found[0][1] if len(found) == 1 else None

    def longer(self, shape: float) -> str:
        """The side that the map stretches most; without slopes, speeds about twice as much as accelerations.

        Parameters
        ----------
        shape : float
            The greatest speed over the greatest acceleration.
        """
        sides = np.array([(self.box[1] - self.box[0]) * shape, self.box[3] - self.box[2]])
        stretch = np.array([2.0, 1.0]) if self.slope is None else np.abs(_floats(self.slope)).max(axis=0)
        return "v" if np.argmax(stretch * sides) == 0 else "a"

    def leaves(self) -> Iterator[Node]:
        """Leaves in the order of the cover."""
        if not self.parts:
            yield self
        for part in self.parts:
            yield from part.leaves()

    def cover(self) -> str:
        """The text of the tree."""
        return self.cut + "".join(part.cover() for part in self.parts)


@dataclass
class Graph:
    """Which cells may come back to which."""

    pairs: np.ndarray  # (2, m): from cell, to cell
    #: label, count: (n,), int: of each cell the group of those that may come back to one another, and how many groups
    #: there are.
    label: np.ndarray
    count: int
    circles: list[int]  # groups from which a motion may come back to them

    @classmethod
    def of(cls, leaves: list[Node]) -> Graph:
        """Of cells with their images."""
        boxes = np.array([leaf.box for leaf in leaves])
        met = []
        for n, leaf in enumerate(leaves):
            for a, b, c, d in leaf.images or ():
                near = (boxes[:, 0] <= b) & (boxes[:, 1] >= a) & (boxes[:, 2] <= d) & (boxes[:, 3] >= c)
                ends = np.flatnonzero(near)
                met.append(np.stack([np.full(len(ends), n), ends]))
        start, end = pairs = np.concatenate([np.zeros((2, 0), int), *met], axis=1)
        graph = csr_matrix((np.ones(len(start)), (start, end)), (len(leaves), len(leaves)))
        count, label = connected_components(graph, connection="strong")
        # A periodic motion stays in one group; a cell by itself is a circle only where it may come back to itself.
        loops = np.bincount(label, minlength=count) > 1
        loops[label[start[start == end]]] = True
        return cls(pairs, label, count, np.flatnonzero(loops).tolist())

    def members(self, group: int) -> list[int]:
        """Cells of a group."""
        return np.flatnonzero(self.label == group).tolist()

    def descending(self) -> np.ndarray:
        """A number for each group, smaller than those of all groups that lead to it."""
        rows, columns = self.label[self.pairs]
        pairs = np.unique(np.stack([rows, columns], axis=1)[rows != columns], axis=0)
        # From the cells that lead nowhere upwards: the checker tests
        # that every image has a smaller number (docs/theory/proofs.md).
        left = np.bincount(pairs[:, 0], minlength=self.count)
        before: list[list[int]] = [[] for _ in range(self.count)]
        for start, end in pairs.tolist():
            before[end].append(start)
        number, ready = np.zeros(self.count, int), np.flatnonzero(left == 0).tolist()
        for n in range(self.count):
            at = ready.pop()
            number[at] = n
            for start in before[at]:
                left[start] -= 1
                if not left[start]:
                    ready.append(start)
        return number


@dataclass
class Cluster:
    """Cells that are proved to hold one cycle: their group, the form that rises, period [s], multipliers outside."""

    group: int
    form: list[str]
    period: float
    outside: int

    @property
    def claim(self) -> dict[str, Any]:
        """As the certificate has it."""
        ends = [str(Fraction(f"{self.period * (1 + sign * _ROOM):.12g}")) for sign in (-1, 1)]
        return {"period": ends, "outside": self.outside}


def find(loop: Mapping[str, Any], cycles: bool = False) -> dict[str, Any] | str:
    """The certificate that a loop has no periodic motion but rest and those that it lists, or why there is none.

    Parameters
    ----------
    loop : mapping
        As :func:`~eppanalysis.methods.certificates.rational.rational_loop` gives it.
    cycles : bool, optional
        Whether there may be cycles; else a loop with one is given up early.

    Returns
    -------
    dict or str
        Plain data: statement, loop, claim, evidence; or the end of a sentence, empty where cells do not cover the loop.
    """
    with ctx.workprec(BITS):
        try:
            returns = ReturnMap(loop)
        except (Refused, LookupError):
            return ""
        # With a cycle there is no such cover, and halving would go on to its end: one run tells that first.
        if not cycles and _goes_on(returns):
            return f"; a motion has not come to rest after {_MOST_RETURNS} returns"
        return _search(loop, returns, cycles)


def _goes_on(returns: ReturnMap) -> bool:
    """Whether a motion from half the greatest speed is not at rest after many returns: then there is a cycle."""
    v, a = arb(returns.sides[0] / 2), arb(0)
    for _ in range(_MOST_RETURNS):
        image = returns.images(v, a)
        if len(image) != 1:
            return False
        v, a = (x.mid() for x in image[0][:2])
    return True


def _search(loop: Mapping[str, Any], returns: ReturnMap, cycles: bool) -> dict[str, Any] | str:
    """Halve cells on circles until there is none, or each holds one cycle."""
    root, shape = Node((0, 2**GRID, -(2**GRID), 2**GRID)), float(returns.sides[0] / returns.sides[1])
    for mark in "va" * _FIRST_CUTS:
        for leaf in list(root.leaves()):
            leaf.halve(mark)
    for _ in range(_MOST_ROUNDS):
        leaves = list(root.leaves())
        for leaf in leaves:
            if leaf.images is None:
                leaf.map(returns)
        graph = Graph.of(leaves)
        known = _clusters(returns, leaves, graph) if cycles and len(graph.circles) <= _MOST_CLUSTERS else []
        if len(known) == len(graph.circles):
            return _document(loop, root, graph, known)
        decided = {cluster.group for cluster in known}
        left = [n for group in graph.circles if group not in decided for n in graph.members(group)]
        if len(leaves) + len(left) > _MOST_CELLS:
            break
        for n in left:
            leaves[n].halve(leaves[n].longer(shape))
    return f"; {len(left)} of {len(leaves)} cells of the return map may map to themselves"


def _clusters(returns: ReturnMap, leaves: list[Node], graph: Graph) -> list[Cluster]:
    """Circles of cells that are proved to hold one cycle, in ascending period."""
    found = []
    for group in graph.circles:
        boxes = zip(*(leaves[n].box for n in graph.members(group)), strict=True)
        box = [end(side) for end, side in zip((min, max, min, max), boxes, strict=True)]
        image = returns.images(*returns.box(box))
        if len(image) != 1 or image[0][2] is None:
            continue
        form = _form(_floats(image[0][2]))
        try:
            period, outside = returns.cycle(box, form)
        except (Refused, ArithmeticError, ValueError):
            continue
        found.append(Cluster(group, form, float(period), outside))
    return sorted(found, key=lambda cluster: cluster.period)


def _form(slope: np.ndarray) -> list[str]:
    """A quadratic form that rises along a linear map, shape (2, 2): positive where it stretches, else negative."""
    values, rows = np.linalg.eig(slope.T)
    # With slope^T f = mu f the sum of f f*/(|mu|^2 - 1) has A^T Q A - Q =
    # sum of f f*, which is positive definite (docs/theory/proofs.md).
    squares = np.abs(values) ** 2 - 1.0
    Q = sum(np.outer(f, f.conj()).real / s for f, s in zip(rows.T, squares, strict=True))
    Q = Q / np.abs(Q).max()
    return [str(Fraction(f"{x:.12g}")) for x in (Q[0, 0], Q[0, 1], Q[1, 1])]


def _document(loop: Mapping[str, Any], root: Node, graph: Graph, known: list[Cluster]) -> dict[str, Any]:
    """The certificate."""
    order = graph.descending()
    return sealed(
        {
            "statement": check_cells.STATEMENT,
            "loop": dict(loop),
            "claim": {"cells": len(graph.label), "cycles": [cluster.claim for cluster in known]},
            "evidence": {
                "cover": root.cover(),
                "order": order[graph.label].tolist(),
                "forms": [[int(order[cluster.group]), cluster.form] for cluster in known],
            },
        }
    )


def _floats(matrix: Any) -> np.ndarray:
    """Middles of the balls of a matrix."""
    return np.array([[float(x) for x in row] for row in matrix.tolist()])
