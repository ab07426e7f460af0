"""Compiled: what a jump does to the elements that it reaches, when an input steps or another element's output jumps.

An element takes a jump of its input as the motion from the old value straight to the new one, as its map with memory
does. One that follows its input lets go first where the jump is against its motion, at the value that it held; one that
keeps its input on a level is thrown off it. Then the jump takes place, and guards that it has passed fire, upstream
first. So the jump is tried beforehand along the cascade, each element settled before those that it acts on are looked
at: what overshoots on the way is no motion.
"""

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.engine.modes import find_combination
from eppanalysis.kernels.engine.switches import input_at, record, smooth_at, switch
from eppanalysis.kernels.engine.tables import HOT, INLINE
from eppanalysis.kernels.simd.vectors import dot, take

#: Relative size of a change that is a jump, and of a guard's value beyond zero that is no rounding.
CLEAR = 1e-9


@njit(**INLINE)
def may_leave_behind(model, modes, source):
    """Whether a jump of an element's output (of external inputs: the number behind the last) can leave one behind."""
    for e in range(modes.size):
        if model.reach[source, e] and model.mode_lags[model.mode_first[e] + modes[e]]:
            return True
    return False


@njit(**HOT)
def let_go(
    model, compiled, work, workspace, buffer, q, k, x, beyond, recent, H, Sg, last, u, modes, base_step, t, rate,
    count, kept
):  # fmt: skip
    """Let everything go that a jump will leave behind; returns the mode combination then, -1 for none, and the events
    in all.

    Parameters
    ----------
    k : int
        Guard at whose event the jump takes place, -1 for a jump of external inputs.
    x, beyond : arrays (n+,)
        State, and that behind a jump of external inputs (the same otherwise).
    last, u : int, float
        Place on the series of the smooth channels.
    kept : bool
        Whether events are kept.
    """
    keep = buffer.t.size
    while q >= 0:
        g = _left_behind(model, compiled, work, workspace, q, k, x, beyond, recent, H, Sg, last, u, modes, base_step)
        # The trial switches may have overwritten this mode combination in the table.
        q = find_combination(model, compiled, work, modes, base_step)
        if g < 0 or q < 0:
            break
        q = switch(
            model, compiled, work, q, place_of(compiled, q, g), x, recent, H, Sg, last, u, modes, workspace.memory,
            base_step
        )  # fmt: skip
        if kept:
            buffer.t[count % keep], buffer.guard[count % keep] = t, g
            record(buffer, count % keep, x, rate, H, modes)
            count += 1
    return q, count


@njit(**HOT)
def place_of(compiled, q, k):
    """Place of guard k in a mode combination."""
    for i in range(compiled.n_guards[q]):
        if compiled.guard[q, i] == k:
            return i
    return -1


@njit(**HOT)
def _left_behind(model, compiled, work, workspace, q, k, x, beyond, recent, H, Sg, last, u, modes, base_step):
    """Guard of the first element along the cascade that a jump leaves behind; -1 when there is none."""
    source = model.guard_element[k] if k >= 0 else modes.size
    before, new_x, new_modes, new_H = workspace.before, workspace.then_x[1], workspace.then_modes, workspace.then_H
    for row in range(before.size):
        before[row] = input_at(compiled, q, row, x, H, Sg, last, u)
    take(new_x, beyond)
    for e in range(modes.size):
        new_modes[e] = modes[e]
    for i in range(H.size):
        new_H[i] = H[i]
    # All on copies: what the jump would do is tried to its end before anything is allowed to happen
    # (docs/theory/simulation.md, rules of a jump).
    new = q
    if k >= 0:
        i = place_of(compiled, q, k)
        new = switch(
            model, compiled, work, q, i, new_x, recent, new_H, Sg, last, u, new_modes, workspace.memory, base_step
        )
    for e in model.order:
        if new < 0:
            return -1
        if e != source and model.reach[source, e]:
            g = _letting_go(model, compiled, e, modes[e], before, new, new_x, recent, new_H, Sg, last, u)
            if g >= 0:
                return g
        # Settled before those downstream are looked at; more passages than there are modes go in a circle.
        if e == source or model.reach[source, e]:
            for _ in range(2 * model.mode_first[-1] + 16):
                i = _passed(model, compiled, new, e, new_x, recent, new_H, Sg, last, u)
                if i < 0:
                    break
                new = switch(
                    model, compiled, work, new, i, new_x, recent, new_H, Sg, last, u, new_modes, workspace.memory,
                    base_step
                )  # fmt: skip
                if new < 0:
                    return -1
    return -1


@njit(**HOT)
def _letting_go(model, compiled, e, mode, before, new, x, recent, H, Sg, last, u):
    """Guard by which an element in a mode lets go where its inputs jump from `before` to those in combination `new`."""
    m, z0 = model.mode_first[e] + mode, model.first[e, 0]
    if not model.mode_lags[m]:
        return -1
    # Held on a level, it is thrown off where the jump ends beyond it by more than rounding.
    if model.mode_stick[m]:
        off = input_at(compiled, new, z0, x, H, Sg, last, u) - model.mode_level[m]
        size = _input_size(compiled, new, z0, x, recent, H) + abs(model.mode_level[m])
        return _way_off(model, m, off) if abs(off) > CLEAR * size else -1
    for k in range(model.guard_first[m], model.guard_first[m + 1]):
        change = size = 0.0
        for a in range(model.first[e + 1, 0] - z0):
            r = model.guard_rate[k, a]
            if r != 0.0:
                change += r * (input_at(compiled, new, z0 + a, x, H, Sg, last, u) - before[z0 + a])
                size += abs(r) * (_input_size(compiled, new, z0 + a, x, recent, H) + abs(before[z0 + a]))
        # A jump has no rate: the guard on rates sees the way from the old value to the new one in its place.
        if change > CLEAR * size:
            return k
    return -1


@njit(**HOT)
def _way_off(model, m, off):
    """Guard of a sticking mode that leads to the mode on the side to which its input has been thrown off the level."""
    for k in range(model.guard_first[m], model.guard_first[m + 1]):
        e = model.guard_element[k]
        beyond = model.mode_first[e] + model.guard_target[k]
        for back in range(model.guard_first[beyond], model.guard_first[beyond + 1]):
            # The side beyond a guard is the one from which a guard leads back here as the input comes down to the
            # level.
            returns = model.mode_first[e] + model.guard_target[back] == m
            if returns and model.guard_z[back, 0] * off < 0.0:
                return k
    return -1


@njit(**HOT)
def _passed(model, compiled, q, e, x, recent, H, Sg, last, u):
    """Place in combination q of a guard of an element that stands clearly above zero; -1 for none."""
    for i in range(compiled.n_guards[q]):
        if model.guard_element[compiled.guard[q, i]] == e and clearly_above(compiled, q, i, x, recent, H, Sg, last, u):
            return i
    return -1


@njit(**HOT)
def clearly_above(compiled, q, i, x, recent, H, Sg, last, u):
    """Whether a guard on inputs, memory values and outputs stands clearly above zero: a jump has passed it."""
    if compiled.on_rate[q, i]:
        return False
    v = dot(compiled.ga[q, i], x)
    size = 0.0
    for j in range(x.size):
        size += compiled.ga_size[q, i, j] * max(abs(x[j]), recent[j])
    for j in range(H.size):
        v += compiled.gH[q, i, j] * H[j]
        size += abs(compiled.gH[q, i, j] * H[j])
    for j in range(Sg.shape[1]):
        c = compiled.gs[q, i, j]
        if c != 0.0:
            v += c * smooth_at(Sg, last, j, u)
            size += abs(c * Sg[0, j])
    return v > CLEAR * size


@njit(**HOT)
def _input_size(compiled, q, row, x, recent, H):
    """Size of the terms that an element's input is added up from."""
    size = 0.0
    for i in range(compiled.Zx.shape[2]):
        size += abs(compiled.Zx[q, row, i]) * max(abs(x[i]), recent[i])
    for j in range(H.size):
        size += abs(compiled.ZH[q, row, j] * H[j])
    return size
