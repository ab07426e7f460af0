"""Sphinx configuration; pictures and tables are made from the package itself before anything is read."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import figures  # noqa: E402
import figures_howto  # noqa: E402
import figures_identify  # noqa: E402
import figures_paper  # noqa: E402
import tables  # noqa: E402
import tables_paper  # noqa: E402

import eppanalysis  # noqa: E402
from tests.benchmarks import figures as figures_benchmarks  # noqa: E402

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
exclude_patterns = ["_build", "_generated/*.md", "_static/*.md"]
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
    generated = HERE / "_generated"
    generated.mkdir(exist_ok=True)
    figures.make_all(generated)
    figures_identify.make_all(generated)
    tables.make_all(generated)
    figures_howto.make_all(generated)
    figures_paper.make_all(generated)
    tables_paper.make_all(generated)
    figures_benchmarks.make_all(generated)


def setup(app) -> None:
    """Register the maker of pictures and tables."""
    app.connect("builder-inited", make_pages)
