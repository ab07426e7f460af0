"""Results to tables on the console: numbers in the units that people read; computes nothing."""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.table import Table

from eppanalysis.readable import (
    ROUNDING,
    at_rest,
    in_print,
    number,
    percent,
    readable,
    signed_percent,
    with_unit,
    words,
)
from eppanalysis.results import DESCRIBING_FUNCTION, SIMULATION
from eppanalysis.shown import Shown, for_people
from eppanalysis.tables.cells import cell, table_of

if TYPE_CHECKING:
    from eppanalysis.cases import Case
    from eppanalysis.diagnose.result import Diagnosis
    from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
    from eppanalysis.methods.certificates.result import Certificate
    from eppanalysis.methods.comparison.ladder import Ladder
    from eppanalysis.methods.driven.result import ForcedResponse, FrequencyResponse
    from eppanalysis.methods.margins.result import Margins
    from eppanalysis.methods.search.trigger import Trigger
    from eppanalysis.results import LimitCycle, Trajectory

#: How to read an estimate that says no more than that it cannot tell.
_BEYOND = (
    "may not exist: the harmonics that the describing function neglects remove this cycle, or exceed its distance "
    "from a threshold; above 100 % the estimate does not give the size of the error. Compare with the exact cycles "
    "(validate, cycles)."
)
#: What a state is called that was given no name.
_STATE = re.compile(r"^x\d+$")
#: Unstable cycles without a counterpart, each of which has a row of its own.
_MOST_LONE = 4


def result_table(result: Shown) -> Table:
    """The table of a result in the units that people read, a long one cut in the middle."""
    frame = for_people(result.in_brief())
    table = table_of(*map(str, frame.columns))
    for row in frame.itertuples(index=False):
        table.add_row(*row)
    return table


def parameters_table(case: Case) -> Table:
    """Every value of a case with where it comes from."""
    table = table_of("field", "value", "from", "note", numbers=False)
    for name, parameter in case.parameters.items():
        table.add_row(name, in_print(parameter.with_tolerance), parameter.mark, parameter.note)
    return table


def _these(known: Mapping[str, Any], signals: Sequence[str] | None) -> Mapping[str, Any]:
    """What is known of these signals, in their own order; of all where none are chosen."""
    return known if signals is None else {name: known[name] for name in known if name in signals}


def rest_table(run: Trajectory, signals: Sequence[str] | None = None) -> Table:
    """Where each of these signals rests; all by default."""
    table = table_of("signal", "rests at")
    for name, value in _these(run.settled_at, signals).items():
        unit, factor = readable(run.units.get(name, ""))
        table.add_row(with_unit(words(name), unit), cell(at_rest(value) * factor))
    return table


def margins_table(margins: Mapping[str, Any]) -> Table:
    """Margins, one a row, with where the loop is cut and the gains in place of the elements.

    Gain and disk margins are factors, crossovers in rad/s.
    """
    table = table_of("margin", f"cut at {margins['at']}" if "at" in margins else "value")
    for name, value in margins.items():
        if isinstance(value, float):
            table.add_row(name.replace("_", " "), _margin(name, value))
    if "stable" in margins:
        table.add_row("linearised loop", _STABLE[margins["stable"]])
    _add_rule(table, margins.get("rule", ()), [margins.get("message", "")])
    return table


def all_margins_table(found: Sequence[Margins]) -> Table:
    """Margins at several places, a column each."""
    table = table_of("margin", *(f"cut at {one.at}" for one in found))
    for name in found[0].numbers():
        table.add_row(name.replace("_", " "), *(_margin(name, one.numbers()[name]) for one in found))
    table.add_row("linearised loop", *(_STABLE[one.stable] for one in found))
    shared = [sentence for sentence in found[0].rule if all(sentence in one.rule for one in found)]
    # What is said of some places only: a sampled controller is exact at its own ports, and in the mean elsewhere.
    apart: dict[str, list[str]] = {}
    for one in found:
        for sentence in one.rule:
            if sentence not in shared:
                apart.setdefault(sentence, []).append(one.at)
    said = [f"At {', '.join(places)}: {sentence}" for sentence, places in apart.items()]
    _add_rule(table, shared, [*said, *(f"{one.at}: {one.message}" for one in found if one.message)])
    return table


def certificate_table(found: Certificate) -> Table:
    """Roots that are proved, and boxes that are undecided, one a row; amplitudes in SI units."""
    if not found.roots and not found.undecided:
        return sentence_table(found.message)
    table = table_of("proved", "amplitude", "angular frequency")
    for root in found.roots:
        table.add_row("one root", f"{root.amplitude[0]:.12g}", f"{root.omega[0]:.12g} rad/s")
    for left in found.undecided:
        sides = [f"{low:.6g} to {high:.6g}" for low, high in left]
        table.add_row("undecided", sides[0], f"{sides[1]} rad/s")
    return table


def _add_rule(table: Table, rule: Sequence[str], said: Sequence[str]) -> None:
    """The gain in place of each element, one a row, and below the table what is too long for one or said besides."""
    below = []
    for sentence in rule:
        name, _, gain = sentence.removesuffix(".").partition(": ")
        if len(gain) <= _LONGEST_IN_A_ROW and not gain.startswith("executed"):
            table.add_row(f"gain for {name}", gain)
        else:
            below.append(sentence)
    table.caption = "\n".join(sentence for sentence in (*below, *said) if sentence) or None
    table.caption_justify = "left"


#: Characters of a gain's description that a column is widened for.
_LONGEST_IN_A_ROW = 60
_STABLE = {True: "stable", False: "unstable", None: "not decided"}


def _margin(name: str, value: float) -> str:
    """A margin or a crossover in the unit that people read."""
    if name == "phase_margin":
        return f"{cell(math.degrees(value))} deg" if math.isfinite(value) else cell(value)
    unit = {"delay_margin": " s"}.get(name, " rad/s" if name.endswith("crossover") else "")
    return f"{cell(value)}{unit if math.isfinite(value) else ''}"


def certified_orbit_table(orbit: CertifiedOrbit) -> Table:
    """What is proved of a cycle, and below the table the statement, with the reason for what is not decided."""
    table = table_of("of the cycle", "proved")
    table.add_row("period", f"{orbit.period:.12g} s")
    table.add_row("known to", f"{orbit.radius:.1g} of its size")
    table.add_row("alone within", f"{orbit.unique_within:.1g} of its size")
    table.add_row("events", str(len(orbit.events)))
    table.add_row("stability", orbit.stability.name.replace("_", " ").lower())
    largest = f"{abs(orbit.multipliers[0]):.6g} ± {orbit.multiplier_radii[0]:.1g}" if orbit.multipliers.size else ""
    table.add_row("largest multiplier", largest)
    table.caption, table.caption_justify = str(orbit), "left"
    return table


def forced_table(found: ForcedResponse, signals: Sequence[str] | None = None) -> Table:
    """Responses to one sine, a column each: period, stability, and of these signals (all by default) their sizes and
    components at the input's frequency.
    """
    table = table_of("response", *(str(i) for i in range(1, len(found) + 1)))
    table.add_row("periods of the input", *(str(one.multiple) for one in found))
    table.add_row("stability", *("stable" if one.stable else "unstable" for one in found))
    table.add_row("largest multiplier", *(cell(one.largest_multiplier) for one in found))
    for name in _these(found[0].cycle.peak_to_peak, signals):
        unit, factor = readable(found[0].cycle.units.get(name, ""))
        spans, gains = [factor * one.cycle.peak_to_peak[name] for one in found], [one.response(name) for one in found]
        table.add_row(_span_of(name, unit), *map(cell, spans))
        table.add_row(f"{words(name)} gain", *(cell(abs(gain)) for gain in gains))
        table.add_row(f"{words(name)} phase [deg]", *map(_phase, gains))
    return table


def candidates_table(found: Diagnosis) -> Table:
    """The candidates of a diagnosis, one a row, likeliest first."""
    columns = ("candidate", "probability", "misfit", "free", "period [s]", "size (95 % interval), or why not")
    table = table_of(*columns, numbers=False)
    for e in found:
        about = "; ".join(text for text in (e.sizes(), e.note) if text)
        table.add_row(
            e.called,
            "-" if math.isnan(e.probability) else f"{e.probability:.3f}",
            cell(e.misfit),
            str(e.freedom),
            cell(e.period),
            about,
        )
    return table


def special_responses_table(found: FrequencyResponse) -> Table:
    """Folds and other special points of all branches, one a row."""
    unit, factor = readable(found.units.get(found.input, ""))
    table = table_of("at", "frequency [Hz]", with_unit("amplitude", unit), "gain", "phase [deg]")
    for branch in found.branches:
        for s in branch.special:
            size, gain = cell(factor * s.amplitude), cell(abs(s.response))
            table.add_row(s.kind, cell(s.frequency), size, gain, _phase(s.response))
    return table


def _phase(gain: complex) -> str:
    """Phase in degrees; what is rounding of zero is zero."""
    return cell(round(math.degrees(cmath.phase(gain)), 9) + 0.0)


def triggers_table(triggers: Sequence[Trigger]) -> Table:
    """The smallest disturbance of each kind that starts a cycle."""
    table = table_of("disturbed", "starts a cycle from", "largest tried")
    for trigger in triggers:
        unit, factor = readable(trigger.unit)
        none = math.isnan(trigger.size)
        size = "nothing tried starts one" if none else "any" if trigger.size == 0.0 else cell(trigger.size * factor)
        name = _STATE.sub(r"state \g<0>", words(trigger.name))
        table.add_row(with_unit(name, unit or "SI unit"), size, cell(trigger.tried * factor))
    return table


#: Settings whose names in code are no words, and the unit that those have which carry none.
_SETTINGS = {
    "t_end": ("length of the run", "s"),
    "time_step": ("time step", "s"),
    "step": ("step", "s"),
    "omega": ("frequency", "rad/s"),
    "frequency": ("frequency", "Hz"),
    "max_events": ("most events", ""),
    "max_steps": ("most steps", ""),
}


def provenance_table(facts: Mapping[str, Any]) -> Table:
    """Where a result comes from, one fact a row; parameters have a table of their own."""
    table = table_of("", "", numbers=False)
    for name, value in facts.items():
        if name == "parameters":
            continue
        if isinstance(value, Mapping):
            for key, inner in value.items():
                if not isinstance(inner, Mapping | list | tuple):
                    text = number(inner) if isinstance(inner, float) else str(inner)
                    said, unit = _SETTINGS.get(key, (words(key), "")) if name == "settings" else (words(key), "")
                    table.add_row(f"{name}: {said}", f"{text} {unit}".rstrip())
        else:
            table.add_row(name.replace("_", " "), str(value))
    return table


def sentence_table(text: str) -> Table:
    """A table that holds one sentence."""
    table = table_of("", numbers=False)
    table.add_row(text)
    return table


def cases_table(cases: Sequence[Case]) -> Table:
    """Name, kind and title of cases."""
    table = table_of("name", "kind", "title", numbers=False)
    for case in cases:
        table.add_row(case.name, case.kind, case.title)
    return table


def cycles_table(cycles: Sequence[LimitCycle], signals: Sequence[str] | None = None) -> Table:
    """Signals down (all by default), cycles across: mean and peak-to-peak of each."""
    table = table_of("", *(column for i in range(len(cycles)) for column in (f"cycle {i + 1}", "")))
    stability = {True: "stable", False: "unstable", None: "stability unknown"}
    late, pace = readable(next((c.units["time"] for c in cycles if "time" in c.units), "s"))
    for label, values in (
        ("", [stability[c.stable] for c in cycles]),
        ("frequency [Hz]", [cell(c.frequency) for c in cycles]),
        (with_unit("period", late), [cell(c.period * pace) for c in cycles]),
        ("estimated error", [percent(c.error_estimate) for c in cycles]),
    ):
        table.add_row(label, *(cell for value in values for cell in (value, "")))
    table.add_section()
    table.add_row("signal", *(cell for _ in cycles for cell in ("peak to peak", "mean")))
    for name in _these(dict.fromkeys(name for c in cycles for name in c.mean), signals):
        unit, factor = readable(next((c.units[name] for c in cycles if name in c.units), ""))
        cells = []
        for c in cycles:
            cells += [cell(c.peak_to_peak.get(name, math.nan) * factor), _mean(c, name, factor)]
        table.add_row(with_unit(words(name), unit), *cells)
    said = [_BEYOND] * any(c.error_estimate > 1.0 for c in cycles)
    said += [f"cycle {i}: {c.note}" for i, c in enumerate(cycles, 1) if c.note]
    if said:
        table.caption, table.caption_justify, table.caption_style = "\n".join(said), "left", ""
    return table


def ladder_table(ladder: Ladder, signals: Sequence[str] | None = None) -> Table:
    """Frequency, and size and mean of these signals, down; predicted and simulated cycles and errors across."""
    shown = (DESCRIBING_FUNCTION, SIMULATION)
    rungs = [row for row in ladder.rows if row.cycle is not None and row.method.startswith(shown)]
    rests = ladder.run.settled_at if ladder.run.limit_cycle is None else {}
    if not rungs:
        return rest_table(ladder.run, signals) if rests else sentence_table("no cycle to compare, and no rest")
    heads = [row.method.replace(DESCRIBING_FUNCTION, "predicted").replace(SIMULATION, "simulated") for row in rungs]
    table = table_of("", *heads, *(["at rest in simulation"] if rests else []), *(["error"] if ladder.errors else []))

    def add(label: str, cells: list[str], rest: str, error: float | None) -> None:
        last = [signed_percent(error)] if ladder.errors else []
        table.add_row(label, *cells, *([rest] if rests else []), *last)

    paces = [cell(row.quantities["frequency"]) for row in rungs]
    add("frequency [Hz]", paces, "-", ladder.errors.get("frequency", {}).get("frequency"))
    for name in _these(ladder.run.signals, signals):
        unit, factor = readable(ladder.run.units.get(name, ""))
        cycles = [row.cycle for row in rungs if row.cycle is not None]
        errors = ladder.errors.get(name, {})
        spans = [cell(_span(c, name) * factor) for c in cycles]
        if not any(_span(c, name) > 0.0 for c in cycles):
            errors = {}  # of what is constant there is nothing to compare but rounding errors
        add(_span_of(name, unit), spans, "0", errors.get("peak_to_peak"))
        means = [_mean(c, name, factor) for c in cycles]
        add("   mean", means, cell(at_rest(rests.get(name, math.nan)) * factor), errors.get("mean"))
    return table


def rungs_table(ladder: Ladder) -> Table:
    """The rungs of every limit cycle below each other: period, size, errors against the exact cycle, time taken.

    Unstable cycles that the search alone has found are one row where they are many.
    """
    unit, factor = readable(ladder.run.units.get(ladder.signal, ""))
    late, pace = readable(ladder.run.units.get("time", "s"))
    heads = "cycle", "method", with_unit("period", late), _span_of(ladder.signal, unit)
    table = table_of(*heads, "error of period", "error of size", "time [s]", "")
    table.columns[1].justify = table.columns[-1].justify = "left"
    numbers = sorted({row.exact for row in ladder.rows if row.exact is not None})
    of_cycle = {i: [row for row in ladder.rows if row.exact == i] for i in numbers}
    lone = [i for i, (first, *more) in of_cycle.items() if not more and first.cycle and not first.cycle.stable]
    folded = lone if len(lone) > _MOST_LONE else []
    for i in (*(i for i in of_cycle if i not in folded), None):
        for row in (row for row in ladder.rows if row.exact == i):
            frequency, span = row.quantities["frequency"], row.quantities["peak-to-peak"]
            errors = [row.error_of(name) for name in ("period", "peak-to-peak")]
            period = cell(pace / frequency if frequency else None)
            cells = [period, cell(None if span is None else span * factor), *errors, f"{row.seconds:.2g}"]
            table.add_row("-" if i is None else str(i + 1), row.method, *cells, row.note)
        table.add_section()
    if folded:
        many = [of_cycle[i][0] for i in folded]
        periods = sorted(pace / (row.quantities["frequency"] or math.nan) for row in many)
        spans = sorted(factor * (row.quantities["peak-to-peak"] or math.nan) for row in many)
        cells = [f"{cell(values[0])} to {cell(values[-1])}" for values in (periods, spans)]
        table.add_row(
            f"{len(many)} more", many[0].method, *cells, "exact", "exact", "", "the command cycles lists them"
        )
    return table


class TruthTable:
    """All cases in one table: what is known of each, what the run did, whether it agrees, and what the DF says."""

    def __init__(self) -> None:
        heads = (
            "case",
            "figure",
            "finding",
            "must",
            "simulated",
            "",
            "predicted [Hz]",
            "simulated [Hz]",
            "exact",
            "DF",
        )
        self.table = table_of(*heads, numbers=False)
        self.found: list[bool] = []
        self.from_paper = True

    def add(self, case: Case, ladder: Ladder) -> None:
        """A case, with the frequency of the stable predicted cycle (of the one that the run is on, if it is on one)."""
        expected, cycle = case.expected, ladder.run.limit_cycle
        stable = [i for i, c in enumerate(ladder.prediction or ()) if c.stable]
        chosen = [ladder.matched] if ladder.matched is not None else stable
        predicted = ", ".join(cell(ladder.rows[i].quantities["frequency"]) for i in chosen) or "none"
        found = as_found(case, ladder)
        self.table.add_row(
            case.name,
            expected.paper or "-",
            expected.finding or "-",
            expected.outcome or "-",
            ladder.outcome,
            AS_FOUND[found],
            predicted,
            cell(ladder.oscillations * cycle.frequency) if cycle else "none",
            _exact_cycles(ladder),
            _first_sentences(ladder),
        )
        if found is not None:
            self.found.append(found)
            self.from_paper &= bool(expected.paper)

    def sentence(self) -> str:
        """How many cases came out as they must; empty where none says."""
        whom = "the paper found" if self.from_paper else "their sources say"
        return f"{sum(self.found)} of {len(self.found)} as {whom}." if self.found else ""


#: How a table says whether the run did what it must.
AS_FOUND = {True: "ok", False: "FAIL", None: ""}


def as_found(case: Case, ladder: Ladder) -> bool | None:
    """Whether the run did what the case must do; None where the case does not say."""
    must = case.expected.outcome
    return None if must is None else ladder.outcome is must


def _exact_cycles(ladder: Ladder) -> str:
    """How many exact cycles of either kind there are; a dash where the search for them is refused."""
    if ladder.search is None:
        return "-"
    kinds = ((ladder.search.stable, "stable"), (ladder.search.unstable, "unstable"))
    return "\n".join(f"{len(cycles)} {kind}" for cycles, kind in kinds if cycles) or "none"


def _first_sentences(ladder: Ladder) -> str:
    """What the ladder says, in few words."""
    if not ladder.errors:
        return ladder.agreement.sentence(ladder.run.status)
    f, a = ladder.errors["frequency"]["frequency"], ladder.errors.get(ladder.signal, {}).get("peak_to_peak")
    size = f", {signed_percent(a)} in {words(ladder.signal)}" if a is not None else ""
    how = "Agrees" if ladder.agreement.name == "AGREE" else "Is there, but far off"
    return f"{how}: {signed_percent(f)} in frequency{size}."


def _span_of(name: str, unit: str) -> str:
    """What the size of a signal is called."""
    return with_unit(f"{words(name)} peak to peak", unit)


def _span(cycle: LimitCycle, name: str) -> float:
    """Peak-to-peak of a signal; what rounding leaves of a constant one is zero."""
    span, mean = cycle.peak_to_peak.get(name, math.nan), cycle.mean.get(name, math.nan)
    return 0.0 if span <= ROUNDING * abs(mean) else span


def _mean(cycle: LimitCycle, name: str, factor: float) -> str:
    """A mean in readable units; what is left of a mean of zero in a sum, or in a run, is not worth its digits."""
    span, mean = cycle.peak_to_peak.get(name, math.nan), cycle.mean.get(name, math.nan)
    return cell(mean * factor if abs(mean) > 1e-6 * span else 0.0)
