"""Units of states in which a matrix has rows as long as its columns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.linalg import matrix_balance

from eppanalysis.models.systems.linear import balanced


def matrix(seed: int, n: int, decades: float) -> np.ndarray:
    """Entries over so many decades, a third of them zero."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-decades, decades, (n, n)) * (rng.random((n, n)) > 1 / 3)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.sampled_from([1.0, 6.0, 30.0]))
def test_units_are_those_of_lapack(seed: int, n: int, decades: float) -> None:
    A = matrix(seed, n, decades)
    even, units = balanced(A)
    with np.errstate(invalid="ignore"):  # scipy casts the units to whole numbers, too
        expected, (sizes, _) = matrix_balance(A, permute=False, separate=True)
    assert np.array_equal(units, sizes)
    assert np.array_equal(even, expected)
    assert np.array_equal(even * units[:, None] / units, A)


def test_a_matrix_without_states_has_no_units() -> None:
    even, units = balanced(np.zeros((0, 0)))
    assert even.shape == (0, 0)
    assert units.shape == (0,)


@pytest.mark.parametrize("none", [np.nan, np.inf])
def test_what_is_no_number_is_refused(none: float) -> None:
    with pytest.raises(ValueError, match="infs or NaNs"):
        balanced(np.array([[1.0, none], [0.0, 1.0]]))
