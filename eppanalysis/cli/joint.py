"""The command ``eppanalysis import joint``: a robot's joint, from URDF or MJCF, to a case file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from eppanalysis.cli.common import NOTHING, by_name, check_output, echo, file_option, split_pair


def joint(
    robot: Annotated[Path, typer.Argument(metavar="FILE", help="Robot model: URDF or MJCF.", show_default=False)],
    name: Annotated[str, typer.Argument(metavar="JOINT", help="A hinge or a slide of it.", show_default=False)],
    output: Annotated[Path | None, file_option("Write it to a case file (.toml).")] = None,
    keyframe: Annotated[str | None, typer.Option(help="Pose of the model by its name.", show_default=False)] = None,
    pose: Annotated[list[str], typer.Option(metavar="JOINT=POSITION", help="As in elbow=90deg; repeatable.")] = NOTHING,
    actuator: Annotated[Path | None, file_option("What the model lacks (.toml), such as ki.", "--actuator")] = None,
    encoder: Annotated[
        str | None, typer.Option(help='Step of the position: "360/4096 deg".', show_default=False)
    ] = None,
    sample_time: Annotated[str | None, typer.Option(help="Of the controller: 1ms.", show_default=False)] = None,
) -> None:
    """Make a case file of the position loop of a robot's joint, each number with its source; print it without -o."""
    check_output(output, (".toml",))
    from eppanalysis.cases.command_line import command
    from eppanalysis.cases.from_robot import from_robot
    from eppanalysis.writing import write_text

    positions = by_name("--pose", (split_pair(text, "--pose", "JOINT=POSITION") for text in pose))
    read = partial(from_robot, robot, name, keyframe=keyframe, pose=positions)
    case = read(actuator=actuator, encoder=encoder, sample_time=sample_time)
    for remark in case.remarks:
        echo(remark, err=True)
    if output is None:
        echo(case.to_toml().rstrip("\n"))
        return
    write_text(case.to_toml(), output)
    echo(f"{output}: {case.title}")
    echo("Next:")
    for step in ("check", "margins", "simulate", "cycles"):
        echo(f"  {command(step, str(output))}")
