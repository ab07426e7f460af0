"""Every kind of parameter of the elbow as the limit, as a stored table: ``python -m studies.limits``.

It takes a quarter of an hour, so that its result is kept in ``_static/limits.md`` and shown from there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import eppanalysis as epp
from eppanalysis.limits import cut
from eppanalysis.methods.bounds.result import BoundCell
from eppanalysis.readable import in_print
from studies import STORED

RESULT = STORED / "limits.md"
HEADER = ("bounded", "at", "free of cycles", "DF", "exact", "tested at", "at rest")
BACKLASH, GAIN = "lock_pin.backlash", "bands.range"


@dataclass(frozen=True)
class Job:
    """One call of ``design_bounds``: what is bounded, over what, at which values, sought where."""

    limit: str
    over: str
    at: tuple[str, ...]
    within: tuple[str, str]
    given: dict[str, str] = field(default_factory=dict)
    margin: float = 0.01

    @property
    def case(self) -> epp.Case:
        """The original elbow with what is given."""
        return epp.case("fig8a_original").with_values(self.given)


JOBS = (
    Job(GAIN, BACKLASH, ("1 deg",), ("2 lbf", "3 lbf")),
    Job("cable.stiffness", BACKLASH, ("1.5 deg",), ("4000 N/m", "7000 N/m")),
    Job("forearm.prehensor_mass", BACKLASH, ("0.97 deg",), ("0.3 kg", "0.8 kg")),
    Job("controller.delay", BACKLASH, ("0.97 deg",), ("1 ms", "3 ms"), margin=0.2),
    Job("pulley.friction", GAIN, ("1.5 lbf",), ("0.01", "0.06"), {BACKLASH: "0.5 deg"}, margin=0.05),
    Job("bands.parking_width", BACKLASH, ("0.9 deg",), ("0.1 lbf", "0.3 lbf")),
    Job("drive.inertia", BACKLASH, ("0.96 deg",), ("0.025 kg*m^2", "0.045 kg*m^2")),
    Job("bands.max", BACKLASH, ("1 deg",), ("3.6 lbf", "4.2 lbf")),
    Job("drive.stall_torque", BACKLASH, ("0.9 deg",), ("8 N*m", "16 N*m")),
    Job(BACKLASH, GAIN, ("2.5 lbf",), ("0.5 deg", "2 deg")),
)


def line(job: Job, cell: BoundCell) -> tuple[str, ...]:
    """One line of the table."""
    case = job.case

    def text(value: float) -> str:
        return in_print(case.text(job.limit, value, 4)) if math.isfinite(value) else "–"

    def on_the_safe_side(value: float) -> float:
        in_shown = float(case.text(job.limit, 1.0, 15).split()[0])
        return cut(in_shown * value, 4, up=cell.sign < 0) / in_shown

    at = f"{job.over} {case.text(job.over, cell.value, 4)}"
    at += "".join(f", {name} {value}" for name, value in job.given.items())
    side = {1.0: "below", -1.0: "above"}[cell.sign] if cell.finding == "bound" else cell.finding
    runs = str(cell.n_settled) if cell.verified else cell.message
    tested = f"± {100 * job.margin:g} %" if cell.n_runs else "–"
    return (job.limit, at, side, text(cell.first_order), text(on_the_safe_side(cell.exact)), tested, runs)


def cells(job: Job, starts: int = 1000) -> epp.DesignBounds:
    """The bounds of a job."""
    return epp.design_bounds(
        job.case, job.over, job.limit, at=job.at, within=job.within, margin=job.margin, starts=starts
    )


def main() -> None:
    """All jobs; the table is written anew after each, as together they take long."""
    lines = [HEADER, ("---",) * len(HEADER)]
    for job in JOBS:
        lines += [line(job, cell) for cell in cells(job)]
        RESULT.write_text("".join(f"| {' | '.join(row)} |\n" for row in lines), encoding="utf-8")


if __name__ == "__main__":
    main()
