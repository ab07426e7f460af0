"""Responses over the frequency of the input, or over its amplitude: all branches that a search finds, through folds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError, did_you_mean
from eppanalysis.methods.driven.drive import Drive, DriveRange, drive_of
from eppanalysis.methods.driven.first_order import Sinusoid, sinusoid_branches
from eppanalysis.methods.driven.forced import Search, periodic_response, some_responses
from eppanalysis.methods.driven.result import FrequencyResponse, Over, ResponseBranch, SpecialResponse
from eppanalysis.methods.driven.runs import by_runs
from eppanalysis.methods.steady.changes import Change
from eppanalysis.methods.steady.closing import CLOSED
from eppanalysis.methods.steady.follow import Continuation, Place, between
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, PointLike, facts_of, require_continuous, system_of
from eppanalysis.readable import count, listed, number, quantity, words
from eppanalysis.results import EXACT_ORBIT, Status
from eppanalysis.results.provenance import Provenance

METHOD = "pseudo-arclength continuation over the input"
#: Where responses are searched for, as shares of the range: both ends first, for what runs up and what runs down.
_SOUGHT = (0.0, 1.0, 0.5, 0.25, 0.75)
#: Periods of the input in which samples have to come round with it.
_MOST_PERIODS = 60
#: Most branches that are followed.
_MOST_BRANCHES = 8


def frequency_response(
    system: LureSystem | CaseLike,
    input: str | None = None,
    output: str | None = None,
    *,
    amplitude: float | None = None,
    frequencies: tuple[float, float],
    operating_point: PointLike | None = None,
    n_points: int = 400,
    max_step: float = 0.03,
) -> FrequencyResponse:
    """The response to a sine of one amplitude over its frequency, exact, stable and unstable, through its folds.

    Beside the exact branches are those of describing functions. Only responses of the input's own
    period are followed; where one loses its stability to others, the point is named.

    Parameters
    ----------
    system : LureSystem or Case
    input : str, optional
        The driven input; by default that of the case's own sine, or the only one.
    output : str, optional
        Name of a signal; by default the first.
    amplitude : float, optional
        Of the input, in its SI unit; by default that of the case's own sine.
    frequencies : (float, float)
        Range [Hz]; it is covered in logarithmic steps.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the inputs are held, the driven one in the mean [SI]; by default that of the case or loop.
    n_points : int
        At most so many points of a branch.
    max_step : float
        Longest step along a branch, relative to the range and the motion.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    EppError
        As :func:`forced_response`, for a range that is not one, and where no response is found.
    ModelError
        If there is no such input or output.

    References
    ----------
    Nayfeh and Mook, "Nonlinear Oscillations", 1979, section 4.1 (jumps); Allgower and Georg, "Numerical Continuation
    Methods", 1990 (pseudo-arclength); Gelb and Vander Velde, 1968, chapter 3 (describing functions).

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> loop = epp.Diagram(
    ...     parts={
    ...         "spring": epp.Saturation(lower=-1.0, upper=1.0),
    ...         "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 0.0]),
    ...     },
    ...     connect=["end - mass -> spring", "spring -> mass"],
    ...     inputs=["end"],
    ... )
    >>> found = epp.frequency_response(
    ...     loop, output="mass", amplitude=0.5, frequencies=(0.11, 0.16)
    ... )
    >>> [round(2 * np.pi * fold.frequency, 4) for fold in found.folds]
    [0.7722, 0.8325]
    """
    low, high = _range("frequency_response", "frequencies", frequencies)
    require_continuous(system_of(system, "frequency_response"), "frequency_response")
    drive = drive_of(system, input, amplitude, low, operating_point, "frequency_response")
    _closed_exactly(drive)
    limits = float(np.log(low)), float(np.log(high))
    family = DriveRange(lambda value: drive.changed(omega=2.0 * np.pi * float(np.exp(value))), limits)
    return _Response(Over.FREQUENCY, drive, family, _output(drive, output), n_points, max_step).found(system)


def amplitude_response(
    system: LureSystem | CaseLike,
    input: str | None = None,
    output: str | None = None,
    *,
    frequency: float | None = None,
    amplitudes: tuple[float, float],
    operating_point: PointLike | None = None,
    n_points: int = 400,
    max_step: float = 0.03,
) -> FrequencyResponse:
    """The response to a sine of one frequency over its amplitude, as :func:`frequency_response` has it over frequency.

    Parameters
    ----------
    system : LureSystem or Case
    input, output : str, optional
        Names of the driven input and of a signal; as in :func:`frequency_response` by default.
    frequency : float, optional
        [Hz]; by default that of the case's own sine.
    amplitudes : (float, float)
        Range, in the SI unit of the input; it is covered in logarithmic steps.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the inputs are held, the driven one in the mean [SI]; by default that of the case or loop.
    n_points : int
        At most so many points of a branch.
    max_step : float
        Longest step along a branch, relative to the range and the motion.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    EppError, ModelError
        As :func:`frequency_response`.

    References
    ----------
    As :func:`frequency_response`.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> loop = epp.Diagram(
    ...     parts={
    ...         "spring": epp.Cube(1.0),
    ...         "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 1.0]),
    ...     },
    ...     connect=["force - spring -> mass", "mass -> spring"],
    ...     inputs=["force"],
    ... )
    >>> found = epp.amplitude_response(
    ...     loop, output="mass", frequency=1.5 / (2 * np.pi), amplitudes=(0.1, 2.0)
    ... )
    >>> [str(fold.kind) for fold in found.folds]
    ['fold', 'fold']
    """
    low, high = _range("amplitude_response", "amplitudes", amplitudes)
    drive = drive_of(system, input, low, frequency, operating_point, "amplitude_response")
    limits, periods = (float(np.log(low)), float(np.log(high))), _closed_exactly(drive)
    family = DriveRange(lambda value: drive.changed(amplitude=float(np.exp(value))), limits, periods)
    return _Response(Over.AMPLITUDE, drive, family, _output(drive, output), n_points, max_step).found(system)


def _range(analysis: str, name: str, given: tuple[float, float]) -> tuple[float, float]:
    values = tuple(float(v) for v in given)
    if len(values) != 2 or not (np.all(np.isfinite(values)) and 0.0 < min(values) < max(values)):
        raise EppError(f"{analysis}: {name} is {given}; expected two different positive numbers.")
    return min(values), max(values)


def _closed_exactly(drive: Drive) -> int:
    """Periods of the input after which responses repeat themselves; refused where they are known from runs alone.

    Raises
    ------
    EppError
        With a dead time, and where samples do not come round with the input.
    """
    if why := by_runs(drive, _MOST_PERIODS):
        raise EppError(
            f"{drive.system.name} has {why}, so there is no exact response to follow; expected a loop without, or one "
            "frequency and amplitude (forced_response)."
        )
    return drive.comes_round(_MOST_PERIODS)


def _output(drive: Drive, output: str | None) -> str:
    names = drive.system.signals.names
    if output is not None and output not in names:
        raise ModelError(f"{drive.system.name} has no signal {output!r}", expected=did_you_mean(output, names))
    return names[0] if output is None else output


@dataclass
class _Response:
    """One response over a range under way; lives for one call."""

    over: Over
    drive: Drive
    family: DriveRange
    output: str
    n_points: int
    max_step: float
    walks: list[tuple[list[Place], Continuation, tuple[str, str]]] = field(default_factory=list)
    continua: list[float] = field(default_factory=list)

    def found(self, subject: LureSystem | CaseLike) -> FrequencyResponse:
        """All branches, exact and of the DF."""
        analysis = f"{self.over}_response"
        check_counts(analysis, {"n_points": (self.n_points, 2)})
        if not 0.0 < self.max_step <= 1.0:
            raise EppError(f"{analysis}: max_step is {self.max_step}; expected more than 0 and 1 at most.")
        for share in _SOUGHT:
            self._sought((1.0 - share) * self.family.limits[0] + share * self.family.limits[1])
        if not self.walks:
            what = "only a continuum of periodic responses" if self.continua else "no periodic response"
            raise EppError(
                f"{analysis}: {what} of {self.drive.system.name} was found in the range; expected one to follow "
                "(forced_response computes one sine)."
            )
        exact = sorted((self._branch(*walk) for walk in self.walks), key=len, reverse=True)
        settings = {
            "system": self.drive.system.name,
            "limits": np.exp(self.family.limits).tolist(),
            "over": self.over.value,
        }
        settings |= {"amplitude": self.drive.amplitude} if self.over is Over.FREQUENCY else {}
        settings |= {"frequency": self.drive.frequency} if self.over is Over.AMPLITUDE else {}
        whole = not self.continua and not any(_within(end) for b in exact for end in b.ends)
        units = self.drive.system.signals.units_by_name()
        return FrequencyResponse(
            input=self.drive.input,
            output=self.output,
            over=self.over,
            branches=tuple(exact),
            first_order=self._first_order(),
            status=Status.CONVERGED if whole else Status.INCOMPLETE,
            message=self._sentence(exact, whole),
            units={name: units.get(name, "") for name in (self.drive.input, self.output)},
            provenance=Provenance(
                METHOD,
                settings,
                {"residual": CLOSED},
                case=facts_of(subject),
            ),
            operating_point=self.drive.at,
        )

    def _sought(self, value: float) -> None:
        """Branches of the responses at a value that no branch comes through yet."""
        for response in some_responses(self.family.drive(value), self.family.multiple):
            if response.one_of_many:  # between which there is nothing to choose
                self.continua += [value] if value not in self.continua else []
                continue
            if len(self.walks) < _MOST_BRANCHES and not any(self._passes(w[0], value, response) for w in self.walks):
                walk = Continuation(self.family, self.n_points, self.max_step)
                try:
                    places, ends = walk.both_ways(value, response)
                except np.linalg.LinAlgError:
                    continue
                self.walks.append((places, walk, ends))

    def _passes(self, places: list[Place], value: float, response: SteadyMotion) -> bool:
        search = Search(self.family.drive(value), self.family.multiple)
        for one, other in zip(places[:-1], places[1:], strict=True):
            if (one.value - value) * (other.value - value) <= 0:
                there = between(self.family, one, other, value)
                if there is not None and search.same(there.motion, response, self.family.multiple):
                    return True
        return False

    def _branch(self, places: list[Place], walk: Continuation, ends: tuple[str, str]) -> ResponseBranch:
        response, size = np.array([self._of(p) for p in places]).T
        special = tuple(SpecialResponse(kind, *self._sine(p.value), response[i], i) for kind, p, i in walk.special)
        frequency, amplitude = np.array([self._sine(p.value) for p in places]).T
        stable = np.array([p.stable for p in places])
        stable[[i for *_, i in walk.special]] = False  # where a multiplier is on the unit circle, but for rounding
        return ResponseBranch(
            method=EXACT_ORBIT,
            frequency=frequency,
            amplitude=amplitude,
            response=response,
            peak_to_peak=size.real,
            stable=stable,
            multiplier=np.array([p.multiplier for p in places]),
            special=special,
            ends=ends,
        )

    def _sine(self, value: float) -> tuple[float, float]:
        drive = self.family.drive(value)
        return drive.frequency, drive.amplitude

    def _of(self, there: Place) -> tuple[complex, float]:
        """Complex gain and peak-to-peak of the output."""
        found = periodic_response(self.family.drive(there.value), self.family.multiple, there.motion)
        return found.response(self.output), found.cycle.peak_to_peak[self.output]

    def _first_order(self) -> tuple[ResponseBranch, ...]:
        branches = sinusoid_branches(self.family.drive, self.family.limits)
        return tuple(self._first_order_branch(*branch) for branch in branches if len(branch[1]) > 1)

    def _first_order_branch(self, values: Array, there: list[Sinusoid]) -> ResponseBranch:
        frequency, amplitude = np.array([self._sine(float(v)) for v in values]).T
        response = np.array([one.response(self.output) for one in there])
        return ResponseBranch("describing function", frequency, amplitude, response, 2.0 * np.abs(response) * amplitude)

    def _sentence(self, exact: list[ResponseBranch], whole: bool) -> str:
        low, high = (float(v) for v in np.exp(self.family.limits))
        of, unit = quantity(self.drive.amplitude, self.drive.unit), self.drive.unit
        what = f"of amplitude {of} from {number(low)} to {number(high)} Hz"
        if self.over is Over.AMPLITUDE:
            what = f"of {number(self.drive.frequency)} Hz, from {quantity(low, unit)} to {quantity(high, unit)},"
        folds = sorted((s for b in exact for s in b.folds), key=lambda s: float(getattr(s, self.over)))
        where = listed([self._where(fold) for fold in folds])
        parts = [
            f"Response of {words(self.output)} " + (f"jumps at {where}" if folds else "does not jump"),
            f"{count(len(exact), 'branch')} under a sine {what} at {words(self.drive.input)}",
            *(f"{s.kind} at {self._where(s)}" for b in exact for s in b.special if s.kind != Change.FOLD),
        ]
        if not whole:
            parts += [f"a branch {end}" for end in dict.fromkeys(e for b in exact for e in b.ends if _within(e))]
        if self.continua:
            places = ", ".join(self._at(*self._sine(v)) for v in sorted(self.continua))
            parts.append(f"a continuum of responses, which is not followed, at {places}")
        return "; ".join(parts) + "."

    def _where(self, special: SpecialResponse) -> str:
        return self._at(special.frequency, special.amplitude)

    def _at(self, frequency: float, amplitude: float) -> str:
        return f"{number(frequency)} Hz" if self.over is Over.FREQUENCY else quantity(amplitude, self.drive.unit)


def _within(end: str) -> bool:
    """Whether a branch ends within the range."""
    return end.startswith(("ends", "stops"))
