"""Branches of loops with a dead time behind blocks, against an integrator of their own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp

LAG = epp.blocks.TransferFunction
#: Wires from the thermostat on, blocks that are other ones, and the rates of heater and wall: by themselves, by the
#: thermostat, and else.
OVENS = {
    "two blocks in front": (["thermostat -> heater", "heater -> wall", "wall -> late", "late -> oven"], {}, 0.0, 0.0),
    "a held input on the way": (
        ["thermostat -> heater", "heater + outside -> wall", "wall -> late", "late -> oven"], {}, 0.0, 1.0,
    ),
    "blocks that feed back": (
        ["thermostat - loss -> heater", "heater -> wall", "wall -> loss, late", "late -> oven"],
        {"loss": epp.blocks.Gain(gain=0.05)}, 0.05, 0.0,
    ),
    "the last block itself is late": (
        ["thermostat -> heater", "heater -> wall", "wall -> oven"],
        {"wall": LAG(num=[1.0], den=[10.0, 1.0], delay=5.0)}, 0.0, 0.0,
    ),
    "a block that passes it on at once": (
        ["thermostat -> heater", "heater -> wall", "wall -> gain", "gain -> late", "late -> oven"],
        {"gain": epp.blocks.Gain(gain=1.0)}, 0.0, 0.0,
    ),
}  # fmt: skip


def oven(connect: list[str], changed: dict[str, epp.blocks.Block]) -> epp.Diagram:
    """A thermostat that heats an oven through two blocks and a dead time."""
    parts = {
        "thermostat": epp.HysteresisRelay(lower=-0.4, upper=0.4, low=0.0, high=1.0),
        "heater": LAG(num=[10.0], den=[20.0, 1.0]),
        "wall": LAG(num=[1.0], den=[10.0, 1.0]),
        "late": epp.blocks.DeadTime(delay=5.0),
        "oven": LAG(num=[1.0], den=[60.0, 1.0]),
    }
    if not any("late" in wire for wire in connect):
        del parts["late"]
    connect = ["setpoint - oven -> thermostat", *connect]
    return epp.Diagram(parts=parts | changed, connect=connect, inputs={"setpoint": 5.0, "outside": 1.0})


def own_period(loss: float, outside: float, upper: float) -> float:
    """Period of the oven, asking at each time what the wall was like one dead time before."""
    t, y, on, late = 0.0, np.zeros(3), True, 5.0
    past: list[tuple[float, Callable]] = []
    switches: list[float] = []

    def wall(s: float) -> float:
        return 0.0 if s <= 0.0 else float(next(run(s)[1] for begin, run in reversed(past) if begin <= s))

    def rate(s: float, y: np.ndarray) -> list[float]:
        heat = 10.0 * (on - loss * y[1])
        return [(heat - y[0]) / 20.0, (y[0] + outside - y[1]) / 10.0, (wall(s - late) - y[2]) / 60.0]

    def switch(s: float, y: np.ndarray) -> float:
        return y[2] - (5.4 if on else 5.0 - upper)

    switch.terminal = True
    while len(switches) < 13:
        end = min([t + late, *(s + late for s in switches if s + late > t + 1e-9)])
        switch.direction = 1.0 if on else -1.0
        run = solve_ivp(rate, (t, end), y, "DOP853", rtol=1e-10, atol=1e-12, events=switch, dense_output=True)
        past.append((t, run.sol))
        t, y = float(run.t[-1]), run.y[:, -1]
        if run.status == 1:
            on, switches = not on, [*switches, t]
    return switches[-1] - switches[-3]


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[pytest.mark.slow] * (i > 0)) for i, k in enumerate(OVENS)])
def test_a_dead_time_behind_blocks_is_as_one_right_behind_the_element_that_switches(kind):
    connect, changed, loss, outside = OVENS[kind]
    loop = oven(connect, changed).to_system()
    branch = epp.continue_branch(loop, "thermostat.upper", 0.4, 1.0, n_others=0, max_step=0.2)
    assert branch.status.ok and np.all(branch.points["stable"])
    for k in (0, -1):
        wanted = own_period(loss, outside, branch.points["value"][k])
        assert branch.points["period"][k] == pytest.approx(wanted, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("over", [(8.0, 0.0), (0.0, 8.0)])
def test_a_branch_over_a_dead_time_comes_to_none_from_the_other_end(over):
    """A loop without it has another structure, from which no branch begins."""
    connect, changed, _, _ = OVENS["a held input on the way"]
    branch = epp.continue_branch(oven(connect, changed), "late.delay", *over, n_others=0, max_step=0.2)
    assert branch.status.ok and not branch.special and branch.points["value"].max() == 8.0
    assert branch.points["value"].min() < 8e-6
    least = oven(connect, changed | {"late": epp.blocks.DeadTime(delay=0.0)}).to_system()
    period = epp.find_limit_cycles(least).cycles[0].period
    assert branch.points["period"][np.argmin(branch.points["value"])] == pytest.approx(period, rel=1e-5)
