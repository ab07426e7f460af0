"""How one element behaves in time: modes, guards and resets, as plain data.

An element maps its inputs ``z`` (one or more scalars) to its outputs ``w``. It holds a small vector ``h`` of numbers
that stay constant between events (its memory). In each mode its output is affine,

    w = from_input @ z + from_held @ h + from_smooth @ sigma + constant,

or, in a *sticking* mode, the single output takes whatever value keeps the first input constant (dz[0]/dt = 0).
A guard is an affine function of inputs, input rates, held values and outputs; its event takes place where the guard
rises through zero. ``sigma`` are smooth functions of the inputs (sine, cube, ...), for elements that are not
piecewise affine.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Smooth functions an element may use, by the code that the kernels know.
SMOOTH_KINDS = {"sine": 0, "cube": 1, "reciprocal_abs": 2}


def _vector(values: ArrayLike, size: int) -> Array:
    out = np.zeros(size)
    if isinstance(values, int | float):  # as nearly all are
        out[:1] = values
        return out
    given = np.atleast_1d(np.asarray(values, float))
    out[: given.size] = given
    return out


@dataclass(frozen=True)
class Mode:
    """One mode of an element.

    Shapes are (n_outputs, n_inputs), (n_outputs, n_held), (n_outputs, n_smooth) and (n_outputs,).

    A sticking mode keeps the first input at `level`. It exists only where the loop pulls back against the element's
    jump there, that is where the input's rate falls as the output rises for an upward `jump` (and the reverse).
    """

    name: str
    from_input: Array
    from_held: Array
    from_smooth: Array
    constant: Array
    sticking: bool = False
    level: float = 0.0
    jump: float = 1.0


@dataclass(frozen=True)
class Guard:
    """Event of an element: fires in `mode` where the affine function rises through zero, and leads to `target`.

    ``value = on_input @ z + on_rate @ dz/dt + on_held @ h + on_output @ w + constant``. At the event the held values
    become ``held_from_input @ z + held_from_held @ h + held_constant``. Where the loop does not admit the sticking mode
    that is the target, the event leads to `bypass`.
    """

    name: str
    mode: int
    target: int
    on_input: Array
    on_rate: Array
    on_held: Array
    on_output: Array
    constant: float
    held_from_input: Array
    held_from_held: Array
    held_constant: Array
    bypass: int = -1


@dataclass(frozen=True)
class Smooth:
    """Smooth function of the inputs: ``sigma = scale * f(on_input @ z + constant)``, `kind` a key of SMOOTH_KINDS."""

    kind: str
    on_input: Array
    constant: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True)
class Automaton:
    """Modes, guards and start of one element."""

    n_inputs: int
    n_outputs: int
    n_held: int
    modes: tuple[Mode, ...]
    guards: tuple[Guard, ...]
    start_mode: int = 0
    start_held: Array = field(default_factory=lambda: np.zeros(0))
    smooth: tuple[Smooth, ...] = ()

    def follows(self, mode: int) -> bool:
        """Whether the element follows its input in a mode, and holds on to where it was where the input turns back."""
        return self.n_held > 0 and any(g.mode == mode and np.any(g.on_rate) for g in self.guards)


class AutomatonBuilder:
    """Collects modes and guards with the zeros filled in, so that element code states only what is not zero."""

    def __init__(self, n_inputs: int = 1, n_outputs: int = 1, n_held: int = 0, smooth: tuple[Smooth, ...] = ()) -> None:
        self.n_inputs, self.n_outputs, self.n_held, self.smooth = n_inputs, n_outputs, n_held, smooth
        self.modes: list[Mode] = []
        self.guards: list[Guard] = []

    def mode(
        self,
        name: str,
        from_input: ArrayLike = 0.0,
        from_held: ArrayLike = 0.0,
        from_smooth: ArrayLike = 0.0,
        constant: ArrayLike = 0.0,
        sticking: bool = False,
        level: float = 0.0,
        jump: float = 1.0,
    ) -> int:
        """Add a mode and return its number; matrices may be given as a row when there is one output."""

        def matrix(values: ArrayLike, n_columns: int) -> Array:
            given = np.asarray(values, float)
            if given.ndim == 2:
                return given
            out = np.zeros((self.n_outputs, n_columns))
            if n_columns:
                out[0] = _vector(given, n_columns)
            return out

        self.modes.append(
            Mode(
                name,
                matrix(from_input, self.n_inputs),
                matrix(from_held, self.n_held),
                matrix(from_smooth, len(self.smooth)),
                _vector(constant, self.n_outputs),
                sticking,
                level,
                jump,
            )
        )
        return len(self.modes) - 1

    def guard(
        self,
        name: str,
        mode: int,
        target: int,
        on_input: ArrayLike = 0.0,
        on_rate: ArrayLike = 0.0,
        on_held: ArrayLike = 0.0,
        on_output: ArrayLike = 0.0,
        constant: float = 0.0,
        held_from_input: ArrayLike | None = None,
        held_from_held: ArrayLike | None = None,
        held_constant: ArrayLike | None = None,
        bypass: int = -1,
    ) -> None:
        """Add a guard; when no reset is given the held values are kept."""
        keep = held_from_input is None and held_from_held is None and held_constant is None
        n, m = self.n_held, self.n_inputs

        def matrix(values: ArrayLike | None, n_columns: int) -> Array:
            out = np.zeros((n, n_columns))
            if values is not None:
                given = np.asarray(values, float)
                if given.ndim == 2:
                    out[:] = given
                elif n:
                    out[0, : np.atleast_1d(given).size] = given
            return out

        self.guards.append(
            Guard(
                name,
                mode,
                target,
                _vector(on_input, m),
                _vector(on_rate, m),
                _vector(on_held, n),
                _vector(on_output, self.n_outputs),
                float(constant),
                matrix(held_from_input, m),
                np.eye(n) if keep else matrix(held_from_held, n),
                np.zeros(n) if held_constant is None else _vector(held_constant, n),
                bypass,
            )
        )

    def build(self, start_mode: int = 0, start_held: ArrayLike = 0.0) -> Automaton:
        """The finished automaton."""
        return Automaton(
            self.n_inputs,
            self.n_outputs,
            self.n_held,
            tuple(self.modes),
            tuple(self.guards),
            start_mode,
            _vector(start_held, self.n_held),
            self.smooth,
        )
