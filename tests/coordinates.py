"""The same loop in other words: its state in other coordinates, its time, amplitudes and states in other units."""

from __future__ import annotations

import re
from dataclasses import fields, replace

import numpy as np

from eppanalysis.models.elements import Cube, Nonlinearity
from eppanalysis.models.systems.lure import LureSystem

#: Fields of elements that have neither the unit of an amplitude nor that of time.
_PURE = {"slope", "kinetic_ratio", "levels", "stiffness"}
_TIMES = {"dwell_time", "period", "damping"}
#: Factors on time, amplitudes and states (the seed of a random factor for each).
UNITS = ((1e6, 1e-6, 1), (1e-6, 1e6, 2), (1.0, 1e-6, None), (1e-6, 1.0, None), (1e6, 1.0, 3))


def in_coordinates(system: LureSystem, T: np.ndarray) -> LureSystem:
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


def rotated(system: LureSystem, seed: int) -> LureSystem:
    """The loop with its state turned by a random orthogonal matrix."""
    return in_coordinates(system, orthogonal(system.A.shape[0], seed))


def rescaled(system: LureSystem, time: float, amplitude: float, states: int | None = None) -> LureSystem:
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


def _rescaled_element(element: Nonlinearity, time: float, amplitude: float) -> Nonlinearity:
    def scaled(name: str, value: object) -> object:
        if name in _PURE or value is None or isinstance(value, str):
            return value
        if name in _TIMES:
            return value * time
        if name == "stribeck":
            return value / amplitude
        return value / amplitude**2 if isinstance(element, Cube) else value * amplitude

    return type(element)(**{f.name: scaled(f.name, getattr(element, f.name)) for f in fields(element) if f.init})


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
