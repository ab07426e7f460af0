"""What a case should give: known limit cycles, published numbers, the finding of an experiment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from eppanalysis.results import Outcome

if TYPE_CHECKING:
    from eppanalysis.cases.schema import CycleAnswer, ExpectedSection


@dataclass(frozen=True)
class Cycle:
    """A known limit cycle of the signal that the case names."""

    #: Half the peak-to-peak of an exact cycle, the amplitude of the sine of a DF one [unit of the signal].
    amplitude: float
    #: omega, period: [rad/s], [s]; per sample and in samples when the loop is in discrete time with a step of one.
    omega: float
    period: float
    #: mean, middle: mean over time, and halfway between the extremes [unit of the signal].
    mean: float | None = None
    middle: float | None = None
    fundamental: float | None = None  # amplitude of the fundamental [unit of the signal]
    stable: bool | None = None
    #: Largest modulus of the Floquet multipliers, without the one that belongs to the motion along the cycle.
    largest_multiplier: float | None = None
    also: dict[str, float] = field(default_factory=dict)  # further numbers of the cycle, by name


@dataclass(frozen=True)
class Published:
    """A number from the literature; `how_known` says whether it was read in the source."""

    quantity: str
    value: float
    source: str
    how_known: str = ""
    confirmed: bool = False


@dataclass(frozen=True)
class Expected:
    """What a case should give."""

    outcome: Outcome | None = None  # of the simulated run
    signal: str | None = None  # signal that the amplitudes are of
    #: describing_function, exact: all DF cycles and the known exact ones; empty when there are none, None when
    #: the case does not say.
    describing_function: tuple[Cycle, ...] | None = None
    exact: tuple[Cycle, ...] | None = None
    published: tuple[Published, ...] = ()
    #: paper, finding, source, note: figure of the paper, what it shows, where the answers come from, remarks.
    paper: str = ""
    finding: str = ""
    source: str = ""
    note: str = ""


def make_expected(section: ExpectedSection) -> Expected:
    """The frozen noun of a validated section."""
    return Expected(
        None if section.outcome is None else Outcome(section.outcome),
        section.signal,
        _cycles(section.describing_function),
        _cycles(section.exact),
        tuple(Published(p.quantity, p.value, p.source, p.how_known, p.confirmed) for p in section.published),
        section.paper,
        section.finding,
        section.source,
        section.note,
    )


def _cycles(answers: list[CycleAnswer] | None) -> tuple[Cycle, ...] | None:
    if answers is None:
        return None
    return tuple(
        Cycle(
            a.amplitude,
            a.omega,
            a.period if a.period is not None else 6.283185307179586 / a.omega,
            a.mean,
            a.middle,
            a.fundamental,
            a.stable,
            a.largest_multiplier,
            dict(a.also),
        )
        for a in answers
    )
