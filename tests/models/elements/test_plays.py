"""Plays side by side: describing function against quadrature, loops of Masing, runs against each play by itself."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier

PIEZO = epp.PrandtlIshlinskii([0.1, 0.25, 0.5], [0.4, 0.3, 0.2], 1.0)
FALLING = epp.PrandtlIshlinskii([0.4, 0.9, 1.3], [0.6, 0.3, -0.2], 0.5)


@st.composite
def sums(draw: st.DrawFn) -> epp.PrandtlIshlinskii:
    steps = draw(st.lists(st.floats(0.05, 1.0), min_size=1, max_size=4))
    weights = draw(st.lists(st.floats(-2.0, 2.0), min_size=len(steps), max_size=len(steps)))
    return epp.PrandtlIshlinskii(np.cumsum(steps), weights, draw(st.floats(-1.0, 1.0)))


@given(sums(), st.floats(0.05, 10.0), st.floats(-2.0, 2.0))
def test_mean_and_gain_match_quadrature(element: epp.PrandtlIshlinskii, a: float, b: float) -> None:
    r = element.half_widths
    assume(np.all(np.abs(a - r) > 1e-9))
    switches = crossings([*(b + a - 2 * r), *(b - a + 2 * r)], a, b)
    # From where each play stands behind a long motion about the bias.
    start = np.where(a > r, b - a + r, b)
    answer = element.describing_function(a, b)
    assert_agrees(answer, fourier(element, a, b, switches, start=start), a, rounding=1e-12)


@given(sums(), st.floats(0.1, 5.0))
def test_branches_are_the_first_one_at_twice_the_size(element: epp.PrandtlIshlinskii, peak: float) -> None:
    """Masing's rule: from a peak the output falls by twice the first loading curve at half of the way."""

    def loading(x: Any) -> Any:
        return element.straight * x + np.maximum(np.subtract.outer(x, element.half_widths), 0.0) @ element.weights

    up, memory = element.output(peak)
    way = np.linspace(0.0, 2.0 * peak, 41)
    np.testing.assert_allclose(up, loading(peak), atol=1e-13)
    np.testing.assert_allclose(element.output(peak - way, memory)[0], up - 2.0 * loading(way / 2.0), atol=1e-12)


#: Example 1 of Al Janaideh's The Prandtl-Ishlinskii Hysteresis Model (2022), with the numbers of its program.
EXAMPLE = epp.PrandtlIshlinskii([0.45, 0.9, 1.35, 1.8, 2.25, 2.7], [0.6, 0.48, 0.36, 0.24, 0.12, 0.012], 0.72)


def test_an_example_of_the_literature() -> None:
    """Its input 4 sin(2 pi t): the peak and what remains at zero, by hand; and its loop in the steps of the program."""
    r, p = np.array([0.0, *EXAMPLE.half_widths]), np.array([0.72, *EXAMPLE.weights])
    peak, memory = EXAMPLE.output(4.0)
    remains, memory = EXAMPLE.output(0.0, memory)
    assert float(peak) == pytest.approx(8.2056, abs=1e-12) and float(remains) == pytest.approx(1.8456, abs=1e-12)
    v = 4.0 * np.sin(2.0 * np.pi * np.linspace(0.0, 3.0, 3001))
    plays, memory = np.zeros(7), None
    for value in v:
        plays = np.maximum(value - r, np.minimum(value + r, plays))
        found, memory = EXAMPLE.output(float(value), memory)
        assert float(found) == pytest.approx(p @ plays, abs=1e-12)


def inverse(element: epp.PrandtlIshlinskii) -> epp.PrandtlIshlinskii:
    """Its inverse (Krejci and Kuhnen 2001): plays as well, of the widths that the outputs have where slopes change."""
    r, p = np.array([0.0, *element.half_widths]), np.array([element.straight, *element.weights])
    slopes = np.cumsum(p)
    widths = [float(p[: i + 1] @ (r[i] - r[: i + 1])) for i in range(1, r.size)]
    return epp.PrandtlIshlinskii(widths, np.diff(1.0 / slopes), 1.0 / p[0])


def test_its_inverse_in_front_of_it_leaves_a_linear_loop() -> None:
    plant = epp.blocks.TransferFunction(num=[1.5], den=[1.0, 2.0, 1.0, 0.0], start=[0.0, 0.0, 1.2])

    def loop(**between: Any) -> epp.LureSystem:
        names = [*between]
        wires = [f"{a} -> {b}" for a, b in zip(["-plant", *names], [*names, "plant"], strict=True)]
        return epp.Diagram({"plant": plant, **between}, wires).to_system()

    times = np.linspace(0.0, 20.0, 81)
    both = loop(compensator=inverse(EXAMPLE), actuator=EXAMPLE)
    plain = loop(wire=epp.PiecewiseLinear([], [1.0], [0.0]))
    runs = [epp.simulate(system, t_end=20.0, t_eval=times).signals["plant"] for system in (both, plain)]
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-9)


def servo(element: epp.Nonlinearity, gain: float = 6.0, **options: Any) -> epp.LureSystem:
    """A positioning stage of two lags with an integrating controller."""
    return epp.LureSystem.from_tf(([gain], [1.0, 3.0, 2.0, 0.0]), element, **options)


def each_play_alone(loop: epp.LureSystem, plays: Any, times: Any) -> Any:
    """Inputs of the element at times: every play follows, rests and turns back by itself, whatever the others do."""
    A, b, c, e = loop.A, loop.B[:, 0], loop.C[0], loop.elements[0]
    x, r, t, found = np.array(loop.x0), e.half_widths, 0.0, []
    h = np.clip(plays, c @ x - r, c @ x + r)
    side = np.where(h == plays, 0.0, np.sign(c @ x - plays))  # one that it finds outside its width moves at once

    def values(z: float) -> Any:
        return np.where(side == 0.0, h, z - side * r)

    def touch(i: int, way: float) -> Any:
        return lambda t, x: way * (c @ x - h[i]) - r[i]

    def rates(t: float, x: Any) -> Any:
        z = float(c @ x)
        return A @ x + b * (e.straight * z + values(z) @ e.weights)

    while t < times[-1]:
        events: list[Any] = [lambda t, x: c @ rates(t, x)]
        for i in np.flatnonzero(side == 0.0):
            events += [touch(i, 1.0), touch(i, -1.0)]
        for i, event in enumerate(events):
            event.terminal, event.direction = True, float(i > 0)
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02, "dense_output": True}
        part = solve_ivp(rates, (t, times[-1]), x, events=events, **options)
        inside = times[(times >= t) & ((times < part.t[-1]) | (part.status == 0))]
        found += (c @ part.sol(inside)).tolist() if inside.size else []
        # A trifle beyond the event, so that it is not found again.
        t = part.t[-1] + 1e-11
        z, x = float(c @ part.y[:, -1]), part.y[:, -1] + 1e-11 * rates(t, part.y[:, -1])
        h, way = values(z), np.sign(c @ rates(t, x))
        side = np.where(way * (z - h) - r > -1e-9, way, 0.0)
    return np.array(found)


@pytest.mark.parametrize("element", [PIEZO, FALLING], ids=["piezo", "a falling weight"])
def test_a_run_against_each_play_alone(element: epp.PrandtlIshlinskii) -> None:
    plays, times = [0.05, 0.15, 0.3], np.linspace(0.0, 16.0, 61)
    loop = servo(element, 3.0, x0=[0.0, 6.0, 0.7], memory=plays)
    run = epp.simulate(loop, t_end=16.0, t_eval=times)
    names = {event.name for event in run.events}
    assert {"lets go", "meets the upper side", "meets the lower side"} == names and run.n_events > 8
    np.testing.assert_allclose(run.signals["x"], each_play_alone(loop, plays, times), atol=1e-8)


def test_its_cycle_by_three_methods_starts_with_its_plays() -> None:
    loop = servo(PIEZO, 4.0)
    (predicted,) = epp.predict_limit_cycles(loop)
    balanced = epp.harmonic_balance(loop, predicted, 15)
    orbit = epp.exact_orbit(loop, balanced)
    assert predicted.period == pytest.approx(orbit.period, rel=0.01)
    assert balanced.period == pytest.approx(orbit.period, rel=1e-4)
    assert len(balanced.memory[0]) == 3
    # The series of order 15 begins at a phase that is a little off.
    np.testing.assert_allclose(balanced.memory[0], orbit.memory[0], atol=5e-3 * orbit.peak_to_peak["x"])
    # One period from the orbit's state and plays leads back to it.
    once = epp.simulate(replace(loop, x0=orbit.state, memory=orbit.memory), t_end=orbit.period)
    assert once.signals["x"][-1] == pytest.approx(once.signals["x"][0], abs=1e-8)


def test_a_fast_dither_narrows_all_plays() -> None:
    assert epp.smoothed(FALLING, 0.5) == epp.PrandtlIshlinskii([0.4, 0.8], [0.3, -0.2], 1.1)
    slope = epp.smoothed(FALLING, 1.3)
    assert isinstance(slope, epp.PiecewiseLinear) and list(slope.slopes) == pytest.approx([1.2])


def test_one_play_is_a_play() -> None:
    one, play = epp.PrandtlIshlinskii([0.35], [1.0]), epp.Play(0.7)
    a, b = np.meshgrid([0.1, 0.35, 0.4, 3.0], [0.0, -1.0])
    for mine, its in zip(one.describing_function(a, b), play.describing_function(a, b), strict=True):
        np.testing.assert_array_equal(mine, its)
    runs = [epp.simulate(servo(e, x0=[0.0, 0.0, 1.0]), t_end=5.0) for e in (one, play)]
    np.testing.assert_array_equal(runs[0].signals["x"], runs[1].signals["x"])


def test_a_case_file_keeps_fields_and_plays() -> None:
    loop = servo(PIEZO, memory=(0.1, 0.2, 0.4))
    text = epp.Case.from_system(loop).to_toml()
    again = epp.case_from_text(text).to_system()
    assert again.elements == loop.elements and again.memory == loop.memory
    for given_, other, words in (
        ("memory = [0.1, 0.2, 0.4]", "memory = [0.1, 0.9, 0.4]", r"memory is \[0.1, 0.9, 0.4\]; expected 3 outputs of"),
        ("memory = [0.1, 0.2, 0.4]", "memory = 0.1", "memory is 0.1; expected a list of numbers"),
        ("weights = [0.4, 0.3, 0.2]", "weights = [0.4, 0.3]", r"weights is \[0.4, 0.3\]; expected 3 finite numbers"),
        (
            "half_widths = [0.1, ",
            "half_widths = [0.3, ",
            r"half_widths is \[0.3, 0.25, 0.5\]; expected positive numbers",
        ),
    ):
        assert given_ in text
        with pytest.raises(EppError, match=words):
            epp.case_from_text(text.replace(given_, other)).to_system()


def test_values() -> None:
    assert pickle.loads(pickle.dumps(PIEZO)) == PIEZO and hash(PIEZO) != hash(FALLING)
    assert eval(repr(PIEZO), {"PrandtlIshlinskii": epp.PrandtlIshlinskii}) == PIEZO
    assert PIEZO.slope_bounds() == (1.0, pytest.approx(1.9)) and FALLING.slope_bounds() == (0.5, pytest.approx(1.4))
    assert PIEZO.thresholds(0.3).tolist() == [0.1, 0.25, 0.5]
    assert np.isnan(PIEZO.describing_function([np.nan, 1.0])[1]).tolist() == [True, False]
    for make, words in (
        (lambda: epp.PrandtlIshlinskii([], []), r"half_widths is \[\]; expected positive numbers that ascend"),
        (lambda: epp.PrandtlIshlinskii([0.0], [1.0]), r"half_widths is \[0.0\]"),
        (lambda: epp.PrandtlIshlinskii([1.0], [np.inf]), r"weights is \[inf\]; expected 1 finite numbers"),
        (lambda: epp.PrandtlIshlinskii([1.0], [1.0], np.nan), "straight is nan; expected a finite number"),
        (lambda: PIEZO.output(0.0, [0.0, 1.0, 0.0]), "memory is .* expected 3 outputs of its plays"),
        (lambda: epp.simulate(servo(PIEZO, memory=[[0.0, 0.0, 0.0]]), t_end=1.0), "memory is .* expected 3 outputs"),
        (lambda: PIEZO.describing_function(-1.0), "amplitude of a describing function is -1.0"),
    ):
        with pytest.raises(ModelError, match=words):
            make()
