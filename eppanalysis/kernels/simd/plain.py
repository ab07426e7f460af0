"""The sums of rows of :mod:`eppanalysis.kernels.simd.vectors` in plain numpy: the same operations in the same order.

They run where numba is switched off (``NUMBA_DISABLE_JIT=1``), to step through a kernel in a debugger, and give the
same bits: each lane adds up on its own, and sums over all lanes go by halves.
"""

import numpy as np

VECTOR_SIZE = 8


def row_sum(rows, weights, scale, out):
    """out = scale * weights @ rows, with as many columns as `out` has."""
    row_sum_from(np.zeros(out.size), rows, weights, scale, out)


def row_sum_from(start, rows, weights, scale, out):
    """out = scale * (start + weights @ rows): even and odd rows apart."""
    n = out.size
    sums = [start[:n].copy(), np.zeros(n)]
    for r in range(weights.size):
        sums[r % 2] = weights[r] * rows[r, :n] + sums[r % 2]
    out[:] = scale * (sums[0] + sums[1])


def sparse_sum(entries, rows, ends, weights, scale, out):
    """out = scale * weights @ a matrix that is kept by its rows of eight numbers that are not zero."""
    sparse_sum_from(np.zeros(out.size), entries, rows, ends, weights, scale, out)


def sparse_sum_from(start, entries, rows, ends, weights, scale, out):
    """out = scale * (start + weights @ such a matrix): four of its rows beside each other."""
    begin = 0
    for column, end in zip(range(0, out.size, VECTOR_SIZE), ends, strict=False):
        sums = [start[column : column + VECTOR_SIZE].copy(), *np.zeros((3, VECTOR_SIZE))]
        for k in range(begin, end):
            sums[k % 4] = weights[rows[k]] * entries[k] + sums[k % 4]
        begin = end
        out[column : column + VECTOR_SIZE] = scale * ((sums[0] + sums[1]) + (sums[2] + sums[3]))


def sparse_size_sum(entries, rows, ends, weights, scale, out):
    """out = scale * weights @ the absolute values of such a matrix."""
    sparse_sum(np.abs(entries), rows, ends, weights, scale, out)


def add(out, a):
    """out += a."""
    out += a[: out.size]


def take(out, a):
    """out = a."""
    out[:] = a[: out.size]


def take_sizes(out, a):
    """out = abs(a)."""
    out[:] = np.abs(a[: out.size])


def add_sizes(out, a, scale):
    """out += scale * abs(a)."""
    out[:] = scale * np.abs(a[: out.size]) + out


def take_larger(out, a, b):
    """out = max(abs(a), b)."""
    size, other = np.abs(a[: out.size]), b[: out.size]
    out[:] = np.where(size > other, size, other)


def lower_to(out, a):
    """out = min(out, a)."""
    out[:] = np.where(a[: out.size] < out, a[: out.size], out)


def raise_to(out, a):
    """out = max(out, a)."""
    out[:] = np.where(a[: out.size] > out, a[: out.size], out)


def cubics_below(start, start_rate, step, end_rate, third, noise, stray):
    """Whether all curves that stray from a cubic by so much at most stay below zero."""
    level = 0.0 - noise
    b, rise, fall = start + step, third * start_rate, third * end_rate
    first = np.where(start > level, 0.0, start)
    middle = 0.5 * ((first + rise) + (b - fall))
    coefficients = (first + 0.75 * rise, middle + 8.0 / 3.0 * stray, b - 0.75 * fall, b)
    return bool(np.all(start <= noise)) and all(bool(np.all(c <= level)) for c in coefficients)


def _total(width):
    """Sum over all lanes, by halves."""
    while width.size > 1:
        half = width.size // 2
        width = width[:half] + width[half:]
    return float(width[0])


def _blocks(a):
    return a.reshape(-1, VECTOR_SIZE)


def dot(a, b):
    """Sum of a * b."""
    total = np.zeros(VECTOR_SIZE)
    for x, y in zip(_blocks(a), _blocks(b), strict=False):
        total = x * y + total
    return _total(total)


def rises(a, b):
    """Sum of the positive ones among the products a * b."""
    total = np.zeros(VECTOR_SIZE)
    for x, y in zip(_blocks(a), _blocks(b), strict=False):
        product = x * y
        total = total + np.where(product > 0.0, product, 0.0)
    return _total(total)


def value_and_slope(terms, u):
    """Sum of terms[k] * u**k, and of k * terms[k] * u**k."""
    powers, whole, lane = np.ones(VECTOR_SIZE), float(u), np.arange(VECTOR_SIZE)
    for k in range(3):
        powers = powers * np.where(lane >> k & 1, whole, 1.0)
        whole = whole * whole
    value, slope = np.zeros(VECTOR_SIZE), np.zeros(VECTOR_SIZE)
    for place in range(terms.size - VECTOR_SIZE, -1, -VECTOR_SIZE):
        now = terms[place : place + VECTOR_SIZE]
        value = value * whole + now
        slope = slope * whole + now * (place + lane)
    return _total(value * powers), _total(slope * powers)


def polynomial(rows, last, u, out):
    """out = sum of rows[k] * u**k up to k = last (2 or more), its even and its odd terms beside each other."""
    n, square = out.size, u * u
    upper, lower = rows[last, :n], rows[last - 1, :n]
    for turn in range((last - 1) // 2):
        k = last - 2 * (turn + 1)
        upper = upper * square + rows[k, :n]
        lower = lower * square + rows[k - 1, :n]
    even = last % 2 == 0
    out[:] = lower * u + (upper * square + rows[0, :n]) if even else upper * u + lower


def size_sum(rows, last, out):
    """out = sum of the absolute values of rows[1] to rows[last]."""
    total = np.zeros(out.size)
    for k in range(1, last + 1):
        total = total + np.abs(rows[k, : out.size])
    out[:] = total


def any_above(row, scale, limits):
    """Whether the absolute value of any number of a row, times a positive scale, is above its limit, or is none."""
    return not bool(np.all(scale * np.abs(row) <= limits[: row.size]))


#: By the names of the compiled ones.
PLAIN = {
    function.__name__: function
    for function in (
        row_sum,
        row_sum_from,
        sparse_sum,
        sparse_sum_from,
        sparse_size_sum,
        add,
        take,
        take_sizes,
        add_sizes,
        take_larger,
        lower_to,
        raise_to,
        cubics_below,
        dot,
        rises,
        value_and_slope,
        polynomial,
        size_sum,
        any_above,
    )
}
