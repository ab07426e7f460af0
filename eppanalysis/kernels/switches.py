"""Compiled: the rules of a switch: when a guard counts as risen, and what its element does then."""

from __future__ import annotations

from numba import njit

from eppanalysis.kernels.series import first_rise, guard_noise, term_sizes
from eppanalysis.kernels.tables import HOT, INLINE


@njit(**INLINE)
def rise_from_start(slots, q, g, X, last, Sg, H, d, recent, clock, Y, wide, p, forced):
    """First u in [0, 1] where the guard series p rises through zero, by the rules at the start; 2.0 when nowhere."""
    terms = min(6, last - 1)
    for k in range(max(1, terms)):
        if k == 2:
            # Two terms decide nearly always; more are wanted only where the guard touches.
            term_sizes(slots, q, X, Sg, H, d, recent, clock, 3, terms + 1, Y, wide)
        noise = guard_noise(slots, q, g, k, Sg, H, d, Y)
        if p[k] < -noise:
            if k > 0:
                for i in range(last + 1):
                    p[i] = p[i + k]
            return first_rise(p, noise if k == 0 else 0.0)
        if forced:
            return 2.0
        if p[k] > noise:
            return 0.0
    return 2.0


@njit(**INLINE)
def reset(model, slots, q, k, x, H, Sg, last, u, modes, new):
    """Held values and mode of the element whose guard k fired."""
    e = model.guard_element[k]
    z0, h0 = model.first[e, 0], model.first[e, 2]
    n_ze, n_he = model.first[e + 1, 0] - z0, model.first[e + 1, 2] - h0
    for a in range(n_he):
        v = model.reset_0[k, a]
        for b in range(n_he):
            v += model.reset_h[k, a, b] * H[h0 + b]
        for b in range(n_ze):
            c = model.reset_z[k, a, b]
            if c != 0.0:
                v += c * _input(slots, q, z0 + b, x, H, Sg, last, u)
        new[a] = v
    for a in range(n_he):
        H[h0 + a] = new[a]
    modes[e] = model.guard_target[k]


@njit(**HOT)
def _input(slots, q, row, x, H, Sg, last, u):
    v = 0.0
    for i in range(slots.Zx.shape[2]):
        v += slots.Zx[q, row, i] * x[i]
    for j in range(H.size):
        v += slots.ZH[q, row, j] * H[j]
    for j in range(Sg.shape[1]):
        c = slots.Zs[q, row, j]
        if c != 0.0:
            v += c * smooth_at(Sg, last, j, u)
    return v


@njit(**INLINE)
def smooth_at(Sg, last, j, u):
    """Smooth channel j at place u of its series."""
    v = 0.0
    for k in range(last, -1, -1):
        v = v * u + Sg[k, j]
    return v


@njit(**INLINE)
def beyond_level(model, slots, q, k, x, recent, H, Sg, last, u):
    """Whether the input of guard k's element has jumped over the level on which its target would keep it."""
    e = model.guard_element[k]
    m = model.mode_first[e] + model.guard_target[k]
    if not model.mode_stick[m]:
        return False
    z0 = model.first[e, 0]
    size = abs(model.mode_level[m])
    for i in range(model.C.shape[1]):
        size += abs(model.C[z0, i]) * max(abs(x[i]), recent[i])
    return abs(_input(slots, q, z0, x, H, Sg, last, u) - model.mode_level[m]) > 1e-9 * size


@njit(**INLINE)
def settle_on_level(model, slots, q, e, modes, x, H):
    """Put the input of a sticking element exactly on its level, which the event located to rounding."""
    m = model.mode_first[e] + modes[e]
    if model.mode_stick[m]:
        z0, w0 = model.first[e, 0], model.first[e, 1]
        rest, alone, count, scale = -model.mode_level[m], -1, 0, 0.0
        for j in range(H.size):
            rest += model.Kz[z0, j] * H[j]
        left = rest
        for i in range(model.C.shape[1]):
            c = model.C[z0, i]
            if c != 0.0:
                left += c * x[i]
                scale += c * model.B[i, w0]
                alone, count = i, count + 1
        if count == 1:
            x[alone] = -rest / model.C[z0, alone]
        else:
            for i in range(model.C.shape[1]):
                x[i] -= model.B[i, w0] * left / scale
