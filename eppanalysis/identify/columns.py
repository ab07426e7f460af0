"""What the columns of the benches' measured files hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class Role(StrEnum):
    """What a column of a measured file holds."""

    TIME = "time"
    FORCE = "force"
    VOLTAGE = "voltage"
    ANGLE = "angle"
    TORQUE = "torque"
    HARNESS = "harness"


#: SI unit of each role.
ROLES: Mapping[str, str] = dict(zip(Role, ("s", "N", "V", "rad", "N*m", "m"), strict=True))


@dataclass(frozen=True)
class Layout:
    """What the columns of a recorded response are of a case."""

    #: signals, inputs: signal of the loop, and external input, by the role of the column that may hold it.
    signals: Mapping[str, str]
    inputs: Mapping[str, str]
    units: Mapping[str, str]  # SI unit of every role, "time" among them
    clipped: tuple[str, ...] = ()  # roles whose sensor may saturate, which the loop itself does not know
    #: Whether a recorded input counts from its first row on; else from where the case has it before the start.
    from_first: bool = False


#: Of an elbow: its sensors and its harness.
ELBOW = Layout(
    {Role.ANGLE: "theta", Role.FORCE: "sensor_force"}, {Role.HARNESS: "harness_position"}, ROLES, (Role.FORCE,), True
)
