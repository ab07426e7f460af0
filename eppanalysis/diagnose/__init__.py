"""From a recorded oscillation to the element of the loop that explains it, or to what stays undecided."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.cases import Case
from eppanalysis.cases.values.typed import read_in
from eppanalysis.diagnose.candidates import STEPS, Candidates, Family, candidates_of, size_exponents
from eppanalysis.diagnose.fit import Fit, Likelihood, all_fits, of_family
from eppanalysis.diagnose.questions import question
from eppanalysis.diagnose.record import FEWEST_SAMPLES, PER_HARMONIC, Oscillation, Record, oscillation_of, record_of
from eppanalysis.diagnose.result import LINEAR, OWN, UNTRIED, Diagnosis, Explanation, Verdict
from eppanalysis.errors import ArgumentError, CaseError, EppError
from eppanalysis.methods.orbits.orbit import CONVERGED
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import sampled_among
from eppanalysis.models.systems.subject import CaseLike, PointLike, facts_of, standing
from eppanalysis.progress import Progress
from eppanalysis.records.formats import Given
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

__all__ = ["Diagnosis", "Explanation", "Oscillation", "Record", "Verdict", "diagnose"]

METHOD = "exact limit cycles of each element alone, fitted to the record"
#: Probability from which a candidate is named, and chance below which what fits best does not fit.
_NAMED, _NO_CHANCE = 0.95, 1e-3


def diagnose(
    case: LureSystem | CaseLike,
    record: Given,
    *,
    columns: Mapping[str, tuple[str, str]] | None = None,
    model_error: float = 0.02,
    operating_point: PointLike | None = None,
    steps: int = STEPS,
    progress: Progress | None = None,
) -> Diagnosis:
    """Which element of a loop explains a recorded oscillation.

    Candidates are each element alone, with its size free and all others ideal (as their gains in margins), the loop as
    it is modelled, with nothing free, a linear instability, whose gain is free, and a sine from outside, whose
    frequency is free. Their exact limit cycles are laid against the period, growth and harmonics of all recorded
    signals. That two elements of other sizes than in the model together make an oscillation that neither makes alone is
    not among the candidates.

    Parameters
    ----------
    case : Case, Diagram or LureSystem
    record : path, mapping of str to array, DataFrame, Dataset or DataArray
        A file of any format of :doc:`/howto/records`, or a table in memory, with a column ``time [s]`` and one for each
        recorded signal, by the loop's names. Without a unit it is in SI units; a CSV file must have units. Three
        periods or more, of an oscillation that is sustained or grows; of a loop in discrete time its signals at the
        samples.
    columns : mapping of str to (str, str), optional
        Name and unit of a signal whose column has another name.
    model_error : float
        Relative standard deviation of what the model says of periods, sizes and harmonics, 0.001 to 0.5.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.
    steps : int
        Of the engine, that the search for the limit cycles of each candidate may take. The message names what was
        not sought to the end.
    progress : callable, optional
        Called with the number of candidates done, of all, and which one is being looked at.

    Returns
    -------
    Diagnosis

    Raises
    ------
    EppError
        If the record is no such table or holds no oscillation, or for inputs that are not constant.
    ModelError
        If an input or signal is unknown.

    References
    ----------
    Kass and Raftery, "Bayes factors", J Am Stat Assoc 90, 1995.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    >>> t = np.linspace(0.0, 40.0, 2000)
    >>> run = epp.simulate(loop, t_end=100.0, t_eval=60.0 + t)
    >>> found = epp.diagnose(loop, {"time": t, "x": 0.3 * run.signals["x"]})
    >>> found.names, round(found[0].fields["gap"][0], 2)
    (('play',), 0.6)
    """
    if not 1e-3 <= model_error <= 0.5:
        raise ArgumentError("model_error", f" is {model_error}; expected 0.001 to 0.5.", "diagnose")
    system, at = standing(case, operating_point, "diagnose")
    given = record_of(record, system.signals.units_by_name(), columns)
    # In discrete time there is nothing between samples that these could leave out.
    fewest = PER_HARMONIC if system.time_step else FEWEST_SAMPLES
    rates = {2.0 * np.pi / controller.sample_time for controller in sampled_among(system.elements).values()}
    found = oscillation_of(given, fewest, sorted(rates))
    check_counts("diagnose", {"steps": (steps, 1)})
    candidates = candidates_of(system, at, steps)
    searches = [
        *((family.name, family.cycles) for family in candidates.families),
        (OWN, lambda: candidates.whole.cycles),
    ]
    for i, (name, search) in enumerate(searches):
        if progress is not None:
            progress(i, len(searches), name)
        with suppress(EppError):  # what cannot be sought is said of the candidate
            search()
    return explained(candidates, case, given, found, model_error)


def explained(
    candidates: Candidates, case: LureSystem | CaseLike, record: Record, found: Oscillation, model_error: float = 0.02
) -> Diagnosis:
    """What the candidates say of an oscillation; they may be kept for the next record of the same loop."""
    yard = Likelihood(found, model_error)
    fits = [(name, some, why) for name, some, why in all_fits(yard, candidates)]
    weights = np.array([_evidence(some) for _, some, _ in fits])
    # Candidates are equally likely beforehand, so that their shares are those
    # of the evidence (docs/howto/diagnose.md, What the verdict rests on).
    shares = np.exp(weights - weights.max()) if np.any(np.isfinite(weights)) else np.zeros(len(fits))
    shares /= max(float(shares.sum()), 1e-300)
    made = [
        _explanation(candidates, case, name, some, why, float(share))
        for (name, some, why), share in zip(fits, shares, strict=True)
    ]
    made.sort(key=lambda e: (-e.probability, np.nan_to_num(e.misfit, nan=np.inf)))
    units = candidates.system.signals.units_by_name()
    verdict, elsewhere = _verdict(made), ""
    if verdict in (Verdict.UNEXPLAINED, Verdict.UNTRIED):
        made = [replace(e, probability=float("nan")) for e in made]
    doubtful = verdict is Verdict.UNEXPLAINED or (verdict is Verdict.NAMED and made[0].name == LINEAR)
    if doubtful and len(found.names) == 1:
        elsewhere = _elsewhere(yard, candidates, float(weights.max()), units)
        verdict = Verdict.UNDECIDED if elsewhere and verdict is Verdict.NAMED else verdict
    diagnosis = Diagnosis(
        explanations=tuple(made),
        verdict=verdict,
        elsewhere=elsewhere,
        threshold=_NAMED,
        oscillation=found,
        model_error=model_error,
        left_out=candidates.left_out,
        record=record,
        case=getattr(case, "name", candidates.system.name),
        units={name: units[name] for name in found.names},
        status=Status.INCOMPLETE if _untried(made) else Status.CONVERGED,
        provenance=Provenance(
            METHOD,
            {"system": candidates.system.name, "record": record.source, "model_error": model_error},
            {"residual": CONVERGED},
            {"samples": len(record.time), "periods": found.n_periods, "harmonics": found.harmonics.shape[1]},
            facts_of(case),
        ),
        operating_point=candidates.at,
    )
    sizes = {name: max(some, key=lambda fit: fit.evidence).size for name, some, _ in fits if some}
    asked = [question(case, e, found, units, sizes[e.name]) for e in diagnosis.named]
    return replace(diagnosis, questions=tuple(filter(None, asked)))


def _evidence(fits: list[Fit]) -> float:
    """Of a candidate: the mean over the ways in which it may explain the record."""
    if not fits:
        return -np.inf
    return float(np.logaddexp.reduce([fit.evidence for fit in fits]) - np.log(len(fits)))


def _verdict(made: list[Explanation]) -> Verdict:
    from scipy.stats import chi2

    fitting = [e for e in made if np.isfinite(e.misfit)]
    if not fitting and all(e.note.startswith(UNTRIED) for e in made):
        return Verdict.UNTRIED
    if not fitting or not any(chi2.sf(e.misfit, e.freedom) > _NO_CHANCE for e in fitting if e.probability > 0.01):
        return Verdict.UNEXPLAINED
    return Verdict.NAMED if made[0].probability >= _NAMED else Verdict.UNDECIDED


def _elsewhere(yard: Likelihood, candidates: Candidates, evidence: float, units: Mapping[str, str]) -> str:
    """The signal as a record of which an element explains the oscillation far better; empty where there is none.

    A gain on its limit has any sinusoid of its frequency, in whatever signal: what a record attached to the wrong one
    shows, too.
    """
    from scipy.stats import chi2

    (own,) = yard.found.names
    others = [name for name, unit in units.items() if name != own and unit == units[own]]
    best = (evidence + np.log(_NAMED / (1.0 - _NAMED)) + np.log(max(len(others), 1)), "")
    for name in others:
        as_other = Likelihood(replace(yard.found, names=(name,)), yard.model_error)
        # The cycles of these are known; others would have to be sought anew for every signal.
        for family in (f for f in candidates.families if f.in_proportion):
            fits: list[Fit] = []
            with suppress(EppError):  # what cannot be sought explains nothing
                fits = of_family(as_other, family)
            good = [fit for fit in fits if chi2.sf(fit.misfit, fit.freedom) > _NO_CHANCE]
            if good and _evidence(fits) > best[0]:
                best = _evidence(fits), f"as a record of {name} it is explained by {family.name}"
    return best[1]


def _untried(made: list[Explanation]) -> bool:
    return any(e.note.startswith(UNTRIED) for e in made)


def _explanation(
    candidates: Candidates, case: LureSystem | CaseLike, name: str, fits: list[Fit], why: str, share: float
) -> Explanation:
    family = next((f for f in candidates.families if f.name == name), None)
    kind = name if family is None else (family.element.kind or type(family.element).__name__)
    if not fits:
        return Explanation(name, kind, 0.0, float("nan"), 0, float("nan"), note=why)
    best = max(fits, key=lambda fit: fit.evidence)
    made = Explanation(
        name, kind, share, best.misfit, best.freedom, best.period,
        note=f"comes in {_at(best.place)}" if best.place else why if why.startswith(UNTRIED) else "",
        harmonics=best.harmonics,
    )  # fmt: skip
    if family is not None:
        return _with_sizes(made, family, case, best)
    turned = candidates.linear.turned
    if name != LINEAR or turned < 0:
        return made
    return replace(made, fields={"gain": _interval(1.0, best, 1)}, note=f"by the gain at {_names(candidates)[turned]}")


def _at(place: str) -> str:
    return place if place.startswith("behind ") else f"at {place}"


def _names(candidates: Candidates) -> tuple[str, ...]:
    return candidates.system.element_names


def _interval(value: float, fit: Fit, power: int) -> tuple[float, float, float]:
    """A value in the model times the size of a fit, with its 95 % interval."""
    wide = float(np.exp(1.96 * abs(power) * fit.size_error))
    at = value * fit.size**power
    low, high = sorted((at / wide, at * wide))
    return at, low, high


def _with_sizes(made: Explanation, family: Family, case: LureSystem | CaseLike, best: Fit) -> Explanation:
    """With the fields of its element and their intervals, and the parameters of the case that bound it."""
    fields, units = {}, {}
    own: list[str] = []
    parameters = getattr(case, "parameters", {})
    for name, power in size_exponents(family.element).items():
        fields[name] = _interval(float(getattr(family.element, name)), best, power)
        if not isinstance(case, Case):
            continue
        place = f"{family.name}.{name}"
        with suppress(CaseError):  # a field that the file leaves out
            unit, typed = case.unit(place)
            units[name] = read_in(unit, typed) if typed != unit else unit
        own += filter(None, [case.parameter_of(place)])
    others = sorted(n for n in parameters if n not in own)
    # What is free to choose: by its mark, else what the file gives a name of its own.
    free = [n for n in others if parameters[n].mark == "tunable"] or [n for n in others if "." not in n]
    return replace(
        made, fields=fields, units=units, parameter=own[0] if own else "", over=free[0] if free else "",
        in_proportion=family.in_proportion,
    )  # fmt: skip
