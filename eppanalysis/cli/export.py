"""The command ``eppanalysis export``: a case as a unit for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from eppanalysis.cli.common import NOTHING, CaseName, Settings, check_output, echo, file_option, load_case


def export(
    case: CaseName,
    output: Annotated[Path, file_option("The unit (.fmu).")],
    settings: Settings = NOTHING,
    fmi: Annotated[int, typer.Option(help="Version of FMI, 2 or 3.")] = 2,
) -> None:
    """Write a Co-Simulation unit (FMU), which other tools run with the event-exact engine, on this kind of computer.

    Its inputs are offsets, added to what the case does with its external inputs, and held over a communication step.
    """
    from eppanalysis.fmu.export import to_fmu

    check_output(output, (".fmu",))
    echo(f"{to_fmu(load_case(case, settings), output, version=fmi)}: written.")
