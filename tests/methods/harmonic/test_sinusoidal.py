"""Higher-order sinusoidal-input describing functions against closed forms, quadrature and describing functions."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError

STATIC = [
    epp.Saturation(lower=-1.0, upper=0.6),
    epp.DeadZone(lower=-0.5, upper=0.3),
    epp.RelayDeadZone(threshold=0.3),
    epp.Cube(0.7),
    epp.Sine(scale=1.3),
]


def by_quadrature(element, amplitude, bias, order):
    """Midpoints of 40,000 equal steps of one period, by the element's own map."""
    phase = (np.arange(40_000) + 0.5) * 2.0 * np.pi / 40_000
    y = np.array([float(element.output(x, None)[0]) for x in bias + amplitude * np.sin(phase)])
    k = np.arange(order + 1)[:, None]
    found = 2j * np.mean(y * np.exp(-1j * k * phase), axis=1) / amplitude
    found[0] = y.mean() / amplitude
    return found


@pytest.mark.parametrize("element", STATIC, ids=lambda e: type(e).__name__)
def test_static_elements_are_those_of_quadrature(element):
    H = epp.sinusoidal_harmonics(element, 1.7, bias=0.2, order=7)
    # Where the output jumps, by one, the midpoint rule is off by half a step at each of four jumps, over the amplitude.
    assert H[0] == pytest.approx(by_quadrature(element, 1.7, 0.2, 7), abs=1e-4)


@pytest.mark.parametrize(
    "element", [*STATIC, epp.Play(gap=0.8), epp.HysteresisRelay(lower=-0.2, upper=0.3)], ids=lambda e: type(e).__name__
)
@settings(max_examples=10, deadline=None)
@given(amplitude=st.floats(1.0, 5.0), bias=st.floats(-0.4, 0.4))
def test_mean_and_first_harmonic_are_the_describing_function(element, amplitude, bias):
    mean, gain = element.describing_function(amplitude, bias)
    H = epp.sinusoidal_harmonics(element, amplitude, bias=bias)[0]
    assert H[0] * amplitude == pytest.approx(float(mean), abs=1e-9)
    assert H[1] == pytest.approx(complex(gain), abs=1e-9)


def test_a_cube_has_a_third_harmonic_and_no_other():
    found = epp.sinusoidal_harmonics(epp.Cube(2.0), 3.0, order=6)[0]
    # sin^3 = (3 sin - sin 3)/4
    assert found == pytest.approx([0, 2.0 * 9.0 * 0.75, 0, -2.0 * 9.0 * 0.25, 0, 0, 0], abs=1e-12)


def test_a_play_loses_its_even_harmonics_and_keeps_the_phase_of_the_odd_ones():
    element, a = epp.Play(gap=1.0), 2.0
    H = epp.sinusoidal_harmonics(element, a, order=5)[0]
    assert H[[0, 2, 4]] == pytest.approx([0, 0, 0], abs=1e-12)
    memory, y = None, []
    x = a * np.sin(2.0 * np.pi * (np.arange(2 * 4000) + 0.5) / 4000)
    for value in x:
        out, memory = element.output(value, memory)
        y.append(out)
    phase = 2.0 * np.pi * (np.arange(4000) + 0.5) / 4000
    settled = np.array(y[4000:])
    for k in (1, 3, 5):
        assert H[k] == pytest.approx(2j * np.mean(settled * np.exp(-1j * k * phase)) / a, abs=1e-4)


def test_bad_arguments_are_refused():
    with pytest.raises(ModelError, match="amplitude"):
        epp.sinusoidal_harmonics(epp.Relay(), 0.0)
    with pytest.raises(ModelError, match="omega"):
        epp.sinusoidal_harmonics(epp.Relay(), 1.0, omega=-1.0)
