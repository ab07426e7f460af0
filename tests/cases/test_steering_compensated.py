"""Steering with friction that is compensated for: first order by hand, and either side of full compensation."""

import numpy as np
import pytest
from scipy.optimize import fsolve

import eppanalysis as epp


def test_first_order_is_the_balance_by_hand():
    """Friction and compensator read the same speed, so one amplitude and one frequency balance both.

    A small cycle that does not hold bounds those that come to rest.
    """
    s = 1j
    small, cycle = epp.predict_limit_cycles(epp.case("steering_compensated"))

    def balance(logarithms):
        a, w = np.exp(logarithms)
        theta = np.arcsin(0.01 / a)
        added = 2 * 4.8 / (np.pi * 0.01) * (theta + np.sin(theta) * np.cos(theta))
        taken = 4 * 3.0 / (np.pi * a)
        motor = 1 / (1 + s * w / 100.0)
        off = s * w + 2.0 + taken + motor * (400.0 / (s * w) + 5.0 - added)
        return [off.real, off.imag]

    a, w = np.exp(fsolve(balance, np.log([0.5, 20.0])))
    assert cycle.stable and not small.stable and small.elements["rack"]["amplitude"] < 0.01
    assert cycle.omega == pytest.approx(w, rel=1e-8)
    assert cycle.elements["rack"]["amplitude"] == pytest.approx(a, rel=1e-7)


def test_it_swings_where_more_is_compensated_than_there_is_and_rests_where_less_is():
    case = epp.case("steering_compensated")
    run = epp.simulate(case)
    assert run.limit_cycle is not None
    predicted = epp.predict_limit_cycles(case)[1]
    assert run.limit_cycle.period == pytest.approx(predicted.period, rel=0.02)
    less = case.with_values({"share": 0.8})
    assert epp.simulate(less).status is epp.Status.SETTLED and len(epp.predict_limit_cycles(less)) == 0
