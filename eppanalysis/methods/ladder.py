"""The ladder: the methods side by side for one loop, with their errors, and a sentence on what they mean together.

First order can be wrong in both directions, so every predicted cycle is put to the test: a run is started on it and
another a fifth below and above it. What these runs do tells a cycle that exists but is not reached from this start, one
that a lower cycle guards, and one that only the approximation has.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.describing import predict_limit_cycles
from eppanalysis.methods.simulate import simulate
from eppanalysis.models.lure import LureSystem
from eppanalysis.models.signals import Constant, Motion
from eppanalysis.provenance import provenance
from eppanalysis.results import LimitCycle, Prediction, Status, Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Agreement(Enum):
    """What prediction and simulation mean together."""

    AGREE = "Prediction and simulation agree: the run settles on the stable cycle that first order predicts."
    FREE = "Prediction and simulation agree: first order has no limit cycle, and the run settles at rest."
    GUARDED = "A stable cycle exists as predicted, but this start does not reach it: an unstable cycle guards the resting state."
    NOT_PREDICTED = "The run is on a limit cycle that first order does not predict; trust the simulation."
    NOT_THERE = "First order predicts a stable cycle, but no such cycle exists: runs started on it, below it and above it all leave it."
    UNDECIDED = (
        "The run is undecided by its end, so the prediction is neither confirmed nor refuted; simulate for longer."
    )
    NO_PREDICTION = "An element has no describing function, so there is only the simulation."


@dataclass(frozen=True)
class Rung:
    """One row of the ladder: a method, what it gives (None where it gives nothing), and how long it took [s]."""

    method: str
    quantities: dict[str, float | None]
    seconds: float
    note: str = ""


@dataclass(frozen=True)
class Probe:
    """A run started on, below or above a predicted cycle, and where it went.

    Attributes
    ----------
    cycle : int
        Number of the predicted cycle.
    scale : float
        Factor on its oscillation at the start.
    status : Status
    peak_to_peak : float
        Of the ladder's signal on the cycle reached; 0 at rest, nan when undecided.
    """

    cycle: int
    scale: float
    status: Status
    peak_to_peak: float


@dataclass(frozen=True, eq=False)
class Ladder:
    """All methods side by side.

    Attributes
    ----------
    signal : str
        The signal that rows and pictures show.
    prediction : Prediction or None
    run : Trajectory
    matched : int or None
        Number of the predicted cycle that the run is on.
    errors : dict of str to dict of str to float
        For the matched cycle: relative errors of "peak_to_peak", "fundamental" and "mean" (the last relative to the
        peak-to-peak) of every named signal, and of the frequency under "frequency".
    probes : tuple of Probe
    agreement : Agreement
    verdict : str
        Plain sentences.
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
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """What the run did: "oscillate", "settle" or "undecided"."""
        return {Status.LIMIT_CYCLE: "oscillate", Status.SETTLED: "settle"}.get(self.run.status, "undecided")

    def to_dict(self) -> dict[str, Any]:
        """Plain data in SI units, as ``--json`` prints it."""
        return {
            "outcome": self.outcome,
            "agreement": self.agreement.name.lower(),
            "verdict": self.verdict,
            "signal": self.signal,
            "matched": self.matched,
            "errors": {k: dict(v) for k, v in self.errors.items()},
            "prediction": None if self.prediction is None else self.prediction.to_dict(),
            "simulation": self.run.to_dict(),
            "probes": [
                {"cycle": p.cycle, "scale": p.scale, "status": p.status.name.lower(), "peak_to_peak": p.peak_to_peak}
                for p in self.probes
            ],
            "rows": [
                {"method": r.method, "quantities": dict(r.quantities), "seconds": r.seconds, "note": r.note}
                for r in self.rows
            ],
            "provenance": dict(self.provenance),
        }

    def plot(self) -> Figure:
        """The run, its cycle beside the predicted one, and the verdict."""
        from eppanalysis.plots import plot_ladder

        return plot_ladder(self)


class _Expected(Protocol):
    signal: str | None


class _CaseLike(Protocol):
    """What the ladder needs of a case (the case layer stands above the methods)."""

    name: str
    input: Motion | Mapping[str, Motion] | None
    t_end: float

    @property
    def expected(self) -> _Expected: ...
    def to_system(self) -> LureSystem: ...
    def provenance(self) -> dict[str, Any]: ...


def ladder(case: _CaseLike) -> Ladder:
    """Predict, simulate and compare.

    Parameters
    ----------
    case : Case

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
    system = case.to_system()
    signal = case.expected.signal or system.signals.names[0]
    prediction, predict_seconds, why_not = _predict(system, case)
    begin = time.perf_counter()
    run = simulate(system, case.input, case.t_end)
    seconds = time.perf_counter() - begin
    cycles = prediction.cycles if prediction else ()
    matched = _match(cycles, run.limit_cycle, signal)
    held = _held_input(system, case)
    probes = () if system.time_step else _probes(system, cycles, held, case.t_end, signal)
    errors = _errors(cycles[matched], run.limit_cycle) if matched is not None and run.limit_cycle else {}
    agreement = _agreement(prediction, run, matched, probes, signal)
    return Ladder(
        signal=signal,
        prediction=prediction,
        run=run,
        matched=matched,
        errors=errors,
        probes=probes,
        agreement=agreement,
        verdict=" ".join(_sentences(agreement, errors, probes, cycles, signal, why_not)),
        rows=tuple(_rows(cycles, run, signal, predict_seconds, seconds)),
        units={"frequency": "Hz", "peak-to-peak": run.units.get(signal, ""), "mean": run.units.get(signal, "")},
        provenance=provenance("ladder", {"t_end": case.t_end}) | {"case": case.provenance()},
    )


def _predict(system: LureSystem, case: _CaseLike) -> tuple[Prediction | None, float, str]:
    begin = time.perf_counter()
    try:
        prediction = predict_limit_cycles(system, _final_input(system, case))
    except EppError as error:
        return None, 0.0, str(error)
    return prediction, time.perf_counter() - begin, ""


def _motion_map(system: LureSystem, case: _CaseLike) -> Mapping[str, Motion]:
    if case.input is None:
        return {}
    return case.input if isinstance(case.input, Mapping) else {system.input_names[0]: case.input}


def _final_input(system: LureSystem, case: _CaseLike) -> dict[str, float]:
    """Where the external inputs stand at the end of the run: the operating point of its cycle."""
    motions = _motion_map(system, case)
    return {
        name: float(v + (motions[name].value(case.t_end) if name in motions else 0.0))
        for name, v in zip(system.input_names, system.v0, strict=True)
    }


def _held_input(system: LureSystem, case: _CaseLike) -> dict[str, Motion]:
    """The external inputs kept where they stand at the end of the run."""
    final = _final_input(system, case)
    return {n: Constant(final[n] - float(v)) for n, v in zip(system.input_names, system.v0, strict=True)}


def _distance(a: LimitCycle, b: LimitCycle, signal: str) -> float:
    """How far two cycles are apart: the larger of the ratios of frequency and of size, as logarithms."""
    size = max(a.peak_to_peak[signal], 1e-300) / max(b.peak_to_peak[signal], 1e-300)
    return float(max(abs(np.log(a.period / b.period)), abs(np.log(size))))


def _match(cycles: tuple[LimitCycle, ...], reached: LimitCycle | None, signal: str) -> int | None:
    """The stable predicted cycle nearest to the one reached, if it is within a factor of two in frequency and size."""
    if reached is None:
        return None
    near = {i: _distance(c, reached, signal) for i, c in enumerate(cycles) if c.stable is not False}
    best = min(near, key=lambda i: near[i], default=None)
    return best if best is not None and near[best] < np.log(2.0) else None


def _probes(
    system: LureSystem, cycles: tuple[LimitCycle, ...], held: dict[str, Motion], t_end: float, signal: str
) -> tuple[Probe, ...]:
    """Runs from the predicted cycles: stable ones from on, below and above; unstable ones from below and above."""
    out = []
    for i, cycle in enumerate(cycles):
        middle = cycle.provenance.get("mean_state")
        if middle is None or cycle.state.size != system.A.shape[0]:
            continue
        for scale in (0.8, 1.0, 1.25) if cycle.stable else (0.5, 2.0):
            x0 = np.asarray(middle) + scale * (cycle.state - np.asarray(middle))
            start = replace(system, x0=x0, memory=cycle.memory)
            run = simulate(start, held, max(t_end, 60 * cycle.period), t_eval=[0.0])
            size = {Status.SETTLED: 0.0}.get(run.status, float("nan"))
            out.append(Probe(i, scale, run.status, run.limit_cycle.peak_to_peak[signal] if run.limit_cycle else size))
    return tuple(out)


def _errors(predicted: LimitCycle, reached: LimitCycle) -> dict[str, dict[str, float]]:
    """Relative errors of the prediction, signal by signal."""
    out = {"frequency": {"frequency": predicted.frequency / reached.frequency - 1.0}}
    for name, size in reached.peak_to_peak.items():
        if not size > 0:
            continue
        out[name] = {
            "peak_to_peak": predicted.peak_to_peak[name] / size - 1.0,
            "fundamental": predicted.amplitude(name) / reached.amplitude(name) - 1.0,
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
    prediction: Prediction | None, run: Trajectory, matched: int | None, probes: tuple[Probe, ...], signal: str
) -> Agreement:
    if prediction is None:
        return Agreement.NO_PREDICTION
    if run.status is Status.LIMIT_CYCLE:
        return Agreement.AGREE if matched is not None else Agreement.NOT_PREDICTED
    if run.status is not Status.SETTLED:
        return Agreement.UNDECIDED
    if not any(c.stable for c in prediction.cycles):
        return Agreement.FREE
    return Agreement.GUARDED if _confirmed(probes, prediction.cycles, signal) else Agreement.NOT_THERE


def _sentences(
    agreement: Agreement,
    errors: dict[str, dict[str, float]],
    probes: tuple[Probe, ...],
    cycles: tuple[LimitCycle, ...],
    signal: str,
    why_not: str,
) -> list[str]:
    out = [agreement.value]
    if why_not:
        out.append(why_not)
    if errors:
        f, a = errors["frequency"]["frequency"], errors.get(signal, {}).get("peak_to_peak", float("nan"))
        out.append(f"First order is off by {100 * f:+.1f} % in frequency and {100 * a:+.1f} % in the size of {signal}.")
    for i, cycle in enumerate(cycles):
        below = [p for p in probes if p.cycle == i and p.scale < 1]
        above = [p for p in probes if p.cycle == i and p.scale > 1]
        if cycle.stable is False and below and above:
            if _same(below[0], above[0]):
                out.append(
                    f"The unstable cycle predicted at {cycle.frequency:.4g} Hz divides nothing here: "
                    "runs started at half and at twice its size end alike."
                )
            else:
                out.append(
                    f"The unstable cycle predicted at {cycle.frequency:.4g} Hz does divide: "
                    "runs started at half and at twice its size end differently."
                )
    return out


def _same(a: Probe, b: Probe) -> bool:
    if a.status is not b.status:
        return False
    return a.status is not Status.LIMIT_CYCLE or abs(a.peak_to_peak - b.peak_to_peak) <= 1e-3 * abs(b.peak_to_peak)


def _rows(
    cycles: tuple[LimitCycle, ...], run: Trajectory, signal: str, predict_seconds: float, seconds: float
) -> list[Rung]:
    rows = []
    for cycle in cycles:
        kind = {True: "stable", False: "unstable", None: "stability unknown"}[cycle.stable]
        rows.append(Rung(f"describing function, {kind}", _quantities(cycle, signal), predict_seconds))
    if not cycles:
        rows.append(Rung("describing function", _quantities(None, signal), predict_seconds, "no cycle"))
    note = run.status.value if run.limit_cycle is None else ""
    rows.append(Rung("simulation", _quantities(run.limit_cycle, signal), seconds, note))
    return rows


def _quantities(cycle: LimitCycle | None, signal: str) -> dict[str, float | None]:
    if cycle is None:
        return {"frequency": None, "peak-to-peak": None, "mean": None}
    return {"frequency": cycle.frequency, "peak-to-peak": cycle.peak_to_peak[signal], "mean": cycle.mean[signal]}
