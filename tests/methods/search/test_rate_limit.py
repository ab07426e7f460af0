"""A limit of position straight before an ideal rate limit, held against a march of its own."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp

#: Step of the march [s], and the rate of the limiter.
STEP, RATE = 2e-3, 0.5
_LOOP = """
kind = "diagram"
title = "Position limit, then an ideal rate limit"
connect = ["-plant -> sat", "sat -> limiter", "limiter -> plant"]
signals = {{ y = {{ of = "plant" }} }}
[blocks]
plant = {{ kind = "transfer_function", num = [{gain}], den = [1, 1, 1, 0], start = [0, 0, 0.1] }}
[elements]
sat = {{ element = "saturation", lower = -1, upper = 1 }}
limiter = {{ element = "rate_limiter", rate = 0.5 }}
[run]
t_end = "200 s"
"""
_SLIDES = (
    "while the limiter follows the limit its output acts straight on itself and the run stops; elements derived from "
    "their automata follow through one another"
)


def _marched(gain: float, t_end: float) -> np.ndarray:
    """The plant's output at each step, its drive held over it (an error of the order of the step)."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.0]])
    one = expm(np.block([[A, [[0.0], [0.0], [gain]]], [np.zeros((1, 4))]]) * STEP)
    x, r, y = np.array([0.1, 0.0, 0.0, 0.0]), 0.0, np.empty(round(t_end / STEP))
    for k in range(y.size):
        r += min(max(min(max(-x[0], -1.0), 1.0) - r, -RATE * STEP), RATE * STEP)
        x[3] = r
        x, y[k] = one @ x, x[0]
    return y


def _period(y: np.ndarray) -> float:
    """The last turn from one upward passage of zero to the next [s]."""
    rises = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    at = rises - y[rises] / (y[rises + 1] - y[rises])
    return float(at[-1] - at[-2]) * STEP


@pytest.mark.xfail(strict=True, reason=_SLIDES)
@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_a_run_through_a_limit_and_an_ideal_rate_limit_goes_on_to_its_end(gain):
    run, y = epp.simulate(epp.case_from_text(_LOOP.format(gain=gain), "rate")), _marched(gain, 200.0)
    last = y[round(150.0 / STEP) :]
    if gain < 1.0:
        assert np.ptp(last) < 1e-3 and run.status is epp.Status.SETTLED
    else:
        assert run.limit_cycle is not None
        assert run.limit_cycle.period == pytest.approx(_period(y), rel=2e-3)
        assert run.limit_cycle.peak_to_peak["y"] == pytest.approx(np.ptp(last), rel=5e-3)


@cache
def _searched(gain: float) -> epp.CycleSearch:
    return epp.find_limit_cycles(epp.case_from_text(_LOOP.format(gain=gain), "rate"))


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason=_SLIDES)
@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_the_search_finds_the_cycle_of_a_limit_before_an_ideal_rate_limit(gain):
    found = _searched(gain)
    assert found.status is epp.Status.CONVERGED
    if gain < 1.0:
        assert found.settles and not len(found)
    else:
        assert not found.settles and len(found.stable) == 1
        assert found.stable[0].period == pytest.approx(11.1646, rel=1e-4)
        assert found.stable[0].peak_to_peak["y"] == pytest.approx(8.1668, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_a_run_that_stops_early_is_no_rest(gain):
    found = _searched(gain)
    # No run comes to its end, and that is what is said.
    assert found.status is epp.Status.CONVERGED or not found.settles
    assert "switches without end" in str(found) or found.status is epp.Status.CONVERGED
