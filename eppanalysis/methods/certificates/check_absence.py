"""Checker of a certificate of absence: no periodic motion but rest, by the criterion of Popov or the circle criterion.

A file speaks of one linear part, of all on the straight line between two, or of a box with 4 or 8 at its corners, and
of one dead time, or of all between two. The checker runs alone, ``python -I check_absence.py < certificate.json``,
and computes with exact rationals and, behind dead time, with balls (python-flint). Theory: docs/theory/proofs.md, "No
periodic motion", and of play "By frequency".
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

STATEMENT = "no periodic motion but rest"
#: Most characters of a file, of a number in it, and of the numbers of a polynomial; most coefficients of the loop's.
LENGTH, DIGITS, SIZE, ORDER = 100_000, 1000, 4000, 60
#: Most boxes of frequency and dead time, and the binary places of the balls over them.
BOXES, BITS = 20_000, 100
#: Most characters of the longest polynomials of all corners together; most bends and jumps of an element, and
#: characters of their numbers.
CORNERS, PLACES, TEXT = 8000, 800, 40_000
HALF = {"slope": (Fraction,), "bends": [[(Fraction,), (Fraction,)]], "jumps": [[(Fraction,), (Fraction,)]]}
ELEMENTS: dict = {
    "odd_pieces": HALF,
    "pieces": {"positive": HALF, "negative": HALF},
    "cube": {"scale": (Fraction,)},
    "drag": {"scale": (Fraction,)},
    "play": {"gap": (Fraction,)},
}
FORM = {
    "claim": {"sector": [(Fraction, type(None))], "multiplier": (Fraction,)},
    "evidence": {"multiplier": (Fraction,), "polynomials": [[(Fraction,)]]},
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


def delay_form(part):
    """The form of a dead time: one, or the least and the greatest."""
    return [(Fraction,), (Fraction,)] if type(part) is list else (Fraction,)


def ratios(half):
    """Least and greatest y/x of a static element for x > 0; None for no bound.

    It has a slope at zero, bends [at, change of slope] and jumps [at, height]; between two of them y/x has no extremum.
    """
    from flint import fmpq  # its finder is read where this is not installed

    slope, start, offset = fmpq(*number(half["slope"]).as_integer_ratio()), fmpq(0), fmpq(0)
    changes, found = {fmpq(0): [fmpq(0), fmpq(0)]}, []
    for k, name in enumerate(("bends", "jumps")):
        for at, change in ([fmpq(*number(x).as_integer_ratio()) for x in row] for row in half[name]):
            changes.setdefault(at, [fmpq(0), fmpq(0)])[k] += change
    require(min(changes) >= 0, "an element that changes below zero")
    for at, (bend, jump) in sorted(changes.items()):
        found += [slope + offset / at] if at else []  # y = slope x + offset before, and then behind
        slope, offset = slope + bend, offset + jump - bend * at
        start = start if at else offset
        found += [slope + offset / at] if at else [slope] if offset == 0 else []
    least, most = (Fraction(int(y.p), int(y.q)) for y in (min([*found, slope]), max([*found, slope])))
    return None if start < 0 else least, None if start > 0 else most


def sector(element):
    """Least and greatest y/x of an element, one of them None for no bound; of play those of the changes of y and x."""
    if element["kind"] == "play":
        require(number(element["gap"]) > 0, "a play without a gap")
        return Fraction(0), Fraction(1)
    if element["kind"] in ("cube", "drag"):
        require(number(element["scale"]) > 0, "an element outside of all sectors")
        return Fraction(0), None
    name = element["kind"].replace("_", " ")
    require(element["kind"] in ("odd_pieces", "pieces"), f"the element {name} is not covered")
    halves = [element] if element["kind"] == "odd_pieces" else [element["positive"], element["negative"]]
    rows = [row for half in halves for row in half["bends"] + half["jumps"]]
    size = sum(map(len, sum(rows, [])))
    require(len(rows) <= PLACES and size <= TEXT, f"an element of more than {PLACES} bends, or {TEXT} characters")
    least, most = zip(*map(ratios, halves), strict=True)
    return None if None in least else min(least), None if None in most else max(most)


def claimed_sector(claim, own):
    """The sector that is claimed, in which that of the element lies; of any memoryless element there is none."""
    require(len(claim) == 2, "a sector without two ends")
    (low, high), (least, most) = [None if edge is None else number(edge) for edge in claim], own
    if low is None:
        require(high is None, "a sector that is open below")
    else:
        holds = least is not None and low <= least and (high is None or (most is not None and most <= high > low))
        require(holds, f"it claims the sector {claim}, in which the element does not lie")
    return low, high


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


def turned(p, n):
    """``(1 - s)**n p((1 + s)/(1 - s))``, by which the unit circle becomes the imaginary axis, and 1 its zero."""
    out: list = []
    below = [Fraction(1)]
    for c in reversed([*p, *[Fraction(0)] * (n + 1 - len(p))]):
        out, below = added(times(out, [Fraction(1)] * 2), below, c), times(below, [Fraction(1), Fraction(-1)])
    return out


def dead_times(loop):
    """The least and the greatest dead time; None where the linear part is rational: without any, and of samples."""
    listed = isinstance(loop["delay"], list)
    low, high = [*map(number, loop["delay"])] if listed else [number(loop["delay"])] * 2
    require(0 <= low <= high, "dead times that are negative, or not from low to high")
    require(not listed or (loop["time_step"] is None and low < high), "a range of dead times that is none")
    return None if high == 0 or loop["time_step"] is not None else (low, high)


def require_small(rows, count):
    """Refuse polynomials of so many corners with which the criterion would take more than seconds."""
    size = max(sum(len(str(c)) for c in row) for row in rows)
    require(size <= SIZE, f"a polynomial of more than {SIZE} characters")
    require(size * count <= CORNERS, f"polynomials of {count} corners with more than {CORNERS // count} characters")


def linear_parts(loop):
    """Numerators and denominators at the corners, in ascending powers of s, and the least degree of the criterion.

    Of samples ``s = (z - 1)/(z + 1)``: at half of their frequency, which is infinite, the criterion must hold, too.
    """
    require_small([*loop["num"], *loop["den"]], len(loop["num"]))
    nums, dens = ([trimmed([*map(number, row[::-1])]) for row in loop[name]] for name in ("num", "den"))
    dead_times(loop)
    if loop["time_step"] is not None:
        step, late = number(loop["time_step"]), number(loop["delay"])
        require(step > 0 and late <= ORDER * step, "a dead time that is too long")
        require((late / step).denominator == 1, "a dead time that is no whole number of samples")
        dens = [[*[Fraction(0)] * int(late / step), *den] for den in dens]
    monic = all(0 < len(num) < len(den) == len(dens[0]) and den[-1] == 1 for num, den in zip(nums, dens, strict=True))
    require(monic, "a linear part that is zero, passes its input through, or is not monic")
    if loop["time_step"] is None:
        return [*zip(nums, dens, strict=True)], 0
    degree = len(dens[0]) - 1
    corners = [(turned(num, degree), turned(den, degree)) for num, den in zip(nums, dens, strict=True)]
    require_small([row for corner in corners for row in corner], len(corners))
    return corners, degree


def on_axis(p):
    """Polynomials a, b in ``u = omega**2`` with ``p(j omega) = a + j omega b``."""
    return [c * (-1) ** i for i, c in enumerate(p[::2])], [c * (-1) ** i for i, c in enumerate(p[1::2])]


def criterion(num, den, low, high, multiplier):
    """Polynomials a, b, c in omega squared, with ``phi = omega * dead time``: ``a + b cos(phi) + c omega sin(phi)`` is
    ``Re((1 + j omega r) N conj(D)) + |D|^2/(high - low)``, N = num exp(-j phi), D = den + low N.

    Without a sector (no `low`) it is ``Re(j omega r N conj(den))``.
    """
    (a, b), (c, d), u = on_axis(num), on_axis(den), [Fraction(0), Fraction(1)]
    real, turn = added(times(a, c), times(u, times(b, d))), added(times(b, c), times(a, d), Fraction(-1))
    below, room = low or Fraction(0), Fraction(0) if high is None else 1 / (high - low)
    size, driven = added(times(c, c), times(u, times(d, d))), added(times(a, a), times(u, times(b, b)))
    still = added(times([room], size), driven, below + room * below**2)
    share = (low is not None) + 2 * room * below
    cosine = added(times([share], real), times(u, turn), -multiplier)
    return still, cosine, added(times([share], turn), real, multiplier)


def coefficients(corners, edges, multiplier, late):
    """The Bernstein coefficients of the criterion over a box, of degree 2 along each side, from products of corners:
    polynomials in omega squared, three of each with dead time. Bit i of a place says at which end of side i it is.
    """
    low, high = edges

    def parts(num, den):
        still, cosine, sine = criterion(num, den, low, high, multiplier)
        return (still, cosine, sine) if late else (added(still, cosine),)

    alone = [parts(*corner) for corner in corners]
    found: dict = {}
    for a, (num, den) in enumerate(corners):
        for b, (other, below) in enumerate(corners):
            place = tuple((a >> i & 1) + (b >> i & 1) for i in range(3))
            for k, both in enumerate(parts(added(num, other), added(den, below))):
                product = added(added(both, alone[a][k], Fraction(-1)), alone[b][k], Fraction(-1))
                found.setdefault((place, k), []).append(product)
    means: list = [[] for _ in found]
    for i, (_, products) in enumerate(sorted(found.items())):
        for product in products:
            means[i] = added(means[i], product, Fraction(1, 2 * len(products)))
    return means


def holds(polynomials, degree, late):
    """Whether the criterion is positive at all frequencies, as its coefficients over a box say."""
    if not late:
        return all(positive(p) and len(p) > degree for p in polynomials)
    return all(positive_behind(*late, *polynomials[i : i + 3]) for i in range(0, len(polynomials), 3))


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
    from flint import fmpq, fmpq_poly  # its finder is read where this is not installed

    first = fmpq_poly([fmpq(*c.as_integer_ratio()) for c in p])
    chain = [first, first.derivative()]
    while chain[-1]:
        rest = -(chain[-2] % chain[-1])
        chain.append(rest / abs(rest[rest.degree()]) if rest else rest)
    chain.pop()
    return changes([q[0] for q in chain]) == changes([q[q.degree()] for q in chain])


def over(p, u):
    """A polynomial over a ball."""
    from flint import arb, fmpq

    out = arb(0)
    for c in reversed(p):
        out = out * u + fmpq(*c.as_integer_ratio())
    return out


def ball(low, high):
    """All numbers from low to high."""
    from flint import arb, fmpq

    return arb(fmpq(*low.as_integer_ratio())).union(arb(fmpq(*high.as_integer_ratio())))


def halves(box):
    """A box of frequencies and dead times cut in two, across the one that turns phi, or the powers of omega, more."""
    first, last, short, long = box
    omega, late = (first + last) / 2, (short + long) / 2
    if (long - short) * omega > (last - first) * (late + 1 / omega):
        return [(first, last, short, late), (first, last, late, long)]
    return [(first, omega, short, long), (omega, last, short, long)]


def enclosed(a, b, c, box):
    """``a + b cos(phi) + c sin(phi)/omega`` over a box of frequencies and dead times, phi their product."""

    def value(omega, late):
        phi, u = omega * late, omega * omega
        return over(a, u) + over(b, u) * phi.cos() + over(c, u) * late * phi.sinc()

    omega, late, u = ball(*box[:2]), ball(*box[2:]), ball(*box[:2]) ** 2
    whole = value(omega, late)
    if whole > 0 or not omega > 0:
        return whole
    # By the value in the middle and the slopes over the box: terms that cancel in each of these do not count apart.
    slopes = [over([i * x for i, x in enumerate(p)][1:], u) for p in (a, b, c)]
    phi, middle = omega * late, [ball(x, x) for x in (sum(box[:2]) / 2, sum(box[2:]) / 2)]
    cosine, bent = phi.cos(), late * phi.sinc()
    by_omega = 2 * omega * (slopes[0] + slopes[1] * cosine + slopes[2] * bent)
    by_omega += over(c, u) * (late * cosine - bent) / omega - over(b, u) * late * phi.sin()
    by_late = over(c, u) * cosine - over(b, u) * omega * phi.sin()
    return value(*middle) + by_omega * (omega - middle[0]) + by_late * (late - middle[1])


def positive_behind(low, high, still, cosine, sine):
    """Whether ``a + b cos(phi) + c omega sin(phi)`` is positive for all frequencies and dead times from low to high.

    Beyond all roots of a and of ``a^2 - b^2 - omega^2 c^2`` it is, whatever phi; before them boxes are looked at.
    """
    from flint import ctx

    sine = [Fraction(0), *sine] if sine else []
    swing = added(times(cosine, cosine), times(sine, sine[1:]))
    least = added(times(still, still), swing, Fraction(-1))
    if not (still and least and still[-1] > 0 and least[-1] > 0):
        return False
    end = Fraction(1)
    while any(end**2 < 1 + abs(c / p[-1]) for p in (still, least) for c in p):
        end *= 2
    # What vanishes at zero frequency in all of them, by an integrator's pole, vanishes at no other.
    powers = min(next((i for i, c in enumerate(p) if c), len(still)) for p in (still, cosine, sine))
    a, b, c = (p[powers:] for p in (still, cosine, sine))
    boxes = [(Fraction(0), end, low, high)]
    with ctx.workprec(BITS):
        for box in boxes:
            value, u = enclosed(a, b, c, box), ball(*box[:2]) ** 2
            if value < 0 or len(boxes) > BOXES:
                return False
            if not value > 0 and not (over(still, u) > 0 and over(least, u) > 0):
                boxes += halves(box)  # the widest are looked at first
    return True


def verify(document):
    """What a certificate proves: the sector and the multiplier with which the criterion holds."""
    loop_form = {"time_step": (str, type(None)), "num": [[(Fraction,)]], "den": [[(Fraction,)]], "delay": delay_form}
    loop, said, evidence = opened(document, {**FORM, "loop": {**loop_form, "element": element_form}})
    count = len(loop["num"])
    require(count == len(loop["den"]) and count in (1, 2, 4, 8), "linear parts that are no point, line or box")
    require(max(map(len, [*loop["num"], *loop["den"]])) <= ORDER, "a linear part of too high an order")
    require_small(evidence["polynomials"], 1)
    corners, degree = linear_parts(loop)
    sampled, play = loop["time_step"] is not None, loop["element"]["kind"] == "play"
    own, multiplier, late = sector(loop["element"]), number(evidence["multiplier"]), dead_times(loop)
    require(multiplier == 0 or not (sampled or play), "a multiplier, where there are samples or the element remembers")
    edges = claimed_sector(said["sector"], own)
    require(not play or edges == own, "a sector that is not that of play, from 0 to 1")
    if edges != (None, None) and not play:  # of any memoryless element constants do not matter
        lasts = [[p[0] if p else 0 for p in row] for row in zip(*corners, strict=True)]
        seen = any(min(row) > 0 or max(row) < 0 for row in lasts)
        require(seen, "an integrator that the element does not see")
    claim = {**said, "multiplier": evidence["multiplier"]}
    require(said == claim, f"it claims {said}, its evidence shows {claim}")
    found = coefficients(corners, edges, multiplier, late)
    for polynomial, given in zip(found, evidence["polynomials"], strict=True):
        require([*map(number, given)] == polynomial[::-1], "a polynomial that is not the loop's")
    require(holds(found, degree, late), "a polynomial that is not positive for all frequencies")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(read(sys.stdin.read(LENGTH + 1)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        why = str(error) if isinstance(error, Refused) else f"it cannot be read: {type(error).__name__}, {error}"
        print(json.dumps({"accepted": False, "why": why}))
        raise SystemExit(1) from None
