"""Linear systems with named signals as the linear part of a loop: what each element takes and drives.

An element is put between outputs that feed it and inputs that it drives; inputs that none drives are the loop's
external ones.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.own_states import ports
from eppanalysis.models.systems.signals import SignalMap


@dataclass(frozen=True, eq=False)
class Ports:
    """Signals of the linear subsystems of an interconnection, as places to cut: outputs, then inputs.

    Each is ``y = C x + D u`` on the states and the inputs of the system; a disturbance d that is added there acts on
    the states through B, on the outputs through E, and straight back on y through F.
    """

    names: tuple[str, ...]
    B: Array
    C: Array
    D: Array
    E: Array
    F: Array


@dataclass(frozen=True, eq=False)
class Plant:
    """A linear system with names: ``dx/dt = A x + B u + constant_state``, ``y = C x + D u + constant_output``."""

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    time_step: float | None
    name: str
    ports: Ports | None = None
    #: Constant terms, zero by default; units of the outputs; where the inputs and the state are at the start.
    constant_state: Array | None = None
    constant_output: Array | None = None
    units: tuple[str, ...] = ()
    levels: Array | None = None
    x0: Array | None = None


@dataclass(frozen=True, eq=False)
class Place:
    """An element, what it is called, and the outputs that feed it and the inputs that it drives by number."""

    name: str
    element: Nonlinearity
    fed_by: tuple[int, ...]
    drives: tuple[int, ...]


def looped(
    plant: Plant,
    elements: Mapping[Any, Nonlinearity],
    element_names: Sequence[str] | None,
    x0: ArrayLike | None,
    v0: Mapping[str, float] | None,
    delays: Mapping[str, float] | None,
    between: Mapping[Any, tuple[str, ...]] | None = None,
) -> LureSystem:
    """The loop of a plant with elements around it, given by their signals or by a name that is `between` signals.

    Further arguments are those of `from_control`.
    """
    if not elements:
        raise ModelError(f"{plant.name}: a loop needs at least one nonlinear element.")
    taken: dict[int, str] = {}
    known = between or {}
    places = [_place(plant, known.get(key, key), element, taken) for key, element in elements.items()]
    places = [replace(p, name=key) if key in known else p for key, p in zip(elements, places, strict=True)]
    places = _named(plant, places, element_names)
    driven = [j for place in places for j in place.drives]
    free = [j for j in range(len(plant.inputs)) if j not in driven]
    rows = [i for place in places for i in place.fed_by]
    external = tuple(plant.inputs[j] for j in free)
    start = _by_name(plant, "v0", v0, external, plant.levels if plant.levels is None else plant.levels[free])
    late = _by_name(plant, "delays", delays, tuple(plant.inputs[j] for j in driven))
    cuts = None if plant.ports is None else _cuts(plant.ports, rows, driven, late)
    return LureSystem.build(
        plant.A,
        plant.B[:, driven],
        plant.C[rows],
        [place.element for place in places],
        D=plant.D[np.ix_(rows, driven)],
        B_input=plant.B[:, free],
        D_input=plant.D[np.ix_(rows, free)],
        input_names=external,
        element_names=[place.name for place in places],
        signals=_signals(plant, driven, free),
        constant_state=plant.constant_state,
        constant_input=plant.constant_output if plant.constant_output is None else plant.constant_output[rows],
        x0=plant.x0 if x0 is None else x0,
        v0=start,
        delays=late,
        time_step=plant.time_step,
        state_names=plant.states,
        cuts=cuts,
        name=plant.name,
    )


def _cuts(ports: Ports, rows: Sequence[int], driven: Sequence[int], late: Array) -> Cuts:
    """Places to cut, without those that carry a late output of an element, which is late for the states alone, and
    those behind which the loop that is cut open has no solution.
    """
    kept = ~np.any((ports.D[:, driven] != 0.0) & (late > 0.0), axis=1) & (ports.F != -1.0)
    names = tuple(name for name, keep in zip(ports.names, kept.tolist(), strict=True) if keep)
    of_elements = ports.D[np.ix_(kept, driven)]
    return Cuts(
        names, B=ports.B[:, kept], E=ports.E[np.ix_(rows, kept)], C=ports.C[kept], D=of_elements, F=ports.F[kept]
    )


def _place(plant: Plant, key: Any, element: Nonlinearity, taken: dict[int, str]) -> Place:
    """The place of an element; `taken` has the inputs that are driven already."""
    names = (key, key) if isinstance(key, str) else tuple(key)
    n_fed, n_driven = ports(element)
    if len(names) != n_fed + n_driven:
        who = type(element).__name__
        raise ModelError(f"{plant.name}: {who} is at {names}", expected=f"{_counts(n_fed, n_driven)} in a row")
    fed_by = tuple(_number(plant, "output", plant.outputs, n) for n in names[:n_fed])
    drives = tuple(_number(plant, "input", plant.inputs, n) for n in names[n_fed:])
    for j in drives:
        if j in taken:
            raise ModelError(
                f"{plant.name}: input {plant.inputs[j]!r} is driven by two elements",
                expected="one, or a sum of two inputs",
            )
        taken[j] = names[n_fed]
    return Place(names[n_fed], element, fed_by, drives)


def _counts(n_fed: int, n_driven: int) -> str:
    what = "the output of the system that feeds it" if n_fed == 1 else f"{n_fed} outputs of the system that feed it"
    where = "the input that it drives" if n_driven == 1 else f"{n_driven} inputs that it drives"
    return f"{what} and {where}"


def _number(plant: Plant, kind: str, known: Sequence[str], name: str) -> int:
    """Place of a signal among those of the system."""
    if name in known:
        return known.index(name)
    raise ModelError(f"{plant.name} has no {kind} {name!r}", expected=_choice(name, known))


def _choice(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(str(name)[:100], known, n=1)
    listed = f"one of: {', '.join(known) or 'none'}"
    return f"{listed} (did you mean {close[0]!r}?)" if close else listed


def _named(plant: Plant, places: list[Place], names: Sequence[str] | None) -> list[Place]:
    if names is None:
        return places
    if len(names) != len(places):
        raise ModelError(plant.name, list(names), f"{len(places)}, one for each element", field="element_names")
    return [replace(p, name=n) for n, p in zip(names, places, strict=True)]


def _by_name(
    plant: Plant, what: str, given: Mapping[str, float] | None, names: Sequence[str], default: Array | None = None
) -> Array:
    """Values in the order of names, by default those given, or zero."""
    for name in given or {}:
        if name not in names:
            raise ModelError(f"{plant.name}: {what} has {name!r}", expected=_choice(name, names))
    usual = np.zeros(len(names)) if default is None else default
    return np.array([float((given or {}).get(name, value)) for name, value in zip(names, usual, strict=True)])


def _signals(plant: Plant, driven: Sequence[int], free: Sequence[int]) -> SignalMap:
    """Outputs of the system, and behind them what the elements give, by the inputs that they drive."""
    own = len(plant.outputs)
    given = [plant.inputs[j] for j in driven]
    names = (*plant.outputs, *(f"{n}_output" if n in plant.outputs else n for n in given))
    n_given = len(given)
    return SignalMap(
        names,
        np.vstack([plant.C, np.zeros((n_given, len(plant.A)))]),
        np.vstack([plant.D[:, driven], np.eye(n_given)]),
        np.vstack([plant.D[:, free], np.zeros((n_given, len(free)))]),
        np.append(np.zeros(own) if plant.constant_output is None else plant.constant_output, np.zeros(n_given)),
        (*(plant.units or ("",) * own), *("",) * n_given),
    )
