"""Where the DF cannot see: cycles of harmonics, sticking that integral action ends, slow drift, no state of rest.

All are looked for on the loop itself. A balance with harmonics is begun where the DF balance comes nearest to
a cycle that it just does not have. Of an element that sticks, which a sine never does, what drives it is tested for
rest meanwhile: where it grows without end, under integral action or on a moving belt, sticking and slipping
alternate (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083). And an element that jumps over the
only output with which the loop could rest (an encoder between two levels under integral action) keeps it moving,
whatever a sine would do, unless its switching dies out there. Where nothing turns the phase of a sine (a relay on two
integrators) it swings at any size. Where nothing damps a drift through a dead zone (a satellite between the thresholds
of its thrusters), pulses turn it about.
In discrete time the samples of a sine fall on either side of a jump as their phase wants: a whole region of gains
belongs to an amplitude, and cycles of whole numbers of samples lock where it reaches the balance (Kuo, Analysis and
Synthesis of Sampled-Data Control Systems, 1963, chapter 8).
And where the linear part swings undamped by itself its response has no number: of a cycle there the DF says where
the gain of the element passes zero, and no more (x'' + x with what van der Pol adds as the element).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import Balance, unit_at_input
from eppanalysis.methods.describing.equilibrium import no_rest
from eppanalysis.methods.describing.error import BalancedOscillation, Estimate
from eppanalysis.methods.describing.multi import fed
from eppanalysis.methods.describing.quality import Point
from eppanalysis.methods.describing.search import (
    Found,
    amplitude_nodes,
    amplitude_scales,
    crossing_gains,
    frequency_nodes,
    frequency_scales,
    is_one_loop,
    static_curves,
    thresholds_of,
)
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.harmonic.loop import Loop
from eppanalysis.methods.margins.reach import out_of_reach
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import poles, zeros
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.readable import listed, quantity, readable
from eppanalysis.results import Notice

#: Distance of the loop gain from one, up to which harmonics may make up for it, and how many places are tried.
_NEAR, _PLACES = 0.3, 3
#: Distance, in logarithms of amplitude and frequency, within which a place is that of a predicted cycle.
_BESIDE = 0.1
#: Orders of the balances that are tried, the share by which the last may differ from the one before, and the one by
#: which a cycle differs from a predicted one.
_ORDERS, _SETTLED, _OTHER = (3, 9, 15), 0.03, 0.2
#: Share of a pole's size below which its real part is rounding.
_UNDAMPED = 1e-9
#: Samples a turn of cycles that may lock to them, phases of the samples and amplitudes, in thresholds, that are tried,
#: and the distance of the loop gain from one, in logarithms, up to which harmonics may make up for it.
_TURNS, _PHASES, _LOCKS = range(2, 61), 16, 0.15
_SIZES = np.array([1.0001, 1.01, 1.03, 1.08, 1.2, 1.5, 2.0, 3.0, 5.0])


def blind_spots(
    balance: Balance, points: Sequence[Point], estimates: Sequence[Estimate], found: Found, stable: bool
) -> tuple[str, ...]:
    """Sentences about cycles that the loop may have beside the predicted ones; empty for most loops.

    Parameters
    ----------
    stable : bool
        Whether any predicted cycle is: then the loop need not be tested for rest.
    """
    of_any_size = [*_conservative(balance)]
    beyond = [*out_of_reach(balance.system, balance.static)]
    without_rest = [] if stable or of_any_size or beyond else no_rest(balance)
    return tuple(
        [
            *_unsolved(balance, points, found),
            *made_by_harmonics(balance, points, estimates, found),
            *_undamped(balance),
            *of_any_size,
            *beyond,
            *_stick_slip(balance),
            *([] if stable else _jumps_on(balance)),
            *_drift(balance),
            *_locked(balance, points),
            *without_rest,
        ]
    )


def made_by_harmonics(
    balance: Balance, points: Sequence[Point], estimates: Sequence[Estimate], found: Found
) -> Iterator[str]:
    """Balances with harmonics that are none of the predicted cycles, nor what harmonics make of these."""
    # Where the loop gain nearly comes to one, harmonics may make up what is missing
    # (docs/how_we_know.md, What the DF cannot see).
    places = near_misses(balance, points, found)
    known = [m for e in estimates for m in e.oscillations]
    if not places:
        return
    try:
        loop = Loop.with_means(balance.system, balance.static)
    except ModelError:
        return
    for x in places:
        a, phase, b, omega = (v[0] for v in balance.unpack(x[None]))
        here = _refined(BalancedOscillation.of(balance, loop, a, phase, b, float(omega)))
        if here is None or any(_same(here, m) for m in known):
            continue
        known.append(here)
        size = quantity(2.0 * abs(here.Z[0, 1]), unit_at_input(balance.system, 0))
        gain, seen = 100.0 * np.expm1(abs(x[-1])), here.omega / (2.0 * np.pi)
        yield (
            f"The describing function misses a cycle that harmonics make: its loop gain misses 1 by {gain:.2g} % near "
            f"{omega / (2.0 * np.pi):.4g} Hz. A balance of {here.order} harmonics has it at {seen:.4g} Hz, with {size} "
            f"peak to peak of the fundamental at {balance.system.element_names[0]}."
        )


def _same(one: BalancedOscillation, other: BalancedOscillation) -> bool:
    """Whether two motions are nearly as fast and as large."""
    sizes = [np.append(np.abs(m.Z[:, 1]), m.omega) for m in (one, other)]
    return bool(np.abs(sizes[0] / sizes[1] - 1.0).max() < _OTHER)


def _refined(start: BalancedOscillation) -> BalancedOscillation | None:
    """The balance with harmonics near a motion, if it is settled; None otherwise."""
    here, last = start, start
    try:
        for order in _ORDERS:
            if order > start.loop.highest(start.omega):
                return None
            found = here.with_harmonics(order)
            if found is None:
                return None
            here, last = found, here
        change = float(np.abs(here.measures / last.measures - 1.0).max())
        return here if change < _SETTLED and not here.grazes else None
    except Unsettled:
        return None


def near_misses(balance: Balance, points: Sequence[Point], found: Found) -> list[Array]:
    """Vectors of unknowns at which the loop gain comes nearest to one without reaching it, nearest first."""
    one = is_one_loop(balance.system)
    places = _misses_of_one(balance) if one else [x for curve in found.curves for x in _extrema(curve)]
    near = [x for x in _away_from(balance, points, places) if abs(x[-1]) < _NEAR]
    return sorted(near, key=lambda x: abs(float(x[-1])))[:_PLACES]


def _extrema(curve: Array) -> Iterator[Array]:
    """Points of a curve where the missing gain is least, on either side of none."""
    size = np.abs(curve[:, -1])
    same = np.sign(curve[:-2, -1]) == np.sign(curve[2:, -1])
    yield from curve[1:-1][same & (size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:])]


def _misses_of_one(balance: Balance) -> list[Array]:
    """For one element without a mean: amplitudes and frequencies at which ``N L`` is nearest to one."""
    thresholds = np.abs(np.asarray(balance.system.elements[0].thresholds(), float)).ravel()
    thresholds = np.unique(thresholds[(thresholds > 0) & np.isfinite(thresholds)])[:20]
    if not thresholds.size or np.any(balance.prescribed):
        return []
    coarse = np.geomspace(thresholds.min() / 3.0, 30.0 * thresholds.max(), 160)
    above = thresholds[:, None] * (1.0 + np.geomspace(1e-3, 0.3, 12))
    amplitude, omega = np.unique(np.concatenate([coarse, above.ravel()])), frequency_nodes(balance.system, 30)
    mean, gain = balance.evaluate(amplitude[:, None], np.zeros((len(amplitude), 1)), np.ones(len(amplitude)))
    if np.abs(mean).max() > 1e-9 * (np.abs(gain[:, 0]) * amplitude).max():
        return []
    loop = gain[:, 0, None] * balance.linear(omega)[None, :, 0, 0]
    # The size of the complex logarithm: what is missing in gain and in phase as one distance.
    off = np.abs(np.log(np.where(np.abs(loop) > 0, loop, 1e-300)))
    inner, least = off[1:-1, 1:-1], np.ones(off[1:-1, 1:-1].shape, bool)
    for i in (-1, 0, 1):
        for k in (-1, 0, 1):
            least &= inner <= off[1 + i : off.shape[0] - 1 + i, 1 + k : off.shape[1] - 1 + k]
    places = np.argwhere(least & (inner < _NEAR)) + 1
    return [np.array([np.log(amplitude[i]), np.log(omega[k]), 0.0, off[i, k]]) for i, k in places]


def _unsolved(balance: Balance, points: Sequence[Point], found: Found) -> Iterator[str]:
    """Where a curve of the search passes a loop gain of one and the balance has no solution that was found."""
    for x in _away_from(balance, points, found.unsolved):
        size = quantity(2.0 * float(np.exp(x[0])), unit_at_input(balance.system, balance.pivot))
        yield (
            f"The loop gain passes one near {float(np.exp(x[1])) / (2.0 * np.pi):.4g} Hz with {size} peak to peak at "
            f"{balance.system.element_names[balance.pivot]}, where the balance was not solved: a cycle there is not "
            "listed."
        )


def _away_from(balance: Balance, points: Sequence[Point], places: Sequence[Array] | Array) -> list[Array]:
    """Vectors of unknowns that are not beside a predicted cycle."""
    pivot = balance.pivot
    cycles = np.array([[np.log(p.amplitude[pivot]), np.log(p.omega)] for p in points]).reshape(-1, 2)
    return [x for x in places if np.all(np.abs(cycles - x[:2]).max(1) > _BESIDE)]


def _undamped(balance: Balance) -> Iterator[str]:
    """One element on a linear part that swings undamped by itself: amplitudes at which its gain passes zero."""
    system = balance.system
    if not is_one_loop(system) or system.time_step:
        return
    p = poles(system.A)
    alone = np.unique(np.abs(p[(p.imag > 0) & (np.abs(p.real) < _UNDAMPED * np.abs(p))]))
    beside, away = (np.abs(balance.linear(alone * share)[:, 0, 0]) for share in (1.0 + 1e-7, 1.3))
    alone = alone[beside > 1e3 * away]
    sizes: set[str] = set()
    unit, factor = readable(unit_at_input(system, 0))
    unit = f" {unit}".rstrip()
    for line, gains in _along_the_static_balance(balance) if alone.size else ():
        gain = gains.real
        for i in np.flatnonzero(gain[:-1] * gain[1:] < 0):
            share = gain[i] / (gain[i] - gain[i + 1])
            sizes.add(f"{factor * 2.0 * float(line[i, 0] + share * (line[i + 1, 0] - line[i, 0])):.2g}")
    if sizes:
        yield (
            f"The linear part is undamped at {listed([f'{w / (2.0 * np.pi):.4g}' for w in alone])} Hz. The describing "
            f"function has cycles of about {listed(sorted(sizes, key=float)[:_PLACES])}{unit} peak to peak there at "
            f"{system.element_names[0]}; its gain passes zero, so they are not followed here."
        )


def _conservative(balance: Balance) -> Iterator[str]:
    """One element that turns no phase, on a linear part that turns none either, but for its sign: nothing is damped."""
    system = balance.system
    if not is_one_loop(system) or system.time_step or np.any(system.delays) or isinstance(system, DataSystem):
        return
    nodes = frequency_nodes(system, 1)
    L = balance.linear(np.geomspace(nodes[0], nodes[-1], 96))[:, 0, 0]
    # Of most frequencies: at the ends the rounding of turned states has a phase of its own.
    if np.median(np.abs(L.imag) / np.abs(L)) <= _UNDAMPED and any(
        _meets(np.multiply.outer(gain, L)) for _, gain in _along_the_static_balance(balance)
    ):
        name = system.element_names[0]
        yield (
            f"Nothing damps the loop: neither its linear part nor {name} delays a sine at any frequency. The balance "
            "holds for a whole range of sizes, each at another frequency, and a swing keeps its size; damping or "
            "delay outside the model makes it decay or grow."
        )


def _meets(loop_gain: ComplexArray) -> bool:
    """Whether a loop gain over amplitudes and frequencies is real and, at an amplitude, passes one."""
    gain, real = loop_gain.real, np.abs(loop_gain.imag).max() <= _UNDAMPED * np.abs(loop_gain).max()
    return bool(real and np.any(np.any(gain > 1.0, 1) & np.any((gain > 0.0) & (gain < 1.0), 1)))


def _along_the_static_balance(balance: Balance) -> Iterator[tuple[Array, ComplexArray]]:
    """Amplitudes and biases (n, 2) at which the static balance holds, and the element's gains there, a branch each."""
    thresholds = thresholds_of(balance)
    scales = amplitude_scales(balance, crossing_gains(balance.system), thresholds)
    if scales.size:
        for line in static_curves(balance, amplitude_nodes(scales, thresholds, 24), scales)[0]:
            yield line, balance.evaluate(line[:, :1], line[:, 1:], np.ones(len(line)))[1][:, 0]


def _stick_slip(balance: Balance) -> Iterator[str]:
    """Friction that is greater at rest than in motion, where the loop pulls ever harder while it sticks.

    It holds its input only where it acts on it.
    """
    system = balance.system
    for i, e in enumerate(system.elements):
        holds = e.sticks_and_slips and fed(system)[i, i]
        if holds and ((winds_up := _winds_up(balance, i)) or _is_dragged(balance, i)):
            why, how = ("integral action", "hunt") if winds_up else ("what drags it", "judder")
            name = system.element_names[i]
            yield Notice(
                f"{name} sticks, which the describing function does not see, and {why} ends the sticking: the loop may "
                f"{how}, in cycles of sticking and slipping that are not predicted here.",
                f"{name} sticks, and {why} ends the sticking",
                sure=False,
            )


def _jumps_on(balance: Balance) -> Iterator[str]:
    """A valve that sticks and slips, where what the loop needs of it while it sticks grows without end.

    A mean output of every size holds the loop, but by jumps only some are reached.
    """
    names = balance.system.element_names
    for i, e in enumerate(balance.system.elements):
        if e.goes_on_in_jumps and any(_slow_slope(balance, i, g) < -0.5 for g in _gains(balance)):
            cause = f"{names[i]} moves in jumps after sticking, and integral action ends the sticking"
            yield Notice(
                f"{cause}: the loop may hunt about a place between two jumps, in cycles that are not predicted here.",
                cause,
                sure=False,
            )


def _is_dragged(balance: Balance, element: int) -> bool:
    """Whether no mean force holds an element's input at zero: what moves under it, a belt or a disc, goes on."""
    others = np.hstack([np.delete(balance.on_bias, element, axis=1), balance.on_mean])
    left = balance.prescribed - others @ np.linalg.lstsq(others, balance.prescribed)[0]
    return bool(np.abs(left).max(initial=0.0) > _UNDAMPED * np.abs(balance.prescribed).max(initial=0.0))


def _winds_up(balance: Balance, element: int) -> bool:
    """Whether the force that holds an element's input at rest grows without end.

    It does where the response from the force to the input falls at least as ``s**2`` towards ``s = 0``: one zero there
    is that of a speed, the others are the loop's integrators. Those of a law whose integrator is held at a limit are
    there within the limits alone: the others are what they are at rest, or in large motions.
    """
    return any(_slow_slope(balance, element, gains) > 1.5 for gains in _gains(balance))


def _drift(balance: Balance) -> Iterator[str]:
    """On-off elements with a dead zone through which the loop drifts undamped, at whatever speed it has."""
    system = balance.system
    off = {i: levels for i, e in enumerate(system.elements) if (levels := _levels_beside_off(e))}
    idle = np.where(np.isin(balance.owner, [*off])[:, None], 0.0, _large_gains(balance))
    if not off or np.any(balance.prescribed) or not all(_slow_slope(balance, i, idle) < -1.5 for i in off):
        return
    # Levels of one side each turn a drift about together.
    first = next(iter(off))
    slow = balance.linear(np.array([1e-5 * _slowest(system, first)]))[0, first].real
    ways = {float(np.sign(slow[balance.owner == i][0]) * level) for i, levels in off.items() for level in levels}
    if {-1.0, 1.0} <= ways:
        names = listed([system.element_names[i] for i in off])
        yield (
            f"Nothing damps the loop between the thresholds of {names}, where it drifts: it may "
            "swing slowly from one to the other, in cycles that are not predicted here."
        )


def _levels_beside_off(e: Nonlinearity) -> list[float]:
    """Signs of the levels of an element that is off in small oscillations about zero; none of any other."""
    edges = np.abs(np.asarray(e.thresholds(), float))
    edges = edges[edges > 0]
    if not edges.size or (e.n_inputs, e.n_outputs) != (1, 1):
        return []
    modes = e.automaton().mode_columns
    level = np.sign(modes["constant"][~modes["sticking"], 0])  # beside those that slide along an edge
    follows = any(np.any(modes[name]) for name in ("from_input", "from_memory", "from_smooth"))
    on_off = not follows and sorted(level) in ([-1.0, 0.0, 1.0], [-1.0, 0.0], [0.0, 1.0])
    idle = on_off and not np.any(e.describing_function(0.5 * edges.min()))
    return [sign for sign in level.tolist() if sign] if idle else []


def jumps(e: Nonlinearity) -> bool:
    """Whether the output of an element jumps with its input."""
    return not np.all(np.isfinite(e.slope_bounds()))


def _locked(balance: Balance, points: Sequence[Point]) -> Iterator[str]:
    """In discrete time elements that jump: numbers of samples to which cycles may lock beside those predicted."""
    system = balance.system
    if not system.time_step:
        return
    gains = [np.where(np.isfinite(gain), gain, 0.0) for gain in (e.linear_gain() for e in system.elements)]
    slopes = np.zeros((balance.owner.size, balance.m))
    for i, gain in enumerate(gains):
        slopes[balance.owner == i, i] = gain[:, 0]
    bias = np.linalg.lstsq(balance.on_bias + balance.on_mean @ slopes, balance.prescribed)[0]
    known = np.array([2.0 * np.pi / (p.omega * system.time_step) for p in points])
    for i, e in enumerate(system.elements):
        if (e.n_inputs, e.n_outputs) != (1, 1) or not jumps(e):
            continue
        turns = [n for n in _TURNS if _misses_between_samples(balance, i, float(bias[i]), n) < _LOCKS]
        turns = [n for n in turns if np.all(np.abs(known - n) > 1.0)]
        if turns:
            which = f"{turns[0]}" if len(turns) == 1 else f"{turns[0]} to {turns[-1]}"
            yield (
                "The describing function does not see where the samples fall beside the jumps of "
                f"{system.element_names[i]}: cycles of about {which} samples a turn, or of several such turns, may "
                "lock to them that are not predicted here."
            )


def _misses_between_samples(balance: Balance, element: int, bias: float, n: int) -> float:
    """How far the loop gain is from one, in logarithms, for sines of n samples a turn at their best phase and size."""
    system = balance.system
    e, omega = system.elements[element], 2.0 * np.pi / (n * float(system.time_step or 1.0))
    L = _response(balance, element, omega, _large_gains(balance))
    sizes = e.thresholds(bias)
    sizes = sizes[np.isfinite(sizes)][:6, None] * _SIZES
    if not sizes.size:
        sizes = abs(L) * np.abs(e.output(bias + np.array([-1.0, 1.0]))[0]).max() * _SIZES
    turn = np.exp(-2j * np.pi * np.arange(n) / n)
    phase = 2.0 * np.pi * (np.arange(2 * n) + (np.arange(_PHASES)[:, None] + 0.5) / _PHASES) / n
    z = bias + sizes.reshape(-1, 1, 1) * np.sin(phase)
    memory, w = None, np.empty_like(z)
    for k in range(2 * n):  # what an element remembers is its own in the second turn
        w[..., k], memory = e.output(z[..., k], memory)
    gain = (w[..., n:] @ turn) / (z[..., n:] @ turn)
    return float(np.abs(np.log(np.where(gain * L == 0.0, 1e-300, gain * L))).min())


def _slow_slope(balance: Balance, element: int, gains: ComplexArray) -> float:
    """Power of s with which the response from an element's output to its input begins at ``s = 0``; zero if unknown."""
    if balance.system.time_step:
        return 0.0
    slow = np.array([1e-5, 1e-4]) * _slowest(balance.system, element)
    size = np.array([abs(_response(balance, element, w, gains)) for w in slow])
    return float(np.log10(size[1] / size[0])) if np.all(size > 0) else 0.0


def _slowest(system: LureSystem, element: int) -> float:
    """Frequency of the slowest pole, or where there is none zero of an element's own, off the origin; else any."""
    scales = frequency_scales(system)
    if not scales.size:
        row, out = system.input_slices[element].start, system.output_slices[element].start
        own = np.abs(zeros(system.A, system.B[:, [out]], system.C[[row]], system.D[[row]][:, [out]]))
        scales = own[own > _UNDAMPED * own.max(initial=0.0)]
    return float(scales.min()) if scales.size else 1.0


def _response(balance: Balance, element: int, omega: float, gains: ComplexArray) -> complex:
    """From an element's output to its input, the loop closed by gains (nw, nz) of the others."""
    mine = balance.owner == element
    G = balance.system.frequency_response(np.array([omega]))[0]
    others = np.where(mine[:, None], 0.0, gains)
    closed = np.linalg.solve(np.eye(len(G)) - G @ others, G[:, mine].sum(1))
    return complex(closed[balance.rows[element]])


def _large_gains(balance: Balance) -> ComplexArray:
    """Gains (nw, nz) from the first inputs of all elements in motions twice as large as their thresholds."""
    spans = [np.abs(np.asarray(e.thresholds(), float)).max(initial=0.0) or 1.0 for e in balance.system.elements]
    gain = np.nan_to_num(balance.evaluate(2.0 * np.array([spans]), np.zeros((1, balance.m)), np.ones(1))[1][0])
    gains = np.zeros((balance.owner.size, balance.system.C.shape[0]), complex)
    gains[np.arange(balance.owner.size), balance.rows[balance.owner]] = gain
    return gains


def _gains(balance: Balance) -> tuple[ComplexArray, ComplexArray]:
    """The same of large motions and of small ones."""
    return _large_gains(balance), _steepest(balance)


def _steepest(balance: Balance) -> ComplexArray:
    """The same of motions that are small, as margins have them; where these have none, those of large ones."""
    gains, system = _large_gains(balance), balance.system
    for e, z, w in zip(system.elements, system.input_slices, system.output_slices, strict=True):
        if np.all(np.isfinite(small := e.linear_gain())):
            gains[w, z] = small
    return gains
