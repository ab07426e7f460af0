"""Named tuples that kernels take by address: what a kernel reads and writes is what the arrays hold."""

from __future__ import annotations

import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit, typeof

from eppanalysis.kernels.simd.tuples import by_address, frames_of, rows, tuple_at


@by_address
class Things(NamedTuple):
    """Arrays of all sorts."""

    cube: np.ndarray
    many: np.ndarray
    count: np.ndarray
    empty: np.ndarray


def things(seed: int = 0, *cells: int) -> Things:
    random = np.random.default_rng(seed)
    return Things(
        random.normal(size=(*cells, 2, 3, 4)),
        random.normal(size=(*cells, 5)),
        random.integers(0, 9, (*cells, 3, 2)),
        np.zeros((*cells, 0, 2)),
    )


@njit
def _inner(some: Any, i: int) -> float:
    return float(some.cube[1, 2, i] + some.count[i, 1] * some.many.sum() + some.empty.shape[1] + some.empty.size)


@njit
def _outer(some: Any) -> float:
    some.many[2] = some.cube[0, 1].sum() + some.cube.shape[2]
    some.count[2] += 1
    return _inner(some, 2)


@njit
def _of_each(stack: Any, out: Any) -> None:
    for k in range(out.size):
        out[k] = _outer(rows(stack, k))


def expected(some: Things) -> float:
    """As `_outer`, by numpy."""
    some.many[2] = some.cube[0, 1].sum() + some.cube.shape[2]
    some.count[2] += 1
    return float(some.cube[1, 2, 2] + some.count[2, 1] * some.many.sum() + some.empty.shape[1] + some.empty.size)


def test_kernels_read_and_write_the_arrays() -> None:
    given, wanted = things(), things()
    assert _outer(given) == pytest.approx(expected(wanted), rel=1e-14)
    assert np.array_equal(given.count, wanted.count) and np.allclose(given.many, wanted.many, rtol=1e-14)


def test_rows_of_a_stack_are_the_tuples_that_were_stacked() -> None:
    stack, found = things(1, 4), np.zeros(4)
    wanted = [expected(Things(*(a[k].copy() for a in stack))) for k in range(4)]
    _of_each(stack, found)
    assert np.allclose(found, wanted, rtol=1e-14)


def test_types_are_those_of_the_arrays_alone_and_survive_on_disk() -> None:
    kind = typeof(things())
    assert kind == typeof(things(1)) == pickle.loads(pickle.dumps(kind)) != typeof(things(0, 4))


@pytest.mark.parametrize(
    "change",
    [
        {"cube": np.zeros((2, 3, 4)).T},
        {"many": np.zeros(10)[::2]},
        {"many": np.zeros(5, np.float32)},
        {"count": np.zeros((3, 2), np.int32)},
        {"count": np.zeros((3, 2), np.uint64)},
    ],
)
def test_other_arrays_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=f"Things.{next(iter(change))} is no contiguous array"):
        _outer(things()._replace(**change))


@njit
def _of_all(like: Any, frames: Any, out: Any) -> None:
    for k in range(out.size):
        out[k] = _outer(tuple_at(like, frames, k))


def test_tuples_of_arrays_of_other_lengths_are_taken_by_one_kernel_from_their_frames() -> None:
    def of_length(n: int) -> list[Things]:
        return [things(k)._replace(many=np.arange(3.0 + k), empty=np.zeros((k, 3))) for k in range(n)]

    _of_all(of_length(1)[0], frames_of(of_length(1)), np.zeros(1))
    compiled = len(getattr(_of_all, "signatures", ()))
    given, found = of_length(5), np.zeros(5)
    _of_all(given[-1], frames_of(given), found)
    assert np.allclose(found, [expected(one) for one in of_length(5)], rtol=1e-14)
    assert np.all([one.count[2] == other.count[2] + 1 for one, other in zip(given, of_length(5), strict=True)])
    assert len(getattr(_of_all, "signatures", ())) == compiled


def test_frames_are_refused_to_tuples_of_several_types_and_to_arrays_that_no_kernel_takes() -> None:
    with pytest.raises(TypeError, match="several types"):
        frames_of([things(), things()._replace(many=np.zeros((2, 2)))])
    with pytest.raises(TypeError, match="many"):
        frames_of([things()._replace(many=np.zeros(4)[::2])])
