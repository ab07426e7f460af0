"""Checks that no test run collects can still be started."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

CHECKS = sorted(p.stem for p in Path(__file__).parent.glob("*.py") if not p.stem.startswith(("__", "test_")))


@pytest.mark.parametrize("name", CHECKS)
def test_a_check_finds_what_it_imports(name):
    assert importlib.import_module(f"tests.stress.{name}").__doc__
