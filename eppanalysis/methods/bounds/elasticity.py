"""How a bound moves with every parameter of a case: from the multipliers of the programme, with nothing solved again.

At a solution of ``minimise p subject to E(X, theta(p, q)) = 0`` the derivative of the bound by another parameter q is
that of the Lagrangian (the envelope theorem): ``dp/dq = multipliers @ dE/dtheta @ dtheta/dq``. The first two factors
are exact (IPOPT, CasADi); the numbers theta of the loop are polynomials of q to rounding, which are differentiated. The
elasticity ``(q/p) dp/dq`` says by how many per cent the bound moves when the parameter grows by one.

At an exact fold the equations of the orbit, r(u, p) = 0, are singular; with the row psi that annihilates their
derivative by u, ``dp/dq = -(psi @ dr/dq) / (psi @ dr/dp)``, where both derivatives are taken along the exact arcs.

Where cycles begin as the oscillation of the linear loop, a pole of it stays undamped, ``dp/dq = -(d Re s/dq)/(d Re
s/dp)``; where the orbit reaches an allowed size S, ``dp/dq = -(dS/dq) / (dS/dp)``. Pole and size of orbits that are
closed about the bound are polynomials to rounding, too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

import numpy as np

from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.balanced import BoundProblem, steady_loop
from eppanalysis.methods.bounds.fold import Fold, Programmes
from eppanalysis.methods.bounds.numbers import Plan, gather
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.continuation.families import slope_of
from eppanalysis.methods.continuation.labels import linear_arc
from eppanalysis.methods.continuation.seeds import steady_case
from eppanalysis.methods.continuation.steps import BranchPoint
from eppanalysis.methods.harmonic.series import anchored
from eppanalysis.methods.orbits.arcs import Arcs
from eppanalysis.methods.orbits.orbit import CONVERGED, Orbit, solve
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.polynomials import polynomial_at

#: Parameters that say where the motion begins or how it is recorded, not what the loop is.
_LEFT_OUT = ("run.", "expected.")

#: How much larger than allowed a cycle is that is bounded by its frequency alone.
_LARGER = 1e-6


def parameters_of(question: BoundProblem) -> list[str]:
    """Parameters by which a bound has an elasticity: numbers that are not zero, without the bounded one.

    A field that the bounded one replaces (the prehensor's mass, say, by the forearm's inertia) has none.
    """
    case = question.case_at(question.high)
    found = []
    for name, parameter in getattr(case, "parameters", {}).items():
        value = parameter.value
        if isinstance(value, bool) or not value or name == question.limit or name.startswith(_LEFT_OUT):
            continue
        found.append(name)
    return found


def harmonic_slopes(
    question: BoundProblem, programmes: Programmes, fold: Fold, sizes: Mapping[str, float]
) -> dict[str, float]:
    """Derivative of the bound of a fold by parameters, each with what is a large change of it [SI].

    It is nan where a parameter changes the structure of the loop.
    """
    value = fold.cycle.value
    model = question.model()
    numbers = model.numbers(fold.plan, value)
    _, pivot = anchored(fold.cycle.Z)
    expressions = programmes.expressions(fold.plan, model.loop(value), numbers, pivot)
    used = numbers.used
    gradient = np.zeros(used.size)
    gradient[used] = np.array(expressions.by_numbers(fold.unknowns, numbers.at(value)[used], fold.multipliers)).ravel()
    case, out = question.case_at(value), {}
    for name, size in sizes.items():
        slope = _slope(case, name, fold.plan, size)
        # A number that is zero at the bound has no symbol in the equations:
        # where the parameter moves it the derivative is unknown, not zero.
        known = slope is not None and not np.any(slope[~used] != 0.0)
        out[name] = float(gradient @ slope) if known and slope is not None else float("nan")
    return out


def _slope(case: CaseLike, name: str, plan: Plan, size: float) -> np.ndarray | None:
    """Derivative of the loop's numbers by a parameter; None where it changes the structure of the loop."""
    value = case.value(name)
    found = polynomial_at(lambda v: gather(steady_loop(case.with_values({name: v})), plan).flat(), value, size)
    return None if found is None else found.slope(value)


def exact_elasticities(question: BoundProblem, point: BranchPoint) -> dict[str, float]:
    """Elasticity of an exact bound by every parameter; nan where a parameter changes the structure of the loop.

    At a fold the equations of the orbit are singular. At a border collision those are overdetermined that are left when
    the arc that has no duration is kept so. Either way one combination of them does not feel the orbit, only the
    parameters.
    """
    scale = question.case.value
    slopes = exact_slopes(question, point, {name: abs(scale(name)) for name in parameters_of(question)})
    return {name: slope * scale(name) / point.value for name, slope in slopes.items()}


def exact_slopes(question: BoundProblem, point: BranchPoint, sizes: Mapping[str, float]) -> dict[str, float]:
    """Derivative of an exact bound by parameters, as :func:`harmonic_slopes` takes and has it.

    `point` is the fold, or the border collision with the arc that has no duration there.
    """
    orbit, case, value = point.orbit, question.case_at(point.value), question.case.value
    arc = None if point.arc is not None else linear_arc(orbit)
    if arc is not None:
        by_limit = _damping_slope(case, question.limit, point.value, orbit, arc)
        return {
            name: -_damping_slope(case, name, value(name), orbit, arc, size) / by_limit for name, size in sizes.items()
        }
    A = orbit.scaled
    # At a fold the derivative A by the unknowns is singular, and the row psi with psi
    # A = 0 leaves psi (r_limit dlimit + r_q dq) = 0. At a border collision one arc
    # keeps having no duration, so its column is no unknown (docs/howto/bounds.md).
    if point.arc is not None:
        A = np.delete(A, orbit.arcs.free.size + point.arc, axis=1)
    psi = np.linalg.svd(A)[0][:, -1] / orbit.row_scale
    by_limit = float(psi @ point.slope)
    out = {}
    for name, size in sizes.items():
        try:
            slope = slope_of(_changed(case, name), orbit, value(name), size)
        except EppError:
            out[name] = float("nan")
            continue
        out[name] = -float(psi @ slope) / by_limit
    return out


def _changed(case: CaseLike, name: str) -> Callable[[float], HybridSystem]:
    return lambda value: steady_case(case.with_values({name: value}))


def _damping_slope(case: CaseLike, name: str, value: float, orbit: Orbit, arc: int, size: float = 0.0) -> float:
    """Derivative by a parameter of the damping of the pole whose oscillation an orbit is; nan where it has none."""
    build, n, pole = _changed(case, name), orbit.hybrid.n_plant, 2j * np.pi / orbit.period

    def damping(v: float) -> np.ndarray:
        poles = np.linalg.eigvals(Arcs.build(build(v), orbit.arcs.event_sequence, orbit.arcs).F[arc, :n, :n])
        return np.array([poles[np.argmin(np.abs(poles - pole))].real])

    found = polynomial_at(damping, value, size)
    return float("nan") if found is None else float(found.slope(value)[0])


def size_elasticities(
    question: BoundProblem, point: BranchPoint, allowed: Allowed, names: Collection[str] | None = None
) -> dict[str, float]:
    """Elasticity of a bound at which an orbit reaches an allowed size, by parameters (by default all of the case).

    It is nan where a parameter changes the structure of the loop; that by the size itself goes by the name "allowed".
    """
    at_bound, bound = question.case_at(point.value), point.value
    by_limit = _growth(at_bound, question.limit, bound, point, allowed)
    if by_limit is None or by_limit == 0.0:
        return {}
    # The size stays what is allowed: d ln limit / d ln q = -(d ln size / d ln q) / (d ln size / d ln limit).
    # Where the cycle comes into the band it is larger already, and its frequency feels nothing of what is allowed.
    larger = allowed.size_of_orbit(at_bound.to_system(), point.orbit) > (1.0 + _LARGER) * allowed.size
    out = {"allowed": 0.0 if larger else 1.0 / by_limit}
    for name in parameters_of(question):
        if names is not None and name not in names:
            continue
        grown = _growth(at_bound, name, question.case.value(name), point, allowed)
        out[name] = float("nan") if grown is None else -grown / by_limit
    return out


def _growth(case: CaseLike, name: str, value: float, point: BranchPoint, allowed: Allowed) -> float | None:
    """Relative growth of the size of an orbit for a relative growth of a parameter; None where it has none."""

    def size(v: float) -> np.ndarray | None:
        changed = case.with_values({name: v})
        hybrid = steady_case(changed)
        y = point.orbit.y.copy()
        # The states of the loop are followed by its inputs, which the changed parameter may have moved.
        y[hybrid.n_plant : hybrid.x0.size] = hybrid.x0[hybrid.n_plant :]
        orbit = solve(hybrid, replace(point.orbit.guess, y=y))
        return np.array([allowed.of_orbit(changed.to_system(), orbit)]) if orbit.residual < CONVERGED else None

    found = polynomial_at(size, value, abs(value))
    return None if found is None else float(value * found.slope(value)[0] / found.at(value)[0])
