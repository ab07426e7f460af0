"""Two builds of the engine side by side: each call of the one is made by the other too, and gives the same bits.

    python -m pytest -p tests.beside --beside=FILE tests/engine

The file is another build, such as the module for all processors in a wheel: `eppanalysis/engine/_native.abi3.so`.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ENGINE = "eppanalysis.engine._engine"


class Calls:
    """How many calls were compared."""

    count = 0


def load(path: Path) -> ModuleType:
    """A compiled module of that file."""
    name = path.name.partition(".")[0]
    loader = importlib.machinery.ExtensionFileLoader(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def copied(value: Any, copies: dict[int, Any]) -> Any:
    """Copies of all arrays in tuples of tuples, an array that comes twice being one."""
    if isinstance(value, tuple):
        parts = [copied(part, copies) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, np.ndarray | np.void):
        if id(value) not in copies:
            copies[id(value)] = value.copy()
        return copies[id(value)]
    return value


def difference(a: Any, b: Any, place: str) -> str | None:
    """Where two answers differ in a bit; numbers that are none are equal."""
    if isinstance(a, tuple):
        names = getattr(a, "_fields", range(len(a)))
        found = (difference(x, y, f"{place}.{name}") for name, x, y in zip(names, a, b, strict=True))
        return next((one for one in found if one), None)
    if isinstance(a, np.void):
        return difference(a.item(), b.item(), place)
    if isinstance(a, np.ndarray) and a.tobytes() == b.tobytes():
        return None
    if isinstance(a, np.ndarray | float | complex):
        x, y = (np.ascontiguousarray(value).reshape(-1) for value in (a, b))
        if x.dtype.kind in "fc":
            x, y = (value.view(float) for value in (x, y))
            nothing = np.isnan(x) & np.isnan(y)
            x, y = (np.where(nothing, 0.0, value).view(np.int64) for value in (x, y))
        return None if np.array_equal(x, y) else place
    return None if a == b else place


def outcome(function: Callable[..., Any], args: tuple[Any, ...]) -> Any:
    """What a call gives, or what it refuses."""
    try:
        return function(*args)
    except (TypeError, ValueError) as error:
        return error


def both(first: Callable[..., Any], second: Callable[..., Any], name: str) -> Callable[..., Any]:
    """A function that calls both, the second on copies, and gives what the first gives."""

    def call(*args: Any) -> Any:
        others = copied(args, {})
        a, b = outcome(first, args), outcome(second, others)
        if isinstance(a, Exception):
            assert str(a) == str(b), f"{name}: {a!r}, {b!r}"
            raise a
        differs = difference(a, b, "result") or difference(args, others, "arguments")
        assert differs is None, f"{name}: the builds of the engine differ in {differs}"
        Calls.count += 1
        return a

    return call


def joined(first: ModuleType, second: ModuleType, name: str) -> ModuleType:
    """A module whose functions are made by both."""
    module = ModuleType(name)
    for key, value in vars(first).items():
        if isinstance(value, ModuleType):
            module.__dict__[key] = joined(value, getattr(second, key), key)
        elif callable(value) and not key.startswith("__"):
            module.__dict__[key] = both(value, getattr(second, key), key)
        elif not key.startswith("__"):
            module.__dict__[key] = value
    return module


def compare_with(path: Path) -> None:
    """From now on each call of the engine is compared with that of the build in the file."""
    from eppanalysis.engine import _engine

    assert not {f"eppanalysis.engine.{name}" for name in ("runs", "orbits", "balances")} & set(sys.modules)
    sys.modules[ENGINE] = sys.modules["eppanalysis.engine"]._engine = joined(_engine, load(path), ENGINE)  # type: ignore[attr-defined]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--beside", type=Path, help="another build of the engine, which each call is compared with")


def pytest_configure(config: pytest.Config) -> None:
    compare_with(config.getoption("--beside").resolve())


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    terminalreporter.write_line(f"{Calls.count} calls of the engine give the same bits in both builds")
