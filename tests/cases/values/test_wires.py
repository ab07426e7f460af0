"""Units along the wires of a diagram: what is typed must go together, what is plain is taken to fit."""

import tomllib

import pytest

import eppanalysis as epp

SERVO = epp.case("azimuth_servo").to_toml()
FLARE = epp.case("x15_flare").to_toml()


def _read(text, *changes):
    tables = tomllib.loads(text)
    for place, value in changes:
        *path, last = place.split(".")
        here = tables
        for name in path:
            here = here[int(name)] if isinstance(here, list) else here[name]
        here[int(last) if isinstance(here, list) else last] = value
    return epp.Case.from_tables(tables, name="drawn")


@pytest.mark.parametrize(
    ("text", "place", "value", "said"),
    [
        (
            FLARE,
            "parameters.Kp",
            "25 Hz",
            "blocks.gain.gain is 'Kp'; expected a rate in 1/s or rad/s at gain, .*: Kp is in Hz",
        ),
        (FLARE, "parameters.Kp", "2 rad/s", "gain.gain is 'Kp'; expected a plain number .*: Kp is in rad/s"),
        (FLARE, "blocks.gain.gain", "2*Kp*bandwidth", r"blocks.gain.gain is .*: 2\*Kp\*bandwidth is in rad/s"),
        (SERVO, "parameters.Kp", "40 V/m", "controller.kp is 'Kp'; expected a quantity in V/rad .*: Kp is in V/m"),
        (SERVO, "parameters.gap", "0.1 mm", "elements.gear.gap is 'gap'; expected an angle .*: gap is in m"),
        (SERVO, "blocks.motor.ratio", "50 rad/s", "blocks.motor.ratio is '50 rad/s'; expected a plain number"),
        (SERVO, "elements.motor_friction.coulomb", "0.3 N", "coulomb is '0.3 N'; expected a torque"),
        (SERVO, "inputs.setpoint", "0 m", "inputs.setpoint is '0 m'; .* setpoint is in rad"),
        (SERVO, "blocks.load.start", ["5 mm", 0], "blocks.load.start.0 is '5 mm'; .* load.angle is in rad"),
        (SERVO, "blocks.load.start", [0, "5 deg"], "blocks.load.start.1 is '5 deg'; .* load.speed is in rad/s"),
        (SERVO, "blocks.motor.start", ["2 V", 0], "blocks.motor.start.0 is '2 V'; .* motor.angle is in rad"),
        (SERVO, "signals.load.unit", "V", "signals.load.unit is 'V'; .* load.angle is in rad"),
        (SERVO, "connect.2", "motor.speed - load.angle -> gear.twist", "one unit: load.angle is in rad, gear.twist"),
    ],
)
def test_a_unit_that_does_not_go_with_the_wires_is_refused(text, place, value, said):
    with pytest.raises(epp.CaseError, match=said):
        _read(text, (place, value))


def test_the_integral_and_the_derivative_gain_have_the_time_in_their_units():
    pid = {"kind": "pid", "kp": "Kp", "ki": "Kp/Ti", "kd": "Kp*Ti", "tf": "1 ms", "sample_time": "1 ms"}
    assert _read(SERVO, ("blocks.controller", pid)).value("Kp") == 40.0
    for field in ("ki", "kd"):
        with pytest.raises(epp.CaseError, match=f"blocks.controller.{field} is 'Kp'; expected a quantity in V"):
            _read(SERVO, ("blocks.controller", {**pid, field: "0.5*Kp*0.2"}), ("blocks.controller." + field, "Kp"))


def test_plain_numbers_and_machines_of_plain_numbers_fit_everything():
    assert _read(SERVO, ("parameters.Kp", 40)).value("Kp") == 40.0
    wheel, wired = {"kind": "inertia", "inertia": 2.0}, tomllib.loads(FLARE)["connect"] + ["0 -> wheel"]
    changes = [("connect", wired), ("connect.2", "error + wheel.speed + wheel.angle -> rate_limit")]
    assert _read(FLARE, *changes, ("blocks.wheel", wheel)).value("Kp") == 1.5
    with pytest.raises(epp.CaseError, match="wheel.angle is in rad, rate_limit.in is in rad/s"):
        _read(FLARE, *changes, ("blocks.wheel", {**wheel, "inertia": "2 kg*m^2"}))


def test_a_parameter_that_was_set_beside_the_file_is_refused_by_its_own_name():
    with pytest.raises(epp.CaseError, match="^with_values: Kp is '2 rad/s'; expected a plain number"):
        epp.case("x15_flare").with_values({"Kp": "2 rad/s"})


def test_ports_that_the_file_does_not_name_have_the_units_that_follow_from_the_others():
    """By hand from the servo's drawing; a voltage gain's radians are left out, a bandwidth's are no second angle."""
    units = _units(SERVO)
    ports = {"rad": "motor_angle encoder encoder_in gear_twist setpoint", "rad/s": "motor_speed load_friction_in"}
    ports |= {"V": "controller", "A": "motor_current", "N*m": "gear motor_friction load_friction"}
    assert {name: units[name] for names in ports.values() for name in names.split()} == {
        name: unit for unit, names in ports.items() for name in names.split()
    }
    flare = _units(FLARE)
    assert (flare["error"], flare["rate_limit"], flare["elevator"]) == ("rad/s", "rad/s", "rad")


def test_ports_behind_plain_numbers_alone_have_no_unit():
    plain = SERVO.replace("40 V/rad", "40")
    units = _units(plain, ("blocks.controller.kp", "Kp"), ("parameters.Kp", 40.0))
    assert units["controller"] == "V"  # the motor tells it
    loop = _read(epp.case("clegg_loop").to_toml()).to_system()
    assert not any(loop.signals.units)


def test_units_of_ports_are_those_of_the_axes():
    run = epp.simulate(_read(SERVO), t_end=0.1)
    assert run.plot(signals=["motor_current"]).get_ylabel() == "motor current [A]"
    assert run.to_dataset()["gear_twist"].attrs["units"] == "rad"


def _units(text, *changes):
    signals = _read(text, *changes).to_system().signals
    return dict(zip(signals.names, signals.units, strict=True))


@pytest.mark.parametrize("start", [["5 deg", "3 deg/s"], [0.1, 0], ["gap", "2*gap"], [0, "10 1/s"]])
def test_a_start_in_the_units_of_the_states_is_taken(start):
    assert len(_read(SERVO, ("blocks.load.start", start)).to_system().x0)


_AXIS = """
kind = "diagram"
title = "Axis"
connect = [
  "setpoint - scale -> position_loop", "position_loop - motor.speed -> speed_loop", "speed_loop -> current_limit",
  "current_limit -> torque", "torque - bearing -> motor", "motor.speed -> bearing", "motor.angle -> screw",
  "screw -> table", "table -> scale",
]
inputs = { setpoint = "0 mm" }
signals = { table = { of = "table", unit = "m" } }
run = { t_end = "1 s" }
[blocks]
position_loop = { kind = "gain", gain = "5e4 rad/(s*m)" }
speed_loop = { kind = "pi", kp = "0.6 A*s/rad", ti = "8 ms" }
torque = { kind = "gain", gain = "1.2 N*m/A" }
motor = { kind = "inertia", inertia = "1e-3 kg*m^2", damping = "2e-3 N*m*s/rad" }
screw = { kind = "gain", gain = "1.6 mm/rad" }
table = { kind = "low_pass", bandwidth = "400 rad/s" }
[elements]
current_limit = { element = "saturation", lower = "-15 A", upper = "15 A" }
bearing = { element = "friction", coulomb = "0.15 N*m", static = "0.2 N*m" }
scale = { element = "play", gap = "10 um" }
"""


@pytest.mark.parametrize("text", [_AXIS, SERVO], ids=["axis", "servo"])
@pytest.mark.parametrize("wrong", ["*K", "/N", "*s"])
def test_a_number_of_another_unit_is_named_itself_wherever_its_part_stands(text, wrong):
    """Not the last one round a circle of the drawing, where it shows; parts may stand in any order."""
    tables, seeded = tomllib.loads(text), 0
    for section in ("inputs", "blocks", "elements"):
        for name, part in tables[section].items():
            for field, value in part.items() if isinstance(part, dict) else [("", part)]:
                number, unit = value.split(" ") if isinstance(value, str) and " " in value else (value, "")
                if not unit:
                    continue
                place = ".".join(filter(None, (section, name, field)))
                turned = [(s, dict(reversed(tomllib.loads(text)[s].items()))) for s in ("blocks", "elements")]
                for order in ([], turned):
                    with pytest.raises(epp.CaseError) as refused:
                        _read(text, *order, (place, f"{number} {unit}{wrong}"))
                    assert refused.value.field == place
                seeded += 1
    assert seeded > 5


def test_a_gain_that_is_left_out_makes_no_other_unit_and_a_plain_one_may():
    without = {"element": "saturation", "lower": "-15 A", "upper": "15 A"}
    changes = ("blocks.speed_loop.kp", "0.6 V*s/rad"), ("elements.current_limit", without)
    with pytest.raises(epp.CaseError, match="speed_loop.kp is '0.6 V.s/rad'; expected a quantity in s.A/rad"):
        _read(_AXIS, *changes)
    assert _read(_AXIS, *changes, ("elements.current_limit", {**without, "slope": 1})).value("speed_loop.kp") == 0.6
