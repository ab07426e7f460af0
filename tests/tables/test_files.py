"""Files: complete or absent, readable by others, and nothing in a table runs."""

from __future__ import annotations

import csv
import importlib.util

import numpy as np
import pytest
import xarray

from eppanalysis.errors import EppError
from eppanalysis.tables import files as export
from tests.shared import mostly_slow
from tests.synthetic import cycle, prediction, trajectory

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.mark.parametrize("suffix", sorted(MAGIC))
def test_pictures_have_the_format_of_their_suffix(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    export.write_result(trajectory(), export.trajectory_table, path)
    assert path.read_bytes().startswith(MAGIC[suffix])
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", mostly_slow([".svg", ".pdf"], [".svg"]))
def test_equal_results_give_equal_pictures(tmp_path, suffix):
    paths = [tmp_path / f"{i}{suffix}" for i in range(2)]
    for path in paths:
        export.write_result(prediction(), export.prediction_table, path)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_csv_holds_every_digit(tmp_path):
    run, path = trajectory(), tmp_path / "run.csv"
    export.write_result(run, export.trajectory_table, path)
    with path.open(newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == ["time [s]", "theta [rad]", "voltage [V]"]
    np.testing.assert_array_equal(np.array(rows, float)[:, 1], run.signals["theta"])


def test_netcdf_of_a_run_is_its_dataset(tmp_path):
    run, path = trajectory(), tmp_path / "run.nc"
    export.write_result(run, export.trajectory_table, path)
    with xarray.open_dataset(path) as dataset:
        np.testing.assert_array_equal(dataset["theta"], run.signals["theta"])
        assert dataset["theta"].attrs["units"] == "rad"


@pytest.mark.parametrize("missing", ["h5netcdf", "h5py"])
def test_netcdf_without_an_hdf5_library_is_of_version_3(tmp_path, monkeypatch, missing):
    """h5netcdf may be there without the h5py that it needs."""
    there = importlib.util.find_spec
    away = {missing, "netCDF4"}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in away else there(name))
    path = tmp_path / "run.nc"
    export.write_dataset(trajectory().to_dataset(), path)
    assert path.read_bytes()[:3] == b"CDF"


def test_netcdf_of_a_prediction_has_one_row_a_cycle(tmp_path):
    path = tmp_path / "cycles.nc"
    export.write_result(prediction(), export.prediction_table, path)
    with xarray.open_dataset(path) as dataset:
        np.testing.assert_array_equal(dataset["stable"], [0.0, 1.0])
        np.testing.assert_allclose(dataset["fundamental amplitude theta"], [1.0606, 3.0012])
        assert dataset["frequency"].attrs["units"] == "Hz"


def test_tables_of_several_cases_are_joined_with_the_name_of_the_case():
    joined = export.join([("a", export.cycle_table([cycle()])), ("b", export.Table({"x": [1.0]}))])
    assert list(joined.columns["case"]) == ["a", "b"]
    assert joined.columns["x"] == [None, 1.0]


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1"])
def test_a_text_that_looks_like_a_formula_stays_a_text(tmp_path, text):
    path = tmp_path / "table.csv"
    export.write_table(export.Table({text: [text, -1.0]}), path)
    with path.open(newline="") as stream:
        assert list(csv.reader(stream)) == [["'" + text], ["'" + text], ["-1.0"]]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("run.docx", "cannot write a file that ends in '.docx'"),
        ("run", "its name has no ending; expected one of .png"),
        ("missing/run.png", "does not exist"),
        ("folder.png", "is a folder"),
    ],
)
def test_targets_that_cannot_be_written_are_refused_at_once(tmp_path, name, sentence):
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(EppError, match=sentence):
        export.check_target(tmp_path / name)


class Interrupted:
    """A result whose picture is interrupted half way."""

    def plot(self):
        return self

    def savefig(self, stream, **_):
        stream.write(b"half")
        raise KeyboardInterrupt


def test_an_interrupted_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "run.png"
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt):
        export.write_result(Interrupted(), export.trajectory_table, path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["run.png"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("real.csv")
    export.write_table(export.Table({"x": [1.0]}), tmp_path / "link.csv")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real.csv").read_text().startswith("x")


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("  =1+1", "'  =1+1"),
        ("＝1+1", "'＝1+1"),
        ("harmless;=cmd|' /C calc'!A0", "harmless;'=cmd|' /C calc'!A0"),
        ("two lines\n@SUM(A1)", "two lines\n'@SUM(A1)"),
        ("at 1.4 N*m: 1.4 * 164/(164 - 143)", "at 1.4 N*m: 1.4 * 164/(164 - 143)"),
    ],
)
def test_formulas_behind_blanks_and_separators_are_texts_too(tmp_path, text, cell):
    path = tmp_path / "table.csv"
    export.write_table(export.Table({"note": [text]}), path)
    with path.open(newline="") as stream:
        assert list(csv.reader(stream)) == [["note"], [cell]]
