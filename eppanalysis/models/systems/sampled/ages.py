"""How old what a sampled controller reads straight from another one's hold is.

A hold is late by half a sample in the mean over all times. A controller that reads it straight, with nothing between
that smooths it, does so at its own samples: where the clocks of both come round together, the values that it finds have
a few ages, which come again and again. A controller behind another one in the same program finds them fresh.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.hybrid import cascade, reaching
from eppanalysis.models.systems.lure import LureSystem

#: Samples in one turn of all clocks beyond which they are taken for clocks that never coincide.
_MOST_SAMPLES = 512


def turn_of(times: Sequence[float]) -> float | None:
    """Time after which all clocks of these sample times are as before [s]; None where that is too long."""
    exact = [Fraction(repr(float(t))) for t in times]
    over = math.lcm(*(t.denominator for t in exact))
    turn = Fraction(math.lcm(*(int(t * over) for t in exact)), over)
    return float(turn) if sum(turn / t for t in exact) <= _MOST_SAMPLES else None


@dataclass(frozen=True, eq=False)
class StraightReading:
    """What one controller reads straight of what another one holds, or of what an element makes of that alone."""

    reads: NDArray[np.intp]  # what the reader reads, among the inputs of all elements of the loop
    column: int  # what is read, among their outputs
    gains: Array  # from one to the others
    giver: SampledController  # whose hold it comes from
    ages: Array  # time since the giver's sample at the reader's samples of one turn, one after the other [s]

    def correction(self, omega: NDArray[Any]) -> tuple[ComplexArray, ComplexArray]:
        """What is added to its way, which has the hold as it is at all times, and the derivative by the frequency."""
        hold, falls = self.giver.hold(omega)
        turned = np.exp(-1j * np.asarray(omega)[..., None] * self.ages)
        ratio = turned.mean(-1) / hold
        slope = ((-1j * self.ages * turned).mean(-1) - ratio * falls) / hold
        return (ratio - 1.0)[..., None] * self.gains, slope[..., None] * self.gains


def straight_readings(system: LureSystem) -> Iterator[StraightReading]:
    """All of a loop whose ages are known: of controllers whose clocks come round together."""
    sampled = {i: e for i, e in enumerate(system.elements) if isinstance(e, SampledController)}
    rank = {i: k for k, i in enumerate(cascade(list(sampled), _reach(system)))}
    for column, giver in staircases(system).items():
        for reader, controller in sampled.items():
            z = system.input_slices[reader]
            reads = z.start + np.flatnonzero(system.D[z.start : z.stop - 1, column])
            # One that renews its state behind its outputs finds there what it has just put out.
            fresh = rank[giver] < rank[reader] or (reader == giver and controller.state_last)
            ages = _ages(controller, sampled[giver], fresh) if reads.size else None
            if ages is not None:
                yield StraightReading(reads, column, system.D[reads, column], sampled[giver], ages)


def staircases(system: LureSystem) -> dict[int, int]:
    """Outputs of elements that are one controller's hold or follow it alone, and whose it is."""
    sampled = [i for i, e in enumerate(system.elements) if isinstance(e, SampledController)]
    found = {c: i for i in sampled for c in _columns(system, i)}
    rest = [i for i in range(len(system.elements)) if i not in sampled]
    while rest:
        for i in rest:
            z = system.input_slices[i]
            sources = {found.get(c) for c in np.flatnonzero(np.any(system.D[z], axis=0)).tolist()}
            if len(sources) == 1 and None not in sources and not np.any(system.C[z]):
                (source,) = (s for s in sources if s is not None)
                found |= {c: source for c in _columns(system, i)}
                rest.remove(i)
                break
        else:
            break
    return found


def _columns(system: LureSystem, element: int) -> range:
    w = system.output_slices[element]
    return range(w.start, w.stop)


def _reach(system: LureSystem) -> BoolArray:
    """Which elements (columns) act on which (rows) without any state between, straight or through others."""
    acts = np.array(
        [[bool(np.any(system.D[z, w])) for w in system.output_slices] for z in system.input_slices], dtype=bool
    )
    return reaching(acts, acts)


def _ages(reader: SampledController, giver: SampledController, fresh: bool) -> Array | None:
    """Ages at the reader's samples [s]; None where the clocks never come round together."""
    turn, T = turn_of([reader.sample_time, giver.sample_time]), giver.sample_time
    if turn is None:
        return None
    at = reader.offset + reader.sample_time * np.arange(round(turn / reader.sample_time))
    since = np.round((at - giver.offset - giver.delay) / T % 1.0, 12) % 1.0 * T
    if not (fresh or giver.delay):
        since[since == 0.0] = T  # what is put out at this very instant comes too late
    return giver.delay + since
