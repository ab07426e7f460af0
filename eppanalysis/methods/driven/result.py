"""What driven loops return: periodic responses to one sine, and responses over frequency or amplitude."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.errors import EppError, shown
from eppanalysis.methods.steady.changes import Change
from eppanalysis.results import Brief, LimitCycle, Listing, Result, Status

if TYPE_CHECKING:
    import control
    import pandas
    from matplotlib.axes import Axes


class Motion(StrEnum):
    """How a driven run goes on in the end."""

    PERIODIC = "periodic"
    QUASI_PERIODIC = "quasi-periodic"
    IRREGULAR = "irregular"
    UNDECIDED = "undecided"


class Over(StrEnum):
    """What runs along a branch of periodic responses: a property of the sine."""

    FREQUENCY = "frequency"
    AMPLITUDE = "amplitude"


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicResponse(Brief):
    """A motion that repeats itself after a whole number of the input's periods.

    Attributes
    ----------
    multiple : int
        That number: 1 where the loop follows the input, more for a subharmonic.
    phase : float
        Phase of the input at the beginning of `cycle` [rad]; zero unless an element switches just there.
    amplitude : float
        Of the input, in its SI unit.
    cycle : LimitCycle
        The motion: waveform, harmonics (those of the input are the `multiple`-th), Floquet multipliers, events, state.
    one_of_many : bool
        Whether it is one of a continuum (a play that stays within its gap, a free position).
    """

    multiple: int
    phase: float
    amplitude: float
    cycle: LimitCycle
    one_of_many: bool = False

    in_json = "multiple phase amplitude stable responses one_of_many cycle"

    @property
    def stable(self) -> bool:
        """Whether all Floquet multipliers lie inside the unit circle, or a run has come to it."""
        return bool(self.cycle.stable)

    @property
    def largest_multiplier(self) -> float:
        """Largest magnitude of the Floquet multipliers; 0 where every disturbance vanishes within a period, nan where
        a run alone has found the response.
        """
        values = self.cycle.multipliers
        return float("nan") if values is None else float(np.max(np.abs(values), initial=0.0))

    @property
    def responses(self) -> dict[str, complex]:
        """:meth:`response` of every signal."""
        return {name: self.response(name) for name in self.cycle.harmonics}

    @checked
    def response(self, signal: str) -> complex:
        """Component of a signal at the input's frequency over the input, as a complex gain.

        Raises
        ------
        EppError
            If there is no such signal.
        """
        self.cycle.amplitude(signal)  # refuses a signal that is not known
        c = self.cycle.harmonics[signal][self.multiple]
        # The sine of the input, whose phase at the begin is `phase`, is the real part of -j exp(j (phase + omega t)).
        return complex(1j * c * np.exp(-1j * self.phase) / self.amplitude)


@dataclass(frozen=True, eq=False, repr=False)
class ForcedResponse(Listing[PeriodicResponse]):
    """Periodic responses of a loop to one sine: a sequence of PeriodicResponse.

    Attributes
    ----------
    input : str
        Name of the driven input.
    amplitude : float
        Of the sine, in the input's SI unit.
    frequency : float
        Of the sine [Hz].
    responses : tuple of PeriodicResponse
        Those that follow the input first, then subharmonics; of each by size.
    motion : Motion
        How the run from the loop's own start goes on.
    repeats : int
        After how many periods of the input it repeats itself: 1 where it follows the input; 0 where it does not.
    exponent : float
        Of a run that does not repeat itself: the rate at which neighbouring motions part, per period of the input
        (positive: irregular motion, zero: quasi-periodic); nan otherwise.
    status : Status
        NOT_CONVERGED where no periodic response was found.
    message : str
        What was found, and what was not, in sentences.
    first_order : dict of str to complex array
        Complex gains predicted by describing functions, by signal, one for each of their solutions; empty where there
        are none.
    beat : float
        Beat period [s] of a weak sine with the loop's own oscillation, by Adler's law: of n periods of the one beside m
        of the other. nan where the run has come to no such oscillation, or keeps step.
    tongue : (float, float)
        Frequencies between which a weak sine entrains the oscillation that the run has come to, by Adler's law [Hz];
        nan where that law, linear in the sine, knows none.
    """

    input: str
    amplitude: float
    frequency: float
    responses: tuple[PeriodicResponse, ...]
    motion: Motion
    repeats: int
    exponent: float
    status: Status
    message: str
    first_order: dict[str, ComplexArray] = field(default_factory=dict)
    beat: float = float("nan")
    tongue: tuple[float, float] = (float("nan"), float("nan"))

    parts = "responses"
    in_json = (
        "input amplitude frequency status message motion repeats exponent beat tongue responses "
        "describing_function=first_order operating_point provenance"
    )

    @property
    def stable(self) -> tuple[PeriodicResponse, ...]:
        """The stable responses."""
        return tuple(r for r in self.responses if r.stable)

    def __str__(self) -> str:
        return self.message

    def to_frame(self) -> pandas.DataFrame:
        """One row a response: multiple, stability, largest multiplier, and of every signal the complex gain at the
        input's frequency and the peak-to-peak [SI].
        """
        import pandas

        return pandas.DataFrame([_row(r) for r in self.responses])

    @checked
    def plot(self, ax: Axes | None = None, signals: list[str] | None = None) -> Axes:
        """Waveforms of all responses over one of their periods, one panel a signal."""
        return self.drawn("plot_forced_response", ax, signals)


def _row(r: PeriodicResponse) -> dict[str, Any]:
    row: dict[str, Any] = {"multiple": r.multiple, "stable": r.stable, "multiplier": r.largest_multiplier}
    row |= {f"{name}.response": value for name, value in r.responses.items()}
    return row | {f"{name}.peak_to_peak": value for name, value in r.cycle.peak_to_peak.items()}


@dataclass(frozen=True, eq=False, repr=False)
class SpecialResponse(Brief):
    """A point of a branch where something changes.

    Attributes
    ----------
    kind : Change
        "fold", "period doubling", "torus" (quasi-periodic motions leave the branch) or "branch point".
    frequency : float
        Of the input [Hz].
    amplitude : float
        Of the input [SI].
    response : complex
        Gain of the output there.
    index : int
        Number of the branch's point that it is.
    """

    kind: Change
    frequency: float
    amplitude: float
    response: complex
    index: int


@dataclass(frozen=True, eq=False, repr=False)
class ResponseBranch(Brief):
    """Periodic responses along a branch, in its own order.

    Attributes
    ----------
    method : str
        "exact orbit" or "describing function".
    frequency : array, shape (k,)
        Of the input [Hz].
    amplitude : array, shape (k,)
        Of the input [SI].
    response : complex array, shape (k,)
        Component of the output at the input's frequency over the input.
    peak_to_peak : array, shape (k,)
        Of the output [SI]; of a describing function twice the amplitude of its sine.
    stable : bool array, shape (k,)
        Of exact responses; empty for describing functions, which do not tell.
    multiplier : array, shape (k,)
        Largest magnitude of the Floquet multipliers; empty for describing functions.
    special : tuple of SpecialResponse
        Folds and changes of stability, in the order of the branch.
    ends : (str, str)
        How it ends at its first and at its last point.
    """

    method: str
    frequency: Array
    amplitude: Array
    response: ComplexArray
    peak_to_peak: Array
    stable: BoolArray = field(default_factory=lambda: np.zeros(0, bool))
    multiplier: Array = field(default_factory=lambda: np.zeros(0))
    special: tuple[SpecialResponse, ...] = ()
    ends: tuple[str, str] = ("", "")

    def __len__(self) -> int:
        return int(self.frequency.size)

    @property
    def folds(self) -> tuple[SpecialResponse, ...]:
        """Where the branch turns back: a stable and an unstable response meet, and the motion jumps."""
        return tuple(s for s in self.special if s.kind == Change.FOLD)

    def parts(self, over: Over = Over.FREQUENCY) -> list[slice]:
        """Stretches between the folds, on which there is one response for each frequency (or amplitude)."""
        value = getattr(self, over)
        turns = np.flatnonzero(np.diff(np.sign(np.diff(value))) != 0) + 1
        edges = [0, *turns.tolist(), len(self) - 1]
        return [slice(a, b + 1) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a or len(self) == 1]


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Result):
    """Periodic responses of a loop to a sine, over its frequency or over its amplitude.

    Attributes
    ----------
    input, output : str
        Names of the driven input and of the signal.
    over : Over
        "frequency" or "amplitude".
    branches : tuple of ResponseBranch
        Exact responses, the longest branch first.
    first_order : tuple of ResponseBranch
        Predictions of describing functions beside them; empty where there are none.
    status : Status
        INCOMPLETE where a branch ends within the range.
    message : str
        How the branches end, in sentences.
    units : dict of str to str
        SI units of input and output, by their names.
    """

    input: str
    output: str
    over: Over
    branches: tuple[ResponseBranch, ...]
    first_order: tuple[ResponseBranch, ...]
    status: Status
    message: str
    units: dict[str, str] = field(default_factory=dict)

    in_json = (
        "input output over status message branches describing_function=first_order units operating_point provenance"
    )

    def __str__(self) -> str:
        return self.message

    @property
    def folds(self) -> tuple[SpecialResponse, ...]:
        """The folds of all branches, in the order of what runs."""
        found = [s for branch in self.branches for s in branch.folds]
        return tuple(sorted(found, key=lambda s: getattr(s, self.over)))

    def to_frame(self) -> pandas.DataFrame:
        """One row a point: method, branch, frequency [Hz], amplitude [SI], gain, phase [rad], peak-to-peak [SI],
        stable, multiplier.
        """
        import pandas

        frames = []
        for number, branch in enumerate((*self.branches, *self.first_order)):
            known = branch.stable.size > 0
            columns = {
                "method": branch.method,
                "branch": number,
                "frequency": branch.frequency,
                "amplitude": branch.amplitude,
                "gain": np.abs(branch.response),
                "phase": np.unwrap(np.angle(branch.response)),
                "peak_to_peak": branch.peak_to_peak,
                "stable": branch.stable if known else None,
                "multiplier": branch.multiplier if known else np.nan,
            }
            frames.append(pandas.DataFrame(columns))
        return pandas.concat(frames, ignore_index=True)

    @checked
    def to_control(self, part: int | None = None) -> control.FrequencyResponseData:
        """A single-valued part of the first branch as python-control's frequency response.

        Parameters
        ----------
        part : int, optional
            Number of the stretch between folds; only to be left out where the branch has no fold.

        Raises
        ------
        EppError
            If the response runs over the amplitude, or the branch has several parts and none is named.
        """
        import control

        if self.over is not Over.FREQUENCY:
            raise EppError("to_control: the response runs over the amplitude; expected one over the frequency.")
        branch = self.branches[0]
        parts = branch.parts()
        if part is None and len(parts) > 1:
            ends = "; ".join(
                f"{i}: {branch.frequency[p][0]:.6g} to {branch.frequency[p][-1]:.6g} Hz" for i, p in enumerate(parts)
            )
            raise EppError(f"to_control: the response has {len(parts)} values in places; expected the part ({ends}).")
        if part is not None and not 0 <= part < len(parts):
            raise EppError(f"to_control: part is {shown(part)}; expected 0 to {len(parts) - 1}.")
        stretch = parts[part or 0]
        order = np.argsort(branch.frequency[stretch])
        omega = 2.0 * np.pi * branch.frequency[stretch][order]
        names: dict[str, Any] = {"inputs": [self.input.replace(".", "_")], "outputs": [self.output.replace(".", "_")]}
        return control.FrequencyResponseData(branch.response[stretch][order], omega, **names)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Gain and phase over what runs: stable solid, unstable dashed, folds marked, describing function thin."""
        return self.drawn("plot_frequency_response", ax)
