"""The tables of the engine, as named tuples of arrays: a hybrid system's model, its compiled mode combinations.

A hybrid system comes as flat arrays (`Model`). The combination of modes that a run visits is compiled on first visit
into a place of `Combinations`; `Work` is the workspace for that.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array

#: Numbers of a row that are summed at a time.
VECTOR_SIZE = 8
#: Lengths of steps beyond the longest of the grid.
LONGS = 4
#: Loops of more states keep the rate matrix of a mode by what is not zero, and go far by series. Shorter rows are
#: summed faster than their places are looked up.
FEW = 16


def padded(n: int) -> int:
    """Length of a row that holds n numbers."""
    return (n + VECTOR_SIZE - 1) // VECTOR_SIZE * VECTOR_SIZE


def aligned(*shapes: tuple[int, ...]) -> list[Array]:
    """Arrays of zeros that begin where eight numbers do: to fetch eight across such a border takes twice as long.

    All are parts of one, as most of the time would go into finding where each begins.
    """
    sizes = [math.prod(shape) for shape in shapes]
    wide = np.zeros(VECTOR_SIZE + sum(size + -size % VECTOR_SIZE for size in sizes))
    first = -wide.__array_interface__["data"][0] % (wide.itemsize * VECTOR_SIZE) // wide.itemsize
    found = []
    for shape, size in zip(shapes, sizes, strict=True):
        found.append(wide[first : first + size].reshape(shape))
        first += size + -size % VECTOR_SIZE
    return found


def aligned_by_name(shapes: dict[str, tuple[int, ...]]) -> dict[str, Array]:
    """As `aligned`, with names."""
    return dict(zip(shapes, aligned(*shapes.values()), strict=True))


class Model(NamedTuple):
    """Flat arrays of a hybrid system: n states, w outputs, z inputs, H memory values (the last is 1), s smooth ones."""

    A: np.ndarray  # (n, n)
    B: np.ndarray  # (n, w), without delayed outputs
    S: np.ndarray  # (n, s)
    K: np.ndarray  # (n, H)
    C: np.ndarray  # (z, n)
    D: np.ndarray  # (z, w)
    Kz: np.ndarray  # (z, H)
    first: np.ndarray  # (E + 1, 3) int: where each element's inputs, outputs, memory values begin
    order: np.ndarray  # (E,) int: elements, each behind those whose outputs act straight on its inputs
    reach: np.ndarray  # (E + 1, E) int: whether an element's output (last: external inputs) acts straight on an input
    mode_first: np.ndarray  # (E + 1,) int
    mode_wz: np.ndarray  # (m, w_max, z_max)
    mode_wh: np.ndarray  # (m, w_max, h_max)
    mode_ws: np.ndarray  # (m, w_max, s)
    mode_w0: np.ndarray  # (m, w_max)
    mode_stick: np.ndarray  # (m,) int
    mode_lags: np.ndarray  # (m,) int: whether a jump of the element's input may leave it behind
    mode_level: np.ndarray  # (m,)
    guard_first: np.ndarray  # (m + 1,) int
    guard_element: np.ndarray  # (g,) int
    guard_target: np.ndarray  # (g,) int, mode number within the element
    guard_bypass: np.ndarray  # (g,) int, the mode beyond a sticking target, for an input that jumped over its level
    # (g,) int, the mode for an input that stays on the threshold, -1 for none
    guard_on_threshold: np.ndarray
    guard_z: np.ndarray  # (g, z_max)
    guard_rate: np.ndarray  # (g, z_max)
    guard_h: np.ndarray  # (g, h_max)
    guard_w: np.ndarray  # (g, w_max)
    guard_0: np.ndarray  # (g,)
    reset_z: np.ndarray  # (g, h_max, z_max)
    reset_h: np.ndarray  # (g, h_max, h_max)
    reset_0: np.ndarray  # (g, h_max)
    guard_impulse: np.ndarray  # (g, z_max): on the inputs, of the impulse of its element's first output
    smooth_kind: np.ndarray  # (s,) int
    smooth_x: np.ndarray  # (s, n)
    smooth_H: np.ndarray  # (s, H)
    smooth_s: np.ndarray  # (s, s): on those before it
    smooth_scale: np.ndarray  # (s,)
    smooth_w: np.ndarray  # (s,) int, the delayed output of a delay channel
    smooth_delay: np.ndarray  # (s,)
    Yx: np.ndarray  # (y, n)
    Yw: np.ndarray  # (y, w)
    YH: np.ndarray  # (y, H)
    breakpoint_time: np.ndarray  # (k,)
    breakpoint_state: np.ndarray  # (k,) int
    breakpoint_value: np.ndarray  # (k,)
    breakpoint_memory: np.ndarray  # (k,) int
    breakpoint_slope: np.ndarray  # (k,)


class Combinations(NamedTuple):
    """Compiled mode combinations (leading axis: combination).

    Lengths with a + are those of rows that are summed eight numbers at a time: padded with zeros.
    """

    count: np.ndarray  # type: ignore[assignment]  # (3,) int: in use, ever used, the place given up last
    key: np.ndarray  # (q, E) int
    linear: np.ndarray  # (q,) int: no smooth channel acts
    step: np.ndarray  # (q,)
    rate: np.ndarray  # (q,) bound on the growth of the powers of M
    ready: np.ndarray  # (q,) int: whether T and bound are filled
    M: np.ndarray  # (q, n+, n+) transposed: M[j, i] = d x_i' / d x_j
    M_twice: np.ndarray  # (q, n+, n+) its square, of few states
    M_size: np.ndarray  # (q, n+, n+) its absolute values
    entries: np.ndarray  # (q, n+ n+ / 8, 8) rows of eight numbers of M that are not zero, of more than a few states
    row: np.ndarray  # (q, n+ n+ / 8) int: their rows in M; four at a time, where need be with zeros
    row_end: np.ndarray  # (q, n+ / 8) int: behind those of eight columns; () of a few states
    spread_rate: np.ndarray  # (q,) bound on the growth of the powers of M_size, where M is kept so
    far: np.ndarray  # (q,) time that a series goes, where the steps of that time cost more; 0 where they do not
    y_entries: np.ndarray  # (q, n+ y+ / 8, 8), and so on: Y kept in the same way
    y_row: np.ndarray  # (q, n+ y+ / 8) int
    y_row_end: np.ndarray  # (q, y+ / 8) int
    N: np.ndarray  # (q, n, H)
    S: np.ndarray  # (q, n, s)
    Wx: np.ndarray  # (q, w, n)
    WH: np.ndarray  # (q, w, H)
    Ws: np.ndarray  # (q, w, s)
    Zx: np.ndarray  # (q, z, n)
    ZH: np.ndarray  # (q, z, H)
    Zs: np.ndarray  # (q, z, s)
    Y: np.ndarray  # (q, n+, y+) transposed: signals on the state
    YH: np.ndarray  # (q, y, H)
    Ys: np.ndarray  # (q, y, s)
    n_guards: np.ndarray  # (q,) int
    guard: np.ndarray  # (q, G) int
    next: np.ndarray  # (q, G) int
    ga: np.ndarray  # (q, G, n+) guard rows on the state
    ga_count: np.ndarray  # (q, G) int: their entries that are not zero
    ga_place: np.ndarray  # (q, G, n) int
    ga_size: np.ndarray  # (q, G, n+) their absolute values
    gb: np.ndarray  # (q, G, n+) guard rows on the rate of the state
    gb_size: np.ndarray  # (q, G, n+)
    on_rate: np.ndarray  # (q, G) int: whether gb has an entry
    gH: np.ndarray  # (q, G, H)
    gs: np.ndarray  # (q, G, s)
    gt: np.ndarray  # (q, G, s): on the rates of the smooth channels
    smooth_guard: np.ndarray  # (q, G) int: whether gs or gt has an entry
    gf: np.ndarray  # (q, G, n+) guard rows on the state, with the rate put in
    gfH: np.ndarray  # (q, G, H)
    all_gf: np.ndarray  # (q, n+, G+) transposed: all of them
    reach_gf: np.ndarray  # (q, n+, G+) a trace more than their absolute values
    T: np.ndarray  # (q, n+, 2n+ + 2G+): from rate at start to state increment, rate, guard increments, guard rates
    bound: np.ndarray  # (q, n+, G+)
    longs: np.ndarray  # (q,) int: lengths of the next two that are filled
    T_long: np.ndarray  # (q, lengths, n+, 2n+ + 2G+): as T, over long steps
    reach: np.ndarray  # (q, lengths, n+, G+): bound on how far a guard moves on the way, from the rate at the start


class Work(NamedTuple):
    """Workspace for compiling a mode combination."""

    E: np.ndarray  # (w, w)
    F: np.ndarray  # (w, n + H + s)
    rate: np.ndarray  # (n, n + H + s)
    inputs: np.ndarray  # (z, n + H + s)
    signals: np.ndarray  # (y, n + H + s)
    square: np.ndarray  # (8, n+, n+)
    guards: np.ndarray  # (3, n+, G+)


def make_work(model: Model) -> Work:
    """Workspace for a model's mode combinations."""
    n, n_w = model.B.shape
    total = n + model.K.shape[1] + model.S.shape[1]
    shapes = [(n_w, n_w), (n_w, total), (n, total), (model.C.shape[0], total), (model.Yx.shape[0], total)]
    return Work(*aligned(*shapes, (8, padded(n), padded(n)), (3, padded(n), padded(most_guards(model)))))


def most_guards(model: Model) -> int:
    """Guards that a mode combination can have."""
    of_mode = np.diff(model.guard_first).tolist()
    return sum(max(of_mode[a:b], default=0) for a, b in pairwise(model.mode_first.tolist()))


def make_combinations(model: Model, capacity: int) -> Combinations:
    """Workspace for `capacity` mode combinations, each set to zero when it is first used (see :func:`clear`)."""
    n, n_w = model.B.shape
    n_z, n_H, n_s, n_y = model.C.shape[0], model.K.shape[1], model.S.shape[1], model.Yx.shape[0]
    n_e, G = model.mode_first.size - 1, most_guards(model)
    q, wide, most, steps = capacity, padded(n), padded(G), 2 * padded(n) + 2 * padded(G)
    blocks, y_blocks = (0, 0) if n <= FEW else (wide // VECTOR_SIZE, padded(n_y) // VECTOR_SIZE)
    numbers = aligned_by_name({
        "step": (q,), "rate": (q,), "spread_rate": (q,), "far": (q,),
        "entries": (q, blocks * wide, VECTOR_SIZE), "y_entries": (q, y_blocks * wide, VECTOR_SIZE),
        "M": (q, wide, wide), "M_twice": (q, wide, wide), "M_size": (q, wide, wide),
        "N": (q, n, n_H), "S": (q, n, n_s),
        "Wx": (q, n_w, n), "WH": (q, n_w, n_H), "Ws": (q, n_w, n_s),
        "Zx": (q, n_z, n), "ZH": (q, n_z, n_H), "Zs": (q, n_z, n_s),
        "Y": (q, wide, padded(n_y)), "YH": (q, n_y, n_H), "Ys": (q, n_y, n_s),
        "ga": (q, G, wide), "ga_size": (q, G, wide), "gb": (q, G, wide), "gb_size": (q, G, wide),
        "gH": (q, G, n_H), "gs": (q, G, n_s), "gt": (q, G, n_s), "gf": (q, G, wide), "gfH": (q, G, n_H),
        "all_gf": (q, wide, most), "reach_gf": (q, wide, most), "T": (q, wide, steps), "bound": (q, wide, most),
        "T_long": (q, LONGS, wide, steps), "reach": (q, LONGS, wide, most),
    })  # fmt: skip
    per_guard = ("guard", "next", "ga_count", "on_rate", "smooth_guard")
    places = {
        "count": (3,),
        "key": (q, n_e),
        "ga_place": (q, G, n),
        "row": (q, blocks * wide),
        "row_end": (q, blocks),
        "y_row": (q, y_blocks * wide),
        "y_row_end": (q, y_blocks),
    } | dict.fromkeys(per_guard, (q, G))
    places |= dict.fromkeys(("linear", "ready", "n_guards", "longs"), (q,))
    return Combinations(**numbers, **{name: np.zeros(shape, np.int64) for name, shape in places.items()})
