"""Checker that a relay with dead zone has no limit cycle: the return map of a plane in cells, images in balls.

It stands alone, ``python -I check_cells.py < certificate.json``. The loop is k/(s (s + p)(s + q)), p, q > 0; scaled,
``x' = v, v' = a, a' = -a - beta v - kappa y``, y one of -1, 0, 1 beside thresholds of 1. Theory: docs/theory/cells.md.
"""

import json
from fractions import Fraction

from flint import arb, arb_mat, ctx, fmpq

STATEMENT = "no periodic motion but rest, by cells of a return map"
BITS, TICK, GRID = 96, 30, 24  # precision; times are cut at multiples of 2**-TICK, sides of the domain of 2**-GRID


class Refused(Exception):
    """Why a certificate proves nothing."""


def require(holds, why):
    """Refuse what does not hold."""
    if not holds:
        raise Refused(why)


def rational(text):
    """A number as it is written."""
    return fmpq(*Fraction(text if isinstance(text, str) else "no text").as_integer_ratio())


def hull(balls):
    """A ball that holds all of several."""
    first, *others = map(arb, balls)
    return first.union(hull(others)) if others else first


class ReturnMap:
    """From one switch to the upper level, at speed v >= 0, to the next, or to the lower mirrored."""

    def __init__(self, loop):
        ((*none, k), den), element = ([*map(rational, loop[name])] for name in ("num", "den")), loop["element"]
        require(rational(loop["delay"]) == 0 and loop["time_step"] is None, "a loop with dead time or in discrete time")
        require(not any(none) and len(den) == 4 and den[0] == 1 and den[3] == 0, "a loop of another kind")
        require(element["kind"] == "odd_pieces" and len(element["jumps"]) == 1, "an element that is no relay")
        require(not element["bends"] and rational(element["slope"]) == 0, "an element that is no relay with dead zone")
        at, level = map(rational, element["jumps"][0])
        require(at > 0 and level * k > 0 and den[1] > 0 and 0 < 4 * den[2] <= den[1] ** 2, "poles or signs of others")
        self.beta, self.kappa, self.known = den[2] / den[1] ** 2, k * level / den[1] ** 3 / at, {}
        self.sides = self.kappa / self.beta, 2 * self.kappa  # no periodic motion has more speed, more acceleration
        self.jerk = arb(0, 9 * self.kappa)  # of every motion that begins within these sides
        self.matrix, self.limit = arb_mat([[0, 1], [-arb(self.beta), -1]]), int((64 / self.beta).ceil()) << TICK

    def table(self, t):
        """What the position owes to speed, acceleration, relay after a time (ball or ticks), and they to the rate."""
        if t not in self.known:
            time = arb(t) / 2**TICK if isinstance(t, int) else t
            (_, h), (_, dh) = (self.matrix * time).exp().tolist()
            g = (1 - dh - h) / self.beta
            self.known[t] = h + g, g, (time - h - g) / self.beta, h, dh
        return self.known[t] if isinstance(t, int) else self.known.pop(t)

    def state(self, start, t):
        """Position, speed and acceleration after a time, from speed, acceleration, and the level of the relay."""
        (v, a, y), (p, g, s, h, dh) = start, self.table(t)
        push = self.kappa * y
        return 1 + p * v + g * a - push * s, (h + dh) * v + h * a - push * g, dh * a - self.beta * h * v - push * h

    def between(self, early, done, stops=lambda t: False):
        """Ticks between which a crossing comes, the latter None for no end; None where none comes."""
        t = 1 << TICK
        while t and not early(t):
            t //= 2
        low, t = t, max(2 * t, 1)
        while not (never := stops(low)) and low and early(t) and t < self.limit:
            low, t = t, 2 * t
        while not never and t < self.limit and not done(t):
            t *= 2
        high = t
        for _ in range(4):
            low = (low + t) // 2 if early((low + t) // 2) else low
            high = (low + high) // 2 if done((low + high) // 2) else high
        return None if never else (low, high if done(high) else None)

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

    def land(self, start, low, high, level):
        """Speed, acceleration and derivatives where the position meets a level in an interval."""
        step, found = 1 << min(max((high - low) // 16, 1).bit_length() - 1, TICK - 4), []
        for t in range(low // step * step + step, high + step, 2 * step):
            x, *rest = self.near(start, t, d := arb(0, step) / 2**TICK)
            if (x - level + d * rest[0]).contains(0):
                found.append((arb(t) / 2**TICK + d, *rest))
        require(found, "a crossing that is none")
        T, *rest = (hull(x) for x in zip(*found, strict=True))
        while not (more := self.near(start, T.mid(), T - T.mid()))[1].contains(0):
            last, T, more = T, T.intersection(T.mid() - (more[0] - level) / more[1]), more[1:]
            rest = [x.intersection(y) if x.is_finite() else y for x, y in zip(rest, more, strict=True)]
            if 2 * T.rad() > last.rad():
                break
        return *rest[:2], (rest[2:4], rest[4:]) if all(x.is_finite() for x in rest[2:]) else None

    def up(self, v, a):
        """The arc at the upper level: speed (not positive) and acceleration at its end, derivatives."""
        start = hull(v), hull(a), 1
        found = self.between(lambda t: self.state(start, t)[0] > 1, lambda t: self.state(start, t)[0] < 1)
        (V, A, slope), d = self.land(start, found[0], found[1], 1), arb(0).union(arb(found[1]) / 2**TICK)
        fall = start[1] + d * self.jerk
        concave = -fall - self.beta * (start[0] + d * fall) - self.kappa < 0  # v is, and its mean is zero
        return [V.lower(), min(V.upper(), 0)], [A.lower(), min(A.upper(), 0) if concave else A.upper()], slope

    def rest(self, v, a, side):
        """The arc in the dead zone to one threshold: as `up`, mirrored, no derivatives where some do not arrive."""
        start = hull(v), hull(a), 0

        def reach(t):
            return sum(max((side * z).upper(), 0) for z in self.state(start, t)[1:])

        found = self.between(
            lambda t: side * self.state(start, t)[0] < 1 and (side > 0 or self.state(start, t)[1] <= 0),
            lambda t: side * self.state(start, t)[0] > 1,
            lambda t: side * self.state(start, t)[0] + reach(t) / self.beta < 1,
        )
        if found is None or (side > 0 and v[1] <= 0 and a[1] <= 0):
            return None
        if found[1] is not None:
            V, A, slope = self.land(start, found[0], found[1], side)
            return side * V, side * A, slope and [[side * x for x in row] for row in slope]
        V = side * arb(0).union(reach(found[0]))
        return side * V, side * (start[1] + start[0] + self.beta * (1 - side) - V), None

    def images(self, v, a):
        """Where points of a box come back: speed, acceleration, and derivatives if all come to one side."""
        V, A, first = self.up(v, a)
        found = [x for x in (self.rest(V, A, side) for side in (-1, 1)) if x]
        whole = len(found) == 1 and first and found[0][2]
        return [(*found[0][:2], arb_mat(found[0][2]) * arb_mat(first))] if whole else [(*x[:2], None) for x in found]

    def reached(self, v, a):
        """The same, sharper where there are derivatives: by the image of the middle and the mean value theorem."""
        found = self.images(v, a)
        if len(found) == 1 and found[0][2] is not None:
            m = [hull(x).mid() for x in (v, a)]
            away = found[0][2] * arb_mat([[hull(v) - m[0]], [hull(a) - m[1]]])
            (at,) = self.images(*([x, x] for x in m))
            found = [[found[0][i].intersection(at[i] + away[i, 0]) for i in (0, 1)]]
        return [x[:2] for x in found]

    def reached_from(self, leaf):
        """Boxes that hold the images of a box, both in parts of the sides."""
        box = [[arb(size * x / 2**GRID) for x in leaf[i : i + 2]] for i, size in zip((0, 2), self.sides, strict=True)]
        for ends in ([V.lower(), V.upper(), A.lower(), A.upper()] for V, A in self.reached(*box)):
            parts = [(end * 2**GRID / self.sides[i // 2]).lower().floor() for i, end in enumerate(ends)]
            yield [int(part.unique_fmpz()) + 2 * (i % 2) for i, part in enumerate(parts)]


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
    """What a certificate proves: that no cell of a cover comes back to itself, in how many cells."""
    require(document["statement"] == STATEMENT, "another statement")
    text = json.dumps({name: part for name, part in document.items() if name != "digest"}, sort_keys=True)
    require(document["digest"] == int.from_bytes(text.encode(), "big") % (2**127 - 1), "a file that was changed")
    with ctx.workprec(BITS):
        returns, order = ReturnMap(document["loop"]), document["evidence"]["order"]
        cells = [*leaves(document["evidence"]["cover"])]
        require(len(order) == len(cells) and document["claim"] == {"cells": len(cells)}, "an order of other cells")
        for n, leaf in enumerate(cells):
            for a, b, c, d in returns.reached_from(leaf):
                met = [m for m, x in enumerate(cells) if x[0] <= b and a <= x[1] and x[2] <= d and c <= x[3]]
                require(all(order[m] < order[n] for m in met), "cells that may come back to themselves")
    return document["claim"]


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(json.load(open(0)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        print(json.dumps({"accepted": False, "why": str(error) or type(error).__name__}))
        raise SystemExit(1) from None
