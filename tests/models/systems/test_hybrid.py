"""The flat hybrid system: what the engine reads is the loop, its inputs and its elements, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import Ramp, Sine, Step


def elbow() -> epp.LureSystem:
    return epp.case("fig8a_original").to_system()


def test_inputs_become_states_behind_those_of_the_loop():
    system = elbow()
    n = system.A.shape[0]
    held = HybridSystem.from_lure(system, {"harness_position": Step(0.02)})
    swung = HybridSystem.from_lure(system, {"harness_position": Sine(0.01, 2.0, 0.4)})
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
    model = HybridSystem.from_lure(system, {"a": Ramp(2.0, 1.0, 3.0), "b": Step(5.0, time=2.0)}).model
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
    assert hybrid.guard_names == ("maximum", "minimum")
    # And its turns are no events of the user's.
    assert epp.simulate(loop, t_end=5.0).events == ()


def test_clocks_and_inputs_are_not_compared_between_periods():
    case = epp.case("fig8a_original").with_values({"controller.sample_period": "4 ms"})
    hybrid = HybridSystem.from_lure(case.to_system(), {"harness_position": Step(0.02)})
    names = [*case.to_system().state_names, "harness_position"]
    assert [n for n, c in zip(names, hybrid.compared, strict=True) if not c] == ["clock", "harness_position"]


def test_what_has_no_hybrid_form_is_refused():
    discrete = epp.LureSystem.build([[0.5]], [[1.0]], [[1.0]], [epp.Relay()], time_step=1.0)
    with pytest.raises(ModelError, match="it is iterated instead"):
        HybridSystem.from_lure(discrete)
    with pytest.raises(ModelError, match="no input 'x'; expected one of: harness_position"):
        HybridSystem.from_lure(elbow(), {"x": Step(1.0)})
    smooth = epp.LureSystem.build(
        [[0.0]], [[1.0, 1.0]], [[1.0], [0.0]], [epp.Relay(), epp.Cube(scale=1.0)], D=[[0, 0], [1, 0]]
    )
    with pytest.raises(ModelError, match="a smooth element needs an input from the linear part"):
        HybridSystem.from_lure(smooth)
