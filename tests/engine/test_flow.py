"""Exact steps and their bounds, against matrix exponentials of scipy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.engine._engine import parts
from eppanalysis.engine.tables import padded
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.simulation.workspaces import of_thread
from eppanalysis.models.systems.hybrid import HybridSystem

Array = NDArray[np.float64]


def random_matrix(seed: int, n: int, size: float) -> Array:
    """A matrix of the engine: padded with zeros."""
    M = np.zeros((padded(n), padded(n)))
    M[:n, :n] = size * np.random.default_rng(seed).standard_normal((n, n))
    return M


@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(1e-3, 30.0), st.floats(1e-4, 0.3))
@settings(max_examples=60, deadline=None)
def test_the_flow_is_the_matrix_exponential(seed: int, n: int, size: float, h: float) -> None:
    M = random_matrix(seed, n, size)
    integral, power, half, *workspace = np.zeros((8, *M.shape))
    rate = parts.growth_rate(M, workspace[0], workspace[1])
    parts.flow(M, h, rate, integral, power, half, workspace[0], workspace[1])
    both = np.zeros((2 * n, 2 * n))
    both[:n, :n], both[:n, n:] = M[:n, :n], np.eye(n)
    whole, middle = expm(both * h), expm(M[:n, :n] * h / 2)
    # Of a single state scipy's exponential, not this one, was seen to be off by 1.3e-13.
    scale = 10.0 * np.exp(h * np.linalg.norm(M, 2))
    np.testing.assert_allclose(power[:n, :n], whole[:n, :n], rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(integral[:n, :n], whole[:n, n:], rtol=0, atol=1e-13 * scale * h)
    np.testing.assert_allclose(half[:n, :n], middle, rtol=0, atol=1e-13 * scale)


@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(1e-6, 1e6))
@settings(max_examples=60, deadline=None)
def test_powers_grow_no_faster_than_their_bound_says(seed: int, n: int, size: float) -> None:
    M = random_matrix(seed, n, size)
    rate = parts.growth_rate(M, *np.zeros((2, *M.shape)))
    assert np.abs(np.linalg.eigvals(M)).max() <= rate * (1 + 1e-9)
    assert rate <= np.linalg.norm(M) * (1 + 1e-9)


@pytest.fixture(scope="module", params=["fig8a_original", "two_mass_deadzone", "relay_hyst_servo"])
def compiled(request: pytest.FixtureRequest) -> tuple[Any, int, int, float]:
    """A combination of modes that a run has met: all of them, its place, the number of states, and the step."""
    case = epp.case(request.param)
    system = case.to_system()
    inputs = {system.input_names[0]: case.input} if system.input_names else {}
    hybrid = HybridSystem.from_lure(system, inputs)
    base = 2.0 * hybrid.time_scale
    run_hybrid(hybrid, case.t_end, np.zeros(0), base, 20_000, 1)
    combinations, work, _ = of_thread.workspaces(hybrid, base)
    q = int(np.flatnonzero(combinations.ready)[0])
    parts.compile_long(combinations, work, q)
    return combinations, q, hybrid.x0.size, float(combinations.step[q])


def test_no_guard_strays_further_from_its_cubic_than_the_bound(compiled: tuple[Any, int, int, float]) -> None:
    combinations, q, n, h = compiled
    M, rows = combinations.M[q, :n, :n].T, combinations.gf[q, : combinations.n_guards[q], :n]
    generator = np.random.default_rng(7)
    share = []
    for _ in range(40):
        rate = generator.standard_normal(n) * 10.0 ** generator.uniform(-3, 3, n)
        v = np.linspace(0.0, 1.0, 41)
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = M, rate
        # What a guard adds to its start: its row on the increment of the state.
        g = np.array([rows @ expm(both * (h * u))[:n, n] for u in v])
        slope = np.array([rows @ expm(M * (h * u)) @ rate for u in (0.0, 1.0)]) * h
        cubic = (
            np.outer(v * (1 - v) ** 2, slope[0])
            + np.outer(v**2 * (3 - 2 * v), g[-1])
            - np.outer(v**2 * (1 - v), slope[1])
        )
        stray = np.abs(g - cubic).max(axis=0)
        bound = np.abs(rate) @ combinations.bound[q, :n, : len(rows)]
        noise = 1e-14 * np.abs(rows) @ np.abs(rate) * h
        assert np.all(stray <= bound + noise)
        share.append(np.max(stray[bound > noise] / bound[bound > noise], initial=0.0))
    # The bound is one that is worth having: some guard comes near it.
    assert max(share) > 0.05


def test_no_guard_moves_further_on_a_long_step_than_its_reach(compiled: tuple[Any, int, int, float]) -> None:
    combinations, q, n, h = compiled
    M, rows = combinations.M[q, :n, :n].T, combinations.gf[q, : combinations.n_guards[q], :n]
    steps = 16
    generator = np.random.default_rng(8)
    for _ in range(10):
        rate = generator.standard_normal(n)
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = M, rate
        moved = np.array([rows @ expm(both * (h * s))[:n, n] for s in np.linspace(0.0, steps, 161)])
        reach = np.abs(rate) @ combinations.reach[q, 0, :n, : len(rows)]
        assert np.all(np.abs(moved).max(axis=0) <= reach * (1 + 1e-12))


def test_the_step_carries_state_rate_and_guards(compiled: tuple[Any, int, int, float]) -> None:
    combinations, q, n, h = compiled
    M, rows = combinations.M[q, :n, :n].T, combinations.gf[q, : combinations.n_guards[q], :n]
    wide, half = combinations.M.shape[1], combinations.bound.shape[2]
    rate = np.random.default_rng(9).standard_normal(n)
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n] = M, rate
    increment, end_rate = expm(both * h)[:n, n], expm(M * h) @ rate
    end = rate @ combinations.T[q, :n]
    size = np.abs(rate).max()
    np.testing.assert_allclose(end[:n], increment, rtol=0, atol=1e-12 * np.abs(increment).max())
    np.testing.assert_allclose(end[wide : wide + n], end_rate, rtol=0, atol=1e-12 * np.abs(end_rate).max())
    first = 2 * wide
    for place, value in ((first, rows @ increment), (first + half, rows @ end_rate)):
        scale = 1e-12 * (np.abs(rows).max() * max(np.abs(end_rate).max(), size))
        np.testing.assert_allclose(end[place : place + len(rows)], value, rtol=0, atol=scale)
