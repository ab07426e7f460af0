"""Backlash cycling: the forearm moved by hand through the gap, to the backlash and the stiffness of the cable.

The hand takes the forearm from one end of the gap to the other and presses it against the pin there. At the ends

    theta = theta_d ± beta/2 + (T + R F)/k_s,        F = K (x_h - R theta),

T the hand's torque, R F the cable's pull. The means of angle and force over every stay at an end are the data: their
difference between the ends is free of slow drift and of what noise in the angle does to a slope.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.cases import Case
from eppanalysis.errors import ArgumentError, EppError
from eppanalysis.identify.columns import Role
from eppanalysis.identify.estimate import BenchFit, Estimate, Residual, lag_one
from eppanalysis.identify.intervals import Weighted, confounded, rounding, weighted
from eppanalysis.identify.plausible import mistaken
from eppanalysis.identify.strokes import Pulley, sensor_force, strokes
from eppanalysis.models.elements.memory import StictionPulley
from eppanalysis.records.reading import Recording
from eppanalysis.results.provenance import Provenance

#: Fewest stays at the ends, rows in a stay, and parts of a stay where the hand's torque is known.
FEWEST_STAYS, FEWEST_ROWS, PARTS = 5, 5, 6
_STUCK = "the pulley's friction holds the force while the forearm goes through the gap; use a ball bearing."
#: Part of the stretch that must reach the sensor past the pulley's friction.
_LEAST_SLIDING = 0.5
#: 95 % bound of the sum of two rounding errors over the largest of one; drift from stay to stay evens some of it out.
_TWO_ENDS = 1.2
#: Part of the friction's correction that it may be wrong by: turns of the motion are smoothed.
_MODEL_ERROR = 0.05


@dataclass(frozen=True, eq=False)
class _Stays:
    """Means over stays at the ends (or parts of them): which end (+1 flexed), time from -1/2 to 1/2, and columns."""

    side: Array
    time: Array
    angle: Array
    force: Array
    torque: Array | None
    noise: float
    creep: float
    count: int
    starts: IntArray
    ends: IntArray
    pieces: tuple[tuple[int, int], ...]

    def means(self, values: Array) -> Array:
        """Means of a column over the stays (or their parts)."""
        return np.array([values[a:b].mean() for a, b in self.pieces])


def fit_backlash(recording: Recording, case: Case, *, press: float = 0.0) -> BenchFit:
    """Backlash and cable stiffness from backlash cycling.

    Parameters
    ----------
    recording : Recording
        Columns angle (forearm) and force (at the sensor); time and torque (of the hand, flexion positive) where there
        are any. With the torque the pin's stiffness is identified too and its yielding taken out of the backlash.
    case : Case
        For the pulley's radius and friction, and the pin's stiffness.
    press : float
        Largest torque with which the hand may have pressed where no torque was recorded [N*m].

    Raises
    ------
    EppError
        If the forearm does not come to rest at both ends often enough, or the force does not follow the angle.
    """
    if not (math.isfinite(press) and press >= 0):
        raise ArgumentError("press", f" is {press} N*m; expected zero or a positive torque.", "identify")
    radius = case.elbow_parameters.pulley.radius
    stays = _find_stays(recording, radius)
    columns = [np.ones(stays.side.size), stays.time, 0.5 * stays.side]
    names = ["middle of the gap", "drift", "backlash"]
    pin = None
    if stays.torque is not None:
        columns.append(stays.torque + radius * stays.force)
        names.append("pin stiffness")
    held = _held_back(recording, stays, case)
    share = np.ones(stays.side.size) if held is None else held
    angle = _Line.of(np.column_stack(columns), stays.angle, names, recording.source)
    force = _Line.of(np.column_stack(columns[:3]), stays.force / share, names[:3], recording.source)
    if stays.torque is not None:
        pin = _pin(angle)
    backlash = _backlash(angle, force, stays, recording, case, press)
    cable = _cable(_slope(force, stays, recording), held, force, stays, recording, case)
    estimates = [backlash, *cable] + ([pin] if pin else [])
    _check_units(estimates, recording, case)
    return _result(recording, stays, angle, force, tuple(estimates), share, case, press)


def _check_units(estimates: Sequence[Estimate], recording: Recording, case: Case) -> None:
    """Refuse a cable that is softer or stiffer than the case's by the factor between degrees and radians."""
    for found in estimates:
        if found.name != "cable.stiffness" or not (found.identified and found.value > 0):
            continue
        wrong = mistaken("rad", case.value(found.name) / found.value)
        if wrong:
            raise EppError(
                f"{recording.source}: its angle makes the cable {found.text(found.value)}, where the case has "
                f"{case.text(found.name, case.value(found.name))}{wrong}; expected the angle in its own unit."
            )


@dataclass(frozen=True, eq=False)
class _Line:
    """A weighted linear fit."""

    columns: Array
    p: Array
    residual: Array
    noise: Weighted

    @classmethod
    def of(cls, columns: Array, values: Array, names: list[str], source: str) -> _Line:
        lost = confounded(columns, names)
        if lost:
            raise EppError(f"{source}: cannot separate {' and '.join(lost)}; expected stays at both ends in turn.")
        p = np.linalg.lstsq(columns, values, rcond=None)[0]
        noise = weighted(columns, columns @ p - values, 1e-9 * float(np.ptp(values)) + 1e-15)
        p = p + noise.step
        return cls(columns, p, values - columns @ p, noise)

    def half(self, i: int) -> float:
        """95 % half width of a parameter."""
        return float(self.noise.half_widths()[i])


def _find_stays(recording: Recording, radius: float) -> _Stays:
    """Where the forearm rests at either end of its travel: by its angle, or where known by the torque on the pin."""
    angle, source = recording[Role.ANGLE], recording.source
    low, high = np.quantile(angle, [0.02, 0.98])
    span = float(high - low)
    noise = float(np.std(np.diff(angle))) / math.sqrt(2)
    # The median step, 0.954 standard deviations of noise, does not see the few in which the forearm moves.
    steps = np.abs(np.diff(angle))
    noise = min(noise, float(np.median(steps)) / 0.954 + recording.resolution[Role.ANGLE] / math.sqrt(12))
    if not span > 6 * noise:
        raise EppError(
            f"{source}: the angle moves no farther than its noise; expected travel from end to end of the gap."
        )
    upper = angle > 0.5 * (low + high)
    # Noise about the middle is no crossing: it counts once the angle is well on the other side.
    sure = np.where(angle > low + 0.7 * span, 1, np.where(angle < low + 0.3 * span, -1, 0))
    places = np.flatnonzero(sure)
    turns = places[np.flatnonzero(np.diff(sure[places])) + 1] if places.size else places
    edges = [int(places[0]) if places.size else 0, *turns.tolist(), angle.size]
    reach = max(4 * noise, 0.5 * recording.resolution[Role.ANGLE])
    pressed = None if Role.TORQUE not in recording else _pressed(recording, sure, radius)
    found = []
    for first, last in zip(edges, edges[1:], strict=False):
        if pressed is None:
            stay = _stay(angle, first, last, reach, bool(upper[first]))
        else:
            stay = _middle(np.flatnonzero(pressed[first:last]), first)
        if stay is not None:
            found.append(stay)
    sides = np.array([1.0 if upper[(a + b) // 2] else -1.0 for a, b in found])
    if len(found) < FEWEST_STAYS or min(int(np.sum(sides > 0)), int(np.sum(sides < 0))) < 2:
        raise EppError(
            f"{source}: the forearm rests {len(found)} times at an end of its travel; expected {FEWEST_STAYS} or more "
            "stays, at both ends, so that backlash and drift can be separated."
        )
    return _means(recording, found, sides, noise)


def _stay(angle: Array, first: int, last: int, reach: float, upper: bool) -> tuple[int, int] | None:
    """The middle part of the rest within an excursion to one side; None if it does not rest."""
    part = angle[first:last]
    outer = part >= np.median(part) if upper else part <= np.median(part)
    level = float(np.median(part[outer]))
    for _ in range(8):
        near = np.abs(part - level) <= reach
        if not near.any():
            return None
        level = float(np.mean(part[near]))
    return _middle(np.flatnonzero(near), first)


def _pressed(recording: Recording, sure: IntArray, radius: float) -> BoolArray:
    """Rows in which the forearm surely presses against the pin on the side that it is on."""
    net = recording[Role.TORQUE] + radius * recording[Role.FORCE]
    return net * sure > 0.2 * float(np.quantile(np.abs(net), 0.9))


def _middle(places: IntArray, first: int) -> tuple[int, int] | None:
    """Three fifths in the middle of a run of rows; None if too few are left."""
    if not places.size:
        return None
    begin, end = int(places[0]), int(places[-1]) + 1
    trim = (end - begin) // 5
    begin, end = begin + trim, end - trim
    return (first + begin, first + end) if end - begin >= FEWEST_ROWS else None


def _means(recording: Recording, found: list[tuple[int, int]], sides: Array, noise: float) -> _Stays:
    torque = recording.columns.get(Role.TORQUE)
    creep = [_creep(recording[Role.ANGLE][a:b]) for a, b in found]
    pieces, side = [], []
    for (a, b), s in zip(found, sides, strict=True):
        # Within a stay the hand's torque varies, which tells how the pin yields: each of its parts counts by itself.
        parts = 1 if torque is None else max(1, min(PARTS, (b - a) // FEWEST_ROWS))
        cuts = np.linspace(a, b, parts + 1).astype(int)
        pieces += list(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True))
        side += [s] * parts
    time = recording[Role.TIME]
    span = float(np.ptp(time)) or 1.0

    def mean(values: Array) -> Array:
        return np.array([values[a:b].mean() for a, b in pieces])

    return _Stays(
        side=np.array(side),
        time=(mean(time) - float(time.mean())) / span,
        angle=mean(recording[Role.ANGLE]),
        force=mean(recording[Role.FORCE]),
        torque=None if torque is None else mean(torque),
        noise=noise,
        creep=abs(float(np.mean(np.array(creep) * sides))),
        count=len(found),
        starts=np.array([a for a, _ in found]),
        ends=np.array([b for _, b in found]),
        pieces=tuple(pieces),
    )


def _creep(part: Array) -> float:
    """How much farther out the middle third of a stay lies than its outer thirds; noise where the forearm rests."""
    thirds = np.array_split(part, 3)
    return float(thirds[1].mean() - 0.5 * (thirds[0].mean() + thirds[2].mean()))


def _pulley(case: Case) -> Pulley | None:
    """Sensor force over ``K s`` of the case's pulley; None for a ball bearing."""
    pulley, cable = case.elbow_parameters.pulley, case.elbow_parameters.cable
    if pulley.friction == 0:
        return None
    static, ratio = pulley.load_friction, pulley.kinetic_ratio
    element = StictionPulley(cable.harness_stiffness, cable.forearm_stiffness, static, ratio)
    even = element.share(0.0)
    return Pulley(*(element.share(r) / even for r in (ratio * static, -ratio * static, static, -static)))


def _held_back(recording: Recording, stays: _Stays, case: Case) -> Array | None:
    """Sensor force over ``K s`` at every stay: what the pulley's friction holds back there, over the whole motion.

    The stretch s follows from the angle once force and angle are related without friction; that relation and the
    friction's share are found in turn. None where the pulley hardly slides within the gap, so that the force does not
    identify the stretch.
    """
    pulley = _pulley(case)
    share = np.ones(stays.side.size)
    if pulley is None:
        return share
    width = max(1, int(0.2 * float(np.mean(stays.ends - stays.starts))))
    angle = uniform_filter1d(recording[Role.ANGLE], width, mode="nearest")
    for _ in range(6):
        force = stays.force / share
        slope = -_contrast(force, stays.side) / _contrast(stays.angle, stays.side)
        if not slope > 0:
            return None
        stretch = float(np.mean(force / slope + stays.angle)) - angle
        if stretch.min() <= 0:
            return None
        pieces = strokes(stretch, max(0.02 * float(np.ptp(stretch)), 4 * stays.noise / math.sqrt(width)))
        behind = sensor_force(stretch, pieces, pulley)
        if not _contrast(stays.means(behind), stays.side) < _LEAST_SLIDING * _contrast(
            stays.means(stretch), stays.side
        ):
            return None
        share = stays.means(behind) / stays.means(stretch)
    return share


def _pin(angle: _Line) -> Estimate:
    """Stiffness of the pin, the inverse of how the angle yields to torque."""
    give, half = float(angle.p[3]), angle.half(3)
    if give - half <= 0:
        low = 1.0 / (give + half) if give + half > 0 else 0.0
        why = "the hand's torque changes too little at the ends to see the pin yield."
        value = 1.0 / give if give > 0 else low
        return Estimate("lock_pin.stiffness", value, low, math.inf, "N*m/rad", identified=False, note=why)
    return Estimate("lock_pin.stiffness", 1.0 / give, 1.0 / (give + half), 1.0 / (give - half), "N*m/rad")


def _backlash(angle: _Line, force: _Line, stays: _Stays, recording: Recording, case: Case, press: float) -> Estimate:
    stiffness = case.elbow_parameters.lock_pin.stiffness
    radius = case.elbow_parameters.pulley.radius
    value, half = float(angle.p[2]), angle.half(2)
    rounded = _TWO_ENDS * rounding(recording.resolution[Role.ANGLE], stays.noise)
    half = math.hypot(half, rounded) + 2.0 * (stays.creep if stays.creep > 0.5 * stays.noise else 0.0)
    note = "the pin's yielding under the hand taken out"
    below = 0.0
    if stays.torque is None:
        # The cable pulls less at the flexed end; its difference closes the travel a little.
        value -= radius * float(force.p[2]) / stiffness
        below = 2.0 * press / stiffness
        note = (
            f"travel between the ends, the hand pressing with up to {press:g} N*m"
            if press
            else "travel between the ends"
        )
    value, low, high = value - below / 2, value - below - half, value + half
    return Estimate("lock_pin.backlash", value, max(low, 0.0), high, "rad", "deg", note=note)


def _slope(force: _Line, stays: _Stays, recording: Recording) -> tuple[float, float]:
    """K R as the ratio of the contrasts between the ends [N/rad], and its relative 95 % half width."""
    travel = _travel(stays)
    change = force.p[2]
    if change + force.half(2) >= 0 and abs(change) > force.half(2):
        raise EppError(
            f"{recording.source}: the force does not fall as the forearm flexes; expected a cable that is taut "
            "and fixed at the harness."
        )
    resolution = 1.55 * rounding(
        recording.resolution[Role.FORCE], float(np.std(np.diff(recording[Role.FORCE]))) / math.sqrt(2)
    )
    turned = 1.55 * rounding(recording.resolution[Role.ANGLE], stays.noise)
    parts = (math.hypot(force.half(2), resolution) / change, math.hypot(travel.half(2), turned) / travel.p[2])
    return float(-change / travel.p[2]), math.hypot(*parts)


def _travel(stays: _Stays) -> _Line:
    """The angle's own contrast between the ends, whatever the torque."""
    columns = np.column_stack([np.ones(stays.side.size), stays.time, 0.5 * stays.side])
    return _Line.of(columns, stays.angle, ["middle", "drift", "travel"], "")


def _cable(
    slope: tuple[float, float], held: Array | None, force: _Line, stays: _Stays, recording: Recording, case: Case
) -> list[Estimate]:
    value, share = slope
    radius = case.elbow_parameters.pulley.radius
    share = math.hypot(share, _friction_share(recording, stays, held, case)) if held is not None else 0.0
    slides = held is not None
    ends = (value * (1 - share), value * (1 + share)) if slides else (value, math.inf)
    note = f"K R over pulley.radius = {case.text('pulley.radius', radius)}" if slides else _STUCK
    change, half = -float(force.p[2]), force.half(2)
    return [
        Estimate("cable.stiffness", value / radius, ends[0] / radius, ends[1] / radius, "N/m", "", slides, note),
        Estimate("K R", value, *ends, "N/rad", "lbf/deg", slides, "" if slides else _STUCK),
        Estimate("force change over the travel", change, change - half, change + half, "N", "lbf"),
    ]


def _friction_share(recording: Recording, stays: _Stays, held: Array, case: Case) -> float:
    """What the pulley's friction adds to the relative half width of K R: its tolerance, and how well it is modelled."""
    plain, corrected = (_contrast(stays.force / share, stays.side) for share in (np.ones(held.size), held))
    model = _MODEL_ERROR * abs(corrected / plain - 1.0)
    known = case.parameters.get("pulley.friction")
    if known is None or not known.tolerance or not known.value:
        return model
    other = _held_back(recording, stays, case.with_values({"pulley.friction": float(known.value) + known.tolerance}))
    if other is None:
        return 1.0
    return math.hypot(model, _contrast(stays.force / other, stays.side) / corrected - 1.0)


def _contrast(values: Array, side: Array) -> float:
    return float(values[side > 0].mean() - values[side < 0].mean())


def _result(
    recording: Recording,
    stays: _Stays,
    angle: _Line,
    force: _Line,
    estimates: tuple[Estimate, ...],
    share: Array,
    case: Case,
    press: float,
) -> BenchFit:
    notes = recording.sentences()
    notes.append(f"{stays.count} stays at the ends of the travel.")
    if stays.torque is None:
        notes.append("The hand's torque is not recorded: where it yields, the pin adds to the backlash (see press).")
    if case.elbow_parameters.pulley.friction:
        notes.append(
            f"Forces corrected for pulley.friction = {case.text('pulley.friction', case.value('pulley.friction'))}."
        )
    if stays.creep > 0.5 * stays.noise:
        notes.append("The forearm keeps moving at the ends; the interval of the backlash is wider for it.")
    residuals = {
        "angle": Residual(float(np.std(angle.residual)), lag_one(angle.residual), float(angle.p[1]), "rad"),
        "force": Residual(float(np.std(force.residual)), lag_one(force.residual), float(force.p[1]), "N"),
    }
    return BenchFit(
        "backlash cycling", recording.source, estimates, residuals, tuple(notes), recording.n_rows, stays.side.size,
        curves=_curves(recording, stays, angle, force, share),
        provenance=Provenance("backlash cycling", {"press": press, "rows": recording.n_rows}),
    )  # fmt: skip


def _curves(recording: Recording, stays: _Stays, angle: _Line, force: _Line, share: Array) -> dict[str, Any]:
    """Angle and force at every stay with the fit, over time; the whole record thin behind them."""
    time = recording[Role.TIME]
    span = float(np.ptp(time)) or 1.0
    at = stays.time * span + float(time.mean())
    unit = "s" if recording.timed else ""
    left = force.residual * share
    return {
        "panels": {
            "angle": {"x": at, "y": stays.angle, "fit": stays.angle - angle.residual, "residual": angle.residual,
                      "units": (unit, "rad"), "behind": (time, recording[Role.ANGLE])},
            "force": {"x": at, "y": stays.force, "fit": stays.force - left, "residual": left,
                      "units": (unit, "N"), "behind": (time, recording[Role.FORCE])},
        },
        "x": "time" if recording.timed else "row",
    }  # fmt: skip
