"""Measured responses: what is refused, the curve against the function that was sampled, and its deviation by draws."""

import control
import numpy as np
import pytest

import eppanalysis as epp

OMEGA = np.geomspace(0.1, 100.0, 301)


def plant(omega):
    """With a resonance at 8 rad/s that is damped by 10 per cent."""
    s = 1j * np.asarray(omega)
    return 64.0 / (s * (s + 1.0) * (s**2 + 1.6 * s + 64.0))


def test_curve_between_the_points_is_the_function_that_was_sampled():
    response = epp.MeasuredResponse(OMEGA, plant(OMEGA))
    between = np.sqrt(OMEGA[1:] * OMEGA[:-1])
    error = np.abs(response.at(between) / plant(between) - 1.0)
    assert error.max() < 2e-3
    assert error[between < 4.0].max() < 1e-6
    step = 1e-6
    slope = (plant(3.0 + step) - plant(3.0 - step)) / (2.0 * step)
    assert response.with_slope(3.0)[1] == pytest.approx(slope, rel=1e-4)


def test_left_out_points_bound_the_error_between_points():
    coarse = OMEGA[::6]
    curve = epp.MeasuredResponse(coarse, plant(coarse)).curve
    for omega in np.sqrt(coarse[5:-5] * coarse[6:-4]):
        true = abs(np.log(complex(curve.at(np.array(omega))[0] / plant(omega))))
        assert true <= curve.error_between(omega)


def test_no_value_outside_the_data():
    response = epp.MeasuredResponse(OMEGA, plant(OMEGA))
    assert np.isnan(response.at([0.09, 101.0])).all()
    assert np.isfinite(response.at([0.1, 100.0])).all()


@pytest.mark.slow
def test_deviation_of_the_fitted_curve_is_that_of_draws():
    rng = np.random.default_rng(5)
    off = []
    for _ in range(150):
        noise = 1.0 + 0.02 * (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size))
        curve = epp.MeasuredResponse(OMEGA, plant(OMEGA) * noise, deviation=0.02).curve
        error = np.log(complex(curve.at(np.array(1.3))[0] / plant(1.3)))
        off.append(np.array([error.real, error.imag]) / curve.deviation_at(1.3))
    # The root mean square of 300 normal deviates is within 0.12 of one in 99.7 of 100 cases; the choice of knots adds.
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.17)


@pytest.mark.parametrize(("damping", "most"), [(0.1, 0.35), (0.05, 0.4)])
def test_a_fitted_curve_bends_at_a_resonance_and_is_smooth_beside_it(damping, most):
    omega, rng = np.geomspace(0.1, 100.0, 601), np.random.default_rng(7)
    s = 1j * omega
    true = 64.0 / (s * (s + 1.0) * (s**2 + 16.0 * damping * s + 64.0))
    off = []
    for _ in range(20):
        noise = 1.0 + 0.01 * (rng.standard_normal(omega.size) + 1j * rng.standard_normal(omega.size))
        curve = epp.MeasuredResponse(omega, true * noise, deviation=0.01).curve
        off.append(np.log(curve.at(omega)[0] / true) / 0.01)
    # Over its deviation: of the noise of the points little is left, and at the resonance there is no bias besides.
    assert np.sqrt(np.mean(np.abs(off) ** 2) / 2.0) < most
    mean = np.mean(off, 0)[np.abs(omega - 8.0) < 1.0]
    assert max(np.abs(mean.real).max(), np.abs(mean.imag).max()) < 4.0 / np.sqrt(len(off))


def test_points_that_scatter_more_than_said_widen_the_deviation():
    rng = np.random.default_rng(6)
    noise = 1.0 + 0.03 * (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size))
    said = epp.MeasuredResponse(OMEGA, plant(OMEGA) * noise, deviation=0.02).curve
    assert said.scatter > 1.0


def test_a_resonance_that_no_spline_follows_widens_the_deviation_there_and_not_beside_it():
    # Of a width of a tenth of the gap between points: a single one shows it.
    omega, rng = np.geomspace(1.0, 100.0, 401), np.random.default_rng(6)

    def resonance(w):
        return 100.0 / (100.0 - w**2 + 0.02j * w) / (1.0 + 1j * w)

    at, off, said = np.array([10.02, 11.8]), [], []
    for _ in range(60):
        noise = 1.0 + 0.01 * (rng.standard_normal(omega.size) + 1j * rng.standard_normal(omega.size))
        curve = epp.MeasuredResponse(omega, resonance(omega) * noise, deviation=0.01).curve
        off.append(np.log(np.abs(curve.at(at)[0] / resonance(at))))
        said.append(curve.deviation_at(at))
    assert np.min(said, 0)[0] > 0.05
    assert np.std(off, 0)[1] == pytest.approx(np.median(said, 0)[1], rel=0.25)


def test_from_control_takes_frequency_zero_for_the_static_gain():
    omega = np.concatenate([[0.0], OMEGA])
    data = control.frd(3.0 / (1.0 + 1j * omega), omega)
    response = epp.MeasuredResponse.from_control(data, deviation=np.full(omega.size, 0.01))
    assert response.static_gain == 3.0
    assert response.band == (0.1, 100.0)
    assert np.shape(response.deviation) == OMEGA.shape


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"omega": OMEGA[::-1]}, "rad/s after 100; expected .* each once, in order"),
        ({"omega": OMEGA - 0.1}, "omega is 0 rad/s; expected"),
        ({"omega": OMEGA[:-1]}, "shape"),
        ({"omega": OMEGA[:5], "value": plant(OMEGA[:5])}, "8 or more"),
        ({"value": 0.0 * plant(OMEGA)}, "zero or not finite at 0.1"),
        ({"value": plant(OMEGA) * np.exp(-3j * np.arange(OMEGA.size))}, "neighbours"),
        ({"value": ["a"] * OMEGA.size}, "numbers"),
        ({"deviation": 0.0}, "deviation"),
        ({"deviation": 0.5}, "leave noisier points out"),
        ({"deviation": np.full(3, 0.1)}, "deviation"),
        ({"static_gain": np.nan}, "static_gain"),
        ({"unstable_poles": -1}, "unstable_poles"),
    ],
)
def test_refuses(changed, said):
    with pytest.raises(epp.ModelError, match=said):
        epp.MeasuredResponse(**{"omega": OMEGA, "value": plant(OMEGA), **changed})


def test_from_control_refuses_other_things():
    with pytest.raises(epp.EppError, match="expected"):
        epp.MeasuredResponse.from_control(control.tf([1.0], [1.0, 1.0]))
    with pytest.raises(epp.ModelError, match="2 outputs"):
        epp.MeasuredResponse.from_control(control.frd(np.ones((2, 1, 9), complex), np.arange(1.0, 10.0)))


@pytest.mark.parametrize("seed", [None, 1, 2, 3, 4, 5])
def test_the_phase_of_a_pole_without_damping_turns_back(seed):
    omega = np.geomspace(0.01, 100.0, 801)
    value = 1.0 / (1.0 - omega[omega != 1.0] ** 2)
    if seed is not None:
        draw = np.random.default_rng(seed)
        value = value * (1.0 + 0.01 * (draw.standard_normal(value.size) + 1j * draw.standard_normal(value.size)))
    response = epp.MeasuredResponse(omega[omega != 1.0], value)
    phase = response.to_frame()["phase"].to_numpy()
    assert phase[0] == pytest.approx(0.0, abs=0.06)
    assert phase[-1] == pytest.approx(-np.pi, abs=0.06)
    # Of a zero there the way is open, and of a pole if it may be unstable.
    with pytest.raises(epp.ModelError, match="rad of phase apart"):
        epp.MeasuredResponse(omega[omega != 1.0], 1.0 / value)
    with pytest.raises(epp.ModelError, match="rad of phase apart"):
        epp.MeasuredResponse(omega[omega != 1.0], value, unstable_poles=2)


def test_paths_evaluated_at_once_are_the_splines_of_each():
    """Points through which a curve passes and such that it is fitted to, each path in a band of its own."""
    noise = np.random.default_rng(3).standard_normal((2, OMEGA.size))
    noisy = plant(OMEGA) * (1.0 + 0.02 * (noise[0] + 1j * noise[1]))
    part = OMEGA[40:-30]
    paths = [epp.MeasuredResponse(OMEGA, noisy, deviation=0.02), epp.MeasuredResponse(part, plant(part))]
    matrix = epp.MeasuredMatrix([[None, paths[0]], [paths[1], None]])
    omega = np.concatenate([OMEGA, np.sqrt(OMEGA[1:] * OMEGA[:-1]), [0.0, 0.09, 101.0]])
    G, dG = matrix.with_slope(omega)
    assert not G[:, [0, 1], [0, 1]].any() and np.isnan(G[-3:, 0, 1]).all()
    for path, value, slope in ((paths[0], G[:, 0, 1], dG[:, 0, 1]), (paths[1], G[:, 1, 0], dG[:, 1, 0])):
        low, high = path.band
        known = (omega >= low) & (omega <= high)
        np.testing.assert_array_equal(np.isnan(value), ~known)
        x, w = np.log(omega[known]), omega[known]
        ln, by = (path.curve.spline(x, nu) @ [1.0, 1j] for nu in (0, 1))
        np.testing.assert_allclose(value[known], np.exp(ln), rtol=1e-13)
        np.testing.assert_allclose(slope[known], np.exp(ln) * by / w, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(path.with_slope(omega), [value, slope], rtol=1e-11)
