"""Global search for several elements, or one whose describing function depends on frequency.

One element, the pivot, is given an amplitude and a frequency; all other inputs and all means then follow from the
balance of the rest (Picard iteration to come near, Newton to the end). What remains is one complex number, the loop
gain around the pivot. Its zero-phase contours in the plane of (amplitude, omega) are solution curves of the loop
with an artificial gain; where that gain is one there is a limit cycle.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.engine.balances import drive
from eppanalysis.methods.describing.balance import ON_THE_WAY, Balance, describe, moved, newton, ranges, solved_in_part
from eppanalysis.methods.describing.curves import contour_lines, crossings, distinct, interpolate, polish, settle
from eppanalysis.methods.describing.search import Found, frequency_scales, nodes_beside
from eppanalysis.methods.describing.trace import Box, trace
from eppanalysis.models.systems.algebraic import reached
from eppanalysis.models.systems.linear import ROUNDING, units_of_states
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import CANCELLED
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.readable import count
from eppanalysis.roots import stretches

_PER_DECADE, _INNER_STEPS = 9, 16
_GAIN_RANGE = 2.5
_MOST_SEEDS = 150
_LEVELS = (0.0, 0.7, -0.7)
_SAME_CURVE = 0.15
#: Amplitudes and frequencies of grids that are led by another element.
_COARSE = 12
#: Seeds that are followed at a time.
_AT_ONCE = 4
#: Share of a measured response within which another is that of the same signal.
_ALIKE = 0.1
#: Loops of their own whose phases are combined; less than a quarter of a turn; phases of others beside the pivot.
_MOST_LOOPS, _QUARTER, _QUARTERS = 8, 1.4, (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi)


def choose_pivot(system: LureSystem) -> int:
    """Element whose input, once given, leaves the fewest of the others in loops of their own.

    If it ties one on a loop, for what only follows a loop tells nothing of it; then the pin; then by the names of their
    kinds, as the order in which a loop lists them must decide nothing.
    """
    m, feeds = len(system.elements), fed(system)
    on_loop = np.diag(reached(feeds))

    def burden(p: int) -> tuple[int, bool, int, str, int]:
        rest = [i for i in range(m) if i != p]
        reach = reached(feeds[np.ix_(rest, rest)]).astype(int)
        # With the pivot's input given, what is in no loop follows by one pass; each loop that is left may have several
        # solutions.
        in_loops = int(sum((reach[i] * reach[:, i]).sum() - reach[i, i] for i in range(len(rest))))
        e = system.elements[p]
        return in_loops, not on_loop[p], -e.n_inputs, type(e).__name__, p

    return min(range(m), key=burden)


def fed(system: LureSystem) -> BoolArray:
    """Which elements (columns) act on the first input of which, through the linear part alone, shape (m, m)."""
    rows, m = [s.start for s in system.input_slices], len(system.elements)
    owner = np.repeat(np.arange(m), [e.n_outputs for e in system.elements])
    scales = frequency_scales(system)
    middle = float(np.exp(np.log(scales).mean())) if scales.size else 1.0
    acts = _acts(system, middle * 1.2345)[rows]
    return np.array([[acts[i, owner == j].any() for j in range(m)] for i in range(m)])


def _acts(system: LureSystem, omega: float) -> BoolArray:
    """Which outputs of elements (columns) act on which of their inputs: a response that is rounding is none.

    In turned coordinates of the state a response of nothing is a sum whose terms cancel, or what passes through entries
    of A that are zero but for rounding: in even units of the states those are known to a share of the largest ones.
    """
    response = np.abs(system.frequency_response(np.array([omega]))[0])
    if isinstance(system, DataSystem):
        return np.asarray(response != 0)
    unit = units_of_states(system.A, system.around)
    A, B, C = system.A * unit / unit[:, None], system.B / unit[:, None], system.C * unit
    within = np.linalg.inv(1j * omega * np.eye(len(A)) - A)
    into, out = np.linalg.norm(within @ B, axis=0), np.linalg.norm(C @ within, axis=1)
    terms = np.abs(C) @ np.abs(within) @ np.abs(B) + np.abs(system.D)
    return np.asarray(response > CANCELLED * terms + ROUNDING * np.linalg.norm(A) * np.outer(out, into))


def search_several(balance: Balance) -> Found:
    """All limit cycles on the solution curves that cross the grid over (amplitude of the pivot, omega)."""
    amplitude, omega = _pivot_nodes(balance), _omega_nodes(balance)
    L = balance.linear(omega)
    pieces: list[Array] = []
    sheets = _sheets(balance, amplitude, omega, L)
    for X, loop in sheets:
        with np.errstate(all="ignore"):
            # The sine of the phase and not the imaginary part: gains differ by decades over the grid, and would bend
            # its contours.
            sine = loop.imag / np.abs(loop)
        for path in contour_lines(sine):
            pieces += _pieces(X, loop, path)
    limits = [(float(np.log(g[0])), float(np.log(g[-1]))) for g in (amplitude, omega)]
    box = Box(limits[0], limits[1], _GAIN_RANGE)
    seeds = _seeds(balance, sheets, [_kept_up(balance, omega, L), *_led_by_others(balance, omega)])
    curves = _followed(balance, settle(balance, pieces), seeds, box)
    crossed, unsolved = crossings(balance, curves)
    cycles = [polish(balance, seeds[seeds[:, -1] == 0.0]), crossed]
    sizes, frequencies = ranges(balance.system, balance.pivot, amplitude, omega)
    search = (
        f"Sought on {len(amplitude)} amplitudes of {balance.system.element_names[balance.pivot]} from {sizes} by "
        f"{len(omega)} frequencies from {frequencies}, all other amplitudes and means solved for at each "
        f"({count(len(sheets), 'branch')}); curves of zero phase that it meets followed to their ends, with all local "
        "extrema of the loop gain located. "
        "A curve that runs wholly between points of this grid may be missed."
    )
    return Found(distinct(balance, np.concatenate(cycles)), tuple(curves), search, on_grid=True, unsolved=unsolved)


def _pieces(X: Array, loop: ComplexArray, path: Array) -> list[Array]:
    """Stretches of a contour with a positive loop gain that is not hopelessly far from one."""
    points, values = interpolate(X, loop, path)
    with np.errstate(all="ignore"):
        points[:, -1] = -np.log(np.abs(values))
        good = np.all(np.isfinite(points), -1) & (values.real > 0) & (np.abs(points[:, -1]) < _GAIN_RANGE)
    return [points[stretch] for stretch in stretches(good)]


def _followed(balance: Balance, lines: list[Array], seeds: Array, box: Box) -> list[Array]:
    """Lines continued beyond both of their ends (the grid only samples them), and further curves through seeds.

    Seeds that may lie on no line are followed a few at a time, as a step takes as long for one as for several; what
    turns out to be followed already is dropped.
    """
    lines = [line for line in lines if len(line) > 1]
    curves: list[Array] = []
    seeds = _apart(seeds, lines)
    while lines or len(seeds):
        few = seeds[:_AT_ONCE]
        begun = [*lines, *few[:, None]]
        start = np.array([end for line in begun for end in (line[0], line[-1])])
        outward = np.zeros_like(start)
        outward[:, 0] = np.tile((1.0, -1.0), len(begun))
        for i, x in enumerate(lines):
            outward[2 * i : 2 * i + 2] = x[0] - x[1], x[-1] - x[-2]
        paths = trace(balance, start, outward, box)
        for i, line in enumerate(begun):
            if i < len(lines) or len(_apart(line, curves)):
                curves.append(np.concatenate([paths[2 * i][::-1], line, paths[2 * i + 1]]))
        lines, seeds = [], _apart(seeds[len(few) :], curves)
    return curves


def _kept_up(balance: Balance, omega: Array, L: ComplexArray) -> Array:
    """Points from which loops that each swing by themselves come to swing together, shape (n, 3 m + 1).

    Driven by the pivot such a loop answers only near its own frequency, between those of the grid. So each begins at
    the size at which it keeps itself up, in each quarter of the pivot's turn (of many, in each half).
    """
    m = balance.m
    if not 1 < m <= _MOST_LOOPS or balance.owner.size > m:
        return np.zeros((0, 3 * m + 1))
    a = np.geomspace(1e-3, 1e3, 121)[:, None] * usual_amplitudes(balance)
    loops = np.diagonal(L, 0, 1, 2)[:, None] * balance.evaluate(a, np.zeros_like(a), np.ones(len(a)))[1]
    up = (np.abs(np.angle(loops[:, 1:])) < _QUARTER) & (np.abs(loops[:, :-1]) >= 1.0) & (np.abs(loops[:, 1:]) < 1.0)
    at = np.flatnonzero(np.all(np.any(up, axis=1), axis=1))
    sizes = a[len(a) - 1 - np.argmax(up[at, ::-1], axis=1), np.arange(m)]
    quarters = _QUARTERS[:: 1 if m <= 3 else 2]
    turns = np.array([*product(*([0.0] if i == balance.pivot else quarters for i in range(m)))])
    n, each = len(turns), np.repeat(np.arange(len(at)), len(turns))
    bias = np.tile(balance.operating_bias, (len(each), 1))
    return balance.pack(sizes[each], np.tile(turns, (len(at), 1)), bias, omega[at][each], np.ones(n * len(at)))


def _seeds(balance: Balance, sheets: list[tuple[Array, ComplexArray]], beside: list[Array]) -> Array:
    """Solutions at a few artificial gains, by Newton from points of the grid that are not far off in phase and gain.

    They reach curves that run between the points of the grid, or along the edge of a region without solutions.
    """
    starts = [_some(points) for points in beside]
    for X, loop in sheets:
        starts.append(_some(X[_near(loop)]))
    start = np.concatenate([np.zeros((0, 3 * balance.m + 1)), *starts])
    levels = np.repeat(_LEVELS, len(start))
    start = np.tile(start, (len(_LEVELS), 1))
    start[:, -1] = levels
    normal = np.zeros_like(start)
    normal[:, -1] = 1.0
    X, ok = newton(balance, start, normal, 18, ON_THE_WAY)
    ok &= np.abs(X - start)[:, :2].max(-1, initial=0.0) < 4.0
    return np.concatenate([distinct(balance, X[ok & (levels == level)]) for level in _LEVELS])


def _near(loop: ComplexArray) -> BoolArray:
    """Points that are off by less than 80 degrees and a factor of twelve: Newton's method still comes home."""
    size = np.abs(np.log(np.abs(loop), where=loop != 0.0, out=np.full(loop.shape, np.inf)))
    near: BoolArray = np.isfinite(loop) & (np.abs(np.angle(loop)) < _QUARTER) & (size < _GAIN_RANGE)
    return near


def _some(points: Array, most: int = _MOST_SEEDS) -> Array:
    return points[:: max(1, len(points) // most)]


def _led_by_others(balance: Balance, omega: Array) -> list[Array]:
    """Points near limit cycles on coarse grids that are led by each of the other elements, (n, 3 m + 1) each.

    Any element may be the only one whose grid meets a curve: which leads must not decide what is found.
    """
    out, few = [], _some(omega, _COARSE)
    for element in balance.others:
        other = replace(balance, pivot=int(element))
        amplitude, L = _some(_pivot_nodes(other), _COARSE), other.linear(few)
        grid, Lg = _grid(amplitude, few, L)
        X = np.concatenate([start_points(other, grid, Lg, *start) for start in _starts(other)])
        X, loop, _ = inner_newton(other, X, np.tile(Lg, (len(X) // len(Lg), 1, 1)))
        a, phase, b, w = other.unpack(X[_near(loop)])
        out.append(balance.pack(a, phase - phase[:, [balance.pivot]], b, w, np.ones(len(w))))
    return out


def _apart(seeds: Array, curves: list[Array]) -> Array:
    """Seeds that lie on none of the known curves."""
    columns = [0, 1, -1]
    known = np.concatenate([c[:, columns] for c in curves]) if curves else np.zeros((0, 3))
    keep = [not len(known) or np.abs(known - x[columns]).max(-1).min() > _SAME_CURVE for x in seeds]
    return seeds[np.array(keep, bool)]


def _pivot_nodes(balance: Balance) -> Array:
    """Amplitudes of the pivot: around its thresholds, its load and the distance of the load from the thresholds."""
    element = balance.system.elements[balance.pivot]
    thresholds = np.abs(np.asarray(element.thresholds(), float)).ravel()
    load = abs(float(balance.operating_bias[balance.pivot]))
    sizes = np.concatenate([thresholds, [load], np.abs(load - thresholds)])
    top = sizes.max(initial=0.0)
    sizes = sizes[sizes > 1e-9 * top]
    if not sizes.size:
        sizes = _foreign_scales(balance)
    low, high = sizes.min() / 30, sizes.max() * 100
    nodes = [np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 1)]
    # Beside a threshold the gain rises like a root.
    spread = np.array([-0.1, -0.03, -0.01, -1e-3, -1e-6, 1e-6, 1e-3, 0.01, 0.03, 0.1])
    nodes.append(nodes_beside(np.unique(thresholds[thresholds > 0]), spread))
    return np.unique(np.concatenate(nodes))


def _foreign_scales(balance: Balance) -> Array:
    """Amplitudes for a pivot without thresholds: where its gain brings the thresholds of the others into play.

    What a relay or dry friction gives does not depend on the amplitude, and brings nothing into play by it: then those
    that the outputs make of its own input, and those at which inputs that move with it reach their thresholds.
    """
    middle = _middle(balance)
    response = np.abs(balance.linear(middle)[0])
    own = balance.owner == balance.pivot
    a, every = _gains(balance, middle)
    gains = every[:, own].max(-1)
    out, beside = [], []
    for i in balance.others:
        reach = response[i, own].max()
        for threshold in np.abs(np.asarray(balance.system.elements[i].thresholds(), float)).ravel():
            if threshold > 0 and reach > 0:
                off = np.log(gains * a * reach / threshold)
                if np.nanmin(off) <= 0.0 <= np.nanmax(off):
                    out.append(a[int(np.argmin(np.abs(off)))])
                beside.append(threshold * response[balance.pivot].max() / response[i].max())
    return np.unique(out) if out else np.append(usual_amplitudes(balance)[[balance.pivot]], beside)


def _middle(balance: Balance) -> Array:
    """A frequency [rad/s], shape (1,), amid the poles and zeros of the linear part."""
    scales = frequency_scales(balance.system)
    return np.array([float(np.exp(np.log(scales).mean())) if scales.size else 1.0])


def _gains(balance: Balance, omega: Array) -> tuple[Array, Array]:
    """Amplitudes (na,) of any size, and sizes (na, nw) of all gains there without a mean."""
    a = np.geomspace(1e-40, 1e40, 801)
    zero = np.zeros((a.size, balance.m))
    return a, np.abs(balance.evaluate(a[:, None] + zero, zero, np.full(a.size, omega[0]))[1])


@lru_cache(maxsize=4)
def usual_amplitudes(balance: Balance) -> Array:
    """An amplitude for the input of each element, shape (m,), that goes with the units of the loop.

    It is the element's largest threshold or its load; where it has neither (a relay, a cube), what the steps of all
    elements make of it through the linear part, or where its gain makes up for that of the linear part.
    """
    middle = _middle(balance)
    response = np.abs(balance.linear(middle)[0])
    a, gains = _gains(balance, middle)
    outputs = np.nan_to_num(a[:, None] * gains)
    # The output of an element that steps does not fall with its input.
    steps = response @ np.where(outputs[20] < 2.0 * outputs[0], outputs[0], 0.0)
    out = np.zeros(balance.m)
    for i, e in enumerate(balance.system.elements):
        thresholds = np.abs(np.asarray(e.thresholds(), float)).ravel()
        out[i] = thresholds.max(initial=0.0) or abs(balance.operating_bias[i]) or steps[i]
        if not out[i]:
            own = balance.owner == i
            loop = gains[:, own].max(-1) * response[:, own].max()
            crosses = np.flatnonzero((loop[1:] > 1.0) != (loop[:-1] > 1.0))
            out[i] = a[crosses[0]] if crosses.size else 1.0
    return out


def _omega_nodes(balance: Balance) -> Array:
    """Frequencies: poles and zeros of the linear part, and of the loop with each element at its steepest."""
    system = balance.system
    if isinstance(system, DataSystem):
        low, high = system.band
        return np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 2)
    scales = np.concatenate([frequency_scales(system), _stiff_scales(balance)])
    if system.time_step:
        top = np.pi / system.time_step
        low = min(float(scales.min(initial=top)), top) / 100
        return np.unique(np.concatenate([np.geomspace(low, 0.999 * top, 60), np.linspace(0.0, top, 62)[1:-1]]))
    low, high = (scales.min() / 3, scales.max() * 3) if scales.size else (1e-6, 1e6)
    nodes = [np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 2)]
    if np.any(system.delays):
        # Resolve the first turn and a half of the phase; beyond it plants with inertia pass little.
        nodes.append(np.arange(1, 32) * 0.3 / system.delays.max())
    return np.unique(np.concatenate(nodes))


def _stiff_scales(balance: Balance) -> Array:
    """Natural frequencies with the elements as springs of their steepest gain."""
    system = balance.system
    gain = np.zeros((system.B.shape[1], balance.m))
    for i, e in enumerate(system.elements):
        thresholds = np.abs(np.asarray(e.thresholds(), float)).ravel()
        middle = float(np.median(thresholds)) if thresholds.size and np.any(thresholds > 0) else 0.0
        if middle > 0:
            a = middle * np.geomspace(0.1, 1e4, 40)
            values = e.describing_function(a, 0.0, 1.0)[1]
            gain[system.output_slices[i], i] = np.nan_to_num(np.abs(values)).reshape(40, -1).max(0)
    springs = system.B @ gain @ system.C[balance.rows]
    # With either sign, for an element closes its loop with or against the feedback that the matrices hold.
    both = np.concatenate([np.linalg.eigvals(system.A + springs), np.linalg.eigvals(system.A - springs)])
    if system.time_step:
        both = np.log(both[np.abs(both) > 1e-9].astype(complex)) / system.time_step
    sizes = np.abs(both)
    return sizes[sizes > 1e-7 * sizes.max(initial=0.0)]


def _sheets(balance: Balance, amplitude: Array, omega: Array, L: ComplexArray) -> list[tuple[Array, ComplexArray]]:
    """Solutions of everything but the pivot on the grid, from several starts; each different one a sheet of its own."""
    sheets: list[tuple[Array, ComplexArray]] = []
    for number, start in enumerate(_starts(balance)):
        # That of elements which read one signal is a solution in a narrow band alone, about where all is balanced.
        if number and np.isfinite(start[1]) and not _differs(balance, amplitude, omega, L, start, sheets):
            continue
        X, loop, ok = _solve_grid(balance, amplitude, omega, L, start, 2)
        loop = np.where(ok & _new(balance, X, sheets), loop, np.nan)
        sheets.append((X, loop))
    return sheets


def _solve_grid(
    balance: Balance, amplitude: Array, omega: Array, L: ComplexArray, start: tuple[Array, float], rounds: int
) -> tuple[Array, ComplexArray, NDArray]:
    na, nw = len(amplitude), len(omega)
    grid, Lg = _grid(amplitude, omega, L)
    X, loop, ok = inner_newton(balance, start_points(balance, grid, Lg, *start), Lg)
    lent = np.full(len(X), -1)
    for _ in range(rounds):
        X, loop, ok, lent = _lend(balance, X, loop, ok, Lg, (na, nw), lent)
    return X.reshape(na, nw, -1), loop.reshape(na, nw), ok.reshape(na, nw)


def _grid(amplitude: Array, omega: Array, L: ComplexArray) -> tuple[Array, ComplexArray]:
    """Every amplitude with every frequency, as logarithms (n, 2), and the linear response L (nw, ...) at each."""
    pairs = np.stack(np.broadcast_arrays(np.log(amplitude)[:, None], np.log(omega)[None, :]), -1).reshape(-1, 2)
    return pairs, np.tile(L, (len(amplitude), 1, 1))


def _new(balance: Balance, X: Array, sheets: list[tuple[Array, ComplexArray]], stride: int = 1) -> BoolArray:
    """Where a solution is none of those that are known, phases up to whole turns."""
    new, phases = np.ones(X.shape[:2], bool), balance.places[balance.others] - 1
    for known, loop in sheets:
        there = np.isfinite(loop[::stride, ::stride])
        off = known[::stride, ::stride, 2:-1] - X[:, :, 2:-1]
        off[:, :, phases] -= 2.0 * np.pi * np.round(off[:, :, phases] / (2.0 * np.pi))
        new &= ~(there & np.all(np.abs(off) <= 1e-5 * (1e-6 + np.abs(X[:, :, 2:-1])), -1))
    return new


def _differs(
    balance: Balance,
    amplitude: Array,
    omega: Array,
    L: ComplexArray,
    start: tuple[Array, float],
    sheets: list[tuple[Array, ComplexArray]],
) -> bool:
    """Whether a start leads to solutions that are not known yet, judged on a ninth of the grid."""
    X, _, ok = _solve_grid(balance, amplitude[::3], omega[::3], L[::3], start, 0)
    return int((ok & _new(balance, X, sheets, 3)).sum()) > 3


def _starts(balance: Balance) -> list[tuple[Array, float]]:
    """Where the inner solution begins: biases, and an amplitude relative to the thresholds (small and large)."""
    zero = np.zeros(balance.m)
    starts = [(balance.operating_bias, 1.0)]
    if balance.m > 1:
        starts.append((balance.operating_bias, 1e-3))
    if np.any(balance.operating_bias):
        starts.append((zero, 1.0))
    if np.any(_beside(balance)):
        starts.append((balance.operating_bias, np.inf))
    return starts


def _beside(balance: Balance) -> BoolArray:
    """Elements that read the very signal that the pivot reads, shape (m,)."""
    s, p = balance.system, balance.pivot
    # What a measured signal is made of is not known: the same one answers alike at any frequency, but for noise.
    measured = isinstance(s, DataSystem)
    rows = s.frequency_response(_middle(balance))[0] if measured else np.hstack([s.C, s.D])
    rows = rows[balance.rows]
    apart = _ALIKE * np.abs(rows[p]) if measured else 0.0
    beside: BoolArray = np.all(np.abs(rows - rows[p]) <= apart, axis=1)
    beside[p] = False
    return beside


def start_points(balance: Balance, grid: Array, L: ComplexArray, bias: Array, level: float) -> Array:
    """Amplitudes and phases of the others for given biases, by repeated linear solution.

    They begin at a level, over the amplitudes that go with the loop. With an infinite one, elements that read what the
    pivot reads have its amplitude and phase, as they have where all is balanced.
    """
    m, p, o, n = balance.m, balance.pivot, balance.others, len(grid)
    a: Array = np.tile((level if np.isfinite(level) else 1.0) * usual_amplitudes(balance), (n, 1))
    a[:, p] = np.exp(grid[:, 0])
    b = np.broadcast_to(bias, (n, m))
    Z = a.astype(complex)
    omega = np.exp(grid[:, 1])
    # With the pivot's input given the others are driven: linear equations for fixed gains, and gains anew at what these
    # give.
    gains = balance.evaluate(a, b, omega)[1]
    for turn in range(6 if len(o) else 0):
        for i in o if turn else ():
            gains[:, balance.owner == i] = describe(balance.system.elements[i], a[:, i], b[:, i], omega)[1]
        drive(L, gains, balance.owner, o, p, Z)
        a[:, o] = np.maximum(np.abs(Z[:, o]), 1e-300)
    if np.isinf(level):
        a[:, _beside(balance)] = a[:, [p]]
        Z[:, _beside(balance)] = a[:, [p]]
    return balance.pack(a, np.angle(Z), b, omega, np.ones(n))


def inner_newton(balance: Balance, X: Array, L: ComplexArray) -> tuple[Array, ComplexArray, NDArray]:
    """Solve for all but the pivot's own equation at fixed amplitude and frequency of the pivot.

    Returns
    -------
    (X, loop, converged) : array (nb, 3 m + 1), complex array (nb,), bool array (nb,)
        `loop` is the gain once around the loop, cut at the pivot's input.
    """
    X, loop, done = X.copy(), np.full(len(X), np.nan, complex), np.ones(len(X), bool)
    solved = balance.solved
    # What does not come back to an element is known once all is that it needs: few unknowns at a time.
    for block in [np.arange(balance.m)] if solved is None else solved.blocks(np.any(L, axis=0)):
        _solve_block(solved or balance, block, X, L, loop, done)
    return X, loop, done


def _solve_block(
    balance: Balance, block: NDArray[np.intp], X: Array, L: ComplexArray, loop: ComplexArray, done: BoolArray
) -> None:
    """Solve for a block of elements at the points that are `done` but for it; those that are after it stay marked."""
    m, p, free = balance.m, balance.pivot, block[block != balance.pivot]
    rows = np.concatenate([free, m + free, 2 * m + block])
    columns = np.concatenate([balance.places[free], balance.places[free] + 1, 2 * m + block])
    limits, workspace = (1.0, np.inf, np.inf, 1e-7, 0.0), np.empty((1, 3 * m, 3 * m + 1))
    if balance.newton_compiled(X, X, _INNER_STEPS, limits, (block, rows, columns), L, loop, workspace, done):
        return
    # The same steps for elements that the engine does not know.
    alive, still = done & np.all(np.isfinite(X), -1), np.empty((0, *L.shape[1:]), complex)
    done[:] = False
    means, gains = np.empty((len(X), balance.owner.size)), np.empty((len(X), balance.owner.size), complex)
    with np.errstate(all="ignore"):
        for turn in range(_INNER_STEPS):
            todo = np.flatnonzero(alive & ~done)
            if not todo.size:
                break
            x = X[todo]
            s = balance.slopes(x, False, (block, means[todo], gains[todo]) if turn else None)
            means[todo], gains[todo] = s.means, s.gains
            R, J = balance.assemble(x, s, L[todo], still)
            loop[todo] = R[:, p] + 1.0 + 1j * R[:, m + p]
            step, regular = solved_in_part(J, R, rows, columns, x)
            size, sound = moved(balance, x, step, 1.0)
            X[todo] = x
            alive[todo] = regular & sound
            done[todo] = (size < 1e-7) & regular
    done &= alive


def _lend(
    balance: Balance,
    X: Array,
    loop: ComplexArray,
    ok: NDArray,
    L: ComplexArray,
    shape: tuple[int, int],
    before: NDArray[np.intp],
) -> tuple[Array, ComplexArray, NDArray, NDArray[np.intp]]:
    """Try points without a solution again, from the solution of a neighbour on the grid; not twice from the same.

    Returns
    -------
    X, loop, ok, lender
        The last is the number of the neighbour that each was tried from, -1 for none.
    """
    index = np.arange(len(X)).reshape(shape)
    good = ok.reshape(shape)
    lender = np.full(shape, -1)
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        rolled, valid = np.roll(index, shift, axis), np.roll(good, shift, axis)
        edge = [slice(None), slice(None)]
        edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
        valid = valid.copy()
        valid[tuple(edge)] = False
        lender = np.where(~good & valid & (lender < 0), rolled, lender)
    lent = lender.ravel()
    todo = np.flatnonzero((lent >= 0) & (lent != before))
    if not todo.size:
        return X, loop, ok, lent
    trial = X[lent[todo]].copy()
    trial[:, :2] = X[todo, :2]
    trial, new_loop, solved = inner_newton(balance, trial, L[todo])
    X, loop, ok = X.copy(), loop.copy(), ok.copy()
    took = todo[solved]
    X[took], loop[took], ok[took] = trial[solved], new_loop[solved], True
    return X, loop, ok, lent
