"""The digital buck converter against its samples by hand: the filter between them by an exponential, two roundings.

The law counts in eight millionths of the pulse width, of which a step has 500: halves, rounded off zero, do occur.
"""

import numpy as np
from scipy.linalg import expm

import eppanalysis as epp

L, C, R, SUPPLY, PERIOD, ADC, DUTY = 4e-6, 100e-6, 1.0, 5.0, 4e-6, 0.01, 0.004


def by_hand(samples):
    """Voltage and pulse width at the samples, counted from the reference and from the step below."""
    held = expm(PERIOD * np.array([[0.0, 1.0, 0.0], [-1 / (L * C), -1 / (R * C), SUPPLY / (L * C)], [0.0, 0.0, 0.0]]))
    x, integral, found = np.array([0.15, 0.0, 0.0]), 0, []
    for _ in range(samples):
        error = int(np.clip(np.round(-x[0] / ADC), -10, 10))
        integral += 4 * error
        count = 25 * error + integral
        duty = np.sign(count) * min((abs(count) + 250) // 500, 12) * DUTY
        found.append((x[0], duty))
        x[2] = duty - 0.5 * DUTY
        x = held @ x
    return np.array(found).T


def test_run_is_that_of_the_samples_and_comes_to_their_cycle():
    voltage, duty = by_hand(1000)
    times = PERIOD * np.arange(1000)
    run = epp.simulate(epp.case("buck_converter"), t_end=times[-1] + 0.5 * PERIOD, t_eval=times + 0.25 * PERIOD)
    np.testing.assert_allclose(run.signals["duty"], duty, atol=1e-12)
    at = epp.simulate(epp.case("buck_converter"), t_end=times[-1], t_eval=times)
    np.testing.assert_allclose(at.signals["voltage"], voltage, atol=1e-8)
    # What is left at the end is the cycle of both.
    assert np.ptp(voltage[-200:]) > ADC
