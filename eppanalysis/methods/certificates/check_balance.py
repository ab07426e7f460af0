"""Checker, alone, of all roots of the DF balance of a ring or with a bias: docs/theory/proofs.md."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

from flint import acb, acb_poly, arb, arb_mat, ctx, fmpq

ctx.prec = 100
STATEMENT = "all roots of the describing-function balance in a box, of a ring or with a bias"
#: Most characters of a file, of a number; coefficients of a linear part; boxes of the cover, terms of gains in them.
LENGTH, DIGITS, ORDER, BOXES, TERMS = 1_000_000, 1000, 60, 25_000, 4_000_000
HALF = {"slope": (Fraction,), "bends": [[(Fraction,), (Fraction,)]], "jumps": [[(Fraction,), (Fraction,)]]}
ODD = {"odd_pieces": HALF, "play": {"gap": (Fraction,)}}
ODD["hysteresis_relay"] = {"threshold": (Fraction,), "level": (Fraction,)}
ELEMENTS: dict = {**ODD, "pieces": {"positive": HALF, "negative": HALF}}
ELEMENTS["biased_relay"] = {name: (Fraction,) for name in ("lower", "upper", "low", "high")}
PI, ONE, J = arb.pi(), arb(1), acb(0, 1)


class Refused(Exception):
    """Why a certificate proves nothing."""


def require(holds, why):
    """Refuse what does not hold."""
    if not holds:
        raise Refused(why)


def number(text):
    """A number as it is written: a fraction in lowest terms."""
    require(type(text) is str and len(text) <= DIGITS and set(text) <= set("-/0123456789"), "a number that is none")
    found = Fraction(text)
    require(str(found) == text, "a number that is not in lowest terms")
    return found


def once(pairs):
    """Names with their values, none of them twice."""
    require(len(dict(pairs)) == len(pairs), "a name that occurs twice")
    return dict(pairs)


def whole(text):
    """A number that counts; others are fractions as texts, and none is rounded."""
    require(len(text) <= DIGITS and set(text) <= set("-0123456789"), f"a number that is no text: {text[:20]}")
    return int(text)


def read(text):
    """The document of a file."""
    require(len(text) <= LENGTH, f"a file of more than {LENGTH} characters")
    try:
        return json.loads(text, object_pairs_hook=once, parse_int=whole, parse_float=whole, parse_constant=whole)
    except RecursionError:
        raise Refused("lists within lists without end") from None


def fit(part, form, where):
    """Refuse what has another form: names, known and all there; lists of one form, or one a place; types of values."""
    form = form(part) if callable(form) else form
    if isinstance(form, dict):
        require(type(part) is dict, f"{where!a} that has no names")
        odd = sorted(part.keys() ^ form.keys())
        require(not odd, f"{where!a} with a name that is missing or not known: {''.join(odd[:1])[:40]!a}")
        for name, inner in form.items():
            fit(part[name], inner, name)
    elif isinstance(form, list):
        require(type(part) is list and len(form) in (1, len(part)), f"{where!a} that is no list as it should be")
        for inner, one in zip(form if len(form) > 1 else form * len(part), part, strict=True):
            fit(one, inner, where)
    elif type(part) is str and Fraction in form:
        number(part)
    else:
        require(type(part) in form, f"{where!a} with a value of another kind")


def opened(document, form):
    """Loop, claim and evidence of a document that has its statement, digest and form."""
    require(type(document) is dict and document.get("statement") == STATEMENT, "another statement")
    text = json.dumps({name: part for name, part in document.items() if name != "digest"}, sort_keys=True)
    require(document["digest"] == int.from_bytes(text.encode(), "big") % (2**127 - 1), "a file that was changed")
    fit(document, {"statement": (str,), "digest": (int,), **form}, "the file")
    return document["loop"], document["claim"], document["evidence"]


def element_form(part):
    """The form of an element, by its kind."""
    kind = part.get("kind") if type(part) is dict else None
    require(type(kind) is str and kind in ELEMENTS, f"an element that is not covered: {str(kind)[:40]!a}")
    return {"kind": (str,), **ELEMENTS[kind]}


def box_form(part):
    """The form of the box: three sides where there is a bias, else two."""
    sides = ("amplitude", "frequency", "bias") if type(part) is dict and "bias" in part else ("amplitude", "frequency")
    return {side: [(Fraction,), (Fraction,)] for side in sides}


LINK = {"num": [(Fraction,)], "den": [(Fraction,)], "delay": (Fraction,), "element": element_form}
FORM = {
    "loop": {"ring": [LINK], "means": [(Fraction,)]},
    "box": box_form,
    "claim": {"roots": (int,), "undecided": (int,)},
    "evidence": {"roots": [{name: [(Fraction,)] for name in ("enclosure", "region")}], "cover": [(str,)]},
}


def rational(text):
    """A number as it is written."""
    return fmpq(*number(text).as_integer_ratio())


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
    """A line with steps, or a follower, which has a band and a slope; a relay with hysteresis has a gate to pass.

    A step has a place, a size, and 2 for a bend, 1 for a jump that is met upward, -1 downward, 0 both ways.
    """

    def __init__(self, e):
        self.line, self.steps, self.gate, self.follow = (0, 0), [], [], []
        if e["kind"] == "play":
            self.follow = [rational(e["gap"]), 1]
        elif "relay" in e["kind"]:
            v = {name: rational(x) for name, x in e.items() if name != "kind"}
            if e["kind"] == "hysteresis_relay":
                (at, level) = v["threshold"], v["level"]
                v = {"lower": -at, "upper": at, "low": -level, "high": level}
            self.gate, self.line = [v["lower"], v["upper"]], (0, v["low"])
            # Half of the rise at each threshold, as either is met on one way alone.
            self.steps = [(at, (v["high"] - v["low"]) / 2, way) for at, way in zip(self.gate, (-1, 1), strict=True)]
        else:
            self.of_pieces(*((e, e) if e["kind"] == "odd_pieces" else (e["positive"], e["negative"])))
        wide = self.follow[0] >= 0 if self.follow else not self.gate or self.gate[0] <= self.gate[1]
        require(wide, "an element that is none")

    def of_pieces(self, *halves):
        """A line from far below on, with what changes along it."""
        places = [[[*map(rational, row)] for row in half[name]] for half in halves for name in ("bends", "jumps")]
        bends, jumps, turned, steps = places
        require(all(at >= 0 for at, _ in bends + jumps + turned + steps), "an element that changes below zero")
        up, down = (rational(half["slope"]) for half in halves)
        self.line = down + sum(x for _, x in turned), sum(b * x for b, x in turned) - sum(h for _, h in steps)
        changes = [*bends, [fmpq(0), up - down], *([-b, -x] for b, x in turned)]
        self.steps = [(b, x, 2) for b, x in changes if x != 0]
        self.steps += [(b, h, 0) for b, h in [*jumps, *([-b, h] for b, h in steps)]]

    def moves(self, A, B):
        """Whether what remembers certainly answers ``B + A sin`` with more than a constant."""
        low, high = self.gate or (0, 0)
        return A.x > self.follow[0] / 2 if self.follow else not self.gate or (A.x + B.x > high and B.x - A.x < low)

    def at_rest(self, B):
        """No gain, and every constant with which it may answer an input that it does not follow."""
        if self.follow:
            held = B.x * self.follow[1] + arb(0, 1) * self.follow[0] * self.follow[1] / 2
        else:
            held = arb(self.line[1]).union(arb(self.line[1] + 2 * self.steps[0][1]))
        return B.of(arb(0), arb("nan")), B.of(held, arb("nan"))

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
            away, bend = B.line(-1, at), way == 2
            # Nothing changes below the amplitude that meets the step: a lesser one, zero too, counts as that one.
            R = A.of(A.x.max(away.x.abs_lower()), ONE)
            r = away / R
            if B.x - at > A.x and not self.gate:
                N, M = (N.line(1, size), M + B.line(size, -size * at)) if bend else (N, M.line(1, size))
            elif self.gate or not at - B.x > A.x:
                s, time, gain, mean = phases(r)
                N = N + (gain.line(size) if bend else ((s + r.line(-J * way)) / R).line(2 * size / PI))
                M = M + (R * mean if bend else time).line(size)
        return N if self.moves(A, B) else N.of(N.x, arb("nan")), M


class Balance:
    """``prod den - prod(-N num exp(-s delay))`` along a ring, and the balance of the means, over boxes.

    Where an element passes nothing on, what is left is ``prod den = 0``: a harmonic motion of a linear part alone.
    """

    def __init__(self, loop):
        self.ring, self.means = [], [rational(x) for x in loop["means"]]
        for link in loop["ring"]:
            num, den = ([rational(c) for c in link[name][::-1]] for name in ("num", "den"))
            require(any(den) and len(num) + len(den) <= ORDER, "a linear part that is none")
            delay, own = rational(link["delay"]), self.means[:2] == [*den[:1], *num[:1]] != [0, 0]
            require(delay >= 0, "a dead time that is none")
            require(not self.means or (own and len(self.means) == 3), "means that are not those of the linear part")
            require(self.means or link["element"]["kind"] in ODD, "an element that is not odd, without its mean")
            polynomials = (acb_poly([acb(c) for c in p]) for p in (num, den))
            self.ring.append((*polynomials, delay, Element(link["element"])))
        require(len(self.ring) == 1 or (self.ring and not self.means), "a ring with a bias")
        self.boxes = min(BOXES, TERMS // sum(1 + len(element.steps) for *_, element in self.ring))

    def linear(self, w):
        """At ``s = j omega`` the denominators along the ring, the numerators with the dead times, whether all pass."""
        s, parts = w.line(J), []
        for num, den, delay, _ in self.ring:
            late = (-delay * s.x).exp()
            N = s.of(num(s.x), num.derivative()(s.x)) * s.of(late, -delay * late)
            parts.append((s.of(den(s.x), den.derivative()(s.x)), N))
        return parts, any(D.x.contains(0) for D, _ in parts)

    def over(self, box):
        """The balance in reals, as jets; nothing where certainly nothing oscillates."""
        sides = [arb(low).union(arb(high)) for low, high in zip(box[::2], box[1::2], strict=True)]
        A, w, *biases = (Jet(x, [arb(i == k) for k in range(len(sides))]) for i, x in enumerate(sides))
        B, M, P, Q = (biases or [A.line(0)])[0], A, A.line(0, acb(-1)), A.line(0, acb(1))
        parts, alone = self.linear(w)
        for (D, late), (*_, element) in zip(parts, self.ring, strict=True):
            # Where a linear part may swing alone, what remembers may be anywhere that it holds.
            stands = alone and not element.moves(A, B)
            N, M = element.at_rest(B) if stands else element.over(A, B)
            if N.x == 0 and not alone:
                return []
            part = N.line(arb("nan") if stands else 1) * late
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
    loop, said, evidence = opened(document, FORM)
    balance, roots, undecided = Balance(loop), [], 0  # type: ignore[var-annotated]
    sides = ("amplitude", "frequency", *["bias"] * bool(balance.means))
    require(document["box"].keys() == set(sides), "a box without its bias, or with one that there is not")
    box = [rational(x) for side in sides for x in document["box"][side]]
    require(within(box, box) and box[0] > 0 and box[2] > 0, "a box that is none")
    (cover,) = evidence["cover"]
    require(len(cover) <= balance.boxes, f"a cover of more than {balance.boxes} boxes")
    for root in evidence["roots"]:
        inner, region = ([rational(x) for x in root[name]] for name in ("enclosure", "region"))
        require(len(inner) == len(region) == len(box), "a region of other unknowns")
        require(balance.holds_one(region) and balance.holds_one(inner), "a region that is not proved to hold one root")
        require(within(inner, region) and within(inner, box), "an enclosure without its root")
        apart = [any(inner[i + 1] < r[i] or r[i + 1] < inner[i] for i in range(0, len(r), 2)) for r, _ in roots]
        require(all(apart), "enclosures that meet")
        roots.append((inner, region))
    for mark, leaf in leaves(cover, box):
        undecided += mark == "?"
        known = mark == "?" or (mark == "r" and any(within(leaf, r) for _, r in roots))
        require(known or (mark == "." and balance.empty(leaf)), "a box of the cover that is not proved")
    claim = {"roots": len(roots), "undecided": undecided}
    require(said == claim, f"it claims {said}, its evidence shows {claim}")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(read(sys.stdin.read(LENGTH + 1)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        why = str(error) if isinstance(error, Refused) else f"it cannot be read: {type(error).__name__}, {error}"
        print(json.dumps({"accepted": False, "why": why}))
        raise SystemExit(1) from None
