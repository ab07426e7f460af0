"""Exact orbits against closed forms, long event-exact runs and a shooting code on scipy's integrator."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.results import Status
from tests.reference.elbow_reference import ROWS, row
from tests.reference.turns import closed_turn
from tests.shared import cycles_of, predicted
from tests.stress.families import problem


def run_of(name):
    case = epp.case(name)
    return case, epp.simulate(case.to_system(), case.input, t_end=3.0 * case.t_end).limit_cycle


def exact_of(name):
    """The exact orbit near where a run of the case ends."""
    case, cycle = run_of(name)
    found = cycles_of(name)
    return case, cycle, min(found, key=lambda c: abs(c.period - cycle.period))


def relay_half_period(num, den, hysteresis, guess):
    """Half period h from C (1 + e^{Ah})^{-1} int e^{As} ds B = hysteresis (Astrom), by an augmented exponential."""
    n = len(den) - 1
    A = np.vstack([-np.array(den[1:], float), np.eye(n - 1, n)])
    B = np.eye(n, 1)
    C = np.concatenate([np.zeros(n - len(num)), num])

    def switching(h):
        both = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * h)
        # x(h) = -x(0) behind a switch to +1: x(h) = e^{Ah} x(0) + integral.
        return float(C @ np.linalg.solve(np.eye(n) + both[:n, :n], both[:n, n])) - hysteresis

    return brentq(switching, *guess, xtol=1e-15, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "period"),
    [
        ("relay_ideal_khalil79", 2 * relay_half_period([1.0], [1.0, 3.0, 2.0, 0.0], 0.0, (2.0, 2.5))),
        ("relay_fopdt_closed", 2.0 * math.log(2.0 * math.exp(0.5) - 1.0)),
        ("relay_hyst_servo", 2.0 * brentq(lambda h: h / 2 - math.tanh(h / 2) - 0.1, 1.0, 2.0, xtol=1e-15, rtol=1e-15)),
        ("thruster_dz_hyst", 19.6),
    ],
)
def test_relay_loops_meet_tsypkins_closed_forms(name, period):
    _, _, exact = exact_of(name)
    assert exact.period == pytest.approx(period, rel=1e-12)
    assert exact.residual < 1e-12


def test_amplitude_of_the_relay_with_dead_time_is_closed_too():
    # G = exp(-0.5 s)/(s + 1): the output goes on for the dead time towards the relay's level.
    _, _, exact = exact_of("relay_fopdt_closed")
    assert exact.peak_to_peak["x"] / 2 == pytest.approx(1.0 - math.exp(-0.5), rel=1e-12)


@pytest.mark.parametrize(
    "name",
    [
        "fig8a_original",
        "fig6a_original_pulley",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("gain_brings_it_back", "elbow")),
    ],
)
def test_elbow_orbits_agree_with_long_runs(name):
    _, cycle, exact = exact_of(name)
    assert exact.stable
    assert exact.residual < 1e-11
    assert exact.period == pytest.approx(cycle.period, rel=1e-9)
    for signal, span in cycle.peak_to_peak.items():
        assert exact.peak_to_peak[signal] == pytest.approx(span, rel=1e-9), signal


def test_orbit_agrees_with_shooting_on_scipy():
    # Saturation in a negative-resistance oscillator: x = -G y, G = -s/(s^2 + 0.8 s + 8).
    def rate(t, v):
        y = np.clip(v[0], -1.0, 1.0)
        return [-0.8 * v[0] - 8.0 * v[1] + y, v[0]]

    def periodicity(u):
        out = solve_ivp(rate, (0.0, u[1]), [u[0], 0.0], method="DOP853", rtol=1e-13, atol=1e-14, max_step=0.02)
        return [out.y[0, -1] - u[0], out.y[1, -1]]

    start, period = fsolve(periodicity, [1.45, 2.22], xtol=1e-13)
    _, _, exact = exact_of("sat_khalil710")
    assert exact.period == pytest.approx(period, rel=1e-9)
    assert start > 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 3, 4])
def test_oscillating_rows_of_the_truth_table_agree_with_shooting_on_scipy(number):
    """An integrator and equations that share nothing with the package, to the last turn of its return map."""
    case = epp.case(ROWS[number]["name"])
    system, value = case.to_system(), case.operating_point
    exact = epp.exact_orbit(system, next(c for c in predicted(case.name) if c.stable), value)
    turn = closed_turn(row(number), settle=1.0)
    assert turn.change < 1e-10
    assert exact.period == pytest.approx(turn.period, rel=1e-9)
    assert exact.peak_to_peak["theta"] == pytest.approx(turn.peak_to_peak, rel=1e-9)


@pytest.mark.parametrize("name", ["van_der_pol_mu1", "belt_leine"])
def test_smooth_elements_are_closed_to_rounding(name):
    case, _, exact = exact_of(name)
    expected = case.expected.exact[0]
    assert exact.residual < 1e-12
    assert exact.period == pytest.approx(expected.period, rel=1e-12)
    assert exact.peak_to_peak[case.expected.signal] / 2 == pytest.approx(expected.amplitude, rel=1e-12)


def test_run_from_an_exact_orbit_stays_on_it():
    case, _, exact = exact_of("backlash_servo")
    system = replace(case.to_system(), x0=exact.state, memory=exact.memory)
    run = epp.simulate(system, t_end=40 * exact.period)
    assert run.limit_cycle.period == pytest.approx(exact.period, rel=1e-11)


def test_exact_orbit_from_a_prediction():
    case = epp.case("sat_am165")
    exact = epp.exact_orbit(case, predicted(case.name)[0])
    assert exact.status is Status.CONVERGED
    assert exact.method == "exact orbit"
    assert exact.period == pytest.approx(case.expected.exact[0].period, rel=1e-12)


def test_prediction_without_an_orbit_gives_a_status():
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    other = epp.LureSystem.from_tf(([9.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    found = epp.exact_orbit(loop, epp.predict_limit_cycles(other)[0])
    assert found.status is Status.NOT_CONVERGED


def test_moving_inputs_are_refused():
    system = epp.case("fig8a_original").to_system()
    moving = epp.OperatingPoint.of(system, epp.inputs.Ramp(0.01, 0.0), time=1.0)
    with pytest.raises(EppError, match="'harness_position' is a ramp that has not ended at 1 s"):
        epp.exact_orbit(system, predicted("fig8a_original")[0], moving)


def test_an_orbit_has_all_the_switches_of_its_motion():
    """A body on a belt, stuck for most of a period, in whose bristles it rings: the velocity changes its sign behind
    the first switch of the stick, again and again. Fewer switches close, too: on the longest arc, behind its begin.
    """
    friction = epp.LuGreFriction(400.0, 0.5, 0.8, 0.05, damping=5.0, viscous=0.1)
    belt = epp.LureSystem.build(
        [[0.0, 1.0], [-4.0, 0.0]], [[0.0], [-1.0]], [[0.0, 1.0]], [friction], constant_input=[-0.05]
    )
    found = epp.exact_orbit(belt, epp.simulate(belt, t_end=60.0).limit_cycle)
    run = epp.simulate(replace(belt, x0=found.state, memory=found.memory), t_end=0.999 * found.period)
    # The last event of a period is where it begins.
    assert run.n_events == len(found.events) == 8
    assert [e.time for e in run.events][1:] == pytest.approx([e.time for e in found.events][:-1], abs=1e-8)


@pytest.mark.slow
def test_motions_far_faster_than_the_loop_are_no_cycles_because_they_nearly_close():
    """A relay behind two poles more than zeros, in turned states: its input moves by h**2 beside terms of h, so that
    motions of every size close to rounding of these. Tsypkin's locus says that there is none, by numbers of 60 digits.
    """
    loop = problem("relay on lags", 306).system
    flint = pytest.importorskip("flint")
    A, B, C = (flint.arb_mat(m.tolist()) for m in (loop.A, loop.B, loop.C))
    one = flint.arb_mat(np.eye(len(loop.A)).tolist())
    # The product that is zero but for rounding; what it is would decide at the smallest sizes alone.
    assert abs(loop.C @ loop.B)[0, 0] < 1e-15 * np.linalg.norm(loop.C) * np.linalg.norm(loop.B)
    misses = []
    for h in (2.5e-7, 1e-6, 5e-6):
        with flint.ctx.workdps(60):
            E = (A * h).exp()
            start = (one + E).solve(-1 * A.solve((E - one) * B))
            misses.append(float((C * start)[0, 0] / (C * (A * start + B))[0, 0]) / h)
    # Where such a motion would switch it is late by a share of h that grows with h, of one sign: it closes nowhere.
    assert len(set(np.sign(misses))) == 1 and np.all(np.abs(np.diff(np.log(np.abs(misses)))) > 0.5)
    assert not len(epp.find_limit_cycles(loop))


def test_a_motion_that_has_gone_beyond_all_range_is_no_orbit_and_warns_of_nothing():
    """As where Newton's method has gone astray: what it misses by, in sizes of the motion, has no number."""
    astray = SimpleNamespace(r=np.array([1e300, 0.0]), row_scale=np.array([1e-300, 1.0]))
    with np.errstate(all="warn"):
        assert Orbit.residual.func(astray) == np.inf
