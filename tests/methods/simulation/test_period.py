"""The shape of a period against Fourier series that textbooks give in closed form."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation import period, simulate as simulation
from eppanalysis.methods.simulation.period import N_HARMONICS, analyse_period
from eppanalysis.methods.simulation.simulate import run_hybrid
from eppanalysis.results import Status


def shape_of(function, marks, delays=(), time_scale=10.0):
    """Period of a function of time; sampled where the pieces ask for it."""
    return analyse_period(
        np.asarray(marks, float), np.asarray(delays, float), time_scale, ["y"], lambda t: function(t)[:, None]
    )


def coefficient(series: np.ndarray, k: int) -> complex:
    return complex(series[k])


def test_square_wave_between_its_switches():
    """+-1 with switches at 0 and 1.5 of a period of 3: 4/(pi k) sin, only odd harmonics."""
    found = shape_of(lambda t: np.where(t % 3.0 < 1.5, 1.0, -1.0), [0.0, 1.5, 3.0])
    assert found.mean["y"] == pytest.approx(0.0, abs=1e-15)
    assert found.peak_to_peak["y"] == pytest.approx(2.0, abs=1e-12)
    for k in range(1, N_HARMONICS + 1):
        # sum Re(c exp(j k w t)): a sine of amplitude b has c = -j b.
        want = -4j / (np.pi * k) if k % 2 else 0.0
        assert coefficient(found.harmonics["y"], k) == pytest.approx(want, abs=1e-13)


def test_extremum_between_samples_and_away_from_events():
    """b + a sin(w t + phi) without any event inside: exact mean, fundamental and peak to peak."""
    omega, a, b, phi = 2 * np.pi / 0.7, 0.3, 5.0, 1.234
    found = shape_of(lambda t: b + a * np.sin(omega * t + phi), [2.0, 2.7])
    assert found.mean["y"] == pytest.approx(b, rel=1e-15)
    assert found.peak_to_peak["y"] == pytest.approx(2 * a, rel=1e-13)
    # Phases count from the begin of the period.
    assert coefficient(found.harmonics["y"], 1) == pytest.approx(-1j * a * np.exp(1j * (omega * 2.0 + phi)), abs=1e-13)


@pytest.mark.parametrize("marks", [[0.0, 1.0 + 1e-10, 1.0], [0.0, -1e-10, 1.0]], ids=["last", "first"])
def test_two_events_at_one_instant_may_stand_in_the_wrong_order(marks):
    """They do by rounding at a change of the sequence: the period is the one without them."""
    found, plain = (shape_of(lambda t: np.sin(2.0 * np.pi * t), m) for m in (marks, [0.0, 1.0]))
    assert found.peak_to_peak["y"] == pytest.approx(plain.peak_to_peak["y"], rel=1e-13)
    np.testing.assert_allclose(found.harmonics["y"], plain.harmonics["y"], atol=1e-13)


def test_exponential_sawtooth():
    """exp(-t/tau) on [0, 1): c_k = 2 (1 - exp(-1/tau)) / (1/tau + 2 pi j k), up to the last harmonic."""
    tau = 0.13
    found = shape_of(lambda t: np.exp(-(t % 1.0) / tau), [0.0, 1.0])
    for k in (1, 5, 25):
        want = 2 * (1 - np.exp(-1 / tau)) / (1 / tau + 2j * np.pi * k)
        assert coefficient(found.harmonics["y"], k) == pytest.approx(want, rel=1e-11)
    assert found.mean["y"] == pytest.approx(tau * (1 - np.exp(-1 / tau)), rel=1e-12)
    assert found.peak_to_peak["y"] == pytest.approx(1 - np.exp(-1 / tau), rel=1e-3)


def test_kink_that_echoes_behind_a_dead_time():
    """A triangle whose corners lie a dead time behind the events is exact only if the echoes are corners too."""
    late = 0.3

    def triangle(t):
        u = (t - late) % 2.0
        return np.where(u < 1.0, u, 2.0 - u)

    found = shape_of(triangle, [0.0, 1.0, 2.0], delays=[late])
    assert found.peak_to_peak["y"] == pytest.approx(1.0, abs=1e-13)
    assert abs(found.harmonics["y"][1]) == pytest.approx(4 / np.pi**2, rel=1e-13)
    assert abs(found.harmonics["y"][3]) == pytest.approx(4 / (9 * np.pi**2), rel=1e-11)


def test_pieces_are_refined_until_a_fast_signal_is_resolved():
    """40 oscillations within an arc that was said to be slow."""
    found = shape_of(lambda t: np.sin(2 * np.pi * 20 * t), [0.0, 1.0], time_scale=1.0)
    assert abs(found.harmonics["y"][20]) == pytest.approx(1.0, rel=1e-10)
    assert found.peak_to_peak["y"] == pytest.approx(2.0, rel=1e-10)


def test_a_sum_of_all_harmonics_is_resolved_by_the_first_samples():
    """A period that has no more than the harmonics that are told is computed once, not once more for some pieces."""
    asked, k = [], np.arange(1, N_HARMONICS + 1)

    def signal(t):
        asked.append(t.size)
        return np.cos(2.0 * np.pi * np.outer(t, k)).sum(axis=1)

    found = shape_of(signal, [0.0, 1.0])
    assert len(asked) == 1
    np.testing.assert_allclose(found.harmonics["y"][1:], np.ones(N_HARMONICS), rtol=1e-12)
    assert found.peak_to_peak["y"] >= N_HARMONICS


def test_harmonics_are_computed_when_looked_at_and_copied_with_their_cycle(monkeypatch):
    """A cycle's size is told without them; a copy, as other processes get it, holds them."""
    run = epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay()), t_end=100.0)
    copy = pickle.loads(pickle.dumps(run.limit_cycle))
    monkeypatch.setattr(period, "_harmonics", None)
    assert copy.harmonics.keys() == run.limit_cycle.peak_to_peak.keys()
    for name, series in copy.harmonics.items():
        assert series[0].real == pytest.approx(copy.mean[name], abs=1e-14)
    again = epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay()), t_end=100.0).limit_cycle
    assert again.peak_to_peak == copy.peak_to_peak
    with pytest.raises(TypeError):
        again.amplitude("y")


def test_waveform_begins_with_the_period_and_stays_inside():
    found = shape_of(lambda t: t, [3.0, 3.5, 4.0])
    assert found.time[0] == 0.0 and np.all(np.diff(found.time) > 0) and found.time[-1] < 1.0
    np.testing.assert_allclose(found.waveform["y"], 3.0 + found.time, atol=1e-12)


@pytest.mark.parametrize("shift", np.linspace(-1e-4, 1e-4, 9))
def test_extremum_just_beyond_the_end_of_a_piece(shift):
    """The parabola's top lies beside an event, on either side: exact wherever it is."""
    found = shape_of(lambda t: -((t - 0.5 - shift) ** 2), [0.0, 0.5, 1.0])
    assert found.peak_to_peak["y"] == pytest.approx((0.5 + abs(shift)) ** 2, rel=1e-13)


@pytest.mark.parametrize(("marks", "share"), [([1.0, 1.0, 1.0], 1.0), ([0.0, 0.3, 1.0], 0.7), ([0.0, 1.0], 0.0)])
def test_a_period_without_length_or_without_its_end_is_refused(marks, share):
    """Switches at one instant, and a run that ends too soon when it is made once more."""

    def sample(times):
        return np.sin(times[: int(share * times.size)])[:, None]

    with pytest.raises(EppError, match=r"no length|once more"):
        analyse_period(np.array(marks), np.zeros(0), 1.0, ["y"], sample)


@pytest.mark.parametrize("events", [0, 7, 60])
def test_a_run_whose_period_cannot_be_computed_again_is_on_no_cycle(events, monkeypatch):
    """The run is as it was; of its period nothing is said."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    whole = epp.simulate(loop, t_end=100.0)

    def cut(hybrid, t_end, times, base, most, keep, *steps):
        return run_hybrid(hybrid, t_end, times, base, most if keep > 1 else events, keep, *steps)

    monkeypatch.setattr(simulation, "run_hybrid", cut)
    run = epp.simulate(replace(loop, x0=np.array([1.0, 0.0, 0.0])), {}, t_end=100.0)
    again = epp.simulate(loop, t_end=100.0)
    assert whole.status is Status.LIMIT_CYCLE
    for each in (run, again):
        # Few events are enough for one period behind its own first event.
        assert (each.limit_cycle is None) == (each.status is Status.UNDECIDED) == (events == 0)
    assert again.events == whole.events


def test_the_swing_beside_an_offset_has_the_rounding_of_the_samples():
    """Ends of pieces are told from sums, in which the rounding of an offset grew by the square of their terms."""

    def bump(t):
        return (1.0 + 1e-3 * np.sin(np.pi * t))[:, None]

    shape = analyse_period(np.array([0.0, 0.3, 1.0]), np.zeros(0), 0.1, ["x"], bump)
    assert shape.peak_to_peak["x"] == pytest.approx(1e-3, abs=1e-15)
    assert shape.mean["x"] == pytest.approx(1.0 + 2e-3 / np.pi, abs=1e-15)
