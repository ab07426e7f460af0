"""Loops whose states are changed once, however often rounding would ask for another change: deep cascades."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.arrays import Array
from eppanalysis.methods.orbits import exact
from eppanalysis.methods.orbits.decoupled import in_decoupled_states
from eppanalysis.methods.simulation.states import OtherStates


def cascade(n: int, seed: int) -> epp.LureSystem:
    """Two integrators and lags of six decades in series behind a relay, in turned states."""
    rng = np.random.default_rng(seed)
    A = -np.diag(np.r_[0, 0, 10.0 ** rng.uniform(-3, 3, n - 2)])
    A[np.arange(1, n), np.arange(n - 1)] = 1
    T = np.linalg.qr(rng.normal(size=(n, n)))[0]
    return epp.LureSystem.build(T @ A @ T.T, T[:, :1], -T[:, -1:].T, [epp.Relay(-1.0, 1.0)])


@pytest.mark.parametrize(("n", "seed"), [(33, 0), (25, 5), (30, 0), (20, 4)])
def test_changes_of_states_come_to_an_end(n: int, seed: int) -> None:
    """What is found in the new states is told in those given: the changes are inverse to each other."""
    loop = cascade(n, seed)
    own = in_decoupled_states(loop)
    assert own is not None
    y = np.ones(own.T.shape[1])
    assert own.inverse @ (own.T @ y) == pytest.approx(y, abs=1e-6 * np.linalg.cond(own.T))
    assert own.system.C @ y == pytest.approx(loop.C @ (own.T @ y), abs=1e-9 * np.abs(loop.C @ np.abs(own.T)).sum())


@pytest.mark.parametrize(("n", "seed"), [(33, 0), (25, 5)])
def test_a_run_of_a_deep_cascade_ends(n: int, seed: int) -> None:
    assert epp.simulate(cascade(n, seed), t_end=1.0, max_steps=10_000).status in set(epp.Status)


def test_the_states_of_a_cascade_are_asked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the states that come out rounding would ask for others, and in those for others again."""
    asked: list[epp.LureSystem] = []

    def ask(loop: epp.LureSystem, *inputs: Array) -> OtherStates | None:
        asked.append(loop)
        assert len(asked) < 10, "the states are changed to and fro"
        return in_decoupled_states(loop, *inputs)

    monkeypatch.setattr(exact, "in_decoupled_states", ask)
    monkeypatch.setattr(exact, "orbits_of", lambda *given: iter(()))
    loop = cascade(33, 0)
    assert in_decoupled_states(in_decoupled_states(loop).system) is not None
    assert not epp.exact_orbit(loop, epp.predict_limit_cycles(loop)[0]).status.ok
    assert len(asked) == 1
