"""Dead time: against the closed form of a linear loop, scipy by the method of steps, and itself with other steps."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from math import factorial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.signals import SignalMap

JUMPY = [
    epp.Preload(0.3, 1.0),
    epp.Play(0.8),
    epp.JumpAndFollow(0.3, 0.1),
    epp.DeadZone(-0.05, 0.05),
    epp.RelayDeadZone(0.4),
]


def by_steps(gain: Fraction, delay: Fraction, t: Fraction) -> Fraction:
    """The term of degree n acts from the dead time n - 1 on."""
    begun = range(1, int(t // delay) + 2)
    return 1 + sum((-gain) ** n * (t - (n - 1) * delay) ** n / factorial(n) for n in begun)


@pytest.mark.parametrize(("gain", "delay"), [(1.0, 0.5), (1.6, 1.0), (0.3, 2.0)])
@pytest.mark.parametrize("step", [0.03, 0.4])
def test_a_linear_loop_has_a_closed_form(gain, delay, step):
    """x' = -k x(t - L) from x = 1: a polynomial of one degree more after each dead time (method of steps)."""
    loop = epp.LureSystem.from_tf(([gain], [1.0, 0.0]), epp.Saturation(-1e9, 1e9), delay=delay)
    times = np.linspace(0.0, 15.0 * delay, 301)
    run = run_hybrid(replace(HybridSystem.from_lure(loop, {}), x0=np.array([1.0])), times[-1], times, step, 10, 10)
    state = loop.signals.names.index("x")
    expected = np.array([float(by_steps(Fraction(gain), Fraction(delay), Fraction(t))) for t in times])
    scale = run.samples[0, state]
    np.testing.assert_allclose(run.samples[:, state] / scale, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_a_saturated_loop_against_the_method_of_steps():
    delay, end = 0.6, 12.0
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Saturation(slope=4.0), delay=delay)
    x0 = np.array([0.3, 1.0])
    times = np.linspace(0.0, end, 241)
    run = epp.simulate(replace(loop, x0=x0), t_end=end, t_eval=times)

    def push(x: np.ndarray) -> float:
        return float(np.clip(4.0 * (loop.C @ x)[0], -1.0, 1.0))

    pieces = [lambda t: x0]
    state, reached, found = x0, 0.0, [x0]
    while reached < end - 1e-9:
        past, stop = pieces[-1], reached + delay
        wanted = times[(times > reached + 1e-12) & (times <= stop + 1e-12)]
        part = solve_ivp(
            lambda t, x, past=past: loop.A @ x + loop.B[:, 0] * push(past(t - delay)),
            (reached, stop), state, method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.01, dense_output=True,
        )  # fmt: skip
        found += [part.sol(t) for t in wanted]
        state, reached = part.y[:, -1], stop
        pieces.append(part.sol)
    expected = (np.array(found) @ loop.C.T)[:, 0]
    np.testing.assert_allclose(run.signals["x"], expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("element", JUMPY, ids=lambda e: type(e).__name__)
def test_the_step_does_not_matter(element: epp.Nonlinearity):
    loop = epp.LureSystem.from_tf(([3.0], [1.0, 1.5, 0.5, 0.0]), element, delay=0.7)
    hybrid = replace(HybridSystem.from_lure(loop, {}), x0=np.array([0.1, -0.2, 0.5]))
    times = np.linspace(0.0, 30.0, 61)
    coarse, fine = (run_hybrid(hybrid, 30.0, times, step, 1000, 1000) for step in (0.5, 0.011))
    assert coarse.count == fine.count > 4
    np.testing.assert_allclose(coarse.samples, fine.samples, rtol=0, atol=1e-9 * np.abs(fine.samples).max())


@pytest.mark.parametrize("element", [JUMPY[0], JUMPY[2]], ids=lambda e: type(e).__name__)
def test_switches_of_long_ago_cost_nothing(element: epp.Nonlinearity):
    """Each switch comes back after every dead time, ever more faintly; what has become rounding is no border."""
    loop = epp.LureSystem.from_tf(([1.2], [1.0, 1.5, 0.5, 0.0]), element, delay=0.7)
    hybrid = replace(HybridSystem.from_lure(loop, {}), x0=np.array([0.1, -0.2, 0.9]))
    short, long = (run_hybrid(hybrid, end, np.zeros(0), 0.3, 100_000, 100) for end in (100.0, 1000.0))
    assert long.stats[4] < 15.0 * short.stats[4]


@pytest.mark.parametrize("moved", [0.0, -0.2])
def test_a_step_of_the_input_is_felt_after_the_dead_time(moved):
    """x' = -x + clip(v, -0.5, 0.5)(t - 0.5): v jumps from `moved` to 2 at time 0, and was `moved` before."""
    loop = epp.LureSystem.build(
        [[-1.0]], [[1.0]], [[0.0]], [epp.Saturation(-0.5, 0.5)], delays=[0.5],
        input_names=["v"], B_input=[[0.0]], D_input=[[1.0]], v0=[moved],
        signals=SignalMap(("x",), np.eye(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1)),
    )  # fmt: skip
    times = np.linspace(0.0, 2.0, 41)
    run = epp.simulate(loop, {"v": epp.inputs.Step(2.0 - moved, 0.0)}, t_end=2.0, t_eval=times)
    before = moved * (1.0 - np.exp(-np.minimum(times, 0.5)))
    after = np.maximum(times - 0.5, 0.0)
    expected = before * np.exp(-after) + 0.5 * (1.0 - np.exp(-after))
    np.testing.assert_allclose(run.signals["x"], expected, rtol=0, atol=1e-13)


def test_a_dead_time_that_is_none_is_refused():
    loop = epp.LureSystem.from_tf(([1.2], [1.0, 1.5, 0.5, 0.0]), epp.Saturation(), delay=1e-9)
    with pytest.raises(
        ModelError, match=r"dead time of 1e-09 s is negligible beside .* expected 0, or at least 1e-07 s"
    ):
        epp.simulate(loop, t_end=1.0)


@pytest.mark.parametrize("step", [0.05, 0.02, 0.01, 0.005])
def test_play_lets_go_once_whatever_the_step(step: float) -> None:
    """It lets go where its input turns, to rounding of the time at which the past is read."""
    loop = epp.LureSystem.from_tf(([41.6, 5.2], [80.0, 8.0, 0.0]), epp.Play(1.0), delay=2.0, x0=[0.0, 200.0])
    times = np.arange(0.0, 101.0, 5.0)
    found, coarse = (epp.simulate(loop, t_end=100.0, t_eval=times, step=h) for h in (step, 0.1))
    np.testing.assert_allclose([e.time for e in found.events], [e.time for e in coarse.events], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.signals["x"], coarse.signals["x"], rtol=0.0, atol=1e-7)
    later = [e.name.split()[0] for e in found.events if e.time > 1.0]
    assert later == (["lets", "meets"] * len(later))[: len(later)]
