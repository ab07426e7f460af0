"""Growth without end, recognised long before numbers end; and what only seems to grow or to repeat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.results import Status


def growing(delay: float = 2.0) -> epp.LureSystem:
    """A dead zone round 2 exp(-s delay)/(s + 1): far out the gain is 2, so it grows, with all switches at -1 and 1."""
    loop = epp.LureSystem.from_tf(([2.0], [1.0, 1.0]), epp.DeadZone(-1.0, 1.0))
    return replace(loop, delays=np.array([delay]), x0=np.array([9.0]))


GROW = {
    "play, wrong zero": (epp.LureSystem.from_tf(([-5.45, 95.9], [1.0, 0.92, 0.0]), epp.Play(0.3)), 30.0),
    "unstable pole": (
        replace(epp.LureSystem.from_tf(([2.0], [1.0, -0.5]), epp.Saturation(-1.0, 1.0)), x0=np.array([5.0])),
        60.0,
    ),
    "unstable pair": (
        replace(epp.LureSystem.from_tf(([1.0], [1.0, -0.2, 1.0]), epp.Saturation(-1.0, 1.0)), x0=np.array([5.0, 0.0])),
        250.0,
    ),
    "dead time": (growing(), 300.0),
}


@pytest.mark.parametrize("name", GROW)
def test_growth_beyond_all_levels_diverges_alone_and_in_a_batch(name: str) -> None:
    loop, t_end = GROW[name]
    run = epp.simulate(loop, t_end=t_end, t_eval=[t_end])
    assert run.status is Status.DIVERGED
    assert run.t[-1] == t_end  # by the verdict: no number is beyond all bounds yet
    stack = HybridStack.of([HybridSystem.from_lure(loop)], loop.signals.names)
    assert simulate_batch(stack, t_end).status == (Status.DIVERGED,)


@pytest.mark.parametrize("t_end", [40.0, 60.0, 100.0])
def test_growth_on_its_way_through_a_dead_time_is_no_cycle(t_end: float) -> None:
    """At its switches the only state is -1 or 1, and their times repeat: what grows is in the dead time."""
    run = epp.simulate(growing(), t_end=t_end, t_eval=[t_end])
    assert run.status is Status.UNDECIDED


def test_a_ramp_and_a_long_way_to_a_far_cycle_do_not_diverge() -> None:
    ramp = epp.LureSystem.from_tf(([1.0], [1.0, 0.0]), epp.Relay(1.0, 2.0))
    assert epp.simulate(ramp, t_end=1e5, t_eval=[1e5]).status is Status.UNDECIDED
    # Steep up to 1e5, flat beyond: it grows over five decades to a cycle.
    far = epp.PiecewiseLinear([-1e5, 1e5], [0.0, 3.0, 0.0], [-3e5, 0.0, 3e5])
    loop = replace(epp.LureSystem.from_tf(([3.0], [1.0, 2.0, 1.0, 0.0]), far), x0=np.array([1e-3, 0.0, 0.0]))
    assert {epp.simulate(loop, t_end=t, t_eval=[t]).status for t in (10.0, 20.0, 40.0, 300.0)} <= {
        Status.UNDECIDED,
        Status.LIMIT_CYCLE,
    }
