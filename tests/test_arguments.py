"""Public functions refuse what they cannot take in one sentence, and take what they took before."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import ArrayLike

import eppanalysis as epp
from eppanalysis.arguments import check_counts, checked, floats
from eppanalysis.errors import EppError, ModelError
from eppanalysis.results import Result
from tests.wrong_arguments import calls, doors, outcome

#: Results are what functions return; nobody makes them, and they check nothing.
RESULTS = {name for name in dir(epp) if isinstance(kind := getattr(epp, name), type) and issubclass(kind, Result)} | {
    "Case", "Check", "Event", "ManualTable", "OrbitStability", "PeriodicResponse", "Proof", "Remedies",
    "ResponseBranch", "Status",
}  # fmt: skip
BASES = {
    "CaseError", "ElbowParameters", "EppError", "ModelError", "Nonlinearity", "NotConverged", "__version__",
    "inputs", "blocks",
    # What an element of one's own is put together from; `AutomatonElement` looks at it.
    "Automaton", "AutomatonBuilder", "Guard", "Mode", "Smooth",
}  # fmt: skip


def test_everything_public_is_called() -> None:
    called = {door.name for door in doors()}
    assert set(dir(epp)) - RESULTS - BASES <= called
    for door in doors():
        if inspect.isfunction(door.call) and hasattr(door.call, "__wrapped__"):
            assert set(door.good) == set(inspect.signature(door.call).parameters), door.name


@pytest.mark.filterwarnings("ignore")
def test_a_wrong_argument_ends_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample; ``tests/stress`` has more of them."""
    monkeypatch.chdir(tmp_path)
    ends = {str(call): outcome(call, 0.25) for call in calls(7)[:600]}
    assert not {c: end for c, end in ends.items() if end not in ("refused", "answers", "at work")}
    assert sum(end == "refused" for end in ends.values()) > 300


def everything(
    a: float = 0.0,
    b: int | None = None,
    c: Sequence[str] = (),
    d: Mapping[str, float] | None = None,
    e: ArrayLike = 0.0,
    f: tuple[object, object] = (1, 2),
    g: Literal["x", "y"] = "x",
    h: str | Path = "",
    i: object = None,
    j: bool = False,
    *,
    k: epp.LureSystem | None = None,
) -> str:
    return "done"


MOST = ", at most 100000000 of them and none masked."


@pytest.mark.parametrize(
    "good",
    [
        {"a": 1}, {"a": np.float32(1.5)}, {"a": Fraction(1, 2)}, {"a": float("inf")}, {"b": np.int64(3)}, {"b": None},
        {"c": ["u", "v"]}, {"c": np.array(["u"])}, {"d": {"u": 1}}, {"e": [[1, 2], [3, 4]]}, {"e": np.eye(2)}, {"e": 3},
        {"f": ["1 deg", 2]}, {"g": "y"}, {"h": Path("x")}, {"i": object()}, {"j": np.True_},
    ],
)  # fmt: skip
def test_what_an_annotation_says_is_taken(good: dict[str, object]) -> None:
    assert checked(everything)(**good) == "done"


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"b": 1.0}, "b is 1.0; expected a whole number or None."),
        ({"b": True}, "b is True; expected a whole number or None."),
        ({"b": 10**400}, "expected a whole number or None."),
        ({"c": "uv"}, "c is 'uv'; expected a sequence, each item a text."),
        ({"c": [1]}, "c is [1]; expected a sequence, each item a text."),
        ({"d": [1]}, "d is [1]; expected a mapping by name, each value a number, or None."),
        ({"e": [[1], [2, 3]]}, "e is [[1], [2, 3]]; expected an array of numbers."),
        ({"e": "1"}, "e is '1'; expected an array of numbers."),
        ({"e": range(10**9)}, f"e is range(0, 1000000000); expected an array of numbers{MOST}"),
        ({"e": np.broadcast_to(1.0, (10**6, 10**6))}, f"expected an array of numbers{MOST}"),
        ({"e": [[1.0], range(10**9)]}, f"expected an array of numbers{MOST}"),
        ({"e": (1.0 for _ in range(3))}, "expected an array of numbers."),
        ({"e": np.ma.array([1.0, 2.0], mask=[0, 1])}, f"expected an array of numbers{MOST}"),
        ({"c": np.broadcast_to("u", 10**9)}, f"expected a sequence, each item a text{MOST}"),
        ({"f": (1, 2, 3)}, "f is (1, 2, 3); expected 2 values in a row."),
        ({"g": "z"}, "g is 'z'; expected 'x' or 'y'."),
        ({"h": 1}, "h is 1; expected a text or a path that a file can have."),
        ({"j": 1}, "j is 1; expected True or False."),
        ({"k": np.zeros((2, 3))}, "k is an array of shape (2, 3); expected a LureSystem or None."),
    ],
)
def test_what_an_annotation_does_not_say_is_refused(bad: dict[str, object], words: str) -> None:
    with pytest.raises(EppError) as caught:
        checked(everything)(**bad)
    assert str(caught.value).startswith("everything: ") and words in str(caught.value)


def test_too_few_arguments_are_what_they_are_in_python() -> None:
    with pytest.raises(TypeError, match="missing a required argument: 'system'"):
        epp.simulate()


def test_public_functions_travel_to_other_processes() -> None:
    for name in ("simulate", "case", "sweep", "report"):
        function = getattr(epp, name)
        assert pickle.loads(pickle.dumps(function)) is function


def test_counts_and_arrays() -> None:
    with pytest.raises(EppError, match="f: workers is 5000; expected 1024 or less"):
        check_counts("f", {"workers": (5000, 1)})
    with pytest.raises(ModelError, match="gap is 'wide'; expected numbers"):
        floats("wide", "gap")
    with pytest.raises(ModelError, match="x: holds complex numbers; expected real ones"):
        floats(np.array([1.0, 2.0 + 1e-3j]), "x")
    assert floats(np.array([1.0 + 0.0j]), "x").tolist() == [1.0]
    for large in (range(10**9), np.broadcast_to(0.5, (10**9,)), np.ma.array([0.5, 0.9], mask=[False, True])):
        with pytest.raises(EppError, match="of them and none masked"):
            floats(large, "x")
        with pytest.raises(EppError, match="expected a list of numbers"):
            epp.blocks.TransferFunction(num=large, den=[1.0, 1.0])
    with pytest.raises(ModelError, match="Quantiser: levels is 1000000000000; expected a positive whole number of"):
        epp.Quantiser(0.1, 10**12)
    with pytest.raises(EppError, match=r"simulate: max_events is 1000000000000\.0; expected a whole number"):
        epp.simulate(epp.case("relay_deadzone").to_system(), max_events=1e12)


def test_a_name_that_is_no_argument_is_told_with_what_was_meant():
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    with pytest.raises(TypeError, match="simulate: got an unexpected keyword argument 'tend'; did you mean 't_end'"):
        epp.simulate(loop, tend=5.0)


@pytest.mark.parametrize("made", [epp.Saturation, epp.DeadZone, epp.Relay])
def test_one_side_alone_is_not_taken_for_both(made):
    with pytest.raises(epp.ModelError, match=rf"both, as in {made.__name__}\(-0.5, 0.5\)"):
        made(0.5)
    low, high = list(inspect.signature(made).parameters)[:2]
    assert made(**{low: -0.5}) == made(-0.5, 1.0) == made(-0.5, **{high: 1.0})


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (lambda loop: epp.simulate(loop, 100), "did you mean t_end=100?"),
        (lambda loop: epp.simulate(loop, 20.0), "did you mean t_end=20.0?"),
        (lambda loop: epp.simulate(loop, None, "soon"), "expected a number"),
        (lambda loop: epp.simulate(None), "expected a Case or a LureSystem."),
        (lambda loop: epp.certify(loop, None), "expected a text."),
    ],
)
def test_an_argument_in_the_place_of_another_is_told_which(call, meant) -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    with pytest.raises(epp.EppError) as caught:
        call(loop)
    assert meant in str(caught.value)
    assert str(caught.value).endswith(meant) or not meant.endswith(("?", "."))


def test_an_argument_by_its_name_is_not_taken_for_another() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    with pytest.raises(epp.EppError) as caught:
        epp.simulate(loop, input=100)
    assert "did you mean" not in str(caught.value)


def test_numbers_that_numpy_or_compiled_code_does_not_take_are_floats() -> None:
    assert epp.inputs.Step(1.0, Fraction(5, 2)) == epp.inputs.Step(1.0, 2.5)
    assert epp.MidRiseQuantiser(2**63, 3).step == 2.0**63
    assert epp.Play(Fraction(1, 2)) == epp.Play(0.5)


@pytest.mark.parametrize("name", ["a\0b", "x" * 256])
def test_a_text_that_no_file_can_be_called_is_no_path(name) -> None:
    for call in (lambda: epp.read_response(name), lambda: epp.sweep(epp.case("relay_deadzone"), {}, store=name)):
        with pytest.raises(epp.EppError, match="a path that a file can have"):
            call()


@pytest.mark.parametrize("analysis", [epp.predict_limit_cycles, epp.simulate, epp.find_limit_cycles])
@pytest.mark.parametrize("size", [1e-310, 1e-60, 1e70, 1e300])
def test_numbers_with_which_no_loop_can_be_computed_are_refused(analysis, size) -> None:
    """Their powers are no numbers, or zero: the describing function lost the cycle of a relay at a level of 1e70."""
    gain, lag = [4.0], [1.0, 2.0, 1.0, 0.0]
    for make in (
        lambda: epp.LureSystem.from_tf((gain, lag), epp.Play(size)),
        lambda: epp.LureSystem.from_tf((gain, lag), epp.RelayDeadZone(1.0, size)),
        lambda: epp.LureSystem.from_tf((gain, lag), epp.Quantiser(size, 5)),
        lambda: epp.LureSystem.from_tf(([size], lag), epp.Play(1.0)),
        lambda: epp.LureSystem.build([[0.5]], [[1.0]], [[1.0]], [epp.Play(1.0)], time_step=size),
        lambda: epp.blocks.Gain(gain=1.0, sample_time=size),
        lambda: epp.blocks.Mass(mass=size),
    ):
        with pytest.raises(epp.EppError, match="from 1e-50 to 1e\\+50 in size"):
            analysis(make())


def test_arithmetic_beyond_all_range_is_one_sentence() -> None:
    with pytest.raises(epp.EppError, match="continue_branch: numbers beyond all range|expected"):
        epp.continue_branch(epp.case("relay_deadzone"), "relay_dead_zone.threshold", 0.5, 1e160, n_points=3)


def test_an_order_that_nothing_interrupts_is_refused() -> None:
    with pytest.raises(epp.EppError, match="order is 1000000; expected 5000 or less"):
        epp.sinusoidal_harmonics(epp.Saturation(), 2.0, order=1_000_000)
