"""Estimated against true errors of harmonic balance on shipped loops; the truth is what shooting closes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

import eppanalysis as epp
from eppanalysis.methods.harmonic.balance import harmonic_balance
from eppanalysis.methods.harmonic.loop import Loop, inputs_of

#: Order from which shooting starts, beside the prediction itself.
HIGH = 25


@dataclass(frozen=True)
class Entry:
    """One balance: order, estimate (nan: it says that it cannot), distance to the nearest exact orbit (inf: none)."""

    order: int
    estimate: float
    error: float

    @property
    def covered(self) -> bool:
        """Whether the estimate is no less than the error."""
        return self.estimate >= self.error


def entries(name: str, orders: Sequence[int]) -> list[Entry]:
    """All converged balances of a shipped loop at some orders, from each of its predictions."""
    system = epp.case(name).to_system()
    predicted = list(epp.predict_limit_cycles(system))
    loop = Loop.of(system, system.v0)

    def place(cycle: epp.LimitCycle) -> np.ndarray:
        return np.append(np.abs(inputs_of(loop, cycle)[:, 1]), cycle.omega)

    balances = [harmonic_balance(system, guess, n) for guess in predicted for n in orders]
    starts = predicted + [harmonic_balance(system, guess, HIGH) for guess in predicted]
    exact = [place(o) for o in (epp.exact_orbit(system, s) for s in starts) if o.status.ok]
    return [
        Entry(
            order=b.provenance.statistics["order"],
            estimate=b.error_estimate,
            error=min((float(np.abs(place(b) / e - 1.0).max()) for e in exact), default=np.inf),
        )
        for b in balances
        if b.status.ok
    ]


def share_covered(found: Iterable[Entry]) -> float:
    """Of the balances that give an estimate, how many it covers."""
    given = [e for e in found if np.isfinite(e.estimate)]
    return float(np.mean([e.covered for e in given])) if given else 1.0
