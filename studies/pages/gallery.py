"""Every kind of picture, drawn by the lines of ``docs/gallery.md``: ``python -m studies.pages.gallery [NAME...]``.

The page is the one source: each of its blocks of code is run, in the order of the page and with what the first block
makes, and what its last line gives is saved as the picture that follows. Names pick pictures.
"""

from __future__ import annotations

import ast
import io
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image

from eppanalysis.plotting import figure_of
from studies import DOCS

PAGE = DOCS / "gallery.md"
#: A block of code, and the picture that it makes.
BLOCK = re.compile(r"^```python\n(.*?)^```$(?:\n\n!\[.+?\]\((_static/\S+\.png)\))?", re.MULTILINE | re.DOTALL)
DOTS_AN_INCH = 150


def blocks(text: str) -> list[tuple[str, str]]:
    """Code and picture of each block of the page; no picture for what only prepares."""
    return BLOCK.findall(text)


def drawn(code: str, names: dict[str, Any]) -> Figure:
    """The figure that the last line of a block gives."""
    *before, last = ast.parse(code).body
    assert isinstance(last, ast.Expr), f"a block ends with what it draws: {code}"
    exec(compile(ast.Module(before, []), str(PAGE), "exec"), names)
    return figure_of(eval(compile(ast.Expression(last.value), str(PAGE), "eval"), names))


def make_all(folder: Path, chosen: Sequence[str] = ()) -> None:
    """Draw all pictures of the page, or those chosen."""
    (preparation, _), *pictures = blocks(PAGE.read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    exec(compile(preparation, str(PAGE), "exec"), names)
    for code, target in pictures:
        if not chosen or Path(target).stem in chosen:
            save(drawn(code, dict(names)), folder / target)


def save(figure: Figure, path: Path) -> None:
    """Write a picture in 256 colours, which take a third of the bytes: the page holds all of them."""
    stream = io.BytesIO()
    figure.savefig(stream, dpi=DOTS_AN_INCH)
    dots = (DOTS_AN_INCH, DOTS_AN_INCH)
    Image.open(stream).convert("RGB").quantize(256).save(path, optimize=True, dpi=dots)


if __name__ == "__main__":
    make_all(DOCS, sys.argv[1:])
