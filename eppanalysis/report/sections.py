"""The template of a report: for each section its heading, a sentence or two, and the code that fills it.

A new section is one more entry in `SECTIONS`. In its code ``case`` and ``ladder`` are there, and whatever the sections
before it left (``run``, ``cycles``, ``branch``, ``prediction``); each catches what a method refuses and prints the
sentence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from eppanalysis.cases import Case, variation_of
from eppanalysis.cases.command_line import Commands, called
from eppanalysis.cases.variation import time_of_maps
from eppanalysis.methods.bounds.numbers import why_no_bounds
from eppanalysis.methods.bounds.searched import why_by_search
from eppanalysis.models.systems.sampled.clocked import has_samples
from eppanalysis.models.systems.sampled.strobe import sampled_among
from eppanalysis.plotting import main_signals


@dataclass(frozen=True)
class Section:
    """One section."""

    #: title, text: heading, and what the reader needs to know; empty for none.
    title: str
    text: str
    #: The cell for a case, as a reader would write it; empty where the section does not apply.
    code: Callable[[Case], str]
    full: Callable[[Case], str] | None = None  # the cell in place of `code` in a full report, which may take minutes

    def cell(self, case: Case, *, full: bool) -> str:
        """The cell for a case in a report of either length."""
        return self.full(case) if full and self.full is not None else self.code(case)


def _always(code: str) -> Callable[[Case], str]:
    return lambda case: code


#: Gains of the full guideline, as profile ranges relative to the case's own.
_GAINS = (0.6, 0.8, 1.0, 1.2, 1.4)
#: Points of an axis of a map, and how many samples of controllers all its runs may go through: some seconds.
_POINTS, _MOST_SAMPLES = (9, 7, 5), 2e6

SETUP = """\
%matplotlib inline
%config InlineBackend.figure_formats = ["retina"]
import pandas

import eppanalysis as epp

pandas.set_option("display.max_colwidth", None)"""

#: Prediction and simulation side by side, once for all sections, where the case lets them.
LADDER = """\
ladder = None
try:
    ladder = epp.ladder(case)
except epp.EppError:
    pass"""

OVERVIEW = """\
def ladder_of(case):
    try:
        return epp.ladder(case)
    except epp.EppError as reason:
        print(f"{case.name}: {reason}")

ladders = [ladder_of(case) for case in cases]
epp.table([pair for pair in zip(cases, ladders) if pair[1] is not None])"""

_FIRST = """\
run = epp.simulate(case) if ladder is None else ladder.run
cycles = None if ladder is None else ladder.search
if cycles is None:
    try:
        cycles = epp.find_limit_cycles(case)
    except epp.EppError as reason:
        no_cycles = reason
{branch}proof = None
try:
    cycle = run.limit_cycle or next(iter(cycles or ()), None)
    proof = epp.certify(case, "absence") if cycle is None else epp.certify_orbit(case, cycle)
except epp.EppError as refusal:
    proof = refusal
epp.first_page(case, run, ladder, cycles, branch, proof, called={called})"""

_START = """\
epp.table(case)"""

_PREDICTION = """\
prediction = None
try:
    prediction = ladder.prediction if ladder is not None else None
    if prediction is None:
        prediction = epp.predict_limit_cycles(case)
    if len(prediction):
        display(epp.table(prediction, case.named_signals))
    if "response" in prediction.curves or prediction.curves.get("branches"):
        display(prediction.plot().figure)
    print(prediction, prediction.search)
{nyquist}except epp.EppError as reason:
    print(reason)"""

_NYQUIST = """\
    nyquist = epp.frozen_nyquist(case, prediction[-1]) if len(prediction) else None
    if nyquist:
        display(nyquist.plot().figure)
"""

_MARGINS = """\
try:
    display(epp.table(epp.margins(case)))
except epp.EppError as reason:
    print(reason)"""

_LADDER = """\
if ladder is not None:
    display(epp.table(ladder, case.named_signals), run.plot(signals={signals}).figure)
    print(ladder.verdict)
else:
    if run.status is not epp.Status.UNDECIDED:
        display(epp.table(run, case.named_signals))
    display(run.plot(signals={signals}).figure)
    print(run)"""

_CYCLES = """\
if cycles is None:
    print(no_cycles)
else:
    display(epp.table(cycles, case.named_signals))
    print(cycles, "Sought with", cycles.search)
    for cycle in cycles.stable[-1:]:
        display(cycle.plot(signals={signals}).figure)"""

_REMEDIES = """
if cycles is not None and cycles.stable:
    print(*epp.remedies(case, cycles).lines(), sep="\\n")"""

_TRIGGER = """\
if cycles and cycles.stable:
    try:
        display(epp.table(epp.trigger(case, cycles=cycles)))
    except epp.EppError as reason:
        print(reason)
elif cycles is None:
    print("Exact limit cycles were not sought, so none is known that a disturbance could start.")
else:
    print("No stable limit cycle was found, so there is none that a disturbance could start.")"""

_FOLLOW = """\
branch = None
try:
    start, cycle = ("{near}", cycles.stable[-1]) if cycles and cycles.stable else ("{far}", None)
    cycle = None if run.limit_cycle else cycle
    branch = epp.continue_branch(case, "{name}", start=start, stop="{stop}", cycle=cycle)
except epp.EppError as reason:
    no_branch = reason
"""

_BRANCH = """\
if branch is None:
    print(no_branch)
else:
    display(branch.plot({signal}at=case.value("{name}")).figure)
    turning = [special for special in branch.special if special.kind != "change of sequence"]
    for special in turning:
        print(special.kind.capitalize(), "at", branch.place(special) + ":", special.note + ".")
    if others := len(branch.special) - len(turning):
        print("Squares: changes of the sequence of events,", str(others) + ".")
    print(branch.message)"""

_MAP = """\
try:
    axes = {axes}
    t_end = max([{t_end}, *(8.0 * cycle.period for cycle in cycles or ())])
    cells = epp.sweep(case.with_values({{"run.t_end": t_end}}), axes, progress=False)
    if not cells["outcome"].any():
        print("No map: none of", cells["outcome"].size, "runs around this design settles or repeats itself by its end;")
        print("longer ones may (run.t_end).")
    else:
        figure = epp.plot_design_map(cells)
        {mark}
        display(figure){coarse}
except epp.EppError as reason:
    print(reason)"""

#: What a map of a sampled loop says of its grid.
_COARSE = """
        print("The map has {n} by {n} cells, because each run goes through every sample;")
        print({finer!r})"""

_GUIDELINE = """\
try:
    guide = epp.design_guide(case, [case.value("bands.range")], starts=100, branch=branch)
    shown = guide.rounded().T.set_axis(["this case"], axis="columns")
    display(shown[~shown.isin(["", "-"]).all(axis="columns")])
    for sentence in guide.sentences():
        print(sentence)
    print({full!r})
except epp.EppError as reason:
    print(reason)"""

_FULL_GUIDELINE = """\
try:
    guide = epp.design_guide(case, {gains})
    shown = guide.rounded()
    shown = shown.set_index(shown.columns[0]).T.rename_axis(index=None)
    display(shown[~shown.isin(["", "-"]).all(axis="columns")], guide.plot().figure)
    for sentence in guide.sentences():
        print(sentence)
except epp.EppError as reason:
    print(reason)"""

_PROVENANCE = """\
from datetime import datetime

display(epp.table(case.provenance()), epp.table((run if ladder is None else ladder).provenance))
print("Computed", datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z"))"""


def _prediction(case: Case) -> str:
    """With a Nyquist plot of its own where the prediction's is the loop gain over amplitude."""
    system = case.to_system()
    several = len(system.elements) > 1 and not has_samples(system)
    return _PREDICTION.format(nyquist=_NYQUIST if several else "")


def _shown(case: Case) -> list[str]:
    """The signals that are drawn; more are too small for half a page."""
    return main_signals(case.to_system().signals.names, case.expected.signal)


def _first(case: Case, *, full: bool = False) -> str:
    """All that the first page needs: the ladder, the exact cycles, and a branch where there is one to follow."""
    name = _followed(case, full=full)
    if not name:
        return _FIRST.format(branch="branch = None\n", called=called(case, carried=True))
    places = zip(("near", "far", "stop"), variation_of(case).branch(name), strict=True)
    follow = _FOLLOW.format(name=name, **{key: case.text(name, at) for key, at in places})
    return _FIRST.format(branch=follow, called=called(case, carried=True))


def _branch(case: Case, *, full: bool = False) -> str:
    """Over the backlash of an elbow, over what is tunable, the gain or the first positive parameter of another loop."""
    name = _followed(case, full=full)
    signal = f"signal={case.expected.signal!r}, " if case.expected.signal else ""
    return _BRANCH.format(name=name, signal=signal) if name else ""


def _followed(case: Case, *, full: bool = False) -> str:
    """The parameter over which a cycle is followed; none in short reports of loops with samples."""
    names, system = variation_of(case).over(), case.to_system()
    return names[0] if names and (full or not has_samples(system)) else ""


def _map(case: Case) -> str:
    """Gain against backlash of an elbow, the first two positive parameters of another loop."""
    n = _points(case)
    axes = variation_of(case).axes(n)
    if not axes:
        return ""
    factors = [case.readable(name)[1] for name in axes]
    x, y = (f'case.value("{name}") * {factor!r}' for name, factor in zip(axes, factors, strict=True))
    mark = f'figure.axes[0].plot({x}, {y}, "k*", markersize=12)'
    finer = f"A finer one: {Commands.of(case, carried=True).sweep(variation_of(case).axes(max(_POINTS)))}"
    coarse = _COARSE.format(n=n, finer=finer) if n < max(_POINTS) else ""
    return _MAP.format(axes=repr(axes), mark=mark, coarse=coarse, t_end=repr(time_of_maps(case)))


def _points(case: Case) -> int:
    """Points of each axis of a map: fewer where its runs go through many samples, for none of them ends before."""
    controllers = sampled_among(case.to_system().elements).values()
    samples = sum(time_of_maps(case) / controller.sample_time for controller in controllers)
    return next((n for n in _POINTS if n * n * samples <= _MOST_SAMPLES), _POINTS[-1])


def _is_guided(case: Case) -> bool:
    """Whether there is a guideline for its kind of loop, and for this one."""
    system = case.to_system()
    return variation_of(case).guided is not None and not (why_by_search(system) or why_no_bounds(system))


def _guideline(case: Case) -> str:
    """At the case's own gain, and how to have it at others."""
    more = (
        Commands.of(case, carried=True).command("guide", "-o", "guide.html")
        or f"epp.design_guide(case, {_gains(case)!r})"
    )
    return _GUIDELINE.format(full=f"At other gains: {more}")


def _gains(case: Case) -> list[str]:
    own = case.value("bands.range")
    return [case.text("bands.range", factor * own, 4) for factor in _GAINS]


def _full_guideline(case: Case) -> str:
    """At the case's own gain and at others on both sides of it."""
    return _FULL_GUIDELINE.format(gains=_gains(case))


SECTIONS: tuple[Section, ...] = (
    Section("In short", "", _first, partial(_first, full=True)),
    Section(
        "Prediction",
        "All limit cycles that describing functions predict, stable and unstable. In the picture a cycle is where the "
        "curves meet; a filled circle is a stable one. With several elements that is where the loop gain is one; their "
        "Nyquist plot holds at one cycle, here the last, at which the elements behind the cut are frozen.",
        _prediction,
    ),
    Section(
        "Margins",
        "Margins of the loop cut open at the place in the table, with each element as the gain below it; a loop with "
        "good margins may still oscillate.",
        _always(_MARGINS),
    ),
    Section(
        "Ladder",
        "Prediction and event-exact simulation side by side, with the error of the describing function in per cent; "
        "that of a mean is in per cent of the simulated peak to peak.",
        lambda case: _LADDER.format(signals=_shown(case)),
    ),
    Section(
        "Limit cycles",
        "All exact periodic orbits that were found; an unstable one may lie on the basin boundary between rest and "
        "oscillation.",
        lambda case: _CYCLES.format(signals=_shown(case)),
        lambda case: _CYCLES.format(signals=_shown(case)) + _REMEDIES,
    ),
    Section(
        "Trigger",
        "The smallest disturbance of the resting loop that starts an oscillation, in either direction.",
        _always(_TRIGGER),
    ),
    Section(
        "Branch",
        "How a limit cycle changes with a parameter; the dotted line is the case. Stable is solid, unstable dashed. "
        "The first page rounds the end of the branch to the side without a cycle.",
        _branch,
        partial(_branch, full=True),
    ),
    Section("Design map", "Where the design settles and where it oscillates; the star is the case.", _map),
    Section(
        "Bounds and guideline",
        "How much backlash a gain bears before any limit cycle exists, put to the test on both sides.",
        lambda case: _guideline(case) if _is_guided(case) else "",
        lambda case: _full_guideline(case) if _is_guided(case) else "",
    ),
    Section(
        "Case",
        "Values and their sources: taken from a paper or a data sheet, derived from other numbers, measured, assumed, "
        "or tunable, which is free to choose. Coefficients of transfer functions and formulas are in the case's file.",
        _always(_START),
    ),
    Section("Provenance", "What made these numbers.", _always(_PROVENANCE)),
)
