"""Loops of textbooks whose limit cycles are closed forms: the search finds each, and no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp


def test_an_integrator_with_dead_time_and_a_relay() -> None:
    """The relay test of an integrating process: period four dead times, peak to peak twice the slope of one."""
    delay, slope = 0.5, 1.7
    loop = epp.LureSystem.from_tf(([slope], [1.0, 0.0]), epp.Relay(), delay=delay)
    (cycle,) = epp.find_limit_cycles(loop).cycles
    assert cycle.stable and cycle.period == pytest.approx(4 * delay, rel=1e-10)
    assert cycle.peak_to_peak["x"] == pytest.approx(2 * slope * delay, rel=1e-10)


def test_a_thermostat_with_dead_time() -> None:
    """An oven of one time constant between on and off: it goes on as it was for a dead time behind either switch."""
    tau, gain, delay, band, target, power = 50.0, 2.0, 4.0, 0.5, 8.0, 10.0
    loop = epp.LureSystem.build(
        [[-1 / tau]], [[gain / tau]], [[-1.0]], [epp.HysteresisRelay(lower=-band, upper=band, low=0.0, high=power)],
        constant_input=[target], delays=[delay], x0=[5.0],
    )  # fmt: skip
    (cycle,) = epp.find_limit_cycles(loop).cycles
    end, fall = gain * power, np.exp(-delay / tau)
    top, bottom = end - (end - target - band) * fall, (target - band) * fall
    assert cycle.period == pytest.approx(tau * np.log((end - bottom) / (end - top) * top / bottom), rel=1e-9)
    assert cycle.peak_to_peak["hysteresis_relay_input"] == pytest.approx(top - bottom, rel=1e-9)


def test_a_satellite_with_schmitt_triggered_thrusters() -> None:
    """theta'' = u with rate feedback K: it coasts at (on - off)/(2 K), and a pulse turns that round."""
    lead, on, off, thrust = 1.0, 1.0, 0.6, 0.1
    relay = epp.HysteresisRelayDeadZone(on, off, thrust)
    loop = epp.LureSystem.build([[0.0, 1.0], [0.0, 0.0]], [[0.0], [-1.0]], [[1.0, lead]], [relay], x0=[0.5, 0.3])
    (cycle,) = epp.find_limit_cycles(loop).cycles
    rate = (on - off) / (2 * lead)
    coasts, pulse = 2 * (on - lead * rate) / rate, 2 * rate / thrust
    assert cycle.stable and cycle.period == pytest.approx(2 * (coasts + pulse), rel=1e-10)
    # Behind its switch theta + K theta' goes on rising until the rate is K times the thrust.
    over = (rate - lead * thrust) ** 2 / (2 * thrust)
    assert cycle.peak_to_peak["hysteresis_relay_dead_zone_input"] == pytest.approx(2 * (on + over), rel=1e-10)


@pytest.mark.slow  # starts of a continuum are drawn from often
def test_a_continuum_is_listed_without_its_ends() -> None:
    """A valve that slips as far as it sticks, a PI controller and a tank: the level moves by the band, to and fro.

    With the levels a and a - 1 of the valve, in bands, one stroke takes 1/(gain a) and the other 1/(gain (1 - a)): one
    cycle for each a between reset/(2 gain^2) and its mirror image, where a stroke begins at rest.
    """
    band, gain, reset = 5.0, 0.4, 0.08
    loop = epp.LureSystem.from_tf(([gain, reset], [1.0, 0.0, 0.0]), epp.JumpAndFollow(stick_band=band, slip_jump=band))
    found = epp.find_limit_cycles(loop)
    (cycle,) = found
    assert found.n_continua == 1 and cycle.stable
    assert cycle.peak_to_peak["x"] == pytest.approx(band)
    end = reset / (2.0 * gain**2)
    assert end * (1.0 - end) < 1.0 / (gain * cycle.period) < 0.25 + 1e-9


@pytest.mark.xfail(strict=True, reason="a run's verdict takes what grows by a billionth in a turn for a cycle")
@pytest.mark.parametrize("width", [0.2, 30.0])
def test_what_grows_ever_more_slowly_is_no_cycle(width: float) -> None:
    """Two integrators behind a relay with hysteresis: half the square of the speed grows by as much in each turn."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), epp.HysteresisRelay(-width / 2, width / 2))
    for speed in np.sqrt(width) * np.array([1e2, 1e4, 3e4, 1e5]):
        start = replace(loop, x0=np.array([speed, width / 2]))
        assert epp.simulate(start, t_end=20.0 * speed).limit_cycle is None
