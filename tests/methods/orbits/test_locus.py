"""Cycles that no run stays near, against a map over half a period in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root
from scipy.signal import residue

import eppanalysis as epp
from tests.stress.first_order_loops import random_loop


class HalfPeriod:
    """Cycles of a relay with dead zone (threshold and level 1) with a pulse to each side, by residues of the plant.

    A pulse lasts w, and h lies between the begins of two. With residues r and poles p of the plant the state of each
    mode at the begin of a pulse follows from x(h) = -x(0), so both switches are two equations for w and h.
    """

    def __init__(self, numerator, denominator):
        self.r, self.p, _ = residue(numerator, denominator)

    def states(self, w, h):
        w, h = np.asarray(w)[..., None], np.asarray(h)[..., None]
        begin = -(self.forced(h) - self.forced(h - w)) / (1.0 + np.exp(self.p * h))
        return begin, np.exp(self.p * w) * begin + self.forced(w)

    def forced(self, t):
        """Each mode after a step of one, from zero."""
        still = self.p == 0
        return np.where(still, t, np.expm1(self.p * t) / np.where(still, 1.0, self.p))

    def signal(self, state):
        return -(self.r * state).sum(axis=-1).real

    def off_thresholds(self, w, h):
        return np.array([self.signal(state) - 1.0 for state in self.states(w, h)])

    def is_motion(self, w, h):
        """Whether the relay stays on in the pulse and off behind it."""
        begin, end = self.states(w, h)
        t = np.linspace(0.0, 1.0, 2001)[1:-1, None]
        on = self.signal(np.exp(self.p * w * t) * begin + self.forced(w * t))
        off = self.signal(np.exp(self.p * (h - w) * t) * end)
        return on.min() > 1.0 and np.abs(off).max() < 1.0

    def cycles(self):
        """Frequencies [rad/s]."""
        h, share = np.geomspace(1.0, 50.0, 800), np.linspace(0.0, 1.0, 402)[1:-1] ** 2
        w = h[:, None] * share
        off = self.off_thresholds(w, np.broadcast_to(h[:, None], w.shape))
        corners = np.stack([off[:, i : i - 1 or None, j : j - 1 or None] > 0 for i in (0, 1) for j in (0, 1)])
        found = set()
        for i, j in np.argwhere(np.all(np.any(corners, axis=0) & ~np.all(corners, axis=0), axis=0)):
            with np.errstate(all="ignore"):  # on its way
                at = root(lambda v: self.off_thresholds(*v), [w[i, j], h[i]], tol=1e-13)
            if at.success and 0 < at.x[0] < at.x[1] and self.is_motion(*at.x):
                found.add(round(float(np.pi / at.x[1]), 8))
        return sorted(found)


@pytest.mark.parametrize(
    ("damping", "speed", "lag", "gain"),
    [
        (0.2398, 0.8211, 0.183, 0.2467),
        pytest.param(0.2058, 2.149, 0.4365, 10.3153, marks=pytest.mark.slow),
        pytest.param(0.0874, 1.0477, 0.1489, 1.3561, marks=pytest.mark.slow),
    ],
)
def test_all_cycles_of_a_relay_whose_plant_rings_are_listed(damping, speed, lag, gain):
    """Most of them lie on no basin boundary that a line of starts crosses, and first order predicts none."""
    denominator = np.polymul([1.0, 2.0 * damping * speed, speed**2], [1.0, lag, 0.0])
    wanted = HalfPeriod([gain], denominator).cycles()
    found = epp.find_limit_cycles(epp.LureSystem.from_tf(([gain], denominator), epp.RelayDeadZone(1.0)))
    assert len(wanted) >= 6
    for omega in wanted:
        assert min(abs(cycle.omega - omega) for cycle in found) < 1e-6 * omega
    assert "one pulse to each side" in found.search


def test_what_closes_is_a_motion():
    """A dead zone's input leaves the band for good where the equations alone would let it wait for its next turn."""
    loop = random_loop(20010)
    found = epp.find_limit_cycles(loop)
    assert len(found)
    for cycle in found:
        run = epp.simulate(replace(loop, x0=cycle.state, memory=cycle.memory), t_end=0.999 * cycle.period)
        behind = [event.name for event in run.events if event.time > 1e-6 * cycle.period]
        assert behind == [event.name for event in cycle.events][:-1]
