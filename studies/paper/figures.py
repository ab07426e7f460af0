"""The picture of the page on what the paper leaves open: ``python -m studies.paper.figures``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import eppanalysis as epp
from eppanalysis.plotting import GREY, ORANGE, SKY, SMALL, VERMILLION, WIDTH, figure_of_height, in_columns
from eppanalysis.readable import words
from studies import GENERATED
from studies.paper import sensitivity


def paper_sensitivity() -> Figure:
    """For each finding and each open parameter: does it hold at 50 to 150 per cent?"""
    names = sensitivity.assumed()
    factors = sensitivity.FACTORS
    n = len(factors)
    table = np.full((len(names), n * len(sensitivity.FINDINGS)), 0)
    for j, finding in enumerate(sensitivity.FINDINGS):
        want = epp.case(finding).expected.outcome
        for name, found in sensitivity.one_at_a_time(finding).items():
            codes = [1 if word == want else 2 if word in ("settle", "oscillate") else 3 for word in found]
            table[names.index(name), n * j : n * (j + 1)] = codes
    meanings = ("given by the paper, or what the finding itself changes", "holds", "flips", "undecided")
    colours = ("#D9D9D9", SKY, VERMILLION, ORANGE)
    figure = figure_of_height(1.6 + 0.18 * len(names))
    ax = figure.subplots()
    ax.pcolormesh(table, cmap=ListedColormap(colours), norm=BoundaryNorm(np.arange(5) - 0.5, 4), edgecolors="white")
    for j in range(1, len(sensitivity.FINDINGS)):
        ax.axvline(n * j, color="black", linewidth=1.2)
    ax.set_yticks(np.arange(len(names)) + 0.5, [words(name) for name in names], fontsize=SMALL)
    ax.set_xticks(n * (np.arange(len(sensitivity.FINDINGS)) + 0.5), range(1, len(sensitivity.FINDINGS) + 1))
    ax.set_xlabel(f"finding; each at {', '.join(f'{100 * (f - 1):+.0f}' for f in factors)} %", fontsize=SMALL)
    ax.invert_yaxis()
    ax.tick_params(length=0)
    there = [
        Patch(facecolor=c, edgecolor=GREY, label=w)
        for i, (w, c) in enumerate(zip(meanings, colours, strict=True))
        if i in table
    ]
    texts, columns = in_columns([str(patch.get_label()) for patch in there], 0.96 * WIDTH)
    figure.legend(there, texts, fontsize=SMALL, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def make_all(folder: Path) -> None:
    """Make the picture."""
    paper_sensitivity().savefig(folder / "paper_sensitivity.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
