"""Pictures of the how-to pages: ``python -m studies.pages.howto``."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

import eppanalysis as epp
from studies import GENERATED


def own_device_branch() -> Figure:
    """Cycles of the wheelchair over its free play."""
    return epp.continue_branch(epp.case("wheelchair"), "play.gap", start=0.012, stop=0.004).plot("play_input")


def own_device_map() -> Figure:
    """Where the wheelchair settles, over gain and free play."""
    axes = {"loop.gain": "0.5:1.2:22", "play.gap": "0:0.02:21"}
    return epp.plot_design_map(epp.sweep(epp.case("wheelchair"), axes, progress=False))


def make_all(folder: Path) -> None:
    """Make every picture."""
    for make in (own_device_branch, own_device_map):
        make().savefig(folder / f"{make.__name__}.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
