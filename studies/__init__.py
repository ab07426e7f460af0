"""What makes a page, a picture or a table of the documentation by computing."""

from pathlib import Path

#: The documentation, what its build makes for it, and what takes so long to make that it is kept there.
DOCS = Path(__file__).parents[1] / "docs"
GENERATED = DOCS / "_generated"
STORED = DOCS / "_static"
