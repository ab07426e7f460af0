"""How kernels are compiled: arithmetic that leaves the compiler no choice, and a place for the code on any machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis
from eppanalysis.kernels import compiling
from eppanalysis.kernels.compiling import njit, sources, store
from eppanalysis.kernels.engine.tables import ENTRY

FACTOR = st.floats(-1e3, 1e3)
#: Compiles one small kernel, or loads it: prints where it is kept, and how often it was loaded.
CODE = """
import numpy as np
from eppanalysis.kernels.orbits.flow import room
assert room(np.zeros((1, 1, 2))).shape[0] >= 1
print(room.stats.cache_path, sum(room.stats.cache_hits.values()))
"""


@pytest.fixture
def anew() -> Iterator[None]:
    """What is remembered of places and sources is asked for anew, here and after the test."""
    store.cache_clear(), sources.cache_clear()
    yield
    store.cache_clear(), sources.cache_clear()


@pytest.fixture(scope="module")
def sums() -> dict[str, object]:
    """Products and sums with the settings of the engine."""
    settings = ENTRY | {"cache": False}
    return {
        "sum": njit(**settings)(lambda a, b, c: a * b + c),
        "difference": njit(**settings)(lambda a, b, c, d: a * b - c * d),
    }


@settings(max_examples=200)
@given(a=FACTOR, b=FACTOR, c=FACTOR)
def test_products_and_sums_are_rounded_each_as_in_python(sums, a: float, b: float, c: float) -> None:
    """A product that is not rounded before it is added leaves its rounding behind in the difference."""
    assert sums["difference"](a, b, a, b) == 0.0
    assert sums["sum"](a, b, c) == a * b + c


def test_arithmetic_cannot_be_loosened() -> None:
    with pytest.raises(TypeError, match="fastmath"):
        njit(fastmath={"contract"})


def run(root: Path, **environment: str) -> tuple[Path, int, str]:
    """The folder and the loads of CODE in a process of its own, and what it said; with the package from `root`."""
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        cwd=root,
        env=kept | {"PYTHONPATH": str(root)} | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    folder, hits = done.stdout.rsplit(maxsplit=1)
    return Path(folder), int(hits), done.stderr


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package in a folder of its own."""
    source = Path(eppanalysis.__file__).parent
    shutil.copytree(source, tmp_path / "copy" / source.name, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "copy"


@pytest.mark.slow
def test_a_read_only_installation_without_a_home_keeps_its_code_among_the_temporary_files(tmp_path, copy) -> None:
    """Files in the place of folders cannot be written into, not even by root."""
    nowhere = tmp_path / "file"
    nowhere.touch()
    (copy / "eppanalysis" / "kernels" / "__pycache__").touch()
    places = {"HOME": str(nowhere), "XDG_CACHE_HOME": str(nowhere), "NUMBA_CACHE_DIR": str(nowhere)}
    folder, hits, said = run(copy, TMPDIR=str(tmp_path), **places)
    own = tmp_path / f"eppanalysis-{os.getuid()}"
    assert folder.is_relative_to(own)
    assert hits == 0
    assert said.splitlines() == [
        f"Neither the installation nor a folder of the user's can be written: compiled code is kept in {own}."
    ]
    assert run(copy, TMPDIR=str(tmp_path), **places) == (folder, 1, said)


@pytest.mark.slow
def test_code_is_made_anew_when_a_file_that_it_is_made_from_has_changed(tmp_path, copy) -> None:
    place = {"NUMBA_CACHE_DIR": str(tmp_path)}
    folder, *_ = run(copy, **place)
    assert run(copy, **place) == (folder, 1, "")
    imported = copy / "eppanalysis" / "kernels" / "simd" / "vectors.py"
    imported.write_text(imported.read_text() + "# another\n")
    assert run(copy, **place)[1] == 0


def test_sources_are_those_of_a_module_and_of_what_it_imports(copy, anew, monkeypatch) -> None:
    kernels = copy / "eppanalysis" / "kernels"
    monkeypatch.setattr(compiling, "files", lambda package: kernels)
    names = ("engine.run", "orbits.arcs", "engine.flow", "simd.vectors", "describing.piecewise", "verdict")
    before = {name: sources(name) for name in names}
    (kernels / "simd" / "vectors.py").write_text((kernels / "simd" / "vectors.py").read_text() + "# another\n")
    sources.cache_clear()
    assert {name for name in names if sources(name) != before[name]} == {
        "engine.run",
        "orbits.arcs",
        "engine.flow",
        "simd.vectors",
        "verdict",
    }


def test_code_is_not_loaded_from_a_folder_that_others_can_write(tmp_path, anew, monkeypatch) -> None:
    monkeypatch.setattr(compiling, "_takes_files", lambda folder: folder.is_relative_to(tmp_path))
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    own = tmp_path / f"eppanalysis-{os.getuid()}"
    assert store() == str(own)
    assert own.stat().st_mode & 0o777 == 0o700
    own.chmod(0o777)
    store.cache_clear()
    assert store() is None


def test_where_nothing_can_be_written_kernels_are_compiled_all_the_same(tmp_path, anew, monkeypatch, capsys) -> None:
    monkeypatch.setattr(compiling, "_takes_files", lambda folder: False)
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    assert store() is None
    total = njit(cache=True)(lambda a: a.sum())
    assert total(np.arange(4.0)) == 6.0
    assert total.stats.cache_path is None
    assert capsys.readouterr().err.endswith("can be written: code is compiled anew in each process.\n")


def test_modules_of_tests_call_no_kernel(called_by_collecting: set[str]) -> None:
    assert called_by_collecting == set()


@pytest.mark.slow
def test_among_installed_files_no_code_is_put_that_would_stay_when_the_package_goes(tmp_path, copy) -> None:
    """A copy without what a working copy has beside it is one that an installer has made."""
    before = sorted(copy.rglob("*"))
    places = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    folder, hits, said = run(copy, **places)
    assert folder.is_relative_to(tmp_path / "cache") and (hits, said) == (0, "")
    assert run(copy, **places)[:2] == (folder, 1)
    assert sorted(copy.rglob("*")) == before
    (copy / "pyproject.toml").touch()
    assert run(copy, **places)[0].is_relative_to(copy / "eppanalysis" / "kernels" / "__pycache__")
