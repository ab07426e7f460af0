"""The checkers refuse every certificate whose numbers do not prove what it says, and compute in rationals alone."""

from __future__ import annotations

import ast
import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.methods.certificates.play import check_frequency, check_play, exact
from eppanalysis.methods.certificates.play.check_frequency import positive_beyond_zero
from eppanalysis.methods.certificates.play.exact import Refused, never_positive

THIRD = [0.2, 1.2, 1.0, 0.0]


@pytest.fixture(scope="module")
def proof() -> str:
    """That of the servo of third order near its onset."""
    pytest.importorskip("clarabel")
    loop = epp.LureSystem.from_tf(([2.07], THIRD), epp.Play(gap=1.0))
    return epp.certify_absence_with_play(loop).text


@pytest.fixture(scope="module")
def easy() -> str:
    """That of the same servo far from its onset, with few sectors: wrong numbers have room in it."""
    pytest.importorskip("clarabel")
    loop = epp.LureSystem.from_tf(([1.5], THIRD), epp.Play(gap=1.0))
    return epp.certify_absence_with_play(loop, sectors=4).text


@pytest.fixture(scope="module")
def with_zero() -> str:
    """That of a servo with a zero, whose signs at a turning point are proved by a barrier."""
    pytest.importorskip("clarabel")
    loop = epp.LureSystem.from_tf(([0.9, 3.0], THIRD), epp.Play(gap=1.0))
    return epp.certify_absence_with_play(loop, sectors=4).text


def refused(given: dict[str, object]) -> bool:
    try:
        check_play.check_play(json.dumps(given))
    except Refused:
        return True
    return False


def test_the_gain_that_is_proved_is_the_one_of_the_text(proof: str) -> None:
    assert "(207/20)/(1 6 5 0)" in check_play.check_play(proof)
    for gain in ("52/5", "11", "30"):
        assert refused({**json.loads(proof), "numerator": [gain]})
    for den in (["1", "6", "5", "1/1000"], ["1", "5", "5", "0"], ["1", "6", "4", "0"], ["2", "6", "5", "0"]):
        assert refused({**json.loads(proof), "denominator": den})


def test_every_single_number_that_is_changed_is_noticed(easy: str) -> None:
    """Forms are continuous by an equation, so that none of them may change alone; the others have their signs."""
    for k, form in enumerate(json.loads(easy)["moving"]):
        for i, row in enumerate(form):
            for j, value in enumerate(row):
                changed = json.loads(easy)
                changed["moving"][k][i][j] = str(Fraction(value) * Fraction("1.1") + (Fraction(value) == 0))
                assert refused(changed), (k, i, j)
    for field in ("moving_multipliers", "release_multipliers"):
        changed = json.loads(easy)
        first = changed[field][0]
        changed[field][0] = "-1" if isinstance(first, str) else ["-1", *first[1:]]
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
        {"numerator": ["-10"]},
        {"numerator": ["5", "10"]},
        {"numerator": ["1", "0", "10"]},
        {"numerator": []},
        {"moving": []},
        {"moving_multipliers": []},
        {"release_multipliers": []},
        {"rays": [["0", "1"], ["0", "-1"]]},
        {"stuck": [["1", "0"], ["0", "1"]]},
        {"format": "another"},
        {"stuck": None},
        {"stuck": "1/0"},
        {"decrease": "nan"},
        {"decrease": float("inf")},
    ],
)
def test_what_is_not_of_the_form_is_refused(easy: str, wrong: dict[str, object]) -> None:
    assert not refused(json.loads(easy))
    assert refused({**json.loads(easy), **wrong})


def test_signs_with_a_zero_are_checked_as_well(with_zero: str) -> None:
    assert not refused(json.loads(with_zero))
    without = json.loads(with_zero)
    del without["signs"]
    assert refused(without)
    for k, form in enumerate(json.loads(with_zero)["signs"]["forms"]):
        for i, row in enumerate(form):
            for j, value in enumerate(row):
                changed = json.loads(with_zero)
                changed["signs"]["forms"][k][i][j] = str(Fraction(value) * Fraction("1.1") + (Fraction(value) == 0))
                assert refused(changed), (k, i, j)
    for name, wrong in (("rate", "-50"), ("rate", "50"), ("multipliers", ["-1"] * 4), ("multipliers", ["1"] * 3)):
        changed = json.loads(with_zero)
        changed["signs"][name] = wrong
        assert refused(changed)
    for sign in (-1, 0):  # what is nowhere above zero holds no motion back
        changed = json.loads(with_zero)
        forms = changed["signs"]["forms"]
        changed["signs"]["forms"] = [[[str(sign * Fraction(x)) for x in row] for row in form] for form in forms]
        assert refused(changed)


@pytest.mark.parametrize("drop", [0, 3, -1])
def test_sectors_that_leave_a_gap_are_refused(easy: str, drop: int) -> None:
    changed = json.loads(easy)
    for field in ("rays", "moving", "moving_multipliers"):
        del changed[field][drop]
    assert refused(changed)
    turned = json.loads(easy)
    turned["rays"][1], turned["rays"][2] = turned["rays"][2], turned["rays"][1]
    assert refused(turned)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "1", "{}", '{"format": []}'])
def test_what_is_no_certificate_is_refused_in_a_sentence(text: str) -> None:
    for check in (check_play.check_play, check_frequency.check_frequency):
        with pytest.raises(Refused, match="certificate"):
            check(text)


def test_the_checkers_need_nothing_but_rationals_and_json() -> None:
    own = {module.__name__ for module in (check_play, exact)}
    for module in (check_play, check_frequency, exact):
        text = Path(module.__file__).read_text()
        names = {n.module for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom)}
        names |= {a.name for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Import) for a in n.names}
        assert names <= {"__future__", "json", "fractions", "typing", "collections.abc"} | own
        assert len(text.splitlines()) <= 150


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
    assert positive_beyond_zero([Fraction(int(c)) for c in p.coeffs]) == expected


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
        text = json.dumps({
            "format": check_frequency.FORMAT,
            "numerator": [str(Fraction(c * factor * gain) / Fraction(den[0])) for c in num],
            "denominator": [str(Fraction(c) / Fraction(den[0])) for c in den],
        })  # fmt: skip
        try:
            return bool(check_frequency.check_frequency(text))
        except Refused:
            return False

    assert proved(0.9999) and not proved(1.0001)


def test_poles_on_the_axis_are_no_proof() -> None:
    """A linear part that swings by itself does so within the gap."""
    text = json.dumps({"format": check_frequency.FORMAT, "numerator": ["1", "0"], "denominator": ["1", "1", "1", "1"]})
    with pytest.raises(Refused):
        check_frequency.check_frequency(text)
