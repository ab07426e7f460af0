"""A linear controller that is executed once a sample time and holds its outputs in between, with a computation delay.

Times are counted in ticks, whole numbers as far as may be, so that samples do not drift however long a run is, and so
that controllers whose samples coincide do so to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import are_ordinary, checked_class, floats
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import Answer, Nonlinearity, OwnStates
from eppanalysis.models.elements.phases import broadcast

#: Two times have a tick in common where their ratio is one of whole numbers up to this, but for rounding.
_LARGEST_RATIO, _ROUNDING = 10_000, 1e-13


class ControllerMemory(NamedTuple):
    """What a sampled controller remembers.

    Parameters
    ----------
    state : tuple of float
        Its state, behind the last sample.
    output : tuple of float
        What it puts out.
    due : float
        When the next sample is due [s], on the clock of its loop.
    computed : tuple of float
        What it will put out when the computation delay is over; empty without one.
    ready : float
        When that is [s]; nan where nothing is being computed.
    """

    state: tuple[float, ...]
    output: tuple[float, ...]
    due: float
    computed: tuple[float, ...] = ()
    ready: float = math.nan


@checked_class
@dataclass(frozen=True, eq=False)
class SampledController(Nonlinearity):
    """A linear controller in discrete time in a loop of continuous time: sampler, state space, hold.

    At the samples ``t[k] = offset + k sample_time`` it reads its inputs u and computes ::

        y[k] = C x[k] + D u[k]
        x[k+1] = A x[k] + B u[k]

    y[k] is held at its outputs from ``t[k] + delay`` on. A static element (saturation, quantiser) in front of it or
    behind it acts as one in the discrete part would. Samples of several controllers at the same instant are taken one
    after the other, each with what follows from those before: along the signal where one acts straight on the next,
    else in the order of the elements.

    Parameters
    ----------
    A, B, C, D : array, shapes (n, n), (n, m), (p, n), (p, m)
        Of the discrete-time system; n may be zero.
    sample_time : float
        Sample time [s].
    delay : float
        Computation delay [s], zero to `sample_time`.
    offset : float
        Time of the first sample [s].
    x0 : array, shape (n,), optional
        State at the first sample; zero by default.
    y0 : array, shape (p,), optional
        What it puts out before it has computed anything; zero by default.
    state_last : bool
        Whether the state is updated after the outputs, from the inputs as they are then (at the same instant): so an
        integrator stops where an element behind it saturates (anti-windup). Only without `delay`: a dead time
        of the loop behind the saturation replaces it there.
    tick : float, optional
        Unit in which its times are counted [s]; by default `sample_time`. A loop gives those of its controllers that
        have a common divisor the same one.

    Raises
    ------
    ModelError
        If a matrix does not fit, or a time is out of its range.

    See Also
    --------
    OwnStates : How it brings the clock that it reads into the loop.

    Examples
    --------
    A PI controller, 1 kHz, in front of an integrating plant:

    >>> import eppanalysis as epp
    >>> pi = epp.SampledController(
    ...     [[1.0]], [[0.05]], [[1.0]], [[4.0]], sample_time=0.001, delay=0.0004
    ... )
    >>> loop = epp.LureSystem.build(
    ...     [[0.0]], [[1.0]], [[-1.0]], [pi], x0=[1.0], element_names=["pi"]
    ... )
    >>> run = epp.simulate(loop, t_end=10.0)
    >>> run.status.name, bool(abs(run.settled_at["pi_input"]) < 1e-6)
    ('SETTLED', True)
    """

    A: ArrayLike
    B: ArrayLike
    C: ArrayLike
    D: ArrayLike
    sample_time: float
    delay: float = 0.0
    offset: float = 0.0
    x0: ArrayLike | None = None
    y0: ArrayLike | None = None
    state_last: bool = False
    tick: float | None = None

    def __post_init__(self) -> None:
        self._read_matrices()
        positive = math.isfinite(self.sample_time) and self.sample_time > 0
        ranges = {
            "sample_time": (positive and are_ordinary(self.sample_time), "a positive number of seconds"),
            "delay": (0 <= self.delay <= self.sample_time, "zero to the sample time"),
            "offset": (math.isfinite(self.offset) and self.offset >= 0, "zero or a positive number of seconds"),
            "tick": (self.tick is None or 0 < self.tick < math.inf, "a positive number of seconds"),
        }
        for name, (holds, expected) in ranges.items():
            if not holds:
                raise ModelError("SampledController", getattr(self, name), expected, field=name)
        if self.state_last and self.delay:
            expected = "zero where the state is renewed last: a dead time of the loop instead"
            raise ModelError("SampledController", self.delay, expected, field="delay")
        object.__setattr__(self, "n_inputs", self._m + 1)
        object.__setattr__(self, "n_outputs", self._p)
        object.__setattr__(self, "own_states", clock(self._m, self._p))

    def _read_matrices(self) -> None:
        read = {name: floats(getattr(self, name), f"SampledController: {name}", ndmin=2) for name in "ABCD"}
        n = 0 if not read["A"].size else read["A"].shape[0]
        p, m = read["D"].shape if read["D"].ndim == 2 else (0, 0)
        read["x0"] = floats(np.zeros(n) if self.x0 is None else self.x0, "SampledController: x0", ndmin=1)
        read["y0"] = floats(np.zeros(p) if self.y0 is None else self.y0, "SampledController: y0", ndmin=1)
        shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "x0": (n,), "y0": (p,)}
        for name, shape in shapes.items():
            values = read[name]
            values = values.reshape(shape) if not values.size and not math.prod(shape) else values
            if values.shape != shape or not np.all(np.isfinite(values)):
                expected = f"finite numbers, {shape}, as A has {n} states and D {p} by {m}"
                raise ModelError(f"SampledController: {name} has shape {values.shape}", expected=expected, field=name)
            object.__setattr__(self, name, values)
        if not (m and p):
            raise ModelError(f"SampledController: D has shape {(p, m)}", expected="a row for each output", field="D")

    @property
    def _n(self) -> int:
        return len(np.asarray(self.x0))

    @property
    def _m(self) -> int:
        return int(np.shape(self.D)[1])

    @property
    def _p(self) -> int:
        return int(np.shape(self.D)[0])

    @property
    def unit(self) -> float:
        """Unit in which its times are counted [s]."""
        return self.sample_time if self.tick is None else self.tick

    def counted(self, time: float) -> float:
        """A time in ticks, a whole number but for what has no common divisor with the sample time."""
        ticks = time / self.unit
        return float(round(ticks)) if abs(ticks - round(ticks)) <= _ROUNDING * abs(ticks) else ticks

    def automaton(self) -> Automaton:
        """Memory values (state, outputs, tick of the next sample, and with a delay computed outputs, their tick)."""
        n, m, p, late = self._n, self._m, self._p, bool(self.delay)
        size = n + p + 1 + (p + 1 if late else 0)
        state, output, due = slice(0, n), slice(n, n + p), n + p
        computed, ready = slice(n + p + 1, size - 1), size - 1
        build = AutomatonBuilder(n_inputs=m + 1, n_outputs=p, n_memory=size)
        held = np.eye(size)[output]
        holding = build.mode("holding", from_memory=held)
        on_clock = np.eye(m + 1)[m]
        A, B, C, D = (np.asarray(getattr(self, name)) for name in "ABCD")

        def add(name: str, source: int, target: int, at: int, *rows: tuple[slice, Array, Array]) -> None:
            """An event at the tick of a memory value that writes rows on (inputs, state), and counts."""
            on_input, on_memory, constant = np.zeros((size, m + 1)), np.eye(size), np.zeros(size)
            for place, of_input, of_state in rows:
                on_memory[place] = 0.0
                on_input[place, :m], on_memory[place, state] = of_input, of_state
            if at == due:
                constant[due] = self.counted(self.sample_time)
            # The tick of the output is the tick that was due and the delay, not the clock's time: so samples do not
            # drift.
            if at == due and late:
                on_memory[ready], constant[ready] = np.eye(size)[due], self.counted(self.delay)
            if at == ready and late:
                on_memory[output] = np.eye(size)[computed]
            guard = {"on_input": on_clock, "on_memory": -self.unit * np.eye(size)[at]} if at >= 0 else {"constant": 1.0}
            build.guard(
                name,
                source,
                target,
                **guard,
                memory_from_input=on_input,
                memory_from_memory=on_memory,
                memory_constant=constant,
            )

        renewed, put_out = (state, B, A), (computed if late else output, D, C)
        if late:
            computing = build.mode("computing", from_memory=held)
            add("samples", holding, computing, due, put_out, renewed)
            add("puts out", computing, holding, ready)
        elif self.state_last:
            updating = build.mode("updating", from_memory=held)
            add("samples", holding, updating, due, put_out)
            add("updates", updating, holding, -1, renewed)
        else:
            add("samples", holding, holding, due, put_out, renewed)
        start = np.zeros(size)
        start[state], start[output], start[due] = self.x0, self.y0, self.counted(self.offset)
        return build.build(holding, start)

    def start(self, automaton: Automaton, memory: ControllerMemory | None = None) -> tuple[int, Array]:
        """Mode and memory values of a memory."""
        mode, stored = automaton.start_mode, automaton.start_memory.copy()
        if memory is None:
            return mode, stored
        n, p = self._n, self._p
        stored[:n], stored[n : n + p], stored[n + p] = memory.state, memory.output, self.counted(memory.due)
        if self.delay and not math.isnan(memory.ready):
            stored[n + p + 1 : -1], stored[-1] = memory.computed, self.counted(memory.ready)
            mode = 1
        return mode, stored

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> ControllerMemory:
        """State, outputs and times."""
        n, p = self._n, self._p
        state, held = tuple(stored[:n].tolist()), tuple(stored[n : n + p].tolist())
        due = float(stored[n + p]) * self.unit
        if not self.delay:
            return ControllerMemory(state, held, due)
        ready = float(stored[-1]) * self.unit if mode == 1 else math.nan
        return ControllerMemory(state, held, due, tuple(stored[n + p + 1 : -1].tolist()), ready)

    def output(self, x: Any, memory: ControllerMemory | None = None) -> tuple[Any, ControllerMemory]:
        """Outputs for ``x = (inputs, clock)``, and memory; samples that have become due read these inputs."""
        values = floats(x, "output: x")
        u, clock = values[: self._m], float(values[self._m])
        if memory is None:
            memory = self.memory_at(0, self.automaton().start_memory, values, np.zeros(self._p))
        state, held, due, computed, ready = memory
        A, B, C, D = (np.asarray(getattr(self, name)) for name in "ABCD")
        while min(due, math.inf if math.isnan(ready) else ready) <= clock:
            # With a delay of a whole sample time what is ready goes out before the next sample takes its place.
            if ready <= due:
                held, ready = computed, math.nan
                continue
            now = np.array(state, float)
            y, state = tuple((C @ now + D @ u).tolist()), tuple((A @ now + B @ u).tolist())
            computed, ready = (y, due + self.delay) if self.delay else ((), math.nan)
            held = held if self.delay else y
            due += self.sample_time
        w = held[0] if self._p == 1 else np.array(held)
        return w, ControllerMemory(state, held, due, computed, ready)

    def response(self, omega: ArrayLike) -> ComplexArray:
        """Frequency response with hold and delay, shape (..., p, m): the mean over all phases of the samples.

        ``(C (z - A)^-1 B + D) (1 - 1/z)/(j omega T) exp(-j omega delay)`` at ``z = exp(j omega T)``, T the sample time:
        what the first harmonic of the outputs is of that of the inputs, what lies beyond half the sample rate left out.

        Parameters
        ----------
        omega : array_like
            Angular frequency [rad/s].
        """
        return self.response_and_slope(omega)[0]

    def response_and_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`response` and its derivative by `omega`, both of shape (..., p, m)."""
        return self._response(floats(omega, "response: omega"))

    def response_at(self, s: ArrayLike) -> ComplexArray:
        """:meth:`response` at any complex s but zero [1/s], shape (..., p, m)."""
        return self._response(-1j * np.asarray(s))[0]

    def _response(self, w: NDArray[Any]) -> tuple[ComplexArray, ComplexArray]:
        T = self.sample_time
        A, B, C, D = (np.asarray(getattr(self, name)) for name in "ABCD")
        half = 0.5 * w * T
        z = np.exp(2j * half)[..., None, None]
        law, slope = D + 0j * z, 0j * z * D
        if self._n:
            behind = np.linalg.solve(z * np.eye(self._n) - A, B + 0j * z)
            law = C @ behind + D
            slope = C @ np.linalg.solve(z * np.eye(self._n) - A, -1j * T * z * behind)
        hold, falls = (part[..., None, None] for part in self.hold(w))
        return np.asarray(law * hold, complex), np.asarray(slope * hold + law * falls, complex)

    def hold(self, omega: NDArray[Any]) -> tuple[ComplexArray, ComplexArray]:
        """Response of hold and delay alone and its derivative by the frequency [rad/s], which may be complex."""
        T = self.sample_time
        half, late = 0.5 * omega * T, np.exp(-1j * omega * (0.5 * T + self.delay))
        hold = np.sinc(half / np.pi) * late
        small = np.abs(half) < 1e-3
        full = np.where(small, 1.0, half)
        # d/dx sin(x)/x, by its series where the difference would be rounding.
        bend = np.where(small, -half / 3.0 + half**3 / 30.0, (np.cos(full) - np.sin(full) / full) / full)
        falls = 0.5 * T * bend * late - 1j * (0.5 * T + self.delay) * hold
        return np.asarray(hold, complex), np.asarray(falls, complex)

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Its response with hold and delay; the mean is infinite where it integrates a bias.

        Raises
        ------
        ModelError
            If it has several inputs.
        """
        if self._m > 1:
            raise ModelError(f"SampledController: it has {self._m} inputs", expected="one, for a describing function")
        a, b, w = broadcast(amplitude, bias, omega)
        gain = self.response(w)[..., 0]
        A, B, C, D = (np.asarray(getattr(self, name)) for name in "ABCD")
        # A pole at z = 1 sums a bias up without end.
        left = np.eye(self._n) - A
        integrates = self._n and np.linalg.matrix_rank(left) < self._n
        static = np.full(self._p, np.inf) if integrates else (C @ np.linalg.solve(left, B) + D)[:, 0]
        mean = np.where(b[..., None] == 0.0, 0.0, b[..., None] * static)
        return (mean[..., 0], gain[..., 0]) if self._p == 1 else (mean, gain)

    def slope_bounds(self) -> tuple[float, float]:
        """Not bounded: between two samples the input may have returned."""
        return -np.inf, np.inf

    def linear_gain(self) -> Array:
        """Its direct gain, and nothing from the clock."""
        return np.hstack([np.asarray(self.D), np.zeros((self._p, 1))])


def clock(m: int, p: int) -> OwnStates:
    """A clock as the last of the inputs; all else passes."""
    D = np.zeros((m + 1 + p, m + p))
    D[:m, :m], D[m + 1 :, m:] = np.eye(m), np.eye(p)
    C = np.eye(m + 1 + p)[:, m : m + 1]
    return OwnStates(np.zeros((1, 1)), np.zeros((1, m + p)), C, D, n_before=m, n_behind=p, rate=np.ones(1))


def on_common_ticks(elements: Sequence[Nonlinearity]) -> tuple[Nonlinearity, ...]:
    """The same elements, sampled controllers that have a common divisor of their times counting in the same ticks.

    Without one they are counted in ticks of their own.
    """
    made = list(elements)
    free = {i: e for i, e in enumerate(made) if isinstance(e, SampledController) and e.tick is None}
    while free:
        first = next(iter(free.values())).sample_time
        group = {i: e for i, e in free.items() if _ratio(e.sample_time, first)}
        times = [t for e in group.values() for t in (e.sample_time, e.delay, e.offset)]
        # All times are ratios to the first one: with the common denominator as divisor each is a whole number of ticks.
        divisor = math.lcm(*(ratio.denominator for t in times if (ratio := _ratio(t, first))))
        for i, e in group.items():
            made[i] = replace(e, tick=first / divisor)
            del free[i]
    return tuple(made)


def _ratio(time: float, unit: float) -> Fraction | None:
    """A time in units as a ratio of whole numbers; None where it is none."""
    ratio = Fraction(time / unit).limit_denominator(_LARGEST_RATIO)
    return ratio if time and abs(ratio - Fraction(time / unit)) <= _ROUNDING * ratio else None
