"""Weak sines beside the loop's own oscillation: the two phases of entrainment, its tongue and the beat beside it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from tests.shared import mostly_slow


def driven(name: str, element: epp.Nonlinearity, num: list[float], den: list[float]) -> epp.Diagram:
    parts = {name: element, "plant": epp.blocks.TransferFunction(num=num, den=den)}
    return epp.Diagram(parts=parts, connect=[f"force - plant -> {name}", f"{name} -> plant"], inputs=["force"])


LOOPS: dict[str, Callable[[], epp.Diagram]] = {
    "relay": lambda: driven("relay", epp.Relay(), [1.0], [1.0, 3.0, 2.0, 0.0]),
    "saturation": lambda: driven("spring", epp.Saturation(lower=-1.0, upper=1.0), [10.0], [1.0, 3.0, 2.0, 0.0]),
    "relay with hysteresis": lambda: driven("relay", epp.HysteresisRelay(-0.1, 0.1), [2.0], [0.3, 1.0, 0.0]),
}


@cache
def own_cycle(name: str) -> epp.LimitCycle:
    """The one stable cycle of a loop without its sine."""
    (own,) = epp.find_limit_cycles(LOOPS[name]()).stable
    return own


@pytest.mark.parametrize(
    ("name", "amplitude"),
    [
        pytest.param(name, amplitude, marks=[pytest.mark.slow] * (i + k > 0))
        for i, name in enumerate(LOOPS)
        for k, amplitude in enumerate([1e-3, 1e-12, 1e-8, 1e-5])
        if (i + k) % 4 == 0
    ],
)
def test_within_the_tongue_two_phases_keep_step_and_beside_it_the_motion_beats(name: str, amplitude: float) -> None:
    loop, own = LOOPS[name](), own_cycle(name)
    at = epp.forced_response(loop, amplitude=amplitude, frequency=own.frequency)
    low, high = at.tongue if np.isfinite(at.tongue[0]) else (own.frequency, own.frequency)
    assert low < own.frequency < high
    rates = sorted(np.log(np.abs(r.cycle.multipliers[0])) for r in at if abs(r.largest_multiplier - 1.0) < 0.3)
    # Multipliers exp(-K T) and exp(K T), K half the width of the tongue (Adler, Proceedings of the IRE 34, 1946).
    half = np.pi * (high - low) / own.frequency
    # Multipliers and frequencies have 16 digits, of which a weak sine leaves the last ones.
    within = max(20 * half, 1e-6, 2e-14 / half)
    assert rates == pytest.approx([-half, half], rel=within)
    for share, phases in ((0.8, 2), (1.2, 0)):
        found = epp.forced_response(loop, amplitude=amplitude, frequency=own.frequency + share * 0.5 * (high - low))
        assert sum(abs(r.largest_multiplier - 1.0) < 0.3 for r in found) == phases
        assert len(found.stable) == phases / 2
        assert found.motion == ("periodic" if phases else "quasi-periodic")
        if not phases:
            law = 1.0 / (0.5 * (high - low) * np.sqrt(share**2 - 1.0))
            assert found.beat == pytest.approx(law, rel=within) and "with a beat of" in found.message


@pytest.mark.parametrize("share", [0.0, 1.2])
def test_of_a_sine_below_rounding_nothing_is_told(share: float) -> None:
    loop, own, amplitude = LOOPS["relay"](), own_cycle("relay"), 1e-14
    # The tongue is 2.1139 Hz wide for each unit of amplitude.
    found = epp.forced_response(loop, amplitude=amplitude, frequency=own.frequency + share * 1.057 * amplitude)
    assert not len(found) and found.motion == "undecided"
    assert found.message.endswith("entrainment is undecided at this size.")
    assert np.isnan(found.beat) and np.all(np.isnan(found.tongue))


def switches(omega: float, amplitude: float, n: int) -> np.ndarray:
    """Times at which the relay loop switches, by matrix exponentials and Brent's method alone."""
    A, B = np.array([[0.0, 1, 0], [0, 0, 1], [0, -2, -3]]), np.array([0.0, 0, 1])
    whole = np.zeros((5, 5))
    whole[:3, :3], whole[:3, 3] = A, B
    h = 0.02
    F, x, t, out = expm(h * whole), np.array([0.3, 0.0, 0.0, -1.0, 0.0]), 0.0, []

    def seen(dt: float, start: np.ndarray, at: float) -> float:
        return float(amplitude * np.sin(omega * (at + dt)) - (expm(dt * whole) @ start)[0])

    while len(out) < n:
        new = F @ x
        # The relay is at 1 while the force less the plant's output is positive.
        if (amplitude * np.sin(omega * (t + h)) - new[0]) * x[3] < 0:
            dt = brentq(seen, 0.0, h, args=(x, t), xtol=1e-15)
            x, t = expm(dt * whole) @ x, t + dt
            x[3] = -x[3]
            out.append(t)
        else:
            x, t = new, t + h
    return np.array(out)


@pytest.mark.slow
def test_the_tongue_and_the_beat_are_those_of_an_independent_integration() -> None:
    loop, amplitude = LOOPS["relay"](), 1e-3
    (own,) = epp.find_limit_cycles(loop)
    low, high = epp.forced_response(loop, amplitude=amplitude / 10, frequency=own.frequency).tongue
    half = 5.0 * (high - low)  # proportional to the amplitude
    for share in (0.8, 1.2):
        omega = 2.0 * np.pi * (own.frequency + share * half)
        times = switches(omega, amplitude, 2400)[1::2]
        phase = np.unwrap((omega * times) % (2.0 * np.pi))
        found = epp.forced_response(loop, amplitude=amplitude, frequency=omega / (2.0 * np.pi))
        if share < 1:
            assert abs(phase[-1] - phase[-200]) < 1e-3
            (held,) = found.stable
            events = np.array([held.phase + omega * e.time for e in held.cycle.events])
            assert min(abs(np.exp(1j * phase[-1]) - np.exp(1j * events))) < 1e-3
        else:
            # Whole turns, counted from where the motion has come to the cycle.
            turns = np.abs(phase - phase[100]) / (2.0 * np.pi)
            beat = 0.5 * (np.interp(3.0, turns[100:], times[100:]) - np.interp(1.0, turns[100:], times[100:]))
            assert found.motion == "quasi-periodic" and found.beat == pytest.approx(beat, rel=0.03)


def biased() -> epp.Diagram:
    return driven("relay", epp.Relay(-0.6, 1.0), [1.0], [1.0, 3.0, 2.0, 0.0])


@pytest.mark.parametrize("loop", [LOOPS["relay"], pytest.param(biased, marks=pytest.mark.slow)])
def test_beside_several_cycles_the_beat_is_that_of_the_ratio(loop: Callable[[], epp.Diagram]) -> None:
    (own,) = epp.find_limit_cycles(loop()).stable
    for ratio, (n, m) in ((1.3, (4, 3)), (1.48, (3, 2))):
        found = epp.forced_response(loop(), amplitude=1e-4, frequency=ratio * own.frequency)
        assert found.motion == "quasi-periodic"
        assert found.beat == pytest.approx(1.0 / (abs(m * ratio - n) * own.frequency), rel=1e-9)
        assert np.all(np.isnan(found.tongue)) and "Adler" not in found.message


@pytest.mark.slow
def test_what_second_order_decides_is_not_told_by_first_order() -> None:
    loop = biased()
    (own,) = epp.find_limit_cycles(loop).stable
    # Three periods of this sine and two cycles keep step over a share of 1e-3 of the frequency, in second order.
    strong = epp.forced_response(loop, amplitude=0.01, frequency=1.5 * (1 + 1e-4) * own.frequency)
    assert strong.motion == "periodic" and strong.repeats == 3 and np.isnan(strong.beat)
    for amplitude, away in ((1e-3, 1e-6), (1e-6, 0.0)):
        weak = epp.forced_response(loop, amplitude=amplitude, frequency=1.5 * (1 + away) * own.frequency)
        assert weak.motion == "undecided" and np.isnan(weak.beat)
        assert "2 of which last about 3 periods of the input" in weak.message and "second order" in weak.message


@pytest.mark.parametrize("ratio", mostly_slow([1.0, 1.3, 1.46], [1.3]))
def test_a_play_that_stays_within_its_gap_answers_at_any_frequency(ratio: float) -> None:
    plant, amplitude = 4.0, 1e-3
    parts = {"play": epp.Play(1.0), "plant": epp.blocks.TransferFunction(num=[plant], den=[0.2, 1.2, 1.0, 0.0])}
    loop = epp.Diagram(parts=parts, connect=["force - play -> plant", "plant -> play"], inputs=["force"])
    (own,) = epp.find_limit_cycles(loop).stable
    found = epp.forced_response(loop, amplitude=amplitude, frequency=ratio * own.frequency)
    s = 2j * np.pi * ratio * own.frequency
    held = 2.0 * amplitude * abs(plant / (s * (s + 1.0) * (0.2 * s + 1.0)))
    sizes = [r.cycle.peak_to_peak["plant"] for r in found if r.one_of_many]
    assert sizes and sizes == pytest.approx([held] * len(sizes), rel=1e-6)
    assert found.motion == "periodic" and "one of a continuum" in found.message
