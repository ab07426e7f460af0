"""Pulse-width modulation: its own steps in time, closed forms of a first-order plant, an integrator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.errors import ModelError


def sampled_at_all_phases(m: epp.PulseWidthModulator, a: float, b: float, w: float) -> tuple[complex, complex]:
    """Mean and gain from the pulse at each phase of the sine, by a sum over many."""
    phase = (np.arange(40000) + 0.5) * 2.0 * np.pi / 40000
    u = b + a * np.sin(phase)
    width = np.maximum(m.sample_time * np.minimum(np.abs(u) / m.full, 1.0) - m.dead_time, 0.0)
    pulse = m.level * np.sign(u) * (1.0 - np.exp(-1j * w * width)) / (1j * w * m.sample_time)
    mean = np.mean(m.level * np.sign(u) * width / m.sample_time)
    return complex(mean), complex(2j * np.mean(pulse * np.exp(-1j * phase)) / a)


@given(
    st.floats(0.05, 0.5), st.floats(0.2, 2.0), st.floats(0.0, 0.9), st.floats(0.1, 3.0), st.floats(-1.0, 1.0),
    st.floats(0.1, 6.0),
)  # fmt: skip
def test_it_answers_a_sine_as_its_pulses_at_all_phases(period, full, dead, amplitude, bias, turn) -> None:
    modulator = epp.PulseWidthModulator(period, 2.0, full, dead * period)
    mean, gain = sampled_at_all_phases(modulator, amplitude, bias, turn / period)
    found = modulator.describing_function(amplitude, bias, turn / period)
    assert complex(found.mean) == pytest.approx(mean, abs=1e-6)
    assert complex(found.gain) == pytest.approx(gain, abs=1e-6 / amplitude)


def test_its_own_steps_in_time_have_the_pulses() -> None:
    """A sine of a period of 7/3 samples: over 7 samples all phases that it meets."""
    modulator, amplitude, omega = epp.PulseWidthModulator(1.0, 2.0, 0.8, 0.1), 1.1, 2.0 * np.pi * 3 / 7
    times = (np.arange(70000) + 0.5) / 10000
    memory, out = None, []
    for t in times:
        k = np.floor(t)
        y, memory = modulator.output((0.1 + amplitude * np.sin(omega * k), t), memory)
        out.append(y)
    u = 0.1 + amplitude * np.sin(omega * np.arange(7))
    width = np.maximum(np.minimum(np.abs(u) / 0.8, 1.0) - 0.1, 0.0)
    assert np.reshape(out, (7, -1)).mean(axis=1) == pytest.approx(2.0 * np.sign(u) * width, abs=3e-4)


def test_limits() -> None:
    modulator = epp.PulseWidthModulator(0.2, 3.0, 0.5, 0.05)
    a, b = np.geomspace(0.01, 10.0, 20)[:, None], np.linspace(-0.6, 0.6, 5)
    for own, want in zip(
        modulator.describing_function(a, b, 0.0), epp.DeadZoneSaturation(0.125, 6.0, 2.25).describing_function(a, b),
        strict=True,
    ):  # fmt: skip
        np.testing.assert_allclose(own, want, rtol=1e-12, atol=1e-13)
    # At a standing input: the slope of the mean, at the end of a pulse.
    _, gain = modulator.describing_function(0.0, 0.3, 4.0)
    assert complex(gain) == pytest.approx(6.0 * np.exp(-4j * (0.2 * 0.6 - 0.05)), rel=1e-12)
    assert np.isnan(modulator.describing_function([np.nan, 1.0], 0.0, 1.0)[1]).tolist() == [True, False]


def lag(modulator: epp.PulseWidthModulator, tau: float, x0: float, **options: object) -> epp.LureSystem:
    """A first-order lag that the modulator pushes back."""
    return epp.LureSystem.build(
        [[-1.0 / tau]], [[1.0 / tau]], [[-1.0]], [modulator], x0=[x0], element_names=["bridge"], **options
    )


@pytest.mark.parametrize("dead", [0.0, 0.02])
def test_a_lag_swings_over_two_samples_as_the_exponentials_say(dead: float) -> None:
    """With full pulses ``level (exp(-dead/tau) - exp(-T/tau))/(1 + exp(-T/tau))`` turns its sign from sample to sample.

    With a dead time a smaller one does so too, by shorter pulses and unstable: below it all comes to rest.
    """
    T, tau, level, full = 0.1, 0.4, 1.0, 0.08
    e = np.exp(-T / tau)

    def after(x: float) -> float:
        width = max(T * min(x / full, 1.0) - dead, 0.0)
        return e * x - level * (np.exp((width - T) / tau) - e)

    size = level * (np.exp(-dead / tau) - e) / (1.0 + e)
    assert size > full and after(size) == pytest.approx(-size, abs=1e-15)
    found = epp.find_limit_cycles(lag(epp.PulseWidthModulator(T, level, full, dead), tau, size * 1.1))
    (cycle,) = found.stable
    assert cycle.period == pytest.approx(2.0 * T, rel=1e-12)
    # It falls to its size in the dead time.
    assert cycle.peak_to_peak["bridge_input"] == pytest.approx(2.0 * size * np.exp(dead / tau), rel=1e-9)
    start = lag(epp.PulseWidthModulator(T, level, full, dead), tau, size)
    run = epp.simulate(start, t_end=2.0, t_eval=T * np.arange(21))
    np.testing.assert_allclose(run.signals["bridge_input"], -size * (-1.0) ** np.arange(21), atol=1e-12)
    if dead:
        between = brentq(lambda x: after(x) + x, full * dead / T * 1.01, full)
        for ratio, cycles in ((0.98, False), (1.02, True)):
            begun = lag(epp.PulseWidthModulator(T, level, full, dead), tau, ratio * between)
            assert (epp.simulate(begun, t_end=40.0, decide=True).limit_cycle is not None) is cycles


def by_scipy(m: epp.PulseWidthModulator, times: np.ndarray) -> np.ndarray:
    """Angle of a motor of 0.3 s behind the bridge, from 0.7 rad on, from pulse to pulse."""
    x, out = np.array([0.7, 0.0]), []
    for k in range(round(6.0 / m.sample_time)):
        begin = k * m.sample_time
        u = 0.4 * np.sin(3.0 * begin) - x[0]
        width = max(m.sample_time * min(abs(u) / m.full, 1.0) - m.dead_time, 0.0)
        for t0, t1, y in (
            (begin, begin + width, m.level * np.sign(u)),
            (begin + width, begin + m.sample_time, 0.0),
        ):  # fmt: skip
            inside = times[(times >= t0) & (times < t1)]
            if t1 > t0:
                part = solve_ivp(
                    lambda t, x, y=y: [x[1], (y - x[1]) / 0.3], (t0, t1), x, method="DOP853", rtol=1e-12, atol=1e-14,
                    dense_output=True,
                )  # fmt: skip
                out += part.sol(inside)[0].tolist() if inside.size else []
                x = part.y[:, -1]
    return np.array(out)


@pytest.mark.parametrize("dead", [0.0, 0.015])
def test_a_run_is_that_of_another_integrator(dead: float) -> None:
    modulator = epp.PulseWidthModulator(0.05, 2.0, 0.25, dead)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -1.0 / 0.3]], [[0.0], [1.0 / 0.3]], [[-1.0, 0.0]], [modulator], D_input=[[1.0]],
        input_names=["demand"], x0=[0.7, 0.0], element_names=["bridge"],
    )  # fmt: skip
    times = (np.arange(480) + 0.37) / 80.0
    demand = epp.inputs.Sine(0.4, 3.0 / (2.0 * np.pi))
    run = epp.simulate(loop, demand, t_end=6.0, t_eval=times)
    want = by_scipy(modulator, times)
    names = {event.name for event in run.events}
    assert {"begins a pulse up", "begins a full pulse down"} <= names and ("skips" in names) == bool(dead)
    np.testing.assert_allclose(0.4 * np.sin(3.0 * times) - run.signals["bridge_input"], want, rtol=0, atol=1e-8)


def test_samples_do_not_drift_and_a_memory_goes_on() -> None:
    loop = lag(epp.PulseWidthModulator(0.1, 1.0, 0.02), 0.4, 0.3)
    run = epp.simulate(loop, t_end=500.0, t_eval=[0.0, 500.0])
    begun = np.array([event.time for event in run.events if event.name == "samples"])
    np.testing.assert_allclose(begun, 0.1 * np.arange(len(begun)), atol=1e-9)
    begun = lag(epp.PulseWidthModulator(0.1, 1.0, 0.02), 0.4, -0.2, memory=[(1, 0.03, 0.05)])
    events = [(event.name, event.time) for event in epp.simulate(begun, t_end=0.06).events]
    assert events[0] == ("pulse ends", pytest.approx(0.03)) and events[1] == ("samples", pytest.approx(0.05))


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"sample_time": 0.0, "level": 1.0}, "sample_time is 0.0; expected a positive number"),
        ({"sample_time": 0.1, "level": 1.0, "full": 0.0}, "full is 0.0; expected a positive number"),
        ({"sample_time": 0.1, "level": 1.0, "dead_time": 0.1}, "dead_time is 0.1; expected less than sample_time"),
    ],
)
def test_what_is_no_modulator_is_refused(fields: dict[str, float], sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        epp.PulseWidthModulator(**fields)


def test_a_case_says_its_times_in_any_unit_and_writes_them_again() -> None:
    text = epp.Case.from_system(lag(epp.PulseWidthModulator(0.1, 1.0, 0.08, 0.02), 0.4, 0.3), "bridge").to_toml()
    again = epp.case_from_text(text.replace("dead_time = 0.02", 'dead_time = "20 ms"'))
    assert again.value("bridge.dead_time") == 0.02
    assert epp.simulate(again, t_end=20.0, decide=True).limit_cycle is not None


def naturally_at_all_phases(m: epp.NaturalPulseWidthModulator, a: float, b: float, w: float) -> tuple[complex, complex]:
    """Mean and gain from the pulse at each phase of the sine, its end where the sawtooth meets it, by bisection."""
    phase = (np.arange(40000) + 0.5) * 2.0 * np.pi / 40000
    sign = np.sign(b + a * np.sin(phase))
    low, high = np.zeros_like(phase), np.full_like(phase, m.sample_time)
    for _ in range(60):
        t = 0.5 * (low + high)
        u = sign * (b + a * np.sin(phase + w * t))
        goes_on = m.sample_time * np.minimum(u, m.full) > m.full * (t + m.dead_time)
        low, high = np.where(goes_on, t, low), np.where(goes_on, high, t)
    pulse = m.level * sign * (1.0 - np.exp(-1j * w * low)) / (1j * w * m.sample_time)
    mean = np.mean(m.level * sign * low / m.sample_time)
    return complex(mean), complex(2j * np.mean(pulse * np.exp(-1j * phase)) / a)


@given(
    st.floats(0.05, 0.5), st.floats(0.2, 2.0), st.floats(0.0, 0.9), st.floats(0.1, 3.0), st.floats(-1.0, 1.0),
    st.floats(0.1, 0.99),
)  # fmt: skip
def test_a_sawtooth_answers_a_sine_without_a_lag(period, full, dead, amplitude, bias, steep) -> None:
    """While the sine is less steep than the sawtooth."""
    modulator = epp.NaturalPulseWidthModulator(period, 2.0, full, dead * period)
    omega = steep * full / (period * amplitude)
    mean, gain = naturally_at_all_phases(modulator, amplitude, bias, omega)
    found = modulator.describing_function(amplitude, bias, omega)
    assert complex(found.mean) == pytest.approx(mean, abs=1e-6)
    assert complex(found.gain) == pytest.approx(gain, abs=2e-6 / amplitude)


@pytest.mark.parametrize("dead", [0.0, 0.015])
def test_a_run_with_a_sawtooth_is_that_of_another_integrator(dead: float) -> None:
    """A motor of 0.3 s behind a bridge, from 0.7 rad on, and the element's own steps on the way."""
    modulator = epp.NaturalPulseWidthModulator(0.05, 2.0, 0.25, dead)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -1.0 / 0.3]], [[0.0], [1.0 / 0.3]], [[-1.0, 0.0]], [modulator], D_input=[[1.0]],
        input_names=["demand"], x0=[0.7, 0.0], element_names=["bridge"],
    )  # fmt: skip
    times = (np.arange(480) + 0.37) / 80.0
    run = epp.simulate(loop, epp.inputs.Sine(0.4, 3.0 / (2.0 * np.pi)), t_end=6.0, t_eval=times)
    names = {event.name for event in run.events}
    assert {"begins a pulse up", "begins a pulse down", "pulse ends"} <= names
    assert ("skips" in names) == ("full pulse ends" in names) == bool(dead)
    x, want, stepped, memory = np.array([0.7, 0.0]), [], [], None
    for k in range(120):
        begin = 0.05 * k
        sign = np.sign(0.4 * np.sin(3.0 * begin) - x[0])

        def ends(t: float, x: np.ndarray, begin: float = begin, sign: float = sign) -> float:
            u = sign * (0.4 * np.sin(3.0 * t) - x[0])
            return float(0.05 * min(u, 0.25) / 0.25 - dead - (t - begin))

        ends.terminal = True
        t, pushed = begin, ends(begin, x) > 0.0
        while t < begin + 0.05:
            push = 2.0 * sign * pushed
            part = solve_ivp(
                lambda t, x, push=push: [x[1], (push - x[1]) / 0.3], (t, begin + 0.05), x, method="DOP853", rtol=1e-12,
                atol=1e-14, dense_output=True, events=ends if pushed else None,
            )  # fmt: skip
            inside = times[(times >= t) & (times < part.t[-1])]
            want += part.sol(inside)[0].tolist() if inside.size else []
            for at in np.linspace(t, part.t[-1], 8)[1:-1]:
                y, memory = modulator.output((0.4 * np.sin(3.0 * at) - part.sol(at)[0], at), memory)
                stepped.append(y == push)
            t, x, pushed = part.t[-1], part.y[:, -1], False
    np.testing.assert_allclose(0.4 * np.sin(3.0 * times) - run.signals["bridge_input"], want, rtol=0, atol=1e-8)
    assert np.mean(stepped) > 0.98  # steps behind a sample see it late


class TestConverter:
    """The step-down converter of Deane and Hamill 1990, with the numbers of Fossas and Olivar 1996.

    Where a ramp from 3.8 V to 8.2 V in 0.4 ms is above ``8.4 (v - 11.3 V)``, a filter of 20 mH, 47 uF and 22 ohm is at
    its supply. A latch keeps it there until the period ends.
    """

    T, LOW, HIGH, GAIN, AIM = 400e-6, 3.8, 8.2, 8.4, 11.3
    A = np.array([[-1.0 / (22.0 * 47e-6), 1.0 / 47e-6], [-1.0 / 20e-3, 0.0]])

    def later(self, x: np.ndarray, t: float, supply: float) -> np.ndarray:
        """Voltage and current a time later."""
        rest = np.array([supply, supply / 22.0])
        return rest + expm(self.A * t) @ (x - rest)

    def off(self, x: np.ndarray) -> float:
        """How long the supply is off in a period."""

        def above(t: float) -> float:
            ramp = self.LOW + (self.HIGH - self.LOW) * t / self.T
            return float(self.GAIN * (self.later(x, t, 0.0)[0] - self.AIM) - ramp)

        if above(0.0) <= 0.0 or above(self.T) >= 0.0:
            return 0.0 if above(0.0) <= 0.0 else self.T
        return float(brentq(above, 0.0, self.T, xtol=1e-16))

    def once(self, x: np.ndarray, supply: float) -> np.ndarray:
        """The switching map: voltage and current a period later."""
        t = self.off(x)
        return self.later(self.later(x, t, 0.0), self.T - t, supply)

    def slope(self, x: np.ndarray, supply: float) -> np.ndarray:
        """Derivative of the map in closed form, with the jump of its rates where the supply comes on."""
        t = self.off(x)
        if t in (0.0, self.T):
            return expm(self.A * self.T)
        at = self.later(x, t, 0.0)
        normal = np.array([self.GAIN, 0.0])
        rate = float(normal @ self.A @ at) - (self.HIGH - self.LOW) / self.T
        jump = np.eye(2) + np.outer([0.0, supply / 20e-3], normal) / rate
        return expm(self.A * (self.T - t)) @ jump @ expm(self.A * t)

    def multipliers(self, supply: float, turns: int, near: float) -> np.ndarray:
        """Of the points of a period of `turns`, by Newton's method from where the map ends at a supply near it."""
        x = np.array([12.0, 0.55])
        for _ in range(2000):
            x = self.once(x, near)
        for _ in range(20):
            end, slope = x, np.eye(2)
            for _ in range(turns):
                end, slope = self.once(end, supply), self.slope(end, supply) @ slope
            x = x + np.linalg.solve(np.eye(2) - slope, end - x)
        return np.linalg.eigvals(slope)

    def case(self, supply: float) -> epp.Case:
        """The supply less pulses of its height that begin each period."""
        return epp.Case.from_tables({
            "kind": "diagram", "title": "Step-down converter",
            "connect": [
                "filter - aim -> gain", "gain -> amplifier", "amplifier -> modulator", "on - modulator -> filter",
            ],
            "parameters": {"supply": supply},
            "blocks": {
                "filter": {
                    "kind": "transfer_function", "num": [1], "den": [20e-3 * 47e-6, 20e-3 / 22, 1], "start": [12, 0],
                },
                "gain": {"kind": "gain", "gain": self.GAIN},
                "aim": {"kind": "constant", "value": self.AIM + self.LOW / self.GAIN},
                "on": {"kind": "constant", "value": "supply"},
            },
            "elements": {
                "amplifier": {"kind": "saturation", "lower": 0, "upper": self.HIGH - self.LOW},
                "modulator": {
                    "kind": "natural_pulse_width_modulator", "sample_time": self.T, "level": "supply",
                    "full": self.HIGH - self.LOW,
                },
            },
            "signals": {"voltage": {"of": "filter"}},
            "run": {"t_end": "0.1 s"},
        }, name="converter")  # fmt: skip

    @pytest.mark.parametrize("supply", [22.0, 23.0, 24.0])
    def test_below_the_doubling_it_repeats_each_period(self, supply: float) -> None:
        """And nothing rests: a pulse begins each period."""
        found = epp.find_limit_cycles(self.case(supply))
        assert not found.settles and "could not be closed" not in str(found)
        (stable,) = found.stable
        assert stable.period == pytest.approx(self.T, rel=1e-12)
        want = self.multipliers(supply, 1, near=supply)[0]
        found = complex(stable.multipliers[0])
        assert (found.real, abs(found.imag)) == pytest.approx((want.real, abs(want.imag)), rel=1e-6)

    def test_its_period_doubles_and_doubles_again(self) -> None:
        """Published: near 24.5 V."""

        def beyond(supply: float, turns: int, near: float) -> float:
            return float(self.multipliers(supply, turns, near).real.min()) + 1.0

        found = epp.continue_branch(self.case(20.0), "supply", 20.0, 26.0)
        (first,) = (point for point in found.special if point.kind == "period doubling")
        assert first.value == pytest.approx(24.5, abs=0.05)
        assert first.value == pytest.approx(brentq(beyond, 24.2, 25.0, (1, 24.0), xtol=1e-9), abs=1e-6)
        double = epp.continue_branch(self.case(20.0), "supply", 20.0, 33.0, origin=first)
        np.testing.assert_allclose(double.points["period"], 2.0 * self.T, rtol=1e-12)
        (second,) = (point for point in double.special if point.kind == "period doubling")
        assert second.value == pytest.approx(brentq(beyond, 30.8, 31.4, (2, 31.0), xtol=1e-9), abs=1e-6)

    def test_a_doubling_from_the_side_of_twice_the_period(self) -> None:
        """It is the same point, and nothing of twice the period leaves there."""
        case = self.case(24.8)
        (end,) = epp.continue_branch(case, "supply", 24.8, 24.2).special
        assert end.value == pytest.approx(24.516573, abs=1e-6)
        with pytest.raises(epp.EppError, match="origin is where the cycles of twice the period end, at 24.5166"):
            epp.continue_branch(case, "supply", 24.8, 24.2, origin=end)
