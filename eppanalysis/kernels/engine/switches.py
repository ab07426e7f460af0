"""Compiled: the rules of a switch: when a guard counts as risen, and what its element does then."""

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.modes import find_combination, is_of
from eppanalysis.kernels.engine.series import first_rise, guard_noise, term_sizes
from eppanalysis.kernels.engine.tables import HOT, INLINE


@njit(**INLINE)
def rise_from_start(compiled, q, g, X, last, Sg, H, d, recent, clock, Y, wide, p, forced):
    """First u in [0, 1] where the guard series p rises through zero, by the rules at the start; 2.0 when nowhere."""
    terms = min(6, last - 1)
    # A guard that stands on zero goes where its first derivative above rounding points. Where it falls, the zero is
    # divided out, so that the next rise is found however soon it comes (docs/theory/engine.md, Rules at a switch).
    for k in range(max(1, terms)):
        if k == 2:
            # Two terms decide nearly always; more are wanted only where the guard touches.
            term_sizes(compiled, q, X, Sg, H, d, recent, clock, 3, terms + 1, Y, wide)
        noise = guard_noise(compiled, q, g, k, Sg, H, d, Y)
        if p[k] < -noise:
            if k > 0:
                for i in range(last + 1):
                    p[i] = p[i + k]
            return first_rise(p, noise if k == 0 else 0.0)
        # Of two guards that point at each other neither fires: the short step is made in the present mode.
        if forced:
            return 2.0
        if p[k] > noise:
            return 0.0
    return 2.0


@njit(**INLINE)
def switch(model, compiled, work, q, which, x, recent, H, Sg, last, u, modes, memory, base_step):
    """Let the element of a guard that fired take its next mode; returns the new mode combination, -1 when none has a
    solution.
    """
    k = compiled.guard[q, which]
    # What has jumped over a sticking level crosses it, and resets and impulses are of the inputs before the event: all
    # is worked out before anything changes (docs/theory/engine.md, Rules at a switch).
    jumped = beyond_level(model, compiled, q, k, x, recent, H, Sg, last, u)
    strength = impulse(model, compiled, q, k, x, H, Sg, last, u)
    reset(model, compiled, q, k, x, H, Sg, last, u, modes, memory)
    new = compiled.next[q, which]
    if jumped:
        modes[model.guard_element[k]] = model.guard_bypass[k]
        new = -1
    # A place on the way that is remembered may have been given up to another combination.
    if new < 0 or not is_of(compiled, new, modes):
        new = find_combination(model, compiled, work, modes, base_step)
        if new < 0 and model.guard_bypass[k] >= 0 and not jumped:
            # Sliding along two surfaces at once has no unique solution here, so the element that arrives crosses its
            # own.
            jumped = True
            modes[model.guard_element[k]] = model.guard_bypass[k]
            new = find_combination(model, compiled, work, modes, base_step)
        if new < 0:
            return -1
        if not jumped:
            compiled.next[q, which] = new
    if strength != 0.0:
        w0 = model.first[model.guard_element[k], 1]
        for i in range(model.B.shape[0]):
            x[i] += model.B[i, w0] * strength
    settle_on_level(model, model.guard_element[k], modes, x, H)
    return new


@njit(**INLINE)
def reset(model, compiled, q, k, x, H, Sg, last, u, modes, new):
    """Memory values and mode of the element whose guard k fired."""
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
                v += c * input_at(compiled, q, z0 + b, x, H, Sg, last, u)
        new[a] = v
    for a in range(n_he):
        H[h0 + a] = new[a]
    modes[e] = model.guard_target[k]


@njit(**HOT)
def jumps_state(model, k):
    """Whether states jump at guard k's event."""
    for b in range(model.guard_impulse.shape[1]):
        if model.guard_impulse[k, b] != 0.0:
            return True
    return False


@njit(**HOT)
def impulse(model, compiled, q, k, x, H, Sg, last, u):
    """Impulse of the first output of guard k's element at its event."""
    v, z0 = 0.0, model.first[model.guard_element[k], 0]
    for b in range(model.guard_impulse.shape[1]):
        c = model.guard_impulse[k, b]
        if c != 0.0:
            v += c * input_at(compiled, q, z0 + b, x, H, Sg, last, u)
    return v


@njit(**HOT)
def input_at(compiled, q, row, x, H, Sg, last, u):
    """Input of an element (its row among all) at state x."""
    v = 0.0
    for i in range(compiled.Zx.shape[2]):
        v += compiled.Zx[q, row, i] * x[i]
    for j in range(H.size):
        v += compiled.ZH[q, row, j] * H[j]
    for j in range(Sg.shape[1]):
        c = compiled.Zs[q, row, j]
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
def beyond_level(model, compiled, q, k, x, recent, H, Sg, last, u):
    """Whether the input of guard k's element has jumped over the level on which its target would keep it."""
    e = model.guard_element[k]
    m = model.mode_first[e] + model.guard_target[k]
    if not model.mode_stick[m]:
        return False
    z0 = model.first[e, 0]
    size = abs(model.mode_level[m])
    for i in range(model.C.shape[1]):
        size += abs(model.C[z0, i]) * max(abs(x[i]), recent[i])
    return abs(input_at(compiled, q, z0, x, H, Sg, last, u) - model.mode_level[m]) > 1e-9 * size


@njit(**INLINE)
def settle_on_level(model, e, modes, x, H):
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
        # A state that is the input alone is put there exactly; of several each moves as the output of the element moves
        # it.
        if count == 1:
            x[alone] = -rest / model.C[z0, alone]
        else:
            for i in range(model.C.shape[1]):
                x[i] -= model.B[i, w0] * left / scale


@njit(**INLINE)
def record(buffer, r, x, rate, H, modes):
    """State just after an event and its rate just before, into place r of the event buffer."""
    for i in range(buffer.x.shape[1]):
        buffer.x[r, i], buffer.v[r, i] = x[i], rate[i]
    for i in range(H.size):
        buffer.H[r, i] = H[i]
    for i in range(modes.size):
        buffer.modes[r, i] = modes[i]
