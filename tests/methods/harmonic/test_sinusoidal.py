"""Higher-order sinusoidal-input describing functions against closed forms, quadrature and describing functions."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import ParkingBandLaw, SampledLaw
from tests.shared import mostly_slow
from tests.wrong_arguments import fields_of_elements

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


@pytest.mark.parametrize("kind, fields", list(fields_of_elements()), ids=lambda v: getattr(v, "kind", ""))
def test_of_every_element_the_first_harmonic_is_its_describing_function_or_it_is_refused(kind, fields):
    """Its own, whatever states it brings: not that of what is inside them."""
    element, omega = kind(**fields), 1.3
    try:
        H = epp.sinusoidal_harmonics(element, 2.7, bias=0.1, omega=omega, order=3)
    except ModelError:
        assert element.own_states is not None or element.n_inputs > 1
        return
    dynamic = element.of_frequency or element.n_inputs > 1
    mean, gain = element.describing_function(2.7, 0.1, *[omega] * dynamic)
    assert H[:, 1] == pytest.approx(np.atleast_1d(gain), abs=1e-9)
    assert H[:, 0] * 2.7 == pytest.approx(np.atleast_1d(mean), abs=1e-9)


@pytest.mark.parametrize("amplitude, omega", [(0.3, 0.5), (2.0, 3.0)])
def test_the_integrator_of_clegg_has_odd_harmonics_as_one_over_their_number(amplitude, omega):
    """N = (4/pi omega)(1 - j pi/4), and 4/(pi n omega) of the odd ones up to the fifteenth."""
    odd = np.arange(16) % 2
    expected = 4.0 / (np.pi * omega * np.maximum(np.arange(16), 1)) * odd
    found = epp.sinusoidal_harmonics(epp.CleggIntegrator(), amplitude, omega=omega, order=15)[0]
    assert found[1] == pytest.approx(4.0 / (np.pi * omega) * (1.0 - 0.25j * np.pi), rel=1e-14)
    assert found[2:] == pytest.approx(expected[2:], abs=1e-14 / omega)


def test_an_integrator_that_is_never_reset_has_no_mean():
    with pytest.raises(epp.EppError, match="mean"):
        epp.sinusoidal_harmonics(epp.CleggIntegrator(), 1.0, bias=2.0)


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


PARKING = ParkingBandLaw(epp.FiveBandLaw(slack=1.0, low=2.0, high=2.5, max=4.0, supply_voltage=16.0), dwell_time=0.02)


def in_time(element, amplitude, bias, omega):
    """Mean and fundamental of an element with a clock, run over three periods in small steps; of the last one."""
    n, memory, y = 20_000, None, []
    phase = (np.arange(3 * n) + 0.5) * 2.0 * np.pi / n
    for phi in phase:
        value, memory = element.output((bias + amplitude * np.sin(phi), phi / omega), memory)
        y.append(float(value))
    last, phi = np.array(y[2 * n :]), phase[2 * n :]
    return last.mean(), 2j * np.mean(last * np.exp(-1j * phi)) / amplitude


@pytest.mark.parametrize("omega", mostly_slow([1.0, 5.0, 20.0, 60.0], [5.0]))
@pytest.mark.parametrize(("amplitude", "bias"), [(1.6, 2.3), (0.8, 2.4)])
def test_a_clock_that_an_element_declares_is_its_clock(omega, amplitude, bias):
    """Not the rate of its input: it parks where it dwells too long, which hangs on the frequency."""
    H = epp.sinusoidal_harmonics(PARKING, amplitude, bias=bias, omega=omega, order=5)
    mean, gain = PARKING.describing_function(amplitude, bias, omega)
    assert (amplitude * H[0, 0].real, H[0, 1]) == pytest.approx((float(mean), complex(gain)), abs=1e-9)
    known, fundamental = in_time(PARKING, amplitude, bias, omega)
    assert amplitude * H[0, 0].real == pytest.approx(known, abs=5e-3)
    assert H[0, 1] == pytest.approx(fundamental, abs=5e-3)


def test_a_sampled_law_answers_where_its_clock_comes_round_with_the_input():
    """Its samples come at the same phases then, one at phase zero; else it does not repeat itself."""
    law, n = SampledLaw(epp.PiecewiseLinear([0.0], [1.0, 1.0], [0.0, 0.0]), period=0.1), 8
    H = epp.sinusoidal_harmonics(law, 1.0, omega=2.0 * np.pi / (n * 0.1), order=5)
    held = np.exp(-1j * np.pi / n) * np.sinc(1.0 / n)
    assert H[0, 1] == pytest.approx(held, abs=1e-9)
    with pytest.raises(epp.EppError, match="period"):
        epp.sinusoidal_harmonics(law, 1.0, omega=7.0, order=5)
