"""The command ``eppanalysis sweep``: a grid or sample of a case, stored chunk by chunk, and its picture."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eppanalysis.cli.common import (
    NOTHING,
    Allow,
    CaseName,
    Found,
    Json,
    Settings,
    check_output,
    echo,
    file_option,
    load_case,
    print_json,
    progress,
    split_pair,
)
from eppanalysis.cli.ends import exit_code
from eppanalysis.errors import EppError
from eppanalysis.readable import count

if TYPE_CHECKING:
    import xarray

    from eppanalysis.cases import Case
    from eppanalysis.sweep.axes import Axes
    from eppanalysis.sweep.boundary import Boundary

_PICTURES = (".png", ".svg", ".pdf")
_THREADS = "threads"
#: Cells of a sample; a power of two, as a Sobol sample takes it.
_CELLS = 1024
#: Values along each axis of the grid from which a boundary is refined.
_COARSE = 11


def _schedulers() -> list[str]:
    """What ``--scheduler`` takes beside addresses."""
    from eppanalysis.sweep.schedule import QUEUES, Scheduler as Here

    return [*Here, *QUEUES]


class Run(StrEnum):
    """What is carried out in every cell."""

    SIMULATE = "simulate"
    PREDICT = "predict"
    CYCLES = "cycles"
    TRIGGER = "trigger"
    CERTIFY = "certify"
    ALL = "all"


class Design(StrEnum):
    """Which cells there are."""

    GRID = "grid"
    ZIP = "zip"
    LATIN = "latin"
    SOBOL = "sobol"
    TOLERANCES = "tolerances"


class Kind(StrEnum):
    """What a boundary on a map is of."""

    FREE = "free"
    PREDICT = "predict"
    CYCLES = "cycles"
    SIMULATE = "simulate"


#: Exit code of a join to which shares are missing: run it again (EX_TEMPFAIL of sysexits.h).
INCOMPLETE = 75
#: Defaults of options that may be repeated.
NO_RUNS: list[Run] = []
NO_KINDS: list[Kind] = []
AxesOption = Annotated[
    list[str],
    typer.Option(
        "--axis",
        metavar="FIELD=AXIS",
        help="A field (eppanalysis check lists them) with start:stop:count:unit, as in bands.range=1:5:41:lbf, or with "
        'values, as in lock_pin.backlash="0.5 deg,2 deg"; of a sample low:high:unit. Without a unit: SI. Repeatable.',
    ),
]
RunOption = Annotated[
    list[Run],
    typer.Option("--run", metavar="METHOD", help=f"Analyses: {', '.join(Run)}; repeatable.", show_default="simulate"),
]
SignalsOption = Annotated[
    list[str], typer.Option("--signal", metavar="NAME", help="Signals to report; repeatable; all for every one.")
]
DesignOption = Annotated[
    Design,
    typer.Option(
        "--design",
        metavar="KIND",
        help="Which cells: grid, zip (axes that move together), or a sample: latin (hypercube), sobol, tolerances (of "
        "the case file).",
    ),
]
Scheduler = Annotated[
    str,
    typer.Option(
        metavar="WHERE",
        help="threads, processes, a queue (slurm, pbs, ...), or a Dask scheduler's address (tcp://host:8786).",
        autocompletion=lambda incomplete: [name for name in _schedulers() if name.startswith(incomplete)],
    ),
]
Target = Annotated[
    Path | None,
    file_option(
        "A Zarr folder (.zarr), which an interrupted sweep continues; or a table (.nc) or picture (.png, .svg, .pdf)."
    ),
]
Picture = Annotated[Path | None, file_option("Also a picture (.png, .svg, .pdf).", "--picture")]
ShardOption = Annotated[
    str | None,
    typer.Option(
        metavar="I/N",
        help="Compute the share I of N alone, in a separate store beside the output; several machines do one each.",
        show_default=False,
    ),
]
Boundaries = Annotated[
    list[Kind],
    typer.Option(
        "--boundary",
        metavar="KIND",
        help="Draw a boundary on the map: free (round the region without a limit cycle, exact; without one larger than "
        "allowed beside --allow), predict (describing functions), cycles (exact orbits) or simulate; takes minutes. "
        "Repeatable.",
    ),
]


def sweep(
    case: CaseName,
    axes: AxesOption = NOTHING,
    settings: Settings = NOTHING,
    run: RunOption = NO_RUNS,
    signals: SignalsOption = NOTHING,
    allow: Allow = None,
    design: DesignOption = Design.GRID,
    n: Annotated[int | None, typer.Option("--n", help="Cells of a sample.", show_default="1024")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of a sample.")] = 0,
    scheduler: Scheduler = _THREADS,
    workers: Annotated[int | None, typer.Option(help="Threads or processes.", show_default="one per core")] = None,
    chunk: Annotated[int | None, typer.Option(help="Cells stored together.", show_default=False)] = None,
    resume: Annotated[bool, typer.Option("--resume/--no-resume", help="Continue an existing store.")] = True,
    shard: ShardOption = None,
    merge: Annotated[
        bool,
        typer.Option("--merge", help="Join the shares beside the output; exit code 75 where cells are missing."),
    ] = False,
    estimate: Annotated[
        bool, typer.Option("--estimate", help="Compute a sample of the cells alone, and estimate the cost of all.")
    ] = False,
    as_json: Json = False,
    output: Target = None,
    picture: Picture = None,
    boundaries: Boundaries = NO_KINDS,
) -> None:
    """Sweep a grid or a sample of a case: outcome, peak to peak and frequency of every cell.

    Stop it at any moment, or kill it: with a Zarr folder as output the same command goes on where it was.
    """
    from eppanalysis.sweep import sweep as run_sweep

    if output is not None and output.suffix.lower() in _PICTURES:
        output, picture = None, picture or output
    _check_output(output, picture)
    found, over = load_case(case, settings), _axes(axes, design, n, seed)
    _check_boundaries(boundaries, over, picture)
    if estimate:
        asked = {"run": _one_or_more(run) or Run.SIMULATE, "signals": _one_or_more(signals), "allow": allow}
        _print_cost(found, over, asked, as_json, settings)
        return
    store = output if output is not None and output.suffix == ".zarr" else None
    try:
        dataset = run_sweep(
            found,
            over,
            _one_or_more(run) or Run.SIMULATE,
            signals=_one_or_more(signals),
            allow=allow,
            scheduler=scheduler,
            workers=workers,
            chunk=chunk,
            store=store,
            resume=resume,
            shard=shard,
            merge=merge,
        )
        curves = [_boundary(found, over, kind, allow, scheduler, workers) for kind in boundaries]
    except KeyboardInterrupt:
        where = "what is done is kept; the same command goes on." if store else "nothing is kept without -o FILE.zarr."
        echo(f"Interrupted: {where}", err=True)
        if scheduler == _THREADS:  # which would first finish their blocks, for a minute if need be; a store bears it
            sys.stdout.flush()
            os._exit(exit_code())
        raise typer.Exit(130) from None
    _write(dataset, None if store else output, picture, curves)
    counts = _counts(dataset)
    if as_json:
        files = {"output": output, "picture": picture}
        shown = {name: None if path is None else str(path) for name, path in files.items()}
        summary = {**counts, **shown, "boundaries": [curve.to_dict() for curve in curves]}
        print_json("sweep", [(found, Found(" ".join(_sentences(dataset, counts)), summary))], settings)
    else:
        _report(dataset, counts, curves)
    if merge and "not_run" in counts["status"]:
        echo("Not all shares are finished; the same command joins the rest later.", err=True)
        raise typer.Exit(INCOMPLETE)


def _print_cost(case: Case, axes: Axes, asked: dict[str, Any], as_json: bool, settings: Sequence[str]) -> None:
    """What a sweep will cost."""
    from eppanalysis.sweep import sweep_cost

    cost = sweep_cost(case, axes, **asked)
    if as_json:
        print_json("sweep", [(case, Found(str(cost), {"estimate": cost.to_dict()}))], settings)
    else:
        echo(str(cost))


def _axes(texts: Sequence[str], design: Design, n: int | None, seed: int) -> Axes:
    """Axes of the command line: "start:stop:count:unit" and "low:high:unit" as they are, lists at their commas."""
    from eppanalysis.sweep import LatinHypercube, Sobol, Tolerances, Zipped

    pairs = [split_pair(item, "--axis", "FIELD=start:stop:count:unit") for item in texts]
    if len({name for name, _ in pairs}) < len(pairs):
        raise EppError("--axis: a field is given twice; expected each once.")
    ranges = dict(pairs)
    lists: dict[str, Any] = {
        k: v if ":" in v or ".." in v else [x.strip() for x in v.split(",") if x.strip()] for k, v in pairs
    }
    if design in (Design.GRID, Design.ZIP):
        if n is not None:
            raise EppError(f"--n {n}: is of a sample; expected --design latin, sobol or tolerances beside it.")
        return lists if design is Design.GRID else Zipped(lists)
    n = _CELLS if n is None else n
    if design is Design.LATIN:
        return LatinHypercube(ranges, n, seed)
    if design is Design.SOBOL:
        return Sobol(ranges, n, seed)
    if ranges:
        raise EppError("--axis: has no place in a sample of tolerances; expected the tolerances in the case file.")
    return Tolerances(n, seed)


def _one_or_more(names: Sequence[str]) -> Any:
    """Names as a sweep takes them: "all" must be alone."""
    return names[0] if len(names) == 1 else tuple(names) or None


def _check_output(output: Path | None, picture: Path | None) -> None:
    if output is not None and output.suffix == ".zarr":
        if not output.absolute().parent.is_dir():
            raise EppError(f"{output}: the folder {str(output.parent)!r} does not exist; expected an existing one.")
    elif output is not None:
        check_output(output, (".zarr", ".nc", *_PICTURES))
    if picture is not None:
        check_output(picture, _PICTURES)


def _check_boundaries(kinds: Sequence[Kind], axes: Axes, picture: Path | None) -> None:
    if kinds and not (isinstance(axes, dict) and len(axes) == 2 and picture is not None):
        raise EppError("--boundary: is drawn on a map of a grid of two axes; expected two --axis and a picture.")


def _boundary(case: Case, axes: Axes, kind: Kind, allow: str | None, scheduler: str, workers: int | None) -> Boundary:
    """A boundary over the map's axes, from a grid of its own that is coarse."""
    import numpy as np

    from eppanalysis.sweep.axes import make_design
    from eppanalysis.sweep.boundary import free_region, outcome_boundary

    given = {k: v for d in make_design(case, axes).dimensions for k, v in d.values.items()}
    coarse = {k: np.linspace(v.min(), v.max(), _COARSE).tolist() for k, v in given.items()}
    if kind is Kind.FREE:
        with progress(f"border {case.name}") as advance:
            return free_region(case, coarse, allow=allow, progress=advance)
    return outcome_boundary(case, coarse, kind, allow=allow, scheduler=scheduler, workers=workers)


def _write(dataset: xarray.Dataset, table: Path | None, picture: Path | None, curves: Sequence[Boundary]) -> None:
    from eppanalysis.tables.files import write_dataset, write_figure

    if table is not None:
        write_dataset(dataset.assign(message=dataset["message"].astype(object)), table)
    if picture is not None:
        from eppanalysis.sweep.picture import plot_sweep

        write_figure(plot_sweep(dataset, curves), picture)


def _counts(dataset: xarray.Dataset) -> dict[str, Any]:
    """How many cells there are, and how many of them ended how."""
    import numpy as np

    counts: dict[str, Any] = {"cells": int(dataset["status"].size)}
    outcomes = [f"{prefix}{kind}" for kind in ("outcome", "allowed") for prefix in ("", "predicted_", "exact_")]
    for name in (*outcomes, "exact_stability", "trigger_outcome", "status"):
        if name in dataset:
            words = dataset[name].attrs["flag_meanings"].split()
            codes, numbers = np.unique(dataset[name].values, return_counts=True)
            counts[name] = {words[int(c)]: int(k) for c, k in zip(codes, numbers, strict=True)}
    return counts


def _sentences(dataset: xarray.Dataset, counts: dict[str, Any]) -> Iterator[str]:
    """What was swept, and how the cells ended."""
    from eppanalysis.sweep.labels import in_words_of, ranges_of

    yield f"{count(counts['cells'], 'design')}: {ranges_of(dataset)}"
    for name, found in counts.items():
        if name != "cells" and (name != "status" or {"failed", "not_run"} & set(found)):
            yield f"{name.replace('_', ' ')}: {in_words_of(dataset, name)}"


def _report(dataset: xarray.Dataset, counts: dict[str, Any], curves: Sequence[Boundary]) -> None:
    """What was swept, how the cells ended, what the boundaries are, and the first sentence of the cells that failed."""
    import numpy as np

    from eppanalysis.sweep.labels import UNKNOWN

    for sentence in _sentences(dataset, counts):
        echo(sentence)
    if "unknown" in counts.get("outcome", ()):
        echo(UNKNOWN)
    if "allowed" in dataset.attrs:
        echo(f"Allowed is a stable limit cycle up to {dataset.attrs['allowed']}.")
    for curve in curves:
        echo(f"boundary ({curve.label}): {curve.message}")
    if "failed" in counts["status"]:
        messages = dataset["message"].values.ravel()
        echo(f"first failure: {messages[np.flatnonzero(messages != '')[0]]}")
