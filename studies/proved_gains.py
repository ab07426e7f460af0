"""Between which gains nothing is proved of servos with play: proved free up to the one, proved to cycle from the other.

One certificate of absence holds for all gains from a tenth of the onset on. Each gain is that of a certificate, with
the digits that are shown. Run it: ``python -m studies.proved_gains``. It takes some minutes, so that its result is kept
in ``_static/proved_gains.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.results import PlainData
from studies import STORED

__all__ = ["LOOPS", "ProvedGains", "proved_gains", "servo", "table"]

RESULT = STORED / "proved_gains.md"
#: What is beside the gain: numerator and denominator of L(s)/k.
LOOPS: dict[str, tuple[list[float], list[float]]] = {
    "k/(s(s+1))": ([1.0], [1.0, 1.0, 0.0]),
    "k(0.1s+1)/(s(s+1))": ([0.1, 1.0], [1.0, 1.0, 0.0]),
    "k/(s(s+1)(0.05s+1))": ([1.0], [0.05, 1.05, 1.0, 0.0]),
    "k/(s(s+1)(0.2s+1))": ([1.0], [0.2, 1.2, 1.0, 0.0]),
    "k/(s(0.1s+1)(0.2s+1))": ([1.0], [0.02, 0.3, 1.0, 0.0]),
    "k/(s(s+1)^2)": ([1.0], [1.0, 2.0, 1.0, 0.0]),
    "k(0.1s+1)/(s(s+1)(0.2s+1))": ([0.1, 1.0], [0.2, 1.2, 1.0, 0.0]),
    "k(0.3s+1)/(s(s+1)(0.2s+1))": ([0.3, 1.0], [0.2, 1.2, 1.0, 0.0]),
    "k(0.5s+1)/(s(s+1)(0.2s+1))": ([0.5, 1.0], [0.2, 1.2, 1.0, 0.0]),
    "k(1-0.1s)/(s(s+1)(0.2s+1))": ([-0.1, 1.0], [0.2, 1.2, 1.0, 0.0]),
}
#: Gains tried upward for a first cycle; significant digits of a gain; how near the bisection goes, relative to it.
_UPWARD, _DIGITS, _NEAR = 1.3, 5, 1e-3
#: Shares of the least gain with a cycle from which, and up to which in turn, absence is tried.
_FROM, _BELOW = 0.1, (0.995, 0.99, 0.985, 0.98, 0.97, 0.95, 0.9, 0.8)
_SECTORS = 48
#: Where the first runs begin, beyond the gap, and their length [s].
_FAR, _LENGTH = 30.0, 2000.0


@dataclass(frozen=True)
class ProvedGains(PlainData):
    """One loop.

    Attributes
    ----------
    loop : str
    start, free, cycle : float
        From where to where absence of cycles is proved, and the smallest gain at which a cycle is.
    sectors : int
        Of the function that falls.
    period : float
        Of the cycle [s].
    """

    loop: str
    start: float
    free: float
    cycle: float
    sectors: int
    period: float

    @property
    def gap(self) -> float:
        """Between the two, relative to their mean."""
        return 2.0 * (self.cycle - self.free) / (self.cycle + self.free)


def servo(name: str, gain: float) -> epp.LureSystem:
    """A loop of the table with a play of 1."""
    num, den = LOOPS[name]
    return epp.LureSystem.from_tf(([float(f"{gain * c:.12g}") for c in num], den), epp.Play(gap=1.0), name="servo")


def proved_gains(name: str) -> ProvedGains:
    """The two gains of a loop: the one by bisection, the other at shares of it."""
    gain, free, known = 0.3, 0.3, dict[float, epp.LimitCycle]()

    def cycles(at: float) -> bool:
        loop = servo(name, at)
        near = known[min(known)] if known else None
        start = np.full(loop.A.shape[0], _FAR) if near is None else near.state
        found = _cycle_from(replace(loop, x0=start, memory=loop.memory if near is None else near.memory))
        if found is not None:
            known[at] = found
        return found is not None

    while not cycles(gain):
        free, gain = gain, _shown(_UPWARD * gain)
    cycle = _last(gain, free, cycles)
    case, start = epp.Case.from_system(servo(name, 1.0)), _shown(_FROM * cycle)
    for share in _BELOW:
        free = _shown(share * cycle)
        proof = epp.certify(case, "absence", within={"loop.gain": (start, free)}, sectors=_SECTORS)
        if proof.proved:
            return ProvedGains(name, start, free, cycle, proof.document["claim"]["sectors"], known[cycle].period)
    return ProvedGains(name, float("nan"), float("nan"), cycle, 0, known[cycle].period)


def _last(holds_at: float, beyond: float, holds: Callable[[float], bool]) -> float:
    """The gain nearest to another at which something holds that holds at the first."""
    kept = _shown(holds_at)
    while abs(beyond - kept) > _NEAR * kept:
        middle = _shown(0.5 * (kept + beyond))
        kept, beyond = (middle, beyond) if holds(middle) else (kept, middle)
    return kept


def _shown(gain: float) -> float:
    return float(f"{gain:.{_DIGITS}g}")


def _cycle_from(loop: epp.LureSystem) -> epp.LimitCycle | None:
    """The proved cycle that a run ends on, if it ends on one and that is proved."""
    run = epp.simulate(loop, t_end=_LENGTH)
    if run.limit_cycle is None:
        return None
    try:
        orbit = epp.exact_orbit(loop, run.limit_cycle)
        return orbit if epp.certify_orbit(loop, orbit).proved else None
    except EppError:
        return None


def table(found: tuple[ProvedGains, ...]) -> str:
    """The loops in Markdown."""
    lines = [
        "| L(s) | one proof of absence for k | proved to cycle from | apart | sectors | period of the cycle [s] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for r in found:
        ends = f"{r.start:.5g} to {r.free:.5g} | {r.cycle:.5g} | {100.0 * r.gap:.2f} %"
        lines.append(f"| {r.loop} | {ends} | {r.sectors} | {r.period:.4g} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    RESULT.write_text(table(tuple(map(proved_gains, LOOPS))), encoding="utf-8")
