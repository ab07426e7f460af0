"""What the analyses return: statuses that are sentences, events, trajectories, limit cycles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, cmp_to_key
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError, shown as written
from eppanalysis.readable import at_rest, lasting, number, percent, quantity, readable, with_unit, words
from eppanalysis.results.deferred import WhenAsked
from eppanalysis.results.events import Event as Event
from eppanalysis.results.provenance import Provenance
from eppanalysis.results.result import (
    Brief as Brief,
    Listing as Listing,
    PlainData as PlainData,
    Result as Result,
    Status as Status,
    plain as plain,
    require_converged as require_converged,
)
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


#: What a limit cycle says of how it is known; a balance says its order behind.
DESCRIBING_FUNCTION, HARMONIC_BALANCE = "describing function", "harmonic balance"
EXACT_ORBIT, SIMULATION = "exact orbit", "simulation"

#: A signal that moves by less than this share of another of its unit does not tell the oscillation; no gear does that.
_HARDLY = 1e-3
#: Relative difference of two numbers of cycles that is none.
_EQUAL = 1e-9


class Outcome(StrEnum):
    """What a run does in the end, in the word that case files have for it."""

    OSCILLATE = "oscillate"
    SETTLE = "settle"
    UNDECIDED = "undecided"

    @classmethod
    def of(cls, status: Status) -> Outcome:
        """The outcome of a run that ended with this status."""
        return {Status.LIMIT_CYCLE: cls.OSCILLATE, Status.SETTLED: cls.SETTLE}.get(status, cls.UNDECIDED)


@dataclass(frozen=True, eq=False, repr=False)
class LimitCycle(Result):
    """A periodic motion as one method sees it.

    Attributes
    ----------
    method : str
        "describing function", "harmonic balance", "exact orbit" or "simulation".
    status : Status
        How its computation ended.
    period : float
        Period [s].
    mean, peak_to_peak, units : dict of str to float, dict of str to str
        Of every named signal, in its SI unit; that unit.
    harmonics : mapping of str to complex array
        Coefficients c[k] of ``sum Re(c[k] exp(j k omega t))`` of every named signal, c[0] the mean.
    stable, stability_criterion : bool or None, str
        Whether it is (None when it is neutral, or the method cannot tell), and by what that was judged, in plain words.
    multipliers : complex array or None
        Floquet multipliers, where the method has them.
    residual, error_estimate : float
        Residual of the method's own equation; estimated relative error against the true cycle (nan when unknown).
    events : sequence of Event
        Switches of a period, in their order, with time, element and name.
    time, waveform : array, dict of str to array
        One period, sampled.
    state, memory : array, shape (n,), tuple
        State of the loop at the beginning of the period, and what each element remembers there (as its ``output`` takes
        it: a number, a ``Slip``, a pair; None for nothing): what `x0` and `memory` of a system are, from which a run
        goes on. Empty when unknown. What is on its way through a dead time is not part of it.
    mean_state : array, shape (n,)
        Mean of the state over a period, about which starts of other sizes are made. Empty when unknown.
    event_states : array, shape (events, n)
        State at each event of a period, events of no consequence included. Empty when unknown.
    elements : dict of str to dict of str to float
        Describing function only: "amplitude", "bias" and "phase" [rad] at the (first) input of every element.
    harmonic_content : float
        Describing function only: size of the neglected harmonics relative to the fundamental; nan when unknown.
    note : str
        A note: why the error is unknown, or what was found in place of the requested orbit.
    """

    method: str
    status: Status
    period: float
    mean: dict[str, float]
    peak_to_peak: dict[str, float]
    harmonics: Mapping[str, ComplexArray]
    stable: bool | None = None
    stability_criterion: str = ""
    multipliers: ComplexArray | None = None
    residual: float = float("nan")
    error_estimate: WhenAsked[float] = WhenAsked(float("nan"))
    events: Sequence[Event] = ()
    time: Array = field(default_factory=lambda: np.zeros(0))
    waveform: dict[str, Array] = field(default_factory=dict)
    state: Array = field(default_factory=lambda: np.zeros(0))
    memory: tuple[Any, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    mean_state: Array = field(default_factory=lambda: np.zeros(0))
    event_states: Array = field(default_factory=lambda: np.zeros((0, 0)))
    elements: dict[str, dict[str, float]] = field(default_factory=dict)
    harmonic_content: WhenAsked[float] = WhenAsked(float("nan"))
    note: str = ""

    in_json = (
        "method status message=status.value period frequency mean peak_to_peak amplitude=amplitudes stable "
        "stability_criterion multipliers residual error_estimate may_not_exist harmonic_content elements events note "
        "operating_point provenance"
    )

    def __getstate__(self) -> dict[str, Any]:
        """For other processes: with what is computed when it is looked at."""
        return {**vars(self), "error_estimate": self.error_estimate, "harmonic_content": self.harmonic_content}

    @property
    def frequency(self) -> float:
        """Frequency [Hz]."""
        return 1.0 / self.period

    @property
    def omega(self) -> float:
        """Angular frequency [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def may_not_exist(self) -> bool:
        """Whether the harmonics that were neglected may take the cycle away."""
        return bool(np.isinf(self.error_estimate))

    @property
    def amplitudes(self) -> dict[str, float]:
        """Amplitude of the fundamental of every signal, in its SI unit."""
        return {name: float(abs(c[1])) for name, c in self.harmonics.items() if len(c) > 1}

    @checked
    def amplitude(self, signal: str) -> float:
        """Amplitude of the fundamental of a signal, in its SI unit.

        Raises
        ------
        EppError
            If there is no such signal.
        """
        if signal not in self.harmonics:
            raise EppError(f"There is no signal {written(signal)}; expected one of {', '.join(self.harmonics)}.")
        return float(abs(self.harmonics[signal][1]))

    def require_converged(self) -> LimitCycle:
        """The cycle itself, or NotConverged."""
        require_converged(self.status, self.method)
        return self

    def require_state(self, n: int) -> LimitCycle:
        """The cycle itself, or EppError unless it tells the `n` states of a loop at its start."""
        if self.state.size != n:
            raise EppError(
                f"A limit cycle by {self.method} has {self.state.size} states at its start; expected {n}, as a "
                "prediction, an exact orbit or a run of this loop has them."
            )
        return self

    @property
    def size(self) -> str:
        """How large and how fast it is, in words: the peak-to-peak of its first signal and its frequency."""
        return self.size_of(next(iter(self.peak_to_peak), ""))

    def size_of(self, signal: str) -> str:
        """How large and how fast it is in one of its signals, in words."""
        if signal not in self.peak_to_peak:
            return f"{number(self.frequency)} Hz"
        spans = ((words(n), quantity(self.peak_to_peak[n], self.units.get(n, ""))) for n in self._moving(signal))
        named = " but ".join(map(" ".join, spans))
        return f"{named} peak to peak at {number(self.frequency)} Hz"

    def _moving(self, signal: str) -> list[str]:
        """A signal, and where that hardly moves the one of its unit that moves most: a motor within its gap."""
        unit = self.units.get(signal, "")
        alike = [name for name in self.peak_to_peak if unit and self.units.get(name) == unit]
        most = max(alike, key=lambda name: self.peak_to_peak[name], default=signal)
        return [signal, most] if self.peak_to_peak[signal] < _HARDLY * self.peak_to_peak[most] else [signal]

    def __str__(self) -> str:
        """The cycle in a sentence: whether it is stable, its size, its frequency, and by which method."""
        kind = {True: "Stable limit cycle", False: "Unstable limit cycle", None: "Limit cycle"}[self.stable]
        doubt = (
            " It may not exist: the harmonics that the describing function neglects may take it away."
            * self.may_not_exist
        )
        note = f" {self.note[:1].upper()}{self.note[1:].rstrip('.')}." if self.note else ""
        if not self.status.ok:
            return f"No limit cycle was reached ({self.method}). {self.status.value} It has {self.size}.{note}"
        return f"{kind}: {self.size} ({self.method}).{doubt}{note}"

    def to_frame(self) -> pandas.DataFrame:
        """One row: method, stability, frequency [Hz], period [s], and the peak-to-peak and mean of every signal."""
        return cycles_frame([self])

    def in_brief(self) -> pandas.DataFrame:
        """The signals, one a row, each in its own unit."""
        return signals_frame(self.peak_to_peak, self.mean, self.units)

    def to_dataset(self) -> xarray.Dataset:
        """The waveforms of one period as an xarray Dataset over time, with units as attributes."""
        time, waveform = self.by("picture", "one_period")
        return _over_time(time, waveform, self.units, self.status, self.provenance)

    @checked
    def plot(self, ax: Axes | None = None, signals: list[str] | None = None) -> Axes:
        """Waveform of one period, one panel a signal; into a given `ax` goes the main one alone."""
        return self.drawn("plot_limit_cycle", ax, signals)


#: Share of a signal that is no motion.
_STILL = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result):
    """A run in time.

    Attributes
    ----------
    t : array, shape (nt,)
        Times [s].
    signals : dict of str to array, shape (nt,)
        Named signals in SI units.
    events : sequence of Event
        Every switch of every element; the last 20,000 where there were more (see `n_events`).
    status : Status
        SETTLED, LIMIT_CYCLE, UNDECIDED, DIVERGED or EVENT_LIMIT.
    limit_cycle : LimitCycle or None
        The cycle that the run settles on.
    settled_at : dict of str to float
        Where the signals rest, when they do.
    settled_since : float
        Since when it rests (signals within a thousandth of their range from there) or is on the cycle [s], or nan.
    n_events : int
        Switches in all, those included that `events` no longer holds.
    note : str
        Why a run ended early, or is undecided, and what it comes to beyond its end.
    carried_to : float
        How far the motion was carried on beyond the last sample to decide how it ends [s]; nan where the run itself
        shows it.
    again : callable or None
        Signals at other times, computed anew from the same start; None where only the samples are known.
    """

    t: Array
    signals: dict[str, Array]
    events: Sequence[Event]
    status: Status
    limit_cycle: LimitCycle | None = None
    settled_at: dict[str, float] = field(default_factory=dict)
    settled_since: float = float("nan")
    units: dict[str, str] = field(default_factory=dict)
    n_events: int = 0
    note: WhenAsked[str] = WhenAsked("")
    carried_to: float = float("nan")
    again: Callable[[Array], Mapping[str, Array]] | None = None

    in_json = (
        "status message settled_at settled_since carried_to limit_cycle n_events operating_point end_time provenance"
    )

    def __getstate__(self) -> dict[str, Any]:
        """For other processes: with what is computed when it is looked at."""
        return {**vars(self), "note": self.note}

    @property
    def message(self) -> str:
        """How the run ended, in a sentence."""
        return self.note or self.status.value

    @property
    def end_time(self) -> float:
        """Time of the last sample [s]; nan where there is none."""
        return float(self.t[-1]) if self.t.size else float("nan")

    def to_dataset(self) -> xarray.Dataset:
        """The signals as an xarray Dataset over time, with units and provenance as attributes."""
        return _over_time(self.t, self.signals, self.units, self.status, self.provenance)

    def to_frame(self) -> pandas.DataFrame:
        """The signals over time [s], a column each."""
        rows = frame_of([])
        for name, values in {"time": self.t, **self.signals}.items():
            rows[name] = values
        rows.attrs["units"] = {"time": "s", **self.units}
        return rows

    def in_brief(self) -> pandas.DataFrame:
        """The signals, one a row: on the cycle, at rest, or over the whole run."""
        if self.limit_cycle is not None:
            return self.limit_cycle.in_brief()
        rest = dict.fromkeys(self.settled_at, 0.0)
        spans = {name: float(np.ptp(v)) for name, v in self.signals.items() if v.size}
        means = {name: float(np.mean(v)) for name, v in self.signals.items() if v.size}
        return signals_frame(rest or spans, self.settled_at or means, self.units)

    def __str__(self) -> str:
        """What the run does in the end, with a number."""
        since = f", from {lasting(self.settled_since, self.units)} on" * (self.settled_since > 0.0)
        if self.carried_to > self.end_time:
            since += f"; carried on to {lasting(self.carried_to, self.units)}"
        if self.limit_cycle is not None:
            return f"Oscillates: {self.limit_cycle.size}{since}.{' ' * bool(self.note)}{self.note}"
        if self.status is Status.SETTLED:
            first = list(self.settled_at.items())[:1]
            at = "".join(f": {words(n)} at {quantity(at_rest(v), self.units.get(n, ''))}" for n, v in first)
            if self.stands_still:
                return f"Rests where it starts{at}; other starts may oscillate."
            return f"Settles at rest{at}{since}."
        after = self.carried_to if self.status is Status.DIVERGED and self.carried_to > 0.0 else self.end_time
        end = f"after {lasting(after, self.units)}" if self.t.size else "without samples"
        begin = f"Undecided {end}" if self.status is Status.UNDECIDED else end.capitalize()
        return f"{begin}: {self.message}"

    @property
    def stands_still(self) -> bool:
        """Whether the run never leaves the place where it starts, but for rounding."""
        spans = [np.ptp(v) <= _STILL * np.abs(v).max() for v in self.signals.values() if v.size]
        return bool(spans) and all(spans) and not self.settled_since > 0.0

    @checked
    def plot(self, ax: Axes | None = None, signals: list[str] | None = None) -> Axes:
        """Signals against time, one panel each; into a given `ax` goes the main one alone."""
        return self.drawn("plot_trajectory", ax, signals)


class Notice(str):
    """A warning that names a cause of motion.

    Attributes
    ----------
    cause : str
        Why the loop moves, in a clause.
    sure : bool
        Whether it does, or only may.
    """

    cause: str
    sure: bool

    def __new__(cls, sentence: str, cause: str, sure: bool = True) -> Notice:
        """The sentence, with its cause."""
        made = super().__new__(cls, sentence)
        made.cause, made.sure = cause, sure
        return made

    def __getnewargs__(self) -> tuple[Any, ...]:
        return str(self), self.cause, self.sure


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Listing[LimitCycle]):
    """Limit cycles that describing functions with bias predict; behaves as a sequence of LimitCycle.

    Attributes
    ----------
    cycles : tuple of LimitCycle
        By amplitude.
    status : Status
        INCOMPLETE where the search is; `search` says why.
    search : str
        How completeness was sought, in plain words.
    curves : mapping
        What the Nyquist plot needs: "omega", "response", "amplitude" and "locus" for one element; for several the
        loop gain over the amplitude at the principal element.
    margins : mapping
        Those of the linearised loop: where it is cut ("at"), the numbers, and the gains of the elements
        ("rule").
    on_grid : bool
        Whether the search was on a grid between whose points cycles may lie.
    unseen : callable
        Looks for cycles that the describing function does not see, when first read.
    operating_point : OperatingPoint or None
        Where the external inputs are held.
    """

    cycles: tuple[LimitCycle, ...]
    status: Status
    search: str
    curves: Mapping[str, Any] = field(default_factory=dict)
    margins: Mapping[str, Any] = field(default_factory=dict)
    on_grid: bool = False
    unseen: Callable[[], tuple[str, ...]] = field(default_factory=lambda: tuple)

    parts = "cycles"
    in_json = "status message=status.value search warnings margins operating_point cycles provenance"

    def __str__(self) -> str:
        """How many limit cycles the DF has, the largest stable one, and what it may not see."""
        doubtful = [cycle for cycle in self.cycles if cycle.may_not_exist]
        sure = [cycle for cycle in self.cycles if not cycle.may_not_exist]
        ended = [] if self.status.ok else [self.status.value]
        ended += ["Cycles between the points of its grid may be missed."] if self.on_grid else []
        if doubtful and not sure:
            predicts = counted(doubtful, which=" that may not exist")
        else:
            predicts = counted(sure) + f", and {len(doubtful)} more that may not exist" * bool(doubtful)
        # That there is none is no verdict where it is known what the DF does not see.
        missed = ", and may miss one" if self.warnings and not sure else ""
        margin = "" if sure else _margin(self.margins)
        return " ".join([f"The describing function predicts {predicts}{missed}{margin}.", *ended, *self.warnings])

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What cycles the DF cannot see there, a sentence each; looked for when they are first requested."""
        return self.unseen()

    def to_frame(self) -> pandas.DataFrame:
        """The cycles, one a row."""
        return cycles_frame(self.cycles)

    def in_brief(self) -> pandas.DataFrame:
        """The cycles, one a row, by their first signal."""
        return brief_cycles(self.cycles)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Nyquist plot with the -1/N locus, its intersections and arrows of stability."""
        return self.drawn("plot_nyquist", ax)


def _margin(margins: Mapping[str, Any]) -> str:
    """What the linearised loop adds to the sentence that the DF predicts nothing."""
    gain = margins.get("gain_margin", float("nan"))
    if np.isnan(gain):
        return ""
    if margins.get("stable") is None:
        return "; the stability of the linearised loop is undecided"
    if margins["stable"]:
        return f"; the gain margin of the linearised loop is {number(gain)}"
    # An infinite margin of a loop that is unstable at every gain would read as safety.
    border = f", and on the border of stability at {number(gain)} times its gain" if np.isfinite(gain) else ""
    return f"; the linearised loop is unstable{border}"


def smallest_first(cycles: Iterable[LimitCycle]) -> list[LimitCycle]:
    """Cycles by the size of their first signal and their period; mirror images, equal in both, by the signs of their
    means and by their events, the negative one first.
    """
    return sorted(cycles, key=cmp_to_key(_before))


def _before(one: LimitCycle, other: LimitCycle) -> int:
    sizes = list(one.peak_to_peak.values())
    rows = ((*list(c.peak_to_peak.values())[:1], c.period, *c.mean.values()) for c in (one, other))
    for a, b, size in zip(*rows, (*sizes[:1], one.period, *sizes), strict=True):
        if abs(a - b) > _EQUAL * max(size, abs(a)):
            return -1 if a < b else 1
    here, there = ([(e.element, e.name) for e in c.events] for c in (one, other))
    return (here > there) - (here < there)


def counted(cycles: Sequence[LimitCycle], signal: str | None = None, which: str = "") -> str:
    """Limit cycles in words: how many, how many of them stable, the size of the largest of these (of all, if none is).

    `which` says more of them (" that may not exist").

    Examples
    --------
    >>> counted([])
    'no limit cycle'
    """
    if not cycles:
        return "no limit cycle"
    stable = [cycle for cycle in cycles if cycle.stable]
    name = next(iter(cycles[0].peak_to_peak), "") if signal is None else signal
    size = max(stable or cycles, key=lambda cycle: cycle.peak_to_peak.get(name, 0.0)).size_of(name)
    if len(cycles) == 1:
        kind = {True: "stable ", False: "unstable ", None: ""}[cycles[0].stable]
        return f"1 {kind}limit cycle{which}{',' * bool(which)} with {size}"
    if len(stable) == 1:
        return f"{len(cycles)} limit cycles{which}, the stable one with {size}"
    if len(stable) == len(cycles):
        return f"{len(cycles)} stable limit cycles{which}, the largest with {size}"
    known = f", {len(stable) or 'none'} of them stable" if any(c.stable is not None for c in cycles) else ""
    return f"{len(cycles)} limit cycles{which}{known}, the largest{' of these' * bool(stable)} with {size}"


def cycles_frame(cycles: Sequence[LimitCycle]) -> pandas.DataFrame:
    """Limit cycles, one a row [SI]: method, stability, frequency, period, estimated error, and every signal."""
    rows, units = [], {"frequency": "Hz", "period": "s"}
    for cycle in cycles:
        units["period"] = cycle.units.get("time", "s")
        row: dict[str, Any] = {name: getattr(cycle, name) for name in ("method", "stable", "frequency", "period")}
        row["error_estimate"] = cycle.error_estimate
        for name, span in cycle.peak_to_peak.items():
            # What is left of a mean of zero after summation is not worth its digits.
            mean = cycle.mean[name] if abs(cycle.mean[name]) > 1e-9 * span else 0.0
            row |= {f"{name}.peak_to_peak": span, f"{name}.mean": mean}
            units |= dict.fromkeys((f"{name}.peak_to_peak", f"{name}.mean"), cycle.units.get(name, ""))
        rows.append(row)
    return frame_of(rows, units)


def brief_cycles(cycles: Sequence[LimitCycle]) -> pandas.DataFrame:
    """Limit cycles, one a row [SI], by their first signal alone."""
    frame = cycles_frame(cycles).drop(columns="period", errors="ignore")
    frame["error_estimate"] = [percent(cycle.error_estimate) for cycle in cycles]
    return frame[list(frame.columns[:6])].rename(columns={"error_estimate": "estimated error"})


def signals_frame(spans: Mapping[str, float], means: Mapping[str, float], units: Mapping[str, str]) -> pandas.DataFrame:
    """Signals, one a row, in the units that people read, which their names say."""
    rows = []
    for name, span in spans.items():
        unit, factor = readable(units.get(name, ""))
        row = {"signal": with_unit(words(name), unit), "peak to peak": factor * span}
        mean = means.get(name, float("nan"))
        rows.append(row | {"mean": 0.0 if abs(mean) < 1e-9 * span else factor * mean})
    return frame_of(rows)


def _over_time(
    time: Array, signals: Mapping[str, Array], units: Mapping[str, str], status: Status, provenance: Provenance
) -> xarray.Dataset:
    """Signals as a dataset over time, with units, status and provenance as attributes."""
    import json

    import xarray

    # Plain text: files take no unit that remembers in which one people read it.
    data = {name: ("time", values, {"units": str(units.get(name, ""))}) for name, values in signals.items()}
    attributes = {"status": status.name.lower(), "provenance": json.dumps(provenance.to_dict(), default=str)}
    return xarray.Dataset(data, coords={"time": ("time", time, {"units": "s"})}, attrs=attributes)
