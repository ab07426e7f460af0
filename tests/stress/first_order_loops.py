"""Random loops on which first order is put beside the exact search, and what the comparison says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import eppanalysis as epp

Maker = Callable[[np.random.Generator], epp.Nonlinearity]
#: Elements of one input whose threshold, half gap, step or limit is one.
ELEMENTS: dict[str, Maker] = {
    "relay": lambda rng: epp.Relay(),
    "relay with dead zone": lambda rng: epp.RelayDeadZone(threshold=1.0),
    "saturation": lambda rng: epp.Saturation(),
    "dead zone": lambda rng: epp.DeadZone(),
    "hysteresis relay": lambda rng: epp.HysteresisRelay(lower=-1.0, upper=1.0),
    "play": lambda rng: epp.Play(gap=2.0),
    "quantiser": lambda rng: epp.Quantiser(step=2.0, levels=int(rng.integers(2, 25))),
    "preload": lambda rng: epp.Preload(level=1.0, slope=float(rng.uniform(0.2, 1.0))),
}
FAMILIES = (*ELEMENTS, "two elements")


def random_loop(seed: int) -> epp.LureSystem:
    """The loop of a seed, the same for ever; its family is ``FAMILIES[seed % 9]``."""
    rng = np.random.default_rng([20261122, seed])
    family = FAMILIES[seed % len(FAMILIES)]
    name = f"{family}, seed {seed}"
    while True:
        if family == "two elements":
            parts = [ELEMENTS[k](rng) for k in rng.choice(list(ELEMENTS), 2)]
            plants = [random_plant(rng, int(rng.integers(1, 4))) for _ in parts]
            size = np.exp(rng.uniform(np.log(0.8), np.log(8.0)))
        else:
            parts = [ELEMENTS[family](rng)]
            plants = [random_plant(rng, int(rng.integers(2, 7)))]
            amplitude = float(np.exp(rng.uniform(np.log(1.02), np.log(12.0))))
            size = 1.0 / abs(complex(np.asarray(parts[0].describing_function(amplitude)[1]).ravel()[0]))
            size *= np.exp(rng.uniform(-0.5, 0.5)) if rng.random() < 0.3 else 1.0
        turn = np.angle(complex(np.asarray(parts[0].describing_function(2.0)[1]).ravel()[0]))
        gain = _gain_at_half_turn(plants, turn)
        if gain is not None:
            num, den = plants[0]
            plants[0] = (size / gain * num, den)
            blocks = [b for pair in zip(parts, plants, strict=True) for b in pair]
            return epp.LureSystem.from_blocks(blocks, name=name)


def random_plant(rng: np.random.Generator, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator: poles real, in pairs (damping from 0.03) or at zero; zeros on either side."""
    poles = np.array([1.0, 0.0]) if rng.random() < 0.4 else np.array([1.0])
    while poles.size - 1 < order:
        speed = float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
        pair = order - (poles.size - 1) >= 2 and rng.random() < 0.5
        damping = float(np.exp(rng.uniform(np.log(0.03), 0.0)))
        poles = np.polymul(poles, [1.0, 2.0 * damping * speed, speed**2] if pair else [1.0, speed])
    zeros = np.array([1.0])
    for _ in range(min(int(rng.integers(0, 3)), order - 1)):
        place = float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))
        zeros = np.polymul(zeros, [-1.0 / place if rng.random() < 0.35 else 1.0 / place, 1.0])
    return zeros, poles


def _gain_at_half_turn(plants: list[tuple[np.ndarray, np.ndarray]], turn: float) -> float | None:
    """Gain of all plants together where their phase and `turn` make half a turn; None where that is nowhere."""
    s = 1j * np.geomspace(0.02, 50.0, 4001)
    loop = np.exp(1j * turn) * np.prod([np.polyval(num, s) / np.polyval(den, s) for num, den in plants], axis=0)
    phase = np.angle(-loop)
    at = np.flatnonzero((phase[1:] * phase[:-1] <= 0) & (np.abs(phase[1:] - phase[:-1]) < 1.0))
    return float(abs(loop[at[0]])) if at.size else None
