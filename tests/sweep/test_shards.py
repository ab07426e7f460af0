"""Shares of a sweep: computed apart, joined to the same bits; what is missing, damaged or of another sweep is said."""

from __future__ import annotations

import pytest
import xarray
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.cli.sweep import INCOMPLETE
from eppanalysis.errors import EppError
from eppanalysis.sweep import sweep
from eppanalysis.sweep.analyses import NOT_RUN
from tests.shared import mostly_slow

CASE = epp.case("fig8a_original").with_values({"run.t_end": "1 s"})
AXES = {"bands.range": "1:5:6:lbf", "lock_pin.backlash": "0:3:8:deg"}


@pytest.fixture(scope="module")
def wanted() -> xarray.Dataset:
    return sweep(CASE, AXES, progress=False)


def share(store, shard, axes=AXES, **options) -> xarray.Dataset:
    return sweep(CASE, axes, store=store, shard=shard, progress=False, **options)


def join(store, chunk=4) -> xarray.Dataset:
    return sweep(CASE, AXES, store=store, merge=True, chunk=chunk, progress=False)


@pytest.mark.parametrize(("count", "chunk"), mostly_slow([(1, 4), (3, 5), (4, 1)], [(3, 5)]))
def test_shares_joined_are_the_sweep_to_the_bit(wanted, tmp_path, count, chunk) -> None:
    cells = 0
    for number in range(1, count + 1):
        found = share(tmp_path / "map.zarr", (number, count), chunk=chunk)
        cells += int((found["status"] != NOT_RUN).sum())
    assert cells == wanted["status"].size
    assert wanted.identical(join(tmp_path / "map.zarr", chunk).load())


def test_what_is_not_finished_is_joined_later(wanted, tmp_path) -> None:
    store = tmp_path / "map.zarr"
    share(store, "2/2", chunk=4)
    part = join(store).load()
    there = part["status"] != NOT_RUN
    assert 0 < int(there.sum()) < there.size
    assert part["peak_to_peak"].where(there, drop=False).equals(wanted["peak_to_peak"].where(there))
    share(store, "1/2", chunk=4)
    assert wanted.identical(join(store).load())


def test_a_share_that_was_damaged_is_not_taken_over(tmp_path) -> None:
    store = tmp_path / "map.zarr"
    share(store, "1/1", chunk=4)
    file = next(f for f in sorted((tmp_path / "map.1-of-1.zarr" / "peak_to_peak" / "c").rglob("*")) if f.is_file())
    file.write_bytes(file.read_bytes()[:-1] + b"?")
    assert int((join(store)["status"] == NOT_RUN).sum()) == 4


def test_a_share_of_another_sweep_is_refused(tmp_path) -> None:
    share(tmp_path / "map.zarr", "1/2", {"bands.range": "1:5:6:lbf"})
    with pytest.raises(EppError, match=r"map\.1-of-2\.zarr: holds another sweep.*expected a share of"):
        join(tmp_path / "map.zarr")


def test_a_share_in_other_blocks_is_refused(tmp_path) -> None:
    share(tmp_path / "map.zarr", "1/2", chunk=3)
    with pytest.raises(EppError, match="blocks of another size"):
        join(tmp_path / "map.zarr")


@pytest.mark.parametrize("shard", ["0/2", "3/2", "1", "a/b", (1,), (2.5, 3), 7])
def test_a_share_that_is_none_is_refused(tmp_path, shard) -> None:
    with pytest.raises(EppError, match=r"shard is .*expected one of so many, as in '3/8'"):
        share(tmp_path / "map.zarr", shard)


def test_shares_need_a_store_and_joining_needs_shares(tmp_path) -> None:
    with pytest.raises(EppError, match="shard is given without a store"):
        share(None, "1/2")
    with pytest.raises(EppError, match="has no shares beside it"):
        join(tmp_path / "map.zarr")
    with pytest.raises(EppError, match="merge is given beside shard '1/2'"):
        share(tmp_path / "map.zarr", "1/2", merge=True)


@pytest.mark.slow
def test_the_command_says_by_its_exit_code_that_shares_are_missing(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["sweep", "fig8a_original", "--set", "run.t_end=1 s", "--axis", "bands.range=1:5:8:lbf", "-o", "map.zarr"]
    run = CliRunner().invoke
    assert run(app, [*command, "--shard", "1/2"]).exit_code == 0
    assert run(app, [*command, "--merge"]).exit_code == INCOMPLETE
    assert run(app, [*command, "--shard", "2/2"]).exit_code == 0
    assert run(app, [*command, "--merge"]).exit_code == 0
