"""Files as people write them: the words of other programs, numbers of data sheets, and what is left out."""

from __future__ import annotations

import math

import pytest

import eppanalysis as epp

SERVO = epp.case("azimuth_servo").to_toml()


def servo(*changes: tuple[str, str]) -> epp.Case:
    """The shipped servo with other lines."""
    text = SERVO
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return epp.case_from_text(text, "servo")


def test_numbers_of_a_data_sheet() -> None:
    """A ratio, a step as an angle over its counts, and who gives the number."""
    found = servo(
        ("ratio = 50", 'ratio = { value = "36:1", mark = "data sheet", note = "page 3" }'),
        ('step = "2*pi/2^12"', 'step = "360/2000 deg"'),
        ('Ti = { value = "0.4 s"', 'Ti = { value = "1/2.5 s"'),
    )
    ratio = found.parameters["motor.ratio"]
    assert (ratio.value, ratio.mark, ratio.note) == (36.0, "data sheet", "page 3")
    assert found.parameters["encoder.step"].value == pytest.approx(math.radians(0.18), rel=1e-15)
    assert found.parameters["Ti"].value == 0.4
    assert epp.case_from_text(found.to_toml()).parameters == found.parameters
