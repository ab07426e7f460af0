"""What computes the numbers of a sweep: its digest is part of what makes a sweep the same sweep."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

from eppanalysis.engine._engine import SOURCES

#: Rooms and modules of the package that no number comes from.
_NO_NUMBERS = ("cli", "explorer", "report", "tables", "plotting", "shown", "progress", "workers")
#: Pictures in every room.
_PICTURES = ("picture.py", "parallel.py")
#: Libraries that compute.
_LIBRARIES = ("numpy", "scipy")


@cache
def code_digest(package: Path = Path(__file__).parents[1]) -> str:
    """Digest of all sources that numbers come from, and of the versions of libraries that compute.

    A version names a release; between two of them, and in a working copy, the numbers change without it. Of the engine
    its sources count, so that its builds for different processors, which give the same bits, are the same code.
    """
    found = hashlib.blake2b(SOURCES.encode(), digest_size=16)
    for path in sorted(package.rglob("*.py"), key=lambda p: p.relative_to(package).as_posix()):
        name = path.relative_to(package)
        if name.parts[0].removesuffix(".py") in _NO_NUMBERS or path.name in _PICTURES:
            continue
        found.update(f"{name.as_posix()}\0{hashlib.blake2b(path.read_bytes()).hexdigest()}\0".encode())
    for library in _LIBRARIES:
        found.update(f"{library}\0{version(library)}\0".encode())
    return found.hexdigest()
