"""What a case should give: known limit cycles, published numbers, the finding of an experiment."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from eppanalysis.results import Outcome

if TYPE_CHECKING:
    from eppanalysis.cases.schema import CycleAnswer, ExpectedSection


@dataclass(frozen=True)
class Cycle:
    """A known limit cycle of the signal that the case names.

    Attributes
    ----------
    amplitude : float
        Half the peak-to-peak of an exact cycle, the amplitude of the sine of a first-order one [unit of the signal].
    omega, period : float
        [rad/s], [s]; per sample and in samples when the loop is in discrete time with a step of one.
    mean, middle : float or None
        Mean over time, and halfway between the extremes [unit of the signal].
    fundamental : float or None
        Amplitude of the fundamental [unit of the signal].
    stable : bool or None
    largest_multiplier : float or None
        Largest modulus of the Floquet multipliers, without the one that belongs to the motion along the cycle.
    also : dict of str to float
        Further numbers of the cycle, by name.
    """

    amplitude: float
    omega: float
    period: float
    mean: float | None = None
    middle: float | None = None
    fundamental: float | None = None
    stable: bool | None = None
    largest_multiplier: float | None = None
    also: dict[str, float] = field(default_factory=dict)


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
    """What a case should give.

    Attributes
    ----------
    outcome : Outcome or None
        Of the simulated run.
    signal : str or None
        Signal that the amplitudes are of.
    describing_function, exact : tuple of Cycle, or None
        All first-order cycles and the known exact ones; empty when there are none, None when the case does not say.
    published : tuple of Published
    paper, finding, source, note : str
        Figure of the paper, what it shows, where the answers come from, remarks.
    """

    outcome: Outcome | None = None
    signal: str | None = None
    describing_function: tuple[Cycle, ...] | None = None
    exact: tuple[Cycle, ...] | None = None
    published: tuple[Published, ...] = ()
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
