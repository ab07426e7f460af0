"""A relay with dead zone over samples, and an iteration of it: what tests of bounds of such loops share."""

from __future__ import annotations

import tomllib

import numpy as np

import eppanalysis as epp

KINDS = ("discrete time", "sampled controller")
#: Two equal lags under a relay with dead zone, in discrete time, or as they are behind a sampler and hold.
_LOOP = """
kind = "diagram"
title = "relay over samples"
connect = ["-plant -> reader", "reader -> relay", "relay -> plant"]
run = {{ t_end = "100 s" }}
[parameters]
dead = 1.0
level = 1.0
{0} = {1}
[blocks]
{2}
[elements]
relay = {{ element = "relay_dead_zone", threshold = "dead", level = "level" }}
"""
_DISCRETE = """
reader = { kind = "gain", gain = 1 }
plant = { kind = "transfer_function", num = [1.2], den = [1.0, "-2*pole", "pole^2"], sample_time = 0.5, start = [1, 0] }
"""
_SAMPLED = """
reader = { kind = "gain", gain = 1, sample_time = 0.5 }
plant = { kind = "transfer_function", num = ["20*rate^2"], den = [1.0, "2*rate", "rate^2"], start = [1, 0] }
"""


def switched(kind: str) -> epp.Case:
    """The loop of a kind, whose pole or rate is a parameter."""
    parts = ("pole", 0.5, _DISCRETE) if kind == "discrete time" else ("rate", 1.0, _SAMPLED)
    return epp.Case.from_tables(tomllib.loads(_LOOP.format(*parts)), name="relay over samples")


def _matrices(kind: str, value: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From sample to sample: states, what the relay gives, and the output."""
    if kind == "discrete time":
        return np.array([[2 * value, -(value**2)], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([0.0, 1.2])
    # (1 + a t) exp(-a t) and its like: two equal lags by hand, over half a second.
    t, a = 0.5, value
    e = np.exp(-a * t)
    A = e * np.array([[1 + a * t, t], [-a * a * t, 1 - a * t]])
    return A, 20.0 * np.array([1 - e * (1 + a * t), a * a * t * e]), np.array([1.0, 0.0])


def oscillates(kind: str, value: float, level: float, dead: float) -> bool:
    """Whether the loop with a pole or rate still switches after 300 samples from one of 2000 starts."""
    A, b, c = _matrices(kind, value)
    x = np.random.default_rng(1).normal(size=(2000, 2)) * 20.0
    for _ in range(300):
        y = x @ c
        w = -level * np.sign(y) * (np.abs(y) > dead)
        x = x @ A.T + np.outer(w, b)
    return bool(np.any(w))
