"""What is between measured signals and the automata of the elements: rates, clocks, own states, controllers.

An element reads its input and makes of it what else its automaton needs; all of that is linear and known exactly. With
all elements side by side it is a response from what is measured before them, x, and what their automata put out, w, to
what these read, z, and what acts on the measured part, y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.models.elements.base import Nonlinearity, OwnStates
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.own_states import side_by_side
from eppanalysis.models.systems.signals import slices

#: Inputs that nothing measures, as they follow from others: see :func:`ways_of`.
_FOLLOW = ("rate", "clock", "contact")


def ways_of(element: Nonlinearity) -> tuple[str, ...]:
    """How each signal before an element comes about: by its name where it follows from others, else "measured"."""
    if element.own_states is not None:
        return ("measured",) * element.own_states.n_before
    names = element.input_ports[1:] or ("rate",) * element.reads_rate
    others = (*names, *("unknown",) * element.n_inputs)[: element.n_inputs - 1]
    return ("measured", *(name if name in _FOLLOW else "unknown" for name in others))


def measured_of(element: Nonlinearity) -> list[int]:
    """Places of what is measured among the signals before an element."""
    return [i for i, way in enumerate(ways_of(element)) if way == "measured"]


def columns_of(element: Nonlinearity) -> int:
    """Number of the signals by which an element acts on the measured part: not by the rate of a contact angle."""
    if element.own_states is not None:
        return element.own_states.n_behind
    return element.n_outputs - ways_of(element).count("contact")


@dataclass(frozen=True, eq=False)
class Between:
    """The parts of all elements side by side."""

    states: dict[str, Array]  # their states, as :func:`~eppanalysis.models.systems.own_states.side_by_side` has them
    rates: Array  # matrix from (x, w) to (z, y) of what is differentiated
    controllers: tuple[tuple[SampledController, slice, slice], ...]  # with their places in y and in x

    @classmethod
    def of(cls, elements: Sequence[Nonlinearity]) -> Between:
        """That of elements."""
        parts = [_part(e) for e in elements]
        behind, before = (slices(sizes) for sizes in zip(*((p.n_behind, p.n_before) for p in parts), strict=True))
        states = side_by_side(parts)
        rates, z = np.zeros(_joined(states, "D").shape), 0
        for e, part, place in zip(elements, parts, before, strict=True):
            if e.own_states is None:
                rates[z : z + e.n_inputs, place.start] = [way == "rate" for way in ways_of(e)]
            z += len(part.C) - part.n_behind
        places = zip(elements, behind, before, strict=True)
        return cls(states, rates, tuple((e, y, x) for e, y, x in places if isinstance(e, SampledController)))

    @cached_property
    def passes(self) -> bool:
        """Whether what is before and behind the elements is what their automata read and put out."""
        parts = (self.states[name] for name in ("D_zx", "D_yw"))
        straight = all(D.shape == (n := len(D), n) and bool(np.all(np.eye(n) == D)) for D in parts)
        return straight and not (len(self.states["A"]) or self.controllers)

    @cached_property
    def _direct(self) -> Array:
        """Matrix from (x, w) to (z, y) of what has no state."""
        return _joined(self.states, "D")

    def at(self, omega: Array) -> tuple[dict[str, ComplexArray], dict[str, ComplexArray]]:
        """Responses "zx", "zw", "yx" and "yw" at frequencies [rad/s], and their derivatives by them."""
        s, own = 1j * omega[..., None, None], self.states
        P = self._direct + s * self.rates
        dP = np.broadcast_to(1j * self.rates, P.shape).copy()
        if len(own["A"]):
            C, B = np.vstack([own["C_z"], own["C_y"]]), np.hstack([own["B_x"], own["B_w"]])
            resolvent = np.linalg.inv(s * np.eye(len(own["A"])) - own["A"])
            P, dP = P + C @ resolvent @ B, dP - 1j * (C @ resolvent @ resolvent @ B)
        z, x = own["D_zx"].shape
        for controller, y, read in self.controllers:
            places = (..., slice(z + y.start, z + y.stop), read)
            P[places], dP[places] = controller.response_and_slope(omega)
        return _named(P, z, x), _named(dP, z, x)


def _joined(own: dict[str, Array], name: str) -> Array:
    return np.block([[own[f"{name}_zx"], own[f"{name}_zw"]], [own[f"{name}_yx"], own[f"{name}_yw"]]])


def _named(P: ComplexArray, z: int, x: int) -> dict[str, ComplexArray]:
    return {"zx": P[..., :z, :x], "zw": P[..., :z, x:], "yx": P[..., z:, :x], "yw": P[..., z:, x:]}


def _part(element: Nonlinearity) -> OwnStates:
    """What one element brings, rates and controllers, which are no states, left out."""
    own = element.own_states
    if isinstance(element, SampledController):
        # Its response with hold and delay is no rational one; by the DF it has no automaton.
        p, m = np.shape(element.D)
        return OwnStates(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), np.zeros((p, m)), m, p)
    if own is not None:
        return own
    ways, outputs, columns = ways_of(element), element.n_outputs, columns_of(element)
    # A contact angle is the integral of the output behind those that act on the measured part.
    k = outputs - columns
    B, C = np.zeros((k, 1 + outputs)), np.zeros((len(ways) + columns, k))
    B[:, 1 + columns :], C[[i for i, way in enumerate(ways) if way == "contact"]] = np.eye(k), np.eye(k)
    D = np.zeros((len(ways) + columns, 1 + outputs))
    D[0, 0], D[len(ways) :, 1 : 1 + columns] = 1.0, np.eye(columns)
    return OwnStates(np.zeros((k, k)), B, C, D, 1, columns)
