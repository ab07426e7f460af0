"""A sampled loop whose encoder passes many edges: what one run decides the search decides too."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp

#: Step of the encoder and sample time.
EDGE, SAMPLE = 1e-5, 1e-2


def _encoder(start: float) -> epp.AutomatonElement:
    """Reads the greatest multiple of a step up to its input, of however many steps."""
    build = epp.AutomatonBuilder(n_memory=1)
    reads = build.mode("reads", from_memory=[1.0])
    build.guard(
        "up", reads, reads, on_input=1.0, on_memory=-1.0, constant=-EDGE, memory_from_memory=1.0, memory_constant=EDGE
    )
    build.guard("down", reads, reads, on_input=-1.0, on_memory=1.0, memory_from_memory=1.0, memory_constant=-EDGE)
    return epp.AutomatonElement(build.build(reads, [start]))


def _loop() -> epp.LureSystem:
    """x' = -x - u from x = 1, with u what the encoder reads at each sample: 100 000 edges on its way to rest."""
    law = epp.SampledController([[0.0]], [[0.0]], [[0.0]], [[1.0]], sample_time=SAMPLE)
    return epp.LureSystem.build(
        [[-1.0]], [[0.0, -1.0]], [[1.0], [0.0]], [_encoder(1.0), law], D=[[0.0, 0.0], [1.0, 0.0]], x0=[1.0]
    )


def test_a_run_that_passes_many_edges_settles():
    share, x = np.exp(-SAMPLE), 1.0
    for _ in range(3000):  # from sample to sample, in closed form
        x = share * x - (1.0 - share) * EDGE * np.floor(x / EDGE)
    assert abs(x) <= EDGE
    run = epp.simulate(_loop(), t_end=30.0)
    assert run.status is epp.Status.SETTLED and run.n_events > 100_000


@pytest.mark.xfail(
    strict=True,
    reason="runs of a search stop after a number of events that is set by samples; a budget by the loop's time "
    "constants, and its own run, decide",
)
def test_a_search_does_not_use_up_its_events_where_one_run_settles():
    found = epp.find_limit_cycles(_loop())
    assert found.settles and not any("used up all events" in text for text in found.left_open)
