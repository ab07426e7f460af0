"""The loop of Clegg's integrator: its cycle against another integrator, and when it would be without resets."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp

CASE = "clegg_loop"


def rates(t, v):
    s, q, p, speed = v
    return [-p, s - q, speed, -p - 2.0 * speed + 3.0 * np.clip(q, -1.0, 1.0)]


EVENTS = [lambda t, v: v[2], lambda t, v: v[1] - 1.0, lambda t, v: v[1] + 1.0]
for event in EVENTS:
    event.terminal = True


def to_the_next_reset(v):
    """Time until the plant passes through zero, the integrator before its reset and the state behind it."""
    t, v = 0.0, np.array(v, float)
    while True:
        # A little ahead by Euler's rule, past the event at which it begins.
        v, t = v + 1e-9 * np.array(rates(t, v)), t + 1e-9
        run = solve_ivp(rates, (t, t + 20.0), v, events=EVENTS, method="DOP853", rtol=1e-12, atol=1e-13)
        t, v = run.t[-1], run.y[:, -1].copy()
        if len(run.t_events[0]):
            return t, abs(v[0]), np.array([0.0, v[1], 0.0, v[3]])


@pytest.fixture(scope="module")
def begin():
    """State of the cycle behind a reset, by another integrator."""
    v = np.array([0.0, 1.9, 0.0, 1.6])
    for _ in range(40):
        v = to_the_next_reset(v)[2]
    return v


@pytest.fixture(scope="module")
def orbit():
    case = epp.case(CASE)
    return epp.exact_orbit(case, epp.predict_limit_cycles(case)[0])


def test_cycle_is_that_of_another_integrator(orbit, begin):
    half, peak, _ = to_the_next_reset(begin)
    assert orbit.period == pytest.approx(2.0 * half, abs=1e-6)
    assert orbit.peak_to_peak["integrator"] == pytest.approx(2.0 * peak, abs=1e-6)
    assert orbit.stable is True


def test_first_order_balances_where_three_lags_leave_what_the_integrator_takes():
    (predicted,) = epp.predict_limit_cycles(epp.case(CASE))
    assert predicted.omega == pytest.approx(np.tan((np.pi - np.arctan(np.pi / 4)) / 3), rel=1e-9)


def test_run_settles_on_the_cycle(orbit):
    case = epp.case(CASE)
    run = epp.simulate(case.to_system(), case.input, t_end=case.t_end)
    assert run.limit_cycle is not None
    assert run.limit_cycle.period == pytest.approx(orbit.period, rel=1e-6)


@pytest.mark.parametrize(("gain", "cycles"), [(2.14, 0), (2.15, 1)])
def test_first_order_has_a_cycle_from_a_gain_on(gain, cycles):
    assert len(epp.predict_limit_cycles(epp.case(CASE).with_values({"gain": gain}))) == cycles


def test_multipliers_are_those_of_the_return_map(orbit, begin):
    """The state jumps in the map of the event; half a turn, from reset to reset, is differentiated by differences."""
    step, map_of = 1e-4, []
    for place in (1, 3):
        ways = [to_the_next_reset(begin + sign * step * np.eye(4)[place])[2][[1, 3]] for sign in (1.0, -1.0)]
        map_of.append((ways[0] - ways[1]) / (2 * step))
    expected = np.sort(np.abs(np.linalg.eigvals(np.array(map_of).T)) ** 2)
    found = np.sort(np.abs(np.asarray(orbit.multipliers)))[-2:]
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)
