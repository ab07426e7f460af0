"""All mistakes of a file are named at once, each with its field, its value and what was expected, and no others."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from eppanalysis.cases.mistakes import mistakes_in
from eppanalysis.cases.values.toml import write_toml
from eppanalysis.cli.commands import app

SEEDED = Path(__file__).with_name("seeded.toml")
#: What is wrong in the seeded file, field by field, with words of what was expected.
SEEDS = {
    "expected.outcme": "did you mean 'outcome'",
    "run.t_end": "a time such as",
    "run.input.kind": "'step'",
    "parameters.Kp": "a known unit in place of 'V/radd'",
    "parameters.a": "a known parameter in place of 'Kx'",
    "parameters.h": "an expression of numbers",
    "parameters.sqrt": "no function or constant of expressions",
    "parameters.d": "d uses e, which uses d",
    "parameters.Ti.tolerance": "a tolerance in per cent or a time",
    "parameters.J.mark": "one of paper, derived",
    "parameters.b": "a divisor that is not zero",
    "parameters.g": "an argument that is not negative",
    "parameters.f": "a plain number or an angle",
    "parameters.both": "two of one unit: T + L adds s to m",
    "blocks.sensor.kind": "did you mean 'gain'",
    "blocks.pi1.tii": "did you mean 'ti'",
    "blocks.pi2.ti": "a time such as",
    "blocks.pi3.ki": "either it or ti, not both",
    "blocks.pi4.sample_time": "a positive number",
    "blocks.pid1.tf": "a derivative without filter has no end",
    "blocks.lag.delay": "a time such as",
    "blocks.notchy.bandwidth": "write turn/s",
    "blocks.tf1.num": "at most the degree of the denominator, 1",
    "blocks.tf2.den": "a coefficient other than zero",
    "blocks.tf3.start": "1 number, one for each state",
    "blocks.mass.mass": "a positive number",
    "blocks.late.computation_delay": "a sample_time beside it, as the block has no sample_time, or a delay",
    "elements.clip.element": "did you mean 'saturation'",
    "elements.limit.upper": "more than lower (1)",
    "elements.steps.levels": "a whole number from 1",
    "elements.play.gap": "zero or more",
    "elements.dry.static": "at least coulomb (1 N)",
    "elements.gear.stiffness": "lock_pin needs it",
    "elements.gear.damping": "lock_pin needs it",
    "connect.5": "one of mass.position, mass.speed",
    "connect.7": "a part of the diagram in place of 'sensro'",
    "connect.8": "one of gear.twist, gear.rate",
    "connect.9": "did you mean 'two.in'",
    "connect.11": "'one -> three' does already",
    "connect.12": "a connection such as",
    "connect.13": "three.in is an input",
    "connect": "a connection to late.in, '0 -> late.in' where it is to stay at zero",
    "signals.out": "did you mean 'lag'",
    "inputs.load": "load drives nothing",
    "margins_at": "did you mean 'pi1'",
    "expected.signal": "one of",
}


def test_every_seeded_mistake_is_named_and_nothing_else() -> None:
    found, not_seen, not_through = mistakes_in(SEEDED)
    said = {error.field: str(error) for error in found if "algebraic" not in str(error)}
    assert len(SEEDS) >= 40 and said.keys() == SEEDS.keys()
    for field, expected in SEEDS.items():
        assert said[field].startswith(f"{SEEDED}: {field} is ") and expected in said[field] and "\n" not in said[field]
    algebraic = [error for error in found if "algebraic" in str(error)]
    assert len(algebraic) == 1 and "the algebraic loop through six, seven has no unique answer" in str(algebraic[0])
    assert len(found) == len(SEEDS) + 1
    # In place of the others stands a part with their ports.
    assert not_seen == ("d", "sensor", "clip")
    assert set(not_through) == {"pid1", "notchy", "tf1", "tf2", "mass", "limit", "steps", "play", "gear", "six"}


def test_check_prints_them_all_and_says_what_it_has_not_seen() -> None:
    result = CliRunner().invoke(app, ["check", str(SEEDED)])
    assert result.exit_code == 2 and not result.stdout
    lines = result.stderr.splitlines()
    assert len(lines) == len(SEEDS) + 2
    assert lines[-1].startswith(f"{SEEDED}: not checked before that is mended: uses of d, sensor and clip; units")


def test_the_next_file_is_checked_though_one_has_no_base(tmp_path: Path) -> None:
    paths = [str(tmp_path / f"{base}.toml") for base in ("first", "second")]
    for path in paths:
        Path(path).write_text(f'base = "none_of_{Path(path).stem}"\ntitle = "t"\n', encoding="utf-8")
    said = CliRunner().invoke(app, ["check", *paths]).stderr.splitlines()
    assert [line.partition(": ")[0] for line in said] == paths and all("base is 'none_of_" in line for line in said)


@pytest.mark.parametrize(("name", "gain"), [("virtual_spring", "K"), ("steering_compensated", "Kp")])
def test_no_unit_is_refused_beyond_a_gain_that_cannot_be_read(tmp_path: Path, name: str, gain: str) -> None:
    """Taken out, the gain would be 1 and leave the unit of what comes in."""
    file = tmp_path / "wrong.toml"
    case = epp.case(name)
    file.write_text(case.to_toml().replace(f'"{case.held(gain)}"', '"5 apples"'))
    said = CliRunner().invoke(app, ["check", str(file)]).stderr.splitlines()
    assert [line.removeprefix(f"{file}: ") for line in said] == [
        f"parameters.{gain} is '5 apples'; expected a known unit in place of 'apples'.",
        f"not checked before that is mended: uses of {gain}.",
    ]


def test_what_is_missing_beside_a_mistake_is_named_and_what_is_not_read_is_told(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(
        'kind = "diagram"\ntitle = "t"\nconnect = ["demand - lag -> lag", "motor.angle -> lamp"]\n'
        "inputs = { demand = 0 }\n[blocks]\n"
        'lag = { kind = "low_pass", bandwidth = "2 V" }\n'
        'motor = { kind = "motor", resistance = "2 ohm", torque_constant = 1, damping = "2 V" }\n'
        'lamp = { kind = "lead_lag", zero_time = 1, pole_time = "0 s", discretisation = "zoh" }\n[run]\nt_end = "5 s"\n'
    )
    found, not_seen, not_through = mistakes_in(file)
    fields = {"blocks.lag.bandwidth", "blocks.motor.damping", "blocks.motor.inertia", "blocks.lamp.pole_time"}
    fields |= {"blocks.lamp.discretisation", "connect"}
    # No word that what is left makes no loop: it would, were it not for these.
    assert {error.field for error in found} == fields and not not_seen and set(not_through) == {"lag", "motor", "lamp"}
    open_ones = [str(error) for error in found if error.field == "connect"]
    assert [text.partition("nothing drives ")[2] for text in open_ones] == ["motor.voltage).", "motor.torque)."]


@pytest.mark.parametrize(("kind", "to"), [("dead_tim", "pipe"), ("dead_time", "pip")], ids=["kind", "name"])
def test_an_input_whose_only_connection_is_wrong_is_no_unknown_one(tmp_path: Path, kind: str, to: str) -> None:
    """What the input does is said of an input all the same, which the mistake beside it hides."""
    (tmp_path / "tank.toml").write_text(
        f"""
kind = "diagram"
title = "Tank"
connect = ["valve + load -> {to}", "pipe -> tank", "-tank -> valve"]
inputs = ["load"]
[blocks]
pipe = {{ kind = "{kind}", delay = "1 s" }}
tank = {{ kind = "integrator" }}
[elements]
valve = {{ element = "saturation" }}
[run]
t_end = "9 s"
inputs = {{ load = {{ kind = "step", size = 1 }}, laod = {{ kind = "step", size = 1 }} }}
"""
    )
    said = mistakes_in(tmp_path / "tank.toml")
    assert "load" in said.not_seen
    assert [e.field for e in said.found if e.field.startswith("run")] == ["run.inputs.laod"]


@pytest.mark.parametrize("name", ["azimuth_servo", "sat_am165", "fig8a_original"])
def test_a_valid_file_has_no_mistakes(name: str) -> None:
    assert mistakes_in(shipped_cases_folder() / f"{name}.toml") == ((), (), ())


def test_mistakes_of_a_loop_and_of_an_elbow_are_named_too(tmp_path: Path) -> None:
    file, rest = tmp_path / "wrong.toml", '[run]\nt_end = "5 m"\n[[loop.elements]]\nelement = "relay"\n'
    file.write_text('kind = "loop"\n[loop]\nnum = [1, 2]\nden = [1]\ngian = 3\n' + rest)
    assert {e.field for e in mistakes_in(file).found} == {"loop.gian", "run.t_end", "title", "loop.num"}
    ring = 'blocks = [{ num = [2.0], den = [0, 0] }, { element = "plya", gap = 2.0, note = "mine" }]\n'
    file.write_text(f'kind = "loop"\ntitle = "Ring"\n[run]\nt_end = "5 s"\n[loop]\n{ring}')
    assert {e.field for e in mistakes_in(file).found} == {"loop.blocks.1.element"}
    assert mistakes_in(file).not_seen == ("loop blocks 1",)
    file.write_text(file.read_text().replace("plya", "play").replace(', note = "mine"', ""))
    assert {e.field for e in mistakes_in(file).found} == {"loop.blocks.0.den"}
    file.write_text('base = "fig8a_original"\nlock_pin.backlash = "5 mm"\ncable.stifness = 3\nbands.range = "-1 lbf"\n')
    assert {e.field for e in mistakes_in(file).found} == {"lock_pin.backlash", "cable.stifness", "bands.range"}


_SEVERAL = """
kind = "diagram"
title = "Several mistakes in one place"
connect = [
  "demnd - sensr -> ctrl.inn, ctrl", "ctrl.outt -> drive.voltag, clip", "clip -> drive.voltage",
  "drive.angl -> sensor, ctrl", "0 -> drive.torque", "sensor -> dry",
]
inputs = { demand = 0 }
margins_at = ["ctrll", "clip", "clipp"]
parameters = { a = "Kx + Ky" }
signals = { s = "sensr - clup + drive.angle" }
run = { t_end = "1 s" }
[blocks]
ctrl = { kind = "pi", ti = "2 V", sample_time = "3 m", kpp = 3, td = 3 }
drive = { kind = "motor", damping = "2 V", inductance = "-1 H" }
sensor = { kind = "gain", gain = "a*Kz" }
tf = { kind = "transfer_function", den = [0, 0] }
tg = { kind = "transfer_function", den = [1, "x y", 2, "z w"], num = [1, "q q"] }
[elements]
clip = { element = "saturation" }
dry = { element = "friction", static = "-3 N", stick_band = 3 }
gear = { element = "lock_pin", gap = "-0.1 deg" }
"""


def test_several_mistakes_of_one_part_connection_list_or_expression_are_named_at_once(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(_SEVERAL)
    found = [str(error).removeprefix(f"{file}: ") for error in mistakes_in(file).found]
    fields = [text.partition(" is ")[0] for text in found]
    assert {field.partition(".")[2] for field in fields if field.startswith(("blocks", "elements"))} == {
        *("ctrl.kpp", "ctrl.td", "ctrl.ti", "ctrl.sample_time", "drive.damping", "drive.inductance", "sensor.gain"),
        *("drive.torque_constant", "drive.inertia", "tf.num", "tf.den", "tg.den.1", "tg.den.3", "tg.num.1"),
        *("dry.stick_band", "dry.coulomb", "gear.stiffness", "gear.damping", "gear.gap"),
    }
    wrong = ("Kx", "Ky", "Kz", "demnd", "sensr", "clup", "ctrll", "clipp")
    assert all(any(f"in place of {name!r}" in text for text in found) for name in wrong)
    assert [text for text in found if "'demnd - sensr -> ctrl.inn, ctrl' does already" in text]
    assert fields.count("connect.0") == 3 and fields.count("connect.1") == 2 and fields.count("connect.3") == 2
    assert fields.count("signals.s") == 2 and len(found) == len(set(found)) == 36


def test_every_element_of_a_list_is_read_though_one_lacks_fields(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(
        'kind = "loop"\ntitle = "t"\n[loop]\nA = [[0, 1], [0, -1]]\nB = [[0], [1]]\nC = [[1, 0], [0, 1]]\n'
        '[run]\nt_end = "5 s"\n[[loop.elements]]\nelement = "lock_pin"\ngap = "-1 deg"\n'
        '[[loop.elements]]\nelement = "friction"\ncolomb = "3 N"\nstatic = "1 s"\n'
    )
    of_elements = {"0.stiffness", "0.damping", "0.gap", "1.colomb", "1.static"}
    assert {e.field for e in mistakes_in(file).found} == {"loop.C", *(f"loop.elements.{at}" for at in of_elements)}


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('"demnd - sensr -> ctrl.inn, ctrl"', "7", "connect.0"),
        ('run = { t_end = "1 s" }', "expected = { signal = [1] }", "expected.signal"),
    ],
)
def test_another_type_where_a_name_stands_is_one_mistake_of_many(
    tmp_path: Path, old: str, new: str, field: str
) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(_SEVERAL.replace(old, new))
    found = mistakes_in(file).found
    assert field in {error.field for error in found} and len(found) > 20


#: Places of a diagram that hold a number: of a block, its lists and matrices, an element, its tables and lists.
DIAGRAM = """
kind = "diagram"
title = "a diagram with a number in every kind of place"
connect = ["-plant -> hook", "hook -> law", "law + load -> gear", "gear -> filter", "filter -> plant"]
[parameters]
catch = 1.0
half = "catch/2"
[inputs]
load = {load}
[blocks]
plant = {{ kind = "state_space", A = [[{A}, 1], [0, -1]], B = [[0], [{B}]], C = [[1, 0]], start = [{start}, 0] }}
filter = {{ kind = "transfer_function", num = [{num}], den = [1, {den}] }}
law = {{ kind = "gain", gain = {gain} }}
[elements]
gear = {{ element = "play", gap = {gap}, memory = {memory} }}
[elements.hook]
element = "automaton"
start_mode = "free"
start_memory = [0.0]
modes.free = {{ constant = {mode} }}
modes.up = {{ from_input = 1 }}
guards = [
{{ mode = "free", target = "up", on_input = {on_input}, constant = "-catch", memory_constant = [{reset}] }},
{{ mode = "up", target = "free", on_input = -1, constant = {guard} }},
]
[run]
t_end = {t_end}
"""
NUMBERS = {
    "load": "0", "A": "-1", "B": "1", "start": "0", "num": "1", "den": "2", "gain": "1", "gap": "0.1", "memory": "0",
    "mode": "0", "on_input": "1", "reset": "0", "guard": '"catch/2"', "t_end": '"5 s"',
}  # fmt: skip
WRONG = [
    "'-cach'",
    "'2 parsecs of it'",
    "'catch +'",
    "''",
    "'half half'",
    "{}",
    "[]",
    "true",
    "[['cach']]",
    "1e999",
    "nan",
]


BEHIND = """
kind = "diagram"
title = "a play and a saturation behind expressions"
connect = ["-plant.angle -> gear", "gear -> limit", "limit -> plant.voltage", "0 -> plant.torque"]
[parameters]
ratio = 50
slack = "0.1 deg"
half = "slack/2"
[blocks]
plant = { kind = "motor", resistance = 1, torque_constant = 1, inertia = 1, ratio = "ratio" }
[elements]
gear = { kind = "play", gap = "half" }
limit = { kind = "saturation" }
"""


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            {"slack": "-1 deg"},
            "--set: slack is '-1 deg'; expected a value with which elements.gear.gap is zero or more",
        ),
        ({"half": "-1 deg"}, "--set: half is '-1 deg'; expected zero or more."),
        ({"ratio": 0}, "--set: ratio is 0; expected a number other than zero."),
        ({"half": "slack/0"}, "--set: half is 'slack/0'; expected a divisor"),
        (
            {"slack": "-1 deg", "half": "slack"},
            ".gap is 'half'; expected zero or more: half is -1 deg, with half and slack",
        ),
    ],
)
def test_what_is_set_is_refused_by_its_own_name_however_deep_it_is_used(values: dict[str, object], said: str) -> None:
    case = epp.case_from_text(BEHIND)
    with pytest.raises(epp.CaseError) as caught:
        case.with_values(values, "--set")
    assert said in str(caught.value)


def test_what_a_file_sets_of_its_base_is_refused_in_that_file(tmp_path: Path) -> None:
    (tmp_path / "whole.toml").write_text(BEHIND)
    own = tmp_path / "own.toml"
    own.write_text('base = "whole"\ntitle = "own"\n[parameters]\nslack = "-1 deg"\n')
    [said] = map(str, mistakes_in(own).found)
    assert said.startswith(
        f"{own}: parameters.slack is '-1 deg'; expected a value with which elements.gear.gap is zero"
    )


@pytest.mark.parametrize(
    ("changed", "field", "value", "expected"),
    [
        (('mode = "free", target = "up"', 'mde = "free", target = "up"'), "hook.guards.0.mde", "'free'", "'mode'"),
        (("from_input = 1", 'from_inptu = "cach"'), "hook.modes.up.from_inptu", "'cach'", "'from_input'"),
        (("gap = 0.1", 'gp = "slack"'), "gear.gp", "'slack'", "'gap'"),
        (("gap = 0.1", 'gap = ["half"]'), "gear.gap", "['half']", "a number with or without a unit."),
    ],
)
def test_a_misspelt_field_is_named_before_its_text_is_taken_for_an_expression(
    tmp_path: Path, changed: tuple[str, str], field: str, value: str, expected: str
) -> None:
    path = tmp_path / "drawn.toml"
    path.write_text(DIAGRAM.format(**NUMBERS).replace(*changed))
    [said] = map(str, mistakes_in(path).found)
    assert said.startswith(f"{path}: elements.{field} is {value}; expected") and expected in said


def test_a_name_where_nothing_has_one_has_no_list_of_none(tmp_path: Path) -> None:
    path = tmp_path / "bare.toml"
    path.write_text('kind = "diagram"\ntitle = "bare"\nconnect = ["-plant -> servo"]\n')
    said = [str(error) for error in mistakes_in(path).found]
    assert said and all("one of none" not in sentence for sentence in said)
    assert any("in place of 'servo': there is none." in sentence for sentence in said)


#: Two for each place, each of them at two places or more.
@pytest.mark.parametrize(
    ("place", "wrong"), [(place, WRONG[(i + k) % len(WRONG)]) for i, place in enumerate(NUMBERS) for k in (0, 5)]
)
def test_a_wrong_number_anywhere_is_told_in_sentences(tmp_path: Path, place: str, wrong: str) -> None:
    path = tmp_path / "drawn.toml"
    path.write_text(DIAGRAM.format(**NUMBERS | {place: wrong}))
    found = CliRunner().invoke(app, ["check", str(path)])
    assert found.exit_code == 2, found.output
    assert isinstance(found.exception, SystemExit), found.exception
    lines = found.stderr.strip().splitlines()
    assert lines and all("expected" in line or "not checked before" in line for line in lines), lines
    assert not found.stdout


def test_the_diagram_itself_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "drawn.toml"
    path.write_text(DIAGRAM.format(**NUMBERS))
    assert CliRunner().invoke(app, ["check", str(path)]).exit_code == 0


MUTATED = ["robot_servo", "fig8a_original", "wheelchair", "relay_fopdt_closed"]
CHANGES = {
    "misspelt": lambda holder, key: holder.__setitem__(f"{str(key)[:-1]}q", holder.pop(key)),
    "gone": lambda holder, key: holder.__delitem__(key),
    "a text": lambda holder, key: holder.__setitem__(key, "no such thing"),
    "a list": lambda holder, key: holder.__setitem__(key, [["a"], 1]),
    "a table": lambda holder, key: holder.__setitem__(key, {"value": {"value": 1}}),
    "huge": lambda holder, key: holder.__setitem__(key, 1e300),
}


def _places(data, path=()):
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from _places(value, (*path, key))


@pytest.mark.slow
@pytest.mark.parametrize("turn", range(2))
@pytest.mark.parametrize("name", MUTATED)
def test_check_and_simulate_say_the_same_of_a_file_that_is_changed_in_one_place(
    tmp_path: Path, name: str, turn: int
) -> None:
    """Every key of every table: valid, or sentences and no traceback; and what is valid can be run.

    Two changes at each place, other ones from place to place.
    """
    told = ("expected", "not checked before", "is its unit right?")
    whole, path = tomllib.loads(epp.case(name).to_toml()), tmp_path / "changed.toml"
    for i, place in enumerate(_places(whole)):
        change = list(CHANGES)[(i + 3 * turn) % len(CHANGES)]
        data = copy.deepcopy(whole)
        holder = data
        for key in place[:-1]:
            holder = holder[key]
        if change == "misspelt" and isinstance(holder, list):
            continue
        CHANGES[change](holder, place[-1])
        path.write_text(write_toml(data), encoding="utf-8")
        found = CliRunner().invoke(app, ["check", str(path)])
        assert found.exit_code in (0, 2) and "Traceback" not in found.output, (place, found.exception)
        lines = found.stderr.strip().splitlines()
        if found.exit_code == 2:
            assert lines and all(any(word in x for word in told) for x in lines), (place, lines)
        else:
            with np.errstate(all="ignore"):
                end = None if "t_end" in data.get("run", {}) else 1.0  # without it only runs are refused
                epp.simulate(epp.read_case(path), t_end=end, max_steps=100)


def test_a_name_that_connections_cannot_have_is_one_mistake_and_how_to_rename_it_is_said(tmp_path: Path) -> None:
    """An element is none of the blocks, though it is named in none of them; a signal's name stands in no connection."""
    path = tmp_path / "named.toml"
    path.write_text(
        """
kind = "diagram"
title = "A name of a block diagram elsewhere"
connect = ["-gap -> motor", "motor -> gap"]
signals."Motor/Angle 1" = "motor"
run = { t_end = "1 s" }
[blocks]
motor = { kind = "transfer_function", num = [5], den = [1, 1, 0] }
[elements]
gap = { element = "play", gap = 2.0 }
"my-relay" = { element = "relay" }
""",
        encoding="utf-8",
    )
    (found,) = mistakes_in(path).found
    assert found.field == "elements.my-relay"
    assert found.expected.endswith("such as 'my_relay' here and wherever it is named")
    path.write_text(path.read_text(encoding="utf-8").replace('"my-relay"', "# my-relay"), encoding="utf-8")
    assert "Motor/Angle 1" in epp.read_case(path).to_system().signals.names


@pytest.mark.parametrize(
    ("typed", "shown"),
    [
        ("true", "true"),
        ("false", "false"),
        ("2024-01-31", "2024-01-31"),
        ("12:30:00", "12:30:00"),
        ("2024-01-31T12:30:00", "2024-01-31T12:30:00"),
        ("[1, true]", "[1, true]"),
        ('{ m = true, n = "a" }', "{m = true, n = 'a'}"),
    ],
)
def test_a_value_is_shown_as_it_was_typed(typed: str, shown: str) -> None:
    text = epp.case("relay_deadzone").to_toml()
    title = next(line for line in text.splitlines() if line.startswith("title"))
    with pytest.raises(epp.EppError) as caught:
        epp.case_from_text(text.replace(title, f"title = {typed}"), name="mine")
    assert f"title is {shown}; expected" in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32-le"])
def test_a_file_in_another_encoding_is_called_that(encoding: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(epp.case("relay_deadzone").to_toml().encode(encoding))
    with pytest.raises(epp.EppError, match=r"is 'not UTF-8 .*byte [013].*expected a TOML file in UTF-8"):
        epp.read_case(file)
