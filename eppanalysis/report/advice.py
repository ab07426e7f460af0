"""What to do about what a report found: in sentences, each question with the command that answers it."""

from __future__ import annotations

from dataclasses import dataclass

from eppanalysis.cases import Case
from eppanalysis.cases.command_line import Commands
from eppanalysis.errors import EppError
from eppanalysis.limits import MARGIN, Limit, Printed
from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
from eppanalysis.methods.certificates.result import Certificate
from eppanalysis.methods.continuation.result import Branch, SpecialPoint
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.readable import words
from eppanalysis.results import Status, Trajectory

#: Letters of a name that is a symbol, before which there is no article.
_SYMBOL = 2
#: An end this near to the case's own value, relative to it, is taken to be at it.
_AT = 1e-9


@dataclass(frozen=True)
class Found:
    """What was computed for a report, and the next steps."""

    commands: Commands
    run: Trajectory
    cycles: CycleSearch | None
    branch: Branch | None
    end: SpecialPoint | None  # where the cycles of the branch cease to exist, nearest to the case's own value
    proof: Certificate | CertifiedOrbit | EppError | None

    @property
    def case(self) -> Case:
        """The case."""
        return self.commands.case

    def advice(self) -> str:
        """What to do, in lines; a command is at the end of a line."""
        oscillates = self.cycles is not None and self.cycles.stable
        more = [f"Why it oscillates, and what ends it: {self.commands.remedies()}"] if oscillates else []
        return "\n".join([*self._lines(), *more])

    def _lines(self) -> list[str]:
        run, cycles = self.run, self.cycles
        if run.limit_cycle is None and not cycles:
            return self._without_cycles()
        if run.limit_cycle is None and run.status is not Status.SETTLED and not (cycles and cycles.stable):
            further = self._how_far("Or compute how far a parameter must go for no cycle to exist")
            return [f"Change the loop until its own run settles, or see where it ends: {self._longer()}", *further]
        if self.branch is None:
            return self._how_far("Compute how far a parameter must go") or [
                "Change the loop until its own run settles."
            ]
        if self.end is None:
            the = self._the(self.branch).replace("the ", "The ", 1)
            return [
                f"{the} alone does not end it where its branch was followed: change another parameter.",
                *self._how_far("How far it must go", besides=self.branch.parameter),
            ]
        return self._beside(self.branch, self.end)

    def _without_cycles(self) -> list[str]:
        run, cycles = self.run, self.cycles
        keep = [] if self.branch is None or self.end is None else self._beside(self.branch, self.end)
        rests, opened = run.status is Status.SETTLED, cycles is not None and cycles.left_open
        if rests and not opened:
            proved = not isinstance(self.proof, EppError | None) and self.proof.proved
            thorough = [] if cycles is None or proved else ["The search is thorough and no proof."]
            return [" ".join(["Nothing, at these values.", *keep[:1], *thorough]), *keep[1:]]
        own = "Nothing from its own start; other starts are undecided. " if rests else ""
        if cycles is not None and not opened:
            own = "No start of the search oscillates; its own run is not at rest by its end, and may creep on. "
        search = [f"Search from other starts: {self.commands.cycles()}"] if cycles is None else []
        return [f"{own}Simulate for longer: {self._longer()}", *search, *keep]

    def _longer(self) -> str:
        return self.commands.longer(self.case.t_end)

    def _how_far(self, asked: str, besides: str = "") -> list[str]:
        """How far a parameter must go: over another one, or alone where the loop has no other."""
        names = [name for name in self.commands.over if name != besides]
        if not names:
            return []
        question = self.commands.bounds(names[0])
        if not question and names[0] == "loop.gain" and not has_samples(self.case.to_system()):
            question = self.commands.largest(names[0])
        return [f"{asked}: {question}"] if question else []

    def _the(self, branch: Branch) -> str:
        """The parameter of a branch in a sentence; a symbol has no article."""
        name = words(branch.parameter)
        return name if len(name) <= _SYMBOL or name != name.lower() else f"the {name}"

    def _beside(self, branch: Branch, end: SpecialPoint) -> list[str]:
        """On which side of where its cycles end the parameter of a branch is to be, or to stay."""
        the, own, above = self._the(branch), self.case.value(branch.parameter), branch.lies_above(end)
        kept = printed(self.case, branch, end)
        now = self.case.text(branch.parameter, own)
        if (own - end.value) * (1 if above else -1) < -_AT * abs(own):
            return [f"Keep {the} {kept}; it is {now} now."]
        question = self.commands.bounds(branch.parameter)
        others = f" Others may remain; this tests for them: {question}" if question else " Others may remain."
        return [f"Bring {the} from {now} {kept}: there this oscillation does not exist.{others}"]


def limit_of(branch: Branch, end: SpecialPoint) -> Limit:
    """Where the cycles of a branch end, as a limit that is tested a margin to the side without them."""
    above = branch.lies_above(end)
    return Limit(end.value, not above, end.value - MARGIN * abs(end.value) * (1.0 if above else -1.0))


def printed(case: Case, branch: Branch, end: SpecialPoint) -> str:
    """On which side of where its cycles end the parameter of a branch is to be kept, as guidelines print it."""
    limit = limit_of(branch, end)
    return Printed.of([limit], case.readable(branch.parameter)).kept(limit)
