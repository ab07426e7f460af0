"""The ladder: the methods side by side for one loop, with their errors, and a sentence on what they mean together.

The rungs themselves (the DF, harmonic balance, exact orbit, simulation) are in ``rungs``. The DF can be wrong
in both directions, so every predicted cycle is put to the test: a run is started on it and another a fifth below and
above it. What these runs do tells a cycle that exists but is not reached from this start, one that a lower cycle
guards, and one that only the approximation has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.errors import EppError
from eppanalysis.methods.comparison.rungs import (
    FACTOR,
    Climb,
    Clock,
    Rung,
    climb,
    distance,
    largest_harmonic,
    load_methods,
)
from eppanalysis.methods.comparison.sentences import cycle_sentences, error_sentences, missed_sentences
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.models.systems.inputs import Constant, InputSignal
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.subject import CaseLike, require_case
from eppanalysis.readable import words
from eppanalysis.results import (
    DESCRIBING_FUNCTION,
    EXACT_ORBIT,
    HARMONIC_BALANCE,
    LimitCycle,
    Outcome,
    Prediction,
    Result,
    Status,
    Trajectory,
    counted,
)
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


#: Errors of the DF, in frequency and in size, up to which prediction and simulation are said to agree.
_AGREES = 0.1


_LEFT_OPEN = "; the run itself is undecided by its end"


class Agreement(Enum):
    """What prediction and simulation mean together."""

    AGREE = (
        f"Prediction and simulation agree within {100 * _AGREES:g} %: "
        "the run settles on the stable cycle that the describing function predicts."
    )
    ROUGH = (
        "The run settles on the stable cycle that the describing function predicts, but the prediction is off by more "
        f"than {100 * _AGREES:g} % in frequency or size."
    )
    FREE = "Prediction and simulation agree: no stable limit cycle is predicted, and the run settles at rest."
    BASIN_BOUNDARY = (
        "A stable cycle exists as predicted, but this start does not reach it: an unstable cycle lies on the basin "
        "boundary of rest."
    )
    AT_REST = (
        "A stable cycle exists as predicted, but this start does not reach it: the run ends at rest, "
        "and no unstable cycle is known between the two; simulate from a disturbed start."
    )
    NOT_PREDICTED = "The run is on a limit cycle that the describing function does not predict; trust the simulation."
    NOT_THERE = (
        "The describing function predicts a stable cycle, but no such cycle exists: "
        "runs started on it, below it and above it all leave it."
    )
    MISSED = (
        "The describing function misses stable limit cycles that the exact search finds. The run is on none of them "
        "by its end."
    )
    CONFIRMED = f"The exact search confirms what the describing function predicts{_LEFT_OPEN}, so simulate for longer."
    CONFIRMED_STABLE = (
        "The exact search confirms the stable cycle that the describing function predicts, but not every unstable "
        f"one to within {100 * _AGREES:g} %{_LEFT_OPEN}, simulate for longer to see the stable one there."
    )
    NONE_STABLE = (
        "The describing function predicts no stable cycle and the exact search finds none, but unstable ones differ "
        f"by more than {100 * _AGREES:g} %{_LEFT_OPEN}, simulate for longer."
    )
    FOUND = (
        f"The exact search finds the stable cycle that the describing function predicts, with an error above "
        f"{100 * _AGREES:g} % in frequency or size{_LEFT_OPEN}, simulate for longer to see it there."
    )
    UNDECIDED = (
        "The run is undecided by its end, so the prediction is neither confirmed nor refuted; simulate for longer."
    )
    DRIVEN = "An input varies, so there is no limit cycle to predict; only the run is computed."
    NO_PREDICTION = "An element has no describing function, so no cycle of this loop is predicted."

    def sentence(self, status: Status) -> str:
        """What is said beside a run that ends so: none that grows without bound has to be made longer."""
        if status is not Status.DIVERGED:
            return self.value
        if self is Agreement.UNDECIDED:
            return "The run grows without bound, so the prediction is neither confirmed nor refuted."
        lead, left_open, _ = self.value.partition(_LEFT_OPEN)
        return f"{lead}; the run itself grows without bound." if left_open else self.value


@dataclass(frozen=True)
class Probe:
    """A run started on, below or above a predicted cycle, and where it went."""

    cycle: int  # number of the predicted cycle
    scale: float  # factor on its oscillation at the start
    status: Status
    peak_to_peak: float  # of the ladder's signal on the cycle reached; 0 at rest, nan when undecided


@dataclass(frozen=True, eq=False, repr=False)
class Ladder(Result):
    """A limit cycle by all methods side by side: describing function, harmonic balance, exact orbit, run.

    Attributes
    ----------
    signal : str
        The signal that rows and pictures show.
    prediction : Prediction or None
        Cycles that the describing function predicts; None without one.
    run : Trajectory
        The case's own run.
    matched : int or None
        Number of the predicted cycle that the run is on.
    missed : tuple of int
        Numbers of the stable exact cycles (of `search`) that the describing function does not predict.
    errors : dict of str to dict of str to float
        For the matched cycle: relative errors of "peak_to_peak", "fundamental" and "mean" (the last relative to the
        peak-to-peak) of every named signal, and of the frequency under "frequency".
    oscillations : int
        Oscillations of the signal within one period of the run's cycle (its largest harmonic); frequencies are compared
        oscillation by oscillation.
    probes : tuple of Probe
        Runs that begin on, below or above a predicted cycle, and where they went.
    probe_seconds : float
        How long all probes took.
    agreement : Agreement
        What prediction and run say of each other.
    verdict : str
        Plain sentences.
    rows : tuple of Rung
        Describing function, harmonic balance, exact orbit and simulation of every cycle, with time and error of each.
    search : CycleSearch or None
        All exact cycles; None where the search is refused.
    search_seconds : float
        How long the search for them took.
    operating_point : OperatingPoint or None
        Values of the external inputs at the end of the run, or why they are not constant.
    """

    signal: str
    prediction: Prediction | None
    run: Trajectory
    matched: int | None
    errors: dict[str, dict[str, float]]
    probes: tuple[Probe, ...]
    agreement: Agreement
    verdict: str
    rows: tuple[Rung, ...]
    units: dict[str, str]
    missed: tuple[int, ...] = ()
    oscillations: int = 1
    probe_seconds: float = 0.0
    search: CycleSearch | None = None
    search_seconds: float = 0.0

    in_json = (
        "outcome agreement verdict signal matched missed oscillations errors prediction simulation=run probes "
        "exact=search rows operating_point provenance"
    )

    @property
    def outcome(self) -> Outcome:
        """What the run did."""
        return Outcome.of(self.run.status)

    @property
    def balance(self) -> LimitCycle | None:
        """The harmonic balance of the cycle that the run is on, if there is one."""
        here = self.rows[-1].exact
        found = (r.cycle for r in self.rows if r.method.startswith(HARMONIC_BALANCE) and r.exact == here)
        return next(found, None) if here is not None else None

    def __str__(self) -> str:
        """What the run does, what exact cycles there are, and what the DF says of them."""
        cycle = self.run.limit_cycle
        run = str(self.run) if cycle is None else f"Oscillates: {cycle.size_of(self.signal)}."
        first = [*error_sentences(self.errors, self.signal), *missed_sentences(self.missed, self.search)]
        return " ".join([*self._exactly(run), self.agreement.sentence(self.run.status), *first])

    def _exactly(self, run: str) -> list[str]:
        """What the run and the exact search find, and first what tells more: a cycle, or that there is none."""
        if self.search is None or self.run.limit_cycle is not None:
            return [run, *self._exact_sentence()]
        if any(found.stable for found in self.search):
            return [f"Can oscillate: {counted(self.search.cycles, self.signal)}.", run, *self.search.doubts()]
        undecided = self.run.status is Status.UNDECIDED
        return [f"{self.search.headline()}.", run] if undecided else [run, *self._exact_sentence()]

    def _exact_sentence(self) -> list[str]:
        """What the search finds, exactly or from runs alone; a cycle that the run is on is not repeated."""
        if self.search is None:
            return []
        run, found = self.run.limit_cycle, self.search.cycles
        alone = run is not None and len(found) == 1 and found[0].size_of(self.signal) == run.size_of(self.signal)
        said = "this limit cycle and no other" if alone else counted(found, self.signal)
        search = "exact search" if all(cycle.method == EXACT_ORBIT for cycle in found) else "search by runs"
        return [f"The {search} finds {said}.", *self.search.doubts()]

    def to_frame(self) -> pandas.DataFrame:
        """The methods, one a row: the cycle of each, how far it is off, and how long it took [s]."""
        rows = [
            {
                "exact cycle": None if row.exact is None else str(row.exact + 1),
                "method": row.method,
                "frequency": row.quantities["frequency"],
                **{f"{self.signal} {words(name)}": row.quantities[name] for name in ("peak-to-peak", "mean")},
                **{f"error of {words(name)}": row.errors.get(name) for name in ("period", "peak-to-peak")},
                "seconds": row.seconds,
            }
            for row in self.rows
        ]
        unit = self.run.units.get(self.signal, "")
        sizes = dict.fromkeys((f"{self.signal} peak to peak", f"{self.signal} mean"), unit)
        return frame_of(rows, {"frequency": "Hz", "seconds": "s", **sizes})

    def in_brief(self) -> pandas.DataFrame:
        """The methods with their size, speed and errors in per cent."""
        frame = self.to_frame().drop(columns=["seconds", f"{self.signal} mean"])
        for name in ("period", "peak-to-peak"):
            frame[f"error of {words(name)}"] = [row.error_of(name) for row in self.rows]
        return frame

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The run, its cycle beside the predicted one, and the verdict."""
        return self.drawn("plot_ladder", ax)


class _Expected(Protocol):
    @property
    def signal(self) -> str | None: ...


class _ExpectingCase(CaseLike, Protocol):
    """What the ladder needs of a case besides."""

    @property
    def expected(self) -> _Expected: ...
    def provenance(self) -> dict[str, Any]: ...


def ladder(case: _ExpectingCase | LureSystem) -> Ladder:
    """Predict, simulate and compare.

    Parameters
    ----------
    case : Case or LureSystem

    Returns
    -------
    Ladder

    Raises
    ------
    EppError
        If the loop can be neither predicted nor simulated.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> result = epp.ladder(epp.case("relay_ideal_khalil79"))
    >>> result.agreement.name, round(100 * result.errors["frequency"]["frequency"], 1)
    ('AGREE', 2.4)
    """
    case = require_case(case, "ladder")
    system, at = case.to_system(), case.operating_point
    signal = case.expected.signal or system.signals.names[0]
    load_methods()
    clock = Clock()
    prediction, why_not = _predict(system, at)
    predict_seconds = clock.lap()
    run = simulate(case)
    run_seconds = clock.lap()
    cycles = prediction.cycles if prediction else ()
    matched = _match(cycles, run.limit_cycle, signal)
    held = {n: Constant(at.inputs[n] - float(v)) for n, v in zip(system.input_names, system.v0, strict=True)}
    probes = _probes(system, cycles, held, case.t_end, signal)
    probe_seconds = clock.lap()
    oscillations = largest_harmonic(run.limit_cycle, signal) if run.limit_cycle else 1
    errors = _errors(cycles[matched], run.limit_cycle, oscillations) if matched is not None and run.limit_cycle else {}
    found = climb(system, at, (prediction, predict_seconds), (run, run_seconds), signal)
    stays = bool(_confirmed(probes, cycles, signal))
    agreement = _agreement(prediction, run, matched, stays, found) if at.stands else Agreement.DRIVEN
    if agreement is Agreement.AGREE and not _agrees(errors, signal):
        agreement = Agreement.ROUGH
    reasons = [why_not] if why_not and at.stands else []
    sentences = [agreement.sentence(run.status), *reasons, *cycle_sentences(run.limit_cycle, errors, signal)]
    missed = missed_sentences(found.missed, found.search)
    return Ladder(
        signal=signal,
        prediction=prediction,
        run=run,
        matched=matched,
        errors=errors,
        oscillations=oscillations,
        probes=probes,
        probe_seconds=probe_seconds,
        agreement=agreement,
        missed=found.missed,
        verdict=" ".join([*sentences, *_probe_sentences(probes, cycles), found.sentence, *missed]),
        rows=found.rows,
        search=found.search,
        search_seconds=found.search_seconds,
        units={"frequency": "Hz", "peak-to-peak": run.units.get(signal, ""), "mean": run.units.get(signal, "")},
        provenance=Provenance("ladder", {"t_end": case.t_end}, case=case.provenance()),
        operating_point=at,
    )


def _predict(system: LureSystem, at: OperatingPoint) -> tuple[Prediction | None, str]:
    try:
        return predict_limit_cycles(system, at), ""
    except EppError as error:
        return None, str(error)


def _match(cycles: tuple[LimitCycle, ...], reached: LimitCycle | None, signal: str) -> int | None:
    """The stable predicted cycle nearest to the one reached, if it is within a factor of two in frequency and size."""
    if reached is None:
        return None
    near = {i: distance(c, reached, signal) for i, c in enumerate(cycles) if c.stable is not False}
    best = min(near, key=lambda i: near[i], default=None)
    return best if best is not None and near[best] < np.log(FACTOR) else None


def _probes(
    system: LureSystem, cycles: tuple[LimitCycle, ...], held: Mapping[str, InputSignal], t_end: float, signal: str
) -> tuple[Probe, ...]:
    """Runs from the predicted cycles: stable ones from on, below and above; unstable ones from below and above."""
    out = []
    for i, cycle in enumerate(cycles):
        middle = cycle.mean_state
        if not middle.size or cycle.state.size != system.A.shape[0]:
            continue
        for scale in (0.8, 1.0, 1.25) if cycle.stable else (0.5, 2.0):
            x0 = middle + scale * (cycle.state - middle)
            start = replace(system, x0=x0, memory=cycle.memory)
            run = simulate(start, held, max(t_end, 60 * cycle.period), t_eval=[0.0])
            size = {Status.SETTLED: 0.0}.get(run.status, float("nan"))
            out.append(Probe(i, scale, run.status, run.limit_cycle.peak_to_peak[signal] if run.limit_cycle else size))
    return tuple(out)


def _errors(predicted: LimitCycle, reached: LimitCycle, oscillations: int) -> dict[str, dict[str, float]]:
    """Relative errors of the prediction, signal by signal; nan where there is nothing to compare with."""
    out = {"frequency": {"frequency": predicted.frequency / (oscillations * reached.frequency) - 1.0}}
    for name, size in reached.peak_to_peak.items():
        if not size > 0:
            continue
        fundamental = (
            float(abs(reached.harmonics[name][oscillations])) if len(reached.harmonics[name]) > oscillations else 0.0
        )
        # A mean may be zero: its error is relative to the size.
        out[name] = {
            "peak_to_peak": predicted.peak_to_peak[name] / size - 1.0,
            "fundamental": predicted.amplitude(name) / fundamental - 1.0 if fundamental > 0 else float("nan"),
            "mean": (predicted.mean[name] - reached.mean[name]) / size,
        }
    return out


def _confirmed(probes: tuple[Probe, ...], cycles: tuple[LimitCycle, ...], signal: str) -> set[int]:
    """Predicted stable cycles near which a run stays."""
    out = set()
    for p in probes:
        size = cycles[p.cycle].peak_to_peak[signal]
        if cycles[p.cycle].stable and p.status is Status.LIMIT_CYCLE and 0.5 < p.peak_to_peak / max(size, 1e-300) < 2.0:
            out.add(p.cycle)
    return out


def _agreement(
    prediction: Prediction | None, run: Trajectory, matched: int | None, stays: bool, found: Climb
) -> Agreement:
    """What it all means: `stays` says whether a run started near a predicted stable cycle stays there."""
    if prediction is None:
        return Agreement.NO_PREDICTION
    if run.status is Status.LIMIT_CYCLE:
        return Agreement.AGREE if matched is not None else Agreement.NOT_PREDICTED
    predicted = any(c.stable for c in prediction.cycles)
    # A stable cycle that the DF misses outweighs a run at rest, which another start would have taken to it.
    if found.missed and not (stays or found.confirmed):
        return Agreement.MISSED
    if run.status is not Status.SETTLED:
        return _by_search(predicted, found)
    if not predicted:
        return Agreement.FREE
    if not (stays or found.confirmed):
        return Agreement.NOT_THERE
    known = found.search.cycles if found.search is not None else prediction.cycles
    return Agreement.BASIN_BOUNDARY if any(c.stable is False for c in known) else Agreement.AT_REST


def _by_search(predicted: bool, found: Climb) -> Agreement:
    """What the exact search says of the prediction where the run says nothing."""
    if found.search is None:
        return Agreement.UNDECIDED
    if found.missed:
        return Agreement.MISSED
    if not (found.confirmed if predicted else found.search.status.ok):
        return Agreement.UNDECIDED
    off = [row.cycle for row in found.rows if row.cycle is not None and _is_far_off(row)]
    if not off:
        return Agreement.CONFIRMED
    if not predicted:
        return Agreement.NONE_STABLE
    return Agreement.FOUND if any(cycle.stable for cycle in off) else Agreement.CONFIRMED_STABLE


def _is_far_off(row: Rung) -> bool:
    """Whether a rung is a cycle of the DF that no exact one is near; one that may not exist need not have one."""
    if not row.method.startswith(DESCRIBING_FUNCTION) or row.cycle is None:
        return False
    if row.exact is None:
        return not row.cycle.may_not_exist
    return max(map(abs, row.errors.values())) > _AGREES


def _agrees(errors: dict[str, dict[str, float]], signal: str) -> bool:
    """Whether the DF is near the matched cycle in frequency and in the size of the signal."""
    off = errors["frequency"]["frequency"], errors.get(signal, {}).get("peak_to_peak", 0.0)
    return max(map(abs, off)) <= _AGREES


def _probe_sentences(probes: tuple[Probe, ...], cycles: tuple[LimitCycle, ...]) -> list[str]:
    """What the runs beside the unstable cycles say of them."""
    out = []
    for i, cycle in enumerate(cycles):
        below = [p for p in probes if p.cycle == i and p.scale < 1]
        above = [p for p in probes if p.cycle == i and p.scale > 1]
        if cycle.stable is False and below and above:
            same = _same(below[0], above[0])
            meaning, end = (
                ("is on no basin boundary here", "alike") if same else (("is on a basin boundary"), "differently")
            )
            out.append(
                f"The unstable cycle predicted at {cycle.frequency:.4g} Hz {meaning}: "
                f"runs started at half and at twice its size end {end}."
            )
    return out


def _same(a: Probe, b: Probe) -> bool:
    if a.status is not b.status:
        return False
    return a.status is not Status.LIMIT_CYCLE or abs(a.peak_to_peak - b.peak_to_peak) <= 1e-3 * abs(b.peak_to_peak)
