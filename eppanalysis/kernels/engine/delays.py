"""Compiled: the memory of dead times, a ring buffer of Taylor series of each delayed output.

Every step that a run makes leaves the series of the delayed outputs behind; a later step reads them back, shifted to
where it stands, and counts no further than the segment that it reads. Such an end would come back after each dead time,
with those that were there before, for ever. So a step is expanded beyond it, as far as the series that it reads holds,
and where the next one only continues it (there was no switch, or its echo has become too faint) both are one segment.
"""

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.series import DELAY_LINE, EPS, ORDER
from eppanalysis.kernels.engine.tables import HOT

#: Segments that are remembered.
LINE_CAPACITY = 8192
#: Begin of all time [s], and length of what holds for ever.
ALWAYS = 1e300
#: Rounding within which one series continues another, relative to the sum of its terms.
CONTINUES = 8.0 * EPS


@njit(**HOT)
def start_lines(model, compiled, q, x, H, line_t, line_h, line_c, line_n):
    """Before the start a delayed output has had its value at the start for ever."""
    for j in range(line_n.shape[0]):
        if model.smooth_kind[j] != DELAY_LINE:
            continue
        w = model.smooth_w[j]
        v = 0.0
        for i in range(compiled.Wx.shape[2]):
            v += compiled.Wx[q, w, i] * x[i]
        for i in range(H.size):
            v += compiled.WH[q, w, i] * H[i]
        line_t[j, 0, 0], line_t[j, 0, 1], line_h[j, 0] = -ALWAYS, 0.0, 2.0 * ALWAYS
        line_c[j, 0, :] = 0.0  # what an earlier run left there
        line_c[j, 0, 0] = v
        line_n[j, 0], line_n[j, 1] = 1, 0


@njit(**HOT)
def segment_reach(model, j, t, line_t, line_h, line_n):
    """How far from t on the segment that holds t - delay counts, and how far its series holds.

    Both are -1 when history was overwritten.
    """
    size = line_t.shape[1]
    late = t - model.smooth_delay[j]
    # A segment that ends here but for the rounding of times would be read over no time at all.
    slack = 1e-14 * max(abs(t), abs(late))
    while line_n[j, 1] < line_n[j, 0] - 1 and line_t[j, line_n[j, 1] % size, 1] <= late + slack:
        line_n[j, 1] += 1
    if line_n[j, 0] - line_n[j, 1] > size:
        return -1.0, -1.0
    r = line_n[j, 1] % size
    counts, holds = line_t[j, r, 1] - late, line_t[j, r, 0] + line_h[j, r] - late
    return max(counts, 0.0), max(counts, holds)


@njit(**HOT)
def read_line(model, j, t, d, line_t, line_h, line_c, line_n, Sg, p):
    """Series of the delayed output over [t, t + d] from its segment, by a shift of the series."""
    r = line_n[j, 1] % line_t.shape[1]
    c, h = line_c[j, r], line_h[j, r]
    constant = True
    for k in range(1, ORDER + 1):
        if c[k] != 0.0:
            constant = False
    if constant:
        Sg[0, j] = c[0]
        for k in range(1, ORDER + 1):
            Sg[k, j] = 0.0
        return
    _shift(c, (t - model.smooth_delay[j] - line_t[j, r, 0]) / h, p)
    f = 1.0
    for k in range(ORDER + 1):
        Sg[k, j] = p[k] * f
        f *= d / h


@njit(**HOT)
def extend_lines(model, compiled, q, X, last, Sg, H, t, d, u1, line_t, line_h, line_c, line_n, p):
    """Append what the delayed outputs did over the step just made."""
    n_s = line_n.shape[0]
    for j in range(n_s):
        if model.smooth_kind[j] != DELAY_LINE:
            continue
        size = line_t.shape[1]
        r = line_n[j, 0] % size
        w = model.smooth_w[j]
        constant = True
        for k in range(last + 1, ORDER + 1):
            line_c[j, r, k] = 0.0
        for k in range(last + 1):
            v = 0.0
            for i in range(compiled.Wx.shape[2]):
                v += compiled.Wx[q, w, i] * X[k, i]
            for i in range(n_s):
                v += compiled.Ws[q, w, i] * Sg[k, i]
            if k == 0:
                for i in range(H.size):
                    v += compiled.WH[q, w, i] * H[i]
            elif v != 0.0:
                constant = False
            line_c[j, r, k] = v
        # Where the series only goes on there was no switch: one segment more would come back as an end after every dead
        # time.
        before = (line_n[j, 0] - 1) % size
        if _continues(line_c[j, before], line_t[j, before, 0], line_h[j, before], line_c[j, r], t, d, u1, p):
            line_t[j, before, 1] = t + u1 * d
            continue
        line_t[j, r, 0], line_t[j, r, 1] = t, t + u1 * d
        line_h[j, r] = 2.0 * ALWAYS if constant else d
        line_n[j, 0] += 1


@njit(**HOT)
def _continues(old, begin, h, new, t, d, u1, p):
    """Whether a series over [t, t + u1 d] is what an earlier one, in units of h from its begin, says of it."""
    if t + u1 * d > begin + h:
        return False
    _shift(old, (t - begin) / h, p)
    f, away, size = 1.0, 0.0, 0.0
    for k in range(ORDER + 1):
        away += abs(p[k] * f - new[k])
        size += abs(new[k])
        f *= d / h
    return away <= CONTINUES * size


@njit(**HOT)
def _shift(c, u, p):
    """Coefficients of the polynomial c about u."""
    for k in range(ORDER + 1):
        p[k] = c[k]
    if u == 0.0:
        return
    # Horner's scheme, repeated: each pass takes off one factor of the new variable.
    for i in range(ORDER):
        for k in range(ORDER - 1, i - 1, -1):
            p[k] += u * p[k + 1]
