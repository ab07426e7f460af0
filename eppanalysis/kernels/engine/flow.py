"""Compiled: exact steps of an affine system, with bounds for its guards.

For one step h the matrices are made that carry state, rate and guards from the start of the step to its end, with a
bound on how far a guard can stray from the cubic through its end values; for long steps, with a bound on its travel.
"""

import numpy as np

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.tables import HOT, INLINE, LONG_DOUBLINGS
from eppanalysis.kernels.simd.sparse import sparse_size_sum, sparse_sum, sparse_sum_from
from eppanalysis.kernels.simd.vectors import (
    VECTOR_SIZE,
    add,
    add_sizes,
    any_above,
    dot,
    row_sum,
    row_sum_from,
    take,
    take_sizes,
)

#: How far a series goes of which the terms are to fall to rounding by order 32, in turns of 1/rate; and in steps.
REACH, MOST_FAR, _ORDERS = 3.0, 64, 32


@njit(**INLINE)
def rate_from(compiled, q, start, x, scale, out):
    """out = scale * (start + M x)."""
    if compiled.row_end.shape[1] > 0:
        sparse_sum_from(start, compiled.entries[q], compiled.row[q], compiled.row_end[q], x, scale, out)
    else:
        row_sum_from(start, compiled.M[q], x, scale, out)


@njit(**INLINE)
def rate_of(compiled, q, x, scale, out):
    """out = scale * M x."""
    if compiled.row_end.shape[1] > 0:
        sparse_sum(compiled.entries[q], compiled.row[q], compiled.row_end[q], x, scale, out)
    else:
        row_sum(compiled.M[q], x, scale, out)


@njit(**INLINE)
def size_of_rate(compiled, q, sizes, scale, out):
    """out = scale * abs(M) sizes."""
    if compiled.row_end.shape[1] > 0:
        sparse_size_sum(compiled.entries[q], compiled.row[q], compiled.row_end[q], sizes, scale, out)
    else:
        row_sum(compiled.M_size[q], sizes, scale, out)


@njit(**HOT)
def multiply(P, Q, scale, out):
    """out = scale P Q for small matrices, padded (no BLAS: its threads cost more than the product)."""
    for i in range(P.shape[0]):
        row_sum(Q, P[i], scale, out[i])


@njit(**HOT)
def _add(out, P):
    """out += P."""
    for i in range(P.shape[0]):
        add(out[i], P[i])


@njit(**HOT)
def growth_rate(M, P, Q):
    """Bound on the growth of the powers of M (padded): the 32nd root of the norm of its 32nd power [1/s]."""
    n = M.shape[0]
    size = 0.0
    for i in range(n):
        size += dot(M[i], M[i])
    if size == 0.0:
        return 0.0
    # A norm of M itself may exceed the growth by orders where states differ in scale, and would shorten all steps.
    _copy(P, M)
    log_scale, scale = 0.5 * np.log(size), 1.0 / size
    for _ in range(5):
        multiply(P, P, scale, Q)
        P, Q = Q, P
        norm = 0.0
        for i in range(n):
            norm += dot(P[i], P[i])
        if norm == 0.0:
            return 0.0
        log_scale, scale = 2.0 * log_scale + 0.5 * np.log(norm), 1.0 / norm
    return np.exp(log_scale / 32.0)


@njit(**HOT)
def flow(M, h, rate, integral, power, half, term, work):
    """exp(M h), its integral over [0, h], and exp(M h/2), into the arrays so named; for M (padded) or its transpose."""
    n = M.shape[0]
    doublings = 1
    while rate * h / 2.0**doublings > 0.5:
        doublings += 1
    # Scaling and squaring: a Taylor series of the integral over a step so short that it needs 21 terms at most.
    d = h / 2.0**doublings
    for i in range(n):
        for j in range(n):
            term[i, j] = integral[i, j] = d if i == j else 0.0
    for i in range(n):
        power[0, i] = 1e-18 * d
    for k in range(2, 22):
        multiply(M, term, d / k, work)
        term, work = work, term
        _add(integral, term)
        if not _any_above(term, 1.0, power[0]):
            break
    multiply(M, integral, 1.0, power)
    for i in range(n):
        power[i, i] += 1.0
    for k in range(doublings):
        if k == doublings - 1:
            _copy(half, power)
        # Twice the time: what the first half added, carried through the second, is added once more.
        multiply(power, integral, 1.0, work)
        _add(integral, work)
        multiply(power, power, 1.0, work)
        _copy(power, work)


@njit(**HOT)
def _any_above(P, scale, limits):
    """Whether a number of the matrix P is above the limit of its column."""
    for i in range(P.shape[0]):
        if any_above(P[i], scale, limits):
            return True
    return False


@njit(**HOT)
def _copy(out, source):
    for i in range(out.shape[0]):
        take(out[i], source[i])


@njit(**HOT)
def choose_step(compiled, work, q, base_step):
    """Step of combination q: the base step, halved until the mode's motion is resolved; its matrices wait for their
    use.
    """
    rate = growth_rate(compiled.M[q], work.square[0], work.square[1])
    h, sparse = base_step, compiled.row_end.shape[1] > 0
    # At 6 the bound of a fast step, a series in half of it, may be e^3 times what it begins with; what goes by series
    # goes no further than these.
    while rate * h > (REACH if sparse else 6.0):
        h *= 0.5
    compiled.step[q], compiled.rate[q], compiled.ready[q], compiled.longs[q], compiled.far[q] = h, rate, 0, 0, 0
    if sparse:
        _keep_sparse(compiled.M[q], compiled.entries[q], compiled.row[q], compiled.row_end[q])
        _keep_sparse(compiled.Y[q], compiled.y_entries[q], compiled.y_row[q], compiled.y_row_end[q])
        compiled.spread_rate[q] = growth_rate(compiled.M_size[q], work.square[0], work.square[1])
        far = MOST_FAR * h if rate * h * MOST_FAR <= REACH else REACH / rate
        # By the numbers that are read: those of M at each order, those of T at each step.
        if compiled.linear[q] and _ORDERS * VECTOR_SIZE * compiled.row_end[q, -1] < far / h * compiled.T[q].size:
            compiled.far[q] = far


@njit(**HOT)
def _keep_sparse(M, entries, row, row_end):
    """Keep a rate matrix by its rows of eight numbers that are not zero, filled up to four at a time."""
    k = 0
    for block in range(row_end.size):
        first = block * VECTOR_SIZE
        for j in range(M.shape[0]):
            some = False
            for i in range(VECTOR_SIZE):
                row[k], entries[k, i] = j, M[j, first + i]
                some = some or entries[k, i] != 0.0
            k += some
        while k % 4 > 0:
            row[k], entries[k] = 0, 0.0
            k += 1
        row_end[block] = k


@njit(**HOT)
def compile_step(compiled, work, q):
    """Fill the matrices that carry state, rate and guards over the step of combination q.

    How far a guard strays from the cubic through its end values is bounded by its fourth derivative over the step,
    ``gf M^3 exp(M s) x'(0)``, by its series about the middle.
    """
    M, h, rate, a = compiled.M[q], compiled.step[q], compiled.rate[q], work.square
    compiled.ready[q] = 1
    integral, power, half = a[2], a[3], a[4]
    flow(M, h, rate, integral, power, half, a[5], a[6])
    _fill_step(compiled.T[q], compiled.gf[q], compiled.n_guards[q], integral, power)
    P, Q = work.guards[0], work.guards[1]
    # h^4/384 is Hermite's remainder, that of the cubic through end values and end rates; the thousandth covers
    # rounding. The guard's rows take M three times, then exp(M h/2): its fourth derivative in the middle of the step.
    multiply(M, compiled.all_gf[q], 1.001 * h**4 / 384.0, P)
    multiply(M, P, 1.0, Q)
    multiply(M, Q, 1.0, P)
    multiply(half, P, 1.0, Q)
    # From the middle the series reaches both ends in half a step, which halves each power of the bound's growth.
    _sizes_of_powers(M, 0.5 * h, 0.0, Q, P, compiled.bound[q])


@njit(**HOT)
def _sizes_of_powers(M, step, shift, P, Q, total):
    """total = sum of abs(M^k P) step^k shift!/(k + shift)! over k; P and Q are overwritten."""
    for i in range(P.shape[0]):
        take_sizes(total[i], P[i])
    factor = 1.0
    for k in range(1, 64):
        factor *= step / (k + shift)
        multiply(M, P, 1.0, Q)
        P, Q = Q, P
        grown = k <= 8
        for i in range(P.shape[0]):
            add_sizes(total[i], P[i], factor)
            grown = grown or any_above(P[i], 1e4 * factor, total[i])
        if not grown:
            break


@njit(**HOT)
def compile_long(compiled, work, q):
    """Fill the matrices of the next longer step of combination q, and the bound on its guards' travel."""
    n, level, a = compiled.N.shape[1], compiled.longs[q], work.square
    integral, power, product = a[2], a[3], a[4]
    T = compiled.T[q] if level == 0 else compiled.T_long[q, level - 1]
    reach = compiled.reach[q, level]
    for i in range(n):
        for j in range(n):
            integral[i, j], power[i, j] = T[i, j], T[i, power.shape[0] + j]
    P, Q = work.guards[0], work.guards[1]
    if level == 0:
        h = compiled.step[q]
        for i in range(power.shape[0]):
            for g in range(P.shape[1]):
                P[i, g] = 1.001 * h * compiled.all_gf[q, i, g]
        _sizes_of_powers(compiled.M[q], h, 1.0, P, Q, reach)
    else:
        _copy(reach, compiled.reach[q, level - 1])
    for _ in range(LONG_DOUBLINGS):
        # Twice the time: in its second half a guard travels at most as far from where the sizes of exp(M t) carry the
        # rate (docs/theory/engine.md, Long step).
        for i in range(power.shape[0]):
            take_sizes(product[i], power[i])
        multiply(product, reach, 1.0, P)
        _add(reach, P)
        multiply(power, integral, 1.0, product)
        _add(integral, product)
        multiply(power, power, 1.0, product)
        _copy(power, product)
    _fill_step(compiled.T_long[q, level], compiled.gf[q], compiled.n_guards[q], integral, power)
    compiled.longs[q] = level + 1


@njit(**HOT)
def _fill_step(T, gf, G, integral, power):
    """Columns of T: state increment, rate, guard increments and guard rates at the end of a step."""
    wide = power.shape[0]
    half = (T.shape[1] - 2 * wide) // 2
    for i in range(wide):
        for j in range(wide):
            T[i, j], T[i, wide + j] = integral[i, j], power[i, j]
        for g in range(half):
            own = g < G
            T[i, 2 * wide + g] = dot(integral[i], gf[g]) if own else 0.0
            T[i, 2 * wide + half + g] = dot(power[i], gf[g]) if own else 0.0
