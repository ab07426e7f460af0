"""The first page of a report: the verdict, one picture, three numbers, what to do, and how all of that is known."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from eppanalysis.cases import Case
from eppanalysis.cases.command_line import Commands, commands_in
from eppanalysis.errors import EppError
from eppanalysis.limits import Printed
from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
from eppanalysis.methods.certificates.result import Certificate
from eppanalysis.methods.comparison.ladder import Ladder
from eppanalysis.methods.continuation.result import CEASES, Branch, SpecialPoint
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.readable import in_print, lasting, quantity, words
from eppanalysis.report.advice import Found, limit_of
from eppanalysis.results import SIMULATION, LimitCycle, Status, Trajectory
from eppanalysis.shown import html_row, png

#: Size of the picture [inch], and its dots per inch.
_SIZE, _DOTS = (5.6, 2.8), 180
#: What is this near to the least or largest value of a branch, relative to the largest, is its end there.
_OUTERMOST = 1e-6

#: Notebooks put what is in a cell to the right.
_CELL = '<td style="text-align: left">'


@dataclass(frozen=True)
class FirstPage:
    """What a reader of a report sees first."""

    verdict: str  # what the loop does, in one or two sentences
    numbers: tuple[tuple[str, str, str], ...]  # three at most: what, its value with unit, and how it is known
    advice: str  # what to do about it, in lines; a command is at the end of a line, and runs as it is printed
    known: tuple[tuple[str, str], ...]  # what each method says: predicted, exact, simulated, proved
    picture: bytes = b""  # PNG; empty where there is none

    def __str__(self) -> str:
        """All of it but the picture, a line each."""
        numbers = [f"{what}: {value}; {how}" for what, value, how in self.numbers]
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
            f'<div class="numbers">{numbers}</div><p><strong>What to do.</strong> {_with_commands(self.advice)}</p>'
            f"<p><strong>How it is known.</strong></p><table>{known}</table></div>"
        )


def _with_commands(advice: str) -> str:
    """What to do as HTML: each line by itself, its command as it is typed."""
    lines = []
    for line in advice.splitlines():
        command = next(iter(commands_in([line])), "")
        said = html.escape(line.removesuffix(command))
        lines.append(f"{said}<br><code>{html.escape(command)}</code>" if command else said)
    return "<br>".join(lines)


def first_page(
    case: Case,
    run: Trajectory,
    ladder: Ladder | None = None,
    cycles: CycleSearch | None = None,
    branch: Branch | None = None,
    proof: Certificate | CertifiedOrbit | EppError | None = None,
    called: Sequence[str] | None = None,
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
    called : sequence of str, optional
        The words by which the command line finds the case, for the commands of the page; by default the case's own
        file or the name by which it ships. Of a case that has neither, the next steps are given in Python.

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
    branch = _of_own_cycles(case, run, cycles, branch)
    end = _nearest_end(case, branch)
    commands = Commands.of(case) if called is None else Commands(case, tuple(called))
    return FirstPage(
        verdict=_verdict(run, cycles, largest, signal),
        numbers=tuple(_numbers(case, run, largest, branch, end, signal))[:3],
        advice=Found(commands, run, cycles, branch, end, proof).advice(),
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
        return "Comes to rest from its own start; other starts were not tried."
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
            in_print(Printed.of([limit_of(branch, end)], case.readable(name)).whole(limit_of(branch, end))),
            f"{end.kind} of its exact branch",
        )
    elif branch is None and largest is not None:
        yield "period of the oscillation", lasting(largest.period, largest.units), how
    elif branch is not None:
        values = branch.points["value"]
        low, high = branch.ends_of(float(values.min()), float(values.max()))
        how = (
            "exact branch; what is beyond was not followed" if branch.missing else "exact branch, without an end in it"
        )
        what = "the oscillation" if largest is not None else "a limit cycle"
        yield f"{words(branch.parameter)} with {what}", f"{low.partition(' ')[0]} to {high}", how


def _of_own_cycles(case: Case, run: Trajectory, cycles: CycleSearch | None, branch: Branch | None) -> Branch | None:
    """The branch; none where the case has cycles and the branch has none at the case's own value: it is of others."""
    if branch is None or not (run.limit_cycle or cycles):
        return branch
    values = [*branch.points["value"], *(special.value for special in branch.special)]
    own, near = case.value(branch.parameter), _OUTERMOST * max(map(abs, values))
    return branch if len(branch) > 1 and min(values) - near <= own <= max(values) + near else None


def _nearest_end(case: Case, branch: Branch | None) -> SpecialPoint | None:
    """Where the cycles of the branch cease to exist, nearest to the case's own value of the parameter.

    A branch may turn several times: beyond an inner fold it has other cycles still.
    """
    if branch is None or branch.not_covered:
        return None
    own = case.value(branch.parameter)
    ends = [special for special in branch.special if special.kind in CEASES]
    values = np.array([*branch.points["value"], *(end.value for end in ends)])
    near = _OUTERMOST * np.abs(values).max()
    low, high = values.min() + near, values.max() - near
    return min((end for end in ends if not low < end.value < high), key=lambda end: abs(end.value - own), default=None)


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
        yield "Searched", str(cycles)
    yield "Simulated", str(run)
    moving = " and ".join(f"{name} {why}" for name, why in case.operating_point.moving.items())
    held = f" Proofs are of inputs that are held; here {moving}." if moving else ""
    if proof is None:
        told = "Nothing: no proof was requested, or none covers this loop."
        yield "Proved", f"{told}{held}"
    elif isinstance(proof, EppError):
        yield "Proved", f"Nothing: no sentence here is a theorem. The reason: {proof}{held}"
    elif proof.proved:
        theorem = str(proof).removeprefix("Proved: ")
        yield "Proved", f"{theorem} This sentence is a theorem, all others here are computed.{held}"
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
