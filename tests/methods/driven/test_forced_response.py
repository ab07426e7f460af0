"""Periodic responses to a sine: closed forms, an independent integrator, subharmonics, what does not repeat."""

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError
from tests.coordinates import rotated
from tests.driven_loops import TURN, duffing, loop, saturated


def steady(rate, omega, start, periods):
    """Half the peak-to-peak and the state at phase zero after many periods, by Runge-Kutta of order 8."""
    T = TURN / omega
    way = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12, "max_step": T / 40}
    before = solve_ivp(rate, (0.0, periods * T), start, **way)
    last = solve_ivp(rate, (0.0, T), before.y[:, -1], dense_output=True, **way)
    x = last.sol(np.linspace(0.0, T, 20_001))[0]
    return 0.5 * float(np.ptp(x)), before.y[:, -1]


def half(response, signal="mass"):
    return response.cycle.peak_to_peak[signal] / 2


@pytest.mark.parametrize(("omega", "amplitudes"), [(0.72, [0.995]), (0.80, [1.269, 1.821]), (0.96, [1.251])])
def test_stable_responses_of_the_saturated_spring_are_those_of_runge_kutta(omega, amplitudes):
    # Published to three digits, from a Runge-Kutta integration from below and from above.
    found = epp.forced_response(saturated(), amplitude=0.5, frequency=omega / TURN)
    assert [round(half(r), 3) for r in found.stable] == amplitudes
    assert len(found) == 2 * len(amplitudes) - 1, "between two stable responses an unstable one"


@pytest.mark.slow
def test_both_stable_responses_are_those_of_an_independent_integrator():
    omega = 0.8

    def rate(t, y):
        return [y[1], np.clip(0.5 * np.sin(omega * t) - y[0], -1.0, 1.0) - 0.2 * y[1]]

    found = epp.forced_response(saturated(), amplitude=0.5, frequency=omega / TURN)
    low = steady(rate, omega, [0.0, 0.0], 40)[0]
    high = steady(rate, omega, [0.0, -1.4], 40)[0]
    # Corners of the saturation lie within steps of the integrator: its error is that of a step across a corner.
    assert [half(r) for r in found.stable] == pytest.approx([low, high], rel=1e-5)


def test_an_unstable_response_closes_in_an_independent_integrator_with_its_multipliers():
    """The motion with its derivative, each piece of the saturation by itself: no step goes across a corner."""
    omega, T = 0.8, TURN / 0.8

    def pressed(t, y):
        return 0.5 * np.sin(omega * t) - y[0]

    def rate(t, y, side):
        P = y[2:].reshape(2, 2)
        force, slope = (pressed(t, y), -1.0) if side == 0 else (side, 0.0)
        return [y[1], force - 0.2 * y[1], *P[1], *(slope * P[0] - 0.2 * P[1])]

    def corners(side):
        """Where the spring's force reaches its limit or comes back from it."""
        ends = [lambda t, y, _, level=level: pressed(t, y) - level for level in ((-1, 1) if side == 0 else (side,))]
        for end, level in zip(ends, (-1, 1) if side == 0 else (side,), strict=True):
            end.terminal, end.direction = True, level if side == 0 else -side
        return ends

    def over(x):
        """After a period, with the derivative over the start."""
        t, y = 0.0, np.append(x, np.eye(2))
        side = int(np.fix(np.clip(pressed(t, y), -1.0, 1.0)))
        way = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": T / 50}
        while t < T:
            run = solve_ivp(rate, (t, T), y, args=(side,), events=corners(side), **way)
            t, y = run.t[-1], run.y[:, -1]
            side = 0 if side else int(np.sign(pressed(t, y)))
        return y[:2], y[2:].reshape(2, 2)

    unstable = next(r for r in epp.forced_response(saturated(), amplitude=0.5, frequency=omega / TURN) if not r.stable)
    system = saturated()
    T_state = np.array([system.signals.C[system.signals.names.index("mass")], [0.0, 0.0]])
    T_state[1] = T_state[0] @ system.A  # the rate of the mass, which nothing else acts on
    x = T_state @ unstable.cycle.state
    end, P = over(x)
    multipliers = np.sort(unstable.cycle.multipliers.real)
    # Each step is true to 1e-12, and what it is not grows until the end, by the larger multiplier at most.
    steps = 200 * max(1.0, multipliers[-1])
    assert end == pytest.approx(x, abs=steps * 1e-12)
    values, vectors = np.linalg.eig(P)
    error = np.linalg.cond(vectors) * steps * 1e-12 * np.abs(P).max()  # Bauer and Fike
    assert np.sort(values.real) == pytest.approx(multipliers, abs=error) and error < 1e-6
    # Liouville: their product is what damping alone makes of an area.
    assert np.prod(unstable.cycle.multipliers) == pytest.approx(np.exp(-0.2 * T), rel=1e-10)


def test_duffing_is_that_of_an_independent_integrator_and_near_first_order():
    omega, force = 1.5, 0.5
    found = epp.forced_response(duffing(), amplitude=force, frequency=omega / TURN)

    def rate(t, y):
        return [y[1], force * np.sin(omega * t) - 0.2 * y[1] - y[0] - y[0] ** 3]

    amplitude, state = steady(rate, omega, [0.0, 0.0], 80)
    on_it = min(found.stable, key=lambda r: abs(half(r) - amplitude))
    # Samples miss the extremum by up to (omega T / 20,000)^2 / 8 = 1e-8 of it.
    assert half(on_it) == pytest.approx(amplitude, rel=5e-8)
    assert on_it.cycle.waveform["mass"][0] == pytest.approx(state[0], abs=2e-3)
    # Closed form of first order: ((1 - w^2 + 3/4 a^2)^2 + (0.2 w)^2) a^2 = F^2.
    roots = np.roots([9 / 16, 1.5 * (1 - omega**2), (1 - omega**2) ** 2 + (0.2 * omega) ** 2, -(force**2)])
    sizes = np.sort(np.sqrt(roots[np.abs(roots.imag) < 1e-9].real))
    assert np.sort(force * np.abs(found.first_order["mass"])) == pytest.approx(sizes, rel=1e-9)
    exact = np.sort([force * abs(r.response("mass")) for r in found if r.multiple == 1])
    assert exact.size == sizes.size == 3
    assert exact == pytest.approx(sizes, rel=0.03), "its third harmonic is some per cent of the fundamental"


def test_a_smooth_element_sees_the_whole_sine_that_acts_on_its_input():
    """x + v into a cube: the amplitude was left out of what a smooth element sees of the sine."""
    omega, size = 1.3, 0.4
    system = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.5]], [[0.0], [-1.0]], [[1.0, 0.0]], [epp.Cube(1.5)],
        D_input=[[1.0]], input_names=["v"], element_names=["cube"],
    )  # fmt: skip

    def rate(t, y):
        return [y[1], -y[0] - 0.5 * y[1] - 1.5 * (y[0] + size * np.sin(omega * t)) ** 3]

    (response,) = epp.forced_response(system, amplitude=size, frequency=omega / TURN)
    end = solve_ivp(rate, (0.0, TURN / omega), response.cycle.state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    # Not begun elsewhere than at phase zero: no element switches there.
    assert response.phase == 0.0
    assert end == pytest.approx(response.cycle.state, abs=1e-10)


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(
    zeta=st.floats(0.05, 1.5),
    omega=st.floats(0.05, 20.0),
    amplitude=st.floats(1e-6, 0.05),
)
def test_within_the_linear_range_the_response_is_the_frequency_response(zeta, omega, amplitude):
    # 1/(s^2 + 2 zeta s + 1) in parallel with an unused dead zone: |x| <= amplitude/(2 zeta sqrt(1 - zeta^2)) < 1.
    system = loop(epp.DeadZone(lower=-1.0, upper=1.0), [1.0], [1.0, 2 * zeta, 1.0])
    found = epp.forced_response(system, amplitude=amplitude, frequency=omega / TURN)
    s = 1j * omega
    (one,) = found
    assert one.response("mass") == pytest.approx(1.0 / (s * s + 2 * zeta * s + 1.0), rel=1e-9)
    assert one.response("force") == pytest.approx(1.0, abs=1e-9)
    assert one.stable
    assert np.sort_complex(one.cycle.multipliers) == pytest.approx(
        np.sort_complex(np.exp(np.linalg.eigvals([[0.0, 1.0], [-1.0, -2 * zeta]]) * TURN / omega)), rel=1e-6, abs=1e-9
    )


def test_under_a_vanishing_sine_rest_stays_rest():
    system, T = duffing(), 4.0
    (one,) = epp.forced_response(system, amplitude=1e-12, frequency=1 / T)
    flow = np.linalg.eigvals(expm(T * np.array([[0.0, 1.0], [-1.0, -0.2]])))
    assert np.sort_complex(one.cycle.multipliers) == pytest.approx(np.sort_complex(flow), rel=1e-9)
    assert half(one) < 1e-11


def test_a_weak_sine_entrains_the_loop_s_own_oscillation_at_two_phases():
    # Averaged over a period the phase obeys d(phase)/dt = detuning - K sin(phase): one stable, one unstable, with
    # multipliers exp(-K T) and exp(K T), K proportional to the sine (Adler, Proceedings of the IRE 34, 1946).
    loop = epp.Diagram(
        parts={"relay": epp.Relay(), "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 2.0, 0.0])},
        connect=["force - plant -> relay", "relay -> plant"],
        inputs=["force"],
    )
    (own,) = epp.find_limit_cycles(loop)
    rates = []
    for amplitude in (2e-3, 1e-3):
        found = epp.forced_response(loop, amplitude=amplitude, frequency=own.frequency)
        assert [r.stable for r in sorted(found, key=lambda r: not r.stable)] == [True, False]
        rates.append(sorted(np.log(np.abs(r.cycle.multipliers).max()) for r in found))
        assert rates[-1][0] == pytest.approx(-rates[-1][1], rel=0.1)
    assert rates[0] == pytest.approx(2 * np.array(rates[1]), rel=0.1)


def test_a_subharmonic_is_found_beside_the_response_of_the_input_s_period():
    # A stiff cubic spring answers with a third of the input's frequency, too (Nayfeh and Mook, section 4.1.4).
    omega, force = 3.6, 4.0
    found = epp.forced_response(duffing(damping=0.05), amplitude=force, frequency=omega / TURN)

    def rate(t, y):
        return [y[1], force * np.sin(omega * t) - 0.05 * y[1] - y[0] - y[0] ** 3]

    assert [r.multiple for r in found.stable] == [1, 1, 3]
    for r in found.stable:
        names = duffing().signals
        C = names.C[names.names.index("mass")]
        x = np.array([C @ r.cycle.state, C @ duffing(damping=0.05).A @ r.cycle.state])
        T = r.multiple * TURN / omega
        end = solve_ivp(rate, (0.0, T), x, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        assert end == pytest.approx(x, abs=1e-7)


def test_elements_with_memory_and_jumps():
    # A relay straight on the input switches just at phase zero; behind it a lag of one second.
    system = epp.Diagram(
        parts={"relay": epp.Relay(), "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0])},
        connect=["force -> relay", "relay -> lag"],
        inputs=["force"],
    ).to_system()
    T = 3.0
    (one,) = epp.forced_response(system, amplitude=1.0, frequency=1 / T)
    assert half(one, "lag") == pytest.approx(np.tanh(T / 4), rel=1e-10)
    assert one.cycle.multipliers == pytest.approx([np.exp(-T)], rel=1e-9)
    w = TURN / T
    assert one.response("lag") == pytest.approx(4 / np.pi / (1 + 1j * w), rel=1e-9)


def stops(force, ratio, V, U, X):
    """Whether the mass stops on its way from X to -X, by the same closed form."""
    t = np.linspace(0.0, np.pi / ratio, 801)
    for sign in (1.0, -1.0):
        c, s = X, sign * 0.5 * U  # force V cos and sin of the input's phase at the turn
        x = (X - 0.5 - c) * np.cos(t) + ratio * s * np.sin(t) + 0.5 + c * np.cos(ratio * t) - s * np.sin(ratio * t)
        if abs(x[-1] + X) < 1e-9:
            return bool(np.any(np.diff(x) >= 0))
    raise AssertionError("the closed form does not close")


@settings(max_examples=5, deadline=None)
@given(ratio=st.floats(1.2, 3.0), force=st.floats(1.0, 5.0))
def test_dry_friction_is_den_hartog_s(ratio, force):
    # x'' + x + 0.5 sign(x') = force sin(ratio t), without stops above resonance (Den Hartog, Transactions of the ASME
    # 53, 1931): X^2 = (force V)^2 - (0.5 U)^2.
    system = epp.Diagram(
        parts={
            "friction": epp.Friction(coulomb=0.5, static=0.5),
            "mass": epp.blocks.Integrator(),
            "place": epp.blocks.Integrator(),
        },
        connect=["force - friction - place -> mass", "mass -> friction", "mass -> place"],
        inputs=["force"],
    ).to_system()
    V, U = 1 / (1 - ratio**2), np.sin(np.pi / ratio) / (ratio * (1 + np.cos(np.pi / ratio)))
    size = (force * V) ** 2 - (0.5 * U) ** 2
    assume(size > 0)
    assume(not stops(force, ratio, V, U, np.sqrt(size)))
    found = epp.forced_response(system, amplitude=force, frequency=ratio / TURN, most_periods=1)
    assert [half(r, "place") for r in found.stable] == pytest.approx([np.sqrt(size)], rel=1e-9)


@pytest.mark.slow
def test_a_play_that_stays_in_its_gap_is_one_of_a_continuum():
    system = epp.Diagram(
        parts={"gear": epp.Play(gap=1.0), "motor": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0])},
        connect=["force - gear -> motor", "motor -> gear"],
        inputs=["force"],
    ).to_system()
    found = epp.forced_response(system, amplitude=1.0, frequency=1.0, most_periods=1)
    assert all(r.one_of_many for r in found)
    # Of 1/(s (s + 1)) the amplitude is half the gap, 0.5, at 0.1989 Hz: above it the gear stands.
    response = epp.frequency_response(system, output="motor", amplitude=1.0, frequencies=(0.18, 0.3), max_step=0.1)
    (branch,) = response.branches
    assert not response.status.ok and "a continuum of responses, which is not followed, at" in response.message
    assert 0.196 < branch.frequency.max() < 0.1990


def test_an_integrator_that_nothing_drives_is_a_constant_and_makes_no_continuum():
    """A PID without an integral part holds what that part starts with: the response is that of a shifted setpoint."""
    kp, td, tf, offset = 2.0, 0.3, 0.05, 0.5

    def servo(controller):
        return epp.Diagram(
            parts={
                "controller": controller,
                "relay": epp.HysteresisRelay(-0.1, 0.1),
                "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 2.0, 1.0, 0.0]),
            },
            connect=["setpoint - plant -> controller", "controller -> relay", "relay -> plant"],
            inputs=["setpoint"],
        )

    sine = {"input": "setpoint", "amplitude": 3.0, "frequency": 0.2}
    pid = servo(epp.blocks.PID(kp=kp, td=td, tf=tf, start=[offset, 0.0]))
    (found,) = epp.forced_response(pid, **sine)
    filtered = epp.blocks.TransferFunction(num=[kp * (tf + td), kp], den=[tf, 1.0])
    (expected,) = epp.forced_response(servo(filtered), **sine, operating_point={"setpoint": offset / kp})
    assert not found.one_of_many and found.stable
    assert np.abs(found.cycle.multipliers) == pytest.approx(np.abs(expected.cycle.multipliers), abs=1e-9)
    assert found.response("plant") == pytest.approx(expected.response("plant"), rel=1e-9)
    assert found.cycle.state[0] == offset and found.cycle.state.size == pid.to_system().A.shape[0]


def test_a_run_that_grows_without_bound_is_said_to():
    """Beyond the dead zone 8/(s (s + 1)^2) under proportional control is unstable, and a sine of 1 leaves it."""
    servo = epp.Diagram(
        parts={
            "gap": epp.DeadZone(-0.1, 0.1),
            "plant": epp.blocks.TransferFunction(num=[8.0], den=[1.0, 2.0, 1.0, 0.0]),
        },
        connect=["setpoint - plant -> gap", "gap -> plant"],
        inputs=["setpoint"],
    )
    found = epp.forced_response(servo, "setpoint", amplitude=1.0, frequency=0.2)
    assert found.motion == "undecided" and "own start ends early, or grows beyond bounds." in found.message
    assert epp.simulate(servo, epp.inputs.Sine(1.0, 0.2), t_end=500.0).status.name == "DIVERGED"


@pytest.mark.parametrize("seed", [0, 1])
def test_turned_states_leave_a_response_the_one_that_it_is(seed):
    """What a position and a controller's constant are mixed with makes no response one of a continuum."""
    servo = epp.Diagram(
        parts={
            "controller": epp.blocks.PID(kp=3.3, td=0.582, tf=0.0167),
            "valve": epp.Preload(level=0.424, slope=1.38),
            "mass": epp.blocks.Mass(mass=2.02, damping=0.641, start=[1.7, 0.0]),
            "friction": epp.Friction(coulomb=0.156, static=0.2028),
        },
        connect=[
            "setpoint - mass.position -> controller",
            "controller -> valve",
            "valve - friction -> mass",
            "mass.speed -> friction",
        ],
        inputs=["setpoint"],
    ).to_system()
    (given,) = epp.forced_response(servo, "setpoint", amplitude=0.7, frequency=0.13)
    other = rotated(servo, seed)
    (turned,) = epp.forced_response(other, "setpoint", amplitude=0.7, frequency=0.13)
    assert not turned.one_of_many and turned.stable and given.stable
    assert half(turned, "mass_position") == pytest.approx(half(given, "mass_position"), rel=1e-9)
    # Its state is one of the turned loop: the signals there are those of the motion.
    at_start = other.signals.C @ turned.cycle.state
    place = other.signals.names.index("mass_position")
    assert at_start[place] == pytest.approx(turned.cycle.waveform["mass_position"][0], rel=1e-9)


def test_a_loop_with_an_oscillation_of_its_own_is_entrained_or_is_quasi_periodic():
    # A relay oscillates by itself: a strong sine near its frequency takes it along, a weak one far from it does not.
    system = epp.Diagram(
        parts={"relay": epp.Relay(), "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 2.0, 0.0])},
        connect=["force - plant -> relay", "relay -> plant"],
        inputs=["force"],
    ).to_system()
    own = 1 / 4.55107103
    taken = epp.forced_response(system, amplitude=0.3, frequency=1.05 * own)
    assert (taken.motion, taken.repeats) == ("periodic", 1)
    assert any(r.stable and r.multiple == 1 for r in taken)
    not_taken = epp.forced_response(system, amplitude=0.01, frequency=1.37 * own, most_periods=3)
    assert not_taken.motion == "quasi-periodic"
    assert "does not repeat itself" in not_taken.message
    assert abs(not_taken.exponent) < 0.02


def test_ueda_s_oscillator_is_irregular_and_its_unstable_responses_are_found():
    # x'' + 0.05 x' + x^3 = 7.5 cos t: the "Japanese attractor" (Ueda, Journal of Statistical Physics 20, 1979), whose
    # largest exponent is about 0.09 to 0.1 per second.
    found = epp.forced_response(duffing(damping=0.05, stiffness=0.0), amplitude=7.5, frequency=1 / TURN, most_periods=1)
    assert found.motion == "irregular"
    assert 0.08 < found.exponent / TURN < 0.12
    assert found.repeats == 0 and not found.stable and len(found) >= 1


def test_what_is_not_covered_is_said():
    system = saturated()
    with pytest.raises(EppError, match="amplitude is None; expected a positive number"):
        epp.forced_response(system, frequency=1.0)
    with pytest.raises(EppError, match=r"frequency is -1.0; expected a positive number \[Hz\]"):
        epp.forced_response(system, amplitude=1.0, frequency=-1.0)
    with pytest.raises(ModelError, match="no input 'forse'"):
        epp.forced_response(system, "forse", amplitude=1.0, frequency=1.0)
    with pytest.raises(EppError, match="has no external input"):
        epp.forced_response(epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Relay()), amplitude=1.0, frequency=1.0)


@pytest.mark.parametrize("stiffness", [0.0, 0.4])
def test_a_relay_that_breaks_friction_away_leaves_the_multipliers_as_they_are(stiffness):
    """The jump passes the friction's guard by a force, at its own instant: what is left of a disturbance after a period
    says so, in given and in turned states.
    """
    amplitude, frequency = 0.7, 0.13
    parts = {
        "controller": epp.blocks.LeadLag(gain=5.45, zero_time=0.3059, pole_time=0.0779),
        "relay": epp.HysteresisRelayDeadZone(on=0.123, off=0.0647, level=1.17),
        "mass": epp.blocks.Mass(mass=0.613, damping=0.537, start=[1.0, 0.0]),
        "friction": epp.Friction(coulomb=0.483, static=0.966),
        "spring": epp.blocks.Gain(gain=stiffness),
    }
    wires = [
        "setpoint - mass.position -> controller",
        "controller -> relay",
        "mass.position -> spring",
        "relay - friction - spring -> mass",
        "mass.speed -> friction",
    ]
    servo = epp.Diagram(parts, wires, inputs=["setpoint"]).to_system()
    (given,) = epp.forced_response(servo, "setpoint", amplitude=amplitude, frequency=frequency)
    sine, periods = epp.inputs.Sine(amplitude, frequency), np.array([2.0, 3.0, 40.0])
    run = epp.simulate(servo, sine, t_end=41.0 / frequency, t_eval=periods / frequency).signals["mass_position"]
    left = (run[1] - run[2]) / (run[0] - run[2])
    assert np.abs(left) == pytest.approx(np.abs(given.cycle.multipliers).max(), rel=0.05)
    for seed in (0, 1):
        (turned,) = epp.forced_response(rotated(servo, seed), "setpoint", amplitude=amplitude, frequency=frequency)
        assert np.abs(turned.cycle.multipliers) == pytest.approx(np.abs(given.cycle.multipliers), abs=1e-7)


def test_one_response_that_repeats_itself_every_second_period_is_not_some_of_several():
    """A sample each 0.1 s and a sine of 0.25 s: five samples are two periods."""
    plant = epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0])
    parts = {"law": epp.blocks.Gain(gain=2.0, sample_time=0.1), "valve": epp.Saturation(), "plant": plant}
    servo = epp.Diagram(parts, ["level - plant -> law", "law -> valve", "valve -> plant"], inputs=["level"])
    found = epp.forced_response(servo, amplitude=1.0, frequency=4.0)
    assert [r.multiple for r in found] == [2]
    assert "at level: 1 found, 1 stable, of 2 periods of the input. " in str(found)
