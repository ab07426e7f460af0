"""Modes in rationals against the engine's own tables in floats."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.certificates.orbits.modes import ExactModes, in_span
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.orbits.shooting import orbits_near

flint = pytest.importorskip("flint")


def floats(matrix) -> np.ndarray:
    return np.array([[int(v.p) / int(v.q) for v in row] for row in matrix.tolist()])


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
