"""A disk that is full, and one that is read-only, for real: a small file system in memory. Needs the right to mount."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.sweep import open_sweep, sweep
from eppanalysis.sweep.analyses import NOT_RUN

CASE = epp.case("fig8a_original").with_values({"run.t_end": "0.3 s"})
AXES = {"bands.range": "1:5:6:lbf", "lock_pin.backlash": "0:3:8:deg"}
Remount = Callable[[str], None]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not sys.platform.startswith("linux") or os.geteuid() != 0 or shutil.which("mount") is None,
        reason="only the administrator of a Linux machine may mount",
    ),
]


def call(*arguments: str) -> bool:
    return subprocess.run(arguments, check=False, capture_output=True).returncode == 0


@pytest.fixture
def disk(tmp_path) -> Iterator[tuple[Path, Remount]]:
    """A disk of 800 kB, and how to change it."""
    place = tmp_path / "disk"
    place.mkdir()
    if not call("mount", "-t", "tmpfs", "-o", "size=800k", "tmpfs", str(place)):
        pytest.skip("mounting is not allowed here")

    def remount(options: str) -> None:
        """Another thread may be writing just then, which Linux refuses as busy."""
        for _ in range(200):
            if call("mount", "-o", f"remount,{options}", str(place)):
                return
            time.sleep(0.01)
        raise AssertionError(f"the disk could not be mounted anew with {options}")

    yield place, remount
    assert call("umount", str(place))


def one_sentence(store: Path, scheduler: str = "threads") -> str:
    with pytest.raises(EppError) as caught:
        sweep(CASE, AXES, store=store, chunk=1, scheduler=scheduler, workers=2, progress=False)
    text = str(caught.value)
    assert "\n" not in text and text.startswith(str(store)) and "expected a place to write to" in text
    return text


@pytest.mark.parametrize("scheduler", ["threads", "processes"])
def test_a_full_disk_keeps_what_is_there_and_goes_on_with_more_room(disk, scheduler) -> None:
    place, remount = disk
    store = place / "map.zarr"
    wanted = sweep(CASE, AXES, progress=False)
    assert "No space left on device" in one_sentence(store, scheduler)
    left = np.asarray(open_sweep(store)["status"].values == NOT_RUN)
    assert 0 < left.sum() < left.size
    kept = open_sweep(store)["events"].values[~left]
    assert np.array_equal(kept, wanted["events"].values[~left])
    remount("size=20m")
    assert wanted.identical(sweep(CASE, AXES, store=store, progress=False).load())


def test_a_disk_that_is_full_from_the_start_is_left_as_it_is(disk) -> None:
    place, _ = disk
    (place / "other").write_bytes(b"x" * (800 * 1024 - 8192))
    assert "No space left on device" in one_sentence(place / "map.zarr")
    assert [p.name for p in place.iterdir()] == ["other"]


def test_a_read_only_disk_can_be_read(disk) -> None:
    place, remount = disk
    remount("size=20m")
    wanted = sweep(CASE, AXES, store=place / "map.zarr", progress=False).load()
    remount("ro")
    assert "Read-only file system" in one_sentence(place / "other.zarr")
    assert wanted.identical(open_sweep(place / "map.zarr").load())
    assert wanted.identical(sweep(CASE, AXES, store=place / "map.zarr", progress=False).load())
    remount("rw")


def test_a_disk_that_turns_read_only_in_mid_run(disk, monkeypatch) -> None:
    from eppanalysis.sweep.store import ZarrStore

    place, remount = disk
    remount("size=20m")
    write, count = ZarrStore.write, []

    def write_some(store, bounds, columns):
        count.append(bounds)
        if len(count) == 10:
            store._lock.release()  # by hand Linux mounts no disk anew on which the lock is open; after an error it does
            remount("ro")
        write(store, bounds, columns)

    monkeypatch.setattr(ZarrStore, "write", write_some)
    assert "Read-only file system" in one_sentence(place / "map.zarr")
    remount("rw")
    monkeypatch.setattr(ZarrStore, "write", write)
    wanted = sweep(CASE, AXES, progress=False)
    assert wanted.identical(sweep(CASE, AXES, store=place / "map.zarr", progress=False).load())
