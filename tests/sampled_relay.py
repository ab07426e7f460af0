"""What tests of sampled loops share: a relay with a dead zone behind a sampler, and its cycles by closed forms."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.linalg

import eppanalysis as epp

#: 1/(s+1)^3 under a relay with a dead zone that reads the samples of its output.
_TEXT = """
kind = "diagram"
title = "Relay with a dead zone behind a sampler"
connect = ["-plant -> reader", "reader -> relay", "relay -> plant"]
run = { t_end = "100 s" }
[parameters]
dead = 0.16
T = "0.5 s"
[blocks]
reader = { kind = "gain", gain = 1, sample_time = "T" }
plant = { kind = "zero_pole_gain", poles = [-1, -1, -1], start = [1, 0, 0] }
[elements]
relay = { element = "relay_dead_zone", threshold = "dead" }
"""


class Pattern(NamedTuple):
    """A locked cycle: samples in a period, in a pulse, and the dead zones between which it exists."""

    samples: int
    pulse: int
    low: float
    high: float


def sampled_relay() -> epp.Case:
    """The loop as a case."""
    return epp.Case.from_tables(tomllib.loads(_TEXT), name="sampled relay")


def patterns(T: float, longest: int) -> Iterator[Pattern]:
    """All locked cycles of one pulse up and one as long down in at most so many samples.

    Of each pattern of the relay the outputs at the samples are those of a linear map; the pattern is a cycle for all
    dead zones between the largest output at which it gives nothing and the smallest at which it gives a pulse.
    """
    M = np.zeros((4, 4))
    M[:3, :3], M[0, 3] = [[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]], 1.0
    X = scipy.linalg.expm(M * T)
    E, F = X[:3, :3], X[:3, 3]
    for n in range(4, longest + 1):
        once = np.linalg.inv(np.eye(3) - np.linalg.matrix_power(E, n))
        after_pulse = np.fft.rfft([(once @ np.linalg.matrix_power(E, (j - 1) % n) @ F)[2] for j in range(n)])
        for a in range(1, n // 2 + 1):
            rests = [(m, n - 2 * a - m) for m in range(n - 2 * a + 1)]
            u = np.array([np.r_[np.ones(a), np.zeros(m), -np.ones(a), np.zeros(k)] for m, k in rests])
            y = np.fft.irfft(np.fft.rfft(u) * after_pulse, n)
            pulse = np.where(u != 0.0, -u * y, np.inf).min(axis=1)
            nothing = np.where(u == 0.0, np.abs(y), 0.0).max(axis=1)
            for low, high in zip(nothing[pulse > nothing], pulse[pulse > nothing], strict=True):
                yield Pattern(n, a, float(low), float(high))
