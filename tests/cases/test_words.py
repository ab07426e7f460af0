"""Files as people write them: the words of other programs, numbers of data sheets, and what is left out."""

from __future__ import annotations

import json
import math
import re

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

SERVO = epp.case("azimuth_servo").to_toml()


def servo(*changes: tuple[str, str]) -> epp.Case:
    """The shipped servo with other lines."""
    text = SERVO
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return epp.case_from_text(text, "servo")


def test_numbers_of_a_data_sheet() -> None:
    """A ratio, a step as an angle over its counts, and who gives the number."""
    found = servo(
        ("ratio = 50", 'ratio = { value = "36:1", mark = "data sheet", note = "page 3" }'),
        ('step = "2*pi/2^12"', 'step = "360/2000 deg"'),
        ('Ti = { value = "0.4 s"', 'Ti = { value = "1/2.5 s"'),
    )
    ratio = found.parameters["motor.ratio"]
    assert (ratio.value, ratio.mark, ratio.note) == (36.0, "data sheet", "page 3")
    assert found.parameters["encoder.step"].value == pytest.approx(math.radians(0.18), rel=1e-15)
    assert found.parameters["Ti"].value == 0.4
    assert epp.case_from_text(found.to_toml()).parameters == found.parameters


def test_kind_and_element_are_one_word() -> None:
    """Either may say what an element is, in a diagram and in a loop; both at once is a mistake."""
    assert servo(('kind = "lock_pin"', 'element = "lock_pin"')).parameters == servo().parameters
    loop = (
        'kind = "loop"\ntitle = "t"\n[loop]\nnum = [5.0]\nden = [1, 1, 0]\n[[loop.elements]]\n{} = "play"\ngap = 2.0\n'
    )
    each = [epp.case_from_text(loop.format(word) + '[run]\nt_end = "9 s"') for word in ("kind", "element")]
    assert [found.value("play.gap") for found in each] == [2.0, 2.0]
    assert "element =" not in each[1].to_toml()
    with pytest.raises(
        epp.CaseError, match=r"elements.gear.kind is 'lock_pin'; expected either element or kind, which"
    ):
        servo(('kind = "lock_pin"', 'element = "lock_pin"\nkind = "lock_pin"'))


def test_a_file_that_inherits_may_use_the_other_word(tmp_path) -> None:
    """A kind in place of an element, and the other name of a field, replace what the base says."""
    (tmp_path / "mine.toml").write_text(
        'base = "azimuth_servo"\ntitle = "mine"\n[elements]\ngear.backlash = "0.2 deg"\nencoder.element = "quantizer"\n'
        'encoder.resolution = "0.1 deg"\n',
        encoding="utf-8",
    )
    found = epp.read_case(tmp_path / "mine.toml")
    assert found.parameters["gear.gap"].value == pytest.approx(math.radians(0.2))
    assert found.parameters["encoder.step"].value == pytest.approx(math.radians(0.1))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('kind = "motor"', 'kind = "dc_motor"'),
        ('resistance = "2 ohm"\ntorque_constant', 'R = "2 ohm"\nKt'),
        ('kind = "lock_pin"\ngap', 'kind = "backlash"\nbacklash'),
        ('kind = "quantiser"', 'kind = "quantizer"'),
        ('sample_time = "1 ms"', 'Ts = "1 ms"'),
        ('static = "0.7 N*m"', 'stiction = "0.7 N*m"'),
    ],
)
def test_words_of_others_mean_the_same(old: str, new: str) -> None:
    """The case is the same, and prints our words."""
    found = servo((old, new))
    assert found.to_toml() == SERVO and found.parameters == servo().parameters


def test_backlash_is_what_its_fields_make_of_it() -> None:
    """A gap alone is a play, as in Simulink; with a stiffness it is the gap between two inertias."""
    drawn = """kind = "diagram"
title = "t"
connect = ["-gear -> plant", "plant -> gear"]
[blocks]
plant = { kind = "tf", numerator = [5.0], den = [1, 1, 0] }
[elements]
gear = { kind = "backlash", width = 2.0 }
[run]
t_end = "50 s"
"""
    assert isinstance(epp.case_from_text(drawn).to_system().elements[0], epp.Play)
    pin = servo(('kind = "lock_pin"', 'kind = "backlash"'))
    assert isinstance(pin.to_system().elements[0], epp.LockPin)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('gap = "gap"', 'backlash = "2 N"', r"elements.gear.backlash is '2 N'; expected an angle"),
        (
            'gap = "gap"',
            'gap = "gap"\nwidth = "1 deg"',
            r"elements.gear.width is '1 deg'; expected either gap or width",
        ),
        (
            'kind = "quantiser"',
            'kind = "quantize"',
            r"elements.encoder.kind is 'quantize'; expected a known element: did",
        ),
        ('kind = "motor"', 'kind = "backlash"', r"blocks.motor.kind is 'backlash'.*which belongs in \[elements\]"),
        (
            'kind = "quantiser"',
            'kind = "dc_motor"',
            r"elements.encoder.kind is 'dc_motor'.*which belongs in \[blocks\]",
        ),
    ],
)
def test_a_mistake_is_named_by_the_word_of_the_file(old: str, new: str, said: str, tmp_path) -> None:
    """Also among all the mistakes of a file."""
    with pytest.raises(epp.CaseError, match=said):
        servo((old, new))
    (tmp_path / "servo.toml").write_text(SERVO.replace(old, new, 1), encoding="utf-8")
    answered = CliRunner().invoke(app, ["check", str(tmp_path / "servo.toml")])
    assert answered.exit_code == 2 and re.search(said, answered.stderr)


def test_settings_may_use_the_word_of_the_file() -> None:
    changed = servo().with_values({"gear.backlash": "0.2 deg", "motor.Kt": "0.06 N*m/A"})
    assert changed.value("motor.torque_constant") == 0.06
    assert changed.value("gear.gap") == pytest.approx(math.radians(0.2))
    with pytest.raises(
        epp.CaseError, match=r"motor.R is 'not known'; expected a known field: did you mean 'motor.resist"
    ):
        servo().value("motor.R")


def test_a_play_between_two_inertias_is_remarked() -> None:
    """Its output is held by friction, so it cannot let a load fly through the gap; one before a sensor can."""
    drive = """kind = "diagram"
title = "t"
connect = ["motor.angle - load.angle -> gear", "gear -> shaft.twist", "motor.speed - load.speed -> shaft.rate",
  "shaft -> load", "-shaft -> motor", "load.angle -> sensor", "sensor -> 0"]
[blocks]
shaft = { kind = "shaft", stiffness = "100 N*m/rad" }
motor = { kind = "inertia", J = "1 kg*m^2" }
load = { kind = "inertia", J = "2 kg*m^2" }
[elements]
gear = { kind = "backlash", gap = "1 deg" }
sensor = { kind = "backlash", gap = "1 deg" }
"""
    drive = drive.replace(', "sensor -> 0"', "")
    (said,) = epp.case_from_text(drive).remarks
    assert said.startswith("gear is a play between motor and load") and 'kind = "lock_pin"' in said
    assert epp.case("steering_compensated").remarks == ()


VALVE = """kind = "diagram"
title = "Valve with a limit"
connect = ["setpoint - plant -> controller", "controller -> valve", "valve -> plant"]
inputs = ["setpoint"]
[blocks]
controller = { kind = "pi", kp = 20.0, ti = "5 s" }
plant = { kind = "transfer_function", num = [1], den = [1, 3, 2, 0] }
[elements]
valve = { kind = "saturation", lower = -1, upper = 1 }
"""


@pytest.mark.parametrize(
    ("input", "at"),
    [
        ("", "setpoint = 0"),
        ('{ kind = "step", size = 0.5, time = "3 s" }', "setpoint = 0.5"),
        ('{ kind = "ramp", rate = 0.5, stop = "2 s" }', "setpoint = 1"),
        ('{ kind = "steps", times = ["1 s", "2 s"], values = [3, 4] }', "setpoint = 4"),
        ('{ kind = "ramp", rate = 0.5 }', "input 'setpoint' is a ramp that does not end"),
        ('{ kind = "sine", amplitude = 0.5, frequency = "1 Hz" }', "input 'setpoint' is a sine"),
    ],
)
def test_without_a_length_of_the_run_inputs_are_where_they_come_to(input: str, at: str) -> None:
    case = epp.case_from_text(VALVE + f"[run]\ninput = {input}" * bool(input))
    assert str(case.operating_point) == at
    assert epp.margins(case).at == "controller.out"


def test_a_file_needs_a_run_only_for_runs(tmp_path) -> None:
    """What does not run answers as with a run; what does names the line that is missing."""
    path = tmp_path / "valve.toml"
    path.write_text(VALVE, encoding="utf-8")
    for command in ("check", "margins", "predict"):
        assert CliRunner().invoke(app, [command, str(path)]).exit_code == 0
    texts = VALVE, f"{VALVE}[run]\nt_end = '50 s'"
    found, with_run = (epp.predict_limit_cycles(epp.case_from_text(text)) for text in texts)
    assert [c.omega for c in found] == [c.omega for c in with_run] and len(found)
    grid = epp.sweep(epp.case_from_text(VALVE), {"controller.kp": [20.0, 25.0]}, run="predict", progress=False)
    assert "t_end" not in json.loads(grid.attrs["provenance"])["settings"]
    for command in ("simulate", "validate"):
        answered = CliRunner().invoke(app, [command, str(path)])
        assert answered.exit_code == 2 and "run.t_end is missing; expected the length of a run: run.t_end = '10 s'" in (
            answered.stderr
        )
    assert CliRunner().invoke(app, ["simulate", str(path), "--set", "run.t_end=10 s"]).exit_code == 0
    path.write_text(f"run.t_end = '10 s'\n{VALVE}", encoding="utf-8")
    assert epp.read_case(path).t_end == 10.0


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('inputs = ["setpoint"]\n', "", 'inputs = ["setpoint"]'),
        ("setpoint - plant", "setpoint - plant + wind", 'inputs = ["setpoint", "wind"]'),
        ('inputs = ["setpoint"]', 'inputs = { level = "1 m" }', 'inputs = { level = "1 m", setpoint = 0.0 }'),
    ],
)
def test_an_input_that_is_not_declared_is_answered_with_its_line(old: str, new: str, line: str, tmp_path) -> None:
    """The line makes the file valid, and is said once however often the input is used."""
    path = tmp_path / "valve.toml"
    broken = VALVE.replace(old, new, 1)
    path.write_text(broken, encoding="utf-8")
    answered = CliRunner().invoke(app, ["check", str(path)])
    assert f"an external input needs the line {line} above the first section." in answered.stderr
    mended = re.sub("^inputs.*\n", "", broken, flags=re.MULTILINE)
    if "level" in line:
        mended = mended.replace("setpoint - plant", "setpoint + level - plant")
    path.write_text(f"{line}\n{mended}", encoding="utf-8")
    assert "setpoint" in epp.read_case(path).to_system().input_names


@pytest.mark.parametrize(("old", "new"), [("setpoint -", "setpoit -"), ('controller = { kind = "pi"', "# ")])
def test_a_slip_and_a_part_that_is_missing_are_no_inputs(old: str, new: str, tmp_path) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(VALVE.replace(old, new, 1), encoding="utf-8")
    answered = CliRunner().invoke(app, ["check", str(path)])
    assert answered.exit_code == 2 and "external input needs" not in answered.stderr


def test_contact_stiffness_is_estimated_from_the_size_of_the_gear(tmp_path) -> None:
    """c b r^2 of ISO 6336-1, with r of the base circle; it is said, marked, and gives way to a number."""
    size = 'pitch_diameter = "60 mm"\nface_width = "10 mm"'
    found = servo(('stiffness = "800 N*m/rad"', size))
    expected = 20e9 * 0.01 * (0.03 * math.cos(math.radians(20.0))) ** 2
    stiffness = found.parameters["gear.stiffness"]
    assert stiffness.value == pytest.approx(expected) == found.to_system().elements[0].stiffness
    assert stiffness.mark == "derived" and "ISO 6336-1" in stiffness.note
    (said,) = found.remarks
    assert said.startswith("gear.stiffness is estimated to be 158944 N*m/rad")
    assert found.with_values({"gear.face_width": "5 mm"}).value("gear.stiffness") == pytest.approx(expected / 2)
    given = found.with_values({"gear.stiffness": "800 N*m/rad"})
    assert given.remarks == () and given.to_system().elements[0].stiffness == 800.0
    path = tmp_path / "servo.toml"
    path.write_text(SERVO.replace('stiffness = "800 N*m/rad"', size), encoding="utf-8")
    answered = CliRunner().invoke(app, ["predict", str(path), "--json"])
    assert said in answered.stderr
    assert json.loads(answered.stdout)["cases"][0]["remarks"] == [said]


@pytest.mark.parametrize(
    ("new", "said"),
    [
        (
            "",
            "elements.gear.stiffness is missing; expected a value: lock_pin needs it, or pitch_diameter and face_width",
        ),
        ('pitch_diameter = "60 mm"', "elements.gear.face_width is missing; expected a value: stiffness is estimated"),
        (
            'pitch_diameter = "60 N"\nface_width = "1 mm"',
            "pitch_diameter is '60 N'; expected a length that is positive",
        ),
        (
            'pitch_diameter = "60 mm"\nface_width = 0',
            "elements.gear.face_width is 0; expected a length that is positive",
        ),
    ],
)
def test_sizes_that_make_no_gear_are_refused(new: str, said: str) -> None:
    with pytest.raises(epp.CaseError, match=re.escape(said)):
        servo(('stiffness = "800 N*m/rad"', new))


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ('{ kind = "saturation", upper = "24 V" }', "valve.lower is not given, beside valve.upper of 24 V, and is -1"),
        (
            '{ kind = "saturation", min = -5 }',
            "valve.upper is not given, beside valve.lower of -5",
        ),
        ('{ kind = "relay", high = 2 }', "valve.low is not given, beside valve.high of 2, and is -1 by default."),
        ('{ kind = "saturation" }', ""),
        ('{ kind = "relay", low = 0, high = 1 }', ""),
    ],
)
def test_one_side_that_is_left_at_its_default_is_remarked(typed: str, said: str) -> None:
    """A limit of 24 V on one side alone is seldom meant; both sides left out are the unit element."""
    remarks = epp.case_from_text(re.sub("valve = {.*", f"valve = {typed}", VALVE)).remarks
    assert remarks == () if not said else remarks[0].startswith(said)


@pytest.mark.parametrize("blocks", ['[["a"], 1]', "3", '{ controller = "pi" }', "{ controller = { kind = [1] } }"])
@pytest.mark.parametrize("inputs", ['["setpoint"]', "3", '[["a"], 1]', ""])
def test_what_is_no_table_of_parts_is_a_sentence(blocks: str, inputs: str, tmp_path) -> None:
    """Words and undeclared inputs are looked for in files that hold anything."""
    path = tmp_path / "valve.toml"
    text = f'kind = "diagram"\ntitle = "t"\nconnect = ["setpoint - a -> controller"]\nblocks = {blocks}\n'
    path.write_text(text + f"inputs = {inputs}" * bool(inputs), encoding="utf-8")
    answered = CliRunner().invoke(app, ["check", str(path)])
    assert answered.exit_code == 2 and "expected" in answered.stderr
