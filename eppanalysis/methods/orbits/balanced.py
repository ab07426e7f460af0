"""The orbit that a balance stands for, closed from states on it: no run follows a very unstable cycle."""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.harmonic.loop import Loop, inputs_of
from eppanalysis.methods.harmonic.series import TURN, orders
from eppanalysis.methods.orbits.orbit import Orbit
from eppanalysis.methods.orbits.shooting import PIECES, orbit_of_motion
from eppanalysis.methods.steady.closing import close
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.results import LimitCycle


def orbit_of_balance(hybrid: HybridSystem, loop: Loop, balance: LimitCycle) -> Orbit | None:
    """The exact orbit near a balance; None where its states lead to none.

    From a cycle with a multiplier in the thousands a run departs before it has come round, however good its start is.
    The balance knows the state at each phase and which switch each element has made last: passes begin on all of it.
    """
    W, regimes = loop.answers(inputs_of(loop, balance), balance.omega)
    if len(hybrid.automata) != len(regimes):  # an observer behind the elements: no element switches
        return None
    phases = TURN * np.arange(PIECES) / PIECES
    states, starts = _states(hybrid, loop, balance, W, phases / balance.omega), []
    for phase, x in zip(phases, states, strict=True):
        modes, memory = np.zeros(len(regimes), np.int64), hybrid.H0.copy()
        for e, regime in enumerate(regimes):
            # Before its first switch of the period an element is as the last one has left it.
            last = min(regime.switches, key=lambda s: (phase - s.phase) % TURN, default=regime)
            modes[e], memory[slice(*hybrid.model.first[e : e + 2, 2])] = last.mode, last.memory
        starts.append(hybrid.at(x, memory, modes))
    begin = SteadyMotion.through(starts, [balance.period / PIECES] * PIECES)
    return orbit_of_motion(close(begin, given=False, pieces=PIECES))


def _states(hybrid: HybridSystem, loop: Loop, balance: LimitCycle, W: ComplexArray, times: Array) -> Array:
    """States at times (nt,), with the held inputs behind those of the loop, shape (nt, n + inputs)."""
    k = orders(W.shape[1] - 1)[1:]
    response = (loop.system.state_response(balance.omega * k) @ W.T[1:, :, None])[..., 0]
    moving = (np.exp(1j * balance.omega * np.outer(times, k)) @ response).real
    held = np.tile(hybrid.x0[hybrid.n_plant :], (times.size, 1))
    return np.hstack([balance.mean_state + moving, held])
