"""Compiled code from files: numba's tables are not read for it, and kernels that are compiled later can use it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

#: Kernels of a module, one of which calls another and makes an array.
KERNELS = """
import numpy as np
from eppanalysis.kernels import compiling

compiling.sources = lambda module: "tried"


@compiling.njit(**compiling.KERNEL)
def lengths(a, b):
    return np.sqrt(a * a + b * b)


@compiling.njit(**compiling.KERNEL)
def longest(a, b):
    return lengths(a, b).max()


@compiling.njit(**compiling.KERNEL)
def room(a, b):
    return np.zeros(int(a[0] - b[0]))
"""
CALL = """
import sys
import numpy as np
import kernels

kernel = getattr(kernels, sys.argv[1])
try:
    found = np.max(kernel(np.array([3.0, 5.0]), np.array([4.0, 12.0])))
except ValueError as error:
    found = str(error).replace(" ", "_")
hits, misses = (sum(counted.values()) for counted in (kernel.stats.cache_hits, kernel.stats.cache_misses))
print(found, hits, misses, "numba.np.arraymath" in sys.modules)
"""


def call(folder: Path, kernel: str) -> list[str]:
    """What a kernel gives in a process of its own; how often it was loaded, compiled; whether the tables were read."""
    place = {"NUMBA_CACHE_DIR": str(folder / "kept"), "PYTHONPATH": ":".join([str(folder), *sys.path])}
    done = subprocess.run([sys.executable, "-c", CALL, kernel], env=place, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.slow
def test_what_is_loaded_reads_no_tables_and_serves_kernels_that_are_compiled_later(tmp_path) -> None:
    (tmp_path / "kernels.py").write_text(KERNELS)
    assert call(tmp_path, "lengths") == ["13.0", "0", "1", "True"]
    assert call(tmp_path, "lengths") == ["13.0", "1", "0", "False"]
    assert call(tmp_path, "longest") == ["13.0", "0", "1", "True"]  # with the loaded code of the first linked in
    assert call(tmp_path, "longest") == ["13.0", "1", "0", "False"]


@pytest.mark.slow
def test_what_numba_itself_refuses_is_refused_by_loaded_code(tmp_path) -> None:
    (tmp_path / "kernels.py").write_text(KERNELS)
    refused = "negative_dimensions_not_allowed"
    assert call(tmp_path, "room") == [refused, "0", "1", "True"]
    assert call(tmp_path, "room") == [refused, "1", "0", "False"]


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    for place in range(len(content) // 3, len(content) - 16, max(1, len(content) // 40)):
        content[place] ^= 0x10
    path.write_bytes(content)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGES = {
    "cut": _cut,
    "empty": lambda path: path.write_bytes(b""),
    "bits": _flip,
    "something else": lambda path: path.write_bytes(b"\x80\x04]." + bytes(100)),
    "gone": Path.unlink,
    "a folder in its place": _folder,
}


@pytest.mark.slow
@pytest.mark.parametrize("kept", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_code_is_compiled_anew_and_kept_again(tmp_path: Path, damage: str, kept: str) -> None:
    (tmp_path / "kernels.py").write_text(KERNELS)
    assert call(tmp_path, "lengths") == ["13.0", "0", "1", "True"]
    for path in (tmp_path / "kept").rglob(f"*.{kept}"):
        DAMAGES[damage](path)
    assert call(tmp_path, "lengths") == ["13.0", "0", "1", "True"]
    again = ["13.0", "0", "1", "True"] if damage == "a folder in its place" else ["13.0", "1", "0", "False"]
    assert call(tmp_path, "lengths") == again


@pytest.mark.slow
def test_where_there_is_no_room_for_code_it_is_compiled_all_the_same(tmp_path: Path) -> None:
    """A file may have no more than a few bytes, as on a full disk; nothing of it is left, and later there is room."""
    resource = pytest.importorskip("resource")
    (tmp_path / "kernels.py").write_text(KERNELS)
    place = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": ":".join([str(tmp_path), *sys.path])}
    done = subprocess.run(
        [sys.executable, "-B", "-c", CALL, "lengths"], env=place, capture_output=True, text=True, check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64)),
    )  # fmt: skip
    assert done.stdout.split() == ["13.0", "0", "1", "True"]
    assert not [path for path in (tmp_path / "kept").rglob("*") if path.is_file()]
    assert call(tmp_path, "lengths") == ["13.0", "0", "1", "True"]
    assert call(tmp_path, "lengths") == ["13.0", "1", "0", "False"]
