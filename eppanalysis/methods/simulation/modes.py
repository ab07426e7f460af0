"""The law of motion of combinations of modes, and where what sticks in them holds its input."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.engine.orbits import READY, SINGULAR, build_arcs
from eppanalysis.errors import ModelError
from eppanalysis.methods.simulation.workspaces import of_thread
from eppanalysis.models.systems.hybrid import HybridSystem, of_model
from eppanalysis.models.systems.starts import input_rows


class Laws(NamedTuple):
    """Laws of motion of p arcs by y, which stacks the state on memory values and a 1, and by smooth channels."""

    F: Array  # (p, n, N): rates
    S: Array  # (p, n, channels)
    g: Array  # (p, N): the guard that ends each arc, below zero until passed; nothing for one without
    gs: Array  # (p, channels)
    J: Array  # (p, N, N): y behind the event
    smooth: IntArray  # (p,)
    sense: Array  # (p, channels)
    Y: Array  # (p, signals, N)
    Ys: Array  # (p, signals, channels)
    W: Array  # (p, outputs, N)


def laws_of(hybrid: HybridSystem, modes: IntArray, guards: IntArray, timing: IntArray) -> Laws:
    """The laws of arcs in these modes (p, elements), each with the event that ends it and the guard that tells when.

    Raises
    ------
    ModelError
        If a combination of modes has no unique solution, or not that event.
    """
    model, p, base = hybrid.model, len(modes), 2.0 * hybrid.time_scale  # as runs have it
    (n, n_w), n_s, n_y = model.B.shape, model.S.shape[1], model.Yx.shape[0]
    N = n + model.K.shape[1]
    found = Laws(
        np.empty((p, n, N)), np.empty((p, n, n_s)), np.empty((p, N)), np.empty((p, n_s)), np.empty((p, N, N)),
        np.empty(p, np.int64), np.ones((p, n_s)), np.empty((p, n_y, N)), np.empty((p, n_y, n_s)), np.empty((p, n_w, N)),
    )  # fmt: skip
    compiled, work, _ = of_thread.workspaces(hybrid, base)
    F, S, g, gs, J, smooth, sense, Y, Ys, W = found
    code = build_arcs(model, compiled, work, base, modes, guards, timing, F, S, g, gs, J, smooth, sense, Y, Ys, W)
    if code != READY:
        what = "a combination of modes without a unique solution" if code == SINGULAR else "an event it does not have"
        raise ModelError(f"orbit: the sequence of events runs through {what}.")
    return found


def guards_of(hybrid: HybridSystem, modes: IntArray) -> IntArray:
    """Numbers of all guards of a combination of modes (elements,)."""
    first = hybrid.model.mode_first[:-1] + modes
    return np.concatenate([np.arange(*hybrid.model.guard_first[m : m + 2]) for m in first])


class ModeLaw(NamedTuple):
    """The law of motion of one combination of modes, by y of :class:`Laws`."""

    F: Array  # (n, N): rates of all states
    terms: Array  # (n, N): how large the terms of F are that come from states and outputs
    g: Array  # (guards, N): below zero until passed
    levels: Array  # (N, N): puts what sticks on its level, beside which it is by rounding


def law_of(hybrid: HybridSystem, modes: IntArray) -> ModeLaw | None:
    """The law of a combination of modes (elements,); None where they have no unique one."""
    known, key = _known_laws(hybrid), modes.tobytes()
    if key not in known:
        guards = guards_of(hybrid, modes)
        ends = guards if guards.size else np.array([-1])  # a single arc that nothing ends
        try:
            laws = laws_of(hybrid, np.tile(modes, (ends.size, 1)), ends, ends)
            F, g, model = laws.F[0], laws.g[: guards.size], hybrid.model
            terms = np.hstack([np.abs(model.A), np.abs(model.K)]) + np.abs(model.B) @ np.abs(laws.W[0])
            law = ModeLaw(F, terms, g, on_levels(hybrid, modes[None]))
            known[key] = law if np.all(np.isfinite(F)) else None
        except ModelError:
            known[key] = None
    return known[key]


@of_model
def _known_laws(hybrid: HybridSystem) -> dict[bytes, ModeLaw | None]:
    """The combinations of modes that motions of a model were met in, which fill it."""
    return {}


def on_levels(hybrid: HybridSystem, modes: IntArray) -> Array:
    """The matrix (N, N) of y that puts the inputs of all elements that stick on every arc on their levels.

    On a cycle no event brings them there. That they are there is an equation of its own, and a disturbance off a
    level, which the element takes back at once, is none that lasts.
    """
    model = hybrid.model
    n, size = model.A.shape[0], model.A.shape[0] + model.K.shape[1]
    put = np.eye(size)
    rows = model.mode_first[:-1] + modes
    sticks = np.flatnonzero(model.mode_stick[rows].all(axis=0) & (modes == modes[0]).all(axis=0))
    seen = input_rows(hybrid, modes[0]) if sticks.size else put
    for e in sticks:
        off, way = seen[model.first[e, 0]].copy(), way_back(hybrid, seen, int(e))
        pull = off[:n] @ way
        off[-1] -= model.mode_level[rows[0, e]]
        put[:n] -= np.outer(way / pull, off @ put)
    return put


def way_back(hybrid: HybridSystem, seen: Array, element: int) -> Array:
    """The direction of the state along which a sticking element is taken back to its level.

    Parameters
    ----------
    seen : array
        What :func:`~eppanalysis.models.systems.starts.input_rows` gives.
    """
    z, w = hybrid.model.first[element, :2]
    c = seen[z, : hybrid.model.A.shape[0]]
    return np.asarray(c != 0, float) if np.count_nonzero(c) == 1 else hybrid.model.B[:, w]
