"""The automata of all elements: what each one does between events, and when it switches.

Names of modes and events are what users read in the event list. Every guard is an affine function that rises through
zero at its event; see :mod:`eppanalysis.models.elements.automaton` for the notation (inputs z, outputs w, memory values
h).
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arrays import Array, IntArray
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder, Guard, Mode, Smooth
from eppanalysis.models.elements.columns import ByName, Columns


def static_map(breakpoints: ArrayLike, slopes: ArrayLike, intercepts: ArrayLike, at: Array) -> Automaton:
    """Piecewise-linear map; at a jump there is also a mode that slides along it.

    The modes are the pieces, then the slides; as columns, for a map may have thousands of which a run visits a few. An
    input that jumps to a breakpoint and stays there gives the map's output `at` it: that of either side, or between.
    """
    x, a, b = (np.atleast_1d(np.asarray(v, float)) for v in (breakpoints, slopes, intercepts))
    left, right = a[:-1] * x + b[:-1], a[1:] * x + b[1:]
    jumps = np.abs(right - left) > 1e-12 * np.maximum(np.abs(left), np.abs(right))
    placed, zero = np.flatnonzero(jumps), np.zeros(np.count_nonzero(jumps))
    n = a.size + placed.size
    modes = {
        "from_input": np.concatenate([a, zero])[:, None, None],
        "from_memory": np.zeros((n, 1, 0)),
        "from_smooth": np.zeros((n, 1, 0)),
        "constant": np.concatenate([b, at[placed]])[:, None],
        "sticking": np.arange(n) >= a.size,
        "level": np.concatenate([np.zeros(a.size), x[placed]]),
        "jump": np.concatenate([np.ones(a.size), (right - left)[placed]]),
    }
    guards, numbers = _crossings(x, left, right, at, np.where(jumps, a.size + np.cumsum(jumps) - 1, -1))
    return Automaton(
        n_inputs=1,
        n_outputs=1,
        n_memory=0,
        modes=Columns(Mode, partial(_name_of_piece, a.size, placed), modes),
        guards=Columns(Guard, partial(_name_of_crossing, numbers), guards),
        start_mode=a.size // 2,
    )


def _crossings(x: Array, left: Array, right: Array, at: Array, slide: IntArray) -> tuple[ByName, IntArray]:
    """Guards of a static map in columns, with their numbers among four for each breakpoint.

    The four: the slide along it is left upward and downward, the input rises and falls through it.

    Parameters
    ----------
    x, left, right, at : arrays, shape (k,)
        Breakpoints, and the output on both sides of each and at it.
    slide : int array, shape (k,)
        Mode that slides along the jump there, -1 where there is none.
    """
    below, jumps = np.arange(x.size), slide >= 0
    above, up, zero, one = below + 1, np.where(right > left, 1.0, -1.0), np.zeros(x.size), np.ones(x.size)
    numbers = np.flatnonzero(np.column_stack([jumps, jumps, one > 0, one > 0]))
    n, none = numbers.size, np.full(x.size, -1)
    # A side that has the breakpoint is entered from the other one, and not left; else the input rests between them.
    rises = np.where(at == right, above, np.where(at == left, none, slide))
    falls = np.where(at == left, below, np.where(at == right, none, slide))

    def column(*of_four: NDArray[Any]) -> NDArray[Any]:
        """A column from its values for each of the four."""
        return np.column_stack(of_four).ravel()[numbers]

    return {
        "mode": column(slide, slide, below, above),
        "target": column(above, below, np.where(jumps, slide, above), np.where(jumps, slide, below)),
        "on_input": column(zero, zero, one, -one)[:, None],
        "on_rate": np.zeros((n, 1)),
        "on_memory": np.zeros((n, 0)),
        "on_output": column(up, -up, zero, zero)[:, None],
        "constant": column(-up * right, up * left, -x, x),
        "memory_from_input": np.zeros((n, 0, 1)),
        "memory_from_memory": np.zeros((n, 0, 0)),
        "memory_constant": np.zeros((n, 0)),
        "impulse": np.zeros((n, 1)),
        # What the loop does not keep on the jump passes it at once (docs/theory/engine.md, Modes).
        "bypass": column(none, none, np.where(jumps, above, none), np.where(jumps, below, none)),
        "on_threshold": column(none, none, np.where(jumps, rises, none), np.where(jumps, falls, none)),
    }, numbers


def _name_of_piece(n_pieces: int, at: IntArray, i: int) -> str:
    return f"piece {i + 1}" if i < n_pieces else f"slides at breakpoint {at[i - n_pieces] + 1}"


def _name_of_crossing(numbers: IntArray, i: int) -> str:
    number, way = divmod(int(numbers[i]), 4)
    at = f"breakpoint {number + 1}"
    return (f"leaves {at} upward", f"leaves {at} downward", f"rises through {at}", f"falls through {at}")[way]


def smooth(kind: str, scale: float) -> Automaton:
    """Smooth memoryless element ``scale * f(z)``."""
    build = AutomatonBuilder(smooth=(Smooth(kind, np.ones(1), 0.0, scale),))
    build.mode("smooth", from_smooth=1.0)
    return build.build()


def friction(coulomb: float, static: float, stribeck: float = 0.0) -> Automaton:
    """Friction force of a velocity: slips either way, sticks at zero while it can hold."""
    if stribeck > 0:
        return sticking(static, 0.0, law=(Smooth("reciprocal_abs", np.array([stribeck]), 0.0, static),))
    return sticking(static, coulomb)


def decay(shape: float, velocity: float, scale: float) -> tuple[tuple[Smooth, ...], float]:
    """Smooth functions of which the last, and a constant with it, are ``scale*exp(-|v/velocity|**shape)``.

    Even shapes are a Gaussian of a power, odd ones are what ``exp(-2|p|) = 2/(1 + |tanh p|) - 1`` makes of one, and
    those that are no whole number from 1 to 6 are made of the logarithm.
    """
    u, none = np.array([1 / velocity]), np.zeros(1)
    if shape not in range(1, 7):
        power = Smooth("exponential", none, on_smooth=(shape,))
        return (Smooth("logarithm", u), power, Smooth("exponential", none, 0.0, scale, (0.0, -1.0))), 0.0
    if shape == 2:
        return (Smooth("gaussian", u, 0.0, scale),), 0.0
    if shape == 1:
        return (Smooth("tanh", u / 2), Smooth("reciprocal_abs", none, 0.0, 2 * scale, (1.0,))), -scale
    power = Smooth({3.0: "cube", 4.0: "square", 5.0: "fifth_power", 6.0: "cube"}[shape], u)
    if shape % 2 == 0:
        return (power, Smooth("gaussian", none, 0.0, scale, (1.0,))), 0.0
    bent = Smooth("tanh", none, on_smooth=(0.5,))
    return (power, bent, Smooth("reciprocal_abs", none, 0.0, 2 * scale, (0.0, 1.0))), -scale


class Creep(NamedTuple):
    """Line of a friction below a velocity, its edge."""

    edge: float
    level: float
    slope: float


def sticking(
    static: float,
    level: float,
    viscous: float = 0.0,
    law: tuple[Smooth, ...] = (),
    creep: Creep | None = None,
) -> Automaton:
    """Force against a velocity: sticks at zero up to `static`, slips with `level`, the law and the viscous part.

    Parameters
    ----------
    law : tuple of Smooth
        The last of them is what falls with speed; or nothing.
    creep : Creep, optional
        The line in place of all of them at small velocities.
    """
    build, falls = AutomatonBuilder(smooth=law), np.eye(1, len(law), len(law) - 1)[0]
    stick = build.mode("stuck", sticking=True)
    forward = build.mode("slips forward", from_input=viscous, from_smooth=falls, constant=level)
    backward = build.mode("slips backward", from_input=viscous, from_smooth=-falls, constant=-level)
    slow = forward, backward
    if creep:
        slow = (
            build.mode("creeps forward", from_input=creep.slope, constant=creep.level),
            build.mode("creeps backward", from_input=creep.slope, constant=-creep.level),
        )
    build.guard("breaks away forward", stick, slow[0], on_output=1.0, constant=-static)
    build.guard("breaks away backward", stick, slow[1], on_output=-1.0, constant=-static)
    build.guard("sticks", slow[0], stick, on_input=-1.0, bypass=slow[1], on_threshold=stick)
    build.guard("sticks", slow[1], stick, on_input=1.0, bypass=slow[0], on_threshold=stick)
    if creep:
        for sign, creeps, slips in ((1.0, slow[0], forward), (-1.0, slow[1], backward)):
            build.guard("slips", creeps, slips, on_input=sign, constant=-creep.edge)
            build.guard("slows down", slips, creeps, on_input=-sign, constant=creep.edge)
    return build.build(stick)


def hysteresis_relay(lower: float, upper: float, low: float, high: float) -> Automaton:
    """Two-level relay that goes high above `upper` and low below `lower`."""
    build = AutomatonBuilder()
    off, on = build.mode("low", constant=low), build.mode("high", constant=high)
    build.guard("switches high", off, on, on_input=1.0, constant=-upper)
    build.guard("switches low", on, off, on_input=-1.0, constant=lower)
    return build.build(off)


def hysteresis_relay_dead_zone(on: float, off: float, level: float) -> Automaton:
    """Three-level relay with separate on and off thresholds."""
    build = AutomatonBuilder()
    zero = build.mode("off")
    plus, minus = build.mode("plus", constant=level), build.mode("minus", constant=-level)
    build.guard("switches plus", zero, plus, on_input=1.0, constant=-on)
    build.guard("switches minus", zero, minus, on_input=-1.0, constant=-on)
    build.guard("switches off", plus, zero, on_input=-1.0, constant=off)
    build.guard("switches off", minus, zero, on_input=1.0, constant=off)
    return build.build(zero)


def play(gap: float) -> Automaton:
    """Friction-driven backlash: the output rests in the gap (memory value) or is pushed by either side."""
    return plays(np.array([gap / 2]), np.ones(1), 0.0)


def plays(half_widths: Array, weights: Array, straight: float) -> Automaton:
    """The input and plays of ascending half-widths, weighted: all plays rest (memory values), or the first ones move.

    A wider play never moves before a narrower one does, and all stop where the input turns back.
    """
    n = half_widths.size
    build = AutomatonBuilder(n_memory=n)
    for number in range(2 * n + 1):
        count, way = moving_plays(number)
        w = np.where(np.arange(n) < count, weights, 0.0)
        name = f"pushed {'up' if way > 0 else 'down'}" if count else "in the gap"
        build.mode(
            f"{name} by {count}" if count and n > 1 else name,
            from_input=straight + w.sum(),
            from_memory=weights - w,
            constant=0.0 - way * float(w @ half_widths),
        )
    for number in range(2 * n + 1):
        count, way = moving_plays(number)
        for ahead, name in ((1.0, "upper"), (-1.0, "lower")):
            if count < n and way != -ahead:
                target, row = 2 * count + (1 if ahead > 0 else 2), -ahead * np.eye(n)[count]
                b = float(half_widths[count])
                build.guard(f"meets the {name} side", number, target, on_input=ahead, on_memory=row, constant=-b)
        if count:
            # Pushed, the input is as far from the outputs as ever: only its rate tells that it turns back.
            moving = np.arange(n) < count
            build.guard(
                "lets go",
                number,
                0,
                on_rate=-way,
                memory_from_input=np.where(moving, 1.0, 0.0)[:, None],
                memory_from_memory=np.diag(np.where(moving, 0.0, 1.0)),
                memory_constant=np.where(moving, -way * half_widths, 0.0),
            )
    return build.build(0)


def moving_plays(mode: int) -> tuple[int, float]:
    """How many of the plays move in a mode of :func:`plays`, and which way."""
    return (mode + 1) // 2, (0.0 if mode == 0 else 1.0 if mode % 2 else -1.0)


def backlash_compensator(gap: float, travel: float) -> Automaton:
    """Half the gap on the side to which the input moves; over the travel behind a reversal a line takes it there."""
    b = gap / 2
    build = AutomatonBuilder(n_memory=1 if travel else 0)
    steep = gap / travel if travel else 0.0
    turns = build.mode("turns", from_input=1.0 + steep, from_memory=-steep)
    up, down = build.mode("leads up", from_input=1.0, constant=b), build.mode("leads down", from_input=1.0, constant=-b)
    if not travel:
        build.guard("moves up", turns, up, on_rate=1.0)
        build.guard("moves down", turns, down, on_rate=-1.0)
        build.guard("turns down", up, down, on_rate=-1.0)
        build.guard("turns up", down, up, on_rate=1.0)
        return build.build(turns)
    half = travel / 2
    build.guard("has turned up", turns, up, on_input=1.0, on_memory=-1.0, constant=-half)
    build.guard("has turned down", turns, down, on_input=-1.0, on_memory=1.0, constant=-half)
    build.guard("turns down", up, turns, on_rate=-1.0, memory_from_input=1.0, memory_constant=-half)
    build.guard("turns up", down, turns, on_rate=1.0, memory_from_input=1.0, memory_constant=half)
    return build.build(turns)


def jump_and_follow(stick_band: float, slip_jump: float, slope: float) -> Automaton:
    """Stiction relay: rests until the input has moved by the stick band, jumps, follows, rests on reversal."""
    offset, reach = (stick_band - slip_jump) / 2, (stick_band + slip_jump) / 2
    build = AutomatonBuilder(n_memory=1)
    rest = build.mode("stuck", from_memory=1.0)
    up = build.mode("follows up", from_input=slope, constant=-slope * offset)
    down = build.mode("follows down", from_input=slope, constant=slope * offset)
    build.guard("breaks away upward", rest, up, on_input=slope, on_memory=-1.0, constant=-slope * reach)
    build.guard("breaks away downward", rest, down, on_input=-slope, on_memory=1.0, constant=-slope * reach)
    build.guard("sticks", up, rest, on_rate=-1.0, memory_from_input=slope, memory_constant=-slope * offset)
    build.guard("sticks", down, rest, on_rate=1.0, memory_from_input=slope, memory_constant=slope * offset)
    return build.build(rest)


def stiction_pulley(
    harness_stiffness: float, forearm_stiffness: float, friction: float, kinetic_ratio: float
) -> Automaton:
    """Cable over a pulley with friction proportional to its load: outputs (sensor force, harness force), held u.

    Stuck, the stretch ``u`` of the forearm side is kept; sliding, ``|F_h - F_f| = kinetic_ratio * friction * (F_h +
    F_f)`` makes it proportional to the total stretch s; slack, both forces vanish.
    """
    k_h, k_f, m = harness_stiffness, forearm_stiffness, friction
    rise, fall = pulley_slopes(k_h, k_f, kinetic_ratio * m)
    build = AutomatonBuilder(n_outputs=2, n_memory=1)
    stuck = build.mode("stuck", from_input=[[0.0], [k_h]], from_memory=[[k_f], [-k_h]])
    up = build.mode("slides up", from_input=[[k_f * rise], [k_h * (1 - rise)]])
    down = build.mode("slides down", from_input=[[k_f * fall], [k_h * (1 - fall)]])
    slack = build.mode("slack")
    load_up, load_down = (1 - m) * k_h, (1 + m) * k_h
    build.guard("breaks away upward", stuck, up, on_input=load_up, on_memory=-(load_up + (1 + m) * k_f))
    build.guard("breaks away downward", stuck, down, on_input=-load_down, on_memory=load_down + (1 - m) * k_f)
    build.guard("sticks", up, stuck, on_rate=-1.0, memory_from_input=rise)
    build.guard("sticks", down, stuck, on_rate=1.0, memory_from_input=fall)
    # Both lines of sliding pass through the origin, so that slack begins and ends without a jump.
    build.guard("goes slack", up, slack, on_input=-1.0, memory_constant=0.0)
    build.guard("goes slack", down, slack, on_input=-1.0, memory_constant=0.0)
    build.guard("goes taut", slack, up, on_input=1.0)
    return build.build(stuck)


def pulley_slopes(harness_stiffness: float, forearm_stiffness: float, friction: float) -> tuple[float, float]:
    """Forearm-side share u/s of the total stretch at ``|F_h - F_f| = friction (F_h + F_f)``: (rising, falling)."""
    k_h, k_f, m = harness_stiffness, forearm_stiffness, friction
    rise = (1 - m) * k_h / ((1 - m) * k_h + (1 + m) * k_f)
    fall = (1 + m) * k_h / ((1 + m) * k_h + (1 - m) * k_f)
    return rise, fall


def lock_pin(gap: float, stiffness: float, damping: float, unilateral: bool) -> Automaton:
    """Compliant backlash with inputs (delta, delta_rate); a unilateral contact only pushes."""
    b = gap / 2
    build = AutomatonBuilder(n_inputs=2)
    free = build.mode("free")
    plus = build.mode("contact plus", from_input=[stiffness, damping], constant=-stiffness * b)
    minus = build.mode("contact minus", from_input=[stiffness, damping], constant=stiffness * b)
    build.guard("makes contact plus", free, plus, on_input=[1.0, 0.0], constant=-b)
    build.guard("makes contact minus", free, minus, on_input=[-1.0, 0.0], constant=-b)
    build.guard("enters the gap", plus, free, on_input=[-1.0, 0.0], constant=b)
    build.guard("enters the gap", minus, free, on_input=[1.0, 0.0], constant=b)
    if not unilateral:
        return build.build(free)
    for sign, contact, side in ((1.0, plus, "plus"), (-1.0, minus, "minus")):
        # The damper of a contact that opens would pull: the torque ends at zero before the twist is back at the gap
        # (docs/theory/lock_pin.md).
        row = np.array([sign * stiffness, sign * damping])
        away = build.mode(f"released {side}")
        build.guard(f"releases {side}", contact, away, on_input=-row, constant=stiffness * b)
        build.guard(f"touches {side} again", away, contact, on_input=row, constant=-stiffness * b)
        build.guard("enters the gap", away, free, on_input=[-sign, 0.0], constant=b)
    return build.build(free)


def nordin_shaft(gap: float, stiffness: float, damping: float) -> Automaton:
    """Shaft with inner damping behind a gap: inputs (delta, delta_rate, contact angle), outputs (torque, its rate).

    The contact angle leaves a side as its drift there turns inwards, and does not come back before that, the drift at
    the side, has turned outwards again. Until then the side is not looked for, on which the angle still is but for
    rounding.
    """
    b = gap / 2
    build = AutomatonBuilder(n_inputs=3, n_outputs=2)
    relax = stiffness / damping
    drift = np.array([[0.0, 0.0, 0.0], [relax, 1.0, -relax]])
    free = build.mode("free", from_input=drift)
    torque = [[stiffness, damping, 0.0], [0.0, 0.0, 0.0]]
    sides = []
    for name, sign in (("plus", 1.0), ("minus", -1.0)):
        contact = build.mode(f"contact {name}", from_input=torque, constant=[-sign * stiffness * b, 0.0])
        leaving = build.mode(f"leaving {name}", from_input=drift)
        build.guard(f"makes contact {name}", free, contact, on_input=[0.0, 0.0, sign], constant=-b)
        build.guard(f"releases {name}", contact, leaving, on_output=[-sign, 0.0])
        inward = [sign * relax, sign, 0.0]
        build.guard(f"turns back to {name}", leaving, free, on_input=inward, constant=-relax * b)
        sides.append((sign, contact, leaving))
    for (sign, contact, _), (_, _, leaving) in zip(sides, sides[::-1], strict=True):
        name = "plus" if sign > 0 else "minus"
        build.guard(f"makes contact {name}", leaving, contact, on_input=[0.0, 0.0, sign], constant=-b)
    return build.build(free)


def parking(
    breakpoints: ArrayLike, slopes: ArrayLike, intercepts: ArrayLike, low: float, high: float, dwell_time: float
) -> Automaton:
    """Band law with inputs (force, clock) that parks after `dwell_time` between `low` and `high`, until above `high`.

    The memory value is the clock at the last entry into the parking band.
    """
    x, a, b = (np.atleast_1d(np.asarray(v, float)) for v in (breakpoints, slopes, intercepts))
    build = AutomatonBuilder(n_inputs=2, n_memory=1)
    for i, (slope, intercept) in enumerate(zip(a, b, strict=True)):
        build.mode(f"piece {i + 1}", from_input=[slope, 0.0], constant=intercept)
    band = int(np.searchsorted(x, (low + high) / 2))
    parked = build.mode("parked")
    for i, edge in enumerate(x):
        for name, source, target, sign in (("rises", i, i + 1, 1.0), ("falls", i + 1, i, -1.0)):
            entry = [0.0, 1.0] if target == band else None
            at = float(-sign * edge)
            row = [sign, 0.0]
            build.guard(
                f"{name} through breakpoint {i + 1}", source, target, on_input=row, constant=at, memory_from_input=entry
            )
    build.guard("parks", band, parked, on_input=[0.0, 1.0], on_memory=-1.0, constant=-dwell_time)
    build.guard("unparks", parked, band + 1, on_input=[1.0, 0.0], constant=-high)
    return build.build(band)


def sampled(breakpoints: ArrayLike, slopes: ArrayLike, intercepts: ArrayLike, period: float) -> Automaton:
    """Static map with inputs (x, clock) that is read every `period` and held: memory values (output, next reading).

    A reading walks from piece to piece at one instant until it is in the one that holds the input.
    """
    x, a, b = (np.atleast_1d(np.asarray(v, float)) for v in (breakpoints, slopes, intercepts))
    build = AutomatonBuilder(n_inputs=2, n_memory=2)
    for i in range(len(a)):
        build.mode(f"reads piece {i}", from_memory=[1.0, 0.0])
    hold = build.mode("holds", from_memory=[1.0, 0.0])
    for i, edge in enumerate(x):
        build.guard("reads higher", i, i + 1, on_input=[1.0, 0.0], constant=float(-edge))
        build.guard("reads lower", i + 1, i, on_input=[-1.0, 0.0], constant=float(edge))
    # Behind the passages between pieces: of guards above zero the first one goes, so that only the piece
    # that holds the input reads it.
    for i, (slope, intercept) in enumerate(zip(a, b, strict=True)):
        build.guard(
            "reads",
            i,
            hold,
            constant=1.0,
            memory_from_input=[[slope, 0.0], [0.0, 0.0]],
            memory_from_memory=[[0.0, 0.0], [0.0, 1.0]],
            memory_constant=[intercept, period],
        )
    build.guard("sample due", hold, len(a) // 2, on_input=[0.0, 1.0], on_memory=[0.0, -1.0])
    return build.build(hold)
