"""Elements of one's own in a case file: what it takes, what it refuses, and that it reads back what was written."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.own import ModeMemory

HOOK = """
kind = "diagram"
title = "Hook"
connect = ["-plant -> hook", "hook -> plant"]

[parameters]
catch = "2 mm"
stiffness = "3 kN/m"

[blocks]
plant = { kind = "transfer_function", num = [1.0], den = [1.0, 3.0, 2.0, 0.0], start = [0.1, 0, 0] }

[elements.hook]
element = "automaton"
start_mode = "free"
start_memory = ["1 mm"]

[elements.hook.modes]
free = {}
pulls = { from_input = "stiffness", from_memory = "-stiffness/2" }

[[elements.hook.guards]]
name = "catches"
mode = "free"
target = "pulls"
on_input = 1
constant = "-catch"
memory_constant = "catch/4"

[[elements.hook.guards]]
mode = "pulls"
target = "free"
on_input = -1
constant = "1 mm"

[run]
t_end = "2 s"
"""


def hook() -> epp.Case:
    return epp.case_from_text(HOOK, "hook")


def test_numbers_are_quantities_and_expressions() -> None:
    element = hook().to_system().elements[0]
    assert isinstance(element, epp.AutomatonElement)
    free, pulls = element.rules.modes
    assert (free.from_input, pulls.from_input, pulls.from_memory) == (0.0, 3000.0, -1500.0)
    catches, lets_go = element.rules.guards
    assert (catches.name, catches.constant, catches.memory_constant) == ("catches", -0.002, 0.0005)
    assert not np.any(catches.memory_from_memory)
    # Without a reset the memory is kept, and without a name the event says where it goes.
    assert (lets_go.name, lets_go.memory_from_memory, lets_go.constant) == ("goes to free", 1.0, 0.001)


def test_its_numbers_are_parameters_of_the_case() -> None:
    changed = hook().with_values({"hook.guards.1.constant": "0.5 mm", "catch": "4 mm"})
    catches, lets_go = changed.to_system().elements[0].automaton().guards
    assert (catches.constant, lets_go.constant) == (-0.004, 0.0005)
    loop = epp.Case.from_system(hook().to_system())
    assert (
        loop.with_values({"hook.guards.1.constant": 0.25}).to_system().elements[0].automaton().guards[1].constant
        == 0.25
    )


@pytest.mark.parametrize(("field", "value", "words"), [
    ("guards.1.constant", "2 N", r"guards\.1\.constant is '2 N'; expected a length"),
    ("guards.1.target", "fre", r"guards\.1\.target is 'fre'; expected the name of a mode: did you mean 'free'"),
    ("guards.0.on_memory", [1, 2], r"guards\.0\.on_memory is \[1, 2\]; expected a number"),
    ("guards.0.slope", 1, r"guards\.0\.slope is 1; expected a field of an automaton: one of name, mode"),
    ("guards", 3, r"hook\.guards is 3; expected a list of tables"),
    ("modes", {}, r"hook\.modes is {}; expected a table of one or more modes"),
    ("modes.pulls.from_smooth", 1, r"from_smooth is 1; expected nothing, as the element has no smooth"),
    ("modes.pulls.level", 1, r"modes.pulls.level is 1; expected nothing, as the mode does not stick"),
    ("modes.pulls.sticking", 1, r"sticking is 1; expected true or false"),
    ("guards.0.constant", [1.0], r"constant is \[1\.0\]; expected a number"),
    ("n_inputs", 0, r"n_inputs is 0; expected a whole number from 1 to 50"),
    ("smooth", [{"kind": "cub"}], r"smooth\.0\.kind is 'cub'; expected a known function: did you mean 'cube'"),
    ("smooth", [{"kind": "cube", "on_smooth": [1.0]}], r"smooth\.0\.on_smooth .* weights of the functions before"),
    ("start_mode", 3, r"start_mode is 3; expected the name of a mode: one of free, pulls"),
    ("memory", 3.0, r"memory is 3\.0; expected a table of mode, memory and reached"),
    ("own_states", {"A": [[1]]}, r"own_states\.B is missing; expected a matrix"),
    ("modes.pulls.constant", "stifness", r"constant is 'stifness'; expected a known parameter .* 'stiffness'"),
    ("modes.pulls.constant", "__import__('os')", r"expected a quantity such as '5 mm', or an expression"),
    ("colour", 1, r"hook\.colour is 1; expected a field of an automaton"),
])  # fmt: skip
def test_what_is_wrong_is_said_in_one_sentence(field: str, value: Any, words: str) -> None:
    with pytest.raises(epp.CaseError, match=words):
        hook().with_values({f"hook.{field}": value})


def test_memory_and_own_states_come_back() -> None:
    own = epp.OwnStates(A=[[-0.5]], B=[[0.0, 1.0]], C=[[-1.0], [1.0]], D=[[1.0, 0.0], [0.0, 0.0]])
    element = epp.AutomatonElement(epp.Play(0.4).automaton(), own)
    memory = ModeMemory(1, (0.125,), 0.25)
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), element, x0=[2.0], memory=memory)
    again = epp.case_from_text(epp.Case.from_system(loop).to_toml()).to_system()
    assert again.memory == (memory,)
    for name in ("A", "B", "C", "D", "x0"):
        np.testing.assert_array_equal(getattr(again, name), getattr(loop, name))
        np.testing.assert_array_equal(getattr(again.elements[0].own_states, name, 0.0), getattr(own, name, 0.0))


def test_modes_of_one_name_are_not_written() -> None:
    build = epp.AutomatonBuilder()
    build.guard("on", build.mode("same"), build.mode("same", from_input=1.0), on_input=1.0)
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.AutomatonElement(build.build()))
    with pytest.raises(epp.ModelError, match="a mode is called 'same'; expected names of modes .* that differ"):
        epp.Case.from_system(loop)


def test_smooth_functions_of_others_come_back_from_a_file():
    smooth = (
        epp.Smooth("square", np.array([2.0]), 0.5),
        epp.Smooth("tanh", np.array([1.0]), on_smooth=(0.25,)),
    )
    build = epp.AutomatonBuilder(smooth=smooth)
    build.mode("smooth", from_smooth=[0.0, 1.0])
    element = epp.AutomatonElement(build.build())
    assert element.output(0.3)[0] == pytest.approx(np.tanh(0.3 + 0.25 * 1.1**2), rel=1e-15)
    assert element.slope_bounds() == (-np.inf, np.inf)
    with pytest.raises(ModelError, match="it has a smooth function of others; expected smooth functions of its inputs"):
        element.describing_function(1.0)
    loop = epp.LureSystem.build([[-1.0]], [[-1.0]], [[1.0]], [element], x0=[2.0], name="nested")
    again = epp.case_from_text(epp.Case.from_system(loop, name="nested").to_toml()).to_system()
    for one, other in zip(smooth, again.elements[0].automaton().smooth, strict=True):
        assert one.on_smooth == other.on_smooth and one.kind == other.kind
    times = np.linspace(0.0, 2.0, 5)
    run = epp.simulate(again, t_end=2.0, t_eval=times)

    def rate(t: float, x: Any) -> Any:
        return -x - np.tanh(x + 0.25 * (2.0 * x + 0.5) ** 2)

    expected = solve_ivp(rate, (0.0, 2.0), [2.0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=times).y[0]
    name = next(iter(run.signals))
    np.testing.assert_allclose(run.signals[name], expected, atol=1e-10)
    with pytest.raises(ModelError, match="on_smooth of smooth function 0 has 1 weights; expected at most 0"):
        wrong = epp.AutomatonBuilder(smooth=(epp.Smooth("cube", np.ones(1), on_smooth=(1.0,)),))
        wrong.mode("smooth", from_smooth=1.0)
        wrong.build()


@pytest.mark.slow
def test_an_own_element_with_a_mean_is_sought_at_few_places_and_has_the_cycles_of_the_shipped_one() -> None:
    system = epp.case("sat_asymmetric").to_system()
    own = epp.AutomatonElement(system.elements[0].automaton())
    known, found = (epp.predict_limit_cycles(replace(system, elements=(e,))) for e in (*system.elements, own))
    assert "sought at a tenth of the places" in found.search
    assert "sought at a tenth of the places" not in known.search
    assert (found.status, known.status) == (epp.Status.INCOMPLETE, epp.Status.CONVERGED)
    assert len(found) == len(known) == 1
    for one, same in zip(known, found, strict=True):
        assert same.omega == pytest.approx(one.omega, rel=1e-9) and same.stable == one.stable
        assert same.peak_to_peak == pytest.approx(one.peak_to_peak, rel=1e-9)
        assert same.mean == pytest.approx(one.mean, rel=1e-8)
