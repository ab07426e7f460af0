"""Compiled: sizes of the motion on an orbit, by which residuals and steps of Newton's method are scaled."""

import numpy as np

from eppanalysis.kernels.compiling import KERNEL, PART, njit


@njit(**PART)
def size_of_motion(F, starts, ends, inner, tau, scale):
    """Fill `scale` (N,) with the size of the motion in each place of y; never zero.

    Parameters
    ----------
    F : array (p, n, N)
        Rates on the arcs.
    starts, ends, inner : arrays (p + 1, N), (p, N), (k, N)
        y behind and before the events, and half-way along some arcs.
    tau : array (p,)
        Dwell times.
    """
    p, n, N = F.shape
    for j in range(N):
        low, high = starts[0, j], starts[0, j]
        for rows in (starts, ends, inner):
            for a in range(rows.shape[0]):
                low, high = np.minimum(low, rows[a, j]), np.maximum(high, rows[a, j])
        size, span = max(abs(low), abs(high)), high - low
        if j < n:
            # What is fast comes back before the event: the way that it could go counts, too.
            for a in range(p):
                first, last = 0.0, 0.0
                for i in range(N):
                    first += F[a, j, i] * starts[a, i]
                    last += F[a, j, i] * ends[a, i]
                span = np.maximum(span, 0.1 * abs(tau[a]) * np.maximum(abs(first), abs(last)))
        scale[j] = span if span > 1e-9 * size else size if size > 0.0 else 1.0


@njit(**KERNEL)
def sizes_of_residuals(g, at_once, free, scale, period, rows):
    """Fill `rows` (m + p,) with the sizes of what must vanish: places `free` of y, and the guard that ends each arc.

    Where an arc ends at once, or its guard sees nothing, that is its dwell time; where it begins on its own guard, the
    mean rate of that (`at_once`: 1 and 2).
    """
    m = free.size
    for k in range(m):
        rows[k] = scale[free[k]]
    for a in range(g.shape[0]):
        size = 0.0
        for j in range(g.shape[1]):
            size += abs(g[a, j]) * scale[j]
        if at_once[a] == 1 or size == 0.0:
            size = period
        elif at_once[a] == 2:
            size /= period
        rows[m + a] = size
