"""Where elements that stick hold their inputs, which the state is beside by rounding."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.models.systems.hybrid import HybridSystem


def on_levels(hybrid: HybridSystem, modes: IntArray) -> Array:
    """The matrix (N, N) of y that puts the inputs of all elements that stick on every arc on their levels.

    On a cycle no event brings them there. That they stand there is an equation of its own, and a disturbance off a
    level, which the element takes back at once, is none that lasts.
    """
    model = hybrid.model
    n, size = model.A.shape[0], model.A.shape[0] + model.K.shape[1]
    put = np.eye(size)
    rows = model.mode_first[:-1] + modes
    for e in np.flatnonzero(model.mode_stick[rows].all(axis=0) & (modes == modes[0]).all(axis=0)):
        z = model.first[e, 0]
        off, way = np.concatenate([model.C[z], model.Kz[z]]), way_back(hybrid, int(e))
        off[-1] -= model.mode_level[rows[0, e]]
        put[:n] -= np.outer(way / (model.C[z] @ way), off @ put)
    return put


def way_back(hybrid: HybridSystem, element: int) -> Array:
    """The direction of the state along which a sticking element is taken back to its level."""
    z, w = hybrid.model.first[element, :2]
    c = hybrid.model.C[z]
    return np.asarray(c != 0, float) if np.count_nonzero(c) == 1 else hybrid.model.B[:, w]
