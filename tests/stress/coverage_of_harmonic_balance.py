"""Every shipped loop with a prediction, orders 1 to 25: ``pytest -s tests/stress/coverage_of_harmonic_balance.py``.

Takes about an hour on one core, most of it for the elbow's loops at every order. The file's name keeps it out of the
README's test command.
"""

from __future__ import annotations

import sys

import numpy as np

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.harmonic_coverage import Entry, entries, share_covered


def test_estimates_cover_the_distance_to_an_exact_orbit_in_95_of_100():
    every: list[Entry] = []
    for name in epp.shipped_cases():
        if epp.case(name).to_system().time_step:
            continue
        try:
            found = entries(name, range(1, 26))
        except ModelError:  # no describing function
            continue
        if found:
            given = [e for e in found if np.isfinite(e.estimate)]
            ratio = np.median([e.estimate / e.error for e in given]) if given else np.nan
            covered = sum(e.covered for e in given)
            row = f"| {name} | {len(found)} | {len(found) - len(given)} | {covered} of {len(given)} | {ratio:.2f} |\n"
            sys.stdout.write(row)
        every += found
    assert every
    assert share_covered(every) >= 0.95
