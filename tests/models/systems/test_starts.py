"""State and memory of a cycle are where a run goes on from; what elements remember, they begin with."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.models.elements import ParkingBandLaw, SampledLaw, Slip
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.starts import remembered
from tests.restarts import check_restart, cycles_of
from tests.shared import mostly_slow

#: The others take longer; they are in the tests of stress.
QUICK = [
    "backlash_discrete_pi", "backlash_servo_unseen", "band_two_cycles", "belt_leine", "fig6a_original_pulley",
    "fig8a_original", "pid_hunting", "relay_biased_fopdt", "relay_deadzone", "relay_fopdt_closed", "relay_hyst_servo",
    "sat_asymmetric", "stiction_level_S5J2", "thruster_dz_hyst", "two_mass_damped_shaft", "van_der_pol_mu1",
]  # fmt: skip

BANDS = epp.FiveBandLaw(-2.0, -1.0, 1.0, 2.0, 16.0)
LOOPS = {
    "play": (epp.Play(2.0), ([5.0], [1.0, 1.0, 0.0])),
    "jump_and_follow": (epp.JumpAndFollow(1.0, 0.4), ([2.0], [1.0, 1.0, 0.0])),
    "jump_beyond_the_band": (epp.JumpAndFollow(0.4, 0.7), ([2.0], [1.0, 1.0, 0.0])),
    "hysteresis_relay": (epp.HysteresisRelay(-0.3, 0.7, -0.5, 1.0), ([2.0], [1.0, 1.0, 0.0])),
    "dead_zone_relay": (epp.HysteresisRelayDeadZone(0.8, 0.3, 1.0), ([4.0], [1.0, 1.0, 0.0])),
}


@pytest.mark.parametrize("name", mostly_slow(QUICK, QUICK[::4]))
def test_shipped_cycles_go_on_from_state_and_memory(name: str) -> None:
    system, value, cycles = cycles_of(name)
    assert cycles
    for cycle in cycles:
        check_restart(system, value, cycle)


@pytest.mark.parametrize("kind", LOOPS)
def test_cycle_of_a_run_goes_on_from_wherever_it_is_cut(kind: str) -> None:
    """Begun at each of its events in turn, and between any two of them."""
    element, plant = LOOPS[kind]
    system = epp.LureSystem.from_tf(plant, element)
    stable = max(epp.find_limit_cycles(system).stable, key=lambda c: c.period)
    found = epp.simulate(replace(system, x0=stable.state, memory=stable.memory), t_end=80.0 * stable.period).limit_cycle
    assert found is not None
    assert found.period == pytest.approx(stable.period, rel=1e-9)
    check_restart(system, epp.OperatingPoint(), replace(found, time=np.zeros(0), waveform={}))
    hybrid = HybridSystem.from_lure(replace(system, x0=stable.state, memory=stable.memory))
    marks = np.array([0.0, *(e.time for e in stable.events)])
    for cut in np.unique(np.concatenate([marks[1:-1], 0.3 * marks[:-1] + 0.7 * marks[1:]])):
        x, H, modes = state_at(hybrid, float(cut))
        again = replace(system, x0=x[: system.A.shape[0]], memory=remembered(hybrid, x, H, modes))
        run = epp.simulate(again, t_end=1.02 * stable.period)
        expected = sorted((e.time - cut) % stable.period for e in stable.events)
        met = [e.time for e in run.events if 1e-7 * stable.period < e.time < (1.0 - 1e-7) * stable.period]
        expected = [t for t in expected if 1e-7 * stable.period < t < (1.0 - 1e-7) * stable.period]
        np.testing.assert_allclose(met, expected, rtol=0.0, atol=1e-9 * stable.period)


def state_at(hybrid: HybridSystem, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State, memory values and modes a moment after t, as the engine has them."""
    from eppanalysis.methods.simulation.runs import run_hybrid

    run = run_hybrid(hybrid, t * (1.0 + 1e-12), np.zeros(0), 2.0 * hybrid.time_scale, 10_000, 10_000)
    last = run.order[-1] if run.n_kept else None
    stored, modes = (hybrid.H0, hybrid.modes0) if last is None else (run.memory_values[last], run.modes[last])
    return run.x_end, stored, modes


@pytest.mark.parametrize("level", [-1.0, 1.0])
def test_relay_with_hysteresis_begins_at_the_level_it_remembers(level: float) -> None:
    system = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.HysteresisRelay(-0.5, 0.5), x0=[0.0], memory=level)
    run = epp.simulate(system, t_end=0.1)
    np.testing.assert_allclose(run.signals["y"], level)
    np.testing.assert_allclose(run.signals["x"], -level * (1.0 - np.exp(-run.t)), atol=1e-12)


def test_a_jump_at_the_start_is_taken_from_what_was_reached() -> None:
    """An element that follows upward goes on where a step at the start carries its input on, and stays where not."""
    element = epp.JumpAndFollow(1.0, 0.4)
    system = epp.LureSystem.build(
        [[-1.0]], [[0.0]], [[0.0]], [element], D_input=[[1.0]], input_names=("v",), memory=[Slip(0.7, 1, 1.0)]
    )
    for value in (1.0, 1.3, 0.9, 0.4, -0.5):
        run = epp.simulate(system, epp.inputs.Step(value), 1.0, [0.5])
        assert run.signals["jump_and_follow_output"][0] == pytest.approx(element.output(value, system.memory[0])[0])


def test_what_is_remembered_begins_anew() -> None:
    """Modes and memory values of followers and relays come back from what is remembered of them."""
    elements = [
        epp.Play(0.5),
        epp.JumpAndFollow(1.0, 0.4),
        epp.HysteresisRelay(-1.0, 1.0),
        epp.HysteresisRelayDeadZone(1.0, 0.5),
    ]
    system = epp.LureSystem.build([[0.0]], np.zeros((1, 4)), np.zeros((4, 1)), elements, constant_input=[0.2] * 4)
    hybrid = HybridSystem.from_lure(system)
    rng = np.random.default_rng(7)
    for _ in range(40):
        modes = rng.integers([3, 3, 2, 3])
        H = np.append(rng.normal(size=hybrid.H0.size - 1), 1.0)
        memory = remembered(hybrid, hybrid.x0, H, modes)
        again = hybrid.begun(system.x0, memory)
        assert again.modes0[1:].tolist() == modes[1:].tolist()
        for one, other in zip(remembered(again, again.x0, again.H0, again.modes0), memory, strict=True):
            assert one == pytest.approx(other)


@pytest.mark.parametrize(
    ("element", "memories"),
    [
        (ParkingBandLaw(BANDS, 0.5), [(True, 1.5), (False, 1.25)]),
        (SampledLaw(BANDS, 0.01), [(3.0, 0.27)]),
        (epp.StictionPulley(5.0, 20.0, 0.3, 0.6), [0.1, Slip(0.1, -1, 0.4), Slip(0.1, 1, 0.4)]),
    ],
)
def test_laws_that_know_the_time_and_the_cable_begin_with_what_they_remember(element: Any, memories: list) -> None:
    automaton = element.automaton()
    for memory in memories:
        mode, stored = element.start(automaton, memory)
        x = np.array([memory.reached if isinstance(memory, Slip) else 0.1])
        assert element.memory_at(mode, stored, x, np.array([20.0 * stored[0], 0.0])) == pytest.approx(memory)


@pytest.mark.parametrize("kinetic", [0.6, 1.0])
@pytest.mark.parametrize("stretch", [-0.2, 0.05, 1.3])
def test_a_cable_without_memory_begins_in_a_run_as_its_map_says(kinetic: float, stretch: float) -> None:
    pulley = epp.StictionPulley(5.0, 20.0, 0.3, kinetic)
    loop = epp.LureSystem.build([[-1.0]], [[0.0, 0.0]], [[1.0]], [pulley], x0=[stretch], element_names=["cable"])
    run = epp.simulate(loop, t_end=0.1, t_eval=np.array([0.0, 0.1]))
    first = [run.signals[f"cable_output{i}"][0] for i in (1, 2)]
    assert first == pytest.approx(pulley.output(stretch)[0].tolist(), abs=1e-12)


@pytest.mark.parametrize(
    "element", [epp.Play(2.0), epp.JumpAndFollow(1.5, 0.4), epp.JumpAndFollow(0.4, 0.7, slope=2.0)]
)
@pytest.mark.parametrize("start", [-3.0, -0.6, 0.0, 0.3, 0.9, 2.5])
def test_an_element_without_memory_begins_alike_in_continuous_and_discrete_time(element: Any, start: float) -> None:
    """What holds starts from zero, or as near to it as the input lets it, however the time runs."""
    first = []
    for step in (None, 0.1):
        A, B = ([[-1.0]], [[0.0]]) if step is None else ([[0.9]], [[0.0]])
        loop = epp.LureSystem.build(A, B, [[1.0]], [element], x0=[start], time_step=step, element_names=["stored"])
        run = epp.simulate(loop, t_end=1.0, **({"t_eval": np.array([1e-9, 1.0])} if step is None else {}))
        first.append(float(run.signals["stored_output"][0]))
    assert first[0] == pytest.approx(first[1], abs=1e-8)
    at_zero = element.output(start, 0.0)[0]
    assert first[1] == pytest.approx(float(at_zero), abs=1e-12)
