"""Harmonic balance against quadrature of the elements' own maps, describing functions, exact orbits and simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.harmonic.balance import harmonic_balance
from eppanalysis.methods.harmonic.coefficients import respond, stacked
from eppanalysis.methods.harmonic.elements import PeriodicElement
from eppanalysis.models.elements import ParkingBandLaw
from tests.fourier import series, turning_points, value
from tests.harmonic_coverage import entries
from tests.shared import mostly_slow, predicted

LAW = epp.FiveBandLaw(1.0, 2.0, 3.0, 4.0, 16.0, 0.5)

# Elements with the mean and the size of the inputs that bring them to life.
ELEMENTS = {
    "saturation": (epp.Saturation(-0.8, 1.0, 2.0), 0.2, 1.5),
    "dead zone": (epp.DeadZone(-1.0, 1.5, 2.0), 0.2, 2.0),
    "dead zone, saturation": (epp.DeadZoneSaturation(0.5, 2.0, 3.0), -0.3, 2.0),
    "relay": (epp.Relay(-1.0, 2.0, 0.3), 0.2, 1.5),
    "relay, dead zone": (epp.RelayDeadZone(0.5), 0.1, 1.5),
    "preload": (epp.Preload(0.3, 2.0), 0.1, 1.0),
    "quantiser": (epp.Quantiser(0.7, 4), 0.2, 2.0),
    "bands": (LAW, 2.4, 1.5),
    "cube": (epp.Cube(0.3), 0.4, 1.5),
    "sine": (epp.Sine(1.2), 0.4, 2.0),
    "friction": (epp.Friction(1.0), 0.2, 1.5),
    "falling friction": (epp.Friction(0.0, static=1.0, stribeck=2.0), 0.2, 1.5),
    "hysteresis": (epp.HysteresisRelay(-0.3, 0.5), 0.1, 1.5),
    "hysteresis, dead zone": (epp.HysteresisRelayDeadZone(1.0, 0.5), 0.1, 2.0),
    "play": (epp.Play(1.0), 0.3, 1.5),
    "jump and follow": (epp.JumpAndFollow(1.0, 0.4, 1.3), 0.3, 1.5),
    "pulley": (epp.StictionPulley(8.0, 33.0, 0.05, 0.8), 2.5, 1.5),
    "lock pin": (epp.LockPin(0.5, 100.0, 1.0), 0.1, 1.0),
    "lock pin, classical": (epp.LockPin(0.5, 100.0, 1.0, "classical"), 0.1, 1.0),
}

_P8 = np.polynomial.legendre.Legendre.basis(8)
_NODES = np.concatenate([[-1.0], np.sort(_P8.deriv().roots()), [1.0]])
# Lobatto's rule: with both ends among the nodes no jump hides behind the last one.
RULE = _NODES, 2 / (72 * _P8(_NODES) ** 2)

#: For each loop: cycle of its case, error of order n falls like n**-rate.
RATES = {
    # A relay's output jumps: the cut-off part of its input at the switching instant counts, which for a plant of odd
    # relative degree r is a sum of k**-(1 + r) beyond n; for even r the leading terms cancel by symmetry.
    "relay_hyst_goncalves6": 1.0,
    "relay_hyst_servo": 3.0,
    "relay_ideal_khalil79": 3.0,
    # A saturation has kinks: two orders more, for relative degree 1 and 3.
    "sat_khalil710": 3.0,
    "sat_am165": 5.0,
}


def roles(element) -> list[str]:
    return ["free", "rate" if isinstance(element, epp.LockPin) else "clock"][: element.n_inputs]


def adaptive(f, low: float, high: float, whole=None, depth: int = 44):
    """Integral by bisection down to rounding, which finds jumps and corners wherever they are."""
    if whole is None:
        whole = rule(f, low, high)
    middle = (low + high) / 2
    left, right = rule(f, low, middle), rule(f, middle, high)
    if depth == 0 or (depth < 42 and np.abs(left + right - whole).max() <= 1e-13):
        return left + right
    return adaptive(f, low, middle, left, depth - 1) + adaptive(f, middle, high, right, depth - 1)


def rule(f, low: float, high: float):
    node, weight = RULE
    points = low + (high - low) * (node + 1) / 2
    return (high - low) / 2 * (weight @ f(points))


def by_quadrature(element, c: np.ndarray, omega: float) -> np.ndarray:
    """Coefficients of the settled output by adaptive quadrature of the element's own map in time."""
    k = np.arange(c.size)
    marks = turning_points(c)
    ends = np.append(marks, marks[0] + 2 * np.pi)
    rated = isinstance(element, epp.LockPin)
    memory = None
    if not rated:
        x = [value(c, m) for m in marks]
        memory = element.output(max(x) + 4 * np.ptp(x), None)[1]
        for m in [*marks, *marks, marks[0]]:
            memory = element.output(value(c, m), memory)[1]
    total = np.zeros(element.n_outputs * c.size, complex)
    for low, high in zip(ends[:-1], ends[1:], strict=True):

        def weighted(phi: np.ndarray, memory=memory) -> np.ndarray:
            z = value(c, phi)
            given = (z, value(1j * k * omega * c, phi)) if rated else z
            y = np.reshape(element.output(given, memory)[0], (phi.size, -1, 1))
            return (y * np.exp(-1j * np.multiply.outer(phi, k))[:, None]).reshape(phi.size, -1)

        total += adaptive(weighted, low, high)
        memory = None if rated else element.output(value(c, high), memory)[1]
    W = total.reshape(element.n_outputs, -1) / np.pi
    W[:, 0] /= 2
    return W


@pytest.mark.parametrize("name", mostly_slow(ELEMENTS, [*ELEMENTS][::4]))
@settings(max_examples=8)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 6))
def test_coefficients_equal_quadrature_of_the_map_in_time(name, seed, n):
    element, mean, size = ELEMENTS[name]
    Z = series(n, mean, size, seed)
    found = respond(PeriodicElement(element, roles(element)), Z, 3.0).coefficients
    expected = by_quadrature(element, Z[0], 3.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", [*ELEMENTS, "parking"])
def test_one_harmonic_gives_the_describing_function(name):
    element, mean, size = ELEMENTS.get(name, (ParkingBandLaw(LAW, 0.3), 2.4, 1.5))
    prepared = PeriodicElement(element, roles(element))
    for a in (0.7, 1.0, 1.6):
        Z = np.array([[mean, a * size * np.exp(0.4j)]])
        expected_mean, gain = element.describing_function(a * size, mean, 3.0)
        found = respond(prepared, Z, 3.0).coefficients
        scale = np.abs(found).max() + 1e-300
        np.testing.assert_allclose(found[:, 0].real, np.atleast_1d(expected_mean), rtol=0, atol=1e-13 * scale)
        np.testing.assert_allclose(found[:, 1], np.atleast_1d(gain) * Z[0, 1], rtol=0, atol=1e-13 * scale)


@pytest.mark.parametrize("name", [*ELEMENTS, "parking"])
def test_derivatives_equal_central_differences(name):
    element, mean, size = ELEMENTS.get(name, (ParkingBandLaw(LAW, 0.3), 2.4, 1.5))
    prepared, omega, n = PeriodicElement(element, roles(element)), 3.0, 4
    Z = series(n, mean, size, 7)
    x = np.append(stacked(Z)[0], omega)

    def at(unknowns):
        c = unknowns[: n + 1].astype(complex)
        c[1:] += 1j * unknowns[n + 1 : -1]
        return respond(prepared, c[None], float(unknowns[-1])).coefficients

    slopes = respond(prepared, Z, omega).slopes
    for i, unit in enumerate(np.eye(x.size)):
        difference = (at(x + 1e-6 * unit) - at(x - 1e-6 * unit)) / 2e-6
        # Rounding of the coefficients over the step, and the third derivative near turning points.
        np.testing.assert_allclose(slopes[:, :, i], difference, rtol=0, atol=1e-6 * np.abs(slopes).max())


#: Shipped cases without first-order cycles, and those whose limited rate first order reads another way: to it the input
#: is a sine, to a balance the error inside; and one with a contact angle, which a balance does not cover.
WITHOUT = {
    "azimuth_servo", "backlash_servo_unseen", "belt_leine", "boston_digital_arm", "fig6b_ball_bearing",
    "fig6b_three_steps",
    "fig8b_reduced_backlash", "fig8b_three_steps", "pid_hunting", "soft_cable", "stiction_deadband_none", "upright",
    "two_mass_damped_shaft", "actuator_both_limits", "clegg_loop", "rate_limited_aircraft",
}  # fmt: skip
#: Sampled loops with steps behind steps: the balance takes a step or two more until its last one is rounding.
SAMPLED = {"buck_converter", "virtual_spring"}
#: Elbows like those that are left: with another pulley, with none, and with a clock.
ALIKE = {
    "elbow", "elbow_cycle_not_there", "fig6a_three_steps", "fig8a_three_steps", "gain_brings_it_back", "light_forearm",
}  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n in ALIKE)) for n in epp.shipped_cases() if n not in WITHOUT],
)
def test_order_one_is_the_describing_function(name):
    case, guesses = epp.case(name), predicted(name)
    assert len(guesses)
    for guess in guesses:
        cycle = harmonic_balance(case, guess, order=1)
        assert cycle.status.ok
        assert cycle.provenance.statistics["iterations"] <= (4 if name in SAMPLED else 2)
        assert cycle.period == pytest.approx(guess.period, rel=1e-10)
        for signal, c in guess.harmonics.items():
            size = abs(c[1])
            assert cycle.peak_to_peak[signal] == pytest.approx(2 * size, rel=1e-10)
            np.testing.assert_allclose(cycle.harmonics[signal], c, rtol=1e-10, atol=1e-10 * size)


def errors(name: str, orders: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """True errors of frequency and fundamental against the exact answer of a case, and the estimates."""
    case = epp.case(name)
    exact, guesses = case.expected.exact[-1], predicted(name)
    guess = min(guesses, key=lambda g: abs(np.log(g.amplitude(case.expected.signal) / exact.amplitude)))
    true, estimated = [], []
    for n in orders:
        cycle = harmonic_balance(case, guess, n)
        known = exact.fundamental or cycle.amplitude(case.expected.signal)
        amplitude = cycle.amplitude(case.expected.signal)
        true.append(max(abs(cycle.omega / exact.omega - 1), abs(amplitude / known - 1)))
        estimated.append(cycle.error_estimate)
    return np.array(true), np.array(estimated)


@pytest.mark.parametrize("name", RATES)
def test_converges_to_the_exact_orbit_at_the_rate_of_theory(name):
    orders = [15, 21, 31, 45, 65]
    true, _ = errors(name, orders)
    rate = -np.polyfit(np.log(orders), np.log(true), 1)[0]
    assert rate == pytest.approx(RATES[name], abs=0.45)


@pytest.mark.slow
def test_converges_exponentially_for_a_smooth_element():
    true, _ = errors("van_der_pol_mu1", [3, 5, 9, 13, 17])
    assert np.all(true[1:] < true[:-1])
    assert true[-1] < 1e-12


@pytest.mark.parametrize("name", [*RATES, "backlash_servo", "band_two_cycles", "sat_plus_backlash", "relay_deadzone"])
def test_error_estimate_is_of_the_size_of_the_error(name):
    true, estimated = errors(name, [5, 9, 17])
    assert np.all(true < 2.5 * estimated)
    assert np.all(estimated < 2.5 * true)


# Order at which period and peak-to-peak of the forearm are within 1 % of the simulated cycle's.
@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("fig8a_original", 5),
        pytest.param("gain_brings_it_back", 3, marks=pytest.mark.slow),
        ("fig6a_original_pulley", 5),
    ],
)
def test_elbow_cycles_within_a_percent_of_simulation(name, order):
    case = epp.case(name)
    run = epp.simulate(case, t_end=8.0).limit_cycle
    cycle = harmonic_balance(case, predicted(name)[-1], order)
    assert cycle.period == pytest.approx(run.period, rel=0.01)
    assert cycle.peak_to_peak["theta"] == pytest.approx(run.peak_to_peak["theta"], rel=0.01)


def third_order() -> epp.LureSystem:
    return epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())


def test_automatic_order_ends_when_its_error_is_small():
    system = third_order()
    cycle = harmonic_balance(system, epp.predict_limit_cycles(system)[0])
    assert cycle.status.ok
    assert cycle.error_estimate < 1e-4
    assert cycle.residual < 1e-12
    # Exact: the relay loop's period by Tsypkin's locus, 4.55107103...
    assert cycle.period == pytest.approx(4.55107103, rel=1e-4)
    assert [p["order"] for p in cycle.provenance.statistics["orders"]] == [1, 3, 5, 9, 15, 25]


def test_starts_from_a_simulated_cycle_and_gives_a_state_on_the_orbit():
    system = third_order()
    run = epp.simulate(system, t_end=200.0).limit_cycle
    cycle = harmonic_balance(system, run, 41)
    assert cycle.period == pytest.approx(run.period, rel=1e-4)
    assert cycle.peak_to_peak["x"] == pytest.approx(run.peak_to_peak["x"], rel=1e-3)
    assert float(system.C[0] @ cycle.state) == pytest.approx(cycle.waveform["x"][0], abs=1e-12)
    assert [e.name for e in cycle.events] == ["rises through breakpoint 1", "falls through breakpoint 1"]


def test_memory_value_of_the_start_is_the_output_there():
    cycle = harmonic_balance(epp.case("backlash_servo"), predicted("backlash_servo")[0], 15)
    # At phase zero the play's input rises: its output rests in the gap or follows half a gap below.
    x = cycle.waveform["x"][0]
    assert abs(x - cycle.memory[0]) < 1.0 + 1e-9


def test_peak_to_peak_is_the_extremum_of_the_series():
    cycle = harmonic_balance(epp.case("fig8a_original"), predicted("fig8a_original")[-1], 5)
    for signal, c in cycle.harmonics.items():
        phases = np.linspace(0, 2 * np.pi, 20001)
        wave = (c @ np.exp(1j * np.outer(np.arange(c.size), phases))).real
        assert cycle.peak_to_peak[signal] == pytest.approx(np.ptp(wave), rel=1e-5)
        assert cycle.peak_to_peak[signal] >= np.ptp(wave) * (1 - 1e-12)


def test_steady_input_moves_the_mean():
    system = epp.LureSystem.build(
        [[-1.0, 0, 0], [1, -2, 0], [0, 1, 0]],
        [[1.0], [0], [0]],
        [[0, 0, -1.0]],
        [epp.Saturation(slope=12.0, lower=-1.0, upper=2.0)],
        B_input=[[1.0], [0], [0]],
        input_names=["load"],
    )
    value = {"load": 0.2}
    guess = epp.predict_limit_cycles(system, value)[0]
    cycle = harmonic_balance(system, guess, 1, value)
    assert cycle.harmonics["saturation_input"] == pytest.approx(guess.harmonics["saturation_input"], rel=1e-9)
    # The integrator leaves the mean of the saturation's output at minus the load, whatever the order.
    assert harmonic_balance(system, guess, 9, value).mean["saturation_output"] == pytest.approx(-0.2, abs=1e-12)


def test_a_cycle_that_only_first_order_has_does_not_converge():
    system = epp.case("sat_plus_backlash").to_system()
    small, large = predicted("sat_plus_backlash")
    assert not harmonic_balance(system, small).status.ok
    assert harmonic_balance(system, large).status.ok


def test_stick_that_rules_the_cycle_is_reported_as_not_converged():
    case = epp.case("pid_hunting")
    system = case.to_system()
    run = epp.simulate(system, t_end=120.0).limit_cycle
    assert not harmonic_balance(system, run).status.ok


def test_refusals():
    system = third_order()
    guess = epp.predict_limit_cycles(system)[0]
    with pytest.raises(EppError, match="order is 0"):
        harmonic_balance(system, guess, 0)
    with pytest.raises(ModelError, match="no input 'push'"):
        harmonic_balance(system, guess, 1, {"push": 1.0})
    sampled = epp.case("backlash_discrete_pi").to_system()
    with pytest.raises(EppError, match="half the sample rate"):
        harmonic_balance(sampled, epp.predict_limit_cycles(sampled)[0], 400)
    shaft = epp.case("two_mass_damped_shaft").to_system()
    with pytest.raises(ModelError, match="reads a state of the loop beside its input"):
        harmonic_balance(shaft, guess, 1)


@pytest.mark.parametrize("name", ["relay_hyst_goncalves6", "two_mass_deadzone", "relay_deadzone", "thruster_dz_hyst"])
def test_estimate_covers_the_distance_to_an_exact_orbit_or_says_that_it_cannot(name):
    """Also where the neglected harmonics add switches; of those that are given half are within twice the truth."""
    found = entries(name, [1, 2, 3, 4, 5, 8, 13, 25])
    given = [e for e in found if np.isfinite(e.estimate)]
    assert len(given) >= len(found) / 2
    assert all(e.covered for e in given)
    assert np.median([e.estimate / e.error for e in given]) < 2.0


@pytest.mark.slow
def test_estimate_of_a_sampled_loop_covers_what_its_order_and_its_samples_leave():
    """Either alone did not: the cycle locks to 28 samples, and the balance of order 15 is 13 % off."""
    found = entries("buck_converter", [3, 7, 8, 15, 16, 19])
    assert len(found) == 6
    assert all(np.isfinite(e.estimate) and e.covered for e in found)


@pytest.mark.slow
def test_a_balance_within_whose_error_a_dwell_time_passes_has_no_estimate():
    """Parking ends every motion of this elbow; balances of a dozen orders go round, and orders nearby agree."""
    found = entries("parking_stops_it", [5, 11, 16, 17])
    assert len(found) == 4
    assert all(np.isnan(e.estimate) for e in found)


def test_without_an_orbit_near_there_is_no_estimate_and_a_reason():
    """Below its smallest stable amplitude the loop has a cycle in first order alone."""
    system = epp.case("sat_plus_backlash").to_system()
    small = min(predicted("sat_plus_backlash"), key=lambda c: c.peak_to_peak[next(iter(c.mean))])
    balance = harmonic_balance(system, small, 1)
    assert np.isnan(balance.error_estimate)
    assert "order" in balance.note


def test_error_is_measured_up_to_half_the_sample_rate():
    """The highest order that a sampled loop allows changes with the frequency on the way there."""
    system = epp.case("backlash_discrete_pi_kp05_ki01").to_system()
    guess = epp.predict_limit_cycles(system)[0]
    for order in (1, 3, 9, None):
        balance = harmonic_balance(system, guess, order)
        assert balance.status.ok
        assert np.isnan(balance.error_estimate) or balance.error_estimate < 1 / 3
