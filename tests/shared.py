"""Dear results that tests of several files look at, computed once in a process."""

from __future__ import annotations

from functools import cache

import eppanalysis as epp


@cache
def predicted(name: str) -> epp.Prediction:
    """What first order predicts for a shipped case."""
    return epp.predict_limit_cycles(epp.case(name))


@cache
def cycles_of(name: str) -> epp.CycleSearch:
    """All limit cycles of a shipped case."""
    return epp.find_limit_cycles(epp.case(name))
