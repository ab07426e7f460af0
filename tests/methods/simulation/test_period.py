"""The shape of a period: harmonics, means and sizes of cycles against Fourier series in closed form."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eppanalysis as epp

#: Loops of one relay of levels -1 and 1 whose cycle switches twice, at half a period: the relay's output is a square
#: wave. With them the plant: a triangle that echoes a dead time later, pieces of exponentials, a ringing pair of poles.
SQUARES = {
    "triangle": (([1.7], [1.0, 0.0]), epp.Relay(), 0.5),
    "exponentials": (([3.0], [2.0, 1.0]), epp.HysteresisRelay(-0.4, 0.4), 0.0),
    "three lags": (([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay(), 0.0),
    "ringing": (([9.0, 9.0], np.polymul([1.0, 0.5, 64.0], [1.0, 1.0, 0.0])), epp.HysteresisRelay(-0.3, 0.3), 0.0),
}


def cycle_of(name: str) -> epp.LimitCycle:
    """The cycle of a relay in front of one of the plants."""
    (num, den), element, delay = SQUARES[name]
    plant = epp.blocks.TransferFunction(num=list(num), den=list(den)).state_space()
    loop = epp.LureSystem.build(plant.A, plant.B, -np.asarray(plant.C), [element], delays=[delay])
    return epp.find_limit_cycles(loop).stable[0]


def part(of: Mapping[str, Any], end: str) -> Any:
    (name,) = (name for name in of if name.endswith(end))
    return of[name]


@pytest.fixture(scope="module", params=SQUARES)
def square(request: pytest.FixtureRequest) -> tuple[epp.LimitCycle, np.ndarray, np.ndarray]:
    """A cycle, its harmonics of the relay's output, and what the plant makes of one."""
    cycle, ((num, den), _, _) = cycle_of(request.param), SQUARES[request.param]
    wave = part(cycle.harmonics, "_output")
    s = 1j * np.arange(1, len(wave)) * cycle.omega
    return cycle, wave, np.polyval(num, s) / np.polyval(den, s)


def test_harmonics_between_switches_are_those_of_a_square_wave(square) -> None:
    cycle, wave, _ = square
    k = np.arange(wave.size)
    np.testing.assert_allclose(np.abs(wave[1::2]), 4.0 / (np.pi * k[1::2]), rtol=1e-9)
    assert np.abs(wave[::2]).max() < 1e-9


def test_harmonics_of_what_the_plant_gives_are_those_of_its_frequency_response(square) -> None:
    cycle, wave, plant = square
    found, size = part(cycle.harmonics, "_input"), part(cycle.peak_to_peak, "_input")
    np.testing.assert_allclose(np.abs(found[1:]), np.abs(plant * wave[1:]), atol=1e-9 * size)
    assert found[0].real == pytest.approx(part(cycle.mean, "_input"), abs=1e-12)


def test_sizes_of_a_triangle_and_of_exponentials_are_exact_at_their_corners() -> None:
    """Corners lie a dead time behind the events, and between samples: peaks are no peaks of samples."""
    assert part(cycle_of("triangle").peak_to_peak, "_input") == pytest.approx(2.0 * 1.7 * 0.5, rel=1e-12)
    saw = cycle_of("exponentials")
    assert part(saw.peak_to_peak, "_input") == pytest.approx(0.8, rel=1e-12)
    assert saw.period == pytest.approx(4.0 * np.log(3.4 / 2.6), rel=1e-12)


def test_harmonics_are_copied_with_their_cycle() -> None:
    """A copy, as other processes get it, holds them."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    cycle = epp.simulate(loop, t_end=100.0).limit_cycle
    copy = pickle.loads(pickle.dumps(cycle))
    assert copy.harmonics.keys() == cycle.peak_to_peak.keys()
    for name, series in copy.harmonics.items():
        np.testing.assert_array_equal(series, cycle.harmonics[name])
        assert series[0].real == pytest.approx(copy.mean[name], abs=1e-14)


def test_a_waveform_begins_with_the_period_and_ends_within_it() -> None:
    cycle = epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay()), t_end=100.0).limit_cycle
    assert cycle.time[0] == 0.0 and np.all(np.diff(cycle.time) > 0) and cycle.time[-1] < cycle.period
    for name, wave in cycle.waveform.items():
        assert np.ptp(wave) <= cycle.peak_to_peak[name] * (1.0 + 1e-12)


def test_the_swing_beside_an_offset_has_the_rounding_of_the_samples() -> None:
    """Of a motion about a place far away no more digits are lost than its samples lose."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    near = epp.simulate(loop, t_end=100.0).limit_cycle
    signals = replace(loop.signals, constant=loop.signals.constant + 1e3)
    far = epp.simulate(replace(loop, signals=signals), t_end=100.0).limit_cycle
    assert far.peak_to_peak["x"] == pytest.approx(near.peak_to_peak["x"], abs=2e-12)
    assert far.mean["x"] == pytest.approx(1e3, rel=1e-14)
