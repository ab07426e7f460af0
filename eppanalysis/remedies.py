"""Why a case oscillates, and which change of one value ends it: each is tried on this case, by runs and the search.

A change counts when the search finds no stable cycle with it and leaves nothing open. The element that an oscillation
needs is known the same way: with a gain in its place there is none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases import Case, Missing, as_case, variation_of
from eppanalysis.cases.command_line import Asking
from eppanalysis.cases.variation import takes
from eppanalysis.diagnose.linear import Linear, is_linear
from eppanalysis.errors import CaseError, EppError
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget, remaining
from eppanalysis.models.systems.absorbed import with_gains
from eppanalysis.models.systems.inputs import Constant
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.progress import Progress
from eppanalysis.readable import DIGITS, listed, number, words
from eppanalysis.results import LimitCycle, PlainData, Status

#: Factors on a value, the smallest change first; a value that a file refuses is tried at the last one that it takes.
FACTORS = (0.8, 1.25, 0.5, 2.0, 0.2, 5.0, 0.1, 10.0)
#: Remedies that are sought, what seeking them may take in all, and what one change may [steps of the engine].
_MOST, _WORK, _FOR_ONE = 3, 1e7, 2e6
#: Halvings between a value that a file takes and one that it refuses.
_HALVINGS = 12
#: Periods of the oscillation that a run from it takes with a changed value, before it is carried on.
_PERIODS = 20.0
#: What the describing function says of a loop that cannot rest, and what it adds of itself there.
_MOVES = re.compile(r"\b(hunts?|judder|keeps moving)\b")
_OF_ITSELF = re.compile(
    r", which the describing function does not see|(: the loop may \w+)?, in [a-z ]+ not predicted here\.$"
)


@dataclass(frozen=True)
class Remedy(PlainData):
    """A change that ends an oscillation.

    Attributes
    ----------
    field : str
    own, value : float
        Of the field as it is, and where the oscillation ends [SI].
    change : str
        Both in words.
    command : str
        That shows it: the search with the changed value.
    n_runs : int
        Runs of that search.
    """

    field: str
    own: float
    value: float
    change: str
    command: str
    n_runs: int

    def __str__(self) -> str:
        """Both values in words."""
        return self.change


@dataclass(frozen=True, eq=False)
class Remedies(PlainData):
    """Why a case oscillates and what ends it.

    Attributes
    ----------
    remedies : tuple of Remedy
        The smallest changes first; each leaves no stable limit cycle by a search with nothing left open.
    causes : tuple of str
        Clauses; empty where none was found.
    cycle : LimitCycle or None
        The oscillation in question; None where there is none to end.
    tried : tuple of str
        The fields that were changed.
    ended : bool
        Whether the work was used up before all was tried.
    """

    remedies: tuple[Remedy, ...]
    causes: tuple[str, ...]
    cycle: LimitCycle | None
    tried: tuple[str, ...] = ()
    ended: bool = False

    in_json = "sentence=__str__ causes remedies tried ended"

    def __str__(self) -> str:
        """Cause and remedy in one sentence."""
        if self.cycle is None:
            return "No stable limit cycle was found: there is nothing to end."
        begin = f"Oscillates because {self.causes[0]}" if self.causes else "Oscillates for no cause that was found"
        return f"{begin}; {self._ends()}."

    def _ends(self) -> str:
        """What ends it, in a clause."""
        if self.remedies:
            return f"ends with {self.remedies[0]} (tested)"
        if not self.tried:
            return "the case has no value to change"
        range_ = f"from {number(min(FACTORS))} to {number(max(FACTORS))} times its value"
        far = f"{range_}{', as far as the work allowed' * self.ended}"
        return f"no change of one value ends it ({listed([words(name) for name in self.tried])}, {far})"

    def lines(self) -> Iterator[str]:
        """The sentence, then each remedy with the command that shows it."""
        yield str(self)
        for remedy in self.remedies:
            yield f"Ends with {remedy}: {remedy.command}"


def remedies(
    case: Case | LureSystem, cycles: CycleSearch | None = None, *, progress: Progress | None = None
) -> Remedies:
    """Why a case oscillates, and which change of one of its values ends that, tried on this case.

    Parameters
    ----------
    case : Case or LureSystem
    cycles : CycleSearch, optional
        What :func:`find_limit_cycles` found for it, where that is known already.
    progress : callable, optional
        Called with changes tried, of how many, and in words.

    Returns
    -------
    Remedies

    Raises
    ------
    EppError
        For an input that is not constant at the end of the run.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> print(epp.remedies(epp.case("pid_hunting")))
    Oscillates because friction sticks, and integral action ends the sticking; ends
    with friction static 1 in place of 2 (tested).
    """
    found = find_limit_cycles(case) if cycles is None else cycles
    return _Tried(as_case(case), found, progress).result()


def why(case: Case, cycles: CycleSearch | None = None) -> tuple[str, ...]:
    """Why a case oscillates, in clauses, without what ends it; arguments as of :func:`remedies`.

    Examples
    --------
    >>> from eppanalysis.cases import case
    >>> why(case("relay_hyst_servo"))
    ('hysteresis relay switches, and no run comes to rest',)
    """
    found = find_limit_cycles(case) if cycles is None else cycles
    return tuple(_Tried(case, found, None).why()) if found.stable else ()


@dataclass
class _Tried:
    """The changes that are tried on a case."""

    case: Case
    found: CycleSearch
    progress: Progress | None
    causes: list[str] = field(default_factory=list)
    tried: dict[str, None] = field(default_factory=dict)

    @cached_property
    def cycle(self) -> LimitCycle | None:
        """The largest stable cycle."""
        signal = self.case.expected.signal or next(iter(self.case.to_system().signals.names), "")
        return max(self.found.stable, key=lambda cycle: cycle.peak_to_peak.get(signal, 0.0), default=None)

    def result(self) -> Remedies:
        """Causes, then remedies, as far as the work goes."""
        ended, end = False, list[Remedy]()
        if self.cycle is not None:
            self.causes = self.why()
            try:
                with budget(_WORK):
                    for remedy in islice(self.remedies(), _MOST):
                        end.append(remedy)
            except BudgetExceeded:
                ended = True
        return Remedies(tuple(end), tuple(self.causes), self.cycle, tuple(self.tried), ended)

    def why(self) -> list[str]:
        """The causes that are found with so much work."""
        causes: list[str] = []
        with suppress(BudgetExceeded), budget(_WORK):
            for cause in self._causes():
                causes.append(cause)
        return causes

    def _causes(self) -> Iterator[str]:
        """Why it oscillates: it cannot rest, or is unstable, or an element without which it does not."""
        system, at = self.case.to_system(), self.case.operating_point
        with suppress(EppError):
            told = [text for text in predict_limit_cycles(system, at).warnings if _MOVES.search(text)]
            # What is sure stands before what may be.
            yield from (_clause(_OF_ITSELF.sub("", text)) for text in sorted(told, key=lambda text: " may " in text))
            if told:
                return
        with suppress(EppError):
            yield from self._by_gains(Linear.of(system, at))

    def _by_gains(self, linear: Linear) -> Iterator[str]:
        """What gains in place of elements tell."""
        loop, gains = linear.loop, linear.gains
        names = [words(name) for name in loop.element_names]
        with suppress(EppError):
            if gains and not linear.refusal and not linear.stable:
                yield f"the loop is unstable with {_gain(len(gains))} in place of {listed([names[i] for i in gains])}"
                return
        needed = [names[i] for i, gain in gains.items() if self._needs(loop, i, gain)]
        if needed:
            which = "its place" if len(needed) == 1 else "place of any of them"
            yield f"of {listed(needed)}: with a gain in {which} no limit cycle is found"
            return
        # No gain stands for a jump, nor for a curve that grows without end.
        switching = [
            names[i]
            for i, e in enumerate(loop.elements)
            if i not in gains and not is_linear(e) and not e.automaton().smooth
        ]
        if switching:
            rest = "" if self.found.settles else ", and no run comes to rest"
            yield f"{listed(switching)} switch{'es' * (len(switching) == 1)}{rest}"

    def _needs(self, loop: LureSystem, element: int, gain: Array) -> bool:
        """Whether the oscillation needs an element: with a gain in its place there is none."""
        with suppress(EppError, BudgetExceeded):
            return self._is_free(with_gains(loop, {element: gain}))
        return False

    def _is_free(self, system: LureSystem) -> bool:
        """Whether a search finds no stable cycle and leaves nothing open."""
        if not system.elements:
            return True  # linear, and stable
        with budget(_FOR_ONE):
            found = find_limit_cycles(system, self.case.operating_point)
        return found.status.ok and not any(c.stable is not False for c in found)

    @cached_property
    def names(self) -> list[str]:
        """Fields that are worth changing, the most telling first."""
        variation = variation_of(self.case)
        given = [*variation.over(), *(slider.name for slider in variation.sliders())]
        # Those of the elements that it is because of come first.
        guilty = " ".join(self.causes)
        return sorted(dict.fromkeys(given), key=lambda name: words(name.partition(".")[0]) not in words(guilty))

    def remedies(self) -> Iterator[Remedy]:
        """Changes that end it, the smallest first; of each field the first that does."""
        done: set[str] = set()
        every = [(factor, name) for factor in FACTORS for name in self.names]
        for k, (factor, name) in enumerate(every):
            if name in done:
                continue
            self.tried[name] = None
            if self.progress is not None:
                self.progress(k, len(every), f"{words(name)} times {number(factor)}")
            changed = self.changed(name, factor)
            if changed is None or not self.ends_by_runs(changed):
                continue
            with suppress(EppError, BudgetExceeded):
                with budget(_FOR_ONE):
                    search = find_limit_cycles(changed)
                if search.status.ok and not any(c.stable is not False for c in search):
                    done.add(name)
                    yield self.remedy(name, changed, search)
            if not remaining():
                raise BudgetExceeded

    def changed(self, name: str, factor: float) -> Case | None:
        """The case with a value times a factor, to two digits, or as far that way as its file takes it."""
        own = self.case.value(name)
        low, high = own, factor * own
        if not takes(self.case, name, high):
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if takes(self.case, name, middle) else (low, middle)
            high = low
        for digits in range(2, DIGITS + 1):
            rounded = self.case.si(name, self.case.text(name, high, digits))
            with suppress(CaseError):
                made = self.case.with_values({name: self.case.text(name, rounded)})
                if np.sign(made.value(name) - own) == np.sign(factor - 1.0):
                    return made
        return None

    def ends_by_runs(self, changed: Case) -> bool:
        """Whether runs from the case's own start and from the oscillation settle; the search is asked only then."""
        try:
            with budget(_FOR_ONE):
                # A case need not say how long its run is.
                own = changed.held("run.t_end")
                end = _PERIODS * self.cycle.period if self.cycle and isinstance(own, Missing) else None
                if simulate(changed, t_end=end, decide=True).status is not Status.SETTLED:
                    return False
                return self._dies_out(changed)
        except BudgetExceeded:
            if not remaining():
                raise
            return False
        except EppError:
            return False

    def _dies_out(self, changed: Case) -> bool:
        """Whether a run from the oscillation settles, where its state is known."""
        cycle, system, at = self.cycle, changed.to_system(), changed.operating_point
        if cycle is None or cycle.state.size != len(system.A):
            return True
        held = {n: Constant(at.inputs[n] - float(v)) for n, v in zip(system.input_names, system.v0, strict=True)}
        try:
            begun = replace(system, x0=cycle.state, memory=cycle.memory)
            run = simulate(begun, held, _PERIODS * cycle.period, [0.0], decide=True)
        except EppError:  # the changed elements cannot remember what those on the cycle do
            return True
        return run.status is Status.SETTLED

    def remedy(self, name: str, changed: Case, search: CycleSearch) -> Remedy:
        """A change that has ended it."""
        own, value = self.case.value(name), changed.value(name)
        now, then = (self.case.text(name, v, DIGITS) for v in (own, value))
        command = Asking.of(changed).command("cycles")
        command = command or f"epp.find_limit_cycles(case.with_values({{{name!r}: {then!r}}}))"
        return Remedy(name, own, value, f"{words(name)} {then} in place of {now}", command, search.n_runs)


def _gain(count: int) -> str:
    return "a gain" if count == 1 else "gains"


def _clause(sentence: str) -> str:
    """A sentence as part of another one."""
    text = sentence.rstrip(".")
    return text.replace("The loop", "the loop", 1) if text.startswith("The loop") else text
