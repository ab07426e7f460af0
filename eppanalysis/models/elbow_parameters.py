"""Parameters of the elbow under extended physiological proprioception (EPP), section by section.

Every field is in SI units and carries the nominal value of the bench elbow of Farrell, Weir, Heckathorne and Childress,
J Rehabil Res Dev 42(5), 2005, lying on its side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from eppanalysis.errors import ModelError

#: One pound-force [N] and standard gravity [m/s^2], both exact by definition.
POUND_FORCE = 4.4482216152605
STANDARD_GRAVITY = 9.80665


def _check(section: object, positive: tuple[str, ...] = (), not_negative: tuple[str, ...] = ()) -> None:
    """Raise ModelError unless the named fields (None is let through) are finite and have the right sign."""
    name = type(section).__name__
    for field_name in (*positive, *not_negative):
        value = getattr(section, field_name)
        if value is None:
            continue
        if not math.isfinite(value):
            raise ModelError(name, value, "a finite number", field=field_name)
        if value < 0 or (value == 0 and field_name in positive):
            wanted = "a positive number" if field_name in positive else "zero or a positive number"
            raise ModelError(name, value, wanted, field=field_name)


@dataclass(frozen=True)
class Drive:
    """Motor, gearing and H-bridge seen at the output shaft.

    Attributes
    ----------
    supply_voltage : float
        [V].
    no_load_speed : float
        At the supply voltage [rad/s].
    stall_torque : float
        At the supply voltage [N*m].
    inertia : float
        [kg*m^2].
    coulomb_friction : float
        [N*m]; 0 leaves it out.
    electrical_time_constant : float
        [s].

    Raises
    ------
    ModelError
        If a number is not finite or has the wrong sign.
    """

    supply_voltage: float = 16.0
    no_load_speed: float = math.radians(164.0)
    stall_torque: float = 10.93
    inertia: float = 0.03
    coulomb_friction: float = 0.3
    electrical_time_constant: float = 1e-3

    def __post_init__(self) -> None:
        positive = ("supply_voltage", "no_load_speed", "stall_torque", "inertia", "electrical_time_constant")
        _check(self, positive, ("coulomb_friction",))


@dataclass(frozen=True)
class Controller:
    """Timing of the controller.

    Attributes
    ----------
    delay : float
        Computation and PWM [s]; 0 leaves it out.
    sample_period : float or None
        Time between two readings of the sensor [s]; None is continuous.

    Raises
    ------
    ModelError
        If a number is not finite or has the wrong sign.
    """

    delay: float = 1e-3
    sample_period: float | None = None

    def __post_init__(self) -> None:
        _check(self, ("sample_period",), ("delay",))


@dataclass(frozen=True)
class Bands:
    """Thresholds of the five-band law: `centre`, `parking_width` and `range`, or all four thresholds in their place.

    Attributes
    ----------
    centre, parking_width, range : float
        Middle of the parking band, its width F_high - F_low, and the profile range F_max - F_slack [N].
    slack, low, high, max : float or None
        The four thresholds [N]; when they are given, the three fields above do not count.
    offset_voltage : float
        Jump of the voltage at the inner edges [V].

    Raises
    ------
    ModelError
        If thresholds are out of order, not all four are given, or a number is not finite.
    """

    centre: float = 2.5 * POUND_FORCE
    parking_width: float = 0.2 * POUND_FORCE
    range: float = 2.5 * POUND_FORCE
    slack: float | None = None
    low: float | None = None
    high: float | None = None
    max: float | None = None
    offset_voltage: float = 0.0

    def __post_init__(self) -> None:
        _check(self, ("centre", "parking_width", "range", "low", "high", "max"), ("offset_voltage",))
        given = [getattr(self, n) is not None for n in ("slack", "low", "high", "max")]
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
class LockPinParameters:
    """Free-swing backlash between drive and forearm.

    Attributes
    ----------
    backlash : float
        Total gap [rad].
    stiffness, damping : float
        In contact [N*m/rad], [N*m*s/rad].

    Raises
    ------
    ModelError
        If a number is not finite or has the wrong sign.
    """

    backlash: float = math.radians(2.5)
    stiffness: float = 1000.0
    damping: float = 1.0

    def __post_init__(self) -> None:
        _check(self, ("stiffness",), ("backlash", "damping"))


@dataclass(frozen=True)
class Forearm:
    """Forearm and prehensor.

    Attributes
    ----------
    inertia : float
        About the elbow axis [kg*m^2]; does not count when `prehensor_mass` is given.
    prehensor_mass, prehensor_distance, shell_inertia : float
        Give the inertia as m l^2 + shell_inertia [kg], [m], [kg*m^2].
    viscous_friction : float
        [N*m*s/rad].
    gravity_moment : float
        Largest moment of gravity [N*m]; 0 on its side.
    upright : bool
        Take the gravity moment m g l of the prehensor in place of `gravity_moment`.

    Raises
    ------
    ModelError
        If a number is not finite or has the wrong sign.
    """

    inertia: float = 0.0465
    prehensor_mass: float | None = None
    prehensor_distance: float = 0.30
    shell_inertia: float = 0.006
    viscous_friction: float = 0.01
    gravity_moment: float = 0.0
    upright: bool = False

    def __post_init__(self) -> None:
        positive = ("inertia", "prehensor_mass", "prehensor_distance")
        _check(self, positive, ("shell_inertia", "viscous_friction", "gravity_moment"))
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
class Cable:
    """The cable, two springs in series, or two of them.

    Attributes
    ----------
    stiffness : float
        Series stiffness K [N/m].
    spring_ratio : float
        Forearm side over harness side, k_f/k_h.
    antagonist : bool
        Bidirectional EPP: an equal second cable that pulls the other way and is wound up as the first unwinds.
    pretension : float or None
        Tension of both cables at the start [N]; by default the centre of the parking band. Only with `antagonist`.

    Raises
    ------
    ModelError
        If a number is not finite or has the wrong sign.
    """

    stiffness: float = 6705.263
    spring_ratio: float = 4.0
    antagonist: bool = False
    pretension: float | None = None

    def __post_init__(self) -> None:
        _check(self, ("stiffness", "spring_ratio", "pretension"))
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
class Pulley:
    """The pulley on the elbow axis.

    Attributes
    ----------
    radius : float
        [m].
    friction : float
        Static friction over the bearing load, mu; 0 is the ball bearing.
    flexion_angle : float
        Operating flexion angle psi [rad].
    kinetic_ratio : float
        Kinetic over static friction, 0 to 1.

    Raises
    ------
    ModelError
        If a number is not finite or out of range.
    """

    radius: float = 0.019
    friction: float = 0.0526
    flexion_angle: float = math.radians(116.4)
    kinetic_ratio: float = 0.8

    def __post_init__(self) -> None:
        _check(self, ("radius",), ("friction", "flexion_angle", "kinetic_ratio"))
        if self.kinetic_ratio > 1:
            raise ModelError("Pulley", self.kinetic_ratio, "0 to 1", field="kinetic_ratio")
        if self.flexion_angle > math.pi:
            raise ModelError("Pulley", self.flexion_angle, "at most 180 deg", field="flexion_angle")
        if self.load_friction >= 1:
            expected = "mu sin(psi/2) < 1, or the pulley never slides"
            raise ModelError("Pulley", self.friction, expected, field="friction")

    @property
    def load_friction(self) -> float:
        """Friction over the sum of the two tensions, mu sin(psi/2)."""
        return self.friction * math.sin(self.flexion_angle / 2)


@dataclass(frozen=True)
class Harness:
    """What the user, or the step-input board, does.

    Attributes
    ----------
    step : float
        Height of the step at t = 0 [m].
    """

    step: float = 0.020

    def __post_init__(self) -> None:
        if not math.isfinite(self.step):
            raise ModelError("Harness", self.step, "a finite number", field="step")


@dataclass(frozen=True)
class Sensor:
    """The force sensor; what is None is left out.

    Attributes
    ----------
    gain : float
        [V/N].
    full_scale : float
        Range of the converter [V]; 10 V are 5 lbf.
    bits : int or None
        Resolution of the converter.
    filter : float or None
        Time constant of a first-order filter in front of the converter [s].

    Raises
    ------
    ModelError
        If a number is not finite or has the wrong sign.
    """

    gain: float = 2.0 / POUND_FORCE
    full_scale: float = 10.0
    bits: int | None = None
    filter: float | None = None

    def __post_init__(self) -> None:
        _check(self, ("gain", "full_scale", "bits", "filter"))
        if self.bits is not None and not (isinstance(self.bits, int) and 1 <= self.bits <= 24):
            raise ModelError("Sensor", self.bits, "a whole number from 1 to 24", field="bits")

    @property
    def force_step(self) -> float:
        """One step of the converter, as a force [N]."""
        return self.full_scale / self.gain / 2 ** (self.bits or 0)


@dataclass(frozen=True)
class Parking:
    """The parking logic.

    Attributes
    ----------
    dwell_time : float or None
        Time in the parking band after which the elbow parks [s]; None is without parking logic.

    Raises
    ------
    ModelError
        If the number is not finite or not positive.
    """

    dwell_time: float | None = None

    def __post_init__(self) -> None:
        _check(self, ("dwell_time",))


@dataclass(frozen=True)
class ElbowParameters:
    """All parameters of the elbow, in SI units; the defaults are the nominal ones.

    Examples
    --------
    >>> from dataclasses import replace
    >>> nominal = ElbowParameters()
    >>> fig8a = replace(nominal, pulley=replace(nominal.pulley, friction=0.0))
    >>> round(fig8a.cable.stiffness * fig8a.pulley.radius * fig8a.lock_pin.backlash / POUND_FORCE, 2)
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
