"""Stability of a predicted cycle by Nyquist's criterion on measured data."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.describing.quality import Point
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.models.systems.measured.response import MeasuredResponse

#: Share by which an amplitude is moved to either side of a cycle for Nyquist's criterion.
_BESIDE = 0.01
#: How far from a whole number the slope of a response towards low frequencies may be.
_WHOLE = 0.3


def stability_of_data(system: DataSystem, balance: Balance, p: Point) -> tuple[bool | None, str]:
    """Verdict by Nyquist's criterion a little beside the cycle, and the sentence that says by what."""
    if system.only is None:
        return None, "No criterion decides stability with several measured paths, or with states between them."
    more, less = (_unstable_poles(system, balance, p, side * _BESIDE) for side in (1.0, -1.0))
    if more is None or less is None:
        return None, "Nyquist's criterion: the data do not show how the loop gain ends, towards zero or upwards."
    if more < 0 or less < 0:
        return None, "Nyquist's criterion: the measured part must have more unstable poles than given."
    text = (
        f"Nyquist's criterion on the data: with a little more amplitude {more}, with a little less {less} of the poles "
        f"of the quasi-linear loop are unstable, if of the measured part {system.only.unstable_poles or 'none'} are."
    )
    return more == 0, text


def _unstable_poles(system: DataSystem, balance: Balance, p: Point, share: float) -> int | None:
    """Number of unstable poles of the loop with the element as the gain that it is at another amplitude.

    A lag of the element counts as dead time. The curve ``1 + N G`` is closed beyond the data: towards zero by as many
    integrators as its slope shows, upwards by a loop gain below one. None where that is not to be seen.
    """
    gain = _gain_beside(balance, p, share)
    around = np.geomspace(1e-6, 0.3, 40)
    omega = np.concatenate([system.frequency_nodes(), p.omega * (1.0 + around), p.omega * (1.0 - around)])
    low, high = system.band
    omega = np.unique(omega[(omega >= low) & (omega <= high)])
    lag = np.exp(1j * np.angle(gain) * omega / p.omega)
    back = -abs(gain) * lag * system.frequency_response(omega)[:, 0, 0]
    if abs(back[-1]) >= 1.0:
        return None
    turn = np.unwrap(np.angle(1.0 + back))
    start = _start(system, turn, abs(back[0]))
    if start is None:
        return None
    # Above the data the loop gain is below one, and 1 + N G ends at one. Each half turn about zero up to there is a
    # pole less on the right (docs/theory/measured.md, Stability).
    end = 2.0 * np.pi * np.round(turn[-1] / (2.0 * np.pi))
    return _only(system).unstable_poles - round((end - start) / np.pi)


def _only(system: DataSystem) -> MeasuredResponse:
    assert system.only is not None
    return system.only


def _start(system: DataSystem, turn: Array, size: float) -> float | None:
    """Argument, a multiple of pi, of ``1 + N G`` where it leaves the real axis at zero frequency."""
    gain = _only(system).static_gain
    if gain is not None and np.isfinite(gain):
        return float(np.pi * np.round(turn[0] / np.pi))
    value, by_omega = _only(system).with_slope(system.band[0])
    slope = float((system.band[0] * by_omega / value).real)
    if slope > 1.0 - _WHOLE and size < 1.0:
        return float(2.0 * np.pi * np.round(turn[0] / (2.0 * np.pi)))
    # Of k integrators 1 + N G comes from infinity, a quarter turn behind the real axis for each.
    integrators = max(0, round(-slope))
    if abs(slope + integrators) > _WHOLE:
        return None
    return float(np.pi * np.round((turn[0] + 0.5 * np.pi * integrators) / np.pi))


def _gain_beside(balance: Balance, p: Point, share: float) -> complex:
    """Gain of the element with the amplitude changed by a share, and the mean with it."""
    # The balance of the means moves the bias with the amplitude, by the implicit function theorem.
    static = balance.on_bias[0, 0] + balance.on_mean[0, 0] * p.slopes_of_mean[1][0]
    by_amplitude = balance.on_mean[0, 0] * p.slopes_of_mean[0][0]
    bias = -by_amplitude / static if by_amplitude and static else 0.0
    return complex(p.gain[0] + share * (p.slopes_of_gain[0][0] + bias * p.slopes_of_gain[1][0]))
