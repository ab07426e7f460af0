"""Where a result comes from, for people: method, settings, tolerances, counts, versions. No algorithm reads it."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

_PACKAGES = ("eppanalysis", "numpy", "scipy")


@cache
def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _versions() -> dict[str, str]:
    return {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}}


@dataclass(frozen=True)
class Provenance:
    """What made a result.

    What an algorithm needs is a field of the result: nothing computes with its provenance.

    Examples
    --------
    >>> Provenance("simulation", {"t_end": 6.0}).to_dict()["settings"]
    {'t_end': 6.0}
    """

    method: str = ""
    #: What was requested: arguments in SI units, the name of the ``system``.
    settings: Mapping[str, Any] = field(default_factory=dict)
    #: Within which the method's equations hold, or its verdicts are given.
    tolerances: Mapping[str, float] = field(default_factory=dict)
    statistics: Mapping[str, Any] = field(default_factory=dict)  # what was counted on the way: runs, events, iterations
    #: File, checksum, version and parameters of the case; empty for a loop made in Python.
    case: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=_versions)  # of Python and the packages that compute

    @property
    def subject(self) -> str:
        """Name of the case or the system that the result is of; empty where none was given."""
        return str(self.case.get("case") or self.settings.get("system") or "")

    def to_dict(self) -> dict[str, Any]:
        """Plain data; parts that hold nothing are left out."""
        parts = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: part if name == "method" else dict(part) for name, part in parts.items() if part}
