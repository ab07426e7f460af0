"""Elements to python-control and from it, beside python-control's own answers."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.foreign import as_element, is_element
from tests.shared import mostly_slow

SIZES = st.floats(0.01, 100.0)
AMPLITUDES = np.geomspace(1.01, 200.0, 40)


def theirs(kind: str, size: float, other: float) -> tuple[control.DescribingFunctionNonlinearity, float]:
    """One of python-control's elements, and the amplitude from which it is in motion."""
    if kind == "saturation":
        return control.saturation_nonlinearity(size), size
    if kind == "backlash":
        return control.friction_backlash_nonlinearity(size), size / 2
    return control.relay_hysteresis_nonlinearity(other, size), size


KINDS = st.sampled_from(["saturation", "backlash", "relay"])


@settings(deadline=None, max_examples=40)
@given(KINDS, SIZES, SIZES)
def test_describing_functions_of_python_control_and_of_the_element_it_becomes_are_one(kind, size, other):
    element, begin = theirs(kind, size, other)
    ours = as_element(element).to_control()
    wanted = control.describing_function(element, begin * AMPLITUDES)
    np.testing.assert_allclose(control.describing_function(ours, begin * AMPLITUDES), wanted, rtol=1e-9)


@settings(deadline=None, max_examples=40)
@given(KINDS, SIZES, SIZES, st.lists(st.floats(-300.0, 300.0), min_size=1, max_size=20))
def test_outputs_of_python_control_and_of_the_element_it_becomes_are_one(kind, size, other, inputs):
    element = theirs(kind, size, other)[0]
    ours = as_element(element).to_control()
    # python-control's play begins at zero, as ours does, and its relay low.
    np.testing.assert_allclose([ours(x) for x in inputs], [float(element(x)) for x in inputs], rtol=1e-12, atol=1e-13)


def test_unsymmetric_saturation_keeps_its_limits():
    with pytest.warns(UserWarning, match="asymmetric"):
        element = control.saturation_nonlinearity(2.0, -0.5)
    assert as_element(element) == epp.Saturation(-0.5, 2.0)


@pytest.mark.parametrize(
    "element",
    [
        *(epp.Play(0.7), epp.Cube(2.0)),
        *(
            pytest.param(e, marks=pytest.mark.slow)
            for e in (epp.Relay(), epp.DeadZone(), epp.RelayDeadZone(0.3), epp.Quantiser(0.2, 4))
        ),
    ],
)
def test_sampled_describing_function_of_the_calls_is_near_the_closed_form(element):
    """python-control samples what is called, memory and all, and keeps what one amplitude leaves for the next."""
    for amplitude in (0.5, 1.0, 3.0):
        found = control.describing_function(element.to_control(), amplitude, num_points=5_000, try_method=False)
        wanted = control.describing_function(element.to_control(), amplitude)
        np.testing.assert_allclose(found, wanted, atol=2e-3)


def test_intersections_of_the_plot_are_the_predicted_cycle():
    import matplotlib.pyplot as plt

    plant, element = control.tf([8.0], [1.0, 2.0, 2.0, 1.0]), epp.Saturation()
    (predicted,) = epp.predict_limit_cycles(epp.LureSystem.from_tf(plant, element))
    amplitudes = np.linspace(1.5, 6.0, 60)
    found = control.describing_function_response(plant, element.to_control(), amplitudes, warn_nyquist=False)
    ((a, omega),) = found.intersections
    assert a == pytest.approx(predicted.amplitude("x"), rel=1e-3)
    assert omega == pytest.approx(predicted.omega, rel=1e-3)
    drawn = control.describing_function_plot(plant, element.to_control(), amplitudes, warn_nyquist=False)
    (locus,) = drawn.lines[1]
    wanted = -1.0 / element.describing_function(amplitudes)[1]
    np.testing.assert_allclose(locus.get_xdata() + 1j * locus.get_ydata(), wanted, rtol=1e-12)
    plt.close("all")


@pytest.mark.parametrize("kind", ["saturation", "backlash", "relay"])
def test_an_element_itself_is_taken_as_python_controls_own_is(kind: str) -> None:
    import matplotlib.pyplot as plt

    element, begin = theirs(kind, 0.7, 1.3)
    ours, plant = as_element(element), control.tf([8.0], [1.0, 2.0, 2.0, 1.0])
    np.testing.assert_allclose(
        control.describing_function(ours, begin * AMPLITUDES), control.describing_function(element, begin * AMPLITUDES),
        rtol=1e-9,
    )  # fmt: skip
    wanted, found = (
        control.describing_function_response(plant, f, begin * AMPLITUDES, warn_nyquist=False) for f in (element, ours)
    )
    assert len(found.intersections) == len(wanted.intersections)
    np.testing.assert_allclose(found.intersections, wanted.intersections, rtol=1e-6)
    lines = [
        control.describing_function_plot(plant, f, begin * AMPLITUDES, warn_nyquist=False).lines[1][0]
        for f in (element, ours)
    ]
    np.testing.assert_allclose(lines[1].get_xydata(), lines[0].get_xydata(), rtol=1e-9)
    plt.close("all")


#: One of every element of one input and one output that remembers nothing and is symmetric about zero.
MEMORYLESS = [
    epp.Saturation(), epp.DeadZone(), epp.Relay(), epp.RelayDeadZone(0.3), epp.Cube(2.0), epp.Quantiser(0.2, 4),
    epp.Tanh(1.0, 2.0), epp.Arctan(1.0), epp.Sine(1.0), epp.Drag(1.0), epp.Friction(0.4), epp.ViscousCoulomb(0.4, 0.1),
    epp.StribeckFriction(1.0, 1.5, 0.2, 0.1), epp.Polynomial([0.0, 1.0, 0.0, 0.5]), epp.Preload(1.0, 1.0),
    epp.LookupTable([-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0]), epp.MidRiseQuantiser(0.1, 10), epp.Coulomb(0.5),
    epp.PiecewiseLinear([-1.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 1.0]), epp.DeadZoneSaturation(0.2, 1.0, 2.0),
]  # fmt: skip


@pytest.mark.parametrize("element", mostly_slow(MEMORYLESS, MEMORYLESS[::4]), ids=lambda e: type(e).__name__)
def test_what_remembers_nothing_is_a_function_that_python_control_samples_to_the_closed_form(element) -> None:
    for amplitude in (0.5, 1.7):
        sampled = control.describing_function(element, amplitude, num_points=4000, zero_check=False, try_method=False)
        closed = control.describing_function(element, amplitude)
        np.testing.assert_allclose(sampled, closed, atol=5e-3)
        # A sample of the plain function is its output; python-control asks whether it may be sampled in any order.
        assert element._isstatic() and element(amplitude) == float(element.output(amplitude)[0])


def test_what_remembers_is_no_function_and_says_what_keeps_it() -> None:
    for element in (epp.Play(1.0), epp.HysteresisRelay(-1.0, 1.0)):
        assert not element._isstatic()
        with pytest.raises(ModelError, match=r"remembers where it has been; expected to_control\(\)"):
            element(0.5)


def test_gains_that_are_no_number_of_the_amplitude_alone_are_refused() -> None:
    for element in (epp.LockPin(gap=0.1, stiffness=10.0, damping=0.1), epp.RateLimiter(1.0)):
        with pytest.raises(ModelError, match="depends on the frequency, or has several inputs or outputs"):
            control.describing_function(element, [1.0, 2.0])
    with pytest.raises(ModelError, match="has a mean of"):
        control.describing_function(epp.Saturation(-0.5, 2.0), [0.4, 1.0])
    mean, gain = epp.Saturation(-0.5, 2.0).describing_function(1.0)  # as ever
    assert mean > 0.0 and abs(gain) < 1.0


def test_a_mean_that_python_control_would_leave_out_is_refused():
    adapter = epp.Saturation(-0.5, 2.0).to_control()
    assert adapter.describing_function(0.4) == pytest.approx(1.0)
    with pytest.raises(ModelError, match=r"has a mean output of 0\.\d+ at amplitude 1; python-control knows none"):
        control.describing_function(adapter, [0.4, 1.0])


def test_what_python_control_cannot_hold_is_refused():
    with pytest.raises(ModelError, match="LockPin has several inputs or outputs"):
        epp.LockPin(gap=0.1, stiffness=10.0, damping=0.1).to_control()


def test_what_is_no_known_element_is_refused():
    class Mine(control.DescribingFunctionNonlinearity):
        pass

    assert is_element(Mine()) and not is_element(([1.0], [1.0, 1.0]))
    for what in (Mine(), 3.0, control.tf([1], [1, 1])):
        with pytest.raises(ModelError, match="is not a known element; expected an element of eppanalysis"):
            as_element(what)


def test_loops_take_them_wherever_an_element_is_taken():
    theirs, ours = control.friction_backlash_nonlinearity(2.0), epp.Play(2.0)
    plant = ([5.0], [1.0, 1.0, 0.0])
    assert epp.LureSystem.from_tf(plant, theirs).elements == (ours,)
    assert epp.LureSystem.from_blocks([theirs, plant]).elements == (ours,)
    assert epp.LureSystem.build([[-1.0]], [[1.0]], [[1.0]], [theirs]).elements == (ours,)
