"""Every exact orbit that is listed behind a dead time exists: a relay that hears the response to its own wave makes it.

The witness is the periodic response of the plant to the listed wave in closed form (matrix exponentials), and the relay
itself, switched along it by its thresholds: it must switch where the orbit says, and nowhere else.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp

#: Samples of each stretch of the response: a crossing is seen to within one of them.
SAMPLES = 2000
#: Natural frequency, damping ratio, dead time, thresholds and levels of plants that ring within the dead time.
RINGING = [
    (3.0, 0.05 / 3.0, 3.0, (-0.02, 0.03), (-0.4, 1.0)),
    (0.9449, 0.0122, 3.997, (-0.0687, 0.0311), (-0.6045, 0.9819)),
    (3.591, 0.0108, 2.9177, (-0.0101, 0.0553), (-0.6057, 0.4423)),
]


def _random(seed: int) -> tuple[float, float, float, tuple[float, float], tuple[float, float]]:
    rng = np.random.default_rng(seed)
    lower, upper = -rng.uniform(0.01, 0.1), rng.uniform(0.01, 0.1)
    return (
        rng.uniform(0.5, 4.0), rng.uniform(0.01, 0.3), rng.uniform(0.5, 4.0), (lower, upper),
        (-rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0)),
    )  # fmt: skip


def _loop(omega: float, damping: float, delay: float, thresholds: tuple[float, float], levels: tuple[float, float]):
    relay = epp.HysteresisRelay(lower=thresholds[0], upper=thresholds[1], low=levels[0], high=levels[1])
    return epp.LureSystem.from_tf(([2.0], [1.0, 2.0 * damping * omega, omega**2]), relay, delay=delay)


def _response(loop: epp.LureSystem, switches: list[tuple[float, float]], T: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and input of the relay over one period, for its wave: (time, value from then on) of each switch."""
    delay, n = float(loop.delays[0]), len(loop.A)
    arrivals = sorted(((t + delay) % T, value) for t, value in switches)
    marks = np.array([0.0, *(t for t, _ in arrivals), T])
    values = [arrivals[-1][1], *(value for _, value in arrivals)]

    def step(value: float, time: float) -> np.ndarray:
        drive = (loop.B[:, 0] * value + loop.constant_state)[:, None]
        return expm(np.block([[loop.A, drive], [np.zeros((1, n + 1))]]) * time)

    over = np.eye(n + 1)
    for value, time in zip(values, np.diff(marks), strict=True):
        over = step(value, time) @ over
    x = np.append(np.linalg.solve(np.eye(n) - over[:n, :n], over[:n, n]), 1.0)
    t, z = [], []
    for value, begin, end in zip(values, marks, marks[1:], strict=False):
        one = step(value, (end - begin) / SAMPLES)
        for k in range(SAMPLES):
            t.append(begin + k * (end - begin) / SAMPLES)
            z.append(float(loop.C[0] @ x[:n] + loop.constant_input[0]))
            x = one @ x
    return np.array(t), np.array(z)


def _heard(t: np.ndarray, z: np.ndarray, relay: epp.HysteresisRelay) -> list[tuple[float, float]]:
    """Where a relay switches along a periodic input, in its second period."""
    state, seen = relay.low, []
    for turn in range(2):
        for time, value in zip(t, z, strict=True):
            new = relay.high if value >= relay.upper else relay.low if value <= relay.lower else state
            if new != state and turn == 1:
                seen.append((float(time), new))
            state = new
    return seen


@pytest.mark.parametrize(
    "numbers",
    [
        *RINGING[:2],
        *(pytest.param(given, marks=pytest.mark.slow) for given in (RINGING[2], *map(_random, range(5)))),
    ],
)
def test_a_relay_that_hears_the_response_to_a_listed_orbit_switches_as_it_says(numbers):
    loop = _loop(*numbers)
    relay, found = loop.elements[0], epp.find_limit_cycles(loop)
    for cycle in found:
        T = cycle.period
        said = sorted((e.time % T, relay.high if e.mode == "high" else relay.low) for e in cycle.events)
        t, z = _response(loop, said, T)
        heard = _heard(t, z, relay)
        assert len(heard) == len(said), f"period {T:.6g}"
        # A switch at the end of the period may be heard at its begin.
        turn = min(range(len(said)), key=lambda k: abs((heard[k][0] - said[0][0] + T / 2) % T - T / 2))
        for (time, value), (at, level) in zip(heard[turn:] + heard[:turn], said, strict=True):
            assert value == level
            assert abs((time - at + T / 2) % T - T / 2) < 3.0 * T / SAMPLES
    # What the loop's own run is on is among them.
    run = epp.simulate(loop, t_end=400.0)
    if run.limit_cycle is not None:
        assert any(c.period == pytest.approx(run.limit_cycle.period, rel=1e-6) for c in found.stable)
