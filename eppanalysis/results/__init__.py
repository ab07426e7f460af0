"""What the analyses return: statuses that are sentences, events, trajectories, limit cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum, StrEnum
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arguments import checked
from eppanalysis.errors import EppError, NotConverged, shown
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.results.provenance import Provenance

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


class Status(Enum):
    """How a method ended; the value is a sentence for people, with the remedy where there is one."""

    CONVERGED = "The method converged."
    SETTLED = "The motion settled at rest."
    LIMIT_CYCLE = "The motion settled on a limit cycle."
    UNDECIDED = "The motion had neither settled nor repeated itself by the end; simulate for longer."
    DIVERGED = "The motion grew without bound."
    EVENT_LIMIT = (
        "The run stopped early: too many events (an accumulation of switches) or steps (far faster motions, or a far "
        "smaller step, than its length allows); its results end where it stopped."
    )
    INCOMPLETE = "The search covers a part of what was asked for; its sentence says which."
    NOT_CONVERGED = "The iteration did not converge; its last iterate is given for inspection only."

    @property
    def ok(self) -> bool:
        """Whether results with this status may be relied on."""
        return self in (Status.CONVERGED, Status.SETTLED, Status.LIMIT_CYCLE)


def require_converged(status: Status, what: str) -> None:
    """Raise NotConverged unless `status` is a success."""
    if not status.ok:
        raise NotConverged(f"{what}: {status.value}")


def plain(value: Any) -> Any:
    """A value as plain data: arrays as lists, complex numbers as pairs, members of enumerations by their names.

    Examples
    --------
    >>> plain({"status": Status.CONVERGED, "values": np.array([1.0, 2.0j])})
    {'status': 'converged', 'values': [[1.0, 0.0], [0.0, 2.0]]}
    """
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, Enum):
        return value.value if isinstance(value, str) else value.name.lower()
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, Mapping):
        return {name: plain(inner) for name, inner in value.items()}
    if is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())
    return [plain(inner) for inner in value] if isinstance(value, list | tuple) else value


class PlainData:
    """A dataclass that people get as plain data."""

    #: What its plain data hold, in order: fields, properties and methods by name, with ``name=place`` for one that goes
    #: by another name there; all fields where nothing is said.
    in_json: ClassVar[str] = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data in SI units, as ``--json`` prints it."""
        names = self.in_json.split() or [f.name for f in fields(self)]  # type: ignore[arg-type]  # a dataclass
        parts = ((name, attrgetter(place or name)(self)) for name, _, place in (item.partition("=") for item in names))
        return {name: plain(part() if callable(part) else part) for name, part in parts}


class Brief(PlainData):
    """A dataclass whose repr fits the console: its plain values, and how much there is of the others."""

    def __repr__(self) -> str:
        named = fields(self)  # type: ignore[arg-type]  # only dataclasses inherit from it
        shown = {f.name: _brief(getattr(self, f.name)) for f in named if f.name != "provenance"}
        return f"{type(self).__name__}({', '.join(f'{name}={text}' for name, text in shown.items() if text)})"


def _brief(value: object) -> str:
    """A plain value itself; of a collection what it is and its size; nothing where there is nothing."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return f"{value:.7g}"
    if value is None or isinstance(value, str | int):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"<array {'x'.join(map(str, value.shape))}>" if value.size else ""
    if isinstance(value, Sized):
        return f"<{type(value).__name__} of {len(value)}>" if len(value) else ""
    return f"<{type(value).__name__}>"


@dataclass(frozen=True, eq=False, repr=False)
class Result(Brief):
    """What an analysis returns.

    Attributes
    ----------
    provenance : Provenance
        What made it; nothing is computed with it.
    operating_point : OperatingPoint or None
        Where the external inputs are held, or why they stand nowhere; None where a result is of no single one.
    """

    provenance: Provenance = field(default_factory=Provenance, kw_only=True, compare=False, repr=False)
    operating_point: OperatingPoint | None = field(default=None, kw_only=True, compare=False)

    def drawn(self, function: str, *options: Any) -> Any:
        """What a function of the module `picture` in the result's own room draws of it."""
        return self.by("picture", function, *options)

    def by(self, module: str, function: str, *options: Any) -> Any:
        """What a function in the result's own room makes of it: a picture, a file.

        Such a function knows the result. So that no two modules know each other, a result knows it by name only; what
        draws and writes is loaded when something is drawn or written.
        """
        own = type(self).__module__
        room = own if own == __name__ else own.rpartition(".")[0]
        return getattr(import_module(f"{room}.{module}"), function)(self, *options)


class Outcome(StrEnum):
    """What a run does in the end, in the word that case files have for it."""

    OSCILLATE = "oscillate"
    SETTLE = "settle"
    UNDECIDED = "undecided"

    @classmethod
    def of(cls, status: Status) -> Outcome:
        """The outcome of a run that ended with this status."""
        return {Status.LIMIT_CYCLE: cls.OSCILLATE, Status.SETTLED: cls.SETTLE}.get(status, cls.UNDECIDED)


class Event(NamedTuple):
    """One switch of one element.

    Attributes
    ----------
    time : float
        When [s].
    element : str
        Name of the element.
    name : str
        What happened ("contact lost", "sticks", ...).
    mode : str
        The element's mode after it.
    """

    time: float
    element: str
    name: str
    mode: str


@dataclass(frozen=True, eq=False, repr=False)
class LimitCycle(Result):
    """A periodic motion as one method sees it.

    Attributes
    ----------
    method : str
        "describing function", "harmonic balance", "exact orbit" or "simulation".
    status : Status
    period, frequency : float
        [s], [Hz].
    mean, peak_to_peak : dict of str to float
        Of every named signal, in its SI unit.
    harmonics : dict of str to complex array
        Coefficients c[k] of ``sum Re(c[k] exp(j k omega t))`` of every named signal, c[0] the mean.
    stable : bool or None
        None when the method cannot tell.
    stability_criterion : str
    multipliers : complex array or None
        Floquet multipliers, where the method has them.
    residual, error_estimate : float
        Residual of the method's own equation; estimated relative error against the true cycle (nan when unknown).
    events : tuple of Event
    time, waveform : array, dict of str to array
        One period, sampled.
    state, memory : array, shape (n,), tuple
        State of the loop at the begin of the period, and what each element remembers there (as its ``output`` takes it:
        a number, a ``Slip``, a pair; None for nothing): what `x0` and `memory` of a system are, from which a run goes
        on. Empty when unknown. What is on its way through a dead time is not part of it.
    mean_state : array, shape (n,)
        Mean of the state over a period, about which starts of other sizes are made. Empty when unknown.
    event_states : array, shape (events, n)
        State at each event of a period, events of no consequence included. Empty when unknown.
    elements : dict of str to dict of str to float
        First order only: "amplitude", "bias" and "phase" [rad] at the (first) input of every element.
    harmonic_content : float
        First order only: size of the neglected harmonics relative to the fundamental; nan when unknown.
    note : str
        What else there is to say: why the error cannot be told, or what was found instead of what was asked for.
    """

    method: str
    status: Status
    period: float
    mean: dict[str, float]
    peak_to_peak: dict[str, float]
    harmonics: dict[str, NDArray[np.complex128]]
    stable: bool | None = None
    stability_criterion: str = ""
    multipliers: NDArray[np.complex128] | None = None
    residual: float = float("nan")
    error_estimate: float = float("nan")
    events: tuple[Event, ...] = ()
    time: Array = field(default_factory=lambda: np.zeros(0))
    waveform: dict[str, Array] = field(default_factory=dict)
    state: Array = field(default_factory=lambda: np.zeros(0))
    memory: tuple[Any, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    mean_state: Array = field(default_factory=lambda: np.zeros(0))
    event_states: Array = field(default_factory=lambda: np.zeros((0, 0)))
    elements: dict[str, dict[str, float]] = field(default_factory=dict)
    harmonic_content: float = float("nan")
    note: str = ""

    in_json = (
        "method status message=status.value period frequency mean peak_to_peak amplitude=amplitudes stable "
        "stability_criterion multipliers residual error_estimate may_not_exist harmonic_content elements events note "
        "operating_point provenance"
    )

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
            raise EppError(f"There is no signal {shown(signal)}; expected one of {', '.join(self.harmonics)}.")
        return float(abs(self.harmonics[signal][1]))

    def require_converged(self) -> LimitCycle:
        """The cycle itself, or NotConverged."""
        require_converged(self.status, self.method)
        return self

    def require_state(self, n: int) -> LimitCycle:
        """The cycle itself, or EppError unless it tells the `n` states of a loop at its begin."""
        if self.state.size != n:
            raise EppError(
                f"A limit cycle by {self.method} has {self.state.size} states at its begin; expected {n}, as a "
                "prediction, an exact orbit or a run of this loop has them."
            )
        return self

    @checked
    def plot(self, signals: list[str] | None = None) -> Figure:
        """Waveform of one period, one panel a signal."""
        return self.drawn("plot_limit_cycle", signals)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result):
    """A run in time.

    Attributes
    ----------
    t : array, shape (nt,)
        Times [s].
    signals : dict of str to array, shape (nt,)
        Named signals in SI units.
    events : tuple of Event
        Every switch of every element; the last 20,000 where there were more (see `n_events`).
    status : Status
        SETTLED, LIMIT_CYCLE, UNDECIDED, DIVERGED or EVENT_LIMIT.
    limit_cycle : LimitCycle or None
        The cycle that the run settles on.
    settled_at : dict of str to float
        Where the signals rest, when they do.
    settled_since : float
        Since when the run is at rest or on the cycle [s]; nan when it is neither.
    n_events : int
        Switches in all, those included that `events` no longer holds.
    """

    t: Array
    signals: dict[str, Array]
    events: tuple[Event, ...]
    status: Status
    limit_cycle: LimitCycle | None = None
    settled_at: dict[str, float] = field(default_factory=dict)
    settled_since: float = float("nan")
    units: dict[str, str] = field(default_factory=dict)
    n_events: int = 0

    in_json = (
        "status message=status.value settled_at settled_since limit_cycle n_events operating_point end_time provenance"
    )

    @property
    def end_time(self) -> float:
        """Time of the last sample [s]; nan where there is none."""
        return float(self.t[-1]) if self.t.size else float("nan")

    def to_dataset(self) -> xarray.Dataset:
        """The signals as an xarray Dataset over time, with units and provenance as attributes."""
        import json

        import xarray

        data = {k: ("time", v, {"units": self.units.get(k, "")}) for k, v in self.signals.items()}
        attributes = {
            "status": self.status.name.lower(),
            "provenance": json.dumps(self.provenance.to_dict(), default=str),
        }
        return xarray.Dataset(data, coords={"time": ("time", self.t, {"units": "s"})}, attrs=attributes)

    @checked
    def plot(self, signals: list[str] | None = None) -> Figure:
        """Signals against time, one panel each."""
        return self.drawn("plot_trajectory", signals)


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """All limit cycles that first-order harmonic balance with bias has.

    Behaves as a sequence of LimitCycle (sorted by amplitude). `curves` holds what the Nyquist picture needs:
    ``{"omega", "response", "amplitude", "locus"}`` for one element; for several the loop gain over the amplitude at the
    principal element. `search` says how completeness was sought, `warnings` what cycles first order cannot see there.
    `operating_point` is where the external inputs are held.
    """

    cycles: tuple[LimitCycle, ...]
    status: Status
    search: str
    curves: Mapping[str, Any] = field(default_factory=dict)
    margins: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    in_json = "status message=status.value search warnings margins operating_point cycles provenance"

    def __len__(self) -> int:
        return len(self.cycles)

    def __getitem__(self, i: int) -> LimitCycle:
        return self.cycles[i]

    def __iter__(self):
        return iter(self.cycles)

    def plot(self, ax: Axes | None = None) -> Figure:
        """Nyquist picture with the -1/N locus, its intersections and arrows of stability."""
        return self.drawn("plot_nyquist", ax)
