"""Loops in one diagram that do not act on one another: the predictions of each alone, whatever stands beside it."""

from __future__ import annotations

import pickle
from itertools import permutations

import numpy as np
import pytest

import eppanalysis as epp

#: Element and plant of closed loops: two that oscillate, one with a stable and an unstable cycle, two that rest.
LOOPS = {
    "relay": (epp.Relay(), ([2.0], [1.0, 3.0, 3.0, 1.0])),
    "switch": (epp.HysteresisRelay(-0.3, 0.3, low=-2.0, high=2.0), ([5.0], [1.0, 2.0, 3.0, 1.0])),
    "band": (epp.RelayDeadZone(0.1), ([1.0], [1.0, 3.0, 2.0, 0.0])),
    "limit": (epp.Saturation(), ([1.0], [1.0, 3.0, 3.0, 1.0])),
    "wide": (epp.Saturation(-2.0, 2.0), ([1.0], [1.0, 3.0, 3.0, 1.0])),
}


def diagram(*names: str, set_point: float = 0.0) -> epp.LureSystem:
    """The loops side by side, each with the set point."""
    parts, connect = {}, []
    for name in names:
        element, (num, den) = LOOPS[name]
        parts |= {name: element, f"plant_{name}": epp.blocks.TransferFunction(num=num, den=den)}
        connect += [f"r - plant_{name} -> {name}", f"{name} -> plant_{name}"]
    return epp.Diagram(parts=parts, connect=connect, inputs={"r": set_point}).to_system()


def alone(name: str) -> list[tuple[float, float, bool]]:
    found = epp.predict_limit_cycles(diagram(name, set_point=0.05))
    return [(c.omega, c.amplitude(f"plant_{name}"), c.stable) for c in found]


PAIRS = list(permutations(list(LOOPS)[:4], 2))


@pytest.mark.parametrize("names", [*(pytest.param(pair, marks=pytest.mark.slow) for pair in PAIRS), tuple(LOOPS)])
def test_each_loop_has_the_cycles_that_it_has_alone(names) -> None:
    found = epp.predict_limit_cycles(diagram(*names, set_point=0.05))
    for name in names:
        own = [c for c in found if c.elements[name]["amplitude"] > 0.0]
        told = [(c.omega, c.amplitude(f"plant_{name}"), c.stable) for c in own]
        assert np.shape(told) == np.shape(alone(name))
        np.testing.assert_allclose(np.array(told, float), np.array(alone(name), float), rtol=1e-9)
        for cycle in own:
            others = [other for other in names if other != name]
            assert all(cycle.amplitude(f"plant_{other}") == 0.0 for other in others)
            assert np.all(np.isfinite(cycle.state)) and cycle.state.size == 3 * len(names)
    assert str(pickle.loads(pickle.dumps(found))) == str(found)
    assert len(found) == sum(len(alone(name)) for name in names)
    assert found.status is epp.Status.CONVERGED
    assert ("Not all elements act on one another" in str(found)) and len(found.to_frame()) == len(found)


@pytest.mark.parametrize("names", [("relay", "band"), ("relay", "relay_too"), ("limit", "wide")])
def test_loops_that_do_not_act_on_one_another_are_seen_apart_in_turned_states(names, monkeypatch) -> None:
    """All cycles were lost, and two relays said to have no state of rest, where turned states mixed the loops."""
    monkeypatch.setitem(LOOPS, "relay_too", LOOPS["relay"])  # the same poles twice
    loop = diagram(*names, set_point=0.05)
    units = 10.0 ** np.array([0.0, 3.0, -2.0, 1.0, -3.0, 2.0])
    T = np.linalg.qr(np.random.default_rng(5).normal(size=(6, 6)))[0] * units
    turned = loop.in_coordinates(T, np.linalg.inv(T))
    plain, found = epp.predict_limit_cycles(loop), epp.predict_limit_cycles(turned)
    assert found.warnings == plain.warnings and "Not all elements act on one another" in str(found)
    told = [
        [(c.omega, c.stable, *(c.elements[name]["amplitude"] for name in names)) for c in p] for p in (found, plain)
    ]
    assert told[0] == [pytest.approx(one, rel=1e-8) for one in told[1]]
    for cycle, own in zip(found, plain, strict=True):
        assert T @ cycle.mean_state == pytest.approx(own.mean_state, abs=1e-8)


def test_a_loop_at_rest_is_told_where_it_rests() -> None:
    (cycle,) = epp.predict_limit_cycles(diagram("relay", "limit", set_point=0.4))
    # Of unit gain on both ways: half of the set point.
    assert cycle.mean["plant_limit"] == pytest.approx(0.2, rel=1e-9)


def test_loops_that_all_rest_are_said_to_be_apart() -> None:
    found = epp.predict_limit_cycles(diagram("limit", "wide"))
    assert not found and "Not all elements act on one another" in str(found)


def test_the_search_closes_the_cycle_of_one_loop_while_the_other_rests() -> None:
    both = epp.find_limit_cycles(diagram("relay", "limit"))
    (own,) = [c for c in epp.find_limit_cycles(diagram("relay")) if c.stable]
    assert [c.period for c in both if c.stable] == pytest.approx([own.period], rel=1e-8)


@pytest.mark.parametrize("gain", [0.5, 1.0])
def test_a_loop_behind_one_that_rests_has_the_cycles_that_it_has_alone(gain) -> None:
    """A saturation in a stable loop whose output is the set point of a relay's loop, which does not act on it."""
    (relay, (num, den)), (limit, (own_num, own_den)) = LOOPS["relay"], LOOPS["limit"]
    plant = epp.blocks.TransferFunction
    parts = {
        "limit": limit, "before": plant(num=own_num, den=own_den), "gain": epp.blocks.Gain(gain=gain),
        "relay": relay, "behind": plant(num=num, den=den),
    }  # fmt: skip
    wires = ["r - before -> limit", "limit -> before", "before -> gain"]
    cascade = epp.Diagram(
        parts=parts, connect=[*wires, "gain - behind -> relay", "relay -> behind"], inputs={"r": 0.4}
    ).to_system()
    parts = {"relay": relay, "behind": plant(num=num, den=den)}
    alone = epp.Diagram(parts=parts, connect=["r - behind -> relay", "relay -> behind"], inputs={"r": 0.2 * gain})
    (own,), (cycle,) = epp.predict_limit_cycles(alone.to_system()), epp.predict_limit_cycles(cascade)
    assert cycle.omega == pytest.approx(own.omega, rel=1e-9) and cycle.stable == own.stable
    for name in ("behind", "relay"):
        assert cycle.amplitude(name) == pytest.approx(own.amplitude(name), rel=1e-9)
        assert cycle.mean[name] == pytest.approx(own.mean[name], rel=1e-9)
    assert cycle.mean["before"] == pytest.approx(0.2, rel=1e-9) and cycle.amplitude("before") == 0.0


def test_a_late_input_makes_no_second_group() -> None:
    """What hands on the late input of a block, where an external input is part of it, is no element to the user."""
    connect = ["r - sensor -> relay", "relay + load -> oven", "oven -> sensor"]
    parts = {
        "relay": epp.HysteresisRelay(-1.0, 1.0, low=0.0, high=1.0),
        "oven": epp.blocks.TransferFunction(num=[120.0], den=[600.0, 1.0], delay=15.0),
        "sensor": epp.blocks.LowPass(bandwidth=0.1),
    }
    late = epp.Diagram(parts=parts, connect=connect, inputs={"r": 80.0, "load": 0.0}).to_system()
    found, alone = map(epp.predict_limit_cycles, (late, without_load(parts, connect)))
    assert len(late.elements) == 2 and len(found) == 1
    assert found.cycles[0].omega == pytest.approx(alone.cycles[0].omega, rel=1e-9)
    assert found.warnings == alone.warnings and found.search == alone.search


def without_load(parts, connect) -> epp.LureSystem:
    return epp.Diagram(parts=parts, connect=[c.replace(" + load", "") for c in connect], inputs={"r": 80.0}).to_system()
