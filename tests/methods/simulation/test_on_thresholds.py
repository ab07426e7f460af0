"""Inputs that a sample or a step leaves exactly on a threshold: the element has the output that its map has there."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp


def _levels(x: Fraction, threshold: int) -> Fraction:
    """3, 0 or -3, and half of it at a threshold."""
    return Fraction(3, 2) * ((x > threshold) + (x >= threshold) - (x < -threshold) - (x <= -threshold))


#: Elements, with their maps in exact numbers.
MAPS: dict[str, tuple[epp.Nonlinearity, Callable[[Fraction], Fraction]]] = {
    "quantiser": (epp.Quantiser(1.0, 1000), lambda x: (1 if x > 0 else -1) * Fraction((abs(2 * x) + 1) // 2)),
    "floor quantiser": (epp.FloorQuantiser(1.0, 1000), lambda x: Fraction(x // 1)),
    "mid-rise quantiser": (epp.MidRiseQuantiser(1.0, 1000), lambda x: x // 1 + Fraction(1, 2)),
    "comparator": (epp.Comparator(-3.0, 3.0), lambda x: Fraction(3 if x >= 0 else -3)),
    "relay": (epp.Relay(-3.0, 3.0), lambda x: Fraction(3 * ((x > 0) - (x < 0)))),
    "relay with dead zone": (epp.RelayDeadZone(2.0, 3.0), lambda x: _levels(x, 2)),
    "preload": (epp.Preload(1.0, 0.5), lambda x: x / 2 + (x > 0) - (x < 0)),
    "friction": (epp.Friction(2.0), lambda x: Fraction(2 * ((x > 0) - (x < 0)))),
}  # fmt: skip
eighths = st.integers(-8, 8).map(lambda k: Fraction(k, 8))


@pytest.mark.parametrize("name", MAPS)
@settings(max_examples=25)
@given(a=st.tuples(eighths, eighths), x0=st.tuples(st.integers(-9, 9), st.integers(-9, 9)))
def test_a_recursion_of_eighths_is_that_of_exact_numbers(
    name: str, a: tuple[Fraction, Fraction], x0: tuple[int, int]
) -> None:
    """w[n] = f(a1 w[n-1] + a2 w[n-2]): its inputs meet the thresholds again and again."""
    element, exact = MAPS[name]
    x, expected = [Fraction(v) for v in x0], []
    for _ in range(10):
        expected.append(a[0] * x[0] + a[1] * x[1])
        x = [exact(expected[-1]), x[0]]
    rows = [[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [list(map(float, a))]
    loop = epp.LureSystem.build(*rows, [element], x0=list(map(float, x0)), time_step=1.0)
    run = epp.simulate(loop, t_end=9.0)
    signal = next(values for name, values in run.signals.items() if name.endswith("_input"))
    np.testing.assert_allclose(signal, list(map(float, expected)), rtol=1e-12, atol=1e-12)


def test_rounding_to_even_multiples_of_a_half_has_the_dead_band_of_the_literature() -> None:
    """y[n] = round(a y[n-1]): it rests at every whole number up to 0.5/(1 - |a|) (Jackson, 1969)."""
    for a in (0.5, 0.75, -0.875):
        widest = int(0.5 / (1.0 - abs(a)))
        for begin in range(widest + 3):
            loop = epp.LureSystem.build(
                [[0.0]], [[1.0]], [[a]], [epp.Quantiser(1.0, 50)], x0=[float(begin)], time_step=1.0
            )
            run = epp.simulate(loop, t_end=60.0)
            end = abs(run.signals["quantiser_input"][-1]) / abs(a)
            assert end == pytest.approx(min(begin, widest), abs=1e-12)


def test_search_lists_every_cycle_of_a_filter_in_whole_numbers() -> None:
    """y[n] = round(0.8125 y[n-1] - 0.9375 y[n-2]): all recursions from whole numbers up to eight, by counting."""
    a, seen = (Fraction(13, 16), Fraction(-15, 16)), set()
    exact = MAPS["quantiser"][1]
    for x in ((p, q) for p in range(-8, 9) for q in range(-8, 9)):
        way: list[tuple[Fraction, Fraction]] = []
        here = (Fraction(x[0]), Fraction(x[1]))
        while here not in way:
            way.append(here)
            here = (exact(a[0] * here[0] + a[1] * here[1]), here[0])
        seen.add(frozenset(way[way.index(here) :]))
    sizes = sorted((len(c), float(max(v[0] for v in c) - min(v[0] for v in c))) for c in seen if len(c) > 1)
    rows = [[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[0.8125, -0.9375]]
    loop = epp.LureSystem.build(*rows, [epp.Quantiser(1.0, 200)], x0=[5.0, 3.0], time_step=1.0)
    found = epp.find_limit_cycles(loop)
    assert found.status is epp.Status.CONVERGED and all(cycle.stable for cycle in found.cycles)
    assert len(found.cycles) == len(sizes) == 5
    assert [round(cycle.period) for cycle in found.cycles] == [length for length, _ in sizes]


def test_a_step_that_ends_on_a_threshold_gives_the_output_at_it() -> None:
    for element, at in ((epp.Comparator(0.0, 1.0, 2.0), 1.0), (epp.Relay(0.0, 1.0, 2.0), 0.5)):
        loop = epp.LureSystem.build(
            [[-1.0]], [[1.0]], [[0.0]], [element], D_input=[[1.0]], B_input=[[0.0]], input_names=("u",), x0=[0.0]
        )
        run = epp.simulate(loop, epp.inputs.Step(2.0, time=1.0), t_end=30.0)
        name = next(name for name in run.signals if name.endswith("_output"))
        assert run.signals[name][-1] == at, type(element)
