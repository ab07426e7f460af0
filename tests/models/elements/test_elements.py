"""What each element says of itself, against its own map; and elements that users define."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.cases.blocks import read_block
from eppanalysis.cases.files import parse_raw
from eppanalysis.cases.values.automata import automaton_table
from eppanalysis.cases.values.toml import write_toml
from eppanalysis.models.elements import ELEMENTS, ParkingBandLaw
from tests.shared import mostly_slow

BANDS = epp.FiveBandLaw(5.0, 10.0, 11.0, 16.0, 16.0, 2.0)
SHIPPED: dict[str, Any] = {
    "play": epp.Play(0.8),
    "prandtl ishlinskii": epp.PrandtlIshlinskii([0.4, 0.9, 1.3], [0.6, 0.3, -0.2], 0.5),
    "hysteresis relay": epp.HysteresisRelay(-0.3, 0.5, -1.0, 2.0),
    "hysteresis relay, one side": epp.HysteresisRelay(0.2, 0.5, 0.0, 2.0),
    "falling hysteresis relay": epp.HysteresisRelay(-0.3, 0.5, 1.0, -2.0),
    "hysteresis relay with dead zone": epp.HysteresisRelayDeadZone(0.9, 0.4, 2.0),
    "backlash compensator": epp.BacklashCompensator(0.6),
    "backlash compensator with travel": epp.BacklashCompensator(0.6, 0.4),
    "friction compensator": epp.FrictionCompensator(1.0),
    "friction compensator with ramp": epp.FrictionCompensator(1.0, 0.3),
    "jump and follow": epp.JumpAndFollow(0.8, 0.3, 2.0),
    "jump and follow without jump": epp.JumpAndFollow(0.8, 0.0, 2.0),
    "pulley": epp.StictionPulley(200.0, 300.0, 0.1, 0.6),
    "pulley without stiction": epp.StictionPulley(200.0, 300.0, 0.1, 1.0),
    "saturation": epp.Saturation(-1.0, 2.0, 3.0),
    "dead zone": epp.DeadZone(-0.4, 0.9, 1.5),
    "dead zone and saturation": epp.DeadZoneSaturation(0.3, 2.0, 1.0),
    "relay": epp.Relay(-1.0, 2.0, 0.3),
    "relay with dead zone": epp.RelayDeadZone(0.5, 2.0),
    "preload": epp.Preload(1.0, 0.5),
    "coulomb": epp.Coulomb(1.0),
    "quantiser": epp.Quantiser(0.25, 6),
    "bands": BANDS,
    "cube": epp.Cube(-0.7),
    "sine": epp.Sine(1.5),
    "bilinear spring": epp.BilinearSpring(-0.4, 0.9, 3.0, 0.5, 0.2),
    "comparator": epp.Comparator(-1.0, 2.0, 0.3),
    "floor quantiser": epp.FloorQuantiser(0.25, 6),
    "mid-rise quantiser": epp.MidRiseQuantiser(0.25, 6),
    "wrap around": epp.WrapAround(0.7, 2),
    "viscous and coulomb": epp.ViscousCoulomb(1.0, 0.4),
    "stribeck": epp.StribeckFriction(1.0, 1.5, 0.6, 0.2),
    "drag": epp.Drag(4.0),
    "polynomial": epp.Polynomial([0.0, 1.0, -0.3, 0.2, 0.0, 0.05]),
    "tanh": epp.Tanh(1.2, 2.0),
    "arctan": epp.Arctan(1.2, 2.0),
    "table": epp.LookupTable([-2.0, -1.0, 0.5, 0.5, 1.5], [-1.0, -2.0, 0.5, 1.0, 1.5], "hold"),
    "monotone table": epp.MonotoneTable([-2.0, -1.0, 0.5, 1.5], [-1.0, -0.8, 0.5, 1.5], "hold"),
    "friction": epp.Friction(1.0),
    "falling friction": epp.Friction(0.0, 1.5, 2.0),
    "piecewise": epp.PiecewiseLinear([-1.0, 0.5], [0.2, -1.0, 2.0], [0.0, -1.2, -2.7]),
}


def walk(element: Any, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs on random ways there and back in small steps, and outputs of the element's map with memory."""
    rng = np.random.default_rng(seed)
    turns = np.concatenate([[0.0], rng.uniform(-3.0, 3.0, 24)])
    if element is BANDS:
        turns = 8.0 + 4.0 * turns
    x = np.concatenate([np.linspace(a, b, 400, endpoint=False) for a, b in zip(turns, turns[1:], strict=False)])
    memory, y = None, []
    for value in x:
        out, memory = element.output(float(value), memory)
        y.append(float(np.ravel(out)[0]))
    return x, np.array(y)


@pytest.mark.parametrize("name", SHIPPED)
def test_slopes_and_sector_hold_the_map(name: str) -> None:
    element = SHIPPED[name]
    x, y = walk(element, 7)
    (low, high), (least, greatest) = element.slope_bounds(), element.sector()
    slopes = np.diff(y) / np.diff(x)
    slack = 1e-9 * (1.0 + np.abs(slopes).max())
    assert low - slack <= slopes.min() and slopes.max() <= high + slack
    # Nor is a finite bound wider than the slopes that occur; over 1 / 1000 of the range a jump is steep.
    for bound, found in ((low, slopes.min()), (high, slopes.max())):
        assert abs(found - bound) <= 0.05 * (1.0 + abs(bound)) if np.isfinite(bound) else abs(found) > 10.0
    ratios = (y / np.where(x == 0.0, np.nan, x))[x != 0.0]
    assert least - 1e-9 <= ratios.min() and ratios.max() <= greatest + 1e-9
    for bound, found in ((least, ratios.min()), (greatest, ratios.max())):
        assert np.isfinite(bound) or abs(found) > 3.0


@pytest.mark.parametrize("damping", [0.0, 0.4])
@pytest.mark.parametrize("model", ["unilateral", "classical"])
def test_slopes_and_sector_of_a_contact_at_any_rate(model: str, damping: float) -> None:
    pin = epp.LockPin(0.5, 3.0, damping, model)
    delta, rate = np.linspace(-2.0, 2.0, 4001)[:, None], np.linspace(-5.0, 5.0, 21)
    torque = pin.output((delta + 0.0 * rate, 0.0 * delta + rate))[0]
    slopes, ratios = (
        np.diff(torque, axis=0) / np.diff(delta, axis=0),
        torque[delta[:, 0] != 0] / delta[delta[:, 0] != 0],
    )
    for (low, high), found in ((pin.slope_bounds(), slopes), (pin.sector(), ratios)):
        assert low - 1e-9 <= found.min() and found.max() <= high + 1e-9
        assert damping or high == pytest.approx(3.0)


@pytest.mark.parametrize("name", SHIPPED)
def test_thresholds_about_a_bias_have_one_signature(name: str) -> None:
    element = SHIPPED[name]
    found = np.asarray(element.thresholds(bias=0.1))
    assert np.all(found > 0) and np.array_equal(element.thresholds(), element.thresholds(0.0))


def test_every_element_of_a_case_file_is_found_by_its_name() -> None:
    for kind, made in ELEMENTS.items():
        assert made.kind == kind and issubclass(made, epp.Nonlinearity)
    assert ParkingBandLaw.kind == "" and ELEMENTS["play"] is epp.Play


# Elements of the user's own -----------------------------------------------------------------------------------------
RING = ([2.0], [1.0, 1.5, 1.0, 0.4])


def ring(element: epp.Nonlinearity) -> epp.LureSystem:
    return epp.LureSystem.from_tf(RING, element, x0=[0.3, 0.5, 2.0], name="ring")


def test_no_element_escapes_what_is_asked_of_every_one_here() -> None:
    """Those with states of their own, or of a contact, have their maps and integrators in files of their own."""
    apart = {
        "lock_pin", "nordin_shaft", "dahl_friction", "lugre_friction", "anti_windup_pid", "clamped_pid", "rate_limiter",
        "rate_limited_servo", "clegg_integrator", "first_order_reset", "timed_relay", "bouc_wen", "impact_stop",
        "pulse_width_modulator", "natural_pulse_width_modulator",
    }  # fmt: skip
    here = {element.kind for element in SHIPPED.values()}
    assert not here & apart and here | apart == set(ELEMENTS)


def by_scipy(loop: epp.LureSystem, events: list[float], times: np.ndarray) -> np.ndarray:
    """Inputs of the element at times: a smooth integrator between the events, with the element's own map."""
    A, b, c, element = loop.A, loop.B[:, 0], loop.C[0], loop.elements[0]
    x, found = np.array(loop.x0), [float(c @ loop.x0)]
    memory = element.output(found[0], None)[1]
    cuts = np.union1d(times, [t for t in events if t < times[-1]])
    for begin, end in itertools.pairwise(cuts):
        rates = _rates(loop, memory, begin, end, float(c @ (A @ x + b * _value(element, float(c @ x), memory))))
        x = solve_ivp(rates, (begin, end), x, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        memory = element.output(float(c @ x) + 2e-11 * np.sign(c @ rates(end, x)), memory)[1]
        if end in times:
            found.append(float(c @ x))
    return np.array(found)


def _value(element: epp.Nonlinearity, z: float, memory: Any) -> float:
    return float(np.ravel(element.output(z, memory)[0])[0])


def _rates(loop: epp.LureSystem, memory: Any, begin: float, end: float, inward: float) -> Any:
    """Rates of the states; at both ends, where the map may jump, the input is taken a trifle inside."""

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        inside = 1e-11 * np.sign(inward) * (1.0 - 2.0 * (t - begin) / (end - begin))
        return loop.A @ x + loop.B[:, 0] * _value(loop.elements[0], float(loop.C[0] @ x) + inside, memory)

    return rates


@pytest.mark.parametrize("name", [n for n, e in SHIPPED.items() if e.n_outputs == 1])
def test_a_loop_with_it_against_another_integrator(name: str) -> None:
    # With a cube or drag this loop runs away. A pulley, with its two outputs, has the loop of the elbow.
    loop, times = ring(SHIPPED[name]), np.linspace(0.0, 1.5 if name in ("cube", "drag") else 6.0, 13)
    run = epp.simulate(loop, t_end=times[-1], t_eval=times)
    found = by_scipy(loop, [event.time for event in run.events], times)
    np.testing.assert_allclose(run.signals["x"], found, rtol=0, atol=1e-7 * np.abs(found).max())


#: Elements that are rebuilt as data: with and without memory, sticking, jumping, smooth, and of many pieces.
REBUILT = (
    "play", "hysteresis relay", "hysteresis relay with dead zone", "backlash compensator with travel",
    "prandtl ishlinskii", "jump and follow", "saturation", "relay", "preload", "quantiser", "table", "friction",
    "falling friction", "cube", "drag", "stribeck",
)  # fmt: skip


def from_a_file(element: epp.Nonlinearity) -> epp.LureSystem:
    """The ring with an element that is nothing but the modes and guards in the text of a case file."""
    loop = ring(epp.AutomatonElement(element.automaton()))
    text = epp.Case.from_system(loop).to_toml()
    assert 'kind = "automaton"' in text
    return epp.case_from_text(text).to_system()


@pytest.mark.parametrize("name", REBUILT)
def test_an_element_rebuilt_as_data_runs_to_the_same_bits(name: str) -> None:
    shipped = SHIPPED[name]
    times = np.linspace(0.0, 15.0, 301)
    one, other = (epp.simulate(loop, t_end=15.0, t_eval=times) for loop in (ring(shipped), from_a_file(shipped)))
    assert [e[:1] + e[2:] for e in one.events] == [e[:1] + e[2:] for e in other.events]
    assert len(one.events) > 3 or name in ("cube", "stribeck")
    # The inputs and outputs are called by the names of the elements.
    for (signal, values), again in zip(one.signals.items(), other.signals.values(), strict=True):
        np.testing.assert_array_equal(values, again, err_msg=signal)


@pytest.mark.parametrize("name", [*REBUILT, "pulley"])
def test_an_element_rebuilt_as_data_is_the_same_to_the_bit(name: str) -> None:
    rules = SHIPPED[name].automaton()
    table = {"kind": "automaton", **automaton_table(epp.AutomatonElement(rules), name)}
    raw = parse_raw(write_toml({"kind": "loop", "own": [table]}), "own", Path())
    block = read_block(raw.data["own"][0], "own.0", raw)
    again = block.others["rules"]
    for columns in ("mode_columns", "guard_columns"):
        one, other = getattr(rules, columns), getattr(again, columns)
        for field in one:
            np.testing.assert_array_equal(one[field], other[field])
            np.testing.assert_array_equal(np.signbit(one[field]), np.signbit(other[field]))
    assert [m.name for m in rules.modes] == [m.name for m in again.modes]
    assert [g.name for g in rules.guards] == [g.name for g in again.guards]
    assert rules.start_mode == again.start_mode and rules.start_memory.tolist() == again.start_memory.tolist()


@pytest.mark.parametrize("name", [n for n in SHIPPED if n not in ("pulley", "pulley without stiction")])
def test_its_describing_function_by_quadrature_is_the_closed_one(name: str) -> None:
    shipped = SHIPPED[name]
    own = epp.AutomatonElement(shipped.automaton())
    bias = 11.0 if shipped is BANDS else 0.2
    # Above the greatest amplitude at which memory tells what the element does.
    amplitude = np.array([1.7, 2.9, 8.3])
    mean, gain = shipped.describing_function(amplitude, bias, 2.0)
    mean_own, gain_own = own.describing_function(amplitude, bias, 2.0)
    np.testing.assert_allclose(mean_own, mean, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(gain_own, gain, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize(
    "name", mostly_slow(["play", "hysteresis relay", "hysteresis relay with dead zone", "jump and follow"], ["play"])
)
def test_its_map_is_that_of_the_element(name: str) -> None:
    shipped = SHIPPED[name]
    x, y = walk(epp.AutomatonElement(shipped.automaton()), 3)
    expected = walk(shipped, 3)[1]
    same = np.abs(y - expected) <= 1e-12
    # Without memory both start at zero input; what they hold there may differ until the input has gone far once.
    first = int(np.argmax(np.abs(x) > 1.5))
    turned = first + int(np.argmax(np.sign(x[first:]) != np.sign(x[first])))
    assert same[max(turned, 2000) :].all()


def halving() -> epp.AutomatonElement:
    """Its output changes at every other passage of the input through zero, so its period is twice the input's."""
    build = epp.AutomatonBuilder()
    levels = [
        (build.mode(f"{level} below", constant=level), build.mode(f"{level}", constant=level)) for level in (-1, 1)
    ]
    for (below, above), (_, other) in zip(levels, levels[::-1], strict=True):
        build.guard("rises", below, other, on_input=1.0)
        build.guard("falls", above, below, on_input=-1.0)
    return epp.AutomatonElement(build.build())


def creeping(share: float) -> epp.AutomatonElement:
    """At every rise of its input through zero the output goes a share of the way to one."""
    build = epp.AutomatonBuilder(n_memory=1)
    below, above = build.mode("below", from_memory=1.0), build.mode("above", from_memory=1.0)
    build.guard("rises", below, above, on_input=1.0, memory_from_memory=1.0 - share, memory_constant=share)
    build.guard("falls", above, below, on_input=-1.0)
    return epp.AutomatonElement(build.build())


def test_what_does_not_answer_with_the_period_of_its_input_has_no_describing_function() -> None:
    for element in (halving(), creeping(0.5)):
        mean, gain = element.describing_function([0.1, 10.0], omega=[1.0, 1e5])
        assert np.all(np.isnan(mean)) and np.all(np.isnan(gain))
    mean, gain = creeping(1.0).describing_function([0.1, 10.0], omega=[1.0, 1e5])
    np.testing.assert_allclose(mean, 1.0, rtol=1e-12)
    np.testing.assert_allclose(gain, 0.0, atol=1e-12)


def hook() -> epp.AutomatonElement:
    """Catches at 1 with a jump up to the line, lets go at a half; the same on the other side."""
    build = epp.AutomatonBuilder()
    free, up, down = build.mode("free"), build.mode("up", from_input=1.0), build.mode("down", from_input=1.0)
    for name, mode, sign in (("up", up, 1.0), ("down", down, -1.0)):
        build.guard(f"catches {name}", free, mode, on_input=sign, constant=-1.0)
        build.guard(f"lets go {name}", mode, free, on_input=-sign, constant=0.5)
    return epp.AutomatonElement(build.build())


def test_an_element_of_ones_own_is_predicted_found_and_simulated() -> None:
    loop = epp.LureSystem.from_tf(([5.5], [1.0, 3.0, 2.0, 0.0]), hook(), x0=[0.0, 0.0, 30.0])
    assert loop.elements[0].slope_bounds() == (0.0, np.inf)
    assert np.isnan(epp.margins(loop).gain_margin) and "through automaton" in epp.margins(loop).message
    predicted = list(epp.predict_limit_cycles(loop))
    assert predicted
    for cycle in predicted:
        a, w = cycle.amplitude("x"), cycle.omega
        # The loop is balanced: N(a) G(j w) = -1, with N by the element and G by hand.
        response = 5.5 / ((1j * w) * (1j * w + 1.0) * (1j * w + 2.0))
        assert complex(hook().describing_function(a, 0.0, w)[1]) * response == pytest.approx(-1.0, abs=1e-6)
    found = [c for c in epp.find_limit_cycles(loop, predicted=predicted) if c.stable]
    run = epp.simulate(loop, t_end=200.0)
    assert run.limit_cycle is not None and len(found) == 1
    # The run still closes in on the cycle, slowly.
    assert found[0].period == pytest.approx(run.limit_cycle.period, rel=1e-4)


def test_an_element_that_the_package_does_not_know_gets_margins() -> None:
    @dataclass(frozen=True)
    class Bend(epp.Nonlinearity):
        """Twice as steep above zero."""

        def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
            return np.where(np.asarray(x) > 0, 2.0 * np.asarray(x), x), memory

        def describing_function(self, amplitude: Any, bias: Any = 0.0, omega: Any = 1.0) -> tuple[Any, Any]:
            return epp.PiecewiseLinear([0.0], [1.0, 2.0], [0.0, 0.0]).describing_function(amplitude, bias, omega)

        def automaton(self) -> epp.Automaton:
            build = epp.AutomatonBuilder()
            low, high = build.mode("below", from_input=1.0), build.mode("above", from_input=2.0)
            build.guard("up", low, high, on_input=1.0)
            build.guard("down", high, low, on_input=-1.0)
            return build.build()

    plant = ([1.0], [1.0, 3.0, 2.0, 0.0])
    margins = epp.margins(epp.LureSystem.from_tf(plant, Bend()))
    assert Bend().slope_bounds() == (1.0, 2.0)
    assert margins.gain_margin == pytest.approx(6.0 / 2.0, rel=1e-9)
    other = epp.margins(epp.LureSystem.from_tf(plant, epp.PiecewiseLinear([0.0], [1.0, 2.0], [0.0, 0.0])))
    assert margins.numbers() == other.numbers()


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (epp.HysteresisRelay(-0.1, 0.1), "none (its output jumps, or its slope has no bound)."),
        (epp.HysteresisRelayDeadZone(0.5, 0.2), "none (its output jumps, or its slope has no bound)."),
        (epp.Preload(0.2, 1.0), "none (its output jumps, or its slope has no bound)."),
        (epp.Cube(1.0), "none (its output jumps, or its slope has no bound)."),
        (epp.Quantiser(0.1, 20), "1 (the mean slope of its steps)."),
        (epp.Coulomb(0.4), "0 (left out: its force does not grow with the speed)."),
        (epp.Play(0.4), "1 (the slope at which it follows)."),
    ],
)
def test_margins_say_which_gain_stands_for_an_element(element: epp.Nonlinearity, said: str) -> None:
    found = epp.margins(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), element))
    assert found.rule == (f"{element.kind}: {said}",)
    assert (found.gain_margin == pytest.approx(6.0)) == said.startswith("1")
    assert found.status.ok == said.startswith("1")


# Linear states of an element's own -----------------------------------------------------------------------------------
def lag_behind(element: epp.Nonlinearity, time: float) -> epp.AutomatonElement:
    """The element with a first-order lag behind it: x goes straight in, w drives s, and y = s."""
    own = epp.OwnStates([[-1.0 / time]], [[0.0, 1.0 / time]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]])
    return epp.AutomatonElement(element.automaton(), own)


@pytest.mark.parametrize("shipped", [epp.Relay()])
def test_a_lag_in_the_element_is_a_lag_in_the_plant(shipped: epp.Nonlinearity) -> None:
    time, plant = 0.5, ([1.0], [1.0, 3.0, 2.0])
    inside = epp.LureSystem.from_tf(plant, lag_behind(shipped, time), x0=[0.3, 0.2])
    outside = epp.LureSystem.from_blocks([shipped, ([1.0], [time, 1.0]), plant], x0=[0.0, 0.3, 0.2])
    assert inside.A.shape == (3, 3) and inside.state_names[-1] == "automaton_0"
    omega = np.geomspace(0.1, 30.0, 40)
    np.testing.assert_allclose(
        inside.frequency_response(omega), outside.frequency_response(omega), rtol=1e-12, atol=1e-14
    )
    runs = [epp.simulate(loop, t_end=60.0) for loop in (inside, outside)]
    assert runs[0].status is runs[1].status
    np.testing.assert_allclose(runs[0].signals["x"], runs[1].signals["x"], atol=1e-9)
    found = [list(epp.find_limit_cycles(loop)) for loop in (inside, outside)]
    assert len(found[0]) == len(found[1]) > 0
    for a, b in zip(*found, strict=True):
        assert a.period == pytest.approx(b.period, rel=1e-8)
        assert a.peak_to_peak["x"] == pytest.approx(b.peak_to_peak["x"], rel=1e-7)


def test_a_rate_limiter_of_own_states_follows_no_faster_than_its_limit() -> None:
    # ds/dt = limit * sat((x - s) / band), y = s: the state of the element stands in its own input.
    law = epp.Saturation(-1.0, 1.0, slope=10.0)
    own = epp.OwnStates([[0.0]], [[0.0, 1.0]], [[-1.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]])
    limiter = epp.AutomatonElement(law.automaton(), own)
    loop = epp.LureSystem.build(
        [[-1.0]], [[0.0]], [[0.0]], [limiter], D_input=[[1.0]], input_names=["u"], x0=[0.0], element_names=["limiter"]
    )
    run = epp.simulate(loop, epp.inputs.Step(3.0), t_end=4.0, t_eval=np.linspace(0.0, 4.0, 401))
    y = run.signals["limiter_output"]
    assert np.abs(np.diff(y)).max() <= 0.01 * (1 + 1e-9)
    np.testing.assert_allclose(y[run.t <= 2.8], run.t[run.t <= 2.8], atol=1e-9)
    assert y[-1] == pytest.approx(3.0, abs=1e-4)


def test_own_states_that_do_not_fit_are_refused() -> None:
    with pytest.raises(epp.ModelError, match=r"OwnStates: B has shape .*; expected"):
        epp.OwnStates([[0.0]], [[0.0, 1.0], [1.0, 0.0]], [[1.0]], [[0.0, 1.0]])
    with pytest.raises(epp.ModelError, match="states of its own; expected none straight before a dead time"):
        epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), lag_behind(epp.Relay(), 1.0), delay=0.1)
    with pytest.raises(epp.ModelError, match="target of the guard 'far' is 5; expected the number of a mode"):
        build = epp.AutomatonBuilder()
        build.guard("far", build.mode("only"), 5, on_input=1.0)
        build.build()
    with pytest.raises(epp.ModelError, match="guard 'on' has a bypass past 'high', which does not stick; expected"):
        build = epp.AutomatonBuilder()
        low, high = build.mode("low"), build.mode("high", constant=1.0)
        build.guard("on", low, high, on_input=1.0, bypass=low)
        build.build()


@pytest.mark.parametrize("name", [n for n, e in SHIPPED.items() if (e.n_inputs, e.n_outputs) == (1, 1)])
def test_means_go_one_way_over_the_bias_where_slopes_do(name: str) -> None:
    # What a search for biases relies on, with a memory as without: a greater input has no smaller answer.
    element = SHIPPED[name]
    low, high = element.slope_bounds()
    amplitude, bias = np.broadcast_arrays(np.geomspace(0.01, 30.0, 20)[:, None], np.linspace(-20.0, 20.0, 401))
    mean = element.describing_function(amplitude, bias)[0]
    rise, least = np.diff(mean, axis=1), -1e-12 * np.abs(mean).max()
    assert low < 0.0 or np.all(rise >= least)
    assert high > 0.0 or np.all(-rise >= least)
