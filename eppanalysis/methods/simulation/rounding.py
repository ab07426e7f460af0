"""What rounding leaves of a motion: whether elements see more than rounding of it, and it more than rounding of them.

A loop far beyond all that has a size of its own in its elements (levels, gaps, forces) is homogeneous to rounding.
Where its linear part does not damp, motions of every size repeat themselves there to the last digits, and what the
elements do, which alone makes one of them a limit cycle, is lost (docs/theory/simulation.md, Verdict).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eppanalysis.models.elements.automaton import SMOOTH_FUNCTIONS, SMOOTH_KINDS
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem
from eppanalysis.models.systems.sampled.strobe import sampled_among

Array = NDArray[np.float64]

#: What is said of a motion whose elements are beneath rounding.
BENEATH_ROUNDING = (
    "The motion repeats itself, but what the elements change of it in a period is beneath rounding of its states: "
    "whether it grows, decays or is a limit cycle cannot be told at this size."
)
#: Samples of a period in which what the elements change is measured.
SAMPLES = 512
#: Movement of an element's input that is rounding, relative to its thresholds and to its value.
_ROUNDING = 1e-13
#: Rounding of a state over a period, relative to its largest value, as in the verdict of a run; changes by the elements
#: that are no more than some times this are lost in it.
_OF_STATES, _LOST = 4e-15, 4.0
#: Above this share of the states the elements' own sizes are felt for certain.
_FELT = 1e-4


def is_rounding(hybrid: HybridSystem, states: Array, memory: Array, moves: Array) -> bool:
    """Whether what the elements see of a motion is rounding of their thresholds and of where it takes place.

    Parameters
    ----------
    hybrid : HybridSystem
    states, memory : arrays, shapes (events, n), (events, h)
        At the events of the motion.
    moves : array, shape (n,)
        How far each state moves at most.
    """
    model = hybrid.model
    place = np.abs(states @ model.C.T + memory @ model.Kz.T).max(axis=0)
    amplitude = np.abs(model.C) @ moves + np.abs(model.Kz) @ np.ptp(memory, axis=0)
    seen, sampled = False, sampled_among(hybrid.elements)
    for e, (first, end) in enumerate(pairwise(model.first[:, 0])):
        own = model.guard_element == e
        weight = np.abs(model.guard_z[own, : end - first]).max(axis=0, initial=0.0)
        if e in sampled or not own.any():
            # An element without levels hands on what it sees, perhaps straight to one that has some; so does a
            # controller, whose guards see its clock alone.
            weight, own = np.where(weight > 0.0, 0.0, 1.0), np.zeros_like(own)
        size = float(np.abs(model.guard_0[own]).max(initial=0.0)) + float(np.sum(weight * place[first:end]))
        if float(np.sum(weight * amplitude[first:end])) > _ROUNDING * size:
            return False
        seen |= size > 0.0
    return seen


def may_be_lost(hybrid: HybridSystem, states: Array, memory: Array, moves: Array, period: float) -> bool:
    """Whether the elements' own sizes are so small beside a motion that :func:`is_lost` has to be asked.

    Parameters are those of :func:`is_rounding`, and the period [s].
    """
    own = _own_sizes(hybrid, states, memory, moves)
    sizes = np.abs(states).max(axis=0) + moves
    seen = np.abs(hybrid.model.C) @ sizes + np.abs(hybrid.model.Kz) @ np.abs(memory).max(axis=0)
    # Without any size of its own a loop is homogeneous whatever its motion.
    return bool(np.any(own > 0.0)) and _share(hybrid, own, sizes, seen, period) < _FELT


def watched(hybrid: HybridSystem) -> HybridSystem:
    """The same system with its states and all inputs and outputs of its elements as signals, in this order."""
    m = hybrid.model
    n_w, (n, n_h) = m.D.shape[1], m.K.shape
    return replace(
        hybrid,
        model=m._replace(
            Yx=np.vstack([np.eye(n), m.C, np.zeros((n_w, n))]),
            Yw=np.vstack([np.zeros((n, n_w)), m.D, np.eye(n_w)]),
            YH=np.vstack([np.zeros((n, n_h)), m.Kz, np.zeros((n_w, n_h))]),
        ),
    )


def is_lost(hybrid: HybridSystem, signals: Array, period: float, changes: float) -> bool:
    """Whether what the elements do to a motion in a period is beneath rounding of its states.

    What an element does is the part of its output that no gain and no constant explain.

    Parameters
    ----------
    hybrid : HybridSystem
    signals : array, shape (nt, n + inputs + outputs)
        Of the `watched` system at even times of one period.
    period : float
        [s]
    changes : float
        Share of the motion's size by which it may change in a period and still count as one that repeats itself.
    """
    n, n_z = hybrid.x0.size, hybrid.model.D.shape[0]
    x, z, w = np.split(signals, [n, n + n_z], axis=1)
    done = np.zeros(w.shape[1])
    for first, end in pairwise(hybrid.model.first):
        done[first[1] : end[1]] = _unexplained(z[:, first[0] : end[0]], w[:, first[1] : end[1]])
    share = _share(hybrid, done, np.abs(x).max(axis=0), np.abs(z).max(axis=0), period)
    return share < _LOST * max(_OF_STATES, changes)


def _unexplained(z: Array, w: Array) -> Array:
    """Mean size of what is left of the outputs w, shape (nt, outputs), behind the best affine map of the inputs z."""
    z = z - z.mean(axis=0)
    columns = np.column_stack([np.ones(len(z)), z / np.maximum(np.abs(z).max(axis=0), 1e-300)])
    gains = np.linalg.lstsq(columns, w, rcond=None)[0]
    left: Array = np.abs(w - columns @ gains).mean(axis=0)
    return left


def _own_sizes(hybrid: HybridSystem, states: Array, memory: Array, moves: Array) -> Array:
    """Most of each output that does not grow in proportion to what the element sees, shape (outputs,)."""
    m = hybrid.model
    varies = _smooth_variation(hybrid, states, memory, moves)
    sizes = np.zeros(m.D.shape[1])
    for e, (first, end) in enumerate(pairwise(m.first[:, 1])):
        modes = slice(m.mode_first[e], m.mode_first[e + 1])
        held = np.abs(m.reset_0[m.guard_element == e]).max(axis=0, initial=0.0)
        most = np.abs(m.mode_w0[modes]) + np.abs(m.mode_ws[modes]) @ varies + np.abs(m.mode_wh[modes]) @ held
        sizes[first:end] = most.max(axis=0)[: end - first]
    return sizes


def _smooth_variation(hybrid: HybridSystem, states: Array, memory: Array, moves: Array) -> Array:
    """How far each smooth channel may vary on a motion, shape (channels,)."""
    m = hybrid.model
    sigma, varies = np.zeros((len(states), m.smooth_kind.size)), np.zeros(m.smooth_kind.size)
    names = {kind: name for name, kind in SMOOTH_KINDS.items()}
    for j, kind in enumerate(m.smooth_kind.tolist()):
        if kind == DELAY_LINE:
            continue
        u = states @ m.smooth_x[j] + memory @ m.smooth_H[j] + sigma @ m.smooth_s[j]
        beyond = float(np.abs(m.smooth_x[j]) @ moves + np.abs(m.smooth_s[j]) @ varies)
        low, high = u.min() - beyond, u.max() + beyond
        # These functions are monotonic beyond one, where they do not repeat themselves.
        at = np.clip(np.concatenate([np.linspace(low, high, 9), np.linspace(-2.0, 2.0, 17)]), low, high)
        f = SMOOTH_FUNCTIONS[names[kind]]
        with np.errstate(over="ignore"):
            varies[j] = abs(m.smooth_scale[j]) * np.ptp(f(at))
            sigma[:, j] = m.smooth_scale[j] * f(u)
    return varies


def _share(hybrid: HybridSystem, outputs: Array, states: Array, inputs: Array, period: float) -> float:
    """Largest share of states, or of what elements see, that outputs of these sizes change in a period."""
    m = hybrid.model
    gain = np.abs(m.B)
    lines = np.flatnonzero(m.smooth_kind == DELAY_LINE)
    gain[:, m.smooth_w[lines]] += np.abs(m.S[:, lines])
    changes = np.concatenate([(gain @ outputs * period)[hybrid.compared], np.abs(m.D) @ outputs])
    sizes = np.concatenate([states[hybrid.compared], inputs])
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(changes > 0.0, changes / sizes, 0.0), initial=0.0))
