"""How one element behaves in time: modes, guards and resets, as plain data.

An element maps its inputs ``z`` (one or more scalars) to its outputs ``w``. It holds a small vector ``h`` of numbers
that stay constant between events (its memory). In each mode its output is affine,

    w = from_input @ z + from_memory @ h + from_smooth @ sigma + constant,

or, in a *sticking* mode, the single output takes whatever value keeps the first input constant (dz[0]/dt = 0).
A guard is an affine function of inputs, input rates, memory values and outputs; its event takes place where the guard
rises through zero. ``sigma`` are smooth functions of the inputs (sine, cube, ...), for elements that are not
piecewise affine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.columns import ByName, in_columns, require_shapes

#: Size of its argument below which the logarithm of a size rests.
LEAST = 5e-11
#: Smooth functions an element may use, of numbers or arrays, in the order of the codes that the engine knows.
SMOOTH_FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sine": np.sin,
    "cube": lambda u: u**3,
    "reciprocal_abs": lambda u: 1.0 / (1.0 + abs(u)),
    "square": lambda u: u**2,
    "fourth_power": lambda u: u**4,
    "fifth_power": lambda u: u**5,
    "tanh": np.tanh,
    "arctan": np.arctan,
    "gaussian": lambda u: np.exp(-(u**2)),
    "logarithm": lambda u: np.log(np.maximum(abs(u), LEAST)),
    "exponential": np.exp,
}
#: Their codes.
SMOOTH_KINDS = {name: code for code, name in enumerate(SMOOTH_FUNCTIONS)}


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
    """One mode: the outputs are ``from_input @ z + from_memory @ h + from_smooth @ sigma + constant``.

    Parameters
    ----------
    name : str
        As a run names it.
    from_input, from_memory, from_smooth : array, shapes (n_outputs, n_inputs), (..., n_memory) and (..., n_smooth)
        Gains from inputs, memory values and smooth functions to the outputs.
    constant : array, shape (n_outputs,)
        Outputs where all those are zero.
    sticking : bool
        Whether it keeps the first input at `level`. Such a mode exists only where the loop pulls back against the
        element's jump there: where the input's rate falls as the output rises for an upward `jump` (and the reverse).
    level, jump : float
        Value of the first input while it sticks; direction of the jump of the output there.
    """

    name: str
    from_input: Array
    from_memory: Array
    from_smooth: Array
    constant: Array
    sticking: bool = False
    level: float = 0.0
    jump: float = 1.0


@dataclass(frozen=True)
class Guard:
    """Event of an element: fires in `mode` where its value rises through zero, and leads to `target`.

    With inputs z, outputs w and memory values h of the element,
    ``value = on_input @ z + on_rate @ dz/dt + on_memory @ h + on_output @ w + constant``. At the event the memory
    values become ``memory_from_input @ z + memory_from_memory @ h + memory_constant``, and the first output has an
    impulse of the strength ``impulse @ z``, by which states that integrate it jump.

    Parameters
    ----------
    name : str
        As a run names its events.
    mode, target, bypass : int
        Numbers of the mode in which it fires and of that it leads to, which is `bypass` (-1: none) where the target
        is a sticking mode that the loop does not admit.
    on_threshold : int
        Number of the mode that it leads to where a jump, of an input or at a sample, leaves its value at zero and there
        it stays (-1: the mode does not change). One that sticks, and that the loop does not admit, then has its own
        output until the input moves off its level.
    on_input, on_rate, on_memory, on_output, impulse, constant : array or float
        Weights of its value, one for each input, memory value or output, and those of the impulse.
    memory_from_input, memory_from_memory, memory_constant : array
        What the n memory values become at the event; shapes (n, inputs), (n, n) and (n,).
    """

    name: str
    mode: int
    target: int
    on_input: Array
    on_rate: Array
    on_memory: Array
    on_output: Array
    constant: float
    memory_from_input: Array
    memory_from_memory: Array
    memory_constant: Array
    impulse: Array
    bypass: int = -1
    on_threshold: int = -1


@dataclass(frozen=True)
class Smooth:
    """Smooth function of the inputs z: ``sigma = scale * f(on_input @ z + on_smooth @ earlier + constant)``.

    Parameters
    ----------
    kind : str
        The function f: sine, square, cube, fourth_power, fifth_power, tanh, arctan, gaussian, exponential, logarithm
        (of the absolute value) or reciprocal_abs (``1/(1 + |u|)``).
    on_input : array, shape (n_inputs,)
        Weights of the inputs in its argument.
    constant, scale : float
        What is added to its argument, and what its value is multiplied by.
    on_smooth : tuple of float, optional
        Weights of the functions before it in the automaton, in their order.
    """

    kind: str
    on_input: Array
    constant: float = 0.0
    scale: float = 1.0
    on_smooth: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Automaton:
    """Modes, guards and start of one element.

    Parameters
    ----------
    n_inputs, n_outputs, n_memory : int
        Numbers of its inputs z, outputs w and memory values h.
    modes : sequence of Mode
        Numbered in this order.
    guards : sequence of Guard
        Of all modes; each names its own by its number.
    start_mode : int
        The first mode of a run.
    start_memory : array, shape (n_memory,)
        Memory values at its start.
    smooth : tuple of Smooth
        Smooth functions of the inputs that outputs may be made of.

    Raises
    ------
    ModelError
        If a mode that a guard or the start names does not exist, a guard bypasses one that does not stick, or an array
        has a wrong shape.

    See Also
    --------
    AutomatonBuilder : Collects modes and guards, and fills in the zeros.
    AutomatonElement : The element of a loop that is one.

    Examples
    --------
    A relay that switches on above 1 and off below -1:

    >>> import eppanalysis as epp
    >>> build = epp.AutomatonBuilder()
    >>> off, on = build.mode("off"), build.mode("on", constant=5.0)
    >>> build.guard("switches on", off, on, on_input=1.0, constant=-1.0)
    >>> build.guard("switches off", on, off, on_input=-1.0, constant=-1.0)
    >>> relay = build.build()
    >>> len(relay.modes), relay.guards[0].name
    (2, 'switches on')
    """

    n_inputs: int
    n_outputs: int
    n_memory: int
    modes: Sequence[Mode]
    guards: Sequence[Guard]
    start_mode: int = 0
    start_memory: Array = field(default_factory=lambda: np.zeros(0))
    smooth: tuple[Smooth, ...] = ()

    def __post_init__(self) -> None:
        require_shapes(self.modes, self._mode_shapes)
        require_shapes(self.guards, self._guard_shapes)
        require_shapes(self.smooth, {"on_input": (self.n_inputs,)})
        if np.shape(self.start_memory) != (self.n_memory,):
            raise ModelError(
                f"Automaton: start_memory has shape {np.shape(self.start_memory)}; expected {(self.n_memory,)}."
            )
        self._require_places()
        for channel in self.smooth:
            if channel.kind not in SMOOTH_KINDS:
                known = ", ".join(map(repr, SMOOTH_KINDS))
                raise ModelError(f"Automaton: kind of a smooth function is {channel.kind!r}; expected one of {known}.")
        for before, channel in enumerate(self.smooth):
            if len(channel.on_smooth) > before:
                raise ModelError(
                    f"Automaton: on_smooth of smooth function {before} has {len(channel.on_smooth)} weights",
                    expected=f"at most {before}, of those before it",
                )

    def _require_places(self) -> None:
        """Modes that the start and the guards name exist, and what a guard bypasses sticks."""
        n = len(self.modes)
        wrong = [] if 0 <= self.start_mode < n else [("start_mode", self.start_mode)]
        for end, least in (("mode", 0), ("target", 0), ("bypass", -1), ("on_threshold", -1)):
            named = self.guard_columns[end]
            for i in np.flatnonzero((named < least) | (named >= n))[:1]:
                wrong.append((f"{end} of the guard {self.guards[i].name!r}", int(named[i])))
        for name, place in wrong:
            raise ModelError(f"Automaton: {name} is {place!r}; expected the number of a mode, 0 to {n - 1}.")
        sticks, guards = self.mode_columns["sticking"], self.guard_columns
        for i in np.flatnonzero((guards["bypass"] >= 0) & ~sticks[guards["target"]])[:1]:
            target = self.modes[guards["target"][i]].name
            raise ModelError(
                f"Automaton: the guard {self.guards[i].name!r} has a bypass past {target!r}, which does not stick",
                expected="none, or a target that sticks",
            )

    @property
    def _mode_shapes(self) -> dict[str, tuple[int, ...]]:
        z, w, h, s = self.n_inputs, self.n_outputs, self.n_memory, len(self.smooth)
        return {"from_input": (w, z), "from_memory": (w, h), "from_smooth": (w, s), "constant": (w,)}

    @property
    def _guard_shapes(self) -> dict[str, tuple[int, ...]]:
        z, w, h = self.n_inputs, self.n_outputs, self.n_memory
        return {
            "on_input": (z,), "on_rate": (z,), "on_memory": (h,), "on_output": (w,), "constant": (),
            "memory_from_input": (h, z), "memory_from_memory": (h, h), "memory_constant": (h,), "impulse": (z,),
        }  # fmt: skip

    @cached_property
    def mode_columns(self) -> ByName:
        """Fields of the modes, one array each."""
        return in_columns(Mode, self.modes, self._mode_shapes)

    @cached_property
    def guard_columns(self) -> ByName:
        """Fields of the guards, one array each."""
        return in_columns(Guard, self.guards, self._guard_shapes)

    @cached_property
    def by_mode(self) -> IntArray:
        """Numbers of the guards, those of each mode together."""
        return np.argsort(self.guard_columns["mode"], kind="stable")

    @cached_property
    def guards_by_mode(self) -> ByName:
        """Fields of the guards in the order of `by_mode`."""
        return {name: column[self.by_mode] for name, column in self.guard_columns.items()}

    @cached_property
    def first_of_mode(self) -> IntArray:
        """Where the guards of each mode begin in `by_mode`, shape (modes + 1,)."""
        counts = np.bincount(self.guard_columns["mode"], minlength=len(self.modes))
        return np.concatenate([[0], np.cumsum(counts)])

    def guards_of(self, mode: int) -> list[Guard]:
        """Guards of a mode, in their order."""
        return [self.guards[i] for i in self.by_mode[self.first_of_mode[mode] : self.first_of_mode[mode + 1]].tolist()]

    @cached_property
    def smooth_on_smooth(self) -> Array:
        """Weights of smooth functions in one another's arguments, shape (n_smooth, n_smooth), below the diagonal."""
        out = np.zeros((len(self.smooth), len(self.smooth)))
        for row, channel in zip(out, self.smooth, strict=True):
            row[: len(channel.on_smooth)] = channel.on_smooth
        return out

    def smooth_at(self, z: Array) -> Array:
        """Values of the smooth functions, shape (n_smooth,), at inputs z, shape (n_inputs,)."""
        sigma = np.zeros(len(self.smooth))
        for i, (channel, weights) in enumerate(zip(self.smooth, self.smooth_on_smooth, strict=True)):
            argument = float(channel.on_input @ z + channel.constant + weights @ sigma)
            sigma[i] = channel.scale * SMOOTH_FUNCTIONS[channel.kind](argument)
        return sigma

    @cached_property
    def has_impulses(self) -> bool:
        """Whether its output has impulses: states of the loop jump at events."""
        return bool(np.any(self.guard_columns["impulse"]))

    @cached_property
    def followed(self) -> BoolArray:
        """Modes in which the output follows the input, and holds its value when the input turns back."""
        out = np.zeros(len(self.modes), bool)
        if self.n_memory:
            out[self.guard_columns["mode"][np.any(self.guard_columns["on_rate"] != 0.0, axis=1)]] = True
        return out


class AutomatonBuilder:
    """Collects modes and guards with the zeros filled in, so that element code states only what is not zero.

    Parameters
    ----------
    n_inputs, n_outputs, n_memory : int
        Numbers of inputs, outputs and memory values.
    smooth : tuple of Smooth
        Smooth functions of the inputs.
    """

    def __init__(
        self, n_inputs: int = 1, n_outputs: int = 1, n_memory: int = 0, smooth: tuple[Smooth, ...] = ()
    ) -> None:
        self.n_inputs, self.n_outputs, self.n_memory, self.smooth = n_inputs, n_outputs, n_memory, smooth
        self.modes: list[Mode] = []
        self.guards: list[Guard] = []

    def mode(
        self,
        name: str,
        from_input: ArrayLike = 0.0,
        from_memory: ArrayLike = 0.0,
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
                matrix(from_memory, self.n_memory),
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
        on_memory: ArrayLike = 0.0,
        on_output: ArrayLike = 0.0,
        constant: float = 0.0,
        memory_from_input: ArrayLike | None = None,
        memory_from_memory: ArrayLike | None = None,
        memory_constant: ArrayLike | None = None,
        bypass: int = -1,
        impulse: ArrayLike = 0.0,
        on_threshold: int = -1,
    ) -> None:
        """Add a guard; when no reset is given the memory values are kept."""
        keep = memory_from_input is None and memory_from_memory is None and memory_constant is None
        n, m = self.n_memory, self.n_inputs

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
                _vector(on_memory, n),
                _vector(on_output, self.n_outputs),
                float(constant),
                matrix(memory_from_input, m),
                np.eye(n) if keep else matrix(memory_from_memory, n),
                np.zeros(n) if memory_constant is None else _vector(memory_constant, n),
                _vector(impulse, m),
                bypass,
                on_threshold,
            )
        )

    def build(self, start_mode: int = 0, start_memory: ArrayLike = 0.0) -> Automaton:
        """The finished automaton.

        Parameters
        ----------
        start_mode, start_memory : int and array_like, shape (n_memory,)
            Mode and memory values at the start.
        """
        return Automaton(
            self.n_inputs,
            self.n_outputs,
            self.n_memory,
            tuple(self.modes),
            tuple(self.guards),
            start_mode,
            _vector(start_memory, self.n_memory),
            self.smooth,
        )


def slopes_of(automaton: Automaton) -> tuple[Array, Array]:
    """Least and greatest slope of each output over each input, shapes (n_outputs, n_inputs); infinite at a jump.

    In a mode the slopes are in `from_input`. At an event the output jumps where it differs, by what the reset writes,
    from what it was, and not just by a multiple of the guard, which is zero there. Where the sign of a jump depends on
    inputs or memory values, for smooth functions of the inputs, and of an output with impulses, nothing is known.
    """
    shape = automaton.n_outputs, automaton.n_inputs
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    if automaton.has_impulses:
        _widen(low, high, -np.inf, np.inf)
    seen = np.array([s.on_input != 0 for s in automaton.smooth]).reshape(-1, shape[1])
    for own, weights in zip(seen, automaton.smooth_on_smooth, strict=True):
        own |= np.any(seen[weights != 0], axis=0)
    for mode in automaton.modes:
        if mode.sticking:
            _widen(low, high, np.copysign(np.inf, mode.jump) * (np.arange(shape[1]) == 0)[None, :])
            continue
        _widen(low, high, mode.from_input)
        for place in np.flatnonzero(np.any(mode.from_smooth, axis=0)):
            reached = np.outer(mode.from_smooth[:, place] != 0, seen[place])
            low[reached], high[reached] = -np.inf, np.inf
    for guard in automaton.guards:
        before, after = automaton.modes[guard.mode], automaton.modes[guard.target]
        if not (before.sticking or after.sticking):
            _widen(low, high, *_jumps(guard, before, after))
    return low, high


def _widen(low: Array, high: Array, *slopes: Array | float) -> None:
    for values in slopes:
        np.minimum(low, values, out=low)
        np.maximum(high, values, out=high)


def _jumps(guard: Guard, before: Mode, after: Mode) -> tuple[Array, Array]:
    """Slopes (n_outputs, n_inputs) at an event: infinite for outputs that jump with an input, zero otherwise."""
    memory = np.hstack([guard.memory_from_input, guard.memory_from_memory, guard.memory_constant[:, None]])
    was = np.hstack([before.from_input, before.from_memory, before.constant[:, None]])
    # As rows on inputs, memory values and one: the new output, with what the reset writes, less the old one.
    new = (
        np.hstack([after.from_input, np.zeros_like(after.from_memory), after.constant[:, None]])
        + after.from_memory @ memory
    )
    row = np.concatenate([guard.on_input, guard.on_memory, [guard.constant]]) + guard.on_output @ was
    if np.any(guard.on_rate):
        # A guard on rates fixes no value of the inputs, so that nothing of the change vanishes with it.
        row = np.zeros_like(row)
    change, size = new - was, np.abs(new) + np.abs(was)
    # The guard is zero at its event: of the change all that is a multiple of its row vanishes there, what is left is a
    # jump.
    share = change[:, :-1] @ row[:-1] / (row[:-1] @ row[:-1] or 1.0)
    left = change - np.outer(share, row)
    left[np.abs(left) <= 1e-12 * (size.max(axis=1, keepdims=True) + np.abs(np.outer(share, row)))] = 0.0
    jumps = np.any(left != 0.0, axis=1)
    known = ~np.any(left[:, :-1] != 0.0, axis=1)
    by = np.where(np.any(guard.on_rate), guard.on_rate, row[: guard.on_input.size])
    sign = np.where(known, np.sign(left[:, -1]), 0.0)[:, None] * np.sign(by)[None, :]
    steep = np.where(jumps[:, None] & (by != 0.0)[None, :], np.inf, 0.0)
    slope = before.from_input
    return (
        np.where((steep > 0) & (sign <= 0), -np.inf, slope),
        np.where((steep > 0) & (sign >= 0), np.inf, slope),
    )


def switching_levels(automaton: Automaton, bias: float = 0.0) -> Array:
    """Values of the first input, from `bias`, at which guards on it rise; how far it must go where they compare it
    with a memory value.
    """
    guards = [g for g in automaton.guards if g.on_input[0] != 0.0]
    return np.array([-g.constant / g.on_input[0] - (0.0 if np.any(g.on_memory) else bias) for g in guards])
