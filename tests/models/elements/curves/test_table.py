"""Tables: the curve through points, its describing function against quadrature, files and what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from tests.models.elements.quadrature import assert_agrees, crossings, fourier


@st.composite
def tables(draw: st.DrawFn) -> epp.LookupTable:
    widths = draw(st.lists(st.floats(0.01, 3), min_size=1, max_size=6))
    x = draw(st.floats(-3, 3)) + np.concatenate([[0.0], np.cumsum(widths)])
    if x.size > 2 and draw(st.booleans()):
        x = np.sort(np.append(x, x[1]))
    y = draw(st.lists(st.floats(-3, 3), min_size=x.size, max_size=x.size))
    return epp.LookupTable(x, y, draw(st.sampled_from(["line", "hold"])))


@given(tables(), st.floats(1e-3, 20), st.floats(-3, 3))
def test_tables_match_quadrature(table: epp.LookupTable, amplitude: float, bias: float) -> None:
    witness = fourier(table, amplitude, bias, crossings(table.breakpoints, amplitude, bias))
    size = np.abs(table.slopes).max() * (amplitude + abs(bias)) + np.abs(table.intercepts).max()
    assert_agrees(table.describing_function(amplitude, bias), witness, amplitude, rounding=1e-14 * float(size))


@given(tables())
def test_the_curve_is_that_of_numpy(table: epp.LookupTable) -> None:
    x = np.linspace(table.inputs[0], table.inputs[-1], 301)
    x = x[~np.isin(x, table.inputs)]
    np.testing.assert_allclose(table.output(x)[0], np.interp(x, table.inputs, table.outputs), atol=1e-9)
    past = table.inputs[-1] + 1.0
    slope = (table.outputs[-1] - table.outputs[-2]) / (table.inputs[-1] - table.inputs[-2])
    expected = table.outputs[-1] + (slope if table.beyond == "line" else 0.0)
    assert float(table.output(past)[0]) == pytest.approx(expected, abs=1e-9 * (1 + abs(slope)))


@given(st.lists(st.floats(0.01, 3), min_size=2, max_size=6), st.integers(0, 5), st.randoms(use_true_random=False))
def test_a_table_through_the_origin_has_the_sector_and_the_slopes_of_its_lines(widths, zero, random) -> None:
    x = np.concatenate([[0.0], np.cumsum(widths)])
    x -= x[zero := min(zero, len(x) - 1)]
    y = np.array([0.0 if i == zero else random.uniform(-3.0, 3.0) for i in range(len(x))])
    table, slopes = epp.LookupTable(x, y, "hold"), np.diff(y) / np.diff(x)
    least, greatest = table.slope_bounds()
    assert (least, greatest) == pytest.approx((min(slopes.min(), 0.0), max(slopes.max(), 0.0)), rel=1e-12)
    # Along a line y/x goes one way: it is extreme at the points and beside the origin.
    beside = slopes[[i for i in (zero - 1, zero) if 0 <= i < len(slopes)]]
    held = [0.0] if zero in (0, len(x) - 1) else []
    ratios = np.concatenate([np.delete(y, zero) / np.delete(x, zero), beside, held, [0.0]])
    assert table.sector() == pytest.approx((ratios.min(), ratios.max()), rel=1e-9, abs=1e-12)


def test_a_file_is_read_with_and_without_a_heading(tmp_path: Path) -> None:
    file = tmp_path / "valve.csv"
    for text in ("opening,flow\n0,0\n0.2,0\n\n1.0,5\n", "0,0,ignored\n0.2,0\n1.0,5"):
        file.write_text(text)
        table = epp.LookupTable.from_csv(file, "hold")
        assert table == epp.LookupTable([0.0, 0.2, 1.0], [0.0, 0.0, 5.0], "hold")
    file.write_text("x,y\n0,0\n1,much\n")
    with pytest.raises(ModelError, match=r"line 3 of .*valve.csv is '1,much'; expected two numbers"):
        epp.LookupTable.from_csv(file)
    with pytest.raises(ModelError, match="cannot be read"):
        epp.LookupTable.from_csv(tmp_path / "none.csv")


def test_a_table_in_a_loop_is_the_piecewise_linear_map_and_comes_back_from_a_file() -> None:
    table = epp.LookupTable([-1.0, 0.0, 2.0], [-3.0, 0.0, 1.0], "hold")
    plain = epp.PiecewiseLinear([-1.0, 0.0, 2.0], [0.0, 3.0, 0.5, 0.0], [-3.0, 0.0, 0.0, 1.0])
    times = np.linspace(0.0, 5.0, 51)
    one, other = (
        epp.simulate(epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.5]), e, x0=[3.0, 1.0]), t_end=5.0, t_eval=times)
        for e in (table, plain)
    )
    np.testing.assert_array_equal(one.signals["x"], other.signals["x"])
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.5]), table)
    again = epp.case_from_text(epp.Case.from_system(loop, name="valve").to_toml()).to_system()
    assert again.elements == (table,) and again.elements[0].beyond == "hold"  # type: ignore[attr-defined]
    assert pickle.loads(pickle.dumps(table)) == table


@pytest.mark.parametrize(
    ("inputs", "outputs", "words"),
    [
        ([1.0], [1.0], r"inputs is \[1.0\]; expected two numbers or more"),
        ([0.0, 1.0], [1.0], r"outputs has shape \(1,\); expected shape \(2,\)"),
        ([0.0, 1.0, 0.5], [1.0, 2.0, 3.0], "expected ascending numbers"),
        ([0.0, 1.0, 1.0, 1.0, 2.0], [0.0] * 5, "expected ascending numbers, two the same for a jump within"),
        ([0.0, 0.0, 1.0], [0.0, 1.0, 2.0], "expected ascending numbers, two the same for a jump within"),
        ([0.0, np.inf], [0.0, 1.0], "expected finite numbers"),
    ],
)
def test_what_is_no_table_is_refused(inputs: list[float], outputs: list[float], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        epp.LookupTable(inputs, outputs)
    with pytest.raises(ModelError, match="beyond is 'round'; expected 'line' or 'hold'|expected"):
        epp.LookupTable([0.0, 1.0], [0.0, 1.0], "round")  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="expected 'line' or 'hold'"):
        epp.LookupTable([0.0, 1.0], [0.0, 1.0], np.eye(2))  # type: ignore[arg-type]
