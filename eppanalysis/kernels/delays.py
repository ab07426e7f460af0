"""Compiled: the memory of dead times, a ring of Taylor series of each delayed output.

Every step that a run makes leaves the series of the delayed outputs behind; a later step reads them back, shifted to
where it stands, and may reach no further than the segment that it reads.
"""

from __future__ import annotations

from numba import njit

from eppanalysis.kernels.series import DELAY_LINE, ORDER
from eppanalysis.kernels.tables import HOT

#: Segments that are remembered.
LINE_CAPACITY = 8192


@njit(**HOT)
def start_lines(model, slots, q, x, H, line_t, line_h, line_c, line_n):
    """Before the start a delayed output has had its value at the start for ever."""
    for j in range(line_n.shape[0]):
        if model.smooth_kind[j] != DELAY_LINE:
            continue
        w = model.smooth_w[j]
        v = 0.0
        for i in range(slots.Wx.shape[2]):
            v += slots.Wx[q, w, i] * x[i]
        for i in range(H.size):
            v += slots.WH[q, w, i] * H[i]
        line_t[j, 0, 0], line_t[j, 0, 1] = -1e300, 0.0
        line_c[j, 0, :] = 0.0  # what an earlier run left there
        line_c[j, 0, 0] = v
        line_n[j, 0], line_n[j, 1] = 1, 0


@njit(**HOT)
def line_room(model, j, t, d, line_t, line_h, line_n):
    """How far the segment that holds t - delay reaches; -1 when history was overwritten."""
    size = line_t.shape[1]
    late = t - model.smooth_delay[j]
    slack = 1e-14 * max(abs(t), abs(late))
    while line_n[j, 1] < line_n[j, 0] - 1 and line_t[j, line_n[j, 1] % size, 1] <= late + slack:
        line_n[j, 1] += 1
    if line_n[j, 0] - line_n[j, 1] > size:
        return -1.0
    if line_n[j, 1] == line_n[j, 0] - 1:
        # The newest segment ends now: a step within the delay stays behind it.
        return min(d, max(line_t[j, line_n[j, 1] % size, 1] - late, 0.0)) if late < t - slack else d
    return min(d, line_t[j, line_n[j, 1] % size, 1] - late)


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
    u = (t - model.smooth_delay[j] - line_t[j, r, 0]) / h
    for k in range(ORDER + 1):
        p[k] = c[k]
    for i in range(ORDER):
        for k in range(ORDER - 1, i - 1, -1):
            p[k] += u * p[k + 1]
    f = 1.0
    for k in range(ORDER + 1):
        Sg[k, j] = p[k] * f
        f *= d / h


@njit(**HOT)
def extend_lines(model, slots, q, X, last, Sg, H, t, d, u1, line_t, line_h, line_c, line_n):
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
            for i in range(slots.Wx.shape[2]):
                v += slots.Wx[q, w, i] * X[k, i]
            for i in range(n_s):
                v += slots.Ws[q, w, i] * Sg[k, i]
            if k == 0:
                for i in range(H.size):
                    v += slots.WH[q, w, i] * H[i]
            elif v != 0.0:
                constant = False
            line_c[j, r, k] = v
        before = (line_n[j, 0] - 1) % size
        if constant and line_c[j, before, 0] == line_c[j, r, 0]:
            flat = True
            for k in range(1, ORDER + 1):
                if line_c[j, before, k] != 0.0:
                    flat = False
            if flat:
                line_t[j, before, 1] = t + u1 * d
                continue
        line_t[j, r, 0], line_t[j, r, 1] = t, t + u1 * d
        line_h[j, r] = d
        line_n[j, 0] += 1
