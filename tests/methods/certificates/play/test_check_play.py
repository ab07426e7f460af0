"""The checkers refuse every certificate of play whose numbers do not prove what it says."""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.methods.certificates import check_absence, check_play
from eppanalysis.methods.certificates.check_absence import added, criterion, positive
from eppanalysis.methods.certificates.check_play import Refused, never_positive
from eppanalysis.methods.certificates.registry import sealed

Document = dict[str, Any]
#: What the program of a checker turns into a refusal.
UNREADABLE = (Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError)
THIRD = [0.2, 1.2, 1.0, 0.0]


@pytest.fixture(scope="module")
def proof() -> Document:
    """That of the servo of third order near its onset."""
    pytest.importorskip("clarabel")
    loop = epp.LureSystem.from_tf(([2.07], THIRD), epp.Play(gap=1.0))
    return epp.certify(loop, "absence").document


@pytest.fixture(scope="module")
def easy() -> Document:
    """That of a range of the same servo far from its onset, with few sectors: wrong numbers have room in it."""
    return of_range([1.0], 1.2, 1.5)


@pytest.fixture(scope="module")
def with_zero() -> Document:
    """That of a range of a servo with a zero, whose signs at a turning point are proved by a barrier."""
    return of_range([0.3, 1.0], 2.5, 3.0)


def of_range(num: list[float], low: float, high: float) -> Document:
    pytest.importorskip("clarabel")
    servo = epp.Case.from_system(epp.LureSystem.from_tf((num, THIRD), epp.Play(gap=1.0)))
    return epp.certify(servo, "absence", within={"loop.gain": (low, high)}, sectors=4).document


def copy_of(document: Document) -> Any:
    return json.loads(json.dumps(document))


def refused(document: Document) -> bool:
    """Whether a certificate is refused, its digest made to fit."""
    try:
        check_play.verify(sealed(document))
    except UNREADABLE:
        return True
    return False


def of_loop(document: Document, **changed: object) -> Document:
    return {**document, "loop": {**document["loop"], **changed}}


def test_the_gain_that_is_proved_is_the_one_of_the_file(proof: Document) -> None:
    assert proof["loop"]["num"] == [["207/20"]] and not refused(proof)
    for gain in ("52/5", "11", "30"):
        assert refused(of_loop(proof, num=[[gain]]))
    for den in (["1", "6", "5", "1/1000"], ["1", "5", "5", "0"], ["1", "6", "4", "0"], ["2", "6", "5", "0"]):
        assert refused(of_loop(proof, den=[den]))
    assert refused(of_loop(proof, delay="1/10")) and refused(of_loop(proof, time_step="1/10"))
    assert refused(of_loop(proof, element={"kind": "play", "gap": "0"}))
    assert refused(of_loop(proof, element={"kind": "jump_and_follow", "gap": "1"}))
    assert refused({**proof, "claim": {"sectors": 2}})
    with pytest.raises(Refused, match="changed"):
        check_play.verify({**proof, "digest": 1})


def test_every_single_number_that_is_changed_is_noticed(easy: Document) -> None:
    """Forms are continuous by an equation, so that none of them may change alone; the others have their signs."""
    moving = easy["evidence"]["moving"]
    assert len(moving) == 2
    for e, k, i, j in np.ndindex(2, len(moving[0]), 3, 3):
        changed, value = copy_of(easy), moving[e][k][i][j]
        changed["evidence"]["moving"][e][k][i][j] = str(Fraction(value) * Fraction("1.1") + (Fraction(value) == 0))
        assert refused(changed), (e, k, i, j)
    for field in ("moving_multipliers", "release_multipliers"):
        changed = copy_of(easy)
        row = changed["evidence"][field][1]
        row[0] = "-1" if field == "moving_multipliers" else ["-1", *row[0][1:]]
        assert refused(changed)


@pytest.mark.parametrize(
    "wrong",
    [
        {"decrease": "0"},
        {"decrease": "-1/1000"},
        {"unit": "0"},
        {"unit": "-1"},
        {"poles": ["1", "1"]},
        {"poles": ["0", "1/2"]},
        {"poles": ["0", "-1"]},
        {"poles": ["0"]},
        {"num": [["6"], ["-10"]]},
        {"num": [["6"], ["5", "10"]]},
        {"num": [["6"], ["1", "0", "10"]]},
        {"num": [["15/2"]] * 2},
        {"num": [["6"], ["7"], ["15/2"]]},
        {"num": [["15/2"]]},
        {"num": [[], ["15/2"]]},
        {"num": []},
        {"den": [["1", "6", "5", "0"]]},
        {"den": [["1", "6", "5", "0"], ["1", "6", "51/10", "0"]]},
        {"num": ["6", "15/2"]},
        {"moving": []},
        {"moving_multipliers": []},
        {"release_multipliers": []},
        {"rays": [["0", "1"], ["0", "-1"]]},
        {"stuck": [[["1", "0"], ["0", "1"]]] * 2},
        {"statement": "another"},
        {"stuck": None},
        {"stuck": "1/0"},
        {"decrease": "nan"},
        {"decrease": float("inf")},
    ],
)
def test_what_is_not_of_the_form_is_refused(easy: Document, wrong: dict[str, object]) -> None:
    assert not refused(copy_of(easy))
    changed = copy_of(easy)
    place = (
        changed["loop"] if wrong.keys() & {"num", "den"} else changed if "statement" in wrong else changed["evidence"]
    )
    place.update(wrong)
    assert refused(changed)


def test_signs_with_a_zero_are_checked_as_well(with_zero: Document) -> None:
    assert not refused(copy_of(with_zero))
    without = copy_of(with_zero)
    del without["evidence"]["signs"]
    assert refused(without)
    forms = with_zero["evidence"]["signs"]["forms"]
    for e, k, i, j in np.ndindex(2, len(forms[0]), 3, 3):
        changed, value = copy_of(with_zero), forms[e][k][i][j]
        other = str(Fraction(value) * Fraction("1.1") + (Fraction(value) == 0))
        changed["evidence"]["signs"]["forms"][e][k][i][j] = other
        assert refused(changed), (e, k, i, j)
    ones = [["1"] * 4] * 3
    for name, wrong in (
        ("rate", "-50"),
        ("rate", "50"),
        ("multipliers", [["-1"] * 4, *ones[1:]]),
        ("multipliers", ones[1:]),
    ):
        changed = copy_of(with_zero)
        changed["evidence"]["signs"][name] = wrong
        assert refused(changed)
    for sign in (-1, 0):  # what is nowhere above zero holds no motion back
        changed = copy_of(with_zero)
        signs = changed["evidence"]["signs"]
        signs["forms"] = [
            [[[str(sign * Fraction(x)) for x in row] for row in form] for form in end] for end in signs["forms"]
        ]
        assert refused(changed)


@pytest.mark.parametrize("drop", [0, 3, -1])
def test_sectors_that_leave_a_gap_are_refused(easy: Document, drop: int) -> None:
    changed = copy_of(easy)
    evidence = changed["evidence"]
    for rows in (evidence["rays"], *evidence["moving"], *evidence["moving_multipliers"]):
        del rows[drop]
    assert refused(changed)
    turned = copy_of(easy)
    rays = turned["evidence"]["rays"]
    rays[1], rays[2] = rays[2], rays[1]
    assert refused(turned)


def test_a_range_is_proved_between_its_ends_and_no_farther(easy: Document, with_zero: Document) -> None:
    """At each end alone it is a proof, too; ends farther apart, or a middle that does not fall, are none."""
    for document, beyond in ((easy, ["11"]), (with_zero, ["6", "20"])):
        low, high = document["loop"]["num"]
        assert not refused(of_loop(document, num=[low, high])) and refused(of_loop(document, num=[low, beyond]))
        single = copy_of(document)
        single["loop"].update(num=[high], den=document["loop"]["den"][:1])
        assert refused(single)
        for name in ("stuck", "moving", "release_multipliers", "moving_multipliers"):
            single["evidence"][name] = single["evidence"][name][-1:]
        if "signs" in single["evidence"]:
            for name in ("forms", "multipliers"):
                single["evidence"]["signs"][name] = single["evidence"]["signs"][name][-1:]
        assert not refused(single)
        between = copy_of(document)
        rows = between["evidence"]["moving_multipliers"]
        rows[1] = [str(Fraction(x) + 1000) for x in rows[1]]
        assert refused(between)


def mixed(shares: list[Fraction], parts: list[Any]) -> Any:
    """The sum of nested lists of numbers with shares."""
    if isinstance(parts[0], list):
        return [mixed(shares, list(inner)) for inner in zip(*parts, strict=True)]
    return str(sum((s * Fraction(x) for s, x in zip(shares, parts, strict=True)), Fraction(0)))


@pytest.mark.parametrize("t", [Fraction(1, 7), Fraction(1, 2), Fraction(19, 20)])
def test_every_gain_of_a_range_has_a_function_that_falls(easy: Document, with_zero: Document, t: Fraction) -> None:
    """What the file of a range says of a gain between its ends makes a file of that gain alone."""
    line, square = [1 - t, t], [(1 - t) ** 2, 2 * t * (1 - t), t**2]
    for document in (easy, with_zero):
        single, given = copy_of(document), document["evidence"]
        single["loop"].update(num=[mixed(line, document["loop"]["num"])], den=document["loop"]["den"][:1])
        for name in ("stuck", "moving", "release_multipliers"):
            single["evidence"][name] = [mixed(line, given[name])]
        single["evidence"]["moving_multipliers"] = [mixed(square, given["moving_multipliers"])]
        if "signs" in given:
            single["evidence"]["signs"]["forms"] = [mixed(line, given["signs"]["forms"])]
            single["evidence"]["signs"]["multipliers"] = [mixed(square, given["signs"]["multipliers"])]
        assert not refused(single)


small = st.integers(-3, 3)


@given(st.lists(small, min_size=9, max_size=9), st.integers(-1, 4))
def test_definite_forms_are_known_exactly(entries: list[int], lift: int) -> None:
    """Against eigenvalues; singular ones (a product of thin matrices) come up on purpose."""
    thin = np.array(entries[:6]).reshape(3, 2)
    whole = np.array(entries).reshape(3, 3)
    for matrix in (-thin @ thin.T, -thin @ thin.T + lift * np.eye(3, dtype=int) * (lift > 0), whole + whole.T):
        largest = np.linalg.eigvalsh(matrix.astype(float))[-1]
        exact = [[Fraction(int(x)) for x in row] for row in matrix]
        assert never_positive(exact) == (largest < 1e-9)


@given(st.lists(st.tuples(st.integers(-4, 4), st.integers(0, 3)), max_size=3), st.integers(-3, 3))
def test_positive_polynomials_are_known_exactly(factors: list[tuple[int, int]], lead: int) -> None:
    """Products of (x - r)^m: positive beyond zero if the leading one is and no r > 0."""
    p = np.poly1d([lead])
    for root, times in factors:
        p = p * np.poly1d([1, -root]) ** times
    expected = lead > 0 and not any(root > 0 and times for root, times in factors)
    assert positive([Fraction(int(c)) for c in p.coeffs[::-1]]) == expected


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ([1.0], THIRD),
        ([3.0, 1.0], [1.0, 2.0, 3.0, 4.0, 0.0]),
        ([20.0], [1.0, 6.0, 5.0]),
        ([2.0, 1.0], [1.0, 0.4, 2.0, 0.0]),
        ([1.0], [1.0, 3.0, 3.0, 1.0]),
    ],
)
def test_frequency_bound_turns_where_the_response_does(num: list[float], den: list[float]) -> None:
    s = 1j * np.logspace(-5, 4, 200001)
    gain = -1.0 / np.min((np.polyval(num, s) / np.polyval(den, s)).real)

    def proved(factor: float) -> bool:
        over, under = ([Fraction(c * by) for c in p[::-1]] for p, by in ((num, factor * gain), (den, 1.0)))
        return positive(added(*criterion(over, under, Fraction(0), Fraction(1), Fraction(0))[:2]))

    assert proved(0.9999) and not proved(1.0001)


def test_play_has_no_multiplier_but_zero() -> None:
    """Its output times the rate of its input has a mean: Popov's criterion would prove loops with cycles."""
    loop = epp.LureSystem.from_tf(([0.5], THIRD), epp.Play(gap=1.0))
    document = copy_of(epp.certify(loop, "absence").document)
    check_absence.verify(document)
    document["claim"]["multiplier"] = document["evidence"]["multiplier"] = "1/10"
    num, den = ([Fraction(c) for c in row[::-1]] for row in (document["loop"]["num"][0], document["loop"]["den"][0]))
    turned = added(*criterion(num, den, Fraction(0), Fraction(1), Fraction(1, 10))[:2])
    assert positive(turned)
    document["evidence"]["polynomials"] = [[str(c) for c in turned[::-1]]]
    with pytest.raises(check_absence.Refused, match="remembers"):
        check_absence.verify(sealed(document))
    document["loop"]["element"]["gap"] = "0"
    with pytest.raises(check_absence.Refused, match="without a gap"):
        check_absence.verify(sealed(document))


def test_poles_on_the_axis_are_no_proof() -> None:
    """A linear part that swings by itself does so within the gap."""
    loop = epp.LureSystem.from_tf(([1.0, 0.0], [1.0, 1.0, 1.0, 1.0]), epp.Play(gap=1.0))
    assert not epp.certify(loop, "absence").proved
    hidden = epp.LureSystem.from_tf(([1.0, 0.0, 4.0], np.polymul([1.0, 0.0, 4.0], [1.0, 1.0])), epp.Play(gap=1.0))
    assert not epp.certify(hidden, "absence").proved
