"""The hybrid system: modes, guards and resets of a loop, packed into flat arrays for the compiled engine.

Derived from the LureSystem and its elements' automata; nothing is written a second time here. The state gains the
external inputs (piecewise linear ones as a state with a held slope, sines as an oscillator), the memory values of all
elements are stacked into one vector ``H`` whose last entry is 1 and carries every constant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from operator import itemgetter
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from eppanalysis.arrays import Array, BoolArray, IntArray
from eppanalysis.engine.tables import Model
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.automaton import SMOOTH_KINDS, Automaton, AutomatonBuilder
from eppanalysis.models.elements.base import Nonlinearity, automaton_of
from eppanalysis.models.elements.columns import name_of
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.inputs import Constant, InputSignal, Sine
from eppanalysis.models.systems.linear import fastest_poles
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.own_states import diagonal
from eppanalysis.models.systems.starts import admitted, not_held, starting_values
from eppanalysis.readable import listed, words

T = TypeVar("T")
DELAY_LINE = len(SMOOTH_KINDS)
#: Models whose facts are kept.
_MODELS = 8
#: Dead time, relative to the fastest time constant of the linear part.
_LEAST_DELAY = 1e-7


def cascade(elements: Iterable[int], acts: BoolArray) -> list[int]:
    """Elements each behind those that act on it (a row what acts on one); the first one breaks an algebraic loop."""
    rest, found = list(elements), []
    while rest:
        found.append(next((i for i in rest if not any(acts[i, j] for j in rest if j != i)), rest[0]))
        rest.remove(found[-1])
    return found


def reaching(begun: BoolArray, acts: BoolArray) -> BoolArray:
    """What each row of `begun` reaches by steps from rows of `acts` to their columns."""
    further = begun | (begun @ acts)
    return begun if np.array_equal(further, begun) else reaching(further, acts)


@dataclass(frozen=True, eq=False)
class HybridSystem:
    """Flat form of a loop with its external inputs."""

    model: Model  # what the engine reads
    #: x0, H0: (n + inputs,), (memory,): state and memory values at the start.
    x0: Array
    H0: Array
    modes0: IntArray  # (elements,): mode of each element at the start
    n_plant: int  # how many of the states are the loop's own
    compared: BoolArray  # (n + inputs,): states that repeat on a limit cycle (clocks do not)
    element_names: tuple[str, ...]  # for the event list
    time_scale: float  # length of a step on which the linear part moves moderately [s]
    #: elements, automata: of the loop; the automata may end with that of an observer.
    elements: tuple[Nonlinearity, ...]
    automata: tuple[Automaton, ...]

    def mode_name(self, element: int, mode: int) -> str:
        """Name of a mode of an element."""
        return name_of(self.automata[element].modes, mode)

    def guard_name(self, guard: int) -> str:
        """Name of a guard; guards are numbered through all elements and modes."""
        e = int(self.model.guard_element[guard])
        automaton, first = self.automata[e], self.model.guard_first[self.model.mode_first[e]]
        return name_of(automaton.guards, int(automaton.by_mode[guard - first]))

    @property
    def chatters(self) -> str:
        """Sentence on elements whose sliding a run cannot follow; empty where there are none."""
        names = [words(self.element_names[e]) for e in not_held(self)]
        slides = "slides" if len(names) == 1 else "slide"
        told = f"Where {listed(names)} {slides} a run switches without end, as the output of an element, its own or "
        told += "another's, acts straight on it; a fast lag between (of a rate limiter, a bandwidth) lets it follow."
        return told if names else ""

    @property
    def may_be_quiet(self) -> bool:
        """Whether motions may repeat themselves without an event: some element is curved, and no observer is there."""
        curved = bool(np.any(self.model.smooth_kind != DELAY_LINE))
        return curved and len(self.automata) == len(self.elements)

    @property
    def held(self) -> HybridSystem:
        """The same system, with its inputs held as at its start."""
        return replace(self, model=_without_breakpoints(self)) if self.model.breakpoint_time.size else self

    def at(self, x0: Array, H0: Array, modes0: IntArray) -> HybridSystem:
        """The same system, begun elsewhere; runs need it so often that `replace` would take as long as they do."""
        return HybridSystem(
            self.model, x0, H0, modes0, self.n_plant, self.compared, self.element_names, self.time_scale,
            self.elements, self.automata,
        )  # fmt: skip

    def begun(self, state: Array, memory: Sequence[Any]) -> HybridSystem:
        """The same system, begun at a state of its loop with what its elements remember; see `starting_values`."""
        x0, H0, modes0 = starting_values(self, state, memory)
        return self.at(x0, H0, modes0)

    @classmethod
    def from_lure(
        cls, system: LureSystem, input_signals: Mapping[str, InputSignal] | None = None, observed: bool = False
    ) -> HybridSystem:
        """Derive the hybrid system of `system` driven by `input_signals` (by input name; at rest where not given).

        The extrema of the first element's input are events where no element can switch, or where it is `observed`.

        Raises
        ------
        ModelError
            For a discrete-time system, an unknown input, or a loop without a unique solution.
        """
        if system.time_step:
            raise ModelError(
                f"{system.name}: a loop in discrete time has no hybrid form of its own",
                expected="that of its controller",
            )
        unknown = set(input_signals or {}) - set(system.input_names)
        if unknown:
            known = ", ".join(system.input_names) or "none"
            raise ModelError(f"{system.name} has no input {sorted(unknown)[0]!r}", expected=f"one of: {known}")
        key = tuple(sorted((input_signals or {}).items(), key=itemgetter(0))), observed
        made, hybrid = _MADE.get(system, (None, None))
        if hybrid is None or made != key:
            hybrid = cls._packed(system, input_signals or {}, observed)
            _MADE[system] = key, hybrid
        return hybrid

    @classmethod
    def _packed(cls, system: LureSystem, input_signals: Mapping[str, InputSignal], observed: bool) -> HybridSystem:
        automata = [automaton_of(e) for e in system.elements]
        names = list(system.element_names)
        # A run is judged by its events (docs/theory/simulation.md, Verdict): where no element can switch, extrema
        # take their place.
        if observed or not any(a.guards for a in automata):
            automata.append(_observer())
            names.append("observer")
        return _Packer(system, automata, names, input_signals).pack()


def of_model(function: Callable[[HybridSystem], T]) -> Callable[[HybridSystem], T]:
    """What a function takes from a system's model alone, kept for the last few models: runs differ in their start."""
    kept: dict[int, tuple[Model, T]] = {}  # a model that is kept is no other's number

    @wraps(function)
    def of(hybrid: HybridSystem) -> T:
        known = kept.get(id(hybrid.model))
        if known is None:
            known = kept[id(hybrid.model)] = hybrid.model, function(hybrid)
            for old in list(kept)[:-_MODELS]:
                kept.pop(old, None)
        return known[1]

    return of


@of_model
def _without_breakpoints(hybrid: HybridSystem) -> Model:
    return hybrid.model._replace(**{
        name: column[:0] for name, column in hybrid.model._asdict().items() if name.startswith("breakpoint_")
    })  # fmt: skip


#: The hybrid system last made of each loop, and of what: a loop, which does not change, is run many times.
_MADE: WeakKeyDictionary[LureSystem, tuple[tuple[Any, ...], HybridSystem]] = WeakKeyDictionary()


def _observer() -> Automaton:
    """Element without output that marks the extrema of the first element's input, for loops that never switch."""
    build = AutomatonBuilder()
    rising, falling = build.mode("rising"), build.mode("falling")
    build.guard("maximum", rising, falling, on_rate=-1.0)
    build.guard("minimum", falling, rising, on_rate=1.0)
    return build.build(rising)


class _Packer:
    """Stacks the loop, its inputs and its automata; lives for one call."""

    def __init__(
        self,
        system: LureSystem,
        automata: Sequence[Automaton],
        names: Sequence[str],
        input_signals: Mapping[str, InputSignal],
    ) -> None:
        self.system, self.automata, self.names = system, automata, names
        self.input_signals = [input_signals.get(name, Constant()) for name in system.input_names]
        self.n = system.A.shape[0]
        self.first = np.zeros((len(automata) + 1, 3), np.int64)
        for e, a in enumerate(automata):
            self.first[e + 1] = self.first[e] + (a.n_inputs, a.n_outputs, a.n_memory)
        self.n_z, self.n_w, n_memory = (int(v) for v in self.first[-1])
        self.n_exo = sum(2 if isinstance(m, Sine) else 1 for m in self.input_signals)
        self.i_slope = n_memory
        self.n_H = n_memory + len(self.input_signals) + 1

    def pack(self) -> HybridSystem:
        x0, A, K, V, breakpoints, carrier = self._inputs()
        B, C, D, Kz = self._about_elements(V, carrier)
        S, smooth = self._smooth(B, C, D, Kz)
        acts = self._acts_on(D, B, C)
        # What is late reaches the states through its channel of the past alone.
        B[:, : self.n_w][:, self._delayed()] = 0.0
        modes, guards = self._modes(B, C, D, S.shape[1])
        model = Model(
            A=A,
            B=B,
            S=S,
            K=K,
            C=C,
            D=D,
            Kz=Kz,
            first=self.first,
            order=self._order(acts),
            reach=self._reach(acts),
            **modes,
            **guards,
            **smooth,
            **self._signals(V, carrier),
            **breakpoints,
        )
        model = Model(*map(np.ascontiguousarray, model))
        return self._around(model, x0).begun(self.system.x0, self.system.memory)

    def _about_elements(self, V: Array, carrier: Array) -> tuple[Array, Array, Array, Array]:
        """B, C, D and Kz between the elements' outputs and inputs; an observer sees the first input."""
        system, n = self.system, self.n + self.n_exo
        nz, nw = system.C.shape[0], system.B.shape[1]
        B, C = np.zeros((n, self.n_w)), np.zeros((self.n_z, n))
        D, Kz = np.zeros((self.n_z, self.n_w)), np.zeros((self.n_z, self.n_H))
        B[: self.n, :nw] = system.B
        C[:nz, : self.n], C[:nz, self.n :] = system.C, system.D_input @ V
        Kz[:nz, -1] = system.constant_input + system.D_input @ carrier
        D[:nz, :nw] = system.D
        if self.n_z > nz:
            C[nz:], Kz[nz:], D[nz:, :nw] = C[:1], Kz[:1], D[:1, :nw]
        return B, C, D, Kz

    def _signals(self, V: Array, carrier: Array) -> dict[str, Array]:
        """Rows of the named signals on states, outputs and memory."""
        s = self.system.signals
        Yw, YH = np.zeros((len(s.names), self.n_w)), np.zeros((len(s.names), self.n_H))
        Yw[:, : s.D.shape[1]] = s.D
        YH[:, -1] = s.constant + s.D_input @ carrier
        return {"Yx": np.hstack([s.C, s.D_input @ V]), "Yw": Yw, "YH": YH}

    def _around(self, model: Model, x0: Array) -> HybridSystem:
        """The flat tables with their start, their names, and which states repeat on a cycle."""
        system = self.system
        fastest = float(fastest_poles(system.A[None])[0])
        self._refuse_tiny_delays(fastest)
        A, B, S, K = model.A, model.B, model.S, model.K
        # A clock never comes back, nor need an input or an integral that nothing reads: the angle behind a speed loop.
        clock = ~np.any(A, axis=1) & ~np.any(B, axis=1) & ~np.any(S, axis=1) & (K[:, -1] != 0)
        unobservable = ~np.any(A, axis=0) & ~np.any(model.C, axis=0)
        return HybridSystem(
            elements=tuple(system.elements),
            automata=tuple(self.automata),
            model=model,
            x0=x0,
            H0=np.append(np.zeros(self.n_H - 1), 1.0),
            modes0=np.array([a.start_mode for a in self.automata], np.int64),
            n_plant=self.n,
            compared=~(clock | unobservable | (np.arange(len(A)) >= self.n)),
            element_names=tuple(self.names),
            time_scale=2.0 / fastest if fastest > 0 else self._sample_time(),
        )

    def _sample_time(self) -> float:
        """The time between samples [s]; without samples one second is as good as any."""
        times = [e.sample_time for e in self.system.elements if isinstance(e, SampledController)]
        return max(times, default=1.0)

    def _acts_on(self, D: Array, B: Array, C: Array) -> BoolArray:
        """Where the output of an element (column) acts straight on an input of another (row), or on its own.

        So does an impulse, by way of the states that integrate it.
        """
        n = len(self.automata)
        acts = np.zeros((n, n), bool)
        kicks = np.array([w for w, a in zip(self.first[:-1, 1], self.automata, strict=True) if a.has_impulses], int)
        self._refuse_impulses(kicks, D)
        straight = D != 0.0
        straight[:, kicks] |= (C @ B[:, kicks]) != 0.0
        rows, columns = np.nonzero(straight)
        of_input, of_output = (np.repeat(np.arange(n), np.diff(self.first[:, k])) for k in (0, 1))
        acts[of_input[rows], of_output[columns]] = True
        return acts

    def _refuse_impulses(self, kicks: IntArray, D: Array) -> None:
        """An output with impulses acts on rates of states alone: no input, signal or dead time takes one."""
        n_w = self.system.B.shape[1]
        seen = np.any(self.system.signals.D[:, kicks[kicks < n_w]], axis=0)
        for w, named in zip(kicks, seen, strict=True):
            if named or np.any(D[:, w]) or self.system.delays[w]:
                name = self.names[int(np.searchsorted(self.first[:, 1], w, side="right")) - 1]
                raise ModelError(
                    f"{self.system.name}: the output of {name} has impulses",
                    expected="one that acts on the rates of states alone, straight and without dead time",
                )

    def _order(self, acts: BoolArray) -> IntArray:
        """Elements along the cascade: each behind those that act straight on it, but for algebraic loops.

        Sampled controllers come last, each behind those that reach it: what a sample brings about is settled before the
        next one at that instant.
        """
        sampled = [e for e, element in enumerate(self.system.elements) if isinstance(element, SampledController)]
        others = (e for e in range(len(acts)) if e not in sampled)
        return np.array([*cascade(others, acts), *cascade(sampled, self._reach(acts)[:-1].T > 0)], np.int64)

    def _reach(self, acts: BoolArray) -> IntArray:
        """Which elements a jump reaches, straight or through others; a row each element, the last for inputs."""
        given = np.flatnonzero(np.any(self.system.D_input != 0.0, axis=1))
        inputs = np.zeros(len(acts), bool)
        inputs[np.searchsorted(self.first[:, 0], given, side="right") - 1] = True
        return reaching(np.vstack([acts.T, inputs]), acts.T).astype(np.int64)

    def _refuse_tiny_delays(self, fastest: float) -> None:
        """A run would need ten million steps and more while the linear part hardly moves."""
        for delay in self.system.delays[self._delayed()]:
            if 0.0 < delay * fastest < _LEAST_DELAY:
                raise ModelError(
                    f"{self.system.name}: a dead time of {delay:g} s is negligible beside the loop's fastest time "
                    f"constant, {1.0 / fastest:g} s",
                    expected=f"0, or at least {_LEAST_DELAY / fastest:g} s",
                )

    def _inputs(self) -> tuple[Array, Array, Array, Array, dict[str, Array], Array]:
        """State with the inputs appended: start, A, K, map V from the input states, breakpoints, constant part."""
        system, n = self.system, self.n
        total = n + self.n_exo
        A, K = np.zeros((total, total)), np.zeros((total, self.n_H))
        V = np.zeros((len(self.input_signals), self.n_exo))
        x0, carrier = np.zeros(total), np.zeros(len(self.input_signals))
        x0[:n] = system.x0
        rows: list[tuple[float, int, float, int, float]] = []
        at, late = 0, bool(system.delays.any())
        for i, input_signal in enumerate(self.input_signals):
            if isinstance(input_signal, Sine):
                # An oscillator's two states are the sine to rounding, so that nothing of it is sampled
                # (docs/theory/driven.md).
                V[i, at], carrier[i] = input_signal.amplitude, system.v0[i]
                A[n + at, n + at + 1], A[n + at + 1, n + at] = input_signal.omega, -input_signal.omega
                x0[n + at], x0[n + at + 1] = np.sin(input_signal.phase), np.cos(input_signal.phase)
                at += 2
                continue
            V[i, at] = 1.0
            K[n + at, self.i_slope + i] = 1.0
            x0[n + at] = system.v0[i]
            for time, value, slope in zip(*input_signal.breakpoints(), strict=True):
                # An input that only goes on is no jump behind which what is late has another past.
                if late and time <= 0.0 == value == slope:
                    continue
                rows.append((time, n + at, system.v0[i] + value, self.i_slope + i, slope))
            at += 1
        A[:n, :n] = system.A
        A[:n, n:] = system.B_input @ V
        K[:n, -1] = system.constant_state + system.B_input @ carrier
        rows.sort()
        table = np.array(rows, float).reshape(-1, 5)
        breakpoints = {
            "breakpoint_time": np.ascontiguousarray(table[:, 0]),
            "breakpoint_state": table[:, 1].astype(np.int64),
            "breakpoint_value": np.ascontiguousarray(table[:, 2]),
            "breakpoint_memory": table[:, 3].astype(np.int64),
            "breakpoint_slope": np.ascontiguousarray(table[:, 4]),
        }
        return x0, A, K, V, breakpoints, carrier

    def _delayed(self) -> IntArray:
        return np.flatnonzero(self.system.delays > 0)

    def _smooth(self, B: Array, C: Array, D: Array, Kz: Array) -> tuple[Array, dict]:
        """Smooth channels of the elements, then one delay channel for each delayed output."""
        rows_x, rows_H, kinds, scales = [], [], [], []
        for e, a in enumerate(self.automata):
            inputs = slice(int(self.first[e, 0]), int(self.first[e + 1, 0]))
            for channel in a.smooth:
                if np.any(channel.on_input @ D[inputs]):
                    raise ModelError(
                        f"{self.system.name}: the output of an element, its own or another's, acts straight on "
                        f"{self.names[e]}; a smooth element needs an input from the linear part, as behind a fast lag."
                    )
                rows_x.append(channel.on_input @ C[inputs])
                row = channel.on_input @ Kz[inputs]
                row[-1] += channel.constant
                rows_H.append(row)
                kinds.append(SMOOTH_KINDS[channel.kind])
                scales.append(channel.scale)
        delayed = self._delayed()
        n_s, n = len(kinds) + len(delayed), C.shape[1]
        S = np.zeros((n, n_s))
        x_rows, H_rows = np.zeros((n_s, n)), np.zeros((n_s, self.n_H))
        if kinds:
            x_rows[: len(kinds)], H_rows[: len(kinds)] = rows_x, rows_H
        on_smooth = np.zeros((n_s, n_s))
        on_smooth[: len(kinds), : len(kinds)] = diagonal([a.smooth_on_smooth for a in self.automata])
        outputs, delay = np.zeros(n_s, np.int64), np.zeros(n_s)
        for j, w in enumerate(delayed, start=len(kinds)):
            S[:, j], outputs[j], delay[j] = B[:, w], w, self.system.delays[w]
        return S, {
            "smooth_kind": np.array([*kinds, *([DELAY_LINE] * len(delayed))], np.int64),
            "smooth_x": x_rows,
            "smooth_H": H_rows,
            "smooth_s": on_smooth,
            "smooth_scale": np.array([*scales, *([1.0] * len(delayed))], float),
            "smooth_w": outputs,
            "smooth_delay": delay,
        }

    def _modes(self, B: Array, C: Array, D: Array, n_s: int) -> tuple[dict, dict]:
        """Flat tables of all modes and guards, sticking modes admitted or bypassed."""
        z_max = max(a.n_inputs for a in self.automata)
        w_max = max(1, *(a.n_outputs for a in self.automata))
        h_max = max(1, *(a.n_memory for a in self.automata))
        n_modes = sum(len(a.modes) for a in self.automata)
        n_guards = sum(len(a.guards) for a in self.automata)
        m = {
            "mode_first": np.cumsum([0, *(len(a.modes) for a in self.automata)]).astype(np.int64),
            "mode_wz": np.zeros((n_modes, w_max, z_max)),
            "mode_wh": np.zeros((n_modes, w_max, h_max)),
            "mode_ws": np.zeros((n_modes, w_max, n_s)),
            "mode_w0": np.zeros((n_modes, w_max)),
            "mode_stick": np.zeros(n_modes, np.int64),
            "mode_lags": np.zeros(n_modes, np.int64),
            "mode_level": np.zeros(n_modes),
        }
        g = {
            "guard_first": np.zeros(n_modes + 1, np.int64),
            "guard_element": np.zeros(n_guards, np.int64),
            "guard_target": np.zeros(n_guards, np.int64),
            "guard_bypass": np.zeros(n_guards, np.int64),
            "guard_on_threshold": np.zeros(n_guards, np.int64),
            "guard_z": np.zeros((n_guards, z_max)),
            "guard_rate": np.zeros((n_guards, z_max)),
            "guard_h": np.zeros((n_guards, h_max)),
            "guard_w": np.zeros((n_guards, w_max)),
            "guard_0": np.zeros(n_guards),
            "reset_z": np.zeros((n_guards, h_max, z_max)),
            "reset_h": np.zeros((n_guards, h_max, h_max)),
            "reset_0": np.zeros((n_guards, h_max)),
            "guard_impulse": np.zeros((n_guards, z_max)),
        }
        of_mode, of_guard, i_smooth = m["mode_first"], np.zeros(1, np.int64), 0
        for e, a in enumerate(self.automata):
            rows = slice(of_mode[e], of_mode[e + 1])
            # A sticking mode holds its input only where the loop pulls it back against the jump; elsewhere it is
            # passed, and an input may rest there.
            jump, sticks = a.mode_columns["jump"], a.mode_columns["sticking"]
            passed = sticks & ~admitted(jump, e, self.first, self.automata, B, C, D)
            rests = passed & np.isin(np.arange(sticks.size), a.guard_columns["on_threshold"])
            self._write_modes(m, rows, a, sticks & ~rests, i_smooth)
            first = of_guard[-1] + a.first_of_mode
            g["guard_first"][of_mode[e] : of_mode[e + 1] + 1] = first
            self._write_guards(g, slice(first[0], first[-1]), e, passed, rests)
            of_guard = first
            i_smooth += len(a.smooth)
        return m, g

    def _write_modes(self, m: dict[str, Any], rows: slice, a: Automaton, sticks: BoolArray, i_smooth: int) -> None:
        z, w, h, modes = a.n_inputs, a.n_outputs, a.n_memory, a.mode_columns
        m["mode_wz"][rows, :w, :z] = modes["from_input"]
        m["mode_wh"][rows, :w, :h] = modes["from_memory"]
        m["mode_ws"][rows, :w, i_smooth : i_smooth + len(a.smooth)] = modes["from_smooth"]
        m["mode_w0"][rows, :w] = modes["constant"]
        m["mode_stick"][rows], m["mode_level"][rows] = sticks, modes["level"]
        m["mode_lags"][rows] = sticks | a.followed

    def _write_guards(self, g: dict[str, Any], rows: slice, e: int, passed: BoolArray, rests: BoolArray) -> None:
        a = self.automata[e]
        z, w, h = a.n_inputs, a.n_outputs, a.n_memory
        guards = a.guards_by_mode
        target = guards["target"]
        g["guard_element"][rows] = e
        g["guard_target"][rows] = np.where(passed[target], guards["bypass"], target)
        g["guard_bypass"][rows] = guards["bypass"]
        # Where the loop holds the input there, the sticking mode is entered as its rules have it.
        stays = guards["on_threshold"]
        g["guard_on_threshold"][rows] = np.where(a.mode_columns["sticking"][stays] & ~rests[stays], -1, stays)
        g["guard_z"][rows, :z], g["guard_rate"][rows, :z] = guards["on_input"], guards["on_rate"]
        g["guard_h"][rows, :h], g["guard_w"][rows, :w] = guards["on_memory"], guards["on_output"]
        g["guard_0"][rows] = guards["constant"]
        g["reset_z"][rows, :h, :z] = guards["memory_from_input"]
        g["reset_h"][rows, :h, :h] = guards["memory_from_memory"]
        g["reset_0"][rows, :h] = guards["memory_constant"]
        g["guard_impulse"][rows, :z] = guards["impulse"]
        # Off a level at which the input rests it is the guards that lead there from either side, turned round.
        back = {(int(guards["mode"][i]), int(target[i])): i for i in np.flatnonzero(rests[target])}
        for i in np.flatnonzero(rests[guards["mode"]]):
            if (way := back.get((int(target[i]), int(guards["mode"][i])))) is not None:
                row = rows.start + i
                g["guard_z"][row, :z], g["guard_w"][row, :w] = -guards["on_input"][way], 0.0
                g["guard_0"][row] = -guards["constant"][way]
