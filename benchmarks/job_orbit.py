"""Exact orbit from its prediction: closing the chain of arcs against shooting and collocation on scipy.

The rivals are what a user would write. Their loop is one that is kind to them: a saturation in front of a third-order
plant, where nothing jumps. Shooting integrates with solve_ivp and solves with root; collocation is solve_bvp with the
period as a parameter, started on the predicted sine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import root

import eppanalysis as epp
from benchmarks.timing import Contender, alternate

Array = NDArray[np.float64]

CASE = "sat_am165"
OURS, SHOOTING, COLLOCATION = "eppanalysis", "scipy solve_ivp + root", "scipy solve_bvp"
TARGET_SECONDS = 0.02


def rate_of(system: epp.LureSystem) -> Callable[[Array], Array]:
    """Rate of the states (n, ...) of the loop, as a user would type it."""
    A, b, c = system.A, system.B[:, 0], system.C[0]

    def rate(x: Array) -> Array:
        y = np.clip(c @ x, -1.0, 1.0)
        return A @ x + np.multiply.outer(b, y)

    return rate


def shooting(system: epp.LureSystem, guess: epp.LimitCycle) -> float:
    """Period by Newton on one integration, begun where the input of the element crosses zero."""
    rate, c = rate_of(system), system.C[0]

    def periodicity(u: Array) -> Array:
        options: dict[str, Any] = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12, "max_step": u[-1] / 50}
        run = solve_ivp(lambda _, x: rate(x), (0.0, u[-1]), u[:-1], **options)
        return np.append(run.y[:, -1] - u[:-1], c @ u[:-1])

    found = root(periodicity, np.append(guess.state, guess.period), tol=1e-12)
    return float(found.x[-1])


def collocation(system: epp.LureSystem, guess: epp.LimitCycle) -> float:
    """Period by fourth-order collocation on an adaptive mesh."""
    rate, c = rate_of(system), system.C[0]
    response = system.state_response(np.array([guess.omega]))[0] @ np.array([guess.harmonics["y"][1]])
    phases = np.linspace(0.0, 1.0, 41)
    start = np.real(response[:, None] * np.exp(2j * np.pi * phases))

    def periodicity(a: Array, b: Array, p: Array) -> Array:
        return np.append(b - a, c @ a)

    found = solve_bvp(
        lambda _, x, p: p[0] * rate(x), periodicity, phases, start, p=[guess.period], tol=1e-9, max_nodes=20_000
    )
    return float(found.p[0])


def run(turns: int = 5, clock: str = "wall") -> dict[str, Any]:
    """Time and error of the period of all three, from the same prediction."""
    case = epp.case(CASE)
    system, expected = case.to_system(), case.expected.exact
    assert expected
    guess = epp.predict_limit_cycles(system)[0]
    ours = Contender(OURS, lambda: epp.exact_orbit(system, guess).period)
    rivals = [Contender(SHOOTING, lambda: shooting(system, guess))]
    rivals.append(Contender(COLLOCATION, lambda: collocation(system, guess)))
    timings = alternate(ours, rivals, turns, clock)
    rows = []
    for name, t in timings.items():
        period = float("nan") if t.result is None else t.result
        rows.append(
            {
                "name": name,
                "seconds": t.seconds,
                "ratio": t.ratio,
                "error": abs(period / expected[0].period - 1.0),
                "target": TARGET_SECONDS if name == OURS else None,
                "met": bool(t.seconds < TARGET_SECONDS) if name == OURS else None,
            }
        )
    return {"case": CASE, "rows": rows}
