"""What a certificate is: a statement about a loop, whether it is proved, and the data that prove it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from eppanalysis.arguments import checked
from eppanalysis.errors import EppError, visible
from eppanalysis.methods.certificates.registry import STATEMENTS, Asked
from eppanalysis.readable import words
from eppanalysis.results import PlainData, Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


class Enclosure(NamedTuple):
    """A box of amplitude [unit of the first element's input], angular frequency [rad/s] and bias, from and to."""

    amplitude: tuple[float, float]
    omega: tuple[float, float]
    bias: tuple[float, float] = (0.0, 0.0)


class WithFile(Result):
    """A result that a file proves, which a small program checks."""

    document: Mapping[str, Any]
    message: str

    @checked
    def write(self, path: str | Path) -> Path:
        """Write the file that the checker reads.

        Raises
        ------
        EppError
            If there is nothing to write, as nothing is proved.
        """
        if not self.document:
            raise EppError(f"{path}: there is no certificate to write. {self.message}")
        path = Path(path)
        path.write_text(json.dumps(self.document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        return path


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(WithFile):
    """A statement about a loop, and what proves it.

    Attributes
    ----------
    statement : Asked
        What was asked: "roots", "absence" or "cycles".
    status : Status
        CONVERGED where all of it is proved; INCOMPLETE where boxes are undecided, nothing is decided, or the loop is
        not covered.
    message : str
        What is proved, or why nothing is, in a sentence.
    document : mapping
        What the file holds, as its checker reads it; empty where nothing is proved.
    roots : tuple of Enclosure
        Of "roots": where exactly one root lies each, in ascending amplitude.
    undecided : tuple of Enclosure
        Of "roots": boxes of which nothing is proved.
    """

    statement: Asked
    status: Status
    message: str
    document: Mapping[str, Any] = field(default_factory=dict)
    roots: tuple[Enclosure, ...] = ()
    undecided: tuple[Enclosure, ...] = ()

    subject = ""  # the sentence names the loop
    in_json = "statement status proved message roots undecided document operating_point provenance"

    def to_frame(self) -> pandas.DataFrame:
        """Roots, as enclosures, and what is undecided, one a row; limit cycles, one a row; of absence, the claim."""
        if self.statement is Asked.CYCLES and self.document:
            found = cycles_of(self.document["claim"])
            names = ("period_from", "period_to", "multipliers_outside")
            rows = [dict(zip(names, (*cycle["period"], cycle["outside"]), strict=True)) for cycle in found]
            return frame_of(rows, {"period_from": "s", "period_to": "s"})
        if self.statement is not Asked.ROOTS:
            claim = {
                name: " to ".join(map(str, value)) if isinstance(value, list) else str(value)
                for name, value in self.document.get("claim", {}).items()
            }
            return frame_of([{"statement": self.statement, "proved": self.proved} | claim], {"multiplier": "s"})
        rows = [
            {
                "proved": proved,
                "amplitude_from": box.amplitude[0],
                "amplitude_to": box.amplitude[1],
                "omega_from": box.omega[0],
                "omega_to": box.omega[1],
            }
            | ({"bias_from": box.bias[0], "bias_to": box.bias[1]} if "bias" in self.document.get("box", {}) else {})
            for boxes, proved in ((self.roots, True), (self.undecided, False))
            for box in boxes
        ]
        return frame_of(rows, {"omega_from": "rad/s", "omega_to": "rad/s"})

    @property
    def proved(self) -> bool:
        """Whether all that was asked is proved."""
        return self.status.ok

    def __str__(self) -> str:
        """What is proved, or why nothing is."""
        return self.message

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The box and its roots, the Popov plot, a level set of the Lyapunov function, or energy gained over lost."""
        return self.drawn("plot_certificate", ax)


@dataclass(frozen=True)
class Check(PlainData):
    """What the checker says of a file.

    Attributes
    ----------
    accepted : bool
        Whether every step of the proof was found true.
    statement : str
        As the file names it.
    message : str
        What is proved, or why the file is refused, in a sentence.
    """

    accepted: bool
    statement: str
    message: str

    def __str__(self) -> str:
        """The sentence."""
        return self.message


def enclosure(texts: Sequence[str]) -> Enclosure:
    """Of four rationals, or six with a bias, as certificates write them."""
    ends = [float(Fraction(text)) for text in texts]
    return Enclosure(*((low, high) for low, high in zip(ends[::2], ends[1::2], strict=True)))


def sentence(document: Mapping[str, Any]) -> str:
    """What a certificate that its checker has accepted proves.

    Examples
    --------
    >>> sentence(
    ...     {
    ...         "statement": "a claim of another kind",
    ...         "loop": {"name": "servo"},
    ...         "claim": {"cycles": 1},
    ...     }
    ... )
    "Proved of servo: a claim of another kind; {'cycles': 1}."
    """
    name, claim = words(visible(str(document["loop"].get("name", "a loop")))), document["claim"]
    if document["statement"] in (STATEMENTS[Asked.ROOTS].text, STATEMENTS["balance"].text):
        return _roots_sentence(name, claim, document["box"])
    if document["statement"] == STATEMENTS[Asked.ABSENCE].text:
        low, high = claim["sector"]
        multiplier = (
            "the circle criterion"
            if claim["multiplier"] == "0"
            else f"Popov's criterion with a multiplier of {float(Fraction(claim['multiplier'])):.4g} s"
        )
        edges = f"{low} to {'infinity' if high is None else high}"
        if document["loop"]["element"]["kind"] == "play":
            return f"Proved: {name} has no periodic motion but rest, for any gap (Re G(jω) > -1)."
        return f"Proved: {name} has no periodic motion but rest (sector {edges}; {multiplier})."
    if document["statement"] == STATEMENTS["absence_with_play"].text:
        how = f"a function that falls, quadratic in {claim['sectors']} sectors"
        return f"Proved: {name} has no periodic motion but rest, for any gap ({how})."
    if document["statement"] == STATEMENTS["elbow"].text:
        degrees = math.degrees(Fraction(claim["backlash"]))
        how = "the drive loses more than the gap lets it gain"
        return f"Proved: {name} has no periodic motion but rest, for any gap up to {degrees:.4g} deg ({how})."
    if document["statement"] == STATEMENTS["cycles"].text:
        return _cycles_sentence(name, claim)
    if document["statement"] == STATEMENTS["orbit"].text:
        period = float(sum(map(Fraction, claim["period"])) / 2)
        alone = f"within {float(Fraction(claim['box'])):.1g} of its size it is the only one with these"
        cycle = f"a limit cycle of {period:.4g} s with {claim['events']} events"
        return f"Proved of the arcs in the file: {name} has {cycle}, and {alone}."
    return f"Proved of {name}: {document['statement']}; {claim}."


def _cycles_sentence(name: str, claim: Mapping[str, Any]) -> str:
    how = f"(its return map in {claim['cells']} cells)"
    found = [
        f"of {sum(cycle['period']) / 2:.4g} s ({'un' * (cycle['outside'] > 0)}stable)" for cycle in cycles_of(claim)
    ]
    if not found:
        return f"Proved: {name} has no periodic motion but rest {how}."
    count = f"exactly {len(found)} limit cycle{'s' * (len(found) > 1)}, {' and '.join(found)},"
    return f"Proved: {name} has {count} and no other periodic motion but rest {how}."


def cycles_of(claim: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The cycles of a claim: period from and to [s], and how many multipliers are outside the unit circle."""
    return [
        {"period": tuple(float(Fraction(end)) for end in cycle["period"]), "outside": int(cycle["outside"])}
        for cycle in claim["cycles"]
    ]


def _roots_sentence(name: str, claim: Mapping[str, int], box: Mapping[str, Any]) -> str:
    (a, b), (c, d), (e, f) = enclosure([x for side in ("amplitude", "frequency", "bias") for x in box.get(side, ())])
    place = f"for amplitudes {a:.4g} to {b:.4g} and {c:.4g} to {d:.4g} rad/s"
    if "bias" in box:
        place = f"for amplitudes {a:.4g} to {b:.4g}, {c:.4g} to {d:.4g} rad/s and biases {e:.4g} to {f:.4g}"
    number, left = claim["roots"], claim["undecided"]
    count = f"exactly {number} root{'s' * (number != 1)}" if number else "no root"
    outside = f", outside of {left} box{'es' * (left > 1)} in which nothing is decided" if left else ""
    return f"Proved: first order has {count} for {name}{outside}; {place}."
