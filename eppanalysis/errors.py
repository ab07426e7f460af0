"""Errors that a user can act on: one sentence each, never a traceback on the command line."""

from __future__ import annotations


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
        shown = repr(value)
        if len(shown) > 80:
            shown = shown[:77] + "..."
        where = f"{source}: {field}" if field else source
        super().__init__(f"{where} is {shown}; expected {expected}.")


class ModelError(EppError):
    """A model that has no well-defined solution: improper, singular, negative where it must be positive."""


class NotConverged(EppError):
    """Raised by ``require_converged()`` on a result whose status is not a success."""
