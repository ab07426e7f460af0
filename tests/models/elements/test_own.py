"""Describing functions of automata of one's own: switches located in closed form, many of them in little time."""

from __future__ import annotations

import time

import numpy as np
import pytest

import eppanalysis as epp


def stem(stuck: float, slip: float) -> epp.AutomatonElement:
    """A valve's stem: it holds until the command is `stuck` away, then goes to `slip` beyond it."""
    build = epp.AutomatonBuilder(n_memory=1)
    held = build.mode("held", from_memory=1.0)
    for name, side in (("up", 1.0), ("down", -1.0)):
        build.guard(
            name, held, held, on_input=side, on_memory=-side, constant=-stuck, memory_from_input=1.0,
            memory_constant=side * slip,
        )  # fmt: skip
    return epp.AutomatonElement(build.build())


def stem_by_steps(stuck: float, slip: float, amplitude: float, bias: float) -> complex:
    """The fundamental of the stem by its own rule, switch after switch in closed form."""
    place, phases, places = 0.0, [], []
    for turn in range(3):
        for side, start in ((1.0, -0.5 * np.pi), (-1.0, 0.5 * np.pi)):
            # Along a rising or falling half turn the command passes each place that makes the stem slip.
            last = bias + side * amplitude
            while side * (last - place) > stuck:
                command = place + side * stuck
                if side * (command - (bias - side * amplitude)) >= 0.0:
                    angle = np.arcsin((command - bias) / amplitude)
                    phase = angle if side > 0 else np.pi - angle
                else:  # it stands off further than that already
                    command, phase = bias - side * amplitude, start
                place = command + side * slip
                if turn == 2:
                    phases.append(phase)
                    places.append(place)
    before = places[-1]
    edges, levels = np.array([-0.5 * np.pi, *phases, 1.5 * np.pi]), np.array([before, *places])
    sine, cosine = -np.diff(np.cos(edges)) @ levels, np.diff(np.sin(edges)) @ levels
    return complex(sine, cosine) / (np.pi * amplitude)


@pytest.mark.parametrize("ratio", [1.25, 3.5, 20.0, 166.0])
@pytest.mark.parametrize(("stuck", "slip"), [(2.0, 1.0), (0.3, 0.1), (1.0, 0.9)])
def test_a_stem_that_slips_often_answers_as_counted_by_hand(ratio, stuck, slip):
    amplitude, bias = ratio * stuck, 0.123 * stuck
    (gain,) = np.atleast_1d(stem(stuck, slip).describing_function(amplitude, bias)[1])
    assert gain == pytest.approx(stem_by_steps(stuck, slip, amplitude, bias), abs=1e-10)


def test_an_answer_that_begins_with_a_switch_is_one_whatever_rounding_says():
    """At a bias at which it slips at the very start, it slips there again a turn later, to rounding."""
    draw = np.random.default_rng(0)
    amplitude, bias = np.exp(draw.uniform(1.0, 5.0, 500)), draw.uniform(-50.0, 50.0, 500)
    assert np.all(np.isfinite(stem(2.0, 1.0).describing_function(amplitude, bias)[0]))


def test_thousands_of_switches_take_milliseconds():
    """Each is located by an arc sine, not by halving from the step of a grid."""
    element = stem(2.0, 1.0)
    element.describing_function(np.array([3.0]), 0.1)
    start = time.process_time()
    element.describing_function(np.linspace(300.0, 600.0, 200), 3.3)  # more than 100,000 switches
    assert time.process_time() - start < 0.5
