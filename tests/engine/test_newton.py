"""Newton's method in one kernel beside the same method step by step, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.describing.balance import Balance, newton_and_jacobian, scales
from eppanalysis.methods.describing.multi import (
    _solve_block,
    choose_pivot,
    inner_newton,
    search_several,
    start_points,
)

RANDOM = np.random.default_rng(11)
N_POINTS = 60


def a_balance(case: str) -> Balance:
    loop, _ = epp.case(case).to_system().with_integrators_apart
    return Balance.of(loop, choose_pivot(loop), np.asarray(loop.v0, float))


def step_by_step(balance: Balance) -> Balance:
    """The same balance, of elements of which no kernel is told the closed form."""
    other = Balance(balance.system, balance.pivot, balance.static)
    other.__dict__["closed_forms"] = None
    return other


def points(balance: Balance) -> np.ndarray:
    """Near limit cycles, far from all of them, and nowhere."""
    cycles = search_several(balance).cycles
    near = cycles[RANDOM.integers(len(cycles), size=N_POINTS)]
    near += 0.03 * scales(balance, near) * RANDOM.normal(size=near.shape)
    X = np.concatenate([near, near + RANDOM.uniform(-2.0, 2.0, near.shape)])
    X[1], X[2, 0], X[3, 0] = np.nan, -299.0, np.inf
    return X


@pytest.mark.parametrize("case", ["fig8a_original", "two_mass_damped_shaft_classical"])
def test_points_go_to_the_same_solutions_in_one_kernel_as_step_by_step(case: str) -> None:
    balance = a_balance(case)
    assert balance.closed_forms is not None
    X = points(balance)
    normal = RANDOM.normal(size=X.shape)
    found = newton_and_jacobian(balance, X, normal, 12, 1e-12)
    wanted = newton_and_jacobian(step_by_step(balance), X, normal, 12, 1e-12)
    assert 0.2 < found[1].mean() < 0.9
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(found, wanted, strict=True))


@pytest.mark.parametrize("case", ["fig8a_original", "two_mass_damped_shaft_classical"])
def test_the_rest_of_a_loop_is_solved_alike_where_amplitude_and_frequency_of_its_pivot_are_given(case: str) -> None:
    balance = a_balance(case)
    X = points(balance)
    L = balance.linear(np.exp(np.nan_to_num(X[:, 1], nan=0.0)))
    found, wanted = inner_newton(balance, X, L), inner_newton(step_by_step(balance), X, L)
    assert 0.2 < found[2].mean() < 0.9
    assert np.array_equal(found[2], wanted[2])
    assert all(np.array_equal(a[found[2]], b[found[2]]) for a, b in zip(found, wanted, strict=True))


@pytest.mark.parametrize("case", ["fig8a_original", "fig6a_original_pulley", "two_mass_damped_shaft_classical"])
def test_block_by_block_all_is_found_that_is_found_at_once(case: str) -> None:
    """And solves all equations but those of the pivot's input."""
    balance = a_balance(case)
    a, omega = RANDOM.uniform(-9.0, 1.0, 400), RANDOM.uniform(0.0, 7.0, 400)
    L = balance.linear(np.exp(omega))
    start = start_points(balance, np.stack([a, omega], -1), L, balance.operating_bias, 1.0)
    X, loop, done = inner_newton(balance, start, L)
    at_once, around, every = start.copy(), loop.copy(), np.ones(len(X), bool)
    _solve_block(balance, np.arange(balance.m), at_once, L, around, every)
    assert every.mean() > 0.1 and not np.any(every & ~done)
    same = np.abs(X - at_once)[every] <= 1e-6 * scales(balance, X[every])
    assert same.all(1).mean() > 0.99
    R, p = balance.residual(X[done])[0], balance.pivot
    assert np.allclose(loop[done], R[:, p] + 1.0 + 1j * R[:, balance.m + p], rtol=1e-6)
    R[:, [p, balance.m + p]] = 0.0
    assert np.all(np.abs(R).max(1) < 1e-6 * (1.0 + np.exp(X[done][:, balance.places]).max(1)))


def test_what_acts_on_nothing_is_a_block_of_its_own() -> None:
    """The elbow's friction has no mean, as its mean speed is zero, and acts on the input of the pivot alone."""
    balance = a_balance("fig8a_original")
    acts = balance.linear(np.ones(1))[0] != 0
    assert balance.solved is not None
    assert [block.tolist() for block in balance.solved.blocks(acts)] == [[0, 1, 2], [3]]


@pytest.mark.parametrize("case", ["sat_plus_backlash", "relay_fopdt_closed", "backlash_discrete_pi"])
def test_what_no_kernel_knows_is_taken_step_by_step(case: str) -> None:
    assert a_balance(case).closed_forms is None


@pytest.mark.parametrize("levels", [(-1.0, 1.0), (1.0, -0.5), (-0.5, 0.8)])
def test_a_relay_with_hysteresis_is_in_the_kernel_what_its_describing_function_says(
    levels: tuple[float, float],
) -> None:
    """Its equations have the same solutions, and its inputs may pass both thresholds, one or none."""
    relay = epp.HysteresisRelay(-0.3, 0.5, *levels)
    system = epp.LureSystem.from_tf(([4.0 * np.sign(levels[1] - levels[0])], [1.0, 2.0, 3.0, 1.0]), relay)
    balance = Balance.of(system, 0, np.asarray(system.v0, float))
    assert balance.closed_forms is not None
    random = np.random.default_rng(7)
    X = random.uniform([-2.0, -1.0, -0.6, -1.0], [1.0, 1.0, 0.8, 1.0], (600, 4))
    normal = random.normal(size=X.shape)
    once, same = (newton_and_jacobian(b, X, normal, 1, 1e-12)[2] for b in (balance, step_by_step(balance)))
    # Where a threshold is only just passed gains rise like a root, of which differences are no derivative.
    top, bottom = X[:, 2] + np.exp(X[:, 0]), X[:, 2] - np.exp(X[:, 0])
    clear = (np.abs(top - relay.upper) > 0.02) & (np.abs(bottom - relay.lower) > 0.02)
    both, none = (top > 0.5) & (bottom < -0.3), (top < 0.5) & (bottom > -0.3)
    assert min(np.sum(clear & part) for part in (both, none, ~both & ~none)) > 10
    assert np.allclose(once[clear], same[clear], rtol=1e-5, atol=1e-5)
    found, ok, _ = newton_and_jacobian(balance, X, normal, 12, 1e-12)
    wanted, also, _ = newton_and_jacobian(step_by_step(balance), X, normal, 12, 1e-12)
    assert ok.mean() > 0.1 and (ok == also).mean() > 0.98
    assert np.allclose(found[ok & also], wanted[ok & also], rtol=1e-9, atol=1e-9)
    R, _ = step_by_step(balance).residual(found[ok])
    assert np.abs(R).max() < 1e-9


@pytest.mark.parametrize("limiter", [epp.RateLimiter(4.0), epp.RateLimitedServo(9.0, 4.0)])
def test_a_limited_rate_is_in_the_kernel_what_its_describing_function_says(limiter: epp.Nonlinearity) -> None:
    """Its error is below its limit, above it, and so large that the output never follows."""
    system = epp.LureSystem.from_blocks(
        [([4.0, 6.0, 2.0], [0.05, 1.0, 0.0]), limiter, ([1.0], [1.0, 0.2, 0.0]), epp.Saturation(-1.0, 1.0)]
    )
    balance = Balance.of(system, 1, np.asarray(system.v0, float))
    assert balance.closed_forms is not None
    random = np.random.default_rng(7)
    X = random.uniform([-2.0, -1.0, -3.0, -2.0, -0.1, -0.1, -1.0], [2.0, 3.0, 3.0, 2.0, 0.1, 0.1, 1.0], (400, 7))
    normal = random.normal(size=X.shape)
    once, same = (newton_and_jacobian(b, X, normal, 1, 1e-12)[2] for b in (balance, step_by_step(balance)))
    assert np.allclose(once, same, rtol=1e-5, atol=1e-5 * np.abs(same).max((1, 2), keepdims=True))
    found, ok, _ = newton_and_jacobian(balance, X, normal, 12, 1e-12)
    wanted, also, _ = newton_and_jacobian(step_by_step(balance), X, normal, 12, 1e-12)
    assert ok.sum() > 20 and (ok == also).mean() > 0.98
    assert np.isclose(found[ok & also], wanted[ok & also], rtol=1e-9, atol=1e-9).all(1).mean() > 0.98
    R, _ = step_by_step(balance).residual(found[ok])
    assert np.abs(R).max() < 1e-9
