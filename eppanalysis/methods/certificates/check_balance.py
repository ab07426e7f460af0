"""Checker, alone, of all roots of the first-order balance of a ring or with a bias: docs/theory/certificates.md."""

import json
from fractions import Fraction

from flint import acb, acb_poly, arb, arb_mat, ctx, fmpq

ctx.prec = 100
STATEMENT = "all roots of the first-order balance in a box, of a ring or with a bias"
PI, ONE, J = arb.pi(), arb(1), acb(0, 1)


class Refused(Exception):
    """Why a certificate proves nothing."""


def require(holds, why):
    """Refuse what does not hold."""
    if not holds:
        raise Refused(why)


def rational(text):
    """A number as it is written."""
    return fmpq(*Fraction(text).as_integer_ratio())


class Jet:
    """A ball with its derivatives by the unknowns."""

    def __init__(self, x, slopes):
        self.x, self.slopes = x, slopes

    def of(self, x, slope):
        """A function of it, by its value and its slope."""
        return Jet(x, [slope * y for y in self.slopes])

    def line(self, slope, offset=0):
        """``slope * self + offset``."""
        return self.of(slope * self.x + offset, slope)

    def __add__(self, other):
        return Jet(self.x + other.x, [x + y for x, y in zip(self.slopes, other.slopes, strict=True)])

    def __mul__(self, other):
        return Jet(self.x * other.x, [x * other.x + self.x * y for x, y in zip(self.slopes, other.slopes, strict=True)])

    def __truediv__(self, other):
        return self * other.of(1 / other.x, -1 / other.x**2)


def phases(r):
    """Of a sine: its slope where it passes r, and of what is above r the time, the gain and the mean."""
    small, large = ((1 - x.min(ONE) ** 2).sqrt() for x in (r.x.abs_lower(), r.x.abs_upper()))
    sides = []
    for end, x in ((y, y.max(-ONE).min(ONE)) for y in (r.x.lower(), r.x.upper())):
        s, t = (1 - x * x).sqrt(), x.acos()
        sides.append((t / PI, (t - x * s) / PI, (s - x * t) / PI + (-1 - end).max(arb(0))))
    s, time, gain, mean = small.union(large), *(x.union(y) for x, y in zip(*sides, strict=True))
    return r.of(s, -r.x / s), r.of(time, -1 / (PI * s)), r.of(gain, -2 * s / PI), r.of(mean, -time)


class Element:
    """A line with steps (where, size; "bend", or a jump met upward 1, downward -1, both ways 0), or a follower."""

    def __init__(self, e):
        self.line, self.follow, self.gate = ([rational(x) for x in e[name]] for name in ("line", "follow", "gate"))
        self.steps = [(rational(b), rational(h) / (2 if self.gate else 1), way) for b, h, way in e["steps"]]
        (low, high), ways = self.gate or (0, 0), [(b, way) for b, _, way in self.steps]
        gated = ways == [(low, -1), (high, 1)] and len({x[1] for x in self.steps}) == 1
        plain = all(way in ("bend", 0) for _, way in ways)
        follows = self.follow and not ways and self.follow[0] >= 0
        require(low <= high and (follows if self.follow else gated if self.gate else plain), "an element that is none")

    def over(self, A, B):
        """Gain and mean for ``B + A sin``; a gain of zero where it does not swing past the gate to either side."""
        if self.follow:
            (band, slope), q = self.follow, A.of(1 - self.follow[0] / A.x, self.follow[0] / A.x**2)
            s, _, gain, _ = phases(q)
            N = gain.line(-slope, slope) + q.of(s.x * s.x, -2 * q.x).line(-J * slope / PI)
            # Up to where it lets go gain and slope are zero.
            N = N if A.x > band / 2 else N.of(N.x, arb(0).union(ONE))
            return A.line(0) if A.x < band / 2 else N, B.line(slope)
        N, M, (low, high) = A.line(0, self.line[0]), B.line(*self.line), self.gate or (0, 0)
        if self.gate and (A.x + B.x < high or B.x - A.x > low):
            return A.line(0), M
        for at, size, way in self.steps:
            away, bend = B.line(-1, at), way == "bend"
            # Nothing changes below the amplitude that meets the step: a lesser one, zero too, counts as that one.
            R = A.of(A.x.max(away.x.abs_lower()), ONE)
            r = away / R
            if B.x - at > A.x and not self.gate:
                N, M = (N.line(1, size), M + B.line(size, -size * at)) if bend else (N, M.line(1, size))
            elif self.gate or not at - B.x > A.x:
                s, time, gain, mean = phases(r)
                N = N + (gain.line(size) if bend else ((s + r.line(-J * way)) / R).line(2 * size / PI))
                M = M + (R * mean if bend else time).line(size)
        return N if not self.gate or (A.x + B.x > high and B.x - A.x < low) else N.of(N.x, arb("nan")), M


class Balance:
    """``prod den - prod(-N num exp(-s delay))`` along a ring, and the balance of the means, over boxes."""

    def __init__(self, loop):
        self.ring, self.means = [], [rational(x) for x in loop["means"]]
        for link in loop["ring"]:
            num, den = (acb_poly([acb(rational(c)) for c in link[name][::-1]]) for name in ("num", "den"))
            self.ring.append((num, den, rational(link["delay"]), Element(link["element"])))
        require(len(self.ring) == 1 or (self.ring and not self.means), "a ring with a bias")

    def over(self, box):
        """The balance in reals, as jets; nothing where certainly nothing oscillates."""
        sides = [arb(low).union(arb(high)) for low, high in zip(box[::2], box[1::2], strict=True)]
        A, w, *biases = (Jet(x, [arb(i == k) for k in range(len(sides))]) for i, x in enumerate(sides))
        s, B, M, P, Q = w.line(J), (biases or [A.line(0)])[0], A, A.line(0, acb(-1)), A.line(0, acb(1))
        for num, den, delay, element in self.ring:
            N, M = element.over(A, B)
            if N.x == 0:
                return []
            late, D = (-delay * s.x).exp(), s.of(den(s.x), den.derivative()(s.x))
            part = N * s.of(num(s.x), num.derivative()(s.x)) * s.of(late, -delay * late)
            P, Q, X = P * part.line(-1), Q * D, part / D
            A = A * Jet(abs(X.x), [(y * X.x.sgn().conjugate()).real for y in X.slopes])
        means = [B.line(self.means[0], -self.means[2]) + M.line(self.means[1])] if biases else []
        return [Jet(F.x.real, [y.real for y in F.slopes]) for F in (P + Q, (P + Q).line(-J))] + means

    def krawczyk(self, box):
        """For each unknown: Newton's step from the midpoint, the spread ``|1 - Y F'(box)| h``, half the width h."""
        half, n = [(box[i + 1] - box[i]) / 2 for i in range(0, len(box), 2)], len(box) // 2
        at = self.over([x for i in range(n) for x in [box[2 * i] + half[i]] * 2])
        try:
            Y, J = (arb_mat(n, n, [x for jet in jets for x in jet.slopes]) for jets in (at, self.over(box)))
            Y = arb_mat(n, n, [x.mid() for x in Y.entries()]).inv()
        except (ZeroDivisionError, ValueError):
            return []
        step, left = Y * arb_mat(n, 1, [jet.x for jet in at]), Y * J
        return [(step[i, 0], sum(abs(left[i, k] - (i == k)) * half[k] for k in range(n)), half[i]) for i in range(n)]

    def empty(self, box):
        """Whether there is certainly no root in a box."""
        jets = self.over(box)
        return not jets or any(abs(jet.x) > 0 for jet in jets) or any(abs(y) - r > h for y, r, h in self.krawczyk(box))

    def holds_one(self, box):
        """Whether there is certainly exactly one root in a box, and inside."""
        return min(box[0], box[2]) > 0 and all(abs(y) + r < h for y, r, h in self.krawczyk(box) or [(0, 1, 0)])


def within(inner, outer):
    """Whether a box lies in another."""
    return all(outer[i] <= inner[i] < inner[i + 1] <= outer[i + 1] for i in range(0, len(inner), 2))


def leaves(cover, box):
    """Boxes of a cover, in its order: "a", "w", "b" cut the next box in an unknown, other marks are leaves."""
    left = [box]
    for mark in cover:
        require(left, "a cover with too many boxes")
        last, i = left.pop(), 2 * "awb".find(mark)
        if 0 <= i < len(box):
            low, high = last[i], last[i + 1]
            octaves = int((high / low).floor()).bit_length() if low > 0 else 0
            cut = low * 2 ** (octaves // 2) if octaves > 2 else (low + high) / 2
            left += [(*last[:i], cut, *last[i + 1 :]), (*last[: i + 1], cut, *last[i + 2 :])]
        else:
            yield mark, last
    require(not left, "a cover with boxes missing")


def verify(document):
    """What a certificate proves: how many roots its box has, outside of how many boxes that are undecided."""
    require(document["statement"] == STATEMENT, "another statement")
    text = json.dumps({name: part for name, part in document.items() if name != "digest"}, sort_keys=True)
    require(document["digest"] == int.from_bytes(text.encode(), "big") % (2**127 - 1), "a file that was changed")
    sides, balance, roots, undecided = ("amplitude", "frequency", "bias"), Balance(document["loop"]), [], 0  # type: ignore
    box = [rational(x) for side in sides[: 3 if balance.means else 2] for x in document["box"][side]]
    require(within(box, box) and box[0] > 0 and box[2] > 0, "a box that is none")
    for root in document["evidence"]["roots"]:
        inner, region = ([rational(x) for x in root[name]] for name in ("enclosure", "region"))
        require(balance.holds_one(region) and balance.holds_one(inner), "a region that is not proved to hold one root")
        require(within(inner, region) and within(inner, box), "an enclosure without its root")
        apart = [any(inner[i + 1] < r[i] or r[i + 1] < inner[i] for i in range(0, len(r), 2)) for r, _ in roots]
        require(all(apart), "enclosures that meet")
        roots.append((inner, region))
    for mark, leaf in leaves("".join(document["evidence"]["cover"]), box):
        undecided += mark == "?"
        known = mark == "?" or (mark == "r" and any(within(leaf, r) for _, r in roots))
        require(known or (mark == "." and balance.empty(leaf)), "a box of the cover that is not proved")
    claim = {"roots": len(roots), "undecided": undecided}
    require(document["claim"] == claim, f"it claims {document['claim']}, its evidence shows {claim}")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(json.load(open(0)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        print(json.dumps({"accepted": False, "why": str(error) or type(error).__name__}))
        raise SystemExit(1) from None
