"""Period, growth, harmonics and noise of a record, against those it was made with."""

from __future__ import annotations

import re

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.diagnose.record import Oscillation, Record, oscillation_of, record_of
from eppanalysis.errors import EppError

UNITS = {"angle": "rad", "torque": "N*m", "x": ""}
#: Coefficients of harmonics, by signal: the fundamental need not be the largest.
SHAPES = {
    "plain": {"x": [1.0 - 0.5j]},
    "odd": {"angle": [0.2j, 0.0, 0.03 - 0.01j, 0.0, 0.01], "torque": [3.0, 0.0, -1.0, 0.0, 0.5j]},
    "second is largest": {"x": [0.3, 1.0 + 0.5j, 0.1j]},
    "third is largest": {"x": [0.2 + 0.1j, 0.0, 1.0]},
}


def made(
    shape: dict[str, list[complex]], omega: float, t: np.ndarray, noise: float, seed: int, growth: float = 0.0
) -> Record:
    """A record with drift and noise whose phases refer to the middle of its time."""
    rng = np.random.default_rng(seed)
    s = t - 0.5 * (t[0] + t[-1])
    signals = {}
    for name, c in shape.items():
        y = sum(np.real(a * np.exp((growth * omega / (2 * np.pi) + 1j * k * omega) * s)) for k, a in enumerate(c, 1))
        signals[name] = y + noise * np.std(y) * rng.normal(size=t.size) + 2.0 * np.std(y) + 0.01 * np.std(y) * s / omega
    return Record("made", t, signals)


def difference(found: Oscillation, shape: dict[str, list[complex]]) -> float:
    """Root mean square of the errors of all harmonics in units of their standard deviations."""
    K = found.harmonics.shape[1]
    true = np.array([[*shape[name], *[0.0] * K][:K] for name in found.names])
    return float(np.sqrt(np.mean(np.abs(found.harmonics - true) ** 2 / found.variance)))


@pytest.mark.parametrize("shape", SHAPES)
def test_harmonics_are_those_it_was_made_with(shape):
    t = 7.0 + np.sort(np.random.default_rng(3).uniform(0.0, 24.0, 1500))  # uneven sampling
    found = oscillation_of(made(SHAPES[shape], 3.1, t, 0.02, 1))
    assert found.omega == pytest.approx(3.1, rel=4 * found.omega_error) and found.omega_error < 2e-3
    assert abs(found.growth) < 4 * found.growth_error
    assert difference(found, SHAPES[shape]) < 2.0


@pytest.mark.parametrize("growth", [-0.05, 0.03, 0.3])
def test_growth_is_told(growth):
    t = np.linspace(0.0, 30.0, 1200)
    found = oscillation_of(made(SHAPES["plain"], 2.5, t, 0.02, 2, growth))
    assert found.growth == pytest.approx(growth, abs=4 * found.growth_error)
    assert found.growth_error < 0.005


@pytest.mark.slow
def test_standard_deviations_are_those_of_many_records():
    t = np.linspace(0.0, 25.0, 500)
    found = [oscillation_of(made(SHAPES["odd"], 3.0, t, 0.05, seed)) for seed in range(30)]
    pulls = np.array([[(f.omega / 3.0 - 1.0) / f.omega_error, f.growth / f.growth_error] for f in found])
    # The standard deviation of 30 normal numbers is within 0.6 and 1.5 but in one of a thousand cases.
    assert np.all((pulls.std(axis=0) > 0.6) & (pulls.std(axis=0) < 1.5))
    assert 0.8 < np.mean([difference(f, SHAPES["odd"]) for f in found]) < 1.3


def test_time_may_begin_anywhere_and_scale():
    t = np.linspace(0.0, 20.0, 600)
    one = made(SHAPES["odd"], 3.0, t, 0.02, 5)
    late = oscillation_of(Record("late", 1e3 * t + 5e4, one.signals))
    first = oscillation_of(one)
    assert late.omega == pytest.approx(1e-3 * first.omega, rel=1e-7)
    assert late.growth == pytest.approx(first.growth, abs=1e-6)
    assert late.harmonics == pytest.approx(first.harmonics, abs=1e-6)


REFUSED = {
    "holds 2.5 periods": lambda t: {"time": t, "x": np.sin(2 * np.pi * 2.5 * t / t[-1])},
    "does not move": lambda t: {"time": t, "x": np.full(t.size, 3.0)},
    "expected an oscillation that repeats": lambda t: {
        "time": t,
        "x": np.sin(5.0 * t) + 3.0 * np.random.default_rng(0).normal(size=t.size),
    },
    "did you mean 'angle'": lambda t: {"time": t, "angl": t},
    "a column 'time'": lambda t: {"angle": t},
    "row 2, time is '9.97494'; expected a later time": lambda t: {"time": t[::-1], "x": t},
    "0 rows long": lambda t: {"time": t[:0], "x": t[:0]},
    "holes in fewer than half": lambda t: {"time": t, "x": np.where(t > 4.0, np.nan, t)},
    "row 4, time is 'inf'": lambda t: {"time": np.where(t == t[3], np.inf, t), "x": t},
    "x is 'of shape (3,)'; expected that of time, (400,)": lambda t: {"time": t, "x": t[:3]},
    "record is 'time'; expected a column of a signal": lambda t: {"time": t},
    "an ordinary magnitude in the unit of 'x'": lambda t: {"time": t, "x": 1e300 * np.sin(5.0 * t)},
    "x: holds complex numbers": lambda t: {"time": t, "x": np.exp(5.0j * t)},
    "'20 rows long'; expected 32 or more complete rows": lambda t: {"time": t[:20], "x": np.sin(t[:20])},
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_what_is_no_oscillation_is_refused_in_a_sentence(sentence):
    given = REFUSED[sentence](np.linspace(0.0, 10.0, 400))
    with pytest.raises(EppError, match=re.escape(sentence)):
        oscillation_of(record_of(given, UNITS))


def test_a_file_is_read_in_its_units(tmp_path):
    t = np.linspace(0.0, 10.0, 100)
    path = tmp_path / "record.csv"
    rows = [f"{1e3 * a:.6f},{np.degrees(np.sin(a)):.9f},{a:.6f},{2 * a:.6f}" for a in t]
    path.write_text("# bench\n" + "\n".join(["time [ms],Angle [deg],x,other", *rows]), encoding="utf-8")
    found = record_of(path, UNITS)
    assert list(found.signals) == ["angle", "x"]
    assert found.time == pytest.approx(t, abs=1e-8) and found.signals["angle"] == pytest.approx(np.sin(t), abs=1e-9)
    chosen = record_of(path, UNITS, {"torque": ("other", "mN*m")})
    assert chosen.signals["torque"] == pytest.approx(2e-3 * t, abs=1e-9)


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        ("t [s],x", "time"),
        ("time [s],y", "a column of a signal of the loop"),
        ("time [s],angle [V]", "unit of"),
    ],
)
def test_a_file_without_what_it_takes_is_refused(header, sentence, tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("\n".join([header, *(f"{i},{i}" for i in range(100))]), encoding="utf-8")
    with pytest.raises(EppError, match=sentence):
        record_of(path, UNITS)


@pytest.mark.parametrize("form", ["frame", "series", "arrays", "lists", "whole numbers"])
def test_a_data_frame_is_a_record_as_its_columns_are(form: str) -> None:
    import pandas as pd

    t = np.linspace(0.0, 40.0, 2000)
    frame = pd.DataFrame({"x": 100.0 * np.sin(0.9 * t), "time": t}, index=np.arange(2000)[::-1])
    if form == "whole numbers":
        frame["x"] = frame["x"].round().astype(int)
    given = {
        "frame": frame,
        "series": frame.to_dict("series"),
        "arrays": {name: frame[name].to_numpy() for name in frame},
        "lists": frame.to_dict("list"),
    }.get(form, frame)
    found = record_of(given, UNITS)
    assert np.array_equal(found.time, t) and [*found.signals] == ["x"]
    assert found.signals["x"] == pytest.approx(100.0 * np.sin(0.9 * t), abs=0.5 if form == "whole numbers" else 1e-12)


@pytest.mark.parametrize("wrong", ["a text", "holes", "no time", "unknown signals", "twice"])
def test_a_data_frame_that_is_no_record_is_one_sentence(wrong: str) -> None:
    import pandas as pd

    loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    t = np.linspace(0.0, 40.0, 200)
    frame = pd.DataFrame({"time": t, "x": np.sin(0.9 * t)})
    match wrong:
        case "a text":
            frame["x"] = frame["x"].map(lambda v: f"{v} V")
        case "holes":
            frame.loc[50:, "x"] = np.nan
        case "no time":
            frame = frame.drop(columns="time")
        case "unknown signals":
            frame = frame.rename(columns={"x": "speed"})
        case "twice":
            frame = frame[["time", "x", "x"]]
    with pytest.raises(epp.EppError, match="expected|must"):
        epp.diagnose(loop, frame)


def test_stamps_of_a_clock_that_counts_from_1970_are_times(tmp_path):
    """What is told of a record does not depend on when it began."""
    t = np.arange(400) * 0.05
    file = tmp_path / "log.csv"
    for begun in (0.0, 1.7e9):
        rows = "".join(f"{begun + s:.2f},{np.sin(2.0 * s) + 0.2 * np.sin(6.0 * s):.6f}\n" for s in t)
        file.write_text(f"time [s],x\n{rows}", encoding="utf-8")
        assert oscillation_of(record_of(file, UNITS)).omega == pytest.approx(2.0, rel=1e-5)


def test_a_time_that_jumps_out_of_all_range_is_refused(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("time [s],x\n" + "".join(f"{s},1\n" for s in range(40)) + "2e9,1\n", encoding="utf-8")
    with pytest.raises(EppError, match=r"time is '2e9'; expected an ordinary magnitude"):
        record_of(file, UNITS)


def test_headers_and_examples_are_those_of_the_record(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("time [s],speed\n" + "".join(f"{s},1\n" for s in range(40)), encoding="utf-8")
    with pytest.raises(EppError, match=r"line 1 is 'time \[s\], speed'; expected a column of a signal of the loop"):
        record_of(file, UNITS)
    ran = CliRunner().invoke(app, ["diagnose", "two_mass_damped_shaft", str(file), "--signal", "speed"])
    assert 'such as twist="channel 1:deg"' in " ".join(ran.output.split())
