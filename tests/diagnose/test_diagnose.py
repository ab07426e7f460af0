"""Which element is named for records of an integrator of its own, and what cannot be told."""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.diagnose import explained
from eppanalysis.diagnose.candidates import Candidates, candidates_of
from eppanalysis.diagnose.record import oscillation_of, record_of
from eppanalysis.errors import EppError
from eppanalysis.shown import for_people
from eppanalysis.tables.console import candidates_table
from studies.diagnose import ALIKE, MECHANISMS, candidates, diagnosed, judged

PLANT = ([5.0], [1.0, 1.0, 0.0])


@cache
def played(size: float = 1.0) -> dict[str, np.ndarray]:
    """A record of play in a servo, with noise."""
    (cycle,) = servo()[0].families[0].cycles()
    t, rng = np.linspace(0.0, 50.0, 1500), np.random.default_rng(11)
    omega = 2 * np.pi / cycle.period
    found = {"time": t}
    for name, c in cycle.harmonics.items():
        y = size * sum(np.real(a * np.exp(1j * k * omega * t)) for k, a in enumerate(c[:15]))
        found[name] = y + 0.02 * np.std(y) * rng.normal(size=t.size)
    return found


@cache
def servo() -> tuple[Candidates, epp.LureSystem]:
    """The loop with play alone; its cycles are sought once."""
    loop = epp.LureSystem.from_tf(PLANT, epp.Play(gap=2.0))
    return candidates_of(loop, epp.OperatingPoint.of(loop)), loop


def said(given: dict[str, np.ndarray], model_error: float = 0.02) -> epp.Diagnosis:
    """The diagnosis of a record of this loop."""
    record = record_of(given, {"x": "", "y": ""})
    return explained(*servo(), record, oscillation_of(record), model_error)


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", ["saturation", "rate limit"])
def test_the_limit_that_made_a_record_is_named(mechanism):
    found, size = diagnosed(mechanism, 0)
    assert judged(mechanism, found, size) == ("right", True), str(found)


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", [name for name in MECHANISMS if name not in ("saturation", "rate limit")])
def test_the_element_that_made_a_record_is_named(mechanism):
    for number in range(3):
        found, size = diagnosed(mechanism, number)
        assert judged(mechanism, found, size)[0] == "right", str(found)


@pytest.mark.parametrize(
    ("mechanism", "label", "recorded", "verdict"),
    [
        pytest.param("saturation", "amplifier", "flow", "undecided", marks=pytest.mark.slow),
        pytest.param("saturation", "drive_in", "command", "undecided", marks=pytest.mark.slow),
        ("rate limit", "drive", "flow", "unexplained"),
        pytest.param("linear instability", "angle", "angle", "named", marks=pytest.mark.slow),
    ],
)
def test_a_record_of_another_signal_is_no_linear_instability(mechanism, label, recorded, verdict):
    """A flow that saturation swings is a sinusoid, which as the output of the limit only a gain on its limit makes."""
    element, loop, run, _ = MECHANISMS[mechanism]
    given, _ = run(np.random.default_rng([20261123, 1]))
    known, system = candidates(loop)
    record = record_of({"time": given["time"], label: given[recorded]}, dict.fromkeys(system.signals.names, ""))
    found = explained(known, system, record, oscillation_of(record))
    assert found.verdict == verdict and found.to_dict()["elsewhere"] == found.elsewhere
    if verdict == "named":
        assert found.names == (element,) and not found.elsewhere
        return
    assert found.elsewhere.startswith("as a record of ") and found.elsewhere.endswith(f"it is explained by {element}")
    assert "is it attached to the right signal?" in str(found)
    if verdict == "undecided":
        assert str(found).startswith(f"Undecided: linear instability and another signal than {label}:")


@pytest.mark.parametrize("mechanism", ALIKE)
def test_two_elements_that_explain_a_record_alike_cannot_be_told(mechanism):
    found, _ = diagnosed(mechanism, 1)
    assert found.verdict == "undecided" and set(found.names) == {"amplifier", "valve"}
    assert found[0].probability == pytest.approx(found[1].probability, rel=1e-3)
    assert "Undecided: " in str(found)


@pytest.mark.slow
def test_an_interval_narrows_with_a_better_model():
    found = [said(played(0.4), error) for error in (0.05, 0.02, 0.005)]
    for one, error in zip(found, (0.05, 0.02, 0.005), strict=True):
        value, low, high = one[0].fields["gap"]
        assert low < 0.8 < high and value == pytest.approx(0.8, rel=0.01)
        assert np.log(high / value) == pytest.approx(1.96 * error, rel=0.2)
    assert [one.names for one in found] == [("play",)] * 3


@pytest.mark.slow
def test_a_loop_that_runs_ten_times_as_fast_is_told_the_same():
    slow = said(played())
    fast = epp.diagnose(
        epp.LureSystem.from_tf(([500.0], [1.0, 10.0, 0.0]), epp.Play(gap=2.0)),
        {**played(), "time": 0.1 * played()["time"]},
    )
    assert fast.period == pytest.approx(0.1 * slow.period, rel=1e-6)
    assert [e.name for e in fast] == [e.name for e in slow]
    assert fast[0].misfit == pytest.approx(slow[0].misfit, abs=1e-3)
    assert fast[0].fields["gap"] == pytest.approx(slow[0].fields["gap"], rel=1e-5)


def test_a_loop_that_is_not_in_proportion_is_tried_size_by_size():
    """Play behind an integrator does not mind where it stands: an input that is held shifts the cycle and no more."""
    loop = epp.Diagram(
        parts={"motor": epp.blocks.TransferFunction(num=[5.0], den=[1.0, 1.0, 0.0]), "gear": epp.Play(gap=2.0)},
        connect=["target - gear -> motor", "motor -> gear"],
        inputs=["target"],
        signals={"x": "motor", "y": "gear"},
    )
    at_rest = said(played(0.3))
    moved = epp.diagnose(loop, played(0.3), operating_point={"target": 0.7})
    assert at_rest[0].in_proportion and not moved[0].in_proportion
    assert at_rest.names == ("play",) and moved.names == ("gear",)
    assert moved[0].fields["gap"] == pytest.approx(at_rest[0].fields["gap"], rel=0.01)


def sought_once(*given: object, held: list[Candidates] = []) -> Candidates:  # noqa: B006
    """The candidates of a loop that is the same however its file is written."""
    held[:] = held or [candidates_of(*given)]
    return held[0]


@pytest.mark.parametrize(
    ("gap", "named"),
    [("'2 mm'", "gear.gap"), ("'width'", "width"), ("'2*half'", "half"), ("'half*sqrt(stretch)'", "half")],
)
def test_a_size_has_its_unit_and_its_command_wherever_the_file_gives_it(gap, named, monkeypatch):
    """A field may hold the number itself, the name of a parameter that does, or an expression of some."""
    monkeypatch.setattr(sys.modules["eppanalysis.diagnose"], "candidates_of", sought_once)
    servo = f"""
kind = "diagram"
title = "servo"
connect = ["-gear -> motor", "motor -> gear"]
signals = {{ x = {{ of = "motor", unit = "m" }}, y = {{ of = "gear", unit = "m" }} }}
[parameters]
K = 5.0
width = "2 mm"
half = "1 mm"
stretch = 4.0
[blocks]
motor = {{ kind = "transfer_function", num = ["K"], den = [1, 1, 0] }}
[elements]
gear = {{ element = "play", gap = {gap} }}
[run]
t_end = "10 s"
"""
    record = {name: column if name == "time" else 1e-3 * column for name, column in played().items()}
    found = epp.diagnose(epp.case_from_text(servo, name="servo"), record)
    assert found[0].fields["gap"][0] == pytest.approx(2e-3, rel=0.01) and found[0].sizes().count(" mm") == 3
    (asked,) = found.remedies()
    assert f"epp.design_bounds(case, 'K', '{named}', at=['5'], allow='x " in asked


@pytest.mark.slow
def test_a_size_is_said_in_the_unit_and_a_record_read_beside_the_time_that_the_case_types():
    """A run that is told in minutes has no signal "time", and a band in inches no millimetres."""
    servo = """
kind = "diagram"
title = "servo"
connect = ["-gear -> motor", "motor -> gear"]
signals = { x = { of = "motor", unit = "m" } }
[blocks]
motor = { kind = "transfer_function", num = [5], den = [1, 1, 0] }
[elements]
gear = { element = "play", gap = "0.1 in" }
[run]
t_end = "3 min"
"""
    record = {"time": played()["time"], "x": 1e-3 * played()["x"]}
    found = epp.diagnose(epp.case_from_text(servo, name="servo"), record)
    assert found[0].name == "gear"
    assert found[0].sizes().count(" in") == 3 and " mm" not in found[0].sizes()


def test_a_record_in_a_file_has_its_time_beside_signals_alone(tmp_path):
    """However the case types its time: that of the record is none of its signals."""
    case = epp.case_from_text(
        """
kind = "diagram"
title = "room"
connect = ["-room -> relay", "relay -> room"]
signals = { T = { of = "room", unit = "K" } }
[blocks]
room = { kind = "transfer_function", num = [3], den = ["5 min", 1], start = ["1 K"] }
[elements]
relay = { element = "hysteresis_relay", lower = "-0.5 K", upper = "0.5 K", low = "-1 K", high = "1 K" }
[run]
t_end = "1 h"
""",
        name="room",
    )
    cycle = epp.simulate(case).limit_cycle
    t = 3600.0 - np.linspace(10.0 * cycle.period, 0.0, 400)
    values = epp.simulate(case, t_eval=t).signals["T"]
    rows = [f"{now - t[0]:.6f},{value:.6f}" for now, value in zip(t, values, strict=True)]
    (tmp_path / "record.csv").write_text("\n".join(["time [s],T [K]", *rows]))
    found = epp.diagnose(case, tmp_path / "record.csv")
    assert found.oscillation.names == ("T",) and found[0].name == "relay"


def test_a_waveform_that_no_candidate_has_stays_unexplained():
    """And none has a probability: the nearest of candidates that do not fit had one of 1.000."""
    t = np.linspace(0.0, 60.0, 2000)
    found = said({"time": t, "x": np.sign(np.sin(1.1 * t))})
    assert found.verdict == "unexplained" and found.names == ()
    assert str(found).startswith("None of the candidates explains it")
    assert not np.isfinite([e.probability for e in found]).any()
    assert set(candidates_table(found).columns[1]._cells) == {"-"}
    assert set(for_people(found.in_brief())["probability"]) == {"-"}
    assert all(e["probability"] is None or np.isnan(e["probability"]) for e in found.to_dict()["explanations"])


def test_a_sine_from_outside_is_no_cycle_of_the_loop():
    t = np.linspace(0.0, 60.0, 2000)
    noise = 0.02 * np.random.default_rng(2).normal(size=t.size)
    found = said({"time": t, "x": np.sin(0.9 * t) + noise})
    assert found.names == ("external disturbance",)


@pytest.mark.parametrize("error", [0.0, 0.6, float("nan")])
def test_a_model_error_out_of_its_range_is_refused(error):
    with pytest.raises(EppError, match="model_error is"):
        epp.diagnose(epp.LureSystem.from_tf(PLANT, epp.Play(gap=2.0)), played(), model_error=error)
