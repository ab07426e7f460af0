"""Finds a certificate of all roots of the describing-function balance in a box: a cover, and an enclosure of each root.

Boxes are cut until each is certainly empty or lies in a region that certainly holds one root. The checker itself
decides that, so that what is found here is what the checker sees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from flint import arb, fmpq, fmpq_poly

from eppanalysis.methods.certificates import check_balance, check_roots
from eppanalysis.methods.certificates.numbers import middle_of
from eppanalysis.methods.certificates.registry import sealed

#: Amplitude from, to [unit of the input], angular frequency from, to [rad/s], and bias from, to where there is one.
Box = tuple[fmpq, ...]
SIDES = ("amplitude", "frequency", "bias")

#: Boxes that are looked at in one piece; what is left then is undecided. Boxes that are left over when no more are cut.
_MOST_BOXES, _ROOM = 20_000, 200
#: Share of its place below which the side of a box is not cut any more.
_LEAST = fmpq(1, 2**30)
#: Share of its place below which an amplitude or a bias is not cut where a linear part swings alone.
_OCTAVE = fmpq(1, 2)
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
    """A search in one declared box, with the functions of its checker."""

    check: Any
    balance: Any
    box: Box
    roots: list[_Root] = field(default_factory=list)
    looked_at: int = 0

    def cover(self, part: Box) -> str:
        """Marks of the boxes that one piece is cut into, as the checker reads them."""
        marks: list[str] = []
        left = [part]
        most = min(_MOST_BOXES, self.balance.boxes - self.looked_at - _ROOM)
        while left:
            box = left.pop()
            mark = self.mark(box, part, len(marks) < most)
            marks.append(mark)
            if mark in "awb":
                left += [half for _, half in self.check.leaves(mark + "..", box)][::-1]
        self.looked_at += len(marks)
        return "".join(marks)

    def mark(self, box: Box, part: Box, may_cut: bool) -> str:
        """What becomes of a box."""
        if self.balance.empty(box):
            return "."
        if any(self.check.within(box, root.region) for root in self.roots):
            return "r"
        shares = _shares(box)
        if max(shares) < _NEAR and self.root_near(box, part):
            return "r"
        way = self.direction(box, shares)
        return "awb"[way] if may_cut and shares[way] > _LEAST else "?"

    def direction(self, box: Box, shares: list[fmpq]) -> int:
        """Which cut makes the balance sharper: that of the unknown that spreads it more."""
        spreads = _spreads(self.balance, box)
        if all(x < float("inf") for x in spreads):
            return max(range(len(spreads)), key=spreads.__getitem__)
        # Where a linear part may swing alone nothing is known until the frequency tells; at its own one little is.
        if self.check is check_balance and self.balance.linear(_still(box[2:4]))[1]:
            wide = (_OCTAVE, _LEAST, _OCTAVE)
            return next((i for i in (1, 0, 2) if i < len(shares) and shares[i] > wide[i]), 1)
        return max(range(len(shares)), key=shares.__getitem__)

    def root_near(self, box: Box, part: Box) -> bool:
        """Whether a region about the box is proved to hold one root, which is noted."""
        place = self.newton(box, part)
        if place is None:
            return False
        enclosure = _about(place, [x * _ENCLOSED for x in _sizes(place)])
        # The region reaches beyond the box: a root on a side of it lies inside, and is one root for the box behind, too
        # (docs/theory/proofs.md, All roots of the DF balance).
        sides = [(high - low) / 8 for low, high in _sides(box)]
        region = _hull(_grown(box, sides), _about(place, sides))
        known = next((root for root in self.roots if _meet(root.enclosure, enclosure)), None)
        region = _clipped(region if known is None else _hull(region, known.region), part)
        inside = self.check.within(enclosure, self.box) and self.check.within(enclosure, region)
        if not (inside and region[2] > 0 and self.balance.holds_one(region)):
            return False
        if known is not None:
            known.region = region
            return True
        if not self.balance.holds_one(enclosure):
            return False
        self.roots.append(_Root(enclosure, region))
        return True

    def newton(self, box: Box, part: Box) -> list[fmpq] | None:
        """Where Newton's method from the middle of a box ends, where that is near the box."""
        place = [(low + high) / 2 for low, high in _sides(box)]
        near = _sides(_grown(box, [high - low for low, high in _sides(box)]))
        for _ in range(_NEWTON_STEPS):
            # Over a box without width the first part of Krawczyk's operator is Newton's step.
            found = self.balance.krawczyk(tuple(x for x in place for _ in "to"))
            if not found:
                return None
            place = [x - middle_of(step) for x, (step, *_) in zip(place, found, strict=True)]
            inside = all(low < x < high for x, (low, high) in zip(place, near, strict=True))
            if not (inside and part[0] < place[0] < part[1]):
                return None
        return place


def _spreads(balance: Any, box: Box) -> list[float]:
    """How much each unknown spreads the balance over a box."""
    if isinstance(balance, check_roots.Balance):
        N, _ = balance.gain.over(*box[:2])
        D, _, M, _ = balance.linear(*box[2:])
        return [float(N.rad() * M.abs_upper()), float(D.rad() + N.abs_upper() * M.rad())]
    half = [float(high - low) / 2 for low, high in _sides(box)]
    found = [0.0] * len(half)
    for jet in balance.over(box):
        spread = [float(y.abs_upper()) * h for y, h in zip(jet.slopes, half, strict=True)]
        # Equations have units of their own: of each, as shares of what it may be.
        size = sum(spread) + float(jet.x.abs_lower())
        found = [x + y / size if size else x for x, y in zip(found, spread, strict=True)]
    return found


def _still(side: Box) -> Any:
    """A side of a box as the checker's balance reads an unknown, without derivatives."""
    return check_balance.Jet(arb(side[0]).union(arb(side[1])), [])


def _sides(box: Box) -> list[tuple[fmpq, fmpq]]:
    return list(zip(box[::2], box[1::2], strict=True))


def _sizes(place: Sequence[fmpq]) -> list[fmpq]:
    """What a share of each unknown is a share of: itself, and of a bias, which may be zero, the amplitude too."""
    return [*place[:2], *(abs(x) + place[0] for x in place[2:])]


def _shares(box: Box) -> list[fmpq]:
    """How wide a box is, as shares of its place."""
    sizes = _sizes([box[1], box[3], *(max(abs(low), abs(high)) for low, high in _sides(box)[2:])])
    return [(high - low) / size for (low, high), size in zip(_sides(box), sizes, strict=True)]


def _about(place: Sequence[fmpq], half: Sequence[fmpq]) -> Box:
    return tuple(end for x, h in zip(place, half, strict=True) for end in (x - h, x + h))


def _grown(box: Box, by: Sequence[fmpq]) -> Box:
    return tuple(end for (low, high), h in zip(_sides(box), by, strict=True) for end in (low - h, high + h))


def _hull(one: Box, other: Box) -> Box:
    return tuple((min, max)[i % 2](x, y) for i, (x, y) in enumerate(zip(one, other, strict=True)))


def _clipped(box: Box, part: Box) -> Box:
    """A box within the amplitudes of a piece."""
    return max(box[0], part[0]), min(box[1], part[1]), *box[2:]


def _meet(one: Box, other: Box) -> bool:
    return all(a <= d and c <= b for (a, b), (c, d) in zip(_sides(one), _sides(other), strict=True))


def find(loop: Mapping[str, Any], box: Box) -> dict[str, Any]:
    """The certificate of all roots in a box.

    Parameters
    ----------
    loop : mapping
        As :func:`~eppanalysis.methods.certificates.rational.rational_loop` gives it, or as
        :func:`~eppanalysis.methods.certificates.roots.ring.rational_ring` does.
    box : tuple of four rationals, or six with a bias

    Returns
    -------
    dict
        Plain data: statement, loop, box, claim, evidence.
    """
    check = _checker(loop)
    search = _Search(check, check.Balance(loop), box)
    if check is check_roots:
        # Many boxes share their sides: what holds over a side is computed once.
        balance = search.balance
        balance.gain.over, balance.linear = cache(balance.gain.over), cache(balance.linear)
    covers = [search.cover(part) for part in _pieces(search.balance, box)]
    found = sorted(search.roots, key=lambda root: (root.enclosure[0], root.enclosure[2]))
    evidence = {
        "roots": [{"enclosure": _texts(r.enclosure), "region": _texts(r.region)} for r in found],
        "cover": covers,
    }
    return sealed(
        {
            "statement": check.STATEMENT,
            "loop": dict(loop),
            "box": {name: _texts(side) for name, side in zip(SIDES, _sides(box), strict=False)},
            "claim": {"roots": len(search.roots), "undecided": sum(c.count("?") for c in covers)},
            "evidence": evidence,
        }
    )


def undamped(loop: Mapping[str, Any]) -> list[fmpq]:
    """Frequencies [rad/s], nearly, of poles that are exactly on the imaginary axis, zero left out; continuous time."""
    found = []
    for link in loop.get("ring", [loop]):
        den = [check_balance.rational(c) for c in link["den"][::-1]]
        # den(j omega) = even(-omega^2) + j omega odd(-omega^2): both are zero at such a pole.
        both = fmpq_poly(den[::2]).gcd(fmpq_poly(den[1::2]))
        roots: list[Any] = both.complex_roots() if both.degree() > 0 else []
        found += [middle_of((-root.real).sqrt()) for root, _ in roots if root.imag == 0 and root.real < 0]
    return found


def _checker(loop: Mapping[str, Any]) -> Any:
    """The checker of a loop, whose functions the search uses."""
    return check_balance if "ring" in loop else check_roots


def _pieces(balance: Any, box: Box) -> list[Box]:
    """The parts of which each has a cover of its own."""
    return balance.pieces(box) if isinstance(balance, check_roots.Balance) else [box]


def _texts(numbers: Sequence[fmpq]) -> list[str]:
    return [str(x) for x in numbers]


def undecided(document: Mapping[str, Any]) -> list[Box]:
    """The boxes of a certificate that are not decided."""
    return [leaf for mark, leaf in all_leaves(document) if mark == "?"]


def all_leaves(document: Mapping[str, Any]) -> list[tuple[str, Box]]:
    """Every box of the cover of a certificate, with its mark."""
    check = _checker(document["loop"])
    box = tuple(check.rational(x) for name in SIDES for x in document["box"].get(name, ()))
    covers = zip(document["evidence"]["cover"], _pieces(check.Balance(document["loop"]), box), strict=True)
    return [leaf for cover, part in covers for leaf in check.leaves(cover, part)]
