"""A recorded response of a loop in discrete time, by an iteration of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp

TANK = """
kind = "diagram"
title = "digital level control"
connect = ["setpoint - tank -> pi", "pi -> valve", "valve -> tank"]
inputs = { setpoint = 0 }
signals = { level = { of = "tank" } }
run = { t_end = "40 s" }
[parameters]
pole = { value = 0.8, mark = "tunable" }
limit = { value = 1.0, mark = "tunable" }
[blocks]
pi = { kind = "transfer_function", num = [1.5, -1.2], den = [1, -1], sample_time = 0.2 }
tank = { kind = "transfer_function", num = [0.25], den = [1, "-pole"], sample_time = 0.2 }
[elements]
valve = { element = "saturation", lower = "-limit", upper = "limit" }
"""
T, COUNT = 0.2, 120
SETPOINT = np.where(np.arange(COUNT) % 60 < 30, 1.5, -1.0)


def iterated(pole: float, limit: float) -> np.ndarray:
    level = summed = last = 0.0
    out = []
    for target in SETPOINT:
        error = target - level
        summed, last = summed + 1.5 * error - 1.2 * last, error
        out.append(level)
        level = pole * level + 0.25 * np.clip(summed, -limit, limit)
    return np.array(out)


def recorded(path: Path, level: np.ndarray, repeats: int = 1) -> Path:
    """Rows at the samples, or several in each, between which a signal is held."""
    noise = 0.02 * np.random.default_rng(3).normal(size=level.size * repeats)
    time = T / repeats * np.arange(level.size * repeats)
    rows = zip(time, np.repeat(level, repeats) + noise, np.repeat(SETPOINT, repeats), strict=True)
    text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
    path.write_text(f"time [s],level,setpoint\n{text}\n", encoding="utf-8")
    return path


def test_runs_are_those_of_the_iteration() -> None:
    case = epp.case_from_text(TANK).with_values({"pole": 0.85, "limit": 1.4})
    run = epp.simulate(case, epp.inputs.Recorded(T * np.arange(COUNT), SETPOINT), t_end=T * (COUNT - 1))
    assert run.signals["level"] == pytest.approx(iterated(0.85, 1.4), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("truth", "repeats"), [({"limit": 1.4}, 1), ({"pole": 0.85, "limit": 1.4}, 3)])
def test_parameters_of_a_difference_equation_are_found(
    tmp_path: Path, few_draws: None, truth: dict[str, float], repeats: int
) -> None:
    path = recorded(tmp_path / "tank.csv", iterated(truth.get("pole", 0.8), truth["limit"]), repeats)
    fit = epp.identify(epp.case_from_text(TANK), step=path, fit=tuple(truth)).fits[0]
    assert fit.status is epp.Status.CONVERGED, str(fit)
    for name, value in truth.items():
        assert fit[name].identified and fit[name].low < value < fit[name].high, str(fit[name])
        assert fit[name].relative_width < 0.05
    assert fit.residuals["level"].rms == pytest.approx(0.02, rel=0.2)
