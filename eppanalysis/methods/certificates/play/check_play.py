"""Checks a certificate that a loop with play has no periodic motion but rest, in rational arithmetic alone.

What is checked, and why it suffices, stands in docs/theory/absence_with_play.md; the numbers in brackets are its
inequalities. Nothing but this file, `exact` and the text has to be believed: no solver, no floating-point number.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from eppanalysis.methods.certificates.play.exact import (
    ONE,
    Matrix,
    Refused,
    Vector,
    never_positive,
    product,
    rate,
    rational,
    require,
    total,
)

FORMAT = "no periodic motion with play, by sectors, 1"


def contact_form(num: Vector, den: Vector, poles: Vector, unit: Fraction) -> tuple[Matrix, Vector]:
    """(C): dy/dt = A y + b dw/dt with y_1 the input's speed, y_k+1 = (d/dt + pole_k) y_k / unit where it sticks."""
    n = len(den) - 1
    require(n in (2, 3) and len(poles) == n - 1 and unit > 0 and len(num) <= 2, "the order and the zeros are few (C)")
    require(min(poles) >= 0, "the poles that make the contact coordinates are not negative (C)")
    quotient = den if n == 2 else [den[0], den[1] - poles[0], den[2] - poles[0] * (den[1] - poles[0])]
    require(n == 2 or den[3] == poles[0] * quotient[2], "the first pole is a pole of a linear part of third order (C)")
    _, one, two = quotient
    last = one - poles[-1]
    back = poles[-1] * last - two
    require(one > 0 and (two > 0 or (n == 2 and two == 0)), "the poles are stable, but for one at zero (C)")
    require(back >= 0, "the poles are real (C)")
    A = [[unit if j == i + 1 else Fraction(0) for j in range(n)] for i in range(n)]
    for k, pole in enumerate([*poles, last]):
        A[k][k] = -pole
    A[n - 1][n - 2] += back / unit
    lead = -num[0] if len(num) == 2 else Fraction(0)
    b = [Fraction(0)] * (n - 2) + [lead / unit ** (n - 2), (-num[-1] - lead * last) / unit ** (n - 1)]
    require(n == 2 or b[2] <= 0, "no zero of a linear part of third order is slower than its poles (C)")
    return A, b


def sectors_of(rays: Matrix, n: int) -> list[tuple[Vector, Vector]]:
    """(S): for each sector of the half plane y_1 >= 0 the two linear forms that are not negative in it."""
    require(rays[0] == [0, 1] and rays[-1] == [0, -1] and [1, 0] in rays, "the sectors cover the half plane (S)")
    require(all(ray[0] > 0 for ray in rays[1:-1]), "the borders of sectors lie in the half plane (S)")
    pairs = list(zip(rays, rays[1:], strict=False))
    require(all(a * d < b * c for (a, b), (c, d) in pairs), "the sectors follow one another (S)")
    none = [Fraction(0)] * (n - 2)
    return [([b, -a, *none], [-d, c, *none]) for (a, b), (c, d) in pairs]


def require_continuous(forms: list[Matrix], rays: Matrix) -> None:
    """(2): forms of neighbouring sectors have the same values on the border between them."""
    n = len(forms[0])
    third = [Fraction(int(i == 2)) for i in range(n)]
    for form, after, ray in zip(forms[:-1], forms[1:], rays, strict=True):
        step, border = total((ONE, after), (-ONE, form)), [ray + [Fraction(0)] * (n - 2), third]
        jumps = [sum(p[i] * step[i][j] * q[j] for i in range(n) for j in range(n)) for p in border for q in border]
        require(not any(jumps), "a function is continuous from sector to sector (2)")


def require_signs(F: Matrix, b: Vector, sectors: list[tuple[Vector, Vector]], rays: Matrix, given: Any) -> None:
    """(Z): with a zero, what is not positive where y_2 turns negative stays so, and y_3 <= 0 at the turning point."""
    G, factors, growth = (rational(given[name]) for name in ("forms", "multipliers", "rate"))
    require_forms(G, len(sectors), 3)
    require_continuous(G, rays)
    for form, (f, g), factor in zip(G, sectors, factors, strict=True):
        grows = total((ONE, rate(form, F)), (growth, form), (factor, product(f, g)))
        require(factor >= 0 and never_positive(grows), "the barrier of signs holds in motion (Z)")
    first, last, slope = G[0], G[-1], -b[1] / F[1][2]
    begins = first[2][2] == 0 <= first[0][2] and first[0][0] + 2 * first[0][2] * slope <= 0
    require(begins and last[2][2] == 0 <= last[1][1] and last[1][2] < 0, "the barrier begins and ends with signs (Z)")


def require_forms(forms: list[Matrix], count: int, n: int) -> None:
    """So many symmetric matrices of one size."""
    require(len(forms) == count and all(len(M) == n and all(len(r) == n for r in M) for M in forms), "forms fit")
    require(all(M[i][j] == M[j][i] for M in forms for i in range(n) for j in range(i)), "all forms are symmetric")


def sector_inequalities(num: Vector, den: Vector, given: dict[str, Any]) -> None:
    """The function falls while the play moves, and never rises: inequalities (1) to (5)."""
    fields = ("poles", "unit", "rays", "stuck", "moving", "moving_multipliers", "release_multipliers", "decrease")
    poles, unit, rays, Q, P, moving, release, decrease = (rational(given[name]) for name in fields)
    A, b = contact_form(num, den, poles, unit)
    n = len(A)
    F = [[x + (b[i] if j == 0 else 0) for j, x in enumerate(row)] for i, row in enumerate(A)]
    sectors, middle = sectors_of(rays, n), rays.index([1, 0])
    if n == 3 and b[1] < 0:
        require_signs(F, b, sectors[middle:], rays[middle + 1 : -1], given["signs"])
    require_forms(P, len(sectors), n)
    require_forms([Q], 1, n)
    require_continuous(P, rays[1:-1])
    require(min(moving + [x for row in release for x in row]) >= 0 < decrease, "no multiplier is negative")
    speed, third = ([Fraction(int(i == k)) for i in range(n)] for k in (0, 2))
    require(never_positive(rate(Q, A)), "the function does not rise while the play rests (1)")
    for form, (f, g), factor in zip(P, sectors, moving, strict=True):
        falls = total((ONE, rate(form, F)), (factor, product(f, g)), (decrease, product(speed, speed)))
        require(never_positive(falls), "the function falls while the play moves (3)")
    turn = total((ONE, Q), (-ONE, P[-1]))
    require(all(x <= 0 for row in turn[1:] for x in row[1:]), "the function does not rise at a turning point (4)")
    for form, (f, g), (both, one, two) in zip(P[:middle], sectors[:middle], release, strict=True):
        facts = total((both, product(f, g)), (one, product(f, third)), (two, product(g, third)))
        require(never_positive(total((ONE, form), (-ONE, Q), (ONE, facts))), "nor at a release (5)")


def statement(num: Vector, den: Vector) -> str:
    """What is proved of the loop."""
    numerator, denominator = (" ".join(map(str, p)) for p in (num, den))
    loop = f"u = -L(s) w + constant, w = play(u), with L = ({numerator})/({denominator}), highest power first,"
    return f"The loop {loop} has no periodic motion but rest, for any gap."


def checked(text: str, form: str, proof: Callable[[Vector, Vector, dict[str, Any]], None]) -> str:
    """The sentence that a text of this form proves; Refused, which is a ValueError, if it proves none."""
    try:
        given = json.loads(text)
        require(given["format"] == form, f"its format is not {form!r}")
        num, den = rational(given["numerator"]), rational(given["denominator"])
        require(0 < len(num) < len(den) and den[0] == 1, "the linear part is strictly proper, its denominator monic")
        proof(num, den, given)
    except (KeyError, TypeError, IndexError, ValueError, ArithmeticError, AttributeError) as error:
        raise error if isinstance(error, Refused) else Refused(f"The certificate cannot be read: {error!r}.") from error
    return statement(num, den)


def check_play(text: str) -> str:
    """The sentence that a certificate by sectors proves; Refused, which is a ValueError, if it proves none."""
    return checked(text, FORMAT, sector_inequalities)
