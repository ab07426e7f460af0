"""Jumps of inputs beside the elements' own maps with memory, which know no modes, along random cascades."""

from __future__ import annotations

from dataclasses import replace
from itertools import cycle, product
from typing import Any

import numpy as np
import pytest

import eppanalysis as epp
from tests.random_loops import random_element
from tests.reference.stepwise import cascade_order, outputs, run_stepwise
from tests.shared import mostly_slow

HOLDS = {
    "play": epp.Play(0.5),
    "jump_and_follow": epp.JumpAndFollow(1.0, 0.4),
    "jump_beyond_the_band": epp.JumpAndFollow(0.4, 1.0),
    "stiction_pulley": epp.StictionPulley(5.0, 20.0, 0.3, 0.6),
}
PATH = [1.0, -1.0, 0.9, 0.8, 0.15, -0.93, -0.8, 0.1, 0.3, 2.0, 1.9, 0.5, 0.5, -0.6]


def static(elements: list[epp.Nonlinearity], D: Any, D_input: Any, memory: list[Any], **more: Any) -> epp.LureSystem:
    """Elements in a cascade between external inputs and nothing."""
    inputs = [f"v{i}" for i in range(np.shape(D_input)[1])]
    nz, nw = np.shape(D)
    return epp.LureSystem.build(
        [[0.0 if more else -1.0]], np.zeros((1, nw)), np.zeros((nz, 1)), elements, D=D, D_input=D_input,
        input_names=inputs, memory=memory, **more,
    )  # fmt: skip


def first_memory(element: epp.Nonlinearity, rng: np.random.Generator) -> Any:
    """A number to begin with, where an element has a memory."""
    if isinstance(element, epp.Play | epp.JumpAndFollow):
        return float(rng.normal())
    if isinstance(element, epp.StictionPulley):
        return float(rng.uniform(0.0, 0.5))
    return None


def random_cascade(seed: int) -> tuple[epp.LureSystem, np.ndarray]:
    """Two to four elements of any kind, each fed by inputs and by others, in any order; and steps of two inputs."""
    rng = np.random.default_rng(seed)
    holds = list(HOLDS.values())
    elements = [random_element(rng), holds[seed % 4], *(random_element(rng) for _ in range(seed % 3))]
    shuffled = rng.permutation(len(elements))
    z = np.cumsum([0, *(e.n_inputs for e in elements)])
    w = np.cumsum([0, *(e.n_outputs for e in elements)])
    D, D_input = np.zeros((z[-1], w[-1])), np.zeros((z[-1], 2))
    for place, e in enumerate(shuffled):
        D_input[z[e]] = rng.normal(size=2) * (rng.random(2) < [1.0, 0.5])
        for before in shuffled[:place]:
            D[z[e], w[before] : w[before + 1]] = rng.normal() * (rng.random() < 0.8)
    system = static(elements, D, D_input, [first_memory(e, rng) for e in elements])
    return system, rng.normal(size=(12, 2)) * 1.5


@pytest.mark.parametrize("kind", HOLDS)
def test_what_holds_stays_put_until_its_input_has_crossed_the_gap(kind: str) -> None:
    element = HOLDS[kind]
    path = np.array(PATH) + 1.5 * (kind == "stiction_pulley")
    system = static([element], np.zeros((1, element.n_outputs)), [[1.0]], [0.2])
    times = np.arange(path.size)
    run = epp.simulate(system, epp.inputs.Steps(times, path), path.size, times + 0.5)
    got = np.array([v for k, v in run.signals.items() if "output" in k]).T
    memory, expected = 0.2, []
    for value in path:
        y, memory = element.output(value, memory)
        expected.append(np.atleast_1d(y))
    np.testing.assert_allclose(got, expected, atol=1e-12)


@pytest.mark.parametrize("time_step", [None, 1.0])
def test_play_by_hand(time_step: float | None) -> None:
    more = {"time_step": time_step} if time_step else {}
    system = static([epp.Play(0.5)], [[0.0]], [[1.0]], [0.0], **more)
    run = epp.simulate(system, epp.inputs.Steps([0.0, 1.0, 2.0, 3.0], [1.0, -1.0, 0.9, 0.8]), 3.0, [0.0, 1.0, 2.0, 3.0])
    held = run.signals["play_output"] if time_step else run.signals["play_output"][1:]
    np.testing.assert_allclose(held, [0.75, -0.75, 0.65, 0.65] if time_step else [-0.75, 0.65, 0.65], atol=1e-15)


def test_random_cascades_take_steps_as_their_maps_do() -> None:
    """Whatever the order in which elements are listed, and whatever overshoots on the way."""
    for seed in range(120):
        system, path = random_cascade(seed)
        times = np.arange(len(path))
        input_signals = {f"v{i}": epp.inputs.Steps(times, path[:, i]) for i in range(2)}
        run = epp.simulate(system, input_signals, float(len(path)), times + 0.5)
        memory, order, expected = list(system.memory), cascade_order(system), []
        for v in path:
            w, memory = outputs(system, order, np.zeros(1), v, memory)
            expected.append(system.signals.D @ w + system.signals.D_input @ v)
        got = np.array([run.signals[name] for name in system.signals.names]).T
        np.testing.assert_allclose(got, expected, atol=1e-9, err_msg=f"seed {seed}: {system.elements}")


def closed(
    front: epp.Nonlinearity, holds: epp.Nonlinearity, element_names: tuple[str, str] = ("front", "holds")
) -> Any:
    """An element that jumps, straight in front of one that holds, round 4/(s (s + 1)^2)."""
    return epp.LureSystem.from_blocks([front, holds, ([4.0], [1.0, 2.0, 1.0, 0.0])], element_names=element_names)


FRONTS = {
    "relay": epp.HysteresisRelay(-0.3, 0.4, -0.9, 1.0),
    "relay_dead_zone": epp.HysteresisRelayDeadZone(0.7, 0.3, 1.2),
    "quantiser": epp.Quantiser(0.45, 9),
    "stiction": epp.JumpAndFollow(0.9, 0.5),
}


BEHIND = ("play", "jump_and_follow", "jump_beyond_the_band")


@pytest.mark.parametrize(
    ("front", "behind"), mostly_slow(product(FRONTS, BEHIND), [*zip(FRONTS, cycle(BEHIND), strict=False)])
)
def test_cascades_in_a_loop_agree_with_their_maps_step_by_step(front: str, behind: str) -> None:
    """To half a per cent of the motion; a step is 0.5 ms, and its error, of first order, 0.3 % at most."""
    memory = (0.1 if front == "stiction" else None, 0.2)
    system, t_end = replace(closed(FRONTS[front], HOLDS[behind]), memory=memory), 8.0
    _, expected = run_stepwise(system, lambda t: np.zeros(0), t_end, 16_000)
    run = epp.simulate(system, None, t_end, np.linspace(0.0, t_end, 1001))
    got, place = run.signals["front_input"], system.signals.names.index("front_input")
    assert np.ptp(got) > 1.0
    np.testing.assert_allclose(got, expected[::16, place], atol=5e-3 * np.ptp(got))


@pytest.mark.parametrize("gap", [0.0, 0.3, 1.0, 1.9])
def test_relay_before_a_gap_is_a_relay_of_what_the_gap_leaves(gap: float) -> None:
    """A relay of levels 1 drives play of width b between 1 - b/2 and -(1 - b/2)."""
    level = 1.0 - gap / 2.0
    both = closed(epp.HysteresisRelay(-0.3, 0.3), epp.Play(gap))
    plant = ([4.0], [1.0, 2.0, 1.0, 0.0])
    alone = epp.LureSystem.from_blocks([epp.HysteresisRelay(-0.3, 0.3, -level, level), plant])
    (cycle,), (known,) = epp.find_limit_cycles(both), epp.find_limit_cycles(alone)
    assert cycle.period == pytest.approx(known.period, rel=1e-12)
    assert cycle.stable
    np.testing.assert_allclose(cycle.multipliers[:2], known.multipliers[:2], atol=1e-9)
    run = epp.simulate(both, t_end=60.0 * known.period)
    assert run.limit_cycle is not None
    assert run.limit_cycle.period == pytest.approx(known.period, rel=1e-9)


def test_what_overshoots_on_the_way_is_no_motion() -> None:
    """A step through a limiter straight into play: the play sees the limit, and stays there as the step goes back."""
    system = static([epp.Saturation(-1.0, 1.0), epp.Play(0.4)], [[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [None, 0.0])
    run = epp.simulate(system, epp.inputs.Steps([0.0, 1.0, 2.0], [0.0, 50.0, 0.95]), 3.0, [0.5, 1.5, 2.5])
    np.testing.assert_allclose(run.signals["play_output"], [0.0, 0.8, 0.8], atol=1e-12)


def test_jump_and_bend_at_once_on_a_moving_input() -> None:
    """A ramp carries play up, and a step goes back within the gap: it stays until the ramp has made that up."""
    system = static([epp.Play(1.0)], [[0.0]], [[1.0, 1.0]], [0.0])
    run = epp.simulate(
        system, {"v0": epp.inputs.Ramp(1.0), "v1": epp.inputs.Step(-0.6, 2.0)}, 4.0, [1.9, 2.1, 2.5, 2.7, 4.0]
    )
    np.testing.assert_allclose(run.signals["play_output"], [1.4, 1.5, 1.5, 1.6, 2.9], atol=1e-12)
    turned = epp.simulate(
        system,
        {"v0": epp.inputs.Recorded([0.0, 2.0, 4.0], [0.0, 2.0, 0.0]), "v1": epp.inputs.Step(0.5, 2.0)},
        4.0,
        [1.9, 2.1, 2.9, 3.5],
    )
    np.testing.assert_allclose(turned.signals["play_output"], [1.4, 2.0, 2.0, 1.5], atol=1e-12)


@pytest.mark.parametrize("jump", [0.5, -0.8])
def test_what_sticks_is_thrown_off_when_its_surface_jumps(jump: float) -> None:
    """A mass on a belt that starts at once: friction takes it along evenly until it sticks again."""
    system = epp.LureSystem.build(
        [[0.0]], [[-1.0]], [[1.0]], [epp.Friction(0.5)], D_input=[[-1.0]], input_names=("belt",),
        state_names=("speed",), element_names=("friction",),
    )  # fmt: skip
    run = epp.simulate(system, epp.inputs.Step(jump, 1.0), 4.0, np.linspace(0.0, 4.0, 41))
    speed = run.signals["friction_input"] + np.where(run.t >= 1.0, jump, 0.0)
    expected = np.sign(jump) * np.clip(0.5 * (run.t - 1.0), 0.0, abs(jump))
    np.testing.assert_allclose(np.delete(speed, 10), np.delete(expected, 10), atol=1e-12)


@pytest.mark.parametrize("model", ["unilateral", "classical"])
def test_lock_pin_is_thrown_across_its_gap(model: str) -> None:
    pin = epp.LockPin(0.2, 10.0, 0.5, model)
    system = static([pin], np.zeros((2, 1)), [[1.0], [0.0]], [None])
    path = np.array([0.3, -0.4, 0.05, -0.15, 0.5])
    run = epp.simulate(system, epp.inputs.Steps(np.arange(5), path), 5.0, np.arange(5) + 0.5)
    np.testing.assert_allclose(run.signals["lock_pin_output"], [pin.output((v, 0.0))[0] for v in path], atol=1e-12)
