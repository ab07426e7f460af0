"""Means: modes at zero that the elements do not see put no condition on them, however many integrators are in a row."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import eppanalysis as epp
from tests.stress.families import turned

OSCILLATOR = epp.LureSystem.from_tf(([0.2, 2.0], [1.0, -0.1, 1.0]), epp.Saturation())


@pytest.mark.parametrize("driven", [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.5, 0.0)])
@pytest.mark.parametrize("row", [1, 2, 3])
@pytest.mark.parametrize("seed", [None, 3])
def test_integrators_that_no_element_sees_leave_a_prediction_as_it_is(row, driven, seed):
    A = scipy.linalg.block_diag(np.diag(np.ones(row - 1), 1), OSCILLATOR.A)
    B = np.vstack([np.array(driven)[-row:, None], OSCILLATOR.B])
    C = np.hstack([np.zeros((1, row)), OSCILLATOR.C])
    loop = epp.LureSystem.build(A, B, C, OSCILLATOR.elements)
    loop = loop if seed is None else turned(loop, np.random.default_rng(seed))
    (alone,), (cycle,) = epp.predict_limit_cycles(OSCILLATOR), epp.predict_limit_cycles(loop)
    assert cycle.period == pytest.approx(alone.period, rel=1e-9)
    assert cycle.elements["saturation"]["amplitude"] == pytest.approx(
        alone.elements["saturation"]["amplitude"], rel=1e-9
    )
