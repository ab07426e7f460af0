"""A loop with all of its elements as gains: its own motions, and what a sine from outside makes of it.

How the states go on is a linear map: at every instant, from sample to sample, or over one turn of the clocks of sampled
controllers. The eigenvectors are the motions of the loop by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.margins.linearised import small_signal
from eppanalysis.methods.margins.sampled import Turn, over_a_turn
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.absorbed import with_gains
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.places import Places

#: Share of the fastest pole below which one neither grows nor turns.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Motions:
    """The motions of a linear loop by itself."""

    after: Array  # of the states on themselves: their rate, or what they are after a time
    #: time, shortest: that time, and that between two samples [s]; zero where `after` is the rate.
    time: float
    shortest: float
    seen: Array  # the signals on the states; over a turn of clocks they are in `turn`
    turn: Turn | None = None

    @classmethod
    def of(cls, loop: LureSystem) -> Motions:
        """Those of a loop without elements, or with none but sampled controllers.

        Raises
        ------
        ModelError
            If the samples of its controllers do not come round together, or there is dead time behind one.
        """
        step, signals = loop.time_step or 0.0, loop.signals.C
        if not loop.elements:
            return cls(loop.A, step, step, signals)
        turn = over_a_turn(loop)
        if turn is None:
            raise ModelError(
                f"{loop.name}: {', '.join(loop.element_names)} do not come round together",
                expected="sampled controllers whose samples do, without dead time behind them",
            )
        return cls(turn.after, turn.time, turn.shortest, signals, turn)

    @cached_property
    def _modes(self) -> tuple[ComplexArray, ComplexArray]:
        values, vectors = np.linalg.eig(self.after)
        if self.time:
            # What is gone after a sample has decayed beyond all numbers.
            values = np.log(np.where(values == 0.0, np.finfo(float).tiny, values).astype(complex)) / self.time
        return np.asarray(values, complex), np.asarray(vectors, complex)

    @property
    def poles(self) -> ComplexArray:
        """[rad/s]"""
        return self._modes[0]

    def nearest(self, aim: complex) -> tuple[complex, ComplexArray]:
        """The pole that turns and is nearest to an aim [rad/s], and the signals of its motion; nan where none turns."""
        s, vectors = self._modes
        if self.time:
            # A turn of several samples tells a pole but for whole turns; two samples make the fastest motion.
            turns = np.round((aim.imag - s.imag) * self.time / (2.0 * np.pi))
            most = np.floor((np.pi / self.shortest * (1.0 + _ROUNDING) - s.imag) * self.time / (2.0 * np.pi))
            s = s + 2j * np.pi / self.time * np.clip(turns, 0.0, np.maximum(most, 0.0))
        size = np.abs(s[np.isfinite(s)]).max(initial=0.0)
        distance = np.where(s.imag > _ROUNDING * size, np.abs(s - aim), np.inf)
        if not np.any(np.isfinite(distance)):
            return complex(np.nan, np.nan), np.zeros(len(self.seen), complex)
        i = int(np.argmin(distance))
        return complex(s[i]), self._signals(complex(s[i]), vectors[:, i])

    def _signals(self, s: complex, x: NDArray[Any]) -> ComplexArray:
        """The signals of a motion ``exp(s t)`` of the states."""
        return np.asarray(self.seen @ x if self.turn is None else self.turn.fundamental(s, x), complex)

    def under_a_sine(self, omega: float, first: int) -> ComplexArray:
        """The signals where two of the states, from number `first` on, are made the cosine and sine of a frequency."""
        ends = 1j * omega if not self.time else np.exp(1j * omega * self.time)
        sine = np.arange(first, first + 2)
        others = np.setdiff1d(np.arange(len(self.after)), sine)
        x = np.zeros(len(self.after), complex)
        x[sine] = 1.0, -1j
        driven = self.after[np.ix_(others, sine)] @ x[sine]
        x[others] = np.linalg.solve(ends * np.eye(others.size) - self.after[np.ix_(others, others)], driven)
        return self._signals(1j * omega, x)


@dataclass(frozen=True, eq=False)
class Linear:
    """The loop with all of its elements as gains."""

    loop: LureSystem  # without dead time; elements to which no gain belongs are left in it
    gains: dict[int, Array]  # sampled controllers, which are linear as they are, have none
    at: OperatingPoint

    @classmethod
    def of(cls, system: LureSystem, at: OperatingPoint) -> Linear:
        """The gains in place of the elements: those of margins, none where that is infinite."""
        loop = small_signal(system)
        loop = replace(loop, memory=(None,) * len(loop.elements))
        gains = {i: np.asarray(e.linear_gain(), float) for i, e in enumerate(loop.elements) if not is_linear(e)}
        return cls(loop, {i: gain for i, gain in gains.items() if np.all(np.isfinite(gain))}, at)

    @cached_property
    def closed(self) -> Motions:
        """The loop with the gains in place.

        Raises
        ------
        ModelError
            If there is dead time behind one of them, or no closed form of the loop.
        """
        return Motions.of(with_gains(self.loop, self.gains))

    @cached_property
    def refusal(self) -> str:
        """Why the loop has no linear form; empty where it has one."""
        elements = zip(self.loop.element_names, self.loop.elements, strict=True)
        kept = [name for i, (name, e) in enumerate(elements) if i not in self.gains and not is_linear(e)]
        if kept:
            return f"{', '.join(kept)} cannot be taken as linear"
        try:
            self.closed  # noqa: B018
        except ModelError as error:
            return str(error).rstrip(".")
        return ""

    @property
    def stable(self) -> bool:
        """Whether no pole grows."""
        poles = self.closed.poles
        return bool(np.all(poles.real < _ROUNDING * np.abs(poles).max(initial=1e-300)))

    def with_gain(self, factor: float) -> Motions:
        """The closed loop with the gain of its principal element multiplied."""
        gains = {i: g * (factor if i == self.turned else 1.0) for i, g in self.gains.items()}
        return Motions.of(with_gains(self.loop, gains))

    @property
    def turned(self) -> int:
        """Element whose gain is multiplied: the principal one, or the first that passes anything on."""
        order = [self.loop.principal, *self.gains]
        return next((i for i in order if i in self.gains and np.any(self.gains[i])), -1)

    def responses(self, omega: float) -> Iterator[tuple[str, ComplexArray]]:
        """The signals under a sine at each external input and behind each element, by the place."""
        loop = self.loop
        behind = replace(
            loop,
            B_input=np.hstack([loop.B_input, loop.B]),
            D_input=np.hstack([loop.D_input, loop.D]),
            signals=replace(loop.signals, D_input=np.hstack([loop.signals.D_input, loop.signals.D])),
        )
        places = [*loop.input_names]
        for name, outputs in zip(loop.element_names, loop.output_slices, strict=True):
            places += [f"behind {name}"] * (outputs.stop - outputs.start)
        closed = with_gains(behind, self.gains)
        for i, place in enumerate(places):
            driven, first = _with_sine(closed, i, omega)
            yield place, Motions.of(driven).under_a_sine(omega, first)


def _with_sine(loop: LureSystem, i: int, omega: float) -> tuple[LureSystem, int]:
    """The loop with a sine at its input i as two more states, and where the first of them is among what moves."""
    A, B_input, C, D_input, s = loop.A, loop.B_input, loop.C, loop.D_input, loop.signals
    n = len(A)
    turning = np.array([[0.0, -omega], [omega, 0.0]])
    into = np.eye(1, 2)

    def beside(rows: Array, column: Array) -> Array:
        return np.hstack([rows, column[:, [i]] @ into])

    driven = replace(
        loop,
        A=np.vstack([beside(A, B_input), np.hstack([np.zeros((2, n)), turning])]),
        B=np.vstack([loop.B, np.zeros((2, loop.B.shape[1]))]),
        C=beside(C, D_input),
        B_input=np.vstack([B_input, np.zeros((2, B_input.shape[1]))]),
        constant_state=np.append(loop.constant_state, [0.0, 0.0]),
        x0=np.append(loop.x0, [0.0, 0.0]),
        signals=replace(s, C=beside(s.C, s.D_input)),
        state_names=(*loop.state_names, "cosine", "sine"),
    )
    return driven, len(Places.of(loop).plant)


def is_linear(element: Nonlinearity) -> bool:
    """Whether an element is linear as it is, so that no gain replaces it."""
    return isinstance(element, SampledController)
