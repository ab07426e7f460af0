"""Cycles of closed orbits: an orbit has one, of each loop that it is shown to."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

import eppanalysis as epp
from eppanalysis.methods.orbits import cycle
from eppanalysis.methods.orbits.exact import orbits_of, steady_hybrid
from tests.shared import predicted


def test_the_period_of_an_orbit_is_run_once_in_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    shaped, shown = cycle.orbit_shape, Counter[object]()

    def counted(system, orbit):
        shown[orbit] += 1
        return shaped(system, orbit)

    monkeypatch.setattr(cycle, "orbit_shape", counted)
    assert len(epp.find_limit_cycles(epp.case("relay_deadzone"))) == 2
    assert set(shown.values()) == {1}


def test_of_another_loop_an_orbit_has_a_cycle_of_its_own() -> None:
    system = epp.case("relay_deadzone").to_system()
    start, at = predicted("relay_deadzone")[-1], epp.case("relay_deadzone").operating_point
    orbit = next(orbits_of(system, steady_hybrid(system), start, at)).orbit
    own = cycle.to_limit_cycle(system, orbit)
    other = cycle.to_limit_cycle(replace(system, name="another"), orbit)
    assert (own.provenance.settings["system"], other.provenance.settings["system"]) == (system.name, "another")
    assert own.period == other.period and own.peak_to_peak == other.peak_to_peak
