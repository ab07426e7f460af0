"""Sphinx configuration; pictures and tables are made from the package itself before anything is read."""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Iterator
from enum import Enum
from itertools import groupby
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from pygments.lexers.python import PythonConsoleLexer
from pygments.lexers.shell import BashLexer
from pygments.token import Keyword, Name
from sphinx.transforms import SphinxTransform

sys.path.insert(0, str(Path(__file__).parents[1]))

import eppanalysis
from benchmarks import figures as benchmark_figures
from studies import GENERATED
from studies.pages import figures, howto, identify, sums, tables
from studies.paper import figures as paper_figures, tables as paper_tables

#: What makes the pictures and tables that the pages include.
MAKERS = (figures, identify, tables, sums, howto, paper_figures, paper_tables, benchmark_figures)

project = "eppanalysis"
author = "eppanalysis developers"
version = release = eppanalysis.__version__

extensions = [
    "myst_nb",  # Markdown, and the tutorials, which run when the documentation is built
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",  # formulas are shown without a network, too
]
exclude_patterns = ["_build", "_templates", "_generated/*.md", "_static/*.md"]
templates_path = ["_templates"]
html_theme = "furo"
html_title = "eppanalysis"
html_static_path = ["_static"]
html_extra_path = ["llms.txt", "SKILL.md"]  # where assistants look for them
html_css_files = ["wide.css"]
html_show_copyright = False

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nitpicky = False

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False


def make_pages(app) -> None:
    """Make everything that the pages include."""
    GENERATED.mkdir(exist_ok=True)
    for maker in MAKERS:
        maker.make_all(GENERATED)


def leave_out(app, what, name, obj, skip, options) -> bool | None:
    """Fields of a class stand in its own words: a second list of their names has nothing to say of them."""
    return True if what == "attribute" and not (isinstance(obj, Enum) and name.isupper()) else None


def as_read(app, what, name, obj, options, signature, returned) -> tuple[str | None, str | None]:
    """A signature as people read it.

    It has no fields that a class keeps for itself, and dots for a default that is no plain value. Fields that are only
    given by name stand with those first that must be given, and those of the class itself before those of all its kind.
    """
    if what == "class" and signature and signature.startswith("(*, "):
        own = inspect.get_annotations(obj)
        given = inspect.signature(obj)
        order = sorted(given.parameters.values(), key=lambda p: (p.default is not p.empty, p.name not in own))
        bare = [p.replace(annotation=p.empty) for p in order]
        signature = str(given.replace(parameters=bare, return_annotation=given.empty))
    shown = re.sub(r"=<[^>]*>", "=...", re.sub(r", _\w+(=[^,)]*)?", "", signature or ""))
    return shown.replace(repr(math.pi), "pi") or signature, returned


def where_written(app, module, name) -> str | None:
    """The module that holds the code of a public function, which calls itself one of the package."""
    found = getattr(eppanalysis, name, None) if module == "eppanalysis" else None
    return inspect.unwrap(found).__module__ if inspect.isfunction(found) else None


class Commands(BashLexer):
    """Lines for a shell whose options are marks of their own, so that none is broken at its hyphens."""

    tokens: ClassVar[dict[str, list]] = {
        **BashLexer.tokens,
        "root": [(r"(?<=[\s\[])--?[A-Za-z][\w-]*", Name.Attribute), *BashLexer.tokens["root"]],
    }


class Session(PythonConsoleLexer):
    """Examples in which ``case`` is the name of a case, and not the word that stands in ``match``."""

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple]:
        """Tokens with their places."""
        for place, kind, value in super().get_tokens_unprocessed(text):
            yield place, Name if kind is Keyword and value == "case" else kind, value


_SYMBOL = r"(?:[nµμmckMG]?(?:Hz|rad|lbf|m|s|g|N|V|A|W|B|Ω)|[KMG]iB|deg|dB|ohm|min|h|lb|px|%)[²³]?"
#: The space between a number and its unit, its sign, or what is counted by it.
_NO_BREAK = (
    rf"(?<=[\d⁰¹²³⁴-⁹°]) (?=(?:{_SYMBOL}(?:[·/]{_SYMBOL})*|per cent)(?![\w·/]))"
    r"|(?<=[±<>]) (?=\d)|(?<=Figure) (?=\d)|(?<=Fig\.) (?=\d)|(?<=Equation) (?=\()"
)
#: The sign of an exponent, behind which a browser would end the line.
_EXPONENT = r"(?<=\de-)(?=\d)"
_VERBATIM = nodes.FixedTextElement, nodes.literal, nodes.math, nodes.math_block, nodes.raw


class OneLine(SphinxTransform):
    """No line ends within a number, between it and its unit, or between a formula in a sentence and what touches it.

    A browser may break a line on either side of a formula, also before a full stop.
    """

    default_priority = 900  # quotation marks have been made by then

    def apply(self, **options) -> None:
        """Put no-break spaces before units, and formulas into one piece with what touches them."""
        for text in list(self.document.findall(nodes.Text)):
            if not isinstance(text.parent, _VERBATIM):
                before = text.parent[max(text.parent.index(text) - 1, 0)]
                number = "0" * isinstance(before, nodes.math)  # as which a formula counts
                held = re.sub(_NO_BREAK, "\N{NO-BREAK SPACE}", f"{number}{text}").removeprefix(number)
                text.parent.replace(text, nodes.Text(re.sub(_EXPONENT, "\N{WORD JOINER}", held)))
        for parent in {id(formula.parent): formula.parent for formula in self.document.findall(nodes.math)}.values():
            parent[:] = list(_in_runs(parent))


class LastLine(SphinxTransform):
    """A block of code ends with its last line, also where an example needs an empty one before the fence."""

    default_priority = 900

    def apply(self, **options) -> None:
        """Take empty lines off the ends of blocks."""
        for block in self.document.findall(nodes.literal_block):
            if block.rawsource == block.astext():  # not one with markup of its own
                block.rawsource = block.rawsource.rstrip()
                block[:] = [nodes.Text(block.rawsource)]


def _in_runs(parent: nodes.Element) -> Iterator[nodes.Node]:
    """The children of a node, with each run without a space in it that holds a formula as one."""
    pieces = []
    for child in parent.children:
        split = re.split(r"([ \t\n]+)", child) if isinstance(child, nodes.Text) else [child]
        pieces += [nodes.Text(piece) if isinstance(piece, str) else piece for piece in split if piece != ""]
    for space, run in groupby(pieces, lambda piece: isinstance(piece, nodes.Text) and piece.isspace()):
        together = list(run)
        if not space and len(together) > 1 and any(isinstance(piece, nodes.math) for piece in together):
            yield nodes.inline("", "", *together, classes=["together"])
        else:
            yield from together


def setup(app) -> None:
    """Register the maker of pictures and tables, what lists of attributes leave out, how code and lines look."""
    for name in ("sh", "bash"):  # commands that the tests run, and others
        app.add_lexer(name, Commands)
    app.add_lexer("pycon", Session)
    app.add_transform(OneLine)
    app.add_transform(LastLine)
    app.connect("builder-inited", make_pages)
    app.connect("autodoc-skip-member", leave_out)
    app.connect("autodoc-process-signature", as_read)
    app.connect("viewcode-follow-imported", where_written)
