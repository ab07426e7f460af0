"""Responses of small linear parts and their slopes, against LAPACK and against states in another order."""

from __future__ import annotations

import numpy as np
import pytest

from eppanalysis.engine.balances import response_and_slope

Array = np.ndarray


def responses(A: Array, B: Array, C: Array, s: Array) -> Array:
    out = np.empty((2, s.size, len(C), B.shape[1]), complex)
    response_and_slope(A, B, C, s, np.full(s.shape, 1j), out)
    return out


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_as_lapack_has_them(n: int) -> None:
    rng = np.random.default_rng(n)
    # Rows of zeros are integrators; sizes of states are decades apart.
    A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, 3)), rng.normal(size=(2, n))
    A[rng.uniform(size=n) < 0.3] = 0.0
    size = 10.0 ** rng.uniform(-6, 6, n)
    s = 1j * np.geomspace(1e-3, 1e3, 40)
    inverse = np.linalg.inv(s[:, None, None] * np.eye(n) - A)
    exact = np.array([C @ inverse @ B, -1j * (C @ inverse @ inverse @ B)])
    found = responses(size[:, None] * A / size, size[:, None] * B, C / size, s)
    np.testing.assert_allclose(
        found, exact, rtol=1e-10, atol=1e-12 * np.abs(exact).max(axis=(2, 3), keepdims=True).min()
    )
    turned = rng.permutation(n)
    other = responses(A[turned][:, turned].copy(), B[turned].copy(), C[:, turned].copy(), s)
    np.testing.assert_allclose(other, found, rtol=1e-10, atol=1e-12 * np.abs(exact).min())


def test_at_a_pole_they_are_those_beside_it() -> None:
    """Of an oscillator at its own frequency: 1/(s**2 + 1) at s = j (1 + eps)."""
    A, B, C = np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    response, slope = responses(A, B, C, np.array([1j]))[:, 0, 0, 0]
    beside = 2.0**-52
    assert response == pytest.approx(1.0 / (1.0 - (1.0 + beside) ** 2), rel=1e-3)
    assert abs(slope) == pytest.approx(2.0 * abs(response) ** 2, rel=1e-3)
