"""Whether a loop can rest, by its static balance: what its elements would have to give, and whether they can.

An element may jump over the only output with which the loop could rest (an encoder between two levels under integral
action), or leave each of its modes before the loop would (a thermostat).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.margins.reach import BALANCED, balances_of_one, units_of, without
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.systems.linear import ROUNDING, units_of_states, zeros
from eppanalysis.models.systems.sampled.averaged import AveragedSystem
from eppanalysis.readable import listed, quantity
from eppanalysis.results import Notice

#: Combinations of levels that are tried for one at which a loop rests.
_MOST_TOGETHER = 1000


def no_rest(balance: Balance) -> Iterator[str]:
    """Elements that jump over the only output with which the loop could rest, or leave it wherever it could."""
    alone = [*_no_rest_of_one(balance)]
    yield from alone or _no_rest_together(balance)


def _moves(has: str) -> Notice:
    """A loop that has what keeps it moving."""
    return Notice(f"The loop has {has}, in a motion that is not predicted here.", f"the loop has {has}")


def _only_on_an_edge(name: str, edge: str) -> str:
    return f" can rest only on an edge of {name}, which jumps where its input passes {edge}"


def _no_rest_together(balance: Balance) -> Iterator[str]:
    """On-off elements that act together, at none of whose levels the loop could rest."""
    system, static = balance.system, balance.static
    if balance.m < 2:
        return
    held = {i: levels for i in range(balance.m) if (levels := levels_held(balance, i)) is not None}
    if len(held) < 2 or np.prod([len(levels) for levels in held.values()]) > _MOST_TOGETHER:
        return
    mine = [system.output_slices[i].start for i in held]
    rows = without(np.hstack([np.delete(static.on_bias, [*held], 1), np.delete(static.on_mean, mine, 1)]))
    columns = np.hstack([static.on_bias[:, [*held]], static.on_mean[:, mine]])
    if not any(_stands(rows, columns, static.prescribed, levels) for levels in product(*held.values())):
        names = listed([system.element_names[i] for i in held])
        yield _moves(f"no state of rest: {names} cannot balance it at any of their levels; it keeps moving")


def levels_held(balance: Balance, element: int) -> list[tuple[tuple[float, float], tuple[float, float]]] | None:
    """Where an element between constant levels stays, ranges of its input and its output; None for any other."""
    e = balance.system.elements[element]
    a = e.automaton()
    modes, guards = a.mode_columns, a.guard_columns
    follows = any(np.any(modes[name]) for name in ("from_input", "from_memory", "from_smooth"))
    many = len(a.modes) > _MOST_TOGETHER
    if (a.n_inputs, a.n_outputs, a.n_memory) != (1, 1, 0) or follows or not a.guards or many:
        return None
    stays = []
    for k, (sticks, edge, jump, level) in enumerate(
        zip(modes["sticking"], modes["level"], modes["jump"], modes["constant"][:, 0], strict=True)
    ):
        own = guards["mode"] == k
        of_input, of_output, rest = guards["on_input"][own, 0], guards["on_output"][own, 0], guards["constant"][own]
        # One that sticks keeps its input and gives what the loop needs; another one keeps its output.
        if not sticks:
            stays += [(inputs, (float(level),) * 2) for inputs in _between(of_input, rest + of_output * level)]
        elif _pulled_back(balance, element, float(jump)):
            stays += [((float(edge),) * 2, outputs) for outputs in _between(of_output, rest + of_input * edge)]
    return stays


def _between(weight: Array, constant: Array) -> Iterator[tuple[float, float]]:
    """The range of a value at which no ``weight value + constant`` is above zero; nothing where there is none."""
    turns = weight != 0.0
    edges, rises = -constant[turns] / weight[turns], weight[turns] > 0.0
    low, high = float(edges[~rises].max(initial=-np.inf)), float(edges[rises].min(initial=np.inf))
    if low <= high and not np.any(constant[~turns] > 0.0):
        yield low, high


def _stands(rows: Array, columns: Array, prescribed: Array, levels: Sequence[tuple[Any, Any]]) -> bool:
    """Whether combinations of static balances, as rows, can be met with inputs and outputs within ranges."""
    from scipy.optimize import lsq_linear

    low, high = np.array([r for part in zip(*levels, strict=True) for r in part]).T
    value, free = low.copy(), (low < high) & (len(rows) > 0)
    if np.any(free):
        unit = np.abs(rows @ columns[:, free]).max(0, initial=0.0)
        unit[unit == 0.0] = 1.0
        turned, sizes, _ = np.linalg.svd(rows @ columns[:, free] / unit)
        rows = turned.T @ rows
    terms, left = np.abs(rows) @ np.abs(columns), rows @ columns
    # What cancels in a combination leaves rounding, which no open range may make up for.
    left[np.abs(left) <= BALANCED * terms] = 0.0
    if np.any(free):
        left[np.ix_(np.pad(sizes, (0, len(rows) - sizes.size)) <= BALANCED * sizes[0], free)] = 0.0
        rest = rows @ prescribed - left[:, ~free] @ low[~free]
        value[free] = (
            lsq_linear(left[:, free] / unit, rest, (low[free] * unit, high[free] * unit), method="bvls").x / unit
        )
    size = terms @ np.abs(value) + np.abs(rows) @ np.abs(prescribed)
    return bool(np.all(np.abs(left @ value - rows @ prescribed) <= BALANCED * size))


def _no_rest_of_one(balance: Balance) -> Iterator[str]:
    """The same of one element, whatever the others do."""
    system = balance.system
    for i, e in enumerate(system.elements):
        of_input, of_output = units_of(system, i)
        if not np.any(e.jumps):
            if _never_stays(balance, i):
                name = system.element_names[i]
                yield _moves(
                    f"no state of rest: {name} leaves each of its modes before the loop rests; it keeps moving"
                )
            continue
        for on_bias, on_mean, prescribed in balances_of_one(system, balance.static, i):
            left, right = _excess(e, on_bias, on_mean, prescribed)
            only = _rests_on_an_edge(e, on_bias, on_mean, left, right)
            if only is not None and not _slides(balance, i, float(e.jumps[only])):
                cause = _only_on_an_edge(system.element_names[i], quantity(float(e.breakpoints[only]), of_input))
                yield Notice(
                    f"The loop{cause}: it may hunt across it, in a motion that is not predicted here.",
                    f"the loop{cause}: it may hunt across it",
                    sure=False,
                )
                break
            jump = _jumped_over(e, on_bias, on_mean, left, right)
            if jump is None or _slides(balance, i, float(e.jumps[jump])):
                continue
            edge = float(e.breakpoints[jump])
            if _dies_out(balance, i, float(e.jumps[jump])):
                cause = _only_on_an_edge(system.element_names[i], quantity(edge, of_input))
                cause += (
                    ": it comes to rest there in ever faster switching, and any delay outside the model makes it hunt"
                )
                yield Notice(f"The loop{cause}.", f"the loop{cause}")
                break
            levels = (float(e.slopes[k] * edge + e.intercepts[k]) for k in (jump, jump + 1))
            below, above = (quantity(level, of_output) for level in levels)
            # A zero is added, which takes the sign off one.
            needed = quantity((prescribed - on_bias * edge) / on_mean + 0.0, of_output)
            yield _moves(
                f"no state of rest: {system.element_names[i]} would have to give {needed} but jumps from {below} to "
                f"{above} where its input passes {quantity(edge, of_input)}; the loop hunts across it"
            )
            break


def _excess(e: Nonlinearity, on_bias: float, on_mean: float, prescribed: float) -> tuple[Array, Array]:
    """Sign of what a static balance has too much on either side of each edge of an element, shape (k,) both."""
    edges = e.breakpoints
    excess = [
        on_bias * edges + on_mean * (slope * edges + offset) - prescribed
        for slope, offset in ((e.slopes[:-1], e.intercepts[:-1]), (e.slopes[1:], e.intercepts[1:]))
    ]
    size = np.abs(on_bias * edges) + abs(prescribed) + np.abs(on_mean) * np.abs(e.output(edges)[0])
    left, right = (np.where(np.abs(x) <= BALANCED * size, 0.0, np.sign(x)) for x in excess)
    return left, right


def _ends(e: Nonlinearity, on_bias: float, on_mean: float, left: Array, right: Array) -> tuple[Array, Array]:
    """Signs of the excess at both ends of every piece: from minus infinity, between edges, and from the last one on."""
    turns = on_bias + on_mean * e.slopes
    first = -np.sign(turns[:1]) if turns[0] else left[:1]
    return np.concatenate([first, right]), np.append(left, np.sign(turns[-1]) if turns[-1] else right[-1])


def _jumped_over(e: Nonlinearity, on_bias: float, on_mean: float, left: Array, right: Array) -> int | None:
    """Number of the jump across which a static balance changes sign, if it holds on no piece of the element."""
    begins, stops = _ends(e, on_bias, on_mean, left, right)
    if np.any(begins * stops <= 0):
        return None
    across = np.flatnonzero(left * right < 0)
    return int(across[0]) if across.size else None


def _rests_on_an_edge(e: Nonlinearity, on_bias: float, on_mean: float, left: Array, right: Array) -> int | None:
    """Number of the jump on one side of which alone a static balance holds, if it holds nowhere else."""
    begins, stops = _ends(e, on_bias, on_mean, left, right)
    within = (begins * stops < 0) | ((begins == 0) & (stops == 0))
    on_edge = (left == 0) | (right == 0)
    one_sided = on_edge & (left != right) & (e.jumps != 0)
    if np.any(within) or np.any(on_edge & ~one_sided):
        return None
    found = np.flatnonzero(one_sided)
    return int(found[0]) if found.size else None


def _never_stays(balance: Balance, element: int) -> bool:
    """Whether an element leaves each of its modes where the loop would rest."""
    e = balance.system.elements[element]
    if any(_leaves_every_mode(e, *balanced) for balanced in balances_of_one(balance.system, balance.static, element)):
        return True
    return balance.m > 1 and _leaves_where_others_follow(balance, element)


def _leaves_where_others_follow(balance: Balance, element: int) -> bool:
    """Whether an element between constant levels leaves each, the others being where they come to rest with it."""
    a = balance.system.elements[element].automaton()
    modes, guards = a.mode_columns, a.guard_columns
    simple = (a.n_inputs, a.n_outputs, a.n_memory) == (1, 1, 0) and not a.smooth and a.guards
    held = simple and not np.any(modes["sticking"]) and not np.any(modes["from_input"])
    if not held or balance.owner.size != balance.m or np.linalg.matrix_rank(balance.on_bias) < balance.m:
        return False
    left = set()
    for k, level in enumerate(modes["constant"][:, 0]):
        bias = _followed(balance, element, float(level))
        if bias is None:
            return False
        own = guards["mode"] == k
        terms = guards["on_input"][own, 0] * bias, guards["on_output"][own, 0] * level, guards["constant"][own]
        if not np.any(sum(terms) > BALANCED * sum(map(np.abs, terms))):
            return False
        left.add(k)
    return len(left) == len(a.modes)


def _followed(balance: Balance, element: int, level: float) -> float | None:
    """Input of an element that holds a level, where all others have followed it in turn; None where they do not."""
    elements, means = balance.system.elements, np.zeros(balance.m)
    means[element] = level
    for _ in range(balance.m + 1):
        bias = np.linalg.solve(balance.on_bias, balance.prescribed - balance.on_mean @ means)
        before = means.copy()
        for i, e in enumerate(elements):
            if i != element:
                if (e.n_inputs, e.n_outputs) != (1, 1) or isinstance(e, AutomatonElement) or e.automaton().n_memory:
                    return None
                means[i] = float(e.output(bias[i : i + 1])[0][0])
        if np.array_equal(before, means):
            return float(bias[element])
    return None


def _leaves_every_mode(e: Nonlinearity, on_bias: float, on_mean: float, prescribed: float) -> bool:
    """Whether an element without memory values switches, in each of its modes, where the static balance would hold."""
    a = e.automaton()
    modes, guards = a.mode_columns, a.guard_columns
    if (a.n_inputs, a.n_outputs, a.n_memory) != (1, 1, 0) or a.smooth or np.any(modes["sticking"]) or not a.guards:
        return False
    slope, offset = modes["from_input"][:, 0, 0], modes["constant"][:, 0]
    turn, left = on_bias + on_mean * slope, prescribed - on_mean * offset
    if np.any((turn == 0.0) & (np.abs(left) <= BALANCED * (abs(prescribed) + np.abs(on_mean * offset)))):
        return False  # at rest wherever it is
    with np.errstate(divide="ignore", invalid="ignore"):
        bias = np.where(turn == 0.0, np.inf, left / turn)[guards["mode"]]
        output = np.where(turn == 0.0, 0.0, slope * left / turn)[guards["mode"]] + offset[guards["mode"]]
        terms = guards["on_input"][:, 0] * bias, guards["on_output"][:, 0] * output, guards["constant"]
    # Without a state of rest in a mode there is none to be left; on the threshold it is not left for certain.
    leaves = ~np.isfinite(bias) | (sum(terms) > BALANCED * sum(map(np.abs, terms)))
    return set(guards["mode"][leaves].tolist()) == set(range(len(a.modes)))


def _slides(balance: Balance, element: int, jump: float) -> bool:
    """Whether the loop pulls an element back at once on either side of a jump, so that it rests there."""
    return _pulled_back(balance, element, jump, 1)


def _pulled_back(balance: Balance, element: int, jump: float, derivatives: int = 2) -> bool:
    """Whether the first derivative of its input at which a jump of an element acts pulls it back, if it is that low."""
    system = balance.system
    if system.time_step or np.any(system.delays[system.output_slices[element]]):
        return False
    pull = _pull(balance, element, jump, derivatives)
    return bool(np.any(pull) and pull[np.flatnonzero(pull)[0]] < 0.0)


def _pull(balance: Balance, element: int, jump: float, count: int) -> Array:
    """What a jump of one element does to the first derivatives of its own input; what is rounding is zero.

    In turned states entries that should be zero are known to a share of the largest ones beside them, in even units.
    """
    system, out = balance.system, balance.system.output_slices[element]
    unit = units_of_states(system.A, system.around)
    A, b, c = system.A * unit / unit[:, None], system.B[:, out] / unit[:, None], system.C[balance.rows[element]] * unit
    moved, read, size, terms, sizes = [b.sum(1)], [c], np.abs(b).sum(1), [], []
    for _ in range(count):
        terms.append(float(c @ moved[-1]))
        sizes.append(float(np.abs(c) @ size))
        moved, read, size = [*moved, A @ moved[-1]], [*read, read[-1] @ A], np.abs(A) @ size
    into, out_of = np.linalg.norm(moved[:-1], axis=1), np.linalg.norm(read[:-1], axis=1)
    # Of c, of b, and of any one A between them.
    unsure = into[0] * out_of + into * out_of[0]
    unsure[1:] += np.linalg.norm(A) * np.convolve(into, out_of)[: count - 1]
    sure = np.abs(terms) > BALANCED * np.array(sizes) + ROUNDING * unsure
    return np.where(sure, jump * np.array(terms), 0.0)


def _dies_out(balance: Balance, element: int, jump: float) -> bool:
    """Whether an element that is alone is pulled back across a jump by the second derivative of its input, and damped.

    It then switches ever faster, each swing smaller than the one before. Fast swings feel the response ``m2/s**2 +
    m3/s**3 + ...`` alone: the first odd term that is there damps them or not. What is slow beside them must die out by
    itself: the zeros.
    """
    system = balance.system
    if len(system.elements) > 1 or system.time_step or np.any(system.delays) or isinstance(system, AveragedSystem):
        return False
    m = _pull(balance, element, jump, 2 * len(system.A))
    m[4::4] *= -1.0  # of the odd powers every other one turns the other way
    odd = m[2::2][m[2::2] != 0.0]
    if np.any(system.D) or m[0] or m.size < 2 or m[1] >= 0.0 or not odd.size or odd[0] <= 0.0:
        return False
    return bool(np.all(zeros(system.A, system.B, system.C[:1], system.D[:1]).real < 0.0))
