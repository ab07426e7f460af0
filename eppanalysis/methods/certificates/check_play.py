"""Checker of a certificate that loops with play have no periodic motion but rest, by a function quadratic in sectors.

A file speaks of one numerator of the linear part, or of all on the straight line between two. The checker runs alone,
``python -I check_play.py < certificate.json``, and computes with exact rationals throughout. Theory:
docs/theory/proofs.md; the numbers in brackets are its inequalities.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the folder of this file: a file there is no module of the standard library, whatever its name

import json
from fractions import Fraction

STATEMENT = "no periodic motion but rest, for any gap of the play"
ONE = Fraction(1)
#: Most characters of a file, and of a number in it.
LENGTH, DIGITS = 2_000_000, 1000
ROWS = [[(Fraction,)]]
EVIDENCE = {"poles": [(Fraction,)], "unit": (Fraction,), "rays": [[(Fraction,), (Fraction,)]], "stuck": [ROWS]}
EVIDENCE |= {"moving": [[ROWS]], "moving_multipliers": ROWS, "decrease": (Fraction,), "release_multipliers": [ROWS]}
SIGNS = {"forms": [[ROWS]], "multipliers": ROWS, "rate": (Fraction,)}
#: By the number of ends of a range: which flow and which form make up each Bernstein coefficient of their product.
MIXED = {1: [[(0, 0)]], 2: [[(0, 0)], [(0, 1), (1, 0)], [(1, 1)]]}
LOOP = {"time_step": (str, type(None)), "num": ROWS, "den": ROWS, "delay": (Fraction,)}
FORM = {
    "loop": {**LOOP, "element": {"kind": (str,), "gap": (Fraction,)}},
    "claim": {"sectors": (int,)},
    "evidence": lambda part: {**EVIDENCE, **({"signs": SIGNS} if type(part) is dict and "signs" in part else {})},
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


def rational(value):
    """Numbers as they are written, in nested lists."""
    return [rational(item) for item in value] if isinstance(value, list) else number(value)


def product(a, b):
    """Matrix of the quadratic form (a.y)(b.y)."""
    return [[(p * s + q * r) / 2 for s, q in zip(b, a, strict=True)] for p, r in zip(a, b, strict=True)]


def total(*terms):
    """Sum of matrices with factors."""
    rows = range(len(terms[0][1]))
    return [[sum((c * M[i][j] for c, M in terms), Fraction(0)) for j in rows] for i in rows]


def rate(P, A):
    """A'P + PA, by which y'Py changes along dy/dt = A y."""
    n = range(len(A))
    return [[sum((A[k][i] * P[k][j] + P[i][k] * A[k][j] for k in n), Fraction(0)) for j in n] for i in n]


def never_positive(matrix):
    """Whether the symmetric matrix is negative semidefinite, by elimination without rounding."""
    M = [[-x for x in row] for row in matrix]
    n = len(M)
    for k in range(n):
        if M[k][k] < 0 or (M[k][k] == 0 and any(M[k][k + 1 :])):
            return False
        for i in range(k + 1, n):
            factor = M[i][k] / M[k][k] if M[k][k] else Fraction(0)
            M[i] = [x - factor * y for x, y in zip(M[i], M[k], strict=True)]
    return True


def contact_form(num, den, poles, unit):
    """(C): dy/dt = A y + b dw/dt with y_1 the input's speed, y_k+1 = (d/dt + pole_k) y_k / unit where it sticks."""
    n = len(den) - 1
    require(n in (2, 3) and len(poles) == n - 1 and unit > 0 and len(num) <= 2, "an order or zeros too many (C)")
    require(min(poles) >= 0, "negative poles that make the contact coordinates (C)")
    quotient = den if n == 2 else [den[0], den[1] - poles[0], den[2] - poles[0] * (den[1] - poles[0])]
    require(n == 2 or den[3] == poles[0] * quotient[2], "a first pole that is none of the linear part (C)")
    _, one, two = quotient
    last = one - poles[-1]
    back = poles[-1] * last - two
    require(one > 0 and (two > 0 or (n == 2 and two == 0)), "poles that are not stable, but for one at zero (C)")
    require(back >= 0, "poles that are not real (C)")
    A = [[unit if j == i + 1 else Fraction(0) for j in range(n)] for i in range(n)]
    for k, pole in enumerate([*poles, last]):
        A[k][k] = -pole
    A[n - 1][n - 2] += back / unit
    lead = -num[0] if len(num) == 2 else Fraction(0)
    b = [Fraction(0)] * (n - 2) + [lead / unit ** (n - 2), (-num[-1] - lead * last) / unit ** (n - 1)]
    require(n == 2 or b[2] <= 0, "a zero of a linear part of third order that is slower than its poles (C)")
    return A, b


def sectors_of(rays, n):
    """(S): for each sector of the half plane y_1 >= 0 the two linear forms that are not negative in it."""
    require(rays[0] == [0, 1] and rays[-1] == [0, -1] and [1, 0] in rays, "sectors that leave the half plane open (S)")
    require(all(ray[0] > 0 for ray in rays[1:-1]), "borders of sectors that leave the half plane (S)")
    pairs = list(zip(rays, rays[1:], strict=False))
    require(all(a * d < b * c for (a, b), (c, d) in pairs), "sectors that do not follow one another (S)")
    none = [Fraction(0)] * (n - 2)
    return [([b, -a, *none], [-d, c, *none]) for (a, b), (c, d) in pairs]


def require_forms(forms, borders, n):
    """(2): symmetric matrices of one size, of which neighbours have the same values on the border between them."""
    require(len(forms) == 1 + len(borders) and all(len(M) == n == len(r) for M in forms for r in M), "forms amiss")
    require(all(M[i][j] == M[j][i] for M in forms for i in range(n) for j in range(i)), "a form that is not symmetric")
    third = [Fraction(int(i == 2)) for i in range(n)]
    for form, after, ray in zip(forms[:-1], forms[1:], borders, strict=True):
        step, border = total((ONE, after), (-ONE, form)), [ray + [Fraction(0)] * (n - 2), third]
        jumps = [sum(p[i] * step[i][j] * q[j] for i in range(n) for j in range(n)) for p in border for q in border]
        require(not any(jumps), "a function that jumps from sector to sector (2)")


def require_falling(flows, ends, sectors, multipliers, growth, decrease):
    """(3), (Z): exp(growth t) y'Gy falls while the play moves, by what is claimed; of a range: for all within (R)."""
    speed = [ONE] + [Fraction(0)] * (len(flows[0]) - 1)
    for pairs, factors in zip(MIXED[len(flows)], multipliers, strict=True):
        for k, ((f, g), factor) in enumerate(zip(sectors, factors, strict=True)):
            terms = [term for i, j in pairs for term in ((ONE, rate(ends[j][k], flows[i])), (growth, ends[j][k]))]
            mean = [(share / len(pairs), form) for share, form in terms]
            change = total(*mean, (factor, product(f, g)), (decrease, product(speed, speed)))
            require(factor >= 0 and never_positive(change), "a function that does not fall while the play moves (3, Z)")


def require_signs(flows, slopes, sectors, borders, given):
    """(Z): not positive where y_2 turns negative, and at the turning point so for y_3 <= 0 alone."""
    ends, factors, growth = (rational(given[name]) for name in SIGNS)
    for forms in ends:
        require_forms(forms, borders, 3)
        first, last = forms[0], forms[-1]
        signs = first[2][2] == 0 <= first[0][2] and last[2][2] == 0 <= last[1][1] and last[1][2] < 0
        require(signs, "a barrier without its signs (Z)")
    for pairs in MIXED[len(flows)]:
        begins = sum(ends[j][0][0][0] + 2 * ends[j][0][0][2] * slopes[i] for i, j in pairs) <= 0
        require(begins, "a barrier that is positive where y_2 turns negative (Z)")
    require_falling(flows, ends, sectors, factors, growth, Fraction(0))


def falls(nums, den, given):
    """The function falls while the play moves and never rises: (1) to (5), of a range (R); returns how many sectors."""
    poles, unit, rays, stuck, moving, factors, decrease, releases = (rational(given[name]) for name in EVIDENCE)
    contacts, n = [contact_form(num, den, poles, unit) for num in nums], len(den) - 1
    A, slopes, third = contacts[0][0], [-b[1] / unit for _, b in contacts], [Fraction(int(i == 2)) for i in range(n)]
    flows = [[[x + (b[i] if j == 0 else 0) for j, x in enumerate(row)] for i, row in enumerate(A)] for _, b in contacts]
    sectors, middle = sectors_of(rays, n), rays.index([1, 0])
    for Q, P, release in zip(stuck, moving, releases, strict=True):
        require_forms([Q], [], n)
        require_forms(P, rays[1:-1], n)
        require(never_positive(rate(Q, A)), "a function that rises while the play rests (1)")
        turn = total((ONE, Q), (-ONE, P[-1]))
        require(all(x <= 0 for row in turn[1:] for x in row[1:]), "a function that rises at a turning point (4)")
        for form, (f, g), (both, one, two) in zip(P[:middle], sectors[:middle], release, strict=True):
            facts = total((both, product(f, g)), (one, product(f, third)), (two, product(g, third)))
            holds = min(both, one, two) >= 0 and never_positive(total((ONE, form), (-ONE, Q), (ONE, facts)))
            require(holds, "a function that rises at a release (5)")
    require(decrease > 0, "a function that need not fall (3)")
    require_falling(flows, moving, sectors, factors, Fraction(0), decrease)
    require(("signs" in given) == (n == 3 and max(slopes) > 0), "a barrier of signs that is missing or not needed (Z)")
    if "signs" in given:
        require_signs(flows, slopes, sectors[middle:], rays[middle + 1 : -1], given["signs"])
    return len(sectors)


def verify(document):
    """What a certificate proves: of how many sectors the function is that falls along every motion."""
    loop, said, evidence = opened(document, FORM)
    require(rational(loop["delay"]) == 0 and loop["time_step"] is None, "dead time or discrete time is not covered")
    require(loop["element"]["kind"] == "play" and rational(loop["element"]["gap"]) > 0, "an element without a gap")
    nums, (den, *others) = rational(loop["num"]), rational(loop["den"])
    require(0 < len(nums) <= 2 and nums[1:] != nums[:1], "numerators that are neither one nor two ends of a range")
    require([den, *others] == [den] * len(nums), "denominators that differ")
    require(den[0] == 1 and all(0 < len(num) < len(den) for num in nums), "a linear part not strictly proper and monic")
    claim = {"sectors": falls(nums, den, evidence)}
    require(said == claim, f"it claims {said}, its evidence shows {claim}")
    return claim


if __name__ == "__main__":
    try:
        print(json.dumps({"accepted": True, "claim": verify(read(sys.stdin.read(LENGTH + 1)))}))
    except (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        why = str(error) if isinstance(error, Refused) else f"it cannot be read: {type(error).__name__}, {error}"
        print(json.dumps({"accepted": False, "why": why}))
        raise SystemExit(1) from None
