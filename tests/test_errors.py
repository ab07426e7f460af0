"""Errors: one sentence, made from fields that stay readable, also behind a process boundary."""

from __future__ import annotations

import pickle

import control
import numpy as np
import pytest

from eppanalysis.errors import CaseError, EppError, ModelError, shown

ERRORS = [
    (ModelError("Pulley", 1.5, "0 to 1", field="kinetic_ratio"), "Pulley: kinetic_ratio is 1.5; expected 0 to 1."),
    (ModelError("The amplitude", -1.0, "zero or more"), "The amplitude is -1.0; expected zero or more."),
    (ModelError("a loop", None, "a number", field="gain"), "a loop: gain is None; expected a number."),
    (
        ModelError("A has shape (1, 2)", expected="a square matrix", field="A"),
        "A has shape (1, 2); expected a square matrix.",
    ),
    (
        ModelError("Relay", 1.0, "more than", field="high", beside=("low", 2.0)),
        "Relay: high is 1.0; expected more than (2.0).",
    ),
    (ModelError("A loop needs an element."), "A loop needs an element."),
    (CaseError("a.toml", "play.gap", "-1 mm", "zero or more"), "a.toml: play.gap is '-1 mm'; expected zero or more."),
]


@pytest.mark.parametrize(("error", "sentence"), ERRORS)
def test_sentence_and_fields_survive_another_process(error: EppError, sentence: str) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error) == sentence
    if error.args and not sentence.startswith("A loop"):
        assert (again.field, again.expected) == (error.field, error.expected)


def test_what_has_a_shape_and_is_no_array_is_called_what_it_is() -> None:
    """A transfer function of python-control, or a table."""
    assert shown(control.tf([1], [1, 1])) == "a TransferFunction of shape (1, 1)"
    assert shown(np.zeros((2, 3))) == "an array of shape (2, 3)"


def test_numbers_of_numpy_are_shown_as_numbers() -> None:
    assert "is -2.0; " in str(ModelError("Play", np.float64(-2), "zero or more", field="gap"))
