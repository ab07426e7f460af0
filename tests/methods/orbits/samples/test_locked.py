"""Exact orbits of loops with sampled controllers, against the fixed points of the exact map from sample to sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import eppanalysis as epp

A = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
T = 0.2


def sampled_relay(delay: float = 0.0) -> epp.LureSystem:
    reader = epp.SampledController([], [], [], [[1.0]], T, delay)
    B, C, D = np.zeros((3, 2)), np.zeros((2, 3)), np.zeros((2, 2))
    B[0, 1], C[0, 2], D[1, 0] = -1.0, 1.0, 1.0
    elements = [reader, epp.HysteresisRelay(-0.1, 0.1)]
    return epp.LureSystem.build(A, B, C, elements, D=D, x0=[1.0, 0, 0], element_names=["reader", "relay"])


def held(time: float) -> tuple[np.ndarray, np.ndarray]:
    M = np.zeros((4, 4))
    M[:3, :3], M[0, 3] = A, -1.0
    E = scipy.linalg.expm(M * time)
    return E[:3, :3], E[:3, 3]


def fixed_points(longest: int) -> dict[tuple[int, int], np.ndarray]:
    """All orbits with two switches and at most so many samples, by (length, samples at +1): states at the samples."""
    E, F = held(T)
    found = {}
    for n in range(2, longest):
        for k in range(1, n):
            pattern = np.r_[np.ones(k), -np.ones(n - k)]
            M, b = np.eye(3), np.zeros(3)
            for u in pattern:
                M, b = E @ M, E @ b + F * u
            x, relay, path = np.linalg.solve(np.eye(3) - M, b), -1.0, []
            for u in pattern:
                relay = 1.0 if x[2] > 0.1 else -1.0 if x[2] < -0.1 else relay
                if relay != u:
                    break
                path.append(x)
                x = E @ x + F * u
            else:
                found[n, k] = np.array(path)
    return found


def test_all_locked_cycles_of_a_sampled_relay_are_found_and_no_others() -> None:
    expected = fixed_points(60)
    assert sorted(expected) == [(24, 12), (26, 13)]
    found = epp.find_limit_cycles(sampled_relay())
    assert [round(c.period / T, 9) for c in found] == [24.0, 26.0] and found.status is epp.Status.CONVERGED
    for cycle, path in zip(found, expected.values(), strict=True):
        assert cycle.method == "exact orbit" and cycle.stable and "locked to the samples" in cycle.note
        assert cycle.peak_to_peak["relay_input"] == pytest.approx(np.ptp(path[:, 2]), rel=1e-12)
        assert np.abs(path - cycle.state[:3]).max(axis=1).min() < 1e-12
        exact = np.linalg.eigvals(held(cycle.period)[0])  # between the switches nothing else acts
        np.testing.assert_allclose(np.abs(cycle.multipliers), np.sort(np.abs(exact))[::-1], rtol=2e-3)


def test_a_prediction_leads_to_the_nearest_orbit() -> None:
    loop = sampled_relay()
    (predicted,) = epp.predict_limit_cycles(loop)
    assert predicted.stable and predicted.period / T == pytest.approx(25.14, abs=0.01)
    assert predicted.error_estimate >= 2.0 * T / predicted.period
    orbit = epp.exact_orbit(loop, predicted)
    assert orbit.status is epp.Status.CONVERGED and round(orbit.period / T, 9) in (24.0, 26.0)


def test_where_there_is_no_orbit_of_so_many_samples_none_is_given() -> None:
    loop = sampled_relay()
    cycle = epp.simulate(loop, t_end=200.0).limit_cycle
    none = epp.exact_orbit(loop, replace(cycle, period=25 * T))
    assert none.status is epp.Status.NOT_CONVERGED and "locked to the samples" in none.note


def test_what_does_not_cover_samples_says_so() -> None:
    loop = sampled_relay()
    with pytest.raises(epp.EppError, match="does not cover loops with sampled controllers: use predict_limit_cycles"):
        epp.frozen_nyquist(loop, epp.predict_limit_cycles(loop)[0])


def test_a_state_of_rest_is_no_orbit_of_its_samples() -> None:
    # Friction holds the mass wherever its sampled spring is weaker: every sample closes there, to the last bit.
    spring = epp.SampledController([], [], [], [[30.0]], 0.01)
    A, B, C = [[0.0, 1.0], [0.0, -1.0]], [[0.0, 0.0], [-1.0, -1.0]], [[1.0, 0.0], [0.0, 1.0]]
    loop = epp.LureSystem.build(A, B, C, [spring, epp.Friction(0.5)], x0=[1.0, 0.0])
    run = epp.simulate(loop, t_end=20.0)
    assert run.status is epp.Status.SETTLED and abs(run.settled_at["sampled_controller_input"]) > 1e-4
    found = epp.find_limit_cycles(loop)
    assert not len(found) and found.settles and not found.diverges
