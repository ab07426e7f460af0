"""Smoothed elements against closed forms, and against quadrature in the other order of the two means."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipe

import eppanalysis as epp
from tests.shared import mostly_slow

SWEPT = (epp.Relay(), epp.Saturation(), epp.DeadZone(), epp.RelayDeadZone(threshold=0.7), epp.Cube(1.0))


def mean_over_time(element: epp.Nonlinearity, x: float, dither: float, wave: str) -> float:
    """Mean output over a period of the dither, by quadrature of the element's own map between its breakpoints."""

    def at(place: float) -> float:
        ride = np.sin(place) if wave == "sine" else place
        return float(np.asarray(element.output(x + dither * ride)[0]))

    inside = [p for p in (element.breakpoints - x) / dither if abs(p) < 1]
    end = 0.5 * np.pi if wave == "sine" else 1.0
    marks = [-end, *sorted(np.arcsin(inside) if wave == "sine" else inside), end]
    parts = [quad(at, low, high, epsabs=1e-13)[0] for low, high in zip(marks[:-1], marks[1:], strict=True)]
    return float(sum(parts)) / (2.0 * end)


@pytest.mark.parametrize("wave", ["sine", "triangle"])
@pytest.mark.parametrize("element", SWEPT, ids=lambda e: type(e).__name__)
def test_the_effective_characteristic_is_the_mean_in_time(element: epp.Nonlinearity, wave: str) -> None:
    rng = np.random.default_rng(3)
    for x, dither in zip(rng.uniform(-2.0, 2.0, 6), 10.0 ** rng.uniform(-1.5, 1.0, 6), strict=True):
        known = mean_over_time(element, float(x), float(dither), wave)
        found = epp.smoothed(element, float(dither), wave).output(x)[0]
        assert float(found) == pytest.approx(known, abs=1e-9 * max(1.0, abs(known)))


@pytest.mark.parametrize("wave", ["sine", "triangle"])
@pytest.mark.parametrize("element", SWEPT, ids=lambda e: type(e).__name__)
def test_the_equivalent_gain_is_that_of_the_effective_characteristic(element: epp.Nonlinearity, wave: str) -> None:
    """The describing function is made of means over the bias; here the slow sine is the outer mean."""
    for a, b, dither in ((0.6, 0.2, 0.9), (2.3, -0.4, 0.5), (0.3, 1.1, 0.25)):
        one = epp.smoothed(element, dither, wave)
        corners = np.concatenate([element.breakpoints + s * dither - b for s in (-1.0, 0.0, 1.0)]) / a
        marks = np.array([-0.5 * np.pi, *np.sort(np.arcsin(corners[np.abs(corners) < 1])), 0.5 * np.pi])
        place, weight = np.polynomial.legendre.leggauss(60)
        middle, half = 0.5 * (marks[1:] + marks[:-1])[:, None], 0.5 * np.diff(marks)[:, None]
        # Roots at the corners are smooth in the angle of a sine across each stretch.
        phi = middle + half * np.sin(0.5 * np.pi * place)
        share = half * 0.5 * np.pi * np.cos(0.5 * np.pi * place) * weight / np.pi
        y = one.output(b + a * np.sin(phi))[0]
        mean, gain = one.describing_function(a, b)
        assert float(mean) == pytest.approx(float(np.sum(share * y)), abs=1e-9)
        assert complex(gain) == pytest.approx(2.0 * float(np.sum(share * y * np.sin(phi))) / a, abs=1e-9)


#: Frictions, and curves that are steep beside the dither, each with where it is.
STEEP = {
    "friction": (epp.Friction(1.0), 0.0),
    "static friction": (epp.Friction(1.0, static=1.6), 0.0),
    "falling friction": (epp.Friction(1.0, static=1.6, stribeck=3.0), 0.0),
    "Stribeck": (epp.StribeckFriction(0.38, 0.6, 0.1), 0.0),
    "narrow Stribeck": (epp.StribeckFriction(0.38, 0.6, 1e-4), 0.0),
    **{f"tanh {slope:g}": (epp.Tanh(level=1.0, slope=slope), 0.0) for slope in (3.0, 1e3, 1e6)},
    **{f"arctan {slope:g}": (epp.Arctan(level=1.0, slope=slope), 0.0) for slope in (3.0, 1e4)},
    "sine": (epp.Sine(scale=40.0), 0.0),
}


def mean_beside(element: epp.Nonlinearity, centre: float, x: float, dither: float, wave: str) -> float:
    """The same of one that is steep or jumps at a known place, from there outwards decade by decade."""
    end = 0.5 * np.pi if wave == "sine" else 1.0
    share = np.clip((centre - x) / dither, -1.0, 1.0)
    at, out = np.arcsin(share) if wave == "sine" else share, np.geomspace(1e-9, 4.0, 60)
    marks = np.unique(np.clip(np.concatenate([at - out, [at, -end, end], at + out]), -end, end))
    place, weight = np.polynomial.legendre.leggauss(20)
    half, middle = 0.5 * np.diff(marks)[:, None], 0.5 * (marks[1:] + marks[:-1])[:, None]
    phi = middle + half * place
    values = np.vectorize(lambda z: float(element.output(z)[0]))(x + dither * (np.sin(phi) if wave == "sine" else phi))
    return float(np.sum(half * weight * values)) / (2.0 * end)


@pytest.mark.parametrize("wave", mostly_slow(["sine", "triangle"], ["triangle"]))
@pytest.mark.parametrize("name", STEEP)
def test_steep_elements_are_their_mean_in_time(name: str, wave: str) -> None:
    """To the documented 1e-9, whether or not the element has breakpoints."""
    element, centre = STEEP[name]
    one = epp.smoothed(element, 0.7, wave)
    for x in (-0.69, -0.1, 0.0, 1e-4, 0.33, 0.9):
        assert float(one.output(x)[0]) == pytest.approx(mean_beside(element, centre, x, 0.7, wave), abs=1e-9)


@pytest.mark.parametrize("wave", ["sine", "triangle"])
def test_friction_is_smoothed_as_the_map_of_the_same_force(wave: str) -> None:
    """Dry friction and a relay of its level have one map, and one describing function."""
    found, known = (epp.smoothed(e, 0.7, wave) for e in (epp.Friction(1.0), epp.Coulomb(1.0)))
    x = np.linspace(-1.0, 1.0, 41)
    assert found.output(x)[0] == pytest.approx(known.output(x)[0], abs=1e-12)
    assert found.output(-0.1)[0] == pytest.approx(2.0 / np.pi * np.arcsin(-1.0 / 7.0) if wave == "sine" else -1.0 / 7.0)
    given = np.array([0.05, 0.3, 0.7, 2.0]), np.array([0.0, 0.2, -0.5, 0.9])
    for one, other in zip(found.describing_function(*given), known.describing_function(*given), strict=True):
        assert one == pytest.approx(other, abs=1e-9)


def test_closed_forms_of_a_relay() -> None:
    """Under a triangle a saturation, exactly; under a sine the arcsine, with the small-signal gain 2/(pi A)."""
    triangle, sine = epp.smoothed(epp.Relay(), 0.5, "triangle"), epp.smoothed(epp.Relay(), 0.5)
    a = np.geomspace(1e-4, 1e3, 40)
    saturation = epp.Saturation(lower=-1.0, upper=1.0, slope=2.0)
    np.testing.assert_allclose(triangle.describing_function(a)[1], saturation.describing_function(a)[1], rtol=1e-9)
    x = np.linspace(-0.8, 0.8, 33)
    known = 2.0 / np.pi * np.arcsin(np.clip(x / 0.5, -1.0, 1.0))
    np.testing.assert_allclose(sine.output(x)[0], known, atol=1e-12)
    assert complex(sine.describing_function(0.0)[1]) == pytest.approx(4.0 / np.pi, rel=1e-9)
    a = np.linspace(0.5, 3.0, 26)
    known = 8.0 / (np.pi**2 * a) * ellipe(0.25 / a**2)
    np.testing.assert_allclose(sine.describing_function(a)[1].real, known, rtol=1e-9)
    # Far beyond the dither nothing of it is left.
    assert complex(sine.describing_function(1e6)[1]) == pytest.approx(4.0 / (np.pi * 1e6), rel=1e-9)


def test_a_play_loses_the_width_of_the_dither() -> None:
    """A slow sine with a fast one on it, followed in time: the mean output is that of a narrower play."""
    dither, turns = 0.2, 150
    phase = np.linspace(0.0, 4.0 * np.pi, 2 * turns * 60 + 1)
    x = 1.5 * np.sin(phase)
    full, narrow, memory, other = epp.Play(gap=1.0), epp.smoothed(epp.Play(gap=1.0), dither), None, None
    y, z = np.empty_like(x), np.empty_like(x)
    for k, value in enumerate(x + dither * np.sin(turns * phase)):
        y[k], memory = full.output(value, memory)
        z[k], other = narrow.output(x[k], other)
    means = (y[1:] - z[1:]).reshape(2 * turns, -1).mean(axis=1)[turns:]
    # As far as the slow sine moves, at most, while the dither runs through a period.
    assert np.max(np.abs(means)) < 1.5 * 2.0 * np.pi / turns
    assert epp.smoothed(epp.Play(gap=1.0), 0.5).output(0.3)[0] == 0.3


def test_what_is_not_covered_is_refused() -> None:
    with pytest.raises(
        epp.EppError, match="has memory, or several inputs; expected an element without memory, or a play"
    ):
        epp.smoothed(epp.HysteresisRelay(lower=-0.1, upper=0.1), 1.0)
    with pytest.raises(epp.EppError, match="expected a positive number"):
        epp.smoothed(epp.Relay(), 0.0)
