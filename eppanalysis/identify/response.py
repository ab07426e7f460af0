"""The elbow's simulated step response as a function of parameters, at the times of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eppanalysis.cases import Case
from eppanalysis.errors import EppError
from eppanalysis.identify.columns import Role
from eppanalysis.identify.intervals import rounding
from eppanalysis.identify.reading import Recording
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.models.devices.elbow.loop import elbow
from eppanalysis.models.devices.elbow.parameters import ElbowParameters, declared
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import InputSignal, Recorded, input_signals_by_name

Array = NDArray[np.float64]

#: Signal of the model behind a column.
SIGNALS = {Role.ANGLE: "theta", Role.FORCE: "sensor_force"}
#: A shorter dead time than this makes no difference, but stiff equations [s].
SHORTEST_DELAY = 2e-5
#: Longest span of averaged rows that leaves the motion as it is [s]; most switches of a run.
LONGEST_BLOCK, MOST_EVENTS = 2e-3, 50_000
#: Rows on end at the same extreme reading that make a saturation.
_SATURATED_ROWS = 5


@dataclass(frozen=True)
class Unknown:
    """A parameter that is fitted, on a scale on which its range is even.

    Attributes
    ----------
    name : str
    start : float
        Value in the case (SI).
    logarithmic : bool
        Positive parameters are fitted by their logarithm, others (which may vanish) by their multiple of `scale`.
    scale : float
    prior : float or None
        Where the case gives a tolerance: standard deviation on the fitted scale.
    """

    name: str
    start: float
    logarithmic: bool
    scale: float
    prior: float | None

    @classmethod
    def of(cls, case: Case, name: str) -> Unknown:
        """The parameter of a case.

        Raises
        ------
        CaseError
            If there is no such parameter, or it has no value.
        """
        value = case.value(name)
        about = declared(name)
        # A lag adds to the delay, so it is even on its own scale; a stiffness or an inertia on that of ratios.
        logarithmic = about.above is not None and value > 0 and about.unit != "s"
        scale = 1.0 if logarithmic else abs(value) or _TYPICAL.get(name, 1.0)
        known = case.parameters.get(name)
        tolerance = None if known is None or not known.tolerance else known.tolerance
        spread = None if tolerance is None else tolerance / 1.96 / (value if logarithmic else scale)
        return cls(name, value, logarithmic, scale, spread)

    @property
    def lag(self) -> float:
        """1 for a time constant that may be short but not vanish, 0 for what may."""
        about = declared(self.name)
        return float(about.above is not None)

    def to_scale(self, value: float) -> float:
        """Place of a value on the fitted scale."""
        return float(np.log(value)) if self.logarithmic else value / self.scale

    def value(self, q: float) -> float:
        """Value at a place on the fitted scale."""
        return float(np.exp(q)) if self.logarithmic else q * self.scale


#: What a parameter that vanishes in the case is measured in.
_TYPICAL = {"controller.delay": 1e-3, "drive.coulomb_friction": 0.3, "lock_pin.backlash": 0.01, "pulley.friction": 0.05}


@dataclass(frozen=True, eq=False)
class Channel:
    """A measured column with its nuisances: zero and drift.

    Attributes
    ----------
    role : Role
    data : array, shape (n,)
    nuisance : array, shape (n, 2)
        Zero and drift.
    noise : float
        Standard deviation of what no model explains, from differences of neighbours.
    live : bool array, shape (n,)
        Rows in which the column does not saturate; only these count.
    """

    role: Role
    data: Array
    nuisance: Array
    noise: float
    live: NDArray[np.bool_]

    def first(self, n: int) -> Channel:
        """The first rows."""
        return replace(self, data=self.data[:n], nuisance=self.nuisance[:n], live=self.live[:n])

    def residual(self, model: Array) -> Array:
        """Model less data without zero and drift, in units of the noise."""
        r = ((model - self.data) / self.noise)[self.live]
        n = np.linalg.qr(self.nuisance[self.live])[0]
        return r - n @ (n.T @ r)


class Response:
    """Simulates candidates and compares them with a recording."""

    def __init__(self, recording: Recording, case: Case, unknowns: Sequence[Unknown]) -> None:
        self.case, self.unknowns = case, tuple(unknowns)
        self.base: ElbowParameters = case.elbow_parameters
        time = recording[Role.TIME]
        self.input_signal, self.time = _input_signal(recording, case)
        if recording.block > 1 and float(np.ptp(time)) / len(time) > LONGEST_BLOCK:
            raise EppError(
                f"{recording.source}: {recording.n_rows} rows over {np.ptp(time):.4g} s are averaged too "
                "coarsely to show the motion; expected the seconds after one step."
            )
        if self.time[-1] <= 0:
            raise EppError(f"{recording.source}: ends at {time[-1]:.4g} s; expected times after the step at 0 s.")
        self.channels = [_channel(recording, role, self.time) for role in SIGNALS if role in recording]
        self.runs = 0

    def replace(self, place: int, unknown: Unknown) -> None:
        """Take another belief about a parameter."""
        self.unknowns = (*self.unknowns[:place], unknown, *self.unknowns[place + 1 :])

    def parameters(self, q: Array) -> ElbowParameters:
        """Parameters of the model at a place on the fitted scale."""
        sections: dict[str, dict[str, float]] = {}
        for unknown, place in zip(self.unknowns, q.tolist(), strict=True):
            section, _, name = unknown.name.partition(".")
            value = unknown.value(place)
            if unknown.name == "controller.delay" and value < SHORTEST_DELAY:
                value = 0.0
            sections.setdefault(section, {})[name] = value
        changed = {section: replace(getattr(self.base, section), **values) for section, values in sections.items()}
        return replace(self.base, **changed)

    def signals(self, q: Array, until: float = np.inf) -> dict[str, Array]:
        """Signals of the channels at the times up to `until`, before the step at rest.

        Raises
        ------
        EppError
            If the candidate has no solution.
        """
        self.runs += 1
        system = elbow(self.parameters(q))
        hybrid = HybridSystem.from_lure(system, {"harness_position": self.input_signal})
        times = self.time[self.time <= until]
        after = times[times >= 0]
        run = run_hybrid(hybrid, float(after[-1]) * (1 + 1e-12), after, 2.0 * hybrid.time_scale, MOST_EVENTS, 1)
        done = int(run.stats[2])
        out: dict[str, Array] = {}
        for channel in self.channels:
            place = system.signals.names.index(SIGNALS[channel.role])
            values = np.empty(times.size)
            values[: times.size - after.size] = 0.0 if channel.role == Role.ANGLE else self.base.bands.parking_centre
            values[times.size - after.size :] = run.samples[:, place]
            # A run that stops early stands still from there on, and fits no more.
            values[times.size - after.size + done :] = run.samples[max(done - 1, 0), place]
            out[channel.role] = values
        return out

    def residual(self, q: Array, until: float = np.inf) -> Array:
        """All channels in units of their noise, then what the case says of the parameters."""
        try:
            found = self.signals(q, until)
            parts = [c.residual(found[c.role]) for c in self._cut(until)]
        except (EppError, ArithmeticError, ValueError):
            # A candidate without a solution is far off, and does not end the fit.
            parts = [np.full(int(c.live.sum()), 1e3) for c in self._cut(until)]
        return np.concatenate([*parts, self.beliefs(q)])

    def beliefs(self, q: Array) -> Array:
        """Distance from the case's own values in units of their tolerances."""
        return np.array([
            (place - u.to_scale(u.start)) / u.prior
            for u, place in zip(self.unknowns, q.tolist(), strict=True)
            if u.prior is not None
        ])  # fmt: skip

    def _cut(self, until: float) -> list[Channel]:
        """The channels' first rows."""
        n = int(np.searchsorted(self.time, until, side="right"))
        return [c.first(n) for c in self.channels]


def _input_signal(recording: Recording, case: Case) -> tuple[InputSignal, Array]:
    """What the harness does, and the times of the record on its clock."""
    time = recording[Role.TIME]
    if Role.HARNESS not in recording:
        input_signal = input_signals_by_name(case.to_system().input_names, case.input).get("harness_position")
        if input_signal is None:
            raise EppError(f"{recording.source}: the case {case.name!r} has no input; expected a step of the harness.")
        return input_signal, time
    harness = recording[Role.HARNESS]
    return Recorded(time - time[0], harness - harness[0]), time - time[0]


def _channel(recording: Recording, role: Role, time: Array) -> Channel:
    data = recording[role]
    steps = np.diff(data, 2) / np.sqrt(6.0)
    # Most second differences are noise; the few at switches are not.
    noise = float(np.median(np.abs(steps))) / 0.6745
    step = recording.resolution[role]
    # What is rounded scatters by its step over the root of twelve, seen or not.
    noise = max(noise, step / np.sqrt(12.0), rounding(step, noise) / np.sqrt(3.0), 1e-12)
    span = float(np.ptp(time))
    columns = np.column_stack([np.ones(time.size), (time - time.mean()) / span])
    live = _unsaturated(data, step) if role == Role.FORCE else np.ones(data.size, bool)
    return Channel(role, data, columns, noise, live)


def _unsaturated(data: Array, step: float) -> NDArray[np.bool_]:
    """Rows that are not at a greatest or least reading at which the column stays for several rows on end."""
    span = float(np.ptp(data))
    live = np.ones(data.size, bool)
    for sign in (-1.0, 1.0):
        top = float(np.max(sign * data))
        at: NDArray[np.bool_] = sign * data >= top - 1e-9 * span
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]]))))[::2]
        near = int(np.sum(sign * data > top - 4 * max(step, 1e-3 * span))) - int(np.sum(at))
        if runs.max() >= _SATURATED_ROWS and near < 0.5 * np.sum(at):
            # The neighbours of a saturated row may be cut by noise.
            live &= ~np.convolve(at, np.ones(5), "same").astype(bool)
    return live
