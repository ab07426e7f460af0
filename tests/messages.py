"""Every text of the package that a user may read, as it stands in the source."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent


class Message(NamedTuple):
    """A text of two words or more, with its file and line; a value that the program fills in is ``{}``."""

    path: str
    line: int
    text: str


def _written(node: ast.AST) -> str | None:
    """Text of a string or of an f-string."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        parts = [part.value if isinstance(part, ast.Constant) else "{}" for part in node.values]
        return "".join(str(part) for part in parts)
    return None


def _strings(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Strings below a node, without those that are statements: docstrings, and what describes a field."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Expr) and _written(child.value) is not None:
            continue
        text = _written(child)
        if text is not None:
            yield child.lineno, text
        if isinstance(child, ast.JoinedStr):  # what stands within the braces may hold texts as well
            for part in child.values:
                if isinstance(part, ast.FormattedValue):
                    yield from _strings(part.value)
        elif text is None:
            yield from _strings(child)


@cache
def messages() -> list[Message]:
    """Texts of the package outside its docstrings and comments."""
    found = []
    for path in sorted((ROOT / "eppanalysis").rglob("*.py")):
        for line, text in _strings(ast.parse(path.read_text(encoding="utf-8"))):
            if " " in text.strip():
                found.append(Message(str(path.relative_to(ROOT)), line, " ".join(text.split())))
    return found
