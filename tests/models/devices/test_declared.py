"""Fields of a device are declared once: what the model refuses, what a file takes and what is documented agree."""

from __future__ import annotations

import math

import pytest

import eppanalysis as epp
from eppanalysis.cases import case, json_schema, variation_of
from eppanalysis.errors import CaseError, ModelError
from eppanalysis.models.devices.declared import Form, declared_fields
from eppanalysis.models.devices.elbow.parameters import declared

SECTIONS = epp.ElbowParameters.sections()
FIELDS = {f"{s}.{f}": about for s, section in SECTIONS.items() for f, about in declared_fields(section).items()}
OUTSIDE = [
    (name, math.nextafter(limit, limit + step))
    for name, about in FIELDS.items()
    for limit, step in ((about.at_least, -1.0), (about.at_most, 1.0))
    if limit is not None and about.form is Form.QUANTITY
] + [(name, about.above) for name, about in FIELDS.items() if about.above is not None]


def test_model_and_file_refuse_the_same_values_in_the_same_words() -> None:
    for name, value in OUTSIDE:
        section, _, field = name.partition(".")
        with pytest.raises(ModelError) as by_model:
            SECTIONS[section](**{field: value})
        with pytest.raises(CaseError) as by_file:
            case("elbow").with_values({name: value})
        assert (by_model.value.field, by_file.value.field) == (field, name)
        assert by_model.value.expected == by_file.value.expected


def test_every_field_is_in_the_schema_and_in_the_documentation() -> None:
    for name, said in FIELDS.items():
        section, _, field = name.partition(".")
        schema = json_schema("elbow")
        place = schema["properties"][section]
        table = schema["$defs"][(place.get("$ref") or place["allOf"][0]["$ref"]).rpartition("/")[2]]
        assert field in table["properties"] and (field in table.get("required", ())) is not said.optional
        doc = SECTIONS[section].__doc__ or ""
        assert f"\n{field} : " in doc and said.about in doc
        assert case("elbow").unit(name)[0] == declared(name).unit == said.unit


def test_the_shipped_elbow_has_the_declared_values() -> None:
    elbow = case("elbow")
    for name in elbow.parameters:
        section, _, field = name.partition(".")
        assert elbow.value(name) == pytest.approx(getattr(getattr(epp.ElbowParameters(), section), field), rel=1e-12)


@pytest.mark.parametrize(
    "name", ["fig8a_original", "light_forearm", "backlash_servo", "relay_ideal_khalil79", "x15_flare"]
)
def test_what_is_worth_varying_can_be_set(name: str) -> None:
    """Every kind of case answers: its sliders, branches and axes are of parameters that it takes."""
    found = case(name)
    variation = variation_of(found)
    moved = [(slider.name, slider.high * slider.per_unit) for slider in variation.sliders()]
    places = [(name, place) for name in variation.over()[:1] for place in variation.branch(name)]
    assert moved
    for field, value in (*moved, *places):
        assert found.with_values({field: value}).value(field) == pytest.approx(value, rel=1e-12)
    for field in variation.axes():
        assert found.value(field) > 0
    field, _, value = variation.example.partition(" = ")
    assert found.si(field, value) == pytest.approx(found.value(field), rel=1e-3)  # its own, to the digits shown
