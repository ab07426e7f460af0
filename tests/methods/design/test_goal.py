"""Goals against closed forms: bandwidths of loops known by hand, measures that are kept, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

import eppanalysis as epp
from eppanalysis.methods.design.goal import Goal, Kept, Measure, goal_of

FIRST = """
kind = "diagram"
title = "Integrator behind play, with a lag"
connect = ["-play -> plant", "plant -> play"]
[parameters]
k = 1.0
Ki = "2*k"
[blocks]
plant = { kind = "transfer_function", num = ["k"], den = [0.1, 1, 0] }
[elements]
play = { element = "play", gap = 1.0 }
[run]
t_end = "100 s"
"""


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return epp.case_from_text(FIRST)


@given(st.floats(0.05, 50.0), st.floats(0.02, 5.0))
def test_the_bandwidth_of_a_second_order_loop_is_its_closed_form(k: float, tau: float) -> None:
    """k/(s(tau s + 1)) closed: |T|^2 = k^2/((k - tau w^2)^2 + w^2), half of it where a quadratic in w^2 is zero."""
    loop = epp.LureSystem.from_tf(([k], [tau, 1.0, 0.0]), epp.Play(gap=1.0))
    b = 1.0 - 2.0 * k * tau
    square = (-b + math.sqrt(b * b + 4.0 * tau**2 * k**2)) / (2.0 * tau**2)
    assert epp.margins(loop).bandwidth == pytest.approx(math.sqrt(square), rel=1e-9)


@pytest.mark.parametrize(("k", "tau", "delay"), [(1.0, 0.1, 0.05), (0.05, 0.3, 0.1), (5.0, 0.02, 0.0)])
def test_the_tracking_error_is_one_over_the_velocity_constant(k: float, tau: float, delay: float) -> None:
    """Whatever lags and dead time there are; with two integrators there is none, without one it has no end."""

    def error(num: list[float], den: list[float]) -> float:
        return epp.margins(epp.LureSystem.from_tf((num, den), epp.Play(gap=1.0), delay=delay)).tracking_error

    assert error([k], [tau, 1.0, 0.0]) == pytest.approx(1.0 / k, rel=1e-9)
    assert error([k, k * k / 4.0], [1.0, 0.0, 0.0]) == pytest.approx(0.0, abs=1e-9)
    assert math.isinf(error([k], [tau, 1.0]))
    assert math.isnan(error([-k], [tau, 1.0, 0.0]))


def test_a_tracking_error_is_kept_at_most(case: epp.Case) -> None:
    goal = goal_of(case, None, "tracking_error", {"tracking_error": "0.5 s"}, None)
    assert goal.judge(case.with_values({"k": 4.0})).worth == pytest.approx(-0.25)
    assert [goal.judge(case.with_values({"k": k})).feasible for k in (1.9, 2.1, 30.0)] == [False, True, True]
    assert f"{goal.kept[0]} {goal.kept[0].side}" == "tracking error of 0.5 s at most"


def test_an_unstable_loop_has_no_bandwidth_and_one_that_passes_all_an_infinite_one() -> None:
    unstable = epp.LureSystem.from_tf(([30.0], [1.0, 3.0, 2.0, 0.0]), epp.Play(gap=1.0))
    assert math.isnan(epp.margins(unstable).bandwidth)
    direct = epp.LureSystem.from_tf(([2.0, 3.0], [1.0, 1.0]), epp.Saturation())
    assert math.isinf(epp.margins(direct).bandwidth)


def test_a_goal_is_a_measure_or_a_number_that_follows_from_the_tuned_ones(case: epp.Case) -> None:
    margins = epp.margins(case)
    assert Goal("bandwidth", 1.0).judge(case).worth == margins.bandwidth
    assert Goal("crossover", -1.0).judge(case).worth == -margins.gain_crossover
    assert Goal("Ki", 1.0).judge(case.with_values({"k": 3.0})).worth == pytest.approx(6.0)
    kept = (Kept(Measure.PHASE_MARGIN, math.radians(60)), Kept(Measure.CROSSOVER, 0.1))
    judged = Goal("k", 1.0, kept).judge(case)
    assert judged.feasible and judged.tightest == kept[0]
    assert judged.slack == pytest.approx(margins.phase_margin / math.radians(60) - 1.0)
    assert not Goal("k", 1.0, kept).judge(case.with_values({"k": 30.0})).feasible


def test_what_is_kept_is_read_with_its_unit(case: epp.Case) -> None:
    goal = goal_of(case, "k", None, {"phase_margin": "45 deg", "bandwidth": "2 Hz", "crossover": "3 rad/s"}, None)
    assert [k.limit for k in goal.kept] == pytest.approx([np.pi / 4, 4 * np.pi, 3.0])
    assert [str(k) for k in goal.kept][:2] == ["phase margin of 45 deg", "bandwidth of 2 Hz"]


@pytest.mark.slow
def test_the_largest_gain_at_a_phase_margin_is_its_closed_form(case: epp.Case) -> None:
    """45 deg at the crossover 1/tau = 10 rad/s, where k = 10 sqrt(2); play makes no cycle with two poles."""
    found = epp.design(case, {"k": ("0.5", 40.0)}, maximise="k", subject_to={"phase_margin": "45 deg"}, verify=False)
    assert found.optimum.at["k"] == pytest.approx(10.0 * math.sqrt(2.0), rel=1e-6)
    assert found.optimum.active == "phase margin of 45 deg"
    assert "The active constraint is the phase margin of 45 deg." in found.sentence


@pytest.mark.slow
def test_what_is_kept_nowhere_would_have_to_give(case: epp.Case) -> None:
    found = epp.design(case, {"k": (20.0, 40.0)}, maximise="k", subject_to={"phase_margin": "60 deg"}, verify=False)
    assert not found.optimum.feasible
    assert "the phase margin of 60 deg is not kept anywhere" in found.sentence
