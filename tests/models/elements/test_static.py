"""Static elements and friction: closed-form describing functions against quadrature of their own maps, limits, laws."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time
from dataclasses import FrozenInstanceError, replace
from itertools import product

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier, fourier_adaptive

numbers = st.floats(-3, 3, allow_subnormal=False)
positive = st.floats(0.01, 3)
amplitudes = st.floats(1e-3, 20)

FIVE_BANDS = epp.FiveBandLaw(slack=5.0, low=10.0, high=11.0, max=17.0, supply_voltage=16.0)
ODD_SHAPES = [
    epp.Saturation(-0.5, 0.5, 2.0),
    epp.DeadZone(-0.7, 0.7, 3.0),
    epp.DeadZoneSaturation(1.0, 4.0, 2.0),
    epp.DeadZoneSaturation(0.0, 4.0, 2.0),
    epp.Relay(-2.0, 2.0),
    epp.RelayDeadZone(0.4, 1.5),
    epp.Preload(0.3, 1.0),
    epp.Quantiser(0.25, 5),
    epp.Coulomb(0.8),
    epp.FrictionCompensator(0.8),
    epp.FrictionCompensator(0.8, 0.4),
    epp.Cube(0.5),
    epp.Sine(1.3),
    epp.Friction(1.2),
    epp.Friction(0.0, static=1.2, stribeck=2.5),
]
ALL_SHAPES = [
    *ODD_SHAPES,
    FIVE_BANDS,
    epp.FiveBandLaw(5.0, 10.0, 11.0, 17.0, 16.0, offset_voltage=3.0),
    epp.Saturation(-0.5, 2.0),
    epp.DeadZone(0.2, 1.5, -2.0),
    epp.Relay(-1.0, 3.0, 0.5),
]
names = [f"{type(e).__name__}{i}" for i, e in enumerate(ALL_SHAPES)]


def rounding(element: epp.PiecewiseLinear, amplitude: float, bias: float) -> float:
    """Absolute rounding of the map: its terms slope*x and intercept may nearly cancel."""
    reach = np.abs(element.slopes).max() * (amplitude + abs(bias))
    return 1e-14 * float(reach + np.abs(element.intercepts).max())


def check(element: epp.PiecewiseLinear, amplitude: float, bias: float) -> None:
    witness = fourier(element, amplitude, bias, crossings(element.breakpoints, amplitude, bias))
    answer = element.describing_function(amplitude, bias)
    assert answer[1].imag == 0
    assert_agrees(answer, witness, amplitude, rounding=rounding(element, amplitude, bias))


@st.composite
def piecewise(draw: st.DrawFn) -> epp.PiecewiseLinear:
    widths = draw(st.lists(positive, max_size=6))
    count = len(widths)
    slopes, offsets = (draw(st.lists(numbers, min_size=count + 1, max_size=count + 1)) for _ in range(2))
    return epp.PiecewiseLinear(draw(numbers) + np.cumsum(widths), slopes, offsets)


@given(piecewise(), amplitudes, numbers)
def test_piecewise_linear_matches_quadrature(element: epp.PiecewiseLinear, amplitude: float, bias: float) -> None:
    check(element, amplitude, bias)


@settings(max_examples=40)
@given(st.lists(positive, min_size=4, max_size=4), numbers, positive, st.floats(0, 1), amplitudes, numbers)
def test_five_bands_match_quadrature(
    widths: list[float], start: float, supply: float, offset: float, amplitude: float, bias: float
) -> None:
    edges = (start + np.cumsum(widths)).tolist()
    check(epp.FiveBandLaw(*edges, supply, offset * supply), amplitude, bias)


@pytest.mark.parametrize("element", [e for e in ALL_SHAPES if isinstance(e, epp.PiecewiseLinear)], ids=repr)
def test_named_shapes_match_quadrature(element: epp.PiecewiseLinear) -> None:
    for amplitude, bias in product((0.02, 0.8, 5.0, 40.0), (0.0, 0.3, -1.1, 12.0)):
        check(element, amplitude, bias)


@given(st.floats(-2, 2), amplitudes, numbers)
def test_smooth_shapes_match_quadrature(scale: float, amplitude: float, bias: float) -> None:
    for element in (epp.Cube(scale), epp.Sine(scale)):
        answer = element.describing_function(amplitude, bias)
        assert_agrees(answer, fourier(element, amplitude, bias), amplitude)


@settings(max_examples=60)
@given(positive, st.floats(1e-3, 200), amplitudes, numbers)
@example(static=1.0, fall=1.0, amplitude=1.0, bias=2.0)
@example(static=1.0, fall=1.0, amplitude=2.0, bias=1.0)
def test_stribeck_friction_matches_quadrature(static: float, fall: float, amplitude: float, bias: float) -> None:
    element = epp.Friction(0.0, static=static, stribeck=fall)
    switches = crossings([0.0], amplitude, bias)
    # Geometric panels towards standstill, where the force falls within 1/(stribeck*amplitude) rad.
    layers = [s + sign * 0.5**k for s in switches for sign in (-1, 1) for k in range(1, 16)]
    witness = fourier_adaptive(element, amplitude, bias, [*switches, *layers])
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude)


@pytest.mark.parametrize("half_range", [1e-12, 1e-3, 0.0499, 0.0501, 0.9999999, 1.0, 1.0000001, 30.0])
@pytest.mark.parametrize("ratio", [0.0, 0.5, -0.99, 0.999999, 1.0, -1.0, 1.000001, 4.0])
def test_stribeck_closed_form_is_smooth_where_it_changes_form(half_range: float, ratio: float) -> None:
    element, amplitude = epp.Friction(0.0, static=1.0, stribeck=half_range / 2), 2.0
    bias = ratio * amplitude
    switches = crossings([0.0], amplitude, bias)
    layers = [s + sign * 0.5**k for s in switches for sign in (-1, 1) for k in range(1, 16)]
    witness = fourier_adaptive(element, amplitude, bias, [*switches, *layers])
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude, 2e-12)


def test_published_formulas_without_bias() -> None:
    # Gelb and Vander Velde 1968: saturation, dead zone, relays, Coulomb friction and line, cube, quantiser.
    a = np.array([0.3, 1.0, 1.7, 12.0])
    ratio = np.minimum(1 / a, 1)
    saturation = 2 / np.pi * (np.arcsin(ratio) + ratio * np.sqrt(1 - ratio**2))
    closed = {
        epp.Saturation(): saturation,
        epp.DeadZone(): 1 - saturation,
        epp.Relay(): 4 / (np.pi * a),
        epp.RelayDeadZone(1.0): 4 / (np.pi * a) * np.sqrt(1 - ratio**2),
        epp.Preload(0.5, 2.0): 2 + 4 * 0.5 / (np.pi * a),
        epp.Coulomb(0.5): 4 * 0.5 / (np.pi * a),
        epp.Friction(0.5, static=0.7): 4 * 0.5 / (np.pi * a),
        epp.Cube(2.0): 2 * 0.75 * a**2,
    }
    for element, expected in closed.items():
        mean, gain = element.describing_function(a)
        np.testing.assert_allclose(gain, expected, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(mean, 0, atol=1e-15)
    treads = [0.5, 1.5, 2.5, 3.5]
    expected = sum(4 / (np.pi * a) * np.sqrt(np.maximum(1 - (d / a) ** 2, 0)) for d in treads)
    np.testing.assert_allclose(epp.Quantiser(1.0, 4).describing_function(a)[1], expected, rtol=1e-13)


def test_published_limit_cycles_balance() -> None:
    """Solutions of 1 + N G = 0 from the literature's loops, found independently (omega, amplitude, element, gain)."""
    two_cycles = epp.DeadZoneSaturation(1.0, 4.0, 2.0)
    for amplitude in (1.2930089342295261, 4.923677709995772):
        s = 1j * 1.7320508075688767
        loop = (24 * s + 6) / (s**4 + 4 * s**3 + 4 * s**2)
        assert abs(1 + loop * two_cycles.describing_function(amplitude)[1]) < 1e-12
    for amplitude in (0.5697547549058886, 1.0428670390085437, 1.7332891371457004, 1.784370646926711):
        gain = epp.Quantiser(1.0, 8).describing_function(amplitude)[1]
        assert gain == pytest.approx(6 / 5.6, rel=1e-12)
    mean, gain = epp.Saturation(-0.5, 2.0).describing_function(2.798229231045058, -1.0530530870594652)
    s = 1j * 1.414213562373095
    assert abs(1 + 8 * gain / (s**3 + 2 * s**2 + 2 * s + 1)) < 1e-12
    assert 8 * mean == pytest.approx(1.0530530870594652, rel=1e-12)  # bias = -G(0) mean


def test_large_amplitudes_keep_relative_accuracy() -> None:
    a = np.array([1e4, 1e8, 1e15])
    _, gain = epp.Saturation().describing_function(a)
    np.testing.assert_allclose(gain, 4 / (np.pi * a) * (1 - 1 / (6 * a**2)), rtol=1e-14)
    # One steep band far from the bias: y jumps by 2 within a millionth of the amplitude.
    steep = epp.Saturation(-1.0, 1.0, 1e6)
    mean, gain = steep.describing_function(1e3, 500.0)
    np.testing.assert_allclose(gain, 4 / (np.pi * 1e3) * np.sqrt(0.75), rtol=1e-14)
    np.testing.assert_allclose(mean, 2 / np.pi * np.arcsin(0.5), rtol=1e-14)
    _, gain = epp.DeadZone().describing_function(a)
    np.testing.assert_allclose(gain, 1 - 4 / (np.pi * a), rtol=1e-6 / a[0])
    _, gain = epp.Quantiser(1e-3, 2048).describing_function(1.0)
    assert gain == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("k", [10, 26, 40])
def test_just_above_a_threshold_relative_accuracy_is_kept(k: int) -> None:
    excess = 0.5**k
    theta = 2 * np.arctan(np.sqrt(excess / (2 + excess)))  # arccos(1/A) for A = 1 + excess
    series = theta**3 * (2 / 3 - 2 * theta**2 / 15 + 4 * theta**4 / 315)
    _, gain = epp.DeadZone().describing_function(1 + excess)
    np.testing.assert_allclose(gain, 2 / np.pi * series, rtol=1e-10)
    mean, _ = epp.DeadZone().describing_function(excess, 1.0)  # oscillates half inside the zone
    np.testing.assert_allclose(mean, excess / np.pi, rtol=1e-14)
    mean, gain = epp.DeadZone(-5.0, 1.0).describing_function(1 + excess)  # only the upper edge is reached
    np.testing.assert_allclose(gain, series / np.pi, rtol=1e-10)
    lever = theta**3 * (1 / 3 - theta**2 / 30 + theta**4 / 840)
    np.testing.assert_allclose(mean, (1 + excess) / np.pi * lever, rtol=1e-10)


@pytest.mark.parametrize(
    "element", [epp.Quantiser(0.37, 2000), epp.FloorQuantiser(1e-3, 700), epp.MidRiseQuantiser(20.0, 400)]
)
def test_a_staircase_is_the_sum_of_its_steps(element: epp.PiecewiseLinear) -> None:
    """Term by term in extended precision; few and many steps, at edges, just past them and beyond the last one."""
    rng, edges = np.random.default_rng(5), element.breakpoints
    step, reach = edges[1] - edges[0], float(edges[-1] - edges[0])
    bias = np.concatenate([rng.uniform(-0.3, 0.3, 40) * reach, rng.choice(edges, 20), np.zeros(4)])
    amplitude = reach * np.exp(rng.uniform(np.log(0.05), np.log(2.0), bias.size))
    amplitude[::4] = np.abs(edges[len(edges) // 2 + 220] - bias[::4]) + 1e-8 * reach
    _, gain = element.describing_function(amplitude, bias)
    described = element.described_with_slopes(amplitude, bias)
    assert described is not None
    mean, _, by = described
    for a, b, found in zip(amplitude, bias, np.array([gain.real, mean, *by]).T, strict=True):
        t = edges.astype(np.longdouble) - b
        t, A = t[np.abs(t) < a], np.longdouble(a)
        root, sides = np.sqrt((A - t) * (A + t)), np.sign(t)
        level = (element.output(np.nextafter(b, -np.inf))[0] + element.output(np.nextafter(b, np.inf))[0]) / 2
        angles = (sides * np.arccos(np.abs(t) / A)).sum()
        exact = [2 * root.sum() / A**2, level * np.pi / step + angles, (1 / root).sum(), (t / root).sum() / A]
        scale = [exact[0], (A + abs(b)) / step, exact[2], exact[2]]
        error = np.abs(found - step / np.pi * np.array(exact, float)) / (step / np.pi * np.array(scale, float))
        # Just past an edge the slopes of the mean hang on how far, which rounding tells to so many digits only.
        near = 1e-6 if np.min(a - np.abs(t)) < 1e-6 * a else 1e-13
        assert np.all(error < [1e-13, 1e-13, near, near])


def test_a_staircase_takes_no_longer_where_it_has_more_steps() -> None:
    def seconds(levels: int) -> float:
        element, amplitude = epp.Quantiser(1.0, levels), levels * np.linspace(0.3, 0.9, 500)
        element.describing_function(amplitude)
        begun = time.perf_counter()
        element.describing_function(amplitude, 0.1)
        return time.perf_counter() - begun

    assert seconds(80_000) < 20 * seconds(400)


def test_below_and_at_the_threshold() -> None:
    for a in (1e-9, 0.5, 1.0):
        for element in (epp.DeadZone(), epp.RelayDeadZone(1.0), epp.Quantiser(2.0, 3)):
            mean, gain = element.describing_function(a)
            assert mean == 0
            assert gain == 0
        mean, gain = epp.Saturation().describing_function(a)
        assert mean == 0
        assert gain == pytest.approx(1, abs=1e-15)
    mean, gain = FIVE_BANDS.describing_function(0.5, [3.0, 7.5, 10.5, 30.0])
    np.testing.assert_allclose(mean, [-16, -8, 0, 16], atol=1e-14)
    np.testing.assert_allclose(gain, [0, 3.2, 0, 0], atol=1e-14)


def test_zero_amplitude_is_the_slope_at_the_bias() -> None:
    mean, gain = FIVE_BANDS.describing_function(0.0, [7.5, 10.0, 10.5])
    np.testing.assert_allclose(mean, [-8, 0, 0], atol=1e-14)
    np.testing.assert_allclose(gain, [3.2, 1.6, 0])
    assert epp.Relay(-1.0, 3.0).describing_function(0.0)[0] == 1
    assert epp.Relay(-1.0, 3.0).describing_function(0.0)[1] == np.inf
    assert epp.Relay(3.0, -1.0).describing_function(0.0)[1] == -np.inf
    friction = epp.Friction(0.0, static=2.0, stribeck=3.0)
    assert friction.describing_function(0.0)[1] == np.inf
    mean, gain = friction.describing_function(0.0, [1.0, -1.0])
    np.testing.assert_allclose(mean, [0.5, -0.5])
    np.testing.assert_allclose(gain, -2 * 3 / 16)
    assert epp.Sine(2.0).describing_function(0.0)[1] == 2


@pytest.mark.parametrize("element", ODD_SHAPES, ids=repr)
@given(a=amplitudes, b=numbers)
@settings(max_examples=25)
def test_odd_maps_have_odd_mean_and_even_gain(element: epp.PiecewiseLinear, a: float, b: float) -> None:
    mean, gain = element.describing_function(a, [b, -b, 0.0])
    scale = abs(gain[0]) * a + abs(mean[0])
    np.testing.assert_allclose(mean[0], -mean[1], atol=1e-13 * scale)
    np.testing.assert_allclose(gain[0], gain[1], atol=1e-13 * scale / a)
    np.testing.assert_allclose(mean[2], 0, atol=1e-13 * (abs(gain[2]) * a))


@given(piecewise(), amplitudes, numbers, st.floats(1e-6, 1e6))
def test_unit_of_the_input_does_not_matter(element: epp.PiecewiseLinear, a: float, b: float, unit: float) -> None:
    other = epp.PiecewiseLinear(element.breakpoints * unit, element.slopes / unit, element.intercepts)
    mean, gain = element.describing_function(a, b)
    other_mean, other_gain = other.describing_function(a * unit, b * unit)
    # A bias that falls exactly on a jump in one unit may stand beside it in the other: by rounding, so skip the mean.
    scale = np.abs(element.slopes).max() * (a + abs(b)) + np.abs(element.intercepts).max() * (1 + 1 / a)
    np.testing.assert_allclose(other_gain * unit, gain, atol=1e-12 * scale * (1 + 1 / a))
    np.testing.assert_allclose(other_mean, mean, atol=1e-6 * scale)


@given(piecewise(), piecewise(), amplitudes, numbers)
def test_describing_functions_add(one: epp.PiecewiseLinear, two: epp.PiecewiseLinear, a: float, b: float) -> None:
    edges = np.unique(np.concatenate([one.breakpoints, two.breakpoints]))
    middles = np.concatenate([edges[:1] - 1, (edges[1:] + edges[:-1]) / 2, edges[-1:] + 1]) if edges.size else [0.0]
    i, j = (np.searchsorted(e.breakpoints, middles) for e in (one, two))
    both = epp.PiecewiseLinear(edges, one.slopes[i] + two.slopes[j], one.intercepts[i] + two.intercepts[j])
    mean, gain = both.describing_function(a, b)
    scale = sum(np.abs(e.slopes).max() * (a + abs(b)) + np.abs(e.intercepts).max() for e in (one, two))
    for k, total in ((0, mean), (1, gain)):
        parts = one.describing_function(a, b)[k] + two.describing_function(a, b)[k]
        np.testing.assert_allclose(total, parts, atol=1e-12 * scale * (1 + 1 / a))


@given(piecewise(), amplitudes, numbers)
def test_gain_lies_within_the_slopes_of_a_continuous_map(element: epp.PiecewiseLinear, a: float, b: float) -> None:
    offsets = np.concatenate([[0.0], np.cumsum(-np.diff(element.slopes) * element.breakpoints)])
    continuous = epp.PiecewiseLinear(element.breakpoints, element.slopes, offsets)
    low, high = continuous.slope_bounds()
    assert low == element.slopes.min()
    assert high == element.slopes.max()
    gain = continuous.describing_function(a, b)[1].real
    slack = 1e-12 * max(abs(low), abs(high))
    assert low - slack <= gain <= high + slack


@given(piecewise())
def test_sector_holds_every_point_and_is_reached(element: epp.PiecewiseLinear) -> None:
    low, high = element.sector()
    near = element.breakpoints[:, None] + np.array([-1e-9, 0, 1e-9])
    x = np.concatenate([np.linspace(-20, 20, 400), near.ravel(), [-1e-7, 1e-7, -1e9, 1e9]])
    x = x[np.abs(x) > 1e-8]
    ratio = element.output(x)[0] / x
    slack = 1e-6 * (1 + np.abs(ratio).max())
    assert low - slack <= ratio.min()
    assert ratio.max() <= high + slack
    for bound, reached in ((low, ratio.min()), (high, ratio.max())):
        if np.isfinite(bound) and np.abs(element.breakpoints).min(initial=1) > 1e-3:
            assert abs(bound - reached) <= 1e-4 * (1 + abs(bound) + np.abs(element.intercepts).max())


def test_sectors_and_slopes_of_named_shapes() -> None:
    assert epp.Saturation(-2.0, 2.0, 3.0).sector() == (0, 3)
    assert epp.DeadZone().sector() == (0, 1)
    assert epp.DeadZoneSaturation(1.0, 4.0, 2.0).sector() == (0, pytest.approx(2 / 1.5))
    assert epp.Relay().sector() == (0, np.inf)
    assert epp.Relay().slope_bounds() == (0, np.inf)
    assert epp.Relay(1.0, -1.0).slope_bounds() == (-np.inf, 0)
    assert epp.RelayDeadZone(0.5, 2.0).sector() == (0, 4)
    assert epp.Quantiser(0.5, 10).sector() == (0, 2)
    assert epp.Preload(1.0, 2.0).sector() == (2, np.inf)
    assert FIVE_BANDS.slope_bounds() == (0, pytest.approx(3.2))
    assert FIVE_BANDS.sector() == (-np.inf, np.inf)  # it pulls back at zero force
    assert epp.Cube(2.0).sector() == (0, np.inf)
    assert epp.Cube(-2.0).slope_bounds() == (-np.inf, 0)
    x = np.linspace(1e-3, 60, 600001)
    low, high = epp.Sine(2.0).sector()
    assert low == pytest.approx(2 * (np.sin(x) / x).min(), rel=1e-9)
    assert high == 2
    assert epp.Sine(-2.0).slope_bounds() == (-2, 2)
    assert epp.Friction(1.0).slope_bounds() == (0, np.inf)
    assert epp.Friction(0.0, static=2.0, stribeck=3.0).slope_bounds() == (-6, np.inf)
    assert epp.Friction(0.0, static=2.0, stribeck=3.0).sector() == (0, np.inf)


def test_maps_are_what_they_are_called() -> None:
    x = np.array([-20.0, -3.0, -1.2, -0.6, -0.2, 0.0, 0.1, 0.6, 1.3, 3.0, 20.0])
    maps = {
        epp.Saturation(-0.5, 2.0, 3.0): np.clip(3 * x, -0.5, 2.0),
        epp.DeadZone(-0.5, 1.0, 2.0): 2 * (x - np.clip(x, -0.5, 1.0)),
        epp.DeadZoneSaturation(0.5, 2.0, 3.0): np.clip(2 * (x - np.clip(x, -0.5, 0.5)), -3, 3),
        epp.Relay(-1.0, 4.0, 0.05): np.where(x > 0.05, 4.0, -1.0),
        epp.RelayDeadZone(0.5, 2.0): 2 * np.sign(x) * (np.abs(x) > 0.5),
        epp.Preload(0.5, 2.0): 2 * x + 0.5 * np.sign(x),
        epp.Coulomb(0.5): 0.5 * np.sign(x),
        epp.Quantiser(0.5, 4): np.clip(0.5 * np.round(x / 0.5), -2, 2),
        epp.Cube(2.0): 2 * x**3,
        epp.Sine(2.0): 2 * np.sin(x),
        epp.Friction(2.0): 2 * np.sign(x),
        epp.Friction(0.0, 2.0, 3.0): 2 * np.sign(x) / (1 + 3 * np.abs(x)),
    }
    for element, expected in maps.items():
        y, memory = element.output(x, "kept")
        np.testing.assert_allclose(y, expected, atol=1e-14)
        assert memory == "kept"


def test_five_bands_follow_the_law() -> None:
    force = np.array([-3.0, 5.0, 6.0, 9.5, 10.0, 10.5, 11.0, 12.0, 16.0, 17.0, 30.0])
    volts = FIVE_BANDS.output(force)[0]
    extension, flexion = -16 * (10 - force) / 5, 16 * (force - 11) / 6
    expected = np.select([force <= 5, force < 10, force <= 11, force < 17], [-16, extension, 0, flexion], 16)
    np.testing.assert_allclose(volts, expected, atol=1e-14)
    offset = replace(FIVE_BANDS, offset_voltage=4.0)
    just = 1e-12
    edges = [10 - just, 10.0, 10 + just, 11.0, 11 + just, 17.0, 5.0]
    np.testing.assert_allclose(offset.output(edges)[0], [-4, -2, 0, 2, 4, 16, -16], atol=1e-9)
    assert not FIVE_BANDS.jumps.any()
    np.testing.assert_allclose(offset.jumps, [0, 4, 4, 0])


def test_a_jump_returns_its_midpoint() -> None:
    assert epp.Relay(-1.0, 3.0, 0.5).output(0.5)[0] == 1
    assert epp.Coulomb(2.0).output(0.0)[0] == 0
    assert epp.Friction(2.0).output(0.0)[0] == 0


def test_thresholds_are_distances_from_the_bias() -> None:
    np.testing.assert_allclose(FIVE_BANDS.thresholds(), [5, 10, 11, 17])
    np.testing.assert_allclose(FIVE_BANDS.thresholds(bias=10.0), [1, 5, 7])
    assert epp.Relay().thresholds().size == 0
    np.testing.assert_allclose(epp.DeadZone().thresholds(), [1])
    np.testing.assert_allclose(epp.Friction(0.0, 1.0, 4.0).thresholds(), [0.25])
    assert epp.Friction(1.0).thresholds().size == 0


def test_shapes_broadcast_and_nothing_finite_gives_nan() -> None:
    for element in ALL_SHAPES:
        a = np.array([0.0, 1e-300, 1e-12, 1.0, 1e8, 1e15])
        b = np.array([[0.0], [1.0], [-1e6]])
        mean, gain = element.describing_function(a, b)
        assert mean.shape == gain.shape == (3, 6)
        assert mean.dtype == float
        assert gain.dtype == complex
        assert not np.isnan(mean).any()
        assert not np.isnan(gain).any()
        mean, gain = element.describing_function(1.0)
        assert mean.shape == gain.shape == ()
        assert element.describing_function(np.ones((2, 1)), 0.0, np.ones(4))[0].shape == (2, 4)
        assert np.isnan(element.describing_function(np.nan)[1])
        assert isinstance(element.automaton(), epp.Automaton)
        with pytest.raises(ModelError, match="amplitude .* -1"):
            element.describing_function([-1.0, 2.0])


def test_elements_are_frozen_hashable_and_travel() -> None:
    for element in ALL_SHAPES:
        with pytest.raises(FrozenInstanceError):
            element.scale = 3.0
        copy = pickle.loads(pickle.dumps(element))
        assert copy == element
        assert hash(copy) == hash(element)
        assert copy.describing_function(1.0, 0.2) == element.describing_function(1.0, 0.2)
        assert type(element).__name__ in repr(element)


BAD = [
    (lambda: epp.PiecewiseLinear([0.0, 0.0], [0, 1, 0], [0, 0, 0]), "breakpoints is"),
    (lambda: epp.PiecewiseLinear([0.0], [0, 1, 0], [0, 0]), "slopes has shape"),
    (lambda: epp.PiecewiseLinear([0.0], [0, np.nan], [0, 0]), "slopes is"),
    (lambda: epp.FiveBandLaw(5.0, 4.0, 6.0, 7.0, 16.0), "low is 4.0; expected more than slack"),
    (lambda: epp.FiveBandLaw(1.0, 4.0, 4.0, 7.0, 16.0), "high is 4.0"),
    (lambda: epp.FiveBandLaw(1.0, 4.0, 5.0, 2.0, 16.0), "max is 2.0"),
    (lambda: epp.FiveBandLaw(1.0, 2.0, 3.0, 4.0, 0.0), "supply_voltage is 0.0"),
    (lambda: epp.FiveBandLaw(1.0, 2.0, 3.0, 4.0, 5.0, 6.0), "offset_voltage is 6.0"),
    (lambda: epp.FiveBandLaw(np.nan, 2.0, 3.0, 4.0, 5.0), "slack is nan; expected a finite number"),
    (lambda: epp.FiveBandLaw("1", 2.0, 3.0, 4.0, 5.0), "slack is '1'"),
    (lambda: epp.Saturation(1.0, -1.0), "upper is -1.0"),
    (lambda: epp.Saturation(slope=0.0), "slope is 0.0"),
    (lambda: epp.DeadZone(1.0, 1.0), "upper is 1.0"),
    (lambda: epp.DeadZone(slope=0.0), "slope is 0.0"),
    (lambda: epp.DeadZoneSaturation(-1.0, 1.0, 1.0), "dead_zone is -1.0"),
    (lambda: epp.DeadZoneSaturation(1.0, 0.0, 1.0), "slope is 0.0"),
    (lambda: epp.DeadZoneSaturation(1.0, 1.0, 0.0), "limit is 0.0"),
    (lambda: epp.Relay(high=np.inf), "high is inf"),
    (lambda: epp.RelayDeadZone(0.0), "threshold is 0.0"),
    (lambda: epp.Preload(np.nan, 1.0), "level is nan"),
    (lambda: epp.Coulomb(np.inf), "level is inf"),
    (lambda: epp.Quantiser(0.0, 3), "step is 0.0"),
    (lambda: epp.Quantiser(1.0, 0), "levels is 0"),
    (lambda: epp.Quantiser(1.0, 2.5), "levels is 2.5"),
    (lambda: epp.Cube(np.nan), "scale is nan"),
    (lambda: epp.Sine(True), "scale is True"),
    (lambda: epp.Friction(-1.0), "coulomb is -1.0"),
    (lambda: epp.Friction(1.0, static=0.5), "static is 0.5; expected at least coulomb"),
    (lambda: epp.Friction(1.0, stribeck=1.0), "static is None"),
    (lambda: epp.Friction(1.0, 1.0, -1.0), "stribeck is -1.0"),
    (lambda: epp.Friction(0.0, 0.0, 1.0), "static is 0.0"),
]


def test_invalid_fields_are_refused_in_one_sentence() -> None:
    for make, words in BAD:
        with pytest.raises(ModelError, match=words) as caught:
            make()
        assert str(caught.value).endswith(".")
        assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_importing_the_elements_loads_no_library_that_takes_long() -> None:
    dear = "casadi", "control", "matplotlib", "pandas", "scipy"
    code = f"import sys, eppanalysis.models.elements; sys.exit(not sys.modules.keys().isdisjoint({dear!r}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_quantiser_gives_levels_alone_also_at_ties():
    """A multiple of the step for any input, the nearest one; odd, though ties have two nearest ones."""
    rng = np.random.default_rng(3)
    for step, levels in ((1.0, 1000), (0.1, 7), (1 / 3, 50)):
        quantiser = epp.Quantiser(step, levels)
        x = np.concatenate([quantiser.breakpoints, rng.uniform(-1.2, 1.2, 400) * step * levels, [902.5, 0.0]])
        y = quantiser.output(x)[0]
        counts = np.round(y / step)
        assert np.array_equal(y, counts * step) and np.abs(counts).max() <= levels
        within = np.abs(x) <= (levels + 0.5) * step
        assert np.all(np.abs(y - x)[within] <= step / 2 * (1 + 1e-12) + 1e-13 * np.abs(x[within]))
        assert np.array_equal(quantiser.output(-x)[0], -y)
    assert epp.Quantiser(1.0, 1000).output(902.5)[0] == 903.0


@pytest.mark.parametrize(
    "element",
    [
        epp.Relay(),
        epp.RelayDeadZone(1.0),
        epp.Saturation(-1.0, 2.0),
        epp.DeadZone(-0.5, 1.0),
        epp.FiveBandLaw(1.0, 2.0, 3.0, 4.5, 2.0),
    ],
)
def test_slopes_of_mean_and_gain_are_those_that_differences_tell(element) -> None:
    rng = np.random.default_rng(3)
    a, b, h = rng.uniform(0.1, 6.0, 400), rng.uniform(-3.0, 5.0, 400), 1e-6
    mean, gain, (level, sway) = element.described_with_slopes(a, b)
    assert np.array_equal((mean, gain), np.real(element.describing_function(a, b)))
    # Where it only just reaches a threshold it changes like a root, and differences tell little.
    clear = np.abs(np.abs(b[:, None] - element.breakpoints) - a[:, None]).min(-1) > 1e-2
    told = (level, sway, 2.0 * sway / a, 2.0 * (level - gain) / a)
    for k, (exact, by) in enumerate(zip(told, ((0, h), (h, 0), (0, h), (h, 0)), strict=True)):
        up, down = (element.describing_function(a + s * by[0], b + s * by[1])[k // 2].real for s in (1, -1))
        np.testing.assert_allclose(exact[clear], ((up - down) / (2 * h))[clear], rtol=1e-5, atol=1e-7)
