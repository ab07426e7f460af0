"""Limit cycles of loops with backlash, friction and other nonlinear elements.

The public face. Every name is imported from its module when it is first used, so that ``import eppanalysis`` costs
next to nothing; ``__init__.pyi`` lists them once, for type checkers and for this module.

Examples
--------
>>> import eppanalysis as epp
>>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
>>> loop.name
'loop'
"""

from __future__ import annotations

import ast
import sys
from functools import wraps
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

__version__ = "0.1.0"


def _listed() -> dict[str, str]:
    """Module of every public name, from the imports of the stub."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [statement for statement in stub.body if isinstance(statement, ast.ImportFrom)]
    return {alias.name: str(statement.module) for statement in imports for alias in statement.names}


_MODULE_OF = _listed()


def __getattr__(name: str) -> Any:
    """Import a public name on its first use (PEP 562)."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(_MODULE_OF[name])
    value = getattr(module, name, None) or import_module(f"{module.__name__}.{name}")  # a public module
    if isinstance(value, FunctionType):
        value = _at_the_door(value)
    globals()[name] = value
    return value


#: Methods over parameters, which need a case and are in a layer below it: a loop becomes one at the door.
_OVER_PARAMETERS = ("continue_branch", "continue_folds", "design", "design_bounds", "ladder", "tolerance_bound")


def _at_the_door(function: Any) -> Any:
    """The public function, which refuses arguments of wrong types in a sentence; calls within are not checked."""
    from eppanalysis.arguments import checked, in_range
    from eppanalysis.workers import one_thread

    inside = _with_case(function) if function.__name__ in _OVER_PARAMETERS else function
    # What makes cases and loops computes nothing, and need not wait for the libraries of linear algebra.
    makes = function.__module__.startswith((f"{__name__}.cases", f"{__name__}.models", f"{__name__}.units"))
    door = checked(inside if makes else in_range(one_thread()(inside)))
    door.__module__ = __name__  # so that processes find it by its public name
    return door


def _with_case(function: Any) -> Any:
    """A method whose argument `case` may be a loop, too."""

    @wraps(function)
    def call(case: Any, *args: Any, **kwargs: Any) -> Any:
        return function(import_module(f"{__name__}.cases").as_case(case), *args, **kwargs)

    return call


def __dir__() -> list[str]:
    """Public names and the version."""
    return sorted([*_MODULE_OF, "__version__"])


class _Package(ModuleType):
    """Keeps public functions in front of the modules of their names: `report`, `sweep`, `identify`.

    Importing a submodule sets the attribute of its name on the package, which would hide the function behind the module
    from then on.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _MODULE_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
