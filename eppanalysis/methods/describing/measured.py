"""Predictions of a measured linear part: what its data tell of a cycle, and what they do not.

Between the lowest and the highest measured frequency the search is that of any loop. Added here are stability by
Nyquist's criterion on the data, the harmonics that the data reach, the error by what is between the points, and the
interval that their standard deviation leaves: by the implicit function theorem, as the balance ``N G + 1 = 0`` is moved
by a change of ``ln G`` as by one of ``ln N``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import Array, Balance
from eppanalysis.methods.describing.error import Estimate
from eppanalysis.methods.describing.quality import Point
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.readable import count
from eppanalysis.results import LimitCycle
from eppanalysis.results.measured import MeasuredCycle

#: Harmonic that data must reach at least, and the most that those beyond may be of the element's input.
_LEAST_HARMONIC, _MOST_BEYOND = 3, 0.02
#: Harmonics of the element's output that are counted as there.
_COUNTED = 60
#: Normal deviates of an interval of 95 %.
_NINETY_FIVE = 1.959963984540054
#: Share by which an amplitude is moved to either side of a cycle for Nyquist's criterion.
_BESIDE = 0.01
#: How far from a whole number the slope of a response towards low frequencies may be.
_WHOLE = 0.3
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
        raise ModelError(
            f"{system.name}: the data of {system.data.name!r} end at {system.band[1]:.4g} rad/s, below harmonics that "
            f"matter to the cycle at {omega:.4g} rad/s: those above number {int(system.band[1] / omega)} may make up "
            f"{100.0 * beyond:.2g} % of the element's input",
            expected=f"data up to number {_LEAST_HARMONIC}, and on to where the rest is {_MOST_BEYOND:.0%} or less",
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
    deviation = np.linalg.norm(moved.T * [r.curve.deviation_at(p.omega) for _, _, r in paths], axis=1)
    factors = np.exp(_NINETY_FIVE * deviation).tolist()
    told = {"amplitude": float(p.amplitude[0]), "frequency": cycle.frequency}
    intervals = {name: (v / f, v * f) for (name, v), f in zip(told.items(), factors, strict=True)}
    return MeasuredCycle.of(
        cycle,
        state=np.zeros(0),
        mean_state=np.zeros(0),
        error_estimate=estimate.error + beyond + between,
        intervals=intervals if all(r.deviation is not None for _, _, r in paths) else {},
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
    square = p.jacobian[:, :-1]
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
    system: DataSystem, balance: Balance, points: Sequence[Point], cycles: Sequence[MeasuredCycle]
) -> tuple[str, ...]:
    """Sentences about what the data do not tell."""
    out = [*above_the_data(system, balance, cycles)]
    if len(cycles) < len(points):
        omega = np.array(sorted(p.omega for p in points))[len(cycles) - len(points) :]
        out.append(
            f"Left out: {count(len(omega), 'balance')} from {omega[0]:.4g} rad/s on, as the data end below harmonics "
            "that matter there."
        )
    if not system.means_known:
        out.append("The static gain is not known: cycles with a mean were not sought.")
    for cycle in cycles:
        if cycle.interpolation_error > _COARSE:
            out.append(
                f"Points beside the cycle at {cycle.omega:.4g} rad/s lie off a curve through their neighbours so far "
                f"that its amplitude or frequency may be off by {100.0 * cycle.interpolation_error:.2g} %: closer "
                "points would tell, or, where it is noise, their standard deviation, by which they are smoothed."
            )
    scatter = max(r.curve.scatter for _, _, r in system.data.known)
    if scatter > 1.2:
        out.append(
            f"The points scatter {scatter:.2g} times as much about the fitted curve as their standard deviation "
            "says; intervals are that much wider."
        )
    return tuple(out)


def above_the_data(system: DataSystem, balance: Balance, cycles: Sequence[MeasuredCycle]) -> tuple[str, ...]:
    """Sentence on which cycles faster than the data are not excluded: those whose loop gain can be one there."""
    if system.only is None:
        return (f"Above the data, which end at {system.band[1]:.4g} rad/s, cycles were not sought.",)
    levels = np.abs(np.asarray(system.elements[0].thresholds(), float)).ravel()
    levels = levels[levels > 0]
    a = (float(levels.max()) if levels.size else 1.0) * _AMPLITUDES
    gain = np.abs(balance.evaluate(a[:, None], np.zeros((len(a), 1)), np.ones(len(a)))[1][:, 0])
    most = gain * float(np.abs(system.only.at(system.band[1])))
    reach = a[np.isfinite(most) & (most >= 1.0)]
    least = min((c.amplitude("x") for c in cycles), default=0.0)
    if not reach.size or reach.max() < _SMALL * least:
        return ()
    return (
        f"Above the data, which end at {system.band[1]:.4g} rad/s, cycles of amplitudes up to {reach.max():.3g} are "
        "not excluded: the loop gain there can be more than one.",
    )


def stability_of_data(system: DataSystem, balance: Balance, p: Point) -> tuple[bool | None, str]:
    """Verdict by Nyquist's criterion a little beside the cycle, and the sentence that says by what."""
    if system.only is None:
        return None, "Of several measured paths, or states between them, no criterion tells the stability."
    more, less = (_unstable_poles(system, balance, p, side * _BESIDE) for side in (1.0, -1.0))
    if more is None or less is None:
        return None, "Nyquist's criterion: the data do not show how the loop gain ends, towards zero or upwards."
    if more < 0 or less < 0:
        return None, "Nyquist's criterion: the measured part must have more unstable poles than was said."
    text = (
        f"Nyquist's criterion on the data: with a little more amplitude {more}, with a little less {less} of the poles "
        f"of the quasi-linear loop are unstable, if of the measured part {system.only.unstable_poles or 'none'} are."
    )
    return more == 0, text


def _unstable_poles(system: DataSystem, balance: Balance, p: Point, share: float) -> int | None:
    """Number of unstable poles of the loop with the element as the gain that it is at another amplitude.

    A lag of the element counts as dead time. The curve ``1 + N G`` is closed beyond the data: towards zero by as many
    integrators as its slope shows, upwards by a loop gain below one. None where that is not to be seen.
    """
    gain = _gain_beside(balance, p, share)
    around = np.geomspace(1e-6, 0.3, 40)
    omega = np.concatenate([system.frequency_nodes(), p.omega * (1.0 + around), p.omega * (1.0 - around)])
    low, high = system.band
    omega = np.unique(omega[(omega >= low) & (omega <= high)])
    lag = np.exp(1j * np.angle(gain) * omega / p.omega)
    back = -abs(gain) * lag * system.frequency_response(omega)[:, 0, 0]
    if abs(back[-1]) >= 1.0:
        return None
    turn = np.unwrap(np.angle(1.0 + back))
    start = _start(system, turn, abs(back[0]))
    if start is None:
        return None
    # Above the data the loop gain is below one, and 1 + N G ends at one. Each half turn about zero up to there is a
    # pole less on the right (docs/theory/measured.md, Stability).
    end = 2.0 * np.pi * np.round(turn[-1] / (2.0 * np.pi))
    return _only(system).unstable_poles - round((end - start) / np.pi)


def _only(system: DataSystem) -> MeasuredResponse:
    assert system.only is not None
    return system.only


def _start(system: DataSystem, turn: Array, size: float) -> float | None:
    """Argument, a multiple of pi, of ``1 + N G`` where it leaves the real axis at zero frequency."""
    gain = _only(system).static_gain
    if gain is not None and np.isfinite(gain):
        return float(np.pi * np.round(turn[0] / np.pi))
    value, by_omega = _only(system).with_slope(system.band[0])
    slope = float((system.band[0] * by_omega / value).real)
    if slope > 1.0 - _WHOLE and size < 1.0:
        return float(2.0 * np.pi * np.round(turn[0] / (2.0 * np.pi)))
    # Of k integrators 1 + N G comes from infinity, a quarter turn behind the real axis for each.
    integrators = max(0, round(-slope))
    if abs(slope + integrators) > _WHOLE:
        return None
    return float(np.pi * np.round((turn[0] + 0.5 * np.pi * integrators) / np.pi))


def _gain_beside(balance: Balance, p: Point, share: float) -> complex:
    """Gain of the element with the amplitude changed by a share, and the mean with it."""
    # The balance of the means moves the bias with the amplitude, by the implicit function theorem.
    static = balance.on_bias[0, 0] + balance.on_mean[0, 0] * p.slopes_of_mean[1][0]
    by_amplitude = balance.on_mean[0, 0] * p.slopes_of_mean[0][0]
    bias = -by_amplitude / static if by_amplitude and static else 0.0
    return complex(p.gain[0] + share * (p.slopes_of_gain[0][0] + bias * p.slopes_of_gain[1][0]))
