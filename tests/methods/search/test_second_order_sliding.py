"""Ideal relays whose output acts on the second derivative of their input: switches come ever faster.

With V = v^2 / 2 + |x| a relay before 1 / (s (T s + 1)) has V' = -v^2 / T: every motion settles. In general swings about
the limit shrink where d = b1 / b0 - a1 < 0 for b0 s^(n-2) + b1 s^(n-3) + ... over s^n + a1 s^(n-1) + ...
(Anosov 1959; Johansson, Rantzer and Astrom 1999).
"""

import numpy as np
import pytest
from scipy import signal

import eppanalysis as epp


def _turned(num, den, element, seed):
    A, B, C, _ = signal.tf2ss(num, den)
    r = np.random.default_rng(seed)
    Q = np.linalg.qr(r.normal(size=A.shape))[0] @ np.diag(10.0 ** r.uniform(-1.0, 1.0, len(A)))
    inverse = np.linalg.inv(Q)
    return epp.LureSystem.from_tf(signal.StateSpace(inverse @ A @ Q, inverse @ B, C @ Q, 0.0), element)


@pytest.mark.parametrize("element", [epp.Relay(), epp.Preload(level=0.33, slope=0.5)])
@pytest.mark.parametrize(
    ("num", "den"), [([1.0], [1.0, 1.0, 0.0]), ([6.7], [1.0, 4.2, 1.57]), ([5.5, 5.8], [1.0, 2.3, 1.74, 0.37])]
)
def test_switches_that_come_ever_faster_about_rest_settle(num, den, element):
    for loop in (epp.LureSystem.from_tf((num, den), element), _turned(num, den, element, 3)):
        found = epp.find_limit_cycles(loop)
        assert found.status is epp.Status.CONVERGED and not found.cycles and not found.diverges


@pytest.mark.parametrize("seed", range(4))
def test_swings_shrink_by_the_sign_of_the_third_derivative(seed):
    r = np.random.default_rng(seed)
    poles, zero = 10.0 ** r.uniform(-0.3, 0.7, 3), 10.0 ** r.uniform(-0.3, 0.5)
    shrinks = []
    for b1 in (zero, 3.0 * poles.sum()):
        found = epp.find_limit_cycles(epp.LureSystem.from_tf(([1.0, b1], np.poly(-poles)), epp.Relay()))
        shrinks.append(found.settles)
        assert found.settles != bool(found.stable), b1
    assert shrinks == [bool(zero < poles.sum()), False]


def test_a_relay_before_a_stable_plant_does_not_grow_without_bound():
    """Beside its cycle turns grow by 1.3 % each, about an output that does not: at other sizes they grow by others."""
    plant = [0.6783498692808216, 3.859265402295382], [1.0, 5.365911621186344, 23.52856527104356, 30.27475717099214]
    found = epp.find_limit_cycles(epp.LureSystem.from_tf(plant, epp.Relay()))
    assert not found.diverges and len(found.stable) == 1


def test_a_run_that_used_up_its_events_settles():
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Relay(), x0=[0.3, 0.3])
    assert epp.simulate(loop, t_end=40.0).status is epp.Status.EVENT_LIMIT
    run = epp.simulate(loop, t_end=40.0, decide=True)
    assert run.status is epp.Status.SETTLED and str(run) == "Settles at rest."
    # Without damping each motion repeats itself.
    free = epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), epp.Relay(), x0=[0.3, 0.3])
    assert epp.simulate(free, t_end=40.0, decide=True).limit_cycle is not None
