"""What a case is of: the questions that cases of every kind answer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from eppanalysis.cases.files import RawCase
from eppanalysis.cases.schema import CaseFile
from eppanalysis.cases.values.expressions import same_unit
from eppanalysis.cases.values.parameters import Named
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.cases.variation import LoopVariation, Variation
from eppanalysis.models.devices.elbow.parameters import ElbowParameters
from eppanalysis.models.systems.inputs import InputSignal
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.units import QuantityError, parse_any


@dataclass(frozen=True)
class Parts:
    """What a validated file describes."""

    parameters: dict[str, Parameter]  # every scalar parameter that is given, by its dotted name
    input: InputSignal | Mapping[str, InputSignal] | None
    system: LureSystem
    elbow: ElbowParameters | None = None  # of a case of the elbow
    #: Numbers that expressions come to, by the dotted names of the fields that hold these.
    computed: dict[str, Named] = field(default_factory=dict)
    #: SI unit of each external input, and the unit that people use.
    input_units: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()  # sentences on what is possible but hardly meant


class Kind(ABC):
    """A kind of case.

    Attributes
    ----------
    name : str
        What its files call it.
    file : type of CaseFile
        The model of its files.
    variation : type of Variation
        What is worth varying in its cases.
    """

    name: ClassVar[str]
    file: ClassVar[type[CaseFile]]
    variation: ClassVar[type[Variation]] = LoopVariation

    @abstractmethod
    def parts(self, file: Any, raw: RawCase) -> Parts:
        """What a validated file describes.

        Raises
        ------
        CaseError
            If its fields contradict one another, or no system follows from them.
        """

    @abstractmethod
    def fields(self, parameters: Iterable[str]) -> list[str]:
        """Names of all parameters that a case with the given ones may have, beside those of its run."""

    def si(self, value: object, unit: str) -> float:
        """SI value of a quantity in a field that has this SI unit, radians left out or not, or of a plain number.

        Raises
        ------
        QuantityError
            If it has another dimension.
        """
        number, given = parse_any(value)
        if given and not (unit and same_unit(given, unit)):
            raise QuantityError(f"a quantity in {unit or 'plain numbers'}")
        return number

    def takes(self, name: str, data: Mapping[str, Any]) -> bool:
        """Whether a file with these tables takes a field that its parts name, beside :meth:`fields`."""
        return False

    def path(self, name: str, data: Mapping[str, Any]) -> list[str | int]:
        """Where a field is in a file with these tables."""
        return list(name.split("."))

    def named_signals(self, data: Mapping[str, Any], signals: tuple[str, ...]) -> tuple[str, ...]:
        """Those of the loop's signals that a file with these tables names itself."""
        return signals

    def implied(self, elbow: ElbowParameters | None, name: str) -> float | None:
        """A parameter that the file does not give itself, but that follows from others or has a default."""
        return None

    def beside(self, elbow: ElbowParameters | None, data: Mapping[str, Any], given: Mapping[str, set[str]]) -> Any:
        """Fields needed beside given ones of each section for the rest to stay where it is, by sections."""
        return {}
