"""Compiled steps of Newton's method beside numpy's linear algebra, and their Jacobian beside differences."""

from __future__ import annotations

import numpy as np

import eppanalysis as epp
from eppanalysis.engine.balances import drive
from eppanalysis.methods.describing.balance import Balance, moved, scales, solved, solved_in_part

RANDOM = np.random.default_rng(5)


def an_elbow() -> tuple[Balance, np.ndarray]:
    """The balance of the paper's elbow, and points where every element is in play."""
    case = epp.case("fig8a_original")
    balance = Balance.of(case.to_system(), 2, np.asarray(case.to_system().v0, float))
    amplitude, phase = np.exp(RANDOM.uniform(-3.0, 2.0, (6, 4))), RANDOM.uniform(-3.0, 3.0, (6, 4))
    bias, omega = RANDOM.uniform(-1e-2, 1e-2, (6, 4)), RANDOM.uniform(5.0, 80.0, 6)
    return balance, balance.pack(amplitude, phase, bias, omega, np.full(6, 1.3))


def test_the_jacobian_is_that_of_the_residual() -> None:
    balance, X = an_elbow()
    R, J = balance.residual(X)
    step = 1e-6 * scales(balance, X)
    for column in range(X.shape[1]):
        up, down = X.copy(), X.copy()
        up[:, column] += step[:, column]
        down[:, column] -= step[:, column]
        slope = (balance.residual(up)[0] - balance.residual(down)[0]) / (2.0 * step[:, [column]])
        size = np.abs(J).max(-1) + np.abs(R)
        assert np.all(np.abs(slope - J[:, :, column]) * scales(balance, X)[:, [column]] < 2e-5 * size)


def test_systems_are_solved_with_their_border_and_in_part() -> None:
    J, R = RANDOM.normal(size=(5, 4, 5)) * np.exp(RANDOM.normal(size=(5, 4, 1)) * 5), RANDOM.normal(size=(5, 4))
    border = RANDOM.normal(size=(5, 5))
    whole, right = np.concatenate([J, border[:, None]], 1), np.column_stack([R, np.full(5, 0.7)])
    found, regular = solved(J, R, border, 0.7)
    assert regular.all()
    assert np.allclose(found, np.linalg.solve(whole, right[..., None])[..., 0], rtol=1e-10)
    rows, columns = np.array([0, 2, 3]), np.array([1, 2, 4])
    part, regular = solved_in_part(J, R, rows, columns, border)
    wanted = np.linalg.solve(J[:, rows[:, None], columns], R[:, rows, None])[..., 0]
    assert regular.all()
    assert np.allclose(part[:, columns], wanted, rtol=1e-10)
    assert np.all(part[:, [0, 3]] == 0.0)


def test_one_system_that_cannot_be_solved_leaves_the_others_alone() -> None:
    J, R, border = np.tile(np.eye(3)[:2], (3, 1, 1)), np.ones((3, 2)), np.tile(np.eye(3)[2], (3, 1))
    J[1, 0, 0] = np.nan
    border[2] = [1.0, 1.0, 0.0]
    found, regular = solved(J, R, border, 1.0)
    assert regular.tolist() == [True, False, True]
    assert found[0].tolist() == [1.0, 1.0, 1.0]
    assert not found[1].any()
    assert np.abs(found[2]).max() > 1e9


def test_inputs_for_given_gains_are_those_of_linear_algebra() -> None:
    owner, others, pivot = np.array([0, 1, 1, 2]), np.array([0, 2]), 1
    L, gains = (RANDOM.normal(size=(2, 7, *shape)) for shape in ((3, 4), (4,)))
    L, gains = L[0] + 1j * L[1], gains[0] + 1j * gains[1]
    L[3, :, 0] = 0.0
    Z = np.tile([0.0, 1.5, 0.0], (7, 1)).astype(complex)
    drive(L, gains, owner, others, pivot, Z)
    returns = (L * (gains * Z[:, owner])[:, None]).sum(-1)
    assert np.all(Z[:, pivot] == 1.5)
    assert np.allclose(returns[:, others], Z[:, others], rtol=1e-12)


def test_steps_are_shortened_by_their_largest_part_in_its_own_scale() -> None:
    balance, X = an_elbow()
    step = RANDOM.normal(size=X.shape) * scales(balance, X)
    step[0] *= 1e-3
    step[1, 1] = 1e4
    before, length = X.copy(), (np.abs(step) / scales(balance, X)).max(-1)
    largest, sound = moved(balance, X, step, 0.7)
    assert np.allclose(largest, length, rtol=1e-12)
    assert np.allclose(before - X, step * np.minimum(1.0, 0.7 / length)[:, None], rtol=1e-9, atol=1e-14)
    assert sound.all()
    X[2, 0], X[3, 4] = 400.0, np.nan
    assert moved(balance, X, np.zeros_like(X), 0.7)[1].tolist() == [True, True, False, False, True, True]
