"""What the methods need of a case: the case layer stands above them, so that they know it by these members only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from eppanalysis.errors import EppError
from eppanalysis.models.lure import LureSystem
from eppanalysis.models.signals import Motion


class CaseLike(Protocol):
    """What branches, bounds and ladders need of a case (the case layer stands above the methods)."""

    @property
    def name(self) -> str:
        """What results call it."""

    @property
    def input(self) -> Motion | Mapping[str, Motion] | None:
        """Motion of the external input."""

    @property
    def t_end(self) -> float:
        """Length of a run [s]."""

    def to_system(self) -> LureSystem:
        """The system."""

    def with_values(self, values: Mapping[str, Any]) -> CaseLike:
        """The same case with other values."""

    def si(self, name: str, value: object) -> float:
        """SI value of a quantity."""

    def value(self, name: str) -> float:
        """A parameter [SI]."""

    def unit(self, name: str) -> tuple[str, str]:
        """SI unit and the unit people use."""

    def readable(self, name: str) -> tuple[str, float]:
        """The unit people use, and the factor from SI to it."""


def require_case(case: object, verb: str) -> None:
    """Raise EppError unless a verb was handed a case; the system made of one is the likely slip."""
    if not hasattr(case, "to_system"):
        kind = type(case).__name__
        raise EppError(f"{verb}: the first argument is a {kind}; expected a Case, as case() and read_case() give.")
