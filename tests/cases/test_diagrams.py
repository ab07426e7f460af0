"""Case files of diagrams: named parameters, expressions, and the same loop as from Python."""

import math

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cases.command_line import Commands
from eppanalysis.cases.files import shipped_cases_folder
from eppanalysis.models.diagrams.blocks import PI, Inertia, Motor
from eppanalysis.units import parse_quantity

SERVO = [
    "setpoint - encoder -> controller",
    "controller -> motor.voltage",
    "motor.angle - load.angle -> gear.twist",
    "motor.speed - load.speed -> gear.rate",
    "-gear - motor_friction -> motor.torque",
    "gear - load_friction -> load",
    "motor.speed -> motor_friction",
    "load.speed -> load_friction",
    "load.angle -> encoder",
]


def _servo_in_python():
    return epp.Diagram(
        parts={
            "controller": PI(kp=40.0, ti=0.4, sample_time=1e-3),
            "motor": Motor(resistance=2.0, torque_constant=0.05, inertia=2e-5, ratio=50.0),
            "load": Inertia(inertia=0.05, damping=0.1),
            "gear": epp.LockPin(gap=math.radians(0.1), stiffness=800.0, damping=1.5),
            "motor_friction": epp.Friction(coulomb=0.3),
            "load_friction": epp.Friction(coulomb=0.5, static=0.7),
            "encoder": epp.Quantiser(step=2 * math.pi / 2**12, levels=2048),
        },
        connect=SERVO,
        inputs=["setpoint"],
        signals={"load": "load.angle", "twist": "motor.angle - load.angle"},
        name="azimuth_servo",
    ).to_system()


def test_the_servo_of_a_file_and_that_of_python_are_the_same_to_the_last_bit():
    case, loop = epp.case("azimuth_servo"), _servo_in_python()
    times = np.linspace(0.0, 0.3, 301)
    one = epp.simulate(case, t_end=0.3, t_eval=times)
    other = epp.simulate(loop, epp.inputs.Step(0.05), t_end=0.3, t_eval=times)
    assert set(one.signals) == set(other.signals)
    for name, values in one.signals.items():
        assert np.array_equal(values, other.signals[name]), name


RING = """
kind = "diagram"
title = "Ring"
connect = ["demand - plant -> valve", "valve -> plant"]
inputs = { demand = "0 m" }
[parameters]
K = { value = 3.0, tolerance = "10 %", mark = "tunable" }
T = "500 ms"
limit = "2*K/3"
[blocks]
plant = { kind = "transfer_function", num = ["K"], den = ["T^2", "2*T", 1, 0], start = [0.1, 0, 0] }
[elements]
valve = { element = "saturation", lower = "-limit", upper = "limit" }
[run]
t_end = "5 s"
[expected]
signal = "plant"
"""


def test_a_parameter_moves_all_that_is_made_of_it():
    case = epp.case_from_text(RING)
    assert case.value("K") == 3.0 and case.value("T") == 0.5 and case.value("limit") == 2.0
    assert case.parameters["K"].tolerance == pytest.approx(0.3)
    valve = case.with_values({"K": 6.0}).to_system().elements[0]
    assert (valve.lower, valve.upper) == (-4.0, 4.0)
    plant = case.with_values({"T": "250 ms"}).to_system()
    expected = 3.0 / (1j * (1.0 + 0.25j) ** 2)
    assert abs(plant.frequency_response(1.0)[0, 0] + expected) < 1e-12


def test_a_field_of_a_part_is_set_by_its_name():
    case = epp.case_from_text(RING).with_values({"valve.upper": 0.5, "plant.delay": "10 ms"})
    loop = case.to_system()
    assert loop.elements[0].upper == 0.5 and case.value("valve.upper") == 0.5
    assert loop.delays.tolist() == [0.01]


def test_what_is_written_reads_back_to_the_same_loop():
    case = epp.case_from_text(RING)
    again = epp.case_from_text(case.to_toml())
    for name in ("A", "B", "C", "D"):
        assert np.array_equal(getattr(case.to_system(), name), getattr(again.to_system(), name))


def test_a_case_of_tables_is_that_of_a_file():
    import tomllib

    one, other = epp.Case.from_tables(tomllib.loads(RING), name="ring"), epp.case_from_text(RING, name="ring")
    assert one.provenance()["sha256"] == other.provenance()["sha256"]


def test_the_analyses_take_a_diagram_and_its_parameters():
    case = epp.case_from_text(RING).with_values({"K": 8.0})
    predicted = epp.predict_limit_cycles(case).cycles
    assert len(predicted) == 1
    # Saturation of +-16/3 with slope one: N(A) = 1/(K times the plant's gain at its phase crossover, w = 1/T).
    assert predicted[0].omega == pytest.approx(2.0, rel=1e-9)
    branch = epp.continue_branch(case, "T", "500 ms", "700 ms")
    assert branch.status is epp.Status.CONVERGED
    assert (min(branch.points["value"]), max(branch.points["value"])) == pytest.approx((0.5, 0.7))
    grid = epp.sweep(case, {"K": [7.0, 8.0], "T": [0.4, 0.5]})
    assert grid.sizes["K"] == 2 and grid.sizes["T"] == 2


MISTAKES = [
    ('"demand - plant -> valve"', '"demand - 2*plant -> valve"', "connect.0", "a block of kind gain for a factor"),
    (
        'kind = "transfer_function"',
        'kind = "Transfer_Function"',
        "blocks.plant.kind",
        "did you mean 'transfer_function'",
    ),
    ("num = [", "Num = [", "blocks.plant.Num", "did you mean 'num'"),
    ("start = [0.1, 0, 0]", 'dead_time = "5 m"', "blocks.plant.dead_time", "a time such as"),
    ('element = "saturation"', 'element = "saturate"', "elements.valve.element", "did you mean 'saturation'"),
    ('upper = "limit"', 'limit = "limit"', "elements.valve.limit", "'limit'; expected a field of saturation: did you"),
    ('kind = "transfer_function"', 'element = "relay"', "blocks.plant.kind", "which belongs in [elements]"),
    (
        'element = "saturation"',
        'element = "saturation", kind = "saturation"',
        "elements.valve.kind",
        "either element or kind, which mean the same",
    ),
    ('element = "saturation"', 'kind = "gain"', "elements.valve.kind", "which belongs in [blocks]"),
    (
        'upper = "limit"',
        'upper = "limit", memory = 1',
        "elements.valve.memory",
        "none, as saturation remembers nothing",
    ),
    ("[run]", '[signals]\ny = { of = "plant", units = "m" }\n[run]', "signals.y.units", "did you mean 'unit'"),
    ('"demand - plant -> valve"', '"demand - plnt -> valve"', "connect.0", "did you mean 'plant'"),
    ('"valve -> plant"', '"valve -> plant.input"', "connect.1", "did you mean 'plant.in'"),
    (', "valve -> plant"]', "]", "connect", "a connection to plant.in"),
    ('"valve -> plant"', '"valve -> plant", "demand -> plant"', "connect.2", "add the two in one sum"),
    ('"valve -> plant"', '"valve plant"', "connect.1", "a connection such as"),
    ('limit = "2*K/3"', 'limit = "2*K + T"', "parameters.limit", "one unit"),
    ('limit = "2*K/3"', 'limit = "2*k/3"', "parameters.limit", "did you mean 'K'"),
    (
        'K = { value = 3.0, tolerance = "10 %", mark = "tunable" }',
        'K = "limit"',
        "parameters.K",
        "which uses K",
    ),
    (
        'kind = "transfer_function"',
        'kind = "transfer_funktion"',
        "blocks.plant.kind",
        "did you mean 'transfer_function'",
    ),
    ("start =", "starts =", "blocks.plant.starts", "did you mean 'start'"),
    ('num = ["K"], ', "", "blocks.plant.num", "a value: transfer_function needs it"),
    ('num = ["K"]', "num = [1, 2, 3, 4, 5]", "blocks.plant.num", "at most the degree of the denominator"),
    ("start = [0.1, 0, 0]", 'delay = "3 m"', "blocks.plant.delay", "a time such as"),
    ("start = [0.1, 0, 0]", 'computation_delay = "1 ms"', "blocks.plant.computation_delay", "no sample_time"),
    ("start = [0.1, 0, 0]", 'sample_time = "0 ms"', "blocks.plant.sample_time", "a positive number"),
    ('element = "saturation"', 'element = "saturaton"', "elements.valve.element", "did you mean 'saturation'"),
    ('upper = "limit"', 'uper = "limit"', "elements.valve.uper", "did you mean 'upper'"),
    ('inputs = { demand = "0 m" }', 'inputs = ["valve"]', "inputs.valve", "another name: elements.valve has it"),
    ('inputs = { demand = "0 m" }', 'inputs = ["demand", "demand"]', "inputs", "names that differ"),
    ('inputs = { demand = "0 m" }', 'inputs = "demand"', "inputs", "a list of names, or a table"),
    ('inputs = { demand = "0 m" }', 'inputs = { "de mand" = "0 m" }', "inputs.de mand", "a plain name of letters"),
    ('inputs = { demand = "0 m" }', 'inputs = { demand = "0 m", load = "0 N" }', "inputs.load", "load drives nothing"),
    ("[blocks]", '[blocks]\nvalve = { kind = "gain" }', "elements.valve", "blocks.valve has it already"),
    ("[blocks]", '[blocks]\n"my plant" = { kind = "gain" }', "blocks.my plant", "a plain name of letters"),
    ("[blocks]", '[blocks]\nspare = { kind = "gain" }', "connect", "a connection to spare.in, '0 -> spare.in'"),
    ('T = "500 ms"', 'sqrt = "500 ms"', "parameters.sqrt", "a name that is no function or constant of expressions"),
    ('T = "500 ms"', 'T = "500 apples"', "parameters.T", "a known unit in place of 'apples'"),
    ('limit = "2*K/3"', 'limit = "2/(K-3)"', "parameters.limit", "a divisor that is not zero: K-3 is 0"),
    ('limit = "2*K/3"', 'limit = "sin(T)"', "parameters.limit", "a plain number or an angle: sin(T) has s"),
    ('tolerance = "10 %"', 'tolerance = "10 s"', "parameters.K.tolerance", "a tolerance in per cent"),
    ('mark = "tunable"', 'mark = "tuneable"', "parameters.K.mark", "one of paper, derived"),
    ('"demand - plant -> valve"', '"demand - 2*plant -> valve"', "connect.0", "a signed sum of ports"),
    ('"demand - plant -> valve"', '"demand - plant -> demand"', "connect.0", "one of plant, valve"),
    ('["demand - plant -> valve", "valve -> plant"]', '"demand - plant -> valve"', "connect", "a list"),
    ('num = ["K"]', 'num = "K"', "blocks.plant.num", "a list of numbers"),
    ('num = ["K"]', 'num = [["K"]]', "blocks.plant.num", "a list of numbers"),
    ('num = ["K"]', "num = []", "blocks.plant.num", "at least one coefficient"),
    ('den = ["T^2", "2*T", 1, 0]', "den = [0, 0]", "blocks.plant.den", "a coefficient other than zero"),
    ('den = ["T^2", "2*T", 1, 0]', "den = [1e-320, 1]", "blocks.plant", "from 1e-50 to 1e+50 in size"),
    ("start = [0.1, 0, 0]", 'discretisation = "tustin"', "blocks.plant.discretisation", "no sample_time"),
    ("start = [0.1, 0, 0]", 'sample_time = "T - 0.5"', "blocks.plant.sample_time", "two of one unit"),
    (
        "start = [0.1, 0, 0]",
        'delay = "1 ms", sample_time = "1 ms"',
        "blocks.plant.delay",
        "zero where it is sampled",
    ),
    ('element = "saturation", ', "", "elements.valve.kind", "a known element: one of"),
    ('upper = "limit"', 'upper = "-2*limit"', "elements.valve.upper", "more than lower (-limit): -2*limit is -4"),
    ("[elements]", '[elements]\n"a valve" = 3', "elements.a valve", "a plain name of letters"),
    ('kind = "diagram"', 'kind = "diagramm"', "kind", "'diagram'"),
    ('kind = "diagram"\n', "", "kind", "'diagram', as the file has connections"),
    ("[run]", '[signals]\na = "plan"\n[run]', "signals.a", "did you mean"),
    ("[run]", '[signals]\na = { unit = "m" }\n[run]', "signals.a.of", "a value"),
    ("[run]", '[signals]\na = { of = "plant -" }\n[run]', "signals.a.of", "a signed sum of ports"),
    ("[run]", "[signals]\na = 3\n[run]", "signals.a", "a signed sum of ports"),
    ('signal = "plant"', 'signal = "plont"', "expected.signal", "one of"),
    ('t_end = "5 s"', 't_end = "5 m"', "run.t_end", "a time"),
    ("[expected]", 'inputs = { dmand = { kind = "step", size = "1 m" } }\n[expected]', "run.inputs.dmand", "demand"),
    ("[expected]", 'input = { kind = "stepp", size = "1 m" }\n[expected]', "run.input.kind", "'step'"),
    ("[expected]", 'input = { kind = "ramp", rate = "1 m" }\n[expected]', "run.input.rate", "a quantity in m/s"),
    ("[expected]", 'input = { kind = "step", siz = "1 m" }\n[expected]', "run.input.siz", "did you mean 'size'"),
    ("[expected]", 'input = { demand = { kind = "step", size = "1 m" } }\n[expected]', "run.input", "run.inputs"),
]

#: The same for the servo that ships: of machines, controllers, sampling and elements with units.
SERVO_MISTAKES = [
    ('inertia = "2e-5 kg*m^2"', 'inertia = "-2e-5 kg*m^2"', "blocks.motor.inertia", "a positive number"),
    ('inertia = "2e-5 kg*m^2"', 'inertia = "2e-5 kg"', "blocks.motor.inertia", "a moment of inertia such as"),
    ('J_load = "0.05 kg*m^2"', 'J_load = "-0.05 kg*m^2"', "blocks.load.inertia", "J_load is -0.05 kg*m^2"),
    ("ratio = 50", "ratio = 0", "blocks.motor.ratio", "a number other than zero"),
    ("ratio = 50", 'ratio = "50:0"', "blocks.motor.ratio", "a divisor that is not zero"),
    ('ti = "Ti"', 'ti = "Ti", ki = "3 V/rad/s"', "blocks.controller.ki", "either it or ti, not both"),
    ('ti = "Ti"', 'ti = "Kp"', "blocks.controller.ti", "a time such as '1 ms': Kp is in V/rad"),
    ('kind = "pi"', 'kind = "pid", td = "1 ms"', "blocks.controller.tf", "a derivative without filter has no end"),
    ('sample_time = "1 ms"', 'sample_time = "1 kHz"', "blocks.controller.sample_time", "a time such as"),
    (
        'sample_time = "1 ms"',
        'sample_time = "1 ms", computation_delay = "2 ms"',
        "blocks.controller.computation_delay",
        "less than sample_time",
    ),
    ('gap = "0.1 deg"', 'gap = { value = "0.1 deg", tolerance = 25 }', "parameters.gap.tolerance", "such as '10 %' or"),
    ('gap = "0.1 deg"', 'gap = "-0.1 deg"', "elements.gear.gap", "zero or more: gap is -0.1 deg"),
    ('coulomb = "0.5 N*m"', 'coulomb = "5 %"', "elements.load_friction.coulomb", "a force or a torque"),
    ('static = "0.7 N*m"', 'static = "0.4 N*m"', "elements.load_friction.static", "at least coulomb (0.5 N*m)"),
    ("levels = 2048", "levels = 20.5", "elements.encoder.levels", "a whole number from 1"),
    ("2*pi/2^12", "2*PI/2^12", "elements.encoder.step", "a known parameter in place of 'PI'"),
    ('stiffness = "800 N*m/rad", ', "", "elements.gear.stiffness", "a value: lock_pin needs it"),
    ('"controller -> motor.voltage"', '"controller -> motor"', "connect.1", "one of motor.voltage, motor.torque"),
    ('"motor.speed -> motor_f', '"motor.torque -> motor_f', "connect.6", "motor.torque is an input; motor has"),
    ('margins_at = "controller"', 'margins_at = "motr.angle"', "margins_at", "did you mean 'motor'"),
    ('margins_at = "controller"', 'margins_at = ["gear", "setpoint"]', "margins_at.1", "a port of a part"),
    ('size = "0.05 rad"', 'size = "0.05 m"', "run.input.size", "a quantity in rad"),
    ('inputs = { setpoint = "0 rad" }', 'inputs = ["setpoint"]', "run.input.size", "its input has no unit"),
    ('"setpoint - encoder -> c', '"-encoder -> c', "inputs.setpoint", "setpoint drives nothing"),
]


def _said(file, old, new):
    """What is said of a file with a mistake in it."""
    assert file.count(old) >= 1, old
    with pytest.raises(epp.CaseError) as caught:
        epp.case_from_text(file.replace(old, new, 1), name="seeded")
    return caught.value


@pytest.mark.parametrize(("old", "new", "field", "expected"), MISTAKES)
def test_a_mistake_is_named_with_its_field_and_what_was_expected(old, new, field, expected):
    error = _said(RING, old, new)
    assert expected in str(error)
    assert error.field == field and str(error).startswith(f"seeded: {field} is ") and "\n" not in str(error)


@pytest.mark.parametrize(("old", "new", "field", "expected"), SERVO_MISTAKES)
def test_a_mistake_in_a_servo_is_named_with_its_field_and_what_was_expected(old, new, field, expected):
    error = _said((shipped_cases_folder() / "azimuth_servo.toml").read_text(encoding="utf-8"), old, new)
    assert expected in str(error)
    assert error.field == field and str(error).startswith(f"seeded: {field} is ") and "\n" not in str(error)


PLANT = 'kind = "transfer_function", num = ["K"], den = ["T^2", "2*T", 1, 0], start = [0.1, 0, 0]'
OTHER_PLANTS = [
    ('kind = "gain", gain = "-K"', "connect", "the algebraic loop through valve has no unique answer"),
    ('kind = "dead_time", delay = "1 ms"', "connect", "a block with states in front of valve"),
    ('kind = "zero_pole_gain", poles = [[-1, 2], [-1, 2]]', "blocks.plant.poles", "beside its conjugate"),
    ('kind = "zero_pole_gain", poles = [[-1, 2, 3]]', "blocks.plant.poles", "pairs [real part, imaginary part]"),
    ('kind = "zero_pole_gain", zeros = [1], poles = []', "blocks.plant.zeros", "at most as many as the 0 poles"),
    ('kind = "state_space", A = [[0, 1], [0]], B = [[0], [1]], C = [[1, 0]]', "blocks.plant.A", "all of one length"),
    ('kind = "state_space", A = [[0, 1], [0, 0]], B = [[0, 1]], C = [[1, 0]]', "blocks.plant.B", "B 2 by 2"),
    ('kind = "state_space", A = 3, B = [[1]], C = [[1]]', "blocks.plant.A", "a list of rows of numbers"),
    (
        'kind = "state_space", A = [[-1]], B = [[1, 1]], C = [[1]], input_names = ["a", "a"]',
        "blocks.plant.input_names",
        "names that differ",
    ),
    ('kind = "low_pass", bandwidth = "10 Hz"', "blocks.plant.bandwidth", "write turn/s"),
    ('kind = "lead_lag", zero_time = "1 s"', "blocks.plant.pole_time", "a value: lead_lag needs it"),
    ('kind = "integrator", discretisation = "tustn"', "blocks.plant.discretisation", "'backward' or 'forward'"),
]


@pytest.mark.parametrize(("plant", "field", "expected"), OTHER_PLANTS)
def test_a_block_that_cannot_be_is_named_with_its_field(plant, field, expected):
    error = _said(RING, PLANT, plant)
    assert error.field == field and expected in str(error)


def test_a_start_of_the_wrong_length_is_refused():
    with pytest.raises(epp.CaseError, match=r"blocks\.plant\.start"):
        epp.case_from_text(RING.replace("start = [0.1, 0, 0]", "start = [0.1]"))


def test_a_prediction_of_a_sampled_servo_has_the_margins_of_the_loop_itself():
    # The mean over the samples' phases, which predictions are made of, has other states than the places to cut know.
    case = epp.case("azimuth_servo")
    assert dict(epp.predict_limit_cycles(case).margins) == epp.margins(case).summary()


def test_margins_are_taken_at_the_controller_where_nothing_is_said():
    text = RING.replace('-> valve"', '-> controller", "controller -> valve"').replace(
        "[elements]", 'controller = { kind = "pi", kp = 1, ti = "9 s" }\n[elements]'
    )
    assert epp.margins(epp.case_from_text(text)).at == "controller.out"
    assert epp.margins(epp.case_from_text(RING)).at == "valve.out"


TWO_INERTIAS = """
kind = "diagram"
title = "Two inertias on a shaft, a sampled speed controller and a limit"
connect = ["-motor.speed -> speed", "speed -> limit", "limit - shaft -> motor", "shaft -> load",
  "motor.angle - load.angle -> shaft.twist", "motor.speed - load.speed -> shaft.rate"]
[parameters]
c = "400 N*m/rad"
Jm = "1e-3 kg*m^2"
[blocks]
speed = { kind = "pi", kp = 0.4, ti = "20 ms", sample_time = "1 ms" }
motor = { kind = "inertia", inertia = "Jm" }
load = { kind = "inertia", inertia = "4*Jm", damping = 0.01 }
shaft = { kind = "shaft", stiffness = "c", damping = 0.05 }
[elements]
limit = { element = "saturation", lower = -5, upper = 5 }
[run]
t_end = "1 s"
"""


def test_a_sampled_drive_whose_angles_drift_together_has_predictions_and_margins():
    # No state alone is the integrator, so that coordinates are changed: of the mean and of the loop of the samples.
    case = epp.case_from_text(TWO_INERTIAS)
    found = epp.predict_limit_cycles(case)
    assert len(found) == 0 and found.margins["at"] == "speed.out" and found.margins["stable"]
    border = case.with_values({"speed.kp": 0.4 * found.margins["gain_margin"]})
    assert epp.margins(border).gain_margin == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize(("typed", "twice"), [("25 rad/s", "50 rad/s"), ("25 deg/s", "50 deg/s")])
def test_an_expression_is_shown_in_the_unit_that_its_parameter_was_typed_in(typed, twice):
    case = epp.case_from_text(RING.replace('T = "500 ms"', f'T = "500 ms"\nw = "{typed}"\nfast = "w + w"'))
    assert str(case.parameters["w"]) == typed and str(case.parameters["fast"]) == twice


def test_a_derived_parameter_has_the_radians_of_the_field_that_takes_it():
    derived = 'ringing = "20 Hz"\nw = "2*pi*ringing"\nc = "Jm*w^2"'
    shaft = TWO_INERTIAS.replace('c = "400 N*m/rad"', derived)
    shaft = shaft.replace("damping = 0.05", 'damping = "0.1*c/w"')
    case = epp.case_from_text(shaft)
    assert case.unit("c") == ("N*m/rad", "N*m/rad") and str(case.parameters["c"]) == "15.7914 N*m/rad"
    assert case.unit("shaft.damping")[0] == "N*m*s/rad" and case.unit("w")[0] == "1/s"
    for typed in ("15 N*m/rad", "15 N*m", 15.0):
        assert case.si("c", typed) == case.with_values({"c": typed}).value("c") == 15.0
    with pytest.raises(epp.CaseError, match="c is '15 N/m'; expected a quantity in N\\*m/rad"):
        case.si("c", "15 N/m")


def test_the_radians_of_a_field_without_a_unit_of_its_own_follow_from_the_signals():
    servo = epp.case("azimuth_servo").to_toml().replace('kp = "Kp"', 'kp = "2*motor"')
    servo = servo.replace("[parameters]", '[parameters]\nsupply = "24 V"\nmotor = "supply/pi"')
    case = epp.case_from_text(servo)
    assert case.unit("controller.kp")[0] == "V/rad" and case.unit("motor")[0] == "V"
    taken = epp.case_from_text(servo.replace("2*motor", "motor"))
    assert str(taken.parameters["motor"]) == "7.63944 V/rad"


def test_a_field_that_is_an_expression_says_so_where_it_is_asked_to_vary():
    servo = epp.case("azimuth_servo")
    with pytest.raises(epp.CaseError, match=r"encoder.step is '2\*pi/2\^12'; .* vary the parameters of its expression"):
        epp.sweep(servo, {"encoder.step": [1e-3, 2e-3]})
    assert servo.with_values({"encoder.step": 1e-3}).value("encoder.step") == 1e-3
    with pytest.raises(epp.CaseError, match="controller.kind is 'not known'"):
        servo.value("controller.kind")


@pytest.mark.parametrize(
    ("case", "name", "other", "wanted"),
    [
        ("azimuth_servo", "Kp", "80 m", "a quantity in V/rad"),
        ("azimuth_servo", "gap", "1 mm", "an angle"),
        ("azimuth_servo", "motor_friction.coulomb", "1 N", "a torque"),
        ("x15_flare", "bandwidth", "25 Hz", "a rate in 1/s or rad/s"),
        ("x15_flare", "rate", "25 m", "a value with which elements.rate_limit.lower is an angular velocity"),
        ("wheelchair", "play.gap", "1 N", "a quantity in m, as it is in the case"),
    ],
)
def test_a_value_of_another_dimension_is_refused_where_no_field_asks_for_one(case, name, other, wanted):
    """A gain, or the gap of a loop of any kind, has the unit that its file gives it; 25 Hz were taken for 25 rad/s."""
    with pytest.raises(epp.CaseError, match=f"{name} is '{other}'; expected {wanted}"):
        epp.case(case).with_values({name: other})


@pytest.mark.parametrize(("levels", "near"), [(1843.2, 1843), (0.2, 1), (5e5, 100000)])
def test_a_count_that_is_none_is_refused_with_the_nearest_one(levels, near):
    with pytest.raises(epp.CaseError, match=f"levels is .*; expected a whole number from 1 to 100000, such as {near}"):
        epp.case("azimuth_servo").with_values({"encoder.levels": levels})


def test_radians_may_be_left_out_plain_numbers_are_in_si_units_and_expressions_have_units():
    servo = epp.case("azimuth_servo")
    for given in ("80 V", "80 V/rad", 80.0):
        assert servo.with_values({"Kp": given}).value("Kp") == 80.0
    with pytest.raises(epp.CaseError, match="expected a quantity in V/rad"):
        servo.with_values({"Kp": "200*Ti"})


def test_a_part_is_set_as_a_whole():
    case = epp.case_from_text(TWO_INERTIAS)
    smooth = case.with_values({"speed": {"kind": "pi", "kp": 0.4, "ti": "20 ms"}})
    assert len(case.to_system().elements) == 2 and len(smooth.to_system().elements) == 1
    with pytest.raises(epp.CaseError, match="spede"):
        case.with_values({"spede": {"kind": "pi", "kp": 0.4}})
    with pytest.raises(epp.CaseError, match="a table"):
        case.with_values({"speed": 3.0})


def test_external_inputs_are_signals_in_si_units():
    # "0 rad" is shown in degrees by tables, which take what is in radians for it.
    text = RING.replace('demand = "0 m"', 'demand = "2.5 deg"')
    case = epp.case_from_text(text)
    shown = dict(zip(case.to_system().signals.names, case.to_system().signals.units, strict=True))
    assert shown["demand"] == "rad"
    found = epp.simulate(case, t_end=0.1)
    assert found.units["demand"] == "rad" and found.signals["demand"][-1] == math.radians(2.5)


@pytest.mark.parametrize("unit", ["deg/s", "mm", "%"])
def test_a_signal_has_the_dimension_of_its_ports(unit):
    text = (shipped_cases_folder() / "azimuth_servo.toml").read_text(encoding="utf-8")
    assert 'unit = "deg"' in text
    with pytest.raises(epp.CaseError, match=r"signals\.\w+\.unit is .*expected"):
        epp.case_from_text(text.replace('unit = "deg"', f'unit = "{unit}"'), "servo")
    assert epp.case_from_text(text.replace('unit = "deg"', 'unit = "turns of the antenna"'), "servo")


@pytest.mark.parametrize("unit", ["rad", "deg", "arcmin", "turn"])
def test_a_signal_is_in_si_units_whatever_it_is_shown_in(unit):
    """A step of 2.9 deg came to rest "at 0.05 deg": the values of a signal are those of its ports."""
    text = (shipped_cases_folder() / "azimuth_servo.toml").read_text(encoding="utf-8")
    case = epp.case_from_text(text.replace('unit = "deg"', f'unit = "{unit}"'), "servo")
    run, usual = (epp.simulate(c, t_end=0.05) for c in (case, epp.case("azimuth_servo")))
    assert run.units["load"] == "rad"
    assert np.array_equal(run.signals["load"], usual.signals["load"])
    frame = run.in_brief().set_index("signal")
    in_si = np.ptp(run.signals["load"])
    assert frame.loc[f"load [{unit}]", "peak to peak"] == pytest.approx(in_si / parse_quantity(f"1 {unit}", "rad"))


BAND = {"kind": "dead_zone", "lower": "-0.1 deg", "upper": "0.1 deg"}


@pytest.mark.parametrize(
    ("before", "connect", "controller"),
    [
        ("controller", ["setpoint - encoder -> band", "band -> controller"], ""),
        (
            "controller.integral",
            ["setpoint - encoder -> controller.in, band", "band -> controller.integral"],
            ', integral_input = "integral" }',
        ),
    ],
)
def test_a_part_before_an_input_is_the_one_drawn_there(before, connect, controller):
    case = epp.case("azimuth_servo")
    inserted = case.with_values({"elements.band": {**BAND, "before": before}})
    text = (shipped_cases_folder() / "azimuth_servo.toml").read_text(encoding="utf-8")
    text = text.replace('"setpoint - encoder -> controller"', ", ".join(f'"{line}"' for line in connect))
    text = text.replace('sample_time = "1 ms" }', f'sample_time = "1 ms"{controller or " }"}')
    drawn = epp.case_from_text(text.replace("[elements]", f"[elements]\nband = {_in_line(BAND)}"), "azimuth_servo")
    ours, theirs = inserted.to_system(), drawn.to_system()
    assert ours.element_names.index("band") != theirs.element_names.index("band")  # last, and first in the file
    one, other = (epp.simulate(c.to_system(), c.input, 1.0, np.linspace(0.0, 1.0, 50)) for c in (inserted, drawn))
    np.testing.assert_allclose(one.signals["load"], other.signals["load"], rtol=1e-9, atol=1e-12)
    words = Commands.of(inserted).command("cycles")
    assert words.startswith("eppanalysis cycles azimuth_servo --set 'elements.band=") and before in words


def _in_line(table):
    return "{ " + ", ".join(f'{key} = "{value}"' for key, value in table.items()) + " }"


def test_a_part_before_no_input_is_refused_with_those_that_there_are():
    with pytest.raises(epp.CaseError, match=r"elements\.band\.before is 'motor'; expected an input .* motor\.voltage"):
        epp.case("azimuth_servo").with_values({"elements.band": {**BAND, "before": "motor"}})
