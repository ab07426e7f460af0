"""Checker of a certificate of absence: no periodic motion but rest, by the criterion of Popov or the circle criterion.

It stands alone, ``python -I check_absence.py < certificate.json``, and computes with exact rationals throughout.
Theory: docs/theory/certificates.md, and of play docs/theory/absence_with_play.md, "By frequency".
"""

import json
from fractions import Fraction

STATEMENT = "no periodic motion but rest"


class Refused(Exception):
    """Why a certificate proves nothing."""


def require(holds, why):
    """Refuse what does not hold."""
    if not holds:
        raise Refused(why)


def rational(text):
    """A number as it is written."""
    require(isinstance(text, str), f"a number that is no text: {text}")
    return Fraction(text)


def ratios(half):
    """Least and greatest y/x of a static element for x > 0; None for no bound.

    It has a slope at zero, bends [at, change of slope] and jumps [at, height]; between two of them y/x has no extremum.
    """
    m, bends, jumps = rational(half["slope"]), *([[*map(rational, row)] for row in half[n]] for n in ("bends", "jumps"))
    require(all(at >= 0 for at, _ in bends + jumps), "an element that changes below zero")
    start = sum(height for at, height in jumps if at == 0)
    places = sorted({at for at, _ in bends + jumps if at > 0})
    first = m + sum(change for at, change in bends if at == 0)
    found = [m + sum(change for _, change in bends)] + ([first] if start == 0 else [])  # far out, and at zero
    for x in places:
        bent = m * x + sum(change * (x - at) for at, change in bends if at < x)
        found += [(bent + sum(h for at, h in jumps if at < x)) / x, (bent + sum(h for at, h in jumps if at <= x)) / x]
    return None if start < 0 else min(found), None if start > 0 else max(found)


def sector(element):
    """Least and greatest y/x of an element, one of them None for no bound; of play those of the rates of y and x."""
    if element["kind"] == "play":
        require(rational(element["gap"]) > 0, "a play without a gap")
        return Fraction(0), Fraction(1)
    if element["kind"] in ("cube", "drag"):
        require(rational(element["scale"]) > 0, "an element outside of all sectors")
        return Fraction(0), None
    name = element["kind"].replace("_", " ")
    require(element["kind"] in ("odd_pieces", "pieces"), f"the element {name} is not covered")
    halves = [element] if element["kind"] == "odd_pieces" else [element["positive"], element["negative"]]
    least, most = zip(*map(ratios, halves), strict=True)
    return None if None in least else min(least), None if None in most else max(most)


def trimmed(p):
    """A polynomial without leading zeros."""
    while p and p[-1] == 0:
        p = p[:-1]
    return p


def added(p, q, factor=Fraction(1)):
    """``p + factor q``, coefficients in ascending powers."""
    n = max(len(p), len(q))
    p, q = ([*x, *[Fraction(0)] * (n - len(x))] for x in (p, q))
    return trimmed([a + factor * b for a, b in zip(p, q, strict=True)])


def times(p, q):
    """The product of two polynomials."""
    out = [Fraction(0)] * max(len(p) + len(q) - 1, 0)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            out[i + j] += a * b
    return trimmed(out)


def on_axis(p):
    """Polynomials a, b in ``u = omega**2`` with ``p(j omega) = a + j omega b``."""
    return [c * (-1) ** i for i, c in enumerate(p[::2])], [c * (-1) ** i for i, c in enumerate(p[1::2])]


def criterion(num, den, low, high, multiplier):
    """``Re((1 + j omega r) num conj(D)) + |D|^2/(high - low)``, D = den + low num, as a polynomial in omega squared."""
    den = added(den, num, low)
    (a, b), (c, d), u = on_axis(num), on_axis(den), [Fraction(0), Fraction(1)]
    real, turn = added(times(a, c), times(u, times(b, d))), added(times(b, c), times(a, d), Fraction(-1))
    size = added(times(c, c), times(u, times(d, d)))
    popov = added(real, times(u, turn), -multiplier)
    return popov if high is None else added(popov, size, 1 / (high - low))


def changes(signs):
    """How often the sign changes, zeros left out."""
    signs = [s for s in signs if s]
    return sum((s > 0) != (t > 0) for s, t in zip(signs, signs[1:], strict=False))


def positive(p):
    """Whether a polynomial is positive for all positive numbers: its sign far out, and no root by Sturm's count."""
    while p and p[0] == 0:
        p = p[1:]
    if not p or p[-1] <= 0:
        return False
    chain = [p, [i * c for i, c in enumerate(p)][1:]]
    while trimmed(chain[-1]):
        rest = chain[-2]
        while len(rest) >= len(chain[-1]):
            shifted = [Fraction(0)] * (len(rest) - len(chain[-1])) + chain[-1]
            rest = added(rest, shifted, -rest[-1] / chain[-1][-1])
        chain.append([-c / abs(rest[-1]) for c in rest])
    chain.pop()
    return changes([q[0] for q in chain]) == changes([q[-1] for q in chain])


def verify(document):
    """What a certificate proves: the sector and the multiplier with which the criterion holds."""
    require(document["statement"] == STATEMENT, "another statement")
    text = json.dumps({name: part for name, part in document.items() if name != "digest"}, sort_keys=True)
    require(document["digest"] == int.from_bytes(text.encode(), "big") % (2**127 - 1), "a file that was changed")
    loop, evidence = document["loop"], document["evidence"]
    require(rational(loop["delay"]) == 0, "a loop with dead time is not covered")
    require(loop["time_step"] is None, "a loop in discrete time is not covered")
    num, den = (trimmed([*map(rational, loop[name][::-1])]) for name in ("num", "den"))
    require(0 < len(num) < len(den), "a linear part that is zero, or passes its input straight through")
    low, high = sector(loop["element"])
    require(low is not None and (high is None or low < high), "an element without a sector")
    if loop["element"]["kind"] == "play":
        require(rational(evidence["multiplier"]) == 0, "a multiplier, where the element remembers")
    else:
        require(num[0] != 0 or (den[0] + low * num[0]) != 0, "an integrator that the element does not see")
    claim = {"sector": [str(low), None if high is None else str(high)], "multiplier": evidence["multiplier"]}
    require(document["claim"] == claim, f"it claims {document['claim']}, its evidence shows {claim}")
    polynomial = criterion(num, den, low, high, rational(evidence["multiplier"]))
    require([*map(rational, evidence["polynomial"])] == polynomial[::-1], "a polynomial that is not the loop's")
    require(positive(polynomial), "a polynomial that is not positive for all frequencies")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(json.load(open(0)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        print(json.dumps({"accepted": False, "why": str(error) or type(error).__name__}))
        raise SystemExit(1) from None
