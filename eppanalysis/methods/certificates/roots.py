"""Finds a certificate of all roots of the first-order balance in a box: a cover of it, and an enclosure of each root.

Boxes are cut until each is certainly empty or lies in a region that certainly holds one root. Whether it is so is asked
of the checker's own functions, so that what is found here is what the checker sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from flint import fmpq

from eppanalysis.methods.certificates import check_roots
from eppanalysis.methods.certificates.check_roots import Balance, leaves, within
from eppanalysis.methods.certificates.numbers import middle_of
from eppanalysis.methods.certificates.registry import sealed

#: Amplitude from, to [unit of the input], angular frequency from, to [rad/s].
Box = tuple[fmpq, fmpq, fmpq, fmpq]

#: Boxes that are looked at in one piece; what is left then is undecided.
_MOST_BOXES = 20_000
#: Share of its place below which the side of a box is not cut any more.
_LEAST = fmpq(1, 2**30)
#: Share of its place by which a root is enclosed, to either side.
_ENCLOSED = fmpq(1, 2**70)
#: Sides of a box, as shares of its place, from which a root is looked for in it.
_NEAR = fmpq(1, 3)
_NEWTON_STEPS = 12


@dataclass
class _Root:
    enclosure: Box
    region: Box


@dataclass
class _Search:
    """A search in one declared box."""

    balance: Balance
    box: Box
    roots: list[_Root] = field(default_factory=list)

    def cover(self, part: Box) -> str:
        """Marks of the boxes that one piece is cut into, as the checker reads them."""
        marks: list[str] = []
        left = [part]
        while left:
            box = left.pop()
            mark = self.mark(box, part, len(marks) < _MOST_BOXES)
            marks.append(mark)
            if mark in "aw":
                left += [half for _, half in leaves(mark + "..", box)][::-1]
        return "".join(marks)

    def mark(self, box: Box, part: Box, may_cut: bool) -> str:
        """What becomes of a box."""
        if self.balance.empty(box):
            return "."
        if any(within(box, root.region) for root in self.roots):
            return "r"
        wide = max(_share(box[:2]), _share(box[2:]))
        if wide < _NEAR and self.root_near(box, part):
            return "r"
        way = self.direction(box)
        return way if may_cut and _share(box[:2] if way == "a" else box[2:]) > _LEAST else "?"

    def direction(self, box: Box) -> str:
        """Which cut makes the balance sharper: that of the unknown that spreads it more."""
        N, _ = self.balance.gain.over(*box[:2])
        D, _, M, _ = self.balance.linear(*box[2:])
        by_amplitude = float(N.rad() * M.abs_upper())
        by_frequency = float(D.rad() + N.abs_upper() * M.rad())
        if not by_amplitude + by_frequency < float("inf"):
            return "a" if _share(box[:2]) > _share(box[2:]) else "w"
        return "a" if by_amplitude > by_frequency else "w"

    def root_near(self, box: Box, part: Box) -> bool:
        """Whether a region about the box is proved to hold one root, which is noted."""
        place = self.newton(box, part)
        if place is None:
            return False
        enclosure = _about(place, (place[0] * _ENCLOSED, place[1] * _ENCLOSED))
        sides = ((box[1] - box[0]) / 8, (box[3] - box[2]) / 8)
        region = _hull(_grown(box, sides), _about(place, sides))
        known = next((root for root in self.roots if _meet(root.enclosure, enclosure)), None)
        region = _clipped(region if known is None else _hull(region, known.region), part)
        inside = within(enclosure, self.box) and within(enclosure, region)
        if not (inside and region[2] > 0 and self.balance.holds_one(region)):
            return False
        if known is not None:
            known.region = region
            return True
        if not self.balance.holds_one(enclosure):
            return False
        self.roots.append(_Root(enclosure, region))
        return True

    def newton(self, box: Box, part: Box) -> tuple[fmpq, fmpq] | None:
        """Where Newton's method from the middle of a box ends, where that is near the box."""
        place = ((box[0] + box[1]) / 2, (box[2] + box[3]) / 2)
        near = _grown(box, (box[1] - box[0], box[3] - box[2]))
        for _ in range(_NEWTON_STEPS):
            found = self.balance.krawczyk((place[0], place[0], place[1], place[1]))
            if not found:
                return None
            place = (place[0] - middle_of(found[0][0]), place[1] - middle_of(found[1][0]))
            if not (near[0] < place[0] < near[1] and near[2] < place[1] < near[3] and part[0] < place[0] < part[1]):
                return None
        return place


def _share(side: tuple[fmpq, ...]) -> fmpq:
    return (side[1] - side[0]) / side[1]


def _about(place: tuple[fmpq, fmpq], sides: tuple[fmpq, fmpq]) -> Box:
    return place[0] - sides[0], place[0] + sides[0], place[1] - sides[1], place[1] + sides[1]


def _grown(box: Box, sides: tuple[fmpq, fmpq]) -> Box:
    return box[0] - sides[0], box[1] + sides[0], box[2] - sides[1], box[3] + sides[1]


def _hull(one: Box, other: Box) -> Box:
    return min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]), max(one[3], other[3])


def _clipped(box: Box, part: Box) -> Box:
    """A box within the amplitudes of a piece."""
    return max(box[0], part[0]), min(box[1], part[1]), box[2], box[3]


def _meet(one: Box, other: Box) -> bool:
    return one[0] <= other[1] and other[0] <= one[1] and one[2] <= other[3] and other[2] <= one[3]


def find(loop: Mapping[str, Any], box: Box) -> dict[str, Any]:
    """The certificate of all roots in a box.

    Parameters
    ----------
    loop : mapping
        As :func:`~eppanalysis.methods.certificates.rational.rational_loop` gives it.
    box : tuple of four rationals

    Returns
    -------
    dict
        Plain data: statement, loop, box, claim, evidence.
    """
    balance: Any = Balance(loop)
    # Many boxes share their sides: what holds over a side is computed once.
    balance.gain.over, balance.linear = cache(balance.gain.over), cache(balance.linear)
    search = _Search(balance, box)
    covers = [search.cover(part) for part in balance.pieces(box)]
    found = sorted(search.roots, key=lambda root: (root.enclosure[0], root.enclosure[2]))
    evidence = {
        "roots": [{"enclosure": _texts(r.enclosure), "region": _texts(r.region)} for r in found],
        "cover": covers,
    }
    return sealed(
        {
            "statement": check_roots.STATEMENT,
            "loop": dict(loop),
            "box": {"amplitude": _texts(box[:2]), "frequency": _texts(box[2:])},
            "claim": {"roots": len(search.roots), "undecided": sum(c.count("?") for c in covers)},
            "evidence": evidence,
        }
    )


def _texts(numbers: tuple[fmpq, ...]) -> list[str]:
    return [str(x) for x in numbers]


def undecided(document: Mapping[str, Any]) -> list[Box]:
    """The boxes of a certificate that are not decided."""
    return [leaf for mark, leaf in all_leaves(document) if mark == "?"]


def all_leaves(document: Mapping[str, Any]) -> list[tuple[str, Box]]:
    """Every box of the cover of a certificate, with its mark."""
    balance = Balance(document["loop"])
    box = tuple(map(check_roots.rational, document["box"]["amplitude"] + document["box"]["frequency"]))
    covers = zip(document["evidence"]["cover"], balance.pieces(box), strict=True)
    return [leaf for cover, part in covers for leaf in leaves(cover, part)]
