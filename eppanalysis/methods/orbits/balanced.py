"""The orbit that a balance means, closed from its own switches: no run follows a very unstable cycle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.harmonic.loop import Loop, inputs_of
from eppanalysis.methods.harmonic.series import TURN, orders
from eppanalysis.methods.orbits.guess import Guess, make_guess
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import close_orbit
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.results import LimitCycle


class _Event(NamedTuple):
    """A switch of an element: when [s], its guard in the hybrid system, the mode and memory values behind it."""

    time: float
    element: int
    guard: int
    mode: int
    memory: Array


def orbit_of_balance(hybrid: HybridSystem, loop: Loop, balance: LimitCycle) -> Orbit | None:
    """The exact orbit near a balance; None where its switches lead to none.

    From a cycle with a multiplier in the thousands a run departs before it has come round, however good its start is.
    The balance knows the order of the switches, their times and the state at each: that is a guess, without a run.
    """
    guess = _guess(hybrid, loop, balance)
    return None if guess is None else close_orbit(hybrid, guess)


def _guess(hybrid: HybridSystem, loop: Loop, balance: LimitCycle) -> Guess | None:
    Z, omega = inputs_of(loop, balance), balance.omega
    W, regimes = loop.answers(Z, omega)
    if len(hybrid.automata) != len(regimes):  # an observer behind the elements: no element switches
        return None
    model = hybrid.model
    memory, modes = hybrid.H0.copy(), np.zeros(len(regimes), np.int64)
    events: list[_Event] = []
    for e, regime in enumerate(regimes):
        own = [(s.phase % TURN, s.mode_guard.guard.mode, s) for s in regime.switches]
        for phase, left, s in own:
            row = int(model.guard_first[model.mode_first[e] + left]) + s.mode_guard.number
            events.append(_Event(phase / omega, e, row, s.mode, s.memory))
        # Before its first switch of the period an element is as the last one has left it.
        last = max(own, key=lambda item: item[0])[2] if own else None
        modes[e] = regime.mode if last is None else last.mode
        memory[slice(*model.first[e : e + 2, 2])] = regime.memory if last is None else last.memory
    if not events:
        return None
    events.sort(key=lambda event: event.time)
    times = np.array([event.time for event in events])
    states = _states(hybrid, loop, balance, W, times)
    before, starts = [], []
    for k, event in enumerate(events):
        before.append(modes.copy())
        starts.append(np.concatenate([states[k - 1], memory]))
        modes[event.element] = event.mode
        memory[slice(*model.first[event.element : event.element + 2, 2])] = event.memory
    tau = np.diff(times, prepend=times[-1] - balance.period)
    return make_guess(hybrid, np.array(before), np.array([e.guard for e in events]), np.array(starts), tau)


def _states(hybrid: HybridSystem, loop: Loop, balance: LimitCycle, W: ComplexArray, times: Array) -> Array:
    """States at times (nt,), with the held inputs behind those of the loop, shape (nt, n + inputs)."""
    k = orders(W.shape[1] - 1)[1:]
    response = (loop.system.state_response(balance.omega * k) @ W.T[1:, :, None])[..., 0]
    moving = (np.exp(1j * balance.omega * np.outer(times, k)) @ response).real
    held = np.tile(hybrid.x0[hybrid.n_plant :], (times.size, 1))
    return np.hstack([balance.mean_state + moving, held])
