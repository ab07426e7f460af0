"""Parts of kernels: functions that only other compiled functions call.

Numba finishes every function on its own: it links in all that the function calls, optimises the whole, turns it into
machine code and keeps that. What a kernel calls through five others is so optimised six times over, five of them for
nothing. A part stays as it was written down; the kernel that calls it, through however many others, is optimised once.
"""

from __future__ import annotations

from typing import Any

from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _Code(JITCodeLibrary):
    """LLVM code that is linked into others, and never run from here."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class Part(Compiler):
    """Numba's compiler, up to the code that is linked into a kernel."""

    def __init__(self, *settings: Any) -> None:
        super().__init__(*settings)
        context = self.state.targetctx  # of this compilation alone
        self.state.library = _Code(context.codegen(), "part")
        context.get_executable = _without_entry


def _without_entry(library: _Code, description: Any, env: Any) -> Any:
    """What stands in numba's tables for a function that cannot be called from Python."""
    library._ensure_finalized()
    return _dynfunc.make_function(
        description.lookup_module(), description.qualname.split(".")[-1], "part of a kernel", 0, env, (library,)
    )
