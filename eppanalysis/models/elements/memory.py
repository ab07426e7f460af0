"""Elements that stick and follow, with memory but without a rate: play, stiction relays.

Their describing functions follow from the changes of the output along one closed cycle of ``x = b + A sin(phi)``,

    gain = 1/(pi A) * closed integral of (cos(phi) - j sin(phi)) dy,

so each is a sum over the slopes and jumps of the loop. Below (and at) the amplitude that closes the loop the output
does not change: the gain is 0 there and the mean is the one that each class documents.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.engine.describing import describe_stiction_pulley
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import IN, RATIO, SLOPE, Answer, Nonlinearity
from eppanalysis.models.elements.exact import Named, Reading
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    POSITIVE,
    amplitude_and_bias,
    angle,
    distances,
    require,
    require_numbers,
    squared_sine,
    with_nan,
)
from eppanalysis.models.elements.piecewise import UNITY


class Slip(NamedTuple):
    """Memory of an element that sticks.

    Parameters
    ----------
    value : array_like
        What the output is, or sticks at.
    direction : array_like
        Which way it slides: 1, -1, or 0 where it is stuck.
    reached : array_like
        The input that it has reached.
    """

    value: ArrayLike
    direction: ArrayLike = 0
    reached: ArrayLike = 0.0


class _Sticking(Nonlinearity):
    """What an element that sticks and follows remembers; the modes of its automaton: stuck, up, down, any others."""

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """Stuck where the memory is a plain number, sliding where it is a :class:`Slip` under way."""
        if not isinstance(memory, Slip):
            return super().start(automaton, memory)
        direction = int(np.sign(memory.direction))
        return direction % 3, super().start(automaton, float(np.asarray(memory.value)))[1]

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> Any:
        """The value stuck at, or the :class:`Slip`."""
        value = self.memory_of(output)
        return Slip(value, 1 if mode == 1 else -1, float(x[0])) if mode in (1, 2) and value is not None else value


@dataclass(frozen=True)
class Play(Nonlinearity, kind="play"):
    """Friction-driven backlash of total width `gap`: the output rests until the input pushes it from either side.

    Without a memory it begins at zero, or as near to zero as the gap lets it, in continuous and in discrete time.

    Parameters
    ----------
    gap : float
        Total width, at least zero [unit of the input, which is that of the output]; the output stays within ``gap/2``
        of the input.

    Raises
    ------
    ModelError
        If the gap is negative or not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import Play
    >>> mean, gain = Play(gap=2.0).describing_function(amplitude=2.0)
    >>> complex(gain.round(4))
    (0.5-0.3183j)
    """

    linear_gain_is = "the slope at which it follows"
    units = MappingProxyType({"gap": IN})
    same_unit = True

    gap: float

    def __post_init__(self) -> None:
        require_numbers(self, gap=NOT_NEGATIVE)

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Array]:
        """Output, which is also the memory; without memory it starts from zero, or as near to it as the gap lets it."""
        x = floats(x, "output: x")
        stored = floats(0.0 if memory is None else memory, "output: memory")
        y = np.clip(stored, x - self.gap / 2, x + self.gap / 2)
        return np.asarray(y), np.asarray(y)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean (the bias, at any amplitude) and gain, which is 0 up to the amplitude ``gap/2``.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b = amplitude_and_bias(amplitude, bias, omega)
        moves = a > self.gap / 2
        reached = np.where(moves, a, self.gap)
        # 1 - u^2 of docs/theory/play.md, Play, as the product 2 (g/a) (a - g/2)/a: the difference would cancel just
        # above half the gap.
        spare = reached - self.gap / 2
        real, lag = 2 * squared_sine(angle(spare, self.gap / 2)), 2 * (self.gap / reached) * (spare / reached)
        return with_nan(a, b, b, np.where(moves, (real - 1j * lag) / np.pi, 0.0))

    def thresholds(self, bias: float = 0.0) -> Array:
        """Half the gap, about any bias."""
        return distances(self.gap / 2)

    def slope_bounds(self) -> tuple[float, float]:
        """Zero in the gap, one where it is pushed; one alone without a gap."""
        return (0.0 if self.gap else 1.0), 1.0

    def sector(self) -> tuple[float, float]:
        """Infinite, as the output stays where it is while the input passes zero; one without a gap."""
        return (-np.inf, np.inf) if self.gap else (1.0, 1.0)

    def memory_of(self, output: Array) -> float | None:
        """The output itself."""
        return float(output[0])

    def exact(self, read: Reading) -> Named:
        """Exact numbers of its fields, for certificates."""
        return Named.of(self, "play", read, "gap")

    def under_dither(self, amplitude: float) -> Nonlinearity:
        """A play whose gap is narrower by the dither's width; what lets its input through where none is left."""
        left = self.gap - 2.0 * amplitude
        return Play(gap=left) if left > 1e-12 * self.gap else UNITY

    def automaton(self) -> Automaton:
        """Rests in the gap, pushed up, pushed down."""
        return automata.play(self.gap)


@dataclass(frozen=True)
class BacklashCompensator(_Sticking, kind="backlash_compensator"):
    """Inverse of a play of width `gap`: half the gap is added on the side to which the input moves.

    In front of a play it makes of the two a straight connection. Without `travel` the output jumps by the gap where the
    input turns back; with it a line takes it to the other side while the input moves on by `travel`.

    Parameters
    ----------
    gap : float
        Total width of the play that is compensated, at least zero [unit of the input].
    travel : float, optional
        How far the input moves from a reversal until all of the gap has been taken up, at least zero [unit of the
        input].

    Raises
    ------
    ModelError
        If a field is negative or not a finite number.

    Examples
    --------
    >>> from eppanalysis.models.elements import BacklashCompensator
    >>> mean, gain = BacklashCompensator(gap=0.5).describing_function(amplitude=1.0)
    >>> complex(gain.round(4))  # 1 + 2j gap/(pi A)
    (1+0.3183j)
    """

    units = MappingProxyType({"gap": IN, "travel": IN})
    same_unit = True

    gap: float
    travel: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, gap=NOT_NEGATIVE, travel=NOT_NEGATIVE)

    @property
    def _steep(self) -> float:
        """Slope that comes on top of one while it turns."""
        return self.gap / self.travel

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Any]:
        """Output and memory: with a travel where its middle is, like that of a play; without one a :class:`Slip`."""
        x = floats(x, "output: x")
        if self.travel:
            middle, _ = Play(self.travel).output(x, memory)
            return np.asarray(x + self._steep * (x - middle)), middle
        value, direction, reached = memory if isinstance(memory, Slip) else Slip(0.0, 0, 0.0)
        way = np.where(x == reached, direction, np.sign(x - np.asarray(reached)))
        y = np.asarray(x + way * self.gap / 2)
        return y, Slip(y, way, x)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean (the bias) and gain, with phase lead: 1 plus ``gap/travel`` (1 - N) of a play of the width `travel`.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b = amplitude_and_bias(amplitude, bias, omega)
        if not self.travel:
            return with_nan(a, b, b, 1.0 + 2j * self.gap / (np.pi * a))
        turned = a > self.travel / 2
        reached = np.where(turned, a, self.travel)
        spare = reached - self.travel / 2
        # 1 - N of a play of that width (docs/theory/play.md, Backlash compensator), over the other part of the half
        # turn: the difference would cancel at large amplitudes.
        kept = 2 * squared_sine(angle(self.travel / 2, spare)) + 2j * (self.travel / reached) * (spare / reached)
        return with_nan(a, b, b, 1.0 + self._steep * np.where(turned, kept / np.pi, 1.0))

    def thresholds(self, bias: float = 0.0) -> Array:
        """Half the travel, or half the gap where there is none, about any bias."""
        return distances((self.travel or self.gap) / 2)

    def sector(self) -> tuple[float, float]:
        """Unbounded, as its output is not zero where the input is; both are 1 where there is no gap."""
        return (-np.inf, np.inf) if self.gap else (1.0, 1.0)

    def memory_of(self, output: Array) -> float | None:
        """Where the middle of the travel is, while the input stays there."""
        return float(output[0]) if self.travel else None

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> Any:
        """Where the middle of the travel is; without one a :class:`Slip`."""
        side = (0, 1, -1)[mode]
        if not self.travel:
            return Slip(float(output[0]), side, float(x[0]))
        return float(x[0]) - side * self.travel / 2 if side else float(stored[0])

    def automaton(self) -> Automaton:
        """Modes: crosses the gap after a reversal, leads upwards, leads downwards."""
        return automata.backlash_compensator(self.gap, self.travel)


@dataclass(frozen=True)
class JumpAndFollow(_Sticking, kind="jump_and_follow"):
    """Stiction relay: sticks until the input has reversed by more than `stick_band`, jumps by `slip_jump`, follows.

    While it follows it stays ``(stick_band - slip_jump)/2`` behind the input; stuck at the value y it breaks away where
    x is more than ``(stick_band + slip_jump)/2`` from ``y/slope``. This is the two-parameter valve stiction of
    Choudhury, Thornhill and Shah (Control Eng. Practice 13, 2005), S = `stick_band` and J = `slip_jump`.

    Parameters
    ----------
    stick_band, slip_jump : float
        Both in the unit of the input, at least zero.
    slope : float, optional
        While following, positive [unit of the output per unit of the input].

    Raises
    ------
    ModelError
        If a field is out of its range.
    """

    units = MappingProxyType({"stick_band": IN, "slip_jump": IN, "slope": SLOPE})

    stick_band: float
    slip_jump: float
    slope: float = 1.0

    def __post_init__(self) -> None:
        require_numbers(self, stick_band=NOT_NEGATIVE, slip_jump=NOT_NEGATIVE, slope=POSITIVE)

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Slip]:
        """Output and memory; a plain number as memory is the value stuck at, none is zero."""
        x = floats(x, "output: x")
        offset, reach = (self.stick_band - self.slip_jump) / 2, (self.stick_band + self.slip_jump) / 2
        before = memory if isinstance(memory, Slip) else Slip(0.0 if memory is None else memory)
        strain = x - np.asarray(before.value, float) / self.slope
        up = ((np.asarray(before.direction) > 0) & (x >= before.reached)) | (strain > reach)
        down = ((np.asarray(before.direction) < 0) & (x <= before.reached)) | (strain < -reach)
        y = np.where(up, self.slope * (x - offset), np.where(down, self.slope * (x + offset), before.value))
        return y, Slip(y, up.astype(int) - (down & ~up).astype(int), x)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean (``slope*bias``, at any amplitude) and gain, which is 0 up to the amplitude ``stick_band/2``.

        From there to ``(stick_band + slip_jump)/2`` the loop coexists with rest: it goes on once it moves, but does not
        start from a value in the middle.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b = amplitude_and_bias(amplitude, bias, omega)
        moves = 2 * a > self.stick_band
        reached = np.where(moves, a, self.stick_band)
        band, jump = self.stick_band / reached, self.slip_jump / reached
        rest = 2 * reached - self.stick_band
        # docs/theory/play.md, Jump-and-follow, with u = 1 - S/a put in.
        real = 2 * squared_sine(angle(rest, self.stick_band)) + 2 * jump * np.sqrt(rest / reached) * np.sqrt(band)
        lag = 2 * (self.stick_band - self.slip_jump) / reached + band * (2 * jump - band)
        return with_nan(a, b, self.slope * b, np.where(moves, self.slope / np.pi * (real - 1j * lag), 0.0))

    def thresholds(self, bias: float = 0.0) -> Array:
        """Half the stick band, about any bias."""
        return distances(self.stick_band / 2)

    def slope_bounds(self) -> tuple[float, float]:
        """Zero while stuck, `slope` while it follows, infinite where it jumps."""
        stuck = self.stick_band + self.slip_jump > 0
        return (0.0 if stuck else self.slope), np.inf if self.slip_jump else self.slope

    def sector(self) -> tuple[float, float]:
        """Infinite, as the output stays where it is while the input passes zero; `slope` where it never sticks."""
        return (-np.inf, np.inf) if self.stick_band + self.slip_jump else (self.slope, self.slope)

    linear_gain_is = "the slope at which it follows"

    def linear_gain(self) -> Array:
        """The slope at which it follows."""
        return np.array([[self.slope]])

    @property
    def goes_on_in_jumps(self) -> bool:
        """Whether it slips by a jump."""
        return self.slip_jump > 0

    def memory_of(self, output: Array) -> float | None:
        """The output itself."""
        return float(output[0])

    def exact(self, read: Reading) -> Named:
        """Exact numbers of its fields, for certificates."""
        return Named.of(self, "jump_and_follow", read, "stick_band", "slip_jump", "slope")

    def automaton(self) -> Automaton:
        """Stuck, follows up, follows down."""
        return automata.jump_and_follow(self.stick_band, self.slip_jump, self.slope)


@dataclass(frozen=True)
class StictionPulley(_Sticking, kind="stiction_pulley"):
    """Cable round a pulley whose friction is proportional to its load: jump-and-follow from stretch to tension.

    With the friction force ``friction*(F_h + F_f)`` and ``kinetic_ratio`` of it while sliding, the stretch u of the
    forearm side is proportional to the total stretch s on four lines: while sliding up and down, and where it breaks
    away up and down. Slack (s <= 0) both forces are zero.

    Parameters
    ----------
    harness_stiffness, forearm_stiffness : float
        Stiffness of the cable on either side of the pulley [N/m], positive.
    friction : float
        Static friction per load, above 0 and below 1: ``mu sin(psi/2)`` with a coefficient mu and an angle of wrap psi.
    kinetic_ratio : float
        Kinetic over static friction, 0 to 1.

    Raises
    ------
    ModelError
        If a field is out of its range.

    Notes
    -----
    One input: the total stretch s [m]. Two outputs: the force ``F_f = k_f u`` at the sensor and ``F_h = k_h (s - u)``
    at the harness [N]. Memory: u [m], as a :class:`Slip` or a plain number (stuck at it); without one it
    begins slack, so that a stretch at the start has slid up.
    """

    n_outputs: ClassVar[int] = 2
    output_ports = ("sensor", "harness")
    units = MappingProxyType(
        {"harness_stiffness": SLOPE, "forearm_stiffness": SLOPE, "friction": RATIO, "kinetic_ratio": RATIO}
    )

    harness_stiffness: float
    forearm_stiffness: float
    friction: float
    kinetic_ratio: float

    def __post_init__(self) -> None:
        require_numbers(self, harness_stiffness=POSITIVE, forearm_stiffness=POSITIVE)
        require(self, "friction", 0 < self.friction < 1, "a number between 0 and 1")
        require(self, "kinetic_ratio", 0 <= self.kinetic_ratio <= 1, "0 to 1")

    def _weight(self, ratio: float) -> float:
        """``(1 - r) k_h + (1 + r) k_f`` for ``F_h - F_f = r (F_h + F_f)``."""
        return (1 - ratio) * self.harness_stiffness + (1 + ratio) * self.forearm_stiffness

    def share(self, ratio: float) -> float:
        """``u/s`` where the tensions differ by ``F_h - F_f = ratio*(F_h + F_f)``."""
        return (1 - ratio) * self.harness_stiffness / self._weight(ratio)

    def share_difference(self, ratio: float, other: float) -> float:
        """``share(ratio) - share(other)``, without cancellation."""
        product = 2 * self.harness_stiffness * self.forearm_stiffness
        return product * (other - ratio) / (self._weight(ratio) * self._weight(other))

    def output(self, x: ArrayLike, memory: Any = None) -> tuple[Array, Slip]:
        """Forces (trailing axis: sensor, harness) and memory."""
        s = floats(x, "output: x")
        kinetic = self.kinetic_ratio * self.friction
        before = memory if isinstance(memory, Slip) else Slip(0.0 if memory is None else memory)
        u = np.asarray(before.value, float)
        up = ((np.asarray(before.direction) > 0) & (s >= before.reached)) | (u < self.share(self.friction) * s)
        down = ((np.asarray(before.direction) < 0) & (s <= before.reached)) | (u > self.share(-self.friction) * s)
        u = np.maximum(np.where(up, self.share(kinetic) * s, np.where(down, self.share(-kinetic) * s, u)), 0)
        forces = np.stack([self.forearm_stiffness * u, self.harness_stiffness * np.maximum(s - u, 0)], axis=-1)
        return forces, Slip(u, up.astype(int) - (down & ~up).astype(int), s)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain of both forces (trailing axis: sensor, harness), also where the cable goes slack in each cycle.

        The loop closes where the greatest stretch exceeds the least ``s_min = bias - amplitude`` by the factor
        ``share(-kinetic)/share(friction)``, always where the cable goes slack (a little above that it coexists with
        rest: it goes on once it slides). Below that u is constant: the sensor force has gain 0, the harness force the
        gain of its spring, and the mean is that of equal tensions at the bias, or of the nearest stuck state that holds
        over the oscillation. Slack throughout, everything is 0.

        Raises
        ------
        ModelError
            If an amplitude is negative.
        """
        a, b = amplitude_and_bias(amplitude, bias, omega)
        mean, gain = np.empty((a.size, 2)), np.empty((a.size, 2), complex)
        springs, points = (self.forearm_stiffness, self.harness_stiffness), (a.flatten(), b.flatten())
        describe_stiction_pulley(*springs, self._of_loop, *points, mean, gain)
        return mean.reshape(*a.shape, 2), gain.reshape(*a.shape, 2)

    @cached_property
    def _of_loop(self) -> Array:
        """What its closed form is made of, shape (9,), as the engine takes it."""
        static, kinetic = self.friction, self.kinetic_ratio * self.friction
        shares = [self.share(ratio) for ratio in (0.0, static, -static, kinetic, -kinetic)]
        # From the least stretch, where it has slid down, to where it breaks away upward, over that stretch; the drop is
        # the same from the greatest one.
        reach = self.share_difference(-kinetic, static) / self.share(static)
        drop = self.share_difference(-static, kinetic) / self.share(-static)
        jumps = [self.share_difference(kinetic, static), self.share_difference(-static, -kinetic)]
        return np.array([*shares, reach, drop, *jumps])

    def thresholds(self, bias: float = 0.0) -> Array:
        """Amplitudes about the mean stretch `bias` at which the loop closes and at which the cable goes slack."""
        if bias <= 0:
            return distances(bias)
        static, kinetic = self.friction, self.kinetic_ratio * self.friction
        excess = self.share_difference(-kinetic, static) / self.share(static)
        return distances(bias * excess / (2 + excess), bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Zero while stuck, infinite where the friction falls as it breaks away, else that of the steeper slide."""
        steepest = np.inf if self.kinetic_ratio < 1 else self.forearm_stiffness * self.share(-self.friction)
        return 0.0, steepest

    def sector(self) -> tuple[float, float]:
        """From slack, without force, to where it breaks away downward."""
        return 0.0, self.forearm_stiffness * self.share(-self.friction)

    linear_gain_is = "its two cables in series: it sticks"

    def linear_gain(self) -> Array:
        """Both springs in series: the tensions on either side are equal."""
        h, f = self.harness_stiffness, self.forearm_stiffness
        return np.full((2, 1), h * f / (h + f))

    def memory_of(self, output: Array) -> float | None:
        """Stretch of the forearm side [m]."""
        return float(output[0]) / self.forearm_stiffness

    def automaton(self) -> Automaton:
        """Stuck, slides up, slides down, slack."""
        return automata.stiction_pulley(
            self.harness_stiffness, self.forearm_stiffness, self.friction, self.kinetic_ratio
        )
