"""Rational forms of sampled controllers in continuous time, and what they read of one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.own_states import diagonal
from eppanalysis.models.systems.sampled.ages import StraightReading
from eppanalysis.models.systems.sampled.places import Places, at


@dataclass(frozen=True, eq=False)
class Form:
    """A controller in continuous time: bilinear transform, and behind it a dead time for each output."""

    #: A, B, C, D: from what it reads to its outputs, late.
    A: Array
    B: Array
    C: Array
    D: Array
    #: B_out, D_out: from what is added to its outputs before they are late.
    B_out: Array
    D_out: Array
    #: C_now, D_now: from its state and from what it reads to its outputs before they are late.
    C_now: Array
    D_now: Array

    @classmethod
    def of(cls, controller: SampledController, outputs: NDArray[np.intp], late: Array) -> Form:
        """That with these of its outputs, each late by a time [s].

        Raises
        ------
        ModelError
            If it has a pole at z = -1.
        """
        A, B, C, D = (np.asarray(getattr(controller, name), float) for name in "ABCD")
        n, T = len(A) if A.size else 0, controller.sample_time
        A, B, C = A.reshape(n, n), B.reshape(n, D.shape[1]), C.reshape(len(D), n)
        turn = np.eye(n) + A
        if n and np.linalg.cond(turn) > 1e12:
            expected = "none there, for predictions in continuous time"
            raise ModelError("SampledController", "A with an eigenvalue of -1", expected)
        back = np.linalg.inv(turn)
        A_c, B_c = 2.0 / T * back @ (A - np.eye(n)), 2.0 / T * back @ B
        now = np.hstack([2.0 * C @ back, D - C @ back @ B])
        # A dead time t in Padé's form of one zero and two poles, (1 - ts/3)/(1 + 2ts/3 + (ts)^2/6), through which
        # nothing goes straight; what is read at once needs none.
        waiting, chosen = np.flatnonzero(late), np.eye(len(D))[outputs]
        t, k = late[waiting], len(waiting)
        drive, out = np.zeros((2 * k, len(D))), np.zeros((len(late), 2 * k))
        drive[1::2] = 6.0 / t[:, None] ** 2 * chosen[waiting]
        out[waiting, 0::2], out[waiting, 1::2] = np.eye(k), np.diag(-t / 3.0)
        waits = diagonal([np.array([[0.0, 1.0], [-6.0 / x**2, -4.0 / x]]) for x in t])
        at_once = chosen * (late == 0.0)[:, None]
        return cls(
            np.block([[A_c, np.zeros((n, 2 * k))], [drive @ now[:, :n], waits]]),
            np.vstack([B_c, drive @ now[:, n:]]),
            np.hstack([at_once @ now[:, :n], out]),
            at_once @ now[:, n:],
            np.vstack([np.zeros((n, len(D))), drive]),
            at_once,
            np.hstack([now[:, :n], np.zeros((len(D), 2 * k))]),
            now[:, n:],
        )

    @classmethod
    def side_by_side(cls, forms: Sequence[Form]) -> Form:
        """Several controllers as one, matrix by matrix."""
        return cls(*(diagonal([getattr(form, f.name) for form in forms]) for f in fields(cls)))


@dataclass(frozen=True, eq=False)
class Forms:
    """The rational forms of all controllers of a loop, side by side."""

    each: tuple[Form, ...]  # of each its outputs as they are held, then those that are read straight at another age
    whole: Form  # all of them side by side
    readings: tuple[StraightReading, ...]  # which those are, in this order
    #: held, aged: rows of the outputs.
    held: NDArray[np.intp]
    aged: NDArray[np.intp]

    @classmethod
    def of(cls, p: Places) -> Forms:
        """Those of a loop."""
        each: list[Form] = []
        readings: list[StraightReading] = []
        held: list[int] = []
        aged: list[int] = []
        first = row = 0
        for c in p.controllers:
            columns = p.held[first : first + c.n_outputs]
            late = 0.5 * c.sample_time + c.delay + p.system.delays[columns]
            own = [r for r in p.straight if r.column in columns]
            ages = [r.ages.mean() for r in own]
            outputs = np.array([*range(c.n_outputs), *(int(np.searchsorted(columns, r.column)) for r in own)], np.intp)
            each.append(Form.of(c, outputs, np.concatenate([late, ages])))
            readings += own
            held += range(row, row + c.n_outputs)
            aged += range(row + c.n_outputs, row + len(outputs))
            first, row = first + c.n_outputs, row + len(outputs)
        return cls(
            tuple(each), Form.side_by_side(each), tuple(readings), np.array(held, np.intp), np.array(aged, np.intp)
        )


@dataclass(frozen=True, eq=False)
class Reads:
    """What the controllers read, where some of it comes from one another's holds at ages of their own."""

    rows: Array  # on plant states, controllers, outputs of the others, external inputs and one
    solved: Array  # in place of 1, as what is read at once takes part in what is read
    gains: Array  # from what is held, each at its age

    @classmethod
    def of(cls, p: Places, forms: Forms) -> Reads:
        """That of a loop."""
        system, C, D = p.system, forms.whole.C, forms.whole.D
        held, gains = at(system.D, p.read, p.held).copy(), np.zeros((p.read.size, forms.aged.size))
        for i, reading in enumerate(forms.readings):
            rows = np.searchsorted(p.read, reading.reads)
            held[rows, np.searchsorted(p.held, reading.column)], gains[rows, i] = 0.0, reading.gains
        solved = np.asarray(np.linalg.inv(np.eye(p.read.size) - gains @ D[forms.aged]), float)
        rows = np.hstack([
            at(system.C, p.read, p.plant), held @ C[forms.held] + gains @ C[forms.aged], at(system.D, p.read, p.w),
            system.D_input[p.read], system.constant_input[p.read, None],
        ])  # fmt: skip
        return cls(solved @ rows, solved, gains)
