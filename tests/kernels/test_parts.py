"""Functions that only kernels call: compiled once for all that is written in a call, and kept in the kernel alone."""

from __future__ import annotations

import numba
import numpy as np

from eppanalysis.kernels.compiling import PART, njit


def test_a_part_does_in_a_kernel_what_it_does_in_python() -> None:
    def horner(coefficients, x):
        value = 0.0
        for c in coefficients:
            value = value * x + c
        return value

    part = njit(**PART)(horner)

    @njit(nogil=True)
    def kernel(coefficients, x):
        return part(coefficients, x) - part(coefficients, -x)

    c = np.array([0.1, -2.0, 3.0, 0.7])
    assert kernel(c, 1.3) == horner(c, 1.3) - horner(c, -1.3)


def test_a_part_is_linked_into_its_kernel_and_stands_nowhere_else() -> None:
    part = njit(**PART)(lambda x: x + 1.0)
    kernel = njit(nogil=True)(lambda x: part(x) * 2.0)
    assert kernel(1.0) == 4.0
    (own,) = part.overloads.values()
    assert own.library.get_pointer_to_function(own.fndesc.llvm_func_name) == 0
    assert not part.stats.cache_path


def test_numbers_written_in_a_call_do_not_compile_a_part_anew() -> None:
    part = njit(**PART)(lambda x, k: x + k)
    kernel = njit(nogil=True)(lambda x, k: part(x, 0) + part(x, -1) + part(x, k))
    assert kernel(1.0, 5) == 7.0
    assert len(part.overloads) == 1


def test_a_part_that_two_others_call_is_linked_into_the_kernel() -> None:
    deepest = njit(**PART)(lambda x: x * x)
    left = njit(**PART)(lambda x: deepest(x) + 1.0)
    right = njit(**PART)(lambda x: deepest(x) - 2.0)
    kernel = njit(nogil=True)(lambda x: left(x) * right(x))
    assert kernel(3.0) == 70.0
    caller = njit(nogil=True)(lambda x: kernel(x) + deepest(x))
    assert caller(3.0) == 79.0
    foreign = numba.njit(lambda x: left(x) * right(x))
    assert foreign(3.0) == 70.0
