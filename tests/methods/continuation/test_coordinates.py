"""Branches do not depend on the coordinates of a loop's state, nor on the units of its time and amplitudes.

Some turns and units each; `tests/stress` has more of them.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.coordinates import UNITS, InOtherWords, rescaled, rotated
from tests.sampled_relay import sampled_relay
from tests.shared import mostly_slow

#: Parameter and range of a branch: relays, rings, a smooth element, dead time, servos, stiction, an elbow.
BRANCHES = {
    "backlash_servo": ("play.gap", 2.0, 1.0),
    "band_two_cycles": ("dead_zone_saturation.limit", 2.0, 1.0),
    "belt_leine": ("friction.stribeck", 3.0, 1.0),
    "clegg_loop": ("gain", 3.0, 2.0),
    "fig8a_original": ("lock_pin.backlash", "2.5 deg", "0.6 deg"),
    "freeplay_section": ("hinge_spring", 1.0, 0.8),
    "pid_hunting": ("controller.ki", 5.0, 2.0),
    "quantised_sensor_ct": ("quantiser.step", 1.0, 2.0),
    "relay_biased_fopdt": ("hysteresis_relay.high", 1.3, 0.7),
    "relay_deadzone": ("relay_dead_zone.threshold", 1.0, 3.0),
    "relay_fopdt_closed": ("loop.delay", 0.5, 1.0),
    "relay_hyst_goncalves6": ("hysteresis_relay.upper", 0.25, 1.0),
    "robot_servo": ("Kp", 60.0, 50.0),
    "sat_asymmetric": ("saturation.upper", 2.0, 0.5),
    "sat_plus_backlash": ("play.gap", 1.0, 3.0),
    "thruster_dz_hyst": ("thruster.off", 0.08, 0.02),
    "two_mass_damped_shaft": ("nordin_shaft.gap", 0.02, 0.04),
    "van_der_pol_mu1": ("cube.scale", 1.0 / 3.0, 1.0),
    "wheelchair": ("play.gap", 0.012, 0.02),
}
QUICK = [
    "clegg_loop",
    "freeplay_section",
    "relay_deadzone",
    "relay_fopdt_closed",
    "relay_hyst_goncalves6",
    "two_mass_damped_shaft",
]
#: Sampled loops: a relay, and a converter whose quantisers meet no sample at a tie, which rounding would decide.
SAMPLED = {
    "relay": (sampled_relay, ("dead", 0.05, 0.2)),
    "converter": (
        lambda: epp.case("buck_converter").with_values({"law.kp": 0.0417, "law.ki": 331.7}),
        ("supply", 5.0, 5.5),
    ),
}
#: Loops with parts whose units are not told are turned only.
TURNED_ONLY = {"clegg_loop", "fig8a_original"}


@functools.cache
def as_given(name: str) -> epp.Branch:
    """The branch of a shipped case."""
    return epp.continue_branch(epp.case(name), *BRANCHES[name])


def branch_alike(name: str, other: InOtherWords, amplitude: float = 1.0) -> None:
    """A case in other words has the same branch: folds, ends, other special points, stability, and its sentence."""
    wanted, found = as_given(name), epp.continue_branch(other, *BRANCHES[name])
    assert str(found) == str(wanted)
    assert len(found.others) == len(wanted.others)
    for mine, theirs in zip((found, *found.others), (wanted, *wanted.others), strict=True):
        assert (mine.ends, mine.status) == (theirs.ends, theirs.status)
        assert [s.kind for s in mine.special] == [s.kind for s in theirs.special]
        np.testing.assert_allclose([f.value for f in mine.folds], [f.value for f in theirs.folds], rtol=1e-8)
        # Where a contact grazes the engine says to some 1e-6 only on which side of the change an orbit is.
        np.testing.assert_allclose([s.value for s in mine.special], [s.value for s in theirs.special], rtol=3e-6)
        np.testing.assert_allclose(mine.points["value"][[0, -1]], theirs.points["value"][[0, -1]], rtol=1e-6)
        for key, unit in (("period", other.time), (mine.signals[0], amplitude)):
            inner = slice(None) if "continuum" not in str(mine) else slice(1)
            np.testing.assert_allclose(
                mine.points[key][[0, -1]][inner] / unit, theirs.points[key][[0, -1]][inner], rtol=1e-6
            )
        assert mine.points["stable"][0] == theirs.points["stable"][0]
        last = -2 if "continuum" in str(mine) else -1
        assert mine.points["stable"][last] == theirs.points["stable"][last]


def turned(name: str, seed: int) -> InOtherWords:
    """The case with its state turned."""
    return InOtherWords(epp.case(name), lambda system: rotated(system, seed))


def in_units(name: str, time: float, amplitude: float, states: int | None) -> InOtherWords:
    """The case with time, amplitudes and states in other units."""
    return InOtherWords(epp.case(name), lambda system: rescaled(system, time, amplitude, states), time)


@pytest.mark.parametrize("name", mostly_slow(QUICK, ("relay_deadzone", "relay_fopdt_closed")))
def test_branches_do_not_depend_on_coordinates_and_units(name):
    branch_alike(name, turned(name, 2))
    if name not in TURNED_ONLY:
        branch_alike(name, in_units(name, *UNITS[0]), UNITS[0][1])


@pytest.mark.parametrize(("name", "seed"), [pytest.param("relay", 0, marks=pytest.mark.slow), ("converter", 1)])
def test_branches_of_sampled_loops_do_not_depend_on_coordinates(name, seed):
    make, (parameter, *over) = SAMPLED[name]
    cases = make(), InOtherWords(make(), lambda system: rotated(system, seed))
    wanted, found = (epp.continue_branch(case, parameter, *over, n_others=0, max_step=0.1) for case in cases)
    assert (str(found), found.ends) == (str(wanted), wanted.ends) and found.points["samples"][0] > 8
    assert [(s.kind, s.note, s.index) for s in found.special] == [(s.kind, s.note, s.index) for s in wanted.special]
    for key in ("value", "period", "samples", "stable", wanted.signals[0]):
        np.testing.assert_allclose(found.points[key], wanted.points[key], rtol=1e-6)


def same_end(case: epp.Case, over: tuple, seed: int) -> epp.Branch:
    """The branch of a case, which ends within the range as that of the case in turned states does."""
    other = InOtherWords(case, lambda system: rotated(system, seed))
    wanted, found = (epp.continue_branch(one, *over, n_others=0) for one in (case, other))
    assert (str(found), found.ends, found.status) == (str(wanted), wanted.ends, wanted.status)
    assert [s.kind for s in found.special] == [s.kind for s in wanted.special]
    np.testing.assert_allclose([s.value for s in found.special], [s.value for s in wanted.special], rtol=1e-6)
    np.testing.assert_allclose(found.points["value"][-1], wanted.points["value"][-1], rtol=1e-6)
    return wanted


@pytest.mark.slow
def test_where_a_branch_ends_at_a_grazing_contact_does_not_depend_on_coordinates():
    """The branch ended with its last step, wherever that was, and not at the contact."""
    branch = same_end(epp.case("level_valve"), ("linkage.gap", "4 mm", "2 mm"), 0)
    assert branch.points["value"][-1] == branch.special[-1].value


@pytest.mark.parametrize("seed", mostly_slow([0, 1], [1]))
def test_a_cycle_that_creeps_to_a_threshold_has_an_infinite_period_in_all_coordinates(seed):
    """A drive under a relay that has let go comes to rest just on its other threshold; order and period were chance."""
    ring = [epp.RelayDeadZone(0.08), ([4.0], [0.2, 1.0, 0.0]), epp.Play(0.1)]
    loop = epp.LureSystem.from_blocks(ring)
    case = epp.Case.from_system(replace(loop, x0=np.array([0.6, 0.0])))
    (end,) = same_end(case, ("relay_dead_zone.threshold", 0.08, 0.3), seed).special
    # Pushed for good the drive settles at a speed of 4; let go it goes on by as much as 0.2 s of that at most.
    assert end.kind == "infinite period" and 0.08 < end.value < 0.8


@pytest.mark.slow
def test_the_branch_of_an_elbow_does_not_depend_on_coordinates():
    """Its stiff contacts kept every orbit from closing, and beside a grazing contact a step collapsed to rest."""
    branch_alike("fig8a_original", turned("fig8a_original", 4))
