"""Lock pin and Nordin's shaft: closed form with its exact release point against quadrature, limits, laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier_with_rate
from tests.shared import mostly_slow

amplitudes = st.floats(1e-2, 20)
ratios = st.just(0.0) | st.floats(1e-9, 30)


def switches(element: epp.LockPin, a: float, b: float, omega: float) -> list[float]:
    """Phases at the edges of the gap, and those at which the torque of either side passes zero, by root finding."""
    half = element.gap / 2
    out = crossings([half, -half], a, b)
    if element.model == "classical":
        return out
    for side in (half, -half):

        def torque(phi: float, side: float = side) -> float:
            spring = element.stiffness * (b - side + a * np.sin(phi))
            return spring + element.damping * a * omega * np.cos(phi)

        grid = np.linspace(-np.pi / 2, 1.5 * np.pi, 721)
        values = torque(grid)
        for i in np.flatnonzero(values[:-1] * values[1:] < 0):
            out.append(brentq(torque, grid[i], grid[i + 1], xtol=1e-15, rtol=1e-14))
        out += grid[values == 0].tolist()
    return out


def check(element: epp.LockPin, a: float, b: float, omega: float, tolerance: float = 1e-9) -> None:
    witness = fourier_with_rate(element, a, b, omega, switches(element, a, b, omega))
    reach = element.stiffness * (a + abs(b) + element.gap) + element.damping * a * omega
    assert_agrees(element.describing_function(a, b, omega), witness, a, tolerance, rounding=1e-14 * reach)


@pytest.mark.parametrize("model", ["unilateral", "classical"])
@given(gap=st.floats(0, 3), k=st.floats(0.1, 10), q=ratios, a=amplitudes, relative=st.floats(-3, 3))
@settings(max_examples=200)
def test_lock_pin(model: str, gap: float, k: float, q: float, a: float, relative: float) -> None:
    omega = 2.5
    check(epp.LockPin(gap, k, q * k / omega, model), a, relative * a, omega)


@pytest.mark.parametrize("depth", [1e-6, 0.1, 1.0, 1.9, 2.0, 2.1, 2.3, 3.0, 80.0])
def test_every_form_of_contact(depth: float) -> None:
    """`depth` is the greatest penetration over the amplitude; from 2 on the pin never gets back into the gap."""
    a, gap, k = 0.7, 2.0, 3.0
    for q in (0.0, 1e-8, 0.3, 1.0, 50.0):
        check(epp.LockPin(gap, k, q * k), a, gap / 2 + (depth - 1) * a, 1.0)


@pytest.mark.parametrize("q", [0.01, 0.3, 4.0])
def test_continuous_where_the_form_changes(q: float) -> None:
    a, gap = 1.0, 0.5
    for inside in (1.0, np.sqrt(1 + q * q)):  # edge reached, torque always positive
        b = gap / 2 + inside * a + np.array([-1e-12, 0.0, 1e-12])
        mean, gain = epp.LockPin(gap, 2.0, 2.0 * q).describing_function(a, b)
        assert np.ptp(mean) < 1e-10
        assert np.abs(np.diff(gain)).max() < 1e-4 * (1 + q)


@given(amplitudes, st.floats(-3, 3), st.floats(0, 3))
def test_without_damping_both_models_are_the_dead_zone(a: float, b: float, half: float) -> None:
    expected = epp.DeadZone(-half - 1e-9, half + 1e-9, 5.0).describing_function(a, b)
    for model in ("unilateral", "classical"):
        mean, gain = epp.LockPin(2 * half + 2e-9, 5.0, 0.0, model).describing_function(a, b, 3.0)
        np.testing.assert_allclose(mean, expected[0], atol=1e-12 * (a + abs(b)))
        np.testing.assert_allclose(gain, expected[1], atol=1e-12)


@given(amplitudes, st.floats(-3, 3), st.floats(0, 50))
def test_classical_without_gap_is_spring_and_damper(a: float, b: float, omega: float) -> None:
    mean, gain = epp.LockPin(0.0, 5.0, 0.3, "classical").describing_function(a, b, omega)
    np.testing.assert_allclose(mean, 5 * b, atol=1e-12 * (a + abs(b)))
    np.testing.assert_allclose(gain, 5 + 0.3j * omega, rtol=1e-12)
    _, gain = epp.LockPin(0.0, 5.0, 0.0).describing_function(a, b, omega)
    np.testing.assert_allclose(gain, 5, rtol=1e-12)


def test_classical_is_the_dead_zone_turned() -> None:
    a, q = np.array([1.1, 2.0, 30.0]), 0.4
    dead_zone = epp.DeadZone(-1.0, 1.0, 5.0).describing_function(a, 0.2)
    mean, gain = epp.LockPin(2.0, 5.0, 5.0 * q, "classical").describing_function(a, 0.2)
    np.testing.assert_allclose(gain, dead_zone[1] * (1 + 1j * q), rtol=1e-12)
    np.testing.assert_allclose(mean, dead_zone[0], rtol=1e-11)


def test_inside_the_gap_and_far_beyond_it() -> None:
    for model in ("unilateral", "classical"):
        pin = epp.LockPin(2.0, 5.0, 0.3, model)
        mean, gain = pin.describing_function([0.0, 1e-12, 0.5, 1.0], 0.0, 10.0)
        assert not mean.any()
        assert not gain.any()
        mean, gain = pin.describing_function([0.5, 0.1], [0.5, -0.8], 10.0)
        assert not mean.any()
        assert not gain.any()
        mean, gain = pin.describing_function([0.0, 1e-9], 4.0, 10.0)  # firmly in contact: spring and damper
        np.testing.assert_allclose(mean, 15)
        np.testing.assert_allclose(gain, 5 + 3j)
    # The gap vanishes against the amplitude: of the damper only the pushing part is left.
    q = 0.6
    _, wide = epp.LockPin(2.0, 5.0, 5.0 * q).describing_function(1e8)
    _, none = epp.LockPin(0.0, 5.0, 5.0 * q).describing_function(1.0)
    np.testing.assert_allclose(wide, none, rtol=1e-7)
    np.testing.assert_allclose(none.imag, 5 * _pushed_without_gap(q), rtol=1e-12)


def _pushed_without_gap(q: float) -> float:
    """``2/pi * integral of (sin + q cos) cos`` over the contact, 0 to pi - arctan q, by elementary integrals."""
    end = np.pi - np.arctan(q)
    return 2 / np.pi * (np.sin(end) ** 2 / 2 + q * (end + np.sin(end) * np.cos(end)) / 2)


@pytest.mark.parametrize("k", [20, 40])
def test_just_touching_keeps_its_relative_accuracy(k: int) -> None:
    q, amplitude = 0.5, 1 + 0.5**k
    _, gain = epp.LockPin(2.0, 1.0, q).describing_function(amplitude)
    # Parabola: contact from -sqrt(2 e), release at e/q behind the peak; the jump of damping torque leads.
    e = 0.5**k / amplitude
    begin, end = np.sqrt(2 * e), e / q
    held = (begin**3 + end**3) / 3
    leading = 2 / np.pi * (held + q * (begin**2 + end**2) / 2 + 1j * q * (held + q * end**2 / 2))
    # The parabola is right to first order in sqrt(e); the real part's next term is of relative order e/q^2.
    assert gain.real == pytest.approx(leading.real, rel=8 * e / q**2 + 1e-12)
    assert gain.imag == pytest.approx(leading.imag, rel=8 * np.sqrt(e) / q**2 + 1e-12)


@given(st.floats(0, 3), ratios, amplitudes, st.floats(-3, 3), st.floats(1e-6, 1e6))
def test_unit_of_the_angle_does_not_matter(gap: float, q: float, a: float, b: float, unit: float) -> None:
    mean, gain = epp.LockPin(gap, 2.0, 2.0 * q).describing_function(a, b)
    other_mean, other_gain = epp.LockPin(gap * unit, 2.0, 2.0 * q).describing_function(a * unit, b * unit)
    scale = (1 + q) * (a + abs(b))
    np.testing.assert_allclose(other_mean / unit, mean, atol=1e-10 * scale)
    np.testing.assert_allclose(other_gain, gain, atol=1e-6 * scale / a)


@given(st.floats(0, 3), ratios, amplitudes, st.floats(-3, 3))
def test_symmetry_and_dissipation(gap: float, q: float, a: float, b: float) -> None:
    mean, gain = epp.LockPin(gap, 2.0, 2.0 * q).describing_function(a, [b, -b, 0.0])
    assert mean[0] == -mean[1]
    assert gain[0] == gain[1]
    assert mean[2] == 0
    assert (gain.imag >= 0).all()  # a damper only takes energy
    assert (gain.imag <= 2 * q * (1 + 1e-12)).all()
    classical = epp.LockPin(gap, 2.0, 2.0 * q, "classical").describing_function(a, [b, -b, 0.0])[1]
    # Pulling while it leaves, the classical pin dissipates more.
    assert (gain.imag <= classical.imag * (1 + 1e-12) + 1e-15).all()


def test_map_by_hand() -> None:
    pin = epp.LockPin(2.0, 10.0, 1.0)
    delta = np.array([0.0, 1.0, 1.5, 1.5, 1.5, -1.5, -1.5, -1.5])
    rate = np.array([9.0, 9.0, 0.0, 2.0, -9.0, 0.0, -2.0, 9.0])
    np.testing.assert_allclose(pin.output((delta, rate))[0], [0, 0, 5, 7, 0, -5, -7, 0])
    classical = epp.LockPin(2.0, 10.0, 1.0, "classical")
    np.testing.assert_allclose(classical.output((delta, rate))[0], [0, 0, 5, 7, -4, -5, -7, 4])
    assert pin.output((1.5, 0.0), "kept")[1] == "kept"


def test_thresholds_and_shapes() -> None:
    pin = epp.LockPin(2.0, 10.0, 1.0)
    np.testing.assert_allclose(pin.thresholds(), [1.0])
    np.testing.assert_allclose(pin.thresholds(bias=0.25), [0.75, 1.25])
    assert epp.LockPin(0.0, 1.0, 1.0).thresholds().size == 0
    a = np.array([0.0, 1e-300, 1e-12, 1.0, 1e8, 1e15])
    b = np.array([[0.0], [1.0], [-1e6]])
    for model in ("unilateral", "classical"):
        for q in (0.0, 1.0, 1e4):
            mean, gain = epp.LockPin(2.0, 10.0, q, model).describing_function(a, b, 3.0)
            assert mean.shape == gain.shape == (3, 6)
            assert mean.dtype == float
            assert gain.dtype == complex
            assert not np.isnan(mean).any()
            assert not np.isnan(gain).any()
    assert pin.describing_function(2.0, 0.0, np.ones((3, 1)))[1].shape == (3, 1)
    assert np.isnan(pin.describing_function(np.nan)[1])
    with pytest.raises(ModelError, match="amplitude"):
        pin.describing_function(-1.0)
    with pytest.raises(ModelError, match="frequency .* -2"):
        pin.describing_function(1.0, 0.0, -2.0)


def test_automata() -> None:
    assert isinstance(epp.LockPin(1.0, 1.0, 1.0).automaton(), epp.Automaton)
    assert len(epp.LockPin(1.0, 1.0, 1.0).automaton().modes) == 5
    assert len(epp.LockPin(1.0, 1.0, 1.0, "classical").automaton().modes) == 3
    assert epp.NordinShaft(1.0, 1.0, 1.0).automaton().n_outputs == 2


def test_nordin_shaft_by_hand() -> None:
    shaft = epp.NordinShaft(2.0, 10.0, 2.0)
    # In the gap: no torque, the contact angle relaxes; at the side: spring and damper as long as they push.
    np.testing.assert_allclose(shaft.output((0.5, 1.0, 0.3))[0], [0, 1 + 5 * 0.2])
    np.testing.assert_allclose(shaft.output((1.5, 1.0, 1.0))[0], [10 * 0.5 + 2 * 1.0, 0])
    np.testing.assert_allclose(shaft.output((1.5, -4.0, 1.0))[0], [0, -4 + 5 * 0.5])
    np.testing.assert_allclose(shaft.output((-1.5, -1.0, -1.0))[0], [-7, 0])
    assert shaft.output((np.zeros(3), np.zeros(3), np.zeros(3)))[0].shape == (3, 2)
    np.testing.assert_allclose(shaft.thresholds(), [1.0])


@pytest.mark.slow
def test_nordin_shaft_releases_where_its_torque_is_zero() -> None:
    """The torque of a driven shaft is spring plus damper of twist minus contact angle, in every phase."""
    shaft, omega = epp.NordinShaft(1.0, 10.0, 2.0), 3.0

    def inputs(t: float, contact: float) -> tuple[float, float, float]:
        return np.sin(omega * t), omega * np.cos(omega * t), float(np.clip(contact, -0.5, 0.5))

    run = solve_ivp(
        lambda t, y: [shaft.output(inputs(t, y[0]))[0][1]], (0, 6), [0.0], max_step=1e-3, rtol=1e-8, atol=1e-10
    )
    for t, contact in zip(run.t[::50], run.y[0][::50], strict=True):
        delta, rate, held = inputs(t, contact)
        torque, drift = shaft.output((delta, rate, held))[0]
        assert torque == pytest.approx(10 * (delta - held) + 2 * (rate - drift), abs=1e-9)
        assert torque * held >= 0
    assert np.abs(run.y[0]).max() < 0.5 + 0.01


def settled_contacts(shaft: epp.NordinShaft, a: float, b: float, omega: float) -> list[tuple[float, float, float]]:
    """Contacts (side, begin, end) of the settled contact angle in a period, by events of its exact motion between them.

    At a side it holds until its drift turns; released, the twist's lead over it dies away with the time constant c/k.
    """
    half, rate = shaft.gap / 2, shaft.stiffness / shaft.damping
    period = 2 * np.pi / omega
    turns = int(np.ceil(40 / (rate * period))) + 3
    grid, last = np.linspace(0.0, period, 4001), (turns - 1) * period

    def twist(t: Any) -> Any:
        return b + a * np.sin(omega * t)

    def drift(t: Any, side: float) -> Any:
        return a * omega * np.cos(omega * t) + rate * (twist(t) - side * half)

    def rise(of: Callable[[Any], Any], t: float) -> float:
        """Where a function is first above zero, from a time on."""
        while t < turns * period:
            if np.any(above := of(t + grid[1:]) > 0):
                low, high = t + grid[int(np.argmax(above))], t + grid[int(np.argmax(above)) + 1]
                return float(brentq(of, low, high, xtol=1e-15, rtol=1e-15)) if of(low) < 0 else low
            t += period
        return np.inf

    out, t, lead = [], 0.0, twist(0.0)
    while t < turns * period:
        since, led = t, lead

        def contact(t: Any, since: float = since, led: float = led) -> Any:
            return twist(t) - led * np.exp(-rate * (t - since))

        begin, side = min((rise(lambda t, s=s: s * contact(t) - half, t + 1e-12 * period), s) for s in (1.0, -1.0))
        t = rise(lambda t, side=side: -side * drift(t, side), begin)
        if t > last and begin < turns * period:
            out.append((side, max(begin, last), min(t, turns * period)))
        lead = twist(t) - side * half if t < np.inf else 0.0
    return out


@pytest.mark.parametrize("seed", mostly_slow(range(20), range(4)))
def test_nordin_shaft(seed: int) -> None:
    """By adaptive quadrature of the torque over the contacts of a motion that has settled."""
    rng = np.random.default_rng(seed)
    gap, k, omega = rng.choice([0.02, 1.0, 2.0]), 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-1, 1)
    kappa, a = 10 ** rng.uniform(-1.2, 2.5), 10 ** rng.uniform(-1, 1)
    b = rng.choice([0.0, rng.uniform(-2, 2), gap / 2 + a * rng.uniform(-1.5, 1.5)])
    shaft = epp.NordinShaft(gap, k, k / (kappa * omega))
    size = np.hypot(k, shaft.damping * omega) * (a + abs(b))
    total = np.zeros(3)
    for side, begin, end in settled_contacts(shaft, a, b, omega):
        for i, weight in enumerate((np.ones_like, np.sin, np.cos)):

            def torque(phi: float, weight: Any = weight, side: float = side) -> float:
                spring = k * (b + a * np.sin(phi) - side * gap / 2)
                return float((spring + shaft.damping * omega * a * np.cos(phi)) * weight(phi) / size)

            total[i] += size * quad(torque, omega * begin, omega * end, epsabs=1e-12, limit=200)[0]
    (mean, rest), (gain, drift) = shaft.describing_function(a, b, omega)
    assert mean == pytest.approx(total[0] / (2 * np.pi), abs=1e-11 * size)
    assert gain == pytest.approx((total[1] + 1j * total[2]) / (np.pi * a), abs=1e-11 * size / a)
    # The torque is spring and damper of twist less contact angle, whose rate has no mean.
    assert rest == 0.0 and gain == pytest.approx((k + 1j * shaft.damping * omega) * (1 - drift / (1j * omega)))


def test_limits_of_nordin_shaft() -> None:
    a, b = np.array([0.3, 0.7, 1.0, 2.0, 50.0]), np.array([-0.4, 0.0, 0.3, 1.0, 0.2])
    # Without a gap it is spring and damper; slow, or hardly damped, it is the dead zone; mirrored, it is the same.
    mean, gain = epp.NordinShaft(0.0, 5.0, 0.3).describing_function(a, b, 2.0)
    np.testing.assert_allclose(mean[:, 0], 5 * b, atol=1e-14)
    np.testing.assert_allclose(gain[:, 0], 5 + 0.6j, rtol=1e-14)
    for damping, omega in ((1e-12, 1.0), (1.0, 1e-12), (1.0, 0.0)):
        mean, gain = epp.NordinShaft(2.0, 5.0, damping).describing_function(a, b, omega)
        expected = epp.DeadZone(-1.0, 1.0, 5.0).describing_function(a, b)
        np.testing.assert_allclose(mean[:, 0], expected[0], atol=1e-10)
        np.testing.assert_allclose(gain[:, 0], expected[1], atol=1e-10)
    shaft = epp.NordinShaft(1.0, 5.0, 2.0)
    (mean, gain), (other, same) = (shaft.describing_function(a, side * b, 3.0) for side in (1, -1))
    np.testing.assert_array_equal(mean, -other)
    np.testing.assert_array_equal(gain, same)
    # Far off the middle it stays in contact; within the gap it never comes into it.
    mean, gain = shaft.describing_function([0.0, 0.1, 0.4], [3.0, -3.0, 0.1], 3.0)
    np.testing.assert_allclose(mean[:, 0], [12.5, -12.5, 0.0])
    np.testing.assert_allclose(gain[:, 0], [5 + 6j, 5 + 6j, 0.0])
    assert np.isnan(shaft.describing_function(np.nan, 0.0, 1.0)[0]).all()
    with pytest.raises(ModelError, match="frequency"):
        shaft.describing_function(1.0, 0.0, -2.0)


BAD = [
    (lambda: epp.LockPin(-1.0, 1.0, 1.0), "gap is -1.0; expected zero or more"),
    (lambda: epp.LockPin(1.0, 0.0, 1.0), "stiffness is 0.0; expected a positive number"),
    (lambda: epp.LockPin(1.0, 1.0, -1.0), "damping is -1.0"),
    (lambda: epp.LockPin(1.0, 1.0, np.nan), "damping is nan"),
    (lambda: epp.LockPin(1.0, 1.0, 1.0, "elastic"), "model is 'elastic'; expected 'unilateral' or 'classical'"),
    (lambda: epp.NordinShaft(-1.0, 1.0, 1.0), "gap is -1.0"),
    (lambda: epp.NordinShaft(1.0, 0.0, 1.0), "stiffness is 0.0"),
    (lambda: epp.NordinShaft(1.0, 1.0, 0.0), "damping is 0.0"),
]


@pytest.mark.parametrize(("make", "words"), BAD, ids=[w for _, w in BAD])
def test_invalid_fields_are_refused_in_one_sentence(make: object, words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        make()
    assert str(caught.value).endswith(".")
