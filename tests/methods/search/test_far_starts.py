"""What a search says of rest and growth where it begins far out, or where nothing rests: closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp


def _hysteresis(start: float) -> epp.LureSystem:
    """x' = -relay(x) between -0.1 and 0.1: from anywhere it comes to the cycle of 0.4 s, a ramp at rate one before."""
    relay = epp.HysteresisRelay(lower=-0.1, upper=0.1, low=-1.0, high=1.0)
    return epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0]], [relay], x0=[start])


def _windup(reference: float, start: tuple[float, float]) -> epp.LureSystem:
    """A lag of one second under a PI law that is limited to one: y' = -y + sat(u), q' = r - y, u = 2 (r - y) + q."""
    return epp.LureSystem.build(
        [[-1.0, 0.0], [-1.0, 0.0]], [[1.0], [0.0]], [[-2.0, 1.0]], [epp.Saturation()],
        constant_state=[0.0, reference], constant_input=[2.0 * reference], x0=list(start),
    )  # fmt: skip


@pytest.mark.parametrize("start", [1.0, pytest.param(1e6, marks=pytest.mark.slow), 1e7, 1e8])
def test_a_hysteresis_relay_on_an_integrator_never_rests_however_far_out_it_begins(start):
    found = epp.find_limit_cycles(_hysteresis(start))
    assert [c.period for c in found] == [pytest.approx(0.4, rel=1e-12)]
    assert not found.settles and not found.diverges


@pytest.mark.parametrize("start", [1e5, 1e6])
def test_a_relay_servo_comes_to_its_cycle_from_far_out(start):
    found = epp.find_limit_cycles(replace(epp.case("relay_hyst_servo").to_system(), x0=np.array([start, 0.0])))
    # An independent integrator comes to the cycle of 2.84724622 s from five such starts.
    assert [c.period for c in found] == [pytest.approx(2.84724622, rel=1e-8)]
    assert not found.settles and not found.diverges


@pytest.mark.parametrize(
    ("reference", "start"),
    [
        (0.99, (0.0, 0.0)),
        (1.01, (0.0, 0.0)),
        (1.01, (0.5, -2.0)),
        (1.01, (0.0, 30.0)),
    ],
)
def test_an_integrator_that_winds_up_for_ever_is_not_at_rest(reference, start):
    loop = _windup(reference, start)
    found = epp.find_limit_cycles(loop)
    assert not len(found)
    # Within the limit it rests at the set point; beyond it the integral gains r - 1 each second, and nothing rests.
    assert found.settles == (reference < 1.0)
    assert found.settles or found.status is epp.Status.UNDECIDED or found.diverges
    if found.settles:
        drive = np.clip(loop.C @ found.rest_state + loop.constant_input, -1.0, 1.0)
        rates = loop.A @ found.rest_state + loop.B @ drive + loop.constant_state
        assert rates == pytest.approx([0.0, 0.0], abs=1e-9)
