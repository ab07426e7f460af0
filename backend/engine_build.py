"""The build of scikit-build-core; on Linux with a C++ compiler of the package index (ziglang) where there is none."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from scikit_build_core import build
from scikit_build_core.build import (
    build_sdist,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

#: Compilers that are looked for, behind the one that this Python was made with.
_COMPILERS = ("c++", "g++", "clang++", "icpx")
#: Programs of a build that come with a compiler, as Zig calls its own.
_PROGRAMS = ("c++", "ar", "ranlib")
_ZIG = "ziglang>=0.13"


def _found() -> str | None:
    """The C++ compiler of this machine; elsewhere than on Linux CMake looks for it."""
    if "CXX" in os.environ or sys.platform != "linux":
        return os.environ.get("CXX", "")
    of_python = (sysconfig.get_config_var("CXX") or "c++").split()[0]
    return next(filter(None, map(shutil.which, (of_python, *_COMPILERS))), None)


@contextmanager
def _compiler(settings: dict[str, Any] | None) -> Iterator[dict[str, Any] | None]:
    """Settings of a build, the compiler in the environment: where there is none, Zig's, in a folder of its own."""
    before, found = dict(os.environ), _found()
    if found is None:
        programs = Path("build/zig").resolve()
        programs.mkdir(parents=True, exist_ok=True)
        for name in _PROGRAMS:  # the interpreter of an isolated build is another one each time
            (programs / name).write_text(f'#!/bin/sh\nexec "$EPP_PYTHON" -m ziglang {name} "$@"\n')
            (programs / name).chmod(0o755)
        found, settings = str(programs / "c++"), {"build-dir": "build/{wheel_tag}-zig"} | (settings or {})
        os.environ.update(PATH=f"{programs}{os.pathsep}{before['PATH']}", EPP_PYTHON=sys.executable)
    os.environ.update({"CXX": found} if found else {})
    try:
        yield settings
    finally:
        os.environ.clear()
        os.environ.update(before)


def get_requires_for_build_wheel(settings: dict[str, Any] | None = None) -> list[str]:
    """What a wheel is built with."""
    return [*build.get_requires_for_build_wheel(settings), *([_ZIG] if _found() is None else [])]


def get_requires_for_build_editable(settings: dict[str, Any] | None = None) -> list[str]:
    """What an editable install is built with."""
    return [*build.get_requires_for_build_editable(settings), *([_ZIG] if _found() is None else [])]


def build_wheel(folder: str, settings: dict[str, Any] | None = None, metadata: str | None = None) -> str:
    """Build a wheel into a folder; its name."""
    with _compiler(settings) as found:
        return build.build_wheel(folder, found, metadata)


def build_editable(folder: str, settings: dict[str, Any] | None = None, metadata: str | None = None) -> str:
    """Build the wheel of an editable install into a folder; its name."""
    with _compiler(settings) as found:
        return build.build_editable(folder, found, metadata)
