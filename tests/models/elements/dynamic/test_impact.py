"""Stops with restitution: the periodic motion with one impact in closed form, and runs against another integrator."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError

ZETA, OMEGA, LIMIT, E = 0.1, 2.7, 0.2, 0.6


def oscillator(stop: epp.ImpactStop, **options: Any) -> epp.LureSystem:
    """A mass of 2 kg on a spring, with a natural frequency of 1 rad/s, driven by an acceleration."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -2.0 * ZETA]], [[0.0], [1.0 / stop.mass]], np.eye(2), [stop], B_input=[[0.0], [1.0]],
        input_names=["push"], element_names=["stop"], **options,
    )  # fmt: skip


def one_impact(push: float) -> tuple[float, float]:
    """Speed before the impact and phase of the sine at it, of the motion that repeats itself after one period.

    Shaw and Holmes 1983: between impacts a free vibration and the forced one, all of it affine in that speed.
    """
    damped, period = np.sqrt(1.0 - ZETA**2), 2.0 * np.pi / OMEGA
    c, s = np.exp(-ZETA * period) * np.array([np.cos(damped * period), np.sin(damped * period)])
    # Of x = p cos(w t) - q sin(w t) + exp(-zeta t) (A cos(d t) + B sin(d t)), at both ends.
    rows = np.array([
        [1.0, 0.0, 1.0, 0.0],
        [1.0, 0.0, c, s],
        [0.0, -OMEGA, -ZETA, damped],
        [0.0, -OMEGA, -ZETA * c - damped * s, damped * c - ZETA * s],
    ])  # fmt: skip
    rest, slope = np.linalg.solve(rows, np.array([[LIMIT, LIMIT, 0.0, 0.0], [0.0, 0.0, -E, 1.0]]).T).T
    response = push / complex(1.0 - OMEGA**2, 2.0 * ZETA * OMEGA)
    size = slope[:2] @ slope[:2], 2.0 * rest[:2] @ slope[:2], rest[:2] @ rest[:2] - abs(response) ** 2
    speed = float(max(np.roots(size).real))
    p, q = rest[:2] + speed * slope[:2]
    # p + j q is the response to a sine turned by its phase.
    return speed, float(np.angle(complex(p, q) / (response / 1j)))


def test_the_periodic_motion_with_one_impact_is_that_in_closed_form() -> None:
    speed, phase = one_impact(3.0)
    period = 2.0 * np.pi / OMEGA
    loop = oscillator(epp.ImpactStop(-9.0, LIMIT, 2.0, E), x0=[LIMIT, -E * speed])
    sine = epp.inputs.Sine(3.0, 1.0 / period, phase=phase)
    run = epp.simulate(loop, sine, t_end=12.5 * period, t_eval=period * np.arange(0.5, 12.5))
    hits = [event.time for event in run.events if event.name == "hits the upper limit"]
    np.testing.assert_allclose(hits, period * np.arange(1, 13), atol=1e-8)
    np.testing.assert_allclose(run.signals["stop_input"], run.signals["stop_input"][0], atol=1e-8)


def test_the_impact_oscillator_of_a_book() -> None:
    """Dankowicz and Schilder, Recipes for Continuation 2013, Example 15.2, with the numbers of its program.

    ``k, c, A, w, d, e = 1, 0.1, 1, 1, 1, 0.8``: behind the impact at 1 the speed is -1.36, at a phase of 0.076 of the
    cosine that drives it.
    """
    stop = epp.ImpactStop(-9.0, 1.0, 1.0, 0.8)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.1]], [[0.0], [1.0]], np.eye(2), [stop], B_input=[[0.0], [1.0]], input_names=["push"],
        element_names=["stop"], x0=[0.5, 0.0],
    )  # fmt: skip
    drive = epp.inputs.Sine(1.0, 1.0 / (2.0 * np.pi), phase=np.pi / 2.0)
    run = epp.simulate(loop, drive, t_end=500.0)
    hit = [event.time for event in run.events if event.name == "hits the upper limit"][-1]
    phase = float(np.remainder(hit, 2.0 * np.pi))
    assert phase == pytest.approx(0.076, abs=5e-4)
    # From just behind the impact on, at this phase and with that speed, to the next impact.
    there = replace(loop, x0=[1.0, -1.36])
    again = epp.simulate(there, replace(drive, phase=np.pi / 2.0 + phase), t_end=7.0)
    (time,) = (event.time for event in again.events if event.name.startswith("hits"))
    assert time == pytest.approx(2.0 * np.pi, abs=0.01)


@pytest.mark.parametrize(("lower", "restitution"), [(-9.0, 0.9), (-0.4, 0.9)])
def test_twenty_impacts_against_another_integrator(lower: float, restitution: float) -> None:
    stop = epp.ImpactStop(lower, LIMIT, 2.0, restitution)
    times = np.linspace(0.0, 40.0, 161)
    run = epp.simulate(oscillator(stop), epp.inputs.Sine(3.0, OMEGA / (2 * np.pi)), t_end=40.0, t_eval=times)

    def rates(t: float, x: Any) -> list[float]:
        return [x[1], -x[0] - 2.0 * ZETA * x[1] + 3.0 * np.sin(OMEGA * t)]

    def reaches(limit: float, way: float) -> Any:
        def event(t: float, x: Any) -> float:
            return float(way * (x[0] - limit))

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        return event

    t, x, found, count = 0.0, np.zeros(2), [], 0
    while count < 100:
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02, "dense_output": True}
        part = solve_ivp(rates, (t, 40.0), x, events=[reaches(LIMIT, 1.0), reaches(lower, -1.0)], **options)
        inside = times[(times >= t) & ((times < part.t[-1]) | (part.status == 0))]
        found += part.sol(inside)[0].tolist() if inside.size else []
        if part.status == 0:
            break
        t, x, count = part.t[-1], part.y[:, -1] * [1.0, -restitution], count + 1
    hits = [event for event in run.events if event.name.startswith("hits")]
    assert len(hits) == count >= 16
    np.testing.assert_allclose(run.signals["stop_input"], found, atol=1e-8)


def test_a_mass_that_is_pressed_against_a_stop_ends_in_a_sentence() -> None:
    loop = oscillator(epp.ImpactStop(-9.0, LIMIT, 2.0, 0.5), v0=[1.0])
    run = epp.simulate(loop, t_end=60.0)
    assert "its switches accumulate there, as the time between them shrinks to nothing" in str(run)
    assert run.signals["stop_input"].max() <= LIMIT + 1e-12 and run.limit_cycle is None
    assert run.signals["stop_input"][-1] == pytest.approx(LIMIT, abs=1e-4)


def test_a_start_at_a_limit_or_beyond_it() -> None:
    leaving = epp.simulate(oscillator(epp.ImpactStop(-9.0, LIMIT, 2.0, E), x0=[LIMIT, -0.1]), t_end=0.1)
    assert leaving.signals["stop_input"].max() <= LIMIT
    beyond = epp.simulate(oscillator(epp.ImpactStop(-9.0, LIMIT, 2.0, E), x0=[0.3, 0.5]), t_end=0.1)
    assert beyond.signals["stop_input"].max() <= 0.3 + 1e-12


def test_values() -> None:
    stop = epp.ImpactStop(-1.0, 2.0, 3.0, 0.5)
    assert stop == pickle.loads(pickle.dumps(stop)) and stop.linear_gain().tolist() == [[0.0, 0.0]]
    assert stop.slope_bounds() == stop.sector() == (-np.inf, np.inf)
    for make, words in (
        (lambda: epp.ImpactStop(1.0, 1.0, 1.0), r"ImpactStop: lower is 1.0; expected less than upper \(1.0\)"),
        (lambda: epp.ImpactStop(0.0, 1.0, 0.0), "mass is 0.0; expected a positive number"),
        (lambda: epp.ImpactStop(0.0, 1.0, 1.0, 1.5), "restitution is 1.5; expected 0 to 1"),
        (lambda: epp.ImpactStop(0.0, np.inf, 1.0), "upper is inf; expected a finite number"),
        (lambda: stop.describing_function(1.0), "so that it has no describing function; expected a run"),
        (lambda: epp.predict_limit_cycles(oscillator(stop)), "so that it has no describing function; expected a run"),
    ):
        with pytest.raises(ModelError, match=words):
            make()


def test_a_case_file_keeps_fields() -> None:
    loop = oscillator(epp.ImpactStop(-1.0, 2.0, 3.0, 0.5), x0=[0.1, 0.0])
    again = epp.case_from_text(epp.Case.from_system(loop, input=epp.inputs.Constant(0.0)).to_toml()).to_system()
    assert again.elements == loop.elements
