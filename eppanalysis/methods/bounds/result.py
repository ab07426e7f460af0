"""What design bounds return: a cell for every value of the parameter that runs, in SI units, with its tests."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.results import Brief, LimitCycle, Result, Status

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
_NAN = float("nan")


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
        "A limit cycle exists at both ends of the range of the limiting parameter, but not at all values between: ask "
        "for a narrower range, which begins or ends among these.",
    )
    UNSURE = (
        "unsure",
        "Whether a limit cycle exists in the range of the limiting parameter is not known: the exact search found none "
        "at some values, but left runs undecided there.",
    )
    SCALES = (
        "scales",
        "The loop's cycles scale with this parameter alone: a cycle at one value is a cycle at every other one, larger "
        "or smaller in proportion, so no finite bound on it exists.",
    )
    IDLE = (
        "idle",
        "The loop of this case does not depend on this parameter (another field may stand in its place), so nothing "
        "bounds it.",
    )
    BEYOND = "beyond", "The bound lies beyond the range of the limiting parameter: cycles exist down to the end of it."
    FAILED = "failed", "The bound could not be computed: no start led to a solution."

    @property
    def answers(self) -> bool:
        """Whether it says why there is no bound, so that none is missing."""
        return self in (self.NONE, self.ALWAYS, self.BETWEEN, self.SCALES, self.IDLE, self.BEYOND)


class Turn(StrEnum):
    """Where a family of exact orbits ends."""

    UNKNOWN = ""
    FOLD = "fold"
    CORNER = "border collision"
    #: Cycles exist up to the end of the range.
    END = "end"


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
    first_order, harmonic, exact : float
        The bound by describing functions, by harmonic balance of order `order`, and exactly [SI]; nan where unknown,
        or where its cycles go on to the end of the range.
    order : int
    error_estimate : float
        Largest relative difference of the harmonic bound from those of the orders from half of it on.
    kind : Turn
        Fold or border collision of the branch of exact orbits.
    frequency : float
        Of the cycle at the bound [Hz].
    safe_value, other_value : float
        Where the tests were made [SI].
    n_runs, n_settled, n_cycles : int
        Runs on the safe side, those that came to rest, and limit cycles that the search or the runs found there.
    verified : bool
        No limit cycle on the safe side, an exact orbit on the other.
    orbit, other_orbit : LimitCycle or None
        The exact orbit at the bound, and on the other side.
    elasticities, harmonic_elasticities : dict of str to float
        Relative change of the exact bound, and of the harmonic one, for a relative change of each parameter.
    message : str
        What is missing, or why there is no bound.
    """

    value: float
    finding: Finding
    sign: float = 1.0
    first_order: float = _NAN
    harmonic: float = _NAN
    order: int = 0
    error_estimate: float = _NAN
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
    elasticities: dict[str, float] = field(default_factory=dict)
    harmonic_elasticities: dict[str, float] = field(default_factory=dict)
    message: str = ""

    in_json = (
        "value finding sign first_order harmonic order error_estimate exact kind frequency bound "
        "first_order_error harmonic_error first_order_unsafe safe_value other_value n_runs n_settled n_cycles "
        "verified elasticities harmonic_elasticities message orbit=_orbit "
        "other_orbit=_other_orbit"
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "finding", Finding(self.finding))
        object.__setattr__(self, "kind", Turn(self.kind))

    @property
    def bound(self) -> float:
        """The best value that is known: exact, else by harmonic balance; nan where there is none."""
        if self.finding is not Finding.BOUND:
            return _NAN
        return self.exact if math.isfinite(self.exact) else self.harmonic

    @property
    def first_order_error(self) -> float:
        """Relative difference of the first-order bound from the best one."""
        return self.first_order / self.bound - 1.0

    @property
    def harmonic_error(self) -> float:
        """Relative difference of the harmonic bound from the exact one."""
        return self.harmonic / self.exact - 1.0

    @property
    def first_order_unsafe(self) -> bool:
        """Whether first order calls designs free of limit cycles that are not."""
        return bool(self.sign * self.first_order_error > 0)

    def _orbit(self) -> dict[str, Any] | None:
        return _summary(self.orbit)

    def _other_orbit(self) -> dict[str, Any] | None:
        return _summary(self.other_orbit)


def _summary(cycle: LimitCycle | None) -> dict[str, Any] | None:
    names = ("period", "stable", "residual", "peak_to_peak")
    return None if cycle is None else {name: getattr(cycle, name) for name in names}


@dataclass(frozen=True, eq=False, repr=False)
class DesignBounds(Result):
    """Bounds on one parameter at a row of values of another; behaves as a sequence of cells.

    Attributes
    ----------
    case : str
    over, limit : str
        The parameter that runs, and the one that is bounded.
    units : dict of str to str
        SI unit of both.
    readable : dict of str to (str, float)
        The unit that people use for both, and the factor from SI to it.
    own : dict of str to float
        Their values in the case [SI], of those that it has.
    within : (float, float)
        Range in which bounds were sought [SI].
    cells : tuple of BoundCell
    margin : float
        How far from each bound it was tested, relative to it.
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

    in_json = "over limit units within status cells operating_point provenance"

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, i: int) -> BoundCell:
        return self.cells[i]

    def __iter__(self):
        return iter(self.cells)

    @property
    def status(self) -> Status:
        """CONVERGED where every cell has a verified bound (or a reason to have none), else UNDECIDED."""
        good = all(c.verified or c.finding.answers for c in self.cells)
        return Status.CONVERGED if good else Status.UNDECIDED

    def array(self, name: str) -> Array:
        """A number of every cell."""
        return np.array([getattr(c, name) for c in self.cells], float)

    def to_dataset(self) -> xarray.Dataset:
        """An xarray Dataset over the parameter that runs, with units, and the status of every cell."""
        import json

        import xarray

        unit = self.units[self.limit]
        columns: dict[str, Any] = {
            name: (self.over, self.array(name), {"units": unit})
            for name in ("first_order", "harmonic", "exact", "bound", "safe_value", "other_value")
        }
        columns |= {
            "order": (self.over, np.array([c.order for c in self.cells])),
            "frequency": (self.over, self.array("frequency"), {"units": "Hz"}),
            "verified": (self.over, np.array([c.verified for c in self.cells])),
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

    def plot(self) -> Figure:
        """The boundary: first order, harmonic balance, exact, and where runs confirmed it."""
        return self.drawn("plot_bounds")

    def plot_elasticities(self, cell: int = 0) -> Figure:
        """Tornado of the elasticities in one cell."""
        return self.drawn("plot_tornado", cell)
