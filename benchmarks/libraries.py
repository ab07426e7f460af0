"""Rivals: what each ODE library makes of the elbow's equations, as a list of ways to run it, the loosest first.

A way is a solver, a tolerance, and the sgn of the drive's friction: as it stands in the equations (hard), or smoothed
over 1e-3 rad/s because an integrator chokes on the jump. The absolute tolerance is a thousandth of the relative one.
Libraries that are not installed are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.elbow_plain import CREEP, FLOATS, Operations, for_scipy, make_rates, smooth_sign, start

Array = NDArray[np.float64]

LOOSE = (1e-1, 1e-2, 1e-3, 1e-4)
TIGHT = 1e-6
ABSOLUTE = 1e-3
SMOOTH = Operations(min, max, smooth_sign)
SIGNS = {"hard": FLOATS, "smooth": SMOOTH}
#: Steps after which a library gives up (a hard sgn at a tight tolerance would take for ever).
MOST_STEPS = 200_000


@dataclass(frozen=True)
class Job:
    """Step response of the elbow with these parameters, every millisecond."""

    p: dict[str, float]
    t_end: float

    @property
    def times(self) -> Array:
        """Sample times [s]."""
        return np.arange(round(self.t_end * 1000.0) + 1) / 1000.0


@dataclass(frozen=True)
class Way:
    """One way to run a library; `run` returns theta [rad] at the job's times."""

    library: str
    solver: str
    sign: str
    rtol: float
    run: Callable[[], Array]

    @property
    def label(self) -> str:
        """For a table."""
        return f"{self.solver}, rtol {self.rtol:.0e}, {self.sign} sgn"


def scipy_plain(job: Job) -> Iterator[Way]:
    """`scipy.integrate.solve_ivp` on plain floats, no events."""
    from scipy.integrate import solve_ivp

    y0, times = start(job.p), job.times

    def run(solver: str, operations: Operations, rtol: float) -> Array:
        rate = for_scipy(job.p, operations)
        found = solve_ivp(rate, (0.0, job.t_end), y0, solver, times, rtol=rtol, atol=ABSOLUTE * rtol)
        return found.y[0]

    for solver in ("RK45", "RK23", "DOP853", "LSODA"):
        for sign, operations in SIGNS.items():
            for rtol in LOOSE if sign == "hard" else (*LOOSE, TIGHT, 1e-9):
                yield Way("scipy solve_ivp", solver, sign, rtol, lambda a=(solver, operations, rtol): run(*a))


def python_control(job: Job) -> Iterator[Way]:
    """`control.input_output_response` of a NonlinearIOSystem."""
    import control

    y0, times = start(job.p), job.times
    silent = np.zeros_like(times)

    def run(system: Any, solver: str, rtol: float) -> Array:
        found = control.input_output_response(
            system,
            times,
            silent,
            y0,
            solve_ivp_method=solver,
            solve_ivp_kwargs={"rtol": rtol, "atol": ABSOLUTE * rtol},
        )
        return found.states[0]

    for sign, operations in SIGNS.items():
        rates = make_rates(job.p, operations)
        system = control.nlsys(
            lambda t, x, u, params, rates=rates: np.array(rates(*x.tolist())),
            None,
            inputs=["harness"],
            outputs=len(y0),
            states=len(y0),
        )
        for solver in ("RK45", "RK23", "LSODA"):
            for rtol in LOOSE:
                yield Way("python-control", solver, sign, rtol, lambda a=(system, solver, rtol): run(*a))


def casadi(job: Job) -> Iterator[Way]:
    """CasADi's CVODES and IDAS on its own virtual machine."""
    import casadi as ca

    y0, times = start(job.p), job.times
    y = ca.SX.sym("y", len(y0))
    kinds = {"hard": ca.sign, "smooth": lambda v: ca.tanh(v / CREEP)}
    adams = {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}
    plugins: dict[str, tuple[str, dict[str, Any]]] = {
        "CVODES BDF": ("cvodes", {}),
        "CVODES Adams": ("cvodes", adams),
        "IDAS": ("idas", {}),
    }
    for sign, function in kinds.items():
        rates = ca.vertcat(*make_rates(job.p, Operations(ca.fmin, ca.fmax, function))(*ca.vertsplit(y)))
        for solver, (plugin, options) in plugins.items():
            for rtol in LOOSE[1:3] if sign == "hard" else (*LOOSE[1:], TIGHT):
                settings = {**options, "reltol": rtol, "abstol": ABSOLUTE * rtol, "max_num_steps": MOST_STEPS}
                made = ca.integrator("step_response", plugin, {"x": y, "ode": rates}, 0.0, list(times), settings)
                library = f"CasADi {solver.split()[0]}"
                yield Way(library, solver, sign, rtol, lambda f=made: np.array(f(x0=y0)["xf"])[0])


def diffrax(job: Job) -> Iterator[Way]:
    """Diffrax on the CPU, compiled by XLA in double precision; the tolerance is an argument, compiled once a solver."""
    import diffrax as dx
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    y0, times = jnp.asarray(start(job.p)), jnp.asarray(job.times)
    kinds = {"hard": jnp.sign, "smooth": lambda v: jnp.tanh(v / CREEP)}

    def compiled(solver: Any, function: Callable) -> Callable[[float], Array]:
        rates = make_rates(job.p, Operations(jnp.minimum, jnp.maximum, function))
        term = dx.ODETerm(lambda t, y, args: jnp.stack(rates(*(y[i] for i in range(y.size)))))

        @jax.jit
        def solve(rtol: float) -> Any:
            control = dx.PIDController(rtol=rtol, atol=ABSOLUTE * rtol)
            kept = dx.SaveAt(ts=times)
            found = dx.diffeqsolve(
                term, solver, 0.0, job.t_end, None, y0, saveat=kept, stepsize_controller=control, max_steps=MOST_STEPS,
                throw=False,
            )  # fmt: skip
            return found.ys[:, 0]

        return lambda rtol: np.asarray(solve(rtol))

    explicit = (dx.Bosh3, dx.Tsit5, dx.Dopri5, dx.Dopri8)
    for sign, function in kinds.items():
        for solver in explicit if sign == "hard" else (*explicit, dx.Kvaerno3, dx.Kvaerno5):
            solve = compiled(solver(), function)
            for rtol in LOOSE[1:] if sign == "hard" else (*LOOSE[1:], TIGHT):
                yield Way("diffrax", solver.__name__, sign, rtol, lambda f=solve, r=rtol: f(r))


def _compiled_rates(p: dict[str, float], sign: str) -> Callable:
    from numba import njit

    function = njit(SIGNS[sign].sign) if sign == "hard" else njit(lambda v: math.tanh(v / CREEP))
    return njit(make_rates(p, Operations(min, max, function)))


def sundials(job: Job) -> Iterator[Way]:
    """CVODE by scikit-sundae, the right-hand side compiled by numba."""
    from sksundae.cvode import CVODE

    y0, times = start(job.p), job.times
    rates = _compiled_rates(job.p, "smooth")

    def rate(t: float, y: Array, out: Array) -> None:
        out[:] = rates(*y.tolist())

    for method in ("Adams", "BDF"):
        for rtol in (*LOOSE[1:], TIGHT):
            solver = CVODE(rate, method=method, rtol=rtol, atol=ABSOLUTE * rtol, max_num_steps=MOST_STEPS)
            yield Way("scikit-sundae CVODE", method, "smooth", rtol, lambda f=solver: f.solve(times, y0).y[:, 0])


def numbalsoda(job: Job) -> Iterator[Way]:
    """LSODA and DOP853 in Fortran and C++, called with a right-hand side compiled by numba: no Python in the loop."""
    import numbalsoda as library
    from numba import cfunc

    y0, times = start(job.p), job.times

    def run(solver: Callable, address: int, rtol: float) -> Array:
        found, success = solver(address, y0, times, rtol=rtol, atol=ABSOLUTE * rtol, mxstep=MOST_STEPS)
        return found[:, 0] if success else np.full(times.size, np.nan)

    for sign in SIGNS:
        rates = _compiled_rates(job.p, sign)
        entry = _entry(cfunc, library.lsoda_sig, rates)
        for name, solver in (("LSODA", library.lsoda), ("DOP853", library.dop853)):
            for rtol in LOOSE[1:3] if sign == "hard" else (*LOOSE[1:], TIGHT):
                yield Way("numbalsoda", name, sign, rtol, lambda a=(solver, entry, rtol): run(a[0], a[1].address, a[2]))


def _entry(cfunc: Callable, signature: Any, rates: Callable) -> Any:
    """C callback around compiled rates."""

    @cfunc(signature)
    def rate(t, y, out, data):
        a, b, c, d, e, f, g = rates(y[0], y[1], y[2], y[3], y[4], y[5], y[6])
        out[0], out[1], out[2], out[3], out[4], out[5], out[6] = a, b, c, d, e, f, g

    return rate


#: Libraries by the module that they need.
LIBRARIES: dict[str, tuple[str, Callable[[Job], Iterator[Way]]]] = {
    "scipy solve_ivp": ("scipy", scipy_plain),
    "python-control": ("control", python_control),
    "CasADi": ("casadi", casadi),
    "diffrax": ("diffrax", diffrax),
    "scikit-sundae CVODE": ("sksundae", sundials),
    "numbalsoda": ("numbalsoda", numbalsoda),
}


def installed() -> dict[str, Callable[[Job], Iterator[Way]]]:
    """Libraries that can be imported."""
    return {name: ways for name, (module, ways) in LIBRARIES.items() if find_spec(module)}
