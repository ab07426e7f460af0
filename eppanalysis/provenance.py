"""Where a result comes from: method, settings, versions."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def provenance(method: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Method, its settings and the versions that made a result.

    Examples
    --------
    >>> provenance("simulation", {"t_end": 6.0})["settings"]
    {'t_end': 6.0}
    """
    packages = {name: _version(name) for name in ("eppanalysis", "numpy", "scipy", "numba")}
    return {"method": method, "settings": dict(settings), "versions": {"python": platform.python_version(), **packages}}
