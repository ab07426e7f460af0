"""Elements and loops whose inputs are Fourier series: regimes, coefficients, equations of the balance."""

from __future__ import annotations

from typing import NamedTuple

from eppanalysis.arrays import Array, BoolArray, ComplexArray, IntArray
from eppanalysis.engine import _engine
from eppanalysis.engine._engine import equations, find_extrema, jacobian, settle, slopes

__all__ = [
    "ENDLESS",
    "UNSETTLED",
    "Automata",
    "Pieces",
    "Table",
    "answer",
    "equations",
    "find_extrema",
    "jacobian",
    "settle",
    "slopes",
]


#: What :func:`settle` says instead of a number of switches: that they never end, that no period repeats.
ENDLESS, UNSETTLED = -1, -2


class Table(NamedTuple):
    """Mode guards (s) and modes (m) of an automaton as arrays; memory values h, inputs z in their roles, outputs w.

    A mode guard of a mode fires where ``factor * series + on_memory @ h + on_clock * time + constant`` rises through
    zero (`series` -1: it has none), writes ``from_input @ z + from_memory @ h + memory_constant`` into the memory
    values, and leads to the mode `target`. `on_free` and `on_rate` are what ``factor * series`` is of the free input
    and of its rate, `free_series` and `rate_series` what each series is. In a mode an output is ``w_free * z + w_rate *
    dz/dt + w_memory @ h + w_constant``.
    """

    roles: IntArray  # (inputs,): 0 the free series, 1 its rate, 2 the time
    first: IntArray  # (m + 1,): first mode guard of each mode
    series: IntArray
    factor: Array
    constant: Array
    on_memory: Array  # (s, h)
    on_clock: Array
    target: IntArray
    from_input: Array  # (s, h, inputs)
    from_memory: Array  # (s, h, h)
    memory_constant: Array  # (s, h)
    on_free: Array
    on_rate: Array
    free_series: Array  # (S,)
    rate_series: Array  # (S,)
    w_free: Array  # (m, w)
    w_rate: Array  # (m, w)
    w_memory: Array  # (m, w, h)
    w_constant: Array  # (m, w)


class Pieces(NamedTuple):
    """What a period consists of, with s switches, h memory values, w outputs."""

    edges: Array  # (s + 2,) phases: begin, switches, end
    modes: IntArray  # (s + 1,)
    memory: Array  # (s + 1, h)
    fired: IntArray  # (s,) mode guards in the table


class Automata(NamedTuple):
    """The elements of a loop, all of one input and affine between their switches."""

    tables: tuple[Table, ...]
    modes: IntArray  # (F,): at the start
    clocked: BoolArray  # (F,)
    first: IntArray  # (F + 1, 2): first output, and first memory value, of each


def answer(
    table: Table, z: ComplexArray, omega: float, mode: int, clocked: bool, rest: Array
) -> tuple[
    tuple[int, int, float, Array, Array, IntArray, Array], Pieces, tuple[ComplexArray, ComplexArray, ComplexArray]
]:
    """What an element that is affine between its switches makes of an input; arguments are those of :func:`settle`.

    Returns
    -------
    regime : tuple
        As :func:`settle`.
    pieces : Pieces
        Of the period, where there is one.
    sums : complex arrays W, S, R, shapes (w, n + 1), (w, 2 n + 1), (w, 2 n + 1)
        Coefficients of the outputs, and of the functions that their input and its rate are multiplied with.
    """
    regime, pieces, sums = _engine.answer(table, z, omega, mode, clocked, rest)
    return regime, Pieces(*pieces), sums
