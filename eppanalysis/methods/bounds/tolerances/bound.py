"""Bounds under tolerances: for the whole box of them (worst case), and with a probability (Monte Carlo on the engine).

Worst case: the exact bound is minimised over the box. Its exact elasticities point to a corner; there they are taken
anew, until they point nowhere else. Corners in the most influential parameters are then checked one by one. Where the
search for limit cycles says the bound, as in loops with samples, see ``searched``.

Probability: parameters are drawn, and for each draw the bound is bracketed by event-exact runs of all draws at once,
started on and around the orbit that exists at the nominal bound, by halving an interval round the value which the
elasticities predict. The bound that holds with probability P is an order statistic of the draws, and its confidence
interval is the exact (binomial) one, free of any distribution: Conover, Practical Nonparametric Statistics, 1999,
section 3.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.arrays import Array
from eppanalysis.errors import CaseError, EppError
from eppanalysis.methods.bounds.balanced import BalancedSweep, BoundProblem
from eppanalysis.methods.bounds.elasticity import parameters_of
from eppanalysis.methods.bounds.searched import SearchedProblem, why_by_search
from eppanalysis.methods.bounds.tolerances.box import ROUNDS, Box
from eppanalysis.methods.bounds.tolerances.distribution import Distribution
from eppanalysis.methods.bounds.tolerances.exact import ExactBox
from eppanalysis.methods.bounds.tolerances.result import Quantile, ToleranceBound
from eppanalysis.methods.bounds.tolerances.searched import SearchedBox
from eppanalysis.methods.continuation.own_states import in_own_states
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike, facts_of, require_case
from eppanalysis.progress import Progress
from eppanalysis.results.provenance import Provenance

_CONFIDENCE = 0.95


def half_widths_of(case: CaseLike, given: Mapping[str, object] | None) -> dict[str, float]:
    """Half-widths of the tolerances [SI]: those given ("10 %" is of the value), or those that the case carries.

    Raises
    ------
    EppError
        If a tolerance is negative, or there are none.
    """
    if given is None:
        carried = getattr(case, "parameters", {})
        found = {name: float(p.tolerance) for name, p in carried.items() if p.tolerance}
    else:
        found = {}
        for name, width in given.items():
            text = str(width).strip()
            share = text.endswith("%")
            try:
                value = case.value(name)
            except EppError as error:
                raise EppError(f"tolerance of {name}: {error}") from None
            try:
                size = abs(value) * float(text[:-1]) / 100.0 if share else case.si(name, width)
            except ValueError:
                raise EppError(f"tolerance of {name} is {width!r}; expected a quantity or a percentage.") from None
            if not (math.isfinite(size) and size >= 0):
                raise EppError(f"tolerance of {name} is {width!r}; expected one that is not negative.")
            found[name] = size
    if not found:
        raise EppError(f"{case.name}: no parameter has a tolerance; expected at least one.")
    return found


def check_tolerances(question: BoundProblem, tolerances: Mapping[str, object] | None) -> dict[str, float]:
    """Half-widths of the tolerances [SI], if a bound under them can be computed.

    Parameters
    ----------
    tolerances : mapping of str to quantity or percentage, optional
        As :func:`half_widths_of` takes them.

    Raises
    ------
    EppError
        If one is not valid, is of a parameter by which a bound has no elasticity, or leads to values that the case
        cannot take.
    """
    case, widths = question.case, half_widths_of(question.case, tolerances)
    known = (*parameters_of(question), question.limit)
    for name, width in widths.items():
        if name not in known:
            why = f"the case holds no number for it but {case.value(name):g}"
            raise EppError(f"tolerance of {name}: {why}; expected a parameter that is given and not zero.")
        if name != question.limit:
            check_ends(case, name, width)
    return widths


def check_ends(case: CaseLike, name: str, width: float) -> None:
    """Refuse a tolerance at one of whose ends there is no such case.

    Raises
    ------
    EppError
        If the parameter less the half-width, or with it, is nothing that the case can take.
    """
    for end in (case.value(name) - width, case.value(name) + width):
        try:
            case.with_values({name: end})
        except CaseError as error:
            said = f"at one end of it {name} is {case.text(name, end)}; expected {error.expected}"
            raise EppError(f"tolerance of {name}: {said}.") from None


def tolerance_bound(
    case: CaseLike | LureSystem,
    limit: str,
    tolerances: Mapping[str, object] | None = None,
    *,
    within: tuple[object, object],
    probabilities: Sequence[float] = (0.95, 0.99),
    samples: int = 400,
    distribution: str = "uniform",
    seed: int = 20050901,
    threads: int = 1,
    sweep: BalancedSweep | None = None,
    progress: Progress | None = None,
) -> ToleranceBound:
    """The bound on a parameter for all values of the others within their tolerances, and with given probabilities.

    Parameters
    ----------
    case : Case or LureSystem
        With sampled controllers, in discrete time, and where harmonic balance does not cover an element, bounds are
        those of the search, as :func:`design_bounds` has them; `ToleranceBound.not_covered` says
        what they do not cover.
    limit : str
        The parameter that is bounded; its own tolerance is taken off the bound.
    tolerances : mapping of str to quantity or percentage, optional
        By default those that the case's parameters carry.
    within : (quantity, quantity)
        Range in which bounds are sought.
    probabilities : sequence of float
        Shares of machines that are to be free of cycles, each between 0 and 1.
    samples : int
        Draws; 0 for the worst case alone.
    distribution : {"uniform", "normal"}
        Even within the tolerance, or normal with a third of it as standard deviation, cut at its ends.
    seed, threads : int
        The result does not depend on the number of threads.
    sweep : BalancedSweep, optional
        Over one of the parameters of a neighbouring case, at whose last value the search goes on; a new search by
        default.
    progress : callable, optional
        Called with which rounds of runs are done, of how many, and what is being done.

    Returns
    -------
    ToleranceBound

    Raises
    ------
    EppError
        If there is no bound at the parameters' own values, or a setting is not valid.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("relay_deadzone")
    >>> tolerances = {"relay_dead_zone.level": "10 %"}
    >>> found = epp.tolerance_bound(
    ...     case, "relay_dead_zone.threshold", tolerances, within=(1.0, 3.0), samples=0
    ... )
    >>> str(found).partition(" wherever")[0]
    'Free of limit cycles above a relay dead zone threshold of 1.829'
    """
    case = require_case(case, "tolerance_bound")
    spreads = Distribution.called(distribution, "tolerance_bound")
    check_counts("tolerance_bound", {"samples": (samples, 0), "seed": (seed, 0), "threads": (threads, 1)})
    for share in probabilities:
        if not 0.0 < share < 1.0:
            raise EppError(f"tolerance_bound: probabilities holds {share}; expected shares between 0 and 1.")
    low, high = (case.si(limit, v) for v in within)
    if not low < high:
        raise EppError(f"tolerance_bound: {limit} is sought within {within[0]} to {within[1]}; expected low < high.")
    question = BoundProblem(in_own_states(case), limit, low, high)
    widths = check_tolerances(question, tolerances)
    # How far the bounded parameter is itself off does not move the bound: that is taken off in the end.
    own = widths.pop(limit, 0.0)
    tell = progress or (lambda done, of, doing: None)
    tell(0, ROUNDS, "worst corner")
    why = why_by_search(case.to_system())
    box: Box = (
        SearchedBox.of(question, widths, SearchedProblem(why=why)) if why else ExactBox.of(question, widths, sweep)
    )
    worst, message, n_corners = box.worst()
    draws, offset = np.zeros(0), float("nan")
    if samples:
        # Independent, so that the binomial interval is exact.
        spread = spreads.within(np.random.default_rng(seed).uniform(size=(samples, len(widths) + 1)))
        draws, offset = box.draws(spread[:, :-1], threads, tell)
        draws = draws - spread[:, -1] * own
    sign = box.sign
    settings = {"limit": limit, "samples": samples, "distribution": distribution, "seed": seed, "half_widths": widths}
    return ToleranceBound(
        limit=limit,
        unit=case.unit(limit)[0],
        readable=case.readable(limit),
        sign=sign,
        half_widths={**widths, **({limit: own} if own else {})},
        nominal=box.centre.value,
        worst_case=worst.value - sign * own,
        worst_values=box.values(worst.place),
        n_corners=n_corners,
        quantiles=tuple(quantile(sign * draws, p, sign) for p in probabilities) if samples else (),
        draws=draws,
        engine_offset=offset,
        message=message,
        not_covered=box.not_covered,
        provenance=Provenance("bound under tolerances", settings, case=facts_of(case)),
    )


def quantile(draws: Array, probability: float, sign: float = 1.0) -> Quantile:
    """The value below which at most the share 1 - probability of all bounds lie, with its exact confidence interval.

    Parameters
    ----------
    draws : array, shape (n,)
        Bounds, times `sign`, so that designs are free below.
    sign : {1, -1}

    Examples
    --------
    >>> import numpy as np
    >>> quantile(np.arange(1.0, 1001.0), 0.95).value
    51.0
    """
    from scipy.stats import binom

    ordered, n, share = np.sort(draws), draws.size, 1.0 - probability
    half = 0.5 * (1.0 - _CONFIDENCE)
    # Of n draws the number below the true quantile is binomial: ranks that bracket it with the confidence wanted.
    low, high = int(binom.ppf(half, n, share)) - 1, int(binom.ppf(1.0 - half, n, share))
    place = math.floor(share * n)
    values = [float(ordered[i]) if 0 <= i < n else float("nan") for i in (place, low, high)]
    value, first, last = (sign * v for v in values)
    return Quantile(probability, value, *((first, last) if sign > 0 else (last, first)))
