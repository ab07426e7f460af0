"""Whether a loop can stand still, said of elements that act together: ranges, open ends, and modes that never stay."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import mostly_slow


def axis(sample_time: float | None, motor: epp.Nonlinearity, load: epp.Nonlinearity, set_point: float = 0.0):
    """A motor and a load on a compliant gear, friction on both sides, an encoder under integral action."""
    timed = {} if sample_time is None else {"sample_time": sample_time}
    parts = {
        "pi": epp.blocks.PI(kp=60.0, ti=0.5, **timed),
        "motor": epp.blocks.Motor(
            resistance=2.49, inductance=2.63e-3, torque_constant=0.0458, inertia=7.06e-6, ratio=36.0
        ),
        "load": epp.blocks.Inertia(inertia=0.01, damping=0.01),
        "gear": epp.LockPin(0.02, 500.0, 0.5),
        "on_motor": motor,
        "on_load": load,
        "encoder": epp.Quantiser(0.003, levels=2000),
        "ref": epp.blocks.Constant(value=set_point),
    }
    connect = [
        "ref - encoder -> pi", "pi -> motor.voltage", "motor.angle - load.angle -> gear.twist",
        "motor.speed - load.speed -> gear.rate", "-gear - on_motor -> motor.torque", "motor.speed -> on_motor",
        "gear - on_load -> load", "load.speed -> on_load", "load.angle -> encoder",
    ]  # fmt: skip
    return epp.Diagram(parts=parts, connect=connect).to_system()


KINDS = {
    "friction": epp.Friction,
    "static": lambda level: epp.Friction(level, static=1.5 * level),
    "coulomb": epp.Coulomb,
}


@pytest.mark.parametrize("sample_time", mostly_slow([None, 2e-3], [None]))
@pytest.mark.parametrize(("motor", "load"), list(product(KINDS, KINDS)))
def test_a_servo_that_stands_still_has_a_state_of_rest(sample_time, motor, load):
    """Speeds that may be anything on one side count as what they are in the balance, not as nothing."""
    loop = axis(sample_time, KINDS[motor](0.15), KINDS[load](0.05))
    assert not any("no state of rest" in w for w in epp.predict_limit_cycles(loop).warnings)
    if sample_time:
        assert epp.simulate(loop, t_end=1.0).stands_still


def switching(modes: dict[str, float], guards: list[tuple]) -> epp.AutomatonElement:
    """An element between levels; guards are (mode, target, weight of the input, constant)."""
    build = epp.AutomatonBuilder()
    number = {name: build.mode(name, constant=level) for name, level in modes.items()}
    for k, (mode, target, weight, constant) in enumerate(guards):
        build.guard(f"g{k}", number[mode], number[target], on_input=weight, constant=constant)
    return epp.AutomatonElement(build.build())


def thermostat(element: epp.Nonlinearity, sensor: epp.Nonlinearity) -> epp.LureSystem:
    """A lag driven by an on-off element behind a sensor with steps."""
    parts = {"plant": epp.blocks.TransferFunction(num=[1.0], den=[3.0, 1.0]), "e": element, "sensor": sensor}
    return epp.Diagram(parts=parts, connect=["plant -> sensor", "sensor -> e", "e -> plant"]).to_system()


NEVER = [
    # Each guard of "a" ends it on a side of its own, and the two sides overlap.
    [("a", "b", 1.0, 1.0), ("a", "b", -1.0, 1.0), ("b", "a", 1.0, -2.0)],
    # A guard that does not look at the input and is met.
    [("a", "b", 0.0, 2.0), ("b", "a", 1.0, 2.0), ("b", "a", -1.0, 3.0)],
    [("a", "b", 1.0, 0.5), ("a", "b", -1.0, 0.1), ("b", "a", 1.0, 0.5), ("b", "a", -1.0, 0.1)],
]


@pytest.mark.parametrize("guards", NEVER)
@pytest.mark.parametrize("step", [0.05, 0.3])
def test_modes_in_which_an_element_stays_nowhere_are_none_to_rest_in(guards, step):
    """A range whose ends have passed each other is empty; a search for a balance within it has no answer."""
    loop = thermostat(switching({"a": 0.0, "b": 2.0}, guards), epp.Quantiser(step, levels=100))
    text = str(epp.predict_limit_cycles(loop))
    stays = any(_stays(guards, mode) for mode in "ab")
    assert stays or "no state of rest" in text


def _stays(guards, mode: str) -> bool:
    x = np.linspace(-10.0, 10.0, 4001)
    met = [weight * x + constant > 0.0 for m, _, weight, constant in guards if m == mode]
    return not np.all(np.any(met, axis=0))


def _rings() -> list[epp.LureSystem]:
    """A preload that must give nothing to an integrator, and a relay in front of one: neither can, for each jumps."""
    ring = epp.LureSystem.from_blocks
    wind = epp.AntiWindupPID(1.32, 0.385, 0.313, -1.34, 1.34), epp.AntiWindupPID(1.55, 0.848, 0.228, -2.27, 2.27)
    servo = epp.Preload(0.228, 1.12), ([1.05], [0.484, 1.0]), epp.RateLimitedServo(9.43, 0.55)
    lags, last = (([0.413], [0.955, 1.0]), ([0.315], [0.102, 1.0])), (epp.Tanh(1.35, 0.546), ([0.578], [0.689, 1.0]))
    winding = ([0.355], [1.0, 0.0]), wind[1], ([4.76], [0.102, 1.0, 0.0])
    return [
        ring([epp.Preload(0.114, 1.73), ([0.401], [1.0, 0.0]), *servo, ([0.369], [1.0, 0.0, 0.0]), *last]),
        ring([epp.Saturation(-1.36, 0.512, 1.12), lags[0], wind[0], lags[1], epp.Relay(-0.158, 0.158), *winding]),
    ]


@pytest.mark.parametrize("loop", _rings(), ids=["preload", "relay"])
def test_no_state_of_rest_is_said_whatever_the_coordinates(loop):
    """What cancels in the balance of one element, and what its jump does to its own input, is zero but for rounding."""
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=loop.A.shape))[0]
    plain, turned = (epp.predict_limit_cycles(system).warnings for system in (loop, loop.in_coordinates(Q, Q.T)))
    assert plain == turned and "no state of rest" in plain[0]
