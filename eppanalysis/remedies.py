"""Why a case oscillates, and which change of one value, or part put in, ends it: tried by runs and the search.

A change counts when the search finds no stable cycle with it and leaves nothing open. The element that an oscillation
needs is known the same way: with a gain in its place there is none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.cases import Case, Missing, as_case, variation_of
from eppanalysis.cases.command_line import Commands
from eppanalysis.cases.values.quantities import format_si
from eppanalysis.cases.variation import takes
from eppanalysis.diagnose.linear import Linear, is_linear
from eppanalysis.errors import CaseError, EppError
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.methods.search.simulate import simulate
from eppanalysis.methods.simulation.budget import BudgetExceeded, budget, remaining
from eppanalysis.models.diagrams.blocks.control import INTEGRAL
from eppanalysis.models.systems.absorbed import with_gains
from eppanalysis.models.systems.inputs import Constant
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.progress import Progress
from eppanalysis.readable import DIGITS, listed, number, words, written
from eppanalysis.results import LimitCycle, Notice, PlainData, Status

#: Factors on a value, the smallest change first; a value that a file refuses is tried at the last one that it takes.
FACTORS = (0.8, 1.25, 0.5, 2.0, 0.2, 5.0, 0.1, 10.0)
#: Remedies that are sought, what seeking them may take in all, and what one change may [steps of the engine].
_MOST, _WORK, _FOR_ONE = 3, 1e7, 2e6
#: Halvings between a value that a file takes and one that it refuses.
_HALVINGS = 12
#: Periods of the oscillation that a run from it takes with a changed value, before it is carried on.
_PERIODS = 20.0
#: Sizes of a part that is put in, in half swings of the signal and in times of a radian of the oscillation; zero over
#: pole of a lead; and after how many factors parts are tried where the loop can rest.
_SIZES, _LEAD, _AFTER = (0.5, 1.0, 1.5, 2.0, 4.0), 10.0, 4
#: Samples of the signal in the period in which its swing is measured.
_SAMPLES = 400
#: The kinds of parts, a signal that no file has, and what joins a part and its place.
_KINDS = {"elements.dead_band": "dead_zone", "blocks.lead": "lead_lag", "blocks.low_pass": "low_pass"}
_PROBE, _BEFORE = "swing_of_the_error", " before "


@dataclass(frozen=True)
class Remedy(PlainData):
    """A change that ends an oscillation.

    Attributes
    ----------
    field : str
        That is changed; of a part that is put in, the field of the file that holds it.
    own : float or None
        Its value as it is [SI]; None of a part.
    value : float
        Where the oscillation ends [SI]; of a part its size: half the width of a dead band, the time constant of a lead,
        the corner frequency of a low pass.
    change : str
        Both in words.
    command : str
        That shows it: the search with the changed value.
    n_runs : int
        Runs of that search.
    """

    field: str
    own: float | None
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
        The fields that were changed, and the parts that were put in.
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
        allowed = ", as far as the work allowed" * self.ended
        names = [name for name in self.tried if _BEFORE not in name]
        parts = [name for name in self.tried if _BEFORE in name]
        if not names:
            return f"no part put in ends it ({listed(parts)}{allowed})"
        nor = f", and no part put in ({listed(parts)})" if parts else ""
        return f"no change of one value ends it ({listed([words(name) for name in names])}, {range_}{allowed}){nor}"

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
    with a dead band of ±44 mm before controller (tested).
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
    hunts: bool = False  # whether it is known that it cannot rest, or may not

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
            notices = [n for n in predict_limit_cycles(system, at).warnings if isinstance(n, Notice)]
            self.hunts = bool(notices)
            # What is sure comes before what may be.
            yield from (notice.cause for notice in sorted(notices, key=lambda notice: not notice.sure))
            if notices:
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
        needed = [names[i] for i in gains if self._needs(loop, {i: gains[i]})]
        if needed:
            which = "its place" if len(needed) == 1 else "place of any of them"
            yield f"of {listed(needed)}: with a gain in {which} no limit cycle is found"
            return
        # Either of two may do alone.
        pairs = combinations(gains, 2) if len(gains) > 2 else ()
        both = next((pair for pair in pairs if self._needs(loop, {i: gains[i] for i in pair})), ())
        if both:
            yield f"of {listed([names[i] for i in both])}: with gains in place of both no limit cycle is found"
            return
        # No gain replaces a jump, nor for a curve that grows without end.
        switching = [
            names[i]
            for i, e in enumerate(loop.elements)
            if i not in gains and not is_linear(e) and not e.automaton().smooth
        ]
        if switching:
            rest = "" if self.found.settles else ", and no run comes to rest"
            yield f"{listed(switching)} switch{'es' * (len(switching) == 1)}{rest}"

    def _needs(self, loop: LureSystem, gains: dict[int, Array]) -> bool:
        """Whether the oscillation needs any of some elements: with gains in their places there is none."""
        with suppress(EppError, BudgetExceeded):
            return self._is_free(with_gains(loop, gains), _FOR_ONE if len(gains) == 1 else _WORK)
        return False

    def _is_free(self, system: LureSystem, work: float) -> bool:
        """Whether a search finds no stable cycle and leaves nothing open."""
        if not system.elements:
            return True  # linear, and stable
        with budget(work):
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
        steps: list[_Part | _Factor] = [_Factor(name, factor) for factor in FACTORS for name in self.names]
        # A dead band lets a loop rest that hunts: parts come first there, and elsewhere behind the nearer values.
        at = 0 if self.hunts else _AFTER * len(self.names)
        every = [*steps[:at], *self.parts(), *steps[at:]]
        for k, step in enumerate(every):
            if step.called in done:
                continue
            self.tried[step.called] = None
            if self.progress is not None:
                self.progress(k, len(every), f"{words(step.called)} {step.size}")
            changed = self.with_part(step) if isinstance(step, _Part) else self.changed(step.called, step.factor)
            if changed is None or not self.ends_by_runs(changed):
                continue
            with suppress(EppError, BudgetExceeded):
                with budget(_FOR_ONE):
                    search = find_limit_cycles(changed)
                if search.status.ok and not any(c.stable is not False for c in search):
                    done.add(step.called)
                    yield self.remedy(step, changed, search)
            if not remaining():
                raise BudgetExceeded

    def parts(self) -> Iterator[_Part]:
        """Parts before the controllers, the smallest first: leads, low passes, and where it hunts dead bands."""
        places = variation_of(self.case).places()
        swings = {driven: self._swing(driven) for driven in dict.fromkeys(places.values())}
        radian = self.cycle.period / (2.0 * np.pi) if self.cycle else 0.0
        for size in _SIZES:
            for port, driven in places.items() if self.hunts else ():
                swing, unit = swings[driven]
                if swing:
                    width = _typed(size * swing, unit)
                    yield _Part(
                        "elements.dead_band", f"±{width}", size * swing, port, {"lower": f"-{width}", "upper": width}
                    )
            for port in (port for port in places if not port.endswith(f".{INTEGRAL}")):
                zero, pole, corner = size * radian, size * radian / _LEAD, 1.0 / (size * radian)
                times = {"zero_time": _typed(zero, "s"), "pole_time": _typed(pole, "s")}
                yield _Part("blocks.lead", times["zero_time"], zero, port, times)
                yield _Part(
                    "blocks.low_pass", _typed(corner, "rad/s"), corner, port, {"bandwidth": _typed(corner, "rad/s")}
                )

    def _swing(self, driven: str) -> tuple[float, str]:
        """Half of what a sum of signals swings by on the oscillation, and its unit; zero where that is not known."""
        cycle, shown = self.cycle, self.case.expected.signal
        with suppress(EppError, BudgetExceeded):
            # A file without signals has those of all ports, and that of its expectation has to stay.
            signals = {f"signals.{shown}": shown} if shown and isinstance(self.case.held("signals"), Missing) else {}
            probed = self.case.with_values({**signals, f"signals.{_PROBE}": driven})
            begun = self._begun(probed)
            if cycle is not None and begun is not None:
                times = np.linspace(0.0, cycle.period, _SAMPLES)
                run = simulate(begun, self._held(probed), cycle.period, times)
                # A sum has the unit of any of its terms.
                terms = [text.replace(".", "_") for text in re.findall(r"[\w.]+", driven)]
                unit = next((unit for name in terms if (unit := run.units.get(name, ""))), "")
                return 0.5 * float(np.ptp(run.signals[_PROBE])), unit
        return 0.0, ""

    def with_part(self, part: _Part) -> Case | None:
        """The case with a part put in; None where a file with it is refused."""
        with suppress(EppError):
            return self.case.with_values({part.field: part.table})
        return None

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
        """Whether runs from the case's own start and from the oscillation settle; the search runs only then."""
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
        cycle = self.cycle
        try:
            begun = self._begun(changed)
            if cycle is None or begun is None:
                return True
            run = simulate(begun, self._held(changed), _PERIODS * cycle.period, [0.0], decide=True)
        except EppError:  # the changed elements cannot remember what those on the cycle do
            return True
        return run.status is Status.SETTLED

    def _begun(self, case: Case) -> LureSystem | None:
        """The loop of a case, begun on the oscillation; None where that has no state of it."""
        cycle, system = self.cycle, case.to_system()
        if cycle is None or cycle.state.size != len(system.A):
            return None
        return replace(system, x0=cycle.state, memory=cycle.memory)

    def _held(self, case: Case) -> dict[str, Constant]:
        """The inputs where they are held at the operating point."""
        system, at = case.to_system(), case.operating_point
        return {n: Constant(at.inputs[n] - float(v)) for n, v in zip(system.input_names, system.v0, strict=True)}

    def remedy(self, step: _Part | _Factor, changed: Case, search: CycleSearch) -> Remedy:
        """A change that has ended it."""
        held: object
        if isinstance(step, _Part):
            name, own, value, held = step.field, None, step.value, step.table
            text = f"a {step.what} of {step.size} before {step.port}"
        else:
            name = step.called
            own, value = self.case.value(name), changed.value(name)
            now, held = (self.case.text(name, v, DIGITS) for v in (own, value))
            text = f"{words(name)} {held} in place of {now}"
        command = Commands.of(changed).command("cycles")
        command = command or f"epp.find_limit_cycles(case.with_values({{{name!r}: {held!r}}}))"
        return Remedy(name, own, value, text, command, search.n_runs)


@dataclass(frozen=True)
class _Factor:
    """A factor on the value of a field."""

    called: str
    factor: float

    @property
    def size(self) -> str:
        """In words."""
        return f"times {number(self.factor)}"


@dataclass(frozen=True)
class _Part:
    """A part that is put in before an input.

    Attributes
    ----------
    field : str
        Of the file that holds it.
    size : str
    value : float
        The same [SI].
    port : str
        The input.
    fields : dict of str to str
        Its size, as a file holds it.
    """

    field: str
    size: str
    value: float
    port: str
    fields: dict[str, str]

    @property
    def what(self) -> str:
        """In words."""
        return self.field.partition(".")[2].replace("_", " ")

    @property
    def called(self) -> str:
        """Where it is, whatever its size."""
        return f"{self.what}{_BEFORE}{self.port}"

    @property
    def table(self) -> dict[str, str]:
        """As a file holds it."""
        return {"kind": _KINDS[self.field], **self.fields, "before": self.port}


def _typed(value: float, unit: str) -> str:
    """A quantity of two digits as files take it."""
    return format_si(value, unit, written(unit), 2)


def _gain(count: int) -> str:
    return "a gain" if count == 1 else "gains"
