"""Room that a run of the engine works in, made beforehand: the compiled part allocates nothing.

Lengths with a + are those of rows that are summed eight numbers at a time: padded with zeros.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.kernels.closure import MOST_EVENTS
from eppanalysis.kernels.delays import LINE_CAPACITY
from eppanalysis.kernels.lanes import aligned, aligned_by_name, padded
from eppanalysis.kernels.series import DELAY_LINE, ORDER
from eppanalysis.kernels.tables import MOST_STEPS, PAUSE, SLICE, Model, Slots, Work, make_slots, make_work, most_guards
from eppanalysis.kernels.tuples import by_address


@by_address
class Ring(NamedTuple):
    """The last events of a run (leading axis: place)."""

    t: np.ndarray  # (keep,)
    guard: np.ndarray  # (keep,) int
    x: np.ndarray  # (keep, n) state just after the event
    v: np.ndarray  # (keep, n) its rate just before
    H: np.ndarray  # (keep, h) held values
    modes: np.ndarray  # (keep, E) int


@by_address
class Room(NamedTuple):
    """Scratch room of a run (lengths with a + are padded as in `Slots`)."""

    X: np.ndarray  # (order + 1, n+) series of the state
    Y: np.ndarray  # (order + 2, n+) sizes behind it
    Sg: np.ndarray  # (order + 1, s) series of the smooth channels, their arguments, and helpers
    arg: np.ndarray
    aux: np.ndarray
    p: np.ndarray  # ((order + 1)+,) series of a guard
    still: np.ndarray  # (y+,) constant parts of the signals
    row: np.ndarray  # (10, n+)
    range: np.ndarray  # (2, n+) least and greatest values of the states on the way
    held: np.ndarray  # (H,)
    guard: np.ndarray  # (7, G+)
    end: np.ndarray  # (2n+ + 2G+,)
    watch: np.ndarray  # (3,) candidate period of a run that closes, events near their predecessors, eighths of events
    line_t: np.ndarray  # (s, ring, 2) begin and end of each segment of a delayed output
    line_h: np.ndarray  # (s, ring) unit of its series
    line_c: np.ndarray  # (s, ring, order + 1)
    line_n: np.ndarray  # (s, 2) int: segments written, segment being read
    x: np.ndarray  # (n+,) state, modes, held values and times of the events of a run that has closed
    modes: np.ndarray  # (E,) int
    H: np.ndarray  # (H,)
    once: np.ndarray  # (events,)
    then_x: np.ndarray  # (2, n+) state behind a jump of inputs, and that of a jump that is tried
    then_modes: np.ndarray  # (E,) int
    then_H: np.ndarray  # (H,)
    before: np.ndarray  # (z,) inputs of the elements before a jump
    pause: np.ndarray  # (PAUSE,) steps until a pause and at most, and what a run that paused goes on from


@by_address
class Samples(NamedTuple):
    """Times at which signals are wanted, where the signals go, and room to sort times."""

    times: np.ndarray  # (2 nt,) increasing; the second half is room for phases in a period
    rows: np.ndarray  # (2 nt,) int: the row of `out` for each
    out: np.ndarray  # (nt, y+)
    phases: np.ndarray  # (nt,)
    order: np.ndarray  # (nt,) int
    bins: np.ndarray  # (nt + 1,) int


def make_ring(keep: int, n: int, n_H: int, n_e: int) -> Ring:
    """Room for the last `keep` events."""
    return Ring(
        np.empty(keep), np.empty(keep, np.int64), np.empty((keep, n)), np.empty((keep, n)), np.empty((keep, n_H)),
        np.empty((keep, n_e), np.int64),
    )  # fmt: skip


def make_samples(times: np.ndarray, n_y: int) -> Samples:
    """Room for `n_y` signals at so many times."""
    nt = times.size
    twice = np.empty(2 * nt)
    twice[:nt] = times
    (out,) = aligned((nt, padded(n_y)))
    return Samples(twice, np.arange(2 * nt), out, np.empty(nt), np.empty(nt, np.int64), np.empty(nt + 1, np.int64))


def make_room(model: Model) -> Room:
    """Scratch room for one run of a model."""
    n, n_s, n_H, n_e = model.A.shape[0], model.S.shape[1], model.K.shape[1], model.mode_first.size - 1
    size = LINE_CAPACITY if np.any(model.smooth_kind == DELAY_LINE) else 1
    wide, half = padded(n), padded(most_guards(model))
    numbers = aligned_by_name({
        "X": (ORDER + 1, wide), "Y": (ORDER + 2, wide),
        "Sg": (ORDER + 1, n_s), "arg": (ORDER + 1, n_s), "aux": (ORDER + 1, n_s), "p": (padded(ORDER + 1),),
        "still": (padded(model.Yx.shape[0]),), "row": (10, wide), "range": (2, wide), "held": (n_H,),
        "guard": (7, half), "end": (2 * wide + 2 * half,), "watch": (3,),
        "line_t": (n_s, size, 2), "line_h": (n_s, size), "line_c": (n_s, size, ORDER + 1),
        "x": (wide,), "H": (n_H,), "once": (MOST_EVENTS,), "pause": (PAUSE,),
        "then_x": (2, wide), "then_H": (n_H,), "before": (model.C.shape[0],),
    })  # fmt: skip
    numbers["pause"][:2] = SLICE, MOST_STEPS
    numbers["line_h"][:] = 1.0
    places = {"line_n": (n_s, 2), "modes": (n_e,), "then_modes": (n_e,)}
    return Room(**numbers, **{name: np.zeros(shape, np.int64) for name, shape in places.items()})


def make_rooms(model: Model) -> tuple[Slots, Work, Room]:
    """Room for the mode combinations of a model, for compiling them, and for its runs."""
    return make_slots(model, min(256, 16 + 4 * int(model.mode_first[-1]))), make_work(model), make_room(model)
