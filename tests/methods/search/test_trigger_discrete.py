"""In discrete time: the smallest disturbances that start a cycle, beside a plain iteration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import mostly_slow
from tests.stress.machine import iterate

#: Three lags under a relay that is silent near zero. The input acts on a lag and on the relay.
A = np.array([[0.7, 0.0, 0.0], [0.25, 0.75, 0.0], [0.06, 0.25, 0.7]])
LOOP = epp.LureSystem.build(
    A, [[-2.4], [0.0], [0.0]], [[0.0, 0.0, 1.0]], [epp.RelayDeadZone(1.0, 1.0)], x0=[0.1, 0.0, 0.0], time_step=0.5,
    B_input=[[0.3], [0.0], [0.0]], D_input=[[1.0]], input_names=["command"],
)  # fmt: skip


def rests(loop: epp.LureSystem) -> bool:
    """Whether the plain iteration has come to rest, where else it swings beyond the dead zone."""
    late = iterate(loop, {}, 600)[-40:]
    return bool(np.ptp(late, axis=0).max() < 1e-6)


@pytest.fixture(scope="module")
def cycles() -> epp.CycleSearch:
    return epp.find_limit_cycles(LOOP)


@pytest.mark.parametrize("place", mostly_slow([0, 1, 2], [2]))
def test_a_state_is_displaced_as_far_as_the_difference_equation_needs(cycles: epp.CycleSearch, place: int) -> None:
    hits = epp.trigger(LOOP, cycles=cycles, states=[f"x{place}"])[2:]
    assert [np.sign(hit.size) for hit in hits] == [1.0, -1.0]
    for hit in hits:
        assert abs(hit.starts / hit.settles - 1.0) < 2e-7 and not hit.not_covered
        assert rests(replace(LOOP, x0=hit.settles * np.eye(3)[place]))
        assert not rests(replace(LOOP, x0=hit.starts * np.eye(3)[place]))


@pytest.mark.parametrize("hand", [0.0, 0.4])
def test_an_input_is_stepped_as_far_as_the_difference_equation_needs(cycles: epp.CycleSearch, hand: float) -> None:
    """From the rest at which the loop is, wherever its input stands."""
    for hit in epp.trigger(LOOP, {"command": hand}, cycles=cycles, states=()):
        rest = np.linalg.solve(np.eye(3) - A, LOOP.B_input[:, 0] * hand)
        for size, ends in ((hit.settles, True), (hit.starts, False)):
            assert rests(replace(LOOP, x0=rest, v0=np.array([hand + size]))) is ends


def test_outputs_on_their_way_are_not_displaced(cycles: epp.CycleSearch) -> None:
    """With a dead time of one sample what is on its way stays that of rest, and a state of its own holds it."""
    late = replace(LOOP, delays=np.array([0.5]), A=0.9 * A)
    chain = np.block([[0.9 * A, LOOP.B], [np.zeros((1, 4))]])
    same = epp.LureSystem.build(
        chain, [[0.0], [0.0], [0.0], [1.0]], [[0.0, 0.0, 1.0, 0.0]], list(LOOP.elements), x0=[0.1, 0.0, 0.0, 0.0],
        time_step=0.5, B_input=[[0.3], [0.0], [0.0], [0.0]], D_input=[[1.0]], input_names=["command"],
    )  # fmt: skip
    one, other = (epp.trigger(loop, states=["x2"]) for loop in (late, same))
    assert [a.size for a in one] == pytest.approx([b.size for b in other], rel=1e-6)
