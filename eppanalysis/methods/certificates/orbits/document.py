"""The file of a certified orbit: its arcs in rationals, the box that holds it, as the checker reads them."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.numbers import middle_of, number_of
from eppanalysis.methods.certificates.orbits.axes import rational_of
from eppanalysis.methods.certificates.orbits.guards import weights_of
from eppanalysis.methods.certificates.orbits.path import Course, ExactPath
from eppanalysis.methods.certificates.orbits.shooting import Enclosure, Shooting
from eppanalysis.methods.certificates.orbits.timed import Sinusoid, takes_own_samples
from eppanalysis.methods.certificates.registry import STATEMENTS, sealed
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint

#: The checker takes this many times the radius that was found, so that its own rounding has room.
_ROOM = 4
#: Weight of an unknown that does not move, as a share of the least one of those that do.
_STILL = 2.0**-30


def document_of(
    path: ExactPath, basis: Array, shooting: Shooting, enclosure: Enclosure, sinusoid: Sinusoid | None = None
) -> dict[str, Any]:
    """The certificate of an orbit: plain data, statement, loop, claim, evidence.

    Parameters
    ----------
    basis : array, shape (m, m)
        From the unknowns of the path to the places of y that are unknown.
    sinusoid : Sinusoid, optional
        That drives the loop.
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
            "loop": {"arcs": _arcs(path), "course": _course(path, basis, sinusoid)},
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


def _arcs(path: ExactPath) -> list[dict[str, Any]]:
    return [_arc(path, k) for k in range(len(path.stages))]


def _course(path: ExactPath, basis: Array, sinusoid: Sinusoid | None) -> dict[str, Any]:
    """Where the arcs come from: the sine that drives a loop, its modes and events, and the unknowns."""
    course = path.course
    numbers = () if sinusoid is None else (number_of(sinusoid.amplitude), number_of(sinusoid.omega))
    return {
        "drive": [] if sinusoid is None else [sinusoid.input, *map(str, numbers)],
        "modes": course.modes.tolist(),
        "guards": course.guards.tolist(),
        "at_once": course.at_once.tolist(),
        "unknown": list(course.free),
        "held": [[place, str(value)] for place, value in path.held.items()],
        "basis": [[str(rational_of(v)) for v in row] for row in basis.tolist()],
    }


def other_arcs(given: Mapping[str, Any], system: LureSystem, at: OperatingPoint) -> str:
    """In what the arcs of a file are others than those of a loop on the same course; empty where they are its own.

    Parameters
    ----------
    given : mapping
        The loop of a certificate that its checker has accepted.
    at : OperatingPoint
        Where the external inputs are held.
    """
    try:
        loop = InSamples.at(system, at).system if system.time_step else system
        sinusoid = sinusoid_of(given["course"])
        hybrid = steady_hybrid(loop, at) if sinusoid is None else sinusoid.hybrid(loop, at)
        sine = None if sinusoid is None else sinusoid.place(loop)
        return "" if _own_arcs(given, hybrid, sine) == given["arcs"] else "its arcs are others"
    except EppError as reason:
        return f"it has no such cycle ({str(reason).rstrip('.')})"
    except (LookupError, TypeError, ValueError, ArithmeticError):
        return "it has no such modes and events"


def sinusoid_of(course: Mapping[str, Any]) -> Sinusoid | None:
    """The sine that drives the loop of a file; None where none does."""
    if not course["drive"]:
        return None
    name, *numbers = course["drive"]
    amplitude, omega = (float(Fraction(value)) for value in numbers)
    if not (amplitude > 0 and omega > 0):
        raise ValueError("a sine whose zeros are not where its element has them")
    return Sinusoid(name, amplitude, omega)


def _own_arcs(given: Mapping[str, Any], hybrid: HybridSystem, sine: int | None) -> list[dict[str, Any]]:
    """The arcs of a system on the course that a file tells."""
    from flint import fmpq, fmpq_mat

    told, n, y = given["course"], hybrid.x0.size, np.concatenate([hybrid.x0, hybrid.H0])
    modes, guards = np.array(told["modes"], np.int64), np.array(told["guards"], np.int64)
    held, unknown = dict(told["held"]), told["unknown"]
    places = sorted([*held, *unknown])
    own = range(n, n + int(hybrid.model.first[-1, 2]))  # places of the memory values of the elements
    known = set(own) <= set(places) <= {*range(n), *own} and not any(place < n for place in held)
    counts = [len(automaton.modes) for automaton in hybrid.automata]
    if not known or len(set(places)) != len(places) or guards.min() < 0 or modes.min() < 0 or (modes >= counts).any():
        raise ValueError("modes, events or places that the system does not have")
    for place, value in held.items():
        y[place] = float(Fraction(value))
    if not takes_own_samples(hybrid, y[n:]):
        raise ValueError("samples at other times")
    at_once = np.array(told["at_once"])
    path = ExactPath.along(hybrid, Course(modes, guards, at_once, tuple(unknown), sine), y)
    rows = [[fmpq(*Fraction(v).as_integer_ratio()) for v in [*row, "0"]] for row in told["basis"]]
    return _arcs(path.in_basis(fmpq_mat([*rows, [fmpq(int(i == path.m)) for i in range(path.m + 1)]])))


def _arc(path: ExactPath, k: int) -> dict[str, Any]:
    stage = path.stages[k]
    numbers = [g for g, _ in stage.guards]
    return {
        "rate": _rows(stage.rate),
        "guards": [_rows(row)[0] for _, row in stage.guards],
        "on_rates": [path.on_rates(k, g) for g in numbers],
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
