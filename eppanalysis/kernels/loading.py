"""How compiled code is kept in files and loaded from them: no more of it, and of numba, than a call needs.

Numba loads what a further compilation would need along with the code: its tables of all functions of numpy (with
scipy's linear algebra), and each kernel's intermediate code, into which others could be linked. A command that compiles
nothing spent a third of its time there. Here both wait until something is compiled.
"""

from __future__ import annotations

import hashlib
import pickle
from contextlib import suppress
from io import BytesIO
from typing import Any

from llvmlite import binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult, compile_result
from numba.core.runtime import rtsys


class _Loaded(JITCodeLibrary):
    """Machine code from a file; the intermediate code beside it waits until a kernel that calls it is compiled."""

    def __init__(self, codegen: Any, name: str, machine: bytes, intermediate: bytes) -> None:
        super().__init__(codegen, name)
        self._intermediate = intermediate
        self.enable_object_caching()
        self._set_compiled_object(machine)
        self._finalize_final_module()

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = llvm.parse_bitcode(self._intermediate)
        return self._shared_module

    def get_pointer_to_function(self, name: str) -> int:
        """Address of what is in the code: numba would look it up in the intermediate code first."""
        return self._codegen._engine.get_function_address(name)


class _Kernel(CompileResultCacheImpl):
    """A compiled kernel as plain data, and back."""

    def reduce(self, kernel: CompileResult) -> tuple[Any, ...]:
        # Without constants there is nothing to read in an environment; loading one imports the module it is of.
        *parts, environments = super().reduce(kernel)
        return *parts, tuple(environment for environment in environments if environment.consts)

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> CompileResult:
        (name, _, code), description, environment, signature, object_mode, lifted, *said, environments = payload
        annotation, begin = said
        for function in begin:
            function()
        library = _Loaded(target_context.codegen(), name, *code)
        entry = target_context.get_executable(library, description, environment)
        for other in environments:
            library.codegen.set_env(other.env_name, other)
        return compile_result(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=library,
            environment=environment,
            entry_point=entry,
            fndesc=description,
            type_annotation=annotation,
            signature=signature,
            objectmode=object_mode,
            lifted=lifted,
            reload_init=begin,
            referenced_envs=environments,
        )


_DIGEST = 16


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST).digest()


class DamagedError(OSError):
    """Raised on a file that is not as it was written; as of one that is not there, numba then compiles anew."""


def _read(path: str) -> bytes:
    with open(path, "rb") as file:
        whole = file.read()
    content = whole[:-_DIGEST]
    if _digest(content) != whole[-_DIGEST:]:
        raise DamagedError(path)
    return content


class _Sealed(IndexDataCacheFile):
    """Numba's index and code files, with a digest behind each."""

    def _load_index(self) -> dict[Any, str]:
        try:
            content = BytesIO(_read(self._index_path))
        except OSError:
            return {}
        if pickle.load(content) != self._version:
            return {}
        stamp, overloads = pickle.loads(content.read())
        return overloads if stamp == self._source_stamp else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        content = pickle.dumps(self._version, protocol=-1) + self._dump((self._source_stamp, overloads))
        self._write(self._index_path, content)

    def _load_data(self, name: str) -> Any:
        return pickle.loads(_read(self._data_path(name)))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as file:
            file.write(content + _digest(content))


class Files(FunctionCache):
    """The files of one kernel, an index and one with the code for each type of arguments."""

    _impl_class = _Kernel

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _Sealed(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def save_overload(self, signature: Any, data: CompileResult) -> None:
        """Keep the code for arguments of these types, if there is room for it."""
        with suppress(OSError):
            super().save_overload(signature, data)

    def load_overload(self, signature: Any, target_context: Any) -> CompileResult | None:
        """Code for arguments of these types, if there is any: numba's tables are read by its compiler, not here."""
        rtsys.initialize(target_context)  # the functions that give memory to arrays and take it back
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target_context)
