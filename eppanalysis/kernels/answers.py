"""Compiled: Fourier coefficients of an element's outputs in its periodic regime, and their derivatives.

The sums are those of docs/theory/harmonic_balance.md, Coefficients without sampling. Unknowns are the mean, the real
and the imaginary parts of the input's coefficients, and the frequency: 2 n + 2 at order n. A period has pieces, one
more than switches; the first begins where the period does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.periodic import TURN, series_at, settle_part
from eppanalysis.kernels.simd.tuples import by_address, tuple_at

_COMPILED = {**KERNEL, "error_model": "numpy"}
_INNER = {**PART, "error_model": "numpy"}
#: Share of the outputs below which a jump is rounding; slowest rise of a guard: one that grazes moves without bound.
_NO_JUMP, _GRAZES = 1e-14, 1e-300


@by_address
class Pieces(NamedTuple):
    """What a period consists of, with s switches, h memory values, w outputs."""

    edges: Array  # (s + 2,) phases: begin, switches, end
    modes: IntArray  # (s + 1,)
    memory: Array  # (s + 1, h)
    fired: IntArray  # (s,) mode guards in the table


@njit(**_INNER)
def _means(pieces, p, n, wave):
    """Mean over a period of exp(-j q phi) on a piece, q = 0..2 n, into `wave`."""
    low, high = pieces.edges[p], pieces.edges[p + 1]
    wave[0] = (high - low) / TURN
    for q in range(1, 2 * n + 1):
        real = math.cos(low * q) - math.cos(high * q)
        imaginary = math.sin(high * q) - math.sin(low * q)
        size = TURN * q
        wave[q] = complex(imaginary / size, -real / size)


@njit(**_INNER)
def _level(table, pieces, p, o):
    """What an output has on a piece besides its input."""
    mode = pieces.modes[p]
    level = table.w_constant[mode, o]
    for h in range(pieces.memory.shape[1]):
        level += table.w_memory[mode, o, h] * pieces.memory[p, h]
    return level


@njit(**_INNER)
def _product(S, n, k, m):
    """What real and imaginary part m of a series are to coefficient k of its product with a real function S."""
    # A real series has a wave at m and one at -m: what S has at k - m and at k + m brings them to k. The mean is no
    # pair.
    q = k - m
    minus = S[q] if q >= 0 else S[-q].conjugate()
    plus = S[k + m]
    share = 1.0 if k else 0.5
    turned = share * (minus - plus)
    return share * (minus + plus), complex(-turned.imag, turned.real)


@njit(**_INNER)
def _convolved(S, n, k, z, factor):
    """Coefficient k of the product of S and a series, of which the mean is real; or of its derivative (factor j m)."""
    total = complex(0.0, 0.0)
    for m in range(n + 1):
        by_real, by_imaginary = _product(S, n, k, m)
        real, imaginary = z[m].real, z[m].imag
        if factor:
            real, imaginary = -m * z[m].imag, m * z[m].real
        total += by_real * real
        if m:
            total += by_imaginary * imaginary
    return total


@njit(**_INNER)
def _coefficients(table, pieces, z, omega, W, S, R):
    """Add the coefficients of the outputs W, and of the functions S and R that input and rate are multiplied with."""
    n, n_w, wave = z.size - 1, W.shape[0], np.empty(2 * z.size - 1, np.complex128)
    for p in range(pieces.modes.size):
        mode = pieces.modes[p]
        _means(pieces, p, n, wave)
        for o in range(n_w):
            free, rate = table.w_free[mode, o], table.w_rate[mode, o]
            for q in range(2 * n + 1):
                S[o, q] += free * wave[q]
                R[o, q] += rate * wave[q]
            level = _level(table, pieces, p, o)
            W[o, 0] += level * wave[0]
            for k in range(1, n + 1):
                W[o, k] += 2.0 * level * wave[k]
    for o in range(n_w):
        for k in range(n + 1):
            W[o, k] += _convolved(S[o], n, k, z, False) + omega * _convolved(R[o], n, k, z, True)


@njit(**_INNER)
def _answer(table, z, omega, mode, clocked, rest):
    """What an element that is affine between its switches makes of an input; arguments are those of :func:`settle`.

    Returns
    -------
    regime : tuple
        As :func:`settle`.
    pieces : Pieces
        Of the period, where there is one.
    sums : complex arrays W, S, R, shapes (w, n + 1), (w, 2 n + 1), (w, 2 n + 1)
        Coefficients of the outputs, and of the functions that their input and its rate are multiplied with.
    """
    regime = settle_part(table, z, omega, mode, clocked, rest)
    count, there, start, begun, at, fired, holds = regime
    s, n_w = at.size, table.w_constant.shape[1]
    edges, modes, memory = np.empty(s + 2), np.empty(s + 1, np.int64), np.empty((s + 1, begun.size))
    edges[0], edges[s + 1], modes[0], memory[0] = start, start + TURN, there, begun
    for i in range(s):
        edges[i + 1], modes[i + 1], memory[i + 1] = at[i], table.target[fired[i]], holds[i]
    pieces = Pieces(edges, modes, memory, fired)
    W = np.zeros((n_w, z.size), np.complex128)
    S, R = np.zeros((n_w, 2 * z.size - 1), np.complex128), np.zeros((n_w, 2 * z.size - 1), np.complex128)
    if count >= 0:
        _coefficients(table, pieces, z, omega, W, S, R)
    return regime, pieces, (W, S, R)


@njit(**_INNER)
def _value(c, phi, power):
    """Value at a phase of a series without its mean, differentiated `power` times (1 or 2)."""
    total = 0.0
    for k in range(1, c.size):
        angle = k * phi
        cosine, sine = math.cos(angle), math.sin(angle)
        if power == 1:
            total -= k * (c[k].real * sine + c[k].imag * cosine)
        else:
            total -= k * k * (c[k].real * cosine - c[k].imag * sine)
    return total


@njit(**_INNER)
def _read(free, rate, clock, z, omega, phi, by_x):
    """Derivatives of an affine function of the inputs at a phase, by the unknowns into `by_x`, and by the phase."""
    n = z.size - 1
    slope, curve = _value(z, phi, 1), _value(z, phi, 2)
    for k in range(n + 1):
        cosine, sine = math.cos(k * phi), math.sin(k * phi)
        by_x[k] = free * cosine - omega * rate * k * sine
        if k:
            by_x[n + k] = -free * sine - omega * rate * k * cosine
    by_x[2 * n + 1] = rate * slope - clock * phi / (omega * omega)
    return free * slope + omega * rate * curve + clock / omega


@njit(**_INNER)
def _jumps(table, pieces, z, omega, jump):
    """Add the jumps of the outputs at the switches to those of smooth functions; returns whether there are any."""
    n_w = jump.shape[1]
    largest, level = 0.0, 0.0
    for p in range(pieces.modes.size):
        for o in range(n_w):
            level = max(level, abs(_level(table, pieces, p, o)))
    for i in range(pieces.fired.size):
        value, slope = series_at(z, pieces.edges[i + 1])
        before, after = pieces.modes[i], pieces.modes[i + 1]
        for o in range(n_w):
            old = table.w_free[before, o] * value + table.w_rate[before, o] * (omega * slope)
            new = table.w_free[after, o] * value + table.w_rate[after, o] * (omega * slope)
            old, new = old + _level(table, pieces, i, o), new + _level(table, pieces, i + 1, o)
            jump[i, o] += new - old
            largest = max(largest, abs(jump[i, o]))
    return largest > _NO_JUMP * (level + largest)


@njit(**_INNER)
def _reset(table, g, h, z, omega, phi, by_x):
    """As :func:`_read`, of what a mode guard writes into a memory value."""
    free, rate, clock = 0.0, 0.0, 0.0
    for i in range(table.roles.size):
        part = table.from_input[g, h, i]
        if table.roles[i] == 0:
            free += part
        elif table.roles[i] == 1:
            rate += part
        else:
            clock += part
    return _read(free, rate, clock, z, omega, phi, by_x)


@njit(**_INNER)
def _pass_on(table, pieces, z, omega, i, here, moved, memory, by_x):
    """Derivatives of the memory values behind a switch, `memory` (h, x), from those before it, `here`."""
    g = pieces.fired[i]
    for h in range(here.shape[0]):
        by_phase = _reset(table, g, h, z, omega, pieces.edges[i + 1], by_x)
        for x in range(by_x.size):
            new = by_x[x] + by_phase * moved[i, x]
            for other in range(here.shape[0]):
                new += table.from_memory[g, h, other] * here[other, x]
            memory[h, x] = new


@njit(**_INNER)
def _move(table, pieces, z, omega, here, moved, memory, by_x):
    """Derivatives of the switching phases, (s, x), and of the memory values on each piece, (s + 1, h, x).

    `here` (h, x) holds the latter at the beginning, and afterwards at the end.
    """
    clocked = False
    for g in range(table.on_clock.size):
        clocked = clocked or table.on_clock[g] != 0.0
    for h in range(here.shape[0]):
        for x in range(moved.shape[1]):
            memory[0, h, x] = here[h, x]
    for i in range(pieces.fired.size):
        g, phi = pieces.fired[i], pieces.edges[i + 1]
        # Of switches at one phase the later ones move with the first: they do not wait for a zero of their own guard.
        if i and phi == pieces.edges[i]:
            for x in range(moved.shape[1]):
                moved[i, x] = moved[i - 1, x]
        else:
            speed = _read(table.on_free[g], table.on_rate[g], table.on_clock[g], z, omega, phi, moved[i])
            # The guard stays zero where its switch moves: by the implicit function theorem the phase moves by minus the
            # guard's derivative over its rate (docs/theory/harmonic_balance.md, Coefficients without sampling).
            speed = speed if abs(speed) > _GRAZES else _GRAZES
            for x in range(moved.shape[1]):
                for h in range(here.shape[0]):
                    moved[i, x] += table.on_memory[g, h] * memory[i, h, x]
                moved[i, x] = -moved[i, x] / speed
        _pass_on(table, pieces, z, omega, i, memory[i], moved, memory[i + 1], by_x)
    for h in range(here.shape[0]):
        for x in range(moved.shape[1]):
            here[h, x] = memory[pieces.fired.size, h, x]
        if clocked:
            # Times count from the begin of a period: in the next one a time that is kept has become less by 2 pi/omega.
            here[h, moved.shape[1] - 1] += TURN / (omega * omega)


@njit(**_INNER)
def _add_moved(pieces, jump, moved, dW):
    """What moving switches contribute: one that comes later keeps the old output for so long."""
    for i in range(pieces.fired.size):
        for k in range(dW.shape[1]):
            angle, share = k * pieces.edges[i + 1], (1.0 if k else 0.5) / math.pi
            cosine, sine = share * math.cos(angle), share * math.sin(angle)
            for o in range(dW.shape[0]):
                real, imaginary = -jump[i, o] * cosine, jump[i, o] * sine
                for x in range(dW.shape[2]):
                    dW[o, k, x] += complex(real * moved[i, x], imaginary * moved[i, x])


@njit(**_INNER)
def _add_memory(table, pieces, memory, wave, dW):
    """What memory values contribute where they act."""
    n = dW.shape[1] - 1
    for p in range(pieces.modes.size):
        _means(pieces, p, n, wave)
        for o in range(dW.shape[0]):
            for h in range(memory.shape[1]):
                on = table.w_memory[pieces.modes[p], o, h]
                if on != 0.0:
                    for k in range(n + 1):
                        share = on * wave[k] * (2.0 if k else 1.0)
                        for x in range(dW.shape[2]):
                            dW[o, k, x] += share * memory[p, h, x]


@njit(**_INNER)
def _slopes(table, pieces, z, omega, S, R, jump, at_rest):
    """Derivatives (w, n + 1, 2 n + 2) of the coefficients of the outputs by the unknowns.

    Parameters
    ----------
    table, pieces, z, omega
        Of an :func:`answer`.
    S, R : complex array, shape (w, 2 n + 1)
        Functions that small changes of the input and of its rate are multiplied with.
    jump : array, shape (s, w)
        Of smooth functions at the switches; those of the outputs are added.
    at_rest : array, shape (h,)
        Derivatives of the memory values by the mean of the input, where nothing switches.
    """
    n, n_w, n_x = z.size - 1, len(S), 2 * z.size
    n_switches, n_memory = pieces.fired.size, at_rest.size
    dW, moved, wave = (
        np.empty((n_w, n + 1, n_x), np.complex128),
        np.zeros((n_switches, n_x)),
        np.empty(n_x - 1, np.complex128),
    )
    memory, work = np.zeros((n_switches + 1, n_memory, n_x)), np.zeros((n_memory + 1, n_x))
    memory[0, :, 0] = at_rest
    for o in range(n_w):
        for k in range(n + 1):
            for m in range(n + 1):
                by_real, by_imaginary = _product(S[o], n, k, m)
                # A real part adds j m omega, an imaginary part -m omega to the rate's coefficient.
                rate_real, rate_imaginary = _product(R[o], n, k, m)
                dW[o, k, m] = by_real + omega * m * rate_imaginary
                if m:
                    dW[o, k, n + m] = by_imaginary - omega * m * rate_real
            dW[o, k, n_x - 1] = _convolved(R[o], n, k, z, True)
    # Where the output is continuous a moving switch changes nothing to first order.
    if n_switches and (_jumps(table, pieces, z, omega, jump) or n_memory):
        # Twice round: what memory holds at the begin was written in the period before, whose derivatives the first turn
        # finds.
        for _ in range(2 if n_memory else 1):
            _move(table, pieces, z, omega, work[1:], moved, memory, work[0])
        _add_moved(pieces, jump, moved, dW)
    if n_memory:
        _add_memory(table, pieces, memory, wave, dW)
    return dW


@njit(**_INNER)
def _jacobian(dW, W, L, dL, on_bias, on_mean, pivot):
    """Derivatives of the equations of a balance by its unknowns, both of number F (2 n + 1) + 1.

    Parameters
    ----------
    dW, W : complex array, shapes (w, n + 1, F (2 n + 1) + 1), (w, n + 1)
        Coefficients of the outputs and their derivatives.
    L, dL : complex array, shape (n, F, w)
        Responses from outputs to inputs at the harmonics, and their derivatives by the frequency.
    on_bias, on_mean : array, shapes (F, F), (F, w)
        Static balance.
    pivot : int
        The input that is in sine phase.
    """
    n, F, n_w = L.shape
    width, last = 2 * n + 1, dW.shape[2] - 1
    J = np.zeros((last + 1, last + 1))
    for f in range(F):
        for j in range(n_w):
            share = on_mean[f, j]
            if share != 0.0:
                for x in range(last + 1):
                    J[f, x] += share * dW[j, 0, x].real
        for g in range(F):
            J[f, g * width] += on_bias[f, g]
        for k in range(n):
            real, imaginary = F + f * n + k, F + (F + f) * n + k
            for j in range(n_w):
                response = L[k, f, j]
                if response != 0.0:
                    for x in range(last + 1):
                        value = response * dW[j, k + 1, x]
                        J[real, x] -= value.real
                        J[imaginary, x] -= value.imag
                value = dL[k, f, j] * W[j, k + 1]
                J[real, last] -= value.real
                J[imaginary, last] -= value.imag
            J[real, f * width + 1 + k] += 1.0
            J[imaginary, f * width + n + 1 + k] += 1.0
    J[last, pivot * width + 1] = 1.0
    return J


@njit(**_COMPILED)
def answer(table, z, omega, mode, clocked, rest):
    """See :func:`_answer`; for one element alone, as the next one."""
    return _answer(table, z, omega, mode, clocked, rest)


@njit(**_COMPILED)
def slopes(table, pieces, z, omega, S, R, jump, at_rest):
    """See :func:`_slopes`."""
    return _slopes(table, pieces, z, omega, S, R, jump, at_rest)


@njit(**_COMPILED)
def jacobian(dW, W, L, dL, on_bias, on_mean, pivot):
    """See :func:`_jacobian`."""
    return _jacobian(dW, W, L, dL, on_bias, on_mean, pivot)


class Automata(NamedTuple):
    """The elements of a loop, all of one input and affine between their switches."""

    like: NamedTuple  # the table of any of them
    tables: np.ndarray  # frames of all tables
    modes: IntArray  # (F,): at the start
    clocked: np.ndarray  # (F,) bool
    first: IntArray  # (F + 1, 2): first output, and first memory value, of each


@njit(**_COMPILED)
def equations(automata, rest, X, linear, means, pivot, J, R, W, switches):
    """The equations of a balance at its unknowns X, mean, real and imaginary parts of each input, and omega at last.

    Where there is no room for a Jacobian, what the elements put out alone.

    Parameters
    ----------
    automata : Automata
    rest : array
        Memory values of all elements at rest.
    linear : tuple of complex arrays L, dL, shape (n, F, w)
        As of :func:`jacobian`.
    means : tuple of arrays on_bias, on_mean, prescribed, shapes (F, F), (F, w), (F,)
        Static balance.
    J, R, W, switches : arrays, shapes (x, x), (x,), (w, n + 1), (F,)
        Are filled with the Jacobian, the residual, the coefficients of the outputs, and the number of switches of each
        element in a period.

    Returns
    -------
    bool
        Whether each element answers periodically, and none whose slope is asked for rests with a value that it holds.
    """
    (L, dL), (on_bias, on_mean, prescribed) = linear, means
    n, F, _ = L.shape
    width, last, omega = 2 * n + 1, X.size - 1, X[-1]
    Z, dW = np.empty((F, n + 1), np.complex128), np.zeros((len(W), n + 1, X.size), np.complex128)
    for f in range(F):
        at, out, end = f * width, automata.first[f, 0], automata.first[f + 1, 0]
        Z[f, 0] = X[at]
        for k in range(1, n + 1):
            Z[f, k] = complex(X[at + k], X[at + n + k])
        table, begun = (
            tuple_at(automata.like, automata.tables, f),
            rest[automata.first[f, 1] : automata.first[f + 1, 1]],
        )
        regime, pieces, sums = _answer(table, Z[f], omega, automata.modes[f], automata.clocked[f], begun)
        W[out:end], switches[f] = sums[0], pieces.fired.size
        if regime[0] < 0 or (J.size > 0 and begun.size > 0 and switches[f] == 0):
            return False
        if J.size == 0:
            continue
        jump, at_rest = np.zeros((switches[f], end - out)), np.zeros(begun.size)
        slope = _slopes(table, pieces, Z[f], omega, sums[1], sums[2], jump, at_rest)
        dW[out:end, :, at : at + width] = slope[:, :, :-1]
        dW[out:end, :, last] = slope[:, :, -1]
    if J.size == 0:
        return True
    J[:] = _jacobian(dW, W, L, dL, on_bias, on_mean, pivot)
    for f in range(F):
        static = -prescribed[f]
        for g in range(F):
            static += on_bias[f, g] * Z[g, 0].real
        for j in range(len(W)):
            static += on_mean[f, j] * W[j, 0].real
        R[f] = static
        for k in range(n):
            away = Z[f, k + 1]
            for j in range(len(W)):
                away -= L[k, f, j] * W[j, k + 1]
            R[F + f * n + k], R[F + (F + f) * n + k] = away.real, away.imag
    R[last] = Z[pivot, 1].real
    return True
