"""Checker of a certificate of all roots of the DF balance ``1 + N(A) G(j omega) = 0`` in a box.

It runs alone, ``python -I check_roots.py < certificate.json``, and computes with exact rationals, and with balls
(python-flint, Arb) that hold the exact values. Theory: docs/theory/proofs.md.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

from flint import acb, acb_poly, arb, ctx, fmpq

ctx.prec = 100
STATEMENT = "all roots of the describing-function balance in a box"
#: Most characters of a file, and of a number in it; most coefficients of a polynomial, most boxes of all covers, and
#: most terms of the gain in all of these.
LENGTH, DIGITS, ORDER, BOXES, TERMS = 1_000_000, 1000, 60, 100_000, 20_000_000
ELEMENTS: dict = {
    "odd_pieces": {"slope": (Fraction,), "bends": [[(Fraction,), (Fraction,)]], "jumps": [[(Fraction,), (Fraction,)]]},
    "play": {"gap": (Fraction,)},
    "jump_and_follow": {"stick_band": (Fraction,), "slip_jump": (Fraction,), "slope": (Fraction,)},
    "hysteresis_relay": {"threshold": (Fraction,), "level": (Fraction,)},
    "hysteresis_relay_dead_zone": {"on": (Fraction,), "off": (Fraction,), "level": (Fraction,)},
    "cube": {"scale": (Fraction,)},
    "drag": {"scale": (Fraction,)},
}


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


SIDE, BOX = [(Fraction,), (Fraction,)], [(Fraction,)] * 4
FORM = {
    "loop": {
        "time_step": (Fraction, type(None)),
        "num": [(Fraction,)],
        "den": [(Fraction,)],
        "delay": (Fraction,),
        "element": element_form,
    },
    "box": {"amplitude": SIDE, "frequency": SIDE},
    "claim": {"roots": (int,), "undecided": (int,)},
    "evidence": {"roots": [{"enclosure": BOX, "region": BOX}], "cover": [(str,)]},
}


def rational(text):
    """A number as it is written."""
    return fmpq(*number(text).as_integer_ratio())


def share(r):
    """``2/pi (asin r + r sqrt(1 - r^2))``, which ascends; beyond [-1, 1] r is rounding."""
    ends = r.lower() if r > -1 else arb(-1), r.upper() if r < 1 else arb(1)
    low, high = (2 / arb.pi() * (x.asin() + x * (1 - x * x).sqrt()) for x in ends)
    return low.union(high)


def cosine(r):
    """``sqrt(1 - r^2)``, which falls with the size of r."""
    small, large = r.abs_lower(), r.abs_upper()
    return (1 - small * small).sqrt().union((1 - large * large).sqrt() if large < 1 else arb(0))


class Gain:
    """N(A) in balls. A jump: the amplitude from which on it is met, where, its height, the way up (1) or down (-1)."""

    def __init__(self, e):
        kind, self.powers, self.bends, self.jumps, self.follow = e["kind"], [], [], [], None
        v = {n: rational(x) for n, x in e.items() if n not in ("kind", "bends", "jumps")}
        if kind == "odd_pieces":
            self.powers = [(v["slope"], 0)]
            self.bends, jumps = ([[*map(rational, row)] for row in e[name]] for name in ("bends", "jumps"))
            self.jumps = [(at, at, height, way) for at, height in jumps for way in (1, -1)]
        elif kind in ("play", "jump_and_follow"):
            self.follow = (v["gap"], 0, 1) if kind == "play" else (v["stick_band"], v["slip_jump"], v["slope"])
        elif kind == "hysteresis_relay":
            self.jumps = [(v["threshold"], v["threshold"], 2 * v["level"], 1)]
        elif kind == "hysteresis_relay_dead_zone":
            self.jumps = [(v["on"], v["on"], v["level"], 1), (v["on"], v["off"], v["level"], -1)]
        else:
            require(kind in ("cube", "drag"), f"an element that is not covered: {kind!a}")
            self.powers = [(3 * v["scale"] / 4, 2) if kind == "cube" else (8 * v["scale"] / (3 * arb.pi()), 1)]
        seen = [self.follow[0] / 2] if self.follow else [x[0] for x in self.bends + self.jumps]
        placed = all(x >= 0 for x in (*seen, *(self.follow or ())))
        require(placed and all(0 <= x[1] <= x[0] for x in self.jumps), "an element that is none")
        self.thresholds, self.terms = sorted({x for x in seen if x > 0}), len(self.bends + self.jumps)

    def over(self, low, high):
        """N and dN/dA over amplitudes between two thresholds."""
        A, pi = arb(low).union(arb(high)), arb.pi()
        N, dN = (acb(sum((n**i * c * A ** (n - i) for c, n in self.powers), arb(0))) for i in (0, 1))
        for b, change in (x for x in self.bends if x[0] <= low):
            N += change * (1 - share(b / A))
            dN += 4 / pi * change * cosine(b / A) * b / A**2
        for _, b, height, way in (x for x in self.jumps if x[0] <= low):
            r, s, size = b / A, cosine(b / A), 2 * height / (pi * A)
            N += size * acb(s, -way * r)
            dN += size / A * acb(1 / s - 2 * s, 2 * way * r)
        if self.follow and self.follow[0] / 2 <= low:
            S, J, m = self.follow
            u, q, p, size = S / A, 1 - S / A, cosine(1 - S / A), 2 * J / (pi * A)
            N += m * acb((1 + share(q)) / 2 + size * p, size * q - p * p / pi)
            dN += m / A * (2 * u / pi * acb(p, q) + (size * acb(-q * u / p - p, u - q) if J else 0))
        return N, dN


class Balance:
    """``F = den + N num exp(-s delay)`` over boxes: amplitude from, to, angular frequency from, to [rad/s].

    Where the element passes nothing on, N = 0, what is left is ``den = 0``: a harmonic motion of the linear part alone.
    """

    def __init__(self, loop):
        self.num, self.den = (acb_poly([acb(rational(c)) for c in loop[name][::-1]]) for name in ("num", "den"))
        self.delay, self.gain = rational(loop["delay"]), Gain(loop["element"])
        self.boxes = min(BOXES, TERMS // (1 + self.gain.terms))
        self.step = None if loop["time_step"] is None else rational(loop["time_step"])
        require(len(self.den) > 0 and len(self.num) + len(self.den) <= ORDER, "a linear part that is none")
        timed = self.delay >= 0 if self.step is None else self.step > 0 and self.delay == 0
        require(timed, "a dead time or a time step that is none")

    def linear(self, low, high):
        """den, its derivative by omega, num with the dead time, its derivative, over frequencies."""
        w = arb(low).union(arb(high))
        s = acb(0, w) if self.step is None else acb(0, w * self.step).exp()
        ds = acb(0, 1) if self.step is None else acb(0, self.step) * s
        late = acb(0, -w * self.delay).exp()
        slope = self.num.derivative()(s) * ds - acb(0, self.delay) * self.num(s)
        return self.den(s), self.den.derivative()(s) * ds, self.num(s) * late, slope * late

    def over(self, box):
        """N, F, dF/dA and dF/domega over a box."""
        (N, dN), (D, dD, M, dM) = self.gain.over(*box[:2]), self.linear(*box[2:])
        return N, D + N * M, dN * M, dD + N * dM

    def krawczyk(self, box):
        """For each unknown: Newton's step Y F(m) from the midpoint, the spread ``|1 - Y J(box)|`` h, half the width h.

        Y is the inverse of the Jacobian J(m). All roots in the box lie within the spread about ``m - Y F(m)``.
        """
        at, half = ((box[0] + box[1]) / 2, (box[2] + box[3]) / 2), ((box[1] - box[0]) / 2, (box[3] - box[2]) / 2)
        _, F, *J = self.over((at[0], at[0], at[1], at[1]))
        a, w = (acb(x.real.mid(), x.imag.mid()) for x in J)
        turn = (a * w.conjugate()).imag
        if not abs(turn) > 0:
            return []
        parts = (F, *self.over(box)[2:])
        step, by_a, by_w = [((x * w.conjugate()).imag / turn, -(x * a.conjugate()).imag / turn) for x in parts]
        spread = [abs(by_a[i] - (i == 0)) * half[0] + abs(by_w[i] - (i == 1)) * half[1] for i in (0, 1)]
        return list(zip(step, spread, half, strict=True))

    def empty(self, box):
        """Whether there is certainly no root in a box."""
        _, F, *_ = self.over(box)
        return abs(F.real) > 0 or abs(F.imag) > 0 or any(abs(y) - r > h for y, r, h in self.krawczyk(box))

    def holds_one(self, box):
        """Whether there is certainly exactly one root in a box, and inside."""
        found = self.krawczyk(box)
        return bool(found) and all(abs(y) + r < h for y, r, h in found)

    def pieces(self, box):
        """A box, cut at the thresholds of the element: N is smooth on each piece."""
        edges = [box[0], *(x for x in self.gain.thresholds if box[0] < x < box[1]), box[1]]
        return [(low, high, *box[2:]) for low, high in zip(edges, edges[1:], strict=False)]


def within(inner, outer):
    """Whether a box lies in another."""
    return all(outer[i] <= inner[i] < inner[i + 1] <= outer[i + 1] for i in (0, 2))


def middle(low, high):
    """Where an interval is cut: at its mean, or after half of the powers of two that it spans."""
    whole = int(high.p * low.q // (high.q * low.p))
    return low * 2 ** (whole.bit_length() // 2) if whole >= 4 else (low + high) / 2


def leaves(cover, box):
    """Boxes of a cover, in its order: "a", "w" cut the next box in amplitude or frequency, other marks are leaves."""
    left = [box]
    for mark in cover:
        require(left, "a cover with too many boxes")
        a, b, c, d = last = left.pop()
        if mark == "a":
            left += [(middle(a, b), b, c, d), (a, middle(a, b), c, d)]
        elif mark == "w":
            left += [(a, b, middle(c, d), d), (a, b, c, middle(c, d))]
        else:
            yield mark, last
    require(not left, "a cover with boxes missing")


def verify(document):
    """What a certificate proves: how many roots its box has, outside of how many boxes that are undecided."""
    loop, said, evidence = opened(document, FORM)
    balance = Balance(loop)
    box = tuple(map(rational, document["box"]["amplitude"] + document["box"]["frequency"]))
    require(0 < box[0] < box[1] and 0 < box[2] < box[3], "a box that is none")
    # Beyond half the sampling frequency the same motions come again under another name.
    require(balance.step is None or box[3] * balance.step < arb.pi(), "a box beyond half the sampling frequency")
    require(sum(map(len, evidence["cover"])) <= balance.boxes, f"a cover of more than {balance.boxes} boxes")
    parts, roots, undecided = balance.pieces(box), [], 0  # type: ignore[var-annotated]
    for root in evidence["roots"]:
        (a, b, c, d), region = inner, _ = [tuple(map(rational, root[name])) for name in ("enclosure", "region")]
        smooth = region[2] > 0 and any(part[0] <= region[0] and region[1] <= part[1] for part in parts)
        require(smooth and balance.holds_one(region), "a region that is not proved to hold one root")
        placed = within(inner, region) and within(inner, box)
        require(placed and balance.holds_one(inner), "an enclosure without its root")
        require(all(b < r[0] or r[1] < a or d < r[2] or r[3] < c for r, _ in roots), "enclosures that meet")
        roots.append((inner, region))
    require(len(evidence["cover"]) == len(parts), "a cover with parts missing")
    for cover, part in zip(evidence["cover"], parts, strict=True):
        for mark, leaf in leaves(cover, part):
            undecided += mark == "?"
            proved = any(within(leaf, r) for _, r in roots) if mark == "r" else mark == "." and balance.empty(leaf)
            require(proved or mark == "?", "a box of the cover that is not proved")
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
