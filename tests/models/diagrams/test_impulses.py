"""An element whose output has impulses in a loop whose signals nobody named; closed form: a jet that fires at a band.

A body that coasts freely gets a change of speed of D at either edge of a band of half width b: from a speed v at the
upper edge on it comes back with D - v, so that a turn takes 2 b (1/v + 1/(D - v)).
"""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import EppError

_DIAGRAM = """
kind = "diagram"
title = "Attitude hold by impulse bits"
connect = {connect}
signals = {{ angle = {{ of = "body.angle" }}{more} }}
[blocks]
body = {{ kind = "inertia", inertia = 2.0, start = [0, {speed}] }}
{blocks}
[elements.valve]
element = "automaton"
modes.idle = {{}}
guards = [
 {{ name = "up", mode = "idle", target = "idle", on_input = 1, constant = -{band}, impulse = {bit} }},
 {{ name = "down", mode = "idle", target = "idle", on_input = -1, constant = -{band}, impulse = {bit} }},
]
[run]
t_end = {t_end}
"""
_STRAIGHT = '["body.angle -> valve", "-valve -> body"]'


def _diagram(band: float, kick: float, speed: float, t_end: float, **others: str) -> epp.Case:
    """The body, of inertia 2, whose speed the impulse of the valve changes by `kick`."""
    text = {"connect": _STRAIGHT, "blocks": "", "more": "", **others}
    return epp.case_from_text(
        _DIAGRAM.format(band=band, bit=2.0 * kick / band, speed=speed, t_end=t_end, **text), "impulse_bits"
    )


def _loop(band: float, kick: float, speed: float, t_end: float) -> epp.LureSystem:
    build = epp.AutomatonBuilder()
    idle = build.mode("idle")
    build.guard("up", idle, idle, on_input=1.0, constant=-band, impulse=kick / band)
    build.guard("down", idle, idle, on_input=-1.0, constant=-band, impulse=kick / band)
    valve = epp.AutomatonElement(build.build(idle))
    return epp.LureSystem.build([[0.0, 1.0], [0.0, 0.0]], [[0.0], [-1.0]], [[1.0, 0.0]], [valve], x0=[0.0, speed])


@given(band=st.floats(1e-3, 1e3), kick=st.floats(0.1, 10.0), share=st.floats(0.1, 0.9))
@settings(max_examples=10, deadline=None)
def test_a_jet_that_fires_at_a_band_has_the_period_of_the_closed_form(band, kick, share):
    speed = share * kick
    turn = 2.0 * band * (1.0 / speed + 1.0 / (kick - speed))
    for made in (_diagram, _loop):
        run = epp.simulate(made(band, kick, speed, 12.0 * turn), t_end=12.0 * turn)
        assert run.limit_cycle is not None and run.limit_cycle.period == pytest.approx(turn, rel=1e-9)
        # Its impulses have no value: the output is no signal, what it acts on is.
        assert not {"valve", "automaton_output"} & set(run.signals)
        assert {"valve_in", "automaton_input"} & set(run.signals)


def test_an_output_that_hands_impulses_on_is_no_signal():
    others = {
        "connect": '["body.angle -> valve", "valve -> twice", "-twice -> body"]',
        "blocks": 'twice = { kind = "gain", gain = 2.0 }',
    }
    run = epp.simulate(_diagram(0.5, 1.0, 0.6, 100.0, **others), t_end=100.0)
    assert run.limit_cycle is not None
    assert run.limit_cycle.period == pytest.approx(1.0 / 0.6 + 1.0 / 1.4, rel=1e-9)  # its kick is twice as large
    assert not {"twice", "valve"} & set(run.signals)


def test_a_signal_that_is_asked_for_and_has_impulses_is_refused():
    with pytest.raises(EppError, match="the output of valve has impulses"):
        epp.simulate(_diagram(0.5, 1.0, 0.6, 100.0, more=', jet = { of = "valve" }'))
