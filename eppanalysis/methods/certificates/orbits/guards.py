"""That the events of an orbit are those of the loop: no guard rises earlier, proved in ball arithmetic.

On a piece of an arc every guard is a Taylor polynomial with a bound on its remainder; where all its Bernstein
coefficients lie below zero by more than that bound, the guard is below zero on the piece. Where that fails the piece is
halved. A guard that is exactly zero at the start of an arc, by the equations of the orbit, is divided by the power of
time with which it leaves zero; that which fires is divided by the time left to its event.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import comb, factorial
from typing import Any

import numpy as np

from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.orbits.path import ExactPath, Stage

#: Terms of the Taylor polynomials, and the most that rate times length of a piece may be.
_TERMS, _REACH = 16, 2.5
#: Halvings of a piece beyond which a guard is not decided.
_MOST_HALVINGS = 24


class Violated(Exception):
    """A guard is proved to rise where the sequence of events has none of it, in a sentence."""


@dataclass(frozen=True)
class Start:
    """How a guard leaves the start of an arc."""

    order: int | None  # of the first derivative that is not exactly zero; None for a rate that stays at zero
    rises: bool  # its sign


def starts_of(path: ExactPath, arc: int, state: Any) -> dict[int, Start]:
    """How every guard leaves the start of an arc, at the state there (arb_mat).

    Raises
    ------
    NotCovered
        Where a guard is so near zero that the ball holds it, and no equation of the orbit says that it is zero; or
        where it stays at zero: what an element does then is told by no guard.
    """
    from flint import arb_mat

    stage, out = path.stages[arc], {}
    for g, row in stage.guards:
        for order in range(path.m + 2):
            value = (arb_mat(row) * state).entries()[0]
            if value > 0 or value < 0:
                out[g] = Start(order, bool(value > 0))
                break
            if not path.zero_at_start(arc, row):
                raise NotCovered(
                    f"It is undecided on which side of zero '{path.guard_name(g)}' is behind "
                    f"'{path.guard_name(path.stages[arc - 1].fired)}'."
                )
            # The next derivative: a guard that is zero by an equation of the orbit leaves zero by the first that is not
            # (docs/theory/proofs.md, No event earlier).
            row = row * stage.rate
        else:
            if not path.on_rates(arc, g):
                raise NotCovered(f"'{path.guard_name(g)}' stays exactly at zero.")
            out[g] = Start(None, False)
    return out


def require_at_once(path: ExactPath, arc: int, starts: dict[int, Start]) -> None:
    """The guard of an event without delay has been passed, and none that is due before it has been, too.

    Of guards that a jump has passed the first one along the cascade fires; those on rates, and those that only begin to
    rise, come behind them.

    Raises
    ------
    NotCovered
        If the guard has not been passed (it may be a moment later), or another one is due before it.
    """
    fired = path.stages[arc].fired
    if not starts[fired].rises:
        raise NotCovered(f"'{path.guard_name(fired)}' has not risen where the sequence has it without delay.")
    place = {g: (not _passed(path, arc, g, start), k) for k, (g, start) in enumerate(starts.items())}
    for g, start in starts.items():
        if start.rises and place[g] < place[fired]:
            raise _due_first(path, g, fired)


def _due_first(path: ExactPath, guard: int, fired: int) -> NotCovered:
    names = f"'{path.guard_name(guard)}'", f"'{path.guard_name(fired)}'"
    return NotCovered(f"{names[0]} and {names[1]} are due at one instant, and the sequence has the latter first.")


def _passed(path: ExactPath, arc: int, guard: int, start: Start) -> bool:
    """Whether a guard that is not on rates is above zero."""
    return start.rises and start.order == 0 and not path.on_rates(arc, guard)


def prove_arc(path: ExactPath, arc: int, start: Any, duration: Any, scale: np.ndarray) -> int:
    """Prove that on an arc no guard rises before the one that ends it; returns the number of pieces.

    Parameters
    ----------
    start : arb_mat, shape (m + 1, 1)
    scale : array, shape (m,)
        Sizes of the unknowns, on which only the effort depends.

    Raises
    ------
    Violated
        If a guard is proved to rise.
    NotCovered
        If one is not decided.
    """
    stage = path.stages[arc]
    if duration < 0:
        raise Violated(f"The arc before '{path.guard_name(stage.fired)}' would take less than no time.")
    if not duration > 0:
        raise NotCovered(f"It is not decided whether the arc before '{path.guard_name(stage.fired)}' takes any time.")
    starts = starts_of(path, arc, start)
    for g, begin in starts.items():
        if begin.rises:
            raise Violated(
                f"'{path.guard_name(g)}' happens at once where the sequence waits for '{path.guard_name(stage.fired)}'."
            )
    ends = {g for g, row in stage.guards if path.zero_at_end(arc, row)}
    first = next(g for g, begin in starts.items() if g in ends and begin.order is not None)
    if first != stage.fired:
        raise _due_first(path, first, stage.fired)
    pieces = _Pieces(stage, ends, start, duration, _Norm(stage, path.moving, scale))
    failed = pieces.prove({g: s.order for g, s in starts.items() if s.order is not None})
    if failed is not None:
        g, happens = failed
        names = f"'{path.guard_name(g)}'", f"'{path.guard_name(stage.fired)}'"
        if happens:
            raise Violated(f"{names[0]} happens before {names[1]}, which the sequence has there.")
        raise NotCovered(f"It is not decided whether {names[0]} happens before {names[1]}.")
    return pieces.count


class _Norm:
    """Bounds on the rate of the state along an arc, in a norm in which it is small."""

    def __init__(self, stage: Stage, moving: list[int], scale: np.ndarray) -> None:
        from flint import arb, arb_mat

        self.moving = moving
        rate = stage.rate.tolist()
        self.weights = [arb(float(w)) for w in weights_of(stage, moving, scale)]
        sizes = arb_mat([[abs(arb(rate[i][j])) for j in moving] for i in moving])
        rows = (sizes * arb_mat(len(moving), 1, self.weights)).entries() if moving else []
        self.rate = max([(r / w).upper() for r, w in zip(rows, self.weights, strict=True)], default=arb(0))
        self.rate = max(self.rate, arb(2) ** -40)

    def of(self, rates: list[Any]) -> Any:
        """Norm of the rates of the state."""
        from flint import arb

        sizes = [(abs(rates[i]) / w).upper() for i, w in zip(self.moving, self.weights, strict=True)]
        return max(sizes, default=arb(0))

    def of_row(self, row: Any) -> Any:
        """Norm of a row on the state."""
        from flint import arb

        entries = row.entries()
        return sum((abs(entries[i]) * w for i, w in zip(self.moving, self.weights, strict=True)), arb(0)).upper()


def weights_of(stage: Stage, moving: list[int], scale: np.ndarray) -> np.ndarray:
    """Weights of the states in which the row sums of the sizes of an arc's rate are nearly equal, as powers of two."""
    from flint import arb

    rate, scale = stage.rate.tolist(), np.asarray(scale, float)[moving]
    size = np.array([[abs(float(arb(rate[i][j]))) for j in moving] for i in moving]).reshape(len(moving), len(moving))
    # The Perron vector makes all weighted row sums equal, and no scaling has a smaller largest one. A trifle in every
    # place keeps the matrix irreducible; powers of two scale without rounding.
    relative = size / scale[:, None] * scale
    relative = relative + 1e-4 * max(float(relative.max(initial=0.0)), 1e-300)
    weights = np.ones(len(scale))
    for _ in range(60):
        weights = relative @ weights
        weights = weights / weights.max(initial=1e-300)
    return np.exp2(np.round(np.log2(np.maximum(weights, 1e-9) * scale)))


class _Pieces:
    """An arc that is halved until all guards are proved to stay below zero on every piece."""

    def __init__(self, stage: Stage, ends: set[int], start: Any, duration: Any, norm: _Norm) -> None:
        from flint import arb_mat

        self.rate, self.start, self.duration, self.norm = arb_mat(stage.rate), start, duration, norm
        self.rows = {g: arb_mat(row) for g, row in stage.guards}
        self.sizes = {g: norm.of_row(row) for g, row in self.rows.items()}
        self.ends, self.count = ends, 0
        reach = float((norm.rate * duration).upper())
        self.first = max(1, int(np.ceil(np.log2(max(reach / _REACH, 1.0)))))
        self.flows = {self.first: (self.rate * self._length(self.first)).exp()}
        for level in range(self.first - 1, -1, -1):
            self.flows[level] = self.flows[level + 1] * self.flows[level + 1]
        self.end = self.flows[0] * start
        self.series: dict[tuple[int, int, bool], Any] = {}
        self.forms: dict[tuple[int, int], Any] = {}

    def _length(self, level: int) -> Any:
        return self.duration / 2**level

    def _flow(self, level: int) -> Any:
        if level not in self.flows:
            self.flows[level] = (self.rate * self._length(level)).exp()
        return self.flows[level]

    def prove(self, orders: dict[int, int]) -> tuple[int, bool] | None:
        """None where all is proved; else a guard that is not, and whether it is proved to rise."""
        open_ = [(0, 0, self.start, list(orders))]
        while open_:
            level, place, state, guards = open_.pop()
            if level >= self.first:
                self.count += 1
                guards = self._left(level, place, state, guards, orders)
                if not guards:
                    continue
                if level >= self.first + _MOST_HALVINGS:
                    return guards[0], False
            middle = self._flow(level + 1) * state
            for g in guards if level >= self.first else ():
                if (self.rows[g] * middle).entries()[0] > 0:
                    return g, True
            open_ += [(level + 1, 2 * place + 1, middle, guards), (level + 1, 2 * place, state, guards)]
        return None

    def _left(self, level: int, place: int, state: Any, guards: list[int], orders: dict[int, int]) -> list[int]:
        """The guards that are not proved to stay below zero on a piece."""
        stray = self._remainder(level, state)
        last = place == 2**level - 1
        return [
            g
            for g in guards
            if not (
                self._ends_below(level, g)
                if last and g in self.ends
                else self._below(level, g, state, stray, 0 if place else orders[g])
            )
        ]

    def _below(self, level: int, g: int, state: Any, stray: Any, order: int) -> bool:
        """Whether a guard, over a power of the time since the start of the piece, lies below zero on it."""
        limit = -(stray * self.sizes[g])
        if order == 0:
            return all(v < limit for v in (self._form(level, g) * state).entries())
        # At the start of an arc a guard may be exactly zero; over that power of the time it has one sign
        # (docs/theory/proofs.md, No event earlier).
        return _all_below((self._series(level, g, False) * state).entries()[order:], limit)

    def _ends_below(self, level: int, g: int) -> bool:
        """Whether a guard that is zero at the event, as that which fires, lies below zero on the last piece.

        It is looked at over the time left to the event. Two elements with the same threshold switch at one instant.
        """
        coefficients = (self._series(level, g, True) * self.end).entries()
        return _all_below(coefficients[1:], -(self._remainder(level, self.end) * self.sizes[g]))

    def _remainder(self, level: int, state: Any) -> Any:
        """Bound on the remainder of the Taylor polynomials on a piece that begins, or ends, with a state; per size."""
        reach = self.norm.rate * abs(self._length(level))
        rates = (self.rate * state).entries()
        return (self.norm.of(rates) / self.norm.rate * reach**_TERMS / factorial(_TERMS) * reach.exp()).upper()

    def _series(self, level: int, g: int, backward: bool) -> Any:
        """Taylor coefficients of a guard over the length of a piece, as rows on the state."""
        from flint import arb_mat

        key = (level, g, backward)
        if key not in self.series:
            step = -self._length(level) if backward else self._length(level)
            row, rows = self.rows[g], []
            for j in range(_TERMS):
                rows += row.entries()
                row = row * self.rate * (step / (j + 1))
            self.series[key] = arb_mat(_TERMS, self.rate.nrows(), rows)
        return self.series[key]

    def _form(self, level: int, g: int) -> Any:
        """Bernstein coefficients of a guard on a piece, as rows on the state."""
        from flint import arb_mat

        if (level, g) not in self.forms:
            self.forms[level, g] = arb_mat(_to_bernstein(_TERMS)) * self._series(level, g, False)
        return self.forms[level, g]


def _all_below(coefficients: list[Any], limit: Any) -> bool:
    """Whether a polynomial on [0, 1] lies below a limit, by its Bernstein coefficients."""
    from flint import arb_mat

    column = arb_mat(len(coefficients), 1, coefficients)
    return all(v < limit for v in (arb_mat(_to_bernstein(len(coefficients))) * column).entries())


@cache
def _to_bernstein(terms: int) -> Any:
    """From the coefficients of a polynomial on [0, 1] to those in the Bernstein basis (fmpq_mat)."""
    from flint import fmpq, fmpq_mat

    d = terms - 1
    return fmpq_mat([[fmpq(comb(i, j), comb(d, j)) if j <= i else fmpq(0) for j in range(terms)] for i in range(terms)])
