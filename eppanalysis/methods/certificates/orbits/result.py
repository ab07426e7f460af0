"""What is proved of a periodic orbit: its existence, how near it is the only one, its period, its stability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.certificates.result import WithFile, driven_by

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_NAN = float("nan")


class Proof(Enum):
    """What has become of the proof that a cycle exists; the value is a sentence for people."""

    PROVED = "The cycle is proved to exist."
    VIOLATED = "This is no motion of the loop: its equations close, but an element would have switched otherwise."
    NOT_DECIDED = "Neither is the cycle proved, nor is it refuted."

    @property
    def ok(self) -> bool:
        """Whether the cycle is proved."""
        return self is Proof.PROVED


class OrbitStability(Enum):
    """What is proved of the Floquet multipliers of a cycle."""

    STABLE = "All multipliers but that of the motion along the cycle are proved to lie inside the unit circle: stable."
    ONE_OUTSIDE = "Exactly one multiplier is proved to lie outside the unit circle: unstable."
    SEVERAL_OUTSIDE = "Several multipliers are proved to lie outside the unit circle: unstable."
    NOT_DECIDED = "Stability is not decided."

    @classmethod
    def of(cls, n_outside: int) -> OrbitStability:
        """The statement for so many multipliers outside, all others being inside."""
        return (cls.STABLE, cls.ONE_OUTSIDE, cls.SEVERAL_OUTSIDE)[min(n_outside, 2)]


@dataclass(frozen=True, eq=False, repr=False)
class CertifiedOrbit(WithFile):
    """What is proved of a periodic orbit in ball arithmetic.

    The loop of which it is proved has rational numbers for its floats: the decimals that were given, and simple
    fractions for what was computed (see :func:`certify_orbit`).

    Attributes
    ----------
    status : Proof
        PROVED, VIOLATED where an element is shown to switch otherwise, or NOT_DECIDED.
    message : str
        Why it is not proved; empty where it is.
    period : float
        Period [s]; nan where nothing is proved.
    period_ball : str
        Ball that holds the period [s], as ``[middle +/- radius]`` in decimals: of a cycle that is locked to samples a
        whole number of them, of a response a whole number of periods of the sine.
    radius : float
        Of the balls that hold the states at the events and the times between them, relative to the size of the motion
        in each state and to the period.
    unique_within : float
        Size of the box about these, relative likewise, that holds no other cycle with the same sequence of events.
    events : tuple of str
        The events of a period, in their order: element and event.
    state : array, shape (n,)
        State of the loop at the beginning of the period.
    stability : OrbitStability
        STABLE, ONE_OUTSIDE, SEVERAL_OUTSIDE or NOT_DECIDED, from the discs that hold the multipliers.
    stability_message : str
        Why stability is not decided; empty where it is.
    multipliers, multiplier_radii : complex array, array, shape (m,)
        Discs that hold the Floquet multipliers, largest first; that of the motion along the cycle is listed as 0.
    n_pieces : int
        Pieces of the cycle on which the guards were proved.
    evidence : dict of str to str
        What the proof rests on: the tables of the loop, the sequence of events, the middle of the balls exactly.
    document : mapping
        What the file holds that :meth:`write` writes, as its checker reads it; empty where nothing is proved.
    """

    status: Proof
    message: str = ""
    period: float = _NAN
    period_ball: str = ""
    radius: float = _NAN
    unique_within: float = _NAN
    events: tuple[str, ...] = ()
    state: Array = field(default_factory=lambda: np.zeros(0))
    stability: OrbitStability = OrbitStability.NOT_DECIDED
    stability_message: str = ""
    multipliers: ComplexArray = field(default_factory=lambda: np.zeros(0, complex))
    multiplier_radii: Array = field(default_factory=lambda: np.zeros(0))
    n_pieces: int = 0
    evidence: dict[str, str] = field(default_factory=dict)
    document: Mapping[str, Any] = field(default_factory=dict)

    in_json = (
        "status sentence=__str__ message period period_ball radius unique_within events state stability "
        "stability_message multipliers multiplier_radii n_pieces operating_point evidence document provenance"
    )

    @property
    def proved(self) -> bool:
        """Whether the cycle is proved to exist."""
        return self.status.ok

    def __str__(self) -> str:
        """What is proved, with the numbers, and what is not, with the reason."""
        if not self.proved:
            return f"{self.status.value} {self.message}".rstrip()
        under = driven_by(self.document)
        what = f"{under}, a periodic response" if under else "a limit cycle"
        found = (
            f"Proved: {what} with a period of {self.period:.4g} s exists; it is known to {self.radius:.1g} of "
            f"its size, and within {self.unique_within:.1g} of it the only one with these {len(self.events)} events."
        )
        return f"{found} {self.stability.value} {self.stability_message}".rstrip()

    def to_frame(self) -> pandas.DataFrame:
        """The discs of the multipliers, one a row."""
        import pandas

        return pandas.DataFrame(
            {
                "real": self.multipliers.real,
                "imaginary": self.multipliers.imag,
                "radius": self.multiplier_radii,
            }
        )

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The discs of the multipliers beside the unit circle."""
        return self.drawn("plot_multiplier_discs", ax)
