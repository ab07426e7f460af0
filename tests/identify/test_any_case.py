"""Responses of cases that are no elbow: a two-inertia drive by an integrator of its own, loops, bad files."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.identify import with_estimates
from eppanalysis.identify.estimate import BenchFit, Estimate
from eppanalysis.identify.response import _run
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.results import Status

DRIVE = """
kind = "diagram"
title = "Two inertias, a shaft between them, dry friction at the load"
connect = [
  "current -> amplifier",
  "amplifier - shaft -> motor",
  "shaft - bearing -> load",
  "motor.angle - load.angle -> shaft.twist",
  "motor.speed - load.speed -> shaft.rate",
  "load.speed -> bearing",
]
inputs = { current = "0 A" }
run = { t_end = "1 s" }
[parameters]
Kt = { value = "0.5 N*m/A", mark = "derived" }
J_load = { value = "0.03 kg*m^2", mark = "tunable" }
coulomb = { value = "0.5 N*m", mark = "tunable" }
k = { value = "60 N*m/rad", mark = "tunable" }
[blocks]
amplifier = { kind = "gain", gain = "Kt" }
motor = { kind = "inertia", inertia = "0.004 kg*m^2", damping = "0.01 N*m*s/rad" }
load = { kind = "inertia", inertia = "J_load", damping = "0.02 N*m*s/rad" }
shaft = { kind = "shaft", stiffness = "k", damping = "0.02 N*m*s/rad" }
[elements]
bearing = { element = "friction", coulomb = "coulomb" }
"""
TRUTH = {"J_load": 0.02, "coulomb": 0.3, "k": 90.0}
TIME = np.arange(0.0, 1.0005, 0.002)
CURRENT = 3.0 * np.sin(2 * np.pi * 2.0 * TIME + 6.0 * TIME**2) + 1.5 * np.sin(2 * np.pi * 7.0 * TIME)


def slope(t: float, x: np.ndarray, sense: int) -> list[float]:
    """Both inertias while the load slides forward (1) or backward (-1), or sticks (0)."""
    a, v, b, w = x
    torque = TRUTH["k"] * (a - b) + 0.02 * (v - w)
    load = 0.0 if sense == 0 else (torque - TRUTH["coulomb"] * sense - 0.02 * w) / TRUTH["J_load"]
    return [v, (0.5 * np.interp(t, TIME, CURRENT) - torque - 0.01 * v) / 0.004, w if sense else 0.0, load]


def driven(x: np.ndarray) -> float:
    """What the shaft presses on the load with, beyond its friction; negative where it sticks."""
    return abs(TRUTH["k"] * (x[0] - x[2]) + 0.02 * (x[1] - x[3])) - TRUTH["coulomb"]


@cache
def truth() -> np.ndarray:
    """Angle and speed of the motor, of the load, at the rows: pieces of one sense of the friction after the other."""
    t, x, sense, out = 0.0, np.zeros(4), 0, np.zeros((TIME.size, 4))
    while t < TIME[-1]:

        def stops(_: float, x: np.ndarray, sense: int = sense) -> float:
            return x[3] if sense else driven(x)

        stops.terminal, stops.direction = True, float(-sense if sense else 1)
        run = solve_ivp(
            lambda t, x, sense=sense: slope(t, x, sense), (t, TIME[-1]), x, method="DOP853", events=stops,
            rtol=1e-9, atol=1e-12, max_step=2e-3, dense_output=True,
        )  # fmt: skip
        rows = (t <= TIME) & (run.t[-1] >= TIME)
        out[rows] = run.sol(TIME[rows]).T
        t, x = run.t[-1], run.y[:, -1].copy()
        x[3] = 0.0
        press = TRUTH["k"] * (x[0] - x[2]) + 0.02 * x[1]
        sense = int(np.sign(press)) if abs(press) >= TRUTH["coulomb"] * (1 - 1e-9) else 0
        x[3] = 1e-12 * sense
    return out


def drive() -> epp.Case:
    return epp.case_from_text(DRIVE)


def record(folder: Path, names: str, *columns: np.ndarray) -> Path:
    path = folder / "record.csv"
    rows = np.column_stack([TIME, *columns])
    path.write_text(f"{names}\n" + "\n".join(",".join(f"{v:.7g}" for v in row) for row in rows.tolist()) + "\n")
    return path


def noisy(seed: int = 5) -> np.ndarray:
    """The motor's angle [deg] as it is read."""
    return np.degrees(truth()[:, 0]) + 0.05 * np.random.default_rng(seed).normal(size=TIME.size)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    path = record(tmp_path_factory.mktemp("drive"), "time [s],motor_angle [deg],current [A]", noisy(), CURRENT)
    return epp.identify(drive(), step=path, fit=tuple(TRUTH))


@pytest.mark.slow
def test_the_integrators_agree():
    """Else the intervals below would say nothing."""
    run = epp.simulate(drive().with_values(TRUTH), epp.inputs.Recorded(TIME, CURRENT), t_end=TIME[-1], t_eval=TIME)
    assert np.ptp(truth()[:, 2]) > 0.5 and np.sum(np.diff(truth()[:, 2]) == 0.0) > 4  # it sticks, then moves
    assert run.signals["motor_angle"] == pytest.approx(truth()[:, 0], abs=2e-6)


@pytest.mark.slow
def test_a_drive_is_found_from_its_recorded_current_and_angle(found):
    fit = found.fits[0]
    assert fit.status is Status.CONVERGED
    for name, value in TRUTH.items():
        assert fit[name].identified and fit[name].low < value < fit[name].high
        assert fit[name].relative_width < 0.1


@pytest.mark.slow
def test_the_result_is_a_case_for_all_that_takes_one(found, tmp_path):
    (tmp_path / "found.toml").write_text(found.to_toml())
    again = epp.read_case(tmp_path / "found.toml")
    measured = again.parameters["J_load"]
    assert measured.mark == "measured" and measured.unit == "kg*m^2"
    assert measured.tolerance == pytest.approx(found["J_load"].tolerance, rel=1e-9)
    assert again.with_values({"J_load": "25 g*m^2"}).value("J_load") == pytest.approx(0.025)


@pytest.mark.slow
def test_a_model_that_is_wrong_elsewhere_is_said_and_what_would_mend_it(tmp_path, few_draws):
    """The motor is damped threefold in the case: its fit leaves little more than noise, but is no fit."""
    text = DRIVE.replace('damping = "0.01 N*m*s/rad"', 'damping = "0.03 N*m*s/rad"')
    case = epp.case_from_text(text).with_values({name: TRUTH[name] for name in ("coulomb", "k")})
    path = record(tmp_path, "time [s],motor_angle [deg],current [A]", noisy(), CURRENT)
    fit = epp.identify(case, step=path, fit=("J_load",)).fits[0]
    assert fit.status is Status.NOT_CONVERGED
    assert any("suggest motor.damping by -" in note for note in fit.notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "rows"),
    [(None, "0.498 s to 0.5 s"), (49, "0.096 s to 0.1 s")],
    ids=["no row is missing", "the row before the step is missing"],
)
def test_what_an_input_does_between_rows_is_said_where_it_matters(tmp_path, few_draws, missing, rows):
    """The current is held from row to row, and the fit takes straight lines: what it says then is the true value."""
    current = np.where(TIME < 0.1, 0.0, np.where(TIME < 0.5, 3.0, -1.0))
    kept = np.arange(TIME.size) != missing
    times, held = TIME[kept], epp.inputs.Steps(TIME[kept], current[kept])
    run = epp.simulate(drive().with_values(TRUTH), held, t_end=TIME[-1], t_eval=times)
    angle = np.degrees(run.signals["motor_angle"]) + 0.05 * np.random.default_rng(5).normal(size=times.size)
    path = tmp_path / "record.csv"
    columns = np.column_stack([times, angle, current[kept]])
    np.savetxt(path, columns, delimiter=",", header="time [s],motor_angle [deg],current [A]", comments="")
    known = drive().with_values({name: TRUTH[name] for name in ("J_load", "coulomb")})
    fit = epp.identify(known, step=path, fit=("k",)).fits[0]
    assert not fit["k"].low <= TRUTH["k"] <= fit["k"].high
    (said,) = [note for note in fit.notes if "linear between rows" in note]
    assert f"Were current held from {rows} and so on, k would be " in said
    assert float(said.partition("k would be ")[2].split()[0]) == pytest.approx(TRUTH["k"], rel=3e-3)


@pytest.mark.slow
def test_what_acts_as_a_sum_alone_is_named(tmp_path, few_draws):
    """Two inertias on one shaft: the motion depends on their sum, so that one of them is taken from the case."""
    parts = 'J_arm = "0.012 kg*m^2"\nJ_tool = "0.015 kg*m^2"\nJ_load = "J_arm + J_tool"'
    text = DRIVE.replace('J_load = { value = "0.03 kg*m^2", mark = "tunable" }', parts)
    case = epp.case_from_text(text).with_values({name: TRUTH[name] for name in ("coulomb", "k")})
    path = record(tmp_path, "time [s],motor_angle [deg],current [mA]", noisy(), 1e3 * CURRENT)
    result = epp.identify(case, step=path, fit=("J_arm", "J_tool"))
    fit = result.fits[0]
    vague = {e.name: e for e in fit.unidentified}
    held = [e for e in vague.values() if not e.kept]
    assert len(held) == 1 and len(vague) == 2
    other = ({"J_arm", "J_tool"} - {held[0].name}).pop()
    assert f"the data do not identify it from {other}" in held[0].note
    assert result.case.parameters[held[0].name].mark == "assumed"
    assert result.case.value("J_arm") + result.case.value("J_tool") == pytest.approx(TRUTH["J_load"], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.02, 0.0125])
def test_an_estimate_at_an_end_of_the_search_is_none(tmp_path, few_draws, share):
    """The search ends at fifty times the case's value: there the truth is, or beyond."""
    case = epp.case_from_text(DRIVE).with_values({**TRUTH, "J_load": share * TRUTH["J_load"]})
    path = record(tmp_path, "time [s],motor_angle [deg],current [mA]", noisy(), 1e3 * CURRENT)
    result = epp.identify(case, step=path, fit=("J_load",))
    end = case.text("J_load", 50.0 * share * TRUTH["J_load"])
    assert not result["J_load"].identified and f"reaches {end}, where the search ends" in result["J_load"].note
    assert result.case.value("J_load") == case.value("J_load") and "0 of 1 parameter" in str(result)


@pytest.mark.slow
def test_what_is_nothing_at_all_is_identified_as_that(tmp_path, few_draws):
    text = DRIVE.replace('inertia = "J_load", damping = "0.02 N*m*s/rad"', 'inertia = "J_load", damping = "oil + more"')
    text = text.replace("[parameters]", '[parameters]\noil = "0.02 N*m*s/rad"\nmore = "0.1 N*m*s/rad"')
    case = epp.case_from_text(text).with_values(TRUTH)
    path = record(tmp_path, "time [s],motor_angle [deg],current [mA]", noisy(seed=0), 1e3 * CURRENT)
    more = epp.identify(case, step=path, fit=("more",))["more"]
    assert more.identified and 0.0 <= more.low <= more.value <= more.high < 0.01


@pytest.mark.parametrize(
    ("name", "field", "signal", "stretch"),
    [
        pytest.param("two_mass_deadzone", "dead_zone.lower", "load [rad]", 1.0, marks=pytest.mark.slow),
        ("backlash_servo", "play.gap", "x", 20.0),
    ],
)
def test_loops_of_matrices_and_rings_are_fitted_from_their_start(tmp_path, few_draws, name, field, signal, stretch):
    """No input moves them; a field may be negative, a signal without a unit."""
    case = epp.case(name)
    value = 1.3 * case.value(field)
    times = TIME * stretch
    run = epp.simulate(case.with_values({field: value}), t_end=times[-1], t_eval=times)
    y = run.signals[signal.partition(" ")[0]]
    y = y + 0.01 * np.std(y) * np.random.default_rng(1).normal(size=y.size)
    path = tmp_path / "record.csv"
    np.savetxt(path, np.column_stack([times, y]), delimiter=",", header=f"time [s],{signal}", comments="")
    told: list[str] = []
    estimate = epp.identify(case, step=path, fit=(field,), progress=lambda *at: told.append(at[2]))[field]
    # What the intervals take is shown as it goes, too: where the sum of squares is rough it is the longer part.
    assert told.count("identify: intervals") > 10
    assert estimate.identified and estimate.low <= estimate.high
    assert estimate.value == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize(
    ("header", "arguments", "expected"),
    [
        ("time [s],motr_angle [deg],current [A]", ("--fit", "J_load"), "did you mean 'motor_angle'?"),
        ("time [s],motor_angle [mm],current [A]", ("--fit", "J_load"), "expected the unit of an angle"),
        ("time [s],motor_angle [deg],current [V]", ("--fit", "J_load"), "expected the unit of a quantity in A"),
        ("time [s],motor_angle [deg],current [A]", (), "--fit with one or more of J_load, coulomb, k."),
        ("time [s],motor_angle [deg],current [A]", ("--fit", "J_laod"), "did you mean 'J_load'?"),
        ("time [s],theta [deg],current [A]", ("--fit", "k", "--signal", "motr=theta"), "one of time, "),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path, header, arguments, expected):
    (tmp_path / "drive.toml").write_text(DRIVE)
    path = record(tmp_path, header, CURRENT, CURRENT)
    result = CliRunner().invoke(app, ["identify", str(tmp_path / "drive.toml"), "--step", str(path), *arguments])
    assert result.exit_code == 2 and not result.stdout
    assert expected in result.stderr and len(result.stderr.strip().splitlines()) == 1


def test_without_a_record_only_that_which_a_case_can_take_is_asked_for():
    with pytest.raises(epp.EppError, match="no measured file is given; expected step: a recorded response"):
        epp.identify(epp.case("azimuth_servo"))
    with pytest.raises(epp.EppError, match="expected tray, backlash or step: a weight tray"):
        epp.identify(epp.case("elbow"))


def test_other_columns_are_named(tmp_path):
    from eppanalysis.records.reading import read_recording

    path = record(tmp_path, "time [s],motor_angle [deg],note [V]", CURRENT, CURRENT)
    read = read_recording(path, ("time", "motor_angle"), units={"time": "s", "motor_angle": "rad"})
    assert read.sentences() == ["Columns that were not used: note [V]."]


@pytest.mark.parametrize(
    ("case", "name"),
    [
        ("azimuth_servo", "gap"),
        ("azimuth_servo", "controller.sample_time"),
        ("fig8a_original", "lock_pin.backlash"),
        ("elbow", "cable.stiffness"),
    ],
)
def test_the_file_has_what_was_identified_in_the_unit_that_the_case_has_it_in(case, name):
    given = epp.case(case)
    unit = given.parameters[name].friendly
    for k in range(1, 40, 4):
        value, width = given.parameters[name].value * (1.0 + k / 97.0), given.parameters[name].value / (30.0 + k)
        found = Estimate(name, value, value - width, value + width, *given.unit(name))
        text = with_estimates(given, BenchFit("step", "record.csv", (found,), {})).to_toml()
        held = tomllib.loads(text)
        written = [t for t in _tables(held) if t.get("mark") == "measured" and "record.csv" in t.get("note", "")]
        assert [t[key].partition(" ")[2] for t in written for key in ("value", "tolerance")] == [unit, unit]
        again = epp.case_from_text(text).parameters[name]
        assert again.value == pytest.approx(value, rel=1e-11)
        assert again.tolerance == pytest.approx(found.tolerance, rel=1e-11)


def _tables(held):
    yield held
    for inner in held.values():
        if isinstance(inner, dict):
            yield from _tables(inner)


@pytest.mark.parametrize("T", [0.1, 0.3, 1.0])
def test_a_row_at_a_sample_holds_what_the_controller_has_then_computed(T):
    """From sample to sample in closed form: a lag behind a sampled gain, whose limit is not reached."""
    tables = {
        "kind": "diagram",
        "title": "Lag behind a sampled gain",
        "connect": ["-lag -> law", "law -> limit", "limit -> lag"],
        "run": {"t_end": "1 s"},
        "blocks": {
            "law": {"kind": "gain", "gain": 0.5, "sample_time": f"{T} s"},
            "lag": {"kind": "transfer_function", "num": [1], "den": [1, 1], "start": [1.0]},
        },
        "elements": {"limit": {"element": "saturation", "lower": -5, "upper": 5}},
    }
    loop, times = epp.Case.from_tables(tables, name="lag").to_system(), T * np.arange(20)
    factor = np.exp(-T) - 0.5 * (1.0 - np.exp(-T))
    run = _run(HybridSystem.from_lure(loop), times)
    law, lag = (run.samples[:, loop.signals.names.index(name)] for name in ("law", "lag"))
    np.testing.assert_allclose(lag, factor ** np.arange(20), atol=3e-6)
    np.testing.assert_allclose(law, -0.5 * factor ** np.arange(20), atol=3e-6)
