"""What tests of bounds share: a small loop whose bound is known, and the result that holds given cells."""

from __future__ import annotations

from typing import Any

import eppanalysis as epp
from eppanalysis.methods.bounds import balanced
from eppanalysis.methods.bounds.result import BoundCell
from eppanalysis.results.provenance import Provenance

#: The fold in gain of the wheelchair with a gap of 12 mm, from a branch of exact orbits.
GAIN = 0.8462572


def wheelchair() -> epp.Case:
    """The shipped case with a gap of 12 mm and a gain that may be bounded."""
    return epp.case("wheelchair").with_values({"loop.gain": 1.0, "play.gap": 0.012})


_seek, _SEEN = balanced._seen_at, {}


def seen_at(question: balanced.BoundProblem, value: float) -> Any:
    """The cycles at a value, sought once for each loop and each search that a test puts in place of the package's."""
    key = question.case_at(value).to_toml(), value, balanced.find_limit_cycles
    if key not in _SEEN:
        _SEEN[key] = _seek(question, value)
    return _SEEN[key]


def bounds_of(case: epp.Case, over: str, limit: str, *cells: BoundCell) -> epp.DesignBounds:
    """What `design_bounds` returns with these cells."""
    names = (over, limit)
    return epp.DesignBounds(
        case.name, over, limit, {n: case.unit(n)[0] for n in names}, {n: case.readable(n) for n in names},
        {n: case.value(n) for n in names}, (0.001, 0.1), cells, 0.01, provenance=Provenance("bounds"),
    )  # fmt: skip
