"""What the run of each shipped case gives, to the last bit, as one digest a line; `diff` compares two checkouts.

python -m tests.benchmarks.same_bits > before
python -m tests.benchmarks.same_bits > after
"""

from __future__ import annotations

import hashlib
import sys
from typing import Any

import numpy as np

import eppanalysis as epp


def _numbers(run: Any) -> list[Any]:
    """Everything that a run says, in the order in which it says it."""
    cycle = run.limit_cycle
    found: list[Any] = [run.t, *run.signals.values(), run.settled_since, *run.settled_at.values()]
    found += [str(e) for e in run.events] + [run.status.name]
    found += (
        [cycle.period, cycle.state, *cycle.mean.values(), *cycle.peak_to_peak.values()] if cycle is not None else []
    )
    return found


def digest(values: list[Any]) -> str:
    """Digest of numbers, arrays and texts."""
    total = hashlib.sha256()
    for value in values:
        total.update(value.encode() if isinstance(value, str) else np.asarray(value, float).tobytes())
    return total.hexdigest()[:16]


def main() -> None:
    """A line for each shipped case."""
    for name in sorted(epp.shipped_cases()):
        case = epp.case(name)
        system = case.to_system()
        run = epp.simulate(system, case.input, t_end=case.t_end)
        sys.stdout.write(f"{name} {digest(_numbers(run))}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
