"""Loops without a state: an element and a gain round it, which every analysis answers as any other loop."""

from __future__ import annotations

import pytest

import eppanalysis as epp


def _loop(element: epp.Nonlinearity, gain: float) -> epp.LureSystem:
    return epp.LureSystem.build([], [], [], [element], D=[[gain]])


@pytest.mark.parametrize("element", [epp.Saturation(), epp.Play(1.0)], ids=["saturation", "play"])
def test_a_loop_without_states_rests(element: epp.Nonlinearity) -> None:
    loop = _loop(element, -0.5)
    assert epp.simulate(loop, t_end=1.0).status is epp.Status.SETTLED
    found = epp.find_limit_cycles(loop)
    assert not found and found.settles and not found.diverges and found.status is epp.Status.CONVERGED
    assert epp.trigger(loop) == ()
    assert not epp.ladder(loop).to_frame().empty


@pytest.mark.parametrize("element", [epp.Relay(), epp.HysteresisRelay(-0.1, 0.1)], ids=["relay", "with hysteresis"])
def test_a_relay_that_acts_straight_against_itself_switches_without_end(element: epp.Nonlinearity) -> None:
    loop = _loop(element, -0.5)
    assert epp.simulate(loop, t_end=1.0).status is epp.Status.EVENT_LIMIT
    found = epp.find_limit_cycles(loop)
    assert not found and not found.settles and found.status is epp.Status.UNDECIDED
