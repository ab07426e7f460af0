"""A PID controller with a limited output whose integrator does not wind up: linear states around a saturation."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from eppanalysis.models.elements.base import OUT, SLOPE, Nonlinearity, OwnStates, Role
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.phases import require, require_numbers
from eppanalysis.models.elements.piecewise import UNITY, PiecewiseLinear

_PER_TIME: Role = (-1, 1, -1)
_TIMES_TIME: Role = (-1, 1, 1)
_TIME: Role = (0, 0, 1)


@dataclass(frozen=True)
class AntiWindupPID(PiecewiseLinear, kind="anti_windup_pid"):
    """PID controller whose output is limited, with anti-windup by back-calculation.

    With the error e and the output v that it would have without limits,

        v = kp e + s + kd/filter_time (e - d),    u = clip(v, lower, upper),
        ds/dt = ki e + (u - v)/tracking_time,     dd/dt = (e - d)/filter_time

    so that the integrator s follows the limit within the tracking time. Its states start at zero. What it says of
    itself, its describing function included, is that of the saturation, from v to u; the states are the loop's. Margins
    are those of the PID within its limits.

    Parameters
    ----------
    kp : float
        [unit of the output per unit of the input]
    ki : float
        [unit of the output per unit of the input and s]
    tracking_time : float
        Time constant with which the integrator follows the limit [s], positive; the longer, the more it winds up.
    lower, upper : float
        Limits of the output, ascending [unit of the output].
    kd : float
        [unit of the output per unit of the input, times s]
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
        "kp": SLOPE, "ki": _PER_TIME, "tracking_time": _TIME, "lower": OUT, "upper": OUT, "kd": _TIMES_TIME,
        "filter_time": _TIME,
    })  # fmt: skip

    kp: float
    ki: float
    tracking_time: float
    lower: float = -1.0
    upper: float = 1.0
    kd: float = 0.0
    filter_time: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self, *self.units)
        require(self, "tracking_time", self.tracking_time > 0, "a positive number")
        require(self, "upper", self.upper > self.lower, "more than lower", "lower")
        if self.kd:
            require(self, "filter_time", self.filter_time > 0, "a positive number, as there is a derivative")
        self._set_pieces([self.lower, self.upper], [0.0, 1.0, 0.0], [self.lower, 0.0, self.upper])
        object.__setattr__(self, "own_states", self._states())
        object.__setattr__(self, "small_signal", pid_within_limits(self.kp, self.ki, self.kd, self.filter_time))

    def _states(self) -> OwnStates:
        """The integrator, and the filter of the derivative where there is one."""
        n = 2 if self.kd else 1
        ahead = self.kd / self.filter_time if self.kd else 0.0
        filtering = 1.0 / self.filter_time if self.kd else 0.0
        v_of_state, v_of_error, back = np.array([1.0, -ahead])[:n], self.kp + ahead, 1.0 / self.tracking_time
        free, driven, none = np.diag([0.0, -filtering])[:n, :n], np.array([self.ki, filtering])[:n], np.zeros(n)
        first = np.eye(n)[0]
        A, B = free - back * np.outer(first, v_of_state), driven - back * v_of_error * first
        return OwnStates(
            A, np.column_stack([B, back * first]), np.array([v_of_state, none]), np.diag([v_of_error, 1.0])
        )


def pid_within_limits(kp: float, ki: float, kd: float, filter_time: float) -> Nonlinearity:
    """What margins take for a PID controller with anti-windup: the PID within its limits.

    It is cut at its input: at the saturation the path of the anti-windup would be cut with it.
    """
    n = 2 if kd else 1
    ahead, filtering = (kd / filter_time, 1.0 / filter_time) if kd else (0.0, 0.0)
    none, driven, of_state = np.zeros(n), np.array([ki, filtering])[:n], np.array([1.0, -ahead])[:n]
    own = OwnStates(
        np.diag([0.0, -filtering])[:n, :n], np.column_stack([none, driven]), np.array([none, of_state]),
        np.diag([1.0, kp + ahead]),
    )  # fmt: skip
    return AutomatonElement(UNITY.automaton(), own)
