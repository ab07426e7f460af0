"""The engine on random loops: two thousand (`EPP_LOOPS`) against itself with halved steps, some against another one.

A missed or invented switch shows as a difference between the two runs. Loops may be chaotic or balance on an edge;
where the runs differ, a third run from a start moved by a few parts in 1e14 tells whether the loop itself magnifies
that much.
"""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.signals import SignalMap
from tests.random_loops import random_loop
from tests.reference.lure_reference import simulate_lure

TIMES = np.linspace(0.0, 12.0, 61)
#: Beyond this size thresholds of order one drown in rounding.
LARGEST = 1e5
#: Loops that are run with halved steps.
LOOPS = int(os.environ.get("EPP_LOOPS", "2000"))


def with_states(system: epp.LureSystem) -> epp.LureSystem:
    """The loop with its states as signals: they are continuous, outputs jump."""
    n, nw, nv = system.A.shape[0], system.B.shape[1], len(system.input_names)
    names = tuple(f"x{i}" for i in range(n))
    return replace(
        system, signals=SignalMap(names, np.eye(n), np.zeros((n, nw)), np.zeros((n, nv)), np.zeros(n), ("",) * n)
    )


def states(system: epp.LureSystem, scale: float = 1.0, shift: float = 0.0) -> tuple[np.ndarray, int, int]:
    """States at TIMES with the internal step scaled, how the run ended, and its forced leaves."""
    hybrid = HybridSystem.from_lure(replace(system, x0=system.x0 * (1.0 + shift)))
    run = run_hybrid(hybrid, float(TIMES[-1]), TIMES, 2.0 * scale * hybrid.time_scale, 20_000, 1)
    return run.samples[: int(run.stats[2])], run.code, int(run.stats[5])


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference relative to the size reached so far, while that stays moderate."""
    n = min(len(a), len(b))
    size = np.maximum.accumulate(np.abs(a[:n]).max(axis=1))
    use = size < LARGEST
    return float(np.max(np.abs(a[:n] - b[:n]).max(axis=1)[use] / np.maximum(size[use], 1e-300), initial=0.0))


def starts_slipping(system: epp.LureSystem) -> bool:
    """Whether a stiction element starts beyond its reach, where the two integrators take different first outputs."""
    z = system.C @ system.x0
    return any(
        isinstance(e, epp.JumpAndFollow) and abs(z[s.start]) > (e.stick_band + e.slip_jump) / 2
        for e, s in zip(system.elements, system.input_slices, strict=True)
    )


def blocks(first: int, *ends: int) -> list[Any]:
    """Seeds from the first to each of the ends, block by block; all but the first block are slow."""
    parts = [range(*pair) for pair in pairwise((first, *ends))]
    return [pytest.param(seeds, id=str(seeds[0]), marks=[pytest.mark.slow] * (i > 0)) for i, seeds in enumerate(parts)]


@pytest.mark.parametrize("seeds", blocks(0, 250, *range(1000, LOOPS + 1, 1000)))
def test_halved_steps_change_nothing(seeds: range) -> None:
    unexplained, hung = [], []
    for seed in seeds:
        system = with_states(random_loop(seed))
        a, code_a, _ = states(system)
        b, code_b, _ = states(system, 0.5)
        if len(a) < len(TIMES) and code_a == 0 or len(b) < len(TIMES) and code_b == 0:
            hung.append(seed)
        apart = distance(a, b)
        if apart > 1e-7:
            moved = max(distance(a, states(system, 1.0, shift)[0]) for shift in (3e-14, -3e-14, 1e-13))
            if moved < 1e-3 * apart:
                unexplained.append((seed, apart, moved))
    assert not hung
    assert not unexplained


@pytest.mark.parametrize("seeds", blocks(30_000, 30_250, 31_000))
def test_a_run_without_samples_ends_where_one_with_samples_does(seeds: range) -> None:
    """Samples hold a run to their grid; without them the grid begins anew at every switch."""
    unexplained = []
    for seed in seeds:
        system = with_states(random_loop(seed))
        a, code, _ = states(system)
        hybrid = HybridSystem.from_lure(system)
        free = run_hybrid(hybrid, float(TIMES[-1]), np.zeros(0), 2.0 * hybrid.time_scale, 20_000, 1)
        n, size = system.A.shape[0], np.abs(a).max(initial=1e-300)
        if code != 0 or size > LARGEST:
            continue
        apart = np.abs(free.x_end[:n] - a[-1]).max() / size if free.code == 0 else np.inf
        if apart > 1e-7:
            moved = max(distance(a, states(system, 1.0, shift)[0]) for shift in (3e-14, -3e-14, 1e-13))
            if moved < 1e-3 * apart:
                unexplained.append((seed, apart, moved))
    assert not unexplained


@pytest.mark.slow
def test_a_sample_agrees_with_another_integrator() -> None:
    compared, wrong = 0, []
    for seed in range(20_000, 20_400):
        system = with_states(random_loop(seed))
        if any(e.n_inputs > 1 or e.n_outputs > 1 for e in system.elements) or starts_slipping(system):
            continue
        a, code, _ = states(system)
        if code != 0 or np.abs(a).max() > LARGEST:
            continue
        try:
            witness = simulate_lure(system, TIMES[:16])
        except (NotImplementedError, RuntimeError, ValueError):
            continue
        b = np.column_stack([witness.signals[name] for name in system.signals.names])
        apart = distance(a[:16], b)
        if apart > 1e-7:
            moved = max(distance(a[:16], states(system, 1.0, shift)[0][:16]) for shift in (1e-11, -1e-11))
            if moved < 1e-2 * apart:
                wrong.append((seed, apart, moved))
        compared += 1
        if compared == 40:
            break
    assert compared == 40
    assert not wrong
