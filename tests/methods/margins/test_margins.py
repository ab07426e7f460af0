"""Margins against python-control on loops opened by hand, closed forms with dead time, and in any coordinates."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from tests.coordinates import in_coordinates, orthogonal
from tests.shared import mostly_slow, said_above

THIRD = ([1.0], [1.0, 3.0, 2.0, 0.0])


def saturation(plant: object, **options: object) -> epp.LureSystem:
    return epp.LureSystem.from_tf(plant, epp.Saturation(-1.0, 1.0), **options)


def control_margins(opened: control.StateSpace, found: epp.Margins) -> dict[str, float]:
    """Margins of a loop gain by python-control, the nearest of all, and its disk margin at a frequency of ours."""
    gains, phases, _, at_phase, at_gain, _ = control.stability_margins(opened, returnall=True)
    i, k = int(np.argmin(np.abs(np.log(gains)))), int(np.argmin(np.abs(phases)))
    disk = control.disk_margins(opened, np.array([found.disk_frequency]))[0]
    return {
        "gain_margin": gains[i],
        "phase_crossover": at_phase[i],
        "phase_margin": np.deg2rad(phases[k]),
        "gain_crossover": at_gain[k],
        "disk_margin": float(np.asarray(disk)),
    }


def agree(found: epp.Margins, opened: control.StateSpace) -> None:
    """Every number to 1e-9, and no frequency of a fine grid nearer to -1."""
    expected = control_margins(opened, found)
    if expected["gain_margin"] > 1e12:  # python-control's rounding of a response that comes near zero from one side
        assert found.gain_margin == np.inf
        del expected["gain_margin"], expected["phase_crossover"]
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-9, abs=1e-9), name
    fine = np.geomspace(0.2, 5.0, 4001) * found.gain_crossover
    assert float(np.asarray(control.disk_margins(opened, fine)[0])) >= found.disk_margin * (1.0 - 1e-9)


# The servo: 24 V motor, gear 50:1, shaft of 800 N m/rad, PI controller -------------------------------------
def servo(
    integral: float, order: list[int] | None = None, elements: list[int] | None = None, encoder: bool = True
) -> epp.LureSystem:
    """States: motor, motor speed, load, load speed, integral. The command is cut between controller and motor.

    `order` and `elements` are the orders in which states and elements stand.
    """
    p = np.arange(5) if order is None else np.array(order)
    q = np.arange(4) if elements is None else np.array(elements)
    A = np.zeros((5, 5))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 1], A[1, 4], A[3, 3] = -62.5, 25.0 * integral, -2.0
    B = np.array([[0, 0, 0, 0], [-20, -20, 0, -1000.0], [0, 0, 0, 0], [20, 0, -20, 0], [0, 0, 0, -1.0]])
    rows = np.array([[1, 0, -1, 0, 0], [0, 1, 0, -1, 0], [0, 1, 0, 0, 0], [0, 0, 0, 1, 0], [0, 0, 1, 0, 0]], float)
    gear, quantiser = epp.LockPin(np.deg2rad(0.1), 800.0, 1.5), epp.Quantiser(0.00153398, 2048)
    kinds = [gear, epp.Friction(0.3), epp.Friction(0.5), quantiser if encoder else epp.Saturation(-9.0, 9.0)]
    z_rows = [[0, 1], [2], [3], [4]]
    # The command u = 40 (0 - angle) + 100 integral moves the motor by 25 u, and nothing else.
    cuts = epp.Cuts(
        ("motor.command",),
        B=np.array([[0.0], [25.0], [0.0], [0.0], [0.0]])[p],
        E=np.zeros((5, 1)),
        C=np.array([[0.0, 0.0, 0.0, 0.0, integral]])[:, p],
        D=np.array([[0.0, 0.0, 0.0, -40.0]])[:, q],
    )
    return epp.LureSystem.build(
        A[np.ix_(p, p)],
        B[np.ix_(p, q)],
        rows[[row for i in q for row in z_rows[i]]][:, p],
        [kinds[i] for i in q],
        element_names=[["gear", "motor_friction", "load_friction", "encoder"][i] for i in q],
        principal=list(q).index(0),
        cuts=cuts,
        margins_at=["motor.command"],
        name="servo",
    )


def servo_by_hand(integral: float) -> control.StateSpace:
    """From the motor's command back to it: motor and load by a spring and damper, then the controller."""
    k, d = 800.0, 1.5
    A = [[0, 1, 0, 0], [-20 * k, -62.5 - 20 * d, 20 * k, 20 * d], [0, 0, 0, 1], [20 * k, 20 * d, -20 * k, -2 - 20 * d]]
    plant = control.ss(A, [[0], [25.0], [0], [0]], [[0, 0, 1, 0]], 0)
    controller = control.ss([[0.0]], [[1.0]], [[integral]], [[40.0]]) if integral else control.ss([], [], [], [[40.0]])
    return control.series(plant, controller)


@pytest.mark.parametrize(("integral", "gain", "phase"), [(0.0, 16.74, 65.8), (100.0, 16.33, 55.8)])
def test_the_servo_has_the_margins_of_its_data_sheet_at_the_command(integral: float, gain: float, phase: float) -> None:
    found = epp.margins(servo(integral))
    assert found.at == "motor.command" and found.stable and found.status is epp.Status.CONVERGED
    assert found.gain_margin == pytest.approx(gain, abs=0.005)
    assert np.rad2deg(found.phase_margin) == pytest.approx(phase, abs=0.05)
    agree(found, servo_by_hand(integral))
    assert "stable: gain margin" in str(found) and "cut at motor.command" in str(found)


def test_the_rule_says_which_gain_each_element_was_given() -> None:
    rule = epp.margins(servo(100.0)).rule
    assert rule[0] == "gear: 800, 1.5 (its stiffness and damping, in contact)."
    assert rule[1] == "motor_friction: 0 (left out: it slides)."
    assert rule[3] == "encoder: 1 (the mean slope of its steps)."


@settings(max_examples=12, deadline=None)
@given(st.permutations(range(5)), st.permutations(range(4)), st.integers(0, 1000), st.floats(-3.0, 3.0))
def test_they_do_not_depend_on_order_or_coordinates(order: list, elements: list, seed: int, decades: float) -> None:
    here = epp.margins(servo(100.0), ["motor.command", "encoder.in", "gear.out"])
    T = orthogonal(5, seed) * 10.0 ** (decades * np.linspace(-1.0, 1.0, 5)[:, None])
    there = epp.margins(in_coordinates(servo(100.0, order, elements), T), ["motor.command", "encoder.in", "gear.out"])
    for a, b in zip(here, there, strict=True):
        assert a.numbers() == pytest.approx(b.numbers(), rel=1e-7, nan_ok=True) and a.stable == b.stable


# Rational loops --------------------------------------------------
@settings(max_examples=25, deadline=None)
@given(st.integers(1, 10**6), st.integers(2, 6))
def test_random_loops_have_the_margins_of_python_control(seed: int, n: int) -> None:
    draw = np.random.default_rng(seed)
    A = draw.normal(size=(n, n)) - 2.0 * np.eye(n)
    b, c = draw.normal(size=(n, 1)), 2.0 * draw.normal(size=(1, n))
    plant = control.ss(A, b, c, 0.0)
    gains, phases = control.stability_margins(plant, returnall=True)[:2]
    found = epp.margins(epp.LureSystem.build(A, b, -c, [epp.Saturation(-1.0, 1.0)]))
    assert found.stable == bool(np.all(np.linalg.eigvals(A - b @ c).real < 0.0))
    positive = np.asarray(gains)[np.asarray(gains) > 0]
    nearest = positive[np.argmin(np.abs(np.log(positive)))] if positive.size else np.inf
    assert found.gain_margin == pytest.approx(nearest, rel=1e-6)
    nearest = np.deg2rad(phases[np.argmin(np.abs(phases))]) if len(phases) else np.inf
    assert found.phase_margin == pytest.approx(nearest, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("place", ["first.in", "first.out", "second.in", "second.out"])
def test_in_a_ring_every_place_has_the_same_margins(place: str) -> None:
    blocks = [epp.Saturation(-1.0, 1.0), ([2.0], [1.0, 1.0]), epp.DeadZone(-0.1, 0.1), ([1.0], [1.0, 2.0, 3.0])]
    ring = epp.LureSystem.from_blocks(blocks, element_names=["first", "second"])
    opened = control.series(control.tf([2.0], [1.0, 1.0]), control.tf([1.0], [1.0, 2.0, 3.0]))
    gain = control.stability_margins(opened)[0]
    assert epp.margins(ring, place).gain_margin == pytest.approx(gain, rel=1e-9)


def test_a_lightly_damped_resonance_is_not_missed() -> None:
    # A peak of 1e6 in a gain of 1e-3: only between its flanks the loop gain is above one.
    w, z = 37.0, 1e-7
    found = epp.margins(saturation(([1e-3 * w * w], [1.0, 2.0 * z * w, w * w])))
    opened = control.ss(control.tf([1e-3 * w * w], [1.0, 2.0 * z * w, w * w]))
    assert found.gain_crossover == pytest.approx(w, rel=1e-3)
    size = np.abs(opened(1j * found.gain_crossover))
    assert size == pytest.approx(1.0, rel=1e-6)


def test_a_loop_that_turns_over_at_rest_has_its_margin_at_frequency_zero() -> None:
    # Positive feedback: at twice the gain a real pole passes zero.
    found = epp.margins(saturation(([1.0], [1.0, 2.0]), feedback=1))
    assert found.gain_margin == pytest.approx(2.0, rel=1e-9) and found.phase_crossover == 0.0 and found.stable


def test_in_discrete_time_the_highest_frequency_counts() -> None:
    # x+ = 0.5 x - g x: at g = 1.5 the pole passes -1.
    loop = epp.LureSystem.build([[0.5]], [[1.0]], [[-1.0]], [epp.Saturation(-1.0, 1.0)], time_step=0.1)
    found = epp.margins(loop)
    assert found.gain_margin == pytest.approx(1.5, rel=1e-12)
    assert found.phase_crossover == pytest.approx(np.pi / 0.1) and found.stable
    late = epp.margins(replace(loop, delays=np.array([0.1])))
    # x+ = 0.5 x - g x(-1): z^2 - 0.5 z + g leaves the circle at g = 1.
    assert late.gain_margin == pytest.approx(1.0, rel=1e-9)


# Dead time --------------------------------------------------
@pytest.mark.parametrize(("gain", "delay"), [(0.5, 1.0), (1.5, 1.0), (1.6, 1.0), (3.0, 0.4), (5.0, 0.4)])
def test_an_integrator_with_dead_time_is_as_its_closed_form(gain: float, delay: float) -> None:
    found = epp.margins(saturation(([gain], [1.0, 0.0]), delay=delay))
    assert found.gain_margin == pytest.approx(np.pi / (2.0 * gain * delay), rel=1e-12)
    assert found.phase_crossover == pytest.approx(np.pi / (2.0 * delay), rel=1e-12)
    assert found.phase_margin == pytest.approx(np.pi / 2.0 - gain * delay, abs=1e-12)
    assert found.stable == (gain * delay < np.pi / 2.0)
    expected = (np.pi / 2.0 - gain * delay) / gain if found.stable else 0.0
    assert found.delay_margin == pytest.approx(expected, rel=1e-9)


def test_outputs_with_different_dead_times_keep_their_own() -> None:
    # Two integrators side by side, of 1 s and of 0.1 s dead time, on one input.
    loop = epp.LureSystem.build(
        np.zeros((2, 2)), np.eye(2), [[-0.6, -0.3], [-0.6, -0.3]], [epp.Saturation(-1.0, 1.0)] * 2,
        element_names=["slow", "quick"], delays=[1.0, 0.1],
    )  # fmt: skip
    found = epp.margins(loop, "slow.out")
    omega = found.gain_crossover
    a, b = (g * np.exp(-1j * omega * tau) / (1j * omega) for g, tau in ((0.6, 1.0), (0.3, 0.1)))
    assert abs(a / (1.0 + b)) == pytest.approx(1.0, rel=1e-12)
    assert found.phase_margin == pytest.approx(np.angle(-a / (1.0 + b)), rel=1e-9)
    assert found.stable


def test_dead_time_agrees_with_its_approximation_where_that_is_good() -> None:
    found = epp.margins(saturation(THIRD, delay=0.2))
    opened = control.series(control.tf(*THIRD), control.tf(*control.pade(0.2, 8)))
    gain, phase, at_phase, at_gain = control.margin(opened)
    assert found.gain_margin == pytest.approx(gain, rel=1e-6)
    assert found.phase_margin == pytest.approx(np.deg2rad(phase), rel=1e-6)
    assert (found.phase_crossover, found.gain_crossover) == pytest.approx((at_phase, at_gain), rel=1e-6)
    delayed = epp.margins(saturation(THIRD, delay=0.2 + 1.001 * found.delay_margin))
    assert not delayed.stable and epp.margins(saturation(THIRD, delay=0.2 + 0.999 * found.delay_margin)).stable


# Elements that no gain stands for --------------------------------------------------
def test_through_a_relay_there_are_no_margins_and_that_is_said() -> None:
    found = epp.margins(epp.LureSystem.from_tf(THIRD, epp.Relay()))
    assert np.isnan(found.gain_margin) and found.status is epp.Status.INCOMPLETE
    assert found.rule == ("relay: none (its output jumps, or its slope has no bound).",)
    assert "leads through relay" in found.message and str(found).startswith(
        "No margins at relay.out: the loop leads through relay, "
    )


@pytest.mark.parametrize("element", [epp.Tanh(level=0.3, slope=2.0), epp.Arctan(level=0.3, slope=2.0)])
def test_a_saturation_without_a_corner_has_the_margins_of_its_slope_at_zero(element: epp.Nonlinearity) -> None:
    found = epp.margins(epp.LureSystem.from_tf(THIRD, element))
    agree(found, 2.0 * control.tf2ss(*THIRD))
    assert found.stable and found.rule == (f"{element.kind}: 2 (its steepest slope).",)


def test_a_relay_aside_of_the_loop_leaves_its_margins() -> None:
    # The second state is moved by a relay on the first and seen by nobody.
    loop = epp.LureSystem.build(
        [[-1.0, 0.0], [0.0, -2.0]], np.eye(2), [[-3.0, 0.0], [1.0, 0.0]], [epp.Saturation(-1.0, 1.0), epp.Relay()]
    )
    for T in (np.eye(2), orthogonal(2, 3)):
        found = epp.margins(in_coordinates(loop, T), "saturation.out")
        assert found.phase_margin == pytest.approx(np.arccos(-1.0 / 3.0), rel=1e-9) and "relay" in found.message
        assert np.isnan(epp.margins(in_coordinates(loop, T), "relay.out").gain_margin)


# The public door --------------------------------------------------
def test_a_signal_that_is_taken_at_a_place_names_it() -> None:
    case = epp.case("azimuth_servo")
    assert epp.margins(case, "load").at == "load.angle"
    assert epp.margins(case, "twist").at == "gear.twist"
    with pytest.raises(
        epp.ModelError, match="cannot be cut at signal 'setpoint', .* no single place; expected one of controller.out"
    ):
        epp.margins(case, "setpoint")


def test_places_are_taken_where_nothing_is_said_and_refused_where_unknown() -> None:
    loop = servo(100.0)
    assert epp.margins(replace(loop, margins_at=())).at == "gear.out"
    assert [m.at for m in epp.margins(loop, ("encoder.out", "gear.in1"))] == ["encoder.out", "gear.in1"]
    with pytest.raises(epp.ModelError, match=r"servo has no place 'motor.comand' to be cut at; did you mean"):
        epp.margins(loop, "motor.comand")


def test_they_go_through_a_case_file() -> None:
    case = epp.Case.from_system(servo(100.0), "servo")
    again = epp.case_from_text(case.to_toml())
    assert again.to_system().places.names[0] == "motor.command"
    here, there = epp.margins(servo(100.0)), epp.margins(again)
    assert there.at == "motor.command" and there.numbers() == here.numbers()
    louder = epp.margins(again.with_values({"loop.gain": 1.0, "loop.margins_at": "encoder.out"}))
    assert louder.at == "encoder.out"
    with pytest.raises(epp.CaseError, match=r"margins_at is 'encoder.uot'; expected .* did you mean 'encoder.out'\?"):
        again.with_values({"loop.margins_at": "encoder.uot"})


def test_the_gain_of_a_case_goes_with_the_outputs_of_elements() -> None:
    loop = saturation(THIRD)
    cuts = epp.Cuts(("drive",), B=loop.B, E=loop.D, C=np.zeros((1, 3)), D=[[1.0]])
    case = epp.Case.from_system(replace(loop, cuts=cuts, margins_at=("drive",)), "drive")
    assert epp.margins(case).gain_margin == pytest.approx(6.0, rel=1e-9)
    assert epp.margins(case.with_values({"loop.gain": 2.0})).gain_margin == pytest.approx(3.0, rel=1e-9)


def test_their_table_frame_and_picture_name_the_cut() -> None:
    found = epp.margins(servo(100.0), ["motor.command", "encoder.out"])
    text = str(epp.table(found))
    assert "cut at motor.command" in text and "cut at encoder.out" in text and "mean slope" in text
    assert found[0].to_frame()["at"].tolist() == ["motor.command"]
    assert "cut at motor.command" in said_above(found[0].plot().figure)[1]


def test_a_dead_time_is_no_element_for_which_a_gain_would_stand() -> None:
    drawn = epp.Diagram(
        parts={
            "controller": epp.blocks.PI(kp=2.0, ti=5.0),
            "valve": epp.Saturation(lower=-1.0, upper=1.0),
            "plant": epp.blocks.LowPass(bandwidth=1.0),
            "pipe": epp.blocks.DeadTime(delay=0.1),
            "probe": epp.blocks.LowPass(bandwidth=20.0),
        },
        connect=[
            "setpoint - probe -> controller",
            "controller -> valve",
            "valve -> plant",
            "plant -> pipe",
            "pipe -> probe",
        ],
        inputs=["setpoint"],
        signals={"level": "plant"},
    )
    assert epp.margins(drawn.to_system()).rule == ("valve: 1 (its steepest slope).",)


def test_a_margin_without_a_crossover_is_said_to_be_infinite() -> None:
    said = str(epp.margins(saturation(([0.5], [1.0, 1.0]))))
    assert "gain margin infinite, phase margin infinite; disk margin" in said and "delay margin infinite;" in said


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.floats(0.01, 3.0))
def test_with_dead_time_they_do_not_depend_on_coordinates(seed: int, delay: float) -> None:
    loop = saturation(([2.0, 1.0], [1.0, 3.0, 2.5, 0.7]), delay=delay)
    here, there = epp.margins(loop), epp.margins(in_coordinates(loop, orthogonal(3, seed)))
    assert here.numbers() == pytest.approx(there.numbers(), rel=1e-7, nan_ok=True) and here.stable == there.stable
    # Dead time is phase: what is left of the margin is left of the phase.
    without = epp.margins(saturation(([2.0, 1.0], [1.0, 3.0, 2.5, 0.7])))
    expected = without.phase_margin - delay * without.gain_crossover
    assert here.phase_margin == pytest.approx(np.angle(np.exp(1j * expected)), abs=1e-9)
    assert here.stable == (expected > 0.0)


def test_long_dead_times_are_found_stable_or_not() -> None:
    # Half the gain with any dead time is stable, as the loop gain never reaches one.
    found = epp.margins(saturation(([0.5], [1.0, 1.0]), delay=50.0))
    assert found.stable and found.phase_margin == np.inf and found.delay_margin == np.inf
    # The first frequency at which 1/(1 + j w) exp(-50 j w) is negative: 50 w + atan w = pi.
    omega = found.phase_crossover
    assert 50.0 * omega + np.arctan(omega) == pytest.approx(np.pi, rel=1e-9)
    assert not epp.margins(saturation(([1.5], [1.0, 1.0]), delay=50.0)).stable


# The same servo drawn, cut at every port ------------------------------------------------------------------------------
PARTS = {
    "controller": (control.ss([[0.0]], [[1.0]], [[100.0]], [[40.0]]), ["in"], ["out"]),
    "motor": (
        control.ss([[0.0, 1.0], [0.0, -62.5]], [[0.0, 0.0], [25.0, 20.0]], np.eye(2), np.zeros((2, 2))),
        ["voltage", "torque"],
        ["angle", "speed"],
    ),
    "load": (
        control.ss([[0.0, 1.0], [0.0, -2.0]], [[0.0], [20.0]], np.eye(2), np.zeros((2, 1))),
        ["torque"],
        ["angle", "speed"],
    ),
    "gear": (control.ss([], [], [], [[800.0, 1.5]]), ["twist", "rate"], ["out"]),
    "encoder": (control.ss([], [], [], [[1.0]]), ["in"], ["out"]),
}
WIRES = {
    "controller.in": {"encoder.out": -1.0},
    "motor.voltage": {"controller.out": 1.0},
    "gear.twist": {"motor.angle": 1.0, "load.angle": -1.0},
    "gear.rate": {"motor.speed": 1.0, "load.speed": -1.0},
    "motor.torque": {"gear.out": -1.0},
    "load.torque": {"gear.out": 1.0},
    "encoder.in": {"load.angle": 1.0},
}


def opened_by_control(place: str) -> control.StateSpace:
    """Minus what comes back to a port of the servo from where it was cut, by python-control."""
    whole = control.append(*(part for part, _, _ in PARTS.values()))
    inputs = [f"{name}.{port}" for name, (_, ports, _) in PARTS.items() for port in ports]
    outputs = [f"{name}.{port}" for name, (_, _, ports) in PARTS.items() for port in ports]
    W = np.array([[WIRES[target].get(source, 0.0) for source in outputs] for target in inputs])
    if place in outputs:
        k = outputs.index(place)
        given, seen = W[:, [k]].copy(), np.eye(len(outputs))[[k]]
        W[:, k] = 0.0
    else:
        i = inputs.index(place)
        given, seen = np.eye(len(inputs))[:, [i]], W[[i]].copy()
        W[i] = 0.0
    before, around, behind = (control.ss([], [], [], D) for D in (given, W, -seen))
    return control.series(before, control.feedback(whole, around, sign=1), behind)


def drawn_servo(rng: np.random.Generator) -> epp.Case:
    """The servo that ships, without samples, its parts and connections in any order."""
    tables = tomllib.loads(epp.case("azimuth_servo").to_toml())
    del tables["blocks"]["controller"]["sample_time"]
    for section in ("blocks", "elements"):
        tables[section] = {name: tables[section][name] for name in rng.permutation(list(tables[section])).tolist()}
    tables["connect"] = rng.permutation(tables["connect"]).tolist()
    return epp.Case.from_tables(tables, name="servo")


@pytest.mark.parametrize("seed", mostly_slow(range(3), [0]))
@pytest.mark.parametrize("place", [*WIRES, "controller.out", "motor.angle", "gear.out", "load.angle", "encoder.out"])
def test_margins_of_a_drawn_servo_are_python_controls_at_every_port_in_any_order(place: str, seed: int) -> None:
    found = epp.margins(drawn_servo(np.random.default_rng(seed)), place)
    assert found.at == place
    agree(found, opened_by_control(place))


def driven(load: float, **drives: epp.Nonlinearity) -> epp.LureSystem:
    """A mass with drag whose position some drives control together, against a constant load."""
    mass = epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0])
    parts = {"load": epp.blocks.Constant(value=load), "mass": mass}
    connect = [f"-mass -> {name}" for name in drives]
    return epp.Diagram(drives | parts, [*connect, f"{' + '.join(drives)} - load -> mass"]).to_system()


@pytest.mark.parametrize("turned", [False, True])
def test_a_loop_that_stands_nowhere_has_no_margins(turned):
    """Drives of 1 and 0.5 hold up to 1.5 together; what a ramp takes along without end nothing holds."""
    main, helper = epp.Saturation(-1.0, 1.0), epp.Saturation(-0.5, 0.5)
    ramp = epp.LureSystem.build([[0, 0], [0, -1.0]], [[0], [-1.0]], [[1.0, 1.0]], [main], constant_state=[1.0, 0.0])
    for loop, why in (
        (driven(1.2, main=main), "main would have to give 1.2, and gives -1 to 1"),
        (driven(1.7, main=main, helper=helper), "main and helper cannot together give"),
        (ramp, "nothing holds what drives it"),
    ):
        loop = in_coordinates(loop, orthogonal(len(loop.A), 3)) if turned else loop
        found = epp.margins(loop)
        assert not found.exist and found.stable is None and found.status is epp.Status.INCOMPLETE
        assert str(found).startswith("No margins at ") and why in str(found)
        assert why in str(epp.predict_limit_cycles(loop)) and "margin" not in str(epp.predict_limit_cycles(loop))
    for loop in (driven(0.9, main=main), driven(1.4, main=main, helper=helper)):
        assert epp.margins(loop).exist and epp.predict_limit_cycles(loop).warnings == ()


def test_margins_are_those_of_the_inputs_that_a_prediction_holds():
    """Held where the drive gives enough there are margins, and above that none."""
    parts = {"drive": epp.Saturation(), "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0])}
    loop = epp.Diagram(parts, ["-mass -> drive", "drive - load -> mass"], inputs={"load": 2.0}).to_system()
    assert "margin" not in str(epp.predict_limit_cycles(loop)) and not epp.margins(loop).exist
    held = epp.predict_limit_cycles(loop, {"load": 0.5})
    assert held.margins["stable"] and "gain margin of the linearised loop is infinite" in str(held)


def test_what_hands_on_a_late_input_is_no_place():
    """A diagram's loop is cut at ports of its parts, and names no other."""
    parts = {
        "valve": epp.Saturation(),
        "oven": epp.blocks.TransferFunction(num=[20.0], den=[600.0, 1.0], delay=15.0),
        "sensor": epp.blocks.LowPass(bandwidth=0.1),
    }
    wires = ["-sensor -> valve", "valve + load -> oven", "oven -> sensor"]
    loop = epp.Diagram(parts, wires, inputs={"load": 0.0}).to_system()
    assert len(loop.elements) == 2
    assert {name.partition(".")[0] for name in loop.places.names} == set(parts)
    with pytest.raises(epp.ModelError, match="its places are valve.out, oven.out, sensor.out, valve.in, oven.in"):
        epp.margins(loop, "nowhere")
    whole, part = epp.margins(loop), epp.margins(loop, "oven.in")
    assert part.gain_margin == pytest.approx(whole.gain_margin, rel=1e-9)


def test_what_is_not_decided_is_no_number_and_zero_has_no_sign() -> None:
    """Two integrators without damping: on the border, with no phase to lose."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 0.0, 0.0]), epp.Play(gap=2.0))
    said = str(epp.margins(loop))
    assert "phase margin 0 deg at 2.236 rad/s" in said and "delay margin not decided" in said and "nan" not in said
