"""What computes the numbers of a sweep: its digest is part of what makes a sweep the same sweep."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

#: Rooms and modules of the package that no number comes from.
_NO_NUMBERS = ("cli", "explorer", "report", "tables", "plotting", "shown", "progress", "workers")
#: Pictures in every room, and files that are compiled or read; caches of compiled code follow from them.
_PICTURES, _FILES = ("picture.py", "parallel.py"), (".py", ".so", ".pyd", ".dll", ".dylib")
#: Libraries that compute.
_LIBRARIES = ("numba", "numpy", "scipy")


@cache
def code_digest(package: Path = Path(__file__).parents[1]) -> str:
    """Digest of all files of the package that numbers come from, and of the versions of libraries that compute.

    A version names a release; between two of them, and in a working copy, the numbers change without it.
    """
    found = hashlib.blake2b(digest_size=16)
    for path in sorted(package.rglob("*"), key=lambda p: p.relative_to(package).as_posix()):
        name = path.relative_to(package)
        if path.suffix not in _FILES or name.parts[0].removesuffix(".py") in _NO_NUMBERS or path.name in _PICTURES:
            continue
        found.update(f"{name.as_posix()}\0{hashlib.blake2b(path.read_bytes()).hexdigest()}\0".encode())
    for library in _LIBRARIES:
        found.update(f"{library}\0{version(library)}\0".encode())
    return found.hexdigest()
