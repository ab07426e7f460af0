"""What a search for limit cycles came to: the cycles, and what it leaves open."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array
from eppanalysis.readable import count, listed, number, quantity, span, words
from eppanalysis.results import LimitCycle, Listing, Status, brief_cycles, counted, cycles_frame

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Means that are listed one by one.
_MOST_MEANS = 4
#: Share of a cycle's size below which its mean is rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class CycleSearch(Listing[LimitCycle]):
    """All limit cycles found, smallest first; behaves as a sequence of LimitCycle.

    Attributes
    ----------
    cycles : tuple of LimitCycle
        Exact orbits; and where runs are on cycles whose orbits could not be closed, those as the runs have them (method
        "simulation", with an error estimate below 1e-9). With samples, motions too that are not locked to them,
        with the difference between their turns as an error estimate (their `note` says so).
    status : Status
        CONVERGED, or UNDECIDED when something is left open: no orbit was found for a predicted cycle whose estimate
        says that it exists, some run neither settled nor repeated itself nor left, or is on a cycle that could not be
        closed, there were more basin boundaries than are bisected, or the search ended before it had come to
        its end (`message` says which).
    settles : bool
        Whether some start settled at rest.
    diverges : bool
        Whether some start grew without bound.
    search : str
        How completeness was sought, in plain words.
    rest_state : array, shape (n,)
        A state of rest that some run reached; empty where none did.
    unclosed : tuple of LimitCycle
        The predicted cycles whose orbits were not found; those with an infinite error estimate may not exist, and
        alone leave nothing open.
    left_open : tuple of str
        What keeps the search from being complete, unclosed predictions aside, each in words.
    n_runs : int
        Runs that were made.
    not_covered : str
        What a search that leaves nothing open has not looked for, in a sentence without its full stop; empty where
        `search` says it all.
    n_continua : int
        How many of the cycles are one of a continuum of cycles, between which a disturbance may move the loop.
    """

    cycles: tuple[LimitCycle, ...]
    status: Status
    settles: bool
    diverges: bool
    search: str
    rest_state: Array = field(default_factory=lambda: np.zeros(0))
    unclosed: tuple[LimitCycle, ...] = ()
    left_open: tuple[str, ...] = ()
    n_runs: int = 0
    not_covered: str = ""
    n_continua: int = 0

    parts = "cycles"
    in_json = "status message settles diverges search operating_point cycles unclosed provenance"

    @property
    def message(self) -> str:
        """How the search ended, in a sentence."""
        notes = dict.fromkeys(c.note for c in self.unclosed if exists(c))
        missing = [self._missing(note, [c for c in self.unclosed if exists(c) and c.note == note]) for note in notes]
        open_ends = "; ".join([*missing, *self.left_open])
        told = [f"The search leaves something open: {open_ends}."] * bool(open_ends)
        doubtful = listed(by_name([c for c in self.unclosed if not exists(c)]))
        if doubtful:
            told.append(f"No orbit was found for the describing-function cycle at {doubtful}, which may not exist.")
        told = told or [self.status.value]
        return " ".join([*told, f"{self.not_covered}."] if self.not_covered else told)

    def _missing(self, note: str, cycles: Sequence[LimitCycle]) -> str:
        """Predicted cycles that were not closed for one reason."""
        what = "the cycle" if len(cycles) == 1 else "the cycles"
        return f"no orbit was closed for {what} predicted at {listed(by_name(cycles))}" + f" ({note})" * bool(note)

    def doubts(self) -> list[str]:
        """What other sentences on the cycles found have to say besides: that the search leaves something open."""
        return [] if self.status.ok else [self.message]

    @property
    def stable(self) -> tuple[LimitCycle, ...]:
        """The stable cycles: what the loop can keep up for ever."""
        return tuple(c for c in self.cycles if c.stable)

    @property
    def unstable(self) -> tuple[LimitCycle, ...]:
        """The unstable cycles: what separates one outcome from another."""
        return tuple(c for c in self.cycles if not c.stable)

    def __str__(self) -> str:
        """Whether the loop oscillates, the largest cycle, and what the search leaves open."""
        # Of a search that leaves nothing open only what it did not look for is said.
        open_ends = f" {self.not_covered}." if self.not_covered else ""
        if self.unclosed or not self.status.ok:
            open_ends = f" {self.message}"
        if not self.cycles:
            # Runs without an end say nothing of cycles: the verdict begins with that, not with what was not found.
            none = "No limit cycle was found" if self.status.ok else "Undecided: no limit cycle was found"
            alike = self.n_runs > 0 and not self.left_open and self.settles != self.diverges
            first, second = ("all runs", "all runs") if alike else ("some starts", "some")
            ends = [f"{first} settle at rest"] * self.settles + [f"{second} grow without bound"] * self.diverges
            sign = ": " if self.status.ok else ", "
            return f"{none}{sign * bool(ends)}{listed(ends) if ends else ''}.{open_ends}"
        # Rest and a cycle may both be there: which of them a motion comes to is for its start to say.
        begin = "Can oscillate" if self.settles else "Oscillates"
        if not self.stable:
            unknown = [cycle for cycle in self.cycles if cycle.stable is None]
            begin = "Limit cycles of unknown stability exist" if unknown else "No stable limit cycle was found"
            # One that has multipliers, and of which it is not known whether it is stable, is neutral.
            if any(c.multipliers is not None for c in unknown):
                begin = "Neutral limit cycles exist"
        rest = " Other starts settle at rest." * self.settles + " Some starts grow without bound." * self.diverges
        return f"{begin}: {counted(self.cycles)}.{self._continua()}{rest}{open_ends}"

    def _continua(self) -> str:
        """Sentence on cycles that have no size of their own."""
        many = self.n_continua
        if not many:
            return ""
        which = "It is" if len(self) == 1 else f"{many} of them {'is' if many == 1 else 'are'}"
        return f" {which} one of a continuum of cycles, between which a disturbance may move the loop."

    def to_frame(self) -> pandas.DataFrame:
        """The cycles, one a row."""
        return cycles_frame(self.cycles)

    def in_brief(self) -> pandas.DataFrame:
        """The cycles, one a row, by their first signal."""
        return brief_cycles(self.cycles)

    @checked
    def plot(self, ax: Axes | None = None, signal: str | None = None) -> Axes:
        """Waveform of every cycle, and the rate of the signal over it."""
        return self.drawn("plot_cycles", ax, signal)


def undecided(number: int) -> str:
    """What runs without an end leave open."""
    return f"{count(number, 'run')} neither settled nor repeated {'itself' if number == 1 else 'themselves'}"


def by_name(cycles: Iterable[LimitCycle]) -> list[str]:
    """Predicted cycles by frequency and size, those of which both are alike together: mirror images differ in their
    means alone.
    """
    alike: dict[str, list[LimitCycle]] = {}
    for cycle in cycles:
        alike.setdefault(_named(cycle), []).append(cycle)
    return [_named(group[0], _about(group)) for group in alike.values()]


def _named(cycle: LimitCycle, about: str = "") -> str:
    """A predicted cycle by its frequency and the size of its first signal."""
    name, size = next(iter(cycle.peak_to_peak.items()))
    kind = {True: ", stable", False: ", unstable", None: ""}[cycle.stable]
    size_in_words = quantity(size, cycle.units.get(name, ""))
    return f"{number(cycle.frequency)} Hz ({words(name)} {size_in_words} peak to peak{about}{kind})"


def _about(cycles: Sequence[LimitCycle]) -> str:
    """Around which means of their first signal several cycles are, in words."""
    name = next(iter(cycles[0].peak_to_peak))
    unit = cycles[0].units.get(name, "")
    means = sorted(c.mean[name] if abs(c.mean[name]) > _ROUNDING * c.peak_to_peak[name] else 0.0 for c in cycles)
    shown = list(dict.fromkeys(quantity(mean, unit) for mean in means))
    if len(cycles) == 1:
        return ""
    if len(shown) == 1:
        return f", {len(cycles)} times"
    return f" about {listed(shown) if len(shown) <= _MOST_MEANS else f'{len(shown)} means {span(means, unit)}'}"


def exists(cycle: LimitCycle) -> bool:
    """Whether a prediction claims that its cycle exists; an infinite estimate of its error says that it may not."""
    return not np.isinf(cycle.error_estimate)
