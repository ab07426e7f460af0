"""Signals and times are shown in the units that a case types; what computes stays in SI units."""

import copy
import math
import pickle

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cases.model import Case
from eppanalysis.readable import Unit, number, readable, written
from eppanalysis.units import parse_quantity

_TABLES = {
    "kind": "diagram",
    "title": "Servo",
    "connect": [
        "-load.angle -> controller",
        "controller -> motor.voltage",
        "motor.angle - load.angle -> gear.twist",
        "motor.speed - load.speed -> gear.rate",
        "-gear -> motor.torque",
        "gear -> load",
    ],
    "run": {"t_end": "6 s"},
    "blocks": {
        "controller": {"kind": "pi", "kp": "40 V/rad", "ti": "0.4 s"},
        "motor": {
            "kind": "motor",
            "resistance": "2 ohm",
            "torque_constant": "0.05 N*m/A",
            "inertia": "2e-5 kg*m^2",
            "ratio": 50,
        },
        "load": {
            "kind": "inertia",
            "inertia": "0.05 kg*m^2",
            "damping": "0.1 N*m*s/rad",
            "start": [0.1, 0],
        },
    },
    "elements": {
        "gear": {"element": "lock_pin", "gap": "0.1 deg", "stiffness": "800 N*m/rad", "damping": "1.5 N*m*s/rad"}
    },
}


def servo(signals=None, **run):
    tables = copy.deepcopy(_TABLES)
    tables["run"] |= run
    return Case.from_tables({**tables, **({"signals": signals} if signals else {})}, "servo")


def shown(case, name):
    return readable(case.to_system().signals.units_by_name()[name])[0]


@pytest.mark.parametrize("unit", ["rad", "deg", "arcmin", "turn", "mrad"])
def test_a_signal_is_shown_in_its_own_unit_and_computed_in_si(unit):
    usual = epp.simulate(servo({"load": {"of": "load.angle"}}))
    case = servo({"load": {"of": "load.angle", "unit": unit}})
    run = epp.simulate(case)
    assert shown(case, "load") == unit
    assert np.array_equal(run.signals["load"], usual.signals["load"])  # whatever it is shown in
    span = run.limit_cycle.peak_to_peak["load"]
    assert f"load {number(span / parse_quantity(f'1 {unit}', 'rad'))} {unit} peak to peak" in str(run)
    assert case.to_system().signals.units[0] == "rad"  # in files


def test_what_has_no_unit_of_its_own_has_that_of_its_dimension():
    case = servo({"speed": {"of": "motor.speed", "unit": "rpm"}})
    assert shown(case, "load_speed") == "rpm"
    assert shown(case, "motor_angle") == "deg"  # as the gap
    rad = case.with_values({"gear.gap": "0.002 rad"})
    assert shown(rad, "motor_angle") == "rad"
    assert shown(servo(), "load_speed") == "deg/s"  # a rate of what is typed in degrees


@pytest.mark.parametrize(("t_end", "unit"), [("6 s", "s"), ("6000 ms", "ms"), ("0.1 min", "min"), (6.0, "s")])
def test_times_are_shown_as_the_length_of_the_run_is_typed(t_end, unit):
    run = epp.simulate(servo(t_end=t_end))
    assert f" {unit} on" in str(run)
    label = run.plot().figure.axes[-1].get_xlabel()
    assert label.startswith(f"time [{unit}]")
    assert run.limit_cycle.period == pytest.approx(epp.simulate(servo()).limit_cycle.period, rel=1e-12)


def test_the_time_axis_has_numbers_of_its_unit():
    run = epp.simulate(servo(t_end="0.1 min"))
    ax = run.plot().figure.axes[-1]
    ax.figure.canvas.draw()
    low, high = ax.get_xlim()
    ticks = [float(text.get_text()) for text in ax.get_xticklabels() if text.get_text()]
    places = ax.get_xticks()
    assert len(ticks) >= 3
    assert np.allclose(np.asarray(places)[: len(ticks)] / 60.0, ticks, rtol=1e-3, atol=1e-9)
    assert max(ticks) * 60.0 <= high + (high - low)


def test_a_unit_goes_with_results_to_other_processes():
    unit = Unit("rad/s", "rpm", 30.0 / math.pi)
    for again in (pickle.loads(pickle.dumps(unit)), copy.deepcopy(unit)):
        assert again == "rad/s"
        assert readable(again) == readable(unit)


def test_a_case_made_in_python_is_shown_as_before():
    """A loop whose signals have SI units is written so that they look as they did."""
    loop = epp.case("freeplay_section").to_system()
    again = epp.Case.from_system(loop, name="again", t_end=1.0)
    for name, unit in again.to_system().signals.units_by_name().items():
        if name in loop.signals.names:
            assert written(unit) == written(loop.signals.units_by_name()[name])
