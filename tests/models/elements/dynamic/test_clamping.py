"""PI and PID controllers with clamping: describing function by integration, loops against another integrator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.optimize import fsolve

import eppanalysis as epp
from eppanalysis.errors import ModelError


def by_integration(c: Any, a: float, b: float, w: float) -> tuple[float, complex]:
    """Mean and gain of the integrator's state, which follows ``v = b + a sin(phi)`` while v is within the limits."""
    low, high = (float(np.arcsin(np.clip((level - b) / a, -1, 1))) for level in (c.lower, c.upper))
    edges = [low, high, np.pi - high, np.pi - low, 2 * np.pi + low]
    kappa = c.ki / c.kp / w

    def driven(phi: float) -> float:
        return float(kappa * (b + a * np.sin(phi)))

    def follows(s: float, begin: float, phi: float) -> float:
        past = quad(lambda p: driven(p) * np.exp(-kappa * (phi - p)), begin, phi, epsabs=1e-14, epsrel=1e-13)[0]
        return float(s * np.exp(-kappa * (phi - begin)) + past)

    def once(s: float) -> float:
        return follows(follows(s, edges[0], edges[1]), edges[2], edges[3])

    # The map over a period is affine.
    at_zero = once(0.0)
    start = at_zero / (1 - (once(1.0) - at_zero))
    top = follows(start, edges[0], edges[1])
    parts: list[Callable[[float], float]] = [
        lambda phi: follows(start, edges[0], phi), lambda phi: top, lambda phi: follows(top, edges[2], phi),
        lambda phi: start,
    ]  # fmt: skip
    weights: list[Callable[[float], float]] = [lambda phi: 1.0, np.sin, np.cos]
    one, sine, cosine = (
        sum(
            quad(lambda p, f=f, g=g: f(p) * g(p), p0, p1, epsabs=1e-13, epsrel=1e-12)[0]
            for f, p0, p1 in zip(parts, edges[:-1], edges[1:], strict=True)
        )
        for g in weights
    )  # fmt: skip
    return one / (2 * np.pi), complex(sine, cosine) / (np.pi * a)


@settings(max_examples=4, deadline=None)
@given(st.floats(0.3, 4.0), st.floats(-1.5, 1.2), st.floats(0.2, 8.0), st.floats(0.2, 3.0))
@example(3.0, 0.5, 1.0, 1.0)
@example(0.2, 0.1, 2.0, 0.5)
def test_mean_and_gain_match_quadrature(amplitude: float, bias: float, omega: float, ki: float) -> None:
    c = epp.ClampedPID(1.3, ki, lower=-1.0, upper=0.7)
    mean, gain = c.describing_function(amplitude, bias, omega)
    of_u = epp.Saturation(-1.0, 0.7).describing_function(amplitude, bias)
    assert (mean[1], gain[1]) == (of_u.mean, of_u.gain)
    if bias - amplitude >= 0.69 or bias + amplitude <= -0.99:
        return  # hardly ever within the limits
    expected = by_integration(c, amplitude, bias, omega)
    assert abs(float(mean[0]) - expected[0]) < 1e-9
    assert abs(complex(gain[0]) / (1 + 1j * omega) - expected[1]) < 1e-9


class WithDerivative:
    """Integrator and filter of a clamped PID behind ``v = b + a sin(w t)``, integrated with every switch located."""

    def __init__(self, c: Any, a: float, b: float, w: float) -> None:
        self.c, self.a, self.b, self.w, self.ahead = c, a, b, w, c.kd / c.filter_time
        levels = np.array([c.lower - b, c.upper - b]) / a
        rises = np.arcsin(levels[np.abs(levels) < 1])
        self.edges = np.array(sorted([-np.pi / 2, *rises, *(np.pi - rises), 1.5 * np.pi])) / w

    def error(self, t: float, x: Any) -> float:
        v = self.b + self.a * np.sin(self.w * t)
        return float((v - x[0] + self.ahead * x[1]) / (self.c.kp + self.ahead))

    def rates(self, t: float, x: Any, held: bool) -> list[float]:
        e = self.error(t, x)
        drive = 0.0 if held else self.c.ki * e
        return [drive, (e - x[1]) / self.c.filter_time, x[0], x[0] * np.sin(self.w * t), x[0] * np.cos(self.w * t)]

    def period(self, start: Any) -> np.ndarray:
        x, turned = np.array([*start, 0.0, 0.0, 0.0]), lambda t, x, held: self.error(t, x)
        turned.terminal = True  # type: ignore[attr-defined]
        for begin, end in zip(self.edges[:-1], self.edges[1:], strict=True):
            v = self.b + self.a * np.sin(self.w * (begin + end) / 2)
            side, t = float(v > self.c.upper) - float(v < self.c.lower), begin
            held = side * self.c.ki * self.error(begin, x) > 0
            while t < end:
                part = solve_ivp(
                    self.rates, (t, end), x, "DOP853", args=(held,), events=turned if side else None, rtol=1e-12,
                    atol=1e-13, max_step=(end - begin) / 20,
                )  # fmt: skip
                t, x, held = part.t[-1], part.y[:, -1], not held
                if t < end:  # beyond the turn, where it is not found again
                    step = 1e-10 / self.w
                    t, x = t + step, x + step * np.array(self.rates(t, x, held))
        return x

    def answer(self) -> tuple[float, complex]:
        start = fsolve(lambda x: self.period(x)[:2] - x, [np.clip(self.b, self.c.lower, self.c.upper), 0.0], xtol=1e-13)
        s, sine, cosine = self.period(start)[2:] * self.w / (2 * np.pi)
        return s, 2 * complex(sine, cosine) / self.a


@pytest.mark.parametrize(("fields", "amplitude", "bias", "omega"), [
    pytest.param((1.0, 2.0, -1.0, 1.0, 0.4, 0.1), 3.0, 0.3, 1.5, marks=pytest.mark.slow),
    pytest.param((1.5, 0.6, -0.4, 1.2, 1.0, 0.3), 2.0, -0.9, 0.4, marks=pytest.mark.slow),
    ((-0.7, -1.3, -0.5, 0.5, -0.5, 0.02), 4.0, 0.0, 6.0),
    ((0.5, 2.0, -1.0, 0.7, 0.3, 0.5), 0.6, 0.6, 2.0),
])  # fmt: skip
def test_with_a_derivative_it_matches_integration(fields: Any, amplitude: float, bias: float, omega: float) -> None:
    c = epp.ClampedPID(*fields)
    mean, gain = c.describing_function(amplitude, bias, omega)
    of_u = epp.Saturation(c.lower, c.upper).describing_function(amplitude, bias)
    assert (mean[1], gain[1]) == (of_u.mean, of_u.gain)
    expected = WithDerivative(c, amplitude, bias, omega).answer()
    assert abs(float(mean[0]) - expected[0]) < 1e-9
    assert abs(complex(gain[0]) / (1 + 1j * omega) - expected[1]) < 1e-9


def test_with_hardly_any_derivative_it_is_the_one_without() -> None:
    amplitude, bias, omega = np.geomspace(0.1, 30.0, 60), np.linspace(-1.5, 1.5, 60), np.geomspace(1e-3, 1e3, 60)
    one = epp.ClampedPID(1.0, 2.0).describing_function(amplitude, bias, omega)
    other = epp.ClampedPID(1.0, 2.0, kd=1e-9, filter_time=1.0).describing_function(amplitude, bias, omega)
    np.testing.assert_allclose(other.mean, one.mean, atol=1e-8)
    np.testing.assert_allclose(other.gain, one.gain, atol=1e-8)


@pytest.mark.slow
def test_a_cycle_with_a_derivative() -> None:
    """Three lags behind the controller: first order, exact orbit and run."""
    c = epp.ClampedPID(2.0, 1.5, kd=0.4, filter_time=0.05)
    loop = epp.LureSystem.build(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]], [[0.0], [0.0], [8.0]], [[-1.0, 0.0, 0.0]], [c],
        x0=[1.0, 0.0, 0.0],
    )  # fmt: skip
    (predicted,) = epp.predict_limit_cycles(loop)
    run = epp.simulate(loop, t_end=200.0)
    assert run.limit_cycle is not None
    orbit = epp.exact_orbit(loop, run.limit_cycle)
    assert orbit.stable and orbit.residual < 1e-10
    assert predicted.stable and predicted.period == pytest.approx(orbit.period, rel=0.05)


def test_limits_of_the_describing_function() -> None:
    c, omega = epp.ClampedPID(2.0, 3.0), np.array([1e-3, 0.7, 40.0])
    mean, gain = c.describing_function(0.8, 0.1, omega)  # within its limits it is linear
    np.testing.assert_allclose(gain[:, 0] / (1 + 1j * omega), 1 / (1 + 1j * omega * 2.0 / 3.0), rtol=1e-12)
    np.testing.assert_allclose(mean, 0.1, rtol=1e-12)
    mean, gain = c.describing_function(0.5, [2.0, -3.0], 1.0)  # always beyond one
    assert mean.tolist() == [[1.0, 1.0], [-1.0, -1.0]] and not np.any(gain)
    slow = c.describing_function(1.5, 0.2, 1e-9)[1]  # of slow motion the error is none, and s is u
    assert complex(slow[0]) == pytest.approx(complex(slow[1]), abs=1e-8)
    assert np.isnan(c.describing_function([np.nan, 1.0], 0.0, 1.0)[1][0]).any()


def test_mirrored_and_rescaled_it_is_the_same() -> None:
    amplitude, bias, omega = np.array([0.45, 1.1, 7.0]), np.array([0.0, -0.3, 1.0]), 1.7
    one = epp.ClampedPID(2.0, 3.0, -0.4, 1.0).describing_function(amplitude, bias, omega)
    mirror = epp.ClampedPID(2.0, 3.0, -1.0, 0.4).describing_function(amplitude, -bias, omega)
    larger = epp.ClampedPID(-6.0, -9.0, -1.2, 3.0).describing_function(3 * amplitude, 3 * bias, omega)
    np.testing.assert_allclose(mirror.mean, -one.mean, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(mirror.gain, one.gain, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(larger.mean, 3 * one.mean, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(larger.gain, one.gain, rtol=1e-12, atol=1e-15)


def servo(controller: epp.Nonlinearity, size: float = 1.0) -> epp.LureSystem:
    """A position servo 1/(s (s + 1)) behind a controller of the error, its position in units of `size`."""
    return epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -1.0]], [[0.0], [1.0]], [[-size, 0.0]], [controller], D_input=[[1.0]], input_names=["r"],
        element_names=["pid"], name="servo",
    )  # fmt: skip


class ByHand:
    """The servo behind a step r: position, speed, integrator and filter, with every switch located."""

    def __init__(self, c: Any, r: float) -> None:
        self.c, self.r, self.ahead = c, r, c.kd / c.filter_time if c.kd else 0.0

    def error_and_v(self, x: Any) -> tuple[float, float]:
        e = self.r - x[0]
        return e, self.c.kp * e + x[2] + self.ahead * (e - x[3])

    def pull(self, x: Any) -> float:
        """Rate of v while the integrator is held."""
        filtered = (self.r - x[0] - x[3]) / self.c.filter_time if self.c.kd else 0.0
        return float(-self.c.kp * x[1] + self.ahead * (-x[1] - filtered))

    def rates(self, mode: str, side: float, x: Any) -> list[float]:
        e, v = self.error_and_v(x)
        u = v if mode == "within" else self.c.upper if side > 0 else self.c.lower
        s = {"held": 0.0, "slides": -self.pull(x)}.get(mode, self.c.ki * e)
        return [x[1], -x[1] + u, s, (e - x[3]) / self.c.filter_time if self.c.kd else 0.0]

    def ends(self, mode: str, side: float) -> list[Callable[[float, Any], float]]:
        """What rises through zero where a mode ends."""
        c, limit = self.c, self.c.upper if side > 0 else self.c.lower
        back = lambda t, x: side * (limit - self.error_and_v(x)[1])  # noqa: E731
        return {
            "within": [lambda t, x: self.error_and_v(x)[1] - c.upper, lambda t, x: c.lower - self.error_and_v(x)[1]],
            "held": [back, lambda t, x: -side * c.ki * self.error_and_v(x)[0]],
            "free": [back, lambda t, x: side * c.ki * self.error_and_v(x)[0]],
            "slides": [
                lambda t, x: side * self.pull(x), lambda t, x: side * (-self.pull(x) - c.ki * self.error_and_v(x)[0]),
            ],
        }[mode]  # fmt: skip

    def at_limit(self, x: Any, side: float) -> str:
        """Mode at a limit: sliding where holding leads back and integrating leads beyond."""
        held, drive = side * self.pull(x), side * self.c.ki * self.error_and_v(x)[0]
        if drive > 0:
            return "slides" if held < 0 < held + drive else "held" if held > 0 else "within"
        return "free" if held + drive > 0 else "within"

    def run(self, times: np.ndarray) -> np.ndarray:
        t, x, side = 0.0, np.zeros(4), 1.0
        e, v = self.error_and_v(x)
        mode = "within"
        if not self.c.lower <= v <= self.c.upper:
            side = 1.0 if v > self.c.upper else -1.0
            mode = "held" if side * self.c.ki * e > 0 else "free"
        found = []
        while True:
            ends = self.ends(mode, side)
            for end in ends:
                end.terminal, end.direction = True, 1.0  # type: ignore[attr-defined]
            options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True, "max_step": 0.02}
            part = solve_ivp(
                lambda t, x, m=mode, s=side: self.rates(m, s, x), (t, times[-1]), x, events=ends, **options
            )
            inside = times[(times >= t) & ((times < part.t[-1]) | (part.status == 0))]
            found.append(part.sol(inside) if inside.size else np.zeros((4, 0)))
            if part.status == 0:
                return np.hstack(found)
            t, x, which = part.t[-1], part.y[:, -1], int(part.t_events[0].size == 0)
            if mode == "within":
                side = -1.0 if which else 1.0
                mode = self.at_limit(x, side)
            elif mode == "slides":
                mode = "within" if which else "held"
            else:
                mode = ("free" if mode == "held" else "held") if which else self.at_limit(x, side)
            t, x = t + 1e-11, x + 1e-11 * np.array(self.rates(mode, side, x))


@pytest.mark.parametrize(("controller", "r"), [
    (epp.ClampedPID(0.5, 1.5), 3.0),
    (epp.ClampedPID(2.0, 6.0, -0.2, 0.5), 1.5),
    (epp.ClampedPID(2.0, 1.5, lower=-0.3, upper=0.8, kd=1.0, filter_time=0.1), 3.0),
])  # fmt: skip
def test_a_step_against_another_integrator(controller: Any, r: float) -> None:
    times = np.linspace(0.0, 12.0, 121)
    run = epp.simulate(servo(controller), epp.inputs.Step(r), t_end=12.0, t_eval=times)
    v, u = run.signals["pid_input"], run.signals["pid_output"]
    expected = ByHand(controller, r).run(times)
    np.testing.assert_allclose(r - v[1:], expected[0, 1:], atol=1e-9)
    assert {f"along the {side} limit" for side in ("upper", "lower")} <= {e.mode for e in run.events}
    assert u.max() == controller.upper and u.min() == controller.lower


def test_it_slides_along_its_limit_without_chatter() -> None:
    """Behind a large step the integrator pushes out of the limit and the falling error in: one event each way."""
    run = epp.simulate(servo(epp.ClampedPID(0.5, 1.5)), epp.inputs.Step(3.0), t_end=3.0)
    assert [e.name for e in run.events] == ["reaches upper", "returns to upper"]


def test_a_cycle_by_all_methods() -> None:
    """A loop that its integrator makes unstable: prediction, run and exact orbit; of another size it is the same."""
    c = epp.ClampedPID(0.5, 1.5)
    loop = servo(c)
    predicted = epp.predict_limit_cycles(loop)
    assert len(predicted) == 1
    run = epp.simulate(loop, epp.inputs.Step(3.0), t_end=200.0)
    assert run.limit_cycle is not None
    orbit = epp.exact_orbit(loop, run.limit_cycle)
    assert orbit.stable is True and orbit.residual < 1e-10
    assert orbit.period == pytest.approx(run.limit_cycle.period, rel=1e-9)
    assert predicted[0].period == pytest.approx(orbit.period, rel=0.15)
    scaled = servo(epp.ClampedPID(0.5, 1.5, -10.0, 10.0))
    again = epp.exact_orbit(scaled, epp.simulate(scaled, epp.inputs.Step(30.0), t_end=200.0).limit_cycle)
    assert again.period == pytest.approx(orbit.period, rel=1e-12)
    assert again.peak_to_peak["pid_input"] == pytest.approx(10 * orbit.peak_to_peak["pid_input"], rel=1e-9)


def test_margins_are_those_of_the_pid() -> None:
    fields = {"kp": 2.0, "ki": 1.5, "lower": -0.3, "upper": 0.8, "kd": 1.0, "filter_time": 0.1}
    one = epp.margins(servo(epp.ClampedPID(**fields)), ["pid.out", "pid.in"])
    other = epp.margins(servo(epp.AntiWindupPID(**fields, tracking_time=0.5)), ["pid.out", "pid.in"])
    assert [m.numbers() for m in one] == [m.numbers() for m in other]


def test_it_comes_back_from_a_file() -> None:
    loop = servo(epp.ClampedPID(2.0, 1.5, kd=1.0, filter_time=0.1))
    again = epp.case_from_text(epp.Case.from_system(loop, name="servo").to_toml()).to_system()
    for name in ("A", "B", "C", "D", "x0"):
        np.testing.assert_array_equal(getattr(again, name), getattr(loop, name))


@pytest.mark.parametrize(("fields", "words"), [
    ({"kp": 0.0}, "ClampedPID: kp is 0.0; expected a number other than zero"),
    ({"ki": -1.0}, r"ClampedPID: ki is -1.0; expected a number of the sign of kp \(1.0\)"),
    ({"lower": 2.0}, r"ClampedPID: upper is 1.0; expected more than lower \(2.0\)"),
    ({"kd": 1.0}, "ClampedPID: filter_time is 0.0; expected a positive number, as there is a derivative"),
])  # fmt: skip
def test_fields_are_checked(fields: dict[str, float], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        epp.ClampedPID(**({"kp": 1.0, "ki": 1.0} | fields))


def test_values() -> None:
    c = epp.ClampedPID(1.0, 2.0)
    y = c.output((np.array([0.5, 2.0, 2.0, -2.0]), np.array([0.5, 0.5, -0.5, -0.5]), 3.0))[0]
    assert y.tolist() == [[4.0, 3.0, 2.0, 3.0], [0.5, 1.0, 1.0, -1.0]]
    assert c.slope_bounds() == (-np.inf, np.inf) and c.thresholds(0.4).tolist() == [0.6, 1.4]
    with pytest.raises(ModelError, match="with kd -0.5 it has no describing function; expected one of the sign of kp"):
        epp.ClampedPID(1.0, 2.0, kd=-0.5, filter_time=0.1).describing_function(1.0)


@pytest.mark.parametrize("controller", [
    epp.ClampedPID(1.0, 1.5), epp.ClampedPID(1.0, 1.5, kd=0.4, filter_time=0.1), epp.AntiWindupPID(1.0, 1.5, 0.3)
])  # fmt: skip
def test_a_dead_time_straight_behind_is_that_of_the_plant_alone(controller: Any) -> None:
    """What an anti-windup does inside the controller does not wait for what its output is on the way to."""
    delay, step, end = 0.4, 2e-4, 8.0
    diagram = epp.Diagram(
        parts={"pid": controller, "late": epp.blocks.DeadTime(delay=delay),
               "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0])},
        connect=["r - plant -> pid", "pid -> late", "late -> plant"], inputs={"r": 5.0}, signals={"x": "plant"},
    )  # fmt: skip
    times = np.linspace(0.0, end, 41)
    found = epp.simulate(diagram.to_system(), t_end=end, t_eval=times).signals["x"]
    x = speed = s = d = 0.0
    wait, seen = [1.0] * round(delay / step), []  # what it has put out for ever
    ahead = controller.kd / controller.filter_time if controller.kd else 0.0
    for i in range(round(end / step) + 1):
        e = 5.0 - x
        v = controller.kp * e + s + ahead * (e - d)
        u, drive = float(np.clip(v, -1.0, 1.0)), controller.ki * e
        if isinstance(controller, epp.AntiWindupPID):
            drive += (u - v) / controller.tracking_time
        elif v != u and (v > u) == (drive > 0):
            drive = 0.0
        if i % round(times[1] / step) == 0:
            seen.append(x)
        wait.append(u)
        x, speed = x + step * speed, speed + step * (wait.pop(0) - speed)
        s, d = s + step * drive, d + step * (e - d) / controller.filter_time if controller.kd else 0.0
    np.testing.assert_allclose(found, seen, atol=3e-3)


def test_an_anti_windup_straight_before_a_dead_time_of_a_bare_loop_is_refused() -> None:
    with pytest.raises(ModelError, match="pid has states of its own; expected none straight before a dead time"):
        epp.LureSystem.build(
            [[-1.0]], [[1.0]], [[-1.0]], [epp.AntiWindupPID(1.0, 1.5, 0.3)], delays=[0.4], element_names=["pid"]
        )
