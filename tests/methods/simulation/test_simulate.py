"""The event-exact simulation beside integrators and closed forms that share no code with it."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError
from eppanalysis.results import Status
from tests.random_loops import random_loop
from tests.reference.elbow_reference import LBF, ROWS, row, simulate_reference
from tests.shared import cycles_of, shipped

ROOT = str(Path(epp.__file__).parents[1])
TEXTBOOK = [name for name, case in shipped().items() if case.expected.exact and case.expected.outcome]


def run_case(name: str, t_end: float | None = None, **changes: Any) -> epp.Trajectory:
    """Simulation of a shipped case; fields with two underscores in place of the dot."""
    case = epp.case(name)
    if changes:
        case = case.with_values({field.replace("__", "."): value for field, value in changes.items()})
    return epp.simulate(case.to_system(), case.input, t_end or case.t_end)


# The truth table ------------------------------------------------------------------------------------------------------
#: A row with friction of the pulley; all of them are for the paper.
WITNESSED = [number if number == 4 else pytest.param(number, marks=pytest.mark.slow) for number in ROWS]


@pytest.mark.parametrize("number", WITNESSED)
def test_rows_of_the_truth_table_agree_with_an_independent_integrator(number: int) -> None:
    """Over 1 s all signals of scipy's run come out; theta to 1e-8 rad (in fact to 1e-12)."""
    times = np.linspace(0.0, 1.0, 201)
    reference = simulate_reference(row(number), 1.0, times, rtol=1e-11, atol=1e-13)
    case = epp.case(ROWS[number]["name"])
    run = epp.simulate(case.to_system(), case.input, 1.0, times)
    np.testing.assert_allclose(run.signals["theta"], reference.signals["theta"], rtol=0, atol=1e-8)
    # Signals that jump differ where a sample is an event time: the first sample, at the step.
    for name, size in {"theta_dot": 1e-7, "drive_angle": 1e-8, "drive_speed": 1e-7, "sensor_force": 1e-5}.items():
        np.testing.assert_allclose(run.signals[name][1:], reference.signals[name][1:], rtol=0, atol=size)


@pytest.mark.parametrize(
    "second",
    [
        (0.0655, 0.004),
        *(pytest.param(s, marks=pytest.mark.slow) for s in ((0.0405, -0.012), (0.0655, 0.012), (0.0655, -0.004))),
        (0.39, 0.002),
    ],
)
def test_second_harness_step_agrees_with_an_independent_integrator(second: tuple[float, float]) -> None:
    """While the cable sticks on the pulley, and while it slides: against the step, far against it, and with it."""
    t_end = second[0] + 0.15
    times = np.linspace(0.0, t_end, 202)[1:]
    reference = simulate_reference(row(4), t_end, times, rtol=1e-11, atol=1e-13, second=second)
    case = epp.case(ROWS[4]["name"])
    run = epp.simulate(case.to_system(), epp.inputs.Steps([0.0, second[0]], [0.02, 0.02 + second[1]]), t_end, times)
    for name, size in {"theta": 1e-10, "theta_dot": 1e-8, "sensor_force": 1e-8, "harness_force": 1e-8}.items():
        np.testing.assert_allclose(run.signals[name], reference.signals[name], rtol=0, atol=size)


@pytest.mark.parametrize("number", ROWS)
def test_rows_of_the_truth_table_come_out_as_the_paper_found(number: int) -> None:
    status = {"oscillate": Status.LIMIT_CYCLE, "settle": Status.SETTLED}[ROWS[number]["must"]]
    assert run_case(ROWS[number]["name"]).status is status


@pytest.mark.slow
def test_period_of_the_original_elbow_is_that_of_the_independent_integrator() -> None:
    """Its period is the mean of many passages of an interpolant, hence 1e-6."""
    reference = simulate_reference(row(1), 4.0, rtol=1e-9, atol=1e-11)
    cycle = run_case("fig8a_original").limit_cycle
    assert cycle is not None
    assert cycle.period == pytest.approx(reference.period, rel=1e-6)
    assert cycle.peak_to_peak["theta"] == pytest.approx(reference.peak_to_peak, rel=1e-6)


# Textbook loops -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", TEXTBOOK)
def test_exact_answers_of_textbook_loops(name: str) -> None:
    """Frequency and amplitude to six digits, from codes and closed forms that each case file names."""
    expected, signal = epp.case(name).expected, epp.case(name).expected.signal
    cycle = run_case(name).limit_cycle
    assert cycle is not None and expected.exact and signal
    half = cycle.peak_to_peak[signal] / 2
    want = min((c for c in expected.exact if c.stable is not False), key=lambda c: abs(c.amplitude - half))
    assert cycle.omega == pytest.approx(want.omega, rel=1e-6)
    assert half == pytest.approx(want.amplitude, rel=1e-6)
    if want.mean is not None:
        assert cycle.mean[signal] == pytest.approx(want.mean, abs=1e-6 * want.amplitude)


# Sticking and switching -----------------------------------------------------------------------------------------------
def test_stuck_is_stuck() -> None:
    """While the drive sticks its speed is zero, not small, and its angle does not creep."""
    run = run_case("fig8b_reduced_backlash")
    rest = run.t > run.settled_since + 0.1
    assert rest.sum() > 1000
    assert np.all(run.signals["drive_speed"][rest] == 0.0)
    assert np.ptp(run.signals["drive_angle"][rest]) == 0.0


def test_a_clock_does_not_count_when_the_steady_part_is_looked_for() -> None:
    """A parking logic that never acts leaves the run, and since when it is steady, as they are."""
    plain, timed = run_case("fig8a_original"), run_case("fig8a_original", parking__dwell_time=1.0)
    assert 0.5 < plain.settled_since < 3.0
    assert timed.settled_since == pytest.approx(plain.settled_since, abs=1e-9)


@pytest.mark.parametrize("begin", [0.5, 1.0, 10.0, 1e3])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_run_rests_once_its_signals_do_not_once_nothing_switches(begin, unit):
    """Behind its limit a loop of first order dies away as an exponential; what the limit lets pass does so last."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.0]), epp.Saturation(-unit, unit), x0=[begin * unit])
    run = epp.simulate(loop, t_end=2.0 * begin + 40.0)
    expected = max(0.0, begin - 1.0) + math.log(1e3)
    assert run.status is Status.SETTLED
    assert expected <= run.settled_since + 1e-9 <= expected + 2.0 * run.t[1]


@pytest.mark.parametrize("t_end", [60.0, 120.0, 200.0])
def test_a_smooth_loop_that_dies_out_rests_since_it_has_however_long_it_runs(t_end: float) -> None:
    """Nothing in it switches; its turns go on, each a fraction of the one before, down to 1e-30 of the first."""
    level, slope = 0.5, 1.33
    loop = epp.LureSystem.from_tf(([9.67], [1.0, 8.647, 22.7, 20.21, 4.7]), epp.Tanh(level=level, slope=slope))
    run = epp.simulate(loop, t_end=t_end)

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        return loop.A @ x + loop.B[:, 0] * level * np.tanh(slope / level * (loop.C[0] @ x))

    alone = solve_ivp(rates, (0.0, 60.0), loop.x0, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.05)
    x = loop.C[0] @ alone.y
    signals = x, level * np.tanh(slope / level * x)
    last = max(alone.t[np.flatnonzero(np.abs(v) > 1e-3 * np.ptp(v))[-1]] for v in signals)
    assert run.status is Status.SETTLED
    assert last - 0.05 <= run.settled_since <= last + 0.05 + 2.0 * run.t[1]


@pytest.mark.parametrize("farther", [1e4, 1e6, 1e8])
@pytest.mark.parametrize("name", ["relay_hyst_goncalves6", "pid_hunting"])
def test_a_run_from_far_out_comes_to_the_same_cycle(name: str, farther: float) -> None:
    """Beside its start the motion is nothing, and seemed to be at rest."""
    case = epp.case(name)
    system = case.to_system()
    far = replace(system, x0=farther * np.linspace(1.0, 0.2, system.x0.size))
    near, from_afar = (epp.simulate(loop, case.input, case.t_end).limit_cycle for loop in (system, far))
    assert from_afar.period == pytest.approx(near.period, rel=1e-6)
    assert from_afar.peak_to_peak["x"] == pytest.approx(near.peak_to_peak["x"], rel=1e-6)


def test_hunting_rests_between_its_jumps() -> None:
    """Integral action winds up while the mass sticks: five of six seconds at a velocity of exactly zero."""
    run = run_case("pid_hunting")
    late = run.t > 0.5 * run.t[-1]
    assert np.mean(run.signals["v"][late] == 0.0) > 0.7
    assert np.max(np.abs(run.signals["v"][late])) > 0.1


def test_force_is_at_a_threshold_whenever_the_band_changes() -> None:
    """Each switch is located: signals sampled at the very times of the events are on the threshold."""
    case = epp.case("fig8a_original")
    first = epp.simulate(case.to_system(), case.input, 1.0)
    times = np.array(sorted({e.time for e in first.events if e.element == "bands" and e.time > 0.0}))
    again = epp.simulate(case.to_system(), case.input, 1.0, times)
    thresholds = np.array([case.value(f"bands.{name}") for name in ("slack", "low", "high", "max")])
    distance = np.abs(again.signals["sensor_force"][:, None] - thresholds).min(1)
    assert times.size > 20
    assert distance.max() < 1e-10


def test_events_are_in_order_and_name_their_element() -> None:
    run = run_case("fig6a_original_pulley", 1.0)
    times = [e.time for e in run.events]
    assert times == sorted(times)
    assert {e.element for e in run.events} == {"cable", "bands", "lock_pin", "drive_friction"}
    assert {e.name for e in run.events if e.element == "cable"} and all(e.name and e.mode for e in run.events)


def test_a_short_pulse_between_samples_is_not_stepped_over() -> None:
    """A relay with dead zone that a pulse of 1 ms pushes over its threshold leaves exactly that impulse behind."""
    system = epp.LureSystem.build(
        [[0.0]],
        [[1.0]],
        [[0.0]],
        [epp.RelayDeadZone(threshold=1.0)],
        D_input=[[1.0]],
        input_names=("u",),
    )
    input_signal = epp.inputs.Recorded([0.0, 5.0, 5.0005, 5.001, 10.0], [0.0, 0.0, 2.0, 0.0, 0.0])
    run = epp.simulate(system, input_signal, 10.0, [0.0, 10.0])
    assert [e.time for e in run.events] == pytest.approx([5.00025, 5.00075], abs=1e-12)
    held = epp.simulate(replace(system, signals=_states(system)), input_signal, 10.0, [10.0])
    assert held.signals["x0"][0] == pytest.approx(5e-4, abs=1e-13)


def _states(system: epp.LureSystem) -> Any:
    """Signals that are the states."""
    n = system.A.shape[0]
    zero = np.zeros((n, system.B.shape[1])), np.zeros((n, len(system.input_names))), np.zeros(n)
    return replace(system.signals, names=tuple(f"x{i}" for i in range(n)), C=np.eye(n), D=zero[0], D_input=zero[1],
                   constant=zero[2], units=("",) * n)  # fmt: skip


def test_accumulating_switches_end_the_run_and_say_so() -> None:
    """x'' = -sgn x - sgn(x')/2 from rest at 1: each oscillation is a third of the one before and takes 8/3 sqrt(x).

    The switches accumulate at 8/3 / (1 - 1/sqrt 3) s.
    """
    elements = [epp.Relay(), epp.Friction(coulomb=0.5)]
    system = epp.LureSystem.build([[0, 1], [0, 0]], [[0, 0], [-1, -1]], np.eye(2), elements, x0=[1, 0])
    run = epp.simulate(system, t_end=10.0, max_events=2000)
    assert run.status is Status.EVENT_LIMIT
    assert run.t[-1] == pytest.approx(8 / 3 / (1 - 1 / math.sqrt(3)), abs=2e-3)
    assert not run.status.ok and run.limit_cycle is None
    assert "accumulate" in run.to_dict()["message"]


def test_a_relay_slides_along_its_threshold() -> None:
    """An ideal relay round 1/(s + 1) arrives at zero after ln 2 (x' = -x - 1 from 1) and stays there."""
    run = epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Relay()), t_end=5.0)
    assert run.status is Status.SETTLED
    assert run.events[-1].time == pytest.approx(math.log(2.0), abs=1e-12)
    assert np.all(np.abs(run.signals["x"][run.t > 0.7]) < 1e-12)


def test_a_loop_that_grows_diverges() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, -50.0]), epp.Saturation())
    assert epp.simulate(loop, t_end=100.0).status is Status.DIVERGED


def test_growth_between_samples_ends_before_numbers_do() -> None:
    """No switch stops this loop's growth, and its samples keep it to short steps: it once ran into infinity."""
    run = epp.simulate(random_loop(44054), t_end=400.0)
    assert run.status is Status.DIVERGED
    assert 0.0 < run.t[-1] < 30.0
    assert all(np.all(np.isfinite(s)) for s in run.signals.values())


def test_a_run_that_is_too_short_is_undecided() -> None:
    run = run_case("relay_ideal_khalil79", 5.0)
    assert run.status is Status.UNDECIDED and run.limit_cycle is None and math.isnan(run.settled_since)


# Sample times and arguments -------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("drag", "comes_to"), [(1e-3, "settles"), (-1e-3, "grows without bound")])
def test_a_run_that_is_too_short_to_die_down_or_grow_says_which(drag: float, comes_to: str) -> None:
    """A wheel on a spring with backlash, in little drag: 60 s are many turns, and no rest yet."""
    shaft = epp.DeadZone(-0.01, 0.01, 60.0)
    A = [[0.0, 1.0], [0.0, -25.0 * drag]]
    column = epp.LureSystem.build(A, [[0.0], [-25.0]], [[1.0, 0.0]], [shaft], x0=[0.3, 0.0])
    run = epp.simulate(column, t_end=60.0)
    assert run.status is epp.Status.UNDECIDED and f"carried on, it {comes_to}" in run.note


def test_what_friction_gives_is_not_said_to_go_further_and_further() -> None:
    """A short run of a stage that sticks: its friction grows with the integral up to the slip, never beyond."""
    A = [[0.0, 1.0, 0.0], [-10.0, -1.0, -5.0], [1.0, 0.0, 0.0]]
    stage = epp.LureSystem.build(A, [[0], [-1], [0]], [[0, 1, 0]], [epp.Friction(1.0, 2.0)], x0=[0.1, 0, 0])
    run = epp.simulate(stage, t_end=10.0)
    assert run.status is epp.Status.UNDECIDED and "further" not in str(run)


def test_every_form_of_t_eval_gives_the_same_motion() -> None:
    case = epp.case("fig8a_original")
    system = case.to_system()
    even = epp.simulate(system, case.input, 1.0, np.linspace(0.0, 1.0, 101))
    uneven = epp.simulate(system, case.input, 1.0, [0.1, 0.11, 0.5, 0.77, 1.0])
    late = epp.simulate(system, case.input, 1.0, np.linspace(0.5, 1.0, 51))
    single = epp.simulate(system, case.input, 1.0, 0.5)
    theta = even.signals["theta"]
    np.testing.assert_allclose(uneven.signals["theta"], theta[[10, 11, 50, 77, 100]], rtol=0, atol=1e-11)
    np.testing.assert_allclose(late.signals["theta"], theta[50:], rtol=0, atol=1e-11)
    assert single.signals["theta"] == pytest.approx(theta[50], abs=1e-11)
    assert epp.simulate(system, case.input, 1.0).t.size == 6001


def test_results_do_not_depend_on_the_internal_step() -> None:
    case = epp.case("fig6a_original_pulley")
    runs = [epp.simulate(case.to_system(), case.input, 1.0, [1.0], step=h) for h in (1e-2, 1e-3, 1.7e-4)]
    np.testing.assert_allclose([r.signals["theta"][0] for r in runs], runs[0].signals["theta"][0], rtol=0, atol=1e-11)
    assert len({len(r.events) for r in runs}) == 1


@pytest.mark.parametrize("t_end", [0.0, -1.0, math.nan, math.inf])
def test_end_must_be_positive(t_end: float) -> None:
    with pytest.raises(EppError, match="expected a positive number of seconds"):
        epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Saturation()), t_end=t_end)


@pytest.mark.parametrize("t_eval", [[0.2, 0.1], [0.1, 0.1], [0.0, math.nan], [0.0, 2.0], [-0.1, 0.5]])
def test_sample_times_must_increase_within_the_run(t_eval: list[float]) -> None:
    with pytest.raises(EppError, match="t_eval"):
        epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Saturation()), t_end=1.0, t_eval=t_eval)


def test_an_unknown_input_and_an_input_signal_without_input_are_refused() -> None:
    with pytest.raises(ModelError, match="no input 'harnes'; expected one of: harness_position"):
        epp.simulate(epp.case("fig8a_original").to_system(), {"harnes": epp.inputs.Step(0.02)}, 1.0)
    with pytest.raises(ModelError, match="0 inputs"):
        epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Saturation()), epp.inputs.Step(1.0), 1.0)


# Input signals -------------------------------------------------------------------------------------------------
INPUT_SIGNALS: dict[str, epp.inputs.InputSignal] = {
    "constant": epp.inputs.Constant(0.4),
    "step": epp.inputs.Step(1.5, time=0.7),
    "steps": epp.inputs.Steps([0.4, 1.2, 3.1], [1.0, -0.5, 0.8]),
    "ramp": epp.inputs.Ramp(0.8, start=0.5, stop=2.5),
    "endless ramp": epp.inputs.Ramp(0.5),
    "sine": epp.inputs.Sine(1.2, 0.4, 0.3),
    "recorded": epp.inputs.Recorded([0.3, 1.0, 1.4, 3.0], [0.0, 2.0, -1.0, 0.5]),
}
#: Where each of them is not smooth, read off above.
KINKS = {"step": [0.7], "steps": [0.4, 1.2, 3.1], "ramp": [0.5, 2.5], "recorded": [0.3, 1.0, 1.4, 3.0]}
#: The same input signals written once more, as plain functions of time behind 0.
FORMULAS: dict[str, Callable[[float], float]] = {
    "constant": lambda t: 0.4,
    "step": lambda t: 1.5 if t >= 0.7 else 0.0,
    "steps": lambda t: 0.0 if t < 0.4 else 1.0 if t < 1.2 else -0.5 if t < 3.1 else 0.8,
    "ramp": lambda t: 0.8 * min(max(t - 0.5, 0.0), 2.0),
    "endless ramp": lambda t: 0.5 * t,
    "sine": lambda t: 1.2 * math.sin(2 * math.pi * 0.4 * t + 0.3),
    "recorded": lambda t: 0.0 if t < 0.3 else float(np.interp(t, [0.3, 1.0, 1.4, 3.0], [0.0, 2.0, -1.0, 0.5])),
}


def _driven() -> epp.LureSystem:
    """Mass on a saturating spring: v' = v0 + u - 0.3 v - 4 sat(x), with x and u = 0.2 at the start."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -0.3]],
        [[0.0], [-4.0]],
        [[1.0, 0.0]],
        [epp.Saturation()],
        B_input=[[0.0], [1.0]],
        input_names=("push",),
        v0=[0.2],
        x0=[0.05, 0.0],
    )


@pytest.mark.parametrize("kind", INPUT_SIGNALS)
def test_input_signals_against_scipy(kind: str) -> None:
    """Restarted at the kinks of the motion; the spring's corner costs the integrator digits, hence 1e-7."""
    times = np.linspace(0.0, 5.0, 51)
    found = epp.simulate(replace(_driven(), signals=_states(_driven())), INPUT_SIGNALS[kind], 5.0, times)
    force = FORMULAS[kind]

    def rate(t: float, y: Any, before: float) -> list[float]:
        push = 0.2 + force(min(t, before))
        return [y[1], push - 0.3 * y[1] - 4.0 * min(max(y[0], -1.0), 1.0)]

    y, edges = np.array([0.05, 0.0]), [0.0, *KINKS.get(kind, []), 5.0]
    for begin, end in zip(edges, edges[1:], strict=False):
        inside = times[(times > begin) & (times <= end)]
        limit = np.nextafter(end, 0.0)
        part = solve_ivp(rate, (begin, end), y, "DOP853", np.union1d(inside, [end]), args=(limit,), rtol=1e-11,
                         atol=1e-12, max_step=0.02)  # fmt: skip
        for t, state in zip(part.t, part.y.T, strict=True):
            if t in inside:
                i = int(np.searchsorted(times, t))
                assert [found.signals["x0"][i], found.signals["x1"][i]] == pytest.approx(list(state), abs=1e-7)
        y = part.y[:, -1]


def test_an_input_signal_moves_the_elbow_as_far_as_statics_say() -> None:
    """Behind any motion: F = K (x_h - R theta), and what the band law makes of F is held by the drive's friction."""
    case = epp.case("fig8b_reduced_backlash")
    input_signals = (
        epp.inputs.Step(0.01),
        epp.inputs.Ramp(0.02, start=0.2, stop=0.7),
        epp.inputs.Recorded([0.0, 0.5, 1.0], [0.0, 0.004, 0.01]),
    )
    for run in (epp.simulate(case.to_system(), input_signal, 4.0) for input_signal in input_signals):
        assert run.status is Status.SETTLED
        end = run.settled_at
        force = 2.5 * LBF + 6705.263 * (0.01 - 0.019 * end["theta"])
        assert end["sensor_force"] == pytest.approx(force, rel=1e-6)
        assert abs(10.93 / 16.0 * five_bands(np.array(force)) + 0.019 * force) <= 0.3 * (1 + 1e-9)


# Options of the elbow -------------------------------------------------------------------------------------------------
def five_bands(force: np.ndarray) -> np.ndarray:
    """The paper's band law with the nominal thresholds, as a table of its corners."""
    corners = LBF * np.array([1.25, 2.4, 2.6, 3.75])
    return np.interp(force, corners, [-16.0, 0.0, 0.0, 16.0])


def test_voltage_follows_the_band_law() -> None:
    run = run_case("fig8a_original", 1.0)
    np.testing.assert_allclose(run.signals["voltage"], five_bands(run.signals["sensor_force"]), atol=1e-9)


def test_quantiser_rounds_the_force() -> None:
    """8 bits over the full scale: the voltage is the law of the rounded force but at samples beside a switch."""
    case = epp.case("fig8a_original").with_values({"sensor.bits": 8})
    run = epp.simulate(case.to_system(), case.input, 1.0)
    step = case.elbow_parameters.sensor.force_step
    rounded = step * np.round(run.signals["sensor_force"] / step)
    off = np.abs(run.signals["voltage"] - five_bands(rounded)) > 1e-9
    assert off.mean() < 0.002
    assert np.unique(np.round(run.signals["voltage"], 9)).size < 200


def test_sample_period_holds_the_voltage() -> None:
    """The voltage is the law of the force at the last multiple of 4 ms."""
    case = epp.case("fig8a_original").with_values({"controller.sample_period": "4 ms"})
    times = np.arange(0, 1000) * 1e-3 + 5e-4
    run = epp.simulate(case.to_system(), case.input, 1.0, times)
    at_clock = epp.simulate(case.to_system(), case.input, 1.0, np.arange(0, 251) * 4e-3)
    held = five_bands(at_clock.signals["sensor_force"])[np.arange(1000) // 4]
    np.testing.assert_allclose(run.signals["voltage"], held, atol=1e-6)


def test_offset_voltage_jumps_at_the_inner_edges() -> None:
    run = run_case("fig8a_original", 2.0, bands__offset_voltage="2 V")
    voltage = run.signals["voltage"][1:]
    moving = np.abs(voltage) > 1e-9
    assert moving.any() and not moving.all()
    assert np.abs(voltage[moving]).min() >= 2.0 - 1e-9


@pytest.mark.parametrize(("lead", "numerator"), [({}, [1.0]), ({"sensor.lead": "20 ms"}, [0.02, 1.0])])
def test_sensor_filter_is_of_first_order(lead: dict[str, str], numerator: list[float]) -> None:
    """The voltage is the law of the force behind the filter, which scipy computes from the run's own samples."""
    case = epp.case("fig8b_reduced_backlash").with_values({"sensor.filter": "5 ms", **lead})
    run = epp.simulate(case.to_system(), case.input, 1.0, np.linspace(0.0, 1.0, 20001))
    force = run.signals["sensor_force"].copy()
    _, lagged, _ = lsim((numerator, [5e-3, 1.0]), force - 2.5 * LBF, run.t)
    np.testing.assert_allclose(run.signals["voltage"][1:], five_bands(lagged + 2.5 * LBF)[1:], atol=2e-3)


def test_parking_logic_ends_the_oscillation_of_the_original_elbow() -> None:
    """After 5 ms inside the parking band there is no voltage, although the force may leave the band downwards."""
    case = epp.case("fig8a_original").with_values({"parking.dwell_time": "5 ms"})
    run = epp.simulate(case.to_system(), case.input, 4.0)
    assert run.status is Status.SETTLED
    parked = [e.time for e in run.events if e.element == "bands" and e.mode == "parked"]
    assert np.all(run.signals["voltage"][run.t > parked[-1]] == 0.0)
    # The force entered the band exactly the dwell time before, and stayed there.
    before = epp.simulate(case.to_system(), case.input, 4.0, np.linspace(parked[-1] - 5e-3, parked[-1], 21))
    force = before.signals["sensor_force"]
    assert min(abs(force[0] - 2.4 * LBF), abs(force[0] - 2.6 * LBF)) < 1e-9
    assert np.all((force[1:] > 2.4 * LBF) & (force[1:] < 2.6 * LBF))


def test_two_cables_rest_with_equal_tensions() -> None:
    """The controller sees the difference: at rest it is within the parking band, and friction holds what is left."""
    low_gain = {"bands.range": "5 lbf", "lock_pin.backlash": "0.1 deg"}
    case = epp.case("fig8b_reduced_backlash").with_values(
        {**low_gain, "cable.antagonist": True, "cable.pretension": "3 lbf"}
    )
    run = epp.simulate(case.to_system(), case.input, 4.0)
    assert run.status is Status.SETTLED
    one, other = run.settled_at["harness_force"], run.settled_at["antagonist_harness_force"]
    assert one + other == pytest.approx(6.0 * LBF, rel=1e-9)
    assert abs(one - other) <= 0.1 * LBF
    assert run.settled_at["pin_torque"] == pytest.approx(0.019 * (other - one), abs=1e-9)


def test_a_slack_cable_never_pushes() -> None:
    """A harness that is let go by 20 mm slackens the cable: no force until the elbow has come down."""
    case = epp.case("fig8b_reduced_backlash")
    run = epp.simulate(case.to_system(), epp.inputs.Step(-0.02), 4.0)
    assert run.signals["sensor_force"].min() == 0.0
    assert np.any(run.signals["sensor_force"][(run.t > 0.01) & (run.t < 0.1)] == 0.0)
    assert run.settled_at["theta"] == pytest.approx(-0.02 / 0.019, abs=0.005)


# Datasets -------------------------------------------------------------------------------------------------------------
def test_dataset_carries_units_and_the_verdict() -> None:
    dataset = run_case("fig8a_original", 1.0).to_dataset()
    assert dataset["theta"].attrs["units"] == "rad" and dataset.sizes["time"] == 6001
    assert dataset.attrs["status"] in {"limit_cycle", "undecided"}


def test_what_a_run_remembers_of_its_dead_time_is_its_own():
    # A run whose delayed signal bends leaves a history behind; the next one in the same workspaces begins with none.
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Saturation(slope=4.0), delay=0.6)
    runs = [epp.simulate(replace(loop, x0=np.array([0.0, 1.0])), t_end=20.0).signals["x"] for _ in range(2)]
    np.testing.assert_array_equal(*runs)
    assert np.ptp(runs[0]) > 1.0


_BITS = """
import hashlib
import eppanalysis as epp
case = epp.case("fig8a_original")
run = epp.simulate(case.to_system(), case.input, case.t_end)
relay = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
guess = epp.predict_limit_cycles(relay)[-1]
orbit = epp.exact_orbit(relay, guess)
numbers = [*(v.tobytes() for v in run.signals.values()), repr([e.time for e in run.events]).encode()]
numbers += [repr((c.omega, c.peak_to_peak, c.multipliers, c.residual)).encode() for c in (guess, orbit)]
digest = hashlib.sha256(b"".join(numbers)).hexdigest()
"""


@pytest.mark.slow
def test_another_process_gives_the_same_bits() -> None:
    """In the first run on a machine this process has compiled what the other one loads."""
    here: dict[str, Any] = {}
    exec(_BITS, here)
    code = [sys.executable, "-c", f"{_BITS}print(digest)"]
    there = subprocess.run(code, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": ROOT})
    assert there.stdout.split() == [here["digest"]]


@pytest.mark.parametrize("delay", [pytest.param(0.0, marks=pytest.mark.slow), 0.3])
def test_a_run_in_the_workspaces_of_another_model_has_the_bits_of_one_in_new_workspaces(delay: float) -> None:
    def run(system: epp.LureSystem) -> epp.Trajectory:
        return epp.simulate(system, t_end=5.0, t_eval=np.linspace(0.0, 5.0, 51))

    def alone(system: epp.LureSystem) -> epp.Trajectory:
        """In a thread of its own, which has kept no rooms."""
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(run, system).result()

    compared = 0
    for seed in range(60):
        system = random_loop(seed)
        if delay and any(a.smooth for a in (e.automaton() for e in system.elements)):
            continue
        if delay:
            system = replace(system, delays=np.full(len(system.delays), delay))
        try:
            expected = alone(system)
        except EppError:
            continue
        run(replace(system, B=1.7 * system.B))
        found = run(system)
        compared += 1
        assert found.events == expected.events and found.status is expected.status
        for name, values in expected.signals.items():
            np.testing.assert_array_equal(found.signals[name], values)
    assert compared > 20


def test_a_run_after_one_that_has_overflown_begins_with_clean_workspaces() -> None:
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.2]], [[0.0], [1.0]], [[0.0, 1.0]], [epp.Cube(1.0)], x0=[0.2, 0.0]
    )
    assert epp.simulate(replace(loop, x0=np.array([2.0, 0.0])), t_end=200.0).status is Status.DIVERGED
    after = epp.simulate(loop, t_end=200.0)
    assert after.status is Status.SETTLED and after.t[-1] == 200.0


@pytest.mark.parametrize("level", [0.1, 1.0])
def test_the_end_of_a_long_run_does_not_decide_its_verdict(level: float) -> None:
    """A run that has closed is carried over its periods; behind them it goes on from the very state that it had."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 3.0, 1.0]), epp.Relay(-level, level), x0=[1.0, 1.0, 1.0])
    for t_end in np.linspace(50.0, 2000.0, 60).tolist():
        run = epp.simulate(loop, t_end=t_end, t_eval=np.linspace(0.0, t_end, 301))
        assert run.status is Status.LIMIT_CYCLE
        assert np.all(np.diff([e.time for e in run.events]) > 0.1)


def test_of_a_run_that_has_closed_only_events_that_are_computed_count() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay(), x0=[1.0, 1.0, 1.0])
    times = np.linspace(0.0, 1000.0, 1001)
    few, many = (epp.simulate(loop, t_end=1000.0, t_eval=times, max_events=n) for n in (120, 200_000))
    assert few.status is Status.LIMIT_CYCLE and few.n_events == many.n_events > 400
    # Its transient is found where what is repeated has taken its place among the events that are kept.
    long = epp.simulate(loop, t_end=1e5)
    assert long.n_events > 40_000 and long.settled_since == pytest.approx(many.settled_since, abs=5.0)
    np.testing.assert_array_equal(few.signals["x"], many.signals["x"])


def test_many_switches_are_not_said_to_accumulate() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay(), x0=[1.0, 1.0, 1.0])
    times = np.linspace(0.0, 1000.0, 1001)
    run = epp.simulate(loop, t_end=1000.0, t_eval=times, max_events=8)
    assert run.status is Status.EVENT_LIMIT and len(run.events) == 8
    assert run.t[-1] <= run.provenance.statistics["time_reached"] < run.t[-1] + 1.0
    assert "accumulate" not in str(run) and "max_events" in str(run)


def test_a_converter_of_many_switches_is_seen_on_its_cycle() -> None:
    """A buck converter under a relay with hysteresis on the voltage behind a resistance in series with its capacitor.

    Where the inductor's current is a triangle, ripple and hysteresis give the period: d(1 - d) V T/L ESR = 2 h. Its
    slow decay over many turns does not come to rest within rounding, so the run is not carried on to its end.
    """
    L, C, R, esr, volts, h = 20e-6, 100e-6, 2.0, 0.2, 12.0, 0.02
    loop = epp.LureSystem.build(
        [[0.0, -1.0 / L], [1.0 / C, -1.0 / (R * C)]], [[1.0 / L], [0.0]], [[-esr, esr / R - 1.0]],
        [epp.HysteresisRelay(-h, h, 0.0, volts)], constant_input=[5.0], x0=[0.0, 0.0],
    )  # fmt: skip
    run = epp.simulate(loop, max_events=20_000)
    assert run.status is Status.LIMIT_CYCLE and run.note in str(run) and "max_events" in run.note
    duty = run.limit_cycle.mean["hysteresis_relay_output"] / volts
    assert run.limit_cycle.period == pytest.approx(2.0 * h * L / (duty * (1.0 - duty) * volts * esr), rel=2e-2)


@pytest.mark.parametrize("name", ["fig8a_original", "relay_deadzone"])
@pytest.mark.parametrize("periods", [3.3, 4.0, 5.0])
def test_a_run_that_leaves_an_unstable_cycle_from_rounding_is_on_no_cycle(name: str, periods: float) -> None:
    case = epp.case(name)
    system, final = case.to_system(), case.operating_point
    (cycle,) = cycles_of(name).unstable
    rest = {
        n: epp.inputs.Constant(final.inputs[n] - float(v)) for n, v in zip(system.input_names, system.v0, strict=True)
    }
    run = epp.simulate(replace(system, x0=cycle.state, memory=cycle.memory), rest, t_end=periods * cycle.period)
    assert run.status is Status.UNDECIDED


def test_error_estimate_counts_a_state_that_creeps_back() -> None:
    """Beside a fast cycle, a state of a million seconds changes by next to nothing in one period."""
    fast = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    A, B, C = np.zeros((4, 4)), np.vstack([fast.B, [[1.0]]]), np.hstack([fast.C, [[0.0]]])
    A[:3, :3], A[3, 3] = fast.A, -1e-6
    slow = epp.LureSystem.build(A, B, C, [epp.Relay()], x0=[0.2, 0.1, 0.05, 0.0])
    (predicted,) = epp.predict_limit_cycles(slow)
    cycle = epp.exact_orbit(slow, predicted)
    assert cycle.status.ok
    away = cycle.state + np.array([0.0, 0.0, 0.0, 1e-4])
    found = epp.simulate(replace(slow, x0=away), t_end=120.0).limit_cycle
    size = cycle.peak_to_peak["relay_output"] / 2.0 * cycle.period / 2.0
    assert found.error_estimate > 0.5 * 1e-4 / size


@pytest.mark.parametrize("t_end", [1000.0, 3000.0, 10000.0])
def test_ever_longer_intervals_are_no_period(t_end: float) -> None:
    """Play behind an integrator creeps from side to side ever more slowly."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Play(2.0), x0=[0.0, 3.0])
    assert epp.simulate(loop, t_end=t_end).status is Status.UNDECIDED


def test_a_motion_without_events_is_measured_on_its_way() -> None:
    """The states that begin and end at zero have moved in between."""
    loop = epp.LureSystem.from_tf(([6.0], np.poly([-0.5, -2.0, -3.0])), epp.Saturation(), x0=[0.0, 0.0, 0.01])
    run = epp.simulate(loop, t_end=100.0)
    assert not run.events and run.status is Status.SETTLED


@pytest.mark.parametrize("t_end", [100.0, 200.0, 300.0])
def test_a_damped_smooth_motion_settles_however_small_it_has_become(t_end: float) -> None:
    A, B, push = [[0.0, 1.0], [0.0, -0.5]], [[0.0], [-1.0]], [0.0, 0.2]
    loop = epp.LureSystem.build(A, B, [[1.0, 0.0]], [epp.Sine(1.0)], constant_state=push, x0=[0.5, 0.0])
    run = epp.simulate(loop, t_end=t_end)
    assert run.status is Status.SETTLED
    assert run.settled_at["sine_input"] == pytest.approx(math.asin(0.2), abs=1e-9)


@pytest.mark.parametrize("name", ["max_events", "max_steps"])
def test_a_limit_that_lets_nothing_happen_is_refused(name: str) -> None:
    with pytest.raises(EppError, match=f"simulate: {name} is 0; expected 1 or more"):
        epp.simulate(epp.case("backlash_servo"), **{name: 0})


@pytest.mark.parametrize("step", [-0.01, 0.0, math.nan, math.inf])
def test_step_must_be_positive(step: float) -> None:
    with pytest.raises(EppError, match=f"step is {step}; expected a positive number of seconds"):
        epp.simulate(epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Relay()), step=step)


def test_events_are_counted_beyond_those_that_are_kept() -> None:
    """Two switches in each of 35,000 periods."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    run = epp.simulate(loop, t_end=160_000.0, t_eval=[0.0, 1.0])
    assert len(run.events) == 20_000
    assert run.n_events == run.to_dict()["n_events"]
    assert run.n_events == pytest.approx(2 * 160_000.0 / run.limit_cycle.period, abs=10)


@pytest.mark.parametrize("size", [1e12, 1e15, 1e18])
def test_a_start_beyond_all_proportion_is_answered(size: float) -> None:
    """Bounds on a guard's curvature overflow there: a status, and no division by zero in compiled code."""
    case = epp.case("belt_leine").with_values({"loop.initial_state": [size, 0.0]})
    assert epp.simulate(case.to_system(), case.input, 1.0).status is not Status.LIMIT_CYCLE


# Bounded work -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("slice_", [1.0, 40.0])
@pytest.mark.parametrize("case_name", ["fig8a_original", "two_mass_deadzone", "upright", "relay_fopdt_closed"])
def test_a_run_that_pauses_is_the_same_to_the_last_bit(case_name, slice_, monkeypatch):
    case = epp.case(case_name)
    system = case.to_system()
    whole = epp.simulate(system, case.input, t_end=3.0)
    monkeypatch.setattr("eppanalysis.engine.workspace.SLICE", slice_)
    with ThreadPoolExecutor(1) as pool:  # in a thread of its own, which has kept no rooms
        paused = pool.submit(epp.simulate, system, case.input, t_end=3.0).result()
    assert paused.events == whole.events and paused.status is whole.status
    for name, values in whole.signals.items():
        np.testing.assert_array_equal(paused.signals[name], values)
    assert paused.provenance.statistics == whole.provenance.statistics


@pytest.mark.parametrize(
    ("system", "settings"),
    [
        (epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay()), {"step": 1e-300}),
        (epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay()), {"step": 1e-12}),
        # A spring that oscillates 1e9 times per second.
        (epp.LureSystem.build([[0, 1], [-1e18, 0]], [[0], [1]], [[-1, 0]], [epp.Sine(1.0)], x0=[1.0, 0.0]), {}),
    ],
)
def test_steps_are_bounded_and_the_end_says_so(system, settings):
    begin = time.process_time()
    run = epp.simulate(system, t_end=10.0, t_eval=[0.0, 10.0], max_steps=100_000, **settings)
    assert time.process_time() - begin < 5.0
    assert run.status is Status.EVENT_LIMIT and "steps" in run.to_dict()["message"]
    assert run.provenance.statistics["time_reached"] < 1.0


@pytest.mark.slow
def test_a_compiled_loop_hears_an_interrupt():
    code = (
        "import eppanalysis as epp\n"
        "loop = epp.LureSystem.build([[0, 1], [-1e18, 0]], [[0], [1]], [[-1, 0]], [epp.Sine(1.0)], x0=[1.0, 0.0])\n"
        "epp.simulate(loop, t_end=1e-9)\n"
        "print('ready', flush=True)\n"
        "try:\n    epp.simulate(loop, t_end=10.0, max_steps=10**12)\n"
        "except KeyboardInterrupt:\n    print('heard', flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        begin = time.perf_counter()
        assert process.stdout.readline() == "heard\n"
        # On an idle machine some 0.1 s.
        assert time.perf_counter() - begin < 3.0
        process.wait(10.0)


@pytest.mark.parametrize("gain", [epp.PiecewiseLinear([], [1.0], [0.0]), epp.Saturation(-1e9, 1e9)])
@pytest.mark.parametrize("before", [True, False])
def test_a_gain_that_is_an_element_changes_no_verdict(gain, before) -> None:
    """What has no levels hands on what it sees: its motion is not rest because no level is near."""
    limit, plant = epp.Saturation(-1.0, 1.0), ([12.0], [1.0, 3.0, 3.0, 1.0])
    alone = epp.LureSystem.from_blocks([limit, plant])
    both = epp.LureSystem.from_blocks([limit, plant, gain] if before else [limit, gain, plant])
    one, two = (epp.simulate(replace(loop, x0=np.full(3, 0.3)), t_end=60.0) for loop in (alone, both))
    assert one.status is two.status is epp.Status.LIMIT_CYCLE
    assert two.limit_cycle.frequency == pytest.approx(one.limit_cycle.frequency, rel=1e-9)
    assert len(epp.find_limit_cycles(both).cycles) == len(epp.find_limit_cycles(alone).cycles) == 1


def test_a_smooth_loop_with_dead_time_is_on_its_cycle_however_long_it_runs():
    """Its events are the turns of its one state, where rates are nothing but rounding."""
    loop = epp.LureSystem.from_tf(([3.0], [1.0, 1.0]), epp.Tanh(level=1.0), delay=1.0)
    periods = []
    for t_end in (50.0, 200.0, 400.0):
        run = epp.simulate(loop, t_end=t_end)
        assert run.status is Status.LIMIT_CYCLE and run.limit_cycle is not None
        periods.append(run.limit_cycle.period)
    np.testing.assert_allclose(periods, periods[0], rtol=1e-9)
    x, t = run.signals["x"][3000:], run.t[3000:]
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    through = t[up] - x[up] * (t[up + 1] - t[up]) / (x[up + 1] - x[up])
    assert float(np.diff(through).mean()) == pytest.approx(periods[0], rel=1e-4)


def test_what_a_limit_has_put_out_before_the_start_is_within_the_limit():
    """A dead time hands on what its element has put out for ever, with the input that was there."""
    held = epp.LureSystem.build(
        [[0.0]], [[1.0]], [[-1.0]], [epp.Saturation()], D_input=[[1.0]], input_names=["r"], v0=[5.0], delays=[0.4]
    )
    run = epp.simulate(held, t_end=0.4, t_eval=[0.0, 0.2, 0.4])
    np.testing.assert_allclose(run.signals["saturation_input"], [5.0, 4.8, 4.6], rtol=1e-12)


@pytest.mark.parametrize(
    ("element", "memory", "handed_on"),
    [
        (epp.Saturation(), None, 1.0),
        (epp.HysteresisRelay(-1.0, 1.0), None, 1.0),
        (epp.HysteresisRelay(-1.0, 1.0), -1.0, 1.0),
        (epp.Play(gap=1.0), None, 2.5),
        (epp.Play(gap=1.0), 3.2, 3.2),
    ],
)
def test_a_dead_time_hands_on_what_was_put_out_before_a_step_at_once(element, memory, handed_on):
    """The dead time of x' = -x + w(t - 0.5) hands on what the element makes of an input held at 3 until the start."""
    stepped = epp.LureSystem.build(
        [[-1.0]], [[1.0]], [[-0.1]], [element], D_input=[[1.0]], input_names=["r"], v0=[3.0], delays=[0.5],
        memory=[memory],
    )  # fmt: skip
    times = np.array([0.0, 0.2, 0.5])
    run = epp.simulate(stepped, {"r": epp.inputs.Step(-3.0)}, t_end=0.5, t_eval=times)
    seen = run.signals[f"{element.kind}_input"]
    np.testing.assert_allclose(seen, 0.1 * handed_on * np.expm1(-times), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("damping", [1.0, 3.0])
def test_a_run_of_ever_smaller_swings_says_so(damping):
    """A relay on a damped double integrator: by the engine's end of events its swings are nothing beside its start."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, damping, 0.0]), epp.Relay())
    run = epp.simulate(loop, t_end=200.0)
    assert run.status is Status.EVENT_LIMIT
    share = float(re.search(r"in swings of (\S+) of the whole motion", str(run)).group(1))
    assert 0.0 < share < 1e-4 and "give it" not in str(run)


def test_events_are_named_where_several_elements_have_very_many_switches():
    """A scale has a hundred thousand steps either way; what happened is looked up among those that did."""
    loop = epp.Diagram(
        parts={
            "scale": epp.Quantiser(1e-3, 100_000),
            "count": epp.Quantiser(1e-3, 100_000),
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
        },
        connect=["-count -> plant", "plant -> scale", "scale -> count"],
    ).to_system()
    run = epp.simulate(replace(loop, x0=[0.01]), t_end=3.0)
    assert run.n_events > 5 and {event.element for event in run.events} == {"scale", "count"}
