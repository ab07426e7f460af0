"""Verdicts on loops with sampled controllers: at rest, locked to the samples, not locked, undecided."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings, strategies as st

import eppanalysis as epp

A = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])


def sampled_relay(x0: list[float], T: float = 0.2) -> epp.LureSystem:
    """1/(s+1)^3 under a relay with hysteresis that reads the samples of its output."""
    reader = epp.SampledController([], [], [], [[1.0]], T)
    B, C, D = np.zeros((3, 2)), np.zeros((2, 3)), np.zeros((2, 2))
    B[0, 1], C[0, 2], D[1, 0] = -1.0, 1.0, 1.0
    elements = [reader, epp.HysteresisRelay(-0.1, 0.1)]
    return epp.LureSystem.build(A, B, C, elements, D=D, x0=x0, element_names=["reader", "relay"])


def integral(plant: float, gain: float, T: float, x0: float = 1.0) -> epp.LureSystem:
    """A first-order plant under a sampled integral controller."""
    law = epp.SampledController([[1.0]], [[gain * T]], [[1.0]], [[0.0]], T)
    return epp.LureSystem.build([[-plant]], [[1.0]], [[-1.0]], [law], x0=[x0], element_names=["law"])


def test_a_loop_comes_to_rest_though_its_samples_go_on() -> None:
    run = epp.simulate(integral(1.0, 0.5, 0.05), t_end=100.0)
    assert run.status is epp.Status.SETTLED and abs(run.settled_at["law_input"]) < 1e-9
    assert 20.0 < run.settled_since < 60.0


def test_a_run_costs_no_memory_for_steps_of_an_encoder_that_it_never_reaches() -> None:
    def peak(levels: int) -> int:
        reader = epp.SampledController([], [], [], [[1.0]], 0.1)
        elements = [reader, epp.Quantiser(step=0.01, levels=levels)]
        D = [[0.0, 1.0], [0.0, 0.0]]
        loop = epp.LureSystem.build([[-1.0]], [[-1.0, 0.0]], [[0.0], [1.0]], elements, D=D, x0=[0.1])
        epp.simulate(loop, t_end=1.0)
        tracemalloc.start()
        epp.simulate(loop, t_end=1.0)
        try:
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert peak(2048) < 2 * peak(256)  # pairs of its steps, of which there are 64 times as many, are not counted


def test_slow_motion_between_two_samples_is_no_rest() -> None:
    # A time constant of 200 s at 1 kHz: a sample moves it by five millionths of the way that is left.
    run = epp.simulate(integral(1.0, 0.005, 0.001), t_end=60.0)
    assert run.status is epp.Status.UNDECIDED


def test_an_integrator_that_winds_up_behind_a_stuck_drive_is_no_rest() -> None:
    law = epp.SampledController([[1.0]], [[0.001]], [[1.0]], [[0.0]], 0.01)
    loop = epp.LureSystem.build(
        [[-1.0]], [[-1.0, 1.0]], [[1.0], [0.0]], [epp.Friction(coulomb=50.0), law], D=np.zeros((2, 2)),
        D_input=[[0.0], [1.0]], input_names=["setpoint"], element_names=["friction", "law"],
    )  # fmt: skip
    run = epp.simulate(loop, epp.inputs.Step(1.0), t_end=100.0)
    assert run.signals["friction_input"][-1] == 0.0 and run.status is epp.Status.UNDECIDED


def test_a_loop_that_grows_is_neither() -> None:
    law = epp.SampledController([], [], [], [[-45.0]], 0.1)
    loop = epp.LureSystem.build([[-1.0]], [[1.0]], [[1.0]], [law], x0=[1.0])
    assert epp.simulate(loop, t_end=10.0).status is epp.Status.UNDECIDED
    assert epp.simulate(loop, t_end=100.0).status is epp.Status.DIVERGED


def iterated(x: np.ndarray, n: int) -> np.ndarray:
    """States at the samples by the exact map, the relay beside it."""
    M = np.zeros((4, 4))
    M[:3, :3], M[0, 3] = A, -1.0
    E, relay, out = scipy.linalg.expm(0.2 * M), -1.0, []
    for _ in range(n):
        out.append(x)
        relay = 1.0 if x[2] > 0.1 else -1.0 if x[2] < -0.1 else relay
        x = E[:3, :3] @ x + E[:3, 3] * relay
    return np.array(out)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3))
def test_a_locked_cycle_is_that_of_the_iterated_map(x0) -> None:
    run = epp.simulate(sampled_relay(x0), t_end=200.0)
    states = iterated(np.array(x0), 1000)
    lengths = [n for n in range(1, 60) if np.abs(states[-1] - states[-1 - n]).max() < 1e-10]
    assert run.status is epp.Status.LIMIT_CYCLE
    assert run.limit_cycle.period == pytest.approx(0.2 * lengths[0], rel=1e-12)
    assert run.limit_cycle.note == f"locked to the samples: {lengths[0]} of 0.2 s"
    assert run.limit_cycle.peak_to_peak["relay_input"] == pytest.approx(np.ptp(states[-60:, 2]), rel=1e-9)
    assert all(event.element == "relay" for event in run.limit_cycle.events) and len(run.limit_cycle.events) == 2


def test_a_locked_cycle_goes_on_from_its_state_and_memory() -> None:
    loop = sampled_relay([1.0, 0.0, 0.0])
    cycle = epp.simulate(loop, t_end=200.0).limit_cycle
    again = replace(loop, x0=cycle.state, memory=cycle.memory)
    run = epp.simulate(again, t_end=26.0, t_eval=np.array([0.1, 5.3, 10.5, 15.7]))
    np.testing.assert_allclose(run.signals["reader_output"], cycle.memory[0].output[0], rtol=1e-11)


def test_a_cycle_that_is_not_locked_is_called_so() -> None:
    # A relay loop, a little disturbed by a sampled law whose samples have nothing to do with its period.
    law = epp.SampledController([], [], [], [[0.02]], 0.0371)
    B, C = np.zeros((3, 2)), np.zeros((2, 3))
    B[0, 0], B[0, 1], C[0, 2], C[1, 1] = -1.0, -1.0, 1.0, 1.0
    loop = epp.LureSystem.build(
        A, B, C, [epp.HysteresisRelay(-0.1, 0.1), law], x0=[1.0, 0, 0], element_names=["relay", "law"]
    )
    run = epp.simulate(loop, t_end=400.0)
    cycle = run.limit_cycle
    assert run.status is epp.Status.LIMIT_CYCLE and cycle.note.startswith("not locked to the samples of 0.0371 s")
    # Its turns differ by what the phase of the samples does; an independent iteration bounds them.
    crossings = independent_crossings(400.0)
    turns = np.diff(crossings[-40:])
    assert cycle.period == pytest.approx(turns.mean(), rel=1e-4)
    assert 0.0 < cycle.error_estimate < 0.02


def resonance(damping: float) -> np.ndarray:
    """A lag of 1 s before a resonance at 1 rad/s, whose second state is the output."""
    return np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, -damping]])


def read_resonance(sample_time: float, damping: float) -> epp.LureSystem:
    """A relay on that resonance, which reads samples."""
    reader = epp.SampledController([], [], [], [[1.0]], sample_time)
    return epp.LureSystem.build(
        resonance(damping), [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], [[0.0, -1.0, 0.0], [0.0, 0.0, 0.0]],
        [reader, epp.HysteresisRelay(-0.1, 0.1)], D=[[0.0, 0.0], [1.0, 0.0]], x0=[1.0, 0.0, 0.0],
        element_names=["reader", "relay"],
    )  # fmt: skip


def iterated_resonance(sample_time: float, damping: float, t_end: float) -> np.ndarray:
    """Input of the reader, ten times a sample, by the exponential of a tenth of it."""
    A, parts = resonance(damping), 10
    held = scipy.linalg.expm(np.block([[A, np.eye(3)[:, :1]], [np.zeros((1, 4))]]) * sample_time / parts)
    x, u, seen = np.array([1.0, 0.0, 0.0]), -1.0, []
    for _ in range(int(t_end / sample_time)):
        u = 1.0 if -x[1] > 0.1 else -1.0 if -x[1] < -0.1 else u
        for _ in range(parts):
            x = held[:3, :3] @ x + held[:3, 3] * u
            seen.append(-x[1])
    return np.array(seen)


def test_growth_that_samples_roughen_is_no_cycle() -> None:
    # Each turn begins at another phase of the samples, so that its size goes to and fro by 2 % while it grows by 11 %.
    run = epp.simulate(read_resonance(0.4, 0.005), t_end=600.0)
    seen = iterated_resonance(0.4, 0.005, 3000.0)
    assert np.ptp(seen[-2000:]) > 1.25 * np.ptp(seen[13000:15000])  # of 80 s before 3000 s, and before 600 s
    assert run.status is epp.Status.UNDECIDED


def test_the_size_of_a_cycle_that_is_not_locked_is_that_of_all_its_turns() -> None:
    cycle = epp.simulate(read_resonance(0.45, 0.05), t_end=600.0).limit_cycle
    assert cycle.note.startswith("not locked to the samples")
    seen = iterated_resonance(0.45, 0.05, 600.0)
    assert cycle.peak_to_peak["reader_input"] == pytest.approx(np.ptp(seen[seen.size // 2 :]), rel=5e-3)


def independent_crossings(t_end: float) -> np.ndarray:
    """Times at which the relay switches up, sample by sample with the exact map and bisection."""
    T, x, relay, law, out, t = 0.0371, np.array([1.0, 0.0, 0.0]), -1.0, 0.0, [], 0.0

    def flow(x: np.ndarray, u: float, d: float) -> np.ndarray:
        M = np.zeros((4, 4))
        M[:3, :3], M[0, 3] = A, -1.0
        E = scipy.linalg.expm(d * M)
        return E[:3, :3] @ x + E[:3, 3] * u

    while t < t_end:
        law, left = 0.02 * x[1], T
        while left > 0.0:
            end = flow(x, relay + law, left)
            level = -relay * (end[2] + relay * 0.1)
            if not level > 0.0:
                x, left, t = end, 0.0, t + left
                continue
            low, high = 0.0, left
            for _ in range(45):
                middle = 0.5 * (low + high)
                passed = -relay * (flow(x, relay + law, middle)[2] + relay * 0.1) > 0.0
                low, high = (low, middle) if passed else (middle, high)
            x, left, t = flow(x, relay + law, high), left - high, t + high
            relay = -relay
            if relay > 0.0:
                out.append(t)
    return np.array(out)


MASS, DAMPING, COULOMB, QUANTUM = 0.1, 0.1, 0.05, 50e-6


def moved(x: float, v: float, force: float, time: float) -> tuple[float, float]:
    """A mass with damping and Coulomb friction under a constant force, by its closed form."""
    while time > 0.0:
        if v == 0.0 and abs(force) <= COULOMB:
            return x, 0.0
        final = (force - np.sign(v or force) * COULOMB) / DAMPING
        end = final + (v - final) * np.exp(-DAMPING / MASS * time)
        turns = v * end < 0.0
        span = MASS / DAMPING * np.log((v - final) / -final) if turns else time
        x += final * span + (v - final) * MASS / DAMPING * -np.expm1(-DAMPING / MASS * span)
        v, time = (0.0, time - span) if turns else (end, 0.0)
    return x, v


@pytest.mark.parametrize(("stiffness", "start"), [(1500.0, 2e-4), (3000.0, 2e-4), (500.0, 4e-3)])
def test_a_virtual_spring_comes_to_rest_where_an_independent_integrator_does(stiffness, start) -> None:
    spring = epp.SampledController([], [], [], [[-stiffness]], 1e-3)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -DAMPING / MASS]], [[0.0] * 3, [-1.0 / MASS, 0.0, 1.0 / MASS]],
        [[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]], [epp.Friction(coulomb=COULOMB), epp.Quantiser(QUANTUM, 100), spring],
        D=[[0.0] * 3, [0.0] * 3, [0.0, 1.0, 0.0]], x0=[start, 0.0], element_names=["friction", "encoder", "spring"],
    )  # fmt: skip
    run = epp.simulate(loop, t_end=10.0)
    x, v = start, 0.0
    for _ in range(10_000):
        x, v = moved(x, v, -stiffness * QUANTUM * np.floor(x / QUANTUM + 0.5), 1e-3)
    assert run.status is epp.Status.SETTLED and v == 0.0
    assert run.settled_at["encoder_input"] == pytest.approx(x, abs=1e-11)


def test_what_is_left_of_a_decay_within_a_dead_zone_is_no_cycle() -> None:
    """Within the overlap of a valve a lag swings out: at 1e-8 of the motion it still passes zero at each turn."""
    blocks = epp.blocks
    servo = epp.Diagram(
        parts={
            "controller": blocks.PI(kp=2000.0, ti=0.5, sample_time=2e-3),
            "valve": blocks.TransferFunction(num=[0.001], den=[1.6e-5, 0.0048, 1.0], start=[0.0255, -5.09e-06]),
            "overlap": epp.DeadZone(lower=-2e-4, upper=2e-4),
            "oil": blocks.TransferFunction(num=[243e3], den=[1.0, 45.0, 8100.0], start=[3.85e-5, -7.39e-5]),
            "piston": blocks.Integrator(start=[4.98264e-3]),
            "sensor": blocks.LowPass(bandwidth=1500.0, start=[4.98416e-3]),
        },
        connect=[
            *("demand - sensor -> controller", "controller -> valve", "valve -> overlap", "overlap -> oil"),
            *("oil -> piston", "piston -> sensor"),
        ],
        inputs={"demand": 0.005},
    ).to_system()
    statuses = {float(t): epp.simulate(servo, t_end=t).status for t in (8.0, 9.0, 10.0, 11.0, 20.0)}
    assert statuses.pop(20.0) is epp.Status.SETTLED
    assert set(statuses.values()) <= {epp.Status.UNDECIDED, epp.Status.SETTLED}


@pytest.mark.parametrize("start", [0.3, pytest.param(1.0, marks=pytest.mark.slow)], ids=["grows", "shrinks"])
def test_a_motion_whose_size_still_changes_from_turn_to_turn_is_no_cycle(start: float) -> None:
    """An oscillator of little damping under a sampled law: its turns wander by a sample, its size goes one way."""
    T, A, b = 0.06, np.array([[0.0, 1.0], [-0.6, -0.1]]), np.array([0.0, 1.0])
    C, D = np.array([[-7.3, 0.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 0.0]])
    elements = [epp.SampledController([], [], [], [[1.0]], T), epp.Saturation(slope=0.6)]
    loop = epp.LureSystem.build(A, np.column_stack([0.0 * b, b]), C, elements, D=D, x0=[start, 0.0])

    step = scipy.linalg.expm(np.block([[A, b[:, None]], [np.zeros((1, 3))]]) * T)
    x, inputs = np.array([start, 0.0]), []
    for _ in range(40_000):
        x = step[:2, :2] @ x + step[:2, 2] * np.clip(-0.6 * 7.3 * x[0], -1.0, 1.0)
        inputs.append(7.3 * x[0])
    size = np.ptp(inputs[20_000:])

    runs = [epp.simulate(loop, t_end=t).limit_cycle for t in (20.0, 40.0, 60.0, 100.0, 600.0)]
    assert runs[-1] is not None
    for cycle in filter(None, runs):
        assert max(cycle.peak_to_peak.values()) == pytest.approx(size, rel=0.01)
