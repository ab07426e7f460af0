"""How good first order is: random loops of known kind, their predicted cycles and the exact ones, to a table.

``python -m studies.first_order`` makes ``docs/_static/first_order.csv`` afresh (some tens of minutes). Each loop has
a number, from which it is made again: ``random_loop("play", 7)``.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import eppanalysis as epp
from studies import STORED
from studies.stored_tables import read_rows, write_rows

TABLE = STORED / "first_order.csv"
LOOPS_PER_ELEMENT = 60

Maker = Callable[[np.random.Generator], epp.Nonlinearity]
#: Elements whose threshold, half gap or limit is one, so that an amplitude is an amplitude over the gap.
ELEMENTS: dict[str, Maker] = {
    "relay": lambda rng: epp.Relay(),
    "relay with dead zone": lambda rng: epp.RelayDeadZone(threshold=1.0),
    "hysteresis relay": lambda rng: epp.HysteresisRelay(lower=-1.0, upper=1.0),
    "hysteresis relay with dead zone": lambda rng: epp.HysteresisRelayDeadZone(on=1.0, off=rng.uniform(0.2, 0.95)),
    "saturation": lambda rng: epp.Saturation(),
    "dead zone": lambda rng: epp.DeadZone(),
    "dead zone with saturation": lambda rng: epp.DeadZoneSaturation(1.0, 1.0, float(rng.uniform(0.5, 3.0))),
    "preload": lambda rng: epp.Preload(level=1.0, slope=1.0),
    "play": lambda rng: epp.Play(gap=2.0),
    "jump and follow": lambda rng: _jump_and_follow(float(rng.uniform(0.1, 1.0))),
    "quantiser": lambda rng: epp.Quantiser(step=2.0, levels=30),
}


def _jump_and_follow(share: float) -> epp.Nonlinearity:
    """Stick band and jump that together are two: the input must move by more than one."""
    return epp.JumpAndFollow(stick_band=2.0 / (1.0 + share), slip_jump=2.0 * share / (1.0 + share))


@dataclass(frozen=True)
class Row:
    """One predicted cycle of one loop beside the exact cycle that it leads to (nan where there is none)."""

    element: str
    number: int
    poles: int
    relative_degree: int
    integrators: int
    ratio: float
    stable: bool
    exact_stable: str
    omega: float
    estimate: float
    content: float
    error_frequency: float
    error_amplitude: float
    error_peak_to_peak: float

    @property
    def exists(self) -> bool:
        """Whether there is an exact cycle."""
        return bool(np.isfinite(self.error_frequency))

    @property
    def error(self) -> float:
        """The largest of the errors in frequency, fundamental and size, which the estimate is of."""
        return max(self.error_frequency, self.error_amplitude, self.error_peak_to_peak)


def random_plant(rng: np.random.Generator) -> tuple[list[float], list[float], int]:
    """Numerator and denominator of a stable low-pass with up to two zeros, and its number of integrators."""
    order = int(rng.integers(2, 7))
    n_zeros = min(int(rng.integers(0, 3)), order - 1)
    integrators = int(rng.random() < 0.4)
    poles = np.array([1.0] + [0.0] * integrators)
    while poles.size - 1 < order:
        speed = float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
        pair = order - (poles.size - 1) >= 2 and rng.random() < 0.5
        factor = [1.0, 2.0 * rng.uniform(0.15, 1.0) * speed, speed**2] if pair else [1.0, speed]
        poles = np.polymul(poles, factor)
    zeros = np.array([1.0])
    for _ in range(n_zeros):
        zeros = np.polymul(zeros, [1.0, float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))])
    return zeros.tolist(), poles.tolist(), integrators


def random_loop(element: str, number: int) -> tuple[epp.LureSystem, float, tuple[int, int, int]]:
    """The loop of a number, the amplitude it was made for, and poles, relative degree and integrators of its plant.

    An amplitude between 1.05 and 12 thresholds is drawn, and the gain is set such that first order has a cycle there.
    """
    rng = np.random.default_rng([zlib.crc32(element.encode()), number])
    while True:
        part = ELEMENTS[element](rng)
        zeros, poles, integrators = random_plant(rng)
        amplitude = float(np.exp(rng.uniform(np.log(1.05), np.log(12.0))))
        gain = complex(np.asarray(part.describing_function(amplitude)[1]).ravel()[0])
        omega = np.geomspace(0.01, 100.0, 20001)
        loop = gain * np.polyval(zeros, 1j * omega) / np.polyval(poles, 1j * omega)
        phase = np.angle(-loop)
        crossings = np.flatnonzero((phase[1:] * phase[:-1] <= 0) & (np.abs(phase[1:] - phase[:-1]) < 1.0))
        if crossings.size:
            k = 1.0 / abs(loop[crossings[0]])
            system = epp.LureSystem.from_tf((list(k * np.array(zeros)), poles), part, name=f"{element} {number}")
            return system, amplitude, (len(poles) - 1, len(poles) - len(zeros), integrators)


def rows_of(element: str, number: int) -> Iterator[Row]:
    """The two predicted cycles of a loop that are nearest to the amplitude it was made for (mostly there is one)."""
    system, wanted, plant = random_loop(element, number)
    taken: list[float] = []
    predicted = sorted(epp.predict_limit_cycles(system), key=lambda c: abs(np.log(c.amplitude("x") / wanted)))
    for guess in sorted(predicted[:2], key=lambda c: c.error_estimate):
        exact = exact_cycle(system, guess, taken)
        errors = [float("nan")] * 3
        if exact is not None:
            taken.append(exact.peak_to_peak["x"])
            errors = [
                abs(guess.omega / exact.omega - 1.0),
                abs(guess.amplitude("x") / exact.amplitude("x") - 1.0),
                abs(guess.peak_to_peak["x"] / exact.peak_to_peak["x"] - 1.0),
            ]
        yield Row(
            element, number, *plant, guess.amplitude("x"), bool(guess.stable),
            "" if exact is None else str(exact.stable), guess.omega, guess.error_estimate,
            guess.harmonic_content, *errors,
        )  # fmt: skip


def exact_cycle(system: epp.LureSystem, guess: epp.LimitCycle, taken: Sequence[float]) -> epp.LimitCycle | None:
    """The exact cycle that a predicted one leads to, within a factor of two; None when there is none (left)."""
    found = [epp.exact_orbit(system, guess)]
    if not any(_belongs(guess, c, taken) for c in found):
        found += list(epp.find_limit_cycles(system))
    near = [c for c in found if _belongs(guess, c, taken)]
    return min(near, key=lambda c: (c.stable != guess.stable, _apart(guess, c)), default=None)


def _apart(guess: epp.LimitCycle, exact: epp.LimitCycle) -> float:
    ratios = guess.omega / exact.omega, guess.peak_to_peak["x"] / exact.peak_to_peak["x"]
    return float(max(abs(np.log(r)) for r in ratios))


def _belongs(guess: epp.LimitCycle, exact: epp.LimitCycle, taken: Sequence[float]) -> bool:
    new = all(abs(exact.peak_to_peak["x"] / size - 1.0) > 1e-6 for size in taken)
    return exact.status.ok and new and _apart(guess, exact) < np.log(2.0)


def study() -> Iterator[Row]:
    """All rows, element by element."""
    for element in ELEMENTS:
        for number in range(LOOPS_PER_ELEMENT):
            yield from rows_of(element, number)


def write(rows: Sequence[Row], path: Path = TABLE) -> None:
    """Rows to the stored table."""
    write_rows(rows, Row, path, __file__)


def read(path: Path = TABLE) -> list[Row]:
    """Rows of the stored table."""
    return read_rows(Row, path)


if __name__ == "__main__":
    write(list(study()))
