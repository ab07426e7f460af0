"""Dahl's friction: its describing function against integration over the way, and loops against another integrator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError


def by_integration(a: float, b: float, w: float, stiffness: float, coulomb: float) -> tuple[float, complex]:
    """Mean and gain by integrating the force over periods, phase by phase, until it repeats."""
    beta = float(np.arcsin(b / a))
    turns = [-beta, np.pi + beta, 2 * np.pi - beta]

    def rates(phi: float, v: Any) -> list[float]:
        u = b + a * np.sin(phi)
        force = stiffness / w * (u - abs(u) * v[0] / coulomb)
        return [force, v[0], v[0] * np.sin(phi), v[0] * np.cos(phi)]

    force = 0.0
    for _ in range(60):
        v = np.array([force, 0.0, 0.0, 0.0])
        for begin, end in zip(turns, turns[1:], strict=False):
            v = solve_ivp(rates, (begin, end), v, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        if abs(v[0] - force) < 1e-13 * coulomb:
            return v[1] / (2 * np.pi), complex(v[2], v[3]) / (np.pi * a)
        force = v[0]
    raise AssertionError("it does not repeat")


@settings(max_examples=6, deadline=None)
@given(st.floats(0.3, 30.0), st.floats(-0.9, 0.9), st.floats(0.2, 4.0))
@example(100.0, 0.0, 1.0)
@example(1.0, 0.97, 2.0)
def test_mean_and_gain_match_integration(reach: float, share: float, omega: float) -> None:
    """`reach` is how often the amplitude of the way is the presliding distance."""
    coulomb, amplitude = 2.0, 0.4
    stiffness = reach * coulomb * omega / amplitude
    found = epp.DahlFriction(stiffness, coulomb).describing_function(amplitude, share * amplitude, omega)
    mean, gain = by_integration(amplitude, share * amplitude, omega, stiffness, coulomb)
    assert abs(float(found[0]) - mean) < 1e-9 * coulomb
    assert abs(complex(found[1]) - gain) < 1e-9 * coulomb / amplitude


def test_limits() -> None:
    stiff = epp.DahlFriction(1e12, 1.5).describing_function([0.1, 3.0], [0.03, -1.0], 2.0)
    plain = epp.Coulomb(1.5).describing_function([0.1, 3.0], [0.03, -1.0])
    for one, other in zip(stiff, plain, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-4)
    soft = epp.DahlFriction(3.0, 1.5).describing_function(1e-9, 0.0, 2.0)[1]
    assert complex(soft) == pytest.approx(3.0 / 2j, rel=1e-8)
    mean, gain = epp.DahlFriction(3.0, 1.5).describing_function(1.0, [-1.0, 1.2], 2.0)
    assert mean.tolist() == [-1.5, 1.5] and gain.tolist() == [0.0, 0.0]


def test_the_describing_function_depends_on_the_way_alone() -> None:
    friction, amplitude = epp.DahlFriction(50.0, 2.0), np.array([0.01, 0.3, 4.0])
    slow, fast = (friction.describing_function(amplitude * k, 0.2 * k * amplitude, 3.0 * k) for k in (1.0, 7.0))
    np.testing.assert_allclose(slow[0], fast[0], rtol=1e-12)
    np.testing.assert_allclose(slow[1], 7.0 * fast[1], rtol=1e-12)


def test_a_body_on_a_spring_against_another_integrator() -> None:
    """A mass of 1 kg on a spring, with Dahl's friction, driven; and what it remembers is the force."""
    friction = epp.DahlFriction(400.0, 0.5)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-4.0, 0.0]], [[0.0], [-1.0]], [[0.0, 1.0]], [friction], B_input=[[0.0], [1.0]],
        input_names=["push"], x0=[0.3, 0.05], memory=[0.2], element_names=["friction"],
    )  # fmt: skip
    times = np.linspace(0.0, 6.0, 121)
    run = epp.simulate(loop, epp.inputs.Sine(1.2, 0.4), t_end=6.0, t_eval=times)

    def rates(t: float, v: Any) -> list[float]:
        push = 1.2 * np.sin(0.8 * np.pi * t)
        return [v[1], -4.0 * v[0] - v[2] + push, 400.0 * (v[1] - abs(v[1]) * v[2] / 0.5)]

    t, v, found = 0.0, np.array([0.3, 0.05, 0.2]), []

    def stops(t: float, v: Any) -> float:
        return float(v[1])

    stops.terminal = True  # type: ignore[attr-defined]
    while True:
        # What DOP853 gives between its steps is less accurate than these: short ones.
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True, "max_step": 0.01}
        part = solve_ivp(rates, (t, 6.0), v, events=stops, **options)
        inside = times[(times >= t) & ((times < part.t[-1]) | (part.status == 0))]
        found.append(part.sol(inside) if inside.size else np.zeros((3, 0)))
        if part.status == 0:
            break
        t, v = part.t[-1] + 1e-10, part.y[:, -1] + 1e-10 * np.array(rates(part.t[-1], part.y[:, -1]))
    expected = np.hstack(found)
    np.testing.assert_allclose(run.signals["friction_input"], expected[1], atol=1e-8)
    np.testing.assert_allclose(run.signals["friction_output"], expected[2], atol=1e-8)


def test_values() -> None:
    friction = epp.DahlFriction(2.0, 3.0)
    assert friction.output_is == "force" and friction.linear_gain() == [[0.0]]
    assert friction.slope_bounds() == friction.sector() == (-np.inf, np.inf)
    assert np.isnan(friction.describing_function([np.nan, 1.0], 0.0, 1.0)[1][0])
    for make, words in (
        (lambda: epp.DahlFriction(0.0, 1.0), "DahlFriction: stiffness is 0.0; expected a positive number"),
        (lambda: epp.DahlFriction(1.0, -1.0), "DahlFriction: coulomb is -1.0; expected a positive number"),
        (lambda: friction.describing_function(1.0, 0.0, -1.0), "frequency of a describing function is -1.0"),
    ):
        with pytest.raises(ModelError, match=words):
            make()


def test_a_cycle_against_its_run() -> None:
    """A spring with negative damping, a cube and Dahl's friction: exact orbit and run are the same motion."""
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, 0.8]], [[0.0, 0.0], [-1.0, -1.0]], [[0.0, 1.0], [0.0, 1.0]],
        [epp.Cube(0.5), epp.DahlFriction(20.0, 0.2)], x0=[1.5, 0.0], element_names=["cube", "dahl"],
    )  # fmt: skip
    run = epp.simulate(loop, t_end=80.0)
    assert run.limit_cycle is not None
    orbit = epp.exact_orbit(loop, run.limit_cycle)
    assert orbit.period == pytest.approx(run.limit_cycle.period, rel=1e-9) and orbit.stable is True
