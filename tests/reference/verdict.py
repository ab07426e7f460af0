"""Whether a sampled motion settles or oscillates, and its period."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

Array = NDArray[np.float64]

#: Below this peak-to-peak the motion counts as settled [rad].
AT_REST = math.radians(0.02)


def judge(t: Array, theta: Array, theta_dot: Array, window: float = 1.0) -> tuple[str, float, float]:
    """Verdict, peak-to-peak and period of theta over the last `window` seconds.

    It oscillates when the last window has more than 0.02 degrees peak to peak and at least 95 % of the window before;
    it settles when it has less than 0.02 degrees. The period is the mean time between upward passages of the middle.
    """
    if t[-1] < 2.0 * window:
        return "undecided", float(np.ptp(theta)), float("nan")
    last, before = t >= t[-1] - window, (t >= t[-1] - 2.0 * window) & (t < t[-1] - window)
    spline = CubicHermiteSpline(t[last], theta[last], theta_dot[last])
    turns = spline.derivative().roots(extrapolate=False)
    # A constant piece (at rest) reports nan among its roots.
    extremes = np.concatenate([theta[last], spline(turns[np.isfinite(turns)])])
    peak_to_peak = float(np.ptp(extremes))
    if peak_to_peak < AT_REST:
        return "settle", peak_to_peak, float("nan")
    if peak_to_peak < 0.95 * np.ptp(theta[before]):
        return "undecided", peak_to_peak, float("nan")
    middle = float(extremes.max() + extremes.min()) / 2.0
    return "oscillate", peak_to_peak, _period(spline, theta[last], middle)


def _period(spline: CubicHermiteSpline, theta: Array, middle: float) -> float:
    """Mean time between upward passages of `middle` that come after a clear low."""
    t, peak_to_peak = spline.x, np.ptp(theta)
    crossings: list[float] = []
    was_low = False
    roots = [float(r) for r in spline.solve(middle, extrapolate=False)]
    for i, r in enumerate(roots):
        # A passage counts once the motion has been well below the middle since the one before.
        start = roots[i - 1] if i else t[0]
        was_low = was_low or bool(np.any(theta[(t >= start) & (t <= r)] < middle - 0.2 * peak_to_peak))
        if was_low and spline(r, 1) > 0.0:
            crossings.append(r)
            was_low = False
    return float(np.mean(np.diff(crossings))) if len(crossings) > 1 else float("nan")
