"""The JSON schema of case files: what ships is valid by it, and what it refuses is refused by the models too."""

from __future__ import annotations

import inspect
import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eppanalysis.cases import shipped_cases_folder
from eppanalysis.cases.editors import case_schema
from eppanalysis.cli.commands import app
from eppanalysis.models.devices.declared import declared_fields
from eppanalysis.models.diagrams import BLOCKS
from eppanalysis.models.elements import ELEMENTS

jsonschema = pytest.importorskip("jsonschema")
FILES = sorted(shipped_cases_folder().glob("*.toml"))


@pytest.fixture(scope="module")
def validator():
    schema = case_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def read(name: str) -> dict:
    return tomllib.loads((shipped_cases_folder() / f"{name}.toml").read_text(encoding="utf-8"))


def test_every_shipped_case_is_valid(validator):
    for path in FILES:
        validator.validate(tomllib.loads(path.read_text(encoding="utf-8")))


def test_the_shipped_cases_are_of_all_kinds_and_some_inherit():
    files = [tomllib.loads(path.read_text(encoding="utf-8")) for path in FILES]
    assert {"elbow", "loop", "diagram"} <= {file.get("kind") for file in files}
    assert any("base" in file for file in files)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("relay_deadzone", {"kind": "arm"}),
        ("relay_deadzone", {"title": 3}),
        ("relay_deadzone", {"lop": {}}),
        ("relay_deadzone", {"run": {"t_end": "1 s", "tend": "1 s"}}),
        ("elbow", {"lock_pin": {"backlesh": "1 deg"}}),
        ("fig8a_original", {"lock_pin": {"backlesh": "1 deg"}}),
        ("x15_flare", {"conect": []}),
        ("azimuth_servo", {"blocks": {"load": {"kind": "inertia", "inertia": "1 kg*m^2", "dampng": 1}}}),
        ("azimuth_servo", {"blocks": {"load": {"kind": "inertia", "damping": 1}}}),
        ("azimuth_servo", {"blocks": {"load": {"kind": "innertia", "inertia": 1}}}),
        ("azimuth_servo", {"blocks": {"load": {"inertia": 1}}}),
        ("azimuth_servo", {"elements": {"gear": {"element": "play", "gapp": 1}}}),
        ("azimuth_servo", {"elements": {"gear": {"element": "plya", "gap": 1}}}),
        ("stiction_deadband_none", {"loop": {"num": [1], "den": [1, 1], "elements": [{"element": "play", "gapp": 1}]}}),
        ("relay_deadzone", {"loop": {"blocks": [{"num": [1], "den": [1, 1]}, {"element": "play", "gapp": 1}]}}),
    ],
)
def test_a_mistake_is_found(validator, name, change):
    assert not validator.is_valid({**read(name), **change})


def test_fields_of_blocks_and_elements_are_those_that_a_reader_of_files_takes(validator):
    """Every field that a kind declares is taken, and a file that inherits may give any of them alone."""
    drawn = {"kind": "diagram", "title": "t", "connect": []}
    for kind, made in BLOCKS.items():
        fields = {name: (about.choices or (1,))[0] for name, about in declared_fields(made).items()}
        validator.validate({**drawn, "blocks": {"part": {"kind": kind, **fields}}})
    for kind, element in ELEMENTS.items():
        fields = dict.fromkeys(inspect.signature(element).parameters, 1)
        for word in ("kind", "element"):
            validator.validate({**drawn, "elements": {"part": {word: kind, **fields}}})
    ring = {"blocks": [{"num": [1], "den": [1, 1]}, {"element": "play", "gap": 1}]}
    validator.validate({**read("relay_deadzone"), "loop": ring})
    validator.validate({**read("relay_deadzone"), "loop": {"num": [1], "den": [1, 1], "elements": ring["blocks"][1:]}})
    validator.validate({"base": "azimuth_servo", "blocks": {"motor": {"ratio": 60}}, "elements": {"gear": {"gap": 1}}})


def test_other_words_for_parts_and_fields_are_those_that_a_reader_takes(validator):
    """A field that is needed may stand under its other name; two words for one kind are a mistake."""
    servo = read("azimuth_servo")
    motor = {"kind": "dc_motor", "R": 2, "Kt": 0.05, "J": 2e-5}
    gear = {"kind": "backlash", "backlash": 0.1}
    words = {
        "blocks": {"motor": motor},
        "elements": {"gear": gear, "encoder": {"element": "quantizer", "lsb": 1, "levels": 9}},
    }
    validator.validate({**servo, **words})
    for wrong in ({"kind": "dc_motor", "R": 2}, {"kind": "dc_moter"}, {**motor, "Kb": 1}):
        assert not validator.is_valid({**servo, "blocks": {"motor": wrong}})
    assert not validator.is_valid({**servo, "elements": {"gear": {"kind": "play", "element": "play", "gap": 1}}})


@pytest.mark.parametrize("missing", ["kind", "title", "loop"])
def test_what_is_missing_is_found_unless_it_may_be_inherited(validator, missing):
    file = {name: part for name, part in read("relay_deadzone").items() if name != missing}
    assert not validator.is_valid(file)
    assert validator.is_valid({**file, "base": "relay_deadzone"})


def test_every_reference_leads_somewhere():
    schema = case_schema()
    references = {
        line.partition("#/$defs/")[2].rstrip('",')
        for line in json.dumps(schema, indent=1).splitlines()
        if '"$ref"' in line
    }
    assert references and references <= set(schema["$defs"])


def test_command_prints_and_writes_the_same(tmp_path: Path):
    printed = CliRunner().invoke(app, ["schema"])
    path = tmp_path / "case.schema.json"
    assert CliRunner().invoke(app, ["schema", "-o", str(path)]).exit_code == 0
    assert json.loads(printed.stdout) == json.loads(path.read_text()) == case_schema()


def test_command_refuses_another_ending(tmp_path: Path):
    result = CliRunner().invoke(app, ["schema", "-o", str(tmp_path / "case.yaml")])
    assert result.exit_code == 2 and "expected one of .json" in result.stderr
