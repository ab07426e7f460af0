"""Linear blocks beside python-control and polynomial arithmetic."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy import signal

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.linear import as_state_space, fastest_poles, poles, zeros
from tests.coordinates import orthogonal

OMEGA = np.array([1e-3, 0.3, 1.0, 7.0, 1e3])


def response(block: epp.StateSpace, points: np.ndarray) -> np.ndarray:
    """C (s - A)^-1 B + D, written out."""
    n = len(block.A)
    values = [block.C @ np.linalg.solve(s * np.eye(n) - block.A, block.B) + block.D for s in points]
    return np.array(values)[:, 0, 0]


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ([5.0], [1.0, 1.0, 0.0]),
        ([1.0, 2.0, 3.0], [2.0, 0.5, 4.0, 1.0]),
        ([3.0, 1.0], [1.0, 4.0]),
        ([2.0], [4.0]),
        ([0.0, 0.0, 1.0], [1.0, 3.0, 2.0, 0.0]),
        ([1e12], [1.0, 2e4, 1e8]),
    ],
)
def test_transfer_function_is_the_quotient_of_its_polynomials(num, den):
    points = 1j * OMEGA
    found = response(as_state_space((num, den)), points)
    np.testing.assert_allclose(found, np.polyval(num, points) / np.polyval(den, points), rtol=1e-12)


def test_python_control_systems_keep_their_response():
    plant = control.tf([1.0, 2.0], [1.0, 3.0, 2.5, 0.7])
    want = plant(1j * OMEGA)
    np.testing.assert_allclose(response(as_state_space(plant), 1j * OMEGA), want, rtol=1e-12)
    np.testing.assert_allclose(response(as_state_space(control.ss(plant)), 1j * OMEGA), want, rtol=1e-10)


def test_discrete_systems_keep_their_sample_time():
    plant = control.tf([0.5], [1.0, -0.8], 0.02)
    block = as_state_space(plant)
    assert block.time_step == 0.02
    z = np.exp(1j * np.array([0.1, 1.0, 3.0]))
    np.testing.assert_allclose(response(block, z), 0.5 / (z - 0.8), rtol=1e-13)
    assert as_state_space(([1.0], [1.0, 0.5]), 1.0).time_step == 1.0


@pytest.mark.parametrize("step", [None, 0.2])
def test_systems_of_scipy_keep_their_response(step):
    """Ratio, zeros and poles, and state space, as scipy evaluates them."""
    poles, zeros = ([-0.5, -2.0], [-3.0]) if step is None else ([0.5, 0.9], [-0.4])
    options = {} if step is None else {"dt": step}
    ratio = signal.ZerosPolesGain(zeros, poles, 2.0, **options)
    points = 1j * OMEGA if step is None else np.exp(0.2j * np.array([0.1, 1.0, 3.0]))
    wanted = 2.0 * (points - zeros[0]) / ((points - poles[0]) * (points - poles[1]))
    for plant in (ratio, ratio.to_tf(), ratio.to_ss()):
        block = as_state_space(plant)
        assert block.time_step == step
        np.testing.assert_allclose(response(block, points), wanted, rtol=1e-11)
        loop = epp.LureSystem.from_tf(plant, epp.Relay())
        assert loop.time_step == step and len(loop.A) == 2


def test_systems_of_scipy_with_several_outputs_are_refused():
    both = signal.StateSpace([[-1.0, 0.0], [0.0, -2.0]], [[1.0], [1.0]], np.eye(2), [[0.0], [0.0]])
    for plant in (both, signal.TransferFunction([[1.0, 2.0], [1.0, 3.0]], [1.0, 3.0, 2.0])):
        with pytest.raises(ModelError, match="several inputs or outputs; expected one of each"):
            as_state_space(plant)


def test_time_scaling_does_not_change_the_balance_of_the_matrices():
    """A plant a million times as fast has entries a million times as large, not 1e18 times."""
    slow, fast = (as_state_space(([1.0], [1.0, 2 * w, w**2, 0.0])) for w in (1.0, 1e6))
    np.testing.assert_allclose(fast.A, 1e6 * slow.A, rtol=1e-12)


@pytest.mark.parametrize(
    ("plant", "sentence"),
    [
        (([1.0, 2.0, 3.0], [1.0, 1.0]), "improper: its numerator has degree 2, its denominator 1"),
        (([1.0], [0.0, 0.0]), "denominator of zero"),
        (([np.nan], [1.0, 1.0]), "not finite"),
        (([1.0], [1.0, np.inf]), "not finite"),
        ("1/(s+1)", "A str is not a linear block"),
        (control.ss([[0.0]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]]), "several inputs or outputs"),
    ],
)
def test_what_is_no_proper_block_is_refused(plant, sentence):
    with pytest.raises(ModelError, match=sentence):
        as_state_space(plant)


#: Zeros and poles, in rad/s.
PLANTS = [
    ([], [0.0, 0.0, 0.0]),
    ([-1.0], [0.0, 0.0]),
    ([-2.0], [-2.0, 0.0, -1.0]),
    ([0.0, -0.2], [0.0, 0.0, -1.0, -1.5]),
    ([3.0], [-1.0, -4.0, -20.0, -300.0]),
    ([-0.1 + 2j, -0.1 - 2j], [-1 + 5j, -1 - 5j, 0.0, 0.0, -7.0]),
    ([-1.0, 0.0], [-3.0, -4.0]),
]


def ascending(values) -> np.ndarray:
    return np.array(sorted(np.asarray(values, complex), key=lambda v: (round(v.real, 6), v.imag)))


@pytest.mark.parametrize(("wanted_zeros", "wanted_poles"), PLANTS)
def test_poles_and_zeros_are_those_of_the_polynomials_in_any_coordinates(wanted_zeros, wanted_poles):
    """Those at the origin exactly, and none that rounding makes of a relative degree of two and more."""
    block = as_state_space((np.real(np.poly(wanted_zeros)), np.real(np.poly(wanted_poles))))
    for seed in range(20):
        for unit in (1.0, 1e-6, 1e6):
            Q = orthogonal(len(block.A), seed)
            A, B, C = unit * Q @ block.A @ Q.T, unit * Q @ block.B, block.C @ Q.T
            for found, wanted in ((poles(A), wanted_poles), (zeros(A, B, C, block.D), wanted_zeros)):
                np.testing.assert_allclose(ascending(found / unit), ascending(wanted), rtol=1e-8)
                assert np.sum(found == 0) == np.sum(np.array(wanted) == 0)


def test_zeros_twice_turned_are_those_of_the_polynomials():
    """Entries that are small by cancellation are known to rounding of what they were made of, not of themselves."""
    block = as_state_space(([-4.0, 4.0], [1.0, 1.0, 2.0, 0.0]))
    for seed in range(100):
        Q = orthogonal(3, seed)
        system = epp.LureSystem.build(Q @ block.A @ Q.T, Q @ block.B, block.C @ Q.T, [epp.Saturation()])
        apart = system.with_integrators_apart[0]
        np.testing.assert_allclose(zeros(apart.A, apart.B, apart.C, block.D), [1.0], rtol=1e-8)


def test_zeros_through_a_direct_path():
    block = as_state_space((np.poly([-1.0, -2.0, -3.0]), np.poly([-4.0, 0.0, 0.0])))
    np.testing.assert_allclose(ascending(zeros(block.A, block.B, block.C, block.D)), [-3.0, -2.0, -1.0], rtol=1e-10)


def test_what_reaches_no_output_has_no_zeros():
    A = np.diag([-1.0, -2.0])
    assert zeros(A, np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1))).size == 0


def test_a_chain_of_integrators_has_no_fastest_pole():
    for n in (1, 2, 3, 5):
        for seed in range(10):
            Q = orthogonal(n, seed)
            assert fastest_poles((Q @ np.eye(n, k=1) @ Q.T)[None])[0] == 0.0
    assert fastest_poles(np.diag([-1.0, -3.0])[None])[0] == 3.0
