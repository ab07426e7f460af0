"""How kernels are compiled, and where the code is kept from one process to the next.

The same input gives the same bits, in the process that compiles and in those that load. Numba keeps several copies of
a function: its own, and one in the object code of each kernel that calls it, inlined and unrolled in its own way. Which
of them runs depends on what a process has compiled and loaded before. All of them round alike as long as the arithmetic
leaves the compiler no choice: no fast-math flag, of which `contract` (a product and a sum may be rounded once) is one.
So kernels are compiled by :func:`njit` alone, which takes none. With contraction, with fused operations spelled out and
without any, six seconds of the elbow were measured to take 0.8 ms alike, to within 2 %; without any, processors that
have no fused operation round as the others do.

Numba compiles a function anew when its own file changes, but not when a file changes whose functions it calls. The code
of a module lies therefore in a folder that is named by the sources of all kernels that go into it.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.resources import files
from multiprocessing import parent_process
from pathlib import Path
from threading import Lock
from typing import Any

import numba
from numba.core import config
from numba.core.dispatcher import Dispatcher
from numba.core.types import unliteral
from numba.misc.appdirs import AppDirs

from eppanalysis.kernels.loading import Files
from eppanalysis.kernels.parts import Kernel, Part

#: Of other kernels; from here comes no code.
_IMPORT = re.compile(r"^from eppanalysis\.kernels\.(?!compiling\b)([\w.]+) import ", re.MULTILINE)
#: Kernels that Python calls, and functions that only kernels call (see :mod:`eppanalysis.kernels.parts`).
KERNEL = {"cache": True, "nogil": True, "no_cfunc_wrapper": True}
PART = {"nogil": True, "pipeline_class": Part, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_place_is_set = Lock()


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Numba's decorator of the same name; with ``cache=True`` the code is kept in the :func:`store`, if there is one.

    Raises
    ------
    TypeError
        If the arithmetic is to be loosened.
    """
    if "fastmath" in options:
        raise TypeError("fastmath: a kernel's bits would depend on what was compiled before it; expected none.")

    def compiled(function: Callable[..., Any]) -> Any:
        folder = store()
        kernel = numba.njit(**{"pipeline_class": Kernel} | options | {"cache": False})(function)
        if options.get("cache") and folder is not None and isinstance(kernel, Dispatcher):
            module = function.__module__.removeprefix(f"{__package__}.")
            # Where there is no place for it any more, the code is compiled in each process.
            with _kept_in(os.path.join(folder, f"{module}-{sources(module)}")), suppress(OSError, RuntimeError):
                kernel._cache = Files(function)
        return _whatever_the_value(kernel)

    return compiled


def _whatever_the_value(function: Any) -> Any:
    """Compile a function once for an argument that is written as a number, and for one of the same type.

    Numba compiles it anew for each number that stands in a call; most of the engine was compiled twice for a zero.
    """
    if isinstance(function, Dispatcher):
        chosen = function.get_call_template

        def of_types(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
            return chosen(tuple(map(unliteral, args)), {name: unliteral(kind) for name, kind in kws.items()})

        function.get_call_template = of_types  # type: ignore[method-assign]
    return function


@contextmanager
def _kept_in(folder: str) -> Iterator[None]:
    """Numba asks for the place when a function is decorated."""
    with _place_is_set:
        before, config.CACHE_DIR = config.CACHE_DIR, folder
        try:
            yield
        finally:
            config.CACHE_DIR = before


@cache
def sources(module: str) -> str:
    """Digest of what the code of a kernel module is made from: its own source, and those of all kernels it imports."""
    found: dict[str, str] = {}
    wanted = [module]
    while wanted:
        name = wanted.pop()
        if name not in found:
            found[name] = (
                files(__package__)
                .joinpath(*name.split(".")[:-1], f"{name.rpartition('.')[2]}.py")
                .read_text(encoding="utf-8")
            )
            wanted += _IMPORT.findall(found[name])
    return hashlib.sha256("".join(found[name] for name in sorted(found)).encode()).hexdigest()[:16]


@cache
def store() -> str | None:
    """Folder in which this process keeps compiled code: the first that can be written; None where nothing can.

    NUMBA_CACHE_DIR where it is given; in a working copy beside the sources; in the user's folder for such things. An
    installation without a home has none of these: then in a temporary folder of this user's, as standard error says.
    Among installed files nothing is put that the installer does not know: it would stay when the package goes, and be
    imported.
    """
    given, beside = config.CACHE_DIR, Path(__file__).with_name("__pycache__") if _in_working_copy() else None
    for place in (given and Path(given).absolute(), beside, Path(AppDirs("eppanalysis", False).user_cache_dir)):
        if place and place.is_absolute() and _takes_files(place):  # a home that nobody knows leaves "~"
            return str(place)
    folder = _temporary()
    if parent_process() is None:  # workers leave it to the process that started them
        kept = f"compiled code is kept in {folder}" if folder else "code is compiled anew in each process"
        sys.stderr.write(f"Neither the installation nor a folder of the user's can be written: {kept}.\n")
    return folder


def _in_working_copy() -> bool:
    """Whether the package lies where it is worked on, and not where an installer has put it."""
    return Path(__file__).parents[2].joinpath("pyproject.toml").is_file()


def _temporary() -> str | None:
    """A folder of this user's among the temporary ones, if there can be one.

    Its name can be guessed, and code is run that lies in it: it is taken only where nobody else may write.
    """
    own = hasattr(os, "getuid")  # on Windows each user has temporary files of their own
    try:
        folder = Path(tempfile.gettempdir()) / (f"eppanalysis-{os.getuid()}" if own else "eppanalysis")
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    if own and (not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022):
        return None
    return str(folder) if _takes_files(folder) else None


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
