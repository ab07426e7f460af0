"""The commands ``eppanalysis cycles`` and ``eppanalysis branch``: all exact limit cycles, and how they change."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eppanalysis.errors import EppError

if TYPE_CHECKING:
    from eppanalysis.case import Case
    from eppanalysis.methods.continuation import Branch
    from eppanalysis.methods.cycles import CycleSearch

_NONE: list[str] = []
_PICTURES = (".png", ".svg", ".pdf")

CaseName = Annotated[str, typer.Argument(metavar="CASE", help="Case file (TOML), or name of a shipped case.")]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="FIELD=VALUE", help="Override a field of the case; repeatable.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON in SI units instead of tables.")]
Picture = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="Write a picture (.png, .svg, .pdf).", show_default=False),
]


def cycles(
    case: CaseName,
    settings: Settings = _NONE,
    knocks: Annotated[bool, typer.Option("--knock", help="Also the smallest knocks that start a cycle.")] = False,
    as_json: Json = False,
) -> None:
    """Find all limit cycles exactly, stable and unstable, and how completeness was sought."""
    from eppanalysis.methods.cycles import find_limit_cycles
    from eppanalysis.methods.knock import knock

    found = _load(case, settings)
    system, value = found.to_system(), found.final_input()
    search = find_limit_cycles(system, value)
    hits = knock(system, cycles=search) if knocks else ()
    if as_json:
        _print_json("cycles", found, {**search.to_dict(), "knocks": [k.to_dict() for k in hits]})
        return
    _show_cycles(found, search)
    for hit in hits:
        typer.echo(f"knock: {hit.name} by {hit.size:.6g} (SI) starts a cycle; {hit.settles:.6g} settles.")


def branch(
    case: CaseName,
    over: Annotated[str, typer.Option("--over", metavar="FIELD", help="The parameter, as in bands.range.")],
    start: Annotated[str, typer.Option("--from", metavar="VALUE", help="Where the branch begins.")],
    stop: Annotated[str, typer.Option("--to", metavar="VALUE", help="Where it ends.")],
    settings: Settings = _NONE,
    points: Annotated[int, typer.Option("--points", help="At most so many orbits.")] = 200,
    as_json: Json = False,
    output: Picture = None,
) -> None:
    """Follow a limit cycle over a parameter, through folds, and name every special point."""
    from eppanalysis.methods.continuation import continue_branch

    if output is not None and output.suffix.lower() not in _PICTURES:
        raise EppError(f"{output}: is not a picture; expected a name that ends in {', '.join(_PICTURES)}.")
    found = _load(case, settings)
    result = continue_branch(found, over, start, stop, n_points=points)
    if as_json:
        _print_json("branch", found, result.to_dict())
    else:
        _show_branch(found, over, result)
    if output is not None:
        result.plot(found.expected.signal).savefig(output)


def _load(text: str, settings: list[str]) -> Case:
    """The case of a file or of a shipped name, with the fields of ``--set`` in place."""
    from eppanalysis.case import case, read_case

    found = read_case(text) if text.endswith(".toml") or Path(text).is_file() else case(text)
    values = {}
    for item in settings:
        name, separator, value = item.partition("=")
        if not separator or not name.strip():
            raise EppError(f"--set {item}: has no field and value; expected FIELD=VALUE.")
        values[name.strip()] = value.strip()
    return found.with_values(values, "--set") if values else found


def _show_cycles(case: Case, search: CycleSearch) -> None:
    n = len(search)
    typer.secho(f"{case.name}: {case.title}", bold=True)
    typer.echo(f"{n or 'no'} limit cycle{'' if n == 1 else 's'}. {search.status.value} Sought with {search.search}")
    for cycle in search:
        name = case.expected.signal or next(iter(cycle.peak_to_peak))
        kind = "stable  " if cycle.stable else "unstable"
        typer.echo(
            f"  {kind}  period {cycle.period:.10g} s  frequency {cycle.frequency:.6g} Hz  {name} "
            f"{cycle.peak_to_peak[name]:.8g} {cycle.units[name]} peak to peak  {cycle.stability_criterion}"
        )


def _show_branch(case: Case, over: str, result: Branch) -> None:
    value = result.points["value"]
    typer.secho(f"{case.name}: {case.title}", bold=True)
    low, high = (case.text(over, float(v)) for v in (value.min(), value.max()))
    typer.echo(f"{len(result)} orbits over {over} between {low} and {high}. {result.message}")
    for special in result.special:
        typer.echo(f"  {special.kind} at {case.text(over, special.value, 10)}: {special.note}")


def _print_json(command: str, case: Case, result: dict[str, Any]) -> None:
    from eppanalysis import __version__

    entry = {"name": case.name, "title": case.title, "kind": case.kind, "result": result}
    document = {"eppanalysis": __version__, "command": command, "cases": [entry]}
    sys.stdout.write(json.dumps(_plain(document), indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def _plain(value: Any) -> Any:
    """Plain JSON: what is not finite as null."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    return value
