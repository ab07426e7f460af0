"""A limit of position straight before an ideal rate limit, held against a march of its own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

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


def _marched(gain: float, t_end: float) -> np.ndarray:
    """The plant's output at each step, its drive held over it (an error of the order of the step)."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.0]])
    one = expm(np.block([[A, np.array([[0.0], [0.0], [gain]])], [np.zeros((1, 4))]]) * STEP)
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


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_the_search_finds_the_cycle_of_a_limit_before_an_ideal_rate_limit(gain):
    found = epp.find_limit_cycles(epp.case_from_text(_LOOP.format(gain=gain), "rate"))
    assert found.status is epp.Status.CONVERGED
    if gain < 1.0:
        assert found.settles and not len(found)
    else:
        assert not found.settles and len(found.stable) == 1
        assert found.stable[0].period == pytest.approx(11.1646, rel=1e-4)
        assert found.stable[0].peak_to_peak["y"] == pytest.approx(8.1668, rel=1e-4)


_BEFORE = [
    epp.Play(0.2), epp.HysteresisRelay(-0.3, 0.3), epp.Saturation(-0.4, 0.8), epp.Relay(-0.6, 0.8, 0.1),
    epp.RelayDeadZone(0.2), epp.Preload(0.3, 0.5), epp.Quantiser(0.3, 20),
]  # fmt: skip


@pytest.mark.parametrize("element", _BEFORE)
def test_an_ideal_rate_limit_follows_an_element_straight_before_it(element):
    loop = epp.LureSystem.from_blocks([element, epp.RateLimiter(RATE), ([1.5], [1.0, 2.0, 1.0, 0.0])])
    times = np.arange(1.0, 31.0)
    run = epp.simulate(loop, t_end=30.0, t_eval=times)
    # The same in small steps: the element by its map, the limiter, whose output is the last state, by its definition.
    A, B, step = loop.A[:3, :3], loop.A[:3, 3:], 1e-3
    one = expm(np.block([[A, B], [np.zeros((1, 4))]]) * step)
    x, memory, marched = loop.x0.copy(), None, []
    for _ in range(round(30.0 / step)):
        asked, memory = element.output(loop.C[0] @ x, memory)
        x[3] += min(max(float(asked) - x[3], -RATE * step), RATE * step)
        x = one @ x
        marched.append(loop.C[0] @ x)
    known = np.array(marched)[np.round(times / step).astype(int) - 1]
    assert np.ptp(known) > 0.5
    assert run.signals[loop.signals.names[0]] == pytest.approx(known, abs=5e-3 * np.ptp(known))
    Q = np.linalg.qr(np.random.default_rng(4).normal(size=loop.A.shape))[0]
    turned = epp.simulate(loop.in_coordinates(Q, Q.T), t_end=30.0, t_eval=times)
    assert turned.n_events == run.n_events


@pytest.mark.parametrize("band", [0.0, 0.2])
def test_the_cycle_of_a_relay_before_an_ideal_rate_limit_is_that_of_its_ramps(band):
    """The drive of 3/((s + 1)(s + 2)) goes from -1 to 1 at a rate of 4 and stays there: half a period, by matrices."""
    element = epp.HysteresisRelay(-band, band) if band else epp.Relay()
    loop = epp.LureSystem.from_blocks([element, epp.RateLimiter(4.0), ([3.0], [1.0, 3.0, 2.0])])
    # The state with its drive and the rate of that.
    A = np.array([[0.0, 1.0, 0.0, 0.0], [-2.0, -3.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]])

    def beyond(half: float) -> float:
        """The output where the drive begins to rise, with the state half a period later its negative."""
        free = expm(A[:2, :2] * half)
        held = expm(A * (half - 0.5)) @ ((expm(0.5 * A) @ [0.0, 0.0, -1.0, 4.0]) * [1.0, 1.0, 1.0, 0.0])
        return 3.0 * float(np.linalg.solve(np.eye(2) + free, -held[:2])[0]) + band

    found = epp.find_limit_cycles(loop)
    assert found.status is epp.Status.CONVERGED and len(found) == 1 and found[0].stable
    assert found[0].method == "exact orbit"
    assert found[0].period == pytest.approx(2.0 * brentq(beyond, 0.6, 3.0, xtol=1e-14), rel=1e-9)


@pytest.mark.parametrize(("num", "sample_time", "gain"), [([1.0], 0.1, 1.0), ([2.0, 3.0], 0.4, 0.5)])
def test_a_sampled_loop_rests_behind_an_ideal_rate_limiter(num, sample_time, gain):
    """It chases the last digits of each sample at its full rate, for as short a time: that is no motion."""
    loop = epp.Diagram(
        parts={
            "law": epp.blocks.Gain(gain=gain, sample_time=sample_time),
            "limiter": epp.RateLimiter(rate=2.0),
            "plant": epp.blocks.TransferFunction(num=num, den=[1.0, 4.0, 2.0], start=[0.3, -0.2]),
        },
        connect=["-plant -> law", "law -> limiter", "limiter -> plant"],
    ).to_system()
    run = epp.simulate(loop, t_end=80.0)
    assert run.status is epp.Status.SETTLED and abs(run.settled_at["plant"]) < 1e-9
    found = epp.find_limit_cycles(loop)
    assert found.status is epp.Status.CONVERGED and not found.cycles and found.settles and not found.diverges
