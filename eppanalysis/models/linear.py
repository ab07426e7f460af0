"""State space of linear blocks, and the border to python-control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.errors import ModelError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """``dx/dt = A x + B u, y = C x + D u`` (or its discrete-time form when `time_step` is set)."""

    A: Array
    B: Array
    C: Array
    D: Array
    time_step: float | None = None


def as_state_space(plant: Any, time_step: float | None = None) -> StateSpace:
    """State space of a transfer function, a python-control system or a (numerator, denominator) pair.

    Parameters
    ----------
    plant : StateSpace, control.LTI or (array_like, array_like)
        Single input, single output.
    time_step : float, optional
        Sample time of a (numerator, denominator) pair in discrete time [s].

    Raises
    ------
    ModelError
        If the system is improper, not single-input single-output, or holds a number that is not finite.
    """
    if isinstance(plant, StateSpace):
        return plant
    if isinstance(plant, tuple) and len(plant) == 2:
        return transfer_function(plant[0], plant[1], time_step)
    if hasattr(plant, "num") and hasattr(plant, "den"):
        if plant.ninputs != 1 or plant.noutputs != 1:
            raise ModelError("The linear part has several inputs or outputs; expected one of each.")
        return transfer_function(plant.num[0][0], plant.den[0][0], _time_step(plant))
    if hasattr(plant, "A") and hasattr(plant, "D"):
        A, B, C, D = (np.asarray(m, float) for m in (plant.A, plant.B, plant.C, plant.D))
        if B.shape[1] != 1 or C.shape[0] != 1:
            raise ModelError("The linear part has several inputs or outputs; expected one of each.")
        return StateSpace(A, B, C, D, _time_step(plant))
    raise ModelError(f"A {type(plant).__name__} is not a linear block; expected a transfer function or a state space.")


def transfer_function(numerator: ArrayLike, denominator: ArrayLike, time_step: float | None = None) -> StateSpace:
    """State space of ``numerator/denominator`` (descending powers), in a controllable form scaled to its own frequency.

    The companion form of a plant with poles near ``w0`` has entries like ``w0**n``; scaling time by ``w0`` first keeps
    them near one, so that results do not depend on the unit of time.
    """
    num = np.trim_zeros(np.atleast_1d(np.asarray(numerator, float)), "f")
    den = np.trim_zeros(np.atleast_1d(np.asarray(denominator, float)), "f")
    if not (np.all(np.isfinite(num)) and np.all(np.isfinite(den))):
        raise ModelError("A transfer function holds a coefficient that is not finite.")
    if den.size == 0:
        raise ModelError("A transfer function has a denominator of zero.")
    if num.size > den.size:
        raise ModelError(
            f"A transfer function is improper: its numerator has degree {num.size - 1}, "
            f"its denominator {den.size - 1}; expected at most the same degree."
        )
    n = den.size - 1
    num = np.concatenate([np.zeros(n + 1 - num.size), num]) / den[0]
    den = den / den[0]
    D = num[:1].reshape(1, 1)
    if n == 0:
        return StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), D, time_step)
    powers = np.arange(1, n + 1)
    sizes = np.abs(den[1:]) ** (1.0 / powers)
    w0 = float(sizes.max()) if time_step is None and sizes.max() > 0 else 1.0
    a = den[1:] / w0**powers
    b = (num[1:] - num[0] * den[1:]) / w0**powers
    A = np.eye(n, k=-1)
    A[0] = -a
    B = np.zeros((n, 1))
    B[0, 0] = 1.0
    return StateSpace(w0 * A, w0 * B, b.reshape(1, n), D, time_step)


def _time_step(plant: Any) -> float | None:
    dt = getattr(plant, "dt", None)
    # True means "discrete, no time given"; note that 1.0 == True.
    return None if dt is None or dt == 0 else float(dt)
