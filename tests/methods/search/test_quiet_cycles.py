"""Cycles on which no element switches in a loop in which one could: stops that are not touched, friction that slips."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import eppanalysis as epp

#: Period and half swing of x of Van der Pol's oscillator, mu = 1 (an independent integrator).
_PERIOD, _AMPLITUDE = 6.6632868593231365, 2.008619860874843


def _van_der_pol(stop: float) -> epp.LureSystem:
    """Van der Pol's oscillator between springs that begin at `stop`."""
    return epp.Diagram(
        parts={
            "oscillator": epp.blocks.TransferFunction(num=[1.0, 0.0], den=[1.0, -1.0, 1.0]),
            "damping": epp.Polynomial([0.0, 0.0, 0.0, 1.0 / 3.0]),
            "stops": epp.DeadZone(lower=-stop, upper=stop, slope=10.0),
        },
        connect=["-damping - stops -> oscillator", "oscillator -> damping, stops"],
    ).to_system()


@pytest.mark.parametrize("stop", [2.3, pytest.param(50.0, marks=pytest.mark.slow)])
def test_a_stop_that_is_not_touched_changes_no_cycle(stop: float) -> None:
    loop = _van_der_pol(stop)
    found = epp.find_limit_cycles(loop)
    assert found.status is epp.Status.CONVERGED
    assert len(found) == 1
    run = epp.simulate(replace(loop, x0=np.array([0.1, 0.0])), t_end=150.0)
    assert run.status is epp.Status.LIMIT_CYCLE
    exact = epp.exact_orbit(loop, epp.predict_limit_cycles(loop)[0])
    for cycle, tolerance in ((found[0], 1e-9), (exact, 1e-9), (run.limit_cycle, 1e-6)):
        assert cycle is not None
        assert cycle.stable is not False
        assert cycle.period == pytest.approx(_PERIOD, rel=tolerance)
        assert cycle.peak_to_peak["oscillator"] / 2.0 == pytest.approx(_AMPLITUDE, rel=tolerance)
    # The events of the list are those of elements.
    assert not len(exact.events)


def _slipping_return(amplitude: float) -> tuple[float, float]:
    """Next maximum of x, and when, of a block on a belt that slips all the time, begun at a maximum."""

    def rates(_: float, s: np.ndarray) -> list[float]:
        v = s[1] - 0.5
        friction = (0.6 + 0.4 * np.exp(-((v / 0.2) ** 2))) * np.sign(v) + 0.05 * v
        return [s[1], -s[0] - 0.02 * s[1] - friction]

    def at_maximum(t: float, s: np.ndarray) -> float:
        return s[1] if t > 1.0 else -1.0

    at_maximum.direction, at_maximum.terminal = -1.0, True  # type: ignore[attr-defined]
    run = solve_ivp(rates, (0.0, 20.0), [amplitude, 0.0], "DOP853", events=at_maximum, rtol=1e-12, atol=1e-14)
    return float(run.y[0, -1]), float(run.t[-1])


@pytest.mark.slow
def test_an_unstable_cycle_that_slips_all_the_time_is_found() -> None:
    block = epp.Diagram(
        parts={
            "block": epp.blocks.Mass(mass=1.0, damping=0.02, stiffness=1.0, start=[1.0, 0.0]),
            "friction": epp.StribeckFriction(coulomb=0.6, static=1.0, velocity=0.2, viscous=0.05),
            "belt": epp.blocks.Constant(value=0.5),
        },
        connect=["block.speed - belt -> friction", "-friction -> block.force"],
        signals={"x": "block.position"},
    ).to_system()
    top = brentq(lambda x: _slipping_return(x)[0] - x, 0.75, 0.9, xtol=1e-13)
    found = epp.find_limit_cycles(block)
    assert found.status is epp.Status.CONVERGED
    assert [cycle.stable for cycle in found] == [False, True]
    assert found[0].period == pytest.approx(_slipping_return(top)[1], rel=1e-9)
    low, high = found[0].mean["x"], found[0].peak_to_peak["x"]
    assert low < top < low + high
