"""Finds a certificate of absence for a relay with dead zone: cells of its return map are halved until it is decided.

Cells that do not lie on a circle of the graph "may come back to" hold no periodic motion. Where circles are left, their
cells are halved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, ctx
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from eppanalysis.methods.certificates import check_cells
from eppanalysis.methods.certificates.check_cells import BITS, GRID, Refused, ReturnMap
from eppanalysis.methods.certificates.registry import sealed

#: Cells in which the search begins, as cuts of both sides; cells and halvings after which it gives up.
_FIRST_CUTS, _MOST_CELLS, _MOST_ROUNDS = 4, 4000, 40
#: Returns after which a motion would have come to rest.
_MOST_RETURNS = 40


@dataclass
class Node:
    """A box of the tree: cut in two, or a leaf with its images."""

    box: tuple[int, int, int, int]
    cut: str = "."
    parts: tuple[Node, ...] = ()
    images: list[list[int]] | None = None

    def halve(self, mark: str) -> None:
        """Cut it in speed ("v") or in acceleration ("a")."""
        i = 0 if mark == "v" else 2
        middle = (self.box[i] + self.box[i + 1]) // 2
        low, high = list(self.box), list(self.box)
        low[i + 1] = high[i] = middle
        self.cut, self.images = mark, None
        self.parts = tuple(Node(tuple(box)) for box in (low, high))  # type: ignore[arg-type]

    def longer(self) -> str:
        """The side to halve: the return map stretches speeds about twice as much as accelerations."""
        return "v" if 4 * (self.box[1] - self.box[0]) >= self.box[3] - self.box[2] else "a"

    def leaves(self) -> Iterator[Node]:
        """Leaves in the order of the cover."""
        if not self.parts:
            yield self
        for part in self.parts:
            yield from part.leaves()

    def cover(self) -> str:
        """The text of the tree."""
        return self.cut + "".join(part.cover() for part in self.parts)


def find(loop: Mapping[str, Any]) -> dict[str, Any] | str:
    """The certificate that a loop has no periodic motion but rest, or why there is none.

    Parameters
    ----------
    loop : mapping
        As :func:`~eppanalysis.methods.certificates.rational.rational_loop` gives it.

    Returns
    -------
    dict or str
        Plain data: statement, loop, claim, evidence; or the end of a sentence, empty where cells do not cover the loop.
    """
    try:
        with ctx.workprec(BITS):
            returns = ReturnMap(loop)
            if _goes_on(returns):
                return f"; a motion has not come to rest after {_MOST_RETURNS} returns"
            return _search(loop, returns)
    except Refused:
        return ""


def _goes_on(returns: ReturnMap) -> bool:
    """Whether a motion from half the greatest speed is not at rest after many returns: then cells are in vain."""
    v, a = arb(returns.sides[0] / 2), arb(0)
    for _ in range(_MOST_RETURNS):
        image = returns.images([v, v], [a, a])
        if len(image) != 1:
            return False
        v, a = (x.mid() for x in image[0][:2])
    return True


def _search(loop: Mapping[str, Any], returns: ReturnMap) -> dict[str, Any] | str:
    """Halve cells on circles until there is none."""
    root = Node((0, 2**GRID, -(2**GRID), 2**GRID))
    for mark in "va" * _FIRST_CUTS:
        for leaf in list(root.leaves()):
            leaf.halve(mark)
    for _ in range(_MOST_ROUNDS):
        leaves = list(root.leaves())
        circles, order = _circles(returns, leaves)
        if not len(circles):
            return sealed(
                {
                    "statement": check_cells.STATEMENT,
                    "loop": dict(loop),
                    "claim": {"cells": len(leaves)},
                    "evidence": {"cover": root.cover(), "order": order},
                }
            )
        if len(leaves) + len(circles) > _MOST_CELLS:
            break
        for n in circles:
            leaves[n].halve(leaves[n].longer())
    return f"; {len(circles)} of {len(leaves)} cells of the return map may come back to themselves"


def _circles(returns: ReturnMap, leaves: list[Node]) -> tuple[list[int], list[int]]:
    """Cells that may come back to themselves, and an order in which all others only descend."""
    boxes = np.array([leaf.box for leaf in leaves])
    rows, columns = [], []
    for n, leaf in enumerate(leaves):
        if leaf.images is None:
            leaf.images = list(returns.reached_from(leaf.box))
        for a, b, c, d in leaf.images:
            near = (boxes[:, 0] <= b) & (boxes[:, 1] >= a) & (boxes[:, 2] <= d) & (boxes[:, 3] >= c)
            met = np.flatnonzero(near).tolist()
            rows += [n] * len(met)
            columns += met
    start, end, size = np.array(rows, int), np.array(columns, int), len(leaves)
    graph = csr_matrix((np.ones(len(start)), (start, end)), (size, size))
    count, label = connected_components(graph, connection="strong")
    loops = np.bincount(label, minlength=count) > 1
    loops[label[start[start == end]]] = True
    order = _descending(label[start], label[end], count)
    return np.flatnonzero(loops[label]).tolist(), order[label].tolist()


def _descending(rows: np.ndarray, columns: np.ndarray, count: int) -> np.ndarray:
    """A number for each group, smaller than those of all groups that lead to it."""
    pairs = np.unique(np.stack([rows, columns], axis=1)[rows != columns], axis=0)
    left = np.bincount(pairs[:, 0], minlength=count)
    before: list[list[int]] = [[] for _ in range(count)]
    for start, end in pairs.tolist():
        before[end].append(start)
    number, ready = np.zeros(count, int), np.flatnonzero(left == 0).tolist()
    for n in range(count):
        at = ready.pop()
        number[at] = n
        for start in before[at]:
            left[start] -= 1
            if not left[start]:
                ready.append(start)
    return number
