"""From the validated sections of an elbow case to the parameters of the model, with the checks across fields."""

from __future__ import annotations

import math
from typing import Any

from eppanalysis.case.files import RawCase
from eppanalysis.case.quantities import Parameter
from eppanalysis.case.schema import ElbowFile
from eppanalysis.errors import ModelError
from eppanalysis.models.elbow_parameters import (
    Bands,
    Cable,
    Controller,
    Drive,
    ElbowParameters,
    Forearm,
    Harness,
    LockPinParameters,
    Parking,
    Pulley,
    Sensor,
)

SECTIONS: dict[str, type] = {
    "drive": Drive,
    "controller": Controller,
    "bands": Bands,
    "lock_pin": LockPinParameters,
    "forearm": Forearm,
    "cable": Cable,
    "pulley": Pulley,
    "harness": Harness,
    "sensor": Sensor,
    "parking": Parking,
}
_WIDTHS = ("centre", "parking_width", "range")
_THRESHOLDS = ("slack", "low", "high", "max")
#: How far bands that count as symmetric may be off it, relative to F_max.
_SYMMETRIC = 1e-12


def elbow_fields(file: ElbowFile) -> dict[str, Parameter]:
    """The given parameters by their dotted names."""
    found = {}
    for section in SECTIONS:
        model = getattr(file, section)
        for name in type(model).model_fields:
            value = getattr(model, name)
            if value is not None:
                found[f"{section}.{name}"] = value
    return found


def elbow_parameters(fields: dict[str, Parameter], raw: RawCase) -> ElbowParameters:
    """Parameters of the model in SI units.

    Raises
    ------
    CaseError
        If fields contradict one another: thresholds out of order, alternatives given twice or not at all.
    """
    _check_bands(fields, raw)
    _check_forearm(fields, raw)
    _check_rest(fields, raw)
    sections: dict[str, Any] = {}
    for section, cls in SECTIONS.items():
        values = {k.partition(".")[2]: p.value for k, p in fields.items() if k.partition(".")[0] == section}
        try:
            sections[section] = cls(**values)
        except ModelError as error:
            raise raw.refused_by_model(error, section) from None
    return ElbowParameters(**sections)


def _check_bands(fields: dict[str, Parameter], raw: RawCase) -> None:
    widths = [f"bands.{n}" for n in _WIDTHS if f"bands.{n}" in fields]
    thresholds = [f"bands.{n}" for n in _THRESHOLDS if f"bands.{n}" in fields]
    either = "either centre, parking_width and range, or slack, low, high and max"
    if widths and thresholds:
        raise raw.refused(thresholds[0], f"{either}, not both")
    needed = _THRESHOLDS if thresholds else _WIDTHS
    for name in needed:
        if f"bands.{name}" not in fields:
            raise raw.refused(f"bands.{name}", f"a force such as '2.5 lbf': {either}")
    if not thresholds and not fields["bands.parking_width"].value < fields["bands.range"].value:
        raise raw.refused("bands.parking_width", f"less than bands.range ({raw.typed('bands.range')})")
    if not thresholds and not fields["bands.parking_width"].value < 2 * fields["bands.centre"].value:
        raise raw.refused("bands.parking_width", "less than twice bands.centre")
    for lower, upper in zip(thresholds, thresholds[1:], strict=False):
        if not fields[lower].value < fields[upper].value:
            order = "thresholds in the order slack < low < high < max"
            raise raw.refused(upper, f"more than {lower} ({raw.typed(lower)}): {order}")
    offset, supply = fields.get("bands.offset_voltage"), fields["drive.supply_voltage"]
    if offset is not None and offset.value > supply.value:
        raise raw.refused("bands.offset_voltage", f"at most drive.supply_voltage ({raw.typed('drive.supply_voltage')})")


def _check_forearm(fields: dict[str, Parameter], raw: RawCase) -> None:
    mass, inertia = "forearm.prehensor_mass" in fields, "forearm.inertia" in fields
    if mass and inertia:
        raise raw.refused("forearm.prehensor_mass", "either inertia or prehensor_mass, not both")
    if not mass and not inertia:
        raise raw.refused("forearm.inertia", "a moment of inertia such as '0.0465 kg*m^2', or prehensor_mass")
    upright = fields.get("forearm.upright")
    if upright is not None and upright.value and "forearm.gravity_moment" in fields:
        raise raw.refused("forearm.gravity_moment", "either upright or gravity_moment, not both")


def _check_rest(fields: dict[str, Parameter], raw: RawCase) -> None:
    antagonist = fields.get("cable.antagonist")
    if "cable.pretension" in fields and not (antagonist is not None and antagonist.value):
        raise raw.refused("cable.pretension", "it only with antagonist = true")
    if "parking.dwell_time" in fields and "controller.sample_period" in fields:
        raise raw.refused("parking.dwell_time", "either it or controller.sample_period, not both")
    friction, angle = float(fields["pulley.friction"].value), float(fields["pulley.flexion_angle"].value)
    if friction * math.sin(angle / 2) >= 1:
        raise raw.refused("pulley.friction", "mu sin(psi/2) below 1, or the pulley never slides")


def other_bands(parameters: ElbowParameters, kept: set[str], given: set[str]) -> dict[str, float]:
    """What the bands need beside a threshold in a case of widths, or beside a width in a case of thresholds [N].

    Bands that are not symmetric about their centre have no widths that could stay.
    """
    slack, low, high, top = parameters.bands.thresholds
    symmetric = abs(low + high - slack - top) <= _SYMMETRIC * abs(top)
    groups = ((_WIDTHS, _THRESHOLDS, symmetric), (_THRESHOLDS, _WIDTHS, True))
    for these, those, known in groups:
        if known and given.intersection(these) and not given.intersection(those) and not kept.intersection(these):
            found = {name: implied(parameters, f"bands.{name}") for name in these if name not in given}
            return {name: value for name, value in found.items() if value is not None}
    return {}


def implied(parameters: ElbowParameters, name: str) -> float | None:
    """A parameter that the file does not give itself."""
    section, _, last = name.partition(".")
    bands = parameters.bands
    slack, low, high, top = bands.thresholds
    derived: dict[str, float | None] = {
        "bands.slack": slack,
        "bands.low": low,
        "bands.high": high,
        "bands.max": top,
        "bands.centre": bands.parking_centre,
        "bands.parking_width": high - low,
        "bands.range": top - slack,
        "forearm.inertia": parameters.forearm.total_inertia,
        "forearm.prehensor_mass": parameters.forearm.equivalent_mass,
        "forearm.gravity_moment": parameters.forearm.total_gravity_moment,
    }
    if name in derived:
        return derived[name]
    found = getattr(getattr(parameters, section), last)
    return None if found is None else float(found)
