"""Weight-tray test: applied force against sensor voltage, loaded and unloaded, to pulley friction, gain, saturation.

The pulley makes the voltage lag behind the force. While it slides, the logarithms of applied and sensed force differ by
``2a`` with ``tanh(a)`` the kinetic friction per load; after a turn the sensed force is constant until the applied one
has come back by ``4E`` in logarithm, ``E = (a + b)/2`` and ``tanh(b)`` the static friction. The lines identify gain and
kinetic friction, the standstill identifies the static one, which weights of finite size only bracket.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import EppError
from eppanalysis.identify.columns import Role
from eppanalysis.identify.estimate import BenchFit, Estimate, Residual, lag_one
from eppanalysis.identify.intervals import Weighted, confounded, rounding, weighted
from eppanalysis.identify.strokes import Pulley, Stroke, sensor_force, strokes
from eppanalysis.records.reading import Recording
from eppanalysis.results.provenance import Provenance

#: Kinetic over static friction: what is taken to be possible before anything is measured.
KINETIC_RATIOS = (0.5, 1.0)
#: A turn of the applied force counts from this share of its range on.
_TURN = 0.04
#: Share of the force at a turn at which the pulley has surely broken away.
_SURELY_BACK = 0.6
_NAMES = ["offset", "drift", "sensor gain", "pulley friction", "saturation"]


@dataclass(frozen=True, eq=False)
class _Data:
    """Rows: time from -1/2 to 1/2, force [N], voltage [V], root of the number of readings behind each, which to fit."""

    time: Array
    force: Array
    voltage: Array
    weight: Array
    used: BoolArray
    pieces: tuple[Stroke, ...]


def fit_tray(recording: Recording, *, wrap: float = math.pi) -> BenchFit:
    """Pulley friction, sensor gain and saturation from a weight-tray test.

    Parameters
    ----------
    recording : Recording
        Columns force (applied, better known than the voltage) and voltage; times where there are any.
    wrap : float
        Angle psi at which the pulley was loaded in the test [rad]; pi, as in the paper's test, loads it most.

    Returns
    -------
    BenchFit
        Estimates pulley.friction, pulley.kinetic_ratio, sensor.gain and, where it was reached, sensor.full_scale.

    Raises
    ------
    EppError
        If the data cannot separate gain and friction: no turn of the force, or none far enough.
    """
    if not 0 < wrap <= math.pi:
        raise EppError(f"identify: the angle of the pulley is {math.degrees(wrap):.4g} deg; expected 0 to 180 deg.")
    data = _prepare(recording)
    loop = _Loop(data)
    best, where = _best(loop, _start(data, recording.source))
    names = _NAMES[: best.size]
    jacobian = loop.jacobian(best, where)
    lost = confounded(jacobian, names)
    if lost:
        raise EppError(
            f"{recording.source}: cannot separate {' and '.join(lost)}; expected a force that goes up and comes down "
            "far enough for the sensor to follow."
        )
    noise = weighted(jacobian, loop.residual(best, where), 1e-9 * float(np.ptp(data.voltage)))
    post = _posterior(loop, best, where, noise)
    best = best + noise.step
    estimates = _estimates(recording, best, noise, post, math.sin(wrap / 2))
    return _result(recording, data, loop, best, where, estimates)


def _best(loop: _Loop, start: Array) -> tuple[Array, float]:
    """Best fit, with saturation where that leaves clearly less."""
    plain, where = loop.search(start)
    guess = _with_saturation(loop.data, plain, where)
    if guess is None:
        return plain, where
    both, there = loop.search(guess)
    before, after = (float(np.sum(loop.residual(p, e) ** 2)) for p, e in ((plain, where), (both, there)))
    seen = np.linalg.norm(loop.jacobian(both, there)[:, 4]) > 0
    # One more parameter always leaves less, by about the variance of a reading; twelve of them are requested.
    return (both, there) if seen and after < before * (1.0 - 12.0 / len(loop.data.force)) else (plain, where)


def _prepare(recording: Recording) -> _Data:
    """Rows in order; where weights have many readings, the mean of the readings at each weight."""
    force, voltage, time = recording[Role.FORCE], recording[Role.VOLTAGE], recording[Role.TIME]
    if float(force.min()) < -0.02 * float(np.ptp(force)):
        raise EppError(
            f"{recording.source}: the force goes down to {force.min():.4g} N; expected forces that only pull."
        )
    if np.ptp(force) <= 0:
        raise EppError(f"{recording.source}: the force never changes; expected weights added and removed.")
    starts = np.flatnonzero(np.diff(force, prepend=np.nan) != 0)
    lengths = np.diff(np.append(starts, force.size))
    weight = np.ones(force.size)
    # A force that stays for many readings is a weight; of a steadily rising one each row counts by itself.
    if starts.size < force.size / 3:
        typical = float(np.median(lengths))
        kept = lengths >= 0.2 * typical
        starts, lengths = starts[kept], lengths[kept]
        places = np.concatenate([np.arange(s, s + n) for s, n in zip(starts, lengths, strict=True)])
        groups = np.repeat(np.arange(starts.size), lengths)
        force, voltage, time = (np.bincount(groups, a[places]) / lengths for a in (force, voltage, time))
        weight = lengths / lengths.mean()
    force = np.maximum(force, 0.0)
    span = float(np.ptp(time)) or 1.0
    noise = float(np.median(np.abs(np.diff(force)))) if starts.size >= recording[Role.FORCE].size / 3 else 0.0
    pieces = strokes(force, max(_TURN * float(np.ptp(force)), min(4 * noise, 0.2 * float(np.ptp(force)))))
    used = ~_after_gaps(force, pieces)
    return _Data((time - time.mean()) / span, force, voltage, np.sqrt(weight), used, pieces)


def _after_gaps(force: Array, pieces: tuple[Stroke, ...]) -> BoolArray:
    """Rows behind a turn at which rows are missing: how far the force went there is not known."""
    out = np.zeros(force.size, bool)
    steps = np.abs(np.diff(force))
    usual = 1.6 * float(np.median(steps[steps > 0]))
    for before, piece in zip(pieces, pieces[1:], strict=False):
        turn = before.last
        if np.all(steps[max(turn - 2, 0) : turn + 1] <= usual):
            continue
        edge = force[before.last - 1]
        back = force[piece.first : piece.last]
        out[piece.first : piece.last] = (
            back > _SURELY_BACK * edge if piece.direction < 0 else back < edge / _SURELY_BACK
        )
    return out


def _start(data: _Data, source: str) -> Array:
    """A first guess: offset, drift, logarithm of the gain, a."""
    if len({piece.direction for piece in data.pieces}) < 2:
        way = "rises" if data.pieces and data.pieces[0].direction > 0 else "falls"
        raise EppError(
            f"{source}: the force only {way}, so sensor gain and pulley friction cannot be separated; expected "
            "loading and unloading."
        )
    low = data.voltage < data.voltage.min() + 0.7 * np.ptp(data.voltage)
    columns = np.column_stack([np.ones(low.sum()), data.force[low]])
    offset, gain = np.linalg.lstsq(columns, data.voltage[low], rcond=None)[0]
    if gain <= 0:
        raise EppError(
            f"{source}: the voltage falls as the force rises; expected a sensor whose voltage rises with force."
        )
    return np.array([offset, 0.0, math.log(gain), 0.02])


def _with_saturation(data: _Data, p: Array, where: float) -> Array | None:
    """A guess with saturation, where the highest readings stay below what the fit without it expects of them."""
    cut = data.voltage < data.voltage.min() + 0.8 * np.ptp(data.voltage)
    loop = _Loop(replace(data, used=data.used & cut))
    inner, _ = loop.fit(p, where)
    expected = loop.model(inner, where)
    scatter = float(np.std((expected - data.voltage)[cut]))
    top = float(np.quantile(data.voltage, 0.995)) - 2.0 * scatter
    beyond = expected > top + 4.0 * scatter
    if np.sum(beyond) < 3:
        return None
    return np.append(inner, float(np.median(data.voltage[beyond])))


class _Loop:
    """The model and its fits at a given half width E of the standstill."""

    def __init__(self, data: _Data) -> None:
        self.data = data

    def model(self, p: Array, where: float) -> Array:
        """Voltage at every row."""
        d = self.data
        sensed = sensor_force(d.force, d.pieces, Pulley.of_force(2.0 * where - p[3], p[3]))
        volts = p[0] + p[1] * d.time + math.exp(p[2]) * sensed
        return np.minimum(volts, p[4]) if p.size > 4 else volts

    def residual(self, p: Array, where: float) -> Array:
        """Model less measurement, weighted by the readings behind each row."""
        return ((self.model(p, where) - self.data.voltage) * self.data.weight)[self.data.used]

    def jacobian(self, p: Array, where: float) -> Array:
        """Central differences; the standstill keeps its place, so the model is smooth in all of them."""
        out = np.empty((int(self.data.used.sum()), p.size))
        for j in range(p.size):
            h = 1e-6 * max(1.0, abs(p[j]))
            up, down = p.copy(), p.copy()
            up[j] += h
            down[j] -= h
            out[:, j] = (self.residual(up, where) - self.residual(down, where)) / (2 * h)
        return out

    def fit(self, start: Array, where: float) -> tuple[Array, float]:
        """Parameters at a given standstill, and their sum of squares; Gauss and Newton's steps, halved as needed."""
        p, r = start, self.residual(start, where)
        cost = float(r @ r)
        for _ in range(30):
            jacobian = self.jacobian(p, where)
            step = np.linalg.lstsq(jacobian, -r, rcond=1e-10)[0]
            step[2:4] = np.clip(step[2:4], -0.3, 0.3)
            for _ in range(12):
                trial = p + step
                r_trial = self.residual(trial, where)
                lower = float(r_trial @ r_trial)
                if lower <= cost:
                    break
                step = 0.5 * step
            else:
                return p, cost
            done = cost - lower <= 1e-12 * cost
            p, r, cost = trial, r_trial, lower
            if done:
                break
        return p, cost

    def search(self, start: Array) -> tuple[Array, float]:
        """Best fit over all standstills."""
        best, where, least = start, 0.0, math.inf
        # With the standstill rows change from sticking to sliding, and the sum of
        # squares jumps: it is scanned, and only the others are fitted by derivatives.
        for share in (0.0, *np.geomspace(0.002, 0.35, 36)):
            p, cost = self.fit(np.where(np.arange(start.size) == 3, share, start), share)
            if cost < least:
                best, where, least = p, share, cost
        for _ in range(2):
            for share in where * np.linspace(0.85, 1.15, 31):
                p, cost = self.fit(best, share)
                if cost < least:
                    best, where, least = p, float(share), cost
        return best, where


@dataclass(frozen=True, eq=False)
class _Posterior:
    """Weights of pairs (a, E) on a grid: what the data and the possible kinetic ratios leave of both frictions."""

    kinetic: Array
    static: Array
    weight: Array


def _posterior(loop: _Loop, best: Array, where: float, noise: Weighted) -> _Posterior:
    """Weights over kinetic friction and standstill.

    At a given standstill everything else is close to linear, so a is normal about its fit; over the standstill the sum
    of squares decides. Ratios of kinetic to static friction are even over what is possible.
    """
    spread = math.sqrt(max(noise.matrix[3, 3], 0.0)) * noise.critical / 1.96
    middle = best[3] + noise.step[3]
    top = max(middle, 0.0) + 5 * spread + 1e-9
    lowest = 0.9 * max(middle - 5 * spread, 1e-3 * spread + 1e-12)
    grid, fits = np.empty(0), np.empty((0, 2))
    fresh = np.append(np.linspace(lowest, 0.5 * (1 + 1 / KINETIC_RATIOS[0]) * top * 1.05, 121), where)
    for _ in range(4):
        grid, fits = np.append(grid, fresh), np.vstack([fits, [_at(loop, best, float(e), noise) for e in fresh]])
        order = np.argsort(grid)
        grid, fits = grid[order], fits[order]
        log_weight = -0.5 * (fits[:, 1] - fits[:, 1].min())
        near = np.flatnonzero(log_weight > -8.0)
        first, last = max(near[0] - 1, 0), min(near[-1] + 1, grid.size - 1)
        if last - first > 40:
            break
        fresh = np.setdiff1d(np.linspace(grid[first], grid[last], 62)[1:-1], grid)
    cells = np.gradient(grid)
    a = np.linspace(1e-6 * top, top, 801)
    sd = max(spread, 1e-3 * top / 8)
    normal = np.exp(np.clip(log_weight[:, None], -700, 0) - 0.5 * ((a[None, :] - fits[:, :1]) / sd) ** 2)
    b = 2.0 * grid[:, None] - a[None, :]
    with np.errstate(all="ignore"):
        ratio = a[None, :] / b
        # Even over the ratio a/b, whose derivative by b is a/b^2 in size.
        prior = np.where((b > 0) & (ratio >= KINETIC_RATIOS[0]) & (ratio <= KINETIC_RATIOS[1]), a[None, :] / b**2, 0.0)
    weight = normal * prior * cells[:, None]
    if not weight.sum() > 0:
        weight = np.where(prior > 0, normal + 1e-300, 0.0)
    return _Posterior(np.tanh(np.broadcast_to(a, b.shape)), np.tanh(b), weight / weight.sum())


def _at(loop: _Loop, start: Array, where: float, noise: Weighted) -> tuple[float, float]:
    """Kinetic friction and weighted sum of squares of the fit at a given standstill."""
    p, _ = loop.fit(start, where)
    columns, residual = noise.whiten(loop.jacobian(p, where)), noise.whiten(loop.residual(p, where))
    step = np.linalg.lstsq(columns, -residual, rcond=None)[0]
    return float(p[3] + step[3]), float(np.sum((residual + columns @ step) ** 2))


def _densest(values: Array, weight: Array, floor: float, ceiling: float) -> tuple[float, float, float]:
    """Mean and ends of the shortest interval that holds 95 % of the weight."""
    order = np.argsort(values, axis=None)
    v, w = values.ravel()[order], weight.ravel()[order]
    used = w > 0
    v, w = v[used], w[used]
    total = np.cumsum(w) / w.sum()
    starts = np.concatenate([[0.0], total[:-1]])
    ends = np.searchsorted(total, np.minimum(starts + 0.95, 1.0 - 1e-12))
    inside = starts + 0.95 <= 1.0
    widths = np.where(inside, v[np.minimum(ends, v.size - 1)] - v, math.inf)
    i = int(np.argmin(widths))
    low, high = float(v[i]), float(v[min(int(ends[i]), v.size - 1)])
    span = high - low
    # An end that is nearly at the border of what is possible says nothing against the border itself.
    low = floor if low - floor < 0.1 * span else low
    high = ceiling if ceiling - high < 0.1 * span else high
    return float(v @ w / w.sum()), low, high


def _estimates(
    recording: Recording, best: Array, noise: Weighted, post: _Posterior, sine: float
) -> tuple[Estimate, ...]:
    half = noise.half_widths()
    gain = math.exp(best[2])
    mean, low, high = _densest(post.static / sine, post.weight, 0.0, math.inf)
    low_k, high_k = KINETIC_RATIOS
    mean = mean if low > 0.0 else 0.0  # what cannot be distinguished from no friction is none
    angle = f"loaded at {2 * math.degrees(math.asin(min(sine, 1.0))):.4g} deg"
    friction = Estimate(
        "pulley.friction", mean, low, high, note=f"{angle}; kinetic over static {low_k:g} to {high_k:g}"
    )
    ratio = Estimate("pulley.kinetic_ratio", *_densest(post.kinetic / post.static, post.weight, low_k, high_k))
    # Nothing was learned about the ratio where its interval is about what was possible before.
    if ratio.high - ratio.low > 0.7 * (high_k - low_k):
        why = "the weights are too coarse or the friction is too small to identify where the pulley breaks away."
        ratio = Estimate(ratio.name, ratio.value, ratio.low, ratio.high, identified=False, note=why)
    ends = gain * np.exp(np.array([-half[2], half[2]]))
    out = [friction, ratio, Estimate("sensor.gain", gain, float(ends[0]), float(ends[1]), "V/N", "V/lbf")]
    if best.size > 4:
        scatter = float(np.std(np.diff(recording[Role.VOLTAGE]))) / math.sqrt(2)
        wide = math.hypot(float(half[4]), 0.95 * rounding(recording.resolution[Role.VOLTAGE], scatter))
        level = float(best[4])
        out.append(Estimate("sensor.full_scale", level, level - wide, level + wide, "V", "V", note="saturation"))
    return tuple(out)


def _result(
    recording: Recording, data: _Data, loop: _Loop, best: Array, where: float, estimates: tuple[Estimate, ...]
) -> BenchFit:
    notes = recording.sentences()
    if len(best) == 4:
        notes.append(f"The voltage never saturates: full scale is above {data.voltage.max():.4g} V.")
    if not any(data.weight != 1.0) or data.weight.size == recording[Role.FORCE].size:
        notes.append(f"{len(data.pieces)} strokes of the force.")
    else:
        notes.append(f"{data.force.size} weights in {len(data.pieces)} strokes, each the mean of its readings.")
    model = loop.model(best, where)
    residual = model - data.voltage
    found = Residual(float(np.sqrt(np.mean(residual**2))), lag_one(residual), float(best[1]), "V")
    curves = {
        "panels": {
            "voltage": {"x": data.force, "y": data.voltage, "fit": model, "residual": -residual, "units": ("N", "V")}
        },
        "x": "force",
        "time": data.time,
    }
    settings = {"kinetic_ratios": list(KINETIC_RATIOS), "rows": recording.n_rows}
    return BenchFit(
        "weight tray", recording.source, estimates, {"voltage": found}, tuple(notes), recording.n_rows, data.force.size,
        curves=curves, provenance=Provenance("weight tray", settings),
    )  # fmt: skip
