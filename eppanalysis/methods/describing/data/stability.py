"""Stability of a predicted cycle by Nyquist's criterion on measured data."""

from __future__ import annotations

import numpy as np

from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.describing.quality import Point
from eppanalysis.methods.margins.measured import unstable_poles
from eppanalysis.models.systems.measured.loop import DataSystem

#: Share by which an amplitude is moved to either side of a cycle for Nyquist's criterion.
_BESIDE = 0.01


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

    A lag of the element counts as dead time.
    """
    gain = _gain_beside(balance, p, share)
    around = np.geomspace(1e-6, 0.3, 40)
    omega = np.concatenate([system.frequency_nodes(), p.omega * (1.0 + around), p.omega * (1.0 - around)])
    low, high = system.band
    omega = np.unique(omega[(omega >= low) & (omega <= high)])
    lag = np.exp(1j * np.angle(gain) * omega / p.omega)
    assert system.only is not None
    return unstable_poles(system.only, -abs(gain) * lag * system.frequency_response(omega)[:, 0, 0])


def _gain_beside(balance: Balance, p: Point, share: float) -> complex:
    """Gain of the element with the amplitude changed by a share, and the mean with it."""
    # The balance of the means moves the bias with the amplitude, by the implicit function theorem.
    static = balance.on_bias[0, 0] + balance.on_mean[0, 0] * p.slopes_of_mean[1][0]
    by_amplitude = balance.on_mean[0, 0] * p.slopes_of_mean[0][0]
    bias = -by_amplitude / static if by_amplitude and static else 0.0
    return complex(p.gain[0] + share * (p.slopes_of_gain[0][0] + bias * p.slopes_of_gain[1][0]))
