"""Quantities: what people write, what is refused, and that text and number are inverse to each other."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
from hypothesis import given, strategies as st

from eppanalysis import units
from eppanalysis.cases.values.expressions import parse
from eppanalysis.errors import EppError
from eppanalysis.units import KINDS, QuantityError, format_si, parse_any, parse_quantity, write_si

POUND_FORCE = 4.4482216152605  # N, exact by definition
FRIENDLY = [
    ("rad", "deg"),
    ("rad/s", "deg/s"),
    ("m", "mm"),
    ("s", "ms"),
    ("N", "lbf"),
    ("V/N", "V/lbf"),
    ("N*m/rad", "N*m/deg"),
    ("kg*m^2", "kg*m^2"),
    ("", "%"),
    ("", ""),
]


def test_quantities_as_people_write_them() -> None:
    for text, unit, value in [
        ("2.5 deg", "rad", math.radians(2.5)),
        ("2.5°", "rad", math.radians(2.5)),
        ("1.25 lbf", "N", 1.25 * POUND_FORCE),
        ("0.45 kg", "kg", 0.45),
        ("16 V", "V", 16.0),
        ("1 ms", "s", 1e-3),
        ("164 deg/s", "rad/s", math.radians(164)),
        ("1 turn/s", "rad/s", 2 * math.pi),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("10.93 N*m", "N*m", 10.93),
        ("10.93 N·m", "N*m", 10.93),
        ("6705 N/m", "N/m", 6705.0),
        ("0.03 kg m²", "kg*m^2", 0.03),
        ("0.01 N*m*s/rad", "N*m*s/rad", 0.01),
        ("1 N*m/deg", "N*m/rad", 180 / math.pi),
        ("2 V/lbf", "V/N", 2 / POUND_FORCE),
        ("20mm", "m", 0.02),
        ("-5e-3 m", "m", -0.005),
        ("−5 mm", "m", -0.005),
        ("5 %", "", 0.05),
        ("1 kgf", "N", 9.80665),
        ("2 Hz", "Hz", 2.0),
        ("360/2000 deg", "rad", math.radians(0.18)),
        ("1/0.9 rad/s", "rad/s", 1 / 0.9),
        ("-5 / 2 mm", "m", -0.0025),
        ("36:1", "", 36.0),
        ("1:2.5", "", 0.4),
        ("3.5", "N", 3.5),
        (3, "N", 3.0),
        (0.25, "rad", 0.25),
    ]:
        assert parse_quantity(text, unit) == pytest.approx(value, rel=4e-16 * 4)


def test_a_quotient_is_the_float_nearest_to_the_one_of_its_decimal_fractions() -> None:
    """0.3/0.1 of floats is 2.9999999999999996; 1e400 is no float, and yet half of 2e400."""
    assert parse_quantity("0.3/0.1", "") == parse_quantity("0.3:0.1", "") == 3.0
    assert parse_any("1e400/2e400 mm") == (0.0005, "m")


def test_refusals() -> None:
    for text, unit, expected in [
        ("1 lb", "N", "write lbf"),
        ("1 kg", "N", "write lbf"),
        ("1 lbf", "kg", "write lb"),
        ("2.5 kg", "rad", "an angle such as '2.5 deg'"),
        ("5 %", "rad", "an angle"),
        ("5 rad", "", "a plain number"),
        ("10 Hz", "rad/s", "write turn/s"),
        ("10 N*m", "N*m/rad", "a torsional stiffness"),
        ("10 rad/s", "Hz", "a frequency"),
        ("1 furlongs_per_fortnite", "m", "a known unit"),
        ("1 degC", "m", "without offset or logarithm in place of 'degC': counted from any level, it is in K"),
        ("70 degF", "K", "it is in K"),
        ("1 dB", "", "without offset or logarithm"),
        ("2.5 deg deg", "rad", "an angle"),
        ("360/0 deg", "rad", "a divisor that is not zero: an angle"),
        ("36:1 deg", "rad", "a ratio such as '36:1' has no unit"),
        ("1/1e-400 s", "s", "a finite number"),
        ("deg", "rad", "an angle"),
        ("", "rad", "an angle"),
        ("nan", "rad", "an angle"),
        ("11/s", "Hz", "a frequency"),
        ("1.1/s", "Hz", "a frequency"),
        ("1e999 rad", "rad", "a finite number"),
        ("1 m^9", "m", "a length"),
        ("9**9**9 m", "m", "a length"),
        ("__import__('os') m", "m", "a length"),
        ("9" * 5000, "m", "at most 80 characters"),
        (float("nan"), "m", "a finite number"),
        (float("-inf"), "m", "a finite number"),
        (10**400, "m", "a finite number"),
        (True, "m", "a length"),
        (None, "m", "a length"),
        ([1.0], "m", "a length"),
    ]:
        with pytest.raises(QuantityError) as caught:
            parse_quantity(text, unit)
        assert expected in caught.value.expected


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(FRIENDLY))
def test_written_text_gives_the_same_number(value: float, pair: tuple[str, str]) -> None:
    assert parse_quantity(write_si(value, *pair), pair[0]) == value


@given(st.floats(-1e6, 1e6), st.sampled_from(FRIENDLY))
def test_shown_text_gives_the_number_to_its_digits(value: float, pair: tuple[str, str]) -> None:
    assert parse_quantity(format_si(value, *pair), pair[0]) == pytest.approx(value, rel=5.1e-6)


@pytest.mark.parametrize("unit", ["N*m", "mN*m/A", "N*cm", "N*m*s/rad", "g*cm^2", "kg*m^2", "V/(N*m)"])
@pytest.mark.parametrize("read", [parse_any, lambda text: parse_quantity(text, "m"), parse])
def test_units_run_together_and_decimal_commas_are_met_with_what_was_meant(unit: str, read) -> None:
    together = unit.translate({ord(sign): None for sign in "*()"})
    for slip in (f"6.25 {together}", f"6,25 {unit}", f"6,25 {together.replace('^2', '²')}"):
        with pytest.raises(QuantityError) as caught:
            read(slip)
        assert str(caught.value).endswith((f"did you mean '6.25 {unit}'?", f"did you mean '{unit}'?")), slip


@given(
    st.lists(st.sampled_from(["s", "V", "Pa", "kg", "m^2"]), min_size=1, max_size=3),
    st.sampled_from(["*", " ", "·"]),
    st.sampled_from(["m^3/", "m/s/", "1/"]),
)
def test_what_stands_below_the_line_may_be_bracketed_as_tables_print_it(below: list, times: str, above: str) -> None:
    bracketed = parse_any(f"2 {above}({times.join(below)})")
    value, unit = parse_any(f"2 {above}{'/'.join(below)}")
    assert bracketed == (pytest.approx(value, rel=1e-15), unit)


@pytest.mark.parametrize(
    "text", ["2 m/(s", "2 m/s)", "2 m/()", "2 (m)", "2 m/(s/V)", "2 m/((s))", "11/(s*V)", "1/(J1*J2)"]
)
def test_other_brackets_are_no_units(text: str) -> None:
    with pytest.raises(QuantityError):
        parse_any(text)


@given(st.text(max_size=100), st.sampled_from(list(KINDS)))
def test_any_text_is_a_finite_number_or_refused(text: str, unit: str) -> None:
    try:
        assert math.isfinite(parse_quantity(text, unit))
    except QuantityError as error:
        assert error.expected


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("2.5 deg", math.radians(2.5), "rad"),
        ("3", 3.0, ""),
        (4, 4.0, ""),
        ("20 mm", 0.02, "m"),
        ("1 lbf", 4.448222, "N"),
    ],
)
def test_quantities_of_any_dimension(text: object, value: float, unit: str) -> None:
    number, found = parse_any(text)
    assert (number, found) == (pytest.approx(value, rel=1e-6), unit)


def test_a_dimension_without_a_name_of_its_own() -> None:
    number, unit = parse_any("3 mm/s^2")
    assert number == pytest.approx(0.003) and parse_quantity(f"1 {unit}", "m/s^2") == 1.0


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("40 V/rad", "V/rad"),
        ("100 V/s/rad", "V/rad/s"),
        ("2 rad/V/s", "rad/V/s"),
        ("0.05 N*m/A", "N*m/A"),
        ("2 kgf/A", "N/A"),
        ("5 Pa", "N/m^2"),
        ("3 kg/s", "N*s/m"),
        ("3 kg*m", "kg*m"),
        ("1 m/N", "m/N"),
        ("1 m/s^2", "m/s^2"),
        ("5 1/s", "1/s"),
        ("5 1/min", "1/s"),
        ("5 kHz", "Hz"),
        ("5 1/s^2", "1/s^2"),
        ("5 s^3", "s^3"),
    ],
)
def test_units_without_a_name_of_their_own_are_products_that_people_know(text: str, shown: str) -> None:
    number, unit = parse_any(text)
    assert unit == shown and units.dimensions(unit) == units.dimensions(text.split(" ", 1)[1])
    assert parse_any(f"{number!r} {unit}") == (number, unit)


def test_common_units_are_what_pint_says() -> None:
    for unit in units._COMMON:
        assert units._as_pint_has_it(unit) == units._COMMON[unit]


@pytest.mark.parametrize("failure", ["ImportError", "TypeError", "AttributeError"])
def test_a_pint_that_does_not_start_is_not_taken_for_a_unit_that_is_none(tmp_path, monkeypatch, failure: str) -> None:
    (tmp_path / "pint.py").write_text(f"raise {failure}('too old for this Python')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pint", raising=False)
    for remembered in (units._registry, units._as_pint_has_it):
        monkeypatch.setattr(units, remembered.__name__, remembered.__wrapped__)
    with pytest.raises(EppError, match=rf"pint, .* cannot be loaded \({failure}: too old for this Python\)"):
        parse_quantity("1 furlong", "m")


@pytest.mark.slow
def test_pint_is_imported_when_it_is_used() -> None:
    """And not for the units of the shipped cases."""
    code = """
import sys
import eppanalysis as epp
for name in epp.shipped_cases():
    epp.case(name)
sys.exit("pint" in sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_a_pint_that_cannot_be_loaded_is_said_with_its_reason() -> None:
    """An old one fails with whatever the libraries beside it raise, which is no reason to call a good unit unknown."""
    program = (
        "import sys\n"
        "class Broken:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'pint': raise TypeError('unexpected keyword argument')\n"
        "sys.meta_path.insert(0, Broken())\n"
        "import eppanalysis as epp\n"
        "try: epp.case('fig8a_original').with_values({'lock_pin.backlash': '5 arcmin'})\n"
        "except epp.EppError as error: print(error)\n"
        "print(epp.case('fig8a_original').with_values({'lock_pin.backlash': '2 deg'}).value('lock_pin.backlash'))\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    said = run.stdout.splitlines()
    assert "pint" in said[0] and "cannot be loaded (TypeError: unexpected keyword argument)" in said[0]
    assert said[1:] == ["0.03490658503988659"]
