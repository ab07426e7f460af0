"""Every result says what made it, and no algorithm reads that."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import control
import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.orbits.exact import centre_of, range_of, steady_hybrid
from eppanalysis.methods.search.basin import basin
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.results import LimitCycle, Result, plain
from eppanalysis.results.provenance import Provenance

LOOP = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
CASE = epp.case("relay_deadzone")
SAMPLED = epp.LureSystem.from_tf(control.tf([0.01, 0.01], [1.0, -1.8, 0.8], 0.1), epp.Relay())


def bare(value: Any) -> Any:
    """The same without a word on where it comes from, in all its parts."""
    if isinstance(value, Provenance):
        return Provenance(versions={})
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return tuple(map(bare, value))
    if isinstance(value, Result):
        return replace(value, **{f.name: bare(getattr(value, f.name)) for f in fields(value) if f.init})
    return value


def numbers(value: Any) -> str:
    """All of a result but where it comes from, to the last bit."""

    def without(data: Any) -> Any:
        if isinstance(data, dict):
            return {name: without(inner) for name, inner in data.items() if name not in ("provenance", "seconds")}
        return [without(inner) for inner in data] if isinstance(data, list) else data

    return json.dumps(without(plain(value)))


def results(value: Any) -> Iterator[Result]:
    """All results in a result."""
    if isinstance(value, Result):
        yield value
    parts = value if isinstance(value, tuple) else ()
    if is_dataclass(value):
        parts = tuple(getattr(value, f.name) for f in fields(value))
    for part in parts:
        yield from results(part)


@pytest.fixture(scope="module")
def search() -> epp.CycleSearch:
    return epp.find_limit_cycles(LOOP)


def test_a_search_does_not_read_where_predictions_come_from():
    predicted = epp.predict_limit_cycles(LOOP).cycles
    assert numbers(epp.find_limit_cycles(LOOP, predicted=bare(predicted))) == numbers(
        epp.find_limit_cycles(LOOP, predicted=predicted)
    )


def test_a_sampled_orbit_does_not_read_where_its_start_comes_from():
    for start in (epp.predict_limit_cycles(SAMPLED)[0], epp.simulate(SAMPLED, t_end=60.0).limit_cycle):
        found = epp.exact_orbit(SAMPLED, start)
        assert found.status.ok and numbers(epp.exact_orbit(SAMPLED, bare(start))) == numbers(found)


def test_orbits_and_balances_do_not_read_where_their_start_comes_from():
    for cycle in epp.predict_limit_cycles(LOOP):
        for method in (epp.exact_orbit, epp.harmonic_balance):
            assert numbers(method(LOOP, bare(cycle))) == numbers(method(LOOP, cycle))
        balance = epp.harmonic_balance(LOOP, cycle)
        assert numbers(epp.exact_orbit(LOOP, bare(balance))) == numbers(epp.exact_orbit(LOOP, balance))


def test_triggers_and_basins_do_not_read_where_cycles_come_from(search):
    assert numbers(epp.trigger(LOOP, cycles=bare(search))) == numbers(epp.trigger(LOOP, cycles=search))
    starts = np.array([0.9, 1.1])[:, None] * search.unstable[0].state
    assert numbers(basin(LOOP, bare(search), starts)) == numbers(basin(LOOP, search, starts))


def test_branches_do_not_read_where_cycles_come_from():
    cycle = epp.find_limit_cycles(CASE.to_system())[0]
    arguments = (CASE, "relay_dead_zone.threshold", 1.0, 1.4)
    one, other = (epp.continue_branch(*arguments, cycle=c) for c in (cycle, bare(cycle)))
    assert numbers(one) == numbers(other)


def test_what_a_cycle_does_not_tell_is_found_by_a_run_once_round(search):
    """Predictions have no states at events, exact orbits no mean: a run from their own start has both."""
    hybrid = steady_hybrid(LOOP, None)
    for cycle in search:
        told = range_of(hybrid, cycle)
        run = range_of(hybrid, replace(cycle, event_states=np.zeros((0, 0))))
        assert np.all(run >= told * (1 - 1e-9)), "a run sees the states between events too"
        # Symmetric loop: the mean is zero.
        assert np.all(np.abs(centre_of(hybrid, cycle)) < 1e-2 * run)
        moved = np.ptp(epp.simulate(replace(LOOP, x0=cycle.state), t_end=cycle.period).signals["x"])
        assert np.max(np.abs(LOOP.signals.C[0]) * run) == pytest.approx(moved, rel=3e-3)


def test_searches_take_cycles_of_any_method(search):
    """Exact orbits as predictions: the same cycles are found again."""
    again = epp.find_limit_cycles(LOOP, predicted=search.cycles)
    assert [c.period for c in again] == pytest.approx([c.period for c in search], rel=1e-9)
    reached = epp.simulate(replace(LOOP, x0=2.0 * search[-1].state), t_end=100.0).limit_cycle
    assert [c.period for c in epp.find_limit_cycles(LOOP, predicted=[reached])] == pytest.approx(
        [c.period for c in search], rel=1e-9
    )


@pytest.mark.parametrize("loop", [LOOP, SAMPLED], ids=["continuous", "sampled"])
def test_a_cycle_without_a_state_is_refused_in_a_sentence(loop):
    cycle = replace(epp.predict_limit_cycles(loop)[0], state=np.zeros(0))
    with pytest.raises(epp.EppError, match="0 states at its start; expected"):
        epp.find_limit_cycles(loop, predicted=[cycle])


def test_every_result_says_what_made_it(search):
    system = CASE.to_system()
    hybrid = steady_hybrid(LOOP, None)
    made = (
        epp.simulate(SAMPLED, t_end=20.0),
        epp.harmonic_balance(LOOP, search[1]),
        epp.trigger(LOOP, cycles=search),
        search,
        epp.continue_folds(CASE, "relay_dead_zone.threshold", "loop.gain", (1.0, 3.0), (1.0, 1.1), n_points=2),
        epp.continue_branch(CASE, "relay_dead_zone.threshold", 1.0, 1.4, cycle=epp.exact_orbit(system, search[1])),
        epp.ladder(CASE),
        epp.frozen_nyquist(LOOP, search[1]),
        basin(LOOP, search, search[0].state[None]),
        simulate_batch(HybridStack.of([hybrid], LOOP.signals.names), 5.0),
    )
    for result in results(made):
        said = result.provenance.to_dict()
        assert said["method"] and said["versions"]["eppanalysis"], type(result)
        json.dumps(said)


def test_plain_data_are_names_numbers_and_texts():
    cycle: LimitCycle = epp.predict_limit_cycles(LOOP)[0]
    data = cycle.to_dict()
    assert json.loads(json.dumps(data)) == data
    assert data["status"] == "converged" and data["message"] == cycle.status.value
    assert data["amplitude"]["x"] == cycle.amplitude("x")
