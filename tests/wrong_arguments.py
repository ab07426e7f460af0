"""Public functions and classes called with one wrong argument after the other: what ends ill must end in a sentence.

Every call has good arguments in all places but one. What comes in that place may happen to be right (no value is wrong
for all places); then the call may do its work, for which it has little time.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import random
import signal
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import eppanalysis as epp
from eppanalysis.methods.bounds.result import BoundCell
from eppanalysis.models.elements import ELEMENTS
from tests.made_bounds import bounds_of

HUGE = 10**400
#: What is put into the place of an argument.
WRONG: tuple[Any, ...] = (
    None, "", "x", "nan", "1 parsec", b"x", True, -1, 0, 1, -0.5, 1e308, 10**12, -(10**12), HUGE,
    float("nan"), float("inf"), -float("inf"), 1j, [], [1], [1, 2, 3], [[1, 2], [3]], ["x"], [None], [float("nan")],
    (), (1, 2), ("a", "b"), {}, {"a": 1}, {1: 2}, {"x": "y"}, {"x": None}, {"x": [1, 2]}, set(), object(), object, len,
    np.array(1.0),
    np.array([]), np.array([np.nan]), np.zeros((2, 3, 4)), np.array(["a"]), np.eye(2), Path("nowhere") / "nothing",
    epp.Status.CONVERGED, epp.StateSpace, epp.StateSpace.__init__, range(3), iter(()),
)  # fmt: skip


@dataclass(frozen=True)
class Door:
    """Something public that can be called, and arguments with which it works."""

    name: str
    call: Callable[..., Any]
    good: dict[str, Any]


@cache
def doors() -> tuple[Door, ...]:
    """Public functions, constructors and methods that take arguments; a test compares them with the public names."""
    return (*_functions(), *_elements(), *_constructors(), *_measured(), *_methods())


def _functions() -> Iterator[Door]:
    """Every public function with its own defaults, and what it needs beside them, or what makes it cheap."""
    case = epp.case("relay_deadzone")
    usual: dict[str, Any] = {"case": case, "loop": case.to_system(), "system": case.to_system()}
    known = _needed(case)
    for name in dir(epp):
        function = getattr(epp, name)
        if not inspect.isfunction(function):
            continue
        given = usual | known.get(name, {})
        good = {
            place: given.get(place, parameter.default)
            for place, parameter in inspect.signature(function).parameters.items()
        }
        lacking = [place for place, value in good.items() if value is inspect.Parameter.empty]
        assert not lacking, f"{name}: say in tests/wrong_arguments.py what {' and '.join(lacking)} may be"
        yield Door(name, function, good)


def _needed(case: epp.Case) -> dict[str, dict[str, Any]]:
    elbow, swing = epp.case("fig8a_original"), np.linspace(0.0, 40.0, 400)
    cycle = epp.predict_limit_cycles(case.to_system())[1]
    threshold, level = "relay_dead_zone.threshold", "relay_dead_zone.level"
    elbow_limit = ("bands.range", "lock_pin.backlash")
    few = {"starts": 10, "seed": 1}
    lag = epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0])
    wires = ["hand - lag -> valve", "valve -> lag"]
    driven = epp.Diagram({"valve": epp.Saturation(), "lag": lag}, wires, inputs=["hand"]).to_system()
    sine: dict[str, Any] = {"system": driven, "input": "hand", "amplitude": 0.5, "frequency": 0.2}
    branch: dict[str, Any] = {**sine, "output": "lag", "n_points": 3, "max_step": 0.1}
    plane = {threshold: [0.5, 0.6], level: [1.0, 1.1]}
    cells = epp.sweep(case, plane, progress=False)
    at_once = {"workers": 1, "progress": False}
    return {
        "case": {"name": "relay_deadzone"},
        "case_from_text": {"text": 'base = "relay_deadzone"'},
        "read_case": {"path": Path("nowhere.toml")},
        "simulate": {"t_end": 1.0, "max_events": 100, "max_steps": 1000},
        "certify": {"sectors": 4},
        "certify_orbit": {"cycle": cycle},
        "check_certificate": {"path": Path("nowhere.json")},
        "check_element": {"element": epp.HysteresisRelay(-0.1, 0.1), "amplitudes": [1.0, 2.0], "name": "relay"},
        "from_fmu": {"path": "nowhere.fmu", "elements": {"x": epp.Saturation()}},
        "to_fmu": {"path": Path("nowhere") / "loop.fmu"},
        "from_control": {"system": case.to_system().to_control(), "elements": case.to_system().connections},
        "from_robot": {"path": Path("nowhere.xml"), "joint": "shoulder"},
        "olop": {
            "loop": epp.LureSystem.from_tf(([4.0], [1.0, 1.0, 0.0]), epp.RateLimiter(1.0)), "amplitude": 0.5
        },
        "read_linear": {"path": "nowhere.mat"},
        "read_response": {"path": "nowhere.csv"},
        "rational_model": {"response": _response(), "order": 2},
        "margins": {"loop": epp.case("sat_khalil710")},  # through a relay there are none
        "harmonic_balance": {"guess": cycle, "order": 3},
        "exact_orbit": {"start": cycle},
        "find_limit_cycles": {"by_balance": False, "predicted": []},
        "frozen_nyquist": {"system": elbow.to_system(), "cycle": cycle},
        "continue_branch": {"parameter": threshold, "start": 0.5, "stop": 0.6, "n_points": 3, "max_step": 0.05,
                            "n_others": 0},
        "continue_folds": {"parameter": threshold, "other": level, "limits": (0.5, 2.0), "over": (1.0, 1.1),
                           "n_points": 2},
        "forced_response": {**sine, "most_periods": 1},
        "frequency_response": {**branch, "frequencies": (0.1, 0.2)},
        "amplitude_response": {**branch, "amplitudes": (0.1, 0.2)},
        "sinusoidal_harmonics": {"element": epp.Saturation(), "amplitude": 2.0, "order": 3},
        "dither": {"frequency": 50.0, "tolerance": 0.1},
        "smoothed": {"element": epp.Saturation(), "amplitude": 0.5},
        "design_bounds": {"over": level, "limit": threshold, "start": 1.0, "stop": 1.1, "points": 1,
                          "within": (0.4, 2.0), "exact": False, "verify": False, **few},
        "design": {"tune": {threshold: (0.4, 2.0)}, "maximise": threshold, "verify": False, **few},
        "tolerance_bound": {"limit": threshold, "within": (0.4, 2.0), "probabilities": (0.9,), "samples": 10,
                            "seed": 1},
        "design_guide": {"gains": ["2.5 lbf"], "samples": 10, **few},
        "elbow": {"parameters": epp.ElbowParameters()},
        "identify": {"case": elbow, "step": "nowhere.csv", "wrap": 3.0},
        "diagnose": {"record": {"time": swing, "x": np.sin(0.99 * swing)}},
        "first_page": {"run": epp.simulate(case)},
        "report": {"cases": [], "path": "nowhere.html"},
        "sweep": {"axes": {threshold: [0.5, 0.6]}, "run": "predict", **at_once},
        "sweep_cost": {"axes": {threshold: [0.5, 0.6]}, "run": "predict"},
        "open_sweep": {"path": "nowhere.zarr"},
        "outcome_boundary": {"axes": plane, "run": "predict", "halvings": 1, **at_once},
        "free_region": {"axes": {threshold: [0.5, 2.0], level: [1.0, 1.1]}},
        "table": {"what": cycle},
        "manual_table": {"result": bounds_of(elbow, *elbow_limit, BoundCell(9.0, "bound", exact=0.015))},
        "plot_design_map": {"dataset": cells},
        "plot_parallel": {"dataset": cells, "variables": ("peak_to_peak",), "most": 10},
        "plot_slices": {"dataset": cells, "variables": ("peak_to_peak",)},
        "plot_sweep": {"dataset": cells},
    }  # fmt: skip


def _response() -> epp.MeasuredResponse:
    s = 1j * np.geomspace(0.1, 100.0, 61)
    return epp.MeasuredResponse(s.imag, 1.0 / (s * (s + 1.0)))


def fields_of_elements() -> Iterator[tuple[type[epp.Nonlinearity], dict[str, Any]]]:
    """Every element of case files, and fields that one may have."""
    # Most elements can be made of ones and defaults; these cannot.
    known: dict[str, dict[str, Any]] = {
        "bilinear_spring": {"lower": -0.5, "upper": 0.5, "outer": 2.0, "inner": 0.5, "preload": 0.1},
        "five_band_law": {"slack": 5.0, "low": 10.0, "high": 11.0, "max": 16.0, "supply_voltage": 16.0},
        "impact_stop": {"lower": -1.0, "upper": 1.0, "mass": 1.0, "restitution": 0.5},
        "lookup_table": {"inputs": [-1.0, 0.0, 1.0], "outputs": [-2.0, 0.0, 1.0], "beyond": "hold"},
        "monotone_table": {"inputs": [-1.0, 0.0, 1.0], "outputs": [-2.0, 0.0, 1.0], "beyond": "hold"},
        "piecewise_linear": {"breakpoints": [-1.0, 1.0], "slopes": [0.0, 1.0, 0.0], "intercepts": [-1.0, 0.0, 1.0]},
        "prandtl_ishlinskii": {"half_widths": [0.5, 1.0], "weights": [0.3, 0.2], "straight": 1.0},
        "stiction_pulley": {
            "harness_stiffness": 10.0, "forearm_stiffness": 20.0, "friction": 0.1, "kinetic_ratio": 0.8,
        },
    }  # fmt: skip
    for of_files, kind in ELEMENTS.items():
        fields = inspect.signature(kind).parameters.items()
        ones = {name: 1.0 if field.default is inspect.Parameter.empty else field.default for name, field in fields}
        yield kind, known.get(of_files, ones)


def _elements() -> Iterator[Door]:
    for kind, good in fields_of_elements():
        name, element = kind.__name__, kind(**good)
        yield Door(name, kind, good)
        if element.n_inputs == 1:
            yield Door(f"{name}.output", element.output, {"x": 0.5})
        about = {"amplitude": 2.0, "bias": 0.0, "omega": 1.0}
        yield Door(f"{name}.describing_function", element.describing_function, about)


def _constructors() -> Iterator[Door]:
    A, B, C = [[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], [[1.0, 0.0]]
    case = epp.case("relay_deadzone")
    loop, element = case.to_system(), epp.Saturation()
    level = "relay_dead_zone.level"
    yield Door("StateSpace", epp.StateSpace, {"A": np.array(A), "B": np.array(B), "C": np.array(C),
                                              "D": np.zeros((1, 1)), "time_step": None})  # fmt: skip
    yield Door(
        "LureSystem", epp.LureSystem, {n: getattr(loop, n) for n in inspect.signature(epp.LureSystem).parameters}
    )
    build = dict.fromkeys(inspect.signature(epp.LureSystem.build).parameters)
    build |= {"A": A, "B": B, "C": C, "elements": [element], "input_names": (), "name": "loop"}
    yield Door("LureSystem.build", epp.LureSystem.build, build)
    rest = {"delay": 0.0, "feedback": -1, "x0": None, "memory": None, "name": "loop"}
    plant = ([1.0], [1.0, 1.0, 0.0])
    yield Door("LureSystem.from_tf", epp.LureSystem.from_tf, {"plant": plant, "element": element, **rest})
    blocks = {"blocks": [plant, element], "element_names": None, **rest}
    yield Door("LureSystem.from_blocks", epp.LureSystem.from_blocks, blocks)
    rules = {"rules": epp.Play(1.0).automaton(), "own_states": None}
    yield Door("AutomatonElement", epp.AutomatonElement, rules)
    one = {name: np.ones((1, 1)) for name in "A"} | {"B": np.ones((1, 2)), "C": np.ones((2, 1)), "D": np.zeros((2, 2))}
    at = {"B": [[1.0]], "E": [[0.0]], "C": [[1.0]], "D": [[0.0]], "F": [0.0], "delays": [0.0]}
    yield Door("Cuts", epp.Cuts, {"names": ("command",), **at})
    drawn = {
        "parts": {"valve": element, "plant": epp.blocks.Integrator()},
        "connect": ["-plant -> valve", "valve -> plant"],
    }
    named = {"inputs": (), "signals": {"level": "plant"}, "units": {"level": "m"}, "memory": {}}
    rest = {"margins_at": "valve", "principal": "valve", "ports_as_signals": True, "name": "tank"}
    yield Door("Diagram", epp.Diagram, {**drawn, **named, **rest})
    yield Door("OwnStates", epp.OwnStates, {**one, "n_before": 1, "n_behind": 1, "start": None, "rate": None})
    law = {name: [[0.5]] for name in "ABCD"} | {
        "sample_time": 0.1,
        "delay": 0.05,
        "offset": 0.0,
        "x0": [0.0],
        "y0": [0.0],
    }
    yield Door("SampledController", epp.SampledController, {**law, "state_last": False, "tick": None})
    yield Door("OperatingPoint", epp.OperatingPoint, {"inputs": {"hand": 1.0}, "moving": {}})
    given = {"name": "loop", "title": "", "input": None, "t_end": 1.0, "signal": None}
    yield Door("Case.from_system", epp.Case.from_system, {"loop": loop, **given})
    for kind in (epp.LatinHypercube, epp.Sobol):
        yield Door(kind.__name__, _swept(case, kind), {"ranges": {level: (1.0, 1.1)}, "n": 2, "seed": 0})
    spread = {"n": 2, "seed": 0, "names": None, "distribution": "uniform"}
    yield Door("Tolerances", _swept(case, epp.Tolerances), spread)
    yield Door("Zipped", _swept(case, epp.Zipped), {"axes": {level: [1.0, 1.1]}})
    for name in ("Constant", "Step", "Steps", "Ramp", "Sine", "Recorded"):
        kind = getattr(epp.inputs, name)
        good: dict[str, Any] = {n: 1.0 for n in inspect.signature(kind).parameters}
        if name == "Steps":
            good = {n: [1.0, 2.0] for n in good}
        if name == "Recorded":
            good |= {"times": [0.0, 1.0], "values": [0.0, 1.0]}
        yield Door(f"signals.{name}", kind, good)


def _measured() -> Iterator[Door]:
    known = _response()
    data = {"omega": known.omega, "value": known.value, "deviation": None, "static_gain": None, "unstable_poles": 0}
    yield Door("MeasuredResponse", epp.MeasuredResponse, {**data, "name": "response"})
    yield Door("MeasuredResponse.at", known.at, {"omega": 1.0})
    closed = {"response": known, "element": epp.Saturation(), "feedback": -1, "name": "loop", "means": None}
    paths = epp.MeasuredMatrix([[known]])
    yield Door("MeasuredMatrix", epp.MeasuredMatrix, {"paths": [[known]], "name": "responses"})
    yield Door("MeasuredMatrix.at", paths.at, {"omega": 1.0})
    yield Door("MeasuredLoop", epp.MeasuredLoop, closed)


def _swept(case: epp.Case, kind: Callable[..., Any]) -> Callable[..., Any]:
    """A sample, made and used: its fields mean something together with a case only."""
    return lambda **given: epp.sweep(case, kind(**given), "predict", workers=1, progress=False)


def _methods() -> Iterator[Door]:
    case = epp.case("relay_deadzone")
    name = "relay_dead_zone.level"
    loop, cycle = case.to_system(), epp.predict_limit_cycles(case.to_system())[1]
    run = epp.simulate(loop, t_end=1.0)
    yield Door("Case.with_values", case.with_values, {"values": {name: 1.1}, "source": "here"})
    yield Door("Case.value", case.value, {"name": name})
    yield Door("Case.si", case.si, {"name": name, "value": 1.0})
    yield Door("Case.unit", case.unit, {"name": name})
    yield Door("Case.readable", case.readable, {"name": name})
    yield Door("Case.text", case.text, {"name": name, "value": 1.0, "digits": 3})
    yield Door("OperatingPoint.of", epp.OperatingPoint.of, {"system": loop, "input": None, "time": 1.0})
    yield Door("OperatingPoint.with_inputs", epp.OperatingPoint().with_inputs, {"inputs": {"hand": 1.0}})
    yield Door("LureSystem.frequency_response", loop.frequency_response, {"omega": 1.0})
    yield Door("LimitCycle.amplitude", cycle.amplitude, {"signal": loop.signals.names[0]})
    yield Door("LimitCycle.plot", cycle.plot, {"ax": None, "signals": None})
    yield Door("Trajectory.plot", run.plot, {"ax": None, "signals": None})


@dataclass(frozen=True)
class Call:
    """One call with a wrong value in one place."""

    door: Door
    place: str
    number: int

    def __str__(self) -> str:
        return f"{self.door.name}({self.place}={WRONG[self.number]!r:.40})"


def calls(seed: int) -> list[Call]:
    """All calls, in a random order: every value in every place."""
    every = [Call(d, place, i) for d in doors() for place in d.good for i in range(len(WRONG))]
    # A function that reports progress is the caller's own, and so is what it raises.
    own = [c for c in every if not (c.place == "progress" and callable(WRONG[c.number]))]
    random.Random(seed).shuffle(own)
    return own


class TooLong(BaseException):
    """A call that is still at work when its time is over."""


def outcome(call: Call, seconds: float = 2.0) -> str:
    """How a call ends: "refused", "answers", "at work", or the traceback's last line."""

    at_work = [True]

    def ring(_: int, frame: FrameType | None) -> None:
        if at_work:  # a call that has just ended is not too long
            raise TooLong

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
            warnings.simplefilter("ignore")
            try:
                call.door.call(**{**call.door.good, call.place: WRONG[call.number]})
            finally:
                at_work.clear()
    except TooLong:
        return "at work"
    except epp.EppError as error:
        text = str(error)
        return "refused" if text and "\n" not in text.strip() else f"a refusal of several lines: {text!r}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    else:
        return "answers"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
