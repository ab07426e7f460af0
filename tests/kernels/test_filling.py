"""Arrays copied and added into slices by loops: what numpy's assignments give, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.filling import accumulate, fill, fill_rows, largest

NUMBERS = np.random.default_rng(4)


@njit(nogil=True)
def _all(out, source, factor, row):
    fill_rows(out[:, 1:], source)
    fill(row[:2], source[0])
    accumulate(out[0], factor, row)
    return largest(source)


def test_slices_hold_what_numpy_writes_there() -> None:
    out, source, row = NUMBERS.normal(size=(3, 4)), NUMBERS.normal(size=(3, 3)), NUMBERS.normal(size=4)
    expected, expected_row = out.copy(), row.copy()
    expected[:, 1:] = source
    expected_row[:2] = source[0, :2]
    expected[0] += 0.3 * expected_row
    assert _all(out, source, 0.3, row) == np.abs(source).max()
    assert np.array_equal(out, expected)
    assert np.array_equal(row, expected_row)


@pytest.mark.parametrize("place", [0, 4, 8])
def test_largest_of_what_is_no_number_is_none(place: int) -> None:
    source = np.ones((3, 3))
    source.flat[place] = np.nan
    assert np.isnan(_all(np.zeros((3, 4)), source, 1.0, np.zeros(4)))
