"""Loops from python-control's systems and back, beside python-control's own responses and plain iterations."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError

OMEGA = np.array([0.05, 0.4, 1.0, 3.0, 40.0])
FRICTION = epp.Friction(0.5, static=0.8)


def motor(**names) -> control.StateSpace:
    given = {"inputs": ["voltage", "friction"], "outputs": ["angle", "speed"], "states": ["angle", "speed"]} | names
    return control.ss([[0, 1], [0, -1]], [[0, 0], [1, -1]], np.eye(2), 0, name="motor", **given)


def controller(output: str = "voltage") -> control.TransferFunction:
    return control.tf([4.0, 2.0], [1.0, 0.0], name="controller", inputs="error", outputs=output)


def servo(*parts, inputs=("reference", "friction")) -> control.InterconnectedSystem:
    difference = control.summing_junction(["reference", "-angle"], "error")
    return control.interconnect(
        [*(parts or (motor(), controller())), difference],
        inputs=list(inputs),
        outputs=["angle", "speed"],
        name="servo",
    )


def limiter() -> control.NonlinearIOSystem:
    clipped = lambda t, x, u, params: np.clip(u, -1.0, 1.0)  # noqa: E731
    return control.nlsys(None, clipped, inputs="wanted", outputs="voltage", name="limiter")


def limited() -> control.InterconnectedSystem:
    return servo(motor(inputs=["voltage", "load"]), limiter(), controller("wanted"), inputs=["reference", "load"])


def test_names_travel():
    loop = epp.from_control(servo(), {("speed", "friction"): FRICTION})
    assert loop.name == "servo" and loop.input_names == ("reference",) and loop.element_names == ("friction",)
    assert loop.signals.names == ("angle", "speed", "friction")
    assert loop.state_names == ("motor_angle", "motor_speed", "controller_x[0]")
    named = epp.from_control(
        servo(), {("speed", "friction"): FRICTION}, element_names=["bearing"], v0={"reference": 2.0},
        delays={"friction": 0.1}, x0=[1.0, 2.0, 3.0], name="mine"
    )  # fmt: skip
    assert named.element_names == ("bearing",) and named.name == "mine"
    assert (named.v0.tolist(), named.delays.tolist(), named.x0.tolist()) == ([2.0], [0.1], [1.0, 2.0, 3.0])


def test_responses_are_those_of_the_connected_system():
    system = servo()
    loop = epp.from_control(system, {("speed", "friction"): FRICTION})
    wanted = np.moveaxis(system(1j * OMEGA), -1, 0)
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 0, 0], wanted[:, 1, 1], rtol=1e-9)
    np.testing.assert_allclose(loop.signal_response(OMEGA)[:, :2, 0], wanted[:, :, 1], rtol=1e-9)


def test_one_name_is_an_output_and_an_input():
    plant = control.tf([2.0], [1.0, 1.0, 0.0], inputs="gear", outputs="gear", name="plant")
    loop = epp.from_control(plant, {"gear": epp.Play(0.2)})
    assert loop.signals.names == ("gear", "gear_output") and loop.element_names == ("gear",)
    want = 2.0 / (1j * OMEGA * (1j * OMEGA + 1.0))
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 0, 0], want, rtol=1e-12)


def test_element_with_two_inputs():
    """Two masses that a gear pin couples: deflection and rate in, one force out."""
    pin = epp.LockPin(gap=0.1, stiffness=50.0, damping=0.5)
    system = control.ss(
        [[0, 1, 0, 0], [0, -0.1, 0, 0], [0, 0, 0, 1], [0, 0, 0, -0.1]], [[0], [-1], [0], [2]],
        [[1, 0, -1, 0], [0, 1, 0, -1], [1, 0, 0, 0]], 0,
        inputs=["force"], outputs=["deflection", "rate", "position"],
    )  # fmt: skip
    loop = epp.from_control(system, {("deflection", "rate", "force"): pin}, x0=[0.0, 1.0, 0.0, 0.0])
    assert np.array_equal(loop.C, system.C[:2]) and np.array_equal(loop.B, system.B)
    with pytest.raises(
        ModelError, match=r"LockPin is at .*; expected 2 outputs of the system that feed it and the inp"
    ):
        epp.from_control(system, {("deflection", "force"): pin})


def test_interconnected_saturation_runs_as_python_control_integrates_it():
    system = servo(motor(), limiter(), controller("wanted"))
    loop = epp.from_control(system, {"limiter": control.saturation_nonlinearity(1.0)})
    t = np.linspace(0.0, 5.0, 501)
    run = epp.simulate(loop, {"reference": epp.inputs.Step(1.0)}, 5.0, t_eval=t)
    wanted = control.input_output_response(
        system,
        t,
        [np.ones_like(t), np.zeros_like(t)],
        solve_ivp_kwargs={"rtol": 1e-10, "atol": 1e-12, "max_step": 0.005},
    )
    for row, name in enumerate(("angle", "speed")):
        np.testing.assert_allclose(run.signals[name], wanted.outputs[row], atol=1e-6)
    assert loop.element_names == ("limiter",) and loop.input_names == ("reference", "friction")


def test_saturation_and_ports_of_an_interconnection_together():
    loop = epp.from_control(limited(), {("speed", "load"): FRICTION, "limiter": epp.Saturation()})
    assert loop.element_names == ("load", "limiter") and loop.input_names == ("reference",)
    assert loop.signals.names == ("angle", "speed", "limiter_wanted", "load", "limiter_voltage")
    s = 1j * OMEGA
    # From the limiter round to itself: the motor, and the controller with a minus.
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 1, 1], -(4 * s + 2) / (s**2 * (s + 1)), rtol=1e-12)


@pytest.mark.parametrize("step", [0.1, True])
def test_discrete_time_against_a_plain_iteration(step):
    A, B, C = [[1.0, 0.1], [0.0, 0.9]], [[0.0], [0.1]], [[-1.0, -0.5]]
    plant = control.ss(A, B, C, 0, step, inputs="u", outputs="y", name="plant")
    loop = epp.from_control(plant, {("y", "u"): epp.Saturation()}, x0=[4.0, 0.0])
    assert loop.time_step == float(step)
    run = epp.simulate(loop, t_end=60 * float(step))
    position, speed, wanted = 4.0, 0.0, []
    for _ in range(61):
        y = -position - 0.5 * speed
        u = max(-1.0, min(1.0, y))
        wanted.append((y, u))
        position, speed = position + 0.1 * speed, 0.9 * speed + 0.1 * u
    np.testing.assert_allclose(np.array([run.signals["y"], run.signals["u"]]).T, wanted, rtol=1e-12, atol=1e-14)


def test_transfer_functions_without_names():
    plant = control.tf([-5.0], [1.0, 1.0, 0.0])
    loop = epp.from_control(plant, {("y[0]", "u[0]"): epp.Play(2.0)})
    wanted = epp.predict_limit_cycles(epp.LureSystem.from_tf(-plant, epp.Play(2.0)))
    assert [c.omega for c in epp.predict_limit_cycles(loop)] == pytest.approx([c.omega for c in wanted], rel=1e-12)


TWICE = {("speed", "friction"): FRICTION, ("angle", "friction"): epp.Play(1.0)}


@pytest.mark.parametrize(
    ("elements", "sentence"),
    [
        ({("sped", "friction"): FRICTION}, r"servo has no output 'sped'; .*angle, speed \(did you mean 'speed'\?\)"),
        ({("speed", "fricton"): FRICTION}, r"no input 'fricton'; .*\(did you mean 'friction'\?\)"),
        ({"friction": FRICTION}, "servo has no output 'friction'; expected one of: angle, speed"),
        (TWICE, "'friction' is driven by two elements; expected one"),
        ({("angle", "speed", "friction"): FRICTION}, "Friction is at .*; expected the output .* and the input"),
        ({}, "servo: a loop needs at least one nonlinear element"),
    ],
)
def test_ports_that_cannot_be_are_refused(elements, sentence):
    with pytest.raises(ModelError, match=sentence):
        epp.from_control(servo(), elements)


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"v0": {"refrence": 1.0}}, r"v0 has 'refrence'; expected one of: reference \(did you mean 'reference'\?\)"),
        ({"delays": {"reference": 1.0}}, "delays has 'reference'; expected one of: friction"),
        ({"element_names": ["a", "b"]}, r"element_names is \['a', 'b'\]; expected 1, one for each element"),
        ({"x0": [1.0]}, "x0 has shape"),
    ],
)
def test_values_that_cannot_be_are_refused(more, sentence):
    with pytest.raises(ModelError, match=sentence):
        epp.from_control(servo(), {("speed", "friction"): FRICTION}, **more)


def test_nonlinear_subsystems_that_no_element_stands_for_are_refused():
    with pytest.raises(
        ModelError, match=r"'limiter' is nonlinear; expected an element .*elements=\{'limiter': \.\.\.\}"
    ):
        epp.from_control(limited(), {("speed", "load"): FRICTION})
    with pytest.raises(
        ModelError, match=r"'limiter' is nonlinear and gives 1 at 1\.\d+; expected 1\.\d+, as Saturation"
    ):
        epp.from_control(limited(), {"limiter": epp.Saturation(-1.0, 2.0)})
    with pytest.raises(ModelError, match="has no memory of its own, as Play has"):
        epp.from_control(limited(), {"limiter": epp.Play(1.0)})
    rate, output = (lambda t, x, u, params: u - x), (lambda t, x, u, params: np.sin(x))
    slow = control.nlsys(rate, output, states=1, inputs="wanted", outputs="voltage", name="limiter")
    system = servo(motor(), slow, controller("wanted"))
    with pytest.raises(
        ModelError, match="'limiter' is nonlinear, with 1 states, 1 inputs and 1 outputs; expected no states"
    ):
        epp.from_control(system, {"limiter": epp.Sine(1.0)})


def test_what_is_no_system_of_equations_is_refused():
    with pytest.raises(ModelError, match="is a FrequencyResponseData; expected a linear system, or an interconnection"):
        epp.from_control(control.frd([1.0, 0.5], [1.0, 2.0]), {("y[0]", "u[0]"): epp.Play(1.0)})
    two = control.tf([[[1.0], [1.0]]], [[[1.0, 1.0], [1.0, 2.0]]])
    with pytest.raises(ModelError, match="several inputs or outputs; expected control.ss of it"):
        epp.from_control(two, {("y[0]", "u[0]"): epp.Play(1.0)})
    with pytest.raises(epp.EppError, match="system is 3; expected an InputOutputSystem"):
        epp.from_control(3, {"a": epp.Play(1.0)})


def test_algebraic_loop_through_linear_subsystems_has_no_solution():
    gain = control.tf([1.0], [1.0], name="gain", inputs="e", outputs="y")
    total = control.summing_junction(["y", "w"], "e", name="total")
    square = control.nlsys(None, lambda t, x, u, params: u**3, inputs="y", outputs="w", name="cube")
    system = control.interconnect([gain, total, square], inputs=[], outputs=["y"], name="ring")
    with pytest.raises(ModelError, match="ring: an algebraic loop through its linear subsystems"):
        epp.from_control(system, {"cube": epp.Cube(1.0)})


ELEMENTS = [epp.Play(0.3), epp.Saturation(), epp.Relay(), FRICTION, epp.LockPin(gap=0.1, stiffness=10.0, damping=0.1)]


@st.composite
def loops(draw) -> epp.LureSystem:
    """Loops with one to three elements, external inputs, and signals of which some are the elements' own."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    elements = draw(st.lists(st.sampled_from(ELEMENTS), min_size=1, max_size=3))
    n, nv = draw(st.integers(1, 4)), draw(st.integers(0, 2))
    nz, nw = sum(e.n_inputs for e in elements), sum(e.n_outputs for e in elements)
    loop = epp.LureSystem.build(
        rng.normal(size=(n, n)), rng.normal(size=(n, nw)), rng.normal(size=(nz, n)), elements,
        D=np.tril(rng.normal(size=(nz, nw)), -2), B_input=rng.normal(size=(n, nv)), D_input=rng.normal(size=(nz, nv)),
        input_names=["v.1", "v.2"][:nv], time_step=draw(st.sampled_from([None, 0.25])), name="made",
    )  # fmt: skip
    if draw(st.booleans()):
        return loop
    shown = rng.permutation(len(loop.signals.names))[: rng.integers(1, len(loop.signals.names) + 1)]
    s = loop.signals
    signals = replace(
        s, names=tuple(f"s{i}" for i in range(len(shown))), C=s.C[shown], D=s.D[shown], D_input=s.D_input[shown],
        constant=s.constant[shown], units=("",) * len(shown),
    )  # fmt: skip
    return replace(loop, signals=signals)


@settings(deadline=None, max_examples=60)
@given(loops())
def test_a_loop_goes_to_python_control_and_back(loop):
    back = epp.from_control(loop.to_control(), loop.connections, element_names=loop.element_names)
    for part in (
        "A",
        "B",
        "C",
        "D",
        "B_input",
        "D_input",
        "elements",
        "element_names",
        "time_step",
        "state_names",
        "name",
    ):
        assert np.array_equal(getattr(back, part), getattr(loop, part)), part
    assert back.input_names == tuple(n.replace(".", "_") for n in loop.input_names)
    for i, name in enumerate(loop.signals.names):
        k = back.signals.names.index(name)
        for part in ("C", "D", "D_input", "constant"):
            assert np.array_equal(getattr(back.signals, part)[k], getattr(loop.signals, part)[i]), (name, part)


@pytest.mark.parametrize("name", ["relay_hyst_goncalves6", "sat_am165", "thruster_dz_hyst", "two_mass_deadzone"])
def test_a_shipped_loop_predicts_the_same_after_the_way_there_and_back(name):
    loop = epp.case(name).to_system()
    back = epp.from_control(loop.to_control(), loop.connections, element_names=loop.element_names)
    wanted, found = epp.predict_limit_cycles(loop), epp.predict_limit_cycles(back)
    assert len(wanted) == len(found)
    for one, other in zip(wanted, found, strict=True):
        assert other.omega == pytest.approx(one.omega, rel=1e-9)
        for signal, size in one.peak_to_peak.items():
            assert other.peak_to_peak[signal] == pytest.approx(size, rel=1e-9)


@pytest.mark.parametrize("at", ["controller.voltage", "controller", "motor.angle", "voltage"])
def test_margins_are_taken_at_signals_of_the_subsystems(at: str):
    """With a limit whose gain at rest is one, the loop is that of controller and motor, cut anywhere on its way."""
    plant, law = motor(inputs=["volts", "load"]), controller()
    system = control.interconnect(
        [plant, law, control.summing_junction(["reference", "-angle"], "error")],
        inputs=["reference", "volts", "load"], outputs=["angle", "speed", "voltage"], name="servo",
    )  # fmt: skip
    loop = epp.from_control(system, {("voltage", "volts"): epp.Saturation(-1.0, 1.0)})
    found = epp.margins(loop, at)
    want = control.margin(control.tf([4.0, 2.0], [1.0, 0.0]) * control.tf([1.0], [1.0, 1.0, 0.0]))
    assert found.phase_margin == pytest.approx(np.deg2rad(want[1]), rel=1e-6)
    again = epp.margins(epp.Case.from_system(loop), at)
    assert again.phase_margin == pytest.approx(found.phase_margin, rel=1e-12)


def test_a_friction_servo_has_margins_at_its_controller():
    loop = epp.from_control(servo(), {("speed", "friction"): FRICTION})
    assert "places of the loop: motor.angle, controller.voltage" in epp.margins(loop, "speed").message
    assert "controller.voltage" in epp.margins(loop).message
    want = control.margin(control.tf([4.0, 2.0], [1.0, 0.0]) * control.tf([1.0], [1.0, 1.0, 0.0]))
    assert epp.margins(loop, "controller").phase_margin == pytest.approx(np.deg2rad(want[1]), rel=1e-6)


@pytest.mark.parametrize("at", ["voltage", "error", "angle"])
def test_every_signal_of_an_interconnection_is_a_cut_by_its_own_name(at: str):
    """The signals of the one loop through controller and motor, none of which an element takes or gives."""
    loop = epp.from_control(servo(), {("speed", "friction"): FRICTION})
    gain, phase, _, crossover = control.margin(control.tf([4.0, 2.0], [1.0, 0.0]) * control.tf([1.0], [1.0, 1.0, 0.0]))
    for one in (loop, epp.Case.from_system(loop)):
        found = epp.margins(one, at)
        assert found.phase_margin == pytest.approx(np.deg2rad(phase), rel=1e-9)
        assert found.gain_margin == gain == np.inf and found.gain_crossover == pytest.approx(crossover, rel=1e-9)


def test_a_name_that_two_subsystems_give_is_no_cut_of_its_own():
    twice = control.tf([1.0], [1.0, 0.0], name="other", inputs="error", outputs="voltage")
    loop = epp.from_control(servo(motor(), controller(), twice), {("speed", "friction"): FRICTION})
    with pytest.raises(ModelError, match="no place 'voltage' to be cut at"):
        epp.margins(loop, "voltage")
    assert epp.margins(loop, "motor.voltage").exist and epp.margins(loop, "other.voltage").exist


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (control.tf([1.0], [1.0, 1.0]), "LureSystem.from_tf(system, Saturation(-1, 1))"),
        (motor(), "from_control(system, {('angle', 'voltage'): Saturation(-1, 1)})"),
        (
            control.frd(control.tf([1.0], [1.0, 1.0]), np.geomspace(0.1, 10.0, 20)),
            "MeasuredResponse.from_control(data)",
        ),
        (limiter(), "such as Saturation(-1, 1), or its points as PiecewiseLinear"),
        (control.saturation_nonlinearity(1.0), "LureSystem.from_tf(plant, element)"),
    ],
    ids=["tf", "ss", "frd", "nlsys", "element"],
)
def test_a_system_handed_to_an_analysis_is_answered_with_the_line_that_makes_a_loop(given, line: str):
    for analysis in (epp.predict_limit_cycles, epp.find_limit_cycles, epp.simulate):
        with pytest.raises(epp.EppError) as error:
            analysis(given)
        assert line in str(error.value) and str(error.value).count("\n") == 0


def test_linear_systems_and_elements_of_python_control_are_parts_of_a_diagram():
    parts = {
        "limit": control.saturation_nonlinearity(1.0),
        "law": controller(),
        "motor": motor(inputs=["volts", "load"]),
    }
    connect = ["ref - motor.angle -> law", "law -> limit", "limit -> motor.volts", "load -> motor.load"]
    made = epp.Diagram(parts, connect, inputs=["ref", "load"]).to_system()
    own = {"limit": epp.Saturation(-1.0, 1.0), "law": epp.blocks.PI(kp=4.0, ki=2.0)}
    same = epp.Diagram(parts | own, connect, inputs=["ref", "load"]).to_system()
    omega = np.geomspace(0.1, 10.0, 7)
    assert np.allclose(made.frequency_response(omega), same.frequency_response(omega), rtol=1e-12)
    one, other = (epp.simulate(loop, {"ref": epp.inputs.Step(1.0)}, 5.0) for loop in (made, same))
    assert np.allclose(one.signals["motor_angle"], other.signals["motor_angle"], atol=1e-9)
    for wrong in (limiter(), control.frd(controller(), omega), 3.0, "limit"):
        with pytest.raises(ModelError, match="diagram: law"):
            epp.Diagram(parts | {"law": wrong}, connect, inputs=["ref", "load"])


@pytest.mark.slow
def test_quotients_of_sympy_are_plants():
    import sympy
    from sympy.physics.control import TransferFunction

    s, k = sympy.Symbol("s"), sympy.Symbol("k")
    want = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    positive = sympy.Symbol("s", positive=True)
    for plant in (
        5 / (s**2 + s),
        5 / s / (s + 1),
        TransferFunction(5, s * (s + 1), s),
        5 / (positive * (positive + 1)),
    ):
        assert np.array_equal(epp.LureSystem.from_tf(plant, epp.Play(gap=2.0)).A, want.A)
    assert epp.margins(5 / (s * (s + 1))).phase_margin == epp.margins(control.tf([5.0], [1.0, 1.0, 0.0])).phase_margin
    for wrong in (k / s, sympy.exp(-s) / s, sympy.sqrt(s), 1 / (sympy.Symbol("z") - 1), TransferFunction(k, s, s)):
        with pytest.raises(ModelError, match="expected a quotient of polynomials of s with numbers in it"):
            epp.LureSystem.from_tf(wrong, epp.Play(gap=2.0))


@st.composite
def interconnections(draw):
    """A chain of subsystems with names of python-control's own, closed through one that an element stands for."""
    parts = []
    for _ in range(draw(st.integers(1, 3))):
        poles = draw(st.lists(st.floats(0.2, 3.0), min_size=1, max_size=2))
        part = control.tf([draw(st.floats(0.5, 2.0))], np.poly(-np.array(poles)))
        parts.append(control.ss(part) if draw(st.booleans()) else part)
    clipped = lambda t, x, u, params: np.clip(u, -1.0, 1.0)  # noqa: E731
    parts.insert(draw(st.integers(0, len(parts))), control.nlsys(None, clipped, inputs=1, outputs=1, name="limit"))
    wires = [
        [(i, 0), (i - 1, 0, 1 if i else -1)] if i else [(0, 0), (len(parts) - 1, 0, -1)] for i in range(len(parts))
    ]
    return control.interconnect(parts, connections=wires, inplist=[(0, 0)], outlist=[(len(parts) - 1, 0)])


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(interconnections())
def test_every_loop_of_python_control_is_a_case_and_reads_back(system):
    loop = epp.from_control(system, {"limit": epp.Saturation(-1.0, 1.0)})
    case = epp.Case.from_system(loop, name="mine")
    read = epp.case_from_text(case.to_toml()).to_system()
    assert (read.state_names, read.signals.names, read.input_names) == (
        loop.state_names, loop.signals.names, loop.input_names
    )  # fmt: skip
    np.testing.assert_array_equal(read.A, loop.A)
    assert case.with_values({"limit.upper": 2.0}).value("limit.upper") == 2.0
    for name in loop.cuts.names:  # cut anywhere on its one way, a loop answers alike
        at, here = epp.margins(loop, name), epp.margins(loop)
        assert at.phase_margin == pytest.approx(here.phase_margin, rel=1e-6, abs=1e-9)
        assert at.gain_margin == pytest.approx(here.gain_margin, rel=1e-6)


def test_elements_and_signals_with_indices_are_parameters_of_a_case():
    plant = control.ss([[0, 1], [0, -1]], [[0], [1]], [[-3, 0]], 0)
    loop = epp.from_control(plant, {("y[0]", "u[0]"): epp.Saturation(-1.0, 1.0)})
    case = epp.Case.from_system(loop, name="mine", signal="y[0]").with_values({"u[0].upper": 2.0})
    assert case.value("u[0].upper") == 2.0 and case.named_signals[0] == "y[0]"
    found = epp.sweep(case, {"u[0].upper": [1.0, 2.0]}, progress=False)
    assert found.sizes["u[0].upper"] == 2


@pytest.mark.parametrize("name", ["sys[3]$copy", "Ventil_öffnung", "μ", "my-motor", "Motor/Speed ref", "plant 1[0]"])
def test_names_that_python_control_gives_and_letters_of_any_alphabet_stand_in_a_case(name: str) -> None:
    limiter = control.nlsys(None, lambda t, x, u, params: np.clip(u, -1, 1), name=name, inputs="u", outputs="v")
    plant = control.ss([[0, 1], [0, -1]], [[0], [4]], [[-1, 0]], 0, inputs="v", outputs="u")
    loop = epp.from_control(control.interconnect([limiter, plant], outputs="u"), {name: epp.Saturation()})
    case = epp.Case.from_system(loop, name="mine", t_end=1.0).with_values({f"{name}.upper": 2.0})
    again = epp.case_from_text(case.to_toml(), "mine").to_system()
    assert again.element_names == (name,) and again.signals.names == loop.signals.names
    assert again.elements == (epp.Saturation(-1.0, 2.0),)
