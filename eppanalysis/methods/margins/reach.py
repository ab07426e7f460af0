"""Whether the elements of a loop can give what a state of rest, or the mean of a motion that stays, needs of them.

The means of every motion that stays somewhere meet the static balance, and a mean output lies between the least and the
greatest output of its element: where no such means meet it, the loop drifts away from wherever it is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import StaticBalance, without_rounding
from eppanalysis.readable import listed, quantity

#: Share of the terms of a static balance below which they balance.
BALANCED = 1e-9
#: Share of its range by which an element may miss what it has to give, and the most modes of one that is tested.
_JUST, _MOST_PIECES = 0.02, 100
_NEITHER, _AWAY = "The loop has neither a state of rest nor a limit cycle", "; the loop drifts away."


def out_of_reach(system: LureSystem, static: StaticBalance) -> Iterator[str]:
    """Elements that cannot give, at rest or in the mean of a cycle, what integrators about them need.

    Parameters
    ----------
    system : LureSystem
        Its integrators are apart.
    static : StaticBalance
        Of this system, at the inputs where it is held.
    """
    reaches = {i: reach for i, e in enumerate(system.elements) if (reach := _reach(e)) is not None}
    alone = False
    for i, (low, high) in reaches.items():
        just = _JUST * (high - low)
        for on_bias, on_mean, prescribed in balances_of_one(system, static, i):
            needed = prescribed / on_mean + 0.0
            if on_bias == 0.0 and not low - just <= needed <= high + just:
                asked, least, most = (quantity(v, units_of(system, i)[1]) for v in (needed, low, high))
                name, alone = system.element_names[i], True
                yield f"{_NEITHER}: in the mean {name} would have to give {asked}, and gives {least} to {most}{_AWAY}"
                break
    if not alone:
        yield from _together(system, static, reaches)


def _together(system: LureSystem, static: StaticBalance, reaches: dict[int, tuple[float, float]]) -> Iterator[str]:
    """The same of all elements with a bound, in what the static balance needs of these alone."""
    weak = [system.output_slices[i].start for i in reaches]
    others = np.delete(static.on_mean, weak, axis=1)
    rows = without(np.hstack([static.on_bias, others]))
    size = np.abs(rows) @ (np.abs(static.prescribed) + np.abs(static.on_mean).sum(1))
    asked, given = rows @ static.prescribed, rows @ static.on_mean[:, weak]
    if not np.any(np.abs(asked) > BALANCED * size):
        return
    low, high = np.array(list(reaches.values())).reshape(-1, 2).T
    just = _JUST * (high - low)
    from scipy.optimize import lsq_linear  # it takes longer to load than most margins take

    nearest = lsq_linear(given, asked, (low - just, high + just)).x if weak else np.zeros(0)
    missing = np.abs(given @ nearest - asked) > BALANCED * size
    if not np.any(missing):
        return
    needed = np.any(np.abs(given[missing]) > BALANCED * size[missing, None], axis=0)
    names = listed([system.element_names[i] for i, n in zip(reaches, needed, strict=True) if n])
    what = f"in the mean {names} cannot together give what the loop needs" if names else "nothing holds what drives it"
    yield f"{_NEITHER}: {what}{_AWAY}"


def _reach(e: Nonlinearity) -> tuple[float, float] | None:
    """Least and greatest output of an element without memory; None for another, and where there is no bound.

    One that sticks gives more at rest than its output for a motion, and of rules of one's own not all need be met.
    """
    if (e.n_inputs, e.n_outputs) != (1, 1) or isinstance(e, AutomatonElement) or e.sticks_and_slips:
        return None
    if e.automaton().n_memory or len(e.automaton().modes) > _MOST_PIECES:
        return None
    edges = np.append(np.abs(np.asarray(e.thresholds(), float)), np.abs(e.breakpoints))
    span = edges[(edges > 0) & np.isfinite(edges)].max(initial=0.0) or 1.0
    near = np.concatenate([e.breakpoints, span * np.linspace(-30.0, 30.0, 6001)])
    y, far = e.output(near)[0], e.output(span * np.array([-1e9, 1e9]))[0]
    inside = np.all(np.isfinite(far)) and np.all(np.abs(far) <= (1.0 + _JUST) * np.abs(y).max())
    return (float(min(y.min(), far.min())), float(max(y.max(), far.max()))) if inside else None


def units_of(system: LureSystem, element: int) -> tuple[str, str]:
    """Units of the first input and output of an element, where signals tell them."""
    z, w = system.input_slices[element].start, system.output_slices[element].start
    read = {"x": system.C[z], "w": system.D[z], "v": system.D_input[z], "one": float(system.constant_input[z])}
    return system.signals.unit_of(**read), system.signals.unit_of(w=np.eye(system.D.shape[1])[w])


def balances_of_one(system: LureSystem, static: StaticBalance, element: int) -> Iterator[tuple[float, float, float]]:
    """Static balances that are left of one element alone, ``on_bias b + on_mean mean = prescribed``."""
    mine = system.output_slices[element]
    others = np.delete(static.on_bias, element, axis=1), np.delete(static.on_mean, mine, axis=1)
    own = np.column_stack([static.on_bias[:, element], static.on_mean[:, mine].sum(1), static.prescribed])
    for k in without(np.hstack(others)):
        # What cancels leaves rounding, and a line so flat would cross any level far enough out.
        on_bias, on_mean, prescribed = without_rounding(k @ own, np.abs(k) @ np.abs(own), BALANCED).tolist()
        if on_mean:
            yield on_bias, on_mean, prescribed


def without(columns: Array) -> Array:
    """Combinations of equations, as rows, without some columns."""
    columns = columns[:, np.any(columns, 0)] / np.abs(columns).max(0)[np.any(columns, 0)]
    u, s, _ = np.linalg.svd(columns)
    rank = int(np.sum(s > BALANCED * s.max(initial=0.0)))
    return without_rounding(u[:, rank:].T, np.ones(1))
