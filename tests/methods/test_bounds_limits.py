"""Every kind of parameter as the limit: its exact bound, the safe side, and what runs and the full search say of both.

All begin from one exact orbit, the one at the bound on backlash. At a backlash a little beside that bound the bound on
another parameter is close by: the orbit leads to it, so that no search by harmonic balance is needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.bounds_exact import correct, searched
from eppanalysis.methods.bounds_fold import Cycle
from eppanalysis.methods.bounds_harmonic import (
    Finding,
    Outlook,
    Question,
    idle,
    inputs_at_end,
    look,
    steady_loop,
)
from eppanalysis.methods.bounds_verify import verify
from eppanalysis.methods.exact import start_of, steady_hybrid
from eppanalysis.methods.harmonic_loop import inputs_of
from eppanalysis.methods.simulate import judge, run_hybrid
from eppanalysis.results import LimitCycle, Status

BACKLASH = "lock_pin.backlash"
#: Limit, backlash [deg], side that has cycles, distance of the tests (those that move the bound on backlash little are
#: tested farther away: a cycle that is about to vanish takes long to fade), and the bound on it as a share of its own.
LIMITS = [
    ("bands.range", 1.0217, -1.0, 0.01, 1.0396),
    ("bands.max", 0.9980, -1.0, 0.01, 1.0300),
    ("bands.parking_width", 0.9956, -1.0, 0.02, 1.0395),
    ("cable.stiffness", 0.9209, 1.0, 0.01, 1.0400),
    ("forearm.prehensor_mass", 0.9757, 1.0, 0.05, 1.0415),
    ("forearm.inertia", 0.97527, 1.0, 0.05, 1.0420),
    ("controller.delay", 0.97797, 1.0, 0.2, 1.0390),
    ("drive.inertia", 0.97518, 1.0, 0.05, 1.0382),
    ("drive.stall_torque", 0.94802, 1.0, 0.01, 1.0403),
    ("drive.coulomb_friction", 0.98305, -1.0, 0.05, 1.0395),
]


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return epp.case("fig8a_original")


@pytest.fixture(scope="module")
def orbit(case: epp.Case) -> LimitCycle:
    """At the bound on backlash, 0.9786 deg."""
    branch = epp.continue_branch(case, BACKLASH, "1.1 deg", "0.9 deg", n_points=80, max_step=0.05)
    return min(branch.folds, key=lambda f: f.value).cycle


def question_at(case: epp.Case, limit: str, backlash: float) -> Question:
    own = case.value(limit)
    return Question(case.with_values({BACKLASH: f"{backlash} deg"}), limit, 0.8 * own, 1.3 * own)


def ends(question: Question, value: float, orbit: LimitCycle) -> Status:
    """Where an event-exact run from a state of the orbit ends at a value of the limit."""
    case = question.case_at(value)
    system = case.to_system()
    hybrid = steady_hybrid(system, inputs_at_end(case, system))
    x0, H0 = start_of(hybrid, orbit)
    hybrid = replace(hybrid, x0=x0, H0=H0)
    t = 400.0 * orbit.period
    return judge(hybrid, run_hybrid(hybrid, t, np.zeros(0), 2.0 * hybrid.time_scale, 400_000, 4000), t)[0]


@pytest.mark.parametrize(("limit", "backlash", "sign", "margin", "share"), LIMITS, ids=[row[0] for row in LIMITS])
def test_bound_on_any_parameter(
    case: epp.Case, orbit: LimitCycle, limit: str, backlash: float, sign: float, margin: float, share: float
) -> None:
    question = question_at(case, limit, backlash)
    near = Cycle(share * case.value(limit), inputs_of(steady_loop(case), orbit)[:, :10], orbit.omega)
    found = correct(question, near, sign)
    assert found.kind == "fold" and found.cycle is not None, found.message
    assert found.value / case.value(limit) == pytest.approx(share, abs=2e-3)
    # The fold in backlash of the case with this value of the limit is the backlash of the question.
    there = case.with_values({limit: found.value})
    branch = epp.continue_branch(there, BACKLASH, "1.1 deg", "0.85 deg", n_points=80, max_step=0.05)
    assert np.degrees(min(f.value for f in branch.folds)) == pytest.approx(backlash, rel=1e-6)
    test = verify(question, found.value, sign, found.cycle, margin=margin, n_starts=40, seed=1)
    assert test.verified, test.message
    assert test.search is not None and len(test.search) == 0 and test.n_settled == 40
    # Runs from the orbit at the bound itself: to rest on the safe side, to the stable cycle on the other.
    assert ends(question, found.value * (1.0 - sign * margin), found.cycle) is Status.SETTLED
    assert ends(question, found.value * (1.0 + sign * margin), found.cycle) is Status.LIMIT_CYCLE
