"""The file of a certified orbit: its arcs in rationals, the box that holds it, as the checker reads them."""

from __future__ import annotations

from typing import Any

import numpy as np

from eppanalysis.methods.certificates.numbers import middle_of
from eppanalysis.methods.certificates.orbits.axes import rational_of
from eppanalysis.methods.certificates.orbits.guards import weights_of
from eppanalysis.methods.certificates.orbits.path import ExactPath, Stage
from eppanalysis.methods.certificates.orbits.shooting import Enclosure, Shooting
from eppanalysis.methods.certificates.registry import STATEMENTS, sealed

#: The checker takes this many times the radius that was found, so that its own rounding has room.
_ROOM = 4
#: Weight of an unknown that does not move, as a share of the least one of those that do.
_STILL = 2.0**-30


def document_of(name: str, path: ExactPath, shooting: Shooting, enclosure: Enclosure) -> dict[str, Any]:
    """The certificate of an orbit: plain data, statement, loop, claim, evidence.

    Parameters
    ----------
    name : str
        Of the loop.
    """
    columns = shooting.columns[: path.m + 1]
    legs = zip(enclosure.starts, enclosure.durations, strict=True)
    x = [v for start, duration in legs for v in (*start.entries()[: path.m], duration)]
    solution, sizes = [middle_of(v) for v in x], [rational_of(float(c)) for c in columns]
    radius = middle_of(enclosure.radius * _ROOM)
    period = sum(solution[path.m :: path.m + 1], solution[0] * 0)
    # The period is the sum of all lengths, each of which is off by its share of the radius at most.
    off = radius * sizes[-1] * len(path.timed)
    box = rational_of(float(enclosure.unique_within))
    return sealed(
        {
            "statement": STATEMENTS["orbit"].text,
            "loop": {"name": name, "arcs": [_arc(path, stage) for stage in path.stages]},
            "claim": {
                "events": len(path.stages),
                "period": [str(period - off), str(period + off)],
                "box": str(box),
            },
            "evidence": {
                "solution": [str(v) for v in solution],
                "sizes": [str(v) for v in sizes],
                "weights": [str(w) for a in path.timed for w in _weights(path, a, columns[: path.m])],
                "radius": str(radius),
                "box": str(box),
            },
        }
    )


def _arc(path: ExactPath, stage: Stage) -> dict[str, Any]:
    numbers = [g for g, _ in stage.guards]
    return {
        "rate": _rows(stage.rate),
        "guards": [_rows(row)[0] for _, row in stage.guards],
        "names": [path.guard_name(g) for g in numbers],
        "on_rates": [bool(np.any(path.hybrid.model.guard_rate[g])) for g in numbers],
        "fired": numbers.index(stage.fired),
        "jump": _rows(stage.jump),
        "levels": [_rows(row)[0] for row in stage.levels.values()],
        "at_once": bool(stage.at_once),
    }


def _weights(path: ExactPath, arc: int, scale: np.ndarray) -> list[Any]:
    """Weights of the unknowns, in which the rates on an arc are small; any that are positive prove something."""
    moving = path.moving
    found = weights_of(path.stages[arc], moving, scale)
    out = np.full(path.m, found.min(initial=1.0) * _STILL)
    out[moving] = found
    return [rational_of(float(w)) for w in out]


def _rows(matrix: Any) -> list[list[str]]:
    return [[str(v) for v in row] for row in matrix.tolist()]
