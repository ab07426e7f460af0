"""Predictions of a measured linear part: what its data tell of a cycle, and what they do not.

Between the lowest and the highest measured frequency the search is that of any loop. Added here are the harmonics that
the data reach, the error by what is between the points, and the intervals that their standard deviation leaves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.describing.data.intervals import Noise
from eppanalysis.methods.describing.error import Estimate
from eppanalysis.methods.describing.neglected_harmonics import near_misses
from eppanalysis.methods.describing.quality import Point
from eppanalysis.methods.describing.search import Found
from eppanalysis.methods.harmonic.averaged import of_samples
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.readable import count
from eppanalysis.results import LimitCycle
from eppanalysis.results.measured import MeasuredCycle

#: Harmonic that data must reach at least, and the most that those beyond may be of the element's input.
_LEAST_HARMONIC, _MOST_BEYOND = 3, 0.02
#: Harmonics of the element's output that are counted as there.
_COUNTED = 60
#: Errors between the points from which a sentence says so.
_COARSE = 0.01
#: Amplitudes of cycles above the data, over the scales of the element.
_AMPLITUDES = np.geomspace(1e-12, 1e6, 1200)
#: Share of the smallest cycle's amplitude below which those above the data are not worth a sentence.
_SMALL = 1e-3


def of_data(
    system: DataSystem,
    balance: Balance,
    points: Sequence[Point],
    estimates: Sequence[Estimate],
    cycles: Sequence[LimitCycle],
) -> tuple[list[Point], tuple[MeasuredCycle, ...]]:
    """The balances whose harmonics the data reach, and their cycles with what belongs to their data.

    Raises
    ------
    ModelError
        If there are cycles, and the data end below harmonics that matter to every one of them.
    """
    reached = [_reached(system, balance, p) for p in points]
    if points and not any(ok for ok, _ in reached):
        omega, (_, beyond) = min((p.omega, r) for p, r in zip(points, reached, strict=True))
        most = 100 * _MOST_BEYOND
        raise ModelError(
            f"{system.name}: the data of {system.data.name!r} end at {system.band[1]:.4g} rad/s, below harmonics that "
            f"matter to the cycle at {omega:.4g} rad/s: those above number {int(system.band[1] / omega)} may make up "
            f"{100.0 * beyond:.2g} % of the element's input",
            expected=f"data up to number {_LEAST_HARMONIC}, and on to where the rest is at most {most:g} %",
        )
    found = [(*r, p, e, c) for r, p, e, c in zip(reached, points, estimates, cycles, strict=True) if r[0]]
    return [p for _, _, p, _, _ in found], tuple(
        _of_data(system, balance, p, e, c, beyond) for _, beyond, p, e, c in found
    )


def _reached(system: DataSystem, balance: Balance, p: Point) -> tuple[bool, float]:
    """Whether the data reach the harmonics that matter, and the most that those beyond may be."""
    highest = system.highest_harmonic(p.omega)
    beyond = _beyond(system, balance, p, highest)
    return highest >= _LEAST_HARMONIC and not beyond > _MOST_BEYOND, beyond


def _of_data(
    system: DataSystem, balance: Balance, p: Point, estimate: Estimate, cycle: LimitCycle, beyond: float
) -> MeasuredCycle:
    paths = system.data.known
    moved = _moved(system, balance, p)
    between = float((moved.T @ [r.curve.error_between(p.omega) for _, _, r in paths]).max())
    noise = Noise.of(system, balance)
    interval = noise.interval(p.unknowns(balance)) if noise else None
    return MeasuredCycle.of(
        of_samples(system, replace(cycle, error_estimate=estimate.error + beyond + between)),
        state=np.zeros(0),
        mean_state=np.zeros(0),
        intervals=interval.in_hertz if interval else {},
        at_a_fold=interval.at_a_fold if interval else False,
        interpolation_error=between,
        highest_harmonic=system.highest_harmonic(p.omega),
        beyond=beyond,
    )


def _moved(system: DataSystem, balance: Balance, p: Point) -> Array:
    """By how much ln a of the first element and ln omega move with a unit of ``ln G`` of each path, shape (paths, 2).

    In magnitude or in phase, at most. The residual is ``L N Z / Z - 1`` at each input, of which a change of L is a
    change itself at the root; what a path changes in L, its own states between them, is a difference.
    """
    m, Z = balance.m, p.amplitude * np.exp(1j * p.phase)
    square = balance.residual(p.unknowns(balance)[None])[1][0][:, :-1]
    size = np.abs(square).max(0)
    scale = np.maximum(np.abs(square / size).max(1), 1e-300)
    inverse = np.linalg.inv(square / size / scale[:, None]) / size[:, None] / scale
    first = inverse[[balance.places[0], 1]]
    outputs = (p.gain * Z[balance.owner])[None, None, :]
    changed = (system.by_path(p.omega)[:, balance.rows] * outputs).sum(-1) / Z
    in_phase = [np.concatenate([turn.real, turn.imag], -1) for turn in (changed, 1j * changed)]
    by_data = np.array([rows @ first[:, : 2 * m].T for rows in in_phase])
    return np.asarray(np.hypot(*by_data), float)


def _beyond(system: DataSystem, balance: Balance, p: Point, highest: int) -> float:
    """Most that harmonics above the data are of an input, over its fundamental, with responses that rise no more.

    Not a number where the harmonics of an element are not known.
    """
    try:
        loop = Loop.with_means(system, balance.static)
    except ModelError:
        return float("nan")
    Z = np.zeros((balance.m, _COUNTED + 1), complex)
    Z[:, 0], Z[:, 1] = p.bias, -1j * p.amplitude * np.exp(1j * p.phase)
    W, _ = loop.answers(Z, p.omega)
    last = np.abs(system.frequency_response(system.band[1])[balance.rows])
    rest = np.sqrt((np.abs(W[:, max(highest, 1) + 1 :]) ** 2).sum(1))
    return float((last @ rest / p.amplitude).max())


def cautions(
    system: DataSystem, balance: Balance, points: Sequence[Point], found: Found, cycles: Sequence[MeasuredCycle]
) -> tuple[str, ...]:
    """Sentences about what the data do not tell."""
    out = [*above_the_data(system, balance, cycles)]
    if len(cycles) < len(points):
        omega = np.array(sorted(p.omega for p in points))[len(cycles) - len(points) :]
        out.append(
            f"Left out: {count(len(omega), 'balance')} from {omega[0]:.4g} rad/s on, as the data end below harmonics "
            "that matter there."
        )
    if any(np.isnan(c.beyond) for c in cycles):
        out.append("The effect of harmonics above the data is unknown, as the harmonics of an element are unknown.")
    if not system.means_known:
        out.append("The static gain is not known: cycles with a mean were not sought.")
    for cycle in cycles:
        if cycle.interpolation_error > _COARSE:
            out.append(
                f"Points beside the cycle at {cycle.omega:.4g} rad/s lie off a curve through their neighbours: its "
                f"amplitude or frequency may be off by {100.0 * cycle.interpolation_error:.2g} %. Give closer points "
                "or, if this is noise, its standard deviation, which smooths them."
            )
    out += _at_the_edge_of_noise(system, balance, points, found, cycles)
    omega = np.array([c.omega for c in cycles])
    scatter = max(float(r.curve.scatter_at(omega).max(initial=r.curve.scatter)) for _, _, r in system.data.known)
    if scatter > 1.2:
        out.append(
            f"The points scatter {scatter:.2g} times as much about the fitted curve as their standard deviation "
            "says; intervals are that much wider."
        )
    return tuple(out)


def above_the_data(system: DataSystem, balance: Balance, cycles: Sequence[MeasuredCycle]) -> tuple[str, ...]:
    """Sentence on which cycles faster than the data are not excluded: those whose loop gain can be one there."""
    if system.only is None:
        return (f"No cycles were sought above the data, which end at {system.band[1]:.4g} rad/s.",)
    levels = np.abs(np.asarray(system.elements[0].thresholds(), float)).ravel()
    levels = levels[levels > 0]
    a = (float(levels.max()) if levels.size else 1.0) * _AMPLITUDES
    gain = np.abs(balance.evaluate(a[:, None], np.zeros((len(a), 1)), np.full(len(a), system.band[1]))[1][:, 0])
    most = gain * float(np.abs(system.only.at(system.band[1])))
    reach = a[np.isfinite(most) & (most >= 1.0)]
    least = min((c.amplitude_of_first for c in cycles), default=0.0)
    if not reach.size or reach.max() < _SMALL * least:
        return ()
    return (
        f"Above the data, which end at {system.band[1]:.4g} rad/s, cycles of amplitudes up to {reach.max():.3g} are "
        "not excluded: the loop gain there can be more than one.",
    )


def _at_the_edge_of_noise(
    system: DataSystem, balance: Balance, points: Sequence[Point], found: Found, cycles: Sequence[MeasuredCycle]
) -> Iterator[str]:
    """Sentences on cycles that errors of the size of the noise take away, and on those that they make."""
    for cycle in cycles:
        if cycle.at_a_fold:
            yield (
                f"The cycle at {cycle.omega:.4g} rad/s with an amplitude of {cycle.amplitude_of_first:.4g} is so near "
                "a fold that errors of the size of the noise remove it together with another: it may not exist, and "
                "its interval reaches across the fold."
            )
    noise = Noise.of(system, balance)
    for interval, off in noise.missed(near_misses(balance, points, found)) if noise else ():
        (low, high), (slow, fast) = interval.amplitude, interval.in_hertz["frequency"]
        yield (
            f"The data leave room for cycles that the fitted curve misses by {off:.2g} standard deviations, with an "
            f"amplitude of {low:.4g} to {high:.4g} at {slow:.4g} to {fast:.4g} Hz."
        )
