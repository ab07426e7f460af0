"""The flow of a loop with its derivative, and steady motions closed on it, for all kinds of loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.steady import flow
from eppanalysis.methods.steady.closing import CLOSED, close
from eppanalysis.methods.steady.flow import advance, later
from eppanalysis.methods.steady.motion import SteadyMotion
from eppanalysis.models.elements import ControllerMemory
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.inputs import Sine
from tests.coordinates import rotated


def sampled(element: epp.Nonlinearity) -> HybridSystem:
    law = epp.SampledController([[0.5]], [[-0.35]], [[1.0]], [[0.4]], 0.1, delay=0.037)
    plant = np.array([[0.0, 1.0, 0.0], [-1.0, -0.2, 0.0], [0.0, 30.0, -30.0]])
    B = np.array([[0.0, 0.0], [-1.0, -0.3], [0.0, 0.0]])
    C = np.array([[3.0, 0.4, 0.1], [0.6, 0.8, 0.0]])
    loop = epp.LureSystem.build(plant, B, C, [element, law], x0=[1.0, 0.0, 0.0])
    memory = ControllerMemory((0.3,), (0.2,), 0.1, (0.4,), 0.037)
    return steady_hybrid(loop).begun(np.array([1.0, 0.2, -0.1, 0.0]), [None, memory])


def autonomous(element: epp.Nonlinearity) -> HybridSystem:
    loop = epp.LureSystem.from_tf(([2.0, 0.3], [1.0, 1.1, 2.0, 0.4]), element, x0=[1.0, -0.4, 0.7])
    return steady_hybrid(loop)


def driven_loop(element: epp.Nonlinearity, turn: np.ndarray | None = None) -> epp.LureSystem:
    T = np.eye(2) if turn is None else turn
    A, B, C = np.array([[0.0, 1.0], [-1.0, -0.2]]), np.array([[0.0], [-1.0]]), np.array([[1.0, 0.3]])
    back, force, x0 = np.linalg.inv(T), np.array([[0.0], [1.0]]), np.array([0.4, 0.1])
    return epp.LureSystem.build(
        T @ A @ back, T @ B, C @ back, [element], B_input=T @ force, input_names=["force"], x0=T @ x0
    )


def driven(element: epp.Nonlinearity) -> HybridSystem:
    return HybridSystem.from_lure(driven_loop(element), {"force": Sine(0.8, 1.3)})


def broken_away(seed: int | None) -> HybridSystem:
    """A relay whose jumps break the friction of a mass away."""
    parts = {
        "relay": epp.HysteresisRelayDeadZone(on=0.12, off=0.06, level=1.2),
        "mass": epp.blocks.Mass(mass=0.6, damping=0.5, start=[1.0, -0.5]),
        "friction": epp.Friction(coulomb=0.5, static=1.0),
        "spring": epp.blocks.Gain(gain=0.2),
    }
    wires = [
        "setpoint - mass.position -> relay",
        "relay - friction - spring -> mass",
        "mass.position -> spring",
        "mass.speed -> friction",
    ]
    loop = epp.Diagram(parts, wires, inputs=["setpoint"]).to_system()
    return HybridSystem.from_lure(loop if seed is None else rotated(loop, seed), {"setpoint": Sine(0.7, 0.13)})


def limited(element: epp.Nonlinearity) -> HybridSystem:
    """A limiter of rate that reaches what is straight before it, and lets go where that jumps."""
    loop = epp.LureSystem.from_blocks([element, epp.RateLimiter(4.0), ([3.0], [1.0, 3.0, 2.0])])
    return replace(steady_hybrid(loop), x0=np.array([0.3, -0.4, 0.2]))


STARTS = {
    "sampled, saturation": lambda: (sampled(epp.Saturation(-0.3, 0.3)), 4.03),
    "sampled, smooth": lambda: (sampled(epp.Tanh(0.3)), 4.03),
    "play": lambda: (autonomous(epp.Play(0.2)), 9.0),
    "hysteresis relay": lambda: (autonomous(epp.HysteresisRelay(-0.1, 0.1)), 9.0),
    "preload": lambda: (autonomous(epp.Preload(0.4, 1.0)), 9.0),
    "relay, then a limit of rate": lambda: (limited(epp.HysteresisRelay(-0.1, 0.1)), 9.0),
    "smooth": lambda: (autonomous(epp.Tanh(0.5)), 9.0),
    "driven saturation": lambda: (driven(epp.Saturation(-0.05, 0.05)), 11.0),
    "driven friction": lambda: (driven(epp.Friction(0.03)), 11.0),
    "relay and friction": lambda: (broken_away(None), 14.0),
    "relay and friction, turned": lambda: (broken_away(0), 14.0),
}


def ends(start: HybridSystem, duration: float) -> np.ndarray:
    run = flow.run_over(start, duration)
    assert run is not None
    end = run.end(start)
    return np.concatenate([end.x0, end.H0])


@pytest.mark.parametrize("name", STARTS)
def test_the_derivative_of_a_pass_is_that_of_differences(name: str) -> None:
    start, duration = STARTS[name]()
    found = advance(start, duration)
    assert found is not None and found.events.size > (-1 if "smooth" in name else 1)
    n, one = start.x0.size, found.y.size - 1
    for k in range(one):
        both = []
        for sign in (1e-6, -1e-6):
            y = found.y.copy()
            y[k] += sign
            both.append(ends(replace(start, x0=y[:n], H0=y[n:]), duration))
        difference = (both[0] - both[1]) / 2e-6
        np.testing.assert_allclose(found.derivative[:, k], difference, atol=3e-7 * (1.0 + np.abs(difference).max()))


@pytest.mark.parametrize("name", STARTS)
def test_the_derivative_of_two_passes_is_the_product(name: str) -> None:
    start, duration = STARTS[name]()
    whole, first = advance(start, duration), advance(start, 0.37 * duration)
    middle = later(start, 0.37 * duration)
    assert whole is not None and first is not None and middle is not None
    second = advance(middle, 0.63 * duration)
    assert second is not None
    product = second.derivative @ first.derivative
    np.testing.assert_allclose(product, whole.derivative, atol=1e-9 * np.abs(whole.derivative).max())


def test_the_clock_does_not_depend_on_events_that_shift() -> None:
    """The clock of a sampled controller grows by one a second: what events shift the end by must not reach it."""
    start, duration = STARTS["sampled, saturation"]()
    found = advance(start, duration)
    assert found is not None
    (clock,) = np.flatnonzero(flow.advances(start)[: start.x0.size])
    own = np.eye(found.y.size)[clock]
    np.testing.assert_allclose(found.derivative[clock, :-1], own[:-1], atol=1e-12)


def relay_loop() -> HybridSystem:
    return steady_hybrid(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay()))


def test_an_autonomous_motion_is_closed_from_afar() -> None:
    """Of a relay round 1/(s (s + 1) (s + 2)): half a period turns the state over, and the input is zero there."""
    A, b, c = np.array([[-3.0, -2.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([-1.0, 0.0, 0.0]), 2

    def input_at_the_switch(half: float) -> float:
        E = expm(np.block([[A, b[:, None]], [np.zeros((1, 4))]]) * half)
        return float(np.linalg.solve(np.eye(3) + E[:3, :3], -E[:3, 3])[c])

    period = 2.0 * brentq(input_at_the_switch, 1.0, 4.0, xtol=1e-14)
    hybrid = relay_loop()
    run = flow.run_over(hybrid, 13.0)
    assert run is not None
    found = close(SteadyMotion.begun(run.end(hybrid), 4.0), given=False)
    assert found is not None and found.gap < CLOSED
    assert found.duration == pytest.approx(period, rel=1e-12)
    values = found.multipliers
    assert values is not None and np.min(np.abs(values - 1.0)) < 1e-9 and np.sum(np.abs(values) > 1e-3) <= 2


@pytest.mark.parametrize("turned", [False, True])
def test_a_driven_motion_is_the_closed_form_of_its_linear_part(turned: bool) -> None:
    """Within its limits a saturation is a gain: the response is that of a transfer function, in any states."""
    turn = np.array([[1.0e3, 2.0], [-3.0, 4.0e-3]]) if turned else None
    loop, sine = driven_loop(epp.Saturation(-50.0, 50.0), turn), Sine(0.8, 1.3)
    found = close(SteadyMotion.begun(HybridSystem.from_lure(loop, {"force": sine}), 1.0 / 1.3), given=True)
    assert found is not None and found.gap < CLOSED
    # x'' + 0.2 x' + x = force - (x + 0.3 x')
    exact = np.array([[0.0, 1.0], [-2.0, -0.5]])
    values = np.sort_complex(np.exp(np.linalg.eigvals(exact) * found.duration))
    assert found.multipliers is not None
    np.testing.assert_allclose(np.sort_complex(found.multipliers), values, atol=1e-10)
    omega = 2.0 * np.pi * 1.3
    phasor = 0.8 / complex(2.0 - omega**2, 0.5 * omega)
    sine_now, cosine_now = found.start.x0[2:]
    x = loop.C @ found.start.x0[:2]
    both = phasor * (1.0 + 0.3j * omega)
    assert x[0] == pytest.approx(both.real * sine_now + both.imag * cosine_now, rel=1e-9)


def begun_near(hybrid: HybridSystem, duration: float) -> SteadyMotion:
    run = flow.run_over(hybrid, 13.0)
    assert run is not None
    begin = SteadyMotion.begun(run.end(hybrid), duration)
    assert begin is not None
    return begin


@pytest.mark.parametrize("pieces", [2, 3, 7])
def test_a_motion_closed_in_pieces_is_that_closed_in_one(pieces: int) -> None:
    begin = begun_near(relay_loop(), 4.0)
    once, several = close(begin, given=False), close(begin, given=False, pieces=pieces)
    assert once is not None and several is not None and len(several.passes) == pieces
    assert several.duration == pytest.approx(once.duration, rel=1e-12)
    one, other = (np.sort(np.vstack([p.rows[1:, :3] for p in motion.passes]), axis=0) for motion in (once, several))
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert once.multipliers is not None and several.multipliers is not None
    np.testing.assert_allclose(several.multipliers, once.multipliers, atol=1e-9)


@pytest.mark.parametrize("pieces", [1, 3])
def test_a_motion_up_to_its_image_is_half_of_the_whole_one(pieces: int) -> None:
    hybrid = relay_loop()
    begin, image = begun_near(hybrid, 2.0), np.diag([-1.0] * hybrid.x0.size + [1.0] * hybrid.H0.size)
    half = close(replace(begin, image=image), given=False, pieces=pieces)
    once = close(begun_near(hybrid, 4.0), given=False)
    assert half is not None and once is not None
    assert 2.0 * half.duration == pytest.approx(once.duration, rel=1e-12)
    whole = half.whole()
    assert whole is not None and whole.gap < CLOSED and whole.ends_in_its_modes
    assert whole.multipliers is not None and once.multipliers is not None and half.multipliers is not None
    np.testing.assert_allclose(whole.multipliers, once.multipliers, atol=1e-9)
    # Of half a turn the multipliers are roots of those of the whole: along the motion it is turned round.
    np.testing.assert_allclose(np.sort(np.abs(half.multipliers) ** 2), np.sort(np.abs(once.multipliers)), atol=1e-9)


def test_a_motion_that_leaves_itself_at_once_is_closed_in_pieces_only() -> None:
    """A mode that grows a million millionfold in a period: what one pass ends at says nothing of its start any more."""
    rate = 7.0
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    A = np.block([[loop.A, np.zeros((3, 1))], [np.zeros((1, 3)), np.full((1, 1), rate)]])
    # The relay reads a little of it, and drives it.
    grown = epp.LureSystem.build(A, np.vstack([loop.B, [[1.0]]]), np.hstack([loop.C, [[1e-3]]]), [epp.Relay()])
    plain = close(begun_near(steady_hybrid(loop), 4.0), given=False)
    assert plain is not None
    hybrid, parts = steady_hybrid(grown), plain.placed(8)
    assert parts is not None
    starts = [hybrid.at(np.append(p.start.x0, 0.0), p.start.H0, p.start.modes0) for p in parts.passes]
    begin = SteadyMotion.through(starts, [p.duration for p in parts.passes])
    found = close(begin, given=False, pieces=8)
    assert found is not None and found.duration == pytest.approx(plain.duration, rel=2e-2)
    values = found.multipliers
    assert values is not None and abs(values[0]) == pytest.approx(np.exp(rate * found.duration), rel=0.2)
    alone = SteadyMotion.begun(found.start, found.duration)
    assert alone is not None and alone.gap > CLOSED
