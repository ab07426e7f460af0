"""The derivative of an orbit's equations by a parameter, against forward mode in 40 digits, and what it moves."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.optimize

import eppanalysis as epp
from eppanalysis.methods.continuation.families import Family, slope_of
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.continuation.steps import locate, make_point, step
from eppanalysis.methods.orbits.arcs import Arcs
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.orbits.orbit import CONVERGED, evaluate, solve
from eppanalysis.methods.orbits.shooting import orbits_near
from tests.shared import mostly_slow

RELAY = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))


def _evaluated(family, value, orbit, moved=0.0):
    """The equations of an orbit's arcs at a value, with what the system itself sets in y, and unknowns moved."""
    hybrid = family.at(value)
    y, tau = orbit.moved(moved + np.zeros(orbit.r.size))
    y[hybrid.n_plant : hybrid.x0.size] = hybrid.x0[hybrid.n_plant :]
    return evaluate(hybrid, Arcs.build(hybrid, orbit.arcs.event_sequence, orbit.arcs), y, tau)


def _power_law(half, at, twice, value):
    """Derivatives of entries ``a + b p^k``: from their values at p/2, p and 2 p these follow without a small step."""
    below, above, out = at - half, twice - at, np.zeros_like(at)
    varies = (below != 0.0) | (above != 0.0)
    power = np.log2(above[varies] / below[varies])
    assert np.max(np.abs(power - np.round(power)), initial=0.0) < 1e-6
    out[varies] = np.round(power) * above[varies] / (2.0 ** np.round(power) - 1.0) / value
    return out


def _forward_mode(build, value, orbit):
    """The derivative by exponentials of twice the size (Van Loan), of arrays whose entries follow power laws."""
    flint = pytest.importorskip("flint")
    here = orbit.arcs
    hybrids = [build(f * value) for f in (0.5, 1.0, 2.0)]
    arcs = [Arcs.build(h, here.event_sequence, here) for h in hybrids]
    n, N = here.F.shape[1:]

    def pair(name, arc):
        """An array of an arc, squared up, and its derivative."""
        arrays = []
        for a in (getattr(arcs[1], name)[arc], _power_law(*(getattr(a, name)[arc] for a in arcs), value)):
            square = np.zeros((N, N))
            square[: n if name == "F" else N] = a
            arrays.append(square)
        full, slope = arrays
        return flint.arb_mat(np.block([[full, slope], [np.zeros((N, N)), full]]).tolist())

    start = np.zeros(N)
    start[hybrids[1].n_plant : hybrids[1].x0.size] = _power_law(*(h.x0[h.n_plant :] for h in hybrids), value)
    shift = _power_law(*(a.shift for a in arcs), value)
    with flint.ctx.workdps(40):
        z, guards = flint.arb_mat([[v] for v in [*start.tolist(), *orbit.y.tolist()]]), []
        for arc in range(here.n_arcs):
            tau, at_once = float(orbit.tau[arc]), here.event_sequence.at_once[arc]
            z = (pair("F", arc) * flint.arb(tau)).exp() * z
            begins_on_it = at_once == 2 and tau != 0.0
            guards.append(0.0 if at_once == 1 else float((pair("g", arc) * z)[0, 0]) / (tau if begins_on_it else 1.0))
            z = pair("J", arc) * z
        moved = np.array([float(z[i, 0]) for i in range(N)]) - start - shift * orbit.period
        return np.array([*moved[here.free], *guards])


def _orbit(case, i=0):
    found, hybrid = list(epp.find_limit_cycles(case))[i], steady_case(case)
    return next(iter(orbits_near(hybrid, *start_of(hybrid, found), found.period)))


#: Elbows, rings, matrices and diagrams: with plays, friction that sticks, limits, dead time, a bias.
KINDS = [
    ("relay_deadzone", ["relay_dead_zone.threshold", "relay_dead_zone.level"]),
    ("relay_fopdt_closed", ["loop.delay"]),
    ("sat_plus_backlash", ["saturation.lower", "play.gap"]),
    ("x15_flare", ["Kp", "bandwidth", "rate"]),
    ("pid_hunting", ["mass.mass", "controller.kp", "friction.coulomb"]),
    ("thruster_dz_hyst", ["craft.inertia", "lead.gain", "thruster.level"]),
]
FURTHER = [
    ("robot_servo", ["Kp", "backlash", "arm_inertia"]),
    ("fig8a_original", ["drive.no_load_speed", "drive.stall_torque", "drive.coulomb_friction"]),
    ("light_forearm", ["drive.no_load_speed", "drive.inertia"]),
    ("freeplay_section", ["edge", "hinge_spring"]),
    ("wheelchair", ["dead_zone.upper", "play.gap"]),
    ("band_two_cycles", ["dead_zone_saturation.dead_zone", "dead_zone_saturation.slope"]),
    ("stiction_level_S5J2", ["controller.ti", "jump_and_follow.slip_jump"]),
]


@pytest.mark.parametrize(("name", "parameters"), mostly_slow([*KINDS, *FURTHER], KINDS[:3]))
def test_the_slope_is_that_of_forward_mode_in_forty_digits(name, parameters):
    case = epp.case(name)
    orbit = _orbit(case)
    for parameter in parameters:
        value = case.value(parameter)

        def build(v, parameter=parameter):
            return steady_case(case.with_values({parameter: float(v)}))

        exact = _forward_mode(build, value, orbit) / orbit.row_scale
        over_the_range = Family(build, (0.8 * value, 1.25 * value)).slope(orbit, value)
        for found in (over_the_range, slope_of(build, orbit, value, abs(value))):
            # Rounding of an orbit's own events, over up to fifteen arcs (fig8a_original: 2e-12).
            assert np.max(np.abs(found / orbit.row_scale - exact)) < 3e-12 * np.max(np.abs(exact))


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("van_der_pol_mu1", ["cube.scale"]), ("belt_leine", ["friction.static", "friction.stribeck"])],
)
def test_the_slope_through_smooth_elements_is_that_of_the_residual_over_a_range(name, parameters):
    case = epp.case(name)
    orbit = _orbit(case)
    assert np.any(orbit.arcs.smooth)
    for parameter in parameters:
        value = case.value(parameter)

        def build(v, parameter=parameter):
            return steady_case(case.with_values({parameter: float(v)}))

        family = Family(build, (0.98 * value, 1.02 * value), patience=1000)
        # The polynomial of the whole residual, run along the arcs anew at 17 values: rounding leaves 1e-12 of it.
        u = np.cos(np.pi * np.arange(17) / 16)
        rows = [_evaluated(family, value * (1.0 + 0.003 * x), orbit).r for x in u]
        fits = [np.polynomial.Chebyshev.fit(u, row, 16) for row in np.array(rows).T]
        # Over a wider range slip comes to the end of its curve before its time, and sixteen degrees leave 4e-8.
        assert all(np.abs(fit.coef[-2:]).max() <= 1e-12 * np.abs(fit.coef[1:]).sum() + 1e-15 for fit in fits)
        slopes = [fit.deriv()(0.0) / (0.003 * value) for fit in fits]
        exact = np.array(slopes) / orbit.row_scale
        found = slope_of(build, orbit, value, abs(value)) / orbit.row_scale
        assert np.max(np.abs(found - exact)) < 1e-11 * np.max(np.abs(exact))


@cache
def _on_the_belt(shape):
    """A belt with friction of this shape: its numbers, the loop, and its one cycle."""
    numbers = {"coulomb": 0.4, "static": 1.0, "velocity": 0.3, "viscous": 0.02, "shape": shape}
    belt = replace(epp.case("belt_leine").to_system(), elements=(epp.StribeckFriction(**numbers),))
    (cycle,) = epp.find_limit_cycles(belt)
    return numbers, belt, cycle


@pytest.mark.parametrize(
    ("shape", "varied"),
    mostly_slow([(1.0, "static"), (3.0, "velocity"), (1.5, "velocity"), (1.5, "shape")], [(1.5, "shape")]),
)
def test_the_slope_through_powers_of_the_velocity(shape, varied):
    numbers, belt, cycle = _on_the_belt(shape)
    value = numbers[varied]

    def build(v):
        return steady_hybrid(replace(belt, elements=(epp.StribeckFriction(**{**numbers, varied: float(v)}),)))

    orbit = next(iter(orbits_near(build(value), *start_of(build(value), cycle), cycle.period)))
    family = Family(build, (0.98 * value, 1.02 * value), patience=1000)
    # Beside rest a fractional power bends like its root: a difference comes near to the derivative as it shrinks.
    u, width = np.cos(np.pi * np.arange(9) / 8), 1e-3 if shape == round(shape) else 1e-5
    rows = [_evaluated(family, value * (1.0 + width * x), orbit).r for x in u]
    fits = [np.polynomial.Chebyshev.fit(u, row, 8) for row in np.array(rows).T]
    exact = np.array([fit.deriv()(0.0) for fit in fits]) / (width * value * orbit.row_scale)
    found = slope_of(build, orbit, value, value) / orbit.row_scale
    assert np.max(np.abs(found - exact)) < (1e-10 if shape == round(shape) else 1e-8) * np.max(np.abs(exact))


@pytest.mark.parametrize(
    ("name", "parameter"),
    [("fig8a_original", "lock_pin.backlash"), ("belt_leine", "friction.static"), ("relay_fopdt_closed", "loop.delay")],
)
@pytest.mark.parametrize("patience", mostly_slow([0, 1000], [0]))
def test_a_step_leads_to_where_scipy_finds_the_orbit_in_the_same_plane(name, parameter, patience):
    """With polynomials that stand in for the loop, and with the loop built anew at each value."""
    case = epp.case(name)
    value, orbit = case.value(parameter), _orbit(case)
    limits = 0.98 * value, 1.02 * value
    family = Family(lambda v: steady_case(case.with_values({parameter: float(v)})), limits, patience=patience)
    point = make_point(family, value, orbit, None)
    found, row = step(point, 0.1), point.weights * point.tangent
    sizes = np.append(orbit.column_scale, family.width)

    def equations(x):
        u = x * sizes
        at = _evaluated(family, u[-1], orbit, u[:-1] - point.unknowns[:-1])
        return np.append(at.r / orbit.row_scale, row @ (u - point.unknowns) - 0.1)

    independent = scipy.optimize.root(equations, (point.unknowns + 0.1 * point.tangent) / sizes, tol=1e-12)
    assert np.max(np.abs(found.unknowns / sizes - independent.x)) < 1e-9
    assert abs(found.value - value) > 1e-4 * value
    assert found.orbit.residual < CONVERGED


@pytest.mark.parametrize("name", mostly_slow(["fig8a_original", "belt_leine", "relay_fopdt_closed"], ["belt_leine"]))
def test_newtons_method_leads_to_the_orbit_from_where_scipys_does(name):
    orbit = _orbit(epp.case(name))
    rng = np.random.default_rng(3)
    y, tau = orbit.moved(1e-3 * rng.normal(size=orbit.r.size) * orbit.column_scale)
    away = solve(orbit.hybrid, replace(orbit.guess, y=y, tau=tau), orbit.arcs)
    assert np.max(np.abs(away.starts - orbit.starts) / orbit.scale) < 1e-9

    def equations(x):
        y, tau = orbit.moved(x * orbit.column_scale)
        return evaluate(orbit.hybrid, orbit.arcs, y, tau).r / orbit.row_scale

    begin = np.append(y[orbit.arcs.free] - orbit.y[orbit.arcs.free], tau - orbit.tau) / orbit.column_scale
    assert np.max(np.abs(scipy.optimize.root(equations, begin, tol=1e-12).x)) < 1e-9
    # Where a step moves nothing any more the method has ended, and without one it is the equations alone.
    assert evaluate(orbit.hybrid, orbit.arcs, y, tau).residual > 1e3 * away.residual


def test_an_orbit_is_refused_by_a_system_that_has_other_modes_or_states():
    orbit, relay = _orbit(epp.case("fig8a_original")), steady_hybrid(RELAY)
    smaller = steady_case(epp.case("fig8a_original").with_values({"drive.coulomb_friction": 0.0}))
    for hybrid in (relay, smaller):
        with pytest.raises(epp.EppError, match="changes its structure"):
            Arcs.build(hybrid, orbit.arcs.event_sequence)
        with pytest.raises(epp.EppError, match="changes its structure"):
            solve(hybrid, orbit.guess)
    # The same modes and guards of a loop with one state more.
    longer = steady_hybrid(epp.LureSystem.from_tf(([5.0], [1.0, 4.0, 5.0, 2.0, 0.0]), epp.RelayDeadZone(1.0)))
    orbit = _orbit(epp.Case.from_system(RELAY, name="relay"))
    with pytest.raises(epp.EppError, match="changes its structure"):
        solve(longer, orbit.guess)
    with pytest.raises(epp.EppError, match="changes its structure"):
        Arcs.build(longer, orbit.arcs.event_sequence, orbit.arcs)


def test_a_parameter_that_changes_the_structure_has_no_slope():
    case = epp.case("fig8a_original")
    orbit = _orbit(case)

    def build(v):
        return steady_case(case.with_values({"drive.coulomb_friction": 0.0} if round(1e7 * v) % 2 else {}))

    with pytest.raises(epp.EppError, match="changes its structure at 1 "):
        slope_of(build, orbit, 1.0, 1.0)


@pytest.mark.parametrize("powers", [(4, -3, 0), (-6, 2, 5), (0, 8, -8)])
def test_the_slope_does_not_depend_on_how_states_are_counted(powers):
    cycle = next(iter(epp.find_limit_cycles(RELAY)))
    x, memory = start_of(steady_hybrid(RELAY), cycle)

    def dwell_times_by(parameter, units, rest):
        """Derivative of the dwell times by a damping, in states of other units; `rest` is what cancels to rounding."""

        def build(value):
            A = np.array([[-value, -0.5, 0.0], [2.0, 0.0, 0.0], [rest(value), 2.0 + rest(value), rest(value)]])
            return steady_hybrid(
                replace(RELAY, A=A * units[:, None] / units, B=RELAY.B * units[:, None], C=RELAY.C / units)
            )

        orbit = next(iter(orbits_near(build(parameter), x * units, memory, cycle.period)))
        return orbit.correction(slope_of(build, orbit, parameter, parameter))[-orbit.tau.size :]

    np.testing.assert_array_equal(RELAY.A, [[-2.0, -0.5, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    plain = dwell_times_by(2.0, np.ones(3), lambda value: 0.0)
    other = dwell_times_by(2.0, 10.0 ** np.array(powers), lambda value: (1e3 + value) - 1e3 - value)
    np.testing.assert_allclose(other, plain, rtol=1e-9)


@pytest.mark.slow
def test_folds_do_not_feel_errors_of_the_slope(monkeypatch):
    (fold,) = epp.continue_branch(RELAY, "loop.gain", 0.7, 0.59).folds
    exact = Family.slope
    monkeypatch.setattr(Family, "slope", lambda *at: exact(*at) * (1.0 + 1e-4 * np.sin(np.arange(7.0))))
    (moved,) = epp.continue_branch(RELAY, "loop.gain", 0.7, 0.59).folds
    assert moved.value == pytest.approx(fold.value, rel=1e-11)


def test_a_test_that_is_zero_at_both_ends_is_met_at_one_of_them():
    """Rounding leaves the determinant of a return map at nothing over a whole step."""
    case, name = epp.case("relay_deadzone"), "relay_dead_zone.threshold"
    family = Family(lambda value: steady_case(case.with_values({name: value})), (1.0, 1.5))
    hybrid, cycle = family.at(1.0), epp.find_limit_cycles(case)[-1]
    orbit = next(iter(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period)))
    point = make_point(family, 1.0, orbit, None)
    further = step(point, 0.01)
    assert further is not None
    assert locate(point, further, lambda _: 0.0) in (point, further)
