"""The bound by harmonic balance: the least (or largest) parameter of all periodic solutions, as a nonlinear programme.

    minimise p over (waveform, omega, switching instants, memory values, p)
    subject to the harmonic balance of order n, and switches in their order.

Its solution is a fold: there a stable and an unstable cycle meet, and beyond it none is left of the family. The
programme holds for one sequence of switches (:mod:`eppanalysis.methods.bounds.equations`). At its solution the elements
show which switches they really make; where these are others, the programme is written for them and solved on from
there. The multipliers of the equations give the derivative of the bound by every number of the loop at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import bmat, diags
from scipy.sparse.linalg import splu

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.equations import Expressions, at_symbols, write
from eppanalysis.methods.bounds.numbers import ParametricModel, Plan, gather, plan_of
from eppanalysis.methods.harmonic.balance import settled
from eppanalysis.methods.harmonic.coefficients import stacked
from eppanalysis.methods.harmonic.elements import Unsettled
from eppanalysis.methods.harmonic.loop import Equations, Loop, unstacked
from eppanalysis.methods.harmonic.series import TURN, anchored, orders
from eppanalysis.models.systems.means import mean_state
from eppanalysis.polynomials import Polynomial

_MOST_PROGRAMMES, _MOST_HOPS = 40, 3
_GENUINE = 1e-6
#: Of the first trust region, the shortest one that is tried: from a true cycle, and from what may be near none.
_SHORTEST, _SHORTEST_KNOWN = 1e-3, 0.5
_BEYOND = (1e-4, 1e-3, 5e-3)
#: Switches of one element this close in phase may be about to merge.
_CLOSE = 1e-2
#: Most steps of Newton's method to an extremum, its longest one from a neighbour's, and the size of the last one.
_MOST_STEPS, _NEAR, _ARRIVED = 8, 1.0, 1e-11
#: What IPOPT says of a solution, and how it is set.
_SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "error_on_fail": False,
    # Multipliers of the equations alone are requested, and IPOPT has those.
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "calc_lam_x": False,
    "ipopt.max_iter": 35,
    "ipopt.tol": 1e-9,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.mu_strategy": "adaptive",
    # Of equations as few as these the quickest ordering costs least, and they are scaled already.
    "ipopt.mumps_pivot_order": 0,
    "ipopt.mumps_permuting_scaling": 0,
}


@dataclass(frozen=True, eq=False)
class Cycle:
    """A periodic motion at a value of the parameter, as far as harmonic balance knows it."""

    value: float  # the parameter [SI]
    Z: ComplexArray  # (F, n + 1): coefficients of the elements' free inputs
    omega: float  # [rad/s]

    @property
    def order(self) -> int:
        """Highest harmonic."""
        return self.Z.shape[1] - 1


@dataclass(frozen=True, eq=False)
class Fold:
    """A solution of the programme."""

    cycle: Cycle  # the periodic motion at the bound
    plan: Plan
    #: unknowns, multipliers: of the equations.
    unknowns: Array
    multipliers: Array
    at_end: bool  # the bound is the end of the range: the family goes on beyond it
    merging: bool  # two switches come together there: the family may go on with others


@dataclass(eq=False)
class Programmes:
    """Programmes by plan, written once and solved for as many loops as have the same one."""

    _expressions: dict[Any, Expressions] = field(default_factory=dict)
    _solvers: dict[Any, Any] = field(default_factory=dict)

    def expressions(self, plan: Plan, loop: Loop, numbers: Polynomial, pivot: int) -> Expressions:
        """The equations of a plan."""
        key = plan, pivot, numbers.used.tobytes()
        if key not in self._expressions:
            kinds = tuple(tuple(s.kind for s, _ in e.smooth) for e in loop.elements)
            self._expressions[key] = write(plan, gather(loop, plan), numbers.used, kinds, pivot)
        return self._expressions[key]

    def solver(self, expressions: Expressions, numbers: Polynomial) -> Any:
        """IPOPT for equations and the places of the numbers that depend on the parameter."""
        key = expressions, numbers.places.tobytes(), numbers.coefficients.shape
        if key not in self._solvers:
            self._solvers[key] = _solver(expressions, numbers)
        return self._solvers[key]


def _solver(expressions: Expressions, numbers: Polynomial) -> Any:
    layout = expressions.layout
    V = ca.SX.sym("V", layout.size + 1)
    constants = ca.SX.sym("constants", int(np.sum(expressions.used)))
    coefficients = ca.SX.sym("coefficients", *numbers.coefficients.shape)
    scales = ca.SX.sym("scales", layout.size)
    sizes = ca.SX.sym("sizes", expressions.residual.size1_out(0))
    sign = ca.SX.sym("sign")
    theta = at_symbols(numbers, V[-1], constants, coefficients)
    equations = expressions.residual(V[:-1] * scales, theta) / sizes
    # Switches of an element stay in their order: for another order these equations do not hold.
    dwells = [_dwells(V[s] * scales[s]) for s in layout.phases if s.stop > s.start]
    problem = {
        "x": V,
        "f": sign * V[-1],
        "g": ca.vertcat(equations, *dwells),
        "p": ca.vertcat(constants, ca.vec(coefficients), scales, sizes, sign),
    }
    return ca.nlpsol("bound", "ipopt", problem, _OPTIONS)


def _dwells(phi: Any) -> Any:
    return ca.vertcat(phi[1:] - phi[:-1], phi[0] + TURN - phi[-1])


def balanced(model: ParametricModel, value: float, near: Cycle) -> Cycle | None:
    """The cycle of the balance at a value to which Newton's method comes from one that is near; None where it fails."""
    true = settled(model.loop(value), near.Z, near.omega)
    return None if true is None else Cycle(value, *true)


def missed(loop: Loop, cycle: Cycle) -> float:
    """Residual of the balance with what the elements really do, relative to the motion; infinite if nothing settles."""
    equations = Equations(loop, cycle.order, 0, np.ones(cycle.order))
    X = equations.pack(cycle.Z, cycle.omega)
    try:
        here = equations.at(X)
    except Unsettled:
        return float("inf")
    _, rows = equations.scales(X, here.W)
    return float(np.abs(here.residual / rows)[:-1].max())


def extreme(
    model: ParametricModel, programmes: Programmes, start: Cycle | Fold, sign: float, reach: float = 0.25
) -> Fold | None:
    """The least (sign 1) or largest (sign -1) parameter of the family of cycles that holds (or is near) `start`.

    Parameters
    ----------
    model : ParametricModel
        The loop over the parameter's range.
    programmes
        What has been written before.
    start : Cycle or Fold
        A fold of a loop whose numbers were a little different is solved for again with the switches that it had.
    sign : {1, -1}
    reach : float
        First trust region of the parameter, relative to its value.

    Returns
    -------
    Fold or None
        None where the programme has no solution near the start.
    """
    known = start if isinstance(start, Fold) else None
    path = _Path(start, reach, _SHORTEST) if isinstance(start, Cycle) else _Path(start.cycle, reach, _SHORTEST_KNOWN)
    for _ in range(_MOST_PROGRAMMES):
        step = _Step.of(model, programmes, path.here, sign, path.width, known)
        beside = None if step is None or known is None else step.followed(known)
        known = None
        found = beside or (None if step is None else step.solve())
        if found is None or step is None:
            path.back()
        # The programme solves its own equations whatever the elements do, so these are asked what they make of it.
        elif missed(model.loop(found.cycle.value), found.cycle) < _GENUINE:
            # A true solution ends the way, unless it lies at the rim of its trust region, or switches merge or differ
            # there: then the next programme begins beyond it.
            smooth = not found.merging and step.same_switches(found)
            beyond = found.cycle if step.at_rim(found) else None if smooth else step.beyond(found)
            if beyond is None:
                return beside or step.polished(found)
            path.arrive(beyond)
        else:
            path.hop(found.cycle, step.settled(found.cycle.value, found.cycle))
        if path.lost:
            return None
    return None


@dataclass
class _Path:
    """The way of the programmes from the start to the bound; lives for one call.

    A solution that is none for the switches that the elements really make still leads on: the next programme is written
    for those. Where this leads nowhere the way goes back to the last true solution, with a shorter reach.
    """

    base: Cycle
    width: float
    shortest: float
    hops: int = 0

    def __post_init__(self) -> None:
        self.here, self.longest = self.base, self.width

    @property
    def lost(self) -> bool:
        """Whether no reach is short enough."""
        return self.width < self.shortest * self.longest

    def back(self) -> None:
        """The programme had no solution."""
        self.here, self.hops, self.width = self.base, 0, 0.4 * self.width

    def hop(self, found: Cycle, true: Cycle | None) -> None:
        """The switches change on the way: on from the true solution beside it, or some times from where it led."""
        self.hops += 1
        if true is not None:
            self.arrive(true)
        elif self.hops > _MOST_HOPS:
            self.back()
        else:
            self.here = found

    def arrive(self, true: Cycle) -> None:
        """A true solution on the way."""
        self.base = self.here = true
        self.hops, self.width = 0, min(1.5 * self.width, self.longest)


@dataclass(frozen=True, eq=False)
class _Step:
    """One programme made ready: from a cycle, with the switches that the elements make there."""

    model: ParametricModel
    expressions: Expressions
    numbers: Polynomial
    solver: Any
    start: Array  # unknowns, and the parameter
    scales: Array
    sizes: Array
    window: tuple[float, float]
    sign: float

    @classmethod
    def of(
        cls,
        model: ParametricModel,
        programmes: Programmes,
        here: Cycle,
        sign: float,
        width: float,
        known: Fold | None,
    ) -> _Step | None:
        loop = model.loop(here.value)
        Z, pivot = anchored(here.Z)
        try:
            if known is None:
                plan, phases, memory = plan_of(loop, Z, here.omega)
                start = unknowns_of(loop, Z, here.omega, phases, memory)
            else:
                plan, start = known.plan, known.unknowns
            numbers = model.numbers(plan, here.value)
            expressions = programmes.expressions(plan, loop, numbers, pivot)
        except (Unsettled, EppError):
            return None
        low, high = numbers.middle - numbers.half, numbers.middle + numbers.half
        window = max(low, here.value - width * abs(here.value)), min(high, here.value + width * abs(here.value))
        solver = programmes.solver(expressions, numbers)
        begin, scales = np.append(start, here.value), expressions.scales(start)
        sizes = np.ones(expressions.residual.size1_out(0))
        step = cls(model, expressions, numbers, solver, begin, scales, sizes, window, sign)
        return replace(step, sizes=step._sizes())

    def _sizes(self) -> Array:
        """Sizes of the equations: the largest change that a scaled unknown makes."""
        # IPOPT has one tolerance for all equations, whose units differ; divided by these sizes each counts alike.
        _, slope = self.solver.get_function("nlp_jac_g")(self._scaled_start(), self._parameters())
        size = np.abs(slope.sparse()[: self.sizes.size, :-1]).max(axis=1).toarray().ravel()
        return np.where(size > 0, size, 1.0)

    def _scaled_start(self) -> Array:
        """The start as the programme has its unknowns."""
        return np.append(self.start[:-1] / self.scales, self._scaled(self.start[-1]))

    def _scaled(self, value: float) -> float:
        return (value - self.numbers.middle) / self.numbers.half

    def solve(self) -> Fold | None:
        """The solution for these switches; None where IPOPT fails."""
        layout = self.expressions.layout
        v0 = self._scaled_start()
        low, high = np.full(v0.size, -np.inf), np.full(v0.size, np.inf)
        low[-1], high[-1] = self._scaled(self.window[0]), self._scaled(self.window[1])
        low[layout.omega], high[layout.omega] = 0.2, 5.0
        # A waveform must not shrink to rest, which solves the equations of a loop that is linear at small amplitude.
        pivot = self.expressions.pivot * layout.width + layout.order + 1
        amplitude = v0[pivot]
        low[pivot], high[pivot] = (0.05 * amplitude, np.inf) if amplitude > 0 else (-np.inf, 0.05 * amplitude)
        n_equations = self.sizes.size
        n_dwells = sum(layout.switches)
        found = self.solver(
            x0=v0,
            p=self._parameters(),
            lbx=low,
            ubx=high,
            lbg=np.zeros(n_equations + n_dwells),
            ubg=np.concatenate([np.zeros(n_equations), np.full(n_dwells, np.inf)]),
        )
        v, g, weights = (np.array(found[name]).ravel() for name in ("x", "g", "lam_g"))
        closed = np.abs(g[:n_equations]).max() < 1e-7 and self.solver.stats()["return_status"] in _SOLVED
        return self._fold(v, g, weights) if closed else None

    def _parameters(self) -> Array:
        """What the programme is given besides its unknowns."""
        d, used = self.numbers, self.expressions.used
        return np.concatenate([d.base[used], d.coefficients.ravel(order="F"), self.scales, self.sizes, [self.sign]])

    def _fold(self, v: Array, g: Array, weights: Array) -> Fold:
        """A solution of the programme in the units of the loop."""
        layout, n_equations, ends = self.expressions.layout, self.sizes.size, (self.model.low, self.model.high)
        unknowns = v[:-1] * self.scales
        value = float(np.clip(self.numbers.middle + self.numbers.half * float(v[-1]), *ends))
        Z = unstacked(unknowns[: layout.n_inputs * layout.width + 1], layout.order)
        # d(bound)/d(equation), in the units of both.
        multipliers = weights[:n_equations] / self.sizes * self.numbers.half * self.sign
        at_end = min(abs(value - e) for e in ends) < 1e-6 * (ends[1] - ends[0])
        return Fold(
            Cycle(value, Z, float(unknowns[layout.omega])),
            self.expressions.plan,
            unknowns,
            multipliers,
            at_end,
            bool(np.any(g[n_equations:] < _CLOSE)),
        )

    def polished(self, found: Fold) -> Fold:
        """The fold itself, by Newton's method on the conditions of an extremum.

        IPOPT's barriers push what it finds off a little, and its multipliers, by which elasticities are had, by more:
        they would depend on where it began. Where the range ends or switches meet, it stays as it is.
        """
        if found.at_end or found.merging or self.at_rim(found):
            return found
        polished = self._by_newton(found, _GENUINE)
        return found if polished is None or polished.merging else polished

    def followed(self, known: Fold) -> Fold | None:
        """The fold of these numbers beside one of others, by Newton's method alone; None where that leads to none.

        From a neighbour it takes a few steps, and IPOPT, which forgets the multipliers, dozens.
        """
        if known.at_end or known.merging:
            return None
        found = self._by_newton(known, _NEAR)
        if found is None or found.at_end or found.merging:
            return None
        return found if self.window[0] < found.cycle.value < self.window[1] else None

    def _by_newton(self, near: Fold, reach: float) -> Fold | None:
        """The extremum that Newton's method comes to without a step beyond `reach`; None where there is none."""
        n, p = self.sizes.size, self._parameters()
        slope, curvature = (self.solver.get_function(name) for name in ("nlp_jac_g", "nlp_hess_l"))
        v = np.append(near.unknowns / self.scales, self._scaled(near.cycle.value))
        weights = np.zeros(n + sum(self.expressions.layout.switches))
        weights[:n] = near.multipliers * self.sizes / (self.numbers.half * self.sign)
        across = np.cos(np.arange(v.size + n))
        across[v.size :] = 0.0
        for _ in range(_MOST_STEPS):
            g, J = slope(v, p)
            J, H = J.sparse()[:n], curvature(v, p, 1.0, weights).sparse()
            H = H + H.T - diags(H.diagonal())  # only its upper half is there
            off = J.T @ weights[:n]
            off[-1] += self.sign
            right = -np.append(off, np.array(g).ravel()[:n])
            try:
                step, along = splu(bmat([[H, J.T], [J, None]], "csc")).solve(np.column_stack([right, across])).T
            except RuntimeError:  # singular: no fold of this kind
                return None
            v, weights[:n], far = v + step[: v.size], weights[:n] + step[v.size :], np.abs(step[: v.size]).max()
            if not far < reach:
                return None
            if far < _ARRIVED:
                # The second solution is the tangent t of the cycles times (across t) / (t H t): of an extremum of the
                # other kind their product is negative.
                is_least = float(across @ along) > 0.0
                return self._fold(v, np.array(slope(v, p)[0]).ravel(), weights) if is_least else None
        return None

    def at_rim(self, found: Fold) -> bool:
        """Whether the solution is where the trust region ends, and not the range."""
        rim = self.window[0] if self.sign > 0 else self.window[1]
        return not found.at_end and abs(found.cycle.value - rim) < 1e-6 * abs(rim)

    def settled(self, value: float, near: Cycle) -> Cycle | None:
        """The true solution at a value, if Newton's method comes to one that is not far off."""
        true = balanced(self.model, value, near)
        return None if true is None or abs(true.omega / near.omega - 1.0) > 0.1 else true

    def beyond(self, found: Fold) -> Cycle | None:
        """A true solution a little further on, where the solution is only one for its switches."""
        near = found.cycle
        values = (near.value - self.sign * share * abs(near.value) for share in _BEYOND)
        tried = (self.settled(value, near) for value in values if self.model.low <= value <= self.model.high)
        return next((true for true in tried if true is not None), None)

    def same_switches(self, found: Fold) -> bool:
        """Whether the elements make just these switches at the solution."""
        cycle = found.cycle
        return plan_of(self.model.loop(cycle.value), cycle.Z, cycle.omega)[0] == self.expressions.plan


def unknowns_of(
    loop: Loop, Z: ComplexArray, omega: float, phases: tuple[Array, ...], memory: tuple[Array, ...]
) -> Array:
    """A cycle in the order of the expressions: series of inputs and states, frequency, switches, memory."""
    W, _ = loop.answers(Z, omega)
    n = Z.shape[1] - 1
    x = np.zeros((loop.system.A.shape[0], n + 1), complex)
    x[:, 0] = mean_state(loop.system, loop.value, Z[:, 0].real, W[:, 0].real)
    x[:, 1:] = (loop.system.state_response(omega * orders(n)[1:]) @ W.T[1:, :, None])[..., 0].T
    return np.concatenate([stacked(np.concatenate([Z, x])).ravel(), [omega], *phases, *(h.ravel() for h in memory)])
