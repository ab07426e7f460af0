"""Modes in rationals against the engine's own tables in floats, and which rational a float stands for."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.methods.certificates.orbits.modes import ExactModes, NotCovered, fraction_of, in_span, rational
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.orbits.shooting import orbits_near

flint = pytest.importorskip("flint")


def floats(matrix) -> np.ndarray:
    return np.array([[int(v.p) / int(v.q) for v in row] for row in matrix.tolist()])


@given(top=st.integers(1, 999), bottom=st.integers(1, 999), power=st.integers(-6, 6))
def test_quotients_of_short_decimals_come_back(top: int, bottom: int, power: int) -> None:
    exact = Fraction(top, bottom) * Fraction(10) ** power
    assert fraction_of(float(Fraction(top) * Fraction(10) ** power) / bottom) == exact


@given(value=st.floats(1e-300, 1e300))
def test_a_fraction_is_next_to_its_float(value: float) -> None:
    found = fraction_of(value)
    assert abs(found / Fraction(value) - 1) < Fraction(1, 2**49)
    assert rational(-value) == -rational(value)


def test_short_decimals_are_themselves_and_infinity_is_refused() -> None:
    assert fraction_of(0.1) == Fraction(1, 10)
    assert fraction_of(12345678.901234) == Fraction("12345678.901234")
    assert rational(-2.5e-3) == flint.fmpq(-1, 400)
    with pytest.raises(NotCovered, match="inf"):
        rational(float("inf"))


@pytest.mark.parametrize("name", ["backlash_servo", "relay_deadzone", "two_mass_damped_shaft_classical", "pid_hunting"])
def test_arcs_are_those_of_the_engine(name: str) -> None:
    """Rates, guards and maps of events of an orbit, computed twice: compiled in floats, and in rationals."""
    case = epp.case(name)
    cycle = epp.simulate(case, t_end=2.0 * case.t_end).limit_cycle
    assert cycle is not None
    hybrid = steady_hybrid(case.to_system(), case.operating_point)
    orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period))
    exact, sequence = ExactModes(hybrid), orbit.arcs.event_sequence
    for a, guard in enumerate(sequence.guards.tolist()):
        mode = exact.mode(sequence.modes[a])
        after = sequence.modes[(a + 1) % len(sequence.modes)]
        J = exact.event(mode, guard, int(after[hybrid.model.guard_element[guard]]))
        for mine, theirs in (
            (mode.rate, orbit.arcs.F[a]),
            (dict(mode.guards)[guard], orbit.arcs.g[a][None]),
            (J, orbit.arcs.J[a]),
        ):
            np.testing.assert_allclose(floats(mine), theirs, rtol=1e-13, atol=1e-13 * np.abs(theirs).max())


def test_what_sticks_has_a_rate_of_zero_exactly() -> None:
    """Friction at rest: the row of its input on the rates is zero in rationals, not to rounding."""
    case = epp.case("fig8a_original")
    hybrid = steady_hybrid(case.to_system(), case.operating_point)
    exact = ExactModes(hybrid)
    stuck = exact.mode([1, 2, 0, 0])
    assert list(stuck.levels) == [3]
    speed = flint.fmpq_mat([stuck.levels[3].tolist()[0][: exact.n]])
    assert all(v == 0 for v in (speed * stuck.rate).tolist()[0])


def test_combinations_of_rows_are_told_exactly() -> None:
    row, other = flint.fmpq_mat([[1, 2, 3]]), flint.fmpq_mat([[0, 1, 1]])
    assert in_span(row * 2 - other * flint.fmpq(1, 3), [row, other])
    assert not in_span(flint.fmpq_mat([[flint.fmpq(1, 10**30), 0, 0]]), [row, other])
    assert in_span(flint.fmpq_mat([[0, 0, 0]]), [])
