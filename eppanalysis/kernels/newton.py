"""Compiled: Newton's method for first-order balances, start to end, where all elements have closed forms in kernels.

Few points on a curve took their time by calls, many on a grid by what was written and read again between them. What is
computed is what :mod:`eppanalysis.methods.describing` does step by step for other elements, to the last bit.
"""

import math

import numpy as np

from eppanalysis.kernels.balances import balance_at, move_at, room_for, solve_at
from eppanalysis.kernels.compiling import KERNEL, PART, njit
from eppanalysis.kernels.describing.closed_forms import lock_pin_at
from eppanalysis.kernels.describing.piecewise import describe, shape_of
from eppanalysis.kernels.responses import answer_at, room_for_answers

_COMPILED = {**KERNEL, "error_model": "numpy"}
_INNER = {**PART, "error_model": "numpy"}
#: Points whose arrays stay in the nearest cache.
_AT_ONCE = 64


@njit(**_INNER)
def _describe(X, points, begin, block, places, pivot, relative, elements, shapes, free, row, inputs, of_elements):
    """Inputs of some elements at some points, and what they make of them; not `free`, pivot and omega stand still.

    Arguments are those of :func:`newton`, workspace for numbers of all points, and what is filled, from the point
    `begin` on.
    """
    first, (breakpoints, slopes, intercepts, jumps), pins = elements
    mean, gain, by_mean, by_gain = of_elements
    n, m = points.size, places.size
    size, bias, level, share, by = row[0, :n], row[1, :n], row[2, :n], row[3, :n], row[4:, :n]
    for e in block:
        for i in range(n):
            x, k = X[points[i]], points[i] - begin
            size[i], bias[i] = math.exp(x[places[e]]), x[2 * m + e]
            phase = x[places[e] + 1] if e != pivot else 0.0
            inputs[k, e] = complex(size[i] * math.cos(phase), size[i] * math.sin(phase))
            for by_what in range(3):
                by_mean[by_what, k, e], by_gain[by_what, k, e] = 0.0, complex(0.0, 0.0)
        gap, stiffness, damping, unilateral = pins[e, 0], pins[e, 1], pins[e, 2], pins[e, 3]
        if stiffness == 0.0:
            i, j = first[e], first[e + 1]
            table = breakpoints[i:j], slopes[i + e : j + e + 1], intercepts[i + e : j + e + 1], jumps[i:j]
            shape = shapes[e, 0] != 0.0, shapes[e, 1]
            describe(table[0], table[1], table[2], table[3], shape, size, bias, level, share, by)
            for i in range(n):
                k = points[i] - begin
                mean[k, e], gain[k, e] = level[i], complex(share[i], 0.0)
                by_mean[0, k, e], by_gain[0, k, e] = by[1, i] * size[i], complex(2.0 * (by[0, i] - share[i]), 0.0)
                by_mean[1, k, e], by_gain[1, k, e] = by[0, i], complex(by[1, i] * (2.0 / size[i]), 0.0)
                if pins[e, 4] == 0.0:
                    continue
                rises, falls = bias[i] + size[i] > table[0][1], bias[i] - size[i] < table[0][0]
                if rises and falls:
                    lag = pins[e, 4] / size[i] / size[i]
                    gain[k, e] -= complex(0.0, lag)
                    by_gain[0, k, e] += complex(0.0, 2.0 * lag)
                else:
                    # It stays on a level: which one is not known where it reaches neither threshold.
                    mean[k, e], gain[k, e] = table[2][2 if rises else 0 if falls else 1], complex(0.0, 0.0)
                    for by_what in range(2):
                        by_mean[by_what, k, e], by_gain[by_what, k, e] = 0.0, complex(0.0, 0.0)
            continue
        for i in range(n):
            k = points[i] - begin
            a, b, omega = max(size[i], 1e-150), bias[i], math.exp(X[points[i], 1])
            beside = b + (relative * a + 1e-12 * abs(b))
            mean[k, e], gain[k, e] = lock_pin_at(gap, stiffness, damping, unilateral != 0.0, a, b, omega)
            for by_what in range(0 if free or e != pivot else 1, 3 if free else 2):
                there = (
                    a * (1.0 + relative) if by_what == 0 else a,
                    beside if by_what == 1 else b,
                    omega * (1.0 + relative) if by_what == 2 else omega,
                )
                step = max(beside - b, 1e-290) if by_what == 1 else relative
                level_there, pull = lock_pin_at(gap, stiffness, damping, unilateral != 0.0, *there)
                by_mean[by_what, k, e] = (level_there - mean[k, e]) / step
                change, per = pull - gain[k, e], 1.0 / step
                by_gain[by_what, k, e] = complex(change.real * per, change.imag * per)


@njit(**PART)
def _shapes(first, maps):
    """What :func:`~eppanalysis.kernels.describing.piecewise.shape_of` tells of each map."""
    shapes = np.empty((first.size - 1, 2))
    for e in range(first.size - 1):
        i, j = first[e], first[e + 1]
        sloped, even = shape_of(maps[0][i:j], maps[1][i + e : j + e + 1], maps[3][i:j])
        shapes[e, 0], shapes[e, 1] = 1.0 if sloped else 0.0, even
    return shapes


@njit(**_COMPILED)
def newton(X, normal, iterations, limits, parts, places, pivot, static, elements, linear, L, around, jacobian, found):
    """Bring points to solutions, of some equations for some of their unknowns.

    Parameters
    ----------
    X, normal : array, shape (n, 3 m + 1)
        Points, which are moved, and one more equation where there is one more unknown: the normals of planes.
    iterations : int
    limits : tuple of float
        Relative step of the differences, longest step, that of a point that may be lost, and how many of these in a
        row; last step of a point that has converged, and the larger of two in a row that are as good.
    parts : int arrays block, rows, columns
        Elements, and their equations and unknowns; all that the others give stands still.
    places, pivot, static
        As of :func:`eppanalysis.kernels.balances.assemble`.
    elements : first (m + 1,), arrays of :func:`~eppanalysis.kernels.describing.piecewise.biased_sinusoid`, pins (m, 5)
        The maps of all elements, one behind the other, their first breakpoints, and gap, stiffness, damping and whether
        it only pushes of each that is a lock pin, zeros for the others; the area of a hysteresis loop over pi.
    linear : arrays, shapes (n, n), (n, m), (m, n), (m, m)
        State space from all outputs to the first inputs.
    L : complex array, shape (n, m, m)
        Its responses, where the amplitude of the pivot and omega stand still; else of length zero.
    around : complex array, shape (n,)
        Is filled with the gain once around the loop, cut at the pivot's input, where these responses are given.
    jacobian, found : array and bool array, shapes (n or 1, 3 m, 3 m + 1), (n,)
        Are filled: that with which a point has made its last step, and whether it has converged. A single Jacobian is
        workspace. Before, `found` says which points are to be moved.
    """
    relative, longest, far, most, tolerance, as_good = limits
    block, rows, columns = parts
    A, B, C, D = linear
    m, n, free, still = places.size, len(A), len(L) == 0, np.empty((0, 0), np.complex128)
    every, R, step, matrix = np.arange(m), np.empty(3 * m), np.empty(3 * m + 1), room_for(columns.size)
    answer, room = np.empty((2, 1, m, m), np.complex128), room_for_answers(n, m)
    most_points = min(len(X), _AT_ONCE)
    row, inputs = np.empty((6, most_points)), np.empty((most_points, m), np.complex128)
    mean, gain = np.empty((most_points, m)), np.empty((most_points, m), np.complex128)
    by_mean, by_gain = np.empty((3, most_points, m)), np.empty((3, most_points, m), np.complex128)
    shapes = _shapes(elements[0], elements[1])
    points, settled, lost = np.empty(most_points, np.int64), np.empty(most_points, np.bool_), np.empty(most_points)
    for begin in range(0, len(X), _AT_ONCE):
        count = 0
        for i in range(begin, min(begin + _AT_ONCE, len(X))):
            if found[i] and np.all(np.isfinite(X[i])):
                points[count] = i
                count += 1
            found[i], settled[i - begin], lost[i - begin] = False, False, 0.0
        for turn in range(iterations):
            if count == 0:
                break
            todo, count = points[:count], 0
            of, of_elements = block if turn else every, (mean, gain, by_mean, by_gain)
            _describe(X, todo, begin, of, places, pivot, relative, elements, shapes, free, row, inputs, of_elements)
            for i in todo:
                x, k, J = X[i], i - begin, jacobian[i if len(jacobian) > 1 else 0]
                if free:
                    omega = math.exp(x[1])
                    answer_at(A, B, C, complex(0.0, omega), complex(0.0, 1.0), room, answer[:, 0])
                    for r in range(m):
                        for c in range(m):
                            answer[0, 0, r, c] += D[r, c]
                            answer[1, 0, r, c] *= omega
                here, slope = (answer[0, 0], answer[1, 0]) if free else (L[i], still)
                balance_at(x, k, block, places, every, pivot, static, of_elements, inputs, here, slope, J, R)
                regular = solve_at(J, R, rows, columns, normal[i], 0.0, matrix, step)
                length, sound = move_at(x, columns, places, step, longest)
                lost[k] = lost[k] + 1.0 if length > far else 0.0
                alive = regular and sound and lost[k] < most
                small = regular and length < as_good
                found[i] = alive and ((regular and length < tolerance) or (small and settled[k]))
                settled[k] = small
                if found[i] and not free:
                    around[i] = complex(0.0, 0.0)
                    for j in range(m):
                        around[i] += here[pivot, j] * gain[k, j] * inputs[k, j] / inputs[k, pivot]
                if alive and not found[i]:
                    points[count] = i
                    count += 1
