"""Results as tables that a notebook shows as HTML and a terminal as text: those of the console; computes nothing."""

from __future__ import annotations

import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from eppanalysis.cases import Case
from eppanalysis.errors import EppError, shown
from eppanalysis.methods.bounds.result import DesignBounds
from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit
from eppanalysis.methods.certificates.result import Certificate
from eppanalysis.methods.comparison.ladder import Ladder
from eppanalysis.methods.design.result import Design
from eppanalysis.methods.margins.result import Margins
from eppanalysis.methods.search.trigger import Trigger
from eppanalysis.results import LimitCycle, Trajectory
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import Shown
from eppanalysis.tables import console, designs

if TYPE_CHECKING:
    from rich.table import Table

#: Fewer characters stay on one line; more than the second are a sentence.
_SHORT, _LONG = 28, 60
_LIKED = (
    "a case, a result, provenance, the margins of a prediction, limit cycles, disturbances, or cases with their ladders"
)


@dataclass(frozen=True, eq=False)
class ShownTable:
    """A table for people: HTML in a notebook, text elsewhere."""

    content: Table

    def __str__(self) -> str:
        """The table as text, not folded."""
        from rich.console import Console

        stream = io.StringIO()
        Console(file=stream, force_jupyter=False, highlight=False, markup=False, width=200).print(self.content)
        return "\n".join(line.removeprefix(" ").rstrip() for line in stream.getvalue().splitlines()).strip("\n")

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """The table as HTML; texts of a case are texts, whatever they hold."""
        head = "".join(_cell("th", str(column.header), column.justify) for column in self.content.columns)
        rows = zip(*(column.cells for column in self.content.columns), strict=True)
        columns = self.content.columns
        body = [
            "".join(_cell("td", str(text), column.justify) for text, column in zip(row, columns, strict=True))
            for row in rows
        ]
        lines = "\n".join(f"<tr>{row}</tr>" for row in body)
        above = f"<thead><tr>{head}</tr></thead>\n" if any(str(column.header) for column in columns) else ""
        note = html.escape(str(self.content.caption)) if self.content.caption else ""
        # The table may be wider than a phone and be pushed about under its window; its sentences stay in view.
        kept = '<div style="position: sticky; left: 0; max-width: min(46em, 90vw)">'
        under = '<caption style="caption-side: bottom; text-align: left; padding-top: 0.4em">'
        below = f"{under}{kept}{note}</div></caption>\n" if note else ""
        return f'<table class="eppanalysis">\n{below}{above}<tbody>\n{lines}\n</tbody>\n</table>'


def _cell(kind: str, text: str, justify: str) -> str:
    """A cell: short texts stay on one line, sentences have room beside them, and spaces that indent stay."""
    style = f"text-align: {'right' if justify == 'right' else 'left'}; padding-right: 1em"
    if len(text) < _SHORT:
        style += "; white-space: nowrap"
    elif len(text) > _LONG:
        style += "; min-width: min(20em, 50vw)"
    indent = "&emsp;" * ((len(text) - len(text.lstrip(" "))) // 2)
    return f'<{kind} style="{style}">{indent}{html.escape(text.strip())}</{kind}>'


def table(what: Any, signals: Sequence[str] | None = None) -> ShownTable:
    """A result as a table in the units that people read.

    Parameters
    ----------
    what : Case, result, mapping, or sequence
        Of a case its parameters with where they come from; of a ladder all methods side by side; of a run its cycle, or
        where it rests; of a prediction or a search its limit cycles; of bounds one a row, of a design its optimum and
        its front. A mapping is the margins of a prediction, or the provenance of a case. A sequence holds limit cycles,
        disturbances, or pairs of a case and its ladder. Of any other result it is its `to_frame`, in brief.
    signals : sequence of str, optional
        Of a ladder, a run and limit cycles: which signals, all by default; ``case.named_signals`` are those that the
        console shows.

    Returns
    -------
    ShownTable
        Shown as HTML by a notebook, as text by ``print``.

    Raises
    ------
    EppError
        If there is no table for it.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> print(epp.table({"gain_margin": 2.0, "phase_margin": 0.5}))
    margin             value
    ────────────────────────
    gain margin            2
    phase margin   28.65 deg
    """
    chosen = (signals,)
    for kind, make in _MAKERS:
        if isinstance(what, kind):
            return ShownTable(make(what, *chosen[: kind in _WITH_SIGNALS]))
    cycles = getattr(what, "cycles", what)
    if isinstance(cycles, Sequence) and not isinstance(cycles, str) and cycles:
        for kind, make in _OF_SEQUENCES:
            if all(isinstance(item, kind) for item in cycles):
                return ShownTable(make(cycles, *chosen[: kind in _WITH_SIGNALS]))
    elif isinstance(cycles, Sequence) and not isinstance(cycles, str):
        return ShownTable(console.sentence_table("none"))
    if isinstance(what, Shown):
        return ShownTable(console.result_table(what))
    raise EppError(f"table: there is none of {type(what).__name__}; expected {_LIKED}.")


def _mapping(values: Mapping[str, Any]) -> Table:
    if not all(isinstance(name, str) for name in values):
        raise EppError(f"table: the mapping has names such as {shown(next(iter(values)))}; expected texts.")
    if "sha256" in values:
        return console.provenance_table(values)
    return console.margins_table(values)


def _made_by(facts: Provenance) -> Table:
    """Of a case there is a table of its own."""
    return console.provenance_table({name: part for name, part in facts.to_dict().items() if name != "case"})


def _run(run: Trajectory, signals: Sequence[str] | None) -> Table:
    cycle = run.limit_cycle
    return console.rest_table(run, signals) if cycle is None else console.cycles_table([cycle], signals)


def _overview(pairs: Sequence[tuple[Case, Ladder]]) -> Table:
    found = console.TruthTable()
    for case, ladder in pairs:
        found.add(case, ladder)
    return found.table


_MAKERS: tuple[tuple[type, Any], ...] = (
    (Case, console.parameters_table),
    (Ladder, console.ladder_table),
    (Trajectory, _run),
    (DesignBounds, designs.bounds_table),
    (Design, designs.design_table),
    (Provenance, _made_by),
    (Margins, lambda found: console.all_margins_table([found])),
    (Certificate, console.certificate_table),
    (CertifiedOrbit, console.certified_orbit_table),
    (Mapping, _mapping),
)
_WITH_SIGNALS = (Ladder, Trajectory, LimitCycle)
_OF_SEQUENCES: tuple[tuple[type, Any], ...] = (
    (LimitCycle, console.cycles_table),
    (Trigger, console.triggers_table),
    (Margins, console.all_margins_table),
    (tuple, _overview),
)
