"""Proof that a loop with play has no limit cycle, whatever its gap: the verb and its result."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.play import check_frequency, check_play
from eppanalysis.methods.certificates.play.exact import Refused
from eppanalysis.methods.certificates.play.loop import RationalLoop, contact_poles, rational_loop
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, facts_of, system_of
from eppanalysis.results import Result, Status
from eppanalysis.results.provenance import Provenance
from eppanalysis.results.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

#: Sectors of a quarter plane that are tried, one after the other: few are fast, many come near the exact onset.
_COUNTS = (4, 10, 24, 48)
_MOST = 200


@dataclass(frozen=True, eq=False, repr=False)
class PlayCertificate(Result):
    """Whether a loop with play was proved to have no periodic motion but rest, and the proof.

    Attributes
    ----------
    proved : bool
        Whether the text proves it. False says that no proof was found: there may be a limit cycle, or none.
    method : str
        "frequency" (Re L > -1) or "sectors" (a function that falls along all motions); empty without a proof.
    status : Status
        CONVERGED with a proof, INCOMPLETE without one.
    message : str
        What is proved, or why nothing is; and where the loop is unstable, that motions may grow for ever.
    text : str
        The proof as JSON, all numbers rational: what `check_play` and `check_frequency` read. Empty without a proof.
    numerator, denominator : tuple of str
        Rational coefficients of the linear part L that the proof is about, highest power first, for u = -L(s) w.
    deviation : float
        By which a coefficient differs most from that of the loop in floating point, as a share of its size;
        what is rounding beside the poles and the gain counts as zero.
    """

    proved: bool
    method: str
    status: Status
    message: str
    text: str
    numerator: tuple[str, ...]
    denominator: tuple[str, ...]
    deviation: float

    in_json = "proved method status message numerator denominator deviation text provenance"

    def to_frame(self) -> pandas.DataFrame:
        """One row: whether it is proved, how, and the linear part of the proof."""
        row = {"proved": self.proved, "method": self.method}
        return frame_of([row | {"numerator": " ".join(self.numerator), "denominator": " ".join(self.denominator)}])

    def __str__(self) -> str:
        """What is proved, or why nothing is."""
        return self.message

    def check(self) -> str:
        """The sentence that the text proves, checked once more in rational arithmetic.

        Raises
        ------
        EppError
            If there is no proof.
        """
        if not self.proved:
            raise EppError(self.message)
        return _check(self.text)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The function on the plane of contact speed and acceleration, or L(j omega) right of -1."""
        return self.drawn("plot_play_certificate", ax)


@checked
def certify_absence_with_play(loop: LureSystem | CaseLike, *, sectors: int = _COUNTS[-1]) -> PlayCertificate:
    """Prove that a loop with one play has no periodic motion but rest, whatever the gap and the constant inputs.

    First that Re L(j omega) > -1, for a linear part L of any order up to 12. Then, of order 2, or of order 3 with one
    zero at most, with real poles: a function that falls along every motion, quadratic in each of many sectors, found
    by a semidefinite program and checked in rational arithmetic.

    Parameters
    ----------
    loop : LureSystem or Case
        One play and a strictly proper linear part in continuous time, without dead time.
    sectors : int, optional
        Most sectors of a quarter plane that are tried; more of them come nearer to the exact onset.

    Returns
    -------
    PlayCertificate
        Where it is not `proved`, nothing is said about limit cycles.

    Raises
    ------
    ModelError
        If the loop is not of that form, or has no gap.
    EppError
        If `sectors` is not from 2 to 200, or the solver of semidefinite programs is not installed.

    References
    ----------
    Johansson and Rantzer (1998), Computation of piecewise quadratic Lyapunov functions for hybrid systems, IEEE
    Transactions on Automatic Control 43(4).

    Examples
    --------
    >>> import eppanalysis as epp
    >>> servo = epp.LureSystem.from_tf(([2.0], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=0.1))
    >>> found = epp.certify_absence_with_play(servo)
    >>> found.proved, found.method, found.denominator
    (True, 'sectors', ('1', '6', '5', '0'))
    """
    if not 2 <= sectors <= _MOST:
        raise EppError(f"certify_absence_with_play: sectors is {sectors}; expected 2 to {_MOST}.")
    system = system_of(loop, "certify_absence_with_play")
    about = rational_loop(system)
    case = {} if isinstance(loop, LureSystem) else facts_of(loop)
    source = Provenance("certificate", {"system": system.name, "sectors": sectors}, case=case)
    method, text, message = _proof(about, sectors)
    if text and np.max(np.linalg.eigvals(system.A + system.B @ system.C).real) >= 0.0:
        message += " While the play moves, the loop is not stable: motions that do not rest may grow without bound."
    return PlayCertificate(
        proved=bool(text),
        method=method,
        status=Status.CONVERGED if text else Status.INCOMPLETE,
        message=message,
        text=text,
        numerator=tuple(map(str, about.numerator)),
        denominator=tuple(map(str, about.denominator)),
        deviation=about.deviation,
        provenance=source,
    )


def _proof(loop: RationalLoop, sectors: int) -> tuple[str, str, str]:
    """Method, text and sentence of a proof; without one the sentence says why."""
    text = _written(loop, {"format": check_frequency.FORMAT})
    if said := _proves(text):
        return "frequency", text, said
    choices, reason = contact_poles(loop)
    if reason:
        return (
            "",
            "",
            f"No proof: Re L(j omega) > -1 fails at some frequency, and {reason}. There may be a cycle or none.",
        )
    for found in _candidates(loop, choices, sectors):
        text = _written(loop, {"format": check_play.FORMAT, **found})
        if said := _proves(text):
            return "sectors", text, said
    return "", "", f"No proof was found with up to {sectors} sectors of a quarter plane. There may be a cycle or none."


def _candidates(loop: RationalLoop, choices: list[list[Fraction]], sectors: int) -> Iterator[dict[str, Any]]:
    """What the search finds with more and more sectors, at the rate of the slowest lag and at that of the loop gain."""
    from eppanalysis.methods.certificates.play.search import SectorSearch

    num, den = list(loop.numerator), list(loop.denominator)
    lag = next((den[k] / den[k - 1] for k in range(loop.order, 0, -1) if den[k]), Fraction(1))
    gain = abs(float(num[-1])) ** (1.0 / loop.order)
    units = dict.fromkeys(Fraction(2) ** round(math.log2(float(rate))) for rate in (lag, gain) if rate > 0)
    for count in dict.fromkeys([*(c for c in _COUNTS if c < sectors), sectors]):
        for poles, unit in product(choices, units):
            found = SectorSearch(num, den, poles, unit, count).candidate()
            if found is not None:
                yield found


def _written(loop: RationalLoop, fields: dict[str, Any]) -> str:
    about = {"numerator": list(loop.numerator), "denominator": list(loop.denominator)}
    return json.dumps({name: _text(value) for name, value in {**fields, **about}.items()}, indent=1)


def _text(value: Any) -> Any:
    """Rationals as strings."""
    if isinstance(value, dict):
        return {name: _text(item) for name, item in value.items()}
    return [_text(item) for item in value] if isinstance(value, list) else str(value)


def _check(text: str) -> str:
    """The sentence that a text proves, by the checker of its form."""
    frequency = json.loads(text)["format"] == check_frequency.FORMAT
    return check_frequency.check_frequency(text) if frequency else check_play.check_play(text)


def _proves(text: str) -> str:
    """The sentence that a text proves; empty where it proves none."""
    try:
        return _check(text)
    except Refused:
        return ""
