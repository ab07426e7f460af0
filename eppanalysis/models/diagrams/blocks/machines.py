"""Mechanical and electrical blocks of a diagram: motor, inertia, gear, shaft, pendulums on a cart and on wheels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError
from eppanalysis.models.devices.declared import quantity, required
from eppanalysis.models.diagrams.blocks.control import Block, static
from eppanalysis.models.elements.base import RATIO, Role
from eppanalysis.models.systems.linear import StateSpace

_TORQUE_CONSTANT = "N*m/A"


def _require_ratio(block: Block, ratio: float) -> None:
    """A gear turns the other way where its ratio is negative, and does nothing where it is zero."""
    if not ratio:
        raise ModelError(type(block).__name__, ratio, "a number other than zero", field="ratio")


def _moving(mass: float, damping: float, stiffness: float) -> StateSpace:
    """A mass, or an inertia, with place and speed as its states and outputs."""
    A = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    return StateSpace(A, np.array([[0.0], [1.0 / mass]]), np.eye(2), np.zeros((2, 1)))


@dataclass(frozen=True, kw_only=True)
class Inertia(Block, kind="inertia"):
    """``inertia angle'' + damping angle' + stiffness angle = torque``."""

    inputs: ClassVar[tuple[str, ...]] = ("torque",)
    outputs: ClassVar[tuple[str, ...]] = ("angle", "speed")
    port_units: ClassVar[Mapping[str, str]] = {"torque": "N*m", "angle": "rad", "speed": "rad/s"}

    inertia: float = required("Moment of inertia", "kg*m^2", above=0)
    damping: float = quantity(0.0, "Viscous friction", "N*m*s/rad", at_least=0)
    stiffness: float = quantity(0.0, "Spring to the ground; negative where it falls", "N*m/rad")

    def continuous(self) -> StateSpace:
        """States: angle and speed."""
        return _moving(self.inertia, self.damping, self.stiffness)


@dataclass(frozen=True, kw_only=True)
class Mass(Block, kind="mass"):
    """``mass position'' + damping position' + stiffness position = force``."""

    inputs: ClassVar[tuple[str, ...]] = ("force",)
    outputs: ClassVar[tuple[str, ...]] = ("position", "speed")
    port_units: ClassVar[Mapping[str, str]] = {"force": "N", "position": "m", "speed": "m/s"}

    mass: float = required("Mass", "kg", above=0)
    damping: float = quantity(0.0, "Viscous friction", "N*s/m", at_least=0)
    stiffness: float = quantity(0.0, "Spring to the ground; negative where it falls", "N/m")

    def continuous(self) -> StateSpace:
        """States: position and speed."""
        return _moving(self.mass, self.damping, self.stiffness)


@dataclass(frozen=True, kw_only=True)
class Motor(Block, kind="motor"):
    """A direct-current motor with its gear: angle, speed and torques are those behind the gear.

    ``inductance current' + resistance current + ratio back_emf speed = voltage`` and ``(ratio^2 inertia) angle'' +
    damping angle' = ratio torque_constant current + torque``; without an inductance the current follows at once.
    """

    inputs: ClassVar[tuple[str, ...]] = ("voltage", "torque")
    outputs: ClassVar[tuple[str, ...]] = ("angle", "speed", "current")
    units: ClassVar[Mapping[str, Role]] = {"ratio": RATIO}
    port_units: ClassVar[Mapping[str, str]] = {
        "voltage": "V", "torque": "N*m", "angle": "rad", "speed": "rad/s", "current": "A",
    }  # fmt: skip

    resistance: float = required("Resistance of the winding (ohm)", "V/A", "ohm", above=0)
    torque_constant: float = required("Torque per current", _TORQUE_CONSTANT)
    inertia: float = required("Moment of inertia of the rotor, before the gear", "kg*m^2", above=0)
    back_emf: float | None = quantity(None, "Voltage per speed of the rotor; the torque constant by default", "V*s/rad")
    inductance: float = quantity(0.0, "Inductance of the winding (henry)", "V*s/A", "H", at_least=0)
    damping: float = quantity(0.0, "Viscous friction behind the gear", "N*m*s/rad", at_least=0)
    ratio: float = quantity(1.0, "Turns of the motor per turn behind the gear")

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_ratio(self, self.ratio)

    def continuous(self) -> StateSpace:
        """States: angle, speed, and the current where there is an inductance."""
        J, N, R = self.ratio**2 * self.inertia, self.ratio, self.resistance
        emf = N * (self.torque_constant if self.back_emf is None else self.back_emf)
        push = N * self.torque_constant
        if not self.inductance:
            A = np.array([[0.0, 1.0], [0.0, -(self.damping + push * emf / R) / J]])
            B = np.array([[0.0, 0.0], [push / R / J, 1.0 / J]])
            C = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -emf / R]])
            return StateSpace(A, B, C, np.array([[0.0, 0.0], [0.0, 0.0], [1.0 / R, 0.0]]))
        L = self.inductance
        A = np.array([[0.0, 1.0, 0.0], [0.0, -self.damping / J, push / J], [0.0, -emf / L, -R / L]])
        B = np.array([[0.0, 0.0], [0.0, 1.0 / J], [1.0 / L, 0.0]])
        return StateSpace(A, B, np.eye(3), np.zeros((3, 2)))


@dataclass(frozen=True, kw_only=True)
class Gear(Block, kind="gear"):
    """An ideal gear: the ratio divides angle and speed on their way out, the torque on its way back."""

    inputs: ClassVar[tuple[str, ...]] = ("angle_in", "speed_in", "torque_in")
    outputs: ClassVar[tuple[str, ...]] = ("angle", "speed", "torque")
    units: ClassVar[Mapping[str, Role]] = {"ratio": RATIO}
    same_unit = True

    ratio: float = required("Turns before the gear per turn behind it")

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_ratio(self, self.ratio)

    def continuous(self) -> StateSpace:
        """No states."""
        return static(np.eye(3) / self.ratio)


@dataclass(frozen=True, kw_only=True)
class Shaft(Block, kind="shaft"):
    """A spring and a damper: ``torque = stiffness twist + damping rate``."""

    inputs: ClassVar[tuple[str, ...]] = ("twist", "rate")
    outputs: ClassVar[tuple[str, ...]] = ("torque",)
    port_units: ClassVar[Mapping[str, str]] = {"twist": "rad", "rate": "rad/s", "torque": "N*m"}

    stiffness: float = required("Stiffness", "N*m/rad", at_least=0)
    damping: float = quantity(0.0, "Damping", "N*m*s/rad", at_least=0)

    def continuous(self) -> StateSpace:
        """No states."""
        return static([[self.stiffness, self.damping]])


@dataclass(frozen=True, kw_only=True)
class CartPendulum(Block, kind="cart_pendulum"):
    """A pendulum upright on a cart, linearised; ``torque`` acts at its pivot, positive as ``angle``: forward."""

    inputs: ClassVar[tuple[str, ...]] = ("force", "torque")
    outputs: ClassVar[tuple[str, ...]] = ("position", "speed", "angle", "rate")
    port_units: ClassVar[Mapping[str, str]] = {
        "force": "N", "torque": "N*m", "position": "m", "speed": "m/s", "angle": "rad", "rate": "rad/s",
    }  # fmt: skip

    carriage_mass: float = required("Of the cart, or both wheels", "kg", above=0)
    mass: float = required("Of the pendulum", "kg", above=0)
    length: float = required("From pivot to centre of mass", "m", above=0)
    inertia: float = quantity(0.0, "About the centre of mass", "kg*m^2", at_least=0)
    damping: float = quantity(0.0, "Viscous friction of the carriage", "N*s/m", at_least=0)
    pivot_damping: float = quantity(0.0, "Of the pivot", "N*m*s/rad", at_least=0)
    gravity: float = quantity(9.80665, "Negative where it hangs", "m/s^2")

    def continuous(self) -> StateSpace:
        """States: position, speed, angle and its rate."""
        found = self._moving(self.carriage_mass, turn=np.array([0.0, 1.0]), pushes=np.eye(2))
        return StateSpace(*found, np.eye(4), np.zeros((4, 2)))

    def _moving(self, carriage: float, turn: Array, pushes: Array) -> tuple[Array, Array]:
        """State and input matrix; the pivot turns by `turn` @ (position, angle), inputs push either by `pushes`."""
        lever, about = self.mass * self.length, self.inertia + self.mass * self.length**2
        # The determinant of their inertias, without the difference of its large terms.
        size = carriage * about + self.mass * self.inertia
        moved = np.array([[about, -lever], [-lever, carriage + self.mass]]) / size
        friction = np.diag([self.damping, 0.0]) + self.pivot_damping * np.outer(turn, turn)
        A, B = np.zeros((4, 4)), np.zeros((4, pushes.shape[1]))
        A[[0, 2], [1, 3]] = 1.0
        A[1::2, 2] = moved[:, 1] * (lever * self.gravity)
        A[1::2, 1::2], B[1::2] = -moved @ friction, moved @ pushes
        return A, B


@dataclass(frozen=True, kw_only=True)
class WheeledPendulum(CartPendulum, kind="wheeled_pendulum"):
    """The same on two wheels that ``torque`` turns against it: a robot that balances; ``force`` acts on the axle."""

    inputs: ClassVar[tuple[str, ...]] = ("torque", "force")
    outputs: ClassVar[tuple[str, ...]] = ("position", "speed", "angle", "rate", "wheel_angle", "wheel_speed")
    port_units: ClassVar[Mapping[str, str]] = {
        **CartPendulum.port_units, "wheel_angle": "rad", "wheel_speed": "rad/s",
    }  # fmt: skip

    radius: float = required("Of a wheel", "m", above=0)
    wheel_inertia: float = quantity(0.0, "Of both wheels", "kg*m^2", at_least=0)

    def continuous(self) -> StateSpace:
        """States: position, speed, angle of the body and its rate."""
        turn = np.array([1.0 / self.radius, -1.0])
        carriage = self.carriage_mass + self.wheel_inertia / self.radius**2
        found = self._moving(carriage, turn, pushes=np.column_stack([turn, [1.0, 0.0]]))
        return StateSpace(*found, np.vstack([np.eye(4), np.kron(turn, np.eye(2))]), np.zeros((6, 2)))
