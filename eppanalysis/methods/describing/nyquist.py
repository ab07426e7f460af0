"""Curves for the picture of a prediction: Nyquist curve and -1/N locus of one element, loop gain for several.

With several elements the loop is cut at its principal element, the bands of the elbow's controller. The gain that would
have to be in front of it to keep up an oscillation of a given amplitude is the inverse of the loop gain: a cycle is
where the loop gain is one, and the curve says how far the gain may change before a cycle comes or goes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.describing.balance import Balance, newton, scales, unit_at_input
from eppanalysis.methods.describing.curves import settle
from eppanalysis.methods.describing.quality import Point
from eppanalysis.methods.describing.search import Found, frequency_nodes
from eppanalysis.methods.describing.trace import Box, trace
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.results import LimitCycle

#: The picture shows loop gains within this factor of one.
_REACH = np.log(12.0)
_STEPS = 120
_MOST_SEEDS = 40
_MOST_THRESHOLDS = 20


def _intersections(points: list[Point], cycles: tuple[LimitCycle, ...], element: int, output: int) -> list[dict]:
    """Where the response of the rest meets -1/N of an element, in the order of the cycles."""
    return [
        {
            "omega": p.omega,
            "amplitude": float(p.amplitude[element]),
            "bias": float(p.bias[element]),
            "value": complex(-1.0 / p.gain[output]),
            "stable": c.stable,
        }
        for p, c in zip(points, cycles, strict=True)
    ]


def nyquist_curves(balance: Balance, points: list[Point], cycles: tuple[LimitCycle, ...]) -> dict[str, Any]:
    """Nyquist curve of the linear part (negative feedback) and the locus -1/N, both around their intersections."""
    system = balance.system
    omega = _nodes(system, points)
    thresholds = np.abs(np.asarray(system.elements[0].thresholds(), float)).ravel()
    centre = [float(p.amplitude[0]) for p in points] or [*thresholds[thresholds > 0]] or [1.0]
    amplitude = np.geomspace(min(centre) / 30, max(centre) * 30, 400)
    # The locus moves fast just above a threshold.
    above = thresholds[thresholds > 0][:_MOST_THRESHOLDS, None] * (1.0 + np.geomspace(1e-9, 0.3, 60))
    amplitude = np.unique(np.concatenate([amplitude, above.ravel()]))
    bias = float(points[0].bias[0]) if points else 0.0
    gain = balance.evaluate(amplitude[:, None], np.full((len(amplitude), 1), bias), np.ones(len(amplitude)))[1][:, 0]
    used = np.abs(gain) > 0
    only = system.only if isinstance(system, DataSystem) else None
    measured = -system.feedback * only.value if only and isinstance(system, DataSystem) else None
    return {
        "measured": measured,
        "kind": "nyquist",
        "omega": omega,
        "response": -balance.linear(omega)[:, 0, 0],
        "amplitude": amplitude[used],
        "locus": -1.0 / gain[used],
        "bias": bias,
        "intersections": _intersections(points, cycles, 0, system.output_slices[0].start),
    }


def _nodes(system: LureSystem, points: list[Point]) -> Array:
    if not np.any(system.delays):
        return frequency_nodes(system, 120)
    top = 3 * max([p.omega for p in points] or [2 * np.pi / float(system.delays.max())])
    nodes = frequency_nodes(replace(system, delays=np.zeros_like(system.delays)), 120)
    return np.unique(np.concatenate([nodes[nodes < top], np.linspace(0.0, top, 1000)[1:]]))


def loop_gain_curves(
    balance: Balance, found: Found, points: list[Point], cycles: tuple[LimitCycle, ...]
) -> dict[str, Any]:
    """Loop gain over the amplitude at the principal element, with the frequency at each point."""
    system = balance.system
    principal = system.principal
    cut = replace(balance, pivot=principal)
    output = system.output_slices[principal].start
    branches = []
    for curve in _curves(cut, balance, found, points):
        a, _, _, omega = cut.unpack(curve)
        branches.append({"amplitude": a[:, principal], "omega": omega, "loop_gain": np.exp(-curve[:, -1])})
    return {
        "kind": "residual",
        "element": system.element_names[principal],
        "unit": unit_at_input(system, principal),
        "branches": branches,
        "intersections": _intersections(points, cycles, principal, output),
    }


def _curves(cut: Balance, balance: Balance, found: Found, points: list[Point]) -> list[Array]:
    """Solution curves of the loop cut at the principal element, through the cycles or near the curves of the search."""
    starts = [
        cut.pack(p.amplitude[None], (p.phase - p.phase[cut.pivot])[None], p.bias[None], np.array([p.omega]), np.ones(1))
        for p in points
    ]
    seeds = np.concatenate(starts) if starts else _seeds(cut, balance, found)
    curves: list[Array] = []
    for seed in seeds:
        if any(np.abs(c - seed)[:, [0, 1, -1]].max(-1).min() < 0.03 for c in curves):
            continue
        box = Box((seed[0] - 7.0, seed[0] + 7.0), (seed[1] - 7.0, seed[1] + 7.0), _REACH)
        pair = np.repeat(seed[None], 2, axis=0)
        outward = np.zeros_like(pair)
        outward[:, 0] = (1.0, -1.0)
        right, left = trace(cut, pair, outward, box, _STEPS)
        curves += settle(cut, [np.concatenate([left[::-1], seed[None], right])], 3)
    return curves


def _seeds(cut: Balance, balance: Balance, found: Found) -> Array:
    """Points of the cut loop near those curves of the search that come nearest to a cycle; none where they fail."""
    points = np.concatenate([np.zeros((0, 3 * cut.m + 1)), *found.curves])
    points = points[np.argsort(np.abs(points[:, -1]))][:_MOST_SEEDS]
    a, phase, b, omega = balance.unpack(points)
    turned = phase - phase[:, [cut.pivot]]
    start = cut.pack(a, turned, b, omega, np.exp(points[:, -1]))
    normal = np.zeros_like(start)
    normal[:, 0] = 1.0
    X, ok = newton(cut, start, normal / scales(cut, start), 18) if len(start) else (start, np.zeros(0, bool))
    ok &= np.abs(X[:, -1]) < _REACH
    return X[ok]
