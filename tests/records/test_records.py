"""What files have beside their numbers: several times, units, names, objects of MATLAB; and what none may do."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.diagnose.record import record_of
from eppanalysis.records.columns import parse_choice
from eppanalysis.records.reading import read_recording
from tests.records import writers

T = np.linspace(0.0, 30.0, 1201)
X = np.sin(0.9 * T)
UNITS = {"theta": "rad", "rate": "rad/s"}


def said(*arguments: object) -> tuple[int, str]:
    ran = CliRunner().invoke(app, [*map(str, arguments)])
    assert ran.exception is None or isinstance(ran.exception, SystemExit), ran.exception
    return ran.exit_code, " ".join(ran.output.split())


@pytest.mark.slow
def test_signals_of_other_times_are_interpolated_and_said_to_be(tmp_path):
    pytest.importorskip("asammdf")
    from asammdf import MDF, Signal

    slow = np.linspace(-1.0, 29.0, 301)
    with MDF(version="4.10") as made:
        made.append(Signal(np.degrees(X), T, name="theta", unit="deg"), acq_name="fast")
        made.append(Signal(2.0 * slow, slow, name="rate", unit="rad/s"), acq_name="slow")
        made.save(tmp_path / "two.mf4")
    found = record_of(tmp_path / "two.mf4", UNITS)
    # A straight line is what interpolation leaves as it is; outside of its times there is none.
    assert found.time[0] == 0.0 and found.time[-1] == pytest.approx(29.0)
    assert np.allclose(found.signals["rate"], 2.0 * found.time) and np.allclose(
        found.signals["theta"], X[: len(found.time)]
    )
    assert found.notes == (
        "theta is fast.theta.", "rate is slow.rate.",
        "slow.rate is interpolated linearly at the times of fast.theta.",
    )  # fmt: skip
    named = record_of(tmp_path / "two.mf4", UNITS, {"rate": ("slow.rate", ""), "theta": ("fast.theta", "")})
    np.testing.assert_allclose(named.time, slow[slow >= 0.0], atol=1e-12)
    assert named.notes[-1] == "fast.theta is interpolated linearly at the times of slow.rate."


@pytest.mark.slow
def test_a_formula_of_a_file_is_not_evaluated(tmp_path):
    pytest.importorskip("asammdf")
    from asammdf import MDF, Signal

    with MDF(version="4.10") as made:
        made.append(Signal(X, T, name="theta", unit="rad", conversion={"formula": "X * 2"}))
        made.save(tmp_path / "formula.mf4")
    with pytest.raises(epp.CaseError, match="given by a formula or a table"):
        record_of(tmp_path / "formula.mf4", UNITS)


@pytest.mark.slow
def test_no_name_of_a_bag_becomes_code(tmp_path, monkeypatch):
    """rosbags makes Python classes of the types of messages, which are called whatever the file says."""
    pytest.importorskip("rosbags")
    file = writers.mcap(tmp_path / "bag.mcap", T, X, X)

    def refused(*_: object) -> None:
        raise AssertionError("code was made of a file")

    monkeypatch.setattr("rosbags.typesys.store.generate_python_code", refused)
    monkeypatch.setattr("rosbags.serde.utils.compile_lines", refused)
    assert np.allclose(record_of(file, {"twist": ""}).signals["twist"], X)


def test_times_and_units_of_a_frame_are_its_own():
    import pandas as pd

    frame = pd.DataFrame({"theta [deg]": np.degrees(X), "rate": 60.0 * X / (2.0 * np.pi), "note": "good"})
    frame.attrs["units"] = {"rate": "rpm"}
    for index, unit in ((pd.Index(T, name="time"), "s"), (pd.to_timedelta(T, "s"), "s"), (1e3 * T, "ms")):
        given = frame.assign(**{"Time [ms]": index}) if unit == "ms" else frame.set_index(index)
        found = record_of(given, UNITS)
        assert np.allclose(found.time, T, atol=1e-9)
        assert np.allclose(found.signals["theta"], X) and np.allclose(found.signals["rate"], X)


def test_holes_of_a_frame_are_left_out_and_counted():
    import pandas as pd

    frame = pd.DataFrame({"time": T, "theta": np.where(T[7] == T, np.nan, X)})
    found = record_of(frame, UNITS)
    assert len(found.time) == 1200 and found.notes == ("1 of 1201 rows has an empty cell and was left out.",)


def test_an_array_of_xarray_has_a_column_for_each_label():
    import xarray as xr

    given = xr.DataArray(np.stack([X, 2.0 * X]), {"channel": ["theta", "rate"], "time": T}, ("channel", "time"))
    found = record_of(given, UNITS)
    assert np.array_equal(found.signals["theta"], X) and np.array_equal(found.signals["rate"], 2.0 * X)
    with pytest.raises(epp.CaseError, match="expected one 'time'"):
        record_of(given.rename(time="t"), UNITS)


def test_a_table_without_the_signals_lists_the_nearest_names():
    given = {"time": T, **{f"channel_{i}": X for i in range(300)}, "imu.pich": X}
    with pytest.raises(epp.CaseError) as caught:
        record_of(given, {"pitch": "rad"})
    assert "is '302 columns'; expected" in str(caught.value) and "; the nearest are imu.pich, " in str(caught.value)
    assert len(str(caught.value)) < 400


def test_a_name_within_a_topic_counts_where_it_is_unique():
    given = {"time": T, "imu.theta": X, "imu.rate": X, "gyro.rate": X}
    found = record_of(given, UNITS)
    assert [*found.signals] == ["theta"] and found.notes[0] == "theta is imu.theta."
    assert [*record_of(given, UNITS, {"rate": ("gyro.rate", "")}).signals] == ["rate"]
    with pytest.raises(epp.CaseError, match="'imu.rate' and 'gyro.rate' at once"):
        record_of(given, UNITS, {"rate": ("rate", "")})


@pytest.mark.parametrize(
    ("text", "roles", "found"),
    [
        ("theta=vehicle_attitude.pitch", ("theta", "rate"), ("theta", "vehicle_attitude.pitch", "")),
        ("pitch_rate", ("pitch_rate", "theta"), ("pitch_rate", "pitch_rate", "")),
        ("vehicle_attitude.q[0]", ("theta",), ("theta", "vehicle_attitude.q[0]", "")),
        ("F (lbf):lbf", ("force",), ("force", "F (lbf)", "lbf")),
    ],
)
def test_a_signal_is_chosen_by_name(text, roles, found):
    assert parse_choice(text, {"time": "s", **dict.fromkeys(roles, "rad")}) == found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Parquet", "ULog", "MCAP", "MF4", "MAT 7.3"])
def test_a_missing_library_is_one_sentence(name, tmp_path, monkeypatch):
    ending, write, _ = writers.FORMATS[name]
    file = write(tmp_path / f"record.{ending}", T, X, X)
    for module in ("pyarrow", "pyulog", "rosbags", "asammdf", "h5py"):
        for loaded in [m for m in sys.modules if m.partition(".")[0] == module]:
            monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setattr("eppanalysis.errors.util.find_spec", lambda _: None)
    with pytest.raises(epp.EppError, match=r"pip install 'eppanalysis\[records\]'"):
        record_of(file, UNITS)


def _saved(path: Path, structure: dict[str, Any], version: str) -> Path:
    """As ``to_eppanalysis.m`` writes it."""
    if version == "5":
        from scipy.io import savemat

        savemat(path, {"eppanalysis": structure})
        return path
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        made = file.create_group("eppanalysis")
        for name, value in structure.items():
            if isinstance(value, str):
                made[name] = np.array([[ord(c)] for c in value], np.uint16)
                made[name].attrs["MATLAB_class"] = np.bytes_("char")
            elif np.iscomplexobj(value):
                pairs = np.empty(value.T.shape, [("real", float), ("imag", float)])
                pairs["real"], pairs["imag"] = value.T.real, value.T.imag
                made[name] = pairs
            else:
                made[name] = np.atleast_2d(np.asarray(value, float)).T
    return path


VERSIONS = ["5", pytest.param("7.3", marks=pytest.mark.slow)]


@pytest.mark.parametrize("version", VERSIONS)
def test_a_frequency_response_of_matlab(tmp_path, version):
    omega = np.geomspace(1.0, 50.0, 40)
    lag, slow = 2.0 / (1.0 + 0.3j * omega), 5.0 / (1.0 + 2.0j * omega)
    frd = {"kind": "frd", "frequency": omega[:, None], "response": lag[None, None, :]}
    found = epp.read_response(_saved(tmp_path / "one.mat", frd, version))
    assert np.allclose(found.omega, omega, rtol=1e-14) and np.allclose(found.value, lag, rtol=1e-14)
    both = {"kind": "frd", "frequency": omega[:, None], "response": np.stack([[lag, slow]])}
    matrix = epp.read_response(_saved(tmp_path / "two.mat", both, version))
    assert matrix.shape == (1, 2) and np.allclose(matrix.paths[0][1].value, slow, rtol=1e-14)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("step", [0.0, 0.1])
def test_linear_systems_of_matlab_are_blocks(tmp_path, version, step):
    control = pytest.importorskip("control")
    same = control.tf([2.0, 1.0], [1.0, 0.4, 3.0], step)
    tf = {"kind": "tf", "sample_time": step, "num": [[2.0, 1.0]], "den": [[1.0, 0.4, 3.0]]}
    system = control.ss(same)
    ss = {"kind": "ss", "sample_time": step, **{n: getattr(system, n) for n in "ABCD"}}
    at = np.array([0.5, 2.0, 7.0])
    want = same(np.exp(1j * at * step) if step else 1j * at)
    for structure in (tf, ss):
        block = epp.read_linear(_saved(tmp_path / "g.mat", structure, version))
        assert block.sample_time == (step or None)
        s = block.state_space()
        points = np.exp(1j * at * step) if step else 1j * at
        found = [(s.C @ np.linalg.solve(p * np.eye(len(s.A)) - s.A, s.B) + s.D).item() for p in points]
        assert np.allclose(found, want, rtol=1e-12)


@pytest.mark.parametrize(
    ("structure", "sentence"),
    [
        ({"kind": "tf", "sample_time": -1.0, "num": 1.0, "den": [1.0, 1.0]}, "sample_time is -1.0; expected zero"),
        ({"kind": "frd", "frequency": [1.0], "response": 1.0}, "without tf or ss .eppanalysis.'; expected numbers, as"),
        ({"kind": "ss", "sample_time": 0.0, "A": [1.0, 2.0], "B": 1.0, "C": 1.0, "D": 0.0}, "not readable"),
        ({"kind": "tf", "sample_time": 0.0, "num": 1.0}, "not readable .'den'"),
    ],
)
def test_what_is_no_linear_system_is_one_sentence(tmp_path, structure, sentence):
    with pytest.raises(epp.EppError, match=sentence):
        epp.read_linear(_saved(tmp_path / "g.mat", structure, "5"))


def test_an_object_of_matlab_is_one_sentence(tmp_path):
    """A timetable as MATLAB itself saves it: an element of the class "opaque", by the published layout of version 5."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    numbers = (
        element(6, struct.pack("<II", 13, 0))
        + element(5, struct.pack("<ii", 1, 1))
        + element(1, b"")
        + element(6, bytes(4))
    )
    opaque = element(6, struct.pack("<II", 17, 0)) + element(1, b"T") + element(1, b"MCOS") + element(1, b"timetable")
    file = tmp_path / "native.mat"
    file.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element(14, opaque + element(14, numbers)))
    with pytest.raises(epp.CaseError, match="an object of MATLAB'; expected numbers, as to_eppanalysis.m"):
        record_of(file, UNITS)


@pytest.mark.slow
def test_what_lies_in_another_file_is_not_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "secret.mat", "w") as file:
        file["theta"] = X[None, :]
    with h5py.File(tmp_path / "given.mat", "w") as file:
        file["time"], file["theta"] = T[None, :], h5py.ExternalLink("secret.mat", "theta")
    with pytest.raises(epp.CaseError):
        record_of(tmp_path / "given.mat", UNITS)


def test_a_recorded_input_may_be_any_format(tmp_path):
    from scipy.io import savemat

    t = np.array([0.0, 0.5, 1.0])
    savemat(tmp_path / "pull.mat", {"time": t, "harness_position": [0.0, 0.01, 0.01], "other": t})
    text = 'base = "elbow"\ntitle = "x"\n[run]\ninput = {kind = "recorded", file = "pull.mat"}\n'
    (tmp_path / "case.toml").write_text(text)
    found = epp.read_case(tmp_path / "case.toml").input
    assert found.value([0.25, 0.75]).tolist() == pytest.approx([0.005, 0.01])


@pytest.mark.slow
def test_identified_numbers_are_the_same_from_csv_and_ulog(tmp_path):
    """The friction pulley of the shipped weight tray, whose columns are written again in other formats."""
    from scipy.io import savemat

    tray = Path("cases/measured/weight_tray.csv")
    read = read_recording(tray, ("force", "voltage"), ("time",), units={"time": "s", "force": "N", "voltage": "V"})
    savemat(tmp_path / "tray.mat", {"time": read["time"], "force": read["force"], "voltage": read["voltage"]})
    log = writers.ulog(tmp_path / "tray.ulg", read["time"], read["force"], read["voltage"])
    columns = {"force": ("shaft.twist", "N"), "voltage": ("drive.torque", "V")}
    want = epp.identify(epp.case("elbow"), tray=tray)
    for given, chosen in ((tmp_path / "tray.mat", None), (log, columns)):
        found = epp.identify(epp.case("elbow"), tray=given, columns=chosen)
        assert [e.name for e in found.estimates] == [e.name for e in want.estimates]
        assert [e.value for e in found.estimates] == pytest.approx([e.value for e in want.estimates], rel=1e-6)


@pytest.mark.slow
def test_the_command_takes_a_signal_of_a_log(tmp_path):
    log = writers.ulog(tmp_path / "flight.ulg", T, X, X)
    code, output = said("diagnose", "backlash_servo", log, "--signal", "x=shaft.twist")
    assert code == 0 and "Columns that were not used" in output
    code, output = said("diagnose", "backlash_servo", log, "--signal", "x=pitch")
    assert code == 2 and "shaft.twist" in output and "expected the column 'pitch' of --signal" in output
