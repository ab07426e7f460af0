"""Loops from blocks beside the algebra of transfer functions and python-control's interconnections."""

from __future__ import annotations

import control
import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import ELEMENTS

OMEGA = np.array([0.05, 0.4, 1.0, 3.0, 40.0])


def test_textbook_loop_has_minus_the_plant():
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    s = 1j * OMEGA
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 0, 0], -5.0 / (s * (s + 1)), rtol=1e-13)
    assert loop.signals.names == ("x", "y") and loop.input_names == ()


def test_positive_feedback_and_dead_time():
    loop = epp.LureSystem.from_tf(([2.0], [1.0, 1.0]), epp.Relay(), delay=0.7, feedback=1)
    want = 2.0 / (1j * OMEGA + 1) * np.exp(-0.7j * OMEGA)
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 0, 0], want, rtol=1e-13)


def test_discrete_time_loop_is_evaluated_on_the_unit_circle():
    loop = epp.LureSystem.from_tf(control.tf([0.3], [1.0, -0.9], 0.5), epp.Relay())
    z = np.exp(0.5j * OMEGA)
    assert loop.time_step == 0.5
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 0, 0], -0.3 / (z - 0.9), rtol=1e-12)


def test_python_control_there_and_back():
    plant = control.tf([1.0, 3.0], [1.0, 2.0, 5.0])
    loop = epp.LureSystem.from_tf(plant, epp.Saturation())
    np.testing.assert_allclose(loop.to_control()(1j * OMEGA), -plant(1j * OMEGA), rtol=1e-12)


def test_ring_of_two_plants_and_two_elements():
    """Saturation, G1, play, G2, and back with a minus: each element sees the plant before it."""
    g1, g2 = ([1.0], [1.0, 2.0]), ([3.0, 1.0], [1.0, 1.0, 4.0])
    loop = epp.LureSystem.from_blocks([epp.Saturation(), g1, epp.Play(gap=0.1), g2])
    s = 1j * OMEGA
    L = loop.frequency_response(OMEGA)
    np.testing.assert_allclose(L[:, 1, 0], 1 / (s + 2), rtol=1e-13)
    np.testing.assert_allclose(L[:, 0, 1], -(3 * s + 1) / (s**2 + s + 4), rtol=1e-12)
    np.testing.assert_allclose([L[:, 0, 0], L[:, 1, 1]], 0.0, atol=1e-15)
    assert loop.element_names == ("saturation", "play")


def test_ring_that_begins_with_a_plant_and_ends_with_an_element():
    """The minus stands where the ring closes, wherever the elements are."""
    loop = epp.LureSystem.from_blocks([([2.0], [1.0, 3.0]), epp.Saturation(), epp.DeadZone()])
    L = loop.frequency_response(OMEGA)
    np.testing.assert_allclose(L[:, 0, 1], -2.0 / (1j * OMEGA + 3), rtol=1e-13)
    np.testing.assert_allclose(L[:, 1, 0], 1.0, rtol=1e-15)


def test_two_elements_of_a_kind_have_names_of_their_own():
    loop = epp.LureSystem.from_blocks([epp.Relay(), ([1.0], [1.0, 1.0]), epp.Relay(), ([1.0], [1.0, 2.0])])
    assert loop.element_names == ("relay_1", "relay_2")
    assert len(set(loop.signals.names)) == 4


def test_response_at_any_complex_frequency_and_at_a_pole():
    """``exp(-0.5 s)/(s - 1)``, and a pole that is met to the last bit is huge and no error."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, -1.0]), epp.Relay(), delay=0.5, feedback=1)
    assert loop.response_at(2.0 + 1.0j)[0, 0] == pytest.approx(np.exp(-1.0 - 0.5j) / (1.0 + 1.0j), rel=1e-14)
    assert abs(loop.response_at(1.0)[0, 0]) > 1e12


def test_responses_of_states_and_signals():
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    states = loop.state_response(OMEGA)[:, :, 0]
    np.testing.assert_allclose(states @ loop.C[0], loop.frequency_response(OMEGA)[:, 0, 0], rtol=1e-12)
    signals = loop.signal_response(OMEGA)[:, :, 0]
    np.testing.assert_allclose(signals[:, 0], loop.frequency_response(OMEGA)[:, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(signals[:, 1], 1.0)


def test_slices_of_elements_with_several_inputs_and_outputs():
    pin = epp.LockPin(gap=0.1, stiffness=10.0, damping=0.1)
    loop = epp.LureSystem.build(np.zeros((2, 2)), np.ones((2, 2)), np.ones((3, 2)), [epp.Relay(), pin])
    assert [(s.start, s.stop) for s in loop.input_slices] == [(0, 1), (1, 3)]
    assert [(s.start, s.stop) for s in loop.output_slices] == [(0, 1), (1, 2)]


def test_arrays_are_frozen():
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    with pytest.raises(ValueError, match="read-only"):
        loop.A[0, 0] = 3.0


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"A": [[1.0, 2.0]]}, r"A has shape \(1, 2\); expected a square matrix"),
        ({"A": np.zeros((2, 2, 2))}, "expected a square matrix"),
        ({"B": [[1.0, 2.0, 3.0]]}, r"B has shape \(1, 3\); expected shape \(2, 1\)"),
        ({"C": [[1.0, np.nan]]}, "C holds a number that is not finite"),
        ({"x0": [1.0, 2.0, 3.0]}, "x0 has shape"),
        ({"delays": [0.1, 0.2]}, "delays has shape"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(fields, sentence):
    given = {"A": np.eye(2), "B": [[1.0], [0.0]], "C": [[1.0, 0.0]], **fields}
    A, B, C = given.pop("A"), given.pop("B"), given.pop("C")
    with pytest.raises(ModelError, match=sentence):
        epp.LureSystem.build(A, B, C, [epp.Relay()], **given)


def test_rings_that_cannot_be_are_refused():
    plant = ([1.0], [1.0, 1.0])
    with pytest.raises(ModelError, match="at least one nonlinear element"):
        epp.LureSystem.from_blocks([plant])
    with pytest.raises(ModelError, match="different sample times"):
        epp.LureSystem.from_blocks([epp.Relay(), plant, control.tf([1.0], [1.0, 0.5], 0.1)])
    with pytest.raises(ModelError, match="several inputs or outputs"):
        epp.LureSystem.from_blocks([epp.LockPin(gap=0.1, stiffness=1.0, damping=0.1), plant])
    with pytest.raises(ModelError, match="the dead time acts straight on saturation; expected .* with states"):
        epp.LureSystem.from_blocks([epp.Relay(), epp.Saturation(), ([1.0, 2.0], [1.0, 1.0])], delay=0.1)


def _delayed_cycle(delay, step=1e-3, until=60.0):
    """Period and peak-to-peak of y'' = -y' + w, w = sat(4 r(t - delay)), r = dead zone(-y): by fixed steps."""
    late, y, rate, seen = [0.0] * round(delay / step), 1.0, 0.0, []
    for _ in range(round(until / step)):
        late.append(np.sign(-y) * max(abs(y) - 0.1, 0.0))
        drive = min(max(4.0 * late.pop(0), -1.0), 1.0)
        rate += step * (drive - rate)
        y += step * rate
        seen.append(y)
    tail = np.array(seen[len(seen) // 2 :])
    up = np.flatnonzero((tail[:-1] < 0) & (tail[1:] >= 0))
    return step * float(np.mean(np.diff(up))), float(np.ptp(tail))


def test_a_dead_time_between_two_elements_is_that_behind_the_second():
    ring = [epp.DeadZone(-0.1, 0.1), ([4.0], [1.0]), epp.Saturation(), ([1.0], [1.0, 1.0]), ([1.0], [1.0, 0.0])]
    loop = epp.LureSystem.from_blocks(ring, delay=0.6)
    assert loop.delays.tolist() == [0.0, 0.6]
    cycle = epp.simulate(loop, t_end=60.0).limit_cycle
    period, size = _delayed_cycle(0.6)
    y = next(name for name in cycle.peak_to_peak if name.startswith("dead_zone"))
    assert cycle.period == pytest.approx(period, rel=5e-3)
    assert cycle.peak_to_peak[y] == pytest.approx(size, rel=5e-3)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"delays": [0.0, -0.3]}, r"delays is \[0.0, -0.3\]; expected zero or positive numbers"),
        ({"time_step": -1.0}, "time_step is -1.0; expected a positive number or None"),
        ({"memory": [1.0]}, r"memory is \(1.0,\); expected 2, one for each element"),
        ({"element_names": ["a"]}, r"element_names is \['a'\]; expected 2 different names"),
        ({"element_names": ["a", "a"]}, r"element_names is \['a', 'a'\]; expected 2 different names"),
        ({"C": np.ones((3, 2))}, r"C has shape \(3, 2\); expected shape \(2, 3\)"),
    ],
)
def test_what_would_be_taken_for_something_else_is_refused(fields, sentence):
    given = {"A": -np.eye(3), "B": np.ones((3, 2)), "C": np.ones((2, 3)), "elements": [epp.Relay(), epp.Relay()]}
    with pytest.raises(ModelError, match=sentence):
        epp.LureSystem.build(**(given | fields))


@pytest.mark.parametrize("feedback", [0, 5])
def test_feedback_is_a_sign(feedback):
    with pytest.raises(ModelError, match=f"feedback is {feedback}; expected -1 or 1"):
        epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Relay(), feedback=feedback)


def test_equal_elements_have_signals_of_their_own():
    loop = epp.LureSystem.build(-np.eye(2), np.eye(2), np.eye(2), [epp.Relay(), epp.Relay()])
    assert loop.signals.names == ("relay_1_input", "relay_1_output", "relay_2_input", "relay_2_output")


def test_automatic_signals_are_the_elements_inputs_with_their_constants():
    """A thermostat: the relay's input is the set point less the temperature."""
    loop = epp.LureSystem.build(
        [[-0.2]], [[0.4]], [[-1.0]], [epp.HysteresisRelay(-0.1, 0.1, 0.0, 1.0)],
        constant_input=[1.0], D_input=[[0.5]], input_names=["change"], x0=[0.5],
    )  # fmt: skip
    (cycle,) = epp.find_limit_cycles(loop)
    assert cycle.mean["hysteresis_relay_input"] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(cycle.waveform["hysteresis_relay_input"]).max() == pytest.approx(0.1, rel=1e-9)
    np.testing.assert_array_equal(loop.signals.D_input[:, 0], [0.5, 0.0])


@pytest.mark.parametrize("omega", [0.0, 1.0])
def test_the_response_at_a_pole_is_huge_and_that_next_to_it(omega: float) -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 1.0, 0.0]), epp.Saturation())
    at, beside = (abs(loop.frequency_response(w)[0, 0]) for w in (omega, omega + 1e-6))
    assert at > 1e6 * beside and np.isfinite(at)


def test_elements_without_a_name_are_called_in_words():
    """Not after their class run together: pictures and tables show it."""
    controller = epp.SampledController([[1.0]], [[0.05]], [[1.0]], [[4.0]], sample_time=0.001)
    loop = epp.LureSystem.build([[0.0]], [[1.0]], [[-1.0]], [controller])
    assert loop.element_names == ("sampled_controller",)
    assert all(element.called() == kind for kind, element in ELEMENTS.items())


@pytest.mark.parametrize("D", [-2.0, -1.0, -0.5, 2.0])
def test_every_door_refuses_elements_that_act_on_themselves_with_several_answers(D) -> None:
    """With slopes from 0 to 1 the loop x = -D y + ... has one answer where 1 + D keeps its sign, whoever builds it."""
    limit, plant = epp.Saturation(-1.0, 1.0), ([D, D + 3.0], [1.0, 1.0])

    def diagram() -> epp.LureSystem:
        blocks = {"plant": epp.blocks.TransferFunction(num=plant[0], den=plant[1]), "saturation": limit}
        return epp.Diagram(parts=blocks, connect=["-plant -> saturation", "saturation -> plant"]).to_system()

    doors = [
        lambda: epp.LureSystem.from_tf(plant, limit),
        lambda: epp.LureSystem.from_blocks([limit, plant]),
        lambda: epp.LureSystem.build([[-1.0]], [[1.0]], [[-3.0]], [limit], D=[[-D]]),
        diagram,
    ]
    said = set()
    for door in doors:
        try:
            door()
        except epp.ModelError as refused:
            said.add(str(refused).partition(": ")[2])
        else:
            said.add("")
    assert len(said) == 1
    assert ("has no unique answer" in said.pop()) == (D <= -1.0)
