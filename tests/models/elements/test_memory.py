"""Elements with memory: closed-form describing functions against quadrature of their own maps, limits, laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.elements import Slip
from tests.models.elements.quadrature import assert_agrees, crossings, fourier, steady_memories

numbers = st.floats(-3, 3)
positive = st.floats(0.01, 3)
amplitudes = st.floats(1e-2, 20)

PULLEY = epp.StictionPulley(harness_stiffness=8000.0, forearm_stiffness=33000.0, friction=0.045, kinetic_ratio=0.8)
ELEMENTS = [
    epp.HysteresisRelay(-0.5, 0.8, -1.0, 2.0),
    epp.HysteresisRelayDeadZone(1.0, 0.6, 2.0),
    epp.Play(0.7),
    epp.JumpAndFollow(1.2, 0.5, 2.0),
    epp.JumpAndFollow(0.5, 1.2),
    PULLEY,
]
kinds = [f"{type(e).__name__}{i}" for i, e in enumerate(ELEMENTS)]


@st.composite
def pulleys(draw: st.DrawFn) -> epp.StictionPulley:
    stiffness = st.floats(0.1, 10)
    return epp.StictionPulley(draw(stiffness), draw(stiffness), draw(st.floats(0.01, 0.95)), draw(st.floats(0, 1)))


@given(numbers, positive, numbers, numbers, amplitudes, numbers)
def test_hysteresis_relay(lower: float, width: float, low: float, high: float, a: float, b: float) -> None:
    element = epp.HysteresisRelay(lower, lower + width, low, high)
    mean, gain = element.describing_function(a, b)
    if b + a <= element.upper and b - a >= element.lower:
        assert mean == pytest.approx((low + high) / 2, abs=1e-15)
        assert gain == 0
        return
    assert_agrees((mean, gain), fourier(element, a, b, crossings((lower, lower + width), a, b)), a)


@given(positive, st.floats(0, 1), positive, amplitudes, numbers)
def test_hysteresis_relay_with_dead_zone(on: float, ratio: float, level: float, a: float, b: float) -> None:
    element = epp.HysteresisRelayDeadZone(on, ratio * on, level)
    levels = [s * x for s in (1, -1) for x in (element.on, element.off)]
    assert_agrees(element.describing_function(a, b), fourier(element, a, b, crossings(levels, a, b)), a)


@given(st.floats(0, 3), amplitudes, numbers)
def test_play(gap: float, a: float, b: float) -> None:
    element = epp.Play(gap)
    witness = fourier(element, a, b, crossings([b + a - gap, b - a + gap], a, b))
    mean, gain = element.describing_function(a, b)
    if 2 * a <= gap:
        assert gain == 0
        assert mean == b
    else:
        # The first quarter from the middle of the gap decides where a small oscillation rests; a large one forgets it.
        assert_agrees((mean, gain), witness, a, rounding=1e-13)


@given(st.floats(0, 3), st.floats(0, 3), positive, amplitudes, numbers)
def test_jump_and_follow(band: float, jump: float, slope: float, a: float, b: float) -> None:
    # Not on the border of moving at all, nor where the quadrature begins on a switch of its own or cannot place one: at
    # the very peak rounding of the level moves the phase by its square root.
    assume(abs(2 * a - band) > 1e-9 and abs(a - band) > 1e-9 and band > 1e-6 * a)
    element = epp.JumpAndFollow(band, jump, slope)
    # Once it moves: from the line it follows up to the peak.
    start = Slip(slope * (b + a - (band - jump) / 2), 1, b + a)
    witness = fourier(element, a, b, crossings([b + a - band, b - a + band], a, b), start=start)
    mean, gain = element.describing_function(a, b)
    if 2 * a <= band:
        assert gain == 0
        assert mean == slope * b
    else:
        assert_agrees((mean, gain), witness, a, rounding=1e-12)


def breakaway_levels(element: epp.StictionPulley, a: float, b: float, start: float | None = None) -> list[float]:
    """Where the force balance at constant u reaches static friction, from the memories at both turning points."""

    def balance(s: float, u: float, sign: float) -> float:
        harness, forearm = element.harness_stiffness * (s - u), element.forearm_stiffness * u
        return sign * (harness - forearm) - element.friction * (harness + forearm)

    out = [0.0]
    trough, peak = steady_memories(element, a, b, start)
    for memory, sign in ((trough, 1.0), (peak, -1.0)):
        u = float(memory.value)
        ends = (max(b - a, u), b + a)
        if ends[1] > ends[0] and balance(ends[0], u, sign) * balance(ends[1], u, sign) < 0:
            out.append(brentq(balance, *ends, args=(u, sign), xtol=1e-15, rtol=1e-14))
    return out


def closing_ratio(element: epp.StictionPulley) -> float:
    """Ratio of greatest to least stretch above which the loop closes, from the force balance on each line."""
    k_h, k_f = element.harness_stiffness, element.forearm_stiffness

    def share(r: float) -> float:
        return float(np.linalg.solve([[1.0, 1.0], [k_h * (1 - r), -k_f * (1 + r)]], [1.0, 0.0])[1])

    return share(-element.friction * element.kinetic_ratio) / share(element.friction)


@given(pulleys(), st.floats(0.05, 3), st.floats(-1, 2))
@settings(max_examples=200)
def test_stiction_pulley(element: epp.StictionPulley, a: float, relative: float) -> None:
    b = relative * 2 * a
    closes = b + a > 0 and (b <= a or (b + a) / (b - a) > closing_ratio(element))
    assume(b <= a or abs((b + a) / (b - a) - closing_ratio(element)) > 1e-9)
    answer = element.describing_function(a, b)
    if closes or b + a <= 0:
        # From the sliding line, as after any excursion; it forgets where it started.
        start = Slip(element.share(element.friction * element.kinetic_ratio) * max(b + a, 0), 1, b + a)
        witness = fourier(element, a, b, crossings(breakaway_levels(element, a, b, start), a, b), start=start)
    else:
        # It rests on the border of slipping or inside; rounding must not let the witness slip.
        u = float(answer[0][0]) / element.forearm_stiffness
        middle = (element.share(element.friction) * (b + a) + element.share(-element.friction) * (b - a)) / 2
        witness = fourier(element, a, b, start=u + 1e-12 * (middle - u))
        assert answer[1][0] == 0
    assert_agrees(answer, witness, a, rounding=1e-12)


@given(pulleys(), st.floats(0.05, 3))
def test_stuck_pulley_takes_equal_tensions_where_they_hold(element: epp.StictionPulley, b: float) -> None:
    mean, gain = element.describing_function(1e-6 * b, b)
    series = 1 / (1 / element.harness_stiffness + 1 / element.forearm_stiffness)
    np.testing.assert_allclose(mean, series * b, rtol=1e-12)
    np.testing.assert_allclose(gain, [0, element.harness_stiffness])


def test_slack_pulley_is_silent() -> None:
    mean, gain = PULLEY.describing_function([0.5, 1.0, 2.0], [-0.5, -1.0, -3.0])
    assert not mean.any()
    assert not gain.any()


def test_pulley_jumps_at_the_closing_amplitude() -> None:
    (closing, slack) = PULLEY.thresholds(bias=0.02)
    assert slack == 0.02
    assert (0.02 + closing) / (0.02 - closing) == pytest.approx(closing_ratio(PULLEY), rel=1e-12)
    _, gain = PULLEY.describing_function(closing * np.array([1 - 1e-9, 1 + 1e-9]), 0.02)
    assert gain[0, 0] == 0
    assert abs(gain[1, 0]) > 100


def test_pulley_with_full_friction_while_sliding_is_played_like_a_cone() -> None:
    # kinetic_ratio = 1 leaves no jumps: sensor force between two rays, continuous in time.
    element = epp.StictionPulley(1.0, 2.0, 0.2, 1.0)
    memory = element.output(1.0)[1]
    path = np.concatenate([np.linspace(1, 3, 50), np.linspace(3, 0.2, 200), np.linspace(0.2, 2, 100)])
    forces = []
    for s in path:
        y, memory = element.output(s, memory)
        forces.append(y)
        assert abs(y[1] - y[0]) <= 0.2 * (y[1] + y[0]) + 1e-12
    assert np.abs(np.diff(forces, axis=0)).max() < 0.1


def test_without_friction_the_pulley_is_a_spring() -> None:
    element = epp.StictionPulley(3.0, 6.0, 1e-9, 0.5)
    spring = epp.PiecewiseLinear([0.0], [0.0, 2.0], [0.0, 0.0])
    for a, b in ((1.0, 3.0), (1.0, 0.4), (2.0, -1.0)):
        mean, gain = element.describing_function(a, b)
        expected = spring.describing_function(a, b)
        np.testing.assert_allclose(mean, expected[0], rtol=1e-7)
        np.testing.assert_allclose(gain, expected[1], atol=1e-7)


def test_published_formulas() -> None:
    # Gelb and Vander Velde 1968: relay with hysteresis, friction-controlled backlash; Choudhury 2005: stiction.
    a = np.array([1.2, 3.0, 50.0])
    relay = epp.HysteresisRelay(-1.0, 1.0, -2.0, 2.0).describing_function(a)[1]
    np.testing.assert_allclose(relay, 8 / (np.pi * a) * np.exp(-1j * np.arcsin(1 / a)), rtol=1e-13)
    np.testing.assert_allclose(
        -1 / relay, -np.pi / 8 * (np.sqrt(a**2 - 1) + 1j), rtol=1e-13
    )  # the critical locus is a line parallel to the real axis
    half = 1.0
    kink = 2 * half / a - 1
    real = (np.pi / 2 - np.arcsin(kink) - kink * np.sqrt(1 - kink**2)) / np.pi
    lag = 4 * half / (np.pi * a) * (1 - half / a)
    np.testing.assert_allclose(epp.Play(2 * half).describing_function(a)[1], real - 1j * lag, rtol=1e-12)
    band, jump = 2.0, 0.7
    turn = np.arcsin((a - band) / a)
    sine = a / 2 * np.sin(2 * turn) - 2 * a * np.cos(turn) - a * (np.pi / 2 + turn) + 2 * (band - jump) * np.cos(turn)
    cosine = -3 * a / 2 + a / 2 * np.cos(2 * turn) + 2 * a * np.sin(turn) - 2 * (band - jump) * np.sin(turn)
    expected = -(sine - 1j * cosine) / (np.pi * a)
    np.testing.assert_allclose(epp.JumpAndFollow(band, jump).describing_function(a)[1], expected, rtol=1e-12)


def test_published_limit_cycles_balance() -> None:
    """Solutions found independently of loops from the literature: 1 + N G = 0."""

    def balance(element: epp.Nonlinearity, loop: complex, amplitude: float, bias: float = 0.0) -> float:
        return abs(1 + loop * element.describing_function(amplitude, bias)[1])

    s = 0.31814239915748294j
    assert balance(epp.Play(2.0), 5 / (s * (s + 1)), 1.0556953082275586) < 1e-12
    s = 1.591383495201434j
    assert balance(epp.Play(2.0), 5 / (s * (s + 1)), 2.020632276959861) < 1e-12
    s = 2.19252753450447j
    assert balance(epp.HysteresisRelay(-0.1, 0.1), 1 / (s * (s + 1)), 0.24098084964495103) < 1e-12
    s = 0.5092201259608369j
    thruster = epp.HysteresisRelayDeadZone(0.1, 0.08, 0.05)
    assert balance(thruster, (1 + 0.5 * s) / s**2, 0.1013295469024534) < 1e-9
    s = 0.2858259095221507j
    stiction = epp.JumpAndFollow(5.0, 2.0)
    assert balance(stiction, 0.4 * (1 + 1 / (5 * s)) / s, 2.793837312449711) < 1e-12
    s = 3.170284003194721j
    relay, amplitude, bias = epp.HysteresisRelay(-0.1, 0.1, -0.7, 1.3), 0.36524608271661557, -0.10532721167710717
    assert balance(relay, np.exp(-0.5 * s) / (s + 1), amplitude, bias) < 1e-12
    assert relay.describing_function(amplitude, bias)[0] == pytest.approx(-bias, rel=1e-12)


def test_without_memory_they_become_the_static_ones() -> None:
    a, b = np.meshgrid([0.2, 1.0, 7.0], [0.0, 0.3, -2.0])
    pairs = [
        (epp.HysteresisRelay(0.25, 0.25, -1.0, 2.0), epp.Relay(-1.0, 2.0, 0.25)),
        (epp.HysteresisRelayDeadZone(0.5, 0.5, 2.0), epp.RelayDeadZone(0.5, 2.0)),
        (epp.Play(0.0), epp.PiecewiseLinear([], [1.0], [0.0])),
        (epp.JumpAndFollow(0.0, 0.0, 3.0), epp.PiecewiseLinear([], [3.0], [0.0])),
    ]
    for element, static in pairs:
        for one, other in zip(element.describing_function(a, b), static.describing_function(a, b), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-14)


def test_jump_and_follow_without_jump_is_play() -> None:
    a = np.array([0.1, 0.5, 0.6, 3.0, 1e9])
    for k in (0, 1):
        stiction, play = epp.JumpAndFollow(1.0, 0.0, 2.0), epp.Play(1.0)
        one, other = stiction.describing_function(a, 0.2)[k], 2 * play.describing_function(a, 0.2)[k]
        np.testing.assert_allclose(one, other, rtol=1e-13)


def test_large_amplitudes() -> None:
    a = np.array([1e4, 1e8, 1e12])
    _, gain = epp.Play(2.0).describing_function(a)
    np.testing.assert_allclose(gain.imag, -4 / (np.pi * a) * (1 - 1 / a), rtol=1e-14)
    np.testing.assert_allclose(1 - gain.real[0], 16 / (3 * np.pi) / a[0] ** 1.5, rtol=1e-3)  # 2/pi chi^3/3, chi^2 = 4/A
    _, gain = epp.HysteresisRelay(-1.0, 1.0).describing_function(a)
    np.testing.assert_allclose(gain.imag, -4 / np.pi / a / a, rtol=1e-14)
    np.testing.assert_allclose(gain.real, 4 / (np.pi * a), rtol=1e-8)
    _, gain = epp.JumpAndFollow(2.0, 2.0).describing_function(a)
    np.testing.assert_allclose(gain.imag, -4 / np.pi / a / a, rtol=1e-14)  # S = J: no offset, lag of second order
    # A cable that is nearly always slack or nearly always taut: a ray for each direction.
    _, gain = epp.StictionPulley(1.0, 1.0, 0.5, 0.8).describing_function(a, 1.0)
    assert np.ptp(gain[:, 0].real) < 1e-3


@pytest.mark.parametrize("k", [20, 40])
def test_just_above_the_threshold_relative_accuracy_is_kept(k: int) -> None:
    excess = 0.5**k
    _, gain = epp.Play(2.0).describing_function(1 + excess)
    theta = 2 * np.arctan(np.sqrt(excess))
    expected = 2 / np.pi * (theta**3 * (1 / 3 - theta**2 / 15 + 2 * theta**4 / 315))
    assert gain.real == pytest.approx(expected, rel=1e-12)
    assert gain.imag == pytest.approx(-4 / np.pi * excess / (1 + excess) ** 2, rel=1e-12)
    _, gain = epp.HysteresisRelay(-1.0, 1.0).describing_function(1 + excess)
    assert gain.real == pytest.approx(4 / np.pi * np.sqrt(excess * (2 + excess)) / (1 + excess) ** 2, rel=1e-12)


def test_at_the_threshold_nothing_moves() -> None:
    for element in (
        epp.HysteresisRelay(-1.0, 1.0),
        epp.HysteresisRelayDeadZone(1.0, 0.5),
        epp.Play(2.0),
        epp.JumpAndFollow(2.0, 0.5),
    ):
        mean, gain = element.describing_function([0.0, 1e-9, 0.5, 1.0])
        assert not mean.any()
        assert not gain.any()
        assert element.describing_function(1.0 + 1e-9)[1] != 0


def test_relays_kept_on_one_side() -> None:
    mean, gain = epp.HysteresisRelay(-1.0, 1.0, -2.0, 3.0).describing_function(0.5, [0.8, -0.8, 0.0, 5.0])
    np.testing.assert_allclose(mean, [3, -2, 0.5, 3])
    assert not gain.any()
    mean, gain = epp.HysteresisRelayDeadZone(1.0, 0.2, 2.0).describing_function(0.1, [0.95, -0.95, 0.5, 7.0])
    np.testing.assert_allclose(mean, [2, -2, 0, 2])
    assert not gain.any()


@given(amplitudes, numbers, st.floats(1e-6, 1e6))
def test_unit_of_the_input_does_not_matter(a: float, b: float, unit: float) -> None:
    scaled = [
        epp.HysteresisRelay(-0.5 * unit, 0.8 * unit, -1.0, 2.0),
        epp.HysteresisRelayDeadZone(1.0 * unit, 0.6 * unit, 2.0),
        epp.Play(0.7 * unit),
        epp.JumpAndFollow(1.2 * unit, 0.5 * unit, 2.0),
    ]
    bounds = np.concatenate([e.thresholds() for e in ELEMENTS[:4]] + [e.thresholds(b) for e in ELEMENTS[:2]])
    assume(np.abs(bounds - a).min() > 1e-9)
    powers = [0, 0, 1, 1]  # of the unit in the output
    for one, other, power in zip(ELEMENTS[:4], scaled, powers, strict=True):
        mean, gain = one.describing_function(a, b)
        other_mean, other_gain = other.describing_function(a * unit, b * unit)
        np.testing.assert_allclose(other_mean, mean * unit**power, rtol=1e-9, atol=1e-9 * unit**power)
        np.testing.assert_allclose(other_gain * unit, gain * unit**power, rtol=1e-7, atol=1e-9 * unit**power)
    mean, gain = PULLEY.describing_function(a, b)
    other_mean, other_gain = PULLEY.describing_function(a * unit, b * unit)
    np.testing.assert_allclose(other_mean, mean * unit, rtol=1e-9, atol=1e-6 * unit)
    np.testing.assert_allclose(other_gain, gain, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("element", ELEMENTS[1:5], ids=kinds[1:5])
@given(a=amplitudes, b=numbers)
@settings(max_examples=25)
def test_odd_elements_have_odd_mean_and_even_gain(element: epp.Nonlinearity, a: float, b: float) -> None:
    mean, gain = element.describing_function(a, [b, -b, 0.0])
    np.testing.assert_allclose(mean[0], -mean[1], atol=1e-12)
    np.testing.assert_allclose(gain[0], gain[1], atol=1e-12 / a)
    assert mean[2] == pytest.approx(0, abs=1e-13)


@pytest.mark.parametrize("element", ELEMENTS, ids=kinds)
@given(a=amplitudes, b=numbers)
@settings(max_examples=50)
def test_they_lag_and_never_supply_energy(element: epp.Nonlinearity, a: float, b: float) -> None:
    gain = element.describing_function(a, b)[1]
    sensor = gain[..., 0] if element.n_outputs == 2 else gain
    assert sensor.imag <= 1e-12 * abs(sensor) or (isinstance(element, epp.JumpAndFollow) and element.slip_jump > 1)
    assert sensor.real >= -1e-12 * abs(sensor)


@pytest.mark.parametrize("element", ELEMENTS, ids=kinds)
@given(path=st.lists(numbers, min_size=2, max_size=6), parts=st.integers(2, 40))
@settings(max_examples=50)
def test_a_monotone_stretch_may_be_taken_in_steps(element: epp.Nonlinearity, path: list[float], parts: int) -> None:
    path = [round(x, 3) for x in path]
    at_once = in_steps = element.output(path[0])[1]
    for begin, end in zip(path[:-1], path[1:], strict=True):
        y, at_once = element.output(end, at_once)
        for x in np.linspace(begin, end, parts + 1)[1:]:
            z, in_steps = element.output(x, in_steps)
        scale = 1 + 1e5 * (element is PULLEY)
        np.testing.assert_allclose(z, y, atol=1e-9 * scale)


def test_maps_by_hand() -> None:
    relay = epp.HysteresisRelay(-1.0, 1.0, -2.0, 3.0)
    y = [-2.0]
    for x in (0.9, 1.0, 1.1, -0.9, -1.0, -1.1, 0.0):
        y.append(float(relay.output(x, y[-1])[0]))
    assert y[1:] == [-2, -2, 3, 3, 3, -2, -2]
    three = epp.HysteresisRelayDeadZone(1.0, 0.5, 2.0)
    y = [0.0]
    for x in (0.9, 1.1, 0.6, 0.4, 0.9, -0.9, -1.1, -0.6, 3.0, -3.0, 0.0):
        y.append(float(three.output(x, y[-1])[0]))
    assert y[1:] == [0, 2, 2, 0, 0, 0, -2, -2, 2, -2, 0]
    play = epp.Play(2.0)
    y = [float(play.output(0.0)[0])]
    for x in (1.0, 2.0, 0.5, 0.0, -1.0):
        y.append(float(play.output(x, y[-1])[0]))
    assert y == [0, 0, 1, 1, 1, 0]
    valve, memory, y = epp.JumpAndFollow(2.0, 1.0), 0.0, []
    for x in (1.4, 1.6, 3.0, 1.1, 0.9, 0.0, 1.9, 2.1):
        value, memory = valve.output(x, memory)
        y.append(float(value))
    np.testing.assert_allclose(y, [0, 1.1, 2.5, 2.5, 1.4, 0.5, 0.5, 1.6])


def test_pulley_by_hand() -> None:
    # k_h = k_f = 1, friction 1/2, kinetic 1/4: rays u/s = 1/4 and 3/4 at breakaway, 3/8 and 5/8 while sliding.
    element = epp.StictionPulley(1.0, 1.0, 0.5, 0.5)
    assert [element.share(r) for r in (0.5, 0.25, 0, -0.25, -0.5)] == [0.25, 0.375, 0.5, 0.625, 0.75]
    assert element.share_difference(0.25, 0.5) == 0.125
    memory, forces = 0.5, []
    for s in (1.9, 2.1, 4.0, 2.1, 1.9, 1.0, -1.0, 0.1):
        y, memory = element.output(s, memory)
        forces.append(y)
    expected = [0.5, 0.7875, 1.5, 1.5, 1.1875, 0.625, 0.0, 0.0375]
    np.testing.assert_allclose([f[0] for f in forces], expected)
    np.testing.assert_allclose([f[1] for f in forces], [1.4, 1.3125, 2.5, 0.6, 0.7125, 0.375, 0, 0.0625])
    assert memory.direction == 1


def test_thresholds() -> None:
    np.testing.assert_allclose(ELEMENTS[0].thresholds(), [0.5, 0.8])
    np.testing.assert_allclose(ELEMENTS[0].thresholds(bias=0.3), [0.5, 0.8])
    np.testing.assert_allclose(ELEMENTS[1].thresholds(), [0.6, 1.0])
    np.testing.assert_allclose(ELEMENTS[1].thresholds(bias=0.5), [0.1, 0.5, 1.1, 1.5])
    np.testing.assert_allclose(ELEMENTS[2].thresholds(), [0.35])
    np.testing.assert_allclose(ELEMENTS[3].thresholds(), [0.6])
    assert epp.Play(0.0).thresholds().size == 0
    assert PULLEY.thresholds().size == 0
    np.testing.assert_allclose(PULLEY.thresholds(bias=-2.0), [2.0])


@pytest.mark.parametrize("element", ELEMENTS, ids=kinds)
def test_shapes_broadcast_and_nothing_finite_gives_nan(element: epp.Nonlinearity) -> None:
    a = np.array([0.0, 1e-300, 1e-12, 1.0, 1e8, 1e15])
    b = np.array([[0.0], [1.0], [-1e6]])
    tail = (2,) if element.n_outputs == 2 else ()
    mean, gain = element.describing_function(a, b)
    assert mean.shape == gain.shape == (3, 6, *tail)
    assert mean.dtype == float
    assert gain.dtype == complex
    assert not np.isnan(mean).any()
    assert not np.isnan(gain).any()
    mean, gain = element.describing_function(1.0, 0.0, np.ones(4))
    assert mean.shape == (4, *tail)
    assert np.isnan(element.describing_function(np.nan)[1]).all()
    assert element.output(np.zeros((2, 3)))[0].shape == (2, 3, *tail)
    assert isinstance(element.automaton(), epp.Automaton)
    with pytest.raises(ModelError, match="amplitude .* -1"):
        element.describing_function([-1.0, 2.0])


BAD = [
    (lambda: epp.HysteresisRelay(1.0, 0.0), "upper is 0.0; expected at least lower"),
    (lambda: epp.HysteresisRelay(np.nan, 0.0), "lower is nan"),
    (lambda: epp.HysteresisRelayDeadZone(1.0, 2.0), "off is 2.0"),
    (lambda: epp.HysteresisRelayDeadZone(1.0, -0.1), "off is -0.1"),
    (lambda: epp.HysteresisRelayDeadZone(0.0, 0.0), "on is 0.0"),
    (lambda: epp.HysteresisRelayDeadZone(1.0, 0.5, 0.0), "level is 0.0"),
    (lambda: epp.Play(-1.0), "gap is -1.0; expected zero or more"),
    (lambda: epp.Play(np.inf), "gap is inf"),
    (lambda: epp.JumpAndFollow(-1.0, 0.0), "stick_band is -1.0"),
    (lambda: epp.JumpAndFollow(1.0, -1.0), "slip_jump is -1.0"),
    (lambda: epp.JumpAndFollow(1.0, 1.0, 0.0), "slope is 0.0"),
    (lambda: epp.StictionPulley(0.0, 1.0, 0.1, 1.0), "harness_stiffness is 0.0"),
    (lambda: epp.StictionPulley(1.0, -1.0, 0.1, 1.0), "forearm_stiffness is -1.0"),
    (lambda: epp.StictionPulley(1.0, 1.0, 0.0, 1.0), "friction is 0.0"),
    (lambda: epp.StictionPulley(1.0, 1.0, 1.0, 1.0), "friction is 1.0"),
    (lambda: epp.StictionPulley(1.0, 1.0, 0.1, 1.5), "kinetic_ratio is 1.5"),
]


@pytest.mark.parametrize(("make", "words"), BAD, ids=[w for _, w in BAD])
def test_invalid_fields_are_refused_in_one_sentence(make: object, words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        make()
    assert str(caught.value).endswith(".")


def test_play_and_dead_zone_share_the_real_part_of_pushing() -> None:
    # Pushing from the crossing of the gap to the turning point: the area under cos^2 is that of a one-sided ramp.
    a, gap = 2.0, 1.0
    ramp = epp.DeadZone(-50.0, gap - a).describing_function(a)[1].real
    assert epp.Play(gap).describing_function(a)[1].real == pytest.approx(ramp, rel=1e-13)
