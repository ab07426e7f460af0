"""No cycle where none is: certificates against the exact onset of cycles, and against exact orbits."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib import util
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates import check_play
from eppanalysis.methods.certificates.play.search import rays_of
from tests.coordinates import in_coordinates, orthogonal
from tests.shared import mostly_slow, said_above

Coefficients = list[float]
THIRD = [0.2, 1.2, 1.0, 0.0]


def servo(num: Coefficients, den: Coefficients, gap: float = 0.3) -> epp.LureSystem:
    return epp.LureSystem.from_tf((num, den), epp.Play(gap=gap))


def overshoot(loop: epp.LureSystem) -> float:
    """How far the output passes zero, as a share of where it was, where the play rested for long before it moves.

    The longer it rests, the farther (the gap is crossed at a speed that the integrator sets in the end). So cycles
    begin, at a size that vanishes against the gap, where this is 1. In speeds the gap drops out.
    """
    A, F, C = loop.A, loop.A + loop.B @ loop.C, loop.C[0]
    start, kept = scipy.linalg.null_space(A)[:, 0], scipy.linalg.null_space(A.T)[:, 0]
    sign, step, state = np.sign(C @ start), scipy.linalg.expm(F * 0.01), start
    for _ in range(6000):
        before, state = state, step @ state
        if sign * (C @ state) <= 0.0:
            break
    else:
        return 0.0  # it creeps in
    last = scipy.optimize.brentq(lambda t: C @ scipy.linalg.expm(F * t) @ before, 0.0, 0.01, xtol=1e-14)
    return float(-(kept @ scipy.linalg.expm(F * last) @ before) / (kept @ start))


def onset(num: Coefficients, den: Coefficients, low: float, high: float) -> float:
    def excess(gain: float) -> float:
        return overshoot(servo([gain * c for c in num], den)) - 1.0

    return float(scipy.optimize.brentq(excess, low, high, xtol=1e-6))


@pytest.fixture(autouse=True)
def _needs_a_solver() -> None:
    pytest.importorskip("clarabel")


def test_servo_of_third_order_is_proved_up_to_its_onset() -> None:
    # 2.077624 is what branches of the exact engine say.
    assert onset([1.0], THIRD, 1.9, 2.3) == pytest.approx(2.077624, abs=2e-6)
    began = time.process_time()
    found = epp.certify(servo([2.07], THIRD), "absence")
    assert found.proved and found.document["claim"]["sectors"] and time.process_time() - began < 5.0
    began = time.process_time()
    check_play.verify(found.document)
    assert time.process_time() - began < 0.5
    assert found.document["loop"]["num"] == [["207/20"]] and found.document["loop"]["den"] == [["1", "6", "5", "0"]]


@pytest.mark.parametrize(
    ("num", "den", "low", "high", "share"),
    [
        ([1.0], [1.0, 1.0, 0.0], 2.0, 4.0, 0.99),
        ([0.1, 1.0], [1.0, 1.0, 0.0], 2.0, 20.0, 0.99),
        ([1.0], THIRD, 1.5, 3.0, 0.98),
        ([1.0], [0.02, 0.3, 1.0, 0.0], 1.0, 8.0, 0.98),
        ([1.0], [1.0, 2.0, 1.0, 0.0], 0.3, 2.0, 0.98),
        ([0.1, 1.0], THIRD, 1.0, 5.0, 0.98),
        ([0.3, 1.0], THIRD, 1.0, 5.0, 0.96),
    ],
)
def test_bounds_stand_within_two_per_cent_of_the_onset(
    num: Coefficients, den: Coefficients, low: float, high: float, share: float
) -> None:
    exact = onset(num, den, low, high)
    below, above = ([gain * c for c in num] for gain in (share * exact, 1.001 * exact))
    assert epp.certify(servo(below, den), "absence", sectors=24).proved
    assert not epp.certify(servo(above, den), "absence", sectors=10).proved


def gains(num: Coefficients, den: Coefficients, low: float, high: float, sectors: int = 48) -> epp.Certificate:
    case = epp.Case.from_system(servo(num, den), name="slack")
    return epp.certify(case, "absence", within={"loop.gain": (low, high)}, sectors=sectors)


def test_one_file_holds_for_a_range_of_gains(tmp_path: Path) -> None:
    began = time.process_time()
    found = gains([1.0], THIRD, 0.8, 2.07)
    assert found.proved and time.process_time() - began < 5.0
    began = time.process_time()
    check_play.verify(found.document)
    assert time.process_time() - began < 0.5
    assert str(found).startswith(
        "Proved: slack with loop.gain from 0.8 to 2.07 has no periodic motion but rest, for any"
    )
    file = found.write(tmp_path / "range.json")
    about = {k: epp.check_certificate(file, servo([k], THIRD)).about for k in (0.79999, 0.8, 1.234567, 2.07, 2.07001)}
    assert list(about.values()) == [False, True, True, True, False]
    assert not epp.check_certificate(file, servo([0.001, 1.0], THIRD)).about
    assert "the loop in the file, with any numerator from 4 to 10.35, has no" in str(epp.check_certificate(file))


@pytest.mark.parametrize(
    ("num", "den", "low", "high"),
    mostly_slow(
        [
            ([1.0], THIRD, 1.5, 3.0),
            ([1.0], [1.0, 1.0, 0.0], 2.0, 4.0),
            ([0.3, 1.0], THIRD, 1.0, 5.0),
            ([0.1, 1.0], [1.0, 1.0, 0.0], 2.0, 20.0),
        ],
        [([1.0], THIRD, 1.5, 3.0)],
    ),
)
def test_ranges_reach_from_near_zero_to_the_onset_and_not_beyond(
    num: Coefficients, den: Coefficients, low: float, high: float
) -> None:
    exact = onset(num, den, low, high)
    assert gains(num, den, 0.02 * exact, 0.98 * exact, sectors=24).proved
    for start in (0.02, 0.9, 1.0005):
        assert not gains(num, den, start * exact, 1.001 * exact, sectors=16).proved


def test_a_line_of_numerators_is_no_box_of_them(tmp_path: Path) -> None:
    found = gains([0.3, 1.0], THIRD, 1.0, 3.0, sectors=10)
    file = found.write(tmp_path / "range.json")
    about = [epp.check_certificate(file, servo(n, THIRD)).about for n in ([0.6, 2.0], [0.3, 2.0], [0.6000001, 2.0])]
    assert about == [True, False, False]


def test_ranges_that_are_not_covered_are_said(tmp_path: Path) -> None:
    case = epp.Case.from_system(servo([1.0], THIRD))
    # Behind dead time the criterion by frequency is left.
    found = epp.certify(case, "absence", within={"loop.delay": (0.0, 0.1)})
    assert not found.proved and str(found).startswith(
        "Not decided: Re G(jω) > -1 fails at some frequency, and functions that fall are sought"
    )
    slow = epp.Case.from_system(servo([0.3], THIRD))
    assert epp.certify(slow, "absence", within={"loop.delay": (0.0, 0.1)}).proved
    # Of play every gap is covered.
    assert epp.certify(case, "absence", within={"play.gap": (1.0, 2.0)}).proved
    for statement, within, words in (
        ("roots", {"loop.gain": (1.0, 2.0)}, "within is of absence"),
        ("absence", {"loop.gain": (2.0, 1.0)}, "expected low < high"),
        ("absence", {}, "expected one to three parameters"),
        ("absence", {"loop.gains": (1.0, 2.0)}, "loop.gain"),
    ):
        with pytest.raises(EppError, match=words):
            epp.certify(case, statement, within=within)
    with pytest.raises(EppError, match="from_system"):
        epp.certify(servo([1.0], THIRD), "absence", within={"loop.gain": (1.0, 2.0)})


def test_a_numerator_that_leaves_its_line_is_not_covered(tmp_path: Path) -> None:
    """Equal at both ends, it bulges between: nothing would be proved of that."""
    path = tmp_path / "bulge.toml"
    parts = """
kind = "diagram"
title = "bulge"
connect = ["- gear -> plant", "plant -> gear"]
[parameters]
k = 0.5
[blocks.plant]
kind = "transfer_function"
num = ["k", "k + 4 * (k - 0.5) * (1 - k)"]
den = [0.2, 1.2, 1, 0]
[elements.gear]
kind = "play"
gap = 1.0
"""
    path.write_text(parts, encoding="utf-8")
    found = epp.certify(epp.read_case(path), "absence", within={"k": (0.5, 1.0)})
    assert not found.proved and "do not run along straight lines with k" in str(found)


@pytest.mark.parametrize("gain", [2.08, 2.3, 5.0])
def test_nothing_is_proved_where_an_exact_orbit_is(gain: float) -> None:
    found = epp.certify(servo([gain], THIRD), "absence", sectors=24)
    assert not found.proved and found.status is epp.Status.INCOMPLETE and not found.document
    assert "There may be a cycle or none" in str(found)


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ([2.3], THIRD),
        ([4.0], [1.0, 1.0, 0.0]),
        ([0.4, 4.5], THIRD),
        ([1.5], [1.0, 2.0, 1.0, 0.0]),
    ],
)
def test_no_loop_with_an_exact_orbit_is_proved_to_have_none(num: Coefficients, den: Coefficients) -> None:
    loop = servo(num, den)
    run = epp.simulate(loop, t_end=200.0)
    assert run.limit_cycle is not None
    assert epp.exact_orbit(loop, run.limit_cycle).status is epp.Status.CONVERGED
    assert not epp.certify(loop, "absence", sectors=16).proved


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 8))])
def test_random_servos_are_proved_below_their_onset_and_never_above(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (float(p) for p in rng.uniform(0.3, 5.0, 2).round(3))
    den = [1.0, a + b, a * b, 0.0]
    exact = onset([1.0], den, 1e-3, 0.999 * a * b * (a + b))
    above, below = rng.uniform(1.002, 2.0), rng.uniform(0.5, 0.95)
    assert not gains([1.0], den, 0.5 * exact, 1.002 * exact, sectors=6).proved
    assert gains([1.0], den, 0.1 * exact, below * exact, sectors=12).proved
    assert not epp.certify(servo([above * exact], den), "absence", sectors=6).proved
    assert epp.certify(servo([below * exact], den), "absence", sectors=12).proved


@pytest.mark.parametrize("gap", [1e-6, 0.3, 40.0])
def test_the_gap_does_not_matter_but_must_be_there(gap: float) -> None:
    assert epp.certify(servo([1.9], THIRD, gap), "absence", sectors=6).proved
    none = epp.certify(servo([1.9], THIRD, 0.0), "absence")
    assert not none.proved and "a play without a gap" in str(none)


@pytest.mark.parametrize("scale", mostly_slow([1e-6, 1e-3, 1e3, 1e6], [1e-6]))
@pytest.mark.parametrize(("num", "sectors"), [([2.07], 24), ([0.9, 3.0], 6)])
def test_the_unit_of_time_does_not_matter(num: Coefficients, sectors: int, scale: float) -> None:
    """Each power of s by a power of the scale; the onset is at 2.0776 without a zero."""
    den = [c * scale ** (3 - k) for k, c in enumerate(THIRD)]
    slower = [c * scale ** (len(num) - 1 - k) for k, c in enumerate(num)]
    assert epp.certify(servo(slower, den), "absence", sectors=sectors).proved
    assert not epp.certify(servo([2.08], den), "absence", sectors=6).proved


def test_coordinates_of_the_state_do_not_matter() -> None:
    loop = servo([1.9], THIRD)
    turned = in_coordinates(loop, orthogonal(3, 5))
    documents = [epp.certify(one, "absence", sectors=6).document for one in (loop, turned)]
    assert documents[0]["loop"]["num"] == documents[1]["loop"]["num"] == [["19/2"]]
    assert documents[0]["loop"]["den"] == documents[1]["loop"]["den"] == [["1", "6", "5", "0"]]


@pytest.mark.parametrize("bias", [0.0, 0.7])
def test_constant_inputs_do_not_matter(bias: float) -> None:
    """Play holds any value at rest; what is proved knows no constants."""
    plant = epp.blocks.TransferFunction(num=[0.9], den=[1.0, 3.0, 2.0])
    wires = ["push - gears -> plant", "plant -> gears"]
    loop = epp.Diagram(parts={"gears": epp.Play(gap=0.3), "plant": plant}, connect=wires, inputs=["push"]).to_system()
    assert epp.certify(loop, "absence", operating_point={"push": bias}).proved


def test_a_loop_whose_motions_all_grow_has_no_cycle_and_is_said_to_grow() -> None:
    num, den = [-5.45, 95.9], [1.0, 0.92, 0.0]
    found = epp.certify(servo(num, den), "absence", sectors=10)
    assert found.proved and "grow without bound" in str(found)
    size = np.abs(epp.simulate(servo(num, den), t_end=10.0).signals["x"])
    assert np.max(size[-len(size) // 10 :]) > 1e3 * np.max(size[: len(size) // 10])


def test_what_is_not_covered_is_said() -> None:
    slow = epp.certify(servo([80.0, 3.0], [1.0, 3.0, 2.0, 0.0]), "absence")
    assert not slow.proved and "slower than its poles" in str(slow)
    two = epp.certify(servo([8.0, 0.1, 30.0], [1.0, 3.0, 2.0, 0.0]), "absence")
    assert not two.proved and "two zeros" in str(two)
    drifting = epp.certify(servo([0.7, 1.0], [1.0, 0.0, 0.0]), "absence")
    assert not drifting.proved and "two integrators" in str(drifting)
    swinging = epp.certify(servo([3.0], [1.0, 0.2, 1.0, 0.0]), "absence")
    assert not swinging.proved and "real poles" in str(swinging)
    fourth = epp.certify(servo([3.0], [1.0, 4.0, 6.0, 4.0, 0.0]), "absence")
    assert not fourth.proved and "order 4" in str(fourth)
    unstable = epp.certify(servo([30.0], [1.0, 1.0, -2.0]), "absence")
    assert not unstable.proved
    for loop, words in (
        (epp.LureSystem.from_tf(([1.0], THIRD), epp.Play(1.0), delay=0.1), "dead time"),
        (epp.LureSystem.from_tf(([0.5, 1.0], [1.0, 2.0]), epp.Play(1.0)), "straight through"),
        (epp.LureSystem.from_tf(([1.0], THIRD), epp.JumpAndFollow(1.0, 0.5)), "of play"),
    ):
        found = epp.certify(loop, "absence")
        assert not found.proved and not found.document and words in str(found)
    with pytest.raises(EppError, match="2 to 200"):
        epp.certify(servo([1.0], THIRD), "absence", sectors=1)


def test_without_the_solver_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = util.find_spec
    monkeypatch.setattr(util, "find_spec", lambda name: None if name == "clarabel" else real(name))
    with pytest.raises(EppError, match="clarabel"):
        epp.certify(servo([1.9], THIRD), "absence")


def test_plain_data_and_pictures() -> None:
    for gain, words in ((1.9, "sectors"), (0.5, "Re G")):
        found = epp.certify(servo([gain], THIRD), "absence", sectors=6)
        assert found.to_dict()["proved"] is True and found.provenance.subject == "loop"
        assert words in said_above(found.plot().figure)[0]


@pytest.mark.parametrize("factor", [[1.0, 0.0, 4.0], [1.0, 0.0, 0.0], [1.0, -1.0], [1.0, 1.0], [1.0, 0.0]], ids=str)
def test_factors_of_both_polynomials_hide_no_cycle(factor: Coefficients) -> None:
    """A hidden mode is in the loop, too: one that swings by itself is a motion that repeats itself."""
    for gain in (2.3, 0.5):
        hidden = servo(list(np.polymul(factor, [gain])), list(np.polymul(factor, THIRD)))
        swings = factor == [1.0, 0.0, 4.0]
        assert epp.certify(hidden, "absence", sectors=6).proved == (gain < 1.0 and not swings)


def test_signs_orders_and_bias_hide_no_cycle() -> None:
    loop, turn = servo([2.3], THIRD), np.eye(3)[[2, 0, 1]]
    for same in (
        replace(loop, B=-loop.B, C=-loop.C),
        loop.in_coordinates(turn, turn.T),
        replace(loop, constant_input=np.full(1, 0.4)),
        replace(loop, constant_state=np.array([0.3, 0.0, 0.0])),
        servo([float("2.3000000000000003")], THIRD, 1e-6),
        servo([float("2.0776238526840614")], THIRD, 1e6),
    ):
        assert not epp.certify(same, "absence", sectors=6).proved


@pytest.mark.parametrize("count", [2, 48, 49, 132, 157, 200])
def test_borders_of_any_number_of_sectors_differ(count: int) -> None:
    """Rounded to two digits they fell together from 132 sectors on, and the proof ended in a traceback."""
    rays = rays_of(count)
    assert len(check_play.sectors_of(rays, 3)) == 2 * count == len({tuple(ray) for ray in rays}) - 1
