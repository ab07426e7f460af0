"""What the first sentence counts: cycles that harmonics leave, beside those that they take away."""

from __future__ import annotations

import re

import numpy as np
import pytest

import eppanalysis as epp


def drive(play: float, coulomb: float, kp: float, ki: float, mass: float, spring: float, at_sensor: bool):
    """A mass with dry friction under PI control, a play before the force or behind the position."""
    parts = {
        "c": epp.blocks.PI(kp=kp, ki=ki),
        "mass": epp.blocks.Mass(mass=mass, damping=0.1, stiffness=spring),
        "friction": epp.Friction(coulomb),
        "play": epp.Play(play),
        "ref": epp.blocks.Constant(value=1.0),
    }
    ways = (
        ("mass.position -> play", "ref - play -> c", "c")
        if at_sensor
        else ("c -> play", "ref - mass.position -> c", "play")
    )
    connect = [*ways[:2], f"{ways[2]} - friction -> mass.force", "mass.speed -> friction"]
    return epp.Diagram(parts=parts, connect=connect).to_system()


LOOPS = {
    "slow ghost": lambda: drive(0.04, 0.46, 4.18, 0.397, 0.93, 0.0, False),
    "behind the position": lambda: drive(0.12, 0.272, 3.92, 1.586, 0.226, 0.0, True),
    "on a spring": lambda: drive(0.1, 0.3, 4.0, 1.0, 0.5, 0.5, True),
    **{n: lambda n=n: epp.case(n) for n in ("backlash_servo", "sat_plus_backlash", "elbow_cycle_not_there")},
    **{n: lambda n=n: epp.case(n) for n in ("sat_khalil710", "pid_hunting")},
}


@pytest.mark.parametrize("name", LOOPS)
def test_the_headline_counts_what_harmonics_leave(name):
    found = epp.predict_limit_cycles(LOOPS[name]())
    gone = sum(np.isinf(cycle.error_estimate) for cycle in found)
    left = len(found) - gone
    first = str(found).split(" Hz")[0].split(".")[0]
    if left or not gone:
        counted = re.match(
            r"The describing function predicts (\d+|no)( stable| unstable)? limit cycles?\b(?! that may not)", first
        )
        assert counted is not None and counted[1] == (str(left) if left else "no")
        assert (f", and {gone} more that may not exist" in str(found)) == bool(gone)
    else:
        assert re.match(
            rf"The describing function predicts {gone}( stable| unstable)? limit cycles? that may not exist,", first
        )


def test_a_ghost_far_below_all_that_moves_is_told_as_one():
    """A play behind an integrator, balanced where harmonics that first order neglects are as large as what it keeps."""
    (ghost,) = epp.predict_limit_cycles(LOOPS["slow ghost"]())
    assert ghost.frequency < 0.01 and ghost.may_not_exist
