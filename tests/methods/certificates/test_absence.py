"""Absence that is proved: sharp where the criterion is, never where there is a cycle, from a file."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.methods.certificates import check_absence
from eppanalysis.methods.certificates.check_absence import (
    Refused,
    coefficients,
    criterion,
    holds,
    positive,
    sector,
    times,
)
from eppanalysis.methods.certificates.rational import element_data
from eppanalysis.methods.certificates.registry import sealed
from tests.shared import mostly_slow
from tests.stress.proofs import PROVABLE, proof

#: Third order without an integrator, and with one, each with the gain at which the linear loop oscillates.
TEXTBOOK = (([1.0, 2.0, 2.0, 1.0], 3.0), ([1.0, 3.0, 2.0, 0.0], 6.0))


def limited(gain: float, den: list[float], element: epp.Nonlinearity | None = None) -> epp.LureSystem:
    return epp.LureSystem.from_tf(([gain], den), element or epp.Saturation())


@pytest.mark.parametrize(("den", "border"), TEXTBOOK)
def test_the_criterion_is_sharp_for_textbook_loops(den: list[float], border: float) -> None:
    for share in (0.1, 0.5, 0.9, 0.999, 1.0 - 1e-6):
        begun = time.process_time()
        found = epp.certify(limited(share * border, den), "absence")
        assert found.proved and time.process_time() - begun < 2.0
    for share in (1.0, 1.0 + 1e-9, 1.001, 1.5, 10.0):
        found = epp.certify(limited(share * border, den), "absence")
        assert not found.proved and not found.document and found.message.startswith("Not decided")


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize(("den", "border"), TEXTBOOK)
def test_units_change_nothing(den: list[float], border: float, scale: float) -> None:
    powers = scale ** np.arange(3, -1, -1.0)
    for share in (0.999, 1.001):
        slow = epp.LureSystem.from_tf(([share * border], np.array(den) * powers), epp.Saturation(-3e-7, 3e-7))
        assert epp.certify(slow, "absence").proved == (share < 1.0)


@given(st.integers(0, 10**9))
@settings(max_examples=150, deadline=None)
def test_sturm_counts_as_the_roots_say(seed: int) -> None:
    """Polynomials of known roots: positive ones single or double, negative and complex ones, far and near."""
    rng = np.random.default_rng(seed)

    def some() -> Fraction:
        return Fraction(int(rng.integers(1, 50)), int(rng.integers(1, 50)))

    p = [some()]
    for _ in range(rng.integers(0, 4)):
        p = times(p, [some(), Fraction(1)])  # negative
    for _ in range(rng.integers(0, 3)):
        re, im = Fraction(int(rng.integers(-20, 20)), 7), some() / 1000
        p = times(p, [re * re + im * im, -2 * re, Fraction(1)])  # a complex pair, hardly off the axis
    has_root = bool(rng.integers(0, 2))
    if has_root:
        root = some()
        p = times(p, [-root, Fraction(1)])
        if rng.integers(0, 2):
            p = times(p, [-root, Fraction(1)])  # it touches zero
    assert positive([Fraction(0)] * int(rng.integers(0, 3)) + p) == (not has_root)
    assert not positive([-c for c in p]) and not positive([])


@given(st.integers(0, 10**9))
@settings(max_examples=60, deadline=None)
def test_the_polynomial_is_the_criterion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    num, den = ([Fraction(int(c), 8) for c in rng.integers(-40, 40, n)] for n in (3, 5))
    low, width, rate = (Fraction(int(c), 8) for c in rng.integers(1, 40, 3))
    polynomials = criterion(num, den, low, low + width, rate)
    for omega, late in zip(np.exp(rng.normal(size=4)), (0.0, *np.exp(rng.normal(size=3))), strict=True):
        s = 1j * omega
        N, D = (np.polyval([float(c) for c in p[::-1]], s) for p in (num, den))
        size, N = abs(D) ** 2 + abs(N) ** 2, N * np.exp(-s * late)
        D = D + float(low) * N
        by_hand = ((1 + s * float(rate)) * N * np.conj(D)).real + abs(D) ** 2 / float(width)
        still, cosine, sine = (np.polyval([float(c) for c in p[::-1]], omega**2) for p in polynomials)
        value = still + cosine * np.cos(omega * late) + sine * omega * np.sin(omega * late)
        assert value == pytest.approx(by_hand, rel=1e-9, abs=1e-7 * size)


@given(st.integers(0, 10**9))
@settings(max_examples=12, deadline=None)
def test_behind_dead_time_it_is_positive_where_dense_frequencies_say_so(seed: int) -> None:
    """Margins from 1 % on, to both sides, whatever the unit of time; with an integrator, and damped poles."""
    rng = np.random.default_rng(seed)

    def some(n: int) -> list[Fraction]:
        return [Fraction(int(c), 8) for c in rng.integers(2, 40, n)]

    (pole, speed, damping), num = some(3), some(2)
    den = times([pole * int(rng.integers(2)), Fraction(1)], [speed**2, 2 * speed * min(damping, 1), Fraction(1)])
    rate, (first, late) = (
        Fraction(int(rng.integers(-8, 8)), 8),
        sorted(Fraction(int(c), 16) for c in rng.integers(1, 40, 2)),
    )
    omega, delays = np.linspace(1e-3, 40.0, 8000), np.linspace(float(first), float(late), 9)[:, None]
    s = 1j * omega
    G = (
        np.polyval([float(c) for c in num[::-1]], s)
        / np.polyval([float(c) for c in den[::-1]], s)
        * np.exp(-s * delays)
    )
    least = float(((1 + s * float(rate)) * G).real.min())
    if not -1e3 < least < -1e-3:
        return
    unit = Fraction(10) ** int(rng.integers(-4, 5))
    for share, is_positive in ((0.99, True), (1.01, False)):
        edges = Fraction(0), Fraction(-share / least).limit_denominator(10**6)
        rows = [[c * unit ** (len(row) - 1 - i) for i, c in enumerate(row)] for row in (num, den)]
        rows[0] = [c * unit ** (len(den) - len(num)) for c in rows[0]]
        found = coefficients([(rows[0], rows[1])], edges, rate / unit, True)
        assert holds(found, 0, (first / unit, late / unit)) == is_positive


@pytest.mark.parametrize(
    "element",
    [
        epp.Saturation(-0.5, 2.0, 1.5),
        epp.DeadZone(-0.4, 0.9, 2.0),
        epp.DeadZoneSaturation(dead_zone=0.5, slope=2.0, limit=1.0),
        epp.Relay(-1.0, 2.0),
        epp.RelayDeadZone(threshold=0.5, level=2.0),
        epp.Preload(level=0.5, slope=2.0),
        epp.Quantiser(step=0.5, levels=4),
        epp.BilinearSpring(lower=-0.5, upper=1.0, outer=3.0, inner=0.5),
        epp.PiecewiseLinear([-1.0, -0.5, 1.0], [0.0, 2.0, 0.5, -0.25], [-1.5, 0.5, -0.25, 0.5]),
        epp.Cube(2.0),
    ],
    ids=lambda e: type(e).__name__,
)
def test_sectors_are_those_of_the_elements(element: epp.Nonlinearity) -> None:
    """Against a dense sampling of the map itself, up to what samples beside a jump leave out."""
    try:
        data = element_data(element)
    except epp.EppError:
        pytest.fail("the element is covered")
    least, most = sector(data)
    x = np.concatenate([np.geomspace(1e-9, 1e9, 40_001), -np.geomspace(1e-9, 1e9, 40_001)])
    ratio = element.output(x)[0] / x
    if least is not None:
        assert ratio.min() >= float(least) - 1e-9 and ratio.min() == pytest.approx(float(least), abs=2e-3)
    assert most is None or ratio.max() <= float(most) + 1e-9
    assert ratio.max() > 1e8 if most is None else ratio.max() == pytest.approx(float(most), rel=2e-3)


def test_a_table_of_many_points_has_a_sector_of_short_numbers() -> None:
    """The exact edges of its sector are quotients of thousands of digits."""
    rng = np.random.default_rng(3)
    x = np.sort(rng.uniform(-3.0, 3.0, 301))
    x = x - x[150]
    y = np.where(x == 0.0, 0.0, np.tanh(x) * rng.uniform(0.8, 1.2, x.size))
    found = epp.certify(limited(0.005, [1.0, 3.0, 2.0], epp.LookupTable(x, y)), "absence")
    assert found.proved
    low, high = map(Fraction, found.document["claim"]["sector"])
    assert max(len(str(edge)) for edge in (low, high)) < 40
    least, most = sector(found.document["loop"]["element"])
    assert least is not None and most is not None and low <= least <= most <= high
    slopes = np.diff(y) / np.diff(x)
    ratios = np.array([*y[x != 0.0] / x[x != 0.0], slopes[0], slopes[-1]])  # its last lines go on
    assert float(low) == pytest.approx(ratios.min(), rel=1e-9) and float(high) == pytest.approx(ratios.max(), rel=1e-9)


@pytest.mark.parametrize(
    ("claimed", "why"),
    [
        (["0", "11/10"], ""),
        (["-1/10", "2"], ""),
        (["0", "9/10"], "does not lie"),
        (["1/10", "1"], "does not lie"),
        (["0"], "two ends"),
        (["0", "1", "1"], "two ends"),
        ([None, "1"], "open below"),
        (["2", "1"], "does not lie"),
    ],
)
def test_a_sector_may_be_wider_than_the_element_and_never_narrower(claimed: list[str | None], why: str) -> None:
    document = json.loads(json.dumps(epp.certify(limited(1.0, [1.0, 3.0, 3.0, 1.0]), "absence").document))
    assert document["claim"] == {"sector": ["0", "1"], "multiplier": "0"}
    low, high = (Fraction(edge or 0) for edge in (*claimed, "1")[:2])
    num, den = (list(map(Fraction, document["loop"][name][0][::-1])) for name in ("num", "den"))
    document["claim"]["sector"] = claimed
    (polynomial,) = coefficients([(num, den)], (low, high), Fraction(0), None)
    document["evidence"]["polynomials"] = [[str(c) for c in polynomial[::-1]]]
    if why:
        with pytest.raises(Refused, match=why):
            check_absence.verify(sealed(document))
    else:
        assert check_absence.verify(sealed(document))["sector"] == claimed


def test_an_element_that_misses_the_origin_is_not_covered() -> None:
    shifted = epp.PiecewiseLinear([0.5], [1.0, 2.0], [0.3, -0.2])
    found = epp.certify(limited(0.1, [1.0, 3.0, 3.0, 1.0], shifted), "absence")
    assert not found.proved and not found.document and "lies in no sector" in str(found)


def border_loops() -> list[tuple[list[float], float]]:
    """Loops of s^3 + a s^2 + b s + c, and the gain at which the linear loop has a pair of poles on the axis."""
    rng = np.random.default_rng(11)
    made = []
    for _ in range(60):
        a, b = rng.integers(1, 30, 2) / 4.0
        c = 0.0 if rng.random() < 0.3 else rng.integers(1, 30) / 8.0
        if a * b - c > 0:
            made.append(([1.0, a, b, c], a * b - c))
    return made


def test_no_loop_with_a_known_cycle_is_certified() -> None:
    """On the border a saturation's linear part holds a sine of any amplitude up to the limit: an exact cycle; beyond it
    there is none that is known, and no proof either. Just below it the criterion is as sharp as Hurwitz's."""
    loops = border_loops()
    assert len(loops) >= 50
    for den, border in loops:
        assert not epp.certify(limited(border, den), "absence").proved
        assert not epp.certify(limited(1.1 * border, den), "absence").proved
    sharp = [epp.certify(limited(0.999 * border, den), "absence").proved for den, border in loops]
    assert sum(sharp) == len(sharp)


def relay_cycle(A: np.ndarray, b: np.ndarray, c: np.ndarray) -> float | None:
    """Half a period of a symmetric cycle of a relay, x = -G y, by Tsypkin's exact condition; None without one."""
    eye = np.eye(len(A))

    def crossing(half: float) -> float:
        flow = scipy.linalg.expm(half * A)
        reached = np.linalg.solve(A, (flow - eye) @ b)
        state = np.linalg.solve(eye + flow, reached)  # at the end of a half period of y = 1, minus that at its begin
        return float(c @ state)

    halves = np.geomspace(0.05, 60.0, 150)
    values = [crossing(h) for h in halves]
    for i in range(len(halves) - 1):
        if values[i] * values[i + 1] < 0:
            return float(halves[i])
    return None


@pytest.mark.slow
def test_no_relay_with_an_exact_cycle_is_certified() -> None:
    """Random stable plants of third to fifth order, in which a relay oscillates by an exact half period."""
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(70):
        poles = -np.round(np.exp(rng.uniform(-1.0, 1.5, rng.integers(3, 6))), 3)
        den = np.poly(poles)
        n = len(den) - 1
        A, b = np.diag(np.ones(n - 1), -1), np.zeros(n)
        A[0], b[0] = -den[1:], 1.0
        c = np.zeros(n)
        c[-1] = 1.0
        if relay_cycle(A, b, c) is None:
            continue
        found += 1
        assert not epp.certify(epp.LureSystem.from_tf(([1.0], den), epp.Relay()), "absence").proved
    assert found >= 50


@pytest.mark.parametrize(
    "family", ["saturation", *(pytest.param(f, marks=pytest.mark.slow) for f in PROVABLE if f != "saturation")]
)
def test_no_random_loop_near_the_birth_of_an_exact_orbit_is_certified(family: str) -> None:
    """The sample of what ``python -m tests.stress --proofs`` does; far below that gain most are."""
    row = proof(family, 1001)
    assert row["outcome"] == "not proved" and row["residual"] < 1e-9
    assert row["covered"] and (row["far_below"] or family == "saturation, unstable pole")


def test_a_relay_that_cannot_oscillate_is_certified_for_all_gains() -> None:
    """Second order: Popov's multiplier turns the response by up to 90 degrees, which is all that is missing."""
    found = epp.certify(limited(50.0, [1.0, 1.0, 1.0], epp.Relay()), "absence")
    assert found.proved and found.document["claim"]["sector"] == ["0", None]


ANY = {
    "saturation": epp.Saturation(),
    "relay": epp.Relay(),
    "dead zone": epp.DeadZone(-0.4, 0.7, 2.0),
    "falls": epp.PiecewiseLinear([-1.0, 1.0], [1.0, -2.0, 1.0], [0.0, 0.0, 0.0]),
    "misses the origin": epp.PiecewiseLinear([0.5], [1.0, 2.0], [0.3, -0.2]),
}


@pytest.mark.parametrize("name", ANY)
def test_one_sign_of_the_imaginary_part_leaves_no_cycle_whatever_the_element(name: str) -> None:
    """A PD controller before a double integrator, of either sign: energy falls. No sector helps there."""
    for num in ([0.7, 1.0], [-0.7, 1.0]):
        found = epp.certify(epp.LureSystem.from_tf((num, [1.0, 0.0, 0.0]), ANY[name], name="pd"), "absence")
        assert found.proved and "whatever the element without memory; Re jωG(jω)" in str(found)
        assert found.document["claim"] == {"sector": [None, None], "multiplier": "1" if num[0] > 0 else "-1"}
        assert found.plot().get_lines()
    undamped = epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), ANY[name])
    lagged = epp.LureSystem.from_tf(([9.0], [1.0, 3.0, 3.0, 1.0]), ANY[name])
    assert not epp.certify(undamped, "absence").proved and not epp.certify(lagged, "absence").proved


def test_an_element_that_remembers_is_not_any_element() -> None:
    for element in (epp.Play(0.5), epp.HysteresisRelay(-0.1, 0.1), epp.JumpAndFollow(1.0, 0.5)):
        assert not epp.certify(epp.LureSystem.from_tf(([0.7, 1.0], [1.0, 0.0, 0.0]), element), "absence").proved
    document = epp.certify(epp.LureSystem.from_tf(([0.7, 1.0], [1.0, 0.0, 0.0]), epp.Saturation()), "absence").document
    remembers = {**document, "loop": {**document["loop"], "element": {"kind": "play", "gap": "1"}}}
    with pytest.raises(Refused, match="remembers"):
        check_absence.verify(sealed(remembers))


@pytest.mark.parametrize(("low", "high", "proved"), [(0.01, 5.99, True), (0.01, 6.001, False), (6.0, 7.0, False)])
def test_a_range_of_gains_ends_at_the_border(low: float, high: float, proved: bool) -> None:
    case = epp.Case.from_system(limited(1.0, [1.0, 3.0, 2.0, 0.0]))
    found = epp.certify(case, "absence", within={"loop.gain": (low, high)})
    assert found.proved == proved and (not proved or len(found.document["loop"]["num"]) == 2)


def test_a_range_between_whose_ends_the_loop_swings_is_not_proved() -> None:
    """Of (s + 1)^2/s^3 the linear loop swings at a gain of 1/2; the criterion holds far below, and far above it."""
    bent = epp.PiecewiseLinear([-1.0, 1.0], [1.0, 1.2, 1.0], [-0.2, 0.0, 0.2])
    case = epp.Case.from_system(epp.LureSystem.from_tf(([1.0, 2.0, 1.0], [1.0, 0.0, 0.0, 0.0]), bent))

    def proved(low: float, high: float) -> bool:
        return epp.certify(case, "absence", within={"loop.gain": (low, high)}).proved

    assert proved(0.05, 0.1) and proved(2.0, 20.0) and not proved(0.05, 20.0) and not proved(0.05, 0.47)
    low, high = (epp.certify(case.with_values({"loop.gain": k}), "absence").document for k in (0.05, 20.0))
    assert low["claim"]["sector"] == high["claim"]["sector"] == ["1", "6/5"]
    forged = json.loads(json.dumps(low))
    forged["loop"] |= {name: low["loop"][name] + high["loop"][name] for name in ("num", "den")}
    nums, dens = ([[Fraction(c) for c in row[::-1]] for row in forged["loop"][name]] for name in ("num", "den"))
    multiplier = Fraction(low["claim"]["multiplier"])
    sums = coefficients([*zip(nums, dens, strict=True)], (Fraction(1), Fraction(6, 5)), multiplier, None)
    forged["evidence"]["polynomials"] = [[str(c) for c in p[::-1]] for p in sums]
    assert len(sums) == 3
    with pytest.raises(Refused, match="not positive"):
        check_absence.verify(sealed(forged))


def tuned(path: Path, integral: float = 0.5) -> epp.Case:
    """A PI controller with a saturated drive before a damped mass."""
    path.write_text(
        f"""
kind = "diagram"
title = "tuned"
connect = ["- plant -> control", "control -> drive", "drive -> plant"]
[parameters]
Kp = 2.0
Ki = {integral}
damping = 1.0
[blocks.control]
kind = "transfer_function"
num = ["Kp", "Ki"]
den = [1, 0]
[blocks.plant]
kind = "transfer_function"
num = [1]
den = [1, "1 + damping", "damping"]
[elements.drive]
kind = "saturation"
""",
        encoding="utf-8",
    )
    return epp.read_case(path)


def test_a_box_of_parameters_is_proved_by_one_file(tmp_path: Path) -> None:
    case = tuned(tmp_path / "tuned.toml")
    box = {"Kp": (1.0, 3.0), "Ki": (0.1, 0.9), "damping": (0.8, 1.2)}
    found = epp.certify(case, "absence", within=box)
    assert found.proved and "with Kp from 1.0 to 3.0, Ki from 0.1 to 0.9 and damping from 0.8 to 1.2" in str(found)
    assert len(found.document["loop"]["num"]) == 8 and len(found.document["evidence"]["polynomials"]) == 27
    file = found.write(tmp_path / "box.json")
    assert (
        "any linear part between the 8 that it lists" in str(epp.check_certificate(file)) and found.plot().get_lines()
    )
    rng = np.random.default_rng(3)
    for _ in range(10):
        values = {name: float(rng.uniform(low, high)) for name, (low, high) in box.items()}
        assert epp.check_certificate(file, case.with_values(values)).about
        name = str(rng.choice(list(box)))
        outside = case.with_values(values | {name: box[name][1] * 1.0001})
        assert epp.check_certificate(file, outside).about is False
        assert epp.certify(case.with_values(values), "absence").proved


@pytest.mark.parametrize(
    ("name", "share", "field"),
    [
        ("backlash_servo", 0.5, "play.gap"),
        ("backlash_servo_unseen", 0.5, "play.gap"),
        ("sat_asymmetric", 0.25, "saturation.upper"),
        ("sat_asymmetric", 0.25, "saturation.lower"),
    ],
)
def test_a_field_of_the_element_may_be_a_side_of_the_box(tmp_path: Path, name: str, share: float, field: str) -> None:
    case = epp.case(name)
    case = case.with_values({"loop.gain": share * case.value("loop.gain")})
    box = {p: tuple(sorted((0.9 * case.value(p), 1.1 * case.value(p)))) for p in ("loop.gain", field)}
    found = epp.certify(case, "absence", within=box)
    assert found.proved and len(found.document["loop"]["num"]) == 2
    file, rng = found.write(tmp_path / "box.json"), np.random.default_rng(5)
    for _ in range(4):
        inside = case.with_values({p: float(rng.uniform(*ends)) for p, ends in box.items()})
        assert epp.check_certificate(file, inside).about and not epp.find_limit_cycles(inside)


def test_elements_of_a_range_lie_in_the_sector_that_the_file_claims(tmp_path: Path) -> None:
    """A steeper limiter is beyond it; one that is less steep, or limits elsewhere, is not."""
    case = epp.Case.from_system(limited(3.0, [1.0, 3.0, 2.0, 0.0], epp.Saturation(-1.0, 1.0, 1.0)))
    found = epp.certify(case, "absence", within={"saturation.slope": (0.9, 1.1), "saturation.upper": (0.5, 2.0)})
    assert found.proved and found.document["claim"]["sector"] == ["0", "11/10"]
    assert "saturation.slope from 0.9 to 1.1 and saturation.upper from 0.5 to 2.0" in str(found)
    file = found.write(tmp_path / "box.json")
    for values, about in (
        ({"saturation.slope": 1.05, "saturation.upper": 1.7}, True),
        ({"saturation.slope": 1.2}, False),
    ):
        assert epp.check_certificate(file, case.with_values(values)).about is about
    # Of a slope of 2.1 the sector ends where Popov's criterion does not hold any more: k = 6 is the limit.
    assert not epp.certify(case, "absence", within={"saturation.slope": (0.9, 2.1)}).proved


def test_what_is_proved_for_one_element_alone_is_proved_of_no_range() -> None:
    case = epp.case("relay_deadzone").with_values({"loop.gain": 0.5})
    assert epp.certify(case, "absence").proved
    found = epp.certify(case, "absence", within={"relay_dead_zone.threshold": (0.99, 1.01)})
    assert not found.proved and "holds for one element of the range alone" in found.message


def test_a_box_that_reaches_a_loop_with_a_cycle_is_not_proved(tmp_path: Path) -> None:
    """At an integral gain of (1 + d)(d + Kp) the linear loop swings without damping."""
    case = tuned(tmp_path / "tuned.toml")
    inside, beyond = ({"Kp": (1.0, 1.2), "Ki": (0.1, top), "damping": (0.9, 1.0)} for top in (3.5, 3.62))
    assert epp.certify(case, "absence", within=inside).proved
    assert not epp.certify(case, "absence", within=beyond).proved


def sampled(
    num: list[float], den: list[float], element: epp.Nonlinearity | None = None, late: int = 0
) -> epp.LureSystem:
    """A loop in discrete time, with samples of half a second."""
    G = control.tf(num, den, 0.5)
    return epp.LureSystem.from_tf(G, element or epp.Saturation(), delay=0.5 * late)


@pytest.mark.parametrize(
    ("element", "most"), [(epp.Saturation(), 1.0), (epp.Quantiser(1.0, 60), 2.0), (epp.Play(1.0), 1.0)]
)
def test_in_discrete_time_the_circle_criterion_holds_up_to_the_cycle(element: epp.Nonlinearity, most: float) -> None:
    """x[k+1] = -K N(x[k]) alternates for ever from K = 1/most on, where N(x)/x has its most."""
    for share, proved in ((0.999, True), (1.001, False)):
        for den, border in (([1.0, 0.0], 1.0), ([1.0, -1.0], 2.0)):  # of a delay, and of an integrator
            assert epp.certify(sampled([share * border / most], den, element), "absence").proved == proved


def test_in_discrete_time_it_is_the_criterion_on_the_unit_circle() -> None:
    """Against many frequencies in floats: 60 random linear parts, some with dead time."""
    rng, proved, theta = np.random.default_rng(50), 0, np.linspace(0.0, np.pi, 20_001)
    for k in range(60):
        roots = rng.uniform(-0.9, 0.9, 2)
        num, den, late = rng.uniform(-1.0, 1.0, 2), np.poly(roots), k % 3
        num, z = num * rng.choice([0.4, 1.5]), np.exp(1j * theta)
        least = float((np.polyval(num, z) / np.polyval(den, z) * z**-late).real.min())
        if abs(1.0 + least) < 1e-3:
            continue
        found = epp.certify(sampled(list(num), list(den), late=late), "absence").proved
        assert found == (least > -1.0), (num, den, late)
        proved += found
    assert 10 < proved < 50


def test_play_that_is_proved_in_discrete_time_comes_to_rest() -> None:
    """Random linear parts of second order, with and without an integrator, up to the border: runs by hand."""
    rng, proved, z = np.random.default_rng(7), 0, np.exp(1j * np.linspace(1e-4, np.pi, 20_001))
    for k in range(40):
        num, poles = rng.integers(-16, 17, 2) / 16, rng.integers(-14, 15, 2) / 16
        den = np.poly([1.0 if k % 2 else poles[0], poles[1]])
        least = float((np.polyval(num, z) / np.polyval(den, z)).real.min())
        num = num * float(np.round(rng.uniform(0.3, 1.5) / max(-least, 0.1), 3))
        least = float((np.polyval(num, z) / np.polyval(den, z)).real.min())
        if abs(1.0 + least) < 1e-3 or not num.any():
            continue
        found = epp.certify(sampled(list(num), list(den), epp.Play(0.4)), "absence").proved
        assert found == (least > -1.0), (num, den)
        proved += found
        x, w, held = np.zeros(2), 0.0, []
        for n in range(4000 if found else 0):  # x'' of the canonical form, the play's output where it is caught
            x = np.array([-den[1] * x[0] - den[2] * x[1] + w, x[0]])
            u = float(-(num @ x)) + (3.0 if n < 5 else 0.0)
            w = min(max(w, u - 0.2), u + 0.2)
            held.append(w)
            if abs(w) > 1e6:  # what grows is no periodic motion
                break
        if found and abs(w) < 1e6:
            assert np.ptp(held[-500:]) < 1e-6 * (1.0 + abs(held[-1])), (num, den)
    assert 10 < proved < 35


def test_filters_that_are_proved_have_no_cycle_of_rounding() -> None:
    """y[n] = round(a1 y[n-1] + a2 y[n-2]) from whole numbers up to six, by counting."""
    some = 0
    for a1, a2 in ((i / 5, j / 5) for i in range(-3, 4) for j in range(-3, 4) if j):
        loop = epp.LureSystem.build(
            [[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[a1, a2]], [epp.Quantiser(1.0, 60)], time_step=1.0
        )
        if not epp.certify(loop, "absence").proved:
            continue
        some += 1
        for here in ((float(p), float(q)) for p in range(-6, 7) for q in range(-6, 7)):
            way = []
            while here not in way:
                way.append(here)
                z = a1 * here[0] + a2 * here[1]
                here = (float(np.copysign(np.floor(abs(z) + 0.5), z)) + 0.0, here[0])
            assert way.index(here) == len(way) - 1, (a1, a2, here)
    assert some > 5


def test_a_range_of_gains_in_discrete_time_ends_before_the_cycle() -> None:
    case = epp.Case.from_system(sampled([0.5], [1.0, -0.3]))
    for top, proved in ((1.29, True), (1.31, False)):  # at z = -1: G = -K/1.3
        found = epp.certify(case, "absence", within={"loop.gain": (0.2, top / 0.5)})
        assert found.proved == proved, found


def test_a_pole_at_minus_one_is_not_passed_over() -> None:
    assert not epp.certify(sampled([0.1], [1.0, 1.0]), "absence").proved
    assert not epp.certify(sampled([0.1, -0.1], [1.0, 1.0, 0.0]), "absence").proved


def reach_and_border(den: list[float], late: float) -> tuple[float, float]:
    """Gains up to which Popov's criterion holds with a dead time, and at which the linear loop oscillates."""
    omega = np.linspace(1e-3, 40.0, 20_000)
    G = np.exp(-1j * omega * late) / np.polyval(den, 1j * omega)
    rates = np.linspace(-1.0, 4.0, 501)
    criterion = max(-1.0 / (G.real - r * omega * G.imag).min() for r in rates)
    crossed = np.flatnonzero((G.imag[1:] >= 0.0) & (G.imag[:-1] < 0.0) & (G.real[1:] < 0.0))
    return criterion, float(-1.0 / G.real[crossed].min())


@pytest.mark.parametrize(("den", "late"), [([1.0, 1.0], 0.5), ([1.0, 1.0, 0.0], 0.5), ([1.0, 0.4, 1.0], 1.2)])
def test_behind_dead_time_the_criterion_reaches_as_far_as_it_holds(den: list[float], late: float) -> None:
    reach, border = reach_and_border(den, late)
    loops = {
        gain: epp.LureSystem.from_tf(([gain], den), epp.Saturation(), delay=late)
        for gain in (0.1 * reach, 0.99 * reach, 1.01 * reach, 1.02 * border)
    }
    proved = [epp.certify(loop, "absence").proved for loop in loops.values()]
    assert proved == [True, True, False, False]
    assert len(epp.find_limit_cycles(list(loops.values())[-1])) == 1


def test_a_range_of_dead_times_is_proved_by_one_file(tmp_path: Path) -> None:
    case = epp.Case.from_system(epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Saturation(), delay=0.5))
    within = {"loop.gain": (0.5, 1.2), "loop.delay": (0.3, 0.5)}
    found = epp.certify(case, "absence", within=within)
    assert found.proved and found.document["loop"]["delay"] == ["3/10", "1/2"]
    path = found.write(tmp_path / "range.json")
    for gain, late, about in ((0.5, 0.5, True), (0.9, 0.37, True), (1.2, 0.3, True), (1.0, 0.52, False)):
        check = epp.check_certificate(path, case.with_values({"loop.gain": gain, "loop.delay": late}))
        assert check.accepted and check.about == about and ("dead time" in check.message) == (not about)
    assert "with any dead time from 0.3 to 0.5 s" in epp.check_certificate(path).message
    # The gain at which the linear loop oscillates with the longest of the dead times.
    border = reach_and_border([1.0, 1.0, 0.0], 0.5)[1]
    assert not epp.certify(case, "absence", within=within | {"loop.gain": (0.5, 1.01 * border)}).proved
    assert epp.certify(case, "absence", within=within | {"loop.delay": (0.0, 0.5)}).proved


@pytest.mark.parametrize(
    ("loop", "why"),
    [
        (limited(1.0, [1.0, 1.0, 0.0], epp.JumpAndFollow(1.0, 0.5)), "memoryless"),
        (limited(1.0, [1.0, 1.0, 0.0], epp.HysteresisRelay(-1.0, 1.0)), "memoryless"),
        (epp.LureSystem.from_tf(([0.1], [1.0, 1.0]), epp.Relay(), delay=0.5), "a sector that is bounded"),
        (epp.LureSystem.from_tf(([9.0], [1.0, 1.0]), epp.Play(gap=1.0), delay=0.5), "without dead time"),
        (epp.LureSystem.from_tf(([1.0, 2.0], [1.0, 1.0]), epp.Saturation()), "straight through"),
        (limited(1.0, [1.0, 0.0, 0.0]), "neither"),
        (limited(0.0, [1.0, 2.0, 1.0]), "does not reach its input"),
        (
            epp.LureSystem.from_tf(([1.0, 0.0, 4.0], np.polymul([1.0, 0.0, 4.0], [1.0, 1.0])), epp.Saturation()),
            "neither",
        ),
        (limited(1.0, [1.0, 0.0, 4.0]), "neither"),
        (epp.LureSystem.from_tf(([1.0, 0.0], [1.0, 3.0, 3.0, 1.0, 0.0]), epp.Saturation()), "integrator"),
        (sampled([9.0], [1.0, -0.5], epp.Play(1.0)), "in continuous time"),
        (sampled([1.1], [1.0, 0.0]), "circle criterion fails"),
        (
            epp.LureSystem.from_tf(control.tf([0.1], [1.0, 0.5], 1.0), epp.Saturation(), delay=0.5),
            "whole number of samples",
        ),
    ],
)
def test_hypotheses_that_fail_are_named(loop: epp.LureSystem, why: str) -> None:
    found = epp.certify(loop, "absence")
    assert not found.proved and not found.document and found.message.startswith("Not decided") and why in found.message


@pytest.mark.parametrize("element", [epp.Saturation(), epp.Relay(), epp.Cube(1.0), epp.Play(0.5)], ids=lambda e: e.kind)
@pytest.mark.parametrize("seen", mostly_slow(["moved, not seen", "seen, not moved", "neither"], ["moved, not seen"]))
def test_a_mode_without_damping_that_the_element_does_not_see_swings_for_ever(
    element: epp.Nonlinearity, seen: str
) -> None:
    """In turned states it cancels but for rounding, to one side or the other: ten loops of each."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        omega = rng.uniform(0.3, 5.0)
        A = scipy.linalg.block_diag(np.diag(-rng.uniform(0.2, 3.0, 2)), [[0.0, omega], [-omega, 0.0]])
        moved, read = (np.append(rng.uniform(0.3, 1.0, 2), scale * rng.normal(size=2)) for scale in _SCALES[seen])
        loop = epp.LureSystem.build(A, -moved[:, None], read[None], [element])
        alone = epp.LureSystem.build(A[:2, :2], loop.B[:2], loop.C[:, :2], [element])
        T = rng.normal(size=(4, 4))
        found = epp.certify(loop.in_coordinates(T, np.linalg.inv(T)), "absence")
        assert epp.certify(alone, "absence").proved and not found.proved, (seed, found.message)


def test_a_mode_without_damping_beside_a_far_faster_lag_is_no_integrator() -> None:
    """In the dead zone nothing damps it, however many times faster than it the other pole is."""
    loop = epp.LureSystem.from_tf(([0.7, 1.0], np.polymul([1.0, 0.0, 1.0], [1e-10, 1.0])), epp.DeadZone())
    poles, modes = np.linalg.eig(loop.A)
    start = modes[:, np.argmax(poles.imag)].real
    swings = replace(loop, x0=0.5 * start / np.abs(loop.C @ start))
    x = epp.simulate(swings, t_end=60.0).signals["x"]
    assert np.ptp(x[:3000]) == pytest.approx(np.ptp(x[3000:]), rel=1e-4) and 1.0 < np.ptp(x) < 2.0
    assert not epp.certify(loop, "absence").proved


@pytest.mark.parametrize("omega", [1e-7, 1e-8, 1e-12])
def test_a_mode_without_damping_is_no_double_integrator_however_slow_it_is(omega: float) -> None:
    for A, proved in (([[0.0, 1.0], [-(omega**2), 0.0]], False), ([[0.0, 1.0], [0.0, 0.0]], True)):
        loop = epp.LureSystem.build(A, [[0.0], [1.0]], [[-1.0, -0.7]], [epp.DeadZone()])
        assert epp.certify(loop, "absence").proved == proved


#: How much of the mode is moved by the element, and is read by it.
_SCALES = {"moved, not seen": (1.0, 0.0), "seen, not moved": (0.0, 1.0), "neither": (0.0, 0.0)}


def tampered() -> list[tuple[str, dict]]:
    whole = epp.certify(limited(5.9, [1.0, 3.0, 2.0, 0.0]), "absence").document
    made = []

    def change(name: str, edit) -> None:
        copy = json.loads(json.dumps(whole))
        edit(copy)
        made.append((name, sealed(copy)))

    def multiplier(d: dict) -> None:
        d["claim"]["multiplier"] = d["evidence"]["multiplier"] = "1/10"

    change("gain", lambda d: d["loop"].update(num=[["59000000001/10000000000"]]))
    change("gain beyond the border", lambda d: d["loop"].update(num=[["61/10"]]))
    change("pole", lambda d: d["loop"]["den"][0].__setitem__(1, "29/10"))
    change("slope", lambda d: d["loop"]["element"].update(slope="2"))
    change("bend", lambda d: d["loop"]["element"]["bends"][0].__setitem__(1, "1"))
    change("dead time", lambda d: d["loop"].update(delay="1/10"))
    change("discrete time", lambda d: d["loop"].update(time_step="1/10"))
    change("polynomial", lambda d: d["evidence"]["polynomials"][0].__setitem__(1, "1"))
    change("polynomial shortened", lambda d: d["evidence"]["polynomials"][0].pop())
    change("multiplier", lambda d: d["evidence"].update(multiplier="7/5"))
    change("multiplier in claim too", multiplier)
    change("sector", lambda d: d["claim"].update(sector=["0", "2"]))
    change("number that is none", lambda d: d["loop"].update(num=[[5.9]]))
    return made


@pytest.mark.parametrize(("name", "document"), tampered(), ids=lambda x: x if isinstance(x, str) else "")
def test_changed_certificates_are_refused(name: str, document: dict) -> None:
    with pytest.raises((Refused, ValueError, LookupError)):
        check_absence.verify(document)


def test_a_changed_file_is_refused_even_where_it_still_proves_something() -> None:
    document = json.loads(json.dumps(epp.certify(limited(1.0, [1.0, 3.0, 2.0, 0.0]), "absence").document))
    document["loop"]["num"] = [["1/2"]]
    with pytest.raises(Refused, match="changed"):
        check_absence.verify(document)
