"""Whether a linear loop is stable: by its poles, and with dead time by how often its characteristic function turns."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.margins.linearised import Linear
from eppanalysis.methods.simulation.stability import eigenvalues_and_errors
from eppanalysis.models.systems.linear import balanced, integrators_apart

#: Largest matrix whose eigenvalues are requested.
_LARGEST = 1500
_MOST_NODES = 400_000
#: Share of the slowest rate by which the contour lies right of the imaginary axis: poles at zero stay left of it.
_ASIDE = 1e-7


def is_stable(loop: Linear, rates: ComplexArray) -> bool | None:
    """Whether no pole of a closed loop grows; None where rounding does not tell.

    Integrators apart from the loop (a clock, a mass whose place nobody measures) neither grow nor decay and do
    not count; an integrator within the loop that the loop does not hold shows in its response at low frequencies.

    Parameters
    ----------
    loop : Linear
        Closed.
    rates : complex array
        Poles and zeros that set the scale [rad/s].
    """
    if not loop.n:
        return True
    if loop.rational:
        return _by_poles(loop.terms[0][1], loop.time_step is not None)
    if loop.time_step:
        late = [round(delay / loop.time_step) for delay, _, _ in loop.terms]
        return None if loop.n * (1 + late[-1]) > _LARGEST else _by_poles(_with_samples_kept(loop, late), True)
    return _by_turns(loop, rates)


def _by_poles(A: Array, discrete: bool) -> bool | None:
    """By eigenvalues, each with the error that rounding may have given it."""
    unit = np.eye(len(A)) if discrete else 0.0
    # Poles at zero do not grow, but rounding would put them on either side of the border: they are taken off first.
    apart, _, k = integrators_apart(balanced(A - unit)[0])
    if not k:
        return True
    found, error = eigenvalues_and_errors(apart[:k, :k], 10.0 * np.finfo(float).eps * k)
    growth = np.abs(found + 1.0) - 1.0 if discrete else found.real
    if np.any(growth > error):
        return False
    return True if np.all(growth < -error) else None


def _with_samples_kept(loop: Linear, late: list[int]) -> Array:
    """State matrix with the last states kept in a row of registers."""
    n, m = loop.n, late[-1]
    A = np.eye(n * (m + 1), k=-n)
    A[:n] = 0.0
    for samples, (_, part, _) in zip(late, loop.terms, strict=True):
        A[:n, samples * n : (samples + 1) * n] += part
    return A


def _by_turns(loop: Linear, rates: ComplexArray) -> bool | None:
    """By the argument principle: ``det(s - A(s))/(s + a)^n`` turns by -pi for each pole that grows."""
    size = np.abs(rates)[np.abs(rates) > 0]
    late = np.array([delay for delay, _, _ in loop.terms if delay])
    marks = np.concatenate([size, 1.0 / late])
    aside = _ASIDE * float(marks.min())
    norm = max(float(sum(np.linalg.norm(A, 2) for _, A, _ in loop.terms)), float(marks.max()))
    omega = np.unique(
        np.concatenate(
            [
                [0.0],
                np.geomspace(1e-3 * aside, 20.0 * loop.n * norm, 4000),
                (np.abs(rates.imag)[:, None] + np.abs(rates.real)[:, None] * np.linspace(-3.0, 3.0, 25)).ravel(),
                _as_long_as_it_counts(loop),
            ]
        )
    )
    omega = omega[omega >= 0.0]
    phase = _phase(loop, aside, omega, norm)
    while True:
        step = np.abs(np.angle(phase[1:] / phase[:-1]))
        # A step of nearly pi may as well be one the other way round.
        coarse = step > 0.5
        coarse &= omega[1:] - omega[:-1] > 1e-12 * omega[1:]
        if not np.any(coarse) or omega.size > _MOST_NODES:
            break
        between = 0.5 * (omega[:-1][coarse] + omega[1:][coarse])
        order = np.argsort(np.concatenate([omega, between]), kind="stable")
        omega = np.concatenate([omega, between])[order]
        phase = np.concatenate([phase, _phase(loop, aside, between, norm)])[order]
    steps = np.angle(phase[1:] / phase[:-1])
    count = -float(np.sum(steps)) / np.pi
    if not np.isfinite(count) or np.abs(steps).max() > 1.0 or abs(count - round(count)) > 0.2 or count < -0.5:
        return None
    return round(count) == 0


def _phase(loop: Linear, aside: float, omega: Array, norm: float) -> ComplexArray:
    """``det(s - A(s))/(s + a)^n`` on the contour, divided by its size."""
    s = np.asarray(aside + 1j * omega, complex)
    A, _ = loop.matrices(s)
    sign = np.linalg.slogdet(s[:, None, None] * np.eye(loop.n) - A)[0]
    turned = (s + norm) / np.abs(s + norm)
    return np.asarray(sign / turned**loop.n, complex)


def _as_long_as_it_counts(loop: Linear) -> Array:
    """Evenly spaced frequencies that show every turn of the longest dead time as far as what is late counts."""
    step = 0.1 / loop.longest_delay
    late = float(sum(np.linalg.norm(A, 2) for delay, A, _ in loop.terms if delay))
    return np.asarray(np.arange(1, min(int(4.0 * late / step) + 400, _MOST_NODES // 4)) * step, float)
