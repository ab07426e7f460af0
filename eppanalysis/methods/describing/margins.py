"""Classical margins of the loop with its elements as gains, through python-control."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.methods.describing.balance import Array
from eppanalysis.methods.describing.search import frequency_scales
from eppanalysis.models.systems.lure import LureSystem

_DELAY_ORDER = 6


def linear_margins(system: LureSystem) -> dict[str, float]:
    """Gain, phase and disk margins of the linearised loop, cut at its principal element.

    Each element is replaced by the gain that it names for it (`Nonlinearity.linear_gain`): its steepest slope, the
    worst case for most loops; a lock pin in contact is spring and damper, velocity friction is left out.

    Returns
    -------
    dict of str to float
        ``gain_margin`` (factor), ``phase_margin`` [rad], ``disk_margin`` (0 where the linearised loop is unstable; the
        other two then say how far it is from stability, and in which direction), and the crossover frequencies
        ``phase_crossover``, ``gain_crossover`` [rad/s]; empty where the gain at the cut is zero. Where elements have
        no finite slope, ``slope_of_NAME`` of each, which is infinite; and the gain margin, if the loop is cut there and
        no other one has none: zero, or infinite where no gain brings the loop to the border of stability.
    """
    gains = [e.linear_gain() for e in system.elements]
    steep = [i for i, gain in enumerate(gains) if not np.all(np.isfinite(gain))]
    if steep:
        return _margins_without_slope(system, gains, steep)
    loop = _open_loop(system, gains)
    if loop is None:
        return {}
    return _margins(system, loop)


def _margins_without_slope(system: LureSystem, gains: list[Array], steep: list[int]) -> dict[str, float]:
    """What is left to say of a loop whose elements have infinite slopes."""
    found = {f"slope_of_{system.element_names[i]}": float("inf") for i in steep}
    if steep != [system.principal]:
        return found
    infinite = gains[system.principal]
    finite = np.where(np.isfinite(infinite), 0.0, np.sign(infinite))
    loop = _open_loop(system, [finite if i in steep else gain for i, gain in enumerate(gains)])
    if loop is None:
        return found
    of_one = _margins(system, loop)["gain_margin"]
    return {"gain_margin": 0.0 if np.isfinite(of_one) else of_one, **found}


def _margins(system: LureSystem, loop: Any) -> dict[str, float]:
    """Margins of an open loop with negative feedback."""
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


def _open_loop(system: LureSystem, gains: list[Array]) -> Any:
    """Return ratio at the principal element, as a python-control system with negative feedback."""
    import control

    principal = system.principal
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
    acting = np.flatnonzero(np.any(K[own, cut] != 0.0, axis=1))
    if acting.size != 1:
        return None
    column = slice(own.start + int(acting[0]), own.start + int(acting[0]) + 1)
    gain = K[column, cut]
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
