"""Limited rates: describing functions against integration in time, and loops against another integrator."""

from __future__ import annotations

import pickle
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.errors import ModelError

DUDA_COMMAND = (
    5.21 * np.polymul(np.polymul([1, -57.36], [1, 4.26]), [1, 0.55]),
    np.polymul([1, 2 * 0.442 * 22.85, 22.85**2], [1, 1.16, 0]),
)
DUDA_AIRCRAFT = (
    -10.524 * np.polymul([1, 1.562], [1, 0.038, 0]),
    np.polymul([1, 2 * 0.212 * 0.088, 0.088**2], np.polymul([1, 3.75], [1, -1.44])),
)


def duda(element: epp.Nonlinearity) -> epp.LureSystem:
    """The aircraft of Duda (AIAA 95-3204), its rate limit in the inner loop."""
    return epp.LureSystem.from_blocks([DUDA_COMMAND, element, DUDA_AIRCRAFT], name="aircraft")


def fundamental_of_limiter(alpha: float) -> complex:
    """Gain of the ideal limiter for ``sin(phi)`` with the rate 1/alpha, from its output phase by phase.

    The output leaves the input where that is too fast and meets it again, or never follows and ramps up and down.
    """
    late = -np.arccos(1 / alpha)

    def above(phi: float) -> float:
        return np.sin(late) + (phi - late) / alpha - np.sin(phi)

    if above(np.pi + late) < 0:  # the next ramp begins before this one has met the input
        late = -np.arcsin(np.pi / (2 * alpha))
        meets = np.pi + late
    else:
        meets = brentq(above, -late, np.pi + late, xtol=1e-15)

    def y(phi: float) -> float:
        return np.sin(late) + (phi - late) / alpha if phi < meets else np.sin(phi)

    parts = [(late, meets), (meets, np.pi + late)]
    sine, cosine = (
        sum(quad(lambda p, f=f: y(p) * f(p), a, b, epsabs=1e-13)[0] for a, b in parts) for f in (np.sin, np.cos)
    )
    return complex(sine, cosine) * 2 / np.pi


def fundamental_of_servo(alpha: float, kappa: float) -> complex:
    """The same for the servo, by integrating it over periods until it repeats, and its Fourier integrals with it."""

    def rates(phi: float, v: Any) -> list[float]:
        return [np.clip(kappa * (np.sin(phi) - v[0]), -1 / alpha, 1 / alpha), v[0] * np.sin(phi), v[0] * np.cos(phi)]

    y, options = 0.0, {"method": "DOP853", "rtol": 3e-13, "atol": 1e-14, "max_step": 0.1}
    for half in range(400):
        begin = np.pi * half
        after = solve_ivp(rates, (begin, begin + np.pi), [y, 0.0, 0.0], **options).y[:, -1]
        # Half a period later it is the same with the other sign, and so are sine and cosine.
        if abs(after[0] + y) < 1e-12:
            return complex(after[1], after[2]) * 2 / np.pi
        y = after[0]
    raise AssertionError("it does not repeat")


@settings(max_examples=60, deadline=None)
@given(st.floats(1.0001, 60.0))
@example(1.2)
@example(1.5)
@example(float(np.sqrt(1 + np.pi**2 / 4)))
@example(1.8620960)
def test_the_limiter_matches_quadrature_in_all_regimes(alpha: float) -> None:
    gain = epp.RateLimiter(2.0).describing_function(alpha * 2.0 / 5.0, 0.3, 5.0)[1]
    assert abs(complex(gain) - fundamental_of_limiter(alpha)) < 1e-9


def test_published_values_and_regimes() -> None:
    alpha = np.array([0.0, 0.5, 1.0, 1.2, 1.5])
    mean, gain = epp.RateLimiter(1.0).describing_function(alpha, -0.7, 1.0)
    np.testing.assert_allclose(np.abs(gain), [1, 1, 1, 0.96687, 0.83836], atol=5e-6)
    np.testing.assert_allclose(np.angle(gain), [0, 0, 0, -0.07109, -0.27600], atol=5e-6)
    assert np.all(mean == -0.7)
    # From the rate at which it no longer follows: a triangle, late by acos(pi/2 alpha).
    alpha = np.array([1.8621, 2.0, 5.0, 1e3, 1e8])
    closed = 4 / (np.pi * alpha) * np.exp(-1j * np.arccos(np.pi / (2 * alpha)))
    # At large alpha what is left of one has the rounding of one.
    np.testing.assert_allclose(epp.RateLimiter(1.0).describing_function(alpha)[1], closed, rtol=1e-13, atol=1e-15)


def test_just_above_the_limit_it_lacks_the_fourth_power() -> None:
    # 1 - N = 9j/(4 pi) beta^4 with cos(beta) = 1/alpha, by expanding the ramp about the steepest point.
    for excess in (1e-9, 1e-7):
        beta = np.arccos(1 / (1 + excess))
        missing = 1 - epp.RateLimiter(1.0).describing_function(1 + excess)[1]
        assert missing.imag == pytest.approx(9 / (4 * np.pi) * beta**4, rel=1e-4, abs=3e-16)


@pytest.mark.slow
@settings(max_examples=2, deadline=None)  # a second and a half each, with the two ends below
@given(st.floats(1.02, 6.0), st.floats(0.3, 60.0))
@example(10.0, 5.0)
@example(1.001, 1.0)
def test_the_servo_matches_integration_in_time(excess: float, kappa: float) -> None:
    alpha = excess * np.hypot(1.0, 1 / kappa)
    servo = epp.RateLimitedServo(bandwidth=kappa * 2.0, rate=3.0)
    gain = servo.describing_function(alpha * 3.0 / 2.0, 1.0, 2.0)[1]
    assert abs(complex(gain) - fundamental_of_servo(alpha, kappa)) < 1e-9


def fundamental_by_phases(alpha: float, kappa: float) -> complex:
    """The same for the servo by the phases at which its ramp begins and ends, bracketed, and quadrature of its rate."""
    rate, beta = 1 / alpha, np.arccos(1 / alpha)

    def ends(begin: float) -> float:
        return brentq(lambda p: np.sin(p) - np.sin(begin) - rate * (p - begin), beta, 2 * np.pi - beta, xtol=1e-15)

    def behind(phi: float, end: float) -> float:
        """Rate of the output behind the ramp: that of a lag which moves with the limit's rate at its end."""
        share = kappa / (kappa**2 + 1)
        forced = (share * (kappa * np.cos(p) + np.sin(p)) for p in (phi, end))
        return next(forced) + (rate - next(forced)) * np.exp(-kappa * (phi - end))

    begin = brentq(lambda b: behind(b + np.pi, ends(b)) + rate if ends(b) < b + np.pi else 2.0, -beta, beta, xtol=1e-15)
    end, parts = ends(begin), []
    cuts = np.minimum(end + np.array([0.0, 3.0, 10.0, 40.0, np.inf]) / kappa, begin + np.pi)
    for turn in (np.cos, np.sin):
        ramp = quad(lambda p, f=turn: rate * f(p), begin, end, epsabs=1e-14)[0]
        rest = [quad(lambda p, f=turn: behind(p, end) * f(p), *cut, epsabs=1e-14)[0] for cut in pairwise(cuts)]
        parts.append(ramp + sum(rest))
    return complex(parts[0], -parts[1]) * 2 / np.pi


@pytest.mark.parametrize("kappa", [0.03, 0.7, 7.0, 2e3, 1e5])
def test_the_servo_matches_its_phases_from_the_onset_of_its_ramps_on(kappa: float) -> None:
    for excess in (1.0001, 1.05, 1.7, 4.2, 30.0):
        alpha = excess * float(np.hypot(1.0, 1 / kappa))
        gain = epp.RateLimitedServo(kappa, 1.0).describing_function(alpha, 0.0, 1.0)[1]
        assert abs(complex(gain) - fundamental_by_phases(alpha, kappa)) < 1e-11


def test_below_its_limit_the_servo_is_its_lag_and_with_a_great_bandwidth_the_limiter() -> None:
    omega = np.array([0.0, 0.3, 2.0, 40.0])
    gain = epp.RateLimitedServo(5.0, 1e9).describing_function(1.0, 0.0, omega)[1]
    np.testing.assert_allclose(gain, 1 / (1 + 1j * omega / 5.0), rtol=1e-13)
    amplitude = np.array([0.5, 1.1, 1.4, 1.9, 7.0])
    fast, ideal = (
        e.describing_function(amplitude, 0.0, 1.0)[1] for e in (epp.RateLimitedServo(1e7, 1.0), epp.RateLimiter(1.0))
    )
    np.testing.assert_allclose(fast, ideal, atol=3e-7)


@given(st.floats(0.01, 50.0), st.floats(0.01, 20.0), st.floats(0.1, 5.0))
def test_the_gain_is_one_of_amplitude_times_frequency_over_the_rate_and_lags(
    amplitude: float, omega: float, rate: float
) -> None:
    limiter = epp.RateLimiter(rate)
    gain = complex(limiter.describing_function(amplitude, 0.0, omega)[1])
    same = complex(limiter.describing_function(3.0 * amplitude, 1.0, omega / 3.0)[1])
    assert gain == pytest.approx(same, rel=1e-9)
    assert abs(gain) <= 1.0 + 1e-12 and -np.pi / 2 <= np.angle(gain) <= 1e-15


@pytest.mark.parametrize("bandwidth", [0.4, 3.0, 100.0, np.inf])
def test_what_is_inside_balances_where_the_element_does(bandwidth: float) -> None:
    """The error that a sine makes has the size |1 - N| A, and the gain from it to the rate is j omega N/(1 - N)."""
    element: epp.Nonlinearity = epp.RateLimiter(0.7) if np.isinf(bandwidth) else epp.RateLimitedServo(bandwidth, 0.7)
    omega = 1.3
    amplitude = 0.7 / omega * np.hypot(1.0, omega / bandwidth) * np.array([1.001, 1.05, 1.3, 1.86, 1.9, 4.0, 300.0])
    gain = element.describing_function(amplitude, 0.0, omega)[1]
    assert element.inside is not None
    mean, inner = element.inside.describing_function(np.abs(1 - gain) * amplitude, 0.0, omega)
    np.testing.assert_allclose(inner, 1j * omega * gain / (1 - gain), rtol=1e-9)
    np.testing.assert_allclose(mean, 0.0, atol=1e-15)


def driven(element: epp.Nonlinearity) -> epp.LureSystem:
    """A plant of two states behind a limited actuator, with position and rate fed back, and a command."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [0.5, -0.4]], [[0.0], [2.0]], [[-1.5, -0.8]], [element], D_input=[[1.0]], input_names=["u"],
        x0=[0.3, -0.2], element_names=["actuator"],
    )  # fmt: skip


def test_the_servo_in_a_loop_against_another_integrator() -> None:
    loop = driven(epp.RateLimitedServo(12.0, 1.5))
    times = np.linspace(0.0, 12.0, 241)
    run = epp.simulate(loop, epp.inputs.Sine(1.2, 0.35), t_end=12.0, t_eval=times)

    def wanted(t: float, v: Any) -> float:
        return 12.0 * (1.2 * np.sin(2 * np.pi * 0.35 * t) - 1.5 * v[0] - 0.8 * v[1] - v[2])

    # From kink to kink, where the rate meets its limit: a step over one would have an error of its length squared.
    t, state, found = 0.0, np.array([0.3, -0.2, 0.0]), np.empty(0)
    limit = 1.5 * np.sign(wanted(t, state)) if abs(wanted(t, state)) > 1.5 else None
    while t < 12.0:

        def rates(t: float, v: Any, limit: float | None = limit) -> list[float]:
            return [v[1], 0.5 * v[0] - 0.4 * v[1] + 2.0 * v[2], wanted(t, v) if limit is None else limit]

        def kink(t: float, v: Any, limit: float | None = limit) -> float:
            return (abs(wanted(t, v)) if limit is None else np.sign(limit) * wanted(t, v)) - 1.5

        kink.terminal, kink.direction = True, 1.0 if limit is None else -1.0  # type: ignore[attr-defined]
        options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13, "max_step": 0.05}
        part = solve_ivp(rates, (t, 12.0), state, events=kink, dense_output=True, **options)
        here = times[(times >= t) & ((times < part.t[-1]) | (part.t[-1] == 12.0))]
        found = np.append(found, part.sol(here)[2])
        t, state = part.t[-1], part.y[:, -1]
        limit = 1.5 * np.sign(wanted(t, state)) if limit is None else None
    np.testing.assert_allclose(run.signals["actuator_output"], found, rtol=0.0, atol=1e-9)
    assert np.abs(np.diff(found)).max() > 0.99 * 1.5 * 0.05


def limited_by_hand(times: np.ndarray) -> np.ndarray:
    """Output of the ideal limiter in `driven`, mode by mode: in a ramp the error falls to zero, behind it y is u."""
    A, b, c, R = np.array([[0.0, 1.0], [0.5, -0.4]]), np.array([0.0, 2.0]), np.array([-1.5, -0.8]), 1.5

    def command(t: float, x: np.ndarray) -> float:
        return 1.2 * np.sin(2 * np.pi * 0.35 * t) + c @ x

    def command_rate(t: float, x: np.ndarray, y: float) -> float:
        return 1.2 * 2 * np.pi * 0.35 * np.cos(2 * np.pi * 0.35 * t) + c @ (A @ x + b * y)

    t, v, found = 0.0, np.array([0.3, -0.2, 0.0]), []
    sign = np.sign(command(0.0, v[:2]) - v[2])
    while t < times[-1]:

        def rates(s: float, v: np.ndarray, sign: float = sign) -> np.ndarray:
            y = v[2] if sign else command(s, v[:2])
            return np.append(A @ v[:2] + b * y, sign * R)

        def ends(s: float, v: np.ndarray, sign: float = sign) -> float:
            if sign:
                return sign * (command(s, v[:2]) - v[2])
            return abs(command_rate(s, v[:2], command(s, v[:2]))) - R

        ends.terminal, ends.direction = True, -1 if sign else 1  # type: ignore[attr-defined]
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True}
        run = solve_ivp(rates, (t, times[-1]), v, events=ends, **options)
        inside = times[(times >= t) & ((times < run.t[-1]) | (run.t[-1] == times[-1]))]
        states = run.sol(inside)
        found += list(states[2] if sign else [command(s, x) for s, x in zip(inside, states[:2].T, strict=True)])
        t, v = run.t[-1], run.y[:, -1]
        if sign:
            rate = command_rate(t, v[:2], v[2])
            sign = np.sign(rate) if abs(rate) > R else 0.0
        else:
            v[2] = command(t, v[:2])
            sign = np.sign(command_rate(t, v[:2], v[2]))
    return np.array(found)


def test_the_limiter_in_a_loop_against_another_integrator() -> None:
    times = np.linspace(0.0, 12.0, 241)
    run = epp.simulate(driven(epp.RateLimiter(1.5)), epp.inputs.Sine(1.2, 0.35), t_end=12.0, t_eval=times)
    expected = limited_by_hand(times)
    assert expected.shape == times.shape
    np.testing.assert_allclose(run.signals["actuator_output"], expected, atol=1e-9)
    slow = np.abs(np.diff(expected)) < 0.99 * 1.5 * 0.05
    assert slow.any() and not slow.all()  # it follows and it ramps


@pytest.mark.slow
def test_the_limited_aircraft() -> None:
    """What first order says depends on what is taken for the element; exact is what a 2000 rad/s servo has."""
    limit = float(np.deg2rad(15.0))
    (predicted,) = epp.predict_limit_cycles(duda(epp.RateLimiter(limit)))
    assert predicted.omega == pytest.approx(3.9668, abs=5e-5)
    assert np.rad2deg(predicted.amplitude("y")) == pytest.approx(4.815, abs=5e-4)
    servo = duda(epp.RateLimitedServo(2000.0, limit))
    exact = epp.exact_orbit(servo, next(iter(epp.predict_limit_cycles(servo))))
    assert 2 * np.pi / exact.period == pytest.approx(4.169755, abs=5e-7)
    assert np.rad2deg(exact.peak_to_peak["y"] / 2) == pytest.approx(5.64753, abs=5e-6)
    assert exact.stable is False and predicted.stable is False
    # The error that is estimated covers the true one.
    ideal = epp.exact_orbit(duda(epp.RateLimiter(limit)), predicted)
    off = abs(predicted.peak_to_peak["y"] / ideal.peak_to_peak["y"] - 1)
    assert 0.1 < off < predicted.error_estimate < 0.3
    # An integral that nothing but signals reads lies anywhere: its orbits are told about zero, found or asked for.
    (found,) = epp.find_limit_cycles(duda(epp.RateLimiter(limit)))
    for cycle in (ideal, found):
        assert max(abs(mean) for mean in cycle.mean.values()) < 1e-9 * cycle.peak_to_peak["y"]
    fast = duda(epp.RateLimiter(4 * limit))
    larger = epp.exact_orbit(fast, next(iter(epp.predict_limit_cycles(fast))))
    assert larger.peak_to_peak["y"] == pytest.approx(4 * ideal.peak_to_peak["y"], rel=1e-9)
    # A saturation in the place of the law inside the servo, with its own describing function: a third answer.
    own = epp.OwnStates([[0.0]], [[0.0, 1.0]], [[-1.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]])  # type: ignore[list-item]
    law = epp.AutomatonElement(epp.Saturation(-limit, limit, 2000.0).automaton(), own)
    (inner,) = epp.predict_limit_cycles(duda(law))
    assert inner.omega == pytest.approx(4.7296, abs=5e-5)
    assert np.rad2deg(inner.amplitude("y")) == pytest.approx(4.0381, abs=5e-5)
    # That one is order 1 of the balance, which cuts off the error inside, and says so.
    first = epp.harmonic_balance(servo, inner, order=1)
    assert 2 * np.pi / first.period == pytest.approx(inner.omega, rel=1e-8)
    assert first.amplitude("y") == pytest.approx(inner.amplitude("y"), rel=1e-8)
    assert "Order 1 takes the error of" in str(first) and not epp.harmonic_balance(servo, inner, order=3).note


def test_margins_are_those_of_the_loop_below_the_limit() -> None:
    unity, lag = epp.PiecewiseLinear([], [1.0], [0.0]), ([12.0], [1.0, 12.0])
    plain = epp.margins(epp.LureSystem.from_blocks([DUDA_COMMAND, unity, DUDA_AIRCRAFT])).numbers()
    for name, value in epp.margins(duda(epp.RateLimiter(0.2))).numbers().items():
        assert value == pytest.approx(plain[name], rel=1e-9)
    behind = epp.margins(epp.LureSystem.from_blocks([DUDA_COMMAND, lag, unity, DUDA_AIRCRAFT])).numbers()
    for name, value in epp.margins(duda(epp.RateLimitedServo(12.0, 0.2))).numbers().items():
        assert value == pytest.approx(behind[name], rel=1e-6)


def test_it_begins_at_its_memory_and_comes_back_from_a_file() -> None:
    loop = epp.LureSystem.from_blocks(
        [epp.RateLimitedServo(20.0, 0.3), ([4.0], [1, 3, 2, 0])], x0=[0.1, 0.2, 0.3], memory=[0.2], name="servo"
    )
    assert loop.x0.tolist() == [0.1, 0.2, 0.3, 0.2] and loop.state_names[-1] == "rate_limited_servo_0"
    run = epp.simulate(loop, t_end=1.0)
    assert run.signals["y"][0] == 0.2
    again = epp.case_from_text(epp.Case.from_system(loop, name="servo").to_toml()).to_system()
    for name in ("A", "B", "C", "D", "x0"):
        np.testing.assert_array_equal(getattr(again, name), getattr(loop, name))
    assert again.given is not None and again.given.elements == (epp.RateLimitedServo(20.0, 0.3),)
    with pytest.raises(ModelError, match=r"RateLimiter: memory is \[nan\]; expected 1 finite numbers"):
        epp.LureSystem.from_blocks([epp.RateLimiter(1.0), ([1.0], [1.0, 1.0])], memory=[float("nan")])
    with pytest.raises(ModelError, match="matrices are not those with which it was given"):
        epp.Case.from_system(loop.in_coordinates(2.0 * np.eye(4), 0.5 * np.eye(4)), name="servo")


def test_a_harmonic_balance_comes_nearer_to_the_exact_cycle_with_its_order() -> None:
    loop = duda(epp.RateLimiter(0.25))
    (predicted,) = epp.predict_limit_cycles(loop)
    exact = 2 * np.pi / epp.exact_orbit(loop, predicted).period
    off = [epp.harmonic_balance(loop, predicted, order).omega / exact - 1 for order in (9, 27)]
    # The error turns where the output has its corner: what a series lacks there falls as its order.
    assert 0.0 < off[1] < off[0] / 2 < 0.05


def test_values() -> None:
    limiter = epp.RateLimiter(1.0)
    assert limiter == pickle.loads(pickle.dumps(limiter)) and hash(limiter) == hash(epp.RateLimiter(1.0))
    assert limiter.describing_function([np.nan, 1.0], 0.0, 1.0)[1].shape == (2,)
    assert np.isnan(limiter.describing_function([np.nan, 1.0], 0.0, 1.0)[1][0])
    assert limiter.output(0.3)[0] == 0.3 and limiter.linear_gain() == [[1.0]]
    for make, words in (
        (lambda: epp.RateLimiter(0.0), "RateLimiter: rate is 0.0; expected a positive number"),
        (lambda: epp.RateLimitedServo(-1.0, 1.0), "RateLimitedServo: bandwidth is -1.0; expected a positive number"),
        (lambda: epp.RateLimitedServo(1.0, float("inf")), "RateLimitedServo: rate is inf; expected a finite number"),
        (lambda: limiter.describing_function(-1.0), "amplitude of a describing function is -1.0"),
        (lambda: limiter.describing_function(1.0, 0.0, -1.0), "frequency of a describing function is -1.0"),
    ):
        with pytest.raises(ModelError, match=words):
            make()


@pytest.mark.parametrize("element", [epp.RateLimiter(rate=1.0), epp.RateLimitedServo(rate=1.0, bandwidth=2.0)])
def test_nothing_passes_of_a_sine_beyond_the_range_of_numbers(element):
    for amplitude, omega in ((2.0, 1e308), (1e308, 1e308), (1e-308, 1e308)):
        gain = element.describing_function(amplitude, 0.0, omega)[1]
        assert np.all(np.isfinite(gain)) and np.all(np.abs(gain) <= 1.0)
    assert abs(complex(np.ravel(element.describing_function(2.0, 0.0, 1e308)[1])[0])) == 0.0
