"""Spans of Legendre series against the roots of their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Legendre

from eppanalysis.engine.runs import spans
from tests.shared import mostly_slow

GRID = np.linspace(-1.0, 1.0, 33)


def greatest(series: list[Legendre]) -> float:
    """Over all pieces: at an end, or where the derivative vanishes."""
    turns = [np.real(s.deriv().roots()) for s in series]
    return max(float(s(np.append(u[np.abs(u) <= 1.0], [-1.0, 1.0])).max()) for s, u in zip(series, turns, strict=True))


@pytest.mark.parametrize("pieces", mostly_slow([1, 2, 7], [2]))
def test_the_span_is_that_between_the_extrema_that_the_derivative_tells(pieces):
    rng = np.random.default_rng(pieces)
    c = rng.standard_normal((200, pieces, 16)) * 0.4 ** np.arange(16)
    fine = c @ np.polynomial.legendre.legvander(GRID, 15).T
    found = np.empty(len(c))
    spans(c, fine, GRID, found)
    exact = [greatest([Legendre(k) for k in rows]) + greatest([Legendre(-k) for k in rows]) for rows in c]
    np.testing.assert_allclose(found, exact, rtol=1e-13)
    # Ends of pieces are points of the grid, where rounding says which is the larger; between them the series bend away.
    between = np.asarray(exact) > np.ptp(fine, axis=(1, 2)) * (1.0 + 1e-9)
    assert np.count_nonzero(between) > 50, "extrema lie between the points of the grid"


def test_signals_at_rest_have_no_span():
    c = np.zeros((1, 3, 8))
    c[..., 0] = 5.0
    found = np.empty(1)
    spans(c, np.full((1, 3, 33), 5.0), GRID, found)
    assert found[0] == 0.0
