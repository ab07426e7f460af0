"""The section with freeplay against cycles of another program, and of another way to write it."""

import numpy as np
import pytest

import eppanalysis as epp
from tests.freeplay import freeplay


def test_the_symmetric_cycles_are_those_of_half_orbit_shooting():
    """Frequencies [Hz] and peaks [deg] of the surface at 14 m/s."""
    case = epp.case("freeplay_section")
    found = [epp.exact_orbit(case, c) for c in epp.predict_limit_cycles(case)]
    peaks = [np.degrees(c.peak_to_peak["surface"]) / 2 for c in found]
    assert [c.frequency for c in found] == pytest.approx([5.179408, 10.987684], rel=1e-6)
    assert peaks == pytest.approx([2.9922, 3.5943], abs=1e-4)


def test_it_is_the_section_of_the_equations_at_its_speed():
    written, equations = epp.case("freeplay_section").to_system(), freeplay(14.0)
    np.testing.assert_allclose(written.A, equations.A, rtol=1e-9)
    np.testing.assert_allclose(written.B, equations.B, rtol=1e-12)
