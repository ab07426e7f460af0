"""Pendulums on a cart and on wheels: textbook matrices, Lagrange's equations, a loop against another integrator."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import CaseError, ModelError

#: Cart and pendulum of the Control Tutorials for MATLAB and Simulink (Inverted Pendulum: System Modeling).
TUTORIAL = {"carriage_mass": 0.5, "mass": 0.2, "length": 0.3, "inertia": 0.006, "damping": 0.1, "gravity": 9.8}


TURNED = np.diag([1.0, 1.0, -1.0, -1.0])  # its angle counts the other way


def of_the_tutorial() -> tuple[np.ndarray, np.ndarray]:
    """Its matrices, with p = (M+m)(I+ml^2) - (ml)^2."""
    M, m, L, I, b, g = TUTORIAL.values()  # noqa: E741
    p = (M + m) * (I + m * L**2) - (m * L) ** 2
    A = np.array([
        [0, 1, 0, 0],
        [0, -(I + m * L**2) * b / p, m**2 * g * L**2 / p, 0],
        [0, 0, 0, 1],
        [0, -(m * L * b) / p, m * g * L * (M + m) / p, 0],
    ])  # fmt: skip
    return A, np.array([0, (I + m * L**2) / p, 0, m * L / p])


def test_matrices_of_the_tutorial() -> None:
    """And its numbers as printed."""
    A, B = of_the_tutorial()
    made = epp.blocks.CartPendulum(**TUTORIAL).state_space()
    np.testing.assert_allclose(made.A, TURNED @ A @ TURNED, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(made.B[:, 0], TURNED @ B, rtol=1e-12, atol=1e-14)
    printed = [-0.1818, 2.6727, -0.4545, 31.1818, 1.8182, 4.5455]
    assert [A[1, 1], A[1, 2], A[3, 1], A[3, 2], B[1], B[3]] == pytest.approx(printed, abs=5e-5)


def test_matrices_of_a_robot_of_bricks() -> None:
    """NXTway-GS (Yamamoto 2009): its numbers, without the rotors' inertia; torque is that of both motors."""
    m, R, M, L, g, fm = 0.03, 0.04, 0.6, 0.072, 9.81, 0.0022
    Jw, J = m * R**2 / 2, M * L**2 / 3
    E11, E12, E22 = (2 * m + M) * R**2 + 2 * Jw, M * L * R, M * L**2 + J
    det = E11 * E22 - E12**2
    # Angle of the wheels, that of the body, and their rates.
    A = np.zeros((4, 4))
    A[[0, 1], [2, 3]] = 1.0
    A[2, 1:] = [-g * M * L * E12 / det, -2 * fm * (E22 + E12) / det, 2 * fm * (E22 + E12) / det]
    A[3, 1:] = [g * M * L * E11 / det, 2 * fm * (E12 + E11) / det, -2 * fm * (E11 + E12) / det]
    B = np.array([0.0, 0.0, (E22 + E12) / det, -(E11 + E12) / det])
    robot = epp.blocks.WheeledPendulum(
        carriage_mass=2 * m,
        wheel_inertia=2 * Jw,
        radius=R,
        mass=M,
        length=L,
        inertia=J,
        pivot_damping=2 * fm,
        gravity=g,
    ).state_space()
    # Its states by ours: position over radius, angle, speed over radius, rate.
    T = np.array([[1 / R, 0, 0, 0], [0, 0, 1, 0], [0, 1 / R, 0, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(robot.A, np.linalg.solve(T, A @ T), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(robot.B[:, 0], np.linalg.solve(T, B), rtol=1e-12, atol=1e-12)
    wheels = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]]) @ T
    np.testing.assert_allclose(robot.C, np.vstack([np.eye(4), wheels]), atol=1e-14)


def by_lagrange(given: dict[str, Any], wheels: bool) -> tuple[np.ndarray, np.ndarray]:
    """State and input matrix at rest, of the motion without any approximation."""
    import sympy

    f = {name: sympy.Rational(str(value)) for name, value in given.items()}
    x, a, v, w, F, T = sympy.symbols("x a v w F T")
    roll, twist = (v / f["radius"], v / f["radius"] - w) if wheels else (0, w)
    carriage = f["carriage_mass"] * v**2 + (f["wheel_inertia"] * roll**2 if wheels else 0)
    bob = (v + f["length"] * sympy.cos(a) * w) ** 2 + (f["length"] * sympy.sin(a) * w) ** 2
    kinetic = (carriage + f["mass"] * bob + f["inertia"] * w**2) / 2
    potential = f["mass"] * f["gravity"] * f["length"] * sympy.cos(a)
    power = F * v + T * twist - (f["damping"] * v**2 + f["pivot_damping"] * twist**2) / 2
    V, W = sympy.symbols("V W")
    equations = []
    for q, u in ((x, v), (a, w)):
        momentum = sympy.diff(kinetic, u)
        change = sum(sympy.diff(momentum, s) * r for s, r in ((x, v), (a, w), (v, V), (w, W)))
        equations.append(change - sympy.diff(kinetic - potential, q) - sympy.diff(power, u))
    found = sympy.solve(equations, [V, W], dict=True)[0]
    rates, rest = sympy.Matrix([v, found[V], w, found[W]]), dict.fromkeys((x, a, v, w, F, T), 0)
    return tuple(
        np.array(rates.jacobian(by).subs(rest).tolist(), float) for by in ([x, v, a, w], [T, F] if wheels else [F, T])
    )


@pytest.mark.slow
@pytest.mark.parametrize("gravity", [9.81, -9.81], ids=["upright", "hanging"])
@pytest.mark.parametrize("wheels", [False, True])
def test_matrices_by_lagrange(wheels: bool, gravity: float) -> None:
    given = {
        "carriage_mass": 0.7, "mass": 1.3, "length": 0.45, "inertia": 0.031, "damping": 0.6, "pivot_damping": 0.08,
        "gravity": gravity, **({"radius": 0.11, "wheel_inertia": 0.004} if wheels else {}),
    }  # fmt: skip
    A, B = by_lagrange(given, wheels)
    made = (epp.blocks.WheeledPendulum if wheels else epp.blocks.CartPendulum)(**given).state_space()
    np.testing.assert_allclose(made.A, A, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(made.B, B, rtol=1e-12, atol=1e-13)


GAINS = {"kx": -1.0, "kv": -1.7, "ka": -18.7, "kr": -3.5}


def balanced() -> epp.Diagram:
    """The cart of the tutorial, balanced by a force up to 2 N, with dry friction in its bearings."""
    return epp.Diagram(
        parts={
            "cart": epp.blocks.CartPendulum(**TUTORIAL, start=[0.0, 0.0, 0.12, 0.0]),
            **{name: epp.blocks.Gain(gain=-gain) for name, gain in GAINS.items()},
            "motor": epp.Saturation(-2.0, 2.0),
            "bearings": epp.Coulomb(0.05),
        },
        connect=[
            "cart.position -> kx", "cart.speed -> kv", "cart.angle -> ka", "cart.rate -> kr",
            "kx + kv + ka + kr -> motor", "cart.speed -> bearings", "motor - bearings -> cart.force",
            "0 -> cart.torque",
        ],
    )  # fmt: skip


def test_a_loop_against_another_integrator() -> None:
    A, B = (TURNED @ part for part in of_the_tutorial())
    A, K = A @ TURNED, np.array(list(GAINS.values()))
    run = epp.simulate(balanced().to_system(), t_end=4.0)
    times = [0.0, *(event.time for event in run.events), 4.0]
    assert len(times) > 3
    x = np.array([0.0, 0.0, 0.12, 0.0])
    for begin, end in zip(times, times[1:], strict=False):
        side = np.sign(A[1] @ x + B[1] * np.clip(-K @ x, -2, 2)) if abs(x[1]) < 1e-9 else np.sign(x[1])

        def rates(t: float, x: np.ndarray, side: float = side) -> np.ndarray:
            return A @ x + B * (np.clip(-K @ x, -2.0, 2.0) - 0.05 * side)

        x = solve_ivp(rates, (begin, end), x, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert run.signals["cart_speed"][-1] == pytest.approx(x[1], abs=1e-8)
    assert run.signals["cart_angle"][-1] == pytest.approx(x[2], abs=1e-8)


def test_a_case_says_its_data_in_any_unit() -> None:
    text = epp.Case.from_system(balanced(), "cart").to_toml()
    again = epp.case_from_text(text.replace("length = 0.3", 'length = "30 cm"'))
    assert again.value("cart.length") == 0.3
    with pytest.raises(CaseError, match=r"cart\.carriage_mass.*-1.*more than 0|cart\.carriage_mass.*-1.*positive"):
        epp.case_from_text(text.replace("carriage_mass = 0.5", "carriage_mass = -1.0")).to_system()
    with pytest.raises(ModelError, match="carriage_mass is 1e-200; expected zero, or a number from 1e-50"):
        epp.blocks.CartPendulum(carriage_mass=1e-200, mass=1e-200, length=1e-200).state_space()
