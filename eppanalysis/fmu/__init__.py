"""Functional Mock-up Units: loops as units for other tools, and units of other tools as the linear part of a loop."""

#: Base units as descriptions of units abbreviate them, and as `eppanalysis.units` calls them.
BASE_UNITS = {
    "kg": "kilogram", "m": "meter", "s": "second", "A": "ampere", "K": "kelvin", "mol": "mole", "cd": "candela",
    "rad": "radian",
}  # fmt: skip
