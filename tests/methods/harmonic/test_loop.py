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


def _near_prediction(name: str, order: int) -> tuple[Equations, np.ndarray]:
    """The equations of a shipped case, and unknowns near its predicted cycle."""
    system, cycle = epp.case(name).to_system(), predicted(name)[-1]
    loop = Loop.of(system, np.array(system.v0, float))
    equations = Equations(loop, order, 0, np.linspace(1.0, 0.3, order))
    X = equations.pack(loop.continued(inputs_of(loop, cycle), cycle.omega, order), cycle.omega)
    return equations, X * (1.0 + 1e-2 * np.sin(np.arange(X.size)))


@pytest.mark.parametrize("name", ["fig8a_original", "sat_plus_backlash", "relay_hyst_servo", "quantised_sensor_ct"])
@pytest.mark.parametrize("order", [1, 7])
def test_all_elements_together_say_what_each_says_alone(name, order):
    equations, X = _near_prediction(name, order)
    linear = [m * equations.weight[:, None, None] for m in equations.loop.linear_and_slope(X[-1], order)]
    together, alone = equations.at(X), equations._in_parts(X, *linear)
    for one, other in ((together.W, alone.W), (together.jacobian, alone.jacobian)):
        np.testing.assert_array_equal(one, other)
    outputs, switches = equations.loop.outputs(*equations.unpack(X))
    np.testing.assert_array_equal(outputs, alone.W)
    assert switches == [r.phases.size for r in equations.loop.answers(*equations.unpack(X))[1]]
    size = equations.scales(X, alone.W)[1]
    np.testing.assert_allclose(together.residual / size, alone.residual / size, rtol=0, atol=1e-14)


def test_an_element_that_rests_with_the_value_it_holds_is_asked_alone():
    equations, X = _near_prediction("backlash_servo", 3)
    X[1:-1] *= 1e-3  # within the gap
    linear = equations.loop.linear_and_slope(X[-1], 3)
    assert equations.loop.at_once(X, 3, linear, 0, X.size) is None
    assert np.all(np.isfinite(equations.at(X).jacobian))
    assert equations.loop.outputs(*equations.unpack(X))[1] == [0]
