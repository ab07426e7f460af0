"""Compiled: arrays copied and added into slices, by loops.

Numba's own assignment of an array to a slice brings along a message for shapes that differ, which takes seconds to
compile.
"""

from eppanalysis.kernels.compiling import PART, njit


@njit(**PART)
def fill(out, source):
    """out[:] = source, for vectors."""
    for i in range(out.size):
        out[i] = source[i]


@njit(**PART)
def fill_rows(out, source):
    """out[:, :] = source, for matrices."""
    for i in range(out.shape[0]):
        fill(out[i], source[i])


@njit(**PART)
def accumulate(out, factor, source):
    """out += factor * source, for vectors."""
    for i in range(out.size):
        out[i] += factor * source[i]


@njit(**PART)
def largest(rows):
    """Largest absolute value in a matrix; not a number where one is none."""
    found = 0.0
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            size = abs(rows[i, j])
            if size > found or size != size:
                found = size
    return found
