"""The same loop in other words: its state in other coordinates, its time, amplitudes and states in other units."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

import eppanalysis as epp
from eppanalysis.models.systems.sampled.averaged import Places

#: Factors on time, amplitudes and states (the seed of a random factor for each).
UNITS = ((1e6, 1e-6, 1), (1e-6, 1e6, 2), (1.0, 1e-6, None), (1e-6, 1.0, None), (1e6, 1.0, 3))


def in_coordinates(system: epp.LureSystem, T: np.ndarray) -> epp.LureSystem:
    """The loop with the state ``T x``, written out here once more so that the package's own way is not its witness."""
    back = np.linalg.inv(T)
    signals = replace(system.signals, C=system.signals.C @ back)
    cuts = system.cuts and replace(system.cuts, B=T @ system.cuts.B, C=system.cuts.C @ back)
    return replace(
        system,
        A=T @ system.A @ back,
        B=T @ system.B,
        C=system.C @ back,
        B_input=T @ system.B_input,
        constant_state=T @ system.constant_state,
        x0=T @ system.x0,
        signals=signals,
        cuts=cuts,
    )


def orthogonal(n: int, seed: int) -> np.ndarray:
    """Random orthogonal matrix, evenly distributed."""
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))
    return Q * np.sign(np.diag(R))


def rotated(system: epp.LureSystem, seed: int) -> epp.LureSystem:
    """The loop with its state turned by a random orthogonal matrix; the clock of sampled controllers is none of it."""
    own = Places.of(system).plant
    T = np.eye(system.A.shape[0])
    T[np.ix_(own, own)] = orthogonal(own.size, seed)
    return in_coordinates(system, T)


def rescaled(system: epp.LureSystem, time: float, amplitude: float, states: int | None = None) -> epp.LureSystem:
    """The loop with all times and amplitudes so many times as large, and each state in a unit of its own.

    `states` is the seed of these units, 1e-6 to 1e6; None leaves them.
    """
    n = system.A.shape[0]
    unit = np.ones(n) if states is None else 10.0 ** np.random.default_rng(states).uniform(-6.0, 6.0, n)
    z, w = np.ones(system.C.shape[0]), np.ones(system.B.shape[1])
    for e, inputs, outputs in zip(system.elements, system.input_slices, system.output_slices, strict=True):
        # The second input of a contact is the rate of its first, its second output that of a state of its own.
        if e.n_inputs > 1:
            z[inputs.start + 1] = 1.0 / time
        if e.n_outputs > 1:
            w[outputs.start + 1] = 1.0 / time
    per_time = 1.0 if system.time_step else 1.0 / time
    s, column = system.signals, unit[:, None]
    return replace(
        system,
        A=column * system.A * per_time / unit,
        B=column * system.B * per_time / w,
        C=z[:, None] * system.C / unit,
        D=z[:, None] * system.D / w,
        B_input=column * system.B_input * per_time * amplitude,
        D_input=z[:, None] * system.D_input * amplitude,
        constant_state=amplitude * unit * system.constant_state * per_time,
        constant_input=amplitude * z * system.constant_input,
        x0=amplitude * unit * system.x0,
        memory=tuple(None if m is None else m * amplitude for m in system.memory),
        delays=system.delays * time,
        time_step=system.time_step and system.time_step * time,
        elements=tuple(_rescaled_element(e, time, amplitude) for e in system.elements),
        signals=replace(s, C=s.C / unit, D=s.D / w, D_input=s.D_input * amplitude, constant=s.constant * amplitude),
    )


def _rescaled_element(element: epp.Nonlinearity, time: float, amplitude: float) -> epp.Nonlinearity:
    def scaled(name: str) -> object:
        value, role = getattr(element, name), element.units.get(name)
        if role is None or value is None:
            return value
        into, out, of_time = role
        return np.multiply(value, amplitude ** (into + out) * time**of_time).tolist()

    return type(element)(**{f.name: scaled(f.name) for f in fields(element) if f.init})


@dataclass(frozen=True)
class InOtherWords:
    """A case whose loop is changed, its parameters and their units left as they are; a run is so many times as long."""

    case: epp.Case
    change: Callable[[epp.LureSystem], epp.LureSystem]
    time: float = 1.0

    def __getattr__(self, name: str) -> object:
        return getattr(self.case, name)

    def to_system(self) -> epp.LureSystem:
        return self.change(self.case.to_system())

    def with_values(self, values: Mapping[str, object]) -> InOtherWords:
        return replace(self, case=self.case.with_values(values))

    @property
    def t_end(self) -> float:
        return self.case.t_end * self.time


def words(sentence: str) -> str:
    """A sentence with its numbers taken out: they have units, and runs in a search may be a few more or less."""
    return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "#", sentence)


def facts(cycles, name: str, time: float = 1.0, amplitude: float = 1.0) -> list[tuple[float, float, bool]]:
    """Period, size and stability of each cycle, in the units of the loop before it was rescaled."""
    return [(c.period / time, c.peak_to_peak[name] / amplitude, c.stable) for c in cycles]


def assert_same_cycles(found, wanted, name: str, time: float = 1.0, amplitude: float = 1.0) -> None:
    """The same cycles to 1e-6, with the same stability."""
    mine, theirs = facts(found, name, time, amplitude), facts(wanted, name)
    assert len(mine) == len(theirs), (mine, theirs)
    for (period, size, stable), (period_2, size_2, stable_2) in zip(mine, theirs, strict=True):
        np.testing.assert_allclose([period, size], [period_2, size_2], rtol=1e-6)
        assert stable == stable_2
