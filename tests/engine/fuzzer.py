"""Random automata, modes and inputs for the engine: no crash, no endless run, no number that is none without a status.

    python -m tests.engine.fuzzer [--first SEED] [--seconds 20]

Each seed is printed before it is tried, so that the last line names one that crashes or hangs.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.engine.harmonics import answer, settle
from eppanalysis.engine.workspace import STEP_LIMIT
from eppanalysis.errors import EppError
from eppanalysis.methods.harmonic.elements import PeriodicElement
from eppanalysis.methods.simulation.runs import judge, run_hybrid
from eppanalysis.models.elements.automaton import SMOOTH_KINDS, Automaton, AutomatonBuilder, Smooth
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import InputSignal, Ramp, Sine, Step
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.results import Status

#: What a number may be in place of one of order one.
WILD = (0.0, -0.0, 1.0, -1.0, 1e-308, 5e-324, 1e-17, 1e-9, 1e9, 1e17, 1e150, 1e308, -1e300, np.inf, -np.inf, np.nan)
#: Statuses of runs that say that something went wrong.
WENT_WRONG = (Status.DIVERGED, Status.NOT_CONVERGED, Status.EVENT_LIMIT)


class Fuzz:
    """One seed.

    Parameters
    ----------
    seed : int
    """

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        #: Share of numbers that are wild; most seeds have none, and reach what lies behind.
        self.wild = float(self.rng.choice([0.0, 0.0, 0.02, 0.2]))

    def numbers(self, *shape: int, zeros: float = 0.5) -> Any:
        """Numbers of order one, many of them zero and some of them wild."""
        out = np.where(self.rng.random(shape) < zeros, 0.0, np.round(self.rng.normal(size=shape), 2))
        return np.where(self.rng.random(shape) < self.wild, self.rng.choice(WILD, shape), out)

    def automaton(self, n_inputs: int) -> Automaton:
        """Up to four modes, each with a guard or two to any other."""
        rng = self.rng
        n_w, n_h, n_modes = int(rng.integers(1, 3)), int(rng.integers(0, 3)), int(rng.integers(1, 5))
        kinds, n_s = tuple(SMOOTH_KINDS), int(rng.choice([0, 0, 0, 1, 2]))
        smooth = tuple(
            Smooth(str(rng.choice(kinds)), self.numbers(n_inputs, zeros=0.1), float(self.numbers()), 1.0)
            for _ in range(n_s)
        )
        build = AutomatonBuilder(n_inputs, n_w, n_h, smooth)
        sticks = rng.random(n_modes) < 0.15
        for m in range(n_modes):
            build.mode(
                f"mode {m}", self.numbers(n_w, n_inputs), self.numbers(n_w, n_h), self.numbers(n_w, n_s),
                self.numbers(n_w), bool(sticks[m]), float(self.numbers()), float(rng.choice([-1.0, 1.0])),
            )  # fmt: skip
        for m in range(n_modes):
            for _ in range(int(rng.integers(1, 3))):
                target = int(rng.integers(n_modes))
                build.guard(
                    "guard", m, target, self.numbers(n_inputs, zeros=0.2), self.numbers(n_inputs, zeros=0.8),
                    self.numbers(n_h), self.numbers(n_w, zeros=0.8), float(self.numbers()), self.numbers(n_h, n_inputs),
                    self.numbers(n_h, n_h), self.numbers(n_h),
                    int(rng.integers(-1, n_modes)) if sticks[target] else -1,
                    self.numbers(n_inputs) if rng.random() < 0.05 else 0.0,
                )  # fmt: skip
        return build.build(int(rng.integers(n_modes)), self.numbers(n_h))

    def signal(self) -> InputSignal:
        """An input over time."""
        a, b = self.rng.normal(), self.rng.uniform(0.1, 3.0)
        choices = (lambda: Step(a), lambda: Ramp(a), lambda: Sine(a, b))
        return choices[self.rng.integers(len(choices))]()

    def hybrid(self) -> HybridSystem:
        """A loop of up to three automata, or one whose tables were filled with wild numbers afterwards."""
        rng = self.rng
        elements = [AutomatonElement(self.automaton(int(rng.integers(1, 3)))) for _ in range(int(rng.integers(1, 4)))]
        n = int(rng.choice([1, 2, 3, 5, 20]))
        n_z, n_w = sum(e.n_inputs for e in elements), sum(e.n_outputs for e in elements)
        delays = np.where(rng.random(n_w) < 0.5, 0.0, rng.uniform(0.0, 1.0, n_w)) if rng.random() < 0.15 else None
        system = LureSystem.build(
            self.numbers(n, n) - np.eye(n), self.numbers(n, n_w), self.numbers(n_z, n), elements,
            D=self.numbers(n_z, n_w, zeros=0.8) if rng.random() < 0.3 else None, B_input=self.numbers(n, 1),
            input_names=("u",), x0=self.numbers(n), delays=delays,
        )  # fmt: skip
        hybrid = HybridSystem.from_lure(system, {"u": self.signal()})
        if not self.wild:
            return hybrid
        tables = {name: self.spoiled(a) for name, a in hybrid.model._asdict().items() if a.dtype.kind == "f"}
        return replace(hybrid, model=hybrid.model._replace(**tables))

    def spoiled(self, table: Array) -> Array:
        """A table, with a wild number now and then."""
        return np.where(self.rng.random(table.shape) < 0.05 * self.wild, self.rng.choice(WILD, table.shape), table)


def run(fuzz: Fuzz) -> str:
    """A run of a loop; how it ended."""
    hybrid, t_end = fuzz.hybrid(), float(fuzz.rng.choice([0.5, 5.0, 60.0]))
    times = np.sort(fuzz.rng.uniform(0.0, t_end, int(fuzz.rng.choice([0, 1, 50]))))
    base = 2.0 * hybrid.time_scale if np.isfinite(hybrid.time_scale) else 0.1
    found = run_hybrid(hybrid, t_end, times, base, 300, int(fuzz.rng.choice([1, 300])), 2_000)
    status, _ = judge(hybrid, found, t_end)
    looked_at = [found.x_end, found.time[: found.n_kept]]
    if not fuzz.wild:  # a signal with a weight of 1e308 is beyond all numbers where the states are not
        looked_at.append(found.samples[: int(found.stats[2])])
    sound = all(np.all(np.isfinite(a)) for a in looked_at)
    assert sound or status in WENT_WRONG, f"a run with numbers that are none ended with {status}, code {found.code}"
    return "steps used up" if found.code == STEP_LIMIT else status.name.lower()


def describe(fuzz: Fuzz) -> str:
    """Describing functions of an automaton: finite, or none at all."""
    element = AutomatonElement(fuzz.automaton(int(fuzz.rng.integers(1, 3))))
    points = np.abs(fuzz.numbers(6, zeros=0.1)), fuzz.numbers(6), np.abs(fuzz.numbers(6, zeros=0.0)) + 0.1
    mean, gain = element.describing_function(*points)
    assert mean.shape == gain.shape
    return "described" if np.all(np.isfinite(gain)) else "not described"


def answer_series(fuzz: Fuzz) -> str:
    """What an automaton makes of a Fourier series: a regime of finite numbers, or a count that says there is none."""
    element = PeriodicElement(AutomatonElement(fuzz.automaton(1)), ("free",))
    n = int(fuzz.rng.integers(1, 8))
    Z = (fuzz.numbers(1, n + 1) + 1j * fuzz.numbers(1, n + 1)).astype(complex)
    Z[:, 0] = Z[:, 0].real
    omega = float(abs(fuzz.numbers()) + 0.1)
    asked = element.asked(Z, omega)
    count, *_ = settle(*asked)
    if count < 0 or element.smooth:
        return "no regime" if count < 0 else "curved"
    _, pieces, sums = answer(*asked)
    finite = all(np.all(np.isfinite(a)) for a in (Z, *[t for t in element.table if t.dtype.kind == "f"]))
    assert not finite or fuzz.wild or all(np.all(np.isfinite(a)) for a in (pieces.edges, *sums))
    return "regime"


#: What is tried, and how often.
TRIED = (run, run, run, describe, answer_series)


def tried(seed: int) -> str:
    """What came of a seed."""
    fuzz = Fuzz(seed)
    what = TRIED[seed % len(TRIED)]
    try:
        return f"{what.__name__}: {what(fuzz)}"
    except EppError as error:
        return f"{what.__name__}: refused, {type(error).__name__}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--count", type=int, default=10**9)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    found: Counter[str] = Counter()
    end, seed, slowest = time.process_time() + asked.seconds, asked.first, (0.0, 0)
    while time.process_time() < end and seed < asked.first + asked.count:
        print(seed, end=" ", file=sys.stderr, flush=True)
        start = time.process_time()
        found[tried(seed)] += 1
        slowest = max(slowest, (time.process_time() - start, seed))
        seed += 1
    print(f"seeds {asked.first} to {seed - 1}, the slowest {slowest[1]} ({slowest[0]:.2f} s)")
    for what, count in sorted(found.items()):
        print(f"{count:6d} {what}")


if __name__ == "__main__":
    main()
