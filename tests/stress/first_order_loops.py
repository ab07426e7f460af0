"""Random loops on which first order is put beside the exact search, and what the comparison says."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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


@dataclass(frozen=True)
class Row:
    """One predicted cycle: its estimate, and its true error (nan where no exact cycle is left within a factor of two).

    The error is the largest of those in frequency, in the fundamental and in the peak-to-peak of the loop's first
    signal."""

    loop: str
    number: int
    estimate: float
    error: float

    @property
    def real(self) -> bool:
        """Whether there is an exact cycle."""
        return bool(np.isfinite(self.error))


def compare(system: epp.LureSystem) -> Iterator[Row]:
    """Every predicted cycle beside the exact one that is its own."""
    predicted = epp.predict_limit_cycles(system)
    exact = [*epp.find_limit_cycles(system, predicted=predicted.cycles)]
    exact += [c for c in map(lambda guess: _by_balance(system, guess, exact), predicted) if c is not None]
    partner = _partners(predicted, exact)
    for i, guess in enumerate(predicted):
        error = max(abs(float(np.expm1(v))) for v in _logs(guess, exact[partner[i]])) if i in partner else float("nan")
        yield Row(system.name, i, guess.error_estimate, error)


def _logs(guess: epp.LimitCycle, exact: epp.LimitCycle) -> list[float]:
    """Logarithms of predicted over exact: frequency, fundamental, peak-to-peak."""
    name = next(iter(guess.harmonics))
    pairs = [(c.omega, c.amplitude(name), c.peak_to_peak[name]) for c in (guess, exact)]
    return [float(np.log(a / b)) for a, b in zip(*pairs, strict=True)]


def _apart(guess: epp.LimitCycle, exact: epp.LimitCycle) -> float:
    frequency, _, peak_to_peak = _logs(guess, exact)
    return max(abs(frequency), abs(peak_to_peak))


def _by_balance(
    system: epp.LureSystem, guess: epp.LimitCycle, known: Sequence[epp.LimitCycle]
) -> epp.LimitCycle | None:
    """A cycle that the search has missed: an orbit closed from a balance of many harmonics."""
    if any(c.stable == guess.stable and _apart(guess, c) < 0.05 for c in known):
        return None
    balance = epp.harmonic_balance(system, guess, order=41)
    exact = epp.exact_orbit(system, balance) if balance.status.ok else balance
    new = exact.status.ok and exact.residual < 1e-9 and all(_apart(exact, c) > 1e-5 for c in known)
    return exact if new else None


def _partners(predicted: Sequence[epp.LimitCycle], exact: Sequence[epp.LimitCycle]) -> dict[int, int]:
    """Pairs within a factor of two in frequency and peak-to-peak, nearest and of like stability first; no
    cycle twice.
    """
    pairs = [
        (_apart(guess, cycle) + 0.2 * (guess.stable != cycle.stable), i, k)
        for i, guess in enumerate(predicted)
        for k, cycle in enumerate(exact)
        if _apart(guess, cycle) < np.log(2.0)
    ]
    partner: dict[int, int] = {}
    for _, i, k in sorted(pairs):
        if i not in partner and k not in partner.values():
            partner[i] = k
    return partner
