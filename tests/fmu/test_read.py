"""Units of another tool as the linear part of a loop."""

from __future__ import annotations

import math
import shutil
import zipfile

import numpy as np
import pytest

import eppanalysis as epp

fmpy = pytest.importorskip("fmpy")

from tests.fmu import units  # noqa: E402

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler makes units"),
]
PLAY = {("angle", "torque"): epp.Play(gap=0.1)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("units")


def _drive(inertia: float) -> tuple[np.ndarray, ...]:
    """Matrices of the drive in `unit.c`, its speed in SI units."""
    A = np.array([[0.0, 1.0], [-1.3 / inertia, -0.7 / inertia]])
    B = np.array([[0.0, 0.0], [1.0 / inertia, 1.0 / inertia]])
    C, D = np.vstack([np.eye(2), A[1]]), np.vstack([np.zeros(2), [0.0, 0.25], B[1]])
    to_si = np.array([1.0, units.RPM, 1.0])[:, None]
    return A, B, to_si * C, to_si * D


@pytest.mark.parametrize("directional", [True, False], ids=["directional", "differences"])
@pytest.mark.parametrize("version", [2, 3])
def test_linear_unit(folder, version, directional):
    """Matrices, signals, units and names are those of the model, exactly."""
    path = units.make(folder, "drive", version, directional=directional)
    loop = epp.from_fmu(path, PLAY)
    A, B, C, D = _drive(0.5)
    for found, expected in (
        (loop.A, A), (loop.B, B[:, :1]), (loop.B_input, B[:, 1:]), (loop.signals.C, np.vstack([C, np.zeros(2)])),
        (loop.signals.D[:3], D[:, :1]), (loop.signals.D_input[:3], D[:, 1:]), (loop.C, C[:1]),
    ):  # fmt: skip
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=0.0)
    assert not np.any(loop.constant_state) and not np.any(loop.signals.constant)
    assert loop.input_names == ("load",)
    assert loop.signals.names == (*units.OUTPUTS, "torque")
    assert loop.signals.units == ("", "rad/s", "rad/s2", "")
    assert loop.state_names == units.STATES and loop.name == "drive"


def test_parameters(folder):
    """A parameter is that of the unit."""
    path = units.make(folder, "drive", 3)
    np.testing.assert_allclose(epp.from_fmu(path, PLAY, parameters={"inertia": 0.02}).A, _drive(0.02)[0], rtol=1e-12)
    with pytest.raises(epp.ModelError, match=r"parameters is 'inertja'; expected a parameter: .*inertia"):
        epp.from_fmu(path, PLAY, parameters={"inertja": 0.02})
    with pytest.raises(epp.EppError, match="SetFloat64 fails"):
        epp.from_fmu(path, PLAY, parameters={"inertia": -1.0})


@pytest.mark.parametrize("directional", [True, False], ids=["directional", "differences"])
@pytest.mark.parametrize("version", [2, 3])
def test_pendulum_at_rest(folder, version, directional):
    """A pendulum under a torque is linearised where it hangs; the loop starts where the unit does."""
    path = units.make(folder, "pendulum", version, directional=directional)
    with pytest.warns(UserWarning, match="is not linear; it is linearised at rest .angle_state = 0.5235"):
        loop = epp.from_fmu(path, {("speed", "load"): epp.Saturation()})
    rest = math.asin(1.5 / 3.0)
    stiffness = 3.0 * math.cos(rest) / 0.5
    np.testing.assert_allclose(loop.A, [[0.0, 1.0], [-stiffness, -0.8]], rtol=1e-9)
    np.testing.assert_allclose(loop.constant_state, [0.0, stiffness * rest - 3.0], rtol=1e-9, atol=1e-12)
    assert loop.x0.tolist() == [0.2, 0.0] and loop.v0.tolist() == [1.5]
    run = epp.simulate(loop, t_end=60.0)
    assert run.signals["angle"][-1] == pytest.approx(rest, abs=1e-9)


@pytest.mark.parametrize("version", [2, 3])
def test_switching_unit(folder, version):
    """A limit that only events switch is seen."""
    path = units.make(folder, "limited", version, directional=False)
    with pytest.warns(UserWarning, match="is not linear"):
        loop = epp.from_fmu(path, PLAY)
    np.testing.assert_allclose(loop.A, _drive(0.5)[0], rtol=1e-9)


def test_co_simulation(folder):
    """Where states cannot be set the directional derivatives at the start are taken, and a warning says so."""
    path = units.make(folder, "drive", 3, kind="CoSimulation")
    with pytest.warns(UserWarning, match="is linearised at its start"):
        loop = epp.from_fmu(path, PLAY)
    np.testing.assert_allclose(loop.A, _drive(0.5)[0], rtol=1e-12)


@pytest.mark.parametrize("directional", [True, False], ids=["directional", "differences"])
@pytest.mark.parametrize("version", [2, 3])
def test_oscillator_at_rest(folder, version, directional):
    """Van der Pol's oscillator begins on one side of its cycle and is linearised at rest: ``[[0, 1], [-1, mu]]``."""
    path = units.make(folder, "oscillator", version, directional=directional)
    for mu in (1.0, 0.3):
        with pytest.warns(
            UserWarning, match=r"is not linear; it is linearised at rest .angle_state = 0, speed_state = 0"
        ):
            loop = epp.from_fmu(path, {("speed_state", "torque"): epp.Saturation()}, parameters={"mu": mu})
        np.testing.assert_allclose(loop.A, [[0.0, 1.0], [-1.0, mu]], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(loop.B, [[0.0], [1.0]], rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(loop.signals.C[:3], [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
        assert loop.x0.tolist() == [2.0, 0.0] and not np.any(loop.constant_state)


def _state_space(n: int) -> dict[str, np.ndarray]:
    """Matrices that are all different."""
    return {name: np.round(np.random.default_rng(k).normal(size=(n, n)), 3) for k, name in enumerate("ABCD")}


@pytest.mark.parametrize("directional", [True, False], ids=["directional", "differences"])
def test_arrays(folder, directional):
    """Each number of an array is a signal; inputs that jump are set at events; sizes follow a structural parameter."""
    path = units.make(folder, "state_space", 3, directional=directional)
    for n in (3, 2):
        given = _state_space(n)
        play = {("y[1]", "u[2]"): epp.Play(gap=0.1)}
        given["D"][0, 1] = 0.0  # no way round the element without a state
        loop = epp.from_fmu(path, play, parameters={**given, **({} if n == 3 else {"n": n})})
        free = [k for k in range(n) if k != 1]
        for found, expected in (
            (loop.A, given["A"]), (loop.B, given["B"][:, 1:2]), (loop.B_input, given["B"][:, free]),
            (loop.C, given["C"][:1]), (loop.signals.C[:n], given["C"]), (loop.signals.D[:n], given["D"][:, 1:2]),
            (loop.signals.D_input[:n], given["D"][:, free]),
        ):  # fmt: skip
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=0.0)
        assert loop.state_names == tuple(f"x[{k + 1}]" for k in range(n))
        assert loop.signals.names == (*(f"y[{k + 1}]" for k in range(n)), "u[2]")
        assert dict(zip(loop.input_names, loop.v0, strict=True)) == {f"u[{k + 1}]": k + 1.0 for k in free}


def test_parameters_that_are_arrays(folder):
    """A parameter has the shape that it has in the unit."""
    path, play = units.make(folder, "state_space", 3), {("y[1]", "u[1]"): epp.Play(gap=0.1)}
    for given, words in (
        ({"A": np.eye(2)}, r"state_space3.*fmu: parameter A has the shape .2, 2.; expected .3, 3."),
        ({"A": 1.0}, r"parameter A has the shape ..; expected .3, 3."),
        ({"n": [2]}, r"parameter n has the shape .1,.; expected a number"),
        ({"n": 2, "A": np.eye(3)}, r"parameter A has the shape .3, 3.; expected .2, 2."),
    ):
        with pytest.raises(epp.ModelError, match=words):
            epp.from_fmu(path, play, parameters=given)
    with pytest.raises(epp.EppError, match="fmi3SetUInt64 fails"):
        epp.from_fmu(path, play, parameters={"n": 9})
    with pytest.raises(epp.ModelError, match=r"has no output 'y'; expected one of: y\[1\], y\[2\], y\[3\]"):
        epp.from_fmu(path, {("y", "u[1]"): epp.Play(gap=0.1)})


def test_limit_cycles_of_the_loop(folder):
    """The loop has the limit cycle of the same loop by hand."""
    path = units.make(folder, "drive", 2)
    relay = epp.HysteresisRelay(-0.02, 0.02, low=1.0, high=-1.0)
    loop = epp.from_fmu(path, {("angle", "torque"): relay})
    A, B, C, _ = _drive(0.5)
    by_hand = epp.LureSystem.build(A, B[:, :1], C[:1], [relay])
    cycles = [epp.simulate(each, t_end=100.0).limit_cycle for each in (
        epp.from_fmu(path, {("angle", "torque"): relay}, x0=[0.1, 0.0]),
        epp.LureSystem.build(A, B[:, :1], C[:1], [relay], x0=[0.1, 0.0]),
    )]  # fmt: skip
    assert cycles[0].period == pytest.approx(cycles[1].period, rel=1e-9)
    predicted = [epp.predict_limit_cycles(each).cycles[0].period for each in (loop, by_hand)]
    assert predicted[0] == pytest.approx(predicted[1], rel=1e-9)


def test_refusals(folder, tmp_path):
    """What cannot be read is refused in one sentence."""
    with pytest.raises(epp.EppError, match="nowhere.fmu: cannot be read .*No such file or directory"):
        epp.from_fmu(tmp_path / "nowhere.fmu", PLAY)
    broken = tmp_path / "broken.fmu"
    broken.write_text("no zip")
    with pytest.raises(epp.EppError, match="broken.fmu: cannot be read .File is not a zip file.; expected a unit"):
        epp.from_fmu(broken, PLAY)
    with zipfile.ZipFile(broken, "w") as archive:
        archive.writestr("readme.txt", "nothing")
    with pytest.raises(
        epp.EppError, match="cannot be read .There is no item named 'modelDescription.xml' in the archive"
    ):
        epp.from_fmu(broken, PLAY)
    with zipfile.ZipFile(broken, "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
    with pytest.raises(epp.EppError, match="cannot be read .*; expected a unit .FMU. of FMI 2 or 3"):
        epp.from_fmu(broken, PLAY)
    with pytest.raises(epp.EppError, match=r"has libraries for vax64; expected one for "):
        epp.from_fmu(units.make(folder, "drive", 2, platform="vax64"), PLAY)
    with pytest.raises(epp.EppError, match="is neither for Model Exchange nor gives directional derivatives"):
        epp.from_fmu(units.make(folder, "drive", 2, kind="CoSimulation", directional=False), PLAY)
    drive = units.make(folder, "drive", 2)
    with pytest.raises(epp.ModelError, match="drive has no output 'angel'; expected one of: angle, speed"):
        epp.from_fmu(drive, {("angel", "torque"): epp.Play(gap=0.1)})
    with pytest.raises(epp.ModelError, match="has no input 'brake'"):
        epp.from_fmu(drive, {("angle", "brake"): epp.Play(gap=0.1)})
