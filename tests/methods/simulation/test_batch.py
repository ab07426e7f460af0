"""Batches: the same numbers as single runs, to the last bit on any number of threads, in flat memory."""

from __future__ import annotations

from itertools import product

import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.results import Status

AXES = {"bands.range": ["1 lbf", "2.5 lbf", "4 lbf"], "lock_pin.backlash": ["0.25 deg", "1.5 deg", "2.5 deg"]}


def made(values: dict) -> HybridSystem:
    case = epp.case("fig8a_original").with_values(values)
    return HybridSystem.from_lure(case.to_system(), {"harness_position": case.input})


@pytest.fixture(scope="module")
def stack() -> HybridStack:
    cells = [made(dict(zip(AXES, values, strict=True))) for values in product(*AXES.values())]
    return HybridStack.of(cells, epp.case("fig8a_original").to_system().signals.names)


def test_cells_equal_single_runs(stack: HybridStack) -> None:
    result = simulate_batch(stack, 6.0)
    for cell, values in enumerate(product(*AXES.values())):
        case = epp.case("fig8a_original").with_values(dict(zip(AXES, values, strict=True)))
        run = epp.simulate(case.to_system(), case.input, 6.0, t_eval=[0.0])
        assert result.status[cell] is run.status
        if run.limit_cycle is not None:
            assert result.period[cell] == pytest.approx(run.limit_cycle.period, rel=1e-10)
            assert result.peak_to_peak["theta"][cell] == pytest.approx(run.limit_cycle.peak_to_peak["theta"], rel=1e-5)
            assert result.mean["theta"][cell] == pytest.approx(run.limit_cycle.mean["theta"], rel=1e-6)


def test_threads_change_no_bit(stack: HybridStack) -> None:
    one, two = simulate_batch(stack, 3.0, threads=1), simulate_batch(stack, 3.0, threads=3)
    assert one.status == two.status
    assert one.period.tobytes() == two.period.tobytes()
    for name in stack.signal_names:
        assert one.peak_to_peak[name].tobytes() == two.peak_to_peak[name].tobytes()


def test_different_structures_are_refused() -> None:
    relay, play = (epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), e) for e in (epp.Relay(), epp.Play(gap=1.0)))
    with pytest.raises(EppError, match="structure"):
        HybridStack.of([HybridSystem.from_lure(relay), HybridSystem.from_lure(play)], relay.signals.names)


def test_settled_cells_report_where_they_rest(stack: HybridStack) -> None:
    result = simulate_batch(stack, 6.0)
    cell = result.status.index(Status.SETTLED)
    assert result.peak_to_peak["theta"][cell] == 0.0
    assert 1.0 < result.mean["theta"][cell] < 1.1
