"""A loop with its elements frozen at a predicted cycle meets -1/N of the one at the cut just there."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.frozen import frozen_loop, input_name, nearest_cycle, with_element_inputs
from tests.shared import predicted, said_above


@pytest.mark.parametrize("name", ["fig8a_original", "gain_brings_it_back", "backlash_servo", "sat_plus_backlash"])
def test_frozen_at_a_predicted_cycle_the_curves_meet_there(name):
    case = epp.case(name)
    system = case.to_system()
    cycles = predicted(name)
    assert len(cycles)
    for cycle in cycles:
        elements = cycle.elements
        sizes, means = ({n: e[key] for n, e in elements.items()} for key in ("amplitude", "bias"))
        found = frozen_loop(system, sizes, means, cycle.omega)
        at = found.response[np.argmin(np.abs(found.omega - cycle.omega))]
        assert at == pytest.approx(found.point, rel=1e-8)


def test_at_rest_the_gain_margin_is_that_of_the_prediction():
    """The elbow at rest: where the response crosses the negative real axis, its steepest slope away from -1."""
    case = epp.case("fig8b_reduced_backlash")
    system = case.to_system()
    names = system.element_names
    found = frozen_loop(system, dict.fromkeys(names, 0.0), dict.fromkeys(names, 11.0), None)
    margins = predicted("fig8b_reduced_backlash").margins
    crossing = np.interp(margins["phase_crossover"], found.omega, found.response.real)
    steepest = max(system.elements[names.index("bands")].slope_bounds(), key=abs)
    assert -1.0 / (crossing * steepest) == pytest.approx(margins["gain_margin"], rel=0.02)


def test_inputs_of_elements_are_signals():
    system = epp.case("fig8a_original").to_system()
    wider = with_element_inputs(system, ("theta",))
    assert wider.signals.names == ("theta", *map(input_name, system.element_names))
    run = epp.simulate(wider, epp.case("fig8a_original").input, 1.0)
    force = epp.simulate(system, epp.case("fig8a_original").input, 1.0).signals["sensor_force"]
    np.testing.assert_allclose(run.signals[input_name("bands")], force, atol=1e-9)
    with pytest.raises(ModelError, match="there is no signal 'elbow'"):
        with_element_inputs(system, ("elbow",))


def test_an_element_without_slope_has_no_picture_at_rest():
    loop = epp.LureSystem.from_blocks([epp.Relay(), epp.Relay(), ([1.0], [1.0, 3.0, 2.0, 0.0])])
    names = loop.element_names
    assert frozen_loop(loop, dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0), None) is None


@pytest.mark.parametrize("name", ["fig8a_original", "gain_brings_it_back", "backlash_servo", "relay_hyst_servo"])
def test_the_cycle_next_to_the_run_is_the_predicted_one(name):
    case = epp.case(name)
    system = case.to_system()
    run = epp.simulate(with_element_inputs(system, ()), case.input, case.t_end).limit_cycle
    names = {n: input_name(n) for n in system.element_names}
    phasors = {n: run.harmonics[at][1] for n, at in names.items()}
    value = case.operating_point.vector(system)
    found = nearest_cycle(system, phasors, {n: run.mean[at] for n, at in names.items()}, run.omega, value)
    stable = [c for c in predicted(name) if c.stable]
    sizes = {n: e["amplitude"] for n, e in stable[-1].elements.items()}
    assert found is not None and found[2] == pytest.approx(stable[-1].omega, rel=1e-8)
    assert found[0] == pytest.approx(sizes, rel=1e-7)


def test_a_motion_that_is_far_from_any_cycle_has_none_next_to_it():
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    assert nearest_cycle(loop, {"saturation": 2.0}, {"saturation": 0.0}, 1.4, np.zeros(0)) is None
    assert nearest_cycle(loop, {"saturation": 0.0}, {"saturation": 0.0}, 1.4, np.zeros(0)) is None


@pytest.mark.parametrize("name", ["fig8a_original", "wheelchair"])
def test_the_picture_at_a_predicted_cycle_meets_in_it(name):
    case = epp.case(name)
    system, inputs = case.to_system(), case.operating_point
    for cycle in predicted(name):
        found = epp.frozen_nyquist(system, cycle, inputs)
        response = np.interp(cycle.omega, found.omega, found.response)
        assert abs(response - found.point) < 1e-9 * abs(found.point)
    axes = found.plot()
    assert axes.get_xlabel() == "real part" and found.element in said_above(axes.figure)[0].replace(" ", "_")
