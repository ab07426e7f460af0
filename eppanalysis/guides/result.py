"""What a guideline is: how far one parameter may go at each value of another, for each variant of a design.

Every row holds the bound on the limited parameter, how it is known, what remains of it under tolerances and margins,
and where the case's own run no longer comes to rest. For the backlash of an elbow the limit is also a length at the
pulley and a force by equations (1) and (2) of the paper, ``dX = R beta`` and ``dF = K dX``. Tables are made by pandas;
nothing here formats one by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eppanalysis.arguments import checked
from eppanalysis.cases import Case
from eppanalysis.limits import Limit, Printed, cut_text
from eppanalysis.methods.bounds.result import BoundCell, write_proofs
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.bounds.tolerances.result import ToleranceBound
from eppanalysis.readable import DIGITS, count, quantity, reasons, with_unit, words
from eppanalysis.results import PlainData, Result

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Of the guidelines of an elbow: the gain, and the backlash.
GAIN, LIMIT = "bands.range", "lock_pin.backlash"
_NAN = float("nan")
#: From this share of what is allowed on a cycle at its bound is larger: less is rounding.
_BEYOND = 1.0 + 1e-6


class Side(StrEnum):
    """Side of a limit."""

    BELOW = "below"
    ABOVE = "above"


class Region(StrEnum):
    """What a design does, by its side of the limit; in words of a manual.

    `sized` are the words where a size of oscillations is allowed.
    """

    sized: str

    def __new__(cls, word: str, sized: str) -> Region:
        """Words for both."""
        made = str.__new__(cls, word)
        made._value_, made.sized = word, sized
        return made

    FREE = "free of oscillation", "no oscillation larger than allowed"
    STRUCK = "rests unless struck", "within what is allowed unless struck"
    UNKNOWN = "oscillation possible", "larger oscillation possible"
    RUNS = "oscillates in its own run", "exceeds what is allowed in its own run"
    NONE = "no limit known", "no limit known"


@dataclass(frozen=True, eq=False)
class GuideRow(PlainData):
    """The guideline at one value of the parameter that runs, for one variant, in SI units.

    Attributes
    ----------
    values : dict of str to float
        The parameter that runs, and those that make the variant.
    cell : BoundCell
        The bound, its tests and its elasticities.
    allowed : float
        The bound less the requested margins, in the SI unit of the limited parameter.
    pulley, force : float
        Of the backlash of an elbow: ``R allowed``, play of the cable at the pulley [m], and ``K R allowed``, change of
        the cable's force as the forearm passes through the gap [N]; nan for other limits.
    tolerance : ToleranceBound or None
        Bounds under tolerances, at the gain with its margin; the margin on the limit is not taken off.
    from_rest : float
        The value from which on the case's own run ends on a cycle (larger than allowed); nan where it does not, or was
        not tested.
    own : float
        The case's own value of the limited parameter; nan where it has none.
    trigger : float
        Smallest step of an external input that starts the oscillation at the case's own value, in the input's SI unit;
        nan where there is none, or the case's own value is within the bound.
    missing : str
        Why there is no bound under tolerances though they are given; empty where nothing is missing.
    rests_to : float
        The value up to which the case's own run came to rest (or to a cycle that is allowed), wherever between it and
        the bound it was tried; nan where it did not, or was not tested.
    struck : str
        The input whose step `trigger` is; empty where there is none.
    """

    values: dict[str, float]
    cell: BoundCell
    allowed: float
    pulley: float
    force: float
    tolerance: ToleranceBound | None
    from_rest: float
    own: float
    trigger: float
    missing: str = ""
    rests_to: float = _NAN
    struck: str = ""

    in_json = "values bound=cell allowed pulley force tolerance from_rest rests_to own trigger struck missing"

    @property
    def printed(self) -> Limit:
        """What is allowed as a limit that is printed: where it is, and where the design was tested."""
        return replace(self.cell.printed, value=self.allowed)

    @property
    def shortened(self) -> float:
        """How much of what is allowed is left where the design was tested."""
        return self.printed.safe / self.allowed

    @property
    def within(self) -> bool:
        """Whether the case's own value is on the safe side of what is allowed."""
        return self.cell.sign * (self.allowed - self.own) >= 0

    @property
    def region(self) -> Region:
        """What the case does with its own value."""
        if not math.isfinite(self.allowed) or math.isnan(self.own):
            return Region.NONE
        sign = self.cell.sign
        if self.within:
            return Region.FREE
        if math.isfinite(self.from_rest) and sign * (self.own - self.from_rest) >= 0:
            return Region.RUNS
        rests = math.isfinite(self.rests_to) and sign * (self.rests_to - self.own) >= 0
        return Region.STRUCK if rests else Region.UNKNOWN


@dataclass(frozen=True, eq=False, repr=False)
class Guide(Result):
    """Guidelines of a case; see :func:`design_guide`.

    Attributes
    ----------
    case : Case
        The case that the guideline is for.
    over, limit : str
        The parameter that runs, and the one that is bounded.
    varied : tuple of str
        The parameters that make the variants.
    rows : tuple of GuideRow
        One for each value of the parameter that runs and each variant.
    margins : dict of str to float
        Factors that were given, by parameter.
    not_covered : str
        What the bounds of a sampled loop do not cover, in a sentence; empty for other loops.
    allowed : Allowed or None
        The largest stable cycle that is allowed; None where no cycle is allowed.
    step : float or None
        Step in which limits are printed, rounded to their safe side, in the unit that people use; by default the
        largest 1, 2 or 5 of a decimal place that gives away 2 % of the smallest at most.
    """

    case: Case
    over: str
    limit: str
    varied: tuple[str, ...]
    rows: tuple[GuideRow, ...]
    margins: dict[str, float]
    not_covered: str = ""
    allowed: Allowed | None = None
    step: float | None = None

    in_json = "over limit varied margins allowed not_covered rows sentences provenance"

    @property
    def of_backlash(self) -> bool:
        """Whether the limit is the backlash of an elbow, which is also a play at the pulley and a force."""
        return self.limit == LIMIT

    @property
    def side(self) -> Side:
        """On which side of the limits the design is free of oscillation."""
        return Side.ABOVE if any(row.cell.sign < 0 and math.isfinite(row.allowed) for row in self.rows) else Side.BELOW

    @property
    def printed(self) -> Printed:
        """How its limits are printed."""
        return Printed.of([row.printed for row in self.rows], self.case.readable(self.limit), self.step)

    def at_the_pulley(self) -> tuple[Printed, Printed, Printed]:
        """How the limits on an elbow's backlash are printed as a play of the cable [mm] and as a force [lbf, N]."""
        plays, forces = ([self.lesser(row, of) for row in self.rows] for of in ("pulley", "force"))
        lbf = self.case.readable(GAIN)
        return Printed.of(plays, ("mm", 1e3)), Printed.of(forces, lbf), Printed.of(forces, ("N", 1.0))

    def lesser(self, row: GuideRow, name: str) -> Limit:
        """What a limit on backlash is at the pulley, where the design was tested."""
        return row.printed.beside(row.shortened * getattr(row, name))

    def worst(self, row: GuideRow) -> Limit:
        """The limit with all tolerances used up and the margins taken off; never beyond the one without."""
        if row.tolerance is None:
            return row.printed.beside(_NAN)
        safest = min if row.cell.sign > 0 else max
        return row.printed.beside(safest(self.less_margin(row.tolerance.worst_case), row.allowed))

    def says(self, region: Region) -> str:
        """A region in words."""
        return region if self.allowed is None else region.sized

    def without(self, cycle: str) -> str:
        """What does not occur on the safe side of the limits, in words: `cycle`, or one larger than allowed."""
        return f"without a {cycle if self.allowed is None else self.allowed.exceeded}"

    def variants(self) -> dict[tuple[float, ...], list[GuideRow]]:
        """The rows by the values of the parameters that make the variants, each over the parameter that runs."""
        groups: dict[tuple[float, ...], list[GuideRow]] = {}
        for row in self.rows:
            groups.setdefault(tuple(row.values[name] for name in self.varied), []).append(row)
        return groups

    def variant_in_words(self, variant: tuple[float, ...]) -> str:
        """The parameters of a variant with their values."""
        pairs = zip(self.varied, variant, strict=True)
        return ", ".join(f"{in_words(name)} {self.case.text(name, value, DIGITS)}" for name, value in pairs)

    def to_frame(self) -> pandas.DataFrame:
        """The table, in the units that people use, with the unit of every column in its name."""
        import pandas

        return pandas.DataFrame([self._line(row, _figure) for row in self.rows])

    def rounded(self) -> pandas.DataFrame:
        """The table as texts, its numbers of four significant digits on the safe side; a dash where there is none."""
        import pandas

        frame = pandas.DataFrame([self._line(row, Printed.digits) for row in self.rows])
        return frame.map(partial(cut_text, up=self.side is Side.ABOVE))

    def _line(self, row: GuideRow, figure: Callable[[Printed, Limit], float | str]) -> dict[str, Any]:
        line: dict[str, Any] = {}
        for name, value in row.values.items():
            unit, factor = self.case.readable(name)
            line[with_unit(in_words(name), unit)] = factor * value
        unit, factor = self.case.readable(self.limit)
        side = "largest" if self.side is Side.BELOW else "smallest"
        line[with_unit(f"{side} {in_words(self.limit)}", unit)] = figure(self.printed, row.printed)
        if self.of_backlash:
            heads = ("at the pulley [mm]", "pulley"), ("force change [lbf]", "force"), ("force change [N]", "force")
            for (head, name), printed in zip(heads, self.at_the_pulley(), strict=True):
                line[head] = figure(printed, self.lesser(row, name))
        line[with_unit("as computed", unit)] = factor * row.cell.bound
        if row.tolerance is not None:
            shown = {"worst case": row.tolerance.worst_case}
            for q in row.tolerance.quantiles:
                name = f"{100 * q.probability:g} %"
                shown |= {name: q.value, f"{name} from": q.low, f"{name} to": q.high}
            line |= {with_unit(name, unit): factor * self.less_margin(value) for name, value in shown.items()}
            line[with_unit("worst case", unit)] = figure(self.printed, self.worst(row))
        if row.cell.proved is not None:
            line[with_unit("proved free at", unit)] = factor * row.cell.proved.free
            line[with_unit("proved to oscillate at", unit)] = factor * row.cell.proved.cycle
            line["these apart [%]"] = 100.0 * row.cell.proved.gap
        if self._applied:
            line["margins taken off"] = ", ".join(self._applied)
        if self.allowed is not None:
            size = with_unit("size at the limit", self.allowed.shown[0])
            line |= {"allowed": str(self.allowed), "what limits": str(row.cell.kind)}
            line[size] = self.allowed.shown[1] * row.cell.size
        begins = "oscillates from rest" if self.of_backlash else "own run oscillates"
        begins = begins if self.allowed is None else "own run exceeds it"
        beyond = Side.ABOVE if self.side is Side.BELOW else Side.BELOW
        line |= {
            with_unit("DF", unit): factor * row.cell.first_order,
            with_unit(f"{begins} {beyond}", unit): factor * row.from_rest,
            with_unit(f"own {in_words(self.limit)}", unit): factor * row.own,
        }
        if self.of_backlash:
            line["disturbance that starts it [mm]"] = 1e3 * abs(row.trigger)
        missing = f"No bound under tolerances: {row.missing}." if row.missing else ""
        line |= {
            "verified": "yes" if row.cell.verified else "no",
            "remark": " ".join(t for t in (row.cell.message, missing) if t),
        }
        return line

    def write_certificates(self, folder: str | Path) -> list[Path]:
        """Write all proofs into a folder, of absence and of cycles, one a file, as `check_certificate` reads them.

        Raises
        ------
        EppError
            If there are none, or the folder cannot be written.
        """
        named = [
            (",".join(f"{name}={value:.6g}" for name, value in row.values.items()), row.cell.proved)
            for row in self.rows
            if row.cell.proved is not None
        ]
        return write_proofs(folder, named, "")

    def less_margin(self, bound: float) -> float:
        """A bound on the limited parameter with the margin on it taken off, in its SI unit."""
        factor = self.margins.get(self.limit, 1.0)
        return bound / factor if self.side is Side.BELOW else bound * factor

    @property
    def _applied(self) -> list[str]:
        """The margins that change anything, in words."""
        return [f"a factor of {factor:g} on {in_words(name)}" for name, factor in self.margins.items() if factor > 1.0]

    def sentences(self) -> list[str]:
        """The table in plain words."""
        rows = [self._sentence(row) for row in self.rows]
        if self._applied:
            kinds = "bound, also where tolerances are used up" if any(row.tolerance for row in self.rows) else "bound"
            rows.append(f"Taken off every {kinds}: {' and '.join(self._applied)}.")
        if self.allowed is not None:
            rows.append(f"Allowed is a stable limit cycle up to {self.allowed}.")
        return [*rows, self.not_covered] if self.not_covered else rows

    def _kept(self, row: GuideRow, *beside: str) -> str:
        """On which side of its limit the limited parameter is to be kept, and in brackets where that was computed."""
        printed, bound = self.printed, row.cell.printed
        computed = f"{bound.how} {printed.computed(bound)}"
        return f"{bound.side} {printed.text(row.printed)} ({'; '.join([computed, *beside])})"

    def _at_worst(self, limits: Sequence[Limit]) -> str:
        """On which side of the strictest limit under tolerances the limited parameter is to be kept."""
        above = limits[0].holds_above
        strictest = (max if above else min)(limits, key=lambda limit: limit.value)
        return f"; {strictest.side} {self.printed.text(strictest)} where every tolerance is used up"

    def place(self, row: GuideRow) -> str:
        """The design of a row in words."""
        return " and ".join(f"a {in_words(n)} of {self.case.text(n, v, DIGITS)}" for n, v in row.values.items())

    def _sentence(self, row: GuideRow) -> str:
        place = self.place(row)
        if not math.isfinite(row.allowed):
            return f"At {place}: {row.cell.message}"
        beside = []
        if self.of_backlash:
            names = ("pulley", "force", "force")
            parts = zip(self.at_the_pulley(), names, strict=True)
            play, lbf, newton = (printed.text(self.lesser(row, name)) for printed, name in parts)
            beside = [f"{play} at the pulley, {lbf} or {newton} of cable force"]
        out = f"At {place} keep {in_words(self.limit)} {self._kept(row, *beside)}"
        if row.tolerance is not None:
            out += self._at_worst([self.worst(row)])
        if row.missing:
            out += f" (no bound under tolerances: {row.missing})"
        # That the cycle grows to what is allowed is what anybody expects.
        begins = self.allowed is not None and row.cell.size > _BEYOND * self.allowed.size
        return f"{out}{self._of_own(row)} {row.cell.active(self.allowed) if begins else ''}".rstrip()

    def _of_own(self, row: GuideRow) -> str:
        """What the sentence of a row says of the case's own value."""
        if math.isnan(row.own):
            return "."
        device = "elbow" if self.case.kind == "elbow" else "case"
        own = self.case.text(self.limit, row.own, 3)
        if row.within:
            return (
                f". The {own} of this {device} are within it." if self.of_backlash else f". Its own {own} is within it."
            )
        out, larger = f". This {device} has {own}: ", "" if self.allowed is None else " larger than allowed"
        if math.isfinite(row.trigger):
            step = (
                f"{1e3 * abs(row.trigger):.2g} mm"
                if self.of_backlash
                else quantity(abs(row.trigger), self.case.input_units.get(row.struck, ""), 2)
            )
            where = "at the harness" if self.of_backlash else f"of {words(row.struck)}"
            if row.trigger == 0.0:
                return out + f"any step {where}, however small, starts an oscillation{larger} that stays."
            return out + f"a step of {step} {where} starts an oscillation{larger} that stays."
        if self.of_backlash and self.allowed is None:
            return out + "an oscillation exists, but no step of the harness that was tried starts it."
        rests, beside = ("rests", "rest") if self.allowed is None else ("stays within what is allowed", "that")
        return out + {
            Region.RUNS: f"its own run ends in an oscillation{larger}.",
            Region.STRUCK: f"it {rests} unless struck; an oscillation{larger} exists beside {beside}.",
        }.get(row.region, f"it is not within the limit, and may oscillate{' more than is allowed' * bool(larger)}.")

    def __str__(self) -> str:
        """The strictest of the bounds, and how many there are."""
        known = [row for row in self.rows if math.isfinite(row.allowed)]
        name = in_words(self.limit)
        if not known:
            why = reasons((self.place(row), row.cell.message or row.cell.finding.sentence) for row in self.rows)
            at = count(len(self.rows), "design")
            return f"No bound on the {name} of {self.case.name} was found at {at}. {why}".strip()
        strictest = min(known, key=lambda row: row.cell.sign * row.allowed)
        tested = sum(row.cell.verified for row in known)
        missing = f"; no bound for {count(len(self.rows) - len(known), 'other')}" if len(known) < len(self.rows) else ""
        alone = len(known) == 1
        how = ("verified" if tested else "not verified") if alone else f"{tested} of them verified"
        how = "found by search" if self.not_covered else how
        sized = "" if self.allowed is None else f", with {self.allowed} allowed"
        off = [self.worst(row) for row in known if row.tolerance is not None]
        return (
            f"Keep {name} {self._kept(strictest)}"
            f"{'' if alone else f', the strictest of {len(known)} bounds'}, at {self.place(strictest)}"
            f"{sized}; {how}{missing}{self._at_worst(off) if off else ''}."
        )

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The limits as a grid by design, and the regions over the parameter that runs; into axes the regions alone."""
        return self.drawn("plot_guide", ax)

    def write(self, path: Path) -> None:
        """Write the table (.md, .csv, .tex, .html, .docx, .xlsx) or the picture (.png, .svg, .pdf), by the name.

        Raises
        ------
        EppError
            If the ending is not known or the file cannot be written.
        """
        self.by("files", "write_guide", path)


def _figure(printed: Printed, limit: Limit) -> float:
    """A limit as it is printed, as a number; nan where there is none."""
    found = printed.number(limit)
    return _NAN if isinstance(found, str) else float(found)


def in_words(name: str) -> str:
    """A parameter as manuals call it.

    Examples
    --------
    >>> in_words("bands.range"), in_words("controller.kp"), in_words("Kp")
    ('profile range', 'controller kp', 'Kp')
    """
    elbow = {
        "bands.range": "profile range",
        "lock_pin.backlash": "backlash",
        "cable.stiffness": "cable stiffness",
        "pulley.friction": "pulley friction",
        "forearm.prehensor_mass": "prehensor mass",
    }
    return elbow.get(name) or words(name)
