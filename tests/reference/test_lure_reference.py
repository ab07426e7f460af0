"""The reference integrator on loops whose limit cycles are published or known in closed form."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.signal import tf2ss

from tests.reference.lure_reference import LureRun, simulate_lure

pytestmark = pytest.mark.slow


def _element(kind: str, **fields: Any) -> Any:
    """Anything with the class name and the fields of an element."""
    return type(kind, (SimpleNamespace,), {"n_inputs": 1, "n_outputs": 1})(**fields)


def _pieces(breakpoints: list[float], slopes: list[float], intercepts: list[float]) -> Any:
    return _element("PiecewiseLinear", breakpoints=breakpoints, slopes=slopes, intercepts=intercepts)


def _loop(A: ArrayLike, B: ArrayLike, C: ArrayLike, elements: list[Any], x0: ArrayLike, **more: Any) -> Any:
    A, x0 = np.atleast_2d(np.asarray(A, float)), np.asarray(x0, float)
    n, m = len(A), len(elements)
    C, B = np.asarray(C, float).reshape(m, n), np.asarray(B, float).reshape(n, m)
    D = np.asarray(more.get("D", np.zeros((m, m))), float)
    signals = SimpleNamespace(names=("x",), C=C[:1], D=D[:1], D_input=np.zeros((1, 0)), constant=np.zeros(1))
    return SimpleNamespace(
        A=A,
        B=B,
        C=C,
        D=D,
        B_input=np.zeros((n, 0)),
        D_input=np.zeros((m, 0)),
        v0=np.zeros(0),
        constant_state=np.zeros(n),
        constant_input=np.asarray(more.get("constant_input", np.zeros(m)), float),
        elements=elements,
        element_names=[f"e{i}" for i in range(m)],
        x0=x0,
        memory=[None] * m,
        delays=np.zeros(m),
        time_step=None,
        signals=signals,
    )


def _ring(num: list[float], den: list[float], element: Any, x0: ArrayLike) -> Any:
    A, B, C, _ = tf2ss(num, den)
    return _loop(A, B, -C, [element], x0)


def _omega(run: LureRun, label: str, per_cycle: int = 1) -> float:
    times = run.event_times(label)
    return 2.0 * math.pi / float(times[-1] - times[-1 - per_cycle])


def _sat_and_play() -> Any:
    A, B, C, _ = tf2ss([8.0], [1.0, 1.0, 0.0])
    elements = [_pieces([-0.5, 0.5], [0, 1, 0], [-0.5, 0, 0.5]), _element("Play", gap=1.0)]
    return _loop(A, np.hstack([B, 0 * B]), np.vstack([0 * C, C]), elements, [1, 1], D=[[0, -1], [0, 0]])


def _belt() -> Any:
    friction = _element("Friction", coulomb=1.0, static=1.0, stribeck=3.0)
    return _loop([[0, 1], [-1, 0]], [0, -1], [0, 1], [friction], [1.135, 0], constant_input=[-0.2])


def _hunting() -> Any:
    friction = _element("Friction", coulomb=1.0, static=2.0, stribeck=0.0)
    return _loop([[0, 1, 0], [0, 0, 1], [-5, -10, -1]], [0, 0, -1], [0, 0, 1], [friction], [0.01, 0.5, 0])


CASES = {
    # Åström's half-period equation.
    "relay": (
        lambda: _ring([1], [1, 3, 2, 0], _pieces([0], [0, 0], [-1, 1]), [1, 1, 1]),
        80,
        "e0: piece 1",
        1.3805948690,
    ),
    "hysteresis relay": (
        lambda: _ring([1], [1, 1, 0], _element("HysteresisRelay", lower=-0.1, upper=0.1, low=-1.0, high=1.0), [1, 1]),
        50,
        "e0: up",
        2.2067586794,
    ),
    # Gonçalves et al., IEEE TAC 46(4), 2001: non-minimum phase, half period 2.094.
    "sixth order": (
        lambda: _ring(
            [1, -5, -11, -5, 250, 250],
            [1, 12, 57, 140, 195, 150, 50],
            _element("HysteresisRelay", lower=-0.25, upper=0.25, low=-1.0, high=1.0),
            np.ones(6),
        ),
        60,
        "e0: up",
        1.5001948489,
    ),
    "backlash servo": (
        lambda: _ring([5], [1, 1, 0], _element("Play", gap=2.0), [3, 3]),
        250,
        "e0: falls",
        1.5732321056,
    ),
    "saturation and play": (_sat_and_play, 60, "e1: falls", 1.9635018532),
    # Block on a belt of Leine and van Campen.
    "belt": (_belt, 50, "e0: slips-", 0.5235537807),
    "hunting": (_hunting, 300, "e0: slips+", 0.5231878694),
    # Level loop with a sticky valve after Choudhury, Thornhill and Shah, 2005.
    "valve": (
        lambda: _loop(
            [[0, 0], [-1, 0]],
            [1, 0],
            [-0.4, 0.08],
            [_element("JumpAndFollow", stick_band=5.0, slip_jump=2.0, slope=1.0)],
            [5, 0],
        ),
        800,
        "e0: falls",
        0.2598303118,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_frequency_of_known_limit_cycles(name: str) -> None:
    """Frequencies that a different code (piecewise-linear shooting, closed forms) gives."""
    make, t_end, label, expected = CASES[name]
    run = simulate_lure(make(), np.linspace(0.0, t_end, 101))
    assert _omega(run, label) == pytest.approx(expected, rel=2e-9)


def test_relay_with_dead_zone_and_hysteresis() -> None:
    """Satellite with on-off thrusters: two thruster pulses a cycle, frequency from its closed-form orbit."""
    thruster = _element("HysteresisRelayDeadZone", on=0.1, off=0.08, level=0.05)
    run = simulate_lure(_loop([[0, 1], [0, 0]], [0, 1], [-1, -0.5], [thruster], [0.11, 0]), np.linspace(0, 600, 11))
    assert _omega(run, "e0: up", per_cycle=2) == pytest.approx(0.3205706789, rel=1e-8)


def test_driven_play_is_the_textbook_loop() -> None:
    """Play driven by sin t through an input: output held at the turns, at half a gap from the input otherwise."""
    system = _loop(np.zeros((1, 1)), [0], [0], [_element("Play", gap=0.6)], [0])
    system.v0, system.B_input, system.D_input = np.zeros(1), np.zeros((1, 1)), np.ones((1, 1))
    signals = SimpleNamespace(
        names=("x", "y"),
        C=np.zeros((2, 1)),
        D=np.array([[0.0], [1.0]]),
        D_input=np.array([[1.0], [0.0]]),
        constant=np.zeros(2),
    )
    system.signals = signals
    t = np.array([0.1, math.pi / 2, 2.0, math.pi, 1.5 * math.pi, 2 * math.pi])
    run = simulate_lure(system, t, inputs=[(math.sin, math.cos)])
    np.testing.assert_allclose(run.signals["y"], [0.0, 0.7, 0.7, 0.3, -0.7, -0.3], atol=1e-9)


def test_unknown_elements_are_refused() -> None:
    """The reference says what it does not know."""
    with pytest.raises(NotImplementedError, match="LockPin"):
        simulate_lure(_loop([[0.0]], [1], [1], [_element("LockPin", gap=1.0)], [0]), [0.0, 1.0])
