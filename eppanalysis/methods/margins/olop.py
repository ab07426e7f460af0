"""The open-loop onset point of a limited rate: where it sets in, and whether it then makes the loop jump.

Duda, "Effects of rate limiting elements in flight control systems: a new PIO criterion", AIAA 95-3204 (1995), and
"Prediction of pilot-in-the-loop oscillations due to rate saturation", J. Guidance 20 (1997) 581. Once a limiter is at
its limit, it loses phase; the loop then runs away or not by the place of its open loop in Nichols' chart at that
frequency, and the boundary between the two is drawn from many loops.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError, ModelError, did_you_mean
from eppanalysis.methods.margins.crossovers import Response
from eppanalysis.methods.margins.linearised import Linearised
from eppanalysis.methods.margins.olop_result import BOUNDARY, OnsetPoint
from eppanalysis.methods.margins.stability import is_stable
from eppanalysis.models.elements.base import RateLimit
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import refuse_samples
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_continuous, system_of
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.roots import between

__all__ = ["olop"]


@checked
def olop(
    loop: LureSystem | CaseLike, amplitude: float, input: str | None = None, element: str | None = None
) -> OnsetPoint:
    """Open-loop onset point of a rate limiter, and on which side of Duda's boundary it lies.

    With a sine of the given amplitude at the reference, the limiter's rate is first reached at the onset frequency: the
    lowest at which its output would move at its limit while the loop is still linear. The open loop, cut at the
    limiter, is read there in Nichols' chart. Above the boundary the loop is prone to jump, and a pilot to oscillate
    with it, once the limit sets in.

    Parameters
    ----------
    loop : LureSystem or Case
        With a rate limiter or a rate-limited servo.
    amplitude : float
        Of the pilot's or reference's sine, in the unit of its input [SI]; positive.
    input : str, optional
        Name of the external input at which it comes in; by default the only one. A loop without any takes it where the
        limiter has its input.
    element : str, optional
        Name of the limiter, where there are several; by default the only one.

    Returns
    -------
    OnsetPoint

    Raises
    ------
    EppError
        If `loop` is neither a case nor a loop, `amplitude` is not positive, or there is no such input.
    ModelError
        If there is no limiter, or several and none is named.

    Notes
    -----
    Of a rate-limited servo it is the rate of its output that is held against the limit, its lag included; of an ideal
    limiter that is the rate of its input, as in Duda's papers. Frequencies above the onset do not count. The boundary
    reaches from -180 to -60 degrees: outside it there is no verdict. It is empirical.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(
    ...     ([4.0], [1.0, 1.0, 0.0]), epp.RateLimiter(rate=1.0)
    ... )
    >>> point = epp.olop(loop, amplitude=0.5)
    >>> print(f"{point.omega:.4f} rad/s, {np.rad2deg(point.phase):.2f} deg")
    1.5519 rad/s, -147.20 deg
    >>> point.prone
    True
    """
    system = system_of(loop, "olop")
    refuse_samples(system.elements, "olop")
    require_continuous(system, "olop")
    if not (np.isfinite(amplitude) and amplitude > 0):
        raise EppError(f"olop: amplitude is {amplitude:g}; expected a positive number.")
    name, limiter = _limiter(system, element)
    column = _input(system, input)
    made_by = Provenance("olop", {"system": system.name}, case=facts_of(loop))
    with np.errstate(all="ignore"):
        linearised = Linearised.of(system, f"{name}.out")
        opened, closed = linearised.opened(f"{name}.out"), linearised.closed()
        rates = np.concatenate([opened.rates, closed.rates])
        response = Response.of(opened, rates)
        moves = _moves(linearised, name, limiter, column)
        # The limiter's output moves at A omega |T|: the lowest frequency at which that is the limit is the onset
        # (docs/theory/rate_limit.md, The onset point).
        omega = _onset(response.omega, lambda w: amplitude * w * np.abs(moves(w)) - limiter.rate)
        value = complex(opened.response(np.array([omega]))[0])
        stable = is_stable(closed, rates)
    status, message = _judged(linearised, stable, omega, value, float(response.omega[0]))
    return OnsetPoint(
        at=name,
        status=status,
        amplitude=amplitude,
        omega=omega,
        phase=_phase(value),
        gain=abs(value),
        boundary=boundary_at(_phase(value)),
        message=message,
        rule=linearised.rule(),
        frequencies=response.omega,
        response=response.value,
        provenance=made_by,
    )


def _limiter(system: LureSystem, element: str | None) -> tuple[str, RateLimit]:
    """Name and limit of the limiter that is meant."""
    given = system if system.given is None else system.given
    found = {
        name: e.rate_limit
        for name, e in zip(given.element_names, given.elements, strict=True)
        if e.rate_limit is not None
    }
    if not found:
        raise ModelError(f"olop: {system.name} has no rate limiter", expected="a RateLimiter or a RateLimitedServo")
    if element is None and len(found) > 1:
        raise ModelError(f"olop: {system.name} has {len(found)} rate limiters", expected=f"one of {', '.join(found)}")
    name = next(iter(found)) if element is None else element
    if name not in found:
        raise ModelError("olop: element", name, did_you_mean(name, found))
    return name, found[name]


def _input(system: LureSystem, name: str | None) -> int | None:
    """Number of the external input; None where the loop has none."""
    names = system.input_names
    if name is None and len(names) > 1:
        raise EppError(f"olop: {system.name} has {len(names)} inputs; expected one of {', '.join(names)}.")
    if name is not None and name not in names:
        raise EppError(f"olop: there is no input {name!r}; expected {did_you_mean(name, names)}.")
    return None if not names else 0 if name is None else names.index(name)


def _moves(
    linearised: Linearised, name: str, limiter: RateLimit, column: int | None
) -> Callable[[Array], ComplexArray]:
    """Response (m,) from the input to the limiter's output in the linear loop, at frequencies (m,) [rad/s]."""
    system, K = linearised.system, linearised.gains
    i = system.element_names.index(name)
    row, n, nz = system.input_slices[i].start, len(system.A), len(system.C)
    # Without an external input the sine is added before the limiter, of which a servo's lag is a part.
    lag = limiter.bandwidth if column is None else np.inf
    B = system.B_input[:, [column]] if column is not None else np.zeros((n, 1))
    D = system.D_input[:, [column]] if column is not None else np.eye(nz)[:, [row]]

    def of(omega: Array) -> ComplexArray:
        s = 1j * np.atleast_1d(omega)[:, None, None]
        late = system.B * np.exp(-s * system.delays)
        both = np.concatenate([late, np.broadcast_to(B, (len(s), n, 1))], axis=-1)
        x = np.linalg.solve(s * np.eye(n) - system.A, both) if n else np.zeros((len(s), 0, both.shape[-1]), complex)
        G, given = system.C @ x[..., :-1] + system.D, system.C @ x[..., -1:] + D
        return np.asarray(np.linalg.solve(np.eye(nz) - G @ K, given)[:, row, 0] / (1.0 + s[:, 0, 0] / lag), complex)

    return of


def _onset(omega: Array, excess: Callable[[Array], Array]) -> float:
    """The lowest frequency at which the limit is reached, to rounding; nan where it never is."""
    values = excess(omega)
    above = np.flatnonzero(values >= 0.0)
    if not above.size:
        return float("nan")
    i = int(above[0])
    if i == 0:
        return float(omega[0])
    return float(between(lambda w, _: excess(w), omega[i - 1 : i], omega[i : i + 1])[0])


def _judged(
    linearised: Linearised, stable: bool | None, omega: float, value: complex, lowest: float
) -> tuple[Status, str]:
    """How far the point may be relied on, and what else there is to say of it."""
    if linearised.without:
        names = " and ".join(linearised.system.element_names[i] for i in linearised.without)
        return Status.INCOMPLETE, f"The loop is linearised without {names}, as no gain exists there."
    if not stable:
        return Status.INCOMPLETE, "The linearised loop is unstable, so the criterion does not apply."
    if omega == lowest:
        return Status.INCOMPLETE, "The limit is reached at any frequency: there is no onset."
    if np.isnan(omega):
        return Status.CONVERGED, "At this amplitude the limit is not reached at any frequency."
    if np.isnan(boundary_at(_phase(value))):
        return Status.INCOMPLETE, "The boundary covers only -180 to -60 deg."
    return Status.CONVERGED, ""


def _phase(value: complex) -> float:
    """Phase [rad] above -2 pi, and zero at most, as Nichols' chart has it."""
    angle = float(np.angle(value))
    return angle - 2.0 * np.pi if angle > 0 else angle


def boundary_at(phase: float) -> float:
    """Gain on the boundary at a phase [rad]; nan outside it."""
    degrees, decibels = np.array(BOUNDARY).T
    at = np.rad2deg(phase)
    if not degrees[0] - 1e-9 <= at <= degrees[-1] + 1e-9:
        return float("nan")
    return float(10.0 ** (np.interp(at, degrees, decibels) / 20.0))
