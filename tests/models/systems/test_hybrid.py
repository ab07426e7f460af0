"""The flat hybrid system: what the engine reads is the loop, its inputs and its elements, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.hybrid import HybridSystem


def elbow() -> epp.LureSystem:
    return epp.case("fig8a_original").to_system()


def test_inputs_become_states_behind_those_of_the_loop():
    system = elbow()
    n = system.A.shape[0]
    held = HybridSystem.from_lure(system, {"harness_position": epp.inputs.Step(0.02)})
    swung = HybridSystem.from_lure(system, {"harness_position": epp.inputs.Sine(0.01, 2.0, 0.4)})
    assert (held.n_plant, held.x0.size, swung.x0.size) == (n, n + 1, n + 2)
    np.testing.assert_array_equal(held.x0[:n], system.x0)
    assert held.x0[n] == system.v0[0]
    # A sine is an oscillator of its own frequency, which starts at its phase.
    np.testing.assert_allclose(swung.x0[n:], [np.sin(0.4), np.cos(0.4)])
    np.testing.assert_allclose(np.linalg.eigvals(swung.model.A[n:, n:]), [4j * np.pi, -4j * np.pi], rtol=1e-12)


def test_rates_are_those_of_the_loop():
    """With all elements at given outputs: A x + B w + constants, for the loop's states."""
    system = elbow()
    flat = HybridSystem.from_lure(system).model
    rng = np.random.default_rng(5)
    x, w = rng.normal(size=system.A.shape[0]), rng.normal(size=system.B.shape[1])
    H = np.zeros(flat.K.shape[1])
    H[-1] = 1.0
    full = np.append(x, system.v0)
    want = system.A @ x + system.B @ w + system.B_input @ system.v0 + system.constant_state
    found = (flat.A @ full + flat.B @ w + flat.K @ H)[: x.size]
    np.testing.assert_allclose(found, want, rtol=1e-12, atol=1e-9)
    z = system.C @ x + system.D @ w + system.D_input @ system.v0 + system.constant_input
    np.testing.assert_allclose(flat.C @ full + flat.D @ w + flat.Kz @ H, z, rtol=1e-12, atol=1e-9)


def test_signals_are_those_of_the_loop():
    system = elbow()
    s, flat = system.signals, HybridSystem.from_lure(system).model
    rng = np.random.default_rng(6)
    x, w = rng.normal(size=system.A.shape[0]), rng.normal(size=system.B.shape[1])
    H = np.zeros(flat.YH.shape[1])
    H[-1] = 1.0
    want = s.C @ x + s.D @ w + s.D_input @ system.v0 + s.constant
    np.testing.assert_allclose(flat.Yx @ np.append(x, system.v0) + flat.Yw @ w + flat.YH @ H, want, rtol=1e-12)


def test_breakpoints_of_the_input_signals_are_in_order_of_time():
    system = epp.LureSystem.build(
        [[-1.0]],
        [[1.0]],
        [[1.0]],
        [epp.Relay()],
        B_input=[[1.0, 1.0]],
        input_names=("a", "b"),
        v0=[10.0, 20.0],
    )
    model = HybridSystem.from_lure(
        system, {"a": epp.inputs.Ramp(2.0, 1.0, 3.0), "b": epp.inputs.Step(5.0, time=2.0)}
    ).model
    assert np.all(np.diff(model.breakpoint_time) >= 0)
    breakpoints = {(t, int(i)): (v, k) for t, i, v, k in zip(model.breakpoint_time, model.breakpoint_state,
    model.breakpoint_value,
                                                       model.breakpoint_slope, strict=True)}  # fmt: skip
    assert (
        breakpoints[1.0, 1] == (10.0, 2.0) and breakpoints[3.0, 1] == (14.0, 0.0) and breakpoints[2.0, 2] == (25.0, 0.0)
    )


def test_memory_of_the_loop_is_what_the_engine_holds():
    """The play's held output stands in H, which ends with the constant 1."""
    loop = replace(epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0)), memory=(0.25,))
    H = HybridSystem.from_lure(loop).H0
    assert 0.25 in H[:-1] and H[-1] == 1.0


def test_a_loop_without_switches_gets_an_observer():
    """Its extrema mark the turns of a loop that never switches (Sine is smooth)."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.5, 1.0]), epp.Sine(scale=0.2))
    hybrid = HybridSystem.from_lure(loop)
    assert hybrid.element_names[-1] == "observer"
    assert [hybrid.guard_name(g) for g in range(2)] == ["maximum", "minimum"]
    # And its turns are no events of the user's.
    assert epp.simulate(loop, t_end=5.0).events == ()


def test_clocks_and_inputs_are_not_compared_between_periods():
    case = epp.case("fig8a_original").with_values({"controller.sample_period": "4 ms"})
    hybrid = HybridSystem.from_lure(case.to_system(), {"harness_position": epp.inputs.Step(0.02)})
    names = [*case.to_system().state_names, "harness_position"]
    assert [n for n, c in zip(names, hybrid.compared, strict=True) if not c] == ["clock", "harness_position"]


def test_what_has_no_hybrid_form_is_refused():
    discrete = epp.LureSystem.build([[0.5]], [[1.0]], [[1.0]], [epp.Relay()], time_step=1.0)
    with pytest.raises(ModelError, match="no hybrid form of its own"):
        HybridSystem.from_lure(discrete)
    with pytest.raises(ModelError, match="no input 'x'; expected one of: harness_position"):
        HybridSystem.from_lure(elbow(), {"x": epp.inputs.Step(1.0)})
    smooth = epp.LureSystem.build(
        [[0.0]], [[1.0, 1.0]], [[1.0], [0.0]], [epp.Relay(), epp.Cube(scale=1.0)], D=[[0, 0], [1, 0]]
    )
    of_itself = epp.LureSystem.from_tf(([0.3, 3.0], [1.0, 1.0]), epp.Tanh(1.0, 2.0))
    for loop in (smooth, of_itself):
        with pytest.raises(ModelError, match="its own or another's, acts straight on .*; a smooth element needs"):
            HybridSystem.from_lure(loop)


def test_an_element_that_acts_straight_on_itself_is_not_said_to_be_acted_on_by_another():
    loop = epp.LureSystem.from_tf(([1.0, 3.0], [1.0, 1.0]), epp.Relay())
    assert (
        "relay slides a run switches without end, as the output of an element, its own"
        in HybridSystem.from_lure(loop).chatters
    )


# A quantiser of many levels ------------------------------------------------------------------------------------------
def servo(levels: int, scale: float = 1.0, step: float = 0.05) -> epp.LureSystem:
    """A loop that hunts over a few levels of its quantised sensor."""
    return epp.LureSystem.from_tf(
        ([5.6], [1, 3, 2, 0]), epp.Quantiser(step, levels), x0=np.array([1.0, 1.0, 1.0]) * scale
    )


def test_levels_that_are_not_reached_change_no_bit():
    few, many = (epp.simulate(servo(levels, 0.2), t_end=200.0) for levels in (40, 2048))
    for name, values in few.signals.items():
        np.testing.assert_array_equal(values, many.signals[name])
    assert len(few.events) > 50 and [e.time for e in few.events] == [e.time for e in many.events]
    assert few.status is many.status and few.limit_cycle is not None and many.limit_cycle is not None
    assert few.limit_cycle.period == many.limit_cycle.period
    np.testing.assert_array_equal(few.limit_cycle.state, many.limit_cycle.state)


@pytest.mark.parametrize("n0", [3, 40, 900])
@pytest.mark.parametrize(("a", "k", "step"), [(1.0, 0.7, 0.05), (0.2, 3.0, 1e-3), (5.0, 0.1, 0.3)])
def test_levels_are_passed_when_the_closed_form_says(a: float, k: float, step: float, n0: int):
    """x' = -a x - k q(x) falls through each level by an exponential of its own."""
    x0 = step * (n0 + 0.3)
    loop = epp.LureSystem.build([[-a]], [[-k]], [[1.0]], [epp.Quantiser(step, 2048)], x0=[x0])
    t, x, expected = 0.0, x0, []
    for n in range(n0, 0, -1):
        rest, edge = k * step * n / a, step * (n - 0.5)
        t += np.log1p((x - edge) / (edge + rest)) / a
        x = edge
        expected.append(t)
    run = epp.simulate(loop, t_end=1.5 * t, t_eval=[0.0, 1.5 * t])
    passed = [e.time for e in run.events if e.name.startswith("falls") and e.time > 0.0]
    np.testing.assert_allclose(passed, expected, rtol=1e-11)
    assert run.signals["quantiser_output"].tolist() == [step * n0, 0.0]


@given(
    step=st.floats(1e-3, 2.0), places=st.lists(st.integers(-2600, 2600), min_size=1, max_size=4),
    beside=st.floats(-0.49, 0.49),
)  # fmt: skip
@settings(max_examples=25, deadline=None)
def test_a_jump_goes_over_any_number_of_levels_at_once(step: float, places: list[int], beside: float):
    """Beside rounding, done here: the output is the level of the input, and each level passed is one switch."""
    loop = epp.LureSystem.build(
        [[-1.0]], [[1.0]], [[0.0]], [epp.Quantiser(step, 2048)], D_input=[[1.0]], input_names=["v"]
    )
    times = np.arange(1.0, len(places) + 1.0)
    values = step * (np.array(places) + beside)
    run = epp.simulate(loop, epp.inputs.Steps(times, values), t_end=times[-1] + 1.0, t_eval=times + 0.5)
    levels = np.clip(places, -2048, 2048)
    np.testing.assert_array_equal(run.signals["quantiser_output"], step * levels.astype(float))
    assert run.n_events == np.abs(np.diff(levels, prepend=0)).sum()
    assert {e.time for e in run.events} <= set(times.tolist())


def test_a_jump_back_comes_to_the_same_bits():
    loop = epp.LureSystem.build(
        [[-1.0]], [[1.0]], [[0.0]], [epp.Quantiser(0.1, 2048)], D_input=[[1.0]], input_names=["v"]
    )
    steps = epp.inputs.Steps(np.arange(1.0, 5.0), np.array([204.0, 0.0, -204.0, 0.0]))
    run = epp.simulate(loop, steps, t_end=5.0, t_eval=np.arange(0.5, 5.0))
    assert run.signals["quantiser_output"].tolist() == [0.0, 0.1 * 2040.0, 0.0, -0.1 * 2040.0, 0.0]
    assert run.n_events == 4 * 2040


def test_a_cycle_begins_again_on_a_high_level():
    """About a bias of 1500 levels: the cycle's state and memory bring it back, with its period."""
    bias, step = 1500.0, 0.01
    loop = epp.LureSystem.from_tf(([5.6], [1, 3, 2, 0]), epp.Quantiser(step, 2048), x0=np.array([1.0, 1.0, 1.0]) * step)
    shifted = replace(loop, constant_input=np.array([bias * step]), constant_state=-loop.B[:, 0] * bias * step)
    plain = epp.simulate(loop, t_end=60.0).limit_cycle
    found = epp.simulate(shifted, t_end=60.0).limit_cycle
    assert plain is not None and found is not None
    assert found.period == pytest.approx(plain.period, rel=1e-9)
    again = epp.simulate(replace(shifted, x0=found.state, memory=found.memory), t_end=2.05 * found.period)
    times = [e.time for e in again.events if 1e-7 < e.time < found.period * (1 - 1e-7)]
    expected = [e.time for e in found.events if 1e-7 < e.time < found.period * (1 - 1e-7)]
    np.testing.assert_allclose(times, expected, rtol=0, atol=1e-8 * found.period)
    orbit = epp.exact_orbit(shifted, found)
    assert orbit.status.ok and orbit.period == pytest.approx(found.period, rel=1e-6)
    assert orbit.multipliers is not None and np.all(np.abs(orbit.multipliers) < 1.0)
