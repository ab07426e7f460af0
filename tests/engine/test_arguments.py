"""Arguments of the engine: arrays in any layout are looked at as numpy has them, others are refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from eppanalysis.engine.balances import response_and_slope
from eppanalysis.engine.describing import describe_map
from eppanalysis.engine.harmonics import find_extrema
from eppanalysis.engine.workspace import PROGRESS, make_progress

RNG = np.random.default_rng(5)
A, B, C = RNG.normal(size=(4, 4)), RNG.normal(size=(4, 2)), RNG.normal(size=(3, 4))
S = 1j * np.arange(1.0, 6.0)


def answers(A, B, C, s, out):
    response_and_slope(A, B, C, s, np.ones_like(s), out)
    return out


def test_arrays_with_gaps_and_such_as_cannot_be_written_are_taken_as_others() -> None:
    wanted = answers(A, B, C, S, np.empty((2, 5, 3, 2), complex))
    wide, out = np.zeros((8, 12)), np.zeros((2, 5, 3, 4), complex)
    wide[::2, ::3], C.flags.writeable = A, False
    found = answers(wide[::2, ::3], np.asfortranarray(B), C, np.repeat(S, 2)[::2], out[..., ::2])
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(out[..., 1::2], 0.0)  # what lies between is left alone


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (A.astype(np.float32), "A: expected an array of float64 with 2 axes"),
        (A[0], "A: expected an array of float64 with 2 axes"),
        (A.astype(int), "A: expected an array of float64"),
        ("A", "A: expected an array"),
        ([[1.0]], "A: expected an array"),
    ],
)
def test_what_is_no_such_array_is_refused_by_name(wrong: object, said: str) -> None:
    with pytest.raises(TypeError, match=said):
        answers(wrong, B, C, S, np.empty((2, 5, 3, 2), complex))


def test_complex_numbers_are_asked_for_where_they_are_needed() -> None:
    with pytest.raises(TypeError, match="c: expected an array of complex128 with 1 axes"):
        find_extrema(np.zeros(3), np.zeros(8), np.zeros(8))


def test_a_call_with_too_few_arguments_is_refused() -> None:
    with pytest.raises(TypeError):
        describe_map(np.zeros(1))


def test_the_record_of_progress_is_that_of_the_engine() -> None:
    from eppanalysis.engine.runs import run

    with pytest.raises(TypeError, match="expected a tuple of"):
        run((), (), (), (), (), (), make_progress(1.0, 0.1, 10))
    assert PROGRESS.isalignedstruct
