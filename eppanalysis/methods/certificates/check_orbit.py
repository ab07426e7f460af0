"""Checker of a certificate that a sequence of affine arcs has one closed orbit in a box, and meets no event earlier.

It runs alone, ``python -I check_orbit.py < certificate.json``, with exact rationals, and balls (python-flint, Arb)
that hold the exact values. On an arc ``dv/dt = rate v``, with a 1 behind v; it ends where its guard is zero, and
``jump v`` follows it. Theory: docs/theory/proofs.md.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

from flint import arb, arb_mat, ctx, fmpq, fmpq_mat, fmpz

STATEMENT = "one closed orbit of a sequence of affine arcs in a box, and no event earlier"
#: Bits; terms of Taylor polynomials, the most that rate times length of a piece may be, halvings of a piece.
BITS, TERMS, REACH, HALVINGS = 256, 16, 2.5, 40
#: Most characters of a file, and of a number in it; most unknowns, and rows of a matrix; most products of numbers in
#: the matrices of all pieces of arcs, a million of which take two seconds; most shares of an arc that are compared.
LENGTH, DIGITS, UNKNOWNS, SIZE, PRODUCTS, SHARES = 2_000_000, 4000, 1200, 60, 4_000_000, 8
ROWS = [[(Fraction,)]]
ARC = {"rate": ROWS, "guards": ROWS, "on_rates": [(bool,)], "fired": (int,), "jump": ROWS, "levels": ROWS}
COURSE = {"modes": [[(int,)]], "guards": [(int,)], "at_once": [(bool,)], "unknown": [(int,)], "basis": ROWS}
COURSE["held"] = [[(int,), (Fraction,)]]
# Input, amplitude and angular frequency [rad/s] of the sine that drives the loop, if one does.
COURSE["drive"] = lambda part: [(str,), (Fraction,), (Fraction,)] if part else [(str,)]
FORM = {
    # The course is for those who know the loop: through which of its modes and events the arcs go.
    "loop": {"arcs": [{**ARC, "at_once": (bool,)}], "course": COURSE},
    "claim": {"events": (int,), "period": [(Fraction,), (Fraction,)], "box": (Fraction,)},
    "evidence": {
        **{name: [(Fraction,)] for name in ("solution", "sizes", "weights")},
        **{name: (Fraction,) for name in ("radius", "box")},
    },
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


def rationals(rows):
    """A matrix of numbers as they are written."""
    return fmpq_mat([[fmpq(*number(v).as_integer_ratio()) for v in row] for row in rows])


def ball(middle, radius):
    """All numbers within a radius."""
    return arb(middle) + arb(0, 1) * arb(radius)


def in_span(row, others):
    """Whether a row is a combination of others, exactly."""
    return bool(fmpq_mat([*others, row.tolist()[0]]).rank() == fmpq_mat(others).rank())


class Arc:
    """Rate, guards in the order in which they are looked at, that which fires, its map, levels of what sticks."""

    def __init__(self, e, m):
        self.rate, self.jump = rationals(e["rate"]), rationals(e["jump"])
        self.guards, self.levels = ([rationals([row]) for row in e[name]] for name in ("guards", "levels"))
        self.fired, self.at_once, self.on_rates = e["fired"], e["at_once"], e["on_rates"]
        square = all((x.nrows(), x.ncols()) == (m + 1, m + 1) for x in (self.rate, self.jump))
        require(square and all(x.ncols() == m + 1 for x in self.guards + self.levels), "arcs of other sizes")
        require(not any(self.rate.tolist()[m]) and self.jump.tolist()[m] == [*[0] * m, 1], "arcs without a 1")
        require(0 <= self.fired < len(self.guards) == len(self.on_rates), "an arc without its guard")


class Orbit:
    """The arcs, one after another; rows that are zero at the ends of those that take time; the equations of a leg."""

    def __init__(self, arcs, m):
        self.arcs, self.timed, self.size = arcs, [k for k, arc in enumerate(arcs) if not arc.at_once], m + 1
        self.products = 0
        require(self.timed, "no arc that takes time")
        self.zero = {k: arcs[k].guards[arcs[k].fired].tolist() for k in self.timed}
        left = known = [(k, row) for k in self.timed for row in arcs[k].levels]
        while known:  # what sticks is on its level at the start, and does not leave it
            known = [x for x in left if not any((x[1] * arcs[x[0]].rate).entries()) and self.at_start(*x)]
            for k, row in known:
                self.zero[k].append(row.tolist()[0])
            left = [x for x in left if not any(x is one for one in known)]
        self.legs = []
        for k, after in zip(self.timed, self.timed[1:] + self.timed[:1], strict=True):
            rows = [[-v for v in row] for row in self.since(after)[1].tolist()[:m]] + self.zero[k][:1]
            self.legs.append((arb_mat(arcs[k].rate), arb_mat(fmpq_mat(rows))))

    def since(self, k):
        """The last arc before that takes time, and the map from its end to the start of arc k."""
        k, through = (k - 1) % len(self.arcs), self.arcs[k - 1].jump
        while self.arcs[k].at_once:
            k = (k - 1) % len(self.arcs)
            through = through * self.arcs[k].jump
        return k, through

    def at_start(self, k, row):
        """Whether a row is zero at the start of an arc."""
        before, through = self.since(k)
        return in_span(row * through, self.zero[before])

    def starts(self, k, state):
        """Of each guard the first derivative that is not zero by its row, whether it rises; None for a rate of zero."""
        out = []
        for row, on_rate in zip(self.arcs[k].guards, self.arcs[k].on_rates, strict=True):
            order, value = 0, (arb_mat(row) * state)[0, 0]
            while not (value > 0 or value < 0) and order < row.ncols():
                require(self.at_start(k, row), "a guard that may be on either side of zero behind an event")
                row, order = row * self.arcs[k].rate, order + 1
                value = (arb_mat(row) * state)[0, 0]
            moves = value > 0 or value < 0
            require(moves or on_rate, "a guard that stays at zero")
            out.append((order, bool(value > 0)) if moves else None)
        return out

    def equations(self, x, spread, sizes):
        """Residual at x of closing leg by leg, guard and next start; derivative over a box of that spread in sizes."""
        n, k = len(x), self.size
        A, r = [[arb(0)] * n for _ in range(n)], []
        for at, (rate, rows) in zip(range(0, n, k), self.legs, strict=True):
            after, v = (at + k) % n, [*x[at : at + k - 1], fmpq(1)]
            flow = (rate * arb(x[at + k - 1])).exp()
            r += (rows * (flow * arb_mat(k, 1, [arb(y) for y in v]))).entries()
            flow = flow * (rate * ball(0, spread * sizes[-1])).exp()
            wide = arb_mat(k, 1, [*(ball(y, spread * s) for y, s in zip(v, sizes[:-1], strict=False)), arb(1)])
            block, by_time = (rows * flow).tolist(), (rows * (rate * (flow * wide))).entries()
            for j in range(k):
                line = [*block[j][: k - 1], by_time[j]]
                A[at + j][at : at + k] = [y * arb(s) for y, s in zip(line, sizes, strict=True)]
                if j < k - 1:
                    A[at + j][after + j] += arb(sizes[j])
                    r[at + j] += arb(x[after + j])
        return arb_mat(n, 1, r), arb_mat(A)

    def holds_one(self, x, spread, sizes):
        """Whether Krawczyk's operator maps a box about x into its inside: it holds exactly one solution."""
        residual, derivative = self.equations(x, fmpq(0), sizes)
        Y = arb_mat([[v.mid() for v in row] for row in derivative.inv().tolist()])
        away = Y * self.equations(x, spread, sizes)[1] - arb_mat(len(x), len(x), 1)
        reach = [sum((abs(v) for v in row), arb(0)) * arb(spread) for row in away.tolist()]
        return all(abs(y) + c < arb(spread) for y, c in zip((Y * residual).entries(), reach, strict=True))

    def stays_below(self, k, start, duration, weights):
        """No guard rises on an arc before its own: Taylor polynomials in Bernstein form, piece by piece."""
        arc, rate = self.arcs[k], arb_mat(self.arcs[k].rate)
        starts, m = self.starts(k, start), len(weights)
        require(duration > 0 and not any(s and s[1] for s in starts), "an event that happens at once")
        sizes = [[abs(v) * w for v, w in zip(row[:m], weights, strict=True)] for row in rate.tolist()[:m]]
        growth = max([arb(2) ** -40] + [(sum(s, arb(0)) / w).upper() for s, w in zip(sizes, weights, strict=True)])
        end, ends = (rate * duration).exp() * start, [in_span(row, self.zero[k]) for row in arc.guards]
        first = not any(s and ends[g] for g, s in enumerate(starts[: arc.fired]))
        require(first, "an event that is not the first one due")

        def below(g, state, length, order, last):
            """Whether a guard over a power of the time since a piece's start (left until the event) lies below zero."""
            state, length, order = (end, -length, 1) if last and ends[g] else (state, length, order)
            row, reach = arb_mat(arc.guards[g]), growth * abs(length)
            high = sum((abs(v) * w for v, w in zip(row.entries()[:m], weights, strict=True)), arb(0))
            fast = max((abs(v) / w).upper() for v, w in zip((rate * state).entries()[:m], weights, strict=True))
            rest, c = high * fast / growth * reach**TERMS / fmpz.fac_ui(fmpz(TERMS)) * reach.exp(), []
            for j in range(TERMS):
                c.append((row * state)[0, 0])
                row = row * rate * (length / (j + 1))
            c, d = c[order:], TERMS - order - 1
            share = [[fmpq(fmpz.bin_uiui(i, j), fmpz.bin_uiui(d, j)) for j in range(i + 1)] for i in range(d + 1)]
            return all(sum((y * s for y, s in zip(c, row, strict=False)), rest) < 0 for row in share)

        left = [(start, duration, [g for g, s in enumerate(starts) if s], True, True, 0)]
        while left:
            state, length, guards, first, last, depth = left.pop()
            self.products += self.size**3
            require(self.products <= PRODUCTS, f"arcs whose pieces take more than {PRODUCTS} products")
            if growth * length < REACH:
                guards = [g for g in guards if not below(g, state, length, first * starts[g][0], last)]
            if guards:
                require(depth < HALVINGS, "an event that may happen earlier")
                middle = (rate * (length / 2)).exp() * state
                left.append((middle, length / 2, guards, False, last, depth + 1))
                left.append((state, length / 2, guards, first, False, depth + 1))
        self.follow(k, arb_mat(arc.jump) * end)

    def follow(self, k, state):
        """Events without delay behind an arc: each guard has been passed, and none that is due before it."""
        k = (k + 1) % len(self.arcs)
        while self.arcs[k].at_once:
            arc, starts = self.arcs[k], self.starts(k, state)
            due = [(s[0] != 0 or arc.on_rates[g], g) for g, s in enumerate(starts) if s and s[1]]
            require(due and min(due)[1] == arc.fired, "an event without delay that is not the first one due")
            state, k = arb_mat(arc.jump) * state, (k + 1) % len(self.arcs)


def once_round(legs):
    """Whether the period is the least one: no share of it brings some state of the motion back to itself.

    A guard is zero at the end of its arc alone, so that no arc is longer than the least period: there are at least as
    many arcs that take time as it goes into the period.
    """
    total, ends = sum((t for *_, t in legs), arb(0)), [arb(0)]
    for *_, t in legs:
        ends.append(ends[-1] + t)

    def at(time):
        """The state at a time, where it is certain on which arc it lies."""
        for (rate, state, _), begin, end in zip(legs, ends, ends[1:], strict=False):
            if begin <= time <= end:
                return (rate * (time - begin)).exp() * state
        return None

    def differs(n):
        """Whether the motion is elsewhere after the n-th part of the period."""
        for j in range(1, SHARES):
            first, then = at(legs[0][2] * j / SHARES), at(legs[0][2] * j / SHARES + total / n)
            apart = first is not None and then is not None
            if apart and any(not (a - b).contains(0) for a, b in zip(first.entries(), then.entries(), strict=True)):
                return True
        return False

    return all(differs(n) for n in range(2, len(legs) + 1))


def verify(document):
    """What a certificate proves: of how many events the orbit is, its period, the box in which there is no other."""
    loop, said, evidence = opened(document, FORM)
    x, sizes, weights = (rationals([evidence[name]]).entries() for name in ("solution", "sizes", "weights"))
    (radius, box), k = rationals([[evidence["radius"], evidence["box"]]]).entries(), len(sizes)
    require(len(x) <= UNKNOWNS and k <= SIZE, f"more than {UNKNOWNS} unknowns, or {SIZE} of an arc")
    with ctx.workprec(BITS):
        orbit = Orbit([Arc(e, k - 1) for e in loop["arcs"]], k - 1)
        fits = len(x) == k * len(orbit.timed) and len(weights) == (k - 1) * len(orbit.timed)
        require(fits and min(sizes + weights) > 0 and 0 < radius <= box, "a box that is none")
        alone = all(orbit.holds_one(x, size, sizes) for size in (box, radius))
        require(alone, "a box that is not proved to hold one orbit")
        legs = []
        for i, arc in enumerate(orbit.timed):
            *start, duration = (ball(v, radius * s) for v, s in zip(x[i * k : i * k + k], sizes, strict=True))
            state = arb_mat(k, 1, [*start, arb(1)])
            orbit.stays_below(arc, state, duration, [arb(w) for w in weights[i * (k - 1) : (i + 1) * (k - 1)]])
            legs.append((arb_mat(orbit.arcs[arc].rate), state, duration))
        require(once_round(legs), "an orbit that may be run more than once")
    period = [str(sum(x[k - 1 :: k], sign * radius * sizes[-1] * len(orbit.timed))) for sign in (-1, 1)]
    claim = {"events": len(orbit.arcs), "period": period, "box": evidence["box"]}
    require(said == claim, f"it claims {said}, its evidence shows {claim}")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(read(sys.stdin.read(LENGTH + 1)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        why = str(error) if isinstance(error, Refused) else f"it cannot be read: {type(error).__name__}, {error}"
        print(json.dumps({"accepted": False, "why": why}))
        raise SystemExit(1) from None
