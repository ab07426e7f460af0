"""Discrete-time loops against plain iterations and closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.results import Status
from tests.stress.families import problem


def loop(element: epp.Nonlinearity, **more) -> epp.LureSystem:
    """x[k+1] = 0.5 x[k] + w + u, z = x."""
    fields = {"B_input": [[1.0]], "input_names": ("u",), "time_step": 0.1, **more}
    return epp.LureSystem.build([[0.5]], [[1.0]], [[1.0]], [element], **fields)


def test_samples_of_a_linear_recursion():
    """x[k+1] = 0.5 x + sat(x): it grows by half until it saturates."""
    run = epp.simulate(loop(epp.Saturation(), x0=[0.2]), t_end=1.0)
    x = [0.2]
    for _ in range(10):
        x.append(0.5 * x[-1] + min(x[-1], 1.0))
    np.testing.assert_allclose(run.signals["saturation_input"], x, rtol=1e-15)
    np.testing.assert_allclose(run.t, 0.1 * np.arange(11), atol=1e-15)


def test_rest_of_a_saturated_recursion():
    """x = 0.5 x + 1: it rests at 2."""
    run = epp.simulate(loop(epp.Saturation(), x0=[1.0]), t_end=10.0)
    assert run.status is Status.SETTLED
    assert run.settled_at["saturation_input"] == pytest.approx(2.0, rel=1e-12)


def test_rest_that_rounding_moves_is_no_motion():
    """A run that begins where another one of the loop has come to rest: its last digits repeat themselves for ever."""
    for seed in (32, 33, 35):
        system = problem("saturation, sampled", seed).system
        there = epp.simulate(system, t_end=400.0).settled_at
        begun = replace(system, x0=np.array(list(there.values())))
        assert epp.simulate(begun, t_end=100.0).status is Status.SETTLED


def test_relay_with_period_two():
    """x[k+1] = 0.5 x - sgn(x)/2 alternates between 1/3 and -1/3, since x = -(0.5 x - 0.5) there."""
    system = epp.LureSystem.build([[0.5]], [[-0.5]], [[1.0]], [epp.Relay()], x0=[0.9], time_step=1.0)
    run = epp.simulate(system, t_end=200.0)
    cycle = run.limit_cycle
    assert run.status is Status.LIMIT_CYCLE and cycle is not None
    assert cycle.period == 2.0
    assert cycle.peak_to_peak["relay_input"] == pytest.approx(2 / 3, rel=1e-12)
    assert cycle.mean["relay_input"] == pytest.approx(0.0, abs=1e-12)


def test_play_in_a_sampled_pi_loop_against_a_plain_iteration():
    """The shipped loop written once more: y[k+1] = y + u, u = -kp m - integral, with m behind a play."""
    case = epp.case("backlash_discrete_pi")
    system = case.to_system()
    run = epp.simulate(system, case.input, 200.0)
    A, B, C, D = system.A, system.B, system.C, system.D
    gap = system.elements[0].gap
    x, held = system.x0.copy(), None
    wanted = []
    for _ in range(201):
        z = float((C @ x).item())
        held = z - np.clip(z - held, -gap / 2, gap / 2) if held is not None else _start(system, z)
        wanted.append(z)
        assert not np.any(D)
        x = A @ x + B[:, 0] * held
    np.testing.assert_allclose(run.signals[case.expected.signal or ""], wanted, rtol=0, atol=1e-12)


def _start(system: epp.LureSystem, z: float) -> float:
    return float(np.atleast_1d(system.elements[0].output(z, system.memory[0])[0])[0])


def test_dead_time_of_whole_samples_and_inputs():
    """x[k+1] = w[k-2] with w = sat(u): a step of u is in x three samples later, and in DeadZone(x) besides."""
    system = epp.LureSystem.build(
        [[0.0]],
        [[1.0, 0.0]],
        [[0.0], [1.0]],
        [epp.Saturation(), epp.DeadZone(lower=-0.1, upper=0.1)],
        D_input=[[1.0], [0.0]],
        input_names=("u",),
        delays=[0.2, 0.0],
        time_step=0.1,
    )
    run = epp.simulate(system, epp.inputs.Step(0.5, time=0.5), 2.0)
    k = np.round(run.t / 0.1)
    np.testing.assert_allclose(run.signals["saturation_output"], np.where(k >= 5, 0.5, 0.0), atol=1e-15)
    np.testing.assert_allclose(run.signals["dead_zone_output"], np.where(k >= 8, 0.4, 0.0), atol=1e-15)


def test_growth_beyond_numbers_is_called_so():
    system = epp.LureSystem.build([[1e10]], [[1.0]], [[1.0]], [epp.Relay()], x0=[1.0], time_step=1.0)
    with np.errstate(all="ignore"):
        assert epp.simulate(system, t_end=100.0).status is Status.DIVERGED


def test_cascades_and_circles_within_a_sample_are_solved():
    cascade = epp.LureSystem.build(
        [[0.0]],
        [[1.0, 0.0]],
        [[0.0], [1.0]],
        [epp.Saturation(), epp.DeadZone()],
        D=[[0.0, 2.0], [0.0, 0.0]],
        x0=[1.7],
        time_step=1.0,
    )
    run = epp.simulate(cascade, t_end=1.0)
    # Dead zone of 1.7 is 0.7, doubled and limited to 1.
    assert run.signals["saturation_output"][0] == pytest.approx(1.0)
    assert run.signals["dead_zone_output"][0] == pytest.approx(0.7)
    circle = epp.LureSystem.build(
        [[0.0]], [[1.0, 0.0]], [[0.0], [1.0]], [epp.Saturation(), epp.DeadZone()], D=[[0, 0.5], [0.5, 0]], time_step=1.0
    )
    # At the first sample d = s / 2 + 3 - 1 and s = min(d / 2, 1); then x is zero, which zero alone solves.
    run = epp.simulate(replace(circle, x0=np.array([3.0])), t_end=1.0)
    assert run.signals["dead_zone_output"] == pytest.approx([2.5, 0.0])
    assert run.signals["saturation_output"] == pytest.approx([1.0, 0.0])


def test_unknown_input_is_refused():
    with pytest.raises(ModelError, match="no input 'v'; expected one of: u"):
        epp.simulate(loop(epp.Saturation()), {"v": epp.inputs.Ramp(1.0)}, 1.0)


def test_a_cycle_of_seven_turns_is_one_period():
    """211 samples hold seven oscillations: the direct iteration of 40000 steps has a mean period of 30.1465 samples."""
    case = epp.case("backlash_discrete_pi_kp05_ki01")
    cycle = epp.simulate(case.to_system(), case.input, case.t_end).limit_cycle
    assert cycle is not None
    assert cycle.period == 211.0
    assert np.argmax(np.abs(cycle.harmonics["m"][1:])) + 1 == 7
    (mean_period,) = [p.value for p in case.expected.published if "period" in p.quantity]
    assert cycle.period / 7 == pytest.approx(mean_period, rel=2e-4)
    assert math.isclose(cycle.frequency, 1 / 211)


def test_harmonics_of_an_even_number_of_samples_add_up_to_the_motion():
    """The highest frequency of two samples, +1 and -1, is there once and not twice."""
    turning = epp.LureSystem.from_tf(control.tf([1.0], [1.0, 0.0], 1.0), epp.Relay(), x0=[1.0])
    cycle = epp.simulate(turning, t_end=50.0).limit_cycle
    assert cycle.period == 2.0
    k, c = np.arange(2), cycle.harmonics["x"]
    series = sum((c[j] * np.exp(2j * np.pi * j * k / 2)).real for j in range(len(c)))
    np.testing.assert_allclose(np.abs(series), 1.0, atol=1e-12)


def test_times_of_samples_only():
    decaying = epp.LureSystem.from_tf(control.tf([0.5], [1.0, -0.5], 0.1), epp.DeadZone(), x0=[1.0])
    whole, few = epp.simulate(decaying, t_end=10.0), epp.simulate(decaying, t_end=10.0, t_eval=[0.0, 0.5, 5.0])
    np.testing.assert_allclose(few.t, [0.0, 0.5, 5.0])
    np.testing.assert_array_equal(few.signals["x"], whole.signals["x"][[0, 5, 50]])
    # Halved twenty times, one is less than a millionth.
    assert whole.settled_since == pytest.approx(2.0)
    with pytest.raises(ModelError, match=r"a time of t_eval is 5.03 s; expected a whole number of samples of 0.1 s"):
        epp.simulate(decaying, t_end=10.0, t_eval=[0.0, 5.03])


def test_dead_time_between_samples_is_refused():
    late = epp.LureSystem.from_tf(control.tf([1.0], [1.0, -1.6, 0.8], 0.1), epp.Relay(), delay=0.14)
    with pytest.raises(ModelError, match=r"a dead time is 0.14 s; expected a whole number of samples of 0.1 s"):
        epp.simulate(late, t_end=10.0)


@pytest.mark.parametrize("seed", range(6))
def test_cascades_with_dead_times_and_inputs_are_those_of_a_plain_iteration(seed: int) -> None:
    """Three elements, of which one feeds the next within a sample and two have a dead time; a sine and a step."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    A *= 0.8 / np.abs(np.linalg.eigvals(A)).max()
    elements = [epp.Saturation(-0.4, 0.5, 1.5), epp.Play(0.2), epp.Quantiser(0.1, 30)]
    D = np.array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0], [0.0, 0.0, 0.0]])
    B, C, B_input, D_input = (rng.normal(size=shape) for shape in ((3, 3), (3, 3), (3, 2), (3, 2)))
    lags = np.array([0, 2, 1])
    system = epp.LureSystem.build(
        A, B, C, elements, D=D, B_input=B_input, D_input=D_input, input_names=("a", "b"), v0=[0.1, 0.0],
        constant_state=0.1 * rng.normal(size=3), x0=rng.normal(size=3), delays=0.25 * lags, time_step=0.25,
    )  # fmt: skip
    run = epp.simulate(system, {"a": epp.inputs.Sine(0.6, 0.37), "b": epp.inputs.Step(0.8, time=4.0)}, 20.0)
    x, held, W, Z = system.x0, 0.0, [], []
    for k in range(81):
        v = np.array([0.1 + 0.6 * np.sin(2 * np.pi * 0.37 * 0.25 * k), 0.8 * (k >= 16)])
        z = C @ x + D_input @ v
        w = np.zeros(3)
        w[0] = np.clip(1.5 * z[0], -0.4, 0.5)
        z[1] += 0.7 * w[0]
        held = min(max(held, z[1] - 0.1), z[1] + 0.1)
        w[1], w[2] = held, 0.1 * np.clip(np.floor(z[2] / 0.1 + 0.5), -30, 30)
        W.append(w)
        Z.append(z)
        late = np.array([W[max(k - lag, 0)][j] for j, lag in enumerate(lags)])
        x = A @ x + B @ late + B_input @ v + system.constant_state
    for j, name in enumerate(("saturation", "play", "quantiser")):
        np.testing.assert_allclose(run.signals[f"{name}_input"], np.array(Z)[:, j], atol=1e-11)
        np.testing.assert_allclose(run.signals[f"{name}_output"], np.array(W)[:, j], atol=1e-11)
