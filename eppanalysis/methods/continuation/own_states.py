"""A case whose loop is followed in states of its own, where those that it is given in are mixed, or go on for ever.

In turned states rounding keeps the orbits of an elbow from closing, and those of a long chain of lags from closing well
(`methods/orbits/decoupled.py`): a branch has no start, or ends where none is. Far from zero the digits of a state are
those of the setpoint and not of the motion. A loop in discrete time is followed round a sampled controller.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from eppanalysis.methods.continuation.result import Branch
from eppanalysis.methods.orbits.decoupled import unmixed
from eppanalysis.methods.search.find import search_from
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.sampled import Enough
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.states import OtherStates, at_centre, unobservable_apart
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.clocked import Clocked
from eppanalysis.models.systems.sampled.strobe import is_sampled
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.progress import Progress
from eppanalysis.results import LimitCycle


@dataclass(frozen=True, eq=False)
class OwnStates:
    """A case that makes its loop in other states, the same at all values of its parameters but for their centre."""

    case: CaseLike
    #: None for those of each loop as it is given.
    states: OtherStates | InSamples | None

    @classmethod
    def of(cls, case: CaseLike) -> OwnStates | None:
        """None where the states need no others, or are taken at samples."""
        system = case.to_system()
        if isinstance(case, cls) or is_sampled(system.elements):
            return None
        if system.time_step:
            return cls(case, InSamples(Clocked.of(system)))
        states = unobservable_apart(system) or unmixed(system)
        may_be_displaced = system.input_names or np.any(system.constant_state) or np.any(system.constant_input)
        if states is None and not (may_be_displaced and case.operating_point.stands):
            return None
        return cls(case, states)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in ("case", "states"):  # read while it comes from another process
            raise AttributeError(name)
        return getattr(self.case, name)

    def at(self, case: CaseLike) -> OtherStates | InSamples:
        """The states at the values of a case."""
        system = case.to_system()
        states = OtherStates.given(system) if self.states is None else self.states.beside(system)
        if isinstance(states, InSamples) or not case.operating_point.stands:
            return states
        centred = at_centre(states.system, case.operating_point.vector(system))
        return states if centred is None else states.then(centred)

    @cached_property
    def own(self) -> OtherStates | InSamples:
        """The states at the case's own values."""
        return self.at(self.case)

    @property
    def operating_point(self) -> OperatingPoint:
        """Where the inputs of the loop in these states are held."""
        own = self.own
        return own.point(self.case.operating_point) if isinstance(own, OtherStates) else self.case.operating_point

    def to_system(self) -> LureSystem:
        """The loop in these states."""
        return self.own.system

    def with_values(self, values: Mapping[str, Any]) -> OwnStates:
        """The case with other values, in the same states."""
        return replace(self, case=self.case.with_values(values))

    def from_user(self, cycle: LimitCycle | None) -> tuple[CaseLike, LimitCycle | None]:
        """The case in these states, and a cycle in the user's as one of it."""
        # It passes on what it does not know itself.
        return cast(CaseLike, self), None if cycle is None else self.own.from_user(cycle)

    def to_user(self, branch: Branch) -> Branch:
        """A branch of the case with its cycles in the user's states."""
        states = [self.at(self.case.with_values({branch.parameter: s.value})) for s in branch.special]
        special = tuple(replace(s, cycle=own.to_user(s.cycle)) for own, s in zip(states, branch.special, strict=True))
        others, at = tuple(map(self.to_user, branch.others)), self.case.operating_point
        return replace(branch, special=special, others=others, operating_point=at)


def in_own_states(case: CaseLike) -> CaseLike:
    """The case, in states of its own where it needs such.

    In discrete time the search bounds, which goes into such states by itself.
    """
    if case.to_system().time_step:
        return case
    return cast(CaseLike, OwnStates.of(case) or case)  # it passes on what it does not know itself


def searched(
    case: CaseLike, known: Sequence[LimitCycle], enough: Enough | None = None, progress: Progress | None = None
) -> CycleSearch:
    """See ``search_from``: in the states of the case, which are searched in those of its user."""
    if not isinstance(case, OwnStates):
        return search_from(case, known, enough, progress)
    states = case.own
    wanted = None if enough is None else lambda cycle: enough(states.from_user(cycle))
    found = search_from(case.case, [states.to_user(cycle) for cycle in known], wanted, progress)
    return replace(found, cycles=tuple(map(states.from_user, found.cycles)))
