"""How far a search for limit cycles must start from rest: where the elements begin to matter.

In the units of the loop itself, and whatever the coordinates of its state.
"""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import describe
from eppanalysis.methods.describing.search import frequency_scales
from eppanalysis.models.elements.piecewise import PiecewiseLinear
from eppanalysis.models.systems.linear import poles
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import CANCELLED, without_rounding
from eppanalysis.models.systems.sampled.strobe import sampled_among


def reach_of_elements(system: LureSystem) -> Array:
    """A state that puts every element's first input at its largest threshold, or where a constant puts it at rest.

    Of many such states, the one to which the least outputs of the elements lead: it is the same motion in all
    coordinates and units of the state.
    """
    oscillations, C = oscillations_at_reach(system)
    # Of all sums of these oscillations that bring each input to one, that of the least coefficients: x = S C' (C S
    # C')^-1 1.
    spread = (oscillations @ oscillations.conj().T).real
    return np.asarray(spread @ C.T @ np.linalg.pinv(C @ spread @ C.T, hermitian=True) @ np.ones(len(C)))


def oscillations_at_reach(system: LureSystem) -> tuple[ComplexArray, Array]:
    """Oscillations to which the elements' outputs lead, as large as the elements need to matter.

    Returns
    -------
    states, C : complex array (n, k), array (elements, n)
        States of the oscillations at frequencies of the linear part; the elements' first inputs by the state, in parts
        of where each begins to matter.
    """
    rows = [s.start for s in system.input_slices]
    omega = _middle_frequencies(system)
    wanted = np.array([_reach(system, i, omega[len(omega) // 2]) for i in range(len(rows))])
    # Where neither a threshold nor its start tells, the loop has no size (an integrator that is reset): any does.
    wanted = wanted if wanted.any() or np.any(system.x0) else np.ones(len(rows))
    C = _seen(system)[rows][wanted > 0] / wanted[wanted > 0, None]
    with np.errstate(all="ignore"):
        states = np.concatenate(list(system.state_response(omega)), axis=1)
        # What drives no input, as the second output of a contact, does so in turned states by rounding.
        inputs = without_rounding(np.abs(C @ states), np.abs(C) @ np.abs(states), CANCELLED)
        states = states / inputs.max(axis=0, initial=0.0)
    return states[:, np.all(np.isfinite(states), axis=0)], C


def driven_behind_controllers(system: LureSystem) -> ComplexArray:
    """Oscillations, shape (n, k), that an element drives which no state moves but through a sampled controller.

    Its input is twice as large as where it begins to matter: of a relay with a small threshold the states then move
    far more than its threshold tells.
    """
    omega, driven = _middle_frequencies(system), [np.zeros((len(system.A), 0), complex)]
    rows = zip(system.elements, system.input_slices, system.output_slices, strict=True)
    for i, (element, inputs, outputs) in enumerate(rows):
        a = 0.0 if np.any(system.C[inputs.start]) else 2.0 * _reach(system, i, omega[len(omega) // 2])
        if a > 0.0:
            gain = describe(element, np.full(omega.size, a), np.zeros(omega.size), omega)[1]
            with np.errstate(all="ignore"):
                states = np.array([response[:, outputs] for response in system.state_response(omega)])
                driven.append(a * np.einsum("kno,ko->nk", states, gain))
    states = np.concatenate(driven, axis=1)
    return states[:, np.all(np.isfinite(states), axis=0)]


def _seen(system: LureSystem) -> Array:
    """The elements' inputs by the state, shape (inputs, n), with what sampled controllers hand on straight."""
    controllers = sampled_among(system.elements)
    straight = np.zeros((len(system.D), len(system.D)))
    for i, controller in controllers.items():
        # Behind its own ports an element has those of the clock that it reads.
        through = np.asarray(controller.D, float)
        z, w = system.input_slices[i].start, system.output_slices[i].start
        straight[:, z : z + through.shape[1]] = system.D[:, w : w + len(through)] @ through
    seen = system.C
    for _ in controllers:
        seen = system.C + straight @ seen
    return seen


def may_be_overcome(system: LureSystem) -> bool:
    """Whether the linear part grows by itself while all elements give no more than so much: from far out all grows."""
    limited = all(isinstance(e, PiecewiseLinear) and e.slopes[0] == e.slopes[-1] == 0.0 for e in system.elements)
    return limited and bool(np.any(poles(system.A).real > 0.0))


def _middle_frequencies(system: LureSystem) -> Array:
    """Some frequencies from the slowest to the fastest of the linear part [rad/s], none of them just on a pole."""
    scales = frequency_scales(system)
    return 1.2345 * (
        np.geomspace(scales.min(), scales.max(), 5) if scales.size else np.array([crossover_frequency(system)])
    )


def crossover_frequency(system: LureSystem) -> float:
    """Highest frequency at which the gain of a loop of integrators passes one [rad/s], which have none of their own.

    One where thresholds do not tell: of a relay without any, behind integrators alone, cycles have all frequencies.
    """
    omega = np.geomspace(1e-12, 1e12, 481)
    L, gains = system.frequency_response(omega), [0.0]
    for element, inputs, outputs in zip(system.elements, system.input_slices, system.output_slices, strict=True):
        level = np.abs(np.atleast_1d(element.thresholds())).max(initial=0.0)
        if level > 0:
            try:
                gain = describe(element, np.full(omega.size, 2.0 * level), np.zeros(omega.size), omega)[1]
            except ModelError:
                continue
            loop = np.abs(np.einsum("kj,kj->k", gain, L[:, inputs.start, outputs]))
            gains += omega[1:][(loop[:-1] > 1.0) & (loop[1:] <= 1.0)].tolist()
    return max(gains) or 1.0


def _reach(system: LureSystem, i: int, omega: float) -> float:
    """How far an element's first input must go for the element to matter: zero where nothing tells."""
    element, row, outputs = system.elements[i], system.input_slices[i].start, system.output_slices[i]
    level = max([*np.abs(np.atleast_1d(element.thresholds())), abs(float(system.constant_input[row]))], default=0.0)
    if level > 0:
        return level
    # Without a threshold (a relay, dry friction, a cubic) its gain changes with size: where the loop's gain passes one,
    # or where it does not to half of what it is when small (a sine that holds a phase) or twice when large (a preload).
    a = np.geomspace(1e-60, 1e60, 601)
    try:
        gain = describe(element, a, np.zeros(a.size), np.full(a.size, omega))[1]
    except ModelError:
        return 0.0
    loop = np.abs(gain @ system.frequency_response(np.array([omega]))[0, row, outputs])
    passes = np.flatnonzero((loop[:-1] > 1.0) != (loop[1:] > 1.0))
    if not passes.size:
        passes = np.flatnonzero(loop < (0.5 * loop[0] if loop[1] > 0.9 * loop[0] else 2.0 * loop[-1]))
    return float(a[passes[0]]) if passes.size else 0.0
