"""The workspace of a run, made beforehand: the engine allocates nothing while it runs.

Lengths with a + are those of rows that are summed eight numbers at a time: padded with zeros.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.engine.tables import (
    Combinations,
    Model,
    Work,
    aligned,
    aligned_by_name,
    make_combinations,
    make_work,
    most_guards,
    padded,
)

#: How a run ended, or that it paused.
DONE, EVENT_LIMIT, DIVERGED, SINGULAR, STALLED, HISTORY, STEP_LIMIT, PAUSED = 0, 1, 2, 3, 4, 5, 6, 7


#: Order of series; segments that a dead time may have on its way; events of a period that closes; number of the kind
#: of a smooth channel that is a dead time.
ORDER, LINE_CAPACITY, MOST_EVENTS, DELAY_LINE = 32, 8192, 128, 11
#: Steps after which a run pauses (a fraction of a second), and after which it ends; sixteen fast ones count as one.
SLICE, MOST_STEPS = 20_000.0, 1e7


class EventBuffer(NamedTuple):
    """The last events of a run (leading axis: place)."""

    t: np.ndarray  # (keep,)
    guard: np.ndarray  # (keep,) int
    x: np.ndarray  # (keep, n) state just after the event
    v: np.ndarray  # (keep, n) its rate just before
    H: np.ndarray  # (keep, h) memory values
    modes: np.ndarray  # (keep, E) int


class Workspace(NamedTuple):
    """Workspace of a run (lengths with a + are padded as in `Combinations`)."""

    X: np.ndarray  # (order + 1, n+) series of the state
    Y: np.ndarray  # (order + 2, n+) sizes behind it
    Z: np.ndarray  # (order + 1, y+) series of the signals
    Sg: np.ndarray  # (order + 1, s) series of the smooth channels, their arguments, and helpers
    arg: np.ndarray
    aux: np.ndarray
    p: np.ndarray  # ((order + 1)+,) series of a guard
    still: np.ndarray  # (y+,) constant parts of the signals
    x: np.ndarray  # (n+,) state, modes and memory values (the last one is 1): the start, and the state of the run
    modes: np.ndarray  # (E,) int
    H: np.ndarray  # (H,)
    rate: np.ndarray  # (n+,) rate of the state just before the last event, or at the end
    low: np.ndarray  # (n+,) least and greatest values of the states on the way
    high: np.ndarray  # (n+,)
    largest: np.ndarray  # (n+,) sizes of the states: greatest so far, and those from which they were computed last
    recent: np.ndarray  # (n+,)
    spread: np.ndarray  # (n+,) sum of the absolute terms of the series behind the start
    push: np.ndarray  # (n+,) constant part of the rate in the mode
    slope: np.ndarray  # (n+,) rate that fast steps carry along, and its size
    speed: np.ndarray  # (n+,)
    small: np.ndarray  # (n+,) rounding of the states, and scratch workspaces
    wide: np.ndarray  # (n+,)
    one: np.ndarray  # (n+,) ones
    memory: np.ndarray  # (H,)
    constant: np.ndarray  # (G+,) constant parts of the guards on state and rate, and on the state alone
    lift: np.ndarray  # (G+,)
    g0: np.ndarray  # (G+,) guards, their rates and their rounding, which fast steps carry along
    g1: np.ndarray  # (G+,)
    tol: np.ndarray  # (G+,)
    stray: np.ndarray  # (G+,) bound on how far each guard strays, and on how high it comes
    top: np.ndarray  # (G+,)
    end: np.ndarray  # (2n+ + 2G+,)
    watch: np.ndarray  # (3,) candidate period of a run that closes, events near their predecessors, eighths of events
    line_t: np.ndarray  # (s, segments, 2) begin and end of each segment of a delayed output
    line_h: np.ndarray  # (s, segments) unit of its series
    line_c: np.ndarray  # (s, segments, order + 1)
    line_n: np.ndarray  # (s, 2) int: segments written, segment being read
    behind_x: np.ndarray  # (n+,) state, modes, memory values and sizes of a run that has closed, behind its periods
    behind_modes: np.ndarray  # (E,) int
    behind_H: np.ndarray  # (H,)
    behind_recent: np.ndarray  # (n+,)
    once: np.ndarray  # (events,) times of the events of its period
    then_x: np.ndarray  # (2, n+) state behind a jump of inputs, and that of a jump that is tried
    then_modes: np.ndarray  # (E,) int
    then_H: np.ndarray  # (H,)
    before: np.ndarray  # (z,) inputs of the elements before a jump


#: Workspaces of a length with the states, and with the guards.
_OF_STATE = (
    "x", "rate", "low", "high", "largest", "recent", "spread", "push", "slope", "speed", "small", "wide", "one",
    "behind_x", "behind_recent",
)  # fmt: skip
_OF_GUARDS = ("constant", "lift", "g0", "g1", "tol", "stray", "top")


#: The state of a run: all that it takes from one step to the next, so that it can pause between any two of them.
PROGRESS = np.dtype(
    [
        # What is requested: end, longest step of the grid, events in all, whether closing on a cycle is watched for
        # (not by a run that goes on from one that has ended: its inputs have passed), whether what was put out
        # before the start is known, steps until a pause and at most.
        ("t_end", "f8"), ("base_step", "f8"), ("max_events", "i8"), ("watch", "?"), ("past_known", "?"),
        ("slice", "f8"), ("most_steps", "f8"),
        # Time, end of what is computed now, place on the grid of the mode (origin, steps), mode combination.
        ("t", "f8"), ("until", "f8"), ("origin", "f8"), ("j_grid", "i8"), ("q", "i8"),
        # Next sample and how many, next breakpoint of the inputs, steps without an event, time of the last one, and how
        # many came at that time, steps too short for the clock.
        ("i_sample", "i8"), ("n_samples", "i8"), ("i_breakpoint", "i8"), ("quiet", "i8"), ("last_t", "f8"),
        ("same_instant", "i8"), ("untimed", "i8"),
        # Whether fast steps may be made, an instant is left by force, the constant parts are those of the mode, what
        # fast steps carry along is that of the state, the state comes from a series step, closing is watched for still.
        ("armed", "?"), ("forced", "?"), ("entered", "?"), ("renewed", "?"), ("stepped", "?"), ("watched", "?"),
        # Whether it is aside, in the period that serves the samples of all periods to come; time and sample behind.
        ("aside", "?"), ("t_behind", "f8"), ("i_behind", "i8"),
        # The step that is made: its unit and end, how far it may go, how far a series of smooth channels holds by those
        # before, its length, how much of it counts, whether it ends on the grid, why fast steps ended, order of its
        # series, place of the guard that rises, where, whether it stays on zero instead, its number.
        ("h", "f8"), ("t1", "f8"), ("t_stop", "f8"), ("holds", "f8"), ("d", "f8"), ("ahead", "f8"), ("on_grid", "?"),
        ("why", "i8"), ("last", "i8"), ("which", "i8"), ("best", "f8"), ("stays", "?"), ("guard", "i8"),
        # How it ended or that it paused, and what was counted.
        ("code", "i8"), ("paused", "?"), ("spent", "f8"), ("count", "i8"), ("fast_steps", "i8"), ("series_steps", "i8"),
        ("refused_series", "i8"), ("forced_leaves", "i8"), ("periods_repeated", "i8"),
    ],
    align=True,
)  # fmt: skip


class Samples(NamedTuple):
    """Times at which signals are wanted, where the signals go, and room to sort times."""

    times: np.ndarray  # (2 nt,) increasing; the second half is room for phases in a period
    rows: np.ndarray  # (2 nt,) int: the row of `out` for each
    out: np.ndarray  # (nt, y+)
    phases: np.ndarray  # (nt,)
    order: np.ndarray  # (nt,) int
    bins: np.ndarray  # (nt + 1,) int


def make_event_buffer(keep: int, n: int, n_H: int, n_e: int) -> EventBuffer:
    """An event buffer for the last `keep` events."""
    return EventBuffer(
        np.empty(keep), np.empty(keep, np.int64), np.empty((keep, n)), np.empty((keep, n)), np.empty((keep, n_H)),
        np.empty((keep, n_e), np.int64),
    )  # fmt: skip


def make_samples(times: np.ndarray, n_y: int) -> Samples:
    """Workspace for `n_y` signals at so many times."""
    nt = times.size
    twice = np.empty(2 * nt)
    twice[:nt] = times
    (out,) = aligned((nt, padded(n_y)))
    return Samples(twice, np.arange(2 * nt), out, np.empty(nt), np.empty(nt, np.int64), np.empty(nt + 1, np.int64))


def make_workspace(model: Model) -> Workspace:
    """Workspace for one run of a model."""
    n, n_s, n_H, n_e = model.A.shape[0], model.S.shape[1], model.K.shape[1], model.mode_first.size - 1
    size = LINE_CAPACITY if np.any(model.smooth_kind == DELAY_LINE) else 1
    wide, half = padded(n), padded(most_guards(model))
    numbers = aligned_by_name({
        "X": (ORDER + 1, wide), "Y": (ORDER + 2, wide), "Z": (ORDER + 1, padded(model.Yx.shape[0])),
        "Sg": (ORDER + 1, n_s), "arg": (ORDER + 1, n_s), "aux": (ORDER + 1, n_s), "p": (padded(ORDER + 1),),
        "still": (padded(model.Yx.shape[0]),), "memory": (n_H,), "end": (2 * wide + 2 * half,), "watch": (3,),
        "line_t": (n_s, size, 2), "line_h": (n_s, size), "line_c": (n_s, size, ORDER + 1),
        "H": (n_H,), "behind_H": (n_H,), "once": (MOST_EVENTS,),
        "then_x": (2, wide), "then_H": (n_H,), "before": (model.C.shape[0],),
        **dict.fromkeys(_OF_STATE, (wide,)), **dict.fromkeys(_OF_GUARDS, (half,)),
    })  # fmt: skip
    numbers["line_h"][:] = numbers["one"][:] = 1.0
    places = {"line_n": (n_s, 2)} | dict.fromkeys(("modes", "behind_modes", "then_modes"), (n_e,))
    return Workspace(**numbers, **{name: np.zeros(shape, np.int64) for name, shape in places.items()})


def make_progress(t_end: float, base_step: float, max_events: int, most_steps: float = MOST_STEPS) -> np.void:
    """What is requested of a run; the rest of the record it fills itself."""
    now = np.zeros(1, PROGRESS)[0]
    now["t_end"], now["base_step"], now["max_events"], now["watch"] = t_end, base_step, max_events, True
    now["slice"], now["most_steps"] = SLICE, most_steps
    return now


def make_workspaces(model: Model) -> tuple[Combinations, Work, Workspace]:
    """Workspace for the mode combinations of a model, for compiling them, and for its runs."""
    return (
        make_combinations(model, min(256, 16 + 4 * int(model.mode_first[-1]))),
        make_work(model),
        make_workspace(model),
    )
