"""What is written to a console or a pipe whose encoding lacks a sign: a sign that is there, in place of a traceback."""

from __future__ import annotations

import codecs
import unicodedata
from typing import Any

#: Letters and signs of units and formulas by what replaces them where they cannot be written.
_PLAIN = {
    "·": "*", "⋅": "*", "×": "x", "°": "deg", "µ": "u", "μ": "u", "Ω": "ohm", "ω": "omega", "ζ": "zeta", "θ": "theta",
    "π": "pi", "±": "+-", "−": "-", "–": "-", "—": "-", "─": "-", "━": "-", "≤": "<=", "≥": ">=", "≈": "~",
    "…": "...",
}  # fmt: skip


def _in_plain_signs(error: UnicodeError) -> tuple[str, int]:
    """What replaces signs that an encoding lacks: itself written otherwise, its letter without accents, else "?"."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_plain, error.object[error.start : error.end])), error.end


def _plain(sign: str) -> str:
    found = _PLAIN.get(sign) or unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
    return found or "?"


codecs.register_error("eppanalysis.plain", _in_plain_signs)


def write_plainly(stream: Any) -> None:
    """Have a text stream write other signs in place of those that its encoding lacks."""
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="eppanalysis.plain")


def has_all_signs(stream: Any) -> bool:
    """Whether a text stream can write every sign."""
    encoding = getattr(stream, "encoding", None)
    return encoding is None or codecs.lookup(encoding).name.startswith("utf")
