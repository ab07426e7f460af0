"""What the pages on the paper are made of: runs, weight-tray tests, branches of exact cycles; computed once a build."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

import eppanalysis as epp
from eppanalysis.models.devices.elbow.parameters import POUND_FORCE as LBF

Array = NDArray[np.float64]

DEGREE = np.pi / 180.0
FIGURE_6 = ("fig6a_three_steps", "fig6b_three_steps")
FIGURE_8 = ("fig8a_three_steps", "fig8b_three_steps")
#: What the paper removed from the upright elbow, put back.
ORIGINAL_ELBOW: tuple[tuple[str, object], ...] = (("lock_pin.backlash", "2.5 deg"), ("pulley.friction", 0.0526))
#: Weights are put on and taken off one by one; how heavy they were is not said.
TRAY_WEIGHT = 0.1 * LBF


@cache
def run(name: str, *changes: tuple[str, object], t_end: float | None = None) -> epp.Trajectory:
    """Run of a shipped case, with fields changed, sampled every half millisecond."""
    case = epp.case(name).with_values(dict(changes)) if changes else epp.case(name)
    end = t_end or case.t_end
    return epp.simulate(case.to_system(), case.input, end, np.linspace(0.0, end, round(2000 * end) + 1))


def outcome(result: epp.Trajectory) -> str:
    """What a run did, in a word."""
    return {"LIMIT_CYCLE": "oscillates", "SETTLED": "settles"}.get(result.status.name, "undecided")


@dataclass(frozen=True)
class Tray:
    """A weight-tray test: weights, and the sensor's voltage under each, first up and then down."""

    weight: Array
    voltage: Array
    top: int

    @property
    def highest(self) -> float:
        """Voltage under the full load [V]."""
        return float(self.voltage[self.top])

    @property
    def flat(self) -> float:
        """Load that is taken off before the voltage falls [N]."""
        falls = np.flatnonzero(self.voltage[self.top :] < self.highest - 1e-9)
        return float(self.weight[self.top] - self.weight[self.top + falls[0]])


@cache
def tray(friction: float, kinetic_ratio: float, step: float = TRAY_WEIGHT) -> Tray:
    """Weight-tray test of the pulley's own element, the cable folded back by 180 degrees as in Figure 4(d).

    The harness side hangs on a weight, which keeps its tension while the pulley slips: a spring so soft that its
    tension does not change.
    """
    elbow = epp.case("elbow").elbow_parameters
    forearm = elbow.cable.forearm_stiffness
    soft = 1e-9 * forearm
    up = np.arange(1, round(5.0 * LBF / step) + 1) * step
    weights = np.concatenate([[0.0], up, up[-2::-1], [0.0]])
    if friction == 0:  # a ball bearing passes the tension on
        return Tray(weights, elbow.sensor.gain * weights, len(up))
    element = epp.StictionPulley(
        harness_stiffness=soft, forearm_stiffness=forearm, friction=friction, kinetic_ratio=kinetic_ratio
    )
    stretch, volts = 0.0, []
    for weight in weights:
        # Between two weights the pulley stands, so the next one finds it stuck: its memory is the stretch alone.
        forces, memory = element.output(weight / soft + stretch, stretch)
        stretch = float(memory.value)
        volts.append(elbow.sensor.gain * float(forces[0]))
    return Tray(weights, np.array(volts), len(up))


@cache
def branch(name: str, parameter: str, stop: str | float) -> epp.Branch:
    """Exact cycles over a parameter, from its value in the case on."""
    case = epp.case(name)
    return epp.continue_branch(case, parameter, start=case.value(parameter), stop=stop)


def gap_branch() -> epp.Branch:
    """The original elbow with less backlash."""
    return branch("fig8a_original", "lock_pin.backlash", "0.5 deg")


def cable_branch() -> epp.Branch:
    """The original elbow with a softer cable."""
    return branch("fig8a_original", "cable.stiffness", epp.case("soft_cable").value("cable.stiffness"))


def gain_branch() -> epp.Branch:
    """The reduced backlash with a wider range, which is less gain."""
    return branch("gain_brings_it_back", "bands.range", "2.5 lbf")


def friction_branch() -> epp.Branch:
    """The original pulley with less friction."""
    return branch("fig6a_original_pulley", "pulley.friction", 0.002)


def mass_branch() -> epp.Branch:
    """The original elbow with a lighter forearm, down to the empty shell."""
    return branch("fig8a_original", "forearm.inertia", epp.case("elbow").value("forearm.shell_inertia"))


def stable_limit(found: epp.Branch) -> float:
    """Where the stable cycles of a branch end: at its fold, or at the value farthest from its beginning [SI]."""
    if found.folds:
        return found.folds[0].value
    value = found.points["value"][found.points["stable"].astype(bool)]
    return float(value[np.argmax(np.abs(value - found.points["value"][0]))])


@dataclass(frozen=True)
class Slip:
    """One stick and slip of the pulley on a limit cycle, from flexion to extension; times in [s].

    Attributes
    ----------
    sticks, slips, extension : float
        When the pulley sticks, when it slips, and when the sensor force falls below F_low.
    held, behind, jump : float
        Sensor force while it sticks; how far the harness side is below it when it slips; fall at the slip [N].
    """

    sticks: float
    slips: float
    extension: float
    held: float
    behind: float
    jump: float


def slip(case: epp.Case) -> Slip:
    """The first full one after 0.55 s, when the cycle is nearly steady."""
    result = epp.simulate(case.to_system(), case.input, 1.0, np.linspace(0.0, 1.0, 2001))
    _, low, high, _ = case.elbow_parameters.bands.thresholds
    cable = [e for e in result.events if e.element == "cable" and e.time > 0.55]
    i = next(i for i, e in enumerate(cable) if e.name == "sticks" and _at(result, e.time, "sensor_force") > high)
    sticks, slips = cable[i].time, cable[i + 1].time
    close = epp.simulate(case.to_system(), case.input, 1.0, np.array([slips - 1e-9, slips + 1e-9])).signals
    held, after = close["sensor_force"]
    extension = result.t[np.flatnonzero((result.t > slips) & (result.signals["sensor_force"] < low))[0]]
    return Slip(sticks, slips, float(extension), held, held - close["harness_force"][0], held - after)


@cache
def paper_slip() -> Slip:
    """That of the case of Figure 6(a)."""
    return slip(epp.case("fig6a_original_pulley"))


def _at(result: epp.Trajectory, time: float, signal: str) -> float:
    return float(np.interp(time, result.t, result.signals[signal]))


def falls_through_parking(result: epp.Trajectory) -> Array:
    """Times at which the force begins to fall through the parking band, and how long it takes; shape (n, 2) [s]."""
    bands = [e for e in result.events if e.element == "bands"]
    passed = [
        (a.time, b.time - a.time)
        for a, b in zip(bands, bands[1:], strict=False)
        if a.name == "falls through breakpoint 3" and b.name in ("falls through breakpoint 2", "parks")
    ]
    return np.array(passed, float).reshape(-1, 2)
