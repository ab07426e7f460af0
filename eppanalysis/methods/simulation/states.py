"""A loop in other states than its user's, and its cycles in these: without those that nothing drives.

An integrator without an input keeps its start: a disturbance, a set point. It is a held input among the
states, and no unknown of a cycle. One without a reader (an angle under control of speed) may go on for ever.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.models.systems.algebraic import reached
from eppanalysis.models.systems.linear import ROUNDING, units_of_states
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import equilibrate, without_rounding
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.results import LimitCycle

#: Share of the largest number of a loop, in units that suit it, below which one is none.
_UNOBSERVABLE = 1e-11


@dataclass(frozen=True, eq=False)
class OtherStates:
    """A loop with states y of its own, where the user's are ``x = T y + held``, and with inputs that are counted from
    his.
    """

    system: LureSystem
    T: Array
    inverse: Array
    held: Array
    inputs: Array | float = 0.0

    def of(self, system: LureSystem) -> LureSystem:
        """A loop with the same states as the user's, such as his own at other values, in these."""
        apart = system.in_coordinates(self.T, self.inverse)
        unobservable = ~(np.any(self.system.A, axis=0) | np.any(self.system.C, axis=0))
        inverse, T = np.abs(self.inverse), np.abs(self.T)
        A = np.where((np.abs(apart.A) <= _UNOBSERVABLE * (inverse @ np.abs(system.A) @ T)) & unobservable, 0.0, apart.A)
        C = np.where((np.abs(apart.C) <= _UNOBSERVABLE * (np.abs(system.C) @ T)) & unobservable, 0.0, apart.C)
        return replace(apart, A=A, C=C)

    def beside(self, system: LureSystem) -> OtherStates:
        """The same states of the user's loop at other values."""
        return replace(self, system=self.of(system))

    @classmethod
    def given(cls, system: LureSystem) -> OtherStates:
        """A loop in the states in which it is given."""
        n = len(system.A)
        return cls(system, np.eye(n), np.eye(n), np.zeros(n))

    def then(self, further: OtherStates) -> OtherStates:
        """The same loop in states further on, those of a change of its own."""
        T, inverse = self.T @ further.T, further.inverse @ self.inverse
        return OtherStates(further.system, T, inverse, self.held + self.T @ further.held, self.inputs + further.inputs)

    def state(self, y: Array) -> Array:
        """A state of the user's, or rows of them; none stays none."""
        return y @ self.T.T + self.held if y.size else y

    def to_user(self, cycle: LimitCycle) -> LimitCycle:
        """A cycle of the loop in the user's states; what it does not tell stays untold."""
        state, mean_state, event_states = map(self.state, (cycle.state, cycle.mean_state, cycle.event_states))
        at = cycle.operating_point and self._moved(cycle.operating_point, self.inputs)
        return replace(cycle, state=state, mean_state=mean_state, event_states=event_states, operating_point=at)

    def from_user(self, cycle: LimitCycle) -> LimitCycle:
        """A cycle in the user's states as one of the loop."""
        own = OtherStates(self.system, self.inverse, self.T, -self.inverse @ self.held, -self.inputs)
        return own.to_user(cycle)

    def point(self, at: OperatingPoint) -> OperatingPoint:
        """An operating point of the user's loop as one of the loop."""
        return self._moved(at, -self.inputs)

    def _moved(self, at: OperatingPoint, by: Array | float) -> OperatingPoint:
        if not np.any(by):
            return at
        return at.with_inputs(dict(zip(self.system.input_names, (at.vector(self.system) + by).tolist(), strict=True)))


def at_centre(system: LureSystem, inputs: Array) -> OtherStates | None:
    """The loop with its state counted from its centre under these inputs, and these from where they are; None where
    both are zero, or there is no centre.

    The centre is where nothing moves while every element's input and output are zero. A setpoint or a load puts it far
    from zero, where the digits of a state are those of the setpoint and not of the motion.
    """
    A = system.A - (np.eye(len(system.A)) if system.time_step else 0.0)
    rows = np.vstack([A, system.C])
    constant = np.concatenate([system.constant_state, system.constant_input])
    given = np.vstack([system.B_input, system.D_input])
    terms = np.abs(constant) + np.abs(given) @ np.abs(inputs)
    right = -without_rounding(constant + given @ inputs, terms)
    if not np.any(right):
        return None
    # More equations than unknowns: whether there is a centre shows in what least squares leave.
    row, column = equilibrate(rows)
    place = np.asarray(np.linalg.lstsq(row[:, None] * rows * column, row * right, rcond=None)[0], float)
    place = without_rounding(place, np.full(len(place), np.abs(place).max(initial=0.0)))
    centre = column * place
    size = row * (np.abs(rows) @ np.abs(centre) + terms)
    if np.any(without_rounding(row * (rows @ centre - right), np.full(len(row), size.max(initial=0.0)))):
        return None
    signals = system.signals
    own = replace(
        system,
        constant_state=np.zeros_like(system.constant_state),
        constant_input=np.zeros_like(system.constant_input),
        x0=system.x0 - centre,
        v0=system.v0 - inputs,
        signals=replace(signals, constant=signals.constant + signals.C @ centre + signals.D_input @ inputs),
    )
    return replace(OtherStates.given(own), held=centre, inputs=inputs)


@lru_cache(maxsize=16)  # a loop is run again and again
def unobservable_apart(system: LureSystem) -> OtherStates | None:
    """The loop with integrals that nothing reads as states of their own; None where they are, or there are none.

    The angles of two inertias on a shaft go on for ever where it turns, and their difference does not.
    """
    if not system.A.size or system.time_step:
        return None
    read = np.vstack([system.A, system.C])
    row, column = equilibrate(read)
    _, s, vt = np.linalg.svd(row[:, None] * read * column)
    still = column[:, None] * vt[int(np.sum(s > _UNOBSERVABLE * s.max(initial=0.0))) :].T
    if not still.size:
        return None
    from scipy.linalg import qr

    places = qr((still / column[:, None]).T, mode="r", pivoting=True)[-1][: still.shape[1]]
    still = still @ np.linalg.inv(still[places])
    beside = np.where(np.abs(still) <= _UNOBSERVABLE * np.outer(column, 1.0 / column[places]), 0.0, still)
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


@dataclass(frozen=True, eq=False)
class Subsystem:
    """Elements of a loop that swing without the others, which do not follow them."""

    elements: BoolArray  # (m,): which are its own
    acting: BoolArray  # (m,): which of the others act on them
    states: BoolArray  # (n,)
    outputs: BoolArray  # (nw,)
    inputs: BoolArray  # (nz,)

    @classmethod
    def with_elements(cls, system: LureSystem, reach: BoolArray, own: BoolArray) -> Subsystem:
        """Of these elements, where `reach` tells what states and elements act on which, through others too."""
        n = len(system.A)
        followed = reach[:n, n:]
        states = np.any(followed[:, own], axis=1) | ~np.any(followed[:, ~own], axis=1)
        slices = system.output_slices, system.input_slices
        spread = (np.repeat(own, [each.stop - each.start for each in places]) for places in slices)
        return cls(own, np.any(reach[n:, n:][own], axis=0) & ~own, states, *spread)

    def of(self, system: LureSystem, state: Array, output: Array) -> LureSystem:
        """Its own loop, the others with this state and these outputs; what of them is not known is not-a-number."""
        s, w, z, signals = self.states, self.outputs, self.inputs, system.signals
        own, x, y = np.flatnonzero(self.elements), np.where(s, 0.0, state), np.where(w, 0.0, output)
        rate = system.A[s] @ np.nan_to_num(x) + system.B[s] @ np.nan_to_num(y)
        told = np.hstack([signals.C, signals.D])
        rest = np.where(told != 0.0, told * np.concatenate([x, y]), 0.0).sum(axis=1)
        return replace(
            system,
            A=system.A[s][:, s],
            B=system.B[s][:, w],
            C=system.C[z][:, s],
            D=system.D[z][:, w],
            elements=tuple(system.elements[e] for e in own),
            element_names=tuple(system.element_names[e] for e in own),
            signals=replace(signals, C=signals.C[:, s], D=signals.D[:, w], constant=signals.constant + rest),
            B_input=system.B_input[s],
            D_input=system.D_input[z],
            constant_state=system.constant_state[s] + rate,
            constant_input=system.constant_input[z] + system.C[z] @ np.nan_to_num(x) + system.D[z] @ np.nan_to_num(y),
            x0=system.x0[s],
            memory=tuple(system.memory[e] for e in own),
            delays=system.delays[w],
            state_names=tuple(np.array(system.state_names)[s].tolist()) if system.state_names else (),
            principal=int(np.searchsorted(own, system.principal)) if self.elements[system.principal] else 0,
            cuts=None,
            margins_at=(),
            given=None,
        )

    def to_user(self, cycle: LimitCycle, system: LureSystem, state: Array) -> LimitCycle:
        """A cycle of its loop as one of the whole, where the others have this state."""
        x, mean = state.copy(), state.copy()
        x[self.states], mean[self.states] = cycle.state, cycle.mean_state
        own = iter(cycle.memory)
        memory = [next(own) if is_own else m for is_own, m in zip(self.elements, system.memory, strict=True)]
        still = dict.fromkeys(system.element_names, {"amplitude": 0.0, "bias": float("nan"), "phase": 0.0})
        return replace(cycle, state=x, mean_state=mean, memory=tuple(memory), elements=still | dict(cycle.elements))


def elements_apart(system: LureSystem) -> OtherStates | None:
    """The loop in states in which it shows which elements do not act on others; None where it shows already.

    In turned states what one element drives is mixed with what others see.
    """
    n = len(system.A)
    if len(system.elements) < 2 or not n:
        return None
    size = units_of_states(system.A, system.around)
    A, B, C = system.A * size / size[:, None], system.B / size[:, None], system.C * size
    driven = [_driven(A, B[:, w]) for w in system.output_slices]
    acts = [
        [
            bool(np.any(without_rounding(C[z] @ R, np.abs(C[z]) @ np.abs(R))) or np.any(system.D[z, w]))
            for w, R in zip(system.output_slices, driven, strict=True)
        ]
        for z in system.input_slices
    ]
    between = reached(np.array(acts))
    if np.array_equal(between, _reach(system)[n:, n:]):
        return None
    # What an element drives of its own comes behind all that those drive on which it acts, and acts on nothing else.
    basis = np.zeros((n, 0))
    for e in np.argsort(np.sum(between | np.eye(len(between), dtype=bool), axis=0), kind="stable"):
        basis = np.hstack([basis, _beyond(driven[e], basis)])
    basis = np.hstack([basis, _beyond(np.eye(n), basis)])
    T, inverse = size[:, None] * basis, np.linalg.inv(basis) / size
    apart = system.in_coordinates(T, inverse)
    terms = [np.abs(x) for x in (inverse, system.A, T, system.B, system.C)]
    return OtherStates(
        replace(
            apart,
            A=without_rounding(apart.A, terms[0] @ terms[1] @ terms[2]),
            B=without_rounding(apart.B, terms[0] @ terms[3]),
            C=without_rounding(apart.C, terms[4] @ terms[2]),
        ),
        T,
        inverse,
        np.zeros(n),
    )


def _driven(A: Array, B: Array) -> Array:
    """Orthonormal basis of what inputs drive of the states, straight or through others, shape (n, k)."""
    basis, last, least = np.zeros((len(A), 0)), B, ROUNDING * np.linalg.norm(B)
    while last.size:
        last = last - basis @ (basis.T @ last)
        U, s, _ = np.linalg.svd(last - basis @ (basis.T @ last), full_matrices=False)
        new = U[:, s > least]
        basis, last, least = np.hstack([basis, new]), A @ new, ROUNDING * np.linalg.norm(A)
    return basis


def _beyond(space: Array, basis: Array) -> Array:
    """Directions of a space, given by orthonormal columns, that a basis does not span."""
    Q = np.linalg.qr(basis)[0]
    _, s, Vt = np.linalg.svd(space - Q @ (Q.T @ space), full_matrices=False)
    return space @ Vt[s > ROUNDING].T


def _reach(system: LureSystem) -> BoolArray:
    """Which states and, behind them, elements act on which, straight or through others, by what is zero."""
    n, m = len(system.A), len(system.elements)
    acts = np.zeros((n + m, n + m), bool)
    acts[:n, :n] = system.A != 0.0
    columns = list(enumerate(system.output_slices))
    for e, z in enumerate(system.input_slices):
        acts[n + e, :n] = np.any(system.C[z] != 0.0, axis=0)
        acts[n + e, n:] = [np.any(system.D[z, w] != 0.0) for _, w in columns]
    for f, w in columns:
        acts[:n, n + f] = np.any(system.B[:, w] != 0.0, axis=1)
    return reached(acts)


def parts_apart(system: LureSystem) -> list[tuple[Subsystem, list[Subsystem]]]:
    """Groups of elements that swing without others, each with these others, by what acts on one another.

    A closed loop swings with all that follows it. None where every loop makes all elements swing.
    """
    n, m = len(system.A), len(system.elements)
    if m < 2:
        return []
    from scipy.sparse.csgraph import connected_components

    reach = _reach(system)
    between = reach[n:, n:]
    # What a loop makes swing, and with it the loop: the same for all its elements.
    groups = {tuple(between[:, e]): between[:, e] for e in np.flatnonzero(np.diag(between))}
    if all(np.all(own) for own in groups.values()):
        return []
    out = []
    for own in groups.values():
        rest = np.flatnonzero(~own)
        number, label = connected_components(between[np.ix_(rest, rest)], directed=True, connection="weak")
        blocks = [np.isin(np.arange(m), rest[label == k]) for k in range(number)]
        made = [Subsystem.with_elements(system, reach, which) for which in (own, *blocks)]
        out.append((made[0], made[1:]))
    return out
