"""The pictures of the explorer's page."""

import math

import pytest

pytest.importorskip("bokeh")

from eppanalysis.explorer.figures import BranchPicture, MapPicture


def named(picture) -> list[str]:
    """What a legend names."""
    return [item.label["value"] for item in picture.figure.legend[0].items if item.visible]


def test_a_legend_names_what_there_is():
    picture = BranchPicture("x", "")
    assert named(picture) == []
    pieces = [{"stable": [True, True, False], "value": [1.0, 2.0, 1.5], "size": [3.0, 4.0, 2.0]}]
    picture.show_branch({"pieces": pieces, "begins": []}, "gain", 1.0, 1.0)
    assert named(picture) == ["stable", "unstable"]
    picture.show_exact({"size": [3.0], "stable": [True]}, 1.0, 1.0)
    picture.show_run(1.0, math.nan)
    assert named(picture) == ["stable", "unstable", "exact, stable", "run"]
    picture.show_branch({"pieces": [], "begins": []}, "gain", 1.0, 1.0)
    picture.show_exact(None, 1.0, 1.0)
    assert named(picture) == ["run"]


def test_a_map_names_the_design_and_where_cycles_begin():
    picture = MapPicture("gain", "gap", (0.0, 2.0), (0.0, 1.0))
    colours = ["settles", "oscillates", "diverges", "not decided"]
    assert named(picture) == colours
    picture.show_place(1.0, 0.5)
    picture.show_begins([(0.5, 0.5)])
    assert named(picture) == [*colours, "cycles begin, exactly", "the design: 1, 0.5 (drag or tap)"]
