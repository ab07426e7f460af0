"""The page on the elements of a case file, made from their signatures: ``python -m studies.pages.elements``.

It is under version control, for it is read where nothing is built; a test compares it with the code.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from itertools import groupby

from eppanalysis.cases.blocks import element_class
from eppanalysis.cases.words import KINDS_OF_ELEMENTS
from eppanalysis.models.elements import ELEMENTS
from studies import DOCS
from studies.pages.words import other_words_line

PAGE = DOCS / "reference" / "elements.md"

_INTRODUCTION = """\
# Elements of a case file

<!-- Made by "python -m studies.pages.elements" from the code; changes belong there. -->

The values of `kind =` in `[elements]` of a diagram ({doc}`diagrams`), or in `[[loop.blocks]]` or `[[loop.elements]]`
of a loop ({doc}`loops`), with their fields. A field without a default is required. A value is a number in SI units, a
quantity (`"12 mm"`), in a diagram an expression, or a table of `value`, `mark`, `note`, `tolerance` ({doc}`../cases`).
In brackets, [u] is the unit of the element's input in the loop, [y] that of its output.

Every element also takes `name` (default: its kind; `--set`, sweeps and signals use it: `play.gap`) and `memory` (what
an element with memory holds at the start). Words behind "Also" are read as the kind, or the field before them; results
print ours. `element` is read as `kind`. An element of your own is `automaton`: {doc}`../howto/own_element`.
"""

#: Units of a loop as docstrings spell them and as the page abbreviates them, longest first.
_UNITS = {
    "unit of the output times s squared per unit of the input": "y·s²/u",
    "unit of the output per unit of the input and s": "y/(u·s)",
    "1 per unit of the input and s": "1/(u·s)",
    "unit of the output per unit of the input, times s": "y·s/u",
    "unit of the output per unit of the input": "y/u",
    "unit of the output per squared unit of the input": "y/u²",
    "unit of the output per cubed unit of the input": "y/u³",
    "unit of the input, which is that of the output": "u = y",
    "unit of input and output": "u = y",
    "unit of the output per s": "y/s",
    "unit of the output": "y",
    "unit of the input": "u",
}
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
        f"- {', '.join(f'`{p.name}`' for p in alike)}{_defaults(alike)}: {_markdown(meaning)}"
        for meaning, alike in ((meaning, list(p)) for meaning, p in groupby(fields, key=lambda p: known[p.name]))
    ]
    if made.columns:
        named = " and ".join(f"`{column}`" for column in made.columns)
        path = "CSV file in the case's folder"
        rows.append(f"- `file`: {path} with {named}: its first columns, units in a header.")
    if (estimate := made.estimate) is not None:
        named = ", ".join(f"`{name}`" for name in estimate.sizes)
        rows.append(f"- {named}: Sizes [m], in place of `{estimate.field}`, to estimate it from: {estimate.by}.")
    also = other_words_line(kind, KINDS_OF_ELEMENTS)
    return f"## {kind}\n\n{_markdown(says)}\n\n{also}" + "\n".join(rows) + "\n"


def _defaults(alike: Iterable[inspect.Parameter]) -> str:
    """The defaults of parameters behind their names, in one word where they are the same."""
    words = dict.fromkeys(map(_default, alike))
    return f" ({', '.join(words)})" if any(words) else ""


def _default(parameter: inspect.Parameter) -> str:
    if parameter.default is parameter.empty:
        return ""
    return "optional" if parameter.default is None else f"`{parameter.default}`"


def _markdown(text: str) -> str:
    """A piece of a docstring as one line of Markdown."""
    line = re.sub(r"`+([^`]*)`+", r"`\1`", re.sub(r":class:", "", " ".join(text.split())))
    line = re.sub(r"\[((?:1 per )?unit of [^]]*)\]", lambda unit: f"[{_UNITS.get(unit[1], unit[1])}]", line)
    # A star between units is no emphasis.
    return re.sub(r"(?<=\w)\*(?=\w)(?=[^`]*(?:`[^`]*`[^`]*)*$)", "·", line)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
