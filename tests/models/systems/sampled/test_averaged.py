"""The loop in the mean over the phases of its samples, against runs and by hand."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.models.systems.sampled.averaged import averaged


def loop(seed: int, delay: float, T: float = 0.01) -> epp.LureSystem:
    """A random plant with a saturation, under a random controller of two inputs and two outputs."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    law = epp.SampledController(
        np.diag(rng.uniform(0.5, 1.0, 2)), rng.normal(size=(2, 2)), rng.normal(size=(2, 2)), rng.normal(size=(2, 2)),
        T, delay * T,
    )  # fmt: skip
    D = np.zeros((3, 3))
    D[0, 1] = 0.3  # a controller's output straight into the saturation
    return epp.LureSystem.build(
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
    rational = epp.LureSystem.frequency_response(made, w)
    # Hold and bilinear transform differ by (omega T)^2 / 12 of the controller's part.
    np.testing.assert_allclose(rational, G, atol=2e-3 * np.abs(G).max())
    np.testing.assert_allclose(made.response_at(2.0j), made.frequency_response(2.0), rtol=1e-9)


def test_a_loop_without_samples_is_itself() -> None:
    plain = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    assert averaged(plain) is plain


def test_what_has_no_form_in_continuous_time_is_refused() -> None:
    law = epp.SampledController([[-1.0]], [[1.0]], [[1.0]], [[0.0]], 0.1)
    system = epp.LureSystem.build(
        [[-1.0]], [[1.0, 1.0]], [[1.0], [1.0]], [epp.Relay(), law], element_names=["relay", "law"]
    )
    with pytest.raises(epp.ModelError, match="eigenvalue of -1"):
        averaged(system)


def test_a_prediction_says_what_the_samples_leave_out_and_how_many_there_are() -> None:
    law = epp.SampledController([], [], [], [[1.0]], 0.2)
    A = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    B, C = np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    system = epp.LureSystem.build(A, B, C, [epp.Relay(), law], D=[[0.0, 1.0], [0.0, 0.0]], x0=[1.0, 0.0, 0.0])
    prediction = epp.predict_limit_cycles(system)
    (cycle,) = prediction
    # Phase of 1/(s + 1)^3 with hold: 3 atan(w) + w T/2 = pi.
    assert 3.0 * np.arctan(cycle.omega) + 0.1 * cycle.omega == pytest.approx(np.pi, rel=1e-9)
    assert f"The fastest cycle has {cycle.period / 0.2:.3g} samples a turn" in prediction.warnings[-1]


#: Ticks that the times of the controllers below are multiples of [s], and of one of them a sample time.
TICK, SAMPLE = 5e-4, 40


def pair(seed: int, ratio: float, delay: int, late: int, through: bool, mutual: bool) -> epp.LureSystem:
    """A sine (the first saturation) through two controllers, one straight behind the other, to a lag 1/(s + 4)^2.

    The second one also reads the sine itself; with `through` a limit stands between; with `mutual` the first one reads
    what the second one holds.
    """
    rng = np.random.default_rng(seed)
    A, B, C, D = rng.uniform(-0.7, 0.7, (4, 2))
    first, second = (
        epp.SampledController([[A[k]]], [[B[k], 1.0]], [[C[k]]], [[D[k], 0.8]], step * TICK, k_delay * TICK)
        for k, step, k_delay in ((0, SAMPLE, delay), (1, round(SAMPLE * ratio), 0))
    )
    wires = np.zeros((6, 4))  # inputs: lag, both of the first, both of the second, limit
    wires[1, 0], wires[2, 2], wires[3, 0], wires[4, 3 if through else 1], wires[5, 1] = 1.0, 0.2 * mutual, 0.3, 1.0, 1.0
    return epp.LureSystem.build(
        [[-4.0, 0.0], [1.0, -4.0]], [[0.0, 0.0, 1.0, 0.0], [0.0] * 4], np.eye(6, 2, k=1),
        [epp.Saturation(-1.0, 1.0), first, second, epp.Saturation(-1.0, 1.0)],
        D=wires, delays=[0.0, late * TICK, late * TICK, 0.0],
    )  # fmt: skip


def gain_by_hand(system: epp.LureSystem, omega: float, n: int, delay: int) -> complex:
    """First harmonic of what the second controller holds while a sine is read, walked through sample by sample.

    Over n common turns of the clocks, in which the sine turns so often that their phases are spread evenly.
    """
    first, second = system.elements[1:3]
    mutual = system.D[2, 2]
    T1, T2 = round(first.sample_time / TICK), round(second.sample_time / TICK)
    turn, x, y = int(np.lcm(T1, T2)), np.zeros(2, complex), [0j, 0j]
    computed, total, warm = [], 0j, 80 * int(np.lcm(T1, T2))
    for t in range(warm + n * turn):
        sine = np.exp(1j * omega * t * TICK)
        if t % T1 == 0:
            u = np.array([sine, mutual * y[1]])
            computed.append((t + delay, first.C[0, 0] * x[0] + first.D[0] @ u))
            x[0] = first.A[0, 0] * x[0] + first.B[0] @ u
        if t % T2 == 0:
            u = np.array([0.3 * sine, next((v for due, v in reversed(computed) if due <= t), 0j)])
            y[1] = second.C[0, 0] * x[1] + second.D[0] @ u
            x[1] = second.A[0, 0] * x[1] + second.B[0] @ u
        if t >= warm:
            total += y[1] * np.exp(-1j * omega * t * TICK)
    return complex(total / (n * turn) * (1.0 - np.exp(-1j * omega * TICK)) / (1j * omega * TICK))


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6), st.sampled_from([1.0, 0.5, 2.0, 1.5, 0.1]), st.sampled_from([0, 13, 40]),
    st.sampled_from([0, 11]), st.booleans(),
)  # fmt: skip
def test_a_controller_reads_anothers_hold_at_its_age_and_not_late_by_both_holds(seed, ratio, delay, late, through):
    mutual = ratio == 1.0 and seed % 2 == 0
    system = pair(seed, ratio, delay, late, through, mutual)
    turn = int(np.lcm(SAMPLE, round(SAMPLE * ratio))) * TICK
    n, turns = 101, 17
    omega = 2.0 * np.pi * turns / (n * turn)
    # What acts on the lag does so with its dead time; what is read straight, without.
    way = np.exp(-1j * omega * late * TICK) / (1j * omega + 4.0) ** 2
    expected = gain_by_hand(system, omega, n, delay) * way
    made = averaged(system)
    G, dG = made.frequency_response_and_slope(omega)
    one = G[0, 0] + G[0, 1] * G[1, 0] / (1.0 - G[1, 1])  # the limit between stands as the gain that it is
    assert one == pytest.approx(expected, rel=1e-8)
    near = (made.frequency_response(omega + 1e-4) - made.frequency_response(omega - 1e-4)) / 2e-4
    np.testing.assert_allclose(dG, near, atol=1e-6 * np.abs(near).max())
    np.testing.assert_allclose(made.response_at(1j * omega), G, rtol=1e-10, atol=1e-14)
