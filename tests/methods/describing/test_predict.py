"""Describing-function prediction against published and closed-form answers, folds, units, and python-control."""

from __future__ import annotations

import time
from dataclasses import replace

import control
import numpy as np
import pytest
import scipy.optimize
import scipy.signal
from scipy.optimize import minimize_scalar

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import unit_at_input
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.models.devices.elbow.loop import elbow
from eppanalysis.models.devices.elbow.parameters import Parking
from eppanalysis.results import Status
from tests.random_loops import random_loop
from tests.shared import mostly_slow, of_unknown_response, shipped, touching

from_tf, from_blocks = epp.LureSystem.from_tf, epp.LureSystem.from_blocks
LBF, DEG = 4.4482216152605, np.pi / 180


def two_mass(element, rate: bool) -> epp.LureSystem:
    """PI control of the load's position; states: twist, motor speed, load speed, load angle, integral."""
    Jm, Jl, dm, dl, kp, ki = 0.001, 0.004, 0.02, 0.02, 6.0, 30.0
    A = np.zeros((5, 5))
    A[0, 1:3] = 1.0, -1.0
    A[1, [1, 3, 4]] = -dm / Jm, -kp / Jm, -ki / Jm
    A[2, 2], A[3, 2], A[4, 3] = -dl / Jl, 1.0, 1.0
    C = [[1.0, 0, 0, 0, 0], [0, 1.0, -1.0, 0, 0]][: 1 + rate]
    return epp.LureSystem.build(A, [[0], [-1 / Jm], [1 / Jl], [0], [0]], C, [element])


def sampled_servo(kp: float, ki: float) -> epp.LureSystem:
    plant = epp.StateSpace(*scipy.signal.tf2ss([kp + ki, -kp], [1.0, -2.0, 1.0]), 1.0)
    return from_tf(plant, epp.Play(gap=2.0))


def hunting(kd: float, ki: float) -> epp.LureSystem:
    A = [[0, 1, 0], [-10, -kd, -ki], [1, 0, 0]]
    return epp.LureSystem.build(A, [[0], [-1], [0]], [[0, 1, 0]], [epp.Friction(coulomb=1.0, static=2.0)])


def belt() -> epp.LureSystem:
    stribeck = epp.Friction(coulomb=0.0, static=1.0, stribeck=3.0)
    return epp.LureSystem.build([[0, 1], [-1, 0]], [[0], [1]], [[0, -1]], [stribeck], constant_input=[0.2])


GONCALVES = ([1, -5, -11, -5, 250, 250], [1, 12, 57, 140, 195, 150, 50])
THIRD_ORDER = [1, 2, 2, 1]

# Loop, then (amplitude at the element's input, omega, mean there, stable) of every describing-function answer.
LOOPS = {
    "relay, third order": (
        from_tf(([1], [1, 3, 2, 0]), epp.Relay()),
        [(0.2122065907891937, 1.4142135623730951, 0, True)],
    ),
    "hysteresis, sixth order": (
        from_tf(GONCALVES, epp.HysteresisRelay(-0.25, 0.25)),
        [(3.1322724679712173, 1.5171958787034536, 0, True)],
    ),
    "relay, dead time": (
        from_tf(([1], [1, 1]), epp.Relay(), delay=0.5),
        [(0.33445724230167534, 3.6731944063042516, 0, True)],
    ),
    "hysteresis, servo": (
        from_tf(([1], [1, 1, 0]), epp.HysteresisRelay(-0.1, 0.1)),
        [(0.24098084964495103, 2.19252753450447, 0, True)],
    ),
    "relay with dead zone": (
        from_tf(([5], [1, 2, 1, 0]), epp.RelayDeadZone(1.0)),
        [(1.0606069553561213, 1.0, 0, False), (3.001204966423319, 1.0, 0, True)],
    ),
    "thruster": (
        from_tf(([0.5, 1], [1, 0, 0]), epp.HysteresisRelayDeadZone(0.1, 0.08, 0.05)),
        [(0.1013295469024534, 0.5092201259608369, 0, True)],
    ),
    "saturation": (from_tf(([8], THIRD_ORDER), epp.Saturation()), [(3.3439987302064953, 1.4142135623730951, 0, True)]),
    "saturation, zero at the origin": (
        from_tf(([-1, 0], [1, 0.8, 8]), epp.Saturation()),
        [(1.4555006310528025, 2.82842712474619, 0, True)],
    ),
    "saturation, type 1": (
        from_tf(([9], [1, 3, 2, 0]), epp.Saturation()),
        [(1.8073615967974652, 1.4142135623730947, 0, True)],
    ),
    "dead zone with saturation": (
        from_tf(([24, 6], [1, 4, 4, 0, 0]), epp.DeadZoneSaturation(1.0, 4.0, 2.0)),
        [(1.2930089342295261, 1.7320508075688767, 0, False), (4.923677709995772, 1.7320508075688767, 0, True)],
    ),
    "quantised sensor": (
        from_tf(([5.6], [1, 3, 2, 0]), epp.Quantiser(1.0, 20)),
        [
            (0.5697547549058886, 1.414213562373095, 0, False),
            (1.0428670390085437, 1.414213562373095, 0, True),
            (1.7332891371457004, 1.414213562373095, 0, False),
            (1.784370646926711, 1.414213562373095, 0, True),
        ],
    ),
    "asymmetric saturation": (
        from_tf(([8], THIRD_ORDER), epp.Saturation(-0.5, 2.0)),
        [(2.798229231045058, 1.414213562373095, -1.0530530870594652, True)],
    ),
    "biased hysteresis, dead time": (
        from_tf(([1], [1, 1]), epp.HysteresisRelay(-0.1, 0.1, -0.7, 1.3), delay=0.5),
        [(0.36524608271661557, 3.170284003194721, -0.10532721167710717, True)],
    ),
    "play in a servo": (
        from_tf(([5], [1, 1, 0]), epp.Play(gap=2.0)),
        [(1.0556953082275586, 0.31814239915748294, 0, False), (2.020632276959861, 1.591383495201434, 0, True)],
    ),
    "play, sampled, 0.3 and 0.1": (sampled_servo(0.3, 0.1), [(1.8110958716515742, 0.2720058512550302, 0, True)]),
    "play, sampled, 0.5 and 0.2": (sampled_servo(0.5, 0.2), [(1.69232225886399, 0.38955509087503426, 0, True)]),
    "play, sampled, 0.2 and 0.2": (sampled_servo(0.2, 0.2), [(3.134533004456603, 0.42897004502352304, 0, True)]),
    "play, sampled, 0.5 and 0.1": (sampled_servo(0.5, 0.1), [(1.423650407543962, 0.24872573337585752, 0, True)]),
    "two masses": (
        two_mass(epp.DeadZone(-0.01, 0.01, 40.0), False),
        [(0.014298266624319145, 37.28398567604504, 0, True)],
    ),
    "belt": (belt(), []),
    "friction hunting": (hunting(1.0, 5.0), []),
    "friction hunting, slow": (hunting(0.5, 2.0), []),
    "valve stiction": (
        from_blocks([epp.JumpAndFollow(5.0, 2.0), ([1], [1, 0]), ([0.4, 0.08], [1, 0])]),
        [(2.793837312449711, 0.2858259095221507, 0, True)],
    ),
    "valve dead band": (from_blocks([epp.JumpAndFollow(4.0, 0.0), ([2], [10, 17, 8, 1]), ([0.6, 0.1], [1, 0])]), []),
    "van der Pol": (from_tf(([1.0, 0], [1, -1.0, 1]), epp.Cube(1 / 3)), [(2.0, 1.0, 0, True)]),
}


def answers(system: epp.LureSystem) -> list[tuple[float, float, float, bool]]:
    """(amplitude, omega, mean) at the first element's input, stability."""
    first = system.element_names[0]
    found = []
    for cycle in predict_limit_cycles(system):
        at = cycle.elements[first]
        assert cycle.residual < 1e-12
        found.append((at["amplitude"], cycle.omega, at["bias"], cycle.stable))
    return found


@pytest.mark.parametrize("name", LOOPS)
def test_every_textbook_answer_and_no_other(name):
    system, expected = LOOPS[name]
    found = answers(system)
    assert len(found) == len(expected)
    for (a, omega, bias, stable), want in zip(found, expected, strict=True):
        assert a == pytest.approx(want[0], rel=1e-9)
        assert omega == pytest.approx(want[1], rel=1e-9)
        assert bias == pytest.approx(want[2], rel=1e-9, abs=1e-9 * a)
        assert stable is want[3]


def test_two_elements_in_series():
    """Saturation and play; the second answer, inside the linear range, is that of the play alone."""
    found = answers(from_blocks([epp.Saturation(-0.5, 0.5), ([8.0], [1, 1, 0]), epp.Play(gap=1.0)]))
    assert found[1][:2] == pytest.approx((0.777671565035938, 1.8915772893351637), rel=1e-9)
    assert [f[3] for f in found] == [False, True]
    alone = answers(from_tf(([8.0], [1, 1, 0]), epp.Play(gap=1.0)))
    assert found[0][1] == pytest.approx(alone[0][1], rel=1e-9)
    assert len(found) == 2


def test_frequency_dependent_element():
    """A lock pin with damping: the balance is written out independently from the loop's own equations."""
    pin = epp.LockPin(gap=0.02, stiffness=40.0, damping=0.1, model="classical")
    ((a, omega, bias, stable),) = answers(two_mass(pin, True))
    s = 1j * omega
    load = 1.0 / (0.004 * s + 0.02)
    motor = (-1.0 - (6.0 / s + 30.0 / s**2) * load) / (0.001 * s + 0.02)
    N = complex(pin.describing_function(a, 0.0, omega)[1])
    assert N * (motor - load) / s == pytest.approx(1.0, abs=1e-10)
    assert bias == pytest.approx(0.0, abs=1e-12)
    assert stable


def play_gain(a: float) -> float:
    """Gain K of K/(s(s+1)) at which play of half gap 1 oscillates with amplitude a."""
    N = complex(epp.Play(gap=2.0).describing_function(a)[1])
    omega = -1.0 / np.tan(np.angle(N))
    return omega * np.hypot(1.0, omega) / abs(N)


PLAY_FOLD = minimize_scalar(play_gain, bounds=(1.01, 3.0), method="bounded", options={"xatol": 1e-12}).fun
FOLDS = {
    "real gain": lambda r: from_tf(([np.pi * r], [1, 2, 1, 0]), epp.RelayDeadZone(1.0)),
    "complex gain": lambda r: from_tf(([PLAY_FOLD * r], [1, 1, 0]), epp.Play(gap=2.0)),
    "several elements": lambda r: from_blocks([epp.Saturation(-9, 9), ([PLAY_FOLD * r], [1, 1, 0]), epp.Play(gap=2.0)]),
}


@pytest.mark.parametrize("kind", FOLDS)
def test_both_cycles_next_to_a_fold_and_none_beyond(kind):
    found = answers(FOLDS[kind](1 + 1e-6))
    assert [f[3] for f in found] == [False, True]
    assert found[0][0] < found[1][0] < 1.01 * found[0][0]
    assert answers(FOLDS[kind](1 - 1e-6)) == []


def scaled(c: float, t: float) -> list[epp.LureSystem]:
    """Loops with amplitudes and time in other units."""
    return [
        from_tf(([5 / t**2], [1, 1 / t, 0]), epp.Play(gap=2.0 * c)),
        from_tf(([5.6 / t**3], [1, 3 / t, 2 / t**2, 0]), epp.Quantiser(c, 20)),
        from_tf(([8 / t**3], [1, 2 / t, 2 / t**2, 1 / t**3]), epp.Saturation(-0.5 * c, 2.0 * c)),
        from_tf(([1 / t], [1, 1 / t]), epp.Relay(-c, c), delay=0.5 * t),
        from_blocks([epp.Saturation(-0.5 * c, 0.5 * c), ([8 / t**2], [1, 1 / t, 0]), epp.Play(gap=c)]),
    ]


@pytest.fixture(scope="module")
def in_si() -> list[list[tuple[float, float, float, bool]]]:
    return [answers(loop) for loop in scaled(1.0, 1.0)]


SLOW_UNITS = [pytest.param(*units, marks=pytest.mark.slow) for units in ((1e-6, 1e-6), (1e6, 1e6))]


@pytest.mark.parametrize(("size", "time"), [(1e-6, 1e6), (1e6, 1e-6), *SLOW_UNITS])
def test_units_do_not_matter(in_si, size, time):
    """Amplitude and time scaled by 1e-6 and 1e6: the same answers in the new units."""
    for want, other in zip(in_si, scaled(size, time), strict=True):
        found = answers(other)
        assert [f[3] for f in found] == [w[3] for w in want]
        for w, f in zip(want, found, strict=True):
            assert f[0] / size == pytest.approx(w[0], rel=1e-9)
            assert f[1] * time == pytest.approx(w[1], rel=1e-9)
            assert f[2] / size == pytest.approx(w[2], rel=1e-9, abs=1e-9 * w[0])


def test_symmetric_loop_with_biased_cycles():
    """Cube in positive feedback: besides the centred cycle a pair off centre, in closed form.

    The mean of (b + a sin)^3 is b^3 + 1.5 a^2 b, its gain 3 b^2 + 0.75 a^2; with L(0) = 1 off centre b^2 = 1 - 1.5 a^2.
    """
    den = np.polymul([1, 2, 1], [0.3, 1])
    phase = lambda w: np.angle((1 - 1j * w) ** 2 / (1 + 1j * w) ** 2 / (1 + 0.3j * w))  # noqa: E731
    w = scipy.optimize.brentq(phase, 3.0, 6.0)
    n = np.hypot(1.0, 0.3 * w)
    found = answers(from_tf(([1, -2, 1], den), epp.Cube(1.0), feedback=1))
    a = np.sqrt((3 - n) / 3.75)
    b = np.sqrt(1 - 1.5 * a**2)
    want = [(-b, a), (0.0, np.sqrt(n / 0.75)), (b, a)]
    assert sorted((f[2], f[0]) for f in found) == [pytest.approx(x, rel=1e-9, abs=1e-9) for x in want]
    assert [f[1] for f in found] == pytest.approx([w] * 3, rel=1e-9)


def test_dead_time_with_bounded_gain_has_all_modes():
    """Saturation behind 20 exp(-s)/(s+1): one cycle for every real value of L below -1."""
    omega = np.linspace(0.1, 20.0, 200001)
    turns = (omega + np.arctan(omega)) / np.pi
    modes = [np.interp(k, turns, omega) for k in (1, 3, 5, 7) if 20 / np.hypot(1, np.interp(k, turns, omega)) > 1]
    found = answers(from_tf(([20.0], [1, 1]), epp.Saturation(), delay=1.0))
    assert sorted(f[1] for f in found) == pytest.approx(modes, rel=1e-6)
    assert [f[3] for f in sorted(found, key=lambda f: f[1])] == [True] + [False] * (len(modes) - 1)


def test_amplitude_inside_a_gap_is_never_an_answer():
    for gap in (0.5, 2.0):
        assert all(f[0] > gap / 2 for f in answers(from_tf(([50.0], [1, 1, 0]), epp.Play(gap=gap))))


def test_linear_element_gives_nothing():
    line = epp.PiecewiseLinear(breakpoints=[0.0], slopes=[1.0, 1.0], intercepts=[0.0, 0.0])
    assert answers(from_tf(([9], [1, 3, 2, 0]), line)) == []


def test_signals_have_the_cycle_of_the_elements():
    cycle = predict_limit_cycles(LOOPS["asymmetric saturation"][0])[0]
    c0, c1 = cycle.harmonics["x"]
    assert c1 == pytest.approx(-1j * 2.798229231045058)  # sine phase: Re(-j a exp(j omega t)) = a sin(omega t)
    mean, gain = epp.Saturation(-0.5, 2.0).describing_function(abs(c1), c0.real)
    assert cycle.harmonics["y"] == pytest.approx([float(mean), complex(gain) * c1])
    assert cycle.mean["x"] == pytest.approx(-8 * cycle.mean["y"])
    assert cycle.peak_to_peak["x"] == pytest.approx(2 * abs(c1))
    assert cycle.waveform["x"].max() == pytest.approx(cycle.mean["x"] + abs(c1), rel=1e-3)


# Relative errors of the describing function against the exact cycle's fundamental: the larger of amplitude and omega.
KNOWN_ERRORS = {
    "relay, third order": [0.0467],
    "hysteresis, sixth order": [0.0183],
    "relay with dead zone": [None, 0.0186],
    "saturation": [0.0150],
    "dead zone with saturation": [0.166, 0.0311],
    "asymmetric saturation": [0.176],
    "play in a servo": [None, 0.0285],
    "valve stiction": [0.1008],
    "van der Pol": [0.0605],
    "play, sampled, 0.3 and 0.1": [0.087],
}


@pytest.mark.parametrize("name", KNOWN_ERRORS)
def test_error_estimate_covers_the_error_and_has_its_size(name):
    cycles = predict_limit_cycles(LOOPS[name][0])
    for cycle, error in zip(cycles, KNOWN_ERRORS[name], strict=True):
        if error is not None:
            # A sampled cycle locks to a whole number of samples, which no balance of harmonics knows.
            assert (0.9 if "sampled" in name else 1.0) * error < cycle.error_estimate < 3.5 * error


def test_error_estimate_warns_of_the_invented_cycle_at_the_gap():
    """First order invents an unstable cycle near the gap, where no true one exists: the estimate says 100 per cent."""
    assert predict_limit_cycles(LOOPS["play in a servo"][0])[0].error_estimate > 0.5


class TestElbow:
    """The paper's elbow: several elements, biased, with a lock pin whose gain depends on frequency."""

    @staticmethod
    def parameters(backlash: float = 2.5, band: float = 2.5) -> epp.ElbowParameters:
        from dataclasses import replace

        p = epp.ElbowParameters()
        return replace(
            p,
            pulley=replace(p.pulley, friction=0.0),
            lock_pin=replace(p.lock_pin, backlash=backlash * DEG),
            bands=replace(p.bands, range=band * LBF),
        )

    @pytest.mark.parametrize(("backlash", "band"), [(2.5, 2.5), (0.5, 1.0)])
    def test_stable_cycle_and_unstable_one_below_it(self, backlash, band):
        prediction = predict_limit_cycles(elbow(self.parameters(backlash, band)))
        assert [c.stable for c in prediction] == [False, True]
        assert prediction[0].peak_to_peak["theta"] < prediction[1].peak_to_peak["theta"]
        assert all(c.residual < 1e-12 for c in prediction)

    @pytest.mark.parametrize(("backlash", "band"), [(0.5, 2.5), (0.25, 1.0)])
    def test_none_with_less_backlash(self, backlash, band):
        assert len(predict_limit_cycles(elbow(self.parameters(backlash, band)))) == 0

    def test_exact_dead_time_and_pade_agree(self):
        p = self.parameters()
        one, other = (predict_limit_cycles(elbow(p, delay_model=model)) for model in ("pade", "exact"))
        assert [c.frequency for c in one] == pytest.approx([c.frequency for c in other], rel=1e-4)

    def test_signals_close_the_equations_of_motion(self):
        """Forearm, drive and cable equations, written out for the fundamental and for the mean."""
        p = self.parameters()
        for cycle in predict_limit_cycles(elbow(p)):
            s = 1j * cycle.omega
            c = {k: v[1] for k, v in cycle.harmonics.items()}
            J, R = p.forearm.total_inertia, p.pulley.radius
            forearm = J * s**2 * c["theta"] + p.forearm.viscous_friction * s * c["theta"]
            assert forearm == pytest.approx(c["pin_torque"] + R * c["harness_force"], rel=1e-9)
            assert c["harness_force"] == pytest.approx(-p.cable.stiffness * R * c["theta"], rel=1e-9)
            friction = 4 * p.drive.coulomb_friction / np.pi * c["drive_speed"] / abs(c["drive_speed"])
            drive = p.drive.inertia * s * c["drive_speed"]
            assert drive == pytest.approx(c["motor_torque"] - c["pin_torque"] - friction, rel=1e-9)
            assert cycle.mean["pin_torque"] == pytest.approx(-R * cycle.mean["harness_force"], rel=1e-9)
            assert cycle.mean["motor_torque"] == pytest.approx(cycle.mean["pin_torque"], rel=1e-9)

    @pytest.mark.slow
    def test_no_other_cycle_from_many_random_starts(self):
        from eppanalysis.methods.describing.balance import Balance, newton
        from eppanalysis.methods.describing.curves import distinct
        from eppanalysis.methods.describing.multi import choose_pivot, inner_newton, start_points, usual_amplitudes

        system = elbow(self.parameters())
        balance = Balance.of(system, choose_pivot(system), system.v0)
        draw = np.random.default_rng(1)
        places = np.stack([draw.uniform(-11, 0, 1500), draw.uniform(0, 7, 1500)], -1)
        biases = usual_amplitudes(balance) * draw.normal(size=(1500, balance.m))
        L = system.frequency_response(np.exp(places[:, 1]))[:, balance.rows, :]
        with np.errstate(all="ignore"):
            X, _, ok = inner_newton(balance, start_points(balance, places, L, biases, 1.0), L)
            X = X[ok]
            X[:, -1] = 0.0
            normal = np.zeros_like(X)
            normal[:, -1] = 1.0
            X, ok = newton(balance, X, normal, 50)
            X = distinct(balance, X[ok & (balance.largest_residual(X) < 1e-9)])
        want = sorted(c.omega for c in predict_limit_cycles(system))
        assert sorted(np.exp(X[:, 1])) == pytest.approx(want, rel=1e-9)


class TestMargins:
    def test_closed_form(self):
        """8/(s^3 + 2 s^2 + 2 s + 1) is -8/3 at omega = sqrt 2."""
        margins = predict_limit_cycles(LOOPS["saturation"][0]).margins
        assert margins["gain_margin"] == pytest.approx(3 / 8, rel=1e-6)
        assert margins["phase_crossover"] == pytest.approx(np.sqrt(2), rel=1e-6)

    def test_elements_without_a_finite_slope_say_so(self):
        margins = predict_limit_cycles(LOOPS["relay, third order"][0]).margins
        assert np.isnan(margins["gain_margin"]) and "leads through relay" in margins["message"]

    def test_elbow_oscillates_although_its_linear_loop_is_stable(self):
        margins = epp.margins(elbow(TestElbow.parameters())).numbers()
        assert margins["gain_margin"] > 2.0
        assert np.rad2deg(margins["phase_margin"]) > 30.0

    def test_a_clock_changes_nothing(self):
        timed = elbow(replace(TestElbow.parameters(), parking=Parking(0.02)))
        assert "clock" in timed.state_names
        assert epp.margins(timed).numbers() == pytest.approx(
            epp.margins(elbow(TestElbow.parameters())).numbers(), rel=1e-9
        )


class TestBadRequests:
    def test_unknown_input(self):
        with pytest.raises(ModelError, match="no input 'angle'; expected one of: harness_position"):
            predict_limit_cycles(elbow(epp.ElbowParameters()), {"angle": 1.0})

    def test_element_without_describing_function(self):
        with pytest.raises(ModelError, match="3 inputs; expected one and its rate"):
            predict_limit_cycles(of_unknown_response())

    @pytest.mark.parametrize("row", [1, 2])
    def test_inputs_that_are_not_what_the_describing_function_takes_them_for(self, row):
        loop = epp.case("two_mass_damped_shaft").to_system()
        C = loop.C.copy()
        C[row] *= -1.0
        with pytest.raises(ModelError, match="is not the (rate of its first|integral of its contact rate)"):
            predict_limit_cycles(epp.LureSystem.build(loop.A, loop.B, C, loop.elements))


class Wrapped(control.DescribingFunctionNonlinearity):
    """An element of ours for python-control."""

    def __init__(self, element):
        self.element = element

    def describing_function(self, A):
        return complex(self.element.describing_function(A)[1])

    def __call__(self, x):
        return float(self.element.output(x)[0])

    def _isstatic(self):
        return True


@pytest.mark.filterwarnings("ignore")
@pytest.mark.slow
class TestPythonControl:
    """What ``control.describing_function_response`` (0.10.2) answers to the same questions, beside our answers.

    If one of these fails after an update, python-control has changed: the verification page then needs the new answer.
    """

    @staticmethod
    def ask(plant, element, amplitudes) -> list[tuple[float, float]]:
        found = control.describing_function_response(plant, element, amplitudes, warn_nyquist=False).intersections
        return [(float(a), float(w)) for a, w in found]

    def test_pair_next_to_a_fold_is_lost(self):
        plant = control.tf([np.pi * (1 + 1e-6)], [1, 2, 1, 0])
        assert self.ask(plant, Wrapped(epp.RelayDeadZone(1.0)), np.linspace(1.0001, 5, 200)) == []
        assert len(answers(FOLDS["real gain"](1 + 1e-6))) == 2

    def test_cycles_are_invented_beyond_a_fold(self):
        plant = control.tf([PLAY_FOLD * (1 - 1e-6)], [1, 1, 0])
        invented = self.ask(plant, control.friction_backlash_nonlinearity(2.0), np.linspace(1.01, 5, 200))
        assert len(invented) == 4
        assert answers(FOLDS["complex gain"](1 - 1e-6)) == []

    def test_amplitudes_inside_the_gap_give_thousands_of_answers(self):
        element = control.friction_backlash_nonlinearity(2.0)
        found = self.ask(control.tf([5], [1, 1, 0]), element, np.linspace(0.1, 5, 20))
        assert len(found) > 1000
        assert sum(np.isfinite(a) for a, _ in found) == 1
        assert len(answers(LOOPS["play in a servo"][0])) == 2

    def test_one_cycle_is_found_twice(self):
        plant, element = control.tf([5], [1, 2, 1, 0]), Wrapped(epp.RelayDeadZone(1.0))
        found = control.describing_function_response(
            plant, element, np.linspace(1.001, 5, 10), np.geomspace(0.1, 10, 101), warn_nyquist=False
        ).intersections
        large = [a for a, _ in found if a == pytest.approx(3.0012, abs=1e-3)]
        assert len(large) >= 2
        assert len(answers(LOOPS["relay with dead zone"][0])) == 2

    def test_slow_units_end_in_a_traceback(self):
        t = 1e6
        plant = control.tf([8 / t**3], [1, 2 / t, 2 / t**2, 1 / t**3])
        with pytest.raises(IndexError):
            self.ask(plant, control.saturation_nonlinearity(1), np.linspace(1, 10, 50))
        system = from_tf(([8 / t**3], [1, 2 / t, 2 / t**2, 1 / t**3]), epp.Saturation())
        assert answers(system)[0][0] == pytest.approx(3.3439987302064953)

    def test_discrete_time_is_wrong(self):
        element = control.friction_backlash_nonlinearity(2.0)
        ((a, omega),) = self.ask(control.tf([0.4, -0.3], [1, -2, 1], 1.0), element, np.linspace(1.01, 5, 200))
        assert a > 1000 and omega < 1e-3
        assert answers(LOOPS["play, sampled, 0.3 and 0.1"][0])[0][0] == pytest.approx(1.8110958716515742)

    def test_dead_time_is_not_taken_and_its_approximation_invents_a_cycle(self):
        omega = np.geomspace(0.1, 100, 2000)
        measured = control.frd(np.exp(-0.5j * omega) / (1j * omega + 1), omega)
        with pytest.raises(ValueError, match="FRD"):
            control.describing_function_response(measured, Wrapped(epp.Relay()), np.linspace(0.01, 1, 100), omega)
        rational = control.tf([1], [1, 1]) * control.tf(*control.pade(0.5, 3))
        found = self.ask(rational, Wrapped(epp.Relay()), np.linspace(0.01, 1, 100))
        assert sorted(w for _, w in found) == pytest.approx([3.6742712, 31.413845], rel=1e-4)
        assert [f[1] for f in answers(LOOPS["relay, dead time"][0])] == pytest.approx([3.6731944063042516])

    def test_bias_of_an_asymmetric_element_is_dropped(self):
        element = control.saturation_nonlinearity(2.0, -0.5)
        ((a, _),) = self.ask(control.tf([8], THIRD_ORDER), element, np.linspace(0.6, 10, 50))
        # The exact fundamental is 3.3957 about a mean of -1.39.
        assert a == pytest.approx(4.102, abs=1e-3)
        assert answers(LOOPS["asymmetric saturation"][0])[0][0] == pytest.approx(2.798229231045058)


@pytest.mark.parametrize(("gain", "stable"), [(5.9, True), (6.1, False), (24.0, False)])
def test_a_disk_margin_is_for_loops_that_are_stable(gain: float, stable: bool) -> None:
    """By Routh, ``gain / (s (s + 1) (s + 2))`` closes stably up to a gain of 6."""
    loop = epp.LureSystem.from_tf(([gain], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    margins = predict_limit_cycles(loop).margins
    assert margins["gain_margin"] == pytest.approx(6.0 / gain, rel=1e-6)
    assert (margins["disk_margin"] > 0.0) == stable


def staircase(levels, reference, x0=(0.0, 0.0, 0.0)):
    """A quantised measurement of a position that is held at `reference`."""
    base = from_tf(([5.6], [1, 3, 2, 0]), epp.Quantiser(1.0, levels))
    return epp.LureSystem.build(
        base.A, base.B, base.C, base.elements, B_input=-base.B, input_names=("r",), v0=[reference], x0=x0
    )


@pytest.fixture(scope="module")
def few_levels():
    return predict_limit_cycles(staircase(6, 0.0))


@pytest.mark.parametrize(
    ("levels", "reference"), [(60, 3.0), (80, 3.0), pytest.param(300, -41.0, marks=pytest.mark.slow), (300, 0.0)]
)
def test_unused_levels_and_the_start_change_no_prediction(few_levels, levels, reference):
    """About any level the staircase is the same: the cycles about zero of a few levels, shifted."""
    few = few_levels
    for x0 in ((0.0, 0.0, 0.0), (0.3, 0.1, 2.0)):
        many = predict_limit_cycles(staircase(levels, reference, x0))
        assert many.status is Status.CONVERGED and len(many) == len(few) == 4
        for c, d in zip(few, many, strict=True):
            name = next(iter(c.mean))
            assert d.amplitude(name) == pytest.approx(c.amplitude(name), rel=1e-9)
            assert d.mean[name] == pytest.approx(reference, abs=1e-9)
            assert d.stable == c.stable and d.error_estimate == pytest.approx(c.error_estimate, rel=1e-6)


@pytest.mark.parametrize("reference", [0.3, 2.5, 2.8])
def test_cycles_between_levels_satisfy_the_balance_by_quadrature(reference):
    """Against sampled integrals of the map itself, on a grid of amplitudes with the mean from bisection."""
    phi = 2 * np.pi * (np.arange(4000) + 0.5) / 4000
    step = epp.Quantiser(1.0, 30)

    def sampled(a):
        low, high = reference - 1.0, reference + 1.0
        for _ in range(45):
            middle = 0.5 * (low + high)
            below = step.output(middle + a * np.sin(phi))[0].mean() < reference
            low, high = (middle, high) if below else (low, middle)
        return 2 * np.mean(step.output(middle + a * np.sin(phi))[0] * np.sin(phi)) / a * 5.6 / 6.0

    found = predict_limit_cycles(staircase(30, reference))
    a = np.geomspace(0.1, 15.0, 120)
    gain = np.array([sampled(v) for v in a])
    crossed = np.flatnonzero((gain[1:] < 1) != (gain[:-1] < 1))
    seen = [c.amplitude(next(iter(c.mean))) for c in found]
    assert all(any(a[i] <= v <= a[i + 1] for v in seen) for i in crossed)
    assert all(sampled(v) == pytest.approx(1.0, abs=1e-2) for v in seen)


@pytest.mark.parametrize(
    "plant", [[1.0, 0.0, 0.0], pytest.param([1.0, 2.0, 1.0, 0.0], marks=pytest.mark.slow)], ids=["pendulum", "damped"]
)
def test_an_element_that_turns_back_for_ever_is_covered_in_part_and_soon(plant):
    """The mean of a sine's output is zero at every multiple of pi and at every zero of a Bessel function."""
    begun = time.process_time()
    found = predict_limit_cycles(from_tf(([1.0], plant), epp.Sine(1.0)))
    assert time.process_time() - begun < 20.0
    assert found.status is Status.INCOMPLETE and "more solutions than can be followed" in found.search


def test_staircase_on_which_the_loop_may_stand_anywhere_is_said_to_be_covered_in_part():
    loop = from_tf(([6.0, -0.98], [1, 3, 3, 1]), epp.Quantiser(1.0, 40))
    found = predict_limit_cycles(loop)
    assert found.status is Status.INCOMPLETE and "may be missing" in found.search


def coupled(seed: int, size: float, other: str) -> epp.LureSystem:
    """Two elements without thresholds, each in the other's way, levels in any unit."""
    draw = np.random.default_rng(seed)
    A = -np.diag(draw.uniform(0.3, 2.0, 4)) + np.triu(draw.normal(size=(4, 4)), 1)
    A -= np.tril(draw.normal(size=(4, 4)), -1)
    A -= (max(0.0, np.linalg.eigvals(A).real.max()) + 0.1) * np.eye(4)
    B, C = 3.0 * draw.normal(size=(4, 2)), draw.normal(size=(2, 4))
    second = epp.Relay(-2.0 * size, 2.0 * size) if other == "relay" else epp.Preload(level=size, slope=0.5)
    return epp.LureSystem.build(A, B, C, [epp.Relay(-size, size), second])


@pytest.mark.parametrize("seed, other, size", [(0, "relay", 1e6), (3, "preload", 1e-6)])
def test_elements_without_thresholds_have_the_same_cycles_in_any_unit_of_amplitude(seed, other, size):
    """Levels times a number: amplitudes times the same number, frequencies and stability as they were."""
    here, there = (predict_limit_cycles(coupled(seed, s, other)) for s in (1.0, size))
    assert len(here) == len(there) == 2
    for one, two in zip(here, there, strict=True):
        assert two.omega == pytest.approx(one.omega, rel=1e-6) and two.stable == one.stable
        for name, amplitude in one.peak_to_peak.items():
            assert two.peak_to_peak[name] == pytest.approx(size * amplitude, rel=1e-6)


@pytest.mark.parametrize("levels", [(-1.0, 3.0), (-5.0, 1.0)])
def test_an_asymmetric_relay_behind_a_dead_time_is_predicted_at_one_frequency(levels: tuple[float, float]) -> None:
    """The mean of an integrator's relay vanishes: sin of its phase is -(low + high)/(high - low) quarters of a turn."""
    low, high = levels
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.0]), epp.Relay(low, high), delay=1.0)
    prediction = epp.predict_limit_cycles(loop)
    # Of an unbounded gain modes as fast as the dead time are left out.
    assert "frequencies from 0.000159 to 0.987 Hz" in prediction.search
    (cycle,) = prediction
    shift = np.sin(-0.5 * np.pi * (low + high) / (high - low))
    gain = 2.0 * (high - low) / np.pi * np.sqrt(1.0 - shift**2)
    assert cycle.omega == pytest.approx(0.5 * np.pi, rel=1e-12)
    assert cycle.amplitude("x") == pytest.approx(gain / cycle.omega, rel=1e-9)
    assert cycle.mean["x"] == pytest.approx(shift * cycle.amplitude("x"), rel=1e-9)
    # Exactly: it falls on for the dead time, rises as long as that takes, rises on, and falls as long as that takes.
    exact = epp.exact_orbit(loop, cycle)
    assert exact.period == pytest.approx(2.0 - low / high - high / low, rel=1e-9)


def test_what_a_grid_over_several_elements_may_miss_is_said():
    """On a finer grid two more cycles of the second loop are found, on one finer still neither."""
    of_two = epp.LureSystem.from_blocks([epp.Saturation(), ([8.0], [1, 1]), epp.Saturation(), ([1.0], [1, 3, 2])])
    for prediction in map(predict_limit_cycles, (of_two, random_loop(15))):
        assert "wholly between points of this grid may be missed" in prediction.search
        assert "Cycles between the points of its grid may be missed." in str(prediction)
    of_one = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    assert "grid" not in str(predict_limit_cycles(of_one))


def test_a_slow_cycle_that_grows_faster_than_it_turns_is_unstable() -> None:
    """A relay behind the unstable pole of 1/(2 s - 1) and a dead time of 0.5: where its gain N is one, a motion of
    slowly changing amplitude obeys 2 s = 1 - N (1 - s/2) and grows at (1 - N)/(2 - N/2), for N falls with amplitude.
    """
    loop = epp.LureSystem.from_tf(([1.0], [2.0, -1.0]), epp.HysteresisRelay(-0.05, 0.05), delay=0.5)
    (slowest,) = (c for c in epp.predict_limit_cycles(loop) if c.omega < 0.03)
    assert not slowest.stable
    for share, end in ((0.7, epp.Status.LIMIT_CYCLE), (1.1, epp.Status.DIVERGED)):
        x0 = [share * slowest.amplitude("x") / loop.C[0, 0]]
        assert epp.simulate(replace(loop, x0=np.array(x0)), t_end=60.0).status is end


def test_the_input_of_an_element_has_the_unit_of_the_signal_that_it_is() -> None:
    """Where other signals are its negative or its multiples, too."""
    for case in shipped().values():
        system = case.to_system()
        units = system.signals.units_by_name()
        for i, name in enumerate(system.element_names):
            told = units.get(f"{name}_in", units.get(f"{name}_input"))
            assert told is None or unit_at_input(system, i) == told, (case.name, name)


@pytest.mark.parametrize(
    "name", mostly_slow(["buck_converter", "sat_plus_backlash", "fig8a_original"], ["buck_converter"])
)
def test_numbers_on_the_axes_of_a_loop_gain_stand_apart(name) -> None:
    """Below a decade or two there are numbers between the powers of ten, which ran into each other."""
    figure = epp.predict_limit_cycles(epp.case(name)).plot().figure
    figure.draw_without_rendering()
    assert not list(touching(figure))


def test_cycles_about_a_jump_are_predicted_however_small_they_are_beside_the_threshold() -> None:
    # Positive feedback of 3/(s+1)^5 through three levels rests at 0 and at 3 and -3; between, the mean stands on a
    # jump. There five lags turn the phase by 360 degrees, and the loop swings by less than 1 % of the threshold.
    loop = epp.LureSystem.from_tf(([3.0], np.poly([-1.0] * 5)), epp.RelayDeadZone(threshold=1.0, level=1.0), feedback=1)
    omega, gain = np.tan(np.radians(72.0)), 3.0 * np.cos(np.radians(72.0)) ** 5

    def amplitude(share: float) -> float:
        """At which the describing function, with the threshold at this share of it above the mean, closes the loop."""
        return 2.0 * gain / np.pi * np.sqrt(1.0 - share**2)

    def mean_missed(share: float) -> float:
        return 1.0 - share * amplitude(share) - 3.0 * (0.5 - np.arcsin(share) / np.pi)

    share = scipy.optimize.brentq(mean_missed, 0.0, 1.0)
    cycles = epp.predict_limit_cycles(loop)
    assert [c.omega for c in cycles] == pytest.approx([omega, omega], rel=1e-9)
    assert [c.amplitude("x") for c in cycles] == pytest.approx([amplitude(share)] * 2, rel=1e-9)
    assert sorted(c.mean["x"] for c in cycles) == pytest.approx(
        [share * amplitude(share) - 1.0, 1.0 - share * amplitude(share)], rel=1e-9
    )
