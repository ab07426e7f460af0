"""A PID controller with a limited output whose integrator does not wind up: linear states around a saturation."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from eppanalysis.models.elements.base import DAMPING, OUT, SLOPE, SLOPE_PER_TIME, TIME, Nonlinearity, OwnStates
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.phases import POSITIVE, require, require_numbers
from eppanalysis.models.elements.piecewise import UNITY, PiecewiseLinear


class LimitedPID(Nonlinearity):
    """What PID controllers with a limited output share, however they keep the integrator from winding up."""

    kp: float
    ki: float
    lower: float
    upper: float
    kd: float
    filter_time: float

    def _require_limits(self) -> None:
        """Refuse limits that do not ascend, and a derivative without a filter."""
        require(self, "upper", self.upper > self.lower, "more than lower", "lower")
        if self.kd:
            require(self, "filter_time", self.filter_time > 0, "a positive number, as there is a derivative")

    @property
    def _derivative(self) -> tuple[int, float, float]:
        """Number of states, the derivative's gain at once, and the rate of its filter."""
        return (2, self.kd / self.filter_time, 1.0 / self.filter_time) if self.kd else (1, 0.0, 0.0)

    def _set_states(self, states: OwnStates) -> None:
        """Store the states, and what margins take: the PID within its limits.

        That is cut at its input: at the limits the path of the anti-windup would be cut with it.
        """
        n, ahead, filtering = self._derivative
        none, driven, of_state = np.zeros(n), np.array([self.ki, filtering])[:n], np.array([1.0, -ahead])[:n]
        within = OwnStates(
            np.diag([0.0, -filtering])[:n, :n], np.column_stack([none, driven]), np.array([none, of_state]),
            np.diag([1.0, self.kp + ahead]),
        )  # fmt: skip
        object.__setattr__(self, "own_states", states)
        object.__setattr__(self, "small_signal", AutomatonElement(UNITY.automaton(), within))


@dataclass(frozen=True)
class AntiWindupPID(LimitedPID, PiecewiseLinear, kind="anti_windup_pid"):
    """PID controller whose output is limited, with anti-windup by back-calculation.

    With the error e and the output v that it would have without limits, ::

        v = kp e + s + kd/filter_time (e - d)
        u = clip(v, lower, upper)
        ds/dt = ki e + (u - v)/tracking_time
        dd/dt = (e - d)/filter_time

    so that the integrator s follows the limit within the tracking time. Its states start at zero. Its describing
    function, sector and slopes are those of the saturation from v to u; the states belong to the loop. Margins are
    those of the PID within its limits.

    Parameters
    ----------
    kp : float
        Proportional gain [unit of the output per unit of the input].
    ki : float
        Integral gain [unit of the output per unit of the input and s].
    tracking_time : float
        Time constant with which the integrator follows the limit [s], positive; the longer, the more it winds up.
    lower, upper : float
        Limits of the output, ascending [unit of the output].
    kd : float
        Derivative gain [unit of the output per unit of the input, times s].
    filter_time : float
        Time constant of the derivative's filter [s], positive where there is a derivative.

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    >>> from eppanalysis.models.elements import AntiWindupPID
    >>> pi = AntiWindupPID(kp=2.0, ki=4.0, tracking_time=0.5)
    >>> pi.own_states.A.tolist(), pi.own_states.B.tolist()
    ([[-2.0]], [[0.0, 2.0]])
    """

    units = MappingProxyType({
        "kp": SLOPE, "ki": SLOPE_PER_TIME, "tracking_time": TIME, "lower": OUT, "upper": OUT, "kd": DAMPING,
        "filter_time": TIME,
    })  # fmt: skip

    kp: float
    ki: float
    tracking_time: float
    lower: float = -1.0
    upper: float = 1.0
    kd: float = 0.0
    filter_time: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, tracking_time=POSITIVE)
        self._require_limits()
        self._set_pieces([self.lower, self.upper], [0.0, 1.0, 0.0], [self.lower, 0.0, self.upper])
        self._set_states(self._states())

    def _states(self) -> OwnStates:
        """The integrator, and the filter of the derivative where there is one."""
        n, ahead, filtering = self._derivative
        v_of_state, v_of_error, back = np.array([1.0, -ahead])[:n], self.kp + ahead, 1.0 / self.tracking_time
        free, driven, none = np.diag([0.0, -filtering])[:n, :n], np.array([self.ki, filtering])[:n], np.zeros(n)
        first = np.eye(n)[0]
        # The integrator is driven by (u - v)/tracking_time: v is put in, so that u alone is the saturation's
        # (docs/theory/anti_windup.md).
        A, B = free - back * np.outer(first, v_of_state), driven - back * v_of_error * first
        return OwnStates(
            A, np.column_stack([B, back * first]), np.array([v_of_state, none]), np.diag([v_of_error, 1.0])
        )
