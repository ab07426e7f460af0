"""Relays with minimum times: their steps, closed forms of a room and a burner, and an integrator of its own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError


def settled(element: epp.TimedRelay, amplitude: float, bias: float, omega: float) -> tuple[bool, complex, complex]:
    """Whether the answer to a sine repeats with it in the end, its mean and its gain, by its own steps in time."""
    n, periods = 1500, 30
    phase = (np.arange(n * periods) + 0.5) * 2.0 * np.pi / n
    memory, out = None, []
    for x, t in zip(bias + amplitude * np.sin(phase), phase / omega, strict=True):
        y, memory = element.output((x, t), memory)
        out.append(y)
    last, before = np.array(out[-n:]), np.array(out[-2 * n : -n])
    turn = np.sin(phase[-n:]) + 1j * np.cos(phase[-n:])
    return bool(np.array_equal(last, before)), complex(last.mean()), complex(2.0 * np.mean(last * turn) / amplitude)


@given(
    st.floats(-0.9, 0.0), st.floats(0.0, 0.9), st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.floats(-0.05, 0.05),
    st.floats(0.3, 3.0),
)  # fmt: skip
def test_it_answers_a_sine_as_its_steps_do(lower, upper, high_for, low_for, bias, omega) -> None:
    relay = epp.TimedRelay(lower, upper, low=-0.5, high=1.0, minimum_high=high_for, minimum_low=low_for)
    repeats, mean, gain = settled(relay, 1.0, bias, omega)
    found = relay.describing_function(1.0, bias, omega)
    if np.isnan(found.mean):
        return  # it takes several periods, or the sum of both times is a period but for the grid of the steps
    assert repeats and complex(found.mean) == pytest.approx(mean, abs=3e-3)
    assert complex(found.gain) == pytest.approx(gain, abs=6e-3)


def test_without_times_it_is_a_relay_with_hysteresis() -> None:
    timed, plain = epp.TimedRelay(-0.3, 0.2, -1.0, 2.0), epp.HysteresisRelay(-0.3, 0.2, -1.0, 2.0)
    a, b = np.geomspace(0.05, 20.0, 30)[:, None], np.linspace(-0.5, 0.5, 7)
    for own, want in zip(timed.describing_function(a, b, 3.0), plain.describing_function(a, b), strict=True):
        assert np.allclose(own, want, rtol=1e-13, atol=1e-13)
    plant = ([1.0], [1.0, 2.0, 2.0, 1.0])
    one, other = (epp.find_limit_cycles(epp.LureSystem.from_tf(plant, element)) for element in (timed, plain))
    assert [c.period for c in one] == pytest.approx([c.period for c in other], rel=1e-9) and len(one) >= 1


def room(high_for: float, low_for: float) -> epp.Diagram:
    """A room of 1200 s with a burner that warms it by 30 K, about 20 K."""
    return epp.Diagram(
        parts={
            "burner": epp.TimedRelay(-0.2, 0.2, 0.0, 1.0, minimum_high=high_for, minimum_low=low_for),
            "room": epp.blocks.TransferFunction(num=[30.0], den=[1200.0, 1.0]),
        },
        connect=["setpoint - room -> burner", "burner -> room"],
        inputs={"setpoint": 20.0},
    )


@pytest.mark.parametrize(("high_for", "low_for"), [(0.0, 0.0), (240.0, 360.0), (900.0, 60.0), (900.0, 700.0)])
def test_a_burner_cycles_as_the_exponentials_say(high_for: float, low_for: float) -> None:
    """Cooling ``T e^{-t/1200}`` and warming ``30 - (30 - T) e^{-t/1200}``, each to its edge and for its time at least.

    From the end of one to the end of the other, again and again: a contraction.
    """
    T, on, off = 19.8, 0.0, 0.0
    for _ in range(200):
        on = max(high_for, 1200.0 * np.log((30.0 - T) / (30.0 - 20.2)) if T < 20.2 else 0.0)
        hot = 30.0 - (30.0 - T) * np.exp(-on / 1200.0)
        off = max(low_for, 1200.0 * np.log(hot / 19.8) if hot > 19.8 else 0.0)
        T = hot * np.exp(-off / 1200.0)
    found = epp.find_limit_cycles(room(high_for, low_for).to_system())
    assert len(found) == len(found.stable) == 1
    assert found[0].period == pytest.approx(on + off, rel=1e-9)
    assert found[0].peak_to_peak["room"] == pytest.approx(hot - T, rel=1e-9)


@pytest.mark.parametrize("rest", [0.0, 5.0, 20.0])
def test_an_air_conditioner_of_the_literature_cycles_as_the_exponentials_say(rest: float) -> None:
    """2 K/kW, 2 kWh/K, 5.6 kW and a COP of 2.5 of a typical one (Hao, Sanandaji, Poolla and Vincent 2015).

    At 32 degrees outside, 22.5 +- 0.3125 inside, and a compressor that rests for some minutes at least.
    """
    R, C, power, outside, low, high = 2.0, 2.0 * 60.0, 2.5 * 5.6, 32.0, 22.5 - 0.3125, 22.5 + 0.3125
    cold, tau = outside - R * power, R * C  # min
    warming = tau * np.log((outside - low) / (outside - high))
    off = max(warming, rest)
    top = outside - (outside - low) * np.exp(-off / tau)
    on = tau * np.log((top - cold) / (low - cold))
    relay = epp.TimedRelay(low, high, 0.0, 1.0, minimum_low=60.0 * rest)
    loop = epp.Diagram(
        parts={"compressor": relay, "room": epp.blocks.TransferFunction(num=[-R * power], den=[60.0 * tau, 1.0])},
        connect=["room + outside -> compressor", "compressor -> room"],
        inputs={"outside": outside},
    ).to_system()
    (cycle,) = epp.find_limit_cycles(loop)
    assert cycle.stable and warming < 20.0
    assert cycle.period == pytest.approx(60.0 * (on + off), rel=1e-9)
    assert cycle.peak_to_peak["room"] == pytest.approx(top - low, rel=1e-9)


def by_scipy(high_for: float, low_for: float, times: np.ndarray) -> np.ndarray:
    """Output of 1/(s^2 + 0.4 s + 1) behind the relay, from x = 0.5 on, integrated from switch to switch."""
    x, t, high, since, out = np.array([0.5, 0.0]), 0.0, False, -np.inf, []
    while t < times[-1]:
        level = 1.0 if high else -1.0
        sign, edge, least = (1.0, -0.1, high_for) if high else (-1.0, 0.1, low_for)
        rate = lambda t, x, level=level: [x[1], level - 0.4 * x[1] - x[0]]  # noqa: E731
        until = min(max(t, since + least), times[-1])
        pieces = [(t, until, None)]
        cross = lambda t, x, sign=sign, edge=edge: sign * (-x[0] - edge)  # noqa: E731
        cross.terminal, cross.direction = True, -1.0  # type: ignore[attr-defined]
        pieces.append((until, times[-1], cross))
        for begin, end, event in pieces:
            if begin == end or (event is not None and event(begin, x) < 0.0):
                continue
            run = solve_ivp(
                rate, (begin, end), x, events=event, dense_output=True, method="DOP853", rtol=1e-12, atol=1e-13
            )
            within = times[(times >= begin) & (times < run.t[-1])]
            out.append(run.sol(within)[0])
            t, x = float(run.t[-1]), run.y[:, -1]
        high, since = not high, t
    return np.concatenate(out)


@pytest.mark.parametrize(("high_for", "low_for"), [(0.0, 0.0), (1.1, 0.4), (3.0, 5.0)])
def test_a_run_is_that_of_another_integrator(high_for: float, low_for: float) -> None:
    relay = epp.TimedRelay(-0.1, 0.1, minimum_high=high_for, minimum_low=low_for)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.4]], [[0.0], [1.0]], [[-1.0, 0.0]], [relay], x0=[0.5, 0.0], element_names=["relay"]
    )
    times = np.linspace(0.0, 40.0, 4001)
    run = epp.simulate(loop, t_end=40.0, t_eval=times)
    want = by_scipy(high_for, low_for, times)
    assert np.abs(run.signals["relay_input"][: len(want)] + want).max() < 1e-8 and len(want) > 3900


def test_memory_holds_a_start_back_until_its_time_is_over() -> None:
    relay = epp.TimedRelay(-0.1, 0.1, minimum_high=2.0)
    plant = ([1.0], [1.0, 1.0])
    for since, first in ((-0.5, 1.5), (-3.0, 0.0)):
        loop = epp.LureSystem.from_tf(plant, relay, x0=[5.0], memory=(True, since))
        run = epp.simulate(loop, t_end=4.0)
        assert run.events[0].time == pytest.approx(first, abs=1e-12)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"lower": 0.5, "upper": 0.1}, "upper is 0.1; expected at least lower"),
        ({"lower": 0.0, "upper": 0.1, "low": 1.0, "high": 1.0}, "high is 1.0; expected above low"),
        ({"lower": 0.0, "upper": 0.1, "minimum_low": -1.0}, "minimum_low is -1.0; expected"),
    ],
)
def test_what_is_no_such_relay_is_refused(fields: dict[str, float], sentence: str) -> None:
    with pytest.raises(ModelError, match=sentence):
        epp.TimedRelay(**fields)


def test_a_case_says_its_times_in_any_unit_and_writes_them_again() -> None:
    case = epp.Case.from_system(room(240.0, 360.0), "room")
    again = epp.case_from_text(case.with_values({"burner.minimum_high": "5 min"}).to_toml())
    assert again.value("burner.minimum_high") == 300.0
    assert epp.simulate(again, t_end=7200.0, decide=True).limit_cycle is not None
