"""Step response to drive inertia, friction, lag and delay: least squares on the event-exact simulation.

A limit cycle makes the sum of squares a comb: a candidate whose frequency is off by a swing over the record fits
another tooth. So the fit begins with many starts on the first swings, and the record grows as the frequency gets sharp.
What the case knows within a tolerance is fitted along and held by that tolerance. What the data cannot tell is taken
from the case as known to its own size, and named.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eppanalysis.case import Case
from eppanalysis.errors import EppError
from eppanalysis.identify.estimate import BenchFit, Estimate, Residual, lag_one
from eppanalysis.identify.intervals import weighted
from eppanalysis.identify.reading import Progress, Recording
from eppanalysis.identify.response import Response, Unknown
from eppanalysis.provenance import provenance
from eppanalysis.results import Status

Array = NDArray[np.float64]

#: What is fitted unless the user says otherwise.
DEFAULT = ("drive.inertia", "drive.coulomb_friction", "drive.electrical_time_constant", "controller.delay")
#: Parameters that the step response does not depend on.
_APART = ("sensor.gain", "sensor.full_scale", "run.t_end")
#: Candidates at the begin, fits that follow them, and shares of the record to fit one after the other.
STARTS, KEPT_STARTS, ROUNDS = 120, (8, 4, 3, 2, 1), 3
_WINDOWS = (0.08, 0.2, 0.4, 0.7, 1.0)
#: A parameter counts as told when half its interval is smaller than this share of it.
TOLD = 0.6
#: Multiples of a held parameter at which the others are fitted again.
_SCAN_DOWN, _SCAN_UP = (0.6, 0.3, 0.05), (1.5, 2.0, 3.0)
#: Residuals larger than this in units of the noise mean that the model does not describe the record.
_WORST_FIT, _GOOD_FIT = 3.0, 1.7


def fit_step(
    recording: Recording,
    case: Case,
    fit: Sequence[str] | None = None,
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> BenchFit:
    """Drive and timing from a recorded step response, with or without limit cycle.

    Parameters
    ----------
    recording : Recording
        Columns time (the step comes at 0 s), angle and, where there are any, force (at the sensor) and harness (its
        motion, in place of the case's step).
    case : Case
        What is known; its parameters with a tolerance are fitted along within it.
    fit : sequence of str, optional
        Fields to identify; `DEFAULT` unless given.
    seed : int
        Of the starts.
    progress : callable, optional

    Raises
    ------
    EppError
        If the data cannot tell any of the parameters.
    """
    names = tuple(fit or DEFAULT)
    unknowns = _unknowns(case, names)
    response = Response(recording, case, unknowns)
    if len(response.time) < 10 * len(unknowns):
        raise EppError(
            f"{recording.source}: {len(response.time)} rows cannot tell {len(unknowns)} parameters; expected more rows."
        )
    q = _search(response, seed, progress)
    solution = _settle(response, q, names)
    if all(name in solution.held for name in names):
        raise EppError(f"{recording.source}: cannot tell {' or '.join(names)}; {_remedy(response)}")
    return _result(recording, solution, names, seed)


def _unknowns(case: Case, names: Sequence[str]) -> tuple[Unknown, ...]:
    if len(set(names)) < len(names):
        raise EppError("identify: a field to fit is given twice; expected each once.")
    asked = [Unknown.of(case, name) for name in names]
    along = [
        Unknown.of(case, name)
        for name, p in case.parameters.items()
        if p.tolerance and not isinstance(p.value, bool) and name not in (*names, *_APART)
    ]
    return (*asked, *(u for u in along if u.prior is not None and u.start != 0))


def _bounds(unknowns: Sequence[Unknown]) -> tuple[Array, Array]:
    low = np.array([u.to_scale(u.start) - math.log(50.0) if u.logarithmic else 0.0 for u in unknowns])
    high = np.array([u.to_scale(u.start) + math.log(50.0) if u.logarithmic else 50.0 for u in unknowns])
    for i, u in enumerate(unknowns):
        if u.name == "pulley.kinetic_ratio":
            high[i] = 1.0 / u.scale
    return low, high


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
    low, high = _bounds(unknowns)
    return np.clip(np.vstack([first, np.column_stack(rows)]), low, high)


def _search(response: Response, seed: int, progress: Progress | None) -> Array:
    """Best place over all starts; further rounds of them while the residuals are clearly more than noise."""
    best, least = np.zeros(0), math.inf
    tell: Progress = progress or (lambda done, total: None)
    for k in range(ROUNDS):
        q = _round(response, seed + k, tell)
        cost = float(np.sum(response.residual(q) ** 2))
        if cost < least:
            best, least = q, cost
        if _misfit(response, best) < _GOOD_FIT:
            break
    return best


def _misfit(response: Response, q: Array) -> float:
    """Residual over noise of the channel that is described worst."""
    found = response.signals(q)
    return max(float(np.std(c.residual(found[c.role]))) for c in response.channels)


def _round(response: Response, seed: int, progress: Progress) -> Array:
    """Best place over one set of starts, the record growing."""
    end = float(response.time[-1])
    starts = _starts(response.unknowns, seed)
    windows = [max(w * end, float(response.time[min(len(response.time) - 1, 30)])) for w in _WINDOWS]
    costs = []
    for i, q in enumerate(starts):
        costs.append(float(np.sum(response.residual(q, windows[0]) ** 2)))
        progress(i, 2 * len(starts))
    places = [starts[i] for i in np.argsort(costs)]
    for k, (until, kept) in enumerate(zip(windows, KEPT_STARTS, strict=True)):
        found = []
        for q in places[:kept]:
            found.append(_fit(response, q, until, robust=k < 2))
        found.sort(key=lambda f: f[0])
        places = [f[1] for f in found]
        progress(len(starts) + (k + 1) * len(starts) // len(windows), 2 * len(starts))
    return places[0]


def _fit(response: Response, start: Array, until: float, robust: bool) -> tuple[float, Array]:
    """Sum of squares and place of a fit to the record up to a time; a robust one is not led by what it cannot reach."""
    from scipy.optimize import least_squares

    def residual(q: Array) -> Array:
        return response.residual(q, until)

    low, high = _bounds(response.unknowns)
    fit = least_squares(
        residual,
        np.clip(start, low + 1e-9, high - 1e-9),
        bounds=(low, high),
        diff_step=np.full(start.size, 1e-4),
        x_scale=_sizes(response.unknowns),
        max_nfev=25,
        xtol=1e-7,
        ftol=1e-7,
        loss="soft_l1" if robust else "linear",
    )
    return float(fit.cost), np.asarray(fit.x, float)


def _sizes(unknowns: Sequence[Unknown]) -> Array:
    return np.array([u.prior if u.prior is not None else 0.3 for u in unknowns])


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where the fit ends.

    Attributes
    ----------
    response : Response
        With what is held by its own size.
    q : array, shape (p,)
    low, high : array, shape (p,)
        Ends of the intervals on the fitted scale.
    held : dict of str to str
        What the data cannot tell, and what it is confused with.
    together : dict of str to str
        What they tell only together with a held one.
    converged : bool
    """

    response: Response
    q: Array
    low: Array
    high: Array
    held: dict[str, str]
    together: dict[str, str]
    converged: bool


def _settle(response: Response, q: Array, names: Sequence[str]) -> _Solution:
    """Weighted fit and covariance; one parameter after the other is held until the data tell the rest."""
    held: dict[str, str] = {}
    together: dict[str, str] = {}
    while True:
        q, matrix, converged = _weighted_fit(response, q, held)
        vague = _vague(response, q, matrix, [n for n in names if n not in held and n not in together])
        if not vague:
            spread = 1.96 * np.sqrt(np.maximum(np.diag(matrix), 0.0))
            low, high = _reach(response, q, matrix, held) if held else (q - spread, q + spread)
            return _Solution(response, q, low, high, held, together, converged)
        worst = vague[0]
        partner = _partner(response, matrix, worst, names)
        if held and not _vague(response, q, _given(response, matrix, held), [worst]):
            together[worst] = partner or next(iter(held))
            continue
        held[worst] = partner
        q = _hold(response, q, matrix, worst)


def _hold(response: Response, q: Array, matrix: Array, name: str) -> Array:
    """Place of the best fit with a parameter held where the case has it, and from then on known to its size."""
    place = [u.name for u in response.unknowns].index(name)
    unknown = response.unknowns[place]
    _, q = _follow(response, q, matrix, place, unknown.to_scale(unknown.start))
    response.replace(place, replace(unknown, prior=0.5))
    return q


def _follow(response: Response, q: Array, matrix: Array, place: int, target: float) -> tuple[float, Array]:
    """Sum of squares and place of the best fit with one parameter taken to `target`, the others following it."""
    unknown = response.unknowns[place]
    follow = matrix[:, place] / matrix[place, place]
    start = q[place]
    cost = math.inf
    for share in np.linspace(0.0, 1.0, max(2, math.ceil(abs(target - start) / 0.3) + 1))[1:]:
        at = start + share * (target - start)
        response.replace(place, replace(unknown, start=unknown.value(float(at)), prior=1e-4))
        low, high = _bounds(response.unknowns)
        half, q = _fit(response, np.clip(q + follow * (at - q[place]), low, high), math.inf, robust=False)
        cost = 2.0 * half
    q = q.copy()
    q[place] = target
    response.replace(place, unknown)
    return cost, q


def _reach(response: Response, q: Array, matrix: Array, held: dict[str, str]) -> tuple[Array, Array]:
    """Ends of the intervals of all parameters over all values of the first held one that fit nearly as well.

    How well a lag and a dead time can be told apart depends on the lag itself, so the interval of one that is held is
    not that of a straight line: its sum of squares is followed from the case's value down and up instead.
    """
    conditional = 1.96 * np.sqrt(np.maximum(np.diag(_given(response, matrix, held)), 0.0))
    place = [u.name for u in response.unknowns].index(next(iter(held)))
    unknown = response.unknowns[place]
    centre = float(q[place])
    away = [math.log(f) if unknown.logarithmic else centre * (f - 1.0) for f in _SCAN_DOWN + _SCAN_UP]
    found = [(float(np.sum(response.residual(q) ** 2)), q)]
    for group in (away[: len(_SCAN_DOWN)], away[len(_SCAN_DOWN) :]):
        here = q
        for offset in group:
            cost, here = _follow(response, here, matrix, place, centre + offset)
            found.append((cost, here))
            if cost > 1.5 * found[0][0]:
                break
    rows = sum(int(c.live.sum()) for c in response.channels)
    least = min(cost for cost, _ in found)
    near = [at for cost, at in found if (cost - least) * rows / least < 3.84 or at is q]
    low = np.min(near, axis=0) - conditional
    high = np.max(near, axis=0) + conditional
    spread = 1.96 * np.sqrt(np.diag(matrix))
    return np.minimum(low, q - spread), np.maximum(high, q + spread)


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
        width = half if u.logarithmic else half / max(abs(q[i]), 1e-3)
        if width > TOLD:
            found.append((width, u.name))
    return [name for _, name in sorted(found, reverse=True)]


def _partner(response: Response, matrix: Array, name: str, names: Sequence[str]) -> str:
    """The parameter that a vague one is confused with, empty where there is none."""
    all_names = [u.name for u in response.unknowns]
    i = all_names.index(name)
    size = np.sqrt(np.diag(matrix))
    correlation = np.abs(matrix[i] / (size * size[i]))
    correlation[i] = 0.0
    j = int(np.argmax(correlation))
    return all_names[j] if correlation[j] > 0.8 else ""


def _weighted_fit(response: Response, q: Array, held: Container[str] = ()) -> tuple[Array, Array, bool]:
    """Gauss-Newton steps with the noise of every channel as its residuals show it; covariance on the fitted scale."""
    steps = 1e-3 * np.ones(q.size)
    low, high = _bounds(response.unknowns)
    matrix, converged = np.eye(q.size), False
    for _ in range(6):
        jacobians = _jacobians(response, q, steps)
        now = response.signals(q)
        rows, values = [], []
        for channel in response.channels:
            r = ((now[channel.role] - channel.data) / channel.noise)[channel.live]
            columns = np.column_stack([jacobians[channel.role] / channel.noise, channel.nuisance])[channel.live]
            live = np.linalg.norm(columns, axis=0) > 0
            step = np.linalg.lstsq(columns[:, live], -r, rcond=1e-10)[0]
            noise = weighted(_independent(columns[:, live]), r + columns[:, live] @ step, 1e-3)
            whitened, left = noise.whiten(columns), noise.whiten(r)
            basis = np.linalg.qr(whitened[:, q.size :])[0]
            rows.append(whitened[:, : q.size] - basis @ (basis.T @ whitened[:, : q.size]))
            values.append(left - basis @ (basis.T @ left))
        beliefs = [i for i, u in enumerate(response.unknowns) if u.prior is not None]
        rows.append(np.eye(q.size)[beliefs] / np.array([[response.unknowns[i].prior or 1.0] for i in beliefs]))
        values.append(response.beliefs(q))
        J, r = np.vstack(rows), np.concatenate(values)
        normal = J.T @ J
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-12, hermitian=True)
        matrix = inverse / np.outer(size, size)
        matrix = matrix + np.diag(np.where(np.diag(normal) > 1e-12, 0.0, 1e6))
        free = [i for i, u in enumerate(response.unknowns) if u.name not in held]
        move = np.zeros(q.size)
        move[free] = -np.linalg.lstsq(J[:, free] / size[free], r, rcond=1e-9)[0] / size[free]
        spread = np.sqrt(np.diag(matrix))
        move = np.clip(move, -0.2, 0.2)
        q = _no_worse(response, q, np.clip(q + move, low, high))
        # Differences over half an interval see the kinks of friction as the data would.
        steps = np.clip(0.5 * spread, 1e-5, 3e-2)
        converged = bool(np.all(np.abs(move) < 0.2 * spread))
        if converged:
            break
    return q, matrix, converged


def _independent(columns: Array) -> Array:
    """Columns that span the same without the dependent ones."""
    basis, triangle = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
    kept = np.abs(np.diag(triangle)) > 1e-9
    return basis[:, kept]


def _no_worse(response: Response, q: Array, moved: Array) -> Array:
    """The moved place, or the nearest on the way whose plain sum of squares is not clearly larger."""
    before = float(np.sum(response.residual(q) ** 2))
    for share in (1.0, 0.5, 0.25):
        trial = q + share * (moved - q)
        if float(np.sum(response.residual(trial) ** 2)) < 1.05 * before:
            return trial
    return q


def _jacobians(response: Response, q: Array, steps: Array) -> dict[str, Array]:
    """Central differences of the signals, one-sided at a bound; shape (n, p) for each channel."""
    low, high = _bounds(response.unknowns)
    columns: dict[str, list[Array]] = {c.role: [] for c in response.channels}
    for j in range(q.size):
        up, down = q.copy(), q.copy()
        up[j] = min(q[j] + steps[j], high[j])
        down[j] = max(q[j] - steps[j], low[j])
        above, below = response.signals(up), response.signals(down)
        for role, found in columns.items():
            found.append((above[role] - below[role]) / (up[j] - down[j]))
    return {role: np.column_stack(found) for role, found in columns.items()}


def _remedy(response: Response) -> str:
    rate = (len(response.time) - 1) / max(float(np.ptp(response.time)), 1e-12)
    return f"expected a motion that depends on them, with less noise or more than {rate:.4g} rows a second."


def _estimates(solution: _Solution, names: Sequence[str]) -> tuple[Estimate, ...]:
    case, out = solution.response.case, []
    for i, u in enumerate(solution.response.unknowns):
        places = (float(a[i]) for a in (solution.q, solution.low, solution.high))
        value, low, high = (u.value(place) for place in places)
        note, told = "", True
        if u.name in solution.held:
            other = solution.held[u.name]
            told = False
            note = f"the data do not tell it{f' from {other}' if other else ''}; taken as {case.text(u.name, u.start)}."
            value = u.start
            low, high = min(low, value), max(high, value)
        elif u.name in solution.together:
            other = solution.together[u.name]
            told, note = False, f"told only together with {other}."
        elif u.name not in names:
            note = "known before, within its tolerance"
        unit, friendly = case.unit(u.name)
        low = max(low, 0.0) if not u.logarithmic else low
        kept = u.name in solution.together
        out.append(Estimate(u.name, value, low, high, unit, friendly, told, note, kept))
    return tuple(out)


def _result(recording: Recording, solution: _Solution, names: Sequence[str], seed: int) -> BenchFit:
    response = solution.response
    now = response.signals(solution.q)
    panels, residuals, worst = {}, {}, 0.0
    for channel in response.channels:
        r = channel.data - now[channel.role]
        share = np.linalg.lstsq(channel.nuisance[channel.live], r[channel.live], rcond=None)[0]
        left = np.where(channel.live, r - channel.nuisance @ share, 0.0)
        drift = float(share[1] * np.ptp(channel.nuisance[:, 1]))
        unit = "rad" if channel.role == "angle" else "N"
        residuals[channel.role] = Residual(float(np.std(left)), lag_one(left), drift, unit)
        worst = max(worst, float(np.std(left)) / channel.noise)
        panels[channel.role] = {
            "x": response.time, "y": channel.data, "fit": channel.data - left, "residual": left, "units": ("s", unit)
        }  # fmt: skip
    notes = recording.sentences()
    notes.append(f"{response.runs} simulated candidates from {STARTS} starts.")
    if worst > _WORST_FIT:
        notes.append(
            f"The residuals are {worst:.3g} times the noise of the record: the model does not describe this motion; "
            "the intervals count that as wander."
        )
    status = Status.CONVERGED if solution.converged else Status.NOT_CONVERGED
    return BenchFit(
        "step response", recording.source, _estimates(solution, names), residuals, tuple(notes), recording.n_rows,
        len(response.time), status, {"panels": panels, "x": "time", "line": True},
        provenance("step response", {"seed": seed, "starts": STARTS, "fit": list(names), "rows": recording.n_rows}),
    )  # fmt: skip
