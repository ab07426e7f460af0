"""Loops as Co-Simulation units, run by FMPy and compared with `simulate`."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest

import eppanalysis as epp

fmpy = pytest.importorskip("fmpy")

from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.simulation import instantiate_fmu  # noqa: E402

pytestmark = pytest.mark.slow
#: Play, friction, relay with dead time, saturation, a sampled controller with a quantiser, three set points.
CASES = (
    "backlash_servo",
    "steering_compensated",
    "relay_fopdt_closed",
    "sat_am165",
    "azimuth_servo",
    "fig8a_three_steps",
)
STEPS = 1000


def _agree(run, reference, tolerance=1e-6):
    """Whether all signals of a run by FMPy are those of a trajectory, relative to their sizes."""
    assert len(reference.signals) == len(run.dtype.names) - 1
    for name, expected in reference.signals.items():
        size = np.ptp(expected) or 1.0
        np.testing.assert_allclose(run[name], expected, rtol=0.0, atol=tolerance * size, err_msg=name)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("name", CASES)
def test_run_is_that_of_simulate(tmp_path, name, version):
    """The description is valid, and ten seconds with all their switches are those of `simulate`."""
    case = epp.case(name)
    path = epp.to_fmu(case, tmp_path / "loop.fmu", version=version)
    description = fmpy.read_model_description(path, validate_variable_names=False, validate_model_structure=True)
    assert description.fmiVersion == f"{version}.0"
    end = 9.99  # three set points step at ten
    run = fmpy.simulate_fmu(path, stop_time=end, output_interval=end / STEPS)
    reference = epp.simulate(case, t_end=end, t_eval=np.linspace(0.0, end, STEPS + 1))
    assert reference.n_events > 5
    _agree(run, reference)


@pytest.mark.parametrize("version", [2, 3])
def test_inputs(tmp_path, version):
    """Inputs that change between steps are those of `simulate` with the same steps, beside the signal of the case."""
    case = epp.case("fig8a_original")
    path = epp.to_fmu(case, tmp_path / "loop.fmu", version=version)
    steps = epp.inputs.Steps([0.5, 1.25, 3.0], [0.01, -0.02, 0.0])
    end, dtype = 5.0, [("time", float), ("harness_position_offset", float)]
    times = [0.0, 0.5, 0.5, 1.25, 1.25, 3.0, 3.0, end]
    signal = np.array(list(zip(times, [0, 0, 0.01, 0.01, -0.02, -0.02, 0, 0], strict=True)), dtype)
    at = np.linspace(0.0, end, STEPS + 1)
    run = fmpy.simulate_fmu(path, stop_time=end, output_interval=end / STEPS, input=signal)
    both = epp.inputs.Steps([0.0, *steps.times], [0.02, *(0.02 + steps.values)])
    reference = epp.simulate(case, both, t_end=end, t_eval=at)
    # FMPy samples twice where an input jumps: before and behind it; both are before what the jump brings about.
    _, first = np.unique(np.round(run["time"], 9), return_index=True)
    kept = ~np.isin(np.round(at, 9), steps.times)
    for name, expected in reference.signals.items():
        size = np.ptp(expected)
        np.testing.assert_allclose(run[name][first][kept], expected[kept], rtol=0.0, atol=1e-6 * size, err_msg=name)


def test_given_input_signals(tmp_path):
    """Signals of the case's inputs can be replaced, and left out: then a start value takes their place."""
    case, end = epp.case("fig8a_original"), 2.0
    at = np.linspace(0.0, end, 201)
    sine = {"harness_position": epp.inputs.Sine(0.01, 0.7)}
    for given, values, reference in ((sine, {}, sine), ({}, {"harness_position_offset": 0.02}, None)):
        path = epp.to_fmu(case, tmp_path / "loop.fmu", input=given)
        run = fmpy.simulate_fmu(path, stop_time=end, output_interval=end / 200, start_values=values)
        _agree(run, epp.simulate(case, reference, t_end=end, t_eval=at))
    with pytest.raises(epp.ModelError, match="has no input 'handle'"):
        epp.to_fmu(case, tmp_path / "loop.fmu", input={"handle": epp.inputs.Constant(1.0)})


def _instance(path, folder):
    description = fmpy.read_model_description(path)
    unit = instantiate_fmu(fmpy.extract(path, folder), description, "CoSimulation", logger=lambda *_: None)
    references = [v.valueReference for v in description.modelVariables if v.causality == "output"]
    read = unit.getReal if description.fmiVersion == "2.0" else unit.getFloat64

    def start(time=0.0):
        if description.fmiVersion == "2.0":
            unit.setupExperiment(startTime=time)
            unit.enterInitializationMode()
        else:
            unit.enterInitializationMode(startTime=time)
        unit.exitInitializationMode()

    return unit, start, lambda: read(references)


def _stepped(units, step, count, begin=0.0):
    for k in range(count):
        for unit in units:
            unit.doStep(currentCommunicationPoint=begin + k * step, communicationStepSize=step)


@pytest.mark.parametrize("version", [2, 3])
def test_instances(tmp_path, version):
    """Two instances do not know of each other, a reset leads to the start, steps of any length to one place."""
    path = epp.to_fmu(epp.case("relay_fopdt_closed"), tmp_path / "loop.fmu", version=version)
    (one, start, of_one), (other, start_other, of_other) = (_instance(path, tmp_path / n) for n in ("a", "b"))
    start()
    begin = of_one()
    _stepped([one], 0.01, 400)
    far = of_one()
    start_other(100.0)
    assert of_other() == begin
    _stepped([other], 0.4, 10, 100.0)
    assert of_other() == pytest.approx(far, rel=1e-9)
    for _ in range(2):
        one.terminate()
        one.reset()
        start()
        assert of_one() == begin
        _stepped([one], 0.01, 400)
        assert of_one() == far
    with pytest.raises(FMICallException):
        one.doStep(currentCommunicationPoint=1.0, communicationStepSize=0.1)  # back in time
    one.freeInstance()
    _stepped([other], 0.4, 1, 104.0)
    other.freeInstance()


def test_refusals(tmp_path):
    """What makes no unit is refused, and leaves no file behind."""
    path = tmp_path / "loop.fmu"
    with pytest.raises(epp.EppError, match=re.escape("to_fmu: version is 1; expected 2 or 3.")):
        epp.to_fmu(epp.case("backlash_servo"), path, version=1)
    with pytest.raises(epp.EppError, match="is in discrete time; expected a loop in continuous time"):
        epp.to_fmu(epp.case("backlash_discrete_pi"), path)
    assert not path.exists()


def test_other_tables(tmp_path):
    """Tables of another unit, or broken ones, make no instance."""
    path = epp.to_fmu(epp.case("backlash_servo"), tmp_path / "loop.fmu")
    description, folder = fmpy.read_model_description(path), fmpy.extract(path, tmp_path / "unit")
    said = []

    def refused(tables: bytes) -> str:
        (folder / "resources" / "loop.bin").write_bytes(tables)
        with pytest.raises(Exception, match="instantiate"):
            instantiate_fmu(folder, description, "CoSimulation", logger=lambda *told: said.append(told[-1].decode()))
        return said[-1]

    own = (folder / "resources" / "loop.bin").read_bytes()
    assert "end too early" in refused(own[:200])
    assert "is not that of the model description" in refused(b"0" * 36 + own[36:])


def test_unit_without_python(tmp_path):
    """The library in a unit links nothing but the system's, and the same loop makes the same bytes."""
    first, second = (epp.to_fmu(epp.case("backlash_servo"), tmp_path / f"{n}.fmu").read_bytes() for n in "ab")
    assert first == second
    with zipfile.ZipFile(tmp_path / "a.fmu") as unit:
        (library,) = [name for name in unit.namelist() if name.startswith("binaries/")]
        unit.extract(library, tmp_path)
    if sys.platform == "linux":
        needed = subprocess.run(["ldd", tmp_path / library], capture_output=True, text=True, check=True).stdout
        assert not re.search("python|stdc", needed)
