"""Loops that become cases: the same numbers, and the same answers from every analysis."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.methods.bounds.balanced import look
from eppanalysis.models.elements.memory import Slip
from eppanalysis.models.systems.signals import SignalMap
from tests.shared import of_kind

#: An elbow with parking logic holds an element that case files do not know.
WRITTEN = tuple(name for name in of_kind("elbow", "loop") if name != "parking_stops_it")


def bits(value: Any) -> Any:
    """What must be the same of a value, to the last bit."""
    if isinstance(value, np.ndarray):
        return value.shape, np.asarray(value, float).tobytes()
    if isinstance(value, Slip):
        return tuple(float(part).hex() for part in value)
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, epp.Nonlinearity):
        return type(value), {name: bits(part) for name, part in vars(value).items()}
    if isinstance(value, SignalMap):
        units = value.units or ("",) * len(value.names)
        return [bits(getattr(value, f.name)) for f in fields(value) if f.name != "units"], units
    return tuple(map(bits, value)) if isinstance(value, tuple) else value


def assert_same(one: epp.LureSystem, other: epp.LureSystem) -> None:
    for field in fields(one):
        assert bits(getattr(one, field.name)) == bits(getattr(other, field.name)), field.name


def test_every_shipped_loop_reads_back_to_the_same_bits() -> None:
    for name in WRITTEN:
        loop = epp.case(name).to_system()
        case = epp.Case.from_system(loop)
        assert_same(case.to_system(), loop)
        assert_same(epp.case_from_text(case.to_toml(), name).to_system(), loop)


@st.composite
def loops(draw: st.DrawFn) -> epp.LureSystem:
    """Loops with everything: cascades, dead times, inputs, constants, memories, signals, no states at all."""
    number = st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: v if abs(v) > 1e-40 else 0.0)

    def array(*shape: int) -> np.ndarray:
        count = int(np.prod(shape))
        return np.array(draw(st.lists(number, min_size=count, max_size=count)), float).reshape(shape)

    positive = st.floats(1e-6, 1e3)
    gain = epp.PiecewiseLinear([], [draw(number)], [draw(number)])
    third = draw(st.sampled_from([epp.Quantiser(draw(positive), 7), gain]))
    elements = [epp.Play(gap=draw(positive)), epp.Friction(draw(positive)), third]
    elements.append(epp.JumpAndFollow(2.0, 1.0, draw(positive)))
    memory = [draw(st.none() | number), None, None, draw(st.none() | st.builds(Slip, number, st.just(1), number))]
    n, nv, ns = draw(st.integers(0, 3)), draw(st.integers(0, 2)), 2
    units = draw(st.sampled_from([(), ("rad", "N*m")]))
    return epp.LureSystem.build(
        array(n, n), array(n, 4), array(4, n), elements, D=np.triu(array(4, 4), 1), B_input=array(n, nv),
        D_input=array(4, nv), input_names=[f"v{i}" for i in range(nv)], constant_state=array(n),
        constant_input=array(4), x0=array(n), v0=array(nv), memory=memory, delays=np.abs(array(4)),
        time_step=draw(st.none() | positive),
        signals=SignalMap(("a", "b"), array(ns, n), array(ns, 4), array(ns, nv), array(ns), units),
    )  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(loops())
def test_any_loop_reads_back_to_the_same_bits(loop: epp.LureSystem) -> None:
    case = epp.Case.from_system(loop)
    assert_same(case.to_system(), loop)
    again = epp.case_from_text(case.to_toml(), "loop")
    assert_same(again.to_system(), loop)
    assert again.operating_point == epp.OperatingPoint.of(loop)


INPUT_SIGNALS: tuple[epp.inputs.InputSignal, ...] = (
    epp.inputs.Constant(0.1),
    epp.inputs.Step(0.1, 1 / 3),
    epp.inputs.Steps([0.1, 0.7], [1 / 3, -0.2]),
    epp.inputs.Ramp(0.1, 0.2, 1 / 3),
    epp.inputs.Ramp(1 / 7),
    epp.inputs.Sine(0.1, 1 / 3, 0.2),
    epp.inputs.Recorded([0.0, 0.1, 1 / 3], [0.1, 0.2, 1 / 7]),
)


@pytest.mark.parametrize("input_signal", INPUT_SIGNALS, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("by_name", [False, True])
def test_motions_are_read_back(input_signal: epp.inputs.InputSignal, by_name: bool) -> None:
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0))
    pushed = epp.LureSystem.build(loop.A, loop.B, loop.C, loop.elements, D_input=[[1.0]], input_names=["hand"])
    case = epp.Case.from_system(pushed, input={"hand": input_signal} if by_name else input_signal, t_end=2 / 3)
    again = epp.case_from_text(case.to_toml(), "loop")
    found = again.input["hand"] if isinstance(again.input, dict) else again.input
    assert found is not None and again.t_end == 2 / 3
    t = np.linspace(0.0, 1.0, 500)
    assert found.value(t).tobytes() == input_signal.value(t).tobytes()


def test_what_no_case_file_can_hold_is_said() -> None:
    class Odd(epp.Saturation):
        """An element of one's own."""

    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), Odd())
    with pytest.raises(epp.EppError, match="odd is a Odd, which no case file knows"):
        epp.Case.from_system(loop)
    with pytest.raises(epp.EppError, match="play.1"):
        epp.Case.from_system(epp.LureSystem.from_blocks([epp.Play(1.0), ([1.0], [1.0, 1.0])], element_names=["play.1"]))
    with pytest.raises(epp.EppError, match=r"run\.inputs\.foot is 'foot'; expected an input of the loop: none"):
        epp.Case.from_system(loop_of_a_relay(), input={"foot": epp.inputs.Constant(1.0)})


def loop_of_a_relay() -> epp.LureSystem:
    """The loop of a shipped case, as one would make it in Python."""
    return epp.case("relay_deadzone").to_system()


def plain(result: Any) -> Any:
    """A result without what says where it comes from, and how long it took."""
    if isinstance(result, dict):
        left_out = ("provenance", "seconds")
        return {k: plain(v) for k, v in result.items() if k not in left_out}
    if isinstance(result, list | tuple):
        return [plain(v) for v in result]
    return repr(result)


LEVEL, THRESHOLD = "relay_dead_zone.level", "relay_dead_zone.threshold"
ANALYSES = {
    "predict_limit_cycles": lambda x: epp.predict_limit_cycles(x).to_dict(),
    "find_limit_cycles": lambda x: epp.find_limit_cycles(x).to_dict(),
    "simulate": lambda x: epp.simulate(x, t_end=50.0).to_dict(),
    "harmonic_balance": lambda x: epp.harmonic_balance(x, epp.predict_limit_cycles(x)[-1], 5).to_dict(),
    "exact_orbit": lambda x: epp.exact_orbit(x, epp.predict_limit_cycles(x)[-1]).to_dict(),
    "trigger": lambda x: [k.to_dict() for k in epp.trigger(x)],
    "ladder": lambda x: epp.ladder(x).to_dict(),
    "continue_branch": lambda x: epp.continue_branch(x, THRESHOLD, 1.0, 1.1, n_points=4, n_others=0).to_dict(),
    "design_bounds": lambda x: epp.design_bounds(
        x, LEVEL, THRESHOLD, at=[1.0], within=(0.5, 2.0), exact=False
    ).to_dict(),
    "sweep": lambda x: epp.sweep(x, {THRESHOLD: [0.5, 1.0]}, "predict", progress=False).to_dict()["data_vars"],
    "frozen_nyquist": lambda x: epp.frozen_nyquist(x, epp.predict_limit_cycles(x)[-1]).response.tolist(),
}


#: They are told most by; the others are asked in the slow tier.
FIRST = {"predict_limit_cycles", "find_limit_cycles", "simulate", "exact_orbit", "sweep"}


@pytest.mark.parametrize(
    "analysis", [pytest.param(name, marks=[pytest.mark.slow] * (name not in FIRST)) for name in ANALYSES]
)
def test_every_analysis_gives_the_same_of_a_case_and_of_its_loop(
    analysis: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eppanalysis.methods.bounds.balanced.look", partial(look, n_scan=2))
    loop = loop_of_a_relay()
    case = epp.Case.from_system(loop)
    assert plain(ANALYSES[analysis](loop)) == plain(ANALYSES[analysis](case))


def test_a_report_of_a_loop(tmp_path: Path) -> None:
    """The notebook of the report reads the loop from the text of its case, whatever the loop is called."""
    from eppanalysis.report.notebook import make_notebook

    case = epp.Case.from_system(loop_of_a_relay(), "my loop")
    cells = [c.source for c in make_notebook([case]).cells]
    place: dict[str, Any] = {"epp": epp, "pandas": pandas}
    exec(next(c for c in cells if "case = " in c).split("import eppanalysis as epp")[1], place)
    assert_same(epp.Case.from_system(place["case"].to_system(), "relay_deadzone").to_system(), loop_of_a_relay())
    assert any("continue_branch" in c for c in cells)


def servo(**options) -> epp.Diagram:
    """A sampled servo with a play, drawn in Python."""
    return epp.Diagram(
        parts={
            "law": epp.blocks.PI(kp=40.0, ti=0.4, sample_time=1e-3),
            "plant": epp.blocks.TransferFunction(num=[1.25], den=[0.1, 3.125, 0.0], start=[0.0, 0.01]),
            "modes": epp.blocks.ZeroPoleGain(poles=[[-2.0, 3.0], [-2.0, -3.0]], gain=13.0),
            "play": epp.Play(gap=0.0035),
        },
        connect=["aim - play -> law", "law -> plant", "plant -> modes", "modes -> play"],
        inputs={"aim": 0.1},
        signals={"load": "play", "error": "aim - play"},
        units={"load": "rad", "aim": "rad"},
        memory={"play": 0.001},
        margins_at="plant",
        name="servo",
        **options,
    )


def test_a_diagram_becomes_a_case_of_a_diagram_and_a_file():
    drawn = servo()
    case = epp.Case.from_system(drawn, t_end=2.0)
    again = epp.case_from_text(case.to_toml())
    assert case.kind == "diagram" and again.parameters == case.parameters
    one = drawn.to_system()
    for other in (case.to_system(), again.to_system()):
        for name in ("A", "B", "C", "D", "B_input", "D_input", "x0", "v0", "delays"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert other.signals.names == one.signals.names
        # A case knows besides those units that follow along the wires.
        pairs = zip(one.signals.units, other.signals.units, strict=True)
        assert all(given in ("", kept) for given, kept in pairs)
        assert other.memory == one.memory and other.margins_at == one.margins_at
    gain_margin = epp.margins(drawn).gain_margin
    assert epp.margins(case).gain_margin == gain_margin
    assert epp.margins(case.with_values({"law.kp": 50.0})).gain_margin == pytest.approx(0.8 * gain_margin, rel=1e-9)


def test_a_diagram_that_no_file_has_a_place_for_becomes_a_case_of_its_loop():
    parts = {"plant": epp.blocks.Integrator(), "lag": epp.blocks.LowPass(bandwidth=2.0), "relay": epp.Relay()}
    wires = ["-plant -> relay", "relay -> lag", "lag -> plant"]
    drawn = epp.Diagram(parts=parts, connect=wires, signals={"y": "plant"}, ports_as_signals=False)
    case = epp.Case.from_system(drawn)
    assert case.kind == "loop" and np.array_equal(case.to_system().A, drawn.to_system().A)


DRAWABLE = ("A", "B", "C", "D", "B_input", "D_input", "constant_state", "constant_input", "x0", "v0", "delays")


def test_every_shipped_loop_is_the_same_as_the_file_of_a_diagram() -> None:
    """Equal numbers, elements and starts are equal results: a diagram's loop is analysed as any other."""
    for name in of_kind("loop"):
        loop = epp.case(name).to_system()
        drawing = replace(epp.Diagram.of(loop), ports_as_signals=True, principal="")
        case = epp.case_from_text(epp.Case.from_system(drawing).to_toml(), name)
        assert case.kind == "diagram"
        found = case.to_system()
        for array in DRAWABLE:
            assert np.array_equal(getattr(found, array), getattr(loop, array)), array
        assert bits(found.elements) == bits(loop.elements)
        assert (found.element_names, found.memory, found.time_step) == (loop.element_names, loop.memory, loop.time_step)
        for i, signal in enumerate(loop.signals.names):
            j = found.signals.names.index(signal)
            for array in ("C", "D", "D_input", "constant"):
                assert np.array_equal(getattr(found.signals, array)[j], getattr(loop.signals, array)[i]), (
                    signal,
                    array,
                )
