"""What single elements do in time, each written from its definition in words, for the slow reference integrator.

A handler knows an element with one input ``z`` and one output ``w``. Its discrete state is a small tuple. A sticking
friction element has no output of its own: the integrator finds the force that keeps ``z`` constant.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

State = tuple[Any, ...]


class Situation(NamedTuple):
    """Input, its rate and output of one element at one instant."""

    z: float
    rate: float
    w: float


class Watch(NamedTuple):
    """An event of one element: fires where `value` rises through zero."""

    label: str
    value: Callable[[Situation], float]
    scale: float = 1.0


class Handler:
    """One element; the base class has a single state and no events."""

    def start(self, now: Situation, memory: float | None) -> State:
        """State at the start, from the input and the memory (None: the element's own)."""
        return ()

    def output(self, z: float, state: State) -> tuple[float, float]:
        """Output and its slope over the input."""
        raise NotImplementedError

    def watches(self, state: State) -> list[Watch]:
        """Events of a state."""
        return []

    def fire(self, label: str, now: Situation, state: State) -> State:
        """State after an event."""
        return state

    def jumped(self, before: float, after: float, state: State) -> State:
        """State after another element has made the input jump; the input before and after."""
        return state

    def settle(self, now: Situation, state: State) -> State:
        """State made consistent after the input or its rate jumped because of another element."""
        return state


@dataclass
class Smooth(Handler):
    """``w = function(z)`` with its derivative."""

    function: Callable[[float], float]
    slope: Callable[[float], float]

    def output(self, z: float, state: State) -> tuple[float, float]:
        """Value and derivative."""
        return self.function(z), self.slope(z)


@dataclass
class Pieces(Handler):
    """Straight pieces between breakpoints; the state is the number of the piece."""

    breakpoints: np.ndarray
    slopes: np.ndarray
    intercepts: np.ndarray

    def start(self, now: Situation, memory: float | None) -> State:
        """Piece that holds the input."""
        return (int(np.searchsorted(self.breakpoints, now.z, side="right")),)

    def output(self, z: float, state: State) -> tuple[float, float]:
        """The straight line of the piece."""
        slope = float(self.slopes[state[0]])
        return slope * z + float(self.intercepts[state[0]]), slope

    def watches(self, state: State) -> list[Watch]:
        """Both ends of the piece."""
        i, out = state[0], []
        if i < len(self.breakpoints):
            upper = float(self.breakpoints[i])
            out.append(Watch(f"piece {i + 1}", lambda now: now.z - upper, max(abs(upper), 1.0)))
        if i > 0:
            lower = float(self.breakpoints[i - 1])
            out.append(Watch(f"piece {i - 1}", lambda now: lower - now.z, max(abs(lower), 1.0)))
        return out

    def fire(self, label: str, now: Situation, state: State) -> State:
        """The neighbouring piece."""
        return (int(label.split()[1]),)

    def settle(self, now: Situation, state: State) -> State:
        """Another piece where the input has jumped out of the present one."""
        i = state[0]
        slack = 1e-9 * max(1e-3, abs(now.z))
        below = i > 0 and now.z < self.breakpoints[i - 1] - slack
        above = i < len(self.breakpoints) and now.z > self.breakpoints[i] + slack
        return self.start(now, None) if below or above else state


@dataclass
class Levels(Handler):
    """Output levels with thresholds that differ on the way up and down: relays with hysteresis.

    ``up[i]`` leads from level i to i + 1 where z rises through it, ``down[i]`` back where z falls through it.
    """

    levels: tuple[float, ...]
    up: tuple[float, ...]
    down: tuple[float, ...]

    def start(self, now: Situation, memory: float | None) -> State:
        """The level nearest to the memory; without one the middle (or lower) level, then what the input forces."""
        i = (len(self.levels) - 1) // 2
        if memory is not None:
            i = int(np.argmin([abs(level - memory) for level in self.levels]))
        return self.settle(now, (i,))

    def output(self, z: float, state: State) -> tuple[float, float]:
        """The level."""
        return self.levels[state[0]], 0.0

    def watches(self, state: State) -> list[Watch]:
        """The thresholds of the level."""
        i, out = state[0], []
        if i < len(self.up):
            upper = self.up[i]
            out.append(Watch("up", lambda now: now.z - upper, max(abs(upper), 1.0)))
        if i > 0:
            lower = self.down[i - 1]
            out.append(Watch("down", lambda now: lower - now.z, max(abs(lower), 1.0)))
        return out

    def fire(self, label: str, now: Situation, state: State) -> State:
        """One level up or down."""
        return (state[0] + (1 if label == "up" else -1),)

    def settle(self, now: Situation, state: State) -> State:
        """Levels passed in a jump of the input."""
        i = state[0]
        while i < len(self.up) and now.z > self.up[i]:
            i += 1
        while i > 0 and now.z < self.down[i - 1]:
            i -= 1
        return (i,)


@dataclass
class Follower(Handler):
    """Holds its output until the input has gone `reach` from it, then follows at the distance `lag`.

    Play: reach = lag = half the gap. Jump and follow: reach = (S + J)/2, lag = (S - J)/2, so that from the rising line
    the output waits for a reversal of S (and for a further J in the old direction) and then jumps by J.
    The state is (motion, held value): motion +1 rising, -1 falling, 0 held. The output is `gain` times the value.
    """

    reach: float
    lag: float
    gain: float = 1.0

    def start(self, now: Situation, memory: float | None) -> State:
        """The memory (an output; on its way, with the direction), moved as far as the input forces."""
        value = getattr(memory, "value", 0.0 if memory is None else memory)
        return self.settle(now, (int(getattr(memory, "direction", 0)), float(value) / self.gain))

    def output(self, z: float, state: State) -> tuple[float, float]:
        """Held or following."""
        motion, held = state
        return (self.gain * held, 0.0) if motion == 0 else (self.gain * (z - motion * self.lag), self.gain)

    def watches(self, state: State) -> list[Watch]:
        """Break away when held; stop where the input's rate changes its sign when following."""
        motion, held = state
        if motion:
            return [Watch("holds", lambda now: -motion * now.rate)]
        scale = max(self.reach, 1.0)
        return [
            Watch("rises", lambda now: now.z - held - self.reach, scale),
            Watch("falls", lambda now: held - now.z - self.reach, scale),
        ]

    def fire(self, label: str, now: Situation, state: State) -> State:
        """The new motion."""
        if label == "holds":
            return (0, now.z - state[0] * self.lag)
        return (1 if label == "rises" else -1, state[1])

    def jumped(self, before: float, after: float, state: State) -> State:
        """Left behind where the input jumps against the motion."""
        motion = state[0]
        return (0, before - motion * self.lag) if motion * (after - before) < -1e-12 else state

    def settle(self, now: Situation, state: State) -> State:
        """Stops where the rate has jumped to the other sign; is carried along where the input has jumped."""
        motion, held = state
        if motion and motion * now.rate < 0.0:
            motion, held = 0, now.z - motion * self.lag
        if motion == 0 and abs(now.z - held) > self.reach * (1.0 + 1e-9):
            side = 1 if now.z > held else -1
            held = now.z - side * self.lag
            # It follows in that direction until the input reverses: only then a new break-away is due.
            motion = 0 if side * now.rate < 0.0 else side
        return (motion, held)


@dataclass
class DryFriction(Handler):
    """Force over a velocity z: `kinetic(|z|)` against the motion; sticks while the force needed is below `static`.

    The state is (sign,), 0 for sticking.
    """

    static: float
    kinetic: Callable[[float], float]
    kinetic_slope: Callable[[float], float]

    def start(self, now: Situation, memory: float | None) -> State:
        """Slips with the sign of the velocity; at rest it sticks (`settle` breaks it away when it must)."""
        return (int(np.sign(now.z)),)

    def output(self, z: float, state: State) -> tuple[float, float]:
        """Kinetic force; nan while sticking, for the integrator to fill in."""
        sign = state[0]
        if sign == 0:
            return math.nan, 0.0
        return sign * self.kinetic(sign * z), self.kinetic_slope(sign * z)

    def watches(self, state: State) -> list[Watch]:
        """Break away when sticking, velocity zero when slipping."""
        sign, scale = state[0], max(self.static, 1.0)
        if sign == 0:
            return [
                Watch("slips+", lambda now: now.w - self.static, scale),
                Watch("slips-", lambda now: -now.w - self.static, scale),
            ]
        return [Watch("sticks", lambda now: -sign * now.z)]

    def fire(self, label: str, now: Situation, state: State) -> State:
        """The new sign."""
        return ({"slips+": 1, "slips-": -1, "sticks": 0}[label],)

    def settle(self, now: Situation, state: State) -> State:
        """Breaks away at once where sticking would need more than the static force."""
        if state[0] == 0 and abs(now.w) > self.static * (1.0 + 1e-12):
            return (1 if now.w > 0.0 else -1,)
        return state


def handler_of(element: Any) -> Handler:
    """Handler of an element of the package, from its class name and its fields.

    Raises
    ------
    NotImplementedError
        If the element is not one of those above.
    """
    name = type(element).__name__
    makers: dict[str, Callable[[Any], Handler]] = {
        "HysteresisRelay": lambda e: Levels((e.low, e.high), (e.upper,), (e.lower,)),
        "HysteresisRelayDeadZone": lambda e: Levels((-e.level, 0.0, e.level), (-e.off, e.on), (-e.on, e.off)),
        "Play": lambda e: Follower(e.gap / 2.0, e.gap / 2.0),
        "JumpAndFollow": lambda e: Follower(
            (e.stick_band + e.slip_jump) / 2.0, (e.stick_band - e.slip_jump) / 2.0, e.slope
        ),
        "Friction": _dry_friction,
        "Cube": lambda e: Smooth(lambda z: e.scale * z**3, lambda z: 3.0 * e.scale * z * z),
        "Sine": lambda e: Smooth(lambda z: e.scale * math.sin(z), lambda z: e.scale * math.cos(z)),
        "Tanh": lambda e: Smooth(
            lambda z: e.level * math.tanh(e.slope * z / e.level),
            lambda z: e.slope * (1.0 - math.tanh(e.slope * z / e.level) ** 2),
        ),
    }
    if name in makers:
        return makers[name](element)
    if hasattr(element, "breakpoints") and hasattr(element, "intercepts"):
        return Pieces(np.asarray(element.breakpoints), np.asarray(element.slopes), np.asarray(element.intercepts))
    raise NotImplementedError(f"the reference integrator does not know {name}")


def _dry_friction(element: Any) -> Handler:
    static = element.coulomb if element.static is None else element.static
    b = element.stribeck
    if b == 0.0:
        return DryFriction(static, lambda v: element.coulomb, lambda v: 0.0)
    return DryFriction(static, lambda v: static / (1.0 + b * v), lambda v: -static * b / (1.0 + b * v) ** 2)
