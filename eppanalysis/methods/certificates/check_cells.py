"""Checker that a relay with dead zone has no limit cycles but those listed: its return map in cells, images in balls.

It runs alone, ``python -I check_cells.py < certificate.json``. The loop is k/(s (s + p)(s + q)), p, q > 0; scaled,
``x' = v, v' = a, a' = -a - beta v - kappa y``, y one of -1, 0, 1 beside thresholds of 1. Theory: docs/theory/proofs.md.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

from flint import arb, arb_mat, ctx, fmpq, fmpq_mat

STATEMENT = "all periodic motions but rest, by cells of a return map"
BITS, TICK, GRID = 96, 60, 24  # precision; times are cut at multiples of 2**-TICK, sides of the domain of 2**-GRID
#: Most characters of a file, and of a number in it; most cells, and most pieces of time in which a crossing is sought.
LENGTH, DIGITS, CELLS, PIECES = 1_000_000, 1000, 10_000, 1000
PAIRS = [[(Fraction,), (Fraction,)]]
FORM = {
    "loop": {
        "time_step": (str, type(None)),
        "num": [(Fraction,)],
        "den": [(Fraction,)],
        "delay": (Fraction,),
        "element": {"kind": (str,), "slope": (Fraction,), "bends": PAIRS, "jumps": PAIRS},
    },
    "claim": {"cells": (int,), "cycles": [{"period": [(Fraction,), (Fraction,)], "outside": (int,)}]},
    "evidence": {"cover": (str,), "order": [(int,)], "forms": [[(int,), [(Fraction,), (Fraction,), (Fraction,)]]]},
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


def rational(text):
    """A number as it is written."""
    return fmpq(*number(text).as_integer_ratio())


def hull(first, *others):
    """A ball that holds all of several."""
    return arb(first).union(hull(*others)) if others else arb(first)


class ReturnMap:
    """From one switch to the upper level, at speed v >= 0, to the next, or to the lower mirrored."""

    def __init__(self, loop):
        ((*none, k), den), element = ([*map(rational, loop[name])] for name in ("num", "den")), loop["element"]
        at, level, slope = map(rational, (*element["jumps"][0], element["slope"]))
        require(rational(loop["delay"]) == 0 and loop["time_step"] is None, "a loop with dead time or in discrete time")
        relay = element["kind"] == "odd_pieces" and len(element["jumps"]) == 1 and not element["bends"]
        require(relay and slope == 0 < at, "an element that is no relay with dead zone")
        require(not any(none) and len(den) == 4 and den[0] == 1 and den[3] == 0, "a loop of another kind")
        require(level * k > 0 and den[1] > 0 and 0 < 4 * den[2] <= den[1] ** 2, "poles or signs of others")
        self.beta, self.kappa, self.rate = den[2] / den[1] ** 2, k * level / den[1] ** 3 / at, den[1]
        self.sides = self.kappa / self.beta, 2 * self.kappa  # no periodic motion has more speed, more acceleration
        self.jerk, self.limit = arb(0, 9 * self.kappa), 1 << int((64 / self.beta).ceil()).bit_length() + TICK
        self.apart, self.known = arb(fmpq(1, 4) - self.beta).sqrt(), {}  # half the distance of the poles

    def table(self, t):
        """What position owes to speed, acceleration, relay after so many ticks, and they to the rate."""
        if t not in self.known:
            time = arb(t) / 2**TICK
            fade, (sinh, cosh) = (-time / 2).exp(), (self.apart * time).sinh_cosh()
            h = fade * (time if 4 * self.beta == 1 else sinh / self.apart)
            dh = fade * cosh - h / 2
            g = (1 - dh - h) / self.beta
            self.known[t] = h + g, g, (time - h - g) / self.beta, h, dh
        return self.known[t]

    def state(self, start, t):
        """Position, speed and acceleration after a time, from speed, acceleration, and the level of the relay."""
        (v, a, y), (p, g, s, h, dh) = start, self.table(t)
        push = self.kappa * y
        return 1 + p * v + g * a - push * s, (h + dh) * v + h * a - push * g, dh * a - self.beta * h * v - push * h

    def turn(self, holds):
        """Ticks at which something still holds, and no longer does (not before the limit if beyond it)."""
        t, step = 0, self.limit
        while step > t >> 5:
            t, step = t + step * holds(t + step), step // 2
        return t, t + max(2 * step, 1)

    def near(self, start, t, d):
        """Speed, acceleration and their derivatives by those at the start if the crossing is within d of a time."""
        (x, v, a), (_, g, _, h, dh), jerk = self.state(start, t), self.table(t), self.jerk
        for _ in range(3):
            A = a + d * jerk
            V = v + d * A
            jerk = -A - self.beta * V - self.kappa * start[2]
        dh = dh + d * arb(0, 2)
        h = h + d * dh
        g = g + d * h
        return x, V, A, h + dh - A * (h + g) / V, h - A * g / V, -jerk * (h + g) / V - self.beta * h, dh - jerk * g / V

    def land(self, start, low, high, side):
        """Speed, acceleration, derivatives by those at the start, time, where a threshold is met; mirrored below."""
        half, found = min(max((high - low) // 16, 1), 1 << TICK - 4), []
        require(high - low <= 2 * half * PIECES, "a crossing after too long a time")
        for t in range(low + half, high + half, 2 * half):
            x, *rest = self.near(start, t, d := arb(0, half) / 2**TICK)
            if (x - side + d * rest[0]).contains(0):
                found.append((arb(t) / 2**TICK + d, *rest))
        require(found and high <= self.limit, "a crossing that is none")
        T, *rest = (hull(*x) for x in zip(*found, strict=True))
        for _ in range(6):
            t = int((T.mid() * 2**TICK).floor().unique_fmpz())
            x, *more = self.near(start, t, hull(0, T - arb(t) / 2**TICK))
            if more[0].contains(0):
                break
            T = T.intersection(arb(t) / 2**TICK - (x - side) / more[0])
            rest = [x.intersection(y) if x.is_finite() else y for x, y in zip(rest, more, strict=True)]
        return *(side * x for x in rest[:2]), arb_mat([rest[2:4], rest[4:]]) * side, T

    def up(self, v, a):
        """The arc at the upper level: speed (not positive) and acceleration at its end, derivatives, time."""
        low, _ = self.turn(lambda t: self.state((v, a, 1), t)[0] > 1)
        _, high = self.turn(lambda t: not self.state((v, a, 1), t)[0] < 1)
        (V, A, *rest), d = self.land((v, a, 1), low, high, 1), hull(0, arb(high) / 2**TICK)
        concave = -(a + d * self.jerk) * (1 + self.beta * d) - self.beta * v < self.kappa  # v is, and its mean is zero
        return [V.lower(), min(V.upper(), 0)], [A.lower(), min(A.upper(), 0) if concave else A.upper()], *rest

    def rest(self, v, a, side):
        """The arc in the dead zone to one threshold, if there may be one: as `up`, mirrored."""
        start = hull(*v), hull(*a), 0
        low, _ = self.turn(lambda t: side * self.state(start, t)[0] < 1 and (side > 0 or self.state(start, t)[1] <= 0))
        reach = sum(max((side * z).upper(), 0) for z in self.state(start, low)[1:])
        if side * self.state(start, low)[0] + reach / self.beta < 1 or (side > 0 and v[1] <= 0 and a[1] <= 0):
            return []
        _, high = self.turn(lambda t: not side * self.state(start, t)[0] > 1)
        if high <= self.limit:
            return [self.land(start, low, high, side)]
        A = side * (start[1] + start[0] + self.beta * (1 - side)) - (V := hull(0, reach))  # some may not arrive
        return [(V, A, arb_mat(2, 2), arb("nan"))]

    def images(self, v, a):
        """Where a box comes back: speed, acceleration; if all of it comes to one side also derivatives and time."""
        V, A, slope, time = self.up(v, a)
        found = [(*x, y * slope, time + t) for side in (-1, 1) for *x, y, t in self.rest(V, A, side)]
        if len(found) != 1 or v.rad() + a.rad() == 0 or not (found[0][2].det() + found[0][3]).is_finite():
            return [(*x[:2], None, None) for x in found]
        ((V, A, slope, time),), ((v0, a0, *_),) = found, self.images(v.mid(), a.mid())
        dv, da = (slope * arb_mat(2, 1, [v - v.mid(), a - a.mid()])).entries()  # sharper by the mean value theorem
        return [(V.intersection(v0 + dv), A.intersection(a0 + da), slope, time)]

    def box(self, cell):
        """Speeds and accelerations of a cell."""
        return [hull(*(s * x / 2**GRID for x in cell[i : i + 2])) for i, s in zip((0, 2), self.sides, strict=True)]

    def reached(self, cell):
        """Boxes that hold the images of a cell, both in parts of the sides, and derivatives as `images` has them."""
        for *image, slope, _ in self.images(*self.box(cell)):
            ends = [(y, 2**GRID / s) for x, s in zip(image, self.sides, strict=True) for y in (x.lower(), x.upper())]
            yield [int((x * s).lower().floor().unique_fmpz()) + 2 * (i % 2) for i, (x, s) in enumerate(ends)], slope

    def cycle(self, cell, form):
        """Period, multipliers outside, of the one cycle in a box: a form rises, A'QA > Q, between any motions."""
        (p, q, r), box = map(rational, form), self.box(cell)
        for n in range(8):
            ((*_, slope, time),), ((v, a, *_),) = self.images(*box), self.images(*(m := [x.mid() for x in box]))
            rise = slope.transpose() * (Q := fmpq_mat([[p, q], [q, r]])) * slope - Q
            step = (slope - arb_mat(2, 2, 1)).inv() * arb_mat(2, 1, [v - m[0], a - m[1]])
            newton = [x - y for x, y in zip(m, step.entries(), strict=True)]
            holds = n or all(x.contains_interior(y) for x, y in zip(box, newton, strict=True))
            require(holds and rise[0, 0] > 0 and rise.det() > 0, "cells that are not proved to hold just one cycle")
            box = [x.intersection(y) for x, y in zip(box, newton, strict=True)]
        return 2 * time / self.rate, 1 if Q.det() < 0 else 2 * int(p > 0)


def leaves(cover):
    """Boxes of a cover, in its order: "v", "a" cut the next box in halves, in speed or acceleration, "." is a leaf."""
    left = [(0, 2**GRID, -(2**GRID), 2**GRID)]
    for mark in cover:
        require(left and mark in "va.", "a cover that is none")
        b = left.pop()
        i, j = (b[0] + b[1]) // 2, (b[2] + b[3]) // 2
        left += {"v": [(i, *b[1:]), (b[0], i, *b[2:])], "a": [(*b[:2], j, b[3]), (*b[:3], j)]}.get(mark, [])
        yield from [b] if mark == "." else []
    require(not left, "a cover with boxes missing")


def verify(document):
    """What a certificate proves: in how many cells, and of each cycle the period and the multipliers outside."""
    loop, claim, evidence = opened(document, FORM)
    order, forms = evidence["order"], dict(evidence["forms"])
    require(len(order) <= CELLS and len(evidence["cover"]) <= 2 * CELLS, f"more than {CELLS} cells")
    require(len(forms) == len(evidence["forms"]), "two forms of the same cells")
    cells, last = [*zip(leaves(evidence["cover"]), order, strict=True)], 0
    require(len(cells) == claim["cells"], "a claim of other cells")
    with ctx.workprec(BITS):
        returns = ReturnMap(loop)
        for (number, form), said in zip(forms.items(), claim["cycles"], strict=True):
            box = [end(cell[i] for cell, n in cells if n == number) for i, end in enumerate((min, max, min, max))]
            (period, outside), (low, high) = returns.cycle(box, form), map(rational, said["period"])
            require(last < low < period < high and said["outside"] == outside, "a cycle that is another one")
            last = high  # cycles differ as their periods do
        for cell, n in cells:
            for (a, b, c, d), _ in returns.reached(cell):
                met = {m for x, m in cells if x[0] <= b and a <= x[1] and x[2] <= d and c <= x[3]}
                require(all(m < n or (m == n and n in forms) for m in met), "cells that may map to themselves")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(read(sys.stdin.read(LENGTH + 1)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        why = str(error) if isinstance(error, Refused) else f"it cannot be read: {type(error).__name__}, {error}"
        print(json.dumps({"accepted": False, "why": why}))
        raise SystemExit(1) from None
