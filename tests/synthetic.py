"""Results made by hand, for the tests of what draws and writes them."""

from __future__ import annotations

import numpy as np

from eppanalysis.results import Event, LimitCycle, Prediction, Status, Trajectory

UNITS = {"theta": "rad", "voltage": "V"}


def cycle(frequency: float = 2.0, amplitude: float = 0.05, stable: bool | None = True) -> LimitCycle:
    """A cycle known by its harmonics only, as a describing function predicts it."""
    return LimitCycle(
        method="describing function",
        status=Status.CONVERGED,
        period=1.0 / frequency,
        mean={"theta": 0.8, "voltage": 0.0},
        peak_to_peak={"theta": 2 * amplitude, "voltage": 16.0},
        harmonics={"theta": np.array([0.8, amplitude]), "voltage": np.array([0.0, -8.0j])},
        stable=stable,
        units=UNITS,
        events=(Event(0.1, "lock_pin", "contact lost", "free"),),
    )


def trajectory(status: Status = Status.LIMIT_CYCLE) -> Trajectory:
    """Two seconds of a sine, steady from 0.5 s on."""
    t = np.linspace(0.0, 2.0, 201)
    signals = {"theta": 0.8 + 0.05 * np.cos(4 * np.pi * t), "voltage": 8.0 * np.sin(4 * np.pi * t)}
    events = (Event(0.3, "lock_pin", "contact lost", "free"), Event(0.6, "lock_pin", "contact", "upper"))
    steady = cycle() if status is Status.LIMIT_CYCLE else None
    rest = {"theta": 0.8, "voltage": 0.0} if status is Status.SETTLED else {}
    return Trajectory(t, signals, events, status, steady, rest, 0.5, UNITS)


def prediction(n: int = 2) -> Prediction:
    """Relay with dead zone (threshold 1, level 1) around 5/(s (s + 1)^2): cycles at amplitudes 1.0606 and 3.0012."""
    omega = np.logspace(-2, 2, 400)
    response = 5.0 / (1j * omega * (1j * omega + 1.0) ** 2)
    amplitude = 1.0 + np.logspace(-4, 2, 400)
    gain = 4.0 / (np.pi * amplitude) * np.sqrt(1.0 - amplitude**-2.0)
    both = (cycle(1 / (2 * np.pi), 1.0606, False), cycle(1 / (2 * np.pi), 3.0012, True))
    curves = {
        "kind": "nyquist",
        "omega": omega,
        "response": response,
        "amplitude": amplitude,
        "locus": -1.0 / gain + 0j,
        "intersections": [{"omega": 1.0, "amplitude": c.amplitude("theta"), "value": -2.5 + 0j} for c in both[:n]],
    }
    return Prediction(both[:n], Status.CONVERGED, "by hand", curves, {"gain_margin": 0.4})


def prediction_of_several() -> Prediction:
    """A loop with two elements: loop gain 3 a exp(-a), which is one at two amplitudes."""
    amplitude = np.linspace(0.1, 5.0, 200)
    branch = {"amplitude": amplitude, "omega": np.full(200, 2.0), "loop_gain": 3.0 * amplitude * np.exp(-amplitude)}
    meets = [{"amplitude": 0.619061, "omega": 2.0}, {"amplitude": 1.512135, "omega": 2.0}]
    curves = {"kind": "residual", "element": "play", "branches": [branch], "intersections": meets}
    both = (cycle(2.0, 0.619061, False), cycle(2.0, 1.512135, True))
    return Prediction(both, Status.CONVERGED, "by hand", curves)
