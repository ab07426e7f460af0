"""The joint of a small robot against scipy's integration of its equations by hand, direction by direction."""

import numpy as np
from scipy.integrate import solve_ivp

import eppanalysis as epp


def motion(x):
    """Torque on the motor without its brushes' friction, and acceleration of the arm; angles q, p and speeds v, w."""
    q, v, p, w = x
    ratio, resistance, constant = 250.0, 3.0, 0.004
    dead = np.radians(0.2)
    error = -p
    volts = np.clip(60.0 * (error - np.clip(error, -dead, dead)), -6.0, 6.0)
    twist, gap = q - p, np.radians(0.5)
    push = 40.0 * (abs(twist) - gap) + 0.05 * np.sign(twist) * (v - w)
    gears = np.sign(twist) * max(0.0, push) if abs(twist) > gap else 0.0
    torque = ratio * constant * (volts - ratio * constant * v) / resistance - gears
    return torque, (gears - 0.002 * w) / 0.004


def by_hand(times):
    """States at given times: the motor slides one way, or is held by the brushes up to their friction."""
    inertia, friction, t, sign = 1e-7 * 250.0**2, 0.04, 0.0, 0.0
    x, found = np.array([0.0, 0.0, np.radians(5.0), 0.0]), []

    def rates(t, x):
        torque, arm = motion(x)
        return [x[1], (torque - sign * friction) / inertia if sign else 0.0, x[3], arm]

    def stops(t, x):
        return x[1] * sign

    def breaks(t, x):
        return abs(motion(x)[0]) - friction

    stops.terminal = breaks.terminal = True
    stops.direction, breaks.direction = -1.0, 1.0
    while t < times[-1]:
        torque = motion(x)[0]
        sign = np.sign(torque) if abs(torque) >= friction * (1.0 - 1e-9) else 0.0
        x[1] = 1e-13 * sign
        event = stops if sign else breaks
        run = solve_ivp(
            rates, (t, times[-1]), x, "DOP853", rtol=1e-9, atol=1e-12, events=event, dense_output=True, max_step=2e-3
        )
        inside = times[(times >= t) & ((times < run.t[-1]) | (run.t[-1] == times[-1]))]
        found += [run.sol(s) for s in inside]
        t, x = run.t[-1], run.y[:, -1]
    return np.array(found)


def test_run_is_that_of_another_integrator():
    times = np.linspace(0.0, 0.4, 201)
    run = epp.simulate(epp.case("robot_servo"), t_end=0.4, t_eval=times)
    found = by_hand(times)
    np.testing.assert_allclose(run.signals["arm"], found[:, 2], atol=1e-7)
    np.testing.assert_allclose(run.signals["twist"], found[:, 0] - found[:, 2], atol=1e-7)
    assert np.ptp(found[:, 2]) > 0.1
