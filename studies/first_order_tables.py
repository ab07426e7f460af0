"""Tables and picture of the study of first order (``first_order.py``), from its stored rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eppanalysis.plotting import BLUE, GREY, SMALL, VERMILLION, panels_of, put_legend
from studies.first_order import ELEMENTS, Row, read

#: Largest amplitude over the threshold of each group.
RATIOS = (1.2, 1.5, 2.0, 4.0, 12.5)
SHARES = (0.5, 0.9, 0.95)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g}" if share < 0.1 else f"{100.0 * share:.3g}"


def _line(name: str, rows: Sequence[Row]) -> list[str]:
    """Counts, quantiles of the errors of cycles that exist, and how often the estimate covers them."""
    real = [r for r in rows if r.exists]
    frequency, amplitude = ([getattr(r, f"error_{k}") for r in real] for k in ("frequency", "peak_to_peak"))
    cells = [_percent(float(q)) for values in (frequency, amplitude) for q in np.quantile(values, SHARES)]
    covered = np.mean([r.estimate >= r.error for r in real])
    over = np.median([r.estimate / max(r.error, 1e-9) for r in real])
    return [name, str(len(rows)), str(len(rows) - len(real)), *cells, f"{100.0 * covered:.0f}", f"{over:.2f}"]


HEADER = ["", "cycles", "not real", *(f"{what} {100 * q:g} %" for what in ("frequency", "size") for q in SHARES)]
HEADER += ["covered", "estimate over error"]


def by_element() -> tuple[list[str], list[list[str]]]:
    """One line an element, and all."""
    rows = read()
    lines = [_line(name, [r for r in rows if r.element == name]) for name in ELEMENTS]
    return HEADER, [*lines, _line("**all**", rows)]


def by_filter() -> tuple[list[str], list[list[str]]]:
    """By relative degree of the linear part: how fast it falls."""
    rows = read()
    degrees = sorted({r.relative_degree for r in rows})
    return HEADER, [_line(f"relative degree {d}", [r for r in rows if r.relative_degree == d]) for d in degrees]


def by_ratio() -> tuple[list[str], list[list[str]]]:
    """By amplitude over the threshold (half gap, limit); the relay has none."""
    rows = [r for r in read() if r.element != "relay"]
    lines, low = [], 1.0
    for high in RATIOS:
        group = [r for r in rows if low <= r.ratio < high]
        lines.append(_line(f"{low:g}\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}{high:g}", group))
        low = high
    return HEADER, lines


def first_order_errors() -> Figure:
    """True error over the estimate, and over the harmonic content."""
    rows = [r for r in read() if r.exists]
    figure, (left, right) = panels_of(2, 2.6)
    kinds: tuple[tuple[str, Callable[[Row], bool], str, str], ...] = (
        ("stable", lambda r: r.stable, BLUE, "o"),
        ("unstable", lambda r: not r.stable, VERMILLION, "^"),
    )
    for label, keep, colour, marker in kinds:
        some = [r for r in rows if keep(r)]
        style: dict[str, Any] = {
            "linestyle": "none",
            "marker": marker,
            "markersize": 3.0,
            "color": colour,
            "alpha": 0.6,
        }
        true = [max(r.error, 1e-6) for r in some]
        left.loglog([min(max(r.estimate, 1e-6), 10.0) for r in some], true, label=label, **style)
        right.loglog([max(r.content, 1e-4) for r in some], true, **style)
    line = np.array([1e-6, 10.0])
    left.loglog(line, line, color=GREY, linewidth=0.8)
    left.annotate("error = estimate", (8e-6, 1.5e-6), fontsize=SMALL, color="#555555")
    left.set_xlabel("error estimate of the prediction")
    left.set_ylabel("true relative error")
    right.set_ylabel("true relative error")
    right.set_xlabel("harmonics over fundamental at the element's input")
    put_legend(left)
    return figure
