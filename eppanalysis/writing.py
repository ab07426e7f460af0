"""Files that are complete, or not there at all."""

from __future__ import annotations

import io
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eppanalysis.errors import EppError


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder that takes the place of `path` when the block ends well, else vanishes.

    Raises
    ------
    EppError
        If the file cannot be written.
    """
    # A link stays one: what it leads to is replaced. Beside it, as only
    # within one file system a file takes the place of another in one step.
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.stem}-{secrets.token_hex(6)}{target.suffix}")
    try:
        yield part
        os.replace(part, target)
    except OSError as error:
        raise EppError(
            f"{path}: cannot be written ({error.strerror or error}); expected a place to write to."
        ) from error
    finally:
        with suppress(OSError):  # where nothing can be written, nothing can be taken away either
            part.unlink(missing_ok=True)


@contextmanager
def at_once(path: Path) -> Iterator[io.BytesIO]:
    """A stream in memory that becomes the file when the block ends well.

    On a full disk libraries that write a file piece by piece end in further errors of their own.
    """
    stream = io.BytesIO()
    yield stream
    path.write_bytes(stream.getvalue())


def write_text(text: str, path: Path) -> None:
    """Write a text in UTF-8.

    Raises
    ------
    EppError
        If the file cannot be written.
    """
    with atomic(path) as part:
        part.write_text(text, encoding="utf-8")
