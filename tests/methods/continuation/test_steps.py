"""The derivative of an orbit's equations by the parameter, against forward mode in 40 digits, and what it moves."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.continuation import steps
from eppanalysis.methods.continuation.branch import steady_case
from eppanalysis.methods.continuation.families import Family
from eppanalysis.methods.orbits.arcs import Arcs
from eppanalysis.methods.orbits.exact import start_of
from eppanalysis.methods.orbits.shooting import orbits_near

RELAY = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))


def _forward_mode(family, value, orbit):
    """The derivative where arrays are linear in the parameter, by exponentials of twice the size (Van Loan)."""
    flint = pytest.importorskip("flint")
    here = orbit.arcs
    low, at, high = (Arcs.build(family.build(f * value), here.event_sequence, here) for f in (0.5, 1.0, 1.5))
    n, N = at.F.shape[1:]

    def pair(name, arc):
        """An array of an arc, squared up, and its derivative."""
        arrays = []
        for a in (getattr(at, name)[arc], (getattr(high, name)[arc] - getattr(low, name)[arc]) / value):
            square = np.zeros((N, N))
            square[: n if name == "F" else N] = a
            arrays.append(square)
        full, slope = arrays
        return flint.arb_mat(np.block([[full, slope], [np.zeros((N, N)), full]]).tolist())

    with flint.ctx.workdps(40):
        z, guards = flint.arb_mat([[0.0]] * N + [[v] for v in orbit.y.tolist()]), []
        for arc in range(at.n_arcs):
            tau = float(orbit.tau[arc])
            z = (pair("F", arc) * flint.arb(tau)).exp() * z
            begins_on_it = at.event_sequence.at_once[arc] == 2
            guards.append(float((pair("g", arc) * z)[0, 0]) / (tau if begins_on_it else 1.0))
            z = pair("J", arc) * z
        return np.array([float(z[int(i), 0]) for i in here.free] + guards)


def test_the_slope_is_that_of_forward_mode_in_forty_digits():
    case, name = epp.Case.from_system(RELAY, name="relay"), "loop.gain"
    family = Family(lambda v: steady_case(case.with_values({name: v})), (0.8, 1.2))
    hybrid = family.at(1.0)
    for predicted in epp.predict_limit_cycles(RELAY):
        orbit = next(iter(orbits_near(hybrid, *start_of(hybrid, predicted), predicted.period)))
        found, exact = (
            slope / orbit.row_scale for slope in (steps.slope_at(family, orbit, 1.0), _forward_mode(family, 1.0, orbit))
        )
        # Rounding over the step of 1e-6: the error that the theory page states.
        assert np.max(np.abs(found - exact)) < 5e-10 * np.max(np.abs(exact))


@pytest.mark.slow
def test_folds_do_not_feel_errors_of_the_slope(monkeypatch):
    (fold,) = epp.continue_branch(RELAY, "loop.gain", 0.7, 0.59).folds
    exact = steps.slope_at
    monkeypatch.setattr(steps, "slope_at", lambda *at: exact(*at) * (1.0 + 1e-4 * np.sin(np.arange(7.0))))
    (moved,) = epp.continue_branch(RELAY, "loop.gain", 0.7, 0.59).folds
    assert moved.value == pytest.approx(fold.value, rel=1e-11)
