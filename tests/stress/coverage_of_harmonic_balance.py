"""Every shipped loop with a prediction, orders 1 to 25: ``pytest -s tests/stress/coverage_of_harmonic_balance.py``.

``python -m tests.stress.coverage_of_harmonic_balance NAME...`` prints the rows of some loops, of all without a name.
Takes a quarter of an hour on one core, most of it for the elbow's loops. The file's name keeps it out of the README's
test command. Matrices are small: several threads in one product, on cores that others use, take five times as long.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from collections.abc import Sequence

import numpy as np

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.harmonic_coverage import Entry, entries, share_covered


def covered(names: Sequence[str]) -> list[Entry]:
    """All balances of shipped loops in continuous time; prints a row of a table for each loop."""
    every: list[Entry] = []
    for name in names:
        if epp.case(name).to_system().time_step:
            continue
        try:
            found = entries(name, range(1, 26))
        except ModelError:  # no describing function
            continue
        if found:
            given = [e for e in found if np.isfinite(e.estimate)]
            ratio = np.median([e.estimate / e.error for e in given]) if given else np.nan
            count = sum(e.covered for e in given)
            row = f"| {name} | {len(found)} | {len(found) - len(given)} | {count} of {len(given)} | {ratio:.2f} |\n"
            sys.stdout.write(row)
            sys.stdout.flush()
        every += found
    return every


def test_estimates_cover_the_distance_to_an_exact_orbit_in_95_of_100():
    every = covered(epp.shipped_cases())
    assert every
    assert share_covered(every) >= 0.95


if __name__ == "__main__":
    covered(sys.argv[1:] or epp.shipped_cases())
