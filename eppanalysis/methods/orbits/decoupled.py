"""A loop in states of its own, where those that it is given in mix what is stiff or large with what is not.

A stiff contact makes entries of 1e8 in the matrix of its mode, of a position into a speed. In natural coordinates, and
in any units of the states, they are apart, and motions are known to the last digits. In turned ones they are
everywhere, for all states mix positions with speeds, and as many digits are lost as the matrix is larger than its
fastest pole. Likewise states of a chain of lags are of very different sizes, and in turned states all signals are small
differences of the largest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.simulation.states import OtherStates, at_centre, unobservable_apart, without_held_states
from eppanalysis.models.systems.linear import balanced, poles
from eppanalysis.models.systems.lure import LureSystem

#: So many times as large as its fastest pole the matrix of a mode may be, in the best units of the states.
_MIXED = 10.0
#: Relative error of the fastest pole above which it is rounding.
_KNOWN = 1e-3
#: Condition of the motions beyond which they are no coordinates.
_WORST = 1e10
#: So many times as large as the signals are the terms of which they are made up, where states are mixed; in natural
#: coordinates and any units it is near one.
_CANCELS = 20.0
#: What elements drive is weighed over a few times that of the fastest pole, so that integrators count as well.
_FADES = 0.1


def in_decoupled_states(system: LureSystem, inputs: Array | None = None) -> OtherStates | None:
    """The loop without states that nothing drives, with those apart that nothing reads, from its centre under these
    inputs, and in those of its own motions; None where it needs none.

    Other motions are made the states once of each kind: made so again they would only undo one another by rounding, for
    ever. What nothing drives or reads is looked for anew behind each, for it may mix these with the others.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> in_decoupled_states(epp.case("elbow").to_system()) is None  # as it is given
    True
    """
    turns: list[Callable[[LureSystem], OtherStates | None]]
    turns = [] if system.time_step else [motions_apart, evenly_driven, integrators_apart]
    first: list[Callable[[LureSystem], OtherStates | None]] = [without_held_states, unobservable_apart]
    if inputs is not None:
        first.append(lambda system: at_centre(system, inputs))
    left = [*first, *turns]
    found: OtherStates | None = None
    while made := next(((change, own) for change in left if (own := change(system)) is not None), None):
        change, own = made
        found, system = own if found is None else found.then(own), own.system
        if change in turns:
            turns.remove(change)
            left = [*first, *turns]
        else:
            left.remove(change)
    return found


def unmixed(system: LureSystem) -> OtherStates | None:
    """The loop in coordinates that mix neither stiff motions nor large states with others; None where none are."""
    return motions_apart(system) or evenly_driven(system)


def integrators_apart(system: LureSystem) -> OtherStates | None:
    """The loop in coordinates in which its integrators are apart; None where they do as it is given.

    Turned, they are slow motions by rounding, and each state drifts where one does: no bound shows that a guard is far.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.case("band_two_cycles").to_system()
    >>> integrators_apart(loop) is None  # as it is given
    True
    """
    apart, T = system.with_integrators_apart
    return None if apart is system else OtherStates(apart, T, np.asarray(np.linalg.inv(T), float), np.zeros(len(T)))


def evenly_driven(system: LureSystem) -> OtherStates | None:
    """The loop in coordinates in which its elements drive every state alike, where signals are differences of states.

    With the Gramian W of what the elements reach (Moore 1981), ``W = T T'``, no signal is smaller than its terms.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.case("relay_hyst_goncalves6").to_system()
    >>> evenly_driven(loop) is None  # as it is given
    True
    """
    if not system.B.size:
        return None
    A, units = balanced(system.A)
    B, C, values = system.B / units[:, None], system.C * units, poles(A)
    fading = max(float(values.real.max()), 0.0) + _FADES * float(np.abs(values).max())
    if fading == 0.0:
        return None
    B = B / np.maximum(np.linalg.norm(B, axis=0), np.finfo(float).tiny)
    W = scipy.linalg.solve_continuous_lyapunov(A - fading * np.eye(len(A)), -B @ B.T)
    size = np.sqrt(np.abs(np.diag(W)))
    terms, seen = np.abs(C) @ size, np.sqrt(np.abs(np.einsum("ij,jk,ik->i", C, W, C)))
    if not np.all(size > 0.0) or not np.any(terms > _CANCELS * seen):
        return None
    strengths, turn = np.linalg.eigh(W / np.outer(size, size))
    if not strengths[0] > strengths[-1] / _WORST:
        return None
    size, strong = size * units, np.sqrt(strengths)
    T, inverse = size[:, None] * turn * strong, (turn / strong).T / size
    return _in_states(system, T, inverse)


def motions_apart(system: LureSystem) -> OtherStates | None:
    """The loop in coordinates of its stiffest motions; None where they need none.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> motions_apart(epp.case("elbow").to_system()) is None  # as it is given
    True
    """
    stiff = _stiffest(system)
    if stiff is None or not stiff.size:
        return None
    both: Any = scipy.linalg.eig(stiff, left=True, right=True)  # scipy's stubs know pairs only
    values, left, V = both
    fastest = int(np.argmax(np.abs(values)))
    # The best units are powers of two that LAPACK finds.
    with np.errstate(invalid="ignore"):  # scipy also returns the scales as whole numbers, which need not fit
        size = np.abs(scipy.linalg.matrix_balance(stiff, permute=False)[0]).max()
    if size <= _MIXED * abs(values[fastest]):
        return None
    # Of integrators in turned states the poles are rounding, and have no directions of their own: the error of a pole
    # is that of the matrix over the cosine between its left and right direction.
    if np.finfo(float).eps * size > _KNOWN * abs(values[fastest]) * abs(np.vdot(left[:, fastest], V[:, fastest])):
        return None
    T = np.column_stack([part for p, v in zip(values, V.T, strict=True) for part in _real(p, v)]).astype(float)
    if not np.linalg.cond(T) < _WORST:
        return None
    return _in_states(system, T, np.asarray(np.linalg.inv(T), float))


def _in_states(system: LureSystem, T: Array, inverse: Array) -> OtherStates | None:
    """The loop in other states; None where these lose an integrator."""
    own = system.in_coordinates(T, inverse)
    # Where these coordinates are long and thin beside the given ones, integrators are lost in them: their poles become
    # slow motions, which set how long runs are and where they start.
    return OtherStates(own, T, inverse, np.zeros(len(T))) if _integrators(own) == _integrators(system) else None


def _integrators(system: LureSystem) -> int:
    return int(np.sum(poles(system.A) == 0.0))


def _real(pole: complex, direction: ComplexArray) -> list[Array]:
    """Real directions of a motion, both of a pair at its first pole."""
    if pole.imag == 0.0:
        return [direction.real]
    return [direction.real, direction.imag] if pole.imag > 0.0 else []


def _stiffest(system: LureSystem) -> Array | None:
    """Matrix of the loop with every element in the mode of its largest gain; None where that has no solution."""
    gains = np.zeros((system.B.shape[1], system.C.shape[0]))
    for element, inputs, outputs in zip(system.elements, system.input_slices, system.output_slices, strict=True):
        modes = element.automaton().mode_columns["from_input"]
        gains[outputs, inputs] = max(modes, key=lambda mode: float(np.abs(mode).sum()))
    try:
        closed = gains @ np.linalg.solve(np.eye(len(system.C)) - system.D @ gains, system.C)
    except np.linalg.LinAlgError:
        return None
    stiff: Array = system.A + system.B @ closed
    return stiff if np.all(np.isfinite(stiff)) else None
