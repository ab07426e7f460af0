"""Stores: killed at any moment a sweep goes on where it was, loses nothing and computes nothing twice."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import xarray

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.sweep import open_sweep, sweep
from eppanalysis.sweep.analyses import NOT_RUN
from eppanalysis.sweep.store import ZarrStore, block_shape
from eppanalysis.sweep.work import Work
from tests.shared import mostly_slow

CASE = epp.case("fig8a_original").with_values({"run.t_end": "1 s"})
AXES = {"bands.range": "1:5:6:lbf", "lock_pin.backlash": "0:3:8:deg"}
PROGRAM = """
import sys
import eppanalysis as epp
from eppanalysis.sweep import sweep

if __name__ == "__main__":
    case = epp.case("fig8a_original").with_values({"run.t_end": "1 s"})
    axes = {"bands.range": "1:5:6:lbf", "lock_pin.backlash": "0:3:8:deg"}
    print("ready", flush=True)
    sweep(case, axes, store=sys.argv[1], chunk=1, scheduler=sys.argv[2], workers=2, progress=False)
"""


@pytest.fixture(scope="module")
def wanted() -> xarray.Dataset:
    return sweep(CASE, AXES, progress=False)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A store with all cells, for tests that leave it as it is."""
    path = tmp_path_factory.mktemp("finished") / "map.zarr"
    sweep(CASE, AXES, store=path, progress=False)
    return path


def done(path: Path) -> int:
    """Blocks that are marked as done; each mark is a file of its own."""
    return sum(1 for f in (path / "progress" / "done").rglob("*") if f.is_file() and f.suffix != ".partial")


@pytest.mark.parametrize("chunk", mostly_slow([1, 5, 48, 1000], [5]))
def test_a_store_holds_the_same_bits(wanted, tmp_path, chunk) -> None:
    found = sweep(CASE, AXES, store=tmp_path / "map.zarr", chunk=chunk, progress=False)
    assert wanted.identical(found.load())
    assert wanted.identical(open_sweep(tmp_path / "map.zarr").load())


def test_anyone_can_read_a_store(wanted, finished) -> None:
    found = xarray.open_zarr(finished, chunks=None, consolidated=False)
    assert found["peak_to_peak"].equals(wanted["peak_to_peak"])
    assert found["status"].dtype == np.int8


def test_a_finished_store_computes_nothing(finished, monkeypatch) -> None:
    monkeypatch.setattr(Work, "block", lambda *_: pytest.fail("computed again"))
    sweep(CASE, AXES, store=finished, progress=False)


def test_interrupted_between_results_and_mark(wanted, tmp_path, monkeypatch) -> None:
    """The worst moment: all numbers of a block are there but its mark is not; only this block is computed again."""
    path, computed = tmp_path / "map.zarr", []
    block, write = Work.block, ZarrStore.write

    def write_half(store, bounds, columns):
        if len(computed) == 10:
            mark, torn = store._mark, store._key(bounds)
            store._mark = lambda key: None if key == torn else mark(key)  # the end comes first
            write(store, bounds, {k: v[::-1] for k, v in columns.items()})  # what a torn write leaves is wrong
            raise KeyboardInterrupt
        write(store, bounds, columns)

    def counted(work, bounds):
        computed.append(tuple(bounds))
        return block(work, bounds)

    monkeypatch.setattr(Work, "block", counted)
    monkeypatch.setattr(ZarrStore, "write", write_half)
    with pytest.raises(KeyboardInterrupt):
        sweep(CASE, AXES, store=path, chunk=1, workers=1, progress=False)
    assert done(path) == 9
    assert int(np.sum(open_sweep(path)["status"].values == NOT_RUN)) == 48 - 9
    monkeypatch.setattr(ZarrStore, "write", write)
    found = sweep(CASE, AXES, store=path, workers=1, progress=False)
    assert wanted.identical(found.load())
    assert len(computed) == 48 + 1
    assert [b for b in set(computed) if computed.count(b) > 1] == [computed[9]]


@pytest.mark.slow
def test_killed_at_random_moments(wanted, tmp_path) -> None:
    """Three times, on threads and on processes by turns: each goes on where the other was."""
    path, program = tmp_path / "map.zarr", tmp_path / "program.py"
    program.write_text(PROGRAM)
    draw = np.random.default_rng(7)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    counts = [0]
    for turn, kill in enumerate((*range(3), None)):
        scheduler = ("threads", "processes")[turn % 2]
        process = subprocess.Popen(
            [sys.executable, str(program), str(path), scheduler], env=environment, stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        if kill is not None:
            # Wait for a random number of further blocks, then for a random part of the next one.
            goal, end = counts[-1] + int(draw.integers(0, 14)), time.monotonic() + 60
            while (not path.exists() or done(path) < goal) and process.poll() is None and time.monotonic() < end:
                time.sleep(0.002)
            time.sleep(float(draw.uniform(0, 0.05)))
            process.send_signal(signal.SIGKILL)
        code = process.wait(timeout=120)
        process.stdout.close()
        counts.append(done(path) if path.exists() else 0)
        assert code == (0 if kill is None else code)
    assert counts == sorted(counts)
    assert counts[-1] == 48
    assert wanted.identical(open_sweep(path).load())
    assert not list(path.rglob("*.partial"))
    assert [p.name for p in tmp_path.iterdir() if p.name.endswith(".part")] == []


@pytest.mark.slow
def test_workers_of_a_cluster_killed_at_random_moments_lose_no_cell(wanted, tmp_path) -> None:
    """A cluster of several worker processes that are killed in turn, all of them at least once."""
    import threading

    from distributed import LocalCluster

    path = tmp_path / "map.zarr"
    killed: list[int] = []
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:

        def kill_one(place: int, pause: float) -> None:
            """One worker, or its successor where it has just gone by itself."""
            end = time.monotonic() + 60
            while time.monotonic() < end:
                pids = [nanny.pid for nanny in cluster.workers.values() if nanny.pid]
                time.sleep(pause)
                with suppress(ProcessLookupError, IndexError):
                    os.kill(pids[place], signal.SIGKILL)
                    killed.append(pids[place])
                    return

        def kill() -> None:
            draw = np.random.default_rng(3)
            for turn, goal in enumerate(np.sort(draw.integers(1, 36, 2))):
                end = time.monotonic() + 60
                while (not path.exists() or done(path) < goal) and time.monotonic() < end:
                    time.sleep(0.005)
                for place in range(2 if turn == 1 else 1):
                    kill_one(place, float(draw.uniform(0, 0.03)))

        thread = threading.Thread(target=kill)
        thread.start()
        found = sweep(CASE, AXES, store=path, chunk=1, scheduler=cluster.scheduler_address, progress=False)
        thread.join()
    assert len(killed) >= 3
    assert wanted.identical(found.load())


@pytest.mark.slow
def test_processes_give_the_same_bits(wanted) -> None:
    assert wanted.identical(sweep(CASE, AXES, scheduler="processes", workers=2, chunk=10, progress=False))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"axes": AXES | {"bands.range": "1:5:6:N"}}, "other axes (bands.range)"),
        ({"axes": {"bands.range": "1:5:6:lbf"}}, "other axes (lock_pin.backlash)"),
        ({"case": CASE.with_values({"forearm.inertia": 0.04})}, "another case"),
        ({"case": CASE.with_values({"run.t_end": 2.0})}, "another case"),
        ({"run": "predict"}, "another run (simulate)"),
        ({"signals": "all"}, "other variables"),
        ({"resume": False}, "results already"),
    ],
)
def test_another_sweep_is_refused_and_nothing_is_lost(wanted, finished, change, words) -> None:
    arguments = {"case": CASE, "axes": AXES, "store": finished, "progress": False} | change
    with pytest.raises(EppError) as caught:
        sweep(**arguments)
    assert words in str(caught.value)
    assert str(finished) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert wanted.identical(open_sweep(finished).load())


def test_a_folder_that_is_something_else_is_left_alone(tmp_path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(EppError, match=r"is no store of a sweep"):
        sweep(CASE, AXES, store=tmp_path, progress=False)
    with pytest.raises(EppError, match=r"is no store of a sweep"):
        sweep(CASE, AXES, store=tmp_path / "notes.txt", progress=False)
    with pytest.raises(EppError, match=r"is no store of a sweep"):
        open_sweep(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_an_empty_folder_is_a_place_to_write_to(wanted, tmp_path) -> None:
    (tmp_path / "map.zarr").mkdir()
    assert wanted.identical(sweep(CASE, AXES, store=tmp_path / "map.zarr", progress=False).load())


def test_a_read_only_place_is_one_sentence() -> None:
    with pytest.raises(EppError, match=r"cannot be written .*expected a place to write to"):
        sweep(CASE, AXES, store="/proc/map.zarr", progress=False)


def test_the_next_block_is_computed_while_one_is_written(wanted, tmp_path, monkeypatch) -> None:
    """Writing waits until the block after it has begun, or two seconds in vain."""
    import zarr.storage._local as local

    path, put, block, begun, in_time = tmp_path / "map.zarr", local._put, Work.block, [], []
    second = threading.Event()

    def computed(work, bounds):
        begun.append(bounds)
        if len(begun) == 2:
            second.set()
        return block(work, bounds)

    def put_late(*arguments, **more):
        if begun:
            in_time.append(second.wait(2.0))
        return put(*arguments, **more)

    monkeypatch.setattr(Work, "block", computed)
    monkeypatch.setattr(local, "_put", put_late)
    assert wanted.identical(sweep(CASE, AXES, store=path, chunk=12, workers=1, progress=False).load())
    assert all(in_time)


def test_a_full_disk_loses_nothing(wanted, tmp_path, monkeypatch) -> None:
    import zarr.storage._local as local

    path, put, room = tmp_path / "map.zarr", local._put, [200]

    def put_while_there_is_room(*arguments, **more):
        room[0] -= 1
        if room[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return put(*arguments, **more)

    monkeypatch.setattr(local, "_put", put_while_there_is_room)
    with pytest.raises(EppError, match="No space left on device"):
        sweep(CASE, AXES, store=path, chunk=1, progress=False)
    kept = done(path)
    assert 0 < kept < 48
    room[0] = 10**9
    assert wanted.identical(sweep(CASE, AXES, store=path, progress=False).load())


@pytest.mark.parametrize(
    ("shape", "chunk"), [((100, 100), 100), ((7,), 3), ((1, 1000), 64), ((3, 5, 7), 1), ((2, 2), 99)]
)
def test_blocks_are_no_larger_than_asked_for(shape, chunk) -> None:
    blocks = block_shape(shape, chunk)
    assert len(blocks) == len(shape)
    assert 1 <= np.prod(blocks) <= chunk


def test_a_sweep_of_another_signal_is_another_sweep(tmp_path) -> None:
    """Variables are named alike for whatever signal is the main one."""
    axes = {"lock_pin.backlash": "1:3:2:deg"}
    sweep(CASE, axes, store=tmp_path / "map.zarr", signals="theta", progress=False)
    with pytest.raises(EppError, match=r"holds a sweep with other signals \(theta\)"):
        sweep(CASE, axes, store=tmp_path / "map.zarr", signals="sensor_force", progress=False)


def answer(act: Callable[[], xarray.Dataset]) -> xarray.Dataset | str:
    """The numbers, or one sentence; anything else is let through, and is a fault."""
    try:
        return act().load()
    except EppError as error:
        assert "\n" not in str(error)
        return str(error)


def same_or_not_run(read: xarray.Dataset, wanted: xarray.Dataset) -> bool:
    """Whether every cell is as it was, or has nothing at all."""
    ran = (read["status"] != NOT_RUN).values
    same = read.attrs == wanted.attrs and read[list(read.coords)].identical(wanted[list(wanted.coords)])
    for name, values in wanted.items():
        texts = [list(map(repr, found.values[ran])) for found in (read[name], values)]  # NaN is not NaN
        same &= read[name].attrs == values.attrs and texts[0] == texts[1]
    return same


def some_damage(draw: np.random.Generator, path: Path) -> str:
    """A file of a store is flipped in a bit, cut, lengthened, emptied or removed, or gets what another one holds."""
    files = sorted(p for p in path.rglob("*") if p.is_file())
    victim = files[draw.integers(len(files))]
    content = victim.read_bytes()
    kind = ("flip", "cut", "lengthen", "empty", "remove", "swap", "copy", "folder")[draw.integers(8)]
    if kind == "flip" and content:
        place = int(draw.integers(len(content)))
        changed = content[place] ^ (1 << int(draw.integers(8)))
        victim.write_bytes(content[:place] + bytes([changed]) + content[place + 1 :])
    elif kind == "cut":
        victim.write_bytes(content[: int(draw.integers(len(content) + 1))])
    elif kind == "lengthen":
        victim.write_bytes(content + draw.bytes(5))
    elif kind == "empty":
        victim.write_bytes(b"")
    elif kind == "remove":
        victim.unlink()
    elif kind in ("swap", "copy"):
        other = files[draw.integers(len(files))]
        others = other.read_bytes()
        victim.write_bytes(others)
        if kind == "swap":
            other.write_bytes(content)
    elif kind == "folder" and victim.parent != path:
        shutil.rmtree(victim.parent)
    return f"{kind} {victim.relative_to(path)}"


@pytest.mark.parametrize(
    ("share", "times"), [(0, 12), *(pytest.param(share, 40, marks=pytest.mark.slow) for share in (1, 2))]
)
def test_what_is_damaged_is_computed_again_or_said_and_never_read(tmp_path, share, times) -> None:
    """Damage at random to a finished store: it holds every cell as it was, as not run, or it says what is damaged."""
    axes = {"lock_pin.backlash": ["1 deg", "2.5 deg", "-1 deg", "3 deg"]}
    case = CASE.with_values({"run.t_end": "0.1 s"})
    whole, path = tmp_path / "whole.zarr", tmp_path / "map.zarr"
    wanted = sweep(case, axes, store=whole, chunk=2, progress=False).load()
    assert np.any(wanted["message"].values != "") and np.any(wanted["message"].values == "")
    draw, mended = np.random.default_rng([5, share]), 0
    for _ in range(times):
        shutil.copytree(whole, path)
        what = some_damage(draw, path)
        read = answer(lambda: open_sweep(path))
        if isinstance(read, xarray.Dataset):
            assert same_or_not_run(read, wanted), what
        again = answer(lambda: sweep(case, axes, store=path, chunk=2, progress=False))
        if isinstance(again, xarray.Dataset):
            assert wanted.identical(again), what
            mended += 1
        shutil.rmtree(path)
    assert mended > 0.75 * times


def test_numbers_that_are_damaged_after_opening_are_refused_as_they_are_read(tmp_path) -> None:
    path = tmp_path / "map.zarr"
    found = sweep(CASE, {"lock_pin.backlash": "1:3:4:deg"}, store=path, chunk=2, progress=False)
    (path / "peak_to_peak" / "c" / "1").unlink()
    with pytest.raises(EppError, match=r"peak_to_peak/c/1 is damaged; the same command computes the damaged parts"):
        found["peak_to_peak"].load()
    assert np.any(np.isfinite(found["peak_to_peak"][:2]))


def test_any_reader_of_zarr_hears_of_a_flipped_bit(tmp_path) -> None:
    path = tmp_path / "map.zarr"
    sweep(CASE, {"lock_pin.backlash": "1:3:4:deg"}, store=path, chunk=2, progress=False)
    chunk = path / "peak_to_peak" / "c" / "0"
    content = chunk.read_bytes()
    chunk.write_bytes(content[:-5] + bytes([content[-5] ^ 1]) + content[-4:])
    with pytest.raises(ValueError, match="checksum"):
        xarray.open_zarr(path, chunks=None, consolidated=False)["peak_to_peak"].load()


def test_blocks_of_another_sweep_are_not_taken_for_its_own(tmp_path) -> None:
    """Whole blocks with their marks, from a store that differs in one value of the case."""
    one, other = tmp_path / "one.zarr", tmp_path / "other.zarr"
    axes = {"lock_pin.backlash": "1:3:4:deg"}
    wanted = sweep(CASE, axes, store=one, chunk=2, progress=False).load()
    sweep(CASE.with_values({"forearm.inertia": 0.05}), axes, store=other, chunk=2, progress=False)
    for name in (*wanted.data_vars, "progress/done"):
        block = f"{name}/1" if name == "progress/done" else f"{name}/c/1"
        (one / str(block)).unlink(missing_ok=True)
        if (other / str(block)).exists():
            shutil.copy(other / str(block), one / str(block))
    assert "damaged" in str(answer(lambda: open_sweep(one)))
    assert wanted.identical(sweep(CASE, axes, store=one, progress=False).load())


@pytest.mark.parametrize("axes", [{"lock_pin.backlash": "1:3:4:deg"}, AXES, {"bands.range": "9:10:100:lbf"}])
def test_a_store_that_lost_its_sheet_is_left_to_the_sweep_that_made_it(tmp_path, axes) -> None:
    """Its blocks show whose it is."""
    path, made = tmp_path / "map.zarr", {"pulley.friction": "0:0.05:2", "lock_pin.backlash": "1:3:3:deg"}
    wanted = sweep(CASE, made, store=path, chunk=2, progress=False).load()
    (path / "progress" / "sweep.json").write_text("{}")
    with pytest.raises(EppError, match=r"no block shows whose results these are; expected another name"):
        sweep(CASE, axes, store=path, chunk=2, progress=False)
    with pytest.raises(EppError, match=r"sweep\.json is damaged; the same command computes"):
        open_sweep(path)
    assert wanted.identical(sweep(CASE, made, store=path, chunk=2, progress=False).load())


@pytest.mark.parametrize("path", [None, 5, b"map.zarr", ["map.zarr"], "", "none", "/dev/null"])
def test_what_is_no_store_is_one_sentence(path, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EppError, match="expected"):
        open_sweep(path)


def test_what_was_damaged_is_said_once(tmp_path, capsys) -> None:
    path, axes = tmp_path / "map.zarr", {"lock_pin.backlash": "1:3:4:deg"}
    sweep(CASE, axes, store=path, chunk=2)
    (path / "events" / "c" / "1").write_bytes(b"")
    capsys.readouterr()
    sweep(CASE, axes, store=path)
    assert capsys.readouterr().err.replace("\n", "") == f"{path}: 1 block damaged since stored, computed again."
    sweep(CASE, axes, store=path)
    assert capsys.readouterr().err == ""


def test_a_mark_is_written_after_its_numbers_are_on_the_disk(tmp_path, monkeypatch) -> None:
    """Whatever the system has not brought to the disk when the power goes is not marked as done."""
    path, synced, early = tmp_path / "map.zarr", set(), []
    fsync, replace = os.fsync, Path.replace

    def watched_sync(file):
        synced.add(os.fstat(file).st_ino)
        fsync(file)

    def watched_replace(part, target):
        place = Path(target)
        if "done" in place.parts:
            early.extend(f for f in (*path.glob(f"*/c/{place.name}"), part) if f.stat().st_ino not in synced)
        return replace(part, target)

    monkeypatch.setattr(os, "fsync", watched_sync)
    monkeypatch.setattr(Path, "replace", watched_replace)
    sweep(CASE, {"lock_pin.backlash": "1:3:4:deg"}, store=path, chunk=2, progress=False)
    assert done(path) == 2 and len(synced) > 20 and not early


@pytest.mark.slow
def test_processes_that_start_at_once_leave_a_store_that_is_whole(wanted, tmp_path) -> None:
    """Each has the store or one sentence, and the same sweep goes on from there; a killed one leaves no lock."""
    program = tmp_path / "program.py"
    program.write_text(
        PROGRAM.replace('print("ready", flush=True)', "sys.stdin.read()").replace(
            "progress=False)", "progress=False)\n    print(sys.argv[1])"
        )
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    path = tmp_path / "map.zarr"
    started = [
        subprocess.Popen(
            [sys.executable, str(program), str(path), "threads"],
            env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for _ in range(2)
    ]  # fmt: skip
    for process in started:
        assert process.stdin is not None
        process.stdin.close()
        process.stdin = None
    ended = [(process.communicate(timeout=120), process.returncode) for process in started]
    assert any(code == 0 for _, code in ended)
    for (_, said), code in ended:
        assert code == 0 or "EppError: " + str(path) in said.splitlines()[-1]
        assert code == 0 or "another process is writing to this store" in said
    assert wanted.identical(sweep(CASE, AXES, store=path, progress=False).load())
    assert [p.name for p in tmp_path.iterdir() if p.name not in ("map.zarr", "program.py")] == []
