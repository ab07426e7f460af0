"""What a bench test gives: estimates with their intervals, what the data could not identify, residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array
from eppanalysis.readable import count, in_print, words
from eppanalysis.results import PlainData, Result, Status
from eppanalysis.shown import frame_of
from eppanalysis.units import format_si

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Share of repeated experiments in which an interval holds the true value.
LEVEL = 0.95


@dataclass(frozen=True)
class Estimate(PlainData):
    """A parameter from measured data.

    Attributes
    ----------
    name : str
        Field of the case file ("pulley.friction"), or plain words for what is no field of it.
    value, low, high : float
        Estimate and ends of its 95 % interval, in `unit`.
    unit, friendly : str
        SI unit, and the unit that people use.
    identified : bool
        Whether the data identify it; where they do not, the interval says how little, and the case keeps its own value.
    note : str
        What the value rests on, or why it could not be identified.
    kept : bool
        Whether the case takes the value although it is identified only together with another one that the case keeps.

    Examples
    --------
    >>> str(Estimate("lock_pin.backlash", 0.0436, 0.0432, 0.0442, "rad", "deg"))
    'lock_pin.backlash = 2.498 deg, 95 % interval 2.475 deg to 2.532 deg'
    """

    name: str
    value: float
    low: float
    high: float
    unit: str = ""
    friendly: str = ""
    identified: bool = True
    note: str = ""
    kept: bool = False

    in_json = "value low high unit identified note"

    @property
    def tolerance(self) -> float:
        """Half width of an interval about the value that holds the estimate's own interval."""
        return max(self.high - self.value, self.value - self.low)

    @property
    def relative_width(self) -> float:
        """Half the interval over the value; over the larger end where the value is zero, 0 where both are."""
        size = abs(self.value) or max(abs(self.low), abs(self.high))
        return 0.5 * (self.high - self.low) / size if size else 0.0

    def text(self, value: float, digits: int = 4) -> str:
        """A value of this parameter as people write it."""
        return in_print(format_si(value, self.unit, self.friendly or self.unit, digits))

    def __str__(self) -> str:
        interval = f"{self.text(self.low)} to {self.text(self.high)}"
        return f"{self.name} = {self.text(self.value)}, {LEVEL:.0%} interval {interval}".replace("95%", "95 %")


@dataclass(frozen=True)
class Residual:
    """What a fit leaves of one measured column."""

    rms: float  # in `unit`
    autocorrelation: float  # of neighbouring samples; near zero where the model leaves nothing but noise
    drift: float  # linear drift that was fitted beside the model, in `unit` over the whole record
    unit: str


@dataclass(frozen=True, eq=False, repr=False)
class BenchFit(Result):
    """Result of one bench test.

    Attributes
    ----------
    bench : str
        "weight tray", "backlash cycling" or "step response".
    source : str
        The measured file.
    estimates : tuple of Estimate
    residuals : dict of str to Residual
        By the role of the column.
    notes : tuple of str
        What else there is to know, a sentence each.
    n_rows, n_used : int
        Rows in the file; points that were fitted.
    status : Status
    curves : mapping
        What the picture needs: ``panels`` of measured points and fit, by role.
    """

    bench: str
    source: str
    estimates: tuple[Estimate, ...]
    residuals: dict[str, Residual]
    notes: tuple[str, ...] = ()
    n_rows: int = 0
    n_used: int = 0
    status: Status = Status.CONVERGED
    curves: Mapping[str, Any] = field(default_factory=dict)

    in_json = (
        "bench source status message estimates=_by_name unidentified=_unidentified_names "
        "limited_by residuals notes n_rows n_used provenance"
    )

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(name)

    @property
    def unidentified(self) -> tuple[Estimate, ...]:
        """What the data could not identify."""
        return tuple(e for e in self.estimates if not e.identified)

    @property
    def limited_by(self) -> str:
        """The parameter that the data identify least, relative to its size."""
        return max(self.estimates, key=lambda e: (not e.identified, e.relative_width)).name if self.estimates else ""

    @property
    def message(self) -> str:
        """What the status says of a fit: whether its estimates can be relied on."""
        return self.status.value if self.status.ok else "The estimates are for inspection only: the notes say why."

    def _by_name(self) -> dict[str, Estimate]:
        return {e.name: e for e in self.estimates}

    def _unidentified_names(self) -> list[str]:
        return [e.name for e in self.unidentified]

    def limit_sentence(self) -> str:
        """Which parameter limits the identification, and how well it is known."""
        if not self.estimates:
            return ""
        worst = self[self.limited_by]
        if not worst.identified:
            return f"Limited by {words(worst.name)}: {worst.note}"
        width = worst.relative_width
        known = f"known to ±{100 * width:.2g} %" if width < 1 else "not known better than its own size"
        return f"Limited by {words(worst.name)}, {known}."

    def __str__(self) -> str:
        """How many parameters the test identifies, and which of them it knows least."""
        known = len(self.estimates) - len(self.unidentified)
        ended = "" if self.status.ok else f" {self.message}"
        counts = f"{known} of {count(len(self.estimates), 'parameter')} identified from {count(self.n_used, 'point')}"
        return f"{self.bench[:1].upper()}{self.bench[1:]}: {counts}. {self.limit_sentence()}{ended}".rstrip()

    def to_frame(self) -> pandas.DataFrame:
        """The estimates, one a row, as :func:`estimates_frame` makes it."""
        return estimates_frame(self.estimates)

    def in_brief(self) -> pandas.DataFrame:
        """The estimates in the units that people use for them."""
        return brief_estimates(self.estimates)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Data with the fit, residuals, and the intervals."""
        return self.drawn("plot_bench", ax)


def estimates_frame(estimates: Sequence[Estimate]) -> pandas.DataFrame:
    """Estimates, one a row, each in its SI unit: name, value, ends of the 95 % interval, whether it is identified."""
    names = ("name", "value", "low", "high", "unit", "identified", "note")
    return frame_of([{name: getattr(estimate, name) for name in names} for estimate in estimates])


def brief_estimates(estimates: Sequence[Estimate]) -> pandas.DataFrame:
    """Estimates as texts in the units that people use for them."""
    return frame_of(
        [
            {
                "parameter": words(e.name),
                "estimate": e.text(e.value),
                "95 % interval": f"{e.text(e.low)} to {e.text(e.high)}",
                "identified": e.identified,
            }
            for e in estimates
        ]
    )


def lag_one(residual: Array) -> float:
    """Autocorrelation of neighbours; 0 for what does not vary.

    Examples
    --------
    >>> import numpy as np
    >>> lag_one(np.array([1.0, -1.0, 1.0, -1.0]))
    -0.75
    """
    r = residual - residual.mean() if residual.size else residual
    power = float(r @ r)
    return float(r[1:] @ r[:-1]) / power if power > 0 else 0.0
