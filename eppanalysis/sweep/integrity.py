"""Whether a store is as it was written: digests of its files, sheets that know their own digest, a lock.

Zarr's own checksum (crc32c) finds flipped bytes in a file that is there. A file that is missing, empty or in the
place of another one only a list of digests finds, and such a list must not be damaged unseen itself.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from filelock import FileLock, Timeout
from zarr.core.buffer import Buffer
from zarr.storage import LocalStore

from eppanalysis.errors import EppError

#: The folder of what is not the sweep's numbers: the sheet, the marks of finished blocks, the lock.
PROGRESS = "progress"
SHEET, LOCK, DONE = f"{PROGRESS}/sweep.json", f"{PROGRESS}/lock", f"{PROGRESS}/done"
REMEDY = "the same command computes the damaged parts anew"

#: There is no such file; a store of other axes may have a folder in its place.
_NO_FILE = (FileNotFoundError, NotADirectoryError, IsADirectoryError)
#: A file system that knows no locks, or does not let one be taken where nothing can be written either.
_NO_LOCKS = (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


def digest(data: bytes) -> str:
    """Digest of the content of a file."""
    return hashlib.blake2b(data, digest_size=16).hexdigest()


def digest_of(facts: Any) -> str:
    """Digest of plain data."""
    return digest(json.dumps(facts, sort_keys=True).encode())


def file_digest(path: Path, *, on_disk: bool = False) -> str | None:
    """Digest of a file as it is there, None where there is none.

    Parameters
    ----------
    on_disk : bool
        Have the system bring the file to the disk before.
    """
    try:
        with path.open("r+b" if on_disk else "rb") as file:
            if on_disk:
                os.fsync(file.fileno())
            return digest(file.read())
    except _NO_FILE:
        return None


def write_sheet(path: Path, place: str, facts: Mapping[str, Any]) -> None:
    """Write plain data with a digest of themselves and of their place, to the disk and in one step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.partial")
    with part.open("w", encoding="utf-8") as file:
        json.dump({"digest": digest_of([place, facts]), "facts": facts}, file)
        # On the disk before it gets its name: a crash leaves the old file or the new one, and none that is torn.
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def read_sheet(path: Path, place: str) -> dict[str, Any] | None:
    """What :func:`write_sheet` wrote there; None where nothing is, or not what was written."""
    try:
        held = json.loads(path.read_bytes())
        whole = held["digest"] == digest_of([place, held["facts"]])
    except (*_NO_FILE, ValueError, TypeError, KeyError, RecursionError):
        return None
    return held["facts"] if whole else None


class Lock:
    """That no other process writes to a store; the system gives it back when the process ends, however it ends.

    Raises
    ------
    EppError
        If another one does.
    """

    def __init__(self, path: Path) -> None:
        self._lock = FileLock(path / LOCK, mode=0o666, thread_local=False)
        try:
            self._lock.acquire(blocking=False)
        except Timeout:
            raise EppError(
                f"{path}: another process is writing to this store; expected to wait for its end, or another name."
            ) from None
        except NotImplementedError:  # as for the file systems below
            pass
        except OSError as error:  # what cannot be written needs no lock, and a finished store is read all the same
            if error.errno not in _NO_LOCKS:
                raise

    def release(self) -> None:
        """Let others write."""
        self._lock.release()


class CheckedStore(LocalStore):
    """A store to read from: blocks that are not finished are empty, and what is damaged is refused as it is read.

    Parameters
    ----------
    root : Path
    variables : sequence of str
        Arrays that grow block by block.
    stamp : str
        What the marks of this very sweep carry.
    """

    def __init__(self, root: Path, variables: Sequence[str], stamp: str) -> None:
        super().__init__(root, read_only=True)
        self.variables, self.stamp = frozenset(variables), stamp
        self.marks: dict[str, dict[str, Any]] = {}

    def with_read_only(self, read_only: bool = True) -> Self:
        """The same: nobody writes through it."""
        return self

    async def get(self, key: str, *arguments: Any, **more: Any) -> Buffer | None:
        """Content of a file, None where there is none; of a finished block only as it was written."""
        return self._checked(key, await super().get(key, *arguments, **more))

    def get_sync(self, key: str, *arguments: Any, **more: Any) -> Buffer | None:
        """The same for callers that do not wait."""
        return self._checked(key, super().get_sync(key, *arguments, **more))

    def _checked(self, key: str, found: Buffer | None) -> Buffer | None:
        name, _, block = key.partition("/c/")
        if name not in self.variables or not block:
            return found
        mark = self.marks.get(block) or read_mark(self.root, block, self.stamp)
        if mark is None:
            if (self.root / DONE / block).exists():
                raise EppError(f"{self.root}: {DONE}/{block} is damaged; {REMEDY}.")
            return None
        self.marks[block] = mark
        if mark.get(name) != (None if found is None else digest(found.to_bytes())):
            raise EppError(f"{self.root}: {key} is damaged; {REMEDY}.")
        return found


def read_mark(root: Path, block: str, stamp: str) -> dict[str, Any] | None:
    """Digests of the files of a block that is finished, by variable; None for another block, or a damaged mark."""
    return read_sheet(root / DONE / block, f"{stamp}/{block}")


def write_mark(root: Path, block: str, stamp: str, names: Sequence[str]) -> None:
    """Mark a block as finished, once all that it has in these arrays is on the disk."""
    digests = {name: file_digest(root / name / "c" / block, on_disk=True) for name in names}
    write_sheet(root / DONE / block, f"{stamp}/{block}", digests)


def is_whole(root: Path, block: str, stamp: str, names: Sequence[str]) -> bool:
    """Whether a block is finished and its files are as they were written."""
    mark = read_mark(root, block, stamp)
    if mark is None:
        return False
    with suppress(OSError):
        return all(mark.get(name) == file_digest(root / name / "c" / block) for name in names)
    return False
