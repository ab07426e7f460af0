"""The operating point: where the external inputs of a loop are held while it rests or oscillates by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked, checked_class
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.models.systems.inputs import InputSignal, Sine, input_signals_by_name

if TYPE_CHECKING:
    from eppanalysis.models.systems.lure import LureSystem

#: Why such an input is not constant.
_SINE = "is a sine"


@checked_class
@dataclass(frozen=True)
class OperatingPoint:
    """Where the external inputs of a loop are held, or why they are not constant.

    That of a case has its inputs at the end of its run; that of a loop without input signals, its `v0`.

    Parameters
    ----------
    inputs : mapping of str to float
        The inputs by name [SI]; those not named stay where the loop has them before its start.
    moving : mapping of str to str
        Why an input is not constant, by its name ("is a sine").

    Raises
    ------
    ModelError
        If a value is not finite.

    Examples
    --------
    >>> from eppanalysis import OperatingPoint
    >>> OperatingPoint({"hand": 0.02}).stands
    True
    >>> str(OperatingPoint({"hand": 0.0}, {"hand": "is a sine"}))
    "input 'hand' is a sine"
    """

    inputs: Mapping[str, float] = field(default_factory=dict)
    moving: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in self.inputs.items():
            if not isfinite(value):
                raise ModelError("OperatingPoint", value, "a finite number", field=name)

    @classmethod
    @checked
    def of(
        cls, system: LureSystem, input: InputSignal | Mapping[str, InputSignal] | None = None, time: float = 0.0
    ) -> OperatingPoint:
        """Where the inputs of a loop are at a time of a run.

        Parameters
        ----------
        system : LureSystem
        input : InputSignal or mapping of str to InputSignal, optional
            What is added to the inputs from t = 0 on; by default they stay at the loop's `v0`.
        time : float
            When [s]: the end of the run; infinite for where they come to.

        Raises
        ------
        ModelError
            If a single motion meets a loop that does not have exactly one input.
        """
        start = dict(zip(system.input_names, np.asarray(system.v0, float).tolist(), strict=True))
        input_signals = {n: m for n, m in input_signals_by_name(system.input_names, input).items() if n in start}
        inputs = {n: v + _offset(input_signals[n], time) if n in input_signals else v for n, v in start.items()}
        why = {name: _moves(input_signal, time) for name, input_signal in input_signals.items()}
        return cls(inputs, {name: text for name, text in why.items() if text})

    @property
    def stands(self) -> bool:
        """Whether all inputs are constant."""
        return not self.moving

    @checked
    def with_inputs(self, inputs: Mapping[str, float]) -> OperatingPoint:
        """The same with some inputs held at other values [SI]."""
        left = {name: text for name, text in self.moving.items() if name not in inputs}
        return OperatingPoint({**self.inputs, **inputs}, left)

    @checked
    def vector(self, system: LureSystem) -> Array:
        """The inputs in the order of a loop, shape (nv,).

        Raises
        ------
        EppError
            If an input is not constant.
        ModelError
            If the loop has no input of that name.
        """
        value = np.array(system.v0, float)
        for name, number in self.inputs.items():
            if name not in system.input_names:
                known = ", ".join(system.input_names) or "none"
                raise ModelError(f"{system.name}: there is no input {name!r}", expected=f"one of: {known}")
            value[system.input_names.index(name)] = number
        if self.moving:
            sine = " For a loop under a sine use forced_response (on the command line: response)."
            raise EppError(
                f"{system.name}: {self}, so there is no operating point for a limit cycle; expected inputs that are "
                f"constant at the end of the run, or values at which they are held.{sine * self.is_driven}"
            )
        return value

    @property
    def is_driven(self) -> bool:
        """Whether an input is a sine."""
        return _SINE in self.moving.values()

    def to_dict(self) -> dict[str, Any]:
        """Plain data in SI units."""
        return {"inputs": dict(self.inputs), "moving": dict(self.moving)}

    def __str__(self) -> str:
        """The inputs, or why they are not constant."""
        if self.moving:
            return " and ".join(f"input {name!r} {text}" for name, text in self.moving.items())
        return ", ".join(f"{name} = {value:.6g}" for name, value in self.inputs.items()) or "no inputs"


def _offset(input_signal: InputSignal, time: float) -> float:
    """What a signal adds to its input at a time; the middle of a sine."""
    if isinstance(input_signal, Sine):
        return 0.0
    # Behind its last breakpoint it stays where it is there, or is never constant.
    return float(input_signal.value(time if isfinite(time) else float(input_signal.breakpoints()[0][-1])))


def _moves(input_signal: InputSignal, time: float) -> str:
    """Why an input is not constant at a time, in words; empty where it does."""
    if isinstance(input_signal, Sine):
        return _SINE if input_signal.amplitude else ""
    times, _, slopes = input_signal.breakpoints()
    slope = slopes[max(int(np.searchsorted(times, time, side="right")) - 1, 0)] if time >= times[0] else 0.0
    until = f"has not ended at {time:.6g} s" if isfinite(time) else "does not end"
    return f"is a {type(input_signal).__name__.lower()} that {until}" if slope else ""
