"""What a certificate is: a statement about a loop, whether it is proved, and the data that prove it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Context, Decimal
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from eppanalysis.arguments import checked
from eppanalysis.errors import EppError, visible
from eppanalysis.methods.certificates.registry import STATEMENTS, Claim
from eppanalysis.readable import words
from eppanalysis.results import PlainData, Result, Status
from eppanalysis.shown import frame_of
from eppanalysis.writing import write_text

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Share of a period by which it may be unsure and is shown as one number.
_SHARP = Fraction(1, 10**5)


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
            If there is nothing to write, as nothing is proved, or the file cannot be written.
        """
        if not self.document:
            raise EppError(f"{path}: there is no certificate to write. {self.message}")
        path = Path(path)
        write_text(json.dumps(self.document, indent=1, ensure_ascii=False) + "\n", path)
        return path


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(WithFile):
    """A statement about a loop, and what proves it.

    Attributes
    ----------
    statement : {"roots", "absence", "cycles"}
        What is proved.
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

    statement: Claim
    status: Status
    message: str
    document: Mapping[str, Any] = field(default_factory=dict)
    roots: tuple[Enclosure, ...] = ()
    undecided: tuple[Enclosure, ...] = ()

    subject = ""  # the sentence names the loop
    in_json = "statement status proved message roots undecided document operating_point provenance"

    def to_frame(self) -> pandas.DataFrame:
        """Roots, as enclosures, and what is undecided, one a row; limit cycles, one a row; of absence, the claim."""
        if self.statement is Claim.CYCLES and self.document:
            found = cycles_of(self.document["claim"])
            names = ("period_from", "period_to", "multipliers_outside")
            rows = [dict(zip(names, (*cycle["period"], cycle["outside"]), strict=True)) for cycle in found]
            return frame_of(rows, {"period_from": "s", "period_to": "s"})
        if self.statement is not Claim.ROOTS:
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
        """Whether the whole statement is proved."""
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
    about : bool or None
        Whether the file states the given loop; None where none was given, or the file is refused.
    """

    accepted: bool
    statement: str
    message: str
    about: bool | None = None

    def __str__(self) -> str:
        """The sentence."""
        return self.message


def enclosure(texts: Sequence[str]) -> Enclosure:
    """Of four rationals, or six with a bias, as certificates write them."""
    ends = [float(Fraction(text)) for text in texts]
    return Enclosure(*((low, high) for low, high in zip(ends[::2], ends[1::2], strict=True)))


#: What a certificate speaks of where nothing says which case its loop is.
UNNAMED = "the loop in the file"


def sentence(document: Mapping[str, Any], name: str = UNNAMED, values: str = "") -> str:
    """What a certificate that its checker has accepted proves.

    Parameters
    ----------
    name : str, optional
        Of the loop, where it is known to be the one that the certificate states.
    values : str, optional
        Of the parameter over which it is known to state the loop.

    Examples
    --------
    >>> sentence(
    ...     {"statement": "a claim of another kind", "claim": {"cycles": 1}},
    ...     name="servo",
    ... )
    "Proved of servo: a claim of another kind; {'cycles': 1}."
    """
    statement, claim, known = document["statement"], document["claim"], name != UNNAMED
    name = words(visible(name)) + (values if known else _range(document))
    if statement in (STATEMENTS[Claim.ROOTS].text, STATEMENTS["balance"].text):
        return _roots_sentence(name, claim, document["box"])
    if statement == STATEMENTS[Claim.ABSENCE].text:
        how = _criterion(claim)
        gap, how = (", for any gap", "Re G(jω) > -1") if document["loop"]["element"]["kind"] == "play" else ("", how)
        return f"Proved: {name} has no periodic motion but rest{gap} ({how})."
    if statement == STATEMENTS["absence_with_play"].text:
        how = f"a function that falls, quadratic in {claim['sectors']} sectors"
        return f"Proved: {name} has no periodic motion but rest, for any gap ({how})."
    if statement == STATEMENTS["elbow"].text:
        how = "the drive loses more than the gap lets it gain"
        return f"Proved: {name} has no periodic motion but rest, for any gap up to {_gap(claim)} deg ({how})."
    if statement == STATEMENTS["cycles"].text:
        return _cycles_sentence(name, claim)
    if statement == STATEMENTS["orbit"].text:
        return _orbit_sentence(name if known else "", claim, driven_by(document))
    return f"Proved of {name}: {statement}; {claim}."


def _range(document: Mapping[str, Any]) -> str:
    """The linear parts and dead times between which one lies, where a file speaks of many."""
    ends, late = document["loop"].get("num", []), document["loop"].get("delay")
    said = []
    if len(ends) > 1 and isinstance(ends[0], list):
        if len(ends) > 2 or document["loop"]["den"][0] != document["loop"]["den"][1]:
            said.append(f"any linear part between the {len(ends)} that it lists")
        else:
            low, high = (" ".join(rounded(Fraction(c), ROUND_HALF_EVEN, 6) for c in row) for row in ends)
            said.append(f"any numerator from {low} to {high}")
    if isinstance(late, list):
        low, high = (rounded(Fraction(t), ROUND_HALF_EVEN) for t in late)
        said.append(f"any dead time from {low} to {high} s")
    return "," * bool(said) + "".join(f" with {part}," for part in said)


def _criterion(claim: Mapping[str, Any]) -> str:
    """The criterion that holds, with its sector."""
    (low, high), multiplier = claim["sector"], Fraction(claim["multiplier"])
    if low is None:
        return f"whatever the element without memory; Re jωG(jω) {'<>'[multiplier > 0]} 0"
    by = f"Popov's criterion with a multiplier of {rounded(multiplier, ROUND_HALF_EVEN)} s" if multiplier else ""
    return f"sector {low} to {'infinity' if high is None else high}; {by or 'the circle criterion'}"


def _gap(claim: Mapping[str, Any]) -> str:
    """A gap in degrees, rounded down; degrees that were given are themselves."""
    return rounded(Fraction(claim["backlash"]) * Fraction(math.degrees(1.0)) * (1 + Fraction(1, 10**12)), ROUND_FLOOR)


def driven_by(document: Mapping[str, Any]) -> str:
    """The sine under which an orbit is one, as "under ..."; empty where none drives the loop."""
    drive = document.get("loop", {}).get("course", {}).get("drive")
    if not drive:
        return ""
    name, *numbers = drive
    amplitude, omega = (rounded(Fraction(value), ROUND_HALF_EVEN, 6) for value in numbers)
    return f"under a sine of {amplitude} and {omega} rad/s at {words(visible(name))}"


def _orbit_sentence(name: str, claim: Mapping[str, Any], under: str) -> str:
    """Of a loop that is known, or of what the file alone shows: that its arcs are those of a loop it does not."""
    period, events = _period(claim["period"]), f"{claim['events']} event{'s' * (claim['events'] != 1)}"
    near = f"within {rounded(Fraction(claim['box']), ROUND_FLOOR, 1)} of its size"
    if name:
        what = f"{under} has a periodic response" if under else "has a limit cycle"
        return f"Proved: {name} {what} {period} with {events}, and {near} it is the only one with these."
    return (
        f"Proved of the arcs in the file: they close to a limit cycle {period} with {events}, before which none of the "
        f"guards in the file rises, and {near} it is the only one with these."
    )


def _period(ends: Sequence[str]) -> str:
    """A period as it is known: a number where its digits are, else from and to."""
    low, high = map(Fraction, ends)
    if high - low <= _SHARP * low:
        return f"of {rounded((low + high) / 2, ROUND_HALF_EVEN)} s"
    return f"of {rounded(low, ROUND_FLOOR)} to {rounded(high, ROUND_CEILING)} s"


def rounded(value: Fraction, way: str, digits: int = 4) -> str:
    """A number to some digits, rounded to one side: what is proved of a box is proved of the one that is printed.

    Examples
    --------
    >>> rounded(Fraction(2, 3), ROUND_FLOOR), rounded(Fraction(2, 3), ROUND_CEILING)
    ('0.6666', '0.6667')
    """
    decimal = Context(prec=digits, rounding=way).divide(Decimal(value.numerator), Decimal(value.denominator))
    text = f"{float(decimal):.{digits}g}"
    # Beyond the range of floats it would be zero, or infinity, of which nothing is proved.
    return text if Decimal(text) == decimal else f"{decimal:.{digits}g}"


def _cycles_sentence(name: str, claim: Mapping[str, Any]) -> str:
    how = f"(its return map in {claim['cells']} cells)"
    found = [f"{_period(cycle['period'])} ({'un' * (cycle['outside'] > 0)}stable)" for cycle in claim["cycles"]]
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
    sides = {side: [Fraction(end) for end in box[side]] for side in ("amplitude", "frequency", "bias") if side in box}
    ends = {
        side: f"{rounded(low, ROUND_CEILING)} to {rounded(high, ROUND_FLOOR)}" for side, (low, high) in sides.items()
    }
    # Of an odd element at no bias the balance without one is decided: cycles about another mean are none of its roots.
    bias = f"biases {ends['bias']}" if "bias" in box else "no bias"
    place = f"for amplitudes {ends['amplitude']}, {ends['frequency']} rad/s and {bias}"
    number, left = claim["roots"], claim["undecided"]
    count = f"exactly {number} root{'s' * (number != 1)}" if number else "no root"
    outside = f", outside of {left} box{'es' * (left > 1)} in which nothing is decided" if left else ""
    return f"Proved: the describing function has {count} for {name}{outside}; {place}."
