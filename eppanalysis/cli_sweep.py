"""The command ``eppanalysis sweep``: a grid or sample of a case, stored chunk by chunk, and its picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eppanalysis.cli_common import NOTHING, CaseName, Settings, load_case, split_pair
from eppanalysis.errors import EppError

if TYPE_CHECKING:
    import xarray

    from eppanalysis.sweep.axes import Axes

_FILES = (".zarr", ".nc", ".png", ".svg", ".pdf")

AxesOption = Annotated[
    list[str],
    typer.Option(
        "--axis",
        metavar="FIELD=AXIS",
        help='start:stop:count:unit, as in bands.range=1:5:41:lbf, or values, as in lock_pin.backlash="0.5 deg,2 deg"; '
        "of a sample low:high:unit. Repeatable.",
    ),
]
RunOption = Annotated[
    list[str], typer.Option("--run", metavar="VERB", help="simulate, predict or cycles; repeatable. [simulate]")
]
SignalsOption = Annotated[
    list[str], typer.Option("--signal", metavar="NAME", help="Signals to report; repeatable; all for every one.")
]
Design = Annotated[
    str,
    typer.Option("--design", metavar="DESIGN", help="grid, zip, latin (hypercube), sobol or tolerances."),
]
Scheduler = Annotated[
    str, typer.Option(metavar="WHERE", help="threads, processes, or a Dask scheduler's address (tcp://host:8786).")
]
Target = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FILE",
        help="A Zarr folder (.zarr), which goes on where it was; or a table (.nc) or picture (.png, .svg, .pdf).",
        show_default=False,
    ),
]


def sweep(
    case: CaseName,
    axes: AxesOption = NOTHING,
    settings: Settings = NOTHING,
    run: RunOption = NOTHING,
    signals: SignalsOption = NOTHING,
    design: Design = "grid",
    n: Annotated[int, typer.Option("--n", help="Cells of a sample.")] = 1024,
    seed: Annotated[int, typer.Option("--seed", help="Seed of a sample.")] = 0,
    scheduler: Scheduler = "threads",
    workers: Annotated[int | None, typer.Option(help="Threads or processes. [one a core]", show_default=False)] = None,
    chunk: Annotated[int | None, typer.Option(help="Cells stored together.", show_default=False)] = None,
    resume: Annotated[bool, typer.Option("--resume/--no-resume", help="Go on with a store that is there.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
    output: Target = None,
) -> None:
    """Sweep a grid or a sample of a case: outcome, amplitude and frequency of every cell.

    Stop it at any moment, or kill it: with a Zarr folder as output the same command goes on where it was.
    """
    from eppanalysis.sweep import sweep as run_sweep

    _check_output(output)
    found = load_case(case, settings)
    wanted: Any = signals or None
    store = output if output is not None and output.suffix == ".zarr" else None
    try:
        dataset = run_sweep(
            found,
            _axes(axes, design, n, seed),
            run or "simulate",
            signals="all" if wanted == ["all"] else wanted,
            scheduler=scheduler,
            workers=workers,
            chunk=chunk,
            store=store,
            resume=resume,
        )
    except KeyboardInterrupt:
        where = "what is done is kept; the same command goes on." if store else "nothing is kept without -o FILE.zarr."
        typer.echo(f"Interrupted: {where}", err=True)
        raise typer.Exit(130) from None
    if output is not None and store is None:
        _write(dataset, output)
    _report(dataset, output, as_json)


def _axes(texts: Sequence[str], design: str, n: int, seed: int) -> Axes:
    """Axes of the command line: "start:stop:count:unit" and "low:high:unit" as they are, lists at their commas."""
    from eppanalysis.sweep import LatinHypercube, Sobol, Tolerances, Zipped

    pairs = [split_pair(item, "--axis", "FIELD=start:stop:count:unit") for item in texts]
    if len({name for name, _ in pairs}) < len(pairs):
        raise EppError("--axis: a field is given twice; expected each once.")
    ranges = dict(pairs)
    lists: dict[str, Any] = {k: v if ":" in v else [x.strip() for x in v.split(",") if x.strip()] for k, v in pairs}
    if design == "grid":
        return lists
    if design == "zip":
        return Zipped(lists)
    if design == "latin":
        return LatinHypercube(ranges, n, seed)
    if design == "sobol":
        return Sobol(ranges, n, seed)
    if design == "tolerances":
        if ranges:
            raise EppError("--axis: has no place in a sample of tolerances; expected the tolerances in the case file.")
        return Tolerances(n, seed)
    raise EppError(f"--design {design}: is not known; expected grid, zip, latin, sobol or tolerances.")


def _check_output(output: Path | None) -> None:
    from eppanalysis.export import check_target

    if output is None:
        return
    if output.suffix == ".zarr":
        if not output.absolute().parent.is_dir():
            raise EppError(f"{output}: the folder {str(output.parent)!r} does not exist; expected an existing one.")
        return
    check_target(output, _FILES)


def _write(dataset: xarray.Dataset, output: Path) -> None:
    from eppanalysis.export import write_dataset, write_figure

    if output.suffix.lower() == ".nc":
        write_dataset(dataset.assign(message=dataset["message"].astype(object)), output)
    else:
        from eppanalysis.plots_map import plot_design_map

        write_figure(plot_design_map(dataset), output)


def _report(dataset: xarray.Dataset, output: Path | None, as_json: bool) -> None:
    """How many cells ended how, and the first sentence of those that failed."""
    import json

    import numpy as np

    counts = {}
    for name in ("outcome", "predicted_outcome", "exact_outcome", "status"):
        if name in dataset:
            words = dataset[name].attrs["flag_meanings"].split()
            codes, numbers = np.unique(dataset[name].values, return_counts=True)
            counts[name] = {words[int(c)]: int(k) for c, k in zip(codes, numbers, strict=True)}
    cells = int(dataset["status"].size)
    if as_json:
        typer.echo(json.dumps({"cells": cells, **counts, "output": None if output is None else str(output)}, indent=2))
        return
    for name, found in counts.items():
        parts = ", ".join(f"{number} {word.replace('_', ' ')}" for word, number in found.items())
        typer.echo(f"{name.replace('_', ' ')} of {cells} cells: {parts}")
    messages = dataset["message"].values
    failed = np.flatnonzero(messages.ravel() != "")
    if failed.size:
        typer.echo(f"first failure: {messages.ravel()[failed[0]]}")
