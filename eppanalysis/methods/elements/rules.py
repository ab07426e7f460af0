"""Whether the rules of an automaton are unambiguous, and whether it can chatter: chains of events that take no time.

From each guard the chains are followed over all inputs, rates and memory values at which it can rise, whether a motion
reaches them or not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import combinations

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.elements.polyhedra import ROUNDING, Place, Region
from eppanalysis.models.elements.automaton import Automaton, Guard

#: Most linear programs, of which some hundred take a second; most events of a chain, over regions and at a point.
_MOST_PROGRAMS, _LONGEST_CHAIN, _LONGEST = 4000, 60, 1000
#: Fields of a guard that say what its event does.
_DOES = ("target", "bypass", "memory_from_input", "memory_from_memory", "memory_constant", "impulse")


class Flaw(StrEnum):
    """What may be wrong with rules, the worst first.

    Events that follow one another without end in no time; guards that do different things and rise at once; events that
    take one another back without a gap, with a jump of the output; guards that rise at once only where their surfaces
    meet.
    """

    ENDLESS = "endless"
    OVERLAP = "overlap"
    CHATTER = "chatter"
    TIE = "tie"


@dataclass(frozen=True)
class Finding:
    """Something about the rules that is not as one would have it."""

    kind: Flaw
    mode: str  # where it begins
    guards: tuple[str, ...]  # names of the guards
    #: inputs, rates, memory: an example [SI].
    inputs: tuple[float, ...] = ()
    rates: tuple[float, ...] = ()
    memory: tuple[float, ...] = ()


class _TooManyError(Exception):
    """There are too many chains of events, or too long ones, for all to be examined."""


@dataclass
class Rules:
    """Examines the rules of an automaton; the rest grows while it is at work."""

    automaton: Automaton
    rate_is_input: bool = False  # whether the second input is the rate of the first
    found: list[Finding] = field(default_factory=list)
    complete: bool = True  # whether all of it could be examined
    programs: int = 0
    guards: list[list[Guard]] = field(init=False)

    def __post_init__(self) -> None:
        self.guards = [self.automaton.guards_of(mode) for mode in range(len(self.automaton.modes))]

    def examine(self) -> list[Finding]:
        """All that is found, once each."""
        if any(np.any(g.on_output) and np.any(self.automaton.modes[g.mode].from_smooth) for g in self.automaton.guards):
            self.complete = False  # the surface of such a guard is no plane
            return []
        with suppress(_TooManyError):
            self.complete = False
            self._examine_all(self._tied(Region.all_of(self.automaton, self._count)))
            self.complete = True
        return list({(f.kind, f.mode, f.guards): f for f in self.found}.values())

    def _examine_all(self, whole: Region) -> None:
        begin = self.automaton.start_memory
        start = Place(self.automaton.start_mode, np.column_stack([np.zeros((begin.size, whole.scale.size)), begin]))
        self._follow(whole, start, (start.mode,))
        for mode in range(len(self.automaton.modes)):
            self._ties(whole, mode)
            for guard in self.guards[mode]:
                self._from(whole, guard)

    def _count(self) -> None:
        """Called before each linear program."""
        self.programs += 1
        if self.programs > _MOST_PROGRAMS:
            raise _TooManyError

    def _check_length(self, chain: Sequence[object]) -> None:
        if len(chain) > _LONGEST_CHAIN:
            raise _TooManyError

    def _tied(self, whole: Region) -> Region:
        """With the second input as the rate of the first, where it is."""
        if not self.rate_is_input:
            return whole
        same = np.zeros(whole.scale.size + 1)
        same[1], same[self.automaton.n_inputs] = 1.0, -1.0
        return whole.on(same)

    def _from(self, whole: Region, guard: Guard) -> None:
        """What follows on a guard that rises in its mode."""
        place = whole.place(guard.mode)
        face = self._face(whole, [guard])
        if face.highest([])[0] < 0.0:
            return
        for behind in self._behind(face, guard, place):
            self._follow(face, behind, (behind.mode,))
        if not (self._sticks(guard.mode) or self._sticks(guard.target)):
            self._back(face, place, (guard,), (place,))

    def _face(self, whole: Region, guards: Sequence[Guard]) -> Region:
        """Points at which guards of a mode rise through zero while the others of the mode are not above it."""
        mode = guards[0].mode
        place, stays = whole.place(mode), [g for g in self.guards[mode] if all(g is not one for one in guards)]
        face = whole.within(*(-whole.row(g, place, leaves=True) for g in stays))
        for row in (whole.row(g, place, leaves=True) for g in guards):
            face, rise = face.on(row), whole.rise(row)
            face = face if rise is None else face.within(rise)
        # While it sticks the input is on its level, and its rate is zero.
        if self._sticks(mode):
            still, rests = np.zeros((2, whole.scale.size + 1))
            still[0], still[-1], rests[self.automaton.n_inputs] = 1.0, -self.automaton.modes[mode].level, 1.0
            face = face.on(still, rests)
        return face

    def _sticks(self, mode: int) -> bool:
        return self.automaton.modes[mode].sticking

    def _ties(self, whole: Region, mode: int) -> None:
        """Guards of a mode that can rise together."""
        for pair in combinations(self.guards[mode], 2):
            if not _differ(*pair):
                continue
            value, point = self._face(whole, pair).highest([])
            if value > 0.0:
                one, other = (whole.row(g, whole.place(mode), leaves=True) for g in pair)
                self._note(Flaw.OVERLAP if _alike(one, other) else Flaw.TIE, mode, pair, point)

    def _behind(self, region: Region, guard: Guard, place: Place) -> Iterator[Place]:
        """Where an event leads; past a sticking mode, too, which the loop need not admit."""
        behind = region.behind(guard, place)
        yield behind
        if self._sticks(behind.mode) and guard.bypass >= 0:
            yield behind._replace(mode=guard.bypass)

    def _follow(self, region: Region, place: Place, passed: tuple[int, ...]) -> None:
        """Guards of a mode that are passed as it is entered: two of them at once, and where each of them leads."""
        self._check_length(passed)
        rows = [(g, region.row(g, place, leaves=False)) for g in self.guards[place.mode]]
        above = [(g, row) for g, row in rows if region.highest([row])[0] > ROUNDING]
        for (one, its), (other, others) in combinations(above, 2):
            if _differ(one, other) and (found := region.highest([its, others]))[0] > ROUNDING:
                self._note(Flaw.OVERLAP, place.mode, (one, other), found[1])
        if self._sticks(place.mode):
            return  # what leaves it hangs on the loop, and takes time
        for guard, row in above:
            beyond = region.within(row)
            for behind in self._behind(beyond, guard, place):
                if behind.mode not in passed:
                    self._follow(beyond, behind, (*passed, behind.mode))
                # A mode that comes again on the way need not come for ever: one example is followed by itself.
                elif not self._ends(*(found := region.highest([row]))[1:], place):
                    self._note(Flaw.ENDLESS, place.mode, (guard,), found[1])

    def _ends(self, point: Array, place: Place) -> bool:
        """Whether events come to an end in no time at a point."""
        here = np.append(point, 1.0)
        region, mode, memory = Region.all_of(self.automaton), place.mode, place.memory @ here
        seen: set[tuple[int, bytes]] = set()
        for _ in range(_LONGEST):
            if (mode, memory.tobytes()) in seen:
                return False
            seen.add((mode, memory.tobytes()))
            now = Place(mode, np.column_stack([np.zeros((memory.size, point.size)), memory]))
            rows = ((g, region.row(g, now, leaves=False)) for g in self.guards[mode])
            guard = next((g for g, row in rows if row @ here > 0.0), None)
            if guard is None or self._sticks(guard.target):
                return True
            mode, memory = guard.target, region.behind(guard, now).memory @ here
        return False

    def _back(self, region: Region, place: Place, path: tuple[Guard, ...], places: tuple[Place, ...]) -> None:
        """Chains without a gap that come back to the first guard: chatter, where an output jumps in them."""
        self._check_length(path)
        here = region.behind(path[-1], place)
        for guard in self.guards[here.mode]:
            row = region.row(guard, here, leaves=False)
            if self._sticks(guard.target) or region.highest([row])[0] < -ROUNDING:
                continue
            touching = region.within(row)
            if self.rate_is_input and not np.any(row[1:-1]) and (rise := region.rise(row)) is not None:
                touching = touching.within(rise)  # the rate is an input, and inputs do not jump
            chain, at = (*path, guard), (*places, here)
            if guard.target == path[0].mode:
                again = region.row(path[0], region.behind(guard, here), leaves=False)
                value, point = touching.highest([again])
                closed = touching.within(again)
                if value >= -ROUNDING and any(closed.jumps(g, p) for g, p in zip(chain, at, strict=True)):
                    self._note(Flaw.CHATTER, path[0].mode, chain, point)
            elif guard.target not in {g.mode for g in path}:
                self._back(touching, here, chain, at)

    def _note(self, kind: Flaw, mode: int, guards: Sequence[Guard], point: Array) -> None:
        n_z = self.automaton.n_inputs
        parts = np.split(point[: 2 * n_z + self.automaton.n_memory], [n_z, 2 * n_z])
        example = (tuple((part + 0.0).tolist()) for part in parts)
        self.found.append(Finding(kind, self.automaton.modes[mode].name, tuple(g.name for g in guards), *example))


def _differ(one: Guard, other: Guard) -> bool:
    """Whether the events of two guards do different things."""
    return any(not np.array_equal(getattr(one, name), getattr(other, name)) for name in _DOES)


def _alike(one: Array, other: Array) -> bool:
    """Whether two rows rise through zero at the same points."""
    sizes = [float(np.max(np.abs(row[:-1]), initial=0.0)) or 1.0 for row in (one, other)]
    return bool(np.allclose(one / sizes[0], other / sizes[1], rtol=1e-12, atol=1e-12))
