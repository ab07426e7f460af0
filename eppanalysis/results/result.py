"""What a result is: a status that is a sentence, plain data, what made it, and how it is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from operator import attrgetter
from typing import Any, ClassVar, Generic, TypeVar, overload

import numpy as np

from eppanalysis.errors import NotConverged
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import Shown

Part = TypeVar("Part")


class Status(Enum):
    """How a method ended, as a sentence for people.

    It is worded for a run (settled to event limit), a search (incomplete) or an iteration (not converged); where
    another method has the status, its own message says what it means there.
    """

    CONVERGED = "The method converged."
    SETTLED = "The motion settled at rest."
    LIMIT_CYCLE = "The motion settled on a limit cycle."
    UNDECIDED = "The motion had neither settled nor repeated itself by the end; simulate for longer."
    DIVERGED = "The motion grew without bound."
    EVENT_LIMIT = "The run stopped early, as it had used up its events or its steps; its results end where it stopped."
    INCOMPLETE = "The search covers only a part; its sentence names it."
    NOT_CONVERGED = "The iteration did not converge; its last iterate is given for inspection only."

    @property
    def ok(self) -> bool:
        """Whether results with this status may be relied on."""
        return self in (Status.CONVERGED, Status.SETTLED, Status.LIMIT_CYCLE)


def require_converged(status: Status, what: str) -> None:
    """Raise NotConverged unless `status` is a success."""
    if not status.ok:
        raise NotConverged(f"{what}: {status.value}")


def plain(value: Any) -> Any:
    """A value as plain data: arrays as lists, complex numbers as pairs, members of enumerations by their names.

    Examples
    --------
    >>> plain({"status": Status.CONVERGED, "values": np.array([1.0, 2.0j])})
    {'status': 'converged', 'values': [[1.0, 0.0], [0.0, 2.0]]}
    """
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, Enum):
        return value.value if isinstance(value, str) else value.name.lower()
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, Mapping):
        return {name: plain(inner) for name, inner in value.items()}
    if is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())
    is_list = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    return [plain(inner) for inner in value] if is_list else value


class PlainData:
    """A dataclass that people get as plain data."""

    #: What its plain data hold, in order: fields, properties and methods by name, with ``name=place`` for one that goes
    #: by another name there; all fields where nothing is said.
    in_json: ClassVar[str] = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data in SI units, as ``--json`` prints it."""
        names = self.in_json.split() or [f.name for f in fields(self)]  # type: ignore[arg-type]  # a dataclass
        parts = ((name, attrgetter(place or name)(self)) for name, _, place in (item.partition("=") for item in names))
        return {name: plain(part() if callable(part) else part) for name, part in parts}


class Brief(PlainData):
    """A dataclass whose repr fits the console: its plain values, and how much there is of the others."""

    def __repr__(self) -> str:
        named = fields(self)  # type: ignore[arg-type]  # only dataclasses inherit from it
        shown = {f.name: _brief(getattr(self, f.name)) for f in named if f.name != "provenance"}
        return f"{type(self).__name__}({', '.join(f'{name}={text}' for name, text in shown.items() if text)})"


def _brief(value: object) -> str:
    """A plain value itself; of a collection what it is and its size; nothing where there is nothing."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return f"{value:.7g}"
    if value is None or isinstance(value, str | int):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"<array {'x'.join(map(str, value.shape))}>" if value.size else ""
    if isinstance(value, Sized):
        return f"<{type(value).__name__} of {len(value)}>" if len(value) else ""
    return f"<{type(value).__name__}>"


@dataclass(frozen=True, eq=False, repr=False)
class Result(Shown, PlainData):
    """What an analysis returns: its sentence is ``str(result)``, and a notebook shows sentence, table and picture.

    Attributes
    ----------
    provenance : Provenance
        What made it; nothing is computed with it.
    operating_point : OperatingPoint or None
        Where the external inputs are held, or why they are not constant; None where a result is of no single one.
    """

    provenance: Provenance = field(default_factory=Provenance, kw_only=True, compare=False, repr=False)
    operating_point: OperatingPoint | None = field(default=None, kw_only=True, compare=False)

    @property
    def subject(self) -> str:  # type: ignore[override]  # of its provenance
        """Name of the case or the system that the result is of; empty where none was given."""
        return self.provenance.subject

    def facts(self) -> Mapping[str, Any]:
        """What made it, as plain data."""
        return self.provenance.to_dict()


class Listing(Result, Generic[Part]):
    """A result that behaves as the sequence of its parts."""

    #: The field that holds them.
    parts: ClassVar[str]

    def __len__(self) -> int:
        return len(getattr(self, self.parts))

    @overload
    def __getitem__(self, place: int) -> Part: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Part, ...]: ...
    def __getitem__(self, place: int | slice) -> Part | tuple[Part, ...]:
        found: Part | tuple[Part, ...] = getattr(self, self.parts)[place]
        return found

    def __iter__(self) -> Iterator[Part]:
        return iter(getattr(self, self.parts))
