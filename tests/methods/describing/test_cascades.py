"""Predictions of cascades, one sampled law behind another at other rates, and of what cannot be linearised."""

from __future__ import annotations

import json

import numpy as np
import pytest

import eppanalysis as epp

RATES = [(0.1, 0.02), (0.3, 0.1), (0.1, 0.03), (0.25, 0.1), (0.02, 0.1), (0.1, 0.1)]
WIRES = [("e outer inner", 0.0), ("e outer inner", 0.01), ("outer inner e", 0.0), ("outer e inner", 0.0)]
PLACES = ["plant.out", "outer.out", "inner.out", "e.in", "e.out"]


def of_all(rates, others):
    """All pairs; in the quick tier each rate and each of the others with the first one."""
    return [
        pytest.param(rate, *other, marks=[pytest.mark.slow] * (i > 0 and k > 0))
        for i, rate in enumerate(rates)
        for k, other in enumerate(others)
    ]


def cascade(outer, inner, element, wires="e outer inner", late=0.0, gain=2.0):
    """Two laws, each executed at its own rate, and an element, in a row round an integrating plant."""
    first, second, third = wires.split()
    return epp.Diagram(
        parts={
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 2.0, 0.0], start=[0.0, 0.0, 1.0]),
            "outer": epp.blocks.Gain(gain=gain, sample_time=outer, computation_delay=late),
            "inner": epp.blocks.Gain(gain=1.0, sample_time=inner),
            "e": element,
        },
        connect=[f"-plant -> {first}", f"{first} -> {second}", f"{second} -> {third}", f"{third} -> plant"],
    ).to_system()


@pytest.mark.parametrize(("rates", "wires", "late"), of_all(RATES, WIRES))
def test_a_cascade_of_two_rates_has_the_cycle_that_runs_come_to(rates, wires, late):
    """A limit is smooth enough for a run not to lock to few samples a turn."""
    loop = cascade(*rates, epp.Saturation(-1.0, 1.0), wires, late, gain=8.0)
    (cycle,) = epp.predict_limit_cycles(loop)
    run = epp.simulate(loop, t_end=200.0)
    time = np.linspace(100.0, 200.0, 100001)
    y = np.interp(time, run.t, run.signals["plant"])
    rises = time[1:][(y[:-1] < 0.0) & (y[1:] >= 0.0)]
    assert cycle.stable
    assert cycle.period == pytest.approx(np.ptp(rises) / (len(rises) - 1), rel=cycle.error_estimate + 0.01)
    assert cycle.peak_to_peak["plant"] == pytest.approx(np.ptp(y), rel=cycle.error_estimate + 0.03)


@pytest.mark.parametrize(("rates", "place"), of_all(RATES, [(p,) for p in PLACES]))
def test_margins_of_a_cascade_are_where_runs_begin_to_grow(rates, place):
    """Cut anywhere; in the mean over the samples they are good to the square of the phase between samples."""
    valve = epp.Saturation(-1e6, 1e6)
    found = epp.margins(cascade(*rates, valve), place)
    exact = any("exact" in line for line in found.rule)
    off = 1e-3 if exact else 1e-3 + (found.phase_crossover * max(rates)) ** 2 / 3.0
    for factor in (1.0 - off, 1.0 + off):
        run = epp.simulate(cascade(*rates, valve, gain=2.0 * found.gain_margin * factor), t_end=600.0)
        early, late = (np.ptp(run.signals["plant"][(run.t > t) & (run.t < t + 30.0)]) for t in (100.0, 570.0))
        assert (late > early) == (factor > 1.0)


def beyond_all_range(gain: float) -> epp.LureSystem:
    """A loop in units in which squares of its numbers are infinite."""
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]]
    return epp.LureSystem.build(A, [[0.0], [0.0], [-1e160]], [[gain * 1e-160, 0.0, 0.0]], [epp.Saturation(-1.0, 1.0)])


@pytest.mark.parametrize(("gain", "count"), [(1.0, 0), (20.0, 1)])
def test_margins_that_cannot_be_taken_leave_the_prediction(gain, count):
    loop = beyond_all_range(gain)
    with pytest.raises(epp.ModelError, match="beyond all range"):
        epp.margins(loop)
    prediction = epp.predict_limit_cycles(loop)
    assert len(prediction) == count and str(prediction).startswith("The describing function predicts")
    assert np.isnan(prediction.margins["gain_margin"]) and "beyond all range" in prediction.margins["message"]
    assert "beyond all range" in json.dumps(prediction.to_dict())
