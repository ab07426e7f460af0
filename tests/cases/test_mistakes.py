"""All mistakes of a file are named at once, each with its field, its value and what was expected, and no others."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from eppanalysis.cases import shipped_cases_folder
from eppanalysis.cases.mistakes import mistakes_in
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
    "parameters.sqrt": "not called like what expressions know",
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
    "blocks.late.computation_delay": "none, as there is no sample_time",
    "elements.clip.element": "did you mean 'saturation'",
    "elements.limit.upper": "more than lower (1)",
    "elements.steps.levels": "a whole number from 1",
    "elements.play.gap": "zero or more",
    "elements.dry.static": "at least coulomb (1 N)",
    "elements.gear.stiffness": "lock_pin needs it",
    "connect.7": "a part of the diagram in place of 'sensro'",
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
    found, not_seen = mistakes_in(SEEDED)
    said = {error.field: str(error) for error in found if "algebraic" not in str(error)}
    assert len(SEEDS) >= 40 and said.keys() == SEEDS.keys()
    for field, expected in SEEDS.items():
        assert said[field].startswith(f"{SEEDED}: {field} is ") and expected in said[field] and "\n" not in said[field]
    algebraic = [error for error in found if "algebraic" in str(error)]
    assert len(algebraic) == 1 and "the algebraic loop through six, seven has no unique answer" in str(algebraic[0])
    assert len(found) == len(SEEDS) + 1
    used_elsewhere = {"d", "sensor", "pid1", "notchy", "mass", "limit", "six"}
    assert set(not_seen) == used_elsewhere | {"tf1", "tf2", "clip", "steps", "play"}  # what these need is wrong


def test_check_prints_them_all_and_says_what_it_has_not_seen() -> None:
    result = CliRunner().invoke(app, ["check", str(SEEDED)])
    assert result.exit_code == 2 and not result.stdout
    lines = result.stderr.splitlines()
    assert len(lines) == len(SEEDS) + 2
    assert lines[-1].endswith("was not looked at; check again when that is mended.")


def test_what_is_missing_beside_a_mistake_is_named_and_what_is_not_read_is_told(tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(
        'kind = "diagram"\ntitle = "t"\nconnect = ["demand - lag -> lag", "motor.angle -> lamp"]\n'
        "inputs = { demand = 0 }\n[blocks]\n"
        'lag = { kind = "low_pass", bandwidth = "2 V" }\n'
        'motor = { kind = "motor", resistance = "2 ohm", torque_constant = 1, damping = "2 V" }\n'
        'lamp = { kind = "lead_lag", zero_time = 1, pole_time = "0 s", discretisation = "zoh" }\n[run]\nt_end = "5 s"\n'
    )
    found, not_seen = mistakes_in(file)
    fields = {"blocks.lag.bandwidth", "blocks.motor.damping", "blocks.motor.inertia", "blocks.lamp.pole_time"}
    # No word that what is left makes no loop: it would, were it not for these.
    assert {error.field for error in found} == fields and set(not_seen) == {"lag", "motor", "lamp"}


@pytest.mark.parametrize("name", ["azimuth_servo", "sat_am165", "fig8a_original"])
def test_a_valid_file_has_no_mistakes(name: str) -> None:
    assert mistakes_in(shipped_cases_folder() / f"{name}.toml") == ((), ())


def test_mistakes_of_a_loop_and_of_an_elbow_are_named_too(tmp_path: Path) -> None:
    file, rest = tmp_path / "wrong.toml", '[run]\nt_end = "5 m"\n[[loop.elements]]\nelement = "relay"\n'
    file.write_text('kind = "loop"\n[loop]\nnum = [1, 2]\nden = [1]\ngian = 3\n' + rest)
    assert {e.field for e in mistakes_in(file).found} == {"loop.gian", "run.t_end", "title", "loop.num"}
    file.write_text('base = "fig8a_original"\nlock_pin.backlash = "5 mm"\ncable.stifness = 3\nbands.range = "-1 lbf"\n')
    assert {e.field for e in mistakes_in(file).found} == {"lock_pin.backlash", "cable.stifness", "bands.range"}
