"""What a search for limit cycles counts while it goes on, and says of itself at its end."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.orbits.delayed.smooth import is_smooth_delayed
from eppanalysis.methods.orbits.mirrored import has_constants
from eppanalysis.methods.orbits.tsypkin import TsypkinLocus
from eppanalysis.methods.search.outcomes import ASIDE, MOST_REACHED, RunOutcome, RunOutcomes
from eppanalysis.methods.search.result import exists, undecided
from eppanalysis.methods.search.unmet import more_of, unmet
from eppanalysis.methods.simulation.stability import is_stable
from eppanalysis.models.systems.hybrid import DELAY_LINE
from eppanalysis.readable import count, number
from eppanalysis.results import LimitCycle

#: Factors on the predicted oscillation (or on the start's distance from rest) at which runs are started.
SCALES = (0.03, 0.1, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 3.0, 6.0)
N_RANDOM = 48


@dataclass
class SearchReport(RunOutcomes):
    """The runs of a search, and what was done with them."""

    by_balance: bool = True
    n_left: int = 0
    n_cut: int = 0
    n_images: int = 0
    n_loci: int = 0
    n_followed: int = 0
    n_pulses: int = 0
    n_towards: int = 0
    unclosed: list[LimitCycle] = field(default_factory=list)
    why_unclosed: dict[int, str] = field(default_factory=dict)

    def beside_rest(self) -> list[tuple[Array, Array]]:
        """Starts to either side of the state of rest that is known, where a load moves it from the centre.

        All others may be far from there. Where it does not hold, its own motion leads on to a cycle, be it far smaller
        than where the elements begin to matter.
        """
        if self.rest is None or not np.any(self.reach) or not has_constants(self.hybrid):
            return []
        rest, memory = self.rest
        return [(rest + aside * self.reach, memory) for aside in (ASIDE, -ASIDE)]

    @property
    def complete(self) -> bool:
        """Whether every cycle said to exist was closed, every run came to an end, every basin boundary was bisected."""
        return not (any(map(exists, self.unclosed)) or self.left_open())

    def left_open(self) -> tuple[str, ...]:
        """What keeps the search from being complete, unclosed predictions aside."""
        aimless, unclosed, beneath = (
            self.outcomes[e] for e in (RunOutcome.UNDECIDED, RunOutcome.UNCLOSED, RunOutcome.BENEATH_ROUNDING)
        )
        why = self.hybrid.chatters.rstrip(".")
        parts = {
            f"{undecided(aimless)}{f' ({why[0].lower()}{why[1:]})' if why else ''}": aimless,
            f"{count(unclosed, 'run')} ended on a cycle that could not be closed": unclosed,
            f"the elements change {count(beneath, 'run')} by less than rounding": beneath,
            f"{count(self.n_left, 'basin boundary')} not bisected": self.n_left,
            f"{count(self.n_ended, 'start')} left when the search had taken {self.work.most:.0e} steps": self.n_ended,
            f"{count(self.n_cut, 'prediction')} not followed to the end": self.n_cut,
            f"the mirror {'image' if self.n_images == 1 else 'images'} of {count(self.n_images, 'cycle')} not tried": (
                self.n_images
            ),
            f"other periods of {count(self.n_loci, 'cycle')} not tried": self.n_loci,
            "symmetric cycles of the relay not sought to the end": self.n_pulses,
        }
        # On an unstable cycle only runs end that begin there; those without arcs, below zero, are known from runs.
        unstable = self._unstable()
        on = [n for i, n in self.times.items() if i not in unstable]
        met = {"cycles that runs end on": on, "cycles on basin boundaries": self.bounding.values()}
        more = [text for which, times in met.items() for text in more_of(which, unmet(times))]
        return (*(text for text, number in parts.items() if number), *more)

    def _unstable(self) -> list[int]:
        """Numbers of the orbits that are not stable."""
        return [i for i, o in enumerate(self.orbits) if not is_stable(o.multipliers, o.one_of_many)]

    def not_covered(self) -> str:
        """Which unstable cycles the search comes to by chance alone, where it has come to some."""
        unstable = self._unstable()
        unbound = [i for i in unstable if i not in self.bounding]
        if not unbound:
            return ""
        # Both sides of such a cycle have one outcome: chaotic motion that passes it by may have no end of them.
        of = f"{len(unbound)} of " * (len(unbound) < len(unstable))
        which = f"{of}the unstable cycle{'s' * (len(unstable) > 1)}"
        alike = "it" if len(unbound) == 1 else "them"
        return f"No basin boundary leads to {which}: others like {alike} may be missed where no prediction is near"

    @cached_property
    def pulses(self) -> TsypkinLocus | None:
        """The symmetric motions of the relay, where the loop has one alone."""
        return TsypkinLocus.of(self.hybrid)

    def sentence(self) -> str:
        """How completeness was sought."""
        ends = ", ".join(f"{n} {what}" for what, n in sorted(self.outcomes.items()))
        balance = ", by harmonic balance where needed" * self.by_balance
        beside = ", beside a state of rest" * bool(self.beside_rest())
        rests = f", and {self.n_towards} towards states of rest of single modes" if self.n_towards else ""
        return (
            f"{count(len(self.predicted), 'predicted cycle')} as seeds{balance}; runs from "
            f"{count(sum(self.outcomes.values()), 'start')}: along {len(SCALES)} scales of each predicted and found "
            f"cycle{beside}, the loop's own start and {N_RANDOM} random ones{rests} ({ends}); "
            f"{count(self.n_boundaries, 'basin boundary')} bisected for unstable cycles{self._tried()}. "
            "Cycles that no prediction is near, and neither a run nor a boundary leads to, may be missed."
            f"{self._pasts()}{self._continua()}{self._unclosed()}{self._left()}"
        )

    def _tried(self) -> str:
        """Which symmetric cycles were sought, and of how many cycles mirror images and other periods were tried."""
        if self.pulses is None:
            return self._others_tried()
        low, high = map(number, self.pulses.reach)
        sought = f"symmetric cycles with one pulse to each side sought at half periods from {low} s to {high} s"
        return f"; {sought}{self._others_tried()}"

    def _others_tried(self) -> str:
        listed = len(self.orbits) + len(self.reached)
        if not listed:
            return ""
        images, loci = (n if n < listed else "each" for n in (len(self.orbits) - self.n_images, self.n_followed))
        if images == loci == "each":
            return "; the mirror image of each cycle tried, and its switches at other periods"
        of = count(listed, "cycle")
        return f"; of {of}, the mirror image of {images} tried, and the switches of {loci} at other periods"

    def _pasts(self) -> str:
        """From which pasts no run was begun, and which cycles were no seeds."""
        if not np.any(self.hybrid.model.smooth_kind == DELAY_LINE):
            return ""
        smooth = " With a smooth element no unstable cycle is closed from a basin boundary."
        return (
            " Before a run its delayed signals are at rest; a cycle that only other pasts lead to may be missed. "
            "Predictions leave out fast modes of a dead time (their own sentence says which), so these are no seeds."
            f"{smooth * is_smooth_delayed(self.hybrid)}"
        )

    def _left(self) -> str:
        """Sentence on the starts and basin boundaries that were left out."""
        if self.n_ended or not self.work.remaining:
            return (
                f" The search ended after {self.work.most:.0e} steps of the engine; "
                f"{count(self.n_ended, 'start')} and {count(self.n_left, 'basin boundary')} were left."
            )
        if not self.n_left:
            return ""
        left = f"{count(self.n_left, 'more basin boundary')} {'was' if self.n_left == 1 else 'were'} left"
        return f" {left}: the starts of different outcomes are interwoven."

    def _continua(self) -> str:
        """Sentence on cycles of a continuum of cycles."""
        many = sum(o.one_of_many for o in self.orbits)
        if not many:
            return ""
        return (
            f" {many} of the cycles listed {'is' if many == 1 else 'are'} one of a continuum of cycles with the "
            "same switches: an element holds a value that none of them renews, or nothing fixes where the motion lies "
            "or how large it is."
        )

    def _unclosed(self) -> str:
        """Why there are runs on cycles that are not among those found."""
        if RunOutcome.UNCLOSED not in self.outcomes:
            return ""
        if np.any(self.hybrid.model.smooth_kind == DELAY_LINE):
            why = "no orbit was closed from their events and delayed signals"
        else:
            why = "from none of their events did Newton's method close an orbit"
        what = (
            f"They are listed from runs, stable ones only, {MOST_REACHED} at most"
            if self.reached
            else "They are not listed; simulate from such a start to see one"
        )
        return f" Some runs are on cycles without a closed orbit: {why}. {what}."
