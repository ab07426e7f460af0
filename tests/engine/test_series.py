"""Series of smooth motion beside closed forms, however much faster than its mode's steps the motion is."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.engine._engine import parts
from eppanalysis.engine.tables import aligned, padded
from eppanalysis.engine.workspace import ORDER
from eppanalysis.results import Status
from tests.stress.families import with_states

Array = NDArray[np.float64]


def states(loop: epp.LureSystem, times: Array, **settings: float) -> tuple[epp.Trajectory, Array]:
    """A run, and its states: a row a time."""
    run = epp.simulate(with_states(loop), t_end=float(times[-1]), t_eval=times, **settings)
    return run, np.column_stack(list(run.signals.values()))


def cubic(rate: float, start: float = 1.0) -> epp.LureSystem:
    """x' = -rate x^3."""
    return epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0]], [epp.Cube(rate)], x0=[start])


@settings(max_examples=40, deadline=None)
@given(exponent=st.floats(-3.0, 11.0), start=st.floats(0.1, 10.0), seed=st.integers(0, 2**32 - 1))
def test_samples_of_fast_smooth_motion_are_those_of_their_times(exponent: float, start: float, seed: int) -> None:
    """1/x^2 grows evenly. Its first samples, that at the start too, were once the state up to 1e-9 of a step later."""
    rate = 10.0**exponent / start**2
    early = 10.0 ** np.random.default_rng(seed).uniform(-6.0, 2.0, 20) / 10.0**exponent
    times = np.unique(np.concatenate([[0.0, 1.0], early[early < 1.0]]))
    run, x = states(cubic(rate, start), times)
    assert run.status in (Status.UNDECIDED, Status.SETTLED)
    np.testing.assert_allclose(x[:, 0], start / np.sqrt(1.0 + 2.0 * 10.0**exponent * times), rtol=1e-13)


@pytest.mark.parametrize("size", [1.0, 1e6, 1e12])
@pytest.mark.parametrize("step", [0.25, 0.01])
def test_samples_just_beside_a_step_are_those_of_their_times(size: float, step: float) -> None:
    """A state that moves far within a time that is nothing to the poles: steps of the linear mode are long for it."""
    A = np.array([[-1.0, size], [0.0, -2.0]])
    loop = epp.LureSystem.build(A, np.zeros((2, 1)), [[0.0, 1.0]], [epp.Saturation(-5.0, 5.0)], x0=[0.0, 1.0])
    beside = np.array([-1e-10, -1e-13, 0.0, 1e-13, 1e-10]) * step
    times = np.concatenate([[0.0], beside[3:], step + beside, 4.0 * step + beside, [1.0 + step]])
    _, x = states(loop, times, step=step)
    exact = np.array([expm(A * t)[:, 1] for t in times])
    np.testing.assert_allclose(x, exact, rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("rate", [1e12, 1e18, 1e48])
@pytest.mark.parametrize("start", [1.0, 1e3])
def test_a_motion_that_dies_out_before_the_clock_moves_is_followed(rate: float, start: float) -> None:
    times = np.linspace(0.0, 10.0, 11)
    run, x = states(cubic(rate, start), times)
    assert run.status.ok
    np.testing.assert_allclose(x[:, 0], start / np.sqrt(1.0 + 2.0 * rate * start**2 * times), rtol=1e-12)


@pytest.mark.parametrize("rate", [-1.0, -1e6])
def test_a_motion_that_escapes_in_finite_time_diverges(rate: float) -> None:
    """1/x^2 falls to zero at -1/(2 rate): the last of it is too fast for the clock, and yet no limit of steps."""
    begin = time.process_time()
    run, x = states(cubic(rate), np.array([0.0, 0.25 / abs(rate), 10.0]))
    assert run.status is Status.DIVERGED and time.process_time() - begin < 5.0
    np.testing.assert_allclose(x[:, 0], [1.0, np.sqrt(2.0)], rtol=1e-13)


def test_what_rests_at_a_sample_before_it_moves_too_fast_for_the_clock_is_sampled_before() -> None:
    """A step of the input at t = 5, a sample there, and 1e-15 s later the state is elsewhere."""
    loop = epp.LureSystem.build(
        [[0.0]], [[-1.0]], [[1.0]], [epp.Cube(1e20)], input_names=["v"], B_input=[[0.0]], D_input=[[1.0]]
    )
    run = epp.simulate(with_states(loop), {"v": epp.inputs.Step(1.0, 5.0)}, t_end=10.0, t_eval=[0.0, 5.0, 10.0])
    # It goes to where x + v = 0.
    np.testing.assert_allclose(run.signals["x0"], [0.0, 0.0, -1.0], atol=1e-10)


@pytest.mark.parametrize("rate", [1e15, 1e18, 1e100, 1e300])
@pytest.mark.parametrize("start", [1.0, 1e3])
@pytest.mark.parametrize("behind", [[1.0, 0.0], [1.0, 3.0, 2.0], [1.0, 3.0, 2.0, 0.0]])
def test_no_sample_of_a_motion_too_fast_for_numbers_is_none(rate: float, start: float, behind: list[float]) -> None:
    """Terms of its series overflow, and what they make up is no number: not below rounding, therefore."""
    loop = epp.LureSystem.from_tf(([1.0], behind), epp.Cube(1.0))
    fast = replace(loop, C=rate * loop.C, x0=np.full(len(behind) - 1, start))
    run, x = states(fast, np.linspace(0.0, 10.0, 11))
    assert np.all(np.abs(x) <= 1e100)
    if not run.status.ok and run.status is not Status.DIVERGED:
        assert run.status is Status.EVENT_LIMIT and "far faster motions" in run.to_dict()["message"]


@pytest.mark.parametrize("beneath", [1e-300, 5e-92, 1e-40, 1e-20, 1e-17, 1e-12])
def test_a_guard_that_falls_from_just_beneath_zero_rises_again_where_its_series_does(beneath: float) -> None:
    """A relay whose input began less than rounding beneath its switch did not switch before the next step."""
    (series,) = aligned((padded(ORDER + 1),))
    series[:3] = -beneath, -0.148, 0.18
    assert parts.first_rise(series, 0.0) == pytest.approx(0.148 / 0.18, rel=1e-9)
