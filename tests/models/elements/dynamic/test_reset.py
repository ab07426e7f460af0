"""Reset elements: describing functions against quadrature in time, and loops against another integrator."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy.integrate import quad, solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError


def made(gain: float, pole: float) -> Any:
    return epp.FirstOrderReset(pole, gain) if pole else epp.CleggIntegrator(gain)


def harmonic(n: int, gain: float, pole: float, amplitude: float, bias: float, omega: float) -> tuple[float, complex]:
    """Mean, and n-th harmonic over the amplitude, by quadrature of the element's answer between two resets each."""
    beta = float(np.arcsin(bias / amplitude))
    kappa, drive = pole / omega, gain / omega

    def sine_part(phi: float) -> float:
        return drive * amplitude * (kappa * np.sin(phi) - np.cos(phi)) / (1 + kappa**2)

    def y(phi: float, begin: float) -> float:
        past = phi - begin
        from_bias = past if kappa == 0 else -np.expm1(-kappa * past) / kappa
        return drive * bias * from_bias + sine_part(phi) - sine_part(begin) * np.exp(-kappa * past)

    spans = [(-beta, np.pi + beta), (np.pi + beta, 2 * np.pi - beta)]
    parts = [lambda phi: 1.0, lambda phi: np.sin(n * phi), lambda phi: np.cos(n * phi)]
    one, sine, cosine = (
        sum(
            quad(lambda p, f=f, a=a: y(p, a) * f(p), a, b, epsabs=1e-13, epsrel=1e-12, limit=200)[0]
            for a, b in spans
        )
        for f in parts
    )  # fmt: skip
    return one / (2 * np.pi), complex(sine, cosine) / (np.pi * amplitude)


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.1, 10.0), st.sampled_from([0.0, 1e-6, 1e-3, 0.3, 1.0, 5.0, 40.0]), st.floats(0.1, 5.0),
    st.floats(-0.999, 0.999), st.floats(0.05, 50.0),
)  # fmt: skip
@example(1.0, 0.0, 1.0, 0.0, 1.0)
@example(2.0, 1e-2, 3.0, 0.99, 3.3)
@example(1.0, 1e-6, 1.0, 0.75, 2.0)
def test_mean_and_gain_match_quadrature(gain: float, pole: float, amplitude: float, share: float, omega: float) -> None:
    bias = share * amplitude
    mean, found = made(gain, pole).describing_function(amplitude, bias, omega)
    expected_mean, expected = harmonic(1, gain, pole, amplitude, bias, omega)
    size = gain / omega
    assert abs(float(mean) - expected_mean) < 1e-9 * size * amplitude
    assert abs(complex(found) - expected) < 1e-9 * size


@pytest.mark.parametrize("pole", [0.0, 0.7])
@pytest.mark.parametrize("n", [2, 3, 6])
def test_higher_harmonics_match_quadrature(pole: float, n: int) -> None:
    found = epp.sinusoidal_harmonics(made(1.5, pole), 2.0, 0.7, 1.3, order=n)[0, n]
    assert abs(found - harmonic(n, 1.5, pole, 2.0, 0.7, 1.3)[1]) < 1e-9


def test_known_values() -> None:
    omega = np.array([0.1, 1.0, 30.0])
    mean, gain = epp.CleggIntegrator(2.0).describing_function([0.1, 3.0, 7.0], 0.0, omega)
    np.testing.assert_allclose(gain, 2.0 / omega * (4 / np.pi - 1j), rtol=1e-14)
    np.testing.assert_array_equal(mean, 0.0)
    assert np.abs(gain[1]) / 2.0 == pytest.approx(1.619, abs=1e-4)
    assert np.degrees(np.angle(gain[1])) == pytest.approx(-38.146, abs=1e-3)
    # A lag that is slow beside the input is an integrator; one that is quick, a gain.
    slow = epp.FirstOrderReset(1e-12, 2.0).describing_function([0.1, 3.0, 7.0], 0.05, omega)
    for one, other in zip(
        slow, epp.CleggIntegrator(2.0).describing_function([0.1, 3.0, 7.0], 0.05, omega), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9)
    quick = epp.FirstOrderReset(1e9, 2e9).describing_function(1.0, 0.4, 1.0)
    assert float(quick[0]) == pytest.approx(0.8, rel=1e-8) and complex(quick[1]) == pytest.approx(2.0, abs=1e-8)


def test_without_a_passage_through_zero_it_is_linear() -> None:
    omega = np.array([0.0, 0.5, 2.0])
    mean, gain = epp.FirstOrderReset(0.5, 3.0).describing_function(1.0, -1.0, omega)
    np.testing.assert_allclose(gain, 3.0 / (0.5 + 1j * omega), rtol=1e-14)
    np.testing.assert_array_equal(mean, -6.0)
    mean, gain = epp.CleggIntegrator(3.0).describing_function(1.0, [-2.0, 2.0], 0.5)
    assert mean.tolist() == [-np.inf, np.inf] and gain.tolist() == [-6j, -6j]


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_what_is_inside_balances_where_the_element_does(pole: float) -> None:
    """The state behind the law is the element's output: its mean and its fundamental."""
    element, omega = made(1.5, pole), 1.3
    mean, gain = element.describing_function([0.2, 2.0], [0.1, -0.5], omega)
    assert element.inside is not None and element.own_states is not None
    driven, inner = element.inside.describing_function([0.2, 2.0], [0.1, -0.5], omega)
    leak = -float(element.own_states.A[0, 0])
    np.testing.assert_allclose(inner / (1j * omega + leak), gain, rtol=1e-13)
    np.testing.assert_allclose(driven / leak, mean, rtol=1e-13)


def alone(element: epp.Nonlinearity) -> epp.LureSystem:
    """An element that an external input drives, without a loop."""
    nothing = np.zeros
    return epp.LureSystem.build(
        nothing((0, 0)), nothing((0, 1)), nothing((1, 0)), [element], D_input=[[1.0]], input_names=["u"],
        element_names=["reset"],
    )  # fmt: skip


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_fifteen_harmonics_of_a_run(pole: float) -> None:
    """Of a run under a sine, by Gauss's rule between the resets, against quadrature and the closed form."""
    gain, amplitude, frequency = 1.5, 2.0, 0.25
    omega = 2 * np.pi * frequency
    period, place, weight = 1 / frequency, *np.polynomial.legendre.leggauss(60)
    times = 2 * period + period * np.concatenate([0.25 * (place + 1), 0.5 + 0.25 * (place + 1)])
    run = epp.simulate(alone(made(gain, pole)), epp.inputs.Sine(amplitude, frequency), t_end=3 * period, t_eval=times)
    y, weights = run.signals["reset_output"], 0.25 * np.tile(weight, 2)
    for n in range(1, 16):
        found = 2j * np.sum(weights * y * np.exp(-1j * n * omega * times)) / amplitude
        assert abs(found - harmonic(n, gain, pole, amplitude, 0.0, omega)[1]) < 1e-9
        lost = -2 * gain / omega / (1 + (pole / omega) ** 2) * (1 + np.exp(-pole * period / 2))
        driven = gain / omega if n == 1 else 0.0
        closed = (driven - 1j * lost / np.pi * (n % 2)) / (pole / omega + 1j * n)
        assert abs(found - closed) < 1e-9


def by_hand(
    gain: float, pole: float, rates: Callable[..., Any], error: Callable[..., float], start: Any, times: np.ndarray
) -> np.ndarray:
    """States at times, the last one reset where the error passes through zero, by another integrator."""
    t, v, found = 0.0, np.array(start, float), []

    def both(t: float, v: Any) -> np.ndarray:
        return np.append(rates(t, v), -pole * v[-1] + gain * error(t, v))

    error.terminal = True  # type: ignore[attr-defined]
    while True:
        ahead = error(t + 1e-9, v + 1e-9 * both(t, v))
        error.direction = -np.sign(ahead)  # type: ignore[attr-defined]
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True}
        run = solve_ivp(both, (t, times[-1]), v, events=error, **options)
        inside = times[(times >= t) & ((times < run.t[-1]) | (run.status == 0))]
        found.append(run.sol(inside) if inside.size else np.zeros((len(v), 0)))
        if run.status == 0:
            return np.hstack(found)
        t, v = run.t[-1], run.y[:, -1].copy()
        v[-1] = 0.0


@pytest.mark.parametrize("pole", [0.0, 1.0])
def test_a_loop_against_another_integrator(pole: float) -> None:
    """The plant (s + 1)/(s (s + 0.2)) behind a reset element, under a sine."""
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -0.2]], [[0.0], [1.0]], [[-1.0, -1.0]], [made(1.0, pole)], D_input=[[1.0]],
        input_names=["r"], element_names=["reset"],
    )  # fmt: skip
    times = np.linspace(0.0, 15.0, 201)
    run = epp.simulate(loop, epp.inputs.Sine(1.0, 0.2), t_end=15.0, t_eval=times)

    def rates(t: float, v: Any) -> list[float]:
        return [v[1], -0.2 * v[1] + v[2]]

    def error(t: float, v: Any) -> float:
        return float(np.sin(0.4 * np.pi * t) - v[0] - v[1])

    expected = by_hand(1.0, pole, rates, error, [0.0, 0.0, 0.0], times)
    np.testing.assert_allclose(run.signals["reset_output"], expected[2], atol=1e-9)
    resets = [e for e in run.events if e.name.startswith("resets")]
    assert len(resets) >= 5


def test_it_begins_at_its_memory_and_is_not_reset_there() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.FirstOrderReset(1.0), x0=[0.5], memory=0.3)
    assert loop.x0.tolist() == [0.5, 0.3]
    run = epp.simulate(loop, t_end=0.1, t_eval=[0.0, 0.01])
    assert run.signals["y"][0] == 0.3 and run.signals["y"][1] == pytest.approx(0.3 - 0.01 * 0.8, abs=1e-4)
    again = epp.case_from_text(epp.Case.from_system(loop, name="reset").to_toml()).to_system()
    for name in ("A", "B", "C", "D", "x0"):
        np.testing.assert_array_equal(getattr(again, name), getattr(loop, name))


def test_an_input_that_steps_over_zero_resets() -> None:
    step = epp.inputs.Step(-3.0, time=1.0)
    loop = epp.LureSystem.build(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [epp.CleggIntegrator(1.0)], D_input=[[1.0]],
        input_names=["u"], element_names=["reset"], v0=[1.0],
    )  # fmt: skip
    run = epp.simulate(loop, step, t_end=2.0, t_eval=[0.5, 0.999, 1.001, 1.5])
    np.testing.assert_allclose(run.signals["reset_output"], [0.5, 0.999, -0.002, -1.0], atol=1e-12)
    assert [e.name for e in run.events] == ["begins positive", "resets downward"]


def test_what_does_not_cover_resets_says_so() -> None:
    case = epp.case("clegg_loop")
    predicted = epp.predict_limit_cycles(case)
    with pytest.raises(ModelError, match="a state that jumps where it is reset is no Fourier series of low order"):
        epp.harmonic_balance(case, predicted[0], 5)
    build = epp.AutomatonBuilder(n_inputs=1)
    one, other = build.mode("one"), build.mode("other")
    build.guard("kicks", one, other, on_input=1.0, impulse=-1.0)
    build.guard("kicks back", other, one, on_input=-1.0, impulse=-1.0)
    kicked = epp.AutomatonElement(build.build())
    assert kicked.slope_bounds() == (-np.inf, np.inf)
    with pytest.raises(ModelError, match="its output has impulses; expected none, for a describing function"):
        kicked.describing_function(1.0)
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), kicked)
    assert loop.signals.names == ("x",)  # an output with impulses is no signal


def test_margins_are_those_without_resets_and_say_so() -> None:
    plant = ([2.0], [1.0, 3.0, 2.0])
    found = epp.margins(epp.LureSystem.from_tf(plant, epp.FirstOrderReset(0.5, 0.5)))
    plain = epp.margins(epp.LureSystem.from_blocks([epp.PiecewiseLinear([], [1.0], [0.0]), ([0.5], [1.0, 0.5]), plant]))
    assert found.rule == ("first_order_reset: 1 (without its resets).",)
    assert found.gain_margin == pytest.approx(plain.gain_margin, rel=1e-9)


def test_values() -> None:
    element = epp.FirstOrderReset(2.0, 3.0)
    assert element == pickle.loads(pickle.dumps(element)) and hash(element) == hash(epp.FirstOrderReset(2.0, 3.0))
    assert element.describing_function([np.nan, 1.0], 0.0, 1.0)[1].shape == (2,)
    assert np.isnan(element.describing_function([np.nan, 1.0], 0.0, 1.0)[1][0])
    assert element.slope_bounds() == element.sector() == (-np.inf, np.inf)
    assert element.linear_gain() == [[1.5]] and epp.CleggIntegrator().linear_gain() == [[np.inf]]
    for make, words in (
        (lambda: epp.CleggIntegrator(0.0), "CleggIntegrator: gain is 0.0; expected a positive number"),
        (lambda: epp.FirstOrderReset(-1.0), "FirstOrderReset: pole is -1.0; expected a positive number"),
        (lambda: element.describing_function(-1.0), "amplitude of a describing function is -1.0"),
        (lambda: element.describing_function(1.0, 0.0, -1.0), "frequency of a describing function is -1.0"),
    ):
        with pytest.raises(ModelError, match=words):
            make()


def test_without_another_nonlinearity_a_loop_grows_or_decays_from_a_gain_on() -> None:
    """It is homogeneous; first order puts the gain at 2.143, where the fundamental balances three lags."""
    sizes = []
    for gain in (2.0, 2.1):
        loop = epp.LureSystem.from_tf(([gain], [1.0, 3.0, 3.0, 1.0]), epp.CleggIntegrator(1.0))
        x = np.abs(epp.simulate(loop, t_end=200.0).signals["x"])
        half = len(x) // 2
        sizes.append(x[half + half // 2 :].max() / x[half : half + half // 2].max())
        assert len(epp.predict_limit_cycles(loop)) == 0
    assert sizes[0] < 0.95 and sizes[1] > 1.01


def test_a_ball_that_bounces_has_impulses_of_its_own() -> None:
    """Any element may have them: the speed turns back by a share at the floor, so flights shorten by that share."""
    share, gravity = 0.8, 9.81
    build = epp.AutomatonBuilder(n_inputs=2)
    flies = build.mode("flies")
    build.guard("bounces", flies, flies, on_input=[-1.0, 0.0], impulse=[0.0, -(1.0 + share)])
    speed = epp.OwnStates(
        np.zeros((1, 1)), np.array([[0.0, 1.0]]), np.array([[0.0], [1.0], [1.0]]),
        np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), rate=np.array([-gravity]),
    )  # fmt: skip
    ball = epp.AutomatonElement(build.build(), speed)
    loop = epp.LureSystem.build([[0.0]], [[1.0]], [[1.0]], [ball], x0=[1.0], element_names=["ball"])
    run = epp.simulate(loop, t_end=3.0)
    fall = np.sqrt(2.0 / gravity)
    expected = fall * (1.0 + 2.0 * np.cumsum(share ** np.arange(6)) - 2.0)
    np.testing.assert_allclose([e.time for e in run.events][:6], expected, rtol=1e-12)
