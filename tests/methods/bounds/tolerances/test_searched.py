"""Bounds under tolerances that the search says, against an iteration of the loop at all corners, from many starts."""

from __future__ import annotations

import itertools
import tomllib

import numpy as np
import pytest

import eppanalysis as epp

#: Two equal lags under a relay with dead zone, in discrete time, or as they are behind a sampler and hold.
LOOP = """
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
DISCRETE = """
reader = { kind = "gain", gain = 1 }
plant = { kind = "transfer_function", num = [1.2], den = [1.0, "-2*pole", "pole^2"], sample_time = 0.5, start = [1, 0] }
"""
SAMPLED = """
reader = { kind = "gain", gain = 1, sample_time = 0.5 }
plant = { kind = "transfer_function", num = ["20*rate^2"], den = [1.0, "2*rate", "rate^2"], start = [1, 0] }
"""


def loop(kind: str) -> epp.Case:
    parts = ("pole", 0.5, DISCRETE) if kind == "discrete time" else ("rate", 1.0, SAMPLED)
    return epp.Case.from_tables(tomllib.loads(LOOP.format(*parts)), name="relay over samples")


def matrices(kind: str, value: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From sample to sample: states, what the relay gives, and the output."""
    if kind == "discrete time":
        return np.array([[2 * value, -(value**2)], [1.0, 0.0]]), np.array([1.0, 0.0]), np.array([0.0, 1.2])
    # (1 + a t) exp(-a t) and its like: two equal lags by hand, over half a second.
    t, a = 0.5, value
    e = np.exp(-a * t)
    A = e * np.array([[1 + a * t, t], [-a * a * t, 1 - a * t]])
    return A, 20.0 * np.array([1 - e * (1 + a * t), a * a * t * e]), np.array([1.0, 0.0])


def oscillates(kind: str, value: float, level: float, dead: float) -> bool:
    """Whether the loop still switches after 300 samples from one of 2000 starts."""
    A, b, c = matrices(kind, value)
    x = np.random.default_rng(1).normal(size=(2000, 2)) * 20.0
    for _ in range(300):
        y = x @ c
        w = -level * np.sign(y) * (np.abs(y) > dead)
        x = x @ A.T + np.outer(w, b)
    return bool(np.any(w))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["discrete time", "sampled controller"])
def test_no_corner_oscillates_beyond_the_worst_case_and_one_does_just_inside(kind: str) -> None:
    case = loop(kind)
    other = "pole" if kind == "discrete time" else "rate"
    centre = case.value(other)
    found = epp.tolerance_bound(case, "dead", {other: "4 %", "level": "5 %"}, within=(0.9, 6.0), samples=8, seed=2)
    assert found.sign == -1.0 and found.n_corners == 3
    corners = list(itertools.product((0.96 * centre, 1.04 * centre), (0.95, 1.05)))
    assert not any(oscillates(kind, value, level, found.worst_case) for value, level in corners)
    worst = found.worst_values[other], found.worst_values["level"]
    assert worst in [pytest.approx(corner) for corner in corners]
    assert oscillates(kind, *worst, 0.98 * found.worst_case)
    assert not oscillates(kind, centre, 1.0, found.nominal) and oscillates(kind, centre, 1.0, 0.98 * found.nominal)
    # What runs say of draws lies between the corners, and as near to the nominal bound.
    assert np.all(found.draws < 1.01 * found.worst_case) and abs(found.engine_offset) < 0.01
    said = str(found)
    assert said.startswith("No limit cycle was found above a dead of ") and "at the corners of the tolerances" in said
    assert found.status is epp.Status.INCOMPLETE and found.not_covered in said
    assert found.to_dict()["not_covered"] == found.not_covered
