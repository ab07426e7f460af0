"""How much each finding of the paper depends on what the paper leaves open: one parameter at a time, or all at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.stats.qmc import LatinHypercube

import eppanalysis as epp
from eppanalysis.cases import GROUPS
from eppanalysis.sweep import Zipped, sweep

FINDINGS = GROUPS["truth-table"]
FACTORS = (0.5, 0.8, 1.2, 1.5)
SPREADS = (0.2, 0.5)
SAMPLES = 40
#: The paper gives this one for Figure 6 only.
RANGE = "bands.range"
WORDS = {0: "undecided", 1: "settle", 2: "oscillate", 3: "diverge"}
#: Oscillation of the last second above which a run that has not repeated itself oscillates [rad].
OSCILLATES = math.radians(0.1)
#: A run that creeps back to rest through the drive is given more time.
PATIENCE = 30.0


def assumed() -> tuple[str, ...]:
    """Parameters of the elbow that are assumed, and the one that is for some of the findings."""
    parameters = epp.case("elbow").parameters
    names = (name for name, p in parameters.items() if p.mark == "assumed" and name != RANGE)
    return (*names, "lock_pin.backlash", RANGE)


def is_open(finding: str, name: str) -> bool:
    """Whether the parameter is left open for this finding."""
    parameter = epp.case(finding).parameters[name]
    if name == RANGE:
        return parameter.value == epp.case("elbow").parameters[name].value
    return parameter.mark == "assumed"


def varied(case: epp.Case, name: str, factor: float) -> dict[str, float]:
    """Values with one parameter scaled, and with what the paper gives kept as it is.

    The radius is scaled with K R, which was measured, kept; the shell as part of the forearm's inertia; ratios and
    angles stay in their range.
    """
    value = factor * case.value(name)
    if name == "pulley.radius":
        return {name: value, "cable.stiffness": case.value("cable.stiffness") / factor}
    if name == "forearm.shell_inertia":
        return {name: value, "forearm.inertia": case.value("forearm.inertia") + value - case.value(name)}
    limit = {"pulley.kinetic_ratio": 1.0, "pulley.flexion_angle": math.pi}.get(name, math.inf)
    return {name: min(value, limit)}


def outcomes(case: epp.Case, cells: Sequence[dict[str, float]]) -> list[str]:
    """What the runs of a case do with other values: "settle", "oscillate", "undecided"."""
    axes = Zipped({name: [cell[name] for cell in cells] for name in cells[0]})
    found = [WORDS[int(code)] for code in sweep(case, axes, progress=False)["outcome"].values]
    late = [i for i, word in enumerate(found) if word == "undecided"]
    if late and case.t_end < PATIENCE:
        longer = outcomes(case.with_values({"run.t_end": PATIENCE}), [cells[i] for i in late])
        for i, word in zip(late, longer, strict=True):
            found[i] = word
    return found


@cache
def one_at_a_time(finding: str) -> dict[str, tuple[str, ...]]:
    """Outcomes for each parameter that is open, at each factor."""
    case = epp.case(finding)
    return {
        name: tuple(outcomes(case, [varied(case, name, factor) for factor in FACTORS]))
        for name in assumed()
        if is_open(finding, name)
    }


@cache
def all_at_once(finding: str, spread: float) -> tuple[str, ...]:
    """Outcomes of a Latin hypercube of all open parameters, each within its value times 1 - spread to 1 + spread."""
    case = epp.case(finding)
    names = [name for name in assumed() if is_open(finding, name)]
    sample = LatinHypercube(len(names), rng=np.random.default_rng(2005)).random(SAMPLES)
    cells = []
    for row in 1.0 + spread * (2.0 * sample - 1.0):
        cell: dict[str, float] = {}
        for name, factor in zip(names, row, strict=True):
            cell |= varied(case, name, float(factor))
        cells.append(cell)
    return tuple(outcomes(case, cells))


@dataclass(frozen=True)
class Piece:
    """Something that the nominal model leaves out, put in."""

    text: str
    values: dict[str, object]


PIECES = (
    Piece("8-bit converter", {"sensor.bits": 8}),
    Piece("sensor filter of 2 ms", {"sensor.filter": 2e-3}),
    Piece("controller sampled every 1 ms", {"controller.sample_period": 1e-3}),
    Piece("controller sampled every 5 ms", {"controller.sample_period": 5e-3}),
    Piece("parking logic, dwell time 0.5 s", {"parking.dwell_time": 0.5}),
    Piece("step in the other direction", {"harness.step": "-20 mm"}),
)


@cache
def with_piece(finding: str, number: int) -> str:
    """Outcome of a finding's case with a piece put in; a run that never repeats itself exactly may still oscillate."""
    case = epp.case(finding).with_values(PIECES[number].values)
    end = np.linspace(case.t_end - 1.0, case.t_end, 1001)
    run = epp.simulate(case.to_system(), case.input, case.t_end, end)
    if run.status.ok:
        return {"LIMIT_CYCLE": "oscillate", "SETTLED": "settle"}[run.status.name]
    return "oscillate" if np.ptp(run.signals["theta"]) > OSCILLATES else "undecided"
