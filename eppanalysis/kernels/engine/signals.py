"""Compiled: what follows from a state in its mode: constant parts until the next event, its rate, the signals."""

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.flow import rate_from, size_of_rate
from eppanalysis.kernels.engine.series import DELAY_LINE, EPS, smooth_term
from eppanalysis.kernels.engine.switches import smooth_at
from eppanalysis.kernels.engine.tables import HOT, INLINE
from eppanalysis.kernels.simd.sparse import sparse_sum
from eppanalysis.kernels.simd.vectors import add, polynomial, row_sum_from, take, take_sizes


@njit(**INLINE)
def enter(compiled, q, H, f, constant, lift, still):
    """Constant parts of the rate, the guards (on state and rate; on the state alone), the signals, until an event."""
    for i in range(compiled.N.shape[1]):
        v = 0.0
        for j in range(H.size):
            v += compiled.N[q, i, j] * H[j]
        f[i] = v
    for g in range(compiled.n_guards[q]):
        v = 0.0
        for j in range(H.size):
            v += compiled.gH[q, g, j] * H[j]
        constant[g] = lift[g] = v
        if compiled.on_rate[q, g]:
            v = 0.0
            for j in range(H.size):
                v += compiled.gfH[q, g, j] * H[j]
            lift[g] = v
    for i in range(compiled.YH.shape[1]):
        v = 0.0
        for j in range(H.size):
            v += compiled.YH[q, i, j] * H[j]
        still[i] = v


@njit(**INLINE)
def rates(compiled, q, x, f, Sg, last, u, rate):
    """Rate of the state x at place u of a series step."""
    rate_from(compiled, q, f, x, 1.0, rate)
    for j in range(Sg.shape[1]):
        sigma = smooth_at(Sg, last, j, u)
        for i in range(compiled.S.shape[1]):
            rate[i] += compiled.S[q, i, j] * sigma


@njit(**HOT)
def rate_at_end(model, compiled, q, workspace):
    """Rate of the state where a run stands; one that is rounding of what it was added up from is none."""
    rate, Sg, f, small = workspace.rate, workspace.Sg, workspace.push, workspace.small
    n_s = Sg.shape[1]
    take(workspace.X[0], workspace.x)
    for j in range(n_s):
        if model.smooth_kind[j] != DELAY_LINE:
            smooth_term(model, j, 0, workspace.X, workspace.H, Sg, workspace.arg, workspace.aux)
    rates(compiled, q, workspace.x, f, Sg, 0, 0.0, rate)
    take_sizes(workspace.wide, workspace.x)
    size_of_rate(compiled, q, workspace.wide, 1.0, small)
    for i in range(compiled.S.shape[1]):
        # The verdict recognises a run at rest by rates that are exactly zero.
        if n_s == 0 and not abs(rate[i]) > 64.0 * EPS * (abs(f[i]) + small[i]):
            rate[i] = 0.0


@njit(**INLINE)
def slack_at(t, step):
    """How far from the end of a step, at time t, a sample counts as at its end: the rounding of times.

    It is little of the step, too: smooth motion may be faster than the steps of its mode by any factor.
    """
    return min(16.0 * EPS * t, 1e-9 * step)


@njit(**INLINE)
def write(Y, Ys, x, still, sigma, row):
    """Signals at state x."""
    row_sum_from(still, Y, x, 1.0, row)
    for j in range(sigma.size):
        for i in range(Ys.shape[0]):
            row[i] += Ys[i, j] * sigma[j]


@njit(**HOT)
def write_rest(compiled, q, x, still, sigma, rows, first, stop, out):
    """Signals at state x at the samples first..stop."""
    for k in range(first, stop):
        write(compiled.Y[q], compiled.Ys[q], x, still, sigma, out[rows[k]])


@njit(**HOT)
def sample_signals(compiled, q, workspace, last, samples, first, stop, t, d):
    """Signals at the samples first..stop of a series step without smooth channels, by series of their own.

    They see few states of a large loop, and several samples come in a step.
    """
    Z, per_unit = workspace.Z, 1.0 / d
    for k in range(last + 1):
        sparse_sum(compiled.y_entries[q], compiled.y_row[q], compiled.y_row_end[q], workspace.X[k], 1.0, Z[k])
    add(Z[0], workspace.still)
    for k in range(first, stop):
        polynomial(Z, last, max(0.0, (samples.times[k] - t) * per_unit), samples.out[samples.rows[k]])


@njit(**HOT)
def sample_series(Y, Ys, X, last, Sg, samples, rows, first, stop, t, d, still, x, out):
    """Signals at the samples first..stop of a series step. (A call with all arrays would be dearer.)"""
    per_unit = 1.0 / d
    for k in range(first, stop):
        # A sample left over by the step before may lie before this one by rounding, which no series extrapolates.
        u = max(0.0, (samples[k] - t) * per_unit)
        polynomial(X, last, u, x)
        row = out[rows[k]]
        row_sum_from(still, Y, x, 1.0, row)
        for j in range(Sg.shape[1]):
            sigma = smooth_at(Sg, last, j, u)
            for i in range(Ys.shape[0]):
                row[i] += Ys[i, j] * sigma
