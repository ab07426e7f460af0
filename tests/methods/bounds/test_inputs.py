"""How large a step or a load a loop bears, beside runs of an integrator that knows the relay's switches by halving."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

SERVO = """
kind = "diagram"
title = "Relay servo with a dead zone"
connect = ["ref - plant - load -> relay", "relay -> plant"]
inputs = { ref = "0 deg", load = "0 deg" }
[run]
t_end = "20 s"
[run.inputs]
ref = { kind = "step", size = "45 deg" }
load = { kind = "step", size = "0 deg" }
[parameters]
K = { value = 4.0, mark = "tunable" }
[blocks]
plant = { kind = "transfer_function", num = ["K"], den = [1.0, 2.0, 1.0, 0.0] }
[elements]
relay = { kind = "relay_dead_zone", threshold = "60 deg", level = "1 V" }
"""
THRESHOLD = np.deg2rad(60.0)


@pytest.fixture
def servo(tmp_path):
    path = tmp_path / "relay servo.toml"
    path.write_text(SERVO)
    return path


def rests(K: float, ref: float = 0.0) -> bool:
    """Whether x''' + 2 x'' + x' = K u, u = relay(ref - x), comes to rest, integrated from switch to switch."""
    x, u, t = np.zeros(3), float(np.sign(ref)) * (abs(ref) > THRESHOLD), 0.0
    edges = [lambda t, x, s=s: ref - x[0] - s * THRESHOLD for s in (-1.0, 1.0)]
    for edge in edges:
        edge.terminal = True  # type: ignore[attr-defined]
    for _ in range(400):
        rate = lambda t, x, u=u: [x[1], x[2], K * u - 2.0 * x[2] - x[1]]  # noqa: E731
        run = solve_ivp(rate, (t, t + 200.0), x, events=edges, rtol=1e-11, atol=1e-12)
        if run.status == 0:
            return True
        t, x = run.t[-1], run.y[:, -1]
        x = x + 1e-10 * np.array(rate(t, x))  # a trifle beyond the edge
        error = ref - x[0]
        u = float(np.sign(error)) * (abs(error) > THRESHOLD)
    return False


def test_the_largest_step_that_a_servo_bears_is_that_of_an_independent_integrator(servo) -> None:
    case = epp.read_case(servo)
    found = epp.design_bounds(case, "K", "run.inputs.ref.size", at=[4.0], within=("10 deg", "400 deg"), margin=1e-5)
    low, high = found[0].safe_value, found[0].other_value
    assert found[0].verified and 0 < high - low < 2e-5 * high
    assert rests(4.0, low * (1.0 - 1e-5)) and not rests(4.0, high * (1.0 + 1e-5))
    assert "the case's own run ceases to come to rest" in found.not_covered


def test_it_is_where_a_disturbance_from_rest_starts_a_cycle(servo) -> None:
    """By the search's own boundary, which steps the input of the resting loop."""
    case = epp.read_case(servo)
    hits = {(hit.name, hit.size > 0): hit.size for hit in epp.trigger(case.to_system(), states=[])}
    for name in ("ref", "load"):
        limit = f"run.inputs.{name}.size"
        alone = case.with_values({"run.inputs.ref.size": "0 deg"})
        found = epp.design_bounds(alone, "K", limit, at=[4.0], within=(0.01, 10.0), margin=1e-5)
        assert found[0].safe_value == pytest.approx(hits[name, True], rel=3e-5)


def run(*args: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["bounds", *map(str, args)])
    return result.exit_code, result.output


def test_the_command_needs_nothing_but_the_limit(servo) -> None:
    limit = ["--limit", "run.inputs.ref.size", "--within", "10 deg..400 deg"]
    code, text = run(servo, *limit, "--json")
    cells = json.loads(text)["cases"][0]["result"]["cells"]
    assert code == 0 and len(cells) == 1 and cells[0]["value"] == 4.0
    code, text = run(servo, *limit)
    assert code == 0 and "below a ref size of 68 deg" in text and "for K at 4" in text


@pytest.mark.parametrize(
    ("limit", "within", "sentence"),
    [
        ("run.inputs.ref.rate", None, "run.inputs.ref.rate is 'not known'; expected a known field"),
        ("run.inputs.wind.size", None, "run.inputs.wind.size is 'not known'; expected a known field"),
        ("plant.num", None, "plant.num"),
        ("run.inputs.load.size", None, "load.size is 0 deg in this case; expected a range"),
        ("run.inputs.ref.size", ("1 V", "2 V"), "is '1 V'; expected a quantity in rad"),
    ],
    ids=["field", "input", "list", "range", "unit"],
)
def test_limits_that_are_none_are_refused(servo, limit: str, within, sentence: str) -> None:
    with pytest.raises(epp.EppError, match=re.escape(sentence)):
        epp.design_bounds(epp.read_case(servo), "K", limit, at=[4.0], within=within)


def test_a_case_without_another_parameter_is_one_sentence() -> None:
    code, text = run("sat_khalil710", "--limit", "loop.gain")
    assert code == 2 and "--over: is not given, and sat_khalil710 has no positive parameter but loop.gain" in text


def test_an_expression_runs_by_its_parameters_alone() -> None:
    for over, limit in (("controller.kp", "gap"), ("Kp", "controller.kp")):
        with pytest.raises(epp.EppError, match="controller.kp is 'Kp'; .* vary the parameters of its expression"):
            epp.design_bounds(epp.case("azimuth_servo"), over, limit)
