"""Loops of many states: they go far by sparse series, and must move as any other loop does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp
from benchmarks.growth import chain
from tests.random_loops import random_loop

SLOPE, THRESHOLD = 5.0, 0.02


def passed_by(loop: epp.LureSystem, n: int, seed: int) -> epp.LureSystem:
    """The same loop, with a chain of n states that its elements drive and that acts on nothing."""
    random = np.random.default_rng(seed)
    own = loop.A.shape[0]
    A = np.zeros((own + n, own + n))
    A[:own, :own] = loop.A
    A[own:, own:] = -np.diag(random.uniform(0.5, 3.0, n)) + np.diag(random.uniform(0.5, 3.0, n - 1), -1)
    B = np.vstack([loop.B, np.zeros((n, loop.B.shape[1]))])
    B[own] = 1.0
    C = np.hstack([loop.C, np.zeros((loop.C.shape[0], n))])
    return epp.LureSystem.build(A, B, C, loop.elements, D=loop.D, x0=np.r_[loop.x0, np.zeros(n)])


def exponential(loop: epp.LureSystem, slope: float, forces: np.ndarray, d: float) -> np.ndarray:
    """Matrix that carries the state and a one through a time in which the outputs are such."""
    n = loop.A.shape[0]
    M = np.zeros((n + 1, n + 1))
    M[:n, :n], M[:n, n] = loop.A + slope * np.outer(loop.B[:, 0], loop.C[0]), loop.B @ forces
    return expm(M * d)


@pytest.mark.parametrize("n", [18, 40, 64])
def test_a_chain_moves_by_matrix_exponentials_between_switches_on_its_thresholds(n: int) -> None:
    loop = chain(n)
    times = np.linspace(0.0, 0.7, 141)
    run = epp.simulate(loop, t_end=0.7, t_eval=times)
    switches = np.array([e.time for e in run.events])
    ends = np.r_[0.0, switches[np.r_[True, np.diff(switches) > 0.0]], 0.7]
    middles = 0.5 * (ends[1:] + ends[:-1])
    seen = epp.simulate(loop, t_end=0.7, t_eval=middles).signals
    z = np.empty((2, times.size))
    x = np.r_[loop.x0, 1.0]
    for k, (a, b) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
        # What the elements do is read from the middle; that they do it all the way is asked at each sample.
        free = abs(seen["saturation_input"][k]) < 1.0 / SLOPE
        forces = np.array([0.0 if free else np.sign(seen["saturation_input"][k]), seen["relay_dead_zone_output"][k]])
        inside = (times >= a) & (times <= b)
        for i in np.flatnonzero(inside):
            at = exponential(loop, SLOPE * free, forces, times[i] - a) @ x
            z[:, i] = loop.C @ at[:-1]
            beyond = np.abs(z[:, i]) - (1.0 / SLOPE, THRESHOLD)
            assert beyond[0] < 1e-9 if free else beyond[0] > -1e-9
            assert beyond[1] < 1e-9 if forces[1] == 0.0 else beyond[1] > -1e-9
        x = exponential(loop, SLOPE * free, forces, b - a) @ x
        if b < 0.7:
            assert np.min(np.abs(np.abs(loop.C @ x[:-1]) - (1.0 / SLOPE, THRESHOLD))) < 1e-11
    assert switches.size > 20
    np.testing.assert_allclose(run.signals["saturation_input"], z[0], atol=1e-10)
    np.testing.assert_allclose(run.signals["relay_dead_zone_input"], z[1], atol=1e-12)


@pytest.mark.parametrize("seed", range(1, 25))
def test_states_that_act_on_nothing_change_no_motion(seed: int) -> None:
    """A small loop goes by fast steps and dense series, the same loop among many states by sparse ones."""
    loop = random_loop(seed)
    runs = [epp.simulate(a, t_end=2.0, t_eval=np.linspace(0.0, 2.0, 401)) for a in (loop, passed_by(loop, 20, seed))]
    few, many = ([(e.element, e.name) for e in run.events] for run in runs)
    assert few == many
    np.testing.assert_allclose(*([e.time for e in run.events] for run in runs), atol=1e-9)
    for name, values in runs[0].signals.items():
        np.testing.assert_allclose(runs[1].signals[name], values, atol=1e-9 * (1.0 + np.abs(values).max()))


def test_a_wave_that_sets_out_through_a_chain_at_rest_costs_no_more_than_one_that_has_arrived() -> None:
    """Masses that it has not reached move by next to nothing: their series are not asked for digits of that."""
    times = np.linspace(0.0, 0.05, 51)
    at_rest = epp.simulate(chain(64), t_end=0.05, t_eval=times, max_steps=60)
    assert at_rest.t.size == times.size
    moving = replace(chain(64), x0=chain(64).x0 + 1e-13)
    arrived = epp.simulate(moving, t_end=0.05, t_eval=times)
    np.testing.assert_allclose(at_rest.signals["saturation_input"], arrived.signals["saturation_input"], atol=1e-9)


def test_samples_do_not_bind_the_series_of_a_large_loop() -> None:
    run = epp.simulate(chain(64), t_end=1.0, t_eval=np.linspace(0.0, 1.0, 10_001))
    assert run.provenance.statistics["fast_steps"] == 0
    assert run.provenance.statistics["series_steps"] < 600
    few = epp.simulate(chain(64), t_end=1.0, t_eval=[0.5, 1.0])
    for name, values in few.signals.items():
        np.testing.assert_allclose(run.signals[name][[5000, 10_000]], values, atol=1e-10)


def test_a_large_loop_at_rest_still_makes_long_steps() -> None:
    loop = epp.LureSystem.build(
        chain(20).A - np.eye(20),
        chain(20).B,
        chain(20).C,
        [epp.DeadZone(-1.0, 1.0), epp.RelayDeadZone(1.0)],
        x0=chain(20).x0,
    )
    run = epp.simulate(loop, t_end=1e5, t_eval=[0.0, 1e5], max_steps=4000)
    assert run.status is epp.Status.SETTLED
    assert run.t[-1] == 1e5
