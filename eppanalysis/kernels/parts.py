"""Kernels and their parts: functions that only other compiled functions call.

Numba finishes every function on its own: it links in all that the function calls, optimises the whole, turns it into
machine code and keeps that. What a kernel calls through five others is so copied and optimised six times over, five of
them for nothing. A part stays as it was written down; the kernel that calls it, through however many others, takes in
all of them once, and is optimised once.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.compiler_lock import require_global_compiler_lock


class _AsWritten(JITCodeLibrary):
    """LLVM code of single functions that is not optimised before it stands in a whole."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class _Code(_AsWritten):
    """LLVM code that is linked into others, and never run from here."""

    def finalize(self) -> None:
        require_global_compiler_lock()
        self._raise_if_finalized()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"
        self._finalize_dynamic_globals()
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """The code with all that it calls, for functions that numba's own compiler compiles."""
        if self._shared_module is None:
            whole = self._final_module.clone()
            for library in _with_what_they_call(self._linking_libraries):
                code = library._final_module if isinstance(library, _Code) else library._get_module_for_linking()
                whole.link_in(code, preserve=True)
            self._shared_module = whole
        return self._shared_module


def _with_what_they_call(libraries: list[Any]) -> list[Any]:
    """Libraries, and those that their parts link in, each once."""
    found = dict.fromkeys(libraries)
    waiting = list(found)
    while waiting:
        library = waiting.pop()
        if isinstance(library, _Code):
            new = [called for called in library._linking_libraries if called not in found]
            found |= dict.fromkeys(new)
            waiting += new
    return list(found)


class _Whole(_AsWritten):
    """Machine code of a function with all that it calls.

    Long products are written as vectors: LLVM is not asked to make vectors of other loops, which are over a few states.
    That was a third of its time, and the code was no faster.
    """

    def finalize(self) -> None:
        others = []
        for library in _with_what_they_call(self._linking_libraries):
            if isinstance(library, _Code):
                self._final_module.link_in(library._final_module, preserve=True)
            else:
                others.append(library)
        self._linking_libraries = others
        super().finalize()

    def _optimize_final_module(self) -> None:
        made = self._codegen._module_pass_manager(opt=2, loop_vectorize=False, slp_vectorize=False)
        passes, *builder = made if isinstance(made, tuple) else (made,)  # older versions of numba have no builder
        passes.run(self._final_module, *builder)


@contextmanager
def _seldom_collecting() -> Iterator[None]:
    """Hardly anything that the compiler makes is garbage before it is done; looking for it took a tenth of the time."""
    usual = gc.get_threshold()
    gc.set_threshold(max(usual[0], 50_000) if usual[0] else 0, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)


class _Shared(Flags):
    """Flags by which numba keeps those of its own functions that a kernel calls, one object for all alike."""

    __hash__, __eq__ = object.__hash__, object.__eq__

    def copy(self) -> Flags:
        return Flags(self)


@cache
def _shared(**settings: Any) -> _Shared:
    shared = _Shared()
    for name, value in settings.items():
        setattr(shared, name, value)
    return shared


class _Flags(Flags):
    """Flags of a kernel or part; numba's own functions are not compiled anew for each kind of these."""

    def copy(self) -> Flags:
        return _shared(nrt=self.nrt, error_model=self.error_model)


#: What numba does for language that kernels do without: closures, comprehensions, `with`, loops over mixed tuples.
_NOT_WRITTEN = {
    *("WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction", "FindLiterallyCalls"),
    *("LiteralUnroll", "LiteralPropagationSubPipelinePass"),
}


class _Compiler(Compiler):
    """Numba's compiler."""

    def __init__(self, *settings: Any) -> None:
        *before, flags, local = settings
        super().__init__(*before, _Flags(flags), local)

    def define_pipelines(self) -> list[Any]:
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.passes = [one for one in pipeline.passes if one[0].__name__ not in _NOT_WRITTEN]
            pipeline.finalize()
        return pipelines


class Kernel(_Compiler):
    """Numba's compiler, with parts taken in."""

    def compile_extra(self, function: Any) -> Any:
        """Compile a function that Python or another kernel calls."""
        self.state.library = _Whole(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()  # so that it can be kept in a file
        with _seldom_collecting():
            return super().compile_extra(function)


class Part(_Compiler):
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
