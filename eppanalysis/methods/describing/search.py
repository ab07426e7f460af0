"""Global search for one element whose describing function does not depend on frequency.

Amplitude scales come from the element's thresholds and from where the loop gain passes one, frequency scales from
poles, zeros and dead time; nothing is measured in absolute units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial

import numpy as np

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.methods.describing.balance import Balance, ranges
from eppanalysis.methods.describing.bias import SingleBias, goes_one_way, spread
from eppanalysis.methods.describing.curves import (
    at_index,
    contour_lines,
    crossings,
    distinct,
    roots_at_once,
    settle,
    up_to_zero,
)
from eppanalysis.models.systems.linear import poles, zeros
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.readable import count
from eppanalysis.roots import between, stretches

#: Phase of the dead time [rad] up to which frequencies are searched, and between two of them.
_MOST_PHASE, _PHASE_STEP = 800.0, 0.2
#: Places beside a frequency at which the linear part changes, relative to it.
_BESIDE = np.concatenate([-np.geomspace(1e-7, 0.1, 8), [1e-10], np.geomspace(1e-7, 0.1, 8)])
#: Amplitudes at which gains are held against what the linear part needs, relative to a threshold.
_FAR = np.geomspace(1e-60, 1e60, 601)
#: Share of a pole's or zero's imaginary part in its size from which it may resonate.
_RESONANT = 0.03
#: Gain at a resonance, relative to those of frequencies ten a decade, from which these miss it, and it is not damped.
_SHARP, _UNDAMPED = 3.0, 1e9
#: Logarithm of a loop gain between nodes that surely is not one; gain below which the logarithm goes on as its tangent.
_FAR_FROM_ONE, _FAINT = 4.0, 1e-3
#: Sections of an interval at once, and how often, to the last digits.
_SECTIONS, _ROUNDS = 64, 8
#: Breakpoints around which biases are sought where the static balance has several answers.
_MOST_CENTRES = 8
_MANY_STEPS = (
    " The static balance has several solutions on pieces of the element: biases were sought around zero and the first "
    f"{_MOST_CENTRES} breakpoints; cycles about others may be missing."
)
#: Amplitudes against which biases are held where they may be many; of an element each of whose answers is a quadrature,
#: against half as many biases.
_AMPLITUDES, _FEW_AMPLITUDES = 250, 60
_UNBALANCED = "At no amplitude is there a bias with which the static balance holds."
_FEW_PLACES = (
    " The means of its element are quadratures: a branch of the bias was sought at a tenth of the places. Cycles on a "
    "small one, or between two jumps of the describing function near each other, may be missing."
)
#: Branches of the bias that are followed: an element that turns back for ever, such as a sine, has them without end.
_MOST_BRANCHES = 40
_MANY_BRANCHES = (
    f" The static balance has more solutions than can be followed: the {_MOST_BRANCHES} branches of the bias with the "
    "smallest oscillations and biases were; cycles on others may be missing."
)


@dataclass(frozen=True, eq=False)
class Found:
    """Limit cycles (k, 3 m + 1), the curves they were found on, how, whether the whole request is covered, and
    whether it was sought on a grid between whose points cycles may lie. Besides, points of the curves beside which the
    loop gain passes one and the balance has not been solved.
    """

    cycles: Array
    curves: tuple[Array, ...]
    search: str
    complete: bool = True
    on_grid: bool = False
    unsolved: Array = field(default_factory=lambda: np.zeros((0, 4)))


def is_one_loop(system: LureSystem) -> bool:
    """Whether a loop has one element with one input and one output that the frequency does not change."""
    first = system.elements[0]
    return len(system.elements) == first.n_inputs == first.n_outputs == 1 and not first.of_frequency


@lru_cache(maxsize=16)
def frequency_scales(system: LureSystem) -> Array:
    """Positive frequencies [rad/s] at which the linear part changes its slope: poles, zeros, dead time.

    Of a measured part these are not known: those between which it is measured.
    """
    if isinstance(system, DataSystem):
        return np.array(system.band)
    n = system.A.shape[0]
    values: ComplexArray = poles(system.A - np.eye(n)) + 1.0 if system.time_step else poles(system.A)
    values = np.concatenate([values, _zeros(system)])
    if system.time_step:
        values = np.asarray(np.log(values[np.abs(values) > 1e-9]) / system.time_step, complex)
    # The imaginary part counts where it shows in a resonance; of a multiple real pole it is rounding.
    turns = np.abs(values.imag)
    sizes = np.concatenate([np.abs(values), turns[turns > _RESONANT * np.abs(values)]])
    sizes = sizes[sizes > 1e-7 * sizes.max(initial=0.0)]
    late = system.delays[system.delays > 0]
    return np.unique(np.concatenate([sizes, 1.0 / late]))


def _zeros(system: LureSystem) -> ComplexArray:
    """Finite transmission zeros of a loop with one element."""
    n = system.A.shape[0]
    if len(system.elements) != 1 or system.B.shape[1] != 1 or not n:
        return np.zeros(0, complex)
    A, B, C, D = system.A, system.B, system.C[:1], system.D[:1]
    return zeros(A - np.eye(n), B, C, D) + 1.0 if system.time_step else zeros(A, B, C, D)


def symmetry_candidates(system: LureSystem) -> Array:
    """Frequencies of all real values of a rational L(j omega): zeros of ``L(s) - L(-s)`` next to the imaginary axis."""
    if system.time_step or np.any(system.delays) or system.A.shape[0] == 0:
        return np.zeros(0)
    A, B, C = system.A, system.B, system.C[:1]
    n = len(A)
    both = np.zeros((2 * n, 2 * n))
    both[:n, :n], both[n:, n:] = A, -A
    s = zeros(both, np.concatenate([B, B]), np.concatenate([C, C], 1), np.zeros((1, 1)))
    # A real rational L(jw) equals L(-jw): its real values are zeros of the difference, none of which a grid can step
    # over.
    s = s[(s.imag > 0) & (np.abs(s.real) < 1e-3 * np.abs(s))]
    return np.unique(s.imag)


def frequency_nodes(system: LureSystem, per_decade: int, lowest_gain: float = 0.0) -> Array:
    """Ascending grid of omega [rad/s], denser at lightly damped poles, zeros and real values of L.

    With dead time, or a sample time, phase keeps turning: nodes are then also evenly spaced, up to where the gain has
    fallen below `lowest_gain` for good (or to half the sampling frequency). Without such a bound a loop with dead time
    has infinitely many modes; those whose period is shorter than the dead time are left out. Measured loops have nodes
    between the lowest and the highest frequency of their data.
    """
    if isinstance(system, DataSystem):
        return system.frequency_nodes()
    scales = frequency_scales(system)
    if system.time_step:
        top = np.pi / system.time_step
        low = min(float(scales.min(initial=top)), top) / 1e3
        nodes = [
            np.geomspace(low, top * (1.0 - 1e-9), 8 * per_decade),
            np.linspace(0.0, top, 20 * per_decade + 2)[1:-1],
        ]
    else:
        low, top = (scales.min() / 1e3, scales.max() * 1e3) if scales.size else (1e-12, 1e12)
        nodes = [np.geomspace(low, top, int(per_decade * np.log10(top / low)) + 2)]
    around = np.concatenate([scales, symmetry_candidates(system) if system.B.shape[1] == 1 else np.zeros(0)])
    nodes.append((around[:, None] * (1.0 + _BESIDE)).ravel())
    if np.any(system.delays):
        bounded = lowest_gain > 0
        top = _gain_limit(system, np.concatenate(nodes), lowest_gain) if bounded else 2 * np.pi / system.delays.max()
        step, top = _PHASE_STEP / system.delays.max(), min(top, dead_time_reach(system))
        nodes.append(np.arange(1, int(top / step) + 2) * step)
    out = np.unique(np.concatenate(nodes))
    return out[(out > 0) & (out <= top)]


def dead_time_reach(system: LureSystem) -> float:
    """Frequency [rad/s] up to which the phase of the dead time is searched; infinite without one."""
    latest = 0.0 if isinstance(system, DataSystem) else float(system.delays.max(initial=0.0))
    return _MOST_PHASE / latest if latest else np.inf


def _gain_limit(system: LureSystem, omega: Array, lowest_gain: float) -> float:
    """Frequency beyond which the gain stays below `lowest_gain`."""
    omega = np.sort(omega)
    gain = np.abs(system.frequency_response(omega)[:, 0, 0])
    above = np.flatnonzero(gain >= lowest_gain)
    return float(omega[min(above[-1] + 1, len(omega) - 1)]) if above.size else float(omega[0])


def amplitude_scales(
    balance: Balance, gains: Array, sizes: Array, single: SingleBias | None = None, stands: Sequence[float] = (0.0,)
) -> Array:
    """Positive amplitudes that matter: `sizes`, and where the element's gain meets 1/`gains` of the linear part.

    The gain is that about the bias of each amplitude where there is a `single` one, else about each bias in `stands`.
    """
    reference = sizes[(sizes > 0) & np.isfinite(sizes)]
    middle = float(np.exp(np.log(reference).mean())) if reference.size else 1.0
    far, asked = middle * _FAR, gains[(gains > 0) & (gains < np.inf)]
    found = [reference]
    for bias in [single.at(far)] if single is not None else [np.full(far.size, stand) for stand in stands]:
        # Next to a bias, smaller amplitudes are lost in its rounding.
        a, b = (v[far > 1e-9 * np.abs(bias)] for v in (far, bias))
        N = np.abs(balance.evaluate(a[:, None], b[:, None], np.ones(a.size))[1][:, 0])
        above = N[:, None] * asked - 1 > 0
        found.append(a[:-1][np.any(above[:-1] != above[1:], axis=1)])
        # A gain that no frequency needs changes all the same: that of a sine, behind a small gain of the loop.
        found.append(a[np.flatnonzero(N / N[0] < 0.5)[:1]] if a.size and not any(v.size for v in found) else a[:0])
    return np.unique(np.concatenate(found))


def amplitude_nodes(scales: Array, thresholds: Array, per_decade: int) -> Array:
    """Ascending grid of amplitudes, geometrically denser towards each threshold from both sides."""
    low, high = scales.min() / 1e2, scales.max() * 1e2
    nodes = [np.geomspace(low, high, int(per_decade * np.log10(high / low)) + 2)]
    gaps = np.unique(thresholds[thresholds > 0])
    nodes.append(nodes_beside(gaps, spread(gaps.size)))
    if gaps.size > 1:
        parts = np.arange(1, 8) / 8.0
        nodes.append((gaps[:-1, None] + parts * np.diff(gaps)[:, None]).ravel())
    out = np.unique(np.concatenate(nodes))
    return out[out > 0]


def nodes_beside(thresholds: Array, spread: Array) -> Array:
    """Amplitudes about ascending thresholds, at relative distances `spread` from each.

    Half the way to the next threshold at most: beyond it the nodes of that one are nearer.
    """
    around = thresholds[:, None] * spread
    below, above = np.diff(thresholds, prepend=0.0)[:, None] / 2, np.diff(thresholds, append=np.inf)[:, None] / 2
    return np.asarray((thresholds[:, None] + around)[(-below < around) & (around < above)])


def search_one(balance: Balance) -> Found:
    """All limit cycles of a loop with one element of one output whose describing function is free of omega."""
    system = balance.system
    single = SingleBias.of(balance)
    thresholds = thresholds_of(balance) if single is None else single.thresholds()
    pieces = system.elements[0].breakpoints.size
    sizes = thresholds if pieces else np.append(thresholds, np.abs(balance.operating_bias))
    # About a jump on which the mean may be the gain of small amplitudes is that of a relay.
    stands = (0.0, *system.elements[0].breakpoints[:_MOST_CENTRES])
    scales = amplitude_scales(balance, crossing_gains(system), sizes, single, stands)
    if not scales.size:
        never = single is not None and not np.any(np.isfinite(single.at(np.ones(1))))
        return Found(np.zeros((0, 4)), (), _UNBALANCED if never else "The element has one gain: the loop is linear.")
    amplitude = amplitude_nodes(scales, thresholds, 24)
    if single is not None:
        return _search_single(single, amplitude)
    # Without a bias, for how far the frequencies must reach alone; cycles are sought along the static balance's curves.
    N = balance.evaluate(amplitude[:, None], np.zeros((len(amplitude), 1)), np.ones(len(amplitude)))[1][:, 0]
    omega = frequency_nodes(system, 40, _lowest_gain(N))
    L = balance.linear(omega)[:, 0, 0]
    lines, followed, coarse = static_curves(balance, amplitude, scales)
    gains = [balance.evaluate(line[:, :1], line[:, 1:], np.ones(len(line)))[1][:, 0] for line in lines]
    real = all(map(_is_real, gains))
    finder = _on_crossings if real else _on_phase_curves
    cycles, curves, unsolved = finder(balance, list(zip(lines, gains, strict=True)), omega, L)
    text = _sentence(system, real, omega, amplitude, len(lines))
    few, whole = pieces <= _MOST_CENTRES, _is_whole(system, omega)
    text += _MANY_STEPS * (not few) + _MANY_BRANCHES * (not followed) + _FEW_PLACES * coarse
    complete = few and followed and whole and not coarse
    return Found(distinct(balance, cycles), tuple(curves), text, complete, unsolved=unsolved)


def _search_single(single: SingleBias, amplitude: Array) -> Found:
    """All limit cycles where each amplitude has one mean: every phase crossing, all roots in amplitude at each."""
    balance = single.balance
    amplitude = single.with_turns(amplitude)
    bias = single.at(amplitude)
    amplitude, bias = amplitude[np.isfinite(bias)], bias[np.isfinite(bias)]
    if not amplitude.size:
        return Found(np.zeros((0, 4)), (), _UNBALANCED)
    gains = balance.evaluate(amplitude[:, None], bias[:, None], np.ones(len(amplitude)))[1][:, 0]
    omega = frequency_nodes(balance.system, 40, _lowest_gain(gains))
    L = balance.linear(omega)[:, 0, 0]
    # The gain is real, so that the loop can close only where L is: its frequencies are found once for all amplitudes.
    N = np.asarray(gains.real, float)
    cycles = [np.zeros((0, 4))]
    for w in phase_crossings(balance, omega, L):
        gain = float(balance.linear(np.array([w]))[0, 0, 0].real)
        cycles.append(_roots_in_amplitude(balance, amplitude, N * gain, w, gain, single.at))
    text = _sentence(balance.system, True, omega, amplitude, 1)
    return Found(distinct(balance, np.concatenate(cycles)), (), text, _is_whole(balance.system, omega))


def thresholds_of(balance: Balance) -> Array:
    """Sizes of the element's thresholds."""
    return np.abs(np.asarray(balance.system.elements[0].thresholds(), float)).ravel()


def crossing_gains(system: LureSystem) -> Array:
    """Gains of the linear part that can meet the locus: ten a decade between its frequency scales, and at peaks."""
    scales = frequency_scales(system)
    if isinstance(system, DataSystem):
        low, high = system.band
    else:
        low, high = (scales.min() / 10, scales.max() * 10) if scales.size else (1e-12, 1e12)
    n = 10 * int(np.ceil(np.log10(high / low)))
    # In the middle of an even number of intervals, so that no point is on the pole of a single resonance.
    omega = low * (high / low) ** ((np.arange(2 * (n // 2)) + 0.5) / (2 * (n // 2)))
    gain = np.abs(system.frequency_response(np.append(omega, scales))[:, 0, 0])
    gain, peaks = gain[: omega.size], gain[omega.size :]
    gain = gain[np.isfinite(gain) & (gain > 0)]
    # A sharp peak lies between them; that of what is not damped has no bound, and says nothing of sizes.
    share = peaks / gain.max(initial=0.0)
    return np.append(gain, peaks[(share > _SHARP) & (share < _UNDAMPED)])


def _lowest_gain(N: ComplexArray) -> float:
    """Gain of the linear part below which the element cannot make up for it; 0 for an element of unbounded gain."""
    size = np.abs(N[np.isfinite(N)])
    top = size.max(initial=0.0)
    if top == 0:
        return np.inf
    # Greatest at an end of the amplitudes and falling from there, as that of a jump or of a power, it has no bound.
    share = max(len(size) // 20, 1)
    ends = size[:share], size[::-1][:share]
    unbounded = any(end[0] == top and end.min() < 0.9 * top for end in ends)
    return 0.0 if unbounded else 0.999 / top


def static_curves(balance: Balance, amplitude: Array, scales: Array) -> tuple[list[Array], bool, bool]:
    """Curves (n, 2) of (amplitude, bias) on which the static balance holds.

    Besides whether all branches that were found are among them, and whether they were sought at few places.
    """
    symmetric = _needs_no_bias(balance, amplitude)
    lines = [np.stack([amplitude, np.zeros(len(amplitude))], -1)] if symmetric else []
    if _prescribed_alone(balance):
        fixed = float(balance.prescribed[0] / balance.on_bias[0, 0])
        return lines or [_with_turns(balance, np.stack([amplitude, np.full(len(amplitude), fixed)], -1))], True, False
    bias = _bias_nodes(balance, scales)
    bias = bias[bias > 0] if symmetric else bias
    # Where all slopes turn the balance the same way no bias beside none is expected: that is held against few
    # amplitudes, and only what contradicts it needs all.
    few = (
        symmetric
        and goes_one_way(balance)
        and not _branches(balance, amplitude[:: len(amplitude) // 25 + 1], bias, True)
    )
    dear = balance.system.elements[0].by_quadrature
    every = max(1, len(amplitude) // (_FEW_AMPLITUDES if dear else _AMPLITUDES))
    branches = [] if few else _branches(balance, amplitude[::every], bias[:: 1 + dear], symmetric)
    branches.sort(key=lambda points: float(np.min(points[:, 0] + np.abs(points[:, 1]))))
    for branch in branches[:_MOST_BRANCHES]:
        points = _settle_bias(balance, branch)
        if dear:
            points = _settle_bias(balance, _denser(points, _AMPLITUDES // _FEW_AMPLITUDES))
        points = _with_turns(balance, points)
        lines += [points, points * [1.0, -1.0]] if symmetric else [points]
    return lines, len(branches) <= _MOST_BRANCHES, dear and not few


def _denser(points: Array, times: int) -> Array:
    """As many points between two neighbours, even in the logarithm of the amplitude and in the bias."""
    place = np.linspace(0.0, len(points) - 1.0, times * (len(points) - 1) + 1)
    return np.stack([np.exp(at_index(np.log(points[:, 0]), place)), at_index(points[:, 1], place)], -1)


def _with_turns(balance: Balance, points: Array) -> Array:
    """A curve of the static balance, denser around where an oscillation about its bias reaches one more threshold."""
    element = balance.system.elements[0]

    def on_curve(place: Array) -> Array:
        """Points at fractional indices."""
        i = np.minimum(place.astype(int), len(points) - 2)
        a, ends = np.exp(at_index(np.log(points[:, 0]), place)), np.stack([points[i, 1], points[i + 1, 1]])
        margin = _margin(a, np.abs(ends).max(axis=0))
        return _balanced(
            balance, a, ends.min(axis=0) - margin, ends.max(axis=0) + margin, at_index(points[:, 1], place)
        )

    def spared(at: Array) -> Array:
        """How many thresholds the oscillation does not pass; on a jump it reaches one, to rounding."""
        return np.array([np.count_nonzero(element.thresholds(float(b)) >= a * (1.0 - 1e-9)) for a, b in at])

    counts = spared(points)
    first = np.flatnonzero((counts[1:] != counts[:-1]) & (points[1:, 0] != points[:-1, 0]))
    if not first.size:
        return points
    # Sections of many at once: a point costs hardly more than one of many.
    high, step = first.astype(float), 1.0
    for _ in range(_ROUNDS):
        step /= _SECTIONS
        places = high[:, None] + step * np.arange(1, _SECTIONS)
        before = spared(on_curve(places.ravel())).reshape(places.shape) == counts[first, None]
        high += step * np.cumprod(before, axis=1).sum(axis=1)
    high += step
    around = spread(len(element.thresholds()))
    room = np.where(around[:, None] < 0.0, high - first, first + 1.0 - high)
    places = np.concatenate([np.arange(len(points), dtype=float), (high + room * around[:, None]).ravel()])
    rows = np.concatenate([points, on_curve(places[len(points) :])])
    return rows[np.unique(places, return_index=True)[1]]


def _branches(balance: Balance, amplitude: Array, bias: Array, symmetric: bool) -> list[Array]:
    """Contours (n, 2) on which the static balance holds, but for the line of no bias where that is one."""
    grid = _static(balance, *np.broadcast_arrays(amplitude[:, None], bias[None, :]))
    if symmetric:
        # The line of no bias is known already; dividing by the bias leaves the others.
        grid = grid / bias
    return [
        np.stack([np.exp(at_index(np.log(amplitude), line[:, 0])), at_index(bias, line[:, 1])], -1)
        for line in contour_lines(grid)
        if len(line) > 1
    ]


def _prescribed_alone(balance: Balance) -> bool:
    return not np.any(balance.on_mean) and balance.on_bias[0, 0] != 0


def _static(balance: Balance, a: Array, b: Array) -> Array:
    mean = balance.evaluate(a[..., None], b[..., None], np.ones(np.shape(a)))[0][..., 0]
    return balance.on_bias[0, 0] * b + balance.on_mean[0, 0] * mean - balance.prescribed[0]


def _needs_no_bias(balance: Balance, a: Array) -> bool:
    """Whether the static balance holds without a bias at all amplitudes, but for rounding."""
    mean, gain = (v[:, 0] for v in balance.evaluate(a[:, None], np.zeros((len(a), 1)), np.ones(len(a))))
    of_bias, of_mean, prescribed = balance.on_bias[0, 0], balance.on_mean[0, 0], balance.prescribed[0]
    left = np.abs(of_mean * mean - prescribed)
    size = np.abs(of_bias) * a + np.abs(of_mean) * (np.abs(mean) + np.abs(gain) * a)
    return bool(np.all((left <= 1e-9 * size) | ~np.isfinite(left)))


def _bias_nodes(balance: Balance, scales: Array) -> Array:
    """Biases of both signs on logarithmic grids, denser around zero and around where the loop may be.

    A piecewise-linear element may be on any of its pieces, wherever the loop starts.
    """
    steps = np.geomspace(scales.min() * 1e-3, scales.max() * 1e3, int(14 * np.log10(scales.max() / scales.min() * 1e6)))
    breakpoints = balance.system.elements[0].breakpoints
    stands = breakpoints[:_MOST_CENTRES] if breakpoints.size else balance.operating_bias[:1]
    centres = [0.0, *stands]
    if balance.on_bias[0, 0]:
        centres.append(balance.prescribed[0] / balance.on_bias[0, 0])
    around = [np.concatenate([[c], c + steps, c - steps]) for c in {float(c) for c in centres}]
    return np.unique(np.concatenate(around))


def _settle_bias(balance: Balance, points: Array) -> Array:
    """Bring contour points onto the static balance by bisection in the bias."""
    a, b = points.T
    margin = _margin(a, np.abs(b))
    return _balanced(balance, a, b - margin, b + margin, b)


def _margin(amplitude: Array, bias: Array) -> Array:
    """How far a bias of this size may be off between nodes."""
    return 0.2 * bias + 1e-3 * amplitude


def _balanced(balance: Balance, a: Array, low: Array, high: Array, otherwise: Array) -> Array:
    """Points (n, 2) of the static balance between two biases, at another one where it does not change its sign."""
    # In a bracket: the slope of the mean is infinite where the input just reaches a jump, and Newton fails there.
    found = between(lambda bias, i: _static(balance, a[i], bias), low, high)
    return np.stack([a, np.where(np.isnan(found), otherwise, found)], -1)


def _is_real(N: ComplexArray) -> bool:
    N = N[np.isfinite(N)]
    return bool(np.abs(N.imag).max(initial=0.0) <= 1e-12 * np.abs(N).max(initial=0.0))


def phase_crossings(balance: Balance, omega: Array, L: ComplexArray) -> Array:
    """All omega of the grid's range at which L(j omega) is real, to rounding."""

    def sine(w: Array) -> Array:
        return _sine(balance.linear(w)[:, 0, 0])

    with np.errstate(all="ignore"):
        return roots_at_once(sine, omega, _sine(L), accept=1e-7)


def _sine(L: ComplexArray) -> Array:
    return np.asarray(L.imag / np.abs(L), float)


def _on_crossings(
    balance: Balance, lines: list[tuple[Array, ComplexArray]], omega: Array, L: ComplexArray
) -> tuple[Array, list[Array], Array]:
    """Real gain: each phase crossing by itself, all roots in amplitude along each branch of the bias."""
    cycles, curves = [np.zeros((0, 4))], []
    for w in phase_crossings(balance, omega, L):
        gain = float(balance.linear(np.array([w]))[0, 0, 0].real)
        for line, gains in lines:
            N = np.asarray(gains.real, float)
            # With one bias the loop gain is a function of the amplitude alone; else the balance of means goes along
            # with it.
            if np.all(line[:, 1] == line[0, 1]):
                one_bias = partial(np.full_like, fill_value=line[0, 1])
                cycles.append(_roots_in_amplitude(balance, line[:, 0], N * gain, w, gain, one_bias))
                continue
            for piece, loop_gain in up_to_zero(balance, line, N * gain, w, gain):
                curves += settle(balance, [_points(piece, np.full(len(piece), w), loop_gain)])
    crossed, unsolved = crossings(balance, curves)
    return np.concatenate([*cycles, crossed]), curves, unsolved


def _roots_in_amplitude(
    balance: Balance, amplitude: Array, loop_gain: Array, omega: float, gain: float, bias_of: Callable[[Array], Array]
) -> Array:
    """Cycles (k, 4) at a phase crossing: where the loop gain, known at ascending amplitudes, passes one."""

    def excess(log_a: Array) -> Array:
        a = np.exp(log_a)
        N = balance.evaluate(a[:, None], bias_of(a)[:, None], np.full(a.size, omega))[1][:, 0].real
        return _log_excess(np.asarray(N * gain, float))

    roots = roots_at_once(excess, np.log(amplitude), _log_excess(loop_gain))
    return np.stack([roots, np.full(roots.size, np.log(omega)), bias_of(np.exp(roots)), np.zeros(roots.size)], -1)


def _log_excess(loop_gain: Array) -> Array:
    # A gain that falls through one and zero within a step goes on below as a line does: a wall there hides the root.
    further = np.log(_FAINT) + loop_gain / _FAINT - 1.0
    return np.where(loop_gain < _FAINT, further, np.log(np.maximum(loop_gain, _FAINT)))


def _points(line: Array, omega: Array, loop_gain: Array) -> Array:
    return np.stack([np.log(line[:, 0]), np.log(omega), line[:, 1], -np.log(np.abs(loop_gain))], -1)


def _on_phase_curves(
    balance: Balance, lines: list[tuple[Array, ComplexArray]], omega: Array, L: ComplexArray
) -> tuple[Array, list[Array], Array]:
    """Complex gain: contours of zero phase in the plane of (place along the bias branch, omega)."""
    pieces: list[Array] = []
    for line, N in lines:
        with np.errstate(all="ignore"):
            n, g = N / np.abs(N), L / np.abs(L)
        sine = np.stack([n.imag, n.real], -1) @ np.stack([g.real, g.imag])
        for path in contour_lines(sine):
            pieces += _phase_pieces(line, N, omega, L, path)
    curves = settle(balance, pieces, 1)
    crossed, unsolved = crossings(balance, curves)
    return crossed, curves, unsolved


def _phase_pieces(line: Array, N: ComplexArray, omega: Array, L: ComplexArray, path: Array) -> list[Array]:
    """Stretches of a contour on which N L is positive; the others, where it is negative, meet them only at poles."""
    loop = np.interp(path[:, 0], np.arange(len(line)), np.abs(N)) * np.exp(at_index(np.log(np.abs(L)), path[:, 1]))
    nearest = np.round(path).astype(int)
    positive = (N[nearest[:, 0]] * L[nearest[:, 1]]).real > 0
    place = np.stack([np.exp(at_index(np.log(line[:, 0]), path[:, 0])), at_index(line[:, 1], path[:, 0])], -1)
    w = np.exp(at_index(np.log(omega), path[:, 1]))
    return [_points(place[run], w[run], loop[run]) for run in stretches(positive & _may_pass_one(loop))]


def _may_pass_one(loop_gain: Array) -> BoolArray:
    """Points of a line beside which its gain, of which these are estimates, may pass one or turn near it."""
    off = np.log(loop_gain)
    beside = np.abs(off) < _FAR_FROM_ONE
    # Next to a resonance it may pass one between two points that are both far from it.
    passes = (off[1:] < 0) != (off[:-1] < 0)
    beside[1:] |= passes
    beside[:-1] |= passes
    return beside | np.append(beside[1:], False) | np.append(False, beside[:-1])


def _is_whole(system: LureSystem, omega: Array) -> bool:
    """Whether a grid goes on to where the gain cannot suffice, and is not cut off where the dead time has turned."""
    return bool(omega[-1] < (1.0 - 1e-9) * dead_time_reach(system))


def _sentence(system: LureSystem, real: bool, omega: Array, amplitude: Array, n_branches: int) -> str:
    how = (
        "every frequency at which the linear part is real, then every amplitude on each branch of the bias"
        if real
        else "contours of zero phase over amplitude and frequency, then every crossing of unit gain along them"
    )
    sizes, frequencies = ranges(system, 0, amplitude, omega)
    text = (
        f"Sought {how} ({count(n_branches, 'branch')} of the bias), with all local extrema located: frequencies from "
        f"{frequencies}, amplitudes from {sizes}."
    )
    if np.any(system.delays):
        text += (
            " Dead time turns the phase without end: faster modes, for which the gain is too small (or, with an "
            "element of unbounded gain, whose period is shorter than the dead time), were left out."
        )
    if not _is_whole(system, omega):
        text += (
            f" Faster cycles than {omega[-1] / (2.0 * np.pi):.3g} Hz are open, because the dead time has turned the "
            f"phase {_MOST_PHASE / (2.0 * np.pi):.0f} times there and the gain may still suffice."
        )
    return text
