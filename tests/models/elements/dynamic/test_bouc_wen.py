"""Hysteresis of Bouc and Wen: its describing function against integration and a closed form, loops against another
integrator.
"""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError


def integrated(rates: Any, begin: float, end: float, v: Any, *signs: int, at: Any = ()) -> tuple[Any, Any]:
    """End of a motion and its values at times; where a sign that the rates hang on changes, it begins anew."""

    def event(i: int) -> Any:
        def passes(t: float, v: Any) -> float:
            return float(v[i])

        passes.terminal = True
        return passes

    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 0.02, "dense_output": True}
    at, found = np.asarray(at, float), []
    while True:
        part = solve_ivp(rates, (begin, end), v, events=[event(i) for i in signs], **options)
        begin, v = part.t[-1], part.y[:, -1]
        inside = at[(at >= part.t[0]) & ((at < begin) | (part.status == 0))]
        found += list(part.sol(inside).T) if inside.size else []
        if part.status == 0:
            return v, np.array(found)
        step = min(1e-10, end - begin)
        begin, v = begin + step, v + step * np.array(rates(begin, v))


def by_integration(spring: epp.BoucWen, a: float, b: float, w: float) -> tuple[float, complex]:
    """Mean and gain by integrating the force over periods until it repeats."""
    beta = float(np.arcsin(b / a))
    turns = [-beta, np.pi + beta, 2 * np.pi - beta]

    def rates(phi: float, v: Any) -> list[float]:
        u, f = b + a * np.sin(phi), v[0]
        force = (spring.stiffness * u - spring.beta * abs(u) * f - spring.gamma * u * abs(f)) / w
        return [force, f, f * np.sin(phi), f * np.cos(phi)]

    force = 0.0
    for _ in range(60):
        v = np.array([force, 0.0, 0.0, 0.0])
        for begin, end in zip(turns, turns[1:], strict=False):
            v, _ = integrated(rates, begin, end, v, 0)
        if abs(v[0] - force) < 1e-12 * spring.stiffness / (spring.beta + spring.gamma):
            return v[1] / (2 * np.pi), complex(v[2], v[3]) / (np.pi * a)
        force = v[0]
    raise AssertionError("it does not repeat")


@settings(max_examples=1, deadline=None)
@given(st.floats(0.5, 6.0), st.floats(-0.8, 0.8), st.floats(-0.8, 2.0))
@example(4.0, 0.0, 1.0)
@example(2.0, 0.95, -0.6)
def test_mean_and_gain_match_integration(reach: float, share: float, skew: float) -> None:
    """`reach` is beta times the amplitude of the way, `skew` gamma over beta."""
    amplitude, omega, beta = 0.4, 1.5, 3.0
    spring = epp.BoucWen(7.0, beta * reach, beta * reach * skew)
    found = spring.describing_function(amplitude, share * amplitude, omega)
    mean, gain = by_integration(spring, amplitude, share * amplitude, omega)
    bound = 7.0 / (beta * reach * (1 + skew))
    assert abs(float(found[0]) - mean) < 1e-9 * bound
    assert abs(complex(found[1]) - gain) < 1e-9 * bound / amplitude


@pytest.mark.parametrize("size", [0.02, 0.5, 4.0])
def test_energy_of_a_loop_with_straight_unloading(size: float) -> None:
    """With beta = gamma it unloads along a line: the energy of a period, of the gain's real part, is elementary.

    The numbers are the defaults of the curve "Bouc_wen" in the manual of SeismoStruct 2025: 210 kN/m, A = 1,
    beta = gamma = 0.5, exponent 1, in units of the deflection.
    """
    stiffness, p, omega = 210e3, 1.0, 3.0
    bound = stiffness / p
    high = brentq(lambda f: f / stiffness - np.log1p(-f / bound) / p - 2 * size, 0.0, bound * (1 - 1e-15), xtol=1e-9)
    way = 2 * size - high / stiffness
    energy = 2 * (bound * (way + np.expm1(-p * way) / p) - high**2 / (2 * stiffness))
    _, gain = epp.BoucWen(stiffness, 0.5, 0.5).describing_function(size * omega, 0.0, omega)
    assert float(gain.real) * np.pi * size**2 * omega == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize("gamma", [0.5, 0.0, -0.3])
def test_the_greatest_force_of_a_driven_loop_in_closed_form(gamma: float) -> None:
    """Ikhouane and Rodellar 2005, the forced limit cycle: each half of a period takes it from -F to F.

    ``ln(1 + (beta - gamma) F/k)/(beta - gamma) - ln(1 - (beta + gamma) F/k)/(beta + gamma)`` is twice the size of the
    motion, whatever its course in time; F is never more than ``k/(beta + gamma)`` (Wen 1976).
    """
    k, beta, size, omega = 3.0, 0.5, 1.7, 2.0

    def way(force: float) -> float:
        back, ahead = beta - gamma, beta + gamma
        begins = np.log1p(back * force / k) / back if back else force / k
        return float(begins - np.log1p(-ahead * force / k) / ahead)

    want = brentq(lambda force: way(force) - 2.0 * size, 0.0, k / (beta + gamma) * (1 - 1e-12), xtol=1e-13)
    loop = epp.LureSystem.build(
        [[-1.0]], [[0.0]], [[0.0]], [epp.BoucWen(k, beta, gamma)], D_input=[[1.0]], input_names=["speed"],
        element_names=["spring"],
    )  # fmt: skip
    turns = np.pi / (2.0 * omega) + np.pi / omega * np.arange(40, 60)
    run = epp.simulate(
        loop, epp.inputs.Sine(size * omega, omega / (2 * np.pi), phase=np.pi / 2), t_end=96.0, t_eval=turns
    )
    np.testing.assert_allclose(np.abs(run.signals["spring_output"]), want, rtol=1e-9)


class TestPiezoelectricActuator:
    """Numbers read from params_completo.m of https://github.com/gfloresc/L-CSS-Bouc-Wen (c12f11c), in micrometres.

    Flores and Rakotondrabe 2022: ``lag dx/dt + x = gain u - F`` behind a voltage u, for ``80 sin(0.2 pi t)``.
    """

    LAG, GAIN, STIFFNESS, BETA, SIZE, OMEGA, KP, KI = 1e-3, 1.0773, 0.40648, 0.00833, 80.0, 0.2 * np.pi, 10.0, 0.5
    SINES = {"aim": epp.inputs.Sine(SIZE, 0.1), "slope": epp.inputs.Sine(SIZE * OMEGA, 0.1, phase=np.pi / 2)}

    def loop(self, rig: epp.blocks.StateSpaceBlock) -> epp.Diagram:
        return epp.Diagram(
            parts={"hysteresis": epp.BoucWen(self.STIFFNESS, self.BETA, self.BETA), "rig": rig},
            connect=["aim -> rig.aim", "slope -> rig.slope", "rig.rate -> hysteresis", "hysteresis -> rig.force"],
            inputs=["aim", "slope"],
        )

    def rig(self, A: Any, B: Any, C: Any, D: Any) -> epp.blocks.StateSpaceBlock:
        names = {"input_names": ["aim", "slope", "force"], "output_names": ["x", "rate"]}
        return epp.blocks.StateSpaceBlock(A=A, B=B, C=C, D=D, **names)

    def test_the_force_of_the_open_actuator_in_closed_form(self) -> None:
        """With beta = gamma it returns along a line and nears its bound as an exponential."""
        a, p = self.STIFFNESS, 2.0 * self.BETA
        most = brentq(lambda f: f / a - np.log1p(-p * f / a) / p - 2 * self.SIZE, 0.0, a / p * (1 - 1e-14), xtol=1e-13)
        half = -a / p * np.expm1(-p * (self.SIZE - most / a))
        open_rig = self.rig(
            [[-1.0 / self.LAG]], [[self.GAIN / self.LAG, 0.0, -1.0 / self.LAG]], [[1.0], [0.0]], [[0.0] * 3, [0, 1, 0]]
        )
        run = epp.simulate(self.loop(open_rig), self.SINES, t_end=200.0, t_eval=[190.0, 192.5, 195.0, 197.5])
        np.testing.assert_allclose(run.signals["hysteresis"], [half, most, -half, -most], rtol=1e-9)
        assert most == pytest.approx(20.471234, abs=1e-6)
        # Of the range of x it is so wide.
        assert half / (self.GAIN * self.SIZE - most) == pytest.approx(0.1447, abs=1e-4)

    def test_under_its_controller_against_another_integrator(self) -> None:
        """The rate of the voltage has the force in it, through the rate of x."""
        lag, gain, kp, ki = self.LAG, self.GAIN, self.KP, self.KI
        dx = np.array([-(1.0 + gain * kp) / lag, gain * ki / lag])  # of x and the integral of the error
        rate = -kp * dx - ki * np.array([1.0, 0.0])
        rig = self.rig(
            [dx.tolist(), [-1.0, 0.0]], [[gain * kp / lag, 0.0, -1.0 / lag], [1.0, 0.0, 0.0]],
            [[1.0, 0.0], rate.tolist()], [[0.0] * 3, [ki - kp * gain * kp / lag, kp, kp / lag]],
        )  # fmt: skip
        times = np.linspace(20.0, 30.0, 401)
        run = epp.simulate(self.loop(rig), self.SINES, t_end=30.0, t_eval=times)

        def rates(t: float, y: Any) -> list[float]:
            x, integral, force = y
            error = self.SIZE * np.sin(self.OMEGA * t) - x
            moved = (gain * (kp * error + ki * integral) - force - x) / lag
            v = kp * (self.SIZE * self.OMEGA * np.cos(self.OMEGA * t) - moved) + ki * error
            return [moved, error, self.STIFFNESS * v - self.BETA * (abs(v) * force + v * abs(force))]

        want = solve_ivp(
            rates, (0.0, 30.0), [0.0] * 3, method="Radau", rtol=1e-9, atol=1e-9, t_eval=times, max_step=0.01
        )
        np.testing.assert_allclose(run.signals["rig_x"], want.y[0], rtol=0, atol=1e-6)
        np.testing.assert_allclose(run.signals["hysteresis"], want.y[2], rtol=0, atol=1e-6)
        x = run.signals["rig_x"]
        assert abs(x[200] - x[0]) / np.ptp(x) == pytest.approx(0.024, abs=0.002)


def test_limits() -> None:
    a, b = np.array([1e-3, 0.1, 3.0, 2.0]), np.array([3e-4, 0.05, -1.0, 3.0])
    for one, other in zip(
        epp.BoucWen(100.0, 50.0).describing_function(a, b, 2.0),
        epp.DahlFriction(100.0, 2.0).describing_function(a, b, 2.0), strict=True,
    ):  # fmt: skip
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-13)
    stiff = epp.BoucWen(1.5e12, 0.6e12, 0.4e12).describing_function([0.1, 3.0], [0.03, -1.0], 2.0)
    plain = epp.Coulomb(1.5).describing_function([0.1, 3.0], [0.03, -1.0])
    for one, other in zip(stiff, plain, strict=True):
        np.testing.assert_allclose(one, other, atol=2e-4)
    assert complex(epp.BoucWen(3.0, 1.0, -0.5).describing_function(1e-9, 0.0, 2.0)[1]) == pytest.approx(3.0 / 2j)
    # At first order in the way, beta is damping and gamma softens.
    tiny, small = epp.BoucWen(3.0, 1.0, 0.5).describing_function([0.0, 1e-6], 0.0, 2.0)[1] * 2j / 3.0 - 1.0
    assert abs(tiny) < 1e-15 and complex(small) == pytest.approx(4 / (3 * np.pi) * 0.5e-6 * (1j - 0.5), rel=1e-5)
    _, at_rest = epp.BoucWen(3.0, 1.0, 0.5).describing_function(1.0, 0.0, 0.0)
    assert complex(at_rest) == pytest.approx(4.0 * 2.0 / np.pi)


@pytest.mark.parametrize("gamma", [0.3, -0.4, 0.9])
def test_a_driven_body_against_another_integrator(gamma: float) -> None:
    """A mass of 1 kg on a spring, with the hysteretic force; and what it remembers is the force."""
    spring = epp.BoucWen(1.0, 0.5, gamma)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.02]], [[0.0], [-1.0]], [[0.0, 1.0]], [spring], B_input=[[0.0], [1.0]],
        input_names=["push"], x0=[1.0, 0.2], memory=[-0.3], element_names=["spring"],
    )  # fmt: skip
    times = np.linspace(0.0, 20.0, 81)
    run = epp.simulate(loop, epp.inputs.Sine(1.2, 0.1), t_end=20.0, t_eval=times)

    def rates(t: float, v: Any) -> list[float]:
        push = 1.2 * np.sin(0.2 * np.pi * t)
        force = v[1] - 0.5 * abs(v[1]) * v[2] - gamma * v[1] * abs(v[2])
        return [v[1], -v[0] - 0.02 * v[1] - v[2] + push, force]

    _, expected = integrated(rates, 0.0, 20.0, np.array([1.0, 0.2, -0.3]), 1, 2, at=times)
    assert {"force passes zero", "turns forward", "turns backward"} <= {event.name for event in run.events}
    np.testing.assert_allclose(run.signals["spring_input"], expected[:, 1], atol=1e-8)
    np.testing.assert_allclose(run.signals["spring_output"], expected[:, 2], atol=1e-8)


def test_a_passive_loop_has_no_cycle() -> None:
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.02]], [[0.0], [-1.0]], [[0.0, 1.0]], [epp.BoucWen(1.0, 0.5, 0.3)], x0=[1.0, 0.0]
    )
    assert len(epp.predict_limit_cycles(loop)) == 0
    (margin,) = epp.margins(loop).rule
    assert "the spring that it is at rest" in margin


@pytest.mark.slow
def test_its_cycles_by_two_methods_and_by_runs_beside_the_greater_one() -> None:
    """A body with negative damping: it is more than the loop's area at small motions and again at large ones."""
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, 0.05]],
        [[0.0], [-1.0]],
        [[0.0, 1.0]],
        [epp.BoucWen(2.0, 3.0, 1.0)],
        element_names=["spring"],
    )
    for predicted in epp.predict_limit_cycles(loop):
        orbit = epp.exact_orbit(loop, predicted)
        assert orbit.stable is predicted.stable is (predicted.amplitude("spring_input") < 1.0)
        assert orbit.period == pytest.approx(predicted.period, rel=0.01)
    for share, grows in ((0.95, False), (1.05, True)):
        run = epp.simulate(replace(loop, x0=share * orbit.state), t_end=20 * orbit.period)
        size = np.abs(run.signals["spring_input"])
        assert bool(size[-100:].max() > size[:100].max()) is grows


def test_values() -> None:
    spring = epp.BoucWen(2.0, 3.0, -1.0)
    assert spring == pickle.loads(pickle.dumps(spring)) and spring.output_is == "force"
    assert spring.slope_bounds() == spring.sector() == (-np.inf, np.inf) and spring.linear_gain() == [[0.0]]
    assert np.isnan(spring.describing_function([np.nan, 1.0], 0.0, 1.0)[1]).tolist() == [True, False]
    for make, words in (
        (lambda: epp.BoucWen(0.0, 1.0), "BoucWen: stiffness is 0.0; expected a positive number"),
        (lambda: epp.BoucWen(1.0, 0.0), "BoucWen: beta is 0.0; expected a positive number"),
        (lambda: epp.BoucWen(1.0, 1.0, -1.0), r"BoucWen: gamma is -1.0; expected more than -beta \(1.0\)"),
        (lambda: spring.describing_function(1.0, 0.0, -1.0), "frequency of a describing function is -1.0"),
    ):
        with pytest.raises(ModelError, match=words):
            make()


def test_a_case_file_keeps_fields_and_force() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.1, 1.0]), epp.BoucWen(2.0, 3.0, -1.0), memory=0.2)
    text = epp.Case.from_system(loop).to_toml()
    again = epp.case_from_text(text).to_system()
    for name in ("A", "B", "C", "D", "x0"):
        np.testing.assert_array_equal(getattr(again, name), getattr(loop, name))
    assert again.given.elements == loop.given.elements
    with pytest.raises(EppError, match=r"gamma is -4.0.* expected more than -beta"):
        epp.case_from_text(text.replace("gamma = -1.0", "gamma = -4.0")).to_system()
