"""Tests by another build of the engine: python -m pytest -p tests.built --built=FILE tests/engine."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.beside import load


def take(path: Path) -> ModuleType:
    """Let the build in the file be the engine."""
    module = sys.modules["eppanalysis.engine._native"] = load(path)
    from eppanalysis.engine import _engine

    assert _engine.__file__ == str(path)
    return module


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--built", type=Path, help="the build of the engine that is tested")


def pytest_configure(config: pytest.Config) -> None:
    take(config.getoption("--built").resolve())
