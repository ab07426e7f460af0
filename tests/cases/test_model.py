"""Case files: what they give, what they refuse and in which words, inheritance, changes, export."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cases import Case, case, json_schema, read_case, shipped_cases, shipped_cases_folder
from eppanalysis.errors import CaseError
from tests.shared import of_kind

BASE = (shipped_cases_folder() / "elbow.toml").read_text(encoding="utf-8")
LOOP = """kind = "loop"
title = "a loop"
[loop]
num = [5.0]
den = [1, 1, 0]
[[loop.elements]]
element = "play"
gap = 2.0
[run]
t_end = "10 s"
"""
VERIFICATION = {
    "relay_ideal_khalil79": (1.4142135623730951, 1.3805948690247447),
    "backlash_servo": (0.31814239915748294, 1.573232105584232),
    "sat_asymmetric": (1.414213562373095, 1.361590719348686),
    "van_der_pol_mu1": (1.0, 0.9429558474416091),
}
TRUTH_TABLE = {
    "fig8a_original": "oscillate",
    "fig8b_reduced_backlash": "settle",
    "gain_brings_it_back": "oscillate",
    "fig6a_original_pulley": "oscillate",
    "fig6b_ball_bearing": "settle",
    "soft_cable": "settle",
    "light_forearm": "settle",
    "upright": "settle",
}


def write(folder: Path, text: str, name: str = "bad.toml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(path: Path) -> CaseError:
    with pytest.raises(CaseError) as caught:
        read_case(path)
    error = caught.value
    sentence = str(error)
    assert "\n" not in sentence and sentence.endswith((".", "?")) and len(sentence) < 1200
    assert error.source in sentence and error.expected in sentence
    assert error.field in sentence
    return error


@pytest.mark.parametrize(
    ("overrides", "field", "shown", "expected"),
    [
        ('[lock_pin]\nbacklash = "2.5 kg"', "lock_pin.backlash", "2.5 kg", "an angle such as '2.5 deg'"),
        ('[bands]\nrange = "1 lb"', "bands.range", "1 lb", "write lbf"),
        ('[lock_pin]\nbacklsh = "2.5 deg"', "lock_pin.backlsh", "2.5 deg", "did you mean 'backlash'"),
        ('[lockpin]\nbacklash = "2.5 deg"', "lockpin", {"backlash": "2.5 deg"}, "did you mean 'lock_pin'"),
        ('[cable]\nstiffness = "-6705 N/m"', "cable.stiffness", "-6705 N/m", "a positive number"),
        ("[lock_pin]\nstiffness = nan", "lock_pin.stiffness", None, "a finite number"),
        ("[forearm]\ninertia = inf", "forearm.inertia", np.inf, "a finite number"),
        ("[drive]\ninertia = true", "drive.inertia", True, "a moment of inertia"),
        ('[drive]\ninertia = "heavy"', "drive.inertia", "heavy", "a moment of inertia"),
        ("[drive]\ninertia = [1, 2]", "drive.inertia", [1, 2], "a moment of inertia"),
        ('[drive]\nno_load_speed = "2 Hz"', "drive.no_load_speed", "2 Hz", "write turn/s"),
        ('[pulley]\nkinetic_ratio = "120 %"', "pulley.kinetic_ratio", "120 %", "at most 1"),
        ("[pulley]\nfriction = 1.5", "pulley.friction", 1.5, "never slides"),
        (
            '[bands]\nslack="1 lbf"\nlow="3 lbf"\nhigh="2 lbf"\nmax="4 lbf"',
            "bands.high",
            "2 lbf",
            "more than bands.low",
        ),
        ('[bands]\nslack = "1 lbf"', "bands.low", None, "either centre"),
        ('[bands]\nslack = "1 lbf"\nrange = "2 lbf"', "bands.slack", "1 lbf", "not both"),
        ('[bands]\nparking_width = "3 lbf"', "bands.parking_width", "3 lbf", "less than bands.range"),
        ('[forearm]\ninertia = 1\nprehensor_mass = "1 kg"', "forearm.prehensor_mass", "1 kg", "not both"),
        ('[cable]\npretension = "1 lbf"', "cable.pretension", "1 lbf", "antagonist"),
        ("[sensor]\nbits = 12.5", "sensor.bits", 12.5, "a whole number from 1 to 24"),
        ('[cable]\nantagonist = "perhaps"', "cable.antagonist", "perhaps", "true or false"),
        ('[run]\nt_end = "-1 s"', "run.t_end", "-1 s", "a positive number"),
        ('[run]\ninput = { kind = "jump" }', "run.input.kind", "jump", "'step'"),
        ('[run]\ninput = { kind = "step", size = "2 kg" }', "run.input.size", "2 kg", "a quantity in m"),
        ('[run]\ninput = { kind = "steps", times = ["0 s"], values = [] }', "run.input.values", [], ""),
        (
            '[run]\ninput = { kind = "steps", times = ["0 s", "1 s"], values = ["1 mm"] }',
            "run.input.values",
            "1 long",
            "2 values, one for each time",
        ),
        (
            '[run]\ninput = { kind = "steps", times = ["1 s", "1 s"], values = ["1 mm", "0 mm"] }',
            "run.input.times.1",
            "1 s",
            "a later time",
        ),
        (
            '[run]\ninput = { kind = "steps", times = ["0 s"], values = ["1 kg"] }',
            "run.input.values.0",
            "1 kg",
            "a quantity in m",
        ),
        ('[run]\ninput = { kind = "recorded", file = "../x.csv" }', "run.input.file", "../x.csv", "name"),
        ('[run]\ninput = { kind = "recorded", file = "x.csv" }', "run.input.file", "x.csv", "in the case's folder"),
        ('[drive]\ninertia = { value = "1 kg*m^2", mark = "guess" }', "drive.inertia.mark", "guess", "paper, derived"),
        ('[drive]\ninertia = { value = 1, colour = "red" }', "drive.inertia", None, "without 'colour'"),
        ('[drive]\ninertia = { value = 1, tolerance = "-5 %" }', "drive.inertia.tolerance", "-5 %", "not negative"),
        ("[pulley]\nradius = 1e308", "pulley.radius", None, "from 1e-50 to 1e+50 in size"),
        ('[expected]\noutcome = "explode"', "expected.outcome", "explode", "'oscillate' or 'settle'"),
    ],
)
def test_overrides_that_are_refused(tmp_path: Path, overrides: str, field: str, shown: object, expected: str) -> None:
    path = write(tmp_path, f'base = "elbow"\ntitle = "bad"\n{overrides}\n')
    error = refusal(path)
    assert (error.source, error.field) == (str(path), field)
    assert expected in error.expected
    if shown is not None:
        assert error.value == shown


@pytest.mark.parametrize(
    "line", [line for line in BASE.splitlines() if line.startswith(("inertia", "delay", "radius"))]
)
def test_missing_field(tmp_path: Path, line: str) -> None:
    text = BASE.replace(line, "", 1)
    error = refusal(write(tmp_path, text))
    assert error.field.endswith(line.partition(" ")[0]) and "is missing" in str(error) and "such as" in error.expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "a case file with at least a title"),
        ("   \n# nothing\n", "a case file with at least a title"),
        ("this is no TOML", "a TOML file"),
        ('title = "a"\ntitle = "b"', "a TOML file"),
        ("x = " + "[" * 5000 + "]" * 5000, "levels"),
        (".".join(["a"] * 60) + " = 1", "levels"),
        ("x = " + "1" * 6000, "numbers of ordinary length"),
        ('title = "' + "x" * 1_100_000 + '"', "at most 1000000 bytes"),
    ],
)
def test_files_that_are_refused(tmp_path: Path, text: str, expected: str) -> None:
    error = refusal(write(tmp_path, text))
    assert error.field == "" and expected in error.expected


def test_files_that_are_not_there_or_no_text(tmp_path: Path) -> None:
    assert refusal(tmp_path / "none.toml").expected == "a case file"
    assert refusal(tmp_path).value == "a folder"
    (tmp_path / "latin.toml").write_bytes(b'title = "\xff\xfe"')
    assert "UTF-8" in refusal(tmp_path / "latin.toml").expected


def test_long_values_are_cut_in_the_sentence(tmp_path: Path) -> None:
    path = write(tmp_path, f'base = "elbow"\ntitle = "bad"\n[drive]\ninertia = "{"9" * 100_000}"')
    assert len(str(refusal(path))) < 400


@pytest.mark.parametrize("base", ["../secret", "/etc/passwd", "sub/base", "..", "nowhere", ""])
def test_bases_outside_the_folder(tmp_path: Path, base: str) -> None:
    write(tmp_path, BASE, "secret.toml")
    folder = tmp_path / "inner"
    folder.mkdir()
    error = refusal(write(folder, f'base = "{base}"\ntitle = "bad"'))
    assert error.field == "base" and error.value == base and "same folder" in error.expected


def test_base_of_another_type(tmp_path: Path) -> None:
    assert refusal(write(tmp_path, 'base = 3\ntitle = "bad"')).field == "base"


def test_base_by_a_link_out_of_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "inner"
    folder.mkdir()
    (folder / "linked.toml").symlink_to(write(tmp_path, BASE, "outside.toml"))
    assert "same folder" in refusal(write(folder, 'base = "linked"\ntitle = "bad"')).expected


def test_a_file_with_the_name_of_a_shipped_case_may_inherit_from_that(tmp_path):
    (tmp_path / "elbow.toml").write_text('base = "elbow"\ntitle = "mine"\n')
    case = read_case(tmp_path / "elbow.toml")
    assert case.title == "mine" and case.value("lock_pin.backlash") == epp.case("elbow").value("lock_pin.backlash")


def test_bases_in_a_circle(tmp_path: Path) -> None:
    path = write(tmp_path, 'base = "bad"\ntitle = "bad"')
    assert "inherit from itself" in refusal(path).expected
    first = write(tmp_path, 'base = "second"\ntitle = "one"', "first.toml")
    write(tmp_path, 'base = "first"\ntitle = "two"', "second.toml")
    error = refusal(first)
    assert "inherit from itself" in error.expected and error.source.endswith("second.toml")


def test_endless_chain_of_bases(tmp_path: Path) -> None:
    for i in range(20):
        write(tmp_path, f'base = "c{i + 1}"\ntitle = "x"', f"c{i}.toml")
    assert "one behind the other" in refusal(tmp_path / "c0.toml").expected


def test_error_in_a_base_names_the_base(tmp_path: Path) -> None:
    base = write(tmp_path, BASE.replace('"19 mm"', '"19 kg"'), "mine.toml")
    error = refusal(write(tmp_path, 'base = "mine"\ntitle = "child"', "child.toml"))
    assert error.source == str(base) and error.field == "pulley.radius"


@pytest.mark.parametrize(
    ("change", "field", "expected"),
    [
        (("num = [5.0]", "num = [1, 2, 3, 4, 5.0]"), "loop.num", "at most the degree of the denominator"),
        (("num = [5.0]", "num = [nan]"), "loop.num.0", "a finite number"),
        (("num = [5.0]", 'num = ["x"]'), "loop.num.0", "a number"),
        (("den = [1, 1, 0]", ""), "loop.den", "a value"),
        (('element = "play"', 'element = "ply"'), "loop.elements.0.element", "did you mean 'play'"),
        (("gap = 2.0", "gp = 2.0"), "loop.elements.0.gp", "did you mean 'gap'"),
        (("gap = 2.0", ""), "loop.elements.0.gap", "play needs it"),
        (("gap = 2.0", "gap = -2.0"), "loop.elements.0.gap", ""),
        (("gap = 2.0", "gap = inf"), "loop.elements.0.gap", "a finite number"),
        (
            ('element = "play"\ngap = 2.0', 'element = "quantiser"\nstep = 1\nlevels = 1e9'),
            "loop.elements.0.levels",
            "a whole number",
        ),
        (("den = [1, 1, 0]", "den = [5e-324, 1, 0]"), "loop", "from 1e-50 to 1e+50"),
        (("gap = 2.0", "gap = true"), "loop.elements.0.gap", "a number"),
        (("num = [5.0]", "num = [5.0]\nA = [[1]]"), "loop", "exactly one of"),
        (("num = [5.0]", "num = [5.0]\nD = [[1]]"), "loop.D", "beside A, B and C"),
        (("num = [5.0]", "num = [5.0]\ninitial_state = [1, 2, 3]"), "loop.initial_state", "2 numbers"),
        (("num = [5.0]", "num = [5.0]\nfeedback = 2"), "loop.feedback", "-1 or 1"),
        (("num = [5.0]\nden = [1, 1, 0]", "A = [[1, 2], [3]]\nB = [[1]]\nC = [[1]]"), "loop.A", "rows of equal"),
        (("num = [5.0]\nden = [1, 1, 0]", "blocks = []"), "loop.blocks", "a value: a loop of blocks needs it"),
        (("num = [5.0]\nden = [1, 1, 0]", "A = [[1, 2]]\nB = [[1]]\nC = [[1]]"), "loop.A", "a square"),
        (('kind = "loop"', 'kind = "looop"'), "kind", "'elbow' or 'loop'"),
        (('kind = "loop"', "kind = [1]"), "kind", "'elbow' or 'loop'"),
        (('t_end = "10 s"', 't_end = "10 s"\ninput = { kind = "step", size = 1 }'), "run.input", "no input"),
        (('t_end = "10 s"', 't_end = "10 s"\n[expected]\nsignal = "z"'), "expected.signal", "one of x, y"),
    ],
)
def test_loops_that_are_refused(tmp_path: Path, change: tuple[str, str], field: str, expected: str) -> None:
    assert change[0] in LOOP
    error = refusal(write(tmp_path, LOOP.replace(*change)))
    assert error.field == field and expected in error.expected


#: Elements with units, each valid; and what is wrong in one of their fields, in units other than SI.
SOUND = {
    "five_band_law": {"slack": "1 lbf", "low": "2 lbf", "high": "3 lbf", "max": "4 lbf", "supply_voltage": "16000 mV"},
    "saturation": {"lower": "-2 lbf", "upper": "2 lbf", "slope": "3 lbf/inch"},
    "dead_zone": {"lower": "-2 mm", "upper": "2 mm"},
    "relay_dead_zone": {"threshold": "2 deg", "level": "300 mV"},
    "quantiser": {"step": "5 mV", "levels": "300 %"},
    "friction": {"coulomb": "1 lbf", "static": "2 lbf"},
    "hysteresis_relay": {"lower": "-1 deg", "upper": "1 deg", "low": -1, "high": 1},
    "hysteresis_relay_dead_zone": {"on": "4 mm", "off": "2 mm", "level": 1},
    "play": {"gap": "2 deg"},
    "jump_and_follow": {"stick_band": "2 mm", "slip_jump": "1 mm"},
    "stiction_pulley": {
        "harness_stiffness": "1 lbf/mm", "forearm_stiffness": "2 lbf/mm", "friction": "5 %", "kinetic_ratio": "80 %",
    },
    "lock_pin": {"gap": "2 deg", "stiffness": "3 lbf*inch/deg", "damping": "1 N*m*ms/deg"},
    "piecewise_linear": {"breakpoints": ["-1 mm", "1 mm"], "slopes": [0, 1, 0], "intercepts": [0, 0, 0]},
}  # fmt: skip
UNSOUND = [
    ("five_band_law", "low", "-4 lbf"), ("five_band_law", "high", "1.5 lbf"), ("five_band_law", "max", "1 N"),
    ("five_band_law", "supply_voltage", "-9 mV"), ("saturation", "upper", "-3 lbf"),
    ("saturation", "slope", "-3 lbf/inch"), ("dead_zone", "upper", "-0.1 inch"),
    ("relay_dead_zone", "threshold", "-2 deg"),
    ("quantiser", "step", "-5 mV"), ("quantiser", "levels", "250 %"), ("friction", "coulomb", "-1 lbf"),
    ("friction", "static", "0.5 lbf"), ("hysteresis_relay", "upper", "-1.5 deg"),
    ("hysteresis_relay_dead_zone", "off", "5 mm"), ("play", "gap", "-2 deg"), ("play", "gap", "1e308 km"),
    ("jump_and_follow", "slip_jump", "-1 mm"), ("stiction_pulley", "friction", "120 %"),
    ("stiction_pulley", "forearm_stiffness", "-2 lbf/mm"), ("lock_pin", "stiffness", "-3 lbf*inch/deg"),
    ("lock_pin", "damping", "-1 N*m*ms/deg"), ("piecewise_linear", "breakpoints", ["1 mm", "-1 mm"]),
]  # fmt: skip


def loop_of(fields: dict[str, object]) -> str:
    """A loop of one element and one state."""
    inputs = 2 if fields["element"] == "lock_pin" else 1
    outputs = 2 if fields["element"] == "stiction_pulley" else 1
    text = LOOP.replace("num = [5.0]\nden = [1, 1, 0]", f"A = [[-1]]\nB = [{[1] * outputs}]\nC = {[[1]] * inputs}")
    return text.replace('element = "play"\ngap = 2.0', "\n".join(f"{k} = {json.dumps(v)}" for k, v in fields.items()))


@pytest.mark.parametrize(("kind", "field", "typed"), UNSOUND)
def test_elements_are_refused_in_the_words_of_the_file(tmp_path: Path, kind: str, field: str, typed: object) -> None:
    sound = {"element": kind, **SOUND[kind]}
    found = read_case(write(tmp_path, loop_of(sound), "sound.toml"))
    where = f"loop.elements.0.{field}"
    path = write(tmp_path, loop_of({**sound, field: typed}))
    error = refusal(path)
    assert (error.source, error.field, error.value) == (str(path), where, typed)
    assert str(error).startswith(f"{path}: {where} is {typed!r}; expected ")
    other = re.search(r"\((.*)\)", error.expected)
    assert other is None or kind == "quantiser" or other[1] in sound.values()
    with pytest.raises(CaseError) as caught:
        found.with_values({f"{kind}.{field}": typed}, "--set")
    named = f"{kind}.{field}"  # as it was set, not where it stands in the file
    assert (caught.value.source, caught.value.field, caught.value.value) == ("--set", named, typed)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"bands.parking_width": "20 N"}, "bands.parking_width"),
        ({"bands.parking_width": 20}, "bands.parking_width"),
        ({"bands.slack": "9 N", "bands.low": "8 N", "bands.high": "2 lbf", "bands.max": "3 lbf"}, "bands.low"),
        ({"bands.offset_voltage": "90000 mV"}, "bands.offset_voltage"),
        ({"forearm.upright": True, "forearm.gravity_moment": "3 lbf*inch"}, "forearm.gravity_moment"),
        ({"cable.pretension": "9 N"}, "cable.pretension"),
        ({"controller.sample_period": "0.01 s", "parking.dwell_time": "0.2 s"}, "parking.dwell_time"),
        ({"pulley.friction": "150 %"}, "pulley.friction"),
        ({"pulley.flexion_angle": "1 turn"}, "pulley.flexion_angle"),
        ({"lock_pin.backlash": "-1 mrad"}, "lock_pin.backlash"),
        ({"harness.step": "1 kg"}, "harness.step"),
        ({"run.input": {"kind": "ramp", "rate": "1 inch/s", "start": "2 s", "stop": "1 s"}}, "run.input.stop"),
        ({"run.input": {"kind": "step", "size": "2 lbf"}}, "run.input.size"),
        ({"run.input": {"kind": "sine", "amplitude": "2 mm", "frequency": "-2 Hz"}}, "run.input.frequency"),
    ],
)
def test_elbows_are_refused_in_the_words_of_the_user(changes: dict[str, object], field: str) -> None:
    with pytest.raises(CaseError) as caught:
        case("elbow").with_values(changes, "--set")
    error, section = caught.value, field.rpartition(".")
    typed = changes[field] if field in changes else changes[section[0]][section[2]]
    assert (error.source, error.field, error.value) == ("--set", field, typed)
    assert str(error).startswith(f"--set: {field} is {typed!r}; expected ")


def test_an_error_names_the_file_of_the_field(tmp_path: Path) -> None:
    """In lists of elements as elsewhere: what --set leaves alone is the file's, what a file replaces is that file's."""
    sound = {"element": "saturation", **SOUND["saturation"]}
    base = write(tmp_path, loop_of(sound), "mine.toml")
    with pytest.raises(CaseError) as caught:
        read_case(base).with_values({"saturation.lower": "3 lbf"}, "--set")
    assert (caught.value.source, caught.value.value) == (str(base), "2 lbf") and "(3 lbf)" in str(caught.value)
    del sound["upper"]
    child = 'base = "mine"\ntitle = "child"\n[[loop.elements]]\nelement = "play"\n'
    error = refusal(write(tmp_path, child, "child.toml"))
    assert error.source.endswith("child.toml") and error.field == "loop.elements.0.gap"


@pytest.mark.parametrize(
    ("line", "field", "typed"),
    [
        ("initial_state = [1, 2, 3]", "loop.initial_state", [1, 2, 3]),
        ("input_matrix = [[1], [2]]\ninputs = ['u']", "loop.input_matrix", [[1], [2]]),
        ("D = [[0, 0]]", "loop.D", [[0, 0]]),
        ("constant_state = [1, 2]", "loop.constant_state", [1, 2]),
    ],
)
def test_matrices_are_refused_as_the_file_calls_them(tmp_path: Path, line: str, field: str, typed: object) -> None:
    text = LOOP.replace("num = [5.0]\nden = [1, 1, 0]", f"A = [[-1]]\nB = [[1]]\nC = [[1]]\n{line}")
    error = refusal(write(tmp_path, text))
    assert (error.field, error.value) == (field, typed) and str(typed) in str(error)


def test_a_recording_beyond_all_numbers_is_refused(tmp_path: Path) -> None:
    write(tmp_path, "time [s], position [km]\n0, 0\n1, 1e308\n", "far.csv")
    error = refusal(
        write(tmp_path, 'base = "elbow"\ntitle = "x"\n[run]\ninput = {kind = "recorded", file = "far.csv"}')
    )
    assert error.field == "run.input" and "values[1] is inf" in str(error) and "far.csv" in str(error)


def test_how_a_published_number_is_known_is_said_in_one_of_three_ways():
    for name in shipped_cases():
        known = {"read in a source", "not read in the source", "recomputed"}
        assert {number.how_known for number in case(name).expected.published} <= known


def test_shipped_case() -> None:
    for name in shipped_cases():
        found = case(name)
        system = found.to_system()
        n, nw = system.B.shape
        assert system.A.shape == (n, n) and system.C.shape == (sum(e.n_inputs for e in system.elements), n)
        assert nw == sum(e.n_outputs for e in system.elements)
        assert system.name == found.name == name and found.title and found.t_end > 0
        assert all(p.mark in ("paper", "derived", "assumed", "measured", "tunable") for p in found.parameters.values())
        assert found.expected.source
        json.dumps(found.provenance())


def test_exported_case_is_the_same(tmp_path: Path) -> None:
    for name in shipped_cases():
        found = case(name)
        again = read_case(write(tmp_path, found.to_toml(), f"{name}.toml"))
        assert again.parameters == found.parameters and again.expected == found.expected and again.t_end == found.t_end
        for matrix in ("A", "B", "C", "D", "x0", "v0"):
            np.testing.assert_array_equal(getattr(again.to_system(), matrix), getattr(found.to_system(), matrix))
        assert again.provenance()["sha256"] == found.provenance()["sha256"]


@pytest.mark.parametrize(("name", "outcome"), TRUTH_TABLE.items())
def test_truth_table(name: str, outcome: str) -> None:
    found = case(name)
    assert found.expected.outcome == outcome and found.expected.paper and found.expected.finding
    assert isinstance(found.input, epp.inputs.Step) and found.input.size == pytest.approx(0.020, rel=1e-15)


def test_truth_table_overrides_only() -> None:
    for name in TRUTH_TABLE:
        text = (shipped_cases_folder() / f"{name}.toml").read_text(encoding="utf-8")
        assert text.startswith('base = "elbow"') and len(text.splitlines()) < 25


@pytest.mark.parametrize(("name", "omegas"), VERIFICATION.items())
def test_answers_of_loops(name: str, omegas: tuple[float, float]) -> None:
    expected = case(name).expected
    assert expected.describing_function is not None and expected.exact is not None
    assert (expected.describing_function[0].omega, expected.exact[0].omega) == omegas


def test_first_order_answers_close_the_loop() -> None:
    """``H(j omega) N = 1`` and the balance of means hold at each answer, so signs and units of the file are right."""
    for name in of_kind("loop"):
        found = case(name)
        system, answers = found.to_system(), found.expected.describing_function or ()
        if len(system.elements) > 1:
            continue  # a cascade is checked where it is predicted
        for answer in answers:
            element, mean = system.elements[0], answer.mean or 0.0
            out, gain = element.describing_function(answer.amplitude, mean, answer.omega)
            # From the element's outputs to its first input; another input is the rate of that one.
            around = system.frequency_response(answer.omega)[0] @ np.atleast_1d(gain)
            assert complex(around) == pytest.approx(1.0, abs=1e-9)
            if answer.mean is not None:
                static = system.D - system.C @ np.linalg.solve(system.A, system.B)
                assert float(static[0] @ np.atleast_1d(out)) == pytest.approx(mean, rel=1e-9)


def test_nominal_values_of_the_elbow() -> None:
    found = case("elbow")
    parameters = found.elbow_parameters
    pound = 4.4482216152605
    assert parameters.drive.no_load_speed == pytest.approx(np.radians(164), rel=1e-14)
    assert parameters.lock_pin.backlash == pytest.approx(np.radians(2.5), rel=1e-14)
    assert parameters.bands.thresholds == pytest.approx([b * pound for b in (1.25, 2.4, 2.6, 3.75)], rel=1e-14)
    # Equations (1) and (2) of the paper: a gap of 2.5 deg changes the cable force by 1.25 lbf.
    change = parameters.cable.stiffness * parameters.pulley.radius * parameters.lock_pin.backlash
    assert change == pytest.approx(1.25 * pound, rel=3e-4)  # K R is rounded to 127.4 N/rad
    assert found.parameters["lock_pin.backlash"].mark == "paper"
    assert found.parameters["drive.stall_torque"].mark == "derived"


def test_inheritance_replaces_alternatives(tmp_path: Path) -> None:
    four = '[bands]\nslack = "1 lbf"\nlow = "2 lbf"\nhigh = "2.5 lbf"\nmax = "4 lbf"\n'
    child = read_case(write(tmp_path, f'base = "elbow"\ntitle = "child"\n{four}', "child.toml"))
    assert "bands.range" not in child.parameters
    assert child.value("bands.range") == pytest.approx(3 * 4.4482216152605)
    three = '[bands]\ncentre = "2 lbf"\nparking_width = "0.2 lbf"\nrange = "2 lbf"\n'
    grandchild = read_case(write(tmp_path, f'base = "child"\ntitle = "grandchild"\n{three}', "grandchild.toml"))
    assert "bands.slack" not in grandchild.parameters and grandchild.value("bands.slack") > 0
    heavy = '[forearm]\nprehensor_mass = "0.9 kg"\n'
    heavier = read_case(write(tmp_path, f'base = "elbow"\ntitle = "heavy"\n{heavy}', "heavy.toml"))
    assert heavier.value("forearm.inertia") == pytest.approx(0.9 * 0.3**2 + 0.006)
    upright = read_case(write(tmp_path, 'base = "elbow"\ntitle = "up"\n[forearm]\nupright = true\n', "up.toml"))
    assert upright.value("forearm.gravity_moment") == pytest.approx(0.45 * 9.80665 * 0.30)


def test_one_threshold_or_width_leaves_the_others_where_they_are() -> None:
    found = case("fig8a_original")
    slack, low, high, top = found.elbow_parameters.bands.thresholds
    moved = found.with_values({"bands.low": 0.9 * low})
    assert moved.elbow_parameters.bands.thresholds == pytest.approx((slack, 0.9 * low, high, top), rel=1e-12)
    # Not symmetric any more: there are no widths that could stay.
    with pytest.raises(CaseError, match="bands.centre is missing"):
        moved.with_values({"bands.range": "3 lbf"})
    back = found.with_values({"bands.low": low}).with_values({"bands.range": "3 lbf"})
    wide = found.with_values({"bands.range": "3 lbf"})
    assert back.elbow_parameters.bands.thresholds == pytest.approx(wide.elbow_parameters.bands.thresholds, rel=1e-12)


def test_mass_of_the_prehensor_follows_from_the_inertia() -> None:
    found = case("fig8a_original")
    assert found.value("forearm.prehensor_mass") == pytest.approx(0.45)
    same = found.with_values({"forearm.prehensor_mass": found.value("forearm.prehensor_mass")})
    assert same.value("forearm.inertia") == pytest.approx(found.value("forearm.inertia"), rel=1e-12)
    with pytest.raises(CaseError, match="is missing"):
        found.with_values({"forearm.inertia": "0.006 kg*m^2"}).value("forearm.prehensor_mass")


def test_answers_are_not_inherited(tmp_path: Path) -> None:
    child = read_case(write(tmp_path, 'base = "backlash_servo"\ntitle = "x"\n[loop]\nnum = [4.0]\n', "child.toml"))
    expected = child.expected
    assert (expected.describing_function, expected.exact, expected.outcome) == (None, None, None)
    assert expected.signal == "x"
    original = case("fig8a_original")
    assert original.with_values({"lock_pin.backlash": "0.1 deg"}).expected.outcome is None
    assert original.with_values({"run.t_end": "3 s"}).expected.outcome == "oscillate"


def test_note_alone_keeps_the_inherited_value(tmp_path: Path) -> None:
    text = 'base = "elbow"\ntitle = "x"\n[pulley]\nradius = { mark = "measured", note = "calliper" }'
    radius = read_case(write(tmp_path, text)).parameters["pulley.radius"]
    assert (radius.value, radius.mark, radius.note) == (0.019, "measured", "calliper")


def test_tolerances(tmp_path: Path) -> None:
    text = """base = "elbow"
title = "x"
[lock_pin]
backlash = { value = "2.5 deg", mark = "measured", tolerance = "0.1 deg" }
stiffness = { value = "1000 N*m/rad", tolerance = "5 %" }
"""
    found = read_case(write(tmp_path, text)).parameters
    assert found["lock_pin.backlash"].tolerance == pytest.approx(np.radians(0.1))
    assert found["lock_pin.stiffness"].tolerance == pytest.approx(50.0)


def test_with_values() -> None:
    original = case("fig8a_original")
    changed = original.with_values({"lock_pin.backlash": "0.5 deg", "bands.range": "1 lbf", "pulley.friction": 0.0})
    assert changed.value("lock_pin.backlash") == pytest.approx(np.radians(0.5))
    assert original.value("lock_pin.backlash") == pytest.approx(np.radians(2.5))
    brought_back = case("gain_brings_it_back").to_system()
    np.testing.assert_array_equal(changed.to_system().x0, brought_back.x0)
    assert changed.to_system().elements == brought_back.elements
    numpy_value = original.with_values({"lock_pin.backlash": np.float64(0.01), "run.t_end": 3})
    assert numpy_value.value("lock_pin.backlash") == 0.01 and numpy_value.t_end == 3.0
    kept = original.with_values({"drive.inertia": original.parameters["drive.inertia"]})
    assert kept.parameters["drive.inertia"] == original.parameters["drive.inertia"]


def test_with_values_of_a_loop() -> None:
    loop = case("backlash_servo").with_values({"play.gap": 4, "loop.gain": 2.0})
    assert loop.value("play.gap") == 4.0 and loop.value("loop.gain") == 2.0
    once, twice = (c.to_system().frequency_response(1.3)[0, 0] for c in (case("backlash_servo"), loop))
    assert twice == pytest.approx(2 * once)


@pytest.mark.parametrize(
    ("values", "field", "expected"),
    [
        ({"lock_pin.backlsh": "0.5 deg"}, "lock_pin.backlsh", "did you mean 'lock_pin.backlash'"),
        ({"backlash": "0.5 deg"}, "backlash", "did you mean 'lock_pin.backlash'"),
        ({"lock_pin.backlash": "0.5 kg"}, "lock_pin.backlash", "an angle"),
        ({"lock_pin.backlash": "-0.5 deg"}, "lock_pin.backlash", "zero or a positive"),
        ({"lock_pin.backlash": float("nan")}, "lock_pin.backlash", "finite"),
        ({"lock_pin": 3}, "lock_pin", "a known field"),
        ({"bands.low": "9 lbf"}, "bands.high", "thresholds in the order"),
        ({"bands.low": "2 lbf", "bands.range": "2 lbf"}, "bands.low", "either centre"),
        ({"": 1}, "", "dotted name"),
        ({"run.t_end.x.y": 1}, "run.t_end.x.y", "dotted name"),
        ({"title.x": 1}, "title.x", "dotted name"),
    ],
)
def test_with_values_that_are_refused(values: dict[str, object], field: str, expected: str) -> None:
    with pytest.raises(CaseError) as caught:
        case("fig8a_original").with_values(values, source="--set")
    assert caught.value.field == field and expected in caught.value.expected and caught.value.source == "--set"


def test_values_of_a_loop_are_shown_as_people_write_them() -> None:
    chair = case("wheelchair")
    assert str(chair.parameters["play.gap"]) == "12 mm" and chair.text("play.gap", 0.0069992) == "6.9992 mm"
    assert chair.value("play.gap") == 0.012 and chair.unit("play.gap") == ("m", "mm")
    turned = case("backlash_servo").with_values({"play.gap": "1 deg"})
    assert str(turned.parameters["play.gap"]) == "1 deg" and turned.readable("play.gap")[0] == "deg"


def test_si_and_text() -> None:
    found = case("fig8a_original")
    assert found.si("lock_pin.backlash", "0.6 deg") == pytest.approx(np.radians(0.6))
    assert found.si("parking.dwell_time", "200 ms") == 0.2
    assert found.text("lock_pin.backlash", np.radians(0.6)) == "0.6 deg"
    assert case("backlash_servo").si("play.gap", 0.3) == 0.3
    for name, value in (("lock_pin.backlash", "1 kg"), ("lock_pin.gap", "1 deg")):
        with pytest.raises(CaseError):
            found.si(name, value)
    with pytest.raises(CaseError, match="is missing"):
        found.value("parking.dwell_time")


def test_unknown_shipped_case() -> None:
    with pytest.raises(CaseError, match="did you mean 'fig8a_original'"):
        case("fig8a_orginal")
    with pytest.raises(CaseError, match="expected a case file"):
        case("???")


def _with_input(folder: Path, line: str) -> Case:
    return read_case(write(folder, f'base = "elbow"\ntitle = "x"\n[run]\ninput = {line}', "moved.toml"))


def test_inputs(tmp_path: Path) -> None:
    assert _with_input(tmp_path, '{ kind = "step", size = "5 mm", time = "1 s" }').input == epp.inputs.Step(0.005, 1.0)
    ramp = _with_input(tmp_path, '{ kind = "ramp", rate = "10 mm/s", start = "1 s", stop = "2 s" }')
    assert ramp.input == epp.inputs.Ramp(0.01, 1.0, 2.0)
    sine = _with_input(tmp_path, '{ kind = "sine", amplitude = "5 mm", frequency = "2 Hz", phase = "90 deg" }')
    assert sine.input == epp.inputs.Sine(0.005, 2.0, np.radians(90.0))
    steps = _with_input(tmp_path, '{ kind = "steps", times = ["0 s", "500 ms"], values = ["20 mm", "0 mm"] }').input
    assert isinstance(steps, epp.inputs.Steps)
    assert steps.value([0.0, 0.4, 0.5]).tolist() == pytest.approx([0.02, 0.02, 0.0])
    write(tmp_path, "time [ms], position [mm]\n0, 0\n500, 10\n1000, 10\n", "pull.csv")
    recorded = _with_input(tmp_path, '{ kind = "recorded", file = "pull.csv" }').input
    assert isinstance(recorded, epp.inputs.Recorded)
    assert recorded.value([0.25, 0.75]).tolist() == pytest.approx([0.005, 0.01])


@pytest.mark.parametrize(
    ("rows", "field", "expected"),
    [
        ("0,0\n1,\n2,3", "line 3, harness_position", "no holes"),
        ("0,0\n1,nan\n2,3", "line 3, harness_position", "a finite number"),
        ("0,0\n1\n2,3", "line 3", "2 cells"),
        ("0,0\n1,2,3\n2,3", "line 3", "2 cells"),
        ("0,0\n1,x\n2,3", "line 3, harness_position", "a finite number"),
        ("0,0\n1,1\n1,2", "line 4, time", "a later time"),
        ("-1,0\n1,1\n2,2", "time", "not negative"),
        ("0,0", "", "2 or more complete rows"),
    ],
)
def test_recordings_that_are_refused(tmp_path: Path, rows: str, field: str, expected: str) -> None:
    path = write(tmp_path, f"time,position\n{rows}\n", "pull.csv")
    with pytest.raises(CaseError) as caught:
        _with_input(tmp_path, '{ kind = "recorded", file = "pull.csv" }')
    assert caught.value.source == str(path) and caught.value.field == field and expected in caught.value.expected


def test_recordings_with_a_wrong_header(tmp_path: Path) -> None:
    write(tmp_path, "time [s], position [kg]\n0,0\n1,1\n", "pull.csv")
    with pytest.raises(CaseError, match="a length"):
        _with_input(tmp_path, '{ kind = "recorded", file = "pull.csv" }')
    write(tmp_path, "time\n0\n1\n", "pull.csv")
    with pytest.raises(CaseError, match="two columns"):
        _with_input(tmp_path, '{ kind = "recorded", file = "pull.csv" }')


@pytest.mark.parametrize("kind", ["elbow", "loop"])
def test_schema_is_json(kind: str) -> None:
    schema = json_schema(kind)
    assert "title" in schema["required"] and json.loads(json.dumps(schema)) == schema


def test_schema_of_another_kind() -> None:
    with pytest.raises(CaseError):
        json_schema("arm")


@pytest.mark.parametrize(
    ("input_signal", "units"),
    [
        ({"kind": "step", "size": "20 mm"}, {"size": ("m", "mm"), "time": ("s", "ms")}),
        ({"kind": "steps", "times": ["1 s"], "values": ["2 mm"]}, {}),
        ({"kind": "ramp", "rate": "20 mm/s"}, {"rate": ("m/s", "mm/s"), "start": ("s", "ms"), "stop": ("s", "ms")}),
        (
            {"kind": "sine", "amplitude": "5 mm", "frequency": "1 Hz"},
            {"frequency": ("Hz", "Hz"), "phase": ("rad", "deg")},
        ),
    ],
)
def test_run_time_and_numbers_of_the_input_have_units(input_signal, units):
    changed = case("fig8a_original").with_values({"run.input": input_signal, "run.t_end": "4 s"})
    assert changed.unit("run.t_end") == ("s", "s")
    assert changed.value("run.t_end") == 4.0
    for name, unit in units.items():
        assert changed.unit(f"run.input.{name}") == unit
    for name in ("kind", "values", "file"):
        with pytest.raises(CaseError, match="not known"):
            changed.unit(f"run.input.{name}")


def test_a_file_in_place_of_a_name_is_told_who_reads_it() -> None:
    with pytest.raises(CaseError, match="the name of a case that ships; read_case reads a file"):
        case("my_loop.toml")


@pytest.mark.parametrize(
    ("name", "field", "sentence"),
    [
        ("x15_flare", "loop.gain", "loop.gain is 2.0; expected a known field: one of Kp, "),
        ("fig8a_original", "loop.gain", "loop.gain is 2.0; expected a known field: did you mean"),
        ("robot_servo", "kp", "kp is 2.0; expected a known field: did you mean 'Kp'?"),
    ],
)
def test_a_field_that_this_kind_of_case_has_not_is_told_as_it_was_typed(name, field, sentence) -> None:
    with pytest.raises(CaseError) as refused:
        case(name).with_values({field: 2.0}, "--set")
    assert str(refused.value).startswith(f"--set: {sentence}")


def test_a_case_is_read_where_it_is_printed_and_in_a_notebook() -> None:
    """Not the fields of its class, with sixteen digits a number."""
    servo = case("robot_servo").with_values({"title": "a <b> joint"})
    assert str(servo) == "robot_servo: a <b> joint"
    assert repr(servo) == f"<Case robot_servo: a <b> joint; {len(servo.parameters)} parameters>"
    page = servo._repr_html_()
    assert "<b>" not in page and "60 V/rad" in page and page.count("<tr>") == len(servo.parameters)


def test_comments_of_a_file_stay_beside_values_that_change(tmp_path) -> None:
    path = tmp_path / "tank.toml"
    text = (shipped_cases_folder() / "level_valve.toml").read_text(encoding="utf-8")
    path.write_text(
        text.replace('linkage = { kind = "play", gap = "2 mm" }', 'linkage = { kind = "play", gap = "2 mm" } # worn')
    )
    changed = read_case(path).with_values({"linkage.gap": "1 mm", "blocks.lag": {**LAG, "before": "controller"}})
    made = changed.to_toml(comments=True)
    assert 'linkage = { kind = "play", gap = "1 mm" } # worn' in made and made.startswith("# A tank whose level")
    assert tomllib.loads(made) == tomllib.loads(changed.to_toml())
    assert "#" not in changed.to_toml()
    path.write_text("no longer = = TOML")
    assert changed.to_toml(comments=True) == changed.to_toml()


LAG = {"kind": "low_pass", "bandwidth": "1 rad/s"}
SYNONYMS_AND_BASES = [
    "fig6a_three_steps",
    "backlash_discrete_pi_kp02_ki02",
    "parking_stops_it",
    "wheelchair",
    "clegg_loop",
]


@pytest.mark.parametrize("name", SYNONYMS_AND_BASES)
def test_a_case_with_its_comments_is_the_same_case(name) -> None:
    read = case(name)
    assert tomllib.loads(read.to_toml(comments=True)) == tomllib.loads(read.to_toml())
