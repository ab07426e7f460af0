"""Modules of the documentation, which stand in no package."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

DOCS = Path(__file__).parent.parent / "docs"


def docs_module(name: str) -> ModuleType:
    """A module of the folder ``docs``, with the others there within its reach."""
    if str(DOCS) not in sys.path:
        sys.path.append(str(DOCS))
    return import_module(name)
