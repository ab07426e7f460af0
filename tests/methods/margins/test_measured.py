"""Margins of loop gains handed over as they are, and of measured ones, beside python-control's and closed forms."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import eppanalysis as epp

LOOPS = {
    "integrator": ([1.0], [1.0, 1.0, 0.0], 0),
    "three lags": ([10.0], [1.0, 3.0, 3.0, 1.0], 0),
    "two integrators": ([5.0, 5.0], [1.0, 12.0, 0.0, 0.0], 0),
    "integrator and two lags": ([1.5], [1.0, 2.0, 1.0, 0.0], 0),
    "unstable lag": ([2.0], [1.0, -1.0], 1),
    "unstable lag, too little": ([0.7], [1.0, -1.0], 1),
    "less than one": ([0.5], [1.0, 1.0], 0),
    "positive feedback": ([-3.0], [1.0, 2.0, 5.0], 0),
    "resonance": ([4.0], [1.0, 0.4, 4.0, 0.0], 0),
}


def measured(num: list[float], den: list[float], unstable: int = 0, **more) -> epp.MeasuredResponse:
    omega = np.geomspace(1e-3, 1e3, 3000)
    data = control.frd(control.tf(num, den), omega)
    return epp.MeasuredResponse.from_control(data, unstable_poles=unstable, **more)


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_gain_has_the_margins_of_python_control(name: str) -> None:
    num, den, unstable = LOOPS[name]
    system = control.tf(num, den)
    gain, phase, _, crossover = control.margin(system)
    closed = bool(np.all(control.feedback(system).poles().real < 0))
    static = None if den[-1] == 0.0 else num[-1] / den[-1]
    # Between the points the data are a spline; at rest they are the static gain.
    for loop, near in ((system, 1e-9), (measured(num, den, unstable, static_gain=static), 1e-6)):
        found = epp.margins(loop)
        assert found.at == "loop.out" and found.stable is closed
        assert found.gain_margin == pytest.approx(gain, rel=near)
        assert found.phase_margin == pytest.approx(np.deg2rad(phase), rel=near)
        assert np.isnan(found.gain_crossover) or found.gain_crossover == pytest.approx(crossover, rel=near)


def test_other_packages_systems_are_loop_gains_too() -> None:
    from scipy import signal

    want = epp.margins(control.tf([3.0], [1.0, 2.0, 1.0, 0.0])).numbers()
    for same in (
        signal.TransferFunction([3.0], [1.0, 2.0, 1.0, 0.0]),
        control.ss(control.tf([3.0], [1.0, 2.0, 1.0, 0.0])),
    ):
        assert epp.margins(same).numbers() == pytest.approx(want, rel=1e-9)
    assert (
        epp.margins(control.frd(control.tf([3.0], [1.0, 2.0, 1.0, 0.0]), np.geomspace(0.01, 100.0, 2000))).stable
        is False
    )


@given(st.sampled_from([-1.0, 1.0]), st.floats(0.2, 3.0))
def test_a_measured_loop_has_the_margins_of_its_model(sign: float, slope: float) -> None:
    num, den = [2.0 * sign], [1.0, 2.0, 2.0, 1.0]
    element = epp.Saturation(slope=slope)
    loop = epp.MeasuredLoop(measured(num, den, static_gain=2.0 * sign), element)
    want = epp.margins(epp.LureSystem.from_tf((num, den), element))
    assume(want.stable is not None)
    for at in ("saturation.in", "saturation.out"):
        found = epp.margins(loop, at)
        assert found.stable == want.stable and found.at == at and found.message.startswith("Measured from 0.001 to")
        for name, value in want.numbers().items():
            assert getattr(found, name) == pytest.approx(value, rel=1e-5, nan_ok=True)
        assert found.disk_margin == pytest.approx(want.disk_margin, rel=1e-3)


def test_two_measured_paths_are_cut_at_each_element() -> None:
    """Two loops that do not know of one another: each has the margins of its own, without a verdict on the whole."""
    own = [measured([2.0], [1.0, 1.0, 0.0]), measured([9.0], [1.0, 3.0, 2.0, 0.0])]
    matrix = epp.MeasuredMatrix([[own[0], None], [None, own[1]]])
    loop = epp.MeasuredLoop(matrix, [epp.Saturation(), epp.Saturation(slope=0.5)])
    for at, gain, slope in (("saturation_1.out", own[0], 1.0), ("saturation_2.in", own[1], 0.5)):
        found = epp.margins(loop, at)
        alone = epp.margins(epp.MeasuredLoop(gain, epp.Saturation(slope=slope)))
        assert found.numbers()["phase_margin"] == pytest.approx(alone.phase_margin, rel=1e-9)
        assert found.stable is None and found.status is epp.Status.INCOMPLETE
        assert "do not decide the stability" in found.message


def test_data_that_end_too_early_decide_nothing_and_a_relay_has_no_gain() -> None:
    short = epp.MeasuredResponse(np.geomspace(0.1, 1.0, 30), 50.0 / (1j * np.geomspace(0.1, 1.0, 30)))
    found = epp.margins(short)
    assert found.stable is None and found.status is epp.Status.INCOMPLETE
    relay = epp.margins(epp.MeasuredLoop(measured([1.0], [1.0, 1.0, 0.0]), epp.Relay()))
    assert not relay.exist and "relay, without a gain" in relay.message
