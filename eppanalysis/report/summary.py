"""The first page of a report: the verdict, one picture, three numbers, what to do, and how all of that is known."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eppanalysis.cases import Case, variation_of
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
from eppanalysis.methods.certificates.result import Certificate
from eppanalysis.methods.comparison.ladder import Ladder
from eppanalysis.methods.continuation.labels import Change
from eppanalysis.methods.continuation.result import Branch, SpecialPoint
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.readable import DIGITS, cut, in_print, lasting, quantity, words
from eppanalysis.results import SIMULATION, LimitCycle, Status, Trajectory
from eppanalysis.shown import html_row, png

#: Size of the picture [inch], and its dots per inch.
_SIZE, _DOTS = (5.6, 2.8), 180
#: Where the cycles of a branch cease to exist.
_ENDS = (Change.FOLD, Change.TURNING, Change.INFINITE, Change.LINEAR)
#: Letters of a name that is a symbol, before which stands no article.
_SYMBOL = 2
#: An end this near to the case's own value, relative to it, is taken to be at it.
_AT = 1e-9
#: A run that came to no end is to be so many times as long.
_LONGER = 10

#: What is this near to the least or largest value of a branch, relative to the largest, is its end there.
_OUTERMOST = 1e-6

#: Notebooks put what stands in a cell to the right.
_CELL = '<td style="text-align: left">'


@dataclass(frozen=True)
class FirstPage:
    """What a reader of a report sees first."""

    verdict: str  # what the loop does, in one or two sentences
    numbers: tuple[tuple[str, str, str], ...]  # three at most: what, its value with unit, and how it is known
    advice: str  # what to do about it
    known: tuple[tuple[str, str], ...]  # what each method says: predicted, exact, simulated, proved
    picture: bytes = b""  # PNG; empty where there is none

    def __str__(self) -> str:
        """All of it but the picture, a line each."""
        numbers = [f"{what}: {value} ({how})" for what, value, how in self.numbers]
        known = [f"{how}: {what}" for how, what in self.known]
        return "\n".join([self.verdict, *numbers, f"What to do: {self.advice}", *known])

    def _repr_html_(self) -> str:
        numbers = "".join(
            f"<div><b>{value}</b> <span>{what}</span> <small>({how})</small></div>"
            for what, value, how in (map(html.escape, known) for known in self.numbers)
        )
        known = "".join(html_row(cells, _CELL) for cells in self.known)
        shown = base64.b64encode(self.picture).decode()
        picture = f'<img alt="{html.escape(self.verdict)}" src="data:image/png;base64,{shown}">' if shown else ""
        return (
            f'<div class="first"><p class="verdict"><strong>{html.escape(self.verdict)}</strong></p>{picture}'
            f'<div class="numbers">{numbers}</div><p><strong>What to do.</strong> {html.escape(self.advice)}</p>'
            f"<p><strong>How it is known.</strong></p><table>{known}</table></div>"
        )


def first_page(
    case: Case,
    run: Trajectory,
    ladder: Ladder | None = None,
    cycles: CycleSearch | None = None,
    branch: Branch | None = None,
    proof: Certificate | CertifiedOrbit | EppError | None = None,
) -> FirstPage:
    """The first page of a report, from what has been computed for it.

    Parameters
    ----------
    case : Case
    run : Trajectory
        Its own run.
    ladder : Ladder, optional
        Prediction and simulation side by side.
    cycles : CycleSearch, optional
        All exact cycles that were found.
    branch : Branch, optional
        Of the cycle over a parameter.
    proof : Certificate, CertifiedOrbit or EppError, optional
        The proof that was attempted, or the error that refused it. Where the proof succeeds, its sentence is a theorem,
        and the page says that no other is.

    Returns
    -------
    FirstPage
        Shown as HTML by a notebook, as text by ``print``.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> case = epp.case("sat_khalil710")
    >>> print(epp.first_page(case, epp.simulate(case)).verdict)
    Oscillates: x 2.911 peak to peak at 0.4497 Hz.
    """
    signal = case.expected.signal or next(iter(run.signals), "")
    largest = _largest(run, cycles, signal)
    end = _nearest_end(case, branch)
    return FirstPage(
        verdict=_verdict(run, cycles, largest, signal),
        numbers=tuple(_numbers(case, run, largest, branch, end, signal))[:3],
        advice=_advice(case, run, cycles, branch, end, proof),
        known=tuple(_known(case, run, ladder, cycles, proof)),
        picture=_picture(run, ladder, signal),
    )


def _largest(run: Trajectory, cycles: CycleSearch | None, signal: str) -> LimitCycle | None:
    """The cycle that the run is on; where it is on none, the largest stable one that was found."""
    stable = [] if cycles is None else [cycle for cycle in cycles if cycle.stable]
    return run.limit_cycle or max(stable, key=lambda cycle: cycle.peak_to_peak[signal], default=None)


def _verdict(run: Trajectory, cycles: CycleSearch | None, largest: LimitCycle | None, signal: str) -> str:
    if run.limit_cycle is not None:
        return f"Oscillates: {run.limit_cycle.size_of(signal)}."
    if run.status is Status.UNDECIDED and largest is not None and cycles is not None:
        after = lasting(run.end_time, run.units)
        return f"{cycles.headline()}. Its own run was on none of them by its end, after {after}."
    if run.status is not Status.SETTLED and cycles is not None and (largest or run.status is Status.UNDECIDED):
        return f"{cycles.headline()}. {run}"
    if run.status is not Status.SETTLED:
        return str(run)
    if largest is not None:
        return f"Rests unless it is struck: beside rest there is an oscillation, {largest.size_of(signal)}."
    if cycles is None:
        return "Comes to rest from its own start; other starts were not looked at."
    left = ", but runs were left undecided" if cycles.left_open else ""
    return f"Comes to rest, and no limit cycle was found from any other start{left}."


def _numbers(
    case: Case,
    run: Trajectory,
    largest: LimitCycle | None,
    branch: Branch | None,
    end: SpecialPoint | None,
    signal: str,
) -> Iterator[tuple[str, str, str]]:
    if largest is not None:
        how = "event-exact simulation" if largest.method == SIMULATION else largest.method
        size = quantity(largest.peak_to_peak[signal], largest.units.get(signal, ""))
        yield f"{words(signal)}, peak to peak", size, how
        yield "frequency of the oscillation", f"{largest.frequency:.4g} Hz", how
    elif run.status is Status.SETTLED:
        if run.settled_since > 0.0:
            yield "at rest from", lasting(run.settled_since, run.units), "event-exact simulation"
        if signal in run.settled_at:
            rest = quantity(run.settled_at[signal], run.units.get(signal, ""))
            yield f"{words(signal)} at rest", rest, "event-exact simulation"
    elif run.t.size:
        late = run.signals[signal][run.t > 0.5 * run.t[-1]]
        moved = quantity(float(np.ptp(late)), run.units.get(signal, ""))
        yield f"{words(signal)}, peak to peak in the second half of the run", moved, "event-exact simulation, undecided"
        yield "length of the run", lasting(float(run.t[-1]), run.units), "as the case says (run.t_end)"
    if branch is not None and end is not None:
        name = branch.parameter
        yield (
            f"{words(name)} at which {'the oscillation ends' if largest is not None else 'oscillations begin'}",
            in_print(_limit(case, branch, end)),
            f"exact: {end.kind} of its branch",
        )
    elif branch is None and largest is not None:
        yield "period of the oscillation", lasting(largest.period, largest.units), how
    elif branch is not None:
        values = branch.points["value"]
        low, high = (in_print(case.text(branch.parameter, float(v), DIGITS)) for v in (values.min(), values.max()))
        how = (
            "exact branch; what is beyond was not followed" if branch.missing else "exact branch, without an end in it"
        )
        what = "the oscillation" if largest is not None else "a limit cycle"
        yield f"{words(branch.parameter)} with {what}", f"{low.partition(' ')[0]} to {high}", how


def _nearest_end(case: Case, branch: Branch | None) -> SpecialPoint | None:
    """Where the cycles of the branch cease to exist, nearest to the case's own value of the parameter.

    A branch may turn several times: beyond an inner fold it has other cycles still.
    """
    if branch is None or branch.not_covered:
        return None
    own = case.value(branch.parameter)
    ends = [special for special in branch.special if special.kind in _ENDS]
    values = np.array([*branch.points["value"], *(end.value for end in ends)])
    near = _OUTERMOST * np.abs(values).max()
    low, high = values.min() + near, values.max() - near
    return min((end for end in ends if not low < end.value < high), key=lambda end: abs(end.value - own), default=None)


def _advice(
    case: Case,
    run: Trajectory,
    cycles: CycleSearch | None,
    branch: Branch | None,
    end: SpecialPoint | None,
    proof: Certificate | CertifiedOrbit | EppError | None,
) -> str:
    if run.limit_cycle is None and not cycles:
        keep = "" if branch is None or end is None else f" {_beside(case, branch, end)}"
        rests, opened = run.status is Status.SETTLED, cycles is not None and cycles.left_open
        if opened or not rests:
            own = "Nothing from its own start; what others lead to is left open. " if rests else ""
            if cycles is not None and not opened:
                own = "No start of the search oscillates; its own run is not at rest by its end, and may creep on. "
            search = ", or ask eppanalysis cycles" if cycles is None else ""
            longer = f'--set run.t_end="{quantity(_LONGER * case.t_end, "s")}"'
            return f"{own}Simulate for longer, {longer}{search}.{keep}"
        # What was asked and refused is not advised.
        asks = ": eppanalysis certify --statement absence asks for one" if proof is None else ""
        proved = not isinstance(proof, EppError | None) and proof.proved
        searched = "" if cycles is None or proved else f" The search is thorough and no proof{asks}."
        return f"Nothing, at these values.{keep}{searched}"
    if run.limit_cycle is None and run.status is not Status.SETTLED and not (cycles and cycles.stable):
        return (
            "Change the loop until its own run settles (eppanalysis design looks for such values), or simulate for "
            "longer (run.t_end) to see where it ends."
        )
    if branch is None:
        limit, over = [*variation_of(case).over()[:2], "FIELD", "FIELD"][:2]
        far = f"eppanalysis bounds {case.name} --over {over} --limit {limit}, or eppanalysis design"
        return f"Ask how far a parameter must go: {far}."
    if end is None:
        return (
            f"{_the(branch).replace('the ', 'The ', 1)} alone does not end it where its branch was followed: change "
            "another parameter (eppanalysis design), or ask eppanalysis bounds for a wider range."
        )
    return _beside(case, branch, end)


def _the(branch: Branch) -> str:
    """The parameter of a branch in a sentence; a symbol has no article."""
    name = words(branch.parameter)
    return name if len(name) <= _SYMBOL or name != name.lower() else f"the {name}"


def _beside(case: Case, branch: Branch, end: SpecialPoint) -> str:
    """On which side of where its cycles end the parameter of a branch is to be, or to stay."""
    the, own, above = _the(branch), case.value(branch.parameter), _lies_above(branch, end)
    side = f"{'under' if above else 'above'} {_limit(case, branch, end)}"
    now = case.text(branch.parameter, own)
    if (own - end.value) * (1 if above else -1) < -_AT * abs(own):
        return f"Keep {the} {side}; it is {now} now."
    return (
        f"Bring {the} from {now} {side}, where this oscillation ceases to exist, with a margin. Others may "
        "remain: eppanalysis bounds tests for them."
    )


def _lies_above(branch: Branch, end: SpecialPoint) -> bool:
    """Whether the cycles, which lie on one side of where they end, are at larger values."""
    return float(branch.points["value"].mean()) > end.value


def _limit(case: Case, branch: Branch, end: SpecialPoint) -> str:
    """Where the cycles end, rounded to the side without them."""
    factor = case.readable(branch.parameter)[1]
    safe = cut(factor * end.value, DIGITS, up=not _lies_above(branch, end)) / factor
    return case.text(branch.parameter, safe, DIGITS)


def _known(
    case: Case,
    run: Trajectory,
    ladder: Ladder | None,
    cycles: CycleSearch | None,
    proof: Certificate | CertifiedOrbit | EppError | None,
) -> Iterator[tuple[str, str]]:
    if ladder is not None:
        yield "Predicted", ladder.agreement.sentence(ladder.run.status)
    if cycles is not None:
        yield "Exact", str(cycles)
    yield "Simulated", str(run)
    moving = " and ".join(f"{name} {why}" for name, why in case.operating_point.moving.items())
    held = f" Proofs are of inputs that are held; here {moving}." if moving else ""
    if proof is None:
        told = "Nothing: no proof was asked for, or none covers this loop; eppanalysis certify says which."
        yield "Proved", f"{told}{held}"
    elif isinstance(proof, EppError):
        yield "Proved", f"Nothing: no sentence here is a theorem. The reason: {proof}{held}"
    elif proof.proved:
        theorem = str(proof).removeprefix("Proved: ")
        told = f"{theorem[:1].upper()}{theorem[1:]} This sentence is a theorem, all others here are computed."
        yield "Proved", f"{told}{held}"
    else:
        yield "Proved", f"Nothing: no sentence here is a theorem. {proof}{held}"


def _picture(run: Trajectory, ladder: Ladder | None, signal: str) -> bytes:
    """The end of the run, or its cycle beside the predicted one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, layout="constrained")
    ax = figure.add_subplot()
    try:
        if ladder is None:
            run.plot(ax, signals=[signal])
        else:
            ladder.plot(ax)
    except EppError:
        return b""
    ax.set_title("")
    return png(figure, _DOTS)
