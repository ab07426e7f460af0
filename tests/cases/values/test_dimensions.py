"""Units in loops: what goes together is taken in any unit, what does not is refused, whatever the element."""

from __future__ import annotations

import re
from functools import cache

import pint
import pytest
from hypothesis import assume, given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import CaseError, EppError
from eppanalysis.models.elements import ELEMENTS


@cache
def quantity(number: float, unit: str) -> pint.Quantity:
    """A quantity of a registry of its own, made when it is first asked for."""
    return registry().Quantity(number, unit)


@cache
def registry() -> pint.UnitRegistry:
    return pint.UnitRegistry()


#: Units of a signal before and behind an element, several of each dimension.
WAYS = ("deg", "rad", "mm", "inch", "N", "lbf", "V", "mm/s", "deg/s")
#: Fields with numbers that each element takes, by their meaning: i the unit of its input, o that of its output.
FIELDS = {
    "saturation": {"lower": (-1, "o"), "upper": (1, "o"), "slope": (2, "o/i")},
    "dead_zone": {"lower": (-1, "i"), "upper": (1, "i"), "slope": (2, "o/i")},
    "dead_zone_saturation": {"dead_zone": (1, "i"), "slope": (2, "o/i"), "limit": (3, "o")},
    "relay": {"low": (-1, "o"), "high": (1, "o"), "threshold": (0.1, "i")},
    "relay_dead_zone": {"threshold": (1, "i"), "level": (1, "o")},
    "preload": {"level": (1, "o"), "slope": (1, "o/i")},
    "bilinear_spring": {
        "lower": (-1, "i"),
        "upper": (1, "i"),
        "outer": (2, "o/i"),
        "inner": (1, "o/i"),
        "preload": (1, "o"),
    },
    "hysteresis_relay": {"lower": (-1, "i"), "upper": (1, "i"), "low": (-1, "o"), "high": (1, "o")},
    "hysteresis_relay_dead_zone": {"on": (2, "i"), "off": (1, "i"), "level": (1, "o")},
    "jump_and_follow": {"stick_band": (2, "i"), "slip_jump": (1, "i"), "slope": (1, "o/i")},
}


def made(kind: str, units: dict[str, str]) -> epp.Case:
    """A loop with an element whose fields have these units."""
    fields = {name: f"{number} {units[name]}" for name, (number, _) in FIELDS[kind].items()}
    return epp.case("backlash_servo").with_values({"loop.elements": [{"element": kind, **fields}]})


def spelled(role: str, before: str, behind: str) -> str:
    """A unit as a case file has it: "deg/s" over "mm" is deg/s/mm."""
    return {"i": before, "o": behind, "o/i": f"{behind}/{before}"}[role]


@settings(deadline=None, max_examples=60)
@given(st.sampled_from(sorted(FIELDS)), st.sampled_from(WAYS[:7]), st.sampled_from(WAYS), st.data())
def test_a_field_of_another_dimension_is_refused_and_named(kind, before, behind, data) -> None:
    assume(quantity(1, before).to_base_units().units != quantity(1, behind).to_base_units().units)
    units = {name: spelled(role, before, behind) for name, (_, role) in FIELDS[kind].items()}
    case = made(kind, units)
    for name, (number, _) in FIELDS[kind].items():
        expected = quantity(number, units[name]).to_base_units().magnitude
        assert float(case.parameters[f"{kind}.{name}"].value) == pytest.approx(expected, rel=1e-12)
    wrong = data.draw(st.sampled_from(sorted(FIELDS[kind])))
    kin = [name for name, (_, role) in FIELDS[kind].items() if role == FIELDS[kind][wrong][1] and name != wrong]
    enough = kin or ("i" in (roles := {role for _, role in FIELDS[kind].values()}) and {"o", "o/i"} <= roles)
    if not enough:
        return  # nothing else of its kind: any unit may be meant
    with pytest.raises(EppError, match=r"loop\.elements\.0\.\w+ is .*; expected .*, to go with"):
        made(kind, units | {wrong: "kg"})


def test_every_element_says_what_its_fields_are() -> None:
    import inspect

    from eppanalysis.cases.blocks import element_class

    for kind in ELEMENTS:
        made = element_class(kind)
        assert set(inspect.signature(made).parameters) - {"model", "beyond"} == set(made.units)


@pytest.mark.parametrize(
    ("name", "field", "value", "expected"),
    [
        ("pid_hunting", "friction.coulomb", "5 %", "a force or a torque"),
        ("pid_hunting", "friction.coulomb", "1 N*m", "a force such as"),
        ("pid_hunting", "friction.stribeck", "3 m/s", "a quantity in s/m"),
        ("belt_leine", "friction.coulomb", "5 deg", "a force or a torque"),
        ("two_mass_deadzone", "dead_zone.upper", "5 mm", "an angle such as '2.5 deg', to go with signals.twist"),
        ("two_mass_deadzone", "dead_zone.slope", "40 N/m", "a torsional stiffness"),
        ("two_mass_damped_shaft", "nordin_shaft.gap", "5 parsec", "an angle"),
        ("two_mass_damped_shaft", "nordin_shaft.damping", "1 N*m/rad", "a torsional damping"),
        ("two_mass_damped_shaft_classical", "lock_pin.gap", "5 %", "an angle"),
        ("wheelchair", "dead_zone.upper", "2 mm", "a force such as '1.25 lbf', to go with lower"),
    ],
)
def test_units_are_those_of_the_signals_of_the_loop(name, field, value, expected) -> None:
    with pytest.raises(EppError, match=expected) as caught:
        epp.case(name).with_values({field: value})
    assert field.partition(".")[2] in str(caught.value)


@pytest.mark.parametrize("value", ["40 N*m/rad", "40 N*m", "40", "7080.6 lbf*inch"])
def test_radians_may_be_left_out_of_a_quotient(value) -> None:
    assert (
        epp.case("two_mass_deadzone").with_values({"dead_zone.slope": value}).parameters["dead_zone.slope"].value > 39
    )


@pytest.mark.parametrize("place", ["num", "den"])
def test_coefficients_of_a_transfer_function_take_no_unit(place) -> None:
    blocks = [{"element": "play", "gap": 1.0}, {"num": [1.0], "den": [1.0, 1.0, 0.0], place: ["5 N", 1.0, 2.0]}]
    loop = {"blocks": blocks}
    with pytest.raises(EppError, match=rf"loop\.blocks\.1\.{place}\.0 is '5 N'; expected a plain number"):
        epp.case("sat_plus_backlash").with_values({"loop": loop})


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("fig8a_original", {"lock_pin.backlash": 2.5}, "2.5 rad, which are 143.239 deg; for degrees write"),
        ("fig8a_original", {"harness.step": "5 parsec"}, "far from what machines have"),
        ("backlash_servo", {"play.gap": "5 parsec"}, "far from what machines have"),
        ("backlash_servo", {"play.gap": "1e-30 m"}, "far from what machines have"),
    ],
)
def test_what_is_hardly_meant_is_said(name, values, words) -> None:
    (remark,) = epp.case(name).with_values(values).remarks
    assert words in remark and next(iter(values)) in remark


def test_what_is_meant_needs_no_remark() -> None:
    assert not [remark for name in epp.shipped_cases() for remark in epp.case(name).remarks]
    assert not epp.case("fig8a_original").with_values({"lock_pin.backlash": "143 deg"}).remarks


@pytest.mark.parametrize("value", [1e308, "1e308 rad", "361 deg"])
def test_a_gap_of_more_than_a_turn_is_refused(value) -> None:
    with pytest.raises(EppError, match=r"lock_pin\.backlash is .*; expected at most 360 deg"):
        epp.case("fig8a_original").with_values({"lock_pin.backlash": value})


@pytest.mark.parametrize(("fields", "words"), [
    ('element = "first_order_reset"\npole = "2 mm"', "pole is '2 mm'; expected a quantity in 1/s"),
    ('element = "first_order_reset"\npole = "50 %"', "pole is '50 %'; expected a quantity in 1/s"),
    (
        'element = "anti_windup_pid"\nkp = 2.0\nki = 1.0\ntracking_time = "400 mm"',
        "tracking_time is '400 mm'; expected a time such as '1 ms'",
    ),
])  # fmt: skip
def test_a_time_or_a_rate_is_one_whatever_the_signals_are(fields: str, words: str) -> None:
    loop = 'kind = "loop"\ntitle = "t"\n[loop]\nnum = [1.0]\nden = [1, 1, 0]\n[[loop.elements]]\n'
    text = f'{loop}{fields}\n[run]\nt_end = "1 s"\n'
    with pytest.raises(CaseError, match=re.escape(words)):
        epp.case_from_text(text)
