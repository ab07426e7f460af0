"""Cases of the elbow: from the validated sections to the parameters of the model, with the checks across fields."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from eppanalysis.cases.files import RawCase
from eppanalysis.cases.inputs import input_signals_of
from eppanalysis.cases.kind import Kind, Parts
from eppanalysis.cases.schema import ElbowFile
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.cases.variation import Slider, Variation, Varied
from eppanalysis.errors import CaseError, ModelError
from eppanalysis.models.devices.declared import declared_fields
from eppanalysis.models.devices.elbow.loop import elbow
from eppanalysis.models.devices.elbow.parameters import Bands, ElbowParameters
from eppanalysis.models.systems.inputs import Step
from eppanalysis.readable import in_print
from eppanalysis.units import parse_quantity

_WIDTHS, _THRESHOLDS = Bands.WIDTHS, Bands.THRESHOLDS
#: How far bands that count as symmetric may be off it, relative to F_max.
_SYMMETRIC = 1e-12
_MASS = "forearm.prehensor_mass"
#: Of an elbow: field, words, unit, lowest, highest, step; most telling first.
_ELBOW = (
    ("bands.range", "Gain: profile range", "lbf", 1.0, 5.0, 0.05),
    ("lock_pin.backlash", "Backlash", "deg", 0.0, 4.0, 0.05),
    ("pulley.friction", "Pulley friction", "", 0.0, 0.15, 0.002),
    ("cable.stiffness", "Cable stiffness", "N/m", 500.0, 15000.0, 50.0),
    (_MASS, "Mass in the hand", "kg", 0.05, 1.5, 0.01),
    ("controller.delay", "Delay", "ms", 0.0, 20.0, 0.25),
)


class ElbowVariation(Variation):
    """Of an elbow: its gain and its backlash before all else."""

    guided = ("bands.range", "lock_pin.backlash")

    def sliders(self) -> Iterable[Slider]:
        """The parameters of its design; the forearm's inertia where the shell has all of it."""
        for name, title, unit, low, high, step in _ELBOW:
            value = current(self.case, name)
            if value is None:
                name, title, unit, low, high, step = "forearm.inertia", "Forearm inertia", "kg*m^2", 0.005, 0.2, 0.001
                value = self.case.value(name)
            per_unit = self.case.si(name, f"1 {unit}".strip())
            shown = value / per_unit
            yield Slider(name, title, in_print(unit), per_unit, min(low, shown), max(high, shown), step, shown)

    def over(self) -> list[str]:
        """The backlash."""
        return ["lock_pin.backlash"]

    def branch(self, name: str) -> tuple[float, float, float]:
        """From a backlash at which the elbow oscillates, down through the fold."""
        return max(1.3 * self.case.value(name), math.radians(0.5)), math.radians(4.0), math.radians(0.1)

    def axes(self, points: int = 9) -> dict[str, str]:
        """Gain against backlash, on a grid of its own."""
        return {"bands.range": "1:5:17:lbf", "lock_pin.backlash": "0.25:3:12:deg"}


def current(case: Varied, name: str) -> float | None:
    """Value of a field [SI], also of the mass where the case gives the inertia; None where there is none."""
    try:
        return case.value(name)
    except CaseError:
        if name != _MASS:
            raise
        return None


class ElbowKind(Kind):
    """Cases of the elbow."""

    name = "elbow"
    file = ElbowFile
    variation = ElbowVariation

    def parts(self, file: Any, raw: RawCase) -> Parts:
        """The parameters, the harness' step unless another input is given, and the elbow."""
        fields = elbow_fields(file)
        parameters = elbow_parameters(fields, raw)
        try:
            with np.errstate(all="ignore"):  # what overflows is refused as not finite
                system = replace(elbow(parameters), name=raw.name)
        except (ModelError, ArithmeticError) as error:
            raise CaseError(raw.source, "", "beyond the range of numbers", f"ordinary magnitudes ({error})") from None
        units = dict.fromkeys(system.input_names, ("m", "mm"))
        input_signal = input_signals_of(file.run, system.input_names, "m", raw) or Step(parameters.harness.step)
        return Parts(fields, input_signal, system, parameters, input_units=units)

    def fields(self, parameters: Iterable[str]) -> list[str]:
        """All that are declared."""
        return list(_names())

    def si(self, value: object, unit: str) -> float:
        """A quantity of the field's own dimension, or a number in its SI unit."""
        return parse_quantity(value, unit)

    def implied(self, elbow: ElbowParameters | None, name: str) -> float | None:
        """What follows from other parameters, and defaults."""
        return None if elbow is None else implied(elbow, name)

    def beside(self, elbow: ElbowParameters | None, data: Mapping[str, Any], given: Mapping[str, set[str]]) -> Any:
        """The other bands."""
        if elbow is None or not isinstance(data.get("bands"), dict):
            return {}
        return {"bands": other_bands(elbow, set(data["bands"]), given.get("bands", set()))}


@cache
def _names() -> tuple[str, ...]:
    sections = ElbowParameters.sections().items()
    return tuple(f"{name}.{field}" for name, section in sections for field in declared_fields(section))


def elbow_fields(file: Any) -> dict[str, Parameter]:
    """The given parameters by their dotted names."""
    found = {}
    for section in ElbowParameters.sections():
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
    values: dict[str, dict[str, Any]] = {}
    for dotted, parameter in fields.items():
        section, _, name = dotted.partition(".")
        values.setdefault(section, {})[name] = parameter.value
    sections: dict[str, Any] = {}
    for section, cls in ElbowParameters.sections().items():
        try:
            sections[section] = cls(**values.get(section, {}))
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
    # Widths say bands that are symmetric; others have thresholds alone.
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
