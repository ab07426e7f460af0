"""The equations of a balance: their Jacobian against differences of what they are."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.harmonic.loop import Equations, Loop, inputs_of
from tests.shared import predicted


@pytest.mark.parametrize("name", ["fig8a_original", "backlash_servo", "sat_khalil710"])
@pytest.mark.parametrize("order", [1, 4])
def test_jacobian_equals_central_differences(name, order):
    system = epp.case(name).to_system()
    cycle = predicted(name)[-1]
    loop = Loop.of(system, np.array(system.v0, float))
    Z = loop.continued(inputs_of(loop, cycle), cycle.omega, order)
    equations = Equations(loop, order, 0, np.linspace(1.0, 0.3, order))
    X = equations.pack(Z, cycle.omega)
    here = equations.at(X)
    unknowns, rows = equations.scales(X, here.W)
    jacobian = here.jacobian * unknowns / rows[:, None]
    for i, unit in enumerate(np.eye(X.size) * 1e-6):
        up, down = (equations.at(X + sign * unit * unknowns).residual / rows for sign in (1.0, -1.0))
        np.testing.assert_allclose(jacobian[:, i], (up - down) / 2e-6, rtol=0, atol=3e-6 * np.abs(jacobian).max())
