"""A disturbance among the states, as an integrator without an input: the same loop as with a held input."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp

A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]])
B, C = np.array([[0.0], [0.0], [5.0]]), np.array([[1.0, 0.0, 0.0]])
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
LOAD = 0.3


def with_input(element: epp.Nonlinearity) -> epp.LureSystem:
    return epp.LureSystem.build(A, -B, C, [element], B_input=B, input_names=["load"], v0=[LOAD])


def with_state(element: epp.Nonlinearity, turn: np.ndarray) -> epp.LureSystem:
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[:3, 3] = A, B[:, 0]
    drive, seen, start = np.vstack([-B, [[0.0]]]), np.append(C, 0.0)[None], np.array([0.0, 0.0, 0.0, LOAD])
    return epp.LureSystem.build(turn @ whole @ turn.T, turn @ drive, seen @ turn.T, [element], x0=turn @ start)


@pytest.mark.parametrize("turn", [np.eye(4), TURN], ids=["as it is", "turned"])
@pytest.mark.parametrize("element", [epp.Relay(), epp.HysteresisRelay(-0.1, 0.1)], ids=lambda e: e.kind)
def test_a_held_state_is_a_held_input(element: epp.Nonlinearity, turn: np.ndarray) -> None:
    loop, other = with_input(element), with_state(element, turn)
    (wanted,), (found,) = epp.predict_limit_cycles(loop), epp.predict_limit_cycles(other)
    assert found.period == pytest.approx(wanted.period, rel=1e-9)
    assert found.error_estimate == pytest.approx(wanted.error_estimate, rel=1e-6)
    exact = epp.exact_orbit(loop, wanted).period
    for cycle in (epp.exact_orbit(other, found), epp.harmonic_balance(other, found, order=41)):
        assert cycle.period == pytest.approx(exact, rel=1e-9 if cycle.method == "exact orbit" else 2e-3)
        assert (turn.T @ cycle.state)[3] == pytest.approx(LOAD, rel=1e-9)
    assert abs(exact / epp.exact_orbit(with_input(element), wanted, {"load": 0.0}).period - 1.0) > 0.03


@pytest.mark.slow
@pytest.mark.parametrize("turn", [np.eye(4), TURN], ids=["as it is", "turned"])
def test_a_search_does_not_move_a_held_state(turn: np.ndarray) -> None:
    (wanted,) = epp.find_limit_cycles(with_input(epp.Relay()))
    found = epp.find_limit_cycles(with_state(epp.Relay(), turn))
    assert [c.period for c in found] == [pytest.approx(wanted.period, rel=1e-9)]
    assert found.status is epp.Status.CONVERGED and not found.settles and "continuum" not in str(found)
