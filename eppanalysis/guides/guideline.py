"""Design guidelines for manufacturers and prosthetists: how much backlash a design may have, in tables and sentences.

Every row holds the exact, tested bound on the lock pin's backlash at one gain (profile range) of one variant of the
elbow, as an angle, as a length at the pulley and as a force by equations (1) and (2) of the paper, ``dX = R beta`` and
``dF = K dX``; what remains of it under tolerances; and, where the elbow's own backlash is larger, the disturbance with
which its oscillation begins. Tables are made by pandas; nothing here formats one by hand.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eppanalysis.arguments import check_counts, checked
from eppanalysis.cases import Case, as_case
from eppanalysis.cases.variation import variation_of
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.design import Settings, bound_of_branch, design_bounds, range_within
from eppanalysis.methods.bounds.harmonic import HarmonicSweep, Question
from eppanalysis.methods.bounds.regions import smallest_trigger, starts_from_rest
from eppanalysis.methods.bounds.result import BoundCell
from eppanalysis.methods.bounds.tolerances.bound import check_tolerances, tolerance_bound
from eppanalysis.methods.bounds.tolerances.result import ToleranceBound
from eppanalysis.models.systems.subject import require_case
from eppanalysis.progress import Progress
from eppanalysis.readable import DIGITS, count, cut, cut_text, with_unit
from eppanalysis.results import PlainData, Result
from eppanalysis.results.provenance import Provenance

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

    from eppanalysis.methods.continuation.result import Branch

__all__ = ["Guide", "GuideRow", "design_guide"]

GAIN, LIMIT = "bands.range", "lock_pin.backlash"
_NAN = float("nan")


@dataclass(frozen=True, eq=False)
class GuideRow(PlainData):
    """The guideline at one gain of one variant, in SI units.

    Attributes
    ----------
    values : dict of str to float
        The gain, and the parameters that make the variant.
    cell : BoundCell
        The bound, its tests and its elasticities.
    allowed : float
        The bound with the margins asked for taken off [rad].
    pulley : float
        ``R allowed``: play of the cable at the pulley [m].
    force : float
        ``K R allowed``: change of the cable's force as the forearm passes through the gap [N].
    tolerance : ToleranceBound or None
        Bounds under tolerances at the gain with its margin; the margin on the backlash is not taken off.
    from_rest : float
        Backlash from which on the case's own input signal starts the oscillation from rest [rad]; nan where none does.
    own : float
        The elbow's own backlash [rad].
    trigger : float
        Smallest step of the harness that starts the oscillation at the own backlash [m]; nan where there is none, or
        where the own backlash is within the bound.
    missing : str
        Why there is no bound under tolerances though they are given; empty where nothing is missing.
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

    in_json = "values bound=cell allowed pulley force tolerance from_rest own trigger missing"


@dataclass(frozen=True, eq=False, repr=False)
class Guide(Result):
    """Guidelines of a case; see :func:`design_guide`.

    Attributes
    ----------
    case : Case
    varied : tuple of str
        The parameters that make the variants.
    rows : tuple of GuideRow
    margins : dict of str to float
    """

    case: Case
    varied: tuple[str, ...]
    rows: tuple[GuideRow, ...]
    margins: dict[str, float]

    in_json = "varied margins rows sentences provenance"

    def to_frame(self) -> pandas.DataFrame:
        """The table, in the units that people use, with the unit of every column in its name."""
        import pandas

        return pandas.DataFrame([self._line(row) for row in self.rows])

    def rounded(self) -> pandas.DataFrame:
        """The table with its numbers as texts, cut to four significant digits; what there is none of is a dash."""
        return self.to_frame().map(cut_text)

    def _line(self, row: GuideRow) -> dict[str, Any]:
        line: dict[str, Any] = {}
        for name, value in row.values.items():
            unit, factor = self.case.readable(name)
            line[_column(name.partition(".")[2], unit)] = factor * value
        _, degrees = self.case.readable(LIMIT)
        lbf = self.case.readable(GAIN)[1]
        line |= {
            "largest backlash [deg]": degrees * row.allowed,
            "at the pulley [mm]": 1e3 * row.pulley,
            "force change [lbf]": lbf * row.force,
            "force change [N]": row.force,
        }
        tolerance = row.tolerance
        missing = f"No bound under tolerances: {row.missing}." if row.missing else ""
        if tolerance is not None:
            line["worst case [deg]"] = degrees * self.less_margin(tolerance.worst_case)
            for q in tolerance.quantiles:
                line[f"{100 * q.probability:g} % [deg]"] = degrees * self.less_margin(q.value)
                line[f"{100 * q.probability:g} % from [deg]"] = degrees * self.less_margin(q.low)
                line[f"{100 * q.probability:g} % to [deg]"] = degrees * self.less_margin(q.high)
        if self._applied:
            line["margins taken off"] = ", ".join(self._applied)
        line |= {
            "first order [deg]": degrees * row.cell.first_order,
            "oscillates from rest above [deg]": degrees * row.from_rest,
            "own backlash [deg]": degrees * row.own,
            "disturbance that starts it [mm]": 1e3 * abs(row.trigger),
            "verified": "yes" if row.cell.verified else "no",
            "remark": " ".join(t for t in (row.cell.message, missing) if t),
        }
        return line

    def less_margin(self, bound: float) -> float:
        """A bound on the backlash with the margin on it taken off [rad]."""
        return bound / self.margins.get(LIMIT, 1.0)

    @property
    def _applied(self) -> list[str]:
        """The margins that change anything, in words."""
        return [f"a factor of {factor:g} on {in_words(name)}" for name, factor in self.margins.items() if factor > 1.0]

    def sentences(self) -> list[str]:
        """The table in plain words."""
        rows = [self._sentence(row) for row in self.rows]
        if not self._applied:
            return rows
        kinds = "bound, also where tolerances are used up" if any(row.tolerance for row in self.rows) else "bound"
        return [*rows, f"Taken off every {kinds}: {' and '.join(self._applied)}."]

    def _below(self, backlash: float) -> str:
        """A backlash in three digits, rounded to the safe side."""
        factor = self.case.readable(LIMIT)[1]
        return self.case.text(LIMIT, cut(factor * backlash, 3) / factor, 3)

    def _sentence(self, row: GuideRow) -> str:
        text = self.case.text
        place = " and ".join(f"{in_words(n)} of {text(n, v, 4)}" for n, v in row.values.items())
        if not math.isfinite(row.allowed):
            return f"At a {place}: {row.cell.message}"
        lbf = self.case.readable(GAIN)[1]
        out = (
            f"At a {place} keep backlash under {self._below(row.allowed)} ({cut(1e3 * row.pulley, 2):.2g} mm at the "
            f"pulley, {cut(lbf * row.force, 2):.2g} lbf or {cut(row.force, 2):.2g} N of cable force)"
        )
        if row.tolerance is not None:
            out += f"; under {self._below(self.less_margin(row.tolerance.worst_case))} where every tolerance is used up"
        if row.missing:
            out += f" (no bound under tolerances: {row.missing})"
        if row.own <= row.allowed:
            return out + f". The {text(LIMIT, row.own, 3)} of this elbow are within it."
        out += f". This elbow has {text(LIMIT, row.own, 3)}: "
        if math.isfinite(row.trigger):
            return out + f"a step of {1e3 * abs(row.trigger):.2g} mm at the harness starts an oscillation that stays."
        return out + "an oscillation exists, but no step of the harness that was tried starts it."

    def __str__(self) -> str:
        """The strictest of the bounds, and how many there are."""
        known = [row for row in self.rows if math.isfinite(row.allowed)]
        if not known:
            return f"No bound on the backlash of {self.case.name} was found at {count(len(self.rows), 'design')}."
        strictest = min(known, key=lambda row: row.allowed)
        at = " and ".join(f"{in_words(n)} of {self.case.text(n, v, DIGITS)}" for n, v in strictest.values.items())
        tested = sum(row.cell.verified for row in known)
        missing = f"; no bound for {len(self.rows) - len(known)} others" if len(known) < len(self.rows) else ""
        return (
            f"Keep backlash under {self._below(strictest.allowed)}, the strictest of {count(len(known), 'bound')} "
            f"(at a {at}); {tested} of them verified{missing}."
        )

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The three regions over the gain: free of cycles, guarded by an unstable one, oscillating from rest."""
        return self.drawn("plot_regions", ax)

    def write(self, path: Path) -> None:
        """Write the table (.md, .csv, .tex, .html, .xlsx) or the picture (.png, .svg, .pdf), by the name's ending.

        Raises
        ------
        EppError
            If the ending is not known or the file cannot be written.
        """
        self.by("files", "write_guide", path)


def design_guide(
    case: Case,
    gains: Sequence[object],
    *,
    variants: Mapping[str, Sequence[object]] | None = None,
    tolerances: Mapping[str, object] | None = None,
    margins: Mapping[str, float] | None = None,
    within: tuple[object, object] | None = None,
    samples: int = 400,
    starts: int = 1000,
    workers: int = 1,
    seed: int = 20050901,
    branch: Branch | None = None,
    progress: Progress | None = None,
) -> Guide:
    """Guidelines on backlash for an elbow: at several gains, for all combinations of chosen parameters.

    Parameters
    ----------
    case : Case
        Of the elbow.
    gains : sequence of quantity
        Profile ranges.
    variants : mapping of str to sequence of quantity, optional
        Values of parameters such as "cable.stiffness", "forearm.prehensor_mass", "pulley.friction"; every combination
        is a variant. By default the case as it is.
    tolerances : mapping of str to quantity or percentage, optional
        Adds the columns for the worst case and for 95 and 99 % of all elbows. Those that the case carries are used
        where none are given; none are added where there are none.
    margins : mapping of str to float, optional
        Factor by which "bands.range" (the gain) may still grow worse and "lock_pin.backlash" must stay below its
        bound.
    within : (quantity, quantity), optional
        Range in which the bound is sought; a twentieth to twice the case's own backlash by default.
    samples : int
        Draws for the probabilities.
    starts : int
        Runs that test each bound.
    workers : int
        Processes.
    seed : int
    branch : Branch, optional
        Exact cycles of this case over its backlash, where they are known already. The end of the branch is then put to
        the test in place of a bound that harmonic balance finds, in a fraction of the time and without the value of
        first order. Where the branch has no end, the bound is sought as without it. For the case's own gain only.
    progress : callable, optional
        Told the number of rows done, of all rows, and nothing in words.

    Returns
    -------
    Guide

    Raises
    ------
    EppError
        If the case is no elbow, or a value is not valid.
    """
    case = as_case(case)
    require_case(case, "design_guide")
    if not variation_of(case).has_guideline:
        raise EppError(
            f"guide: {case.name} is a {case.kind}; expected a case of the elbow. For two parameters of any case: "
            "eppanalysis bounds CASE --over FIELD --limit FIELD --manual FILE."
        )
    if not gains:
        raise EppError("guide: no gain is given; expected one profile range or more.")
    given = dict(margins or {})
    _check_branch(case, gains, branch, by_own_gain=not variants and given.get(GAIN, 1.0) == 1.0)
    for name, factor in given.items():
        if name not in (GAIN, LIMIT) or not (math.isfinite(factor) and factor >= 1.0):
            raise EppError(
                f"guide: the margin of {name} is {factor}; expected a factor of 1 or more on {GAIN} or {LIMIT}."
            )
    ranges = [case.si(GAIN, g) for g in gains]
    counts = {"samples": (samples, 0), "starts": (starts, 1), "workers": (workers, 1), "seed": (seed, 0)}
    check_counts("guide", counts)
    names = tuple(variants or {})
    combinations = [dict(zip(names, values, strict=True)) for values in itertools.product(*(variants or {}).values())]
    work = _Work(ranges, given, tolerances, within, samples, starts, workers, seed, branch)
    for combination in combinations:
        work.check(case.with_values(combination) if combination else case)
    rows: list[GuideRow] = []
    total = len(ranges) * len(combinations)
    for combination in combinations:
        done = len(rows)

        def advance(count: int, of: int | None, doing: str, done: int = done) -> None:
            if progress is not None:
                progress(done + count, total, doing)

        rows += work.rows(case.with_values(combination) if combination else case, tuple(combination), advance)
    settings: dict[str, Any] = {
        "gains": ranges,
        "variants": {k: [str(v) for v in vs] for k, vs in (variants or {}).items()},
    }
    settings |= {"margins": given, "samples": samples, "starts": starts, "seed": seed}
    settings |= {"tolerances": {name: str(width) for name, width in tolerances.items()}} if tolerances else {}
    made_by = Provenance("design guide", settings, case=case.provenance())
    return Guide(case, names, tuple(rows), given, provenance=made_by)


def _check_branch(case: Case, gains: Sequence[object], branch: Branch | None, *, by_own_gain: bool) -> None:
    """A branch answers for one loop."""
    if branch is None:
        return
    if branch.parameter != LIMIT:
        raise EppError(f"guide: the branch runs over {branch.parameter}; expected one over {LIMIT}.")
    if not by_own_gain or [case.si(GAIN, g) for g in gains] != [case.value(GAIN)]:
        raise EppError(
            f"guide: the branch is of the gain {case.text(GAIN, case.value(GAIN))}; expected that gain alone, "
            "no variants, and no margin on the gain."
        )


@dataclass(frozen=True)
class _Work:
    """The settings of a guide."""

    ranges: list[float]
    margins: dict[str, float]
    tolerances: Mapping[str, object] | None
    within: tuple[object, object] | None
    samples: int
    starts: int
    workers: int
    seed: int
    branch: Branch | None

    def check(self, case: Case) -> None:
        """Refuse tolerances that one variant cannot have, before anything is computed."""
        if self.tolerances is None and not any(p.tolerance for p in case.parameters.values()):
            return
        for gain in self.ranges:
            check_tolerances(self._question(case.with_values({GAIN: gain})), self.tolerances)

    def _question(self, case: Case) -> Question:
        return Question(case, LIMIT, *range_within(case, LIMIT, self.within))

    def rows(self, case: Case, varied: tuple[str, ...], advance: Progress) -> list[GuideRow]:
        """Rows of one variant."""
        known = self._known(case)
        if known is not None:
            question, cell = known
            row = self._row(case, varied, cell.value, cell, (question.low, question.high), HarmonicSweep(question))
            advance(1, 1, "")
            return [row]
        # A margin on the gain asks for the bound of a loop whose gain is larger by it.
        worse = [gain / self.margins.get(GAIN, 1.0) for gain in self.ranges]
        bounds = design_bounds(
            case,
            GAIN,
            LIMIT,
            at=worse,
            within=self.within,
            starts=self.starts,
            seed=self.seed,
            workers=self.workers,
            progress=advance,
        )
        sweep = HarmonicSweep(Question(case, LIMIT, *bounds.within, GAIN))
        return [
            self._row(case, varied, gain, cell, bounds.within, sweep)
            for gain, cell in zip(self.ranges, bounds, strict=True)
        ]

    def _known(self, case: Case) -> tuple[Question, BoundCell] | None:
        """The bound at the end of the branch that was given, tested; None where it has no end."""
        if self.branch is None:
            return None
        question = self._question(case)
        settings = Settings(starts=self.starts, seed=self.seed)
        cell = bound_of_branch(question, self.ranges[0], self.branch, settings)
        return None if cell is None else (question, cell)

    def _row(
        self,
        case: Case,
        varied: tuple[str, ...],
        gain: float,
        cell: BoundCell,
        within: tuple[float, float],
        sweep: HarmonicSweep,
    ) -> GuideRow:
        here = case.with_values({GAIN: gain})
        own, bound = case.value(LIMIT), cell.bound
        allowed = bound / self.margins.get(LIMIT, 1.0)
        question = Question(here, LIMIT, within[0], max(within[1], 2.0 * own))
        found = math.isfinite(bound)
        hit = smallest_trigger(question, own) if found and own > bound else None
        tolerance, missing = None, ""
        if found:
            try:
                tolerance = self._tolerance(here.with_values({GAIN: cell.value}), within, sweep)
            except EppError as error:
                missing = str(error).rstrip(".")
        radius, stiffness = case.value("pulley.radius"), case.value("cable.stiffness")
        return GuideRow(
            values={GAIN: gain, **{name: case.value(name) for name in varied}},
            cell=cell,
            allowed=allowed,
            pulley=radius * allowed,
            force=stiffness * radius * allowed,
            tolerance=tolerance,
            from_rest=starts_from_rest(question, bound, cell.sign) if found else _NAN,
            own=own,
            trigger=_NAN if hit is None else hit.size,
            missing=missing,
        )

    def _tolerance(self, case: Case, within: tuple[float, float], sweep: HarmonicSweep) -> ToleranceBound | None:
        carried = any(p.tolerance for p in case.parameters.values())
        if self.tolerances is None and not carried:
            return None
        return tolerance_bound(
            case,
            LIMIT,
            self.tolerances,
            within=within,
            samples=self.samples,
            seed=self.seed,
            threads=self.workers,
            sweep=sweep,
        )


def _column(name: str, unit: str) -> str:
    return with_unit(in_words(f".{name}"), unit)


def in_words(name: str) -> str:
    """A parameter as manuals call it."""
    last = name.partition(".")[2].replace("_", " ")
    return {"range": "profile range", "stiffness": "cable stiffness", "friction": "pulley friction"}.get(last, last)
