"""Friction with a viscous part and the Stribeck curve: describing functions, stick-slip against another integrator."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.special import erfi

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.coefficients import respond
from eppanalysis.methods.harmonic.elements import PeriodicElement
from tests.models.elements.quadrature import assert_agrees, crossings, fourier, fourier_adaptive
from tests.shared import mostly_slow

positive, amplitudes, numbers = st.floats(0.01, 3), st.floats(1e-3, 20), st.floats(-3, 3)


@given(st.floats(0, 3), st.floats(0, 3), amplitudes, numbers)
def test_viscous_and_coulomb_match_quadrature(coulomb: float, viscous: float, amplitude: float, bias: float) -> None:
    element = epp.ViscousCoulomb(coulomb, viscous)
    witness = fourier(element, amplitude, bias, crossings([0.0], amplitude, bias))
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 3), positive, st.floats(0.003, 3), st.floats(0, 2), amplitudes, st.just(0.0) | numbers)
def test_stribeck_matches_quadrature(
    coulomb: float, excess: float, velocity: float, viscous: float, amplitude: float, bias: float
) -> None:
    element = epp.StribeckFriction(coulomb, coulomb + excess, velocity, viscous)
    switches = crossings([0.0], amplitude, bias)
    near = [*switches, -np.pi / 2, np.pi / 2]
    layers = [s + sign * 0.5**k for s in near for sign in (-1, 1) for k in range(1, 16)]
    witness = fourier_adaptive(element, amplitude, bias, [*switches, *layers])
    assert_agrees(element.describing_function(amplitude, bias), witness, amplitude)


@pytest.mark.parametrize(
    ("shape", "velocity", "amplitude", "bias"),
    [(0.5, 0.3, 2.0, 0.4), (1.0, 0.01, 1.0, 0.0), (1.5, 0.2, 3.0, -1.0), (3.0, 0.1, 0.3, 0.0), (6.0, 0.05, 2.0, 0.5)],
)
def test_other_shapes_match_quadrature(shape: float, velocity: float, amplitude: float, bias: float) -> None:
    element = epp.StribeckFriction(0.4, 1.7, velocity, 0.2, shape)

    def force(phi: float) -> float:
        return float(element.output(bias + amplitude * np.sin(phi))[0])

    rest = -np.arcsin(bias / amplitude)
    steps = np.pi * 0.5 ** np.arange(0, 40)
    near = np.clip(np.concatenate([rest - steps, [rest], rest + steps]), -np.pi / 2, np.pi / 2)
    mean = sum(quad(force, *ends, epsabs=1e-13)[0] for ends in pairwise(np.unique(near))) / np.pi
    wave = sum(quad(lambda p: force(p) * np.sin(p), *ends, epsabs=1e-13)[0] for ends in pairwise(np.unique(near)))
    found = element.describing_function(amplitude, bias)
    assert found[0] == pytest.approx(mean, rel=1e-9, abs=1e-9)
    assert found[1] * amplitude == pytest.approx(2 * wave / np.pi, rel=1e-9)


def test_formula_without_bias_and_limits() -> None:
    # By u = cos(phi): the integral of sin exp(-p^2 sin^2) from 0 to pi is exp(-p^2) sqrt(pi) erfi(p)/p.
    p = np.array([0.1, 1.0, 4.0])
    gain = epp.StribeckFriction(0.0, 1.0, 0.5).describing_function(0.5 * p)[1]
    closed = 2 / np.pi * np.exp(-(p**2)) * np.sqrt(np.pi) * erfi(p) / p / (0.5 * p)
    np.testing.assert_allclose(gain, closed, rtol=1e-12)
    element = epp.StribeckFriction(1.0, 1.5, 0.2, 0.3)
    mean, gain = element.describing_function(0.0, [0.0, 0.1, -0.1])
    assert gain[0] == np.inf
    step = np.diff(element.output([0.1 - 1e-6, 0.1 + 1e-6])[0])[0] / 2e-6
    np.testing.assert_allclose(gain[1:], step, rtol=1e-8)
    np.testing.assert_allclose(mean, element.output([0.0, 0.1, -0.1])[0], rtol=1e-12)
    plain, same = epp.StribeckFriction(1.0, 1.0, 0.2, 0.3), epp.ViscousCoulomb(1.0, 0.3)
    for one, other in zip(plain.describing_function(p, 0.2), same.describing_function(p, 0.2), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)
    assert np.isnan(element.describing_function([np.nan], 0.0)[1][0])


def dragged(element: epp.Nonlinearity, speed: float) -> epp.LureSystem:
    """A block on a belt (its velocity relative to the belt into the element), held by a spring and pushed."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [-4.0, 0.0]], [[0.0], [-1.0]], [[0.0, 1.0]], [element], constant_input=[-speed],
        x0=[0.0, 0.0], element_names=["friction"],
    )  # fmt: skip


def slid_by_hand(element: epp.StribeckFriction, speed: float, times: np.ndarray) -> np.ndarray:
    """Position and velocity of the block: carried along until the spring breaks it away, then sliding."""
    t, v, found, stuck = 0.0, np.array([0.0, 0.0]), [], False
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "dense_output": True}
    while t < times[-1]:
        if stuck:
            end = t + max(0.0, (element.static / 4.0 - v[0]) / speed)
            inside = times[(times >= t) & (times < min(end, times[-1] + 1.0))]
            found += [[v[0] + speed * (s - t), speed] for s in inside]
            t, v, stuck = end, np.array([v[0] + speed * (end - t), speed - 1e-15]), False
            continue
        sign = np.sign(v[1] - speed)

        def rates(s: float, v: np.ndarray, sign: float = sign) -> list[float]:
            rest = v[1] - speed
            dry = element.coulomb + (element.static - element.coulomb) * np.exp(
                -(abs(rest / element.velocity) ** element.shape)
            )
            return [v[1], -4.0 * v[0] - sign * dry - element.viscous * rest]

        def meets(s: float, v: np.ndarray) -> float:
            return v[1] - speed

        meets.terminal, meets.direction = True, -sign  # type: ignore[attr-defined]
        run = solve_ivp(rates, (t, times[-1]), v, events=meets, **options)
        last = run.t[-1] == times[-1]
        inside = times[(times >= t) & ((times < run.t[-1]) | last)]
        found += run.sol(inside).T.tolist()
        t, v, stuck = run.t[-1], run.y[:, -1], True
        if last:
            break
    return np.array(found)


@pytest.mark.parametrize("shape", [0.5, 0.9, 1.0, 1.5, 2.0, 3.0, 4.5, 5.0, 6.0])
def test_a_block_that_sticks_and_slips_against_another_integrator(shape: float) -> None:
    element, speed = epp.StribeckFriction(1.0, 2.0, 0.3, 0.05, shape), 0.4
    times = np.linspace(0.0, 12.0, 241)
    run = epp.simulate(dragged(element, speed), t_end=12.0, t_eval=times)
    position, velocity = slid_by_hand(element, speed, times).T
    assert position.shape == times.shape
    np.testing.assert_allclose(run.signals["friction_input"], velocity - speed, atol=1e-8)
    stuck = run.signals["friction_input"] == 0.0
    assert stuck.sum() > 20 and (~stuck).sum() > 20
    # At rest on the belt friction holds what the spring pulls.
    np.testing.assert_allclose(run.signals["friction_output"][stuck], -4.0 * position[stuck], atol=1e-8)


@pytest.mark.parametrize("shape", mostly_slow([0.5, 1.0, 1.5, 3.0, 5.0], [1.5]))
def test_orbit_of_another_shape(shape: float) -> None:
    """A stable cycle on a belt: its orbit is what a long run comes to."""
    system = dragged(epp.StribeckFriction(1.0, 2.0, 0.3, 0.05, shape), 0.4)
    run = epp.simulate(system, t_end=40.0)
    orbit = epp.exact_orbit(system, run.limit_cycle)
    assert orbit.period == pytest.approx(run.limit_cycle.period, rel=1e-6)
    by_hand = slid_by_hand(system.elements[0], 0.4, np.linspace(0.0, 40.0, 8001))[6000:, 1]
    assert np.ptp(by_hand) == pytest.approx(orbit.peak_to_peak["friction_input"], rel=1e-5)


@pytest.mark.parametrize("shape", [0.3, 0.5, 0.8])
def test_it_leaves_rest_as_the_equation_of_its_own_curve_does(shape: float) -> None:
    """Pulled just over the edge, ``dv/dt = rise + |v|**shape``: the time to a velocity by quadrature."""
    rise, drop = 1e-4, 0.01
    element = epp.StribeckFriction(1.0, 2.0, 1.0, 0.0, shape)
    loop = epp.LureSystem.build(
        [[0.0]], [[-1.0]], [[1.0]], [element], constant_state=[2.0 + rise], x0=[0.0], element_names=["friction"]
    )

    def slowness(p: float) -> float:  # in the power p = v**(1 - shape), of which the begin is no root
        v = p ** (1 / (1 - shape))
        return v**shape / (rise - np.expm1(-(v**shape))) / (1 - shape)

    edges = np.concatenate([[0.0], np.geomspace(1e-9, drop ** (1 - shape), 40)])
    taken = sum(quad(slowness, *ends, epsabs=0.0, epsrel=1e-12)[0] for ends in pairwise(edges))
    run = epp.simulate(loop, t_end=2.0 * taken, t_eval=[taken])
    assert run.signals["friction_input"][0] == pytest.approx(drop, rel=1e-7)


@pytest.mark.parametrize("shape", [0.5, 1.5])
def test_a_fractional_shape_mirrored_and_in_other_units(shape: float) -> None:
    times, k = np.linspace(0.0, 12.0, 121), 1e3
    one = epp.simulate(dragged(epp.StribeckFriction(1.0, 2.0, 0.3, 0.05, shape), 0.4), t_end=12.0, t_eval=times)
    other = dragged(epp.StribeckFriction(1.0, 2.0, 0.3, 0.05, shape), -0.4)
    small = dragged(epp.StribeckFriction(1.0 * k, 2.0 * k, 0.3 * k, 0.05, shape), 0.4 * k)
    for system, scale in ((other, -1.0), (small, k)):
        found = epp.simulate(system, t_end=12.0, t_eval=times).signals["friction_input"]
        np.testing.assert_allclose(found / scale, one.signals["friction_input"], atol=1e-11)


@pytest.mark.parametrize("shape", [1.0, 1.5, 3.0, 4.0, 5.0])
def test_answer_to_harmonics_of_another_shape(shape: float) -> None:
    """Coefficients of the force against a sum over a period, and their slopes against differences."""
    element = epp.StribeckFriction(1.0, 2.0, 0.3, 0.05, shape)
    Z = np.array([[0.05, -1j, 0.1, 0.05j]])
    periodic = PeriodicElement.of(element, ("free",))
    answer = respond(periodic, Z, 2.0)
    switches = np.sort(np.mod(answer.regime.phases, 2 * np.pi))
    edges = np.append(switches, switches[0] + 2 * np.pi)
    node, weight = np.polynomial.legendre.leggauss(60)
    total = np.zeros(4, complex)
    for low, high in pairwise(np.concatenate([np.linspace(*ends, 9)[:-1] for ends in pairwise(edges)] + [edges[-1:]])):
        phi = (low + high) / 2 + (high - low) / 2 * node
        v = (np.exp(1j * np.outer(phi, np.arange(4))) @ Z[0]).real
        force = weight * (high - low) / 2 * element.output(v)[0]
        total += np.exp(-1j * np.outer(np.arange(4), phi)) @ force / np.pi
    total[0] /= 2
    np.testing.assert_allclose(answer.coefficients[0], total, atol=1e-10)
    step = 1e-6
    moved = respond(periodic, Z + step * np.array([[0.0, 1.0, 0.0, 0.0]]), 2.0)
    slope = (moved.coefficients - answer.coefficients)[0] / step
    np.testing.assert_allclose(answer.slopes[0, :, 1], slope, atol=1e-4)


@pytest.mark.parametrize("shape", [1.0, 1.5, 2.0, 4.0])
def test_slopes_of_other_shapes(shape: float) -> None:
    element = epp.StribeckFriction(1.0, 2.0, 0.5, 0.1, shape)
    v = np.linspace(1e-9, 5.0, 400001)
    assert element.slope_bounds()[0] == pytest.approx(np.diff(element.output(v)[0]).min() / (v[1] - v[0]), rel=1e-4)
    assert epp.StribeckFriction(1.0, 2.0, 0.5, 0.1, 0.5).slope_bounds()[0] == -np.inf
    assert epp.StribeckFriction(1.0, 1.0, 0.5, 0.1, 0.5).slope_bounds()[0] == 0.1


def test_slopes_sectors_and_refusals() -> None:
    element = epp.StribeckFriction(1.0, 2.0, 0.5, 0.1)
    v = np.linspace(1e-6, 5.0, 200001)
    assert element.slope_bounds()[0] == pytest.approx(np.diff(element.output(v)[0]).min() / (v[1] - v[0]), rel=1e-6)
    assert element.slope_bounds()[1] == np.inf and element.sector() == (0.1, np.inf)
    assert element.sticks_and_slips and not epp.ViscousCoulomb(1.0, 1.0).sticks_and_slips
    assert epp.ViscousCoulomb(0.0, 2.0).sector() == (2.0, 2.0)
    for make, words in (
        (lambda: epp.ViscousCoulomb(-1.0, 0.0), "coulomb is -1.0; expected zero or more"),
        (lambda: epp.StribeckFriction(1.0, 0.5, 1.0), "static is 0.5.*expected at least coulomb"),
        (lambda: epp.StribeckFriction(1.0, 2.0, 0.0), "velocity is 0.0; expected a positive number"),
        (lambda: epp.StribeckFriction(1.0, 2.0, 1.0, 0.0, 0.0), "shape is 0.0; expected a positive number, 6 or less"),
        (lambda: epp.StribeckFriction(1.0, 2.0, 1.0, -1.0), "viscous is -1.0; expected zero or more"),
    ):
        with pytest.raises(ModelError, match=words):
            make()
