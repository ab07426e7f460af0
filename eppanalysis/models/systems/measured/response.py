"""A frequency response as it was measured: frequencies, complex values, their standard deviation, the static gain."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import checked, checked_class, floats
from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.measured.curve import Curve
from eppanalysis.readable import number
from eppanalysis.shown import Shown, frame_of

if TYPE_CHECKING:
    import control
    import pandas

    from eppanalysis.plotting import Axes

#: Fewest points of a curve.
_FEWEST = 8
#: Steps of the phase between two neighbours from which it is open which way it turned, unless the magnitude tells, and
#: from which it does not [rad].
_TURN, _HALF_TURN = 2.5, 3.0
#: Deviation from which log magnitude and phase are no longer as likely to be off one way as the other.
_NOISY = 0.3


@checked_class
@dataclass(frozen=True, eq=False, repr=False)
class MeasuredResponse(Shown):
    """Measured frequency response of a linear part with one input and one output.

    Between the points it is a curve of log magnitude and unwrapped phase over log frequency; outside them it has no
    value. It smooths points with a standard deviation and passes through others.

    Parameters
    ----------
    omega : array_like, shape (m,)
        Angular frequencies [rad/s], positive and ascending; eight or more.
    value : array_like, shape (m,)
        Complex response at each of them.
    deviation : array_like, shape (m,), or float, optional
        Standard deviation of its real and of its imaginary part, over its magnitude: 0.01 is one per cent of magnitude
        and 0.01 rad of phase. That of a mean of several sweeps is that of one over the square root of their number.
    static_gain : float, optional
        Response at frequency zero, which only oscillations with a mean need; infinite for a part that integrates.
    unstable_poles : int
        How many poles of the part lie right of the imaginary axis, for the stability of cycles: none where it was
        measured alone.
    name : str
        What results call it.

    Raises
    ------
    ModelError
        If lengths differ, frequencies are not positive and ascending, a value is zero or not finite, there are fewer
        than eight, a deviation is not positive or is 0.3 or more, or the phase turns by more than 2.5 rad between two
        neighbours and neither a peak nor a dip of the magnitude says which way. For half a turn only a peak decides.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> omega = np.geomspace(0.1, 10.0, 101)
    >>> response = epp.MeasuredResponse(omega, 1.0 / (1.0 + 1j * omega))
    >>> f"{response.at(2.0):.5f}"
    '0.20000-0.40000j'
    """

    omega: ArrayLike
    value: Any
    deviation: ArrayLike | float | None = None
    static_gain: float | None = None
    unstable_poles: int = 0
    name: str = "response"

    def __post_init__(self) -> None:
        omega, value = _numbers(self.omega, float, "omega"), _numbers(self.value, complex, "value")
        if omega.ndim != 1 or omega.shape != value.shape:
            _refuse("value", f"of shape {value.shape}", f"as many values as frequencies, shape {omega.shape}")
        if len(omega) < _FEWEST:
            _refuse("omega", f"{len(omega)} frequencies", f"{_FEWEST} or more")
        before = np.append(0.0, omega[:-1])
        if not np.all(rises := np.isfinite(omega) & (omega > before)):
            i = int(np.argmin(rises))
            behind = f" after {before[i]:.6g}" if i else ""
            _refuse("omega", f"{omega[i]:.6g} rad/s{behind}", "finite frequencies above zero, each once, in order")
        if not (np.all(np.isfinite(value)) and np.all(np.abs(value) > 0)):
            at = omega[int(np.argmin(np.isfinite(value) & (np.abs(value) > 0)))]
            _refuse("value", f"zero or not finite at {at:.6g} rad/s", "a finite response with a magnitude")
        steps = np.abs(np.angle(value[1:] / value[:-1]))
        if (open_ways := np.flatnonzero((steps > _TURN) & ~self._told_by_magnitude(value))).size:
            i = int(open_ways[0])
            between = f"{omega[i]:.6g} and {omega[i + 1]:.6g} rad/s"
            _refuse("value", f"{steps[i]:.3g} rad of phase apart at {between}", "neighbours less than 2.5 rad apart")
        object.__setattr__(self, "omega", omega)
        object.__setattr__(self, "value", value)
        if self.deviation is not None:
            object.__setattr__(self, "deviation", self._checked_deviation())
        if self.unstable_poles < 0:
            _refuse("unstable_poles", str(self.unstable_poles), "zero or more")
        gain = self.static_gain
        if gain is not None and (np.isnan(gain) or gain == -np.inf):
            _refuse("static_gain", str(gain), "a number, or infinity for a part that integrates")

    def _told_by_magnitude(self, value: ComplexArray) -> BoolArray:
        """Of each step between neighbours, whether the phase turned as the magnitude says.

        At a peak, of a lightly damped pole, it turns back, or ahead where the pole is unstable; at a dip, of a zero on
        the left, ahead, by less than half a turn.
        """
        size, turn = np.log(np.abs(value)), np.angle(value[1:] / value[:-1])
        told = np.zeros(len(turn), bool)
        dip, ahead, half = (
            size[:-3] + size[3:] > size[1:-2] + size[2:-1],
            turn[1:-1] > 0,
            np.abs(turn[1:-1]) >= _HALF_TURN,
        )
        told[1:-1] = np.where(
            dip, ahead & ~half, np.where(half, self.unstable_poles < 2, ~ahead | (self.unstable_poles > 1))
        )
        return told

    @property
    def _phase(self) -> Array:
        """Unwrapped phase at the points [rad]; what seems half a turn ahead, at the peak of a pole, is one back."""
        value = np.asarray(self.value, complex)
        phase = np.unwrap(np.angle(value))
        for i in np.flatnonzero(np.diff(phase) >= _HALF_TURN):
            phase[i + 1 :] -= 2.0 * np.pi
        return phase

    def _checked_deviation(self) -> Array:
        size = _numbers(self.deviation, float, "deviation")
        if size.ndim and size.shape != self._omega.shape:
            _refuse("deviation", f"of shape {size.shape}", f"one number, or shape {self._omega.shape}")
        size = np.broadcast_to(size, self._omega.shape).copy()
        wrong = np.flatnonzero(~((size > 0) & (size < _NOISY)))
        if wrong.size:
            at = f"{size[wrong[0]]:.4g} at {self._omega[wrong[0]]:.6g} rad/s"
            _refuse("deviation", at, f"shares of the magnitude above 0 and below {_NOISY}; leave noisier points out")
        return size

    @classmethod
    @checked
    def from_control(
        cls,
        data: control.FrequencyResponseData,
        deviation: ArrayLike | float | None = None,
        static_gain: float | None = None,
        unstable_poles: int = 0,
        name: str = "response",
    ) -> MeasuredResponse:
        """From python-control's frequency response data.

        Parameters
        ----------
        data : control.FrequencyResponseData
            With one input and one output; a point at frequency zero is the static gain where that is not given.
        deviation : array_like or float, optional
            As in the class; for as many points as `data` has.
        static_gain, unstable_poles, name : optional
            As in the class.

        Returns
        -------
        MeasuredResponse

        Raises
        ------
        ModelError
            If it is something else, has several inputs or outputs, or its points are refused.
        """
        if not (hasattr(data, "omega") and hasattr(data, "frdata")):
            raise ModelError(f"from_control: the data are a {type(data).__name__}", expected="FrequencyResponseData")
        values = np.asarray(data.frdata)
        if values.shape[:2] != (1, 1):
            shown = f"{values.shape[1]} inputs and {values.shape[0]} outputs"
            raise ModelError(f"from_control: the data have {shown}", expected="one of each")
        omega, value = np.asarray(data.omega, float), np.asarray(values[0, 0], complex)
        at_rest = omega == 0.0
        if np.any(at_rest) and static_gain is None:
            static_gain = float(value[at_rest][0].real)
        if deviation is not None and np.ndim(deviation):
            deviation = np.asarray(deviation, float)[~at_rest]
        return cls(omega[~at_rest], value[~at_rest], deviation, static_gain, unstable_poles, name)

    @property
    def _omega(self) -> Array:
        return np.asarray(self.omega, float)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest measured frequency [rad/s]."""
        return float(self._omega[0]), float(self._omega[-1])

    @cached_property
    def curve(self) -> Curve:
        """The curve through the points, or fitted to them."""
        size, deviation = np.log(np.abs(np.asarray(self.value))), None if self.deviation is None else self._of()
        return Curve.through(np.log(self._omega), np.column_stack([size, self._phase]), deviation)

    def _of(self) -> Array:
        return np.asarray(self.deviation, float)

    def at(self, omega: ArrayLike) -> ComplexArray:
        """Response at frequencies [rad/s]; not a number outside the data."""
        return self.with_slope(omega)[0]

    def with_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """Response at frequencies [rad/s], and its derivative by them; not a number outside the data."""
        omega = floats(omega, "MeasuredResponse: omega")
        inside, (G, dG) = self.knows(omega), self.curve.at(omega)
        return np.where(inside, G, np.nan), np.where(inside, dG, np.nan)

    def knows(self, omega: Array) -> BoolArray:
        """Whether frequencies [rad/s] lie within the data."""
        low, high = self.band
        return (omega >= low * (1.0 - 1e-12)) & (omega <= high * (1.0 + 1e-12))

    def __str__(self) -> str:
        """How much was measured, and how well."""
        told = f"Frequency response at {len(self._omega)} frequencies {reach(self)}"
        if self.deviation is not None:
            told += f", standard deviation {number(100.0 * float(np.median(self._of())))} %"
        return told + ("" if self.static_gain is None else f", static gain {number(float(self.static_gain))}") + "."

    @property
    def subject(self) -> str:  # type: ignore[override]  # its own name
        """What results call it."""
        return self.name

    def facts(self) -> dict[str, Any]:
        """What is known beside the points."""
        return {"static_gain": self.static_gain, "unstable_poles": self.unstable_poles}

    def to_frame(self) -> pandas.DataFrame:
        """One row a measured frequency: magnitude, unwrapped phase, and the deviation over the magnitude."""
        size, phase = np.exp(self.curve.points[:, 0]), self.curve.points[:, 1]
        rows = [{"omega": w, "magnitude": g, "phase": p} for w, g, p in zip(self._omega, size, phase, strict=True)]
        if self.deviation is not None:
            rows = [row | {"deviation": d} for row, d in zip(rows, self._of(), strict=True)]
        return frame_of(rows, {"omega": "rad/s", "phase": "rad"})

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Bode diagram of the points and the curve through them; the magnitude alone in given axes."""
        return self.drawn("plot_response", ax)


def reach(measured: Any) -> str:
    """From where to where something is measured, in words."""
    low, high = measured.band
    return f"from {number(low)} to {number(high)} rad/s"


def _numbers(given: object, kind: type, field: str) -> NDArray:
    try:
        return np.array(given, kind)
    except (TypeError, ValueError, OverflowError):
        raise ModelError("MeasuredResponse", given, "numbers", field=field) from None


def _refuse(field: str, found: str, expected: str) -> None:
    raise ModelError(f"MeasuredResponse: {field} is {found}", expected=expected, field=field)
