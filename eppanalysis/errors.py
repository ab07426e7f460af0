"""Errors that a user can act on: one sentence each, never a traceback on the command line."""

from __future__ import annotations

_LONGEST_SHOWN = 80


def visible(text: str) -> str:
    r"""A text with its control characters spelled out, so that a terminal shows them and does not obey them.

    Examples
    --------
    >>> visible("a\x1b[2Jb")
    'a\\x1b[2Jb'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def shown(value: object) -> str:
    """A value as a sentence shows it: on one line, and not longer than that.

    Examples
    --------
    >>> shown("1 deg"), shown([1, 2])
    ("'1 deg'", '[1, 2]')
    """
    if getattr(value, "shape", ()):
        return f"an array of shape {value.shape}"  # type: ignore[attr-defined]
    if type(value).__repr__ is object.__repr__:
        return f"a {type(value).__name__}"
    try:
        return _cut(" ".join(repr(value).split()))
    except (ValueError, RecursionError):  # a whole number of thousands of digits; a list of lists without end
        return f"a very long {type(value).__name__}"


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."


class EppError(Exception):
    """A request that cannot be carried out, in one sentence that says why and what was expected."""


class CaseError(EppError):
    """A case file or a value in it that is not valid.

    Parameters
    ----------
    source : str
        File (or shipped case, or command-line option) that holds the value.
    field : str
        Dotted name of the field; empty when the file as a whole is meant.
    value : object
        What was found.
    expected : str
        What was expected in its place.
    """

    def __init__(self, source: str, field: str, value: object, expected: str) -> None:
        self.source, self.field, self.value, self.expected = source, field, value, expected
        where = f"{source}: {_cut(visible(field))}" if field else source
        super().__init__(f"{where} is {shown(value)}; expected {expected}{'' if expected.endswith('?') else '.'}")


class ModelError(EppError):
    """A model that has no well-defined solution: improper, singular, negative where it must be positive."""


class NotConverged(EppError):
    """Raised by ``require_converged()`` on a result whose status is not a success."""
