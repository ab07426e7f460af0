"""The PID controller with anti-windup: in a loop against another integrator, and without its limit a PID."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError

PLANT = ([[0.0, 1.0], [0.0, -1.0]], [[0.0], [1.0]], [[-1.0, 0.0]])


def servo(controller: epp.Nonlinearity) -> epp.LureSystem:
    """A position servo 1/(s (s + 1)) behind a controller of the error."""
    return epp.LureSystem.build(
        *PLANT, [controller], D_input=[[1.0]], input_names=["r"], element_names=["pid"], name="servo"
    )


def by_hand(c: Any, r: float, times: np.ndarray) -> np.ndarray:
    """Position and speed, integrator and filter, of the servo behind a step, by another integrator."""

    def v_of(x: Any) -> float:
        e = r - x[0]
        return float(c.kp * e + x[2] + (c.kd / c.filter_time * (e - x[3]) if c.kd else 0.0))

    def rates(t: float, x: Any) -> list[float]:
        e, v = r - x[0], v_of(x)
        u = float(np.clip(v, c.lower, c.upper))
        filtered = (e - x[3]) / c.filter_time if c.kd else 0.0
        return [x[1], -x[1] + u, c.ki * e + (u - v) / c.tracking_time, filtered]

    edges = [lambda t, x: v_of(x) - c.upper, lambda t, x: v_of(x) - c.lower]
    for edge in edges:
        edge.terminal = True  # type: ignore[attr-defined]
    t, x, found = 0.0, np.zeros(4), []
    while True:
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True}
        run = solve_ivp(rates, (t, times[-1]), x, events=edges, **options)
        inside = times[(times >= t) & ((times < run.t[-1]) | (run.status == 0))]
        found.append(run.sol(inside) if inside.size else np.zeros((4, 0)))
        if run.status == 0:
            return np.hstack(found)
        t, x = run.t[-1], run.y[:, -1]
        t, x = t + 1e-10, x + 1e-10 * np.array(rates(t, x))  # past the edge, which would be found again


@pytest.mark.parametrize("controller", [
    epp.AntiWindupPID(2.0, 1.5, 0.4),
    epp.AntiWindupPID(2.0, 1.5, 0.4, lower=-0.3, upper=0.8, kd=1.0, filter_time=0.1),
])  # fmt: skip
def test_a_step_against_another_integrator(controller: Any) -> None:
    times = np.linspace(0.0, 12.0, 121)
    run = epp.simulate(servo(controller), epp.inputs.Step(3.0), t_end=12.0, t_eval=times)
    expected = by_hand(controller, 3.0, times)
    np.testing.assert_allclose(3.0 - run.signals["pid_input"][1:], expected[0, 1:], atol=1e-9)
    assert np.count_nonzero(run.signals["pid_output"] == controller.upper) > 10


def test_without_reaching_its_limits_it_is_a_pid() -> None:
    pid = epp.AntiWindupPID(2.0, 1.5, 0.4, kd=1.0, filter_time=0.1, lower=-50.0, upper=50.0)
    loop = servo(pid)
    plain = epp.LureSystem.from_blocks(
        [epp.PiecewiseLinear([], [1.0], [0.0]), ([1.0], [1.0, 1.0, 0.0]),
         (np.polyadd(np.polymul([2.0, 1.5], [0.1, 1.0]), [1.0, 0.0, 0.0]), [0.1, 1.0, 0.0])],
    )  # fmt: skip
    one, other = epp.margins(loop).numbers(), epp.margins(plain).numbers()
    assert np.isfinite(other["phase_margin"])
    for name, value in other.items():
        assert one[name] == pytest.approx(value, rel=1e-6, nan_ok=True)


def test_back_calculation_keeps_the_overshoot_small() -> None:
    peaks = []
    for tracking in (0.2, 1e6):
        run = epp.simulate(servo(epp.AntiWindupPID(2.0, 1.0, tracking)), epp.inputs.Step(5.0), t_end=60.0)
        peaks.append(5.0 - run.signals["pid_input"].min())
    assert peaks[0] < 0.8 * peaks[1]


def test_it_comes_back_from_a_file() -> None:
    loop = epp.LureSystem.from_blocks([epp.AntiWindupPID(2.0, 1.5, 0.4), ([1.0], [1.0, 1.0, 0.0])], name="servo")
    again = epp.case_from_text(epp.Case.from_system(loop, name="servo").to_toml()).to_system()
    for name in ("A", "B", "C", "D", "x0"):
        np.testing.assert_array_equal(getattr(again, name), getattr(loop, name))


@pytest.mark.parametrize(("fields", "words"), [
    ({"tracking_time": 0.0}, "AntiWindupPID: tracking_time is 0.0; expected a positive number"),
    ({"lower": 2.0}, r"AntiWindupPID: upper is 1.0; expected more than lower \(2.0\)"),
    ({"kd": 1.0}, "AntiWindupPID: filter_time is 0.0; expected a positive number, as there is a derivative"),
    ({"ki": float("nan")}, "AntiWindupPID: ki is nan; expected a finite number"),
])  # fmt: skip
def test_fields_are_checked(fields: dict[str, float], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        epp.AntiWindupPID(**({"kp": 1.0, "ki": 1.0, "tracking_time": 0.5} | fields))
