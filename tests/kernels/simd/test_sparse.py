"""Sums over matrices of which most is zero, against numpy: the compiled ones and their plain twins."""

# ruff: noqa: PLW0108  # intrinsics can be called from compiled functions only

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba import njit

from eppanalysis.kernels.engine.flow import _keep_sparse
from eppanalysis.kernels.simd import plain
from eppanalysis.kernels.simd.sparse import sparse_size_sum, sparse_sum, sparse_sum_from

ROUNDING = 16 * np.finfo(float).eps


@pytest.fixture(scope="module")
def kernels() -> dict[str, Callable[..., Any]]:
    """What is compiled, in functions that can be called from here."""
    made = {
        "sparse_sum": lambda e, rows, ends, w, scale, out: sparse_sum(e, rows, ends, w, scale, out),
        "sparse_sum_from": lambda start, e, rows, ends, w, scale, out: sparse_sum_from(
            start, e, rows, ends, w, scale, out
        ),
        "sparse_size_sum": lambda e, rows, ends, w, scale, out: sparse_size_sum(e, rows, ends, w, scale, out),
        "keep": lambda M, e, rows, ends: _keep_sparse(M, e, rows, ends),
    }
    return {name: njit(f) for name, f in made.items()}


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 1.0])
@pytest.mark.parametrize("shape", [(24, 24), (64, 8), (8, 40)])
def test_sums_over_what_is_not_zero(
    kernels: dict[str, Callable[..., Any]], shape: tuple[int, int], share: float
) -> None:
    random = np.random.default_rng(hash((shape, share)) % 2**32)
    M = random.normal(size=shape) * (random.random(shape) < share)
    weights, start = random.normal(size=shape[0]), random.normal(size=shape[1])
    most = shape[0] * shape[1] // 8
    kept = np.full((most, 8), np.nan), np.zeros(most, np.int64), np.zeros(shape[1] // 8, np.int64)
    kernels["keep"](M, *kept)
    largest = np.abs(weights) @ np.abs(M) + np.abs(start)
    for name, first, wanted in (
        ("sparse_sum", (), weights @ M),
        ("sparse_sum_from", (start,), start + weights @ M),
        ("sparse_size_sum", (), weights @ np.abs(M)),
    ):
        out, twin = np.full((2, shape[1]), np.nan)
        kernels[name](*first, *kept, weights, 0.3, out)
        assert np.all(np.abs(out - 0.3 * wanted) <= ROUNDING * largest)
        getattr(plain, name)(*first, *kept, weights, 0.3, twin)
        np.testing.assert_array_equal(out, twin)
