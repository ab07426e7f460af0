"""What rounding leaves of a motion: whether elements see more than rounding of it, and it more than rounding of them.

A loop far beyond all that has a size of its own in its elements (levels, gaps, forces) is homogeneous to rounding.
Where its linear part does not damp, motions of every size repeat themselves there to the last digits, and what the
elements do, which alone makes one of them a limit cycle, is lost (docs/theory/simulation.md, Verdict).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.engine.runs import rounding_of_motion
from eppanalysis.models.elements.automaton import SMOOTH_FUNCTIONS, SMOOTH_KINDS
from eppanalysis.models.systems.hybrid import DELAY_LINE, HybridSystem, of_model
from eppanalysis.models.systems.sampled.strobe import sampled_among

#: What is said of a motion whose elements are beneath rounding.
BENEATH_ROUNDING = (
    "The motion repeats itself, but its elements change it by less than rounding in a period: whether it grows, "
    "decays or is a limit cycle is undecided at this size."
)
#: Samples of a period in which what the elements change is measured.
SAMPLES = 512
#: In place of a channel without end.
_NO_END = 1e200
#: Movement of an element's input that is rounding, relative to its thresholds and to the terms of its value; of a loop
#: without any size of its own, relative to where the run has been.
_ROUNDING = 1e-13
#: Rounding of a state over a period, relative to its largest value, as in the verdict of a run; changes by the elements
#: that are no more than some times this are lost in it.
_OF_STATES, _LOST = 4e-15, 4.0
#: Above this share of the states the elements' own sizes are felt for certain.
_FELT = 1e-4


@dataclass(frozen=True, eq=False)
class _Sizes:
    """What these tests, which follow every run, take from the model alone."""

    #: (z, n + h): sizes of the gains from states and memory values to the elements' inputs.
    on_inputs: Array
    #: on_rates, straight: (n, w), (z, w): sizes of the gains from outputs, late ones too, to the rates of the states
    #: and to the inputs.
    on_rates: Array
    straight: Array
    #: (elements, z), (elements,): of each element: the largest weights of the inputs in its guards, and its largest
    #: threshold.
    elements: tuple[Array, Array]
    modes: tuple[tuple[slice, int], ...]  # of each element: its modes, and the number of its outputs
    #: constant, per_smooth: (modes, w), (modes, w, channels): most of each output in a mode that does not grow with the
    #: inputs, and its gains from smooth channels.
    constant: Array
    per_smooth: Array

    @classmethod
    def of(cls, hybrid: HybridSystem) -> _Sizes:
        """Those of a hybrid system."""
        m, sampled = hybrid.model, sampled_among(hybrid.elements)
        on_rates, lines = np.abs(m.B), np.flatnonzero(m.smooth_kind == DELAY_LINE)
        on_rates[:, m.smooth_w[lines]] += np.abs(m.S[:, lines])
        Kz, modes, constant, count = m.Kz.copy(), [], np.abs(m.mode_w0), len(m.first) - 1
        weights, levels = np.zeros((count, len(m.C))), np.zeros(count)
        for e, ((z, w, h), (z_end, w_end, h_end)) in enumerate(pairwise(m.first.tolist())):
            own, rows = m.guard_element == e, slice(int(m.mode_first[e]), int(m.mode_first[e + 1]))
            constant[rows] += np.abs(m.mode_wh[rows]) @ np.abs(m.reset_0[own]).max(axis=0, initial=0.0)
            modes.append((rows, w_end - w))
            if e in sampled:  # what it holds goes straight to the elements behind it
                Kz[:, h:h_end] += m.D[:, w:w_end] @ m.mode_wh[rows.start, : w_end - w, : h_end - h]
            weight = np.abs(m.guard_z[own, : z_end - z]).max(axis=0, initial=0.0)
            if e in sampled or not own.any():
                # An element without levels hands on what it sees, perhaps straight to one that has some; so does a
                # controller, whose guards see its clock alone.
                weight, own = np.where(weight > 0.0, 0.0, 1.0), np.zeros_like(own)
            weights[e, z:z_end], levels[e] = weight, np.abs(m.guard_0[own]).max(initial=0.0)
        on_inputs = np.abs(np.hstack([m.C, Kz]))
        return cls(on_inputs, on_rates, np.abs(m.D), (weights, levels), tuple(modes), constant, np.abs(m.mode_ws))

    def changes(self, outputs: Array) -> tuple[Array, Array]:
        """Most by which outputs of these sizes change the rates of the states, and the inputs of elements at once."""
        return self.on_rates @ outputs, self.straight @ outputs

    def outputs(self, varies: Array) -> Array:
        """Most of each output that does not grow with the inputs, of smooth channels that vary so far."""
        # One without end may act through others alone.
        most = self.constant + self.per_smooth @ np.minimum(varies, _NO_END)
        return np.concatenate([most[rows, :count].max(axis=0) for rows, count in self.modes])

    @cached_property
    def still(self) -> tuple[Array, tuple[Array, Array]]:
        """That without smooth channels, and the changes by it."""
        outputs = self.outputs(np.zeros(self.per_smooth.shape[2]))
        return outputs, self.changes(outputs)


_sizes_of = of_model(_Sizes.of)


def left_by_rounding(
    hybrid: HybridSystem, states: Array, memory: Array, moves: Array, period: float, reached: Array | float = 0.0
) -> tuple[bool, bool]:
    """Whether what the elements see of a motion is rounding of their thresholds and of where it takes place.

    Besides whether their own sizes are so small beside the motion that :func:`is_lost` has to decide.

    Parameters
    ----------
    states, memory : arrays, shapes (events, n), (events, h)
        At the events of the motion.
    moves : array, shape (n,)
        How far each state moves at most.
    period : float
        [s]
    reached : array, shape (n,), optional
        How far each state has been from zero in the run, where there was one.
    """
    of = _sizes_of(hybrid)
    own, changes = of.still
    if of.per_smooth.shape[2]:
        own = of.outputs(_smooth_variation(hybrid, states, memory, moves))
        changes = of.changes(own)
    states, memory = np.ascontiguousarray(states), np.ascontiguousarray(memory)
    numbers = of.on_inputs, of.elements, changes, _ROUNDING
    rounding, share = rounding_of_motion(states, memory, moves, float(period), hybrid.compared, *numbers)
    # Without any size of its own a loop is homogeneous whatever its motion: what has decayed so far decays further.
    has_size = bool(own.max(initial=0.0) > 0.0)
    if not has_size and not of.elements[1].any():
        rounding = rounding or bool(np.all((moves <= _ROUNDING * reached)[hybrid.compared]))
    return rounding, share < _FELT and has_size


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
    (on_rates, straight), compared = _sizes_of(hybrid).changes(outputs), hybrid.compared
    changes, sizes = (
        np.concatenate(both) for both in ([(on_rates * period)[compared], straight], [states[compared], inputs])
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(changes > 0.0, changes / sizes, 0.0), initial=0.0))
