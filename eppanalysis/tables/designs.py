"""Bounds and designs to tables on the console, in the units that people read."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from rich.table import Table

from eppanalysis.limits import Limit
from eppanalysis.methods.bounds.result import Finding, Turn
from eppanalysis.readable import percent, signed_percent, with_unit, words
from eppanalysis.tables.cells import cell, table_of

if TYPE_CHECKING:
    from eppanalysis.methods.bounds.result import BoundCell, DesignBounds
    from eppanalysis.methods.design.result import Design


def bounds_table(bounds: DesignBounds) -> Table:
    """Bounds as they are printed and by every method, over the parameter that runs; where a size is allowed, what is
    active and the size.
    """
    (x_unit, x), (y_unit, y) = (bounds.readable[name] for name in (bounds.over, bounds.limit))
    if bounds.not_covered:
        return _searched_bounds_table(bounds)
    allowed, printed = bounds.allowed, bounds.printed
    columns: list[tuple[str, Callable[[BoundCell], str]]] = [
        (_kept(bounds), lambda c: printed.digits(c.printed)),
        (with_unit("exact", y_unit), lambda c: printed.figures(replace(c.printed, value=c.exact))),
        (with_unit("DF", y_unit), lambda c: cell(y * c.first_order)),
        ("", lambda c: signed_percent(c.first_order_error) + " unsafe" * c.first_order_unsafe),
    ]
    if allowed is not None:
        size = f"{words(allowed.signal)} there"
        columns.append(("active", lambda c: c.kind or "-"))
        columns.append((size, lambda c: allowed.text(c.size) if math.isfinite(c.size) else "-"))
    columns.append(("frequency [Hz]", lambda c: cell(c.frequency)))
    proofs = any(c.proved is not None for c in bounds)
    beside = [*(with_unit(f"proved {side}", y_unit) for side in ("free", "cycle")), "apart"] if proofs else []
    table = table_of(with_unit(words(bounds.over), x_unit), *(head for head, _ in columns), "verified", *beside)
    for c in bounds:
        bound = c.finding is Finding.BOUND
        proved = ["-"] * len(beside)
        if c.proved is not None:
            above = c.sign < 0
            free, cycle = Limit(c.proved.free, above), Limit(c.proved.cycle, not above)
            proved = [printed.figures(free), printed.figures(cycle), percent(c.proved.gap)]
        tested = f"yes, {c.n_settled} runs" if c.verified else "no"
        shown = [text(c) if bound else "-" for _, text in columns]
        table.add_row(cell(x * c.value), *shown, tested if bound else c.finding, *proved)
    return table


def _kept(bounds: DesignBounds) -> str:
    """The head of the column that says how far the parameter may go."""
    above = {c.sign < 0 for c in bounds if math.isfinite(c.bound)}
    side = "at most" if True not in above else "at least" if False not in above else "keep to"
    return with_unit(side, bounds.readable[bounds.limit][0])


def design_table(design: Design) -> Table:
    """The optimum, and the front below it: the tuned parameters, what is active, and whether it is confirmed."""
    names, over = list(design.tune), design.front_over
    own = [] if design.objective in names else [design.objective]
    heads = [with_unit(words(name), design.readable[name][0]) for name in ([over] if over else []) + own + names]
    table = table_of(*heads, with_unit("DF", design.readable[design.limit][0]), "active", "confirmed")
    for place, (value, best) in enumerate([(design.front_own, design.optimum), *design.front]):
        shown = [design.inside(best, n).partition(" ")[0] if best.feasible else "-" for n in own + names]
        first_order = cell(design.readable[design.limit][1] * best.first_order)
        active = best.active or (best.kind if best.kind is not Turn.END else "own range")
        active = active if best.feasible else "infeasible"
        beside = [cell(design.readable[over][1] * value) + " (own)" * (place == 0)] if over else []
        table.add_row(*beside, *shown, first_order, active, "yes" if best.confirmed else "no")
    return table


def _searched_bounds_table(bounds: DesignBounds) -> Table:
    """Bounds of a sampled loop: the last value without a cycle, and where one was found."""
    (x_unit, x), (y_unit, y) = (bounds.readable[name] for name in (bounds.over, bounds.limit))
    printed = bounds.printed
    heads = _kept(bounds), with_unit("no cycle found", y_unit), with_unit("cycle found", y_unit)
    table = table_of(with_unit(words(bounds.over), x_unit), *heads, "frequency [Hz]", "finding", "values tried", "runs")
    for c in bounds:
        beyond = Limit(c.other_value, c.sign > 0)
        known = [printed.digits(c.printed), printed.figures(c.printed), printed.figures(beyond), cell(c.frequency)]
        shown = known if c.finding is Finding.BOUND else ["-"] * len(known)
        table.add_row(cell(x * c.value), *shown, c.finding, str(c.n_searched), str(c.n_runs))
    return table
