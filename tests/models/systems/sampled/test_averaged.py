"""The loop in the mean over the phases of its samples, against runs and by hand."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.averaged import averaged


def loop(seed: int, delay: float, T: float = 0.01) -> LureSystem:
    """A random plant with a saturation, under a random controller of two inputs and two outputs."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    law = epp.SampledController(
        np.diag(rng.uniform(0.5, 1.0, 2)), rng.normal(size=(2, 2)), rng.normal(size=(2, 2)), rng.normal(size=(2, 2)),
        T, delay * T,
    )  # fmt: skip
    D = np.zeros((3, 3))
    D[0, 1] = 0.3  # a controller's output straight into the saturation
    return LureSystem.build(
        rng.normal(size=(n, n)) - 2.0 * np.eye(n), rng.normal(size=(n, 3)), rng.normal(size=(3, n)),
        [epp.Saturation(-1.0, 1.0), law], D=D, D_input=rng.normal(size=(3, 1)), input_names=["v"],
    )  # fmt: skip


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.4, 1.0]))
def test_its_response_is_that_of_the_loop_closed_by_hand(seed, delay) -> None:
    system, w = loop(seed, delay), np.array([0.3, 2.0, 40.0, 200.0])
    law = system.elements[1]
    G = system.frequency_response(w)
    for k, omega in enumerate(w):
        z = np.exp(1j * omega * 0.01)
        ss = control.ss(law.A, law.B, law.C, law.D, 0.01)
        K = ss(z) * (1.0 - 1.0 / z) / (1j * omega * 0.01) * np.exp(-1j * omega * law.delay)
        P = G[k]
        expected = P[0, 0] + P[0, 1:] @ K @ np.linalg.solve(np.eye(2) - P[1:3, 1:] @ K, P[1:3, :1])
        assert averaged(system).frequency_response(omega)[0, 0] == pytest.approx(expected[0], rel=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.4, 1.0]))
def test_its_rational_form_and_its_slope_agree_with_the_response(seed, delay) -> None:
    made = averaged(loop(seed, delay))
    w, h = np.array([0.05, 0.5, 3.0]), 1e-5
    G, slope = made.frequency_response_and_slope(w)
    np.testing.assert_allclose(G, made.frequency_response(w), rtol=1e-12)
    near = (made.frequency_response(w + h) - made.frequency_response(w - h)) / (2.0 * h)
    np.testing.assert_allclose(slope, near, atol=1e-5 * np.abs(near).max() + 1e-8 * np.abs(G).max())
    rational = LureSystem.frequency_response(made, w)
    # Hold and bilinear transform differ by (omega T)^2 / 12 of the controller's part.
    np.testing.assert_allclose(rational, G, atol=2e-3 * np.abs(G).max())
    np.testing.assert_allclose(made.response_at(2.0j), made.frequency_response(2.0), rtol=1e-9)


def test_a_loop_without_samples_is_itself() -> None:
    plain = LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    assert averaged(plain) is plain


def test_what_has_no_form_in_continuous_time_is_refused() -> None:
    law = epp.SampledController([[-1.0]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    system = LureSystem.build(
        [[-1.0]], [[1.0, 1.0]], [[1.0], [1.0]], [epp.Relay(), law], element_names=["relay", "law"]
    )
    with pytest.raises(epp.ModelError, match="eigenvalue of -1"):
        averaged(system)


def test_a_prediction_says_what_the_samples_leave_out_and_how_many_there_are() -> None:
    law = epp.SampledController([], [], [], [[1.0]], 0.2)
    A = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    B, C = np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    system = LureSystem.build(A, B, C, [epp.Relay(), law], D=[[0.0, 1.0], [0.0, 0.0]], x0=[1.0, 0.0, 0.0])
    prediction = epp.predict_limit_cycles(system)
    (cycle,) = prediction
    # Phase of 1/(s + 1)^3 with hold: 3 atan(w) + w T/2 = pi.
    assert 3.0 * np.arctan(cycle.omega) + 0.1 * cycle.omega == pytest.approx(np.pi, rel=1e-9)
    assert f"The fastest cycle has {cycle.period / 0.2:.3g} samples a turn" in prediction.warnings[-1]
