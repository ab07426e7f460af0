"""Input signals: offsets that are added to a system's external input from the start of a run on.

Each input signal gives ``value(t)``. The piecewise-linear ones give ``breakpoints()`` besides, the data from which an
exact integrator restarts; the sine gives its amplitude, angular frequency and phase.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import checked_class, floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError

Breakpoints = tuple[Array, Array, Array]


def _require_finite(name: str, **values: float) -> None:
    for field_name, value in values.items():
        if not np.isfinite(value):
            raise ModelError(name, value, "a finite number", field=field_name)


def _evaluate_breakpoints(breakpoints: Breakpoints, t: ArrayLike) -> Array:
    """Value of a piecewise-linear input signal; at a jump the value behind it."""
    times, values, slopes = breakpoints
    t = np.asarray(t, float)
    piece = np.maximum(np.searchsorted(times, t, side="right") - 1, 0)
    return np.where(t < times[0], 0.0, values[piece] + slopes[piece] * (t - times[piece]))


@checked_class
@dataclass(frozen=True)
class Constant:
    """An offset that never changes.

    Parameters
    ----------
    size : float
        Offset from t = 0 on, in the unit of the input; 0 leaves the system at its operating point.

    Raises
    ------
    ModelError
        If `size` is not finite.

    Examples
    --------
    >>> from eppanalysis import inputs
    >>> float(inputs.Constant(0.0).value(3.0))
    0.0
    """

    size: float = 0.0

    def __post_init__(self) -> None:
        _require_finite("Constant", size=self.size)

    def value(self, t: ArrayLike) -> Array:
        """Offset at the times `t` [s]."""
        return np.full(np.shape(t), float(self.size))

    def breakpoints(self) -> Breakpoints:
        """Times, values behind them and slopes behind them, each of shape (1,)."""
        return np.zeros(1), np.array([float(self.size)]), np.zeros(1)


@checked_class
@dataclass(frozen=True)
class Step:
    """A jump by `size` at `time`.

    Parameters
    ----------
    size : float
        Height of the jump, in the unit of the input.
    time : float
        When [s], not negative; at that time the value is already `size`.

    Raises
    ------
    ModelError
        If a number is not finite, or `time` is negative.

    Examples
    --------
    >>> from eppanalysis import inputs
    >>> inputs.Step(0.02).value([0.0, 1.0]).tolist()
    [0.02, 0.02]
    """

    size: float
    time: float = 0.0

    def __post_init__(self) -> None:
        _require_finite("Step", size=self.size, time=self.time)
        if self.time < 0:
            raise ModelError("Step", self.time, "0 or more", field="time")

    def value(self, t: ArrayLike) -> Array:
        """Offset at the times `t` [s]."""
        return _evaluate_breakpoints(self.breakpoints(), t)

    def breakpoints(self) -> Breakpoints:
        """Times, values behind them and slopes behind them, each of shape (2,) or (1,) for a step at 0."""
        if self.time == 0.0:
            return np.zeros(1), np.array([float(self.size)]), np.zeros(1)
        return np.array([0.0, self.time]), np.array([0.0, self.size]), np.zeros(2)


@checked_class
@dataclass(frozen=True)
class Ramp:
    """An input signal at constant rate between two times, at rest before and after.

    Parameters
    ----------
    rate : float
        Slope, in the unit of the input per second.
    start : float
        When it begins [s], not negative.
    stop : float, optional
        When it ends [s], later than `start`; by default it never does.

    Raises
    ------
    ModelError
        If a number is not finite or the times are out of order.

    Examples
    --------
    >>> from eppanalysis import inputs
    >>> inputs.Ramp(2.0, start=1.0, stop=2.0).value([0.5, 1.5, 3.0]).tolist()
    [0.0, 1.0, 2.0]
    """

    rate: float
    start: float = 0.0
    stop: float | None = None

    def __post_init__(self) -> None:
        _require_finite("Ramp", rate=self.rate, start=self.start, stop=0.0 if self.stop is None else self.stop)
        if self.start < 0:
            raise ModelError("Ramp", self.start, "0 or more", field="start")
        if self.stop is not None and self.stop <= self.start:
            raise ModelError("Ramp", self.stop, "a time after start", field="stop", beside=("start", self.start))

    def value(self, t: ArrayLike) -> Array:
        """Offset at the times `t` [s]."""
        return _evaluate_breakpoints(self.breakpoints(), t)

    def breakpoints(self) -> Breakpoints:
        """Times, values behind them and slopes behind them, each of shape (1,) to (3,)."""
        rows = [(0.0, 0.0, 0.0)] if self.start > 0 else []
        rows.append((self.start, 0.0, self.rate))
        if self.stop is not None:
            rows.append((self.stop, self.rate * (self.stop - self.start), 0.0))
        times, values, slopes = np.array(rows, float).T
        return times, values, slopes


@checked_class
@dataclass(frozen=True)
class Sine:
    """``amplitude * sin(2 pi frequency_hz t + phase)`` from t = 0 on.

    Parameters
    ----------
    amplitude : float
        In the unit of the input.
    frequency_hz : float
        Frequency [Hz], positive.
    phase : float
        Phase at t = 0 [rad].

    Raises
    ------
    ModelError
        If a number is not finite, or the frequency is not positive.

    Examples
    --------
    >>> from eppanalysis import inputs
    >>> round(float(inputs.Sine(0.01, 1.0).value(0.25)), 12)
    0.01
    """

    amplitude: float
    frequency_hz: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        _require_finite("Sine", amplitude=self.amplitude, frequency_hz=self.frequency_hz, phase=self.phase)
        if self.frequency_hz <= 0:
            raise ModelError("Sine", self.frequency_hz, "a positive number", field="frequency_hz")

    @property
    def omega(self) -> float:
        """Angular frequency [rad/s]."""
        return 2.0 * np.pi * self.frequency_hz

    def value(self, t: ArrayLike) -> Array:
        """Offset at the times `t` [s]."""
        t = np.asarray(t, float)
        return np.where(t < 0.0, 0.0, self.amplitude * np.sin(self.omega * t + self.phase))


@dataclass(frozen=True, eq=False)
class Steps:
    """Several jumps one after the other, at rest in between.

    Parameters
    ----------
    times : array_like, shape (n,)
        When it jumps [s], finite and strictly increasing, the first not negative; before it the offset is 0.
    values : array_like, shape (n,)
        Offset behind each jump, in the unit of the input, finite.

    Raises
    ------
    ModelError
        If lengths differ, there is no jump, a number is not finite, or times do not increase.

    Examples
    --------
    >>> from eppanalysis import inputs
    >>> inputs.Steps([0.0, 1.0], [0.02, 0.0]).value([0.5, 1.0, 4.0]).tolist()
    [0.02, 0.0, 0.0]
    """

    times: Array
    values: Array

    def __post_init__(self) -> None:
        _freeze_samples(self, 1)

    def value(self, t: ArrayLike) -> Array:
        """Offset at the times `t` [s]."""
        return _evaluate_breakpoints(self.breakpoints(), t)

    def breakpoints(self) -> Breakpoints:
        """Times, values behind them and slopes behind them (zero), each of shape (n,) or (n + 1,)."""
        times, values = self.times, self.values
        if times[0] > 0:
            times, values = np.append(0.0, times), np.append(0.0, values)
        return times, values, np.zeros(times.size)


def _freeze_samples(input_signal: Steps | Recorded, fewest: int) -> None:
    """Check times and values of an input signal and make them arrays that cannot be changed."""
    name = type(input_signal).__name__
    given = {"times": input_signal.times, "values": input_signal.values}
    times, values = (floats(a, f"{name}: {n}", ndmin=1, copy=True) for n, a in given.items())
    if times.shape != values.shape or times.ndim != 1 or times.size < fewest:
        wanted = {1: "one", 2: "two"}[fewest]
        found = f"{name}: times {times.shape} and values {values.shape}"
        raise ModelError(found, expected=f"{wanted} or more of each")
    for field_name, array in (("times", times), ("values", values)):
        holes = np.flatnonzero(~np.isfinite(array))
        if holes.size:
            raise ModelError(f"{name}: {field_name}[{holes[0]}]", array[holes[0]], "a finite number")
    stuck = np.flatnonzero(np.diff(times) <= 0)
    if stuck.size:
        i = int(stuck[0]) + 1
        raise ModelError(f"{name}: times[{i}]", times[i], f"more than the time before it ({times[i - 1]})")
    if times[0] < 0:
        raise ModelError(f"{name}: times[0]", times[0], "0 or more")
    for field_name, array in (("times", times), ("values", values)):
        array.flags.writeable = False
        object.__setattr__(input_signal, field_name, array)


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recorded input signal, linear between its samples and constant behind the last one.

    Parameters
    ----------
    times : array_like, shape (n,)
        Sample times [s], finite and strictly increasing, the first not negative; before it the offset is 0.
    values : array_like, shape (n,)
        Samples, in the unit of the input, finite.

    Raises
    ------
    ModelError
        If lengths differ, a number is not finite, or times do not increase.

    Examples
    --------
    >>> from eppanalysis import inputs
    >>> inputs.Recorded([0.0, 1.0], [0.0, 0.02]).value([0.5, 4.0]).tolist()
    [0.01, 0.02]
    """

    times: Array = field(repr=False)
    values: Array = field(repr=False)

    def __post_init__(self) -> None:
        _freeze_samples(self, 2)

    def value(self, t: ArrayLike) -> Array:
        """Offset at the times `t` [s]."""
        return _evaluate_breakpoints(self.breakpoints(), t)

    def breakpoints(self) -> Breakpoints:
        """Times, values behind them and slopes behind them, each of shape (n,) or (n + 1,)."""
        times, values = self.times, self.values
        slopes = np.append(np.diff(values) / np.diff(times), 0.0)
        if times[0] > 0:
            return np.append(0.0, times), np.append(0.0, values), np.append(0.0, slopes)
        return times, values, slopes


#: Every input signal that a run accepts.
InputSignal = Constant | Step | Steps | Ramp | Sine | Recorded


def input_signals_by_name(
    input_names: Sequence[str], given: InputSignal | Mapping[str, InputSignal] | None
) -> dict[str, InputSignal]:
    """Input signals by the name of the input that each drives; a single one drives the only input.

    Parameters
    ----------
    input_names : sequence of str
        Of the system.
    given : InputSignal, mapping of str to InputSignal, or None
        None leaves every input where it is.

    Raises
    ------
    ModelError
        If a single input signal meets a system that has not exactly one input.

    Examples
    --------
    >>> input_signals_by_name(["harness_position"], Step(0.02))
    {'harness_position': Step(size=0.02, time=0.0)}
    """
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return dict(given)
    if len(input_names) != 1:
        raise ModelError(
            f"The system has {len(input_names)} inputs", expected="input signals by name, not a single one"
        )
    return {input_names[0]: given}
