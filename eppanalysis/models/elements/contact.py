"""Compliant backlash: a spring and a damper that touch only outside a gap."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array
from eppanalysis.engine.describing import describe_lock_pin, describe_nordin_shaft
from eppanalysis.models.elements import automata
from eppanalysis.models.elements.automaton import Automaton
from eppanalysis.models.elements.base import DAMPING, IN, SLOPE, Answer, ClosedForm, Estimate, Nonlinearity
from eppanalysis.models.elements.phases import (
    NOT_NEGATIVE,
    POSITIVE,
    SMALLEST_AMPLITUDE,
    broadcast_with_frequency,
    distances,
    require,
    require_numbers,
)

#: Mean stiffness of steel teeth in mesh over their face width [N/m per m]: 20 N/(mm um), ISO 6336-1; a lightly loaded
#: mesh (less than 100 N/mm) is softer. Its line of action touches the base circle, at a pressure angle of 20 deg.
_MESH, _PRESSURE_ANGLE = 20e9, np.radians(20.0)

_CONTACT = MappingProxyType({"gap": IN, "stiffness": SLOPE, "damping": DAMPING})


def mesh_stiffness(pitch_diameter: float, face_width: float) -> float:
    """Stiffness of the teeth of a gear about its axis [N*m/rad], from pitch diameter and face width [m].

    Examples
    --------
    >>> round(mesh_stiffness(pitch_diameter=0.06, face_width=0.01))
    158944
    """
    return float(_MESH * face_width * (0.5 * pitch_diameter * np.cos(_PRESSURE_ANGLE)) ** 2)


@dataclass(frozen=True)
class LockPin(Nonlinearity, kind="lock_pin"):
    """Lock pin in its socket: no torque inside the gap, a spring and a damper outside it.

    Inputs are the relative angle delta [rad] and its rate [rad/s], the output is a torque [N*m].

    Parameters
    ----------
    gap : float
        Total free width [rad], at least zero.
    stiffness : float
        Stiffness of the contact [N*m/rad], positive.
    damping : float
        Damping of the contact [N*m*s/rad], at least zero.
    model : {"unilateral", "classical"}
        "unilateral": contact only pushes, ``max(0, k (delta - gap/2) + c rate)`` for ``delta > gap/2`` and its mirror
        image. "classical": the damper acts wherever ``|delta| > gap/2``, even if it pulls.

    Raises
    ------
    ModelError
        If a field is out of its range.

    Examples
    --------
    >>> from eppanalysis.models.elements import LockPin
    >>> pin = LockPin(gap=0.02, stiffness=100.0, damping=1.0)
    >>> float(pin.output((0.03, 0.5))[0])
    2.5
    >>> mean, gain = pin.describing_function(amplitude=0.02, omega=30.0)
    >>> complex(gain.round(3))
    (40.346+9.955j)
    """

    n_inputs: ClassVar[int] = 2
    input_ports = ("twist", "rate")
    units = _CONTACT
    input_is = "way"
    estimate = Estimate(
        "stiffness",
        "N*m/rad",
        MappingProxyType({"pitch_diameter": "m", "face_width": "m"}),
        mesh_stiffness,
        "teeth of steel in mesh (ISO 6336-1); shafts and light loads make it softer",
    )

    gap: float
    stiffness: float
    damping: float
    model: Literal["unilateral", "classical"] = "unilateral"

    def __post_init__(self) -> None:
        require_numbers(self, gap=NOT_NEGATIVE, stiffness=POSITIVE, damping=NOT_NEGATIVE)
        require(
            self,
            "model",
            isinstance(self.model, str) and self.model in ("unilateral", "classical"),
            "'unilateral' or 'classical'",
        )

    def output(self, x: Any, memory: Any = None) -> tuple[Array, Any]:
        """Torque for ``x = (delta, rate)``; there is no memory, `memory` is handed through."""
        delta, rate = (floats(v, "output: x") for v in (x[0], x[1]))
        over, under = delta > self.gap / 2, delta < -self.gap / 2
        spring = delta - np.clip(delta, -self.gap / 2, self.gap / 2)
        torque = self.stiffness * spring + self.damping * rate
        if self.model == "classical":
            return np.where(over | under, torque, 0.0), memory
        return np.where(over, np.maximum(torque, 0), np.where(under, np.minimum(torque, 0), 0.0)), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain for ``delta = bias + amplitude*sin(omega t)`` and its rate; depends on the frequency.

        Exact with the phases at which contact begins and ends. "Unilateral" contact begins at the edge of the gap,
        with a jump ``c*rate``, or, where delta never returns into the gap, where the torque rises from zero; it ends
        where the torque falls to zero. With q = c omega/k and C the integral of cos^2 over the contact,

            gain = k/pi * [C + q (cos^2 end + cos^2 begin)/2 + j q (C + q cos^2(end)/2)]

        when it begins at the edge (derived by integration by parts; every term is positive, so none cancel).

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
        mean, gain = np.empty(a.size), np.empty(a.size, complex)
        fields = self.gap, self.stiffness, self.damping, self.model == "unilateral"
        describe_lock_pin(*fields, a.flatten(), b.flatten(), w.flatten(), mean, gain)
        return mean.reshape(a.shape), gain.reshape(a.shape)

    @property
    def closed_form(self) -> ClosedForm:
        """Gap, stiffness, damping and model, from which mean and gain are computed."""
        return ClosedForm(pin=(self.gap, self.stiffness, self.damping, float(self.model == "unilateral")))

    def thresholds(self, bias: float = 0.0) -> Array:
        """Distances of both edges of the gap from the bias."""
        return distances(self.gap / 2 - bias, self.gap / 2 + bias)

    def slope_bounds(self) -> tuple[float, float]:
        """Of the spring at a constant rate; infinite with a damper, which acts from the edge of the gap on."""
        if not self.damping:
            return (0.0 if self.gap else self.stiffness), self.stiffness
        return (-np.inf if self.model == "classical" else 0.0), np.inf

    def sector(self) -> tuple[float, float]:
        """As the slopes: infinite with a damper, whose torque grows with the rate."""
        return self.slope_bounds()

    linear_gain_is = "its stiffness and damping, in contact"

    def linear_gain(self) -> Array:
        """Spring and damper, in contact."""
        return np.array([[self.stiffness, self.damping]])

    def automaton(self) -> Automaton:
        """Free, in contact on either side and, if unilateral, released on either side."""
        return automata.lock_pin(self.gap, self.stiffness, self.damping, self.model == "unilateral")


@dataclass(frozen=True)
class NordinShaft(Nonlinearity, kind="nordin_shaft"):
    """Shaft with inner damping behind a gap, whose contact angle is a state of the loop.

    Inputs are the twist delta [rad], its rate [rad/s] and the contact angle theta_b [rad] (within ``gap/2`` of zero);
    outputs are the torque [N*m] and the rate of the contact angle [rad/s], which the linear part integrates. After
    Nordin, Galić and Gutman, "New models for backlash and gear play", Int. J. Adapt. Control Signal Process. 11, 1997.

    Parameters
    ----------
    gap : float
        Total free width [rad], at least zero.
    stiffness, damping : float
        Of the shaft [N*m/rad, N*m*s/rad], positive.

    Raises
    ------
    ModelError
        If a field is out of its range.
    """

    n_inputs: ClassVar[int] = 3
    n_outputs: ClassVar[int] = 2
    input_ports = ("twist", "rate", "contact")
    output_ports = ("torque", "contact_rate")
    units = _CONTACT
    input_is = "way"

    gap: float
    stiffness: float
    damping: float

    def __post_init__(self) -> None:
        require_numbers(self, gap=NOT_NEGATIVE, stiffness=POSITIVE, damping=POSITIVE)

    def output(self, x: Any, memory: Any = None) -> tuple[Array, Any]:
        """Torque and rate of the contact angle (trailing axis); `memory` is unused, the state is the third input."""
        delta, rate, contact = (floats(v, "output: x") for v in (x[0], x[1], x[2]))
        # Without torque the damper gives way as the spring relaxes, k (twist - contact) + c (twist - contact)' = 0.
        drift = rate + self.stiffness / self.damping * (delta - contact)
        half = self.gap / 2
        blocked = ((contact >= half) & (drift > 0)) | ((contact <= -half) & (drift < 0))
        # In the gap the shaft relaxes without torque; at either side what would move on is torque instead.
        return np.stack([np.where(blocked, self.damping * drift, 0.0), np.where(blocked, 0.0, drift)], -1), memory

    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean and gain for ``delta = bias + amplitude*sin(omega t)``, its rate, and a settled contact angle.

        Closed but for the phases at which contact begins, which are roots found to rounding (docs/theory/lock_pin.md,
        The damped shaft).

        Raises
        ------
        ModelError
            If an amplitude or a frequency is negative.
        """
        a, b, w = broadcast_with_frequency(amplitude, bias, omega)
        a = np.where(a == 0, SMALLEST_AMPLITUDE, a)
        mean, share = np.empty(a.size), np.empty(a.size, complex)
        points = a.flatten(), b.flatten(), w.flatten()
        describe_nordin_shaft(self.gap, self.stiffness, self.damping, *points, mean, share)
        means, part = mean.reshape(a.shape), share.reshape(a.shape)
        # In the gap and at a side alike the torque is spring plus damper of twist less contact angle.
        torque, rate = part * (self.stiffness + 1j * w * self.damping), 1j * w * (1.0 - part)
        return np.stack([means, 0.0 * means], -1), np.stack([torque, rate], -1)

    def thresholds(self, bias: float = 0.0) -> Array:
        """Half the gap, about any bias, as the contact angle is a state of its own."""
        return distances(self.gap / 2)

    def slope_bounds(self) -> tuple[float, float]:
        """Of the torque over the twist, at a constant rate and contact angle."""
        return 0.0, self.stiffness

    linear_gain_is = "its stiffness and damping, in contact"

    def linear_gain(self) -> Array:
        """Spring and damper, in contact, where the contact angle rests."""
        return np.array([[self.stiffness, self.damping, 0.0], [0.0, 0.0, 0.0]])

    def automaton(self) -> Automaton:
        """Free, in contact on either side."""
        return automata.nordin_shaft(self.gap, self.stiffness, self.damping)
