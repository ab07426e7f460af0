"""Dear results that tests of several files look at, computed once in a process."""

from __future__ import annotations

from functools import cache

from matplotlib.figure import Figure

import eppanalysis as epp


def said_above(figure: Figure) -> tuple[str, str]:
    """The verdict that stands in bold above a picture, and what stands small below it, each on one line."""
    small = " ".join(text for artist in figure.artists if (text := getattr(artist, "get_text", str)()))
    return " ".join(figure.get_suptitle().split()), " ".join(small.split())


@cache
def predicted(name: str) -> epp.Prediction:
    """What first order predicts for a shipped case."""
    return epp.predict_limit_cycles(epp.case(name))


@cache
def cycles_of(name: str) -> epp.CycleSearch:
    """All limit cycles of a shipped case."""
    return epp.find_limit_cycles(epp.case(name))
