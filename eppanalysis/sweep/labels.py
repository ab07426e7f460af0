"""What pictures of sweeps share: outcomes and their words, units of axes, the verdict above a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.plotting import put_verdict
from eppanalysis.readable import in_print, span, with_unit, words
from eppanalysis.sweep.analyses import PREFIX, Analysis

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


#: Of the variables of each analysis, the surest first.
PREFIXES = tuple(PREFIX[analysis] for analysis in (Analysis.SIMULATE, Analysis.CYCLES, Analysis.PREDICT))


def is_sized(cells: xarray.Dataset) -> bool:
    """Whether a sweep knows a limit cycle that is allowed."""
    return "allowed" in cells.attrs


def outcomes_in(cells: xarray.Dataset) -> list[str]:
    """What says how a cell ends: that of the run first; beside a cycle that is allowed where there is one."""
    kind = "allowed" if is_sized(cells) else "outcome"
    return [f"{prefix}{kind}" for prefix in PREFIXES if f"{prefix}{kind}" in cells]


#: Of maps that hold no answer, and what gives one.
UNKNOWN = "Unknown: the run neither settles nor repeats itself by its end (run.t_end)."


def in_words_of(cells: xarray.Dataset, name: str) -> str:
    """In how many of the designs the loop does what, or what is proved of it, the most first."""
    values, counts = np.unique(cells[name].values, return_counts=True)
    parts = [f"{meanings(cells[name])[int(values[k])]} in {counts[k]}" for k in np.argsort(-counts, kind="stable")]
    return ", ".join([f"{parts[0]} of {counts.sum()} designs", *parts[1:]])


def put_verdict_of(figure: Figure, cells: xarray.Dataset, details: str = "") -> None:
    """What the loop does in the designs that are drawn, above their picture."""
    name = next((n for n in ("proved", *outcomes_in(cells)) if n in cells), None)
    verdict = in_words_of(cells, name).capitalize() if name and cells[name].size else ""
    allowed = f"allowed is {cells.attrs['allowed']}" if is_sized(cells) else ""
    small = ", ".join(filter(None, (allowed, details)))
    if verdict.startswith("Unknown") and name == "outcome":
        small = f"{small}. {UNKNOWN}" if small else UNKNOWN
    put_verdict(figure, verdict, small, str(cells.attrs.get("case", "")))


def meanings(outcome: xarray.DataArray) -> list[str]:
    """What each number of an outcome means."""
    return [words(word) for word in str(outcome.attrs["flag_meanings"]).split()]


def factor_of(dataset: xarray.Dataset, name: str) -> float:
    """From SI to the unit in which people read the axis."""
    shown = dataset[name].attrs.get("per_readable_unit")
    return 1.0 / float(shown) if shown else 1.0


def unit_of(dataset: xarray.Dataset, name: str) -> str:
    """The unit in which people read the axis."""
    attrs = dataset[name].attrs
    return attrs.get("readable_units" if attrs.get("per_readable_unit") else "units", "")


def readable_axis(dataset: xarray.Dataset, name: str) -> tuple[np.ndarray, str]:
    """Values of an axis as people read them, and its label."""
    return dataset[name].values * factor_of(dataset, name), with_unit(words(name), in_print(unit_of(dataset, name)))


def place_in(dataset: xarray.Dataset, name: str, i: int) -> str:
    """A value of an axis with its unit."""
    if name not in dataset.coords:
        return str(i)
    return f"{float(dataset[name].values[i]) * factor_of(dataset, name):.4g} {in_print(unit_of(dataset, name))}".strip()


def ranges_of(dataset: xarray.Dataset) -> str:
    """From where to where the parameters of a sweep run, each in the unit in which people read it."""
    parts = []
    for name in map(str, dataset.coords):
        values = dataset[name].values
        if values.ndim == 1 and values.dtype.kind == "f":
            shown = in_print(unit_of(dataset, name)), factor_of(dataset, name)
            parts.append(f"{words(name)} {span(values, '', shown)}")
    return "; ".join(parts)
