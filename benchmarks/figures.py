"""Tables and pictures of the page on benchmarks, from the result of ``python -m benchmarks``.

Made by the Sphinx build, or by ``python -m benchmarks.figures``.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks import report
from eppanalysis.plotting import BLUE, GREEN, GREY, VERMILLION, figure_of_height, panels_of, put_legend

DOCS = Path(__file__).parents[1] / "docs"
RESULT = DOCS / "_static" / "benchmarks.json"

Results = dict[str, Any]

#: Rivals of the picture of accuracy, by how their names begin.
KINDS = {
    "eppanalysis": (VERMILLION, "*", 160),
    "numba ": (GREEN, "s", 40),
    "scipy event machine": (BLUE, "D", 40),
    "scipy solve_ivp": (BLUE, "o", 25),
    "python-control": (GREY, "^", 30),
    "CasADi": ("tab:purple", "v", 30),
    "diffrax": ("tab:brown", "<", 30),
    "scikit-sundae": ("tab:pink", ">", 30),
    "numbalsoda": ("black", "P", 40),
}


def accuracy(results: Results) -> Figure:
    """Time against error of everything that was tried in job A."""
    figure = figure_of_height(4.6)
    ax = figure.subplots()
    job = results["job_a"]
    points = [(r["name"], r["error"], r["seconds"]) for r in job["rows"]]
    points += [(r["library"], r["error"], r["seconds"]) for r in job["tried"] if r.get("error") is not None]
    for kind, (colour, marker, size) in KINDS.items():
        chosen = [(e, s) for name, e, s in points if name.startswith(kind) and e and s]
        if chosen:
            ax.scatter(
                *zip(*chosen, strict=True), s=size, c=colour, marker=marker, label=kind.strip(), alpha=0.8, linewidths=0
            )
    ax.set(xscale="log", yscale="log", xlabel="largest error of theta [rad]", ylabel="time [s]", xlim=(None, 0.2))
    ax.grid(alpha=0.3)
    put_legend(ax)
    return figure


def _curve(
    ax: Axes, x: list[float], y: list[float], names: tuple[str, str], label: str = "", colour: str = BLUE
) -> None:
    ax.loglog(x, y, "o-", color=colour, label=label or None)
    ax.set(xlabel=names[0], ylabel=names[1])
    ax.grid(alpha=0.3)


def growth(results: Results) -> Figure:
    """Time against states, events per second, and cells."""
    figure, (first, second, third) = panels_of(3, 1.7)
    states, events, cells = (results["growth"][k] for k in ("states", "events", "cells"))
    n = [r["states"] for r in states]
    _curve(first, n, [r["seconds"] for r in states], ("states", "time of 6 s [s]"), "engine", VERMILLION)
    theirs = [r["seconds"] * r["ratio"] for r in states]
    _curve(first, n, theirs, ("states", "time of 6 s [s]"), "scipy DOP853, rtol 1e-06")
    first.set_xticks(n, [str(k) for k in n])
    first.minorticks_off()
    put_legend(first)
    rates = [r["events_per_second"] for r in events]
    _curve(second, rates, [r["seconds"] for r in events], ("events per second", "time of 6 s [s]"), "", VERMILLION)
    second.set_ylim(1e-5, 1e-2)  # a scale on which scatter looks like scatter
    count = [r["cells"] for r in cells]
    _curve(third, count, [r["seconds"] for r in cells], ("cells", "time [s]"), "one thread", VERMILLION)
    two = [r["seconds"] / r["speedup_two_threads"] for r in cells]
    _curve(third, count, two, ("cells", "time [s]"), "two threads", GREEN)
    put_legend(third)
    return figure


#: Pictures by the part of the results that they show.
PICTURES: dict[str, Callable[[Results], Figure]] = {"accuracy": accuracy, "growth": growth}


def make_all(folder: Path, result: Path = RESULT) -> None:
    """Write every table and picture."""
    results = json.loads(result.read_text(encoding="utf-8"))
    (folder / "benchmarks_setting.md").write_text(report.setting(results), encoding="utf-8")
    for name, table in report.tables(results).items():
        (folder / f"benchmarks_{name}.md").write_text(table, encoding="utf-8")
    for name, draw in PICTURES.items():
        draw(results).savefig(folder / f"benchmarks_{name}.png", dpi=150)


if __name__ == "__main__":
    generated = DOCS / "_generated"
    generated.mkdir(exist_ok=True)
    make_all(generated)
