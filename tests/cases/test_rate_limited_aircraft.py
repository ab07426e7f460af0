"""Duda's aircraft: the cycle that its rate limit makes, against an independent integrator, and its onset point."""

import numpy as np
import pytest

import eppanalysis as epp

CASE = "rate_limited_aircraft"


def orbit(case):
    return epp.exact_orbit(case, epp.predict_limit_cycles(case)[0])


@pytest.mark.slow
def test_unstable_cycle_is_the_one_known_and_grows_with_the_rate():
    case = epp.case(CASE)
    exact = orbit(case)
    assert exact.omega == pytest.approx(4.169755, abs=5e-7)
    assert np.rad2deg(exact.peak_to_peak["delta"]) / 2.0 == pytest.approx(5.64753, abs=5e-6)
    assert exact.stable is False
    faster = orbit(case.with_values({"rate": "60 deg/s"}))
    assert faster.omega == pytest.approx(exact.omega, rel=1e-9)
    assert faster.peak_to_peak["delta"] == pytest.approx(4.0 * exact.peak_to_peak["delta"], rel=1e-9)


def test_onset_point_is_that_of_the_transfer_functions():
    case = epp.case(CASE)
    point = epp.olop(case, amplitude=np.deg2rad(5.0))
    s = 1j * point.omega
    control = (
        5.21 * (s - 57.36) * (s + 4.26) * (s + 0.55) / ((s**2 + 2 * 0.442 * 22.85 * s + 22.85**2) * s * (s + 1.16))
    )
    aircraft = -10.524 * (s + 1.562) * (s + 0.038) * s
    aircraft /= (s**2 + 2 * 0.212 * 0.088 * s + 0.088**2) * (s + 3.75) * (s - 1.44)
    servo = 2000.0 / (s + 2000.0)
    L = control * aircraft * servo
    assert point.gain == pytest.approx(abs(L), rel=1e-9)
    assert np.exp(1j * point.phase) == pytest.approx(L / abs(L), rel=1e-9)
    assert np.deg2rad(5.0) * point.omega * abs(servo / (1.0 + L)) == pytest.approx(np.deg2rad(15.0), rel=1e-9)
    assert point.prone
    assert epp.olop(case, amplitude=np.deg2rad(1.0)).prone is False
