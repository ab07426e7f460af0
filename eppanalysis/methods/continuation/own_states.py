"""A case whose loop is followed in states of its own, where those that it is given in are mixed, or go on for ever.

In turned states rounding keeps the orbits of an elbow from closing, and those of a long chain of lags from closing well
(`methods/orbits/apart.py`): a branch has no start, or ends where none is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from eppanalysis.methods.continuation.result import Branch
from eppanalysis.methods.orbits.apart import unmixed
from eppanalysis.methods.simulation.states import OtherStates, unread_apart
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import is_sampled
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.results import LimitCycle


@dataclass(frozen=True, eq=False)
class OwnStates:
    """A case that makes its loop in other states, the same at all values of its parameters."""

    case: CaseLike
    states: OtherStates

    @classmethod
    def of(cls, case: CaseLike) -> OwnStates | None:
        """None where the states need no others, or are taken at samples."""
        system = case.to_system()
        if isinstance(case, cls) or system.time_step or is_sampled(system.elements):
            return None
        states = unread_apart(system) or unmixed(system)
        return None if states is None else cls(case, states)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("case", "states"):  # asked for while it is read from another process
            raise AttributeError(name)
        return getattr(self.case, name)

    def to_system(self) -> LureSystem:
        """The loop in these states."""
        return self.states.of(self.case.to_system())

    def with_values(self, values: Mapping[str, Any]) -> OwnStates:
        """The case with other values, in the same states."""
        return replace(self, case=self.case.with_values(values))

    def asked(self, cycle: LimitCycle | None) -> tuple[CaseLike, LimitCycle | None]:
        """The case in these states, and a cycle in the user's as one of it."""
        # It passes on what it does not know itself.
        return cast(CaseLike, self), None if cycle is None else self.states.asked(cycle)

    def told(self, branch: Branch) -> Branch:
        """A branch of the case with its cycles in the user's states."""
        special = tuple(replace(s, cycle=self.states.told(s.cycle)) for s in branch.special)
        return replace(branch, special=special, others=tuple(map(self.told, branch.others)))


def in_own_states(case: CaseLike) -> CaseLike:
    """The case, in states of its own where it needs such."""
    return cast(CaseLike, OwnStates.of(case) or case)  # it passes on what it does not know itself
