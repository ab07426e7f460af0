"""Pictures of the page on identification, from the recordings that ship."""

from __future__ import annotations

from pathlib import Path

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from studies import GENERATED


def make_all(folder: Path) -> None:
    """One picture for each test."""
    measured = shipped_cases_folder() / "measured"
    tests = {"tray": "weight_tray.csv", "backlash": "backlash_cycling.csv", "step": "step_response.csv"}
    found = epp.identify(epp.case("elbow"), **{test: measured / name for test, name in tests.items()})
    for test, fit in zip(tests, found.fits, strict=True):
        fit.plot().figure.savefig(folder / f"identify_{test}.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
