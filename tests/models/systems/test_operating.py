"""The operating point: one meaning for all analyses, for any motion of the inputs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp

T_END = 4.0
times = st.floats(0.01, 8.0, allow_nan=False)
sizes = st.floats(-2.0, 2.0, allow_nan=False)


@st.composite
def input_signals(draw: st.DrawFn) -> epp.inputs.InputSignal:
    """Motions of all kinds, whose changes may come before the end of the run or after it."""
    kind = draw(st.sampled_from(["constant", "step", "steps", "ramp", "recorded"]))
    if kind == "constant":
        return epp.inputs.Constant(draw(sizes))
    if kind == "step":
        return epp.inputs.Step(draw(sizes), draw(times))
    if kind == "ramp":
        start = draw(times)
        return epp.inputs.Ramp(draw(sizes), start, start + draw(times))
    when = sorted(draw(st.sets(times, min_size=2, max_size=4)))
    values = draw(st.lists(sizes, min_size=len(when), max_size=len(when)))
    return (epp.inputs.Steps if kind == "steps" else epp.inputs.Recorded)(when, values)


def _pushed(bias: float = 0.0) -> epp.LureSystem:
    """A loop of a relay with dead zone whose set point comes from outside."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0), name="pushed")
    return epp.LureSystem.build(
        loop.A,
        loop.B,
        loop.C,
        loop.elements,
        D_input=[[1.0]],
        input_names=["hand"],
        v0=[bias],
        x0=loop.x0,
        name="pushed",
    )


@settings(max_examples=200, deadline=None)
@given(input_signals(), sizes)
def test_the_inputs_are_those_at_the_end_of_the_run(input_signal: epp.inputs.InputSignal, bias: float) -> None:
    """Held where the motion's own value is at the end of the run, unless it differs just before and after it."""
    case = epp.Case.from_system(_pushed(bias), input=input_signal, t_end=T_END)
    point = case.operating_point
    assert point.inputs["hand"] == pytest.approx(bias + float(input_signal.value(T_END)), abs=1e-12)
    moves = abs(float(input_signal.value(T_END + 1e-6)) - float(input_signal.value(T_END)))
    jumps = np.any(np.abs(input_signal.breakpoints()[0] - T_END) < 1e-5)
    if not jumps:
        assert point.stands == (moves == 0.0)


@pytest.mark.slow
@settings(max_examples=5, deadline=None)
@given(sizes, st.floats(4.5, 9.0))
def test_what_comes_after_the_run_changes_nothing(late: float, when: float) -> None:
    """Search, prediction and branch are at one operating point, whatever the input does after the end of the run."""
    case = epp.Case.from_system(_pushed(), input=epp.inputs.Steps([0.0, when], [0.2, 0.2 + late]), t_end=T_END)
    (cycle,) = epp.find_limit_cycles(case).stable
    (still,) = epp.find_limit_cycles(case.to_system(), {"hand": 0.2}).stable
    assert cycle.period == still.period
    name = "relay_dead_zone.threshold"
    branch = epp.continue_branch(case, name, 1.0, 0.99, cycle=cycle, n_points=2)
    assert branch.points["period"][0] == pytest.approx(cycle.period, rel=1e-9)
    assert branch.operating_point == cycle.operating_point == epp.predict_limit_cycles(case).operating_point


def test_an_elbow_that_is_pushed_on_after_its_run() -> None:
    steps = {"kind": "steps", "times": ["0 s", "5 s"], "values": ["20 mm", "60 mm"]}
    case = epp.case("fig8a_original").with_values({"run.t_end": "4 s", "run.input": steps})
    point = case.operating_point
    assert point.inputs["harness_position"] == pytest.approx(case.to_system().v0[0] + 0.02, rel=1e-12)
    cycle = epp.predict_limit_cycles(case)[-1]
    exact = epp.exact_orbit(case, cycle)
    branch = epp.continue_branch(case, "lock_pin.backlash", "2.5 deg", "2.49 deg", cycle=exact, n_points=2)
    assert branch.points["period"][0] == pytest.approx(exact.period, rel=1e-9)
    assert cycle.operating_point == exact.operating_point == branch.operating_point == point


def test_all_analyses_refuse_a_sine_with_one_reason() -> None:
    case = epp.Case.from_system(_pushed(), name="pushed", input=epp.inputs.Sine(0.1, 1.0), t_end=T_END)
    name = "relay_dead_zone.threshold"
    cycle = epp.predict_limit_cycles(case, {"hand": 0.0})[-1]
    analyses = {
        "predict": lambda: epp.predict_limit_cycles(case),
        "balance": lambda: epp.harmonic_balance(case, cycle),
        "orbit": lambda: epp.exact_orbit(case, cycle),
        "cycles": lambda: epp.find_limit_cycles(case),
        "trigger": lambda: epp.trigger(case),
        "branch": lambda: epp.continue_branch(case, name, 1.0, 0.9),
        "bounds": lambda: epp.design_bounds(case, "relay_dead_zone.level", name, at=[1.0], within=(0.9, 1.1)),
        "nyquist": lambda: epp.frozen_nyquist(case, cycle),
    }
    said = set()
    for call in analyses.values():
        with pytest.raises(epp.EppError) as refusal:
            call()
        said.add(str(refusal.value))
    (sentence,) = said
    assert sentence.startswith("pushed: input 'hand' is a sine, so there is no operating point for a limit cycle;")


def test_the_ladder_of_a_driven_loop_says_that_it_is_driven() -> None:
    case = epp.Case.from_system(_pushed(), input=epp.inputs.Sine(0.1, 1.0), t_end=T_END)
    found = epp.ladder(case)
    assert found.agreement.name == "DRIVEN"
    assert found.prediction is None and found.search is None
    assert found.verdict.count("input 'hand' is a sine") == 1
    assert found.to_dict()["operating_point"]["moving"] == {"hand": "is a sine"}


def test_inputs_that_are_memory_by_name() -> None:
    """Of two inputs one is a sine: held at a value it stands, and the other one stays where the case has it."""
    one = _pushed()
    both = epp.LureSystem.build(
        one.A, one.B, one.C, one.elements, D_input=[[1.0, 2.0]], input_names=["hand", "load"], x0=one.x0
    )
    case = epp.Case.from_system(
        both, input={"hand": epp.inputs.Sine(1.0, 2.0), "load": epp.inputs.Step(0.1)}, t_end=1.0
    )
    assert str(case.operating_point) == "input 'hand' is a sine"
    found = epp.predict_limit_cycles(case, {"hand": 0.3})
    assert found.operating_point == epp.OperatingPoint({"hand": 0.3, "load": 0.1})
    again = epp.predict_limit_cycles(both, found.operating_point)
    assert [c.period for c in again] == [c.period for c in found]
    with pytest.raises(epp.EppError, match="there is no input 'foot'; expected one of: hand, load"):
        epp.predict_limit_cycles(case, {"hand": 0.0, "foot": 1.0})


def test_a_trigger_is_at_the_operating_point_of_its_search() -> None:
    """The rest of a loop with an integrator is carried along with its set point: so are the disturbances."""
    loop = _pushed()
    here = epp.trigger(loop, cycles=epp.find_limit_cycles(loop, {"hand": 0.7}))
    start = epp.trigger(loop)
    assert [k.name for k in here] == [k.name for k in start] != []
    assert [k.size for k in here] == pytest.approx([k.size for k in start], rel=1e-5, nan_ok=True)
    assert {k.operating_point.inputs["hand"] for k in here if k.operating_point} == {0.7}
