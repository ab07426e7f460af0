"""All rungs of the ladder for all shipped cases, with the error against the exact cycle, to a table.

``python -m studies.ladder`` makes ``docs/_static/ladder.csv`` afresh (some minutes): what ``eppanalysis validate``
shows of each case.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import eppanalysis as epp
from eppanalysis.models.systems.sampled.strobe import is_sampled
from eppanalysis.results import Status
from studies import STORED
from studies.stored_tables import read_rows, write_rows

TABLE = STORED / "ladder.csv"
METHODS = ("describing function", "harmonic balance", "exact orbit", "simulation")


@dataclass(frozen=True)
class Row:
    """One rung of one case (numbers are nan where it has no cycle).

    Attributes
    ----------
    case, signal : str
    method : str
        As the ladder calls it: with the order of a balance, or the stability.
    exact : int
        Number of the exact cycle that the rung belongs to, -1 for none.
    frequency, peak_to_peak : float
        Of the signal [Hz, SI].
    error_period, error_size : float
        Relative errors against the exact cycle.
    note : str
    """

    case: str
    signal: str
    method: str
    exact: int
    frequency: float
    peak_to_peak: float
    error_period: float
    error_size: float
    note: str


def covered() -> tuple[str, ...]:
    """Shipped cases that a ladder climbs: all but those with sampled controllers."""
    return tuple(name for name in epp.shipped_cases() if not is_sampled(epp.case(name).to_system().elements))


def study() -> Iterator[list[Row]]:
    """Rows of one case after the other."""
    for name in covered():
        sys.stderr.write(f"{name}\n")
        yield rows_of(name)


def rows_of(name: str) -> list[Row]:
    """Rows of one case."""
    found = epp.ladder(epp.case(name))
    rows = []
    for r in found.rows:
        frequency, size = (r.quantities[k] for k in ("frequency", "peak-to-peak"))
        rows.append(
            Row(
                case=name,
                signal=found.signal,
                method=r.method,
                exact=-1 if r.exact is None else r.exact,
                frequency=_or_nan(frequency),
                peak_to_peak=_or_nan(size),
                error_period=r.errors.get("period", float("nan")),
                error_size=r.errors.get("peak-to-peak", float("nan")),
                note=r.note,
            )
        )
    return rows


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def write(rows: Sequence[Row], path: Path = TABLE) -> None:
    """Rows to the stored table."""
    write_rows(rows, Row, path, __file__)


def read(path: Path = TABLE) -> list[Row]:
    """Rows of the stored table."""
    return read_rows(Row, path)


def table() -> tuple[list[str], list[list[str]]]:
    """One line for each exact cycle, and for each prediction or balance that no exact cycle belongs to."""
    rows = read()
    lines = []
    for name in dict.fromkeys(r.case for r in rows):
        own = [r for r in rows if r.case == name]
        cycles = [[r for r in own if r.exact == number] for number in sorted({r.exact for r in own if r.exact >= 0})]
        alone = [rungs[0] for rungs in cycles if len(rungs) == 1 and rungs[0].note and "unstable" in rungs[0].method]
        several = len(alone) > 1
        lines += [_line(name, rungs) for rungs in cycles if not (several and rungs[0] in alone)]
        if several:
            low, high = (f(r.frequency for r in alone) for f in (min, max))
            span = " to ".join(dict.fromkeys((f"{low:.4g}", f"{high:.4g}")))
            lines.append([f"`{name}`", f"{len(alone)} unstable", span, "", "", "by search", ""])
        lines += [_line(name, [r]) for r in own if r.exact < 0 and np.isfinite(r.frequency)]
        if not any(np.isfinite(r.frequency) for r in own):
            lines.append(
                [
                    f"`{name}`",
                    "no cycle",
                    "",
                    "",
                    "",
                    "",
                    Status(own[-1].note).name.lower().replace("settled", "settles"),
                ]
            )
    first, balance, exact, run = METHODS
    return ["case", "cycle", "frequency [Hz]", f"{first} [%]", f"{balance} [%]", exact, f"{run} [%]"], lines


def _line(name: str, rungs: Sequence[Row]) -> list[str]:
    best = rungs[-1]
    exact = next((r for r in rungs if r.method.startswith("exact")), None)
    if exact is None:
        what = "not real" if best.method.startswith(METHODS[:2]) else "not closed"
    else:
        what = exact.method.split(", ")[-1]
    cells = [_cell([r for r in rungs if r.method.startswith(m)]) for m in METHODS]
    return [f"`{name}`", what, f"{(exact or best).frequency:.5g}", *cells]


def _cell(rungs: Sequence[Row]) -> str:
    """Errors in period and size [%], or how an exact cycle was come to."""
    if not rungs:
        return ""
    rung = rungs[0]
    if rung.method.startswith("exact"):
        return "by search" if rung.note else "closed"
    order = [rung.method.split(", ")[-1].replace("order ", "n = ")] if rung.method.startswith("harmonic") else []
    if np.isfinite(rung.error_period):
        order.append(f"{_percent(rung.error_period)} / {_percent(rung.error_size)}")
    return ", ".join(order) or "predicted"


def _percent(error: float) -> str:
    """Two digits of a relative error in per cent; "0" where it is rounding."""
    if abs(error) < 1e-9:
        return "0"
    return f"{100.0 * error:+.2g}" if abs(error) >= 1e-5 else "< 0.001"


if __name__ == "__main__":
    found: list[Row] = []
    for some in study():
        found += some
        write(found)
