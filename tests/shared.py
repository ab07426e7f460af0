"""What tests of several files look at: dear results, computed once in a process, and loops."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import eppanalysis as epp

if TYPE_CHECKING:
    from pathlib import Path

    import click
    from matplotlib.figure import Figure


def mostly_slow(values: Iterable[Any], quick: Collection[Any]) -> list[Any]:
    """The values of a parametrisation, all but a few of which are the slow tier's."""
    held = [(value, value if isinstance(value, tuple) else (value,)) for value in values]
    return [value if value in quick else pytest.param(*row, marks=pytest.mark.slow) for value, row in held]


@cache
def command_line() -> click.Group:
    """The command line as typer makes it, once in a process as its users do."""
    from typer.main import get_command

    from eppanalysis.cli.commands import app

    return get_command(app)


def said_above(figure: Figure) -> tuple[str, str]:
    """The verdict that stands in bold above a picture, and what stands small below it, each on one line."""
    small = " ".join(text for artist in figure.artists if (text := getattr(artist, "get_text", str)()))
    return " ".join(figure.get_suptitle().split()), " ".join(small.split())


def touching(figure: Figure) -> Iterator[str]:
    """Numbers of an axis that run into each other."""
    for axis in (axis for ax in figure.axes if ax.axison for axis in (ax.xaxis, ax.yaxis)):
        texts = [label for label in axis.get_ticklabels(which="both") if label.get_text() and label.get_visible()]
        boxes = [text.get_window_extent() for text in texts]
        places = sorted(range(len(boxes)), key=lambda i: (boxes[i].x0, boxes[i].y0))
        yield from (
            f"{texts[i].get_text()} {texts[j].get_text()}"
            for i, j in pairwise(places)
            if axis is axis.axes.xaxis and boxes[i].x1 > boxes[j].x0
        )


@cache
def shipped() -> dict[str, epp.Case]:
    """The cases that ship, for those who choose among them before any test begins."""
    return {name: epp.case(name) for name in epp.shipped_cases()}


def of_kind(*kinds: str) -> list[str]:
    """Names of the shipped cases of some kinds."""
    return [name for name, case in shipped().items() if case.kind in kinds]


@cache
def predicted(name: str) -> epp.Prediction:
    """What first order predicts for a shipped case."""
    return epp.predict_limit_cycles(epp.case(name))


def of_unknown_response() -> epp.Case:
    """The relay loop of a shipped case, but its relay reads two more signals: it has no describing function."""
    loop = epp.case("relay_ideal_khalil79").to_system()
    build = epp.AutomatonBuilder(n_inputs=3)
    low, high = build.mode("low", constant=-1.0), build.mode("high", constant=1.0)
    build.guard("rises", low, high, on_input=1.0)
    build.guard("falls", high, low, on_input=-1.0)
    relay, C = epp.AutomatonElement(build.build()), np.vstack([loop.C, np.zeros((2, len(loop.A)))])
    return epp.Case.from_system(
        epp.LureSystem.build(loop.A, loop.B, C, [relay], x0=loop.x0), "three_signals", t_end=99.0
    )


@cache
def cycles_of(name: str) -> epp.CycleSearch:
    """All limit cycles of a shipped case."""
    return epp.find_limit_cycles(epp.case(name))


def draw_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let identification draw enough to see what happens, not to rely on intervals."""
    from eppanalysis.identify import sampling, step, surface

    for place, name, least in (
        (step, "STARTS", 30), (step, "KEPT_STARTS", (4, 2, 1, 1, 1)), (step, "ROUNDS", 1), (surface, "ROUNDS", 2),
        (sampling, "CHAINS", 10), (sampling, "BEFORE", 10), (sampling, "TURNS", 10), (sampling, "_PLACES", 16),
        (sampling, "_TURNS", 6),
    ):  # fmt: skip
        monkeypatch.setattr(place, name, least)


def conveyor(tmp_path: Path) -> epp.Case:
    """A drive with two masses that rests unless it is struck."""
    path = tmp_path / "conveyor.toml"
    path.write_text(
        """
kind = "diagram"
title = "Conveyor drive with two masses"
connect = [
  "setpoint - load -> pid", "pid - gear -> motor", "motor -> angle", "angle - load -> gear.twist",
  "motor - load_speed -> gear.rate", "gear -> load_speed", "load_speed -> load",
]
inputs = { setpoint = "0 rad" }
[blocks]
pid = { kind = "pi", kp = "3 N*m/rad", ti = "0.5 s" }
motor = { kind = "transfer_function", num = [1], den = [0.002, 0.05] }
angle = { kind = "integrator" }
load_speed = { kind = "transfer_function", num = [1], den = [0.006, 0.02] }
load = { kind = "integrator" }
[elements]
gear = { element = "lock_pin", gap = "2 deg", stiffness = "50 N*m/rad", damping = "0.1 N*m*s/rad" }
[run]
t_end = "20 s"
"""
    )
    return epp.read_case(path)
