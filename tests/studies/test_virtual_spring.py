"""Virtual springs and walls: the engine's largest stiffness is that of closed forms from sample to sample."""

from __future__ import annotations

import pytest

import eppanalysis as epp
from studies.virtual_spring import STARTS, Haptic, by_closed_forms, by_engine, comes_to_rest

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("device", "known"), list(zip(STARTS, (3454.0, 544.0, 2200.0, 2200.0), strict=True)))
def test_the_largest_stiffness_is_that_of_closed_forms(device, known):
    reference = by_closed_forms(device)
    assert reference == pytest.approx(known, rel=1.5e-3)
    assert by_engine(device, reference) == pytest.approx(reference, rel=1e-3)


@pytest.mark.parametrize("stiffness", [3450.0, 3455.0, 3457.0, 3548.0, 3555.0, 3570.0])
def test_islands_of_rest_are_the_same(stiffness):
    device = Haptic(2e-4)
    assert device.settles(stiffness) is comes_to_rest(device, stiffness) is (stiffness not in (3455.0, 3555.0))


def test_friction_lets_small_motion_be_stiffer_than_passivity_and_large_motion_less():
    small, large = (by_closed_forms(device) for device in STARTS[:2])
    damping, friction = STARTS[0].bounds
    assert (damping, friction) == pytest.approx((200.0, 2000.0))
    assert damping < large < friction < small


def test_a_wall_has_no_place_of_rest_beyond_the_hand_and_friction_over_five_steps():
    """At 2200 N/m the force of five steps is the hand's and friction's, 0.55 N, and that of four is 0.44 N."""
    wall = Haptic(-2e-4, wall=True, hand=0.5)
    limit = (wall.hand + wall.coulomb) / (5.0 * wall.quantum)
    assert wall.settles(0.995 * limit) and not wall.settles(1.005 * limit)
    places = [0.5 - 1.005 * limit * wall.quantum * n for n in range(20)]
    assert not any(abs(force) <= wall.coulomb for force in places)


@pytest.mark.parametrize(
    ("aside", "stiffness", "rests"), [("5 mm", 540, True), ("5 mm", 551, False), ("0.2 mm", 3400, True)]
)
def test_the_case_that_ships_is_that_spring(aside, stiffness, rests):
    case = epp.case("virtual_spring").with_values({"aside": aside, "K": stiffness})
    run = epp.simulate(case, t_end=60.0, t_eval=[60.0], max_events=60_000)
    assert (run.status is epp.Status.SETTLED) is rests
    device = Haptic(case.value("aside"))
    assert comes_to_rest(device, float(stiffness)) is rests
