"""What the model does is not denied: relays and the loop's own cycle are candidates, and what was not tried is said."""

from __future__ import annotations

import shlex
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from eppanalysis.cli.commands import app
from eppanalysis.diagnose.record import oscillation_of, record_of
from tests.report.test_commands import resolve
from tests.shared import mostly_slow

HOUSE = """
kind = "diagram"
title = "a room, a heater that is on or off, and the cold outside"
connect = ["room -> heater", "heater + loss -> room"]
signals = { T = { of = "room" }, heat = { of = "heater" } }
[parameters]
Tset = 20.0
band = 1.5
[blocks]
room = { kind = "transfer_function", num = [2.0], den = [30.0, 1], start = [15] }
loss = { kind = "constant", value = 2.5 }
[elements.heater]
element = "automaton"
start_mode = "on"
modes.on = { from_input = "-0.1", constant = "12.0" }
modes.off = {}
guards = [
 { name = "off", mode = "on", target = "off", on_input = 1, constant = "-Tset-band" },
 { name = "on", mode = "off", target = "on", on_input = -1, constant = "Tset-band" },
]
[run]
t_end = "400 s"
"""


def thermostats() -> dict[str, epp.LureSystem | epp.Case]:
    """Three on-off controls: about zero with dead time, uneven levels about a set point, and a heater of modes."""
    lag = ([4.0], [1.0, 1.0])
    uneven = epp.Diagram(
        parts={
            "room": epp.blocks.TransferFunction(num=[8.0], den=[5.0, 1.0]),
            "switch": epp.HysteresisRelay(-0.4, 0.4, -0.2, 1.0),
        },
        connect=["target - room -> switch", "switch -> room"],
        inputs={"target": 2.0},
        signals={"T": "room", "heat": "switch"},
    )  # fmt: skip
    return {
        "dead time": epp.LureSystem.from_tf(lag, epp.HysteresisRelay(-0.3, 0.5, -1.0, 1.0), delay=0.2),
        "uneven": uneven.to_system(),
        "own modes": epp.case_from_text(HOUSE, name="house"),
    }


@cache
def recorded(name: str, noise: float = 0.01, scale: float = 1.0) -> tuple[epp.Diagnosis, epp.LimitCycle]:
    """What is said of the first signal of the exact model's own run, with noise, and the cycle that it is on."""
    loop = thermostats()[name]
    length = {"t_end": 60.0} if name != "own modes" else {}
    run = epp.simulate(loop, **length)
    cycle = run.limit_cycle
    signal = next(iter(run.signals))
    t = run.t[-1] - 12.0 * cycle.period + np.linspace(0.0, 12.0 * cycle.period, 1500)
    y = epp.simulate(loop, **length, t_eval=t).signals[signal]
    y = scale * (y + noise * np.std(y) * np.random.default_rng(7).normal(size=t.size))
    return epp.diagnose(loop, {"time": t - t[0], signal: y}), cycle


@pytest.mark.parametrize("name", thermostats())
def test_the_cycle_of_the_very_model_is_not_denied(name: str) -> None:
    found, cycle = recorded(name)
    assert found.verdict == "named", str(found)
    assert found[0].name in ("hysteresis_relay", "switch", "loop as modelled")
    assert found[0].period == pytest.approx(cycle.period, rel=1e-6)
    if found[0].name != "loop as modelled":  # the same cycle is not counted twice
        own = next(e for e in found if e.name == "loop as modelled")
        assert own.note == f"has the cycle of {found[0].name}" and own.probability == 0.0
    assert found.status is epp.Status.INCOMPLETE  # a relay has no gain, so that two candidates could not be tried
    assert "cannot be taken as linear" in str(found)


@pytest.mark.slow
def test_a_record_of_another_size_is_not_the_models_own_cycle() -> None:
    """Nothing but the phase of the model's own cycle is free."""
    found, _ = recorded("own modes", scale=1.3)
    assert found.verdict == "unexplained" and "loop as modelled" in str(found)


def test_two_elements_together_are_told_by_the_loop_as_it_is_modelled() -> None:
    """A relay behind backlash: neither alone has the cycle of both."""
    loop = epp.LureSystem.from_blocks([epp.Relay(), ([3.0], [1.0, 2.0, 1.0, 0.0]), epp.Play(1.5)])
    run = epp.simulate(loop, t_end=200.0)
    cycle, name = run.limit_cycle, next(iter(run.signals))
    t = run.t[-1] - np.linspace(10.0 * cycle.period, 0.0, 1200)
    found = epp.diagnose(loop, {"time": t - t[0], name: epp.simulate(loop, t_end=200.0, t_eval=t).signals[name]})
    assert found.names == ("loop as modelled",)
    assert found[0].period == pytest.approx(cycle.period, rel=1e-6)


def servo(**more: float) -> epp.LureSystem:
    """A servo with backlash and a limit far away."""
    return epp.LureSystem.from_blocks([epp.Saturation(-50.0, 50.0), ([5.0], [1.0, 1.0, 0.0]), epp.Play(2.0)], **more)


def sine(name: str, share: float = 0.0, at: float = 0.0) -> dict[str, np.ndarray]:
    """A sine at 0.9 rad/s with noise, and a second one beside it."""
    t = np.linspace(0.0, 200.0, 4000)
    y = np.sin(0.9 * t) + share * np.sin(at * t + 0.3) + 0.02 * np.random.default_rng(3).normal(size=t.size)
    return {"time": t, name: y}


def test_a_loop_in_which_nothing_can_be_tried_says_so() -> None:
    """With a step of the engine a candidate no search leads anywhere."""
    loop = epp.LureSystem.from_tf(([4.0], [1.0, 1.0]), epp.HysteresisRelay(-0.3, 0.5), delay=0.2)
    found = epp.diagnose(loop, sine("x"), steps=1)
    assert found.verdict == "nothing tried" and found.names == () and found.status is epp.Status.INCOMPLETE
    said = str(found)
    assert said.startswith("No candidate could be tried: the record has a period of 6.98") and "None of" not in said
    assert "could not be tried to the end: the search took all of 1 steps." in said
    assert all(np.isnan(e.probability) for e in found)


def test_what_is_not_sought_to_the_end_is_said_and_the_rest_answers() -> None:
    found = epp.diagnose(servo(), sine(servo().signals.names[0]), steps=2000)
    assert found.names == ("external disturbance",) and found.status is epp.Status.INCOMPLETE
    assert "could not be tried to the end: the search took all of 2000 steps." in str(found)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["friction and rate limit", "linear instability", "encoder of 4096 counts"])
def test_a_diagnosis_has_a_bound_of_effort(kind: str) -> None:
    """By the engine's steps, which are the same on every machine: so many for each candidate and no more."""
    from eppanalysis.methods.simulation.budget import budget

    blocks = {
        "friction and rate limit": [([4.0, 6.0, 2.0], [0.05, 1.0, 0.0]), epp.RateLimiter(4.0), ([1.0], [1.0, 0.2, 0.0]),
                                    epp.Quantiser(0.01, 4000)],
        "linear instability": [epp.Saturation(), ([12.0], [1.0, 3.0, 2.0, 0.0]), epp.Quantiser(0.001, 4000)],
        "encoder of 4096 counts": [epp.Quantiser(2 * np.pi / 4096, 2047), ([30.0], [1.0]), epp.Saturation(-10, 10),
                                   ([5.0], [0.2, 1.0, 0.0]), ([1.0], [0.02, 1.0])],
    }[kind]  # fmt: skip
    loop = epp.LureSystem.from_blocks(blocks)
    steps = 40_000
    with budget(1e9) as work:
        found = epp.diagnose(loop, sine(loop.signals.names[0]), steps=steps)
    assert len(str(found)) > 20
    # A search may go beyond its steps by one run of the engine; sizes are sought again, six for each cycle.
    assert work.used < 60 * steps


@pytest.mark.parametrize("share", mostly_slow([0.22, 0.1], [0.1]))
def test_a_second_line_in_a_record_is_mentioned(share: float) -> None:
    found = epp.diagnose(servo(), sine(servo().signals.names[0], share, 2.0), steps=20_000)
    (line,) = found.oscillation.others
    assert line.frequency == pytest.approx(2.0 / (2 * np.pi), rel=0.02) and line.share == pytest.approx(share, rel=0.1)
    assert f"holds a line at {line.frequency:.4g} Hz, {100 * line.share:.2g} % as large" in str(found)


@pytest.mark.slow
@pytest.mark.parametrize("even", [True, False])
def test_a_second_line_in_a_long_record_takes_no_square_of_its_length(even: bool) -> None:
    """Minutes at 2 kHz: every one of 40,000 samples at every one of as many frequencies took a minute."""
    rng, n, begin = np.random.default_rng(1), 40_000, time.process_time()
    t = np.linspace(0.0, 100.0, n) if even else np.sort(rng.uniform(0.0, 100.0, n))
    y = np.sin(1.1 * t) + 0.2 * np.sin(2.0 * t) + 0.01 * rng.normal(size=n)
    (line,) = oscillation_of(record_of({"time": t, "x": y}, {"x": ""})).others
    assert line.frequency == pytest.approx(2.0 / (2.0 * np.pi), rel=0.02) and line.share == pytest.approx(0.2, rel=0.1)
    assert time.process_time() - begin < 30.0


@pytest.mark.parametrize("seed", mostly_slow(range(8), [0, 1]))
def test_noise_drift_and_harmonics_are_no_second_line(seed: int) -> None:
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 60.0, 1500)
    y = np.sign(np.sin(1.1 * t)) + 0.03 * t + 0.1 * rng.normal(size=t.size)
    assert oscillation_of(record_of({"time": t, "x": y}, {"x": ""})).others == ()


@pytest.mark.slow
def test_commands_of_a_diagnosis_are_understood_and_that_of_a_file_runs_as_it_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    case = epp.case("level_valve")
    asked = list(epp.diagnose(case, shipped_cases_folder() / "measured" / "tank_level.csv").remedies())
    Path("house.toml").write_text(HOUSE, encoding="utf-8")
    house = epp.read_case("house.toml")
    cycle = epp.simulate(house).limit_cycle
    t = 400.0 - np.linspace(12.0 * cycle.period, 0.0, 1500)
    asked += epp.diagnose(house, {"time": t - t[0], "T": epp.simulate(house, t_eval=t).signals["T"]}).remedies()
    assert len(asked) == 2
    of_case, of_file = (line[line.index("eppanalysis ") :] for line in asked)
    resolve(of_case)
    done = CliRunner().invoke(app, shlex.split(of_file)[1:])
    assert done.exit_code == 0, f"{of_file}: {done.output}"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_thermostat_as_it_is_modelled_is_named_in_noise(seed: int) -> None:
    """Its period tells its size better than its swing does, of which 3 % are noise."""
    room = epp.case_from_text(
        """
kind = "diagram"
title = "room"
connect = ["-sensor + set -> relay", "relay -> heat", "heat + loss -> room", "room -> sensor"]
signals = { T = { of = "room", unit = "K" } }
[blocks]
set = { kind = "constant", value = "20 K" }
loss = { kind = "constant", value = "2 K" }
heat = { kind = "gain", gain = 30 }
room = { kind = "transfer_function", num = [1], den = ["40 min", 1], start = ["18 K"] }
sensor = { kind = "transfer_function", num = [1], den = ["60 s", 1], start = ["18 K"] }
[elements]
relay = { element = "hysteresis_relay", lower = "-0.4 K", upper = "0.4 K", low = "0 K", high = "1 K" }
[run]
t_end = "3 h"
""",
        name="room",
    )
    t = np.linspace(10_800.0 - 12.0 * epp.simulate(room).limit_cycle.period, 10_800.0, 576)
    exact = epp.simulate(room, t_eval=t).signals["T"]
    noise = 0.015 * np.ptp(exact) * np.random.default_rng(seed).normal(size=t.size)
    found = epp.diagnose(room, {"time": t - t[0], "T": exact + noise}, steps=100_000)
    assert found.names == ("relay",) and found[0].fields["high"][0] == pytest.approx(1.0, rel=0.05)
