"""Branches of loops in discrete time against a law of scale and plain iterations."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError


def turn(system: epp.LureSystem, cycle: epp.LimitCycle) -> np.ndarray:
    """Input of the play over a turn from a cycle's state on, by the difference equation alone, and one sample more."""
    A, b, c, gap = system.A, system.B[:, 0], system.C[0], system.elements[0].gap
    x, held, seen = cycle.state, cycle.memory[0], []
    for _ in range(round(cycle.period / system.time_step) + 1):
        z = float(c @ x)
        held = min(max(held, z - gap / 2), z + gap / 2)
        seen.append(z)
        x = A @ x + b * held
    return np.array(seen)


def test_a_cycle_of_play_grows_with_its_gap() -> None:
    """A play and a linear loop have no other size than the gap: the cycle of 25 samples is the same in its units."""
    case = epp.case("backlash_discrete_pi")
    branch = epp.continue_branch(case, "play.gap", 1.0, 3.0, n_others=0, n_simulated=2, max_step=0.2)
    assert branch.ends == ("begins at the end of the range", "leaves the range")
    gaps, sizes = branch.points["value"], branch.points["m"]
    np.testing.assert_allclose(sizes / gaps, sizes[0] / gaps[0], rtol=1e-12)
    assert np.all(branch.points["period"] == 25.0) and np.all(branch.points["stable"]) and not branch.special
    # The run of the case at either end comes to it.
    np.testing.assert_allclose(branch.simulated["m"], 3.332089194 * branch.simulated["value"] / 2.0, rtol=1e-6)


@pytest.mark.slow
def test_a_relay_alternates_as_far_as_its_levels_let_it() -> None:
    """x -> x/2 - w/2: in turn x = (h + 2 l)/3 ... between levels l < 0 < h, while both have the sign that they need."""
    loop = epp.LureSystem.build([[0.5]], [[-0.5]], [[1.0]], [epp.Relay()], x0=[0.9], time_step=1.0, name="relay")
    case = epp.Case.from_system(loop, name="relay").with_values({"run.t_end": "100 s"})
    branch = epp.continue_branch(case, "relay.high", 1.0, 3.0, n_others=0, max_step=0.25)
    # From x > 0 to x' = x/2 - h/2 < 0 and back to x = x'/2 - l/2, with l = -1: x = (2 - h)/3, x' = (1 - 2 h)/3.
    np.testing.assert_allclose(branch.points["period"], 2.0)
    high = branch.points["value"]
    np.testing.assert_allclose(branch.points["relay_input"], (1.0 + high) / 3.0, rtol=1e-12)
    # At h = 2 the larger one is at the relay's threshold.
    assert high.max() == pytest.approx(2.0, abs=1e-5)
    assert "ceases to exist" in branch.special[0].note


def test_folds_of_loops_in_discrete_time_are_refused() -> None:
    case = epp.case("backlash_discrete_pi")
    with pytest.raises(EppError, match="continue_folds does not cover loops in discrete time: locked cycles end"):
        epp.continue_folds(case, "play.gap", "loop.time_step", (1.0, 2.0), (0.5, 1.5))


def test_cycles_at_special_points_are_those_of_their_value() -> None:
    """Beyond kp = 0.2 others have another number of samples: what is told of a border is a cycle of the loop there."""
    case = epp.case("backlash_discrete_pi")
    branch = epp.continue_branch(case, "play.gap", 1.0, 3.0, n_others=0, max_step=0.5)
    for special in branch.special:
        system = case.with_values({"play.gap": special.value}).to_system()
        seen = turn(system, special.cycle)
        assert seen[-1] == pytest.approx(seen[0], abs=1e-10)
        np.testing.assert_allclose(seen[:-1], special.cycle.waveform["m"], atol=1e-10)
