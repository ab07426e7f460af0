"""What a record may be: a file of one of these formats, by its ending, or a table in memory.

Nothing in a file runs. A format whose library is not installed is one sentence with the command that installs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from numpy.typing import ArrayLike

from eppanalysis.errors import CaseError, EppError, Missing, require_packages, shown
from eppanalysis.records.tables import Table

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import DataArray, Dataset

    Given: TypeAlias = str | Path | Mapping[str, ArrayLike] | DataFrame | Dataset | DataArray
else:
    Given = Any

#: What benches have in their first line.
HEADER = "a header such as 'time [s],force [lbf],voltage [V]'"
#: Bytes of a file that is read into memory as a whole.
_LARGEST = 2_000_000_000
#: By a file's ending: what it is called, the function that opens it (in a module of this package), and its packages.
_FORMATS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    ".parquet": ("a Parquet file", "columnar.Parquet", ("pyarrow",)),
    ".mat": ("a MAT-file", "matlab.mat", ()),
    ".ulg": ("a ULog file", "logs.ulog", ("pyulog",)),
    ".mcap": ("an MCAP file", "logs.bag", ("rosbags",)),
    ".db3": ("a rosbag2 file", "logs.bag", ("rosbags",)),
    ".mf4": ("an MF4 file", "logs.mf4", ("asammdf",)),
}
_BAG = ("a rosbag2 folder", "logs.bag", ("rosbags",))


def opened(given: Given, header: str = HEADER, *, has_si: bool = False, largest: int | None = None) -> Table:
    """The table that a file or what is in memory holds.

    Parameters
    ----------
    given : path, mapping of str to array, DataFrame, Dataset or DataArray
        A path with another ending than those of the formats is a CSV file.
    header : str
        What the first line of a CSV file may be, for messages.
    has_si : bool
        Whether a column of a CSV file without a unit is in SI units, as those of other formats are.
    largest : int, optional
        Bytes that a file may have.

    Raises
    ------
    CaseError
        If there is no such file, or it cannot be read.
    """
    if not isinstance(given, str | Path):
        return _in_memory(given)
    path, source = Path(given), str(given)
    bag = path.is_dir() and (path / "metadata.yaml").is_file()
    kind, place, packages = _BAG if bag else _FORMATS.get(path.suffix.lower(), ("a CSV file", "", ()))
    with readable_as(source, kind):
        if not (bag or path.is_file()):
            found = "a folder" if path.is_dir() else "not a file" if path.exists() else Missing()
            raise CaseError(source, "", found, f"{kind} that can be read")
        size = sum(p.stat().st_size for p in path.iterdir() if p.is_file()) if bag else path.stat().st_size
        # What is read piece by piece may be of any size.
        largest = largest or (_LARGEST if place and place != "columnar.Parquet" else size)
        if size > largest:
            raise CaseError(source, "", f"{size} bytes long", f"at most {largest} bytes")
    if not place:
        from eppanalysis.records.texts import Text

        with readable_as(source, kind):
            return Text(path, source, header, has_si)
    require_packages(f"{source}: {kind}", "records", *packages)
    module, _, name = place.partition(".")
    reader: Callable[[Path, str], Table] = getattr(import_module(f"eppanalysis.records.{module}"), name)
    with readable_as(source, kind):
        return reader(path, source)


@contextmanager
def readable_as(source: str, kind: str) -> Iterator[None]:
    """Whatever a library raises on a damaged file, as one sentence.

    Raises
    ------
    CaseError
        With the library's reason.
    """
    try:
        yield
    except EppError:
        raise
    except Exception as error:  # each library has errors of its own, and damaged files raise others besides
        why = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise CaseError(
            source, "", f"not readable ({' '.join(why.split())[:120]})", f"{kind} that can be read"
        ) from None


def _in_memory(given: Any) -> Table:
    from eppanalysis.records import memory

    if hasattr(given, "iloc") and hasattr(given, "columns"):
        return memory.frame(given)
    if isinstance(given, Mapping) and not hasattr(given, "dims"):
        return memory.mapping(given)
    if not hasattr(given, "coords"):
        expected = "a path, arrays by name, a DataFrame, a Dataset or a DataArray"
        raise EppError(f"record: is {shown(given)}; expected {expected}.")
    return memory.dataset(given)
