"""Stretches of a run that nearly return to their begin, against a search through all pairs of its events."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.orbits.guess import recurrences, stretch
from eppanalysis.methods.simulation.simulate import run_hybrid


@pytest.mark.parametrize("share", [None, 0.2])
@pytest.mark.parametrize("name", ["fig8a_original", "relay_deadzone"])
def test_the_best_returns_are_those_of_all_pairs(name: str, share: float | None) -> None:
    case, most, looked_at = epp.case(name), 3, 40
    period = None if share is None else (0.0, share * case.t_end)
    hybrid = steady_hybrid(case.to_system(), case.operating_point)
    run = run_hybrid(hybrid, case.t_end, np.zeros(0), hybrid.time_scale, 60_000, 100)
    events = range(max(run.n_kept - looked_at, 0), run.n_kept)
    time, state = run.time[run.order], run.state[run.order][:, hybrid.compared]
    what = [(int(run.guard[k]), *run.modes[k].tolist()) for k in run.order]
    span = np.ptp(state[events], axis=0)
    last = [k for k in events if k + 1 == run.n_kept or time[k + 1] > time[k]]
    pairs = [(i, j) for i, j in combinations(last, 2) if what[i] == what[j]]
    if period is not None:
        pairs = [(i, j) for i, j in pairs if period[0] <= time[j] - time[i] <= period[1]]
    moves = span > 0
    away = {(i, j): float(np.round(np.max(np.abs(state[i] - state[j])[moves] / span[moves]), 12)) for i, j in pairs}
    best = sorted(pairs, key=lambda p: (away[p], time[p[1]] - time[p[0]]))[:most]
    expected = [guess for i, j in best if (guess := stretch(hybrid, run, i, j)) is not None]
    found = list(recurrences(hybrid, run, period, most, looked_at))
    assert len(pairs) > most and len(found) == len(expected) > 1
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.tau, other.tau)
