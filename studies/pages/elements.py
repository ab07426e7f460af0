"""The page on the elements of a case file, made from their signatures: ``python -m studies.pages.elements``.

It is under version control, for it is read where nothing is built; a test compares it with the code.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from itertools import groupby

from eppanalysis.cases.blocks import element_class
from eppanalysis.models.elements import ELEMENTS
from studies import DOCS

PAGE = DOCS / "reference" / "elements.md"

_INTRODUCTION = """\
# Elements of a case file

<!-- Made by "python -m studies.pages.elements" from the code; changes belong there. -->

What stands behind `element =` in `[elements]` of a diagram ({doc}`diagrams`), or in `[[loop.blocks]]` or
`[[loop.elements]]` of a loop ({doc}`loops`), with its fields. A field without a default must be given. A value is a
plain number, a text with a unit (`"12 mm"`, which becomes SI), in a diagram an expression of its parameters, or a table
of `value`, `mark`, `note` and `tolerance` ({doc}`../cases`); fields that hold several numbers (`piecewise_linear`, the
tables, `polynomial`) are lists of them.
Units in brackets are those that the loop around the element has there: where its input is a length, the gap of a
play is one too.

Besides its own fields every element takes

| field | default | meaning |
| --- | --- | --- |
| `name` | the element's kind | what `--set`, sweeps and signals call it (`play.gap`); its own in a loop |
| `memory` | the element's own | value that an element with memory holds at the start |

An element of your own is `automaton`, with its modes, guards and resets as fields: {doc}`../howto/own_element`.
"""

_PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", re.MULTILINE | re.DOTALL)
_ENTRY = re.compile(r"^(\w[\w, ]*?) : [^\n]*\n((?:[ ]+[^\n]*\n?|\n)+)", re.MULTILINE)


def page() -> str:
    """The page as Markdown."""
    return _INTRODUCTION + "".join(f"\n{_section(kind)}" for kind in ELEMENTS)


def meanings(kind: str) -> dict[str, str]:
    """What each field of an element means, from its docstring."""
    section = _PARAMETERS.search((inspect.getdoc(element_class(kind)) or "") + "\n")
    return {
        name.strip(): " ".join(text.split())
        for names, text in (_ENTRY.findall(section[1]) if section else ())
        for name in names.split(",")
    }


def _section(kind: str) -> str:
    """Heading, first paragraph of the docstring, and the fields of an element."""
    made = element_class(kind)
    says, known = (inspect.getdoc(made) or "").split("\n\n")[0], meanings(kind)
    fields = inspect.signature(made).parameters.values()
    rows = [
        f"| {', '.join(f'`{p.name}`' for p in alike)} | {_defaults(alike)} | {_markdown(meaning)} |"
        for meaning, alike in ((meaning, list(p)) for meaning, p in groupby(fields, key=lambda p: known[p.name]))
    ]
    if made.columns:
        named = " and ".join(f"`{column}`" for column in made.columns)
        path = "Path of a CSV file in the case's folder"
        rows.append(f"| `file` | none | {path}, in place of {named}: its first columns, with units in a header. |")
    head = ["| field | default | meaning [unit] |", "| --- | --- | --- |"]
    return "\n".join([f"## {kind}", "", _markdown(says).replace("\\|", "|"), "", *head, *rows]) + "\n"


def _defaults(alike: Iterable[inspect.Parameter]) -> str:
    """The defaults of parameters, in one word where they are the same."""
    return ", ".join(dict.fromkeys(map(_default, alike)))


def _default(parameter: inspect.Parameter) -> str:
    if parameter.default is parameter.empty:
        return "must be given"
    return "none" if parameter.default is None else f"`{parameter.default}`"


def _markdown(text: str) -> str:
    """A piece of a docstring as one line of a Markdown table."""
    line = re.sub(r"`+([^`]*)`+", r"`\1`", re.sub(r":class:", "", " ".join(text.split())))
    # A star between units is no emphasis; a bar ends no cell.
    return re.sub(r"(?<=\w)\*(?=\w)(?=[^`]*(?:`[^`]*`[^`]*)*$)", "·", line).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
