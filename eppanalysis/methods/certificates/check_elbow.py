"""Checker, alone, of a certificate that a motor-driven arm with a gap, friction and a cable has no periodic motion.

Run it: ``python -I check_elbow.py < certificate.json``. Polynomials are exact rationals, means of impulse responses are
balls (python-flint, Arb). Theory: docs/theory/proofs.md, whose letters are used.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

from flint import acb, acb_poly, arb, ctx, fmpq

ctx.prec = 128
STATEMENT = "no periodic motion but rest, for any gap up to the one stated"
#: Cells in which an impulse response is looked at, and decades of its slowest part over which.
CELLS, FADED = 2000, 30
NAMES = [
    "inertia",
    "viscous",
    "contact_stiffness",
    "contact_damping",
    "backlash",
    "friction",
    "lag",
    "delay",
    "back_emf",
]
NAMES += ["torque", "cable_stiffness", "radius", "slack", "low", "high", "max"]
#: Most characters of a file, and of a number in it.
LENGTH, DIGITS = 100_000, 100
FORM = {
    "loop": {name: (Fraction,) for name in NAMES},
    "claim": {"backlash": (Fraction,)},
    "evidence": {"mu": (Fraction,), "sigma": (Fraction,), "n": [(Fraction,)], "d": [(Fraction,)]},
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


def ball(x):
    """A rational as a ball."""
    return arb(fmpq(x.numerator, x.denominator))


def trimmed(p):
    """A polynomial, coefficients in ascending powers, without leading zeros."""
    while p and p[-1] == 0:
        p = p[:-1]
    return p


def added(*polynomials):
    """The sum of polynomials."""
    n = max(map(len, polynomials))
    return trimmed(
        [sum(column) for column in zip(*([*p, *[Fraction(0)] * (n - len(p))] for p in polynomials), strict=True)]
    )


def times(p, *others):
    """The product of polynomials, and of numbers."""
    for q in others:
        q = q if isinstance(q, list) else [q]
        out = [Fraction(0)] * max(len(p) + len(q) - 1, 0)
        for i, a in enumerate(p):
            for j, b in enumerate(q):
                out[i + j] += a * b
        p = trimmed(out)
    return p


def size(p):
    """``|p(j omega)|^2`` as a polynomial in ``u = omega**2``."""
    even, odd = ([c * (-1) ** i for i, c in enumerate(p[k::2])] for k in (0, 1))
    return added(times(even, even), times([Fraction(0), Fraction(1)], odd, odd))


def turned(p):
    """``p(-s)``."""
    return [c * (-1) ** i for i, c in enumerate(p)]


def over_s(p):
    """``p/s``."""
    require(not p or p[0] == 0, "a shape that does not begin at one")
    return p[1:]


def changes(signs):
    """How often the sign changes, zeros left out."""
    signs = [s for s in signs if s]
    return sum((s > 0) != (t > 0) for s, t in zip(signs, signs[1:], strict=False))


def positive(p):
    """Whether a polynomial is positive at zero and for all positive numbers, by Sturm's count of its roots."""
    if not p or p[0] <= 0 or p[-1] <= 0:
        return False
    chain = [p, [i * c for i, c in enumerate(p)][1:]]
    while trimmed(chain[-1]):
        rest = chain[-2]
        while len(rest) >= len(chain[-1]):
            shifted = [Fraction(0)] * (len(rest) - len(chain[-1])) + chain[-1]
            rest = added(rest, times(shifted, -rest[-1] / chain[-1][-1]))
        chain.append([-c / abs(rest[-1]) for c in rest])
    chain.pop()
    return changes([q[0] for q in chain]) == changes([q[-1] for q in chain])


def mean_size(num, den):
    """Upper bound of the integral of the size of the impulse response, to both sides of zero, of ``num/den``."""
    require(len(num) <= len(den) and len(den) > 1, "a filter that differentiates")
    through = num[-1] / den[-1] if len(num) == len(den) else Fraction(0)
    rest, total = added(num, times(den, -through)), abs(ball(through))
    top, below = (acb_poly([acb(ball(c)) for c in p]) for p in (rest, den))
    parts = [(p, top(p) / below.derivative()(p)) for p in below.roots()]
    require(all(p.real > 0 or p.real < 0 for p, _ in parts), "a pole on the axis")
    for side in (1, -1):
        total += one_side([(side * p, r) for p, r in parts if side * p.real < 0])
    return total


def one_side(parts):
    """Upper bound of the integral of ``|sum r exp(p t)|`` over t > 0."""
    if not parts:
        return arb(0)
    step = FADED / min(abs(p.real) for p, _ in parts).mid() / CELLS
    at = [sum(((r / p * (p * (step * k)).exp()).real for p, r in parts), arb(0)) for k in range(CELLS + 1)]
    total = sum((abs(r) * (p.real * (step * CELLS)).exp() / -p.real for p, r in parts), arb(0))
    for k in range(CELLS):
        t = (step * k).union(step * (k + 1))
        value = sum(((r * (p * t).exp()).real for p, r in parts), arb(0))
        total += abs(at[k + 1] - at[k]) if value > 0 or value < 0 else step * value.abs_upper()
    return total


def slope_and_pull(v):
    """Steepest torque over the forearm's angle, and how far the cable presses the contact in below full drive."""
    steepest = v["torque"] / min(v["max"] - v["high"], v["low"] - v["slack"]) * v["cable_stiffness"] * v["radius"]
    return steepest, v["radius"] * v["max"] / v["contact_stiffness"]


def share(v, evidence):
    """``4 mu/kappa`` less the sum of the sizes, times its denominator, as a polynomial in omega squared."""
    J, B, k, c, tau, T = (v[name] for name in NAMES[:4] + ["lag", "delay"])
    n, d, (mu, sigma) = evidence["n"], evidence["d"], (evidence["mu"], evidence["sigma"])
    require(len(n) <= 3 and len(d) == 5 and d[-1] != 0 and n[0] == d[0] == 1, "a shape of another order")
    require(mu > 0 and 0 < sigma < 1, "weights that are none")
    one, s = [Fraction(1)], [Fraction(0), Fraction(1)]
    late, lag, mass = [Fraction(12), 6 * T, T * T], [Fraction(1), tau], [B, J]
    early = times(turned(lag), turned(late))
    full, delta = times(d, k), [k, c + B, J]
    ahead = over_s(added(late, times(early, Fraction(-1))))
    first = added(times(full, lag, added(ahead, times(late, mu))), times(mass, lag, n, early))
    second = over_s(added(full, times(delta, n, Fraction(-1))))
    third = added(times(mass, s, n), times(full, Fraction(-1)))
    fourth = added(second, times(mass, n), times(d, c))
    press = v["cable_stiffness"] * v["radius"] ** 2 / k
    costs = (1 - sigma) * c / 2, Fraction(3, 4) * sigma * k * k / c, B / press**2
    others = added(*(times(size(p), 1 / cost) for p, cost in zip((second, third, fourth), costs, strict=True)))
    whole = added(times(size(first), 1 / v["back_emf"]), times(others, size(early)))
    bound = 4 * mu / slope_and_pull(v)[0]
    return added(times(size(full), size(early), bound), times(whole, times(one, Fraction(-1)))), third, full, late, lag


def verify(document):
    """What a certificate proves: the gap up to which the loop has no periodic motion but rest."""
    loop, claim, evidence = opened(document, FORM)
    v = {name: number(loop[name]) for name in NAMES}
    require(all(v[name] > 0 for name in NAMES if name not in ("backlash", "slack")), "a number that is not positive")
    require(v["backlash"] >= 0 and 0 <= v["slack"] < v["low"] <= v["high"] < v["max"], "a gap or bands that are none")
    weights = {name: number(evidence[name]) for name in ("mu", "sigma")}
    shape = {name: [*map(number, evidence[name])] for name in ("n", "d")}
    polynomial, third, full, late, lag = share(v, weights | shape)
    require(positive(polynomial), "sizes whose sum is too large at some frequency")
    kappa, pull = slope_and_pull(v)
    reach = mean_size(third, full) * ball(v["backlash"] / 2) + ball(pull / 2)
    need = ball(kappa) * mean_size(turned(late), times(lag, late)) * reach
    require(need < ball(v["friction"]), "a gap across which the drive's friction is too small")
    require(claim["backlash"] == loop["backlash"], "a claim of another gap")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(read(sys.stdin.read(LENGTH + 1)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        why = str(error) if isinstance(error, Refused) else f"it cannot be read: {type(error).__name__}, {error}"
        print(json.dumps({"accepted": False, "why": why}))
        raise SystemExit(1) from None
