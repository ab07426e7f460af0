"""Named signals of a loop, the names of its elements and states, and the checks of what it is made of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import ROUNDING
from eppanalysis.models.systems.own_states import ports
from eppanalysis.readable import Unit


@dataclass(frozen=True)
class SignalMap:
    """Named outputs ``y = C x + D w + D_input v + constant`` that users see (not the inputs of the elements)."""

    names: tuple[str, ...]
    C: Array
    D: Array
    D_input: Array
    constant: Array
    units: tuple[str, ...] = ()
    #: Unit of time, which may be read in another one.
    time: str = "s"

    def led_by(self, name: str) -> SignalMap:
        """The same signals with this one first: sentences and pictures are about the first one."""
        order = sorted(range(len(self.names)), key=lambda i: self.names[i] != name)
        names, units = (tuple(part[i] for i in order) if part else part for part in (self.names, self.units))
        C, D, D_input, constant = (part[order] for part in (self.C, self.D, self.D_input, self.constant))
        return replace(self, names=names, C=C, D=D, D_input=D_input, constant=constant, units=units)

    def units_by_name(self) -> dict[str, str]:
        """SI unit of each signal, empty for one that has none."""
        return dict(zip(self.names, self.units or ("",) * len(self.names), strict=True))

    def units_of_results(self) -> dict[str, str]:
        """SI unit of each signal, and of time where it is read in another one."""
        return {**({"time": self.time} if isinstance(self.time, Unit) else {}), **self.units_by_name()}

    def in_units(self, known: Mapping[str, str]) -> SignalMap:
        """The signals with these units, by their names; none for one that is not among them."""
        return replace(self, units=tuple(known.get(name, "") for name in self.names))

    def unit_of(self, x: Array | None = None, w: Array | None = None, v: Array | None = None, one: float = 0.0) -> str:
        """The unit of a sum of states x, outputs of elements w, external inputs v and a constant; empty where no
        signal is just that.
        """
        parts = ((x, self.C), (w, self.D), (v, self.D_input))
        row = np.concatenate([np.zeros(m.shape[1]) if given is None else given for given, m in parts])
        rows = np.hstack([m for _, m in parts])
        alike = np.isclose(rows, row, ROUNDING, 0.0).all(axis=1) & np.isclose(self.constant, one, ROUNDING, 0.0)
        return next((unit for unit, here in zip(self.units, alike, strict=False) if here and unit), "")


def require(name: str, what: str, given: object, holds: bool, expected: str) -> None:
    """Refuse what a loop called `name` is given where it does not hold."""
    if not holds:
        raise ModelError(name, given, expected, field=what)


def labels_of(elements: Sequence[Nonlinearity], names: Sequence[str] | None) -> tuple[str, ...]:
    """What the elements are called: as given, else after their kinds."""
    given = tuple(names) if names is not None else ()
    return given or tuple(_unique([e.called() for e in elements]))


def state_names_of(name: str, names: Sequence[str] | None, n: int) -> tuple[str, ...]:
    """What the states are called: as given, else x0, x1, ..."""
    given = tuple(names) if names is not None else ()
    require(name, "state_names", list(given), len(given) in (0, n), f"{n}, one for each state")
    return given or tuple(f"x{i}" for i in range(n))


def require_names(name: str, labels: tuple[str, ...], count: int) -> None:
    """One name for each element, and no name twice: signals are found by them."""
    fits = len(labels) == count and len(set(labels)) == count
    require(name, "element_names", list(labels), fits, f"{count} different names, one for each element")


def checked_array(name: str, label: str, values: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    """An array of a shape, zeros by default; a single row or column may be given as a list of numbers."""
    out = np.zeros(shape) if values is None else np.array(values, float)
    if out.size == math.prod(shape) and (out.ndim < len(shape) and 1 in shape or not out.size):
        out = out.reshape(shape)
    if out.shape != shape:
        raise ModelError(f"{name}: {label} has shape {out.shape}", expected=f"shape {shape}", field=label)
    if not np.all(np.isfinite(out)):
        raise ModelError(f"{name}: {label} holds a number that is not finite.", field=label)
    out.flags.writeable = False
    return out


def _unique(names: list[str]) -> list[str]:
    return [n if names.count(n) == 1 else f"{n}_{names[:i].count(n) + 1}" for i, n in enumerate(names)]


def slices(sizes: Sequence[int], first: int = 0) -> tuple[slice, ...]:
    """Places of parts of given sizes one behind the other, from the first place on."""
    ends = first + np.cumsum([0, *sizes])
    return tuple(slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True))


def element_signals(
    elements: Sequence[Nonlinearity],
    labels: Sequence[str],
    C: Array,
    D: Array,
    D_input: Array,
    constant: Array,
    single: tuple[str, str] | None = None,
) -> SignalMap:
    """Each element's first input and all outputs, named after the element (``x`` and ``y`` when there is one).

    An output with impulses is none of them.
    """
    names: list[str] = []
    rows_c, rows_d, rows_v, constants = [], [], [], []
    nw, nv = D.shape[1], D_input.shape[1]
    inputs, outputs = (slices([ports(e)[k] for e in elements]) for k in (0, 1))
    for element, label, zs, ws in zip(elements, labels, inputs, outputs, strict=True):
        names.append(single[0] if single else f"{label}_input")
        rows_c.append(C[zs.start])
        rows_d.append(D[zs.start])
        rows_v.append(D_input[zs.start])
        constants.append(constant[zs.start])
        for j in range(ws.start + element.has_impulses, ws.stop):
            many = ws.stop - ws.start > 1
            names.append(single[1] if single else f"{label}_output{j - ws.start + 1 if many else ''}")
            rows_c.append(np.zeros(C.shape[1]))
            rows_d.append(np.eye(nw)[j])
            rows_v.append(np.zeros(nv))
            constants.append(0.0)
    C, D, D_input = (
        np.array(rows, float).reshape(len(names), width)
        for rows, width in ((rows_c, C.shape[1]), (rows_d, nw), (rows_v, nv))
    )
    return SignalMap(tuple(names), C, D, D_input, np.array(constants), ("",) * len(names))
