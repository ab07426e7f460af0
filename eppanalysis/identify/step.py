"""A recorded response to parameters, an elbow's step to drive and timing: least squares on the event-exact simulation.

A limit cycle makes the sum of squares a comb: a candidate whose frequency is off by an oscillation over the record fits
another tooth. So the fit begins with many starts on the first oscillations, and the record grows as the frequency gets
sharp. Near the best place it is a bent ridge, and intervals come from weighted draws
(:mod:`eppanalysis.identify.surface`). What the case knows within a tolerance is fitted along and held by that
tolerance. What the data cannot identify is taken from the case as known to its own size, and named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import TypeVar

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases import Case
from eppanalysis.cases.variation import takes
from eppanalysis.errors import EppError
from eppanalysis.identify.estimate import BenchFit, Estimate, Residual, lag_one
from eppanalysis.identify.plausible import LEAST_SHARE, explained, refuse_what_is_no_response
from eppanalysis.identify.response import Response, Unknown
from eppanalysis.identify.sampling import WALKED, Cloud, anneal, walk
from eppanalysis.identify.surface import DRAWS, ENOUGH, explore
from eppanalysis.identify.whitening import WIDEST_START, bounds_of, held_between_rows, local, suspects
from eppanalysis.models.systems.inputs import Recorded
from eppanalysis.progress import Progress
from eppanalysis.readable import listed
from eppanalysis.records.reading import Recording
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

Drawn = TypeVar("Drawn")

#: What is fitted unless the user says otherwise.
DEFAULT = ("drive.inertia", "drive.coulomb_friction", "drive.electrical_time_constant", "controller.delay")
#: Parameters that the step response does not depend on.
_APART = ("sensor.gain", "sensor.full_scale", "run.t_end")
#: Candidates at the begin, fits that follow them, and shares of the record to fit one after the other.
STARTS, KEPT_STARTS, ROUNDS = 120, (8, 4, 3, 2, 1), 3
_WINDOWS = (0.08, 0.2, 0.4, 0.7, 1.0)
#: A parameter counts as identified when half its interval is smaller than this share of it.
IDENTIFIED = 0.6
#: Residuals larger than this in units of the noise mean that the model does not describe the record.
_WORST_FIT = 3.0
#: Standard deviations beyond which residuals indicate another value of what is not fitted.
_ASKED = 5.0
#: So far beyond an end of the search a case is tried, on the fitted scale.
_BEYOND = 0.01


def fit_step(
    recording: Recording,
    case: Case,
    fit: Sequence[str] | None = None,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> BenchFit:
    """Parameters from a recorded response, an elbow's drive and timing from its step; with or without limit cycle.

    Parameters
    ----------
    recording : Recording
        Time (the run starts at 0 s) and signals, an elbow's angle and force; recorded inputs take the place of those
        that the case has.
    case : Case
        What is known; its parameters with a tolerance are fitted along within it.
    fit : sequence of str, optional
        Fields to identify; `DEFAULT` of an elbow.
    seed : int
        Of the starts.

    Raises
    ------
    EppError
        If nothing is to be fitted, or the data cannot identify any of the parameters.
    """
    names = tuple(fit or ()) or _default(case)
    unknowns = _unknowns(case, names)
    response = Response(recording, case, unknowns)
    if len(response.time) < 10 * len(unknowns):
        raise EppError(
            f"{recording.source}: {len(response.time)} rows cannot identify {len(unknowns)} parameters; expected more "
            "rows."
        )
    candidates = response.candidates(_starts(unknowns, seed))
    if _insensitive(response, candidates):
        raise EppError(f"{recording.source}: cannot identify {' or '.join(names)}; {_remedy(response)}")
    refuse_what_is_no_response(response, candidates, recording.source)
    ends = _search(response, seed, progress)
    solution = _settle(response, ends[0], names, seed, progress)
    response.read_noise(solution.q)
    solution = solution.spanning(ends[1:])
    if all(name in solution.held for name in names):
        raise EppError(f"{recording.source}: cannot identify {' or '.join(names)}; {_remedy(response)}")
    return _result(recording, solution, names, seed)


def _unknowns(case: Case, names: Sequence[str]) -> tuple[Unknown, ...]:
    if len(set(names)) < len(names):
        raise EppError("identify: a field to fit is given twice; expected each once.")
    asked = [Unknown.of(case, name) for name in names]
    along = [
        Unknown.of(case, name)
        for name, p in case.parameters.items()
        if p.tolerance and p.value and name not in (*names, *_APART)
    ]
    return (*asked, *along)


def _default(case: Case) -> tuple[str, ...]:
    """What is fitted of an elbow; nobody knows what is of another case."""
    if case.kind == "elbow":
        return DEFAULT
    known = case.parameters
    marked = [name for name, p in known.items() if p.mark == "tunable" or p.tolerance]
    raise EppError(
        f"identify: no parameter of {case.name} is given to fit; expected --fit with one or more of "
        f"{', '.join(marked or known) or 'its fields, of which it has none'}."
    )


def _starts(unknowns: Sequence[Unknown], seed: int) -> Array:
    """The case itself, then an even spread over a third to three times its values (known ones stay near)."""
    from scipy.stats import qmc

    spread = qmc.LatinHypercube(len(unknowns), rng=seed).random(STARTS - 1)
    rows = []
    for j, u in enumerate(unknowns):
        centre = u.to_scale(u.start)
        if u.prior is not None:
            rows.append(centre + (2.0 * spread[:, j] - 1.0) * u.prior)
        elif u.logarithmic:
            rows.append(centre + (2.0 * spread[:, j] - 1.0) * math.log(3.0))
        else:
            rows.append(3.0 * spread[:, j] * (centre or 1.0))
    first = [u.to_scale(u.start) for u in unknowns]
    low, high = bounds_of(unknowns)
    return np.clip(np.vstack([first, np.column_stack(rows)]), low, high)


def _insensitive(response: Response, candidates: Sequence[dict[str, Array]]) -> bool:
    """Whether the motion is the same, next to the noise, whatever the parameters."""
    first, *others = candidates
    return all(
        float(np.max(np.abs(other[c.role] - first[c.role]))) < 0.1 * c.noise
        for other in others
        for c in response.channels
    )


def _search(response: Response, seed: int, progress: Progress | None) -> list[Array]:
    """Places where rounds from other starts end, the best one first.

    While that leaves clearly more than noise there are further rounds, and one by a population where the motion jumps.
    """
    ends: list[Array] = []
    advance: Progress = progress or (lambda done, total, doing: None)

    def taken(q: Array) -> bool:
        """Whether the best place so far leaves noise alone."""
        ends.append(q)
        response.read_noise(q)
        ends.sort(key=lambda q: float(np.sum(response.residual(q) ** 2)))
        return response.noise_alone(ends[0])

    if any(taken(_round(response, seed + k, advance)) for k in range(ROUNDS)):
        return ends
    # Descent is stuck among the patterns of a controller that hunts.
    if response.jumps(ends[0]):
        taken(anneal(response, _starts(response.unknowns, seed), bounds_of(response.unknowns), seed, advance))
    return ends


def _round(response: Response, seed: int, progress: Progress) -> Array:
    """Best place over one set of starts, the record growing."""
    end = float(response.time[-1])
    starts = _starts(response.unknowns, seed)
    windows = [max(w * end, float(response.time[min(len(response.time) - 1, 30)])) for w in _WINDOWS]
    costs = []
    for i, q in enumerate(starts):
        costs.append(float(np.sum(response.residual(q, windows[0]) ** 2)))
        progress(i, 2 * len(starts), "")
    # Over the whole record the sum of squares is a comb, with a tooth for each oscillation that a candidate is off by;
    # over its begin it has few, and the best go on to more of it.
    places = [starts[i] for i in np.argsort(costs)]
    for k, (until, kept) in enumerate(zip(windows, KEPT_STARTS, strict=True)):
        found = []
        for q in places[:kept]:
            found.append(_fit(response, q, until, robust=k < 2))
        found.sort(key=lambda f: f[0])
        places = [f[1] for f in found]
        progress(len(starts) + (k + 1) * len(starts) // len(windows), 2 * len(starts), "")
    return places[0]


def _fit(response: Response, start: Array, until: float, robust: bool) -> tuple[float, Array]:
    """Sum of squares and place of a fit to the record up to a time; a robust one is not led by what it cannot reach."""
    from scipy.optimize import least_squares

    def residual(q: Array) -> Array:
        return response.residual(q, until)

    low, high = bounds_of(response.unknowns)
    fit = least_squares(
        residual,
        np.clip(start, low + 1e-9, high - 1e-9),
        bounds=(low, high),
        diff_step=np.full(start.size, 1e-4),
        x_scale=_sizes(response.unknowns),
        max_nfev=12,
        xtol=1e-4,
        ftol=1e-4,
        loss="soft_l1" if robust else "linear",
    )
    return float(fit.cost), np.asarray(fit.x, float)


def _sizes(unknowns: Sequence[Unknown]) -> Array:
    return np.array([u.prior if u.prior is not None else 0.3 for u in unknowns])


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where the fit ends."""

    response: Response
    q: Array  # (p,): with what is held where the case has it
    #: low, high: (p,): ends of the intervals on the fitted scale.
    low: Array
    high: Array
    held: dict[str, str]  # what the data cannot identify, and what it is confused with
    together: dict[str, str]  # what they identify only together with a held one
    cloud: Cloud
    #: (p,): half widths, on the fitted scale, from the ends of other searches, where this one leaves no noise.
    apart: Array | None = None

    @property
    def converged(self) -> bool:
        """Whether more draws, and searches from other starts, would say the same."""
        return self.cloud.settled and self.apart is None

    def spanning(self, ends: Sequence[Array]) -> _Solution:
        """The same with intervals that span where other searches ended, unless this place leaves noise alone."""
        if self.response.noise_alone(self.q):
            return self
        apart = _student(len(ends) + 1.0) * np.std([self.q, *ends], axis=0, ddof=min(1, len(ends)))
        if np.all(apart <= 0.5 * (self.high - self.low)) and not self.response.jumps(self.q):
            return self
        least, most = bounds_of(self.response.unknowns)
        low = np.maximum(np.minimum(self.low, self.q - apart), least)
        high = np.minimum(np.maximum(self.high, self.q + apart), most)
        return replace(self, low=low, high=high, apart=apart)

    def vague(self, place: int) -> bool:
        """Whether other searches ended at such other values of a parameter that this one says little."""
        size = 1.0 if self.response.unknowns[place].logarithmic else abs(float(self.q[place]))
        return self.apart is not None and bool(self.apart[place] > IDENTIFIED * size)


def _settle(
    response: Response, q: Array, names: Sequence[str], seed: int, progress: Progress | None = None
) -> _Solution:
    """What the data leave possible; one parameter after the other is held until the data identify the rest."""

    def counted(ask: Callable[[Array], Drawn], total: int | None) -> Callable[[Array], Drawn]:
        number = count(1)

        def drawn(place: Array) -> Drawn:
            if progress is not None:
                progress(next(number), total, "identify: intervals")
            return ask(place)

        return drawn

    low, high = bounds_of(response.unknowns)
    cloud = Cloud(q, q, np.zeros((q.size, q.size)), math.inf)
    # Noise is read off what the best place leaves, and where that is hangs on the noise: once more from there.
    for _ in range(2):
        whitener, matrix = local(response, q)
        spread = np.minimum(np.sqrt(np.diag(matrix)), WIDEST_START)
        scale = spread / np.sqrt(np.diag(matrix))
        matrix = matrix * np.outer(scale, scale)
        if cloud.effective > ENOUGH * DRAWS:
            cloud = explore(counted(whitener.residual, None), q, matrix, low, high, seed)
        q = cloud.best
    if cloud.effective <= ENOUGH * DRAWS:
        cloud = walk(counted(whitener.cost, WALKED), q, matrix, (low, high), seed)
        q = cloud.best
    student = _student(cloud.effective)
    spread = student * np.sqrt(np.diag(cloud.matrix))
    ends = (np.minimum(cloud.mean - spread, q), np.maximum(cloud.mean + spread, q))
    held: dict[str, str] = {}
    together: dict[str, str] = {}
    # Along a ridge the best place is anywhere: the relative width of an interval is taken where others are held.
    while new := [n for n in _vague(response, q, cloud.matrix, names) if n not in held and n not in together]:
        name, partner = new[0], _partner(response, cloud.matrix, new[0])
        if held and not _vague(response, q, _given(response, cloud.matrix, held), [name]):
            together[name] = partner or next(iter(held))
        else:
            held[name] = partner
            q = _hold(response, q, cloud.matrix, name)
    # With one parameter fixed the others are as uncertain as if it were known; the intervals also span the other fits.
    near = student * np.sqrt(np.maximum(np.diag(_given(response, cloud.matrix, held)), 0.0)) if held else 0.0
    return _Solution(response, q, np.minimum(ends[0], q - near), np.maximum(ends[1], q + near), held, together, cloud)


def _student(effective: float) -> float:
    """97.5 % point for a spread that is known from so many draws."""
    from scipy.stats import t

    return float(t.ppf(0.975, max(effective - 1.0, 3.0)))


def _hold(response: Response, q: Array, matrix: Array, name: str) -> Array:
    """Place of the best fit with a parameter held where the case has it, the others following it there."""
    place = [u.name for u in response.unknowns].index(name)
    unknown = response.unknowns[place]
    target = unknown.to_scale(unknown.start)
    follow = matrix[:, place] / matrix[place, place]
    start = q[place]
    low, high = bounds_of(response.unknowns)
    # In short steps, or the fit leaves the ridge along which the others replace this parameter.
    for share in np.linspace(0.0, 1.0, max(2, math.ceil(abs(target - start) / 0.3) + 1))[1:]:
        at = start + share * (target - start)
        response.replace(place, replace(unknown, start=unknown.value(float(at)), prior=1e-4))
        _, q = _fit(response, np.clip(q + follow * (at - q[place]), low, high), math.inf, robust=False)
    q = q.copy()
    q[place] = target
    # A tight prior keeps the parameter at its target while the others are fitted again.
    response.replace(place, replace(unknown, prior=1e-4))
    return q


def _given(response: Response, matrix: Array, held: dict[str, str]) -> Array:
    """Covariance of the parameters if the held ones were known exactly."""
    fixed = np.array([u.name in held for u in response.unknowns])
    out = np.zeros_like(matrix)
    inverse = np.linalg.inv(matrix)
    out[np.ix_(~fixed, ~fixed)] = np.linalg.inv(inverse[np.ix_(~fixed, ~fixed)])
    return out


def _vague(response: Response, q: Array, matrix: Array, names: Sequence[str]) -> list[str]:
    """Parameters whose interval is as wide as themselves, the widest first."""
    found = []
    for i, u in enumerate(response.unknowns):
        if u.name not in names:
            continue
        half = 1.96 * math.sqrt(max(matrix[i, i], 0.0))
        # What may be nothing at all is known where the case's own value is far.
        alone = u.logarithmic or (u.vanishes and half >= abs(q[i]))
        width = half if alone else half / max(abs(q[i]), 1e-3)
        if width > IDENTIFIED:
            found.append((width, u.name))
    return [name for _, name in sorted(found, reverse=True)]


def _partner(response: Response, matrix: Array, name: str) -> str:
    """The parameter that a vague one is confused with, empty where there is none."""
    all_names = [u.name for u in response.unknowns]
    i = all_names.index(name)
    size = np.sqrt(np.diag(matrix))
    correlation = np.abs(matrix[i] / (size * size[i]))
    correlation[i] = 0.0
    j = int(np.argmax(correlation))
    return all_names[j] if correlation[j] > 0.8 else ""


def _remedy(response: Response) -> str:
    rate = (len(response.time) - 1) / max(float(np.ptp(response.time)), 1e-12)
    return f"expected a motion that depends on them, with less noise or more than {rate:.4g} rows a second."


def _estimates(solution: _Solution, names: Sequence[str]) -> tuple[Estimate, ...]:
    case, out = solution.response.case, []
    for i, u in enumerate(solution.response.unknowns):
        least = -math.inf if u.logarithmic else 0.0
        places = (float(a[i]) for a in (solution.q, np.maximum(solution.low, least), solution.high))
        value, *ends = (u.value(place) for place in places)
        low, high = sorted(ends)
        note, identified = "", True
        if u.name in solution.held:
            other = solution.held[u.name]
            identified = False
            note = (
                f"the data do not identify it{f' from {other}' if other else ''}; taken as "
                f"{case.text(u.name, u.start)}."
            )
            value = u.start
            low, high = min(low, value), max(high, value)
        elif u.name in solution.together:
            other = solution.together[u.name]
            identified, note = False, f"identified only together with {other}."
        elif solution.vague(i):
            identified, note = False, "searches from other starts end at other values of it."
        elif end := _end_reached(solution, i):
            identified = False
            note = f"its interval reaches {end}, where the search ends; expected a nearer value in the case."
        elif u.name not in names:
            note = "known before, within its tolerance"
        unit, friendly = case.unit(u.name)
        kept = u.name in solution.together
        out.append(Estimate(u.name, value, low, high, unit, friendly, identified, note, kept))
    return tuple(out)


def _end_reached(solution: _Solution, place: int) -> str:
    """The end of the search that a parameter's interval reaches; empty where it reaches none, where that is zero, as no
    fit changes a sign, or where the case goes no further.
    """
    case, unknown = solution.response.case, solution.response.unknowns[place]
    low, high = (float(ends[place]) for ends in bounds_of(solution.response.unknowns))
    reached = ((low, -_BEYOND, solution.low[place] <= low), (high, _BEYOND, solution.high[place] >= high))
    for end, step, there in reached:
        if there and unknown.value(end) and takes(case, unknown.name, unknown.value(end + step)):
            return case.text(unknown.name, unknown.value(end))
    return ""


def _doubt(solution: _Solution) -> str:
    """The parameter not fitted that residuals show to be wrong, in a sentence; empty where they show none."""
    apart = (*_APART, *(u.name for u in solution.response.unknowns))
    asked = suspects(local(solution.response, solution.q)[0], solution.q, apart)
    name = max(asked, key=lambda n: asked[n][1], default="")
    if not (name and asked[name][1] > _ASKED):
        return ""
    change, deviations = asked[name]
    return (
        f"The residuals are not noise: they suggest {name} by {100 * change:+.2g} % ({deviations:.2g} standard "
        "deviations), which is not fitted; the intervals hold for its value in the case."
    )


def _unrecorded(solution: _Solution) -> Iterator[str]:
    """The parameters whose intervals hold only if recorded inputs are linear between rows, in a sentence."""
    response, q = solution.response, solution.q
    inputs = {name: given for name, given in response.inputs.items() if isinstance(given, Recorded)}
    if not inputs:
        return
    moved = q + held_between_rows(local(response, q)[0], q)
    other = {
        u.name: response.case.text(u.name, u.value(float(place)), 4)
        for u, place, low, high in zip(response.unknowns, moved, solution.low, solution.high, strict=True)
        if not low <= place <= high and u.name not in solution.held
    }
    if other:
        # Where an input changes most while nothing is recorded.
        areas = {name: np.abs(np.diff(given.values)) * np.diff(given.times) for name, given in inputs.items()}
        name = max(inputs, key=lambda n: float(areas[n].max() / max(np.ptp(inputs[n].values), 1e-300)))
        begin, end = inputs[name].times[int(np.argmax(areas[name])) :][:2] + response.begin
        yield (
            f"The intervals hold for inputs that are linear between rows. Were {name} held from {begin:.6g} s to "
            f"{end:.6g} s and so on, {listed([f'{n} would be {value}' for n, value in other.items()])}."
        )


def _objections(solution: _Solution, doubt: str, worst: float, shares: Mapping[str, float]) -> Iterator[str]:
    """What speaks against a fit, in sentences."""
    if solution.apart is not None:
        yield (
            "The residuals are more than noise, so that the search may have missed the best place: intervals are "
            "widened to span where searches from other starts end."
        )
    if not solution.cloud.settled:
        yield "The sum of squares is so rough that its draws have not settled: take the intervals as a guess."
    if doubt:
        yield doubt
    if worst > _WORST_FIT:
        yield (
            f"The residuals are {worst:.3g} times the noise of the record: the model does not describe this motion; "
            "the intervals count that as wander."
        )
    for role, share in shares.items():
        if share < LEAST_SHARE:
            yield f"Of the {role} only {100 * max(share, 0.0):.2g} % are explained."


def _result(recording: Recording, solution: _Solution, names: Sequence[str], seed: int) -> BenchFit:
    response = solution.response
    now = response.signals(solution.q)
    panels: dict[str, object] = {}
    residuals: dict[str, Residual] = {}
    worst, shares = 0.0, {}
    for channel in response.channels:
        r = channel.data - now[channel.role]
        share = np.linalg.lstsq(channel.nuisance[channel.live], r[channel.live], rcond=None)[0]
        left = np.where(channel.live, r - channel.nuisance @ share, 0.0)
        drift = float(share[1] * np.ptp(channel.nuisance[:, 1]))
        residuals[channel.role] = Residual(float(np.std(left)), lag_one(left), drift, channel.unit)
        worst = max(worst, float(np.std(left)) / channel.noise)
        shares[channel.role] = explained(channel, left)
        panels[channel.role] = {
            "x": response.time, "y": channel.data, "fit": channel.data - left, "residual": left,
            "units": ("s", channel.unit),
        }  # fmt: skip
    if max(shares.values()) < LEAST_SHARE:
        left_over = ", ".join(f"{100 * max(share, 0.0):.2g} % of the {role}" for role, share in shares.items())
        raise EppError(f"{recording.source}: the best fit explains {left_over}; expected the response of such a case.")
    # Counted before the test of the residuals, which takes further runs.
    notes = [*recording.sentences(), f"{response.runs} simulated candidates from {STARTS} starts."]
    doubt = _doubt(solution)
    notes += _unrecorded(solution)
    notes += _objections(solution, doubt, worst, shares)
    identified = solution.converged and not doubt and worst <= _WORST_FIT and min(shares.values()) >= LEAST_SHARE
    status = Status.CONVERGED if identified else Status.NOT_CONVERGED
    settings = {"seed": seed, "starts": STARTS, "fit": list(names), "rows": recording.n_rows}
    return BenchFit(
        "step response", recording.source, _estimates(solution, names), residuals, tuple(notes), recording.n_rows,
        len(response.time), status, {"panels": panels, "x": "time", "line": True},
        provenance=Provenance("step response", settings),
    )  # fmt: skip
