"""What bounds return: a cell for each value of the parameter that runs, with its tests and what is proved by it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError
from eppanalysis.limits import Limit, Printed
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.readable import count, percent, reasons, span, with_unit, words
from eppanalysis.results import Brief, LimitCycle, Listing, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

    from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
    from eppanalysis.methods.certificates.result import Certificate

_NAN = float("nan")
#: Relative error of a bound that is none: at the limit of linear stability the DF is exact.
_ROUNDING = 1e-6
#: What is said of a bound of which no test was requested.
UNTESTED = "Not verified."


class Finding(StrEnum):
    """What is known of a cell; `sentence` says it to people."""

    sentence: str

    def __new__(cls, word: str, sentence: str = "") -> Finding:
        """A word for files with a sentence."""
        made = str.__new__(cls, word)
        made._value_, made.sentence = word, sentence
        return made

    BOUND = "bound", "A bound was found."
    NONE = (
        "none",
        "The exact search finds no limit cycle at either end of the range of the limiting parameter nor at the values "
        "tried between, so nothing bounds it there.",
    )
    ALWAYS = (
        "always",
        "A limit cycle exists at both ends of the range of the limiting parameter and at all values tried between: "
        "none of them is free of cycles.",
    )
    BETWEEN = (
        "between",
        "A limit cycle exists at both ends of the range of the limiting parameter, but not at all values between: "
        "give a narrower range that begins or ends among these.",
    )
    UNSURE = (
        "unsure",
        "It is unknown whether a limit cycle exists in the range of the limiting parameter: the exact search found "
        "none at some values, but left runs undecided there.",
    )
    SCALES = (
        "scales",
        "The loop's cycles scale with this parameter alone: a cycle at one value is a cycle at every other one, larger "
        "or smaller in proportion, so no finite bound on it exists.",
    )
    IDLE = (
        "idle",
        "The loop of this case does not depend on this parameter (another field may replace it), so nothing bounds it.",
    )
    BEYOND = "beyond", "The bound lies beyond the range of the limiting parameter: cycles exist down to the end of it."
    FAILED = "failed", "No start led to a bound; one may still exist."

    @property
    def answers(self) -> bool:
        """Whether it says why there is no bound, so that none is missing."""
        return self in (self.NONE, self.ALWAYS, self.BETWEEN, self.SCALES, self.IDLE, self.BEYOND)

    @property
    def is_open(self) -> bool:
        """Whether a bound may be there that was not found."""
        return self in (self.UNSURE, self.FAILED)


class Known(StrEnum):
    """How a bound is known, the surest first; in words for a legend."""

    PROVED = "proved on both sides"
    TESTED = "exact and tested"
    EXACT = "exact, not tested"
    SEARCHED = "found by search"
    BALANCED = "describing function alone"
    NONE = "no bound"


class Turn(StrEnum):
    """Where a family of exact orbits ends."""

    UNKNOWN = ""
    FOLD = "fold"
    CORNER = "border collision"
    #: The loop ceases to be stable, as its linear part says, and oscillates within the limits of its elements.
    LINEAR = "linear limit"
    #: The stable cycle goes on, and is larger than allowed from here on.
    SIZE = "allowed size"
    #: The cycle goes on, and is stable from here on.
    STABILITY = "change of stability"
    #: Cycles exist up to the end of the range.
    END = "end"
    #: No orbit was found that continues the branch: up to here the family is known.
    BREAK = "end of the branch"
    #: No orbit was followed: the search for limit cycles answers differently on both sides.
    SEARCH = "search"
    #: Nothing ends: a region in the plane of two parameters reaches to the end of a range.
    EDGE = "end of the range"


@dataclass(frozen=True, eq=False, repr=False)
class ProvedSides(Brief):
    """What is proved on both sides of a bound.

    Attributes
    ----------
    free : float
        The value nearest the bound at which the loop is proved to have no periodic motion [SI]; nan where none is.
    cycle : float
        The value nearest the bound at which it is proved to have one [SI]; nan where none is.
    gap : float
        How far the two are apart, relative to the bound.
    absence : Certificate or None
        The proof at `free`, or from `free_from` to `free`.
    orbit : CertifiedOrbit or None
        The proof at `cycle`.
    message : str
        Why there is no proof on a side, or none nearer.
    free_from : float
        The other end of the values for which `absence` holds, `free` itself where it is of that alone [SI].
    """

    free: float = _NAN
    cycle: float = _NAN
    gap: float = _NAN
    absence: Certificate | None = None
    orbit: CertifiedOrbit | None = None
    message: str = ""
    free_from: float = _NAN

    in_json = "free free_from cycle gap message"


def write_proofs(folder: str | Path, named: Sequence[tuple[str, ProvedSides]], why: str) -> list[Path]:
    """Write proofs into a folder that is made for them, each under a name; `why` says why there are none."""
    sides = [pair for name, s in named for pair in ((name, s.absence), (f"{name}-cycle", s.orbit))]
    place, proofs = Path(folder), {name: proof for name, proof in sides if proof is not None}
    if not proofs:
        raise EppError(f"{folder}: there is no certificate to write. {why}".rstrip())
    place.mkdir(parents=True, exist_ok=True)
    return [proof.write(place / f"{name}.json") for name, proof in proofs.items()]


@dataclass(frozen=True, eq=False, repr=False)
class BoundCell(Brief):
    """The bound at one value of the parameter that runs.

    Attributes
    ----------
    value : float
        Of the parameter that runs [SI].
    finding : Finding
        That there is a bound, or why there is none.
    sign : float
        1: the design is free of limit cycles below the bound; -1: above it.
    first_order, exact : float
        The bound by describing functions, and exactly [SI]; nan where unknown, or where its cycles go on to the end of
        the range.
    searched : float
        The bound of a sampled loop, by the search for limit cycles: the last value at which it finds none [SI].
    kind : Turn
        Fold or border collision of the branch of exact orbits, or where no orbit was found that continues it; where a
        size is allowed also that the cycle reaches it, or becomes stable.
    size : float
        Of the orbit at the bound, where a size is allowed [SI, in its measure].
    frequency : float
        Of the cycle at the bound [Hz].
    safe_value, other_value : float
        Where the tests were made [SI].
    n_searched : int
        Values of the limiting parameter searched, where the bound is by the search.
    n_runs, n_settled, n_cycles : int
        Runs on the safe side, those that came to rest (or to a cycle that is allowed), and limit cycles (that are not)
        which the search or the runs found there.
    verified : bool
        No limit cycle on the safe side, an exact orbit on the other.
    orbit, other_orbit : LimitCycle or None
        The exact orbit at the bound, and on the other side.
    elasticities : mapping of str to float
        Relative change of the exact bound for a relative change of each parameter; computed when they are looked at.
    message : str
        What is missing, or why there is no bound.
    proved : ProvedSides or None
        What is proved on both sides of the bound, where that was requested.
    """

    value: float
    finding: Finding
    sign: float = 1.0
    first_order: float = _NAN
    exact: float = _NAN
    kind: Turn = Turn.UNKNOWN
    frequency: float = _NAN
    safe_value: float = _NAN
    other_value: float = _NAN
    n_runs: int = 0
    n_settled: int = 0
    n_cycles: int = 0
    verified: bool = False
    orbit: LimitCycle | None = None
    other_orbit: LimitCycle | None = None
    elasticities: Mapping[str, float] = field(default_factory=dict)
    message: str = ""
    size: float = _NAN
    searched: float = _NAN
    n_searched: int = 0
    proved: ProvedSides | None = None

    in_json = (
        "value finding sign describing_function=first_order exact searched kind size frequency bound "
        "describing_function_error=first_order_error describing_function_unsafe=first_order_unsafe safe_value "
        "other_value n_searched n_runs n_settled n_cycles verified proved elasticities message orbit=_orbit "
        "other_orbit=_other_orbit"
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "finding", Finding(self.finding))
        object.__setattr__(self, "kind", Turn(self.kind))

    @property
    def bound(self) -> float:
        """The best value that is known: exact, else by search, else by describing functions; nan where there is none,
        or where the tests found limit cycles on its safe side: it bounds nothing.
        """
        if self.finding is not Finding.BOUND or self.n_cycles:
            return _NAN
        return next((v for v in (self.exact, self.searched) if math.isfinite(v)), self.first_order)

    @property
    def printed(self) -> Limit:
        """The bound as a limit that is printed: where it was tested, and where it is."""
        how = {Known.BALANCED: "by describing functions", Known.SEARCHED: "by search"}.get(self.known, "exact")
        return Limit(self.bound, self.sign < 0, self.safe_value, how)

    @property
    def known(self) -> Known:
        """How the bound is known."""
        if math.isnan(self.bound):
            return Known.NONE
        if self.proved is not None and math.isfinite(self.proved.gap):
            return Known.PROVED
        if math.isfinite(self.exact):
            return Known.TESTED if self.verified else Known.EXACT
        return Known.SEARCHED if math.isfinite(self.searched) else Known.BALANCED

    @property
    def first_order_error(self) -> float:
        """Relative difference of the DF bound from the best one."""
        return self.first_order / self.bound - 1.0

    @property
    def first_order_unsafe(self) -> bool:
        """Whether the DF calls designs free of limit cycles that are not."""
        return bool(self.sign * self.first_order_error > _ROUNDING)

    def active(self, allowed: Allowed | None) -> str:
        """What bounds where a size is allowed: that size, the band's edge, or the birth of the cycle; a sentence."""
        if allowed is None or self.orbit is None:
            return ""
        size = f"{allowed.signal} {allowed.text(self.size)}"
        if self.kind is Turn.SIZE and self.size > (1.0 + _ROUNDING) * allowed.size:
            return f"At the bound a stable cycle of {size} comes into the band ({allowed})."
        if self.kind is Turn.SIZE:
            return f"At the bound the stable cycle reaches the allowed size ({allowed})."
        born = "becomes stable" if self.kind is Turn.STABILITY else "is born"
        return f"At the bound the cycle {born} with {size}, more than is allowed ({allowed})."

    def _orbit(self) -> dict[str, Any] | None:
        return _summary(self.orbit)

    def _other_orbit(self) -> dict[str, Any] | None:
        return _summary(self.other_orbit)


def _summary(cycle: LimitCycle | None) -> dict[str, Any] | None:
    names = ("period", "stable", "residual", "peak_to_peak")
    return None if cycle is None else {name: getattr(cycle, name) for name in names}


@dataclass(frozen=True, eq=False, repr=False)
class DesignBounds(Listing[BoundCell]):
    """Bounds on one parameter at a row of values of another; behaves as a sequence of cells.

    Attributes
    ----------
    case, over, limit : str
        The case, the parameter that runs, and the one that is bounded.
    units : dict of str to str
        SI unit of both.
    readable : dict of str to (str, float)
        The unit that people use for both, and the factor from SI to it.
    own : dict of str to float
        Their values in the case [SI], of those that it has.
    within : (float, float)
        Range in which bounds were sought [SI].
    cells : tuple of BoundCell
        One at each value of the parameter that runs.
    margin : float
        How far from each bound it was tested, relative to it.
    allowed : Allowed or None
        The largest stable cycle that is allowed; None where no cycle is allowed.
    not_covered : str
        What the bounds of a sampled loop do not cover, in a sentence; empty for other loops.
    step : float or None
        Step in which bounds are printed, rounded to their safe side, in the unit that people use; by default the
        largest 1, 2 or 5 of a decimal place that gives away 2 % of the smallest at most.
    operating_point : OperatingPoint or None
        Where the case holds the external inputs; with a parameter that moves them, at the case's own value of it.
    """

    case: str
    over: str
    limit: str
    units: dict[str, str]
    readable: dict[str, tuple[str, float]]
    own: dict[str, float]
    within: tuple[float, float]
    cells: tuple[BoundCell, ...]
    margin: float = _NAN
    allowed: Allowed | None = None
    not_covered: str = ""
    step: float | None = None

    parts = "cells"
    in_json = "over limit units within allowed status not_covered cells operating_point provenance"

    @property
    def status(self) -> Status:
        """CONVERGED where every cell has a verified bound (or a reason to have none), else UNDECIDED.

        INCOMPLETE where all have, but by the search for limit cycles alone, of which `not_covered` says the limits.
        """
        good = all(c.verified or c.finding.answers for c in self.cells)
        if good and self.not_covered:
            return Status.INCOMPLETE
        return Status.CONVERGED if good else Status.UNDECIDED

    @property
    def printed(self) -> Printed:
        """How its bounds are printed."""
        return Printed.of([c.printed for c in self.cells], self.readable[self.limit], self.step)

    def array(self, name: str) -> Array:
        """The number called `name` of every cell, nan where it has none."""
        return np.array([getattr(c, name) for c in self.cells], float)

    def to_dataset(self) -> xarray.Dataset:
        """An xarray Dataset over the parameter that runs, with units, and the status of every cell."""
        import json

        import xarray

        unit = self.units[self.limit]
        columns: dict[str, Any] = {
            name: (self.over, self.array(name), {"units": unit})
            for name in ("first_order", "exact", "searched", "bound", "safe_value", "other_value")
        }
        columns |= {
            "frequency": (self.over, self.array("frequency"), {"units": "Hz"}),
            "verified": (self.over, np.array([c.verified for c in self.cells])),
            **{name: (self.over, at, {"units": unit}) for name, at in self._proved().items()},
            "n_runs": (self.over, np.array([c.n_runs for c in self.cells])),
            "n_settled": (self.over, np.array([c.n_settled for c in self.cells])),
            "finding": (self.over, np.array([c.finding.value for c in self.cells], object)),
            "message": (self.over, np.array([c.message for c in self.cells], object)),
        }
        names = sorted({name for c in self.cells for name in c.elasticities})
        if names:
            values = [[c.elasticities.get(name, _NAN) for name in names] for c in self.cells]
            columns["elasticity"] = ((self.over, "parameter"), np.array(values), {"units": "1"})
        return xarray.Dataset(
            columns,
            coords={
                self.over: (self.over, self.array("value"), {"units": self.units[self.over]}),
                **({"parameter": names} if names else {}),
            },
            attrs={
                "limit": self.limit,
                "case": self.case,
                "provenance": json.dumps(self.provenance.to_dict(), default=str),
            },
        )

    def __str__(self) -> str:
        """The bounds from the smallest to the largest, how many were verified, and what is missing."""
        found = [c for c in self.cells if math.isfinite(c.bound)]
        at = f"{words(self.over)} {self._span(self.over, [c.value for c in found or self.cells])}"
        if not found:
            places = (f"a {words(self.over)} {self._span(self.over, [c.value], 'of')}" for c in self.cells)
            why = reasons(zip(places, (c.message or c.finding.sentence for c in self.cells), strict=True))
            none = f"No bound on {words(self.limit)}"
            if any(c.finding.is_open for c in self.cells):  # what was not found is not said to be none
                none = f"Undecided: no bound on {words(self.limit)} was found"
            return f"{none} for {at}. {why} {self.not_covered}".rstrip()
        side = " or ".join(name for name, sign in (("below", 1.0), ("above", -1.0)) if sign in {c.sign for c in found})
        verified = sum(c.verified for c in found)
        tested = f"{verified} of {count(len(found), 'bound')} verified by runs and orbits"
        # A picture shows in large letters what is in front of the first semicolon.
        doubt = (
            "" if verified == len(found) or self.not_covered else ", verified in part" if verified else ", not verified"
        )
        unknown = sum(c.finding.is_open for c in self.cells)
        without = len(self) - len(found) - unknown
        none = f"; no bound at {without} of {len(self)} values" * bool(without)
        none += f"; undecided at {unknown} of {len(self)} values, where no bound was found" * bool(unknown)
        which = "limit cycle" if self.allowed is None else self.allowed.exceeded
        free, orbits = "Free of limit cycles" if self.allowed is None else f"No {which}", tested
        if self.not_covered:
            free = f"No {which} was found"
            orbits = f"a cycle was found just beyond {verified} of {count(len(found), 'bound')}"
        limit = self.printed.span([c.printed for c in found])
        return (
            f"{free} {side} a {words(self.limit)} {limit}, for {at}{doubt}; {orbits}{none}. {self.not_covered}"
        ).rstrip() + f" {self.in_theorems}".rstrip()

    @property
    def in_theorems(self) -> str:
        """What is proved of the bounds, in sentences; empty where no proofs were requested."""
        proofs = [(c, c.proved) for c in self.cells if c.proved is not None]
        if not proofs:
            return ""
        both = [p for _, p in proofs if math.isfinite(p.gap)]
        said = [f"{len(both)} of {count(len(proofs), 'bound')} proved on both sides"]
        if both:
            said[0] += f", {percent(max(p.gap for p in both))} apart at most"
        said += [f"{sum(math.isfinite(p.free) for _, p in proofs)} with absence of cycles alone"] * (not both)
        n_ranges = sum(p.free_from != p.free for _, p in proofs if math.isfinite(p.free))
        said += [f"{n_ranges} with one proof for all values on the free side"] * (n_ranges > 0)
        why = dict.fromkeys(p.message for _, p in proofs if p.message)
        return " ".join([f"{'; '.join(said)}.", *why])

    def _proved(self) -> dict[str, Array]:
        """The values at which absence of cycles, and a cycle, are proved; nothing where that was not requested."""
        if all(c.proved is None for c in self.cells):
            return {}
        sides = {"proved_free": "free", "proved_cycle": "cycle"}
        return {name: np.array([getattr(c.proved, side, _NAN) for c in self.cells]) for name, side in sides.items()}

    @checked
    def write_certificates(self, folder: str | Path) -> list[Path]:
        """Write all proofs into a folder, of absence and of cycles, one a file, as `check_certificate` reads them.

        Raises
        ------
        EppError
            If there are none, or the folder cannot be written.
        """
        named = [(f"{self.over}={c.value:.6g}", c.proved) for c in self.cells if c.proved is not None]
        return write_proofs(folder, named, self.in_theorems)

    def _span(self, name: str, values: list[float], *words: str) -> str:
        """From where to where values of a parameter run, in the unit that people use for it."""
        return span(values, self.units[name], self.readable[name], *words)

    def to_frame(self) -> pandas.DataFrame:
        """The bounds, one a row [SI]."""
        names = ("first_order", *["searched" if self.not_covered else "exact"], "bound")
        proved = self._proved()
        rows = [
            {
                self.over: c.value,
                **{name: getattr(c, name) for name in names},
                "frequency": c.frequency,
                "verified": c.verified,
                **{name: at[i] for name, at in proved.items()},
                "finding": c.finding.value,
            }
            for i, c in enumerate(self.cells)
        ]
        limit = dict.fromkeys((*names, *proved), self.units[self.limit])
        return frame_of(rows, {self.over: self.units[self.over], **limit, "frequency": "Hz"})

    def in_brief(self) -> pandas.DataFrame:
        """The bounds in the units that people use for both parameters."""
        (x_unit, x), (y_unit, y) = self.readable[self.over], self.readable[self.limit]
        heads = ("DF", f"bound on {words(self.limit)}", "as computed")
        first, best, computed = (with_unit(text, y_unit) for text in heads)
        rows = [
            {
                with_unit(words(self.over), x_unit): x * c.value,
                first: y * c.first_order,
                best: self.printed.digits(c.printed),
                computed: self.printed.figures(c.printed),
                "verified": c.verified if c.finding is Finding.BOUND else None,
            }
            for c in self.cells
        ]
        return frame_of(rows)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The boundary: describing function, exact, and where runs confirmed it."""
        return self.drawn("plot_bounds", ax)

    @checked
    def plot_elasticities(self, ax: Axes | None = None, cell: int = 0) -> Axes:
        """Tornado of the elasticities in one cell."""
        return self.drawn("plot_tornado", ax, cell)
