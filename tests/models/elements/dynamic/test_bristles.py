"""LuGre's friction: its describing function against integration, its limits, and loops against another integrator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError

SOFT = epp.LuGreFriction(stiffness=400.0, coulomb=0.5, static=0.8, velocity=0.05, damping=5.0, viscous=0.1)


def steady(f: Any, v: Any) -> Any:
    """The Stribeck curve without its viscous part."""
    return f.coulomb + (f.static - f.coulomb) * np.exp(-((v / f.velocity) ** 2))


def by_integration(f: Any, a: float, b: float, w: float) -> tuple[float, complex]:
    """Mean and gain by integrating the bristles' force from reversal to reversal, until it repeats."""
    beta = float(np.arcsin(np.clip(b / a, -1, 1)))
    turns = [-beta, np.pi + beta, 2 * np.pi - beta]

    def rates(phi: float, x: Any) -> list[float]:
        v = b + a * np.sin(phi)
        rate = f.stiffness / w * (v - abs(v) * x[0] / steady(f, v))
        return [rate, x[0], x[0] * np.sin(phi), x[0] * np.cos(phi)]

    force = 0.0
    for _ in range(100):
        x = np.array([force, 0.0, 0.0, 0.0])
        for begin, end in zip(turns, turns[1:], strict=False):
            x = solve_ivp(rates, (begin, end), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        if abs(x[0] - force) < 1e-13 * f.coulomb:
            bristles = complex(x[2], x[3]) / (np.pi * a) * (1 + 1j * w * f.damping / f.stiffness)
            return x[1] / (2 * np.pi) + f.viscous * b, bristles + f.viscous
        force = x[0]
    raise AssertionError("it does not repeat")


@settings(max_examples=4, deadline=None)
@given(st.floats(1.0, 60.0), st.floats(-0.95, 0.95), st.floats(0.5, 3.0), st.floats(0.05, 20.0))
@example(40.0, 0.0, 1.0, 10.0)
@example(5.0, 1.3, 2.0, 2.0)
def test_mean_and_gain_match_integration(reach: float, share: float, omega: float, quick: float) -> None:
    """`reach` is how often the amplitude of the way is the presliding distance, `quick` that of the velocity."""
    coulomb, a = 2.0, 0.4
    friction = epp.LuGreFriction(reach * coulomb * omega / a, coulomb, 1.6 * coulomb, a / quick, 0.3, 0.7)
    found = friction.describing_function(a, share * a, omega)
    mean, gain = by_integration(friction, a, share * a, omega)
    assert abs(float(found[0]) - mean) < 1e-9 * coulomb
    assert abs(complex(found[1]) - gain) < 1e-9 * coulomb / a


def test_limits() -> None:
    amplitude, bias = np.array([0.02, 0.1, 3.0]), np.array([0.0, 0.03, -1.0])
    stiff = epp.LuGreFriction(1e11, 1.5, 2.0, 0.1, 0.0, 0.4).describing_function(amplitude, bias, 2.0)
    plain = epp.StribeckFriction(1.5, 2.0, 0.1, 0.4).describing_function(amplitude, bias)
    # The force reverses within a phase of this size behind the velocity.
    late = np.sqrt(2 * 2.0 * 2.0 / (1e11 * amplitude))
    assert np.all(np.abs(stiff.mean - plain.mean) < 2 * 2.0 * late)
    assert np.all(np.abs(stiff.gain - plain.gain) < 2 * 4 * 2.0 / (np.pi * amplitude) * late)
    dahl = epp.DahlFriction(30.0, 1.5).describing_function(amplitude, bias, 2.0)
    for one, other in zip(
        epp.LuGreFriction(30.0, 1.5, 1.5, 0.1).describing_function(amplitude, bias, 2.0), dahl, strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-11)
    still = epp.LuGreFriction(30.0, 1.5, 2.0, 0.1).describing_function([0.02, 3.0], 0.0, 0.0)[1]
    np.testing.assert_allclose(
        still, epp.StribeckFriction(1.5, 2.0, 0.1).describing_function([0.02, 3.0])[1], rtol=1e-9
    )
    small = epp.LuGreFriction(30.0, 1.5, 2.0, 0.1, 0.2, 0.4).describing_function(1e-9, 0.0, 2.0)[1]
    assert complex(small) == pytest.approx(30.0 / 2j + 0.6, rel=1e-7)


def test_steady_motion_is_on_the_stribeck_curve() -> None:
    friction, curve = SOFT, epp.StribeckFriction(SOFT.coulomb, SOFT.static, SOFT.velocity, SOFT.viscous)
    speeds = np.array([-0.4, -0.02, 0.003, 0.05, 2.0])
    mean = friction.describing_function(0.0, speeds, 1.0)[0]
    np.testing.assert_allclose(mean, curve.output(speeds)[0], rtol=1e-8)


def test_mirrored_and_rescaled_it_is_the_same() -> None:
    amplitude, bias = np.array([0.01, 0.3, 4.0]), np.array([0.002, -0.1, 5.0])
    one = SOFT.describing_function(amplitude, bias, 2.0)
    mirror = SOFT.describing_function(amplitude, -bias, 2.0)
    # Velocities three times, forces seven times, time a fifth.
    other = epp.LuGreFriction(400.0 * 7 / 3 * 5, 3.5, 5.6, 0.15, 5.0 * 7 / 3, 0.1 * 7 / 3)
    scaled = other.describing_function(3 * amplitude, 3 * bias, 10.0)
    np.testing.assert_allclose(mirror.mean, -one.mean, rtol=1e-9)
    np.testing.assert_allclose(mirror.gain, one.gain, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(scaled.mean, 7 * one.mean, rtol=1e-9)
    np.testing.assert_allclose(scaled.gain, 7 / 3 * one.gain, rtol=1e-9, atol=1e-12)


def body(friction: epp.Nonlinearity, **more: Any) -> epp.LureSystem:
    """A mass of 1 kg on a spring of 4 N/m."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [-4.0, 0.0]], [[0.0], [-1.0]], [[0.0, 1.0]], [friction], element_names=["friction"], **more
    )


@pytest.mark.parametrize("f", [SOFT, epp.LuGreFriction(4e4, 0.5, 0.8, 0.01, 50.0, 0.3)])
def test_a_driven_body_against_another_integrator(f: Any) -> None:
    """Velocity and force, the last sample too; and what it remembers is the bristles' force."""
    times = np.linspace(0.0, 3.0, 61)
    loop = body(f, B_input=[[0.0], [1.0]], input_names=["push"], x0=[0.3, 0.05], memory=[0.2])
    run = epp.simulate(loop, epp.inputs.Sine(1.2, 0.4), t_end=3.0, t_eval=times)

    def rate(x: Any) -> Any:
        return f.stiffness * (x[1] - abs(x[1]) * x[2] / steady(f, x[1]))

    def force(x: Any) -> Any:
        return x[2] + f.damping / f.stiffness * rate(x) + f.viscous * x[1]

    def rates(t: float, x: Any) -> list[float]:
        return [x[1], -4.0 * x[0] - force(x) + 1.2 * np.sin(0.8 * np.pi * t), rate(x)]

    options = {"method": "LSODA", "rtol": 1e-12, "atol": 1e-14, "t_eval": times}
    expected = solve_ivp(rates, (0.0, 3.0), [0.3, 0.05, 0.2], **options).y
    np.testing.assert_allclose(run.signals["friction_input"], expected[1], atol=1e-9)
    np.testing.assert_allclose(run.signals["friction_output"], force(expected), atol=1e-8)


def test_without_dampers_and_a_falling_part_it_is_dahls() -> None:
    times = np.linspace(0.0, 5.0, 51)
    runs = [
        epp.simulate(body(f, x0=[1.0, 0.0]), t_end=5.0, t_eval=times).signals["friction_output"]
        for f in (epp.DahlFriction(50.0, 0.5), epp.LuGreFriction(50.0, 0.5, 0.5, 0.1))
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    # By way of the falling part, which is next to none.
    nearly = epp.simulate(body(epp.LuGreFriction(50.0, 0.5, 0.5 * (1 + 1e-13), 0.1), x0=[1.0, 0.0]), t_end=5.0,
                          t_eval=times)  # fmt: skip
    np.testing.assert_allclose(nearly.signals["friction_output"], runs[0], atol=1e-11)


def belt(friction: epp.Nonlinearity, x0: tuple[float, float]) -> epp.LureSystem:
    """The body on a belt that runs at 0.05 m/s."""
    return body(friction, constant_input=[-0.05], x0=x0)


def test_stick_slip_on_a_belt_is_an_orbit() -> None:
    """Run and exact orbit are the same motion, and its multiplier is that of a disturbed run."""
    run = epp.simulate(belt(SOFT, (0.3, 0.0)), t_end=80.0)
    assert run.limit_cycle is not None
    orbit = epp.exact_orbit(belt(SOFT, (0.3, 0.0)), run.limit_cycle)
    assert orbit.period == pytest.approx(run.limit_cycle.period, rel=1e-9) and orbit.stable is True
    start = np.asarray(orbit.state)[:3]
    # Central differences are off by the square of their step, which the bristles magnify. All runs take the same steps.
    moved = 1e-6 * np.eye(3)
    starts = start[:, None] + np.hstack([np.zeros((3, 1)), moved, -moved])

    def rates(t: float, x: Any) -> Any:
        x = x.reshape(starts.shape)
        v = x[1] - 0.05
        rate = SOFT.stiffness * (v - abs(v) * x[2] / steady(SOFT, v))
        pull = -4.0 * x[0] - x[2] - SOFT.damping / SOFT.stiffness * rate - SOFT.viscous * v
        return np.array([x[1], pull, rate]).ravel()

    ends = solve_ivp(rates, (0.0, orbit.period), starts.ravel(), method="LSODA", rtol=1e-12, atol=1e-14).y[:, -1]
    ends = ends.reshape(starts.shape)
    np.testing.assert_allclose(ends[:, 0], start, atol=1e-8)
    found = np.linalg.eigvals((ends[:, 1:4] - ends[:, 4:]) / 2e-6)
    found = found[np.argsort(-np.abs(found))]
    assert found[0] == pytest.approx(1.0, abs=1e-3)
    multipliers = orbit.multipliers[np.argsort(-np.abs(orbit.multipliers))]
    assert found[1] == pytest.approx(multipliers[0], abs=1e-3)


def test_values() -> None:
    assert SOFT.output_is == "force" and SOFT.sticks_and_slips and SOFT.linear_gain() == [[0.1]]
    assert SOFT.output(0.2, 0.3)[0] == pytest.approx(
        0.3 + 5.0 * (0.2 - 0.2 * 0.3 / steady(SOFT, 0.2)) + 0.1 * 0.2, rel=1e-14
    )
    assert SOFT.slope_bounds() == SOFT.sector() == (-np.inf, np.inf)
    mean, gain = SOFT.describing_function([np.nan, 1.0], 0.0, 1.0)
    assert np.isnan(mean[0]) and np.isnan(gain[0]) and np.isfinite(gain[1])
    good = {"stiffness": 1.0, "coulomb": 1.0, "static": 1.0, "velocity": 1.0}
    for fields, words in (
        ({"stiffness": 0.0}, "LuGreFriction: stiffness is 0.0; expected a positive number"),
        ({"static": 0.5}, r"LuGreFriction: static is 0.5; expected at least coulomb \(1.0\)"),
        ({"damping": -1.0}, "LuGreFriction: damping is -1.0; expected zero or more"),
    ):
        with pytest.raises(ModelError, match=words):
            epp.LuGreFriction(**(good | fields))
    with pytest.raises(ModelError, match="frequency of a describing function is -1.0"):
        SOFT.describing_function(1.0, 0.0, -1.0)


@pytest.mark.slow
def test_a_prediction_says_that_such_a_loop_may_hunt() -> None:
    """A positioning servo with integral action, whose friction falls with speed: first order sees no cycle."""
    friction = epp.LuGreFriction(2000.0, 1.0, 1.6, 0.02, damping=20.0, viscous=0.1)
    servo = epp.LureSystem.build(
        [[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [3.0, -4.0, -1.0]], [[0.0], [0.0], [-1.0]], [[0.0, 0.0, 1.0]], [friction],
        B_input=[[1.0], [0.0], [4.0]], input_names=["r"], v0=[1.0], element_names=["friction"],
    )  # fmt: skip
    assert "the loop may hunt" in str(epp.predict_limit_cycles(servo))
