"""A loop in other states than its user's, and its cycles in these: without those that nothing drives.

An integrator without an input keeps its start: a disturbance, a set point. It is a held input that stands among the
states, and no unknown of a cycle. One without a reader (an angle under control of speed) may go on for ever.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy.linalg

from eppanalysis.arrays import Array
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import equilibrate, without_rounding
from eppanalysis.results import LimitCycle

#: Share of the largest number of a loop, in units that suit it, below which one is none.
_UNREAD = 1e-11


@dataclass(frozen=True, eq=False)
class OtherStates:
    """A loop with states y of its own, where the user's are ``x = T y + held`` and ``y = inverse x``."""

    system: LureSystem
    T: Array
    inverse: Array
    held: Array

    def of(self, system: LureSystem) -> LureSystem:
        """A loop with the same states as the user's, such as his own at other values, in these."""
        apart = system.in_coordinates(self.T, self.inverse)
        unread = ~(np.any(self.system.A, axis=0) | np.any(self.system.C, axis=0))
        inverse, T = np.abs(self.inverse), np.abs(self.T)
        A = np.where((np.abs(apart.A) <= _UNREAD * (inverse @ np.abs(system.A) @ T)) & unread, 0.0, apart.A)
        C = np.where((np.abs(apart.C) <= _UNREAD * (np.abs(system.C) @ T)) & unread, 0.0, apart.C)
        return replace(apart, A=A, C=C)

    def state(self, y: Array) -> Array:
        """A state of the user's, or rows of them; none stays none."""
        return y @ self.T.T + self.held if y.size else y

    def told(self, cycle: LimitCycle) -> LimitCycle:
        """A cycle of the loop in the user's states; what it does not tell stays untold."""
        state, mean_state, event_states = map(self.state, (cycle.state, cycle.mean_state, cycle.event_states))
        return replace(cycle, state=state, mean_state=mean_state, event_states=event_states)

    def asked(self, cycle: LimitCycle) -> LimitCycle:
        """A cycle in the user's states as one of the loop."""
        return OtherStates(self.system, self.inverse, self.T, np.zeros(len(self.inverse))).told(cycle)


@lru_cache(maxsize=16)  # a loop is run again and again
def unread_apart(system: LureSystem) -> OtherStates | None:
    """The loop with integrals that nothing reads as states of their own; None where they are, or there are none.

    The angles of two inertias on a shaft go on for ever where it turns, and their difference does not.
    """
    if not system.A.size or system.time_step:
        return None
    read = np.vstack([system.A, system.C])
    row, column = equilibrate(read)
    _, s, vt = np.linalg.svd(row[:, None] * read * column)
    still = column[:, None] * vt[int(np.sum(s > _UNREAD * s.max(initial=0.0))) :].T
    if not still.size:
        return None
    places = scipy.linalg.qr((still / column[:, None]).T, mode="r", pivoting=True)[-1][: still.shape[1]]
    still = still @ np.linalg.inv(still[places])
    beside = np.where(np.abs(still) <= _UNREAD * np.outer(column, 1.0 / column[places]), 0.0, still)
    beside[places] = 0.0
    if not np.any(beside):
        return None
    T, inverse = np.eye(len(still)), np.eye(len(still))
    T[:, places] += beside
    inverse[:, places] -= beside
    apart = system.in_coordinates(T, inverse)
    A, C = apart.A.copy(), apart.C.copy()
    A[:, places], C[:, places] = 0.0, 0.0
    return OtherStates(replace(apart, A=A, C=C), T, inverse, np.zeros(len(T)))


def without_held_states(system: LureSystem) -> OtherStates | None:
    """The loop with its undriven integrators as constants; None where it has none."""
    if not system.A.size:
        return None
    apart, T = system.with_integrators_apart
    inverse: Array = np.asarray(np.linalg.inv(T), float)
    A = apart.A - (np.eye(len(T)) if system.time_step else 0.0)
    given: Array = np.hstack([system.B, system.B_input, system.constant_state[:, None]])
    terms: Array = np.abs(inverse) @ np.abs(given)
    driven = np.any(A, axis=1) | np.any(without_rounding(inverse @ given, terms), axis=1)
    if np.all(driven):
        return None
    held, s, cuts = np.where(driven, 0.0, apart.x0), apart.signals, apart.cuts
    own = replace(
        apart,
        A=apart.A[driven][:, driven],
        B=apart.B[driven],
        C=apart.C[:, driven],
        B_input=apart.B_input[driven],
        constant_state=(apart.constant_state + A @ held)[driven],
        constant_input=apart.constant_input + apart.C @ held,
        x0=apart.x0[driven],
        state_names=tuple(np.array(apart.state_names)[driven].tolist()),
        signals=replace(s, C=s.C[:, driven], constant=s.constant + s.C @ held),
        cuts=cuts and replace(cuts, B=cuts.B[driven], C=cuts.C[:, driven]),
    )
    return OtherStates(own, T[:, driven], inverse[driven], T @ held)
