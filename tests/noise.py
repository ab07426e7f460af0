"""Other processors: their libraries sum in another order, and the last bit of what these return is another one.

What stands for them here is noise of one unit in the last place, on the numbers of a loop's matrices and on what the
linear algebra of numpy and scipy returns. It depends on the number and the seed alone, as on a processor the same
numbers always give the same: what is equal stays equal, pairs stay conjugate, and what is zero is zero.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any
from unittest.mock import patch

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

import eppanalysis as epp
from tests.coordinates import InOtherWords

#: Relative difference of two numbers, and what is nothing whatever its size (SI units): one that is exactly zero by
#: symmetry is so large.
CLOSE, NOTHING = 1e-9, 1e-12
#: How a result was made, and what it is off: numbers that are rounding themselves.
LEFT_OUT = {"provenance", "seconds", "search", "n_runs", "residual", "error_estimate"}
#: They rearrange numbers and round nothing.
EXACT = {"block_diag", "matrix_balance", "toeplitz", "companion", "hankel", "circulant"}


def shaken(x: Any, seed: int) -> Any:
    """Floats one unit in the last place up or down, or as they are; anything within tuples and lists."""
    if isinstance(x, tuple):
        parts = [shaken(part, seed) for part in x]
        return type(x)(*parts) if hasattr(x, "_fields") else tuple(parts)
    if isinstance(x, list):
        return [shaken(part, seed) for part in x]
    if isinstance(x, complex | np.complexfloating):
        return type(x)(complex(shaken(x.real, seed), shaken(x.imag, seed)))
    if isinstance(x, float | np.floating) and type(x) is not np.longdouble:
        return type(x)(_moved(np.array([x], float), seed)[0])
    if not isinstance(x, np.ndarray):
        return x
    if x.dtype == np.float64:
        return _moved(x, seed)
    if x.dtype == np.complex128:
        return _moved(x.real, seed) + 1j * _moved(x.imag, seed)
    return x


def _moved(x: np.ndarray, seed: int) -> np.ndarray:
    """Bits of the numbers without their signs, mixed with the seed (splitmix64), tell which way they go."""
    size = np.abs(np.ascontiguousarray(x))
    bits = size.view(np.uint64) + np.uint64((seed + 1) * 0x9E3779B97F4A7C15 % 2**64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1)):
        bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
    way = np.choose((bits % np.uint64(3)).astype(int), [0.0, size, np.inf])
    moved = np.where((size > 0.0) & np.isfinite(size), np.nextafter(size, np.where(way == size, size, way)), size)
    return np.copysign(moved, x)


@contextmanager
def noise(seed: int) -> Iterator[None]:
    """In the block numpy's and scipy's linear algebra returns numbers that are off by one unit in the last place."""
    with contextmanager(_patched)(seed):
        yield


def _patched(seed: int) -> Iterator[None]:
    modules: list[ModuleType] = [np.linalg, scipy.linalg, scipy.sparse.linalg]
    changes = [(module, name, _shaking(value, seed)) for module in modules for name, value in _functions(module)]
    patches = [patch.object(*change) for change in changes]
    for one in patches:
        one.start()
    try:
        yield
    finally:
        for one in reversed(patches):
            one.stop()


def _functions(module: ModuleType) -> Iterator[tuple[str, Callable[..., Any]]]:
    for name in module.__all__:
        value = getattr(module, name)
        if callable(value) and not inspect.isclass(value) and not inspect.ismodule(value) and name not in EXACT:
            yield name, value


def _shaking(function: Callable[..., Any], seed: int) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        out = function(*args, **kwargs)
        return _Factors(out, seed) if hasattr(out, "solve") else shaken(out, seed)

    return call


@dataclass
class _Factors:
    """A factorisation whose solutions are off as others are."""

    own: Any
    seed: int

    def __getattr__(self, name: str) -> Any:
        return getattr(self.own, name)

    def solve(self, *args: Any) -> Any:
        return shaken(self.own.solve(*args), self.seed)


def with_shaken_matrices(case: epp.Case, seed: int) -> InOtherWords:
    """The case with the numbers of its loop's matrices off by one unit in the last place."""

    def moved(part: Any, *names: str) -> Any:
        return part and replace(part, **{name: shaken(getattr(part, name), seed) for name in names})

    def change(system: epp.LureSystem) -> epp.LureSystem:
        signals = moved(system.signals, "C", "D", "D_input")
        cuts = moved(system.cuts, "B", "E", "C", "D", "F")
        return replace(
            moved(system, "A", "B", "C", "D", "B_input", "D_input", "constant_state", "constant_input"),
            signals=signals,
            cuts=cuts,
        )

    return InOtherWords(case, change)


def plain(result: Any) -> Any:
    """What a result says and is, but for how it was made."""
    if isinstance(result, Mapping):
        return {str(k): plain(v) for k, v in result.items() if str(k) not in LEFT_OUT}
    if isinstance(result, list | tuple):
        return [plain(v) for v in result]
    if hasattr(result, "to_dict"):
        return {"says": str(result), **plain(result.to_dict())}
    return result


def differences(one: Any, other: Any, path: str = "") -> Iterator[str]:
    """What differs between two of these: numbers by their relative difference, those of a list by its largest."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in sorted(one.keys() | other.keys()):
            if key in one and key in other:
                yield from differences(one[key], other[key], f"{path}.{key}")
            else:
                yield f"{path}.{key}: in one only"
    elif isinstance(one, list) and isinstance(other, list):
        yield from _of_lists(one, other, path)
    elif _is_number(one) and _is_number(other):
        yield from _number(one, other, abs(one), path)
    elif one != other:
        yield f"{path}: {one!r:.150} and {other!r:.150}"


def _of_lists(one: list[Any], other: list[Any], path: str) -> Iterator[str]:
    if len(one) != len(other):
        yield f"{path}: {len(one)} and {len(other)} entries"
        return
    numbers = bool(one) and all(map(_is_number, [*one, *other]))
    largest = max((abs(x) for x in one if math.isfinite(x)), default=0.0) if numbers else 0.0
    for k, (a, b) in enumerate(zip(one, other, strict=True)):
        yield from _number(a, b, largest, f"{path}[{k}]") if numbers else differences(a, b, f"{path}[{k}]")


def _is_number(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool)


def _number(a: float, b: float, size: float, path: str) -> Iterator[str]:
    if not (a == b or abs(a - b) <= max(CLOSE * size, NOTHING) or (math.isnan(a) and math.isnan(b))):
        yield f"{path}: {a!r} and {b!r}"


def branch(case: Any) -> Any:
    """The branch over what a case declares tunable, else over its gap or gain, down to four fifths of it."""
    positive = {name: p.value for name, p in case.parameters.items() if isinstance(p.value, float) and p.value > 0.0}
    tunable = [name for name in positive if case.parameters[name].mark == "tunable"]
    named = [name for name in positive if name.split(".")[-1] in ("backlash", "gap", "gain", "kp")]
    name = next(iter([*tunable, *named]), None)
    return name and epp.continue_branch(case, name, positive[name], 0.8 * positive[name])


ANALYSES: dict[str, Callable[[Any], Any]] = {
    "margins": epp.margins,
    "predict": epp.predict_limit_cycles,
    "simulate": epp.simulate,
    "cycles": epp.find_limit_cycles,
    "branch": branch,
}


def answer(case: Any, analysis: str) -> Any:
    """What an analysis says of a case, an error as its sentence."""
    try:
        return plain(ANALYSES[analysis](case))
    except epp.EppError as error:
        return str(error)


def unlike(name: str, analysis: str, seeds: Iterable[int]) -> list[str]:
    """What differs between the answer on this processor and those on others."""
    case = epp.case(name)
    here = answer(case, analysis)
    found = []
    for seed in seeds:
        with noise(seed):
            found += [
                f"seed {seed}: {d}" for d in differences(here, answer(with_shaken_matrices(case, seed), analysis))
            ]
    return found
