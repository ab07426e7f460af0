"""What the methods need of a case: the case layer is above them, so that they know it by these members only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeVar

from eppanalysis.errors import EppError, ModelError, did_you_mean
from eppanalysis.foreign import line_for
from eppanalysis.models.systems.inputs import InputSignal, Sine, input_signals_by_name
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.loop import MeasuredLoop
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import instead_of, refuse_samples


class CaseLike(Protocol):
    """What the methods need of a case (the case layer is above them)."""

    @property
    def name(self) -> str:
        """What results call it."""

    @property
    def input(self) -> InputSignal | Mapping[str, InputSignal] | None:
        """Signal of the external input."""

    @property
    def t_end(self) -> float:
        """Length of a run [s]."""

    @property
    def operating_point(self) -> OperatingPoint:
        """Values of the inputs at the end of the run."""

    def to_system(self) -> LureSystem:
        """The system."""

    def with_values(self, values: Mapping[str, Any]) -> CaseLike:
        """The same case with other values."""

    def si(self, name: str, value: object) -> float:
        """SI value of a quantity."""

    def value(self, name: str) -> float:
        """A parameter [SI]."""

    def unit(self, name: str) -> tuple[str, str]:
        """SI unit and the unit people use."""

    def readable(self, name: str) -> tuple[str, float]:
        """The unit people use, and the factor from SI to it."""

    def text(self, name: str, value: float, digits: int = 6) -> str:
        """A value of a parameter, given in SI units, as people write it."""


def facts_of(case: CaseLike | LureSystem | MeasuredLoop) -> Mapping[str, Any]:
    """What provenance says of a case: all that it tells of itself, at least its name; nothing of a loop."""
    if isinstance(case, LureSystem | MeasuredLoop):
        return {}
    own = getattr(case, "provenance", None)
    return {"case": case.name} if own is None else own()


#: Analyses that need no states, so that a measured frequency response is enough.
_KNOW_DATA = ("predict_limit_cycles", "harmonic_balance", "margins")
#: An operating point as analyses take it: itself, or inputs by name [SI], the others staying where they are.
PointLike = OperatingPoint | Mapping[str, float]
C = TypeVar("C", bound=CaseLike)


def system_of(loop: LureSystem | CaseLike | MeasuredLoop, analysis: str) -> LureSystem:
    """The system that an analysis was handed, as itself or as a case.

    Raises
    ------
    EppError
        If it is neither, or has no states and the analysis needs them.
    """
    if isinstance(loop, MeasuredLoop) and analysis not in _KNOW_DATA:
        raise EppError(
            f"{analysis}: {loop.name} is a measured frequency response, which has no states; expected a loop that has "
            "them, such as rational_model() makes of the data."
        )
    if isinstance(loop, LureSystem):
        return loop
    if not hasattr(loop, "to_system"):
        expected = line_for(loop) or "a Case or a LureSystem"
        raise EppError(f"{analysis}: the first argument is a {type(loop).__name__}; expected {expected}.")
    return loop.to_system()


def standing(
    loop: LureSystem | CaseLike | MeasuredLoop, given: PointLike | None, analysis: str
) -> tuple[LureSystem, OperatingPoint]:
    """The system and the operating point of an analysis: as given, else that of the case or the loop.

    Raises
    ------
    EppError
        If it is neither a case nor a loop, an input is not constant, or the analysis does not cover sampled
        controllers and there are some.
    ModelError
        If there is no input of that name.
    """
    system = system_of(loop, analysis)
    refuse_samples(system.elements, analysis)
    point = OperatingPoint.of(system) if isinstance(loop, LureSystem | MeasuredLoop) else loop.operating_point
    if given is not None:
        point = given if isinstance(given, OperatingPoint) else point.with_inputs(given)
    inputs = point.vector(system).tolist()
    return system, OperatingPoint(dict(zip(system.input_names, inputs, strict=True)))


def require_continuous(system: LureSystem, analysis: str) -> None:
    """Refuse a loop in discrete time.

    Raises
    ------
    EppError
        If it is one.
    """
    if system.time_step:
        raise EppError(f"{analysis} does not cover loops in discrete time: {instead_of(analysis)}.")


def require_case(case: C | LureSystem, analysis: str) -> C:
    """The case that an analysis over parameters was handed; at the public door a loop has become one.

    Raises
    ------
    EppError
        If it is none, or the analysis does not cover sampled controllers and there are some.
    """
    if isinstance(case, LureSystem) or not hasattr(case, "to_system"):
        kind = type(case).__name__
        hint = "; Case.from_system() makes one of a loop" if isinstance(case, LureSystem) else ""
        raise EppError(
            f"{analysis}: the first argument is a {kind}; expected a Case, as case() and read_case() give{hint}."
        )
    refuse_samples(case.to_system().elements, analysis)
    return case


def own_sines(loop: LureSystem | CaseLike, analysis: str) -> dict[str, Sine]:
    """The sines among the input signals of a case."""
    given: Any = getattr(loop, "input", None)
    if given is None:
        return {}
    signals = input_signals_by_name(system_of(loop, analysis).input_names, given)
    return {name: one for name, one in signals.items() if isinstance(one, Sine) and one.amplitude > 0}


def driven_input(loop: LureSystem | CaseLike, input: str | None, analysis: str) -> str:
    """The input that a sine drives: as given, else the one of the case with a sine, else the only one.

    Raises
    ------
    EppError
        If there is none, or there are several.
    ModelError
        If there is none of that name.
    """
    system = system_of(loop, analysis)
    names = tuple(system.input_names)
    if not names:
        raise EppError(f"{analysis}: {system.name} has no external input; expected one that a sine can drive.")
    if input is not None:
        if input not in names:
            raise ModelError(f"{system.name} has no input {input!r}", expected=did_you_mean(input, names))
        return input
    likely = tuple(own_sines(loop, analysis)) or names
    if len(likely) > 1:
        raise EppError(f"{analysis}: {system.name} has inputs {', '.join(likely)}; expected the name of one.")
    return likely[0]
