"""Laws with a clock: their steps in time, and their describing functions against long time averages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.dynamic.parking import ParkingBandLaw, SampledLaw

LAW = epp.FiveBandLaw(slack=5.0, low=10.0, high=11.0, max=16.0, supply_voltage=16.0, offset_voltage=1.0)


def averages(element: Any, amplitude: float, bias: float, omega: float, n_periods: int) -> tuple[float, complex]:
    """Mean and fundamental gain of the element's own steps in time, after two periods."""
    n = 4000
    phases = (np.arange(n * (n_periods + 2)) + 0.5) * 2 * np.pi / n
    memory, out = None, []
    for phase in phases:
        y, memory = element.output((bias + amplitude * np.sin(phase), phase / omega), memory)
        out.append(y)
    y, phase = np.array(out[2 * n :]), phases[2 * n :]
    return float(y.mean()), complex(2 * np.mean(y * (np.sin(phase) + 1j * np.cos(phase))) / amplitude)


@pytest.mark.parametrize(
    ("amplitude", "bias", "omega", "dwell_time"),
    [
        (4.0, 10.5, 10.0, 0.1),  # passes too quickly to park
        (4.0, 10.5, 1.0, 0.1),  # parks on the way down
        (4.0, 9.0, 5.0, 0.05),  # parks, biased
        (1.2, 9.3, 5.0, 0.1),  # comes from below, turns inside the band, parks for good
        (0.8, 9.3, 5.0, 0.5),  # comes from below, turns inside the band too quickly
        (2.0, 12.3, 5.0, 0.1),  # comes from above and turns inside the band
        (0.3, 10.5, 5.0, 0.1),  # stays inside
        (3.0, 20.0, 5.0, 0.1),  # full flexion throughout
    ],
)
def test_parking_against_its_steps_in_time(amplitude: float, bias: float, omega: float, dwell_time: float) -> None:
    element = ParkingBandLaw(LAW, dwell_time)
    mean, gain = element.describing_function(amplitude, bias, omega)
    wanted_mean, wanted_gain = averages(element, amplitude, bias, omega, 2)
    # The samples place each jump of one volt to half a sample.
    assert float(mean) == pytest.approx(wanted_mean, abs=4 / 4000 * 17)
    assert complex(gain) == pytest.approx(wanted_gain, abs=4 / 4000 * 17 / amplitude)


def test_parking_is_vectorised() -> None:
    element = ParkingBandLaw(LAW, 0.1)
    mean, gain = element.describing_function(np.array([2.0, 4.0])[:, None], 10.5, np.array([1.0, 5.0, 10.0]))
    assert mean.shape == gain.shape == (2, 3)
    one_mean, one_gain = element.describing_function(4.0, 10.5, 5.0)
    assert mean[1, 1] == one_mean and gain[1, 1] == one_gain


def test_parking_in_time() -> None:
    element = ParkingBandLaw(LAW, 1.0)
    memory, voltages = None, []
    for force, clock in [
        (10.5, 0.0),
        (10.5, 0.9),
        (8.0, 0.95),
        (10.5, 1.0),
        (10.5, 2.0),
        (8.0, 2.5),
        (12.0, 3.0),
        (8.0, 3.1),
    ]:
        voltage, memory = element.output((force, clock), memory)
        voltages.append(voltage)
    down, up = float(LAW.output(8.0)[0]), float(LAW.output(12.0)[0])
    assert voltages == [0.0, 0.0, down, 0.0, 0.0, 0.0, up, down]


@pytest.mark.parametrize(("period", "omega"), [(0.01, 9.7), (0.05, 12.345)])
def test_sampled_law_against_its_steps_in_time(period: float, omega: float) -> None:
    """The sampling drifts through the phase of the sine, so that a long average is the mean over that phase."""
    element = SampledLaw(LAW, period)
    mean, gain = element.describing_function(4.0, 11.0, omega)
    wanted_mean, wanted_gain = averages(element, 4.0, 11.0, omega, 60)
    assert float(mean) == pytest.approx(wanted_mean, abs=0.02)
    assert complex(gain) == pytest.approx(wanted_gain, abs=0.02)


def test_sampled_law_holds() -> None:
    element = SampledLaw(LAW, 0.1)
    first, memory = element.output((12.0, 0.0))
    assert first == float(LAW.output(12.0)[0])
    held, memory = element.output((15.0, 0.05), memory)
    assert held == first
    read, memory = element.output((15.0, 0.1), memory)
    assert read == float(LAW.output(15.0)[0]) and memory[1] == pytest.approx(0.2)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_times_that_are_refused(value: float) -> None:
    with pytest.raises(ModelError, match="positive number"):
        ParkingBandLaw(LAW, value)
    with pytest.raises(ModelError, match="positive number"):
        SampledLaw(LAW, value)


def test_automata_fit() -> None:
    for element in (ParkingBandLaw(LAW, 0.1), SampledLaw(LAW, 0.1)):
        automaton = element.automaton()
        assert (automaton.n_inputs, automaton.n_outputs) == (2, 1)
        assert element.thresholds().size
