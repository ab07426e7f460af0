"""Loops as diagrams: what comes back is the loop, to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.models.systems.signals import SignalMap
from tests.shared import of_kind

MATRICES = (
    *("A", "B", "C", "D", "B_input", "D_input", "constant_state", "constant_input"),
    *("x0", "v0", "delays"),
)
AS_GIVEN = (
    *("elements", "element_names", "input_names", "memory", "time_step", "state_names", "name"),
    *("principal", "margins_at"),
)


def _require_same(found, loop):
    for name in MATRICES:
        np.testing.assert_array_equal(getattr(found, name), getattr(loop, name), err_msg=name)
    for name in AS_GIVEN:
        assert getattr(found, name) == getattr(loop, name), name
    for name in ("names", "units"):
        assert getattr(found.signals, name) == getattr(loop.signals, name)
    for name in ("C", "D", "D_input", "constant"):
        np.testing.assert_array_equal(getattr(found.signals, name), getattr(loop.signals, name), err_msg=name)


def _require_same_places(found, loop):
    """Return ratios of the elements' inputs and outputs, which diagrams call by the names of their ports."""
    drawing = epp.Diagram.of(loop)
    called = [f"{n}.{p}" for side in (drawing.ports.inputs, drawing.ports.outputs)
              for n in loop.element_names for p in side[n]]  # fmt: skip
    for name, old in zip(called, loop.places.names, strict=True):
        i, j = found.places.number(name), loop.places.number(old)
        for matrix in ("B", "E"):
            np.testing.assert_array_equal(getattr(found.places, matrix)[:, i], getattr(loop.places, matrix)[:, j])
        for matrix in ("C", "D", "F", "delays"):
            np.testing.assert_array_equal(getattr(found.places, matrix)[i], getattr(loop.places, matrix)[j])


def test_every_shipped_loop_comes_back_from_its_diagram():
    for name in of_kind("loop", "elbow"):
        loop = epp.case(name).to_system()
        found = epp.Diagram.of(loop).to_system()
        _require_same(found, loop)
        _require_same_places(found, loop)


@pytest.mark.parametrize("name", ["backlash_discrete_pi", "belt_leine", "relay_biased_fopdt", "parking_stops_it"])
def test_runs_have_the_same_bits(name):
    """In discrete time, with a constant, with dead time, with a clock and an external input."""
    case = epp.case(name)
    loop, found = case.to_system(), epp.Diagram.of(case.to_system()).to_system()
    t_end = 20.0 * (loop.time_step or 0.01)
    one, other = (epp.simulate(system, case.input, t_end=t_end) for system in (loop, found))
    np.testing.assert_array_equal(one.t, other.t)
    for signal in loop.signals.names:
        np.testing.assert_array_equal(one.signals[signal], other.signals[signal], err_msg=signal)


def _random_loop(seed):
    """Two inputs, elements with one and with two inputs, cascades, constants, dead time, dense signals."""
    rng = np.random.default_rng(seed)
    elements = [
        epp.Saturation(lower=-1.0, upper=1.0),
        epp.LockPin(gap=0.1, stiffness=2.0, damping=0.1),
        epp.Play(gap=0.2),
    ]
    n, nz, nw = int(rng.integers(0, 4)), 4, 3
    late = rng.random() < 0.5 and n > 0
    D = np.zeros((nz, nw))
    D[3, 1] = rng.normal()  # the lock pin acts straight on the play
    signals = rng.normal(size=(2, nw))
    signals[:, 0] = rng.choice([-1.0, 0.0, 1.0], size=2)
    kept = rng.random() < 0.5
    map_ = SignalMap(
        ("a", "b c"), rng.normal(size=(2, n)), signals, rng.normal(size=(2, 2)), rng.normal(size=2), ("m", "")
    )
    return epp.LureSystem.build(
        rng.normal(size=(n, n)), rng.normal(size=(n, nw)), rng.normal(size=(nz, n)), elements, D=D,
        B_input=rng.normal(size=(n, 2)), D_input=rng.normal(size=(nz, 2)), input_names=("load", "linear"),
        constant_state=rng.normal(size=n) * kept, constant_input=rng.normal(size=nz) * kept,
        element_names=("one", "pin", "linear_2"), signals=map_, x0=rng.normal(size=n), v0=rng.normal(size=2),
        memory=[None, None, 0.05], delays=[0.3 * late, 0.0, 0.0], principal=int(rng.integers(0, 3)),
        margins_at=["pin.in2"] if rng.random() < 0.5 else [], name="random",
    )  # fmt: skip


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_loop_comes_back_from_its_diagram(seed):
    loop = _random_loop(seed)
    found = epp.Diagram.of(loop).to_system()
    _require_same(replace(found, margins_at=()), replace(loop, margins_at=()))
    assert found.margins_at == (("pin.rate",) if loop.margins_at else ())
    _require_same_places(found, loop)


_TWICE = SignalMap(("y",), np.zeros((1, 1)), np.full((1, 1), 2.0), np.zeros((1, 0)), np.zeros(1))


def _loop(**options):
    return epp.LureSystem.build(
        [[-1.0]], [[1.0]], [[-1.0]], [epp.Saturation(lower=-1.0, upper=1.0)], **{"element_names": ["valve"], **options}
    )


@pytest.mark.parametrize(
    ("loop", "sentence"),
    [
        (lambda: _loop(element_names=["my valve"]), "a plain name"),
        (lambda: _loop(delays=[1.0], D=[[0.5]]), "acts straight on an element"),
        (lambda: _loop(delays=[1.0], time_step=1.0), "dead time in discrete time"),
        (lambda: _loop(delays=[1.0], signals=_TWICE), "1 or -1 times"),
        (
            lambda: epp.LureSystem.build(
                [[0.0]], [[1.0]], [[-1.0]], [epp.SampledController([[1.0]], [[0.1]], [[1.0]], [[1.0]], sample_time=0.1)]
            ),
            "brought linear states of its own",
        ),
    ],
)  # fmt: skip
def test_what_a_diagram_cannot_hold_is_refused(loop, sentence):
    with pytest.raises(epp.ModelError, match=sentence):
        epp.Diagram.of(loop())
