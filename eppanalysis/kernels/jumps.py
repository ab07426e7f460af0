"""Compiled: what a jump does to the elements that it reaches, when an input steps or another element's output jumps.

An element takes a jump of its input as the motion from the old value straight to the new one, as its map with memory
does. One that follows its input lets go first where the jump is against its motion, at the value that it held; one that
keeps its input on a level is thrown off it. Then the jump takes place, and guards that it has passed fire, upstream
first. So the jump is tried beforehand along the cascade, each element settled before those that it acts on are looked
at: what overshoots on the way is no motion.
"""

from __future__ import annotations

from eppanalysis.kernels.compiling import njit
from eppanalysis.kernels.lanes import dot, take
from eppanalysis.kernels.modes import find_slot
from eppanalysis.kernels.switches import input_at, record, smooth_at, switch
from eppanalysis.kernels.tables import HOT, INLINE

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
    model, slots, work, room, ring, q, k, x, beyond, recent, H, Sg, last, u, modes, base_step, t, rate, count, kept
):  # fmt: skip
    """Let everything go that a jump will leave behind; returns the slot then, -1 for none, and the events in all.

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
    keep = ring.t.size
    while q >= 0:
        g = _left_behind(model, slots, work, room, q, k, x, beyond, recent, H, Sg, last, u, modes, base_step)
        # What was tried may have taken the room of this combination.
        q = find_slot(model, slots, work, modes, base_step)
        if g < 0 or q < 0:
            break
        q = switch(model, slots, work, q, place_of(slots, q, g), x, recent, H, Sg, last, u, modes, room.held, base_step)
        if kept:
            ring.t[count % keep], ring.guard[count % keep] = t, g
            record(ring, count % keep, x, rate, H, modes)
            count += 1
    return q, count


@njit(**HOT)
def place_of(slots, q, k):
    """Place of guard k in a slot."""
    for i in range(slots.n_guards[q]):
        if slots.guard[q, i] == k:
            return i
    return -1


@njit(**HOT)
def _left_behind(model, slots, work, room, q, k, x, beyond, recent, H, Sg, last, u, modes, base_step):
    """Guard of the first element along the cascade that a jump leaves behind; -1 when there is none."""
    source = model.guard_element[k] if k >= 0 else modes.size
    before, new_x, new_modes, new_H = room.before, room.then_x[1], room.then_modes, room.then_H
    for row in range(before.size):
        before[row] = input_at(slots, q, row, x, H, Sg, last, u)
    take(new_x, beyond)
    for e in range(modes.size):
        new_modes[e] = modes[e]
    for i in range(H.size):
        new_H[i] = H[i]
    new = q
    if k >= 0:
        i = place_of(slots, q, k)
        new = switch(model, slots, work, q, i, new_x, recent, new_H, Sg, last, u, new_modes, room.held, base_step)
    for e in model.order:
        if new < 0:
            return -1
        if e != source and model.reach[source, e]:
            g = _letting_go(model, slots, e, modes[e], before, new, new_x, recent, new_H, Sg, last, u)
            if g >= 0:
                return g
        if e == source or model.reach[source, e]:
            for _ in range(2 * model.mode_first[-1] + 16):
                i = _passed(model, slots, new, e, new_x, recent, new_H, Sg, last, u)
                if i < 0:
                    break
                new = switch(
                    model, slots, work, new, i, new_x, recent, new_H, Sg, last, u, new_modes, room.held, base_step
                )
                if new < 0:
                    return -1
    return -1


@njit(**HOT)
def _letting_go(model, slots, e, mode, before, new, x, recent, H, Sg, last, u):
    """Guard by which an element in a mode lets go where its inputs jump from `before` to those in slot `new`."""
    m, z0 = model.mode_first[e] + mode, model.first[e, 0]
    if not model.mode_lags[m]:
        return -1
    if model.mode_stick[m]:
        off = input_at(slots, new, z0, x, H, Sg, last, u) - model.mode_level[m]
        size = _input_size(slots, new, z0, x, recent, H) + abs(model.mode_level[m])
        return _way_off(model, m, off) if abs(off) > CLEAR * size else -1
    for k in range(model.guard_first[m], model.guard_first[m + 1]):
        change = size = 0.0
        for a in range(model.first[e + 1, 0] - z0):
            r = model.guard_rate[k, a]
            if r != 0.0:
                change += r * (input_at(slots, new, z0 + a, x, H, Sg, last, u) - before[z0 + a])
                size += abs(r) * (_input_size(slots, new, z0 + a, x, recent, H) + abs(before[z0 + a]))
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
            returns = model.mode_first[e] + model.guard_target[back] == m
            if returns and model.guard_z[back, 0] * off < 0.0:
                return k
    return -1


@njit(**HOT)
def _passed(model, slots, q, e, x, recent, H, Sg, last, u):
    """Place in slot q of a guard of an element that stands clearly above zero; -1 for none."""
    for i in range(slots.n_guards[q]):
        if model.guard_element[slots.guard[q, i]] == e and clearly_above(slots, q, i, x, recent, H, Sg, last, u):
            return i
    return -1


@njit(**HOT)
def clearly_above(slots, q, i, x, recent, H, Sg, last, u):
    """Whether a guard on inputs, held values and outputs stands clearly above zero: a jump has passed it."""
    if slots.on_rate[q, i]:
        return False
    v = dot(slots.ga[q, i], x)
    size = 0.0
    for j in range(x.size):
        size += slots.ga_size[q, i, j] * max(abs(x[j]), recent[j])
    for j in range(H.size):
        v += slots.gH[q, i, j] * H[j]
        size += abs(slots.gH[q, i, j] * H[j])
    for j in range(Sg.shape[1]):
        c = slots.gs[q, i, j]
        if c != 0.0:
            v += c * smooth_at(Sg, last, j, u)
            size += abs(c * Sg[0, j])
    return v > CLEAR * size


@njit(**HOT)
def _input_size(slots, q, row, x, recent, H):
    """Size of the terms that an element's input is added up from."""
    size = 0.0
    for i in range(slots.Zx.shape[2]):
        size += abs(slots.Zx[q, row, i]) * max(abs(x[i]), recent[i])
    for j in range(H.size):
        size += abs(slots.ZH[q, row, j] * H[j])
    return size
