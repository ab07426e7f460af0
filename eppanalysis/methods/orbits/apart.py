"""A loop in coordinates of its own stiffest motion, where those that it is given in mix what is stiff with what is not.

A stiff contact makes entries of 1e8 in the matrix of its mode, of a position into a speed. In natural coordinates, and
in any units of the states, they stand alone, and motions are known to the last digits. In turned ones they are
everywhere, for all states mix positions with speeds, and as many digits are lost as the matrix is larger than its
fastest pole.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from eppanalysis.methods.harmonic.states import OtherStates, without_held_states
from eppanalysis.models.systems.linear import poles
from eppanalysis.models.systems.lure import LureSystem

Array = NDArray[np.float64]

#: So many times as large as its fastest pole the matrix of a mode may be, in the best units of the states.
_MIXED = 10.0
#: Relative error of the fastest pole above which it is rounding.
_KNOWN = 1e-3
#: Condition of the motions beyond which they are no coordinates.
_WORST = 1e10


def in_states_of_its_own(system: LureSystem) -> OtherStates | None:
    """The loop without states that nothing drives, else in those of its stiffest motions; None where it needs none."""
    return without_held_states(system) or (None if system.time_step else motions_apart(system))


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
    poles, left, V = both
    fastest = int(np.argmax(np.abs(poles)))
    # The best units are powers of two that LAPACK finds.
    with np.errstate(invalid="ignore"):  # scipy also returns the scales as whole numbers, which need not fit
        size = np.abs(scipy.linalg.matrix_balance(stiff, permute=False)[0]).max()
    if size <= _MIXED * abs(poles[fastest]):
        return None
    # Of integrators in turned states the poles are rounding, and have no directions of their own: the error of a pole
    # is that of the matrix over the cosine between its left and right direction.
    if np.finfo(float).eps * size > _KNOWN * abs(poles[fastest]) * abs(np.vdot(left[:, fastest], V[:, fastest])):
        return None
    T = np.column_stack([part for p, v in zip(poles, V.T, strict=True) for part in _real(p, v)]).astype(float)
    if not np.linalg.cond(T) < _WORST:
        return None
    inverse = np.asarray(np.linalg.inv(T), float)
    own = system.in_coordinates(T, inverse)
    # Where these coordinates are long and thin beside the given ones, integrators are lost in them: their poles become
    # slow motions, which set how long runs are and where they start.
    return OtherStates(own, T, inverse, np.zeros(len(T))) if _integrators(own) == _integrators(system) else None


def _integrators(system: LureSystem) -> int:
    return int(np.sum(poles(system.A) == 0.0))


def _real(pole: complex, direction: NDArray[np.complex128]) -> list[Array]:
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
