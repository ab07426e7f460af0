"""The command ``eppanalysis margins``: how far the linearised loop is from instability, cut wherever one likes."""

from __future__ import annotations

from typing import Annotated

import typer

from eppanalysis.cli.common import (
    NOTHING,
    CaseName,
    Found,
    Json,
    Picture,
    Settings,
    answer,
    check_output,
    echo,
    load_case,
    print_table,
)
from eppanalysis.errors import EppError


def margins(
    case: CaseName,
    at: Annotated[
        list[str],
        typer.Option(
            "--at", metavar="NAME", help="Where to cut the loop, as in gear.out; repeatable.", show_default=False
        ),
    ] = NOTHING,
    settings: Settings = NOTHING,
    as_json: Json = False,
    output: Picture = None,
) -> None:
    """Say gain, phase, disk and delay margins of the linearised loop, cut at any named place."""
    from eppanalysis.methods.margins.linearised import small_signal
    from eppanalysis.methods.margins.margins import margins as margins_at, places_of
    from eppanalysis.tables.console import all_margins_table
    from eppanalysis.tables.files import PICTURES, write_figure

    check_output(output, PICTURES)
    found = load_case(case, settings)
    names = list(at) or list(places_of(found))
    if output is not None and len(names) > 1:
        raise EppError(f"{output}: is one picture for {len(names)} cuts; expected one --at.")
    result = margins_at(found, names)

    def show() -> None:
        for one in result:
            echo(f"{one.headline()}; cut at {one.at}." if one.exist else str(one))
        print_table(all_margins_table(result))
        echo(f"places of the loop: {', '.join(small_signal(found.to_system()).places.distinct)}")

    both = Found(" ".join(map(str, result)), {"margins": [one.to_dict() for one in result]})
    answer("margins", found, settings, as_json, both, show)
    if output is not None:
        write_figure(result[0].plot(), output)
