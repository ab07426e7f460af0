"""Where a listed orbit begins and in which order mirror images stand: rules for all states and starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.results import smallest_first
from tests.coordinates import rotated
from tests.shared import cycles_of

NAMES = ["relay_deadzone", "relay_hyst_servo", "sat_am165", "freeplay_section", "backlash_servo", "relay_fopdt_closed"]


def events(cycle: epp.LimitCycle) -> list[tuple[str, str]]:
    return [(e.element, e.name) for e in cycle.events]


@pytest.mark.parametrize("name", NAMES)
def test_an_orbit_begins_at_the_same_event_wherever_along_it_it_is_closed(name: str) -> None:
    """The halves of a symmetric orbit take as long but for rounding, which chose between them."""
    system = epp.case(name).to_system()
    for cycle in cycles_of(name):
        for first in range(len(cycle.event_states)):
            states = np.roll(cycle.event_states, -first, axis=0) * (1.0 + 1e-9)
            anew = epp.exact_orbit(system, replace(cycle, state=states[0], memory=(), event_states=states))
            assert anew.status.ok and events(anew) == events(cycle)
            assert anew.state == pytest.approx(cycle.state, abs=1e-8 * np.ptp(states, axis=0).max())


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (i > 1)) for i, n in enumerate(NAMES)])
def test_a_search_lists_the_same_phases_in_the_same_order_in_turned_states_and_from_another_start(name: str) -> None:
    system, wanted = epp.case(name).to_system(), cycles_of(name)
    for seed in range(2):
        found = epp.find_limit_cycles(rotated(replace(system, x0=(1.0 + seed) * system.x0), seed))
        assert [events(c) for c in found] == [events(c) for c in wanted]
        for here, there in zip(found, wanted, strict=True):
            for signal, size in there.peak_to_peak.items():
                assert here.harmonics[signal][:4] == pytest.approx(there.harmonics[signal][:4], abs=1e-6 * size + 1e-12)


def test_mirror_images_are_told_by_their_means_and_else_by_their_events() -> None:
    """They are equal in size and period but for rounding; one begins with the image of what the other begins with."""
    pair = [c for c in cycles_of("freeplay_section") if c.period == pytest.approx(0.1917889, rel=1e-6)]
    assert len(pair) == 2 and pair[0].state == pytest.approx(-pair[1].state, abs=1e-9)
    for up, down in ((1e-15, -1e-15), (-1e-15, 1e-15), (0.0, 0.0)):
        moved = [replace(c, period=c.period * (1.0 + by)) for c, by in zip(pair, (up, down), strict=True)]
        for given in (moved, moved[::-1]):
            assert [events(c) for c in smallest_first(given)] == [events(c) for c in pair]
    larger = replace(pair[0], period=1.001 * pair[0].period)
    assert smallest_first([larger, pair[1]]) == [pair[1], larger]
