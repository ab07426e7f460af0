"""Sphinx configuration; pictures and tables are made from the package itself before anything is read."""

from __future__ import annotations

import inspect
import math
import re
import sys
from enum import Enum
from pathlib import Path
from typing import ClassVar

from pygments.lexers.shell import BashLexer
from pygments.token import Name

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


def setup(app) -> None:
    """Register the maker of pictures and tables, what lists of attributes leave out, and how commands are coloured."""
    for name in ("sh", "bash"):  # commands that the tests run, and others
        app.add_lexer(name, Commands)
    app.connect("builder-inited", make_pages)
    app.connect("autodoc-skip-member", leave_out)
    app.connect("autodoc-process-signature", as_read)
    app.connect("viewcode-follow-imported", where_written)
