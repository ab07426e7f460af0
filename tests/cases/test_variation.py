"""What is varied in a case where nothing is named: what it marks as tunable, then its gain, no half of an element."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cases import variation_of
from eppanalysis.cases.command_line import Commands
from eppanalysis.cli.commands import app
from eppanalysis.errors import CaseError


def test_what_is_tunable_comes_first():
    assert variation_of(epp.case("level_valve")).over()[:2] == ["controller.kp", "controller.ti"]
    assert list(variation_of(epp.case("azimuth_servo")).axes()) == ["Kp", "Ti"]


@pytest.mark.parametrize(
    ("name", "limit", "over"),
    [
        ("azimuth_servo", "Kp", "gap"),
        ("azimuth_servo", "gap", "Kp"),
        ("azimuth_servo", "J_load", "Kp"),
        ("virtual_spring", "K", "quantum"),
        ("steering_compensated", "Kp", "dry"),
        ("x15_flare", "Kp", "rate"),
        ("wheelchair", "loop.gain", "play.gap"),
        ("fig8a_original", "lock_pin.backlash", "bands.range"),
    ],
)
def test_a_gain_is_bounded_over_the_size_of_an_element_and_all_else_over_the_gain(name, limit, over):
    assert variation_of(epp.case(name)).beside(limit)[0] == over
    advised = Commands.of(epp.case(name)).bounds(limit)
    assert f"--over {over} " in advised and f"--limit {limit}" in advised


def test_a_map_of_one_tunable_parameter_is_beside_the_size_of_an_element(tmp_path):
    made = CliRunner().invoke(app, ["new", str(tmp_path / "servo.toml"), "--kind", "servo"])
    assert made.exit_code == 0
    servo = epp.read_case(tmp_path / "servo.toml")
    assert list(variation_of(servo).axes()) == ["bandwidth", "backlash"]


@pytest.mark.parametrize("name", ["wheelchair", "sat_asymmetric", "two_mass_deadzone", "relay_biased_fopdt"])
def test_no_axis_is_one_side_of_an_element_that_has_two(name):
    case = epp.case(name)
    varied = variation_of(case)
    # Nor is one of them moved by a slider; each can still be set by hand.
    for field in [*varied.over(), *(slider.name for slider in varied.sliders())]:
        assert not field.endswith((".upper", ".lower", ".high", ".low")), field
    assert varied.over()[0] == "loop.gain"


def test_a_gain_that_is_left_out_is_one():
    case = epp.case("wheelchair")
    assert "loop.gain" not in case.parameters and case.value("loop.gain") == 1.0
    assert case.with_values({"loop.gain": 1.0}).to_system().B.tolist() == case.to_system().B.tolist()


def test_an_equal_unit_is_taken_and_another_is_not():
    servo = epp.case("azimuth_servo")
    assert servo.si("motor.resistance", "3 ohm") == servo.si("motor.resistance", "3 V/A") == 3.0
    with pytest.raises(CaseError, match="expected a quantity in V/A"):
        servo.si("motor.resistance", "3 V")


def test_what_is_tunable_stays_so_with_another_value():
    """A report of a servo with a gain set by hand goes on to follow its cycle over that gain."""
    servo = epp.case("robot_servo")
    again = servo.with_values({"Kp": "50 V/rad", "backlash": "0.5 deg"})
    assert servo.parameters["Kp"].mark == again.parameters["Kp"].mark == "tunable"
    assert again.parameters["backlash"].mark == "assumed" and again.value("Kp") == 50.0


@pytest.mark.parametrize(("given", "unit"), [("50 V/rad", "V/rad"), (50.0, "V/rad"), ("50", "V/rad"), (50, "V/rad")])
def test_another_value_keeps_its_tolerance_and_its_unit(given: object, unit: str) -> None:
    changed = epp.case("azimuth_servo").with_values({"Kp": given})
    found = changed.parameters["Kp"]
    assert (found.value, found.unit, found.mark, str(found)) == (50.0, unit, "tunable", "50 V/rad")
    assert found.tolerance == pytest.approx(5.0)  # 10 % of what it is now
    # What it is written as is read back, and an expression has the tolerances of its parameters.
    assert epp.Case.from_tables(tomllib.loads(changed.to_toml()), name="again").parameters["Kp"] == found
    assert changed.with_values({"Kp": "16*pi"}).parameters["Kp"].tolerance is None


def test_a_plain_number_is_exact_in_the_unit_that_it_is_shown_in() -> None:
    case, names = epp.case("azimuth_servo"), ("gap", "motor_friction.coulomb", "J_load", "gear.stiffness")
    for value in np.random.default_rng(3).uniform(1e-4, 1.0, 40):
        changed = case.with_values(dict.fromkeys(names, value))
        assert [case.si(name, changed.value(name)) for name in names] == [value] * len(names)
    assert str(case.with_values({"gap": np.radians(0.2)}).parameters["gap"]) == "0.2 deg"


@pytest.mark.parametrize("name", ["azimuth_servo", "virtual_spring", "wheelchair"])
@pytest.mark.parametrize("points", [5, 7, 9])
def test_a_map_of_any_loop_has_the_case_itself_among_its_designs(name, points):
    """A case that comes to rest stood in a cell that a design beside it had made unknown."""
    case = epp.case(name)
    for field, axis in variation_of(case).axes(points).items():
        low, high, count, *unit = axis.split(":")
        assert int(count) == points
        middle = case.si(field, f"{0.5 * (float(low) + float(high)):.12g} {''.join(unit)}".strip())
        assert middle == pytest.approx(case.value(field), rel=1e-11)
