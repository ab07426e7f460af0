"""Pictures that take a minute to compute: ``python -m studies.pages.stored [NAME...]``; names pick pictures.

They are kept in ``docs/_static``, drawn by the lines of their pages from the files that readers save there.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable

from matplotlib.figure import Figure

import eppanalysis as epp
from eppanalysis.plotting import figure_of
from studies import DOCS, STORED

ELBOW = "fig8a_original"


def case_on(page: str, name: str, place: int = 0) -> epp.Case:
    """The case of a block of TOML on a page, counted from 0."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    return epp.case_from_text(re.findall(r"^```toml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)[place], name=name)


def fig8a_original() -> Figure:
    """Of the README and of the quickstart."""
    return figure_of(epp.ladder(epp.case(ELBOW)).plot())


def _bounds() -> epp.DesignBounds:
    at = {"start": "2 lbf", "stop": "3 lbf", "points": 5}
    return epp.design_bounds(epp.case(ELBOW), "bands.range", "lock_pin.backlash", **at)


def bounds_original() -> Figure:
    """The bound on the elbow's backlash."""
    return figure_of(_bounds().plot())


def bounds_tornado() -> Figure:
    """Its elasticities."""
    return figure_of(_bounds().plot_elasticities(cell=2))


def sweep_map() -> Figure:
    """Where the elbow oscillates, with the region without limit cycles and what describing functions say of it."""
    case = epp.case(ELBOW)
    found = epp.sweep(case, {"bands.range": "1:5:81:lbf", "lock_pin.backlash": "0:3:61:deg"}, progress=False)
    region = epp.free_region(case, {"bands.range": "1:5:2:lbf", "lock_pin.backlash": "0:3:2:deg"})
    coarse = {"bands.range": "1:5:9:lbf", "lock_pin.backlash": "0:3:7:deg"}
    return epp.plot_design_map(found, curves=[region, epp.outcome_boundary(case, coarse, "predict")])


def sweep_slices() -> Figure:
    """Amplitude and frequency over the backlash."""
    axes = {"bands.range": "2:4:3:lbf", "lock_pin.backlash": "0:3:31:deg"}
    return epp.plot_slices(epp.sweep(epp.case(ELBOW), axes, progress=False))


def sweep_sample() -> Figure:
    """A sample over four parameters."""
    ranges = {"bands.range": "1:5:lbf", "lock_pin.backlash": "0:3:deg"}
    ranges |= {"forearm.inertia": "0.03:0.06:kg*m^2", "cable.stiffness": "4000:9000:N/m"}
    return epp.plot_parallel(epp.sweep(epp.case(ELBOW), epp.Sobol(ranges, 256), progress=False))


def design_lead() -> Figure:
    """The largest gain without a limit cycle over the lead."""
    tune = {"k": (1.0, 20.0), "T": (0.0, 2.0)}
    return figure_of(epp.design(case_on("howto/design", "servo"), tune, maximise="k").plot())


def design_front() -> Figure:
    """The largest bandwidth without a limit cycle over the backlash."""
    case, tune = case_on("howto/design", "two_mass", 1), {"Kp": ("5 1/s", "100 1/s")}
    front = {"gap": [f"{gap} deg" for gap in (0.25, 0.5, 1, 2)]}
    return figure_of(epp.design(case, tune, maximise="bandwidth", front=front).plot())


PICTURES: tuple[Callable[[], Figure], ...] = (
    fig8a_original,
    bounds_original,
    bounds_tornado,
    sweep_map,
    sweep_slices,
    sweep_sample,
    design_lead,
    design_front,
)


if __name__ == "__main__":
    for make in PICTURES:
        if make.__name__ in (sys.argv[1:] or [make.__name__]):
            make().savefig(STORED / f"{make.__name__}.png", dpi=150, metadata={"Software": None})
