"""How a result shows itself on a console and in a notebook: its sentence, its table, its picture, what made it.

A result, and what was measured, says three things of its own: a sentence (``__str__``), a table in SI units
(``to_frame``) and a picture (``plot``). What people see is made of them here, once for all.
"""

from __future__ import annotations

import base64
import cmath
import html
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from eppanalysis.errors import EppError
from eppanalysis.readable import number, readable, with_unit, words

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Rows of a table that are shown; of a longer one those at both ends.
_MOST_ROWS = 12
#: Size of the picture beside the table [inch], and its dots per inch.
_SMALL, _DOTS = (4.6, 3.0), 110
_STYLE = "display: flex; flex-wrap: wrap; gap: 1.5em; align-items: flex-start"
_CELL = '<td style="text-align: left; padding-right: 1em">'
#: What the columns are called whose rad/s are no turning of a shaft; they stay in rad/s.
_ANGULAR = ("omega", "crossover")
#: Parts of the provenance that fill pages and have tables of their own.
_LONG = ("parameters",)
#: Where a clause ends.
_CLAUSE = re.compile(r"[.;] ")


class Shown:
    """What people see of a result, made of its own sentence, table and picture."""

    #: Case or system that the picture names; empty where the sentence does.
    subject: str = ""

    def facts(self) -> Mapping[str, Any]:
        """What it comes from, as plain data."""
        raise NotImplementedError

    def to_frame(self) -> pandas.DataFrame:
        """The result as a table in SI units; ``attrs["units"]`` of it says which."""
        raise NotImplementedError

    def plot(self, ax: Axes | None = None) -> Axes:
        """The picture; see :meth:`drawn`."""
        raise NotImplementedError

    def drawn(self, function: str, ax: Axes | None, *options: Any) -> Axes:
        """The axes into which a function of the module `picture` in the result's own room draws it.

        Into given axes goes its main panel; without any, the whole picture goes on a figure of its own (``ax.figure``)
        with the verdict above it, and its first axes are returned. A notebook shows them as that figure.
        """
        from eppanalysis.plotting import put_verdict

        figure = self.by("picture", function, *options, ax)
        if ax is not None:
            return ax
        verdict = self.headline()
        rest = str(self).removeprefix(verdict).lstrip(".;: ")
        put_verdict(figure, verdict, rest[:1].upper() + rest[1:], self.subject)
        first: Axes = figure.axes[0]
        # A figure that no window manages is shown by nobody; what a notebook looks for is this name.
        first._repr_png_ = partial(png, figure)  # type: ignore[attr-defined]
        return first

    def by(self, module: str, function: str, *options: Any) -> Any:
        """What a function in the result's own room makes of it: a picture, a file.

        Such a function knows the result. So that no two modules know each other, a result knows it by name only; what
        draws and writes is loaded when something is drawn or written.
        """
        own = import_module(type(self).__module__)
        room = own.__name__ if hasattr(own, "__path__") else own.__name__.rpartition(".")[0]
        return getattr(import_module(f"{room}.{module}"), function)(self, *options)

    def headline(self) -> str:
        """The verdict alone, as it is above the picture: what the sentence begins with."""
        sentence = str(self)
        ends = (found.start() for found in _CLAUSE.finditer(sentence))
        # What is in brackets may hold a full stop that ends no clause.
        whole = (end for end in ends if sentence.count("(", 0, end) == sentence.count(")", 0, end))
        return sentence[: next(whole, None)].removesuffix(".")

    def in_brief(self) -> pandas.DataFrame:
        """The rows of the table that are shown with the sentence; by default all of them."""
        return self.to_frame()

    def __repr__(self) -> str:
        """The sentence, and below it the table where the result is a list of things."""
        if not hasattr(self, "__len__") or not len(self):
            return str(self)
        return f"{self}\n{for_people(self.in_brief()).to_string(index=False)}"

    def _repr_html_(self) -> str:
        """What a notebook shows: the sentence, the table, a small picture, and folded away what made the result."""
        table = for_people(self.in_brief()).to_html(index=False, border=0, justify="left").replace("<td>", _CELL)
        return (
            f'<div class="eppanalysis"><p><strong>{html.escape(str(self))}</strong></p>'
            f'<div style="{_STYLE}"><div>{table}</div>{self._picture()}</div>'
            f"<details><summary>Where this comes from</summary>{_facts(self.facts())}</details></div>"
        )

    def _picture(self) -> str:
        """The small picture as inline PNG, or why there is none."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=_SMALL, layout="constrained")
        try:
            self.plot(figure.add_subplot())
        except EppError as reason:
            return f"<div>No picture: {html.escape(str(reason))}</div>"
        data = base64.b64encode(png(figure, _DOTS)).decode()
        return f'<img alt="{html.escape(str(self))}" src="data:image/png;base64,{data}">'


def html_row(cells: Iterable[str], cell: str = _CELL) -> str:
    """A row of a table as notebooks show it, `cell` being how each of its cells begins."""
    return f"<tr>{''.join(f'{cell}{html.escape(text)}</td>' for text in cells)}</tr>"


def frame_of(
    rows: Sequence[Mapping[str, Any]],
    units: Mapping[str, str] | None = None,
    shown: Mapping[str, tuple[str, float]] | None = None,
) -> pandas.DataFrame:
    """A table of rows of SI values that carries the units of its columns, and those that people use for some.

    Examples
    --------
    >>> frame_of([{"gap": 0.002}], {"gap": "m"}).attrs["units"]
    {'gap': 'm'}
    """
    import pandas

    frame = pandas.DataFrame(list(rows))
    frame.attrs["units"] = {name: unit for name, unit in (units or {}).items() if unit and name in frame.columns}
    frame.attrs["shown"] = dict(shown or {})
    return frame


def for_people(frame: pandas.DataFrame) -> pandas.DataFrame:
    """A table as texts, in the units that people read; a long one is cut in the middle.

    Examples
    --------
    >>> frame = frame_of([{"play.gap": 0.002, "stable": True}], {"play.gap": "m"})
    >>> print(for_people(frame).to_string(index=False))
    play gap [mm] stable
                2    yes
    """
    import pandas

    units: Mapping[str, str] = frame.attrs.get("units", {})
    known: Mapping[str, tuple[str, float]] = frame.attrs.get("shown", {})
    shown = {}
    for name in frame.columns:
        angular = any(part in str(name) for part in _ANGULAR)
        unit, factor = (units.get(name, ""), 1.0) if angular else readable(units.get(name, ""))
        unit, factor = known.get(str(name), (unit, factor))
        shown[with_unit(words(str(name)), unit)] = [_cell(value, factor) for value in frame[name].tolist()]
    table = pandas.DataFrame(shown)
    if len(table) <= _MOST_ROWS:
        return table
    half = _MOST_ROWS // 2
    left_out = pandas.DataFrame({name: ["..."] for name in table.columns})
    return pandas.concat([table.head(half), left_out, table.tail(half)])


def _cell(value: Any, factor: float) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, complex):
        return f"{number(factor * abs(value))} at {number(round(math.degrees(cmath.phase(value)), 6) + 0.0)} deg"
    if not isinstance(value, int | float):
        return str(value)
    return number(value if factor == 1.0 else factor * value)


def png(figure: Figure, dots: float = 110.0) -> bytes:
    """A figure as PNG."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dots, metadata={"Software": None})
    return stream.getvalue()


def _facts(facts: Mapping[str, Any]) -> str:
    """Facts as a table of two columns; those of a fact go below its name."""
    rows = "".join(html_row((words(name), text)) for name, text in _leaves(facts))
    return f"<table><tbody>{rows}</tbody></table>"


def _leaves(facts: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        if name in _LONG:
            continue
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{name}: ")
        else:
            yield f"{above}{name}", str(value)
