"""Classical margins of the loop with its elements as gains, through python-control."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.methods.describing_balance import Array
from eppanalysis.methods.describing_search import frequency_scales
from eppanalysis.models.lure import LureSystem
from eppanalysis.models.nonlinearities.base import Nonlinearity
from eppanalysis.models.nonlinearities.contact import LockPin
from eppanalysis.models.nonlinearities.friction import Friction
from eppanalysis.models.nonlinearities.memory import JumpAndFollow, Play, StictionPulley
from eppanalysis.models.nonlinearities.parking import ParkingBandLaw, SampledLaw
from eppanalysis.models.nonlinearities.piecewise import PiecewiseLinear
from eppanalysis.models.nonlinearities.static import Cube, Sine

_DELAY_ORDER = 6


def linear_margins(system: LureSystem) -> dict[str, float]:
    """Gain, phase and disk margins of the linearised loop, cut at its principal element.

    Each element is replaced by its steepest finite slope (the worst case for most loops; a smooth one by its slope at
    zero), a lock pin in contact by spring and damper; velocity friction is left out. The loop is cut at the band law,
    or at the first element where there is none.

    Returns
    -------
    dict of str to float
        ``gain_margin`` (factor), ``phase_margin`` [rad], ``disk_margin`` (0 where the linearised loop is unstable; the
        other two then say how far it is from stability, and in which direction), and the crossover frequencies
        ``phase_crossover``, ``gain_crossover`` [rad/s]; empty where an element jumps or has no slope.
    """
    gains = [element_slope(e) for e in system.elements]
    if any(g is None for g in gains):
        return {}
    loop = _open_loop(system, [g for g in gains if g is not None])
    if loop is None:
        return {}
    import control

    scales = frequency_scales(system)
    low, high = (scales.min() * 1e-2, scales.max() * 1e2) if scales.size else (1e-3, 1e3)
    top = np.pi / system.time_step * (1 - 1e-6) if system.time_step else high
    gm, pm, _, wg, wp, _ = control.stability_margins(loop, returnall=True)
    gain_margin, phase_crossover = _nearest(gm, np.log(np.maximum(gm, 1e-300)), wg, low, high)
    phase_margin, gain_crossover = _nearest(np.deg2rad(pm), pm, wp, low, high)
    omega = np.geomspace(low, min(high, top), 500)
    # No disk of gains and phases keeps stable what is unstable to begin with; python-control does not ask.
    disk_margin = float(np.asarray(control.disk_margins(loop, omega)[0])) if _closes_stably(loop) else 0.0
    return {
        "gain_margin": gain_margin,
        "phase_margin": phase_margin,
        "disk_margin": disk_margin,
        "phase_crossover": phase_crossover,
        "gain_crossover": gain_crossover,
    }


def _closes_stably(loop: Any) -> bool:
    """Whether no pole of the closed loop grows, but for rounding."""
    import control

    poles = np.asarray(control.feedback(loop).poles())
    growth = np.abs(poles) - 1.0 if loop.isdtime(strict=True) else poles.real
    return bool(np.all(growth <= 1e-9 * np.abs(poles).max(initial=1.0)))


def _nearest(margins: Array, distance: Array, omega: Array, low: float, high: float) -> tuple[float, float]:
    """The margin of least distance among crossovers inside the frequency range; infinite where there is none."""
    inside = (omega > low) & (omega < high)
    if not np.any(inside):
        return float("inf"), float("nan")
    best = int(np.argmin(np.where(inside, np.abs(distance), np.inf)))
    return float(margins[best]), float(omega[best])


def element_slope(element: Nonlinearity) -> Array | None:
    """Gains (n_outputs, n_inputs) of an element, or None."""
    if isinstance(element, SampledLaw | ParkingBandLaw):
        inner = element_slope(element.law)
        return None if inner is None else np.hstack([inner, [[0.0]]])
    if isinstance(element, LockPin):
        return np.array([[element.stiffness, element.damping]])
    if isinstance(element, StictionPulley):
        h, f = element.harness_stiffness, element.forearm_stiffness
        return np.full((2, 1), h * f / (h + f))
    slope = _scalar_slope(element)
    return np.array([[slope]]) if np.isfinite(slope) else None


def _scalar_slope(element: Nonlinearity) -> float:
    """Slope of an element with one input and one output; not a number where it has none."""
    if isinstance(element, PiecewiseLinear):
        return float(max(element.slope_bounds(), key=abs))
    if isinstance(element, Sine):
        return float(element.scale)
    if isinstance(element, Play):
        return 1.0
    if isinstance(element, JumpAndFollow):
        return float(element.slope)
    return 0.0 if isinstance(element, Friction | Cube) else float("nan")


def _open_loop(system: LureSystem, gains: list[Array]) -> Any:
    """Return ratio at the principal element, as a python-control system with negative feedback."""
    import control

    principal = next((i for i, n in enumerate(system.element_names) if n == "bands"), 0)
    nw, nz = system.B.shape[1], system.C.shape[0]
    K = np.zeros((nw, nz))
    for i, gain in enumerate(gains):
        K[system.output_slices[i], system.input_slices[i]] = gain
    cut, own = system.input_slices[principal], system.output_slices[principal]
    outside = K.copy()
    outside[own] = 0.0
    inverse = np.linalg.inv(np.eye(nz) - system.D @ outside)
    C, D = inverse @ system.C, inverse @ system.D
    A, B = system.A + system.B @ outside @ C, system.B + system.B @ outside @ D
    gain = K[own, cut]
    if gain.shape[0] != 1 or not np.any(gain):
        return None
    column = slice(own.start, own.start + 1)
    into, out = B[:, column], -gain @ C[cut]
    # A clock is an integrator apart: it would put a pole and a zero at the origin and spoil the crossovers.
    used = _reached(A, into) & _reached(A.T, out.T)
    args = (A[np.ix_(used, used)], into[used], out[:, used], -gain @ D[cut][:, column])
    loop = control.ss(*args, *([system.time_step] if system.time_step else []))
    if np.any(system.delays) and not system.time_step:
        late = system.delays.max()
        loop = control.series(control.tf2ss(control.tf(*control.pade(late, _DELAY_ORDER))), loop)
    return loop


def _reached(A: Array, B: Array) -> NDArray[np.bool_]:
    """States that the columns of B act on, directly or through other states, by the pattern of A; shape (n,)."""
    reached = np.any(B != 0.0, axis=1)
    for _ in range(len(A)):
        reached = reached | np.any((A != 0.0) & reached, axis=1)
    return reached
