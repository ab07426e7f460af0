"""A sampled loop whose encoder passes many edges: what one run decides the search decides too."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp

#: Step of the encoder and sample time.
EDGE, SAMPLE = 5e-6, 1e-3


def _loop() -> epp.LureSystem:
    """x' = -x - u, with u the encoder's reading of x at each sample: x shrinks by the same share from sample to
    sample, but for half an edge, and passes 200 000 edges on its way.
    """
    law = epp.SampledController([[0.0]], [[0.0]], [[0.0]], [[1.0]], sample_time=SAMPLE)
    return epp.LureSystem.build(
        [[-1.0]], [[0.0, -1.0]], [[1.0], [0.0]], [epp.Quantiser(EDGE), law], D=[[0.0, 0.0], [1.0, 0.0]], x0=[1.0]
    )


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    reason="runs of a search stop after a number of events that is set by samples; a budget by the loop's time "
    "constants, and its own run, decide",
)
def test_a_search_does_not_use_up_its_events_where_one_run_settles():
    loop = _loop()
    share, x = np.exp(-SAMPLE), 1.0
    for _ in range(20_000):  # from sample to sample
        x = share * x - (1.0 - share) * EDGE * np.round(x / EDGE)
    assert abs(x) <= EDGE
    run = epp.simulate(loop, t_end=30.0, max_events=1_000_000)
    assert run.status is epp.Status.SETTLED
    found = epp.find_limit_cycles(loop)
    assert found.settles and not any("used up all events" in text for text in found.left_open)
