"""Places of sampled controllers and other elements in a loop, and what the controllers make of a sine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.ages import StraightReading, straight_readings
from eppanalysis.models.systems.sampled.strobe import clock_in


@dataclass(frozen=True, eq=False)
class Places:
    """Places of controllers and other elements in a loop."""

    controllers: tuple[SampledController, ...]
    plant: NDArray[np.intp]  # states but the clock
    #: z, w: inputs and outputs of the other elements.
    z: NDArray[np.intp]
    w: NDArray[np.intp]
    #: read, held: what the controllers read (not the clock), and their outputs.
    read: NDArray[np.intp]
    held: NDArray[np.intp]
    system: LureSystem  # the loop

    @cached_property
    def straight(self) -> tuple[StraightReading, ...]:
        """What controllers read straight of one another's holds."""
        return tuple(straight_readings(self.system))

    @classmethod
    def of(cls, system: LureSystem) -> Places:
        """Those of a loop."""
        z: list[int] = []
        w: list[int] = []
        read: list[int] = []
        held: list[int] = []
        clocks: set[int] = set()
        for e, zs, ws in zip(system.elements, system.input_slices, system.output_slices, strict=True):
            if isinstance(e, SampledController):
                read += range(zs.start, zs.stop - 1)
                held += range(ws.start, ws.stop)
                clocks.add(clock_in(system.C[zs.stop - 1]))
            else:
                z += range(zs.start, zs.stop)
                w += range(ws.start, ws.stop)
        plant = np.setdiff1d(np.arange(len(system.A)), sorted(clocks))
        chosen = tuple(e for e in system.elements if isinstance(e, SampledController))
        at_z, at_w, at_read, at_held = (np.array(places, np.intp) for places in (z, w, read, held))
        return cls(chosen, plant, at_z, at_w, at_read, at_held, system)

    def responses(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Responses of all controllers and their derivatives by the frequency, shape (..., held, read)."""
        both = [c.response_and_slope(omega) for c in self.controllers]
        return self.side_by_side([k for k, _ in both]), self.side_by_side([dk for _, dk in both])

    def aged(self, omega: NDArray[Any]) -> tuple[ComplexArray, ComplexArray]:
        """What is added to the responses of the loop where holds are read at known ages, and its derivative."""
        added = np.zeros((2, *np.shape(omega), *self.system.D.shape), complex)
        for reading in self.straight:
            added[..., reading.reads, reading.column] = reading.correction(omega)
        return added[0], added[1]

    def side_by_side(self, responses: Sequence[ComplexArray]) -> ComplexArray:
        """What each controller makes of what it reads, as one response of shape (..., held, read)."""
        K, i, j = np.zeros((*responses[0].shape[:-2], self.held.size, self.read.size), complex), 0, 0
        for k in responses:
            p, m = k.shape[-2:]
            K[..., i : i + p, j : j + m] = k
            i, j = i + p, j + m
        return K

    def closing(self, G: ComplexArray, K: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """From what the others bring to what is read, to what is held: ``K before``, and ``behind K`` alike."""
        around = at(G, self.read, self.held)
        before = np.linalg.inv(np.eye(self.read.size) - around @ K)
        behind = np.linalg.inv(np.eye(self.held.size) - K @ around)
        return np.asarray(K @ before, complex), np.asarray(before, complex), np.asarray(behind, complex)


def at(G: NDArray, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray:
    """Rows and columns of matrices, shape (..., n, m)."""
    return G[..., rows[:, None], columns]
