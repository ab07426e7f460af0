"""Monotone cubics through a table: the curve, its describing function, its bounds, runs, and what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier


@st.composite
def tables(draw: st.DrawFn) -> epp.MonotoneTable:
    widths = draw(st.lists(st.floats(0.05, 3), min_size=1, max_size=6))
    x = draw(st.floats(-3, 3)) + np.concatenate([[0.0], np.cumsum(widths)])
    y = draw(st.lists(st.floats(-3, 3), min_size=x.size, max_size=x.size))
    return epp.MonotoneTable(x, y, draw(st.sampled_from(["line", "hold"])))


@given(tables())
@example(epp.MonotoneTable([0.0, 0.05, 1.55, 3.55, 6.55], [1.0, 0.0, 0.0, 0.0, 0.0]))
def test_the_curve_is_that_of_scipy_and_has_no_overshoot(table: epp.MonotoneTable) -> None:
    x = np.linspace(table.inputs[0], table.inputs[-1], 301)
    y, _ = table.output(x)
    size = np.abs(table.outputs).max()
    np.testing.assert_allclose(y, PchipInterpolator(table.inputs, table.outputs)(x), atol=1e-10 * size)
    k = np.clip(np.searchsorted(table.inputs, x, side="right"), 1, table.inputs.size - 1)
    low, high = np.sort([table.outputs[k - 1], table.outputs[k]], axis=0)
    assert np.all(y >= low - 1e-10 * size) and np.all(y <= high + 1e-10 * size)
    slope = PchipInterpolator(table.inputs, table.outputs).derivative()(table.inputs[-1])
    expected = table.outputs[-1] + (2.0 * slope if table.beyond == "line" else 0.0)
    assert float(table.output(table.inputs[-1] + 2.0)[0]) == pytest.approx(expected, abs=1e-9 * (1 + abs(slope)))


@given(tables(), st.floats(1e-3, 20), st.floats(-3, 3))
def test_describing_functions_match_quadrature(table: epp.MonotoneTable, amplitude: float, bias: float) -> None:
    witness = fourier(table, amplitude, bias, crossings(table.inputs, amplitude, bias))
    far = np.abs(np.diff(table.outputs) / np.diff(table.inputs)).max() * (amplitude + abs(bias) + 10.0)
    size = float(np.abs(table.outputs).max() + far)
    assert_agrees(table.describing_function(amplitude, bias), witness, amplitude, rounding=1e-12 * size)


@given(tables(), st.floats(-6, 6))
def test_without_amplitude_it_is_the_curve_and_its_slope(table: epp.MonotoneTable, bias: float) -> None:
    mean, gain = table.describing_function(0.0, bias)
    near, small = table.describing_function(1e-9, bias)
    assert float(mean) == pytest.approx(float(table.output(bias)[0]), rel=1e-12, abs=1e-12)
    assert float(near) == pytest.approx(float(mean), rel=1e-6, abs=1e-6)
    if np.abs(table.inputs - bias).min() > 1e-6:
        assert complex(small) == pytest.approx(complex(gain), rel=1e-6, abs=1e-6)


@given(tables())
def test_slopes_and_sector_hold_everywhere_and_are_reached(table: epp.MonotoneTable) -> None:
    x = np.linspace(table.inputs[0] - 1.0, table.inputs[-1] + 1.0, 4001)
    y, _ = table.output(x)
    slopes, (low, high) = np.diff(y) / np.diff(x), table.slope_bounds()
    spread = 1e-2 * max(np.ptp([low, high]), 1e-6)
    assert low - spread <= slopes.min() <= low + 40 * spread and high - 40 * spread <= slopes.max() <= high + spread
    least, most = table.sector()
    away = np.abs(x) > 1e-3
    ratios = y[away] / x[away]
    assert np.all(ratios >= least - 1e-6 * (1 + abs(least))) and np.all(ratios <= most + 1e-6 * (1 + abs(most)))


def test_the_sector_of_a_curve_through_the_origin_is_finite() -> None:
    table = epp.MonotoneTable([-2.0, -1.0, 0.0, 1.0, 2.0], [-1.2, -1.0, 0.0, 1.0, 1.2], "hold")
    x = np.linspace(1e-6, 50.0, 200_001)
    ratios = table.output(x)[0] / x
    assert table.sector() == pytest.approx((0.0, ratios.max()), abs=1e-6)


def test_a_run_agrees_with_an_independent_integrator() -> None:
    table = epp.MonotoneTable([-2.0, -1.0, 0.0, 0.5, 2.0], [-2.5, -0.4, 0.0, 0.3, 1.0], "hold")
    loop = epp.LureSystem.from_tf(([6.0], [1.0, 2.0, 1.0, 0.0]), table, x0=[0.3, -0.2, 0.5])
    run = epp.simulate(loop, t_end=8.0)
    curve = PchipInterpolator(table.inputs, table.outputs)

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        y = curve(np.clip(float((loop.C @ x)[0]), -2.0, 2.0))
        return loop.A @ x + loop.B[:, 0] * y

    known = solve_ivp(rates, (0.0, 8.0), [0.3, -0.2, 0.5], method="DOP853", rtol=1e-11, atol=1e-12, max_step=0.02)
    assert run.t[-1] == known.t[-1]
    assert run.signals["x"][-1] == pytest.approx(float((loop.C @ known.y[:, -1])[0]), abs=1e-7)


@pytest.mark.slow
def test_first_order_balance_and_orbit_of_a_loop_with_it_agree() -> None:
    table = epp.MonotoneTable([-2.0, -1.0, 0.0, 1.0, 2.0], [-1.2, -1.0, 0.0, 1.0, 1.2], "hold")
    loop = epp.LureSystem.from_tf(([4.0], [1.0, 2.0, 1.0, 0.0]), table)
    (predicted,) = epp.predict_limit_cycles(loop)
    (exact,) = epp.find_limit_cycles(loop)
    balanced = epp.harmonic_balance(loop, predicted, order=15)
    assert balanced.period == pytest.approx(exact.period, rel=1e-6)
    assert balanced.peak_to_peak["x"] == pytest.approx(exact.peak_to_peak["x"], rel=1e-5)
    assert predicted.period == pytest.approx(exact.period, rel=0.05)


def test_it_comes_from_a_case_file_and_goes_through_a_pickle(tmp_path: Path) -> None:
    (tmp_path / "valve.csv").write_text("inputs,outputs\n0,0\n0.2,0\n1.0,5\n")
    table = epp.MonotoneTable.from_csv(tmp_path / "valve.csv", "hold")
    assert table == epp.MonotoneTable([0.0, 0.2, 1.0], [0.0, 0.0, 5.0], "hold") and hash(table) == hash(table)
    assert (
        pickle.loads(pickle.dumps(table)) == table and eval(repr(table), {"MonotoneTable": epp.MonotoneTable}) == table
    )
    text = """
kind = "loop"
title = "Valve"
[loop]
num = [1.0]
den = [1, 2, 1, 0]
[[loop.elements]]
element = "monotone_table"
name = "valve"
file = "valve.csv"
beyond = "hold"
[run]
t_end = "10 s"
"""
    (tmp_path / "valve.toml").write_text(text)
    assert epp.read_case(tmp_path / "valve.toml").to_system().elements[0] == table


@pytest.mark.parametrize(
    ("inputs", "outputs"), [([0.0], [1.0]), ([0.0, 0.0], [1.0, 2.0]), ([0.0, 1.0], [1.0, np.nan]), ([0.0, 1.0], [1.0])]
)
def test_what_is_no_table_is_refused(inputs: list[float], outputs: list[float]) -> None:
    with pytest.raises(ModelError, match="MonotoneTable"):
        epp.MonotoneTable(inputs, outputs)
