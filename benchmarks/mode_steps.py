"""Matrix exponentials in fixed steps of 0.25 ms with bisection, in numba: exact steps the plain way, for one loop.

Modes, guards and their order come from the reference elbow; its affine pieces are read off by evaluating them. Every
mode gets exp(M h) and exp(M h/2), exp(M h/4), ... once. A step is one product; where a guard is above zero at its end,
bisection goes down the halves to the event, and after the switch the halves that are left lead back to the grid. An
event that comes and goes inside one step is missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg
from numba import njit
from numpy.typing import NDArray

from tests.reference.elbow_reference import Elbow, Mode

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

N = 8  # seven states and the constant 1
HALVES = 36  # 0.25 ms / 2**36 is 4e-15 s
SPEED = 3


class Tables(NamedTuple):
    """All modes that can be reached, and the state at the start (in mode 0)."""

    step: Array  # (modes, HALVES + 1, 8, 8 + guards): state, then guards, a time h / 2**k later
    target: IntArray  # (modes, guards)
    stops: IntArray  # (modes, guards): 1 where the drive stops
    start: Array  # (8,)


def _after(mode: Mode, label: str) -> Mode:
    kind, name = label.split(" ")
    if kind == "drive":
        return mode._replace(drive="stuck" if name == "stops" else name)
    return mode._replace(band=int(name)) if kind == "band" else mode._replace(**{kind: name})


def _row(value, at_zero: float) -> Array:
    """Coefficients of an affine function of the state, with its constant last."""
    return np.array([*(value(e) - at_zero for e in np.eye(N - 1)), at_zero])


def _modes(elbow: Elbow, first: Mode) -> list[Mode]:
    modes, wait = [first], [first]
    while wait:
        mode = wait.pop()
        for guard in elbow.guards(mode):
            new = _after(mode, guard.label)
            if new not in modes:
                modes.append(new)
                wait.append(new)
    return modes


def _exponentials(M: Array, h: float) -> Array:
    """exp(M h / 2**k) for all k: the first ones by Pade approximation, then by Taylor's series."""
    sizes = h / 2.0 ** np.arange(HALVES + 1)
    out = np.zeros((sizes.size, N, N))
    out[:4] = scipy.linalg.expm(sizes[:4, None, None] * M)
    out[4:] = term = np.eye(N)
    for k in range(1, 20):
        term = term @ (sizes[4:, None, None] * M) / k
        out[4:] += term
    return out


def tables(elbow: Elbow, h: float) -> Tables:
    """Tables for the step `h` [s]."""
    y0, first = elbow.start()
    modes = _modes(elbow, first)
    zero, most = np.zeros(N - 1), max(len(elbow.guards(m)) for m in modes)
    step = np.zeros((len(modes), HALVES + 1, N, N + most))
    target, stops = np.zeros((len(modes), most), np.int64), np.zeros((len(modes), most), np.int64)
    for i, mode in enumerate(modes):
        M, at_zero = np.zeros((N, N)), elbow.rate(0.0, zero, mode)
        M[: N - 1, N - 1] = at_zero
        for j, e in enumerate(np.eye(N - 1)):
            M[: N - 1, j] = elbow.rate(0.0, e, mode) - at_zero
        rows = np.zeros((most, N))
        for g, guard in enumerate(elbow.guards(mode)):
            rows[g] = _row(lambda y, f=guard.value: f(0.0, y), guard.value(0.0, zero))
            target[i, g] = modes.index(_after(mode, guard.label))
            stops[i, g] = guard.label == "drive stops"
        for k, flow in enumerate(_exponentials(M, h)):
            step[i, k] = np.vstack([flow, rows @ flow]).T
    return Tables(step, target, stops, np.append(y0, 1.0))


@njit(cache=True, nogil=True)
def _advance(step, x, out):
    """State and guards one step on; the first guard above zero, or -1."""
    size = out.size
    for i in range(size):
        out[i] = 0.0
    for j in range(N):
        v = x[j]
        for i in range(size):
            out[i] += step[j, i] * v
    for i in range(N, size):
        if out[i] > 0.0:
            return i - N
    return -1


@njit(cache=True, nogil=True)
def _take(x, out):
    for i in range(N):
        x[i] = out[i]


@njit(cache=True, nogil=True)
def _down_the_halves(steps, x, out, left):
    """Take the halves that fit and stay free of events; what is left, in smallest parts."""
    for k in range(1, HALVES + 1):
        size = 1 << (HALVES - k)
        if size <= left and _advance(steps[k], x, out) < 0:
            _take(x, out)
            left -= size
    return left


@njit(cache=True, nogil=True)
def bisect_modes(tables, n_samples, every, states):
    """State at every `every`-th step into `states` (n_samples, 8); the number of events."""
    x, out = tables.start.copy(), np.empty(tables.step.shape[3])
    mode, events, whole = 0, 0, 1 << HALVES
    states[0] = x
    for s in range(1, n_samples):
        for _ in range(every):
            if _advance(tables.step[mode, 0], x, out) < 0:
                _take(x, out)
                continue
            left = whole
            while left > 0:
                left = _down_the_halves(tables.step[mode], x, out, left)
                if left == 0:
                    break
                # The smallest part leads to just behind the event.
                g = _advance(tables.step[mode, HALVES], x, out)
                _take(x, out)
                left -= 1
                if g >= 0:
                    if tables.stops[mode, g]:
                        x[SPEED] = 0.0
                    mode = tables.target[mode, g]
                    events += 1
        states[s] = x
    return events
