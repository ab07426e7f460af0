"""What a diagnosis came to: which element explains the oscillation, how large it is, and what stays undecided."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import ComplexArray
from eppanalysis.diagnose.record import Oscillation, Record
from eppanalysis.readable import listed, number, percent, quantity, words
from eppanalysis.results import Listing, PlainData, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: What people call the mechanism of an element, by its kind, where that says it in other words.
_MECHANISMS = {
    "play": "backlash",
    "lock_pin": "backlash",
    "nordin_shaft": "backlash",
    "jump_and_follow": "stiction",
    "stiction_pulley": "stiction",
    "rate_limiter": "rate limit",
    "rate_limited_servo": "rate limit",
}
#: Candidates that are no elements.
LINEAR, DISTURBANCE, OWN = "linear instability", "external disturbance", "loop as modelled"
#: How notes begin that say that a candidate was not tried, or not to the end.
UNTRIED = ("could not", "cannot be tried")


class Verdict(StrEnum):
    """What a diagnosis says."""

    NAMED = "named"
    UNDECIDED = "undecided"
    UNEXPLAINED = "unexplained"
    UNTRIED = "nothing tried"


@dataclass(frozen=True, eq=False)
class Explanation(PlainData):
    """One candidate.

    Attributes
    ----------
    name, kind : str
        What the loop calls the element, and what such an element is called; both the same for what is no element.
    probability : float
        Among the candidates, each as likely as the other before the record; nan where none of them explains it.
    misfit, freedom : float, int
        Sum of squares of differences in units of their standard deviations, and how many are free.
    period : float
        That it has [s]; nan where it has none.
    fields : dict of str to (float, float, float)
        Value and 95 % interval of each field of the element that sets its size [SI], "gain" for a factor on the loop's.
    units : dict of str to str
    parameter, over : str
        The parameter of the case that sets its size, and one that is free to choose, for `bounds`; empty where there is
        none.
    in_proportion : bool
        Whether its limit cycle is in proportion to its size, so that none is without one.
    note : str
        Why it is no explanation, or where a disturbance comes in.
    harmonics : complex array, shape (signals, K)
        Of the recorded signals, as it has them; empty where it has none.
    """

    name: str
    kind: str
    probability: float
    misfit: float
    freedom: int
    period: float
    fields: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    parameter: str = ""
    over: str = ""
    in_proportion: bool = False
    note: str = ""
    harmonics: ComplexArray = field(default_factory=lambda: np.zeros((0, 0), complex))

    in_json = "name kind probability misfit freedom period fields units parameter over in_proportion note"

    @property
    def called(self) -> str:
        """Name, and in brackets what it is where the name does not say it."""
        kind = _MECHANISMS.get(self.kind, words(self.kind))
        return self.name if kind in words(self.name) else f"{self.name} ({kind})"

    def sizes(self) -> str:
        """The fields with their intervals, in words."""
        parts = []
        for name, (value, low, high) in self.fields.items():
            unit = self.units.get(name, "")
            ends = [quantity(end, unit) for end in sorted((low, high), key=abs)]
            parts.append(f"{words(name)} {quantity(value, unit)} ({' to '.join(ends)})")
        return ", ".join(parts)


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Listing[Explanation]):
    """Which element of a loop explains a recorded oscillation; behaves as a sequence of Explanation, likeliest first.

    Attributes
    ----------
    explanations : tuple of Explanation
        Of all candidates, likeliest first.
    verdict : {"named", "undecided", "unexplained", "nothing tried"}
        "named" where one candidate has at least the probability `threshold`, "unexplained" where none fits the record,
        "undecided" where several together have it, "nothing tried" where none could be laid against the record.
    threshold : float
        Probability from which on a candidate is named.
    oscillation : Oscillation
        Of the record.
    model_error : float
        Relative error that the model was taken to have.
    left_out : dict of str to str
        Elements that were not candidates, and why.
    record : Record
        The record that was explained.
    case : str
        Name of the case.
    units : dict of str to str
        Of the recorded signals.
    status : Status
        INCOMPLETE where a candidate could not be tried; its note says why.
    elsewhere : str
        Where a linear instability fits best, or nothing does: that an element explains the oscillation far better,
        if the record is of the other signal, in words; empty where none does.
    questions : tuple of str
        Next questions about those that are named, each with the command that answers it.
    """

    explanations: tuple[Explanation, ...]
    verdict: Verdict
    threshold: float
    oscillation: Oscillation
    model_error: float
    left_out: dict[str, str]
    record: Record
    case: str
    units: dict[str, str]
    status: Status
    elsewhere: str = ""
    questions: tuple[str, ...] = ()

    parts = "explanations"
    in_json = (
        "status message=status.value verdict elsewhere threshold named=names explanations period growth model_error "
        "left_out operating_point provenance"
    )

    @property
    def period(self) -> float:
        """Of the record [s]."""
        return self.oscillation.period

    @property
    def growth(self) -> float:
        """Growth of the record's amplitude per period, as a logarithm."""
        return self.oscillation.growth

    @property
    def named(self) -> tuple[Explanation, ...]:
        """The fewest candidates that together have at least the probability `threshold`; none where none fits."""
        if self.verdict not in (Verdict.NAMED, Verdict.UNDECIDED):
            return ()
        total = np.cumsum([e.probability for e in self.explanations])
        return self.explanations[: int(np.searchsorted(total, self.threshold)) + 1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the candidates in `named`."""
        return tuple(e.name for e in self.named)

    def headline(self) -> str:
        """The verdict in a few words."""
        if self.verdict is Verdict.UNTRIED:
            return "No candidate could be tried"
        if self.verdict is Verdict.UNEXPLAINED:
            tried = " that could be tried" if any(e.note.startswith(UNTRIED) for e in self) else ""
            return f"None of the candidates{tried} explains it"
        if self.verdict is Verdict.NAMED:
            return f"Explained by {self.named[0].called}"
        another = [f"another signal than {self.oscillation.names[0]}"] if self.elsewhere else []
        return f"Undecided: {listed([*(e.called for e in self.named), *another])}"

    def __str__(self) -> str:
        """The verdict with its numbers: period of the record and of the candidate, size, what comes next."""
        begin = f"{self.headline()}: the record has a period of {number(self.period)} s"
        another = f" But {self.elsewhere}: is it attached to the right signal?" if self.elsewhere else ""
        if self.verdict is Verdict.UNTRIED:
            return f"{begin}. {self._not_tried()}{self._beside()}"
        if self.verdict is Verdict.UNEXPLAINED:
            near = next((e for e in self.explanations if np.isfinite(e.misfit)), None)
            best = "" if near is None else (
                f", and the nearest, {near.called} with {number(near.period)} s, differs by a sum of squares of "
                f"{number(near.misfit)} where {near.freedom} is usual"
            )  # fmt: skip
            return f"{begin}{best}.{another}{self._beside()}{self._not_tried()}"
        parts = [f"{e.called} has {number(e.period)} s{f', {e.sizes()}' * bool(e.fields)}" for e in self.named]
        others = [e for e in self.explanations[len(self.named) :] if e.probability > 0.0]
        rest = ""
        if others:
            rest = f" Next is {others[0].called}, {_odds(self.named[0], others[0])}."
        told = f"{begin}; {'; '.join(parts)}.{rest}{another}{self._remedy()}"
        return f"{told}{self._beside()}{self._not_tried()}"

    def _not_tried(self) -> str:
        """Which candidates were not tried, or not to the end, and why."""
        why = [(e.name, e.note) for e in self.explanations if e.note.startswith(UNTRIED)]
        by_note: dict[str, list[str]] = {}
        for name, note in [*why, *self.left_out.items()] if self.verdict is Verdict.UNTRIED else why:
            by_note.setdefault(note, []).append(name)
        return "".join(f" {_candidates(names)} {note.rstrip('.')}." for note, names in by_note.items())

    def _beside(self) -> str:
        """What the record holds beside the oscillation that is explained."""
        lines = [
            f"{words(line.signal)} holds a line at {number(line.frequency)} Hz, {percent(line.share)} as large"
            for line in self.oscillation.others
        ]
        return f" Beside it {listed(lines)}: no candidate is of both." if lines else ""

    def _remedy(self) -> str:
        """What becomes of the oscillation with the size of what is named."""
        if self.verdict is not Verdict.NAMED or not self.named[0].in_proportion:
            return ""
        begin = f" The oscillation is in proportion to {self.named[0].called}"
        return f"{begin}: a smaller one makes less of it, and only without any it ends."

    def remedies(self) -> list[str]:
        """Next questions about each candidate that is named, each with its command at the end of the line."""
        return list(self.questions) if self.named else []

    def to_frame(self) -> pandas.DataFrame:
        """The candidates, one a row: probability, misfit, period [s], and the factor on the first of their fields."""
        return frame_of([self._row(e) for e in self.explanations], {"period": "s"})

    def _row(self, e: Explanation) -> dict[str, Any]:
        return {
            "candidate": e.called,
            "probability": e.probability,
            "misfit": e.misfit,
            "free": e.freedom,
            "period": e.period,
            "size": e.sizes(),
            "note": e.note,
        }

    def in_brief(self) -> pandas.DataFrame:
        """The candidates, their probabilities in per cent."""
        frame = self.to_frame()
        frame["probability"] = [
            "-" if np.isnan(share) else "< 0.01 %" if share < 1e-4 else f"{number(100.0 * share)} %"
            for share in frame["probability"].tolist()
        ]
        return frame

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The record folded to one period, and the waveform of the best candidates, one panel a signal."""
        return self.drawn("plot_diagnosis", ax)


def _candidates(names: list[str]) -> str:
    return f"{'Candidate' if len(names) == 1 else 'Candidates'} {listed(names)}"


def _odds(best: Explanation, other: Explanation) -> str:
    ratio = best.probability / other.probability
    return f"{number(ratio, 2)} times less likely" if ratio < 1e4 else "far less likely"
