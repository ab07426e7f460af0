"""What can be certified: each statement, which module finds its certificates, and which small program checks them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any


class Claim(StrEnum):
    """What `certify` can prove."""

    ROOTS = "roots"
    ABSENCE = "absence"
    CYCLES = "cycles"


@dataclass(frozen=True)
class Statement:
    """A kind of statement."""

    text: str  # the statement as its certificates name it
    #: Name of the program beside this file that checks them, without its ending. It reads a certificate from its
    #: standard input, prints ``{"accepted": true}`` or ``{"accepted": false, "why": "..."}``, and imports nothing of
    #: this package.
    checker: str

    @property
    def program(self) -> Path:
        """File of the checker."""
        return Path(__file__).with_name(f"{self.checker}.py")

    def functions(self) -> Any:
        """The checker as a module, for those who search with its own functions."""
        return import_module(f"{__package__}.{self.checker}")


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A certificate with the number by which its checker sees that it was changed, whatever that would prove.

    Parameters
    ----------
    document : mapping
        Plain data, as JSON holds them.

    Examples
    --------
    >>> one, other = sealed({"statement": "nothing"}), sealed({"statement": "Nothing"})
    >>> one["digest"] == other["digest"]
    False
    """
    rest = {name: part for name, part in document.items() if name != "digest"}
    return {**rest, "digest": int.from_bytes(json.dumps(rest, sort_keys=True).encode(), "big") % (2**127 - 1)}


def of_text(text: str) -> Statement:
    """The statement that a certificate names.

    Raises
    ------
    LookupError
        If there is none.
    """
    return {statement.text: statement for statement in STATEMENTS.values()}[text]


#: By the word that `certify` takes; "absence" has four proofs, one of them "cycles", and `certify_orbit` has its own.
STATEMENTS = {
    Claim.ROOTS: Statement("all roots of the describing-function balance in a box", "check_roots"),
    "balance": Statement(
        "all roots of the describing-function balance in a box, of a ring or with a bias", "check_balance"
    ),
    Claim.ABSENCE: Statement("no periodic motion but rest", "check_absence"),
    "orbit": Statement("one closed orbit of a sequence of affine arcs in a box, and no event earlier", "check_orbit"),
    "cycles": Statement("all periodic motions but rest, by cells of a return map", "check_cells"),
    "absence_with_play": Statement("no periodic motion but rest, for any gap of the play", "check_play"),
    "elbow": Statement("no periodic motion but rest, for any gap up to the one stated", "check_elbow"),
}
