"""A number in a message is in the unit that people type, also where it came by way of SI units."""

from __future__ import annotations

import re

import pytest

import eppanalysis as epp

TYPED = [
    ("fig8a_original", "bands.range", "-4 lbf"),
    ("fig8a_original", "lock_pin.backlash", "-2 deg"),
    ("fig8a_original", "drive.no_load_speed", "-10 deg/s"),
    ("fig8a_original", "pulley.flexion_angle", "400 deg"),
    ("fig8a_original", "pulley.radius", "-19 mm"),
    ("fig8a_original", "run.t_end", "-3 s"),
    ("wheelchair", "play.gap", "-9 mm"),
]


@pytest.mark.parametrize(("name", "field", "typed"), TYPED)
def test_a_value_that_was_handed_on_in_si_units_is_named_as_it_is_typed(name: str, field: str, typed: str) -> None:
    case = epp.case(name)
    si = case.si(field, typed)
    with pytest.raises(epp.CaseError) as refused:
        case.with_values({field: si})
    assert typed in str(refused.value), str(refused.value)


@pytest.mark.parametrize(
    "ask",
    [
        lambda case: epp.design_bounds(
            case, "lock_pin.backlash", "bands.range", at=["1 deg"], within=("-4 lbf", "3 lbf")
        ),
        lambda case: epp.design(case, {"bands.range": ("-4 lbf", "2 lbf")}, minimise="bands.range"),
        lambda case: epp.continue_branch(case, "bands.range", "-4 lbf", "2 lbf"),
    ],
    ids=["bounds", "design", "branch"],
)
def test_analyses_over_a_parameter_name_its_value_as_it_was_typed(ask) -> None:
    with pytest.raises(epp.EppError) as refused:
        ask(epp.case("fig8a_original"))
    assert "-4 lbf" in str(refused.value) and "17.79" not in str(refused.value)


def test_a_cell_of_a_sweep_that_fails_names_its_value_as_it_was_typed() -> None:
    cells = epp.sweep(epp.case("fig8a_original"), {"bands.range": "-4:2:2:lbf"}, progress=False)
    assert "-4 lbf" in str(cells["message"].values[0])


def test_a_value_that_follows_from_what_was_typed_has_its_unit() -> None:
    """The other thresholds stay where they are: 2.6 lbf is no longer above the one that was moved."""
    with pytest.raises(epp.CaseError) as refused:
        epp.case("fig8a_original").with_values({"bands.low": "14 lbf"})
    assert re.search(r"bands\.high is '2\.6 lbf'; expected more than bands\.low \(14 lbf\)", str(refused.value))
