"""Switches of a run: the sequence that becomes objects when it is looked at."""

from __future__ import annotations

import pickle

import pytest

import eppanalysis as epp


@pytest.fixture(scope="module")
def run() -> epp.Trajectory:
    return epp.simulate(epp.case("relay_deadzone"))


def test_it_is_the_sequence_that_a_tuple_would_be(run) -> None:
    whole = tuple(run.events)
    assert len(run.events) == len(whole) == run.n_events > 10
    assert run.events == whole and run.events[3:7] == whole[3:7] and run.events[::-2] == whole[::-2]
    assert run.events[0] == whole[0] and run.events[-1] == whole[-1]
    assert [e.time for e in whole] == sorted(e.time for e in whole)
    assert {e.element for e in whole} == {"relay_dead_zone"} and hash(run.events) == hash(whole)
    with pytest.raises(IndexError):
        run.events[len(whole)]


def test_it_survives_a_process_and_is_plain_data(run) -> None:
    assert pickle.loads(pickle.dumps(run.events)) == run.events
    first = run.limit_cycle.to_dict()["events"][0]
    assert first == run.limit_cycle.events[0]._asdict()


def test_a_loop_with_another_input_is_packed_again() -> None:
    case = epp.case("fig8a_original")
    small = epp.simulate(case.to_system(), epp.inputs.Step(1e-4), 2.0)
    large = epp.simulate(case.to_system(), epp.inputs.Step(1e-2), 2.0)
    again = epp.simulate(case.to_system(), epp.inputs.Step(1e-4), 2.0)
    assert small.events == again.events and small.events != large.events
