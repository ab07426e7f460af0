"""What run, prediction and search of each shipped case give, to the last bit; `diff` compares two checkouts.

python -m benchmarks.same_bits > before
python -m benchmarks.same_bits > after

A line has the case with the digests of its run, of its prediction, and, of a case whose elements are few and fast, of
its search for limit cycles.
"""

from __future__ import annotations

import hashlib
import sys
from typing import Any

import numpy as np

import eppanalysis as epp

#: Cases whose search takes some seconds at most.
SEARCHED = (
    "backlash_servo_unseen",
    "band_two_cycles",
    "fig8a_original",
    "relay_deadzone",
    "sat_khalil710",
    "thruster_dz_hyst",
)


def _numbers(run: Any) -> list[Any]:
    """Everything that a run says, in the order in which it says it."""
    cycle = run.limit_cycle
    found: list[Any] = [run.t, *run.signals.values(), run.settled_since, *run.settled_at.values()]
    found += [str(e) for e in run.events] + [run.status.name]
    return found + ([] if cycle is None else _of_cycle(cycle))


def _of_cycle(cycle: Any) -> list[Any]:
    return [cycle.period, cycle.state, cycle.error_estimate, *cycle.mean.values(), *cycle.peak_to_peak.values()]


def _of_cycles(cycles: Any) -> list[Any]:
    return [cycles.status.name, *(value for cycle in cycles for value in _of_cycle(cycle))]


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
        parts = [_numbers(epp.simulate(system, case.input, t_end=case.t_end))]
        try:
            parts.append(_of_cycles(epp.predict_limit_cycles(case)))
        except epp.ModelError as refusal:  # an element without a describing function
            parts.append([str(refusal)])
        if name in SEARCHED:
            parts.append(_of_cycles(epp.find_limit_cycles(case)))
        sys.stdout.write(f"{name} {' '.join(map(digest, parts))}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
