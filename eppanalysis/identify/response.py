"""A case's simulated response as a function of parameters, at the times of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.cases import Case
from eppanalysis.cases.variation import takes
from eppanalysis.errors import CaseError, EppError
from eppanalysis.identify.columns import ELBOW, Layout, Role
from eppanalysis.identify.intervals import rounding
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.models.devices.elbow.loop import elbow
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import InputSignal, Recorded, Sine, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.clocked import Clocked
from eppanalysis.models.systems.sampled.strobe import Strobe
from eppanalysis.records.reading import Recording

#: A shorter dead time than this makes no difference, but stiff equations [s].
SHORTEST_DELAY = 2e-5
#: Longest span of averaged rows that leaves the motion as it is [s]; most switches of a run.
LONGEST_BLOCK, MOST_EVENTS = 2e-3, 50_000
#: Share of a sample time within which a row is at a sample.
_AT_SAMPLE = 1e-6
#: Rows on end at the same extreme reading that make a saturation.
_SATURATED_ROWS = 5
#: Share of the fastest time constant in which a loop at its start is seen before anything moves; largest signal.
_INSTANT, _LARGEST = 1e-9, 1e100
#: Residual over noise of a good fit; scatter of neighbours, over the noise, of a motion that may hide it and of a
#: residual without jumps.
_GOOD_FIT, _HIDING, _NO_JUMP = 1.7, 0.5, 1.2
#: Cases about the given one that show what a response looks like.
_CANDIDATES = 8


def layout_of(case: Case) -> Layout:
    """What columns a recorded response of a case may have: those of an elbow's bench, else its signals and inputs."""
    if case.kind == "elbow":
        return ELBOW
    system = case.to_system()
    signals = {name: name for name in system.signals.names if name not in system.input_names}
    units = {**dict.fromkeys(system.input_names, ""), **case.input_units, **system.signals.units_by_name()}
    return Layout(signals, {name: name for name in system.input_names}, units)


@dataclass(frozen=True)
class Unknown:
    """A parameter that is fitted, on a scale on which its range is even."""

    name: str
    start: float  # value in the case (SI)
    #: Parameters that must be positive are fitted by their logarithm, others by their multiple of `scale`.
    logarithmic: bool
    vanishes: bool  # whether it may be zero
    scale: float  # negative for what is negative in the case: no fit changes a sign
    prior: float | None  # where the case gives a tolerance: standard deviation on the fitted scale

    @classmethod
    def of(cls, case: Case, name: str) -> Unknown:
        """The parameter of a case.

        Raises
        ------
        CaseError
            If there is no such parameter, it has no value, or it cannot vary a little.
        """
        value = case.value(name)
        scale = value or _TYPICAL.get(name, 0.0)
        known = case.parameters.get(name)
        counted = known is not None and isinstance(known.value, bool)
        if not scale or counted or not any(takes(case, name, r * scale) for r in (0.99, 1.01)):
            raise CaseError(case.source, name, value, "a quantity that is not zero and may vary a little, to fit it")
        vanishes = takes(case, name, 0.0)
        # A lag adds to the delay, so it is even on its own scale; a stiffness or an inertia on that of ratios.
        logarithmic = not vanishes and value > 0 and case.unit(name)[0] != "s"
        scale = 1.0 if logarithmic else scale
        tolerance = None if known is None or not known.tolerance else known.tolerance
        spread = None if tolerance is None else tolerance / 1.96 / abs(value if logarithmic else scale)
        return cls(name, value, logarithmic, vanishes, scale, spread)

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
    """A measured column with its nuisances: zero and drift."""

    role: str
    data: Array  # (n,)
    nuisance: Array  # (n, 2): zero and drift
    noise: float  # standard deviation of what no model explains, at most: from differences of neighbours
    live: BoolArray  # (n,): rows in which the column does not saturate; only these count
    unit: str = ""  # SI unit
    step: float = 0.0  # least step between readings

    def quieter(self, model: Array) -> Channel:
        """The same where neighbours of what a model leaves differ by less than those of the record."""
        left = self.data[: model.size] - model
        return replace(self, noise=min(self.noise, _noise_of(left, self.step))) if left.size > 2 else self

    def jumps(self, model: Array) -> bool:
        """Whether a motion differs from row to row as much as its noise, as that of a controller that hunts."""
        return _noise_of(model, 0.0) > _HIDING * self.noise

    def noise_alone(self, model: Array) -> bool:
        """Whether a model leaves hardly more than noise; of a motion that jumps, no jump either."""
        counts = self.live[2:] & self.live[1:-1] & self.live[:-2]
        apart = np.diff(self.data - model, 2)[counts] / np.sqrt(6.0)
        jump = float(np.sqrt(np.mean(apart**2))) if self.jumps(model) else 0.0
        return self.misfit(model) < _GOOD_FIT and jump < _NO_JUMP * self.noise

    def misfit(self, model: Array) -> float:
        """Residual over noise."""
        return float(np.std(self.residual(model)))

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
        self.case, self.unknowns, self.layout = case, tuple(unknowns), layout_of(case)
        time = recording[Role.TIME]
        self.inputs, self.time = _input_signals(recording, case, self.layout)
        self.begin = float(time[0] - self.time[0])  # of the run, on the record's clock [s]
        longest = max(LONGEST_BLOCK, HybridSystem.from_lure(self._as_run(case.to_system())).time_scale)
        if recording.block > 1 and float(np.ptp(time)) / len(time) > longest:
            raise EppError(
                f"{recording.source}: {recording.n_rows} rows over {np.ptp(time):.4g} s are averaged too "
                "coarsely to show the motion; expected the seconds after one step."
            )
        if self.time[-1] <= 0:
            raise EppError(f"{recording.source}: ends at {time[-1]:.4g} s; expected times after the step at 0 s.")
        layout = self.layout
        self.channels = [_channel(recording, role, self.time, layout) for role in layout.signals if role in recording]
        self.runs = 0

    def replace(self, place: int, unknown: Unknown) -> None:
        """Take another belief about a parameter."""
        self.unknowns = (*self.unknowns[:place], unknown, *self.unknowns[place + 1 :])

    def system(self, q: Array) -> LureSystem:
        """The loop at a place on the fitted scale."""
        values = {u.name: u.value(place) for u, place in zip(self.unknowns, q.tolist(), strict=True)}
        if self.case.kind != "elbow":
            return self.case.with_values(values).to_system()
        # The same without reading the case again, for the fields that its file may hold beside others.
        base, sections = self.case.elbow_parameters, dict[str, dict[str, float]]()
        for name, value in values.items():
            section, _, field = name.partition(".")
            short = name == "controller.delay" and value < SHORTEST_DELAY
            sections.setdefault(section, {})[field] = 0.0 if short else value
        return elbow(replace(base, **{key: replace(getattr(base, key), **some) for key, some in sections.items()}))

    def signals(self, q: Array, until: float = np.inf) -> dict[str, Array]:
        """Signals of the channels at the times up to `until`, before 0 s at the loop's start.

        Raises
        ------
        EppError
            If the candidate has no solution.
        """
        self.runs += 1
        system = self.system(q)
        times = self.time[self.time <= until]
        after = times[times >= 0]
        as_run = self._as_run(system)
        driven = HybridSystem.from_lure(as_run, self.inputs)
        run = _run(driven, after)
        done = int(run.stats[2])
        start = np.zeros((1, run.samples.shape[1]))
        if after.size < times.size:
            start = _run(self._undriven(as_run, driven), np.zeros(1)).samples
        out: dict[str, Array] = {}
        for channel in self.channels:
            place = system.signals.names.index(self.layout.signals[channel.role])
            values = np.empty(times.size)
            values[: times.size - after.size] = start[0, place]
            values[times.size - after.size :] = run.samples[:, place]
            # A run that stops early is constant from there on, and no longer fits.
            values[times.size - after.size + done :] = run.samples[max(done - 1, 0), place]
            if not np.all(np.abs(values) < _LARGEST):
                raise EppError(f"{system.name}: {channel.role} grows beyond all range with these parameters.")
            out[channel.role] = values
        return out

    def _as_run(self, system: LureSystem) -> LureSystem:
        """The loop as it is run: in discrete time round a sampled controller, which holds its signals between rows."""
        if not system.time_step:
            return system
        first = [self.inputs[n].value(np.zeros(1))[0] if n in self.inputs else 0.0 for n in system.input_names]
        return Clocked.of(system, system.v0 + np.array(first, float)).system

    def _undriven(self, system: LureSystem, driven: HybridSystem) -> HybridSystem:
        """The loop before its inputs act; one that is driven by a sine has its oscillator in it."""
        if any(isinstance(given, Sine) for given in self.inputs.values()):
            return HybridSystem.from_lure(system)
        return driven.held.begun(system.x0, system.memory)

    def candidates(self, places: Iterable[Array]) -> list[dict[str, Array]]:
        """Signals of the first few of the places that have a solution; the first one must.

        Raises
        ------
        EppError
            If the first one has none, or hardly any has.
        """
        first, *others = places
        found = [self.signals(first)]
        for q in others:
            with suppress(EppError):
                found.append(self.signals(q))
            if len(found) == _CANDIDATES:
                return found
        raise EppError(
            f"{self.case.source}: hardly any case near it has a solution; expected other values to begin with."
        )

    def read_noise(self, q: Array, until: float = np.inf) -> None:
        """Take the noise from what a place leaves of the record, where that shows less of it.

        Whatever is taken off the record, neighbours differ by the noise at least: a signal that jumps from sample to
        sample hides it until the jumps are taken off.
        """
        found = self.signals(q, until)
        self.channels = [c.quieter(found[c.role]) for c in self.channels]

    def noise_alone(self, q: Array) -> bool:
        """Whether a place leaves hardly more than noise."""
        found = self.signals(q)
        return all(c.noise_alone(found[c.role]) for c in self.channels)

    def jumps(self, q: Array) -> bool:
        """Whether a signal differs from row to row as much as its noise, so that the record does not show that."""
        found = self.signals(q)
        return any(c.jumps(found[c.role]) for c in self.channels)

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


def _run(hybrid: HybridSystem, times: Array) -> Run:
    """The loop's signals at times; at a sample, behind it, as a controller writes down what it has just computed."""
    strobe = Strobe.of(hybrid)
    for controller in () if strobe is None else strobe.controllers:
        T = controller.sample_time
        sample = T * np.round(times / T)
        times = np.where(np.abs(times - sample) < _AT_SAMPLE * T, sample + _AT_SAMPLE * T, times)
    end = float(times[-1]) * (1 + 1e-12) or _INSTANT * hybrid.time_scale
    samples = 0 if strobe is None else strobe.samples_in(end)
    return run_hybrid(hybrid, end, times, 2.0 * hybrid.time_scale, MOST_EVENTS + samples, 1)


def _input_signals(recording: Recording, case: Case, layout: Layout) -> tuple[Mapping[str, InputSignal], Array]:
    """What the external inputs do, and the times of the record on their clock."""
    time, system = recording[Role.TIME], case.to_system()
    given = input_signals_by_name(system.input_names, case.input)
    recorded = [role for role in layout.inputs if role in recording]
    if not recorded:
        if layout is ELBOW and not given:
            raise EppError(f"{recording.source}: the case {case.name!r} has no input; expected a step of the harness.")
        return given, time
    for role in recorded:
        place = system.input_names.index(layout.inputs[role])
        before = recording[role][0] if layout.from_first else system.v0[place]
        given[layout.inputs[role]] = Recorded(time - time[0], recording[role] - before)
    return given, time - time[0]


def _channel(recording: Recording, role: str, time: Array, layout: Layout) -> Channel:
    data = recording[role]
    step = recording.resolution[role]
    noise = _noise_of(data, step)
    span = float(np.ptp(time))
    columns = np.column_stack([np.ones(time.size), (time - time.mean()) / span])
    live = _unsaturated(data, step) if role in layout.clipped else np.ones(data.size, bool)
    return Channel(role, data, columns, noise, live, layout.units[role], step)


def _noise_of(data: Array, step: float) -> float:
    """Standard deviation of noise on a motion, by its second differences."""
    # Most second differences are noise; the few at switches are not.
    noise = float(np.median(np.abs(np.diff(data, 2)))) / np.sqrt(6.0) / 0.6745
    # What is rounded scatters by its step over the root of twelve, seen or not.
    return float(max(noise, step / np.sqrt(12.0), rounding(step, noise) / np.sqrt(3.0), 1e-12))


def _unsaturated(data: Array, step: float) -> BoolArray:
    """Rows that are not at a greatest or least reading at which the column stays for several rows on end."""
    span = float(np.ptp(data))
    live = np.ones(data.size, bool)
    for sign in (-1.0, 1.0):
        top = float(np.max(sign * data))
        at: BoolArray = sign * data >= top - 1e-9 * span
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]]))))[::2]
        near = int(np.sum(sign * data > top - 4 * max(step, 1e-3 * span))) - int(np.sum(at))
        if runs.max() >= _SATURATED_ROWS and near < 0.5 * np.sum(at):
            # The neighbours of a saturated row may be cut by noise.
            live &= ~np.convolve(at, np.ones(5), "same").astype(bool)
    return live
