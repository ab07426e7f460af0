"""Parameters of the elbow under extended physiological proprioception (EPP), section by section.

Every field is declared here and nowhere else, in SI units, with the nominal value of the bench elbow of Farrell, Weir,
Heckathorne and Childress, J Rehabil Res Dev 42(5), 2005, lying on its side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from eppanalysis.errors import ModelError
from eppanalysis.models.devices.declared import Declared, Section, declared_fields, flag, quantity, whole_number

#: One pound-force [N] and standard gravity [m/s^2], both exact by definition.
POUND_FORCE = 4.4482216152605
STANDARD_GRAVITY = 9.80665
#: Half a turn, and what rounding makes of 180 deg [rad].
_HALF_TURN = 3.141592653589794


@dataclass(frozen=True)
class Drive(Section):
    """Motor, gearing and H-bridge seen at the output shaft."""

    supply_voltage: float = quantity(16.0, "Supply voltage", "V", above=0)
    no_load_speed: float = quantity(math.radians(164.0), "At the supply voltage", "rad/s", "deg/s", above=0)
    stall_torque: float = quantity(10.93, "At the supply voltage", "N*m", above=0)
    inertia: float = quantity(0.03, "Motor and gearing at the output", "kg*m^2", above=0)
    coulomb_friction: float = quantity(0.3, "At the output; 0 leaves it out", "N*m", at_least=0)
    electrical_time_constant: float = quantity(1e-3, "Inductance over resistance", "s", "ms", above=0)


@dataclass(frozen=True)
class Controller(Section):
    """Timing of the controller."""

    delay: float = quantity(1e-3, "Computation and PWM; 0 leaves it out", "s", "ms", at_least=0)
    sample_period: float | None = quantity(
        None, "Time between two readings of the sensor; None is continuous", "s", "ms", above=0
    )


@dataclass(frozen=True)
class Bands(Section):
    """Thresholds of the five-band law: centre, parking width and range, or all four of them."""

    #: Two ways to give the thresholds; where all four are given, the widths do not count.
    WIDTHS: ClassVar[tuple[str, ...]] = ("centre", "parking_width", "range")
    THRESHOLDS: ClassVar[tuple[str, ...]] = ("slack", "low", "high", "max")

    centre: float = quantity(2.5 * POUND_FORCE, "Middle of the parking band", "N", "lbf", above=0, optional=True)
    parking_width: float = quantity(
        0.2 * POUND_FORCE, "Width of the parking band, F_high - F_low", "N", "lbf", above=0, optional=True
    )
    range: float = quantity(2.5 * POUND_FORCE, "Profile range, F_max - F_slack", "N", "lbf", above=0, optional=True)
    slack: float | None = quantity(None, "Threshold F_slack", "N", "lbf")
    low: float | None = quantity(None, "Threshold F_low", "N", "lbf", above=0)
    high: float | None = quantity(None, "Threshold F_high", "N", "lbf", above=0)
    max: float | None = quantity(None, "Threshold F_max", "N", "lbf", above=0)
    offset_voltage: float = quantity(0.0, "Jump of the voltage at the inner edges", "V", at_least=0, optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [getattr(self, n) is not None for n in self.THRESHOLDS]
        if any(given) and not all(given):
            raise ModelError("Bands: only some of slack, low, high and max are given", expected="all four or none")
        slack, low, high, top = self.thresholds
        if not slack < low < high < top:
            found = f"Bands: thresholds {slack}, {low}, {high}, {top} N"
            raise ModelError(found, expected="slack < low < high < max")
        if low <= 0:
            raise ModelError(f"Bands: low is {low} N", expected="a positive tension")

    @property
    def thresholds(self) -> tuple[float, float, float, float]:
        """Slack, low, high, max [N]."""
        if self.slack is not None and self.low is not None and self.high is not None and self.max is not None:
            return self.slack, self.low, self.high, self.max
        half, inner = self.range / 2, self.parking_width / 2
        return self.centre - half, self.centre - inner, self.centre + inner, self.centre + half

    @property
    def parking_centre(self) -> float:
        """Middle of the parking band, the tension at which every run starts [N]."""
        _, low, high, _ = self.thresholds
        return (low + high) / 2


@dataclass(frozen=True)
class LockPinParameters(Section):
    """Free-swing backlash between drive and forearm."""

    #: A gap of more than a full turn is none.
    backlash: float = quantity(math.radians(2.5), "Total gap", "rad", "deg", at_least=0, at_most=2.0 * math.pi)
    stiffness: float = quantity(1000.0, "In contact", "N*m/rad", above=0)
    damping: float = quantity(1.0, "In contact", "N*m*s/rad", at_least=0)


@dataclass(frozen=True)
class Forearm(Section):
    """Forearm and prehensor."""

    inertia: float = quantity(
        0.0465, "About the elbow axis; does not count when `prehensor_mass` is given", "kg*m^2", above=0, optional=True
    )
    prehensor_mass: float | None = quantity(
        None, "Mass m in the inertia m l^2 + `shell_inertia`, where it is given", "kg", above=0
    )
    prehensor_distance: float = quantity(0.30, "Distance l of that mass from the axis", "m", above=0, optional=True)
    shell_inertia: float = quantity(0.006, "Inertia of the forearm alone", "kg*m^2", at_least=0, optional=True)
    viscous_friction: float = quantity(0.01, "At the elbow axis", "N*m*s/rad", at_least=0)
    gravity_moment: float = quantity(0.0, "Largest moment of gravity; 0 on its side", "N*m", at_least=0, optional=True)
    upright: bool = flag("Take the gravity moment m g l of the prehensor in place of `gravity_moment`")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.upright and self.gravity_moment:
            raise ModelError("Forearm: both upright and gravity_moment are given", expected="one of them")

    @property
    def total_inertia(self) -> float:
        """Inertia that the equations use [kg*m^2]."""
        if self.prehensor_mass is None:
            return self.inertia
        return self.prehensor_mass * self.prehensor_distance**2 + self.shell_inertia

    @property
    def equivalent_mass(self) -> float | None:
        """Mass at the prehensor's distance that gives the inertia with the shell [kg]; None where the shell has all."""
        if self.prehensor_mass is not None:
            return self.prehensor_mass
        mass = (self.inertia - self.shell_inertia) / self.prehensor_distance**2
        return mass if mass > 0 else None

    @property
    def total_gravity_moment(self) -> float:
        """Gravity moment that the equations use [N*m]; upright, m l follows from the inertia: (J - shell)/l."""
        if not self.upright:
            return self.gravity_moment
        return STANDARD_GRAVITY * max(0.0, self.total_inertia - self.shell_inertia) / self.prehensor_distance


@dataclass(frozen=True)
class Cable(Section):
    """The cable, or two of them."""

    stiffness: float = quantity(6705.263, "Stiffness K of its two springs in series", "N/m", above=0)
    spring_ratio: float = quantity(4.0, "Forearm side over harness side, k_f/k_h", above=0)
    antagonist: bool = flag(
        "Bidirectional EPP: an equal second cable that pulls the other way and is wound up as the first unwinds"
    )
    pretension: float | None = quantity(
        None,
        "Tension of both cables at the start, by default the centre of the parking band; only with `antagonist`",
        "N",
        "lbf",
        above=0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pretension is not None and not self.antagonist:
            raise ModelError("Cable: pretension is given without antagonist", expected="both")

    @property
    def harness_stiffness(self) -> float:
        """k_h = K (1 + rho)/rho [N/m]."""
        return self.stiffness * (1.0 + self.spring_ratio) / self.spring_ratio

    @property
    def forearm_stiffness(self) -> float:
        """k_f = K (1 + rho) [N/m]."""
        return self.stiffness * (1.0 + self.spring_ratio)


@dataclass(frozen=True)
class Pulley(Section):
    """The pulley on the elbow axis."""

    radius: float = quantity(0.019, "Radius", "m", "mm", above=0)
    friction: float = quantity(0.0526, "Static friction over the bearing load, mu; 0 is the ball bearing", at_least=0)
    flexion_angle: float = quantity(
        math.radians(116.4), "Operating flexion angle psi", "rad", "deg", at_least=0, at_most=_HALF_TURN
    )
    kinetic_ratio: float = quantity(0.8, "Kinetic over static friction", at_least=0, at_most=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.load_friction >= 1:
            expected = "mu sin(psi/2) < 1, or the pulley never slides"
            raise ModelError("Pulley", self.friction, expected, field="friction")

    @property
    def load_friction(self) -> float:
        """Friction over the sum of the two tensions, mu sin(psi/2)."""
        return self.friction * math.sin(self.flexion_angle / 2)


@dataclass(frozen=True)
class Harness(Section):
    """What the user, or the step-input board, does."""

    step: float = quantity(0.020, "Height of the step at t = 0", "m", "mm")


@dataclass(frozen=True)
class Sensor(Section):
    """The force sensor; what is not given is left out."""

    left_out: ClassVar[bool] = True

    gain: float = quantity(2.0 / POUND_FORCE, "Voltage over force", "V/N", "V/lbf", above=0, optional=True)
    full_scale: float = quantity(10.0, "Range of the converter; 10 V are 5 lbf", "V", above=0, optional=True)
    bits: int | None = whole_number("Resolution of the converter", 1, 24)
    filter: float | None = quantity(
        None, "Time constant of a first-order filter in front of the converter", "s", "ms", above=0
    )
    lead: float | None = quantity(
        None, "Time constant of a lead in that filter, (lead s + 1)/(filter s + 1)", "s", "ms", above=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lead is not None and self.filter is None:
            raise ModelError(
                f"Sensor: lead is {self.lead} s, and there is no filter", expected="a filter, which limits the lead"
            )

    @property
    def force_step(self) -> float:
        """One step of the converter, as a force [N]."""
        return self.full_scale / self.gain / 2 ** (self.bits or 0)


@dataclass(frozen=True)
class Parking(Section):
    """The parking logic."""

    left_out: ClassVar[bool] = True

    dwell_time: float | None = quantity(
        None, "Time in the parking band after which the elbow parks; None is without parking logic", "s", "ms", above=0
    )


@dataclass(frozen=True)
class ElbowParameters:
    """All parameters of the elbow, in SI units; the defaults are the nominal ones.

    Attributes
    ----------
    drive : Drive
        Motor, gearing and H-bridge, seen at the output shaft.
    controller : Controller
        Its timing: dead time and sample period.
    bands : Bands
        Thresholds of the five-band law; its range sets the gain.
    lock_pin : LockPinParameters
        Backlash between drive and forearm, and the stiffness of the contact.
    forearm : Forearm
        Inertia, friction and weight of forearm and prehensor.
    cable : Cable
        Stiffness and damping of the control cable.
    pulley : Pulley
        Radius and friction on the elbow axis.
    harness : Harness
        What the user, or the step-input board, does.
    sensor : Sensor
        Of the force; what is not given is left out.
    parking : Parking
        The band and the time after which the controller brakes.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from eppanalysis import ElbowParameters
    >>> from eppanalysis.models.devices.elbow.parameters import POUND_FORCE
    >>> nominal = ElbowParameters()
    >>> fig8a = replace(nominal, pulley=replace(nominal.pulley, friction=0.0))

    Play of the lock pin as travel of the cable, and the force that it makes [lbf]:

    >>> play = fig8a.pulley.radius * fig8a.lock_pin.backlash
    >>> round(fig8a.cable.stiffness * play / POUND_FORCE, 2)
    1.25
    """

    drive: Drive = field(default_factory=Drive)
    controller: Controller = field(default_factory=Controller)
    bands: Bands = field(default_factory=Bands)
    lock_pin: LockPinParameters = field(default_factory=LockPinParameters)
    forearm: Forearm = field(default_factory=Forearm)
    cable: Cable = field(default_factory=Cable)
    pulley: Pulley = field(default_factory=Pulley)
    harness: Harness = field(default_factory=Harness)
    sensor: Sensor = field(default_factory=Sensor)
    parking: Parking = field(default_factory=Parking)

    @classmethod
    def sections(cls) -> dict[str, type[Section]]:
        """The sections by their names, in the order of a case file."""
        made: dict[str, Any] = {found.name: found.default_factory for found in fields(cls)}
        return made


def declared(name: str) -> Declared:
    """What is known of a field of the elbow, by its dotted name.

    Examples
    --------
    >>> declared("lock_pin.backlash").unit
    'rad'
    """
    section, _, field_name = name.partition(".")
    return declared_fields(ElbowParameters.sections()[section])[field_name]
