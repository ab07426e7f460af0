"""Batches: the same numbers as single runs, to the last bit on any number of threads, in flat memory."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
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


def test_runs_of_one_model_share_what_is_compiled_of_it_and_have_the_bits_of_runs_apart() -> None:
    """From states inside and outside its cycle, in modes that others have met before, and with two first steps."""
    hybrid, names = made({}), epp.case("fig8a_original").to_system().signals.names
    rng = np.random.default_rng(4)
    runs = [replace(hybrid, x0=hybrid.x0 * rng.uniform(-3.0, 3.0)) for _ in range(40)]
    one = HybridStack.of(runs, names)
    one.time_scale[20:] *= 0.5
    apart = replace(one, model=type(one.model)(*(np.repeat(a, len(runs), axis=0) for a in one.model)))
    assert len(one.model.A) == 1 and len(set(simulate_batch(one, 1.0).events.tolist())) > 3
    for stacks in ((one, apart), (one.take(np.arange(7, 30)), apart.take(np.arange(7, 30)))):
        for t_end in (1.0, 6.0):
            shared, separate = (simulate_batch(s, t_end, threads=n) for s, n in zip(stacks, (3, 1), strict=True))
            assert shared.status == separate.status
            for field in ("period", "events", "last_event", "change"):
                assert getattr(shared, field).tobytes() == getattr(separate, field).tobytes()
            for name in names:
                assert shared.mean[name].tobytes() == separate.mean[name].tobytes()


def test_different_structures_are_refused() -> None:
    relay, play = (epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), e) for e in (epp.Relay(), epp.Play(gap=1.0)))
    with pytest.raises(EppError, match="structure"):
        HybridStack.of([HybridSystem.from_lure(relay), HybridSystem.from_lure(play)], relay.signals.names)


def test_settled_cells_report_where_they_rest(stack: HybridStack) -> None:
    result = simulate_batch(stack, 6.0)
    cell = result.status.index(Status.SETTLED)
    assert result.peak_to_peak["theta"][cell] == 0.0
    assert 1.0 < result.mean["theta"][cell] < 1.1
