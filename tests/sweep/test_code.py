"""A store belongs to the code that has computed it: what changes numbers changes its identity."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

import eppanalysis as epp
from eppanalysis.sweep.code import code_digest

PACKAGE = Path(epp.__file__).parent


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("copy") / "eppanalysis"
    shutil.copytree(PACKAGE, target, ignore=shutil.ignore_patterns("__pycache__"))
    return target


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("engine/runs.py", True),
        ("models/elements/memory.py", True),
        ("methods/search/simulate.py", True),
        ("sweep/work.py", True),
        ("cases/loops.py", True),
        ("arrays.py", True),
        ("cli/commands.py", False),
        ("report/page.py", False),
        ("results/picture.py", False),
        ("plotting.py", False),
        ("engine/__pycache__/runs.cpython-311.pyc", False),
    ],
)
def test_what_computes_is_in_the_digest_and_nothing_else(copy: Path, name: str, counts: bool) -> None:
    path, before = copy / name, code_digest.__wrapped__(copy)
    held = path.read_bytes() if path.exists() else None
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes((held or b"") + b"\n# changed\n")
    try:
        assert (code_digest.__wrapped__(copy) != before) is counts
    finally:
        path.unlink() if held is None else path.write_bytes(held)
    assert code_digest.__wrapped__(copy) == before


def test_the_sources_of_the_engine_are_in_the_digest(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = code_digest.__wrapped__(copy)
    monkeypatch.setattr(sys.modules[code_digest.__module__], "SOURCES", "of other sources")
    assert code_digest.__wrapped__(copy) != before


def test_a_place_or_a_time_is_nothing_of_it(copy: Path) -> None:
    assert code_digest.__wrapped__(copy) == code_digest()


def test_a_store_of_other_code_is_refused_and_left_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from eppanalysis.sweep import store

    path, axes = tmp_path / "map.zarr", {"loop.gain": [1.0, 2.0]}
    case = epp.case("backlash_servo").with_values({"run.t_end": "1 s"})
    kept = epp.sweep(case, axes, store=path, progress=False).load()
    files = {p: p.read_bytes() for p in path.rglob("*") if p.is_file()}
    monkeypatch.setattr(store, "code_digest", lambda: "of another commit")
    with pytest.raises(epp.EppError, match="other code of eppanalysis.*expected the same sweep, or another name"):
        epp.sweep(case, axes, store=path, progress=False)
    assert {p: p.read_bytes() for p in path.rglob("*") if p.is_file()} == files
    monkeypatch.undo()
    assert kept.identical(epp.sweep(case, axes, store=path, progress=False).load())
