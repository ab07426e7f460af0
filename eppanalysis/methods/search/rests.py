"""States of rest that single combinations of modes have and draw motions to, where runs have found no rest.

A mass under integral action comes to rest where the force that it slips under is just held: a state on the edge of the
slip, which motions come to from one side alone (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994)
1083). Few starts lead there, or to a rest in a narrow band. Within one combination of modes the loop is affine, so its
states of rest are solved for, and runs are begun on the way that the slowest motion takes to each.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.orbits.arcs import Arcs, EventSequence
from eppanalysis.methods.simulation.kept import Run
from eppanalysis.methods.simulation.modes import guards_of
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem

#: By the bytes of its modes: state and memory values with which a combination was met.
VisitedModes = dict[bytes, tuple[Array, Array]]

#: Combinations that are tried, of those that were met.
_MOST = 64
#: Rounding of rates and of distances to guards, relative to their terms.
_ROUNDING = 1e-9
#: Eigenvalues below this share of the largest belong to states of rest side by side.
_NEUTRAL = 1e-6
#: How far from the state of rest a run begins, relative to the way to the next guard.
_SHARE = 0.5
#: What is left of the way by when it is judged whether a run has come to rest: more than rounding, which may lead it on
#: over a guard that the state of rest lies on.
_LEFT = 1e-9


def note_modes(visited: VisitedModes, start: HybridSystem, run: Run) -> None:
    """Add the combinations of modes that a run has met."""
    visited.setdefault(start.modes0.tobytes(), (start.x0, start.H0))
    # Nearly all rows are met already: as one value each they are looked up in less time than they are sorted in.
    rows = run.modes[run.order]
    seen = rows.view(f"V{rows.itemsize * rows.shape[1]}").ravel().tolist()
    for modes in sorted(set(seen) - visited.keys(), key=_in_order):
        i = run.order[seen.index(modes)]
        visited[modes] = run.state[i].copy(), run.memory_values[i].copy()


def _in_order(modes: bytes) -> list[int]:
    return np.frombuffer(modes, np.int64).tolist()


def towards_rests(hybrid: HybridSystem, visited: VisitedModes) -> Iterator[tuple[Array, Array, float]]:
    """States and memory values from which the slowest motion of a combination goes to its state of rest, and by when
    it is there [s].
    """
    model = hybrid.model
    late = np.flatnonzero(model.smooth_kind == DELAY_LINE)
    if late.size < model.smooth_kind.size:  # with smooth elements no combination is affine
        return
    for modes, (x, H) in list(visited.items())[:_MOST]:
        arcs = _arcs(hybrid, np.frombuffer(modes, np.int64))
        if arcs is None:
            continue
        # At rest what comes out of a dead time is what goes in, which is constant where there are arcs.
        delayed = arcs.W[0, model.smooth_w[late], arcs.memory.stop - 1]
        with np.errstate(over="ignore", invalid="ignore"):  # what is beyond all range is no start
            towards = [*_towards(arcs.F[0], arcs.g, hybrid.compared, np.concatenate([x, H, delayed]))]
        yield from ((start, H, time) for start, time in towards if np.all(np.isfinite(start)))


def _arcs(hybrid: HybridSystem, modes: IntArray) -> Arcs | None:
    """One arc for every guard of a combination of modes; None where it has none, or no unique solution."""
    guards = guards_of(hybrid, modes)
    if not guards.size:
        return None
    p = guards.size
    none = np.full((p, 3), -1), np.zeros(p, np.int64)
    try:
        return Arcs.build(hybrid, EventSequence(np.tile(modes, (p, 1)), guards, *none))
    except ModelError:
        return None


def _towards(F: Array, g: Array, moves: BoolArray, y: Array) -> Iterator[tuple[Array, float]]:
    """Starts beside the state of rest of ``x' = F y`` that is next to y, if all motions of F come to rest, and by when
    they do.
    """
    n, x = moves.size, y[: moves.size]
    A = F[np.ix_(moves, np.flatnonzero(moves))]
    values, vectors = np.linalg.eig(A)
    size = float(np.abs(values).max(initial=0.0))
    passing = np.abs(values) > _NEUTRAL * size
    gains = np.linalg.svd(A, compute_uv=False)
    still = int(np.sum(gains <= _ROUNDING * gains.max(initial=0.0)))
    # As many motions without a rate as eigenvalues of zero: in a chain of integrators there are fewer, and what is
    # still in one place drifts in another.
    if not passing.any() or np.any(values[passing].real >= 0.0) or still != int(np.sum(~passing)):
        return
    met, y = y, y.copy()
    terms = np.abs(F) @ np.abs(y)
    y[:n][moves] -= np.linalg.lstsq(A, (F @ y)[moves], rcond=_ROUNDING)[0]
    if np.any(np.abs(F @ y)[moves] > _ROUNDING * (terms + np.abs(F) @ np.abs(y))[moves]):
        return
    slow = np.zeros(n, complex)
    # All other motions die out sooner: what comes to rest comes along the slowest one.
    k = int(np.argmax(np.where(passing, values.real, -np.inf)))
    slow[moves] = vectors[:, k]
    # Of a rate that is zero at rest nothing is left but rounding: its terms are those of the motion that was met.
    way, terms = g @ y, np.abs(g) @ np.maximum(np.abs(y), np.abs(met))
    way = np.where(np.abs(way) <= _ROUNDING * terms, 0.0, way)
    if np.any(way > 0.0):
        return
    turns = abs(values[k].imag) > _ROUNDING * size
    for side in (1.0, -1.0):
        # A motion that swings about its rest comes as near to a guard from both sides.
        nears = np.abs(g[:, :n] @ slow) if turns else side * (g[:, :n] @ slow).real
        with np.errstate(divide="ignore", invalid="ignore"):
            far = float(np.min(np.where(nears > 0.0, -way / nears, np.inf), initial=np.inf))
        far = float(np.abs(x - y[:n]).max()) if np.isinf(far) else far
        if far > 0.0:
            yield y[:n] + _SHARE * side * far * slow.real, float(np.log(_LEFT) / values[k].real)
