"""Rules of the engine at switches: traps that break event machines, each on a loop whose answer is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.engine import workspace
from eppanalysis.engine.tables import make_combinations
from eppanalysis.methods.simulation import runs
from eppanalysis.models.systems.signals import SignalMap
from eppanalysis.results import Status


def block_on_friction(
    push: float, coulomb: float, static: float | None = None, x0: tuple = (0.0, 0.0)
) -> epp.LureSystem:
    """A mass of one that `push` - t drives against friction: dv/dt = push - t - F."""
    A, B, C = [[0.0, 0.0], [0.0, 0.0]], [[-1.0], [0.0]], [[1.0, 0.0]]
    signals = SignalMap(
        ("v", "F"), np.array([[1.0, 0], [0, 0]]), np.array([[0.0], [1.0]]), np.zeros((2, 1)), np.zeros(2)
    )
    return epp.LureSystem.build(
        A,
        B,
        C,
        [epp.Friction(coulomb, static)],
        B_input=[[1.0], [0.0]],
        input_names=("push",),
        v0=[push],
        signals=signals,
        x0=x0,
    )


@pytest.mark.parametrize("excess", [1e-3, 1e-9, 1e-12, 3e-15, 1e-16, 0.0])
def test_torque_barely_above_friction_ends(excess: float) -> None:
    """A drive that starts with its force barely above friction, and falling, moves for 2 * excess and stays."""
    run = epp.simulate(block_on_friction(1.0 + excess, 1.0), epp.inputs.Ramp(-1.0), t_end=0.5)
    assert len(run.events) <= 4
    assert run.signals["v"][-1] == 0.0
    assert run.provenance.statistics["forced_leaves"] == 0


def test_sliding_block_stops_when_it_should() -> None:
    """From v = 1 with no push the block stops after 1/F, exactly, and never moves again."""
    run = epp.simulate(block_on_friction(0.0, 0.5, x0=(1.0, 0.0)), t_end=5.0)
    stops = [e.time for e in run.events if e.name == "sticks"]
    assert stops == [pytest.approx(2.0, rel=1e-14)]
    assert np.all(run.signals["v"][run.t > 2.0] == 0.0)


def test_two_crossings_inside_one_step_are_both_found() -> None:
    """An undamped oscillator's peak pokes through a threshold for far less than a step."""
    for depth in (1e-2, 1e-4, 1e-6, 1e-8):
        loop = epp.LureSystem.build(
            [[0.0, 1.0], [-1.0, 0.0]],
            [[0.0], [0.0]],
            [[1.0, 0.0]],
            [epp.DeadZone(-2.0, 1.0 - depth, 1.0)],
            x0=[0.0, 1.0],
        )
        run = epp.simulate(loop, t_end=40.0, t_eval=[0.0], step=2.0)
        half = math.acos(1.0 - depth)
        turns = [math.pi / 2 + 2 * math.pi * k for k in range(7) if math.pi / 2 + 2 * math.pi * k + half < 40]
        expected = [t + s * half for t in turns for s in (-1, 1)]
        assert [e.time for e in run.events if e.time > 0] == pytest.approx(expected, abs=1e-9 / math.sqrt(depth) ** 0.5)


def test_a_guard_that_is_only_touched_leaves_the_run_alone() -> None:
    """The same oscillator, touching: peak and threshold agree to rounding; a jump there must not be taken for good."""
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [0.0]], [[1.0, 0.0]], [epp.DeadZone(-2.0, 1.0 + 1e-12, 1.0)], x0=[0.0, 1.0]
    )
    run = epp.simulate(loop, t_end=40.0)
    assert run.events == ()


def test_start_beyond_a_sticking_level_moves_on() -> None:
    """A relay that would slide at zero starts far from it: the state must not be pulled onto the threshold."""
    loop = epp.LureSystem.build([[-1.0]], [[-1.0]], [[1.0]], [epp.Relay(-1.0, 1.0)], x0=[5.0])
    run = epp.simulate(loop, t_end=4.0, t_eval=[0.0, 1.0])
    assert run.signals["relay_input"][0] == 5.0
    assert run.signals["relay_input"][1] == pytest.approx(6.0 * math.exp(-1.0) - 1.0, rel=1e-14)


def test_sliding_mode_holds_the_threshold() -> None:
    """dx/dt = 0.5 - sgn(x): reaches zero and slides there with the equivalent output 0.5."""
    loop = epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0]], [epp.Relay(-1.0, 1.0)], constant_state=[0.5], x0=[1.0])
    run = epp.simulate(loop, t_end=6.0)
    late = run.t > 2.0 + 1e-9
    assert np.all(run.signals["relay_input"][late] == 0.0)
    assert run.signals["relay_output"][late] == pytest.approx(0.5, abs=1e-15)


def test_accumulating_switches_stop_the_run_and_say_so() -> None:
    """Two relays on a double integrator, on position and on speed: switches accumulate at the origin."""
    zeno = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.0, 0.0], [-1.0, -0.5]],
        [[1.0, 0.0], [0.0, 1.0]],
        [epp.Relay(), epp.Relay()],
        x0=[1.0, 0.0],
    )
    run = epp.simulate(zeno, t_end=50.0, max_events=2000)
    assert run.status in (Status.EVENT_LIMIT, Status.SETTLED)


def test_results_do_not_depend_on_the_step() -> None:
    case = epp.case("fig8a_original")
    times = np.linspace(0.0, 3.0, 301)
    a, b = (epp.simulate(case.to_system(), case.input, 3.0, times, step=h) for h in (1e-2, 7e-5))
    assert np.abs(a.signals["theta"] - b.signals["theta"]).max() < 1e-12
    assert [e.name for e in a.events] == [e.name for e in b.events]


@pytest.mark.parametrize(("parts", "of_sixteen"), [(8, 2), (16, 1), (16, 2), (10, 3)])
def test_play_under_a_sine_switches_four_times_a_period_where_its_switches_fall_on_ends_of_steps(
    parts: int, of_sixteen: int
) -> None:
    """Steps end at every peak, where it lets go, and at the instant of its first contact."""
    gap = 2.0 * math.sin(2.0 * math.pi * of_sixteen / 16)
    # The plant is the integral of the play's output, which nothing feeds back.
    loop = epp.LureSystem.build(
        [[0.0]], [[1.0]], [[0.0]], [epp.Play(gap)], D_input=[[1.0]], input_names=("u",), B_input=[[0.0]]
    )
    run = epp.simulate(loop, epp.inputs.Sine(1.0, 1.0), 10.0, np.linspace(0.0, 10.0, 10 * parts + 1))
    meets = 0.5 * math.asin(gap - 1.0) / math.pi  # after each peak the input comes back by the gap
    up = np.arange(11.0)
    times = np.sort([*(up + 0.25), *(up + 0.75), *(up + 0.5 + meets), *(up[1:] + meets), of_sixteen / 16])
    expected = times[times < 10.0]
    np.testing.assert_allclose([e.time for e in run.events], expected, rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_stribeck_friction_breaks_away_alike_in_both_directions(way: float) -> None:
    """A push that grows slowly breaks the block away either way; the two motions are mirror images."""

    def moved(sign: float) -> np.ndarray:
        A, B, C = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], [[-1.0], [0.0], [0.0]], [[1.0, 0.0, 0.0]]
        loop = epp.LureSystem.build(
            A,
            B,
            C,
            [epp.Friction(1.0, 1.0, 3.0)],
            B_input=[[1.0], [0.0], [0.0]],
            input_names=("push",),
        )
        run = epp.simulate(loop, epp.inputs.Ramp(sign * 1.0), t_end=2.0)
        return run.signals["friction_input"]

    forward = moved(1.0)
    assert np.allclose(moved(way), way * forward, rtol=1e-12, atol=1e-12)
    # After breaking away at t = 1 the block obeys dv/dt = t - 1/(1 + 3 v); scipy is the witness.
    from scipy.integrate import solve_ivp

    witness = solve_ivp(lambda t, v: t - 1.0 / (1.0 + 3.0 * v), (1.0, 2.0), [0.0], rtol=1e-11, atol=1e-13)
    assert forward[-1] == pytest.approx(witness.y[0, -1], rel=1e-8)


def test_a_full_table_of_mode_combinations_leaves_no_trace(monkeypatch) -> None:
    """An encoder has more levels than the table has places: what differs in constants alone takes over matrices."""
    case, made = epp.case("azimuth_servo"), []
    for places in (256, 6, 2):
        monkeypatch.setattr(workspace, "make_combinations", lambda model, _, n=places: make_combinations(model, n))
        monkeypatch.setattr(runs, "of_thread", type(runs.of_thread)())
        made.append(epp.simulate(case, t_end=2.0))
    whole, *others = made
    assert len(whole.events) > 40
    for run in others:
        assert run.events == whole.events
        assert all(np.array_equal(values, whole.signals[signal]) for signal, values in run.signals.items())
