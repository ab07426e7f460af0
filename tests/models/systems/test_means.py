"""Means: modes at zero that the elements do not see put no condition on them, however many integrators are in a row."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import eppanalysis as epp
from eppanalysis.models.systems.means import StaticBalance
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


@pytest.mark.parametrize("row", [1, 2])
@pytest.mark.parametrize("seed", [None, 3])
def test_what_turns_freely_at_a_mean_speed_leaves_that_speed_as_it_is(row, seed):
    """The angle of a drive whose speed is controlled: integrators of what an element sees, none of which it sees."""
    drawn = epp.LureSystem.from_tf(([2.0], [1.0, 3.0, 3.0, 1.0]), epp.Relay(low=-1.0, high=3.0))
    biased = epp.LureSystem.build(drawn.A, drawn.B, drawn.C, drawn.elements)
    A = scipy.linalg.block_diag(np.diag(np.ones(row - 1), 1), biased.A)
    A[row - 1, row:] = biased.C[0]
    B, C = np.vstack([np.zeros((row, 1)), biased.B]), np.hstack([np.zeros((1, row)), biased.C])
    loop = epp.LureSystem.build(A, B, C, biased.elements)
    loop = loop if seed is None else turned(loop, np.random.default_rng(seed))
    (alone,), (cycle,) = epp.predict_limit_cycles(biased), epp.predict_limit_cycles(loop)
    for name in alone.mean:
        assert abs(alone.mean[name]) > 0.01 * alone.peak_to_peak[name]
        assert cycle.mean[name] == pytest.approx(alone.mean[name], rel=1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_solved_for_means_a_balance_holds_for_the_same_ones(seed):
    """Three elements, the last with two outputs; the second's mean input alone is prescribed, but not in one row."""
    draw = np.random.default_rng(seed)
    mixed = draw.normal(size=(3, 3)) @ np.diag(10.0 ** draw.uniform(-3, 3, 3))
    on_bias, on_mean = np.array([[0.0, 0, 2.0], [0, 1.0, 0], [0, 0, 0]]), draw.normal(size=(3, 4))
    on_mean[1] = 0.0
    static = StaticBalance(np.arange(3), mixed @ on_bias, mixed @ on_mean, mixed @ np.array([0.3, 0.7, 0.0]))
    owner = np.array([0, 1, 2, 2])
    solved = static.solved(owner)
    assert solved is not None
    table, own = (np.column_stack(part[1:3]) for part in (static, solved))
    exact = np.linalg.lstsq(table.T, own.T, rcond=None)[0].T
    assert np.allclose(exact @ table, own, atol=1e-7) and np.allclose(exact @ static.prescribed, solved.prescribed)
    of = np.append(np.arange(3), owner)
    for i in range(3):
        alone = (of == i) & (np.count_nonzero(own, axis=0) == 1)
        assert np.any(own[i, alone] == 1.0)
    assert np.count_nonzero(own[1]) == 1 and solved.prescribed[1] == pytest.approx(0.7, rel=1e-9)


def test_a_balance_without_an_equation_for_each_element_is_not_solved():
    static = StaticBalance(np.arange(2), np.zeros((2, 2)), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.zeros(2))
    assert static.solved(np.array([0, 0, 1])) is None
