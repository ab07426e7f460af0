"""The verdict on runs whose every change is known."""

from __future__ import annotations

import time
from itertools import product

import numpy as np
import pytest

from eppanalysis.engine._engine import parts
from eppanalysis.engine.runs import CYCLE, rounding_of_motion


def judged(drift: float, growth: float, decay: float, turns: int, noise: float = 0.0) -> tuple[int, np.ndarray]:
    """Verdict on a zigzag of period 1 that drifts beneath a transient.

    From turn to turn the drift grows, and the transient shrinks, by a factor.
    """
    k = np.arange(2 * turns + 1)
    slow = drift * np.cumsum(growth ** (k / 2.0)) + 2.0 * decay ** (k / 2.0)
    slow += noise * np.random.default_rng(turns).uniform(-1.0, 1.0, k.size)
    states = (np.where(k % 2, 1.0, -1.0) + slow)[:, None]
    rates = np.where(k % 2, 4.0, -4.0)[:, None]
    found, compared = np.zeros(4), np.ones(1, dtype=bool)
    low, high = states.min(axis=0), states.max(axis=0)
    t = 0.5 * (k + 1.0)
    code = parts.verdict(t, k % 2, states, rates, float(t[-1]), low, high, compared, found)
    return int(code), found


@pytest.mark.parametrize(("drift", "growth", "decay"), [*product([1e-4, 3e-3], [1.0, 1.2], [0.003, 0.1, 0.2])])
def test_a_drift_beneath_a_fast_transient_is_no_cycle(drift: float, growth: float, decay: float) -> None:
    """What a long stretch changes falls steeply while a transient dies out in it; its parts drift on all the same."""
    behind = 3 + int(np.ceil(np.log(0.05 * drift) / np.log(decay)))  # the transient is gone from the last three turns
    assert [judged(drift, growth, decay, turns)[0] for turns in range(behind, 40)].count(CYCLE) == 0


@pytest.mark.parametrize("decay", [0.02, 0.03, 0.05])
def test_a_steep_fall_is_not_extrapolated_to_less_than_the_last_change(decay: float) -> None:
    """Of three turns that change ever less the last may be all drift."""
    code, found = judged(1e-4, 1.0, decay**2, 3)
    assert code != CYCLE or found[3] > 0.9e-4


@pytest.mark.parametrize("decay", [0.003, 0.03, 0.1, 0.3])
def test_the_transient_alone_ends_on_the_cycle(decay: float) -> None:
    code, found = judged(0.0, 1.0, decay, 30)
    assert code == CYCLE
    assert found[1] == pytest.approx(1.0)


@pytest.mark.parametrize("noise", [1e-12, 1e-9, 3e-9, 2e-8])
def test_what_only_wanders_has_the_least_period(noise: float) -> None:
    """A stiff motion enlarges its rounding: a few periods together then came back nearer than one, by chance."""
    for turns in range(30, 70):
        code, found = judged(0.0, 1.0, 0.1, turns, noise)
        assert code == CYCLE and found[0] == 2 and found[3] < 5.0 * noise + 1e-9


@pytest.mark.parametrize("growth", [1.0, 1.1, 1.5, 2.0])
def test_a_small_creep_is_no_wandering(growth: float) -> None:
    """What grows from rounding, or creeps on for ever, is on no cycle however little it has moved."""
    for drift in (1e-7, 1e-8):
        assert judged(drift * growth**-20.0, growth, 0.1, 30, 1e-13)[0] != CYCLE


def test_ten_thousands_of_switches_that_pile_up_are_judged_at_once() -> None:
    """Two guards in turn along a slide: any even number may be a period, and the slide moves on through each."""
    k = np.arange(20_000)
    states = 1e-3 * k[:, None] + np.where(k % 2, 1e-3, -1e-3)[:, None]
    rates, found, compared = np.ones((k.size, 1)), np.zeros(4), np.ones(1, dtype=bool)
    facts = (states.min(axis=0), states.max(axis=0), compared, found)
    begun = time.process_time()
    assert parts.verdict(1e-3 * (k + 1.0), k % 2, states, rates, 1e-3 * k.size, *facts) == 0
    assert time.process_time() - begun < 0.3  # a comparison of all stretches, event by event, takes 1.4 s


def test_what_rounding_leaves_of_a_motion_is_what_its_sizes_say() -> None:
    rng, said = np.random.default_rng(7), []
    for _ in range(200):
        events, n, h, z, count = (int(k) for k in rng.integers(2, 6, 5))
        states = 10.0 ** rng.uniform(-1, 14) * (1.0 + 10.0 ** rng.uniform(-17, 0) * rng.normal(size=(events, n)))
        memory, moves = rng.normal(size=(events, h)) * 10.0 ** rng.uniform(-16, 1), np.ptp(states, axis=0)
        levels, weights = rng.choice([0.0, 1.0], count), np.abs(rng.normal(size=(count, z)))
        compared = rng.random(n) < 0.7
        changes, period = (np.abs(rng.normal(size=n)), np.abs(rng.normal(size=z))), 10.0 ** rng.uniform(-3, 3)
        gains = np.abs(rng.normal(size=(z, n + h)))
        found = rounding_of_motion(states, memory, moves, period, compared, gains, (weights, levels), changes, 1e-13)
        amplitude = gains @ np.concatenate([moves, np.ptp(memory, axis=0)])
        sizes = np.concatenate([np.abs(states).max(axis=0) + moves, np.abs(memory).max(axis=0)])
        place = gains @ sizes
        said.append(bool(np.all(weights @ amplitude <= 1e-13 * (levels + weights @ place))))
        share = max((changes[0] * period / sizes[:n])[compared].max(initial=0.0), (changes[1] / place).max())
        assert found[0] == said[-1]
        assert np.isclose(found[1], share, rtol=1e-12)
    assert 20 < sum(said) < 180
